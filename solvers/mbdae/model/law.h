// Constitutive laws of rods and deformable elements, with exact derivatives.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/deck/deck.h"

namespace mbdae {

/// Force of a law and its derivatives.
template <int N>
struct LawValue {
  Eigen::Matrix<double, N, 1> f;  ///< [N] or [N m]
  Eigen::Matrix<double, N, N> K;  ///< derivative with respect to the strain
  Eigen::Matrix<double, N, N> C;  ///< derivative with respect to the strain rate
};

/// A muscle's force, its derivatives, and how it came about.
struct MuscleValue {
  double force = 0.0;          ///< [N], tension positive
  double stiffness = 0.0;      ///< derivative with respect to the rod's strain [N]
  double damping = 0.0;        ///< derivative with respect to the rod's strain rate [N s]
  double by_activation = 0.0;  ///< derivative with respect to the activation drive [N]
  double x = 0.0;              ///< length over reference length [-]
  double v = 0.0;              ///< velocity over reference velocity [-]
  double activation = 0.0;     ///< including reflex and clipping [-]
};

template <int N>
LawValue<N> evaluate(const LinearLaw<N>& law, double t, const Eigen::Matrix<double, N, 1>& strain,
                     const Eigen::Matrix<double, N, 1>& rate) {
  LawValue<N> out;
  out.f = law.prestress + law.C * rate;
  if (law.prestrain.terms.empty()) {
    out.f += law.K * strain;
  } else {
    out.f += law.K * (strain - law.prestrain.at(t));
  }
  out.K = law.K;
  out.C = law.C;
  return out;
}

template <int N>
LawValue<N> evaluate(const CubicLaw<N>& law, double t, const Eigen::Matrix<double, N, 1>& strain,
                     const Eigen::Matrix<double, N, 1>& rate) {
  LawValue<N> out;
  const Eigen::Matrix<double, N, 1> e = strain - law.prestrain.at(t);
  out.f = law.prestress + law.C * rate;
  out.K.setZero();
  out.C = law.C;
  for (int i = 0; i < N; ++i) {
    const double magnitude = e(i) < 0.0 ? -e(i) : e(i);
    out.f(i) += (law.K1(i) + law.K2(i) * magnitude + law.K3(i) * e(i) * e(i)) * e(i);
    out.K(i, i) = law.K1(i) + 2.0 * law.K2(i) * magnitude + 3.0 * law.K3(i) * e(i) * e(i);
  }
  return out;
}

template <int N>
LawValue<N> evaluate(const FunctionLaw<N>& law, double t, const Eigen::Matrix<double, N, 1>& strain,
                     const Eigen::Matrix<double, N, 1>& rate) {
  LawValue<N> out;
  const Eigen::Matrix<double, N, 1> e = strain - law.prestrain.at(t);
  out.f = law.prestress + law.C * rate;
  out.K.setZero();
  out.C = law.C;
  for (int i = 0; i < N; ++i) {
    const ScalarFunctionPtr& function = law.elastic[static_cast<std::size_t>(i)];
    if (!function) continue;
    out.f(i) += function->value(e(i));
    out.K(i, i) = function->slope(e(i));
  }
  return out;
}

/// Muscle force at strain eps = l/L_rod - 1 and strain rate [1/s] (Pennestri's curves or the erf variant).
///
/// Derivatives are exact; they are zero where the activation is clipped, and at the start of the short range
/// stiffness the branch of lengthening is taken. f2 is held at its limit 1.6 for v >= 1.
MuscleValue evaluate(const MuscleLaw& law, double t, double eps, double eps_rate);

/// Force of a scalar law and its derivatives by strain (k) and strain rate (d).
struct ScalarLawValue {
  double f, k, d;
};
ScalarLawValue evaluate(const Law1& law, double t, double strain, double rate);

/// Couple or force of a 3D law.
LawValue<3> evaluate(const Law3& law, double t, const Vec3& strain, const Vec3& rate);

}  // namespace mbdae
