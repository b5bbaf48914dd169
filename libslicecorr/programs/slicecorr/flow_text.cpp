// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "slicecorr/limit.hpp"

namespace slicecorr::cli {

namespace {

using nlohmann::ordered_json;

std::string pressure(double pa) {
  return pa >= 1e5   ? fmt::format("{:.3f} bar", pa * 1e-5)
         : pa >= 1e3 ? fmt::format("{:.3f} kPa", pa * 1e-3)
                     : fmt::format("{:.2f} Pa", pa);
}

std::string counted(int count, const char* what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

double height_mm(const FlowFindings& f, int slice) { return (slice + 0.5) * f.layer_um * 1e-3; }

/// Whether resin never leaves a blind void again, once a slice has closed it.
bool is_sealed(const FlowFindings& f, const BlindVoid& v) {
  return !v.vented && !v.from_platform && v.last + 1 < f.part_slices;
}

std::string blind_in_words(const FlowFindings& f, const BlindVoid& v) {
  return fmt::format("{}, x {:.2f}, y {:.2f} mm, slices {} to {}, {:.4g} mm³{}{}",
                     is_sealed(f, v) ? "sealed" : "cup", v.x_mm, v.y_mm, v.first, v.last,
                     v.volume_mm3, v.from_platform ? ", from the platform on" : "",
                     v.vented ? ", open to the bath after that" : "");
}

/// What the figures take for granted.
std::string steady_in_words(const FlowFindings& f) {
  return fmt::format(
      "taken as steady: each slice as if its section were printed for ever; suction, dose and window's "
      "dose in a gap of {:.4g} um everywhere, the dead zone where each front comes to rest (~: it does "
      "not, a first step). --in-time follows the print from its first instant",
      f.pull.gap_um);
}

/// Slices that stick, the first of them.
struct Sticking {
  std::size_t count = 0;
  int first = -1;
  void add(const SliceFlow& s) {
    if (count++ == 0) first = s.slice;
  }
};

/// By the dead zone that the light leaves where it is known; else by the even gap, which says less.
void warn_of_sticking(const FlowFindings& f, std::vector<std::string>& all) {
  constexpr double kSticks = 0.98;
  Sticking known, assumed, restless;
  for (const SliceFlow& s : f.slices) {
    if (!s.dose) continue;
    if (!s.zone_at_rest) restless.add(s);
    if (s.zone_at_rest && s.zone_window >= kSticks) known.add(s);
    if (!s.zone_at_rest && s.dose->max_window >= kSticks) assumed.add(s);
  }
  if (known.count > 0) {
    all.push_back(fmt::format(
        "in {} slices, the first of them slice {}, resin at the window comes to 98 % of its gel dose "
        "and more under the dead zone that the light leaves: it sticks there",
        known.count, known.first));
  }
  if (restless.count > 0) {
    all.push_back(fmt::format(
        "in {} of {} slices, the first of them slice {}, the front does not come to rest: their dead "
        "zone is a first step from the even gap; --in-time follows the print",
        restless.count, f.slices.size(), restless.first));
  }
  if (assumed.count > 0) {
    all.push_back(fmt::format(
        "in {} of these, the first of them slice {}, resin at the window would come to 98 % of its gel "
        "dose and more if the gap were {:.4g} um everywhere: it may stick there",
        assumed.count, assumed.first, f.pull.gap_um));
  }
}

}  // namespace

std::vector<const SliceFlow*> slowest_apart(const FlowFindings& f, std::size_t most) {
  std::vector<const SliceFlow*> sorted;
  for (const SliceFlow& s : f.slices) sorted.push_back(&s);
  std::stable_sort(sorted.begin(), sorted.end(), [](const SliceFlow* a, const SliceFlow* b) {
    return a->speed_limit_mm_h < b->speed_limit_mm_h;
  });
  const int apart = std::max(1, f.part_slices / 20);
  std::vector<const SliceFlow*> chosen;
  for (const SliceFlow* s : sorted) {
    if (chosen.size() == most) break;
    const bool told = std::any_of(chosen.begin(), chosen.end(), [&](const SliceFlow* c) {
      return c->mask == s->mask || std::abs(c->slice - s->slice) < apart;
    });
    if (!told) chosen.push_back(s);
  }
  return chosen;
}

const SliceFlow& FlowFindings::slowest() const {
  return *std::min_element(slices.begin(), slices.end(),
                           [](const SliceFlow& a, const SliceFlow& b) {
                             return a.speed_limit_mm_h < b.speed_limit_mm_h;
                           });
}

std::vector<std::string> flow_warnings(const FlowFindings& f) {
  std::vector<std::string> all;
  const SliceFlow& worst = f.slowest();
  if (worst.speed_limit_mm_h < f.pull.speed_mm_h) {
    all.push_back(fmt::format("{:g} mm/h is too fast: slice {} bears at most {} mm/h before {}",
                              f.pull.speed_mm_h, worst.slice, at_most(worst.speed_limit_mm_h),
                              f.limit_given ? "the printer's limit" : "resin cavitates"));
  }
  if (!f.platform.slices.empty() &&
      f.platform.slices.front().speed_limit_mm_h < f.pull.speed_mm_h) {
    const PlatformFlow::Slice& first = f.platform.slices.front();
    all.push_back(fmt::format(
        "the platform's early slices: under {:g} x {:g} mm of platform slice 0 bears {} mm/h; beside "
        "the part the gap grows until the part takes over after {} ({:.0f} um)",
        f.platform.width_mm, f.platform.height_mm, at_most(first.speed_limit_mm_h),
        counted(f.platform.changeover_slice, "slice"), f.platform.changeover_um));
  }
  if (!f.blind.empty()) {
    const double volume = [&] {
      double sum = 0;
      for (const BlindVoid& v : f.blind) sum += v.volume_mm3;
      return sum;
    }();
    all.push_back(fmt::format(
        "{} blind {} of {:.4g} mm³ in all fill through the gap; the largest: {}", f.blind.size(),
        f.blind.size() == 1 ? "void" : "voids", volume, blind_in_words(f, f.blind.front())));
  }
  std::size_t thick = 0, bound = 0;
  double area = 0, near = 0;
  for (const SliceFlow& s : f.slices) {
    bound += s.bound ? 1 : 0;
    thick += !s.bound && f.pull.gap_um > 0.2 * s.width_um ? 1 : 0;
    area += s.area_mm2;
    near += s.area_mm2 * s.near_outline;
  }
  if (thick > 0) {
    all.push_back(fmt::format(
        "in {} of {} slices the gap is more than a fifth of the part's widest place: the thin gap does "
        "not hold there",
        thick, f.slices.size()));
  }
  if (bound > 0) {
    all.push_back(fmt::format(
        "{} of {} slices are less than three cells wide: their suction is an upper bound", bound,
        f.slices.size()));
  }
  if (area > 0 && near > 0.3 * area) {
    all.push_back(
        fmt::format("{:.0f} % of the area is nearer to an outline than the gap is thick, where the "
                    "thin gap does not hold",
                    100 * near / area));
  }
  if (f.window) {
    for (std::string& text : window_warnings(*f.window, f.slices)) all.push_back(std::move(text));
  }
  if (!f.pull.light) return all;
  const FlowResin& r = *f.pull.resin;
  const double across = f.pull.speed_mm_h / 3.6e6 * f.pull.gap_um * 1e-6;
  if (r.inhibitor_life_s > 0 && across > 1000 * r.diffusion_m2_s) {
    all.push_back(fmt::format(
        "the Péclet number S h/c is {}: with inhibitor that lasts, the dose in the middle grows "
        "without end as diffusion goes (dose_diffusion_m2_s)",
        r.diffusion_m2_s > 0 ? fmt::format("{:.0f}", across / r.diffusion_m2_s)
                             : std::string("infinite")));
  }
  warn_of_sticking(f, all);
  if (f.middle_lasting != 0 &&
      std::abs(f.middle_fleeting - f.middle_lasting) > 0.1 * std::abs(f.middle_lasting)) {
    all.push_back(fmt::format(
        "how long inhibitor lasts matters (inhibitor_life_s): the dose in the middle of slice {} is "
        "{:.3g} when it lasts and {:.3g} when it does not",
        worst.slice, f.middle_lasting, f.middle_fleeting));
  }
  return all;
}

std::string flow_table(const FlowFindings& f) {
  std::string text = fmt::format(
      "{} of {:g} um, {} looked at, {} among them; cells of {:g} um ({} x {})\n"
      "{:g} mm/h, gap {:.4g} um ({}), viscosity {:g} Pa·s, limit {:g} Pa ({})\n",
      counted(f.part_slices, "slice"), f.layer_um, f.slices.size(),
      counted(static_cast<int>(f.masks), "section"), f.pitch_um, f.columns, f.rows,
      f.pull.speed_mm_h, f.pull.gap_um, f.gap_words, f.pull.viscosity_pa_s, f.pull.limit_pa,
      f.limit_given ? "the printer's" : "where resin cavitates");
  const bool dosed = f.pull.light.has_value();
  text += fmt::format("{:>7} {:>9} {:>12} {:>9} {:>10} {:>8} {:>8}", "slice", "mm", "suction", "N",
                      "most mm/h", "x mm", "y mm");
  if (dosed) text += fmt::format(" {:>18} {:>8} {:>14}", "dose", "in 10 %", "dead zone um");
  text += "\n";
  for (const SliceFlow* s : slowest_apart(f, 10)) {
    text += fmt::format("{:>7} {:>9.3f} {:>12} {:>9.3g} {:>10} {:>8.2f} {:>8.2f}", s->slice,
                        height_mm(f, s->slice), pressure(s->suction_pa), s->force_n,
                        at_most(s->speed_limit_mm_h), s->x_mm, s->y_mm);
    if (s->dose) {
      text += fmt::format(
          " {:>18} {:>6.1f} % {:>14}",
          fmt::format("{:.2f} {:.2f} {:.2f}", s->dose->min, s->dose->mean, s->dose->max),
          100 * s->dose->within_10,
          fmt::format("{}{:.0f} to {:.0f}", s->zone_at_rest ? "" : "~", s->dead_zone_min_um,
                      s->dead_zone_max_um));
    }
    text += "\n";
  }
  const SliceFlow& worst = f.slowest();
  text += fmt::format("slowest: slice {} at {:.3f} mm, at most {} mm/h\n", worst.slice,
                      height_mm(f, worst.slice), at_most(worst.speed_limit_mm_h));
  if (!f.platform.slices.empty()) {
    const PlatformFlow::Slice& first = f.platform.slices.front();
    text += fmt::format(
        "platform of {:g} x {:g} mm: slice 0 {} and {:.3g} N, at most {} mm/h; the part takes over at "
        "a gap of {:.0f} um, after {}\n",
        f.platform.width_mm, f.platform.height_mm, pressure(first.suction_pa), first.force_n,
        at_most(first.speed_limit_mm_h), f.platform.changeover_um,
        counted(f.platform.changeover_slice, "slice"));
  }
  constexpr std::size_t kMostBlind = 5;
  for (std::size_t i = 0; i < std::min(kMostBlind, f.blind.size()); ++i) {
    text += "blind: " + blind_in_words(f, f.blind[i]) + "\n";
  }
  if (f.blind.size() > kMostBlind) {
    text += fmt::format("and {} smaller ones\n", f.blind.size() - kMostBlind);
  }
  text +=
      f.window
          ? window_table(*f.window, f.slices, f.pull)
          : std::string(
                "window: taken as rigid; what one that gives way domes, and how long a change of speed takes, is told "
                "where the printer's [window] or an option says what it is\n");
  text += dosed ? steady_in_words(f) + "\n" : f.no_dose + "\n";
  return text;
}

std::string flow_json(const FlowFindings& f) {
  ordered_json j;
  j["speed_mm_h"] = f.pull.speed_mm_h;
  j["gap_um"] = f.pull.gap_um;
  j["gap_from"] = f.gap_words;
  j["viscosity_pa_s"] = f.pull.viscosity_pa_s;
  j["limit_pa"] = f.pull.limit_pa;
  j["limit_given"] = f.limit_given;
  j["blue_mw_cm2"] = f.pull.light ? ordered_json(f.pull.light->blue_mw_cm2) : ordered_json();
  j["uv_mw_cm2"] = f.pull.light ? ordered_json(f.pull.light->uv_mw_cm2) : ordered_json();
  j["layers"] = f.part_slices;
  j["layer_um"] = f.layer_um;
  j["pitch_um"] = f.pitch_um;
  j["cells"] = {f.columns, f.rows};
  j["every"] = f.pull.every;
  j["masks"] = f.masks;
  if (!f.pull.light) j["no_dose"] = f.no_dose;
  if (f.pull.light) j["taken_as_steady"] = steady_in_words(f);
  if (f.window) j["window"] = window_json(*f.window);
  j["slices"] = ordered_json::array();
  for (std::size_t k = 0; k < f.slices.size(); ++k) {
    const SliceFlow& s = f.slices[k];
    ordered_json one;
    one["slice"] = s.slice;
    one["z_mm"] = height_mm(f, s.slice);
    one["suction_pa"] = s.suction_pa;
    one["x_mm"] = s.x_mm;
    one["y_mm"] = s.y_mm;
    one["force_n"] = s.force_n;
    one["speed_limit_mm_h"] = s.speed_limit_mm_h;
    one["upper_bound"] = s.bound;
    one["dose"] = nullptr;
    one["within_10_percent"] = nullptr;
    one["window_dose"] = nullptr;
    one["dead_zone_um"] = nullptr;
    if (s.dose) {
      one["dose"] = {{"min", s.dose->min}, {"mean", s.dose->mean}, {"max", s.dose->max}};
      one["within_10_percent"] = s.dose->within_10;
      one["window_dose"] = s.dose->max_window;
      one["dead_zone_um"] = {{"min", s.dead_zone_min_um}, {"max", s.dead_zone_max_um}};
      one["dead_zone_at_rest"] = s.zone_at_rest;
      one["window_dose_at_rest"] = s.zone_at_rest ? ordered_json(s.zone_window) : ordered_json();
    }
    if (f.window) add_window_json(*f.window, k, one);
    j["slices"].push_back(std::move(one));
  }
  const SliceFlow& worst = f.slowest();
  j["slowest"] = {{"slice", worst.slice},
                  {"speed_limit_mm_h", worst.speed_limit_mm_h},
                  {"x_mm", worst.x_mm},
                  {"y_mm", worst.y_mm}};
  ordered_json early = ordered_json::array();
  for (const PlatformFlow::Slice& s : f.platform.slices) {
    early.push_back({{"slice", s.slice},
                     {"suction_pa", s.suction_pa},
                     {"force_n", s.force_n},
                     {"speed_limit_mm_h", s.speed_limit_mm_h}});
  }
  j["platform"] = {{"width_mm", f.platform.width_mm},
                   {"height_mm", f.platform.height_mm},
                   {"changeover_um", f.platform.changeover_um},
                   {"changeover_slice", f.platform.changeover_slice},
                   {"slices", early}};
  j["blind"] = ordered_json::array();
  for (const BlindVoid& v : f.blind) {
    j["blind"].push_back({{"kind", is_sealed(f, v) ? "sealed" : "cup"},
                          {"x_mm", v.x_mm},
                          {"y_mm", v.y_mm},
                          {"first_slice", v.first},
                          {"last_slice", v.last},
                          {"volume_mm3", v.volume_mm3},
                          {"area_mm2", v.area_mm2},
                          {"from_platform", v.from_platform},
                          {"vented", v.vented}});
  }
  if (f.middle_lasting != 0) {
    j["middle_dose"] = {{"lasting", f.middle_lasting}, {"fleeting", f.middle_fleeting}};
  }
  j["warnings"] = f.warnings;
  return j.dump(2);
}

std::string flow_profile_csv(const FlowFindings& f) {
  std::string text = "slice,z_um,speed_limit_mm_h,looked_at\n";
  std::size_t next = 0;
  for (int n = 0; n < f.part_slices; ++n) {
    while (next < f.slices.size() && f.slices[next].slice < n) ++next;
    const bool looked_at = next < f.slices.size() && f.slices[next].slice == n;
    double limit = std::numeric_limits<double>::infinity();
    if (next < f.slices.size()) limit = f.slices[next].speed_limit_mm_h;
    if (!looked_at && next > 0) limit = std::min(limit, f.slices[next - 1].speed_limit_mm_h);
    if (!std::isfinite(limit)) continue;
    text += fmt::format("{},{},{},{}\n", n, n * f.layer_um, at_most(limit), looked_at ? 1 : 0);
  }
  text.pop_back();  // whoever prints it ends the line
  return text;
}

}  // namespace slicecorr::cli
