// Time integration by SUNDIALS IDA on the stabilised index-2 form of the equations of motion.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/dae/analyses.h"
#include "mbdae/model/model.h"

namespace mbdae {

/// Time history from a state that satisfies the constraints to kConstraintTolerance.
///
/// Where drives jump, the integration ends and starts again behind the jump; it also starts again where the constraints
/// that were left out as redundant at its start cease to be.
Motion integrate_ida(Model& model, const State& state, const InitialValueData& settings,
                     const IntegrateOptions& options, const AtInstant& at_instant = {});

}  // namespace mbdae
