// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/consistency.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/linear_algebra.h"

namespace mbdae {

namespace {

std::string amount(double value, const std::string& unit) {
  std::ostringstream out;
  out.precision(3);
  out << value << " " << unit;
  return out.str();
}

}  // namespace

Model make_model(const Deck& deck) {
  constexpr int kMostUnknowns = 5000;  // a dense matrix of that size has 200 MB
  if (deck.nodes.empty() && deck.abstract_nodes.empty())
    throw ModelError("the deck has no nodes: there is nothing to analyse");
  try {
    Model model(deck);
    if (model.size() > kMostUnknowns) {
      throw ModelError("the deck has " + std::to_string(model.size()) + " unknowns; the matrices here are dense, and " +
                       std::to_string(kMostUnknowns) + " are the most they can have");
    }
    return model;
  } catch (const std::invalid_argument& error) {
    throw ModelError(error.what());
  }
}

namespace {

constexpr double kClosed = 1e-13;  // violation left at which closing stops [m, rad]
constexpr int kClosingSteps = 30;
// A constraint that follows from others at the closed configuration does so only nearly beside it.
constexpr double kDependent = 1e-5;

/// Constraint matrix by the variations of the nodes, 6 columns each. Rows at velocity level are zero without
/// `velocities`.
Eigen::MatrixXd constraint_matrix(const Model& model, const Equations& eq, bool velocities) {
  const int first = model.reaction_start(), count = model.reaction_count();
  Eigen::MatrixXd Phi(count, 6 * static_cast<Eigen::Index>(model.slots().size()));
  for (std::size_t i = 0; i < model.slots().size(); ++i) {
    Phi.middleCols<6>(6 * static_cast<Eigen::Index>(i)) = eq.g_y.block(first, model.slots()[i].first, count, 6);
  }
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      if (!entry.constraint->velocity_level(k)) continue;
      const int row = entry.constraint->first() + k;
      Phi.row(row - first).setZero();
      for (std::size_t i = 0; velocities && i < model.slots().size(); ++i) {
        Phi.block<1, 6>(row - first, 6 * static_cast<Eigen::Index>(i)) =
            eq.g_ydot.block<1, 6>(row, model.slots()[i].first);
      }
    }
  }
  return Phi;
}

/// Violations at position level; rows at velocity level are zero.
Eigen::VectorXd position_error(const Model& model, const Equations& eq) {
  const int first = model.reaction_start();
  Eigen::VectorXd error = eq.g.tail(model.reaction_count());
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      if (entry.constraint->velocity_level(k)) error(entry.constraint->first() + k - first) = 0.0;
    }
  }
  return error;
}

// What genels impose is brought about by the first time step, as in MBDyn.
void forget_genels(const Model& model, Equations& eq, ConstraintRates& rates) {
  for (const ConstraintEntry& entry : model.constraints()) {
    if (entry.data->type->card != CardKind::genel) continue;
    eq.g.segment(entry.constraint->first(), entry.constraint->size()).setZero();
    rates.rate.segment(entry.constraint->first(), entry.constraint->size()).setZero();
  }
}

/// What the velocities violate: rates of constraints at position level, constraints at velocity level themselves.
Eigen::VectorXd velocity_error(const Model& model, const State& state, Equations& eq, bool tangent) {
  ConstraintRates rates;
  eq.clear(model.size(), tangent);
  model.add_reduced_constraints(state, eq, tangent);
  model.rates(state, rates, false);
  forget_genels(model, eq, rates);
  return rates.rate.tail(model.reaction_count()) + eq.g.tail(model.reaction_count()) - position_error(model, eq);
}

// Leaves out what no motion of the nodes can close: constraints of states alone, and what genels impose.
void leave_others(const Model& model, const Eigen::MatrixXd& Phi, Eigen::VectorXd& error) {
  for (const ConstraintEntry& entry : model.constraints()) {
    const bool genel = entry.data->type->card == CardKind::genel;
    for (int k = 0; k < entry.constraint->size(); ++k) {
      const int row = entry.constraint->first() + k - model.reaction_start();
      if (genel || Phi.row(row).isZero(0.0)) error(row) = 0.0;
    }
  }
}

