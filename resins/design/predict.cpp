// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "design/designer.hpp"
#include "design/numbers.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/vial_keys.hpp"
#include "support/json/finite.hpp"
#include "support/json/read_json.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::resins {

namespace {

/// Limits are named this far inside: what is typed back goes another way to its answer.
constexpr double kInside = 1e-9;

std::string dose_unit(double m, LightUnit unit) {
  return m == 1 ? std::string(unit_of_dose(unit)) : fmt::format("(mW/cm²)^{:.3g} s", m);
}

/// Blue light at which passing light gives just the critical dose.
double critical_intensity(const Kinetics& k, double uv, double speed) {
  const auto phi = [&](double blue) {
    return passing_dose_prime(k, blue, uv, speed) / k.critical_dose_prime;
  };
  if (k.has_gel_time()) {
    // A s/h + (B s/(2 h))².
    const double rate = units::cm_s_from_mm_h(speed) / (k.hb_um * 1e-4);
    const double root = 0.5 * k.gel_time.B * rate;
    return k.gel_time.A * rate + root * root;
  }
  if (k.bleaching) {
    return k.bleaching->absorbed(k.critical_dose_prime) * units::cm_s_from_mm_h(speed) * 1e4;
  }
  // UV only takes away: the intensity without it is a lower bound.
  double low = std::pow(
      k.m * units::cm_s_from_mm_h(speed) * k.critical_dose_prime / (k.hb_um * 1e-4), 1 / k.m);
  if (!(k.beta > 0 && uv > 0)) return low;
  double high = low;
  while (phi(high) < 1 && high < 1e12) high *= 2;
  return halved({low, high}, 100, [&](double mw_cm2) { return phi(mw_cm2) < 1; }).high;
}

Passing passing_of(const Kinetics& k, const Question& q) {
  Passing p;
  const auto phi = [&](double blue) {
    return passing_dose_prime(k, blue, q.uv_mw_cm2, q.speed_mm_h) / k.critical_dose_prime;
  };
  p.phi = phi(q.blue_mw_cm2);
  p.critical_intensity_mw_cm2 = critical_intensity(k, q.uv_mw_cm2, q.speed_mm_h);
  if (k.bleaching) {
    p.fastest_mm_h = q.speed_mm_h * q.blue_mw_cm2 / p.critical_intensity_mw_cm2;
    p.slowest_mm_h = q.speed_mm_h * q.black_mw_cm2 / p.critical_intensity_mw_cm2;
  } else {
    // The dose is inversely proportional to the speed.
    p.fastest_mm_h = q.speed_mm_h * p.phi;
    p.slowest_mm_h = q.speed_mm_h * phi(q.black_mw_cm2);
  }
  p.slice_time_s = units::slice_time_s(q.layer_um, q.speed_mm_h);
  if (p.phi > 1 && k.has_gel_time()) {
    Process process;
    process.speed_mm_h = q.speed_mm_h;
    const GelTimeKernel kernel(k.gel_time, k.hb_um, process, q.layer_um, {q.blue_mw_cm2});
    p.slices_to_gel = static_cast<int>(std::ceil(kernel.slices_to_gel(q.blue_mw_cm2) - 1e-9));
  } else if (p.phi > 1 && k.bleaching) {
    const double gain = q.blue_mw_cm2 / (units::cm_s_from_mm_h(q.speed_mm_h) * 1e4);
    for (double dose = 0; dose < k.critical_dose_prime * (1 - 1e-9) && p.slices_to_gel < 1'000'000;
         ++p.slices_to_gel) {
      dose = k.bleaching->after(dose, q.layer_um, gain);
    }
  } else if (p.phi > 1 && !(k.beta > 0 && q.uv_mw_cm2 > 0)) {
    const double reach_um = k.hb_um / k.m * std::log(p.phi / (p.phi - 1));
    p.slices_to_gel = static_cast<int>(std::ceil(reach_um / q.layer_um - 1e-9));
  }
  return p;
}

bool inhibited(const Forecast& f) { return f.kinetics.beta > 0 && f.question.uv_mw_cm2 > 0; }

void describe_start(const Forecast& f, std::vector<std::string>& s) {
  const Question& q = f.question;
  const Kinetics& k = f.kinetics;
  const char* known = f.gel_dose_known ? "" : " (the resin gives no gel dose of its own)";
  if (k.has_gel_time()) {
    s.push_back(fmt::format("Time used: {} {}/i + {}/sqrt(i) s.",
                            q.aim ? "what correction aims at," : "time to gel,",
                            figure(k.gel_time.A), figure(k.gel_time.B)));
  } else {
    s.push_back(
        fmt::format("Dose used: {} {} {}{}.", q.aim ? "what correction aims at," : "gel dose,",
                    figure(k.critical_dose_prime), dose_unit(k.m, f.unit), q.aim ? "" : known));
  }
  if (!inhibited(f)) {
    s.push_back(
        fmt::format("First gel: at the window after {} s. Without UV light there is no dead zone.",
                    figure(f.first.time_s)));
    return;
  }
  s.push_back(fmt::format("First gel: {} um above the window after {} s.", figure(f.first.z_um),
                          figure(f.first.time_s)));
  if (f.steady_dead_zone_um > 0) {
    s.push_back(fmt::format(
        "Dead zone in the long run: {} um; the front is within a tenth of it after {} s.",
        figure(f.steady_dead_zone_um), figure(*f.front_settled_s)));
  } else {
    s.push_back(fmt::format(
        "The dead zone does not last: {}; {} mW/cm² of UV light and more would keep it free.",
        std::isfinite(f.window_time_s)
            ? fmt::format("beta Iuv is less than Ib. The resin cures to the window after {} s",
                          figure(f.window_time_s))
            : std::string("beta Iuv is just Ib. It gets ever thinner, though the window itself is "
                          "reached in no finite time"),
        at_least(q.blue_mw_cm2 / k.beta * (1 + kInside))));
  }
}

void describe_exposure(const Forecast& f, std::vector<std::string>& s) {
  const Question& q = f.question;
  if (inhibited(f) && std::isfinite(*f.back_settled_s)) {
    s.push_back(fmt::format("The back is at nine tenths of its height without UV light after {} s.",
                            figure(*f.back_settled_s)));
  }
  if (q.exposure_s > 0) {
    if (!f.fronts) {
      s.push_back(fmt::format("After {} s nothing has gelled yet.", figure(q.exposure_s)));
    } else if (inhibited(f)) {
      s.push_back(fmt::format(
          "After {} s: cured from {} um (dead zone) to {} um above the window; without UV light it "
          "would be {} um high.",
          figure(q.exposure_s), figure(f.fronts->front_um), figure(f.fronts->back_um),
          figure(std::max(0.0, f.cured_height_without_uv_um))));
    } else {
      s.push_back(fmt::format("After {} s: cured {} um high.", figure(q.exposure_s),
                              figure(f.fronts->back_um)));
    }
  }
  if (q.height_um > 0 && f.unanswered.empty()) {
    s.push_back(fmt::format("Resin {} um above the window gels after {} s.", figure(q.height_um),
                            figure(f.exposure_for_height_s)));
  }
}

void describe_lift(const Forecast& f, std::vector<std::string>& s) {
  const Question& q = f.question;
  if (!f.layer_holds_s || (q.exposure_s == 0 && q.height_um == 0)) return;
  std::string text = fmt::format(
      "Layer by layer: a layer of {} um holds when the platform lifts if it is exposed for at least "
      "{} s ({} gel doses at its far edge)",
      figure(q.layer_um), at_least(*f.layer_holds_s), figure(f.green_strength));
  if (q.exposure_s > 0) {
    text += q.exposure_s >= *f.layer_holds_s
                ? fmt::format("; after {} s it does", figure(q.exposure_s))
                : fmt::format("; after {} s it does not", figure(q.exposure_s));
  }
  s.push_back(text + ".");
}

void describe_passing(const Forecast& f, std::vector<std::string>& s) {
  const Question& q = f.question;
  if (!f.passing) return;
  const Passing& p = *f.passing;
  s.push_back(
      fmt::format("Continuous printing at {} mm/h: phi = {} (dose inside a long part, over the "
                  "dose used); phi = 1 takes {} {}.",
                  figure(q.speed_mm_h), figure(p.phi), figure(p.critical_intensity_mw_cm2),
                  unit_of_light(f.unit)));
  if (p.phi <= 1) {
    s.push_back(
        fmt::format("That is too fast: the resin does not gel. With this light {} mm/h is the "
                    "limit.",
                    at_most(p.fastest_mm_h * (1 - kInside))));
  } else {
    s.push_back(fmt::format("Fastest speed with this light: {} mm/h.", figure(p.fastest_mm_h)));
  }
  if (q.black_mw_cm2 > 0) {
    s.push_back(fmt::format("Slowest speed: {} mm/h, where black pixels gel the resin.",
                            figure(p.slowest_mm_h)));
  }
  std::string slices = fmt::format("Each slice of {} um is shown for {} s", figure(q.layer_um),
                                   figure(p.slice_time_s));
  if (p.slices_to_gel > 0) {
    slices += fmt::format("; {} such slice{} lift the dose from nothing to the dose used",
                          p.slices_to_gel, p.slices_to_gel == 1 ? "" : "s");
  }
  s.push_back(slices + ".");
}

/// What a place gets of the calibration's light, and what becomes of it there.
std::string place_in_words(const char* which, const Forecast& f) {
  const Question& q = f.question;
  std::string text =
      fmt::format("At the {} places ({} {}) ", which, figure(q.blue_mw_cm2), unit_of_light(f.unit));
  if (!inhibited(f)) {
    text += fmt::format("the window gels after {} s", figure(f.first.time_s));
  } else {
    text += fmt::format(
        "the first resin gels after {} s, {}", figure(f.first.time_s),
        f.steady_dead_zone_um > 0
            ? fmt::format("the dead zone is {} um in the long run", figure(f.steady_dead_zone_um))
            : std::string("no dead zone lasts"));
  }
  if (q.exposure_s > 0) {
    text += f.fronts ? fmt::format("; after {} s it is cured {} um high", figure(q.exposure_s),
                                   figure(f.fronts->back_um))
                     : fmt::format("; after {} s nothing is cured", figure(q.exposure_s));
  }
  if (q.height_um > 0) {
    text += std::isfinite(f.exposure_for_height_s)
                ? fmt::format("; resin {} um above the window gels after {} s", figure(q.height_um),
                              figure(f.exposure_for_height_s))
                : fmt::format("; resin {} um above the window never gels", figure(q.height_um));
  }
  if (f.passing) {
    text += fmt::format("; the fastest speed is {} mm/h",
                        at_most(f.passing->fastest_mm_h * (1 - kInside)));
    if (f.passing->slowest_mm_h > 0) {
      text +=
          fmt::format(", the slowest {} mm/h", at_least(f.passing->slowest_mm_h * (1 + kInside)));
    }
  }
  return text + ".";
}

void describe_places(const Forecast& f, std::vector<std::string>& s) {
  const Question& q = f.question;
  s.push_back(fmt::format(
      "All of this holds for places that get the light of the calibration. By its flat-field the "
      "display gives {:.3g} to {:.3g} % of it{}.",
      100 * q.least_light, 100 * q.greatest_light,
      q.dark_places ? ", and none at all in some places, which can't print" : ""));
  s.push_back(place_in_words("dimmest", *f.dimmest));
  s.push_back(place_in_words("brightest", *f.brightest));
}

}  // namespace

