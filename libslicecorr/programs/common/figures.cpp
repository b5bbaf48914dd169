// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/bodies.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "slicecorr/verdict.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::cli {

namespace {

/// Of edges; under UV light single exposures have none.
std::string um_or_dash(const Histogram& errors, double um) {
  return errors.count() > 0 ? fmt::format("{:.3f} um", um) : "-";
}

}  // namespace

std::string figures_table(const std::vector<Figures>& columns) {
  std::string text;
  std::size_t width = 18;
  for (const Figures& c : columns) width = std::max(width, c.heading.size() + 2);
  const auto line = [&](const std::string& name, auto figure) {
    text += fmt::format("  {:<34}", name);
    for (const Figures& c : columns) text += fmt::format("{:>{}}", figure(*c.prediction), width);
    text += "\n";
  };
  if (columns.size() > 1) {
    text += fmt::format("  {:<34}", "");
    for (const Figures& c : columns) text += fmt::format("{:>{}}", c.heading, width);
    text += "\n";
  }
  const auto errors = [&](const char* what, Histogram Prediction::*of) {
    const auto um = [&](const Prediction& p, double value) {
      return (p.*of).count() ? fmt::format("{:.3f} um", value) : std::string("-");
    };
    const auto name = [&](const char* figure) { return fmt::format("{}, {}", what, figure); };
    line(name("mean"), [&](const Prediction& p) { return um(p, (p.*of).mean()); });
    line(name("95 % within"), [&](const Prediction& p) { return um(p, (p.*of).quantile(0.95)); });
    line(name("largest"), [&](const Prediction& p) { return um(p, (p.*of).greatest()); });
  };
  errors("height error", &Prediction::height_error_um);
  const bool any_surface = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->surface_error_um.count() > 0;
  });
  if (any_surface) errors("distance to the mesh", &Prediction::surface_error_um);
  const bool any_plane = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->plane_error_um.count() > 0;
  });
  if (any_plane) {
    errors("error in the plane", &Prediction::plane_error_um);
    line("outlines outwards, on average", [](const Prediction& p) {
      return p.plane_error_um.count() ? fmt::format("{:+.3f} um", p.plane_signed_um())
                                      : std::string("-");
    });
    line("edges closed up in the plane",
         [](const Prediction& p) { return fmt::format("{}", p.plane_closed); });
    line("edges of lines lost in the plane",
         [](const Prediction& p) { return fmt::format("{}", p.plane_lost); });
  }
  line("gap voxels cured through",
       [](const Prediction& p) { return fmt::format("{}", p.cure_through_voxels); });
  line("feature voxels undercured",
       [](const Prediction& p) { return fmt::format("{}", p.undercure_voxels); });
  const bool any_joints = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->joints.has_value();
  });
  if (any_joints) {
    const auto joints = [&](const char* name, auto value) {
      line(name,
           [&](const Prediction& p) { return p.joints ? value(*p.joints) : std::string("-"); });
    };
    joints("least dose at a joint", [](const JointFigures& j) {
      return std::isfinite(j.least) ? fmt::format("{:.4f}", j.least) : std::string("-");
    });
    joints("voxels that do not hold at their lift",
           [](const JointFigures& j) { return fmt::format("{}", j.not_holding_voxels); });
    joints("films over gaps", [](const JointFigures& j) { return fmt::format("{}", j.films); });
    joints("liquid layers over gaps, at most",
           [](const JointFigures& j) { return fmt::format("{}", j.liquid_layers_max); });
    joints("edges over gaps if lifts exchange resin, mean", [](const JointFigures& j) {
      return um_or_dash(j.exchanged_error_um, j.exchanged_error_um.mean());
    });
    joints("edges over gaps if lifts exchange resin, largest", [](const JointFigures& j) {
      return um_or_dash(j.exchanged_error_um, j.exchanged_max_um);
    });
    joints("edges over gaps if all resin stays, mean", [](const JointFigures& j) {
      return um_or_dash(j.staying_error_um, j.staying_error_um.mean());
    });
    joints("edges over gaps if all resin stays, largest",
           [](const JointFigures& j) { return um_or_dash(j.staying_error_um, j.staying_max_um); });
  }
  line("column features lost",
       [](const Prediction& p) { return fmt::format("{} of {}", p.lost_features, p.runs); });
  const bool any_split = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->split_features > 0;
  });
  if (any_split) {
    line("column features in pieces",
         [](const Prediction& p) { return fmt::format("{} of {}", p.split_features, p.runs); });
    line("least dose in features", [](const Prediction& p) {
      return p.target_voxels && !p.at_heights ? fmt::format("{:.4f}", p.min_inside_layers)
                                              : std::string("-");
    });
  }
  line("column gaps merged",
       [](const Prediction& p) { return fmt::format("{} of {}", p.merged_features, p.gaps); });
  line("one-slice gaps", [](const Prediction& p) { return fmt::format("{}", p.one_slice_gaps); });
  line("least contrast of gaps", [](const Prediction& p) {
    return p.gap_contrast.count() ? fmt::format("{:.4f}", p.gap_contrast.least())
                                  : std::string("-");
  });
  line(fmt::format("open gaps of a contrast below {:g}", kLeastGapContrast),
       [](const Prediction& p) { return fmt::format("{} of {}", narrow_gaps(p), p.gaps); });
  const auto bodies = [&](const char* name, std::uint64_t Bodies::*count, bool timed = false) {
    const bool any = std::any_of(columns.begin(), columns.end(), [&](const Figures& f) {
      return f.prediction->bodies && f.prediction->bodies->printed.*count > 0;
    });
    if (!any) return;
    line(name, [&](const Prediction& p) {
      const bool told = p.bodies && (p.bodies->printed.in_time || !timed);
      return told ? fmt::format("{}", p.bodies->printed.*count) : std::string("-");
    });
  };
  // Where it is known of one print when it gels, what another one looks like without is no comparison.
  const bool in_time = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->bodies && f.prediction->bodies->printed.in_time;
  });
  bodies("bodies that begin hanging on nothing", &Bodies::islands_in_all, in_time);
  bodies("loose bodies", &Bodies::loose_bodies);
  bodies("sealed cavities", &Bodies::sealed_in_all);
  bodies("cups", &Bodies::cups_in_all);
  const bool any_left = std::any_of(columns.begin(), columns.end(), [](const Figures& f) {
    return f.prediction->left_alone_voxels > 0;
  });
  if (any_left) {
    line("voxels left alone",
         [](const Prediction& p) { return fmt::format("{}", p.left_alone_voxels); });
  }
  line("overlap with the design",
       [](const Prediction& p) { return fmt::format("{:.6f}", p.iou()); });
  return text;
}

