// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/multistep.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "mbdae/dae/consistency.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/recorder.h"

namespace mbdae {

namespace {

constexpr MultistepCoefficients kImplicitEuler{1.0, 0.0, 1.0, 0.0, 0.0};
constexpr MultistepCoefficients kCrankNicolson{1.0, 0.0, 0.5, 0.5, 0.0};

// After so many iterations corrections are made with new factors, and halved while the residual falls by less than half
// of what they promise.
constexpr int kGoesRound = 8;
constexpr double kLeastShare = 1.0 / 64.0;
constexpr double kFarOff = 1e3;  // tolerances; nearer, Newton's method is on one side of the kink
// Newton has converged in all but name when the residual no longer falls below this part of the largest force.
constexpr double kRoundOff = 1e-13;

// Factors are kept from step to step as long as a correction brings the residual down to this part; with kept factors
// the iteration goes on to this part of the tolerance, where Newton's method would have arrived by itself.
constexpr double kWorthKeeping = 0.05, kKeptAccuracy = 1e-4, kKeptRoundOff = 1e-3;
constexpr double kSameStep = 1e-9;  // relative difference of step lengths that is round-off of the times

// Changes between stuck and sliding that one time step may hold; what more is asked for comes in the next one.
constexpr int kMostSwitches = 8;

// What the formula needs of an instant: rotations are kept as matrices and enter as increments from the latest one.
struct Instant {
  State state;
  Eigen::VectorXd rate;  // rates of x, beta, gamma; angular velocities in the rotation entries
};

class Stepper {
 public:
  Stepper(Model& model, const InitialValueData& settings) : model_(model), settings_(settings) {}

  // From instants k-2 and k-1 to k = k-1 + h.
  Instant step(const Instant& older, const Instant& last, double h, const MultistepCoefficients& formula) {
    const int n = model_.size(), nodes = static_cast<int>(model_.slots().size());
    Instant next = last;
    next.state.t = last.state.t + h;

    // Rates of the last two instants in the rotation chart about the last one, and what the formula takes from them.
    // The rotation itself is counted from the orientation and angular velocity predicted there: next = Rd(g) R_p, w =
    // G(g) g' + Rd(g) w_p with g = h b0 g', as MBDyn does.
    predicted_.resize(static_cast<std::size_t>(nodes));
    Eigen::VectorXd older_rate = older.rate;
    Eigen::VectorXd known = Eigen::VectorXd::Zero(n);  // y_k - h b0 y'_k
    for (int i = 0; i < nodes; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& o = motion_of(older.state, slot);
      const NodeMotion& l = motion_of(last.state, slot);
      const int x = slot.first, g = slot.first + 3;
      const Vec3 turned = cayley_parameters(o.R * l.R.transpose());
      older_rate.segment<3>(g) = cayley_tangent(turned).inverse() * o.w;
      known.segment<3>(x) = formula.a1 * l.x + formula.a2 * o.x;
      predicted_[static_cast<std::size_t>(i)] =
          predicted(formula, l, turned, older_rate.segment<3>(g), h, last.state.t - older.state.t);
      if (slot.has_rates()) {
        known.segment<6>(slot.force) =
            formula.a1 * last.state.y.segment<6>(slot.force) + formula.a2 * older.state.y.segment<6>(slot.force);
      }
    }
    for (int k = model_.own_start(); k < model_.reaction_start(); ++k) {
      if (!model_.algebraic(k)) known(k) = formula.a1 * last.state.y(k) + formula.a2 * older.state.y(k);
    }
    known += h * (formula.b1 * last.rate + formula.b2 * older_rate);
    for (const NodeSlot& slot : model_.slots()) known.segment<3>(slot.first + 3).setZero();

    // Predictor: rates continue on the line through the last two.
    const double spacing = last.state.t - older.state.t;
    Eigen::VectorXd rate = last.rate;
    if (spacing > 0.0) rate += (h / spacing) * (last.rate - older_rate);
    rate.tail(model_.reaction_count()).setZero();
    for (const NodeSlot& slot : model_.slots()) rate.segment<3>(slot.first + 3).setZero();

    const double c = h * formula.b0;
    double norm = 0.0;
    int switches = 0;
    bool renew = !lu_ || std::abs(lu_c_ - c) > kSameStep * c;
    bool kept = false;   // the last correction came from kept factors
    double share = 1.0;  // of a correction; less where Newton's method goes round in a kink (friction that turns)
    for (int iteration = 0; iteration <= settings_.max_iterations; ++iteration) {
      apply(known + c * rate, rate, next.state);
      model_.assemble(next.state, eq_, renew);
      const int first = model_.reaction_start(), count = model_.reaction_count();
      const double previous = norm;
      norm = std::sqrt(eq_.g.head(first).squaredNorm() + eq_.g.tail(count).squaredNorm() / (c * c));
      const double load = next.state.y.size() > 0 ? next.state.y.cwiseAbs().maxCoeff() : 0.0;
      const double round_off = kRoundOff * (1.0 + load) / c;
      const bool exhausted = iteration > 0 && norm >= previous && norm <= round_off;
      const double wanted =
          kept ? std::max(kKeptAccuracy * settings_.tolerance, kKeptRoundOff * round_off) : settings_.tolerance;
      const bool converged = norm <= std::min(wanted, settings_.tolerance);
      if (converged || exhausted) {
        if (model_.switch_modes(next.state, 0.0) && ++switches <= kMostSwitches) {
          iteration = -1;
          renew = true;
          continue;
        }
        next.rate = rate;
        for (const NodeSlot& slot : model_.slots()) {
          next.rate.segment<3>(slot.first + 3) = motion_of(next.state, slot).w;
        }
        return next;
      }
      if (!std::isfinite(norm)) break;

      Eigen::VectorXd g = eq_.g;
      g.tail(count) /= c;
      Eigen::VectorXd delta;
      if (!renew && (iteration < kGoesRound || norm <= kFarOff * settings_.tolerance) &&
          (!kept || norm < kWorthKeeping * previous)) {
        delta = by_factors(g);
        kept = true;
      } else {
        if (!renew) model_.assemble(next.state, eq_, true);
        delta = newton_step(known + c * rate, rate, c, g);
        renew = !lu_;
        kept = false;
      }
      if (iteration >= kGoesRound && norm > kFarOff * settings_.tolerance) {
        const bool slow = norm > (1.0 - 0.5 * share) * previous;
        share = slow ? std::max(0.5 * share, kLeastShare) : std::min(2.0 * share, 1.0);
        delta *= share;
      }
      for (int k = 0; k < first; ++k) (model_.algebraic(k) ? next.state.y : rate)(k) -= delta(k);
      next.state.y.tail(count) -= delta.tail(count);
    }
    const auto worst = static_cast<int>(worst_of(eq_.g));
    std::ostringstream out;
    out << "time step to t = " << next.state.t << " s did not converge";
    if (std::isfinite(norm)) {
      out << " in " << settings_.max_iterations << " iterations (residual " << norm << ", wanted "
          << settings_.tolerance << ")";
    }
    const bool constrained = std::isfinite(norm) && worst >= model_.own_start();
    const std::string contradicts = constrained ? contradiction(model_, last.state, next.state.t) : "";
    out << ": "
        << (contradicts.empty() ? model_.equation_off(worst, eq_.g(worst)) + "; use a shorter time step" : contradicts);
    if (constrained && contradicts.empty()) out << ", or look for constraints that contradict each other";
    if (!std::isfinite(norm)) out << ", or " << kLookForNoNumber;
    throw NotConverged(out.str());
  }

