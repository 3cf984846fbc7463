// Reactions, accelerations, inputs and names of linearised models.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include "deck_builder.h"
#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "pencil.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

constexpr double kGravity = 9.81;  // m/s^2

// Swinging about z at the origin: mass m, distance L, inertia J about the centre of mass.
Deck swinging(double theta, double rate) {
  Deck deck;
  const Mat3 R = rotation_exp(Vec3(0, 0, theta));
  const Vec3 x = R * Vec3(0, -0.5, 0), w(0, 0, rate);
  const NodeIndex node = add_node(deck, NodeKind::dynamic_node, x, R, w.cross(x), w);
  add_body(deck, node, 2.0, Vec3::Zero(), 0.03 * Mat3::Identity());
  add_joint(deck, RevolutePinData{node, Vec3(0, 0.5, 0), Mat3::Identity(), Vec3::Zero(), Mat3::Identity(), {}});
  add_gravity(deck, Vec3(0, -kGravity, 0));
  return deck;
}

MuscleLaw muscle(double length) {
  MuscleLaw law;
  law.Li = law.L0 = length;
  law.V0 = 4.0 * length;
  law.F0 = 100.0;
  law.activation = constant(0.2);
  return law;
}

}  // namespace

TEST_CASE("reactions and accelerations of a pendulum in full swing") {
  const double theta = 0.7, rate = 3.0, m = 2.0, L = 0.5, J = 0.03;
  const LinearisedModel model = linearise(swinging(theta, rate), {});
  const double alpha = -m * kGravity * L * std::sin(theta) / (J + m * L * L);
  const Vec3 x = rotation_exp(Vec3(0, 0, theta)) * Vec3(0, -L, 0);
  const Vec3 acceleration = Vec3(0, 0, alpha).cross(x) - rate * rate * x;
  const Vec3 carried = m * (acceleration + Vec3(0, kGravity, 0));  // force of the pin on the body
  CHECK((model.y.segment<3>(12) + carried).norm() < 1e-12);        // MBDyn's sign: the force that the node exerts
  CHECK((model.ydot.segment<3>(6) - m * acceleration).norm() < 1e-12);
  CHECK(std::abs(model.ydot(11) - J * alpha) < 1e-13);
  CHECK((model.ydot.segment<3>(3) - Vec3(0, 0, rate)).norm() == 0.0);
  CHECK((model.y.segment<3>(6) - m * Vec3(0, 0, rate).cross(x)).norm() < 1e-14);
}

TEST_CASE("pencil of a hanging pendulum has the physical frequency") {
  Deck deck = swinging(0.0, 0.0);
  const LinearisedModel model = linearise(deck, {});
  const double omega = std::sqrt(2.0 * kGravity * 0.5 / (0.03 + 0.5));
  CHECK(distance_to_eigenvalue(model, {0.0, omega}) < 1e-12);                // rad/s
  CHECK(distance_to_eigenvalue(model, {0.0, omega * (1.0 + 1e-9)}) > 1e-9);  // which sees that much
}

