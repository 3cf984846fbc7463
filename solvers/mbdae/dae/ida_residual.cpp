// Residual and Jacobian of IDA's equations.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <sstream>

#include "mbdae/dae/consistency.h"
#include "mbdae/dae/ida_equations.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/quaternion_rates.h"

namespace mbdae::ida_detail {

namespace {

constexpr double kHolds = 1e-12;  // residual that is not worth a word [N, N m, m, rad]

// Beyond any machine [m/s^2, rad/s^2], [m/s], [rad/s], [N, N m] (estimated); they decide what a failure is put down to.
constexpr double kAbsurdAcceleration = 1e10, kAbsurdSpeed = 1e5, kAbsurdSpin = 1e5, kAbsurdForce = 1e10;
constexpr const char* kLookForOrders = "; look for a force, a stiffness or a mass that is wrong by orders of magnitude";

}  // namespace

int IdaEquations::residual(double t, N_Vector yy, N_Vector yp, N_Vector rr, void* self) {
  auto& s = *static_cast<IdaEquations*>(self);
  Eigen::Map<Eigen::VectorXd> r(N_VGetArrayPointer(rr), s.size_);
  s.evaluate(t, s.view(yy), s.view(yp), r);
  return r.allFinite() ? 0 : 1;
}

int IdaEquations::jacobian(double t, double cj, N_Vector yy, N_Vector yp, N_Vector, SUNMatrix J, void* self, N_Vector,
                           N_Vector, N_Vector) {
  auto& s = *static_cast<IdaEquations*>(self);
  Eigen::Map<Eigen::MatrixXd> out(SUNDenseMatrix_Data(J), s.size_, s.size_);
  s.differentiate(t, cj, s.view(yy), s.view(yp), out);
  return 0;
}

int IdaEquations::mode_margins(double t, N_Vector yy, N_Vector yp, realtype* margins, void* self) {
  auto& s = *static_cast<IdaEquations*>(self);
  State state = s.state_of(t, s.view(yy), s.view(yp));
  bool loads = false;
  for (const Element* element : s.with_modes_) loads |= element->margin_reads_load();
  try {
    if (loads) solve_accelerations(s.model_, state);
  } catch (const ModelError& error) {
    s.load_failure_ = error.what();
    return 1;
  }
  for (std::size_t k = 0; k < s.with_modes_.size(); ++k) margins[k] = s.with_modes_[k]->mode_margin(state);
  return 0;
}

std::string IdaEquations::worst_equation(double t, const Values& y, const Values& ydot) {
  Eigen::VectorXd r(size_);
  evaluate(t, y, ydot, r);
  const auto worst = static_cast<int>(worst_of(r.segment(velocity_, motions_ + own_)));
  const double off = r(velocity_ + worst);
  if (std::abs(off) <= kHolds) return "";
  int row = model_.scalar_start() + worst - motions_;
  for (const MotionGroup& group : model_.motions()) {
    if (worst >= group.motion && worst < group.motion + group.count) row = group.force + worst - group.motion;
  }
  return model_.equation_off(row, off);
}

std::string IdaEquations::absurd_motion(double t, const Values& y, const Values& ydot) {
  const State& state = state_of(t, y, ydot);
  double worst = 1.0;
  std::ostringstream out;
  out.precision(3);
  for (int i = 0; i < nodes_; ++i) {
    const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
    const auto look = [&](double value, double limit, const char* what, const char* unit) {
      if (!(value > worst * limit)) return;
      worst = value / limit;
      out.str("");
      out << model_.deck().nodes[static_cast<std::size_t>(i)].id.name << " " << what << " " << value << " " << unit;
    };
    if (model_.slots()[static_cast<std::size_t>(i)].has_rates()) {
      look(ydot.segment<3>(velocity(i)).norm(), kAbsurdAcceleration, "is accelerated by", "m/s^2");
      look(ydot.segment<3>(velocity(i) + 3).norm(), kAbsurdAcceleration, "is accelerated by", "rad/s^2");
    }
    look(node.v.norm(), kAbsurdSpeed, "moves at", "m/s");
    look(node.w.norm(), kAbsurdSpin, "turns at", "rad/s");
  }
  return out.str().empty() ? "" : out.str() + kLookForOrders;
}

std::string IdaEquations::absurd_force(double t, const Values& y, const Values& ydot) {
  Eigen::VectorXd r(size_);
  evaluate(t, y, ydot, r);
  const double most = motions_ == 0 ? 0.0 : r.segment(velocity_, motions_).cwiseAbs().maxCoeff();
  return most > kAbsurdForce ? worst_equation(t, y, ydot) + kLookForOrders : "";
}

// Coordinates of motion of a flexible body: those of the node that carries it, then its own.
std::vector<int> IdaEquations::moving_of(std::size_t i) const {
  std::vector<int> out;
  const int node = model_.flexible()[i].body->carrier().index;
  for (int k = 0; k < 6 && node >= 0; ++k) out.push_back(motion(node) + k);
  const MotionGroup& own = model_.motions()[static_cast<std::size_t>(nodes_) + i];
  for (int k = 0; k < own.count; ++k) out.push_back(own.motion + k);
  return out;
}

void IdaEquations::evaluate(double t, const Values& y, const Values& ydot, Eigen::Ref<Eigen::VectorXd> r) {
  const State& state = state_of(t, y, ydot);
  assemble(false);
  const int first = model_.scalar_start();
  const auto mu = y.segment(mu_, own_);
  for (int i = 0; i < nodes_; ++i) {
    const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
    const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
    const Vec6 correction = eq_.g_y.block(first, slot.first, own_, 6).transpose() * mu;
    r.segment<3>(pose(i)) = ydot.segment<3>(pose(i)) - node.v - correction.head<3>();
    const Eigen::Vector4d q = y.segment<4>(pose(i) + 3);
    r.segment<4>(pose(i) + 3) =
        ydot.segment<4>(pose(i) + 3) - 0.5 * quaternion_rates(q) * (node.w + correction.tail<3>());
    r.segment<6>(velocity(i)) = eq_.g.segment<6>(slot.force);
    if (slot.has_rates()) {
      const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
      r.segment<6>(velocity(i)) +=
          inertia.mass_matrix(node) * ydot.segment<6>(velocity(i)) + inertia.velocity_terms(node);
    }
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    const int q = modal_pose(group), m = group.count;
    r.segment(q, m) = ydot.segment(q, m) - y.segment(velocity_ + group.motion, m) -
                      eq_.g_y.block(first, group.pose, own_, m).transpose() * mu;
    r.segment(velocity_ + group.motion, m) = eq_.g.segment(group.force, m);
  }
  for (std::size_t i = 0; i < model_.flexible().size(); ++i) {
    const Flexible& body = *model_.flexible()[i].body;
    const std::vector<int> moving = moving_of(i);
    const Eigen::VectorXd accelerations = ydot.segment(velocity_, motions_)(moving);
    const Eigen::VectorXd force = body.mass_matrix(state) * accelerations + body.velocity_terms(state);
    for (std::size_t k = 0; k < moving.size(); ++k) {
      r(velocity_ + moving[k]) += force(static_cast<Eigen::Index>(k));
    }
  }
  r.segment(scalar_, own_) = eq_.g.segment(first, own_);
  for (int k = 0; k < own_; ++k) r(mu_ + k) = kept_[static_cast<std::size_t>(k)] ? rate(k) : y(mu_ + k);
  for (const int k : redundant_) r(scalar_ + k) = y(scalar_ + k);
}

void IdaEquations::differentiate(double t, double cj, const Values& y, const Values& ydot,
                                 Eigen::Ref<Eigen::MatrixXd> J) {
  const State& state = state_of(t, y, ydot);
  assemble(true);
  const int first = model_.scalar_start();
  // The model's equations by IDA's unknowns.
  Eigen::MatrixXd by = Eigen::MatrixXd::Zero(model_.size(), size_);
  for (int j = 0; j < nodes_; ++j) {
    const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(j)];
    const Mat34 T = rotation_variation(y.segment<4>(pose(j) + 3));
    by.middleCols<3>(pose(j)) = eq_.g_y.middleCols<3>(slot.first);
    by.middleCols<4>(pose(j) + 3) = eq_.g_y.middleCols<3>(slot.first + 3) * T;
    by.middleCols<6>(velocity(j)) = eq_.g_ydot.middleCols<6>(slot.first);
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    by.middleCols(modal_pose(group), group.count) = eq_.g_y.middleCols(group.pose, group.count);
    by.middleCols(velocity_ + group.motion, group.count) = eq_.g_y.middleCols(group.force, group.count);
  }
  by.middleCols(scalar_, own_) = eq_.g_y.middleCols(first, own_);
  by.middleCols(scalar_, scalars_) += cj * eq_.g_ydot.middleCols(first, scalars_);

