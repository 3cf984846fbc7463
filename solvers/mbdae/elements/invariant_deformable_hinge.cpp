// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/invariant_deformable_hinge.h"

#include "mbdae/deck/law_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

InvariantDeformableHinge::InvariantDeformableHinge(const InvariantDeformableHingeData& data, const Numbering& numbering)
    : data_(data), node1_(numbering.slot(data.node1)), node2_(numbering.slot(data.node2)) {}

void InvariantDeformableHinge::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Mat3 Ra = n1.R * data_.R1h;
  const Vec3 theta = rotation_log(Ra.transpose() * n2.R * data_.R2h), w21 = n2.w - n1.w, half = 0.5 * theta;
  const Mat3 Rh = Ra * rotation_exp(half);
  const LawValue<3> law = evaluate(data_.law, state.t, theta, Rh.transpose() * w21);
  const Vec3 M = Rh * law.f;
  add_to_g(eq.g, node1_, Vec3::Zero(), -M);
  add_to_g(eq.g, node2_, Vec3::Zero(), M);
  if (!tangent) return;

  // dtheta = T (dphi2 - dphi1); Rh turns by dphi1 + H (dphi2 - dphi1), H = Ra Gamma(theta/2)/2 T
  const Mat3 T = rotation_gamma_inverse(theta) * Ra.transpose(), H = 0.5 * Ra * rotation_gamma(half) * T;
  const Mat3 C = Rh * law.C * Rh.transpose();
  const Mat3 by_turn = C * skew(w21) - skew(M);  // of Rh
  const Mat3 by_phi2 = Rh * law.K * T + by_turn * H, by_phi1 = by_turn - by_phi2;
  const int M1 = moment_row(node1_), M2 = moment_row(node2_);
  const int g1 = rotation_column(node1_), g2 = rotation_column(node2_);
  add_block(eq.g_y, M1, g1, -by_phi1);
  add_block(eq.g_y, M1, g2, -by_phi2);
  add_block(eq.g_y, M2, g1, by_phi1);
  add_block(eq.g_y, M2, g2, by_phi2);
  add_block(eq.g_ydot, M1, g1, C);
  add_block(eq.g_ydot, M1, g2, -C);
  add_block(eq.g_ydot, M2, g1, -C);
  add_block(eq.g_ydot, M2, g2, C);
}

namespace reading {

InvariantDeformableHingeData read_invariant_deformable_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return {first.node, second.node, first.orientation, second.orientation, read_law3(context)};
}

}  // namespace reading

}  // namespace mbdae
