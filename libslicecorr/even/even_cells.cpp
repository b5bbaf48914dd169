// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "even/even_cells.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <optional>

#include "bands/bands.hpp"
#include "even/kept_images.hpp"
#include "even/lit_setup.hpp"
#include "even/planned_images.hpp"
#include "flow/solvable.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

FlowPart part_of(const SliceSource& part, const EvenSections::Cells& cells,
                 const ExecutionContext& context) {
  FlowPartOptions options;
  options.gap_um = cells.gap_um;
  options.pitch_um = cells.pitch_um;
  return {part, options, context};
}

}  // namespace

EvenSections::EvenSections(const SliceSource& part, const Setup& setup, const Cells& cells,
                           const ExecutionContext& context)
    : part_(part_of(part, cells, context)), resin_(flow_resin(setup.resin)) {}

bool EvenSections::can_be_solved(int slice) const {
  if (part_.mask_of(slice) < 0) return false;
  return solvable(part_.section(mask_of(slice)));
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

double EvenSections::changed(int slice, int other) const {
  if (mask_of(slice) == mask_of(other)) return 0;
  const FlowSection a = section(mask_of(slice)), b = section(mask_of(other));
  double differs = 0, area_a = 0, area_b = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double in_a = a.cells[i] == FlowCell::part ? a.coverage[i] : 0;
    const double in_b = b.cells[i] == FlowCell::part ? b.coverage[i] : 0;
    differs += std::abs(in_a - in_b);
    area_a += in_a;
    area_b += in_b;
  }
  return differs / std::max({area_a, area_b, 1.0});
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

double even_uv_cap(const Setup& setup) {
  return setup.printer.uv->max_mw_cm2() * LampShares{setup.process}.least_uv() *
         std::min(1.0, least_uv_factor(setup.printer));
}

double even_blue_cap(const SliceSource& target, const Setup& setup) {
  const double full =
      setup.printer.calibration.back().intensity_mw_cm2 * LampShares{setup.process}.least_blue();
  const LightMap map(setup.printer, target.grid(), target.frame());
  const auto counts = map.counts(target.bounds());
  for (std::size_t v = 1; v < counts.size(); ++v) {
    if (counts[v] > 0) return full * map.factor(static_cast<std::uint8_t>(v));
  }
  return full;
}

namespace {

/// Sums over the pixels of cells, in whole numbers, times coverage, 1..255: they are the same in whatever
/// order threads add.
struct LightSums {
  std::vector<std::int64_t> blue, uv;               ///< nW/cm²
  std::vector<std::int64_t> own_blue, own_uv;       ///< of pixels that do not follow the even light
  std::vector<std::int32_t> lit, part, followed;    ///< pixels
  std::vector<std::array<std::int32_t, 9>> shares;  ///< of followed pixels, in 1/kShareUnit
};
constexpr double kLightUnit = 1e6, kShareUnit = 512;

/// Where pixels lie among the middles of cells, along one direction.
struct PixelPlaces {
  struct Place {
    std::size_t cell = 0;
    std::array<double, 3> shares{};  ///< of the cell before, its own and the one after
  };
  std::vector<Place> of_pixel;

  PixelPlaces(int pixels, double pixel_um, double first_um, double pitch_um, int cells) {
    for (int p = 0; p < pixels; ++p) {
      const double at = ((p + 0.5) * pixel_um - first_um) / pitch_um;
      const double cell = std::clamp(std::floor(at), 0.0, cells - 1.0);
      const double off = std::clamp(at - cell - 0.5, -0.5, 0.5);
      of_pixel.push_back({static_cast<std::size_t>(cell),
                          {std::max(0.0, -off), 1 - std::abs(off), std::max(0.0, off)}});
    }
  }
};

/// Adds the light of the pixels of one slice's rows to its cells.
class LightAdder {
 public:
  LightAdder(const Setup& setup, const Grid& images, const ImageFrame& frame, const FlowGrid& grid)
      : images_(images),
        columns_(static_cast<std::size_t>(grid.columns)),
        across_(images.width_px, images.pixel_x_um, grid.left_um, grid.pitch_um, grid.columns),
        down_(images.height_px, images.pixel_y_um, grid.top_um, grid.pitch_um, grid.rows),
        map_(setup.printer, images, frame),
        uv_map_(uv_light_map(setup.printer, images, frame)),
        even_light_(*setup.process.even_light),
        process_(setup.process),
        back_(setup.printer, setup.resin, setup.process, images.layer_um) {
    blue_ = level_intensities(setup.printer);
    blue_of_ = units(blue_);
    full_ = blue_.back();
    for (std::size_t l = 1; l < blue_.size(); ++l) step_ = std::max(step_, blue_[l] - blue_[l - 1]);
    if (even_light_.uv) {
      uv_images_.emplace(setup, images, frame);
      uv_of_ = units(uv_level_intensities(setup.printer));
    }
    even_light_.uv = even_light_.blue;
    even_.emplace(even_light_, images);
  }

  void add(int n, const PixelBox& band, const std::uint8_t* rows, const std::uint8_t* covered,
           LightSums& sums, std::mutex& adding) const {
    const auto width = static_cast<std::size_t>(band.width());
    std::vector<std::uint8_t> whole;
    std::vector<double> even(width);
    const double blue_share = LampShares{process_}.blue(n) * back_.times(n),
                 uv_share = LampShares{process_}.uv(n);
    for (int y = band.y0; y < band.y1; ++y, rows += width, covered += width) {
      if (std::all_of(rows, rows + width, [](std::uint8_t p) { return p == 0; }) &&
          std::all_of(covered, covered + width, [](std::uint8_t p) { return p == 0; })) {
        continue;
      }
      even_->uv_of_row(n, band.x0, y, even);
      if (uv_images_) {
        whole.assign(static_cast<std::size_t>(images_.width_px), 0);
        std::copy_n(rows, width, whole.begin() + band.x0);
        uv_images_->make_row(n, y, whole);
      }
      const PixelPlaces::Place& row = down_.of_pixel[static_cast<std::size_t>(y)];
      const std::lock_guard lock(adding);
      for (std::size_t i = 0; i < width; ++i) {
        if (rows[i] == 0 && covered[i] == 0) continue;
        const auto x = static_cast<std::size_t>(band.x0) + i;
        const PixelPlaces::Place& column = across_.of_pixel[x];
        const std::size_t cell = row.cell * columns_ + column.cell;
        sums.part[cell] += covered[i];
        const std::int32_t share = LitPart::lit(rows[i], covered[i]);
        if (share == 0) continue;
        const double factor = map_.factor(map_.value(static_cast<int>(x), y));
        const std::int64_t blue = std::llround(blue_of_[rows[i]] * factor * blue_share);
        const double uv_factor = uv_map_.factor(uv_map_.value(static_cast<int>(x), y));
        const std::int64_t uv =
            uv_images_ ? std::llround(uv_of_[whole[x]] * uv_share * uv_factor) : 0;
        sums.lit[cell] += share;
        sums.blue[cell] += share * blue;
        sums.uv[cell] += share * uv;
        const double differs = static_cast<double>(blue) / kLightUnit - even[i] / 255 * full_;
        if (std::abs(differs) > 0.5 * (full_ / 255 + step_) * (1 + 1e-9)) {
          sums.own_blue[cell] += share * blue;
          sums.own_uv[cell] += share * uv;
          continue;
        }
        sums.followed[cell] += share;
        for (std::size_t k = 0; k < 9; ++k) {
          const double of_cell = row.shares[k / 3] * column.shares[k % 3];
          // NOLINTNEXTLINE(bugprone-incorrect-roundings): never below 0, and lround is a call.
          sums.shares[cell][k] += share * static_cast<std::int32_t>(of_cell * kShareUnit + 0.5);
        }
      }
    }
  }

 private:
  static std::vector<double> units(const std::vector<double>& levels) {
    std::vector<double> of_pixel;
    for (int pixel = 0; pixel < 256; ++pixel) {
      const int level =
          level_of_pixel(static_cast<std::uint8_t>(pixel), static_cast<int>(levels.size()));
      of_pixel.push_back(levels[static_cast<std::size_t>(level)] * kLightUnit);
    }
    return of_pixel;
  }

  const Grid& images_;
  std::size_t columns_;
  PixelPlaces across_, down_;
  LightMap map_, uv_map_;
  EvenLight even_light_;  ///< with curing light in place of UV light
  const Process& process_;
  EvenBack back_;
  std::optional<EvenPixels> even_;
  std::vector<double> blue_, blue_of_, uv_of_;
  double full_ = 0, step_ = 0;
  std::optional<EvenUvImages> uv_images_;
};

CellLight mean_light(const LightSums& sums, double schedule_uv, bool uv_by_place) {
  CellLight cells;
  ImageLight image;
  image.uv = uv_by_place;
  double lit = 0, part = 0;
  for (std::size_t c = 0; c < sums.lit.size(); ++c) {
    const double pixels = std::max(1, sums.lit[c]);
    const auto mean = [&](std::int64_t sum) {
      return static_cast<double>(sum) / kLightUnit / pixels;
    };
    cells.blue.push_back(mean(sums.blue[c]));
    cells.uv.push_back(uv_by_place ? mean(sums.uv[c]) : schedule_uv);
    image.blue_mw_cm2.push_back(mean(sums.own_blue[c]));
    image.uv_mw_cm2.push_back(mean(sums.own_uv[c]));
    std::array<float, 9>& shares = image.shares.emplace_back();
    double all = 0;
    for (const std::int32_t share : sums.shares[c]) all += share;
    for (std::size_t k = 0; all > 0 && k < 9; ++k) {
      shares[k] = static_cast<float>(sums.shares[c][k] / all * sums.followed[c] / pixels);
    }
    // Cells in which light goes on beyond the end of features are lit by more than is part.
    lit += std::min(sums.lit[c], sums.part[c]);
    part += sums.part[c];
  }
  cells.lit = part > 0 ? lit / part : 0;
  cells.image = std::make_shared<const ImageLight>(std::move(image));
  return cells;
}

}  // namespace

std::vector<CellLight> shown_cells(const SliceSource& shown, const SliceSource& target,
                                   const FlowGrid& grid, const std::vector<int>& slices,
                                   const Setup& setup, const ExecutionContext& context) {
  std::vector<LightSums> sums(slices.size());
  for (LightSums& s : sums) {
    for (auto* v : {&s.blue, &s.uv, &s.own_blue, &s.own_uv}) v->assign(grid.cells(), 0);
    for (auto* v : {&s.lit, &s.part, &s.followed}) v->assign(grid.cells(), 0);
    s.shares.assign(grid.cells(), {});
  }
  const LightAdder adder(setup, shown.grid(), shown.frame(), grid);
  const auto index_of = [&](int n) {
    const auto at = std::lower_bound(slices.begin(), slices.end(), n);
    const bool asked = at != slices.end() && *at == n;
    return asked ? static_cast<std::size_t>(at - slices.begin()) : slices.size();
  };
  const auto bands = bands_of(shown.grid(), shown.bounds());
  std::mutex adding;
  parallel_for(context, "look at the light", bands.size(), [&](std::size_t b) {
    const PixelBox& band = bands[b];
    const std::vector<std::uint8_t> none(columns_of(band), 0);
    std::vector<std::vector<std::uint8_t>> part(slices.size());
    target.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::size_t i = index_of(n);
      if (rows && i < slices.size()) part[i].assign(rows, rows + none.size());
    });
    shown.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::size_t i = index_of(n);
      if (i == slices.size() || (!rows && part[i].empty())) return;
      adder.add(n, band, rows ? rows : none.data(), part[i].empty() ? none.data() : part[i].data(),
                sums[i], adding);
    });
  });
  std::vector<CellLight> result;
  const std::vector<double>& schedule = setup.process.uv.slice_mw_cm2;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const auto n = std::min(static_cast<std::size_t>(slices[i]), schedule.size() - 1);
    result.push_back(mean_light(sums[i], schedule[n] * LampShares{setup.process}.uv(slices[i]),
                                setup.process.even_light->uv != nullptr));
    sums[i] = {};
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
  const DoseSummary s = summarise(section, dose);
  FrontDose front{s.min, s.mean, s.max, s.within_10, s.max_window, kMostGapUm, 0};
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
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

