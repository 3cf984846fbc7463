// The serve mode: docs/io_formats/serve.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mbdae {

/// Answers one request line with one reply line (neither with its end). Never throws on bad input.
std::string answer(const std::string& request);

/// Answers every line of descriptor `in` on descriptor `out` until the end of input or until nobody reads any more.
/// Returns the exit code.
int serve(int in, int out);

}  // namespace mbdae
