// Scalar functions: constants, exponentials, logarithms, powers, lines, broken lines, and what is made of two others.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <utility>
#include <vector>

#include "mbdae/deck/scalar_reader.h"

namespace mbdae::reading {

namespace {

class Constant final : public ScalarFunction {
 public:
  explicit Constant(double value) : value_(value) {}
  double value(double) const override { return value_; }
  double slope(double) const override { return 0.0; }

 private:
  double value_;
};

/// multiplier exp(rate x)
class Exponential final : public ScalarFunction {
 public:
  Exponential(double multiplier, double rate) : multiplier_(multiplier), rate_(rate) {}
  double value(double x) const override { return multiplier_ * std::exp(rate_ * x); }
  double slope(double x) const override { return rate_ * value(x); }

 private:
  double multiplier_, rate_;
};

/// multiplier log(coefficient x)
class Logarithm final : public ScalarFunction {
 public:
  Logarithm(double multiplier, double coefficient) : multiplier_(multiplier), coefficient_(coefficient) {}
  double value(double x) const override { return multiplier_ * std::log(coefficient_ * x); }
  double slope(double x) const override { return multiplier_ / x; }

 private:
  double multiplier_, coefficient_;
};

class Power final : public ScalarFunction {
 public:
  explicit Power(double exponent) : exponent_(exponent) {}
  double value(double x) const override { return std::pow(x, exponent_); }
  double slope(double x) const override { return exponent_ == 0.0 ? 0.0 : exponent_ * std::pow(x, exponent_ - 1.0); }

 private:
  double exponent_;
};

/// Straight lines between points, the outer ones going on unless held.
class BrokenLine final : public ScalarFunction {
 public:
  BrokenLine(std::vector<double> x, std::vector<double> y, bool hold)
      : x_(std::move(x)), y_(std::move(y)), hold_(hold) {}
  double value(double x) const override {
    const std::size_t i = piece(x);
    if (held(x)) return x < x_.front() ? y_.front() : y_.back();
    return y_[i] + (y_[i + 1] - y_[i]) * (x - x_[i]) / (x_[i + 1] - x_[i]);
  }
  double slope(double x) const override {
    const std::size_t i = piece(x);
    return held(x) ? 0.0 : (y_[i + 1] - y_[i]) / (x_[i + 1] - x_[i]);
  }

 private:
  bool held(double x) const { return hold_ && (x < x_.front() || x > x_.back()); }
  std::size_t piece(double x) const {
    std::size_t i = 0;
    while (i + 2 < x_.size() && x >= x_[i + 1]) ++i;
    return i;
  }

  std::vector<double> x_, y_;
  bool hold_;
};

enum class Operation { sum, difference, product, quotient };

class Combined final : public ScalarFunction {
 public:
  Combined(Operation operation, ScalarFunctionPtr first, ScalarFunctionPtr second)
      : operation_(operation), first_(std::move(first)), second_(std::move(second)) {}
  double value(double x) const override {
    const double a = first_->value(x), b = second_->value(x);
    switch (operation_) {
      case Operation::sum:
        return a + b;
      case Operation::difference:
        return a - b;
      case Operation::product:
        return a * b;
      default:
        return a / b;
    }
  }
  double slope(double x) const override {
    const double a = first_->value(x), b = second_->value(x), da = first_->slope(x), db = second_->slope(x);
    switch (operation_) {
      case Operation::sum:
        return da + db;
      case Operation::difference:
        return da - db;
      case Operation::product:
        return da * b + a * db;
      default:
        return (da - a / b * db) / b;
    }
  }

