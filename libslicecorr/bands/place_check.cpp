// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/place_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "bands/bands.hpp"
#include "bands/correct_spread.hpp"
#include "bands/robust_design.hpp"
#include "correct/coupled_plan.hpp"
#include "correct/inhibited_plan.hpp"
#include "cure/limits.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

const Printer& fitting(const Setup& setup, const SliceSource& target) {
  if (target.left_alone()) {
    std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
    features.push_back(Feature::left_alone);
    check_supported(features, setup.printer.name, setup.resin.name);
  }
  const Printer& printer = setup.printer;
  const Grid& grid = target.grid();
  // Archives made for a printer have the images of its display, ours those of its plate.
  const Grid wanted = images_of(printer, target.frame());
  if (grid.width_px != wanted.width_px || grid.height_px != wanted.height_px) {
    throw InputError(fmt::format("the slices are {} x {} pixels; printer '{}' has {} x {}",
                                 grid.width_px, grid.height_px, printer.name, wanted.width_px,
                                 wanted.height_px));
  }
  const auto differ = [](double a, double b) { return std::abs(a - b) > 0.01 * b; };
  if (differ(grid.pixel_x_um, wanted.pixel_x_um) || differ(grid.pixel_y_um, wanted.pixel_y_um)) {
    throw InputError(fmt::format(
        "the slices were made for pixels of {:g} x {:g} um; those of printer '{}' are {:g} x {:g} "
        "um",
        grid.pixel_x_um, grid.pixel_y_um, printer.name, wanted.pixel_x_um, wanted.pixel_y_um));
  }
  return printer;
}

namespace {

/// Slices that the stage can travel; nothing when it has no end.
std::optional<int> slices_of_travel(const Printer& printer, const CureModel& model) {
  const double layer_um = model.layer_um;
  if (printer.travel_mm <= 0) return std::nullopt;
  const double most_mm = printer.travel_mm * (1 + 1e-9);
  auto slices = static_cast<int>(std::min(1e9, std::floor(most_mm / (layer_um * 1e-3))));
  if (!model.heights.alike()) {
    const auto fits = [&](int n) { return model.heights.place_um(n, layer_um) * 1e-3 <= most_mm; };
    for (slices = 0; slices < 1'000'000 && fits(slices + 1);) ++slices;
    return slices;
  }
  while (slices > 0 && slices * layer_um * 1e-3 > most_mm) --slices;
  return slices;
}

/// dose_for_end() under UV light. There the slices added after the end depend on the level that
/// holds the dose, and so on the dose itself (`inhibited_slices`): the least dose is searched.
double inhibited_dose_for_end(const CureModel& model, int slices) {
  const InhibitedKernel& kernel = *model.inhibited();
  const int s = kernel.strongest_setting(), cap = kernel.highest_usable_level(s);
  const ExtraLight extra(kernel, InhibitedKernel::upper_end);
  const InhibitedTuning tuning;
  std::vector<double> doses;
  for (int level = 0; level <= cap; ++level) doses.push_back(kernel.steady_dose(s, level));
  const auto fits = [&](double times) {
    int steady = cap;
    while (steady > 0 && times * doses[static_cast<std::size_t>(steady - 1)] >= 1.0) --steady;
    const int lag = lag_of(tuning.end_lag_share, extra.peak(s, steady));
    const int full = slices - lag - tuning.spare_slices;
    return full > 0 && times * extra.sum(s, cap, full) >= 1.0;
  };
  const double lit = doses.back();
  if (!(lit > 0)) return std::numeric_limits<double>::infinity();
  for (double dose = 1; dose < 1e6; dose *= 1.01) {
    if (fits(dose / lit)) return dose;
  }
  return std::numeric_limits<double>::infinity();
}

/// The dose after a long run of slices that lit pixels must pass so that a part's end cures in so
/// many slices from slice `first` on; infinite when none is enough.
double dose_for_end(const CureModel& model, int first, int slices) {
  if (model.mode == ExposureMode::layerwise && !model.inhibited()) return 1.0;
  if (slices < 1) return std::numeric_limits<double>::infinity();
  if (model.inhibited()) {
    const double usual =
        model.heights.alike() ? slices : model.depth(first + slices) - model.depth(first);
    return inhibited_dose_for_end(model, static_cast<int>(usual));
  }
  if (model.gel_time()) {
    // Both doses are inversely proportional to the speed. One slice is to spare (slices_with_burst).
    const GelTimeKernel& kernel = *model.gel_time();
    const double full = kernel.level_mw_cm2(kernel.levels() - 1);
    const int last = std::max(1, slices - 1), bath = model.bath_slices;
    return std::max(1.0, long_run_dose(model, full) /
                             kernel.dose_at_end(full, bath > 0 ? std::min(last, bath) : last));
  }
  if (const BleachingLaw* const law = model.bleaching()) {
    // One slice is to spare here, too.
    const double length = std::max(1, slices - 1), gain = law->absorbed(1.0);
    const double most = 2 + 2 / (length * gain);
    return halved({1.0, most}, 60,
                  [&](double phi) { return law->after(0.0, length, phi * gain) < 1.0; })
        .high;
  }
  const double usual =
      model.heights.alike() ? slices : model.depth(first + slices) - model.depth(first);
  return std::max(1.0, model.steady(-1.0 / std::expm1(-usual * model.eta * units::kLn10)));
}

/// Per value of light: which columns the part lights, and up to which layer.
struct LitPlaces {
  LightCounts columns{};
  std::array<std::int32_t, 256> end;  ///< 1 more than the last lit layer
  std::array<Pixel, 256> first;       ///< in reading order

