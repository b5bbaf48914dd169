// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Whether a vat bears a print: the gap, the slowest slice, and what is said of it.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/limit.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

/// int_0^h of the rate, um (mW/cm²)^m; inhibitor counts as negative dose.
double rate_integral(const Kinetics& k, const FlowLight& light, double h_um) {
  const double blue = light.blue_mw_cm2, uv = k.beta * light.uv_mw_cm2;
  if (k.m == 1) {
    return -blue * k.hb_um * std::expm1(-h_um / k.hb_um) +
           uv * k.huv_um * std::expm1(-h_um / k.huv_um);
  }
  // Simpson; the rate is smooth but for its root, where it is 0 itself.
  constexpr int kSteps = 512;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double z_um = h_um * i / kSteps;
    const double a = blue * std::exp(-z_um / k.hb_um) - uv * std::exp(-z_um / k.huv_um);
    const double weight = i == 0 || i == kSteps ? 1 : i % 2 == 1 ? 4 : 2;
    sum += weight * std::copysign(std::pow(std::abs(a), k.m), a);
  }
  return sum * h_um / (3 * kSteps);
}

}  // namespace

double even_gap_um(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                   double speed_mm_h) {
  if (kinetics.beta <= 0) {
    throw InfeasibleError(
        "the resin has no [inhibition]: without a dead zone it sticks to the window at once; expected "
        "a resin that UV light inhibits");
  }
  if (!keeps_dead_zone(kinetics, blue_mw_cm2, uv_mw_cm2)) {
    throw InfeasibleError(fmt::format(
        "no dead zone lasts under {:g} mW/cm² of UV light and {:g} of blue: resin sticks "
        "to the window; a dead zone lasts above {} mW/cm² of UV light",
        uv_mw_cm2, blue_mw_cm2, at_least(blue_mw_cm2 / kinetics.beta)));
  }
  const double speed_um_s = speed_mm_h / 3.6;
  const FlowLight light{blue_mw_cm2, uv_mw_cm2};
  const double wanted = speed_um_s * kinetics.critical_dose_prime;
  const double low =
      std::min(steady_dead_zone_um(kinetics, blue_mw_cm2, uv_mw_cm2), kThickestGapUm);
  constexpr double high = kThickestGapUm;
  const auto less = [&](double um) { return rate_integral(kinetics, light, um) < wanted; };
  return less(high) ? high : halved({low, high}, 60, less).high;
}

PrintGap print_gap(const Printer& printer, const Resin& resin, const Process& process,
                   double given_um) {
  if (process.even_light)
    return {process.even_light->gap_um, "the dead zone that the light is for"};
  if (given_um > 0) return {given_um, "as given"};
  const UvSchedule& uv = process.uv;
  if (uv.dead_zone_um > 0) return {uv.dead_zone_um, "the dead zone that the UV light is to hold"};
  if (uv.kind == UvKind::constant && resin.inhibition) {
    const Kinetics kinetics = make_kinetics(resin, true, true);
    const double blue = level_intensities(as_lit(printer, process)).back();
    if (keeps_dead_zone(kinetics, blue, uv.uv_mw_cm2)) {
      return {even_gap_um(kinetics, blue, uv.uv_mw_cm2, process.speed_mm_h),
              "where resin has its dose in the mean under full light"};
    }
  }
  return {kDefaultGapUm, "assumed"};
}

namespace {

/// The part on the flow's cells; nothing where the print is not judged.
std::optional<FlowPart> judged_part(const SliceSource& target, const Resin& resin,
                                    const Process& process, const PrintGap& gap,
                                    const ExecutionContext& context) {
  const bool judged = resin.viscosity_pa_s > 0 && process.mode == ExposureMode::continuous;
  if (!judged || target.bounds().empty()) return std::nullopt;
  const Grid& g = target.grid();
  const PixelBox box = target.bounds();
  if (std::min(box.width() * g.pixel_x_um, box.height() * g.pixel_y_um) <
      3 * std::max(g.pixel_x_um, g.pixel_y_um)) {
    return std::nullopt;
  }
  // The slowest slice is a wide one: cells may be coarser than where all are looked at.
  constexpr double kMostPitchUm = 500;
  std::optional<FlowPart> part;
  part.emplace(target, FlowPartOptions{.most_pitch_um = kMostPitchUm, .gap_um = gap.gap_um},
               context);
  if (part->masks() == 0) return std::nullopt;
  return part;
}

double limit_pa(const Printer& printer) {
  return printer.suction_limit_pa > 0 ? printer.suction_limit_pa : kCavitationPa;
}

std::vector<SliceFlow> flow_of_slices(const FlowPart& part, const Printer& printer,
                                      const Resin& resin, const Process& process,
                                      const PrintGap& gap, const ExecutionContext& context) {
  FlowPull pull;
  pull.viscosity_pa_s = resin.viscosity_pa_s;
  pull.speed_mm_h = process.speed_mm_h;
  pull.gap_um = gap.gap_um;
  pull.limit_pa = limit_pa(printer);
  return part_flow(part, pull, context);
}

}  // namespace

