// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow_in_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "flow_input.hpp"
#include "flow_window_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/first_slices.hpp"
#include "slicecorr/flow_in_time.hpp"
#include "slicecorr/flow_report.hpp"

namespace slicecorr::cli {

namespace {

using nlohmann::ordered_json;

/// What was followed, and how.
struct Followed {
  std::string shape;  ///< in words
  FlowPull pull;
  InTime how;
  std::string light;  ///< in words
  double pitch_um = 0;
  std::vector<std::string> notes;
  PrintInTime print;
  FlowWindow window;
  std::vector<WindowRest> rest;  ///< of slices; empty where the window is rigid
  bool limit_given = false;      ///< by the printer; else resin cavitates at `pull.limit_pa`
};

/// The first slice at whose end more suction is drawn than there can be, or nothing.
const SliceInTime* beyond_limit(const Followed& f) {
  const auto first =
      std::find_if(f.print.slices.begin(), f.print.slices.end(),
                   [&f](const SliceInTime& s) { return s.suction_pa > f.pull.limit_pa; });
  return first == f.print.slices.end() ? nullptr : &*first;
}

[[noreturn]] void not_in_time(const char* option, const char* why) {
  throw InputError(fmt::format("{} does not go with --in-time: {}", option, why));
}

void check(const FlowOptions& o) {
  const int shapes = (o.mesh.parts.empty() ? 0 : 1) + (o.disc_radius_mm > 0 ? 1 : 0) +
                     (o.strip_half_width_mm > 0 ? 1 : 0);
  if (shapes != 1) {
    throw InputError(
        "expected one of PART, --disc-radius-mm and --strip-half-width-mm with --in-time");
  }
  if (o.window.gives_way() && o.strip_half_width_mm > 0) {
    not_in_time("a window that gives way under a strip",
                "how far it does is known of discs and parts");
  }
  if (o.gap_um > 0) not_in_time("--gap-um", "the gap is what comes of the print");
  if (o.every != 1) not_in_time("--every", "slices are printed one after the other");
  if (!o.platform_mm.empty()) {
    not_in_time("--platform-mm",
                "what is drawn in beside the part, under the platform, is not counted");
  }
  if (o.json == "-" && o.profile == "-") {
    throw InputError("--json and --profile both go to stdout; expected a file for one of them");
  }
  std::vector<std::string> taken = o.mesh.parts;
  for (const std::string& output : {o.json, o.output, o.profile}) {
    check_output(output, taken);
    if (!output.empty() && output != "-") taken.push_back(output);
  }
  const std::string ending = std::filesystem::path(o.output).extension().string();
  if (!o.output.empty() && ending != ".svg" && ending != ".html") {
    throw InputError(o.output, "", "expected an output that ends in .svg or .html with --in-time");
  }
}

void take_even_light(const FlowOptions& o, const FlowInput& in, Followed& f) {
  if (!in.uv_mw_cm2) {
    throw InputError(
        "a print in time needs the UV light that keeps resin liquid; expected --uv-mw-cm2");
  }
  const FlowLight light{o.blue_mw_cm2.value_or(in.printer.calibration.back().intensity_mw_cm2),
                        *in.uv_mw_cm2};
  check_blue_lamp(in.printer, light.blue_mw_cm2);
  if (light.uv_mw_cm2 > 0 && in.resin.inhibition) check_uv_lamp(in.printer, light.uv_mw_cm2);
  f.pull.light = light;
  f.light = fmt::format("{:g} and {:g} mW/cm² of curing and UV light everywhere", light.blue_mw_cm2,
                        light.uv_mw_cm2);
}

void follow_shape(const FlowOptions& o, Followed& f) {
  DiscPrint print;
  print.shape = o.disc_radius_mm > 0 ? DiscShape::disc : DiscShape::strip;
  print.radius_mm = o.disc_radius_mm > 0 ? o.disc_radius_mm : o.strip_half_width_mm;
  print.speed_mm_h = f.pull.speed_mm_h;
  if (o.mesh.layer_um > 0) f.how.layer_um = o.mesh.layer_um;
  if (o.pitch_um > 0) {
    const double cells = std::round(1e3 * print.radius_mm / o.pitch_um);
    if (!(cells >= 4 && cells <= 1000)) {
      throw InputError(fmt::format("--pitch-um makes {:g} cells of {:g} mm; expected 4 to 1000",
                                   cells, print.radius_mm));
    }
    f.how.cells = static_cast<int>(cells);
  }
  f.pitch_um = 1e3 * print.radius_mm / f.how.cells;
  f.shape = print.shape == DiscShape::disc
                ? fmt::format("disc of {:g} mm radius", print.radius_mm)
                : fmt::format("strip of {:g} mm half width", print.radius_mm);
  f.print = follow_disc(*f.pull.resin, print,
                        even_light(f.pull.light->blue_mw_cm2, f.pull.light->uv_mw_cm2), f.how);
}

void follow_input(const FlowOptions& o, const FlowInput& in, Followed& f,
                  const ExecutionContext& context) {
  const FlowPart part(*in.slices, {.pitch_um = o.pitch_um, .pixels = in.pixels}, context);
  if (part.masks() == 0) {
    throw InputError(fmt::format(
        "no cell of {:g} um is lit by half; expected a part that is wider, or a finer --pitch-um",
        part.grid().pitch_um));
  }
  f.pitch_um = part.grid().pitch_um;
  f.how.layer_um = part.layer_um();
  f.how.slices = o.slices > 0 ? std::min(o.slices, part.slices()) : part.slices();
  f.shape = std::filesystem::path(o.mesh.parts[0]).filename().string();
  if (f.pull.light) {
    f.print = follow_part(part, f.pull, f.how, {}, context);
    return;
  }
  f.print = follow_part(part, f.pull, f.how,
                        even_light_in_time(*in.process, in.printer, in.slices->grid(), part.grid()),
                        context);
}

/// Light sets the gap from the window's own surface: the front follows it, and what was followed holds over it.
void look_at_window(const FlowOptions& o, const FlowInput& in, Followed& f) {
  f.window = window_of(o.window, in.printer);
  if (!f.window.gives_way() || o.strip_half_width_mm > 0) return;
  check_window(f.window);
  for (const SliceInTime& s : f.print.slices) {
    if (!(s.suction_pa > 0 && s.force_n > 0)) {
      f.rest.emplace_back();
      continue;
    }
    f.rest.push_back(window_rest(f.window, {s.area_mm2, s.suction_pa, s.force_n, s.mean_um,
                                            f.pull.speed_mm_h, f.pull.viscosity_pa_s}));
  }
  const auto steep = std::max_element(
      f.rest.begin(), f.rest.end(), [](const auto& a, const auto& b) { return a.slope < b.slope; });
  if (steep->slope > 0.5) {
    f.notes.push_back(fmt::format(
        "the window leans by {:.2g} in slice {}: what is told of it holds for flat windows, up to 0.5",
        steep->slope, f.print.slices[static_cast<std::size_t>(steep - f.rest.begin())].slice));
  }
}

double dome_um(const WindowRest& rest) { return rest.middle_um - rest.rim_um; }

std::string window_in_time(const Followed& f) {
  if (f.rest.empty()) {
    return "window: taken as rigid; what one that gives way domes is told where the printer's [window] or an option says "
           "what it is\n";
  }
  const WindowRest& last = f.rest.back();
  const auto most =
      std::max_element(f.rest.begin(), f.rest.end(),
                       [](const auto& a, const auto& b) { return dome_um(a) < dome_um(b); });
  const auto slice = static_cast<std::size_t>(most - f.rest.begin());
  return fmt::format(
      "window: {}; fronts are those over its own surface. What is flat is domed by {:.3g} um in the last slice, "
      "{:.3g} um at the most (slice {}); changes faster than {:.2g} s {} not followed: meanwhile the part grows "
      "faster or slower than the stage moves\n",
      window_in_words(f.window), dome_um(last), dome_um(*most), f.print.slices[slice].slice,
      last.time_s, last.at_most ? "may be" : "are");
}

std::string sticks_in_words(const PrintInTime& p) {
  return fmt::format(
      "sticks to the window in slice {}, {:.2f} s after the first instant, at {}: the print ends "
      "there",
      p.sticks->slice, p.sticks->seconds,
      p.sticks->y_mm == 0 ? fmt::format("{:.2f} mm from the middle", p.sticks->x_mm)
                          : fmt::format("x {:.2f}, y {:.2f} mm", p.sticks->x_mm, p.sticks->y_mm));
}

std::string end_in_words(const Followed& f) {
  const PrintInTime& p = f.print;
  std::string sticks = p.sticks ? sticks_in_words(p) : std::string();
  if (const SliceInTime* beyond = beyond_limit(f)) {
    return fmt::format(
        "{}draws {:.3g} Pa in slice {}, {:.2f} s after the first instant, {}. Suction of narrow places falls with finer "
        "cells than {:g} um; where it does not, resin can't follow, cavities open or the window is drawn on to the "
        "part, and what is told of later slices does not hold",
        sticks.empty() ? sticks : sticks + "; it ", beyond->suction_pa, beyond->slice,
        beyond->seconds,
        f.limit_given
            ? fmt::format("more than the printer's limit of {:g} Pa", f.pull.limit_pa)
            : fmt::format("more than the {:g} Pa at which resin cavitates", f.pull.limit_pa),
        f.pitch_um);
  }
  if (p.sticks) return sticks;
  if (p.steady_from) {
    return fmt::format("prints; from slice {} on nothing changes any more", *p.steady_from);
  }
  return "prints as far as it was followed; it is not steady at the end";
}

std::string table_of(const Followed& f) {
  std::string text = fmt::format(
      "{}, in time: {} slices of {:g} um, cells of {:g} um, levels of {:g} um to {:g} um\n"
      "{:g} mm/h, first gap {:g} um, {}\n",
      f.shape, f.print.slices.size(), f.how.layer_um, f.pitch_um, f.how.level_um, f.how.top_um,
      f.pull.speed_mm_h, f.how.first_gap_um, f.light);
  text += fmt::format("{:>7} {:>8} {:>22} {:>8} {:>7} {:>14} {:>8} {:>11} {:>10}\n", "slice", "s",
                      "dead zone um", "middle", "void", "level um", "window", "inflow mm3/s",
                      "suction Pa");
  const std::vector<SliceInTime>& slices = f.print.slices;
  constexpr std::size_t kRows = 12;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    // Early ones one by one, later ones in growing steps.
    std::size_t step = 1;
    while (i + 1 >= 4 * step && slices.size() > kRows) step *= 2;
    if ((i + 1) % step != 0 && i + 1 != slices.size()) continue;
    const SliceInTime& s = slices[i];
    text += fmt::format(
        "{:>7} {:>8.2f} {:>22} {:>8.1f} {:>5.1f} % {:>14} {:>8.3f} {:>11.4g} {:>10.4g}\n", s.slice,
        s.seconds, fmt::format("{:.1f} {:.1f} {:.1f}", s.min_um, s.mean_um, s.max_um), s.middle_um,
        100 * s.void_share,
        s.level.share > 0 ? fmt::format("{:.0f} +- {:.0f}", s.level.mean_um, s.level.deviation_um)
                          : std::string("-"),
        s.window_dose, s.inflow_mm3_s, s.suction_pa);
  }
  return text + window_in_time(f) + end_in_words(f) + "\n";
}

std::string json_of(const Followed& f) {
  ordered_json j;
  j["shape"] = f.shape;
  j["speed_mm_h"] = f.pull.speed_mm_h;
  j["viscosity_pa_s"] = f.pull.viscosity_pa_s;
  j["limit_pa"] = f.pull.limit_pa;
  j["limit_given"] = f.limit_given;
  j["blue_mw_cm2"] = f.pull.light ? ordered_json(f.pull.light->blue_mw_cm2) : ordered_json();
  j["uv_mw_cm2"] = f.pull.light ? ordered_json(f.pull.light->uv_mw_cm2) : ordered_json();
  j["light"] = f.light;
  j["layer_um"] = f.how.layer_um;
  j["first_gap_um"] = f.how.first_gap_um;
  j["pitch_um"] = f.pitch_um;
  j["level_um"] = f.how.level_um;
  j["top_um"] = f.how.top_um;
  j["slices"] = ordered_json::array();
  for (std::size_t k = 0; const SliceInTime& s : f.print.slices) {
    ordered_json one;
    one["slice"] = s.slice;
    one["seconds"] = s.seconds;
    one["area_mm2"] = s.area_mm2;
    one["dead_zone_um"] = {
        {"min", s.min_um}, {"mean", s.mean_um}, {"max", s.max_um}, {"middle", s.middle_um}};
    one["void_share"] = s.void_share;
    one["level_front_um"] = {
        {"mean", s.level.mean_um}, {"deviation", s.level.deviation_um}, {"share", s.level.share}};
    one["window_dose"] = s.window_dose;
    one["least_dose"] = s.least_dose;
    one["inflow_mm3_s"] = s.inflow_mm3_s;
    one["rim_mm_s"] = s.rim_mm_s;
    one["suction_pa"] = s.suction_pa;
    one["force_n"] = s.force_n;
    one["along"] = {
        {"place_mm", s.place_mm}, {"gap_um", s.gap_um}, {"window_dose", s.window_along}};
    if (!f.rest.empty()) {
      const WindowRest& r = f.rest[k];
      one["window"] = {{"middle_um", r.middle_um},
                       {"rim_um", r.rim_um},
                       {"slope", r.slope},
                       {"change_s", r.time_s},
                       {"change_at_most", r.at_most}};
    }
    ++k;
    j["slices"].push_back(std::move(one));
  }
  const PrintInTime& p = f.print;
  const SliceInTime* beyond = beyond_limit(f);
  j["prints"] = !p.sticks && !beyond;
  j["beyond_limit"] = nullptr;
  if (beyond) {
    j["beyond_limit"] = {
        {"slice", beyond->slice}, {"seconds", beyond->seconds}, {"suction_pa", beyond->suction_pa}};
  }
  j["sticks"] = nullptr;
  if (p.sticks) {
    j["sticks"] = {{"slice", p.sticks->slice},
                   {"seconds", p.sticks->seconds},
                   {"x_mm", p.sticks->x_mm},
                   {"y_mm", p.sticks->y_mm}};
  }
  j["steady_from"] = p.steady_from ? ordered_json(*p.steady_from) : ordered_json();
  j["undone_places"] = p.undone_places;
  j["warnings"] = f.notes;
  return j.dump(2);
}

std::string csv_of(const Followed& f) {
  std::string text =
      "slice,z_um,seconds,dead_zone_min_um,dead_zone_mean_um,dead_zone_max_um,dead_zone_middle_um,"
      "void_share,window_dose,inflow_mm3_s,suction_pa,force_n\n";
  for (const SliceInTime& s : f.print.slices) {
    text += fmt::format(
        "{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}\n", s.slice,
        s.slice * f.how.layer_um, s.seconds, s.min_um, s.mean_um, s.max_um, s.middle_um,
        s.void_share, s.window_dose, s.inflow_mm3_s, s.suction_pa, s.force_n);
  }
  text.pop_back();  // whoever prints it ends the line
  return text;
}

/// What is too coarse for what came of it, and from when on.
void take_coarse_notes(Followed& f) {
  // On a disc whose dead zone is 54 um, rings of 100 um leave its least and middle within 6 %.
  constexpr double kMostCells = 2;
  const auto& slices = f.print.slices;
  const auto thin = std::find_if(slices.begin(), slices.end(), [&](const SliceInTime& s) {
    return f.pitch_um > kMostCells * s.min_um;
  });
  if (thin != slices.end()) {
    f.notes.push_back(fmt::format(
        "from slice {} on cells of {:g} um are more than twice as wide as the dead zone is thick there, {:.1f} "
        "um: the dead zone, whether it sticks and the suction may be off; a --pitch-um of {:.0f} or less "
        "follows it better",
        thin->slice, f.pitch_um, thin->min_um, kMostCells * thin->min_um));
  }
  const auto hard = std::find_if(slices.begin(), slices.end(),
                                 [](const SliceInTime& s) { return s.suction_pa > kCavitationPa; });
  if (hard != slices.end()) {
    f.notes.push_back(fmt::format(
        "from slice {} on the suction is above 1 bar ({:.3g} bar there), more than one can draw on a liquid: "
        "resin cavitates before, or the dead zone, {:.1f} um at the least on levels of {:g} um, is told too "
        "thin",
        hard->slice, hard->suction_pa * 1e-5, hard->min_um, f.how.level_um));
  }
}

void take_notes(Followed& f, bool part) {
  const std::size_t followed = f.print.slices.size();
  if (part && !f.print.sticks && followed < static_cast<std::size_t>(f.how.slices)) {
    f.notes.push_back(fmt::format(
        "from slice {} on nothing draws resin in, as behind a part whose images go on: it is "
        "followed up to there",
        followed));
  }
  const double least = f.print.slices.back().min_um;
  if (least < 3 * f.how.level_um && !f.print.sticks) {
    f.notes.push_back(
        fmt::format("the dead zone is {:.1f} um at the least, which is less than three "
                    "levels of {:g} um: it may stick in truth",
                    least, f.how.level_um));
  }
  take_coarse_notes(f);
  std::size_t open = 0;
  for (const SliceInTime& s : f.print.slices) open += s.void_share > 0.5 ? 1 : 0;
  const double first_s = f.how.top_um / (f.pull.speed_mm_h / 3.6);
  if (f.print.slices.back().void_share > 0.5) {
    f.notes.push_back(
        fmt::format("more than half of the last slice is a void: nothing gels there below {:g} um",
                    f.how.top_um));
  } else if (open > 0) {
    f.notes.push_back(
        fmt::format("in {} slices most of the section has nothing gelled under it yet, as "
                    "in the first {:.1f} s",
                    open, first_s));
  }
  if (part) {
    f.notes.emplace_back(
        "outlines run along cells here, and nothing within a gap of an outline is in the "
        "model of a thin gap");
  }
}

InTimePicture picture_of(const Followed& f) {
  InTimePicture p;
  p.title = fmt::format("{}: a print in time", f.shape);
  p.words = fmt::format("{:g} mm/h, {}. It {}.", f.pull.speed_mm_h, f.light, end_in_words(f));
  p.layer_um = f.how.layer_um;
  p.print = f.print;
  p.notes = f.notes;
  return p;
}

}  // namespace

