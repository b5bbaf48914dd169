// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "bands/uv_of_slices.hpp"
#include "parallel/silent.hpp"
#include "plan/along_z.hpp"
#include "plan/closed.hpp"
#include "plan/planner.hpp"
#include "plan/refuse.hpp"
#include "plan/tolerances.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/machine_light.hpp"

namespace slicecorr {

namespace {

using detail::Bound;
using detail::DesignColumns;
using detail::gelling;
using detail::kPaceDigits;
using detail::pace_of;
using detail::PaceRange;
using detail::PartHeights;
using detail::Planner;
using detail::refuse_plan;
using detail::Trials;

void check(const SliceSource& target, const Setup& setup, const PlanAsk& ask) {
  const auto expect = [](bool holds, const std::string& what) {
    if (!holds) throw InputError(what);
  };
  expect(ask.tolerance_um > 0 && std::isfinite(ask.tolerance_um),
         fmt::format("a tolerance of {:g} um; expected one above 0", ask.tolerance_um));
  expect(ask.gap_contrast >= 0 && ask.gap_contrast < 1,
         fmt::format("a contrast of {:g}; expected 0 to below 1", ask.gap_contrast));
  expect(ask.light_error >= 0 && ask.light_error < 1,
         fmt::format("an error of the light of {:g}; expected 0 to below 1", ask.light_error));
  expect(ask.least_gap_um >= 0, "a least gap below 0 um");
  for (const double factor : ask.free.dose_factors) {
    expect(factor >= 1 && factor <= 1e3,
           fmt::format("a dose of {:g} times the gel dose to aim at; expected 1 to 1000", factor));
  }
  expect(!target.doses(), "wanted doses can't be planned for; expected a part without them");
  expect(!target.left_alone(), "what is left alone can't be planned for; expected the part alone");
  const Process& p = setup.process;
  expect(p.even_dead_zone == EvenDeadZone::off,
         "light for an even dead zone can't be planned for; expected UV light of one intensity");
  expect(
      !detail::chooses_uv_of_slices(p) || !setup.printer.flat_field,
      "UV light that changes from slice to slice can't be planned for where the display's light is uneven; expected "
      "one intensity, or a printer without display.flat_field");
  expect(p.layer_heights_um.empty(),
         "layers of different heights can't be planned for; expected layers of one height");
  expect(!setup.printer.uv_flat_field || p.uv.kind == UvKind::off,
         "uneven UV light ([uv] flat_field) can't be planned for; expected a printer without it");
  expect(p.uv_lamp_share.empty(),
         "a UV lamp that fades (uv_lamp_log) can't be planned for; expected all of its light");
  expect(
      p.lamp_share.empty(),
      "a lamp that fades (lamp_log) can't be planned for; expected the light of the calibration");
  expect(p.light_share.empty(),
         "light below full (light_share) can't be planned for; expected all of the light");
  expect(p.layer_exposure_s.empty(),
         "exposures of each layer can't be planned for; expected one of normal layers");
  expect(!ask.free.uv || p.uv.kind == UvKind::constant,
         "UV light is to be chosen; expected its greatest intensity");
  expect(!(ask.free.lamp && p.mode == ExposureMode::layerwise),
         "layer by layer less light only takes longer; expected the lamp not to be free");
}

std::vector<PaceRange> paces_of(const std::vector<SpeedRange>& ranges) {
  std::vector<PaceRange> paces;
  paces.reserve(ranges.size());
  for (const SpeedRange& r : ranges) paces.push_back({r.least_mm_h, r.greatest_mm_h});
  return paces;
}

/// All settings that are to be tried besides the speed, what the setup says first.
struct Candidate {
  Setup setup;
  std::string words;  ///< empty: as it is
  std::optional<double> dose_factor{};
};
void add_aims(const Setup& setup, std::vector<Candidate>& all) {
  constexpr std::array<double, 4> aims_um{0.5, 0.2, 1, 2};
  for (const double aim_um : aims_um) {
    all.push_back({setup, fmt::format("edges aimed at to {:g} um", aim_um)});
    all.back().setup.process.edge_aim_um = aim_um;
  }
}
std::vector<Candidate> candidates(const Setup& setup, const PlanFree& free) {
  std::vector<Candidate> all{{setup, ""}};
  if (free.omega_max) {
    constexpr std::array<double, 4> caps{kNoCap, 1.5, 1.2, 1.05};
    for (const double cap : caps) {
      if (cap == setup.process.omega_max) continue;
      all.push_back({setup, cap >= kNoCap ? std::string("no cap of the dose")
                                          : fmt::format("dose inside features at most {:g}", cap)});
      all.back().setup.process.omega_max = cap;
    }
  }
  if (free.edge_aim) add_aims(setup, all);
  for (const double factor : free.dose_factors) {
    Candidate c{setup, fmt::format("{:g} times the gel dose aimed at", factor), factor};
    c.setup.resin = with_overrides(c.setup.resin, {{}, {}, factor});
    all.push_back(std::move(c));
  }
  if (free.uv) {
    for (const double share : {0.9, 0.8, 0.7, 0.6, 0.5}) {
      const double uv = rounded_down(share * setup.process.uv.uv_mw_cm2, 4);
      all.push_back({setup, fmt::format("UV light of {:g} mW/cm²", uv)});
      all.back().setup.process.uv.uv_mw_cm2 = uv;
    }
  }
  return all;
}

/// What a print with these settings can do.
struct Found {
  PlanPoint at;
  Setup setup;
  std::string words;
  std::optional<double> dose_factor{};
  double lamp_share = 1;
  std::unique_ptr<Planner> planner;
  double most = 0;  ///< pace
};

/// The setup as columns alone see it.
Setup of_columns(Setup setup, std::vector<std::string>& notes) {
  if (!setup.printer.spread.none() || setup.resin.scatter_um2_per_um > 0) {
    setup.printer.spread = {};
    setup.resin.scatter_um2_per_um = 0;
    notes.emplace_back(
        "light spreads: each column is planned as if it stood alone; correct and verify say what "
        "spreading costs");
  }
  setup.process.slice_speed_mm_h.clear();
  setup.process.slice_lamps = SliceLamps::follow;
  return setup;
}

/// The print as the machine moves for it.
MovedPrint moved(const Setup& setup, const PrintPlan& plan, int slices) {
  const double m = make_kinetics(setup.resin, setup.process.uv.kind != UvKind::off, true).m;
  return {setup.process, m, setup.resin.absorbance_height10_um, plan.layer_um, slices};
}

/// What is planned is what the machine takes: its ramps, and nothing that it refuses.
void keep_to_machine(PrintPlan& plan) {
  const auto& machine = plan.ask.stage.motion;
  if (!machine) return;
  plan.setup = detail::as_machine_moves(std::move(plan.setup), plan.ask.stage);
  const int slices = plan.layers + plan.at.extra_slices;
  print_motion(moved(plan.setup, plan, slices), *machine);
  check_lamps({plan.setup.printer, plan.setup.resin, plan.setup.process, plan.layer_um, slices},
              *machine);
}

/// Slices that draw more than the vat bears go slower.
void hold_back(const SliceSource& target, PrintPlan& plan, const ExecutionContext& context) {
  Process& p = plan.setup.process;
  const auto limits = slice_speed_limits(target, plan.setup.printer, plan.setup.resin, p,
                                         plan.setup.gap_um, detail::silent(context));
  p.slice_speed_mm_h = plan.slice_speed_mm_h =
      speeds_within(limits, plan.at.speed_mm_h, plan.ask.stage.acceleration_mm_s2, plan.layer_um);
  const double uniform_s = plan.at.time_s * plan.at.speed_mm_h / plan.suction->speed_limit_mm_h;
  plan.uniform_time_s = uniform_s;
  plan.at.time_s = light_on_s(p, 1, plan.layer_um, plan.layers + plan.at.extra_slices);
  plan.notes.push_back(fmt::format(
      "{} from slice to slice, for what the vat bears: {:.4g} s, where one speed for all, {} mm/h, takes "
      "{:.4g} s",
      speeds_in_words(p), plan.at.time_s, at_most(plan.suction->speed_limit_mm_h), uniform_s));
}

/// Speeds of slices by light.
void change_along_z(const SliceSource& target, const DesignColumns& columns,
                    const PartHeights& heights, Planner& planner, PrintPlan& plan,
                    const ExecutionContext& context) {
  const char* const why_not =
      plan.setup.process.uv.kind != UvKind::off ? "UV light is on"
      : plan.setup.resin.has_gel_time()         ? "the resin has a time to gel"
      : !plan.light                             ? "the resin bleaches"
      : plan.setup.printer.flat_field           ? "the display's light is uneven"
      : light_spreads(plan.setup.printer, plan.setup.resin, plan.setup.process) ? "light spreads"
      : plan.lamp_share < 1 ? "less light is planned than the lamp has"
                            : nullptr;
  if (why_not) {
    plan.notes.push_back(
        fmt::format("the stage can change its speed, but {}: all slices have one speed", why_not));
    return;
  }
  detail::AlongZBounds bounds;
  bounds.uniform_mm_h = plan.at.speed_mm_h;
  bounds.acceleration_mm_s2 = plan.ask.stage.acceleration_mm_s2;
  double most_mm_h = plan.stage_mm_h > 0 ? plan.stage_mm_h : plan.light->smax_mm_h;
  if (plan.ask.stage.motion) {
    most_mm_h =
        std::min(most_mm_h, most_speed(moved(plan.setup, plan, 0), *plan.ask.stage.motion).mm_h);
  }
  bounds.most_mm_h.assign(static_cast<std::size_t>(plan.layers), most_mm_h);
  if (plan.suction && plan.suction->limit_given) {
    const auto limits =
        slice_speed_limits(target, plan.setup.printer, plan.setup.resin, plan.setup.process,
                           plan.setup.gap_um, detail::silent(context));
    for (std::size_t n = 0; n < std::min(limits.size(), bounds.most_mm_h.size()); ++n) {
      bounds.most_mm_h[n] = std::min(bounds.most_mm_h[n], limits[n]);
    }
  }
  const auto found =
      detail::speeds_along_z(planner, columns, heights, *plan.light, plan.ask, bounds);
  if (!found || found->point.time_s > 0.995 * plan.at.time_s) {
    plan.notes.emplace_back(
        "the stage can change its speed, but no other speeds of slices were found that save half a "
        "percent of the time");
    return;
  }
  plan.along_z = found->point;
  plan.slice_speed_mm_h = found->speed_mm_h;
  const Process with = planner.with_speeds(found->speed_mm_h).process;
  Process& p = plan.setup.process;
  p.speed_mm_h = with.speed_mm_h;
  p.slice_speed_mm_h = with.slice_speed_mm_h;
  p.slice_lamps = with.slice_lamps;
  plan.notes.push_back(
      fmt::format("{}: {:.4g} s, where one speed for all, {:g} mm/h, takes {:.4g} s",
                  speeds_in_words(p), found->point.time_s, plan.at.speed_mm_h, plan.at.time_s));
}

}  // namespace

PrintPlan plan_print(const SliceSource& whole_target, const Setup& asked, const PlanAsk& ask,
                     const ExecutionContext& context) {
  check(whole_target, asked, ask);
  const Setup counted = setup_to_correct(whole_target, asked, context);
  const SlicesAlone alone(whole_target);
  const SliceSource& target = counted.process.surface == Surface::mesh ? whole_target : alone;
  PrintPlan plan;
  plan.ask = ask;
  plan.mode = counted.process.mode;
  plan.layer_um = target.grid().layer_um;
  plan.layers = target.grid().layers;
  const bool continuous = plan.mode == ExposureMode::continuous;
  const Setup setup = of_columns(counted, plan.notes);
  plan.stage_mm_h = setup.printer.max_speed_mm_h;

  const DesignColumns columns(target, context);
  const Trials trials(target, columns, ask);
  PartHeights heights = detail::heights_of(columns, trials.least_gap_slices());
  plan.part_columns = columns.pixels();
  plan.distinct_columns = columns.columns().size();
  plan.features = heights.features;

  // Bounds that are not the light's.
  Bound bound;
  if (continuous) {
    if (plan.stage_mm_h > 0) {
      bound.take(plan.stage_mm_h, "stage",
                 fmt::format("the stage of '{}' does at most {} mm/h", setup.printer.name,
                             at_most(plan.stage_mm_h, 12)));
    }
    if (ask.stage.motion) {
      const MostSpeed most = most_speed(moved(setup, plan, 0), *ask.stage.motion);
      bound.take(most.mm_h, "machine", most.words);
    }
    Setup fast = setup;
    fast.process.speed_mm_h = std::max(1.0, gelling(setup, plan.layer_um).greatest);
    if (judges_suction(fast)) {
      plan.suction = print_suction(target, fast.printer, fast.resin, fast.process, fast.gap_um,
                                   detail::silent(context));
    }
    if (plan.suction && plan.suction->limit_given && !ask.stage.variable_speed) {
      bound.take(rounded_down(plan.suction->speed_limit_mm_h, kPaceDigits), "suction",
                 suction_in_words(*plan.suction, plan.suction->speed_limit_mm_h));
    }
    if (!plan.suction) {
      plan.notes.emplace_back(
          "resin flow and the pull on the part are not counted: the resin file has no "
          "viscosity_pa_s");
    } else if (!plan.suction->limit_given) {
      plan.notes.push_back(
          fmt::format("the printer file has no suction_limit_pa; at 1 bar, where resin cavitates, "
                      "slice {} bears {:.5g} mm/h",
                      plan.suction->slice, plan.suction->speed_limit_mm_h));
    }
    plan.notes.emplace_back(
        "green strength, heat and the time that diffusion takes are not counted");
  }

  // The fastest of all settings.
  std::unique_ptr<Found> best;
  const PlanGap* gap = detail::limiting_gap(heights.gaps);
  std::optional<PlanLight> light;
  std::vector<Candidate> all = candidates(setup, ask.free);
  bool aims = ask.free.edge_aim || setup.process.edge_aim_um > 0, unasked = false;
  for (std::size_t i = 0;; ++i) {
    if (i == all.size() && !best && light && !aims) {
      // Closed forms know a speed, and levels that place edges so finely spoil it.
      aims = unasked = true;
      add_aims(setup, all);
    }
    // Nobody waits for the best of what was not asked for.
    if (i == all.size() || (unasked && best)) break;
    const Candidate c = all[i];
    auto found = std::make_unique<Found>();
    try {
      found->planner = std::make_unique<Planner>(target, columns, heights, trials, c.setup, ask,
                                                 context, plan.tried);
    } catch (const InfeasibleError&) {
      if (c.words.empty()) throw;
      plan.chosen.push_back(c.words + ": does not print");
      continue;
    }
    Planner& planner = *found->planner;
    if (c.words.empty()) light = planner.light();
    const PaceRange gels = planner.gels();
    std::vector<PaceRange> ranges{gels};
    double most = std::min(gels.greatest, continuous ? bound.most_mm_h : gels.greatest);
    if (light && planner.light()) {
      const auto closed = detail::closed_ranges(*planner.light(), heights.gaps, ask);
      // Slices whose edges have heights of their own have gaps between whole slices.
      const bool proven = !columns.has_heights();
      if (closed.empty() && proven) {
        if (c.words.empty()) refuse_plan(ask, light, heights.gaps, trials, plan.tried, bound);
        continue;
      }
      if (!closed.empty()) ranges = paces_of(closed);
      const auto tolerated = tolerated_speeds(*planner.light(), ask.tolerance_um, ask.light_error);
      if (!tolerated) refuse_plan(ask, light, heights.gaps, trials, plan.tried, bound);
      most = std::min(most, tolerated->greatest_mm_h);
    }
    std::optional<PlanPoint> point = planner.fastest(ranges, most);
    found->setup = c.setup;
    if (!point && continuous && ask.free.lamp && std::isfinite(bound.most_mm_h)) {
      // Less light at the speed of the bound does what more speed would do.
      point = planner.fastest(ranges, gels.greatest);
      if (point && point->speed_mm_h > bound.most_mm_h) {
        found->lamp_share = std::pow(bound.most_mm_h / point->speed_mm_h, 1 / planner.m());
      }
    }
    if (!point) {
      plan.chosen.push_back((c.words.empty() ? std::string("as it is") : c.words) +
                            ": no speed that was tried keeps what is asked for");
      continue;
    }
    found->at = *point;
    found->words = c.words;
    found->dose_factor = c.dose_factor;
    found->most = most;
    const bool faster = !best || pace_of(found->at) > pace_of(best->at) * detail::kPaceStep;
    if (!c.words.empty()) {
      plan.chosen.push_back(c.words + (continuous ? fmt::format(": {:g} mm/h", point->speed_mm_h)
                                                  : fmt::format(": {:g} s", point->exposure_s)));
    }
    if (faster) best = std::move(found);
  }
  if (!best) refuse_plan(ask, light, heights.gaps, trials, plan.tried, bound);

  Planner& planner = *best->planner;
  plan.at = best->at;
  plan.lamp_share = best->lamp_share;
  plan.with = best->words;
  plan.dose_factor = best->dose_factor;
  plan.light = planner.light();
  plan.setup = best->setup;
  plan.setup.printer = asked.printer;
  plan.setup.resin =
      best->dose_factor ? with_overrides(asked.resin, {{}, {}, best->dose_factor}) : asked.resin;
  (continuous ? plan.setup.process.speed_mm_h : plan.setup.process.exposure_s) =
      continuous ? plan.at.speed_mm_h : plan.at.exposure_s;
  const double pace = pace_of(plan.at);

  // What a little more speed does, and a tenth less.
  const double next = pace * detail::kPaceStep;
  if (continuous && plan.lamp_share < 1) {
    plan.limited_by = bound.word;
    plan.limit = bound.words;
    plan.at.speed_mm_h = plan.setup.process.speed_mm_h = bound.most_mm_h;
    plan.at.time_s *= best->at.speed_mm_h / bound.most_mm_h;
  } else if (next <= best->most) {
    plan.faster = planner.at(next);
    plan.limited_by = plan.faster->limited_by;
    plan.limit = plan.faster->why;
    plan.limit_place = plan.faster->place;
  } else if (continuous && bound.most_mm_h <= best->most * (1 + 1e-9)) {
    plan.limited_by = bound.word;
    plan.limit = bound.words;
  } else if (plan.light && ask.light_error > 0 &&
             next > plan.light->smax_mm_h /
                        (1 + plan.light->lam_um * ask.light_error / ask.tolerance_um)) {
    plan.limited_by = "tolerance";
    plan.limit = fmt::format(
        "an error of {:g} % of the light moves lower edges by {:g} um: full light is only {:.4g} "
        "times what gels",
        100 * ask.light_error, ask.tolerance_um, plan.light->full(pace));
  } else {
    plan.limited_by = "light";
    plan.limit = "full light just gels the resin";
  }
  plan.slower = planner.at(0.9 * pace);

  if (plan.light) {
    plan.ranges = detail::closed_ranges(*plan.light, heights.gaps, ask);
    for (PlanGap& g : heights.gaps) {
      if (g.left_out || g.beside_grey) continue;
      if (g.at_platform) {
        g.ranges = platform_gap_speeds(*plan.light, g.slices, ask.gap_contrast);
      } else {
        g.ranges = gap_speeds(*plan.light, g.slices, ask.gap_contrast);
        g.best = best_gap(*plan.light, g.slices);
      }
    }
    plan.steps = detail::next_steps(*plan.light, planner.m(), gap, ask,
                                    std::isfinite(bound.most_mm_h) ? bound.most_mm_h : 0);
  }
  plan.gaps = heights.gaps;

  // The curve: from the slowest speed that prints to a little beyond the fastest.
  if (ask.curve_points > 0) {
    const double low = std::max(planner.gels().least, 0.02 * pace),
                 high = std::min(planner.gels().greatest, 1.3 * pace);
    std::vector<double> paces{pace, next};
    for (int k = 0; k < ask.curve_points; ++k) {
      paces.push_back(low * std::pow(high / low, (k + 0.5) / ask.curve_points));
    }
    std::sort(paces.begin(), paces.end());
    for (const double p : paces) {
      if (p <= planner.gels().greatest) plan.curve.push_back(planner.at(p));
    }
  }
  if (ask.tolerance_points > 0 && plan.lamp_share == 1) {
    plan.tolerances = detail::tolerance_curve(planner, ask, heights.gaps, bound);
  }
  plan.uniform_time_s = plan.at.time_s;
  if (ask.stage.variable_speed && continuous) {
    if (plan.suction && plan.suction->limit_given &&
        plan.at.speed_mm_h > plan.suction->speed_limit_mm_h) {
      hold_back(target, plan, context);
    } else {
      change_along_z(target, columns, heights, planner, plan, context);
    }
  }
  keep_to_machine(plan);
  plan.judged_columns = planner.judged();
  context.report("plan", 1);
  return plan;
}

}  // namespace slicecorr