/// Refuses an equation that has no finite value.
void require_number(const Model& model, int row, double value) {
  if (!std::isfinite(value)) throw ModelError(model.equation_off(row, value) + ": " + kLookForNoNumber);
}

void note_worst(const Model& model, const Eigen::VectorXd& error, Correction* out) {
  const Eigen::Index worst = worst_of(error);
  out->worst = model.reaction_start() + static_cast<int>(worst);
  out->violation = error(worst);
}

}  // namespace

Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> shortest_solution(const Eigen::MatrixXd& Phi) {
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> out;
  out.setThreshold(kDependent);
  out.compute(Phi);
  return out;
}

void check_constraints(const Model& model, const State& state, bool velocities) {
  Equations eq;
  eq.clear(model.size(), false);
  model.add_reduced_constraints(state, eq, false);
  ConstraintRates rates;
  model.rates(state, rates, false);
  const auto check = [&](const ElementData& data, const Element& element) {
    if (const std::string defect = element.defect(state); !defect.empty()) {
      throw ModelError(joint_title(data) + " " + defect);
    }
  };
  for (const LoadEntry& entry : model.loads()) check(*entry.data, *entry.element);
  for (const ConstraintEntry& entry : model.constraints()) check(*entry.data, *entry.constraint);

  forget_genels(model, eq, rates);

  const int first = model.reaction_start(), count = model.reaction_count();
  if (count == 0) return;
  const Eigen::VectorXd error = velocities ? Eigen::VectorXd(eq.g.tail(count)) : position_error(model, eq);
  auto worst = static_cast<int>(worst_of(error));
  if (!(std::abs(error(worst)) <= kConstraintTolerance)) {
    const double value = eq.g(first + worst);
    require_number(model, first + worst, value);
    throw ModelError(model.equation_title(first + worst) + " is violated by " +
                     amount(value, model.equation_unit(first + worst)) + " (at most " +
                     amount(kConstraintTolerance, "") +
                     "allowed): correct the node positions and orientations or the joint's geometry");
  }
  if (!velocities) return;
  worst = static_cast<int>(worst_of(rates.rate.tail(count)));
  const double speed = rates.rate(first + worst);
  if (!(std::abs(speed) <= kConstraintTolerance)) {
    require_number(model, first + worst, speed);
    throw ModelError("the initial velocities violate " + model.equation_title(first + worst) + " by " +
                     amount(speed, model.equation_unit(first + worst) + "/s") +
                     ": give the nodes velocities that match, or a drive that starts with zero rate");
  }
}

Correction close_constraints(Model& model, State& state) {
  Correction out;
  if (model.reaction_count() == 0) return out;
  const std::vector<NodeMotion> start = state.nodes;
  const Eigen::Index moving = 6 * static_cast<Eigen::Index>(start.size());
  Equations eq;
  double before = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kClosingSteps; ++i) {
    model.set_reference(state);
    eq.clear(model.size(), true);
    State unloaded = state;
    unloaded.y.tail(model.reaction_count()).setZero();  // the constraints alone; their drives may read the other states
    model.add_reduced_constraints(unloaded, eq, true);
    const Eigen::MatrixXd Phi = constraint_matrix(model, eq, false);
    Eigen::VectorXd error = position_error(model, eq);
    leave_others(model, Phi, error);
    if (i == 0) note_worst(model, error, &out);
    out.left = error.cwiseAbs().maxCoeff();
    if (!(out.left > kClosed) || out.left >= before) return out;  // closed, or as far as round-off lets it
    before = out.left;
    // The displacement from the start stays as short as it can: only what the constraints ask for.
    Eigen::VectorXd gone(moving);
    for (std::size_t k = 0; k < start.size(); ++k) {
      gone.segment<3>(6 * static_cast<Eigen::Index>(k)) = state.nodes[k].x - start[k].x;
      gone.segment<3>(6 * static_cast<Eigen::Index>(k) + 3) = rotation_log(state.nodes[k].R * start[k].R.transpose());
    }
    const Eigen::VectorXd step = -gone - shortest_solution(Phi).solve(error - Phi * gone);
    out.moved = (gone + step).cwiseAbs().maxCoeff();
    for (std::size_t k = 0; k < start.size(); ++k) {
      state.nodes[k].x += step.segment<3>(6 * static_cast<Eigen::Index>(k));
      state.nodes[k].R = rotation_exp(step.segment<3>(6 * static_cast<Eigen::Index>(k) + 3)) * state.nodes[k].R;
    }
  }
  return out;
}

