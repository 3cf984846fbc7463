// Times at which drives or their derivatives jump: where an integration has to end and to start again.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mbdae/deck/deck.h"

namespace mbdae {

/// Between these neighbouring times [s] the drives change from one smooth piece to the next.
struct Jump {
  double before = 0.0, after = 0.0;
};

/// The jumps from the initial time on, in order. They are looked for between time steps and between the times that
/// drives know beforehand; two of one drive that undo each other within one time step are not seen.
std::vector<Jump> find_jumps(const std::vector<DrivePtr>& drives, const InitialValueData& settings);

}  // namespace mbdae
