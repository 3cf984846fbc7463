// What IDA integrates: unknowns, residual and Jacobian of the stabilised index-2 equations.
//
// The unknowns, in this order: per node x, quaternion (7); per node v, w (6); reactions lambda; multipliers mu that
// keep position and velocity constraints both satisfied (Gear, Gupta and Leimkuhler 1985). Equations:
// docs/theory/integration.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linear_algebra.h"

namespace mbdae {

namespace ida_detail {

// Absolute tolerance of reactions [N, N m] and multipliers [m/s, rad/s]. They are algebraic: no local error is
// estimated for them, and in Newton's iteration they are as exact as the motion; a tight tolerance would only hold it
// up at very short steps, where round-off in the constraints divided by the step shows in them.
constexpr double kMultiplierTolerance = 0.1;

constexpr double kSmallerPart = 0.3;  // of what the constraints left out had in the dependencies: choose again below it
constexpr int kMostPasses = 10;       // of putting an instant back on the constraints

constexpr double kRedundant = 1e-7;  // relative size of a constraint's independent part below which it is redundant

constexpr double kForever = std::numeric_limits<double>::infinity();

using Mat43 = Eigen::Matrix<double, 4, 3>;
using Mat34 = Eigen::Matrix<double, 3, 4>;

// qdot = Q(q) w / 2
inline Mat43 quaternion_rates(const Eigen::Vector4d& q) {
  Mat43 Q;
  Q.row(0) = -q.tail<3>().transpose();
  Q.bottomRows<3>() = -skew(q.tail<3>());
  Q.bottomRows<3>().diagonal().array() += q(0);
  return Q;
}

// dphi = T(q) dq: exact for the rotation of q / |q|.
inline Mat34 rotation_variation(const Eigen::Vector4d& q) {
  return (2.0 / q.squaredNorm()) * quaternion_rates(q).transpose();
}

// d(Q(q) u)/dq
inline Eigen::Matrix4d quaternion_rates_derivative(const Vec3& u) {
  Eigen::Matrix4d L;
  L(0, 0) = 0.0;
  L.block<1, 3>(0, 1) = -u.transpose();
  L.block<3, 1>(1, 0) = u;
  L.bottomRightCorner<3, 3>() = skew(u);
  return L;
}

inline std::string time_text(double t) {
  std::ostringstream out;
  out << t;
  return out.str();
}

class IdaIntegrator {
 public:
  IdaIntegrator(Model& model, const State& state) : model_(model), state_(state) {
    nodes_ = static_cast<int>(model.slots().size());
    reactions_ = model.reaction_count();
    motions_ = model.motion_count();
    velocity_ = nodes_ + motions_;
    lambda_ = velocity_ + motions_;
    mu_ = lambda_ + reactions_;
    size_ = mu_ + reactions_;
    velocity_level_.assign(static_cast<std::size_t>(reactions_), false);
    for (const ConstraintEntry& entry : model.constraints()) {
      for (int k = 0; k < entry.constraint->size(); ++k) {
        velocity_level_[static_cast<std::size_t>(entry.constraint->first() + k - model.reaction_start())] =
            entry.constraint->velocity_level(k);
      }
    }
  }

  int size() const { return size_; }
  const State& state() const { return state_; }
  // True if the last output found that the constraints that follow from the others are to be chosen again.
  bool stale() const { return stale_; }

  // Drives are evaluated within these times only: on this side of their jumps.
  void set_piece(double from, double to) {
    from_ = from;
    to_ = std::max(from, to);
  }

  // Puts the present motion on the constraints as they are just behind t, and finds which of them are redundant there.
  // The nodes' velocities change as little as the constraints ask for.
  Correction settle(double t) {
    state_.t = std::clamp(t, from_, to_);
    Correction positions = close_constraints(model_, state_);
    if (positions.worst >= 0) {
      if (!(positions.left <= kConstraintTolerance)) {
        throw NotConverged(
            "at t = " + time_text(t) + " s " + violated(model_, positions, false) +
            ", and no position closes it: it contradicts the other constraints; remove a redundant constraint or "
            "make the drives agree");
      }
      match_velocities(model_, state_);
    }
    find_redundant();
    stale_ = false;
    return positions;
  }

