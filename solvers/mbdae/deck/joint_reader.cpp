// Joints: the grammar of each type.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>

#include <utility>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/geometry.h"
#include "mbdae/deck/law_reader.h"

namespace mbdae::reading {
namespace {

/// A node of a joint with its frame, so that places can point at it.
struct End {
  NodeIndex node = 0;
  Frame frame;
  Vec3 position = Vec3::Zero();
  Mat3 orientation = Mat3::Identity();

  Place place() const {
    Place place;
    place.node = &frame;
    return place;
  }
  /// Place of a datum of this node given after the first node's.
  Place after(const End& first) const {
    Place place = this->place();
    place.other = &first.frame;
    place.other_position = &first.position;
    place.other_orientation = &first.orientation;
    return place;
  }
};

End read_end(Context& context) {
  End end;
  end.node = context.node();
  end.frame = context.frame(end.node);
  return end;
}

enum class Presence { required, optional };

/// `position, x`
void read_offset(Context& context, const Place& place, Presence presence, Vec3* out, const char* word = "position") {
  Input& input = context.input;
  if (presence == Presence::required) {
    input.require(word);
  } else if (!input.more() || !input.take(word)) {
    return;
  }
  *out = read_position(context, place);
}

/// [orientation, R]
void read_hinge(Context& context, const Place& place, Mat3* out, const char* word = "orientation") {
  if (context.input.more() && context.input.take(word)) *out = read_orientation(context, place);
}

/// Two nodes, each with a position and an orientation: the common form of most joints.
std::pair<End, End> read_two_ends(Context& context, Presence position) {
  End first = read_end(context);
  read_offset(context, first.place(), position, &first.position);
  read_hinge(context, first.place(), &first.orientation);
  End second = read_end(context);
  read_offset(context, second.after(first), position, &second.position);
  read_hinge(context, second.after(first), &second.orientation);
  return {first, second};
}

template <int N>
std::optional<Vec6> read_initial_state(Context& context) {
  Input& input = context.input;
  if (!input.more() || !input.take("initial state")) return std::nullopt;
  Vec6 state = Vec6::Zero();
  for (int i = 0; i < N; ++i) state(i) = input.real("a component of the initial reaction");
  return state;
}

/// [, orientation description, t][, output, yes|no][, inverse dynamics, ...]
void skip_joint_options(Input& input) {
  while (input.more()) {
    if (skip_orientation_description(input) || skip_output(input)) continue;
    if (!input.take("inverse dynamics")) return;
    for (const char* flag : {"torque", "prescribed motion", "right hand side", "ergonomy"}) {
      if (input.more() && input.take(flag)) input.yes_no();
    }
  }
}

JointKind read_clamp(Context& context) {
  Input& input = context.input;
  const End end = read_end(context);
  ClampData joint;
  joint.node = end.node;
  joint.X = end.frame.x;
  joint.R = end.frame.R;
  input.need("`node` or a position");
  input.take("position");
  if (!input.take("node")) joint.X = read_position(context, {});
  input.need("`node` or an orientation");
  input.take("orientation");
  if (!input.take("node")) joint.R = read_orientation(context, {});
  skip_joint_options(input);
  joint.initial_reaction = read_initial_state<6>(context);
  return joint;
}

JointKind read_spherical_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return SphericalHingeData{first.node, second.node, first.position, second.position};
}

/// A node's point and axes, and where they are pinned in space.
struct Pin {
  End end;
  Vec3 X0 = Vec3::Zero();
  Mat3 R0 = Mat3::Identity();
};

Pin read_pin(Context& context) {
  Pin pin;
  pin.end = read_end(context);
  read_offset(context, pin.end.place(), Presence::required, &pin.end.position);
  read_hinge(context, pin.end.place(), &pin.end.orientation);
  read_offset(context, {}, Presence::required, &pin.X0);
  read_hinge(context, {}, &pin.R0);
  return pin;
}

JointKind read_spherical_pin(Context& context) {
  const Pin pin = read_pin(context);
  return SphericalPinData{pin.end.node, pin.end.position, pin.X0};
}

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

JointKind read_revolute_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  RevoluteHingeData joint{
      first.node, second.node, first.position, second.position, first.orientation, second.orientation, {}, {}};
  joint.initial_theta = read_initial_theta(context.input);
  refuse_friction(context.input);
  skip_joint_options(context.input);
  if (const auto state = read_initial_state<5>(context)) joint.initial_reaction = state->head<5>();
  return joint;
}

JointKind read_revolute_pin(Context& context) {
  const Pin pin = read_pin(context);
  RevolutePinData joint{pin.end.node, pin.end.position, pin.end.orientation, pin.X0, pin.R0, {}};
  joint.initial_theta = read_initial_theta(context.input);
  refuse_friction(context.input);
  skip_joint_options(context.input);
  read_initial_state<5>(context);  // read but without effect: the reaction of a revolute pin starts at zero
  return joint;
}

