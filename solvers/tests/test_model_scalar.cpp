// Abstract nodes, genels, friction, drives that read the state: tangents against finite differences of the residual, in
// both forms; balancing; scalar functions.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include <functional>

#include "deck_builder.h"
#include "mbdae/elements/distance.h"
#include "mbdae/elements/genel_constraints.h"
#include "mbdae/elements/genel_springs.h"
#include "mbdae/elements/linear_motion.h"
#include "mbdae/elements/state_space.h"
#include "mbdae/model/model.h"
#include "test_deck_support.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

State moved(const Model& model, const State& reference, const Eigen::VectorXd& dy, const Eigen::VectorXd& dydot) {
  State state = reference;
  state.y += dy;
  state.ydot += dydot;
  for (std::size_t i = 0; i < state.nodes.size(); ++i) {
    const int first = model.slots()[i].first;
    const Mat3 turn = cayley_rotation(dy.segment<3>(first + 3));
    state.nodes[i].x += dy.segment<3>(first);
    state.nodes[i].v += dydot.segment<3>(first);
    state.nodes[i].R = turn * reference.nodes[i].R;
    state.nodes[i].w =
        cayley_tangent(dy.segment<3>(first + 3)) * dydot.segment<3>(first + 3) + turn * reference.nodes[i].w;
  }
  return state;
}

Eigen::VectorXd derivative(const std::function<Eigen::VectorXd(double)>& f) {
  const double h = 2e-3;
  const auto slope = [&](double step) -> Eigen::VectorXd { return (f(step) - f(-step)) / (2.0 * step); };
  const Eigen::VectorXd a = slope(h), b = slope(h / 2), c = slope(h / 4);
  const Eigen::VectorXd ab = (4.0 * b - a) / 3.0, bc = (4.0 * c - b) / 3.0;
  return (16.0 * bc - ab) / 15.0;
}

void assemble(const Model& model, const State& state, Equations& eq, bool tangent, bool reduced) {
  if (!reduced) return model.assemble(state, eq, tangent);
  eq.clear(model.size(), tangent);
  model.add_loads(state, eq, tangent);
  model.add_reduced_constraints(state, eq, tangent);
}

void check_tangents_at(const Model& model, const State& state, double tolerance = 1e-9) {
  const int n = model.size();
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(n);
  for (const bool reduced : {false, true}) {
    Equations eq, work;
    assemble(model, state, eq, true, reduced);
    model.to_increments(state, eq);
    for (int k = 0; k < n; ++k) {
      const Eigen::VectorXd unit = Eigen::VectorXd::Unit(n, k);
      const Eigen::VectorXd by_y = derivative([&](double h) {
        assemble(model, moved(model, state, h * unit, zero), work, false, reduced);
        return work.g;
      });
      const Eigen::VectorXd by_ydot = derivative([&](double h) {
        assemble(model, moved(model, state, zero, h * unit), work, false, reduced);
        return work.g;
      });
      INFO("column " << model.unknown_name(k) << (reduced ? ", reduced" : ""));
      const double scale = 1.0 + by_y.norm() + by_ydot.norm();
      CHECK((by_y - eq.g_y.col(k)).norm() / scale < tolerance);
      CHECK((by_ydot - eq.g_ydot.col(k)).norm() / scale < tolerance);
    }
  }
}

/// A state that fits nothing.
State ugly_state(const Model& model, unsigned seed) {
  Ugly ugly(seed);
  State state = model.initial_state();
  state.t = 0.37;
  for (int k = 0; k < model.size(); ++k) {
    state.y(k) += ugly.number(-3.0, 3.0);
    state.ydot(k) = ugly.number(-3.0, 3.0);
  }
  return state;
}

void check_tangents(const Deck& deck, unsigned seed, double tolerance = 1e-9) {
  const Model model(deck);
  check_tangents_at(model, ugly_state(model, seed), tolerance);
}

