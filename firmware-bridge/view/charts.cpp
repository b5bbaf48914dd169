// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "view/charts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "support/text/display_text.hpp"
#include "view/envelope.hpp"

namespace slicecorr::bridge::detail {
namespace {

using chart::Axis;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;

constexpr double kPanelHeight = 170, kHalfHeight = 120;

using Of = std::function<double(const FrameRow&)>;

std::vector<Point> series(const PrintRecord& r, const Of& x, const Of& y) {
  std::vector<Point> points;
  points.reserve(r.frames.size());
  for (const FrameRow& f : r.frames) points.push_back({x(f), y(f)});
  return points;
}

double number(const FrameRow& f) { return f.frame; }

/// The stage's way as people count it: heights in mm, or turns; errors in um, or degrees.
struct Way {
  explicit Way(const PrintFacts& f)
      : turns(f.turns()),
        per_um(turns ? 1 / (360 * f.um_per_deg) : 1e-3),
        short_per_um(turns ? 1 / f.um_per_deg : 1),
        title(turns ? "turns" : "z, mm"),
        over(turns ? "over the turns" : "over z"),
        unit(turns ? "°" : "um") {}
  bool turns;
  double per_um, short_per_um;
  const char *title, *over, *unit;
  Of place() const {
    return [k = per_um](const FrameRow& f) { return f.z_um * k; };
  }
};

bool any(const std::vector<Point>& points) {
  return std::any_of(points.begin(), points.end(),
                     [](const Point& p) { return std::isfinite(p.x) && std::isfinite(p.y); });
}

Axis axis_of(std::string title, const std::vector<const std::vector<Point>*>& lists, bool of_x,
             std::vector<double> more = {}, bool from_zero = false) {
  for (const auto* const list : lists) {
    for (const Point& p : *list) more.push_back(of_x ? p.x : p.y);
  }
  Axis axis = chart::axis_over(std::move(title), false, more, from_zero);
  if (!of_x) return axis;
  // Without room at the sides: a print begins and ends.
  const double room = 0.07 / 1.14 * (axis.high - axis.low);
  if (!from_zero) axis.low += room;
  axis.high -= from_zero ? 0.07 / 1.07 * (axis.high - axis.low) : room;
  if (!(axis.high > axis.low)) axis.high = axis.low + 1;
  return axis;
}

/// Where the print failed.
double fault_place(const PrintRecord& r) {
  return r.fault == Fault::none ? NAN : r.fault_z_um * Way(r.facts).per_um;
}
double fault_frame(const PrintRecord& r) {
  return r.fault == Fault::none || r.fault_frame < 0 ? NAN : r.fault_frame;
}
/// `row`: where its word is in the way of nothing.
void mark_fault(Panel& panel, const PrintRecord& r, double at, int row) {
  if (std::isfinite(at)) panel.vertical(at, std::string(name_of(r.fault)), row);
}

/// So that the line of a fault at the end is not the frame's.
Axis with_room(Axis axis, double fault) {
  if (std::isfinite(fault)) axis.high += 0.03 * (axis.high - axis.low);
  return axis;
}

/// The axis of the stage's way, from the first frame to where the print came.
Axis way_axis(const PrintRecord& r, const std::vector<Point>& points) {
  const double fault = fault_place(r);
  return with_room(axis_of(Way(r.facts).title, {&points}, true, {fault}), fault);
}

/// Counts on a logarithmic axis, a bar for each bound.
template <typename Bounds, typename Counts>
Panel histogram(const Bounds& bounds, const Counts& counts, const char* unit, int colour) {
  const auto names = bound_names(bounds.data(), bounds.size());
  std::uint64_t most = 1;
  for (const std::uint64_t n : counts) most = std::max(most, n);
  Axis x{fmt::format("late by at most, {}; the last: by more", unit), false, 0,
         static_cast<double>(counts.size())};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    x.ticks.push_back({static_cast<double>(i) + 0.5, i < bounds.size() ? names[i] : ">"});
  }
  const double high = std::pow(10.0, std::ceil(std::log10(static_cast<double>(most)) + 0.35));
  Panel panel(std::move(x), Axis{"frames", true, 0.5, std::max(10.0, high)}, kPanelHeight);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    const double left = static_cast<double>(i) + 0.1, right = left + 0.8;
    const auto n = static_cast<double>(counts[i]);
    const std::vector<Point> floor{{left, 0.5}, {right, 0.5}}, top{{left, n}, {right, n}};
    panel.band(floor, top, Style::series, colour);
    panel.line({{left, 0.5}, {left, n}, {right, n}, {right, 0.5}}, Style::series, colour);
    panel.words({left + 0.4, n}, text::count(static_cast<std::int64_t>(counts[i])), 0, -5,
                "middle");
  }
  return panel;
}

