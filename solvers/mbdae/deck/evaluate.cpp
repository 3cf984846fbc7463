// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/deck/evaluate.h"

#include <limits>

#include "mbdae/deck/evaluator_functions.h"

namespace mbdae::reading {

using evaluation::Evaluator;

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
    if (evaluation::has_branches(node)) return true;
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
