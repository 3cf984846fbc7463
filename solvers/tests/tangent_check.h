// Tangents of a deck's elements against finite differences of their residual, in a state that fits nothing.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <catch2/catch.hpp>

#include <functional>

#include "deck_builder.h"
#include "mbdae/model/model.h"

namespace mbdae::test {

// The unknowns about a reference state: x, g (Cayley-Gibbs-Rodrigues, R = Rd(g) R_ref), beta, gamma, reactions; with
// rates gdot such that w = G(g) gdot + Rd(g) w_ref.
inline State moved(const Model& model, const State& reference, const Eigen::VectorXd& dy,
                   const Eigen::VectorXd& dydot) {
  State state = reference;
  state.y += dy;
  state.ydot += dydot;
  for (std::size_t i = 0; i < state.nodes.size(); ++i) {
    const int first = model.slots()[i].first;
    const Vec3 g = dy.segment<3>(first + 3), gdot = dydot.segment<3>(first + 3);
    const Mat3 turn = cayley_rotation(g);
    state.nodes[i].x += dy.segment<3>(first);
    state.nodes[i].v += dydot.segment<3>(first);
    state.nodes[i].R = turn * reference.nodes[i].R;
    state.nodes[i].w = cayley_tangent(g) * gdot + turn * reference.nodes[i].w;
  }
  return state;
}

// Central differences with one Richardson step: error of order h^4.
inline Eigen::VectorXd derivative(const std::function<Eigen::VectorXd(double)>& f) {
  const double h = 2e-3;
  const auto slope = [&](double step) -> Eigen::VectorXd { return (f(step) - f(-step)) / (2.0 * step); };
  const Eigen::VectorXd a = slope(h), b = slope(h / 2), c = slope(h / 4);
  const Eigen::VectorXd ab = (4.0 * b - a) / 3.0, bc = (4.0 * c - b) / 3.0;
  return (16.0 * bc - ab) / 15.0;
}

inline void check_tangents(const Deck& deck, unsigned seed, double tolerance = 1e-10) {
  Ugly ugly(seed);
  Model model(deck);
  State state = model.initial_state();
  state.t = 0.37;
  for (int k = 0; k < model.size(); ++k) {
    state.y(k) += ugly.number(-3.0, 3.0);  // momenta and reactions that fit nothing
    state.ydot(k) = ugly.number(-3.0, 3.0);
  }
  model.set_reference(state);
  Equations eq;
  model.assemble(state, eq, true);
  model.to_increments(state, eq);

  const int n = model.size();
  Equations work;
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k) {
    const Eigen::VectorXd unit = Eigen::VectorXd::Unit(n, k);
    const Eigen::VectorXd by_y = derivative([&](double h) {
      model.assemble(moved(model, state, h * unit, zero), work, false);
      return work.g;
    });
    const Eigen::VectorXd by_ydot = derivative([&](double h) {
      model.assemble(moved(model, state, zero, h * unit), work, false);
      return work.g;
    });
    INFO("column " << model.unknown_name(k));
    const double scale = 1.0 + by_y.norm() + by_ydot.norm();
    CHECK((by_y - eq.g_y.col(k)).norm() / scale < tolerance);
    CHECK((by_ydot - eq.g_ydot.col(k)).norm() / scale < tolerance);
  }

  // Velocity terms of the constraints: rate_q is the derivative of the velocity constraint, rate that of phi in time.
  ConstraintRates rates, rate_work;
  model.rates(state, rates, true);
  const int first = model.reaction_start(), count = model.reaction_count();
  const auto velocity_constraint = [&](const State& s) {
    model.rates(s, rate_work, false);
    model.assemble(s, work, false);
    Eigen::VectorXd out = rate_work.rate.tail(count);
    for (const ConstraintEntry& entry : model.constraints()) {
      for (int i = 0; i < entry.constraint->size(); ++i) {
        const int row = entry.constraint->first() + i;
        if (entry.constraint->velocity_level(i)) out(row - first) = work.g(row);
      }
    }
    return out;
  };
  for (std::size_t i = 0; i < state.nodes.size(); ++i) {
    for (int k = 0; k < 6; ++k) {
      const int column = model.slots()[i].first + k;
      const Eigen::VectorXd by_q = derivative([&](double h) {
        State s = state;
        if (k < 3) {
          s.nodes[i].x(k) += h;
        } else {
          s.nodes[i].R = rotation_exp(h * Vec3::Unit(k - 3)) * s.nodes[i].R;
        }
        return velocity_constraint(s);
      });
      INFO("rate_q column " << model.unknown_name(column));
      CHECK((by_q - rates.rate_q.col(column).tail(count)).norm() / (1.0 + by_q.norm()) < tolerance);
    }
  }
  for (const FlexibleEntry& entry : model.flexible()) {
    for (int k = 0; k < entry.body->modes(); ++k) {
      const int column = entry.body->first_displacement() + k;
      const Eigen::VectorXd by_q = derivative([&](double h) {
        State s = state;
        s.y(column) += h;
        return velocity_constraint(s);
      });
      INFO("rate_q column " << model.unknown_name(column));
      CHECK((by_q - rates.rate_q.col(column).tail(count)).norm() / (1.0 + by_q.norm()) < tolerance);
    }
  }

  // Along a motion with constant velocity and angular velocity (zero accelerations).
  const auto at_time = [&](double h) {
    State s = state;
    s.t += h;
    for (NodeMotion& node : s.nodes) {
      node.x += h * node.v;
      node.R = rotation_exp(h * node.w) * node.R;
    }
    for (const FlexibleEntry& entry : model.flexible()) {
      const int own = entry.body->first_displacement(), m = entry.body->modes();
      s.y.segment(own, m) += h * s.y.segment(own + m, m);
    }
    return s;
  };
  const Eigen::VectorXd phi_rate = derivative([&](double h) {
    model.assemble(at_time(h), work, false);
    return Eigen::VectorXd(work.g.tail(count));
  });
  const Eigen::VectorXd bias = derivative([&](double h) { return velocity_constraint(at_time(h)); });
  for (const ConstraintEntry& entry : model.constraints()) {
    for (int i = 0; i < entry.constraint->size(); ++i) {
      const int row = entry.constraint->first() + i - first;
      INFO(joint_title(*entry.data) << " row " << i + 1);
      if (!entry.constraint->velocity_level(i)) {
        CHECK(std::abs(rates.rate(first + row) - phi_rate(row)) / (1.0 + std::abs(phi_rate(row))) < tolerance);
      }
      CHECK(std::abs(rates.bias(first + row) - bias(row)) / (1.0 + std::abs(bias(row))) < tolerance);
    }
  }
}

}  // namespace mbdae::test
