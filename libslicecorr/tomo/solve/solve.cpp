// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/solve.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "slicecorr/error.hpp"
#include "tomo/solve/published_solvers.hpp"

namespace slicecorr::tomo {
namespace {

void refuse(const char* option, const char* message) {
  throw InputError("solver", option, message);
}

void check_options(const Projector& projector, const Target& target, const SolveOptions& o) {
  const Shape shape = target.grid.shape();
  if (!(projector.shape() == shape)) refuse("projector", "must have the grid of the part");
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
  if (!(o.window.k0 > 0)) refuse("window", "must have k0 above 0");
  if (!(o.clip_sigma >= 0)) refuse("clip_sigma", "must be 0 or more");
  if (!(o.stop_error >= 0)) refuse("stop_error", "must be 0 or more");
  if (o.start != nullptr && o.start->size() != shape.light()) {
    refuse("start", "must have the grid of the part");
  }
  if (o.resume != nullptr) {
    const bool ladder = o.method == Method::ladder;
    if (o.resume->best.light.size() != shape.light() ||
        o.resume->numbers.size() != (o.method == Method::osmo ? shape.field() : shape.light()) ||
        o.resume->dose.size() != (ladder ? shape.field() : 0)) {
      refuse("resume", "must have the grid of the part");
    }
  }
}

/// Throws for a gel voxel that no pixel lights.
void check_lit(const ExecutionContext& context, const Projector& projector, const Target& target) {
  const Light all(target.grid, Array<float>(target.grid.shape().light(), 1.0F));
  const WeakVoxel weakest = weakest_voxel(target, adjoint(projector, context, all).values);
  if (!(weakest.dose > 0)) {
    throw InfeasibleError(weakest.name + " is lit from no angle; move the part or the insert");
  }
}

/// The ladder, from where filtered back projection leads.
Solution from_projections(const ExecutionContext& context, const Projector& projector,
                          const Target& target, const RayTables& optics, const SolveOptions& o) {
  Array<float> start;
  if (o.start != nullptr) start = *o.start;
  if (o.start == nullptr && o.resume == nullptr) {
    start = filtered_start(context, target, optics, o.window).values;
  }
  LadderOptions how = o;
  how.scale_start = o.start == nullptr;
  Solution solution{ladder(context, projector, target, std::move(start), how), {}};
  solution.metrics = measure(target, solution.dose);
  return solution;
}

}  // namespace

Method method_named(std::string_view name) {
  constexpr Method kAll[] = {Method::ladder, Method::osmo, Method::kelly, Method::fbp};
  static_assert(std::size(kAll) == std::size(kMethodNames));
  const auto* const found = std::find(std::begin(kMethodNames), std::end(kMethodNames), name);
  if (found != std::end(kMethodNames)) return kAll[found - std::begin(kMethodNames)];
  throw InputError(fmt::format("no method '{}'; expected {}", name, fmt::join(kMethodNames, ", ")));
}

Solution solve(const ExecutionContext& context, const Projector& projector, const Target& target,
               const RayTables& optics, const SolveOptions& options) {
  check_options(projector, target, options);
  check_lit(context, projector, target);
  Solution solution;
  switch (options.method) {
    case Method::ladder:
      solution = from_projections(context, projector, target, optics, options);
      break;
    case Method::osmo:
      detail::run_osmo(context, projector, target, options, solution);
      break;
    case Method::kelly:
      detail::run_kelly(context, projector, target, options, solution);
      break;
    case Method::fbp:
      detail::run_fbp(context, projector, target, optics, options, solution);
      break;
  }
  return solution;
}

}  // namespace slicecorr::tomo
