// The light that makes the front's dose even under a section.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "descent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_section.hpp"

namespace slicecorr {
namespace {

/// The window's doses are kept this much below their limit, and cost the square of what they are
/// above, times this, per cell.
constexpr double kWindowMargin = 0.005;
constexpr double kWindowCost = 30;
/// Gaps of the first look and steps of the second; steps of light at each.
constexpr int kCoarseGaps = 7, kFineGaps = 5, kLook = 60;
constexpr int kConstantGaps = 12, kConstantFine = 12;

void need(bool good, const char* what, double value, const char* expected) {
  if (!good) throw InputError("flow", what, fmt::format("{}; expected {}", value, expected));
}

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
  if (!(resin.kinetics.beta > 0) || g.max_uv_mw_cm2 == 0) {
    throw InfeasibleError(
        "flow: no dead zone lasts without inhibition by UV light, so the part sticks to the window "
        "at once; it needs UV light and a resin with beta > 0");
  }
}

/// What stays the same for all gaps.
struct Task {
  const FlowSection& section;
  const GapPressure& pressure;
  const FlowResin& resin;
  double speed_mm_h;
  const SectionGoal& goal;
  const ExecutionContext& context;
  std::vector<std::size_t> cells;  ///< of part
  std::vector<int> right, below;   ///< of those, their neighbours among them; -1 without
  std::vector<double> distance_um;

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
  Task t{section, pressure, resin, speed_mm_h, goal, context, {}, {}, {}, {}};
  std::vector<int> number(section.size(), -1);
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    number[i] = static_cast<int>(t.cells.size());
    t.cells.push_back(i);
  }
  const auto width = static_cast<std::size_t>(section.width);
  for (const std::size_t i : t.cells) {
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

  const SectionSweep& sweep() const { return sweep_; }

  /// The best constant light, shares of the caps.
  Choice constant() const {
    if (sweep_.linear()) return constant_linear();
    return constant_any();
  }

  Choice patterned(std::vector<double> x, int iterations, double window_cost = kWindowCost) const {
    const detail::Descent d = detail::descend(
        std::move(x),
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
      for (std::size_t k = 0; k < count; ++k) x.push_back((*from)[t_.cells[k]]);
    }
    return x;
  }
  std::vector<double> blue(const std::vector<double>& x) const {
    return light(x, 0, blue_size(), t_.goal.max_blue_mw_cm2);
  }
  std::vector<double> uv(const std::vector<double>& x) const {
    return light(x, blue_size(), uv_size(), t_.goal.max_uv_mw_cm2);
  }

 private:
  std::size_t blue_size() const {
    const FlowPattern p = t_.goal.pattern;
    return p == FlowPattern::blue || p == FlowPattern::both ? t_.cells.size() : 1;
  }
  std::size_t uv_size() const {
    const FlowPattern p = t_.goal.pattern;
    return p == FlowPattern::uv || p == FlowPattern::both ? t_.cells.size() : 1;
  }

  std::vector<double> light(const std::vector<double>& x, std::size_t from, std::size_t count,
                            double cap) const {
    std::vector<double> cells(t_.section.size(), 0.0);
    for (std::size_t k = 0; k < t_.cells.size(); ++k) {
      cells[t_.cells[k]] = cap * x[from + (count > 1 ? k : 0)];
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
    const std::vector<double> blue_light = blue(x), uv_light = uv(x);
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
    add(by_light.blue, t_.goal.max_blue_mw_cm2, 0, blue_size(), gradient);
    add(by_light.uv, t_.goal.max_uv_mw_cm2, blue_size(), uv_size(), gradient);
    sum += rough(x, 0, blue_size(), gradient);
    sum += rough(x, blue_size(), uv_size(), gradient);
    sum += pulled(x, gradient);
    return sum;
  }

  void add(const std::vector<double>& by_cell, double cap, std::size_t from, std::size_t count,
           std::vector<double>& gradient) const {
    for (std::size_t k = 0; k < t_.cells.size(); ++k) {
      gradient[from + (count > 1 ? k : 0)] += cap * by_cell[t_.cells[k]];
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
    const double one = 1, none = 0;
    const SectionDose of_blue = sweep_.dose({&one, 1}, {&none, 1});
    const SectionDose of_uv = sweep_.dose({&none, 1}, {&one, 1});
    const double limit = t_.goal.max_window - kWindowMargin;
    const auto best_blue = [&](double uv) {
      double up = 0, down = 0, most = t_.goal.max_blue_mw_cm2;
      for (const std::size_t cell : t_.cells) {
        const double b = of_blue.front[cell];
        up += weight_[cell] * b * (1 - uv * of_uv.front[cell]);
        down += weight_[cell] * b * b;
        if (of_blue.window[cell] > 0) {
          most = std::min(most, (limit - uv * of_uv.window[cell]) / of_blue.window[cell]);
        }
      }
      return std::clamp(up / down, 0.0, std::max(most, 0.0));
    };
    const auto misses = [&](double uv) {
      const double b = best_blue(uv);
      double sum = 0;
      for (const std::size_t cell : t_.cells) {
        const double miss = b * of_blue.front[cell] + uv * of_uv.front[cell] - 1;
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
    const Task task{t_.section, t_.pressure, t_.resin, t_.speed_mm_h, goal,
                    t_.context, t_.cells,    t_.right, t_.below,      t_.distance_um};
    const AtGap even(task, gap_um_);
    Choice best;
    for (const double uv : {0.25, 0.5, 1.0}) {
      double low = 0, high = 1;
      for (int k = 0; k < 12; ++k) {
        const double blue = 0.5 * (low + high);
        const SectionDose dose = even.sweep_.dose(even.blue({blue, uv}), even.uv({blue, uv}));
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

/// Cells outside the part take the light of the nearest filled ones, ring by ring.
void fill_outside(const FlowSection& s, std::vector<double>& light) {
  std::vector<char> known(s.size(), 0);
  std::vector<std::size_t> front;
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.cells[i] != FlowCell::part) continue;
    known[i] = 1;
    front.push_back(i);
  }
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
constexpr std::size_t kScanCells = 800, kScanConstant = 4000;

/// A section on cells of twice the size, and what counts on it.
struct Coarse {
  FlowSection section;
  std::vector<double> weight;
};

Coarse coarsened(const FlowSection& s, const std::vector<double>& weight) {
  Coarse c;
  c.section.width = (s.width + 1) / 2;
  c.section.height = (s.height + 1) / 2;
  c.section.pitch_x_um = 2 * s.pitch_x_um;
  c.section.pitch_y_um = 2 * s.pitch_y_um;
  for (int y = 0; y < c.section.height; ++y) {
    for (int x = 0; x < c.section.width; ++x) {
      double covered = 0, counts = 0;
      int blind = 0;
      std::int32_t of_void = 0;
      for (int k = 0; k < 4; ++k) {
        const int u = 2 * x + k % 2, v = 2 * y + k / 2;
        if (u >= s.width || v >= s.height) continue;
        const std::size_t i = s.index(u, v);
        const FlowCell cell = s.cells[i];
        covered +=
            s.coverage.empty() || cell == FlowCell::blind ? cell != FlowCell::bath : s.coverage[i];
        if (!weight.empty()) counts += weight[i];
        if (cell != FlowCell::blind) continue;
        ++blind;
        if (!s.voids.empty()) of_void = s.voids[i];
      }
      const bool part = covered >= 2;
      c.section.cells.push_back(part && blind >= 2 ? FlowCell::blind
                                : part             ? FlowCell::part
                                                   : FlowCell::bath);
      c.section.coverage.push_back(static_cast<float>(covered / 4));
      if (!s.voids.empty()) c.section.voids.push_back(of_void);
      if (!weight.empty()) c.weight.push_back(counts);
    }
  }
  return c;
}

std::size_t parts_of(const FlowSection& s) {
  return static_cast<std::size_t>(std::count(s.cells.begin(), s.cells.end(), FlowCell::part));
}

bool fits(const FlowSection& s) {
  try {
    check_section(s);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

/// Light at a gap, cells, shares of the caps.
struct Scan {
  double gap_um = 0;
  std::vector<double> blue, uv;
  int iterations = 0;
};

/// The best gap, on coarser cells where there are many, and the light found there.
Scan scan_gaps(const Task& task) {
  const FlowSection& s = task.section;
  Coarse coarse;
  const bool fine =
      parts_of(s) <= kScanCells || (coarse = coarsened(s, task.goal.weight), !fits(coarse.section));
  Scan scan;
  if (!fine) {
    SectionGoal goal = task.goal;
    goal.weight = coarse.weight;
    const GapPressure pressure = solve_pressure(coarse.section, task.context);
    const Scan below = scan_gaps(
        make_task(coarse.section, pressure, task.resin, task.speed_mm_h, goal, task.context));
    scan = {below.gap_um, std::vector<double>(s.size()), std::vector<double>(s.size()),
            below.iterations};
    for (std::size_t i = 0; i < s.size(); ++i) {
      const auto width = static_cast<std::size_t>(s.width);
      const std::size_t from =
          coarse.section.index(static_cast<int>(i % width / 2), static_cast<int>(i / width / 2));
      scan.blue[i] = below.blue[from];
      scan.uv[i] = below.uv[from];
    }
    return scan;
  }
  const Choice choice = best_gap(task);
  const AtGap at(task, choice.gap_um);
  scan = {choice.gap_um, at.blue(choice.x), at.uv(choice.x), choice.iterations};
  for (double& v : scan.blue) v /= task.goal.max_blue_mw_cm2;
  for (double& v : scan.uv) v /= task.goal.max_uv_mw_cm2;
  fill_outside(s, scan.blue);
  fill_outside(s, scan.uv);
  return scan;
}

}  // namespace

DoseSummary summarise(const FlowSection& section, const SectionDose& dose,
                      std::span<const double> weight) {
  if (dose.front.size() != section.size() || dose.window.size() != section.size() ||
      (!weight.empty() && weight.size() != section.size())) {
    throw InputError("flow", "dose", "does not have a number per cell of the section");
  }
  DoseSummary s;
  s.min = std::numeric_limits<double>::infinity();
  s.max = s.max_window = -s.min;
  double total = 0;
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    s.max_window = std::max(s.max_window, dose.window[i]);
    const double w = weight.empty() ? 1 : weight[i], d = dose.front[i];
    if (!(w > 0)) continue;
    s.min = std::min(s.min, d);
    s.max = std::max(s.max, d);
    total += w;
    s.mean += w * d;
    s.mean_square += w * (d - 1) * (d - 1);
    s.within_10 += d >= 0.9 && d <= 1.1 ? w : 0;
  }
  if (!(total > 0)) throw InputError("flow", "weight", "no cell of part counts");
  s.mean /= total;
  s.mean_square /= total;
  s.within_10 /= total;
  return s;
}

SectionOptimum optimise_section(const FlowSection& section, const GapPressure& pressure,
                                const FlowResin& resin, double speed_mm_h, const SectionGoal& goal,
                                const ExecutionContext& context) {
  check_section(section);
  check_goal(section, resin, goal);
  if (pressure.gap_um > 0) {
    throw InputError("flow", "pressure", "is of a gap that varies; expected that of an even one");
  }
  const Task task = make_task(section, pressure, resin, speed_mm_h, goal, context);
  const Scan scan = scan_gaps(task);
  const AtGap at(task, scan.gap_um);
  Choice choice;
  choice.gap_um = scan.gap_um;
  SectionOptimum best;
  best.gap_um = scan.gap_um;
  const auto shine = [&] {
    best.blue_mw_cm2 = at.blue(choice.x);
    best.uv_mw_cm2 = at.uv(choice.x);
    best.dose = at.sweep().dose(best.blue_mw_cm2, best.uv_mw_cm2);
    best.summary = summarise(section, best.dose, task.weight(choice.gap_um));
  };
  best.iterations = scan.iterations;
  if (goal.pattern == FlowPattern::constant) {
    choice = at.constant();
    shine();
  } else {
    choice.x = at.shares(scan.blue, scan.uv);
    double cost = kWindowCost;
    for (int round = 0; round < 4; ++round, cost *= 10) {
      choice = at.patterned(std::move(choice.x), goal.iterations, cost);
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
  fill_outside(section, best.blue_mw_cm2);
  fill_outside(section, best.uv_mw_cm2);
  return best;
}

}  // namespace slicecorr
