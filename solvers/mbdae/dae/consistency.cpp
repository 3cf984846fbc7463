// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/consistency.h"

#include <cmath>
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
  try {
    return Model(deck);
  } catch (const std::invalid_argument& error) {
    throw ModelError(error.what());
  }
}

void check_constraints(const Model& model, const State& state) {
  Equations eq;
  eq.clear(model.size(), false);
  model.add_constraints(state, eq, false);
  ConstraintRates rates;
  model.rates(state, rates, false);
  for (const LoadEntry& entry : model.loads()) {
    if (const std::string defect = entry.element->defect(state); !defect.empty()) {
      throw ModelError(joint_title(*entry.data) + " " + defect);
    }
  }

  int worst = -1;
  double value = 0.0;
  const int first = model.reaction_start(), count = model.reaction_count();
  if (count == 0) return;
  const double violation = eq.g.tail(count).cwiseAbs().maxCoeff(&worst);
  if (!(violation <= kConstraintTolerance)) {
    value = eq.g(first + worst);
    throw ModelError(model.equation_title(first + worst) + " is violated by " +
                     amount(value, model.equation_unit(first + worst)) + " (at most " +
                     amount(kConstraintTolerance, "") +
                     "allowed): correct the node positions and orientations or the joint's geometry");
  }
  const double speed = rates.rate.tail(count).cwiseAbs().maxCoeff(&worst);
  if (!(speed <= kConstraintTolerance)) {
    value = rates.rate(first + worst);
    throw ModelError("the initial velocities violate " + model.equation_title(first + worst) + " by " +
                     amount(value, model.equation_unit(first + worst) + "/s") +
                     ": give the nodes velocities that match, or a drive that starts with zero rate");
  }
}

Eigen::VectorXd solve_accelerations(const Model& model, State& state) {
  const int nodes = static_cast<int>(model.slots().size()), moving = 6 * nodes;
  const int first = model.reaction_start(), count = model.reaction_count();
  const int total = moving + count;

  State unloaded = state;
  unloaded.y.setZero();
  Equations eq;
  eq.clear(model.size(), true);
  model.add_loads(unloaded, eq, false);
  model.add_constraints(unloaded, eq, true);
  ConstraintRates rates;
  model.rates(state, rates, false);

  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(total, total);
  Eigen::VectorXd rhs(total);
  bool inertia = false;
  for (int i = 0; i < nodes; ++i) {
    const NodeSlot& slot = model.slots()[static_cast<std::size_t>(i)];
    const int row = 6 * i;
    rhs.segment<6>(row) = -eq.g.segment<6>(slot.force);
    if (slot.dynamic) {
      const NodeInertia& body = model.inertias()[static_cast<std::size_t>(i)];
      const NodeMotion& motion = state.nodes[static_cast<std::size_t>(i)];
      K.block<6, 6>(row, row) = body.mass_matrix(motion);
      rhs.segment<6>(row) -= body.velocity_terms(motion);
      inertia = true;
    }
    K.block(row, moving, 6, count) = eq.g_y.block(slot.force, first, 6, count);
    K.block(moving, row, count, 6) = eq.g_y.block(first, slot.first, count, 6);
  }
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int k = 0; k < entry.constraint->size(); ++k) {
      if (!entry.constraint->velocity_level(k)) continue;
      const int row = entry.constraint->first() + k;
      for (int i = 0; i < nodes; ++i) {
        const int column = 6 * i;
        K.block<1, 6>(moving + row - first, column) =
            eq.g_ydot.block<1, 6>(row, model.slots()[static_cast<std::size_t>(i)].first);
      }
    }
  }
  rhs.tail(count) = -rates.bias.tail(count);

  if (!inertia) {
    if (count > 0) {
      state.y.tail(count) = K.topRightCorner(moving, count).completeOrthogonalDecomposition().solve(rhs.head(moving));
    }
    return Eigen::VectorXd::Zero(moving);
  }

  const Eigen::VectorXd solution = robust_solve(K, rhs);
  state.y.tail(count) = solution.tail(count);
  const Eigen::VectorXd error = (K * solution - rhs).tail(count);
  int worst = 0;
  if (count > 0 && error.cwiseAbs().maxCoeff(&worst) > kConstraintTolerance * (1.0 + solution.head(moving).norm())) {
    throw ModelError(model.equation_title(first + worst) +
                     " contradicts the other constraints: the accelerations they ask for differ by " +
                     amount(error(worst), model.equation_unit(first + worst) + "/s^2") +
                     "; remove a redundant constraint or make the drives agree");
  }
  return solution.head(moving);
}

}  // namespace mbdae
