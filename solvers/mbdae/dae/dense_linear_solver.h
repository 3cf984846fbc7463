// SUNDIALS' view of dense matrices and Eigen's LU: a linear solver object that falls back to minimum norm when
// singular.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sundials/sundials_context.h>
#include <sundials/sundials_linearsolver.h>
#include <sundials/sundials_matrix.h>
#include <sundials/sundials_nvector.h>

#include <memory>

namespace mbdae {

/// Owners of SUNDIALS objects.
struct ContextDeleter {
  void operator()(SUNContext context) const { SUNContext_Free(&context); }
};
struct VectorDeleter {
  void operator()(N_Vector vector) const { N_VDestroy(vector); }
};
struct MatrixDeleter {
  void operator()(SUNMatrix matrix) const { SUNMatDestroy(matrix); }
};
struct SolverDeleter {
  void operator()(SUNLinearSolver solver) const { SUNLinSolFree(solver); }
};
using ContextPtr = std::unique_ptr<std::remove_pointer_t<SUNContext>, ContextDeleter>;
using VectorPtr = std::unique_ptr<std::remove_pointer_t<N_Vector>, VectorDeleter>;
using MatrixPtr = std::unique_ptr<std::remove_pointer_t<SUNMatrix>, MatrixDeleter>;
using SolverPtr = std::unique_ptr<std::remove_pointer_t<SUNLinearSolver>, SolverDeleter>;

/// A SUNDIALS context; throws std::bad_alloc.
ContextPtr make_context();

/// A linear solver for dense matrices. `minimum_norm`: solve singular systems by rank-revealing QR (costs a condition
/// estimate per factorisation); otherwise a singular matrix is reported to SUNDIALS as a recoverable failure.
SolverPtr make_dense_solver(SUNContext context, bool minimum_norm);

}  // namespace mbdae