void add_histograms(const PrintRecord& r, std::vector<Chart>& charts) {
  const auto total = [](const auto& counts) {
    std::uint64_t sum = 0;
    for (const std::uint64_t n : counts) sum += n;
    return sum;
  };
  const bool deg = r.facts.turns() && total(r.lateness.deg) > 0;
  const bool um = !deg && total(r.lateness.um) > 0, ms = total(r.lateness.ms) > 0;
  if (!deg && !um && !ms) return;
  Picture picture("How late frames were",
                  "Numbers of frames by how late they were, on a logarithmic axis");
  if (deg) picture.add(histogram(Lateness::kBoundsDeg, r.lateness.deg, "degrees of the turn", 0));
  if (um) picture.add(histogram(Lateness::kBoundsUm, r.lateness.um, "um of the stage's way", 0));
  if (ms) {
    picture.add(histogram(Lateness::kBoundsMs, r.lateness.ms,
                          r.facts.layerwise ? "ms of exposure" : "ms", 2));
  }
  picture.note("What is early counts as in time, in the first bar.");
  charts.push_back({"How late frames were", picture.svg()});
}

void add_lateness(const PrintRecord& r, std::vector<Chart>& charts) {
  const bool layers = r.facts.layerwise;
  const Way way(r.facts);
  const Of late = [layers, k = way.short_per_um](const FrameRow& f) {
    return layers ? (f.exposed_s - f.exposure_s) * 1e3 : f.late_um * k;
  };
  const auto all = series(r, number, late);
  if (!any(all)) return;
  std::vector<Point> late_ones;
  for (const FrameRow& f : r.frames) {
    if (f.late) late_ones.push_back({number(f), late(f)});
  }
  const char* const unit = layers ? "ms" : way.unit;
  const int digits = way.turns ? 3 : 2;
  Picture picture(
      layers ? "Exposures, longer than asked" : "Lateness of each frame",
      fmt::format("Lateness in {} over the number of the frame; {} of {} frames are late", unit,
                  late_ones.size(), r.frames.size()));
  std::vector<double> more{0, layers      ? Lateness::kBoundsMs[0]
                              : way.turns ? Lateness::kBoundsDeg[0]
                                          : Lateness::kBoundsUm[0]};
  const double most_late = r.facts.max_late_um * way.short_per_um;
  const bool limited = !layers && most_late > 0;
  double worst = 0, earliest = 0;
  for (const Point& p : all) {
    if (!std::isfinite(p.y)) continue;
    worst = std::max(worst, p.y);
    earliest = std::min(earliest, p.y);
  }
  // Where frames are far from what is borne, its line would flatten them.
  if (limited && worst > most_late / 20) more.push_back(most_late);
  Panel panel(with_room(axis_of(layers ? "layer" : "frame", {&all}, true, {fault_frame(r)}),
                        fault_frame(r)),
              axis_of(fmt::format("late, {}", unit), {&all}, false, more), kPanelHeight);
  if (limited) panel.horizontal(most_late, "more counts as late");
  if (limited && earliest < -most_late / 2) {
    panel.horizontal(-most_late, "so does what is earlier", true);
  }
  panel.line(envelope(all), Style::series, 0);
  for (const Peak& p : peaks(late_ones)) {
    panel.point(p.at, 1,
                p.count == 1 ? fmt::format("frame {:.0f}: {:.{}f} {}", p.at.x, p.at.y, digits, unit)
                             : fmt::format("{} late frames here; the worst, {:.0f}: {:.{}f} {}",
                                           p.count, p.at.x, p.at.y, digits, unit));
  }
  mark_fault(panel, r, fault_frame(r), 2);
  picture.legend_line(Style::series, layers ? "exposure less what was asked" : "lateness", 0);
  if (!late_ones.empty()) picture.legend_point(1, "late");
  picture.add(panel);
  charts.push_back({"Lateness", picture.svg()});
}

