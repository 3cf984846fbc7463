// Names of unknowns and equations, as in docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <sstream>

#include "mbdae/model/model.h"

namespace mbdae {

std::string joint_title(const ElementData& joint) {
  return joint.id.name + " (" + joint.type->name + " " + std::to_string(joint.id.label) + ")";
}

Model::Place Model::place(int k) const {
  if (k >= scalar_start_ && k < reaction_start_) return {-1, 0, -1, k - scalar_start_};
  if (k < reaction_start_) {
    std::size_t i = 0;
    while (i + 1 < slots_.size() && slots_[i + 1].first <= k) ++i;
    return {static_cast<int>(i), k - slots_[i].first, -1, -1};
  }
  std::size_t i = 0;
  while (i + 1 < constraints_.size() && constraints_[i + 1].constraint->first() <= k) ++i;
  return {-1, k - constraints_[i].constraint->first(), static_cast<int>(i), -1};
}

std::string Model::unknown_name(int k) const {
  static constexpr std::array<const char*, 12> kSuffix{"x",  "y",  "z",  "gx", "gy", "gz",
                                                       "bx", "by", "bz", "hx", "hy", "hz"};
  const Place p = place(k);
  if (p.node >= 0) {
    return deck_.nodes[static_cast<std::size_t>(p.node)].id.name + "." + kSuffix[static_cast<std::size_t>(p.component)];
  }
  if (p.scalar >= 0) {
    const ScalarEntry& entry = scalars_[static_cast<std::size_t>(p.scalar)];
    return entry.owner->name + entry.info.name;
  }
  return constraints_[static_cast<std::size_t>(p.constraint)].data->id.name + ".reaction[" +
         std::to_string(p.component + 1) + "]";
}

std::string Model::unknown_kind(int k) const {
  static constexpr std::array<const char*, 4> kKinds{"position", "rotation", "momentum", "momenta_moment"};
  const Place p = place(k);
  const int group = p.component / 3;
  if (p.scalar >= 0) return scalars_[static_cast<std::size_t>(p.scalar)].info.differential ? "state" : "algebraic";
  if (p.node >= 0) return kKinds[static_cast<std::size_t>(group)];
  const Constraint& constraint = *constraints_[static_cast<std::size_t>(p.constraint)].constraint;
  return constraint.plain_equation(p.component) ? "algebraic" : "reaction";
}

std::string Model::unknown_unit(int k) const {
  static constexpr std::array<const char*, 4> kUnits{"m", "rad", "kg m/s", "kg m^2/s"};
  const Place p = place(k);
  const int group = p.component / 3;
  if (p.node >= 0) return kUnits[static_cast<std::size_t>(group)];
  if (p.scalar >= 0) return scalars_[static_cast<std::size_t>(p.scalar)].info.unit;
  return constraints_[static_cast<std::size_t>(p.constraint)].constraint->reaction_unit(p.component);
}

int Model::unknown_owner(int k) const {
  const Place p = place(k);
  if (p.scalar >= 0) return static_cast<int>(scalars_[static_cast<std::size_t>(p.scalar)].owner->label);
  return static_cast<int>(p.node >= 0 ? deck_.nodes[static_cast<std::size_t>(p.node)].id.label
                                      : constraints_[static_cast<std::size_t>(p.constraint)].data->id.label);
}

std::string Model::equation_title(int k) const {
  static constexpr std::array<const char*, 4> kEquations{"momentum definition", "momenta moment definition",
                                                         "force equilibrium", "moment equilibrium"};
  const Place p = place(k);
  std::ostringstream out;
  if (p.node >= 0) {
    const NodeSlot& slot = slots_[static_cast<std::size_t>(p.node)];
    const int group = p.component / 3 + (slot.dynamic ? 0 : 2);
    out << kEquations[static_cast<std::size_t>(group)] << " of node "
        << deck_.nodes[static_cast<std::size_t>(p.node)].id.name << " along "
        << "xyz"[p.component % 3];
    return out.str();
  }
  if (p.scalar >= 0) {
    const ScalarEntry& entry = scalars_[static_cast<std::size_t>(p.scalar)];
    out << entry.info.equation << " of " << entry.owner->name;
    return out.str();
  }
  const ConstraintEntry& entry = constraints_[static_cast<std::size_t>(p.constraint)];
  out << "constraint " << p.component + 1 << " of " << entry.constraint->size()
      << (entry.data->type->card == CardKind::genel ? " of genel " : " of joint ") << joint_title(*entry.data);
  return out.str();
}

std::string Model::equation_unit(int k) const {
  static constexpr std::array<const char*, 4> kUnits{"kg m/s", "kg m^2/s", "N", "N m"};
  const Place p = place(k);
  if (p.node >= 0) {
    const NodeSlot& slot = slots_[static_cast<std::size_t>(p.node)];
    const int group = p.component / 3 + (slot.dynamic ? 0 : 2);
    return kUnits[static_cast<std::size_t>(group)];
  }
  if (p.scalar >= 0) return "(its own unit)";
  const Constraint& constraint = *constraints_[static_cast<std::size_t>(p.constraint)].constraint;
  const std::string unit = constraint.is_couple(p.component) ? "rad" : "m";
  return constraint.velocity_level(p.component) ? unit + "/s" : unit;
}

}  // namespace mbdae
