// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/friction.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "mbdae/deck/scalar_reader.h"

namespace mbdae {

namespace {
double sign(double x) { return x < 0.0 ? -1.0 : 1.0; }

constexpr double kCreeps = 100.0;  // times `still`: a speed that is kept as v0 when sliding ends
constexpr double kSlack = 1e-9;    // of mu(0): how far beyond it |f| may be before a variable step lets go
}  // namespace

Friction::Point Friction::point(const State& state) const {
  Point at;
  at.e = motion_of(state, node1_).R * axis_;
  at.w = motion_of(state, node1_).w - motion_of(state, node2_).w;
  at.F = state.y.segment<3>(force_);
  at.v = data_.radius * at.e.dot(at.w);
  const double load = at.F.norm();
  at.loaded = load > data_.preload;
  at.N = at.loaded ? load : data_.preload;
  at.f = state.y(scalar_);
  if (!data_.coulomb) at.f = data_.sigma0 * at.f + data_.sigma1 * state.ydot(scalar_) + data_.sigma2 * at.v;
  const double root = std::sqrt(1.0 + at.f * at.f);
  at.s = data_.plane_hinge ? at.f / root : at.f;
  at.slope = data_.plane_hinge ? 1.0 / (root * root * root) : 1.0;
  return at;
}

Friction::Bristle Friction::bristle(double z, double v) const {
  const double speed = std::abs(v), mu = data_.mu->value(speed), mu_v = data_.mu->slope(speed) * sign(v);
  const double zs = mu / data_.sigma0, size = std::abs(z);
  double alpha = 0.0, alpha_z = 0.0, alpha_v = 0.0;
  if (z * sign(v) > 0.0 && size > data_.kappa * zs) {
    if (size >= zs) {
      alpha = 1.0;
    } else {
      const double width = (1.0 - data_.kappa) * zs, pi = std::numbers::pi;
      const double angle = pi * (size - 0.5 * (1.0 + data_.kappa) * zs) / width;
      alpha = 0.5 + 0.5 * std::sin(angle);
      alpha_z = 0.5 * std::cos(angle) * pi * sign(z) / width;
      alpha_v = -0.5 * std::cos(angle) * pi * size / (width * zs) * mu_v / data_.sigma0;
    }
  }
  const double q = speed / mu, q_v = sign(v) / mu - speed * mu_v / (mu * mu);
  Bristle out;
  out.value = alpha * data_.sigma0 * z * q;
  out.by_z = data_.sigma0 * q * (alpha + alpha_z * z);
  out.by_v = data_.sigma0 * z * (alpha_v * q + alpha * q_v);
  return out;
}

void Friction::assemble(const State& state, Equations& eq, bool tangent) const {
  const Point at = point(state);
  const double r = data_.radius, y = state.y(scalar_), M3 = at.s * at.N * r;
  add_to_g(eq.g, node1_, Vec3::Zero(), M3 * at.e);
  add_to_g(eq.g, node2_, Vec3::Zero(), -M3 * at.e);

  // own equation: by_y y-part, by_v the sliding speed
  double by_y = 0.0, by_v = 0.0;
  if (!data_.coulomb) {
    const Bristle b = bristle(y, at.v);
    eq.g(scalar_) += at.v - state.ydot(scalar_) - b.value;
    by_y = -b.by_z;
    by_v = 1.0 - b.by_v;
  } else if (stuck_) {
    eq.g(scalar_) -= at.v - creep_;
    by_v = -1.0;
  } else {
    const double speed = std::abs(at.v);
    eq.g(scalar_) += direction_ * data_.mu->value(speed) + data_.sigma2 * at.v - y;
    by_y = -1.0;
    by_v = direction_ * data_.mu->slope(speed) * sign(at.v) + data_.sigma2;
  }
  if (!tangent) return;

  const int g1 = rotation_column(node1_), g2 = rotation_column(node2_);
  const int M1 = moment_row(node1_), M2 = moment_row(node2_);
  // dv = r e.(dw1 - dw2) + r (e x w).dphi1
  const Vec3 by_w = r * at.e, by_phi = r * at.e.cross(at.w);
  eq.g_y(scalar_, scalar_) += by_y;
  if (!data_.coulomb) eq.g_ydot(scalar_, scalar_) -= 1.0;
  add_row(eq.g_ydot, scalar_, g1, by_v * by_w);
  add_row(eq.g_ydot, scalar_, g2, -by_v * by_w);
  add_row(eq.g_y, scalar_, g1, by_v * by_phi);

  const double per_f = at.slope * at.N * r;
  const double f_y = data_.coulomb ? 1.0 : data_.sigma0, f_v = data_.coulomb ? 0.0 : data_.sigma2;
  const struct {
    int row;
    double s;
  } ends[2] = {{M1, 1.0}, {M2, -1.0}};
  for (const auto& [row, s] : ends) {
    if (row < 0) continue;
    add_column(eq.g_y, row, scalar_, s * per_f * f_y * at.e);
    if (!data_.coulomb) add_column(eq.g_ydot, row, scalar_, s * per_f * data_.sigma1 * at.e);
    const Mat3 by_speed = s * per_f * f_v * at.e * by_w.transpose();
    add_block(eq.g_ydot, row, g1, by_speed);
    add_block(eq.g_ydot, row, g2, -by_speed);
    add_block(eq.g_y, row, g1, s * per_f * f_v * at.e * by_phi.transpose() - s * M3 * skew(at.e));
    if (at.loaded) add_block(eq.g_y, row, force_, s * at.s * r * at.e * at.F.normalized().transpose());
  }
}

ScalarInfo Friction::scalar() const {
  if (data_.coulomb) return {".friction", "-", "friction", false};
  return {".bristle", "m", "bristle deflection", true};
}

void Friction::let_go(const Point& at, double still) {
  stuck_ = false;
  direction_ = sign(at.f);
  least_ = still > 0.0 ? std::min(at.v * direction_, 0.0) - still : 0.0;
}

bool Friction::switch_mode(const State& state, double still) {
  if (!data_.coulomb) return false;
  const Point at = point(state);
  if (stuck_) {
    if (!(std::abs(at.f) > most(still > 0.0))) return false;
    let_go(at, still);
    return true;
  }
  if (at.v * direction_ >= least_) return false;
  stuck_ = true;
  creep_ = std::abs(at.v) <= kCreeps * still ? at.v : 0.0;
  return true;
}

void Friction::end_mode(const State& state, double still) {
  const Point at = point(state);
  if (stuck_) {
    let_go(at, still);
  } else {
    stuck_ = true;
    creep_ = at.v;
  }
}

double Friction::most(bool slack) const { return data_.mu->value(0.0) * (slack ? 1.0 + kSlack : 1.0); }

double Friction::mode_margin(const State& state) const {
  if (!data_.coulomb) return 1.0;
  const Point at = point(state);
  return stuck_ ? most(true) - std::abs(at.f) : at.v * direction_ - least_;
}

bool Friction::ineffective(const State& state) const { return data_.coulomb && point(state).N == 0.0; }

double Friction::couple(const State& state) const {
  const Point at = point(state);
  return at.s * at.N * data_.radius;
}

namespace reading {

std::optional<FrictionData> read_friction(Context& context) {
  static constexpr const char* kModels[] = {"modlugre", "discrete coulomb"};
  static constexpr const char* kShapes[] = {"simple", "simple plane hinge"};
  Input& input = context.input;
  if (!input.more() || !input.take("friction")) return std::nullopt;
  FrictionData friction;
  friction.radius = input.positive("the radius of the friction [m]");
  if (input.take("preload")) {
    const SourcePosition where = input.where();
    friction.preload = input.real("the preload [N]");
    if (!(friction.preload >= 0.0)) {
      input.fail(where, "found a preload of " + number_text(friction.preload) + " N, expected 0 or more");
    }
  }
  input.need("a friction model: modlugre or discrete coulomb");
  friction.coulomb = input.keyword(kModels, "friction model") == 1;
  const auto not_negative = [&](const char* what) {
    const SourcePosition where = input.where();
    const double value = input.real(what);
    if (!(value >= 0.0)) input.fail(where, "found " + number_text(value) + ", expected " + what + " of 0 or more");
    return value;
  };
  if (!friction.coulomb) {
    friction.sigma0 = input.positive("the stiffness of the bristles, sigma0 [1/m]");
    friction.sigma1 = not_negative("the damping of the bristles, sigma1 [s/m]");
    friction.sigma2 = not_negative("the viscous friction, sigma2 [s/m]");
    const SourcePosition where = input.where();
    friction.kappa = input.real("the elastic part, kappa");
    if (!(friction.kappa >= 0.0 && friction.kappa < 1.0)) {
      input.fail(where, "found kappa " + number_text(friction.kappa) + ", expected 0 to below 1");
    }
  }
  const SourcePosition where = input.where();
  friction.mu = scalar_function(context);
  for (const double v : {0.0, 0.01, 0.1, 1.0}) {
    if (!(friction.mu->value(v) > 0.0)) {
      input.fail(where, "the friction coefficient must be positive: the function is " +
                            number_text(friction.mu->value(v)) + " at " + number_text(v) + " m/s");
    }
  }
  if (friction.coulomb) {
    if (input.more() && input.take("sigma2")) friction.sigma2 = not_negative("the viscous friction, sigma2 [s/m]");
    if (const SourcePosition here = input.where(); input.more() && input.take("velocity ratio")) {
      input.positive("the velocity ratio");
      input.diagnostics().warning(here,
                                  "`velocity ratio` has no effect: the change between stuck and sliding is found");
    }
  }
  input.need("the shape of the friction: simple or simple plane hinge");
  friction.plane_hinge = input.keyword(kShapes, "shape of the friction") == 1;
  return friction;
}

}  // namespace reading

}  // namespace mbdae
