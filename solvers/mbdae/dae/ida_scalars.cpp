// The unknowns of IDA, in this order: per node x, quaternion (7); per node v, w (6); scalars; reactions lambda;
// multipliers mu that keep position and velocity constraints both satisfied (Gear, Gupta and Leimkuhler 1985), one per
// reaction and one per scalar whose equation only constrains the motion. Equations: docs/theory/integration.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/ida_scalars.h"

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>
#include <sstream>

#include "mbdae/dae/consistency.h"
#include "mbdae/dae/dense_linear_solver.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/recorder.h"

namespace mbdae {

namespace {

// As in ida.cpp: Newton's iteration stops at this part of the local error test; reactions and multipliers are
// algebraic.
constexpr double kNewtonCoefficient = 1e-3, kRoundOff = 1e-14, kLooseNewton = 0.33;
constexpr double kMultiplierTolerance = 0.1;
constexpr double kRedundant = 1e-9;
constexpr double kFirstStep = 0.1;
constexpr long kStepsPerOutput = 1000000;

constexpr int kMostSwitches = 8;      // of modes at one instant
constexpr int kMostRestarts = 10000;  // between two instants written: chattering
constexpr int kCorrections = 2;       // of an instant back on the constraints

using Mat43 = Eigen::Matrix<double, 4, 3>;
using Mat34 = Eigen::Matrix<double, 3, 4>;
using Values = Eigen::Map<const Eigen::VectorXd>;

// qdot = Q(q) w / 2
Mat43 quaternion_rates(const Eigen::Vector4d& q) {
  Mat43 Q;
  Q.row(0) = -q.tail<3>().transpose();
  Q.bottomRows<3>() = -skew(q.tail<3>());
  Q.bottomRows<3>().diagonal().array() += q(0);
  return Q;
}

struct IdaDeleter {
  void operator()(void* memory) const { IDAFree(&memory); }
};

void ignore_message(int, const char*, const char*, char*, void*) {}  // failures are reported by NotConverged

/// Residual and Jacobian. A constraint: its row and the column of its multiplier among the model's unknowns, both the
/// same number; `nodes`: the nodes have a part in it at position level.
class ScalarEquations {
 public:
  ScalarEquations(Model& model, const State& state)
      : model_(model),
        state_(state),
        nodes_(static_cast<int>(model.slots().size())),
        scalar_(13 * nodes_),
        scalars_(model.scalar_count()),
        lambda_(scalar_ + scalars_),
        reactions_(model.reaction_count()),
        mu_(lambda_ + reactions_) {
    assemble(state_, true);
    classify();
    size_ = mu_ + static_cast<int>(stabilised_.size());
  }

  int size() const { return size_; }
  const State& state() const { return state_; }
  const std::vector<Element*>& with_modes() const { return with_modes_; }

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
      y.segment<6>(velocity(i)) << node.v, node.w;
      ydot.segment<3>(pose(i)) = node.v;
      ydot.segment<4>(pose(i) + 3) = 0.5 * quaternion_rates(q) * node.w;
      ydot.segment<6>(velocity(i)) = accelerations.segment<6>(6 * i);
      if (!model_.slots()[static_cast<std::size_t>(i)].dynamic) id.segment<6>(velocity(i)).setZero();
    }
    y.segment(scalar_, scalars_) = state_.y.segment(model_.scalar_start(), scalars_);
    for (int k = 0; k < scalars_; ++k) {
      if (rate_counts_[static_cast<std::size_t>(k)]) {
        ydot(scalar_ + k) = state_.ydot(model_.scalar_start() + k);
      } else {
        id(scalar_ + k) = 0.0;
        tolerance(scalar_ + k) = kMultiplierTolerance;
      }
    }
    y.segment(lambda_, reactions_) = state_.y.tail(reactions_);
    for (const int k : redundant_) y(lambda_ + k) = 0.0;
    id.tail(size_ - lambda_).setZero();
    tolerance.tail(size_ - lambda_).setConstant(kMultiplierTolerance);
  }

