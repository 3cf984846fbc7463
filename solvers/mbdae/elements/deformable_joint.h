// Deformable joint: force and couple as functions of relative displacement and rotation and their rates (6 x 6 law).
//
//   Ra = R1 R1h,  d2 = R2 f2,  d1 = x2 + d2 - x1                the point of node 2 from node 2 and from node 1
//   strain = [Ra^T (d1 - R1 f1);  log(Ra^T R2 R2h)]
//   rate   = [Ra^T (v2 + w2 x d2 - v1 - w1 x d1);  Ra^T (w2 - w1)]
//   (F; M) = Ra f(strain, rate),  f = prestress + K (strain - prestrain) + C rate
//   g[F1] -= F,  g[M1] -= M + d1 x F,  g[F2] += F,  g[M2] += M + d2 x F
//
// It owns no unknowns; (F, M) acts on node 1 at node 2's point, the opposite on node 2. A spring below node 2 that
// carries a weight W has the prestress (0, 0, -W). Valid for a relative rotation below pi. Source: MBDyn's joint.
// Tangent exact in any state (MBDyn's lacks the inverse of Gamma before its first step, docs/conventions.md):
// docs/theory/elements.md; test "deformable hinges and joint at large relative rotation" (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct DeformableJointData {
  NodeIndex node1, node2;
  Vec3 f1, f2;
  Mat3 R1h, R2h;
  Law6 law;
};

class DeformableJoint final : public Element {
 public:
  DeformableJoint(const DeformableJointData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  DeformableJointData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

DeformableJointData read_deformable_joint(Context& context);

}  // namespace reading

}  // namespace mbdae
