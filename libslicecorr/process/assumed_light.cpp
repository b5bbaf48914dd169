// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/assumed_light.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"

namespace slicecorr {

namespace {

struct Kind {
  std::string_view words;
  double wavelength_nm;
  double power;        ///< of the level
  double dark_to_255;  ///< levels of 255 up to this show nothing
};
/// By `AssumedLight`.
constexpr std::array kKinds{Kind{"nothing", 0, 1, 0},
                            Kind{"a typical monochrome LCD of 405 nm", 405, 3, 0},
                            Kind{"a typical DLP projector of 385 nm", 385, 1, 37},
                            Kind{"a typical DLP projector of 405 nm", 405, 1, 37}};

const Kind& kind_of(AssumedLight light) { return kKinds[static_cast<std::size_t>(light)]; }

double mean_multiple() { return std::sqrt(kLeastOfHolding * kMostOfHolding); }

/// Critical doses per second of full light at the far edge of a layer that is exposed so long that the mean
/// multiple of `holds` arrives there.
double critical_share(const Resin& resin, double layer_um, double holds) {
  return std::pow(10, -resin.m * layer_um / resin.absorbance_height10_um) /
         (mean_multiple() * holds);
}

}  // namespace

std::string_view words_of(AssumedLight light) { return kind_of(light).words; }

std::string_view name_of(AssumedLight light) {
  return find_setting("assume")->words[static_cast<std::size_t>(light)];
}

AssumedLight assumed_light(std::string_view word, const Printer& printer) {
  if (word.empty()) return AssumedLight::none;
  for (std::size_t i = 0; i < kKinds.size(); ++i) {
    if (word == name_of(static_cast<AssumedLight>(i))) return static_cast<AssumedLight>(i);
  }
  // Panels of liquid crystals let little of 385 nm through.
  const bool known = printer.wavelength_nm > 0;
  return known && same_light(printer.wavelength_nm, 385) ? AssumedLight::dlp_385
                                                         : AssumedLight::mono_lcd_405;
}

Printer with_assumed_light(Printer display, AssumedLight light) {
  if (light_is_measured(display) && !display.model) {
    throw InputError(fmt::format(
        "the light of printer '{}' is measured: expected nothing to be assumed", display.name));
  }
  const Kind& kind = kind_of(light);
  if (!same_light(display.wavelength_nm, kind.wavelength_nm)) {
    throw InputError(
        fmt::format("printer '{}' has light of {:g} nm; expected another than {} to be assumed",
                    display.name, display.wavelength_nm, kind.words));
  }
  if (!(display.wavelength_nm > 0)) display.wavelength_nm = kind.wavelength_nm;
  display.unit = LightUnit::brightest;
  display.model = false;
  display.calibration.clear();
  const int last = display.levels() - 1;
  for (int level = 0; level <= last; ++level) {
    const double above = std::max(0.0, 255.0 * level / last - kind.dark_to_255);
    display.calibration.push_back(
        {static_cast<double>(level), std::pow(above / (255 - kind.dark_to_255), kind.power)});
  }
  return display;
}

Resin with_assumed_dose(Resin resin, double layer_um, double exposure_s, double holds) {
  const auto refuse = [&](const char* what) {
    throw InputError(
        fmt::format("resin '{}' {}: expected no assumed light with it", resin.name, what));
  };
  if (is_relative(resin)) refuse("was measured in seconds of a printer's full light");
  refuse_law(resin, LawUse::assumed_light);
  resin.unit = LightUnit::brightest;
  resin.inhibition.reset();
  resin.chemistry.reset();
  resin.gel_dose_mj_cm3 = resin.inhibition_dose_mj_cm3 = resin.inhibition_resupply_mj_cm3_s = 0;
  resin.dose_factor = 1;
  const double critical_s = exposure_s * critical_share(resin, layer_um, holds);
  if (resin.critical_dose_prime > 0) {
    resin.critical_dose_prime = critical_s;
  } else {
    resin.critical_dose_mj_cm3 = units::volumetric_from_areal(critical_s, dose_height_e_um(resin));
  }
  return resin;
}

double exposure_of_assumed_dose(const Resin& resin, double layer_um, double holds) {
  const double critical_s =
      resin.critical_dose_prime > 0
          ? resin.critical_dose_prime
          : units::areal_from_volumetric(resin.critical_dose_mj_cm3, dose_height_e_um(resin));
  return critical_s / critical_share(resin, layer_um, holds);
}

double assumed_green_strength(double holds) { return holds * mean_multiple() / kLeastOfHolding; }

double holds_of_assumed(double green_strength) {
  return green_strength * kLeastOfHolding / mean_multiple();
}

std::string assumption_in_words(const Printer& printer, const Resin& resin,
                                const Process& process) {
  if (process.assumed == AssumedLight::none) return {};
  return fmt::format(
      "assumed, not measured: grey levels of printer '{}' as bright as those of {}, light that goes "
      "down to a tenth in {:.4g} um as published of resin '{}', and exposures of {:g} to {:g} times what "
      "holds. Layers are to hold where it is {:g} times; figures are those for {:.2g} times",
      printer.name, words_of(process.assumed), resin.absorbance_height10_um, resin.name,
      kLeastOfHolding, kMostOfHolding, kLeastOfHolding, mean_multiple());
}

}  // namespace slicecorr