  J.setZero();
  for (const MotionGroup& group : model_.motions()) {
    J.middleRows(velocity_ + group.motion, group.count) = by.middleRows(group.force, group.count);
  }
  J.middleRows(scalar_, own_) = by.middleRows(first, own_);
  for (int i = 0; i < nodes_; ++i) {
    if (!model_.slots()[static_cast<std::size_t>(i)].has_rates()) continue;
    const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
    const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
    const int x = pose(i), v = velocity(i);
    Eigen::Matrix<double, 6, 3> by_phi, by_w;
    inertia.inertia_derivatives(node, ydot.segment<6>(v), by_phi, by_w);
    J.block<6, 4>(v, x + 3) += by_phi * rotation_variation(y.segment<4>(x + 3));
    J.block<6, 3>(v, v + 3) += by_w;
    J.block<6, 6>(v, v) += cj * inertia.mass_matrix(node);
  }
  for (std::size_t i = 0; i < model_.flexible().size(); ++i) differentiate_inertia(cj, i, y, ydot, J);
  differentiate_kinematics(cj, y, J);
  differentiate_rates(cj, y, J);
  for (const int k : redundant_) {
    J.row(scalar_ + k).setZero();
    J(scalar_ + k, scalar_ + k) = 1.0;
  }
}

// Rows of positions, quaternions and modal displacements. The derivative of the constraint gradients times mu is left
// out, mu being as small as the tolerance.
void IdaEquations::differentiate_kinematics(double cj, const Values& y, Eigen::Ref<Eigen::MatrixXd> J) const {
  const int first = model_.scalar_start();
  const auto mu = y.segment(mu_, own_);
  for (int i = 0; i < nodes_; ++i) {
    const int x = pose(i), v = velocity(i);
    const Mat43 Q = quaternion_rates(y.segment<4>(x + 3));
    const auto Phi = eq_.g_y.block(first, model_.slots()[static_cast<std::size_t>(i)].first, own_, 6);
    const Vec3 turning = state_.nodes[static_cast<std::size_t>(i)].w + Phi.rightCols<3>().transpose() * mu;
    J.block<3, 3>(x, x).diagonal().array() += cj;
    J.block<3, 3>(x, v).diagonal().array() -= 1.0;
    J.block(x, mu_, 3, own_) -= Phi.leftCols<3>().transpose();
    J.block<4, 4>(x + 3, x + 3) -= 0.5 * quaternion_rates_derivative(turning);
    J.block<4, 4>(x + 3, x + 3).diagonal().array() += cj;
    J.block<4, 3>(x + 3, v + 3) -= 0.5 * Q;
    J.block(x + 3, mu_, 4, own_) -= 0.5 * Q * Phi.rightCols<3>().transpose();
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& own = model_.motions()[i];
    const int m = own.count, a = modal_pose(own), b = velocity_ + own.motion;
    J.block(a, a, m, m).diagonal().array() += cj;
    J.block(a, b, m, m).diagonal().array() -= 1.0;
    J.block(a, mu_, m, own_) -= eq_.g_y.block(first, own.pose, own_, m).transpose();
  }
}

