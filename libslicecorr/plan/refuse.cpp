// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/refuse.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "plan/closed.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::detail {

void refuse_plan(const PlanAsk& ask, const std::optional<PlanLight>& light,
                 const std::vector<PlanGap>& gaps, const Trials& trials,
                 const std::vector<PlanPoint>& tried, const Bound& bound) {
  const PlanGap* const gap = limiting_gap(gaps);
  const bool layer_by_layer = !tried.empty() && tried.front().exposure_s > 0;
  std::string text =
      fmt::format("no {} prints this part as asked", layer_by_layer ? "exposure" : "speed");
  const auto in_gap = [&](const PlanGap& g) {
    return fmt::format("the gap of {} at pixel {}, {}, slices {} to {} ({} pixels have such)",
                       trials.height_in_words(g.slices), g.place.x, g.place.y, g.place.first,
                       g.place.last, g.count);
  };
  if (light && gap && !gap->at_platform) {
    const BestGap best = best_gap(*light, gap->slices);
    if (best.contrast < ask.gap_contrast) {
      text += fmt::format(
          ": {} keeps a contrast of at most {}, at {:.5g} mm/h, where {:g} is asked for; expected "
          "at most that contrast, or gaps of at least {:g} um to be planned for",
          in_gap(*gap), at_most(best.contrast, 4), best.speed_mm_h, ask.gap_contrast,
          (gap->slices + 1) * light->layer_um);
      throw InfeasibleError(text);
    }
  }
  if (light && !tolerated_speeds(*light, ask.tolerance_um, ask.light_error)) {
    throw InfeasibleError(fmt::format(
        "{}: an error of {:g} % of the light moves edges by more than {:g} um at any speed, where "
        "{:g} um are allowed; expected a greater tolerance, or light that is known better",
        text, 100 * ask.light_error, light->lam_um * ask.light_error, ask.tolerance_um));
  }
  const auto ranges = light ? closed_ranges(*light, gaps, ask) : std::vector<SpeedRange>{};
  if (!ranges.empty() && bound.most_mm_h < ranges.front().least_mm_h) {
    throw InfeasibleError(fmt::format(
        "{}: edges and gaps keep what is asked for from {} mm/h on, and {}; expected less light "
        "(the lamp free), a smaller contrast (gap_contrast) or a greater tolerance (tolerance_um)",
        text, at_least(ranges.front().least_mm_h), bound.words));
  }
  // What is lost counts most, then edges, then how dark gaps are.
  const auto misses = [](const PlanPoint& p) {
    return std::tuple(p.lost + p.split, p.off, -p.contrast, p.max_abs_um);
  };
  const PlanPoint* nearest = nullptr;
  for (const PlanPoint& p : tried) {
    if (p.prints && !p.keeps && (!nearest || misses(p) < misses(*nearest))) nearest = &p;
  }
  if (nearest) {
    text += fmt::format(": nearest is {}, where {}",
                        nearest->speed_mm_h > 0 ? fmt::format("{:g} mm/h", nearest->speed_mm_h)
                                                : fmt::format("{:g} s", nearest->exposure_s),
                        nearest->why);
    double contrast = 0, um = std::numeric_limits<double>::infinity();
    for (const PlanPoint& p : tried) {
      if (!p.prints || p.keeps || p.lost + p.split > 0) continue;
      if (p.off == 0) contrast = std::max(contrast, p.contrast);
      if (p.narrow == 0) um = std::min(um, p.max_abs_um);
    }
    if (contrast > 0 && contrast < ask.gap_contrast) {
      text += fmt::format("; expected a contrast of at most {}", at_most(contrast, 4));
    } else if (std::isfinite(um) && um > ask.tolerance_um) {
      text += fmt::format("; expected a tolerance of at least {} um", at_least(um, 4));
    } else {
      text +=
          "; expected a smaller contrast (gap_contrast), a greater tolerance (tolerance_um) or "
          "low gaps to be left out (least_gap_um)";
    }
  } else if (std::isfinite(bound.most_mm_h)) {
    text += fmt::format(": {}", bound.words);
  } else if (!tried.empty()) {
    text += ": " + tried.back().why;
  }
  throw InfeasibleError(text);
}

}  // namespace slicecorr::detail
