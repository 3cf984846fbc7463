// Drives that read the model's state: `node`, `element` and `dof` drives.
//
// A signal is a quantity of the state. The model refreshes its value, its rate and its gradient before it assembles
// anything; drives then take it like a function of time. That way a drive within a drive within a joint needs no
// knowledge of the state, and tangents are exact: a drive tells its derivatives by the signals in it, a signal tells
// its own by the unknowns.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mbdae/drive/drive.h"

namespace mbdae {

/// A signal at a state. Gradient: derivatives by unknown `column` and by its rate; for nodes by the variations (dx,
/// dphi) and (dv, dw), as in Equations.
struct SignalValue {
  struct Entry {
    int column = 0;
    double by_y = 0.0, by_ydot = 0.0;
  };
  double value = 0.0;
  double rate = 0.0;  ///< in time, with accelerations zero
  std::vector<Entry> gradient;
};

class Signal {
 public:
  enum class Source { node, abstract_node, joint };

  /// `quantity`: what of the source, numbered by its kind (node: see NodeSignal; joint: its row's list of signals).
  Signal(Source source, std::size_t index, int quantity) : source(source), index(index), quantity(quantity) {}

  const Source source;
  const std::size_t index;  ///< in Deck::nodes, Deck::abstract_nodes or Deck::joints
  const int quantity;
  mutable SignalValue now;  ///< at the state that the model has refreshed it with
};

/// Quantities of a structural node: three components each.
enum class NodeSignal { position = 0, velocity = 3, angular_velocity = 6, rotation_vector = 9 };

/// The value of a nested drive whose argument is the signal.
class SignalDrive final : public Drive {
 public:
  SignalDrive(std::shared_ptr<const Signal> signal, DrivePtr nested)
      : signal_(std::move(signal)), nested_(std::move(nested)) {}
  Jet at(double t) const override {
    const Jet jet = nested_->at_argument(signal_->now.value, t);
    return {jet.value, jet.rate * signal_->now.rate, 0.0};
  }
  Jet at_argument(double, double t) const override { return at(t); }
  void add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const override {
    out.push_back({signal_.get(), factor * nested_->at_argument(signal_->now.value, t).rate});
  }
  bool reads_state() const override { return true; }

 private:
  std::shared_ptr<const Signal> signal_;
  DrivePtr nested_;
};

}  // namespace mbdae
