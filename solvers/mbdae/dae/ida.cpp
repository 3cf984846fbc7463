// The unknowns of IDA, in this order: per node x, quaternion (7); per node v, w (6); reactions lambda; multipliers mu
// that keep position and velocity constraints both satisfied (Gear, Gupta and Leimkuhler 1985). Equations:
// docs/theory/integration.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/ida.h"

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>
#include <sstream>

#include "mbdae/dae/dense_linear_solver.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/recorder.h"

namespace mbdae {

namespace {

// Newton's iteration stops at this part of the local error test, so that constraints hold far better than the
// tolerance; at tight tolerances round-off [relative to unity] sets the limit, and SUNDIALS' default is never exceeded.
constexpr double kNewtonCoefficient = 1e-3, kRoundOff = 1e-14, kLooseNewton = 0.33;

// Absolute tolerance of reactions [N, N m] and multipliers [m/s, rad/s]. They are algebraic: no local error is
// estimated for them, and in Newton's iteration they are as exact as the motion; a tight tolerance would only hold it
// up at very short steps, where round-off in the constraints divided by the step shows in them.
constexpr double kMultiplierTolerance = 0.1;

constexpr double kRedundant = 1e-9;  // relative size of a constraint's independent part below which it is redundant

// First step as a part of the square root of the tolerance [s]: the first step is of first order, and IDA shortens it
// where needed.
constexpr double kFirstStep = 0.1;

constexpr long kStepsPerOutput = 1000000;

using Mat43 = Eigen::Matrix<double, 4, 3>;
using Mat34 = Eigen::Matrix<double, 3, 4>;

// qdot = Q(q) w / 2
Mat43 quaternion_rates(const Eigen::Vector4d& q) {
  Mat43 Q;
  Q.row(0) = -q.tail<3>().transpose();
  Q.bottomRows<3>() = -skew(q.tail<3>());
  Q.bottomRows<3>().diagonal().array() += q(0);
  return Q;
}

// dphi = T(q) dq: exact for the rotation of q / |q|.
Mat34 rotation_variation(const Eigen::Vector4d& q) { return (2.0 / q.squaredNorm()) * quaternion_rates(q).transpose(); }

// d(Q(q) u)/dq
Eigen::Matrix4d quaternion_rates_derivative(const Vec3& u) {
  Eigen::Matrix4d L;
  L(0, 0) = 0.0;
  L.block<1, 3>(0, 1) = -u.transpose();
  L.block<3, 1>(1, 0) = u;
  L.bottomRightCorner<3, 3>() = skew(u);
  return L;
}

struct IdaDeleter {
  void operator()(void* memory) const { IDAFree(&memory); }
};

void ignore_message(int, const char*, const char*, char*, void*) {}  // failures are reported by NotConverged

class IdaIntegrator {
 public:
  IdaIntegrator(Model& model, const State& state) : model_(model), state_(state) {
    nodes_ = static_cast<int>(model.slots().size());
    reactions_ = model.reaction_count();
    motions_ = 6 * nodes_;
    velocity_ = 7 * nodes_;
    lambda_ = 13 * nodes_;
    mu_ = lambda_ + reactions_;
    size_ = mu_ + reactions_;
    velocity_level_.assign(static_cast<std::size_t>(reactions_), false);
    for (const ConstraintEntry& entry : model.constraints()) {
      for (int k = 0; k < entry.constraint->size(); ++k) {
        velocity_level_[static_cast<std::size_t>(entry.constraint->first() + k - model.reaction_start())] =
            entry.constraint->velocity_level(k);
      }
    }
    find_redundant();
  }

  int size() const { return size_; }

