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
#include "slicecorr/machine_light.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::bridge {
namespace {

/// Relative difference of intensities and dead zones that comes of rounding.
constexpr double kSlack = 1e-6;
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
  const LightMap light_, uv_light_;
  const std::size_t pixels_;
  const std::vector<double> blue_;  ///< mW/cm², by level
  std::array<int, 256> level_{};    ///< by pixel value
  Image places_, uv_places_;        ///< values of the light maps, where they count
  std::optional<Kinetics> kinetics_;
  std::array<double, 256> uv_intensity_{};  ///< mW/cm², by pixel value of patterned UV light
};

FrameLight::FrameLight(const PrintPlan& plan, const StackReader& stack, const Machine& machine)
    : plan_(plan),
      stack_(stack),
      process_(*stack.info().process),
      uv_tolerance_mw_cm2_(machine.uv.tolerance * plan.uv_max_mw_cm2),
      light_(machine.printer, stack.info().grid, stack.frame()),
      uv_light_(uv_light_map(machine.printer, stack.info().grid, stack.frame())),
      pixels_(static_cast<std::size_t>(stack.info().grid.width_px) *
              static_cast<std::size_t>(stack.info().grid.height_px)),
      blue_(level_intensities(machine.printer)) {
  const Printer& printer = machine.printer;
  for (int v = 0; v < 256; ++v) {
    level_[static_cast<std::size_t>(v)] = level_of_pixel(v, printer.levels());
  }
  if (!plan.uv) return;
  kinetics_ = make_kinetics(*stack.info().resin, true, true);
  const auto take_places = [&](const LightMap& map, Image& places) {
    if (map.even()) return;
    places.resize(pixels_);
    map.values({0, 0, stack.info().grid.width_px, stack.info().grid.height_px}, places.data());
  };
  take_places(light_, places_);
  take_places(uv_light_, uv_places_);
  if (!plan.uv_patterned) return;
  const auto levels = uv_level_intensities(printer);
  for (int v = 0; v < 256; ++v) {
    uv_intensity_[static_cast<std::size_t>(v)] =
        levels[static_cast<std::size_t>(level_of_pixel(v, static_cast<int>(levels.size())))];
  }
}

double FrameLight::greatest_ratio(int n, const Image& image, std::uint8_t most) const {
  if (places_.empty() && uv_places_.empty() && !plan_.uv_patterned) return intensity_of(most);
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
    // As much more blue light as less UV light comes there.
    if (!uv_places_.empty()) value /= std::max(uv_light_.factor(uv_places_[p]), 1e-12);
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

  const MachineMotion motion = motion_of(machine);
  const LitPrint print{printer, *info.resin, process, plan.layer_um,
                       static_cast<int>(plan.frames.size())};
  check_black_light(print, motion);
  plan.black_excess = black_excess(print, motion);
  const FrameLight light(plan, stack, machine);

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
  if (!plan.uv) return;
  std::vector<double> uv_mw_cm2;
  for (const FramePlan& frame : plan.frames) uv_mw_cm2.push_back(frame.uv_mw_cm2);
  check_uv_range(print, motion, uv_mw_cm2);
}

}  // namespace slicecorr::bridge
