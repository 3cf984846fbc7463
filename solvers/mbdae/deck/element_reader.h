// Cards of the nodes and elements blocks and the reference card. Each reads to the end of its card.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

void read_reference(Context& context);
void read_structural(Context& context);
void read_body(Context& context);
void read_gravity(Context& context);
void read_force(Context& context, bool couple);
void read_joint(Context& context);

/// `output, yes|no` if it is there; true if it was.
bool skip_output(Input& input);

}  // namespace mbdae::reading
