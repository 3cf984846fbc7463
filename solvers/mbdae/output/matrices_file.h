// Writes docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/output/hdf5_file.h"
#include "mbdae/output/provenance.h"

namespace mbdae {

/// Where the values of a dataset lie in a file: what reads the file next need not look for them.
struct DatasetPlace {
  const char* name;
  std::uint64_t offset;                   ///< first byte, a multiple of 8
  std::vector<std::uint64_t> dimensions;  ///< of 64-bit numbers; of a text its bytes
};

/// Writes `model` to `path`, all or nothing, and tells where the datasets are. Throws FileError.
std::vector<DatasetPlace> write_matrices_file(const std::string& path, const LinearisedModel& model,
                                              const Provenance& provenance);

}  // namespace mbdae
