// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <string>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/ida.h"
#include "mbdae/dae/multistep.h"

namespace mbdae {

namespace {

InitialValueData settings_of(const Deck& deck, const IntegrateOptions& options) {
  InitialValueData settings = deck.initial_value;
  if (options.final_time) settings.final_time = *options.final_time;
  if (options.time_step) settings.time_step = *options.time_step;
  if (!std::isfinite(settings.final_time)) {
    throw ModelError("the final time is `forever`: give a finite one in the deck or on the command line");
  }
  if (!(settings.final_time >= settings.initial_time)) {
    throw ModelError("the final time " + std::to_string(settings.final_time) + " s lies before the initial time " +
                     std::to_string(settings.initial_time) + " s");
  }
  if (settings.time_step == 0.0) {
    throw ModelError("the deck has no time step: give one in the deck or on the command line");
  }
  if (!(settings.time_step > 0.0) || !std::isfinite(settings.time_step)) {
    throw ModelError("the time step must be positive, it is " + std::to_string(settings.time_step) + " s");
  }
  if (options.output_every < 1) {
    throw ModelError("output every " + std::to_string(options.output_every) + " time steps: must be at least 1");
  }
  if (!(options.rtol > 0.0) || !(options.atol > 0.0)) {
    throw ModelError("the relative and absolute tolerance must be positive");
  }
  return settings;
}

}  // namespace

Motion integrate(const Deck& deck, const IntegrateOptions& options) {
  if (options.integrator != "ida" && options.integrator != "ms") {
    throw ModelError("unknown integrator '" + options.integrator + "': use 'ida' or 'ms'");
  }
  if (deck.control.static_model) {
    throw ModelError(
        "a deck with `model: static;` has no motion to integrate: remove the card or ask for the "
        "static equilibrium");
  }
  const InitialValueData settings = settings_of(deck, options);
  if (options.integrator == "ms" && settings.method == MethodKind::other) {
    throw ModelError("method `" + settings.method_text +
                     "` is not available: use `ms, RHO`, `implicit euler` or `crank nicolson` in the deck, or IDA");
  }

  Model model = make_model(deck);
  State state = model.initial_state();
  model.set_reference(state);
  check_constraints(model, state);
  const Eigen::VectorXd accelerations = solve_accelerations(model, state);
  if (options.integrator == "ida") return integrate_ida(model, state, accelerations, settings, options);

  Equations eq;
  model.assemble(state, eq, false);  // with momenta rates zero: what is left of the balance is minus the rates
  for (const NodeSlot& slot : model.slots()) {
    if (slot.dynamic) state.ydot.segment<6>(slot.force) = -eq.g.segment<6>(slot.force);
  }
  model.set_modal_rates(state, accelerations);
  return integrate_multistep(model, state, settings, options);
}

}  // namespace mbdae
