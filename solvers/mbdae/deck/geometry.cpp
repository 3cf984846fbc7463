// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/geometry.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

namespace mbdae::reading {
namespace {

constexpr const char* kDescriptions[] = {"euler123", "euler313", "euler321", "orientation vector",
                                         "orientation matrix"};

/// Below this, R^T R - I is the last digit of numbers copied by hand; above kNoRotation it is a mistake.
constexpr double kRoundedRotation = 1e-9;
constexpr double kNoRotation = 1e-3;
/// Sine of the angle between two vectors below which they define no plane.
constexpr double kParallel = 1e-10;

double read_scale(Input& input) { return input.more() && input.take("scale") ? input.real("a scale factor") : 1.0; }

Mat3 axis_rotation(int axis, double angle) { return Eigen::AngleAxisd(angle, Vec3::Unit(axis)).toRotationMatrix(); }

/// Three Euler angles about the given axes (0, 1, 2), the first outermost.
Mat3 euler(Input& input, int first, int second, int third) {
  const double unit = input.more() && input.take("degrees") ? std::numbers::pi / 180.0 : 1.0;
  const double a = unit * input.real("the first angle");
  const double b = unit * input.real("the second angle");
  const double c = unit * input.real("the third angle");
  return axis_rotation(first, a) * axis_rotation(second, b) * axis_rotation(third, c);
}

Mat3 explicit_rotation(Input& input, const SourcePosition& where) {
  Mat3 R;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) R(row, column) = input.real("an element of the orientation matrix");
  }
  const double error = (R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff();
  if (!(error < kNoRotation)) {
    const std::string size = std::isfinite(error) ? "|R^T R - I| = " + number_text(error) : "its entries are too large";
    input.fail(where, "the matrix is not a rotation: " + size);
  }
  if (R.determinant() < 0.0) input.fail(where, "the matrix is a reflection (determinant -1), expected a rotation");
  if (error > kRoundedRotation) {
    input.diagnostics().warning(where, "the matrix is a rotation to " + number_text(error) + " only: give more digits");
  }
  return R;
}

int read_axis(Input& input) {
  const SourcePosition where = input.where();
  const std::int64_t axis = input.integer("the number of an axis");
  if (axis < 1 || axis > 3) input.fail(where, "found axis " + std::to_string(axis) + ", expected 1, 2 or 3");
  return static_cast<int>(axis) - 1;
}

Vec3 three_numbers(Input& input, const char* what) {
  Vec3 v;
  for (int i = 0; i < 3; ++i) v(i) = input.real(what);
  return v;
}

/// A square matrix in any of its forms; "skew" exists for three rows only.
template <int N>
Eigen::Matrix<double, N, N> read_square(Input& input, const char* what) {
  input.need(what);
  Eigen::Matrix<double, N, N> m = Eigen::Matrix<double, N, N>::Zero();
  if (input.take("null")) {
  } else if (input.take("eye")) {
    m.setIdentity();
  } else if (input.take("diag")) {
    for (int i = 0; i < N; ++i) m(i, i) = input.real(what);
  } else if (N == 3 && input.take("skew")) {
    m.template topLeftCorner<3, 3>() = skew(three_numbers(input, what));
  } else if (input.take("sym")) {
    for (int row = 0; row < N; ++row) {
      for (int column = row; column < N; ++column) m(row, column) = m(column, row) = input.real(what);
    }
  } else {
    input.take("matr");
    for (int row = 0; row < N; ++row) {
      for (int column = 0; column < N; ++column) m(row, column) = input.real(what);
    }
  }
  return m * read_scale(input);
}

Vec3 unit_vector(Input& input, const char* what) {
  const SourcePosition where = input.where();
  const Vec3 v = three_numbers(input, what);
  const double length = v.stableNorm();
  if (!(length > 0.0)) input.fail(where, "a vector of zero length gives no direction");
  return v / length;
}

/// The axis that `guess` stands for, perpendicular to v: 1 where v is smallest, -v_smallest/v_largest where it is
/// largest.
Vec3 guessed_axis(const Vec3& v) {
  int smallest = 0, largest = 0;
  for (int i = 1; i < 3; ++i) {
    if (std::abs(v(i)) < std::abs(v(smallest))) smallest = i;
    if (std::abs(v(i)) > std::abs(v(largest))) largest = i;
  }
  if (smallest == largest) largest = 2;  // three equal components
  Vec3 w = Vec3::Zero();
  w(smallest) = 1.0;
  w(largest) = -v(smallest) / v(largest);
  return w.normalized();
}

/// i, v, j, { w | guess }: axis i along v, axis j in the half plane of w.
Mat3 two_vectors(Input& input) {
  const int i = read_axis(input);
  const Vec3 v = unit_vector(input, "a component of the first vector");
  const SourcePosition where = input.where();
  const int j = read_axis(input);
  if (i == j) input.fail(where, "both vectors are given for axis " + std::to_string(i + 1));
  const SourcePosition second = input.where();
  Vec3 w;
  if (input.more() && input.take("guess")) {
    w = guessed_axis(v);
  } else {
    w = unit_vector(input, "a component of the second vector");
  }
  const double sign = j == (i + 1) % 3 ? 1.0 : -1.0;
  Vec3 normal = sign * v.cross(w);
  if (!(normal.norm() > kParallel)) input.fail(second, "the two vectors are parallel, they define no orientation");
  normal.normalize();
  const int k = 3 - i - j;
  Mat3 R;
  R.col(i) = v;
  R.col(k) = normal;
  R.col(j) = sign * normal.cross(v);
  return R;
}

enum class FrameKind { standard, global, node, label, other_position, other_orientation, other_node };

struct FrameChoice {
  FrameKind kind = FrameKind::standard;
  Frame frame;  ///< of the label, or of the other node
  SourcePosition where;
};

/// `reference, <frame>,` if it is there.
FrameChoice read_frame_choice(Context& context, const Place& place) {
  static constexpr const char* kFrames[] = {"global",    "node", "local", "other position", "other orientation",
                                            "other node"};
  Input& input = context.input;
  FrameChoice choice;
  choice.where = input.where();
  if (!input.more() || !input.take("reference")) return choice;
  choice.where = input.where();
  input.need("a frame: global, node, local, a reference label, other position, other orientation, other node");
  switch (input.take_any(kFrames)) {
    case 0:
      choice.kind = FrameKind::global;
      return choice;
    case 1:
    case 2:
      if (place.node == nullptr && place.beside != nullptr) {
        choice.kind = FrameKind::label;
        choice.frame = *place.beside;
        return choice;
      }
      if (place.node == nullptr) {
        input.fail(choice.where,
                   "not supported: the frame `node` for something given in the global frame "
                   "(write `reference, global` or a reference label)");
      }
      choice.kind = FrameKind::node;
      return choice;
    case 3:
      choice.kind = FrameKind::other_position;
      break;
    case 4:
      choice.kind = FrameKind::other_orientation;
      break;
    case 5:
      choice.kind = FrameKind::other_node;
      break;
    default: {
      choice.kind = FrameKind::label;
      const auto words = input.peek_words();
      if (words && !input.symbols().find(input.peek_text())) {
        input.fail(choice.where, "unknown frame " + quoted(words->written) + ", expected: " + joined(kFrames) +
                                     " or the label of a reference" + suggestion(words->text, kFrames));
      }
      choice.frame = context.references.get(input, input.label("the label of a reference"));
      return choice;
    }
  }
  if (place.other == nullptr) {
    input.fail(choice.where, "there is no other node here: the frames `other ...` are for the second node of a joint");
  }
  choice.frame = *place.other;
  return choice;
}

[[noreturn]] void wrong_frame(Context& context, const FrameChoice& choice, const char* right) {
  context.input.fail(choice.where, std::string("this frame does not fit here, expected ") + right);
}

/// Axes of the chosen frame in global components, for directions and matrices.
Mat3 axes_of(Context& context, const FrameChoice& choice, const Place& place) {
  switch (choice.kind) {
    case FrameKind::standard:
    case FrameKind::node:
      return place.node != nullptr ? place.node->R : Mat3::Identity();
    case FrameKind::global:
      return Mat3::Identity();
    case FrameKind::label:
    case FrameKind::other_node:
      return choice.frame.R;
    case FrameKind::other_orientation:
      if (place.other_orientation != nullptr) return choice.frame.R * *place.other_orientation;
      [[fallthrough]];
    default:
      wrong_frame(context, choice, "`other orientation` or `other node`");
  }
}

bool stays_local(const FrameChoice& choice, const Place& place) {
  if (place.node == nullptr) return choice.kind == FrameKind::standard || choice.kind == FrameKind::global;
  return choice.kind == FrameKind::standard || choice.kind == FrameKind::node;
}

}  // namespace

