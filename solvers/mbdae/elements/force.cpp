// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/force.h"

#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

void AppliedForce::assemble(const State& state, Equations& eq, bool tangent) const {
  const NodeMotion& n = motion_of(state, node_);
  const bool follower = data_.frame == ForceFrame::follower;
  Vec3 value = data_.value.at(state.t);
  if (follower) value = n.R * value;
  const Mat3 frame = follower ? n.R : Mat3(Mat3::Identity());
  const int F = node_.force, M = moment_row(node_), g = rotation_column(node_);
  if (data_.couple) {
    add_to_g(eq.g, node_, Vec3::Zero(), -value);
    if (!tangent) return;
    if (follower) add_block(eq.g_y, M, g, skew(value));
    if (data_.value.reads_state()) add_drive_derivative(eq, M, data_.value, state.t, -frame);
    return;
  }
  const Vec3 arm = n.R * data_.arm;
  add_to_g(eq.g, node_, -value, -arm.cross(value));
  if (!tangent) return;
  if (data_.value.reads_state()) {
    add_drive_derivative(eq, F, data_.value, state.t, -frame);
    add_drive_derivative(eq, M, data_.value, state.t, -skew(arm) * frame);
  }
  if (follower) {
    add_block(eq.g_y, F, g, skew(value));
    add_block(eq.g_y, M, g, skew(arm.cross(value)));
  } else {
    add_block(eq.g_y, M, g, -skew_skew(value, arm));
  }
}

namespace reading {

namespace {

ForceData read_load(Context& context, ForceFrame frame, bool couple) {
  const AllowStateDrives allow(context);
  Input& input = context.input;
  ForceData force;
  force.frame = frame;
  force.couple = couple;
  force.node = context.node();
  const Frame node = context.frame(force.node);
  Place place;
  place.node = &node;
  read_offset(context, place, couple ? Presence::optional : Presence::required, &force.arm);
  Place global;
  global.beside = &node;
  force.value = read_vector_drive(context, frame == ForceFrame::follower ? &place : &global);
  if (input.more()) skip_output(input);
  return force;
}

}  // namespace

ForceData read_absolute_force(Context& context) { return read_load(context, ForceFrame::absolute, false); }
ForceData read_follower_force(Context& context) { return read_load(context, ForceFrame::follower, false); }
ForceData read_absolute_couple(Context& context) { return read_load(context, ForceFrame::absolute, true); }
ForceData read_follower_couple(Context& context) { return read_load(context, ForceFrame::follower, true); }

}  // namespace reading

}  // namespace mbdae
