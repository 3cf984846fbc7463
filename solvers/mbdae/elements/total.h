// Clamp, in line, in plane, total and total pin joints: components of a relative position and of a relative rotation,
// imposed.
//
// All five are one constraint between node 1 (or the ground) and node 2, seen from frames fixed in node 1:
//
//   R = R1 R1h,  Rr = R1 R1hr,  b2 = R2 f2,  b1 = x2 + b2 - x1
//   F = sum R_i F~_i,  M = sum Rr_i M~_i          over the active components, reactions in node 1's frames
//   g[F1] -= F,  g[M1] -= M + b1 x F,  g[F2] += F,  g[M2] += M + b2 x F
//   position i:  phi = R_i.b1 - o_i - X_i(t)
//   rotation i:  phi = theta_i,  exp(theta x) = Rr^T R2 R2hr exp(Theta(t) x)^T
//   velocity components: the rates of these, imposed
//
// Reactions [N, N m] act on node 1 with a plus sign, on node 2 with a minus sign, as in MBDyn. With one or two
// rotations active, the imposed rotation vector's free components are those of a reference that follows the motion step
// by step (`ms`: carry_reference), or those of the relative rotation itself, theta = log(Rr^T R2 R2hr) - Theta (IDA:
// follow_free_rotations), which is what `ms` converges to with short steps. Valid for theta < pi. Source: MBDyn's
// joints. The tangent is exact in any state, where MBDyn's in line and in plane joints (under load), total pin (offset
// and load) and rotation rows (theta not 0) are not: docs/theory/elements.md, docs/conventions.md; tests "clamp, also
// when turned away from its place", "in line", "total joint, every kind of component" (test_model_tangent.cpp),
// "prismatic joint, plane" (test_model_scalar.cpp), signs in test_model_signs.cpp.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct ClampData {
  NodeIndex node;
  Vec3 X;                                ///< clamped position, global [m]
  Mat3 R;                                ///< clamped orientation
  std::optional<Vec6> initial_reaction;  ///< F, M global [N, N m]
};

/// A point of node 2 moves along axis 3 of Rv, through p in node 1.
struct InLineData {
  NodeIndex node1, node2;
  Vec3 p;
  Mat3 Rv;
  Vec3 q;  ///< offset in node 2
};

/// A point of node 2 stays in the plane through p with normal n, both in node 1.
struct InPlaneData {
  NodeIndex node1, node2;
  Vec3 p;
  Vec3 n;  ///< a unit vector
  Vec3 q;  ///< offset in node 2
};

enum class TotalComponent { inactive, position, velocity };  // "position" = rotation for the orientation group

struct TotalJointData {
  NodeIndex node1, node2;
  Vec3 f1, f2;
  Mat3 R1h, R1hr, R2h, R2hr;  ///< position and rotation orientations in node 1, 2
  std::array<TotalComponent, 3> position{}, rotation{};
  VectorDrive<3> position_drive, rotation_drive;  ///< imposed relative position [m], rotation vector [rad] (or rates)

  static constexpr const char* kSignals[] = {"Fx", "Fy", "Fz", "Mx", "My", "Mz", "dx", "dy", "dz"};
};

struct TotalPinData {
  NodeIndex node;
  Vec3 fn;         ///< in the node
  Mat3 Rnh, Rnhr;  ///< in the node
  Vec3 Xc;         ///< global
  Mat3 Rch, Rchr;  ///< global
  std::array<TotalComponent, 3> position{}, rotation{};
  VectorDrive<3> position_drive, rotation_drive;

  static constexpr const char* kSignals[] = {"Fx", "Fy", "Fz", "Mx", "My", "Mz", "dx", "dy", "dz"};
};

class TotalConstraint final : public Constraint {
 public:
  TotalConstraint(const ClampData& data, const Numbering& numbering);
  TotalConstraint(const InLineData& data, const Numbering& numbering);
  TotalConstraint(const InPlaneData& data, const Numbering& numbering);
  TotalConstraint(const TotalJointData& data, const Numbering& numbering);
  TotalConstraint(const TotalPinData& data, const Numbering& numbering);

  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool velocity_level(int k) const override { return rows_[static_cast<std::size_t>(k)].velocity; }
  bool is_couple(int k) const override { return rows_[static_cast<std::size_t>(k)].rotation; }
  void set_reference(const State& state) override;
  void carry_reference(const State& state) override;
  void follow_free_rotations(bool follow) override { follows_ = follow && partial_rotation(); }
  std::vector<DriveInput> drive_inputs(const State& state) const override;
  SignalValue signal(int k, const State& state) const override;

 private:
  /// An imposed component: what constraint row k follows.
  struct Row {
    bool rotation = false;
    bool velocity = false;
    int component = 0;  ///< 0, 1, 2
  };
  /// Derivative of the constraint rows with respect to imposed component k's drive value, at the state.
  Eigen::VectorXd drive_derivative(const State& state, int k) const;

  /// True if one or two rotation components are active: what they mean depends on the rotation left free.
  bool partial_rotation() const { return active_rotations_ == 1 || active_rotations_ == 2; }

  struct Offset;    // of the point of node 2, and its motion
  struct Relative;  // the relative rotation and what belongs to it

  void add_rows(const std::array<TotalComponent, 3>& position, const std::array<TotalComponent, 3>& rotation);
  Offset offset(const State& state) const;
  Relative relative_rotation(const State& state) const;
  Mat3 rotation_by_drive(const Relative& rel) const;  ///< theta by the imposed rotation vector
  /// Derivative of the rate of a position component, e . u, by positions and rotations.
  void add_rate_row(Eigen::MatrixXd& A, int row, const Vec3& e, const Offset& at) const;

  NodeSlot node1_, node2_;
  Vec3 f2_ = Vec3::Zero();      ///< point in node 2
  Vec3 origin_ = Vec3::Zero();  ///< components of R^T b1 at zero drive
  Mat3 R1h_, R1hr_, R2hr_;
  VectorDrive<3> position_drive_, rotation_drive_;
  bool driven_ = false;       ///< has drives: not a clamp or an in line joint
  bool reads_state_ = false;  ///< some of them read the state
  std::vector<Row> rows_;
  int active_rotations_ = 0;
  std::array<bool, 3> rotation_active_{};  ///< imposed at position level
  Vec3 free_rotation_ = Vec3::Zero();      ///< components of the imposed rotation vector that are left free [rad]
  bool follows_ = false;                   ///< these components are those of the state at hand
};

namespace reading {

ClampData read_clamp(Context& context);
InLineData read_in_line(Context& context);
InPlaneData read_in_plane(Context& context);
TotalJointData read_total_joint(Context& context);
TotalPinData read_total_pin(Context& context);

}  // namespace reading

}  // namespace mbdae
