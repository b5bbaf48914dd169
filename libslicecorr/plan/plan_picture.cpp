// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Speed against contrast and edge errors: the closed form as a curve, corrections as points.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan/closed.hpp"
#include "slicecorr/plan.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr {

namespace {

using chart::Panel;
using chart::Point;
using chart::Style;

constexpr int kKeeps = 0, kFails = 1;
constexpr double kHigh = 230;

struct Drawn {
  std::vector<const PlanPoint*> points;  ///< that print
  std::vector<double> paces;
  bool continuous = true;
  double pace(const PlanPoint& p) const { return continuous ? p.speed_mm_h : p.exposure_s; }
};

void points_of(Panel& panel, const Drawn& d, double PlanPoint::*value, double scale) {
  for (const PlanPoint* p : d.points) {
    panel.point({d.pace(*p), p->*value * scale}, p->keeps ? kKeeps : kFails,
                p->keeps ? fmt::format("{:g}: keeps all", d.pace(*p)) : p->why);
  }
}

/// Speed and time against the tolerance of edges.
void add_tolerances(chart::Picture& picture, const PrintPlan& plan, bool continuous) {
  std::vector<double> tolerances, paces, times;
  std::vector<Point> speed, time;
  for (const PlanTolerance& t : plan.tolerances) {
    tolerances.push_back(t.tolerance_um);
    if (!t.at) continue;
    paces.push_back(continuous ? t.at->speed_mm_h : t.at->exposure_s);
    times.push_back(t.at->print_time().all_s().value_or(t.at->time_s));
    speed.push_back({t.tolerance_um, paces.back()});
    time.push_back({t.tolerance_um, times.back()});
  }
  if (speed.size() < 2) return;
  const bool minutes = *std::max_element(times.begin(), times.end()) >= 600;
  for (std::size_t k = 0; minutes && k < times.size(); ++k) time[k].y = times[k] /= 60;
  const chart::Axis x =
      chart::axis_over("tolerance of edges, um (dotted: the one asked for)", true, tolerances);
  const auto add = [&](const chart::Axis& y, const std::vector<Point>& points, bool last) {
    Panel panel(x, y, kHigh * 0.7, last);
    panel.line(points, Style::series, 2);
    std::size_t k = 0;
    for (const PlanTolerance& t : plan.tolerances) {
      if (t.at) {
        panel.point(points[k], kKeeps, fmt::format("limited by {}", t.limited_by));
        ++k;
      }
    }
    panel.vertical(plan.ask.tolerance_um, "");
    picture.add(panel);
  };
  add(chart::axis_over(continuous ? "fastest speed, mm/h" : "least exposure, s", false, paces,
                       true),
      speed, false);
  add(chart::axis_over(minutes ? "time of all slices, min" : "time of all slices, s", false, times,
                       true),
      time, true);
}

/// Speeds of slices against their height.
void add_along_z(chart::Picture& picture, const PrintPlan& plan) {
  if (plan.slice_speed_mm_h.empty()) return;
  std::vector<Point> steps;
  std::vector<double> speeds{0};
  const int slices = plan.layers + plan.at.extra_slices;
  for (int n = 0; n < slices; ++n) {
    const double v = slice_speed_mm_h(plan.setup.process, n);
    speeds.push_back(v);
    for (const int end : {n, n + 1}) steps.push_back({end * plan.layer_um * 1e-3, v});
  }
  Panel panel(chart::axis_over("height above the platform, mm", false, {0, steps.back().x}),
              chart::axis_over("speed of slices, mm/h", false, speeds, true), kHigh * 0.7);
  panel.line(steps, Style::series, 1);
  panel.horizontal(
      plan.along_z || !plan.suction ? plan.at.speed_mm_h : plan.suction->speed_limit_mm_h,
      "one speed for all");
  picture.add(panel);
}

}  // namespace

