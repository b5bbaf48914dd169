// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "chemistry/reaction_kernels.hpp"
#include "slicecorr/chemistry_cell.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

using detail::kCellBlock;

/// A block of equal cells, of which the first counts.
class Block {
 public:
  explicit Block(const CellState& s) { put(s); }
  void put(const CellState& s) {
    const double values[kSpecies] = {s.I, s.Ir, s.P0, s.P1, s.P2, s.P3, s.O, s.Q};
    for (std::size_t k = 0; k < kSpecies; ++k) values_[k].fill(values[k]);
  }
  CellState get() const {
    const auto at = [&](std::size_t k) { return values_[k][0]; };
    return {at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)};
  }
  /// One step; the difference that the halves make.
  double step(const detail::ReactionStep& r, double kd, bool inhibitor, detail::StepError scale) {
    std::array<double, kCellBlock> broken;
    broken.fill(-std::expm1(-kd * r.h / 2));
    detail::CellArrays a{values_[0].data(), values_[1].data(),
                         values_[2].data(), values_[3].data(),
                         values_[4].data(), values_[5].data(),
                         values_[6].data(), inhibitor ? values_[7].data() : nullptr};
    detail::react(r, broken.data(), a, kCellBlock, nullptr, &scale);
    return scale.worst;
  }

 private:
  static constexpr std::size_t kSpecies = 8;
  std::array<std::array<double, kCellBlock>, kSpecies> values_;
};

double groups(const CellState& s) { return s.P0 + s.P1 + s.P2 + s.P3; }

void check(const CellQuestion& q) {
  if (q.light.empty()) throw InputError("there is no light; expected an intensity and a time");
  for (const LightStep& l : q.light) {
    if (!(l.intensity_mw_cm2 >= 0) || !std::isfinite(l.intensity_mw_cm2) || !(l.seconds > 0) ||
        !std::isfinite(l.seconds)) {
      throw InputError(
          fmt::format("light of {:g} mW/cm² for {:g} s; expected an intensity of at "
                      "least 0 and a time above 0",
                      l.intensity_mw_cm2, l.seconds));
    }
  }
  if (!(q.supply_per_s >= 0) || !std::isfinite(q.supply_per_s)) {
    throw InputError(
        fmt::format("oxygen is resupplied at {:g} per s; expected at least 0", q.supply_per_s));
  }
  if (!(q.tolerance >= 1e-9 && q.tolerance <= 0.1)) {
    throw InputError(fmt::format("the tolerance is {:g}; expected 1e-9 to 0.1", q.tolerance));
  }
}

/// Walks one cell through its light.
class Walk {
 public:
  Walk(const Chemistry& c, const CellQuestion& q)
      : c_(c), q_(q), state_(cell_at_start(c)), block_(state_), step_(detail::reaction_of(c)) {
    step_.supply_per_s = q.supply_per_s;
    step_.outside_mol_l = c.oxygen_mol_l;
    found_ = c.oxygen_mol_l + c.inhibitor_mol_l;
  }

  /// `until_gel`: stops when the resin has gelled. `keep`: all moments, else the last alone.
  CellRun run(bool until_gel, bool keep, const ExecutionContext& context) {
    CellRun run;
    double time = 0;
    note(run, time, q_.light.front().intensity_mw_cm2, keep);
    for (const LightStep& light : q_.light) {
      const double end = time + light.seconds, kd = initiation_per_s(c_, light.intensity_mw_cm2);
      const double steady = kd > 0 ? steady_radicals_mol_l(c_, light.intensity_mw_cm2) : 0;
      if (steady > 0) steady_ = steady;
      const detail::StepError scale = scales();
      // After a switch everything begins anew, within millionths of a second.
      double h = std::min(light.seconds, 1e-6);
      while (time < end) {
        context.check_cancelled();
        const bool last = h >= end - time;
        step_.h = last ? end - time : h;
        const CellState before = state_;
        const double error = block_.step(step_, kd, c_.inhibitor_mol_l > 0, scale) / q_.tolerance;
        if (error > 1 && step_.h > kLeastStep * (1 + time)) {
          block_.put(before);
          h = step_.h * std::max(0.2, 0.9 / std::sqrt(error));
          continue;
        }
        state_ = block_.get();
        const double from = time;
        time = last ? end : time + step_.h;
        watch_gel(run, before, from, time);
        watch_inhibition(run, before, from, time);
        ++run.steps;
        note(run, time, light.intensity_mw_cm2, keep);
        if (until_gel && std::isfinite(run.gel_time_s)) return run;
        h = step_.h * std::clamp(0.9 / std::sqrt(std::max(error, 1e-12)), 0.3, 2.0);
        // Between moments there are straight lines.
        if (keep) h = std::min(h, light.seconds / kLeastSteps);
      }
    }
    return run;
  }

 private:
  static constexpr double kLeastStep = 1e-13, kLeastSteps = 300;

  detail::StepError scales() const {
    detail::StepError e;
    // Without oxygen there is none to be wrong by.
    e.scale_O = std::max(c_.oxygen_mol_l, 1e-9 * c_.groups_mol_l);
    e.scale_P = 0.1 * c_.groups_mol_l;
    e.scale_p = std::max(1e-3 * steady_, 1e-15 * c_.groups_mol_l);
    return e;
  }

  void note(CellRun& run, double time, double intensity, bool keep) {
    run.balance_error =
        std::max(run.balance_error, std::abs(groups(state_) - c_.groups_mol_l) / c_.groups_mol_l);
    if (!keep) run.moments.clear();
    run.moments.push_back({time, intensity, state_});
  }