  LitPlaces() { end.fill(0); }
  void add(std::uint8_t value, Pixel pixel, std::int32_t lit_end) {
    const Pixel& f = first[value];
    const bool earlier = pixel.y < f.y || (pixel.y == f.y && pixel.x < f.x);
    if (columns[value] == 0 || earlier) first[value] = pixel;
    ++columns[value];
    end[value] = std::max(end[value], lit_end);
  }
  void merge(const LitPlaces& o) {
    for (std::size_t v = 0; v < 256; ++v) {
      if (o.columns[v] == 0) continue;
      const std::uint64_t sum = columns[v] + o.columns[v];
      add(static_cast<std::uint8_t>(v), o.first[v], o.end[v]);
      columns[v] = sum;
    }
  }
};

LitPlaces lit_places(const SliceSource& target, const LightMap& map,
                     const ExecutionContext& context) {
  const auto bands = bands_of(target.grid(), target.bounds());
  LitPlaces all;
  std::mutex merging;
  parallel_for(context, "find lit places", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    const std::size_t columns = columns_of(band);
    std::vector<std::int32_t> end(columns, 0);
    target.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      if (!rows) return;
      for (std::size_t k = 0; k < columns; ++k) end[k] = rows[k] ? n + 1 : end[k];
    });
    LitPlaces found;
    std::size_t k = 0;
    for (int y = band.y0; y < band.y1; ++y) {
      for (int x = band.x0; x < band.x1; ++x, ++k) {
        if (end[k] > 0) found.add(map.value(x, y), {x, y}, end[k]);
      }
    }
    const std::lock_guard lock(merging);
    all.merge(found);
  });
  return all;
}

/// The first pixel of a value in reading order.
Pixel first_of(const LightMap& map, const Grid& grid, std::uint8_t value) {
  for (int y = 0; y < grid.height_px; ++y) {
    for (int x = 0; x < grid.width_px; ++x) {
      if (map.value(x, y) == value) return {x, y};
    }
  }
  return {};
}

