#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>

#include "plan/checks.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
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

/// What the dimmest share of a lamp leaves dark at both ends of ramps.
void check_ramps(const PrintPlan& plan, const Machine& machine, double uv_least_share) {
  const double least = std::max(machine.blue.min_share, uv_least_share);
  const double dark_um = plan.ramp_um * std::pow(least, 2 * plan.m);
  if (!plan.lamps_follow() || dark_um <= machine.limits.max_late_um) return;
  throw InfeasibleError(fmt::format(
      "the lamps of printer '{}' can't follow the stage below {:g} % of their light: {:.1f} um "
      "would stay dark at both ends, {:g} um are borne (max_late_um); correct the part with --ramp "
      "outside, or with a ramp of {:.4g} mm or less",
      machine.printer.name, least * 100, dark_um, machine.limits.max_late_um,
      plan.ramp_um * machine.limits.max_late_um / dark_um * 1e-3));
}

/// Layer by layer: light of black outside of the exposures.
void check_black(PrintPlan& plan, const StackInfo& info, const Machine& machine) {
  if (plan.mode != ExposureMode::layerwise || plan.uv || !(plan.black_mw_cm2 > 0)) return;
  // The lamp goes off a cycle or two after the image has gone; one that warms up is on before it.
  const double cycle_s = machine.limits.cycle_s;
  double time_s = 1.5 * cycle_s;
  if (machine.blue.warm_up_s > 0) time_s += machine.blue.settle_s + 4 * cycle_s;
  const Kinetics k = make_kinetics(*info.resin, false, true);
  plan.black_excess = std::pow(plan.black_mw_cm2, k.m) * time_s / k.critical_dose_prime /
                      -std::expm1(-k.m * plan.layer_um / k.hb_um);
  if (plan.black_excess <= kMostBlackExcess) return;
  throw InfeasibleError(fmt::format(
      "the lamp of printer '{}' shines behind black for {:.0f} ms more in each layer (cycle_s{}), "
      "which adds up to {:.1f} % of the dose that gels; {:g} % are borne",
      machine.printer.name, time_s * 1e3, machine.blue.warm_up_s > 0 ? ", warm_up_s" : "",
      plan.black_excess * 100, kMostBlackExcess * 100));
}

}  // namespace

