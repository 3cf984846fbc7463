// Orientations against closed forms, composition of frames against the kinematics of rigid bodies.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <cmath>
#include <numbers>

#include "test_deck_support.h"

using deck_test::only_joint;
using deck_test::read_good;
using deck_test::with_elements;
using deck_test::with_nodes;
using mbdae::Mat3;
using mbdae::Vec3;

namespace {

Mat3 Rx(double a) {
  Mat3 R;
  R << 1, 0, 0, 0, std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a);
  return R;
}
Mat3 Ry(double a) {
  Mat3 R;
  R << std::cos(a), 0, std::sin(a), 0, 1, 0, -std::sin(a), 0, std::cos(a);
  return R;
}
Mat3 Rz(double a) {
  Mat3 R;
  R << std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a), 0, 0, 0, 1;
  return R;
}

Mat3 orientation(const std::string& text) {
  return with_nodes("structural: 1, dynamic, null, " + text + ", null, null;\n").nodes[0].R;
}

void check_close(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double tolerance = 1e-15) {
  INFO("found\n" << a << "\nexpected\n" << b);
  CHECK((a - b).cwiseAbs().maxCoeff() <= tolerance);
}

}  // namespace

TEST_CASE("orientation by angles") {
  check_close(orientation("eye"), Mat3::Identity());
  check_close(orientation("euler, 0.1, 0.2, 0.3"), Rx(0.1) * Ry(0.2) * Rz(0.3));
  check_close(orientation("euler123, 0.1, 0.2, 0.3"), Rx(0.1) * Ry(0.2) * Rz(0.3));
  check_close(orientation("euler313, 0.1, 0.2, 0.3"), Rz(0.1) * Rx(0.2) * Rz(0.3));
  check_close(orientation("euler321, 0.1, 0.2, 0.3"), Rz(0.1) * Ry(0.2) * Rx(0.3));
  check_close(orientation("euler, degrees, 90., 0., 0."), Rx(std::numbers::pi / 2.0));
}

TEST_CASE("orientation by a rotation vector") {
  check_close(orientation("vector, 0., 0.7, 0."), Ry(0.7));
  check_close(orientation("vector, 0., 0., 0."), Mat3::Identity());
  // A third of a turn about the diagonal swaps the axes round.
  Mat3 cyclic;
  cyclic << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  check_close(orientation("vector, 2.*pi/3./sqrt(3.), 2.*pi/3./sqrt(3.), 2.*pi/3./sqrt(3.)"), cyclic);
}

TEST_CASE("orientation by two vectors") {
  // Axis 3 along y, axis 1 along x: axis 2 is 3 x 1 = y x x = -z.
  Mat3 expected;
  expected.col(0) = Vec3::UnitX();
  expected.col(1) = -Vec3::UnitZ();
  expected.col(2) = Vec3::UnitY();
  check_close(orientation("3, 0., 5., 0., 1, 2., 0., 0."), expected);
  // For every pair: a rotation, axis i along v, axis j in the half plane of w.
  const Vec3 v(1.0, 2.0, -0.5), w(0.3, -1.0, 2.0);
  for (int i = 1; i <= 3; ++i) {
    for (int j = 1; j <= 3; ++j) {
      if (i == j) continue;
      const Mat3 R = orientation(std::to_string(i) + ", 1., 2., -0.5, " + std::to_string(j) + ", 0.3, -1., 2.");
      check_close(R.transpose() * R, Mat3::Identity());
      CHECK(std::abs(R.determinant() - 1.0) < 1e-14);
      check_close(R.col(i - 1), v.normalized());
      CHECK(R.col(j - 1).dot(w) > 0.0);
      CHECK(std::abs(R.col(5 - i - j).dot(w)) < 1e-15);  // axes count from 1, columns from 0
    }
    const Mat3 guessed = orientation(std::to_string(i) + ", 1., 2., -0.5, " + std::to_string(i % 3 + 1) + ", guess");
    check_close(guessed.transpose() * guessed, Mat3::Identity());
    CHECK(std::abs(guessed.determinant() - 1.0) < 1e-14);
    check_close(guessed.col(i - 1), v.normalized());
  }
}

