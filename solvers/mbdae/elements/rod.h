// Rod: a force along the line between two points, a function of its strain and strain rate. A muscle is a rod whose law
// is a muscle's.
//
//   f1 = R1 f1~, f2 = R2 f2~                      arms, zero without `position`
//   u = x2 + f2 - x1 - f1,  l = |u|,  n = u/l     from point 1 to point 2
//   eps = l/L0 - 1,  epsdot = n.udot/L0           strain, strain rate
//   F = f(eps, epsdot) n                          tension is positive
//   g[F1] -= F,  g[M1] -= f1 x F,  g[F2] += F,  g[M2] += f2 x F
//
// It owns no unknowns; tension pulls node 1 towards point 2 and node 2 towards point 1 (g is minus the sum of forces).
// In a linear law k is a force per unit strain: the stiffness along the rod is k/L0. Valid while l > 0; ends that
// coincide are refused, as there is no direction. Source of the muscle's curves: Pennestri et al. (2007), as MBDyn's
// module-muscles has them (model/law.h). Tangent: docs/theory/elements.md; tests "rods: linear, cubic, with and without
// offsets" and "muscles: every variant of the law" (test_model_tangent.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct RodData {
  NodeIndex node1, node2;
  Vec3 f1 = Vec3::Zero(), f2 = Vec3::Zero();
  double L0 = 0.0;  ///< reference length [m]; `from nodes` is resolved by the reader
  Law1 law;

  const char* counts_as() const { return std::holds_alternative<MuscleLaw>(law) ? "muscles" : "rods"; }
};

class Rod final : public Element, public Muscle {
 public:
  Rod(const RodData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  int rank() const override { return 0; }
  std::string defect(const State& state) const override;

  /// Null unless the law is a muscle's, as it must be for what follows.
  const Muscle* muscle() const override { return std::holds_alternative<MuscleLaw>(data_.law) ? this : nullptr; }
  double length(const State& state) const override;
  MuscleValue value(const State& state) const override;
  void add_activation_derivative(const State& state, const MuscleValue& value,
                                 Eigen::Ref<Eigen::VectorXd> column) const override;

 private:
  struct Geometry {
    Vec3 f1, f2, u, udot;  // arms, point 2 from point 1 and its rate
    double l, eps, eps_rate;
  };
  Geometry geometry(const State& state) const;

  RodData data_;
  NodeSlot node1_, node2_;
};

namespace reading {

RodData read_rod(Context& context);
/// The old card: offsets are required, the word `position` before them is not.
RodData read_rod_with_offset(Context& context);

}  // namespace reading

}  // namespace mbdae