  Eigen::VectorXd accelerations() {
    try {
      return solve_accelerations(model_, state_);
    } catch (const ModelError& error) {
      throw NotConverged("at t = " + time_text(state_.t) + " s " + error.what());
    }
  }

  // Initial values, rates, and which unknowns are differential.
  void start(const Eigen::VectorXd& accelerations, Eigen::Ref<Eigen::VectorXd> y, Eigen::Ref<Eigen::VectorXd> ydot,
             Eigen::Ref<Eigen::VectorXd> id, double atol, Eigen::Ref<Eigen::VectorXd> tolerance) const {
    y.setZero();
    ydot.setZero();
    id.setOnes();
    tolerance.setConstant(atol);
    for (int i = 0; i < nodes_; ++i) {
      const NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      const Eigen::Vector4d q = quaternion_of(node.R);
      y.segment<3>(pose(i)) = node.x;
      y.segment<4>(pose(i) + 3) = q;
      y.segment<3>(velocity(i)) = node.v;
      y.segment<3>(velocity(i) + 3) = node.w;
      ydot.segment<3>(pose(i)) = node.v;
      ydot.segment<4>(pose(i) + 3) = 0.5 * quaternion_rates(q) * node.w;
      ydot.segment<6>(velocity(i)) = accelerations.segment<6>(motion(i));
      if (!model_.slots()[static_cast<std::size_t>(i)].has_rates()) id.segment<6>(velocity(i)).setZero();
    }
    for (std::size_t i = static_cast<std::size_t>(nodes_); i < model_.motions().size(); ++i) {
      const MotionGroup& group = model_.motions()[i];
      y.segment(modal_pose(group), group.count) = state_.y.segment(group.pose, group.count);
      y.segment(velocity_ + group.motion, group.count) = state_.y.segment(group.force, group.count);
      ydot.segment(modal_pose(group), group.count) = state_.y.segment(group.force, group.count);
      ydot.segment(velocity_ + group.motion, group.count) = accelerations.segment(group.motion, group.count);
    }
    y.segment(lambda_, reactions_) = state_.y.tail(reactions_);
    for (const int k : redundant_) y(lambda_ + k) = 0.0;
    id.segment(lambda_, size_ - lambda_).setZero();
    tolerance.segment(lambda_, size_ - lambda_).setConstant(kMultiplierTolerance);
  }

  // IDA's unknowns into node motions and reactions.
  const State& state_of(double t, const Eigen::Map<const Eigen::VectorXd>& y) {
    state_.t = std::clamp(t, from_, to_);
    for (int i = 0; i < nodes_; ++i) {
      NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      node.x = y.segment<3>(pose(i));
      node.R = rotation_of_quaternion(y.segment<4>(pose(i) + 3));
      node.v = y.segment<3>(velocity(i));
      node.w = y.segment<3>(velocity(i) + 3);
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      if (slot.modal) state_.y.segment<6>(slot.force) = y.segment<6>(velocity(i));
    }
    for (std::size_t i = static_cast<std::size_t>(nodes_); i < model_.motions().size(); ++i) {
      const MotionGroup& group = model_.motions()[i];
      state_.y.segment(group.pose, group.count) = y.segment(modal_pose(group), group.count);
      state_.y.segment(group.force, group.count) = y.segment(velocity_ + group.motion, group.count);
    }
    state_.y.tail(reactions_) = y.segment(lambda_, reactions_);
    return state_;
  }

