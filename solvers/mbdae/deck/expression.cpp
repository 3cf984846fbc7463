// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/expression.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <string>

namespace mbdae::reading {
namespace {

struct BinaryOperator {
  std::string_view symbol;
  Op op;
  int level;  ///< 0 binds weakest
};

constexpr int kLevels = 4;  // of the operators below
// The three logical operators have one level: 1 || 0 && 0 is (1 || 0) && 0, which is false.
constexpr std::array<BinaryOperator, 14> kBinary = {{
    {"~|", Op::logical_xor, 0},
    {"||", Op::logical_or, 0},
    {"&&", Op::logical_and, 0},
    {">", Op::greater, 1},
    {">=", Op::greater_equal, 1},
    {"==", Op::equal, 1},
    {"<=", Op::less_equal, 1},
    {"<", Op::less, 1},
    {"!=", Op::not_equal, 1},
    {"+", Op::add, 2},
    {"-", Op::subtract, 2},
    {"*", Op::multiply, 3},
    {"/", Op::divide, 3},
    {"%", Op::modulo, 3},
}};

const BinaryOperator* find_binary(const Token& token) {
  if (token.kind != TokenKind::symbol || token.is(",") || token.is(";")) return nullptr;
  for (const BinaryOperator& candidate : kBinary) {
    if (token.text == candidate.symbol) return &candidate;
  }
  return nullptr;
}

std::optional<Type> type_word(std::string_view word) {
  if (word == "real") return Type::real;
  if (word == "integer") return Type::integer;
  if (word == "bool") return Type::boolean;
  if (word == "string") return Type::string;
  return std::nullopt;
}

}  // namespace

void ExpressionParser::check_depth(int depth) {
  if (depth > kDeepestNesting) {
    diagnostics_.fail(tokens_.peek().where,
                      "expression nested deeper than " + std::to_string(kDeepestNesting) + " levels");
  }
}

int ExpressionParser::add(ExpressionNode node, int first, int second) {
  node.first = first;
  if (first >= 0) {
    node.height = out_.nodes[static_cast<std::size_t>(first)].height + 1;
    if (second >= 0) {
      node.height = std::max(node.height, out_.nodes[static_cast<std::size_t>(second)].height + 1);
      out_.nodes[static_cast<std::size_t>(first)].sibling = second;
    }
  }
  if (node.height > kHighestTree) {
    diagnostics_.fail(node.where, "expression with more than " + std::to_string(kHighestTree) +
                                      " operations in a row: split it with `set:`");
  }
  out_.nodes.push_back(node);
  return static_cast<int>(out_.nodes.size()) - 1;
}

void ExpressionParser::expect(std::string_view symbol) {
  const Token token = tokens_.take();
  if (!token.is(symbol)) {
    diagnostics_.fail(token.where, "found " + described(token) + ", expected `" + std::string(symbol) + "`");
  }
}

int ExpressionParser::statement(int depth) {
  const Token& token = tokens_.peek();
  if (token.kind != TokenKind::word) return assignment(depth);
  // A declaration starts with modifiers and a type, followed by a name: two words in a row.
  const bool modifier = token.text == "const" || token.text == "ifndef";
  const TokenKind after = tokens_.peek(1).kind;
  if (type_word(token.text) && (after == TokenKind::integer || after == TokenKind::real || after == TokenKind::bad)) {
    diagnostics_.fail(tokens_.peek(1).where,
                      "found " + described(tokens_.peek(1)) + ", expected the name of a variable");
  }
  if (after != TokenKind::word) return assignment(depth);
  if (!modifier && !type_word(token.text)) {
    static constexpr const char* kTypes[] = {"bool", "integer", "real", "string", "const", "ifndef"};
    diagnostics_.fail(token.where, "found " + quoted(token.text) + ", expected a type: bool, integer, real, string" +
                                       suggestion(token.text, kTypes));
  }

  ExpressionNode node;
  node.op = Op::declare;
  node.where = token.where;
  if (tokens_.peek().text == "ifndef") {
    tokens_.take();
    node.if_not_defined = true;
  }
  if (tokens_.peek().text == "const") {
    tokens_.take();
    node.constant = true;
  }
  const Token type = tokens_.take();
  const std::optional<Type> known = type.kind == TokenKind::word ? type_word(type.text) : std::nullopt;
  if (!known)
    diagnostics_.fail(type.where, "found " + described(type) + ", expected a type: bool, integer, real, string");
  node.type = *known;
  const Token name = tokens_.take();
  if (name.kind != TokenKind::word) {
    diagnostics_.fail(name.where, "found " + described(name) + ", expected the name of a variable");
  }
  if (depth == 0) declared_ = name.text;
  node.where = name.where;
  if (name.text == "Time" || name.text == "TimeStep" || name.text == "Step" || name.text == "Var") {
    diagnostics_.fail(name.where, quoted(name.text) + " is a run-time variable of the language, choose another name");
  }
  if (run_time_) return local_declaration(node, name, depth);
  const std::optional<std::uint32_t> known_symbol = symbols_.find(name.text);
  if (known_symbol && symbols_[*known_symbol].broken) throw Reported{};
  if (known_symbol && !node.if_not_defined) {
    diagnostics_.fail(name.where, "the variable " + quoted(name.text) + " is declared already (use `set: " +
                                      std::string(name.text) + " = ...;` to change it, `ifndef` to keep it)");
  }
  int initial = -1;
  const std::size_t variables = symbols_.size();
  if (tokens_.peek().is("=")) {
    tokens_.take();
    initial = assignment(depth);
  } else if (node.constant) {
    diagnostics_.fail(name.where, "the constant " + quoted(name.text) + " needs a value: `= ...`");
  }
  if (known_symbol) {
    node.index = *known_symbol;
  } else {
    node.if_not_defined = false;
    Variable variable;
    variable.name = std::string(name.text);
    variable.constant = node.constant;
    variable.value.type = node.type;
    // Its own initial value may have declared it.
    if (const auto inner = symbols_.size() > variables ? symbols_.find(name.text) : std::nullopt) {
      diagnostics_.fail(name.where, "the variable " + quoted(symbols_[*inner].name) + " is declared already");
    }
    node.index = symbols_.add(std::move(variable));
  }
  return add(node, initial);
}

std::optional<std::uint32_t> ExpressionParser::find_local(std::string_view name) const {
  for (std::size_t i = 0; i < out_.locals.size(); ++i) {
    if (out_.locals[i] == name) return static_cast<std::uint32_t>(i);
  }
  return std::nullopt;
}

int ExpressionParser::local_declaration(ExpressionNode node, const Token& name, int depth) {
  if (find_local(name.text) || symbols_.find(name.text)) {
    diagnostics_.fail(name.where, "the variable " + quoted(name.text) + " is declared already");
  }
  node.op = Op::declare_local;
  if (!tokens_.peek().is("=")) {
    diagnostics_.fail(name.where,
                      "the variable " + quoted(name.text) + " of a run-time expression needs a value: `= ...`");
  }
  tokens_.take();
  const int initial = assignment(depth);
  node.index = static_cast<std::uint32_t>(out_.locals.size());
  out_.locals.emplace_back(name.text);
  out_.local_types.push_back(node.type);
  return add(node, initial);
}

int ExpressionParser::assignment(int depth) {
  check_depth(depth);
  const Token& first = tokens_.peek();
  if ((first.kind == TokenKind::integer || first.kind == TokenKind::real) && tokens_.peek(1).is(";")) return number();
  const int left = binary(0, depth);
  if (!tokens_.peek().is("=")) return left;
  const Token token = tokens_.take();
  const ExpressionNode target = out_.nodes[static_cast<std::size_t>(left)];
  if (target.op != Op::variable && target.op != Op::local) {
    diagnostics_.fail(token.where, "only a variable can stand left of `=` (the comparison is `==`)");
  }
  if (run_time_ && target.op == Op::variable) {
    diagnostics_.fail(token.where, "not supported: the assignment to a variable of the deck in a run-time expression");
  }
  const int right = assignment(depth + 1);
  ExpressionNode node;
  node.op = target.op == Op::local ? Op::assign_local : Op::assign;
  node.where = token.where;
  return add(node, left, right);
}

// An operand and what operators of level `lowest` or higher make of it.
int ExpressionParser::binary(int lowest, int depth) {
  int left = power(depth);
  while (true) {
    const BinaryOperator* const found = find_binary(tokens_.peek());
    if (found == nullptr || found->level < lowest) return left;
    ExpressionNode node;
    node.op = found->op;
    node.where = tokens_.take().where;
    // The right operand has only what binds tighter, so that a - b - c is (a - b) - c.
    const int right = found->level + 1 < kLevels ? binary(found->level + 1, depth) : power(depth);
    left = add(node, left, right);
  }
}

int ExpressionParser::power(int depth) {
  check_depth(depth);
  const int base = unary(depth);
  if (!tokens_.peek().is("^")) return base;
  ExpressionNode node;
  node.op = Op::power;
  node.where = tokens_.take().where;
  const int exponent = power(depth + 1);
  return add(node, base, exponent);
}

int ExpressionParser::unary(int depth) {
  check_depth(depth);
  const Token& token = tokens_.peek();
  if (token.kind == TokenKind::symbol && (token.text == "-" || token.text == "+" || token.text == "!")) {
    ExpressionNode node;
    node.op = token.text == "-" ? Op::negate : token.text == "+" ? Op::plus : Op::logical_not;
    node.where = token.where;
    tokens_.take();
    const int operand = unary(depth + 1);
    return add(node, operand);
  }
  return primary(depth);
}

int ExpressionParser::number() {
  const Token token = tokens_.take();
  Number value;
  const bool fits = read_number(token, &value);
  ExpressionNode node;
  node.where = token.where;
  if (token.kind == TokenKind::integer) {
    node.integer = value.integer;
    if (!fits) {
      diagnostics_.fail(token.where, "the integer " + quoted(token.text) + " is larger than INT_MAX = 2147483647 " +
                                         "(write it with a point for a real)");
    }
    return add(node);
  }
  node.op = Op::real;
  node.type = Type::real;
  node.real = value.real;
  if (!fits) {
    // Too large is an error, too small is as good as zero.
    node.real = std::strtod(with_plain_exponent(token.text).c_str(), nullptr);
    if (!std::isfinite(node.real)) diagnostics_.fail(token.where, "the number " + quoted(token.text) + " is too large");
  }
  return add(node);
}

int ExpressionParser::primary(int depth) {
  const Token& token = tokens_.peek();
  if (token.kind == TokenKind::integer || token.kind == TokenKind::real) return number();
  if (token.kind == TokenKind::word) return name(depth);
  if (token.kind == TokenKind::string) {
    ExpressionNode node;
    node.op = Op::text;
    node.type = Type::string;
    node.where = token.where;
    node.index = static_cast<std::uint32_t>(out_.texts.size());
    out_.texts.push_back(unescaped(token.text));
    tokens_.take();
    return add(node);
  }
  if (token.is("[")) diagnostics_.fail(token.where, "not supported: variables `[node, ...]` that follow the motion");
  if (!token.is("("))
    diagnostics_.fail(token.where, "found " + described(token) + ", expected a number or an expression");
  ExpressionNode node;
  node.op = Op::sequence;
  node.where = tokens_.take().where;
  const int first = statement(depth + 1);
  int last = first;
  int height = out_.nodes[static_cast<std::size_t>(first)].height;
  while (tokens_.peek().is(";")) {
    tokens_.take();
    const int next = statement(depth + 1);
    out_.nodes[static_cast<std::size_t>(last)].sibling = next;
    height = std::max(height, out_.nodes[static_cast<std::size_t>(next)].height);
    last = next;
  }
  expect(")");
  const Op inside = out_.nodes[static_cast<std::size_t>(first)].op;
  if (last == first && inside != Op::variable && inside != Op::local) return first;
  return add_sequence(node, first, height);
}

int ExpressionParser::add_sequence(ExpressionNode node, int first, int height) {
  node.op = Op::sequence;
  node.height = height + 1;
  const int sequence = add(node);
  out_.nodes[static_cast<std::size_t>(sequence)].first = first;
  return sequence;
}

void ExpressionParser::parse_statements() {
  ExpressionNode node;
  node.where = tokens_.peek().where;
  const int first = statement(0);
  int last = first;
  int height = out_.nodes[static_cast<std::size_t>(first)].height;
  while (tokens_.peek().is(";")) {
    tokens_.take();
    if (tokens_.peek().kind == TokenKind::end) break;
    const int next = statement(0);
    out_.nodes[static_cast<std::size_t>(last)].sibling = next;
    height = std::max(height, out_.nodes[static_cast<std::size_t>(next)].height);
    last = next;
  }
  out_.root = last == first ? first : add_sequence(node, first, height);
}

void ExpressionParser::unknown_name(const Token& token) {
  std::vector<const char*> names;
  names.reserve(symbols_.size());
  for (std::uint32_t i = 0; i < symbols_.size(); ++i) names.push_back(symbols_[i].name.c_str());
  diagnostics_.fail(token.where, "unknown name " + quoted(token.text) + suggestion(token.text, names));
}

int ExpressionParser::name(int depth) {
  const Token token = tokens_.take();
  if (tokens_.peek().is("(")) return call(token, depth);
  if (tokens_.peek().is("::")) return model_namespace(token, depth);
  ExpressionNode node;
  node.where = token.where;
  if (const auto local = find_local(token.text)) {
    node.op = Op::local;
    node.index = *local;
    return add(node);
  }
  if (const auto symbol = symbols_.find(token.text)) {
    node.op = Op::variable;
    node.index = *symbol;
    return add(node);
  }
  const bool time = token.text == "Time", step = token.text == "TimeStep", argument = token.text == "Var";
  if (time || step || argument) {
    if (!run_time_ && time && symbols_.knows_time) {
      diagnostics_.warning(token.where,
                           "`Time` is the initial time, 0, while the deck is read; what changes with time "
                           "belongs in a `string` drive");
      node.op = Op::real;
      node.type = Type::real;
      return add(node);
    }
    if (!run_time_) {
      diagnostics_.fail(token.where, "not supported: the run-time variable " + quoted(token.text) +
                                         " while the deck is read (it belongs in a `string` drive)");
    }
    node.op = time ? Op::time : step ? Op::time_step : Op::argument;
    return add(node);
  }
  if (token.text == "Step") diagnostics_.fail(token.where, "not supported: the run-time variable `Step`");
  unknown_name(token);
}

int ExpressionParser::model_namespace(const Token& token, int depth) {
  tokens_.take();  // ::
  const Token member = tokens_.take();
  if (token.text == "model" && member.text == "drive" && find_drive_) return model_drive(token, depth);
  if (token.text != "model" || member.text != "current" || run_time_) {
    diagnostics_.fail(token.where, "not supported: the function " +
                                       quoted(std::string(token.text) + "::" + std::string(member.text)) +
                                       (run_time_ ? " in a run-time expression" : ""));
  }
  expect("(");
  const Token what = tokens_.take();
  if (what.kind != TokenKind::string || what.text != "L0") {
    diagnostics_.fail(what.where, "found " + described(what) + ", expected \"L0\"");
  }
  expect(")");
  ExpressionNode node;
  node.op = Op::model_current;
  node.where = token.where;
  return add(node);
}

int ExpressionParser::model_drive(const Token& token, int depth) {
  expect("(");
  const Token label = tokens_.take();
  Number number;
  if (label.kind == TokenKind::word) {
    const auto symbol = symbols_.find(label.text);
    if (!symbol) unknown_name(label);
    const Variable& variable = symbols_[*symbol];
    if (variable.broken) throw Reported{};
    number.type = variable.has_value ? variable.value.type : Type::string;
    number.integer = variable.value.integer;
  } else if (!read_number(label, &number)) {
    number.type = Type::string;
  }
  if (number.type != Type::integer || number.integer < 0) {
    diagnostics_.fail(label.where, "found " + described(label) + ", expected the label of a drive caller");
  }
  ExpressionNode node;
  node.op = Op::model_drive;
  node.where = token.where;
  node.index = static_cast<std::uint32_t>(out_.drives.size());
  out_.drives.push_back(find_drive_(label, static_cast<std::uint32_t>(number.integer)));
  expect(",");
  const int argument = assignment(depth + 1);
  expect(")");
  return add(node, argument);
}

int ExpressionParser::call(const Token& token, int depth) {
  const FunctionInfo* info = find_function(token.text);
  if (info == nullptr) {
    std::vector<const char*> names;
    for (const FunctionInfo& info : functions()) names.push_back(info.name);
    diagnostics_.fail(token.where, "unknown function " + quoted(token.text) + suggestion(token.text, names));
  }
  if (run_time_ && (info->id == Function::rand_ || info->id == Function::random_ || info->id == Function::seed ||
                    info->id == Function::sprintf_ || info->id == Function::stop)) {
    diagnostics_.fail(token.where, "not supported: the function " + quoted(token.text) + " in a run-time expression");
  }
  expect("(");
  ExpressionNode node;
  node.op = Op::call;
  node.where = token.where;
  node.index = static_cast<std::uint32_t>(info->id);
  int first = -1, last = -1, count = 0;
  if (!tokens_.peek().is(")")) {
    while (true) {
      const int argument = assignment(depth + 1);
      node.height = std::max(node.height, out_.nodes[static_cast<std::size_t>(argument)].height + 1);
      if (last >= 0) {
        out_.nodes[static_cast<std::size_t>(last)].sibling = argument;
      } else {
        first = argument;
      }
      last = argument;
      ++count;
      if (!tokens_.peek().is(",")) break;
      tokens_.take();
    }
  }
  expect(")");
  if (count < info->least || count > info->most) {
    diagnostics_.fail(token.where,
                      "the function " + quoted(token.text) + " takes " + std::to_string(info->least) +
                          (info->most > info->least ? " or " + std::to_string(info->most) : std::string()) +
                          (info->most == 1 ? " argument, not " : " arguments, not ") + std::to_string(count));
  }
  const int index = add(node);
  out_.nodes[static_cast<std::size_t>(index)].first = first;
  return index;
}

}  // namespace mbdae::reading
