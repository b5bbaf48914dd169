// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Pictures that need parameters alone: curing fronts, and what a resin file says.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/fit_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/plots.hpp"
#include "slicecorr/units.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::resins {

namespace {

using chart::Axis;
using chart::figure;
using chart::Panel;
using chart::Picture;
using chart::Point;
using chart::Style;

/// `unit`: of its dose.
std::string words_of(const Kinetics& k, const std::string& unit) {
  if (k.has_gel_time()) {
    return fmt::format("h {} um (base e), A {} mJ/cm², B {} √(mW/cm²)·s: gels after A/i + B/√i",
                       figure(k.hb_um), figure(k.gel_time.A), figure(k.gel_time.B));
  }
  std::string text = fmt::format("hb {} um, D′c {} {}, m {}", figure(k.hb_um),
                                 figure(k.critical_dose_prime), unit, figure(k.m));
  if (k.bleaching) {
    text += fmt::format(", bleaches to hb {} um by {} mJ/cm²", figure(1 / k.bleaching->bleached()),
                        figure(k.bleaching->dose()));
  }
  if (k.beta > 0) text += fmt::format(", β {}, huv {} um", figure(k.beta), figure(k.huv_um));
  return text + " (heights base e, doses areal)";
}

/// Heights against time, s and um.
struct FrontCurves {
  std::vector<Point> front, back;
  std::vector<Point> without;  ///< cured height without UV light
};

FrontCurves curves_of(const Kinetics& k, double blue, double uv, double first_s, double end_s) {
  FrontCurves curves;
  constexpr int points = 240;
  for (int i = 0; i <= points && end_s > first_s; ++i) {
    // Close together at first: both fronts start off vertically.
    const double u = static_cast<double>(i) / points;
    const double t = i == 0 ? first_s : first_s + (end_s - first_s) * u * u * u;
    if (const auto f = curing_fronts(k, blue, uv, t)) {
      curves.front.push_back({t, f->front_um});
      curves.back.push_back({t, f->back_um});
    }
  }
  for (int i = 1; i <= points; ++i) {
    const double t = end_s * i / points;
    const double z = cured_height_um(k, blue, t);
    if (z >= 0) curves.without.push_back({t, z});
  }
  return curves;
}

}  // namespace

