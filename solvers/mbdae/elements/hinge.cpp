// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/hinge.h"

#include <cmath>
#include <numbers>
#include <utility>

namespace mbdae {

void Hinge::set_points(const NodeSlot& node1, const Vec3& d1, const NodeSlot& node2, const Vec3& d2, int first) {
  node1_ = node1;
  node2_ = node2;
  d1_ = d1;
  d2_ = d2;
  first_ = first;
  size_ = 3;
}

void Hinge::add_axis(const NodeSlot& node_a, const Vec3& a, const NodeSlot& node_b, const Vec3& b, double couple_sign) {
  axes_.push_back({node_a, node_b, a, b, couple_sign});
  ++size_;
}

Hinge::Hinge(const SphericalHingeData& data, const Numbering& numbering) {
  const NodeSlot &node1 = numbering.slot(data.node1), &node2 = numbering.slot(data.node2);
  set_points(node1, data.d1, node2, data.d2, numbering.first);
}

Hinge::Hinge(const SphericalPinData& data, const Numbering& numbering) {
  const NodeSlot& node = numbering.slot(data.node);
  set_points(node, data.d, NodeSlot{}, data.X0, numbering.first);
}

Hinge::Hinge(const RevoluteHingeData& data, const Numbering& numbering) {
  const NodeSlot &node1 = numbering.slot(data.node1), &node2 = numbering.slot(data.node2);
  set_points(node1, data.d1, node2, data.d2, numbering.first);
  add_axis(node1, data.R1h.col(2), node2, data.R2h.col(1), 1.0);
  add_axis(node1, data.R1h.col(2), node2, data.R2h.col(0), -1.0);
  R1h_ = data.R1h;
  R2h_ = data.R2h;
  if (data.friction) friction_.emplace(*data.friction, node1, node2, data.R1h.col(2), first_, numbering.scalar);
}

Hinge::Hinge(const RevolutePinData& data, const Numbering& numbering) {
  const NodeSlot& node = numbering.slot(data.node);
  set_points(node, data.d, NodeSlot{}, data.X0, numbering.first);
  add_axis(NodeSlot{}, data.R0.col(2), node, data.Rh.col(1), -1.0);
  add_axis(NodeSlot{}, data.R0.col(2), node, data.Rh.col(0), 1.0);
}

Hinge::Hinge(const CardanoHingeData& data, const Numbering& numbering) {
  const NodeSlot &node1 = numbering.slot(data.node1), &node2 = numbering.slot(data.node2);
  set_points(node1, data.d1, node2, data.d2, numbering.first);
  point_row_sign_ = 1.0;
  add_axis(node1, data.R1h.col(2), node2, data.R2h.col(1), 1.0);
}

Hinge::Hinge(const CardanoPinData& data, const Numbering& numbering) {
  const NodeSlot& node = numbering.slot(data.node);
  set_points(node, data.d, NodeSlot{}, data.X0, numbering.first);
  force_sign_ = -1.0;
  add_axis(NodeSlot{}, data.R0.col(2), node, data.Rh.col(1), 1.0);
}

Hinge::Hinge(const PrismaticData& data, const Numbering& numbering) {
  node1_ = numbering.slot(data.node1);
  node2_ = numbering.slot(data.node2);
  first_ = numbering.first;
  d1_ = d2_ = Vec3::Zero();
  points_ = size_ = 0;
  axis_row_sign_ = 1.0;
  for (const auto& [i, j] : {std::pair{1, 2}, std::pair{2, 0}, std::pair{0, 1}}) {
    add_axis(node1_, data.R1h.col(i), node2_, data.R2h.col(j), -1.0);
  }
}

Hinge::Hinge(const AxialRotationData& data, const Numbering& numbering)
    : Hinge(RevoluteHingeData{data.node1, data.node2, data.d1, data.d2, data.R1h, data.R2h, {}, {}, {}}, numbering) {
  spin_ = data.drive;
  ++size_;
}

Hinge::Hinge(const RevoluteRotationData& data, const Numbering& numbering)
    : Hinge(RevoluteHingeData{data.node1, data.node2, Vec3::Zero(), Vec3::Zero(), data.R1h, data.R2h, {}, {}, {}},
            numbering) {
  without_points();
}

Hinge::Hinge(const CardanoRotationData& data, const Numbering& numbering)
    : Hinge(CardanoHingeData{data.node1, data.node2, Vec3::Zero(), Vec3::Zero(), data.R1h, data.R2h}, numbering) {
  without_points();
}

void Hinge::without_points() {
  size_ -= points_;
  points_ = 0;
}

void Hinge::assemble(const State& state, Equations& eq, bool tangent) const {
  if (points_ > 0) assemble_points(state, eq, tangent);
  assemble_axes(state, eq, tangent);
  if (spin_) assemble_spin(state, eq, tangent);
  if (friction_) friction_->assemble(state, eq, tangent);
}

void Hinge::assemble_points(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Vec3 d1 = n1.R * d1_, d2 = n2.R * d2_;
  const Vec3 F = force_sign_ * state.y.segment<3>(first_);

  add_to_g(eq.g, node1_, F, d1.cross(F));
  add_to_g(eq.g, node2_, -F, -d2.cross(F));
  eq.g.segment<3>(first_) += point_row_sign_ * (n1.x + d1 - n2.x - d2);

  if (tangent) {
    const Mat3 I = Mat3::Identity(), d1x = skew(d1), d2x = skew(d2);
    add_block(eq.g_y, node1_.force, first_, force_sign_ * I);
    add_block(eq.g_y, moment_row(node1_), first_, force_sign_ * d1x);
    add_block(eq.g_y, node2_.force, first_, -force_sign_ * I);
    add_block(eq.g_y, moment_row(node2_), first_, -force_sign_ * d2x);
    add_block(eq.g_y, first_, node1_.first, point_row_sign_ * I);
    add_block(eq.g_y, first_, rotation_column(node1_), -point_row_sign_ * d1x);
    add_block(eq.g_y, first_, node2_.first, -point_row_sign_ * I);
    add_block(eq.g_y, first_, rotation_column(node2_), point_row_sign_ * d2x);
    add_block(eq.g_y, moment_row(node1_), rotation_column(node1_), skew_skew(F, d1));
    add_block(eq.g_y, moment_row(node2_), rotation_column(node2_), -skew_skew(F, d2));
  }
}

void Hinge::assemble_axes(const State& state, Equations& eq, bool tangent) const {
  for (std::size_t k = 0; k < axes_.size(); ++k) {
    const Axis& axis = axes_[k];
    const int row = first_ + points_ + static_cast<int>(k);
    const Vec3 a = motion_of(state, axis.node_a).R * axis.a, b = motion_of(state, axis.node_b).R * axis.b;
    const Vec3 arm = axis.couple_sign * b.cross(a);
    const double M = state.y(row);
    add_to_g(eq.g, axis.node_a, Vec3::Zero(), M * arm);
    add_to_g(eq.g, axis.node_b, Vec3::Zero(), -M * arm);
    eq.g(row) += axis_row_sign_ * a.dot(b);
    if (!tangent) continue;

    const int Ma = moment_row(axis.node_a), Mb = moment_row(axis.node_b);
    const int ga = rotation_column(axis.node_a), gb = rotation_column(axis.node_b);
    add_column(eq.g_y, Ma, row, arm);
    add_column(eq.g_y, Mb, row, -arm);
    add_row(eq.g_y, row, ga, axis_row_sign_ * a.cross(b));
    add_row(eq.g_y, row, gb, axis_row_sign_ * b.cross(a));
    const double scale = axis.couple_sign * M;
    const Mat3 by_a = -scale * skew_skew(b, a), by_b = scale * skew_skew(a, b);
    add_block(eq.g_y, Ma, ga, by_a);
    add_block(eq.g_y, Ma, gb, by_b);
    add_block(eq.g_y, Mb, ga, -by_a);
    add_block(eq.g_y, Mb, gb, -by_b);
  }
}

void Hinge::assemble_spin(const State& state, Equations& eq, bool tangent) const {
  const int row = first_ + size_ - 1;
  const NodeMotion& n1 = motion_of(state, node1_);
  const Vec3 e = n1.R * R1h_.col(2), w21 = motion_of(state, node2_).w - n1.w;
  const double M = state.y(row);
  add_to_g(eq.g, node1_, Vec3::Zero(), M * e);
  add_to_g(eq.g, node2_, Vec3::Zero(), -M * e);
  eq.g(row) += e.dot(w21) - spin_->value(state.t);
  if (!tangent) return;
  const int g1 = rotation_column(node1_), g2 = rotation_column(node2_);
  add_column(eq.g_y, moment_row(node1_), row, e);
  add_column(eq.g_y, moment_row(node2_), row, -e);
  add_block(eq.g_y, moment_row(node1_), g1, -M * skew(e));
  add_block(eq.g_y, moment_row(node2_), g1, M * skew(e));
  add_row(eq.g_y, row, g1, e.cross(w21));
  add_row(eq.g_ydot, row, g1, -e);
  add_row(eq.g_ydot, row, g2, e);
  add_drive_derivative(eq, row, *spin_, state.t, -1.0);
}

void Hinge::rates(const State& state, ConstraintRates& out, bool tangent) const {
  if (points_ > 0) point_rates(state, out, tangent);
  axis_rates(state, out, tangent);
  if (!spin_) return;
  const int row = first_ + size_ - 1;
  const NodeMotion &n1 = motion_of(state, node1_), &n2 = motion_of(state, node2_);
  const Vec3 e = n1.R * R1h_.col(2), w21 = n2.w - n1.w;
  out.bias(row) += n1.w.cross(e).dot(w21) - spin_->at(state.t).rate;
  if (tangent) add_row(out.rate_q, row, rotation_column(node1_), e.cross(w21));
}

void Hinge::point_rates(const State& state, ConstraintRates& out, bool tangent) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  const Vec3 d1 = n1.R * d1_, d2 = n2.R * d2_;
  const Vec3 d1dot = n1.w.cross(d1), d2dot = n2.w.cross(d2);
  out.rate.segment<3>(first_) += point_row_sign_ * (n1.v + d1dot - n2.v - d2dot);
  out.bias.segment<3>(first_) += point_row_sign_ * (n1.w.cross(d1dot) - n2.w.cross(d2dot));
  if (tangent) {
    add_block(out.rate_q, first_, rotation_column(node1_), -point_row_sign_ * skew_skew(n1.w, d1));
    add_block(out.rate_q, first_, rotation_column(node2_), point_row_sign_ * skew_skew(n2.w, d2));
  }
}

