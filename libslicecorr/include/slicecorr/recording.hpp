// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file recording.hpp
/// What a machine really showed: a recorded stack (docs/recording.md).
///
/// A corrected stack says what is to be shown in each slice. A recorded one says what was: its
/// archive holds the images in the order in which they appeared, as many as there were, and beside
/// them which of them were lit while the window passed each slice of the plan, and with how much
/// light. Whoever predicts from a recorded stack (`verify_stack`, `probe_stack`, ...) sums the
/// showings of each slice.
///
/// Plain values, thread-safe for reading; all functions are thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

class SliceSource;
struct StackInfo;

/// What was shown in each slice of the plan.
struct Recording {
  /// An image while the window was within one slice.
  struct Showing {
    /// Index of the archive's image, from 0; -1: black.
    int image = -1;
    /// Integral of (share of blue light)^m over the time for which the image was shown within the
    /// slice, over the time that the process plans for the slice (`planned_light_s`); m is
    /// `light_exponent`. 1: as planned; 0: dark. The share is that of what the calibration stands
    /// for.
    double light = 0;
    /// Mean intensity of the UV lamp while the image was shown, >= 0; of a patterned lamp that over
    /// a fully lit pixel. Without `light` it has no effect.
    double uv_mw_cm2 = 0;
    /// Measured positions of the window between which the image was shown, from the platform; where
    /// both are the same, its light counts as spread over the slice.
    double from_um = 0, to_um = 0;
    double speed_um_s = 0;  ///< mean speed of the stage
    double blue_share = 0;  ///< mean share of blue light, 1: as calibrated
    bool operator==(const Showing&) const = default;
  };
  std::vector<Showing> showings;  ///< slice by slice, in the order in which they were shown
  std::vector<std::size_t> ends;  ///< per slice: index in `showings` after its last one
  /// Images whose UV image was not the one that follows from the blue one: what they print can't be
  /// predicted. Rising.
  std::vector<int> other_uv_images;

  int slices() const { return static_cast<int>(ends.size()); }
  /// The showings of a slice, 0..slices() - 1.
  std::span<const Showing> of(int slice) const;
  /// Appends a slice.
  void add_slice(std::span<const Showing> shown);
  bool operator==(const Recording&) const = default;
};

/// Time that a process plans for the light of a slice, s: continuous that in which the stage passes
/// it at the print's speed (where the lamp follows a ramp, more time and less light are the same
/// `light`), or at the slice's own where lamps stay; layer by layer its exposure. A share s of the light
/// (`light_share`) counts as s^m of the time; `m` is `light_exponent`.
double planned_light_s(const Process& process, double layer_um, int slice, double m);

/// The exponent m to which the share of blue light counts: the resin's, under UV light that of its
/// inhibition.
double light_exponent(const Resin& resin, const Process& process);

/// Throws `InputError` naming `source`, the slice and what was expected, when a showing names an
/// image that is not there or a number is not finite or negative.
void check_recording(const Recording& recording, int images, const std::string& source);

/// Throws `InputError` when `source` is a recording: for what needs slices, which a recording's
/// images are not.
void refuse_recording(const SliceSource& source);

}  // namespace slicecorr
