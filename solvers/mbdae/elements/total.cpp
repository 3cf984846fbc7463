// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/total.h"

namespace mbdae {

namespace {
constexpr std::array<TotalComponent, 3> kAll{TotalComponent::position, TotalComponent::position,
                                             TotalComponent::position};
constexpr std::array<TotalComponent, 3> kNone{TotalComponent::inactive, TotalComponent::inactive,
                                              TotalComponent::inactive};
}  // namespace

namespace {

/// Adds to a row the derivatives of `coefficient` times a component of a vector drive.
void add_component_derivative(Equations& eq, int row, const VectorDrive<3>& drive, double t, int component,
                              double coefficient) {
  for (const auto& term : drive.terms) {
    if (term.direction(component) != 0.0) {
      add_drive_derivative(eq, row, *term.drive, t, coefficient * term.direction(component));
    }
  }
}

}  // namespace

struct TotalConstraint::Offset {
  Mat3 R;        // position frame in node 1, global
  Vec3 b1, b2;   // the point from node 1 and from node 2
  Vec3 w1, w21;  // angular velocity of node 1, of node 2 less that of node 1
  Vec3 b1_rate, b2_rate;
  Vec3 u;  // rate of b1 seen from node 1
};

// E = Rr^T R2 R2hr exp(Theta)^T = exp(angle): theta is the constraint. Theta is zero in E, and imposed on theta, where
// free components follow.
struct TotalConstraint::Relative {
  Mat3 Rr;     // rotation frame in node 1, global
  Vec3 Theta;  // imposed rotation vector in E
  Mat3 E;
  Vec3 angle;
  Vec3 theta;
  Mat3 gamma_inverse;  // of angle
};

void TotalConstraint::add_rows(const std::array<TotalComponent, 3>& position,
                               const std::array<TotalComponent, 3>& rotation) {
  for (const bool rotational : {false, true}) {
    for (int i = 0; i < 3; ++i) {
      const TotalComponent component = (rotational ? rotation : position)[static_cast<std::size_t>(i)];
      if (component == TotalComponent::inactive) continue;
      const bool velocity = component == TotalComponent::velocity;
      rows_.push_back({rotational, velocity, i});
      if (rotational && !velocity) {
        ++active_rotations_;
        rotation_active_[static_cast<std::size_t>(i)] = true;
      }
    }
  }
  size_ = static_cast<int>(rows_.size());
}

TotalConstraint::TotalConstraint(const ClampData& data, const Numbering& numbering)
    : node2_(numbering.slot(data.node)),
      origin_(data.X),
      R1h_(Mat3::Identity()),
      R1hr_(Mat3::Identity()),
      R2hr_(data.R.transpose()) {
  first_ = numbering.first;
  add_rows(kAll, kAll);
}

TotalConstraint::TotalConstraint(const InLineData& data, const Numbering& numbering)
    : node1_(numbering.slot(data.node1)),
      node2_(numbering.slot(data.node2)),
      f2_(data.q),
      origin_(data.Rv.transpose() * data.p),
      R1h_(data.Rv),
      R1hr_(Mat3::Identity()),
      R2hr_(Mat3::Identity()) {
  first_ = numbering.first;
  add_rows({TotalComponent::position, TotalComponent::position, TotalComponent::inactive}, kNone);
}

TotalConstraint::TotalConstraint(const InPlaneData& data, const Numbering& numbering)
    : node1_(numbering.slot(data.node1)),
      node2_(numbering.slot(data.node2)),
      f2_(data.q),
      R1hr_(Mat3::Identity()),
      R2hr_(Mat3::Identity()) {
  const Vec3 across = data.n.unitOrthogonal();
  R1h_ << across, data.n.cross(across), data.n;
  origin_ = R1h_.transpose() * data.p;
  first_ = numbering.first;
  add_rows({TotalComponent::inactive, TotalComponent::inactive, TotalComponent::position}, kNone);
}

TotalConstraint::TotalConstraint(const TotalJointData& data, const Numbering& numbering)
    : node1_(numbering.slot(data.node1)),
      node2_(numbering.slot(data.node2)),
      f2_(data.f2),
      origin_(data.R1h.transpose() * data.f1),
      R1h_(data.R1h),
      R1hr_(data.R1hr),
      R2hr_(data.R2hr),
      position_drive_(data.position_drive),
      rotation_drive_(data.rotation_drive),
      driven_(true),
      reads_state_(data.position_drive.reads_state() || data.rotation_drive.reads_state()) {
  first_ = numbering.first;
  add_rows(data.position, data.rotation);
}

TotalConstraint::TotalConstraint(const TotalPinData& data, const Numbering& numbering)
    : node2_(numbering.slot(data.node)),
      f2_(data.fn),
      origin_(data.Rch.transpose() * data.Xc),
      R1h_(data.Rch),
      R1hr_(data.Rchr),
      R2hr_(data.Rnhr),
      position_drive_(data.position_drive),
      rotation_drive_(data.rotation_drive),
      driven_(true),
      reads_state_(data.position_drive.reads_state() || data.rotation_drive.reads_state()) {
  first_ = numbering.first;
  add_rows(data.position, data.rotation);
}

TotalConstraint::Offset TotalConstraint::offset(const State& state) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  Offset at;
  at.R = n1.R * R1h_;
  at.b2 = n2.R * f2_;
  at.b1 = n2.x + at.b2 - n1.x;
  at.w1 = n1.w;
  at.w21 = n2.w - n1.w;
  at.b2_rate = n2.w.cross(at.b2);
  at.b1_rate = n2.v + at.b2_rate - n1.v;
  at.u = at.b1_rate - n1.w.cross(at.b1);
  return at;
}

