// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/uncertain_walk.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/supports.hpp"

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

UncertainTotal::UncertainTotal(const Setup& setup, double layer_um, const PixelBox& box)
    : uncertainty_(*setup.uncertainty), maps_(box) {
  check_uncertainty(uncertainty_);
  check_uncertain(setup);
  total_.inputs = uncertainty_;
  Process process = setup.process;
  if (process.uv.kind == UvKind::off) return;
  if (process.uv.kind == UvKind::constant && !(process.uv.uv_mw_cm2 > 0)) {
    // The lamp gives what was found for the dead zone, whatever the resin then turns out to be.
    process.uv.uv_mw_cm2 = uv_for_dead_zone(make_kinetics(setup.resin, true, true),
                                            setup.printer.calibration.back().intensity_mw_cm2,
                                            process.uv.dead_zone_um);
    process.uv.dead_zone_um = 0;
  }
  const bool exponent = uncertainty_.sd(UncertainInput::m) > 0;
  nearby_ = nearby_models(setup.printer, setup.resin, process, layer_um,
                          exponent ? uncertainty_.reference_mw_cm2 : 0);
}

UncertainBand UncertainTotal::band(const CureModel& model, int all_layers, std::size_t columns,
                                   bool at_heights) const {
  UncertainBand band(model, uncertainty_, all_layers, columns, nearby_ ? &*nearby_ : nullptr);
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

void UncertainTotal::add(const CureModel& model, std::size_t columns, const ShownSlice& shown,
                         const CodedDesign& design, int all_layers, bool at_heights,
                         const BandPredictor::PixelOfColumn& place,
                         const ExecutionContext& context) {
  // A few columns at a time, so that what is known of them stays in the nearest caches; their slices
  // are read some at a time.
  constexpr std::size_t width = 256;
  constexpr int most = 32;
  const std::vector<std::size_t> starts = starts_of_parts(design.coverage, columns, width);
  UncertainPrint figures;
  std::vector<UncertainBand> bands;
  for (const std::size_t from : starts) {
    bands.push_back(band(model, all_layers, std::min(width, columns - from), at_heights));
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
  for (int end = all_layers; end > 0; end -= most) {
    context.check_cancelled();
    const int first = std::max(0, end - most);
    for (int n = first; n < end; ++n) {
      const auto k = static_cast<std::size_t>(n - first);
      pixels[k].take(shown(n), columns);
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
    const auto place_in_part = [&](std::size_t column) { return place(starts[b] + column); };
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
