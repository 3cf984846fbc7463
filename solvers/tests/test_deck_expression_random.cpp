// Thousands of random expressions against a second evaluation, written from the rules of the language and working on
// the tree that the text was printed from: it shares neither parser nor arithmetic with the reader.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <climits>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "mbdae/deck/evaluate.h"
#include "mbdae/deck/expression.h"
#include "test_deck_support.h"

namespace {

enum class Kind { boolean, integer, real };

struct Worth {
  Kind kind = Kind::integer;
  double value = 0.0;
};

/// No value: 1/0, an overflow, a remainder of reals.
struct NoValue {};

struct Tree {
  std::string name;  ///< operator, function, or what a leaf is written as
  int level = 7;  ///< how tight: 0 assignment, 1 logical, 2 comparison, 3 sum, 4 product, 5 power, 6 sign, 7 the rest
  Worth leaf;
  int variable = -1;  ///< of a leaf or an assignment
  std::vector<std::unique_ptr<Tree>> parts;
};

struct Function {
  const char* name;
  std::size_t parts;
};
constexpr Function kFunctions[] = {
    {"abs", 1},  {"ceil", 1},    {"floor", 1},    {"round", 1}, {"sign", 1},  {"step", 1},  {"ramp", 1},
    {"par", 1},  {"exp", 1},     {"sin", 1},      {"cos", 1},   {"tanh", 1},  {"atan2", 2}, {"min", 2},
    {"max", 2},  {"sramp", 2},   {"copysign", 2}, {"in_ll", 3}, {"in_le", 3}, {"in_el", 3}, {"in_ee", 3},
    {"real", 1}, {"integer", 1}, {"bool", 1},     {"sqrt", 1},  {"log", 1}};
struct Operator {
  const char* name;
  int level;
};
constexpr Operator kOperators[] = {{"&&", 1}, {"||", 1}, {"~|", 1}, {"<", 2}, {"<=", 2}, {">", 2}, {">=", 2}, {"==", 2},
                                   {"!=", 2}, {"+", 3},  {"-", 3},  {"*", 4}, {"/", 4},  {"%", 4}, {"^", 5}};

constexpr int kVariables = 3;  // B bool, I integer, R real
constexpr const char* kNames[kVariables] = {"B", "I", "R"};
constexpr Kind kKinds[kVariables] = {Kind::boolean, Kind::integer, Kind::real};

class Maker {
 public:
  explicit Maker(unsigned seed) : random_(seed) {}

  std::unique_ptr<Tree> tree(int height) {
    auto out = std::make_unique<Tree>();
    const int choice = height == 0 ? 0 : below(12);
    if (choice < 2) {
      leaf(*out);
    } else if (choice < 8) {
      const Operator& op = kOperators[below(std::size(kOperators))];
      out->name = op.name;
      out->level = op.level;
      add(*out, height, 2);
    } else if (choice < 9) {
      constexpr const char* kSigns[] = {"-", "+", "!"};
      out->name = kSigns[below(3)];
      out->level = 6;
      add(*out, height, 1);
    } else if (choice < 11) {
      const Function& function = kFunctions[below(std::size(kFunctions))];
      out->name = function.name;
      add(*out, height, function.parts);
    } else {
      out->name = "=";
      out->level = 0;
      out->variable = below(kVariables);
      add(*out, height, 1);
    }
    return out;
  }

  /// As little as the rules ask for: parentheses only where the part binds less than its place wants.
  std::string text(const Tree& tree, int wanted) {
    std::string out;
    const bool parentheses = tree.level < wanted || below(12) == 0;
    if (parentheses) out += "(" + blank();
    if (tree.level == 7) {
      out += tree.name;
      if (!tree.parts.empty()) {
        out += "(";
        for (std::size_t i = 0; i < tree.parts.size(); ++i) out += (i == 0 ? "" : ", ") + text(*tree.parts[i], 1);
        out += ")";
      }
    } else if (tree.level == 0) {
      out += kNames[tree.variable] + blank() + "=" + blank() + text(*tree.parts[0], 0);
    } else if (tree.level == 6) {
      out += tree.name + blank() + text(*tree.parts[0], 6);
    } else if (tree.level == 5) {  // from the right
      out += text(*tree.parts[0], 6) + blank() + "^" + blank() + text(*tree.parts[1], 5);
    } else {  // from the left
      out += text(*tree.parts[0], tree.level) + " " + tree.name + blank() + text(*tree.parts[1], tree.level + 1);
    }
    if (parentheses) out += blank() + ")";
    return out;
  }