std::string fronts_svg(const Kinetics& k, double blue, double uv, double greatest_time_s,
                       const std::string& name) {
  const FirstGel first = first_gel(k, blue, uv);
  if (!std::isfinite(first.time_s)) {
    throw InputError("without blue light nothing gels; expected an intensity above 0");
  }
  const double end = greatest_time_s > 0 ? greatest_time_s : 8 * first.time_s;
  const double steady = steady_dead_zone_um(k, blue, uv);
  const double window = window_time_s(k, blue, uv);
  const bool inhibited = k.beta > 0 && uv > 0;

  const FrontCurves curves = curves_of(k, blue, uv, first.time_s, end);
  const std::vector<Point>&front = curves.front, &back = curves.back, &without = curves.without;

  const std::string light = inhibited
                                ? fmt::format("Ib {}, Iuv {} mW/cm²", figure(blue), figure(uv))
                                : fmt::format("Ib {} mW/cm², no UV", figure(blue));
  Picture picture(titled(name, "curing fronts, " + light),
                  fmt::format("Height of the curing fronts over time. First gel {} um above the "
                              "window after {} s; steady dead zone {} um.",
                              figure(first.z_um), figure(first.time_s), figure(steady)));
  picture.legend_band(Style::fit, "cured");
  picture.legend_line(Style::fit, inhibited ? "fronts zf and zb" : "front zb");
  if (inhibited) picture.legend_line(Style::other, "zb without UV");

  const std::string start =
      fmt::format("z0 = {} um, t0 = {} s", figure(first.z_um), figure(first.time_s));
  // The window is seen twice: with all that is cured, and closer, with the dead zone.
  const auto draw = [&](Axis y, double height, bool labels, bool close, bool start_words) {
    Panel panel({"time, s", false, 0, end}, std::move(y), height, labels);
    panel.band(front, back, Style::fit);
    if (steady > 0) {
      panel.horizontal(steady,
                       close ? fmt::format("zf in the long run: {} um", figure(steady)) : "", true);
    }
    panel.line(back, Style::fit);
    if (inhibited) {
      panel.line(front, Style::fit);
      panel.line(without, Style::other);
    }
    if (window < end && inhibited) {
      panel.vertical(window, fmt::format("at the window after {} s", figure(window)));
    }
    panel.dot({first.time_s, first.z_um});
    if (first.time_s < end && start_words) {
      panel.words({first.time_s, first.z_um}, start, 12, first.z_um > 0 ? 5 : -10);
    }
    if (!back.empty()) {
      const auto at = static_cast<std::size_t>(0.9 * static_cast<double>(back.size()));
      if (!close) panel.words(back[at], "zb", -4, 22, "end");
      if (inhibited && front[at].y > 0) panel.words(front[at], "zf", 0, -8, "end");
    }
    picture.add(panel);
  };
  double top = first.z_um;
  if (!back.empty()) top = std::max(top, back.back().y);
  if (!without.empty()) top = std::max(top, without.back().y);
  const bool zoom = first.z_um > 0 && !front.empty();
  draw({"height above the window, um", false, 0, top > 0 ? 1.06 * top : 1}, 300, !zoom, false,
       !zoom);
  if (zoom) draw({"the same, closer, um", false, 0, 1.25 * first.z_um}, 170, true, true, true);

  picture.note(words_of(k, prime_unit(k.m)));
  if (end <= first.time_s) {
    picture.note(
        fmt::format("Nothing gels within {} s: the first gel comes after {} s, {} um above the "
                    "window.",
                    figure(end), figure(first.time_s), figure(first.z_um)));
  } else if (steady > 0) {
    picture.note(fmt::format("The dead zone lasts: {} um in the long run.", figure(steady)));
  } else if (std::isfinite(window)) {
    picture.note(fmt::format(
        "{} The front reaches the window after {} s.",
        inhibited ? "No dead zone lasts, β Iuv is below Ib." : "Without UV there is no dead zone.",
        figure(window)));
  }
  return picture.svg();
}

namespace {

/// Times to gel over intensity, between the two laws that rule at its ends, and their exponent.
std::string gel_time_svg(const std::string& name, const Kinetics& gel, const Kinetics& aim) {
  const GelTime& g = gel.gel_time;
  // Around the intensity at which both terms are as long.
  const double even = std::pow(g.A / g.B, 2);
  Picture picture(
      titled(name, "time to gel"),
      fmt::format("Time to gel over intensity, from the parameters of resin {}.", name));
  const Axis x{"intensity at the place, mW/cm²", true, even / 1000, even * 1000};
  std::vector<Point> line, by_a, by_b, exponent;
  for (int i = 0; i <= 240; ++i) {
    const double at = x.low * std::pow(x.high / x.low, i / 240.0);
    line.push_back({at, gel_time_s(g, at)});
    by_a.push_back({at, g.A / at});
    by_b.push_back({at, g.B / std::sqrt(at)});
    exponent.push_back({at, local_exponent(g, at)});
  }
  const bool further = aim.gel_time.A > g.A;
  picture.legend_line(Style::fit, "time to gel A/i + B/√i");
  picture.legend_line(Style::other, "A/i alone, B/√i alone");
  Panel panel(x, {"time, s", true, line.back().y / 3, line.front().y * 1.5}, 300);
  panel.line(by_a, Style::other);
  panel.line(by_b, Style::other);
  panel.line(line, Style::fit);
  panel.vertical(even, fmt::format("both as long at {}", figure(even)), 0);
  picture.add(panel);
  Panel below(x, {"exponent m there", false, 0.45, 1.05}, 160);
  below.line(exponent, Style::fit);
  picture.add(below);
  picture.note(words_of(gel, prime_unit(gel.m)));
  if (further) {
    picture.note(fmt::format("Correction aims at {:.3g} times that time.", aim.gel_time.A / g.A));
  }
  picture.note("Drawn from the parameters alone, without measurements.");
  return picture.svg();
}

}  // namespace

