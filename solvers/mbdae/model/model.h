// The whole model: numbering of unknowns and equations, all elements, assembly.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mbdae/deck/deck.h"
#include "mbdae/model/element.h"
#include "mbdae/model/inertia.h"

namespace mbdae {

/// A joint with reactions, and what the deck calls it.
struct ConstraintEntry {
  const ElementData* data = nullptr;
  std::unique_ptr<Constraint> constraint;
};

/// An element without unknowns: rods, deformable elements, applied forces.
struct LoadEntry {
  const ElementData* data = nullptr;
  std::unique_ptr<Element> element;
};

/// A scalar unknown: of an abstract node, or of an element.
struct ScalarEntry {
  const Identity* owner = nullptr;
  ScalarInfo info;
};

/// A flexible body.
struct FlexibleEntry {
  const ElementData* data = nullptr;
  const Flexible* body = nullptr;
};

/// Coordinates of motion that stand together: a node's (x, phi) or a body's modal displacements.
struct MotionGroup {
  int motion = 0;  ///< number of the first among all coordinates of motion
  int count = 0;
  int pose = 0;   ///< its first column
  int force = 0;  ///< its first equilibrium equation
};

struct MuscleEntry {
  const ElementData* data = nullptr;
  const Muscle* muscle = nullptr;
};

/// How a joint is called in messages: `wrist_l (cardano hinge 107)`.
std::string joint_title(const ElementData& joint);

/// A deck as a system of equations. Keeps references into the deck, which must outlive it.
class Model {
 public:
  /// Throws std::invalid_argument on a body on a static node of a dynamic deck, and on modal nodes or joints of a
  /// static one.
  explicit Model(const Deck& deck);

  const Deck& deck() const { return deck_; }
  int size() const { return size_; }                      ///< number of unknowns
  int reaction_start() const { return reaction_start_; }  ///< first reaction
  int reaction_count() const { return size_ - reaction_start_; }
  int own_start() const { return own_start_; }  ///< end of the nodes: displacements and velocities that joints own
  int scalar_start() const { return scalar_start_; }  ///< first scalar: they stand between those and reactions
  int scalar_count() const { return reaction_start_ - scalar_start_; }
  const std::vector<ScalarEntry>& scalars() const { return scalars_; }  ///< in their order
  const std::vector<NodeSlot>& slots() const { return slots_; }
  const std::vector<ConstraintEntry>& constraints() const { return constraints_; }
  const std::vector<LoadEntry>& loads() const { return loads_; }        ///< in the order of assembly
  const std::vector<MuscleEntry>& muscles() const { return muscles_; }  ///< deck order
  const std::vector<NodeInertia>& inertias() const { return inertias_; }
  const std::vector<FlexibleEntry>& flexible() const { return flexible_; }  ///< deck order

  /// Nodes in deck order, then flexible bodies in deck order.
  const std::vector<MotionGroup>& motions() const { return motions_; }
  int motion_count() const { return motion_count_; }

  /// The unknowns in the order of files: what stands at place k there. Inside, displacements and velocities of joints,
  /// then scalars stand before all reactions; in files abstract nodes follow the structural ones, and each element has
  /// its own unknowns together, as in MBDyn. Empty if there is no difference.
  const std::vector<int>& file_order() const { return file_order_; }

  /// True if unknown k has no rate: reactions and algebraic scalars.
  bool algebraic(int k) const {
    return k >= reaction_start_ ||
           (k >= scalar_start_ && !scalars_[static_cast<std::size_t>(k - scalar_start_)].info.differential);
  }

  /// Deck poses and velocities (zero velocities under `model: static`), momenta of the bodies, no reactions.
  State initial_state() const;

  /// Momenta of the bodies and velocities of modal nodes into state.y.
  void set_momenta(State& state) const;

  /// Counts free rotation components of total joints from this configuration.
  void set_reference(const State& state);

  /// The same after a converged step of `ms`, as MBDyn does it.
  void carry_reference(const State& state);

  /// Whether free rotation components of total joints are those of each state itself instead of the reference's.
  void follow_free_rotations(bool follow);

  /// The state has been accepted: whole turns are counted from it.
  void accept(const State& state);

