// Where a result file comes from: the program and the deck.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace mbdae {

struct Provenance {
  std::string solver;       ///< name and version, `mbdae 1.0.0`
  std::string deck_sha256;  ///< 64 hexadecimal digits
};

/// SHA-256 of `text` as 64 lower-case hexadecimal digits (FIPS 180-4).
std::string sha256_hex(std::string_view text);

}  // namespace mbdae
