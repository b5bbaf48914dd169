// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The light that makes the front's dose even under a section.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "flow/coarser_section.hpp"
#include "flow/descent.hpp"
#include "flow/image_light.hpp"
#include "flow/need.hpp"
#include "flow/optimise_from.hpp"
#include "flow/solvable.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_section.hpp"

namespace slicecorr {
namespace {

using detail::need;

/// The window's doses are kept this much below their limit, and cost the square of what they are
/// above, times this, per cell.
constexpr double kWindowMargin = 0.005;
constexpr double kWindowCost = 30;
/// No place gets less than this share of the best constant light: nothing is won by less, and columns so
/// dim could not be drawn beside bright ones.
constexpr double kLeastShare = 0.3;
/// Times that light is sought, with ten times the window's cost each, until its doses hold.
constexpr int kWindowRounds = 4;
/// Gaps of the first look and steps of the second; steps of light at each.
constexpr int kCoarseGaps = 7, kFineGaps = 5, kLook = 60, kRefine = 40;
constexpr int kConstantGaps = 12, kConstantFine = 12;

void check_goal(const FlowSection& section, const FlowResin& resin, const SectionGoal& g) {
  need(std::isfinite(g.min_gap_um) && g.min_gap_um > 0, "min_gap_um", g.min_gap_um, "more than 0");
  need(std::isfinite(g.max_gap_um) && g.max_gap_um >= g.min_gap_um, "max_gap_um", g.max_gap_um,
       "min_gap_um or more");
  need(std::isfinite(g.max_blue_mw_cm2) && g.max_blue_mw_cm2 > 0, "max_blue_mw_cm2",
       g.max_blue_mw_cm2, "more than 0");
  need(std::isfinite(g.max_uv_mw_cm2) && g.max_uv_mw_cm2 >= 0, "max_uv_mw_cm2", g.max_uv_mw_cm2,
       "0 or more");
  need(std::isfinite(g.max_window) && g.max_window > kWindowMargin, "max_window", g.max_window,
       "more than 0.005");
  need(std::isfinite(g.leave_out_gaps) && g.leave_out_gaps >= 0, "leave_out_gaps", g.leave_out_gaps,
       "0 or more");
  need(std::isfinite(g.smooth_um) && g.smooth_um >= 0, "smooth_um", g.smooth_um, "0 or more");
  need(std::isfinite(g.uv_pull) && g.uv_pull >= 0, "uv_pull", g.uv_pull, "0 or more");
  need(g.iterations >= 1, "iterations", g.iterations, "1 or more");
  if (!g.weight.empty()) {
    need(g.weight.size() == section.size(), "weight", static_cast<double>(g.weight.size()),
         "a number per cell");
    for (const double w : g.weight) need(std::isfinite(w) && w >= 0, "weight", w, "0 or more");
  }
  if (g.image) detail::check_image(section, *g.image);
  if (!(resin.kinetics.beta > 0) || g.max_uv_mw_cm2 == 0) {
    throw InfeasibleError(
        "flow: no dead zone lasts without inhibition by UV light, so the part sticks to the window "
        "at once; it needs UV light and a resin with beta > 0");
  }
}

/// What it costs where cells are to hold curing light off the window and don't: the mean square of what is
/// missing, as a share of the cap, times this.
constexpr double kHoldOffCost = 10;

/// What stays the same for all gaps.
struct Task {
  const FlowSection& section;
  const GapPressure& pressure;
  const FlowResin& resin;
  double speed_mm_h;
  const SectionGoal& goal;
  const ExecutionContext& context;
  std::vector<std::size_t> cells;  ///< of part
  std::vector<std::size_t>
      asked;  ///< whose light is sought: those of part, and others that they show
  std::vector<int> right, below;  ///< of those, their neighbours among them; -1 without
  std::vector<double> distance_um;
  double holds_off = 0;  ///< `StartLight::holds_off`

