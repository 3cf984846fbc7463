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
#include "mbdae/dae/jumps.h"
#include "mbdae/dae/recorder.h"

namespace mbdae {

namespace {

using ida_detail::IdaEquations;
using ida_detail::time_text;

// Newton's iteration stops at this part of the local error test, so that constraints hold far better than the
// tolerance; at tight tolerances round-off [relative to unity] sets the limit, and SUNDIALS' default is never exceeded.
constexpr double kNewtonCoefficient = 1e-3, kRoundOff = 1e-14, kLooseNewton = 0.33;

// Between two instants written: where constraints cease to be redundant, and ends of elements' modes.
constexpr int kMostRestarts = 50, kMostEnds = 10000;

constexpr double kRoundOffOfTimes = 1e-14;  // relative: IDA does not integrate over less

constexpr double kNotQuite = 1e-10;  // violation at the start worth a word [m, rad]

// First step as a part of the square root of the tolerance [s]: the first step is of first order, and IDA shortens it
// where needed.
constexpr double kFirstStep = 0.1;

constexpr long kStepsPerOutput = 100000, kStepsWithScalars = 1000000;

// It gives up sooner where, twice in a row, this many steps lead on so little that several times the most would be
// needed.
constexpr long kStepsBetweenLooks = 2500;
constexpr double kHopeless = 5.0;

// A part of the time step: how far ahead a failure without visible cause is looked into.
constexpr double kAhead = 1e-3, kFarAhead = 10.0;

struct IdaDeleter {
  void operator()(void* memory) const { IDAFree(&memory); }
};

void ignore_message(int, const char*, const char*, char*, void*) {}  // failures are reported by NotConverged

Eigen::Map<Eigen::VectorXd> view(const VectorPtr& vector, int size) { return {N_VGetArrayPointer(vector.get()), size}; }

/// SUNDIALS' objects for one integration.
class Ida {
 public:
  Ida(IdaEquations& equations, const InitialValueData& settings, const IntegrateOptions& options, bool scalars)
      : equations_(equations),
        settings_(settings),
        options_(options),
        n_(equations.size()),
        context_(make_context()),
        most_steps_(scalars ? kStepsWithScalars : kStepsPerOutput) {
    for (VectorPtr* vector : {&y_, &ydot_, &id_, &tolerance_}) vector->reset(N_VNew_Serial(n_, context_.get()));
    matrix_.reset(SUNDenseMatrix(n_, n_, context_.get()));
    solver_ = make_dense_solver(context_.get(), false);
    ida_.reset(IDACreate(context_.get()));
    if (!y_ || !ydot_ || !id_ || !tolerance_ || !matrix_ || !ida_) throw std::bad_alloc();
  }

  /// Starts, again or for the first time, at time t from the equations' state.
  void start(double t) {
    equations_.start(equations_.accelerations(), view(y_, n_), view(ydot_, n_), view(id_, n_), options_.atol,
                     view(tolerance_, n_));
    const int flag = started_ ? IDAReInit(ida_.get(), t, y_.get(), ydot_.get())
                              : IDAInit(ida_.get(), IdaEquations::residual, t, y_.get(), ydot_.get());
    if (flag != IDA_SUCCESS) throw std::bad_alloc();
    if (!started_) set_up();
    started_ = true;
    if (IDASetId(ida_.get(), id_.get()) != IDA_SUCCESS) throw std::bad_alloc();
    t_ = t;
    IDASetInitStep(ida_.get(), std::min(settings_.time_step, kFirstStep * std::sqrt(options_.rtol)));
  }

  /// Goes on to `target`, but not beyond `stop`. Returns SUNDIALS' flag.
  int advance(double target, double stop) {
    IDASetStopTime(ida_.get(), stop);
    const double end = std::min(target, stop), looks = static_cast<double>(most_steps_ / kStepsBetweenLooks);
    steps_ = 0;
    for (int hopeless = 0;;) {
      const double before = t_;
      const int flag = IDASolve(ida_.get(), target, &t_, y_.get(), ydot_.get(), IDA_NORMAL);
      if (flag != IDA_TOO_MUCH_WORK || (steps_ += kStepsBetweenLooks) >= most_steps_) return flag;
      hopeless = end - t_ > kHopeless * looks * (t_ - before) ? hopeless + 1 : 0;
      if (hopeless == 2) return flag;
    }
  }

