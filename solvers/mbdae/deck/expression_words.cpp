// The words and numbers of expressions: names of functions, literals.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <charconv>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <string>

#include "mbdae/deck/expression.h"

namespace mbdae::reading {
namespace {

constexpr std::array<FunctionInfo, 50> kFunctions = {{
    {"abs", Function::abs_, 1, 1},
    {"acos", Function::acos_, 1, 1},
    {"acosh", Function::acosh_, 1, 1},
    {"asin", Function::asin_, 1, 1},
    {"asinh", Function::asinh_, 1, 1},
    {"atan", Function::atan_, 1, 1},
    {"atan2", Function::atan2_, 2, 2},
    {"atanh", Function::atanh_, 1, 1},
    {"actan", Function::actan, 1, 1},
    {"actan2", Function::actan2, 2, 2},
    {"actanh", Function::actanh, 1, 1},
    {"ceil", Function::ceil_, 1, 1},
    {"copysign", Function::copysign_, 2, 2},
    {"cos", Function::cos_, 1, 1},
    {"cosh", Function::cosh_, 1, 1},
    {"ctan", Function::ctan, 1, 1},
    {"ctanh", Function::ctanh, 1, 1},
    {"exp", Function::exp_, 1, 1},
    {"floor", Function::floor_, 1, 1},
    {"log", Function::log_, 1, 1},
    {"log10", Function::log10_, 1, 1},
    {"max", Function::max_, 2, 2},
    {"min", Function::min_, 2, 2},
    {"par", Function::par, 1, 1},
    {"print", Function::print, 1, 1},
    {"ramp", Function::ramp, 1, 1},
    {"rand", Function::rand_, 0, 0},
    {"random", Function::random_, 0, 0},
    {"round", Function::round_, 1, 1},
    {"seed", Function::seed, 1, 1},
    {"sign", Function::sign, 1, 1},
    {"sin", Function::sin_, 1, 1},
    {"sinh", Function::sinh_, 1, 1},
    {"sprintf", Function::sprintf_, 2, 2},
    {"sqrt", Function::sqrt_, 1, 1},
    {"sramp", Function::sramp, 2, 2},
    {"step", Function::step, 1, 1},
    {"stop", Function::stop, 1, 2},
    {"tan", Function::tan_, 1, 1},
    {"tanh", Function::tanh_, 1, 1},
    {"in_ll", Function::in_ll, 3, 3},
    {"in_le", Function::in_le, 3, 3},
    {"in_el", Function::in_el, 3, 3},
    {"in_ee", Function::in_ee, 3, 3},
    {"bool", Function::cast_boolean, 1, 1},
    {"integer", Function::cast_integer, 1, 1},
    {"real", Function::cast_real, 1, 1},
    {"string", Function::cast_string, 1, 1},
    {"integer_eval", Function::cast_integer, 1, 1},
    {"real_eval", Function::cast_real, 1, 1},
}};

}  // namespace

std::span<const FunctionInfo> functions() { return kFunctions; }

const FunctionInfo* find_function(std::string_view name) {
  for (const FunctionInfo& info : kFunctions) {
    if (name == info.name) return &info;
  }
  return nullptr;
}

std::string with_plain_exponent(std::string_view number) {
  std::string text(number);
  if (const std::size_t d = text.find_first_of("dD"); d != std::string::npos) text[d] = 'e';
  return text;
}

bool read_number(const Token& token, Number* number) {
  std::string_view text = token.text;
  std::string plain;
  if (token.kind == TokenKind::real && text.find_first_of("dD") != std::string_view::npos) {
    plain = with_plain_exponent(text);
    text = plain;
  }
  const char* const begin = text.data();
  const char* const end = begin + text.size();
  if (token.kind == TokenKind::integer) {
    number->type = Type::integer;
    return std::from_chars(begin, end, number->integer).ec == std::errc() && number->integer <= INT_MAX;
  }
  number->type = Type::real;
  return token.kind == TokenKind::real && std::from_chars(begin, end, number->real).ec == std::errc();
}

}  // namespace mbdae::reading
