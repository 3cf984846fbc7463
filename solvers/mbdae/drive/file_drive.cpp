// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/drive/file_drive.h"

#include <algorithm>

namespace mbdae {

std::uint64_t FileDrive::piece(double t) const {
  const std::vector<double>& times = table_->times;
  const auto behind = static_cast<std::uint64_t>(std::upper_bound(times.begin(), times.end(), t) - times.begin());
  return t > times.back() ? behind + 1 : behind;  // the last instant is still inside
}

Jet FileDrive::at(double t) const {
  const std::vector<double>& times = table_->times;
  const std::size_t behind = piece(t), last = times.size() - 1;
  if (behind == 0 || behind > last + 1) {
    if (table_->zero_outside) return {};
    return {amplitude_ * table_->at(behind == 0 ? 0 : last, column_), 0.0, 0.0};
  }
  const std::size_t row = behind - 1;
  const double here = table_->at(row, column_);
  if (!table_->straight || row == last) return {amplitude_ * here, 0.0, 0.0};
  const double slope = (table_->at(row + 1, column_) - here) / (times[row + 1] - times[row]);
  return {amplitude_ * (here + slope * (t - times[row])), amplitude_ * slope, 0.0};
}

}  // namespace mbdae
