// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/evaluate.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "mbdae/deck/diagnostic.h"
#include "mbdae/deck/format_text.h"
#include "mbdae/drive/drive_jet.h"
#include "mbdae/drive/drive_library.h"

namespace mbdae::reading {
namespace {

constexpr std::size_t kLongestText = std::size_t{1} << 16;  // characters; "a"+"a" doubled in a row of cards stays small

double value_of(double x) { return x; }
double value_of(const Jet& x) { return x.value; }
void set_real(double x, double* out) { *out = x; }
void set_real(double x, Jet* out) { *out = {x, 0.0, 0.0}; }

/// The sign of x and of what it is about to become (jets know their rate).
int side_of(double x) { return x > 0.0 ? 1 : x < 0.0 ? -1 : 0; }
int side_of(const Jet& x) { return side(x); }

/// Which branch of a function with branches holds; 0 of the smooth ones.
std::uint64_t branch(Function id, double x, double y, double z) {
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

bool has_branches(const ExpressionNode& node) {
  if (node.op >= Op::greater && node.op <= Op::not_equal) return true;
  if (node.op != Op::call) return false;
  // 1, 2, 3 and 3, 1, 2 are on different branches of every function that has some
  const auto id = static_cast<Function>(node.index);
  return branch(id, 1.5, 2.5, 3.5) != 0 || id == Function::cast_integer;
}

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
      fail(node, std::string("found a ") + type_name(v.type) + ", expected an integer");
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
        if (!cast) fail(node, std::string("found a ") + type_name(v.type) + ", expected a string");
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

}  // namespace

Value<double> evaluate(const Expression& expression, ReadingState& state) {
  Evaluator<double> evaluator(expression, *state.symbols);
  evaluator.state = &state;
  return evaluator.evaluate(expression.root);
}

Jet StringDrive::checked(const Jet& time, const Jet& argument) const {
  Evaluator<Jet> evaluator(expression_, *symbols_);
  evaluator.time = time;
  evaluator.argument = argument;
  evaluator.time_step = {time_step_, 0.0, 0.0};
  const Value<Jet> value = evaluator.evaluate(expression_.root);
  if (value.type == Type::real) return value.real;
  if (value.type == Type::string) {
    throw EvaluationError{expression_.nodes[static_cast<std::size_t>(expression_.root)].where,
                          "found a string, expected an expression worth a number"};
  }
  return {static_cast<double>(value.integer), 0.0, 0.0};
}

std::uint64_t StringDrive::piece(double t) const {
  Evaluator<Jet> evaluator(expression_, *symbols_);
  evaluator.time = evaluator.argument = {t, 1.0, 0.0};
  evaluator.time_step = {time_step_, 0.0, 0.0};
  try {
    evaluator.evaluate(expression_.root);
  } catch (const EvaluationError&) {
  } catch (const BrokenVariable&) {
  }
  return evaluator.piece;
}

bool StringDrive::has_pieces() const {
  for (const ExpressionNode& node : expression_.nodes) {
    if (has_branches(node)) return true;
  }
  for (const DrivePtr& drive : expression_.drives) {
    if (drive->has_pieces()) return true;
  }
  return false;
}

void StringDrive::known_jumps(std::vector<double>& times) const {
  for (const DrivePtr& drive : expression_.drives) drive->known_jumps(times);  // right where the argument is the time
}

Jet StringDrive::at(double t) const { return unchecked({t, 1.0, 0.0}, {t, 1.0, 0.0}); }

Jet StringDrive::at_argument(double argument, double t) const { return unchecked({t, 0.0, 0.0}, {argument, 1.0, 0.0}); }

Jet StringDrive::unchecked(const Jet& time, const Jet& argument) const {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  try {
    return checked(time, argument);
  } catch (const EvaluationError&) {
  } catch (const BrokenVariable&) {
  }
  return {kNan, kNan, kNan};
}

}  // namespace mbdae::reading
