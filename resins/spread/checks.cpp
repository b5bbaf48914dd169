// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "spread/checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "fit/statistics.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/repeated_rows.hpp"

namespace slicecorr::resins {

namespace {

/// No light of a display is as narrow, and no scan of an edge as short.
constexpr double kLeastUm = 2;

std::string in_words(const PrintedWidth& w) {
  return fmt::format("a {} of {:g} um", w.kind == WidthKind::gap ? "gap" : "line", w.designed_um);
}

struct Mean {
  double sum = 0, squares = 0, n = 0;
  void add(double v) {
    sum += v;
    squares += v * v;
    ++n;
  }
  double mean() const { return sum / n; }
  /// Whether it is above 0 by more than chance.
  bool clearly_above_0() const {
    if (n < 3 || sum <= 0) return false;
    const double variance = std::max(0.0, squares / n - mean() * mean()) * n / (n - 1);
    constexpr double errors = 3;
    return mean() > errors * std::sqrt(variance / n);
  }
};

}  // namespace

std::vector<WidthProblem::Row> rows_of(const SpreadMeasurements& measured,
                                       const SpreadFitOptions& o) {
  const std::vector<double> levels =
      o.printer ? level_intensities(*o.printer) : std::vector<double>();
  std::vector<WidthProblem::Row> rows;
  bool depths = false;
  for (std::size_t i = 0; i < measured.widths.size(); ++i) {
    const PrintedWidth& w = measured.widths[i];
    const auto fail = [&](const std::string& message) {
      throw InputError(measured.source, fmt::format("line {}", w.line), message);
    };
    WidthProblem::Row r;
    r.index = i;
    r.designed_um = w.designed_um;
    r.printed_um = w.printed_um;
    r.error_um = w.error_um;
    r.exposure.gap = w.kind == WidthKind::gap;
    r.exposure.moving = o.moving;
    r.exposure.light = w.light;
    if (!std::isnan(w.level)) {
      if (levels.empty())
        fail("has a grey level; expected --printer, whose calibration says its light");
      const double last = static_cast<double>(levels.size()) - 1;
      if (w.level != std::floor(w.level) || w.level > last) {
        fail(
            fmt::format("has level {:g}; expected a whole number up to {:g}, as the printer has "
                        "them",
                        w.level, last));
      }
      r.exposure.light = levels[static_cast<std::size_t>(w.level)] / levels.back();
    }
    if (o.resin) {
      r.exposure.m = o.resin->m;
      r.exposure.height_e_um = o.resin->absorbance_height10_um / std::numbers::ln10;
    }
    const double nowhere = o.moving ? std::numeric_limits<double>::infinity() : 0;
    r.exposure.depth_um = std::isnan(w.depth_um) ? nowhere : w.depth_um;
    depths = depths || r.exposure.depth_um != (rows.empty() ? r : rows[0]).exposure.depth_um;
    rows.push_back(r);
  }
  const bool scatter = o.free.count("scatter_um2_per_um") > 0;
  if (!o.resin && (depths || (o.moving && scatter))) {
    throw InputError(measured.source, "",
                     "has widths of several depths; expected --resin, whose absorbance height says "
                     "how light falls between them");
  }
  return rows;
}

std::string repeats_of(const SpreadMeasurements& measured) {
  std::vector<std::vector<double>> rows;
  for (const PrintedWidth& w : measured.widths) {
    rows.push_back({w.kind == WidthKind::gap ? 1.0 : 0.0, w.designed_um, w.printed_um, w.depth_um,
                    w.level, w.light});
  }
  for (const KnifeEdge& e : measured.edges) {
    for (const EdgeSample& at : e.samples) rows.push_back({e.depth_um, at.at_um, at.intensity});
  }
  return repeats_in_words(std::move(rows));
}

void check_widths(const SpreadMeasurements& measured, const std::vector<WidthProblem::Row>& rows,
                  const SpreadFitOptions& o) {
  double widest = 0;
  for (const PrintedWidth& w : measured.widths) widest = std::max(widest, w.designed_um);
  if (widest < kLeastUm) {
    throw InputError(measured.source, "",
                     fmt::format("the widest line or gap is {:g} um; expected micrometres, these "
                                 "look like millimetres",
                                 widest));
  }
  const double pixel_um = o.printer ? std::min(o.printer->pixel_x_um, o.printer->pixel_y_um) : 0;
  for (const PrintedWidth& w : measured.widths) {
    const std::string place = fmt::format("line {}", w.line);
    if (!(std::isfinite(w.designed_um) && w.designed_um > 0 && std::isfinite(w.printed_um) &&
          w.printed_um >= 0)) {
      throw InputError(measured.source, place,
                       "expected designed_um above 0 and printed_um of 0 or more");
    }
    // A sub-pixel line can't be shown.
    if (w.designed_um < 0.2 * pixel_um) {
      throw InputError(
          measured.source, place,
          fmt::format("designed_um is {:g}, less than a fifth of the printer's pixel of "
                      "{:g} um; expected micrometres",
                      w.designed_um, pixel_um));
    }
    if (w.printed_um > 0 &&
        (w.printed_um < w.designed_um / 200 || w.printed_um > w.designed_um * 200)) {
      throw InputError(
          measured.source, place,
          fmt::format("printed_um is {:g} of {}; expected micrometres in both columns, "
                      "and 0 where nothing is left",
                      w.printed_um, in_words(w)));
    }
  }
  // Where light makes lines wider than designed it makes gaps narrower.
  std::map<std::pair<double, double>, std::array<Mean, 2>> wider;
  for (const auto& r : rows) {
    if (r.printed_um == 0) continue;
    wider[{r.exposure.depth_um, r.exposure.light}][r.exposure.gap ? 1 : 0].add(r.printed_um -
                                                                               r.designed_um);
  }
  for (const auto& [exposure, means] : wider) {
    if (!means[0].clearly_above_0() || !means[1].clearly_above_0()) continue;
    throw InputError(
        measured.source, "",
        fmt::format("lines are {:.1f} um and gaps {:.1f} um wider than designed, though an edge of "
                    "light moves one way only; expected gaps measured where they are open, and "
                    "designed_um at the window",
                    means[0].mean(), means[1].mean()));
  }
}

void check_edges(const SpreadMeasurements& measured) {
  for (const KnifeEdge& e : measured.edges) {
    constexpr std::size_t least = 5;
    if (e.samples.size() < least) {
      throw InputError(e.source, "",
                       fmt::format("has {} places of an edge; expected at least {}, better thirty",
                                   e.samples.size(), least));
    }
    const double range = e.samples.back().at_um - e.samples.front().at_um;
    if (range < kLeastUm) {
      throw InputError(
          e.source, "",
          fmt::format("an edge's places are {:g} um apart in all; expected micrometres, "
                      "these look like millimetres",
                      range));
    }
    // Of the ends; one of them may hold a place that is off.
    const std::size_t n = e.samples.size(), end = std::max<std::size_t>(1, n / 8);
    std::vector<double> first, last, off;
    for (std::size_t i = 0; i < end; ++i) {
      first.push_back(e.samples[i].intensity);
      last.push_back(e.samples[n - 1 - i].intensity);
    }
    const double low = median(first), high = median(last);
    for (const double v : first) off.push_back(std::abs(v - low));
    for (const double v : last) off.push_back(std::abs(v - high));
    const double scatter = median(off);
    if (!(std::abs(high - low) > 4 * scatter) || high == low) {
      throw InputError(e.source, e.samples[0].line ? fmt::format("line {}", e.samples[0].line) : "",
                       fmt::format("shows no edge: {:.3g} at one end, {:.3g} at the other, which "
                                   "scatter by {:.2g}; expected even light on both sides of it",
                                   low, high, scatter));
    }
  }
}

void check_reach(const SpreadFit& fit, const SpreadFitOptions& o) {
  if (!o.printer) return;
  const double shorter = std::min(o.printer->width_px * o.printer->pixel_x_um,
                                  o.printer->height_px * o.printer->pixel_y_um);
  for (const SpreadGaussian& g : fit.spread().gaussians) {
    if (kSpreadReachSigmas * g.sigma_um <= shorter) continue;
    throw InputError(
        fit.source, "",
        fmt::format("with a sigma of {:.4g} um light reaches further than the display's shorter "
                    "side, {:g} um; expected places in micrometres, and the edge magnified",
                    g.sigma_um, shorter));
  }
}

}  // namespace slicecorr::resins
