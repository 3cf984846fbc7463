// A state that satisfies the equations: constraints checked, accelerations and reactions solved for.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

#include "mbdae/dae/linear_algebra.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// Largest violation that a deck's configuration [m, rad, -] or velocity [m/s, rad/s] may have.
inline constexpr double kConstraintTolerance = 1e-6;

/// Throws ModelError, naming joint, component and amount, if the state violates a constraint; with `velocities` also if
/// it violates a time derivative.
void check_constraints(const Model& model, const State& state, bool velocities = true);

/// How far a state was from satisfying the constraints, and what was done about it.
struct Correction {
  int worst = -1;          ///< equation with the largest violation, -1 if there are no constraints
  double violation = 0.0;  ///< of that equation, before
  double left = 0.0;       ///< largest violation after the correction
  double moved = 0.0;      ///< largest change of a position or rotation [m, rad] (velocity: [m/s, rad/s])
};

/// Solves Phi x = b with the shortest x, for constraint matrices near a configuration that satisfies the constraints:
/// what is dependent there counts as dependent here.
Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> shortest_solution(const Eigen::MatrixXd& Phi);

/// Moves the nodes to the nearest configuration that closes the constraints, distances and angles counted alike.
Correction close_constraints(Model& model, State& state);

/// Changes the velocities as little as the constraints' rates ask for, momenta with them.
Correction match_velocities(const Model& model, State& state);

/// `constraint 1 of 3 of joint hinge (...) is open by 0.1 m` (velocity: `m/s`).
std::string violated(const Model& model, const Correction& correction, bool velocity);

/// What `close_constraints` left open at time t [s], said as the contradiction it is.
std::string contradiction_text(const Model& model, const Correction& correction, double t);

/// The same if no position near the state's satisfies the constraints at time t; empty if one does.
std::string contradiction(Model& model, State state, double t);

/// The deck's state ready for an analysis: checks the constraints, and finds velocities that satisfy them where the
/// deck's do not (unless it says `skip initial joint assembly`). Adds what it changed to `notes`.
State consistent_state(Model& model, std::vector<std::string>& notes);

/// Solves M a + B lambda = f, Phi a = -bias for accelerations and reactions; writes the reactions into state.y.
///
/// Redundant constraints get the reactions of minimum norm. Under `model: static` only B lambda = f is solved, in the
/// least squares sense. Returns accelerations of the coordinates of motion: 6 per node in deck order, then modal ones
/// (zero where nothing defines them) [m/s^2, rad/s^2]. Throws ModelError if the constraints contradict each other at
/// acceleration level.
Eigen::VectorXd solve_accelerations(const Model& model, State& state);

/// Solves the scalars' own equations for their rates, everything else given; nearest to the present rates where several
/// do.
void solve_state_rates(const Model& model, State& state);

/// Accelerations of modal nodes and modal displacements at the reactions of the state, the others zero: what makes
/// their equilibrium equations hold, of least size where the mass matrix is singular.
Eigen::VectorXd modal_accelerations(const Model& model, const State& state);

/// A model from a deck, bad decks as ModelError.
Model make_model(const Deck& deck);

}  // namespace mbdae
