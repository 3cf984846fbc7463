// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/drive/drive_library.h"

#include <algorithm>
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

std::uint64_t PiecewiseLinearDrive::piece(double t) const {
  const auto after = std::upper_bound(points_.begin(), points_.end(), t,
                                      [](double time, const auto& point) { return time < point.first; });
  return static_cast<std::uint64_t>(after - points_.begin());
}

Jet PiecewiseLinearDrive::at(double t) const {
  const std::size_t k = piece(t);
  if (k == 0) return {points_.front().second, 0.0, 0.0};
  if (k == points_.size()) return {points_.back().second, 0.0, 0.0};
  const auto& [t0, v0] = points_[k - 1];
  const auto& [t1, v1] = points_[k];
  const double slope = (v1 - v0) / (t1 - t0);
  return {v0 + slope * (t - t0), slope, 0.0};
}

Jet composed(const Drive& outer, const Jet& inner) {
  const Jet f = outer.at(inner.value);
  return compose(inner, f.value, f.rate, f.second);
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

std::uint64_t SumDrive::piece(double t) const {
  std::uint64_t sum = 0;
  for (const DrivePtr& drive : drives_) sum = mixed(sum, drive->piece(t));
  return sum;
}

bool SumDrive::has_pieces() const {
  for (const DrivePtr& drive : drives_) {
    if (drive->has_pieces()) return true;
  }
  return false;
}

void SumDrive::add_sensitivity(double t, double factor, std::vector<Sensitivity>& out) const {
  for (const DrivePtr& drive : drives_) drive->add_sensitivity(t, factor, out);
}

void SumDrive::known_jumps(std::vector<double>& times) const {
  for (const DrivePtr& drive : drives_) drive->known_jumps(times);
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
