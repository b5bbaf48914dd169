// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/oxygen_step.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "bands/bands.hpp"
#include "bands/design_band.hpp"
#include "base/coded_band.hpp"
#include "chemistry/even_oxygen.hpp"
#include "cure/shown_slices.hpp"
#include "parallel/silent.hpp"
#include "pipeline/corrected_info.hpp"
#include "pipeline/shortcomings.hpp"
#include "pipeline/target_scan.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/print_file.hpp"

namespace slicecorr {

namespace {

using detail::bands_of;
using detail::CodedBand;
using detail::columns_of;
using detail::OxygenImage;
using detail::OxygenLight;

constexpr const char* kMark = ", oxygen evened out";
/// Slices that are reckoned before any of them is kept.
constexpr int kBlock = 16;
/// Measured on one core of some 2.5 GHz: cells that the judge steps in a second, and cells that pass one filter.
constexpr double kCellStepsPerS = 15e6, kFilteredPerS = 8e6;

[[noreturn]] void refuse(const std::string& what) {
  throw InputError("oxygen is evened out " + what);
}

double spread_um(const Printer& printer) {
  return printer.spread.none() ? 0 : printer.spread.gaussians.front().sigma_um;
}

/// Share of the light at the window that comes to the far edge of a layer.
double share_at_far_edge(const Resin& resin, double layer_um) {
  return std::pow(10.0, -layer_um / resin.absorbance_height10_um);
}

OxygenLight light_of(const Setup& setup, const Grid& grid, const OxygenAsk& ask) {
  OxygenLight light;
  light.cell_um = grid.pixel_x_um;
  light.spread_um = spread_um(setup.printer);
  light.margin = ask.margin;
  light.steps = ask.steps;
  const double share = share_at_far_edge(setup.resin, grid.layer_um);
  for (const double i : level_intensities(as_lit(setup.printer, setup.process)))
    light.level_mw_cm2.push_back(share * i);
  return light;
}

/// A plane this wide or more is transformed fast.
int fast_length(int least) {
  for (int n = least;; ++n) {
    int rest = n;
    for (const int prime : {2, 3, 5}) {
      while (rest % prime == 0) rest /= prime;
    }
    if (rest == 1) return n;
  }
}

/// The slices of a print, changed one by one.
class EvenSlices {
 public:
  EvenSlices(const SliceSource& shown, const SliceSource& target, const Setup& setup,
             const OxygenAsk& ask, const ExecutionContext& context)
      : chemistry_(*setup.resin.chemistry),
        process_(setup.process),
        levels_(setup.printer.levels()),
        light_(light_of(setup, shown.grid(), ask)),
        bands_(bands_of(shown.grid(), shown.bounds())),
        slices_(shown.grid().layers) {
    shown_.reserve(bands_.size());
    for (const PixelBox& band : bands_) {
      box_ = box_.united(band);
      shown_.emplace_back(columns_of(band));
      solid_.emplace_back(columns_of(band));
      even_.emplace_back(columns_of(band));
    }
    parallel_for(context, "correct", bands_.size(), [&](std::size_t i) {
      shown_[i] = detail::coded_band_of(shown, bands_[i]);
      std::vector<std::uint8_t> room(columns_of(bands_[i]));
      target.read_band(bands_[i], [&](int, const std::uint8_t* rows) {
        if (rows) {
          std::transform(rows, rows + room.size(), room.begin(),
                         [](std::uint8_t v) { return static_cast<std::uint8_t>(v >= 128); });
        }
        solid_[i].append(rows ? room.data() : nullptr);
      });
    });
  }

  OxygenEffort effort(const ExecutionContext& context) const;
  OxygenFigures even_out(const ExecutionContext& context);
  const std::vector<PixelBox>& bands() const { return bands_; }
  const CodedBand& band(std::size_t i) const { return even_[i]; }

 private:
  struct Image {
    OxygenImage cells;  ///< empty: nothing to gel
    PixelBox place;     ///< of the cells
  };