JointKind read_cardano_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  return CardanoHingeData{first.node,      second.node,       first.position,
                          second.position, first.orientation, second.orientation};
}

JointKind read_cardano_pin(Context& context) {
  const Pin pin = read_pin(context);
  return CardanoPinData{pin.end.node, pin.end.position, pin.end.orientation, pin.X0, pin.R0};
}

JointKind read_in_line(Context& context) {
  End first = read_end(context);
  read_offset(context, first.place(), Presence::optional, &first.position);
  read_hinge(context, first.place(), &first.orientation);
  const End second = read_end(context);
  InLineData joint{first.node, second.node, first.position, first.orientation, Vec3::Zero()};
  read_offset(context, second.after(first), Presence::optional, &joint.q, "offset");
  return joint;
}

/// s1, s2, s3: which components are constrained, and how.
std::array<TotalComponent, 3> read_components(Input& input, bool rotation) {
  static constexpr const char* kPosition[] = {"active", "inactive", "position", "velocity"};
  static constexpr const char* kRotation[] = {"active", "inactive", "rotation", "angular velocity"};
  const Choices choices = rotation ? Choices(kRotation) : Choices(kPosition);
  std::array<TotalComponent, 3> out{};
  for (TotalComponent& component : out) {
    input.need([&] { return "the state of a component: " + joined(choices) + ", 0 or 1"; });
    const auto words = input.peek_words();
    const bool constant = !words || input.symbols().find(input.peek_text());
    const int state = input.take_any(choices);
    if (state >= 0) {
      component = state == 1   ? TotalComponent::inactive
                  : state == 3 ? TotalComponent::velocity
                               : TotalComponent::position;
    } else if (constant) {
      component =
          input.boolean("the state of a component: 0 or 1") ? TotalComponent::position : TotalComponent::inactive;
    } else {
      input.keyword(choices, "state of a component");
    }
  }
  return out;
}

/// [position constraint, ...] [orientation constraint, ...]
template <class Joint>
void read_total_constraints(Context& context, Joint* joint) {
  Input& input = context.input;
  if (input.more() && input.take("position constraint")) {
    joint->position = read_components(input, false);
    joint->position_drive = read_vector_drive(context, nullptr);
  }
  if (input.more() && input.take("orientation constraint")) {
    joint->rotation = read_components(input, true);
    joint->rotation_drive = read_vector_drive(context, nullptr);
  }
}

JointKind read_total_joint(Context& context) {
  TotalJointData joint;
  End first = read_end(context);
  read_offset(context, first.place(), Presence::optional, &first.position);
  read_hinge(context, first.place(), &first.orientation, "position orientation");
  End rotated = first;  // as `first`, with the orientation for rotations
  rotated.orientation = Mat3::Identity();
  read_hinge(context, first.place(), &rotated.orientation, "rotation orientation");
  End second = read_end(context);
  Mat3 rotation = Mat3::Identity();
  read_offset(context, second.after(first), Presence::optional, &second.position);
  read_hinge(context, second.after(first), &second.orientation, "position orientation");
  read_hinge(context, second.after(rotated), &rotation, "rotation orientation");
  joint.node1 = first.node;
  joint.node2 = second.node;
  joint.f1 = first.position;
  joint.f2 = second.position;
  joint.R1h = first.orientation;
  joint.R1hr = rotated.orientation;
  joint.R2h = second.orientation;
  joint.R2hr = rotation;
  read_total_constraints(context, &joint);
  return joint;
}

JointKind read_total_pin(Context& context) {
  TotalPinData joint;
  const End end = read_end(context);
  joint.node = end.node;
  joint.fn = joint.Xc = Vec3::Zero();
  joint.Rnh = joint.Rnhr = joint.Rch = joint.Rchr = Mat3::Identity();
  read_offset(context, end.place(), Presence::optional, &joint.fn);
  read_hinge(context, end.place(), &joint.Rnh, "position orientation");
  read_hinge(context, end.place(), &joint.Rnhr, "rotation orientation");
  read_offset(context, {}, Presence::optional, &joint.Xc);
  read_hinge(context, {}, &joint.Rch, "position orientation");
  read_hinge(context, {}, &joint.Rchr, "rotation orientation");
  read_total_constraints(context, &joint);
  return joint;
}

JointKind read_rod(Context& context) {
  Input& input = context.input;
  End first = read_end(context);
  read_offset(context, first.place(), Presence::optional, &first.position);
  End second = read_end(context);
  read_offset(context, second.after(first), Presence::optional, &second.position);
  if (first.node == second.node) input.fail(input.card_position(), "a rod needs two different nodes");
  RodData joint;
  joint.node1 = first.node;
  joint.node2 = second.node;
  joint.f1 = first.position;
  joint.f2 = second.position;
  const double distance =
      (second.frame.x + second.frame.R * second.position - first.frame.x - first.frame.R * first.position).norm();
  input.need("the length of the rod or `from nodes`");
  const SourcePosition where = input.where();
  if (!(distance > 0.0)) input.fail(where, "the ends of the rod coincide, a rod needs a direction");
  joint.L0 = input.take("from nodes") ? distance : input.positive("the length of the rod [m], or `from nodes`");
  joint.law = read_law1(context, &joint.L0);
  return joint;
}