  const State& state_of(double t, const Values& y, const Values& ydot) {
    state_.t = t;
    for (int i = 0; i < nodes_; ++i) {
      NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
      node.x = y.segment<3>(pose(i));
      node.R = rotation_of_quaternion(y.segment<4>(pose(i) + 3));
      node.v = y.segment<3>(velocity(i));
      node.w = y.segment<3>(velocity(i) + 3);
    }
    state_.y.segment(model_.scalar_start(), scalars_) = y.segment(scalar_, scalars_);
    state_.ydot.segment(model_.scalar_start(), scalars_) = ydot.segment(scalar_, scalars_);
    state_.y.tail(reactions_) = y.segment(lambda_, reactions_);
    return state_;
  }

  // The state to write: the interpolated motion put back on the constraints by the shortest correction.
  const State& output(double t, const Values& y, const Values& ydot) {
    state_of(t, y, ydot);
    if (stabilised_.empty()) return state_;
    for (int pass = 0; pass < kCorrections; ++pass) {
      assemble(state_, true);
      const auto count = static_cast<Eigen::Index>(stabilised_.size());
      Eigen::MatrixXd Phi(count, 6 * nodes_);
      Eigen::VectorXd error(count), speed(count);
      for (Eigen::Index k = 0; k < count; ++k) {
        const int row = stabilised_[static_cast<std::size_t>(k)];
        for (const NodeSlot& slot : model_.slots()) {
          Phi.block<1, 6>(k, 6 * slot.index) = eq_.g_y.block<1, 6>(row, slot.first);
        }
        error(k) = eq_.g(row);
        speed(k) = rate(row, ydot.segment(scalar_, scalars_));
      }
      const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> inverse(Phi);
      const Eigen::VectorXd step = inverse.solve(error), change = inverse.solve(speed);
      for (int i = 0; i < nodes_; ++i) {
        NodeMotion& node = state_.nodes[static_cast<std::size_t>(i)];
        node.x -= step.segment<3>(6 * i);
        node.R = rotation_exp(-step.segment<3>(6 * i + 3)) * node.R;
        node.v -= change.segment<3>(6 * i);
        node.w -= change.segment<3>(6 * i + 3);
      }
    }
    return state_;
  }

  // Accelerations of the present state, elements in the modes that it asks for.
  Eigen::VectorXd accelerations() {
    Eigen::VectorXd out = solve_accelerations(model_, state_);
    for (int i = 0; i < kMostSwitches && model_.switch_modes(state_); ++i) out = solve_accelerations(model_, state_);
    return out;
  }

  void end_modes(const std::vector<int>& roots) {
    for (std::size_t k = 0; k < roots.size(); ++k) {
      if (roots[k] != 0) with_modes_[k]->end_mode(state_);
    }
  }

  static int residual(double t, N_Vector yy, N_Vector yp, N_Vector rr, void* self) {
    auto& s = *static_cast<ScalarEquations*>(self);
    Eigen::Map<Eigen::VectorXd> r(N_VGetArrayPointer(rr), s.size_);
    s.evaluate(t, s.view(yy), s.view(yp), r);
    return r.allFinite() ? 0 : 1;
  }

  static int jacobian(double t, double cj, N_Vector yy, N_Vector yp, N_Vector, SUNMatrix J, void* self, N_Vector,
                      N_Vector, N_Vector) {
    auto& s = *static_cast<ScalarEquations*>(self);
    Eigen::Map<Eigen::MatrixXd> out(SUNDenseMatrix_Data(J), s.size_, s.size_);
    s.differentiate(t, cj, s.view(yy), s.view(yp), out);
    return 0;
  }