TEST_CASE("orientation written out, vectors and scales") {
  check_close(orientation("matr, 0., -1., 0., 1., 0., 0., 0., 0., 1."), Rz(std::numbers::pi / 2.0));
  const mbdae::Deck deck =
      with_nodes("structural: 1, static, 1., 2., 3., scale, 0.5, eye, null, 1., 0., 0., scale, -2.;\n");
  check_close(deck.nodes[0].x, Vec3(0.5, 1.0, 1.5));
  check_close(deck.nodes[0].w, Vec3(-2.0, 0.0, 0.0));
  CHECK(deck.nodes[0].kind == mbdae::NodeKind::static_node);
}

TEST_CASE("reference frames compose as rigid bodies that move") {
  const std::string globals =
      "reference: 1, 1., 2., 3., euler, 0.1, 0.2, 0.3, 0.5, -0.4, 0.3, 0.2, 0.7, -1.1;\n"
      "reference: 2, position, reference, 1, 0.3, 0.2, 0.1, orientation, reference, 1, euler321, 0.4, 0.5, 0.6,\n"
      "  velocity, reference, 1, 0.1, 0.2, 0.3, angular velocity, reference, 1, 0.6, 0.5, 0.4;\n";
  const mbdae::Deck deck = with_nodes(
      "structural: 1, dynamic, reference, 2, 0.7, -0.2, 0.4, reference, 2, vector, 0.1, 0.2, 0.3, reference, 2, null, "
      "reference, 2, null;\n"
      "structural: 2, dynamic, reference, 1, 0.1, 0., 0., eye, reference, 2, null, reference, global, 1., 0., 0.;\n"
      "structural: 3, dynamic, at reference, 2;\n",
      globals);
  const Vec3 x1(1, 2, 3), v1(0.5, -0.4, 0.3), w1(0.2, 0.7, -1.1);
  const Mat3 R1 = Rx(0.1) * Ry(0.2) * Rz(0.3);
  const Vec3 x2 = x1 + R1 * Vec3(0.3, 0.2, 0.1);
  const Mat3 R2 = R1 * Rz(0.4) * Ry(0.5) * Rx(0.6);
  const Vec3 v2 = v1 + w1.cross(R1 * Vec3(0.3, 0.2, 0.1)) + R1 * Vec3(0.1, 0.2, 0.3);
  const Vec3 w2 = w1 + R1 * Vec3(0.6, 0.5, 0.4);
  check_close(deck.nodes[2].x, x2, 2e-15);
  check_close(deck.nodes[2].R, R2, 2e-15);
  check_close(deck.nodes[2].v, v2, 2e-15);
  check_close(deck.nodes[2].w, w2, 2e-15);
  check_close(deck.nodes[0].x, x2 + R2 * Vec3(0.7, -0.2, 0.4), 2e-15);
  check_close(deck.nodes[0].R, R2 * orientation("vector, 0.1, 0.2, 0.3"), 2e-15);
  check_close(deck.nodes[0].v, v2 + w2.cross(R2 * Vec3(0.7, -0.2, 0.4)), 2e-15);
  check_close(deck.nodes[0].w, w2, 2e-15);
  // Position and velocity may be given in different frames: the arm runs from the velocity's.
  check_close(deck.nodes[1].v, v2 + w2.cross(deck.nodes[1].x - x2), 2e-15);
  check_close(deck.nodes[1].w, Vec3(1, 0, 0));
}

TEST_CASE("global and referenced data are pulled back into the node") {
  deck_test::DeckText text;
  text.globals = "reference: 7, 0.5, 0.6, 0.7, euler, 0.3, 0.2, 0.1, null, null;\n";
  text.nodes =
      "structural: 1, dynamic, 1., 2., 3., euler, 0.1, 0.2, 0.3, null, null;\n"
      "structural: 2, dynamic, -1., 0., 1., euler321, 0.4, 0.5, 0.6, null, null;\n";
  text.elements =
      "joint: 1, total joint,\n"
      "  1, position, reference, global, 0.1, 0.2, 0.3, position orientation, reference, 7, euler, 0., 0.1, 0.,\n"
      "     rotation orientation, euler, 0.7, 0., 0.,\n"
      "  2, position, reference, other position, 0.4, 0.5, 0.6, position orientation, reference, other orientation, "
      "euler, 0., 0., 0.2,\n"
      "     rotation orientation, reference, other orientation, euler, 0.3, 0., 0.,\n"
      "  position constraint, 1, 0, position, null, orientation constraint, inactive, rotation, angular velocity, "
      "null;\n";
  const mbdae::Deck deck = read_good(text);
  const auto joint = only_joint<mbdae::TotalJointData>(deck);
  const Vec3 x1(1, 2, 3), x2(-1, 0, 1);
  const Mat3 R1 = Rx(0.1) * Ry(0.2) * Rz(0.3), R2 = Rz(0.4) * Ry(0.5) * Rx(0.6), R7 = Rx(0.3) * Ry(0.2) * Rz(0.1);
  const Vec3 f1 = R1.transpose() * (Vec3(0.1, 0.2, 0.3) - x1);
  const Mat3 R1h = R1.transpose() * R7 * Ry(0.1);
  check_close(joint.f1, f1, 2e-15);
  check_close(joint.R1h, R1h, 2e-15);
  check_close(joint.R1hr, Rx(0.7));
  check_close(joint.f2, R2.transpose() * (x1 + R1 * (f1 + Vec3(0.4, 0.5, 0.6)) - x2), 3e-15);
  check_close(joint.R2h, R2.transpose() * R1 * R1h * Rz(0.2), 2e-15);
  check_close(joint.R2hr, R2.transpose() * R1 * Rx(0.7) * Rx(0.3), 2e-15);
  using C = mbdae::TotalComponent;
  CHECK(joint.position == std::array<C, 3>{C::position, C::inactive, C::position});
  CHECK(joint.rotation == std::array<C, 3>{C::inactive, C::position, C::velocity});
  CHECK(joint.position_drive.terms.empty());
}

