// What an expression is worth: typed evaluation with doubles while a deck is read, with jets at run time.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "mbdae/deck/expression.h"
#include "mbdae/deck/value.h"
#include "mbdae/drive/drive.h"

namespace mbdae::reading {

/// An expression without a value: 1/0, an undefined variable, "a"*2, ...
struct EvaluationError {
  SourcePosition where;
  std::string message;
};

/// The cause has been reported where the variable was declared.
struct BrokenVariable {};

/// What an expression may see and change while a deck is read.
struct ReadingState {
  Symbols* symbols = nullptr;
  const double* current_length = nullptr;  ///< model::current("L0") [m]; null outside of a rod
  std::uint32_t random_state = 1;          ///< of `rand` and `random`: the same in every reading
};

/// Evaluates while reading. Throws EvaluationError or BrokenVariable.
Value<double> evaluate(const Expression& expression, ReadingState& state);

/// A string drive: an expression of Time, TimeStep and Var (which is Time unless a drive is nested in another).
/// Where the expression has no value (1/0, ...) value, rate and second derivative are NaN.
class StringDrive final : public Drive {
 public:
  /// Variables are looked up when the drive is evaluated, so `symbols` is shared with the reader.
  StringDrive(Expression expression, std::shared_ptr<const Symbols> symbols, double time_step)
      : expression_(std::move(expression)), symbols_(std::move(symbols)), time_step_(time_step) {
    for (const DrivePtr& drive : expression_.drives) size_.add(*drive);
  }
  Jet at(double t) const override;
  Jet at_argument(double argument, double t) const override;
  std::uint64_t piece(double t) const override;
  bool has_pieces() const override;
  int depth() const override { return size_.depth; }
  double count() const override { return size_.count; }
  void known_jumps(std::vector<double>& times) const override;

  /// As `at`, but throws EvaluationError or BrokenVariable instead of returning NaN.
  Jet checked(double t) const { return checked(Jet{t, 1.0, 0.0}, Jet{t, 1.0, 0.0}); }

 private:
  Jet checked(const Jet& time, const Jet& argument) const;
  Jet unchecked(const Jet& time, const Jet& argument) const;

  Expression expression_;
  std::shared_ptr<const Symbols> symbols_;
  double time_step_;  // [s]
  DriveSize size_;
};

}  // namespace mbdae::reading
