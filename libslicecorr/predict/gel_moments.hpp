// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// When the middles of layers gel: how many slices after their own. What slice m + j adds in the middle of
/// layer m is, by (A.32), phi_m (1 - sqrt a) for j = 0 and phi_(m+j) sqrt(a) (1 - a) a^(j-1) else; layer
/// by layer phi'_(m+j) sqrt(a) a^j. A layer has gelled when the sum so far reaches 1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "predict/plain_moments.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// Follows the columns of a band from the last slice to the first. Not thread-safe.
class GelMoments {
 public:
  /// As `BandPredictor::DelaySink`. False: enough is known, and nothing more is looked for.
  using Sink = PlainMoments::Sink;
  /// Whether moments follow from sums of layers that are alike: of the law `SumOfLight`.
  static bool known(const CureModel& model);
  /// `model` and `curve` outlive it; `longest`: delays are at most this.
  GelMoments(const CureModel& model, const PixelCurve& curve, std::size_t columns, int longest,
             Sink sink);

  /// `pixels` of the columns from `first` on; null: nothing is shown. Each column gets all of its slices,
  /// from the last to the first; slices after one with an image have none.
  void add_slice(int slice, std::size_t first, std::size_t columns, const std::uint8_t* pixels);

 private:
  struct Column {
    std::uint16_t alike = 0;  ///< slices with the same light from the one at hand on, at least
    std::uint16_t delay = 0;  ///< as told last
  };
  std::uint8_t* row(std::size_t block, int slice) {
    const auto kept = static_cast<std::size_t>(slice) & (ring_ - 1);
    return &pixels_[(block * ring_ + kept) * kLanes];
  }
  /// Whether the column's delay may be another in the slice before this one, with the same light.
  bool look(std::size_t column, int slice);
  /// From a slice on so many are shown equally long.
  int equally_long(int slice) const;
  /// What a pixel sums up to that shows the same light in all slices: after j of them, and after how many it
  /// is known whether the layer gels. Most columns most often do, so it is worked out once.
  struct SameLight {
    std::vector<double> sums;  ///< empty: not worked out yet
    int known_after = 0;       ///< looks; more than `sums` has: never
    bool gels = false;
  };
  const SameLight& same_light(std::uint8_t pixel);

  std::optional<PlainMoments> plain_;  ///< does all the work where the model is plain
  const CureModel& model_;
  const PixelCurve& curve_;
  const Sink sink_;
  bool wanted_ = true;
  int longest_ = 0;              ///< delay
  std::vector<double> weights_;  ///< what is left of slice m + j in the middle of layer m
  std::vector<double> rest_;     ///< sum of these from j on, at least
  double brightest_ = 0;         ///< light of any slice
  double keeps_ = 1;             ///< share of liquid resin that a lift leaves in its place
  std::size_t ring_ = 1;         ///< slices kept, a power of two
  std::vector<std::uint8_t> pixels_;
  std::vector<SameLight> same_light_;  ///< by pixel
  std::vector<int> equally_long_;      ///< of slices whose exposures are listed
  std::vector<Column> columns_;
  /// Per block of lanes.
  std::vector<std::uint64_t> active_;  ///< columns whose delay may change
  std::vector<int> last_;              ///< slice with light; -1: not known yet
};

}  // namespace slicecorr::detail
