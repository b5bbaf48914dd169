#include "slicecorr/tomo/solve.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "slicecorr/error.hpp"
#include "tomo/ladder.hpp"

namespace slicecorr::tomo {
namespace {

void refuse(const char* option, const char* message) {
  throw InputError("solver", option, message);
}

void check_options(const Projector& projector, const Target& target, const SolveOptions& o) {
  if (!(projector.grid() == target.grid)) refuse("projector", "must have the grid of the part");
  if (o.steps < 0) refuse("steps", "must be 0 or more");
  if (o.memory < 1 || o.memory > 50) refuse("memory", "must be in 1..50");
  if (o.most_steps < 0) refuse("most_steps", "must be 0 or more");
  if (o.proof_steps < 0) refuse("proof_steps", "must be 0 or more");
  if (!(o.most_dose > 1)) refuse("most_dose", "must be above 1");
  if (!(o.cap >= 0)) refuse("cap", "must be 0 or more");
  if (o.rungs.empty()) refuse("rungs", "must have at least one");
  double before = 1;
  for (const double rung : o.rungs) {
    if (!(rung > 0 && rung < before)) refuse("rungs", "must be below 1, above 0 and fall");
    before = rung;
  }
  if (!(o.osmo_low > 0 && o.osmo_low < o.osmo_high && o.osmo_high <= 1)) {
    refuse("osmo_low, osmo_high", "must be 0 < low < high <= 1");
  }
  if (o.start != nullptr && !(o.start->grid == target.grid)) {
    refuse("start", "must have the grid of the part");
  }
}

/// Throws for a gel voxel that no pixel lights.
void check_lit(const ExecutionContext& context, const Projector& projector, const Target& target) {
  const TomoGrid& grid = target.grid;
  Light all(grid);
  std::fill(all.values.begin(), all.values.end(), 1.0f);
  const Field seen = adjoint(projector, context, all);
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        const std::size_t v = grid.voxel(x, y, z);
        if (target.kinds[v] == Kind::kGel && !(seen.values[v] > 0)) {
          throw InfeasibleError("the part's voxel " + std::to_string(x) + ", " + std::to_string(y) +
                                " in slice " + std::to_string(z) +
                                " is lit from no angle; move the part or the insert");
        }
      }
    }
  }
}

void scale(Array<float>& values, double factor) {
  for (float& v : values) v *= static_cast<float>(factor);
}

float largest(const Array<float>& values) {
  return *std::max_element(values.begin(), values.end());
}

/// Keeps the best of what a solver passes through.
class Best {
 public:
  Best(const Target& target, Solution& solution) : target_(target), solution_(solution) {}

  /// By VER first, and then by process window.
  void offer(const Light& light, const Field& dose, const Metrics& m) {
    const Metrics& best = solution_.metrics;
    const bool better = m.ver < best.ver || (m.ver == best.ver && m.pw > best.pw);
    if (any_ && !better) return;
    any_ = true;
    solution_.light.values = light.values;
    solution_.dose.values = dose.values;
    solution_.metrics = m;
  }
  /// Scales to 1 at the weakest gel voxel.
  void finish() {
    const double least = solution_.metrics.min_gel;
    if (!(least > 0)) return;
    scale(solution_.light.values, 1 / least);
    scale(solution_.dose.values, 1 / least);
    solution_.metrics = measure(target_, solution_.dose);
  }

 private:
  const Target& target_;
  Solution& solution_;
  bool any_ = false;
};

/// Clips at 0 and scales light to a maximum of 1.
void normalise(Light& light) {
  for (float& v : light.values) v = std::max(v, 0.0f);
  const float most = largest(light.values);
  if (most > 0) scale(light.values, 1.0 / most);
}

/// A step of OSMO or Kelly, judged.
void record(const Target& target, const Light& light, const Field& dose, int step, Best& best,
            Solution& solution, const SolveOptions& options) {
  const Metrics m = measure(target, dose);
  solution.history.push_back({.step = step, .ver = m.ver, .pw = m.pw, .contrast = m.contrast});
  best.offer(light, dose, m);
  if (options.checkpoint) options.checkpoint(light, 1);
}

