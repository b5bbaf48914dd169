// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file first_slices.hpp
/// The first slices of a print whose light makes the dead zone even (even_dead_zone.hpp), followed from the
/// first instant: before the flow is steady resin has not brought along yet what the light counts on.
///
/// Functions are thread-safe and give the same for any number of threads. `InputError`, `Cancelled`.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/even_light.hpp"
#include "slicecorr/flow_in_time.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {

/// What came of it.
struct FirstSlices {
  int slices = 0;                     ///< that were followed; 0: none could be, see `why_not`
  double pitch_um = 0;                ///< of the cells
  std::optional<StuckInTime> sticks;  ///< nothing: they print
  std::string why_not;
  /// A sentence that says so.
  std::string in_words() const;
};

/// Follows up to 40 slices on cells of which 30 lie along the part. `pixels`: what those of `part` are.
/// `setup.process.even_light` must be there, as `find_even_light` or a stack gives it. Some seconds of one core.
FirstSlices follow_first_slices(const SliceSource& part, FlowPixels pixels, const Setup& setup,
                                const ExecutionContext& context = {});

/// The light of the middles of `cells`, by slice, of images like those of `images`. For one thread.
/// `process` must outlive it.
LightInTime even_light_in_time(const Process& process, const Printer& printer, const Grid& images,
                               const FlowGrid& cells);

}  // namespace slicecorr
