// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/value.h"

#include <array>
#include <cfloat>
#include <climits>
#include <numbers>

namespace mbdae::reading {
namespace {

struct RealConstant {
  const char* name;
  double value;
};

// Exact by definition: 1 in = 0.0254 m, 1 lb = 0.45359237 kg, standard gravity 9.80665 m/s^2 (NIST SP 811, appendix B).
constexpr double kInch = 0.0254;                      // m
constexpr double kFoot = 12.0 * kInch;                // m
constexpr double kPound = 0.45359237;                 // kg
constexpr double kPoundForce = kPound * 9.80665;      // N
constexpr double kSlug = kPoundForce / kFoot;         // kg
constexpr double kDegree = std::numbers::pi / 180.0;  // rad

constexpr std::array<RealConstant, 18> kReals = {{
    {"pi", std::numbers::pi},
    {"e", std::numbers::e},
    {"deg2rad", kDegree},
    {"rad2deg", 1.0 / kDegree},
    {"in2m", kInch},
    {"m2in", 1.0 / kInch},
    {"in2mm", 1000.0 * kInch},
    {"mm2in", 0.001 / kInch},
    {"ft2m", kFoot},
    {"m2ft", 1.0 / kFoot},
    {"lb2kg", kPound},
    {"kg2lb", 1.0 / kPound},
    {"lb2N", kPoundForce},
    {"N2lb", 1.0 / kPoundForce},
    {"slug2kg", kSlug},
    {"kg2slug", 1.0 / kSlug},
    {"REAL_MAX", DBL_MAX},
    {"REAL_MIN", DBL_MIN},
}};

}  // namespace

std::string found_type(Type type) {
  return std::string(type == Type::integer ? "found an " : "found a ") + type_name(type);
}

const char* type_name(Type type) {
  switch (type) {
    case Type::boolean:
      return "bool";
    case Type::integer:
      return "integer";
    case Type::real:
      return "real";
    default:
      return "string";
  }
}

Symbols::Symbols() : places_(1024, 0) {
  variables_.reserve(256);
  for (const RealConstant& constant : kReals) {
    add({constant.name, Value<double>::from_real(constant.value), true, true, false});
  }
  add({"TRUE", Value<double>::from_bool(true), true, true, false});
  add({"FALSE", Value<double>::from_bool(false), true, true, false});
  add({"INT_MAX", Value<double>::from_integer(INT_MAX), true, true, false});
  add({"INT_MIN", Value<double>::from_integer(INT_MIN), true, true, false});
  add({"RAND_MAX", Value<double>::from_integer(INT_MAX), true, true, false});
}

std::optional<std::uint32_t> Symbols::find(std::string_view name) const {
  const std::uint32_t occupant = places_[place_of(name)];
  if (occupant == 0) return std::nullopt;
  return occupant - 1;
}

std::uint32_t Symbols::add(Variable variable) {
  const auto index = static_cast<std::uint32_t>(variables_.size());
  variables_.push_back(std::move(variable));
  if (2 * variables_.size() > places_.size()) {
    grow();
  } else {
    enter(index);
  }
  return index;
}

std::size_t Symbols::place_of(std::string_view name) const {
  const std::size_t mask = places_.size() - 1;
  std::size_t place = std::hash<std::string_view>{}(name)&mask;
  while (places_[place] != 0 && variables_[places_[place] - 1].name != name) place = (place + 1) & mask;
  return place;
}

void Symbols::enter(std::uint32_t index) {
  std::uint32_t& place = places_[place_of(variables_[index].name)];
  if (place == 0) place = index + 1;  // of two variables with one name, which recovery after errors may make, the first
}

void Symbols::grow() {
  places_.assign(2 * places_.size(), 0);
  for (std::uint32_t i = 0; i < variables_.size(); ++i) enter(i);
}

}  // namespace mbdae::reading
