// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/report.hpp"

namespace slicecorr {

namespace {

constexpr double kWidth = 860, kHeight = 300, kRoomLeft = 56, kRoomRight = 56, kRoomTop = 34,
                 kRoomBottom = 44;

/// A round step that divides `range` into four to nine.
double round_step(double range) {
  const double power = std::pow(10.0, std::floor(std::log10(range / 4)));
  for (const double factor : {1.0, 2.0, 2.5, 5.0, 10.0}) {
    if (range / (power * factor) <= 9) return power * factor;
  }
  return power * 10;
}

/// Dose at t of the way from the upper to the lower end of a layer whose logarithm is linear
/// between its ends and its middle: layer by layer that is exact.
double dose_inside(const ProbeRow& row, double t) {
  const auto between = [](double p, double q, double u) {
    return p > 0 && q > 0 ? p * std::pow(q / p, u) : p + u * (q - p);
  };
  return t < 0.5 ? between(row.dose, row.dose_middle, 2 * t)
                 : between(row.dose_middle, row.dose_lower, 2 * t - 1);
}

}  // namespace

std::string column_svg(const std::vector<ProbeRow>& column, const CureModel& model,
                       const std::string& title, double least_top_dose, std::size_t slices) {
  if (column.empty()) return {};
  const auto place = [&](double zeta) { return model.heights.place_um(zeta, model.layer_um); };
  const double z_last = place(static_cast<double>(column.size()));
  const double z_end = place(static_cast<double>(std::max(column.size(), slices)));
  double dose_top = 1.08 * std::max(least_top_dose, 1.1);
  int grey_top = 1;
  for (const ProbeRow& r : column) {
    dose_top = std::max({dose_top, r.dose * 1.08, r.dose_lower * 1.08});
    grey_top = std::max(grey_top, r.grey);
  }
  const double x_scale = (kWidth - kRoomLeft - kRoomRight) / z_end;
  const double floor_y = kHeight - kRoomBottom;
  const auto x = [&](double z) { return kRoomLeft + z * x_scale; };
  const auto y = [&](double dose) { return floor_y - dose / dose_top * (floor_y - kRoomTop); };
  const auto y_grey = [&](double g) { return floor_y - g / grey_top * (floor_y - kRoomTop); };

  std::string svg = fmt::format(
      R"(<svg viewBox="0 0 {} {}" role="img" aria-label="{}" class="plot"><text x="{}" y="18" class="h">{}</text>)",
      kWidth, kHeight, title, kRoomLeft, title);
  // The design: full layers shaded, grey ones paler.
  for (std::size_t n = 0; n < column.size();) {
    std::size_t end = n;
    while (end < column.size() && column[end].target == column[n].target) ++end;
    if (column[n].target > 0) {
      svg += fmt::format(
          R"(<rect class="design" x="{:.2f}" y="{:.2f}" width="{:.2f}" height="{:.2f}" fill-opacity="{:.2f}"/>)",
          x(place(static_cast<double>(n))), kRoomTop,
          (place(static_cast<double>(end)) - place(static_cast<double>(n))) * x_scale,
          floor_y - kRoomTop, 0.35 * column[n].target);
    }
    n = end;
  }
  for (double z = 0, step = round_step(z_end); z <= z_end * 1.0001; z += step) {
    svg += fmt::format(R"(<text x="{:.2f}" y="{}" class="tick" text-anchor="middle">{:g}</text>)",
                       x(z), floor_y + 16, z);
  }
  for (double d = 0, step = round_step(dose_top); d <= dose_top; d += step) {
    svg += fmt::format(R"(<text x="{}" y="{:.2f}" class="tick" text-anchor="end">{:g}</text>)",
                       kRoomLeft - 6, y(d) + 4, d);
  }
  for (const int g : {0, grey_top}) {
    svg += fmt::format(R"(<text x="{}" y="{:.2f}" class="tick grey">{}</text>)",
                       kWidth - kRoomRight + 6, y_grey(g) + 4, g);
  }
  svg += fmt::format(
      R"(<text x="{}" y="{}" class="tick" text-anchor="middle">z from the platform, um</text>)"
      R"x(<text x="14" y="{}" class="tick" transform="rotate(-90 14 {})" text-anchor="middle">dose / critical dose</text>)x"
      R"x(<text x="{}" y="{}" class="tick grey" transform="rotate(-90 {} {})" text-anchor="middle">grey level</text>)x",
      (kRoomLeft + kWidth - kRoomRight) / 2, kHeight - 8, kHeight / 2, kHeight / 2, kWidth - 8,
      kHeight / 2, kWidth - 8, kHeight / 2);
  svg += fmt::format(R"(<line class="gel" x1="{}" x2="{}" y1="{:.2f}" y2="{:.2f}"/>)", kRoomLeft,
                     kWidth - kRoomRight, y(1), y(1));
  std::string steps = fmt::format("M{:.2f} {:.2f}", x(0), y_grey(column[0].grey));
  std::string curve;
  // Enough points that the exact curve looks smooth, and no more than the plot has pixels for.
  const int inside = std::clamp(static_cast<int>(2000 / column.size()), 1, 8);
  for (std::size_t n = 0; n < column.size(); ++n) {
    const double z = place(static_cast<double>(n));
    const double high_um = model.height(static_cast<int>(n)) * model.layer_um;
    if (n && column[n].grey != column[n - 1].grey) {
      steps += fmt::format("H{:.2f}V{:.2f}", x(z), y_grey(column[n].grey));
    }
    const double below = n + 1 < column.size() ? column[n + 1].dose : 0.0;
    // Layer by layer the dose jumps at nodes: both ends of a layer are drawn.
    const bool both_ends = !model.is_plain();
    for (int i = 0; i < inside + both_ends; ++i) {
      const double t = static_cast<double>(i) / inside;
      const double dose =
          both_ends ? dose_inside(column[n], t)
                    : column[n].phi + (below - column[n].phi) * std::pow(model.a, 1.0 - t);
      curve +=
          fmt::format("{}{:.2f} {:.2f}", curve.empty() ? "M" : "L", x(z + t * high_um), y(dose));
    }
  }
  curve += fmt::format("L{:.2f} {:.2f}", x(z_last), y(0));
  steps += fmt::format("H{:.2f}", x(z_last));
  svg +=
      fmt::format(R"(<path class="steps" d="{}"/><path class="dose" d="{}"/></svg>)", steps, curve);
  return svg;
}

}  // namespace slicecorr
