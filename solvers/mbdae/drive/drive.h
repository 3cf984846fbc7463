// Drives: scalar functions of time with their first and second time derivatives, and vectors made of them.
//
// Derivatives are needed because driven constraints enter the velocity and acceleration constraints.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

namespace mbdae {

/// A value with its first and second time derivative.
struct Jet {
  double value = 0.0;
  double rate = 0.0;
  double second = 0.0;
};

class Signal;

/// Derivative of a drive's value by a quantity of the state that it reads.
struct Sensitivity {
  const Signal* signal = nullptr;
  double derivative = 0.0;
};

/// A scalar function of time [s].
class Drive {
 public:
  virtual ~Drive() = default;

  /// Value and derivatives at time t. At kinks (ramp ends) the derivative of the branch entered at t.
  virtual Jet at(double t) const = 0;

  /// As a drive within another: a function of the outer drive's `argument`, its derivatives by that; `t` is the time.
  virtual Jet at_argument(double argument, double /*t*/) const { return at(argument); }

  /// True if the value depends on the model's state (drive/signal.h).
  virtual bool reads_state() const { return false; }

  /// Adds `factor` times the derivatives of the value by what it reads of the state.
  virtual void add_sensitivity(double /*t*/, double /*factor*/, std::vector<Sensitivity>& /*out*/) const {}

  double value(double t) const { return at(t).value; }

  /// A number that tells which smooth piece holds at time t: it changes where value or derivatives jump.
  virtual std::uint64_t piece(double /*t*/) const { return 0; }
  /// False if the drive is one smooth piece.
  virtual bool has_pieces() const { return false; }
  /// Drives within drives: how many levels, how many in all. Evaluation recurs that deep and costs that much.
  virtual int depth() const { return 1; }
  virtual double count() const { return 1.0; }
  /// Adds the times of jumps that are known beforehand [s].
  virtual void known_jumps(std::vector<double>& /*times*/) const {}
};

/// Depth and count of a drive with parts.
struct DriveSize {
  int depth = 1;
  double count = 1.0;
  void add(const Drive& part) {
    depth = std::max(depth, part.depth() + 1);
    count += part.count();
  }
};

/// Mixes a number into another: pieces of drives that are made of drives.
inline std::uint64_t mixed(std::uint64_t one, std::uint64_t other) { return (one ^ other) * 1099511628211U + 1; }

using DrivePtr = std::shared_ptr<const Drive>;

/// The constant drive; also what a bare number in a deck becomes.
class ConstDrive final : public Drive {
 public:
  explicit ConstDrive(double value) : value_(value) {}
  Jet at(double) const override { return {value_, 0.0, 0.0}; }

 private:
  double value_;
};

/// A vector function of time: sum of constant directions times drives. Empty = zero.
template <int N>
struct VectorDrive {
  using Vector = Eigen::Matrix<double, N, 1>;
  struct Term {
    Vector direction;
    DrivePtr drive;
  };
  std::vector<Term> terms;

  bool reads_state() const {
    for (const Term& term : terms) {
      if (term.drive->reads_state()) return true;
    }
    return false;
  }

  /// Value (derivative = 0), rate (1) or second derivative (2) at time t.
  Vector at(double t, int derivative = 0) const {
    Vector sum = Vector::Zero();
    for (const Term& term : terms) {
      const Jet jet = term.drive->at(t);
      sum += term.direction * (derivative == 0 ? jet.value : derivative == 1 ? jet.rate : jet.second);
    }
    return sum;
  }
};

}  // namespace mbdae
