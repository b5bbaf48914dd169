// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A print of a disc or a strip from its first instant: its rings or slabs as a plan that grows.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"
#include "flow/growth.hpp"
#include "flow/in_time.hpp"

namespace slicecorr {

namespace {

constexpr int kMostLevels = 2000;

/// Rings of a disc per 2 pi, or slabs of half a strip per um of its length, from the middle on.
detail::GrowthPlan make_rings(const DiscPrint& print, const DiscLight& light, int cells) {
  const bool round = print.shape == DiscShape::disc;
  const double dr = 1e3 * print.radius_mm / cells, speed = disc::um_s(print.speed_mm_h);
  detail::GrowthPlan plan;
  plan.near.resize(static_cast<std::size_t>(cells));
  for (int i = 0; i < cells; ++i) {
    const double r0 = i * dr, r1 = r0 + dr, place = (i + 0.5) / cells;
    plan.area_um2.push_back(round ? 0.5 * (r1 * r1 - r0 * r0) : dr);
    plan.blue_mw_cm2.push_back(light.blue_mw_cm2.at(place));
    plan.uv_mw_cm2.push_back(light.uv_mw_cm2.at(place));
    if (i > 0) {
      plan.near[static_cast<std::size_t>(i)].emplace_back(i - 1, dr);
      plan.near[static_cast<std::size_t>(i) - 1].emplace_back(i, dr);
    }
    detail::GrowthFace face;
    face.to = i;
    face.from = i + 1 < cells ? i + 1 : detail::kFreshBath;
    face.beyond_to = i > 0 ? i - 1 : detail::kMirror;
    face.beyond_from = i + 2 < cells ? i + 2 : detail::kFreshBath;
    face.flux_um3_s = speed * (round ? 0.5 * r1 * r1 : r1);
    face.exchange = i + 1 < cells ? (round ? r1 : 1) / dr : 0;
    face.reach_um = 0.5 * dr;
    plan.faces.push_back(face);
  }
  return plan;
}

std::vector<double> places_of(int cells) {
  std::vector<double> places;
  places.reserve(static_cast<std::size_t>(cells));
  for (int i = 0; i < cells; ++i) places.push_back((i + 0.5) / cells);
  return places;
}

detail::GapGrowth begin(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                        const DiscGrowth& g) {
  const auto levels = static_cast<std::size_t>(std::ceil(g.top_um / g.level_um));
  detail::GapGrowth growth(
      resin, {disc::um_s(print.speed_mm_h), g.first_gap_um, g.slope, g.level_um, levels});
  growth.set_plan(make_rings(print, light, g.cells),
                  std::vector<double>(static_cast<std::size_t>(g.cells) * levels, 0.0));
  return growth;
}

void check_growth(const DiscGrowth& g) {
  disc::check_positive(g.first_gap_um, "first_gap_um");
  disc::check_positive(g.seconds, "seconds");
  disc::check_positive(g.slope, "slope");
  disc::check_positive(g.level_um, "level_um");
  disc::check_positive(g.top_um, "top_um");
  if (g.cells < 4 || g.cells > 1000) {
    disc::refuse("cells", fmt::format("is {}; expected 4 to 1000", g.cells));
  }
  const double levels = g.top_um / g.level_um;
  if (!(levels >= 4 && levels <= kMostLevels)) {
    disc::refuse("top_um", fmt::format("is {}; expected 4 to {} levels of {} um", g.top_um,
                                       kMostLevels, g.level_um));
  }
}

}  // namespace

DiscGrown grow_disc(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                    const DiscGrowth& growth) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_light(light);
  disc::check_inhibited(light);
  check_growth(growth);
  detail::GapGrowth rings = begin(resin, print, light, growth);
  const std::vector<double> places = places_of(growth.cells);
  DiscGrown grown;
  while (rings.seconds() < growth.seconds && !grown.adhesion) {
    rings.step(growth.seconds - rings.seconds());
    if (const auto at = rings.stuck()) grown.adhesion = {rings.seconds(), places[*at]};
  }
  rings.find_gap();
  grown.gap_um = {places, rings.gap_um()};
  grown.seconds = rings.seconds();
  grown.undone_places = rings.undone();
  return grown;
}

PrintInTime follow_disc(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                        const InTime& how) {
  detail::check_in_time(how);
  DiscGrowth growth{how.first_gap_um, 1, how.slope, how.cells, how.level_um, how.top_um};
  growth.seconds = how.slices * how.layer_um / disc::um_s(print.speed_mm_h);
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_light(light);
  disc::check_inhibited(light);
  check_growth(growth);
  const bool round = print.shape == DiscShape::disc;
  const std::vector<double> places = places_of(how.cells);
  std::vector<double> distance_um, place_mm;
  for (const double r : places) {
    place_mm.push_back(r * print.radius_mm);
    distance_um.push_back(1e3 * print.radius_mm * (1 - r));
  }
  detail::GapGrowth rings = begin(resin, print, light, growth);
  detail::AtRest rest;
  PrintInTime all;
  all.top_um = how.top_um;
  for (int n = 0; n < how.slices && !all.sticks; ++n) {
    const double until = (n + 1) * how.layer_um / disc::um_s(print.speed_mm_h);
    if (rest.holds()) rings.wait(until - rings.seconds());
    while (until - rings.seconds() > 1e-9 * until && !all.sticks) {
      rings.step(until - rings.seconds());
      if (const auto at = rings.stuck()) {
        all.sticks = StuckInTime{n, rings.seconds(), place_mm[*at], 0};
      }
    }
    rings.find_gap();
    rest.add(rings, how.top_um, true);
    SliceInTime slice = detail::look_at(rings, distance_um, how.top_um);
    slice.slice = n;
    const DiscSuction suction = disc_suction(resin, print, {places, rings.felt_um()});
    slice.suction_pa = suction.most_pa;
    slice.force_n = suction.force_n;
    slice.inflow_mm3_s = suction.flow_mm3_s;
    slice.rim_mm_s = suction.rim_mm_s;
    const double width_um = 1e3 * print.radius_mm;
    slice.area_mm2 = 1e-6 * (round ? 3.14159265358979323846 * width_um * width_um : 2e3 * width_um);
    slice.level = level_front({places, rings.gap_um()}, print.radius_mm);
    slice.place_mm = place_mm;
    slice.gap_um = rings.gap_um();
    for (std::size_t i = 0; i < places.size(); ++i) {
      slice.window_along.push_back(rings.window_dose(i));
    }
    all.slices.push_back(std::move(slice));
  }
  all.undone_places = rings.undone();
  detail::find_steady(all);
  return all;
}

LevelFront level_front(const RadialCurve& gap_um, double radius_mm) {
  disc::check_gap(gap_um);
  disc::check_positive(radius_mm, "radius_mm");
  const double level = std::tan(10 * 3.14159265358979323846 / 180);
  LevelFront front;
  double sum = 0, squares = 0;
  for (std::size_t i = 1; i < gap_um.r.size(); ++i) {
    const double width = gap_um.r[i] - gap_um.r[i - 1];
    const double rise = gap_um.value[i] - gap_um.value[i - 1];
    if (std::abs(rise) > level * 1e3 * radius_mm * width) continue;
    const double h = 0.5 * (gap_um.value[i] + gap_um.value[i - 1]);
    front.share += width;
    sum += width * h;
    squares += width * h * h;
  }
  if (front.share <= 0) return front;
  front.mean_um = sum / front.share;
  front.deviation_um =
      std::sqrt(std::max(0.0, squares / front.share - front.mean_um * front.mean_um));
  return front;
}

}  // namespace slicecorr