std::string contradiction_text(const Model& model, const Correction& correction, double t) {
  std::ostringstream out;
  out << "at t = " << t << " s " << violated(model, correction, false)
      << ", and no position closes it: it contradicts the other constraints; remove a redundant constraint or make the "
         "drives agree";
  return out.str();
}

std::string contradiction(Model& model, State state, double t) {
  state.t = t;
  const Correction positions = close_constraints(model, state);
  return positions.left <= kConstraintTolerance ? "" : contradiction_text(model, positions, t);
}

Correction match_velocities(const Model& model, State& state) {
  Correction out;
  if (model.reaction_count() == 0) return out;
  Equations eq;
  const Eigen::VectorXd error = velocity_error(model, state, eq, true);
  note_worst(model, error, &out);
  const Eigen::VectorXd change = shortest_solution(constraint_matrix(model, eq, true)).solve(error);
  out.moved = change.cwiseAbs().maxCoeff();
  for (std::size_t k = 0; k < state.nodes.size(); ++k) {
    state.nodes[k].v -= change.segment<3>(6 * static_cast<Eigen::Index>(k));
    state.nodes[k].w -= change.segment<3>(6 * static_cast<Eigen::Index>(k) + 3);
  }
  model.set_momenta(state);
  out.left = velocity_error(model, state, eq, false).cwiseAbs().maxCoeff();
  return out;
}

std::string violated(const Model& model, const Correction& correction, bool velocity) {
  std::string unit = model.equation_unit(correction.worst);
  if (velocity && unit.find("/s") == std::string::npos) unit += "/s";
  return model.equation_title(correction.worst) + " is open by " + amount(correction.violation, unit);
}

State consistent_state(Model& model, std::vector<std::string>& notes) {
  State state = model.initial_state();
  model.set_reference(state);
  const bool find_velocities = !model.deck().control.skip_initial_joint_assembly;
  check_constraints(model, state, !find_velocities);
  if (!find_velocities || model.reaction_count() == 0) return state;
  Equations eq;  // most decks start at rest: no need to look for velocities
  const Eigen::VectorXd open = velocity_error(model, state, eq, false);
  const Eigen::Index worst = worst_of(open);
  require_number(model, model.reaction_start() + static_cast<int>(worst), open(worst));
  if (std::abs(open(worst)) <= kConstraintTolerance) return state;
  State matched = state;
  const Correction velocities = match_velocities(model, matched);
  if (!(std::abs(velocities.violation) > kConstraintTolerance)) return state;
  if (!(velocities.left <= kConstraintTolerance)) {
    throw ModelError("the initial velocities violate the constraints: " + violated(model, velocities, true) +
                     ", and there are none that satisfy all constraints: make the drives agree");
  }
  notes.push_back("the initial velocities violate the constraints: " + violated(model, velocities, true) +
                  "; the nearest that do not violate them are used (changed by at most " +
                  amount(velocities.moved, "m/s or rad/s") + ")");
  return matched;
}

