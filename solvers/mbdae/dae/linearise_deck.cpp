// The analysis `linearise`: the state that a deck implies, and the linearised model there.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <string>
#include <utility>
#include <vector>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linearise_at_state.h"

namespace mbdae {

namespace {

// Momenta, reactions and modal unknowns of a file; a modal joint or node without any (all zero) keeps the deck's.
void impose(const Model& model, const Eigen::VectorXd& file, State& state) {
  const State deck = state;
  state.y = file;
  const std::vector<int>& order = model.file_order();
  for (std::size_t i = 0; i < order.size(); ++i) state.y(order[i]) = file(static_cast<Eigen::Index>(i));
  for (std::size_t i = 0; i < model.slots().size(); ++i) {
    const NodeSlot& slot = model.slots()[i];
    if (!slot.modal) continue;
    if (state.y.segment<6>(slot.force).isZero(0.0)) state.y.segment<6>(slot.force) = deck.y.segment<6>(slot.force);
    state.nodes[i].v = state.y.segment<3>(slot.force);
    state.nodes[i].w = state.y.segment<3>(slot.force + 3);
  }
  for (const FlexibleEntry& entry : model.flexible()) {
    const int own = entry.body->first_displacement(), n = 2 * entry.body->modes();
    if (state.y.segment(own, n).isZero(0.0)) state.y.segment(own, n) = deck.y.segment(own, n);
  }
}

}  // namespace

LinearisedModel linearise(const Deck& deck, const LineariseOptions& options) {
  Model model = make_model(deck);
  std::vector<std::string> notes;
  State state = consistent_state(model, notes);
  Eigen::VectorXd accelerations;
  if (options.state) {
    if (options.state->size() != model.size()) {
      throw ModelError("the state to linearise at has " + std::to_string(options.state->size()) +
                       " entries, the deck has " + std::to_string(model.size()) + " unknowns");
    }
    impose(model, *options.state, state);
    solve_state_rates(model, state);
    accelerations = modal_accelerations(model, state);
  } else {
    accelerations = solve_accelerations(model, state);
  }
  LinearisedModel out =
      linearise_at_state(model, state, options.c.value_or(deck_coefficient(deck)), "linearise", accelerations);
  out.notes = std::move(notes);
  return out;
}

}  // namespace mbdae
