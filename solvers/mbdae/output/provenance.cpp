// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/output/provenance.h"

#include <array>

namespace mbdae {

void write_header(Hdf5Group& root, const std::string& filetype, const std::array<int, 2>& version,
                  const Provenance& provenance) {
  root.attribute("filetype", filetype);
  root.attribute("version", version);
  root.attribute("solver", provenance.solver);
  root.attribute("deck_sha256", provenance.deck_sha256);
}

}  // namespace mbdae
