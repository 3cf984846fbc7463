// A degree of freedom as an element reads it and writes into its equation.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/element.h"

namespace mbdae {

class Dof {
 public:
  Dof(const DofData& data, const Numbering& numbering) : structural_(data.structural), rate_(data.rate) {
    if (structural_) {
      const NodeSlot& slot = numbering.slot(data.node);
      index_ = slot.index;
      component_ = data.component;
      column_ = slot.first + component_;
      row_ = slot.force + component_;
    } else {
      column_ = row_ = numbering.abstract_nodes[data.node].first;
      differential_ = numbering.abstract_nodes[data.node].differential;
    }
  }

  /// Its equation: force or moment equilibrium, or an abstract node's own.
  int row() const { return row_; }

  /// True if the value is a position or a state, not a rate, not an algebraic value: a constraint on it is one at
  /// position level.
  bool position_level() const { return !rate_; }
  bool structural() const { return structural_; }
  bool differential() const { return differential_; }
  int column() const { return column_; }

  /// The value by its order, and the rate of the value (of the `algebraic` order).
  double value(const State& state) const { return read(state, rate_); }
  double rate(const State& state) const { return read(state, true); }

  /// Adds `coefficient` times the derivatives of the value (the rate) to row `row`.
  void add_value(Equations& eq, int row, double coefficient) const { add(eq, row, coefficient, rate_); }
  void add_rate(Equations& eq, int row, double coefficient) const { add(eq, row, coefficient, true); }

  /// Unit of what acts on it, and of its value.
  const char* load_unit() const { return !structural_ ? "-" : component_ < 3 ? "N" : "N m"; }

 private:
  double read(const State& state, bool rate) const {
    if (!structural_) return rate ? state.ydot(column_) : state.y(column_);
    const NodeMotion& node = state.nodes[static_cast<std::size_t>(index_)];
    if (component_ >= 3) return node.w(component_ - 3);
    return rate ? node.v(component_) : node.x(component_);
  }
  void add(Equations& eq, int row, double coefficient, bool rate) const {
    (rate || (structural_ && component_ >= 3) ? eq.g_ydot : eq.g_y)(row, column_) += coefficient;
  }

  bool structural_, rate_, differential_ = true;
  int index_ = -1, component_ = 0, column_ = -1, row_ = -1;
};

}  // namespace mbdae
