// Spherical, revolute and cardano joints: coincident points and orthogonal axes.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mbdae/model/element.h"

namespace mbdae {

class Hinge final : public Constraint {
 public:
  /// Slots of node 1 and node 2; a pin has the ground (default slot) as node 2. `first` = first reaction.
  Hinge(const SphericalHingeData& data, const NodeSlot& node1, const NodeSlot& node2, int first);
  Hinge(const SphericalPinData& data, const NodeSlot& node, int first);
  Hinge(const RevoluteHingeData& data, const NodeSlot& node1, const NodeSlot& node2, int first);
  Hinge(const RevolutePinData& data, const NodeSlot& node, int first);
  Hinge(const CardanoHingeData& data, const NodeSlot& node1, const NodeSlot& node2, int first);
  Hinge(const CardanoPinData& data, const NodeSlot& node, int first);

  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool is_couple(int k) const override { return k >= 3; }

 private:
  /// Axis a on one node stays orthogonal to axis b on another; its reaction M is the couple sign_couple * M * (b x a).
  struct Axis {
    NodeSlot node_a, node_b;
    Vec3 a, b;           ///< in their nodes
    double couple_sign;  ///< of the couple on node a's equilibrium rows; node b gets the opposite
  };

  void set_points(const NodeSlot& node1, const Vec3& d1, const NodeSlot& node2, const Vec3& d2, int first);
  void add_axis(const NodeSlot& node_a, const Vec3& a, const NodeSlot& node_b, const Vec3& b, double couple_sign);

  NodeSlot node1_, node2_;
  Vec3 d1_, d2_;  ///< hinge point in node 1, 2
  double point_row_sign_ = -1.0;
  double force_sign_ = 1.0;  ///< of F on node 1's equilibrium rows
  std::vector<Axis> axes_;
};

}  // namespace mbdae
