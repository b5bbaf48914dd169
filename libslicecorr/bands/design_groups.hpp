// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A band of a target in groups of columns that get equal light: what all that corrects, predicts and
/// measures a band goes through. Where light is even it is one group, of all columns.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "bands/design_band.hpp"
#include "bands/dose_meter.hpp"
#include "base/coded_band.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

/// Takes the rows of a slice; null: black.
using PutRows = std::function<void(int slice, const std::uint8_t* rows)>;

/// Number of columns of each value of light.
using LightCounts = std::array<std::uint64_t, 256>;

/// Columns of equal light, and what is wanted of them. What it points to lives as long as its band.
struct DesignGroup {
  std::uint8_t value = 0;  ///< of light
  std::size_t columns = 0;
  const std::vector<std::uint32_t>* of_band = nullptr;  ///< which of the band; null: all
  BandPredictor::PixelOfColumn place;                   ///< the pixel of each column
  BandReader coverage;
  const CodedBand* heights = nullptr;     ///< edge heights; null: none
  const CodedBand* left_alone = nullptr;  ///< null: nothing
  std::optional<WantedBand> doses;        ///< where doses are wanted
  const CodedBand* beside = nullptr;      ///< rows of `DesignAsk::beside`

  DesignReader made;  ///< in place of coverage and heights; empty: these

  /// The design, slice by slice, first slice first. `surface`: see `read_design`.
  void read(Surface surface, const DesignSink& sink) const {
    if (made) return made(sink);
    read_design(coverage, heights, surface, sink);
  }
  CodedDesign coded(Surface surface) const {
    return {columns, {coverage, heights, left_alone}, surface};
  }
};

/// What of a band is read beside the target.
struct DesignAsk {
  BandReader coverage = {};             ///< in place of the target's own
  const SliceSource* beside = nullptr;  ///< other slices over the same columns
  bool doses = true;                    ///< with those that are wanted
};

class DesignBand {
 public:
  /// `map`: the display's light. `target` and `map` must outlive it. Where light is uneven only columns
  /// that are lit are in groups.
  DesignBand(const SliceSource& target, const LightMap& map, const PixelBox& box,
             DesignAsk ask = {});
  ~DesignBand();
  DesignBand(const DesignBand&) = delete;
  DesignBand& operator=(const DesignBand&) = delete;

  const std::vector<DesignGroup>& groups() const { return groups_; }
  /// How many columns are in groups, added up by value of light.
  void count(LightCounts& counts) const;
  /// `make` gives the rows of a group to its second argument, `slices` of them, from the last slice to
  /// the first; `put` gets those of the band.
  void each(int slices, const std::function<void(const DesignGroup&, const PutRows&)>& make,
            const PutRows& put) const;

 private:
  struct Kept;
  std::unique_ptr<Kept> kept_;
  std::vector<DesignGroup> groups_;
};

/// A band read once and divided: the columns that are lit in any of its sources, by value of light.
struct GroupedBand {
  struct Group {
    std::uint8_t value = 0;
    std::vector<std::uint32_t> columns;  ///< of the band
    std::vector<CodedBand> sources;      ///< rows of these columns, by reader
  };
  std::vector<Group> groups;

  GroupedBand(const LightMap& map, const PixelBox& band, const std::vector<BandReader>& readers);
};

}  // namespace slicecorr::detail
