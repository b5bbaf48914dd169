// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Pictures of columns and stationary exposures against time.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "slicecorr/report.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr {

namespace {

using chart::figure;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;

/// Edges of a gelled stretch against time.
struct Stretch {
  std::vector<Point> front, back;
  GelledInterval last;
};

void extend(Stretch& s, double time_s, const GelledInterval& interval) {
  s.front.push_back({time_s, interval.front_um});
  s.back.push_back({time_s, interval.back_um});
  s.last = interval;
}

/// Its edges so far; what is left has none, and stays where it was.
Stretch taken_from(Stretch& s) {
  return {std::exchange(s.front, {}), std::exchange(s.back, {}), s.last};
}

/// Gelled stretches only grow: followed from step to step they are born, grow and merge.
std::vector<Stretch> stretches_of(const std::vector<HistoryStep>& steps, std::size_t stride) {
  std::vector<Stretch> done, open;
  double before_s = 0;
  for (std::size_t i = 0;; i = std::min(i + stride, steps.size() - 1)) {
    const HistoryStep& step = steps[i];
    std::vector<Stretch> next;
    for (const GelledInterval& now : step.gelled) {
      std::vector<std::size_t> parents;
      for (std::size_t k = 0; k < open.size(); ++k) {
        const GelledInterval& old = open[k].last;
        if (old.back_um < now.front_um && now.back_um < old.front_um) parents.push_back(k);
      }
      if (parents.size() == 1) {
        Stretch& s = open[parents[0]];
        extend(s, step.time_s, now);
        next.push_back(taken_from(s));
        continue;
      }
      Stretch born;
      if (parents.empty()) {
        const double middle = 0.5 * (now.front_um + now.back_um);
        extend(born, before_s, {middle, middle});
      }
      // Those that merge meet halfway.
      double back = now.back_um;
      for (std::size_t p = 0; p < parents.size(); ++p) {
        Stretch& s = open[parents[p]];
        const double front = p + 1 < parents.size()
                                 ? 0.5 * (s.last.front_um + open[parents[p + 1]].last.back_um)
                                 : now.front_um;
        extend(s, step.time_s, {front, back});
        back = front;
        done.push_back(taken_from(s));
      }
      extend(born, step.time_s, now);
      next.push_back(std::move(born));
    }
    for (Stretch& s : open) {
      if (!s.front.empty()) done.push_back(std::move(s));
    }
    open = std::move(next);
    before_s = step.time_s;
    if (i + 1 == steps.size()) break;
  }
  for (Stretch& s : open) done.push_back(std::move(s));
  return done;
}

/// Runs of designed layers: [first, last), in um.
std::vector<GelledInterval> runs_of(const std::vector<double>& design, double layer_um) {
  std::vector<GelledInterval> runs;
  for (std::size_t n = 0; n < design.size();) {
    std::size_t end = n;
    while (end < design.size() && (design[end] > 0.5) == (design[n] > 0.5)) ++end;
    if (design[n] > 0.5) {
      runs.push_back({static_cast<double>(end) * layer_um, static_cast<double>(n) * layer_um});
    }
    n = end;
  }
  return runs;
}

Panel time_panel(const ColumnHistory& h, const std::vector<GelledInterval>& runs, double z_end) {
  Panel panel({"time, s", false, 0, h.total_s, false},
              {"z from the platform, um", false, 0, z_end, true}, 400);
  const auto across = [&](double z) { return std::vector<Point>{{0, z}, {h.total_s, z}}; };
  for (const GelledInterval& run : runs) {
    panel.band(across(run.back_um), across(run.front_um), Style::mark);
  }
  // No more points than the picture can show.
  const std::size_t stride = 1 + h.steps.size() / 1200;
  for (const Stretch& s : stretches_of(h.steps, stride)) {
    panel.band(s.back, s.front, Style::other);
    panel.line(s.back, Style::series, 0);
    panel.line(s.front, Style::series, 0);
  }
  std::vector<Point> window, zone, first;
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 0; i < h.steps.size();
       i += i + 1 == h.steps.size() ? 1 : std::min(stride, h.steps.size() - 1 - i)) {
    const HistoryStep& step = h.steps[i];
    // Layer by layer the window jumps when a slice begins.
    if (h.mode == ExposureMode::layerwise && !window.empty() &&
        window.back().y < step.z_window_um) {
      window.push_back({window.back().x, step.z_window_um});
    }
    window.push_back({step.time_s, step.z_window_um});
    if (h.dead_zone_um.empty()) continue;
    const auto n = static_cast<std::size_t>(step.slice);
    const auto at = [&](double above) {
      const double z = step.z_window_um - above;
      return Point{step.time_s, z >= 0 ? z : nothing};
    };
    zone.push_back(at(h.dead_zone_um[n]));
    first.push_back(at(h.first_gel_um[n]));
  }
  panel.line(zone, Style::reference);
  panel.line(first, Style::mark);
  panel.line(window, Style::fit);
  return panel;
}