  std::vector<double> weight(double gap_um) const {
    std::vector<double> w(section.size(), 0.0);
    double sum = 0;
    for (const std::size_t cell : cells) {
      if (distance_um[cell] < goal.leave_out_gaps * gap_um) continue;
      w[cell] = goal.weight.empty() ? 1 : goal.weight[cell];
      sum += w[cell];
    }
    if (!(sum > 0)) {
      throw InputError("flow", "leave_out_gaps",
                       fmt::format("nothing counts at a gap of {} um; expected less to be left out "
                                   "or a part of more weight",
                                   gap_um));
    }
    return w;
  }
};

Task make_task(const FlowSection& section, const GapPressure& pressure, const FlowResin& resin,
               double speed_mm_h, const SectionGoal& goal, const ExecutionContext& context) {
  Task t{section, pressure, resin, speed_mm_h, goal, context, {}, {}, {}, {}, {}};
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] == FlowCell::part) t.cells.push_back(i);
  }
  t.asked = detail::asked_cells(section, goal.image.get());
  std::vector<int> number(section.size(), -1);
  for (std::size_t k = 0; k < t.asked.size(); ++k) number[t.asked[k]] = static_cast<int>(k);
  const auto width = static_cast<std::size_t>(section.width);
  for (const std::size_t i : t.asked) {
    t.right.push_back((i + 1) % width != 0 ? number[i + 1] : -1);
    t.below.push_back(i + width < section.size() ? number[i + width] : -1);
  }
  t.distance_um = outline_distance_um(section);
  return t;
}

/// Light of a section at one gap, and how far it misses the goal.
struct Choice {
  double gap_um = 0;
  double value = std::numeric_limits<double>::infinity();
  std::vector<double> x;  ///< shares of the caps: of blue, then of UV, one number or one per cell
  int iterations = 0;
};

/// The problem at one gap.
class AtGap {
 public:
  AtGap(const Task& task, double gap_um)
      : t_(task),
        gap_um_(gap_um),
        weight_(task.weight(gap_um)),
        total_(std::accumulate(weight_.begin(), weight_.end(), 0.0)),
        sweep_(task.section, task.pressure, task.resin, task.speed_mm_h, {&gap_um, 1},
               task.goal.sweep) {}

  /// The best constant light, shares of the caps.
  Choice constant() const {
    if (sweep_.linear()) return constant_linear();
    return constant_any();
  }

  Choice patterned(std::vector<double> x, int iterations, double window_cost = kWindowCost) const {
    const detail::Descent d = detail::descend(
        std::move(x), least(),
        [&](const std::vector<double>& at, std::vector<double>& gradient) {
          return value(at, gradient, window_cost);
        },
        iterations);
    return {gap_um_, d.value, d.x, d.iterations};
  }

  /// One number or one per cell, as the goal asks for.
  std::vector<double> spread(double blue, double uv) const {
    std::vector<double> x(blue_size(), blue);
    x.insert(x.end(), uv_size(), uv);
    return x;
  }
  /// From shares of the caps, cells.
  std::vector<double> shares(const std::vector<double>& blue, const std::vector<double>& uv) const {
    std::vector<double> x;
    for (const auto& [from, count] : {std::pair{&blue, blue_size()}, std::pair{&uv, uv_size()}}) {
      for (std::size_t k = 0; k < count; ++k) x.push_back((*from)[t_.asked[k]]);
    }
    return x;
  }
  /// The light that is asked for.
  std::vector<double> blue(const std::vector<double>& x) const {
    return light(x, 0, blue_size(), t_.goal.max_blue_mw_cm2);
  }
  std::vector<double> uv(const std::vector<double>& x) const {
    return light(x, blue_size(), uv_size(), t_.goal.max_uv_mw_cm2);
  }
  /// The dose of what cells show of it.
  SectionDose dose(const std::vector<double>& x) const {
    return sweep_.dose(shown_blue(x), shown_uv(x));
  }

 private:
  /// What no place gets less of.
  std::vector<double> least() const {
    std::vector<double> x(blue_size() + uv_size(), 0.0);
    if (!sweep_.linear() || x.size() == 2) return x;
    const Choice even = constant_linear();
    for (std::size_t k = 0; k < x.size(); ++k) {
      x[k] = kLeastShare * even.x[k < blue_size() ? 0 : 1];
    }
    return x;
  }

  std::size_t blue_size() const {
    const FlowPattern p = t_.goal.pattern;
    return p == FlowPattern::blue || p == FlowPattern::both ? t_.asked.size() : 1;
  }
  std::size_t uv_size() const {
    const FlowPattern p = t_.goal.pattern;
    return p == FlowPattern::uv || p == FlowPattern::both ? t_.asked.size() : 1;
  }

