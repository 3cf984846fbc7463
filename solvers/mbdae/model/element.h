// What every element does: add its part of the residual g(t, y, ydot) and of the tangents g_y, g_ydot.
//
// Elements see nodes as rigid-body motions (x, R, v, w) and differentiate with respect to their variations
// (dx, dphi, dv, dw) with dR = dphi x R; all global components. The columns of a node's position and rotation unknowns
// hold those derivatives until Model::to_increments() turns them into derivatives with respect to the unknowns.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

#include "mbdae/deck/deck.h"
#include "mbdae/model/law.h"
#include "mbdae/model/rotation.h"

namespace mbdae {

/// Pose and velocity of a node, global components.
struct NodeMotion {
  Vec3 x = Vec3::Zero();  ///< [m]
  Mat3 R = Mat3::Identity();
  Vec3 v = Vec3::Zero();  ///< [m/s]
  Vec3 w = Vec3::Zero();  ///< [rad/s]
};

/// Everything a residual depends on.
struct State {
  double t = 0.0;                 ///< [s]
  std::vector<NodeMotion> nodes;  ///< deck order
  Eigen::VectorXd y;              ///< all but the poses of nodes is read from here
  Eigen::VectorXd ydot;           ///< all but the velocities of nodes is read from here
};

/// Residual and tangents of the whole model, in the order of the unknowns.
struct Equations {
  Eigen::VectorXd g;
  Eigen::MatrixXd g_y, g_ydot;

  void clear(int n, bool tangent) {
    g.setZero(n);
    if (tangent) {
      g_y.setZero(n, n);
      g_ydot.setZero(n, n);
    }
  }
};

/// First and second time derivative of the constraints, by equation number.
struct ConstraintRates {
  Eigen::VectorXd rate;    ///< d phi/dt; zero in rows that are velocity constraints (there phi itself is the rate)
  Eigen::VectorXd bias;    ///< second derivative of phi (first, of velocity constraints) with accelerations zero
  Eigen::MatrixXd rate_q;  ///< derivative of the velocity-level constraint with respect to (dx, dphi) and displacements
};

/// Where a node's unknowns and equations stand, counted from 0. The ground has index, first and force -1.
struct NodeSlot {
  int index = -1;
  int first = -1;        ///< position columns, then rotation columns
  int force = -1;        ///< force equilibrium rows, then moment equilibrium rows
  bool dynamic = false;  ///< has momenta: 12 unknowns instead of 6
  bool modal = false;    ///< has velocities v, w instead of momenta: 12 unknowns

  bool has_rates() const { return dynamic || modal; }  ///< 12 unknowns, the last 6 of them at `force`
};

/// A scalar: the unknown of an abstract node, or one that an element owns beside its reactions. Its equation has the
/// same number.
struct ScalarSlot {
  int first = -1;
  bool differential = true;  ///< has a rate; otherwise only its value counts
};

/// What an element is made with: where its nodes stand, and the numbers of its own first unknowns.
struct Numbering {
  /// Displacements of a joint of its own, then as many velocities.
  struct Own {
    int first = -1;
    int modes = 0;
  };
  std::span<const NodeSlot> nodes;             ///< deck order
  int first = 0;                               ///< first reaction
  int scalar = -1;                             ///< first scalar of its own
  std::span<const ScalarSlot> abstract_nodes;  ///< deck order
  int own = -1;                                ///< first displacement of its own, if it has any
  std::span<const Own> joints;                 ///< of all joints, deck order

  const NodeSlot& slot(NodeIndex node) const { return nodes[node]; }
};

class Muscle;
class Flexible;

/// A drive that a linearised model has as an input: how it is called after its element, and what it moves.
struct DriveInput {
  std::string name;        ///< ".position[1]"
  std::string unit;        ///< of the drive
  int first = 0;           ///< first equation that it enters
  Eigen::VectorXd column;  ///< derivative of the equations from there on
};

/// A scalar that an element owns: how it is called after the element.
struct ScalarInfo {
  std::string name;      ///< ".state[1]"
  std::string unit;      ///< of the scalar
  std::string equation;  ///< what its equation says, for messages
  bool differential = true;
};

class Element {
 public:
  virtual ~Element() = default;