TEST_CASE("inputs are derivatives of the residual") {
  Deck deck = swinging(0.4, 0.0);
  const NodeIndex seat = add_node(deck, NodeKind::static_node, Vec3(0.3, 0.1, 0.0), rotation_exp(Vec3(0.2, 0.1, -0.3)));
  TotalPinData pin;
  pin.node = seat;
  pin.fn = Vec3(0.01, 0.02, 0.03);
  pin.Xc = deck.nodes[seat].x + deck.nodes[seat].R * pin.fn;
  pin.Rch = pin.Rnh = rotation_exp(Vec3(0.5, 0.1, 0.2));
  pin.Rchr = rotation_exp(Vec3(-0.5, 0.1, 0.2));
  pin.Rnhr = deck.nodes[seat].R.transpose() * pin.Rchr;
  pin.position.fill(TotalComponent::position);
  pin.rotation.fill(TotalComponent::position);
  add_joint(deck, pin);
  MuscleLaw law = muscle((deck.nodes[1].x - deck.nodes[0].x).norm());
  law.reflex = ReflexData{constant(1.2), constant(0.1), constant(law.L0)};
  add_joint(deck, RodData{1, 0, Vec3::Zero(), Vec3::Zero(), law.Li, law});

  const LinearisedModel model = linearise(deck, {});
  REQUIRE(model.inputs.size() == 7);
  CHECK(model.inputs[0].name == "activation[joint_103]");
  CHECK(model.inputs[2].name == "drive[joint_102.position[2]]");
  CHECK(model.inputs[6].name == "drive[joint_102.rotation[3]]");
  CHECK(model.inputs[6].unit == "rad");
  REQUIRE(model.muscles.size() == 1);
  const double active = 0.2 * (1.6 - 1.6 / std::exp(1.0)) * std::exp(0.0025 - 40 * 6.25e-6);
  const double passive = 1.3 * std::atan(0.1 * std::pow(0.78, 10));
  CHECK(std::abs(model.muscles[0].force - 100.0 * (active + passive)) < 1e-12);

  // The residual depends on the inputs: linear in activation, checked by differences for the drives.
  const auto residual = [&](std::size_t input, double h) {
    Deck changed = deck;
    if (input == 0) {
      std::get<MuscleLaw>(changed.joints[2].as<RodData>().law).activation = constant(0.2 + h);
    } else {
      auto& moved = changed.joints[1].as<TotalPinData>();
      const Vec3 direction = h * Vec3::Unit((static_cast<int>(input) - 1) % 3);
      (input <= 3 ? moved.position_drive : moved.rotation_drive) = vector_drive<3>(direction);
    }
    const Model built(changed);
    State state = built.initial_state();
    state.y.tail(built.reaction_count()) = model.y.tail(built.reaction_count());
    Equations eq;
    built.assemble(state, eq, false);
    return eq.g;
  };
  for (std::size_t i = 0; i < 7; ++i) {
    const double h = 1e-4;
    const Eigen::VectorXd difference = (residual(i, h) - residual(i, -h)) / (2.0 * h);
    INFO(model.inputs[i].name);
    const double error = (difference - model.g_u.col(static_cast<Eigen::Index>(i))).norm();
    CHECK(error / (1.0 + difference.norm()) < 1e-10);
  }
}

TEST_CASE("names, kinds, units") {
  const LinearisedModel model = linearise(swinging(0.1, 0.0), {});
  REQUIRE(model.dofs.size() == 17);
  const auto is = [&](std::size_t k, const char* name, const char* kind, const char* unit, int owner) {
    CHECK(model.dofs[k].name == name);
    CHECK(model.dofs[k].kind == kind);
    CHECK(model.dofs[k].unit == unit);
    CHECK(model.dofs[k].owner == owner);
  };
  is(1, "node_1.y", "position", "m", 1);
  is(5, "node_1.gz", "rotation", "rad", 1);
  is(6, "node_1.bx", "momentum", "kg m/s", 1);
  is(10, "node_1.hy", "momenta_moment", "kg m^2/s", 1);
  is(14, "joint_101.reaction[3]", "reaction", "N", 101);
  is(15, "joint_101.reaction[4]", "reaction", "N m", 101);
  CHECK(model.joints.at(0).type == "revolute pin");
  CHECK(model.joints.at(0).first == 12);
  CHECK(model.nodes.at(0).dofs == 12);
  CHECK(model.c == 0.01);
}

TEST_CASE("residual without reactions is the unbalanced load; with them nothing is left at rest") {
  const LinearisedModel model = linearise(swinging(0.0, 0.0), {});
  CHECK(std::abs(model.residual(7) - 2.0 * kGravity) < 1e-13);
  CHECK(std::abs(model.residual.norm() - 2.0 * kGravity) < 1e-13);
  CHECK(model.residual_norm < 1e-13);
}

TEST_CASE("a given state replaces momenta and reactions") {
  const Deck deck = swinging(0.3, 0.0);
  LineariseOptions options;
  options.state = Eigen::VectorXd::LinSpaced(17, 1.0, 17.0);
  const LinearisedModel model = linearise(deck, options);
  CHECK(model.y.tail<11>() == options.state->tail<11>());
  CHECK(model.y.head<3>() == deck.nodes[0].x);
  options.state = Eigen::VectorXd::Zero(5);
  CHECK_THROWS_WITH(linearise(deck, options), Catch::Contains("5 entries") && Catch::Contains("17 unknowns"));
}