  static int mode_margins(double t, N_Vector yy, N_Vector yp, realtype* margins, void* self) {
    auto& s = *static_cast<ScalarEquations*>(self);
    const State& state = s.state_of(t, s.view(yy), s.view(yp));
    for (std::size_t k = 0; k < s.with_modes_.size(); ++k) margins[k] = s.with_modes_[k]->mode_margin(state);
    return 0;
  }

  // The equation with the largest residual.
  std::string worst_equation(double t, const Values& y, const Values& ydot) {
    Eigen::VectorXd r(size_);
    evaluate(t, y, ydot, r);
    int worst = 0;
    r.segment(7 * nodes_, mu_ - 7 * nodes_).cwiseAbs().maxCoeff(&worst);
    const int row = worst < 6 * nodes_ ? model_.slots()[static_cast<std::size_t>(worst / 6)].force + worst % 6
                                       : model_.scalar_start() + worst - 6 * nodes_;
    std::ostringstream out;
    out << model_.equation_title(row) << " is off by " << r(7 * nodes_ + worst) << " " << model_.equation_unit(row);
    return out.str();
  }

  Values view(N_Vector vector) const { return {N_VGetArrayPointer(vector), size_}; }

 private:
  static int pose(int i) { return 7 * i; }
  int velocity(int i) const { return 7 * nodes_ + 6 * i; }

  void assemble(const State& state, bool tangent) {
    eq_.clear(model_.size(), true);
    model_.add_loads(state, eq_, tangent);
    model_.add_reduced_constraints(state, eq_, true);
    model_.rates(state, rates_, tangent);
  }

  bool depends_on_positions(int row) const {
    for (const NodeSlot& slot : model_.slots()) {
      if (!eq_.g_y.block<1, 6>(row, slot.first).isZero(0.0)) return true;
    }
    return false;
  }

  // Which scalars have rates that count, which rows constrain positions, which of those follow from others.
  void classify() {
    for (Element* element : model_.with_modes()) with_modes_.push_back(element);
    const int scalar = model_.scalar_start(), first = model_.reaction_start();
    for (int k = 0; k < scalars_; ++k) {
      rate_counts_.push_back(!model_.algebraic(scalar + k) && !eq_.g_ydot.col(scalar + k).isZero(0.0));
    }
    // A scalar's equation in which only positions and states stand: the scalar is a multiplier (a seat that follows a
    // state, its force in an abstract node).
    for (int k = 0; k < scalars_; ++k) {
      const int row = scalar + k;
      bool only = !rate_counts_[static_cast<std::size_t>(k)] && eq_.g_ydot.row(row).isZero(0.0) &&
                  eq_.g_y.row(row).tail(reactions_).isZero(0.0) && depends_on_positions(row);
      for (int j = 0; j < scalars_; ++j) {
        only = only && (rate_counts_[static_cast<std::size_t>(j)] || eq_.g_y(row, scalar + j) == 0.0);
      }
      if (only) stabilised_.push_back(row);
    }
    check_steady();
    // A constraint that follows from the others is left out, its reaction zero.
    Eigen::MatrixXd all(reactions_, model_.size() + scalars_);
    all << eq_.g_y.bottomRows(reactions_), eq_.g_ydot.block(first, scalar, reactions_, scalars_);
    for (const ConstraintEntry& entry : model_.constraints()) {
      for (int k = 0; k < entry.constraint->size(); ++k) {
        const int row = entry.constraint->first() + k;
        const bool velocity = entry.constraint->velocity_level(k);
        if (velocity) all.row(row - first).head(model_.size()) += eq_.g_ydot.row(row);
        if (!velocity && depends_on_positions(row)) stabilised_.push_back(row);
      }
    }
    if (reactions_ == 0) return;
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(all.transpose());
    qr.setThreshold(kRedundant);
    for (Eigen::Index k = qr.rank(); k < reactions_; ++k) {
      const int column = qr.colsPermutation().indices()(k);
      redundant_.push_back(column);
      std::erase(stabilised_, first + column);
    }
  }

