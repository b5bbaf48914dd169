// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file baseline.hpp
/// The compensations for cure-through that people use today, to compare with: our own
/// implementations from their descriptions. None knows the resin, the light or the speed.
///
///  - *Whole-layer erase*: light of later slices cures through the gap on their platform side, so
///    each run of lit slices behind a gap loses its first N slices, those next to the gap. N is one
///    number for the whole part; runs of N slices or fewer vanish. The run on the platform is
///    whole.
///  - *Z compensation* of PrusaSlicer (`zcorrection_layers`): each slice keeps what the N slices on its
///    platform side have, too, down to the first one. On pixels that are lit or black this is the erase.
///    A grey pixel keeps the least of its values in these slices: all that outlines have in common where
///    one lies within the other.
///  - *Fixed grey table*: a pixel is darkened by 25, 15, 10 and 5 grey values of 255 when the next,
///    the second, third and fourth slice after it is lit there.
///
/// A pixel is lit when it is not 0. Erase and table go through the slices of a band from the last to the
/// first, as predictions do, and need no slices of their own.
///
/// Objects are for one thread at a time, but walks over one `BandErase` may run side by side;
/// `cure_through_slices` is thread-safe. Nothing here throws anything of its own.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr {

/// What a band remembers of its runs for the erase: where each begins, noted where it ends.
class BandErase {
 public:
  explicit BandErase(std::size_t columns);

  /// Coverage of the next layer, from layer 0 on, one byte per column; null for an empty one.
  void add_layer(const std::uint8_t* coverage);

  /// One way through the layers with one N >= 0, after all have been added. Any number of walks may
  /// be made; the band must outlive them and not change.
  class Walk {
   public:
    Walk(const BandErase& band, int erased_layers);
    /// What is left of `coverage` of the next layer, from the last one on. Valid until the next
    /// call.
    const std::uint8_t* next(const std::uint8_t* coverage);

   private:
    const BandErase& band_;
    int erased_layers_;
    int layer_;
    std::vector<std::int32_t> first_;  ///< per column: first layer of the run that was met last
    std::vector<std::uint8_t> out_;
  };

 private:
  struct End {
    std::uint32_t column;
    std::int32_t first;
  };
  std::vector<std::int32_t> first_;
  std::vector<std::uint8_t> before_, empty_;
  std::vector<End> ends_;
  std::vector<std::size_t> ends_end_;  ///< per layer: ends of runs that lie right before it
};

/// What the table subtracts for the four slices after a pixel, the nearest first; grey values.
inline constexpr std::array<std::uint8_t, 4> kGreyTable{25, 15, 10, 5};

class BandGreyTable {
 public:
  explicit BandGreyTable(std::size_t columns);
  /// What is left of `coverage` of the next layer, from the last one on. Valid until the next call.
  const std::uint8_t* next(const std::uint8_t* coverage);

 private:
  std::array<std::vector<std::uint8_t>, kGreyTable.size()> later_;  ///< the nearest first
  std::vector<std::uint8_t> out_;
};

/// The most slices through which full light cures, above a feature of any height. An erase of more
/// can't be better for any edge: with this one nothing cures through. Needs a feasible model.
int cure_through_slices(const CureModel& model);

}  // namespace slicecorr
