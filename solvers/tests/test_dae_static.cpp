// Static equilibria against closed forms and from bad starts, and what failures say.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include "deck_builder.h"
#include "mbdae/dae/analyses.h"
#include "mbdae/dae/linear_algebra.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

constexpr double kGravity = 9.81;  // m/s^2

TotalPinData pin_of(NodeIndex node, const Vec3& x) {
  TotalPinData pin;
  pin.node = node;
  pin.fn = Vec3::Zero();
  pin.Xc = x;
  pin.Rnh = pin.Rnhr = pin.Rch = pin.Rchr = Mat3::Identity();
  pin.position.fill(TotalComponent::position);
  pin.rotation.fill(TotalComponent::position);
  return pin;
}

LinearLaw<3> spring3(double k) {
  LinearLaw<3> law;
  law.K = k * Mat3::Identity();
  return law;
}

// Pendulum m [kg], L [m] about z at the origin against a torsion spring k [N m/rad] that is relaxed at angle rest
// [rad]; zero angle hangs along -y. The node starts at angle start.
Deck sprung_pendulum(double m, double L, double k, double rest, double start) {
  Deck deck;
  deck.control.static_model = true;
  const NodeIndex ground = add_node(deck, NodeKind::static_node, Vec3::Zero());
  const Mat3 R = rotation_exp(Vec3(0, 0, start));
  const NodeIndex bob = add_node(deck, NodeKind::dynamic_node, R * Vec3(0, -L, 0), R);
  add_body(deck, bob, m, Vec3::Zero(), Mat3::Identity() * 0.01);
  add_joint(deck, clamp(deck, ground));
  add_joint(deck,
            RevoluteHingeData{ground, bob, Vec3::Zero(), Vec3(0, L, 0), Mat3::Identity(), Mat3::Identity(), {}, {}});
  LinearLaw<3> law = spring3(k);
  law.prestrain = vector_drive<3>(Vec3(0, 0, rest));
  add_joint(deck, DeformableHingeData{ground, bob, Mat3::Identity(), Mat3::Identity(), law});
  add_gravity(deck, Vec3(0, -kGravity, 0));
  return deck;
}

double angle_of(const LinearisedModel& model, std::size_t node) { return rotation_log(model.nodes[node].R).z(); }

// k (theta - rest) + m g L sin(theta) = 0 by bisection.
double pendulum_angle(double m, double L, double k, double rest) {
  double low = -3.0, high = 3.0;
  for (int i = 0; i < 200; ++i) {
    const double mid = 0.5 * (low + high);
    (k * (mid - rest) + m * kGravity * L * std::sin(mid) < 0.0 ? low : high) = mid;
  }
  return 0.5 * (low + high);
}

}  // namespace

TEST_CASE("pendulum against a torsion spring, from far away") {
  for (const double start : {0.0, 0.9, -1.5, 2.5}) {
    const LinearisedModel model = solve_static(sprung_pendulum(2.0, 0.5, 14.0, 1.1, start), {});
    INFO("start " << start);
    CHECK(std::abs(angle_of(model, 1) - pendulum_angle(2.0, 0.5, 14.0, 1.1)) < 1e-12);
    CHECK(model.residual_norm < 1e-10);
    CHECK(model.analysis == "static");
    // the clamp carries the weight
    CHECK(std::abs(model.y(12 + 1) + 2.0 * kGravity) < 1e-12);
  }
}

TEST_CASE("constraints violated at the start are closed") {
  // Two links of length 1 between the ground and a pinned point: elbow position by the cosine law.
  Deck deck;
  deck.control.static_model = true;
  const double distance = 1.5;
  const NodeIndex a = add_node(deck, NodeKind::static_node, Vec3(0.03, 0.02, -0.05), rotation_exp(Vec3(0.1, 0.2, 0.9)));
  const NodeIndex b = add_node(deck, NodeKind::static_node, Vec3(0.8, 0.5, 0.06), rotation_exp(Vec3(-0.1, 0.1, -0.5)));
  add_joint(deck, RevolutePinData{a, Vec3::Zero(), Mat3::Identity(), Vec3::Zero(), Mat3::Identity(), {}});
  add_joint(deck, RevoluteHingeData{a, b, Vec3(1, 0, 0), Vec3::Zero(), Mat3::Identity(), Mat3::Identity(), {}, {}});
  TotalPinData end = pin_of(b, Vec3(distance, 0, 0));
  end.fn = Vec3(1, 0, 0);
  end.position = {TotalComponent::position, TotalComponent::position, TotalComponent::inactive};
  end.rotation.fill(TotalComponent::inactive);
  add_joint(deck, end);
  const LinearisedModel model = solve_static(deck, {});
  const Vec3 elbow(0.5 * distance, std::sqrt(1.0 - 0.25 * distance * distance), 0.0);
  CHECK((model.nodes[1].x - elbow).norm() < 1e-11);
}

