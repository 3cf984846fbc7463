// Every element's tangents against finite differences of its residual, at large rotations, in motion, under load.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include "tangent_check.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

// Two tumbling bodies with awkward inertias.
Deck two_bodies(unsigned seed) {
  Ugly ugly(seed);
  Deck deck;
  for (int i = 0; i < 2; ++i) {
    const NodeIndex node =
        add_node(deck, NodeKind::dynamic_node, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.vector(2.0));
    add_body(deck, node, ugly.number(0.5, 3.0), ugly.vector(0.2), ugly.inertia());
  }
  add_gravity(deck, Vec3(0.3, -9.81, 0.7));
  return deck;
}

}  // namespace

TEST_CASE("bodies in motion, several on one node") {
  Deck deck = two_bodies(1);
  Ugly ugly(101);
  add_body(deck, 0, 0.7, ugly.vector(), ugly.inertia());
  check_tangents(deck, 1);
}

TEST_CASE("bodies under model: static") {
  Deck deck = two_bodies(2);
  deck.control.static_model = true;
  check_tangents(deck, 2);
}

TEST_CASE("forces and couples") {
  Deck deck = two_bodies(3);
  Ugly ugly(103);
  for (const ForceFrame frame : {ForceFrame::absolute, ForceFrame::follower}) {
    for (const bool couple : {false, true}) {
      ForceData force;
      force.frame = frame;
      force.couple = couple;
      force.node = couple ? 0 : 1;
      force.arm = ugly.vector();
      force.value = vector_drive<3>(ugly.vector(5.0), sine(1.0, 0.5, 2.0));
      add_force(deck, force);
    }
  }
  check_tangents(deck, 3);
}

TEST_CASE("clamp, also when turned away from its place") {
  Deck deck = two_bodies(4);
  add_joint(deck, clamp(deck, 0));
  Ugly ugly(104);
  add_joint(deck, ClampData{1, ugly.vector(), ugly.rotation(1.0) * deck.nodes[1].R, std::nullopt});
  check_tangents(deck, 4);
}

TEST_CASE("spherical joints") {
  Deck deck = two_bodies(5);
  Ugly ugly(105);
  add_joint(deck, SphericalHingeData{0, 1, ugly.vector(), ugly.vector()});
  add_joint(deck, SphericalPinData{1, ugly.vector(), ugly.vector()});
  check_tangents(deck, 5);
}

TEST_CASE("revolute joints") {
  Deck deck = two_bodies(6);
  Ugly ugly(106);
  add_joint(deck, RevoluteHingeData{0, 1, ugly.vector(), ugly.vector(), ugly.rotation(), ugly.rotation(), {}, {}});
  add_joint(deck, RevolutePinData{1, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.rotation(), {}});
  check_tangents(deck, 6);
}

TEST_CASE("cardano joints") {
  Deck deck = two_bodies(7);
  Ugly ugly(107);
  add_joint(deck, CardanoHingeData{1, 0, ugly.vector(), ugly.vector(), ugly.rotation(), ugly.rotation()});
  add_joint(deck, CardanoPinData{1, ugly.vector(), ugly.rotation(), ugly.vector(), ugly.rotation()});
  check_tangents(deck, 7);
}

TEST_CASE("in line") {
  Deck deck = two_bodies(8);
  Ugly ugly(108);
  add_joint(deck, InLineData{0, 1, ugly.vector(), ugly.rotation(), ugly.vector()});
  add_joint(deck, InLineData{1, 0, ugly.vector(), ugly.rotation(), Vec3::Zero()});
  check_tangents(deck, 8);
}

TEST_CASE("in plane") {
  Deck deck = two_bodies(18);
  Ugly ugly(118);
  add_joint(deck, InPlaneData{0, 1, ugly.vector(), ugly.vector().normalized(), ugly.vector()});
  add_joint(deck, InPlaneData{1, 0, ugly.vector(), Vec3(0, 0, -1), Vec3::Zero()});
  check_tangents(deck, 18);
}

