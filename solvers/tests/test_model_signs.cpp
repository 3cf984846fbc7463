// Signs and scaling: tangent blocks of joints written out in MBDyn's convention, J(c) with constraint rows divided by c
// and reaction columns not multiplied by c. The formulas are those that reproduce matrices written by MBDyn.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <catch2/catch.hpp>

#include "deck_builder.h"
#include "mbdae/model/model.h"

using namespace mbdae;
using namespace mbdae::test;

namespace {

constexpr double c = 0.03;  // s

// Two static nodes (6 unknowns each: rows of forces are rows 0 and 6) and one joint, with reactions.
struct Fixture {
  Ugly ugly{7};
  Deck deck;
  Fixture() {
    for (int i = 0; i < 2; ++i) add_node(deck, NodeKind::static_node, ugly.vector(), ugly.rotation());
  }

  // J(c) in MBDyn's scaling and the state's reactions.
  Eigen::MatrixXd tangent(Eigen::VectorXd& reactions) {
    Model model(deck);
    State state = model.initial_state();
    for (int k = 12; k < model.size(); ++k) state.y(k) = ugly.number(-3.0, 3.0);
    reactions = state.y.tail(model.size() - 12);
    model.set_reference(state);
    Equations eq;
    model.assemble(state, eq, true);
    Eigen::MatrixXd J = eq.g_ydot + c * eq.g_y;
    J.bottomRows(model.size() - 12) /= c;
    J.rightCols(model.size() - 12) /= c;
    return J;
  }
  const Mat3& R(std::size_t i) const { return deck.nodes[i].R; }
};

void same(const Eigen::MatrixXd& J, const Eigen::MatrixXd& expected) {
  CHECK((J - expected).norm() < 1e-13 * J.norm());
}

}  // namespace

TEST_CASE("spherical and revolute hinge") {
  Fixture f;
  RevoluteHingeData hinge{0, 1, f.ugly.vector(), f.ugly.vector(), f.ugly.rotation(), f.ugly.rotation(), {}, {}};
  add_joint(f.deck, hinge);
  Eigen::VectorXd y;
  const Eigen::MatrixXd J = f.tangent(y);
  const Vec3 F = y.head<3>(), d1 = f.R(0) * hinge.d1, d2 = f.R(1) * hinge.d2;
  const Vec3 e3 = f.R(0) * hinge.R1h.col(2), e1 = f.R(1) * hinge.R2h.col(0), e2 = f.R(1) * hinge.R2h.col(1);
  const Vec3 t1 = e2.cross(e3), t2 = e3.cross(e1), mu = e2 * y(3) - e1 * y(4);
  const Mat3 I = Mat3::Identity(), P = c * skew(mu) * skew(e3), Q = c * skew(e3) * skew(mu);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(17, 17);
  expected.block<3, 3>(0, 12) = I;
  expected.block<3, 3>(3, 12) = skew(d1);
  expected.block<3, 3>(6, 12) = -I;
  expected.block<3, 3>(9, 12) = -skew(d2);
  expected.block<3, 3>(12, 0) = -I;
  expected.block<3, 3>(12, 3) = skew(d1);
  expected.block<3, 3>(12, 6) = I;
  expected.block<3, 3>(12, 9) = -skew(d2);
  expected.block<3, 3>(3, 3) = c * skew(F) * skew(d1) - P;
  expected.block<3, 3>(3, 9) = Q;
  expected.block<3, 3>(9, 3) = P;
  expected.block<3, 3>(9, 9) = -c * skew(F) * skew(d2) - Q;
  expected.block<3, 1>(3, 15) = t1;
  expected.block<3, 1>(3, 16) = t2;
  expected.block<3, 1>(9, 15) = -t1;
  expected.block<3, 1>(9, 16) = -t2;
  expected.block<1, 3>(15, 3) = t1.transpose();
  expected.block<1, 3>(15, 9) = -t1.transpose();
  expected.block<1, 3>(16, 3) = -t2.transpose();
  expected.block<1, 3>(16, 9) = t2.transpose();
  same(J, expected);
}

TEST_CASE("revolute pin") {
  Fixture f;
  RevolutePinData pin{1, f.ugly.vector(), f.ugly.rotation(), f.ugly.vector(), f.ugly.rotation(), {}};
  add_joint(f.deck, pin);
  Eigen::VectorXd y;
  const Eigen::MatrixXd J = f.tangent(y);
  const Vec3 d = f.R(1) * pin.d, e3 = pin.R0.col(2), e1 = f.R(1) * pin.Rh.col(0), e2 = f.R(1) * pin.Rh.col(1);
  const Vec3 t1 = e2.cross(e3), t2 = e3.cross(e1), mu = e2 * y(3) - e1 * y(4), F = y.head<3>();
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(17, 17);
  expected.block<3, 3>(6, 12).setIdentity();
  expected.block<3, 3>(9, 12) = skew(d);
  expected.block<3, 3>(9, 9) = c * (skew(F) * skew(d) + skew(e3) * skew(mu));
  expected.block<3, 3>(12, 6) = -Mat3::Identity();
  expected.block<3, 3>(12, 9) = skew(d);
  expected.block<3, 1>(9, 15) = t1;
  expected.block<3, 1>(9, 16) = t2;
  expected.block<1, 3>(15, 9) = -t1.transpose();
  expected.block<1, 3>(16, 9) = t2.transpose();
  same(J, expected);
}

