/// What the first pass over a target collects besides handing its slices on.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstring>
#include <string>

#include "pipeline/bands.hpp"
#include "pipeline/relief.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::detail {

struct SliceRange {
  int first, past;
};

/// Bands and ranges may be read by several threads at once.
class TargetScan {
 public:
  explicit TargetScan(const SliceSource& target)
      : target_(target), relief_(target.bounds(), target.grid().layers) {}

  void read(const PixelBox& band, const SliceSource::Sink& sink) {
    read(band, {0, target_.grid().layers}, sink);
  }
  void read(const PixelBox& band, const SliceRange& range, const SliceSource::Sink& sink) {
    const std::size_t columns = columns_of(band);
    LitColumns lit(columns);
    const auto take = [&](int n, const std::uint8_t* rows) {
      lit.add(n, rows);
      if (rows && !full_ && std::memchr(rows, 255, columns)) full_ = true;
      sink(n, rows);
    };
    target_.read_slices(band, range.first, range.past, take);
    coverage_sum_ += lit.sum();
    relief_.add(band, lit.finish());
  }
  /// To be called after all bands.
  void fill(StackInfo& info) const {
    if (!full_) refuse_vanished(target_);
    const Grid& g = target_.grid();
    info.part_volume_mm3 = static_cast<double>(coverage_sum_.load()) / 255.0 * g.pixel_x_um *
                           g.pixel_y_um * g.layer_um * 1e-9;
    info.target_layers = g.layers;
    info.program = std::string("slicecorr ") + version;
  }
  GreyImage picture() const { return relief_.picture(); }

 private:
  const SliceSource& target_;
  Relief relief_;
  std::atomic<std::uint64_t> coverage_sum_{0};
  std::atomic<bool> full_{false};  ///< a voxel of coverage 1 was seen
};

}  // namespace slicecorr::detail
