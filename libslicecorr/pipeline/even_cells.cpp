#include "pipeline/even_cells.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>

#include "parallel/silent.hpp"
#include "pipeline/bands.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

FlowPart part_of(const SliceSource& target, const EvenSections::Cells& cells,
                 const ExecutionContext& context) {
  FlowPartOptions options;
  options.gap_um = cells.gap_um;
  options.pitch_um = cells.pitch_um;
  return {target, options, context};
}

/// Sections narrower than this many cells have no inside that cells could tell.
constexpr int kLeastCells = 3;

}  // namespace

EvenSections::EvenSections(const SliceSource& target, const Setup& setup, const Cells& cells,
                           const ExecutionContext& context)
    : part_(part_of(target, cells, context)), resin_(flow_resin(setup.resin)) {}

bool EvenSections::can_be_solved(int slice) const {
  if (part_.mask_of(slice) < 0) return false;
  const FlowSection section = part_.section(mask_of(slice));
  int x0 = section.width, x1 = -1, y0 = section.height, y1 = -1;
  for (int y = 0; y < section.height; ++y) {
    for (int x = 0; x < section.width; ++x) {
      if (section.cells[section.index(x, y)] != FlowCell::part) continue;
      x0 = std::min(x0, x);
      x1 = std::max(x1, x);
      y0 = std::min(y0, y);
      y1 = std::max(y1, y);
    }
  }
  return x1 - x0 + 1 >= kLeastCells && y1 - y0 + 1 >= kLeastCells;
}

std::vector<int> EvenSections::slices_of(int every) const {
  std::vector<int> slices;
  const int count = part_.slices();
  for (int n = 0; n < count; n += std::max(1, every)) {
    if (can_be_solved(n)) slices.push_back(n);
  }
  if (slices.empty() || slices.back() != count - 1) {
    if (can_be_solved(count - 1)) slices.push_back(count - 1);
  }
  return slices;
}

std::size_t EvenSections::largest(const std::vector<int>& slices) const {
  std::size_t best = mask_of(slices.front());
  double area = 0;
  for (const int n : slices) {
    const double its = part_area_mm2(section(mask_of(n)));
    if (its <= area) continue;
    area = its;
    best = mask_of(n);
  }
  return best;
}

double part_area_mm2(const FlowSection& section) {
  return static_cast<double>(
             std::count(section.cells.begin(), section.cells.end(), FlowCell::part)) *
         section.cell_um2() * 1e-6;
}

double mean_over_part(const FlowSection& section, const std::vector<double>& values) {
  double sum = 0, cells = 0;
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    sum += values[i];
    ++cells;
  }
  return cells > 0 ? sum / cells : 0;
}

double even_blue_cap(const SliceSource& target, const Setup& setup) {
  const double full = setup.printer.calibration.back().intensity_mw_cm2;
  const LightMap map(setup.printer, target.grid(), target.frame());
  if (map.even()) return full;
  const auto counts = map.counts(target.bounds());
  for (std::size_t v = 1; v < counts.size(); ++v) {
    if (counts[v] > 0) return full * map.factor(static_cast<std::uint8_t>(v));
  }
  return full;
}

CellLight even_cells(const Setup& setup, std::size_t at) {
  const EvenLight& light = *setup.process.even_light;
  const LevelTable blue(level_intensities(setup.printer));
  const double full = blue.phi(blue.size() - 1);
  const auto nearest = [&](double mw_cm2) {
    const auto [below, above] = blue.around(mw_cm2);
    const double low = blue.phi(below), high = blue.phi(above);
    return mw_cm2 - low <= high - mw_cm2 ? low : high;
  };
  CellLight cells;
  const std::size_t first = at * light.cells();
  std::optional<LevelTable> uv;
  if (light.uv) uv.emplace(uv_level_intensities(setup.printer));
  const UvSchedule& schedule = setup.process.uv;
  const auto n =
      std::min(static_cast<std::size_t>(light.slices[at]), schedule.slice_mw_cm2.size() - 1);
  for (std::size_t i = 0; i < light.cells(); ++i) {
    cells.blue.push_back(nearest((*light.blue)[first + i] / 255.0 * full));
    cells.uv.push_back(uv ? uv->phi(uv->at_least((*light.uv)[first + i] / 255.0 *
                                                 setup.printer.uv->max_mw_cm2() * (1 - 1e-12)))
                          : schedule.slice_mw_cm2[n]);
  }
  return cells;
}

