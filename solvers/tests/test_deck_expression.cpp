// Expressions against the rules of the input language and hand-computed values.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <numbers>

#include "mbdae/deck/evaluate.h"
#include "mbdae/deck/expression.h"
#include "test_deck_support.h"

namespace {

using mbdae::reading::Diagnostics;
using mbdae::reading::EvaluationError;
using mbdae::reading::Expression;
using mbdae::reading::ExpressionParser;
using mbdae::reading::Lexer;
using mbdae::reading::ReadingState;
using mbdae::reading::Reported;
using mbdae::reading::Symbols;
using mbdae::reading::TokenStream;
using mbdae::reading::Type;

struct Result {
  mbdae::reading::Value<double> value;
  std::string problem;
};

/// Evaluates statements separated by `;`, keeping variables; the last one's value.
Result evaluate(const std::string& text) {
  Diagnostics diagnostics;
  diagnostics.add_file("text");
  Symbols symbols;
  ReadingState state;
  state.symbols = &symbols;
  TokenStream tokens(Lexer(text, 0));
  Result result;
  try {
    while (true) {
      Expression expression;
      ExpressionParser parser(tokens, symbols, diagnostics, expression, false);
      parser.parse_statement();
      result.value = mbdae::reading::evaluate(expression, state);
      if (!tokens.peek().is(";")) break;
      tokens.take();
    }
    if (tokens.peek().kind != mbdae::reading::TokenKind::end) result.problem = "rest";
  } catch (const Reported&) {
    result.problem = diagnostics.take().front().message;
  } catch (const EvaluationError& error) {
    result.problem = error.message;
  }
  return result;
}

void check_integer(const std::string& text, std::int64_t expected) {
  INFO(text);
  const Result result = evaluate(text);
  CHECK(result.problem == "");
  CHECK(result.value.type == Type::integer);
  CHECK(result.value.integer == expected);
}

void check_real(const std::string& text, double expected) {
  INFO(text);
  const Result result = evaluate(text);
  CHECK(result.problem == "");
  CHECK(result.value.type == Type::real);
  CHECK(result.value.real == Approx(expected).epsilon(1e-15).margin(1e-300));
}

void check_bool(const std::string& text, bool expected) {
  INFO(text);
  const Result result = evaluate(text);
  CHECK(result.problem == "");
  CHECK(result.value.type == Type::boolean);
  CHECK((result.value.integer != 0) == expected);
}

void check_problem(const std::string& text, const std::string& expected) {
  INFO(text);
  CHECK(evaluate(text).problem == expected);
}

}  // namespace

TEST_CASE("literals have the type they are written in") {
  check_integer("12", 12);
  check_real("1.", 1.0);
  check_real(".5", 0.5);
  check_real("1e3", 1000.0);
  check_real("1.e-9", 1e-9);
  check_real("2.5E+2", 250.0);
  check_real("1.d0", 1.0);  // Fortran's exponent
  check_real("2.5D+2", 250.0);
  check_real("1e-400", 0.0);
  check_integer("2147483647", 2147483647);
  check_problem("2147483648",
                "the integer `2147483648` is larger than INT_MAX = 2147483647 (write it with a point for a real)");
  check_problem("1e999", "the number `1e999` is too large");
  check_problem("3abc", "found a number run into letters, expected a number or an expression");
}

TEST_CASE("integers divide to integers, reals do not") {
  check_integer("1/3", 0);
  check_integer("7/2", 3);
  check_integer("-7/2", -3);
  check_integer("-7 % 3", -1);
  check_real("1./3", 1.0 / 3.0);
  check_real("1/3.", 1.0 / 3.0);
  check_real("1/3*1.", 0.0);
  check_real("1.*1/4", 0.25);
  check_integer("2*3+4*5", 26);
}

TEST_CASE("the unary minus binds tighter than the power") {
  check_real("-2^2", 4.0);
  check_real("0-2^2", -4.0);
  check_real("2^3^2", 512.0);
  check_real("(2^3)^2", 64.0);
  check_real("2^-1", 0.5);
  check_real("2.^-2", 0.25);
  check_real("4.^0.5", 2.0);
  check_integer("--3", 3);
  check_integer("- -+3", 3);
  check_integer("2*-3", -6);
}