  // Initial values, rates, and which unknowns are differential.
  void start(const Eigen::VectorXd& accelerations, Eigen::Ref<Eigen::VectorXd> y, Eigen::Ref<Eigen::VectorXd> ydot,
             Eigen::Ref<Eigen::VectorXd> id, double atol, Eigen::Ref<Eigen::VectorXd> tolerance) const {
    y.setZero();
    ydot.setZero();
    id.setOnes();
    tolerance.setConstant(atol);
    for (int i = 0; i < nodes_; ++i) {
      const NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      const Eigen::Vector4d q = quaternion_of(node.R);
      y.segment<3>(pose(i)) = node.x;
      y.segment<4>(pose(i) + 3) = q;
      y.segment<3>(velocity(i)) = node.v;
      y.segment<3>(velocity(i) + 3) = node.w;
      ydot.segment<3>(pose(i)) = node.v;
      ydot.segment<4>(pose(i) + 3) = 0.5 * quaternion_rates(q) * node.w;
      ydot.segment<6>(velocity(i)) = accelerations.segment<6>(motion(i));
      if (!model_.slots()[static_cast<std::size_t>(i)].dynamic) id.segment<6>(velocity(i)).setZero();
    }
    y.segment(lambda_, reactions_) = state_.y.tail(reactions_);
    for (const int k : redundant_) y(lambda_ + k) = 0.0;
    id.segment(lambda_, size_ - lambda_).setZero();
    tolerance.segment(lambda_, size_ - lambda_).setConstant(kMultiplierTolerance);
  }

  // IDA's unknowns into node motions and reactions.
  const State& state_of(double t, const Eigen::Map<const Eigen::VectorXd>& y) {
    state_.t = t;
    for (int i = 0; i < nodes_; ++i) {
      NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      node.x = y.segment<3>(pose(i));
      node.R = rotation_of_quaternion(y.segment<4>(pose(i) + 3));
      node.v = y.segment<3>(velocity(i));
      node.w = y.segment<3>(velocity(i) + 3);
    }
    state_.y.tail(reactions_) = y.segment(lambda_, reactions_);
    return state_;
  }

  // The state to write: IDA interpolates between its steps, so the interpolated motion is put back on the constraints
  // (shortest correction); redundant constraints share their load with the smallest norm.
  const State& output(double t, const Eigen::Map<const Eigen::VectorXd>& y) {
    state_of(t, y);
    if (reactions_ == 0) return state_;
    const int first = model_.reaction_start();
    Eigen::MatrixXd Phi(reactions_, motions_), B(motions_, reactions_);
    for (int pass = 0; pass < 2; ++pass) {
      eq_.clear(model_.size(), true);
      model_.add_constraints(state_, eq_, true);
      gather(Phi, B);
      Eigen::VectorXd error = eq_.g.tail(reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) error(k) = 0.0;
      }
      const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> inverse(Phi);
      const Eigen::VectorXd step = inverse.solve(error);
      for (int i = 0; i < nodes_; ++i) {
        NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
        node.x -= step.segment<3>(motion(i));
        node.R = rotation_exp(-step.segment<3>(motion(i) + 3)) * node.R;
      }
      model_.rates(state_, rates_, false);
      Eigen::VectorXd speed = rates_.rate.tail(reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) speed(k) = eq_.g(first + k);
      }
      const Eigen::VectorXd change = inverse.solve(speed);
      for (int i = 0; i < nodes_; ++i) {
        NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
        node.v -= change.segment<3>(motion(i));
        node.w -= change.segment<3>(motion(i) + 3);
      }
    }
    if (!redundant_.empty()) {
      state_.y.tail(reactions_) = B.completeOrthogonalDecomposition().solve(B * state_.y.tail(reactions_)).eval();
    }
    return state_;
  }

  static int residual(double t, N_Vector yy, N_Vector yp, N_Vector rr, void* self) {
    auto& s = *static_cast<IdaIntegrator*>(self);
    const Eigen::Map<const Eigen::VectorXd> y(N_VGetArrayPointer(yy), s.size_), ydot(N_VGetArrayPointer(yp), s.size_);
    Eigen::Map<Eigen::VectorXd> r(N_VGetArrayPointer(rr), s.size_);
    s.evaluate(t, y, ydot, r);
    return r.allFinite() ? 0 : 1;
  }

  static int jacobian(double t, double cj, N_Vector yy, N_Vector yp, N_Vector, SUNMatrix J, void* self, N_Vector,
                      N_Vector, N_Vector) {
    auto& s = *static_cast<IdaIntegrator*>(self);
    const Eigen::Map<const Eigen::VectorXd> y(N_VGetArrayPointer(yy), s.size_), ydot(N_VGetArrayPointer(yp), s.size_);
    Eigen::Map<Eigen::MatrixXd> out(SUNDenseMatrix_Data(J), s.size_, s.size_);
    s.differentiate(t, cj, y, ydot, out);
    return 0;
  }

