// Applied forces and couples, absolute or follower.
//
//   a = R arm
//   absolute force:   g[F] -= f,  g[M] -= a x f          f(t) in global axes
//   follower force:   the same with f = R f~(t)
//   couples:          g[M] -= m,  m(t) global or R m~(t)
//
// They own no unknowns; f and m act on the node (g is minus the sum of forces). Valid in any state. Source: MBDyn's
// forces and couples. Tangent: docs/theory/elements.md; test "forces and couples" (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

enum class ForceFrame { absolute, follower };

struct ForceData {
  ForceFrame frame = ForceFrame::absolute;
  bool couple = false;
  NodeIndex node = 0;
  Vec3 arm = Vec3::Zero();  ///< in the node frame [m]; unused by couples
  VectorDrive<3> value;     ///< [N] or [N m]
};

class AppliedForce final : public Element {
 public:
  AppliedForce(const ForceData& data, const Numbering& numbering) : data_(data), node_(numbering.slot(data.node)) {}
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  ForceData data_;
  NodeSlot node_;
};

namespace reading {

ForceData read_absolute_force(Context& context);
ForceData read_follower_force(Context& context);
ForceData read_absolute_couple(Context& context);
ForceData read_follower_couple(Context& context);

}  // namespace reading

}  // namespace mbdae
