// Genels `state space SISO`, `state space MIMO` and `scalar filter`: linear systems between degrees of freedom and
// drives.
//
//   g[x] = E x' - A x - B u
//   g[y] += y - C x - D u          in the row of the output's degree of freedom, y its value
//
// x are n states of its own; u are degrees of freedom or drives. `gain` multiplies C and D. The scalar filter y/u =
// b(s)/a(s) with monic a is the controllable canonical form of it, its gain multiplying b. Unless the card says
// `balance, no` the states are scaled by powers of two, x = T x_scaled, as MBDyn scales them (LAPACK's dgebal):
// unknowns and the initial values of the card are the scaled ones. Valid in any state. Source: MBDyn's genels. Tangent
// exact; MBDyn's has the input with the opposite sign and in the input's row number, lacks D, and leaves out drives
// (docs/conventions.md). Tests "state spaces and filters", "states are balanced as LAPACK does"
// (test_model_scalar.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mbdae/model/dof.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct StateSpaceData {
  /// A degree of freedom, or else a drive.
  struct Input {
    std::optional<DofData> dof;
    DrivePtr drive;
  };
  std::vector<DofData> outputs;
  std::vector<Input> inputs;
  Eigen::MatrixXd E, A, B, C, D;
  Eigen::VectorXd x, xdot;  ///< initial values; rates where the deck has them

  int scalars() const { return static_cast<int>(A.rows()); }
};

class StateSpace final : public Element {
 public:
  StateSpace(const StateSpaceData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  std::vector<ScalarInfo> scalars() const override;
  void initialise(State& state) const override;

 private:
  StateSpaceData data_;
  int first_;
  std::vector<Dof> outputs_;
  std::vector<std::optional<Dof>> inputs_;
};

/// Diagonal of T that balances T^-1 A T: rows and columns of like norms, powers of two.
Eigen::VectorXd balancing_scale(Eigen::MatrixXd A);

namespace reading {

StateSpaceData read_state_space_siso(Context& context);
StateSpaceData read_state_space_mimo(Context& context);
StateSpaceData read_scalar_filter(Context& context);

}  // namespace reading

}  // namespace mbdae