  // Their time derivative has no part from drives.
  void check_steady() {
    for (const double dt : {0.013, 0.37, 1.9}) {
      if (stabilised_.empty()) return;
      State later = state_;
      later.t += dt;
      Equations eq;
      eq.clear(model_.size(), false);
      model_.add_loads(later, eq, false);
      for (const int row : stabilised_) {
        if (std::abs(eq.g(row) - eq_.g(row)) > 1e-12 * (1.0 + std::abs(eq_.g(row)))) {
          throw ModelError(model_.equation_title(row) +
                           " constrains the motion and depends on time: integrate the deck with `ms`");
        }
      }
    }
  }

  // Time derivative of a position constraint.
  double rate(int row, const Eigen::VectorXd& scalar_rates) const {
    if (row >= model_.reaction_start()) return rates_.rate(row);  // states that drives read included
    double out = eq_.g_y.row(row).segment(model_.scalar_start(), scalars_).dot(scalar_rates);
    for (const NodeSlot& slot : model_.slots()) {
      const NodeMotion& node = motion_of(state_, slot);
      out += eq_.g_y.block<1, 3>(row, slot.first).dot(node.v) + eq_.g_y.block<1, 3>(row, slot.first + 3).dot(node.w);
    }
    return out;
  }

  void evaluate(double t, const Values& y, const Values& ydot, Eigen::Ref<Eigen::VectorXd> r) {
    const State& state = state_of(t, y, ydot);
    assemble(state, true);
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      Vec6 correction = Vec6::Zero();
      for (std::size_t k = 0; k < stabilised_.size(); ++k) {
        correction += eq_.g_y.block<1, 6>(stabilised_[k], slot.first).transpose() * y(mu_ + static_cast<int>(k));
      }
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
    r.segment(scalar_, scalars_ + reactions_) = eq_.g.segment(model_.scalar_start(), scalars_ + reactions_);
    for (std::size_t k = 0; k < stabilised_.size(); ++k) {
      r(mu_ + static_cast<int>(k)) = rate(stabilised_[k], ydot.segment(scalar_, scalars_));
    }
    for (const int k : redundant_) r(lambda_ + k) = y(lambda_ + k);
  }