  const ImageLight* image() const { return t_.goal.image.get(); }
  const ImageLight* uv_image() const { return image() && image()->uv ? image() : nullptr; }
  std::vector<double> shown_blue(const std::vector<double>& x) const {
    return image() ? image()->of_blue(t_.section, blue(x)) : blue(x);
  }
  std::vector<double> shown_uv(const std::vector<double>& x) const {
    return image() ? image()->of_uv(t_.section, uv(x)) : uv(x);
  }
  std::vector<double> light(const std::vector<double>& x, std::size_t from, std::size_t count,
                            double cap) const {
    std::vector<double> cells(t_.section.size(), 0.0);
    for (std::size_t k = 0; k < t_.asked.size(); ++k) {
      cells[t_.asked[k]] = cap * x[from + (count > 1 ? k : 0)];
    }
    return cells;
  }

  double missed(const SectionDose& dose, std::vector<double>* front) const {
    double sum = 0;
    for (const std::size_t cell : t_.cells) {
      const double miss = dose.front[cell] - 1;
      sum += weight_[cell] * miss * miss;
      if (front) (*front)[cell] = 2 * weight_[cell] * miss / total_;
    }
    return sum / total_;
  }

  double value(const std::vector<double>& x, std::vector<double>& gradient,
               double window_cost) const {
    t_.context.check_cancelled();
    const std::vector<double> blue_light = shown_blue(x), uv_light = shown_uv(x);
    const SectionDose dose = sweep_.dose(blue_light, uv_light);
    std::vector<double> front(t_.section.size(), 0.0), window(t_.section.size(), 0.0);
    double sum = missed(dose, &front);
    const double per_cell = window_cost / static_cast<double>(t_.cells.size());
    for (const std::size_t cell : t_.cells) {
      const double above = dose.window[cell] - (t_.goal.max_window - kWindowMargin);
      if (!(above > 0)) continue;
      sum += per_cell * above * above;
      window[cell] = 2 * per_cell * above;
    }
    const SectionGradient by_light = sweep_.gradient(blue_light, uv_light, front, window);
    std::fill(gradient.begin(), gradient.end(), 0.0);
    add(detail::by_asked(t_.section, image(), by_light.blue), t_.goal.max_blue_mw_cm2, 0,
        blue_size(), gradient);
    add(detail::by_asked(t_.section, uv_image(), by_light.uv), t_.goal.max_uv_mw_cm2, blue_size(),
        uv_size(), gradient);
    sum += rough(x, 0, blue_size(), gradient);
    sum += rough(x, blue_size(), uv_size(), gradient);
    sum += pulled(x, gradient);
    if (t_.holds_off > 0) sum += held_off(x, gradient);
    return sum;
  }

  void add(const std::vector<double>& by_cell, double cap, std::size_t from, std::size_t count,
           std::vector<double>& gradient) const {
    for (std::size_t k = 0; k < t_.asked.size(); ++k) {
      gradient[from + (count > 1 ? k : 0)] += cap * by_cell[t_.asked[k]];
    }
  }

  /// The mean of (smooth_um |grad x|)² and its gradient.
  double rough(const std::vector<double>& x, std::size_t from, std::size_t count,
               std::vector<double>& gradient) const {
    if (count == 1) return 0;
    double sum = 0;
    const auto along = [&](const std::vector<int>& neighbour, double pitch) {
      const double share = t_.goal.smooth_um / pitch;
      const double cost = share * share / static_cast<double>(count);
      for (std::size_t k = 0; k < count; ++k) {
        if (neighbour[k] < 0) continue;
        const auto other = static_cast<std::size_t>(neighbour[k]);
        const double step = x[from + other] - x[from + k];
        sum += cost * step * step;
        gradient[from + other] += 2 * cost * step;
        gradient[from + k] -= 2 * cost * step;
      }
    };
    along(t_.right, t_.section.pitch_x_um);
    along(t_.below, t_.section.pitch_y_um);
    return sum;
  }

  double held_off(const std::vector<double>& x, std::vector<double>& gradient) const {
    const double uv_to_blue =
        t_.holds_off * t_.resin.kinetics.beta * t_.goal.max_uv_mw_cm2 / t_.goal.max_blue_mw_cm2;
    const double cost = kHoldOffCost / static_cast<double>(t_.asked.size());
    double sum = 0;
    for (std::size_t k = 0; k < t_.asked.size(); ++k) {
      const std::size_t b = blue_size() > 1 ? k : 0, u = blue_size() + (uv_size() > 1 ? k : 0);
      const double lacks = x[b] - uv_to_blue * x[u];
      if (!(lacks > 0)) continue;
      sum += cost * lacks * lacks;
      gradient[b] += 2 * cost * lacks;
      gradient[u] -= 2 * cost * lacks * uv_to_blue;
    }
    return sum;
  }