/// Velocity and acceleration terms against the reduced constraints along a motion without accelerations.
void check_rates(const Deck& deck, unsigned seed) {
  const Model model(deck);
  State state = ugly_state(model, seed);
  ConstraintRates rates, work_rates;
  model.rates(state, rates, true);
  Equations work;
  const int first = model.reaction_start(), count = model.reaction_count();
  const auto at_time = [&](double h) {
    State s = state;
    s.t += h;
    for (NodeMotion& node : s.nodes) {
      node.x += h * node.v;
      node.R = rotation_exp(h * node.w) * node.R;
    }
    return s;
  };
  const auto velocity_constraint = [&](const State& s) {
    model.rates(s, work_rates, false);
    assemble(model, s, work, false, true);
    Eigen::VectorXd out = work_rates.rate.tail(count);
    for (const ConstraintEntry& entry : model.constraints()) {
      if (entry.constraint->velocity_level(0))
        out(entry.constraint->first() - first) = work.g(entry.constraint->first());
    }
    return out;
  };
  const Eigen::VectorXd rate = derivative([&](double h) {
    assemble(model, at_time(h), work, false, true);
    return Eigen::VectorXd(work.g.tail(count));
  });
  const Eigen::VectorXd bias = derivative([&](double h) { return velocity_constraint(at_time(h)); });
  for (const ConstraintEntry& entry : model.constraints()) {
    const int row = entry.constraint->first();
    INFO(joint_title(*entry.data));
    if (!entry.constraint->velocity_level(0))
      CHECK(rates.rate(row) == Approx(rate(row - first)).epsilon(1e-9).margin(1e-9));
    CHECK(rates.bias(row) == Approx(bias(row - first)).epsilon(1e-9).margin(1e-9));
  }
  for (std::size_t i = 0; i < state.nodes.size(); ++i) {
    for (int k = 0; k < 6; ++k) {
      const Eigen::VectorXd by_q = derivative([&](double h) {
        State s = state;
        if (k < 3) {
          s.nodes[i].x(k) += h;
        } else {
          s.nodes[i].R = rotation_exp(h * Vec3::Unit(k - 3)) * s.nodes[i].R;
        }
        return velocity_constraint(s);
      });
      CHECK((by_q - rates.rate_q.col(model.slots()[i].first + k).tail(count)).norm() < 1e-9 * (1.0 + by_q.norm()));
    }
  }
}

Deck two_bodies(unsigned seed) {
  Ugly ugly(seed);
  Deck deck;
  for (int i = 0; i < 2; ++i) {
    const NodeIndex node =
        add_node(deck, NodeKind::dynamic_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector());
    add_body(deck, node, 1.5 + i, ugly.vector(0.1), ugly.inertia());
  }
  return deck;
}

deck_test::DeckText deck_text(const std::string& elements) {
  deck_test::DeckText deck;
  deck.nodes =
      "structural: 1, dynamic, 0.1, 0.2, 0.3, euler, 0.3, -0.4, 0.5, 0.1, 0.2, -0.3, 0.4, 0.5, -0.6;\n"
      "structural: 2, dynamic, 1., 2., 3., euler, -0.2, 0.1, 0.7, 0.3, -0.2, 0.1, 0.5, -0.3, 0.2;\n"
      "abstract: 1, differential, value, 0.1, derivative, 0.2; abstract: 2, differential; abstract: 3, differential;\n"
      "abstract: 4, algebraic, value, 0.3;\n";
  deck.control = "abstract nodes: 4; genels: " + std::to_string(deck_test::occurrences(elements, "genel:")) + ";";
  deck.globals =
      "scalar function: \"strib\", exp, coefficient, -10., 0.10; scalar function: \"coul\", const, 0.15;\n"
      "scalar function: \"mu\", sum, \"strib\", \"coul\";";
  deck.elements =
      "body: 1, 1, 2., 0.1, 0.2, 0.3, diag, 1., 2., 3.; body: 2, 2, 1., null, diag, 1., 1., 2.;\n" + elements;
  return deck;
}

}  // namespace