// Rows of the multipliers mu: rates of the constraints at position level, otherwise mu = 0.
void IdaEquations::differentiate_rates(double cj, const Values& y, Eigen::Ref<Eigen::MatrixXd> J) const {
  const int first = model_.scalar_start();
  const auto reactions = model_.reaction_start();
  for (int i = 0; i < nodes_; ++i) {
    const int x = pose(i), column = model_.slots()[static_cast<std::size_t>(i)].first;
    const Mat34 T = rotation_variation(y.segment<4>(x + 3));
    J.block(mu_ + scalars_, x, reactions_, 3) = rates_.rate_q.block(reactions, column, reactions_, 3);
    J.block(mu_ + scalars_, x + 3, reactions_, 4) = rates_.rate_q.block(reactions, column + 3, reactions_, 3) * T;
    J.block(mu_, velocity(i), own_, 6) = eq_.g_y.block(first, column, own_, 6);
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& own = model_.motions()[i];
    J.block(mu_ + scalars_, modal_pose(own), reactions_, own.count) =
        rates_.rate_q.block(reactions, own.pose, reactions_, own.count);
    J.block(mu_, velocity_ + own.motion, own_, own.count) = eq_.g_y.block(first, own.pose, own_, own.count);
  }
  J.block(mu_, scalar_, own_, scalars_) = cj * eq_.g_y.block(first, first, own_, scalars_);
  for (int k = 0; k < own_; ++k) {
    if (kept_[static_cast<std::size_t>(k)]) continue;
    J.row(mu_ + k).setZero();
    J(mu_ + k, mu_ + k) = 1.0;
  }
}

void IdaEquations::differentiate_inertia(double cj, std::size_t i, const Values& y, const Values& ydot,
                                         Eigen::Ref<Eigen::MatrixXd> J) const {
  const Flexible& body = *model_.flexible()[i].body;
  const MotionGroup& own = model_.motions()[static_cast<std::size_t>(nodes_) + i];
  const int m = own.count, a = modal_pose(own), b = velocity_ + own.motion, node = body.carrier().index;
  const std::vector<int> moving = moving_of(i);
  const Eigen::VectorXd accelerations = ydot.segment(velocity_, motions_)(moving);
  const Eigen::MatrixXd M = cj * body.mass_matrix(state_);
  const InertiaTangent by = body.inertia_tangent(state_, accelerations);
  Eigen::MatrixXd by_q;
  if (node >= 0) by_q = by.by_phi * rotation_variation(y.segment<4>(pose(node) + 3));
  for (std::size_t k = 0; k < moving.size(); ++k) {
    const int row = velocity_ + moving[k];
    const auto r = static_cast<Eigen::Index>(k);
    for (std::size_t c = 0; c < moving.size(); ++c) {
      J(row, velocity_ + moving[c]) += M(r, static_cast<Eigen::Index>(c));
    }
    if (node < 0) continue;
    J.block<1, 4>(row, pose(node) + 3) += by_q.row(r);
    J.block<1, 3>(row, velocity(node) + 3) += by.by_w.row(r);
    J.block(row, a, 1, m) += by.by_a.row(r);
    J.block(row, b, 1, m) += by.by_b.row(r);
  }
}

}  // namespace mbdae::ida_detail
