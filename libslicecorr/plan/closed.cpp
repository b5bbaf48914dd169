// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/closed.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

namespace slicecorr::detail {

namespace {

/// Gaps that closed forms speak of lie between full slices; beside greys they end elsewhere.
struct Kind {
  int slices;
  bool at_platform, clean;
  bool operator<(const Kind& o) const {
    return std::tie(slices, at_platform, clean) < std::tie(o.slices, o.at_platform, o.clean);
  }
};
struct Counted {
  std::uint64_t pixels = 0;
  PlanPlace place;
  void add(const DesignColumns::Column& c, int first, int past) {
    // Columns come in reading order.
    if (pixels == 0) place = {c.x, c.y, first, past - 1};
    pixels += c.pixels;
  }
};

}  // namespace

PartHeights heights_of(const DesignColumns& columns, int least_gap_slices) {
  constexpr int kNone = std::numeric_limits<int>::max();
  const auto all = columns.columns();
  std::map<Kind, Counted> gaps;
  std::map<int, Counted> features;
  PartHeights out;
  out.lowest_gap.assign(all.size(), kNone);
  out.lowest_feature.assign(all.size(), kNone);
  out.gap_at.assign(static_cast<std::size_t>(columns.layers()), 0);
  out.platform_gap_at = out.gap_at;
  for (std::size_t k = 0; k < all.size(); ++k) {
    // From the last full slice on: where it ended, whether there was an empty slice, and a grey one.
    int ended = 0, began = -1;
    bool platform = true, empty = false, grey = false;
    std::uint8_t coverage = 0;
    int since = 0;
    const auto stretch = [&](int past) {
      if (past == since) return;
      empty = empty || coverage == 0;
      grey = grey || (coverage != 0 && coverage != 255);
      if (coverage == 255 && began < 0) {
        if (empty) {
          const int slices = since - ended;
          gaps[{slices, platform, !grey}].add(all[k], ended, since);
          if (slices >= least_gap_slices) {
            out.lowest_gap[k] = std::min(out.lowest_gap[k], slices);
            std::vector<int>& lies_in = platform ? out.platform_gap_at : out.gap_at;
            for (int n = ended; n < since; ++n) {
              int& lowest = lies_in[static_cast<std::size_t>(n)];
              if (lowest == 0 || slices < lowest) lowest = slices;
            }
          }
        }
        began = since;
      } else if (coverage != 255 && began >= 0) {
        features[since - began].add(all[k], began, since);
        out.lowest_feature[k] = std::min(out.lowest_feature[k], since - began);
        ended = since;
        began = -1;
        platform = false;
        empty = coverage == 0;
        grey = coverage != 0;
      }
      since = past;
    };
    for (const ColumnEvent& e : columns.events(k)) {
      if (e.coverage == coverage) continue;
      stretch(e.layer);
      coverage = e.coverage;
      since = e.layer;
    }
    stretch(columns.layers());
    if (began >= 0) {
      features[columns.layers() - began].add(all[k], began, columns.layers());
      out.lowest_feature[k] = std::min(out.lowest_feature[k], columns.layers() - began);
    }
  }
  for (const auto& [kind, counted] : gaps) {
    PlanGap gap;
    gap.slices = kind.slices;
    gap.at_platform = kind.at_platform;
    gap.beside_grey = !kind.clean;
    gap.left_out = kind.slices < least_gap_slices;
    gap.count = counted.pixels;
    gap.place = counted.place;
    out.gaps.push_back(gap);
  }
  for (const auto& [slices, counted] : features) {
    out.features.push_back({slices, counted.pixels, counted.place});
  }
  return out;
}

const PlanGap* limiting_gap(const std::vector<PlanGap>& gaps) {
  const PlanGap* platform = nullptr;
  for (const PlanGap& g : gaps) {
    if (g.left_out || g.beside_grey) continue;
    if (!g.at_platform) return &g;
    if (!platform) platform = &g;
  }
  return platform;
}

std::vector<SpeedRange> closed_ranges(const PlanLight& light, const std::vector<PlanGap>& gaps,
                                      const PlanAsk& ask) {
  const auto tolerated = tolerated_speeds(light, ask.tolerance_um, ask.light_error);
  if (!tolerated) return {};
  std::vector<SpeedRange> ranges{*tolerated};
  if (!(ask.gap_contrast > 0)) return ranges;
  // Higher gaps have wider ranges.
  bool between = false, platform = false;
  for (const PlanGap& g : gaps) {
    if (g.left_out || g.beside_grey) continue;
    bool& seen = g.at_platform ? platform : between;
    if (seen) continue;
    seen = true;
    ranges = common(ranges, g.at_platform ? platform_gap_speeds(light, g.slices, ask.gap_contrast)
                                          : gap_speeds(light, g.slices, ask.gap_contrast));
  }
  return ranges;
}

std::vector<PlanStep> next_steps(const PlanLight& light, double m, const PlanGap* gap,
                                 const PlanAsk& ask, double most_mm_h) {
  std::vector<PlanStep> steps;
  const auto add = [&](const std::string& change, const PlanLight& l, int slices) {
    PlanStep step;
    step.change = change;
    std::vector<PlanGap> gaps;
    if (gap) {
      gaps.push_back(*gap);
      gaps.back().slices = slices;
      if (!gap->at_platform) step.best = best_gap(l, slices);
    }
    const auto ranges = closed_ranges(l, gaps, ask);
    if (!ranges.empty() && (most_mm_h <= 0 || ranges.front().least_mm_h <= most_mm_h)) {
      step.range = ranges.back();
      step.speed_mm_h = ranges.back().greatest_mm_h;
      if (most_mm_h > 0 && *step.speed_mm_h > most_mm_h) {
        step.speed_mm_h = most_mm_h;
        step.held_back = true;
      }
    }
    steps.push_back(step);
  };
  const int g = gap ? gap->slices : 0;
  add("as it is", light, g);
  // The areal dose is the photochemistry's: light per height falls with the absorbance height.
  PlanLight l = light;
  const auto scaled = [&](double most, double least) {
    l = light;
    l.smax_mm_h *= most;
    l.smin_mm_h *= least;
  };
  scaled(0.8, 0.8);
  l.lam_um *= 0.8;
  add("absorbance height 20 % lower", l, g);
  scaled(1.25, 1.25);
  l.lam_um *= 1.25;
  add("absorbance height 25 % higher", l, g);
  scaled(std::pow(1.2, m), std::pow(1.2, m));
  add("light 20 % more", l, g);
  scaled(1, std::pow(0.5, m));
  add("black half as bright", l, g);
  scaled(1.25, 1.25);
  add("dose aimed at 20 % lower", l, g);
  scaled(1, 1);
  l.layer_um = light.layer_um / 2;
  add("slices half as high", l, 2 * g);
  if (g % 2 == 0 && g / 2 >= 2) {
    l.layer_um = light.layer_um * 2;
    add("slices twice as high", l, g / 2);
  }
  return steps;
}

}  // namespace slicecorr::detail
