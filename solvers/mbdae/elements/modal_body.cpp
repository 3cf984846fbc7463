// The body of a modal joint: elasticity, damping, weight, inertia.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/modal_joint.h"

namespace mbdae {

/// Moments of mass at the state, body axes, and velocities.
struct ModalJoint::Body {
  Mat3 R;
  Vec3 w;              // global
  Vec3 S;              // S0 + I3 a
  Mat3 J;              // about the origin
  Eigen::Matrix3Xd H;  // I4 + I5(a)
  Eigen::VectorXd a, b;
  Vec3 s;  // I3 b
};

ModalJoint::ModalJoint(const ModalData& data, const Numbering& numbering)
    : data_(data), m_(data.coordinates()), own_(numbering.own) {
  if (data.node) node_ = numbering.slot(*data.node);
  for (const ModalInterface& interface : data.interfaces) ends_.push_back(numbering.slot(interface.node));
  first_ = numbering.first;
  size_ = 6 * static_cast<int>(data.interfaces.size());
}

void ModalJoint::initialise_modes(Eigen::Ref<Eigen::VectorXd> y) const {
  y.segment(own_, m_) = data_.a;
  y.segment(own_ + m_, m_) = data_.b;
}

ModalJoint::Body ModalJoint::body(const State& state) const {
  const ModalInertia& in = data_.inertia;
  Body out;
  out.R = axes(state);
  out.w = node_.index < 0 ? Vec3(Vec3::Zero()) : Vec3(state.y.segment<3>(node_.force + 3));
  out.a = displacements(state);
  out.b = velocities(state);
  out.S = in.S0;
  out.J = in.J0;
  out.s.setZero();
  if (!in.coupled) return out;
  out.S += in.I3 * out.a;
  out.s = in.I3 * out.b;
  out.H = in.I4;
  for (int j = 0; j < m_; ++j) {
    const double a = out.a(j);
    if (a == 0.0) continue;
    const Mat3& I8 = in.I8[static_cast<std::size_t>(j)];
    out.J += a * (I8 + I8.transpose());
    out.H += a * in.I5.middleCols(j * m_, m_);
    if (in.I9.empty()) continue;
    for (int k = 0; k < m_; ++k) out.J -= a * out.a(k) * in.I9[static_cast<std::size_t>(j * m_ + k)];
  }
  return out;
}

void ModalJoint::assemble_loads(const State& state, const Vec3& gravity, Equations& eq, bool tangent) const {
  const int a = own_, b = own_ + m_;
  eq.g.segment(b, m_) += data_.K * displacements(state) + data_.C * velocities(state);
  if (tangent) {
    eq.g_y.block(b, a, m_, m_) += data_.K;
    eq.g_y.block(b, b, m_, m_) += data_.C;
  }
  if (gravity.isZero(0.0)) return;
  const ModalInertia& in = data_.inertia;
  const Mat3& R = axes(state);
  Vec3 S = in.S0;
  if (in.coupled) S += in.I3 * displacements(state);
  S = R * S;
  add_to_g(eq.g, node_, -in.m * gravity, -S.cross(gravity));
  if (tangent) add_block(eq.g_y, moment_row(node_), rotation_column(node_), -skew_skew(gravity, S));
  if (!in.coupled) return;
  const Eigen::Matrix3Xd I3 = R * in.I3;
  eq.g.segment(b, m_) -= I3.transpose() * gravity;
  if (!tangent || node_.index < 0) return;
  const Eigen::Matrix3Xd turning = skew(gravity) * I3;
  eq.g_y.block(node_.force + 3, a, 3, m_) += turning;
  eq.g_y.block(b, node_.first + 3, m_, 3) += turning.transpose();
}

Eigen::MatrixXd ModalJoint::mass_matrix(const State& state) const {
  const int rigid = node_.index < 0 ? 0 : 6, n = rigid + m_;
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(n, n);
  out.bottomRightCorner(m_, m_) = data_.M;
  if (rigid == 0) return out;
  const Body body = this->body(state);
  const Mat3 Sx = skew(body.R * body.S);
  out.topLeftCorner<3, 3>().diagonal().setConstant(data_.inertia.m);
  out.block<3, 3>(0, 3) = -Sx;
  out.block<3, 3>(3, 0) = Sx;
  out.block<3, 3>(3, 3) = body.R * body.J * body.R.transpose();
  if (!data_.inertia.coupled) return out;
  out.block(0, 6, 3, m_) = body.R * data_.inertia.I3;
  out.block(3, 6, 3, m_) = body.R * body.H;
  out.block(6, 0, m_, 6) = out.block(0, 6, 6, m_).transpose();
  return out;
}

Eigen::VectorXd ModalJoint::velocity_terms(const State& state) const {
  const int rigid = node_.index < 0 ? 0 : 6;
  Eigen::VectorXd out = Eigen::VectorXd::Zero(rigid + m_);
  if (rigid == 0) return out;
  const Body body = this->body(state);
  if (body.w.isZero(0.0)) return out;
  const ModalInertia& in = data_.inertia;
  const Mat3& R = body.R;
  const Vec3 w = R.transpose() * body.w;
  Vec3 force = w.cross(w.cross(body.S)), moment = w.cross(body.J * w);
  if (in.coupled) {
    force += 2.0 * w.cross(body.s);
    for (int j = 0; j < m_; ++j) {
      const auto at = static_cast<std::size_t>(j);
      const Mat3& I8 = in.I8[at];
      const Mat3& I10 = in.I10[at];
      Mat3 centrifugal = I8.transpose() + I10;
      moment += body.b(j) * (2.0 * I8 + I10 + I10.transpose()) * w;
      for (int k = 0; k < m_ && !in.I9.empty(); ++k) {
        const Mat3& I9 = in.I9[static_cast<std::size_t>(j * m_ + k)];
        moment -= 2.0 * body.a(j) * body.b(k) * (I9 * w);
        centrifugal -= body.a(k) * I9;
      }
      const Eigen::Matrix3Xd I5_j = in.I5(Eigen::all, Eigen::seqN(j, m_, m_));  // column i: I5_ij
      out(rigid + j) = 2.0 * w.dot(I5_j * body.b) - w.dot(centrifugal * w);
    }
  }
  out.head<3>() = R * force;
  out.segment<3>(3) = R * moment;
  if (in.coupled) out.segment<3>(3) += R * body.w.cross(R * (in.I11 * body.b));
  return out;
}

InertiaTangent ModalJoint::inertia_tangent(const State& state, const Eigen::VectorXd& acceleration) const {
  const int rigid = node_.index < 0 ? 0 : 6, n = rigid + m_;
  InertiaTangent out;
  out.by_phi.setZero(n, 3);
  out.by_w.setZero(n, 3);
  out.by_a.setZero(n, m_);
  out.by_b.setZero(n, m_);
  if (rigid == 0) return out;
  const Body body = this->body(state);
  const ModalInertia& in = data_.inertia;
  const bool still = acceleration.isZero(0.0);
  if (still && body.w.isZero(0.0) && body.b.isZero(0.0)) return out;

  const Mat3& R = body.R;
  const Mat3 RT = R.transpose();
  const Vec3 vdot = acceleration.head<3>(), wdot = acceleration.segment<3>(3);
  const Vec3 A = RT * vdot, alpha = RT * wdot, w = RT * body.w;
  const Mat3 Sx = skew(body.S), wx = skew(w), alphax = skew(alpha);
  const Vec3 Jw = body.J * w;

  // Body axes first: force and moment, their derivatives with respect to A, alpha, w; the mass matrix gives the first
  // two.
  Vec3 force = in.m * A - Sx * alpha + w.cross(w.cross(body.S));
  Vec3 moment = body.S.cross(A) + body.J * alpha + w.cross(Jw);
  Mat3 force_w = -skew(w.cross(body.S)) - wx * Sx;
  Mat3 moment_w = wx * body.J - skew(Jw);
  Vec3 slip = Vec3::Zero();    // w x R I11 b, global, before the second R
  Mat3 slip_w = Mat3::Zero();  // by global w
  if (in.coupled) {
    const auto bdot = acceleration.tail(m_);
    force += in.I3 * bdot + 2.0 * w.cross(body.s);
    moment += body.H * bdot;
    force_w -= 2.0 * skew(body.s);
    const Eigen::Matrix3Xd bdot_terms = [&] {  // column j: sum_k I5_jk bdot_k
      Eigen::Matrix3Xd sum(3, m_);
      for (int j = 0; j < m_; ++j) sum.col(j) = in.I5.middleCols(j * m_, m_) * bdot;
      return sum;
    }();
    out.by_a.topRows<3>() = R * ((alphax + wx * wx) * in.I3);
    out.by_b.topRows<3>() = R * (2.0 * wx * in.I3);
    Eigen::Matrix3Xd moment_a = -skew(A) * in.I3 + bdot_terms, moment_b(3, m_);
    const Vec3 h11 = R * (in.I11 * body.b);
    slip = body.w.cross(h11);
    slip_w = -skew(h11);
    for (int j = 0; j < m_; ++j) {
      const auto at = static_cast<std::size_t>(j);
      const Mat3& I8 = in.I8[at];
      const Mat3& I10 = in.I10[at];
      Mat3 J_a = I8 + I8.transpose(), P_b = I8, centrifugal = I8.transpose() + I10;
      Vec3 coriolis_a = Vec3::Zero();
      for (int k = 0; k < m_ && !in.I9.empty(); ++k) {
        const Mat3& I9 = in.I9[static_cast<std::size_t>(j * m_ + k)];
        const Mat3& I9t = in.I9[static_cast<std::size_t>(k * m_ + j)];
        J_a -= body.a(k) * (I9 + I9t);
        P_b -= body.a(k) * I9t;
        coriolis_a -= 2.0 * body.b(k) * (I9 * w);
        centrifugal -= body.a(k) * I9;
        out.by_a(6 + j, k) += w.dot(I9 * w);
        moment_w -= 2.0 * body.a(j) * body.b(k) * I9;
        moment -= 2.0 * body.a(j) * body.b(k) * (I9 * w);
      }
      moment += body.b(j) * (2.0 * I8 + I10 + I10.transpose()) * w;
      moment_w += body.b(j) * (2.0 * I8 + I10 + I10.transpose());
      moment_a.col(j) += J_a * alpha + w.cross(J_a * w) + coriolis_a;
      moment_b.col(j) = (2.0 * P_b + I10 + I10.transpose()) * w;

      // modal equation j
      const Eigen::Matrix3Xd I5_j = in.I5(Eigen::all, Eigen::seqN(j, m_, m_));  // column i: I5_ij
      out.by_a.row(6 + j) += alpha.transpose() * I5_j;
      out.by_b.row(6 + j) += 2.0 * w.transpose() * I5_j;
      const Vec3 by_w = 2.0 * (I5_j * body.b) - (centrifugal + centrifugal.transpose()) * w;  // body axes
      const Vec3 by_A = in.I3.col(j), by_alpha = body.H.col(j);
      out.by_w.row(6 + j) = (R * by_w).transpose();
      // d(R^T u) = R^T (u x dphi)
      out.by_phi.row(6 + j) = (R * by_w).transpose() * skew(body.w) + (R * by_A).transpose() * skew(vdot) +
                              (R * by_alpha).transpose() * skew(wdot);
    }
    out.by_a.middleRows<3>(3) = R * moment_a;
    out.by_b.middleRows<3>(3) = R * moment_b + R * skew(body.w) * (R * in.I11);
  }
  const Mat3 force_phi = in.m * RT * skew(vdot) - Sx * RT * skew(wdot) + force_w * RT * skew(body.w);
  const Mat3 moment_phi = Sx * RT * skew(vdot) + body.J * RT * skew(wdot) + moment_w * RT * skew(body.w);
  out.by_phi.topRows<3>() = R * force_phi - skew(R * force);
  out.by_phi.middleRows<3>(3) = R * moment_phi - skew(R * moment);
  out.by_w.topRows<3>() = R * force_w * RT;
  out.by_w.middleRows<3>(3) = R * moment_w * RT;
  if (in.coupled) {
    // R (w x R h): the outer R and the inner one turn
    const Vec3 h11 = R * (in.I11 * body.b);
    out.by_phi.middleRows<3>(3) += -skew(R * slip) - R * skew(body.w) * skew(h11);
    out.by_w.middleRows<3>(3) += R * slip_w;
  }
  return out;
}

ModalForce::ModalForce(const ModalForceData& data, const Numbering& numbering) : data_(data) {
  const Numbering::Own& joint = numbering.joints[data.joint];
  first_ = joint.first + joint.modes;
}

void ModalForce::assemble(const State& state, Equations& eq, bool /*tangent*/) const {
  for (const ModalForceData::Term& term : data_.terms) eq.g(first_ + term.mode) -= term.drive->value(state.t);
}

}  // namespace mbdae
