// The functions of expressions: what they are worth, and which of their branches holds.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "mbdae/deck/evaluator.h"

namespace mbdae::reading::evaluation {

/// Which branch of a function with branches holds; 0 of the smooth ones.
inline std::uint64_t branch(Function id, double x, double y, double z) {
  const auto side = [](double a) -> std::uint64_t { return a < 0.0 ? 1U : a == 0.0 ? 2U : 3U; };
  const auto whole = [](double a) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::clamp(a, -1e15, 1e15)));
  };
  switch (id) {
    case Function::abs_:
    case Function::par:
    case Function::ramp:
    case Function::sign:
    case Function::step:
      return side(x);
    case Function::copysign_:
      return side(x) + 3 * side(y);
    case Function::max_:
    case Function::min_:
      return side(x - y);
    case Function::sramp:
      return side(x) + 3 * side(x - y);
    case Function::in_ll:
    case Function::in_le:
    case Function::in_el:
    case Function::in_ee:
      return side(y - x) + 3 * side(z - y);
    case Function::ceil_:
      return whole(std::ceil(x));
    case Function::floor_:
      return whole(std::floor(x));
    case Function::round_:
      return whole(std::nearbyint(x));
    default:
      return 0;
  }
}

inline bool has_branches(const ExpressionNode& node) {
  if (node.op >= Op::greater && node.op <= Op::not_equal) return true;
  if (node.op != Op::call) return false;
  // 1, 2, 3 and 3, 1, 2 are on different branches of every function that has some
  const auto id = static_cast<Function>(node.index);
  return branch(id, 1.5, 2.5, 3.5) != 0 || id == Function::cast_integer;
}

template <class Real>
Value<Real> Evaluator<Real>::random(const ExpressionNode& node, Function id, const V* argument) {
  if (state == nullptr) fail(node, "a random number in a run-time expression");
  if (id == Function::seed) {
    state->random_state = static_cast<std::uint32_t>(integer(node, *argument)) | 1U;
    return V::from_integer(0);
  }
  // Park and Miller's minimal standard generator: the same deck gives the same numbers everywhere.
  state->random_state = static_cast<std::uint32_t>(std::uint64_t{state->random_state} * 48271U % 2147483647U);
  if (id == Function::rand_) return V::from_integer(state->random_state);
  return constant(state->random_state / 2147483647.0);
}

template <class Real>
Value<Real> Evaluator<Real>::formatted(const ExpressionNode& node, const V& format, const V& argument) const {
  if (format.type != Type::string) fail(node, "sprintf wants a format string first");
  const Value<double> value{argument.type, argument.integer, value_of(argument.real), argument.text};
  std::string out, problem;
  if (!format_text(format.text, value, &out, &problem)) fail(node, problem);
  return V::from_text(std::move(out));
}

