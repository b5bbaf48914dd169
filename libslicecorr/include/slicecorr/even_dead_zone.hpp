// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file even_dead_zone.hpp
/// Light that makes dose and dead zone even although resin flows: found for a target, and judged in
/// what is shown (flow.md of the dissertation's chapter IV: docs/even-dead-zone.md).
///
/// All functions are thread-safe and give the same light and figures for any number of threads.
/// `InputError` for what does not fit, `InfeasibleError` where no dead zone can last, `Cancelled`.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "slicecorr/flow_doses.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

struct Setup;

/// Every so many slices the light is found anew; between them it is linear.
inline constexpr int kEvenSlices = 20;

/// The process of `setup` with the light that its `even_dead_zone` asks for, and with its UV light;
/// as it is where nothing is asked for, or the light is there. Slices 0, `every`, 2 `every`, ... and
/// the last are looked at, and more where sections change fast; those with the same section once, those
/// too small for the flow's cells not at all. Light is sought for what will be lit, as images will show
/// it. Slices in which it does no better than light that is the same everywhere get that. `setup.gap_um`
/// is the dead zone aimed at; 0: that with which the largest section comes out best, or a thinner one
/// with which columns print what they do not with that. Tells gap, slices and caps through `context`.
Process find_even_light(const SliceSource& target, const Setup& setup,
                        const ExecutionContext& context = {}, int every = kEvenSlices);

/// What the light brings to the front, in the slices that it was found for and half way between.
/// `shown`: the corrected slices, whose pixels count; null: those that the correction will show, known
/// from the design and the even light. Judged is what is lit and has gelled material above: where
/// features stay dark before an edge, resin is as open as beside the part.
FlowDoses flow_doses(const SliceSource& target, const SliceSource* shown, const Setup& asked,
                     const ExecutionContext& context = {});

/// UV images under even light by place: rows of a slice's grey pixels become the pixels of its UV
/// image. Where nothing is lit there is just the UV light that keeps black from curing.
class EvenUvImages {
 public:
  /// `process.even_light` of the setup must be there with UV light by place, and outlive this. `images` lie like
  /// `frame`. Where the UV lamp is uneven each place shows so much more of it that the light is even.
  EvenUvImages(const Setup& setup, const Grid& images, const ImageFrame& frame);
  std::uint8_t of_black() const { return of_black_; }
  void make_row(int slice, int y, std::span<std::uint8_t> pixels) const;

 private:
  const LightMap map_, uv_map_;                  ///< of the display and of the UV lamp
  std::shared_ptr<const EvenLight> blue_light_;  ///< with curing light in place of UV light
  EvenPixels pixels_, blue_;
  std::array<double, 256> share_of_{};  ///< by pixel, of full curing light, of 255
  double step_ = 0;                     ///< the greatest of `share_of_` from level to level
  double uv_of_blue_ = 0;  ///< share of UV light that keeps a share of curing light off the window
  std::uint8_t of_black_ = 0;
  /// Of a slice: its share of the usual curing light, and which of the tables goes with its UV lamp.
  struct Lamps {
    double blue = 1;
    std::uint16_t table = 0;
  };
  std::vector<Lamps> lamps_;  ///< the last holds for later slices
  /// By the share of full UV light that is to come, in steps of 1/kSteps of 1/255.
  std::vector<std::vector<std::uint8_t>> of_share_;
  static constexpr int kSteps = 16;
};

}  // namespace slicecorr
