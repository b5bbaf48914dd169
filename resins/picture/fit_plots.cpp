// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Pictures of fits: data, curve, band and residuals.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include "picture/fit_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/resins/plots.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::resins {

namespace {

using chart::Axis;
using chart::axis_over;
using chart::figure;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;

/// More would make files that no viewer opens.
constexpr std::size_t kMostPoints = 4000;
constexpr std::size_t kMostLegends = 12;
constexpr int kCurvePoints = 200;

/// Where a measurement belongs in the legend; points of a group are drawn alike.
struct Group {
  double blue_mw_cm2 = 0, exposure_s = 0;
  auto operator<=>(const Group&) const = default;  // NOLINT: no 0 is a pointer here
};

/// Measurements of one kind, with where they stand in a picture.
struct Data {
  std::vector<std::size_t> points;  ///< indices into `FitResult::points`
  std::map<Group, int> series;
};

Data data_of(const FitResult& fit, bool dead_zones, bool by_exposure) {
  Data data;
  for (std::size_t i = 0; i < fit.points.size(); ++i) {
    const FitPoint& p = fit.points[i];
    if (p.is_dead_zone != dead_zones) continue;
    data.points.push_back(i);
    data.series.emplace(Group{p.blue_mw_cm2, by_exposure ? p.exposure_s : 0}, 0);
  }
  if (data.points.empty()) {
    throw InputError(fmt::format("the fit has no measurements of {} to draw",
                                 dead_zones ? "dead zones" : "cured heights"));
  }
  int next = 0;
  for (auto& [group, series] : data.series) series = next++;
  return data;
}

int series_of(const Data& data, const FitPoint& p, bool by_exposure) {
  return data.series.at({p.blue_mw_cm2, by_exposure ? p.exposure_s : 0});
}

/// Height of the legend stays in bounds, however many intensities there are.
void data_legend(Picture& picture, const Data& data) {
  std::size_t shown = 0;
  for (const auto& [group, series] : data.series) {
    if (shown++ == kMostLegends) {
      picture.note(fmt::format("{} more intensities are drawn without a word in the legend.",
                               data.series.size() - kMostLegends));
      break;
    }
    std::string text = group.blue_mw_cm2 > 0 ? figure(group.blue_mw_cm2) + " mW/cm²" : "data";
    if (group.exposure_s > 0) text += fmt::format(", {} s", figure(group.exposure_s));
    picture.legend_point(series, text);
  }
}

/// Bars over replicates, one standard deviation to either side of their mean; true when there are
/// any.
bool draw_scatter(Panel& panel, const FitResult& fit, const Data& data, bool by_exposure,
                  const std::function<double(const FitPoint&)>& x) {
  struct Sum {
    double n = 0, mean = 0, squares = 0;
    std::size_t any = 0;
  };
  std::map<std::tuple<double, double, double, double>, Sum> conditions;
  for (const std::size_t i : data.points) {
    const FitPoint& p = fit.points[i];
    Sum& s = conditions[{p.blue_mw_cm2, p.uv_mw_cm2, p.exposure_s, p.dose_mj_cm2}];
    s.any = i;
    ++s.n;
    const double off = p.measured_um - s.mean;
    s.mean += off / s.n;
    s.squares += off * (p.measured_um - s.mean);
  }
  bool any = false;
  for (const auto& [condition, s] : conditions) {
    if (s.n < 2 || conditions.size() > kMostPoints) continue;
    const FitPoint& p = fit.points[s.any];
    panel.bar({x(p), s.mean}, series_of(data, p, by_exposure), std::sqrt(s.squares / (s.n - 1)));
    any = true;
  }
  return any;
}

/// Data in a panel at (x, y), every so many where there are too many.
void draw_points(Panel& panel, Picture* picture, const FitResult& fit, const Data& data,
                 bool by_exposure, const std::function<double(const FitPoint&)>& x,
                 const std::function<double(const FitPoint&)>& y) {
  const std::size_t stride = (data.points.size() + kMostPoints - 1) / kMostPoints;
  for (std::size_t i = 0; i < data.points.size(); i += stride) {
    const FitPoint& p = fit.points[data.points[i]];
    panel.point({x(p), y(p)}, series_of(data, p, by_exposure),
                fmt::format("line {}: {} um, fit {} um", p.origin.line, figure(p.measured_um),
                            figure(p.predicted_um)));
  }
  if (picture && stride > 1) {
    picture->note(
        fmt::format("Every {}th of {} measurements is drawn.", stride, data.points.size()));
  }
}

/// Rings about the outliers among `data`; true when there are any.
bool draw_rings(Panel& panel, const FitResult& fit, bool dead_zones,
                const std::function<double(const FitPoint&)>& x,
                const std::function<double(const FitPoint&)>& y) {
  std::set<std::size_t> done;
  for (const Outlier& o : fit.outliers) {
    if (o.point >= fit.points.size() || !done.insert(o.point).second) continue;
    const FitPoint& p = fit.points[o.point];
    if (p.is_dead_zone != dead_zones) continue;
    panel.ring({x(p), y(p)}, fmt::format("line {}", p.origin.line));
  }
  return !done.empty();
}

void figures_notes(Picture& picture, const FitResult& fit) {
  for (const Parameter& p : fit.parameters) picture.note(parameter_words(p));
  picture.note(
      fmt::format("R² {:.4f}, RMSE {} um, {} measurements", fit.r2, figure(fit.rmse_um), fit.n));
}

Panel residual_panel(Picture& picture, const Axis& x_axis, const FitResult& fit, const Data& data,
                     bool dead_zones, bool by_exposure,
                     const std::function<double(const FitPoint&)>& x) {
  const auto residual = [](const FitPoint& p) { return p.measured_um - p.predicted_um; };
  double most = 0;
  for (const std::size_t i : data.points) {
    const double r = std::abs(residual(fit.points[i]));
    if (std::isfinite(r)) most = std::max(most, r);
  }
  const double reach = most > 0 ? 1.25 * most : 1;
  Panel panel(x_axis, {"residual, um", false, -reach, reach}, 110);
  panel.horizontal(0, "");
  draw_points(panel, nullptr, fit, data, by_exposure, x, residual);
  if (draw_rings(panel, fit, dead_zones, x, residual)) picture.legend_ring("outlier");
  return panel;
}

/// A curve with its band; `predict` and `half_width` over x.
struct Curve {
  std::vector<Point> line, low, high;
};

Curve curve_over(const Axis& axis, const std::function<double(double)>& predict,
                 const std::function<double(double)>& half_width) {
  Curve c;
  for (int i = 0; i <= kCurvePoints; ++i) {
    const double t = static_cast<double>(i) / kCurvePoints;
    const double x = axis.logarithmic ? axis.low * std::pow(axis.high / axis.low, t)
                                      : axis.low + t * (axis.high - axis.low);
    const double y = predict(x), w = half_width(x);
    c.line.push_back({x, y});
    c.low.push_back({x, y - w});
    c.high.push_back({x, y + w});
  }
  return c;
}

/// The working curve of a fit over its own dose: D, I^m t, or with a time to gel I / ig(t).
struct WorkingCurve {
  bool jacobs = true;
  double m = 1, gel_dose = 0, height_um = 0;
  std::string axis, unit;
  std::optional<GelTime> gel_time;
  double dose(const FitPoint& p) const {
    if (gel_time) return p.blue_mw_cm2 / gel_intensity_mw_cm2(*gel_time, p.exposure_s);
    if (jacobs) return p.dose_mj_cm2;
    return std::pow(p.blue_mw_cm2, m) * p.exposure_s;
  }
  /// Exposure that gives a dose at an intensity.
  double exposure(double dose, double blue) const {
    if (gel_time) return gel_time_s(*gel_time, blue / dose);
    return jacobs ? dose / blue : dose / std::pow(blue, m);
  }
};

WorkingCurve working_curve_of(const FitResult& fit) {
  WorkingCurve w;
  w.jacobs = kind_of(fit.model).by_dose;
  if (!kind_of(fit.model).heights) {
    throw InputError("a fit of dead zones has no working curve; expected one of cured heights");
  }
  w.height_um = fit.value("h_um");
  if (w.jacobs) {
    w.gel_dose = fit.value("dc_mj_cm2");
    w.axis = "dose D, mJ/cm²";
    w.unit = "mJ/cm²";
  } else if (fit.model == FitModel::gel_time) {
    w.gel_time = {fit.value("gel_a_mj_cm2"), fit.value("gel_b_sqrt_mw_cm2_s")};
    w.gel_dose = 1;
    w.axis = "intensity over that which gels in the same time, I/ig(t)";
  } else {
    w.m = fit.value("m");
    w.gel_dose = fit.value("critical_dose_prime");
    w.axis = fmt::format("dose analogue D′ = Iᵐ t, {}", prime_unit(w.m));
    w.unit = prime_unit(w.m);
  }
  return w;
}

/// Fit and band in a panel, over the dose. The band of a kinetic fit depends on the intensity as
/// well: the widest of those measured is drawn.
Curve curve_of(const FitResult& fit, const WorkingCurve& w, const Axis& axis, const Data& data) {
  std::vector<double> blues;
  for (const auto& [group, series] : data.series) {
    blues.push_back(group.blue_mw_cm2 > 0 ? group.blue_mw_cm2 : 1);
  }
  // The widest lies at the ends of the range and at its middle.
  if (blues.size() > 3) blues = {blues.front(), blues[blues.size() / 2], blues.back()};
  if (w.jacobs) blues.resize(1);
  return curve_over(
      axis, [&](double d) { return predict_um(fit, blues[0], 0, w.exposure(d, blues[0])); },
      [&](double d) {
        double widest = 0;
        for (const double blue : blues) {
          const double c = confidence_um(fit, blue, 0, w.exposure(d, blue));
          if (!std::isfinite(c)) return c;
          widest = std::max(widest, c);
        }
        return widest;
      });
}

/// Axis of heights that holds the data, and the curve where there is data.
Axis height_axis(const FitResult& fit, const Data& data, const std::string& title) {
  std::vector<double> values{0};
  for (const std::size_t i : data.points) {
    const FitPoint& p = fit.points[i];
    values.push_back(p.measured_um);
    if (p.predicted_um > 0) values.push_back(p.predicted_um);
  }
  Axis axis = axis_over(title, false, values, true);
  // Room for points that lie at zero.
  axis.low = -0.03 * axis.high;
  return axis;
}

}  // namespace

