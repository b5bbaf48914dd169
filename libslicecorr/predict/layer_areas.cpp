// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/layer_areas.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>

namespace slicecorr {

std::optional<AreaChange> LayerAreas::largest_change() const {
  std::uint64_t most = 0;
  std::size_t at = 0;
  for (std::size_t n = 1; n < lit_pixels.size(); ++n) {
    const std::uint64_t a = lit_pixels[n - 1], b = lit_pixels[n], change = a < b ? b - a : a - b;
    if (change <= most) continue;
    most = change;
    at = n;
  }
  if (most == 0) return std::nullopt;
  return AreaChange{static_cast<int>(at), heights.place_um(static_cast<double>(at), layer_um),
                    mm2(at - 1), mm2(at)};
}

std::optional<PeelForce> LayerAreas::largest_force() const {
  if (!(adhesion_kpa > 0) || lit_pixels.empty()) return std::nullopt;
  const auto most = std::max_element(lit_pixels.begin(), lit_pixels.end());
  if (*most == 0) return std::nullopt;
  const auto at = static_cast<std::size_t>(most - lit_pixels.begin());
  constexpr double n_of_kpa_mm2 = 1e-3;
  return PeelForce{static_cast<int>(at), heights.place_um(static_cast<double>(at), layer_um),
                   mm2(at), adhesion_kpa * mm2(at) * n_of_kpa_mm2};
}

std::string LayerAreas::in_words() const {
  std::string text;
  if (const auto c = largest_change()) {
    text += fmt::format(
        "  largest change of lit area: layer {}, at {:g} um, from {:.4g} to {:.4g} mm²\n", c->layer,
        c->um, c->from_mm2, c->to_mm2);
  }
  if (const auto f = largest_force()) {
    text += fmt::format(
        "  largest peel force: {:.4g} N in layer {}, at {:g} um ({:.4g} mm² at {:g} kPa)", f->n,
        f->layer, f->um, f->mm2, adhesion_kpa);
    constexpr double pa_of_kpa = 1e3;
    if (limit_pa > 0 && adhesion_kpa * pa_of_kpa > limit_pa) {
      text += fmt::format(
          "; more per area than the {:g} Pa that the printer bears (suction_limit_pa)", limit_pa);
    }
    text += "\n";
  }
  return text;
}

std::string LayerAreas::to_json() const {
  nlohmann::ordered_json j;
  j["largest_area_change"] = nullptr;
  if (const auto c = largest_change()) {
    j["largest_area_change"] = {{"layer", c->layer},
                                {"um", c->um},
                                {"mm2", c->mm2()},
                                {"from_mm2", c->from_mm2},
                                {"to_mm2", c->to_mm2}};
  }
  if (const auto f = largest_force()) {
    j["largest_peel_force"] = {{"layer", f->layer}, {"um", f->um}, {"mm2", f->mm2}, {"n", f->n}};
  }
  return j.dump(2);
}

LayerAreas areas_of(const Grid& grid, const Printer* printer) {
  LayerAreas areas;
  areas.layer_um = grid.layer_um;
  areas.pixel_mm2 = grid.pixel_x_um * grid.pixel_y_um * 1e-6;
  areas.lit_pixels.assign(static_cast<std::size_t>(grid.layers), 0);
  if (printer != nullptr) {
    areas.adhesion_kpa = printer->adhesion_kpa;
    areas.limit_pa = printer->suction_limit_pa;
  }
  return areas;
}

LayerAreas lit_areas(const SliceSource& slices, const Printer* printer,
                     const ExecutionContext& context) {
  const Grid& grid = slices.grid();
  LayerAreas areas = areas_of(grid, printer);
  const PixelBox box = slices.bounds();
  if (box.empty()) return areas;
  const int rows = band_rows(grid), first = box.y0 / rows;
  std::mutex adding;
  parallel_for(context, "areas", static_cast<std::size_t>((box.y1 - 1) / rows - first + 1),
               [&](std::size_t i) {
                 const int y0 = (first + static_cast<int>(i)) * rows;
                 const PixelBox band{box.x0, y0, box.x1, std::min(y0 + rows, grid.height_px)};
                 const std::size_t columns = static_cast<std::size_t>(band.width()) *
                                             static_cast<std::size_t>(band.height());
                 std::vector<std::uint64_t> lit(areas.lit_pixels.size());
                 slices.read_band(band, [&](int n, const std::uint8_t* pixels) {
                   lit[static_cast<std::size_t>(n)] = count_lit(pixels, columns);
                 });
                 const std::lock_guard lock(adding);
                 for (std::size_t n = 0; n < lit.size(); ++n) areas.lit_pixels[n] += lit[n];
               });
  return areas;
}

}  // namespace slicecorr
