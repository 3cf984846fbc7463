// What IDA integrates: unknowns, residual and Jacobian of the stabilised index-2 equations.
//
// The unknowns, in this order: per node x, quaternion (7), modal displacements; per node v, w (6), modal velocities;
// scalars and reactions lambda; multipliers mu, one for each of these, that keep position and velocity constraints both
// satisfied (Gear, Gupta and Leimkuhler 1985) and are zero where there is no such constraint. Equations:
// docs/theory/integration.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "mbdae/dae/analyses.h"
#include "mbdae/dae/consistency.h"

namespace mbdae {

namespace ida_detail {

std::string time_text(double t);

class IdaEquations {
 public:
  using Values = Eigen::Map<const Eigen::VectorXd>;

  IdaEquations(Model& model, const State& state);

  int size() const { return size_; }
  const State& state() const { return state_; }
  // True if the last output found that the constraints that follow from the others are to be chosen again.
  bool stale() const { return stale_; }
  // Elements that end their modes by themselves (stuck, sliding).
  const std::vector<Element*>& with_modes() const { return with_modes_; }

  // Drives are evaluated within these times only: on this side of their jumps.
  void set_piece(double from, double to);

  // Puts the present motion on the constraints as they are just behind t, and finds which of them are redundant there.
  // The nodes' velocities change as little as the constraints ask for.
  Correction settle(double t);

  // Accelerations of the present state, elements in the modes that it asks for.
  Eigen::VectorXd accelerations();

  // Ends the modes of those elements whose margin is marked as having become zero.
  void end_modes(const std::vector<int>& roots);

  // Initial values, rates, and which unknowns are differential.
  void start(const Eigen::VectorXd& accelerations, Eigen::Ref<Eigen::VectorXd> y, Eigen::Ref<Eigen::VectorXd> ydot,
             Eigen::Ref<Eigen::VectorXd> id, double atol, Eigen::Ref<Eigen::VectorXd> tolerance) const;

  // IDA's unknowns into node motions, scalars and reactions.
  const State& state_of(double t, const Values& y, const Values& ydot);

  // The state to write: IDA interpolates between its steps, so the interpolated motion is put back on the constraints
  // (shortest correction); redundant constraints share their load with the smallest norm.
  const State& output(double t, const Values& y, const Values& ydot);

  /// Which equation is farthest from holding, and how far; empty if all of them hold.
  std::string worst_equation(double t, const Values& y, const Values& ydot);

  /// What moves as no machine does, and what to look for; empty if nothing does.
  std::string absurd_motion(double t, const Values& y, const Values& ydot);

  /// The same of the equation that is farthest from holding.
  std::string absurd_force(double t, const Values& y, const Values& ydot);

  /// What contradicts what at time t, were the present state to go there; empty if nothing does.
  std::string contradiction_at(double t) { return contradiction(model_, state_, std::clamp(t, from_, to_)); }

  /// Why loads of elements with modes could not be solved for; empty if they could.
  const std::string& load_failure() const { return load_failure_; }

  // IDA's callbacks; the last argument is this object.
  static int residual(double t, N_Vector yy, N_Vector yp, N_Vector rr, void* self);
  static int jacobian(double t, double cj, N_Vector yy, N_Vector yp, N_Vector rr, SUNMatrix J, void* self, N_Vector,
                      N_Vector, N_Vector);
  static int mode_margins(double t, N_Vector yy, N_Vector yp, realtype* margins, void* self);

  Values view(N_Vector vector) const { return {N_VGetArrayPointer(vector), size_}; }

 private:
  // What the equation of a scalar or reaction says of the motion: nothing (none), or which level of it is constrained.
  enum class Level { none, position, velocity };

  // Where node i's position, velocity and variation (dx, dphi) start.
  static int pose(int i) { return 7 * i; }
  int velocity(int i) const { return velocity_ + 6 * i; }
  static int motion(int i) { return 6 * i; }
  int modal_pose(const MotionGroup& group) const { return nodes_ + group.motion; }
  std::size_t groups() const { return model_.motions().size(); }

  void add_to_modes(const Eigen::VectorXd& change, bool velocities);
  std::vector<int> moving_of(std::size_t i) const;

  void assemble(bool tangent);
  void classify();
  void check_steady();
  bool depends_on_positions(int row) const;
  double rate(int k) const;
  void gather(Eigen::MatrixXd& Phi) const;
  void project(bool kept_only);
  Eigen::MatrixXd constraint_rows() const;
  void find_redundant();
  bool misses() const;
  void check_agreement();
  void share_loads();

  void evaluate(double t, const Values& y, const Values& ydot, Eigen::Ref<Eigen::VectorXd> r);
  void differentiate(double t, double cj, const Values& y, const Values& ydot, Eigen::Ref<Eigen::MatrixXd> J);
  void differentiate_kinematics(double cj, const Values& y, Eigen::Ref<Eigen::MatrixXd> J) const;
  void differentiate_rates(double cj, const Values& y, Eigen::Ref<Eigen::MatrixXd> J) const;
  void differentiate_inertia(double cj, std::size_t i, const Values& y, const Values& ydot,
                             Eigen::Ref<Eigen::MatrixXd> J) const;

  Model& model_;
  State state_;
  Equations eq_;
  ConstraintRates rates_;
  std::vector<Element*> with_modes_;
  std::string load_failure_;
  // Of scalars and reactions, one after the other:
  std::vector<Level> level_;
  std::vector<bool> kept_;         // has a multiplier mu
  std::vector<bool> rate_counts_;  // of every scalar
  std::vector<int> redundant_;     // reactions whose constraint follows from the others, counted from the first scalar
  double redundancy_ = 0.0;        // relative size of the part of a constraint that does not follow from others
  double part_ = 1.0;              // that they have in the dependencies, at least
  bool stale_ = false;             // others should be left out
  bool scalar_constraints_ = false;  // some scalar's equation constrains positions
  // Times that drives are evaluated at.
  double from_ = -std::numeric_limits<double>::infinity(), to_ = std::numeric_limits<double>::infinity();
  int nodes_ = 0, motions_ = 0, scalars_ = 0, reactions_ = 0, own_ = 0;
  int velocity_ = 0, scalar_ = 0, lambda_ = 0, mu_ = 0, size_ = 0;
};

}  // namespace ida_detail

}  // namespace mbdae