void add_stage(const PrintRecord& r, std::vector<Chart>& charts) {
  const Way way(r.facts);
  const auto error = series(
      r, way.place(), [k = way.short_per_um](const FrameRow& f) { return f.stage_error_um * k; });
  if (!any(error)) return;
  double worst = 0;
  for (const Point& p : error) {
    if (std::isfinite(p.y)) worst = std::max(worst, std::abs(p.y));
  }
  // Less than that is rounding.
  const double least = way.turns ? Lateness::kBoundsDeg[0] : Lateness::kBoundsUm[0];
  std::vector<double> more{-least, least};
  const double tolerance = r.facts.tolerance_um * way.short_per_um;
  // Between two frames the stage may have been further off than at any; the page's figure is that.
  const double most = r.last ? r.last->worst_stage_error_um * way.short_per_um : 0;
  const bool between = most > worst + least;
  if (between) {
    worst = most;
    more.push_back(most);
  }
  if (worst > tolerance / 20) more.insert(more.end(), {-tolerance, tolerance});
  Picture picture("Where the stage was, measured less commanded",
                  fmt::format("The stage's error {}, at most {:.{}f} {}", way.over, worst,
                              way.turns ? 3 : 2, way.unit));
  Panel panel(way_axis(r, error),
              axis_of(fmt::format("error, {}", way.unit), {&error}, false, more), kHalfHeight);
  if (tolerance > 0) {
    panel.horizontal(tolerance, "tolerance", true);
    panel.horizontal(-tolerance, "");
  }
  if (between) panel.horizontal(most, "largest either way, between two frames");
  panel.line(envelope(error), Style::series, 0);
  mark_fault(panel, r, fault_place(r), 0);
  picture.add(panel);
  charts.push_back({"Stage", picture.svg()});
}

/// Asked and measured of one lamp.
void lamp_panel(Picture& picture, const PrintRecord& r, const std::vector<Point>& asked,
                const std::vector<Point>& measured, const char* title, bool x_labels) {
  Panel panel(way_axis(r, asked), axis_of(title, {&asked, &measured}, false, {0}, true),
              kHalfHeight, x_labels);
  panel.line(envelope(measured), Style::series, 0);
  panel.line(envelope(asked), Style::reference);
  mark_fault(panel, r, fault_place(r), 3);
  picture.add(panel);
}

void add_lamps(const PrintRecord& r, std::vector<Chart>& charts) {
  const Way way(r.facts);
  const Of at = way.place();
  const auto blue_asked = series(r, at, [](const FrameRow& f) { return f.blue_share * 100; });
  const auto blue = series(r, at, [](const FrameRow& f) { return f.blue_measured * 100; });
  const auto uv_asked = series(r, at, [](const FrameRow& f) { return f.uv_mw_cm2; });
  const auto uv = series(r, at, [](const FrameRow& f) { return f.uv_measured; });
  if (!any(blue_asked) && !any(blue)) return;
  const auto shines = [](const std::vector<Point>& points) {
    return std::any_of(points.begin(), points.end(), [](const Point& p) { return p.y > 0; });
  };
  const bool with_uv = r.facts.uv || shines(uv) || shines(uv_asked);
  Picture picture("Lamps, asked and measured",
                  fmt::format("Light asked and measured {}", way.over));
  picture.legend_line(Style::series, "measured", 0);
  picture.legend_line(Style::reference, "asked");
  lamp_panel(picture, r, blue_asked, blue, "blue, %", !with_uv);
  if (with_uv) lamp_panel(picture, r, uv_asked, uv, "UV, mW/cm²", true);
  picture.note(
      "At the moment when each frame was shown; a lamp follows what is asked with its own time.");
  charts.push_back({"Lamps", picture.svg()});
}

