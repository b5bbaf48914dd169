// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/chemistry_plots.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/fit_text.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::resins {

namespace {

using chart::Axis;
using chart::figure;
using chart::Panel;
using chart::Point;
using chart::Style;

constexpr int kPoints = 500;

}  // namespace

std::string cell_svg(const Chemistry& c, const CellRun& run, const std::string& name) {
  const double end = run.moments.back().time_s;
  const auto curve = [&](const auto& value) {
    std::vector<Point> points;
    for (int k = 0; k <= kPoints; ++k) {
      const double t = end * k / kPoints;
      points.push_back({t, value(run.at(t))});
    }
    return points;
  };
  double brightest = 0;
  for (const CellMoment& m : run.moments) brightest = std::max(brightest, m.intensity_mw_cm2);
  chart::Picture picture(
      titled(name, fmt::format("a cell under {} mW/cm²", figure(brightest))),
      fmt::format(
          "End groups used up and concentrations over {} s. Inhibited until {} s, gelled at {} "
          "s.",
          figure(end), figure(run.inhibition_time_s), figure(run.gel_time_s)));

  const auto used = curve([&](const CellState& s) { return used_up(c, s); });
  double most = c.gel_conversion;
  for (const Point& p : used) most = std::max(most, p.y);
  Panel groups(Axis{"", false, 0, end}, Axis{"share of end groups", false, 0, most * 1.1}, 200,
               false);
  groups.line(used, Style::series, 0);
  groups.line(curve([&](const CellState& s) { return conversion(c, s); }), Style::series, 1);
  groups.horizontal(c.gel_conversion, fmt::format("gel, {} %", figure(100 * c.gel_conversion)));

  Panel species(Axis{"time, s", false, 0, end}, Axis{"mol/l", true, 1e-12, 10}, 260);
  species.line(curve([](const CellState& s) { return s.O; }), Style::series, 2);
  species.line(curve([](const CellState& s) { return s.P1; }), Style::series, 3);
  species.line(curve([](const CellState& s) { return s.I; }), Style::series, 4);
  species.line(curve([](const CellState& s) { return s.P3; }), Style::series, 5);
  if (c.inhibitor_mol_l > 0) {
    species.line(curve([](const CellState& s) { return s.Q; }), Style::other);
  }
  for (Panel* panel : {&groups, &species}) {
    if (std::isfinite(run.inhibition_time_s)) {
      panel->vertical(run.inhibition_time_s, panel == &groups ? "oxygen gone" : "", 0);
    }
    if (std::isfinite(run.gel_time_s)) {
      panel->vertical(run.gel_time_s, panel == &groups ? "gelled" : "", 1);
    }
  }
  for (std::size_t k = 1; k < run.moments.size(); ++k) {
    const CellMoment &before = run.moments[k - 1], &m = run.moments[k];
    if (before.intensity_mw_cm2 == m.intensity_mw_cm2) continue;
    groups.vertical(
        before.time_s,
        m.intensity_mw_cm2 > 0 ? fmt::format("{} mW/cm²", figure(m.intensity_mw_cm2)) : "dark", 2);
  }
  picture.legend_line(Style::series, "used up", 0);
  picture.legend_line(Style::series, "bonded", 1);
  picture.legend_line(Style::series, "oxygen", 2);
  picture.legend_line(Style::series, "chains", 3);
  picture.legend_line(Style::series, "initiator", 4);
  picture.legend_line(Style::series, "dead", 5);
  if (c.inhibitor_mol_l > 0) picture.legend_line(Style::other, "inhibitor");
  picture.add(groups);
  picture.add(species);
  return picture.svg();
}

}  // namespace slicecorr::resins
