// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/dose_meter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <mutex>
#include <optional>

#include "bands/bands.hpp"
#include "bands/design_groups.hpp"
#include "bands/place_plans.hpp"
#include "cure/spread_band.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr::detail {

namespace {

/// Doses that are no sums: by walking up through slices of full light until nothing changes.
double most_by_walk(const CureModel& model) {
  constexpr int longest = 20000;
  constexpr double same = 1e-7;
  BandDose dose(model, 1);
  const double full = model.phi_max();
  ImageShowing showing;
  showing.phi = &full;
  double most = 0;
  for (int k = 0; k < longest; ++k) {
    // What slices count for is that of those after the last.
    dose.add_slice(std::numeric_limits<int>::max() / 2 - k, {&showing, 1});
    const double middle = *dose.middle();
    if (k > 0 && middle <= most * (1 + same)) return middle;
    most = middle;
  }
  return most;
}

/// The dose that full light for ever gives the middle of a layer; layer by layer that of all exposures
/// together, of the layer in which it is the greatest.
double most_dose(const CureModel& model) {
  if (const InhibitedKernel* const kernel = model.inhibited()) {
    double most = 0;
    for (int s = 0; s < kernel->settings(); ++s) {
      most = std::max(most, kernel->steady_middle_dose(s, kernel->highest_usable_level(s)));
    }
    return most;
  }
  if (!model.adds_up()) return most_by_walk(model);
  const double full = model.steady(model.phi_max());
  if (model.mode == ExposureMode::continuous) return full * model.greatest_ratio();
  double most = 0;
  for (int n = 0; n < static_cast<int>(std::max<std::size_t>(1, model.own_a.size())); ++n) {
    most = std::max(most, model.root_a_of(n) / model.one_minus_a_of(n));
  }
  return full * most;
}

}  // namespace

void check_doses(const DoseTarget& doses, const SliceSource& target, const PlaceModels& models,
                 const Setup& setup) {
  check_correction(setup, {target.left_alone() != nullptr, true});
  std::vector<Feature> features = features_of(models.brightest());
  features.push_back(Feature::wanted_doses);
  check_supported(features);
  const LightCounts part = models.map().counts(target.bounds());
  const double most = doses.scale.greatest();
  for (std::size_t v = 1; v < part.size(); ++v) {
    const auto value = static_cast<std::uint8_t>(v);
    if (part[v] == 0) continue;
    const CureModel& model = models.model(value);
    const bool layerwise = model.mode == ExposureMode::layerwise;
    const double reached = most_dose(model);
    if (most < reached) continue;
    if (layerwise) {
      throw InfeasibleError(fmt::format(
          "a dose of {:g} is wanted, and full light comes to {:.4g} in the middle of a layer; expose for "
          "more than {:.4g} s, or want a lower dose",
          most, reached, setup.process.exposure_s * most / reached));
    }
    throw InfeasibleError(fmt::format(
        "a dose of {:g} is wanted, and full light comes to {:.4g} at {:g} mm/h; a speed below {:.4g} "
        "mm/h would do, or a lower dose",
        most, reached, setup.process.speed_mm_h, setup.process.speed_mm_h * reached / most));
  }
}

std::vector<RegionDose> regions_of(const DoseTarget& doses) {
  std::vector<RegionDose> regions(doses.regions.size());
  for (std::size_t r = 0; r < regions.size(); ++r) regions[r].name = doses.regions[r];
  return regions;
}

void merge_regions(std::vector<RegionDose>& into, const std::vector<RegionDose>& from) {
  if (into.empty()) into = std::vector<RegionDose>(from.size());
  for (std::size_t r = 0; r < from.size(); ++r) {
    into[r].name = from[r].name;
    into[r].merge(from[r]);
  }
}

DoseMeter::DoseMeter(const WantedBand& wanted, const CureModel& model, const CodedBand& coverage)
    : wanted_(wanted),
      coverage_(coverage),
      dose_(model, coverage.columns()),
      black_(coverage.columns(), 0),
      cover_(coverage.columns()),
      bytes_(coverage.columns()),
      regions_(regions_of(*wanted.doses)) {}

void DoseMeter::add_slice(int slice, const std::uint8_t* pixels) {
  dose_.add_slice(slice, pixels ? pixels : black_.data());
  measure(slice);
}

void DoseMeter::add_slice(int slice, std::span<const ImageShowing> showings) {
  dose_.add_slice(slice, showings);
  measure(slice);
}

void DoseMeter::measure(int slice) {
  if (slice >= coverage_.slices() || coverage_.black(slice)) return;
  coverage_.read(slice, cover_.data());
  wanted_.bytes->read(slice, bytes_.data());
  const double* const middle = dose_.middle();
  const DoseTarget& doses = *wanted_.doses;
  for (std::size_t k = 0; k < cover_.size(); ++k) {
    if (cover_[k] != 255) continue;
    regions_[doses.region_of[bytes_[k]]].add(doses.scale.dose[bytes_[k]], middle[k]);
  }
}

std::vector<RegionDose> measure_doses(const SliceSource& stack, const SliceSource& target,
                                      const PlaceModels& models, const ShownSlices& slices,
                                      const ExecutionContext& context) {
  const DoseTarget& doses = *target.doses();
  std::vector<RegionDose> all = regions_of(doses);
  const auto bands = bands_of(target.grid(), target.bounds());
  const SpreadLight spread(models, stack.grid(), stack.frame());
  // Where light spreads, all columns of a band have one model.
  static const LightMap together;
  std::mutex merging;
  parallel_for(context, "measure doses", bands.size(), [&](std::size_t i) {
    // A model per value of light: columns of one value after the other.
    const DesignBand band(target, spread.none() ? models.map() : together, bands[i],
                          {.beside = &stack});
    for (const DesignGroup& g : band.groups()) {
      const CodedDesign design = g.coded(Surface::slices);
      DoseMeter meter(*g.doses, spread.none() ? models.model(g.value) : spread.model(),
                      design.coverage);
      std::optional<SpreadBand> light;
      if (!spread.none()) light.emplace(spread, stack, slices, bands[i]);
      std::vector<std::uint8_t> pixels(g.columns);
      for (int n = g.beside->slices(); n-- > 0;) {
        if ((n & 63) == 0) context.check_cancelled();
        if (light) {
          meter.add_slice(n, light->of(n));
          continue;
        }
        g.beside->read(n, pixels.data());
        meter.add_slice(n, pixels.data());
      }
      const std::lock_guard lock(merging);
      merge_regions(all, meter.regions());
    }
  });
  return all;
}

}  // namespace slicecorr::detail
