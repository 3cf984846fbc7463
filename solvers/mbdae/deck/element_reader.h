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
/// `driven: label, DRIVE, { CARD: label, ... | existing: CARD, label };`: an element that is there while its drive is
/// not zero.
void read_driven(Context& context);

/// A joint, force or couple: what follows `joint:`, `force:`, `couple:`.
void read_element(Context& context, CardKind card);

/// `name, "...",` after a label, if it is there.
void skip_name(Input& input);

/// `output, yes|no` if it is there; true if it was.
bool skip_output(Input& input);

/// [, orientation description, t][, output, yes|no][, inverse dynamics, ...]
void skip_joint_options(Input& input);

}  // namespace mbdae::reading