  double t() const { return t_; }
  Eigen::Map<const Eigen::VectorXd> y() const { return {N_VGetArrayPointer(y_.get()), n_}; }
  Eigen::Map<const Eigen::VectorXd> ydot() const { return {N_VGetArrayPointer(ydot_.get()), n_}; }

  /// Which elements have ended their modes, after IDA_ROOT_RETURN.
  std::vector<int> ended() const {
    std::vector<int> roots(equations_.with_modes().size());
    IDAGetRootInfo(ida_.get(), roots.data());
    return roots;
  }

  [[noreturn]] void fail(int flag) {
    const std::string absurd = equations_.absurd_motion(t_, y(), ydot());
    if (flag == IDA_TOO_MUCH_WORK) {
      throw NotConverged("time integration stopped at t = " + time_text(t_) + " s: " + std::to_string(steps_) +
                         " steps did not reach the next instant to write" +
                         (absurd.empty() ? "; loosen the tolerances, or integrate with `ms`" : ": " + absurd));
    }
    const std::string where = equations_.worst_equation(t_, y(), ydot());
    if (flag == IDA_ROOT_RETURN) {
      throw NotConverged("time integration stopped at t = " + time_text(t_) + " s: friction chatters" +
                         (where.empty() ? "" : " (" + where + ")") + "; loosen the tolerances, or integrate with `ms`");
    }
    const std::unique_ptr<char, void (*)(void*)> name(IDAGetReturnFlagName(flag), std::free);
    const std::string stopped = "time integration stopped at t = " + time_text(t_) + " s (" + name.get() + "): ";
    if (flag == IDA_REP_RES_ERR || flag == IDA_FIRST_RES_FAIL || flag == IDA_RES_FAIL) {
      throw NotConverged(stopped + (where.empty() ? "just after it the equations have no finite value" : where) + "; " +
                         kLookForNoNumber);
    }
    if (flag == IDA_RTFUNC_FAIL && !equations_.load_failure().empty()) {
      throw NotConverged(stopped + equations_.load_failure());
    }
    if (!absurd.empty()) throw NotConverged(stopped + absurd);
    if (where.empty()) {
      const std::string soon = equations_.absurd_force(t_ + kAhead * settings_.time_step, y(), ydot());
      if (!soon.empty()) throw NotConverged(stopped + "just after it " + soon);
      for (const double ahead : {kAhead, 1.0, kFarAhead}) {
        const std::string contradicts = equations_.contradiction_at(t_ + ahead * settings_.time_step);
        if (!contradicts.empty()) throw NotConverged(stopped + contradicts);
      }
    }
    throw NotConverged(
        stopped + (where.empty() ? "all equations hold there, but no step leads on" : where) +
        "; loosen the tolerances, or look for a motion that the joints do not allow, or one that nothing "
        "determines (a body without mass that nothing holds)");
  }

 private:
  void set_up() {
    const int modes = static_cast<int>(equations_.with_modes().size());
    std::vector<int> falling(equations_.with_modes().size(), -1);
    if (IDASVtolerances(ida_.get(), options_.rtol, tolerance_.get()) != IDA_SUCCESS ||
        IDASetUserData(ida_.get(), &equations_) != IDA_SUCCESS ||
        IDASetSuppressAlg(ida_.get(), SUNTRUE) != IDA_SUCCESS ||
        IDASetLinearSolver(ida_.get(), solver_.get(), matrix_.get()) != IDA_SUCCESS ||
        IDASetJacFn(ida_.get(), IdaEquations::jacobian) != IDA_SUCCESS ||
        (modes > 0 && (IDARootInit(ida_.get(), modes, IdaEquations::mode_margins) != IDA_SUCCESS ||
                       IDASetRootDirection(ida_.get(), falling.data()) != IDA_SUCCESS))) {
      throw std::bad_alloc();
    }
    IDASetErrHandlerFn(ida_.get(), ignore_message, nullptr);
    IDASetNoInactiveRootWarn(ida_.get());
    IDASetNonlinConvCoef(
        ida_.get(), std::clamp(kRoundOff / std::min(options_.rtol, options_.atol), kNewtonCoefficient, kLooseNewton));
    IDASetMaxNumSteps(ida_.get(), kStepsBetweenLooks);
  }

