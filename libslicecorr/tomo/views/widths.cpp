// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/widths.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::tomo {

namespace {

constexpr std::array<const char*, 5> kWidthColumns{"x_mm", "y_mm", "z_mm", "along", "width_mm"};
/// Spread that is looked for, in voxels: up to so much, in such steps.
constexpr double kMostSpread = 4, kSpreadStep = 0.25;
constexpr int kSections = 14;

}  // namespace

std::vector<MeasuredWidth> read_widths(const std::string& path) {
  CsvReader table = CsvReader::of_file(path, {.comments_behind_cells = true});
  CsvRow row;
  const auto wrong = [&](const std::string& what) {
    throw InputError(
        path, table.place(),
        what + "; expected a table with the columns x_mm, y_mm, z_mm, along, width_mm");
  };
  if (!table.next(row)) wrong("is empty");
  std::array<std::size_t, kWidthColumns.size()> place{};
  for (std::size_t c = 0; c < kWidthColumns.size(); ++c) {
    const auto found = std::find(row.cells.begin(), row.cells.end(), kWidthColumns[c]);
    if (found == row.cells.end()) wrong(fmt::format("has no column '{}'", kWidthColumns[c]));
    place[c] = static_cast<std::size_t>(found - row.cells.begin());
  }
  std::vector<MeasuredWidth> widths;
  const std::size_t columns = row.cells.size();
  while (table.next(row)) {
    if (row.cells.size() != columns) wrong(fmt::format("has {} cells", row.cells.size()));
    MeasuredWidth w;
    const auto number = [&](std::size_t c) {
      const auto value = number_in_text(row.cells[place[c]]);
      if (!value || !(std::abs(*value) < 1e6)) {
        wrong(fmt::format("{} is '{}'", kWidthColumns[c], row.cells[place[c]]));
      }
      return *value;
    };
    for (std::size_t k = 0; k < 3; ++k) w.at_mm[k] = number(k);
    const std::string& along = row.cells[place[3]];
    if (along != "x" && along != "y" && along != "z") wrong("along is '" + along + "'");
    w.along = along[0] - 'x';
    w.width_mm = number(4);
    if (!(w.width_mm > 0)) wrong("width_mm is not above 0");
    widths.push_back(w);
  }
  if (widths.empty()) wrong("has no width");
  return widths;
}

double width_of(const Box<float>& dose, const Sampling& sampling, double gel_dose,
                const MeasuredWidth& where) {
  const std::array<int, 3> sizes{dose.nx, dose.ny, dose.nz};
  std::array<int, 3> voxel{};
  double along = 0;  // among the voxels of the axis
  for (std::size_t k = 0; k < 3; ++k) {
    const double middle = k == 2 ? sampling.middle_z_mm : 0;
    const double index = (where.at_mm[k] - middle) / sampling.voxel_mm + 0.5 * (sizes[k] - 1);
    if (!(index >= -0.5 && index < sizes[k] - 0.5)) {
      throw InputError(fmt::format("a width at {:g}, {:g}, {:g} mm; expected a place in the voxels",
                                   where.at_mm[0], where.at_mm[1], where.at_mm[2]));
    }
    voxel[k] = static_cast<int>(std::lround(index));
    if (static_cast<int>(k) == where.along) along = index;
  }
  const int n = sizes[static_cast<std::size_t>(where.along)];
  const auto at = [&](int i) {
    std::array<int, 3> v = voxel;
    v[static_cast<std::size_t>(where.along)] = i;
    return static_cast<double>(dose.values[dose.at(v[2], v[1], v[0])]);
  };
  const int start = std::clamp(static_cast<int>(std::lround(along)), 0, n - 1);
  if (!(at(start) >= gel_dose)) return 0;
  double ends = 0;
  for (const int step : {-1, 1}) {
    int i = start;
    while (i + step >= 0 && i + step < n && at(i + step) >= gel_dose) i += step;
    if (i + step < 0 || i + step >= n) return std::numeric_limits<double>::quiet_NaN();
    ends += std::abs(i - start) + (at(i) - gel_dose) / (at(i) - at(i + step));
  }
  return ends * sampling.voxel_mm;
}

