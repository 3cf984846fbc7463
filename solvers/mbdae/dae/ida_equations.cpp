// The state that IDA's equations stand at: constraints and their redundancy, starts, what is written.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/ida_equations.h"

#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/quaternion_rates.h"

namespace mbdae::ida_detail {

namespace {

// Absolute tolerance of reactions [N, N m] and multipliers [m/s, rad/s]. They are algebraic: no local error is
// estimated for them, and in Newton's iteration they are as exact as the motion; a tight tolerance would only hold it
// up at very short steps, where round-off in the constraints divided by the step shows in them.
constexpr double kMultiplierTolerance = 0.1;

constexpr double kSmallerPart = 0.3;  // of what the constraints left out had in the dependencies: choose again below it
constexpr int kMostPasses = 10;       // of putting an instant back on the constraints
constexpr int kMostSwitches = 8;      // of modes at one instant
constexpr double kStill = 1e-9;       // speed to which that of something at rest is known [m/s]

// Relative size of a constraint's independent part below which it is redundant. Where a closed chain cannot quite
// close, what would be redundant is nearly so.
constexpr double kRedundant = 1e-7, kNearlyRedundant = 1e-5;
constexpr double kClosed = 1e-12;  // violation left [m, rad] above which a chain counts as one that cannot close

// Combinations of constraints that are always satisfied: an orthonormal basis, one column each.
Eigen::MatrixXd dependencies(const Eigen::MatrixXd& rows, double threshold) {
  Eigen::FullPivLU<Eigen::MatrixXd> lu(rows.transpose());
  lu.setThreshold(threshold);
  const Eigen::Index count = lu.dimensionOfKernel();
  if (count == 0) return Eigen::MatrixXd(rows.rows(), 0);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(lu.kernel());
  return qr.householderQ() * Eigen::MatrixXd::Identity(rows.rows(), count);
}

}  // namespace

std::string time_text(double t) {
  std::ostringstream out;
  out << t;
  return out.str();
}

IdaEquations::IdaEquations(Model& model, const State& state)
    : model_(model),
      state_(state),
      with_modes_(model.with_modes()),
      nodes_(static_cast<int>(model.slots().size())),
      motions_(model.motion_count()),
      scalars_(model.scalar_count()),
      reactions_(model.reaction_count()),
      own_(scalars_ + reactions_),
      velocity_(nodes_ + motions_),
      scalar_(velocity_ + motions_),
      lambda_(scalar_ + scalars_),
      mu_(scalar_ + own_),
      size_(mu_ + own_) {}

void IdaEquations::set_piece(double from, double to) {
  from_ = from;
  to_ = std::max(from, to);
}

Correction IdaEquations::settle(double t) {
  state_.t = std::clamp(t, from_, to_);
  Correction positions = close_constraints(model_, state_);
  if (positions.worst >= 0) {
    if (!(positions.left <= kConstraintTolerance)) {
      throw NotConverged(contradiction_text(model_, positions, t));
    }
    match_velocities(model_, state_);
  }
  redundancy_ = positions.left > kClosed ? kNearlyRedundant : kRedundant;
  classify();
  if (positions.left > kClosed && !redundant_.empty()) project(true);
  if (scalar_constraints_) {  // what follows a state moves at its rate
    solve_state_rates(model_, state_);
    project(false);
  }
  stale_ = false;
  return positions;
}

Eigen::VectorXd IdaEquations::accelerations() {
  try {
    Eigen::VectorXd out = solve_accelerations(model_, state_);
    for (int i = 0; i < kMostSwitches && !with_modes_.empty() && model_.switch_modes(state_, kStill); ++i) {
      out = solve_accelerations(model_, state_);
    }
    return out;
  } catch (const ModelError& error) {
    throw NotConverged("at t = " + time_text(state_.t) + " s " + error.what());
  }
}

void IdaEquations::end_modes(const std::vector<int>& roots) {
  for (std::size_t k = 0; k < roots.size(); ++k) {
    if (roots[k] != 0) with_modes_[k]->end_mode(state_, kStill);
  }
}

void IdaEquations::start(const Eigen::VectorXd& accelerations, Eigen::Ref<Eigen::VectorXd> y,
                         Eigen::Ref<Eigen::VectorXd> ydot, Eigen::Ref<Eigen::VectorXd> id, double atol,
                         Eigen::Ref<Eigen::VectorXd> tolerance) const {
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
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    y.segment(modal_pose(group), group.count) = state_.y.segment(group.pose, group.count);
    y.segment(velocity_ + group.motion, group.count) = state_.y.segment(group.force, group.count);
    ydot.segment(modal_pose(group), group.count) = state_.y.segment(group.force, group.count);
    ydot.segment(velocity_ + group.motion, group.count) = accelerations.segment(group.motion, group.count);
  }
  y.segment(scalar_, own_) = state_.y.segment(model_.scalar_start(), own_);
  for (int k = 0; k < scalars_; ++k) {
    if (rate_counts_[static_cast<std::size_t>(k)]) {
      ydot(scalar_ + k) = state_.ydot(model_.scalar_start() + k);
    } else {
      id(scalar_ + k) = 0.0;
      tolerance(scalar_ + k) = kMultiplierTolerance;
    }
  }
  for (const int k : redundant_) y(scalar_ + k) = 0.0;
  id.segment(lambda_, size_ - lambda_).setZero();
  tolerance.segment(lambda_, size_ - lambda_).setConstant(kMultiplierTolerance);
}

