// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/drive/drive_library.h"

#include <cmath>

#include "mbdae/drive/drive_jet.h"

namespace mbdae {

Jet RampDrive::at(double t) const {
  if (t < start_) return {initial_, 0.0, 0.0};
  if (t < end_) return {initial_ + slope_ * (t - start_), slope_, 0.0};
  return {initial_ + slope_ * (end_ - start_), 0.0, 0.0};
}

Jet StepDrive::at(double t) const {
  if (t == start_) return {0.5 * (initial_ + amplitude_), 0.0, 0.0};
  return {t < start_ ? initial_ : initial_ + amplitude_, 0.0, 0.0};
}

Jet WaveDrive::at(double t) const {
  const double tau = t - start_;
  if (tau < 0.0) return {initial_, 0.0, 0.0};
  if (tau >= duration_) return {initial_ + wave(duration_).value, 0.0, 0.0};
  const Jet jet = wave(tau);
  return {initial_ + jet.value, jet.rate, jet.second};
}

Jet SineDrive::wave(double tau) const {
  const double s = std::sin(w_ * tau), c = std::cos(w_ * tau);
  return {amplitude_ * s, amplitude_ * w_ * c, -amplitude_ * w_ * w_ * s};
}

Jet CosineDrive::wave(double tau) const {
  const double s = std::sin(w_ * tau), c = std::cos(w_ * tau);
  return {amplitude_ * (1.0 - c), amplitude_ * w_ * s, amplitude_ * w_ * w_ * c};
}

Jet SumDrive::at(double t) const {
  Jet sum;
  for (const DrivePtr& drive : drives_) sum = sum + drive->at(t);
  return sum;
}

Jet SumDrive::at_argument(double argument, double t) const {
  Jet sum;
  for (const DrivePtr& drive : drives_) sum = sum + drive->at_argument(argument, t);
  return sum;
}

bool SumDrive::reads_state() const {
  for (const DrivePtr& drive : drives_) {
    if (drive->reads_state()) return true;
  }
  return false;
}

void SumDrive::add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const {
  for (const DrivePtr& drive : drives_) drive->add_sensitivity(t, factor, out);
}

Jet ProductDrive::at(double t) const { return first_->at(t) * second_->at(t); }

Jet ProductDrive::at_argument(double argument, double t) const {
  return first_->at_argument(argument, t) * second_->at_argument(argument, t);
}

void ProductDrive::add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const {
  first_->add_sensitivity(t, factor * second_->value(t), out);
  second_->add_sensitivity(t, factor * first_->value(t), out);
}

}  // namespace mbdae
