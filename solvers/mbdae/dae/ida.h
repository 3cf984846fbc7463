// Time integration by SUNDIALS IDA on the stabilised index-2 form of the equations of motion.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/dae/analyses.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// Time history from a consistent state. `accelerations`: 6 per node, as solve_accelerations returns them.
Motion integrate_ida(Model& model, const State& state, const Eigen::VectorXd& accelerations,
                     const InitialValueData& settings, const IntegrateOptions& options);

}  // namespace mbdae
