// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// When which frame of a job is lit, by the angle at which the vial stands then.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/shown.hpp"

namespace slicecorr::tomo::detail {

/// When which frame is lit: for each of a turn's cells of angle the frames, by their angle (or
/// `kBlackFrame`), and for how long, s.
class Schedule {
 public:
  /// Cells of angle in a frame's step, of what was shown: an odd number, so that its own angle is the
  /// middle of one.
  static constexpr int kCellsPerStep = 5;

  struct Part {
    int angle = 0;
    double exposed_s = 0;
  };
  explicit Schedule(int cells) : cells_(static_cast<std::size_t>(cells)) {}
  int cells() const { return static_cast<int>(cells_.size()); }
  /// Any whole number stands for the cell of that angle.
  const std::vector<Part>& at(long cell) const { return cells_[place(cell)]; }
  void add(long cell, int angle, double exposed_s) {
    std::vector<Part>& parts = cells_[place(cell)];
    for (Part& part : parts) {
      if (part.angle != angle) continue;
      part.exposed_s += exposed_s;
      return;
    }
    parts.push_back({angle, exposed_s});
  }

 private:
  std::size_t place(long cell) const {
    const long n = static_cast<long>(cells_.size());
    return static_cast<std::size_t>((cell % n + n) % n);
  }
  std::vector<std::vector<Part>> cells_;
};

/// Cells side by side in which the same frames are lit for as long, and of which one of the job's angles
/// is the nearest.
struct LitRun {
  long first = 0, end = 0;  ///< cells, from 0 on; the last may go on beyond a turn
  int stage = 0;            ///< that angle
  const std::vector<Schedule::Part>* parts = nullptr;  ///< of each cell
};

/// Where runs lie on the turn, in cells; cell c is what lies within half of one of c.
class LitRuns {
 public:
  /// `schedule` must outlive this.
  LitRuns(const Schedule& schedule, int angles);
  const std::vector<LitRun>& all() const { return runs_; }

  /// Calls use(middle, length, run) for the parts of a stretch from `from` to `to`, both anywhere.
  template <class Use>
  void each(double from, double to, const Use& use) const {
    const auto cell = static_cast<long>(std::floor(from + 0.5));
    const long n = static_cast<long>(run_of_cell_.size()), wrapped = (cell % n + n) % n;
    auto k = static_cast<std::size_t>(run_of_cell_[static_cast<std::size_t>(wrapped)]);
    // The run's cells as they are counted here.
    long first = runs_[k].first + cell - wrapped;
    if (first > cell) first -= n;
    while (from < to) {
      const LitRun& run = runs_[k];
      const long end = first + run.end - run.first;
      const double until = std::min(to, static_cast<double>(end) - 0.5);
      if (until > from && !run.parts->empty()) use((from + until) / 2, until - from, run);
      from = until > from ? until : static_cast<double>(end) - 0.5;
      first = end;
      k = k + 1 < runs_.size() ? k + 1 : 0;
    }
  }

 private:
  std::vector<LitRun> runs_;
  std::vector<int> run_of_cell_;
};

/// Each frame at its own angle, for its share of all turns.
Schedule planned(const TomoJob& job, const Bench& bench);

/// As it was shown.
Schedule scheduled(std::span<const Showing> shown, const Bench& bench);

}  // namespace slicecorr::tomo::detail