TEST_CASE("operators bind in the order of the language") {
  check_real("1+2*3^2", 19.0);
  check_integer("10-4-3", 3);
  check_integer("100/10/5", 2);
  check_bool("1+1 == 2", true);
  check_bool("1 < 2 && 3 < 2", false);
  check_bool("TRUE || FALSE && FALSE", false);  // one level, from the left
  check_bool("TRUE ~| FALSE && FALSE", false);
  check_bool("TRUE ~| TRUE || TRUE", true);
  check_bool("FALSE && FALSE || TRUE", true);
  check_bool("TRUE ~| FALSE", true);
  check_bool("!TRUE || TRUE", true);
  check_bool("!(TRUE || TRUE)", false);
  check_bool("3 >= 3", true);
  check_bool("3 != 3.", false);
  check_bool("\"a\" < \"b\"", true);
  check_bool("FALSE && 1/0 > 0", false);
  check_bool("TRUE || 1/0 > 0", true);
}

TEST_CASE("the left operand comes first") {
  check_integer("integer I = 5; (I = 3) + I", 6);
  check_integer("integer I = 5; I + (I = 3)", 8);
  check_bool("integer I = 5; I == (I = 3)", false);
  check_integer("integer I = 5; FALSE && (I = 3); I", 5);
}

TEST_CASE("variables are declared, assigned, kept and cast") {
  check_real("real A = 2; A*3", 6.0);
  check_integer("integer I = 3; I/2", 1);
  check_integer("integer I = 4.; I", 4);
  check_integer("integer I; I = 5; I+1", 6);
  check_integer("integer I; integer J; I = J = 7; I+J", 14);
  check_integer("const integer K = 1; ifndef const integer K = 2; K", 1);
  check_real("(real x = 3.; real y = 4.; sqrt(x^2 + y^2))", 5.0);
  check_real("real(1)/3", 1.0 / 3.0);
  check_integer("integer(-2.9)", -2);
  check_bool("bool(0.5)", true);
  check_real("real_eval(1)", 1.0);
  check_real("real a = 1.; real A = 2.; a", 1.0);
  check_problem("const real A", "the constant `A` needs a value: `= ...`");
  check_problem("const real A = 1.; A = 2.", "the constant `A` cannot be changed");
  check_problem("real A = 1.; real A = 2.",
                "the variable `A` is declared already (use `set: A = ...;` to change it, `ifndef` to keep it)");
  check_problem("real A; A+1.", "the variable `A` has no value yet");
  check_problem("real A = A", "unknown name `A`");
  check_problem("integer I = 2.5", "found 2.5, expected an integer (write integer(...) to cut it off)");
  check_problem("2 = 3", "only a variable can stand left of `=` (the comparison is `==`)");
  check_problem("pi = 3.", "the constant `pi` cannot be changed");
  check_problem("real Time = 3.", "`Time` is a run-time variable of the language, choose another name");
}

TEST_CASE("strings are joined and formatted") {
  CHECK(evaluate("\"a\" + \"b\" + 1").value.text == "ab1");
  CHECK(evaluate("sprintf(\"%03d%%\", 7)").value.text == "007%");
  CHECK(evaluate("sprintf(\"x = %.2f m\", 1.234)").value.text == "x = 1.23 m");
  CHECK(evaluate("sprintf(\"<%s>\", \"a\")").value.text == "<a>");
  check_problem("sprintf(\"%s\", 1)", "sprintf cannot write a value of type integer as `%s`");
  check_problem("sprintf(\"%d %d\", 1)", "sprintf wants one conversion (%d, %g, %s, ...) in its format");
  check_problem("sprintf(\"%n\", 1)", "sprintf cannot write a value of type integer as `%n`");
  check_problem("\"a\" * 2", "found the string `a`, expected a number");
}

