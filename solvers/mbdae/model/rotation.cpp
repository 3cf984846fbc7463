// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/rotation.h"

#include <cmath>

namespace mbdae {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector4d;

namespace {

// Below this squared angle [rad^2] the closed forms lose digits and the Taylor series below (error < 1e-16) take over.
constexpr double kSeries = 0.25;

double horner(const double* c, int n, double s) {
  double value = 0.0;
  for (int i = n - 1; i >= 0; --i) value = value * s + c[i];
  return value;
}

// Functions of s = |theta|^2, each with its derivative in s:
//   a = (1 - cos)/|theta|^2, b = (|theta| - sin)/|theta|^3, c = (1 - (|theta|/2) cot(|theta|/2))/|theta|^2.
struct Coefficient {
  double value;
  double slope;
};

Coefficient coefficient_a(double s) {
  static constexpr double series[] = {1.0 / 2,       -1.0 / 24,         1.0 / 720,         -1.0 / 40320,
                                      1.0 / 3628800, -1.0 / 479001600., 1.0 / 87178291200.};
  static constexpr double slope[] = {-1.0 / 24,      2.0 / 720,         -3.0 / 40320,
                                     4.0 / 3628800., -5.0 / 479001600., 6.0 / 87178291200.};
  if (s < kSeries) return {horner(series, 7, s), horner(slope, 6, s)};
  const double phi = std::sqrt(s);
  return {(1.0 - std::cos(phi)) / s, (phi * std::sin(phi) - 2.0 * (1.0 - std::cos(phi))) / (2.0 * s * s)};
}

Coefficient coefficient_b(double s) {
  static constexpr double series[] = {1.0 / 6,         -1.0 / 120,         1.0 / 5040,          -1.0 / 362880,
                                      1.0 / 39916800., -1.0 / 6227020800., 1.0 / 1307674368000.};
  static constexpr double slope[] = {-1.0 / 120,      2.0 / 5040,         -3.0 / 362880,
                                     4.0 / 39916800., -5.0 / 6227020800., 6.0 / 1307674368000.};
  if (s < kSeries) return {horner(series, 7, s), horner(slope, 6, s)};
  const double phi = std::sqrt(s);
  return {(phi - std::sin(phi)) / (s * phi),
          (3.0 * std::sin(phi) - phi * std::cos(phi) - 2.0 * phi) / (2.0 * s * s * phi)};
}

Coefficient coefficient_c(double s) {
  static constexpr double series[] = {1.0 / 12,           1.0 / 720,
                                      1.0 / 30240,        1.0 / 1209600,
                                      1.0 / 47900160.,    691.0 / 1307674368000.,
                                      1.0 / 74724249600., 3617.0 / 10670622842880000.};
  static constexpr double slope[] = {1.0 / 720,
                                     2.0 / 30240,
                                     3.0 / 1209600,
                                     4.0 / 47900160.,
                                     5.0 * 691.0 / 1307674368000.,
                                     6.0 / 74724249600.,
                                     7.0 * 3617.0 / 10670622842880000.};
  if (s < kSeries) return {horner(series, 8, s), horner(slope, 7, s)};
  const double phi = std::sqrt(s), half = 0.5 * phi, sine = std::sin(half), cot = std::cos(half) / sine;
  return {(1.0 - half * cot) / s, (-2.0 / phi + (half / (sine * sine) + cot) / 2.0) / (2.0 * s * phi)};
}

Matrix3d series_matrix(double first, double second, const Vector3d& theta) {
  Matrix3d m = second * skew_skew(theta, theta) + first * skew(theta);
  m.diagonal().array() += 1.0;
  return m;
}

// d/dtheta of (I + first theta x + second theta x theta x) a.
Matrix3d series_derivative(double first, double first_slope, const Coefficient& second, const Vector3d& theta,
                           const Vector3d& a) {
  const Vector3d ta = theta.cross(a), tta = theta.cross(ta);
  Matrix3d m = -first * skew(a) - second.value * (skew(ta) + skew_skew(theta, a));
  m += (2.0 * first_slope * ta + 2.0 * second.slope * tta) * theta.transpose();
  return m;
}

}  // namespace

Matrix3d rotation_exp(const Vector3d& theta) {
  const double s = theta.squaredNorm();
  const Coefficient b = coefficient_b(s);
  return series_matrix(1.0 - s * b.value, coefficient_a(s).value, theta);
}

Vector4d quaternion_of(const Matrix3d& R) {
  // Shepperd: divide by the largest of the four components.
  const double trace = R.trace();
  Vector4d q;
  int largest = 0;
  if (R.diagonal().maxCoeff(&largest) > trace) {
    const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
    q(1 + i) = 1.0 + R(i, i) - R(j, j) - R(k, k);
    q(0) = R(k, j) - R(j, k);
    q(1 + j) = R(j, i) + R(i, j);
    q(1 + k) = R(k, i) + R(i, k);
  } else {
    q << 1.0 + trace, R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1);
  }
  q.normalize();
  return q(0) < 0.0 ? Vector4d(-q) : q;
}

Matrix3d rotation_of_quaternion(const Vector4d& q) {
  const double scale = 2.0 / q.squaredNorm();
  const Vector3d e = q.tail<3>();
  Matrix3d R = scale * (q(0) * skew(e) + skew_skew(e, e));
  R.diagonal().array() += 1.0;
  return R;
}

Vector3d rotation_log(const Matrix3d& R) {
  const Vector4d q = quaternion_of(R);
  const Vector3d e = q.tail<3>();
  const double sine = e.norm();
  if (sine == 0.0) return Vector3d::Zero();
  return (2.0 * std::atan2(sine, q(0)) / sine) * e;
}

Matrix3d rotation_gamma(const Vector3d& theta) {
  const double s = theta.squaredNorm();
  return series_matrix(coefficient_a(s).value, coefficient_b(s).value, theta);
}

Matrix3d rotation_gamma_inverse(const Vector3d& theta) {
  return series_matrix(-0.5, coefficient_c(theta.squaredNorm()).value, theta);
}

Matrix3d rotation_gamma_derivative(const Vector3d& theta, const Vector3d& a) {
  const double s = theta.squaredNorm();
  const Coefficient first = coefficient_a(s);
  return series_derivative(first.value, first.slope, coefficient_b(s), theta, a);
}

Matrix3d rotation_gamma_inverse_derivative(const Vector3d& theta, const Vector3d& a) {
  return series_derivative(-0.5, 0.0, coefficient_c(theta.squaredNorm()), theta, a);
}

Matrix3d cayley_rotation(const Vector3d& g) {
  const double scale = 4.0 / (4.0 + g.squaredNorm());
  return series_matrix(scale, 0.5 * scale, g);
}

Matrix3d cayley_tangent(const Vector3d& g) {
  const double scale = 4.0 / (4.0 + g.squaredNorm());
  Matrix3d G = (0.5 * scale) * skew(g);
  G.diagonal().array() += scale;
  return G;
}

Eigen::Matrix3d cayley_rate_derivative(const Eigen::Vector3d& g, const Eigen::Vector3d& gdot) {
  const double scale = 4.0 / (4.0 + g.squaredNorm());
  const Eigen::Vector3d w = cayley_tangent(g) * gdot;
  return (-0.5 * scale) * (w * g.transpose() + skew(gdot));
}

Vector3d cayley_parameters(const Matrix3d& R) {
  const Vector4d q = quaternion_of(R);
  return (2.0 / q(0)) * q.tail<3>();
}

}  // namespace mbdae
