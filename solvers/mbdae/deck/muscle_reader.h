// The muscle law of module-muscles.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

/// Reads what follows `muscle,`; `where` is the position of that word.
MuscleLaw read_muscle(Context& context, const SourcePosition& where);

}  // namespace mbdae::reading
