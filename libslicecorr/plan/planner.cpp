// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "cure/black_light.hpp"
#include "cure/limits.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::detail {

PaceRange gelling(const Setup& setup, double layer_um) {
  Process p = setup.process;
  const bool continuous = p.mode == ExposureMode::continuous;
  constexpr double reference = 100;
  if (continuous) {
    p.speed_mm_h = reference;
  } else {
    p.exposure_s = 1;
    p.bottom_exposure_s = 0;
    p.bottom_layers = p.fade_layers = 0;
  }
  const CureModel model = make_cure_model(setup.printer, setup.resin, p, layer_um);
  double lit = model.steady(model.phi_max()),
         black = model.steady(model.phi_min()) * model.returned(0);
  if (const GelTimeKernel* const kernel = model.gel_time(); kernel && continuous) {
    lit = detail::long_run_dose(model, kernel->level_mw_cm2(kernel->levels() - 1));
    black = detail::long_run_dose(model, kernel->level_mw_cm2(0) * model.returned(0));
  } else if (model.inhibited()) {
    const InhibitedKernel& kernel = *model.inhibited();
    const int s = kernel.strongest_setting();
    lit = kernel.steady_dose(s, kernel.highest_usable_level(s));
    black = kernel.alike() ? kernel.steady_dose(0, 0) : kernel.steady_dose_at(0, 0, {layer_um, 0});
  } else if (!continuous) {
    const double far = model.lifts ? model.lifts->green_strength : 1.0;
    if (const GelTimeKernel* const kernel = model.gel_time()) {
      lit = kernel->dose_through_layer(kernel->level_mw_cm2(kernel->levels() - 1), 1) / far;
    } else {
      lit = model.phi_max() / model.before_fading(far);
    }
    black = detail::alike_black(model);
  }
  const double unit = continuous ? reference : 1;
  PaceRange r{unit * black * (1 + 1e-6), unit * lit * (1 - 1e-6)};
  r.least = std::max(r.least, kSlowest * r.greatest);
  return r;
}

Setup at_pace(Setup setup, double pace) {
  if (setup.process.mode == ExposureMode::continuous) {
    setup.process.speed_mm_h = rounded_down(pace, kPaceDigits);
  } else {
    setup.process.exposure_s = rounded_up(1 / pace, kPaceDigits);
  }
  return setup;
}

double pace_of(const PlanPoint& p) { return p.speed_mm_h > 0 ? p.speed_mm_h : 1 / p.exposure_s; }

Planner::Planner(const SliceSource& target, const DesignColumns& columns,
                 const PartHeights& heights, const Trials& trials, const Setup& setup,
                 const PlanAsk& ask, const ExecutionContext& context, std::vector<PlanPoint>& tried)
    : columns_(columns),
      heights_(heights),
      trials_(trials),
      setup_(setup),
      context_(context),
      quiet_(silent(context)),
      tried_(tried),
      gels_(gelling(setup, target.grid().layer_um)),
      which_(critical(ask.most_columns)) {
  // Stages are another limit, and none of the light's.
  setup_.printer.max_speed_mm_h = 0;
  const double layer_um = target.grid().layer_um;
  if (setup.process.mode == ExposureMode::continuous && setup.process.uv.kind == UvKind::off) {
    Process p = setup.process;
    p.speed_mm_h = std::max(1.0, gels_.greatest);
    const CureModel model = make_cure_model(setup.printer, setup.resin, p, layer_um);
    if (model.is_continuous()) {
      light_ = plan_light(model, p.speed_mm_h);
      m_ = model.m;
    }
  }
}

std::optional<PlanPoint> Planner::fastest(const std::vector<PaceRange>& ranges, double most) {
  // Each round adds columns that fail, and what failed stays so: there is an end.
  for (;;) {
    const auto pace = fastest_pace(ranges, most, [&](double p) { return at(p).keeps; });
    if (!pace) return std::nullopt;
    PlanPoint found = at(*pace);
    if (found.all_columns) return found;
    std::vector<std::uint32_t> failing;
    const PlanPoint whole =
        trials_.correct(at_pace(setup_, *pace), everything(), {&failing, nullptr}, quiet_);
    note(whole);
    points_[key(*pace)] = whole;
    if (whole.keeps) return whole;
    if (failing.empty()) return std::nullopt;  // the window, of all columns together
    grow(std::move(failing));
  }
}