void Question::take_flat_field(const Printer& printer) {
  if (!printer.flat_field) return;
  const FlatField& field = *printer.flat_field;
  int least = 255;
  for (const std::uint8_t v : *field.values) {
    dark_places = dark_places || v == 0;
    if (v > 0) least = std::min<int>(least, v);
  }
  least_light = 1.0 * least / field.reference;
  greatest_light = 1.0 * field.greatest() / field.reference;
}

Forecast predict(const Resin& resin, const Question& q) {
  if (!(q.blue_mw_cm2 > 0)) throw InputError("blue light is 0; expected an intensity above 0");
  Forecast f;
  f.question = q;
  f.unit = resin.unit;
  f.kinetics = make_kinetics(resin, q.uv_mw_cm2 > 0, q.aim);
  f.gel_dose_known = resin.dose_factor > 1 || resin.gel_dose_mj_cm3 > 0 ||
                     resin.critical_dose_prime > 0 || is_relative(resin);
  const Kinetics& k = f.kinetics;
  f.first = first_gel(k, q.blue_mw_cm2, q.uv_mw_cm2);
  f.steady_dead_zone_um = steady_dead_zone_um(k, q.blue_mw_cm2, q.uv_mw_cm2);
  f.window_time_s = window_time_s(k, q.blue_mw_cm2, q.uv_mw_cm2);
  if (q.exposure_s > 0) {
    f.fronts = curing_fronts(k, q.blue_mw_cm2, q.uv_mw_cm2, q.exposure_s);
    f.cured_height_without_uv_um =
        cured_height_um(make_kinetics(resin, false, q.aim), q.blue_mw_cm2, q.exposure_s);
  }
  if (q.height_um > 0) {
    const double rate = dose_prime_at(k, q.blue_mw_cm2, q.uv_mw_cm2, q.height_um, 1);
    f.exposure_for_height_s = rate > 0 ? k.critical_dose_prime / rate : kInfinity;
    if (!std::isfinite(f.exposure_for_height_s)) {
      f.unanswered = fmt::format(
          "resin {} um above the window never gels: it lies in the dead zone of {} um; expected a "
          "height above that, or UV light below {} mW/cm²",
          figure(q.height_um), at_least(f.steady_dead_zone_um * (1 + kInside)),
          at_most(q.blue_mw_cm2 / k.beta * std::exp(q.height_um * (1 / k.huv_um - 1 / k.hb_um)) *
                  (1 - kInside)));
    }
  }
  if (!(q.uv_mw_cm2 > 0) && resin.adds_up()) {
    // With lifts the strength at joints stands in place of a factor on all doses.
    const Kinetics gel = make_kinetics(resin, false, false);
    f.green_strength = resin.green_strength > 0 ? resin.green_strength : kDefaultGreenStrength;
    f.layer_holds_s = f.green_strength * gel.critical_dose_prime /
                      dose_prime_at(gel, q.blue_mw_cm2, 0, q.layer_um, 1);
  }
  if (q.speed_mm_h > 0) f.passing = passing_of(k, q);
  if (inhibited(f)) {
    f.front_settled_s = front_settled_s(k, q.blue_mw_cm2, q.uv_mw_cm2);
    f.back_settled_s = back_settled_s(k, q.blue_mw_cm2, q.uv_mw_cm2);
  }
  describe_start(f, f.sentences);
  if (const std::string text = vial_keys_in_words(resin); !text.empty()) {
    f.sentences.push_back(text + ".");
  }
  describe_exposure(f, f.sentences);
  describe_lift(f, f.sentences);
  describe_passing(f, f.sentences);
  if (q.least_light != 1 || q.greatest_light != 1) {
    const auto at = [&](double share) {
      Question there = q;
      there.blue_mw_cm2 *= share;
      there.black_mw_cm2 *= share;
      there.least_light = there.greatest_light = 1;
      return std::make_shared<const Forecast>(predict(resin, there));
    };
    f.dimmest = at(q.least_light);
    f.brightest = at(q.greatest_light);
    describe_places(f, f.sentences);
  }
  return f;
}

