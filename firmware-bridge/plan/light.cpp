// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>

#include "plan/checks.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::bridge {
namespace {

/// Relative difference of intensities and dead zones that comes of rounding.
constexpr double kSlack = 1e-6;
/// Share of the dose that gels which black may give while the lamp shines around exposures.
constexpr double kMostBlackExcess = 0.05;

/// UV light of a slice by the schedule: of a lamp that floods the window.
double flood_mw_cm2(const UvSchedule& uv, const Kinetics& kinetics, double full_mw_cm2, int n) {
  if (uv.kind == UvKind::per_slice && !uv.slice_mw_cm2.empty()) {
    const auto last = uv.slice_mw_cm2.size() - 1;
    return uv.slice_mw_cm2[std::min(static_cast<std::size_t>(n), last)];
  }
  return uv.uv_mw_cm2 > 0 ? uv.uv_mw_cm2 : uv_for_dead_zone(kinetics, full_mw_cm2, uv.dead_zone_um);
}

/// Layer by layer: light of black outside of the exposures.
void check_black(PrintPlan& plan, const StackInfo& info, const Machine& machine) {
  if (plan.mode != ExposureMode::layerwise || plan.uv || !(plan.black_mw_cm2 > 0)) return;
  // The lamp goes off a cycle or two after the image has gone; one that warms up is on before it.
  const double cycle_s = machine.limits.cycle_s;
  double time_s = 1.5 * cycle_s;
  if (machine.blue.warm_up_s > 0) time_s += machine.blue.settle_s + 4 * cycle_s;
  const Kinetics k = make_kinetics(*info.resin, false, true);
  plan.black_excess = dose_prime_at(k, plan.black_mw_cm2, 0, 0, time_s) / k.critical_dose_prime /
                      -std::expm1(-k.m * plan.layer_um / k.hb_um);
  if (plan.black_excess <= kMostBlackExcess) return;
  throw InfeasibleError(fmt::format(
      "the lamp of printer '{}' shines behind black for {:.0f} ms more in each layer (cycle_s{}), "
      "which adds up to {:.1f} % of the dose that gels; {:g} % are borne",
      machine.printer.name, time_s * 1e3, machine.blue.warm_up_s > 0 ? ", warm_up_s" : "",
      plan.black_excess * 100, kMostBlackExcess * 100));
}

/// The blue lamp warms up behind black, which may give light, too.
void check_warm_up(const PrintPlan& plan, const StackInfo& info, const Machine& machine) {
  if (!(plan.black_mw_cm2 > 0) || plan.uv || !(machine.blue.warm_up_s > 0)) return;
  // At the window the resin gains dose fastest.
  const Kinetics k = make_kinetics(*info.resin, false, false);
  const double dose =
      dose_prime_at(k, plan.black_mw_cm2, 0, 0, machine.blue.warm_up_s) / k.critical_dose_prime;
  if (dose > 0.5) {
    throw InfeasibleError(fmt::format(
        "the blue lamp warms up for {:g} s behind black, which still gives {:g} {}: {:.0f} % "
        "of the dose that gels the resin; 50 % are borne",
        machine.blue.warm_up_s, plan.black_mw_cm2, unit_of_light(info.resin->unit), dose * 100));
  }
}

/// UV light that the lamp gives. `least_share`: of its greatest intensity.
void check_uv_range(const PrintPlan& plan, const Machine& machine, double least_share) {
  double least = plan.frames.front().uv_mw_cm2, greatest = least;
  for (std::size_t n = 0; n < plan.frames.size(); ++n) {
    // It follows the speed as blue light does.
    const double share =
        lamp_share(plan, LampDrive{}, plan.speed_at(static_cast<int>(n)), static_cast<int>(n));
    least = std::min(least, plan.frames[n].uv_mw_cm2 * (plan.slice_speed_um_s.empty() ? 1 : share));
    greatest = std::max(greatest, plan.frames[n].uv_mw_cm2);
  }
  if (greatest > plan.uv_max_mw_cm2 * (1 + kSlack) ||
      least < least_share * plan.uv_max_mw_cm2 * (1 - kSlack)) {
    throw InfeasibleError(fmt::format(
        "the stack asks for {:.4g} to {:.4g} mW/cm² of UV light, the lamp of printer '{}' gives "
        "{:.4g} to {:.4g}",
        least, greatest, machine.printer.name, least_share * plan.uv_max_mw_cm2,
        plan.uv_max_mw_cm2));
  }
}

/// What a frame says of light: whether it is lit, its UV light, and whether that keeps resin off
/// the window. Frames may be planned on any threads at once.
class FrameLight {
 public:
  FrameLight(const PrintPlan& plan, const StackReader& stack, const Machine& machine);

  /// Fills in `frame`, the n-th. What is wrong with it in words, else empty.
  std::string plan_frame(int n, FramePlan& frame) const;

 private:
  using Image = std::vector<std::uint8_t>;
  /// The greatest blue light over UV light, which counts as a share of the lamp's; `most`: the
  /// image's greatest pixel.
  double greatest_ratio(int n, const Image& image, std::uint8_t most) const;
  double intensity_of(std::uint8_t pixel) const {
    return blue_[static_cast<std::size_t>(level_[pixel])];
  }

