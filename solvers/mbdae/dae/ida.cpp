// IDA at work on the equations of ida_equations.h.
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
#include "mbdae/dae/ida_equations.h"
#include "mbdae/dae/ida_scalars.h"
#include "mbdae/dae/linear_algebra.h"
#include "mbdae/dae/recorder.h"

namespace mbdae {

namespace {

// Newton's iteration stops at this part of the local error test, so that constraints hold far better than the
// tolerance; at tight tolerances round-off [relative to unity] sets the limit, and SUNDIALS' default is never exceeded.
constexpr double kNewtonCoefficient = 1e-3, kRoundOff = 1e-14, kLooseNewton = 0.33;

// First step as a part of the square root of the tolerance [s]: the first step is of first order, and IDA shortens it
// where needed.
constexpr double kFirstStep = 0.1;

constexpr long kStepsPerOutput = 1000000;

struct IdaDeleter {
  void operator()(void* memory) const { IDAFree(&memory); }
};

void ignore_message(int, const char*, const char*, char*, void*) {}  // failures are reported by NotConverged

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
    bool modal = !model.flexible().empty();
    for (const NodeSlot& slot : model.slots()) modal |= slot.modal;
    if (modal) {
      throw ModelError("IDA has no equations for modal joints beside abstract nodes or friction: integrate with `ms`");
    }
    return integrate_ida_with_scalars(model, state, accelerations, settings, options);
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
