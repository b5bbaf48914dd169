// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file recorded_slices.hpp
/// Recordings in memory, and the dose of a column by integration over the time of what was shown.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "memory_slices.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::test {

class RecordedSlices final : public SliceSource {
 public:
  RecordedSlices(MemorySlices images, Recording recording)
      : images_(std::move(images)), recording_(std::move(recording)) {}
  const Grid& grid() const override { return images_.grid(); }
  PixelBox bounds() const override { return images_.bounds(); }
  ImageFrame frame() const override { return images_.frame(); }
  const Recording* recording() const override { return &recording_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    images_.read_band(band, sink);
  }
  const MemorySlices& images() const { return images_; }

 private:
  MemorySlices images_;
  Recording recording_;
};

/// One image per slice with the light of the plan.
inline Recording as_planned(int slices, double uv_mw_cm2 = 0) {
  Recording r;
  for (int n = 0; n < slices; ++n) {
    const Recording::Showing showing{n, 1.0, uv_mw_cm2, 0, 0, 0, 1.0};
    r.add_slice({&showing, 1});
  }
  return r;
}

/// A stretch of a print: the window moves steadily while one image is lit.
struct Stretch {
  double from_um = 0, to_um = 0;  ///< of the window; the same where it stands still
  double time_s = 0;
  double blue_mw_cm2 = 0;  ///< over the column, with the lamp's share
  double uv_mw_cm2 = 0;
};

/// The resin by areal, base-e numbers.
struct Cure {
  double hb_um = 0, m = 1, dose_prime = 0;  ///< (mW/cm²)^m s
  double beta = 0, huv_um = 1;
};

/// Relative dose at a height, by the midpoint rule over the time of the whole history.
inline double dose_by_time(const std::vector<Stretch>& history, const Cure& cure, double z_um,
                           int steps = 400) {
  double dose = 0;
  for (Stretch s : history) {
    if (s.to_um < z_um || (s.to_um == s.from_um && s.from_um < z_um)) continue;
    if (s.from_um < z_um) {
      // The showing before the window has come to the point does not light it.
      s.time_s *= (s.to_um - z_um) / (s.to_um - s.from_um);
      s.from_um = z_um;
    }
    for (int k = 0; k < steps; ++k) {
      const double window = s.from_um + (s.to_um - s.from_um) * (k + 0.5) / steps;
      const double d = window - z_um;
      const double net = s.blue_mw_cm2 * std::exp(-d / cure.hb_um) -
                         cure.beta * s.uv_mw_cm2 * std::exp(-d / cure.huv_um);
      if (net > 0) dose += std::pow(net, cure.m) / cure.dose_prime * s.time_s / steps;
    }
  }
  return dose;
}

}  // namespace slicecorr::test