std::optional<PlanPoint> Planner::fastest_within(const std::vector<PaceRange>& ranges, double most,
                                                 double tolerance_um) {
  const auto pace =
      fastest_pace(ranges, most, [&](double p) { return keeps_within(at(p), tolerance_um); });
  if (!pace) return std::nullopt;
  return at(*pace);
}

const PlanPoint& Planner::at(double pace) {
  const double k = key(pace);
  const auto found = points_.find(k);
  if (found != points_.end()) return found->second;
  PlanPoint p = trials_.correct(at_pace(setup_, pace), which_, {}, quiet_);
  note(p);
  return points_.emplace(k, std::move(p)).first->second;
}

Setup Planner::with_speeds(const std::vector<double>& speeds_mm_h) const {
  Setup setup = setup_;
  Process& p = setup.process;
  p.speed_mm_h = *std::max_element(speeds_mm_h.begin(), speeds_mm_h.end());
  p.slice_speed_mm_h = speeds_mm_h;
  // The last holds for later slices.
  while (p.slice_speed_mm_h.size() > 1 &&
         *(p.slice_speed_mm_h.end() - 2) == p.slice_speed_mm_h.back()) {
    p.slice_speed_mm_h.pop_back();
  }
  p.slice_lamps = SliceLamps::stay;
  if (p.slice_speed_mm_h.size() == 1) {
    p.slice_speed_mm_h.clear();
    p.slice_lamps = SliceLamps::follow;
  }
  return setup;
}

Planner::Speeds Planner::at_speeds(const std::vector<double>& speeds_mm_h) {
  Speeds s;
  s.point = trials_.correct(with_speeds(speeds_mm_h), which_, {nullptr, &s.failing}, quiet_);
  note(s.point);
  return s;
}

Planner::Speeds Planner::at_speeds_in_all(const std::vector<double>& speeds_mm_h) {
  Speeds s;
  std::vector<std::uint32_t> failing;
  s.point = trials_.correct(with_speeds(speeds_mm_h), everything(), {&failing, &s.failing}, quiet_);
  note(s.point);
  if (!failing.empty()) grow(std::move(failing));
  return s;
}

double Planner::key(double pace) const {
  const Setup s = at_pace(setup_, pace);
  return setup_.process.mode == ExposureMode::continuous ? s.process.speed_mm_h
                                                         : s.process.exposure_s;
}

void Planner::note(const PlanPoint& p) {
  tried_.push_back(p);
  // Nobody knows how many it takes: each takes a seventh of what is left.
  context_.report("plan", 1 - std::pow(6.0 / 7, static_cast<double>(tried_.size())));
  context_.check_cancelled();
}

std::vector<std::uint32_t> Planner::everything() const {
  std::vector<std::uint32_t> all(columns_.columns().size());
  std::iota(all.begin(), all.end(), 0U);
  return all;
}

std::vector<std::uint32_t> Planner::critical(int most) const {
  std::vector<std::uint32_t> all = everything();
  const auto limit = static_cast<std::size_t>(most);
  if (all.size() <= limit) return all;
  std::stable_sort(all.begin(), all.end(), [&](std::uint32_t a, std::uint32_t b) {
    return heights_.lowest_gap[a] != heights_.lowest_gap[b]
               ? heights_.lowest_gap[a] < heights_.lowest_gap[b]
               : heights_.lowest_feature[a] < heights_.lowest_feature[b];
  });
  std::vector<std::uint32_t> some(all.begin(), all.begin() + most / 2);
  const std::size_t rest = limit - some.size();
  for (std::size_t k = 0; k < rest; ++k) {
    some.push_back(all[some.size() + k * (all.size() - limit) / rest]);
  }
  std::sort(some.begin(), some.end());
  some.erase(std::unique(some.begin(), some.end()), some.end());
  return some;
}

void Planner::grow(std::vector<std::uint32_t> failing) {
  constexpr std::size_t kMost = 4096;
  if (failing.size() > kMost) {
    for (std::size_t k = 0; k < kMost; ++k) failing[k] = failing[k * failing.size() / kMost];
    failing.resize(kMost);
  }
  which_.insert(which_.end(), failing.begin(), failing.end());
  std::sort(which_.begin(), which_.end());
  which_.erase(std::unique(which_.begin(), which_.end()), which_.end());
  // What fails by some columns fails by more; what keeps may not.
  std::erase_if(points_, [](const auto& p) {
    return !p.second.all_columns && keeps_within(p.second, std::numeric_limits<double>::infinity());
  });
}

}  // namespace slicecorr::detail