namespace {

// Unknowns of the accelerations' equations: coordinates of motion, then scalars (rates of states, values of algebraic
// ones), then reactions.
struct Accelerations {
  Eigen::MatrixXd K;
  Eigen::VectorXd residual;  // at accelerations, rates and reactions of `state` and `a`
};

// Rows that constrain the motion but belong to a scalar or to states alone: what their first time derivative says.
void differentiate_row(const Model& model, const State& state, const Equations& eq, int row, Accelerations& out,
                       int at) {
  const int moving = model.motion_count(), first = model.scalar_start();
  out.residual(at) = 0.0;
  for (const NodeSlot& slot : model.slots()) {
    const NodeMotion& node = motion_of(state, slot);
    out.K.block<1, 6>(at, 6 * slot.index) = eq.g_ydot.block<1, 6>(row, slot.first);
    out.residual(at) +=
        eq.g_y.block<1, 3>(row, slot.first).dot(node.v) + eq.g_y.block<1, 3>(row, slot.first + 3).dot(node.w);
  }
  for (int k = 0; k < model.scalar_count(); ++k) {
    if (model.algebraic(first + k)) continue;
    out.K(at, moving + k) = eq.g_y(row, first + k);
    out.residual(at) += eq.g_y(row, first + k) * state.ydot(first + k);
  }
}

Accelerations acceleration_equations(const Model& model, const State& state, const Eigen::VectorXd& a,
                                     const ConstraintRates& rates) {
  const int moving = model.motion_count(), scalars = model.scalar_count();
  const int first_scalar = model.scalar_start(), first = model.reaction_start(), count = model.reaction_count();
  const int start = moving + scalars, total = start + count;
  Equations eq;
  eq.clear(model.size(), true);
  model.add_loads(state, eq, scalars > 0);
  model.add_reduced_constraints(state, eq, true);

  Accelerations out;
  out.K = Eigen::MatrixXd::Zero(total, total);
  out.residual = Eigen::VectorXd::Zero(total);
  Eigen::MatrixXd& K = out.K;
  K.topLeftCorner(moving, moving) = model.mass_matrix(state);
  out.residual.head(moving) = model.velocity_terms(state);
  if (scalars > 0) out.residual.head(moving) += K.topLeftCorner(moving, moving) * a;
  for (const MotionGroup& group : model.motions()) {
    const int n = group.count;
    out.residual.segment(group.motion, n) += eq.g.segment(group.force, n);
    K.block(group.motion, start, n, count) = eq.g_y.block(group.force, first, n, count);
    K.block(start, group.motion, count, n) = eq.g_y.block(first, group.pose, count, n);
    for (int k = 0; k < scalars; ++k) {
      const Eigen::MatrixXd& by = model.algebraic(first_scalar + k) ? eq.g_y : eq.g_ydot;
      K.block(group.motion, moving + k, n, 1) = by.block(group.force, first_scalar + k, n, 1);
    }
  }
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      if (!entry.constraint->velocity_level(k)) continue;
      const int row = entry.constraint->first() + k;
      for (const MotionGroup& group : model.motions()) {
        K.block(start + row - first, group.motion, 1, group.count) = eq.g_ydot.block(row, group.pose, 1, group.count);
      }
    }
  }
  out.residual.tail(count) = rates.bias.tail(count);
  if (scalars == 0) return out;

  out.residual.tail(count) += K.block(start, 0, count, moving) * a;
  for (int k = 0; k < scalars; ++k) {
    const int row = first_scalar + k, at = moving + k;
    out.residual(at) = eq.g(row);
    for (int j = 0; j < scalars; ++j) {
      K(at, moving + j) = (model.algebraic(first_scalar + j) ? eq.g_y : eq.g_ydot)(row, first_scalar + j);
    }
    K.block(at, start, 1, count) = eq.g_y.block(row, first, 1, count);
    if (K.row(at).isZero(0.0)) differentiate_row(model, state, eq, row, out, at);
  }
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      const int row = entry.constraint->first() + k, at = start + row - first;
      const bool of_nodes = !K.block(at, 0, 1, moving).isZero(0.0);
      bool with_rates = false;
      for (int j = 0; j < scalars; ++j) with_rates |= eq.g_ydot(row, first_scalar + j) != 0.0;
      if (with_rates) {  // imposes the rate of a state
        K.row(at).setZero();
        for (int j = 0; j < scalars; ++j) {
          K(at, moving + j) = (model.algebraic(first_scalar + j) ? eq.g_y : eq.g_ydot)(row, first_scalar + j);
        }
        out.residual(at) = eq.g(row);
      } else if (!of_nodes) {  // imposes a state, or an algebraic value
        bool of_states = false;
        for (int j = 0; j < scalars; ++j) {
          const double by = eq.g_y(row, first_scalar + j);
          K(at, moving + j) = by;
          of_states |= by != 0.0 && !model.algebraic(first_scalar + j);
        }
        out.residual(at) = of_states ? rates.rate(row) : eq.g(row);
      } else if (entry.constraint->velocity_level(k)) {
        for (int j = 0; j < scalars; ++j) {
          if (model.algebraic(first_scalar + j)) continue;
          K(at, moving + j) = eq.g_y(row, first_scalar + j);
          out.residual(at) += eq.g_y(row, first_scalar + j) * state.ydot(first_scalar + j);
        }
      }
    }
  }
  return out;
}

}  // namespace