DiffusionFit fit_diffusion(const TomoJob& job, const std::vector<MeasuredWidth>& widths,
                           const ExecutionContext& context) {
  if (widths.empty()) throw InputError("there is no width to fit");
  const double time_s = job.turns * job.printer.rotation->turn_s();
  const double gel = dose_to_gel_mj_cm3(job.resin);
  int tried = 0;
  struct Trial {
    double spread = 0, squares = 0;
    std::vector<double> widths_mm;
  };
  const auto diffusion_of = [&](double spread) {
    const double sigma_m = spread * job.sampling.voxel_mm * 1e-3;
    return sigma_m * sigma_m / (2 * time_s);
  };
  const auto attempt = [&](double spread) {
    TomoJob with = job;
    with.resin.dose_diffusion_m2_s = diffusion_of(spread);
    const Box<float> dose = dose_of(with, slicecorr::detail::silent(context));
    Trial t{spread, 0, {}};
    for (const MeasuredWidth& w : widths) {
      const double width = width_of(dose, job.sampling, gel, w);
      if (std::isnan(width)) {
        throw InputError(fmt::format(
            "what gels at {:g}, {:g}, {:g} mm reaches the last voxel along {}; expected a width "
            "that ends",
            w.at_mm[0], w.at_mm[1], w.at_mm[2], "xyz"[w.along]));
      }
      t.widths_mm.push_back(width);
      t.squares += (width - w.width_mm) * (width - w.width_mm);
    }
    context.report("trying", std::min(0.99, ++tried / (kMostSpread / kSpreadStep + kSections)));
    return t;
  };
  Trial best = attempt(0);
  if (std::all_of(best.widths_mm.begin(), best.widths_mm.end(), [](double w) { return w == 0; })) {
    throw InputError("nothing gels where widths were measured; expected places in the print");
  }
  const double n = static_cast<double>(widths.size());
  DiffusionFit fit;
  fit.without_rms_mm = std::sqrt(best.squares / n);
  for (double s = kSpreadStep; s <= kMostSpread * (1 + 1e-9); s += kSpreadStep) {
    Trial t = attempt(s);
    if (t.squares < best.squares) best = std::move(t);
  }
  fit.at_bound = best.spread > kMostSpread * (1 - 1e-9);
  constexpr double kGolden = 0.6180339887498949;
  double low = std::max(0.0, best.spread - kSpreadStep), high = best.spread + kSpreadStep;
  Trial left = attempt(high - kGolden * (high - low)),
        right = attempt(low + kGolden * (high - low));
  for (int i = 0; i < kSections; ++i) {
    if (left.squares <= right.squares) {
      high = right.spread;
      right = std::move(left);
      left = attempt(high - kGolden * (high - low));
    } else {
      low = left.spread;
      left = std::move(right);
      right = attempt(low + kGolden * (high - low));
    }
  }
  for (Trial* t : {&left, &right}) {
    if (t->squares < best.squares) best = std::move(*t);
  }
  fit.diffusion_m2_s = diffusion_of(best.spread);
  fit.spread_mm = best.spread * job.sampling.voxel_mm;
  fit.predicted_mm = std::move(best.widths_mm);
  fit.rms_mm = std::sqrt(best.squares / n);
  return fit;
}

std::string DiffusionFit::to_json(const std::vector<MeasuredWidth>& widths) const {
  nlohmann::ordered_json j;
  j["dose_diffusion_m2_s"] = diffusion_m2_s;
  j["spread_mm"] = spread_mm;
  j["rms_mm"] = rms_mm;
  j["without_rms_mm"] = without_rms_mm;
  j["at_bound"] = at_bound;
  auto& all = j["widths"] = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < widths.size(); ++k) {
    all.push_back({{"x_mm", widths[k].at_mm[0]},
                   {"y_mm", widths[k].at_mm[1]},
                   {"z_mm", widths[k].at_mm[2]},
                   {"along", std::string(1, "xyz"[widths[k].along])},
                   {"width_mm", widths[k].width_mm},
                   {"predicted_mm", predicted_mm[k]}});
  }
  return j.dump(2);
}

}  // namespace slicecorr::tomo
