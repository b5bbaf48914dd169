// The absorber that a speed and a tolerance need: docs/design.md, section recommend.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "design/numbers.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {

namespace {

Process continuous(double speed_mm_h) {
  Process process;
  process.speed_mm_h = speed_mm_h;
  return process;
}

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// The absorbance heights that definitions may have (base 10, um), as base e.
constexpr double kGreatestHeightE = 1e7 / units::kLn10;
/// Gaps are judged by the shortest one of which both edges can be right.
constexpr int kGapSlices = 2;
/// The recommended height keeps this factor from the ends of the range.
constexpr double kMargin = 1.02;

/// x in [low, high] where `holds` changes from `at_low`, in ratio to 1e-13.
double boundary(double low, double high, bool at_low, const std::function<bool(double)>& holds) {
  for (int i = 0; i < 200 && high / low > 1 + 1e-14; ++i) {
    const double middle = std::sqrt(low * high);
    if (!(middle > low && middle < high)) break;
    (holds(middle) == at_low ? low : high) = middle;
  }
  return at_low ? low : high;
}

/// How far one grey level moves an upper and a lower edge at most, beside gaps that keep half the
/// contrast.
struct EdgeSteps {
  double upper_um = kInfinity, lower_um = kInfinity;
};

EdgeSteps edge_steps(const CureModel& model) {
  if (!(model.phi_max() > 1) || !(model.phi_min() < 1)) return {};
  double step = 0;
  for (std::size_t l = 1; l < model.level_phi.size(); ++l) {
    step = std::max(step, model.level_phi[l] - model.level_phi[l - 1]);
  }
  // A lower edge hangs on the fractional slice that begins the burst. A step there has decayed at
  // the edge by (phi - 1) / (phi - W), W the dose above that slice, and the edge moves by the rest
  // over the slope phi - 1. W is at most one slice of the burst above the least dose of the gap,
  // half the critical one. A burst of one slice is no brighter than it must be.
  const double contrast = std::min(model.phi_max() - 0.5, 0.5 / model.one_minus_a);
  return {model.level_step_um(), model.layer_um * step * model.one_minus_a /
                                     (model.a * units::kLn10 * model.eta * contrast)};
}

/// All that a recommendation is found from, at one speed.
class Designer {
 public:
  Designer(const Resin& resin, const Printer& printer, const Wish& wish, double speed_mm_h)
      : resin_(resin), printer_(printer), wish_(wish), speed_(speed_mm_h) {
    const Kinetics k = make_kinetics(resin, false, true);
    m_ = k.m;
    blue_ = printer.calibration.back().intensity_mw_cm2;
    black_ = printer.calibration.front().intensity_mw_cm2;
    // phi_max = he / limit_: the areal dose does not depend on the absorber.
    limit_ = m_ * units::cm_s_from_mm_h(speed_) * k.critical_dose_prime / std::pow(blue_, m_) * 1e4;
    ratio_ = std::pow(black_ / blue_, m_);
  }

  double m() const { return m_; }
  double blue() const { return blue_; }
  double black() const { return black_; }
  double ratio() const { return ratio_; }
  /// Height at which full light just reaches the critical intensity, and black light does.
  double speed_limit() const { return limit_; }
  double black_limit() const { return ratio_ > 0 ? limit_ / ratio_ : kInfinity; }
  double phi_max(double he) const { return he / limit_; }
  double phi_min(double he) const { return ratio_ * he / limit_; }

  CureModel model(double he) const {
    return make_cure_model(printer_, with_height(resin_, he), continuous(speed_), wish_.layer_um);
  }
  double error(double he) const {
    const EdgeSteps e = edge_steps(model(he));
    return std::max(e.upper_um, e.lower_um);
  }

  Kinetics inhibited(double he) const { return make_kinetics(with_height(resin_, he), true, true); }
  double huv() const { return units::height_e_from_10(resin_.inhibition->absorbance_height10_um); }
  /// (3.25) solved for the UV light, at full blue light.
  double uv_needed(double he) const {
    const Inhibition& i = *resin_.inhibition;
    return blue_ / i.beta * std::exp(wish_.dead_zone_um * (1 / huv() - 1 / he));
  }
  double phi_with_uv(double he) const {
    const Kinetics k = inhibited(he);
    return passing_dose_prime(k, blue_, uv_needed(he), speed_) / k.critical_dose_prime;
  }
  double lamp() const { return printer_.uv ? printer_.uv->max_mw_cm2() : 0; }
  bool keeps_any_dead_zone() const {
    return keeps_dead_zone(make_kinetics(resin_, true, true), blue_, lamp());
  }