template <class Real>
Value<Real> Evaluator<Real>::call(const ExpressionNode& node) {
  V arguments[3];
  int count = 0;
  for (int child = node.first; child >= 0; child = expression_.nodes[static_cast<std::size_t>(child)].sibling) {
    arguments[count++] = evaluate(child);
  }
  const auto id = static_cast<Function>(node.index);
  switch (id) {
    case Function::cast_boolean:
      return converted(node, arguments[0], Type::boolean, true);
    case Function::cast_integer: {
      V whole = converted(node, arguments[0], Type::integer, true);
      piece = mixed(piece, static_cast<std::uint64_t>(whole.integer));
      return whole;
    }
    case Function::cast_real:
      return converted(node, arguments[0], Type::real, true);
    case Function::cast_string:
      return converted(node, arguments[0], Type::string, true);
    case Function::print:
      return arguments[0];
    case Function::rand_:
    case Function::random_:
    case Function::seed:
      return random(node, id, arguments);
    case Function::sprintf_:
      return formatted(node, arguments[0], arguments[1]);
    case Function::stop:
      if (truth(node, arguments[0])) fail(node, "the deck asks to stop here");
      return V::from_bool(false);
    default:
      break;
  }
  using std::acos, std::acosh, std::asin, std::asinh, std::atan, std::atan2, std::atanh, std::copysign, std::cos,
      std::cosh, std::exp, std::fabs, std::log, std::log10, std::sin, std::sinh, std::sqrt, std::tan, std::tanh;
  const Real x = count > 0 ? real(node, arguments[0]) : Real{};
  const Real y = count > 1 ? real(node, arguments[1]) : Real{};
  const Real z = count > 2 ? real(node, arguments[2]) : Real{};
  const double xv = value_of(x), yv = value_of(y), zv = value_of(z);
  Real zero{}, one{};
  set_real(0.0, &zero);
  set_real(1.0, &one);
  const auto done = [&](const char* what, const Real& result) { return checked_real(node, what, result); };
  if constexpr (!std::is_same_v<Real, double>) piece = mixed(piece, branch(id, xv, yv, zv));
  switch (id) {
    case Function::abs_:
      return done("abs", fabs(x));
    case Function::acos_:
      return done("acos", acos(x));
    case Function::acosh_:
      return done("acosh", acosh(x));
    case Function::asin_:
      return done("asin", asin(x));
    case Function::asinh_:
      return done("asinh", asinh(x));
    case Function::atan_:
      return done("atan", atan(x));
    case Function::atan2_:
      return done("atan2", atan2(x, y));
    case Function::atanh_:
      return done("atanh", atanh(x));
    case Function::actan:
      return done("actan", atan2(one, x));
    case Function::actan2:
      return done("actan2", atan2(y, x));
    case Function::actanh:
      return done("actanh", atanh(one / x));
    case Function::ceil_:
      return constant(std::ceil(xv));
    case Function::copysign_:
      return done("copysign", copysign(x, y));
    case Function::cos_:
      return done("cos", cos(x));
    case Function::cosh_:
      return done("cosh", cosh(x));
    case Function::ctan:
      return done("ctan", one / tan(x));
    case Function::ctanh:
      return done("ctanh", one / tanh(x));
    case Function::exp_:
      return done("exp", exp(x));
    case Function::floor_:
      return constant(std::floor(xv));
    case Function::log_:
      return done("log", log(x));
    case Function::log10_:
      return done("log10", log10(x));
    case Function::max_:
    case Function::min_: {
      const bool first = (side_of(x - y) >= 0) == (id == Function::max_);
      return V::from_real(first ? x : y);
    }
    case Function::par:
      return done("par", side_of(x) > 0 ? x * x : zero);
    case Function::ramp:
      return done("ramp", side_of(x) > 0 ? x : zero);
    case Function::sramp:
      return done("sramp", side_of(x) <= 0 ? zero : side_of(x - y) >= 0 ? y : x);
    case Function::step:
      return constant(xv < 0.0 ? 0.0 : xv > 0.0 ? 1.0 : 0.5);
    case Function::round_:
      return constant(std::nearbyint(xv));  // halves to the even neighbour
    case Function::sign:
      return V::from_integer(xv > 0.0 ? 1 : xv < 0.0 ? -1 : 0);
    case Function::sin_:
      return done("sin", sin(x));
    case Function::sinh_:
      return done("sinh", sinh(x));
    case Function::sqrt_:
      return done("sqrt", sqrt(x));
    case Function::tan_:
      return done("tan", tan(x));
    case Function::tanh_:
      return done("tanh", tanh(x));
    case Function::in_ll:
      return constant(xv < yv && yv < zv ? 1.0 : 0.0);
    case Function::in_le:
      return constant(xv < yv && yv <= zv ? 1.0 : 0.0);
    case Function::in_el:
      return constant(xv <= yv && yv < zv ? 1.0 : 0.0);
    case Function::in_ee:
      return constant(xv <= yv && yv <= zv ? 1.0 : 0.0);
    default:
      fail(node, "a function without a rule");
  }
}

}  // namespace mbdae::reading::evaluation
