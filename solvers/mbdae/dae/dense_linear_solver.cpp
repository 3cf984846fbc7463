// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/dense_linear_solver.h"

#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <new>
#include <optional>

#include "mbdae/dae/linear_algebra.h"

namespace mbdae {

namespace {

using MatrixMap = Eigen::Map<const Eigen::MatrixXd>;
using VectorMap = Eigen::Map<Eigen::VectorXd>;

struct Content {
  bool minimum_norm = false;
  Eigen::PartialPivLU<Eigen::MatrixXd> lu;
  std::optional<Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>> qr;
};

Content& content(SUNLinearSolver solver) { return *static_cast<Content*>(solver->content); }

SUNLinearSolver_Type type(SUNLinearSolver) { return SUNLINEARSOLVER_DIRECT; }

int setup(SUNLinearSolver solver, SUNMatrix A) {
  Content& self = content(solver);
  const MatrixMap matrix(SUNDenseMatrix_Data(A), SUNDenseMatrix_Rows(A), SUNDenseMatrix_Columns(A));
  if (!all_finite(matrix.data(), matrix.size())) return SUNLS_LUFACT_FAIL;
  self.qr.reset();
  self.lu.compute(matrix);
  if (self.minimum_norm) {
    if (is_singular(self.lu)) self.qr.emplace(matrix);
  } else if (self.lu.matrixLU().diagonal().cwiseAbs().minCoeff() == 0.0) {
    return SUNLS_LUFACT_FAIL;
  }
  return SUNLS_SUCCESS;
}

int solve(SUNLinearSolver solver, SUNMatrix, N_Vector x, N_Vector b, realtype) {
  Content& self = content(solver);
  const Eigen::Index n = N_VGetLength(b);
  VectorMap solution(N_VGetArrayPointer(x), n);
  const VectorMap rhs(N_VGetArrayPointer(b), n);
  if (self.qr) {
    solution = self.qr->solve(rhs).eval();
  } else {
    solution = self.lu.solve(rhs).eval();
  }
  return solution.allFinite() ? SUNLS_SUCCESS : SUNLS_PACKAGE_FAIL_REC;
}

int release(SUNLinearSolver solver) {
  delete static_cast<Content*>(solver->content);
  solver->content = nullptr;
  SUNLinSolFreeEmpty(solver);
  return SUNLS_SUCCESS;
}

}  // namespace

ContextPtr make_context() {
  SUNContext context = nullptr;
  if (SUNContext_Create(nullptr, &context) != 0) throw std::bad_alloc();
  return ContextPtr(context);
}

SolverPtr make_dense_solver(SUNContext context, bool minimum_norm) {
  SUNLinearSolver solver = SUNLinSolNewEmpty(context);
  if (solver == nullptr) throw std::bad_alloc();
  auto* self = new Content;
  self->minimum_norm = minimum_norm;
  solver->content = self;
  solver->ops->gettype = type;
  solver->ops->setup = setup;
  solver->ops->solve = solve;
  solver->ops->free = release;
  return SolverPtr(solver);
}

}  // namespace mbdae
