// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/linearise_at_state.h"

#include <utility>

#include "mbdae/dae/linear_algebra.h"

namespace mbdae {

namespace {

constexpr double kDefaultCoefficient = 0.01;  // s, LineariseOptions::c

void describe_unknowns(const Model& model, LinearisedModel& out) {
  out.dofs.reserve(static_cast<std::size_t>(model.size()));
  for (int place = 0; place < model.size(); ++place) {
    const int k = model.file_order().empty() ? place : model.file_order()[static_cast<std::size_t>(place)];
    out.dofs.push_back({model.unknown_name(k), model.unknown_kind(k), model.unknown_unit(k), model.unknown_owner(k)});
  }
  if (model.file_order().empty()) {
    for (const ConstraintEntry& entry : model.constraints()) {
      out.joints.push_back({entry.data->id.name, static_cast<int>(entry.data->id.label), entry.data->type->name,
                            entry.constraint->first(), entry.constraint->size()});
    }
    return;
  }
  // elements with unknowns of their own, where they stand in the file
  int first = model.own_start() + static_cast<int>(model.deck().abstract_nodes.size());
  std::size_t constraint = 0;
  for (const std::vector<ElementData>* list : {&model.deck().joints, &model.deck().genels}) {
    for (const ElementData& data : *list) {
      int dofs = data.type->scalars != nullptr ? data.type->scalars(data.data) : 0;
      if (constraint < model.constraints().size() && model.constraints()[constraint].data == &data) {
        dofs += model.constraints()[constraint++].constraint->size();
        if (data.type->coordinates != nullptr) dofs += 2 * data.type->coordinates(data.data);
      }
      if (dofs == 0) continue;
      const std::string prefix = data.type->card == CardKind::genel ? "genel " : "";
      out.joints.push_back({data.id.name, static_cast<int>(data.id.label), prefix + data.type->name, first, dofs});
      first += dofs;
    }
  }
}

void describe_nodes(const Model& model, const State& state, LinearisedModel& out) {
  out.nodes.reserve(state.nodes.size());
  for (std::size_t i = 0; i < state.nodes.size(); ++i) {
    const NodeMotion& motion = state.nodes[i];
    const NodeSlot& slot = model.slots()[i];
    const Identity& id = model.deck().nodes[i].id;
    NodeState node;
    node.name = id.name;
    node.label = static_cast<int>(id.label);
    node.first = slot.first;
    node.dofs = slot.has_rates() ? 12 : 6;
    node.x = motion.x;
    node.v = motion.v;
    node.w = motion.w;
    node.R = motion.R;
    out.nodes.push_back(node);
  }
}

void describe_inputs(const Model& model, const State& state, LinearisedModel& out) {
  std::vector<std::pair<const ElementData*, DriveInput>> drives;
  for (const ConstraintEntry& entry : model.constraints()) {
    for (DriveInput& input : entry.constraint->drive_inputs(state)) drives.emplace_back(entry.data, std::move(input));
  }
  out.g_u = Eigen::MatrixXd::Zero(model.size(), static_cast<Eigen::Index>(model.muscles().size() + drives.size()));

  int column = 0;
  for (const auto& [data, muscle] : model.muscles()) {
    const Identity& id = data->id;
    const MuscleValue value = muscle->value(state);
    out.muscles.push_back(
        {id.name, static_cast<int>(id.label), muscle->length(state), value.x, value.v, value.activation, value.force});
    out.inputs.push_back({"activation[" + id.name + "]", "-"});
    muscle->add_activation_derivative(state, value, out.g_u.col(column++));
  }
  for (const auto& [data, input] : drives) {
    out.inputs.push_back({"drive[" + data->id.name + input.name + "]", input.unit});
    out.g_u.col(column++).segment(input.first, input.column.size()) = input.column;
  }
}

// Rows and columns from the model's order of unknowns to that of files.
void order_for_file(const std::vector<int>& order, LinearisedModel& out) {
  for (Eigen::MatrixXd* matrix : {&out.J_plus, &out.J_minus}) *matrix = (*matrix)(order, order).eval();
  for (Eigen::VectorXd* vector : {&out.y, &out.ydot, &out.residual, &out.equilibrium_residual}) {
    *vector = (*vector)(order).eval();
  }
}

}  // namespace

double deck_coefficient(const Deck& deck) {
  return deck.initial_value.eigenanalysis ? 0.5 * deck.initial_value.eigenanalysis->parameter : kDefaultCoefficient;
}

LinearisedModel linearise_at_state(const Model& model, State& state, double c, const char* analysis,
                                   const Eigen::VectorXd& accelerations) {
  LinearisedModel out;
  out.analysis = analysis;
  out.c = c;
  out.time = state.t;

  Equations eq;
  if (model.scalar_count() > 0) {
    state.ydot.head(model.scalar_start()).setZero();
    state.ydot.tail(model.reaction_count()).setZero();
  } else {
    state.ydot.setZero(model.size());
  }
  const Eigen::VectorXd at_rest = Eigen::VectorXd::Zero(model.motion_count());
  model.set_modal_rates(state, at_rest);
  model.assemble(state, eq, true);
  out.equilibrium_residual = eq.g;
  out.residual_norm = norm_of(eq.g);
  for (const NodeSlot& slot : model.slots()) {
    const NodeMotion& motion = motion_of(state, slot);
    state.ydot.segment<3>(slot.first) = motion.v;
    state.ydot.segment<3>(slot.first + 3) = motion.w;
    if (slot.dynamic) state.ydot.segment<6>(slot.force) = -eq.g.segment<6>(slot.force);
  }
  model.set_modal_rates(state, accelerations);

  State free = state;  // no reactions, no momenta rates
  free.y.tail(model.reaction_count()).setZero();
  free.ydot.setZero();
  Equations unbalanced;
  model.set_modal_rates(free, at_rest);
  model.assemble(free, unbalanced, false);
  out.residual = unbalanced.g;
  // The tangents of flexible bodies depend on accelerations; those of everything else on no rate of an unknown.
  if (!model.flexible().empty() && !accelerations.isZero(0.0)) model.assemble(state, eq, true);

  model.to_increments(state, eq);
  out.J_plus = eq.g_ydot + c * eq.g_y;
  eq.g_ydot -= c * eq.g_y;
  out.J_minus = std::move(eq.g_ydot);
  out.y = state.y;
  for (const NodeSlot& slot : model.slots()) {
    out.y.segment<3>(slot.first) = motion_of(state, slot).x;
    out.y.segment<3>(slot.first + 3).setZero();
  }
  out.ydot = state.ydot;
  if (!model.file_order().empty()) order_for_file(model.file_order(), out);
  describe_unknowns(model, out);
  describe_nodes(model, state, out);
  describe_inputs(model, state, out);
  if (!model.file_order().empty()) out.g_u = out.g_u(model.file_order(), Eigen::all).eval();
  return out;
}

}  // namespace mbdae
