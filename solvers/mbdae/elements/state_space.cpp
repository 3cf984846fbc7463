// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/state_space.h"

#include <cmath>

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/scalar_reader.h"

namespace mbdae {

StateSpace::StateSpace(const StateSpaceData& data, const Numbering& numbering) : data_(data), first_(numbering.scalar) {
  for (const DofData& dof : data.outputs) outputs_.emplace_back(dof, numbering);
  for (const StateSpaceData::Input& input : data.inputs) {
    inputs_.emplace_back(input.dof ? std::optional<Dof>(Dof(*input.dof, numbering)) : std::nullopt);
  }
}

std::vector<ScalarInfo> StateSpace::scalars() const {
  std::vector<ScalarInfo> out;
  for (int k = 1; k <= data_.scalars(); ++k) {
    out.push_back({".state[" + std::to_string(k) + "]", "-", "state " + std::to_string(k), true});
  }
  return out;
}

void StateSpace::initialise(State& state) const {
  state.y.segment(first_, data_.scalars()) = data_.x;
  if (data_.xdot.size() > 0) state.ydot.segment(first_, data_.scalars()) = data_.xdot;
}

void StateSpace::assemble(const State& state, Equations& eq, bool tangent) const {
  const int n = data_.scalars();
  const auto m = static_cast<Eigen::Index>(inputs_.size());
  Eigen::VectorXd u(m);
  for (Eigen::Index j = 0; j < m; ++j) {
    const auto at = static_cast<std::size_t>(j);
    u(j) = inputs_[at] ? inputs_[at]->value(state) : data_.inputs[at].drive->value(state.t);
  }
  const auto x = state.y.segment(first_, n);
  eq.g.segment(first_, n) += data_.E * state.ydot.segment(first_, n) - data_.A * x - data_.B * u;
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    eq.g(outputs_[i].row()) += outputs_[i].value(state) - data_.C.row(row).dot(x) - data_.D.row(row).dot(u);
  }
  if (!tangent) return;

  eq.g_ydot.block(first_, first_, n, n) += data_.E;
  eq.g_y.block(first_, first_, n, n) -= data_.A;
  const auto add_input = [&](int row, Eigen::Index j, double coefficient) {
    if (coefficient == 0.0) return;
    const auto at = static_cast<std::size_t>(j);
    if (inputs_[at]) {
      inputs_[at]->add_value(eq, row, coefficient);
    } else {
      add_drive_derivative(eq, row, *data_.inputs[at].drive, state.t, coefficient);
    }
  };
  for (Eigen::Index j = 0; j < m; ++j) {
    for (int k = 0; k < n; ++k) add_input(first_ + k, j, -data_.B(k, j));
  }
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    outputs_[i].add_value(eq, outputs_[i].row(), 1.0);
    eq.g_y.block(outputs_[i].row(), first_, 1, n) -= data_.C.row(row);
    for (Eigen::Index j = 0; j < m; ++j) add_input(outputs_[i].row(), j, -data_.D(row, j));
  }
}

Eigen::VectorXd balancing_scale(Eigen::MatrixXd A) {
  constexpr double kRadix = 2.0, kWorthwhile = 0.95;
  const Eigen::Index n = A.rows();
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n);
  for (bool changed = true; changed;) {
    changed = false;
    for (Eigen::Index i = 0; i < n; ++i) {
      double c = A.col(i).norm(), r = A.row(i).norm();
      if (!(c > 0.0 && r > 0.0 && std::isfinite(c + r))) continue;  // of what overflows nothing is made better
      const double before = c + r;
      double f = 1.0;
      while (c < r / kRadix) {
        f *= kRadix;
        c *= kRadix;
        r /= kRadix;
      }
      while (c / kRadix >= r) {
        f /= kRadix;
        c /= kRadix;
        r *= kRadix;
      }
      if (c + r >= kWorthwhile * before) continue;
      scale(i) *= f;
      A.row(i) /= f;
      A.col(i) *= f;
      changed = true;
    }
  }
  return scale;
}

