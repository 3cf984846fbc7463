// Linear systems that may be singular: redundant constraints, directions that nothing resists.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/QR>

// Compiled once, in linear_algebra.cpp: these are what the compiler is longest at.
extern template class Eigen::PartialPivLU<Eigen::MatrixXd>;
extern template class Eigen::ColPivHouseholderQR<Eigen::MatrixXd>;
extern template class Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>;

namespace mbdae {

/// True if none of the numbers is infinite or NaN. Eigen's allFinite asks for each one by itself.
bool all_finite(const double* data, Eigen::Index size);

/// Index of the first number that is infinite or NaN, else of the largest by magnitude; 0 of none.
Eigen::Index worst_of(const Eigen::Ref<const Eigen::VectorXd>& values);

/// 2-norm; of finite numbers it is finite, even if their squares are not.
double norm_of(const Eigen::VectorXd& values);

/// True if the factorised matrix is singular to working precision.
bool is_singular(const Eigen::PartialPivLU<Eigen::MatrixXd>& lu);

/// Solves A x = b: LU with one step of refinement, or the minimum norm least squares solution by rank-revealing QR when
/// A is singular.
Eigen::VectorXd robust_solve(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

}  // namespace mbdae
