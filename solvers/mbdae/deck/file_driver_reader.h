// File drivers: the block `drivers` and the drive caller `file`.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

/// `file: label, fixed step | variable step, ..., "file";`
void read_file_driver(Context& context);

/// What follows `file,` in a drive: `label [, column] [, amplitude, A]`.
DrivePtr read_file_drive(Context& context);

}  // namespace mbdae::reading