TEST_CASE("large rotation of a clamped node follows a ramp in time") {
  // A total pin turned to 2.5 rad about an oblique axis and moved, ramping from 0 to 1 s: time is the load parameter.
  class Ramp final : public Drive {
   public:
    Jet at(double t) const override { return {t < 1.0 ? t : 1.0, t < 1.0 ? 1.0 : 0.0, 0.0}; }
  };
  Deck deck;
  deck.control.static_model = true;
  deck.initial_value.final_time = 1.0;
  deck.initial_value.time_step = 0.05;
  const NodeIndex node = add_node(deck, NodeKind::static_node, Vec3::Zero());
  TotalPinData pin = pin_of(node, Vec3::Zero());
  const Vec3 turn = 2.5 * Vec3(1, 2, -1).normalized(), shift(0.1, -0.2, 0.3);
  pin.position_drive = vector_drive<3>(shift, std::make_shared<Ramp>());
  pin.rotation_drive = vector_drive<3>(turn, std::make_shared<Ramp>());
  add_joint(deck, pin);
  const LinearisedModel model = solve_static(deck, {});
  CHECK(model.time == 1.0);
  CHECK((model.nodes[0].x - shift).norm() < 1e-13);
  CHECK((model.nodes[0].R - rotation_exp(turn)).norm() < 1e-13);
}

TEST_CASE("redundant constraints: least loads, same posture") {
  Deck deck = sprung_pendulum(2.0, 0.5, 14.0, 1.1, 0.3);
  const LinearisedModel simple = solve_static(deck, {});
  add_joint(deck, clamp(deck, 0));  // the ground twice
  const LinearisedModel model = solve_static(deck, {});
  CHECK(std::abs(angle_of(model, 1) - angle_of(simple, 1)) < 1e-12);
  const Eigen::VectorXd first = model.y.segment<6>(12), second = model.y.tail<6>();
  CHECK((first - second).norm() < 1e-12);  // both carry half
  CHECK((first + second - simple.y.segment<6>(12)).norm() < 1e-12);
}

TEST_CASE("partly imposed rotation: the imposed component of the rotation vector is met") {
  Deck deck;
  deck.control.static_model = true;
  const NodeIndex node = add_node(deck, NodeKind::static_node, Vec3::Zero(), rotation_exp(Vec3(0.05, 0.3, -0.2)));
  TotalPinData pin = pin_of(node, Vec3::Zero());
  pin.rotation = {TotalComponent::position, TotalComponent::inactive, TotalComponent::inactive};
  pin.rotation_drive = vector_drive<3>(Vec3(0.7, 0, 0));
  add_joint(deck, pin);
  const NodeIndex ground = add_node(deck, NodeKind::static_node, Vec3::Zero());
  add_joint(deck, clamp(deck, ground));
  LinearLaw<3> law = spring3(3.0);
  law.prestrain = vector_drive<3>(Vec3(0.0, 0.5, -0.4));
  add_joint(deck, DeformableHingeData{ground, node, Mat3::Identity(), Mat3::Identity(), law});
  const LinearisedModel model = solve_static(deck, {});
  CHECK(std::abs(rotation_log(model.nodes[0].R).x() - 0.7) < 1e-13);
}

TEST_CASE("a node that nothing carries is named") {
  Deck deck = sprung_pendulum(2.0, 0.5, 14.0, 1.1, 0.3);
  const NodeIndex loose = add_node(deck, NodeKind::dynamic_node, Vec3(1, 1, 1));
  deck.nodes[loose].id.name = "feather";
  add_body(deck, loose, 0.3, Vec3::Zero(), 0.01 * Mat3::Identity());
  try {
    solve_static(deck, {});
    FAIL("converged");
  } catch (const NotConverged& error) {
    CHECK_THAT(error.what(), Catch::Contains("force equilibrium of node feather along y is off by 2.94 N"));
  }
}

TEST_CASE("constraints that cannot be met are named") {
  Deck deck = sprung_pendulum(2.0, 0.5, 14.0, 1.1, 0.3);
  add_joint(deck, SphericalPinData{1, Vec3(0, 0.5, 0), Vec3(0.3, 0.4, 0.0)});  // half a metre from the hinge
  CHECK_THROWS_WITH(solve_static(deck, {}), Catch::Contains("joint_104") || Catch::Contains("joint_102"));
}

TEST_CASE("a dynamic deck is refused") {
  Deck deck = sprung_pendulum(2.0, 0.5, 14.0, 1.1, 0.3);
  deck.control.static_model = false;
  CHECK_THROWS_AS(solve_static(deck, {}), ModelError);
}

TEST_CASE("what is singular is told as by the condition estimate alone") {
  int singular = 0, regular = 0;
  for (int exponent = 0; exponent <= 20; ++exponent) {
    for (int n = 1; n <= 30; ++n) {
      Eigen::MatrixXd A = Eigen::MatrixXd::Random(n, n);
      A.col(n / 2) *= std::pow(10.0, -exponent);
      if (n > 1) A.row(n - 1) = A.row(0) + std::pow(10.0, -exponent) * A.row(n - 1).eval();
      const Eigen::PartialPivLU<Eigen::MatrixXd> lu(A);
      const auto pivots = lu.matrixLU().diagonal().cwiseAbs();
      const bool expected = !(pivots.minCoeff() > 1e-15 * pivots.maxCoeff()) || !(lu.rcond() > 1e-15);
      ++(expected ? singular : regular);
      INFO("n = " << n << ", exponent " << exponent);
      CHECK(is_singular(lu) == expected);
    }
  }
  CHECK(singular > 100);
  CHECK(regular > 100);
}

TEST_CASE("infinities and NaN are found anywhere") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    for (int n = 1; n <= 17; ++n) {
      Eigen::VectorXd x = Eigen::VectorXd::Constant(n, 1e308);
      CHECK(all_finite(x.data(), n));
      for (int i = 0; i < n; ++i) {
        x(i) = bad;
        CHECK_FALSE(all_finite(x.data(), n));
        x(i) = 1e308;
      }
    }
  }
  CHECK(all_finite(nullptr, 0));
}