namespace detail {

std::vector<std::vector<int>> in_parts(const std::vector<int>& slices, const FlowGrid& grid) {
  constexpr double kMostBytes = 256e6, kCellBytes = 250;
  const double at_once = kMostBytes / (kCellBytes * static_cast<double>(grid.cells()));
  const auto most = static_cast<std::size_t>(std::max(4.0, at_once));
  std::vector<std::vector<int>> parts;
  for (std::size_t first = 0; first < slices.size(); first += most) {
    const std::size_t past = std::min(slices.size(), first + most);
    parts.emplace_back(slices.begin() + static_cast<std::ptrdiff_t>(first),
                       slices.begin() + static_cast<std::ptrdiff_t>(past));
  }
  return parts;
}

std::vector<int> judged_slices(const EvenLight& light) {
  std::vector<int> slices;
  for (const int n : light.slices) {
    // Where nothing was looked at in between, light is only as good as sections change slowly.
    if (!slices.empty() && n - slices.back() > 1) slices.push_back((slices.back() + n) / 2);
    slices.push_back(n);
  }
  return slices;
}

FlowDoses judge_light(const EvenSections& sections, const std::vector<int>& slices,
                      const std::vector<CellLight>& lights, const SliceSource& target,
                      const Setup& setup, const ExecutionContext& context) {
  const EvenLight& light = *setup.process.even_light;
  FlowDoses doses;
  doses.gap_um = light.gap_um;
  const double speed_um_s = units::cm_s_from_mm_h(setup.process.speed_mm_h) * 1e4;
  const Kinetics& kinetics = sections.resin().kinetics;
  // The best intensities that are the same everywhere.
  SectionGoal goal;
  goal.pattern = FlowPattern::constant;
  goal.min_gap_um = goal.max_gap_um = light.gap_um;
  goal.max_blue_mw_cm2 = even_blue_cap(target, setup);
  goal.max_uv_mw_cm2 = even_uv_cap(setup);
  std::vector<std::optional<FlowDoses::Slice>> found(slices.size());
  const ExecutionContext alone = detail::silent(context);
  parallel_for(context, "dose in flowing resin", found.size(), [&](std::size_t i) {
    const int n = slices[i];
    if (n >= sections.part().slices() || !sections.can_be_solved(n)) return;
    const CellLight& cells = lights[i];
    const std::size_t mask = sections.mask_of(n);
    const FlowSection section = sections.section(mask);
    const GapPressure pressure = sections.pressure(mask, alone);
    const SectionSweep sweep(section, pressure, sections.resin(), setup.process.speed_mm_h,
                             std::vector{light.gap_um});
    SectionGoal constant = goal;
    constant.image = cells.image;
    const SectionOptimum best = optimise_section(section, pressure, sections.resin(),
                                                 setup.process.speed_mm_h, constant, alone);
    FlowDoses::Slice slice;
    slice.slice = n;
    slice.area_mm2 = part_area_mm2(section);
    slice.lit = cells.lit;
    slice.even = front_dose(section, sweep, cells, kinetics, light.gap_um, speed_um_s);
    const CellLight same{cells.image->of_blue(section, best.blue_mw_cm2),
                         cells.image->of_uv(section, best.uv_mw_cm2)};
    slice.without = front_dose(section, sweep, same, kinetics, light.gap_um, speed_um_s);
    found[i] = slice;
  });
  for (const auto& slice : found) {
    if (slice) doses.slices.push_back(*slice);
  }
  return doses;
}

}  // namespace detail

