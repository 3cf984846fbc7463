// Distance joint: two points keep an imposed distance.
//
//   f1 = R1 f1~,  f2 = R2 f2~,  D = x2 + f2 - x1 - f1
//   0 = D - d(t) u,  0 = |u| - 1            u the direction from point 1 to point 2
//   g[F1] -= u f,  g[M1] -= f1 x u f,  g[F2] += u f,  g[M2] += f2 x u f
//
// Four unknowns of its own: u (algebraic) and the force f [N], positive in tension, as MBDyn has them. Valid for d > 0.
// For accelerations and the variable-step integration the same joint is 0 = |D| - d(t) beside u = D/d. Source: MBDyn's
// joint; tangent exact in both: docs/theory/elements.md, test "distance joint" (test_model_scalar.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct DistanceData {
  NodeIndex node1, node2;
  Vec3 f1 = Vec3::Zero(), f2 = Vec3::Zero();
  DrivePtr distance;  ///< [m]

  static int scalars() { return 3; }
};

class Distance final : public Constraint {
 public:
  Distance(const DistanceData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override { assemble(state, eq, tangent, false); }
  void assemble_reduced(const State& state, Equations& eq, bool tangent) const override {
    assemble(state, eq, tangent, true);
  }
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool is_couple(int /*k*/) const override { return false; }
  bool plain_equation(int /*k*/) const override { return true; }
  std::vector<ScalarInfo> scalars() const override;
  void initialise(State& state) const override;
  std::string defect(const State& state) const override;

 private:
  struct Geometry;
  Geometry geometry(const State& state) const;
  void assemble(const State& state, Equations& eq, bool tangent, bool reduced) const;

  DistanceData data_;
  NodeSlot node1_, node2_;
  int u_;  ///< first component of the direction
};

namespace reading {

DistanceData read_distance(Context& context);
/// The old card: offsets are required, the word `position` before them is not.
DistanceData read_distance_with_offset(Context& context);

}  // namespace reading

}  // namespace mbdae