  double pulled(const std::vector<double>& x, std::vector<double>& gradient) const {
    const std::size_t count = uv_size(), from = blue_size();
    if (count == 1) return 0;
    const double n = static_cast<double>(count), cost = t_.goal.uv_pull / n;
    const double mean =
        std::accumulate(x.begin() + static_cast<std::ptrdiff_t>(from), x.end(), 0.0) / n;
    double sum = 0;
    for (std::size_t k = from; k < from + count; ++k) {
      sum += cost * (x[k] - mean) * (x[k] - mean);
      gradient[k] += 2 * cost * (x[k] - mean);
    }
    return sum;
  }

  /// For each UV light the best blue one is known, and what it misses is convex in UV.
  Choice constant_linear() const {
    const std::vector<double> one(t_.section.size(), 1.0), none(t_.section.size(), 0.0);
    const SectionDose of_blue = sweep_.dose(detail::followed(t_.section, image(), one), none);
    const SectionDose of_uv = sweep_.dose(none, detail::followed(t_.section, uv_image(), one));
    SectionDose besides{none, none};
    if (image())
      besides = sweep_.dose(image()->blue_mw_cm2, uv_image() ? image()->uv_mw_cm2 : none);
    const double limit = t_.goal.max_window - kWindowMargin;
    const auto best_blue = [&](double uv) {
      double up = 0, down = 0, most = t_.goal.max_blue_mw_cm2;
      for (const std::size_t cell : t_.cells) {
        const double b = of_blue.front[cell];
        up += weight_[cell] * b * (1 - besides.front[cell] - uv * of_uv.front[cell]);
        down += weight_[cell] * b * b;
        if (of_blue.window[cell] > 0) {
          const double left = limit - besides.window[cell] - uv * of_uv.window[cell];
          most = std::min(most, left / of_blue.window[cell]);
        }
      }
      return down > 0 ? std::clamp(up / down, 0.0, std::max(most, 0.0)) : 0.0;
    };
    const auto misses = [&](double uv) {
      const double b = best_blue(uv);
      double sum = 0;
      for (const std::size_t cell : t_.cells) {
        const double miss =
            besides.front[cell] + b * of_blue.front[cell] + uv * of_uv.front[cell] - 1;
        sum += weight_[cell] * miss * miss;
      }
      return sum / total_;
    };
    double low = 0, high = t_.goal.max_uv_mw_cm2;
    for (int k = 0; k < 80; ++k) {
      const double a = low + (high - low) * 0.4, b = low + (high - low) * 0.6;
      (misses(a) <= misses(b) ? high : low) = misses(a) <= misses(b) ? b : a;
    }
    double uv = 0.5 * (low + high);
    for (const double end : {0.0, t_.goal.max_uv_mw_cm2}) {
      if (misses(end) < misses(uv)) uv = end;
    }
    return {gap_um_,
            misses(uv),
            {best_blue(uv) / t_.goal.max_blue_mw_cm2, uv / t_.goal.max_uv_mw_cm2},
            0};
  }

  /// Two numbers, by descent from a few UV lights, each with the blue light whose mean dose is 1.
  Choice constant_any() const {
    SectionGoal goal = t_.goal;
    goal.pattern = FlowPattern::constant;
    const Task task{t_.section, t_.pressure, t_.resin, t_.speed_mm_h, goal,          t_.context,
                    t_.cells,   t_.asked,    t_.right, t_.below,      t_.distance_um};
    const AtGap even(task, gap_um_);
    Choice best;
    for (const double uv : {0.25, 0.5, 1.0}) {
      double low = 0, high = 1;
      for (int k = 0; k < 12; ++k) {
        const double blue = 0.5 * (low + high);
        const SectionDose dose = even.dose({blue, uv});
        double mean = 0;
        for (const std::size_t cell : t_.cells) mean += weight_[cell] * dose.front[cell];
        (mean < total_ ? low : high) = blue;
      }
      Choice next = even.patterned({0.5 * (low + high), uv}, 40);
      if (next.value < best.value) best = std::move(next);
    }
    return best;
  }

  const Task& t_;
  double gap_um_;
  std::vector<double> weight_;
  double total_;
  SectionSweep sweep_;
};