std::string share_in_words(const PlaceModels& models, std::uint8_t value) {
  if (models.paired()) {
    return fmt::format("{:.4g} of the light and {:.4g} of the UV light of the calibrations",
                       models.curing_factor(value), models.uv_factor(value));
  }
  return models.of_uv()
             ? fmt::format("{:.4g} of the UV light of the calibration", models.uv_factor(value))
             : fmt::format("{:.4g} of the light of the calibration", models.curing_factor(value));
}

/// Checks whether a target can be printed on a display; refuses with what would do for all places.
class PlaceCheck {
 public:
  PlaceCheck(const SliceSource& target, const PlaceModels& models, const Setup& setup,
             const ExecutionContext& context)
      : target_(target), models_(models), map_(models.map()), setup_(setup), context_(context) {
    check_stage_speed(setup.printer, setup.process);
    const Grid& grid = target.grid();
    travel_ = slices_of_travel(setup.printer, models.brightest());
    brightest_ = map_.reference();
    if (map_.even()) return;
    const LightCounts display = map_.counts({0, 0, grid.width_px, grid.height_px});
    brightest_ = 255;
    while (display[brightest_] == 0) --brightest_;
    // Of places that differ in two lights another may get more of black.
    for (std::size_t v = 1; models.paired() && v < display.size(); ++v) {
      const auto value = static_cast<std::uint8_t>(v);
      if (display[v] > 0 && !verdict_at(value, false).black.empty()) brightest_ = value;
    }
  }

  /// Slices that will be shown.
  int all_layers() {
    const int layers = target_.grid().layers;
    if (travel_ && layers > *travel_) {
      throw InfeasibleError(fmt::format(
          "the part is {:.3f} mm high; the stage of '{}' travels {} mm", height_mm(layers),
          setup_.printer.name, at_most(setup_.printer.travel_mm, 12)));
    }
    // Black must leave the resin liquid everywhere, lit or not; the brightest place fails first.
    if (!fine(brightest_)) refuse();
    int all = slices_with_burst(models_.model(brightest_), layers, layers - 1);
    if (!alike(all)) {
      // A dim place counts only where the part is lit.
      const LitPlaces& lit = lit_now();
      all = layers;
      for (std::size_t v = 0; v < 256; ++v) {
        if (lit.columns[v] == 0) continue;
        const auto value = static_cast<std::uint8_t>(v);
        if (!fine(value)) refuse();
        all = std::max(all, slices_with_burst(models_.model(value), layers, lit.end[v] - 1));
      }
    }
    if (travel_ && all > *travel_) refuse_travel(all);
    const int edges = layers + slices_for_edges();
    all = std::max(all, travel_ ? std::min(edges, *travel_) : edges);
    // The part's end may lie half a slice below its last node.
    const bool more = models_.brightest().is_continuous() && !(travel_ && all + 1 > *travel_) &&
                      target_.ends_below_last_node();
    if (more) ++all;
    if (setup_.uncertainty && setup_.uncertainty->robust) {
      const int robust = all + robust_slices(models_.brightest());
      all = travel_ ? std::max(all, std::min(robust, *travel_)) : robust;
    }
    if (all - layers > kLongest) {
      throw InfeasibleError(fmt::format(
          "the part's end does not cure: light of black comes too close to full light for any "
          "number of slices after it; {}",
          ways()));
    }
    return all;
  }

