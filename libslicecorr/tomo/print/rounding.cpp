// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/rounding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <tuple>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/surface.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/print/judging.hpp"

namespace slicecorr::tomo::detail {

namespace {

constexpr int kRounds = 24, kTakenBack = 4, kMostMiddled = 8;
/// So near to the middle of their bands doses need not be brought.
constexpr double kMiddle = 2e-3;
/// Where no turn more is allowed, and light is so much more than the projector has, more changes little.
constexpr double kFarAbove = 1.3;
/// Frames of an angle that are tried unasked, at most.
constexpr int kMostHeld = 9;
/// Levels have to gain so much contrast for frames to be held unasked.
constexpr double kWorthHolding = 1.005;

/// Each angle's light as that of `hold` angles around it.
Light held_light(const TomoGrid& grid, const Light& light, const TomoGrid& held, int hold) {
  Light out(held);
  const std::size_t frame = grid.light_of_block() / static_cast<std::size_t>(grid.angles);
  for (std::size_t b = 0; b < grid.blocks(); ++b) {
    for (int k = 0; k < held.angles; ++k) {
      const int m = (k + hold / 2) / hold % grid.angles;
      std::copy_n(light.block(b) + static_cast<std::size_t>(m) * frame, frame,
                  out.block(b) + static_cast<std::size_t>(k) * frame);
    }
  }
  return out;
}

/// Frames of one way of showing the light.
class Rounding {
 public:
  Rounding(const ToShow& show, const ExecutionContext& context, TomoJob job, const Bench& bench,
           const Light& light)
      : show_(show), context_(context), bench_(bench), light_(light), job_(std::move(job)) {}

  void settle(bool carry) {
    double scale = show_.scale;
    job_.turns = show_.turns;
    for (int round = 0;; ++round) {
      judge_at(scale, carry);
      // What comes back takes its share of the light first.
      const double back = bench_.resupply_mj_cm3_s * figures_.print_time_s;
      const bool banded = figures_.wanted.has_value();
      const double short_by =
          banded ? figures_.wanted->brighter
                 : (figures_.gel_dose_mj_cm3 + back) / (figures_.metrics.min_gel + back);
      if (banded && round > 0 && (std::abs(short_by - 1) < kMiddle || round > kMostMiddled)) break;
      // More than enough, where the operators see less than the sum, costs turns: taken back once.
      if (!banded && short_by <= 1 && (round > 0 || short_by > 0.99)) break;
      const bool all_lit = job_.turns == show_.most_turns && scale > kFarAbove * show_.brightest;
      if (round + 1 == kRounds || all_lit) break;
      scale *= banded ? short_by : short_by + 2e-4 * (round + 1);
      while (round < kTakenBack && job_.turns > 1 &&
             scale * job_.turns <= show_.brightest * (job_.turns - 1)) {
        scale *= static_cast<double>(job_.turns) / (job_.turns - 1);
        --job_.turns;
      }
      if (scale <= show_.brightest || job_.turns == show_.most_turns) continue;
      scale *= static_cast<double>(job_.turns) / (job_.turns + 1);
      ++job_.turns;
    }
  }

  TomoJob& job() { return job_; }
  const PrintFigures& figures() const { return figures_; }
  std::uint16_t top() const { return *std::max_element(job_.levels.begin(), job_.levels.end()); }
  /// What of two ways is better.
  std::pair<bool, double> rank() const {
    return {figures_.feasible(),
            figures_.wanted ? figures_.wanted->slack : figures_.metrics.contrast};
  }

 private:
  void judge_at(double scale, bool carry) {
    job_.levels = carry ? carried_levels(light_, scale, bench_.mw_cm2)
                        : nearest_levels(light_, scale, bench_.mw_cm2);
    const Box<float> dose = dose_of(job_, context_);
    figures_ = judge(job_, bench_, show_.target, dose, show_.black_mj_cm3);
    if (figures_.wanted) return;
    figures_.surface =
        surface_of(dose, job_.part, job_.insert, job_.sampling.voxel_mm, figures_.gel_dose_mj_cm3);
  }

