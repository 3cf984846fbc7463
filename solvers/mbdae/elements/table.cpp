// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/table.h"

#include <type_traits>

#include "mbdae/deck/context.h"
#include "mbdae/elements/deformable_axial_joint.h"
#include "mbdae/elements/deformable_displacement_joint.h"
#include "mbdae/elements/deformable_hinge.h"
#include "mbdae/elements/deformable_joint.h"
#include "mbdae/elements/distance.h"
#include "mbdae/elements/force.h"
#include "mbdae/elements/genel_constraints.h"
#include "mbdae/elements/genel_springs.h"
#include "mbdae/elements/hinge.h"
#include "mbdae/elements/invariant_deformable_hinge.h"
#include "mbdae/elements/linear_motion.h"
#include "mbdae/elements/modal_joint.h"
#include "mbdae/elements/rod.h"
#include "mbdae/elements/state_space.h"
#include "mbdae/elements/total.h"

namespace mbdae {

namespace {

/// A row from a reader that returns the element's data and a class that is made of them.
template <auto kRead, class Mechanics>
ElementType row(CardKind card, const char* name, const char* counts_as, const char* alias = nullptr) {
  using Data = std::invoke_result_t<decltype(kRead), reading::Context&>;
  ElementType type{};
  type.card = card;
  type.name = name;
  type.alias = alias;
  type.counts_as = counts_as;
  type.data = &typeid(Data);
  type.read = [](reading::Context& context, const SourcePosition& where) -> std::any {
    Data data = kRead(context);
    if constexpr (requires { data.node1 == data.node2; }) {
      if (data.node1 == data.node2) context.input.fail(where, "both ends of the joint are on the same node");
    }
    return data;
  };
  type.make = [](const std::any& data, const Numbering& numbering) -> std::unique_ptr<Element> {
    return std::make_unique<Mechanics>(*std::any_cast<Data>(&data), numbering);
  };
  if constexpr (requires(const Data& data) { data.counts_as(); }) {
    type.counts = [](const std::any& data) { return std::any_cast<Data>(&data)->counts_as(); };
  }
  if constexpr (requires(const Data& data) { data.scalars(); }) {
    type.scalars = [](const std::any& data) { return std::any_cast<Data>(&data)->scalars(); };
  }
  if constexpr (requires { Data::kSignals; }) type.signals = Data::kSignals;
  if constexpr (requires(const Data& data) { data.coordinates(); }) {
    type.coordinates = [](const std::any& data) { return std::any_cast<Data>(&data)->coordinates(); };
  }
  return type;
}

using namespace reading;  // the readers
constexpr CardKind kJoint = CardKind::joint, kGenel = CardKind::genel, kForce = CardKind::force,
                   kCouple = CardKind::couple;

const ElementType kElements[] = {
    row<read_clamp, TotalConstraint>(kJoint, "clamp", "joints"),
    row<read_spherical_hinge, Hinge>(kJoint, "spherical hinge", "joints"),
    row<read_spherical_pin, Hinge>(kJoint, "spherical pin", "joints", "pin"),
    row<read_revolute_hinge, Hinge>(kJoint, "revolute hinge", "joints", "plane hinge"),
    row<read_revolute_pin, Hinge>(kJoint, "revolute pin", "joints", "plane pin"),
    row<read_cardano_hinge, Hinge>(kJoint, "cardano hinge", "joints", "universal hinge"),
    row<read_cardano_pin, Hinge>(kJoint, "cardano pin", "joints", "universal pin"),
    row<read_in_line, TotalConstraint>(kJoint, "in line", "joints", "inline"),
    row<read_in_plane, TotalConstraint>(kJoint, "in plane", "joints", "inplane"),
    row<read_prismatic, Hinge>(kJoint, "prismatic", "joints"),
    row<read_axial_rotation, Hinge>(kJoint, "axial rotation", "joints"),
    row<read_revolute_rotation, Hinge>(kJoint, "revolute rotation", "joints"),
    row<read_cardano_rotation, Hinge>(kJoint, "cardano rotation", "joints", "universal rotation"),
    row<read_distance, Distance>(kJoint, "distance", "joints"),
    row<read_distance_with_offset, Distance>(kJoint, "distance with offset", "joints"),
    row<read_linear_velocity, LinearMotion>(kJoint, "linear velocity", "joints"),
    row<read_linear_acceleration, LinearMotion>(kJoint, "linear acceleration", "joints"),
    row<read_total_joint, TotalConstraint>(kJoint, "total joint", "joints"),
    row<read_total_pin, TotalConstraint>(kJoint, "total pin joint", "joints"),
    row<read_modal, ModalJoint>(kJoint, "modal", "joints"),
    row<read_rod, Rod>(kJoint, "rod", "rods"),
    row<read_rod_with_offset, Rod>(kJoint, "rod with offset", "rods"),
    row<read_deformable_hinge, DeformableHinge>(kJoint, "deformable hinge", "deformable"),
    row<read_deformable_joint, DeformableJoint>(kJoint, "deformable joint", "deformable"),
    row<read_deformable_axial_joint, DeformableAxialJoint>(kJoint, "deformable axial joint", "deformable"),
    row<read_deformable_displacement_joint, DeformableDisplacementJoint>(kJoint, "deformable displacement joint",
                                                                         "deformable"),
    row<read_invariant_deformable_hinge, InvariantDeformableHinge>(kJoint, "invariant deformable hinge", "deformable"),
    row<read_spring_support, SpringSupport>(kGenel, "spring support", "genels"),
    row<read_cross_spring, SpringSupport>(kGenel, "cross spring support", "genels"),
    row<read_scalar_spring, ScalarSpring>(kGenel, "spring", "genels"),
    row<read_genel_mass, GenelMass>(kGenel, "mass", "genels"),
    row<read_genel_clamp, ScalarConstraint>(kGenel, "clamp", "genels"),
    row<read_genel_distance, ScalarConstraint>(kGenel, "distance", "genels"),
    row<read_state_space_siso, StateSpace>(kGenel, "state space siso", "genels"),
    row<read_state_space_mimo, StateSpace>(kGenel, "state space mimo", "genels"),
    row<read_scalar_filter, StateSpace>(kGenel, "scalar filter", "genels"),
    row<read_abstract_force, AbstractForce>(kForce, "abstract", "forces"),
    row<read_absolute_force, AppliedForce>(kForce, "absolute", "forces", "conservative"),
    row<read_follower_force, AppliedForce>(kForce, "follower", "forces"),
    row<read_absolute_couple, AppliedForce>(kCouple, "absolute", "forces", "conservative"),
    row<read_modal_force, ModalForce>(kForce, "modal", "forces"),
    row<read_follower_couple, AppliedForce>(kCouple, "follower", "forces"),
};

}  // namespace

ElementTable element_table() { return kElements; }

}  // namespace mbdae
