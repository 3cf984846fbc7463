// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/linear_algebra.h"

#include <cmath>

template class Eigen::PartialPivLU<Eigen::MatrixXd>;
template class Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
template class Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>;

namespace mbdae {

namespace {

// Smallest to largest pivot, and reciprocal condition number: the rows and columns of our matrices (masses,
// stiffnesses, unit constraint gradients) differ by at most about 1e8 in size.
constexpr double kSingular = 1e-15;

// An upper bound of the condition number in the 1-norm, by the magnitudes in the factors alone: |A| <= |L| |U|, and the
// inverse of a triangular matrix is bounded by that of its comparison matrix (Higham, Accuracy and Stability of
// Numerical Algorithms, section 8.2). It takes a tenth of the time of an estimate by solving.
double condition_bound(const Eigen::MatrixXd& lu) {
  const Eigen::Index n = lu.rows();
  Eigen::VectorXd sums(n), norms(n), by_L(n), by_U(n);  // of each column: |L|, |L| |U|, inverses of the factors
  for (Eigen::Index j = n - 1; j >= 0; --j) {
    const Eigen::Index below = n - 1 - j;
    const auto column = lu.col(j).tail(below).cwiseAbs();
    sums(j) = 1.0 + column.sum();
    by_L(j) = 1.0 + column.dot(by_L.tail(below));
  }
  for (Eigen::Index j = 0; j < n; ++j) {
    const auto column = lu.col(j).head(j).cwiseAbs();
    const double pivot = std::abs(lu(j, j));
    norms(j) = column.dot(sums.head(j)) + pivot * sums(j);
    by_U(j) = (1.0 + column.dot(by_U.head(j))) / pivot;
  }
  using Eigen::PropagateNaN;
  return norms.maxCoeff<PropagateNaN>() * by_L.maxCoeff<PropagateNaN>() * by_U.maxCoeff<PropagateNaN>();
}

}  // namespace

Eigen::Index worst_of(const Eigen::Ref<const Eigen::VectorXd>& values) {
  Eigen::Index worst = 0;
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    if (!std::isfinite(values(k))) return k;
    if (std::abs(values(k)) > std::abs(values(worst))) worst = k;
  }
  return worst;
}

double norm_of(const Eigen::VectorXd& values) {
  const double norm = values.norm();
  return std::isfinite(norm) || !values.allFinite() ? norm : values.stableNorm();
}

bool all_finite(const double* data, Eigen::Index size) {
  const Eigen::Map<const Eigen::ArrayXd> x(data, size);
  return (x - x).sum() == 0.0;  // a difference is zero, or NaN, and then the sum is
}

bool is_singular(const Eigen::PartialPivLU<Eigen::MatrixXd>& lu) {
  const auto pivots = lu.matrixLU().diagonal().cwiseAbs();
  // Eigen's condition estimate passes over pivots that are exactly zero.
  if (!(pivots.minCoeff() > kSingular * pivots.maxCoeff())) return true;
  // The estimate is never above the condition number: where the bound is well below the limit, it need not be made.
  if (condition_bound(lu.matrixLU()) < 0.1 / kSingular) return false;
  return !(lu.rcond() > kSingular);
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
