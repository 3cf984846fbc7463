// Two-step implicit integration with a chosen asymptotic spectral radius (`ms`), implicit Euler, Crank-Nicolson.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/dae/analyses.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// y_k = a1 y_{k-1} + a2 y_{k-2} + h (b0 y'_k + b1 y'_{k-1} + b2 y'_{k-2})
struct MultistepCoefficients {
  double a1, a2, b0, b1, b2;
};

/// Second order, both roots at infinity equal to -rho. 0 <= rho <= 1; rho = 0 is BDF2. docs/theory/integration.md.
MultistepCoefficients multistep_coefficients(double rho);

/// Time history by the deck's method from a consistent state (accelerations in `state.ydot`).
Motion integrate_multistep(Model& model, const State& state, const InitialValueData& settings,
                           const IntegrateOptions& options, const AtInstant& at_instant = {});

}  // namespace mbdae
