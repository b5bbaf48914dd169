// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan.hpp"
#include "slicecorr/limit.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

namespace {

std::string time_in_words(double s) {
  const long total = std::lround(s);
  return total >= 3600 ? fmt::format("{} h {} min", total / 3600, total % 3600 / 60)
         : total >= 60 ? fmt::format("{} min {} s", total / 60, total % 60)
                       : fmt::format("{:.1f} s", s);
}

std::string time_in_words(const PrintTime& t) {
  if (!t.dark_s) return time_in_words(t.light_s) + " of light (lifts not known)";
  if (*t.dark_s == 0) return time_in_words(t.light_s);
  return time_in_words(*t.all_s()) + ", of it " + time_in_words(t.light_s) + " of light";
}
/// Short, for tables: with lifts where these are known.
double told_s(const PrintTime& t) { return t.all_s().value_or(t.light_s); }

std::string pace(const PlanPoint& p) {
  return p.exposure_s > 0 ? fmt::format("{:g} s", p.exposure_s)
                          : fmt::format("{:g} mm/h", p.speed_mm_h);
}

/// Whether an edge at a gap was judged: not where all gaps are left out. What is left then are ends of
/// features with nothing behind them, which are right by themselves.
bool edges_judged(const PlanPoint& p) { return p.contrast_at.x >= 0; }

std::string keeps(const PlanPoint& p) {
  return edges_judged(p) ? "keeps all" : "prints; no edge at a gap was judged";
}

std::string row(const PlanPoint& p) {
  if (!p.prints) return fmt::format("  {:>12}  {}", pace(p), p.limited_by);
  const auto um = [&](double value) {
    return edges_judged(p) ? fmt::format("{:.3f}", value) : std::string("-");
  };
  return fmt::format("  {:>12}  {:>8}  {:>8}  {:>8}  {:>12}  {}", pace(p), um(p.mean_abs_um),
                     um(p.max_abs_um),
                     p.contrast_at.x >= 0 ? fmt::format("{:.4f}", p.contrast) : std::string("-"),
                     time_in_words(told_s(p.print_time())), p.keeps ? keeps(p) : p.limited_by);
}

std::string ranges_in_words(const std::vector<SpeedRange>& ranges) {
  std::string text;
  for (const SpeedRange& r : ranges) {
    text += fmt::format("{}{:.2f} to {:.2f}", text.empty() ? "" : " and ", r.least_mm_h,
                        r.greatest_mm_h);
  }
  return text.empty() ? "none" : text + " mm/h";
}

/// Gaps for which nothing is promised: the first line says so, because the print has them all the same.
std::string left_out_in_words(const PrintPlan& plan) {
  std::uint64_t pixels = 0;
  int slices = 0;
  for (const PlanGap& g : plan.gaps) {
    if (!g.left_out) continue;
    pixels += g.count;
    slices = std::max(slices, g.slices);
  }
  if (pixels == 0) return {};
  return fmt::format("; not counted are gaps of up to {:g} um ({} pixels), which may close",
                     slices * plan.layer_um, text::count(static_cast<std::int64_t>(pixels)));
}

std::string gap_in_words(const PrintPlan& plan, const PlanGap& g) {
  std::string text =
      fmt::format("  {:>3} slice{}, {:g} um{}{}: {} pixels, first {}, {}, slices {} to {}",
                  g.slices, g.slices == 1 ? " " : "s", g.slices * plan.layer_um,
                  g.at_platform ? ", from the platform" : "", g.beside_grey ? ", beside grey" : "",
                  g.count, g.place.x, g.place.y, g.place.first, g.place.last);
  if (g.left_out) return text + "; left out";
  if (!plan.light || g.beside_grey) return text;
  text += "; " + ranges_in_words(g.ranges);
  if (g.best) {
    text += fmt::format(", best {:.4f} at {:.2f} mm/h", g.best->contrast, g.best->speed_mm_h);
  }
  return text;
}

}  // namespace

