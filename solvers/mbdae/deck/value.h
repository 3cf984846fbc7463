// Typed values of the expression language and the variables that hold them.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mbdae/drive/drive.h"

namespace mbdae::reading {

enum class Type : std::uint8_t { boolean, integer, real, string };

const char* type_name(Type type);
/// `found a real`, `found an integer`
std::string found_type(Type type);

/// A value of the language; Real is double while a deck is read, Jet in run-time expressions.
/// Booleans and integers live in `integer` (32-bit range), so that 1/3 is an integer division.
template <class Real>
struct Value {
  Type type = Type::integer;
  std::int64_t integer = 0;
  Real real{};
  std::string text;

  static Value from_bool(bool b) { return {Type::boolean, b ? 1 : 0, Real{}, {}}; }
  static Value from_integer(std::int64_t i) { return {Type::integer, i, Real{}, {}}; }
  static Value from_real(const Real& r) { return {Type::real, 0, r, {}}; }
  static Value from_text(std::string s) { return {Type::string, 0, Real{}, std::move(s)}; }
};

/// The value of a plain number.
struct Number {
  Type type = Type::integer;
  std::int64_t integer = 0;
  double real = 0.0;
};

/// A named value. Its type is fixed by its declaration.
struct Variable {
  std::string name;
  Value<double> value;
  bool constant = false;
  bool has_value = false;
  bool broken = false;  ///< its declaration had an error, reported already
};

/// All variables of a deck, the language's constants included. Names are case sensitive.
class Symbols {
 public:
  Symbols();

  std::optional<std::uint32_t> find(std::string_view name) const;
  /// Adds a variable that is not there yet.
  std::uint32_t add(Variable variable);
  Variable& operator[](std::uint32_t index) { return variables_[index]; }
  const Variable& operator[](std::uint32_t index) const { return variables_[index]; }
  std::size_t size() const { return variables_.size(); }

  bool knows_time = false;  ///< `Time` is 0 while the deck is read (where the initial time is)

 private:
  /// Where the name is in `places_`, or where it belongs.
  std::size_t place_of(std::string_view name) const;
  void enter(std::uint32_t index);
  void grow();

  std::vector<Variable> variables_;
  // A hash table with open addressing of indices plus one, 0 where nobody is; its size is a power of two, and at least
  // half of it is free. A deck declares hundreds of variables: a node of a std::unordered_map for each would cost more
  // than reading it.
  std::vector<std::uint32_t> places_;
};

}  // namespace mbdae::reading
