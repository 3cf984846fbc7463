// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/ends.h"
#include "mbdae/elements/hinge.h"

namespace mbdae::reading {

namespace {

/// True if the argument can only be the beginning of a position: `null`, a frame, a real number.
bool at_vector(Input& input) {
  if (!input.more()) return false;
  if (input.at_real()) return true;
  const auto words = input.peek_words();
  return words && (words->is("null") || words->is("reference"));
}

}  // namespace

SphericalHingeData read_spherical_hinge(Context& context) {
  // Nothing else here begins like a position: the word may be left out.
  const auto presence = [&] { return at_vector(context.input) ? Presence::required : Presence::optional; };
  End first = read_end(context);
  read_offset(context, first.place(), presence(), &first.position);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_offset(context, second.after(first), presence(), &second.position);
  read_hinge(context, second.after(first), &second.orientation);
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

PrismaticData read_prismatic(Context& context) {
  End first = read_end(context);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_hinge(context, second.after(first), &second.orientation);
  return PrismaticData{first.node, second.node, first.orientation, second.orientation};
}

}  // namespace mbdae::reading