  // The equation with the largest violation of balance or constraint at the present state.
  std::string worst_equation(double t, const Eigen::Map<const Eigen::VectorXd>& y,
                             const Eigen::Map<const Eigen::VectorXd>& ydot) {
    Eigen::VectorXd r(size_);
    evaluate(t, y, ydot, r);
    int worst = 0;
    r.segment(velocity_, motions_ + reactions_).cwiseAbs().maxCoeff(&worst);
    const int row = worst < motions_ ? model_.slots()[static_cast<std::size_t>(worst / 6)].force + worst % 6
                                     : model_.reaction_start() + worst - motions_;
    std::ostringstream out;
    out << model_.equation_title(row) << " is off by " << r(velocity_ + worst) << " " << model_.equation_unit(row);
    return out.str();
  }

 private:
  // Where node i's position, velocity and variation (dx, dphi) start.
  static int pose(int i) { return 7 * i; }
  int velocity(int i) const { return velocity_ + 6 * i; }
  static int motion(int i) { return 6 * i; }

  // Constraint matrix (velocity level rows included) and reaction columns from the assembled equations.
  void gather(Eigen::MatrixXd& Phi, Eigen::MatrixXd& B) const {
    const int first = model_.reaction_start();
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      Phi.middleCols<6>(motion(i)) = eq_.g_y.block(first, slot.first, reactions_, 6);
      B.middleRows<6>(motion(i)) = eq_.g_y.block(slot.force, first, 6, reactions_);
      for (int k = 0; k < reactions_; ++k) {
        if (velocity_level_[static_cast<std::size_t>(k)]) {
          Phi.block<1, 6>(k, motion(i)) = eq_.g_ydot.block<1, 6>(first + k, slot.first);
        }
      }
    }
  }

  // Constraints that follow from the others: left out of the equations, their reactions zero.
  void find_redundant() {
    if (reactions_ == 0) return;
    eq_.clear(model_.size(), true);
    model_.add_constraints(state_, eq_, true);
    Eigen::MatrixXd Phi(reactions_, motions_), B(motions_, reactions_);
    gather(Phi, B);
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(Phi.transpose());
    qr.setThreshold(kRedundant);
    for (Eigen::Index k = qr.rank(); k < reactions_; ++k) {
      redundant_.push_back(qr.colsPermutation().indices()(k));
    }
  }

  void evaluate(double t, const Eigen::Map<const Eigen::VectorXd>& y, const Eigen::Map<const Eigen::VectorXd>& ydot,
                Eigen::Ref<Eigen::VectorXd> r) {
    const State& state = state_of(t, y);
    eq_.clear(model_.size(), true);
    model_.add_loads(state, eq_, false);
    model_.add_constraints(state, eq_, true);
    model_.rates(state, rates_, false);
    const int first = model_.reaction_start();
    const auto mu = y.segment(mu_, reactions_);
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      const Vec6 correction = eq_.g_y.block(first, slot.first, reactions_, 6).transpose() * mu;
      r.segment<3>(pose(i)) = ydot.segment<3>(pose(i)) - node.v - correction.head<3>();
      const Eigen::Vector4d q = y.segment<4>(pose(i) + 3);
      r.segment<4>(pose(i) + 3) =
          ydot.segment<4>(pose(i) + 3) - 0.5 * quaternion_rates(q) * (node.w + correction.tail<3>());
      r.segment<6>(velocity(i)) = eq_.g.segment<6>(slot.force);
      if (slot.dynamic) {
        const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
        r.segment<6>(velocity(i)) +=
            inertia.mass_matrix(node) * ydot.segment<6>(velocity(i)) + inertia.velocity_terms(node);
      }
    }
    r.segment(lambda_, reactions_) = eq_.g.tail(reactions_);
    r.segment(mu_, reactions_) = rates_.rate.tail(reactions_);
    for (int k = 0; k < reactions_; ++k) {
      if (velocity_level_[static_cast<std::size_t>(k)]) r(mu_ + k) = y(mu_ + k);  // no position constraint to keep
    }
    for (const int k : redundant_) {
      r(lambda_ + k) = y(lambda_ + k);
      r(mu_ + k) = y(mu_ + k);
    }
  }

  void differentiate(double t, double cj, const Eigen::Map<const Eigen::VectorXd>& y,
                     const Eigen::Map<const Eigen::VectorXd>& ydot, Eigen::Ref<Eigen::MatrixXd> J) {
    const State& state = state_of(t, y);
    model_.assemble_statics(state, eq_, true);
    model_.rates(state, rates_, true);
    const int first = model_.reaction_start();
    const auto mu = y.segment(mu_, reactions_);
    J.setZero();
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      const int x = pose(i), v = velocity(i);
      const Eigen::Vector4d q = y.segment<4>(x + 3);
      const Mat43 Q = quaternion_rates(q);
      const Mat34 T = rotation_variation(q);

      // kinematics; the derivative of the constraint matrix times mu is left out, mu being as small as the tolerance
      const auto Phi = eq_.g_y.block(first, slot.first, reactions_, 6);
      const Vec3 turning = node.w + Phi.rightCols<3>().transpose() * mu;
      J.block<3, 3>(x, x).diagonal().array() += cj;
      J.block<3, 3>(x, v).diagonal().array() -= 1.0;
      J.block(x, mu_, 3, reactions_) -= Phi.leftCols<3>().transpose();
      J.block<4, 4>(x + 3, x + 3) -= 0.5 * quaternion_rates_derivative(turning);
      J.block<4, 4>(x + 3, x + 3).diagonal().array() += cj;
      J.block<4, 3>(x + 3, v + 3) -= 0.5 * Q;
      J.block(x + 3, mu_, 4, reactions_) -= 0.5 * Q * Phi.rightCols<3>().transpose();

      // equilibrium by motions of every node
      for (int j = 0; j < nodes_; ++j) {
        const NodeSlot& other = model_.slots()[static_cast<std::size_t>(j)];
        const Mat34 Tj = rotation_variation(y.segment<4>(pose(j) + 3));
        J.block<6, 3>(v, pose(j)) += eq_.g_y.block<6, 3>(slot.force, other.first);
        J.block<6, 4>(v, pose(j) + 3) += eq_.g_y.block<6, 3>(slot.force, other.first + 3) * Tj;
        J.block<6, 6>(v, velocity(j)) += eq_.g_ydot.block<6, 6>(slot.force, other.first);
      }
      J.block(v, lambda_, 6, reactions_) += eq_.g_y.block(slot.force, first, 6, reactions_);
      if (slot.dynamic) {
        const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
        Eigen::Matrix<double, 6, 3> by_phi, by_w;
        inertia.inertia_derivatives(node, ydot.segment<6>(v), by_phi, by_w);
        J.block<6, 4>(v, x + 3) += by_phi * T;
        J.block<6, 3>(v, v + 3) += by_w;
        J.block<6, 6>(v, v) += cj * inertia.mass_matrix(node);
      }

      // constraints
      J.block(lambda_, x, reactions_, 3) += Phi.leftCols<3>();
      J.block(lambda_, x + 3, reactions_, 4) += Phi.rightCols<3>() * T;
      J.block(lambda_, v, reactions_, 6) += eq_.g_ydot.block(first, slot.first, reactions_, 6);
      J.block(mu_, x, reactions_, 3) += rates_.rate_q.block(first, slot.first, reactions_, 3);
      J.block(mu_, x + 3, reactions_, 4) += rates_.rate_q.block(first, slot.first + 3, reactions_, 3) * T;
      J.block(mu_, v, reactions_, 6) += Phi;
    }
    for (int k = 0; k < reactions_; ++k) {
      if (!velocity_level_[static_cast<std::size_t>(k)]) continue;
      J.row(mu_ + k).setZero();
      J(mu_ + k, mu_ + k) = 1.0;
    }
    for (const int k : redundant_) {
      for (const int row : {lambda_ + k, mu_ + k}) {
        J.row(row).setZero();
        J(row, row) = 1.0;
      }
    }
  }

  Model& model_;
  State state_;
  Equations eq_;
  ConstraintRates rates_;
  std::vector<bool> velocity_level_;
  std::vector<int> redundant_;  // constraints, counted from the first reaction
  int nodes_ = 0, reactions_ = 0, motions_ = 0, velocity_ = 0, lambda_ = 0, mu_ = 0, size_ = 0;
};