void add_speed(const PrintRecord& r, std::vector<Chart>& charts) {
  if (r.facts.layerwise) {
    const auto asked = series(r, number, [](const FrameRow& f) { return f.exposure_s; });
    const auto was = series(r, number, [](const FrameRow& f) { return f.exposed_s; });
    if (!any(asked)) return;
    Picture picture("Exposures", "Exposure of each layer, asked and as it was");
    picture.legend_line(Style::series, "as it was", 0);
    picture.legend_line(Style::reference, "asked");
    Panel panel(axis_of("layer", {&asked}, true), axis_of("s", {&asked, &was}, false, {0}, true),
                kHalfHeight);
    panel.line(envelope(was), Style::series, 0);
    panel.line(envelope(asked), Style::reference);
    picture.add(panel);
    charts.push_back({"Exposures", picture.svg()});
    return;
  }
  const Way way(r.facts);
  const double per_um_s = way.turns ? way.short_per_um : 3.6;
  const auto speed =
      series(r, way.place(), [per_um_s](const FrameRow& f) { return f.speed_um_s * per_um_s; });
  if (!any(speed)) return;
  const double planned = r.facts.speed_um_s * per_um_s;
  Picture picture("Speed", fmt::format("Measured speed of the stage {}", way.over));
  // From 0 a wobble of a vial, some per cent, would be flat.
  Panel panel(way_axis(r, speed),
              way.turns ? axis_of("°/s", {&speed}, false, {0.99 * planned, 1.01 * planned})
                        : axis_of("mm/h", {&speed}, false, {planned}, true),
              kHalfHeight);
  if (planned > 0) panel.horizontal(planned, "planned", true);
  panel.line(envelope(speed), Style::series, 0);
  mark_fault(panel, r, fault_place(r), way.turns ? 0 : 3);
  picture.add(panel);
  charts.push_back({"Speed", picture.svg()});
}

void add_display(const PrintRecord& r, std::vector<Chart>& charts) {
  const auto upload = series(r, number, [](const FrameRow& f) { return f.upload_s * 1e3; });
  const auto present = series(r, number, [](const FrameRow& f) { return f.present_s * 1e3; });
  const auto takes_time = [](const std::vector<Point>& points) {
    return std::any_of(points.begin(), points.end(), [](const Point& p) { return p.y > 0; });
  };
  if (!takes_time(upload) && !takes_time(present)) return;
  double missed = 0;
  for (const FrameRow& f : r.frames)
    missed += std::isfinite(f.missed_vblanks) ? f.missed_vblanks : 0;
  Picture picture("Into the display",
                  "Time of each frame to be brought into the display and to light");
  picture.legend_line(Style::series, "pixels into its memory", 0);
  picture.legend_line(Style::series, "from there to light", 1);
  Panel panel(axis_of("frame", {&upload}, true),
              axis_of("ms", {&upload, &present}, false, {0}, true), kHalfHeight);
  panel.line(envelope(present), Style::series, 1);
  panel.line(envelope(upload), Style::series, 0);
  picture.add(panel);
  if (missed > 0) picture.note(fmt::format("{:.0f} refreshes of the display were missed.", missed));
  charts.push_back({"Display", picture.svg()});
}

void add_temperature(const PrintRecord& r, std::vector<Chart>& charts) {
  const Way way(r.facts);
  const auto t = series(r, way.place(), [](const FrameRow& f) { return f.temperature_c; });
  if (!any(t)) return;
  Picture picture("Temperature",
                  fmt::format("Temperature that the machine measured, {}", way.over));
  Panel panel(way_axis(r, t), axis_of("°C", {&t}, false), kHalfHeight);
  panel.line(envelope(t), Style::series, 1);
  picture.add(panel);
  charts.push_back({"Temperature", picture.svg()});
}

}  // namespace

