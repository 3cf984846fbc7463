// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/static_solver.h"

#include <kinsol/kinsol.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <sstream>

#include "mbdae/dae/linear_algebra.h"

namespace mbdae {

namespace {

// Weight of constraint rows against force rows in the line search's merit function [N/m, N m/rad]: a grip 1 mm off
// counts as much as 0.1 N or 0.1 N m out of balance.
constexpr double kConstraintWeight = 100.0;

constexpr double kLargestStep = 1e8;     // no limit on a Newton step but the line search's
constexpr double kSmallestStep = 1e-14;  // relative step below which the line search gives up
constexpr int kPolishingSteps = 3;
constexpr double kRoundOff = 1e-15;        // of the residual, against the largest reaction: no tolerance asks for less
constexpr int kSmallestHomotopyStep = 64;  // times smaller than the regular one

struct KinsolDeleter {
  void operator()(void* memory) const { KINFree(&memory); }
};

void ignore_message(int, const char*, const char*, char*, void*) {}  // failures are reported by NotConverged

}  // namespace

StaticSolver::StaticSolver(Model& model, State state, const StaticOptions& options)
    : model_(model), options_(options), n_(model.size()), state_(std::move(state)), reference_(state_) {
  u_.setZero(n_);
  offset_.setZero(n_);
  context_ = make_context();
  vector_.reset(N_VNew_Serial(n_, context_.get()));
  one_.reset(N_VNew_Serial(n_, context_.get()));
  scale_.reset(N_VNew_Serial(n_, context_.get()));
  matrix_.reset(SUNDenseMatrix(n_, n_, context_.get()));
  if (!vector_ || !one_ || !scale_ || !matrix_) throw std::bad_alloc();
  // KINSOL clears the matrix before every Jacobian, entry by entry; ours writes every entry.
  matrix_->ops->zero = [](SUNMatrix) { return 0; };
  N_VConst(1.0, one_.get());
  N_VConst(1.0, scale_.get());
  for (int k = model.reaction_start(); k < n_; ++k) N_VGetArrayPointer(scale_.get())[k] = kConstraintWeight;
  solver_ = make_dense_solver(context_.get(), true);
}

void StaticSolver::apply(const Eigen::VectorXd& u) {
  for (std::size_t i = 0; i < state_.nodes.size(); ++i) {
    const int first = model_.slots()[i].first;
    state_.nodes[i].x = reference_.nodes[i].x + u.segment<3>(first);
    state_.nodes[i].R = cayley_rotation(u.segment<3>(first + 3)) * reference_.nodes[i].R;
  }
  state_.y.tail(model_.reaction_count()) = u.tail(model_.reaction_count());
}

void StaticSolver::residual(const Eigen::VectorXd& u, Eigen::Ref<Eigen::VectorXd> F) {
  apply(u);
  model_.assemble_statics(state_, eq_, false);
  F = eq_.g - offset_;
}

void StaticSolver::jacobian(const Eigen::VectorXd& u, Eigen::Ref<Eigen::MatrixXd> J) {
  apply(u);
  model_.assemble_statics(state_, eq_, true);
  J = eq_.g_y;
  for (const NodeSlot& slot : model_.slots()) {
    const Vec3 g = u.segment<3>(slot.first + 3);
    if (!g.isZero(0.0)) J.middleCols<3>(slot.first + 3) = (J.middleCols<3>(slot.first + 3) * cayley_tangent(g)).eval();
  }
}

int StaticSolver::kinsol_residual(N_Vector u, N_Vector F, void* self) {
  auto& solver = *static_cast<StaticSolver*>(self);
  Eigen::Map<Eigen::VectorXd> out(N_VGetArrayPointer(F), solver.n_);
  solver.u_ = Eigen::Map<const Eigen::VectorXd>(N_VGetArrayPointer(u), solver.n_);
  solver.residual(solver.u_, out);
  return out.allFinite() ? 0 : 1;  // 1: recoverable, the line search shortens the step
}

int StaticSolver::kinsol_jacobian(N_Vector u, N_Vector, SUNMatrix J, void* self, N_Vector, N_Vector) {
  auto& solver = *static_cast<StaticSolver*>(self);
  Eigen::Map<Eigen::MatrixXd> out(SUNDenseMatrix_Data(J), solver.n_, solver.n_);
  solver.u_ = Eigen::Map<const Eigen::VectorXd>(N_VGetArrayPointer(u), solver.n_);
  solver.jacobian(solver.u_, out);
  return 0;
}

bool StaticSolver::newton() {
  reference_ = state_;
  Eigen::VectorXd u = Eigen::VectorXd::Zero(n_);
  u.tail(model_.reaction_count()) = state_.y.tail(model_.reaction_count());
  std::copy(u.data(), u.data() + n_, N_VGetArrayPointer(vector_.get()));

  const std::unique_ptr<void, KinsolDeleter> kinsol(KINCreate(context_.get()));
  if (!kinsol) throw std::bad_alloc();
  KINSetUserData(kinsol.get(), this);
  KINSetErrHandlerFn(kinsol.get(), ignore_message, nullptr);
  KINSetNumMaxIters(kinsol.get(), options_.max_iterations);
  KINSetMaxSetupCalls(kinsol.get(), 1);  // a new Jacobian at every iteration
  KINSetMaxNewtonStep(kinsol.get(), kLargestStep);
  KINSetFuncNormTol(kinsol.get(), options_.tolerance);
  KINSetScaledStepTol(kinsol.get(), kSmallestStep);
  if (KINInit(kinsol.get(), kinsol_residual, vector_.get()) != KIN_SUCCESS ||
      KINSetLinearSolver(kinsol.get(), solver_.get(), matrix_.get()) != KIN_SUCCESS ||
      KINSetJacFn(kinsol.get(), kinsol_jacobian) != KIN_SUCCESS) {
    throw std::bad_alloc();
  }
  KINSol(kinsol.get(), vector_.get(), KIN_LINESEARCH, one_.get(), scale_.get());
  long int iterations = 0;
  KINGetNumNonlinSolvIters(kinsol.get(), &iterations);
  iterations_ += static_cast<int>(iterations);

  // Whatever KINSOL says, the residual decides; near round-off plain Newton steps finish where a line search cannot.
  Eigen::VectorXd F(n_);
  Eigen::MatrixXd J(n_, n_);
  u = Eigen::Map<const Eigen::VectorXd>(N_VGetArrayPointer(vector_.get()), n_);
  residual(u, F);
  for (int i = 0; i < kPolishingSteps && F.norm() > limit() && F.norm() < 1e-3; ++i) {
    jacobian(u, J);
    u -= robust_solve(J, F);
    residual(u, F);
    ++iterations_;
  }
  return F.norm() <= limit();
}

double StaticSolver::limit() const {
  const auto reactions = state_.y.tail(model_.reaction_count());
  const double load = reactions.size() > 0 ? reactions.cwiseAbs().maxCoeff() : 0.0;
  return std::max(options_.tolerance, kRoundOff * (1.0 + load));
}

bool StaticSolver::homotopy() {
  // F(u) = s F(u0), s from 1 to 0: loads, prestrains and constraint violations grow from the present configuration,
  // which is the solution at s = 1.
  model_.assemble_statics(state_, eq_, false);
  const Eigen::VectorXd initial = eq_.g;
  const double regular = 1.0 / std::max(1, options_.load_steps);
  double step = regular, s = 1.0;
  bool converged = false;
  while (s > 0.0) {
    const double next = s - step < 1e-9 ? 0.0 : s - step;
    const State before = state_;
    offset_ = next * initial;
    if (newton()) {
      s = next;
      step = std::min(2.0 * step, regular);
      converged = s == 0.0;
    } else {
      state_ = before;
      step *= 0.5;
      if (step < regular / kSmallestHomotopyStep) break;
    }
  }
  offset_.setZero();
  return converged;
}

double StaticSolver::unbalance(const State& state) {
  model_.assemble_statics(state, eq_, false);
  return norm_of(eq_.g);
}

std::string StaticSolver::worst_equation() {
  const Eigen::VectorXd scaled = eq_.g.cwiseProduct(Eigen::Map<Eigen::VectorXd>(N_VGetArrayPointer(scale_.get()), n_));
  const auto worst = static_cast<int>(worst_of(scaled));
  return model_.equation_off(worst, eq_.g(worst));
}

void StaticSolver::solve_at(double t) {
  const State before = state_;
  state_.t = t;
  model_.set_reference(state_);
  bool converged = newton(), finite = true;
  std::string where;
  if (!converged) {
    finite = std::isfinite(unbalance(state_));
    where = worst_equation();
    if (finite) {
      std::ostringstream norm;
      norm << norm_of(eq_.g);
      where += " (norm of all residuals " + norm.str() + ")";
    }
    state_ = before;
    state_.t = t;
    converged = homotopy();
  }
  // Free rotation components of partly constrained joints move with the solution.
  for (int i = 0; converged && i < options_.max_iterations; ++i) {
    model_.set_reference(state_);
    if (unbalance(state_) <= limit()) return;
    converged = newton();
  }
  if (!converged) {
    state_ = before;
    std::ostringstream out;
    out << "static equilibrium not found at time " << t << " s: " << where;
    if (finite) {
      out << "; load stepping did not help. Give a configuration closer to equilibrium, or check that springs or "
             "constraints hold every node";
    } else {
      out << "; " << kLookForNoNumber;
    }
    throw NotConverged(out.str());
  }
}

}  // namespace mbdae