JointKind read_deformable_hinge(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::optional);
  return DeformableHingeData{first.node, second.node, first.orientation, second.orientation, read_law3(context)};
}

JointKind read_deformable_joint(Context& context) {
  const auto [first, second] = read_two_ends(context, Presence::required);
  return DeformableJointData{first.node,        second.node,        first.position,    second.position,
                             first.orientation, second.orientation, read_law6(context)};
}

struct JointType {
  const char* name;
  JointKind (*read)(Context&);
};

constexpr JointType kJoints[] = {
    {"clamp", read_clamp},
    {"spherical hinge", read_spherical_hinge},
    {"spherical pin", read_spherical_pin},
    {"revolute hinge", read_revolute_hinge},
    {"revolute pin", read_revolute_pin},
    {"cardano hinge", read_cardano_hinge},
    {"cardano pin", read_cardano_pin},
    {"in line", read_in_line},
    {"total joint", read_total_joint},
    {"total pin joint", read_total_pin},
    {"rod", read_rod},
    {"deformable hinge", read_deformable_hinge},
    {"deformable joint", read_deformable_joint},
    {"universal hinge", read_cardano_hinge},
    {"universal pin", read_cardano_pin},
};

constexpr const char* kOtherJoints[] = {"angular acceleration",
                                        "angular velocity",
                                        "axial rotation",
                                        "beam slider",
                                        "brake",
                                        "cardano rotation",
                                        "deformable axial joint",
                                        "deformable displacement joint",
                                        "deformable displacement hinge",
                                        "distance",
                                        "distance with offset",
                                        "drive displacement",
                                        "drive displacement pin",
                                        "drive hinge",
                                        "friction",
                                        "gimbal hinge",
                                        "gimbal rotation",
                                        "imposed displacement",
                                        "imposed displacement pin",
                                        "imposed kinematics",
                                        "imposed orientation",
                                        "in line contact",
                                        "in plane",
                                        "in plane contact",
                                        "inline",
                                        "inline friction",
                                        "inplane",
                                        "invariant deformable displacement joint",
                                        "invariant deformable hinge",
                                        "kinematic",
                                        "linear acceleration",
                                        "linear velocity",
                                        "modal",
                                        "offset displacement joint",
                                        "plane displacement",
                                        "plane displacement pin",
                                        "plane hinge",
                                        "plane pin",
                                        "point contact",
                                        "point surface contact",
                                        "prismatic",
                                        "revolute rotation",
                                        "rod bezier",
                                        "rod with offset",
                                        "rotation",
                                        "screw",
                                        "total equation",
                                        "total reaction",
                                        "total force",
                                        "tube",
                                        "viscous body"};

int joint_type(Input& input) {
  const char* names[std::size(kJoints)];
  for (std::size_t i = 0; i < std::size(kJoints); ++i) names[i] = kJoints[i].name;
  input.need([&] { return "a joint type: " + joined(names); });
  const int type = input.take_any(names);
  if (type >= 0) return type;
  if (const auto words = input.peek_words()) {
    for (const char* other : kOtherJoints) {
      if (words->is(other)) input.fail(words->where, std::string("not supported: the joint `") + other + "`");
    }
  }
  return input.keyword(names, "joint type");  // fails with the choices
}

void check_two_nodes(Input& input, const JointKind& kind, const SourcePosition& where) {
  const bool same = std::visit(
      [](const auto& joint) {
        if constexpr (requires { joint.node1; }) {
          return joint.node1 == joint.node2;
        } else {
          return false;
        }
      },
      kind);
  if (same) input.fail(where, "both ends of the joint are on the same node");
}

}  // namespace

void read_joint(Context& context) {
  Input& input = context.input;
  ++context.joint_count.found;
  const Label label = input.label("a joint label");
  context.joints.announce(input, label);
  const SourcePosition where = input.where();
  const int type = joint_type(input);
  JointData joint{identity(label, "joint"), kJoints[type].read(context)};
  skip_joint_options(input);
  if (input.more()) {
    if (const auto words = input.peek_words(); words && words->is("initial state")) {
      input.fail(
          words->where,
          std::string("`initial state` belongs at the end of clamp, revolute hinge and revolute pin only, not of `") +
              kJoints[type].name + "`");
    }
  }
  input.end_card();
  check_two_nodes(input, joint.kind, where);
  context.deck.joints.push_back(std::move(joint));
  context.joints.define(label, {});
}

}  // namespace mbdae::reading