TEST_CASE("genels") {
  const Deck deck = deck_test::read_good(deck_text(
      "genel: 1, spring support, 1, abstract, algebraic, cubic viscoelastic generic, 2., 3., 4., 0.5, prestress, 0.3;\n"
      "genel: 2, cross spring support, 2, abstract, algebraic, 1, structural, 3, algebraic, linear viscoelastic, 7., "
      "8.;\n"
      "genel: 3, cross spring support, 1, structural, 5, differential, 1, abstract, algebraic, linear elastic, 2.;\n"
      "genel: 4, spring, 2, abstract, algebraic, 1, abstract, differential, linear elastic, 13.;\n"
      "genel: 5, spring, 4, abstract, 1, structural, 2, algebraic, linear elastic, 3.;\n"
      "genel: 6, mass, 1, abstract, algebraic, 4.; genel: 7, mass, 2, structural, 1, algebraic, 2.;\n"
      "genel: 8, distance, 2, abstract, algebraic, 3, abstract, algebraic, 0.25;\n"
      "genel: 9, clamp, 1, structural, 1, algebraic, sine, 0., 3., 0.2, forever, 0.;\n"
      "genel: 10, clamp, 3, abstract, differential, 0.3; genel: 11, clamp, 4, abstract, 0.7;\n"
      "genel: 12, clamp, 2, structural, 6, differential, 0.1;\n"
      "genel: 13, spring support, 2, structural, 3, algebraic, linear viscoelastic, 20., 0.5, position, from node;\n"
      "force: 1, abstract, 3, abstract, cosine, 0., 2., 3., forever, 0.;"));
  check_tangents(deck, 1);
  CHECK(deck.genels.size() == 13);
}

TEST_CASE("state spaces and filters") {
  check_tangents(
      deck_test::read_good(deck_text(
          "genel: 1, state space SISO, 1, abstract, algebraic, node dof, 1, structural, 3, algebraic, 2, matrix E, 2., "
          "0.3, 0.1, 1.5, matrix A, -1., 20., -3., -4., matrix B, 5., 6., matrix C, 7., 8., matrix D, 9., gain, 0.5, "
          "balance, no, value, 0.1, -0.2, derivative, 1., 2.;\n"
          "genel: 2, state space MIMO, 2, 2, abstract, algebraic, 4, abstract, 3, node dof, 2, structural, 5, "
          "differential, drive, node, 3, abstract, string, \"x\", linear, 0.1, 2., drive, const, 0.3, 2, matrix A, "
          "-1., "
          "1e4, -1e-3, -4., matrix B, 5., 6., 7., 1., 2., 3., matrix C, 7., 8., -1., 3., matrix D, 1., 2., 3., 4., 5., "
          "6.;\n"
          "genel: 3, scalar filter, 3, abstract, algebraic, node dof, 1, abstract, differential, 3, 3., 50., 7., 2, "
          "0.5, "
          "4., 7., gain, 2., balance, no;")),
      2);
}

TEST_CASE("states are balanced as LAPACK does") {
  Eigen::MatrixXd A(2, 2);
  A << -1.0, 1e4, -1e-3, -4.0;
  CHECK(balancing_scale(A) == Eigen::Vector2d(512.0, 0.25));  // found in MBDyn's output for this matrix
  A(0, 1) = 1e160;                                            // its square overflows
  CHECK(balancing_scale(A) == Eigen::Vector2d(1.0, 1.0));
}

