// The constraints of a modal joint at its interfaces.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/modal_joint.h"

namespace mbdae {

namespace {

/// Axial vector of a matrix: sin(angle) n of a rotation. Linear.
Vec3 axial(const Mat3& A) { return 0.5 * Vec3(A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1)); }

}  // namespace

/// Of the interface node against the body.
struct ModalJoint::Turn {
  Mat3 R2T, N, A;  // transposed axes of the interface node, R2^T R, R2^T R (1 + (Q a) x)
};

ModalJoint::Turn ModalJoint::turn(const State& state, std::size_t i) const {
  Turn out;
  out.R2T = motion_of(state, ends_[i]).R.transpose();
  out.N = out.R2T * axes(state);
  out.A = out.N + out.N * skew(data_.interfaces[i].Q * displacements(state));
  return out;
}

std::string ModalJoint::defect(const State& state) const {
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    if (turn(state, i).A.trace() > 1.0) continue;
    return "has its interface node " + data_.interfaces[i].label +
           " turned by more than 90 deg against the body: give the structural node the orientation of the body";
  }
  return {};
}

void ModalJoint::assemble(const State& state, Equations& eq, bool tangent) const {
  const Mat3& R = axes(state);
  const int a = own_, b = own_ + m_;
  const int v = node_.force, w = moment_row(node_), x = node_.first, g = rotation_column(node_);
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    const ModalInterface& interface = data_.interfaces[i];
    const NodeSlot& end = ends_[i];
    const NodeMotion& n2 = motion_of(state, end);
    const int row = first_ + 6 * static_cast<int>(i), turn_row = row + 3;
    const Vec3 d1 = R * (interface.p + interface.T * displacements(state)), d2 = n2.R * interface.o;
    const Vec3 F = state.y.segment<3>(row), couple = state.y.segment<3>(turn_row), N = n2.R * couple;
    const Turn turn = this->turn(state, i);
    const Eigen::Matrix3Xd RT = R * interface.T, RQ = R * interface.Q;

    eq.g.segment<3>(row) += origin(state) + d1 - n2.x - d2;
    eq.g.segment<3>(turn_row) += axial(turn.A);
    add_to_g(eq.g, node_, F, d1.cross(F) + N);
    add_to_g(eq.g, end, -F, -d2.cross(F) - N);
    eq.g.segment(b, m_) += RT.transpose() * F + RQ.transpose() * N;
    if (!tangent) continue;

    const Mat3 one = Mat3::Identity(), d1x = skew(d1), d2x = skew(d2), Fx = skew(F), Nx = skew(N);
    const int x2 = end.first, g2 = rotation_column(end), F2 = end.force, M2 = moment_row(end);

    // constraint rows
    add_block(eq.g_y, row, x, one);
    add_block(eq.g_y, row, g, -d1x);
    eq.g_y.block(row, a, 3, m_) += RT;
    add_block(eq.g_y, row, x2, -one);
    add_block(eq.g_y, row, g2, d2x);
    // dA = (R2^T (dphi - dphi2)) x A + N (Q da) x; the axial vector of u x A is (tr A - A) u / 2
    const Mat3 gradient = 0.5 * (turn.A.trace() * turn.R2T - turn.A * turn.R2T);
    add_block(eq.g_y, turn_row, g, gradient);
    add_block(eq.g_y, turn_row, g2, -gradient);
    eq.g_y.block(turn_row, a, 3, m_) += 0.5 * (turn.N.trace() * interface.Q - turn.N.transpose() * interface.Q);

    // columns of the reactions
    add_block(eq.g_y, v, row, one);
    add_block(eq.g_y, w, row, d1x);
    add_block(eq.g_y, w, turn_row, n2.R);
    eq.g_y.block(b, row, m_, 3) += RT.transpose();
    eq.g_y.block(b, turn_row, m_, 3) += RQ.transpose() * n2.R;
    add_block(eq.g_y, F2, row, -one);
    add_block(eq.g_y, M2, row, -d2x);
    add_block(eq.g_y, M2, turn_row, -n2.R);

    // the arms, shapes and couples turn and move
    add_block(eq.g_y, w, g, Fx * d1x);
    add_block(eq.g_y, w, g2, -Nx);
    add_block(eq.g_y, M2, g2, Nx - Fx * d2x);
    if (w >= 0) {
      eq.g_y.block(w, a, 3, m_) -= Fx * RT;
      eq.g_y.block(b, g, m_, 3) += RT.transpose() * Fx + RQ.transpose() * Nx;
    }
    if (g2 >= 0) eq.g_y.block(b, g2, m_, 3) -= RQ.transpose() * Nx;
  }
}