TEST_CASE("cardano hinge") {
  Fixture f;
  CardanoHingeData hinge{0, 1, f.ugly.vector(), f.ugly.vector(), f.ugly.rotation(), f.ugly.rotation()};
  add_joint(f.deck, hinge);
  Eigen::VectorXd y;
  const Eigen::MatrixXd J = f.tangent(y);
  const Vec3 F = y.head<3>(), d1 = f.R(0) * hinge.d1, d2 = f.R(1) * hinge.d2;
  const Vec3 e3 = f.R(0) * hinge.R1h.col(2), e2 = f.R(1) * hinge.R2h.col(1), t = e2.cross(e3), mu = y(3) * e2;
  const Mat3 I = Mat3::Identity(), P = c * skew(mu) * skew(e3), Q = c * skew(e3) * skew(mu);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(16, 16);
  expected.block<3, 3>(0, 12) = I;
  expected.block<3, 3>(3, 12) = skew(d1);
  expected.block<3, 3>(6, 12) = -I;
  expected.block<3, 3>(9, 12) = -skew(d2);
  expected.block<3, 3>(12, 0) = I;
  expected.block<3, 3>(12, 3) = -skew(d1);
  expected.block<3, 3>(12, 6) = -I;
  expected.block<3, 3>(12, 9) = skew(d2);
  expected.block<3, 1>(3, 15) = t;
  expected.block<3, 1>(9, 15) = -t;
  expected.block<1, 3>(15, 3) = t.transpose();
  expected.block<1, 3>(15, 9) = -t.transpose();
  expected.block<3, 3>(3, 3) = c * skew(F) * skew(d1) - P;
  expected.block<3, 3>(3, 9) = Q;
  expected.block<3, 3>(9, 3) = P;
  expected.block<3, 3>(9, 9) = -c * skew(F) * skew(d2) - Q;
  same(J, expected);
}

TEST_CASE("cardano pin") {
  Fixture f;
  CardanoPinData pin{0, f.ugly.vector(), f.ugly.rotation(), f.ugly.vector(), f.ugly.rotation()};
  add_joint(f.deck, pin);
  Eigen::VectorXd y;
  const Eigen::MatrixXd J = f.tangent(y);
  const Vec3 F = y.head<3>(), d = f.R(0) * pin.d, e3 = pin.R0.col(2), e2 = f.R(0) * pin.Rh.col(1), t = e2.cross(e3);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(16, 16);
  expected.block<3, 3>(0, 12) = -Mat3::Identity();
  expected.block<3, 3>(3, 12) = -skew(d);
  expected.block<3, 1>(3, 15) = -t;
  expected.block<3, 3>(3, 3) = -c * (skew(F) * skew(d) + skew(e3) * skew(y(3) * e2));
  expected.block<3, 3>(12, 0) = -Mat3::Identity();
  expected.block<3, 3>(12, 3) = skew(d);
  expected.block<1, 3>(15, 3) = -t.transpose();
  same(J, expected);
}

TEST_CASE("clamp in place, total joint in place") {
  Fixture f;
  add_joint(f.deck, clamp(f.deck, 0));
  Eigen::VectorXd y;
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(18, 18);
  expected.block<6, 6>(0, 12).setIdentity();
  expected.block<6, 6>(12, 0).setIdentity();
  same(f.tangent(y), expected);

  Fixture g;
  TotalJointData joint;
  joint.node1 = 0;
  joint.node2 = 1;
  joint.f1 = g.ugly.vector();
  joint.f2 = g.ugly.vector();
  joint.R1h = joint.R2h = g.ugly.rotation();
  joint.R1hr = g.ugly.rotation();
  joint.R2hr = g.R(1).transpose() * g.R(0) * joint.R1hr;
  joint.position = {TotalComponent::position, TotalComponent::inactive, TotalComponent::position};
  joint.rotation = {TotalComponent::inactive, TotalComponent::position, TotalComponent::inactive};
  add_joint(g.deck, joint);
  const Eigen::MatrixXd J = g.tangent(y);
  const Mat3 R = g.R(0) * joint.R1h, Rr = g.R(0) * joint.R1hr;
  const Vec3 b2 = g.R(1) * joint.f2, b1 = g.deck.nodes[1].x + b2 - g.deck.nodes[0].x;
  const Mat3 Fx = c * skew(R.col(0) * y(0) + R.col(2) * y(1)), Mx = c * skew(Rr.col(1) * y(2));
  expected.setZero(15, 15);
  expected.block<3, 3>(0, 3) = Fx;
  expected.block<3, 3>(6, 3) = -Fx;
  expected.block<3, 3>(3, 0) = -Fx;
  expected.block<3, 3>(3, 6) = Fx;
  expected.block<3, 3>(3, 3) = skew(b1) * Fx + Mx;
  expected.block<3, 3>(3, 9) = -Fx * skew(b2);
  expected.block<3, 3>(9, 3) = -skew(b2) * Fx - Mx;
  expected.block<3, 3>(9, 9) = Fx * skew(b2);
  for (int k = 0; k < 2; ++k) {
    const Vec3 e = R.col(2 * k);
    Eigen::VectorXd border(12);
    border << -e, -b1.cross(e), e, b2.cross(e);
    expected.col(12 + k).head(12) = border;
    expected.row(12 + k).head(12) = border.transpose();
  }
  Eigen::VectorXd border = Eigen::VectorXd::Zero(12);
  border.segment<3>(3) = -Rr.col(1);
  border.segment<3>(9) = Rr.col(1);
  expected.col(14).head(12) = border;
  expected.row(14).head(12) = border.transpose();
  same(J, expected);
}