  IdaEquations& equations_;
  const InitialValueData& settings_;
  const IntegrateOptions& options_;
  int n_;
  ContextPtr context_;
  VectorPtr y_, ydot_, id_, tolerance_;
  MatrixPtr matrix_;
  SolverPtr solver_;
  std::unique_ptr<void, IdaDeleter> ida_;
  bool started_ = false;
  long most_steps_, steps_ = 0;  // to the next instant: allowed, and done
  double t_ = 0.0;
};

std::string off_text(const Model& model, const Correction& positions, const std::string& before,
                     const std::string& after) {
  std::ostringstream out;
  out.precision(3);
  out << before << violated(model, positions, false) << after << positions.moved << " m or rad";
  if (positions.left > kNotQuite) out << "; " << positions.left << " m or rad remain open";
  return out.str();
}

}  // namespace

Motion integrate_ida(Model& model, const State& state, const InitialValueData& settings,
                     const IntegrateOptions& options, const AtInstant& at_instant) {
  const double t0 = settings.initial_time, h = settings.time_step;
  const long steps = count_steps(settings);
  const std::vector<Jump> jumps = find_jumps(model.deck().pieced_drives, settings);
  std::size_t next_jump = 0;
  std::vector<std::string> notes;

  model.follow_free_rotations(true);
  IdaEquations equations(model, state);
  double from = t0;  // where the drives' present piece begins
  if (!jumps.empty() && jumps.front().before <= t0) from = jumps[next_jump++].after;
  const auto stop = [&] { return next_jump < jumps.size() ? jumps[next_jump].before : settings.final_time; };
  equations.set_piece(from, stop());
  const Correction open = equations.settle(t0);
  const bool closed = std::abs(open.violation) > kNotQuite;
  if (closed) {
    notes.push_back(off_text(
        model, open, "the joints do not quite meet at the start: ", "; the nodes were moved to close it, by at most "));
  }
  Ida ida(equations, settings, options, model.scalar_count() > 0);
  ida.start(t0);
  double started = t0;
  int restarts = 0, ends = 0;  // since the last instant written

  MotionRecorder recorder(model, options.channels);
  recorder.record(closed ? equations.state() : state, t0);
  model.accept(equations.state());
  for (long k = options.output_every; steps > 0; k += options.output_every, restarts = ends = 0) {
    if (k > steps) {
      if (k - options.output_every == steps) break;
      k = steps;  // the last instant is always written
    }
    const double target = std::min(t0 + static_cast<double>(k) * h, settings.final_time);
    bool written = false;
    while (!written) {
      const int flag = ida.advance(target, std::min(stop(), settings.final_time));
      // A failure may come of what has been told.
      const auto fail = [&] {
        try {
          ida.fail(flag);
        } catch (const NotConverged& failure) {
          throw NotConverged(failure.what() + (notes.empty() ? "" : " (" + notes.back() + ")"));
        }
      };
      if (flag == IDA_ROOT_RETURN) {  // an element ends its mode: begin again in the next one
        if (++ends > kMostEnds) fail();
        const std::vector<int> ended = ida.ended();
        started = ida.t();
        equations.state_of(started, ida.y(), ida.ydot());
        equations.settle(started);
        equations.end_modes(ended);
        ida.start(started);
        continue;
      }
      const bool at_jump = flag >= 0 && next_jump < jumps.size() && ida.t() >= jumps[next_jump].before;
      if (flag < 0 && (flag == IDA_TOO_MUCH_WORK || !(ida.t() > started) || ++restarts > kMostRestarts)) fail();
      // The instant of a jump, to round-off, is the one before it.
      written = flag >= 0 && (!at_jump || target <= jumps[next_jump].after + kRoundOffOfTimes * std::abs(target));
      if (written) {
        const State& now = equations.output(target, ida.y(), ida.ydot());
        model.accept(now);
        recorder.record(now, target);
      }
      if (flag >= 0 && !at_jump && !equations.stale()) break;
      equations.state_of(ida.t(), ida.y(), ida.ydot());
      started = ida.t();
      if (at_jump) {
        started = jumps[next_jump++].after;
        equations.set_piece(started, stop());
      }
      const Correction moved = equations.settle(started);
      if (at_jump && std::abs(moved.violation) > kConstraintTolerance) {
        notes.push_back(off_text(model, moved, "at t = " + time_text(started) + " s a drive jumps: ",
                                 "; the nodes were moved at once to close it, by at most "));
      }
      ida.start(started);
    }
    if (options.progress) options.progress(target);
    if (at_instant && !at_instant(equations.state())) break;
  }
  Motion motion = recorder.take();
  motion.notes = std::move(notes);
  return motion;
}

}  // namespace mbdae