TEST_CASE("functions and constants") {
  const double pi = std::numbers::pi;
  check_real("pi", pi);
  check_real("e", std::numbers::e);
  check_real("180.*deg2rad", pi);
  check_real("1.*rad2deg", 180.0 / pi);
  check_real("12.*in2m - ft2m + 1.", 1.0);
  check_real("slug2kg", 14.593902937206364);  // lbf s^2 / ft: 0.45359237 * 9.80665 / 0.3048
  check_real("lb2kg", 0.45359237);
  check_real("sin(0.3)", std::sin(0.3));
  check_real("acos(-1.)", pi);
  check_real("atan2(1., -1.)", 0.75 * pi);
  check_real("actan2(1., 2.)", std::atan2(2.0, 1.0));
  check_real("actan(2.)", std::atan(0.5));
  check_real("ctan(0.3)", 1.0 / std::tan(0.3));
  check_real("actanh(2.)", std::atanh(0.5));
  check_real("ctanh(0.7)", 1.0 / std::tanh(0.7));
  check_real("log10(1000.)", 3.0);
  check_real("copysign(2., -0.5)", -2.0);
  check_real("abs(-2.5)", 2.5);
  check_real("abs(-2)", 2.0);
  check_real("ceil(1.2)", 2.0);
  check_real("floor(-1.2)", -2.0);
  check_real("round(2.5)", 2.0);
  check_real("round(3.5)", 4.0);
  check_real("round(-0.4)", 0.0);
  check_integer("sign(-3.)", -1);
  check_real("max(2, 3)", 3.0);
  check_real("min(2, 3.)", 2.0);
  check_real("ramp(-1.)", 0.0);
  check_real("ramp(2.)", 2.0);
  check_real("sramp(3., 2.)", 2.0);
  check_real("sramp(1., 2.)", 1.0);
  check_real("step(-1.)", 0.0);
  check_real("step(1.)", 1.0);
  check_real("step(0)", 0.5);
  check_real("par(3.)", 9.0);
  check_real("in_ll(1., 1., 2.)", 0.0);
  check_real("in_el(1., 1., 2.)", 1.0);
  check_real("in_le(1., 2., 2.)", 1.0);
  check_real("in_ee(1., 2., 2.)", 1.0);
  check_bool("INT_MAX == 2147483647", true);
  check_bool("random() == random()", false);
  check_problem("sin(1., 2.)", "the function `sin` takes 1 argument, not 2");
  check_problem("atan2(1.)", "the function `atan2` takes 2 arguments, not 1");
  check_problem("sine(1.)", "unknown function `sine`; did you mean `sin`?");
  check_problem("stop(1 > 0)", "the deck asks to stop here");
}

TEST_CASE("what has no value is said so") {
  check_problem("1/0", "division by zero");
  check_problem("1./0.", "division by zero");
  check_problem("1 % 0", "division by zero");
  check_problem("1. % 2", "`%` is for integers, found a real");
  check_problem("sqrt(-1.)", "the result of sqrt is not a finite number");
  check_problem("log(0.)", "the result of log is not a finite number");
  check_problem("exp(1000.)", "the result of exp is not a finite number");
  check_problem("1e300*1e300", "the result of `*` is not a finite number");
  check_problem("INT_MAX + 1", "integer overflow: the result 2147483648 is out of range");
  check_real("2^40", 1099511627776.0);
  check_real("floor(1e20)", 1e20);
  check_problem("0^-1", "division by zero");
  check_problem("integer I = 2^40", "1099511627776 does not fit in an integer");
  check_problem("Time",
                "not supported: the run-time variable `Time` while the deck is read (it belongs in a `string` drive)");
  check_problem("HAND_L", "unknown name `HAND_L`");
  check_problem("real HAND_L = 1.; HAND_LL", "unknown name `HAND_LL`; did you mean `HAND_L`?");
  check_problem("model::node::structural(1, \"X[1]\")", "not supported: the function `model::node`");
  check_problem("(1 + 2", "found the end of the file, expected `)`");
  check_problem("1 +", "found the end of the file, expected a number or an expression");
}

TEST_CASE("nesting has a limit, not the stack") {
  check_integer(std::string(199, '(') + "1" + std::string(199, ')'), 1);
  const std::string message = "expression nested deeper than 200 levels";
  check_problem(std::string(100000, '('), message);
  check_problem(std::string(100000, '-') + "1", message);
  std::string powers;
  for (int i = 0; i < 100000; ++i) powers += "1^";
  check_problem(powers + "1", message);
  std::string sum = "1";
  for (int i = 0; i < 900; ++i) sum += "+1";
  check_integer(sum, 901);
  for (int i = 0; i < 200; ++i) sum += "+1";
  check_problem(sum, "expression with more than 1000 operations in a row: split it with `set:`");
}