  /// Interval of heights that gel, keep gaps liquid and keep the dead zone; with what sets its
  /// ends.
  struct Limits {
    double low = 0, high = kInfinity;
    std::string low_because, high_because;
    bool any() const { return low * (1 + 1e-9) < high; }
  };
  Limits limits() const {
    Limits l{limit_, std::min(black_limit(), kGreatestHeightE), {}, {}};
    l.low_because = fmt::format("full light ({} mW/cm²) gels the resin at {} mm/h above it",
                                figure(blue_), figure(speed_));
    l.high_because =
        black_limit() < kGreatestHeightE
            ? fmt::format("black pixels ({} mW/cm²) gel the resin from there on", figure(black_))
            : "no resin file goes beyond it";
    if (!(wish_.dead_zone_um > 0)) return l;
    // Above huv, and where full light still gels the resin against the UV light.
    const double least = std::max(l.low, huv() * (1 + 1e-9));
    const auto gels = [&](double he) { return phi_with_uv(he) > 1; };
    double low = kGreatestHeightE;
    if (gels(kGreatestHeightE)) {
      low = gels(least) ? least : boundary(least, kGreatestHeightE, false, gels);
    }
    if (low > l.low) {
      l.low = low;
      l.low_because = low <= huv() * (1 + 1e-8)
                          ? "blue light must reach further than UV light for a dead zone"
                          : "full light gels the resin against the UV light above it";
    }
    // The stronger the blue light reaches, the more UV light the dead zone takes.
    const double longest =
        1 / huv() - std::log(resin_.inhibition->beta * lamp() / blue_) / wish_.dead_zone_um;
    const double high = !keeps_any_dead_zone() ? 0.0 : longest > 0 ? 1 / longest : kInfinity;
    if (high < l.high) {
      l.high = high;
      l.high_because = fmt::format(
          "the UV lamp's {} mW/cm² keep a dead zone of {} um under full blue light up to there",
          figure(lamp()), figure(wish_.dead_zone_um));
    }
    return l;
  }

  /// Where the falling error of lower edges and the rising one of upper edges meet, or the end
  /// nearest to that.
  double least_of_piece(double start, double end) const {
    const auto rising = [&](double he) {
      const EdgeSteps e = edge_steps(model(he));
      return e.upper_um >= e.lower_um;
    };
    if (rising(start)) return start;
    return rising(end) ? boundary(start, end, false, rising) : end;
  }

  /// Heights within `l` at which no edge moves by more than the tolerance; the longest stretch.
  /// `least_error` takes the least error there is.
  std::optional<Limits> within_tolerance(const Limits& l, double& least_error) const {
    least_error = kInfinity;
    if (!l.any()) return std::nullopt;
    // Between heights at which a grey level passes phi = 1 the error of upper edges rises with the
    // height, that of lower edges falls. So each piece holds one stretch at most.
    std::vector<double> cuts{l.low * (1 + 1e-12), l.high * (1 - 1e-12)};
    for (const double i : level_intensities(printer_)) {
      if (!(i > 0)) continue;
      const double he = limit_ * std::pow(blue_ / i, m_) * (1 + 1e-12);
      if (he > cuts[0] && he < cuts[1]) cuts.push_back(he);
    }
    std::sort(cuts.begin(), cuts.end());
    const auto fits = [&](double he) { return error(he) <= wish_.tolerance_um; };
    std::optional<Limits> best, open;
    const auto close = [&] {
      if (open && (!best || open->high / open->low > best->high / best->low)) best = open;
      open.reset();
    };
    const std::string tolerance = fmt::format(
        "one grey level moves an edge by the {} um allowed there", figure(wish_.tolerance_um));
    for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
      const double start = cuts[i], end = cuts[i + 1] * (1 - 2e-12);
      if (!(end > start)) continue;
      const double bottom = least_of_piece(start, end);
      least_error = std::min(least_error, error(bottom));
      if (!fits(bottom)) {
        close();
        continue;
      }
      if (!fits(start)) {
        close();
        open = Limits{boundary(start, bottom, false, fits), 0, tolerance, {}};
      } else if (!open) {
        open = Limits{i == 0 ? l.low : start, 0, i == 0 ? l.low_because : tolerance, {}};
      }
      if (fits(end)) {
        open->high = i + 2 == cuts.size() ? l.high : end;
        open->high_because = l.high_because;
      } else {
        open->high = boundary(bottom, end, true, fits);
        open->high_because = tolerance;
        close();
      }
    }
    close();
    return best;
  }

