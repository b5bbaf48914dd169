// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What to think of results, in words.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"

namespace slicecorr {

namespace {

/// Mean over the radius.
double mean_of(const RadialCurve& curve) {
  double sum = curve.value.front() * curve.r.front() + curve.value.back() * (1 - curve.r.back());
  for (std::size_t i = 1; i < curve.r.size(); ++i) {
    sum += 0.5 * (curve.r[i] - curve.r[i - 1]) * (curve.value[i] + curve.value[i - 1]);
  }
  return sum;
}

void remark_on_store(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                     const DiscLight& light, const DiscGrid& grid,
                     std::vector<std::string>& remarks) {
  FlowResin other = resin;
  other.inhibitor_life_s = std::numeric_limits<double>::infinity();
  const double kept = disc::march(other, print, gap_um, {light}, grid).front().front.value.front();
  other.inhibitor_life_s = 0;
  const double lost = disc::march(other, print, gap_um, {light}, grid).front().front.value.front();
  if (std::abs(kept - lost) > 0.1 * std::max(std::abs(kept), std::abs(lost))) {
    remarks.push_back(fmt::format(
        "the dose in the middle is {:.2f} when inhibitor lasts and {:.2f} when it fades at once "
        "(inhibitor_life_s)",
        kept, lost));
  }
}

}  // namespace

std::vector<std::string> disc_remarks(const FlowResin& resin, const DiscPrint& print,
                                      const RadialCurve& gap_um, const DiscLight& light,
                                      double limit_pa, const DiscGrid& grid) {
  disc::check_light(light);
  disc::check_grid(grid);
  const DiscSuction suction = disc_suction(resin, print, gap_um, limit_pa);
  std::vector<std::string> remarks;
  const double h = mean_of(gap_um), radius = 1e3 * print.radius_mm;
  if (h > 0.2 * 2 * radius) {
    remarks.push_back(
        fmt::format("the gap is {:.0f} % of the part's width; the flow is that of gaps below 20 %",
                    100 * h / (2 * radius)));
  }
  const double inside = std::max(0.0, 1 - h / radius);
  const double near = 1 - (print.shape == DiscShape::disc ? inside * inside : inside);
  if (near > 0.3) {
    remarks.push_back(fmt::format(
        "{:.0f} % of the area are nearer to the outline than the gap is thick, where the flow is "
        "not told",
        100 * near));
  }
  if (suction.fastest_mm_h < print.speed_mm_h) {
    remarks.push_back(
        fmt::format("the suction of {:.3g} bar is more than {:.3g} bar; at most {:.4g} mm/h",
                    suction.most_pa * 1e-5, limit_pa * 1e-5, suction.fastest_mm_h));
  }
  const double peclet = disc::um_s(print.speed_mm_h) * h / disc::um2_s(resin.diffusion_m2_s);
  if (std::isinf(resin.inhibitor_life_s) && peclet > 1000) {
    remarks.push_back(fmt::format(
        "with a Péclet number of {:.3g} and inhibitor that lasts, the dose in the middle falls "
        "without bound",
        peclet));
  }
  const DiscDose dose = disc_dose(resin, print, gap_um, light, grid);
  const double places = static_cast<double>(grid.levels) * grid.steps;
  if (static_cast<double>(dose.undone_places) > 0.01 * places) {
    remarks.push_back(fmt::format("dose is undone at {} of {:.0f} places, which can't be",
                                  dose.undone_places, places));
  }
  remark_on_store(resin, print, gap_um, light, grid, remarks);
  return remarks;
}

std::vector<std::string> disc_remarks(const DiscOptimum& optimum, const DiscGoal& goal) {
  std::vector<std::string> remarks;
  if (optimum.blue_at_cap) {
    remarks.push_back(
        fmt::format("blue light is at its cap of {:.4g} mW/cm²", goal.blue_most_mw_cm2));
  }
  if (optimum.uv_at_cap) {
    remarks.push_back(fmt::format("UV light is at its cap of {:.4g} mW/cm²", goal.uv_most_mw_cm2));
  }
  if (optimum.gap_at_limit) {
    remarks.push_back(fmt::format("the gap of {:.4g} um is at the limit of {:.4g} to {:.4g} um",
                                  optimum.gap_um, goal.least_gap_um, goal.largest_gap_um));
  }
  return remarks;
}

}  // namespace slicecorr