Eigen::VectorXd solve_accelerations(const Model& model, State& state) {
  constexpr int kMostIterations = 20;
  constexpr double kConverged = 1e-13;
  const int moving = model.motion_count(), scalars = model.scalar_count();
  const int first_scalar = model.scalar_start(), first = model.reaction_start(), count = model.reaction_count();
  const int start = moving + scalars;
  bool inertia = scalars > 0 || !model.flexible().empty();
  for (const NodeSlot& slot : model.slots()) inertia |= slot.has_rates();

  // Linear in everything asked for, but for friction: one step of Newton's method otherwise.
  state.y.head(model.own_start()).setZero();
  state.y.tail(count).setZero();
  model.set_momenta(state);
  Eigen::VectorXd a = Eigen::VectorXd::Zero(moving);
  for (int iteration = 0; iteration < kMostIterations; ++iteration) {
    ConstraintRates rates;
    model.rates(state, rates, false);
    const Accelerations equations = acceleration_equations(model, state, a, rates);
    if (!inertia) {
      if (count > 0) {
        state.y.tail(count) = equations.K.topRightCorner(moving, count)
                                  .completeOrthogonalDecomposition()
                                  .solve(-equations.residual.head(moving));
      }
      return Eigen::VectorXd::Zero(moving);
    }
    const Eigen::VectorXd rhs = -equations.residual;
    const Eigen::VectorXd solution = robust_solve(equations.K, rhs);
    state.y.tail(count) += solution.tail(count);
    a += solution.head(moving);
    for (int k = 0; k < scalars; ++k) {
      (model.algebraic(first_scalar + k) ? state.y : state.ydot)(first_scalar + k) += solution(moving + k);
    }
    const Eigen::VectorXd error = (equations.K * solution - rhs).tail(count);
    int worst = 0;
    if (count > 0 && error.cwiseAbs().maxCoeff(&worst) > kConstraintTolerance * (1.0 + solution.head(moving).norm())) {
      throw ModelError(model.equation_title(first + worst) +
                       " contradicts the other constraints: the accelerations they ask for differ by " +
                       amount(error(worst), model.equation_unit(first + worst) + "/s^2") +
                       "; remove a redundant constraint or make the drives agree");
    }
    if (scalars == 0) break;
    const double size = 1.0 + a.norm() + state.y.tail(count).norm() + state.ydot.segment(first_scalar, scalars).norm();
    if (solution.segment(0, start + count).norm() <= kConverged * size) break;
  }
  for (const ConstraintEntry& entry : model.constraints()) {
    if (const std::string defect = entry.constraint->defect_under_load(state); !defect.empty()) {
      throw ModelError(joint_title(*entry.data) + " " + defect);
    }
  }
  return a;
}

void solve_state_rates(const Model& model, State& state) {
  const int first = model.scalar_start(), count = model.scalar_count();
  if (count == 0) return;
  Equations eq;
  eq.clear(model.size(), true);
  model.add_loads(state, eq, true);
  model.add_constraints(state, eq, true);
  const Eigen::MatrixXd E = eq.g_ydot.block(first, first, count, count);
  state.ydot.segment(first, count) -= E.completeOrthogonalDecomposition().solve(eq.g.segment(first, count));
}

Eigen::VectorXd modal_accelerations(const Model& model, const State& state) {
  std::vector<int> moving, equations;
  const std::size_t nodes = model.slots().size();
  for (std::size_t i = 0; i < model.motions().size(); ++i) {
    if (i < nodes && !model.slots()[i].modal) continue;
    const MotionGroup& group = model.motions()[i];
    for (int k = 0; k < group.count; ++k) {
      moving.push_back(group.motion + k);
      equations.push_back(group.force + k);
    }
  }
  Eigen::VectorXd out = Eigen::VectorXd::Zero(model.motion_count());
  if (moving.empty()) return out;
  Equations eq;
  model.assemble_statics(state, eq, false);
  const Eigen::VectorXd force = -eq.g(equations) - model.velocity_terms(state)(moving);
  const Eigen::MatrixXd M = model.mass_matrix(state)(moving, moving);
  out(moving) = M.completeOrthogonalDecomposition().solve(force).eval();
  return out;
}

}  // namespace mbdae