  /// Error of both edges at the best single intensity up to full light, without correction.
  double uncorrected_error(double he) const {
    // Over and under are equal where phi² - 2 phi + phi_min = 0.
    const double balanced = 1 + std::sqrt(std::max(0.0, 1 - phi_min(he)));
    const UncorrectedEdges e =
        uncorrected_edges(std::min(balanced, phi_max(he)), phi_min(he), he / m_);
    return std::max(e.over_um, e.under_um);
  }
  /// Height of the least such error: full light is the balanced intensity.
  double best_uncorrected() const { return limit_ * (2 - ratio_); }
  std::optional<HeightRange> uncorrected_range() const {
    const auto fits = [&](double he) { return uncorrected_error(he) <= wish_.tolerance_um; };
    const double best = best_uncorrected();
    if (!fits(best)) return std::nullopt;
    double high = std::min(black_limit(), kGreatestHeightE) * (1 - 1e-12);
    if (!fits(high)) high = boundary(best, high, true, fits);
    const double low = boundary(limit_ * (1 + 1e-12), best, false, fits);
    return HeightRange{units::height10_from_e(low), units::height10_from_e(high)};
  }

  double gap_um() const { return kGapSlices * wish_.layer_um; }
  double contrast(double he) const {
    return gap_contrast(phi_max(he), phi_min(he), he / m_, gap_um());
  }
  /// The height from `low` to `high` at which gaps keep most contrast.
  double best_contrast(double low, double high) const {
    for (int i = 0; i < 200 && high / low > 1 + 1e-10; ++i) {
      const double third = std::pow(high / low, 1.0 / 3);
      const double p = low * third, q = p * third;
      (contrast(p) > contrast(q) ? high : low) = contrast(p) > contrast(q) ? q : p;
    }
    return std::sqrt(low * high);
  }

 private:
  const Resin& resin_;
  const Printer& printer_;
  const Wish& wish_;
  double speed_, m_ = 1, blue_ = 0, black_ = 0, limit_ = 0, ratio_ = 0;
};

std::string height_words(double he) {
  return fmt::format("{} um (base 10; {} um base e)", figure(units::height10_from_e(he)),
                     figure(he));
}

/// Whether some absorber meets the wish.
bool any_meets(const Resin& resin, const Printer& printer, const Wish& wish) {
  const Designer d(resin, printer, wish, wish.speed_mm_h);
  double least = 0;
  return d.within_tolerance(d.limits(), least).has_value();
}

constexpr int kWayDigits = 3;

/// The value nearest to `now` on the way to `end`, in steps of 15 %, at which `works` holds, with
/// as many digits as that takes; empty when there is none.
std::string first_that_works(double now, double end, const std::function<bool(double)>& works) {
  const bool up = end > now;
  const double step = up ? 1 / 0.85 : 0.85;
  double fails = now;
  for (int i = 0; i < 40 && fails != end; ++i) {
    const double next = up ? std::min(end, fails * step) : std::max(end, fails * step);
    if (!works(next)) {
      fails = next;
      continue;
    }
    const double limit =
        up ? boundary(fails, next, false, works) : boundary(next, fails, true, works);
    for (int digits = kWayDigits; digits <= 15; digits += 2) {
      const double typed = up ? rounded_up(limit, digits) : rounded_down(limit, digits);
      if (works(typed)) return fmt::format("{}", typed);
    }
    return {};
  }
  return {};
}