std::string plan_text(const PrintPlan& plan) {
  const bool continuous = plan.mode == ExposureMode::continuous;
  const std::string asked =
      edges_judged(plan.at)
          ? fmt::format("with edges within {:g} um and a contrast of {:g} in gaps{}",
                        plan.ask.tolerance_um, plan.ask.gap_contrast, left_out_in_words(plan))
          : std::string("that prints; no edge at a gap was judged, because no gap is planned for");
  std::string text = fmt::format(
      "{}: the {} {}\n"
      "limited by {}: {}\n"
      "print {}, {} slices after the part's end\n",
      pace(plan.at), continuous ? "fastest" : "least exposure", asked, plan.limited_by, plan.limit,
      time_in_words(plan.at.print_time()), plan.at.extra_slices);
  if (!continuous) {
    text += "a layer takes " +
            layer_time(plan.setup.process, plan.setup.lift_times, plan.layer_um).in_words();
    text += "\n";
  }
  if (!plan.slice_speed_mm_h.empty()) {
    const Process& p = plan.setup.process;
    const double time_s = plan.along_z ? plan.along_z->time_s : plan.at.time_s;
    text += fmt::format("speeds of slices: {}; {}, {:.1f} % less than with one speed\n",
                        speeds_in_words(p), time_in_words(time_s),
                        100 * (1 - time_s / plan.uniform_time_s));
    if (plan.along_z) {
      text += fmt::format("  edges off by {:.3f} um at most", plan.along_z->max_abs_um);
      if (plan.along_z->contrast_at.x >= 0) {
        text += fmt::format(", contrast {:.4f} at least", plan.along_z->contrast);
      }
      text += "\n";
    }
    text += fmt::format(
        "  correct takes --speed-mm-h {:g} --slice-speed-mm-h FILE{}, FILE from --slice-speeds\n",
        p.speed_mm_h, p.slice_lamps == SliceLamps::stay ? " --slice-lamps stay" : "");
  }
  if (plan.setup.process.ramp == Ramp::lamp_follows) {
    text += fmt::format(
        "ramps: the lamps follow the stage over the first and last {:g} mm; correct does this "
        "(--ramp lamp-follows --ramp-mm {:g})\n",
        plan.setup.process.ramp_mm, plan.setup.process.ramp_mm);
  }
  if (!plan.with.empty()) {
    text += "with " + plan.with;
    if (plan.setup.process.edge_aim_um > 0) {
      text += fmt::format(": correct takes --edge-aim-um {:g}", plan.setup.process.edge_aim_um);
    }
    if (plan.dose_factor) {
      text += fmt::format(": correct takes --dose-factor {:g}", *plan.dose_factor);
    }
    text += "\n";
  }
  if (plan.lamp_share < 1) {
    text += fmt::format(
        "lamp: {:.4g} of its light; the calibration of the printer file times this share\n",
        plan.lamp_share);
  }
  if (plan.light) {
    const PlanLight& l = *plan.light;
    const double s = plan.at.speed_mm_h * std::pow(plan.lamp_share, -1.0);
    text += fmt::format(
        "light: full {:.4g} and black {:.4g} times what gels; full light gels up to {:.2f}, black "
        "below {:.2f} mm/h\n",
        l.full(s), l.black(s), l.smax_mm_h, l.smin_mm_h);
    text += fmt::format("closed forms: {}\n", ranges_in_words(plan.ranges));
  }
  if (plan.faster) {
    text += fmt::format("half a percent faster, {}: {}\n", pace(*plan.faster),
                        plan.faster->keeps ? keeps(*plan.faster) : plan.faster->why);
  }
  if (plan.slower) {
    text += fmt::format("a tenth slower, {}: {}\n", pace(*plan.slower),
                        plan.slower->keeps ? keeps(*plan.slower) : plan.slower->why);
  }
  for (const std::string& words : plan.chosen) text += "tried: " + words + "\n";
  if (!plan.gaps.empty()) {
    text += "gaps, the lowest:\n";
    constexpr std::size_t kMost = 6;
    for (std::size_t i = 0; i < std::min(kMost, plan.gaps.size()); ++i) {
      text += gap_in_words(plan, plan.gaps[i]) + "\n";
    }
  }
  if (!plan.curve.empty()) {
    text +=
        fmt::format("  {:>12}  {:>8}  {:>8}  {:>8}  {:>12}\n", continuous ? "speed" : "exposure",
                    "mean, um", "most, um", "contrast", "time");
    for (const PlanPoint& p : plan.curve) text += row(p) + "\n";
  }
  if (!plan.tolerances.empty()) {
    text += fmt::format("  {:>13}  {:>12}  {:>12}  {}\n", "tolerance, um",
                        continuous ? "speed" : "exposure", "time", "limited by");
    for (const PlanTolerance& t : plan.tolerances) {
      text += fmt::format("  {:>13g}  {:>12}  {:>12}  {}\n", t.tolerance_um,
                          t.at ? pace(*t.at) : std::string("none"),
                          t.at ? time_in_words(told_s(t.at->print_time())) : std::string("-"),
                          t.limited_by);
    }
  }
  if (!plan.steps.empty()) {
    text += "the next step, by closed forms:\n";
    for (const PlanStep& s : plan.steps) {
      text += fmt::format(
          "  {:<32} {}{}{}\n", s.change,
          s.speed_mm_h ? fmt::format("{:.2f} mm/h", *s.speed_mm_h) : std::string("no speed"),
          s.held_back ? " (held back by stage or suction)" : "",
          s.best ? fmt::format("; best contrast {:.4f}", s.best->contrast) : "");
    }
  }
  if (!plan.orientations.empty()) {
    text += "orientations, turned by X,Y,Z degrees:\n";
    for (const PlanOrientation& o : plan.orientations) {
      const std::string turned =
          fmt::format("{:g},{:g},{:g}", o.rotate_deg[0], o.rotate_deg[1], o.rotate_deg[2]);
      text += o.prints ? fmt::format("  {:<14} {:>12} slices in {}, limited by {}{}\n", turned,
                                     o.layers, time_in_words(told_s(o.time)), o.limited_by,
                                     o.chosen ? "; chosen" : "")
                       : fmt::format("  {:<14} {}\n", turned, o.limited_by);
    }
  }
  for (const std::string& note : plan.notes) text += "note: " + note + "\n";
  return text;
}

}  // namespace slicecorr::cli
