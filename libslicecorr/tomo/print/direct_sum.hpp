// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Doses of a job by a direct sum, to judge what the solver's operators say: from a voxel back to the
/// pixels that light it. Level light and light that slices share have a way each.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/print.hpp"
#include "tomo/print/schedule.hpp"

namespace slicecorr::tomo::detail {

/// What is summed. The job, the bench and the schedule outlive it.
struct Judged {
  const TomoJob& job;
  const Bench& bench;
  const Schedule& schedule;
  JudgedAt at = JudgedAt::means;
  /// A voxel's side across and upwards, mm; 0 for its centre.
  double side_mm() const { return at == JudgedAt::means ? bench.grid.voxel_mm() : 0; }
  double height_mm() const { return at == JudgedAt::means ? bench.grid.slice_height_mm() : 0; }
  /// Voxels by which the part's rim moves in a frame's step.
  double arc() const;
  /// Of the job's angles, the one nearest to a cell of the schedule.
  int angle_near(long cell) const;
  /// Where in a turn the frame of that angle is shown.
  std::size_t frame_at(int stage) const {
    return static_cast<std::size_t>(bench.frame_of_angle(stage));
  }
};

class DirectSum {
 public:
  virtual ~DirectSum() = default;
  /// Adds the dose of the print over alpha_a to every slice of a column of voxels: all of it, or with
  /// `sum` of as many as frames and slices what comes while each frame of a turn is shown.
  virtual void add(int column, int row_of_voxels, std::vector<double>& sum) const = 0;
};

std::unique_ptr<DirectSum> make_level_sum(const Judged& judged);
std::unique_ptr<DirectSum> make_traced_sum(const Judged& judged, const ExecutionContext& context);
std::unique_ptr<DirectSum> make_rising_sum(const Judged& judged, const ExecutionContext& context);
std::unique_ptr<DirectSum> make_ray_sum(const Judged& judged, const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
