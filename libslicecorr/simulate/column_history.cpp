// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// One pixel column against time.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "cure/margin.hpp"
#include "cure/own_doses.hpp"
#include "cure/own_exposure.hpp"
#include "cure/spread_band.hpp"
#include "simulate/column_in_time.hpp"
#include "simulate/refuse.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/simulate.hpp"

namespace slicecorr {

namespace {

using detail::KernelLight;
using Moment = PrintClock::Moment;

/// What a column shows, slice by slice.
struct ColumnLight {
  std::vector<std::uint8_t> pixels;
  std::vector<double> phi;  ///< relative intensity with its exposure; not looked at under UV light
  std::vector<FrontLight> fronts;  ///< under UV light, where light spreads
};

/// The light of a column for an inhibited kernel.
std::vector<KernelLight> lights_of(const ColumnLight& shown, const InhibitedKernel& kernel) {
  std::vector<KernelLight> lights;
  for (const FrontLight& light : shown.fronts) {
    lights.push_back({light.front, static_cast<double>(light.amount)});
  }
  if (!lights.empty()) return lights;
  for (const std::uint8_t v : shown.pixels)
    lights.push_back({level_of_pixel(v, kernel.levels()), 1});
  return lights;
}

ColumnHistory history_of(const CureModel& model, const Process& process, ColumnLight shown,
                         const ColumnOptions& options, const ExecutionContext& context) {
  const std::vector<std::uint8_t>& pixels = shown.pixels;
  if (pixels.empty()) throw InputError("a column without slices; expected one slice at least");
  refuse_own_heights(process);
  if (options.substeps < 0 || options.substeps > 10000) {
    throw InputError(
        fmt::format("{} steps in a slice; expected 1 to 10000, or 0", options.substeps));
  }
  const auto slices = static_cast<int>(pixels.size());
  const PrintClock clock(process, model.m, model.layer_um, slices);
  std::vector<double> times = options.profile_times_s;
  std::sort(times.begin(), times.end());
  for (const double t : times) {
    // The end of the print may be given as it is printed, with some digits less.
    if (!(t >= 0 && t <= clock.total_s() * (1 + 1e-6))) {
      throw InputError(fmt::format("a time of {:g} s is outside the print; expected 0 to {:g} s", t,
                                   clock.total_s()));
    }
  }
  // Some 600 steps make smooth curves.
  const int substeps =
      options.substeps > 0 ? options.substeps : std::clamp((600 + slices - 1) / slices, 1, 64);

  ColumnHistory history;
  history.mode = model.mode;
  history.layer_um = model.layer_um;
  history.total_s = clock.total_s();
  std::vector<KernelLight> lights;
  if (model.inhibited()) lights = lights_of(shown, *model.inhibited());
  const std::unique_ptr<detail::Column> column =
      detail::make_column(model, std::move(shown.phi), lights);
  const bool moving = model.mode == ExposureMode::continuous;
  const auto step_to = [&](const Moment& now) {
    history.steps.push_back({clock.time_s(now), now.slice, now.share,
                             (now.slice + (moving ? now.share : 1.0)) * model.layer_um,
                             column->gelled(now)});
  };
  std::size_t next = 0;
  const auto profiles_to = [&](int slice, double share) {
    for (; next < times.size(); ++next) {
      const Moment now = clock.at(times[next]);
      if (now.slice > slice || (now.slice == slice && now.share > share)) break;
      DoseProfile p = column->profile(now);
      p.time_s = clock.time_s(now);
      p.slice = now.slice;
      p.share = now.share;
      history.profiles.push_back(std::move(p));
    }
  };
  step_to({0, 0});
  for (int n = 0; n < slices; ++n) {
    context.check_cancelled();
    for (int i = 1; i < substeps; ++i) step_to({n, static_cast<double>(i) / substeps});
    // Moments inside the slice come before it is finished.
    profiles_to(n, std::nextafter(1.0, 0.0));
    column->finish_slice(n);
    step_to({n, 1.0});
    profiles_to(n, 1.0);
    context.report("simulate", static_cast<double>(n + 1) / slices);
  }
  if (model.inhibited()) {
    const InhibitedKernel& kernel = *model.inhibited();
    const auto none = std::numeric_limits<double>::quiet_NaN();
    for (int n = 0; n < slices; ++n) {
      const KernelLight& light = lights[static_cast<std::size_t>(n)];
      const double zone = kernel.dead_zone_um(n, light.level);
      const double first = kernel.first_gel_um(n, light.level);
      const bool lit =
          pixels[static_cast<std::size_t>(n)] > 0 && light.amount > 0 && std::isfinite(zone);
      history.dead_zone_um.push_back(lit ? zone : none);
      history.first_gel_um.push_back(lit ? first : none);
    }
  }
  return history;
}

}  // namespace

ColumnHistory simulate_column(const CureModel& model, const Process& process,
                              const std::vector<std::uint8_t>& pixels, const ColumnOptions& options,
                              const ExecutionContext& context) {
  const PixelCurve curve = pixel_curve(model);
  std::vector<double> phi;
  phi.reserve(pixels.size());
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    phi.push_back(curve[pixels[n]] * model.ratio(static_cast<int>(n)));
  }
  return history_of(model, process, {pixels, std::move(phi), {}}, options, context);
}

