// Mathematical expressions as trees: what was written, not yet what it is worth.
//
// Operators from high to low: unary + - !, ^ (right to left), * / %, + -, comparisons, then && || ~| together from the
// left, = (right to left). A unary minus binds tighter than ^: -2^2 is 4. The left operand is evaluated first.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "mbdae/deck/diagnostic.h"
#include "mbdae/deck/lexer.h"
#include "mbdae/deck/value.h"

namespace mbdae::reading {

enum class Op : std::uint8_t {
  integer,
  real,
  text,
  variable,
  local,          ///< variable of a run-time expression
  time,           ///< run-time variable Time
  time_step,      ///< run-time variable TimeStep
  argument,       ///< run-time variable Var
  model_current,  ///< model::current("L0")
  model_drive,    ///< model::drive(label, argument) at run time
  plus,
  negate,
  logical_not,
  power,
  multiply,
  divide,
  modulo,
  add,
  subtract,
  greater,
  greater_equal,
  equal,
  less_equal,
  less,
  not_equal,
  logical_and,
  logical_or,
  logical_xor,
  assign,
  assign_local,
  declare,
  declare_local,
  call,
  sequence,  ///< ( a; b; c ), worth its last
};

enum class Function : std::uint8_t {
  abs_,
  acos_,
  acosh_,
  asin_,
  asinh_,
  atan_,
  atan2_,
  atanh_,
  actan,
  actan2,
  actanh,
  ceil_,
  copysign_,
  cos_,
  cosh_,
  ctan,
  ctanh,
  exp_,
  floor_,
  log_,
  log10_,
  max_,
  min_,
  par,
  print,
  ramp,
  rand_,
  random_,
  round_,
  seed,
  sign,
  sin_,
  sinh_,
  sprintf_,
  sqrt_,
  sramp,
  step,
  stop,
  tan_,
  tanh_,
  in_ll,
  in_le,
  in_el,
  in_ee,
  cast_boolean,
  cast_integer,
  cast_real,
  cast_string,
};

struct FunctionInfo {
  const char* name;
  Function id;
  std::uint8_t least, most;  ///< number of arguments
};

/// All functions.
std::span<const FunctionInfo> functions();

/// Null when there is no such function.
const FunctionInfo* find_function(std::string_view name);

struct ExpressionNode {
  Op op = Op::integer;
  Type type = Type::integer;    ///< declare: of the variable; literals: of the value
  bool constant = false;        ///< declare
  bool if_not_defined = false;  ///< declare: the variable existed, keep it
  std::uint32_t index = 0;      ///< variable, declare: symbol; text: index into texts; call: Function
  int height = 1;               ///< of the tree below
  int first = -1;               ///< first child
  int sibling = -1;             ///< next child of the same parent
  std::int64_t integer = 0;
  double real = 0.0;
  SourcePosition where;
};

struct Expression {
  std::vector<ExpressionNode> nodes;
  std::vector<std::string> texts;
  std::vector<std::string> locals;  ///< names of the variables that a run-time expression declares
  std::vector<Type> local_types;
  std::vector<DrivePtr> drives;  ///< that a run-time expression calls
  int root = -1;

  void clear() {
    nodes.clear();
    texts.clear();
    locals.clear();
    local_types.clear();
    drives.clear();
    root = -1;
  }
};

/// Nesting of parentheses, signs and exponents.
inline constexpr int kDeepestNesting = 200;
/// Height of a tree: a sum of n terms is n high.
inline constexpr int kHighestTree = 1000;

/// Fortran's 1.d0 as 1.e0.
std::string with_plain_exponent(std::string_view number);

/// The value of a number token. False if the token is no number, or one that does not fit its type.
bool read_number(const Token& token, Number* number);

/// Finds a drive caller by its label, or fails with a message.
using FindDrive = std::function<DrivePtr(const Token&, std::uint32_t)>;

/// Parses from a token stream until something that does not belong to an expression.
class ExpressionParser {
 public:
  ExpressionParser(TokenStream& tokens, Symbols& symbols, Diagnostics& diagnostics, Expression& out, bool run_time,
                   FindDrive find_drive = {})
      : tokens_(tokens),
        symbols_(symbols),
        diagnostics_(diagnostics),
        out_(out),
        run_time_(run_time),
        find_drive_(std::move(find_drive)) {}

  /// One expression, as an argument of a card.
  void parse_expression() { out_.root = assignment(0); }
  /// What stands in `set:`: a declaration or an expression.
  void parse_statement() { out_.root = statement(0); }
  /// Statements separated by `;`, worth the last one: what stands in a `string` drive.
  void parse_statements();
  /// Name of the variable being declared, "" when there is none (for recovery after an error).
  std::string_view declared() const { return declared_; }

 private:
  int statement(int depth);
  int local_declaration(ExpressionNode node, const Token& name, int depth);
  std::optional<std::uint32_t> find_local(std::string_view name) const;
  int assignment(int depth);
  int binary(int lowest, int depth);
  int power(int depth);
  int unary(int depth);
  int primary(int depth);
  int number();
  int name(int depth);
  int model_namespace(const Token& token, int depth);
  int model_drive(const Token& token, int depth);
  int call(const Token& token, int depth);
  int add(ExpressionNode node, int first = -1, int second = -1);
  int add_sequence(ExpressionNode node, int first, int height);
  void check_depth(int depth);
  void expect(std::string_view symbol);
  [[noreturn]] void unknown_name(const Token& token);

  TokenStream& tokens_;
  Symbols& symbols_;
  Diagnostics& diagnostics_;
  Expression& out_;
  bool run_time_;
  FindDrive find_drive_;
  std::string_view declared_;
};

}  // namespace mbdae::reading