void ModalJoint::rates(const State& state, ConstraintRates& out, bool tangent) const {
  const Mat3& R = axes(state);
  const NodeMotion& n1 = motion_of(state, node_);
  const int g = rotation_column(node_);
  for (std::size_t i = 0; i < ends_.size(); ++i) {
    const ModalInterface& interface = data_.interfaces[i];
    const NodeSlot& end = ends_[i];
    const NodeMotion& n2 = motion_of(state, end);
    const int row = first_ + 6 * static_cast<int>(i), turn_row = row + 3, g2 = rotation_column(end);
    const Vec3 d1 = R * (interface.p + interface.T * displacements(state)), d2 = n2.R * interface.o;
    const Vec3 moving = R * (interface.T * velocities(state));
    out.rate.segment<3>(row) += n1.v + n1.w.cross(d1) + moving - n2.v - n2.w.cross(d2);
    out.bias.segment<3>(row) += n1.w.cross(n1.w.cross(d1) + 2.0 * moving) - n2.w.cross(n2.w.cross(d2));

    const Turn turn = this->turn(state, i);
    const Vec3 w = turn.R2T * (n1.w - n2.w);                    // of the body seen from the node, its axes
    const Vec3 w_rate = turn.R2T * (-n2.w.cross(n1.w - n2.w));  // with accelerations zero
    const Mat3 wx = skew(w), small_rate = skew(interface.Q * velocities(state));
    const Mat3 N_rate = wx * turn.N, A_rate = wx * turn.A + turn.N * small_rate;
    const Mat3 A_second = skew(w_rate) * turn.A + wx * A_rate + N_rate * small_rate;
    out.rate.segment<3>(turn_row) += axial(A_rate);
    out.bias.segment<3>(turn_row) += axial(A_second);
    if (!tangent) continue;

    const Mat3 w1x = skew(n1.w);
    add_block(out.rate_q, row, g, -w1x * skew(d1) - skew(moving));
    out.rate_q.block(row, own_, 3, m_) += w1x * R * interface.T;
    add_block(out.rate_q, row, g2, skew(n2.w) * skew(d2));

    for (int k = 0; k < 3; ++k) {
      const Vec3 e = Vec3::Unit(k);
      for (const bool second_node : {false, true}) {
        const int column = second_node ? g2 : g;
        if (column < 0) continue;
        const Vec3 u = turn.R2T * e;
        const double sign = second_node ? -1.0 : 1.0;
        const Vec3 dw = second_node ? Vec3(turn.R2T * (n1.w - n2.w).cross(e)) : Vec3(Vec3::Zero());
        const Mat3 ux = sign * skew(u), dA = ux * turn.A, dN = ux * turn.N;
        const Mat3 dA_rate = skew(dw) * turn.A + wx * dA + dN * small_rate;
        out.rate_q.block<3, 1>(turn_row, column + k) += axial(dA_rate);
      }
    }
    for (int k = 0; k < m_; ++k) {
      const Mat3 small = skew(Vec3(interface.Q.col(k)));
      const Mat3 dA = turn.N * small;
      out.rate_q.block<3, 1>(turn_row, own_ + k) += axial(wx * dA);
    }
  }
}

}  // namespace mbdae
