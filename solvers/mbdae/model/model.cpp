// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/model.h"

#include <algorithm>
#include <stdexcept>

namespace mbdae {

Model::Model(const Deck& deck) : deck_(deck) {
  slots_.reserve(deck.nodes.size());
  for (std::size_t i = 0; i < deck.nodes.size(); ++i) {
    NodeSlot slot;
    slot.index = static_cast<int>(i);
    slot.dynamic = deck.nodes[i].kind == NodeKind::dynamic_node && !deck.control.static_model;
    slot.first = size_;
    slot.force = slot.dynamic ? size_ + 6 : size_;
    size_ += slot.dynamic ? 12 : 6;
    slots_.push_back(slot);
  }
  std::vector<int> scalar_of_joint, scalar_of_genel;
  number_scalars(scalar_of_joint, scalar_of_genel);

  std::vector<std::vector<const BodyData*>> bodies(deck.nodes.size());
  for (const BodyData& body : deck.bodies) {
    if (!slots_[body.node].dynamic && !deck.control.static_model) {
      throw std::invalid_argument("body " + std::to_string(body.id.label) + " sits on the static node " +
                                  deck.nodes[body.node].id.name +
                                  ": make the node dynamic, or declare `model: static;` in the control data");
    }
    bodies[body.node].push_back(&body);
  }
  inertias_.reserve(slots_.size());
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    inertias_.emplace_back(slots_[i], bodies[i], deck.gravity ? &*deck.gravity : nullptr);
  }

  for (const std::vector<ElementData>* list : {&deck.joints, &deck.genels, &deck.forces}) {
    for (std::size_t i = 0; i < list->size(); ++i) {
      const ElementData& data = (*list)[i];
      Numbering numbering{slots_, size_, -1, abstract_slots_};
      if (list == &deck.joints) numbering.scalar = scalar_of_joint[i];
      if (list == &deck.genels) numbering.scalar = scalar_of_genel[i];
      std::unique_ptr<Element> element = data.type->make(data.data, numbering);
      if (list == &deck.joints) joints_.push_back(element.get());
      if (const Muscle* muscle = element->muscle()) muscles_.push_back({&data, muscle});
      if (numbering.scalar >= 0) {
        int k = numbering.scalar - scalar_start_;
        for (ScalarInfo& info : element->scalars()) {
          scalars_[static_cast<std::size_t>(k++)] = {&data.id, std::move(info)};
        }
      }
      if (auto* constraint = dynamic_cast<Constraint*>(element.get())) {
        element.release();
        size_ += constraint->size();
        constraints_.push_back({&data, std::unique_ptr<Constraint>(constraint)});
      } else {
        loads_.push_back({&data, std::move(element)});
      }
    }
  }
  if (scalar_count() > 0) order_for_files();
  std::stable_sort(loads_.begin(), loads_.end(), [](const LoadEntry& one, const LoadEntry& other) {
    return one.element->rank() < other.element->rank();
  });
}

State Model::initial_state() const {
  State state;
  state.t = deck_.initial_value.initial_time;
  state.y.setZero(size_);
  state.ydot.setZero(size_);
  state.nodes.reserve(slots_.size());
  for (const NodeData& node : deck_.nodes) {
    NodeMotion motion{node.x, node.R, node.v, node.w};
    if (deck_.control.static_model) motion.v = motion.w = Vec3::Zero();
    state.nodes.push_back(motion);
  }
  for (std::size_t i = 0; i < abstract_slots_.size(); ++i) {
    state.y(abstract_slots_[i].first) = deck_.abstract_nodes[i].value;
    state.ydot(abstract_slots_[i].first) = deck_.abstract_nodes[i].rate;
  }
  if (scalar_count() > 0) for_elements([&](const ElementData&, const Element& element) { element.initialise(state); });
  set_momenta(state);
  refresh_signals(state);
  return state;
}

void Model::set_momenta(State& state) const {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (slots_[i].dynamic) state.y.segment<6>(slots_[i].force) = inertias_[i].momentum(state.nodes[i]);
  }
}

void Model::set_reference(const State& state) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->set_reference(state);
}

void Model::accept(const State& state) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->accept(state);
}

bool Model::switch_modes(const State& state) {
  bool switched = false;
  for (ConstraintEntry& entry : constraints_) switched |= entry.constraint->switch_mode(state);
  return switched;
}

void Model::assemble(const State& state, Equations& eq, bool tangent) const {
  eq.clear(size_, tangent);
  for (const NodeInertia& inertia : inertias_) inertia.assemble(state, eq, tangent);
  add_loads(state, eq, tangent);
  add_constraints(state, eq, tangent);
}

void Model::assemble_statics(const State& state, Equations& eq, bool tangent) const {
  eq.clear(size_, tangent);
  add_loads(state, eq, tangent);
  add_constraints(state, eq, tangent);
}

void Model::add_loads(const State& state, Equations& eq, bool tangent) const {
  refresh_signals(state);
  for (const NodeInertia& inertia : inertias_) inertia.assemble_gravity(state, eq, tangent);
  for (const LoadEntry& entry : loads_) entry.element->assemble(state, eq, tangent);
}

void Model::add_constraints(const State& state, Equations& eq, bool tangent) const {
  refresh_signals(state);
  for (const ConstraintEntry& entry : constraints_) entry.constraint->assemble(state, eq, tangent);
}

void Model::add_reduced_constraints(const State& state, Equations& eq, bool tangent) const {
  refresh_signals(state);
  for (const ConstraintEntry& entry : constraints_) entry.constraint->assemble_reduced(state, eq, tangent);
}

void Model::rates(const State& state, ConstraintRates& out, bool tangent) const {
  refresh_signals(state);
  out.rate.setZero(size_);
  out.bias.setZero(size_);
  if (tangent) out.rate_q.setZero(size_, size_);
  for (const ConstraintEntry& entry : constraints_) entry.constraint->rates(state, out, tangent);
}

void Model::to_increments(const State& state, Equations& eq) const {
  for (const NodeSlot& slot : slots_) {
    const Vec3& w = motion_of(state, slot).w;
    if (w.isZero(0.0)) continue;
    const int g = slot.first + 3;
    eq.g_y.middleCols<3>(g) -= eq.g_ydot.middleCols<3>(g) * skew(w);
  }
}

}  // namespace mbdae
