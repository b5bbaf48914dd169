// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a correction for an even dead zone shows, kept as far as its dose in flowing resin is judged by it.
#pragma once

#include <cstdint>
#include <vector>

#include "base/coded_band.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// The slices of a target as they are lit: some as grey values, of all others which pixels are lit at all
/// (1). Slices after the target's last one are left out. Bands are filled first, several at once, then
/// read by any threads; `target` must outlive it.
class KeptImages final : public SliceSource {
 public:
  /// `whole`: slices that are kept as grey values. `bands`: what is put, from the top row down.
  KeptImages(const SliceSource& target, const std::vector<int>& whole,
             const std::vector<PixelBox>& bands);
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  void read_band(const PixelBox& box, const Sink& sink) const override;

  /// Pixels of a slice, from the last one to the first; null: black.
  void put(std::size_t band, int slice, const std::uint8_t* pixels);

 private:
  struct Band {
    PixelBox box;
    CodedBand upwards;  ///< the last slice first
    std::vector<std::uint8_t> room;
  };

  const SliceSource& target_;
  std::vector<char> whole_;
  std::vector<Band> bands_;
};

/// Voxels of coverage 1 that light leaves unprinted.
struct Undercured {
  std::uint64_t voxels = 0, of = 0;
  bool more_than(double share) const {
    return static_cast<double>(voxels) > share * static_cast<double>(of);
  }
};

/// What `correct_stack` will show with the even light of a setup, by the same solve. `left`: told what it leaves
/// unprinted, which takes a prediction more, or null. Throws as it does.
KeptImages solved_images(const SliceSource& target, const Setup& setup,
                         const std::vector<int>& whole, Undercured* left,
                         const ExecutionContext& context);

/// Nearly the same in a third of the time: columns keep what was planned, with their edges brought to their
/// places (`InhibitedTuning::as_planned`).
KeptImages nearly_solved_images(const SliceSource& target, const Setup& setup,
                                const std::vector<int>& whole, const ExecutionContext& context);

/// What `correct_stack` leaves unprinted with the even light of a setup, in one column of so many across and
/// down (`every`, 1 or more). Throws as it does.
Undercured undercured_by(const SliceSource& target, const Setup& setup, int every,
                         const ExecutionContext& context);

}  // namespace slicecorr::detail