Panel dose_panel(const ColumnHistory& h, const std::vector<GelledInterval>& runs, double z_end) {
  double most = 1.1;
  for (const DoseProfile& p : h.profiles) {
    for (const double d : p.dose) most = std::max(most, d);
  }
  most *= 1.08;
  Panel panel({"z from the platform, um", false, 0, z_end, false},
              {"dose / critical dose", false, 0, most, false}, 260);
  for (const GelledInterval& run : runs) {
    panel.band({{run.back_um, 0}, {run.front_um, 0}}, {{run.back_um, most}, {run.front_um, most}},
               Style::mark);
  }
  // Later profiles are nowhere lower: drawn from the last to the first, each down to the axis, what
  // is left to see of one is what it added.
  const std::size_t count = std::min<std::size_t>(h.profiles.size(), chart::kSteps);
  for (std::size_t k = count; k-- > 0;) {
    const DoseProfile& p = h.profiles[k];
    // Ends of layers are kept, so that the sawtooth stays one.
    const std::size_t per_layer = kSamplesPerLayer + (h.mode == ExposureMode::layerwise ? 1U : 0U);
    const std::size_t stride = p.z_um.size() > 1500 ? kSamplesPerLayer : 1;
    std::vector<Point> low, high;
    for (std::size_t i = 0; i < p.z_um.size(); ++i) {
      if (i % per_layer % stride != 0 && i + 1 < p.z_um.size()) continue;
      high.push_back({p.z_um[i], p.dose[i]});
      low.push_back({p.z_um[i], 0});
    }
    panel.band(low, high, Style::step, static_cast<int>(k));
  }
  panel.horizontal(1, "gels");
  return panel;
}

/// What each layer's own exposure leaves where it meets the layer above it.
Panel lift_panel(const ColumnHistory& h, double z_end) {
  double most = h.green_strength;
  for (const LayerAtLift& layer : h.lifts) most = std::max(most, layer.joint_dose);
  most *= 1.08;
  Panel panel({"z from the platform, um", false, 0, z_end, false},
              {"own dose at the joint", false, 0, most, false}, 160);
  for (std::size_t n = 0; n < h.lifts.size();) {
    const AtLift state = h.lifts[n].state;
    std::vector<Point> low, high;
    for (; n < h.lifts.size() && h.lifts[n].state == state; ++n) {
      const double from = static_cast<double>(n) * h.layer_um, to = from + h.layer_um;
      const double dose = std::max(h.lifts[n].joint_dose, 0.02 * most);
      for (const double z : {from, to}) {
        high.push_back({z, dose});
        low.push_back({z, 0});
      }
    }
    if (state != AtLift::nothing) {
      panel.band(low, high, Style::series, static_cast<int>(state) - 1);
      panel.line(high, Style::series, static_cast<int>(state) - 1);
    }
  }
  panel.horizontal(h.green_strength, "holds");
  return panel;
}

}  // namespace