int flow_in_time(const FlowOptions& o, const ExecutionContext& context, Console& console) {
  check(o);
  const FlowInput in = read_flow_input(o, context);
  Followed f;
  f.pull.speed_mm_h = in.speed_mm_h;
  f.pull.resin = flow_resin(in.resin, o.resin);
  f.pull.viscosity_pa_s = in.resin.viscosity_pa_s;
  f.limit_given = in.printer.suction_limit_pa > 0;
  f.pull.limit_pa = f.limit_given ? in.printer.suction_limit_pa : kCavitationPa;
  if (o.first_gap_um > 0) f.how.first_gap_um = o.first_gap_um;
  if (o.slices > 0) f.how.slices = o.slices;
  const bool by_place = in.process && in.process->even_light && !o.blue_mw_cm2 && !o.uv_mw_cm2;
  if (by_place) {
    f.light = "the light by place that the stack was corrected for";
  } else {
    take_even_light(o, in, f);
  }
  if (in.slices) {
    follow_input(o, in, f, context);
  } else {
    follow_shape(o, f);
  }
  look_at_window(o, in, f);
  take_notes(f, in.slices != nullptr);
  for (const std::string& note : f.notes) context.tell(note);
  if (!o.json.empty()) print_or_write(o.json, json_of(f));
  if (!o.profile.empty()) print_or_write(o.profile, csv_of(f));
  if (o.json != "-" && o.profile != "-") print_result(table_of(f));
  if (!o.output.empty()) {
    const bool page = std::filesystem::path(o.output).extension() == ".html";
    write_text_file(o.output, page ? in_time_page(picture_of(f)) : in_time_svg(picture_of(f)));
    console.say(fmt::format("{}: written", o.output));
  }
  return kDone;
}

void refuse_in_time_options(const FlowOptions& o) {
  const auto refuse = [](const char* option) {
    throw InputError(fmt::format("{} is of a print in time; expected --in-time with it", option));
  };
  if (o.disc_radius_mm > 0) refuse("--disc-radius-mm");
  if (o.strip_half_width_mm > 0) refuse("--strip-half-width-mm");
  if (o.first_gap_um > 0) refuse("--first-gap-um");
  if (o.slices > 0) refuse("--slices");
  if (o.mesh.parts.empty()) throw InputError("expected a PART: meshes, or one stack");
}

}  // namespace slicecorr::cli