const State& IdaEquations::state_of(double t, const Values& y, const Values& ydot) {
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
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    state_.y.segment(group.pose, group.count) = y.segment(modal_pose(group), group.count);
    state_.y.segment(group.force, group.count) = y.segment(velocity_ + group.motion, group.count);
  }
  state_.y.segment(model_.scalar_start(), own_) = y.segment(scalar_, own_);
  state_.ydot.segment(model_.scalar_start(), scalars_) = ydot.segment(scalar_, scalars_);
  return state_;
}

const State& IdaEquations::output(double t, const Values& y, const Values& ydot) {
  state_of(t, y, ydot);
  if (std::all_of(level_.begin(), level_.end(), [](Level level) { return level == Level::none; })) {
    model_.set_momenta(state_);
    return state_;
  }
  project(false);
  stale_ = misses();
  check_agreement();
  if (!redundant_.empty()) share_loads();
  model_.set_momenta(state_);
  return state_;
}

// Puts the present motion on the constraints by the shortest correction; on those that are integrated only, if asked.
void IdaEquations::project(bool kept_only) {
  const auto left_out = [&](int k) {
    return kept_only && level_[static_cast<std::size_t>(k)] == Level::position && !kept_[static_cast<std::size_t>(k)];
  };
  Eigen::MatrixXd Phi;
  double open = 1.0;
  for (int pass = 0; pass < 2 || (pass < kMostPasses && open > kConstraintTolerance); ++pass) {
    assemble(false);
    gather(Phi);
    Eigen::VectorXd error = eq_.g.tail(own_);
    for (int k = 0; k < own_; ++k) {
      if (level_[static_cast<std::size_t>(k)] != Level::position) error(k) = 0.0;
      if (left_out(k)) {
        error(k) = 0.0;
        Phi.row(k).setZero();
      }
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
    Eigen::VectorXd speed(own_);
    for (int k = 0; k < own_; ++k) {
      const Level level = level_[static_cast<std::size_t>(k)];
      speed(k) = level == Level::velocity ? eq_.g(model_.scalar_start() + k) : 0.0;
      if (level == Level::position && !left_out(k)) speed(k) = rate(k);
    }
    const Eigen::VectorXd change = inverse.solve(speed);
    for (int i = 0; i < nodes_; ++i) {
      NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      node.v -= change.segment<3>(motion(i));
      node.w -= change.segment<3>(motion(i) + 3);
    }
    add_to_modes(-change, true);
  }
}

// Adds to modal displacements or velocities, given for all coordinates of motion, and to the unknowns of modal nodes.
void IdaEquations::add_to_modes(const Eigen::VectorXd& change, bool velocities) {
  for (int i = 0; i < nodes_ && velocities; ++i) {
    const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
    if (slot.modal) state_.y.segment<6>(slot.force) += change.segment<6>(motion(i));
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    state_.y.segment(velocities ? group.force : group.pose, group.count) += change.segment(group.motion, group.count);
  }
}

// Residual, constraint gradients and rates at the present state; the tangents of loads too where they are asked for.
void IdaEquations::assemble(bool tangent) {
  eq_.clear(model_.size(), true);
  model_.add_loads(state_, eq_, tangent || scalar_constraints_);
  model_.add_reduced_constraints(state_, eq_, true);
  model_.rates(state_, rates_, tangent);
}

bool IdaEquations::depends_on_positions(int row) const {
  for (const MotionGroup& group : model_.motions()) {
    if (!eq_.g_y.row(row).segment(group.pose, group.count).isZero(0.0)) return true;
  }
  return false;
}

// Which scalars have rates that count, what every equation says of the motion, which constraints follow from others.
void IdaEquations::classify() {
  assemble(true);
  const int scalar = model_.scalar_start();
  level_.assign(static_cast<std::size_t>(own_), Level::none);
  rate_counts_.clear();
  for (int k = 0; k < scalars_; ++k) {
    rate_counts_.push_back(!model_.algebraic(scalar + k) && !eq_.g_ydot.col(scalar + k).isZero(0.0));
  }
  // A scalar's equation in which only positions and states stand: the scalar is a multiplier (a seat that follows a
  // state, its force in an abstract node).
  scalar_constraints_ = false;
  for (int k = 0; k < scalars_; ++k) {
    const int row = scalar + k;
    bool only = !rate_counts_[static_cast<std::size_t>(k)] && eq_.g_ydot.row(row).isZero(0.0) &&
                eq_.g_y.row(row).tail(reactions_).isZero(0.0) && depends_on_positions(row);
    for (int j = 0; j < scalars_; ++j) {
      only = only && (rate_counts_[static_cast<std::size_t>(j)] || eq_.g_y(row, scalar + j) == 0.0);
    }
    if (only) level_[static_cast<std::size_t>(k)] = Level::position;
    scalar_constraints_ |= only;
  }
  if (scalar_constraints_) check_steady();
  for (const ConstraintEntry& entry : model_.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      const int row = entry.constraint->first() + k;
      Level& level = level_[static_cast<std::size_t>(row - scalar)];
      if (entry.constraint->velocity_level(k)) {
        level = Level::velocity;
      } else if (depends_on_positions(row)) {
        level = Level::position;
      }
    }
  }
  kept_.clear();
  for (const Level level : level_) kept_.push_back(level == Level::position);
  find_redundant();
  for (const int k : redundant_) kept_[static_cast<std::size_t>(k)] = false;
}

