// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/law.h"

#include <cmath>

namespace mbdae {

namespace {

struct Curve {
  double value;
  double slope;
};

// Active force against length (Pennestri et al. 2007).
Curve active_length_pennestri(double x) {
  const double u = x - 0.95, u2 = u * u;
  const double value = std::exp(u2 - 40.0 * u2 * u2);
  return {value, value * (2.0 - 160.0 * u2) * u};
}

// Active force against length written with error functions.
Curve active_length_erf(double x) {
  const double a = 10.0 * (x - 0.55), b = 5.0 * (x - 0.85), c = 2.4 * (x - 1.35);
  const double two_over_sqrt_pi = 1.1283791670955126;
  return {0.4 * std::erf(a) + 0.2 * std::erf(b) - 0.6 * std::erf(c),
          two_over_sqrt_pi * (4.0 * std::exp(-a * a) + std::exp(-b * b) - 1.44 * std::exp(-c * c))};
}

// Active force against velocity; the curve reaches its limit 1.6 at v = 1 and is held there.
Curve active_velocity(double v) {
  if (v >= 1.0) return {1.6, 0.0};
  const double s = 1.0 / (v - 1.0), s2 = s * s;
  const double power = std::exp(0.1 * s2 - 1.1 * s2 * s2);
  if (power == 0.0) return {1.6, 0.0};  // next to v = 1, where s overflows
  return {1.6 - 1.6 * power, 1.6 * power * (0.2 - 4.4 * s2) * s2 * s};
}

// Passive force against length.
Curve passive(double x) {
  const double u = x - 0.22, u2 = u * u, u4 = u2 * u2, u8 = u4 * u4;
  return {1.3 * std::atan(0.1 * u8 * u2), 1.3 * u8 * u / (1.0 + 0.01 * u8 * u8 * u4)};
}

// Short range stiffness: force over F0 f1 per unit of reference activation, and its slope in the stretch z.
Curve short_range(const ShortRangeData& data, double z) {
  if (z < 0.0) return {0.0, 0.0};
  if (data.model == ShortRangeModel::linear) {
    return z < data.delta ? Curve{data.gamma * z, data.gamma} : Curve{data.gamma * data.delta, 0.0};
  }
  const double ratio = z / data.delta, e = std::exp(ratio);
  return {data.gamma * data.delta * (1.0 - std::exp(1.0 - e)), data.gamma * std::exp(ratio - e + 1.0)};
}

}  // namespace

MuscleValue evaluate(const MuscleLaw& law, double t, double eps, double eps_rate) {
  const double length_ratio = law.Li / law.L0, velocity_ratio = law.Li / law.V0;
  const double prestrain = law.prestrain ? law.prestrain->value(t) : 0.0;
  const double reference_activation = law.activation->value(t);

  MuscleValue out;
  out.x = length_ratio * (1.0 + eps - prestrain);
  out.v = law.ergonomy ? 0.0 : velocity_ratio * eps_rate;
  const Curve f1 = law.model == MuscleModel::pennestri ? active_length_pennestri(out.x) : active_length_erf(out.x);
  const Curve f2 = active_velocity(out.v), f3 = passive(out.x);

  double a = reference_activation, a_x = 0.0, a_v = 0.0, a_a = 1.0;  // activation and its derivatives
  double stretch = 0.0;
  if (law.reflex) {
    const double kp = law.reflex->proportional_gain->value(t), kd = law.reflex->derivative_gain->value(t);
    stretch = out.x - law.reflex->reference_length->value(t) / law.L0;
    a += kp * stretch + kd * out.v;
    a_x = kp;
    a_v = kd;
  }
  if (law.activation_check && (a < 0.0 || a > 1.0)) {
    a = a < 0.0 ? 0.0 : 1.0;
    a_x = a_v = a_a = 0.0;
  }
  out.activation = a;

  const Curve unit = law.short_range ? short_range(*law.short_range, stretch) : Curve{0.0, 0.0};
  const double S = unit.value * reference_activation, S_x = unit.slope * reference_activation;
  const double active = f2.value * a + S;
  out.force = law.prestress + law.F0 * (f1.value * active + f3.value);
  out.stiffness = law.F0 * (f1.slope * active + f1.value * (f2.value * a_x + S_x) + f3.slope) * length_ratio;
  out.damping = law.ergonomy ? 0.0 : law.F0 * f1.value * (f2.slope * a + f2.value * a_v) * velocity_ratio;
  out.by_activation = law.F0 * f1.value * (f2.value * a_a + unit.value);
  return out;
}

ScalarLawValue evaluate(const Law1& law, double t, double strain, double rate) {
  if (const auto* muscle = std::get_if<MuscleLaw>(&law)) {
    const MuscleValue value = evaluate(*muscle, t, strain, rate);
    return {value.force, value.stiffness, value.damping};
  }
  using Scalar = Eigen::Matrix<double, 1, 1>;
  const auto of = [&](const auto& spring) -> LawValue<1> { return evaluate(spring, t, Scalar(strain), Scalar(rate)); };
  const LawValue<1> value = std::holds_alternative<LinearLaw<1>>(law)  ? of(std::get<LinearLaw<1>>(law))
                            : std::holds_alternative<CubicLaw<1>>(law) ? of(std::get<CubicLaw<1>>(law))
                                                                       : of(std::get<FunctionLaw<1>>(law));
  return {value.f(0), value.K(0), value.C(0)};
}

LawValue<3> evaluate(const Law3& law, double t, const Vec3& strain, const Vec3& rate) {
  return std::visit([&](const auto& l) { return evaluate(l, t, strain, rate); }, law);
}

}  // namespace mbdae