std::vector<CellLight> shown_cells(const SliceSource& shown, const SliceSource& target,
                                   const EvenSections& sections, const Setup& setup,
                                   const ExecutionContext& context) {
  const EvenLight& light = *setup.process.even_light;
  const FlowGrid& grid = sections.part().grid();
  const Grid& images = shown.grid();
  // Sums in whole nW/cm² times coverage, 1..255: they are the same in whatever order threads add.
  struct Sums {
    std::vector<std::int64_t> blue, uv, lit, part;
  };
  constexpr double kUnit = 1e6, kCovered = 255;
  std::vector<Sums> sums(light.slices.size());
  for (Sums& s : sums) {
    for (auto* v : {&s.blue, &s.uv, &s.lit, &s.part}) v->assign(grid.cells(), 0);
  }
  const std::vector<double> intensity = level_intensities(setup.printer);
  std::optional<EvenUvImages> uv_images;
  std::vector<double> uv_intensity;
  if (light.uv) {
    uv_images.emplace(setup.printer, setup.resin, setup.process, images);
    uv_intensity = uv_level_intensities(setup.printer);
  }
  const auto of_pixel = [](const std::vector<double>& levels, std::uint8_t pixel) {
    const int level = level_of_pixel(pixel, static_cast<int>(levels.size()));
    return std::llround(levels[static_cast<std::size_t>(level)] * kUnit);
  };
  const LightMap map(setup.printer, images, shown.frame());
  const auto cell_of = [&](double um, double first_um, int cells) {
    return std::clamp(static_cast<int>(std::floor((um - first_um) / grid.pitch_um)), 0, cells - 1);
  };
  const auto slice_of = [&](int n) {
    const auto at = std::lower_bound(light.slices.begin(), light.slices.end(), n);
    const bool solved = at != light.slices.end() && *at == n;
    return solved ? static_cast<std::size_t>(at - light.slices.begin()) : sums.size();
  };
  const auto bands = bands_of(images, shown.bounds());
  std::mutex adding;
  parallel_for(context, "look at the light", bands.size(), [&](std::size_t b) {
    const PixelBox& band = bands[b];
    const auto width = static_cast<std::size_t>(band.width());
    // Light counts where it falls on the part: pixels of an outline by what of them is part.
    std::vector<std::vector<std::uint8_t>> part(sums.size());
    target.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::size_t i = slice_of(n);
      if (!rows || i == sums.size()) return;
      part[i].assign(rows, rows + width * static_cast<std::size_t>(band.y1 - band.y0));
    });
    shown.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::size_t i = slice_of(n);
      if (!rows || i == sums.size() || part[i].empty()) return;
      Sums& s = sums[i];
      for (int y = band.y0; y < band.y1; ++y) {
        const std::size_t begin = static_cast<std::size_t>(y - band.y0) * width;
        const std::uint8_t *const row = rows + begin, *const covered = part[i].data() + begin;
        std::vector<std::uint8_t> whole;
        if (uv_images) {
          whole.assign(static_cast<std::size_t>(images.width_px), 0);
          std::copy_n(row, width, whole.begin() + band.x0);
          uv_images->make_row(n, y, whole);
        }
        const int cell_y = cell_of((y + 0.5) * images.pixel_y_um, grid.top_um, grid.rows);
        const std::lock_guard lock(adding);
        for (int x = band.x0; x < band.x1; ++x) {
          const std::uint8_t pixel = row[x - band.x0];
          const std::int64_t share = covered[x - band.x0];
          if (share == 0) continue;
          const int cell_x = cell_of((x + 0.5) * images.pixel_x_um, grid.left_um, grid.columns);
          const std::size_t cell =
              static_cast<std::size_t>(cell_y) * static_cast<std::size_t>(grid.columns) +
              static_cast<std::size_t>(cell_x);
          s.part[cell] += share;
          if (pixel == 0) continue;
          const double factor = map.even() ? 1.0 : map.factor(map.value(x, y));
          s.blue[cell] +=
              share * std::llround(static_cast<double>(of_pixel(intensity, pixel)) * factor);
          if (uv_images) {
            s.uv[cell] += share * of_pixel(uv_intensity, whole[static_cast<std::size_t>(x)]);
          }
          s.lit[cell] += share;
        }
      }
    });
  });
  const double pixels_of_cell =
      grid.pitch_um * grid.pitch_um / (images.pixel_x_um * images.pixel_y_um);
  std::vector<CellLight> result;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const Sums& s = sums[i];
    const std::vector<double>& per_slice = setup.process.uv.slice_mw_cm2;
    const auto n = std::min(static_cast<std::size_t>(light.slices[i]), per_slice.size() - 1);
    CellLight cells;
    const CellLight planned = even_cells(setup, i);
    std::size_t lit = 0, part = 0;
    const FlowSection section = sections.section(sections.mask_of(light.slices[i]));
    for (std::size_t c = 0; c < grid.cells(); ++c) {
      const double part_sum = std::max<double>(1, static_cast<double>(s.part[c])) * kUnit;
      cells.blue.push_back(static_cast<double>(s.blue[c]) / part_sum);
      cells.uv.push_back(light.uv ? static_cast<double>(s.uv[c]) / part_sum : per_slice[n]);
      const bool counts = section.cells[c] == FlowCell::part;
      // Cells that are dimmer, before edges that face the platform, have nothing that is to gel yet.
      const bool is_lit = static_cast<double>(s.lit[c]) >= 0.25 * kCovered * pixels_of_cell &&
                          cells.blue.back() >= 0.5 * planned.blue[c];
      cells.weight.push_back(counts && is_lit ? 1.0 : 0.0);
      cells.shown.push_back(planned.blue[c] > 0 ? std::min(1.0, cells.blue.back() / planned.blue[c])
                                                : 0.0);
      part += static_cast<std::size_t>(counts);
      lit += static_cast<std::size_t>(counts && is_lit);
    }
    cells.lit = part > 0 ? static_cast<double>(lit) / static_cast<double>(part) : 0;
    result.push_back(std::move(cells));
  }
  return result;
}