  void watch_gel(CellRun& run, const CellState& before, double from, double to) const {
    const double level = c_.groups_mol_l * (1 - c_.gel_conversion);
    if (before.P0 > level && state_.P0 <= level && !std::isfinite(run.gel_time_s)) {
      run.gel_time_s = from + (to - from) * (before.P0 - level) / (before.P0 - state_.P0);
    }
  }

  /// Radicals set free so far, less what takes them first.
  void watch_inhibition(CellRun& run, const CellState& before, double from, double to) {
    const double ahead = born_ - found_;
    born_ += 2 * (before.I - state_.I);
    found_ += step_.supply_per_s * (to - from) * (c_.oxygen_mol_l - (before.O + state_.O) / 2);
    if (ahead <= 0 && born_ > found_ && !std::isfinite(run.inhibition_time_s)) {
      run.inhibition_time_s = from + (to - from) * ahead / (ahead - (born_ - found_));
    }
  }

  const Chemistry& c_;
  const CellQuestion& q_;
  CellState state_;
  Block block_;
  detail::ReactionStep step_;
  double steady_ = 0;
  /// Radicals of the initiator, and oxygen and inhibitor with what came from outside, mol/l.
  double born_ = 0, found_ = 0;
};

}  // namespace

CellState cell_at_start(const Chemistry& c) {
  CellState s;
  s.I = c.initiator_mol_l;
  s.P0 = c.groups_mol_l;
  s.O = c.oxygen_mol_l;
  s.Q = c.inhibitor_mol_l;
  return s;
}

double conversion(const Chemistry& c, const CellState& s) { return s.P2 / c.groups_mol_l; }

double used_up(const Chemistry& c, const CellState& s) { return 1 - s.P0 / c.groups_mol_l; }

CellState CellRun::at(double time_s) const {
  const auto after = std::lower_bound(moments.begin(), moments.end(), time_s,
                                      [](const CellMoment& m, double t) { return m.time_s < t; });
  if (after == moments.begin()) return moments.front().state;
  if (after == moments.end()) return moments.back().state;
  const CellMoment &b = *after, &a = *(after - 1);
  const double w = (time_s - a.time_s) / (b.time_s - a.time_s);
  CellState s;
  for (double CellState::*k : {&CellState::I, &CellState::Ir, &CellState::P0, &CellState::P1,
                               &CellState::P2, &CellState::P3, &CellState::O, &CellState::Q}) {
    s.*k = a.state.*k + w * (b.state.*k - a.state.*k);
  }
  return s;
}

std::string CellRun::to_csv(const Chemistry& c, std::size_t most) const {
  std::string out =
      "time_s,intensity_mw_cm2,initiator_mol_l,initiator_radicals_mol_l,groups_mol_l,"
      "chains_mol_l,bonded_mol_l,dead_mol_l,oxygen_mol_l,inhibitor_mol_l,conversion,used_up\n";
  // Steps lie where things change: every so many of them.
  const std::size_t every = std::max<std::size_t>(1, (moments.size() + most - 1) / most);
  for (std::size_t k = 0; k < moments.size(); ++k) {
    const CellMoment& m = moments[k];
    const bool switched =
        k + 1 < moments.size() && moments[k + 1].intensity_mw_cm2 != m.intensity_mw_cm2;
    if (k % every != 0 && k + 1 != moments.size() && !switched) continue;
    const CellState& s = m.state;
    out += fmt::format(
        "{:.9g},{:g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},"
        "{:.8g}\n",
        m.time_s, m.intensity_mw_cm2, s.I, s.Ir, s.P0, s.P1, s.P2, s.P3, s.O, s.Q, conversion(c, s),
        used_up(c, s));
  }
  return out;
}

CellRun run_cell(const Chemistry& c, const CellQuestion& question,
                 const ExecutionContext& context) {
  check(question);
  return Walk(c, question).run(false, true, context);
}

CellTimes cell_times(const Chemistry& c, double intensity_mw_cm2, double supply_per_s,
                     const ExecutionContext& context) {
  CellQuestion q;
  q.supply_per_s = supply_per_s;
  q.tolerance = 1e-4;
  CellTimes times;
  if (!never_gels(c, intensity_mw_cm2, supply_per_s).empty()) return times;
  // Initiator that is used up slows the end: a generous bound, which is not reached by resins that gel.
  const double inhibited = std::max(inhibition_time_used_up_s(c, intensity_mw_cm2),
                                    inhibition_time_supplied_s(c, intensity_mw_cm2, supply_per_s));
  constexpr double most_gel_times = 20;
  q.light = {{most_gel_times * (inhibited + gel_time_of(c).B / std::sqrt(intensity_mw_cm2)) +
                  10 / initiation_per_s(c, intensity_mw_cm2),
              intensity_mw_cm2}};
  check(q);
  const CellRun run = Walk(c, q).run(true, false, context);
  return {run.inhibition_time_s, run.gel_time_s};
}

std::string never_gels(const Chemistry& c, double intensity_mw_cm2, double supply_per_s) {
  if (!(intensity_mw_cm2 > 0)) return "there is no light; expected an intensity above 0";
  if (c.initiator_mol_l <= least_initiator_mol_l(c)) {
    return fmt::format(
        "the resin never gels: all radicals of its {:g} mol/l of initiator do not use "
        "up oxygen and inhibitor; it needs more than {:g} mol/l",
        c.initiator_mol_l, least_initiator_mol_l(c));
  }
  const double least = threshold_intensity_mw_cm2(c, supply_per_s);
  if (supply_per_s > 0 && intensity_mw_cm2 <= least) {
    return fmt::format(
        "the resin never gels under {:g} mW/cm²: as much oxygen comes from outside as "
        "it uses up; it needs more than {:.4g} mW/cm²",
        intensity_mw_cm2, least);
  }
  return "";
}

}  // namespace slicecorr
