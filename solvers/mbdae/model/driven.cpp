// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/model/driven.h"

#include <utility>

namespace mbdae {

namespace {

/// What both kinds share; Base is Element or Constraint.
template <class Base>
class Driven : public Base {
 public:
  Driven(std::unique_ptr<Base> element, DrivePtr drive) : element_(std::move(element)), drive_(std::move(drive)) {}

  void accept(const State& state) override { element_->accept(state); }
  SignalValue signal(int k, const State& state) const override { return element_->signal(k, state); }
  int rank() const override { return element_->rank(); }
  std::vector<DriveInput> drive_inputs(const State& state) const override {
    return there(state) ? element_->drive_inputs(state) : std::vector<DriveInput>{};
  }
  std::string defect(const State& state) const override {
    return there(state) ? element_->defect(state) : std::string();
  }
  std::string defect_under_load(const State& state) const override {
    return there(state) ? element_->defect_under_load(state) : std::string();
  }

 protected:
  bool there(const State& state) const { return drive_->value(state.t) != 0.0; }

  std::unique_ptr<Base> element_;
  DrivePtr drive_;
};

class DrivenLoad final : public Driven<Element> {
 public:
  using Driven::Driven;
  void assemble(const State& state, Equations& eq, bool tangent) const override {
    if (there(state)) element_->assemble(state, eq, tangent);
  }
};

class DrivenConstraint final : public Driven<Constraint> {
 public:
  DrivenConstraint(std::unique_ptr<Constraint> element, DrivePtr drive)
      : Driven<Constraint>(std::move(element), std::move(drive)) {
    first_ = element_->first();
    size_ = element_->size();
  }
  void assemble(const State& state, Equations& eq, bool tangent) const override {
    if (there(state)) return element_->assemble(state, eq, tangent);
    eq.g.segment(first_, size_) += state.y.segment(first_, size_);
    if (tangent) eq.g_y.diagonal().segment(first_, size_).array() += 1.0;
  }
  void assemble_reduced(const State& state, Equations& eq, bool tangent) const override {
    if (there(state)) element_->assemble_reduced(state, eq, tangent);
  }
  void rates(const State& state, ConstraintRates& out, bool tangent) const override {
    if (there(state)) element_->rates(state, out, tangent);
  }
  bool velocity_level(int k) const override { return element_->velocity_level(k); }
  bool is_couple(int k) const override { return element_->is_couple(k); }
  bool plain_equation(int k) const override { return element_->plain_equation(k); }
  std::string reaction_unit(int k) const override { return element_->reaction_unit(k); }
  void set_reference(const State& state) override { element_->set_reference(state); }
  void carry_reference(const State& state) override { element_->carry_reference(state); }
  void follow_free_rotations(bool follow) override { element_->follow_free_rotations(follow); }
};

}  // namespace

std::unique_ptr<Element> driven(std::unique_ptr<Element> element, const DrivePtr& drive) {
  if (!drive) return element;
  if (auto* constraint = dynamic_cast<Constraint*>(element.get())) {
    element.release();
    return std::make_unique<DrivenConstraint>(std::unique_ptr<Constraint>(constraint), drive);
  }
  return std::make_unique<DrivenLoad>(std::move(element), drive);
}

}  // namespace mbdae