/// The best constant light, and what of it is to be patterned after a few steps.
Choice look(const Task& task, double gap_um, int steps) {
  const AtGap at(task, gap_um);
  Choice choice = at.constant();
  if (task.goal.pattern == FlowPattern::constant) return choice;
  return at.patterned(at.spread(choice.x[0], choice.x[1]), steps);
}

Choice best_gap(const Task& task) {
  const double low = task.goal.min_gap_um, high = task.goal.max_gap_um;
  if (low == high) return look(task, low, kLook);
  const bool constant = task.goal.pattern == FlowPattern::constant;
  const std::size_t count = constant ? kConstantGaps : kCoarseGaps;
  std::vector<Choice> choices(count);
  parallel_for(task.context, "gaps", count, [&](std::size_t k) {
    const double share = static_cast<double>(k) / static_cast<double>(count - 1);
    const double gap = k == 0 ? low : k + 1 == count ? high : low * std::pow(high / low, share);
    choices[k] = look(task, gap, kLook);
  });
  const auto lowest = static_cast<std::size_t>(
      std::min_element(choices.begin(), choices.end(),
                       [](const Choice& a, const Choice& b) { return a.value < b.value; }) -
      choices.begin());
  Choice best = choices[lowest];
  // Golden section between its neighbours.
  double a = choices[lowest > 0 ? lowest - 1 : 0].gap_um;
  double b = choices[std::min(lowest + 1, count - 1)].gap_um;
  const double golden = 0.381966011250105;
  for (int k = 0; k < (constant ? kConstantFine : kFineGaps); ++k) {
    const bool left = best.gap_um - a > b - best.gap_um;
    const double gap =
        left ? best.gap_um - golden * (best.gap_um - a) : best.gap_um + golden * (b - best.gap_um);
    if (b - a < 0.2) break;
    Choice next = look(task, gap, kLook);
    if (next.value < best.value) {
      (left ? b : a) = best.gap_um;
      best = std::move(next);
    } else {
      (left ? a : b) = gap;
    }
  }
  return best;
}

