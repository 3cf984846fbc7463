// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/linear_algebra.h"

template class Eigen::PartialPivLU<Eigen::MatrixXd>;
template class Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
template class Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>;

namespace mbdae {

namespace {

// Smallest to largest pivot, and reciprocal condition number: the rows and columns of our matrices (masses,
// stiffnesses, unit constraint gradients) differ by at most about 1e8 in size.
constexpr double kSingular = 1e-15;

}  // namespace

bool all_finite(const double* data, Eigen::Index size) {
  const Eigen::Map<const Eigen::ArrayXd> x(data, size);
  return (x - x).sum() == 0.0;  // a difference is zero, or NaN, and then the sum is
}

bool is_singular(const Eigen::PartialPivLU<Eigen::MatrixXd>& lu) {
  const auto pivots = lu.matrixLU().diagonal().cwiseAbs();
  // Eigen's condition estimate passes over pivots that are exactly zero.
  return !(pivots.minCoeff() > kSingular * pivots.maxCoeff()) || !(lu.rcond() > kSingular);
}

Eigen::VectorXd robust_solve(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  if (A.rows() == 0) return Eigen::VectorXd(0);
  const Eigen::PartialPivLU<Eigen::MatrixXd> lu(A);
  if (is_singular(lu)) return A.completeOrthogonalDecomposition().solve(b);
  Eigen::VectorXd x = lu.solve(b);
  x += lu.solve(b - A * x);
  return x;
}

}  // namespace mbdae
