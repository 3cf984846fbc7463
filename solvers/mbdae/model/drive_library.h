// The drives of the input language: ramp, sine, cosine, step, sums and products of drives, time.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "mbdae/model/drive.h"

namespace mbdae {

/// The time itself (`time`, and `direct` where nothing else is the argument).
class TimeDrive final : public Drive {
 public:
  Jet at(double t) const override { return {t, 1.0, 0.0}; }
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

/// v0 before `start`, v0 + amplitude afterwards (from t = start on).
class StepDrive final : public Drive {
 public:
  StepDrive(double start, double amplitude, double initial) : start_(start), amplitude_(amplitude), initial_(initial) {}
  Jet at(double t) const override;

 private:
  double start_, amplitude_, initial_;
};

/// v0 + A sin(w (t - start)) between start and end, v0 before, the last value afterwards.
class SineDrive final : public Drive {
 public:
  /// w [rad/s]; `duration` [s] may be infinite.
  SineDrive(double start, double w, double amplitude, double duration, double initial)
      : start_(start), w_(w), amplitude_(amplitude), duration_(duration), initial_(initial) {}
  Jet at(double t) const override;

 private:
  double start_, w_, amplitude_, duration_, initial_;
};

/// v0 + A (1 - cos(w (t - start))) between start and end, v0 before, the last value afterwards.
class CosineDrive final : public Drive {
 public:
  CosineDrive(double start, double w, double amplitude, double duration, double initial)
      : start_(start), w_(w), amplitude_(amplitude), duration_(duration), initial_(initial) {}
  Jet at(double t) const override;

 private:
  double start_, w_, amplitude_, duration_, initial_;
};

/// The sum of drives (`array`).
class SumDrive final : public Drive {
 public:
  explicit SumDrive(std::vector<DrivePtr> drives) : drives_(std::move(drives)) {}
  Jet at(double t) const override;

 private:
  std::vector<DrivePtr> drives_;
};

/// The product of two drives (`mult`).
class ProductDrive final : public Drive {
 public:
  ProductDrive(DrivePtr first, DrivePtr second) : first_(std::move(first)), second_(std::move(second)) {}
  Jet at(double t) const override;

 private:
  DrivePtr first_, second_;
};

}  // namespace mbdae
