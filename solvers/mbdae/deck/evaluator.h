// The evaluation of expressions, with doubles or with jets. Only evaluate.cpp needs to know it.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <climits>
#include <cmath>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "mbdae/deck/diagnostic.h"
#include "mbdae/deck/evaluate.h"
#include "mbdae/deck/format_text.h"
#include "mbdae/drive/drive_jet.h"
#include "mbdae/drive/drive_library.h"

namespace mbdae::reading::evaluation {

constexpr std::size_t kLongestText = std::size_t{1} << 16;  // characters; "a"+"a" doubled in a row of cards stays small

inline double value_of(double x) { return x; }
inline double value_of(const Jet& x) { return x.value; }
inline void set_real(double x, double* out) { *out = x; }
inline void set_real(double x, Jet* out) { *out = {x, 0.0, 0.0}; }

/// The sign of x and of what it is about to become (jets know their rate).
inline int side_of(double x) { return x > 0.0 ? 1 : x < 0.0 ? -1 : 0; }
inline int side_of(const Jet& x) { return side(x); }

template <class Real>
class Evaluator {
 public:
  using V = Value<Real>;

  Evaluator(const Expression& expression, const Symbols& symbols) : expression_(expression), symbols_(symbols) {
    locals_.resize(expression.locals.size());
    for (std::size_t i = 0; i < locals_.size(); ++i) locals_[i].type = expression.local_types[i];
  }

  ReadingState* state = nullptr;  // null at run time
  Real time{}, time_step{}, argument{};
  std::uint64_t piece = 0;  // of the branches taken

  V evaluate(int index) {
    const ExpressionNode& node = expression_.nodes[static_cast<std::size_t>(index)];
    if constexpr (!std::is_same_v<Real, double>) {
      if (is_comparison(node.op)) {
        const V left = evaluate(node.first);
        V result = binary(node, left, evaluate(second(node)));
        piece = mixed(piece, static_cast<std::uint64_t>(result.integer));
        return result;
      }
    }
    switch (node.op) {
      case Op::integer:
        return V::from_integer(node.integer);
      case Op::real:
        return constant(node.real);
      case Op::text:
        return V::from_text(expression_.texts[node.index]);
      case Op::variable:
        return variable(node);
      case Op::local:
        return locals_[node.index];
      case Op::time:
        return V::from_real(time);
      case Op::argument:
        return V::from_real(argument);
      case Op::time_step:
        return V::from_real(time_step);
      case Op::model_current:
        if (state == nullptr || state->current_length == nullptr) {
          fail(node, "model::current(\"L0\") has a value only in the law of a rod");
        }
        return constant(*state->current_length);
      case Op::model_drive: {
        const V argument = evaluate(node.first);
        const Drive& drive = *expression_.drives[node.index];
        if constexpr (std::is_same_v<Real, double>) {
          return V::from_real(drive.value(real(node, argument)));
        } else {
          const Real x = real(node, argument);
          piece = mixed(piece, drive.piece(x.value));
          return V::from_real(composed(drive, x));
        }
      }
      case Op::plus:
      case Op::negate:
        return sign_change(node);
      case Op::logical_not:
        return V::from_bool(!truth(node, evaluate(node.first)));
      case Op::logical_and:
        return V::from_bool(truth(node, evaluate(node.first)) && truth(node, evaluate(second(node))));
      case Op::logical_or:
        return V::from_bool(truth(node, evaluate(node.first)) || truth(node, evaluate(second(node))));
      case Op::logical_xor: {
        const bool a = truth(node, evaluate(node.first)), b = truth(node, evaluate(second(node)));
        return V::from_bool(a != b);
      }
      case Op::assign:
        return assign(node);
      case Op::assign_local: {
        V& local = locals_[expression_.nodes[static_cast<std::size_t>(node.first)].index];
        local = converted(node, evaluate(second(node)), local.type, false);
        return local;
      }
      case Op::declare_local: {
        V& local = locals_[node.index];
        local = converted(node, evaluate(node.first), node.type, false);
        return local;
      }
      case Op::declare:
        return declare(node);
      case Op::call:
        return call(node);
      case Op::sequence: {
        V last;
        for (int child = node.first; child >= 0; child = expression_.nodes[static_cast<std::size_t>(child)].sibling) {
          last = evaluate(child);
        }
        return last;
      }
      default: {
        const V left = evaluate(node.first);  // before the right one, which may change a variable
        return binary(node, left, evaluate(second(node)));
      }
    }
  }

