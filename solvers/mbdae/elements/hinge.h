// Spherical, revolute, cardano, axial and prismatic joints: coincident points and orthogonal axes.
//
//   d1 = R1 d1~,  d2 = R2 d2~                     a pin has the ground as node 2: x2 = 0, d2 = X0
//   points:  phi = s (x1 + d1 - x2 - d2)
//            g[F1] += r F,  g[M1] += r d1 x F,  g[F2] -= r F,  g[M2] -= r d2 x F
//   axes:    phi = t a.b                           a on one node, b on the other
//            g[M_a] += k M b x a,  g[M_b] -= k M b x a
//   spin:    phi = e.(w2 - w1) - d(t),  e = axis 3 of frame 1
//            g[M1] += M e,  g[M2] -= M e
//
// Reactions F [N] global, then one couple M [N m] per axis. r = 1: F is the force that node 1 exerts on node 2 (on the
// ground), so that it acts on node 1 with a minus sign; the cardano pin has r = -1. s = -1, but +1 for the cardano
// hinge; k per axis in hinge.cpp; t = -1, but +1 for the prismatic joint, which has three axes and no points. All as in
// MBDyn's Jacobians. Spherical: no axis; revolute: e3 of frame 1 against e2 and e1 of frame 2; cardano: e3 of frame 1
// against e2 of frame 2; the axial rotation is a revolute hinge that spins, and `rotation` joints have no points. An
// axis condition holds for a = -a too: a joint assembled upside down stays there. Valid in any state. Source: MBDyn's
// joints. Tangent exact: docs/theory/elements.md; tests "spherical joints", "revolute joints", "cardano joints"
// (test_model_tangent.cpp), "prismatic joint, plane" (test_model_scalar.cpp), signs in test_model_signs.cpp.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mbdae/elements/friction.h"
#include "mbdae/model/element.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct SphericalHingeData {
  NodeIndex node1, node2;
  Vec3 d1, d2;  ///< hinge point in node 1, 2
};

struct SphericalPinData {
  NodeIndex node;
  Vec3 d;   ///< in the node
  Vec3 X0;  ///< global
};

struct RevoluteHingeData {
  NodeIndex node1, node2;
  Vec3 d1, d2;
  Mat3 R1h, R2h;  ///< hinge frames in node 1, 2; free axis = 3
  std::optional<double> initial_theta;
  std::optional<Eigen::Matrix<double, 5, 1>> initial_reaction;  ///< F global, M1, M2 local
  std::optional<FrictionData> friction = std::nullopt;

  int scalars() const { return friction ? 1 : 0; }
  static constexpr const char* kSignals[] = {"rz", "wz", "Fx", "Fy", "Fz"};
};

struct RevolutePinData {
  NodeIndex node;
  Vec3 d;
  Mat3 Rh;
  Vec3 X0;
  Mat3 R0;  ///< global
  std::optional<double> initial_theta;
};

struct CardanoHingeData {
  NodeIndex node1, node2;
  Vec3 d1, d2;
  Mat3 R1h, R2h;  ///< axis 3 of R1h stays orthogonal to axis 2 of R2h
};

/// A revolute hinge whose relative angular velocity is imposed.
struct AxialRotationData {
  NodeIndex node1, node2;
  Vec3 d1, d2;
  Mat3 R1h, R2h;   ///< axis = 3
  DrivePtr drive;  ///< [rad/s]

  static constexpr const char* kSignals[] = {"rz", "wz", "Fx", "Fy", "Fz"};
};

/// The axes of a revolute or a cardano hinge without its point.
struct RevoluteRotationData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
};

struct CardanoRotationData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
};

struct CardanoPinData {
  NodeIndex node;
  Vec3 d;
  Mat3 Rh;
  Vec3 X0;
  Mat3 R0;
};

/// Frames that keep their relative orientation; their origins move as they like.
struct PrismaticData {
  NodeIndex node1, node2;
  Mat3 R1h, R2h;
};

