// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A print in time: where its front is, and what goes on under it.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/flow_report.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr {

namespace {

using chart::Panel;
using chart::Point;
using chart::Style;
using namespace page;

using Slices = std::vector<SliceInTime>;

std::vector<Point> line_of(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < x.size(); ++i) points.push_back({x[i], y[i]});
  return points;
}

template <class Value>
std::vector<Point> in_time(const Slices& slices, const Value& value) {
  std::vector<Point> points;
  for (const SliceInTime& s : slices) points.push_back({s.seconds, value(s)});
  return points;
}

constexpr std::size_t kFronts = 6;  // a colour for each

/// Slices whose fronts are drawn: each twice as late as the one before, and the last.
std::vector<std::size_t> drawn_slices(std::size_t count) {
  std::vector<std::size_t> drawn;
  for (std::size_t n = 1; n < count && drawn.size() + 1 < kFronts; n *= 2) {
    drawn.push_back(n - 1);
  }
  drawn.push_back(count - 1);
  return drawn;
}

chart::Axis time_axis(const Slices& slices) { return {"s", false, 0, slices.back().seconds}; }

Panel front_panel(const InTimePicture& p, chart::Picture& picture) {
  const Slices& slices = p.print.slices;
  double least = slices.back().place_mm.front(), most = slices.back().place_mm.back();
  for (const SliceInTime& s : slices) {
    least = std::min(least, s.place_mm.front());
    most = std::max(most, s.place_mm.back());
  }
  Panel panel({"mm", false, least, most}, {"front over the window, um", false, 0, p.print.top_um},
              240);
  int series = 0;
  for (const std::size_t n : drawn_slices(slices.size())) {
    panel.line(line_of(slices[n].place_mm, slices[n].gap_um), Style::series, series);
    picture.legend_line(Style::series,
                        fmt::format("slice {}, {:.2f} s", slices[n].slice, slices[n].seconds),
                        series);
    ++series;
  }
  return panel;
}

Panel zone_panel(const InTimePicture& p) {
  const Slices& slices = p.print.slices;
  std::vector<double> all;
  for (const SliceInTime& s : slices) all.push_back(s.max_um);
  Panel panel(time_axis(slices), chart::axis_over("dead zone, um", false, all, true), 180, false);
  panel.band(in_time(slices, [](const SliceInTime& s) { return s.min_um; }),
             in_time(slices, [](const SliceInTime& s) { return s.max_um; }), Style::series, 0);
  panel.line(in_time(slices, [](const SliceInTime& s) { return s.middle_um; }), Style::series, 1);
  return panel;
}

Panel window_panel(const InTimePicture& p) {
  const Slices& slices = p.print.slices;
  std::vector<double> all{1.05, 0};
  for (const SliceInTime& s : slices) all.push_back(s.window_dose);
  Panel panel(time_axis(slices), chart::axis_over("dose at the window", false, all, true), 130,
              false);
  panel.line(in_time(slices, [](const SliceInTime& s) { return s.window_dose; }), Style::series, 2);
  panel.horizontal(1, "sticks");
  return panel;
}

Panel suction_panel(const InTimePicture& p) {
  const Slices& slices = p.print.slices;
  std::vector<double> all;
  for (const SliceInTime& s : slices) all.push_back(s.suction_pa);
  Panel panel(time_axis(slices), chart::axis_over("suction, Pa", false, all, true), 130);
  panel.line(in_time(slices, [](const SliceInTime& s) { return s.suction_pa; }), Style::series, 3);
  return panel;
}

Markup rows_of(const InTimePicture& p) {
  Table table({}, "slices", true);
  table.columns("slice", "s", "dead zone, um", "middle, um", "window's dose", "least dose",
                "inflow, mm³/s", "suction, Pa", "force, N");
  for (const SliceInTime& s : p.print.slices) {
    table.begin();
    table.cells(s.slice, fmt::format("{:.2f}", s.seconds),
                fmt::format("{:.0f}–{:.0f}", s.min_um, s.max_um),
                fmt::format("{:.1f}", s.middle_um), fmt::format("{:.3g}", s.window_dose),
                fmt::format("{:.3g}", s.least_dose), fmt::format("{:.3g}", s.inflow_mm3_s),
                fmt::format("{:.3g}", s.suction_pa), fmt::format("{:.3g}", s.force_n));
  }
  return table;
}

}  // namespace

std::string in_time_svg(const InTimePicture& p) {
  chart::Picture picture(p.title, p.words);
  picture.add(front_panel(p, picture));
  picture.legend_band(Style::series, "dead zone, least to greatest");
  picture.legend_line(Style::series, "its middle", 1);
  picture.add(zone_panel(p));
  picture.add(window_panel(p));
  picture.add(suction_panel(p));
  picture.note(p.words);
  return picture.svg();
}

std::string in_time_page(const InTimePicture& p) {
  Page page(p.title, {page_tiles_css});
  page += drawing(in_time_svg(p));
  for (const std::string& note : p.notes) page += markup("<p>{}</p>", note);
  page += rows_of(p);
  return page.html() + "\n";
}

}  // namespace slicecorr