  void differentiate(double t, double cj, const Values& y, const Values& ydot, Eigen::Ref<Eigen::MatrixXd> J) {
    const State& state = state_of(t, y, ydot);
    assemble(state, true);
    const int scalar = model_.scalar_start(), own = scalars_ + reactions_;
    // own equations and unknowns: states by value and rate, the others by value
    Eigen::MatrixXd by_own = eq_.g_y.middleCols(scalar, own);
    by_own.leftCols(scalars_) += cj * eq_.g_ydot.middleCols(scalar, scalars_);
    J.setZero();
    J.block(scalar_, scalar_, own, own) = by_own.middleRows(scalar, own);
    for (int i = 0; i < nodes_; ++i) {
      const NodeSlot& slot = model_.slots()[static_cast<std::size_t>(i)];
      const NodeMotion& node = state.nodes[static_cast<std::size_t>(i)];
      const int x = pose(i), v = velocity(i);
      const Eigen::Vector4d q = y.segment<4>(x + 3);
      const Mat43 Q = quaternion_rates(q);
      const Mat34 T = (2.0 / q.squaredNorm()) * Q.transpose();  // dphi = T dq

      // kinematics; derivatives of the constraints' gradients times mu are left out, mu being as small as the tolerance
      Vec3 turning = node.w;
      for (std::size_t k = 0; k < stabilised_.size(); ++k) {
        const int row = stabilised_[k], column = mu_ + static_cast<int>(k);
        const Vec6 gradient = eq_.g_y.block<1, 6>(row, slot.first).transpose();
        turning += gradient.tail<3>() * y(column);
        J.block<3, 1>(x, column) = -gradient.head<3>();
        J.block<4, 1>(x + 3, column) = -0.5 * Q * gradient.tail<3>();
        J.block<1, 6>(column, v) = gradient.transpose();
        if (row >= model_.reaction_start()) {
          J.block<1, 3>(column, x) = rates_.rate_q.block<1, 3>(row, slot.first);
          J.block<1, 4>(column, x + 3) = rates_.rate_q.block<1, 3>(row, slot.first + 3) * T;
        }
      }
      J.block<3, 3>(x, x).diagonal().array() += cj;
      J.block<3, 3>(x, v).diagonal().array() -= 1.0;
      Eigen::Matrix4d turned;
      turned << 0.0, -turning.transpose(), turning, skew(turning);
      J.block<4, 4>(x + 3, x + 3) -= 0.5 * turned;
      J.block<4, 4>(x + 3, x + 3).diagonal().array() += cj;
      J.block<4, 3>(x + 3, v + 3) -= 0.5 * Q;

      // equilibrium and own equations by this node's motion
      for (int j = 0; j < nodes_; ++j) {
        const NodeSlot& other = model_.slots()[static_cast<std::size_t>(j)];
        const int at = velocity(j);
        J.block<6, 3>(at, x) += eq_.g_y.block<6, 3>(other.force, slot.first);
        J.block<6, 4>(at, x + 3) += eq_.g_y.block<6, 3>(other.force, slot.first + 3) * T;
        J.block<6, 6>(at, v) += eq_.g_ydot.block<6, 6>(other.force, slot.first);
      }
      J.block(scalar_, x, own, 3) = eq_.g_y.block(scalar, slot.first, own, 3);
      J.block(scalar_, x + 3, own, 4) = eq_.g_y.block(scalar, slot.first + 3, own, 3) * T;
      J.block(scalar_, v, own, 6) = eq_.g_ydot.block(scalar, slot.first, own, 6);
      J.block(v, scalar_, 6, own) = by_own.middleRows(slot.force, 6);
      if (slot.dynamic) {
        const NodeInertia& inertia = model_.inertias()[static_cast<std::size_t>(i)];
        Eigen::Matrix<double, 6, 3> by_phi, by_w;
        inertia.inertia_derivatives(node, ydot.segment<6>(v), by_phi, by_w);
        J.block<6, 4>(v, x + 3) += by_phi * T;
        J.block<6, 3>(v, v + 3) += by_w;
        J.block<6, 6>(v, v) += cj * inertia.mass_matrix(node);
      }
    }
    for (std::size_t k = 0; k < stabilised_.size(); ++k) {
      J.block(mu_ + static_cast<int>(k), scalar_, 1, scalars_) =
          cj * eq_.g_y.block(stabilised_[k], scalar, 1, scalars_);
    }
    for (const int k : redundant_) {
      J.row(lambda_ + k).setZero();
      J(lambda_ + k, lambda_ + k) = 1.0;
    }
  }

  Model& model_;
  State state_;
  Equations eq_;
  ConstraintRates rates_;
  std::vector<Element*> with_modes_;
  std::vector<bool> rate_counts_;  // of every scalar
  std::vector<int> stabilised_;    // rows that constrain positions and have a mu
  std::vector<int> redundant_;     // constraints, counted from the first reaction
  int nodes_, scalar_, scalars_, lambda_, reactions_, mu_, size_ = 0;
};

Eigen::Map<Eigen::VectorXd> view(const VectorPtr& vector, int size) { return {N_VGetArrayPointer(vector.get()), size}; }

}  // namespace

