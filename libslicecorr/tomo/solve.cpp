#include "slicecorr/tomo/solve.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>
#include <string>

#include "slicecorr/error.hpp"
#include "tomo/best_light.hpp"
#include "tomo/block_solver.hpp"
#include "tomo/published_solvers.hpp"

namespace slicecorr::tomo {
namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

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
  if (!(o.clip_sigma >= 0)) refuse("clip_sigma", "must be 0 or more");
  if (!(o.stop_error >= 0)) refuse("stop_error", "must be 0 or more");
  if (o.start != nullptr && !(o.start->grid == target.grid)) {
    refuse("start", "must have the grid of the part");
  }
  if (o.resume != nullptr) {
    const std::size_t light = target.grid.blocks() * target.grid.light_of_block();
    if (!(o.resume->best.light.grid == target.grid) ||
        o.resume->numbers.size() != (o.method == Method::kOsmo ? target.kinds.size() : light)) {
      refuse("resume", "must have the grid of the part");
    }
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

/// The steps of all blocks as steps of the part; a block that was done early stays as it was.
void add_history(const std::vector<std::vector<detail::BlockStep>>& blocks, const Target& target,
                 double rung, std::vector<Step>& history) {
  std::size_t most = 0;
  for (const auto& block : blocks) most = std::max(most, block.size());
  for (std::size_t k = 0; k < most; ++k) {
    Step step{.rung = rung, .step = static_cast<int>(k)};
    double min_gel = kNone, max_void = 0, max_dose = 0;
    std::size_t gelled = 0;
    for (const auto& block : blocks) {
      if (block.empty()) continue;
      const detail::BlockStep& s = block[std::min(k, block.size() - 1)];
      step.loss += s.loss;
      min_gel = std::min<double>(min_gel, s.min_gel);
      max_void = std::max<double>(max_void, s.max_void);
      max_dose = std::max<double>(max_dose, s.max_dose);
      gelled += s.void_gelled;
    }
    step.ver = static_cast<double>(gelled) / static_cast<double>(target.gel + target.empty);
    step.pw = max_dose > 0 ? (min_gel - max_void) / max_dose : 0;
    step.contrast = max_void > 0 ? min_gel / max_void : kNone;
    history.push_back(step);
  }
}

class Ladder {
 public:
  Ladder(const ExecutionContext& context, const Projector& projector, const Target& target,
         const RayTables& optics, const SolveOptions& options, Solution& solution)
      : context_(context),
        projector_(projector),
        target_(target),
        options_(options),
        solution_(solution),
        best_(target, solution),
        light_(options.start != nullptr ? *options.start
                                        : filtered_start(context, target, optics, options.window)),
        dose_(target.grid) {}

  void run() {
    bool missed = false;
    if (options_.resume != nullptr) {
      light_.values = options_.resume->numbers;
      dose_ = adjoint(projector_, context_, light_);
      missed = options_.resume->missed;
      best_.resume(options_.resume->best);
    } else if (options_.start == nullptr) {
      scale_start();
    }
    for (std::size_t r = 0; r < options_.rungs.size(); ++r) {
      const double rung = options_.rungs[r];
      if (options_.resume != nullptr && rung > options_.resume->rung) continue;
      const detail::Penalty penalty = penalty_of(rung);
      if (!missed) {
        missed = climb(penalty) != 0;
        offer(rung);
        if (options_.checkpoint) {
          const double next = r + 1 < options_.rungs.size() ? options_.rungs[r + 1] : 0;
          options_.checkpoint({.numbers = light_.values,
                               .rung = missed ? rung : next,
                               .missed = missed,
                               .best = solution_});
        }
      }
      if (!missed) continue;
      prove(penalty);
      break;
    }
    best_.finish();
  }

 private:
  /// Light that would have to exceed the cap, to bring the weakest voxel to its dose, takes the place
  /// of none that would not.
  void offer(double rung) {
    const Metrics m = measure(target_, dose_);
    if (options_.cap > 0 && best_.any() &&
        !(detail::largest(light_.values) <= options_.cap * m.min_gel * (1 + 1e-6))) {
      return;
    }
    best_.offer(light_, dose_, m, rung, true);
  }
  detail::Penalty penalty_of(double rung) const {
    return {.rung = rung,
            .most_dose = options_.most_dose,
            .cap = options_.cap > 0 ? options_.cap : kNone};
  }
  const Kind* kinds(std::size_t b) const {
    return target_.kinds.data() + b * target_.grid.voxels_of_block();
  }

  /// One scale for each block: they share nothing but the rung.
  void scale_start() {
    const detail::Penalty penalty = penalty_of(options_.rungs.front());
    parallel_for(context_, "start", target_.grid.blocks(), [&](std::size_t b) {
      projector_.adjoint(b, light_.block(b), dose_.block(b), context_);
      const double factor =
          detail::best_scale(kinds(b), target_.grid.voxels_of_block(), dose_.block(b), penalty);
      float* light = light_.block(b);
      for (std::size_t i = 0; i < target_.grid.light_of_block(); ++i) {
        light[i] *= static_cast<float>(factor);
      }
    });
  }

  /// The loss that is left of a rung. Goes on, twice as long each time, while that halves it.
  double climb(const detail::Penalty& penalty) {
    int steps = options_.steps == 0 ? 60 : options_.steps;
    const int most = std::max(steps, options_.most_steps);
    double loss = descend(penalty, steps, "solving"), before = kNone;
    for (int done = steps; done < most && loss > 0 && loss < 0.5 * before; done += steps) {
      steps = std::min(2 * steps, most - done);
      before = loss;
      loss = descend(penalty, steps, "solving");
    }
    return loss;
  }

  double descend(const detail::Penalty& penalty, int steps, std::string_view stage) {
    std::vector<std::vector<detail::BlockStep>> blocks(target_.grid.blocks());
    parallel_for(context_, stage, blocks.size(), [&](std::size_t b) {
      blocks[b] = detail::solve_block(projector_, b, kinds(b), penalty, steps, options_.memory,
                                      context_, light_.block(b), dose_.block(b));
    });
    add_history(blocks, target_, penalty.rung, solution_.history);
    return solution_.history.back().loss;
  }

  void keep_bound(double rung) {
    const Certificate proof = contrast_bound(context_, projector_, target_, dose_, rung);
    if (proof.bound < solution_.contrast_bound) {
      solution_.contrast_bound = proof.bound;
      solution_.bound_slice = proof.slice;
    }
  }

  /// The proof wants the minimum of the first two terms alone, without bounds on the light.
  void prove(detail::Penalty penalty) {
    if (options_.proof_steps == 0) return;
    keep_bound(penalty.rung);
    penalty.most_dose = kNone;
    penalty.cap = kNone;
    int steps = 20;
    for (int done = 0; done < options_.proof_steps; done += steps, steps *= 2) {
      steps = std::min(steps, options_.proof_steps - done);
      const double loss = descend(penalty, steps, "proving");
      if (options_.cap == 0) {
        best_.offer(light_, dose_, measure(target_, dose_), penalty.rung, true);
      }
      if (loss == 0) return;
      keep_bound(penalty.rung);
    }
  }

  const ExecutionContext& context_;
  const Projector& projector_;
  const Target& target_;
  const SolveOptions& options_;
  Solution& solution_;
  detail::Best best_;
  Light light_;
  Field dose_;
};

}  // namespace

Method method_named(std::string_view name) {
  constexpr Method kAll[] = {Method::kLadder, Method::kOsmo, Method::kKelly, Method::kFbp};
  static_assert(std::size(kAll) == std::size(kMethodNames));
  const auto* const found = std::find(std::begin(kMethodNames), std::end(kMethodNames), name);
  if (found != std::end(kMethodNames)) return kAll[found - std::begin(kMethodNames)];
  throw InputError(fmt::format("no method '{}'; expected {}", name, fmt::join(kMethodNames, ", ")));
}

Solution solve(const ExecutionContext& context, const Projector& projector, const Target& target,
               const RayTables& optics, const SolveOptions& options) {
  check_options(projector, target, options);
  check_lit(context, projector, target);
  Solution solution(target.grid);
  switch (options.method) {
    case Method::kLadder:
      Ladder(context, projector, target, optics, options, solution).run();
      break;
    case Method::kOsmo:
      detail::run_osmo(context, projector, target, options, solution);
      break;
    case Method::kKelly:
      detail::run_kelly(context, projector, target, options, solution);
      break;
    case Method::kFbp:
      detail::run_fbp(context, projector, target, optics, options, solution);
      break;
  }
  return solution;
}

Certificate contrast_bound(const ExecutionContext& context, const Projector& projector,
                           const Target& target, const Field& dose, double rung) {
  constexpr float kMargin = 1e-4f;
  const TomoGrid& grid = target.grid;
  const std::size_t lanes = grid.lanes();
  std::vector<double> bounds(static_cast<std::size_t>(grid.slices), kNone);
  parallel_for(context, "proving", grid.blocks(), [&](std::size_t b) {
    const std::size_t voxels = grid.voxels_of_block(), pixels = grid.light_of_block();
    Array<float> low(voxels), high(voxels), empty(voxels);
    Array<float> a_low(pixels), a_high(pixels), a_empty(pixels);
    std::vector<double> sum_low(lanes), sum_high(lanes), count(lanes), delta(lanes);
    const Kind* kinds = target.kinds.data() + b * voxels;
    const float* d = dose.block(b);
    for (std::size_t i = 0; i < voxels; ++i) {
      if (kinds[i] == Kind::kGel) {
        low[i] = std::max(0.0f, 1.0f - d[i]);
        sum_low[i % lanes] += low[i];
      } else if (kinds[i] == Kind::kVoid) {
        high[i] = std::max(0.0f, d[i] - static_cast<float>(rung));
        sum_high[i % lanes] += high[i];
        empty[i] = 1;
        count[i % lanes] += 1;
      }
    }
    projector.forward(b, low.data(), a_low.data(), context);
    projector.forward(b, high.data(), a_high.data(), context);
    projector.forward(b, empty.data(), a_empty.data(), context);
    for (std::size_t i = 0; i < pixels; ++i) {
      const double missing = static_cast<double>(a_low[i]) * (1 + kMargin) -
                             static_cast<double>(a_high[i]) * (1 - kMargin);
      if (missing <= 0) continue;
      double& most = delta[i % lanes];
      most = a_empty[i] > 0 ? std::max(most, missing / (a_empty[i] * (1 - kMargin))) : kNone;
    }
    for (int l = 0; l < grid.lanes_used(b); ++l) {
      if (sum_low[l] > 0 && delta[l] < kNone) {
        bounds[b * lanes + l] = (sum_high[l] + delta[l] * count[l]) / sum_low[l];
      }
    }
  });
  const auto least = std::min_element(bounds.begin(), bounds.end());
  if (*least == kNone) return {};
  return {*least, static_cast<int>(least - bounds.begin())};
}

}  // namespace slicecorr::tomo
