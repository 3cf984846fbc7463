// Elements that own no unknowns but connect two nodes: rods (muscles included) and deformable hinges and joints.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mbdae/model/element.h"
#include "mbdae/model/law.h"

namespace mbdae {

/// A force along the line between two points, as a function of its strain and strain rate.
class Rod final : public Element {
 public:
  Rod(const RodData& data, const NodeSlot& node1, const NodeSlot& node2);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

  /// Length at the state [m].
  double length(const State& state) const;

  bool is_muscle() const { return std::holds_alternative<MuscleLaw>(data_.law); }

  /// The muscle's inner values; the rod's law must be a muscle.
  MuscleValue muscle(const State& state) const;

  /// Adds the derivative of g with respect to the activation drive of the muscle, whose values these are, to a column.
  void add_activation_derivative(const State& state, const MuscleValue& muscle,
                                 Eigen::Ref<Eigen::VectorXd> column) const;

  /// True if the points coincide: no direction, no force.
  bool collapsed(const State& state) const;

 private:
  struct Geometry {
    Vec3 f1, f2, u, udot;  // arms, point 2 from point 1 and its rate
    double l, eps, eps_rate;
  };
  struct Scalar {
    double f, k, d;
  };
  Geometry geometry(const State& state) const;
  Scalar law(double t, double eps, double eps_rate) const;

  RodData data_;
  NodeSlot node1_, node2_;
};

/// A couple as a function of the relative rotation vector and relative angular velocity.
class DeformableHinge final : public Element {
 public:
  DeformableHinge(const DeformableHingeData& data, const NodeSlot& node1, const NodeSlot& node2);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  DeformableHingeData data_;
  NodeSlot node1_, node2_;
};

/// Force and couple as functions of relative displacement and rotation and their rates.
class DeformableJoint final : public Element {
 public:
  DeformableJoint(const DeformableJointData& data, const NodeSlot& node1, const NodeSlot& node2);
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  DeformableJointData data_;
  NodeSlot node1_, node2_;
};

}  // namespace mbdae
