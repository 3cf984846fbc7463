// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/provenance.h"

#include <sha2.h>  // libmd

#include <array>
#include <cstdint>

namespace mbdae {

void write_header(Hdf5Group& root, const std::string& filetype, const std::array<int, 2>& version,
                  const Provenance& provenance) {
  root.attribute("filetype", filetype);
  root.attribute("version", version);
  root.attribute("solver", provenance.solver);
  root.attribute("deck_sha256", provenance.deck_sha256);
}

std::string sha256_hex(std::string_view text) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256Data(reinterpret_cast<const std::uint8_t*>(text.data()), text.size(), hex.data());
  return {hex.data(), SHA256_DIGEST_STRING_LENGTH - 1};
}

}  // namespace mbdae