void TotalConstraint::add_rate_row(Eigen::MatrixXd& A, int row, const Vec3& e, const Offset& at) const {
  const Vec3 ew1 = e.cross(at.w1);
  add_row(A, row, node1_.first, ew1);
  add_row(A, row, node2_.first, -ew1);
  add_row(A, row, rotation_column(node1_), e.cross(at.u));
  add_row(A, row, rotation_column(node2_), at.b2.cross(e.cross(at.w21)));
}

TotalConstraint::Relative TotalConstraint::relative_rotation(const State& state) const {
  Relative r;
  r.Rr = motion_of(state, node1_).R * R1hr_;
  r.E = r.Rr.transpose() * motion_of(state, node2_).R * R2hr_;
  r.Theta = free_rotation_;
  if (!rotation_drive_.terms.empty()) {
    const Vec3 drive = rotation_drive_.at(state.t);
    for (int i = 0; i < 3; ++i) {
      if (rotation_active_[static_cast<std::size_t>(i)]) r.Theta(i) = drive(i);
    }
  }
  Vec3 imposed = Vec3::Zero();
  if (follows_) imposed.swap(r.Theta);
  if (!r.Theta.isZero(0.0)) r.E *= rotation_exp(r.Theta).transpose();
  r.angle = rotation_log(r.E);
  r.theta = r.angle - imposed;
  r.gamma_inverse = rotation_gamma_inverse(r.angle);
  return r;
}

Mat3 TotalConstraint::rotation_by_drive(const Relative& rel) const {
  if (follows_) return -Mat3::Identity();
  return -(rel.gamma_inverse * (rel.E * rotation_gamma(rel.Theta)));
}

void TotalConstraint::set_reference(const State& state) {
  if (!partial_rotation()) return;
  const Mat3 relative = (motion_of(state, node1_).R * R1hr_).transpose() * motion_of(state, node2_).R * R2hr_;
  const Vec3 theta = rotation_log(relative);
  for (int i = 0; i < 3; ++i) free_rotation_(i) = rotation_active_[static_cast<std::size_t>(i)] ? 0.0 : theta(i);
}

void TotalConstraint::carry_reference(const State& state) {
  if (!partial_rotation()) return;
  const Vec3 turned = relative_rotation(state).theta;
  for (int i = 0; i < 3; ++i) {
    if (!rotation_active_[static_cast<std::size_t>(i)]) free_rotation_(i) += turned(i);
  }
}

