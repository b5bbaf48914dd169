// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/uncertain_walk.hpp"

#include <algorithm>
#include <memory>
#include <vector>

#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

namespace {

/// Where parts of so many columns begin that anything is designed in.
std::vector<std::size_t> starts_of_parts(const CodedBand& coverage, std::size_t columns,
                                         std::size_t width) {
  std::vector<bool> designed((columns + width - 1) / width, false);
  std::vector<NonZero> lit;
  for (int n = 0; n < coverage.slices(); ++n) {
    if (n > 0 && coverage.same(n, n - 1)) continue;
    coverage.read_nonzero(n, lit);
    for (const NonZero& pixel : lit) designed[pixel.at / width] = true;
  }
  std::vector<std::size_t> starts;
  for (std::size_t p = 0; p < designed.size(); ++p) {
    if (designed[p]) starts.push_back(p * width);
  }
  return starts;
}

}  // namespace

UncertainTotal::UncertainTotal(const Setup& setup, const PlaceModels& models, const PixelBox& box)
    : uncertainty_(*setup.uncertainty), models_(models), maps_(box) {
  check_uncertainty(uncertainty_);
  check_uncertain(setup);
  total_.inputs = uncertainty_;
  nearby(models.map().greatest());  // what can't be said is refused before the work
}

Process with_known_uv(const PlaceModels& models, std::uint8_t value) {
  Process process = models.process_at(value);
  // A pattern is that of the place which it is made for: here it holds a thicker dead zone.
  if (process.uv.kind == UvKind::patterned && !process.even_light) {
    return with_pattern_held(process, models.resin(), models.resin(),
                             1 / models.light_held_of(value));
  }
  if (process.uv.kind != UvKind::constant) return process;
  // What is asked of a lamp that fades is known.
  if (!process.uv_lamp_share.empty() && process.uv.uv_mw_cm2 > 0) {
    process.uv.dead_zone_um = 0;
    return process;
  }
  const InhibitedKernel& kernel = *models.model(value).inhibited();
  process.uv.uv_mw_cm2 = kernel.setting_uv_mw_cm2(0, 0) * kernel.blue_share(0);
  process.uv.dead_zone_um = 0;
  return process;
}

bool pulses_differ(const PlaceModels& models, const Uncertainty& u) {
  return models.printer().grey == GreyLight::pulsed && models.resin().m != 1 &&
         (u.sd(UncertainInput::m) > 0 || u.sd(UncertainInput::stray) > 0);
}

std::unique_ptr<const NearbyModels> nearby_of_place(const PlaceModels& models, std::uint8_t value,
                                                    const Uncertainty& u) {
  const CureModel& model = models.model(value);
  if (derives_by_recursion(model) && !pulses_differ(models, u)) return nullptr;
  const bool exponent = u.sd(UncertainInput::m) > 0;
  return std::make_unique<const NearbyModels>(
      nearby_models(models.printer_at(value), models.resin(), with_known_uv(models, value),
                    model.layer_um, exponent ? u.reference_mw_cm2 : 0));
}

const NearbyModels* UncertainTotal::nearby(std::uint8_t value) const {
  const std::lock_guard lock(making_);
  if (!made_[value]) {
    made_[value] = true;
    nearby_[value] = nearby_of_place(models_, value, uncertainty_);
  }
  return nearby_[value].get();
}

UncertainBand UncertainTotal::band(std::uint8_t value, int all_layers, std::size_t columns,
                                   bool at_heights) const {
  UncertainBand band(models_.model(value), uncertainty_, all_layers, columns, nearby(value));
  if (at_heights) band.aim_at_heights();
  return band;
}

void UncertainTotal::add(UncertainBand& band, const BandPredictor::PixelOfColumn& place) {
  UncertainPrint figures;
  band.finish(place, figures);
  maps_.add(band.sides(), place);
  const std::lock_guard lock(merging_);
  total_.merge(figures);
}

void UncertainTotal::add(const DesignGroup& group, const Walked& slices, const CodedDesign& design,
                         const ExecutionContext& context) {
  const std::size_t columns = group.columns;
  // A few columns at a time, so that what is known of them stays in the nearest caches; their slices
  // are read some at a time.
  constexpr std::size_t width = 256;
  constexpr int most = 32;
  const std::vector<std::size_t> starts = starts_of_parts(design.coverage, columns, width);
  UncertainPrint figures;
  std::vector<UncertainBand> bands;
  for (const std::size_t from : starts) {
    bands.push_back(
        band(group.value, slices.all_layers, std::min(width, columns - from), slices.at_heights));
    bands.back().add_to(figures);
  }
  LeftAloneRows left_alone(design.left_alone);
  std::vector<std::uint8_t> row(columns), room(columns);
  struct Rows {
    bool none = true;
    std::vector<std::uint8_t> bytes;
    void take(const std::uint8_t* from, std::size_t n) {
      none = from == nullptr;
      if (from) bytes.assign(from, from + n);
    }
    const std::uint8_t* at(std::size_t column) const { return none ? nullptr : &bytes[column]; }
  };
  std::vector<Rows> pixels(most), coverage(most), heights(most);
  for (int end = slices.all_layers; end > 0; end -= most) {
    context.check_cancelled();
    const int first = std::max(0, end - most);
    for (int n = first; n < end; ++n) {
      const auto k = static_cast<std::size_t>(n - first);
      pixels[k].take(slices.shown(n), columns);
      design.coverage.read(n, row.data());
      coverage[k].take(marked(row.data(), left_alone.at(n), room), columns);
      heights[k].take(design.heights_at(n, row.data()), columns);
    }
    for (std::size_t b = 0; b < bands.size(); ++b) {
      for (int n = end; n-- > first;) {
        const auto k = static_cast<std::size_t>(n - first);
        bands[b].add_slice(n, pixels[k].at(starts[b]), coverage[k].at(starts[b]),
                           heights[k].at(starts[b]));
      }
    }
  }
  for (std::size_t b = 0; b < bands.size(); ++b) {
    const auto place_in_part = [&](std::size_t column) { return group.place(starts[b] + column); };
    bands[b].finish(place_in_part, figures);
    maps_.add(bands[b].sides(), place_in_part);
  }
  const std::lock_guard lock(merging_);
  total_.merge(figures);
}

std::shared_ptr<const UncertainPrint> UncertainTotal::result(
    const std::optional<RobustFigures>& robust) const {
  auto print = std::make_shared<UncertainPrint>(total_);
  print->robust = robust;
  print->maps = std::make_shared<const SurfaceMaps>(maps_.maps());
  return print;
}

}  // namespace slicecorr::detail
