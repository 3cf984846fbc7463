// The function `sprintf` of the expression language, with one value.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mbdae/deck/value.h"

namespace mbdae::reading {

/// Writes `value` as the one conversion in `format` says (%d, %i, %e, %f, %g, %s with flags and at most two-digit
/// widths). Formats come from decks, so nothing else gets through; false with a reason in `problem` then.
bool format_text(const std::string& format, const Value<double>& value, std::string* out, std::string* problem);

}  // namespace mbdae::reading
