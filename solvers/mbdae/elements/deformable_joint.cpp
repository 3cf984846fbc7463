// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/deformable_joint.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

DeformableJoint::DeformableJoint(const DeformableJointData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

void DeformableJoint::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h, RaT = Ra.transpose();
  const Vec3 d2 = n2.R * data_.f2, d1 = n2.x + d2 - n1.x;
  const Vec3 u = n2.v + n2.w.cross(d2) - n1.v - n1.w.cross(d1), w21 = n2.w - n1.w;
  Vec6 strain, rate;
  strain << RaT * (d1 - n1.R * data_.f1), rotation_log(RaT * n2.R * data_.R2h);
  rate << RaT * u, RaT * w21;
  const LawValue<6> law = std::visit([&](const auto& l) { return evaluate(l, state.t, strain, rate); }, data_.law);
  const Vec3 F = Ra * law.f.head<3>(), M = Ra * law.f.tail<3>();
  add_to_g(eq.g, node1_, -F, -M - d1.cross(F));
  add_to_g(eq.g, node2_, F, M + d2.cross(F));
  if (!tangent) return;

  // Strain and strain rate by the variations of node 1 (dx1, dphi1) and node 2, then global force and moment.
  using Mat612 = Eigen::Matrix<double, 6, 12>;
  const Mat3 d1x = skew(d1), d2x = skew(d2), w1x = skew(n1.w), zero = Mat3::Zero();
  const Mat3 twist = rotation_gamma_inverse(strain.tail<3>()) * RaT;
  Mat612 strain_q, rate_q, rate_qdot;
  strain_q << -RaT, RaT * d1x, RaT, -RaT * d2x,  //
      zero, -twist, zero, twist;
  rate_q << RaT * w1x, RaT * skew(u), -RaT * w1x, RaT * (w1x * d2x - skew_skew(n2.w, d2)),  //
      zero, RaT * skew(w21), zero, zero;
  rate_qdot << -RaT, RaT * d1x, RaT, -RaT * d2x,  //
      zero, -RaT, zero, RaT;
  Mat6 frame = Mat6::Zero();
  frame.topLeftCorner<3, 3>() = Ra;
  frame.bottomRightCorner<3, 3>() = Ra;
  Mat612 wrench_q = frame * (law.K * strain_q + law.C * rate_q);
  const Mat612 wrench_qdot = frame * law.C * rate_qdot;
  wrench_q.block<3, 3>(0, 3) -= skew(F);
  wrench_q.block<3, 3>(3, 3) -= skew(M);

  // Node 1 gets -(F, M + d1 x F), node 2 gets +(F, M + d2 x F).
  const NodeSlot* nodes[2] = {&node1_, &node2_};
  const Mat3* arms[2] = {&d1x, &d2x};
  for (int i = 0; i < 2; ++i) {
    if (nodes[i]->force < 0) continue;
    const double s = i == 0 ? -1.0 : 1.0;
    Mat612 rows_q = wrench_q, rows_qdot = wrench_qdot;
    rows_q.bottomRows<3>() += *arms[i] * wrench_q.topRows<3>();
    rows_qdot.bottomRows<3>() += *arms[i] * wrench_qdot.topRows<3>();
    // variation of the arm: d(d1) = dx2 - d2 x dphi2 - dx1, d(d2) = -d2 x dphi2
    const Mat3 Fx = skew(F);
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

DeformableJointData read_deformable_joint(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  return DeformableJointData{first.node,        second.node,        first.position,    second.position,
                             first.orientation, second.orientation, read_law6(context)};
}

}  // namespace reading

}  // namespace mbdae