TEST_CASE("prismatic") {
  Deck deck = two_bodies(19);
  Ugly ugly(119);
  add_joint(deck, PrismaticData{0, 1, ugly.rotation(), ugly.rotation()});
  check_tangents(deck, 19);
}

namespace {

TotalJointData total_joint(Ugly& ugly) {
  TotalJointData joint;
  joint.node1 = 0;
  joint.node2 = 1;
  joint.f1 = ugly.vector();
  joint.f2 = ugly.vector();
  joint.R1h = ugly.rotation();
  joint.R1hr = ugly.rotation();
  joint.R2h = ugly.rotation();
  joint.R2hr = ugly.rotation(0.5);
  joint.position_drive = vector_drive<3>(ugly.vector(), sine(0.4, 0.3, 2.0, 0.7));
  joint.rotation_drive = vector_drive<3>(ugly.vector(), sine(0.2, 0.3, 3.0, 0.3));
  return joint;
}

TotalPinData total_pin(Ugly& ugly) {
  const TotalJointData joint = total_joint(ugly);
  TotalPinData pin;
  pin.node = 1;
  pin.fn = joint.f2;
  pin.Rnh = joint.R2h;
  pin.Rnhr = joint.R2hr;
  pin.Xc = joint.f1;
  pin.Rch = joint.R1h;
  pin.Rchr = joint.R1hr;
  pin.position_drive = joint.position_drive;
  pin.rotation_drive = joint.rotation_drive;
  return pin;
}

constexpr auto P = TotalComponent::position;
constexpr auto V = TotalComponent::velocity;
constexpr auto O = TotalComponent::inactive;

}  // namespace

TEST_CASE("total joint, every kind of component") {
  Ugly ugly(109);
  const std::array<std::array<TotalComponent, 6>, 7> kinds{{{P, P, P, P, P, P},
                                                            {P, O, P, O, P, P},
                                                            {O, P, O, O, P, O},
                                                            {V, P, O, O, O, O},
                                                            {V, V, V, V, V, V},
                                                            {O, O, V, P, V, P},
                                                            {P, V, P, O, O, V}}};
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const auto& kind = kinds[i];
    const auto seed = static_cast<unsigned>(i);
    DYNAMIC_SECTION("kind " << i) {
      Deck deck = two_bodies(20 + seed);
      TotalJointData joint = total_joint(ugly);
      joint.position = {kind[0], kind[1], kind[2]};
      joint.rotation = {kind[3], kind[4], kind[5]};
      add_joint(deck, joint);
      check_tangents(deck, 30 + seed);
    }
    DYNAMIC_SECTION("pin of kind " << i) {
      Deck deck = two_bodies(40 + seed);
      TotalPinData pin = total_pin(ugly);
      pin.position = {kind[0], kind[1], kind[2]};
      pin.rotation = {kind[3], kind[4], kind[5]};
      add_joint(deck, pin);
      check_tangents(deck, 50 + seed);
    }
  }
}

TEST_CASE("rods: linear, cubic, with and without offsets") {
  Deck deck = two_bodies(10);
  Ugly ugly(110);
  LinearLaw<1> linear;
  linear.K << 12.0;
  linear.C << 3.0;
  linear.prestress << 1.3;
  linear.prestrain = vector_drive<1>(Eigen::Matrix<double, 1, 1>(0.1), sine(1.0, 0.2, 1.0));
  add_joint(deck, RodData{0, 1, ugly.vector(), ugly.vector(), 0.8, linear});
  add_joint(deck, RodData{1, 0, Vec3::Zero(), Vec3::Zero(), 1.1, linear});
  CubicLaw<1> cubic;
  cubic.K1 << 5.0;
  cubic.K2 << 3.0;
  cubic.K3 << 7.0;
  cubic.C << 0.4;
  cubic.prestress << -0.2;
  add_joint(deck, RodData{0, 1, ugly.vector(), ugly.vector(), 0.9, cubic});
  check_tangents(deck, 10);
}

