// Scalars of a model: abstract nodes and what elements own beside reactions; the signals that drives read.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <stdexcept>

#include "mbdae/model/model.h"

namespace mbdae {

void Model::number_scalars(std::vector<int>& scalar_of_joint, std::vector<int>& scalar_of_genel) {
  scalar_start_ = size_;
  for (const AbstractNodeData& node : deck_.abstract_nodes) {
    abstract_slots_.push_back({size_++, node.differential});
    scalars_.push_back({&node.id, {".x", "-", "equation", node.differential}});
  }
  const auto number = [&](const std::vector<ElementData>& list, std::vector<int>& out) {
    for (const ElementData& data : list) {
      const int count = data.type->scalars != nullptr ? data.type->scalars(data.data) : 0;
      out.push_back(count > 0 ? size_ : -1);
      size_ += count;
      scalars_.resize(scalars_.size() + static_cast<std::size_t>(count));
    }
  };
  number(deck_.joints, scalar_of_joint);
  number(deck_.genels, scalar_of_genel);
  reaction_start_ = size_;
  if (deck_.control.static_model && scalar_count() > 0) {
    throw std::invalid_argument(
        "abstract nodes, friction and other elements with states cannot be part of a deck with `model: static;`: make "
        "the deck dynamic");
  }
}

void Model::order_for_files() {
  for (int k = 0; k < own_start_; ++k) file_order_.push_back(k);
  for (const ScalarSlot& node : abstract_slots_) file_order_.push_back(node.first);
  // elements in deck order, joints before genels; both lists of entries keep that order
  std::size_t constraint = 0;
  int scalar = scalar_start_ + static_cast<int>(abstract_slots_.size());
  for (const std::vector<ElementData>* list : {&deck_.joints, &deck_.genels}) {
    for (const ElementData& data : *list) {
      const int scalars = data.type->scalars != nullptr ? data.type->scalars(data.data) : 0;
      const Constraint* reactions = nullptr;
      if (constraint < constraints_.size() && constraints_[constraint].data == &data) {
        reactions = constraints_[constraint++].constraint.get();
      }
      const auto add_scalars = [&] {
        for (int k = 0; k < scalars; ++k) file_order_.push_back(scalar + k);
      };
      const bool reactions_first = reactions != nullptr && reactions->reactions_first();
      if (const Flexible* body = reactions != nullptr ? reactions->flexible() : nullptr; body != nullptr) {
        for (int k = 0; k < 2 * body->modes(); ++k) file_order_.push_back(body->first_displacement() + k);
      }
      if (!reactions_first) add_scalars();
      for (int k = 0; reactions != nullptr && k < reactions->size(); ++k) file_order_.push_back(reactions->first() + k);
      if (reactions_first) add_scalars();
      scalar += scalars;
    }
  }
}

namespace {

SignalValue node_signal(const NodeSlot& slot, const NodeMotion& node, int quantity) {
  const int i = quantity % 3, x = slot.first + i, g = slot.first + 3;
  SignalValue out;
  switch (static_cast<NodeSignal>(quantity - i)) {
    case NodeSignal::position:
      out.value = node.x(i);
      out.rate = node.v(i);
      out.gradient.push_back({x, 1.0, 0.0});
      break;
    case NodeSignal::velocity:
      out.value = node.v(i);
      out.gradient.push_back({x, 0.0, 1.0});
      break;
    case NodeSignal::angular_velocity:
      out.value = node.w(i);
      out.gradient.push_back({g + i, 0.0, 1.0});
      break;
    case NodeSignal::rotation_vector: {
      const Vec3 phi = rotation_log(node.R), by_phi = rotation_gamma_inverse(phi).row(i);
      out.value = phi(i);
      out.rate = by_phi.dot(node.w);
      for (int j = 0; j < 3; ++j) out.gradient.push_back({g + j, by_phi(j), 0.0});
      break;
    }
  }
  return out;
}

}  // namespace

void Model::refresh_signals(const State& state) const {
  for (const auto& signal : deck_.signals) {
    switch (signal->source) {
      case Signal::Source::node:
        signal->now = node_signal(slots_[signal->index], state.nodes[signal->index], signal->quantity);
        break;
      case Signal::Source::abstract_node: {
        const int k = abstract_slots_[signal->index].first;
        signal->now = {};
        signal->now.value = signal->quantity == 0 ? state.y(k) : state.ydot(k);
        if (signal->quantity == 0) signal->now.rate = state.ydot(k);
        signal->now.gradient.push_back({k, signal->quantity == 0 ? 1.0 : 0.0, signal->quantity == 0 ? 0.0 : 1.0});
        break;
      }
      case Signal::Source::joint:
        signal->now = joints_[signal->index]->signal(signal->quantity, state);
        break;
    }
  }
}

std::vector<Element*> Model::with_modes() const {
  std::vector<Element*> out;
  for (const ConstraintEntry& entry : constraints_) {
    if (entry.constraint->has_modes()) out.push_back(entry.constraint.get());
  }
  return out;
}

}  // namespace mbdae
