// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/drive_reader.h"

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/file_driver_reader.h"
#include "mbdae/deck/scalar_reader.h"
#include "mbdae/drive/drive_library.h"

namespace mbdae::reading {
namespace {

constexpr int kDeepestDrive = 64;    ///< written within one card
constexpr int kLongestChain = 1000;  ///< by references
constexpr double kMostParts = 100000;

enum DriveKind {
  kConst,
  kNull,
  kUnit,
  kOne,
  kTime,
  kTimeStep,
  kDirect,
  kRamp,
  kSine,
  kCosine,
  kStep,
  kString,
  kArray,
  kMult,
  kReference,
  kLinear,
  kNode,
  kElement,
  kDof,
  kParabolic,
  kCubic,
  kPiecewiseLinear,
  kFile
};

constexpr const char* kDrives[] = {"const",     "null",
                                   "unit",      "one",
                                   "time",      "timestep",
                                   "direct",    "ramp",
                                   "sine",      "cosine",
                                   "step",      "string",
                                   "array",     "mult",
                                   "reference", "linear",
                                   "node",      "element",
                                   "dof",       "parabolic",
                                   "cubic",     "piecewise linear",
                                   "file"};

/// Drives of the language that are not read here.
constexpr const char* kOtherDrives[] = {
    "closest next", "discrete filter", "double ramp",     "double step", "drive",    "event",
    "exponential",  "fourier series",  "frequency sweep", "meter",       "periodic", "postponed",
    "random",       "sample and hold", "scalar function", "switch",      "tanh",     "while"};

DrivePtr read(Context& context, int depth);

/// A drive within another or within a vector: there `timestep` is its argument, the time.
DrivePtr read_part(Context& context, int depth) {
  DrivePtr drive = read(context, depth);
  if (dynamic_cast<const TimeStepDrive*>(drive.get()) != nullptr) return std::make_shared<const TimeDrive>();
  return drive;
}

DrivePtr constant(double value) { return std::make_shared<const ConstDrive>(value); }

DrivePtr read_ramp(Context& context) {
  Input& input = context.input;
  const double slope = input.real("the slope of the ramp");
  const double start = input.real("the initial time of the ramp");
  input.need("the final time of the ramp");
  const SourcePosition where = input.where();
  const double end =
      input.take("forever") ? std::numeric_limits<double>::infinity() : input.real("the final time of the ramp");
  if (!(end >= start)) {
    input.fail(where, "the ramp ends at " + number_text(end) + " s, before it starts at " + number_text(start) + " s");
  }
  const double initial = input.real("the initial value of the ramp");
  if (slope == 0.0) return constant(initial);
  return std::make_shared<const RampDrive>(slope, start, end, initial);
}

template <class Wave>
DrivePtr read_wave(Context& context, bool sine) {
  static constexpr const char* kCycles[] = {"half", "one", "forever"};
  Input& input = context.input;
  const double start = input.real("the initial time");
  const double w = input.real("the angular frequency");
  const double amplitude = input.real("the amplitude");
  input.need("a number of cycles, half, one, or forever");
  const SourcePosition where = input.where();
  const int word = input.take_any(kCycles);
  double cycles = std::numeric_limits<double>::infinity();
  if (word == 0) {
    cycles = sine ? 0.25 : 0.5;  // stops at the top
  } else if (word != 2) {
    const std::int64_t n = word == 1 ? 1 : input.integer("a number of cycles, half, one, or forever");
    if (n == 0) {
      input.fail(where, "found 0 cycles, expected 1 or more, -1 or less (to stop at the top), half, one, or forever");
    }
    // Negative numbers stop where the slope is zero: at the top.
    cycles = std::abs(static_cast<double>(n)) - (n < 0 ? (sine ? 0.75 : 0.5) : (sine ? 0.5 : 0.0));
  }
  const double initial = input.real("the initial value");
  if (amplitude == 0.0 || w == 0.0) return constant(initial);
  const double duration = cycles * 2.0 * std::numbers::pi / std::abs(w);
  return std::make_shared<const Wave>(start, w, amplitude, duration, initial);
}

DrivePtr read_array(Context& context, int depth) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  const std::int64_t count = input.integer("the number of drives");
  if (count < 1) input.fail(where, "found " + std::to_string(count) + " drives, expected 1 or more");
  std::vector<DrivePtr> drives;
  for (std::int64_t i = 0; i < count; ++i) {
    input.need([&] { return "drive " + std::to_string(i + 1) + " of " + std::to_string(count); });
    drives.push_back(read_part(context, depth + 1));
  }
  return std::make_shared<const SumDrive>(std::move(drives));
}

/// Refuses a drive that reads the state where its user does not expect one.
void check_state_drive(Context& context, const SourcePosition& where) {
  if (context.state_drives) return;
  context.input.fail(where,
                     "not supported here: a drive that reads the state; it may drive forces, genels, total joints, "
                     "velocities, distances and activations");
}

/// The drive of the signal's value.
DrivePtr nested(Context& context, int depth, std::shared_ptr<const Signal> signal) {
  context.input.need("the drive of the value: direct, linear, string, ...");
  const SourcePosition where = context.input.where();
  DrivePtr drive = read_part(context, depth + 1);
  if (drive->reads_state()) {
    context.input.fail(where, "not supported: a drive that reads the state within another one");
  }
  return std::make_shared<const SignalDrive>(std::move(signal), std::move(drive));
}

DrivePtr read_polynomial(Input& input, std::size_t count) {
  std::array<double, 4> a{};
  for (std::size_t i = 0; i < count; ++i) a[i] = input.real("a coefficient of the drive");
  return std::make_shared<const PolynomialDrive>(a);
}

DrivePtr read_piecewise_linear(Input& input) {
  const SourcePosition where = input.where();
  const std::int64_t count = input.integer("the number of points");
  if (count < 2) input.fail(where, "found " + std::to_string(count) + " points, expected 2 or more");
  std::vector<std::pair<double, double>> points;
  for (std::int64_t i = 0; i < count; ++i) {
    input.need([&] { return "point " + std::to_string(i + 1) + " of " + std::to_string(count); });
    const SourcePosition here = input.where();
    const double time = input.real("the time of a point");
    if (!points.empty() && !(time > points.back().first)) {
      input.fail(here, "found time " + number_text(time) + " after " + number_text(points.back().first) +
                           ", expected increasing times");
    }
    points.emplace_back(time, input.real("the value at a point"));
  }
  return std::make_shared<const PiecewiseLinearDrive>(std::move(points));
}

DrivePtr read_any(Context& context, int depth) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  if (depth > kDeepestDrive)
    input.fail(where, "drives nested deeper than " + std::to_string(kDeepestDrive) + " levels");
  input.need([&] { return "a drive: " + joined(kDrives) + ", or a number"; });
  switch (input.take_any(kDrives)) {
    case kConst:
      return constant(input.real("the value of the drive"));
    case kNull:
      return constant(0.0);
    case kUnit:
    case kOne:
      return constant(1.0);
    case kTime:
    case kDirect:
      return std::make_shared<const TimeDrive>();
    case kTimeStep:
      return std::make_shared<const TimeStepDrive>(context.time_step());
    case kRamp:
      return read_ramp(context);
    case kSine:
      return read_wave<SineDrive>(context, true);
    case kCosine:
      return read_wave<CosineDrive>(context, false);
    case kStep: {
      const double start = input.real("the time of the step");
      const double amplitude = input.real("the height of the step");
      return std::make_shared<const StepDrive>(start, amplitude, input.real("the initial value of the step"));
    }
    case kString:
      return input.string_drive(context.time_step(), context.initial_time(), [&](const Label& label) {
        DrivePtr drive = context.drives.get(input, label);
        if (context.file_callers.count(label.value) != 0) {
          input.fail(where, "not supported: a drive that reads a file within a string");
        }
        if (drive->reads_state()) {
          input.fail(where, "not supported: a drive that reads the state within a string");
        }
        return drive;
      });
    case kArray:
      return read_array(context, depth);
    case kMult: {
      DrivePtr first = read_part(context, depth + 1);
      return std::make_shared<const ProductDrive>(std::move(first), read_part(context, depth + 1));
    }
    case kReference: {
      const Label label = input.label("the label of a drive caller");
      DrivePtr drive = context.drives.get(input, label);
      if (context.file_callers.count(label.value) != 0) ++context.file_drives;
      if (drive->reads_state()) check_state_drive(context, where);
      return drive;
    }
    case kLinear: {
      const double initial = input.real("the value at zero");
      return std::make_shared<const LinearDrive>(initial, input.real("the slope"));
    }
    case kNode:
      check_state_drive(context, where);
      return nested(context, depth, read_node_signal(context));
    case kElement:
      check_state_drive(context, where);
      return nested(context, depth, read_element_signal(context));
    case kDof:
      check_state_drive(context, where);
      return nested(context, depth, read_dof_signal(context));
    case kParabolic:
      return read_polynomial(input, 3);
    case kCubic:
      return read_polynomial(input, 4);
    case kPiecewiseLinear:
      return read_piecewise_linear(input);
    case kFile:
      return read_file_drive(context);
    default:
      break;
  }
  if (const auto words = input.peek_words(); words && !input.symbols().find(input.peek_text())) {
    for (const char* other : kOtherDrives) {
      if (words->is(other)) input.fail(where, std::string("not supported: the drive `") + other + "`");
    }
    const std::string hint = suggestion(words->text, kDrives);
    input.fail(where, (hint.empty() ? "not supported: the drive " : "unknown drive ") + quoted(words->written) +
                          ", expected: " + joined(kDrives) + ", or a number" + hint);
  }
  return constant(input.real("a drive or a number"));
}

