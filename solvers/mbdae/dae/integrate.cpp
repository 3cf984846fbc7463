// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/ida.h"
#include "mbdae/dae/linearise_at_state.h"
#include "mbdae/dae/multistep.h"

namespace mbdae {

namespace {

std::string text(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

/// Refuses histories that would not fit in memory.
void check_rows(const Model& model, long steps, const IntegrateOptions& options) {
  constexpr double kMostBytes = 4e9;
  const double rows = static_cast<double>(steps / options.output_every) + 2.0;
  const std::size_t all =
      12 * model.slots().size() + static_cast<std::size_t>(model.reaction_count()) + 3 * model.muscles().size();
  const double columns = static_cast<double>(options.channels.empty() ? all : options.channels.size()) + 1.0;
  if (8.0 * rows * columns > kMostBytes) {
    throw ModelError("the time history would have " + text(rows) + " rows of " + text(columns) +
                     " numbers, more than 4 GB: write fewer (every n-th time step, fewer channels)");
  }
}

/// Momenta rates of a state with accelerations and reactions solved for.
void set_momenta_rates(const Model& model, State& state) {
  Equations eq;
  model.assemble(state, eq, false);  // with momenta rates zero: what is left of the balance is minus the rates
  for (const NodeSlot& slot : model.slots()) {
    if (slot.dynamic) state.ydot.segment<6>(slot.force) = -eq.g.segment<6>(slot.force);
  }
}

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

long count_steps(const InitialValueData& settings) {
  constexpr double kMost = 1e9;
  const double span = settings.final_time - settings.initial_time, steps = std::floor(span / settings.time_step + 1e-6);
  if (!(steps <= kMost)) {
    throw ModelError("time steps of " + text(settings.time_step) + " s over " + text(span) +
                     " s are more than 1e9 steps: give a larger time step");
  }
  const double largest = std::max(std::abs(settings.initial_time), std::abs(settings.final_time));
  if (steps > 0.0 && settings.time_step < 8.0 * std::numeric_limits<double>::epsilon() * largest) {
    throw ModelError("a time step of " + text(settings.time_step) + " s is lost in the round-off of times of " +
                     text(largest) + " s: give a larger time step");
  }
  return static_cast<long>(steps);
}

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
  check_rows(model, count_steps(settings), options);
  std::vector<std::string> notes;
  State state = consistent_state(model, notes);
  const Eigen::VectorXd accelerations = solve_accelerations(model, state);
  Motion motion;
  if (options.integrator == "ida") {
    motion = integrate_ida(model, state, settings, options);
  } else {
    set_momenta_rates(model, state);
    model.set_modal_rates(state, accelerations);
    motion = integrate_multistep(model, state, settings, options);
  }
  motion.notes.insert(motion.notes.begin(), notes.begin(), notes.end());
  return motion;
}

std::vector<LinearisedModel> linearise_at_times(const Deck& deck, const LineariseOptions& options) {
  const double t0 = deck.initial_value.initial_time;
  std::vector<double> times;
  if (deck.initial_value.eigenanalysis) times = deck.initial_value.eigenanalysis->times;
  std::vector<LinearisedModel> out;
  if (times.empty() || times.front() <= t0) out.push_back(linearise(deck, options));
  std::size_t next = 0;
  while (next < times.size() && times[next] <= t0) ++next;
  if (next == times.size()) return out;

  IntegrateOptions integration;
  integration.channels = {};
  InitialValueData settings = settings_of(deck, integration);
  Model model = make_model(deck);
  std::vector<std::string> notes;
  State state = consistent_state(model, notes);
  const Eigen::VectorXd accelerations = solve_accelerations(model, state);
  const double c = options.c.value_or(deck_coefficient(deck));
  const double h = settings.time_step;
  State last = state;
  const bool by_ida = settings.method == MethodKind::other;
  const auto linearise_here = [&] {
    State here = last;
    if (by_ida) {  // `ms` carries a reference along
      model.follow_free_rotations(false);
      model.set_reference(here);
    }
    out.push_back(linearise_at_state(model, here, c, "linearise", modal_accelerations(model, here)));
    if (by_ida) model.follow_free_rotations(true);
    out.back().notes = notes;
  };
  const auto at_instant = [&](const State& now) {
    last = now;
    const std::size_t before = next;
    while (next < times.size() && times[next] <= now.t + 1e-9 * h) ++next;  // rounded sums of steps count as the time
    if (next > before) linearise_here();
    return next < times.size();
  };
  if (by_ida) {
    notes.push_back("the method `" + settings.method_text + "` is not available: the state at the times of the " +
                    "eigenanalysis was reached with IDA");
    integrate_ida(model, state, settings, integration, at_instant);
  } else {
    set_momenta_rates(model, state);
    model.set_modal_rates(state, accelerations);
    integrate_multistep(model, state, settings, integration, at_instant);
  }
  if (next < times.size()) linearise_here();  // what is still due when the run ends
  return out;
}

}  // namespace mbdae
