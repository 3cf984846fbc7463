// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/elements/genel_springs.h"

#include "mbdae/deck/drive_reader.h"
#include "mbdae/deck/element_reader.h"
#include "mbdae/deck/law_reader.h"
#include "mbdae/deck/scalar_reader.h"

namespace mbdae {

void SpringSupport::assemble(const State& state, Equations& eq, bool tangent) const {
  const auto [f, k, d] = evaluate(data_.law, state.t, column_.value(state) - x0_, column_.rate(state));
  eq.g(row_.row()) += f;
  if (!tangent) return;
  column_.add_value(eq, row_.row(), k);
  column_.add_rate(eq, row_.row(), d);
}

void ScalarSpring::assemble(const State& state, Equations& eq, bool tangent) const {
  const auto [f, k, d] = evaluate(data_.law, state.t, dof2_.value(state) - dof1_.value(state), 0.0);
  eq.g(dof1_.row()) -= f;
  eq.g(dof2_.row()) += f;
  if (!tangent) return;
  dof1_.add_value(eq, dof1_.row(), k);
  dof2_.add_value(eq, dof1_.row(), -k);
  dof1_.add_value(eq, dof2_.row(), -k);
  dof2_.add_value(eq, dof2_.row(), k);
}

void AbstractForce::assemble(const State& state, Equations& eq, bool tangent) const {
  eq.g(dof_.row()) -= data_.drive->value(state.t);
  if (tangent) add_drive_derivative(eq, dof_.row(), *data_.drive, state.t, -1.0);
}

namespace reading {

namespace {

/// A degree of freedom whose value and rate a law can take: the `algebraic` order of one that has a rate.
DofData read_spring_dof(Context& context) {
  const SourcePosition where = context.input.where();
  const DofData dof = read_dof(context);
  if (is_algebraic(context, dof)) {
    context.input.fail(where, "the node is algebraic and has no rate: a spring needs a differential node");
  }
  if (dof.rate) context.input.fail(where, "a spring takes the `algebraic` order; write a viscous law for a velocity");
  if (dof.structural && dof.component >= 3) {
    context.input.fail(where, "a rotation has no value of its own that a spring could take; use a deformable hinge");
  }
  return dof;
}

}  // namespace

SpringSupportData read_spring_support(Context& context) {
  Input& input = context.input;
  SpringSupportData genel;
  genel.dof = read_spring_dof(context);
  genel.law = read_spring_law1(context);
  if (input.more() && input.take("position")) {
    input.need("the position of zero strain, or `from node`");
    if (!input.take("from node")) {
      genel.x0 = input.real("the position of zero strain, or `from node`");
    } else if (genel.dof.structural) {
      genel.x0 = context.deck.nodes[genel.dof.node].x(genel.dof.component);
    } else {
      genel.x0 = context.deck.abstract_nodes[genel.dof.node].value;
    }
  }
  return genel;
}

CrossSpringData read_cross_spring(Context& context) {
  CrossSpringData genel;
  genel.row = read_dof(context);
  genel.column = read_spring_dof(context);
  genel.law = read_spring_law1(context);
  return genel;
}

ScalarSpringData read_scalar_spring(Context& context) {
  ScalarSpringData genel;
  const auto read_end = [&] {
    const SourcePosition where = context.input.where();
    const DofData dof = read_dof(context);
    if (dof.structural && dof.component >= 3 && !dof.rate) {
      context.input.fail(where, "a rotation has no value of its own that a spring could take; use a deformable hinge");
    }
    return dof;
  };
  genel.dof1 = read_end();
  genel.dof2 = read_end();
  const SourcePosition where = context.input.where();
  genel.law = read_spring_law1(context);
  if (evaluate(genel.law, 0.0, 0.0, 1.0).d != 0.0) {
    context.input.fail(where, "the genel `spring` takes an elastic law");
  }
  return genel;
}

AbstractForceData read_abstract_force(Context& context) {
  const AllowStateDrives allow(context);
  AbstractForceData force;
  force.dof = read_dof(context, Order::optional);
  force.drive = read_drive(context);
  if (context.input.more()) skip_output(context.input);
  return force;
}

}  // namespace reading

}  // namespace mbdae