void Hinge::axis_rates(const State& state, ConstraintRates& out, bool tangent) const {
  for (std::size_t k = 0; k < axes_.size(); ++k) {
    const Axis& axis = axes_[k];
    const int row = first_ + points_ + static_cast<int>(k);
    const NodeMotion& na = motion_of(state, axis.node_a);
    const NodeMotion& nb = motion_of(state, axis.node_b);
    const Vec3 a = na.R * axis.a, b = nb.R * axis.b;
    const Vec3 adot = na.w.cross(a), bdot = nb.w.cross(b);
    out.rate(row) += axis_row_sign_ * (adot.dot(b) + a.dot(bdot));
    out.bias(row) += axis_row_sign_ * (na.w.cross(adot).dot(b) + 2.0 * adot.dot(bdot) + a.dot(nb.w.cross(bdot)));
    if (tangent) {
      // d((wa - wb) . (a x b)); u^T skew(p) skew(q) = (q x (p x u))^T
      const Vec3 relative = na.w - nb.w;
      add_row(out.rate_q, row, rotation_column(axis.node_a), axis_row_sign_ * a.cross(b.cross(relative)));
      add_row(out.rate_q, row, rotation_column(axis.node_b), -axis_row_sign_ * b.cross(a.cross(relative)));
    }
  }
}

