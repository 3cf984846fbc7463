// What a `joint: modal` card and its `.fem` file say, in the modes that the joint uses.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mbdae/deck/deck.h"

namespace mbdae {

/// An interface: a structural node clamped to a node of the finite element model.
struct ModalInterface {
  NodeIndex node = 0;
  std::string label;      ///< of the finite element node
  Vec3 p = Vec3::Zero();  ///< undeformed, from the origin in body axes [m]
  Eigen::Matrix3Xd T, Q;  ///< translation and rotation rows of the shapes, 3 x m
  Vec3 o = Vec3::Zero();  ///< offset in the structural node's axes [m]
};

/// Moments of mass of the body, in its axes and about its origin; p_i, m_i, J_i and T_i, Q_i of all nodes i.
struct ModalInertia {
  double m = 0.0;          ///< [kg]
  Vec3 S0 = Vec3::Zero();  ///< sum m p [kg m]
  Mat3 J0 = Mat3::Zero();  ///< sum J - m p x p x [kg m^2]
  bool coupled = false;    ///< the matrices below are there; otherwise they are empty
  Eigen::Matrix3Xd I3;     ///< sum m T, 3 x n
  Eigen::Matrix3Xd I4;     ///< sum m p x T + J Q
  Eigen::Matrix3Xd I5;     ///< column j n + k: sum m T_j x T_k
  std::vector<Mat3> I8;    ///< of mode j: - sum m p x T_j x
  std::vector<Mat3> I10;   ///< sum (Q_j) x J
  Eigen::Matrix3Xd I11;    ///< sum J Q
  std::vector<Mat3> I9;    ///< of modes j, k at j n + k: sum m T_j x T_k x; empty unless the card says to use it
};

struct ModalData {
  std::optional<NodeIndex> node;  ///< modal node that carries the body; none if it is clamped
  Vec3 x = Vec3::Zero();          ///< of a clamped body: origin and axes in space
  Mat3 R = Mat3::Identity();
  std::vector<int> numbers;  ///< of the modes in use: their numbers in the file, from 1
  Eigen::MatrixXd M, C, K;
  Eigen::VectorXd a, b;  ///< initial modal displacements and velocities
  ModalInertia inertia;
  std::vector<ModalInterface> interfaces;

  /// Number of modes: the joint has this many displacements and as many velocities as unknowns.
  int coordinates() const { return static_cast<int>(numbers.size()); }
};

/// `force: label, modal, joint, ...`: a force on each of some modal equations.
struct ModalForceData {
  std::size_t joint = 0;  ///< index in Deck::joints
  struct Term {
    int mode = 0;  ///< of the modes in use, from 0
    DrivePtr drive;
  };
  std::vector<Term> terms;
};

namespace reading {
struct Context;

ModalData read_modal(Context& context);
ModalForceData read_modal_force(Context& context);
}  // namespace reading

}  // namespace mbdae
