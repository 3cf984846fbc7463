// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/model.h"

#include <algorithm>
#include <stdexcept>

#include "mbdae/model/driven.h"

namespace mbdae {

Model::Model(const Deck& deck) : deck_(deck) {
  slots_.reserve(deck.nodes.size());
  for (std::size_t i = 0; i < deck.nodes.size(); ++i) {
    NodeSlot slot;
    slot.index = static_cast<int>(i);
    slot.dynamic = deck.nodes[i].kind == NodeKind::dynamic_node && !deck.control.static_model;
    slot.modal = deck.nodes[i].kind == NodeKind::modal_node;
    if (slot.modal && deck.control.static_model) {
      throw std::invalid_argument("node " + deck.nodes[i].id.name +
                                  " is a modal node, which `model: static;` has no place for: make the deck dynamic");
    }
    slot.first = size_;
    slot.force = slot.has_rates() ? size_ + 6 : size_;
    size_ += slot.has_rates() ? 12 : 6;
    slots_.push_back(slot);
    motions_.push_back({motion_count_, 6, slot.first, slot.force});
    motion_count_ += 6;
  }
  number_joints();
  std::vector<int> scalar_of_joint, scalar_of_genel;
  number_scalars(scalar_of_joint, scalar_of_genel);

  std::vector<std::vector<const BodyData*>> bodies(deck.nodes.size());
  for (const BodyData& body : deck.bodies) {
    if (!slots_[body.node].has_rates() && !deck.control.static_model) {
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
      Numbering numbering{slots_, size_, -1, abstract_slots_, -1, own_};
      if (list == &deck.joints) {
        numbering.scalar = scalar_of_joint[i];
        numbering.own = own_[i].first;
      }
      if (list == &deck.genels) numbering.scalar = scalar_of_genel[i];
      std::unique_ptr<Element> element = driven(data.type->make(data.data, numbering), data.driver);
      if (list == &deck.joints) joints_.push_back(element.get());
      if (const Flexible* body = element->flexible()) flexible_.push_back({&data, body});
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
  if (scalar_count() > 0 || !flexible_.empty()) order_for_files();
  std::stable_sort(loads_.begin(), loads_.end(), [](const LoadEntry& one, const LoadEntry& other) {
    return one.element->rank() < other.element->rank();
  });
}

// Displacements and velocities that joints own stand after the nodes.
void Model::number_joints() {
  own_start_ = size_;
  own_.resize(deck_.joints.size());
  for (std::size_t i = 0; i < own_.size(); ++i) {
    const ElementData& joint = deck_.joints[i];
    if (joint.type->coordinates == nullptr) continue;
    if (deck_.control.static_model) {
      throw std::invalid_argument("joint " + joint_title(joint) +
                                  " cannot be part of a deck with `model: static;`: make the deck dynamic");
    }
    const int modes = joint.type->coordinates(joint.data);
    own_[i] = {size_, modes};
    motions_.push_back({motion_count_, modes, size_, size_ + modes});
    motion_count_ += modes;
    size_ += 2 * modes;
  }
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
  for (const FlexibleEntry& entry : flexible_) entry.body->initialise_modes(state.y);
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
    if (slots_[i].modal) state.y.segment<6>(slots_[i].force) << state.nodes[i].v, state.nodes[i].w;
  }
}

void Model::set_modal_rates(State& state, const Eigen::VectorXd& accelerations) const {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (slots_[i].modal) state.ydot.segment<6>(slots_[i].force) = accelerations.segment<6>(motions_[i].motion);
  }
  for (std::size_t i = slots_.size(); i < motions_.size(); ++i) {
    const MotionGroup& group = motions_[i];
    state.ydot.segment(group.pose, group.count) = state.y.segment(group.force, group.count);
    state.ydot.segment(group.force, group.count) = accelerations.segment(group.motion, group.count);
  }
}

Eigen::MatrixXd Model::mass_matrix(const State& state) const {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(motion_count_, motion_count_);
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (!slots_[i].has_rates()) continue;
    const int row = motions_[i].motion;
    M.block<6, 6>(row, row) = inertias_[i].mass_matrix(state.nodes[i]);
  }
  for (std::size_t i = 0; i < flexible_.size(); ++i) {
    const MotionGroup& own = motions_[slots_.size() + i];
    const int node = flexible_[i].body->carrier().index;
    const Eigen::MatrixXd part = flexible_[i].body->mass_matrix(state);
    const int m = own.count;
    M.block(own.motion, own.motion, m, m) = part.bottomRightCorner(m, m);
    if (node < 0) continue;
    const int rigid = motions_[static_cast<std::size_t>(node)].motion;
    M.block<6, 6>(rigid, rigid) += part.topLeftCorner<6, 6>();
    M.block(rigid, own.motion, 6, m) = part.topRightCorner(6, m);
    M.block(own.motion, rigid, m, 6) = part.bottomLeftCorner(m, 6);
  }
  return M;
}

