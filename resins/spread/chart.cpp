// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A fit of spread as a picture.
#include "support/chart/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "fit/figure_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/spread_fit.hpp"

namespace slicecorr::resins {

namespace {

using chart::axis_over;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;

/// Told where there are several, or where it is not the window.
std::string depth_words(const SpreadFit& fit, double depth_um) {
  const bool all_at_window = std::all_of(fit.residuals.begin(), fit.residuals.end(),
                                         [](const SpreadResidual& r) { return r.depth_um == 0; });
  if (all_at_window || !std::isfinite(depth_um)) return {};
  return fmt::format(", {:g} um deep", depth_um);
}

/// An axis about 0 as far as a round value, so that it is labelled.
chart::Axis axis_about_0(const std::string& title, const std::vector<double>& values) {
  double most = 0;
  for (const double v : values) most = std::max(most, std::abs(v));
  const double ten = most > 0 ? std::pow(10, std::floor(std::log10(most))) : 1;
  double round = ten;
  for (const double times : {2.0, 5.0, 10.0}) {
    if (round < most) round = times * ten;
  }
  return axis_over(title, false, {-round, round});
}

/// Measured and found by what was designed; what is left below.
void draw_widths(const SpreadFit& fit, Picture& picture) {
  struct Series {
    std::vector<Point> found;
    int number = 0;
  };
  std::map<std::pair<double, WidthKind>, Series> all;
  std::vector<double> designed, printed, off;
  double narrowest = std::numeric_limits<double>::infinity(), widest = 0;
  for (const SpreadResidual& r : fit.residuals) {
    all[{r.depth_um, r.kind}];
    designed.push_back(r.designed_um);
    printed.insert(printed.end(), {r.measured, std::max(0.0, r.found)});
    narrowest = std::min(narrowest, r.designed_um);
    widest = std::max(widest, r.designed_um);
    if (!r.left_out) off.insert(off.end(), {r.measured - r.found, r.found - r.measured});
  }
  int number = 0;
  for (auto& [key, s] : all) s.number = number++ % 6;
  Panel widths(axis_over("designed width, um", false, designed, true),
               axis_over("printed width, um", false, printed, true), 320, false);
  widths.line({{0, 0}, {widest, widest}}, Style::reference);
  Panel rest(axis_over("designed width, um", false, designed, true),
             axis_about_0("measured less found, um", off), 200);
  rest.horizontal(0, "");
  const double most = off.empty() ? 1 : *std::max_element(off.begin(), off.end());
  for (const SpreadResidual& r : fit.residuals) {
    Series& s = all.at({r.depth_um, r.kind});
    s.found.push_back({r.designed_um, std::max(0.0, r.found)});
    const Point at{r.designed_um, r.measured};
    const std::string words = fmt::format("line {}: {:g} um measured, {:.1f} um found", r.line,
                                          r.measured, std::max(0.0, r.found));
    widths.point(at, s.number, words);
    const bool outlier = r.left_out && r.measured > 0;
    if (outlier) widths.ring(at, fmt::format("line {}", r.line));
    if (r.left_out && !outlier) continue;
    const Point left{r.designed_um, std::clamp(r.measured - r.found, -most, most)};
    rest.point(left, s.number, words);
    if (outlier) rest.ring(left, fmt::format("line {}: {:.1f}", r.line, r.measured - r.found));
  }
  for (auto& [key, s] : all) {
    std::stable_sort(s.found.begin(), s.found.end(),
                     [](const Point& a, const Point& b) { return a.x < b.x; });
    // Where widths were repeated, the fit says the same.
    widths.line(s.found, Style::series, s.number);
    picture.legend_point(s.number,
                         fmt::format("{}{}", key.second == WidthKind::gap ? "gaps" : "lines",
                                     depth_words(fit, key.first)));
  }
  picture.legend_line(Style::reference, "printed as designed");
  picture.add(widths);
  picture.add(rest);
}

/// Light by the distance from the edge; what is left below.
void draw_edges(const SpreadFit& fit, Picture& picture) {
  std::map<std::size_t, std::vector<const SpreadResidual*>> edges;
  double reach = 0;
  for (const SpreadGaussian& g : fit.spread().gaussians) reach = std::max(reach, 5 * g.sigma_um);
  double deepest = 0;
  for (const SpreadResidual& r : fit.residuals) deepest = std::max(deepest, r.depth_um);
  reach = std::max(
      reach, 5 * std::sqrt(std::pow(reach / 5, 2) +
                           std::max(0.0, fit.parameter("scatter_um2_per_um").value) * deepest));
  std::vector<double> at, light{0, 1}, off;
  for (const SpreadResidual& r : fit.residuals) {
    if (std::abs(r.at_um) > reach) continue;
    edges[r.edge].push_back(&r);
    at.push_back(r.at_um);
    light.push_back(r.measured);
    if (!r.left_out)
      off.insert(off.end(), {100 * (r.measured - r.found), 100 * (r.found - r.measured)});
  }
  if (off.empty()) throw InputError(fit.source, "", "has no places to draw");
  const double most = *std::max_element(off.begin(), off.end());
  Panel steps(axis_over("from the edge, um", false, at),
              axis_over("light, of the step", false, light), 320, false);
  Panel rest(axis_over("from the edge, um", false, at), axis_about_0("measured less found, %", off),
             200);
  rest.horizontal(0, "");
  for (const auto& [edge, all] : edges) {
    const int number = static_cast<int>(edge % 6);
    std::vector<Point> found;
    // Pictures have more places than can be told apart.
    constexpr std::size_t shown = 400;
    const std::size_t stride = all.size() / shown + 1;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const SpreadResidual& r = *all[i];
      found.push_back({r.at_um, r.found});
      if (i % stride != 0 && !r.left_out) continue;
      const std::string words = fmt::format("{:.1f} um: {:.3f}", r.at_um, r.measured);
      const Point left{r.at_um, std::clamp(100 * (r.measured - r.found), -most, most)};
      steps.point({r.at_um, r.measured}, number, words);
      rest.point(left, number, words);
      if (!r.left_out) continue;
      steps.ring({r.at_um, r.measured}, fmt::format("line {}", r.line));
      rest.ring(left, fmt::format("line {}: {:.0f} %", r.line, 100 * (r.measured - r.found)));
    }
    steps.line(found, Style::fit);
    if (edge < 6) {
      picture.legend_point(number,
                           fmt::format("edge {}{}", edge + 1, depth_words(fit, all[0]->depth_um)));
    }
  }
  picture.legend_line(Style::fit, "found");
  picture.add(steps);
  picture.add(rest);
}

}  // namespace

std::string spread_fit_svg(const SpreadFit& fit) {
  Picture picture(
      fit.of_widths ? "Printed widths, measured and found" : "Knife edges, measured and found",
      fit.of_widths ? "Printed by designed width of lines and gaps, and what a fit of "
                      "spread leaves of them"
                    : "Light by the distance from an edge, and what a fit of spread "
                      "leaves of it");
  if (fit.of_widths) {
    draw_widths(fit, picture);
  } else {
    draw_edges(fit, picture);
  }
  if (std::any_of(fit.residuals.begin(), fit.residuals.end(),
                  [](const SpreadResidual& r) { return r.left_out && r.measured > 0; })) {
    picture.legend_ring("left out");
  }
  for (const SpreadParameter& p : fit.parameters) {
    if (!p.fitted) continue;
    picture.note(fmt::format(
        "{} = {} {} (95 %: {} to {})", p.name, resins::figure(p.value, p.standard_error), p.unit,
        resins::figure(p.ci95[0], p.standard_error), resins::figure(p.ci95[1], p.standard_error)));
  }
  return picture.svg();
}

}  // namespace slicecorr::resins
