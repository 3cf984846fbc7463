// A state that satisfies the equations: constraints checked, accelerations and reactions solved for.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "mbdae/model/model.h"

namespace mbdae {

/// Largest violation that a deck's configuration [m, rad, -] or velocity [m/s, rad/s] may have.
inline constexpr double kConstraintTolerance = 1e-6;

/// Throws ModelError, naming joint, component and amount, if the state violates a constraint or its time derivative.
void check_constraints(const Model& model, const State& state);

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
