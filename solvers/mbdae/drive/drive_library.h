// The drives of the input language: ramp, sine, cosine, step, sums and products of drives, time.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

/// v0 before `start`, v0 + slope (t - start) up to `end`, constant from there on.
class RampDrive final : public Drive {
 public:
  /// slope [1/s], start and end [s] (end may be infinite).
  RampDrive(double slope, double start, double end, double initial)
      : slope_(slope), start_(start), end_(end), initial_(initial) {}
  Jet at(double t) const override;

 private:
  double slope_, start_, end_, initial_;
};

/// v0 before `start`, v0 + amplitude afterwards, (v0 + amplitude)/2 at t = start itself.
class StepDrive final : public Drive {
 public:
  StepDrive(double start, double amplitude, double initial) : start_(start), amplitude_(amplitude), initial_(initial) {}
  Jet at(double t) const override;

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

/// The sum of drives (`array`).
class SumDrive final : public Drive {
 public:
  explicit SumDrive(std::vector<DrivePtr> drives) : drives_(std::move(drives)) {}
  Jet at(double t) const override;
  Jet at_argument(double argument, double t) const override;
  bool reads_state() const override;
  void add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const override;

 private:
  std::vector<DrivePtr> drives_;
};

/// The product of two drives (`mult`).
class ProductDrive final : public Drive {
 public:
  ProductDrive(DrivePtr first, DrivePtr second) : first_(std::move(first)), second_(std::move(second)) {}
  Jet at(double t) const override;
  Jet at_argument(double argument, double t) const override;
  bool reads_state() const override { return first_->reads_state() || second_->reads_state(); }
  void add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const override;

 private:
  DrivePtr first_, second_;
};

}  // namespace mbdae
