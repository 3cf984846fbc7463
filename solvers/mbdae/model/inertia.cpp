// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/inertia.h"

namespace mbdae {

NodeInertia::NodeInertia(const NodeSlot& node, const std::vector<const BodyData*>& bodies,
                         const VectorDrive<3>* gravity)
    : node_(node), gravity_(gravity) {
  for (const BodyData* body : bodies) {
    m_ += body->m;
    S_ += body->m * body->d;
    J_ += body->J_cm - body->m * skew_skew(body->d, body->d);
  }
}

Vec6 NodeInertia::momentum(const NodeMotion& motion) const {
  const Vec3 S = motion.R * S_;
  Vec6 out;
  out << m_ * motion.v + motion.w.cross(S), S.cross(motion.v) + motion.R * (J_ * (motion.R.transpose() * motion.w));
  return out;
}

Mat6 NodeInertia::mass_matrix(const NodeMotion& motion) const {
  const Mat3 Sx = skew(motion.R * S_);
  Mat6 out;
  out << m_ * Mat3::Identity(), -Sx, Sx, motion.R * J_ * motion.R.transpose();
  return out;
}

Vec6 NodeInertia::velocity_terms(const NodeMotion& motion) const {
  const Vec3 S = motion.R * S_, wS = motion.w.cross(S);
  const Vec3 Jw = motion.R * (J_ * (motion.R.transpose() * motion.w));
  Vec6 out;
  out << motion.w.cross(wS), motion.w.cross(Jw);
  return out;
}

void NodeInertia::inertia_derivatives(const NodeMotion& motion, const Vec6& acceleration,
                                      Eigen::Matrix<double, 6, 3>& by_phi, Eigen::Matrix<double, 6, 3>& by_w) const {
  // force: m a + wdot x S + w x (w x S); moment: S x a + J wdot + w x (J w)
  const Vec3 S = motion.R * S_, a = acceleration.head<3>(), alpha = acceleration.tail<3>();
  const Vec3& w = motion.w;
  const Mat3 J = motion.R * J_ * motion.R.transpose(), Sx = skew(S), wx = skew(w), Jwx = skew(J * w);
  by_phi.topRows<3>() = -(skew(alpha) + wx * wx) * Sx;
  by_phi.bottomRows<3>() = skew_skew(a, S) - skew(J * alpha) + J * skew(alpha) + wx * (J * wx - Jwx);
  by_w.topRows<3>() = -skew(w.cross(S)) - wx * Sx;
  by_w.bottomRows<3>() = wx * J - Jwx;
}

void NodeInertia::assemble_gravity(const State& state, Equations& eq, bool tangent) const {
  if (gravity_ == nullptr || node_.force < 0 || m_ == 0.0) return;
  const NodeMotion& n = motion_of(state, node_);
  const Vec3 S = n.R * S_, a = gravity_->at(state.t);
  add_to_g(eq.g, node_, -m_ * a, -S.cross(a));
  if (tangent) add_block(eq.g_y, node_.force + 3, node_.first + 3, -skew_skew(a, S));
}

void NodeInertia::assemble(const State& state, Equations& eq, bool tangent) const {
  if (node_.modal) assemble_modal(state, eq, tangent);
  if (!node_.dynamic) return;
  const NodeMotion& n = motion_of(state, node_);
  const int x = node_.first, beta = x + 6;
  const Vec3 S = n.R * S_;
  const Mat3 J = n.R * J_ * n.R.transpose();
  const Vec3 Jw = J * n.w;
  const Vec3 b = state.y.segment<3>(beta), h = state.y.segment<3>(beta + 3);
  eq.g.segment<3>(x) += m_ * n.v + n.w.cross(S) - b;
  eq.g.segment<3>(x + 3) += S.cross(n.v) + Jw - h;
  eq.g.segment<3>(beta) += state.ydot.segment<3>(beta);
  eq.g.segment<3>(beta + 3) += state.ydot.segment<3>(beta + 3) + n.v.cross(b);
  if (!tangent) return;

  const Mat3 I = Mat3::Identity(), Sx = skew(S);
  eq.g_ydot.block<3, 3>(x, x) += m_ * I;
  eq.g_ydot.block<3, 3>(x, x + 3) -= Sx;
  eq.g_ydot.block<3, 3>(x + 3, x) += Sx;
  eq.g_ydot.block<3, 3>(x + 3, x + 3) += J;
  if (!n.w.isZero(0.0) || !n.v.isZero(0.0)) {
    eq.g_y.block<3, 3>(x, x + 3) -= skew_skew(n.w, S);
    eq.g_y.block<3, 3>(x + 3, x + 3) += skew_skew(n.v, S) - skew(Jw) + J * skew(n.w);
    eq.g_y.block<3, 3>(beta + 3, beta) += skew(n.v);
  }
  eq.g_y.block<3, 3>(x, beta) -= I;
  eq.g_y.block<3, 3>(x + 3, beta + 3) -= I;
  eq.g_ydot.block<3, 3>(beta, beta) += I;
  eq.g_ydot.block<3, 3>(beta + 3, beta + 3) += I;
  eq.g_ydot.block<3, 3>(beta + 3, x) -= skew(b);
}

void NodeInertia::assemble_modal(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n = motion_of(state, node_);
  const int x = node_.first, v = node_.force;
  eq.g.segment<3>(x) += n.v - state.y.segment<3>(v);
  eq.g.segment<3>(x + 3) += n.w - state.y.segment<3>(v + 3);
  if (tangent) {
    eq.g_ydot.block<6, 6>(x, x).diagonal().array() += 1.0;
    eq.g_y.block<6, 6>(x, v).diagonal().array() -= 1.0;
  }
  if (empty()) return;
  NodeMotion motion = n;  // with the velocities that are unknowns
  motion.v = state.y.segment<3>(v);
  motion.w = state.y.segment<3>(v + 3);
  const Vec6 acceleration = state.ydot.segment<6>(v);
  const Mat6 M = mass_matrix(motion);
  eq.g.segment<6>(v) += M * acceleration + velocity_terms(motion);
  if (!tangent) return;
  Eigen::Matrix<double, 6, 3> by_phi, by_w;
  inertia_derivatives(motion, acceleration, by_phi, by_w);
  eq.g_ydot.block<6, 6>(v, v) += M;
  eq.g_y.block<6, 3>(v, x + 3) += by_phi;
  eq.g_y.block<6, 3>(v, v + 3) += by_w;
}

}  // namespace mbdae
