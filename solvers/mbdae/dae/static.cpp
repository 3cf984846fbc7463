// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linearise_at_state.h"
#include "mbdae/dae/static_solver.h"

namespace mbdae {

namespace {

constexpr int kSmallestLoadStep = 64;  // times smaller than the regular one

// The residual at the initial configuration, which shows whether anything depends on time.
Eigen::VectorXd residual_at(const Model& model, State state, double t) {
  Equations eq;
  state.t = t;
  model.assemble_statics(state, eq, false);
  return eq.g;
}

bool depends_on_time(const Model& model, const State& state, double t0, double t1) {
  const Eigen::VectorXd start = residual_at(model, state, t0);
  for (const double part : {0.31, 0.77, 1.0}) {  // irregular, so that periodic drives do not hide
    if (residual_at(model, state, t0 + part * (t1 - t0)) != start) return true;
  }
  return false;
}

}  // namespace

LinearisedModel solve_static(const Deck& deck, const StaticOptions& options) {
  if (!deck.control.static_model) {
    throw ModelError("static equilibrium needs `model: static;` in the deck's control data");
  }
  Model model = make_model(deck);
  const State initial = model.initial_state();
  const double t0 = deck.initial_value.initial_time, t1 = deck.initial_value.final_time;
  StaticSolver solver(model, initial, options);

  solver.solve_at(t0);
  if (std::isfinite(t1) && t1 > t0 && depends_on_time(model, initial, t0, t1)) {
    // Time is the load parameter: the deck's steps, at most `load_steps` of them, halved where Newton fails.
    const double h = deck.initial_value.time_step;
    const double steps = h > 0.0 ? std::ceil((t1 - t0) / h - 1e-9) : 1.0;
    const double regular = (t1 - t0) / std::clamp(steps, 1.0, std::max(1.0, static_cast<double>(options.load_steps)));
    double t = t0, step = regular;
    while (t < t1) {
      const double next = t + step > t1 - 1e-9 * regular ? t1 : t + step;
      try {
        solver.solve_at(next);
        t = next;
        step = std::min(2.0 * step, regular);
      } catch (const NotConverged&) {
        step *= 0.5;
        if (step < regular / kSmallestLoadStep) throw;
      }
    }
  }

  State state = solver.state();
  LinearisedModel out =
      linearise_at_state(model, state, deck_coefficient(deck), "static", Eigen::VectorXd::Zero(model.motion_count()));
  out.iterations = solver.iterations();
  return out;
}

}  // namespace mbdae
