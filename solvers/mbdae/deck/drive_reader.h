// Drives (scalar functions of time) and template drives (vectors of them).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"
#include "mbdae/deck/geometry.h"

namespace mbdae::reading {

DrivePtr read_drive(Context& context);

/// `drive caller: label, [name, "...",] drive;`
void read_drive_caller(Context& context);

/// A vector drive. With a `place`, the single entity may be given in a frame after an explicit `single`.
VectorDrive<3> read_vector_drive(Context& context, const Place* place);
VectorDrive<6> read_vector_drive6(Context& context);
/// The scalar case: a drive, or `[single,] factor, drive`.
VectorDrive<1> read_scalar_drive(Context& context);

}  // namespace mbdae::reading
