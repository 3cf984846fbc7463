// Linearises a model at a given state, with the names of everything: shared by the analyses `linearise` and `static`.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/dae/linearised_model.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// Tangent matrices, residuals, inputs and names at a state whose momenta and reactions are set. `accelerations`: of
/// the coordinates of motion; those of modal unknowns count.
LinearisedModel linearise_at_state(const Model& model, State& state, double c, const char* analysis,
                                   const Eigen::VectorXd& accelerations);

/// c [s] of the deck's eigenanalysis card (`parameter` / 2), 0.01 s without one.
double deck_coefficient(const Deck& deck);

}  // namespace mbdae