namespace {

/// Wanted doses beside those that print; empty where none are wanted.
std::string doses_table(const Prediction& p) {
  if (p.regions.empty()) return {};
  std::string text =
      fmt::format("  {:<34}{:>12}{:>18}{:>10}{:>10}{:>10}{:>12}{:>12}\n", "dose of", "voxels",
                  "wanted", "least", "mean", "greatest", "most below", "most above");
  for (const RegionDose& r : p.regions) {
    if (r.voxels == 0) {
      text += fmt::format("  {:<34}{:>12}\n", r.name, 0);
      continue;
    }
    const std::string wanted =
        r.least_wanted == r.greatest_wanted
            ? fmt::format("{:.4g}", r.least_wanted)
            : fmt::format("{:.4g}-{:.4g}", r.least_wanted, r.greatest_wanted);
    text +=
        fmt::format("  {:<34}{:>12}{:>18}{:>10.4f}{:>10.4f}{:>10.4f}{:>12.4f}{:>12.4f}\n", r.name,
                    r.voxels, wanted, r.least, r.mean(), r.greatest, r.most_below, r.most_above);
  }
  return text;
}

/// Dose and dead zone in resin that flows, slice by slice; empty where no light was made for it.
std::string flow_table(const Prediction& p) {
  if (!p.flow || p.flow->slices.empty()) return {};
  const FlowDoses& flow = *p.flow;
  std::string text = fmt::format(
      "  flow: dead zone of {:.4g} um; by the light that the images show {:.1f} % of the sections get "
      "their dose within 10 %, by the best that is the same everywhere {:.1f} %\n",
      flow.gap_um, 100 * flow.within_10(), 100 * flow.within_10_without());
  std::size_t sticks = 0, sticks_without = 0;
  const FlowDoses::Slice* worst = nullptr;
  for (const FlowDoses::Slice& s : flow.slices) {
    sticks_without += s.without.max_window >= 1 ? 1 : 0;
    if (s.even.max_window < 1) continue;
    ++sticks;
    if (!worst || s.even.max_window > worst->even.max_window) worst = &s;
  }
  if (worst) {
    text += fmt::format(
        "  flow: resin gels at the window in {} of {} slices looked at, most in slice {} (dose {:.2f}); "
        "with light that is the same everywhere in {}\n",
        sticks, flow.slices.size(), worst->slice, worst->even.max_window, sticks_without);
  }
  text += fmt::format("  {:>7}{:>19}{:>24}{:>24}{:>24}{:>10}\n", "slice", "within 10 %, %",
                      "dose, min mean max", "dead zone, um", "without, um", "window");
  // A screen full; all of them are in the JSON.
  constexpr std::size_t most = 20;
  const std::size_t step = (flow.slices.size() + most - 1) / most;
  for (std::size_t i = 0; i < flow.slices.size(); i += step) {
    const FlowDoses::Slice& s = flow.slices[i];
    const auto range = [](const FrontDose& f) {
      return fmt::format("{:.1f} to {:.1f}", f.dead_zone_min_um, f.dead_zone_max_um);
    };
    text += fmt::format(
        "  {:>7}{:>19}{:>24}{:>24}{:>24}{:>10.3f}\n", s.slice,
        fmt::format("{:.1f} ({:.1f})", 100 * s.even.within_10, 100 * s.without.within_10),
        fmt::format("{:.3f} {:.3f} {:.3f}", s.even.min, s.even.mean, s.even.max), range(s.even),
        range(s.without), s.even.max_window);
  }
  return text;
}

}  // namespace