std::vector<std::string> ways_out(const Designer& d, const Resin& resin, const Printer& printer,
                                  const Wish& wish, const Designer::Limits& limits,
                                  double least_error) {
  std::vector<std::string> ways;
  const auto with_speed = [&](double speed) {
    Wish w = wish;
    w.speed_mm_h = speed;
    return any_meets(resin, printer, w);
  };
  if (!limits.any() && wish.dead_zone_um > 0) {
    std::string text =
        d.keeps_any_dead_zone()
            ? fmt::format(
                  "the UV lamp's {} mW/cm² do not keep a dead zone of {} um and let full light ({} "
                  "mW/cm²) gel the resin at {} mm/h",
                  figure(d.lamp()), figure(wish.dead_zone_um), figure(d.blue()),
                  figure(wish.speed_mm_h))
            : fmt::format(
                  "no dead zone lasts under full blue light ({} mW/cm²) with the UV lamp's {} "
                  "mW/cm²",
                  figure(d.blue()), figure(d.lamp()));
    const auto with_lamp = [&](double most) {
      Printer p = printer;
      if (!p.uv) p.uv = UvLamp{0, false, {{0, 0}, {1, most}}};
      p.uv->calibration.back().intensity_mw_cm2 = most;
      return any_meets(resin, p, wish);
    };
    const double lamp = std::max(d.lamp(), d.blue() / resin.inhibition->beta * 0.5);
    if (const auto most = first_that_works(lamp, lamp * 1e4, with_lamp); !most.empty()) {
      text += fmt::format("; a UV lamp of {} mW/cm² would do", most);
    }
    const auto with_zone = [&](double zone_um) {
      Wish w = wish;
      w.dead_zone_um = zone_um;
      return any_meets(resin, printer, w);
    };
    if (const auto zone = first_that_works(wish.dead_zone_um, wish.dead_zone_um * 1e-3, with_zone);
        !zone.empty()) {
      text += fmt::format("; a dead zone of {} um would do", zone);
    }
    const auto with_blue = [&](double most) {
      Printer p = printer;
      for (CalibrationPoint& c : p.calibration) c.intensity_mw_cm2 *= most / d.blue();
      return any_meets(resin, p, wish);
    };
    if (const auto blue = first_that_works(d.blue(), d.blue() * 1e-3, with_blue); !blue.empty()) {
      text += fmt::format(
          "; a projector of {} mW/cm² at full light, and black in proportion, would do", blue);
    }
    ways.push_back(text);
  } else if (!limits.any()) {
    ways.push_back(fmt::format(
        "the printer's black ({} mW/cm²) is too bright against its full light ({} mW/cm²), or the "
        "speed of {} mm/h is beyond every absorbance height of a resin file",
        figure(d.black()), figure(d.blue()), figure(wish.speed_mm_h)));
  } else {
    ways.push_back(fmt::format(
        "one grey level moves an edge by {} um at the least, whatever the absorber; that tolerance "
        "would do, or a projector with finer steps below the critical intensity",
        at_least(least_error, kWayDigits)));
  }
  if (const auto slower = first_that_works(wish.speed_mm_h, wish.speed_mm_h * 1e-3, with_speed);
      !slower.empty()) {
    ways.push_back(fmt::format("a speed of {} mm/h meets the rest of the wish", slower));
  }
  return ways;
}

void check_wish(const Printer& printer, const Resin& resin, const Wish& wish) {
  if (!(wish.speed_mm_h > 0) || !(wish.tolerance_um > 0) || !(wish.layer_um > 0)) {
    throw InputError("a wish needs a speed, a tolerance and a slice height above 0");
  }
  if (printer.max_speed_mm_h > 0 && wish.speed_mm_h > printer.max_speed_mm_h) {
    throw InputError(
        fmt::format("speed {:g} mm/h is beyond the stage of printer '{}', which reaches {:g} mm/h",
                    wish.speed_mm_h, printer.name, printer.max_speed_mm_h));
  }
  if (wish.dead_zone_um > 0 && !resin.inhibition) {
    throw InputError(resin.name, "inhibition",
                     "a dead zone is asked for, but the resin has no inhibition by UV light; "
                     "expected beta and absorbance_height_um");
  }
}

