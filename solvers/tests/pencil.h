// Eigenvalues of a linearised model, without Eigen's eigenvalue solvers, at which compilers are long.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <complex>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/linear_algebra.h"

namespace mbdae::test {

// Bound [rad/s] on the distance of lam from the nearest eigenvalue of (lam g_ydot + g_y) v = 0. By Jacobi's formula
// d ln det(lam g_ydot + g_y) / d lam = trace((lam g_ydot + g_y)^-1 g_ydot), which is the sum of 1 / (lam - lam_i): one
// of n eigenvalues is no further away than n / |trace|.
inline double distance_to_eigenvalue(const LinearisedModel& model, std::complex<double> lam) {
  const Eigen::MatrixXd g_ydot = 0.5 * (model.J_plus + model.J_minus);
  const Eigen::MatrixXd g_y = (model.J_plus - model.J_minus) / (2.0 * model.c);
  const Eigen::Index n = g_y.rows();
  Eigen::MatrixXd A(2 * n, 2 * n), b = Eigen::MatrixXd::Zero(2 * n, n);  // real and imaginary parts
  A << lam.real() * g_ydot + g_y, -lam.imag() * g_ydot, lam.imag() * g_ydot, lam.real() * g_ydot + g_y;
  b.topRows(n) = g_ydot;
  std::complex<double> trace = 0.0;
  const Eigen::PartialPivLU<Eigen::MatrixXd> lu(A);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Eigen::VectorXd x = lu.solve(Eigen::VectorXd(b.col(k)));
    trace += std::complex<double>(x(k), x(n + k));
  }
  return static_cast<double>(n) / std::abs(trace);
}

}  // namespace mbdae::test