/// Other cells take the light of the nearest asked ones, ring by ring.
void fill_outside(const Task& task, std::vector<double>& light) {
  const FlowSection& s = task.section;
  std::vector<char> known(s.size(), 0);
  std::vector<std::size_t> front = task.asked;
  for (const std::size_t i : front) known[i] = 1;
  while (!front.empty()) {
    std::vector<std::size_t> next;
    for (const std::size_t i : front) {
      const int x = static_cast<int>(i % static_cast<std::size_t>(s.width));
      const int y = static_cast<int>(i / static_cast<std::size_t>(s.width));
      for (const auto& [dx, dy] : {std::array{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        if (x + dx < 0 || y + dy < 0 || x + dx >= s.width || y + dy >= s.height) continue;
        const std::size_t to = s.index(x + dx, y + dy);
        if (known[to]) continue;
        known[to] = 1;
        light[to] = light[i];
        next.push_back(to);
      }
    }
    front.swap(next);
  }
}

/// Gaps are compared on sections of no more cells than this.
constexpr std::size_t kScanCells = 800;

std::size_t parts_of(const FlowSection& s) {
  return static_cast<std::size_t>(std::count(s.cells.begin(), s.cells.end(), FlowCell::part));
}

/// Light at a gap, cells, shares of the caps.
struct Scan {
  double gap_um = 0;
  std::vector<double> blue, uv;
  int iterations = 0;
};

Scan scan_of(const Task& task, const AtGap& at, const Choice& choice, int iterations_before) {
  Scan scan{choice.gap_um, at.blue(choice.x), at.uv(choice.x),
            iterations_before + choice.iterations};
  for (double& v : scan.blue) v /= task.goal.max_blue_mw_cm2;
  for (double& v : scan.uv) v /= task.goal.max_uv_mw_cm2;
  fill_outside(task, scan.blue);
  fill_outside(task, scan.uv);
  return scan;
}

Scan scan_of(const Task& task, const detail::StartLight& start) {
  Scan scan{task.goal.min_gap_um, start.blue_mw_cm2, start.uv_mw_cm2, 0};
  for (double& v : scan.blue) v /= task.goal.max_blue_mw_cm2;
  for (double& v : scan.uv) v /= task.goal.max_uv_mw_cm2;
  return scan;
}

/// The best gap, on coarser cells where there are many, and the light found there. `refined`: light is
/// sought on these cells, too, from that of the coarser ones.
Scan scan_gaps(const Task& task, bool refined) {
  const FlowSection& s = task.section;
  FlowSection coarse;
  if (parts_of(s) <= kScanCells || (coarse = detail::coarser(s, 2), !detail::solvable(coarse))) {
    const Choice choice = best_gap(task);
    return scan_of(task, AtGap(task, choice.gap_um), choice, 0);
  }
  SectionGoal goal = task.goal;
  goal.weight = detail::sums_on_coarser(s, coarse, 2, task.goal.weight);
  if (goal.image) {
    goal.image =
        std::make_shared<const ImageLight>(detail::coarser_image(s, coarse, 2, *goal.image));
  }
  const GapPressure pressure = solve_pressure(coarse, task.context);
  const Scan below =
      scan_gaps(make_task(coarse, pressure, task.resin, task.speed_mm_h, goal, task.context), true);
  Scan scan{below.gap_um, detail::on_finer(s, coarse, below.blue),
            detail::on_finer(s, coarse, below.uv), below.iterations};
  if (!refined || task.goal.pattern == FlowPattern::constant) return scan;
  const AtGap at(task, scan.gap_um);
  return scan_of(task, at, at.patterned(at.shares(scan.blue, scan.uv), kRefine), scan.iterations);
}

/// The best light; `start` null: from the best constant light, by way of coarser cells.
SectionOptimum optimum(const FlowSection& section, const GapPressure& pressure,
                       const FlowResin& resin, double speed_mm_h, const SectionGoal& goal,
                       const detail::StartLight* start, const ExecutionContext& context) {
  check_section(section);
  check_goal(section, resin, goal);
  if (pressure.gap_um > 0) {
    throw InputError("flow", "pressure", "is of a gap that varies; expected that of an even one");
  }
  Task task = make_task(section, pressure, resin, speed_mm_h, goal, context);
  task.holds_off = start ? start->holds_off : 0;
  const Scan scan = start ? scan_of(task, *start) : scan_gaps(task, false);
  const AtGap at(task, scan.gap_um);
  Choice choice;
  choice.gap_um = scan.gap_um;
  SectionOptimum best;
  best.gap_um = scan.gap_um;
  const auto shine = [&] {
    best.blue_mw_cm2 = at.blue(choice.x);
    best.uv_mw_cm2 = at.uv(choice.x);
    best.dose = at.dose(choice.x);
    best.summary = summarise(section, best.dose, task.weight(choice.gap_um));
  };
  best.iterations = scan.iterations;
  if (goal.pattern == FlowPattern::constant) {
    choice = at.constant();
    shine();
  } else {
    choice.x = at.shares(scan.blue, scan.uv);
    double cost = kWindowCost;
    for (int round = 0; round < kWindowRounds; ++round, cost *= 10) {
      choice =
          at.patterned(std::move(choice.x),
                       round == 0 ? goal.iterations : std::min(goal.iterations, kRefine), cost);
      best.iterations += choice.iterations;
      shine();
      if (best.summary.max_window <= goal.max_window) break;
    }
  }
  const auto most = [&](const std::vector<double>& light) {
    return *std::max_element(light.begin(), light.end());
  };
  best.blue_at_cap = most(best.blue_mw_cm2) >= goal.max_blue_mw_cm2 * (1 - 1e-6);
  best.uv_at_cap = most(best.uv_mw_cm2) >= goal.max_uv_mw_cm2 * (1 - 1e-6);
  best.gap_at_limit = goal.min_gap_um < goal.max_gap_um &&
                      (best.gap_um == goal.min_gap_um || best.gap_um == goal.max_gap_um);
  fill_outside(task, best.blue_mw_cm2);
  fill_outside(task, best.uv_mw_cm2);
  return best;
}

}  // namespace

SectionOptimum optimise_section(const FlowSection& section, const GapPressure& pressure,
                                const FlowResin& resin, double speed_mm_h, const SectionGoal& goal,
                                const ExecutionContext& context) {
  return optimum(section, pressure, resin, speed_mm_h, goal, nullptr, context);
}

SectionOptimum detail::optimise_section_from(const StartLight& start, const FlowSection& section,
                                             const GapPressure& pressure, const FlowResin& resin,
                                             double speed_mm_h, const SectionGoal& goal,
                                             const ExecutionContext& context) {
  return optimum(section, pressure, resin, speed_mm_h, goal, &start, context);
}

}  // namespace slicecorr