  const ToShow& show_;
  const ExecutionContext& context_;
  const Bench& bench_;
  const Light& light_;
  TomoJob job_;
  PrintFigures figures_;
};

/// The better one of nearest levels and, where few are used, of carried ones.
Rounding best_of(const ToShow& show, const ExecutionContext& context, const TomoJob& job,
                 const Bench& bench, const Light& light) {
  Rounding nearest(show, context, job, bench, light);
  nearest.settle(false);
  if (nearest.top() >= kFewLevels) return nearest;
  // With few levels, or a projector so bright that few are used, it depends on the part which way to
  // round prints better.
  Rounding carried(show, context, job, bench, light);
  carried.settle(true);
  return carried.rank() > nearest.rank() ? carried : nearest;
}

}  // namespace

void check_hold(const Printer& printer, int angles, int hold) {
  if (hold < 2) return;
  if (hold % 2 == 0) {
    throw InputError(fmt::format(
        "{} frames for each angle; expected an odd number, so that one of them is the angle's own",
        hold));
  }
  if (!printer.rotation->wobble.empty()) {
    throw InputError(
        "frames are to be held, and the axis wobbles, which each angle's frame follows; expected one frame for "
        "each angle");
  }
  const int most = most_frames_per_turn(*printer.rotation);
  if (most == 0 || hold * angles <= most) return;
  throw InputError(fmt::format(
      "{} frames for each of {} angles; expected at most {} in a turn, as the projector shows",
      hold, angles, most));
}

RoundedPrint show_light(const ToShow& show, const ExecutionContext& context, TomoJob& job) {
  // Nobody knows how often frames have to be judged: each time brings it nearer to the end.
  double told = 0, before = 0, last = 0;
  ExecutionContext judging = slicecorr::detail::silent(context);
  judging.progress = [&](std::string_view, double done) {
    if (done < last) before = told;
    last = done;
    told = std::max(told, std::min(before + done / kRounds, 0.99));
    context.report("judging", told);
  };
  const auto held_by = [&](int hold) {
    TomoJob held = job;
    held.sampling.angles = hold * show.bench.grid.angles;
    const Bench bench = make_bench(held.printer, held.resin, held.sampling);
    const Light light = held_light(show.bench.grid, show.light, bench.grid, hold);
    Rounding of_light(show, judging, std::move(held), bench, light);
    of_light.settle(true);
    return std::pair(std::move(of_light.job()), of_light.figures());
  };
  RoundedPrint rounded;
  if (show.hold > 1) {
    rounded.hold = show.hold;
    std::tie(job, rounded.figures) = held_by(show.hold);
    rounded.top = *std::max_element(job.levels.begin(), job.levels.end());
    return rounded;
  }
  Rounding plain = best_of(show, judging, job, show.bench, show.light);
  rounded.top = plain.top();
  rounded.figures = plain.figures();
  const auto rank = plain.rank();
  const Rotation& rotation = *job.printer.rotation;
  const int angles = show.bench.grid.angles, most = most_frames_per_turn(rotation) / angles;
  int hold = std::min({kMostHeld, most, static_cast<int>(kFewLevels) / (rounded.top + 1) + 1});
  hold -= hold % 2 == 0 ? 1 : 0;
  if (show.hold == 0 && rounded.top < kFewLevels && hold > 1 && rotation.wobble.empty()) {
    auto [held, figures] = held_by(hold);
    const double gained = figures.wanted ? figures.wanted->slack : figures.metrics.contrast;
    if (figures.feasible() >= rank.first && gained > kWorthHolding * rank.second) {
      context.tell(fmt::format(
          "few levels are used: the frame of each angle is held as {} of them, which differ by a level at most; "
          "contrast {:.4g} in place of {:.4g}",
          hold, gained, rank.second));
      rounded.hold = hold;
      rounded.figures = figures;
      job = std::move(held);
      return rounded;
    }
  }
  job = std::move(plain.job());
  return rounded;
}

}  // namespace slicecorr::tomo::detail