  /// Adds to eq.g and, if asked, to eq.g_y and eq.g_ydot.
  virtual void assemble(const State& state, Equations& eq, bool tangent) const = 0;

  /// The same in the form that accelerations and the variable-step integration start from: unknowns that only rewrite a
  /// constraint stand in equations of their own, and every constraint row depends on the nodes. By default no other.
  virtual void assemble_reduced(const State& state, Equations& eq, bool tangent) const { assemble(state, eq, tangent); }

  /// The scalars that it owns, in their order.
  virtual std::vector<ScalarInfo> scalars() const { return {}; }

  /// Initial values of its scalars, and rates where the deck has them.
  virtual void initialise(State& /*state*/) const {}

  /// Called once a state has been accepted: for elements that remember.
  virtual void accept(const State& /*state*/) {}

  /// Quantity k of those that drives may read of it (its row's `signals`).
  virtual SignalValue signal(int /*k*/, const State& /*state*/) const { return {}; }

  /// True if its reactions stand before its scalars in files.
  virtual bool reactions_first() const { return false; }

  /// Elements of a lower rank are assembled first; rods come before other loads.
  virtual int rank() const { return 1; }

  /// The muscle that this is, or null.
  virtual const Muscle* muscle() const { return nullptr; }

  /// The flexible body that this is, or null.
  virtual const Flexible* flexible() const { return nullptr; }

  /// The drives that linearised models have as inputs, at the state.
  virtual std::vector<DriveInput> drive_inputs(const State& /*state*/) const { return {}; }

  /// Why the element cannot start from this state, as the rest of a sentence about it; empty if it can.
  virtual std::string defect(const State& /*state*/) const { return {}; }

  /// The same once reactions are known: why the equations have no solution there.
  virtual std::string defect_under_load(const State& /*state*/) const { return {}; }

  /// For elements with modes (stuck, sliding): takes the mode that the state asks for; true if it was another one.
  /// `still` is the speed [m/s] to which that of something at rest is known.
  virtual bool switch_mode(const State& /*state*/, double /*still*/) { return false; }

  virtual bool has_modes() const { return false; }

  /// Ends the mode: stuck turns to sliding, sliding to stuck. `still` as above.
  virtual void end_mode(const State& /*state*/, double /*still*/) {}

  /// A number that falls through zero where the mode ends.
  virtual double mode_margin(const State& /*state*/) const { return 1.0; }

  /// Whether that number reads a load, which IDA knows at its steps alone, and not between them.
  virtual bool margin_reads_load() const { return false; }
};

/// A muscle: inner values, and what its activation does.
class Muscle {
 public:
  virtual ~Muscle() = default;

  /// Length at the state [m].
  virtual double length(const State& state) const = 0;

  virtual MuscleValue value(const State& state) const = 0;

  /// Adds the derivative of g with respect to the activation drive of the muscle, whose values these are, to a column.
  virtual void add_activation_derivative(const State& state, const MuscleValue& value,
                                         Eigen::Ref<Eigen::VectorXd> column) const = 0;
};

/// Derivatives of mass matrix times acceleration plus velocity terms of a flexible body.
struct InertiaTangent {
  Eigen::MatrixXd by_phi, by_w;  ///< rotation and angular velocity of the node that carries it, 3 columns
  Eigen::MatrixXd by_a, by_b;    ///< modal displacements and velocities
};

/// An element that owns displacements a and velocities b, carried by a modal node or by the ground. Vectors and
/// matrices of its motion are in the order (v, w, b) of the node and the modes; only (b) on the ground.
class Flexible {
 public:
  virtual ~Flexible() = default;

  virtual int modes() const = 0;
  virtual int first_displacement() const = 0;  ///< the velocities follow
  virtual const NodeSlot& carrier() const = 0;
  virtual int mode_number(int k) const = 0;  ///< how mode k (from 0) is called in output

  /// Initial displacements and velocities into y.
  virtual void initialise_modes(Eigen::Ref<Eigen::VectorXd> y) const = 0;

  /// Elastic and damping forces and weight.
  virtual void assemble_loads(const State& state, const Vec3& gravity, Equations& eq, bool tangent) const = 0;

