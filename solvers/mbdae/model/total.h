// Clamp, in line, total and total pin joints: components of a relative position and of a relative rotation, imposed.
//
// All four are one constraint between node 1 (or the ground) and node 2, seen from frames fixed in node 1.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <vector>

#include "mbdae/model/element.h"

namespace mbdae {

class TotalConstraint final : public Constraint {
 public:
  TotalConstraint(const ClampData& data, const NodeSlot& node, int first);
  TotalConstraint(const InLineData& data, const NodeSlot& node1, const NodeSlot& node2, int first);
  TotalConstraint(const TotalJointData& data, const NodeSlot& node1, const NodeSlot& node2, int first);
  TotalConstraint(const TotalPinData& data, const NodeSlot& node, int first);

  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool velocity_level(int k) const override { return rows_[static_cast<std::size_t>(k)].velocity; }
  bool is_couple(int k) const override { return rows_[static_cast<std::size_t>(k)].rotation; }
  void set_reference(const State& state) override;

  /// An imposed component: what constraint row k follows.
  struct Row {
    bool rotation = false;
    bool velocity = false;
    int component = 0;  ///< 0, 1, 2
  };
  const std::vector<Row>& rows() const { return rows_; }

  /// Derivative of the constraint rows with respect to imposed component k's drive value, at the state.
  Eigen::VectorXd drive_derivative(const State& state, int k) const;

  /// True if one or two rotation components are active: what they mean depends on the rotation left free.
  bool partial_rotation() const { return active_rotations_ == 1 || active_rotations_ == 2; }
  int active_rotations() const { return active_rotations_; }

 private:
  struct Offset;    // of the point of node 2, and its motion
  struct Relative;  // the relative rotation and what belongs to it

  void add_rows(const std::array<TotalComponent, 3>& position, const std::array<TotalComponent, 3>& rotation);
  Offset offset(const State& state) const;
  Relative relative_rotation(const State& state) const;
  /// Derivative of the rate of a position component, e . u, by positions and rotations.
  void add_rate_row(Eigen::MatrixXd& A, int row, const Vec3& e, const Offset& at) const;

  NodeSlot node1_, node2_;
  Vec3 f2_ = Vec3::Zero();      ///< point in node 2
  Vec3 origin_ = Vec3::Zero();  ///< components of R^T b1 at zero drive
  Mat3 R1h_, R1hr_, R2hr_;
  VectorDrive<3> position_drive_, rotation_drive_;
  std::vector<Row> rows_;
  int active_rotations_ = 0;
  std::array<bool, 3> rotation_active_{};  ///< imposed at position level
  Vec3 free_rotation_ = Vec3::Zero();      ///< components of the imposed rotation vector that are left free [rad]
};

}  // namespace mbdae