std::string name_of(AtLift state) {
  constexpr std::array<const char*, 5> names{"nothing", "holds", "film", "liquid", "does not hold"};
  return names[static_cast<std::size_t>(state)];
}

namespace {

/// A layer with what its own exposure leaves, and whether as much of it gels as of a film.
struct OwnLayer {
  LayerAtLift layer;
  bool film = false, lit = false;
};

std::vector<LayerAtLift> at_lifts(const LiftModel& lifts, const std::vector<OwnLayer>& own,
                                  const std::vector<double>& design) {
  using enum AtLift;
  const auto layers = static_cast<int>(own.size());
  std::vector<LayerAtLift> all;
  all.reserve(own.size());
  for (const OwnLayer& o : own) all.push_back(o.layer);
  const auto of = [&](int n) -> LayerAtLift& { return all[static_cast<std::size_t>(n)]; };
  const auto solid = [&](int n) {
    const auto i = static_cast<std::size_t>(n);
    return design.empty() ? own[i].lit : i < design.size() && design[i] >= 1;
  };
  for (int n = 0; n < layers;) {
    if (!solid(n)) {
      ++n;
      continue;
    }
    int end = n;
    while (end < layers && solid(end)) ++end;
    // The first layer that has gelled at its lift begins the feature; those above it are liquid on
    // purpose, where a gap is above them.
    int begin = n;
    while (begin + 1 < end && of(begin).window_dose < 1) ++begin;
    for (int k = n; k < begin; ++k) of(k).state = n > 0 ? liquid : does_not_hold;
    const bool hangs = own[static_cast<std::size_t>(begin)].film;
    if (n > 0) of(begin).state = hangs ? film : does_not_hold;
    for (int k = n > 0 ? begin + 1 : begin; k < end; ++k) {
      const bool on_liquid = k > 0 && (k > begin || begin > n) && of(k - 1).window_dose < 1;
      const bool reaches = of(k).joint_dose >= lifts.green_strength - detail::kMargin;
      of(k).state = reaches && !on_liquid ? holds : does_not_hold;
    }
    n = end;
  }
  return all;
}

/// Under UV light: net doses.
std::vector<OwnLayer> own_under_uv(const CureModel& model, const std::vector<std::uint8_t>& pixels,
                                   const std::vector<FrontLight>& fronts) {
  detail::OwnDoses doses(*model.inhibited(), model.lifts->skin);
  std::vector<OwnLayer> own;
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    ImageShowing showing{&pixels[n], 1.0, model.inhibited()->setting_of_slice(static_cast<int>(n))};
    if (!fronts.empty()) showing.fronts = &fronts[n];
    const detail::OwnDoses::Own o = doses.of({&showing, 1}, 0, model.ratio(static_cast<int>(n)));
    own.push_back({{AtLift::nothing, o.greatest, o.joint}, o.film, pixels[n] > 0});
  }
  return own;
}

}  // namespace