std::string working_curve_svg(const FitResult& fit, double dose_factor, const std::string& name) {
  const WorkingCurve w = working_curve_of(fit);
  // A multiple of the time to gel is no one place on an axis of intensities.
  if (w.gel_time) dose_factor = 1;
  const Data data = data_of(fit, false, false);
  const auto dose = [&](const FitPoint& p) { return w.dose(p); };
  const double aim = dose_factor * w.gel_dose;
  std::vector<double> doses{w.gel_dose, aim};
  for (const std::size_t i : data.points) doses.push_back(dose(fit.points[i]));
  const Axis x = axis_over(w.axis, true, doses);
  std::vector<double> heights{0, w.height_um * std::log(aim / w.gel_dose) / w.m};
  Axis y = height_axis(fit, data, "cured height, um");
  y.high = std::max(y.high, axis_over("", false, heights, true).high);

  const Curve curve = curve_of(fit, w, x, data);
  const bool band = std::any_of(curve.low.begin(), curve.low.end(),
                                [](const Point& p) { return std::isfinite(p.y); });
  const std::string kind = w.jacobs                       ? "Jacobs"
                           : w.gel_time                   ? "gel-time"
                           : fit.model == FitModel::joint ? "joint"
                                                          : "kinetic";
  Picture picture(
      titled(name, fmt::format("working curve, {} fit", kind)),
      fmt::format("Cured height over dose on a logarithmic axis: {} measurements, a {} fit{} and "
                  "residuals.{}",
                  data.points.size(), kind, band ? " with its 95 % band" : "",
                  w.gel_time ? "" : fmt::format(" Gel dose {} {}.", figure(w.gel_dose), w.unit)));
  data_legend(picture, data);
  picture.legend_line(Style::fit, "fit");
  if (band) picture.legend_band(Style::fit, "95 % band of the curve");

  Panel panel(x, y, 320, false);
  panel.band(curve.low, curve.high, Style::fit);
  panel.vertical(w.gel_dose,
                 w.gel_time ? "just gels" : fmt::format("gel dose {}", figure(w.gel_dose)), 0);
  if (dose_factor != 1) {
    panel.vertical(aim, fmt::format("aim {:g} × gel = {}", dose_factor, figure(aim)), 1);
  }
  panel.line(curve.line, Style::fit);
  const auto measured = [](const FitPoint& p) { return p.measured_um; };
  draw_points(panel, &picture, fit, data, false, dose, measured);
  if (draw_scatter(panel, fit, data, false, dose)) {
    picture.legend_bar("scatter of replicates, ± 1 s");
  }
  draw_rings(panel, fit, false, dose, measured);
  panel.dot({w.gel_dose, 0});
  picture.add(panel);
  picture.add(residual_panel(picture, x, fit, data, false, false, dose));
  figures_notes(picture, fit);
  if (w.gel_time) {
    picture.note(
        "Time to gel A/i + B/√i; ig(t) gels in just t. Measurements at all intensities lie on one "
        "line where it holds.");
    return picture.svg();
  }
  picture.note(fmt::format(
      "Gel dose: {0} {1}, where the curve meets zero height. Correction aims at {2:g} times that: "
      "{3} {1}.",
      figure(w.gel_dose), w.unit, dose_factor, figure(aim)));
  return picture.svg();
}

