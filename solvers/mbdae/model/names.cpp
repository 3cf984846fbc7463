// Names of unknowns and equations, as in docs/io_formats/matrices.md.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>
#include <sstream>

#include "mbdae/model/model.h"

namespace mbdae {

namespace {

// Groups of three unknowns or equations of a node.
enum Group { kPosition, kRotation, kMomentum, kMomentaMoment, kVelocity, kAngularVelocity };
/// `joint hand_l`, but not `joint joint 1`: the name of a thing with a label that is no constant says its kind.
std::string kind_and_name(const std::string& kind, const std::string& name) {
  return name.rfind(kind + " ", 0) == 0 ? name : kind + " " + name;
}

}  // namespace

std::string joint_title(const ElementData& joint) {
  return joint.id.name + " (" + joint.type->name + " " + std::to_string(joint.id.label) + ")";
}

Model::Place Model::place(int k) const {
  Place out;
  if (k >= reaction_start_) {
    std::size_t i = 0;
    while (i + 1 < constraints_.size() && constraints_[i + 1].constraint->first() <= k) ++i;
    out.component = k - constraints_[i].constraint->first();
    out.constraint = static_cast<int>(i);
    return out;
  }
  if (k >= scalar_start_) {
    out.scalar = k - scalar_start_;
    return out;
  }
  for (std::size_t i = 0; i < flexible_.size(); ++i) {
    const int own = k - flexible_[i].body->first_displacement();
    if (own < 0 || own >= 2 * flexible_[i].body->modes()) continue;
    out.component = own;
    out.flexible = static_cast<int>(i);
    return out;
  }
  std::size_t i = 0;
  while (i + 1 < slots_.size() && slots_[i + 1].first <= k) ++i;
  out.node = static_cast<int>(i);
  out.component = k - slots_[i].first;
  out.group = out.component / 3;
  if (slots_[i].modal && out.group >= kMomentum) out.group += kVelocity - kMomentum;
  return out;
}

std::string Model::unknown_name(int k) const {
  static constexpr std::array<const char*, 6> kLetters{"", "g", "b", "h", "v", "w"};
  const Place p = place(k);
  if (p.node >= 0) {
    return deck_.nodes[static_cast<std::size_t>(p.node)].id.name + "." + kLetters[static_cast<std::size_t>(p.group)] +
           "xyz"[p.component % 3];
  }
  if (p.flexible >= 0) {
    const FlexibleEntry& entry = flexible_[static_cast<std::size_t>(p.flexible)];
    const int m = entry.body->modes();
    return entry.data->id.name + (p.component < m ? ".a[" : ".b[") +
           std::to_string(entry.body->mode_number(p.component % m)) + "]";
  }
  if (p.scalar >= 0) {
    const ScalarEntry& entry = scalars_[static_cast<std::size_t>(p.scalar)];
    return entry.owner->name + entry.info.name;
  }
  return constraints_[static_cast<std::size_t>(p.constraint)].data->id.name + ".reaction[" +
         std::to_string(p.component + 1) + "]";
}

std::string Model::unknown_kind(int k) const {
  static constexpr std::array<const char*, 6> kKinds{"position",       "rotation", "momentum",
                                                     "momenta_moment", "velocity", "angular_velocity"};
  const Place p = place(k);
  if (p.scalar >= 0) return scalars_[static_cast<std::size_t>(p.scalar)].info.differential ? "state" : "algebraic";
  if (p.flexible >= 0) {
    return p.component < flexible_[static_cast<std::size_t>(p.flexible)].body->modes() ? "modal_displacement"
                                                                                       : "modal_velocity";
  }
  if (p.node >= 0) return kKinds[static_cast<std::size_t>(p.group)];
  const Constraint& constraint = *constraints_[static_cast<std::size_t>(p.constraint)].constraint;
  return constraint.plain_equation(p.component) ? "algebraic" : "reaction";
}

std::string Model::unknown_unit(int k) const {
  static constexpr std::array<const char*, 6> kUnits{"m", "rad", "kg m/s", "kg m^2/s", "m/s", "rad/s"};
  const Place p = place(k);
  if (p.node >= 0) return kUnits[static_cast<std::size_t>(p.group)];
  if (p.scalar >= 0) return scalars_[static_cast<std::size_t>(p.scalar)].info.unit;
  if (p.flexible >= 0) {
    return p.component < flexible_[static_cast<std::size_t>(p.flexible)].body->modes() ? "-" : "1/s";
  }
  return constraints_[static_cast<std::size_t>(p.constraint)].constraint->reaction_unit(p.component);
}

int Model::unknown_owner(int k) const {
  const Place p = place(k);
  if (p.scalar >= 0) return static_cast<int>(scalars_[static_cast<std::size_t>(p.scalar)].owner->label);
  if (p.flexible >= 0) return static_cast<int>(flexible_[static_cast<std::size_t>(p.flexible)].data->id.label);
  return static_cast<int>(p.node >= 0 ? deck_.nodes[static_cast<std::size_t>(p.node)].id.label
                                      : constraints_[static_cast<std::size_t>(p.constraint)].data->id.label);
}

// The equations of a node by groups: definitions and equilibrium.
int Model::equation_group(const Place& p) const {
  const NodeSlot& slot = slots_[static_cast<std::size_t>(p.node)];
  const int group = p.component / 3;
  if (slot.modal) return group < 2 ? 4 + group : group;
  return slot.dynamic ? group : group + 2;
}

std::string Model::equation_title(int k) const {
  static constexpr std::array<const char*, 6> kEquations{"momentum definition", "angular momentum definition",
                                                         "force equilibrium",   "moment equilibrium",
                                                         "velocity definition", "angular velocity definition"};
  const Place p = place(k);
  std::ostringstream out;
  if (p.node >= 0) {
    out << kEquations[static_cast<std::size_t>(equation_group(p))] << " of "
        << kind_and_name("node", deck_.nodes[static_cast<std::size_t>(p.node)].id.name) << " along "
        << "xyz"[p.component % 3];
    return out.str();
  }
  if (p.scalar >= 0) {
    const ScalarEntry& entry = scalars_[static_cast<std::size_t>(p.scalar)];
    out << entry.info.equation << " of " << entry.owner->name;
    return out.str();
  }
  if (p.flexible >= 0) {
    const FlexibleEntry& entry = flexible_[static_cast<std::size_t>(p.flexible)];
    const int m = entry.body->modes();
    out << (p.component < m ? "velocity definition" : "equilibrium") << " of mode "
        << entry.body->mode_number(p.component % m) << " of " << kind_and_name("joint", joint_title(*entry.data));
    return out.str();
  }
  const ConstraintEntry& entry = constraints_[static_cast<std::size_t>(p.constraint)];
  out << "constraint " << p.component + 1 << " of " << entry.constraint->size() << " of "
      << kind_and_name(entry.data->type->card == CardKind::genel ? "genel" : "joint", joint_title(*entry.data));
  return out.str();
}

std::string Model::equation_off(int k, double value) const {
  if (!std::isfinite(value)) return equation_title(k) + " has no finite value";
  std::ostringstream out;
  out.precision(3);
  out << equation_title(k) << " is off by " << value << " " << equation_unit(k);
  return out.str();
}

std::string Model::equation_unit(int k) const {
  static constexpr std::array<const char*, 6> kUnits{"kg m/s", "kg m^2/s", "N", "N m", "m/s", "rad/s"};
  const Place p = place(k);
  if (p.node >= 0) return kUnits[static_cast<std::size_t>(equation_group(p))];
  if (p.scalar >= 0) return "(its own unit)";
  if (p.flexible >= 0) return "(modal unit)";
  const Constraint& constraint = *constraints_[static_cast<std::size_t>(p.constraint)].constraint;
  const std::string unit = constraint.is_couple(p.component) ? "rad" : "m";
  return constraint.velocity_level(p.component) ? unit + "/s" : unit;
}

}  // namespace mbdae
