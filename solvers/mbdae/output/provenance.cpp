// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/provenance.h"

#include <openssl/evp.h>

#include <array>
#include <stdexcept>

namespace mbdae {

void write_header(Hdf5Group& root, const std::string& filetype, const std::array<int, 2>& version,
                  const Provenance& provenance) {
  root.attribute("filetype", filetype);
  root.attribute("version", version);
  root.attribute("solver", provenance.solver);
  root.attribute("deck_sha256", provenance.deck_sha256);
}

std::string sha256_hex(std::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  if (EVP_Digest(text.data(), text.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) {
    throw std::runtime_error("the cryptographic library computes no SHA-256");
  }
  constexpr char kDigits[] = "0123456789abcdef";
  std::string hex;
  hex.reserve(2 * static_cast<std::size_t>(size));
  for (unsigned int i = 0; i < size; ++i) {
    hex += kDigits[digest[i] >> 4];
    hex += kDigits[digest[i] & 15];
  }
  return hex;
}

}  // namespace mbdae
