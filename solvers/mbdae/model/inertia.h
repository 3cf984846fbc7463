// Inertia and gravity of the bodies on a node.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mbdae/model/element.h"

namespace mbdae {

/// All bodies of one node: momentum definitions, inertia forces, gravity.
class NodeInertia final : public Element {
 public:
  NodeInertia(const NodeSlot& node, const std::vector<const BodyData*>& bodies, const VectorDrive<3>* gravity);

  /// Momentum form of a dynamic node: definitions of beta and gamma, betadot, gammadot + v x beta. Of a modal node:
  /// definitions of v and w, inertia forces.
  void assemble(const State& state, Equations& eq, bool tangent) const override;

  /// Weight.
  void assemble_gravity(const State& state, Equations& eq, bool tangent) const;

  /// Momentum and momenta moment about the node at the given motion [kg m/s, kg m^2/s].
  Vec6 momentum(const NodeMotion& motion) const;

  /// Mass matrix about the node: derivative of the momenta with respect to (v, w).
  Mat6 mass_matrix(const NodeMotion& motion) const;

  /// Inertia force and moment about the node with accelerations zero: the velocity terms.
  Vec6 velocity_terms(const NodeMotion& motion) const;

  /// Derivatives of mass_matrix * acceleration + velocity_terms with respect to dphi and dw (6 x 3 each).
  void inertia_derivatives(const NodeMotion& motion, const Vec6& acceleration, Eigen::Matrix<double, 6, 3>& by_phi,
                           Eigen::Matrix<double, 6, 3>& by_w) const;

  const NodeSlot& slot() const { return node_; }
  double mass() const { return m_; }
  bool empty() const { return m_ == 0.0 && J_.isZero(0.0); }

 private:
  void assemble_modal(const State& state, Equations& eq, bool tangent) const;

  NodeSlot node_;
  double m_ = 0.0;
  Vec3 S_ = Vec3::Zero();  ///< static moment in the node frame [kg m]
  Mat3 J_ = Mat3::Zero();  ///< inertia about the node, node axes [kg m^2]
  const VectorDrive<3>* gravity_;
};

}  // namespace mbdae
