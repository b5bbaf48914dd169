// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What happens under each slice of a part, and under the platform.

#include <algorithm>
#include <cmath>
#include <map>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_suction.hpp"

namespace slicecorr {

namespace {

void measure_outline(const FlowSection& section, double gap_um, SliceFlow& flow) {
  // What is too narrow to be solved has no inside.
  const std::vector<double> distance_um =
      flow.bound ? std::vector<double>(section.size(), 0.0) : outline_distance_um(section);
  std::size_t cells = 0, near = 0;
  for (std::size_t k = 0; k < section.size(); ++k) {
    if (section.cells[k] != FlowCell::part) continue;
    ++cells;
    near += distance_um[k] < gap_um ? 1 : 0;
    flow.width_um = std::max(flow.width_um, 2 * distance_um[k]);
  }
  flow.area_mm2 = static_cast<double>(cells) * section.cell_um2() * 1e-6;
  flow.near_outline = cells > 0 ? static_cast<double>(near) / static_cast<double>(cells) : 0;
}

SliceFlow flow_of(const FlowPart& part, std::size_t mask, const FlowPull& pull,
                  const ExecutionContext& context) {
  SliceFlow flow;
  flow.mask = mask;
  const MaskPhi phi = mask_phi(part, mask, context);
  const auto [x_mm, y_mm] = part.grid().place_mm(phi.cell);
  flow.x_mm = x_mm;
  flow.y_mm = y_mm;
  flow.bound = phi.bound;
  flow.suction_pa = suction_pa(phi.max_phi_um2, pull.viscosity_pa_s, pull.speed_mm_h, pull.gap_um);
  flow.force_n =
      suction_force_n(phi.integral_um4, pull.viscosity_pa_s, pull.speed_mm_h, pull.gap_um);
  flow.speed_limit_mm_h =
      suction_speed_limit_mm_h(phi.max_phi_um2, pull.viscosity_pa_s, pull.gap_um, pull.limit_pa);
  const FlowSection section = part.section(mask);
  measure_outline(section, pull.gap_um, flow);
  if (!pull.light || phi.bound) return flow;
  const GapPressure pressure = solve_pressure(section, context);
  const double blue = pull.light->blue_mw_cm2, uv = pull.light->uv_mw_cm2;
  const SectionSweep sweep(section, pressure, *pull.resin, pull.speed_mm_h, {&pull.gap_um, 1});
  flow.dose = summarise(section, sweep.dose({&blue, 1}, {&uv, 1}));
  if (!pull.dead_zone) return flow;
  const DeadZoneRange zone =
      dead_zone_under(section, *pull.resin, pull.speed_mm_h, pull.gap_um, *pull.light, context);
  flow.dead_zone_min_um = zone.min_um;
  flow.dead_zone_max_um = zone.max_um;
  flow.zone_at_rest = zone.at_rest;
  flow.zone_window = zone.max_window;
  return flow;
}

/// Cells of the platform with the gap under each, in um; cells beside the part have `beside_um`.
std::vector<double> platform_gaps(const FlowPart& part, const FlowSection& platform, int slice,
                                  double gap_um, double beside_um) {
  const FlowGrid& grid = part.grid();
  const int mask = part.mask_of(slice);
  const FlowSection section =
      mask >= 0 ? part.section(static_cast<std::size_t>(mask)) : FlowSection{};
  const double left_um = (grid.image_width_um - platform.width * platform.pitch_x_um) / 2;
  const double top_um = (grid.image_height_um - platform.height * platform.pitch_y_um) / 2;
  const int finer = std::max(1, static_cast<int>(std::lround(platform.pitch_x_um / grid.pitch_um)));
  std::vector<double> gaps(platform.size());
  for (int y = 0; y < platform.height; ++y) {
    for (int x = 0; x < platform.width; ++x) {
      double cubes = 0;
      for (int k = 0; k < finer * finer; ++k) {
        const int row = k / finer, column = k % finer;
        const double px = left_um + (x + (column + 0.5) / finer) * platform.pitch_x_um;
        const double py = top_um + (y + (row + 0.5) / finer) * platform.pitch_y_um;
        const double cx = std::floor((px - grid.left_um) / grid.pitch_um);
        const double cy = std::floor((py - grid.top_um) / grid.pitch_um);
        const bool inside =
            mask >= 0 && cx >= 0 && cy >= 0 && cx < section.width && cy < section.height;
        const bool under_part =
            inside && section.cells[section.index(static_cast<int>(cx), static_cast<int>(cy))] ==
                          FlowCell::part;
        const double gap = under_part ? gap_um : beside_um;
        cubes += gap * gap * gap;
      }
      gaps[platform.index(x, y)] = std::cbrt(cubes / (finer * finer));
    }
  }
  return gaps;
}

}  // namespace

std::vector<SliceFlow> part_flow(const FlowPart& part, const FlowPull& pull,
                                 const ExecutionContext& context) {
  if (pull.light && !pull.resin) throw InputError("light without a resin; expected both");
  std::vector<int> slices;
  for (int n = 0; n < part.slices(); n += pull.every) slices.push_back(n);
  if (!slices.empty() && slices.back() != part.slices() - 1) slices.push_back(part.slices() - 1);
  std::map<std::size_t, std::size_t> place_of;
  std::vector<std::size_t> masks;
  for (const int n : slices) {
    if (part.mask_of(n) < 0) continue;
    const auto mask = static_cast<std::size_t>(part.mask_of(n));
    if (place_of.try_emplace(mask, masks.size()).second) masks.push_back(mask);
  }
  std::vector<SliceFlow> of_masks(masks.size());
  ExecutionContext inner = detail::silent(context);
  inner.threads = 1;
  parallel_for(context, "solve flow", masks.size(),
               [&](std::size_t i) { of_masks[i] = flow_of(part, masks[i], pull, inner); });
  std::vector<SliceFlow> all;
  for (const int n : slices) {
    if (part.mask_of(n) < 0) continue;
    all.push_back(of_masks[place_of.at(static_cast<std::size_t>(part.mask_of(n)))]);
    all.back().slice = n;
  }
  return all;
}

PlatformFlow platform_flow(const FlowPart& part, const FlowPull& pull, double width_mm,
                           double height_mm, const ExecutionContext& context) {
  const double width_um = width_mm * 1e3, height_um = height_mm * 1e3;
  PlatformFlow flow;
  flow.width_mm = width_mm;
  flow.height_mm = height_mm;
  const double mean_um2 = flow_shapes::rectangle_mean_phi_um2(width_um, height_um);
  const double platform_um4 = mean_um2 * width_um * height_um;
  const MaskPhi first = part.masks() > 0 ? mask_phi(part, 0, context) : MaskPhi{};
  if (first.integral_um4 > 0) {
    flow.changeover_um = pull.gap_um * std::cbrt(platform_um4 / first.integral_um4);
  }
  flow.changeover_slice =
      std::clamp(static_cast<int>(std::ceil((flow.changeover_um - pull.gap_um) / part.layer_um())),
                 0, std::max(0, part.slices() - 1));
  // Suction under the whole platform is smooth: coarse cells will do.
  constexpr double kMostCells = 128;
  const double finest_um = std::max(width_um, height_um) / kMostCells;
  const double pitch_um =
      std::max(1.0, std::ceil(finest_um / part.grid().pitch_um)) * part.grid().pitch_um;
  FlowSection platform;
  platform.width = std::max(3, static_cast<int>(std::lround(width_um / pitch_um)));
  platform.height = std::max(3, static_cast<int>(std::lround(height_um / pitch_um)));
  platform.pitch_x_um = width_um / platform.width;
  platform.pitch_y_um = height_um / platform.height;
  platform.cells.assign(platform.size(), FlowCell::part);
  constexpr int kMostSlices = 8;
  const int step = std::max(1, (flow.changeover_slice + kMostSlices - 1) / kMostSlices);
  std::vector<int> slices;
  for (int n = 0; n < flow.changeover_slice; n += step) slices.push_back(n);
  slices.push_back(flow.changeover_slice);
  flow.slices.resize(slices.size());
  ExecutionContext inner = detail::silent(context);
  inner.threads = 1;
  parallel_for(context, "platform", slices.size(), [&](std::size_t i) {
    const int n = slices[i];
    const std::vector<double> gaps =
        platform_gaps(part, platform, n, pull.gap_um, pull.gap_um + n * part.layer_um());
    const GapPressure p = solve_pressure(platform, gaps, pull.gap_um, inner);
    flow.slices[i] = {
        n, suction_pa(p.max_phi_um2, pull.viscosity_pa_s, pull.speed_mm_h, pull.gap_um),
        suction_force_n(p.integral_um4, pull.viscosity_pa_s, pull.speed_mm_h, pull.gap_um),
        suction_speed_limit_mm_h(p.max_phi_um2, pull.viscosity_pa_s, pull.gap_um, pull.limit_pa)};
  });
  return flow;
}

}  // namespace slicecorr