  double exposure_s(int n) const { return layer_exposure_s(process_, n); }
  /// Slices that show and mean the same as the one before.
  bool like_before(int n) const {
    if (n == 0 || exposure_s(n) != exposure_s(n - 1)) return false;
    for (std::size_t i = 0; i < bands_.size(); ++i) {
      const bool in_target = n < solid_[i].slices();
      if (!shown_[i].same(n, n - 1) || !in_target || !solid_[i].same(n, n - 1)) return false;
    }
    return true;
  }
  /// A slice over all bands.
  std::vector<std::uint8_t> whole(const std::vector<CodedBand>& coded, int n) const {
    std::vector<std::uint8_t> out(columns_of(box_));
    // Bands are as wide as the box.
    for (std::size_t i = 0; i < bands_.size(); ++i) {
      const auto row = static_cast<std::size_t>(bands_[i].y0 - box_.y0);
      coded[i].read(n, out.data() + row * static_cast<std::size_t>(box_.width()));
    }
    return out;
  }
  /// What of a slice is lit and solid, in box_.
  PixelBox lit_part(const std::vector<std::uint8_t>& shown) const;
  /// With dark round it.
  PixelBox place_of(const PixelBox& lit, double exposure_s) const {
    const int reach = detail::oxygen_reach(chemistry_, light_, exposure_s);
    PixelBox p{lit.x0 - reach, lit.y0 - reach, lit.x1 + reach, lit.y1 + reach};
    p.x1 = p.x0 + fast_length(p.width());
    p.y1 = p.y0 + fast_length(p.height());
    return p;
  }
  Image image_of(int n) const;
  void keep(int n, const std::vector<std::uint8_t>* changed);

