// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/linear_motion.h"

#include "mbdae/deck/drive_reader.h"
#include "mbdae/elements/ends.h"

namespace mbdae {

LinearMotion::LinearMotion(const LinearVelocityData& data, const Numbering& numbering)
    : node_(numbering.slot(data.node)), e_(data.e), drive_(data.drive) {
  first_ = numbering.first;
  size_ = 1;
}

LinearMotion::LinearMotion(const LinearAccelerationData& data, const Numbering& numbering)
    : node_(numbering.slot(data.node)), e_(data.e), drive_(data.drive), q_(numbering.scalar) {
  first_ = numbering.first;
  size_ = 1;
}

std::vector<ScalarInfo> LinearMotion::scalars() const {
  if (q_ < 0) return {};
  return {{".velocity", "m/s", "imposed velocity", true}};
}

void LinearMotion::initialise(State& state) const {
  if (q_ >= 0) state.y(q_) = e_.dot(motion_of(state, node_).v);
}

void LinearMotion::assemble(const State& state, Equations& eq, bool tangent, int constraint, int definition) const {
  add_to_g(eq.g, node_, state.y(first_) * e_, Vec3::Zero());
  const int row = q_ < 0 ? first_ : constraint;
  eq.g(row) += e_.dot(motion_of(state, node_).v);
  if (q_ < 0) {
    eq.g(row) -= drive_->value(state.t);
  } else {
    eq.g(row) -= state.y(q_);
    eq.g(definition) += state.ydot(q_) - drive_->value(state.t);
  }
  if (!tangent) return;
  add_column(eq.g_y, node_.force, first_, e_);
  add_row(eq.g_ydot, row, node_.first, e_);
  if (q_ >= 0) {
    eq.g_y(row, q_) -= 1.0;
    eq.g_ydot(definition, q_) += 1.0;
  }
  add_drive_derivative(eq, q_ < 0 ? row : definition, *drive_, state.t, -1.0);
}

void LinearMotion::rates(const State& state, ConstraintRates& out, bool /*tangent*/) const {
  if (q_ < 0) out.bias(first_) -= drive_->at(state.t).rate;
}

namespace reading {

namespace {

template <class Data>
Data read_motion(Context& context) {
  Input& input = context.input;
  Data joint;
  joint.node = context.node();
  const SourcePosition where = input.where();
  const Vec3 direction = read_direction(context, {});
  if (!(direction.norm() > 0.0)) input.fail(where, "the direction is zero");
  joint.e = direction.normalized();
  const AllowStateDrives allow(context);
  joint.drive = read_drive(context);
  return joint;
}

}  // namespace

LinearVelocityData read_linear_velocity(Context& context) { return read_motion<LinearVelocityData>(context); }
LinearAccelerationData read_linear_acceleration(Context& context) {
  return read_motion<LinearAccelerationData>(context);
}

}  // namespace reading

}  // namespace mbdae