void describe(const Resin& resin, const Printer& printer, const Wish& wish, Recommendation& r) {
  const Kinetics k = make_kinetics(resin, false, true);
  const std::string at = printer.wavelength_nm > 0
                             ? fmt::format("at {:g} nm", printer.wavelength_nm)
                             : "at the wavelength of the curing light";
  const double present = k.hb_um;
  r.reasons.push_back(aim_words(resin));
  if (r.present_fits) {
    r.reasons.push_back(
        fmt::format("The resin as it is, {}, meets the wish already.", height_words(present)));
  } else {
    r.reasons.push_back(fmt::format(
        "The resin as it is, {}, does not meet the wish: its height is {} the range.",
        height_words(present), r.present_height10_um <= r.range->least_um ? "below" : "above"));
  }
  const double f = r.absorber_factor;
  const std::string best = height_words(r.height_e_um);
  if (f > 1.02) {
    r.reasons.push_back(fmt::format(
        "{}: add absorber until the absorbance {} is {:.3g} times what it is; the height is then "
        "{}.",
        r.present_fits ? "Best for gaps" : "Recommended", at, f, best));
  } else if (f < 0.98) {
    r.reasons.push_back(fmt::format(
        "{}: leave out absorber until the absorbance {} is {:.3g} times what it is; the height is "
        "then {}.",
        r.present_fits ? "Best for gaps" : "Recommended", at, f, best));
  } else {
    r.reasons.push_back("No other absorber would be better by much.");
  }
  r.reasons.push_back(
      fmt::format("Any height between {} and {} um (base 10) will do. Below: {}. Above: {}.",
                  figure(r.range->least_um), figure(r.range->greatest_um), r.least_because,
                  r.greatest_because));
  r.reasons.push_back(fmt::format(
      "At the height above full light is {} times the critical intensity, black light {}; the "
      "fastest speed is {} mm/h{}.",
      figure(r.phi_max), figure(r.phi_min), figure(r.fastest_mm_h),
      r.slowest_mm_h > 0 ? fmt::format(", the slowest {} mm/h", figure(r.slowest_mm_h)) : ""));
  r.reasons.push_back(fmt::format(
      "With correction one grey level moves an edge by {} um at most; one percent more light moves "
      "an upper edge by {} um.",
      figure(r.corrected_error_um), figure(r.um_per_percent_of_light)));
  r.reasons.push_back(fmt::format(
      "Without correction, at full light, thick features would reach {} um past their upper edge "
      "and miss {} um at their lower one.",
      figure(r.uncorrected.over_um), figure(r.uncorrected.under_um)));
  if (r.range_uncorrected) {
    r.reasons.push_back(fmt::format(
        "Without correction the tolerance needs an absorbance height between {} and {} um (base "
        "10) and one intensity for all lit pixels.",
        figure(r.range_uncorrected->least_um), figure(r.range_uncorrected->greatest_um)));
  } else {
    r.reasons.push_back(fmt::format(
        "Without correction no absorber meets {} um at this speed: the best error, with one "
        "intensity for all lit pixels, is {} um, at {} um (base 10).",
        figure(wish.tolerance_um), figure(r.best_uncorrected_error_um),
        figure(r.best_uncorrected_height10_um)));
  }
  if (wish.dead_zone_um > 0) {
    r.reasons.push_back(fmt::format(
        "A dead zone of {} um under full blue light takes {} mW/cm² of UV light; phi falls to {} "
        "by it.",
        figure(wish.dead_zone_um), figure(r.uv_needed_mw_cm2), figure(r.phi_with_uv)));
    r.warnings.push_back(
        "the correction does not reckon with UV light yet: near the window it takes dose away");
  }
  r.reasons.push_back(
      "Assumed: absorber changes the absorbance height and leaves the areal gel dose as it is "
      "(measure again after mixing)" +
      std::string(wish.dead_zone_um > 0 ? "; the UV absorbance height stays as well." : "."));
  if (r.phi_max < 1.25) {
    r.warnings.push_back(fmt::format(
        "full light is only {} times the critical intensity: a dimmer lamp or a dose that is "
        "somewhat higher stops the print from gelling",
        figure(r.phi_max)));
  }
  if (r.gap_contrast < 0.03) {
    r.warnings.push_back(fmt::format(
        "a gap of {} um keeps a contrast of {} only: errors of a few percent in light or dose "
        "close it",
        figure(r.gap_um), figure(r.gap_contrast)));
  }
  const double travel_um = printer.travel_mm * 1000;
  if (travel_um > 0 && r.burst_um > travel_um) {
    r.warnings.push_back(fmt::format(
        "the lower end of a part takes {} um of extra slices, more than the stage's travel",
        figure(r.burst_um)));
  }
  r.reasons.push_back(fmt::format(
      "Below a feature {} um of full light are needed; a gap of {} um keeps a contrast of {}.",
      figure(r.burst_um), figure(r.gap_um), figure(r.gap_contrast)));
}

