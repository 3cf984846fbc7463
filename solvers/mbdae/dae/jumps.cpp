// SPDX-License-Identifier: BSD-3-Clause
#include "mbdae/dae/jumps.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mbdae {

namespace {

constexpr double kForever = std::numeric_limits<double>::infinity();
constexpr std::size_t kMostPoints = 1000000;  // of the grid that jumps are looked for on

double next_after(double t) { return std::nextafter(t, kForever); }

/// The jumps of one drive between a and b, where its pieces differ.
void bisect(const Drive& drive, double a, double b, std::vector<Jump>* out) {
  const std::uint64_t piece = drive.piece(a);
  while (next_after(a) < b) {
    const double middle = a + 0.5 * (b - a);
    if (middle <= a || middle >= b) break;
    (drive.piece(middle) == piece ? a : b) = middle;
  }
  // An instant by itself, as that of a step, is part of the jump.
  while (drive.piece(next_after(b)) != drive.piece(b) && b - a < 1e-9 * (1.0 + std::abs(b))) b = next_after(b);
  out->push_back({a, b});
}

std::vector<double> grid(const std::vector<DrivePtr>& drives, const InitialValueData& settings) {
  const double t0 = settings.initial_time, t1 = settings.final_time;
  std::vector<double> points{t0, next_after(t0), t1};
  for (const DrivePtr& drive : drives) {
    std::vector<double> known;
    drive->known_jumps(known);
    for (const double t : known) {
      for (const double near : {std::nextafter(t, -kForever), next_after(t)}) {
        if (near > t0 && near < t1) points.push_back(near);
      }
    }
  }
  const double count = std::min((t1 - t0) / settings.time_step, static_cast<double>(kMostPoints));
  for (std::size_t k = 1; static_cast<double>(k) < count; ++k) {
    points.push_back(t0 + (t1 - t0) * (static_cast<double>(k) / count));
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace

std::vector<Jump> find_jumps(const std::vector<DrivePtr>& drives, const InitialValueData& settings) {
  std::vector<Jump> found;
  if (drives.empty() || !(settings.final_time > settings.initial_time)) return found;
  std::vector<DrivePtr> each = drives;
  std::sort(each.begin(), each.end());
  each.erase(std::unique(each.begin(), each.end()), each.end());
  const std::vector<double> points = grid(each, settings);
  for (const DrivePtr& drive : each) {
    std::uint64_t piece = drive->piece(points.front());
    for (std::size_t i = 1; i < points.size(); ++i) {
      // Several jumps between two points: one after the other.
      for (double a = points[i - 1]; drive->piece(points[i]) != piece && a < points[i];) {
        bisect(*drive, a, points[i], &found);
        a = std::min(found.back().after, points[i]);
        piece = drive->piece(a);
      }
    }
  }
  std::sort(found.begin(), found.end(), [](const Jump& one, const Jump& other) { return one.before < other.before; });
  std::vector<Jump> merged;
  for (const Jump& jump : found) {
    if (!merged.empty() && jump.before <= merged.back().after) {
      merged.back().after = std::max(merged.back().after, jump.after);
    } else {
      merged.push_back(jump);
    }
  }
  return merged;
}

}  // namespace mbdae