Mat3 skew(const Vec3& v) {
  Mat3 S;
  S << 0.0, -v(2), v(1), v(2), 0.0, -v(0), -v(1), v(0), 0.0;
  return S;
}

Mat3 rotation_of(const Vec3& v) {
  const double angle = v.stableNorm();
  if (!(angle > 0.0)) return Mat3::Identity();
  return Eigen::AngleAxisd(angle, v / angle).toRotationMatrix();
}

Vec3 read_vec3(Input& input, const char* what) {
  input.need(what);
  const Vec3 v = input.take("null") ? Vec3::Zero() : three_numbers(input, what);
  return v * read_scale(input);
}

Vec6 read_vec6(Input& input, const char* what) {
  input.need(what);
  Vec6 v = Vec6::Zero();
  if (!input.take("null")) {
    for (int i = 0; i < 6; ++i) v(i) = input.real(what);
  }
  return v * read_scale(input);
}

Mat3 read_mat3(Input& input, const char* what) { return read_square<3>(input, what); }

Mat6 read_mat6(Input& input, const char* what) { return read_square<6>(input, what); }

Mat3 read_orientation(Input& input) {
  static constexpr const char* kForms[] = {"eye",      "matr",     "euler",  "euler123",
                                           "euler313", "euler321", "vector", "null"};
  input.need("an orientation: eye, matr, euler123, euler313, euler321, vector, or two vectors");
  const SourcePosition where = input.where();
  switch (input.take_any(kForms)) {
    case 0:
      return Mat3::Identity();
    case 1:
      return explicit_rotation(input, where);
    case 2:
    case 3:
      return euler(input, 0, 1, 2);
    case 4:
      return euler(input, 2, 0, 2);
    case 5:
      return euler(input, 2, 1, 0);
    case 6:
      return rotation_of(three_numbers(input, "a component of the rotation vector"));
    case 7:
      input.fail(where, "`null` is not an orientation, expected `eye`");
    default:
      break;
  }
  if (const auto words = input.peek_words(); words && !input.symbols().find(input.peek_text())) {
    const std::string hint = suggestion(words->text, kForms);
    input.fail(where, (hint.empty() ? "not supported: the orientation " : "unknown orientation ") +
                          quoted(words->written) +
                          ", expected: eye, matr, euler123, euler313, euler321, vector, or two vectors" + hint);
  }
  return two_vectors(input);
}

