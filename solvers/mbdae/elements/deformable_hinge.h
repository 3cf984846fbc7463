// Deformable hinge: a couple as a function of the relative rotation vector and the relative angular velocity.
//
//   Ra = R1 R1h,  theta = log(Ra^T R2 R2h),  om = Ra^T (w2 - w1)
//   m = Ra f(theta, om),  f = prestress + K (theta - prestrain) + C om  or cubic
//   g[M1] -= m,  g[M2] += m
//
// It owns no unknowns; the couple m acts on node 1, -m on node 2. Valid for |theta| < pi. The positions that its card
// may name have no effect. Source: rotation vectors and their tangent map Gamma (model/rotation.h). Tangent exact in
// any state: docs/theory/elements.md; test "deformable hinges and joint at large relative rotation"
// (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct DeformableHingeData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
  Law3 law;

  static constexpr const char* kSignals[] = {"rx", "ry", "rz", "wx", "wy", "wz", "Mx", "My", "Mz"};
};

class DeformableHinge final : public Element {
 public:
  DeformableHinge(const DeformableHingeData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  SignalValue signal(int k, const State& state) const override;

 private:
  DeformableHingeData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

DeformableHingeData read_deformable_hinge(Context& context);

}  // namespace reading

}  // namespace mbdae