std::vector<ScalarInfo> Hinge::scalars() const {
  return friction_ ? std::vector<ScalarInfo>{friction_->scalar()} : std::vector<ScalarInfo>{};
}

std::string Hinge::defect_under_load(const State& state) const {
  if (!friction_ || !friction_->ineffective(state)) return {};
  return "has friction without preload and carries no load: nothing holds it; give a `preload`";
}

double Hinge::turn(const State& state) const {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  const Mat3 E = (motion_of(state, node1_).R * R1h_).transpose() * motion_of(state, node2_).R * R2h_;
  const double angle = std::atan2(E(1, 0), E(0, 0));
  return angle + kTurn * std::round((last_turn_ - angle) / kTurn);
}

void Hinge::accept(const State& state) { last_turn_ = turn(state); }

SignalValue Hinge::signal(int k, const State& state) const {
  const NodeMotion& n1 = motion_of(state, node1_);
  const NodeMotion& n2 = motion_of(state, node2_);
  SignalValue out;
  if (k < 2) {  // rz, wz
    const Mat3 Ra = n1.R * R1h_, E = Ra.transpose() * n2.R * R2h_;
    const Vec3 w21 = n2.w - n1.w;
    // off the joint's axis, as it is between iterations, the angle's derivative is not quite e.(dphi2 - dphi1)
    const double off = E(2, 0) / (E(0, 0) * E(0, 0) + E(1, 0) * E(1, 0));
    const Vec3 e = k == 0 ? Vec3(Ra * Vec3(-off * E(0, 0), -off * E(1, 0), 1.0)) : Vec3(Ra.col(2));
    out.value = k == 0 ? turn(state) : e.dot(w21);
    if (k == 0) out.rate = e.dot(w21);
    for (int i = 0; i < 3; ++i) {
      const double a = e(i), turning = e.cross(w21)(i);  // dwz = e.(dw2 - dw1) + (e x w21).dphi1
      const int g1 = rotation_column(node1_) + i, g2 = rotation_column(node2_) + i;
      out.gradient.push_back({g1, k == 0 ? -a : turning, k == 0 ? 0.0 : -a});
      out.gradient.push_back({g2, k == 0 ? a : 0.0, k == 0 ? 0.0 : a});
    }
    return out;
  }
  // force in the hinge's axes of node 1
  const Vec3 F = state.y.segment<3>(first_), axis = n1.R * R1h_.col(k - 2), turning = axis.cross(F);
  out.value = axis.dot(F);
  for (int i = 0; i < 3; ++i) {
    out.gradient.push_back({first_ + i, axis(i), 0.0});
    out.gradient.push_back({rotation_column(node1_) + i, turning(i), 0.0});
  }
  return out;
}

}  // namespace mbdae