std::optional<PrintSuction> print_suction(const SliceSource& target, const Printer& printer,
                                          const Resin& resin, const Process& process,
                                          double given_gap_um, const ExecutionContext& context) {
  const bool judged = resin.viscosity_pa_s > 0 && process.mode == ExposureMode::continuous;
  if (!judged) return std::nullopt;
  PrintSuction print;
  print.gap = print_gap(printer, resin, process, given_gap_um);
  const auto part = judged_part(target, resin, process, print.gap, context);
  if (!part) return std::nullopt;
  const LayerHeights heights(process.layer_heights_um);
  print.limit_given = printer.suction_limit_pa > 0;
  print.limit_pa = limit_pa(printer);
  print.speed_mm_h = process.speed_mm_h;
  if (!process.slice_speed_mm_h.empty()) {
    const auto share = [&](const SliceFlow& s) {
      return slice_speed_mm_h(process, s.slice) / s.speed_limit_mm_h;
    };
    const auto slices = flow_of_slices(*part, printer, resin, process, print.gap, context);
    const SliceFlow& s = *std::max_element(
        slices.begin(), slices.end(),
        [&](const SliceFlow& a, const SliceFlow& b) { return share(a) < share(b); });
    print.slice = s.slice;
    print.z_mm = heights.place_um(s.slice + 0.5, part->layer_um()) * 1e-3;
    print.x_mm = s.x_mm;
    print.y_mm = s.y_mm;
    print.speed_mm_h = slice_speed_mm_h(process, s.slice);
    print.suction_pa = s.suction_pa * print.speed_mm_h / process.speed_mm_h;
    print.force_n = s.force_n * print.speed_mm_h / process.speed_mm_h;
    print.speed_limit_mm_h = s.speed_limit_mm_h;
    return print;
  }
  const SlowestSlice slowest = slowest_slice(*part, context);
  const auto [x_mm, y_mm] = part->grid().place_mm(slowest.phi.cell);
  print.slice = slowest.slice;
  print.z_mm = heights.place_um(slowest.slice + 0.5, part->layer_um()) * 1e-3;
  print.x_mm = x_mm;
  print.y_mm = y_mm;
  const double mu = resin.viscosity_pa_s, h_um = print.gap.gap_um, speed = process.speed_mm_h;
  print.suction_pa = suction_pa(slowest.phi.max_phi_um2, mu, speed, h_um);
  print.force_n = suction_force_n(slowest.phi.integral_um4, mu, speed, h_um);
  print.speed_limit_mm_h =
      suction_speed_limit_mm_h(slowest.phi.max_phi_um2, mu, h_um, print.limit_pa);
  return print;
}

std::vector<double> slice_speed_limits(const SliceSource& target, const Printer& printer,
                                       const Resin& resin, const Process& process,
                                       double given_gap_um, const ExecutionContext& context) {
  if (!(resin.viscosity_pa_s > 0)) return {};
  const PrintGap gap = print_gap(printer, resin, process, given_gap_um);
  const auto part = judged_part(target, resin, process, gap, context);
  if (!part) return {};
  std::vector<double> limits(static_cast<std::size_t>(target.grid().layers) + 1,
                             std::numeric_limits<double>::infinity());
  for (const SliceFlow& s : flow_of_slices(*part, printer, resin, process, gap, context)) {
    limits.at(static_cast<std::size_t>(s.slice)) = s.speed_limit_mm_h;
  }
  return limits;
}

std::string suction_in_words(const PrintSuction& s, double speed_mm_h) {
  return fmt::format(
      "suction under the part: {:.4g} Pa and {:.3g} N at {:g} mm/h in slice {} ({:.3f} mm), greatest at "
      "x {:.2f}, y {:.2f} mm; {} is reached at {} mm/h (gap {:.4g} um, {})",
      s.suction_pa, s.force_n, speed_mm_h, s.slice, s.z_mm, s.x_mm, s.y_mm,
      s.limit_given ? fmt::format("the printer's limit of {:g} Pa", s.limit_pa)
                    : std::string("1 bar, where resin cavitates,"),
      at_most(s.speed_limit_mm_h), s.gap.gap_um, s.gap.words);
}

void check_suction(const PrintSuction& s, const Printer& printer, double speed_mm_h) {
  if (!s.limit_given || speed_mm_h <= s.speed_limit_mm_h) return;
  throw InfeasibleError(fmt::format(
      "at {:g} mm/h the resin under slice {} ({:.3f} mm) is drawn with {:.4g} Pa at x {:.2f}, y {:.2f} "
      "mm; printer '{}' bears {:g} Pa (suction_limit_pa): expected at most {} mm/h for a gap of "
      "{:.4g} um ({})",
      speed_mm_h, s.slice, s.z_mm, s.suction_pa, s.x_mm, s.y_mm, printer.name, s.limit_pa,
      at_most(s.speed_limit_mm_h), s.gap.gap_um, s.gap.words));
}

}  // namespace slicecorr