std::string collapse_svg(const FitResult& jacobs, const FitResult& kinetic,
                         const std::string& name) {
  Picture picture(titled(name, "do the data collapse? Dose D above, dose analogue D′ below"),
                  "Cured height over dose and over the dose analogue of a kinetic fit. Where "
                  "reciprocity holds both look alike; else only the lower one is a single line.");
  bool first = true;
  std::vector<std::string> notes;
  for (const FitResult* fit : {&jacobs, &kinetic}) {
    const WorkingCurve w = working_curve_of(*fit);
    const Data data = data_of(*fit, false, false);
    const auto dose = [&](const FitPoint& p) { return w.dose(p); };
    std::vector<double> doses{w.gel_dose};
    for (const std::size_t i : data.points) doses.push_back(dose(fit->points[i]));
    const Axis x = axis_over(w.axis, true, doses);
    const Axis y = height_axis(*fit, data, "cured height, um");
    if (first) {
      data_legend(picture, data);
      picture.legend_line(Style::fit, "fit");
    }
    Panel panel(x, y, 250);
    panel.line(curve_of(*fit, w, x, data).line, Style::fit);
    const auto measured = [](const FitPoint& p) { return p.measured_um; };
    draw_points(panel, first ? &picture : nullptr, *fit, data, false, dose, measured);
    panel.dot({w.gel_dose, 0});
    picture.add(panel);
    notes.push_back(fmt::format("{}: h = {} um, {} = {} {}{}; R² {:.4f}, RMSE {} um",
                                w.jacobs ? "Jacobs (D)" : "Kinetic (D′)", figure(w.height_um),
                                w.jacobs ? "Dc" : "D′c", figure(w.gel_dose), w.unit,
                                w.jacobs ? "" : fmt::format(", m = {}", figure(w.m)), fit->r2,
                                figure(fit->rmse_um)));
    first = false;
  }
  for (const std::string& note : notes) picture.note(note);
  for (const FitResult* fit : {&kinetic, &jacobs}) {
    if (!fit->reciprocity) continue;
    picture.note(fit->reciprocity->verdict);
    break;
  }
  return picture.svg();
}