std::string record_svg(const ResinRecord& record) {
  const Resin& resin = record.resin;
  if (resin.has_gel_time()) {
    return gel_time_svg(record.name, make_kinetics(resin, false, false),
                        make_kinetics(resin, false, true));
  }
  const Kinetics gel = make_kinetics(resin, false, false);
  const Kinetics aim = make_kinetics(resin, false, true);
  const double gel_dose = gel.critical_dose_prime, aim_dose = aim.critical_dose_prime;
  // A dose without a factor is one to aim at; that the resin gels there is not said.
  const bool gel_known = aim_dose > gel_dose * (1 + 1e-9) || resin.gel_dose_mj_cm3 > 0;
  const std::string unit =
      is_relative(resin) ? std::string(unit_of_dose(resin.unit)) : prime_unit(gel.m);

  Picture picture(
      titled(record.name, resin.inhibition ? "working curve and dead zone" : "working curve"),
      fmt::format("Cured height over dose, from the parameters of resin {}.", record.name));
  const Axis x{gel.m == 1 ? "dose D, " + unit : fmt::format("dose analogue D′ = Iᵐ t, {}", unit),
               true, gel_dose / 1.6, std::max(2 * aim_dose, 30 * gel_dose)};
  const double top = cured_height_um(gel, 1, x.high);
  Panel panel(x, {"cured height, um", false, 0, 1.04 * top}, 280);
  std::vector<Point> curve;
  const int points = gel.bleaching ? 120 : 1;
  for (int i = 0; i <= points; ++i) {
    const double dose = gel_dose * std::pow(x.high / gel_dose, static_cast<double>(i) / points);
    curve.push_back({dose, cured_height_um(gel, 1, dose)});
  }
  panel.line(curve, Style::fit);
  if (gel_known) {
    panel.vertical(gel_dose, fmt::format("gel dose {}", figure(gel_dose)), 0);
    if (aim_dose > gel_dose) {
      panel.vertical(
          aim_dose, fmt::format("aim {:.3g} × gel = {}", aim_dose / gel_dose, figure(aim_dose)), 1);
    }
  } else {
    panel.vertical(aim_dose, fmt::format("aim {}", figure(aim_dose)), 0);
  }
  panel.dot({gel_dose, 0});
  picture.add(panel);
  if (resin.inhibition) {
    const Kinetics k = make_kinetics(resin, true, false);
    const Axis ratio{"ratio of UV to blue intensity, Iuv/Ib", true, 0.5 / k.beta, 30 / k.beta};
    std::vector<Point> line;
    for (int i = 0; i <= 200; ++i) {
      const double r = ratio.low * std::pow(ratio.high / ratio.low, i / 200.0);
      line.push_back({r, steady_dead_zone_um(k, 1, r)});
    }
    Panel zone(ratio, {"steady dead zone, um", false, 0, 1.08 * line.back().y}, 200);
    zone.vertical(1 / k.beta, fmt::format("β Iuv = Ib at {}", figure(1 / k.beta)));
    zone.line(line, Style::fit);
    picture.add(zone);
    picture.note(words_of(k, unit));
  } else {
    picture.note(words_of(gel, unit));
  }
  picture.note(
      gel_known ? fmt::format("Correction aims at {} {}, {:.3g} times the gel dose.",
                              figure(aim_dose), unit, aim_dose / gel_dose)
                : fmt::format("Correction aims at {} {}. The file gives no gel dose: the curve is "
                              "that of the dose aimed at.",
                              figure(aim_dose), unit));
  picture.note("Drawn from the parameters alone, without measurements.");
  return picture.svg();
}

}  // namespace slicecorr::resins