TEST_CASE("drives that read the state") {
  check_tangents(
      deck_test::read_good(deck_text(
          "joint: 1, revolute hinge, 1, position, null, 2, position, -1., 0.2, 0.1, orientation, euler, 0.1, 0.2, "
          "0.3;\n"
          "joint: 2, deformable hinge, 1, 2, linear viscoelastic generic, diag, 1., 2., 3., diag, 0.1, 0.2, 0.3;\n"
          "force: 1, absolute, 1, position, 0.1, 0.2, 0.3, 1., 2., 3., node, 2, structural, string, \"X[2]\", linear, "
          "0.5, 2.;\n"
          "force: 2, follower, 2, position, null, component, node, 1, structural, string, \"XP[1]\", string, "
          "\"Var^2 + Time\", mult, node, 1, structural, string, \"Omega[3]\", direct, node, 2, structural, string, "
          "\"Phi[1]\", direct, element, 1, joint, string, \"rz\", string, \"sin(Var)\";\n"
          "couple: 3, follower, 1, component, element, 1, joint, string, \"wz\", direct, element, 1, joint, string, "
          "\"Fy\", linear, 0., 2., array, 2, element, 2, joint, string, \"My\", direct, element, 2, joint, string, "
          "\"rz\", direct;\n"
          "joint: 3, total joint, 1, 2, position constraint, active, inactive, velocity, component, node, 1, abstract, "
          "string, \"x\", direct, null, node, 1, abstract, string, \"xP\", linear, 0., 3., orientation constraint, "
          "active, active, active, component, node, 2, abstract, string, \"x\", direct, const, 0.1, dof, 2, "
          "structural, "
          "3, algebraic, linear, 0., 0.1;\n"
          "force: 4, abstract, 3, abstract, element, 3, joint, string, \"Fx\", string, \"2.*Var\";\n"
          "force: 5, abstract, 2, structural, 3, dof, 1, structural, 5, differential, direct;\n"
          "genel: 1, clamp, 1, structural, 2, algebraic, node, 3, abstract, string, \"x\", linear, 0., 2.;")),
      3, 1e-8);
}

TEST_CASE("prismatic joint, plane") {
  Ugly ugly(5);
  Deck deck = two_bodies(4);
  add_joint(deck, PrismaticData{0, 1, ugly.rotation(), ugly.rotation()});
  add_joint(deck, InPlaneData{0, 1, ugly.vector(), ugly.vector().normalized(), ugly.vector()});
  check_tangents(deck, 6);
}

TEST_CASE("distance joint") {
  Ugly ugly(7);
  Deck deck = two_bodies(8);
  deck.nodes[1].x += Vec3(2.0, 1.0, 0.5);
  add_joint(deck, DistanceData{0, 1, ugly.vector(), ugly.vector(), sine(2.0, 0.3, 3.0)});
  check_tangents(deck, 9);
  check_rates(deck, 10);
}

TEST_CASE("linear velocity and acceleration") {
  Ugly ugly(11);
  Deck deck = two_bodies(12);
  add_joint(deck, LinearVelocityData{0, ugly.vector().normalized(), sine(2.0, 0.3, 3.0)});
  add_joint(deck, LinearAccelerationData{1, ugly.vector().normalized(), sine(2.0, 0.3, 3.0)});
  check_tangents(deck, 13);
}

TEST_CASE("friction: tangents") {
  const std::string joint =
      "joint: 1, revolute hinge, 1, position, null, orientation, euler, 0.3, 0.2, 0.1, 2, position, ";
  for (const std::string& friction : {std::string("modlugre, 20., 3., 0.5, 0.5, \"mu\", simple"),
                                      std::string("modlugre, 20., 3., 0.5, 0.5, \"mu\", simple plane hinge"),
                                      std::string("discrete coulomb, \"mu\", sigma2, 0.05, simple")}) {
    for (const std::string& preload : {std::string("preload, 100., "), std::string()}) {
      const Deck deck =
          deck_test::read_good(deck_text(joint + "-1., 0.2, 0.1, friction, 0.05, " + preload + friction + ";"));
      const Model model(deck);
      REQUIRE(model.scalar_count() == 5);
      for (unsigned seed = 0; seed < 4; ++seed) {
        State state = ugly_state(model, 20 + seed);
        const double turned = seed % 2 == 0 ? 1.0 : -1.0;
        state.nodes[0].w *= 0.5 * turned;
        state.nodes[1].w *= -0.5 * turned;
        // bristle between kappa zs and zs, and beyond, on either side
        state.y(model.scalar_start() + 4) = turned * (seed < 2 ? 0.009 : 0.05);
        INFO(friction << " " << preload << seed);
        check_tangents_at(model, state, seed < 2 ? 1e-6 : 1e-8);
      }
    }
  }
}

