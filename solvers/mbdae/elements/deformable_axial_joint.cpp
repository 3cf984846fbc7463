// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/deformable_axial_joint.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

DeformableAxialJoint::DeformableAxialJoint(const DeformableAxialJointData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

void DeformableAxialJoint::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h;
  const Vec3 theta = rotation_log(Ra.transpose() * n2.R * data_.R2h), w21 = n2.w - n1.w, e = Ra.col(2);
  const auto [f, k, d] = evaluate(data_.law, state.t, theta.z(), e.dot(w21));
  add_to_g(eq.g, node1_, Vec3::Zero(), -f * e);
  add_to_g(eq.g, node2_, Vec3::Zero(), f * e);
  if (!tangent) return;

  const Vec3 twist = Ra * rotation_gamma_inverse(theta).row(2).transpose();  // dtheta_3 = twist.(dphi2 - dphi1)
  const Mat3 K = k * e * twist.transpose(), C = d * e * e.transpose();
  const Mat3 by_phi1 = d * e * e.cross(w21).transpose() - K - f * skew(e);  // de = dphi1 x e
  const int M1 = moment_row(node1_), M2 = moment_row(node2_);
  const int g1 = rotation_column(node1_), g2 = rotation_column(node2_);
  add_block(eq.g_y, M1, g1, -by_phi1);
  add_block(eq.g_y, M1, g2, -K);
  add_block(eq.g_y, M2, g1, by_phi1);
  add_block(eq.g_y, M2, g2, K);
  add_block(eq.g_ydot, M1, g1, C);
  add_block(eq.g_ydot, M1, g2, -C);
  add_block(eq.g_ydot, M2, g1, -C);
  add_block(eq.g_ydot, M2, g2, C);
}

namespace reading {

DeformableAxialJointData read_deformable_axial_joint(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return {first.node, second.node, first.orientation, second.orientation, read_spring_law1(context)};
}

}  // namespace reading

}  // namespace mbdae