std::string column_history_svg(const ColumnHistory& h, const std::string& title) {
  const double layers = std::max(h.steps.empty() ? 1.0 : h.steps.back().z_window_um / h.layer_um,
                                 static_cast<double>(h.design.size()));
  const double z_end = layers * h.layer_um;
  const std::vector<GelledInterval> runs = runs_of(h.design, h.layer_um);
  Picture picture(title,
                  "Above: what of a pixel column has gelled, against time, platform up. Below: the "
                  "dose along the column as the slices add to it.");
  picture.legend_band(Style::other, "gelled");
  picture.legend_line(Style::fit, "window");
  if (!runs.empty()) picture.legend_band(Style::mark, "design");
  if (!h.dead_zone_um.empty()) {
    picture.legend_line(Style::reference, "steady dead zone zf");
    picture.legend_line(Style::mark, "first gel z0");
  }
  picture.add(time_panel(h, runs, z_end));
  if (!h.profiles.empty()) {
    const std::size_t count = std::min<std::size_t>(h.profiles.size(), chart::kSteps);
    for (std::size_t k = 0; k < count; ++k) {
      const DoseProfile& p = h.profiles[k];
      picture.legend_band(Style::step, fmt::format("to slice {}", p.slice), static_cast<int>(k));
    }
    picture.add(dose_panel(h, runs, z_end));
  }
  if (h.mode == ExposureMode::layerwise) {
    picture.note("Time is that of the exposures; the lifts between them are not in it.");
    if (!h.lifts.empty()) {
      for (const AtLift state :
           {AtLift::holds, AtLift::film, AtLift::liquid, AtLift::does_not_hold}) {
        const auto is = [&](const LayerAtLift& layer) { return layer.state == state; };
        if (std::any_of(h.lifts.begin(), h.lifts.end(), is)) {
          picture.legend_band(Style::series, "at its lift: " + name_of(state),
                              static_cast<int>(state) - 1);
        }
      }
      picture.add(lift_panel(h, z_end));
      picture.note(
          "At its lift a layer hangs on the one above it by what its own exposure left there.");
    }
  }
  return picture.svg();
}

std::string stationary_svg(const std::vector<StationaryFronts>& exposures, double time_s,
                           const std::string& title, const std::string& note) {
  double z_end = 0;
  for (const StationaryFronts& e : exposures) {
    for (const auto& p : e.points) z_end = std::max(z_end, p.back_um);
  }
  Panel panel({"time, s", false, 0, time_s, false},
              {"z from the window, um", false, 0, z_end > 0 ? 1.07 * z_end : 1.0, false}, 400);
  Picture picture(title,
                  "Curing fronts over a window that stands still: between the two lines of a "
                  "colour resin has gelled.");
  int series = 0;
  for (const StationaryFronts& e : exposures) {
    std::vector<Point> front, back;
    for (const auto& p : e.points) {
      front.push_back({p.time_s, p.front_um});
      back.push_back({p.time_s, p.back_um});
    }
    panel.band(front, back, Style::series, series);
    panel.line(front, Style::series, series);
    panel.line(back, Style::series, series);
    if (!e.points.empty()) panel.point({e.first.time_s, e.first.z_um}, series);
    std::string words = fmt::format("{} mW/cm²", figure(e.blue_mw_cm2));
    if (e.uv_mw_cm2 > 0) words += fmt::format(" over {} of UV", figure(e.uv_mw_cm2));
    if (e.points.empty()) words += ": nothing gels";
    picture.legend_point(series, words);
    ++series;
  }
  picture.add(panel);
  for (const StationaryFronts& e : exposures) {
    if (e.points.empty()) continue;
    std::string words =
        fmt::format("{} mW/cm²: first gel after {} s at {} um", figure(e.blue_mw_cm2),
                    figure(e.first.time_s), figure(e.first.z_um));
    if (e.uv_mw_cm2 > 0) {
      words += std::isfinite(e.window_s)
                   ? fmt::format(", cures to the window after {} s", figure(e.window_s))
               : e.dead_zone_um > 0
                   ? fmt::format(", steady dead zone {} um", figure(e.dead_zone_um))
                   : std::string(", no dead zone lasts");
    }
    picture.note(words + ".");
  }
  if (!note.empty()) picture.note(note);
  return picture.svg();
}

}  // namespace slicecorr
