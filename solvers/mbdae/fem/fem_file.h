// A body reduced to modes, as a `.fem` file has it: finite element nodes, mode shapes, modal matrices, masses.
//
// Text. Everything is skipped up to a line that begins with `** RECORD GROUP n`; then come numbers in free format until
// the next such line; `** END OF FILE` ends. docs/io_formats/fem.md has the groups. Nothing is computed here but what
// needs no more than the file; elements/modal_reader.cpp makes a joint of it.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

#include "mbdae/deck/diagnostic.h"

namespace mbdae {

/// Mass, centre of mass and inertia about it, body axes [kg, m, kg m^2].
struct FemRigidBody {
  double m = 0.0;
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d J = Eigen::Matrix3d::Zero();
};

struct FemFile {
  int nodes = 0, modes = 0;
  std::vector<std::string> labels;         ///< of the nodes (group 2)
  Eigen::Matrix3Xd points;                 ///< one column per node, body axes (5, 6, 7) [m]
  std::vector<Eigen::MatrixXd> shape;      ///< per node 6 x modes: translations, rotations (8)
  Eigen::VectorXd a, adot;                 ///< initial displacements and velocities (3, 4), zero if not given
  Eigen::MatrixXd M, K;                    ///< modal mass and stiffness (9, 10)
  std::optional<Eigen::MatrixXd> C;        ///< modal damping (13)
  std::optional<Eigen::Matrix4Xd> lumped;  ///< per node m, Jx, Jy, Jz (11) [kg, kg m^2]
  std::optional<FemRigidBody> rigid;       ///< group 12
  /// Inertia invariants (14 to 18) as written, modes of the file in their order: I3, I4 3 x n; I8 3 x 3n;
  /// I5 3 x n^2; I9 3 x 3n^2.
  std::optional<Eigen::MatrixXd> I3, I4, I8, I5, I9;
};

namespace reading {

/// Reads a `.fem` text. `file` is its index in the diagnostics; what is wrong with it is reported there, and then
/// Reported is thrown. Warnings are for what MBDyn passes over and a person would not.
FemFile read_fem(const std::string& text, int file, Diagnostics& diagnostics);

}  // namespace reading

}  // namespace mbdae