double front_settled_s(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  const double zone = steady_dead_zone_um(k, blue_mw_cm2, uv_mw_cm2);
  if (!(zone > 0) || !std::isfinite(zone)) return kInfinity;
  const FirstGel first = first_gel(k, blue_mw_cm2, uv_mw_cm2);
  if (first.z_um <= 1.1 * zone) return first.time_s;
  return k.critical_dose_prime / dose_prime_at(k, blue_mw_cm2, uv_mw_cm2, 1.1 * zone, 1);
}

double back_settled_s(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  const FirstGel first = first_gel(k, blue_mw_cm2, uv_mw_cm2);
  if (!std::isfinite(first.time_s)) return kInfinity;
  // Where a back without UV light is z / 0.9 high, z gels at that time just when e^(z/(9 hb)) (1 - r(z)) is
  // 1, r the share that UV light takes of the blue light there: it rises with z.
  const double ratio = k.beta * uv_mw_cm2 / blue_mw_cm2;
  const double shorter = 1 / k.huv_um - 1 / k.hb_um;
  const auto below = [&](double z) {
    return std::exp(z / (9 * k.hb_um)) * (1 - ratio * std::exp(-z * shorter)) < 1;
  };
  double high = k.hb_um;
  while (below(high)) high *= 2;
  const double z = halved({0, high}, 100, below).high;
  // Below the first gel it is the front that gets there; the back has been further up from the start.
  if (z <= first.z_um) return first.time_s;
  return k.critical_dose_prime / std::pow(blue_mw_cm2, k.m) * std::exp(k.m * z / (0.9 * k.hb_um));
}