TEST_CASE("scalars: names, kinds, order of files") {
  const Deck deck = deck_test::read_good(deck_text(
      "joint: 1, revolute hinge, 1, position, null, 2, position, -1., 0.2, 0.1, friction, 0.05, preload, 10., "
      "modlugre, "
      "20., 3., 0.5, 0.5, \"mu\", simple;\n"
      "joint: 2, distance, 1, 2, 2.; genel: 1, mass, 1, abstract, algebraic, 4.; genel: 2, clamp, 2, abstract, "
      "algebraic, 0.;"));
  const Model model(deck);
  std::vector<std::string> names;
  for (const int k : model.file_order()) names.push_back(model.unknown_name(k) + " " + model.unknown_kind(k));
  REQUIRE(names.size() == 24 + 4 + 6 + 4 + 1 + 1);
  CHECK(names[24] == "abstract node 1.x state");
  CHECK(names[27] == "abstract node 4.x algebraic");
  CHECK(names[28] == "joint 1.reaction[1] reaction");
  CHECK(names[33] == "joint 1.bristle state");
  CHECK(names[34] == "joint 2.direction[1] algebraic");
  CHECK(names[37] == "joint 2.reaction[1] algebraic");
  CHECK(names[38] == "genel 1.rate state");
  CHECK(names[39] == "genel 2.reaction[1] reaction");
}

TEST_CASE("what cannot be a genel, a drive or friction is refused by name") {
  const auto refused = [](const std::string& elements, const std::string& words) {
    const std::string message = deck_test::complaint(deck_text(elements).text());
    INFO(message);
    CHECK(message.find(words) != std::string::npos);
  };
  refused("genel: 1, spring support, 4, abstract, linear elastic, 1.;", "the node is algebraic and has no rate");
  refused("genel: 1, spring support, 1, structural, 4, algebraic, linear elastic, 1.;", "use a deformable hinge");
  refused("genel: 1, clamp, 4, abstract, algebraic, 1.;", "its order must not be given");
  refused("genel: 1, clamp, 9, abstract, algebraic, 1.;", "abstract node 9 is not defined before this card");
  refused("genel: 1, spring, 1, abstract, algebraic, 2, abstract, algebraic, linear viscous, 1.;", "elastic law");
  refused("genel: 1, swash plate, 1;", "not supported: the genel `swash plate`");
  refused("gravity: uniform, 0., 0., 1., node, 1, structural, string, \"X[1]\", direct;", "not supported here");
  refused("force: 1, abstract, 1, abstract, element, 7, joint, string, \"rz\", direct;", "joint 7 is not defined");
  refused("joint: 1, clamp, 1, node, node; force: 1, abstract, 1, abstract, element, 1, joint, string, \"rz\", direct;",
          "not supported: the quantity `rz` of a clamp");
  refused(
      "joint: 1, revolute hinge, 1, position, null, 2, position, null, friction, 0.1, modlugre, 1., 1., 1., 0.5, "
      "\"nu\", simple;",
      "the scalar function \"nu\" is not defined");
  refused(
      "joint: 1, revolute hinge, 1, position, null, 2, position, null, friction, 0.1, modlugre, 1., 1., 1., 0.5, "
      "\"mu\";",
      "the shape of the friction");
  refused(
      "genel: 1, state space SISO, 1, abstract, algebraic, drive, 0., 1, matrix E, 1., matrix A, 1., matrix B, 1., "
      "matrix C, 1.;",
      "balance, no");
  refused("genel: 1, scalar filter, 1, abstract, algebraic, drive, 0., 1, 1., 2, 1., 1., 1.;",
          "above the denominator's");
}
