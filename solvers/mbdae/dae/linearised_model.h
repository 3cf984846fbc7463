// What an analysis produces: plain data, in the order of docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

namespace mbdae {

struct UnknownInfo {
  std::string name;  ///< `hand_l.x`, `wrist_l.reaction[2]`
  std::string kind;  ///< position, rotation, momentum, momenta_moment, reaction
  std::string unit;
  int owner = 0;  ///< label of the node or joint
};

struct InputInfo {
  std::string name;
  std::string unit;
};

struct NodeState {
  std::string name;
  int label = 0;
  int first = 0;  ///< first unknown, from 0
  int dofs = 0;   ///< 12 or 6
  Eigen::Vector3d x, v, w;
  Eigen::Matrix3d R;
};

struct JointInfo {
  std::string name;
  int label = 0;
  std::string type;  ///< as in the deck: "spherical hinge", ...
  int first = 0;
  int dofs = 0;
};

struct MuscleState {
  std::string name;
  int label = 0;
  double length = 0.0, x = 0.0, v = 0.0, activation = 0.0, force = 0.0;
};

/// A linearised model and the state it was taken at.
struct LinearisedModel {
  std::string analysis;  ///< "linearise" or "static"
  double c = 0.0;        ///< [s]
  double time = 0.0;     ///< [s]
  Eigen::MatrixXd J_plus, J_minus;
  Eigen::VectorXd y, ydot, residual, equilibrium_residual;
  std::vector<UnknownInfo> dofs;
  std::vector<InputInfo> inputs;
  Eigen::MatrixXd g_u;  ///< n x inputs
  std::vector<NodeState> nodes;
  std::vector<JointInfo> joints;  ///< those with unknowns, deck order
  std::vector<MuscleState> muscles;
  int iterations = 0;              ///< of the static equilibrium
  double residual_norm = 0.0;      ///< 2-norm of equilibrium_residual
  std::vector<std::string> notes;  ///< what a person should know about the result
};

/// A time history: one row of `data` per instant, one column per channel.
struct Motion {
  std::vector<double> time;         ///< [s]
  std::vector<InputInfo> channels;  ///< name (`lever.gz`, `grip_l.reaction[1]`, `muscle[delt1_l].force`) and unit
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> data;
  std::vector<std::string> notes;  ///< what a person should know about the result
};

}  // namespace mbdae