void run_osmo(const ExecutionContext& context, const Projector& projector, const Target& target,
              const SolveOptions& options, Solution& solution) {
  Best best(target, solution);
  Field model = filtered_model(context, target, options.window);
  Light light(target.grid);
  Field dose(target.grid);
  const auto project = [&] {
    light = forward(projector, context, model);
    normalise(light);
    dose = adjoint(projector, context, light);
    const float most = largest(dose.values);
    if (most > 0) scale(dose.values, 1.0 / most);
  };
  const auto high = static_cast<float>(options.osmo_high),
             low = static_cast<float>(options.osmo_low);
  const int steps = options.steps == 0 ? 20 : options.steps;
  project();
  record(target, light, dose, 0, best, solution, options);
  for (int step = 1; step < steps; ++step) {
    context.report("solving", static_cast<double>(step) / steps);
    for (const Kind kind : {Kind::kVoid, Kind::kGel}) {
      context.check_cancelled();
      for (std::size_t i = 0; i < target.kinds.size(); ++i) {
        if (target.kinds[i] != kind) continue;
        if (kind == Kind::kVoid) {
          model.values[i] -= std::max(dose.values[i] - low, 0.0f);
        } else {
          model.values[i] += std::max(high - dose.values[i], 0.0f);
        }
      }
      project();
    }
    record(target, light, dose, step, best, solution, options);
  }
  // The kept light has a maximum of 1 and its dose one of 1: bring them to one unit.
  solution.dose = adjoint(projector, context, solution.light);
  solution.metrics = measure(target, solution.dose);
  best.finish();
}

void run_kelly(const ExecutionContext& context, const Projector& projector, const Target& target,
               const SolveOptions& options, Solution& solution) {
  Best best(target, solution);
  const TomoGrid& grid = target.grid;
  Field gel(grid);
  for (std::size_t i = 0; i < target.kinds.size(); ++i) {
    gel.values[i] = target.kinds[i] == Kind::kGel ? 1.0f : 0.0f;
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
    if (target.kinds[i] == Kind::kGel) in_gel += response.values[i];
    if (target.kinds[i] == Kind::kVoid) in_void += response.values[i];
  }
  const double jump =
      in_gel / static_cast<double>(target.gel) - in_void / static_cast<double>(target.empty);
  const double unit_step = jump > 0 ? 1 / jump : 1;
  Light light = unit;
  if (options.start != nullptr) {
    light = *options.start;
  } else {
    scale(light.values, unit_step);
  }
  const int steps = options.steps == 0 ? 10 : options.steps;
  for (int step = 0; step < steps; ++step) {
    context.check_cancelled();
    context.report("solving", static_cast<double>(step) / steps);
    for (float& v : light.values) v = std::max(v, 0.0f);
    const float most = largest(light.values);
    for (float& v : light.values) v = std::round(v / most * 255) / 255 * most;
    const Field dose = adjoint(projector, context, light);
    record(target, light, dose, step, best, solution, options);
    const double threshold = measure(target, dose).best_threshold;
    const double width = 0.05 * largest(dose.values);
    Field wrong(grid);
    for (std::size_t i = 0; i < target.kinds.size(); ++i) {
      if (target.kinds[i] == Kind::kNeither) continue;
      const double solid = 1 / (1 + std::exp(-(dose.values[i] - threshold) / width));
      wrong.values[i] = static_cast<float>(solid - gel.values[i]);
    }
    const Light change = filtered(wrong);
    for (std::size_t i = 0; i < light.values.size(); ++i) {
      light.values[i] -= static_cast<float>(unit_step) * change.values[i];
    }
  }
  best.finish();
}

}  // namespace

Solution solve(const ExecutionContext& context, const Projector& projector, const Target& target,
               const RayTables& optics, const SolveOptions& options) {
  check_options(projector, target, options);
  check_lit(context, projector, target);
  Solution solution(target.grid);
  switch (options.method) {
    case Method::kLadder:
      detail::run_ladder(context, projector, target, optics, options, solution);
      break;
    case Method::kOsmo:
      run_osmo(context, projector, target, options, solution);
      break;
    case Method::kKelly:
      run_kelly(context, projector, target, options, solution);
      break;
    case Method::kFbp: {
      Best best(target, solution);
      const Light light = filtered_start(context, target, optics, options.window);
      const Field dose = adjoint(projector, context, light);
      record(target, light, dose, 0, best, solution, options);
      best.finish();
      break;
    }
  }
  return solution;
}

}  // namespace slicecorr::tomo