std::string PrintPlan::svg(const std::string& title) const {
  Drawn d;
  d.continuous = mode == ExposureMode::continuous;
  for (const PlanPoint& p : curve) {
    if (p.prints) d.points.push_back(&p);
  }
  if (d.points.empty()) d.points.push_back(&at);
  for (const PlanPoint* p : d.points) d.paces.push_back(d.pace(*p));
  const double found = d.pace(at);
  if (light) {
    d.paces.push_back(light->smax_mm_h);
    d.paces.push_back(std::max(light->smin_mm_h, 0.01 * found));
  }
  const std::string unit = d.continuous ? "mm/h" : "s";
  chart::Picture picture(
      title, fmt::format("{:g} {} is the {} that keeps edges within {:g} um and a contrast of {:g} "
                         "in gaps; it is limited by {}.",
                         found, unit, d.continuous ? "fastest speed" : "shortest exposure",
                         ask.tolerance_um, ask.gap_contrast, limited_by));
  picture.legend_point(kKeeps, "a correction that keeps all");
  picture.legend_point(kFails, "one that does not");
  const chart::Axis x =
      chart::axis_over(d.continuous ? "speed, mm/h" : "exposure of a layer, s", true, d.paces);

  const PlanGap* const gap = detail::limiting_gap(gaps);
  std::vector<double> contrasts{ask.gap_contrast};
  std::vector<Point> whole, continuous;
  bool any_gap = false;
  for (const PlanPoint* p : d.points) {
    any_gap = any_gap || p->contrast_at.x >= 0;
    if (p->contrast_at.x >= 0) contrasts.push_back(p->contrast);
  }
  if (light && gap && !gap->at_platform) {
    constexpr int kPoints = 200;
    const double low = std::max(x.low, light->smin_mm_h), high = std::min(x.high, light->smax_mm_h);
    const double g = std::exp(gap->slices * light->layer_um / light->lam_um);
    for (int k = 0; k <= kPoints; ++k) {
      const double s = low * std::pow(high / low, static_cast<double>(k) / kPoints);
      const double p = light->full(s), p0 = light->black(s);
      whole.push_back({s, gap_contrast(*light, gap->slices, s)});
      // Slices of no height: dark and lit stretches meet where both doses are the same.
      const double u = (p - p0) / ((1 - p0) / g + p - 1);
      continuous.push_back({s, std::max(0.0, (p - 1) * (u - 1))});
      contrasts.push_back(continuous.back().y);
    }
  }
  if (any_gap || !whole.empty()) {
    Panel panel(x, chart::axis_over("least contrast of gaps", false, contrasts, true), kHigh,
                false);
    if (!whole.empty()) {
      picture.legend_line(Style::fit, fmt::format("gap of {} slices, closed form", gap->slices));
      picture.legend_line(Style::other, "the same with slices of no height");
      panel.line(continuous, Style::other);
      panel.line(whole, Style::fit);
    }
    panel.horizontal(ask.gap_contrast, "asked for");
    panel.vertical(found, fmt::format("{:g} {}", found, unit));
    for (const PlanPoint* p : d.points) {
      if (p->contrast_at.x >= 0) {
        panel.point({d.pace(*p), p->contrast}, p->keeps ? kKeeps : kFails, p->why);
      }
    }
    picture.add(panel);
  }
  std::vector<double> errors{ask.tolerance_um};
  for (const PlanPoint* p : d.points) errors.push_back(p->max_abs_um);
  Panel panel(x, chart::axis_over("largest edge error, um", false, errors, true), kHigh);
  if (light && ask.light_error > 0) {
    std::vector<Point> upper, lower;
    constexpr int kPoints = 200;
    for (int k = 0; k <= kPoints; ++k) {
      const double s = x.low * std::pow(x.high / x.low, static_cast<double>(k) / kPoints);
      const double p = light->full(s), p0 = light->black(s);
      const double moved = light->lam_um * ask.light_error;
      const double top = panel.full_height() > 0 ? 2 * ask.tolerance_um : 0;
      if (p0 < 1 && moved / (1 - p0) < top) upper.push_back({s, moved / (1 - p0)});
      if (p > 1 && moved / (p - 1) < top) lower.push_back({s, moved / (p - 1)});
    }
    picture.legend_line(
        Style::reference,
        fmt::format("what {:g} % of light moves edges, upper and lower", 100 * ask.light_error));
    panel.line(upper, Style::reference);
    panel.line(lower, Style::reference);
  }
  panel.horizontal(ask.tolerance_um, "tolerance");
  panel.vertical(found, "");
  points_of(panel, d, &PlanPoint::max_abs_um, 1);
  picture.add(panel);
  add_tolerances(picture, *this, d.continuous);
  add_along_z(picture, *this);
  picture.note(fmt::format("What limits it: {}.", limit));
  return picture.svg();
}

}  // namespace slicecorr