TEST_CASE("deformable hinges and joint at large relative rotation") {
  Ugly ugly(111);
  for (unsigned i = 0; i < 3; ++i) {
    Deck deck = two_bodies(60 + i);
    LinearLaw<3> law3;
    law3.K = ugly.matrix<3>(5.0);
    law3.C = ugly.matrix<3>(2.0);
    law3.prestress = ugly.vector();
    law3.prestrain = vector_drive<3>(ugly.vector(0.3));
    add_joint(deck, DeformableHingeData{0, 1, ugly.rotation(), ugly.rotation(), law3});
    CubicLaw<3> cubic;
    cubic.K1 = ugly.vector(4.0);
    cubic.K2 = ugly.vector(4.0);
    cubic.K3 = ugly.vector(4.0);
    cubic.C = ugly.matrix<3>();
    cubic.prestress = ugly.vector();
    add_joint(deck, DeformableHingeData{1, 0, ugly.rotation(), ugly.rotation(), cubic});
    LinearLaw<6> law6;
    law6.K = ugly.matrix<6>(5.0);
    law6.C = ugly.matrix<6>(2.0);
    law6.prestress << ugly.vector(), ugly.vector();
    add_joint(deck, DeformableJointData{0, 1, ugly.vector(), ugly.vector(), ugly.rotation(), ugly.rotation(), law6});
    check_tangents(deck, 70 + i);

    Deck others = two_bodies(60 + i);
    add_joint(others, InvariantDeformableHingeData{0, 1, ugly.rotation(), ugly.rotation(), law3});
    add_joint(others, InvariantDeformableHingeData{1, 0, ugly.rotation(), ugly.rotation(), cubic});
    add_joint(others, DeformableDisplacementJointData{0, 1, ugly.vector(), ugly.vector(), ugly.rotation(), law3});
    add_joint(others, DeformableDisplacementJointData{1, 0, ugly.vector(), ugly.vector(), ugly.rotation(), cubic});
    LinearLaw<1> law1;
    law1.K << 3.0;
    law1.C << 0.7;
    law1.prestress << 1.3;
    add_joint(others, DeformableAxialJointData{0, 1, ugly.rotation(), ugly.rotation(), law1});
    check_tangents(others, 170 + i);
  }
}

TEST_CASE("muscles: every variant of the law") {
  Ugly ugly(112);
  for (int variant = 0; variant < 8; ++variant) {
    Deck deck = two_bodies(80);
    for (NodeData& node : deck.nodes) {
      node.v *= 0.05;
      node.w *= 0.05;
    }
    MuscleLaw law;
    const Vec3 f1 = ugly.vector(0.1), f2 = ugly.vector(0.1);
    const double l = (deck.nodes[1].x + deck.nodes[1].R * f2 - deck.nodes[0].x - deck.nodes[0].R * f1).norm();
    law.Li = l / 1.07;
    law.L0 = l / 1.12;
    law.V0 = 4.0 * law.L0;
    law.F0 = 20.0;
    law.activation = constant(0.3);
    law.prestress = 0.7;
    if (variant == 1) law.model = MuscleModel::erf;
    if (variant == 2) law.ergonomy = true;
    if (variant >= 3) {
      law.reflex = ReflexData{constant(1.2), constant(0.4), constant(0.93 * l)};
      law.prestrain = constant(0.01);
    }
    if (variant == 4) law.short_range = ShortRangeData{ShortRangeModel::linear, 28.0, 0.7};
    if (variant == 5) law.short_range = ShortRangeData{ShortRangeModel::exponential, 2.8, 0.3};
    if (variant == 6) law.reflex->proportional_gain = constant(30.0);   // saturated above
    if (variant == 7) law.reflex->proportional_gain = constant(-30.0);  // and below
    law.activation_check = variant >= 6;
    DYNAMIC_SECTION("variant " << variant) {
      add_joint(deck, RodData{0, 1, f1, f2, law.Li, law});
      check_tangents(deck, 90, 3e-10);
    }
  }
}
