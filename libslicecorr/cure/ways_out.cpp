// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cure/black_light.hpp"
#include "cure/limit_doses.hpp"
#include "cure/limits.hpp"
#include "cure/margin.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

// Limits are computed in another way than models are made. So far inside a limit (a share of it, `kMargin`) both
// agree.

/// Every exposure at most `most_s`.
Process cut(Process p, double most_s) {
  p.exposure_s = std::min(p.exposure_s, most_s);
  p.bottom_exposure_s = std::min(p.bottom_exposure_s, most_s);
  for (double& time_s : p.layer_exposure_s) time_s = std::min(time_s, most_s);
  return p;
}

/// The longest exposure, s, that all layers may get so that black leaves the resin liquid.
/// `normal_s`: the exposure that the model's phi' stands for. Infinite without light of black.
double longest_alike_s(const CureModel& model, double normal_s) {
  return model.phi_min() > 0 ? normal_s / alike_black(model)
                             : std::numeric_limits<double>::infinity();
}

/// The same for the exposures of `process`, each cut to the result: a few layers may be exposed for
/// longer than all of them may.
double longest_for_black_s(const CureModel& model, const Process& process, double normal_s) {
  const double alike_s = longest_alike_s(model, normal_s);
  if (!std::isfinite(alike_s)) return std::numeric_limits<double>::infinity();
  const auto fits = [&](double most_s) {
    return most_black(model, exposure_ratios(cut(process, most_s), normal_s, model.m)).dose < 1.0;
  };
  double longest_s = process.exposure_s;
  for (int n = 0; n < static_cast<int>(model.exposure_ratio.size()); ++n) {
    longest_s = std::max(longest_s, layer_exposure_s(process, n));
  }
  const double fits_s = alike_s * (1 - kMargin), gels_s = std::max(longest_s, alike_s);
  if (fits(gels_s)) return alike_s;
  return halved({fits_s, gels_s}, 60, fits).low;
}

struct Failing {
  bool lit = false, black = false;
};

/// Speeds, mm/h, or exposures, s, at which all places print.
struct Paces {
  double least = 0, greatest = std::numeric_limits<double>::infinity();
  bool any() const { return least <= greatest && greatest > 0; }
};

Paces speeds(const std::vector<LitPlace>& places, const Printer& printer, const Process& process) {
  // Every dose is inversely proportional to the speed.
  Paces p;
  for (const LitPlace& place : places) {
    const LimitDoses d = limit_doses(*place.model);
    if (place.lit) {
      const double mm_h = pace_mm_h(*place.model, process, Counts::least);
      p.greatest = std::min(p.greatest, mm_h * d.lit / place.needed);
    }
    p.least = std::max(p.least, pace_mm_h(*place.model, process, Counts::most) * d.black);
  }
  p.greatest *= 1 - kMargin;
  if (printer.max_speed_mm_h > 0) p.greatest = std::min(p.greatest, printer.max_speed_mm_h);
  p.least *= 1 + kMargin;
  return p;
}

Paces exposures(const std::vector<LitPlace>& places, const Process& process,
                const Failing& failing) {
  Paces p;
  for (const LitPlace& place : places) {
    const double dose = limit_doses(*place.model).lit;
    const double shortest_s = is_plain_layerwise(*place.model)
                                  ? layer_exposure_s(process, weakest_layer(*place.model))
                                  : process.exposure_s;
    if (place.lit) p.least = std::max(p.least, shortest_s * place.needed / dose * (1 + kMargin));
  }
  if (!std::isfinite(p.least)) return {std::numeric_limits<double>::infinity(), 0};
  for (const LitPlace& place : places) {
    const CureModel& model = *place.model;
    const double longest_s =
        !is_plain_layerwise(model) ? process.exposure_s / limit_doses(model).black
        : failing.lit              ? longest_alike_s(model, process.exposure_s)
                                   : longest_for_black_s(model, process, process.exposure_s);
    p.greatest = std::min(p.greatest, longest_s * (1 - kMargin));
  }
  return p;
}

/// Both ends as text, rounded inwards with as many digits as leave room between them.
struct PaceWords {
  std::string least, greatest;
};
std::optional<PaceWords> in_words(const Paces& p) {
  if (!p.any()) return std::nullopt;
  for (int digits = kLimitDigits; digits <= 15; digits += 2) {
    if (rounded_up(p.least, digits) <= rounded_down(p.greatest, digits)) {
      return PaceWords{p.least > 0 ? at_least(p.least, digits) : "",
                       std::isfinite(p.greatest) ? at_most(p.greatest, digits) : ""};
    }
  }
  return std::nullopt;
}

Failing failing_of(const std::vector<LitPlace>& places) {
  Failing f;
  for (const LitPlace& p : places) {
    const LimitDoses d = limit_doses(*p.model);
    f.lit = f.lit || (p.lit && (!gels(*p.model, d.lit) || d.lit < p.needed));
    f.black = f.black || d.black >= 1.0;
  }
  return f;
}

