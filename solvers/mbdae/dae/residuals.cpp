// The analysis `residuals`: the equations along a motion that somebody else proposes, as balances of harmonics do.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linearise_at_state.h"

namespace mbdae {

namespace {

constexpr int kMostInstants = 8192;  // of a period: a table of sines and the samples stay below 1 GB

void refuse_memory(Model& model) {
  for (const ConstraintEntry& entry : model.constraints()) {
    if (!entry.constraint->has_modes()) continue;
    throw ModelError(joint_title(*entry.data) +
                     " sticks and slides: its equations depend on what was before, and a motion alone has no residual; "
                     "leave its friction out, or use modlugre");
  }
}

// `reference` moved by increments of the unknowns: rotations are counted from its orientations, R = R(g) R_0, and
// w = G(g) g' + R(g) w_0.
void move(const Model& model, const State& reference, const Eigen::VectorXd& y, const Eigen::VectorXd& ydot,
          State& out) {
  out.y = reference.y + y;
  out.ydot = reference.ydot + ydot;
  for (std::size_t i = 0; i < out.nodes.size(); ++i) {
    const int x = model.slots()[i].first, g = x + 3;
    const NodeMotion& at = reference.nodes[i];
    const Vec3 increment = y.segment<3>(g);
    const Mat3 turn = cayley_rotation(increment);
    out.nodes[i].x = at.x + y.segment<3>(x);
    out.nodes[i].v = at.v + ydot.segment<3>(x);
    out.nodes[i].R = turn * at.R;
    out.nodes[i].w = cayley_tangent(increment) * ydot.segment<3>(g) + turn * at.w;
  }
}

// Columns of rotations from variations (dphi, dw) to increments (dg, dg').
void to_chart(const Model& model, const State& reference, const Eigen::VectorXd& y, const Eigen::VectorXd& ydot,
              Equations& eq) {
  for (std::size_t i = 0; i < model.slots().size(); ++i) {
    const int g = model.slots()[i].first + 3;
    const Vec3 increment = y.segment<3>(g);
    const Mat3 G = cayley_tangent(increment);
    const Mat3 carried = skew(cayley_rotation(increment) * reference.nodes[i].w) * G;
    const Mat3 by_g = cayley_rate_derivative(increment, ydot.segment<3>(g)) - carried;
    eq.g_y.middleCols<3>(g) = (eq.g_y.middleCols<3>(g) * G + eq.g_ydot.middleCols<3>(g) * by_g).eval();
    eq.g_ydot.middleCols<3>(g) = (eq.g_ydot.middleCols<3>(g) * G).eval();
  }
}

}  // namespace

struct ResidualsAlong::Prepared {
  explicit Prepared(const Deck& deck) : model(make_model(deck)), order(model.file_order()) {
    refuse_memory(model);
    std::vector<std::string> notes;
    reference = consistent_state(model, notes);
    model.follow_free_rotations(true);  // no reference that follows the motion: samples have no order
    const Eigen::VectorXd accelerations = solve_accelerations(model, reference);
    linearise_at_state(model, reference, deck_coefficient(deck), "residuals", accelerations);  // sets its rates
    for (int k = 0; order.size() < static_cast<std::size_t>(model.size()); ++k) order.push_back(k);
  }

