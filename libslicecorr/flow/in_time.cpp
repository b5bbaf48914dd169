// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/in_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_march.hpp"

namespace slicecorr::detail {

void check_in_time(const InTime& how) {
  disc::check_positive(how.layer_um, "layer_um");
  disc::check_positive(how.first_gap_um, "first_gap_um");
  disc::check_positive(how.slope, "slope");
  disc::check_positive(how.level_um, "level_um");
  disc::check_positive(how.top_um, "top_um");
  const double levels = how.top_um / how.level_um;
  if (!(levels >= 4 && levels <= 2000)) {
    disc::refuse("level_um", fmt::format("is {}; expected 4 to 2000 levels below {} um",
                                         how.level_um, how.top_um));
  }
  if (how.slices < 1) disc::refuse("slices", fmt::format("is {}; expected 1 or more", how.slices));
}

SliceInTime look_at(const GapGrowth& growth, const std::vector<double>& distance_um,
                    double top_um) {
  SliceInTime s;
  s.seconds = growth.seconds();
  const double open_um = std::min(growth.platform_um(), top_um);
  double area = 0, furthest = 0, all_max = 0;
  s.min_um = std::numeric_limits<double>::infinity();
  s.window_dose = -s.min_um;
  for (std::size_t i = 0; i < distance_um.size(); ++i) {
    const double h = growth.gap_um()[i], weight = growth.plan().area_um2[i];
    if (!(distance_um[i] > 0)) continue;
    area += weight;
    s.mean_um += weight * h;
    s.min_um = std::min(s.min_um, h);
    all_max = std::max(all_max, h);
    if (distance_um[i] >= h) s.max_um = std::max(s.max_um, h);
    if (h >= open_um) s.void_share += weight;
    if (distance_um[i] > furthest * (1 + 1e-9)) {
      furthest = distance_um[i];
      s.middle_um = h;
    }
    s.window_dose = std::max(s.window_dose, growth.window_dose(i));
  }
  if (s.max_um <= 0) s.max_um = all_max;
  s.mean_um /= area;
  s.void_share /= area;
  s.least_dose = *std::min_element(growth.dose().begin(), growth.dose().end());
  return s;
}

void find_steady(PrintInTime& print) {
  constexpr std::size_t kLeastSlices = 5;
  if (print.sticks || print.slices.empty()) return;
  const SliceInTime& last = print.slices.back();
  const auto near = [](double value, double wanted) {
    return std::abs(value - wanted) <= 1 + 0.02 * wanted;
  };
  std::size_t from = print.slices.size();
  while (from > 0) {
    const SliceInTime& s = print.slices[from - 1];
    const bool same = near(s.min_um, last.min_um) && near(s.middle_um, last.middle_um) &&
                      std::abs(s.window_dose - last.window_dose) <= 0.02 &&
                      s.area_mm2 == last.area_mm2;
    if (!same) break;
    --from;
  }
  if (print.slices.size() - from < kLeastSlices) return;
  print.steady_from = print.slices[from].slice;
}

void AtRest::add(const GapGrowth& growth, double top_um, bool same) {
  // What is told of a slice is told to a tenth of a um, and to a thousandth.
  constexpr double kGapUm = 0.01, kDose = 1e-4;
  const std::size_t cells = growth.gap_um().size();
  bool still = same && gap_um_.size() == cells && growth.platform_um() > top_um;
  std::vector<double> window;
  for (std::size_t i = 0; i < cells; ++i) {
    window.push_back(growth.window_dose(i));
    still = still && std::abs(growth.gap_um()[i] - gap_um_[i]) < kGapUm &&
            std::abs(window[i] - window_[i]) < kDose;
  }
  still_ = still ? still_ + 1 : 0;
  gap_um_ = growth.gap_um();
  window_ = std::move(window);
}

}  // namespace slicecorr::detail
