// Invariant deformable hinge: a deformable hinge whose law is written in the frame half way between its nodes.
//
//   Ra = R1 R1h,  theta = log(Ra^T R2 R2h),  Rh = Ra exp(theta/2 x)
//   m = Rh f(theta, Rh^T (w2 - w1))
//   g[M1] -= m,  g[M2] += m
//
// It owns no unknowns; the couple m acts on node 1, -m on node 2. With an isotropic law it makes no difference which
// node comes first. Valid for |theta| < pi. Source: MBDyn's joint; rotation vectors of model/rotation.h. Tangent exact
// in any state: docs/theory/elements.md; test "deformable hinges and joint at large relative rotation"
// (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct InvariantDeformableHingeData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
  Law3 law;
};

class InvariantDeformableHinge final : public Element {
 public:
  InvariantDeformableHinge(const InvariantDeformableHingeData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  InvariantDeformableHingeData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

InvariantDeformableHingeData read_invariant_deformable_hinge(Context& context);

}  // namespace reading

}  // namespace mbdae
