// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/dose_meter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>

#include "pipeline/bands.hpp"
#include "pipeline/place_plans.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_spreads.hpp"

namespace slicecorr::detail {

namespace {

[[noreturn]] void refuse(const char* why) {
  throw InputError(fmt::format("doses can't be graded {}", why));
}

}  // namespace

void check_graded(const SliceSource& target, const Setup& setup) {
  if (target.left_alone()) refuse("beside what is left alone; expected the part by itself");
  if (setup.process.mode == ExposureMode::layerwise) {
    refuse(
        "layer by layer, where the dose falls through every layer; expected continuous exposure");
  }
  if (setup.process.uv.kind != UvKind::off) {
    refuse("under UV light; expected continuous exposure without it");
  }
  if (setup.resin.has_gel_time()) {
    refuse("with a resin of model \"gel-time\"; expected one of another model (resinctl derive)");
  }
  if (light_spreads(setup.printer, setup.resin, setup.process)) {
    refuse("where light spreads from pixel to pixel; expected a printer and a resin without");
  }
  if (setup.process.omega_max < 1e300) {
    refuse("and capped at once: wanted doses say the most, too; expected no cap of the dose");
  }
}

void check_doses(const DoseTarget& doses, const SliceSource& target, const PlaceModels& models,
                 const Setup& setup) {
  check_graded(target, setup);
  const CureModel& model = models.brightest();
  if (model.bath_slices > 0) {
    refuse("in resin that ends above the window; expected deeper resin, or no depth at all");
  }
  if (model.is_continuous() && !model.exposure_ratio.empty()) {
    refuse("where slices get more light than others; expected lamps that follow the speed");
  }
  if (!model.is_plain()) {
    refuse("below a platform that sends light back; expected one that takes it up");
  }
  const LightCounts part = models.map().counts(target.bounds());
  const double most = doses.scale.greatest();
  for (std::size_t v = 1; v < part.size(); ++v) {
    const auto value = static_cast<std::uint8_t>(v);
    if (part[v] == 0 && !models.even()) continue;
    if (models.even() && value != models.map().reference()) continue;
    const double reached = models.model(value).phi_max();
    if (most < reached) continue;
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
                                      const PlaceModels& models, const ExecutionContext& context) {
  const DoseTarget& doses = *target.doses();
  std::vector<RegionDose> all = regions_of(doses);
  const auto bands = bands_of(target.grid(), target.bounds());
  std::mutex merging;
  parallel_for(context, "measure doses", bands.size(), [&](std::size_t i) {
    // A model per value of light: columns of one value after the other.
    const GroupedBand grouped(
        models.map(), bands[i],
        BandReaders({reader_of(stack, bands[i]), reader_of(*doses.images, bands[i]),
                     reader_of(target, bands[i])}));
    for (const GroupedBand::Group& g : grouped.groups) {
      const WantedBand wanted{&doses, &g.sources[1]};
      DoseMeter meter(wanted, models.model(g.value), g.sources[2]);
      std::vector<std::uint8_t> pixels(g.columns.size());
      for (int n = g.sources[0].slices(); n-- > 0;) {
        if ((n & 63) == 0) context.check_cancelled();
        g.sources[0].read(n, pixels.data());
        meter.add_slice(n, pixels.data());
      }
      const std::lock_guard lock(merging);
      merge_regions(all, meter.regions());
    }
  });
  return all;
}

}  // namespace slicecorr::detail