  // The state to write: IDA interpolates between its steps, so the interpolated motion is put back on the constraints
  // (shortest correction); redundant constraints share their load with the smallest norm.
  const State& output(double t, const Eigen::Map<const Eigen::VectorXd>& y) {
    state_of(t, y);
    if (reactions_ == 0) {
      model_.set_momenta(state_);
      return state_;
    }
    const int first = model_.reaction_start();
    Eigen::MatrixXd Phi(reactions_, motions_), B(motions_, reactions_);
    double open = 1.0;
    for (int pass = 0; pass < 2 || (pass < kMostPasses && open > kConstraintTolerance); ++pass) {
      eq_.clear(model_.size(), true);
      model_.add_constraints(state_, eq_, true);
      gather(Phi, B);
      Eigen::VectorXd error = eq_.g.tail(reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) error(k) = 0.0;
      }
      open = error.cwiseAbs().maxCoeff();
      const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> inverse = shortest_solution(Phi);
      const Eigen::VectorXd step = inverse.solve(error);
      for (int i = 0; i < nodes_; ++i) {
        NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
        node.x -= step.segment<3>(motion(i));
        node.R = rotation_exp(-step.segment<3>(motion(i) + 3)) * node.R;
      }
      add_to_modes(-step, false);
      model_.rates(state_, rates_, false);
      Eigen::VectorXd speed = rates_.rate.tail(reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) speed(k) = eq_.g(first + k);
      }
      const Eigen::VectorXd change = inverse.solve(speed);
      for (int i = 0; i < nodes_; ++i) {
        NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
        node.v -= change.segment<3>(motion(i));
        node.w -= change.segment<3>(motion(i) + 3);
      }
      add_to_modes(-change, true);
    }
    stale_ = misses(Phi);
    check_agreement();
    if (!redundant_.empty()) {
      state_.y.tail(reactions_) = B.completeOrthogonalDecomposition().solve(B * state_.y.tail(reactions_)).eval();
    }
    model_.set_momenta(state_);
    return state_;
  }

  static int residual(double t, N_Vector yy, N_Vector yp, N_Vector rr, void* self) {
    auto& s = *static_cast<IdaIntegrator*>(self);
    const Eigen::Map<const Eigen::VectorXd> y(N_VGetArrayPointer(yy), s.size_), ydot(N_VGetArrayPointer(yp), s.size_);
    Eigen::Map<Eigen::VectorXd> r(N_VGetArrayPointer(rr), s.size_);
    s.evaluate(t, y, ydot, r);
    return r.allFinite() ? 0 : 1;
  }

  static int jacobian(double t, double cj, N_Vector yy, N_Vector yp, N_Vector, SUNMatrix J, void* self, N_Vector,
                      N_Vector, N_Vector) {
    auto& s = *static_cast<IdaIntegrator*>(self);
    const Eigen::Map<const Eigen::VectorXd> y(N_VGetArrayPointer(yy), s.size_), ydot(N_VGetArrayPointer(yp), s.size_);
    Eigen::Map<Eigen::MatrixXd> out(SUNDenseMatrix_Data(J), s.size_, s.size_);
    s.differentiate(t, cj, y, ydot, out);
    return 0;
  }

  // The equation with the largest violation of balance or constraint at the present state.
  std::string worst_equation(double t, const Eigen::Map<const Eigen::VectorXd>& y,
                             const Eigen::Map<const Eigen::VectorXd>& ydot) {
    Eigen::VectorXd r(size_);
    evaluate(t, y, ydot, r);
    int worst = 0;
    r.segment(velocity_, motions_ + reactions_).cwiseAbs().maxCoeff(&worst);
    int row = model_.reaction_start() + worst - motions_;
    for (const MotionGroup& group : model_.motions()) {
      if (worst >= group.motion && worst < group.motion + group.count) row = group.force + worst - group.motion;
    }
    std::ostringstream out;
    out << model_.equation_title(row) << " is off by " << r(velocity_ + worst) << " " << model_.equation_unit(row);
    return out.str();
  }

 private:
  // Where node i's position, velocity and variation (dx, dphi) start.
  static int pose(int i) { return 7 * i; }
  int velocity(int i) const { return velocity_ + 6 * i; }
  static int motion(int i) { return 6 * i; }
  int modal_pose(const MotionGroup& group) const { return nodes_ + group.motion; }

  // Adds to modal displacements or velocities, given for all coordinates of motion, and to the unknowns of modal nodes.
  void add_to_modes(const Eigen::VectorXd& change, bool velocities) {
    for (int i = 0; i < nodes_ && velocities; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      if (slot.modal) state_.y.segment<6>(slot.force) += change.segment<6>(motion(i));
    }
    for (std::size_t i = static_cast<std::size_t>(nodes_); i < model_.motions().size(); ++i) {
      const MotionGroup& group = model_.motions()[i];
      state_.y.segment(velocities ? group.force : group.pose, group.count) += change.segment(group.motion, group.count);
    }
  }