 private:
  template <class T>
  int below(T limit) {
    return static_cast<int>(random_() % static_cast<unsigned>(limit));
  }
  std::string blank() { return below(3) == 0 ? " " : ""; }

  void leaf(Tree& out) {
    switch (below(5)) {
      case 0:
        out.leaf = {Kind::boolean, static_cast<double>(below(2))};
        out.name = out.leaf.value != 0.0 ? "TRUE" : "FALSE";
        break;
      case 1:
      case 2: {
        constexpr int kSpecial[] = {0, 1, 2, 46341, INT_MAX};
        const int value = below(4) == 0 ? kSpecial[below(5)] : below(20);
        out.leaf = {Kind::integer, static_cast<double>(value)};
        out.name = std::to_string(value);
        break;
      }
      case 3: {
        constexpr std::pair<const char*, double> kReals[] = {{"0.", 0.0},   {"2.5", 2.5},   {".5", 0.5},
                                                             {"1e1", 10.0}, {"3.d-1", 0.3}, {"7.25", 7.25},
                                                             {"1.", 1.0},   {"-1.5", -1.5}};
        const auto& [name, value] = kReals[below(7)];
        out.leaf = {Kind::real, value};
        out.name = name;
        break;
      }
      default:
        out.variable = below(kVariables);
        out.name = kNames[out.variable];
    }
  }

  void add(Tree& out, int height, std::size_t parts) {
    for (std::size_t i = 0; i < parts; ++i) out.parts.push_back(tree(height - 1));
  }

  std::mt19937 random_;
};

Worth whole(double value) {
  if (!(value >= INT_MIN && value <= INT_MAX)) throw NoValue{};
  return {Kind::integer, value + 0.0};  // there is one zero
}

Worth real(double value) {
  if (!std::isfinite(value)) throw NoValue{};
  return {Kind::real, value};
}

Worth logical(bool value) { return {Kind::boolean, value ? 1.0 : 0.0}; }

Worth as(Kind kind, const Worth& given, bool cut) {
  if (kind == given.kind) return given;
  if (kind == Kind::real) return {Kind::real, given.value};
  if (kind == Kind::boolean) return logical(given.value != 0.0);
  if (!cut && given.value != std::trunc(given.value)) throw NoValue{};
  return whole(std::trunc(given.value));
}

class Reference {
 public:
  std::vector<Worth> variables;

  Worth worth(const Tree& tree) {
    if (tree.level == 0)
      return variables[static_cast<std::size_t>(tree.variable)] =
                 as(kKinds[tree.variable], worth(*tree.parts[0]), false);
    if (tree.parts.empty()) return tree.variable < 0 ? tree.leaf : variables[static_cast<std::size_t>(tree.variable)];
    const Worth a = worth(*tree.parts[0]);
    const std::string& op = tree.name;
    if (op == "&&" && a.value == 0.0) return logical(false);  // the right operand does not matter, nor is it looked at
    if (op == "||" && a.value != 0.0) return logical(true);
    if (tree.parts.size() == 1) return one(op, a);
    const Worth b = worth(*tree.parts[1]);
    if (tree.parts.size() == 2) return two(op, a, b);
    const double x = b.value, low = a.value, high = worth(*tree.parts[2]).value;
    const bool above = op[3] == 'e' ? low <= x : low < x;
    const bool below = op[4] == 'e' ? x <= high : x < high;
    return real(above && below ? 1.0 : 0.0);
  }

