// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow_window_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "slicecorr/limit.hpp"

namespace slicecorr::cli {

namespace {

using nlohmann::ordered_json;

/// The slice with the greatest of a figure, the first of equal ones.
template <class All, class Figure>
std::size_t greatest(const All& all, const Figure& figure) {
  return static_cast<std::size_t>(
      std::max_element(all.begin(), all.end(),
                       [&](const auto& a, const auto& b) { return figure(a) < figure(b); }) -
      all.begin());
}

}  // namespace

std::string window_in_words(const FlowWindow& w) {
  std::string text;
  if (w.springs_um_per_kpa > 0) text = fmt::format("springs of {:g} um/kPa", w.springs_um_per_kpa);
  if (w.film_n_m > 0) {
    text = fmt::format("a film of {:g} N/m, free over a radius of {:g} mm", w.film_n_m,
                       w.film_radius_mm);
    if (w.film_stretch_n_m > 0)
      text += fmt::format(", that stretches by {:g} N/m", w.film_stretch_n_m);
  }
  if (w.rubber_mm > 0) {
    text = fmt::format("rubber of {:g} mm and {:g} MPa on glass", w.rubber_mm, w.rubber_mpa);
  }
  if (w.arm_n_mm > 0) {
    text += fmt::format("{}an arm of {:g} N/mm", text.empty() ? "" : " on ", w.arm_n_mm);
  }
  return text;
}

const FlowWindow& window_of(const FlowWindow& options, const Printer& printer) {
  return options.gives_way() ? options : printer.window;
}

void add_window_options(CLI::App& app, FlowWindow& w) {
  app.add_option("--window-um-per-kpa", w.springs_um_per_kpa,
                 "A window that gives way like springs: its rise under suction")
      ->check(number_above_zero());
  app.add_option("--film-n-m", w.film_n_m, "A film as window: its tension at rest")
      ->check(number_above_zero());
  app.add_option("--film-radius-mm", w.film_radius_mm, "Radius over which the film is free")
      ->check(number_above_zero());
  app.add_option("--film-stretch-n-m", w.film_stretch_n_m,
                 "E t/(1 - nu²) of a film that stretches [it keeps its tension]")
      ->check(number_above_zero());
  app.add_option("--rubber-mm", w.rubber_mm, "Rubber on glass (PDMS) as window: its thickness")
      ->check(number_above_zero());
  app.add_option("--rubber-mpa", w.rubber_mpa, "Modulus of the rubber, E")
      ->check(number_above_zero());
  app.add_option("--arm-n-mm", w.arm_n_mm, "Stiffness of what holds platform or vat [rigid]")
      ->check(number_above_zero());
}

std::optional<WindowFindings> find_window(const FlowWindow& window,
                                          const std::vector<SliceFlow>& slices,
                                          const FlowPull& pull, const ExecutionContext& context) {
  check_window(window);
  if (!window.gives_way()) return std::nullopt;
  WindowFindings found;
  found.window = window;
  std::map<std::size_t, std::size_t> first;  // slice by mask
  for (std::size_t k = 0; k < slices.size(); ++k) {
    const SliceFlow& s = slices[k];
    const auto [at, is_new] = first.try_emplace(s.mask, k);
    if (!is_new) {
      found.rest.push_back(found.rest[at->second]);
      found.pull.push_back(found.pull[at->second]);
      continue;
    }
    context.check_cancelled();
    context.report("pull sections off",
                   static_cast<double>(k) / static_cast<double>(slices.size()));
    const PulledSection section{s.area_mm2,  s.suction_pa,    s.force_n,
                                pull.gap_um, pull.speed_mm_h, pull.viscosity_pa_s};
    found.rest.push_back(window_rest(window, section));
    found.pull.push_back(window_pull(window, section));
    if (const auto snap = window_snap_mm_h(window, section)) {
      found.snap_mm_h = std::min(*snap, found.snap_mm_h.value_or(*snap));
    }
  }
  context.report("pull sections off", 1);
  return found;
}

std::vector<std::string> window_warnings(const WindowFindings& f,
                                         const std::vector<SliceFlow>& slices) {
  std::vector<std::string> all;
  const std::size_t steep = greatest(f.rest, [](const WindowRest& r) { return r.slope; });
  if (f.rest[steep].slope > 0.5) {
    all.push_back(fmt::format(
        "the window leans by {:.2g} under slice {}: what is told of it holds for flat windows, up to 0.5",
        f.rest[steep].slope, slices[steep].slice));
  }
  const std::size_t wide = greatest(slices, [](const SliceFlow& s) { return s.area_mm2; });
  PulledSection section;
  section.area_mm2 = slices[wide].area_mm2;
  if (f.window.film_n_m > 0 && f.window.film_radius_mm < 1.5 * section.radius_mm()) {
    all.push_back(
        fmt::format("the film's frame is near to the outline of slice {}: rims and corners that "
                    "come closer to it are held more than a disc is",
                    slices[wide].slice));
  }
  return all;
}

std::string window_table(const WindowFindings& f, const std::vector<SliceFlow>& slices,
                         const FlowPull& pull) {
  const std::size_t domed =
      greatest(f.rest, [](const WindowRest& r) { return r.middle_um - r.rim_um; });
  const std::size_t pulled = greatest(f.pull, [](const WindowPull& p) { return p.force_n; });
  const WindowRest& r = f.rest[domed];
  const WindowPull& p = f.pull[pulled];
  const std::string change =
      fmt::format("a change of speed takes {}{:.2g} s", r.at_most ? "at most " : "", r.time_s);
  std::string text = fmt::format(
      "window: {}\n"
      "  printed without a pause: slice {} is domed by {:.3g} um (the window rises {:.3g} um in the middle); {}\n"
      "  pulled off at {:g} mm/h from {:.4g} um: slice {} takes {:.3g} N, {:.3g} of what a rigid window "
      "would, after {:.3g} um of travel; it grows as speed^{:.2f}\n",
      window_in_words(f.window), slices[domed].slice, r.middle_um - r.rim_um, r.middle_um, change,
      pull.speed_mm_h, pull.gap_um, slices[pulled].slice, p.force_n, p.share, p.travel_um,
      p.exponent);
  if (f.snap_mm_h) {
    text += fmt::format(
        "  a flat window snaps on to the part beyond {} mm/h: come to higher speeds slowly\n",
        at_most(*f.snap_mm_h));
  }
  return text;
}

ordered_json window_json(const WindowFindings& f) {
  const auto or_null = [](double value) {
    return value > 0 ? ordered_json(value) : ordered_json();
  };
  return {{"springs_um_per_kpa", or_null(f.window.springs_um_per_kpa)},
          {"film_n_m", or_null(f.window.film_n_m)},
          {"film_radius_mm", or_null(f.window.film_radius_mm)},
          {"film_stretch_n_m", or_null(f.window.film_stretch_n_m)},
          {"arm_n_mm", or_null(f.window.arm_n_mm)},
          {"rubber_mm", or_null(f.window.rubber_mm)},
          {"rubber_mpa", or_null(f.window.rubber_mpa)},
          {"snap_mm_h", or_null(f.snap_mm_h.value_or(0))}};
}

void add_window_json(const WindowFindings& f, std::size_t slice, ordered_json& to) {
  const WindowRest& r = f.rest[slice];
  const WindowPull& p = f.pull[slice];
  to["window"] = {
      {"middle_um", r.middle_um}, {"rim_um", r.rim_um},          {"slope", r.slope},
      {"change_s", r.time_s},     {"change_at_most", r.at_most}, {"pull_n", p.force_n},
      {"pull_share", p.share},    {"pull_exponent", p.exponent}, {"pull_travel_um", p.travel_um}};
}

}  // namespace slicecorr::cli
