// Writes docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/output/hdf5_file.h"
#include "mbdae/output/provenance.h"

namespace mbdae {

/// Writes `model` to `path`, all or nothing. Throws FileError.
void write_matrices_file(const std::string& path, const LinearisedModel& model, const Provenance& provenance);

}  // namespace mbdae
