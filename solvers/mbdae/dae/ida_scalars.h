// Time integration by SUNDIALS IDA of models with scalars: abstract nodes, genels, friction, states of elements.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/dae/analyses.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// Time history from a consistent state. `accelerations`: 6 per node, as solve_accelerations returns them.
///
/// Where friction changes between stuck and sliding the integration ends and starts again in the other mode.
Motion integrate_ida_with_scalars(Model& model, const State& state, const Eigen::VectorXd& accelerations,
                                  const InitialValueData& settings, const IntegrateOptions& options);

}  // namespace mbdae