  Model model;
  std::vector<int> order;
  State reference;
};

ResidualsAlong::ResidualsAlong(const Deck& deck) {
  if (deck.control.static_model) {
    throw ModelError("a deck with 'model: static' has no motions: residuals along one need a dynamic deck");
  }
  prepared_ = std::make_unique<const Prepared>(deck);
}

ResidualsAlong::~ResidualsAlong() = default;

Residuals ResidualsAlong::operator()(const Eigen::VectorXd& samples, int tangents_every) const {
  const Model& model = prepared_->model;
  const State& reference = prepared_->reference;
  const std::vector<int>& order = prepared_->order;
  const Eigen::Index n = model.size();
  if (samples.size() == 0 || samples.size() % (2 * n) != 0) {
    throw std::invalid_argument("the samples are " + std::to_string(samples.size()) +
                                " numbers; expected rows of 2 x " + std::to_string(n) +
                                ", y and ydot of the deck's unknowns");
  }
  const Eigen::Index count = samples.size() / (2 * n);
  Residuals out;
  out.g.resize(n, count);
  Eigen::MatrixXd g_y = Eigen::MatrixXd::Zero(n, n), g_ydot = g_y;
  Eigen::VectorXd y(n), ydot(n);
  State state = reference;
  Equations eq;
  const auto where = [&](Eigen::Index sample, Eigen::Index k) {
    return "sample " + std::to_string(sample + 1) + " of " + std::to_string(count) + ", " +
           model.unknown_name(order[static_cast<std::size_t>(k)]);
  };
  for (Eigen::Index sample = 0; sample < count; ++sample) {
    const auto row = samples.segment(2 * n * sample, 2 * n);
    for (Eigen::Index k = 0; k < 2 * n; ++k) {
      if (!std::isfinite(row(k))) {
        throw std::invalid_argument("the samples have no finite " + std::string(k < n ? "value" : "rate") + " in " +
                                    where(sample, k % n));
      }
      (k < n ? y : ydot)(order[static_cast<std::size_t>(k % n)]) = row(k);
    }
    move(model, reference, y, ydot, state);
    const bool tangents = tangents_every > 0 && sample % tangents_every == 0;
    model.assemble(state, eq, tangents);
    out.g.col(sample) = eq.g(order);
    for (Eigen::Index k = 0; k < n; ++k) {
      if (std::isfinite(out.g(k, sample))) continue;
      throw NotConverged("the residual is not finite in the equation of " + where(sample, k));
    }
    if (tangents) {
      to_chart(model, reference, y, ydot, eq);
      g_y += eq.g_y;
      g_ydot += eq.g_ydot;
    }
  }
  if (tangents_every > 0) {
    const double share = 1.0 / static_cast<double>((count + tangents_every - 1) / tangents_every);
    out.mean_g_y = share * g_y(order, order);
    out.mean_g_ydot = share * g_ydot(order, order);
  }
  return out;
}

Residuals ResidualsAlong::of_harmonics(const Eigen::VectorXd& harmonics, int count, int instants,
                                       int tangents_every) const {
  const Eigen::Index n = prepared_->model.size(), parts = 2 * Eigen::Index{count} + 1;
  if (harmonics.size() != 2 * n * parts) {
    throw std::invalid_argument("the motion is " + std::to_string(harmonics.size()) + " numbers; expected 2 x " +
                                std::to_string(n) + " x " + std::to_string(parts) +
                                ", harmonics of the deck's unknowns and of their rates");
  }
  if (instants > kMostInstants) {
    throw std::invalid_argument(std::to_string(instants) + " instants of a period are too many; " +
                                std::to_string(kMostInstants) + " at most");
  }
  if (instants < parts) {
    throw std::invalid_argument(std::to_string(instants) + " instants cannot tell " + std::to_string(count) +
                                " harmonics; give " + std::to_string(parts) + " or more");
  }
  Eigen::MatrixXd in_time(parts, instants);  // row by part: 1, cos, -sin, ...
  for (Eigen::Index k = 0; k < parts; ++k) {
    for (int i = 0; i < instants; ++i) {
      const auto turns = static_cast<double>((k + 1) / 2 * i % instants);  // exact, whatever the harmonic
      const double phase = 2.0 * std::numbers::pi * turns / instants;
      in_time(k, i) = k == 0 ? 1.0 : k % 2 == 1 ? std::cos(phase) : -std::sin(phase);
    }
  }
  const Eigen::Map<const Eigen::MatrixXd> given(harmonics.data(), parts, 2 * n);
  const Eigen::MatrixXd samples = given.transpose() * in_time;
  Residuals out = (*this)(Eigen::Map<const Eigen::VectorXd>(samples.data(), samples.size()), tangents_every);
  Eigen::VectorXd share = Eigen::VectorXd::Constant(parts, 2.0 / instants);
  share(0) = 1.0 / instants;
  out.g = (out.g * in_time.transpose() * share.asDiagonal()).eval();
  return out;
}

}  // namespace mbdae
