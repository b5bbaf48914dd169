// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "report/page_parts.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::detail {

namespace {

using chart::Panel;
using chart::Point;
using chart::Style;

using Slices = std::vector<FlowDoses::Slice>;

template <class Value>
std::vector<Point> over_slices(const Slices& slices, const Value& value) {
  std::vector<Point> points;
  for (const FlowDoses::Slice& s : slices) points.push_back({1.0 * s.slice, value(s)});
  return points;
}

chart::Axis slice_axis(const Slices& slices) {
  const double last = slices.back().slice;
  return {"slice", false, 1.0 * slices.front().slice, std::max(last, slices.front().slice + 1.0)};
}

/// A single slice is a line across.
Slices drawn(Slices slices) {
  if (slices.size() == 1) {
    slices.push_back(slices.front());
    ++slices.back().slice;
  }
  return slices;
}

Panel share_panel(const Slices& slices) {
  Panel panel(slice_axis(slices), {"share of area, %", false, 0, 100}, 170, false);
  panel.line(over_slices(slices, [](const auto& s) { return 100 * s.without.within_10; }),
             Style::reference);
  panel.line(over_slices(slices, [](const auto& s) { return 100 * s.even.within_10; }),
             Style::series, 0);
  return panel;
}

Panel zone_panel(const Slices& slices, double gap_um) {
  std::vector<double> all{gap_um};
  for (const auto& s : slices) {
    all.push_back(s.even.dead_zone_max_um);
    all.push_back(s.without.dead_zone_max_um);
  }
  Panel panel(slice_axis(slices), chart::axis_over("dead zone, um", false, all, true), 200);
  const auto least = [&](auto light) {
    return over_slices(slices, [&](const auto& s) { return (s.*light).dead_zone_min_um; });
  };
  const auto greatest = [&](auto light) {
    return over_slices(slices, [&](const auto& s) { return (s.*light).dead_zone_max_um; });
  };
  panel.band(least(&FlowDoses::Slice::even), greatest(&FlowDoses::Slice::even), Style::series, 0);
  panel.line(least(&FlowDoses::Slice::without), Style::reference);
  panel.line(greatest(&FlowDoses::Slice::without), Style::reference);
  return panel;
}

}  // namespace

page::Markup flow_charts(const ReportContent& c) {
  if (!c.after.flow || c.after.flow->slices.empty()) return {};
  const FlowDoses& flow = *c.after.flow;
  const Slices slices = drawn(flow.slices);
  chart::Picture picture(
      "Dose and dead zone in resin that flows",
      fmt::format(
          "Share of each slice's section whose dose is within 10 % of the one wanted, and the "
          "range of its dead zone, over slices: {:.1f} % in the mean, {:.1f} % with light "
          "that is the same everywhere.",
          100 * flow.within_10(), 100 * flow.within_10_without()));
  picture.legend_line(Style::series, "this stack");
  picture.legend_line(Style::reference, "the best light that is the same everywhere");
  picture.legend_band(Style::series, "this stack, least to greatest dead zone");
  picture.add(share_panel(slices));
  picture.add(zone_panel(slices, flow.gap_um));
  return page::markup(
      R"(<h3>Resin that flows</h3><p class="dim">Light made for an even dead zone of {:.4g} um. In the mean {:.1f} % of the sections get their dose within 10 %, with the best light that is the same everywhere {:.1f} %. {} slices were looked at. Above, the share of each section; below, its dead zone, least and greatest.</p>{})",
      flow.gap_um, 100 * flow.within_10(), 100 * flow.within_10_without(), flow.slices.size(),
      page::drawing(picture.svg()));
}

}  // namespace slicecorr::detail
