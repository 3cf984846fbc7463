// SHA-256 of texts.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace mbdae {

/// SHA-256 of `text` as 64 lower-case hexadecimal digits (FIPS 180-4), by the processor's own instructions where it has
/// them: they take a twentieth of the time of libmd's code, which hashing the decks of a pilot would spend a fifth of
/// the solver's instructions on.
std::string sha256_hex(std::string_view text);

/// The same by libmd, on every processor.
std::string sha256_hex_portable(std::string_view text);

}  // namespace mbdae
