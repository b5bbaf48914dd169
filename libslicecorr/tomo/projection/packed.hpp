// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Some slices of a part, put together into blocks of their own, so that no lane is spent on others.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo::detail {

class PackedSlices {
 public:
  /// `slices` of the projector, at least one.
  PackedSlices(const Projector& projector, const std::vector<int>& slices)
      : from_(projector.shape()),
        slices_(slices),
        projector_(projector.of_slices(slices)),
        to_(projector_->shape()) {}

  const Projector& projector() const { return *projector_; }
  std::size_t blocks() const { return to_.blocks(); }
  /// The slices of a block, lane by lane.
  std::vector<int> of_block(std::size_t block) const {
    const auto lanes = static_cast<std::size_t>(to_.lanes);
    const auto first = slices_.begin() + static_cast<std::ptrdiff_t>(block * lanes);
    return {first, first + to_.lanes_used(block)};
  }

  /// Numbers of a block out of an array over the whole part, and back: `per_block` per block and lane.
  template <class T>
  Array<T> take(std::size_t block, const Array<T>& whole) const {
    const Strides s = strides(whole.size());
    Array<T> numbers(s.rows * s.to_lanes);
    copy(block, s, [&](std::size_t from, std::size_t to) { numbers[to] = whole[from]; });
    return numbers;
  }
  template <class T>
  void put_back(std::size_t block, const Array<T>& numbers, Array<T>& whole) const {
    copy(block, strides(whole.size()),
         [&](std::size_t from, std::size_t to) { whole[from] = numbers[to]; });
  }

 private:
  struct Strides {
    std::size_t rows, from_lanes, to_lanes;
  };
  Strides strides(std::size_t whole) const {
    const auto lanes = static_cast<std::size_t>(from_.lanes);
    return {whole / from_.blocks() / lanes, lanes, static_cast<std::size_t>(to_.lanes)};
  }
  template <class Use>
  void copy(std::size_t block, const Strides& s, const Use& use) const {
    const std::vector<int> slices = of_block(block);
    std::vector<std::size_t> first;
    for (const int slice : slices) {
      const auto z = static_cast<std::size_t>(slice);
      first.push_back(z / s.from_lanes * s.rows * s.from_lanes + z % s.from_lanes);
    }
    for (std::size_t row = 0; row < s.rows; ++row) {
      for (std::size_t l = 0; l < first.size(); ++l) {
        use(first[l] + row * s.from_lanes, row * s.to_lanes + l);
      }
    }
  }

  Shape from_;
  std::vector<int> slices_;
  std::unique_ptr<Projector> projector_;
  Shape to_;
};

/// Numbers of cells that are laid out as `from` says, as `to` has the same cells.
template <class T>
Array<T> in_lanes(const Shape& from, const Shape& to, const Array<T>& numbers) {
  if (from.lanes == to.lanes) return numbers;
  Array<T> out(to.field());
  const auto a = static_cast<std::size_t>(from.lanes), b = static_cast<std::size_t>(to.lanes);
  const std::size_t columns = from.field_of_block / a;
  for (std::size_t z = 0; z < static_cast<std::size_t>(from.slices); ++z) {
    for (std::size_t i = 0; i < columns; ++i) {
      out[z / b * to.field_of_block + i * b + z % b] =
          numbers[z / a * from.field_of_block + i * a + z % a];
    }
  }
  return out;
}

/// Cells of a block of some slices, and of other lanes.
inline CellKinds take_cells(const PackedSlices& packed, std::size_t block, const CellKinds& cells) {
  CellKinds some;
  some.kinds = packed.take(block, cells.kinds);
  some.least = packed.take(block, cells.least);
  some.most = packed.take(block, cells.most);
  return some;
}
inline CellKinds cells_in_lanes(const Shape& from, const Shape& to, const CellKinds& cells) {
  CellKinds out;
  out.kinds = in_lanes(from, to, cells.kinds);
  if (!cells.banded()) return out;
  out.least = in_lanes(from, to, cells.least);
  out.most = in_lanes(from, to, cells.most);
  return out;
}

/// The slice whose own contrast is least.
inline int hardest_slice(const Shape& shape, const CellKinds& cells, const Array<float>& dose) {
  const auto lanes = static_cast<std::size_t>(shape.lanes);
  const auto slices = static_cast<std::size_t>(shape.slices);
  std::vector<float> least(slices, std::numeric_limits<float>::infinity()), most(slices, 0.0F);
  for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
    if (cells.kinds[i] == Kind::neither) continue;
    const std::size_t z = i / shape.field_of_block * lanes + i % lanes;
    if (cells.kinds[i] == Kind::gel) {
      least[z] = std::min(least[z], dose[i]);
    } else {
      most[z] = std::max(most[z], dose[i]);
    }
  }
  int hardest = -1;
  for (std::size_t z = 0; z < slices; ++z) {
    if (!std::isfinite(least[z])) continue;
    const auto at = static_cast<std::size_t>(std::max(hardest, 0));
    // least / most, without a division by 0.
    if (hardest < 0 || least[z] * most[at] < least[at] * most[z]) hardest = static_cast<int>(z);
  }
  return hardest;
}

/// The slices that hold gel, or all of them as one.
inline std::vector<int> problems_with_gel(const Shape& shape, const CellKinds& cells) {
  if (shape.coupled) return {0};
  const auto lanes = static_cast<std::size_t>(shape.lanes);
  std::vector<bool> has(static_cast<std::size_t>(shape.slices), false);
  for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
    if (cells.kinds[i] == Kind::gel || (cells.banded() && cells.least[i] > 0)) {
      has[i / shape.field_of_block * lanes + i % lanes] = true;
    }
  }
  std::vector<int> slices;
  for (int z = 0; z < shape.slices; ++z) {
    if (has[static_cast<std::size_t>(z)]) slices.push_back(z);
  }
  return slices;
}

}  // namespace slicecorr::tomo::detail