TEST_CASE("the frame of the other node knows no hinge") {
  deck_test::DeckText text;
  text.nodes =
      "structural: 1, dynamic, 1., 2., 3., euler, 0.1, 0.2, 0.3, null, null;\n"
      "structural: 2, dynamic, -1., 0., 1., euler321, 0.4, 0.5, 0.6, null, null;\n";
  text.elements =
      "joint: 1, revolute hinge, 1, position, 0.1, 0.2, 0.3, orientation, euler, 0.3, 0., 0.,\n"
      "  2, position, reference, other node, 0.4, 0.5, 0.6, orientation, reference, other node, euler, 0., 0., 0.2;\n";
  const auto joint = only_joint<mbdae::RevoluteHingeData>(read_good(text));
  const Mat3 R1 = Rx(0.1) * Ry(0.2) * Rz(0.3), R2 = Rz(0.4) * Ry(0.5) * Rx(0.6);
  check_close(joint.d2, R2.transpose() * (Vec3(1, 2, 3) + R1 * Vec3(0.4, 0.5, 0.6) - Vec3(-1, 0, 1)), 2e-15);
  check_close(joint.R2h, R2.transpose() * R1 * Rz(0.2), 2e-15);
}

TEST_CASE("inertia turns with its frame") {
  deck_test::DeckText text;
  text.nodes = "structural: 1, dynamic, 1., 2., 3., euler, 0.1, 0.2, 0.3, null, null;\n";
  text.elements =
      "body: 1, 1, 2., reference, global, 1., 2., 4., reference, global, diag, 1., 2., 2.5;\n"
      "body: 2, 1, 2., null, diag, 1., 2., 2.5, orientation, euler, 0., 0.3, 0.;\n"
      "body: 3, 1, 2., null, sym, 1., 0.1, 0.2, 2., 0.3, 2.5, inertial, node;\n";
  const mbdae::Deck deck = read_good(text);
  const Mat3 R = Rx(0.1) * Ry(0.2) * Rz(0.3), J = Vec3(1.0, 2.0, 2.5).asDiagonal();
  check_close(deck.bodies[0].d, R.transpose() * Vec3(0, 0, 1));
  check_close(deck.bodies[0].J_cm, R.transpose() * J * R, 2e-15);
  check_close(deck.bodies[1].J_cm, Ry(0.3) * J * Ry(0.3).transpose(), 2e-15);
  Mat3 sym;
  sym << 1, 0.1, 0.2, 0.1, 2, 0.3, 0.2, 0.3, 2.5;
  check_close(deck.bodies[2].J_cm, sym);
}

TEST_CASE("condensed masses add up as rigid bodies") {
  // Two point masses of 1 and 3 kg, 2 m apart on x: centre at 1.5 m from the first, J = 1*3/4*4 = 3 about y and z.
  const mbdae::Deck deck = with_elements("body: 1, 1, condense, 2, 1., null, null, 3., 2., 0., 0., null;\n");
  CHECK(deck.bodies[0].m == 4.0);
  check_close(deck.bodies[0].d, Vec3(1.5, 0, 0));
  check_close(deck.bodies[0].J_cm, Vec3(0, 3, 3).asDiagonal().toDenseMatrix());
}
