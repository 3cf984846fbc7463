// Genels with an unknown of their own: a value imposed on one degree of freedom or on a difference of two; a mass.
//
//   clamp:     phi = x - d(t),            g[row] += F
//   distance:  phi = x2 - x1 - d(t),      g[1] -= F,  g[2] += F
//   mass:      w - x' = 0,                g[row] += m w'        w is a state
//
// F, the reaction, is the force that the clamp takes from the degree of freedom (from the first towards the second). x
// is the value by its order: with `differential` the rate is imposed. Valid in any state. Source: MBDyn's genels;
// tangents exact also for algebraic nodes, where MBDyn's `distance` is not, and for drives that read the state
// (docs/conventions.md). Test "genels" (test_model_scalar.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mbdae/model/dof.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct GenelClampData {
  DofData dof;
  DrivePtr drive;
};

struct GenelDistanceData {
  DofData dof1, dof2;
  DrivePtr drive;
};

struct GenelMassData {
  DofData dof;
  double m = 0.0;

  static int scalars() { return 1; }
};

class ScalarConstraint final : public Constraint {
 public:
  ScalarConstraint(const GenelClampData& data, const Numbering& numbering);
  ScalarConstraint(const GenelDistanceData& data, const Numbering& numbering);
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  void rates(const State& state, ConstraintRates& out, bool tangent) const override;
  bool velocity_level(int /*k*/) const override { return !position_level_; }
  bool is_couple(int /*k*/) const override { return false; }
  bool plain_equation(int /*k*/) const override { return plain_; }
  std::string reaction_unit(int /*k*/) const override { return dofs_.front().load_unit(); }

 private:
  std::vector<Dof> dofs_;
  std::vector<double> signs_;
  DrivePtr drive_;
  bool position_level_ = true;
  bool plain_ = false;  ///< a clamp of an algebraic node: the equation that gives its value
};

class GenelMass final : public Element {
 public:
  GenelMass(const GenelMassData& data, const Numbering& numbering)
      : dof_(data.dof, numbering), m_(data.m), w_(numbering.scalar) {}
  void assemble(const State& state, Equations& eq, bool tangent) const override;
  std::vector<ScalarInfo> scalars() const override { return {{".rate", "-", "rate of the degree of freedom", true}}; }
  void initialise(State& state) const override { state.y(w_) = dof_.rate(state); }

 private:
  Dof dof_;
  double m_;
  int w_;
};

namespace reading {

GenelClampData read_genel_clamp(Context& context);
GenelDistanceData read_genel_distance(Context& context);
GenelMassData read_genel_mass(Context& context);

}  // namespace reading

}  // namespace mbdae