 private:
  // Newton's correction with new factors, which are kept unless the matrix is singular.
  Eigen::VectorXd newton_step(const Eigen::VectorXd& y, const Eigen::VectorXd& rate, double c,
                              const Eigen::VectorXd& g) {
    to_chart(y, rate);
    const int first = model_.reaction_start(), count = model_.reaction_count();
    Eigen::MatrixXd J = eq_.g_ydot + c * eq_.g_y;
    J.rightCols(count) = eq_.g_y.rightCols(count);
    for (int k = model_.scalar_start(); k < first; ++k) {
      if (model_.algebraic(k)) J.col(k) = eq_.g_y.col(k);
    }
    J.bottomRows(count) /= c;
    row_scale_ = column_scale_ = Eigen::VectorXd::Ones(J.rows());
    lu_.emplace(J);
    lu_c_ = c;
    if (is_singular(*lu_) && J.rows() > 0) {
      // Perhaps by its units only: a force on a seat that follows a state stands in its equations with c squared.
      const auto inverse = [](double largest) { return largest > 0.0 ? 1.0 / largest : 1.0; };
      row_scale_ = J.cwiseAbs().rowwise().maxCoeff().unaryExpr(inverse);
      J = row_scale_.asDiagonal() * J;
      column_scale_ = J.cwiseAbs().colwise().maxCoeff().transpose().unaryExpr(inverse);
      J = J * column_scale_.asDiagonal();
      lu_.emplace(J);
    }
    const Eigen::VectorXd scaled = row_scale_.cwiseProduct(g);
    if (is_singular(*lu_)) {
      lu_.reset();
      return column_scale_.cwiseProduct(robust_solve(J, scaled));
    }
    Eigen::VectorXd delta = lu_->solve(scaled);
    delta += lu_->solve(scaled - J * delta);
    return column_scale_.cwiseProduct(delta);
  }

  /// The correction by the factors at hand.
  Eigen::VectorXd by_factors(const Eigen::VectorXd& g) const {
    return column_scale_.cwiseProduct(lu_->solve(row_scale_.cwiseProduct(g)));
  }

  /// Orientation and angular velocity that a node's rotation increments are counted from.
  struct Predicted {
    Mat3 R;
    Vec3 w;
  };

