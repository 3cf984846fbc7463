// Where a result file comes from: the program and the deck.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string>
#include <string_view>

#include "mbdae/output/hdf5_file.h"

namespace mbdae {

struct Provenance {
  std::string solver;       ///< name and version, `mbdae 1.0.0`
  std::string deck_sha256;  ///< 64 hexadecimal digits
};

/// Writes what every result file begins with: its type, the version of its format (major, minor), and where it is from.
void write_header(Hdf5Group& root, const std::string& filetype, const std::array<int, 2>& version,
                  const Provenance& provenance);

/// SHA-256 of `text` as 64 lower-case hexadecimal digits (FIPS 180-4).
std::string sha256_hex(std::string_view text);

}  // namespace mbdae
