// Genels without unknowns of their own: springs on degrees of freedom, and forces on them.
//
// x, x' are a degree of freedom and its rate, f(x, x') a law with one component.
//
//   spring support:        g[row] += f(x - x0, x')
//   cross spring support:  g[row] += f(x_column, x'_column)      the row may be another's: networks of springs are
//                                                                state spaces, docs/theory/elements.md
//   spring:                g[1] -= f(x2 - x1),  g[2] += f(x2 - x1)
//   force, abstract:       g[row] -= d(t)
//
// The row of a structural degree of freedom is its force or moment equilibrium (g is minus the sum of forces): a spring
// pulls back. The row of an abstract node is its own equation. Valid in any state. Source: MBDyn's genels; tangents
// exact also for algebraic nodes, where MBDyn's `spring` is not, and for drives that read the state, which MBDyn leaves
// out (docs/conventions.md). Test "genels" (test_model_scalar.cpp).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mbdae/model/dof.h"

namespace mbdae {

namespace reading {
struct Context;
}

struct SpringSupportData {
  DofData dof;
  Law1 law;
  double x0 = 0.0;
};

struct CrossSpringData {
  DofData row, column;
  Law1 law;
};

struct ScalarSpringData {
  DofData dof1, dof2;
  Law1 law;
};

struct AbstractForceData {
  DofData dof;
  DrivePtr drive;
};

class SpringSupport final : public Element {
 public:
  SpringSupport(const SpringSupportData& data, const Numbering& numbering)
      : data_(data), row_(data.dof, numbering), column_(data.dof, numbering), x0_(data.x0) {}
  SpringSupport(const CrossSpringData& data, const Numbering& numbering)
      : data_{data.column, data.law, 0.0}, row_(data.row, numbering), column_(data.column, numbering) {}
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  SpringSupportData data_;
  Dof row_, column_;
  double x0_ = 0.0;
};

class ScalarSpring final : public Element {
 public:
  ScalarSpring(const ScalarSpringData& data, const Numbering& numbering)
      : data_(data), dof1_(data.dof1, numbering), dof2_(data.dof2, numbering) {}
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  ScalarSpringData data_;
  Dof dof1_, dof2_;
};

class AbstractForce final : public Element {
 public:
  AbstractForce(const AbstractForceData& data, const Numbering& numbering) : data_(data), dof_(data.dof, numbering) {}
  void assemble(const State& state, Equations& eq, bool tangent) const override;

 private:
  AbstractForceData data_;
  Dof dof_;
};

namespace reading {

SpringSupportData read_spring_support(Context& context);
CrossSpringData read_cross_spring(Context& context);
ScalarSpringData read_scalar_spring(Context& context);
AbstractForceData read_abstract_force(Context& context);

}  // namespace reading

}  // namespace mbdae