  const PrintPlan& plan_;
  const StackReader& stack_;
  const Process& process_;
  const double uv_tolerance_mw_cm2_;  ///< of the lamp
  const LightMap light_;
  const std::size_t pixels_;
  const std::vector<double> blue_;  ///< mW/cm², by level
  std::array<int, 256> level_{};    ///< by pixel value
  Image places_;                    ///< values of the light map, where they count
  std::optional<Kinetics> kinetics_;
  std::array<double, 256> uv_intensity_{};  ///< mW/cm², by pixel value of patterned UV light
};

FrameLight::FrameLight(const PrintPlan& plan, const StackReader& stack, const Machine& machine)
    : plan_(plan),
      stack_(stack),
      process_(*stack.info().process),
      uv_tolerance_mw_cm2_(machine.uv.tolerance * plan.uv_max_mw_cm2),
      light_(machine.printer, stack.info().grid, stack.frame()),
      pixels_(static_cast<std::size_t>(stack.info().grid.width_px) *
              static_cast<std::size_t>(stack.info().grid.height_px)),
      blue_(level_intensities(machine.printer)) {
  const Printer& printer = machine.printer;
  for (int v = 0; v < 256; ++v) {
    level_[static_cast<std::size_t>(v)] = level_of_pixel(v, printer.levels());
  }
  if (!plan.uv) return;
  kinetics_ = make_kinetics(*stack.info().resin, true, true);
  if (!light_.even()) {
    places_.resize(pixels_);
    light_.values({0, 0, stack.info().grid.width_px, stack.info().grid.height_px}, places_.data());
  }
  if (!plan.uv_patterned) return;
  const auto levels = uv_level_intensities(printer);
  for (int v = 0; v < 256; ++v) {
    uv_intensity_[static_cast<std::size_t>(v)] =
        levels[static_cast<std::size_t>(level_of_pixel(v, static_cast<int>(levels.size())))];
  }
}

double FrameLight::greatest_ratio(int n, const Image& image, std::uint8_t most) const {
  if (places_.empty() && !plan_.uv_patterned) return intensity_of(most);
  Image uv_image;
  if (plan_.uv_patterned) {
    uv_image.resize(pixels_);
    stack_.read_uv_slice(n, uv_image.data());
  }
  double ratio = 0;
  for (std::size_t p = 0; p < pixels_; ++p) {
    if (level_[image[p]] <= 0) continue;
    double value = intensity_of(image[p]);
    if (!places_.empty()) value *= light_.factor(places_[p]);
    if (plan_.uv_patterned) {
      value /= std::max(uv_intensity_[uv_image[p]] / plan_.uv_max_mw_cm2, 1e-12);
    }
    ratio = std::max(ratio, value);
  }
  return ratio;
}

std::string FrameLight::plan_frame(int n, FramePlan& frame) const {
  Image image(pixels_);
  stack_.read_slice(n, image.data());
  const std::uint8_t most = *std::max_element(image.begin(), image.end());
  frame.lit = level_[most] > 0;
  if (!plan_.uv) return {};
  const double brightest = light_.factor(light_.greatest());
  frame.uv_mw_cm2 = plan_.uv_patterned
                        ? plan_.uv_max_mw_cm2
                        : flood_mw_cm2(process_.uv, *kinetics_, blue_.back() * brightest, n);
  if (!frame.lit || process_.allow_window_cure) return {};
  if (process_.even_light) {
    // Found by the dose that flowing resin brings to the window, which may gain some where it stays for
    // a moment: the light of the stack is what keeps it off.
    frame.least_uv_mw_cm2 = std::max(0.0, frame.uv_mw_cm2 - uv_tolerance_mw_cm2_);
    return {};
  }
  const double ratio = greatest_ratio(n, image, most);
  frame.least_uv_mw_cm2 = uv_for_dead_zone(*kinetics_, ratio, 0);
  const double wanted = uv_for_dead_zone(*kinetics_, ratio, process_.uv.dead_zone_um);
  // Without a dead zone asked for any will do, but for none.
  const bool held = process_.uv.dead_zone_um > 0
                        ? wanted <= frame.uv_mw_cm2 * (1 + kSlack)
                        : keeps_dead_zone(*kinetics_, ratio, frame.uv_mw_cm2);
  if (held) return {};
  return fmt::format(
      "slice {} needs {}{:.4g} mW/cm² of UV light under its brightest pixel{}, the stack has "
      "{:.4g}: resin would cure to the window; correct the part with more UV light",
      n, process_.uv.dead_zone_um > 0 ? "" : "more than ", wanted,
      process_.uv.dead_zone_um > 0
          ? fmt::format(" for its dead zone of {:g} um", process_.uv.dead_zone_um)
          : std::string(),
      frame.uv_mw_cm2);
}

}  // namespace

void plan_light(PrintPlan& plan, const StackReader& stack, const Machine& machine,
                const ExecutionContext& context) {
  const StackInfo& info = stack.info();
  const Process& process = *info.process;
  const Printer& printer = machine.printer;
  plan.black_mw_cm2 = level_intensities(printer).front();
  plan.uv = process.uv.kind != UvKind::off;
  plan.uv_patterned = process.uv.kind == UvKind::patterned;
  if (printer.uv) plan.uv_max_mw_cm2 = printer.uv->max_mw_cm2();

  check_warm_up(plan, info, machine);
  const FrameLight light(plan, stack, machine);
  const double uv_least_share =
      plan.uv ? std::max(machine.uv.min_share, printer.uv->min_mw_cm2() / plan.uv_max_mw_cm2) : 0;
  check_black(plan, info, machine);

  std::mutex failing;
  int first_bad = -1;
  std::string bad;
  parallel_for(context, "check", plan.frames.size(), [&](std::size_t i) {
    const int n = static_cast<int>(i);
    const std::string wrong = light.plan_frame(n, plan.frames[i]);
    if (wrong.empty()) return;
    const std::scoped_lock lock(failing);
    if (first_bad >= 0 && first_bad < n) return;
    first_bad = n;
    bad = wrong;
  });
  if (first_bad >= 0) throw InfeasibleError(bad);
  if (plan.uv) check_uv_range(plan, machine, uv_least_share);
}

}  // namespace slicecorr::bridge