DrivePtr read(Context& context, int depth) {
  const SourcePosition where = context.input.where();
  DrivePtr drive = read_any(context, depth);
  if (drive->depth() > kLongestChain) {
    context.input.fail(where,
                       "drives that refer to one another over more than " + std::to_string(kLongestChain) + " steps");
  }
  if (drive->count() > kMostParts) {
    context.input.fail(where, "a drive made of more than " + std::to_string(static_cast<int>(kMostParts)) +
                                  " others (each reference counts with all that it refers to)");
  }
  if (depth == 0 && drive->has_pieces()) context.deck.pieced_drives.push_back(drive);
  return drive;
}

template <int N>
using Vector = Eigen::Matrix<double, N, 1>;

/// Reads the direction of a single entity.
template <int N>
Vector<N> read_entity(Context& context, const Place* place, bool explicitly_single) {
  if constexpr (N == 3) {
    Input& input = context.input;
    const auto words = input.peek_words();
    if (words && words->is("reference")) {
      if (!explicitly_single)
        input.fail(words->where, "a frame needs the word `single` before it: `single, reference, ...`");
      if (place == nullptr) input.fail(words->where, "not supported: a frame for the direction of this drive");
      return read_direction(context, *place);
    }
    return read_vec3(input, "a component of the direction");
  } else {
    (void)place;
    (void)explicitly_single;
    return read_vec6(context.input, "a component of the direction");
  }
}

