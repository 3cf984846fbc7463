// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/deformable_displacement_joint.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

DeformableDisplacementJoint::DeformableDisplacementJoint(const DeformableDisplacementJointData& data,
                                                         const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

void DeformableDisplacementJoint::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h, RaT = Ra.transpose();
  const Vec3 d2 = n2.R * data_.f2, d1 = n2.x + d2 - n1.x;
  const Vec3 u = n2.v + n2.w.cross(d2) - n1.v - n1.w.cross(d1);
  const LawValue<3> law = evaluate(data_.law, state.t, RaT * (d1 - n1.R * data_.f1), RaT * u);
  const Vec3 F = Ra * law.f;
  add_to_g(eq.g, node1_, -F, -d1.cross(F));
  add_to_g(eq.g, node2_, F, d2.cross(F));
  if (!tangent) return;

  // dF by the variations of node 1 (dx1, dphi1) and node 2: strain, rate, and the frame that turns with node 1
  using Mat312 = Eigen::Matrix<double, 3, 12>;
  const Mat3 K = Ra * law.K * RaT, C = Ra * law.C * RaT;
  const Mat3 d1x = skew(d1), d2x = skew(d2), w1x = skew(n1.w), Fx = skew(F);
  Mat312 by_q, by_qdot;
  by_q << -K + C * w1x, K * d1x + C * skew(u) - Fx, K - C * w1x, -K * d2x + C * (w1x * d2x - skew_skew(n2.w, d2));
  by_qdot << -C, C * d1x, C, -C * d2x;

  const NodeSlot* nodes[2] = {&node1_, &node2_};
  const Mat3* arms[2] = {&d1x, &d2x};
  for (int i = 0; i < 2; ++i) {
    if (nodes[i]->force < 0) continue;
    const double s = i == 0 ? -1.0 : 1.0;
    Eigen::Matrix<double, 6, 12> rows_q, rows_qdot;
    rows_q << by_q, *arms[i] * by_q;
    rows_qdot << by_qdot, *arms[i] * by_qdot;
    // variation of the arm: d(d1) = dx2 - d2 x dphi2 - dx1, d(d2) = -d2 x dphi2
    rows_q.block<3, 3>(3, 9) += Fx * d2x;
    if (i == 0) {
      rows_q.block<3, 3>(3, 0) += Fx;
      rows_q.block<3, 3>(3, 6) -= Fx;
    }
    for (int j = 0; j < 2; ++j) {
      if (nodes[j]->first < 0) continue;
      const int column = 6 * j;
      eq.g_y.block<6, 6>(nodes[i]->force, nodes[j]->first) += s * rows_q.middleCols<6>(column);
      eq.g_ydot.block<6, 6>(nodes[i]->force, nodes[j]->first) += s * rows_qdot.middleCols<6>(column);
    }
  }
}

namespace reading {

DeformableDisplacementJointData read_deformable_displacement_joint(Context& context) {
  const auto [first, second] = read_two_plain_ends(context);
  return {first.node, second.node, first.position, second.position, first.orientation, read_law3(context)};
}

}  // namespace reading

}  // namespace mbdae