// The time derivative of scalars' equations that constrain positions has no part from drives.
void IdaEquations::check_steady() {
  for (const double dt : {0.013, 0.37, 1.9}) {
    State later = state_;
    later.t += dt;
    Equations eq;
    eq.clear(model_.size(), false);
    model_.add_loads(later, eq, false);
    for (int k = 0; k < scalars_; ++k) {
      const int row = model_.scalar_start() + k;
      if (level_[static_cast<std::size_t>(k)] == Level::none) continue;
      if (std::abs(eq.g(row) - eq_.g(row)) > 1e-12 * (1.0 + std::abs(eq_.g(row)))) {
        throw ModelError(model_.equation_title(row) +
                         " constrains the motion and depends on time: integrate the deck with `ms`");
      }
    }
  }
}

// Time derivative of the position constraint of a scalar or reaction.
double IdaEquations::rate(int k) const {
  const int row = model_.scalar_start() + k;
  if (k >= scalars_) return rates_.rate(row);  // states that drives read included
  double out = eq_.g_y.row(row)
                   .segment(model_.scalar_start(), scalars_)
                   .dot(state_.ydot.segment(model_.scalar_start(), scalars_));
  for (const NodeSlot& slot : model_.slots()) {
    const NodeMotion& node = motion_of(state_, slot);
    out += eq_.g_y.block<1, 3>(row, slot.first).dot(node.v) + eq_.g_y.block<1, 3>(row, slot.first + 3).dot(node.w);
  }
  for (std::size_t i = static_cast<std::size_t>(nodes_); i < groups(); ++i) {
    const MotionGroup& group = model_.motions()[i];
    out += eq_.g_y.row(row).segment(group.pose, group.count).dot(state_.y.segment(group.force, group.count));
  }
  return out;
}

