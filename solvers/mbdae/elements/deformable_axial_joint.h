// Deformable axial joint: a couple about axis 3 of node 1's frame as a function of the rotation about it and its rate.
//
//   Ra = R1 R1h,  theta = log(Ra^T R2 R2h),  e = Ra e3
//   m = e f(theta_3, e.(w2 - w1))
//   g[M1] -= m,  g[M2] += m
//
// It owns no unknowns; the couple m acts on node 1, -m on node 2. Meant to stand beside a revolute hinge on the same
// axis; elsewhere theta_3 is the third component of the rotation vector. Valid for |theta| < pi. Source: MBDyn's joint.
// Tangent exact in any state; MBDyn's takes dtheta_3 for e.(dphi2 - dphi1), which it is only for rotations about the
// axis: docs/theory/elements.md, docs/conventions.md; test "deformable hinges and joint at large relative rotation"
// (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct DeformableAxialJointData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
  Law1 law;
};

class DeformableAxialJoint final : public Element {
 public:
  DeformableAxialJoint(const DeformableAxialJointData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  DeformableAxialJointData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

DeformableAxialJointData read_deformable_axial_joint(Context& context);

}  // namespace reading

}  // namespace mbdae
