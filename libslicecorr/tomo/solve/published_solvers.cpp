// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/solve/published_solvers.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {
namespace {

constexpr std::size_t kLanes = 16;

SLICECORR_CLONES
void scale_all(float* values, std::size_t count, float factor) {
  for (std::size_t i = 0; i < count; ++i) values[i] *= factor;
}
/// Raises all to `least`, and gives the largest.
SLICECORR_CLONES
float raise_all(float* values, std::size_t count, float least) {
  float most[kLanes];
  std::fill_n(most, kLanes, least);
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      const float v = values[i + k] > least ? values[i + k] : least;
      values[i + k] = v;
      most[k] = v > most[k] ? v : most[k];
    }
  }
  for (; i < count; ++i) {
    values[i] = std::max(values[i], least);
    most[0] = std::max(most[0], values[i]);
  }
  return *std::max_element(most, most + kLanes);
}
/// Takes from the model in cells of this kind what the dose has above `low`, or gives what it lacks of
/// `high`.
SLICECORR_CLONES
void correct_void(const Kind* kinds, const float* dose, std::size_t count, float low,
                  float* model) {
  for (std::size_t i = 0; i < count; ++i) {
    const float above = dose[i] - low;
    model[i] -= kinds[i] == Kind::empty && above > 0 ? above : 0.0F;
  }
}
SLICECORR_CLONES
void correct_gel(const Kind* kinds, const float* dose, std::size_t count, float high,
                 float* model) {
  for (std::size_t i = 0; i < count; ++i) {
    const float below = high - dose[i];
    model[i] += kinds[i] == Kind::gel && below > 0 ? below : 0.0F;
  }
}

void scale(Array<float>& values, double factor) {
  scale_all(values.data(), values.size(), static_cast<float>(factor));
}

/// Of numbers that are 0 or more.
float largest(Array<float>& values) { return raise_all(values.data(), values.size(), 0); }

/// The best light of those that a solver passes through.
class Best {
 public:
  /// Without doses where they are computed again in the end: they take as much as a field.
  enum class Keeps { light_and_dose, light };
  Best(const Target& target, Solution& solution, Keeps keeps = Keeps::light_and_dose)
      : target_(target), solution_(solution), keeps_(keeps) {}

  /// Goes on from what another was offered, with this dose of its light.
  void resume(const FoundLight& best, const Array<float>& dose) {
    static_cast<FoundLight&>(solution_) = best;
    solution_.metrics = measure_extremes(target_, dose);
    any_ = true;
  }
  /// By VER first, and then by process window.
  void offer(const Array<float>& light, const Array<float>& dose, const Metrics& m) {
    const Metrics& best = solution_.metrics;
    const bool better = m.ver < best.ver || (m.ver == best.ver && m.pw > best.pw);
    if (any_ && !better) return;
    any_ = true;
    solution_.light = light;
    if (keeps_ == Keeps::light_and_dose) solution_.dose = dose;
    solution_.metrics = m;
  }
  /// Scales to 1 at the weakest gel voxel.
  void finish() {
    const double least = solution_.metrics.min_gel;
    if (least > 0) {
      scale(solution_.light, 1 / least);
      scale(solution_.dose, 1 / least);
    }
    solution_.metrics = measure(target_, solution_.dose);
  }

 private:
  const Target& target_;
  Solution& solution_;
  Keeps keeps_;
  bool any_ = false;
};

/// Clips at 0 and scales light to a maximum of 1.
void normalise(Array<float>& light) {
  const float most = largest(light);
  if (most > 0) scale(light, 1.0 / most);
}

/// Cuts off light above the mean and this many standard deviations, and rounds what is left to 256
/// levels, the brightest 1.
void clip(const TomoGrid& grid, Array<float>& light, double sigmas) {
  const auto lanes = static_cast<std::size_t>(grid.light_lanes());
  double sum = 0, squares = 0;
  // Lanes without a slice are 0 and add nothing.
  for (const float v : light) {
    sum += v;
    squares += static_cast<double>(v) * v;
  }
  const std::size_t of_lane = light.size() / (grid.blocks() * lanes);
  const double count = static_cast<double>(of_lane) * grid.light_rows();
  const double mean = sum / count;
  const double most = mean + sigmas * std::sqrt(std::max(0.0, squares / count - mean * mean));
  for (float& v : light) v = std::min(v, static_cast<float>(most));
  normalise(light);
  for (float& v : light) v = std::round(v * 255) / 255;
}

/// A step of OSMO or Kelly, judged.
void record(const Target& target, const Light& light, const Field& dose, int step, Best& best,
            Solution& solution) {
  const Metrics m = measure_extremes(target, dose.values);
  solution.history.push_back({.step = step, .ver = m.ver, .pw = m.pw, .contrast = m.contrast});
  best.offer(light.values, dose.values, m);
}

}  // namespace