class Hinge final : public Constraint {
 public:
  /// A pin has the ground as node 2.
  Hinge(const SphericalHingeData& data, const Numbering& numbering);
  Hinge(const SphericalPinData& data, const Numbering& numbering);
  Hinge(const RevoluteHingeData& data, const Numbering& numbering);
  Hinge(const RevolutePinData& data, const Numbering& numbering);
  Hinge(const CardanoHingeData& data, const Numbering& numbering);
  Hinge(const CardanoPinData& data, const Numbering& numbering);
  Hinge(const PrismaticData& data, const Numbering& numbering);
  Hinge(const AxialRotationData& data, const Numbering& numbering);
  Hinge(const RevoluteRotationData& data, const Numbering& numbering);
  Hinge(const CardanoRotationData& data, const Numbering& numbering);

  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool is_couple(int k) const override { return k >= points_; }
  bool velocity_level(int k) const override { return spin_ && k == size_ - 1; }
  std::vector<ScalarInfo> scalars() const override;
  bool reactions_first() const override { return true; }
  void accept(const State& state) override;
  SignalValue signal(int k, const State& state) const override;
  bool switch_mode(const State& state, double still) override {
    return friction_ && friction_->switch_mode(state, still);
  }
  bool has_modes() const override { return friction_ && friction_->has_modes(); }
  void end_mode(const State& state, double still) override { friction_->end_mode(state, still); }
  bool margin_reads_load() const override { return friction_ && friction_->margin_reads_load(); }
  double mode_margin(const State& state) const override { return friction_ ? friction_->mode_margin(state) : 1.0; }
  std::string defect_under_load(const State& state) const override;

 private:
  /// Axis a on one node stays orthogonal to axis b on another; its reaction M is the couple sign_couple * M * (b x a).
  struct Axis {
    NodeSlot node_a, node_b;
    Vec3 a, b;           ///< in their nodes
    double couple_sign;  ///< of the couple on node a's equilibrium rows; node b gets the opposite
  };

  void assemble_points(const State& state, Equations& eq, bool tangent) const;
  void assemble_axes(const State& state, Equations& eq, bool tangent) const;
  void assemble_spin(const State& state, Equations& eq, bool tangent) const;
  void point_rates(const State& state, ConstraintRates& out, bool tangent) const;
  void axis_rates(const State& state, ConstraintRates& out, bool tangent) const;
  void without_points();
  void set_points(const NodeSlot& node1, const Vec3& d1, const NodeSlot& node2, const Vec3& d2, int first);
  void add_axis(const NodeSlot& node_a, const Vec3& a, const NodeSlot& node_b, const Vec3& b, double couple_sign);

  NodeSlot node1_, node2_;
  Vec3 d1_, d2_;    ///< hinge point in node 1, 2
  int points_ = 3;  ///< rows of coincident points
  double point_row_sign_ = -1.0;
  double axis_row_sign_ = -1.0;  ///< constraint rows of axes are -(a . b), as in MBDyn's Jacobian
  double force_sign_ = 1.0;      ///< of F on node 1's equilibrium rows
  std::vector<Axis> axes_;
  std::optional<Friction> friction_;
  DrivePtr spin_;  ///< imposed angular velocity about axis 3, the last row; null = none
  double turn(const State& state) const;
  Mat3 R1h_ = Mat3::Identity(), R2h_ = Mat3::Identity();  ///< hinge frames of a revolute hinge
  double last_turn_ = 0.0;                                ///< angle about the axis, whole turns counted [rad]
};

namespace reading {

SphericalHingeData read_spherical_hinge(Context& context);
SphericalPinData read_spherical_pin(Context& context);
RevoluteHingeData read_revolute_hinge(Context& context);
RevolutePinData read_revolute_pin(Context& context);
CardanoHingeData read_cardano_hinge(Context& context);
CardanoPinData read_cardano_pin(Context& context);
PrismaticData read_prismatic(Context& context);
AxialRotationData read_axial_rotation(Context& context);
RevoluteRotationData read_revolute_rotation(Context& context);
CardanoRotationData read_cardano_rotation(Context& context);

}  // namespace reading

}  // namespace mbdae
