// Rows of a time history: which channels exist, and their values at a state.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mbdae/dae/linearised_model.h"
#include "mbdae/model/model.h"

namespace mbdae {

class MotionRecorder {
 public:
  /// `wanted`: names of channels, empty = all. Throws ModelError on a name that does not exist.
  MotionRecorder(const Model& model, const std::vector<std::string>& wanted);

  /// Appends the state's values under the given time [s]; reactions are taken from state.y.
  void record(const State& state, double time);

  Motion take();

 private:
  const Model& model_;
  std::vector<int> momenta_;          // unknowns that are momenta
  std::vector<std::size_t> columns_;  // of all channels, those wanted
  std::vector<double> values_, row_;
  Motion motion_;
};

}  // namespace mbdae
