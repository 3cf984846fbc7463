// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"
#include "mbdae/elements/total.h"

namespace mbdae::reading {

ClampData read_clamp(Context& context) {
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

InLineData read_in_line(Context& context) {
  End first = read_end(context);
  read_offset(context, first.place(), Presence::optional, &first.position);
  read_hinge(context, first.place(), &first.orientation);
  const End second = read_end(context);
  InLineData joint{first.node, second.node, first.position, first.orientation, Vec3::Zero()};
  read_offset(context, second.after(first), Presence::optional, &joint.q, "offset");
  return joint;
}

InPlaneData read_in_plane(Context& context) {
  Input& input = context.input;
  End first = read_end(context);
  read_offset(context, first.place(), Presence::optional, &first.position);
  const SourcePosition where = input.where();
  const Vec3 normal = read_direction(context, first.place());
  if (!(normal.norm() > 0.0)) input.fail(where, "the normal of the plane is zero");
  const End second = read_end(context);
  InPlaneData joint{first.node, second.node, first.position, normal.normalized(), Vec3::Zero()};
  read_offset(context, second.after(first), Presence::optional, &joint.q, "offset");
  return joint;
}

namespace {

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
  const AllowStateDrives allow(context);
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

}  // namespace

TotalJointData read_total_joint(Context& context) {
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

TotalPinData read_total_pin(Context& context) {
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

}  // namespace mbdae::reading