/// What the height to formulate for means where the display's light is not that of the calibration.
void describe_places(const Resin& resin, const Printer& printer, const Wish& wish,
                     Recommendation& r) {
  if (!printer.flat_field) return;
  const FlatField& field = *printer.flat_field;
  std::array<std::uint64_t, 256> pixels{};
  for (const std::uint8_t v : *field.values) ++pixels[v];
  const double greatest = 1.0 * field.greatest() / field.reference;
  const Resin formulated = with_height(resin, r.height_e_um);
  Recommendation::Places places;
  places.greatest_light = greatest;
  places.least_light = greatest;
  double met = 0, least_met = kInfinity, greatest_met = 0;
  for (int v = 255; v > 0; --v) {
    const std::uint64_t count = pixels[static_cast<std::size_t>(v)];
    if (count == 0) continue;
    const double share = 1.0 * v / field.reference;
    places.least_light = share;
    const Printer there = dimmed(printer, share);
    const Designer d(resin, there, wish, wish.speed_mm_h);
    bool meets = d.phi_max(r.height_e_um) > 1 && d.phi_min(r.height_e_um) < 1 &&
                 d.error(r.height_e_um) <= wish.tolerance_um;
    if (wish.dead_zone_um > 0) {
      // One lamp for the whole window: it keeps the dead zone where light is brightest.
      const double uv = r.uv_needed_mw_cm2 * greatest;
      const Kinetics k = make_kinetics(formulated, true, true);
      meets = meets && uv <= d.lamp() &&
              passing_dose_prime(k, d.blue(), uv, wish.speed_mm_h) > k.critical_dose_prime;
    }
    if (!meets) continue;
    met += static_cast<double>(count);
    least_met = share;
    greatest_met = std::max(greatest_met, share);
  }
  places.share_met = met / static_cast<double>(field.values->size());
  const auto m = make_kinetics(resin, false, true).m;
  places.fastest_mm_h = r.fastest_mm_h * std::pow(places.least_light, m);
  places.slowest_mm_h = r.slowest_mm_h * std::pow(greatest, m);
  r.places = places;
  r.reasons.push_back(fmt::format(
      "All of this holds for places that get the light of the calibration. By its flat-field the "
      "display gives {:.3g} to {:.3g} % of it{}: with the height above the resin gels everywhere{} "
      "up to {} mm/h{}.",
      100 * places.least_light, 100 * greatest,
      pixels[0] > 0 ? ", and none at all in some places" : "", pixels[0] > 0 ? " else" : "",
      at_most(places.fastest_mm_h * (1 - 1e-9)),
      places.slowest_mm_h > 0 ? fmt::format(", and black leaves it liquid from {} mm/h on",
                                            at_least(places.slowest_mm_h * (1 + 1e-9)))
                              : ""));
  if (places.share_met >= 1) {
    r.reasons.push_back("The wish is met on the whole display.");
  } else if (met > 0) {
    r.warnings.push_back(fmt::format(
        "the wish is met on {:.3g} % of the display only, where it gives {:.3g} to {:.3g} % of the "
        "calibration's light",
        100 * places.share_met, 100 * least_met, 100 * greatest_met));
  } else {
    r.warnings.push_back(
        "the wish is met nowhere on the display: no place gets the light of the calibration");
  }
}

}  // namespace

UncorrectedEdges uncorrected_edges(double phi, double phi_min, double effective_um) {
  UncorrectedEdges e;
  e.over_um = phi > 1 && phi_min < 1 ? effective_um * std::log((phi - phi_min) / (1 - phi_min))
              : phi > 1              ? kInfinity
                                     : 0;
  e.under_um = phi > 1 ? -effective_um * std::log1p(-1 / phi) : kInfinity;
  return e;
}