// Gradients of the constraints by the coordinates of motion, one row for every scalar and reaction.
void IdaEquations::gather(Eigen::MatrixXd& Phi) const {
  Phi.setZero(own_, motions_);
  for (int k = 0; k < own_; ++k) {
    const Level level = level_[static_cast<std::size_t>(k)];
    if (level == Level::none) continue;
    const Eigen::MatrixXd& by = level == Level::velocity ? eq_.g_ydot : eq_.g_y;
    for (const MotionGroup& group : model_.motions()) {
      Phi.block(k, group.motion, 1, group.count) = by.block(model_.scalar_start() + k, group.pose, 1, group.count);
    }
  }
}

// What constraints are made of, for their dependencies: their rows by all unknowns and by the rates of scalars.
Eigen::MatrixXd IdaEquations::constraint_rows() const {
  const int first = model_.reaction_start();
  Eigen::MatrixXd rows(reactions_, model_.size() + scalars_);
  rows << eq_.g_y.bottomRows(reactions_), eq_.g_ydot.block(first, model_.scalar_start(), reactions_, scalars_);
  for (int k = 0; k < reactions_; ++k) {
    if (level_[static_cast<std::size_t>(scalars_ + k)] != Level::velocity) continue;
    // A velocity does not depend on the positions that turn it.
    rows.row(k).head(model_.own_start()) = eq_.g_ydot.row(first + k).head(model_.own_start());
  }
  return rows;
}

// Constraints that follow from the others: left out of the equations, their reactions zero. Those with the largest
// part in the dependencies, so that the others stay independent as long as can be.
void IdaEquations::find_redundant() {
  redundant_.clear();
  if (reactions_ == 0) return;
  const Eigen::MatrixXd basis = dependencies(constraint_rows(), redundancy_);
  if (basis.cols() == 0) return;
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(basis.transpose());
  for (Eigen::Index k = 0; k < basis.cols(); ++k) {
    redundant_.push_back(scalars_ + static_cast<int>(qr.colsPermutation().indices()(k)));
  }
  part_ = std::abs(qr.matrixQR()(basis.cols() - 1, basis.cols() - 1));
}

// True if the constraints left out have become the wrong ones.
bool IdaEquations::misses() const {
  if (redundant_.empty()) return false;
  const Eigen::MatrixXd basis = dependencies(constraint_rows(), redundancy_);
  const auto count = static_cast<Eigen::Index>(redundant_.size());
  if (basis.cols() != count) return basis.cols() < count;
  Eigen::MatrixXd chosen(count, count);
  for (Eigen::Index k = 0; k < count; ++k)
    chosen.row(k) = basis.row(redundant_[static_cast<std::size_t>(k)] - scalars_);
  return Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(chosen).matrixQR().diagonal().cwiseAbs().minCoeff() <
         kSmallerPart * part_;
}

// Constraints that are left out as redundant must go on following from the others.
void IdaEquations::check_agreement() {
  if (redundant_.empty()) return;
  eq_.clear(model_.size(), false);
  model_.add_reduced_constraints(state_, eq_, false);
  int row = -1;
  for (int k = scalars_; k < own_; ++k) {
    const int candidate = model_.scalar_start() + k;
    if (level_[static_cast<std::size_t>(k)] == Level::none) continue;
    if (row < 0 || !(std::abs(eq_.g(candidate)) <= std::abs(eq_.g(row)))) row = candidate;
  }
  if (row < 0 || std::abs(eq_.g(row)) <= kConstraintTolerance) return;
  std::ostringstream out;
  out << "at t = " << time_text(state_.t) << " s " << model_.equation_title(row)
      << " contradicts the other constraints: the position nearest to all of them leaves " << eq_.g(row) << " "
      << model_.equation_unit(row) << " of it open; remove a redundant constraint or make the drives agree";
  throw NotConverged(out.str());
}

// The reactions of smallest norm that do the same everywhere.
void IdaEquations::share_loads() {
  eq_.clear(model_.size(), true);
  model_.add_reduced_constraints(state_, eq_, true);
  Eigen::MatrixXd B(motions_ + own_, reactions_);
  for (const MotionGroup& group : model_.motions()) {
    B.middleRows(group.motion, group.count) =
        eq_.g_y.block(group.force, model_.reaction_start(), group.count, reactions_);
  }
  B.bottomRows(own_) = eq_.g_y.block(model_.scalar_start(), model_.reaction_start(), own_, reactions_);
  state_.y.tail(reactions_) = B.completeOrthogonalDecomposition().solve(B * state_.y.tail(reactions_)).eval();
}

}  // namespace mbdae::ida_detail
