// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the first pass over a target collects besides handing its slices on.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <string>
#include <vector>

#include "bands/bands.hpp"
#include "base/coded_band.hpp"
#include "pipeline/relief.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::detail {

struct SliceRange {
  int first, past;
};

/// Bands and ranges may be read by several threads at once.
class TargetScan {
 public:
  /// `heights`: of the target's layers.
  explicit TargetScan(const SliceSource& target, LayerHeights heights = {})
      : target_(target),
        heights_(std::move(heights)),
        relief_(target.bounds(), target.grid().layers),
        layer_sums_(heights_.alike() ? 0 : static_cast<std::size_t>(target.grid().layers)) {}

  void read(const PixelBox& band, const SliceSource::Sink& sink) {
    read(band, {0, target_.grid().layers}, sink);
  }
  void read(const PixelBox& band, const SliceRange& range, const SliceSource::Sink& sink) {
    const std::size_t columns = columns_of(band);
    LitColumns lit(columns);
    const auto take = [&](int n, const std::uint8_t* rows) {
      lit.add(n, rows);
      if (rows && !full_ && std::memchr(rows, 255, columns)) full_ = true;
      if (rows && !heights_.alike()) add_layer(n, rows, columns);
      sink(n, rows);
    };
    target_.read_slices(band, range.first, range.past, take);
    coverage_sum_ += lit.sum();
    relief_.add(band, lit.finish());
  }
  /// What of a band is left alone prints, too.
  void add(const CodedBand& left_alone) {
    std::vector<std::uint8_t> rows(left_alone.columns());
    std::uint64_t sum = 0;
    for (int n = 0; n < left_alone.slices(); ++n) {
      if (left_alone.black(n)) continue;
      left_alone.read(n, rows.data());
      sum = std::accumulate(rows.begin(), rows.end(), sum);
      if (!heights_.alike()) add_layer(n, rows.data(), rows.size());
    }
    coverage_sum_ += sum;
  }
  /// To be called after all bands.
  void fill(StackInfo& info) const {
    if (!full_ && target_.left_alone()) {
      throw InputError("nothing of the part is left to correct: what is left alone covers it");
    }
    if (!full_) refuse_vanished(target_);
    const Grid& g = target_.grid();
    info.part_volume_mm3 = static_cast<double>(coverage_sum_.load()) / 255.0 * g.pixel_x_um *
                           g.pixel_y_um * g.layer_um * 1e-9;
    if (!heights_.alike()) {
      info.part_volume_mm3 = 0;
      for (std::size_t n = 0; n < layer_sums_.size(); ++n) {
        info.part_volume_mm3 += static_cast<double>(layer_sums_[n].load()) / 255.0 * g.pixel_x_um *
                                g.pixel_y_um * heights_.of(static_cast<int>(n), g.layer_um) * 1e-9;
      }
    }
    info.target_layers = g.layers;
    info.program = std::string("slicecorr ") + version;
  }
  GreyImage picture() const { return relief_.picture(); }

 private:
  void add_layer(int n, const std::uint8_t* rows, std::size_t count) {
    layer_sums_[static_cast<std::size_t>(n)] +=
        std::accumulate(rows, rows + count, std::uint64_t{0});
  }

  const SliceSource& target_;
  LayerHeights heights_;
  Relief relief_;
  std::vector<std::atomic<std::uint64_t>> layer_sums_;  ///< where layers are of different heights
  std::atomic<std::uint64_t> coverage_sum_{0};
  std::atomic<bool> full_{false};  ///< a voxel of coverage 1 was seen
};

}  // namespace slicecorr::detail