std::string speed_way(const std::vector<LitPlace>& places, const Printer& printer,
                      const Process& process, const Failing& failing) {
  const Paces paces = speeds(places, printer, process);
  const auto words = in_words(paces);
  if (!words) {
    const bool no_travel = std::any_of(places.begin(), places.end(), [](const LitPlace& p) {
      return p.lit && !std::isfinite(p.needed);
    });
    if (no_travel)
      return "no speed works: the stage's travel leaves no slices in which the part's end could "
             "cure";
    if (paces.greatest == printer.max_speed_mm_h) {
      return fmt::format(
          "no speed of the stage of printer '{}' is fast enough for its light of black",
          printer.name);
    }
    return paces.least > 0 && paces.greatest > 0
               ? "no speed works: where lit pixels gel, black ones do, too"
               : "no speed works";
  }
  if (has_own_speeds(process)) {
    const auto of = [](const char* side, const std::string& mm_h) {
      return mm_h.empty() ? mm_h : fmt::format("{} {} mm/h", side, mm_h);
    };
    const std::string most = of("at most", words->greatest), least = of("at least", words->least);
    const std::string between = most.empty() || least.empty() ? "" : " and ";
    return "give each slice " + (failing.lit ? most + between + least : least + between + most);
  }
  const std::string slower = fmt::format("slower than {} mm/h", words->greatest);
  if (words->least.empty()) return "print " + slower;
  const std::string faster = fmt::format("faster than {} mm/h", words->least);
  return failing.lit ? fmt::format("print {} and {}", slower, faster)
                     : fmt::format("print {} and {}", faster, slower);
}

std::string exposure_way(const std::vector<LitPlace>& places, const Process& process,
                         const Failing& failing) {
  const Paces paces = exposures(places, process, failing);
  const auto words = in_words(paces);
  if (!words) {
    return std::isfinite(paces.least)
               ? "no exposure works: where lit pixels gel, black ones do, too"
               : "no exposure works";
  }
  if (failing.lit) {
    std::string text = fmt::format("expose for at least {} s", words->least);
    if (!words->greatest.empty()) text += fmt::format(" and for less than {} s", words->greatest);
    return text;
  }
  // A normal exposure that is too long is so for the first layers, too.
  const char* which = "";
  for (const LitPlace& p : places) {
    const CureModel& model = *p.model;
    if (model.exposure_ratio.empty() || model.inhibited() || limit_doses(model).black < 1.0)
      continue;
    which = black_as_a_rule(model)             ? "all layers "
            : process.layer_exposure_s.empty() ? "the first layers "
                                               : "each layer ";
  }
  return fmt::format("expose {}for less than {} s", which, words->greatest);
}

/// Where doses are no sums: by how much light would have to be multiplied for a dose of it to be
/// `wanted`.
double light_by_trying(const CureModel& model, double wanted, double LimitDoses::*dose) {
  const auto reaches = [&](double factor) {
    CureModel other = model;
    if (model.gel_time()) {
      other.law =
          WithGelTime{std::make_shared<const GelTimeKernel>(model.gel_time()->with_light(factor))};
    }
    for (double& phi : other.level_phi) {
      phi = other.phi(factor * model.intensity_mw_cm2(phi));
    }
    return limit_doses(other).*dose >= wanted;
  };
  // In powers of e: no light at all makes no dose.
  constexpr double low = -60, high = 60;
  if (!std::isfinite(wanted) || !reaches(std::exp(high)))
    return std::numeric_limits<double>::infinity();
  return std::exp(halved({low, high}, 60, [&](double ln) { return !reaches(std::exp(ln)); }).high);
}

/// What intensities of full light and of black would make all places print at the speed or exposure
/// asked for. Only without UV light, whose dead zone would matter, too.
std::string light_way(const std::vector<LitPlace>& places, const Printer& printer,
                      const Failing& failing) {
  double full = 0, black = std::numeric_limits<double>::infinity();
  for (const LitPlace& p : places) {
    const LimitDoses d = limit_doses(*p.model);
    if (!p.model->adds_up()) {
      if (p.lit) full = std::max(full, light_by_trying(*p.model, p.needed, &LimitDoses::lit));
      black = std::min(black, light_by_trying(*p.model, 1.0, &LimitDoses::black));
      continue;
    }
    if (p.lit) full = std::max(full, std::pow(p.needed / d.lit, 1.0 / p.model->m));
    black = std::min(black, std::pow(1.0 / d.black, 1.0 / p.model->m));
  }
  full *= printer.calibration.back().intensity_mw_cm2 * (1 + kMargin);
  black *= printer.calibration.front().intensity_mw_cm2 * (1 - kMargin);
  // Where no light is enough, less of black changes nothing.
  if (failing.lit && !std::isfinite(full)) return {};
  std::string text;
  if (failing.lit) {
    const bool reaches = is_plain_layerwise(*places.front().model);
    text = fmt::format("with {} {} {}{}", reaches ? "at least" : "more than", at_least(full),
                       unit_of_light(printer.unit), failing.black ? " of full light" : "");
  }
  if (failing.black) {
    text += fmt::format("{}black below {} {}", text.empty() ? "with " : " and ", at_most(black),
                        unit_of_light(printer.unit));
  }
  return text;
}

}  // namespace

std::string ways_out(const std::vector<LitPlace>& places, const Printer& printer,
                     const Process& process) {
  const Failing failing = failing_of(places);
  std::string text = is_continuous(process) ? speed_way(places, printer, process, failing)
                                            : exposure_way(places, process, failing);
  if (!places.front().model->inhibited()) {
    if (const std::string light = light_way(places, printer, failing); !light.empty()) {
      text += ", or " + light;
    }
  } else if (places.size() == 1 && !places.front().model->inhibited()->ends()) {
    const LitPlace& p = places.front();
    if (const auto uv = working_uv(p.model->inhibited()->kinetics(), p.model->layer_um,
                                   level_intensities(printer), *printer.uv, process, p.needed)) {
      text += fmt::format(", or with {} mW/cm² of UV light", *uv);
    }
  }
  return text;
}

}  // namespace slicecorr::detail