Vec3 read_position(Context& context, const Place& place) {
  const FrameChoice choice = read_frame_choice(context, place);
  const Vec3 p = read_vec3(context.input, "a component of the position");
  if (stays_local(choice, place)) return p;
  Vec3 x = p;  // global
  switch (choice.kind) {
    case FrameKind::label:
    case FrameKind::other_node:
      x = choice.frame.x + choice.frame.R * p;
      break;
    case FrameKind::other_position:
      if (place.other_position == nullptr) wrong_frame(context, choice, "`other node`");
      x = choice.frame.x + choice.frame.R * (*place.other_position + p);
      break;
    case FrameKind::other_orientation:
      wrong_frame(context, choice, "`other position` or `other node`");
    default:
      break;
  }
  return place.node != nullptr ? Vec3(place.node->R.transpose() * (x - place.node->x)) : x;
}

Mat3 read_orientation(Context& context, const Place& place) {
  const FrameChoice choice = read_frame_choice(context, place);
  const Mat3 given = read_orientation(context.input);
  if (stays_local(choice, place)) return given;
  if (choice.kind == FrameKind::global) return place.node->R.transpose() * given;
  const Mat3 R = axes_of(context, choice, place) * given;
  return place.node != nullptr ? Mat3(place.node->R.transpose() * R) : R;
}

Vec3 read_direction(Context& context, const Place& place) {
  const FrameChoice choice = read_frame_choice(context, place);
  const Vec3 given = read_vec3(context.input, "a component of the vector");
  if (stays_local(choice, place)) return given;
  const Vec3 v = axes_of(context, choice, place) * given;
  return place.node != nullptr ? Vec3(place.node->R.transpose() * v) : v;
}

Mat3 read_matrix(Context& context, const Place& place, const char* what) {
  const FrameChoice choice = read_frame_choice(context, place);
  const Mat3 given = read_mat3(context.input, what);
  if (stays_local(choice, place)) return given;
  Mat3 R = axes_of(context, choice, place);
  if (place.node != nullptr) R = place.node->R.transpose() * R;
  return R * given * R.transpose();
}

Vec3 read_velocity(Context& context, const Vec3& x) {
  const FrameChoice choice = read_frame_choice(context, {});
  const Vec3 given = read_vec3(context.input, "a component of the velocity");
  if (choice.kind != FrameKind::label) return given;
  return choice.frame.v + choice.frame.w.cross(x - choice.frame.x) + choice.frame.R * given;
}

Vec3 read_angular_velocity(Context& context) {
  const FrameChoice choice = read_frame_choice(context, {});
  const Vec3 given = read_vec3(context.input, "a component of the angular velocity");
  if (choice.kind != FrameKind::label) return given;
  return choice.frame.w + choice.frame.R * given;
}

Frame read_frame(Context& context, bool description) {
  Input& input = context.input;
  Frame frame;
  input.need("a position");
  input.take("position");
  frame.x = read_position(context, {});
  input.need("an orientation");
  if (!input.take("orientation")) input.take("hinge");
  frame.R = read_orientation(context, {});
  if (description && input.more()) skip_orientation_description(input);
  input.need("a velocity");
  input.take("velocity");
  frame.v = read_velocity(context, frame.x);
  input.need("an angular velocity");
  input.take("angular velocity");
  frame.w = read_angular_velocity(context);
  return frame;
}

bool skip_orientation_description(Input& input) {
  if (!input.take("orientation description")) return false;
  input.keyword(kDescriptions, "orientation description");
  return true;
}

}  // namespace mbdae::reading