std::string dead_zone_svg(const FitResult& fit, const std::string& name) {
  if (!kind_of(fit.model).dead_zones) {
    throw InputError("a fit of cured heights has no dead zone; expected one of dead zones");
  }
  const bool steady = fit.model == FitModel::dead_zone_steady;
  // A steady dead zone depends on the ratio alone, others on intensity and time as well.
  const Data data = data_of(fit, true, !steady);
  const auto ratio = [](const FitPoint& p) { return p.uv_mw_cm2 / p.blue_mw_cm2; };
  const double beta = fit.value("beta");
  std::vector<double> ratios{1 / beta};
  for (const std::size_t i : data.points) ratios.push_back(ratio(fit.points[i]));
  const Axis x = axis_over("ratio of UV to blue intensity, Iuv/Ib", true, ratios);
  const Axis y = height_axis(fit, data, "dead zone, um");

  Picture picture(
      titled(name, fmt::format("dead zone, {} fit", steady                         ? "steady"
                                                    : fit.model == FitModel::joint ? "joint"
                                                                                   : "transient")),
      fmt::format(
          "Height of the dead zone over the ratio of UV to blue intensity: {} measurements, fit "
          "with its 95 % band, residuals.",
          data.points.size()));
  data_legend(picture, data);
  Panel panel(x, y, 300, false);
  panel.vertical(1 / beta, fmt::format("β Iuv = Ib at {}", figure(1 / beta)));
  const auto curve_at = [&](double blue, double exposure) {
    return curve_over(
        x, [&](double r) { return predict_um(fit, blue, r * blue, exposure); },
        [&](double r) { return confidence_um(fit, blue, r * blue, exposure); });
  };
  if (steady) {
    const FitPoint& any = fit.points[data.points.front()];
    const Curve c = curve_at(any.blue_mw_cm2, any.exposure_s);
    panel.band(c.low, c.high, Style::fit);
    panel.line(c.line, Style::fit);
    picture.legend_line(Style::fit, "fit");
    picture.legend_band(Style::fit, "95 % band of the curve");
  } else {
    std::size_t drawn = 0;
    for (const auto& [group, series] : data.series) {
      if (drawn++ == kMostLegends) break;
      const Curve c = curve_at(group.blue_mw_cm2, group.exposure_s);
      if (data.series.size() <= 3) panel.band(c.low, c.high, Style::series, series);
      panel.line(c.line, Style::series, series);
    }
    picture.legend_line(Style::series, "fits", 0);
    if (data.series.size() <= 3) picture.legend_band(Style::series, "95 % bands", 0);
  }
  const auto measured = [](const FitPoint& p) { return p.measured_um; };
  draw_points(panel, &picture, fit, data, !steady, ratio, measured);
  if (draw_scatter(panel, fit, data, !steady, ratio)) {
    picture.legend_bar("scatter of replicates, ± 1 s");
  }
  draw_rings(panel, fit, true, ratio, measured);
  picture.add(panel);
  picture.add(residual_panel(picture, x, fit, data, true, !steady, ratio));
  figures_notes(picture, fit);
  picture.note(
      fmt::format("Below a ratio of {} (β Iuv < Ib) the resin cures to the window in the long run.",
                  figure(1 / beta)));
  return picture.svg();
}

}  // namespace slicecorr::resins