 private:
  /// Slices that the edges of the last layer ask for where columns are corrected together.
  int slices_for_edges() {
    const CureModel& model = models_.brightest();
    if (!spreads(setup_) || setup_.process.spread_rounds == 0 || target_.left_alone()) return 0;
    if (!can_couple(model)) return 0;
    // Layer by layer each layer cures by its own light; under UV light its kernel has the slices.
    if (!model.inhibited() && model.mode == ExposureMode::layerwise) return 0;
    std::optional<SpreadLight> light;
    if (!want_their_light(model)) light.emplace(models_, target_.grid(), target_.frame());
    const auto slices = [&](CureModel of) {
      if (want_their_light(of)) return slices_to_gel_at_edges_by_columns(of);
      // Slices after the end may count for less than others.
      double least = of.ratio(std::numeric_limits<int>::max());
      const int layers = target_.grid().layers;
      for (std::size_t n = static_cast<std::size_t>(layers); n < of.exposure_ratio.size(); ++n) {
        least = std::min(least, of.exposure_ratio[n]);
      }
      for (double& phi : of.level_phi) phi *= least;
      of.exposure_ratio.clear();
      return slices_to_gel_at_edges(of, light->blur(), light->distances());
    };
    if (map_.even()) return slices(model);
    // The dimmest place that is lit asks for the most.
    const LitPlaces& lit = lit_now();
    if (models_.paired()) {
      // They are in no order of doses.
      int most = 0;
      for (std::size_t v = 1; v < lit.columns.size(); ++v) {
        if (lit.columns[v] > 0) {
          most = std::max(most, slices(models_.model(static_cast<std::uint8_t>(v))));
        }
      }
      return most;
    }
    const auto dimmest = std::find_if(lit.columns.begin() + 1, lit.columns.end(),
                                      [](std::uint64_t columns) { return columns > 0; });
    if (dimmest == lit.columns.end()) return 0;
    return slices(models_.model(static_cast<std::uint8_t>(dimmest - lit.columns.begin())));
  }
  Verdict verdict_at(std::uint8_t value, bool lit) const {
    return verdict({&models_.model(value), models_.curing_factor(value), lit},
                   models_.printer_at(value),
                   models_.of_uv() ? models_.process_at(value) : setup_.process);
  }
  bool fine(std::uint8_t value) const {
    if (value == 0) return false;
    const Verdict v = verdict_at(value, true);
    return v.weak.empty() && v.black.empty();
  }
  /// Whether all places that the part may be lit at need the same.
  bool alike(int all) const {
    if (map_.even()) return true;
    const int layers = target_.grid().layers;
    const LightCounts part = map_.counts(target_.bounds());
    for (std::size_t v = 0; v < 256; ++v) {
      const auto value = static_cast<std::uint8_t>(v);
      if (part[v] == 0) continue;
      if (!fine(value) || slices_with_burst(models_.model(value), layers, layers - 1) != all) {
        return false;
      }
    }
    return true;
  }
  const LitPlaces& lit_now() {
    if (lit_) return *lit_;
    if (map_.even()) {
      lit_.emplace();
      lit_->columns[brightest_] = 1;
      lit_->end[brightest_] = target_.grid().layers;
    } else {
      lit_ = lit_places(target_, map_, context_);
    }
    return *lit_;
  }

  /// The brightest place and all that are lit, with what they need to end within the travel.
  std::vector<LitPlace> places() {
    const LitPlaces& lit = lit_now();
    const bool none = std::all_of(lit.columns.begin(), lit.columns.end(),
                                  [](std::uint64_t columns) { return columns == 0; });
    std::vector<LitPlace> all;
    for (std::size_t v = 1; v < 256; ++v) {
      const auto value = static_cast<std::uint8_t>(v);
      if (lit.columns[v] == 0 && value != brightest_) continue;
      LitPlace p{&models_.model(value), models_.curing_factor(value), none || lit.columns[v] > 0};
      // Without a limit of travel a part's end must still cure within some number of slices.
      const int most = travel_ ? *travel_ - lit.end[v] : kLongest;
      if (p.lit) p.needed = dose_for_end(*p.model, lit.end[v], most);
      all.push_back(p);
    }
    return all;
  }
  std::string ways() {
    // Ways out are known for one UV light.
    if (models_.of_uv()) return "expected a part, a speed or UV light that suits all of its places";
    return ways_out(places(), as_lit(setup_.printer, setup_.process), setup_.process);
  }