Motion integrate_ida_with_scalars(Model& model, const State& state, const Eigen::VectorXd& accelerations,
                                  const InitialValueData& settings, const IntegrateOptions& options) {
  for (const ConstraintEntry& entry : model.constraints()) {
    if (const std::string why = entry.constraint->no_variable_step(); !why.empty()) {
      throw ModelError(joint_title(*entry.data) + " " + why);
    }
  }
  ScalarEquations equations(model, state);
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
  const int modes = static_cast<int>(equations.with_modes().size());
  if (IDAInit(ida.get(), ScalarEquations::residual, t0, y.get(), ydot.get()) != IDA_SUCCESS ||
      IDASVtolerances(ida.get(), options.rtol, tolerance.get()) != IDA_SUCCESS ||
      IDASetUserData(ida.get(), &equations) != IDA_SUCCESS || IDASetId(ida.get(), id.get()) != IDA_SUCCESS ||
      IDASetSuppressAlg(ida.get(), SUNTRUE) != IDA_SUCCESS ||
      IDASetLinearSolver(ida.get(), solver.get(), matrix.get()) != IDA_SUCCESS ||
      IDASetJacFn(ida.get(), ScalarEquations::jacobian) != IDA_SUCCESS ||
      (modes > 0 && IDARootInit(ida.get(), modes, ScalarEquations::mode_margins) != IDA_SUCCESS)) {
    throw std::bad_alloc();
  }
  IDASetErrHandlerFn(ida.get(), ignore_message, nullptr);
  IDASetNoInactiveRootWarn(ida.get());
  IDASetNonlinConvCoef(ida.get(),
                       std::clamp(kRoundOff / std::min(options.rtol, options.atol), kNewtonCoefficient, kLooseNewton));
  const double first_step = std::min(h, kFirstStep * std::sqrt(options.rtol));
  IDASetInitStep(ida.get(), first_step);
  IDASetMaxNumSteps(ida.get(), kStepsPerOutput);
  IDASetStopTime(ida.get(), settings.final_time);

  MotionRecorder recorder(model, options.channels);
  recorder.record(state, state.t);
  model.accept(state);
  const auto steps = static_cast<long>(std::floor((settings.final_time - t0) / h + 1e-6));
  for (long k = options.output_every; steps > 0; k += options.output_every) {
    if (k > steps) {
      if (k - options.output_every == steps) break;
      k = steps;  // the last instant is always written
    }
    double t = t0;
    const double target = std::min(t0 + static_cast<double>(k) * h, settings.final_time);
    int flag = IDA_ROOT_RETURN;
    for (int restarts = 0; flag == IDA_ROOT_RETURN; ++restarts) {
      flag = IDASolve(ida.get(), target, &t, y.get(), ydot.get(), IDA_NORMAL);
      if (flag < 0 || (flag == IDA_ROOT_RETURN && restarts == kMostRestarts)) {
        std::ostringstream out;
        const std::unique_ptr<char, void (*)(void*)> name(IDAGetReturnFlagName(flag), std::free);
        out << "time integration stopped at t = " << t << " s (" << (flag < 0 ? name.get() : "friction chatters")
            << "): " << equations.worst_equation(t, equations.view(y.get()), equations.view(ydot.get()))
            << "; loosen the tolerances, or integrate with `ms`";
        throw NotConverged(out.str());
      }
      if (flag != IDA_ROOT_RETURN) break;
      // an element ends its mode: begin again in the next one
      std::vector<int> roots(static_cast<std::size_t>(modes));
      IDAGetRootInfo(ida.get(), roots.data());
      equations.output(t, equations.view(y.get()), equations.view(ydot.get()));
      equations.end_modes(roots);
      equations.start(equations.accelerations(), view(y, n), view(ydot, n), view(id, n), options.atol,
                      view(tolerance, n));
      if (IDAReInit(ida.get(), t, y.get(), ydot.get()) != IDA_SUCCESS) throw std::bad_alloc();
      IDASetInitStep(ida.get(), first_step);
    }
    const State& now = equations.output(t, equations.view(y.get()), equations.view(ydot.get()));
    model.accept(now);
    recorder.record(now, now.t);
    if (options.progress) options.progress(t);
  }
  return recorder.take();
}

}  // namespace mbdae