void TotalConstraint::assemble(const State& state, Equations& eq, bool tangent) const {
  const Offset at = offset(state);
  const Vec3 &b1 = at.b1, &b2 = at.b2, &w21 = at.w21;
  const Vec3 imposed = position_drive_.at(state.t);
  const int F1 = node1_.force, F2 = node2_.force, M1 = moment_row(node1_), M2 = moment_row(node2_);
  const int x1 = node1_.first, x2 = node2_.first, g1 = rotation_column(node1_), g2 = rotation_column(node2_);

  Relative rel;
  Mat3 theta_rows;  // rows: derivative of theta with respect to the relative rotation
  if (active_rotations_ > 0) {
    rel = relative_rotation(state);
    theta_rows = rel.gamma_inverse * rel.Rr.transpose();
  } else {
    rel.Rr = motion_of(state, node1_).R * R1hr_;
  }

  Vec3 F = Vec3::Zero(), M = Vec3::Zero();
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    const auto [rotation, velocity, i] = rows_[k];
    const int row = first_ + static_cast<int>(k);
    const double reaction = state.y(row);
    if (!rotation) {
      const Vec3 e = at.R.col(i), m1 = b1.cross(e), m2 = b2.cross(e);
      F += reaction * e;
      eq.g(row) += (velocity ? e.dot(at.u) : e.dot(b1) - origin_(i)) - imposed(i);
      if (!tangent) continue;
      Eigen::MatrixXd& rows = velocity ? eq.g_ydot : eq.g_y;
      add_row(rows, row, x1, -e);
      add_row(rows, row, g1, -m1);
      add_row(rows, row, x2, e);
      add_row(rows, row, g2, m2);
      if (velocity) add_rate_row(eq.g_y, row, e, at);
      if (reads_state_) add_component_derivative(eq, row, position_drive_, state.t, i, -1.0);
      add_column(eq.g_y, F1, row, -e);
      add_column(eq.g_y, M1, row, -m1);
      add_column(eq.g_y, F2, row, e);
      add_column(eq.g_y, M2, row, m2);
    } else {
      const Vec3 e = rel.Rr.col(i);
      M += reaction * e;
      eq.g(row) += velocity ? e.dot(w21) - rotation_drive_.at(state.t)(i) : rel.theta(i);
      if (!tangent) continue;
      if (velocity) {
        add_row(eq.g_ydot, row, g1, -e);
        add_row(eq.g_ydot, row, g2, e);
        add_row(eq.g_y, row, g1, e.cross(w21));
        if (reads_state_) add_component_derivative(eq, row, rotation_drive_, state.t, i, -1.0);
      } else {
        const Vec3 gradient = theta_rows.row(i);
        add_row(eq.g_y, row, g1, -gradient);
        add_row(eq.g_y, row, g2, gradient);
        if (reads_state_) {  // theta by the imposed rotation vector
          const Mat3 by_drive = rotation_by_drive(rel);
          for (int j = 0; j < 3; ++j) {
            if (!rotation_active_[static_cast<std::size_t>(j)]) continue;
            add_component_derivative(eq, row, rotation_drive_, state.t, j, by_drive(i, j));
          }
        }
      }
      add_column(eq.g_y, M1, row, -e);
      add_column(eq.g_y, M2, row, e);
    }
  }
  add_to_g(eq.g, node1_, -F, -M - b1.cross(F));
  add_to_g(eq.g, node2_, F, M + b2.cross(F));
  if (!tangent) return;

  if (x1 < 0) {  // frames fixed in the ground
    add_block(eq.g_y, M2, g2, skew_skew(F, b2));
    return;
  }
  const Mat3 Fx = skew(F), Mx = skew(M);
  add_block(eq.g_y, F1, g1, Fx);
  add_block(eq.g_y, F2, g1, -Fx);
  add_block(eq.g_y, M1, x1, -Fx);
  add_block(eq.g_y, M1, x2, Fx);
  add_block(eq.g_y, M1, g1, skew_skew(b1, F) + Mx);
  add_block(eq.g_y, M1, g2, -skew_skew(F, b2));
  add_block(eq.g_y, M2, g1, -skew_skew(b2, F) - Mx);
  add_block(eq.g_y, M2, g2, skew_skew(F, b2));
}

