// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/bench.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/turbidity.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/blurred_projector.hpp"
#include "tomo/operators/rays.hpp"
#include "tomo/operators/search_projector.hpp"
#include "tomo/operators/square_projector.hpp"
#include "tomo/operators/traced_light.hpp"
#include "tomo/print/traced_bench.hpp"

namespace slicecorr::tomo {

namespace {

constexpr double kSame = 1e-9;
/// Places within a group of pixels that tell how much of its light comes into the resin.
constexpr int kWithinGroup = 8;

[[noreturn]] void wrong(const Printer& printer, const std::string& what) {
  throw InputError("printer '" + printer.name + "': " + what);
}

}  // namespace

detail::RayAt detail::ray_at(const Vial& vial, double n_resin, double q_mm, double alpha_per_mm,
                             double radius_mm) {
  if (misses(vial, n_resin, q_mm, 0)) return {};
  const double magnified = n_resin / vial.n_outside, t = q_mm / magnified;
  const double beyond = std::sqrt(std::max(0.0, vial.inner_mm * vial.inner_mm - t * t)) -
                        std::sqrt(std::max(0.0, radius_mm * radius_mm - t * t));
  return {transmittance(vial, n_resin, q_mm, 0) * magnified * std::exp(-alpha_per_mm * beyond),
          turned_rad(vial, n_resin, q_mm, 0)};
}

int voxels_across(const Printer& printer, double voxel_mm) {
  require_tomographic(printer);
  const double radius_mm = printer.vial->inner_mm;
  const double half = std::floor(radius_mm / voxel_mm + kSame);
  if (!(half >= 1) || half > 8000) {
    throw InputError(fmt::format(
        "voxels of {:g} mm in resin of {:g} mm radius; expected 1 to 8000 from axis to wall",
        voxel_mm, radius_mm));
  }
  return 2 * static_cast<int>(half) + 1;
}

double z_of_row(const Bench& bench, int row) {
  const TomoGrid& grid = bench.grid;
  if (grid.coupled()) return bench.rays.row_mm[static_cast<std::size_t>(row)];
  return grid.lowest_mm + grid.voxel_mm() * row;
}

int row_of_slice(const Bench& bench, int slice) {
  if (!bench.grid.coupled()) return slice;
  const double z = bench.grid.lowest_mm + bench.grid.slice_height_mm() * slice;
  int nearest = 0;
  for (int r = 1; r < bench.grid.rows; ++r) {
    if (std::abs(z_of_row(bench, r) - z) < std::abs(z_of_row(bench, nearest) - z)) nearest = r;
  }
  return nearest;
}

Light light_of_groups(const Bench& groups, Light light, const Bench& pixels) {
  if (groups.grid == pixels.grid && groups.window == pixels.window) return light;
  const TomoGrid &from = groups.grid, &to = pixels.grid;
  Light shown(to);
  const PixelWindow &a = groups.window, &b = pixels.window;
  const auto group_of = [](int pixel, int first, int wide, int count) {
    const int group = pixel < first ? -1 : (pixel - first) / wide;
    return group < count ? group : -1;
  };
  for (int i = 0; i < to.pixels; ++i) {
    const int column = group_of(b.first_column + i, a.first_column, a.wide, a.columns);
    if (column < 0) continue;
    for (int r = 0; r < to.light_rows(); ++r) {
      int row = r;
      if (to.coupled()) {
        const int down = group_of(b.first_row + b.rows - 1 - r, a.first_row, a.high, a.rows);
        if (down < 0) continue;
        row = a.rows - 1 - down;
      }
      for (int m = 0; m < to.angles; ++m) {
        shown.values[to.pixel(m, i, r)] = light.values[from.pixel(m, column, row)];
      }
    }
  }
  return shown;
}

namespace {

/// The operators of a bench's rays, by those of each term of its light.
template <class Make>
std::shared_ptr<const Projector> of_blurred(const Bench& bench, const Make& make) {
  std::vector<detail::BlurredTerm> terms;
  for (const BlurredLight& light : bench.blur) {
    LabRays rays = *bench.lab;
    rays.across = light.across;
    rays.up = light.up;
    rays.depth = light.depth;
    terms.emplace_back(light.blur, make(rays));
  }
  if (terms.size() == 1 && terms.front().first.none()) return terms.front().second;
  return detail::make_blurred_projector(bench.grid, std::move(terms));
}

}  // namespace

std::shared_ptr<const Projector> make_projector(const Bench& bench, const Volume* insert) {
  if (bench.traced) {
    if (insert != nullptr) detail::check_traced_insert(bench, *insert);
    return detail::make_traced_projector(bench.grid, *bench.traced);
  }
  if (bench.lab) {
    return of_blurred(bench, [&](const LabRays& rays) {
      return std::shared_ptr<const Projector>(make_ray_projector(bench.grid, rays, insert));
    });
  }
  return detail::make_square_projector(bench.grid, bench.rays, insert);
}

double bytes_of_weights(const Bench& bench) {
  return bench.traced ? detail::bytes_of_weights(bench.grid, *bench.traced) : 0;
}

namespace {

/// Voxels by which light moves from one direction to the next.
double most_voxels(Search search) { return search == Search::rough ? 3 : 1; }

}  // namespace

std::shared_ptr<const Projector> make_search_projector(const Bench& bench, Search search,
                                                       const Volume* insert) {
  if (bench.traced) return make_projector(bench, insert);
  if (bench.lab) {
    return of_blurred(bench, [&](const LabRays& rays) {
      return std::shared_ptr<const Projector>(
          detail::make_ray_search_projector(bench.grid, rays, insert, most_voxels(search)));
    });
  }
  return detail::make_search_projector(bench.grid, bench.rays, insert, most_voxels(search));
}

bool has_rough_search(const Bench& bench) {
  if (bench.traced) return false;
  const auto cells = [&](Search search) {
    return detail::search_directions(bench.grid, bench.rays, most_voxels(search)).cells;
  };
  return cells(Search::rough) < cells(Search::close);
}

int resolving_angles(double radius_mm, double voxel_mm) {
  return static_cast<int>(
      std::min(std::ceil(2 * std::numbers::pi * radius_mm / voxel_mm - kSame), 1e9));
}

int usual_angles(const Printer& printer, double part_radius_mm, double voxel_mm) {
  constexpr int least = 180, most = 1440;
  int angles = std::clamp(resolving_angles(part_radius_mm, voxel_mm), least, most);
  const int shown = most_frames_per_turn(*printer.rotation);
  if (shown > 0) angles = std::min(angles, shown);
  return std::max(3, angles);
}

namespace {

/// Pixels of this size in the resin that show the same.
int grouped_in(const Sampling& sampling, double pixel_mm) {
  if (!sampling.grouped) return 1;
  return std::max(1, static_cast<int>(std::floor(sampling.voxel_mm / pixel_mm + kSame)));
}

/// Light that stays in its slice.
void make_level(const Printer& printer, double n, const Sampling& sampling, Bench& b) {
  const Vial& vial = *printer.vial;
  const Optics& optics = *printer.optics;
  const double pitch_mm = printer.pixel_x_um * 1e-3, row_mm = printer.pixel_y_um * 1e-3;
  TomoGrid& grid = b.grid;
  grid.lowest_mm = sampling.middle_z_mm - 0.5 * grid.slice_height_mm() * (grid.slices - 1);
  grid.pixel_mm = pitch_mm * vial.n_outside / n;
  // Columns whose light may meet a voxel, one more to each side.
  // Where the axis does not keep to its place, as many more as it goes astray.
  const auto line_mm = [&](double column) {
    return pixel_x_mm(printer, column) * vial.n_outside / n;
  };
  const double tilt = optics.tilt_deg * std::numbers::pi / 180;
  const double astray_px =
      most_wobble_px(*printer.rotation) +
      (std::abs(sampling.middle_z_mm) + 0.5 * sampling.voxel_mm * sampling.slices) / pitch_mm *
          std::abs(std::sin(tilt)) +
      printer.width_px * (1 - std::cos(tilt));
  // Walls that are not round (of which alone it says the thickness) bend light in from beside the resin.
  const double lit_mm = vial.wall_mm > 0 ? vial.outer_mm : grid.radius_mm;
  int first = 0, past = printer.width_px;
  while (first < past && line_mm(first + 1 + astray_px) < -lit_mm) ++first;
  while (past > first && line_mm(past - 2 - astray_px) > lit_mm) --past;
  b.reach_mm = std::min(
      {b.reach_mm, -line_mm(astray_px - kSame), line_mm(printer.width_px - 1 - astray_px + kSame)});
  b.reach_mm = std::max(0.0, b.reach_mm);
  const int wide = grouped_in(sampling, grid.pixel_mm);
  // Whole groups: more columns where the image has them, else fewer.
  while ((past - first) % wide != 0 && past < printer.width_px) ++past;
  while ((past - first) % wide != 0 && first > 0) --first;
  past -= (past - first) % wide;
  grid.pixels = (past - first) / wide;
  grid.pixel_mm *= wide;
  b.window = {first, 0, grid.pixels, printer.height_px, wide, 1};
  if (grid.pixels < 2) wrong(printer, "none of its pixels meets the resin");
  grid.check();

  RayTables& rays = b.rays;
  if (wide == 1) rays.lit = std::sqrt(printer.fill_factor);
  if (printer.fill_factor < 1 && (optics.tilt_deg != 0 || !printer.rotation->wobble.empty())) {
    wrong(printer,
          fmt::format("fill_factor of {:g} is not counted where frames follow an axis that "
                      "leans or wobbles; expected 1, or tilt_deg 0 and no wobble",
                      printer.fill_factor));
  }
  // Level light meets a bath's window at right angles.
  const double window = chief_ray(printer, 0, 0).transmittance;
  for (int i = 0; i < grid.pixels; ++i) {
    const double column = b.window.column_of(i);
    rays.line_mm.push_back(line_mm(column));
    const detail::RayAt middle =
        detail::ray_at(vial, n, pixel_x_mm(printer, column), rays.alpha_per_mm, grid.radius_mm);
    rays.turn_rad.push_back(middle.turn_rad);
    double weight = 0;
    if (middle.weight == 0) {
      rays.weight.push_back(0);
      continue;
    }
    for (int k = 0; k < kWithinGroup; ++k) {
      const double q = pixel_x_mm(printer, column + wide * ((k + 0.5) / kWithinGroup - 0.5));
      weight += detail::ray_at(vial, n, q, rays.alpha_per_mm, grid.radius_mm).weight;
    }
    rays.weight.push_back(window * weight / kWithinGroup);
  }

  // Empty tables leave the operators their shorter ways.
  const auto all_near = [](const std::vector<double>& table, auto expected) {
    for (std::size_t i = 0; i < table.size(); ++i) {
      if (std::abs(table[i] - expected(static_cast<int>(i))) > kSame) return false;
    }
    return true;
  };
  if (all_near(rays.line_mm, [&](int i) { return grid.pixel_at_mm(i); })) rays.line_mm.clear();
  if (all_near(rays.turn_rad, [](int) { return 0.0; })) rays.turn_rad.clear();
  if (all_near(rays.weight, [](int) { return 1.0; })) rays.weight.clear();

  if (sampling.grouped) return;
  b.places = FramePlaces(printer, grid, b.window, b.clockwise);
  // What all angles light, at both ends of the rows.
  std::vector<bool> lit(static_cast<std::size_t>(sampling.slices), true);
  for (int m = 0; m < (b.places.moved() ? grid.angles : 1); ++m) {
    for (const int column : {0, grid.pixels - 1}) {
      std::vector<bool> here(lit.size(), false);
      for (int row = 0; row < printer.height_px; ++row) {
        const int s = b.places.lit_by(m, first + column, row).row;
        if (s >= 0) here[static_cast<std::size_t>(s)] = true;
      }
      for (std::size_t s = 0; s < lit.size(); ++s) lit[s] = lit[s] && here[s];
    }
  }
  if (std::find(lit.begin(), lit.end(), false) != lit.end()) {
    wrong(
        printer,
        fmt::format("its image is {:g} mm high about the optical axis at {:g} mm from its middle; "
                    "expected the {:g} mm of the part in it, {:.3f} to {:.3f} mm from the optical "
                    "axis",
                    printer.height_px * row_mm, optics.axis_up_px * row_mm,
                    sampling.slices * sampling.voxel_mm, sampling.z_mm(0) - 0.5 * sampling.voxel_mm,
                    sampling.z_mm(sampling.slices - 1) + 0.5 * sampling.voxel_mm));
  }
}

/// Half-open range of columns or rows.
struct Stretch {
  int first = 0, end = 0;
  int count() const { return end - first; }
};
/// From the first of n to the last for which it holds.
template <class Holds>
Stretch range_of(int n, Holds holds) {
  Stretch range{n, 0};
  for (int i = 0; i < n; ++i) {
    if (!holds(i)) continue;
    range.first = std::min(range.first, i);
    range.end = i + 1;
  }
  range.first = std::min(range.first, range.end);
  return range;
}

/// z of a ray on its way, at u = 0 and at both ends of the resin.
double z_on_axis(const LabRay& ray) { return ray.entry_z_mm + ray.slope * ray.half_mm; }
bool meets(const LabRay& ray, double lowest_mm, double highest_mm) {
  if (!(ray.half_mm > 0)) return false;
  const double end = ray.entry_z_mm + ray.slope * 2 * ray.half_mm;
  return std::max(ray.entry_z_mm, end) >= lowest_mm && std::min(ray.entry_z_mm, end) <= highest_mm;
}

/// Throws for a part that reaches over what the image's rows light on the axis.
void check_rows(const Printer& printer, const Sampling& sampling, double half_row_mm,
                const Bench& b) {
  const std::vector<double>& row_mm = b.rays.row_mm;
  const double lowest_mm = sampling.z_mm(0), highest_mm = sampling.z_mm(sampling.slices - 1);
  const double near = kSame * (1 + std::max(std::abs(lowest_mm), std::abs(highest_mm)));
  // Void is all that an image of one row has above and below it.
  if (printer.height_px == 1 || (row_mm.front() - half_row_mm <= lowest_mm + near &&
                                 row_mm.back() + half_row_mm >= highest_mm - near)) {
    return;
  }
  wrong(printer,
        fmt::format("its image lights {:.3f} to {:.3f} mm on the axis; expected the {:g} mm of the "
                    "part in it, {:.3f} to {:.3f} mm",
                    row_mm.front() - half_row_mm, row_mm.back() + half_row_mm,
                    sampling.slices * sampling.voxel_mm, lowest_mm - 0.5 * sampling.voxel_mm,
                    highest_mm + 0.5 * sampling.voxel_mm));
}

/// Light that rises, falls or spreads: all of its rays.
void make_coupled(const Printer& printer, const Resin& resin, const Sampling& sampling, Bench& b) {
  const Vial& vial = *printer.vial;
  const double n = index_of(resin);
  TomoGrid& grid = b.grid;
  grid.slice_mm = sampling.voxel_mm;
  grid.lowest_mm = sampling.z_mm(0);
  const double highest_mm = sampling.z_mm(sampling.slices - 1);
  // How far apart neighbouring pixels are in the resin, near the axis.
  const double at_mm = printer.pixel_x_um * 1e-3 * vial.n_outside / n,
               row_mm = printer.pixel_y_um * 1e-3 * height_on_axis(printer, n);
  const int wide = grouped_in(sampling, at_mm), high = grouped_in(sampling, row_mm);
  const PixelWindow all{printer.width_px % wide / 2,
                        printer.height_px % high / 2,
                        printer.width_px / wide,
                        printer.height_px / high,
                        wide,
                        high};
  if (all.columns < 2 || all.rows < 1) {
    wrong(printer, fmt::format("its image has fewer than 2 columns of {:g} mm", wide * at_mm));
  }
  // Walls that are not round (of which alone it says the thickness) bend light in from beside the resin.
  Printer widest = printer;
  if (vial.wall_mm > 0) widest.vial->inner_mm = vial.outer_mm * (1 - kSame);
  // A row near the optical axis tells the columns that meet the resin.
  PixelWindow some = all;
  const auto middle_row = static_cast<int>(
      std::clamp(std::lround(image_place(printer, {0, 0}).row), 0L, printer.height_px - 1L));
  some.first_row =
      all.first_row + std::clamp((middle_row - all.first_row) / high, 0, all.rows - 1) * high;
  some.rows = 1;
  const LabRays across = lab_rays(widest, n, b.rays.alpha_per_mm, some);
  const auto per_pixel = static_cast<std::size_t>(across.per_pixel);
  Stretch columns = range_of(all.columns, [&](int c) {
    const auto first = across.rays.begin() + static_cast<std::ptrdiff_t>(per_pixel) * c;
    return std::any_of(first, first + static_cast<std::ptrdiff_t>(per_pixel),
                       [](const LabRay& r) { return r.half_mm > 0; });
  });
  if (columns.count() < 2) wrong(printer, "none of its pixels meets the resin");
  // Columns in the middle and at both ends tell the rows that meet slices.
  const double high_mm = highest_mm + sampling.voxel_mm,
               low_mm = grid.lowest_mm - sampling.voxel_mm;
  std::vector<bool> row_meets(static_cast<std::size_t>(all.rows), false);
  for (const int c : {columns.first, (columns.first + columns.end) / 2, columns.end - 1}) {
    some = all;
    some.first_column = all.first_column + c * wide;
    some.columns = 1;
    const LabRays up = lab_rays(widest, n, b.rays.alpha_per_mm, some);
    for (std::size_t k = 0; k < up.rays.size(); ++k) {
      if (meets(up.rays[k], low_mm, high_mm)) row_meets[k / per_pixel] = true;
    }
  }
  // Rows of light are counted upwards.
  Stretch rows = range_of(all.rows, [&](int r) { return row_meets[static_cast<std::size_t>(r)]; });
  if (rows.count() < 1) wrong(printer, "none of its rows lights the part");
  // Light that the projector blurs comes from pixels beside these, too.
  const detail::SpreadReach beyond = detail::reach_of_spread(printer);
  const auto wider = [](const Stretch& s, int by, int most) {
    return Stretch{std::max(0, s.first - by), std::min(most, s.end + by)};
  };
  columns = wider(columns, (beyond.across + wide - 1) / wide, all.columns);
  rows = wider(rows, (beyond.up + high - 1) / high, all.rows);
  // Two rows tell how far rows are apart.
  if (rows.count() < 2) rows = {std::max(0, rows.end - 2), std::max(rows.end, 2)};
  // An image of one row has a dark one above it.
  if (rows.end > all.rows && printer.height_px > 1) {
    wrong(printer, "its image has one row of light; expected 2 or more");
  }
  b.window = {all.first_column + columns.first * wide,
              all.first_row + (all.rows - rows.end) * high,
              columns.count(),
              rows.count(),
              wide,
              high};
  grid.pixels = columns.count();
  grid.rows = rows.count();
  grid.pixel_mm = wide * at_mm;
  grid.check();
  b.lab = std::make_shared<const LabRays>(lab_rays(printer, n, b.rays.alpha_per_mm, b.window));
  double most_way_mm = 0;
  for (const LabRay& ray : b.lab->rays) {
    most_way_mm = std::max(most_way_mm, 2 * ray.half_mm * std::hypot(1, ray.slope));
  }
  b.blur = detail::blurred_light(
      printer, resin,
      {wide, high, 1 / grid.pixel_mm, 1 / (high * row_mm), grid.voxel_mm(), most_way_mm});

  // The nearest to level rays: the middle rays of pixels, of a row near the optical axis.
  RayTables& rays = b.rays;
  const auto middle_of = [&](int c, int r) -> const LabRay& {
    return b.lab->rays[(static_cast<std::size_t>(c) * static_cast<std::size_t>(grid.rows) +
                        static_cast<std::size_t>(r)) *
                       per_pixel];
  };
  const int near_row =
      grid.rows - 1 - std::clamp((middle_row - b.window.first_row) / high, 0, grid.rows - 1);
  const double axis_pixel =
      -pixel_x_mm(printer, b.window.column_of(0)) / (printer.pixel_x_um * 1e-3 * wide);
  for (int c = 0; c < grid.pixels; ++c) {
    const LabRay& ray = middle_of(c, near_row);
    rays.line_mm.push_back(ray.half_mm > 0 ? ray.t_mm : (c - axis_pixel) * grid.pixel_mm);
    rays.turn_rad.push_back(ray.turn_rad);
    rays.weight.push_back(ray.power * static_cast<double>(per_pixel) * n / vial.n_outside);
  }
  for (int r = 0; r < grid.rows; ++r)
    rays.row_mm.push_back(z_on_axis(middle_of(grid.pixels / 2, r)));
  check_rows(printer, sampling, 0.5 * high * row_mm, b);
  if (!sampling.grouped) b.places = FramePlaces(printer, grid, b.window, b.clockwise);
}

/// Where rows of traced light are on the axis.
void set_rows(const Printer& printer, const Sampling& sampling, Bench& b) {
  const std::optional<double> rise = detail::rise_on_axis(*b.traced);
  if (!rise) return;
  const detail::TracedRows& rows = *b.traced->rows;
  const auto at = [&](double row) {
    const detail::TracedLine line = rows.line(0.5 * (b.grid.pixels - 1), row, 0);
    return line.z_mm + printer.vial->n_outside * line.kz * *rise;
  };
  for (int r = 0; r < b.grid.rows; ++r) b.rays.row_mm[static_cast<std::size_t>(r)] = at(r);
  check_rows(printer, sampling, (at(0.5) - at(-0.5)) / 2, b);
}

}  // namespace

bool slices_share_light(const Printer& printer, const Resin& resin) {
  require_tomographic(printer);
  return printer.optics->kind != OpticsKind::telecentric || printer.optics->half_angle_deg > 0 ||
         detail::light_goes_sideways(printer, resin);
}

std::string doubt_of_turbidity(const Printer& printer, const Resin& resin) {
  require_tomographic(printer);
  const double reach = turbid_reach(resin.turbidity, 2 * printer.vial->inner_mm);
  if (!(reach > kDoubtfulTurbidity)) return {};
  return fmt::format(
      "the resin scatters much: (1 - g) tau is {:.2g} through it, and above {:g} doses may be higher by a "
      "tenth than told, as light that is scattered far to the side is not counted",
      reach, kDoubtfulTurbidity);
}

Bench make_bench(const Printer& printer, const Resin& resin, const Sampling& sampling) {
  require_tomographic(printer);
  const Vial& vial = *printer.vial;
  Bench b;
  const double n = index_of(resin);
  const double row_mm = printer.pixel_y_um * 1e-3;
  if (sampling.voxel_mm < row_mm * (1 - kSame)) {
    wrong(printer,
          fmt::format("its rows are {:g} mm high; expected voxels of at least that, not of "
                      "{:g} mm",
                      row_mm, sampling.voxel_mm));
  }
  if (sampling.angles < 3) {
    throw InputError(fmt::format("{} angles; expected at least 3", sampling.angles));
  }
  const int most_frames = most_frames_per_turn(*printer.rotation);
  if (most_frames > 0 && sampling.angles > most_frames) {
    wrong(printer,
          fmt::format("shows {} frames in a turn at most, not {}; expected fewer angles, or "
                      "a slower turn",
                      most_frames, sampling.angles));
  }
  b.radius_mm = vial.inner_mm;
  const Printer closed = vial.traced() ? detail::closed_like(printer, n) : printer;
  if (vial.traced()) detail::check_traced(printer, resin);
  b.reach_mm = slicecorr::reach_mm(closed, n);
  b.clockwise = printer.rotation->direction == TurnDirection::clockwise;
  b.frame_width = printer.width_px;
  b.frame_height = printer.height_px;

  TomoGrid& grid = b.grid;
  grid.voxels = voxels_across(printer, sampling.voxel_mm);
  grid.radius_mm = 0.5 * sampling.voxel_mm * (grid.voxels - 1);
  grid.slices = sampling.slices;
  grid.angles = sampling.angles;
  b.rays.alpha_per_mm = absorption_per_mm(resin);
  b.alpha_r = b.rays.alpha_per_mm * b.radius_mm;
  if (slices_share_light(printer, resin)) {
    make_coupled(closed, resin, sampling, b);
  } else {
    make_level(closed, n, sampling, b);
  }
  if (vial.traced()) {
    b.traced = detail::traced_light(printer, n, b);
    if (b.traced->rows) set_rows(printer, sampling, b);
  }
  b.mw_cm2 = level_intensities(printer);
  if (!(b.mw_cm2.back() > b.mw_cm2.front())) {
    wrong(printer,
          fmt::format("its brightest level shows {:g} mW/cm², its darkest {:g}; expected a "
                      "calibration that rises",
                      b.mw_cm2.back(), b.mw_cm2.front()));
  }
  if (printer.flat_field && b.places.uneven()) {
    for (int i = 0; i < grid.pixels; ++i) {
      for (int z = 0; z < grid.light_rows(); ++z) {
        const int column = b.window.first_column + i;
        if (misses(*closed.vial, n, pixel_x_mm(printer, column), 0)) continue;
        if (b.places.share(0, i, z) > 0) continue;
        wrong(printer,
              fmt::format("its flat-field is black in column {}, {:.3f} mm from the optical axis, "
                          "where the resin is; expected some light",
                          column, z_of_row(b, z)));
      }
    }
  }
  b.exposure.alpha_a_per_cm = curing_absorption_per_mm(resin) * 10;
  b.exposure.turn_s = printer.rotation->turn_s();
  b.exposure.critical_mj_cm3 = dose_to_gel_mj_cm3(resin);
  b.exposure.black_mw_cm2 = b.mw_cm2.front();
  b.resupply_mj_cm3_s = resin.inhibition_resupply_mj_cm3_s;
  return b;
}

}  // namespace slicecorr::tomo
