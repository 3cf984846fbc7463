// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/genel_constraints.h"

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/scalar_reader.h"

namespace mbdae {

ScalarConstraint::ScalarConstraint(const GenelClampData& data, const Numbering& numbering)
    : dofs_{Dof(data.dof, numbering)}, signs_{1.0}, drive_(data.drive) {
  first_ = numbering.first;
  size_ = 1;
  position_level_ = dofs_[0].position_level();
  plain_ = !dofs_[0].differential();
}

ScalarConstraint::ScalarConstraint(const GenelDistanceData& data, const Numbering& numbering)
    : dofs_{Dof(data.dof1, numbering), Dof(data.dof2, numbering)}, signs_{-1.0, 1.0}, drive_(data.drive) {
  first_ = numbering.first;
  size_ = 1;
  position_level_ = dofs_[0].position_level() && dofs_[1].position_level();
}

void ScalarConstraint::assemble(const State& state, Equations& eq, bool tangent) const {
  eq.g(first_) -= drive_->value(state.t);
  if (tangent) add_drive_derivative(eq, first_, *drive_, state.t, -1.0);
  for (std::size_t i = 0; i < dofs_.size(); ++i) {
    eq.g(first_) += signs_[i] * dofs_[i].value(state);
    eq.g(dofs_[i].row()) += signs_[i] * state.y(first_);
    if (!tangent) continue;
    dofs_[i].add_value(eq, first_, signs_[i]);
    eq.g_y(dofs_[i].row(), first_) += signs_[i];
  }
}

void ScalarConstraint::rates(const State& state, ConstraintRates& out, bool /*tangent*/) const {
  // Linear in the degrees of freedom: nothing depends on the configuration, and with accelerations zero only the drive
  // has a second derivative.
  const Jet drive = drive_->at(state.t);
  if (!position_level_) {
    out.bias(first_) -= drive.rate;
    return;
  }
  out.rate(first_) -= drive.rate;
  for (std::size_t i = 0; i < dofs_.size(); ++i) out.rate(first_) += signs_[i] * dofs_[i].rate(state);
  out.bias(first_) -= drive.second;
}

void GenelMass::assemble(const State& state, Equations& eq, bool tangent) const {
  eq.g(dof_.row()) += m_ * state.ydot(w_);
  eq.g(w_) += state.y(w_) - dof_.rate(state);
  if (!tangent) return;
  eq.g_ydot(dof_.row(), w_) += m_;
  eq.g_y(w_, w_) += 1.0;
  dof_.add_rate(eq, w_, -1.0);
}

namespace reading {

namespace {

DofData read_constrained(Context& context) {
  const SourcePosition where = context.input.where();
  const DofData dof = read_dof(context);
  if (dof.structural && dof.component >= 3 && !dof.rate) {
    context.input.fail(where, "a rotation has no value of its own that could be imposed; use a total joint");
  }
  return dof;
}

}  // namespace

GenelClampData read_genel_clamp(Context& context) {
  const AllowStateDrives allow(context);
  GenelClampData genel;
  genel.dof = read_constrained(context);
  genel.drive = read_drive(context);
  return genel;
}

GenelDistanceData read_genel_distance(Context& context) {
  const AllowStateDrives allow(context);
  GenelDistanceData genel;
  genel.dof1 = read_constrained(context);
  genel.dof2 = read_constrained(context);
  genel.drive = read_drive(context);
  return genel;
}

GenelMassData read_genel_mass(Context& context) {
  Input& input = context.input;
  GenelMassData genel;
  const SourcePosition where = input.where();
  genel.dof = read_dof(context);
  if (genel.dof.rate || is_algebraic(context, genel.dof)) {
    input.fail(where, "a mass takes the `algebraic` order of a differential degree of freedom");
  }
  if (genel.dof.structural && genel.dof.component >= 3) {
    input.fail(where, "a mass takes a position; a rotation has the inertia of bodies");
  }
  genel.m = input.real("the mass");
  return genel;
}

}  // namespace reading

}  // namespace mbdae