void TotalConstraint::rates(const State& state, ConstraintRates& out, bool tangent) const {
  const Offset at = offset(state);
  const Vec3 &w1 = at.w1, &w21 = at.w21;
  const Vec3 u_rate = motion_of(state, node2_).w.cross(at.b2_rate) - w1.cross(at.b1_rate);  // with accelerations zero
  const int g1 = rotation_column(node1_), g2 = rotation_column(node2_);

  Vec3 theta_rate = Vec3::Zero(), theta_bias = Vec3::Zero();
  Mat3 theta_by_phi1 = Mat3::Zero(), theta_by_phi2 = Mat3::Zero();
  const Mat3 Rr = motion_of(state, node1_).R * R1hr_;
  if (active_rotations_ > 0) {
    const Relative rel = relative_rotation(state);
    Vec3 rate = rotation_drive_.at(state.t, 1), second = rotation_drive_.at(state.t, 2);
    for (int i = 0; i < 3; ++i) {
      if (!rotation_active_[static_cast<std::size_t>(i)]) rate(i) = second(i) = 0.0;
    }
    Vec3 imposed_rate = Vec3::Zero(), imposed_second = Vec3::Zero();
    if (follows_) {
      rate.swap(imposed_rate);
      second.swap(imposed_second);
    }
    const Vec3 turning = rel.E * (rotation_gamma(rel.Theta) * rate);  // of exp(Theta), seen in the rotation frame
    const Vec3 omega = Rr.transpose() * w21 - turning;
    const Vec3 angle_rate = rel.gamma_inverse * omega;
    theta_rate = angle_rate - imposed_rate;
    const Mat3 by_theta = rotation_gamma_inverse_derivative(rel.angle, omega);
    const Vec3 turning_rate = omega.cross(turning) + rel.E * (rotation_gamma(rel.Theta) * second +
                                                              rotation_gamma_derivative(rel.Theta, rate) * rate);
    theta_bias =
        rel.gamma_inverse * (Rr.transpose() * (-w1.cross(w21)) - turning_rate) + by_theta * angle_rate - imposed_second;
    if (tangent) {
      const Mat3 by_delta = rel.gamma_inverse * skew(turning) + by_theta * rel.gamma_inverse;
      theta_by_phi2 = by_delta * Rr.transpose();
      theta_by_phi1 = rel.gamma_inverse * Rr.transpose() * skew(w21) - theta_by_phi2;
    }
  }

  const Vec3 drive_rate = position_drive_.at(state.t, 1), drive_second = position_drive_.at(state.t, 2);
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    const auto [rotation, velocity, i] = rows_[k];
    const int row = first_ + static_cast<int>(k);
    if (!rotation) {
      const Vec3 e = at.R.col(i);
      if (!velocity) out.rate(row) += e.dot(at.u) - drive_rate(i);
      out.bias(row) += w1.cross(e).dot(at.u) + e.dot(u_rate) - (velocity ? drive_rate(i) : drive_second(i));
      if (tangent) add_rate_row(out.rate_q, row, e, at);
    } else if (velocity) {
      const Vec3 e = Rr.col(i);
      out.bias(row) += w1.cross(e).dot(w21) - rotation_drive_.at(state.t, 1)(i);
      if (tangent) add_row(out.rate_q, row, g1, e.cross(w21));
    } else {
      out.rate(row) += theta_rate(i);
      out.bias(row) += theta_bias(i);
      if (tangent) {
        add_row(out.rate_q, row, g1, theta_by_phi1.row(i));
        add_row(out.rate_q, row, g2, theta_by_phi2.row(i));
      }
    }
  }
}

SignalValue TotalConstraint::signal(int k, const State& state) const {
  SignalValue out;
  const int component = k % 3;
  if (k >= 6) {
    for (const auto& term : position_drive_.terms) {
      const Jet jet = term.drive->at(state.t);
      out.value += term.direction(component) * jet.value;
      out.rate += term.direction(component) * jet.rate;
    }
    return out;
  }
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].component != component || rows_[i].rotation != (k >= 3)) continue;
    const int row = first_ + static_cast<int>(i);
    out.value = state.y(row);
    out.gradient.push_back({row, 1.0, 0.0});
  }
  return out;
}

std::vector<DriveInput> TotalConstraint::drive_inputs(const State& state) const {
  std::vector<DriveInput> out;
  if (!driven_) return out;
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    const Row& row = rows_[k];
    out.push_back({(row.rotation ? ".rotation[" : ".position[") + std::to_string(row.component + 1) + "]",
                   std::string(row.rotation ? "rad" : "m") + (row.velocity ? "/s" : ""), first_,
                   drive_derivative(state, static_cast<int>(k))});
  }
  return out;
}

Eigen::VectorXd TotalConstraint::drive_derivative(const State& state, int k) const {
  Eigen::VectorXd column = Eigen::VectorXd::Zero(size_);
  const Row& imposed = rows_[static_cast<std::size_t>(k)];
  if (!imposed.rotation || imposed.velocity) {
    column(k) = -1.0;
    return column;
  }
  const Relative rel = relative_rotation(state);
  const Vec3 by_drive = rotation_by_drive(rel).col(imposed.component);
  for (std::size_t j = 0; j < rows_.size(); ++j) {
    if (rows_[j].rotation && !rows_[j].velocity) column(static_cast<int>(j)) = by_drive(rows_[j].component);
  }
  return column;
}

}  // namespace mbdae