void plan_light(PrintPlan& plan, const StackReader& stack, const Machine& machine,
                const ExecutionContext& context) {
  const StackInfo& info = stack.info();
  const Process& process = *info.process;
  const Printer& printer = machine.printer;
  const Grid& grid = info.grid;
  const auto pixels =
      static_cast<std::size_t>(grid.width_px) * static_cast<std::size_t>(grid.height_px);
  const std::vector<double> blue = level_intensities(printer);
  plan.black_mw_cm2 = blue.front();
  plan.uv = process.uv.kind != UvKind::off;
  plan.uv_patterned = process.uv.kind == UvKind::patterned;
  if (printer.uv) plan.uv_max_mw_cm2 = printer.uv->max_mw_cm2();

  if (plan.black_mw_cm2 > 0 && !plan.uv && machine.blue.warm_up_s > 0) {
    // At the window the resin gains dose fastest.
    const Kinetics k = make_kinetics(*info.resin, false, false);
    const double dose =
        std::pow(plan.black_mw_cm2, k.m) * machine.blue.warm_up_s / k.critical_dose_prime;
    if (dose > 0.5) {
      throw InfeasibleError(fmt::format(
          "the blue lamp warms up for {:g} s behind black, which still gives {:g} mW/cm²: {:.0f} % "
          "of the dose that gels the resin; 50 % are borne",
          machine.blue.warm_up_s, plan.black_mw_cm2, dose * 100));
    }
  }

  const LightMap light(printer, grid, stack.frame());
  std::vector<std::uint8_t> places;
  if (plan.uv && !light.even()) {
    places.resize(pixels);
    light.values({0, 0, grid.width_px, grid.height_px}, places.data());
  }
  std::array<int, 256> level{};
  for (int v = 0; v < 256; ++v)
    level[static_cast<std::size_t>(v)] = level_of_pixel(v, printer.levels());
  const auto intensity_of = [&](std::uint8_t pixel) {
    return blue[static_cast<std::size_t>(level[pixel])];
  };

  std::optional<Kinetics> kinetics;
  std::array<double, 256> uv_intensity{};
  double uv_least_share = 0;
  if (plan.uv) {
    kinetics = make_kinetics(*info.resin, true, true);
    uv_least_share = std::max(machine.uv.min_share, printer.uv->min_mw_cm2() / plan.uv_max_mw_cm2);
    if (plan.uv_patterned) {
      const auto levels = uv_level_intensities(printer);
      for (int v = 0; v < 256; ++v) {
        uv_intensity[static_cast<std::size_t>(v)] =
            levels[static_cast<std::size_t>(level_of_pixel(v, static_cast<int>(levels.size())))];
      }
    }
  }
  check_ramps(plan, machine, uv_least_share);
  check_black(plan, info, machine);

  const double brightest = light.factor(light.greatest());
  std::mutex failing;
  int first_bad = -1;
  std::string bad;
  parallel_for(context, "check", plan.frames.size(), [&](std::size_t i) {
    const int n = static_cast<int>(i);
    FramePlan& frame = plan.frames[i];
    std::vector<std::uint8_t> image(pixels), uv_image;
    stack.read_slice(n, image.data());
    const std::uint8_t most = *std::max_element(image.begin(), image.end());
    frame.lit = level[most] > 0;
    if (!plan.uv) return;
    frame.uv_mw_cm2 = plan.uv_patterned
                          ? plan.uv_max_mw_cm2
                          : flood_mw_cm2(process.uv, *kinetics, blue.back() * brightest, n);
    if (!frame.lit || process.allow_window_cure) return;
    // Blue light over UV light where that is greatest; UV light as a share of the lamp's.
    double ratio = 0;
    if (plan.uv_patterned) {
      uv_image.resize(pixels);
      stack.read_uv_slice(n, uv_image.data());
    }
    const auto at = [&](std::size_t p) {
      double value = intensity_of(image[p]);
      if (!places.empty()) value *= light.factor(places[p]);
      if (plan.uv_patterned) {
        value /= std::max(uv_intensity[uv_image[p]] / plan.uv_max_mw_cm2, 1e-12);
      }
      return value;
    };
    if (places.empty() && !plan.uv_patterned) {
      ratio = intensity_of(most);
    } else {
      for (std::size_t p = 0; p < pixels; ++p) {
        if (level[image[p]] > 0) ratio = std::max(ratio, at(p));
      }
    }
    frame.least_uv_mw_cm2 = uv_for_dead_zone(*kinetics, ratio, 0);
    const double wanted = uv_for_dead_zone(*kinetics, ratio, process.uv.dead_zone_um);
    // Without a dead zone asked for any will do, but for none.
    const bool held = process.uv.dead_zone_um > 0
                          ? wanted <= frame.uv_mw_cm2 * (1 + kSlack)
                          : keeps_dead_zone(*kinetics, ratio, frame.uv_mw_cm2);
    if (held) return;
    const std::scoped_lock lock(failing);
    if (first_bad >= 0 && first_bad < n) return;
    first_bad = n;
    bad = fmt::format(
        "slice {} needs {}{:.4g} mW/cm² of UV light under its brightest pixel{}, the stack has "
        "{:.4g}: resin would cure to the window; correct the part with more UV light",
        n, process.uv.dead_zone_um > 0 ? "" : "more than ", wanted,
        process.uv.dead_zone_um > 0
            ? fmt::format(" for its dead zone of {:g} um", process.uv.dead_zone_um)
            : std::string(),
        frame.uv_mw_cm2);
  });
  if (first_bad >= 0) throw InfeasibleError(bad);
  if (!plan.uv) return;
  const auto [least, greatest] = std::minmax_element(
      plan.frames.begin(), plan.frames.end(),
      [](const FramePlan& a, const FramePlan& b) { return a.uv_mw_cm2 < b.uv_mw_cm2; });
  if (greatest->uv_mw_cm2 > plan.uv_max_mw_cm2 * (1 + kSlack) ||
      least->uv_mw_cm2 < uv_least_share * plan.uv_max_mw_cm2 * (1 - kSlack)) {
    throw InfeasibleError(fmt::format(
        "the stack asks for {:.4g} to {:.4g} mW/cm² of UV light, the lamp of printer '{}' gives "
        "{:.4g} to {:.4g}",
        least->uv_mw_cm2, greatest->uv_mw_cm2, printer.name, uv_least_share * plan.uv_max_mw_cm2,
        plan.uv_max_mw_cm2));
  }
}

}  // namespace slicecorr::bridge
