// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What lies near to places: of a surface, only that is drawn.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::resins {

/// The boxes of space that lie within some distance of places. Immutable and thread-safe once made.
class NearPlaces {
 public:
  /// `within_mm` > 0; places may be none.
  NearPlaces(const std::vector<Point3>& places, double within_mm);
  /// False only where no point of this box lies within the distance of a place.
  bool meets(const Point3& low, const Point3& high) const;

 private:
  std::size_t index(const std::array<int, 3>& cell) const {
    return (static_cast<std::size_t>(cell[2]) * static_cast<std::size_t>(size_[1]) +
            static_cast<std::size_t>(cell[1])) *
               static_cast<std::size_t>(size_[0]) +
           static_cast<std::size_t>(cell[0]);
  }
  /// The first and the last cell that a box meets; false where it lies beside all.
  bool cells_of(const Point3& low, const Point3& high, std::array<int, 3>& first,
                std::array<int, 3>& last) const;

  Point3 lower_{};
  double side_ = 1;
  std::array<int, 3> size_{};
  std::vector<std::uint64_t> marked_;
};

}  // namespace slicecorr::resins