 private:
  [[noreturn]] void fail(const ExpressionNode& node, std::string message) const {
    throw EvaluationError{node.where, std::move(message)};
  }

  int second(const ExpressionNode& node) const {
    return expression_.nodes[static_cast<std::size_t>(node.first)].sibling;
  }

  static V constant(double x) {
    V out;
    out.type = Type::real;
    set_real(x, &out.real);
    return out;
  }

  V checked_integer(const ExpressionNode& node, double x) const {
    if (!(x >= INT_MIN && x <= INT_MAX)) fail(node, number_text(x) + " does not fit in an integer");
    return V::from_integer(static_cast<std::int64_t>(x));
  }

  V checked_integer(const ExpressionNode& node, std::int64_t x) const {
    if (x < INT_MIN || x > INT_MAX)
      fail(node, "integer overflow: the result " + std::to_string(x) + " is out of range");
    return V::from_integer(x);
  }

  V checked_real(const ExpressionNode& node, const char* what, const Real& x) const {
    if (!std::isfinite(value_of(x))) fail(node, std::string("the result of ") + what + " is not a finite number");
    return V::from_real(x);
  }

  Real real(const ExpressionNode& node, const V& v) const {
    if (v.type == Type::string) fail(node, "found the string " + quoted(v.text) + ", expected a number");
    if (v.type == Type::real) return v.real;
    Real out{};
    set_real(static_cast<double>(v.integer), &out);
    return out;
  }

  std::int64_t integer(const ExpressionNode& node, const V& v) const {
    if (v.type == Type::real || v.type == Type::string) {
      fail(node, found_type(v.type) + ", expected an integer");
    }
    return v.integer;
  }

  bool truth(const ExpressionNode& node, const V& v) const {
    return v.type == Type::string || v.type == Type::real ? value_of(real(node, v)) != 0.0 : v.integer != 0;
  }

  V variable(const ExpressionNode& node) const {
    const Variable& variable = symbols_[node.index];
    if (variable.broken) throw BrokenVariable{};
    if (!variable.has_value) fail(node, "the variable " + quoted(variable.name) + " has no value yet");
    if constexpr (std::is_same_v<Real, double>) {
      return variable.value;
    } else {
      V out;
      out.type = variable.value.type;
      out.integer = variable.value.integer;
      set_real(variable.value.real, &out.real);
      if (out.type == Type::string) out.text = variable.value.text;
      return out;
    }
  }

  V sign_change(const ExpressionNode& node) {
    V v = evaluate(node.first);
    if (v.type == Type::string) fail(node, "found the string " + quoted(v.text) + ", expected a number");
    if (v.type == Type::boolean) v.type = Type::integer;
    if (node.op == Op::plus) return v;
    if (v.type == Type::integer) return checked_integer(node, -v.integer);
    v.real = -v.real;
    return v;
  }

  V binary(const ExpressionNode& node, const V& a, const V& b) const {
    if (node.op == Op::add && (a.type == Type::string || b.type == Type::string)) {
      std::string text = as_text(a) + as_text(b);
      if (text.size() > kLongestText) fail(node, "the string is longer than 65536 characters");
      return V::from_text(std::move(text));
    }
    if (a.type == Type::string && b.type == Type::string && is_comparison(node.op)) {
      return V::from_bool(compare(node.op, a.text.compare(b.text)));
    }
    const bool whole = a.type != Type::real && b.type != Type::real && a.type != Type::string && b.type != Type::string;
    if (whole && node.op != Op::power) {  // powers of integers are real
      return integer_operation(node, a.integer, b.integer);
    }
    const Real x = real(node, a), y = real(node, b);
    const double xv = value_of(x), yv = value_of(y);
    switch (node.op) {
      case Op::add:
        return checked_real(node, "`+`", x + y);
      case Op::subtract:
        return checked_real(node, "`-`", x - y);
      case Op::multiply:
        return checked_real(node, "`*`", x * y);
      case Op::divide:
        if (yv == 0.0) fail(node, "division by zero");
        return checked_real(node, "`/`", x / y);
      case Op::modulo:
        fail(node, "`%` is for integers, found a real");
      case Op::power:
        return power(node, x, y);
      default:
        return V::from_bool(compare(node.op, xv < yv ? -1 : xv > yv ? 1 : 0));
    }
  }

