// Constitutive laws of rods (1D), deformable hinges (3D) and deformable joints (6D).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/context.h"

namespace mbdae::reading {

/// `rod_length` [m] is what model::current("L0") stands for and what a muscle's initial length should be; null in a
/// named law.
Law1 read_law1(Context& context, const double* rod_length);
/// A 1D law that is not a muscle's: of a rotation, or of an abstract degree of freedom.
Law1 read_spring_law1(Context& context);
Law3 read_law3(Context& context);
Law6 read_law6(Context& context);

/// `constitutive law: label, [name, "...",] dimension, law;`
void read_constitutive_law(Context& context);

}  // namespace mbdae::reading