Eigen::VectorXd Model::velocity_terms(const State& state) const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(motion_count_);
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (slots_[i].has_rates()) out.segment<6>(motions_[i].motion) = inertias_[i].velocity_terms(state.nodes[i]);
  }
  for (std::size_t i = 0; i < flexible_.size(); ++i) {
    const MotionGroup& own = motions_[slots_.size() + i];
    const int node = flexible_[i].body->carrier().index;
    const Eigen::VectorXd part = flexible_[i].body->velocity_terms(state);
    out.segment(own.motion, own.count) = part.tail(own.count);
    if (node >= 0) out.segment<6>(motions_[static_cast<std::size_t>(node)].motion) += part.head<6>();
  }
  return out;
}

// Definitions of the modal velocities and inertia forces of the flexible bodies.
void Model::add_flexible(const State& state, Equations& eq, bool tangent) const {
  for (const FlexibleEntry& entry : flexible_) {
    const Flexible& body = *entry.body;
    const NodeSlot& node = body.carrier();
    const int m = body.modes(), a = body.first_displacement(), b = a + m, rigid = node.index < 0 ? 0 : 6;
    eq.g.segment(a, m) += state.ydot.segment(a, m) - state.y.segment(b, m);
    Eigen::VectorXd acceleration(rigid + m);
    acceleration.tail(m) = state.ydot.segment(b, m);
    if (rigid > 0) acceleration.head<6>() = state.ydot.segment<6>(node.force);
    const Eigen::MatrixXd M = body.mass_matrix(state);
    const Eigen::VectorXd force = M * acceleration + body.velocity_terms(state);
    eq.g.segment(b, m) += force.tail(m);
    if (rigid > 0) eq.g.segment<6>(node.force) += force.head<6>();
    if (!tangent) continue;
    eq.g_ydot.block(a, a, m, m).diagonal().array() += 1.0;
    eq.g_y.block(a, b, m, m).diagonal().array() -= 1.0;
    eq.g_ydot.block(b, b, m, m) += M.bottomRightCorner(m, m);
    if (rigid == 0) continue;
    const int v = node.force, phi = node.first + 3;
    eq.g_ydot.block<6, 6>(v, v) += M.topLeftCorner<6, 6>();
    eq.g_ydot.block(v, b, 6, m) += M.topRightCorner(6, m);
    eq.g_ydot.block(b, v, m, 6) += M.bottomLeftCorner(m, 6);
    const InertiaTangent by = body.inertia_tangent(state, acceleration);
    const auto add = [&](int column, const Eigen::MatrixXd& columns) {
      eq.g_y.block(v, column, 6, columns.cols()) += columns.topRows<6>();
      eq.g_y.block(b, column, m, columns.cols()) += columns.bottomRows(m);
    };
    add(phi, by.by_phi);
    add(v + 3, by.by_w);
    add(a, by.by_a);
    add(b, by.by_b);
  }
}

void Model::set_reference(const State& state) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->set_reference(state);
}

void Model::carry_reference(const State& state) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->carry_reference(state);
}

void Model::follow_free_rotations(bool follow) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->follow_free_rotations(follow);
}

void Model::accept(const State& state) {
  for (ConstraintEntry& entry : constraints_) entry.constraint->accept(state);
}

bool Model::switch_modes(const State& state, double still) {
  bool switched = false;
  for (ConstraintEntry& entry : constraints_) switched |= entry.constraint->switch_mode(state, still);
  return switched;
}

void Model::assemble(const State& state, Equations& eq, bool tangent) const {
  eq.clear(size_, tangent);
  for (const NodeInertia& inertia : inertias_) inertia.assemble(state, eq, tangent);
  add_flexible(state, eq, tangent);
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
  if (!flexible_.empty()) {
    const Vec3 gravity = deck_.gravity ? deck_.gravity->at(state.t) : Vec3(Vec3::Zero());
    for (const FlexibleEntry& entry : flexible_) entry.body->assemble_loads(state, gravity, eq, tangent);
  }
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