std::string Forecast::to_json() const {
  using nlohmann::ordered_json;
  const auto number = [](double v) { return slicecorr::detail::finite_or_null(v); };
  ordered_json j;
  j["dose"] = question.aim ? "aim" : "gel";
  if (kinetics.has_gel_time()) {
    j["gel_a_mj_cm2"] = kinetics.gel_time.A;
    j["gel_b_sqrt_mw_cm2_s"] = kinetics.gel_time.B;
  } else {
    j["critical_dose_prime"] = kinetics.critical_dose_prime;
    j["unit"] = unit_in_files(unit);
    j["m"] = kinetics.m;
  }
  j["h_um"] = kinetics.hb_um;
  j["blue_mw_cm2"] = question.blue_mw_cm2;
  j["uv_mw_cm2"] = question.uv_mw_cm2;
  j["first_gel"] = {{"z_um", number(first.z_um)}, {"time_s", number(first.time_s)}};
  j["dead_zone_um"] = {{"steady", number(steady_dead_zone_um)}};
  j["window_time_s"] = number(window_time_s);
  if (front_settled_s) {
    j["front_settled_s"] = number(*front_settled_s);
    j["back_settled_s"] = number(*back_settled_s);
  }
  if (question.exposure_s > 0) {
    j["exposure_s"] = question.exposure_s;
    j["cured_height_um"] = fronts ? number(fronts->back_um) : ordered_json();
    j["dead_zone_um"]["after_exposure"] = fronts ? number(fronts->front_um) : ordered_json();
    j["cured_height_without_uv_um"] = number(cured_height_without_uv_um);
  }
  if (question.height_um > 0) {
    j["height_um"] = question.height_um;
    j["exposure_for_height_s"] = number(exposure_for_height_s);
  }
  if (layer_holds_s) {
    j["layer_by_layer"] = {{"layer_um", question.layer_um},
                           {"green_strength", green_strength},
                           {"least_exposure_s", number(*layer_holds_s)}};
  }
  if (passing) {
    j["continuous"] = {{"speed_mm_h", question.speed_mm_h},
                       {"phi", passing->phi},
                       {"critical_intensity_mw_cm2", passing->critical_intensity_mw_cm2},
                       {"fastest_mm_h", passing->fastest_mm_h},
                       {"slowest_mm_h", passing->slowest_mm_h},
                       {"slice_time_s", passing->slice_time_s},
                       {"slices_to_gel", passing->slices_to_gel}};
  }
  if (dimmest) {
    const auto place = [](double share, const Forecast& there) {
      ordered_json all{{"light", share}};
      all.update(slicecorr::detail::own_json<nlohmann::ordered_json>(there.to_json()));
      all.erase("text");
      return all;
    };
    j["dimmest_place"] = place(question.least_light, *dimmest);
    j["brightest_place"] = place(question.greatest_light, *brightest);
  }
  j["text"] = sentences;
  if (!unanswered.empty()) j["unanswered"] = unanswered;
  return j.dump(2);
}

}  // namespace slicecorr::resins