/// A direction and its drive.
template <int N>
void read_term(Context& context, const Place* place, bool single, VectorDrive<N>* out) {
  const Vector<N> direction = read_entity<N>(context, place, single);
  DrivePtr drive = read_part(context, 0);
  if (!direction.isZero(0.0)) out->terms.push_back({direction, std::move(drive)});
}

template <int N>
void read_terms(Context& context, const Place* place, VectorDrive<N>* out) {
  Input& input = context.input;
  input.need("a vector drive: null, [single,] vector and drive, component, array");
  if (input.take("null") || input.take("zero")) return;
  if (input.take("component")) {
    for (int i = 0; i < N; ++i) {
      input.need([&] { return "drive " + std::to_string(i + 1) + " of " + std::to_string(N); });
      if (input.take("inactive")) continue;
      out->terms.push_back({Vector<N>::Unit(i), read_part(context, 0)});
    }
    return;
  }
  if (input.take("array")) {
    const SourcePosition count_where = input.where();
    const std::int64_t count = input.integer("the number of vector drives");
    if (count < 1) input.fail(count_where, "found " + std::to_string(count) + " drives, expected 1 or more");
    for (std::int64_t i = 0; i < count; ++i) {
      input.need([&] { return "vector drive " + std::to_string(i + 1) + " of " + std::to_string(count); });
      for (const char* word : {"single", "component", "array"}) {
        if (const auto words = input.peek_words(); words && words->is(word)) {
          input.fail(words->where, std::string("found `") + word +
                                       "` in an array of vector drives, expected a vector and a drive without keyword");
        }
      }
      read_term(context, place, false, out);
    }
    return;
  }
  read_term(context, place, input.take("single"), out);
}

}  // namespace

DrivePtr read_drive(Context& context) { return read(context, 0); }

void read_drive_caller(Context& context) {
  Input& input = context.input;
  const Label label = input.label("a drive caller label");
  context.drives.announce(input, label);
  skip_name(input);
  const int file_drives = context.file_drives;
  DrivePtr drive = read_drive(context);
  if (context.file_drives > file_drives) context.file_callers.insert(label.value);
  if (input.more()) skip_output(input);
  input.end_card();
  context.drives.define(label, std::move(drive));
}

VectorDrive<3> read_vector_drive(Context& context, const Place* place) {
  VectorDrive<3> out;
  read_terms(context, place, &out);
  return out;
}

VectorDrive<6> read_vector_drive6(Context& context) {
  VectorDrive<6> out;
  read_terms(context, nullptr, &out);
  return out;
}

VectorDrive<1> read_scalar_drive(Context& context) {
  Input& input = context.input;
  VectorDrive<1> out;
  Vector<1> factor = Vector<1>::Ones();
  input.need("a drive");
  if (input.take("single")) factor(0) = input.real("the factor of the drive");
  DrivePtr drive = read_part(context, 0);
  out.terms.push_back({factor, std::move(drive)});
  return out;
}

}  // namespace mbdae::reading
