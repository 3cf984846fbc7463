// The data and initial value blocks.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string_view>
#include <utility>

#include "mbdae/deck/block_reader.h"
#include "mbdae/deck/drive_reader.h"

namespace mbdae::reading {
namespace {

constexpr const char* kCards[] = {
    "initial time", "final time", "time step", "method", "tolerance", "max iterations", "derivatives tolerance",
    "derivatives max iterations", "derivatives coefficient", "eigenanalysis", "dummy steps number",
    // accepted without effect
    "dummy steps ratio", "dummy steps tolerance", "dummy steps max iterations", "dummy steps method", "linear solver",
    "nonlinear solver", "output", "abort after", "threads", "min time step", "max time step", "preconditioner",
    "iterative solver", "strategy", "enforce constraint equations"};

/// Old names of cards, and the present ones.
constexpr std::pair<const char*, const char*> kOldCards[] = {
    {"fictitious steps number", "dummy steps number"},
    {"fictitious steps ratio", "dummy steps ratio"},
    {"fictitious steps tolerance", "dummy steps tolerance"},
    {"fictitious steps max iterations", "dummy steps max iterations"},
    {"fictitious steps method", "dummy steps method"},
    {"solver", "linear solver"},
    {"newton raphson", "nonlinear solver"}};

enum Card {
  kInitialTime,
  kFinalTime,
  kTimeStep,
  kMethod,
  kTolerance,
  kMaxIterations,
  kDerivativesTolerance,
  kDerivativesMaxIterations,
  kDerivativesCoefficient,
  kEigenanalysis,
  kDummySteps,
  kLinearSolver = 15,
  kNonlinearSolver,
  kStrategy = 24,
  kEnforce
};

/// Index into `kCards`, -1 for other cards.
int card_kind(const Words& card) {
  for (std::size_t i = 0; i < std::size(kCards); ++i) {
    if (card.is(kCards[i])) return static_cast<int>(i);
  }
  for (const auto& [old, present] : kOldCards) {
    if (!card.is(old)) continue;
    return static_cast<int>(std::find(std::begin(kCards), std::end(kCards), std::string_view(present)) - kCards);
  }
  return -1;
}

constexpr const char* kLinearSolvers[] = {"aztecoo", "harwell",   "klu",        "lapack", "mumps",   "meschach",
                                          "naive",   "pardiso",   "pardiso 64", "pastix", "qr",      "siconos",
                                          "spqr",    "strumpack", "superlu",    "taucs",  "umfpack", "umfpack3",
                                          "watson",  "wsmp",      "y12"};
constexpr const char* kNonlinearSolvers[] = {"newton raphson",
                                             "line search",
                                             "matrix free",
                                             "bfgs",
                                             "nox",
                                             "default",
                                             "mcp newton min fb",
                                             "siconos mcp newton min fb",
                                             "siconos mcp newton fb"};

constexpr const char* kOtherCards[] = {"real time", "pod", "output modes", "modify residual test"};

int read_iterations(Input& input) {
  const SourcePosition where = input.where();
  const std::int64_t count = input.integer("a number of iterations");
  if (count < 0) input.fail(where, "found " + std::to_string(count) + " iterations, expected 0 or more");
  if (input.more()) input.take("at most");
  return static_cast<int>(count);
}

/// A spectral radius: a number, with or without `const`.
double read_radius(Input& input) {
  input.take("const");
  const SourcePosition where = input.where();
  const double rho = input.real("the spectral radius");
  if (!(rho >= 0.0 && rho <= 1.0))
    input.fail(where, "found " + number_text(rho) + ", expected a spectral radius between 0 and 1");
  return rho;
}

void read_method(Context& context) {
  static constexpr const char* kMethods[] = {"ms",
                                             "implicit euler",
                                             "crank nicolson",
                                             "bdf",
                                             "hope",
                                             "ss2",
                                             "ss3",
                                             "ss4",
                                             "ms2",
                                             "ms3",
                                             "ms4",
                                             "ms5",
                                             "bathe",
                                             "msstc3",
                                             "msstc4",
                                             "msstc5",
                                             "mssth3",
                                             "mssth4",
                                             "mssth5",
                                             "dirk33",
                                             "dirk43",
                                             "dirk54",
                                             "hybrid",
                                             "third order",
                                             "thirdorder",
                                             "nostro"};
  Input& input = context.input;
  InitialValueData& data = context.deck.initial_value;
  input.need([&] { return "a method: " + joined(kMethods); });
  const int method = input.keyword(kMethods, "method");
  data.method_text = kMethods[method];
  switch (method) {
    case 0:
      data.method = MethodKind::ms;
      input.need("the spectral radius");
      data.rho = data.rho_algebraic = read_radius(input);
      if (input.more()) data.rho_algebraic = read_radius(input);
      input.allow_trailing_comma();
      break;
    case 1:
      data.method = MethodKind::implicit_euler;
      break;
    case 2:
      data.method = MethodKind::crank_nicolson;
      break;
    default:
      data.method = MethodKind::other;
      input.ignore_arguments();
  }
}

/// A tolerance of residuals; that of the solution, which may follow, has no effect.
double read_tolerance(Input& input) {
  static constexpr const char* kTests[] = {"none", "norm", "minmax", "relnorm", "sepnorm"};
  double tolerance = 0.0;
  if (!input.take("null")) tolerance = input.positive("a tolerance");
  if (input.more() && input.take("test")) {
    input.keyword(kTests, "residual test");
    if (input.more()) input.take("scale");
  }
  if (input.more()) {
    if (const auto words = input.peek_words()) {
      input.diagnostics().warning(words->where, "the solution tolerance has no effect");
      input.ignore_arguments();
    } else {
      input.positive("a tolerance of the solution");
      input.ignore_arguments();
    }
  }
  return tolerance;
}

void read_derivatives_coefficient(Context& context) {
  Input& input = context.input;
  if (input.take("auto")) {
    // the default stays the first guess
  } else {
    context.deck.initial_value.derivatives_coefficient = input.positive("a coefficient");
    if (!input.more() || !input.take("auto")) return;
  }
  if (input.more() && input.take("max iterations")) input.integer("a number of iterations");
  if (input.more() && input.take("factor")) input.positive("a factor");
}

/// How MBDyn changes the time step on the way. Here it stays what the deck says.
void read_strategy(Context& context, const SourcePosition& where) {
  static constexpr const char* kStrategies[] = {"no change", "factor", "change"};
  Input& input = context.input;
  switch (input.keyword(kStrategies, "strategy")) {
    case 0:
      return;
    case 1:
      input.positive("the factor that reduces the time step");
      input.integer("the number of steps before a reduction");
      input.positive("the factor that raises the time step");
      input.integer("the number of steps before it is raised");
      input.integer("the number of iterations below which it is raised");
      if (input.more()) input.integer("the number of iterations above which it is reduced");
      break;
    default: {
      const std::size_t drives = context.deck.pieced_drives.size();
      read_drive(context);
      context.deck.pieced_drives.resize(drives);
    }
  }
  input.diagnostics().warning(where, "the strategy has no effect: the time step stays what the deck says");
}

/// What of the constraints counts in MBDyn's test of convergence.
void read_enforce(Input& input) {
  static constexpr const char* kKinds[] = {"constraint violations", "constraint violation rates"};
  input.keyword(kKinds, "kind of constraint equations");
  if (input.more()) input.require("scale factor");
  if (input.more()) input.positive("a scale factor");
}

/// One option of the eigenanalysis card; only `parameter` has an effect here.
void read_eigen_option(Input& input, EigenanalysisData* data) {
  static constexpr const char* kOptions[] = {"parameter",
                                             "suffix width",
                                             "suffix format",
                                             "output matrices",
                                             "output full matrices",
                                             "output sparse matrices",
                                             "output eigenvectors",
                                             "output geometry",
                                             "matrix output precision",
                                             "results output precision",
                                             "mode",
                                             "lower frequency limit",
                                             "upper frequency limit",
                                             "use lapack",
                                             "use arpack",
                                             "use jdqz",
                                             "use external",
                                             "balance"};
  static constexpr const char* kEnds[] = {"largest magnitude",  "largest real part",  "largest imaginary part",
                                          "smallest magnitude", "smallest real part", "smallest imaginary part"};
  static constexpr const char* kBalances[] = {"no", "scale", "permute", "all"};
  switch (input.keyword(kOptions, "eigenanalysis option")) {
    case 0:
      data->parameter = input.positive("the parameter");
      data->has_parameter = true;
      break;
    case 1:
      input.need("`compute` or a width");
      if (!input.take("compute")) input.integer("a width");
      break;
    case 2:
      input.string("a format in quotes");
      break;
    case 8:
    case 9:
      input.integer("a number of digits");
      break;
    case 10:
      input.keyword(kEnds, "end of the spectrum");
      break;
    case 11:
      input.real("a frequency");
      break;
    case 12:
      data->upper_frequency = input.positive("the upper frequency limit [Hz]");
      break;
    case 13:
      break;
    case 14:
    case 15:
      input.integer("a number of eigenvalues");
      input.integer("a number of vectors");
      input.real("a tolerance");
      if (input.more() && input.take("max iterations")) input.integer("a number of iterations");
      break;
    case 17:
      input.keyword(kBalances, "balance");
      break;
    default:
      break;
  }
}

void read_eigenanalysis(Context& context) {
  Input& input = context.input;
  EigenanalysisData data;
  data.where = input.card_position();
  input.need("a time or a list of times");
  std::int64_t count = 1;
  if (input.take("list")) {
    const SourcePosition where = input.where();
    count = input.integer("the number of times");
    if (count < 1) input.fail(where, "found " + std::to_string(count) + " times, expected 1 or more");
  }
  for (std::int64_t i = 0; i < count; ++i) {
    input.need([&] { return "time " + std::to_string(i + 1) + " of " + std::to_string(count); });
    const SourcePosition where = input.where();
    const double time = input.real("a time [s]");
    if (!data.times.empty() && !(time > data.times.back())) {
      input.fail(where, "found time " + number_text(time) + " after " + number_text(data.times.back()) +
                            ", expected increasing times");
    }
    data.times.push_back(time);
  }
  while (input.more()) read_eigen_option(input, &data);
  if (data.upper_frequency > 0.0 && !data.has_parameter) {
    // A fifth of the highest frequency's radian, within bounds, as MBDyn chooses it [s].
    constexpr double kSmallest = 1e-6, kLargest = 1e6;
    data.parameter = std::clamp(1.0 / (10.0 * std::numbers::pi * data.upper_frequency), kSmallest, kLargest);
  }
  context.deck.initial_value.eigenanalysis = std::move(data);
}

}  // namespace

void read_data_card(Context& context, const Words& card) {
  static constexpr const char* kProblems[] = {"initial value", "multistep", "inverse dynamics"};
  static constexpr const char* kDataCards[] = {"problem"};
  Input& input = context.input;
  if (!card.is("problem") && !card.is("integrator")) {
    input.fail(card.where, "unknown card " + quoted(card.written) + " in the data block, expected: problem, end: data" +
                               suggestion(card.text, kDataCards));
  }
  const SourcePosition where = input.where();
  if (input.keyword(kProblems, "problem") == 2) {
    input.fail(where, "not supported: the problem `inverse dynamics` (expected `initial value`)");
  }
  input.end_card();
}

void read_initial_value_card(Context& context, const Words& card) {
  Input& input = context.input;
  InitialValueData& data = context.deck.initial_value;
  const int kind = card_kind(card);
  if (kind < 0) {
    for (const char* other : kOtherCards) {
      if (card.is(other)) input.fail(card.where, std::string("not supported: the card `") + other + "`");
    }
    const std::string hint = suggestion(card.text, kCards);
    input.fail(card.where, (hint.empty() ? "not supported: the card " : "unknown card ") + quoted(card.written) +
                               " in the initial value block, expected: " + joined(kCards) + hint);
  }
  if (kind == kMethod && (context.initial_value_cards >> kMethod & 1U) != 0) {
    input.fail(card.where, "the method is given already (`" + data.method_text + "`), expected one card `method`");
  }
  context.initial_value_cards |= std::uint64_t{1} << kind;
  switch (kind) {
    case kInitialTime:
      data.initial_time = input.real("the initial time [s]");
      break;
    case kFinalTime:
      input.need("the final time [s] or `forever`");
      data.final_time =
          input.take("forever") ? std::numeric_limits<double>::infinity() : input.real("the final time [s]");
      break;
    case kTimeStep:
      data.time_step = input.positive("the time step [s]");
      break;
    case kMethod:
      read_method(context);
      break;
    case kTolerance:
      data.tolerance = read_tolerance(input);
      break;
    case kMaxIterations:
      data.max_iterations = read_iterations(input);
      break;
    case kDerivativesTolerance:
      data.derivatives_tolerance = read_tolerance(input);
      break;
    case kDerivativesMaxIterations:
      data.derivatives_max_iterations = read_iterations(input);
      break;
    case kDerivativesCoefficient:
      read_derivatives_coefficient(context);
      break;
    case kEigenanalysis:
      read_eigenanalysis(context);
      break;
    case kDummySteps:
      if (input.integer("a number of steps") != 0) {
        input.diagnostics().warning(
            card.where, "dummy steps have no effect: accelerations and reactions at the start are solved for");
      }
      break;
    case kLinearSolver:
      input.keyword(kLinearSolvers, "linear solver");
      input.ignore_arguments();
      break;
    case kNonlinearSolver:
      if (!card.is("newton raphson")) input.keyword(kNonlinearSolvers, "nonlinear solver");
      input.ignore_arguments();
      break;
    case kStrategy:
      read_strategy(context, card.where);
      break;
    case kEnforce:
      read_enforce(input);
      break;
    default:
      input.ignore_arguments();
  }
  input.end_card();
}

void check_initial_value(Context& context, const SourcePosition& where) {
  for (const int card : {kInitialTime, kFinalTime}) {
    if ((context.initial_value_cards >> card & 1U) == 0) {
      context.input.diagnostics().error(
          where, std::string("the initial value block lacks the card `") + kCards[card] + ": ...;`");
    }
  }
  const InitialValueData& data = context.deck.initial_value;
  if ((context.initial_value_cards >> kMethod & 1U) == 0) {
    context.input.diagnostics().warning(where, "the initial value block has no `method` card: `ms, 0.` is used");
  }
  if (data.final_time < data.initial_time) {
    context.input.diagnostics().error(where, "the final time " + number_text(data.final_time) +
                                                 " s is before the initial time " + number_text(data.initial_time) +
                                                 " s");
  }
}

}  // namespace mbdae::reading