  // The rate goes on along the cubic through the last two instants, h after them; a first or one-step formula has the
  // last rate. The formula then gives the rotation.
  static Predicted predicted(const MultistepCoefficients& formula, const NodeMotion& last, const Vec3& turned,
                             const Vec3& older_rate, double h, double spacing) {
    Vec3 rate = last.w;
    const bool two_step = formula.a2 != 0.0 || formula.b2 != 0.0;
    if (two_step && spacing > 0.0) {
      const double a = h / spacing;
      rate = (6.0 * a * (1.0 + a) / spacing) * turned + (1.0 + 4.0 * a + 3.0 * a * a) * last.w +
             a * (2.0 + 3.0 * a) * older_rate;
    }
    const Vec3 g = formula.a2 * turned + h * (formula.b0 * rate + formula.b1 * last.w + formula.b2 * older_rate);
    return {cayley_rotation(g) * last.R, cayley_tangent(g) * rate};
  }

  // Unknowns about the predicted pose to motions of the nodes, momenta and their rates.
  void apply(const Eigen::VectorXd& y, const Eigen::VectorXd& rate, State& out) const {
    for (std::size_t i = 0; i < out.nodes.size(); ++i) {
      const NodeSlot& slot = model_.slots()[i];
      const Vec3 g = y.segment<3>(slot.first + 3);
      out.nodes[i].x = y.segment<3>(slot.first);
      out.nodes[i].v = rate.segment<3>(slot.first);
      const Mat3 turn = cayley_rotation(g);
      out.nodes[i].R = turn * predicted_[i].R;
      out.nodes[i].w = cayley_tangent(g) * rate.segment<3>(slot.first + 3) + turn * predicted_[i].w;
      if (slot.has_rates()) {
        out.y.segment<6>(slot.force) = y.segment<6>(slot.force);
        out.ydot.segment<6>(slot.force) = rate.segment<6>(slot.force);
      }
    }
    for (int k = model_.own_start(); k < model_.reaction_start(); ++k) {
      if (model_.algebraic(k)) continue;
      out.y(k) = y(k);
      out.ydot(k) = rate(k);
    }
  }

  // Columns of rotations from variations (dphi, dw) to increments (dg, dgdot).
  void to_chart(const Eigen::VectorXd& y, const Eigen::VectorXd& rate) {
    for (std::size_t i = 0; i < model_.slots().size(); ++i) {
      const int g = model_.slots()[i].first + 3;
      const Vec3 increment = y.segment<3>(g);
      const Mat3 G = cayley_tangent(increment);
      const Mat3 carried =
          skew(cayley_rotation(increment) * predicted_[i].w) * G;  // the predicted velocity turns along
      eq_.g_y.middleCols<3>(g) =
          (eq_.g_y.middleCols<3>(g) * G +
           eq_.g_ydot.middleCols<3>(g) * (cayley_rate_derivative(increment, rate.segment<3>(g)) - carried))
              .eval();
      eq_.g_ydot.middleCols<3>(g) = (eq_.g_ydot.middleCols<3>(g) * G).eval();
    }
  }

  Model& model_;
  const InitialValueData& settings_;
  Equations eq_;
  std::optional<Eigen::PartialPivLU<Eigen::MatrixXd>> lu_;  // of the last matrix that was factorised
  Eigen::VectorXd row_scale_, column_scale_;                // of the factored matrix
  double lu_c_ = 0.0;                                       // h b0 that it was made with
  std::vector<Predicted> predicted_;                        // one per node
};

}  // namespace

MultistepCoefficients multistep_coefficients(double rho) {
  const double q = (1.0 - rho) * (1.0 - rho), d = 4.0 - q;
  const double beta = (4.0 * rho * rho - q) / d, delta = 0.5 * q / d;
  return {1.0 - beta, beta, 0.5 + delta, 0.5 + 0.5 * beta - 2.0 * delta, 0.5 * beta + delta};
}

Motion integrate_multistep(Model& model, const State& state, const InitialValueData& settings,
                           const IntegrateOptions& options, const AtInstant& at_instant) {
  const bool two_step = settings.method == MethodKind::ms;
  const MultistepCoefficients regular = two_step ? multistep_coefficients(settings.rho)
                                        : settings.method == MethodKind::implicit_euler ? kImplicitEuler
                                                                                        : kCrankNicolson;
  MotionRecorder recorder(model, options.channels);
  recorder.record(state, state.t);

  model.accept(state);
  model.set_reference(state);
  Instant last{state, state.ydot};
  for (const NodeSlot& slot : model.slots()) {
    last.rate.segment<3>(slot.first) = motion_of(state, slot).v;
    last.rate.segment<3>(slot.first + 3) = motion_of(state, slot).w;
  }
  Instant older = last;

  Stepper stepper(model, settings);
  const double t0 = settings.initial_time, h = settings.time_step;
  const long steps = count_steps(settings);
  for (long k = 1; k <= steps; ++k) {
    // The first step of the two-step formula is a Crank-Nicolson step.
    Instant next = stepper.step(older, last, t0 + static_cast<double>(k) * h - last.state.t,
                                k == 1 && two_step ? kCrankNicolson : regular);
    older = std::move(last);
    last = std::move(next);
    model.accept(last.state);
    model.carry_reference(last.state);
    if (k % options.output_every == 0 || k == steps) recorder.record(last.state, last.state.t);
    if (options.progress) options.progress(last.state.t);
    if (at_instant && !at_instant(last.state)) break;
  }
  return recorder.take();
}

}  // namespace mbdae