namespace {

/// How thick the dead zone becomes over a cell: the front moves until the dose is 1, at the rate there.
double dead_zone_um(const Kinetics& k, double blue, double uv, double dose, double gap_um,
                    double speed_um_s) {
  constexpr double kMost = 300;  // more is a void
  const double rate =
      blue * std::exp(-gap_um / k.hb_um) - k.beta * uv * std::exp(-gap_um / k.huv_um);
  if (!(rate > 0)) return dose < 1 ? kMost : gap_um;
  return std::clamp(gap_um + speed_um_s * k.critical_dose_prime * (1 - dose) / rate, 0.0, kMost);
}

FrontDose front_dose(const FlowSection& section, const SectionSweep& sweep, const CellLight& light,
                     const Kinetics& kinetics, double gap_um, double speed_um_s) {
  const SectionDose dose = sweep.dose(light.blue, light.uv);
  const DoseSummary s = summarise(section, dose, light.weight);
  FrontDose front{s.min, s.mean, s.max, s.within_10, s.max_window, kMostGapUm, 0};
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    if (!light.weight.empty() && light.weight[i] == 0) continue;
    const double zone =
        dead_zone_um(kinetics, light.blue[i], light.uv[i], dose.front[i], gap_um, speed_um_s);
    front.dead_zone_min_um = std::min(front.dead_zone_min_um, zone);
    front.dead_zone_max_um = std::max(front.dead_zone_max_um, zone);
  }
  return front;
}

}  // namespace

}  // namespace slicecorr::detail

namespace slicecorr {

FlowDoses flow_doses(const SliceSource& target, const SliceSource* shown, const Setup& setup,
                     const ExecutionContext& context) {
  using namespace detail;
  FlowDoses doses;
  if (!setup.process.even_light) return doses;
  const EvenLight& light = *setup.process.even_light;
  doses.gap_um = light.gap_um;
  const EvenSections sections(target, setup, {light.gap_um, light.pitch_um}, context);
  const FlowGrid& grid = sections.part().grid();
  if (grid.columns != light.columns || grid.rows != light.rows) {
    throw InputError("the even light of this stack was made for another part");
  }
  std::vector<CellLight> lights;
  if (shown) lights = shown_cells(*shown, target, sections, setup, context);
  const double speed_um_s = units::cm_s_from_mm_h(setup.process.speed_mm_h) * 1e4;
  const Kinetics& kinetics = sections.resin().kinetics;
  // The best intensities that are the same everywhere, by mask.
  SectionGoal goal;
  goal.pattern = FlowPattern::constant;
  goal.min_gap_um = goal.max_gap_um = light.gap_um;
  goal.max_blue_mw_cm2 = even_blue_cap(target, setup);
  goal.max_uv_mw_cm2 = setup.printer.uv->max_mw_cm2();
  std::vector<std::optional<FlowDoses::Slice>> found(light.slices.size());
  const ExecutionContext alone = detail::silent(context);
  parallel_for(context, "dose in flowing resin", found.size(), [&](std::size_t i) {
    const int n = light.slices[i];
    if (n >= sections.part().slices() || !sections.can_be_solved(n)) return;
    const CellLight cells = shown ? lights[i] : even_cells(setup, i);
    if (cells.lit < 0.5) return;
    const std::size_t mask = sections.mask_of(n);
    const FlowSection section = sections.section(mask);
    const GapPressure pressure = sections.pressure(mask, alone);
    const SectionSweep sweep(section, pressure, sections.resin(), setup.process.speed_mm_h,
                             std::vector{light.gap_um});
    const SectionOptimum best = optimise_section(section, pressure, sections.resin(),
                                                 setup.process.speed_mm_h, goal, alone);
    FlowDoses::Slice slice;
    slice.slice = n;
    slice.area_mm2 = part_area_mm2(section);
    slice.even = front_dose(section, sweep, cells, kinetics, light.gap_um, speed_um_s);
    CellLight same{best.blue_mw_cm2, best.uv_mw_cm2, cells.weight, 1};
    for (std::size_t c = 0; c < cells.shown.size(); ++c) {
      same.blue[c] *= cells.shown[c];
      same.uv[c] *= cells.shown[c];
    }
    slice.without = front_dose(section, sweep, same, kinetics, light.gap_um, speed_um_s);
    found[i] = slice;
  });
  for (const auto& slice : found) {
    if (slice) doses.slices.push_back(*slice);
  }
  return doses;
}

}  // namespace slicecorr
