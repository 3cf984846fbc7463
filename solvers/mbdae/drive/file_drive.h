// Drives that read a column of numbers over time from a file (`file`).
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "mbdae/drive/drive.h"

namespace mbdae {

/// What a file driver has read: rows of numbers, each at its time.
struct FileTable {
  std::vector<double> times;    ///< [s], increasing, at least one
  std::vector<double> numbers;  ///< row by row
  std::size_t columns = 0;      ///< numbers of a row
  bool straight = true;         ///< straight lines between rows; otherwise a row holds until the next
  bool zero_outside = true;     ///< before the first and after the last row; otherwise these hold on
  double at(std::size_t row, std::size_t column) const { return numbers[row * columns + column]; }
};
using FileTablePtr = std::shared_ptr<const FileTable>;

/// amplitude times a column (counted from 0) of a table at the present time.
class FileDrive final : public Drive {
 public:
  FileDrive(FileTablePtr table, std::size_t column, double amplitude)
      : table_(std::move(table)), column_(column), amplitude_(amplitude) {}
  Jet at(double t) const override;
  /// Within another drive it is still one of the time.
  Jet at_argument(double /*argument*/, double t) const override { return {at(t).value, 0.0, 0.0}; }
  std::uint64_t piece(double t) const override;
  bool has_pieces() const override { return true; }
  void known_jumps(std::vector<double>& times) const override {
    times.insert(times.end(), table_->times.begin(), table_->times.end());
  }

 private:
  FileTablePtr table_;
  std::size_t column_;
  double amplitude_;
};

}  // namespace mbdae
