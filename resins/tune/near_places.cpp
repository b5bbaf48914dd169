// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tune/near_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace slicecorr::resins {

namespace {

/// A cell is so much of the distance wide, so that little more than what is near is taken.
constexpr double kCellShare = 1.0 / 3;
/// Cells of a large part are wider: 16 MiB of bits.
constexpr double kMostCells = 1 << 27;

}  // namespace

NearPlaces::NearPlaces(const std::vector<Point3>& places, double within_mm) {
  if (places.empty()) return;
  Point3 low = places[0], high = places[0];
  for (const Point3& p : places) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  double cells = 1;
  side_ = kCellShare * within_mm;
  for (std::size_t k = 0; k < 3; ++k) {
    lower_[k] = low[k] - within_mm;
    cells *= (high[k] + within_mm - lower_[k]) / side_ + 1;
  }
  side_ *= std::max(1.0, std::cbrt(cells / kMostCells));
  for (std::size_t k = 0; k < 3; ++k) {
    size_[k] = static_cast<int>((high[k] + within_mm - lower_[k]) / side_) + 1;
  }
  const std::array<int, 3> end{0, 0, size_[2]};
  marked_.assign(index(end) / 64 + 1, 0);
  for (const Point3& p : places) {
    Point3 from = p, to = p;
    for (std::size_t k = 0; k < 3; ++k) {
      from[k] -= within_mm;
      to[k] += within_mm;
    }
    std::array<int, 3> first{}, last{}, cell{};
    cells_of(from, to, first, last);
    for (cell[2] = first[2]; cell[2] <= last[2]; ++cell[2]) {
      for (cell[1] = first[1]; cell[1] <= last[1]; ++cell[1]) {
        for (cell[0] = first[0]; cell[0] <= last[0]; ++cell[0]) {
          const std::size_t at = index(cell);
          marked_[at / 64] |= std::uint64_t{1} << (at % 64);
        }
      }
    }
  }
}

bool NearPlaces::cells_of(const Point3& low, const Point3& high, std::array<int, 3>& first,
                          std::array<int, 3>& last) const {
  for (std::size_t k = 0; k < 3; ++k) {
    const double from = std::floor((low[k] - lower_[k]) / side_),
                 to = std::floor((high[k] - lower_[k]) / side_);
    if (to < 0 || from >= size_[k]) return false;
    first[k] = static_cast<int>(std::max(0.0, from));
    last[k] = static_cast<int>(std::min(size_[k] - 1.0, to));
  }
  return true;
}

bool NearPlaces::meets(const Point3& low, const Point3& high) const {
  std::array<int, 3> first{}, last{}, cell{};
  if (marked_.empty() || !cells_of(low, high, first, last)) return false;
  for (cell[2] = first[2]; cell[2] <= last[2]; ++cell[2]) {
    for (cell[1] = first[1]; cell[1] <= last[1]; ++cell[1]) {
      for (cell[0] = first[0]; cell[0] <= last[0]; ++cell[0]) {
        const std::size_t at = index(cell);
        if (marked_[at / 64] >> (at % 64) & 1) return true;
      }
    }
  }
  return false;
}

}  // namespace slicecorr::resins
