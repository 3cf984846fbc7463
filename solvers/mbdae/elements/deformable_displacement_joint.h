// Deformable displacement joint: a force as a function of the relative displacement of two points and its rate.
//
//   Ra = R1 R1h,  d2 = R2 f2,  d1 = x2 + d2 - x1                the point of node 2 from node 2 and from node 1
//   strain = Ra^T (d1 - R1 f1),  rate = Ra^T u,  u = v2 + w2 x d2 - v1 - w1 x d1
//   F = Ra f(strain, rate),  f = prestress + K (strain - prestrain) + C rate  or cubic
//   g[F1] -= F,  g[M1] -= d1 x F,  g[F2] += F,  g[M2] += d2 x F
//
// It owns no unknowns; F acts on node 1 at node 2's point, -F on node 2. The orientation on node 2 has no effect. Valid
// in any state. Source: MBDyn's joint. Tangent exact in any state; MBDyn's lacks, for viscous and viscoelastic laws,
// every term with F itself (the arms and the turning frame): docs/theory/elements.md, docs/conventions.md; test
// "deformable hinges and joint at large relative rotation" (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct DeformableDisplacementJointData {
  NodeIndex node1, node2;
  Vec3 f1, f2;
  Mat3 R1h;
  Law3 law;
};

class DeformableDisplacementJoint final : public Element {
 public:
  DeformableDisplacementJoint(const DeformableDisplacementJointData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  DeformableDisplacementJointData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

DeformableDisplacementJointData read_deformable_displacement_joint(Context& context);

}  // namespace reading

}  // namespace mbdae