  virtual Eigen::MatrixXd mass_matrix(const State& state) const = 0;
  /// Inertia forces with accelerations zero.
  virtual Eigen::VectorXd velocity_terms(const State& state) const = 0;
  virtual InertiaTangent inertia_tangent(const State& state, const Eigen::VectorXd& acceleration) const = 0;
};

/// An element with reactions and constraint equations.
class Constraint : public Element {
 public:
  /// Adds velocity and acceleration terms; rate_q only if asked.
  virtual void rates(const State& state, ConstraintRates& out, bool tangent) const = 0;

  /// True if constraint k (from 0) is written at velocity level.
  virtual bool velocity_level(int /*k*/) const { return false; }

  /// True if constraint k is a rotation or an axis condition: its reaction is a couple [N m].
  virtual bool is_couple(int k) const = 0;

  /// True if row k is no constraint on the motion but an equation between the element's own unknowns.
  virtual bool plain_equation(int /*k*/) const { return false; }

  /// Unit of reaction k.
  virtual std::string reaction_unit(int k) const { return is_couple(k) ? "N m" : "N"; }

  /// Takes the present configuration as the one that free rotation components are counted from.
  virtual void set_reference(const State& /*state*/) {}

  /// Takes it after a converged step of `ms`: free components grow by what the step added to them, as in MBDyn.
  virtual void carry_reference(const State& /*state*/) {}

  /// Whether free rotation components are those of each state itself instead of the reference's.
  virtual void follow_free_rotations(bool /*follow*/) {}

  int first() const { return first_; }
  int size() const { return size_; }

 protected:
  int first_ = 0;  ///< first reaction column and constraint row
  int size_ = 0;
};

/// Adds to row `row` the derivatives of `coefficient` times a drive's value, by what it reads of the state.
inline void add_drive_derivative(Equations& eq, int row, const Drive& drive, double t, double coefficient) {
  if (row < 0 || !drive.reads_state()) return;
  std::vector<Sensitivity> by;
  drive.add_sensitivity(t, coefficient, by);
  for (const Sensitivity& one : by) {
    for (const SignalValue::Entry& entry : one.signal->now.gradient) {
      eq.g_y(row, entry.column) += one.derivative * entry.by_y;
      eq.g_ydot(row, entry.column) += one.derivative * entry.by_ydot;
    }
  }
}

/// The same for rows `row` on: derivatives of M times a vector drive's value.
template <class Matrix>
void add_drive_derivative(Equations& eq, int row, const VectorDrive<3>& drive, double t, const Matrix& M) {
  if (row < 0) return;
  for (const auto& term : drive.terms) {
    if (!term.drive->reads_state()) continue;
    const Vec3 column = M * term.direction;
    for (int i = 0; i < 3; ++i) add_drive_derivative(eq, row + i, *term.drive, t, column(i));
  }
}

/// Motion of a slot's node; the ground does not move.
inline const NodeMotion& motion_of(const State& state, const NodeSlot& slot) {
  static const NodeMotion ground;
  return slot.index < 0 ? ground : state.nodes[static_cast<std::size_t>(slot.index)];
}

/// A += B at (row, column), nothing for the ground.
inline void add_block(Eigen::MatrixXd& A, int row, int column, const Mat3& B) {
  if (row >= 0 && column >= 0) A.block<3, 3>(row, column) += B;
}

inline void add_column(Eigen::MatrixXd& A, int row, int column, const Vec3& b) {
  if (row >= 0) A.block<3, 1>(row, column) += b;
}

inline void add_row(Eigen::MatrixXd& A, int row, int column, const Vec3& b) {
  if (column >= 0) A.block<1, 3>(row, column) += b.transpose();
}

/// Row and column of a node's moments and rotations; -1 for the ground.
inline int moment_row(const NodeSlot& slot) { return slot.force < 0 ? -1 : slot.force + 3; }
inline int rotation_column(const NodeSlot& slot) { return slot.first < 0 ? -1 : slot.first + 3; }

/// Adds a force and a moment [N, N m] to the equilibrium rows of g (g = - sum of the forces on the node).
inline void add_to_g(Eigen::Ref<Eigen::VectorXd> g, const NodeSlot& slot, const Vec3& force, const Vec3& moment) {
  if (slot.force < 0) return;
  g.segment<3>(slot.force) += force;
  g.segment<3>(slot.force + 3) += moment;
}

}  // namespace mbdae