  [[noreturn]] void refuse() {
    const LitPlaces& lit = lit_now();
    const std::string& name = setup_.printer.name;
    if (lit.columns[0] > 0) {
      throw InfeasibleError(fmt::format(
          "the part lies where the flat-field of printer '{}' says that there is no light: {} "
          "pixels, the first {}, {}; expected a part beside them, or another flat-field",
          name, lit.columns[0], lit.first[0].x, lit.first[0].y));
    }
    std::uint64_t weak_pixels = 0, pixels = 0;
    std::optional<std::uint8_t> dimmest;
    for (std::size_t v = 0; v < 256; ++v) {
      const auto value = static_cast<std::uint8_t>(v);
      if (lit.columns[v] == 0) continue;
      pixels += lit.columns[v];
      if (verdict_at(value, true).weak.empty()) continue;
      if (!dimmest) dimmest = value;
      weak_pixels += lit.columns[v];
    }
    std::string text;
    if (dimmest) {
      const Pixel p = lit.first[*dimmest];
      text = verdict_at(*dimmest, true).weak;
      if (!map_.even()) {
        const std::string share = share_in_words(models_, *dimmest);
        text =
            models_.of_uv()
                ? fmt::format(
                      "the UV light of printer '{}' does not suit all places of this part: it fails "
                      "at {} of its pixels, one of them {}, {}, which gets {}: {}",
                      name, weak_pixels, p.x, p.y, share, text)
                : fmt::format(
                      "the light of printer '{}' is {} for this part: it fails at {} of its pixels, "
                      "the dimmest {}, {}, which gets {}: {}",
                      name, weak_pixels < pixels ? "too uneven" : "too weak", weak_pixels, p.x, p.y,
                      share, text);
      }
    }
    if (const std::string black = verdict_at(brightest_, false).black; !black.empty()) {
      if (!text.empty()) text += "; ";
      if (!map_.even()) {
        const Pixel p = first_of(map_, target_.grid(), brightest_);
        text +=
            fmt::format("at the brightest place of the display, pixel {}, {}, which gets {}: ", p.x,
                        p.y, share_in_words(models_, brightest_));
      }
      text += black;
    }
    // Where no lit place is too weak, the brightest place itself is: nothing could be lit there.
    if (text.empty()) text = verdict_at(brightest_, true).weak;
    throw InfeasibleError(text + "; " + ways());
  }

  double height_mm(int layers) const {
    return models_.brightest().depth(layers) * models_.brightest().layer_um * 1e-3;
  }

  [[noreturn]] void refuse_travel(int slices) {
    const Grid& grid = target_.grid();
    const Printer& printer = setup_.printer;
    const double travel_mm = height_mm(slices);
    std::string text = fmt::format(
        "curing the part's end takes {} slices after it, {:.3f} mm in all; the stage of '{}' "
        "travels {} mm; {}",
        slices - grid.layers, travel_mm, printer.name, at_most(printer.travel_mm, 12), ways());
    // Each layer less needs one slice less.
    const int less = slices - *travel_;
    if (less < grid.layers) {
      const double lower_um = models_.brightest().heights.alike()
                                  ? less * grid.layer_um
                                  : (travel_mm - height_mm(*travel_)) * 1e3;
      const double lower_mm = std::ceil(lower_um - 1e-6) * 1e-3;
      text += fmt::format(", or make the part at least {:.3f} mm lower", lower_mm);
    }
    throw InfeasibleError(text);
  }

  const SliceSource& target_;
  const PlaceModels& models_;
  const LightMap& map_;
  const Setup& setup_;
  const ExecutionContext& context_;
  std::optional<int> travel_;
  std::uint8_t brightest_ = 255;
  std::optional<LitPlaces> lit_;
  /// Most slices after a part's end where the stage's travel sets no limit.
  static constexpr int kLongest = 90000;
};

}  // namespace

int slices_to_show(const SliceSource& target, const PlaceModels& models, const Setup& setup,
                   const ExecutionContext& context) {
  return PlaceCheck(target, models, setup, context).all_layers();
}

}  // namespace slicecorr::detail
