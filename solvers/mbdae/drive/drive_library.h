// The drives of the input language: ramp, sine, cosine, step, sums and products of drives, time.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "mbdae/drive/drive.h"

namespace mbdae {

/// The time itself (`time`, and `direct` where nothing else is the argument).
class TimeDrive final : public Drive {
 public:
  Jet at(double t) const override { return {t, 1.0, 0.0}; }
};

/// The time step, which does not change (`timestep`).
class TimeStepDrive final : public Drive {
 public:
  /// step [s]
  explicit TimeStepDrive(double step) : step_(step) {}
  Jet at(double) const override { return {step_, 0.0, 0.0}; }

 private:
  double step_;
};

/// a0 + a1 t + a2 t^2 + a3 t^3 (`linear`, `parabolic`, `cubic`).
class PolynomialDrive final : public Drive {
 public:
  explicit PolynomialDrive(const std::array<double, 4>& a) : a_(a) {}
  Jet at(double t) const override {
    return {a_[0] + t * (a_[1] + t * (a_[2] + t * a_[3])), a_[1] + t * (2.0 * a_[2] + t * 3.0 * a_[3]),
            2.0 * a_[2] + 6.0 * t * a_[3]};
  }

 private:
  std::array<double, 4> a_;
};

/// Straight lines between points, the first value before them, the last one after them (`piecewise linear`).
class PiecewiseLinearDrive final : public Drive {
 public:
  /// Times [s] in increasing order, at least one.
  explicit PiecewiseLinearDrive(std::vector<std::pair<double, double>> points) : points_(std::move(points)) {}
  Jet at(double t) const override;
  std::uint64_t piece(double t) const override;
  bool has_pieces() const override { return true; }
  void known_jumps(std::vector<double>& times) const override {
    for (const auto& [time, value] : points_) times.push_back(time);
  }

 private:
  std::vector<std::pair<double, double>> points_;
};

/// A drive of a drive: f(g(t)) (`drive`, and model::drive in strings).
Jet composed(const Drive& outer, const Jet& inner);

/// v0 before `start`, v0 + slope (t - start) up to `end`, constant from there on.
class RampDrive final : public Drive {
 public:
  /// slope [1/s], start and end [s] (end may be infinite).
  RampDrive(double slope, double start, double end, double initial)
      : slope_(slope), start_(start), end_(end), initial_(initial) {}
  Jet at(double t) const override;
  std::uint64_t piece(double t) const override { return t < start_ ? 0U : t < end_ ? 1U : 2U; }
  bool has_pieces() const override { return true; }
  void known_jumps(std::vector<double>& times) const override { times.insert(times.end(), {start_, end_}); }

 private:
  double slope_, start_, end_, initial_;
};

/// v0 before `start`, v0 + amplitude afterwards, (v0 + amplitude)/2 at t = start itself.
class StepDrive final : public Drive {
 public:
  StepDrive(double start, double amplitude, double initial) : start_(start), amplitude_(amplitude), initial_(initial) {}
  Jet at(double t) const override;
  std::uint64_t piece(double t) const override { return t < start_ ? 0U : t == start_ ? 1U : 2U; }
  bool has_pieces() const override { return true; }
  void known_jumps(std::vector<double>& times) const override { times.push_back(start_); }

 private:
  double start_, amplitude_, initial_;
};

/// v0 + wave(t - start) between start and start + duration, v0 before, the last value afterwards.
class WaveDrive : public Drive {
 public:
  /// w [rad/s]; start and duration [s], which may be infinite.
  WaveDrive(double start, double w, double amplitude, double duration, double initial)
      : w_(w), amplitude_(amplitude), start_(start), duration_(duration), initial_(initial) {}
  Jet at(double t) const final;
  std::uint64_t piece(double t) const final { return t < start_ ? 0U : t - start_ < duration_ ? 1U : 2U; }
  bool has_pieces() const final { return true; }
  void known_jumps(std::vector<double>& times) const final { times.insert(times.end(), {start_, start_ + duration_}); }

 protected:
  double w_, amplitude_;

 private:
  /// The wave `tau` [s] after its start, from zero.
  virtual Jet wave(double tau) const = 0;

  double start_, duration_, initial_;
};

/// wave = A sin(w tau)
class SineDrive final : public WaveDrive {
  using WaveDrive::WaveDrive;
  Jet wave(double tau) const override;
};

/// wave = A (1 - cos(w tau))
class CosineDrive final : public WaveDrive {
  using WaveDrive::WaveDrive;
  Jet wave(double tau) const override;
};

/// v0 + slope times the argument (`linear`); the time where nothing else is the argument.
class LinearDrive final : public Drive {
 public:
  LinearDrive(double initial, double slope) : initial_(initial), slope_(slope) {}
  Jet at(double t) const override { return {initial_ + slope_ * t, slope_, 0.0}; }

 private:
  double initial_, slope_;
};

/// 1 while another drive is not zero, otherwise 0: whether a driven element is there.
class GateDrive final : public Drive {
 public:
  explicit GateDrive(DrivePtr drive) : drive_(std::move(drive)) {}
  Jet at(double t) const override { return {drive_->value(t) != 0.0 ? 1.0 : 0.0, 0.0, 0.0}; }
  std::uint64_t piece(double t) const override { return drive_->value(t) != 0.0 ? 1U : 0U; }
  bool has_pieces() const override { return true; }
  void known_jumps(std::vector<double>& times) const override { drive_->known_jumps(times); }

 private:
  DrivePtr drive_;
};

/// The sum of drives (`array`).
class SumDrive final : public Drive {
 public:
  explicit SumDrive(std::vector<DrivePtr> drives) : drives_(std::move(drives)) {
    for (const DrivePtr& drive : drives_) size_.add(*drive);
  }
  int depth() const override { return size_.depth; }
  double count() const override { return size_.count; }
  Jet at(double t) const override;
  Jet at_argument(double argument, double t) const override;
  bool reads_state() const override;
  void add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const override;
  std::uint64_t piece(double t) const override;
  bool has_pieces() const override;
  void known_jumps(std::vector<double>& times) const override;

 private:
  std::vector<DrivePtr> drives_;
  DriveSize size_;
};

/// The product of two drives (`mult`).
class ProductDrive final : public Drive {
 public:
  ProductDrive(DrivePtr first, DrivePtr second) : first_(std::move(first)), second_(std::move(second)) {
    size_.add(*first_);
    size_.add(*second_);
  }
  int depth() const override { return size_.depth; }
  double count() const override { return size_.count; }
  Jet at(double t) const override;
  Jet at_argument(double argument, double t) const override;
  bool reads_state() const override { return first_->reads_state() || second_->reads_state(); }
  void add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const override;
  std::uint64_t piece(double t) const override { return mixed(first_->piece(t), second_->piece(t)); }
  bool has_pieces() const override { return first_->has_pieces() || second_->has_pieces(); }
  void known_jumps(std::vector<double>& times) const override {
    first_->known_jumps(times);
    second_->known_jumps(times);
  }

 private:
  DrivePtr first_, second_;
  DriveSize size_;
};

}  // namespace mbdae