  /// Elements with modes (stuck, sliding) take those that the state asks for; true if one of them was another. `still`
  /// is the speed [m/s] to which that of something at rest is known.
  bool switch_modes(const State& state, double still);

  /// Those elements.
  std::vector<Element*> with_modes() const;

  /// All elements: constraints, then loads.
  template <class Visit>
  void for_elements(const Visit& visit) const {
    for (const ConstraintEntry& entry : constraints_) visit(*entry.data, *entry.constraint);
    for (const LoadEntry& entry : loads_) visit(*entry.data, *entry.element);
  }

  /// Accelerations [motion_count()] into the rates of modal nodes and modal velocities, the only ones that tangents
  /// depend on; velocities into the rates of modal displacements.
  void set_modal_rates(State& state, const Eigen::VectorXd& accelerations) const;

  /// Mass matrix of the coordinates of motion, and inertia forces with accelerations zero.
  Eigen::MatrixXd mass_matrix(const State& state) const;
  Eigen::VectorXd velocity_terms(const State& state) const;

  /// Residual and tangents with respect to (dx, dphi, dbeta, dgamma, reactions) and (dv, dw, betadot, gammadot); of
  /// modal unknowns with respect to themselves and their rates.
  void assemble(const State& state, Equations& eq, bool tangent) const;

  /// Adds gravity, rods, deformable elements and applied forces: everything but inertia and constraints.
  void add_loads(const State& state, Equations& eq, bool tangent) const;

  /// Statics: loads and constraints, no momenta rows, no momenta rates.
  void assemble_statics(const State& state, Equations& eq, bool tangent) const;

  /// Adds the joints with reactions: constraint rows and reaction forces.
  void add_constraints(const State& state, Equations& eq, bool tangent) const;

  /// The same in the form for accelerations and variable steps (Element::assemble_reduced).
  void add_reduced_constraints(const State& state, Equations& eq, bool tangent) const;

  /// Velocity and acceleration terms of all constraints (vectors and matrix of full size).
  void rates(const State& state, ConstraintRates& out, bool tangent) const;

  /// From variations to the unknowns of the linearised model: at R_ref = R, w_ref = w, dw = dgdot - w x dg.
  void to_increments(const State& state, Equations& eq) const;

  /// Name of unknown k, e.g. `hand_l.gx` or `wrist_l.reaction[2]`.
  std::string unknown_name(int k) const;
  std::string unknown_kind(int k) const;
  std::string unknown_unit(int k) const;
  int unknown_owner(int k) const;

  /// What equation k says and its unit, for messages: `force equilibrium of hand_l along x`, `N`.
  std::string equation_title(int k) const;
  std::string equation_unit(int k) const;

  /// How far it is from holding: `force equilibrium of hand_l along x is off by 3 N`, or `... has no finite value`.
  std::string equation_off(int k, double value) const;

 private:
  struct Place {
    int node = -1, component = 0;  // component within the node's or joint's block
    int constraint = -1;
    int scalar = -1;
    int flexible = -1;
    int group = 0;  // of a node's unknowns: three by three
  };
  int equation_group(const Place& p) const;
  void number_joints();
  void add_flexible(const State& state, Equations& eq, bool tangent) const;
  Place place(int k) const;
  void number_scalars(std::vector<int>& scalar_of_joint, std::vector<int>& scalar_of_genel);
  void order_for_files();
  void refresh_signals(const State& state) const;

  const Deck& deck_;
  int size_ = 0, own_start_ = 0, scalar_start_ = 0, reaction_start_ = 0;
  std::vector<NodeSlot> slots_;
  std::vector<NodeInertia> inertias_;  // one per node
  std::vector<ConstraintEntry> constraints_;
  std::vector<LoadEntry> loads_;
  std::vector<MuscleEntry> muscles_;
  std::vector<ScalarSlot> abstract_slots_;
  std::vector<ScalarEntry> scalars_;
  std::vector<const Element*> joints_;  // by their number in the deck
  std::vector<Numbering::Own> own_;     // of every joint
  std::vector<FlexibleEntry> flexible_;
  std::vector<MotionGroup> motions_;
  int motion_count_ = 0;
  std::vector<int> file_order_;
};

}  // namespace mbdae