std::vector<LayerAtLift> lifts_of(const CureModel& model, const std::vector<double>& phi,
                                  const std::vector<double>& design) {
  if (!model.lifts || model.inhibited()) {
    throw InputError("layers at each lift need a model with lifts, without UV light");
  }
  std::vector<OwnLayer> own;
  for (std::size_t k = 0; k < phi.size(); ++k) {
    const auto n = static_cast<int>(k);
    const detail::OwnExposure its = detail::own_exposure(model, n, phi[k] / model.ratio(n));
    const bool film = model.adds_up() ? its.window >= model.lifts->film - detail::kMargin
                                      : its.skin >= 1 - detail::kMargin;
    own.push_back({{AtLift::nothing, its.window, its.far},
                   film,
                   phi[k] > model.level_phi.front() * model.ratio(n) * (1 + 1e-9)});
  }
  return at_lifts(*model.lifts, own, design);
}

namespace {

/// The light of a single column of a stack under UV light, where it spreads.
std::vector<FrontLight> fronts_at(const SliceSource& stack, const Setup& setup,
                                  const detail::SpreadLight& light, const Pixel& pixel) {
  const detail::ShownSlices slices(stack, setup.printer, setup.resin, setup.process);
  detail::SpreadBand band(light, stack, slices, {pixel.x, pixel.y, pixel.x + 1, pixel.y + 1});
  std::vector<FrontLight> fronts(static_cast<std::size_t>(slices.slices()));
  for (int n = slices.slices(); n-- > 0;) {
    fronts[static_cast<std::size_t>(n)] = *band.of(n).front().fronts;
  }
  return fronts;
}

}  // namespace

ColumnHistory simulate_column(const SliceSource& stack, const SliceSource* target,
                              const Setup& setup, int x, int y, const ColumnOptions& options,
                              const ExecutionContext& context) {
  refuse_recording(stack);
  refuse_scatter(setup.resin);
  const std::vector<ProbeRow> rows = probe_stack(stack, target, setup, x, y);
  const Grid& grid = stack.grid();
  const PlaceModels models(setup.printer, setup.resin, setup.process, grid, stack.frame());
  ColumnLight shown;
  for (const ProbeRow& row : rows) {
    shown.pixels.push_back(
        static_cast<std::uint8_t>(pixel_of_level(row.grey, setup.printer.levels())));
    shown.phi.push_back(row.phi);
  }
  const std::vector<double> own = shown.phi;
  const std::vector<std::uint8_t> pixels = shown.pixels;
  // Where light spreads, what reaches the column is no longer that of its own pixels.
  const detail::SpreadLight light(models, grid, stack.frame());
  if (light.under_uv()) shown.fronts = fronts_at(stack, setup, light, {x, y});
  const std::vector<FrontLight> fronts = shown.fronts;
  ColumnHistory history =
      light.none()
          ? simulate_column(models.model_at(x, y), setup.process, shown.pixels, options, context)
          : history_of(light.model(), setup.process, std::move(shown), options, context);
  if (target) {
    for (const ProbeRow& row : rows) history.design.push_back(row.target);
  }
  const CureModel& model = light.none() ? models.model_at(x, y) : light.model();
  if (model.lifts) {
    history.lifts = model.inhibited() ? at_lifts(*model.lifts, own_under_uv(model, pixels, fronts),
                                                 history.design)
                                      : lifts_of(model, own, history.design);
    history.green_strength = model.lifts->green_strength;
  }
  return history;
}

}  // namespace slicecorr