Eigen::Map<Eigen::VectorXd> view(const VectorPtr& vector, int size) { return {N_VGetArrayPointer(vector.get()), size}; }

}  // namespace

Motion integrate_ida(Model& model, const State& state, const Eigen::VectorXd& accelerations,
                     const InitialValueData& settings, const IntegrateOptions& options) {
  for (const ConstraintEntry& entry : model.constraints()) {
    if (const std::string why = entry.constraint->no_variable_step(); !why.empty()) {
      throw ModelError("joint " + joint_title(*entry.data) + " " + why);
    }
  }
  if (model.scalar_count() > 0) {
    throw ModelError("the deck has abstract nodes, genels or elements with states: integrate it with `ms`");
  }
  IdaIntegrator equations(model, state);
  const int n = equations.size();
  const ContextPtr context = make_context();
  const VectorPtr y(N_VNew_Serial(n, context.get())), ydot(N_VNew_Serial(n, context.get())),
      id(N_VNew_Serial(n, context.get())), tolerance(N_VNew_Serial(n, context.get()));
  const MatrixPtr matrix(SUNDenseMatrix(n, n, context.get()));
  const SolverPtr solver = make_dense_solver(context.get(), false);
  const std::unique_ptr<void, IdaDeleter> ida(IDACreate(context.get()));
  if (!y || !ydot || !id || !tolerance || !matrix || !ida) throw std::bad_alloc();

  equations.start(accelerations, view(y, n), view(ydot, n), view(id, n), options.atol, view(tolerance, n));
  const double t0 = settings.initial_time, h = settings.time_step;
  if (IDAInit(ida.get(), IdaIntegrator::residual, t0, y.get(), ydot.get()) != IDA_SUCCESS ||
      IDASVtolerances(ida.get(), options.rtol, tolerance.get()) != IDA_SUCCESS ||
      IDASetUserData(ida.get(), &equations) != IDA_SUCCESS || IDASetId(ida.get(), id.get()) != IDA_SUCCESS ||
      IDASetSuppressAlg(ida.get(), SUNTRUE) != IDA_SUCCESS ||
      IDASetLinearSolver(ida.get(), solver.get(), matrix.get()) != IDA_SUCCESS ||
      IDASetJacFn(ida.get(), IdaIntegrator::jacobian) != IDA_SUCCESS) {
    throw std::bad_alloc();
  }
  IDASetErrHandlerFn(ida.get(), ignore_message, nullptr);
  IDASetNonlinConvCoef(ida.get(),
                       std::clamp(kRoundOff / std::min(options.rtol, options.atol), kNewtonCoefficient, kLooseNewton));
  IDASetInitStep(ida.get(), std::min(h, kFirstStep * std::sqrt(options.rtol)));
  IDASetMaxNumSteps(ida.get(), kStepsPerOutput);
  IDASetStopTime(ida.get(), settings.final_time);

  MotionRecorder recorder(model, options.channels);
  recorder.record(state);
  const auto steps = static_cast<long>(std::floor((settings.final_time - t0) / h + 1e-6));
  for (long k = options.output_every;; k += options.output_every) {
    if (k > steps) {
      if (k - options.output_every == steps) break;
      k = steps;  // the last instant is always written
    }
    double t = t0;
    const double target = std::min(t0 + static_cast<double>(k) * h, settings.final_time);
    const int flag = IDASolve(ida.get(), target, &t, y.get(), ydot.get(), IDA_NORMAL);
    const Eigen::Map<const Eigen::VectorXd> values(N_VGetArrayPointer(y.get()), n);
    if (flag < 0) {
      const Eigen::Map<const Eigen::VectorXd> speeds(N_VGetArrayPointer(ydot.get()), n);
      std::ostringstream out;
      const std::unique_ptr<char, void (*)(void*)> name(IDAGetReturnFlagName(flag), std::free);
      out << "time integration stopped at t = " << t << " s (" << name.get()
          << "): " << equations.worst_equation(t, values, speeds)
          << "; loosen the tolerances, or look for a motion that the joints do not allow";
      throw NotConverged(out.str());
    }
    recorder.record(equations.output(t, values));
    if (options.progress) options.progress(t);
  }
  return recorder.take();
}

}  // namespace mbdae
