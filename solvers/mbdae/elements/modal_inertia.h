// Moments of mass of a body in modes, from the masses of its finite element nodes or as the file has them.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/elements/modal_data.h"
#include "mbdae/fem/fem_file.h"

namespace mbdae {

/// `kept`: the modes in use, counted from 0 in the file; `shapes`: per node, 6 x modes in use; `origin`: point that the
/// coordinates of the file are counted from [m]. Equations: docs/io_formats/fem.md.
ModalInertia modal_inertia(const FemFile& file, const std::vector<int>& kept,
                           const std::vector<Eigen::MatrixXd>& shapes, const Vec3& origin);

/// The second-order moments I9 of the modes in use.
std::vector<Mat3> modal_invariant_9(const FemFile& file, const std::vector<int>& kept,
                                    const std::vector<Eigen::MatrixXd>& shapes);

}  // namespace mbdae
