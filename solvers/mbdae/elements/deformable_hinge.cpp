// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/deformable_hinge.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

DeformableHinge::DeformableHinge(const DeformableHingeData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

void DeformableHinge::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h;
  const Vec3 theta = rotation_log(Ra.transpose() * n2.R * data_.R2h), w21 = n2.w - n1.w;
  const Vec3 rate = Ra.transpose() * w21;
  const LawValue<3> law = evaluate(data_.law, state.t, theta, rate);
  const Vec3 M = Ra * law.f;
  add_to_g(eq.g, node1_, Vec3::Zero(), -M);
  add_to_g(eq.g, node2_, Vec3::Zero(), M);
  if (!tangent) return;

  const Mat3 K = Ra * law.K * rotation_gamma_inverse(theta) * Ra.transpose(), C = Ra * law.C * Ra.transpose();
  const Mat3 by_phi1 = C * skew(w21) - K - skew(M);
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

SignalValue DeformableHinge::signal(int k, const State& state) const {
  // theta, its rate and the couple, all in node 1's frame
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h;
  const Vec3 theta = rotation_log(Ra.transpose() * n2.R * data_.R2h), w21 = n2.w - n1.w;
  const Vec3 om = Ra.transpose() * w21;
  const Mat3 twist = rotation_gamma_inverse(theta) * Ra.transpose();  // dtheta = twist (dphi2 - dphi1)
  const LawValue<3> law = evaluate(data_.law, state.t, theta, om);
  const Mat3 turning = Ra.transpose() * skew(w21);  // dom = Ra^T (dw2 - dw1) + turning dphi1
  const int group = k / 3, i = k % 3;
  SignalValue out;
  Vec3 by_phi1 = Vec3::Zero(), by_phi2 = Vec3::Zero(), by_w = Vec3::Zero();
  if (group == 0) {
    out.value = theta(i);
    out.rate = twist.row(i).dot(w21);
    by_phi2 = twist.row(i).transpose();
    by_phi1 = -by_phi2;
  } else if (group == 1) {
    out.value = om(i);
    by_phi1 = turning.row(i).transpose();
    by_w = Ra.col(i);
  } else {
    out.value = law.f(i);
    by_phi2 = (law.K.row(i) * twist).transpose();
    by_phi1 = (law.C.row(i) * turning).transpose() - by_phi2;
    by_w = (law.C.row(i) * Ra.transpose()).transpose();
  }
  for (int j = 0; j < 3; ++j) {
    if (rotation_column(node1_) >= 0) out.gradient.push_back({rotation_column(node1_) + j, by_phi1(j), -by_w(j)});
    if (rotation_column(node2_) >= 0) out.gradient.push_back({rotation_column(node2_) + j, by_phi2(j), by_w(j)});
  }
  return out;
}

namespace reading {

DeformableHingeData read_deformable_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return DeformableHingeData{first.node, second.node, first.orientation, second.orientation, read_law3(context)};
}

}  // namespace reading

}  // namespace mbdae
