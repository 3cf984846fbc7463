// Writes docs/io_formats/motion.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/output/hdf5_file.h"
#include "mbdae/output/provenance.h"

namespace mbdae {

/// How a time history was made.
struct Integration {
  std::string integrator;  ///< "ida" or "ms"
  double rtol = 0.0, atol = 0.0;
};

/// Writes `motion` to `path`, all or nothing. Throws FileError.
void write_motion_file(const std::string& path, const Motion& motion, const Integration& integration,
                       const Provenance& provenance);

}  // namespace mbdae
