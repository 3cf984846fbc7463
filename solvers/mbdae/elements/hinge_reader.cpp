// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"
#include "mbdae/elements/hinge.h"

namespace mbdae::reading {

SphericalHingeData read_spherical_hinge(Context& context) {
  const auto [first, second] = read_two_plain_ends(context);
  return SphericalHingeData{first.node, second.node, first.position, second.position};
}

SphericalPinData read_spherical_pin(Context& context) {
  const Pin pin = read_pin(context);
  return SphericalPinData{pin.end.node, pin.end.position, pin.X0};
}

namespace {

void refuse_friction(Input& input) {
  if (!input.more()) return;
  if (const auto words = input.peek_words(); words && words->is("friction")) {
    input.fail(words->where, "not supported: friction in a joint");
  }
}

std::optional<double> read_initial_theta(Input& input) {
  if (!input.more() || !input.take("initial theta")) return std::nullopt;
  return input.real("the initial angle [rad]");
}

}  // namespace

RevoluteHingeData read_revolute_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  RevoluteHingeData joint{
      first.node, second.node, first.position, second.position, first.orientation, second.orientation, {}, {}, {}};
  joint.initial_theta = read_initial_theta(context.input);
  joint.friction = read_friction(context);
  skip_joint_options(context.input);
  if (const auto state = read_initial_state<5>(context)) joint.initial_reaction = state->head<5>();
  return joint;
}

RevolutePinData read_revolute_pin(Context& context) {
  const Pin pin = read_pin(context);
  RevolutePinData joint{pin.end.node, pin.end.position, pin.end.orientation, pin.X0, pin.R0, {}};
  joint.initial_theta = read_initial_theta(context.input);
  refuse_friction(context.input);
  skip_joint_options(context.input);
  read_initial_state<5>(context);  // read but without effect: the reaction of a revolute pin starts at zero
  return joint;
}

CardanoHingeData read_cardano_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  return CardanoHingeData{first.node,      second.node,       first.position,
                          second.position, first.orientation, second.orientation};
}

CardanoPinData read_cardano_pin(Context& context) {
  const Pin pin = read_pin(context);
  return CardanoPinData{pin.end.node, pin.end.position, pin.end.orientation, pin.X0, pin.R0};
}

AxialRotationData read_axial_rotation(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  const AllowStateDrives allow(context);
  DrivePtr drive = read_drive(context);
  refuse_friction(context.input);
  return AxialRotationData{first.node,        second.node,        first.position,  second.position,
                           first.orientation, second.orientation, std::move(drive)};
}

RevoluteRotationData read_revolute_rotation(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return RevoluteRotationData{first.node, second.node, first.orientation, second.orientation};
}

CardanoRotationData read_cardano_rotation(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return CardanoRotationData{first.node, second.node, first.orientation, second.orientation};
}

PrismaticData read_prismatic(Context& context) {
  End first = read_end(context);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_hinge(context, second.after(first), &second.orientation);
  return PrismaticData{first.node, second.node, first.orientation, second.orientation};
}

}  // namespace mbdae::reading