double gap_contrast(double phi_max, double phi_min, double effective_um, double gap_um) {
  if (!(phi_max > 1) || !(phi_min < 1)) return 0;
  // From the lower feature the dose decays upwards to phi_min, from the upper one it must rise
  // downwards, seen from its edge, along phi_max - (phi_max - 1) u; they meet at u (as in A.41).
  const double decay = std::exp(-gap_um / effective_um);
  const double u = (phi_max - phi_min) / ((1 - phi_min) * decay + phi_max - 1);
  return (phi_max - 1) * (u - 1);
}

Resin with_height(const Resin& resin, double height_e_um) {
  Resin r = resin;
  const double now = units::height_e_from_10(resin.absorbance_height10_um);
  r.absorbance_height10_um = units::height10_from_e(height_e_um);
  r.critical_dose_mj_cm3 = units::volumetric_from_areal(
      units::areal_from_volumetric(resin.critical_dose_mj_cm3, now), height_e_um);
  r.gel_dose_mj_cm3 = units::volumetric_from_areal(
      units::areal_from_volumetric(resin.gel_dose_mj_cm3, now), height_e_um);
  return r;
}

double corrected_error_um(const Printer& printer, const Resin& resin, double speed_mm_h,
                          double layer_um) {
  const EdgeSteps e = edge_steps(make_cure_model(printer, resin, continuous(speed_mm_h), layer_um));
  return std::max(e.upper_um, e.lower_um);
}

Recommendation recommend(const Resin& resin, const Printer& printer, const Wish& wish) {
  check_wish(printer, resin, wish);
  const Designer d(resin, printer, wish, wish.speed_mm_h);
  Recommendation r;
  r.present_height10_um = resin.absorbance_height10_um;
  r.range_uncorrected = d.uncorrected_range();
  r.best_uncorrected_height10_um = units::height10_from_e(d.best_uncorrected());
  r.best_uncorrected_error_um = d.uncorrected_error(d.best_uncorrected());
  const Designer::Limits limits = d.limits();
  double least_error = kInfinity;
  const auto found = d.within_tolerance(limits, least_error);
  if (!found) {
    r.ways_out = ways_out(d, resin, printer, wish, limits, least_error);
    if (printer.flat_field) {
      r.ways_out.push_back(fmt::format(
          "this is said of places that get the light of the calibration; by its flat-field the "
          "display gives {}",
          light_in_words(printer)));
    }
    return r;
  }
  r.feasible = true;
  r.range = HeightRange{units::height10_from_e(found->low), units::height10_from_e(found->high)};
  r.least_because = found->low_because;
  r.greatest_because = found->high_because;
  r.present_fits =
      r.present_height10_um > r.range->least_um && r.present_height10_um < r.range->greatest_um;

  const double narrow = std::sqrt(found->high / found->low);
  const double margin = std::min(kMargin, std::sqrt(narrow));
  const double he = d.best_contrast(found->low * margin, found->high / margin);
  const CureModel model = d.model(he);
  r.height_e_um = he;
  r.height10_um = units::height10_from_e(he);
  r.absorber_factor = r.present_height10_um / r.height10_um;
  r.phi_max = model.phi_max();
  r.phi_min = model.phi_min();
  r.fastest_mm_h = wish.speed_mm_h * r.phi_max;
  r.slowest_mm_h = wish.speed_mm_h * r.phi_min;
  r.corrected_error_um = d.error(he);
  const double effective = he / d.m();
  // Dose and floor both rise by a percent: the decay reaches 1 that much later.
  const double more = 1.01;
  r.um_per_percent_of_light =
      more * r.phi_min < 1 ? effective * std::log(more * (1 - r.phi_min) / (1 - more * r.phi_min))
                           : kInfinity;
  r.uncorrected = uncorrected_edges(r.phi_max, r.phi_min, effective);
  r.burst_um = r.uncorrected.under_um;
  r.gap_um = d.gap_um();
  r.gap_contrast = d.contrast(he);
  if (wish.dead_zone_um > 0) {
    r.uv_needed_mw_cm2 = d.uv_needed(he);
    r.phi_with_uv = d.phi_with_uv(he);
  }
  describe(resin, printer, wish, r);
  describe_places(resin, printer, wish, r);
  return r;
}

}  // namespace slicecorr::resins