std::string lifts_line(const std::string& format, const Process& process) {
  const std::string words = holds_without_lifts(format, process);
  return words.empty() ? words : words + "\n";
}

std::string figures_json(const Prediction& p) {
  auto json = slicecorr::detail::own_json<nlohmann::ordered_json>(p.to_json());
  if (p.areas) {
    json.update(slicecorr::detail::own_json<nlohmann::ordered_json>(p.areas->to_json()));
  }
  return json.dump(2);
}

std::string summary(const Prediction& after, const std::optional<Prediction>& before) {
  std::vector<Figures> columns;
  if (before) columns.push_back({"uncorrected", &*before});
  columns.push_back({"corrected", &after});
  // What can be relied on comes before what is computed from inputs as if they were right.
  std::string text = after.uncertain ? uncertainty_in_words(*after.uncertain) : std::string();
  text += figures_table(columns) + doses_table(after) + flow_table(after);
  if (after.areas) text += after.areas->in_words();
  if (const auto& l = after.layerwise) {
    text += fmt::format(
        "  layer by layer: black light alone cures {:.3f} um above a feature{}; the dose within a "
        "layer varies {:.3f}-fold{}{}\n",
        l->cut_through_um,
        l->max_cut_through_um > l->cut_through_um
            ? fmt::format(" ({:.3f} um where exposures are longest)", l->max_cut_through_um)
            : "",
        l->heterogeneity,
        l->gels_further_teeth ? "; it is enough to gel layers further up beside their windows" : "",
        after.joints ? "" : "; whether layers hold when a platform lifts is not looked at");
  }
  if (const auto& zones = after.dead_zones; zones && std::isfinite(zones->least())) {
    // Flow's own figures are above.
    text +=
        fmt::format("  dead zone over lit pixels{}: {:.3f} to {:.3f} um{}\n",
                    after.flow ? ", if resin stood still" : "", zones->least(), zones->greatest(),
                    zones->cured_pixels == 0
                        ? ""
                        : fmt::format("; the resin cures to the window at {} pixels, first in "
                                      "slice {}",
                                      zones->cured_pixels, zones->cured_slice));
  }
  text += verdict_of(after).words + "\n";
  const std::string worse = before ? worse_than_none(after, *before) : std::string();
  return worse.empty() ? text : text + worse + "\n";
}

}  // namespace slicecorr::cli
