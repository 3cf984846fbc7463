// The analysis `linearise`: the state that a deck implies, and the linearised model there.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linearise_at_state.h"

namespace mbdae {

LinearisedModel linearise(const Deck& deck, const LineariseOptions& options) {
  Model model = make_model(deck);
  State state = model.initial_state();
  model.set_reference(state);
  check_constraints(model, state);
  if (options.state) {
    if (options.state->size() != model.size()) {
      throw ModelError("the state to linearise at has " + std::to_string(options.state->size()) +
                       " entries, the deck has " + std::to_string(model.size()) + " unknowns");
    }
    state.y = *options.state;
    if (!model.file_order().empty()) state.y(model.file_order()) = *options.state;
    solve_state_rates(model, state);
  } else {
    solve_accelerations(model, state);
  }
  return linearise_at_state(model, state, options.c.value_or(deck_coefficient(deck)), "linearise");
}

}  // namespace mbdae
