// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/shown.hpp
/// What a machine really showed of a job, and what that prints: frames come late, stages wobble.
///
/// Plain values; functions are thread-safe, with the same results for any number of threads.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo {

/// Stands for black light where a frame of the job is named.
inline constexpr int kBlackFrame = -1;

/// A frame while it was lit. Its light counts as spread evenly over the angles.
struct Showing {
  int frame = kBlackFrame;  ///< of the job, from 0, or black
  /// Between which angles of the stage, from its index on in the direction of the job; turns may be
  /// counted or not.
  double from_deg = 0, to_deg = 0;
  double exposed_s = 0;  ///< how long, >= 0
  double share = 1;      ///< mean light over that of the calibration, >= 0
  bool operator==(const Showing&) const = default;
};

/// What was shown, of a table with the columns job_frame, from_deg, to_deg, exposed_s and
/// blue_measured, which `printbridge` (frames.csv) and `printer-sim` write; others may be there.
struct Shown {
  std::vector<Showing> showings;
  /// Rows without an end: what was on when a print failed. They are left out.
  int without_end = 0;
  /// How long frames were shown, black not among them, each by its share of the light.
  double light_s() const;
};
/// Throws `InputError` naming line and column for tables that lack a column, name frames that the
/// job of so many angles has not, or have numbers that can't be, and for those without any light, as
/// of a dry run.
Shown read_shown(const std::string& path, int angles);

/// The doses that were really left, mJ/cm³: as `dose_of` a job, with each frame at the angles and
/// for the time that it was shown. Angles count in fifths of the job's own steps, so that a frame
/// that was shown at its own angle, for its share of each turn, gives the dose of the job. In resin
/// that changes it counts as so many turns of the job's as frames were lit for, with the mean of their
/// light each.
Box<float> dose_of(const TomoJob& job, std::span<const Showing> shown,
                   const ExecutionContext& context = {}, JudgedAt at = JudgedAt::means);

}  // namespace slicecorr::tomo