 private:
  static Worth one(const std::string& op, const Worth& a) {
    const double x = a.value;
    const Worth number{a.kind == Kind::boolean ? Kind::integer : a.kind, x};
    if (op == "-") return number.kind == Kind::real ? real(-x) : whole(-x);
    if (op == "+") return number;
    if (op == "!") return logical(x == 0.0);
    if (op == "bool") return as(Kind::boolean, a, true);
    if (op == "integer") return as(Kind::integer, a, true);
    if (op == "sign") return whole(x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : 0.0);
    if (op == "abs") return real(x < 0.0 ? -x : x);
    if (op == "ceil") return real(-std::floor(-x));
    if (op == "floor") return real(std::floor(x));
    if (op == "round") {
      const double down = std::floor(x);
      if (x - down != 0.5) return real(std::floor(x + 0.5));
      return real(std::fmod(down, 2.0) == 0.0 ? down : down + 1.0);
    }
    if (op == "step") return real(x < 0.0 ? 0.0 : x == 0.0 ? 0.5 : 1.0);
    if (op == "ramp") return real(x < 0.0 ? 0.0 : x);
    if (op == "par") return real(x < 0.0 ? 0.0 : x * x);
    if (op == "exp") return real(std::exp(x));
    if (op == "sin") return real(std::sin(x));
    if (op == "cos") return real(std::cos(x));
    if (op == "tanh") return real(std::tanh(x));
    if (op == "sqrt") return real(std::sqrt(x));
    if (op == "log") return real(std::log(x));
    return real(x);
  }

  static Worth two(const std::string& op, const Worth& a, const Worth& b) {
    const double x = a.value, y = b.value;
    const bool reals = a.kind == Kind::real || b.kind == Kind::real;
    const auto number = [&](double value) { return reals ? real(value) : whole(value); };
    if (op == "+") return number(x + y);
    if (op == "-") return number(x - y);
    if (op == "*") return number(x * y);
    if (op == "/") {
      if (y == 0.0) throw NoValue{};
      return reals ? real(x / y) : whole(std::trunc(x / y));
    }
    if (op == "%") {
      if (reals || y == 0.0) throw NoValue{};
      return whole(std::fmod(x, y));
    }
    if (op == "^") return real(std::pow(x, y));
    if (op == "<") return logical(x < y);
    if (op == "<=") return logical(x <= y);
    if (op == ">") return logical(x > y);
    if (op == ">=") return logical(x >= y);
    if (op == "==") return logical(x == y);
    if (op == "!=") return logical(x != y);
    if (op == "&&" || op == "||") return logical(y != 0.0);
    if (op == "~|") return logical((x != 0.0) != (y != 0.0));
    if (op == "min") return real(x < y ? x : y);
    if (op == "max") return real(x > y ? x : y);
    if (op == "sramp") return real(x <= 0.0 ? 0.0 : x > y ? y : x);
    if (op == "atan2") return real(std::atan2(x, y));
    return real(std::copysign(x, y));
  }
};

/// The reader's answer.
std::optional<Worth> read(const std::string& text) {
  using namespace mbdae::reading;
  Diagnostics diagnostics;
  Symbols symbols;
  ReadingState state;
  state.symbols = &symbols;
  const std::string all = "bool B = TRUE; integer I = 5; real R = 1.75;" + text;
  TokenStream tokens(Lexer(all, 0));
  Value<double> value;
  try {
    while (true) {
      Expression expression;
      ExpressionParser parser(tokens, symbols, diagnostics, expression, false);
      parser.parse_statement();
      value = evaluate(expression, state);
      if (!tokens.peek().is(";")) break;
      tokens.take();
    }
  } catch (const EvaluationError&) {
    return std::nullopt;
  }
  REQUIRE(tokens.peek().kind == TokenKind::end);
  const Kind kind = value.type == Type::boolean   ? Kind::boolean
                    : value.type == Type::integer ? Kind::integer
                                                  : Kind::real;
  return Worth{kind, kind == Kind::real ? value.real : static_cast<double>(value.integer)};
}

}  // namespace

TEST_CASE("random expressions are worth what the rules say") {
  Maker maker(20251127);
  int values = 0;
  for (int i = 0; i < 20000; ++i) {
    const std::unique_ptr<Tree> tree = maker.tree(1 + i % 5);
    const std::string text = maker.text(*tree, 0);
    Reference reference;
    reference.variables = {{Kind::boolean, 1.0}, {Kind::integer, 5.0}, {Kind::real, 1.75}};
    std::optional<Worth> expected;
    try {
      expected = reference.worth(*tree);
    } catch (const NoValue&) {
    }
    const std::optional<Worth> got = read(text);
    CAPTURE(text);
    REQUIRE(got.has_value() == expected.has_value());
    if (!got) continue;
    ++values;
    CAPTURE(got->value, expected->value);
    REQUIRE(got->kind == expected->kind);
    REQUIRE(got->value == expected->value);
  }
  CHECK(values > 10000);
}