void run_osmo(const ExecutionContext& context, const Projector& projector, const Target& target,
              const SolveOptions& options, Solution& solution) {
  Best best(target, solution, Best::Keeps::light);
  Field model = filtered_model(context, target, options.window);
  Light light(target.grid);
  Field dose(target.grid);
  const auto dose_of = [&](const Array<float>& of) {
    adjoint(projector, context, of, dose.values);
    const float most = largest(dose.values);
    if (most > 0) scale(dose.values, 1.0 / most);
  };
  const auto project = [&] {
    forward(projector, context, model.values, light.values);
    normalise(light.values);
    dose_of(light.values);
  };
  const auto high = static_cast<float>(options.osmo_high),
             low = static_cast<float>(options.osmo_low);
  // What is wrong with the dose, over what the part should have.
  const auto error = [&] {
    double wrong = 0;
    for (std::size_t i = 0; i < target.kinds.size(); ++i) {
      if (target.kinds[i] == Kind::empty) wrong += std::max(dose.values[i] - low, 0.0f);
      if (target.kinds[i] == Kind::gel) wrong += std::max(high - dose.values[i], 0.0f);
    }
    return wrong / (options.osmo_high * static_cast<double>(target.gel));
  };
  const int steps = options.steps == 0 ? 20 : options.steps;
  int step = 1;
  if (options.resume != nullptr) {
    model.values = options.resume->numbers;
    step = options.resume->step;
    dose_of(options.resume->best.light);
    best.resume(options.resume->best, dose.values);
    project();
  } else {
    project();
    record(target, light, dose, 0, best, solution);
  }
  const bool may_stop = options.stop_error > 0;
  for (; step < steps && !(may_stop && error() < options.stop_error); ++step) {
    context.report("solving", static_cast<double>(step) / steps);
    for (const Kind kind : {Kind::empty, Kind::gel}) {
      context.check_cancelled();
      if (kind == Kind::empty) {
        correct_void(target.kinds.data(), dose.values.data(), target.kinds.size(), low,
                     model.values.data());
      } else {
        correct_gel(target.kinds.data(), dose.values.data(), target.kinds.size(), high,
                    model.values.data());
      }
      project();
    }
    record(target, light, dose, step, best, solution);
    if (options.checkpoint) {
      options.checkpoint({.numbers = model.values, .dose = {}, .step = step + 1, .best = solution});
    }
  }
  if (options.clip_sigma > 0) clip(target.grid, solution.light, options.clip_sigma);
  // The kept light has a maximum of 1 and its dose one of 1: bring them to one unit.
  model.values = Array<float>();  // "= {}" would keep their memory
  light.values = Array<float>();
  adjoint(projector, context, solution.light, dose.values);
  solution.dose = std::move(dose.values);
  solution.metrics = measure_extremes(target, solution.dose);
  best.finish();
}

void run_kelly(const ExecutionContext& context, const Projector& projector, const Target& target,
               const SolveOptions& options, Solution& solution) {
  Best best(target, solution);
  const TomoGrid& grid = target.grid;
  Field gel(grid);
  for (std::size_t i = 0; i < target.kinds.size(); ++i) {
    gel.values[i] = target.kinds[i] == Kind::gel ? 1.0f : 0.0f;
  }
  const auto filtered = [&](const Field& field) {
    Light light = forward(projector, context, field);
    ramp_filter(context, light, options.window);
    return light;
  };
  Light unit = filtered(gel);
  const Field response = adjoint(projector, context, unit);
  double in_gel = 0, in_void = 0;
  for (std::size_t i = 0; i < target.kinds.size(); ++i) {
    if (target.kinds[i] == Kind::gel) in_gel += response.values[i];
    if (target.kinds[i] == Kind::empty) in_void += response.values[i];
  }
  const double jump =
      in_gel / static_cast<double>(target.gel) - in_void / static_cast<double>(target.empty);
  const double unit_step = jump > 0 ? 1 / jump : 1;
  Light light = unit;
  if (options.start != nullptr) {
    light.values = *options.start;
  } else {
    scale(light.values, unit_step);
  }
  const int steps = options.steps == 0 ? 10 : options.steps;
  int step = 0;
  if (options.resume != nullptr) {
    light.values = options.resume->numbers;
    step = options.resume->step;
    best.resume(options.resume->best, options.resume->best.dose);
  }
  for (; step < steps; ++step) {
    context.check_cancelled();
    context.report("solving", static_cast<double>(step) / steps);
    for (float& v : light.values) v = std::max(v, 0.0f);
    const float most = largest(light.values);
    for (float& v : light.values) v = std::round(v / most * 255) / 255 * most;
    Field dose = adjoint(projector, context, light);
    record(target, light, dose, step, best, solution);
    const double threshold = measure(target, dose.values).best_threshold;
    const double width = 0.05 * largest(dose.values);
    Field wrong(grid);
    for (std::size_t i = 0; i < target.kinds.size(); ++i) {
      if (target.kinds[i] == Kind::neither) continue;
      const double solid = 1 / (1 + std::exp(-(dose.values[i] - threshold) / width));
      wrong.values[i] = static_cast<float>(solid - gel.values[i]);
    }
    const Light change = filtered(wrong);
    for (std::size_t i = 0; i < light.values.size(); ++i) {
      light.values[i] -= static_cast<float>(unit_step) * change.values[i];
    }
    if (options.checkpoint) {
      options.checkpoint({.numbers = light.values, .dose = {}, .step = step + 1, .best = solution});
    }
  }
  best.finish();
}

void run_fbp(const ExecutionContext& context, const Projector& projector, const Target& target,
             const RayTables& optics, const SolveOptions& options, Solution& solution) {
  Best best(target, solution);
  const Light light = filtered_start(context, target, optics, options.window);
  const Field dose = adjoint(projector, context, light);
  record(target, light, dose, 0, best, solution);
  best.finish();
}

}  // namespace slicecorr::tomo::detail