namespace reading {

namespace {

constexpr std::int64_t kLargest = 1000;  // states, inputs, outputs: as many as a dense matrix is sensible for

std::int64_t read_size(Input& input, const char* what, std::int64_t least) {
  const SourcePosition where = input.where();
  const std::int64_t n = input.integer(what);
  if (n < least || n > kLargest) {
    input.fail(where, "found " + std::to_string(n) + ", expected " + what + " from " + std::to_string(least) + " to " +
                          std::to_string(kLargest));
  }
  return n;
}

Eigen::MatrixXd read_elements(Input& input, Eigen::Index rows, Eigen::Index columns, const char* what) {
  Eigen::MatrixXd out(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (Eigen::Index j = 0; j < columns; ++j) out(i, j) = input.real(what);
  }
  return out;
}

StateSpaceData::Input read_input(Context& context) {
  Input& input = context.input;
  input.need("`node dof` and a degree of freedom, or `drive` and a drive");
  StateSpaceData::Input out;
  if (input.take("drive")) {
    const AllowStateDrives allow(context);
    out.drive = read_drive(context);
    return out;
  }
  const SourcePosition where = input.where();
  if (!input.take("node dof")) {
    input.diagnostics().warning(where, "the input is read as a degree of freedom; write `node dof` before it");
  }
  const SourcePosition dof_where = input.where();
  out.dof = read_dof(context);
  if (out.dof->structural && out.dof->component >= 3 && !out.dof->rate) {
    input.fail(dof_where, "a rotation has no value of its own that could be an input");
  }
  return out;
}

DofData read_output(Context& context) {
  const SourcePosition where = context.input.where();
  const DofData dof = read_dof(context);
  if (dof.structural && dof.component >= 3 && !dof.rate) {
    context.input.fail(where, "a rotation has no value of its own that could be an output");
  }
  return dof;
}

/// [, balance, yes|no] [, value, x... [, derivative, xp...]]
void read_start(Input& input, bool descriptor, StateSpaceData* genel) {
  const Eigen::Index n = genel->A.rows();
  bool balance = true;
  const SourcePosition where = input.where();
  if (input.more() && input.take("balance")) balance = input.yes_no();
  if (balance && n > 0) {
    if (descriptor) input.fail(where, "not supported: balancing a state space with a matrix E; write `balance, no`");
    const Eigen::VectorXd T = balancing_scale(genel->A);
    genel->A = T.asDiagonal().inverse() * genel->A * T.asDiagonal();
    genel->B = T.asDiagonal().inverse() * genel->B;
    genel->C = genel->C * T.asDiagonal();
  }
  genel->x.setZero(n);
  if (!input.more() || !input.take("value")) return;
  genel->x = read_elements(input, n, 1, "the initial value of a state");
  if (input.more() && input.take("derivative")) {
    genel->xdot = read_elements(input, n, 1, "the initial rate of a state");
  }
}

StateSpaceData read_state_space(Context& context, bool several) {
  Input& input = context.input;
  StateSpaceData genel;
  const std::int64_t p = several ? read_size(input, "a number of outputs", 1) : 1;
  for (std::int64_t i = 0; i < p; ++i) genel.outputs.push_back(read_output(context));
  const std::int64_t m = several ? read_size(input, "a number of inputs", 1) : 1;
  for (std::int64_t i = 0; i < m; ++i) genel.inputs.push_back(read_input(context));
  const std::int64_t n = read_size(input, "a number of states", 0);
  const bool descriptor = input.more() && input.take("matrix e");
  genel.E = descriptor ? read_elements(input, n, n, "an element of E") : Eigen::MatrixXd::Identity(n, n);
  input.require("matrix a");
  genel.A = read_elements(input, n, n, "an element of A");
  input.require("matrix b");
  genel.B = read_elements(input, n, m, "an element of B");
  input.require("matrix c");
  genel.C = read_elements(input, p, n, "an element of C");
  genel.D = Eigen::MatrixXd::Zero(p, m);
  if (input.more() && input.take("matrix d")) genel.D = read_elements(input, p, m, "an element of D");
  if (input.more() && input.take("gain")) {
    const double gain = input.real("the gain");
    genel.C *= gain;
    genel.D *= gain;
  }
  read_start(input, descriptor, &genel);
  return genel;
}

}  // namespace

StateSpaceData read_state_space_siso(Context& context) { return read_state_space(context, false); }
StateSpaceData read_state_space_mimo(Context& context) { return read_state_space(context, true); }

StateSpaceData read_scalar_filter(Context& context) {
  Input& input = context.input;
  StateSpaceData genel;
  genel.outputs.push_back(read_output(context));
  genel.inputs.push_back(read_input(context));
  const std::int64_t n = read_size(input, "the order of the denominator", 0);
  const Eigen::VectorXd a = read_elements(input, n, 1, "a coefficient of the denominator");
  const SourcePosition where = input.where();
  const std::int64_t order = read_size(input, "the order of the numerator", 0);
  if (order > n) {
    input.fail(where, "the numerator's order " + std::to_string(order) + " is above the denominator's, " +
                          std::to_string(n) + ": the filter has no state space");
  }
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n + 1);  // from s^n down
  b.tail(order + 1) = read_elements(input, order + 1, 1, "a coefficient of the numerator");
  if (input.more() && input.take("gain")) b *= input.real("the gain");
  genel.E = Eigen::MatrixXd::Identity(n, n);
  genel.A = Eigen::MatrixXd::Zero(n, n);
  genel.B = Eigen::MatrixXd::Zero(n, 1);
  if (n > 0) {
    genel.A.row(0) = -a.transpose();
    genel.A.diagonal(-1).setOnes();
    genel.B(0, 0) = 1.0;
  }
  genel.C = (b.tail(n) - b(0) * a).transpose();
  genel.D = Eigen::MatrixXd::Constant(1, 1, b(0));
  read_start(input, false, &genel);
  return genel;
}

}  // namespace reading

}  // namespace mbdae
