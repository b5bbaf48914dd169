// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/filter.hpp
/// Filtered back projection: the start of the solvers, and a pattern of its own.
///
/// Thread-safe; the same bytes for any number of threads. Errors are `InputError`.
#pragma once

#include <string_view>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

/// What the ramp |k| is multiplied by; k_N is the highest frequency of the pixels.
struct Window {
  enum Kind {
    ram_lak,  ///< 1
    hamming,  ///< 0.54 + 0.46 cos(pi k/k_N)
    kelly,    ///< e^(-(k/k0)^4)
  };
  Kind kind = hamming;
  double k0 = 0.5;  ///< of `kelly`, over k_N; > 0

  constexpr Window(Kind window) : kind(window) {}  // NOLINT: a window's name is a window
  constexpr Window(Kind window, double at) : kind(window), k0(at) {}
};

/// As people name them: "hamming", "ram-lak", "kelly". Throws `InputError` for other names.
Window window_named(std::string_view name);
/// Every name, the default first.
inline constexpr std::string_view kWindowNames[] = {"hamming", "ram-lak", "kelly"};

/// Filters light along t, in place: |k| times the window, zero-padded to a power of 2 of at least 2
/// P. |k| is 1 at the highest frequency. Angular frequencies below `cut_per_mm`, when it is above 0,
/// become 0; the line is then padded to 16 P.
void ramp_filter(const ExecutionContext& context, Light& light, Window window,
                 double cut_per_mm = 0);

/// Light for a part by filtered back projection, negative values set to 0, scaled to a maximum of 1.
/// With absorption it is the inverse of Kelly, Bhattacharya et al., Science 2019, eq. 2: projected
/// with e^(+alpha u), filtered with |k| < alpha zeroed, shown times e^(+alpha sqrt(R^2 - t^2)).
/// Frames of refracted light are resampled from the lines in the resin. An insert is not seen.
Light filtered_start(const ExecutionContext& context, const Target& target, const RayTables& optics,
                     Window window = Window::hamming);

/// Re IFFT2(FFT2(gel) |k| window) of every slice, scaled to a maximum of 1: the model from which
/// OSMO starts.
Field filtered_model(const ExecutionContext& context, const Target& target, Window window);

}  // namespace slicecorr::tomo