TEST_CASE("redundant constraints share the load, contradicting ones are refused") {
  Deck deck = swinging(0.5, 0.0);
  const LinearisedModel single = linearise(deck, {});
  deck.joints.push_back(deck.joints[0]);
  const LinearisedModel both = linearise(deck, {});
  CHECK((both.y.segment<5>(12) - 0.5 * single.y.segment<5>(12)).norm() < 1e-12);
  CHECK((both.y.segment<5>(17) - both.y.segment<5>(12)).norm() < 1e-12);

  // A drive that accelerates against a fixed pin.
  Deck fight = swinging(0.0, 0.0);
  TotalPinData drive;
  drive.node = 0;
  drive.fn = Vec3(0, 0.5, 0);
  drive.Xc = Vec3::Zero();
  drive.Rnh = drive.Rnhr = drive.Rch = drive.Rchr = Mat3::Identity();
  drive.position.fill(TotalComponent::position);
  drive.position_drive = vector_drive<3>(Vec3(1, 0, 0), sine(0.1, -0.1, 3.0, 0.5 * 3.14159265358979323846));
  add_joint(fight, drive);
  CHECK_THROWS_WITH(linearise(fight, {}), Catch::Contains("contradicts"));
}

TEST_CASE("violated constraints and mismatched velocities name joint and amount") {
  Deck deck = swinging(0.2, 0.0);
  deck.nodes[0].x += Vec3(0.0, 2e-3, 0.0);
  CHECK_THROWS_WITH(linearise(deck, {}), Catch::Contains("constraint 2 of 5 of joint joint_101 (revolute pin 101)") &&
                                             Catch::Contains("0.002 m"));
  deck = swinging(0.2, 1.0);
  deck.nodes[0].v += Vec3(0.1, 0.0, 0.0);
  const LinearisedModel found = linearise(deck, {});
  REQUIRE(found.notes.size() == 1);
  CHECK(found.notes[0].find("joint_101 (revolute pin 101)") != std::string::npos);
  deck.control.skip_initial_joint_assembly = true;
  CHECK_THROWS_WITH(linearise(deck, {}),
                    Catch::Contains("velocities") && Catch::Contains("joint_101") && Catch::Contains("0.1 m/s"));
  deck = swinging(0.2, 0.0);
  MuscleLaw law = muscle(0.1);
  add_joint(deck, RodData{0, 0, Vec3::Zero(), Vec3::Zero(), 0.1, law});
  CHECK_THROWS_WITH(linearise(deck, {}), Catch::Contains("coincide"));
}

TEST_CASE("a body on a static node of a dynamic deck is refused") {
  Deck deck = swinging(0.2, 0.0);
  deck.nodes[0].kind = NodeKind::static_node;
  CHECK_THROWS_AS(linearise(deck, {}), ModelError);
}

TEST_CASE("a massless node between joints takes part") {
  // ground - spherical hinge - massless link - spherical hinge - pendulum bob: the link carries axial force only.
  Deck deck;
  const NodeIndex link = add_node(deck, NodeKind::static_node, Vec3::Zero());
  const NodeIndex bob = add_node(deck, NodeKind::dynamic_node, Vec3(0, -0.8, 0));
  add_body(deck, bob, 1.5, Vec3::Zero(), 0.02 * Mat3::Identity());
  add_joint(deck, SphericalPinData{link, Vec3::Zero(), Vec3::Zero()});
  add_joint(deck, SphericalHingeData{link, bob, Vec3(0, -0.8, 0), Vec3::Zero()});
  add_gravity(deck, Vec3(0, -kGravity, 0));
  const LinearisedModel model = linearise(deck, {});
  CHECK((model.y.segment<3>(18) - Vec3(0, -1.5 * kGravity, 0)).norm() < 1e-12);
  CHECK(model.residual_norm < 1e-12);
}