 private:
  Operation operation_;
  ScalarFunctionPtr first_, second_;
};

/// [base, b,] [coefficient, c,] multiplier
struct Scaled {
  double log_base = 1.0, coefficient = 1.0, multiplier = 1.0;
};

Scaled read_scaled(Input& input) {
  Scaled out;
  if (input.take("base")) {
    const SourcePosition where = input.where();
    const double base = input.positive("the base");
    if (base == 1.0) input.fail(where, "found base 1, expected another positive number");
    out.log_base = std::log(base);
  }
  if (input.take("coefficient")) out.coefficient = input.real("the coefficient");
  out.multiplier = input.real("the multiplier");
  return out;
}

ScalarFunctionPtr read_broken_line(Input& input) {
  const bool hold = input.take("do not extrapolate");
  std::vector<double> x, y;
  const SourcePosition where = input.where();
  while (true) {
    input.need("a point or `end`");
    if (input.take("end")) break;
    x.push_back(input.real("an abscissa"));
    y.push_back(input.real("an ordinate"));
    if (x.size() > 1 && !(x.back() > x[x.size() - 2])) {
      input.fail(where, "the abscissae must increase");
    }
  }
  if (x.size() < 2) input.fail(where, "found " + std::to_string(x.size()) + " points, expected 2 or more");
  return std::make_shared<const BrokenLine>(std::move(x), std::move(y), hold);
}

}  // namespace

ScalarFunctionPtr broken_line(std::vector<double> x, std::vector<double> y) {
  return std::make_shared<const BrokenLine>(std::move(x), std::move(y), false);
}

ScalarFunctionPtr scalar_function(Context& context) {
  Input& input = context.input;
  const SourcePosition where = input.where();
  const std::string name = input.string("the name of a scalar function in quotes");
  const auto found = context.scalar_functions.find(name);
  if (found == context.scalar_functions.end()) {
    input.fail(where, "the scalar function \"" + name + "\" is not defined before this card");
  }
  if (found->second == nullptr) throw Reported{};
  return found->second;
}

void read_scalar_function(Context& context) {
  static constexpr const char* kTypes[] = {"const", "exp", "log", "pow", "linear",
                                           "sum",   "sub", "mul", "div", "multilinear"};
  static constexpr const char* kOthers[] = {"cubic natural spline", "cubicspline", "chebychev",
                                            "chebychev interpolation", "gaussian"};
  Input& input = context.input;
  const SourcePosition where = input.where();
  const std::string name = input.string("the name of the function in quotes");
  const auto [entry, added] = context.scalar_functions.emplace(name, nullptr);
  if (!added) input.fail(where, "the scalar function \"" + name + "\" is defined already");
  input.need([&] { return "the type of the function: " + joined(kTypes); });
  if (const auto words = input.peek_words()) {
    for (const char* other : kOthers) {
      if (words->is(other)) input.fail(words->where, std::string("not supported: the scalar function `") + other + "`");
    }
  }
  const int type = input.keyword(kTypes, "scalar function");
  ScalarFunctionPtr function;
  switch (type) {
    case 0:
      function = std::make_shared<const Constant>(input.real("the value"));
      break;
    case 1: {
      const Scaled of = read_scaled(input);
      function = std::make_shared<const Exponential>(of.multiplier, of.log_base * of.coefficient);
      break;
    }
    case 2: {
      const Scaled of = read_scaled(input);
      function = std::make_shared<const Logarithm>(of.multiplier / of.log_base, of.coefficient);
      break;
    }
    case 3:
      function = std::make_shared<const Power>(input.real("the exponent"));
      break;
    case 4: {
      const double x1 = input.real("the first abscissa"), y1 = input.real("the first ordinate");
      const SourcePosition second = input.where();
      const double x2 = input.real("the second abscissa"), y2 = input.real("the second ordinate");
      if (x1 == x2) input.fail(second, "both points of the line have the same abscissa");
      const bool ordered = x1 < x2;
      function = std::make_shared<const BrokenLine>(ordered ? std::vector<double>{x1, x2} : std::vector<double>{x2, x1},
                                                    ordered ? std::vector<double>{y1, y2} : std::vector<double>{y2, y1},
                                                    false);
      break;
    }
    case 9:
      function = read_broken_line(input);
      break;
    default: {
      ScalarFunctionPtr first = scalar_function(context);
      function = std::make_shared<const Combined>(static_cast<Operation>(type - 5), std::move(first),
                                                  scalar_function(context));
    }
  }
  input.end_card();
  entry->second = std::move(function);
}

}  // namespace mbdae::reading