  // Coordinates of motion of a flexible body: those of the node that carries it, then its own.
  std::vector<int> moving_of(std::size_t i) const {
    std::vector<int> out;
    const int node = model_.flexible()[i].body->carrier().index;
    for (int k = 0; k < 6 && node >= 0; ++k) out.push_back(motion(node) + k);
    const MotionGroup& own = model_.motions()[static_cast<std::size_t>(nodes_) + i];
    for (int k = 0; k < own.count; ++k) out.push_back(own.motion + k);
    return out;
  }

  // Constraint matrix (velocity level rows included) and reaction columns from the assembled equations.
  void gather(Eigen::MatrixXd& Phi, Eigen::MatrixXd& B) const {
    const int first = model_.reaction_start();
    for (const MotionGroup& group : model_.motions()) {
      Phi.middleCols(group.motion, group.count) = eq_.g_y.block(first, group.pose, reactions_, group.count);
      B.middleRows(group.motion, group.count) = eq_.g_y.block(group.force, first, group.count, reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) {
          Phi.block(k, group.motion, 1, group.count) = eq_.g_ydot.block(first + k, group.pose, 1, group.count);
        }
      }
    }
  }

  // Constraints that are left out as redundant must go on following from the others.
  void check_agreement() {
    if (redundant_.empty()) return;
    eq_.clear(model_.size(), false);
    model_.add_constraints(state_, eq_, false);
    int worst = 0;
    const double error = eq_.g.tail(reactions_).cwiseAbs().maxCoeff(&worst);
    if (error <= kConstraintTolerance) return;
    const int row = model_.reaction_start() + worst;
    std::ostringstream out;
    out << "at t = " << time_text(state_.t) << " s " << model_.equation_title(row)
        << " contradicts the other constraints: the position nearest to all of them leaves " << eq_.g(row) << " "
        << model_.equation_unit(row) << " of it open; remove a redundant constraint or make the drives agree";
    throw NotConverged(out.str());
  }

  // Combinations of constraints that are always satisfied: an orthonormal basis, one column each.
  static Eigen::MatrixXd dependencies(const Eigen::MatrixXd& Phi) {
    Eigen::FullPivLU<Eigen::MatrixXd> lu(Phi.transpose());
    lu.setThreshold(kRedundant);
    const Eigen::Index count = lu.dimensionOfKernel();
    if (count == 0) return Eigen::MatrixXd(Phi.rows(), 0);
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(lu.kernel());
    return qr.householderQ() * Eigen::MatrixXd::Identity(Phi.rows(), count);
  }

  // Constraints that follow from the others: left out of the equations, their reactions zero. Those with the largest
  // part in the dependencies, so that the others stay independent as long as can be.
  void find_redundant() {
    redundant_.clear();
    if (reactions_ == 0) return;
    eq_.clear(model_.size(), true);
    model_.add_constraints(state_, eq_, true);
    Eigen::MatrixXd Phi(reactions_, motions_), B(motions_, reactions_);
    gather(Phi, B);
    const Eigen::MatrixXd basis = dependencies(Phi);
    if (basis.cols() == 0) return;
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(basis.transpose());
    for (Eigen::Index k = 0; k < basis.cols(); ++k) redundant_.push_back(qr.colsPermutation().indices()(k));
    part_ = std::abs(qr.matrixQR()(basis.cols() - 1, basis.cols() - 1));
  }

  // True if the constraints left out have become the wrong ones at the configuration with this matrix.
  bool misses(const Eigen::MatrixXd& Phi) const {
    if (redundant_.empty()) return false;
    const Eigen::MatrixXd basis = dependencies(Phi);
    const auto count = static_cast<Eigen::Index>(redundant_.size());
    if (basis.cols() != count) return basis.cols() < count;
    Eigen::MatrixXd chosen(count, count);
    for (Eigen::Index k = 0; k < count; ++k) chosen.row(k) = basis.row(redundant_[static_cast<std::size_t>(k)]);
    return Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(chosen).matrixQR().diagonal().cwiseAbs().minCoeff() <
           kSmallerPart * part_;
  }

  void evaluate(double t, const Eigen::Map<const Eigen::VectorXd>& y, const Eigen::Map<const Eigen::VectorXd>& ydot,
                Eigen::Ref<Eigen::VectorXd> r) {
    const State& state = state_of(t, y);
    eq_.clear(model_.size(), true);
    model_.add_loads(state, eq_, false);
    model_.add_constraints(state, eq_, true);
    model_.rates(state, rates_, false);
    const int first = model_.reaction_start();
    const auto mu = y.segment(mu_, reactions_);
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      const Vec6 correction = eq_.g_y.block(first, slot.first, reactions_, 6).transpose() * mu;
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
    for (std::size_t i = static_cast<std::size_t>(nodes_); i < model_.motions().size(); ++i) {
      const MotionGroup& group = model_.motions()[i];
      const int q = modal_pose(group), m = group.count;
      r.segment(q, m) = ydot.segment(q, m) - y.segment(velocity_ + group.motion, m) -
                        eq_.g_y.block(first, group.pose, reactions_, m).transpose() * mu;
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
    r.segment(lambda_, reactions_) = eq_.g.tail(reactions_);
    r.segment(mu_, reactions_) = rates_.rate.tail(reactions_);
    for (int k = 0; k < reactions_; ++k) {
      if (velocity_level_[static_cast<std::size_t>(k)]) r(mu_ + k) = y(mu_ + k);  // no position constraint to keep
    }
    for (const int k : redundant_) {
      r(lambda_ + k) = y(lambda_ + k);
      r(mu_ + k) = y(mu_ + k);
    }
  }

  void differentiate(double t, double cj, const Eigen::Map<const Eigen::VectorXd>& y,
                     const Eigen::Map<const Eigen::VectorXd>& ydot, Eigen::Ref<Eigen::MatrixXd> J) {
    const State& state = state_of(t, y);
    model_.assemble_statics(state, eq_, true);
    model_.rates(state, rates_, true);
    const int first = model_.reaction_start();
    const auto mu = y.segment(mu_, reactions_);
    J.setZero();
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      const int x = pose(i), v = velocity(i);
      const Eigen::Vector4d q = y.segment<4>(x + 3);
      const Mat43 Q = quaternion_rates(q);
      const Mat34 T = rotation_variation(q);

      // kinematics; the derivative of the constraint matrix times mu is left out, mu being as small as the tolerance
      const auto Phi = eq_.g_y.block(first, slot.first, reactions_, 6);
      const Vec3 turning = node.w + Phi.rightCols<3>().transpose() * mu;
      J.block<3, 3>(x, x).diagonal().array() += cj;
      J.block<3, 3>(x, v).diagonal().array() -= 1.0;
      J.block(x, mu_, 3, reactions_) -= Phi.leftCols<3>().transpose();
      J.block<4, 4>(x + 3, x + 3) -= 0.5 * quaternion_rates_derivative(turning);
      J.block<4, 4>(x + 3, x + 3).diagonal().array() += cj;
      J.block<4, 3>(x + 3, v + 3) -= 0.5 * Q;
      J.block(x + 3, mu_, 4, reactions_) -= 0.5 * Q * Phi.rightCols<3>().transpose();

      // equilibrium by motions of every node
      for (int j = 0; j < nodes_; ++j) {
        const NodeSlot& other = model_.slots()[static_cast<std::size_t>(j)];
        const Mat34 Tj = rotation_variation(y.segment<4>(pose(j) + 3));
        J.block<6, 3>(v, pose(j)) += eq_.g_y.block<6, 3>(slot.force, other.first);
        J.block<6, 4>(v, pose(j) + 3) += eq_.g_y.block<6, 3>(slot.force, other.first + 3) * Tj;
        J.block<6, 6>(v, velocity(j)) += eq_.g_ydot.block<6, 6>(slot.force, other.first);
      }
      J.block(v, lambda_, 6, reactions_) += eq_.g_y.block(slot.force, first, 6, reactions_);
      if (slot.has_rates()) {
        const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
        Eigen::Matrix<double, 6, 3> by_phi, by_w;
        inertia.inertia_derivatives(node, ydot.segment<6>(v), by_phi, by_w);
        J.block<6, 4>(v, x + 3) += by_phi * T;
        J.block<6, 3>(v, v + 3) += by_w;
        J.block<6, 6>(v, v) += cj * inertia.mass_matrix(node);
      }

      // constraints
      J.block(lambda_, x, reactions_, 3) += Phi.leftCols<3>();
      J.block(lambda_, x + 3, reactions_, 4) += Phi.rightCols<3>() * T;
      J.block(lambda_, v, reactions_, 6) += eq_.g_ydot.block(first, slot.first, reactions_, 6);
      J.block(mu_, x, reactions_, 3) += rates_.rate_q.block(first, slot.first, reactions_, 3);
      J.block(mu_, x + 3, reactions_, 4) += rates_.rate_q.block(first, slot.first + 3, reactions_, 3) * T;
      J.block(mu_, v, reactions_, 6) += Phi;
    }
    differentiate_modes(cj, y, ydot, J);
    for (int k = 0; k < reactions_; ++k) {
      if (!velocity_level_[static_cast<std::size_t>(k)]) continue;
      J.row(mu_ + k).setZero();
      J(mu_ + k, mu_ + k) = 1.0;
    }
    for (const int k : redundant_) {
      for (const int row : {lambda_ + k, mu_ + k}) {
        J.row(row).setZero();
        J(row, row) = 1.0;
      }
    }
  }

  // Rows and columns of modal displacements and velocities, and the inertia of flexible bodies.
  void differentiate_modes(double cj, const Eigen::Map<const Eigen::VectorXd>& y,
                           const Eigen::Map<const Eigen::VectorXd>& ydot, Eigen::Ref<Eigen::MatrixXd> J) const {
    const int first = model_.reaction_start();
    for (std::size_t i = 0; i < model_.flexible().size(); ++i) {
      const MotionGroup& own = model_.motions()[static_cast<std::size_t>(nodes_) + i];
      const int m = own.count, a = modal_pose(own), b = velocity_ + own.motion;
      J.block(a, a, m, m).diagonal().array() += cj;
      J.block(a, b, m, m).diagonal().array() -= 1.0;
      J.block(a, mu_, m, reactions_) -= eq_.g_y.block(first, own.pose, reactions_, m).transpose();

      // its columns in all equations of motion
      for (const MotionGroup& group : model_.motions()) {
        const int row = velocity_ + group.motion;
        J.block(row, a, group.count, m) += eq_.g_y.block(group.force, own.pose, group.count, m);
        J.block(row, b, group.count, m) += eq_.g_y.block(group.force, own.force, group.count, m);
      }
      // its equations by the motions of nodes, and by reactions
      for (int j = 0; j < nodes_; ++j) {
        const NodeSlot& node = model_.slots()[static_cast<std::size_t>(j)];
        const Mat34 T = rotation_variation(y.segment<4>(pose(j) + 3));
        J.block(b, pose(j), m, 3) += eq_.g_y.block(own.force, node.first, m, 3);
        J.block(b, pose(j) + 3, m, 4) += eq_.g_y.block(own.force, node.first + 3, m, 3) * T;
        J.block(b, velocity(j), m, 6) += eq_.g_ydot.block(own.force, node.first, m, 6);
      }
      J.block(b, lambda_, m, reactions_) += eq_.g_y.block(own.force, first, m, reactions_);
      // constraints
      J.block(lambda_, a, reactions_, m) += eq_.g_y.block(first, own.pose, reactions_, m);
      J.block(mu_, a, reactions_, m) += rates_.rate_q.block(first, own.pose, reactions_, m);
      J.block(mu_, b, reactions_, m) += eq_.g_y.block(first, own.pose, reactions_, m);
      differentiate_inertia(cj, i, y, ydot, J);
    }
  }

  void differentiate_inertia(double cj, std::size_t i, const Eigen::Map<const Eigen::VectorXd>& y,
                             const Eigen::Map<const Eigen::VectorXd>& ydot, Eigen::Ref<Eigen::MatrixXd> J) const {
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

  Model& model_;
  State state_;
  Equations eq_;
  ConstraintRates rates_;
  std::vector<bool> velocity_level_;
  std::vector<int> redundant_;               // constraints, counted from the first reaction
  double part_ = 1.0;                        // that they have in the dependencies, at least
  bool stale_ = false;                       // others should be left out
  double from_ = -kForever, to_ = kForever;  // times that drives are evaluated at
  int nodes_ = 0, reactions_ = 0, motions_ = 0, velocity_ = 0, lambda_ = 0, mu_ = 0, size_ = 0;
};

}  // namespace ida_detail

}  // namespace mbdae