std::vector<std::string> bound_names(const double* bounds, std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < count; ++i) names.push_back(fmt::format("{:g}", bounds[i]));
  names.emplace_back("more");
  return names;
}

namespace {

/// The greatest of what `of` says of frames, either way; NaN where none says anything.
double most_of(const PrintRecord& r, const Of& of) {
  double most = NAN;
  for (const FrameRow& f : r.frames) {
    if (const double v = of(f); std::isfinite(v)) most = std::fmax(most, std::abs(v));
  }
  return most;
}

/// What a chart would show in words, where a print came to its end and nothing in it is worth a look; else
/// empty. `title`: of the chart.
std::string quiet_words(const PrintRecord& r, const std::string& title) {
  if (r.end != PrintRecord::End::done || r.fault != Fault::none) return {};
  const Way way(r.facts);
  const auto length = [&](double um) {
    return fmt::format("{} {}", text::figure(um * way.short_per_um), way.unit);
  };
  const bool late =
      std::any_of(r.frames.begin(), r.frames.end(), [](const FrameRow& f) { return f.late; });
  if (title == "Lateness" || title == "How late frames were") {
    if (late || r.facts.layerwise || !(r.facts.max_late_um > 0)) return {};
    const double worst = most_of(r, [](const FrameRow& f) { return f.late_um; });
    if (!(worst <= r.facts.max_late_um / 2)) return {};
    return fmt::format("no frame was late: at most {} off its place, {} are borne", length(worst),
                       length(r.facts.max_late_um));
  }
  if (title == "Stage") {
    const double worst = std::fmax(most_of(r, [](const FrameRow& f) { return f.stage_error_um; }),
                                   r.last ? r.last->worst_stage_error_um : 0);
    if (!(worst <= r.facts.tolerance_um / 2)) return {};
    return fmt::format("the stage was at most {} off, {} are borne", length(worst),
                       length(r.facts.tolerance_um));
  }
  if (title == "Lamps") {
    // Of full light.
    const double blue =
        most_of(r, [](const FrameRow& f) { return f.blue_measured - f.blue_share; });
    const double uv = most_of(r, [](const FrameRow&f) { return f.uv_measured - f.uv_mw_cm2; }),
                 uv_most = most_of(r, [](const FrameRow&f) { return f.uv_mw_cm2; });
    if (!(blue <= 0.02) || uv > 0.02 * uv_most) return {};
    return fmt::format("the lamps gave what was asked to {} % of full light",
                       text::figure(100 * blue));
  }
  if (title == "Speed") {
    const double off =
        most_of(r, [v = r.facts.speed_um_s](const FrameRow& f) { return f.speed_um_s / v - 1; });
    if (!(r.facts.speed_um_s > 0 && off <= 0.02)) return {};
    return fmt::format("the speed was as planned to {} %", text::figure(100 * off));
  }
  if (title == "Display") {
    const double missed = most_of(r, [](const FrameRow& f) { return f.missed_vblanks; });
    return missed > 0 || !std::isfinite(missed) ? "" : "the display missed no refresh";
  }
  if (title == "Temperature") {
    double least = NAN, most = NAN;
    for (const FrameRow& f : r.frames) {
      least = std::fmin(least, f.temperature_c);
      most = std::fmax(most, f.temperature_c);
    }
    if (!(most - least <= 3)) return {};
    return fmt::format("the temperature stayed between {:.1f} and {:.1f} °C", least, most);
  }
  return {};
}

}  // namespace

std::vector<Chart> charts_of(const PrintRecord& record) {
  std::vector<Chart> charts;
  add_histograms(record, charts);
  add_lateness(record, charts);
  add_stage(record, charts);
  add_lamps(record, charts);
  add_speed(record, charts);
  add_display(record, charts);
  add_temperature(record, charts);
  for (Chart& c : charts) c.quiet = quiet_words(record, c.title);
  return charts;
}

}  // namespace slicecorr::bridge::detail
