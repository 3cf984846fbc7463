// Cards of the data, initial value and control data blocks. Each reads to the end of its card.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

void read_data_card(Context& context, const Words& card);
void read_initial_value_card(Context& context, const Words& card);
void read_control_data_card(Context& context, const Words& card);

/// After `end: initial value;`: what is missing or contradicts itself.
void check_initial_value(Context& context, const SourcePosition& where);
/// After the elements: announced and found numbers of entities.
void check_counts(Context& context);

}  // namespace mbdae::reading