FlowDoses flow_doses(const SliceSource& target, const SliceSource* shown, const Setup& asked,
                     const ExecutionContext& context) {
  using namespace detail;
  if (!asked.process.even_light) return {};
  if (light_spreads(asked.printer, asked.resin, asked.process)) {
    context.tell("what flowing resin gets is told for light that stays in its pixel");
  }
  const Setup setup = lit_setup(asked);
  const EvenLight& light = *setup.process.even_light;
  const std::vector<int> slices = judged_slices(light);
  std::optional<KeptImages> solved;
  if (!shown) shown = &solved.emplace(solved_images(target, setup, slices, nullptr, context));
  const WholeTarget whole(target);
  const EvenSections sections(LitPart(target, *shown), setup, {light.gap_um, light.pitch_um},
                              context);
  const FlowGrid& grid = sections.part().grid();
  if (grid.columns != light.columns || grid.rows != light.rows) {
    throw InputError("the even light of this stack was made for another part");
  }
  FlowDoses all;
  all.gap_um = light.gap_um;
  for (const std::vector<int>& some : in_parts(slices, grid)) {
    const FlowDoses doses =
        judge_light(sections, some, shown_cells(*shown, whole, grid, some, setup, context), target,
                    setup, context);
    all.slices.insert(all.slices.end(), doses.slices.begin(), doses.slices.end());
  }
  return all;
}

}  // namespace slicecorr