  const Chemistry& chemistry_;
  const Process& process_;
  int levels_;
  OxygenLight light_;
  std::vector<PixelBox> bands_;
  PixelBox box_;
  int slices_;
  std::vector<CodedBand> shown_, solid_, even_;
};

PixelBox EvenSlices::lit_part(const std::vector<std::uint8_t>& shown) const {
  PixelBox lit{box_.x1, box_.y1, box_.x0, box_.y0};
  std::size_t k = 0;
  for (int y = box_.y0; y < box_.y1; ++y) {
    for (int x = box_.x0; x < box_.x1; ++x, ++k) {
      if (shown[k] == 0) continue;
      lit = {std::min(lit.x0, x), std::min(lit.y0, y), std::max(lit.x1, x + 1), y + 1};
    }
  }
  return lit;
}

EvenSlices::Image EvenSlices::image_of(int n) const {
  Image image;
  const std::vector<std::uint8_t> shown = whole(shown_, n), solid = whole(solid_, n);
  const PixelBox lit = lit_part(shown);
  if (lit.empty()) return image;
  image.place = place_of(lit, exposure_s(n));
  OxygenImage& cells = image.cells;
  cells.width = image.place.width();
  cells.height = image.place.height();
  cells.level.assign(columns_of(image.place), 0);
  cells.solid.assign(columns_of(image.place), 0);
  bool any = false;
  for (int y = lit.y0; y < lit.y1; ++y) {
    for (int x = lit.x0; x < lit.x1; ++x) {
      const auto from =
          static_cast<std::size_t>(y - box_.y0) * static_cast<std::size_t>(box_.width()) +
          static_cast<std::size_t>(x - box_.x0);
      const auto to =
          static_cast<std::size_t>(y - image.place.y0) * static_cast<std::size_t>(cells.width) +
          static_cast<std::size_t>(x - image.place.x0);
      cells.level[to] = static_cast<std::uint8_t>(level_of_pixel(shown[from], levels_));
      cells.solid[to] = solid[from] != 0 && shown[from] > 0 ? 1 : 0;
      any = any || cells.solid[to] != 0;
    }
  }
  return any ? image : Image{};
}

OxygenEffort EvenSlices::effort(const ExecutionContext& context) const {
  OxygenEffort e;
  for (int n = 0; n < slices_; ++n) {
    context.check_cancelled();
    if (like_before(n)) continue;
    const PixelBox lit = lit_part(whole(shown_, n));
    if (lit.empty()) continue;
    ++e.slices;
    const PixelBox place = place_of(lit, exposure_s(n));
    const auto cells = static_cast<double>(columns_of(place));
    const PatternSetup judge = detail::judging_setup(light_, exposure_s(n));
    const double steps = std::ceil(judge.light_s / step_of(chemistry_, judge));
    e.most_cells = std::max(e.most_cells, cells);
    e.bytes = std::max(
        e.bytes,
        static_cast<double>(pattern_bytes(place.width(), place.height(), chemistry_)) + 80 * cells);
    // The judge sees what was, what the search found, and what the rounds make of it.
    const int runs = 2 + light_.rounds;
    e.seconds += cells * (runs * steps / kCellStepsPerS + 2 * light_.steps / kFilteredPerS);
  }
  const int threads = std::min(thread_count(context), std::max(1, e.slices));
  e.seconds /= threads;
  e.bytes *= threads;
  return e;
}

void EvenSlices::keep(int n, const std::vector<std::uint8_t>* changed) {
  for (std::size_t i = 0; i < bands_.size(); ++i) {
    if (!changed) {
      even_[i].append_of(shown_[i], n);
      continue;
    }
    const auto row = static_cast<std::size_t>(bands_[i].y0 - box_.y0);
    even_[i].append(changed->data() + row * static_cast<std::size_t>(box_.width()));
  }
}

OxygenFigures EvenSlices::even_out(const ExecutionContext& context) {
  struct Made {
    std::vector<std::uint8_t> pixels;
    std::optional<detail::EvenOxygen> even;
  };
  OxygenFigures f;
  // A slice is small work: threads share slices, not cells.
  ExecutionContext alone = detail::silent(context);
  alone.threads = 1;
  Made last;
  detail::OxygenTally before, after;
  for (int first = 0; first < slices_; first += kBlock) {
    const int past = std::min(slices_, first + kBlock);
    std::vector<Made> made(static_cast<std::size_t>(past - first));
    parallel_for(detail::silent(context), "evening out oxygen", made.size(), [&](std::size_t k) {
      const int n = first + static_cast<int>(k);
      if (like_before(n)) return;
      const Image image = image_of(n);
      if (image.cells.level.empty()) return;
      detail::EvenOxygen even =
          detail::even_oxygen(chemistry_, image.cells, light_, exposure_s(n), alone);
      made[k].pixels = whole(shown_, n);
      const PixelBox& p = image.place;
      for (int y = std::max(p.y0, box_.y0); y < std::min(p.y1, box_.y1); ++y) {
        for (int x = std::max(p.x0, box_.x0); x < std::min(p.x1, box_.x1); ++x) {
          const auto at = static_cast<std::size_t>(y - p.y0) * static_cast<std::size_t>(p.width()) +
                          static_cast<std::size_t>(x - p.x0);
          made[k].pixels[static_cast<std::size_t>(y - box_.y0) *
                             static_cast<std::size_t>(box_.width()) +
                         static_cast<std::size_t>(x - box_.x0)] =
              static_cast<std::uint8_t>(pixel_of_level(even.level[at], levels_));
        }
      }
      made[k].even = std::move(even);
    });
    for (int n = first; n < past; ++n) {
      Made& slice = made[static_cast<std::size_t>(n - first)];
      if (!like_before(n)) {
        last = std::move(slice);
        f.distinct += last.even.has_value();
      }
      keep(n, last.even ? &last.pixels : nullptr);
      if (!last.even) continue;
      ++f.slices;
      f.voxels += last.even->solid;
      f.judged += last.even->judged;
      f.short_of_light += last.even->short_of_light;
      f.brightest = std::max(f.brightest, last.even->brightest);
      before.add(last.even->before);
      after.add(last.even->after);
    }
    context.report("evening out oxygen", static_cast<double>(past) / slices_);
  }
  const auto mean = [](double sum, std::size_t count) {
    return count > 0 ? sum / static_cast<double>(count) : 0;
  };
  f.missed_before = mean(before.missed, f.voxels);
  f.missed_after = mean(after.missed, f.voxels);
  f.least_before = before.least;
  f.least_after = after.least;
  f.cure_before = mean(before.cure, f.judged);
  f.cure_after = mean(after.cure, f.judged);
  f.off_before = mean(before.off, f.judged);
  f.off_after = mean(after.off, f.judged);
  f.behind_before = before.behind;
  f.behind_after = after.behind;
  f.dark_gelled_before = before.dark_gelled;
  f.dark_gelled_after = after.dark_gelled;
  return f;
}

std::string effort_in_words(const OxygenEffort& e) {
  const double minutes = e.seconds / 60;
  return fmt::format(
      "evening out oxygen: {} different slices of up to {:.0f} cells, at most some {} and {:.1f} MiB",
      e.slices, e.most_cells,
      minutes < 1 ? fmt::format("{:.0f} s", std::max(1.0, e.seconds))
                  : fmt::format("{:.0f} min", minutes),
      e.bytes / (1U << 20));
}

}  // namespace

void check_even_oxygen(const Setup& setup, const SliceSource& target, const OxygenAsk& ask) {
  const Process& process = setup.process;
  const Resin& resin = setup.resin;
  const Grid& grid = target.grid();
  if (!(ask.margin > 0 && ask.margin < 1) || ask.steps < 1 || ask.steps > 10000) {
    refuse(
        fmt::format("with a margin of {:g} and {} steps; expected a margin between 0 and 1, and "
                    "1 to 10000 steps",
                    ask.margin, ask.steps));
  }
  if (process.mode != ExposureMode::layerwise) {
    refuse(
        "layer by layer alone: in a continuous print a slice has moved on before oxygen comes "
        "from beside; expected a print layer by layer");
  }
  if (!resin.chemistry) {
    throw InputError(resin.name, "chemistry",
                     "missing; oxygen is evened out by it: expected a resin whose file has "
                     "[chemistry]");
  }
  const Chemistry& c = *resin.chemistry;
  if (!(c.oxygen_mol_l > 0)) {
    throw InputError(resin.name, "chemistry.oxygen_mol_l",
                     "is 0; expected oxygen, which is to be evened out");
  }
  if (!c.oxygen_um2_s || !c.initiator_um2_s) {
    throw InputError(resin.name, "chemistry",
                     "does not say how fast oxygen and initiator diffuse; expected viscosity_pa_s "
                     "with radii, or oxygen_diffusion_um2_s and initiator_diffusion_um2_s");
  }
  if (process.uv.kind != UvKind::off) refuse("without UV light; expected no UV light");
  if (target.doses()) refuse("without wanted doses; expected one of both");
  if (setup.uncertainty && setup.uncertainty->robust) {
    refuse("of corrections that are not robust; expected one of both");
  }
  if (setup.printer.flat_field) refuse("for a display with even light; expected no flat_field");
  if (resin.scatter_um2_per_um > 0) refuse("in resin that does not scatter; expected no scatter");
  if (setup.printer.spread.picture || setup.printer.spread.gaussians.size() > 1) {
    refuse("where light spreads as one Gaussian or not at all; expected such a blue.spread");
  }
  if (std::abs(grid.pixel_x_um - grid.pixel_y_um) > 1e-6 * grid.pixel_x_um) {
    refuse(fmt::format("on square pixels; those of the slices are {:g} x {:g} um", grid.pixel_x_um,
                       grid.pixel_y_um));
  }
  double shortest_s = std::numeric_limits<double>::infinity();
  for (int n = 0; n < grid.layers; ++n) {
    shortest_s = std::min(shortest_s, layer_exposure_s(process, n));
  }
  const double full = light_of(setup, grid, ask).level_mw_cm2.back();
  if (const double takes = inhibition_time_s(c, full); takes > shortest_s) {
    throw InfeasibleError(fmt::format(
        "full light does not use up the oxygen of a layer within {:g} s: at its far edge there are "
        "{:.4g} mW/cm², which take {:.4g} s; expected an exposure of that, or {:.4g} times the light",
        shortest_s, full, takes, takes / shortest_s));
  }
}

bool oxygen_is_even(const StackInfo& info) { return info.program.ends_with(kMark); }

OxygenCorrection correct_even_oxygen(const SliceSource& target, const Setup& asked,
                                     const StackFile& file, const CorrectionAsk& ask,
                                     const OxygenAsk& oxygen, const ExecutionContext& context) {
  Setup setup = asked;
  setup.printer = printer_for_file(asked.printer, file, target.grid(), context);
  const SlicesAlone alone(target);
  const SliceSource& wanted = setup.process.surface == Surface::mesh ? target : alone;
  check_even_oxygen(setup, wanted, oxygen);
  OxygenCorrection result;
  Correction& correction = result.correction;
  const auto shown = std::make_shared<const CorrectedSlices>(
      wanted, setup, context, std::filesystem::path(file.path).parent_path().string());
  const Grid& grid = shown->grid();
  detail::TargetScan scan(wanted);
  for (const PixelBox& band : bands_of(wanted.grid(), wanted.bounds())) {
    context.check_cancelled();
    scan.read(band, [](int, const std::uint8_t*) {});
    if (const auto left_alone = detail::left_alone_of(wanted, band)) scan.add(*left_alone);
  }
  EvenSlices slices(*shown, wanted, setup, oxygen, context);
  context.tell(effort_in_words(slices.effort(context)));
  result.oxygen = slices.even_out(context);

  StackWriter writer(file, grid, context);
  parallel_for(context, "encode", slices.bands().size(), [&](std::size_t i) {
    const PixelBox& band = slices.bands()[i];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    std::vector<std::uint8_t> rows(columns_of(band));
    for (int n = 0; n < grid.layers; ++n) {
      const bool black = slices.band(i).black(n);
      if (!black) slices.band(i).read(n, rows.data());
      encoder.put(n, band.x0, band.x1, black ? nullptr : rows.data());
    }
  });
  StackInfo& info = correction.info;
  scan.fill(info);
  info.program += kMark;
  detail::fill_corrected(info, grid, wanted, setup, file);
  correction.after = verify_stack(*shown, wanted, setup, context);
  if (ask.before) {
    const AsSliced as_sliced(wanted);
    correction.before = verify_stack(as_sliced, wanted, setup, context);
  }
  const PlaceModels models(setup.printer, setup.resin, setup.process, grid, wanted.frame());
  detail::tell_shortcomings(correction.after, models.brightest(), setup.process,
                            setup.printer.levels(), context);
  if (ask.before_writing) ask.before_writing(correction);
  writer.finish(info, scan.picture());
  return result;
}

std::string oxygen_in_words(const OxygenFigures& f) {
  std::string text = fmt::format(
      "oxygen in {} slices, {} of them different: light is up to {:.3g} times as bright\n"
      "  oxygen used up misses what is wanted by {:.1f} % on average, {:.1f} % without; at worst "
      "{:.0f} % of it, {:.0f} % without\n",
      f.slices, f.distinct, f.brightest, 100 * f.missed_after, 100 * f.missed_before,
      100 * f.least_after, 100 * f.least_before);
  if (f.short_of_light > 0) {
    text += fmt::format("  {} of {} voxels would need more light than there is\n", f.short_of_light,
                        f.voxels);
  }
  if (f.judged > 0) {
    text += fmt::format(
        "  full equations, of {} voxels that would gel in their own exposure: times to gel are off by "
        "{:.0f} % on average, {:.0f} % without the change; {} cure less than half as far as without "
        "diffusion, {} without; on average {:.0f} % of it, {:.0f} % without\n",
        f.judged, 100 * std::expm1(f.off_after), 100 * std::expm1(f.off_before), f.behind_after,
        f.behind_before, 100 * f.cure_after, 100 * f.cure_before);
  } else {
    text += "  no voxel gels in its own exposure alone: what later slices add is not followed\n";
  }
  text += fmt::format("  {} dark voxels gel, {} without the change\n", f.dark_gelled_after,
                      f.dark_gelled_before);
  return text;
}

}  // namespace slicecorr
