// Linear velocity and linear acceleration of a node, imposed along a fixed direction.
//
//   linear velocity:      0 = e.v - d(t)                        g[F] += e f
//   linear acceleration:  0 = e.v - q,  0 = q' - d(t)           g[F] += e f,  q a state
//
// e is a unit vector in global axes, f the reaction [N] that the node exerts along it. Valid in any state. For
// accelerations and the variable-step integration the two equations of the linear acceleration change places: the first
// is the constraint then, the second the state's. Source: MBDyn's joints; tangents exact in both:
// docs/theory/elements.md, test "linear velocity and acceleration" (test_model_scalar.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct LinearVelocityData {
  NodeIndex node;
  Vec3 e;
  DrivePtr drive;  ///< [m/s]
};

struct LinearAccelerationData {
  NodeIndex node;
  Vec3 e;
  DrivePtr drive;  ///< [m/s^2]

  static int scalars() { return 1; }
};

class LinearMotion final : public Constraint {
 public:
  LinearMotion(const LinearVelocityData& data, const Numbering& numbering);
  LinearMotion(const LinearAccelerationData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override {
    assemble(state, eq, tangent, q_, first_);
  }
  void assemble_reduced(const State& state, Equations& eq, bool tangent) const override {
    assemble(state, eq, tangent, first_, q_);
  }
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool velocity_level(int /*k*/) const override { return true; }
  bool is_couple(int /*k*/) const override { return false; }
  std::vector<ScalarInfo> scalars() const override;
  void initialise(State& state) const override;

 private:
  /// `constraint`: row of e.v - q; `definition`: row of q' - d.
  void assemble(const State& state, Equations& eq, bool tangent, int constraint, int definition) const;

  NodeSlot node_;
  Vec3 e_;
  DrivePtr drive_;
  int q_ = -1;  ///< -1: a velocity is imposed
};

namespace reading {

LinearVelocityData read_linear_velocity(Context& context);
LinearAccelerationData read_linear_acceleration(Context& context);

}  // namespace reading

}  // namespace mbdae
