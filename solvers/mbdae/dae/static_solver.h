// Newton with line search (KINSOL) for the static equilibrium of a model, with homotopy when that fails.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nvector/nvector_serial.h>

#include <string>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/dense_linear_solver.h"
#include "mbdae/model/model.h"

namespace mbdae {

class StaticSolver {
 public:
  /// The model must be static (6 unknowns per node); `state` is the start.
  StaticSolver(Model& model, State state, const StaticOptions& options);

  /// Equilibrium at time t from the present state. Throws NotConverged, leaving the present state as it was.
  void solve_at(double t);

  const State& state() const { return state_; }
  int iterations() const { return iterations_; }

 private:
  // Unknowns: position and Cayley-Gibbs-Rodrigues increments from reference_, then reactions.
  void apply(const Eigen::VectorXd& u);
  void residual(const Eigen::VectorXd& u, Eigen::Ref<Eigen::VectorXd> F);
  void jacobian(const Eigen::VectorXd& u, Eigen::Ref<Eigen::MatrixXd> J);
  bool newton();    // KINSOL, then polishing steps; true if converged to the tolerance
  bool homotopy();  // from the present state, in steps
  double unbalance(const State& state);
  double limit() const;          // of the residual's norm: the tolerance, but not below round-off
  std::string worst_equation();  // of the last residual

  static int kinsol_residual(N_Vector u, N_Vector F, void* self);
  static int kinsol_jacobian(N_Vector u, N_Vector F, SUNMatrix J, void* self, N_Vector, N_Vector);

  Model& model_;
  StaticOptions options_;
  int n_;
  State state_, reference_;
  Equations eq_;
  Eigen::VectorXd u_, offset_;  // offset_: part of the initial unbalance that homotopy still lets pass
  ContextPtr context_;
  VectorPtr vector_, one_, scale_;
  MatrixPtr matrix_;
  SolverPtr solver_;
  int iterations_ = 0;
};

}  // namespace mbdae