  V power(const ExpressionNode& node, const Real& x, const Real& y) const {
    using std::pow;
    if (value_of(x) == 0.0 && value_of(y) < 0.0) fail(node, "division by zero");
    return checked_real(node, "`^`", pow(x, y));
  }

  V integer_operation(const ExpressionNode& node, std::int64_t a, std::int64_t b) const {
    switch (node.op) {
      case Op::add:
        return checked_integer(node, a + b);
      case Op::subtract:
        return checked_integer(node, a - b);
      case Op::multiply:
        return checked_integer(node, a * b);
      case Op::divide:
      case Op::modulo:
        if (b == 0) fail(node, "division by zero");
        return checked_integer(node, node.op == Op::divide ? a / b : a % b);
      default:
        return V::from_bool(compare(node.op, a < b ? -1 : a > b ? 1 : 0));
    }
  }

  static bool is_comparison(Op op) { return op >= Op::greater && op <= Op::not_equal; }

  static bool compare(Op op, int order) {
    switch (op) {
      case Op::greater:
        return order > 0;
      case Op::greater_equal:
        return order >= 0;
      case Op::equal:
        return order == 0;
      case Op::less_equal:
        return order <= 0;
      case Op::less:
        return order < 0;
      default:
        return order != 0;
    }
  }

  static std::string as_text(const V& v) {
    switch (v.type) {
      case Type::string:
        return v.text;
      case Type::boolean:
        return v.integer != 0 ? "TRUE" : "FALSE";
      case Type::integer:
        return std::to_string(v.integer);
      default:
        return number_text(value_of(v.real));
    }
  }

  /// A value as it is kept by a variable of the given type.
  V converted(const ExpressionNode& node, const V& v, Type type, bool cast) const {
    if (v.type == type) return v;
    switch (type) {
      case Type::real:
        return V::from_real(real(node, v));
      case Type::boolean:
        return V::from_bool(truth(node, v));
      case Type::string:
        if (!cast) fail(node, found_type(v.type) + ", expected a string");
        return V::from_text(as_text(v));
      default: {
        const double x = value_of(real(node, v));
        if (!cast && x != std::trunc(x)) {
          fail(node, "found " + number_text(x) + ", expected an integer (write integer(...) to cut it off)");
        }
        return checked_integer(node, std::trunc(x));
      }
    }
  }

  V assign(const ExpressionNode& node) {
    const ExpressionNode& target = expression_.nodes[static_cast<std::size_t>(node.first)];
    V v = evaluate(second(node));
    if constexpr (std::is_same_v<Real, double>) {
      Variable& variable = (*state->symbols)[target.index];
      if (variable.broken) throw BrokenVariable{};
      if (variable.constant) fail(node, "the constant " + quoted(variable.name) + " cannot be changed");
      v = converted(node, v, variable.value.type, false);
      variable.value = v;
      variable.has_value = true;
    }
    return v;
  }

  V declare(const ExpressionNode& node) {
    if constexpr (std::is_same_v<Real, double>) {
      Symbols& symbols = *state->symbols;
      if (node.if_not_defined) return symbols[node.index].value;
      if (node.first >= 0) {
        const V value = converted(node, evaluate(node.first), node.type, false);
        symbols[node.index].value = value;
        symbols[node.index].has_value = true;
      }
      return symbols[node.index].value;
    } else {
      fail(node, "a declaration in a run-time expression");
    }
  }

  V call(const ExpressionNode& node);
  V formatted(const ExpressionNode& node, const V& format, const V& argument) const;
  V random(const ExpressionNode& node, Function id, const V* argument);

  const Expression& expression_;
  const Symbols& symbols_;
  std::vector<V> locals_;  // of a run-time expression
};

}  // namespace mbdae::reading::evaluation
