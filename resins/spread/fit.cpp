// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Fit of spread and scatter to widths or edges.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "fit/figure_text.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "spread/checks.hpp"
#include "spread/problem.hpp"

namespace slicecorr::resins {

namespace {

std::string names_of(const std::vector<const KnownSpread*>& all) {
  std::string text;
  for (const KnownSpread* k : all) text += (text.empty() ? "" : ", ") + std::string(k->name);
  return text;
}

std::string advice_of(const std::vector<const KnownSpread*>& all, bool of_widths) {
  std::string text;
  for (const KnownSpread* k : all) {
    const char* const advice = of_widths ? k->of_widths : k->of_edges;
    if (text.find(advice) == std::string::npos)
      text += fmt::format("\n  for {}: {}", k->name, advice);
  }
  return text;
}

bool is_one_of(const KnownSpread* k, std::initializer_list<std::string_view> names) {
  return std::find(names.begin(), names.end(), std::string_view(k->name)) != names.end();
}

void check_options(const SpreadFitOptions& o, bool of_widths) {
  const auto check = [&](const std::string& name) {
    const KnownSpread* const k = known_spread(name);
    if (!k) {
      std::vector<const KnownSpread*> all;
      for (const KnownSpread& one : known_spread()) all.push_back(&one);
      throw InputError(
          fmt::format("'{}' is no parameter; expected one of {}", name, names_of(all)));
    }
    if (!of_widths && is_one_of(k, {"dose", "dark"})) {
      throw InputError(fmt::format("{} is no parameter of edges, only of widths", name));
    }
    if (o.gaussians == 1 && is_one_of(k, {"sigma2_um", "weight2"})) {
      throw InputError(fmt::format("{} is of a second Gaussian; expected --gaussians 2", name));
    }
  };
  for (const auto& [name, value] : o.fixed) check(name);
  for (const auto& name : o.held) check(name);
  for (const auto& name : o.free) check(name);
  if (o.gaussians != 1 && o.gaussians != 2) {
    throw InputError(fmt::format("{} Gaussians; expected 1 or 2", o.gaussians));
  }
}

/// Where parameters begin, and those that are held stay.
SpreadState state_before(const SpreadFitOptions& o) {
  SpreadState s;
  if (o.printer) {
    const auto& all = o.printer->spread.gaussians;
    if (!all.empty() && all[0].sigma_um > 0) s.sigma_um = all[0].sigma_um;
    if (o.gaussians == 2 && all.size() == 2) {
      s.sigma2_um = all[1].sigma_um;
      s.weight2 = all[1].weight;
    }
    const auto levels = level_intensities(*o.printer);
    s.dark = levels.front() / levels.back();
  }
  if (o.gaussians == 2 && s.weight2 == 0) {
    s.sigma2_um = 4 * s.sigma_um;
    s.weight2 = 0.1;
  }
  if (o.resin) s.scatter = o.resin->scatter_um2_per_um;
  if (o.dose) s.dose = *o.dose;
  for (const auto& [name, value] : o.fixed) s.*known_spread(name)->field = value;
  return s;
}

std::vector<const KnownSpread*> fitted_of(const SpreadFitOptions& o, bool of_widths,
                                          bool several_depths) {
  std::vector<const KnownSpread*> all;
  for (const KnownSpread& k : known_spread()) {
    if (o.fixed.count(k.name) || o.held.count(k.name)) continue;
    bool by_itself = is_one_of(&k, {"sigma_um"});
    if (is_one_of(&k, {"sigma2_um", "weight2"})) by_itself = o.gaussians == 2;
    if (is_one_of(&k, {"scatter_um2_per_um"})) by_itself = several_depths;
    if (is_one_of(&k, {"dose"})) by_itself = of_widths && !o.dose;
    if (by_itself || o.free.count(k.name)) all.push_back(&k);
  }
  if (all.empty()) throw InputError("all parameters are held: there is nothing to fit");
  return all;
}

/// The best of several starts.
double solve(const SpreadProblem& problem, const std::vector<std::vector<double>>& starts,
             std::vector<double>& best, bool fine = true) {
  struct Start {
    double cost = 0;
    const std::vector<double>* values = nullptr;
  };
  std::vector<Start> sorted;
  for (const auto& values : starts) {
    const double cost = problem.cost(values.data());
    if (std::isfinite(cost)) sorted.push_back({cost, &values});
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const Start& a, const Start& b) { return a.cost < b.cost; });
  double least = std::numeric_limits<double>::infinity();
  // Of several minima the best one counts, so those that begin alike are not all taken.
  const std::size_t most = fine ? 6 : 2, alike = fine ? 2 : 1;
  std::map<double, std::size_t> taken;
  std::size_t count = 0;
  for (const Start& start : sorted) {
    if (count == most) break;
    if (taken[start.values->front()]++ >= alike) continue;
    ++count;
    std::vector<double> values = *start.values;
    const double cost = minimise(problem, values, 1e-5, fine ? 60 : 20);
    if (cost < least * (1 - 1e-6)) {
      least = cost;
      best = values;
    }
  }
  return fine && std::isfinite(least) ? minimise(problem, best, kFine, 200) : least;
}

bool fits(const SpreadProblem& problem, std::string_view name) {
  return std::any_of(problem.fitted.begin(), problem.fitted.end(),
                     [&](const KnownSpread* k) { return name == k->name; });
}

/// States to begin with where these parameters are fitted: all combinations.
std::vector<SpreadState> combined(const SpreadProblem& problem, const std::vector<double>& sigmas,
                                  const std::vector<double>& doses) {
  std::vector<SpreadState> all;
  const bool scatters = fits(problem, "scatter_um2_per_um");
  for (const double sigma :
       fits(problem, "sigma_um") ? sigmas : std::vector{problem.start.sigma_um}) {
    for (const double dose : fits(problem, "dose") ? doses : std::vector{problem.start.dose}) {
      for (const double grows : scatters ? std::vector{0.0, 0.5, 3.0} : std::vector{0.0}) {
        SpreadState s = problem.start;
        s.sigma_um = sigma;
        s.dose = dose;
        if (scatters) s.scatter = grows * sigma * sigma / std::max(1.0, problem.deepest_um());
        all.push_back(s);
      }
    }
  }
  return all;
}

/// Where two Gaussians begin when one is found like this.
std::vector<std::vector<double>> starts_of_two(const SpreadProblem& problem,
                                               const SpreadState& one) {
  std::vector<std::vector<double>> starts;
  const bool wide = fits(problem, "sigma2_um"), share = fits(problem, "weight2");
  for (const double times : wide ? std::vector{2.0, 4.0, 8.0} : std::vector{0.0}) {
    for (const double part : share ? std::vector{0.05, 0.2, 0.5} : std::vector{0.0}) {
      for (const double less : {1.0, 0.8, 0.5}) {
        SpreadState s = one;
        s.sigma_um *= fits(problem, "sigma_um") ? less : 1;
        s.sigma2_um = wide ? times * one.sigma_um : problem.start.sigma2_um;
        s.weight2 = share ? part : problem.start.weight2;
        starts.push_back(problem.values_of(s));
      }
    }
  }
  return starts;
}

/// With one Gaussian from these states; with two from what one finds.
template <class Problem>
double solve_all(const Problem& problem, const std::vector<SpreadState>& states,
                 std::vector<double>& best) {
  if (problem.start.weight2 == 0) {
    std::vector<std::vector<double>> starts;
    starts.reserve(states.size());
    for (const SpreadState& s : states) starts.push_back(problem.values_of(s));
    return solve(problem, starts, best);
  }
  Problem one = problem;
  one.start.weight2 = 0;
  std::erase_if(one.fitted, [](const KnownSpread* k) {
    return is_one_of(k, {"sigma2_um", "weight2"});
  });
  SpreadState first = one.start;
  if (!one.fitted.empty()) {
    std::vector<SpreadState> plain = states;
    for (SpreadState& s : plain) s.weight2 = 0;
    std::vector<double> values;
    if (!std::isfinite(solve_all(one, plain, values))) {
      return std::numeric_limits<double>::infinity();
    }
    first = one.at(values.data());
  }
  return solve(problem, starts_of_two(problem, first), best);
}

FitShape shape_at(const SpreadProblem& problem, const std::vector<double>& values,
                  const std::string& source, bool of_widths) {
  FitShape shape = shape_of(problem, values);
  if (!shape.holds) {
    throw InputError(source, "", "the fit ended where light does not spread like this at all");
  }
  std::vector<const KnownSpread*> open;
  for (const std::size_t k : shape.open) {
    if (k < problem.fitted.size()) open.push_back(problem.fitted[k]);
  }
  if (shape.open.empty()) return shape;
  throw InputError(
      source, "",
      fmt::format("these {} can't tell {}{}; hold one with --fix, or measure{}",
                  of_widths ? "widths" : "edges",
                  open.empty() ? "where the edge lies" : names_of(open),
                  open.size() > 1 ? " from each other" : "", advice_of(open, of_widths)));
}

/// What has been found, and what does not belong to it.
struct Settled {
  std::vector<double> values;
  double cost = 0;
  FitShape shape;
};

[[noreturn]] void fail_too_many(const std::string& source, const std::string& line) {
  throw InputError(
      source, line,
      "more than a fifth of the rows do not belong to the others, this one the least; "
      "expected one printer, resin and exposure, or --keep-outliers to count them all");
}

/// Takes away rows that are off by more than light makes of any line, misread or mistyped: they
/// would lead the search astray. Of all starts the one counts that misses least by sum of absolute
/// values.
std::vector<WidthProblem::Row> take_gross(WidthProblem& problem,
                                          const std::vector<SpreadState>& states) {
  std::vector<double> best, off(problem.count());
  double least = std::numeric_limits<double>::infinity();
  for (const SpreadState& state : states) {
    const auto values = problem.values_of(state);
    if (!problem.residuals(values.data(), off.data())) continue;
    double sum = 0;
    for (std::size_t i = 0; i < off.size(); ++i) sum += std::abs(off[i]) * problem.rows[i].error_um;
    if (sum >= least) continue;
    least = sum;
    best = off;
  }
  std::vector<WidthProblem::Row> gross, rest;
  for (std::size_t i = 0; i < best.size(); ++i) {
    const WidthProblem::Row& r = problem.rows[i];
    const double far = 0.5 * (problem.scale_um() + r.designed_um);
    (std::abs(best[i]) * r.error_um > far ? gross : rest).push_back(r);
  }
  if (!gross.empty()) problem.rows = rest;
  return gross;
}

/// Solves, and leaves out what can't belong to the others: `all` are the rows of the problem that
/// count, `lines` tells the line of one. `left_out` holds those that are left out already.
template <class Problem, class Row, class Lines>
Settled settle(Problem& problem, std::vector<Row> Problem::*all,
               const std::vector<SpreadState>& states, const std::string& source, bool of_widths,
               bool outliers, const Lines& lines, std::vector<Row>& left_out) {
  Settled s;
  s.cost = solve_all(problem, states, s.values);
  if (!std::isfinite(s.cost)) {
    throw InputError(source, "",
                     "no spread of light gives anything like this; look at --printer, --resin and "
                     "what --fix holds");
  }
  s.shape = shape_at(problem, s.values, source, of_widths);
  const std::size_t count = (problem.*all).size() + left_out.size();
  const double rounding = of_widths ? 1e-6 * problem.scale_um() : 1e-7;
  const auto worst_of = [&]() -> std::optional<std::size_t> {
    return outliers ? outlier_of(s.shape, problem.unknowns(), rounding) : std::nullopt;
  };
  for (auto worst = worst_of(); worst; worst = worst_of()) {
    left_out.push_back((problem.*all)[*worst]);
    if (5 * left_out.size() > count || count - left_out.size() <= problem.unknowns() + 1) {
      fail_too_many(source, lines(left_out.front()));
    }
    (problem.*all).erase((problem.*all).begin() + static_cast<std::ptrdiff_t>(*worst));
    s.cost = minimise(problem, s.values, kFine, 200);
    s.shape = shape_at(problem, s.values, source, of_widths);
  }
  return s;
}

/// Parameters with their intervals.
void tell_parameters(const SpreadProblem& problem, const Settled& s, bool of_widths, int gaussians,
                     SpreadFit& fit) {
  fit.measurements = static_cast<int>(problem.count());
  fit.freedom = fit.measurements - static_cast<int>(problem.unknowns());
  // Nobody measures more than six digits, so nothing is known better than by these.
  const double digits = 1e-6 * (of_widths ? problem.scale_um() : 1);
  const double variance = std::max(s.cost / fit.freedom, digits * digits);
  const double quantile = student_t_quantile(0.975, fit.freedom);
  const SpreadState found = problem.at(s.values.data());
  for (const KnownSpread& k : known_spread()) {
    if (!of_widths && is_one_of(&k, {"dose", "dark"})) continue;
    if (gaussians == 1 && is_one_of(&k, {"sigma2_um", "weight2"})) continue;
    SpreadParameter p;
    p.name = k.name;
    p.unit = k.unit;
    p.value = found.*k.field;
    const auto at = std::find(problem.fitted.begin(), problem.fitted.end(), &k);
    if (at != problem.fitted.end()) {
      const auto i = static_cast<Eigen::Index>(at - problem.fitted.begin());
      p.fitted = true;
      p.standard_error = std::sqrt(variance * s.shape.unscaled(i, i));
      p.ci95 = {p.value - quantile * p.standard_error, p.value + quantile * p.standard_error};
    }
    fit.parameters.push_back(p);
  }
}

/// Refuses what is told so badly that it is worth nothing; notes on what is told badly.
void judge_parameters(SpreadFit& fit) {
  for (const SpreadParameter& p : fit.parameters) {
    if (!p.fitted) continue;
    const KnownSpread* const k = known_spread(p.name);
    const char* const advice = fit.of_widths ? k->of_widths : k->of_edges;
    const bool length = is_one_of(k, {"sigma_um", "sigma2_um", "weight2", "dose"});
    if (length && p.standard_error > p.value) {
      throw InputError(fit.source, "",
                       fmt::format("these {} can't tell {}: it would be {} with a standard error "
                                   "of {}; hold it with --fix, or measure\n  {}",
                                   fit.of_widths ? "widths" : "edges", p.name, figure(p.value),
                                   figure(p.standard_error), advice));
    }
    if (length && p.ci95[1] - p.ci95[0] > 0.4 * p.value) {
      fit.notes.push_back(fmt::format("{} is known to {:.0f} % only; measure {}.", p.name,
                                      50 * (p.ci95[1] - p.ci95[0]) / p.value, advice));
    }
    if (p.name != "scatter_um2_per_um") continue;
    const double least = 1e-6 * std::pow(fit.parameter("sigma_um").value, 2);
    if (p.ci95[1] < 0 && p.value < -least) {
      throw InputError(
          fit.source, "",
          fmt::format("light spreads less the further it has gone: the scatter would be {} um²/um "
                      "(95 %: {} to {}); expected depth_um from the window upwards, the same "
                      "exposure at all of them",
                      figure(p.value, p.standard_error), figure(p.ci95[0], p.standard_error),
                      figure(p.ci95[1], p.standard_error)));
    }
    if (p.ci95[0] <= 0) {
      fit.notes.push_back(fmt::format(
          "The scatter can't be told from 0 by these; measure at depths further apart."));
    }
  }
}

/// Whether two Gaussians do clearly better where one was fitted.
template <class Problem>
void compare_with_two(const Problem& problem, const Settled& s, SpreadFit& fit) {
  Problem two = problem;
  two.start = problem.at(s.values.data());
  const double freedom =
      static_cast<double>(problem.count()) - static_cast<double>(problem.unknowns()) - 2;
  if (freedom < 1 || !fits(problem, "sigma_um")) return;
  for (const char* name : {"sigma2_um", "weight2"}) two.fitted.push_back(known_spread(name));
  // What is left of rounding is nothing to improve.
  const double n = static_cast<double>(problem.count());
  const double rounding = 1e-7 * (fit.of_widths ? problem.scale_um() : 1);
  if (s.cost < n * rounding * rounding) return;
  std::vector<double> values;
  const double cost = solve(two, starts_of_two(two, two.start), values, false);
  if (!std::isfinite(cost)) return;
  const double f = (s.cost - cost) / 2 / std::max(cost / freedom, 1e-300);
  const double p = f_exceedance(f, 2, freedom);
  if (p > 1e-3) return;
  const SpreadState found = two.at(values.data());
  fit.notes.push_back(fmt::format(
      "Two Gaussians meet them clearly better (p = {:.1g}): {:.3g} um and {:.3g} um with {:.2g} of "
      "the light; try --gaussians 2.",
      p, found.sigma_um, found.sigma2_um, found.weight2));
}

SpreadFit fit_widths(const SpreadMeasurements& measured, const SpreadFitOptions& o) {
  SpreadFit fit;
  fit.source = measured.source;
  fit.of_widths = true;
  auto rows = rows_of(measured, o);
  check_widths(measured, rows, o);
  double deepest = 0, shallowest = std::numeric_limits<double>::infinity(), widest = 0,
         narrowest = shallowest;
  std::vector<double> designed;
  bool several = false;
  for (const auto& r : rows) {
    several = several || r.exposure.depth_um != rows[0].exposure.depth_um;
    deepest = std::max(deepest, r.exposure.depth_um);
    shallowest = std::min(shallowest, r.exposure.depth_um);
    widest = std::max(widest, r.designed_um);
    narrowest = std::min(narrowest, r.designed_um);
    designed.push_back(r.designed_um);
  }
  const double height = rows[0].exposure.height_e_um / rows[0].exposure.m;
  if (o.moving && o.resin) deepest = 40 * height;
  if (std::isinf(deepest)) deepest = 0;
  const double scale = median(designed);
  std::vector<WidthProblem::Row> counted = rows;
  std::erase_if(counted, [](const auto& r) { return r.printed_um == 0; });
  WidthProblem problem(counted, scale, deepest);
  problem.start = state_before(o);
  problem.fitted = fitted_of(o, true, several);
  if (counted.size() <= problem.fitted.size()) {
    throw InputError(measured.source, "",
                     fmt::format("has {} printed widths for {} parameters ({}); expected at least "
                                 "{}, better three times as many. Measure{}",
                                 counted.size(), problem.fitted.size(), names_of(problem.fitted),
                                 problem.fitted.size() + 1, advice_of(problem.fitted, true)));
  }
  // Of light that is left where it is brightest.
  double left = 1;
  if (height > 0) left = o.moving ? -std::expm1(-deepest / height) : std::exp(-shallowest / height);
  std::vector<double> sigmas, doses;
  for (double s = narrowest / 8; s < 1.5 * widest; s *= 1.6) sigmas.push_back(s);
  for (const double d : {1.15, 1.5, 2.0, 3.0, 5.0, 9.0, 18.0, 40.0, 100.0, 400.0})
    doses.push_back(d / left);
  const auto place = [&](const WidthProblem::Row& r) {
    return fmt::format("line {}", measured.widths[r.index].line);
  };
  const auto states = combined(problem, sigmas, doses);
  std::vector<WidthProblem::Row> left_out;
  if (!o.keep_outliers) left_out = take_gross(problem, states);
  if (5 * left_out.size() > counted.size() || problem.count() <= problem.fitted.size()) {
    fail_too_many(measured.source, place(left_out.front()));
  }
  const Settled s = settle(problem, &WidthProblem::rows, states, measured.source, true,
                           !o.keep_outliers, place, left_out);
  tell_parameters(problem, s, true, o.gaussians, fit);
  const SpreadState found = problem.at(s.values.data());
  double squares = 0;
  for (const auto& r : rows) {
    const PrintedWidth& w = measured.widths[r.index];
    const bool out = std::any_of(left_out.begin(), left_out.end(),
                                 [&](const auto& x) { return x.index == r.index; });
    const double width = printed_width_um(found, r.exposure, r.designed_um);
    fit.residuals.push_back({measured.source, w.line, r.exposure.depth_um, w.kind, r.designed_um, 0,
                             0, r.printed_um, width, out || r.printed_um == 0});
    if (!fit.residuals.back().left_out) squares += std::pow(r.printed_um - width, 2);
  }
  fit.rms = std::sqrt(squares / static_cast<double>(problem.count()));
  for (const auto& r : left_out) {
    const PrintedWidth& w = measured.widths[r.index];
    const double width = printed_width_um(found, r.exposure, r.designed_um);
    fit.notes.push_back(fmt::format(
        "Line {}, a {} of {:g} um, does not belong to the others and is left out: {:g} um were "
        "measured, {} um are found.",
        w.line, w.kind == WidthKind::gap ? "gap" : "line", w.designed_um, w.printed_um,
        width > 0 ? fmt::format("{:.1f}", width) : "0"));
  }
  for (const SpreadResidual& r : fit.residuals) {
    if (r.measured > 0 || r.found < std::max(3 * fit.rms, 0.1 * r.designed_um)) continue;
    fit.notes.push_back(
        fmt::format("Line {}, a {} of {:g} um, left nothing, though by the fit it "
                    "is {:.1f} um wide.",
                    r.line, r.kind == WidthKind::gap ? "gap" : "line", r.designed_um, r.found));
  }
  if (!several && deepest > 0 && !o.moving && !fits(problem, "scatter_um2_per_um") &&
      found.scatter == 0) {
    fit.notes.push_back(fmt::format(
        "All were measured {:g} um above the window: sigma_um is that of there.", deepest));
  }
  judge_parameters(fit);
  if (o.gaussians == 1) compare_with_two(problem, s, fit);
  Exposure even = rows[0].exposure;
  even.light = 1;
  if (!o.moving) even.depth_um = shallowest;
  fit.notes.push_back(fmt::format(
      "With this light lines narrower than {:.1f} um do not print, gaps narrower than {:.1f} um "
      "close.",
      narrowest_um(found, even, false), narrowest_um(found, even, true)));
  check_reach(fit, o);
  return fit;
}

SpreadFit fit_edges(const SpreadMeasurements& measured, const SpreadFitOptions& o) {
  SpreadFit fit;
  fit.source = measured.source;
  check_edges(measured);
  double deepest = 0, range = 0;
  bool several = false, pictures = false;
  for (const KnifeEdge& e : measured.edges) {
    deepest = std::max(deepest, e.depth_um);
    several = several || e.depth_um != measured.edges[0].depth_um;
    range = std::max(range, e.samples.back().at_um - e.samples.front().at_um);
    pictures = pictures || e.samples[0].line == 0;
    fit.notes.insert(fit.notes.end(), e.notes.begin(), e.notes.end());
  }
  EdgeProblem problem(measured.edges, range / 20, deepest);
  problem.start = state_before(o);
  problem.fitted = fitted_of(o, false, several);
  if (problem.count() <= problem.unknowns()) {
    throw InputError(
        measured.source, "",
        fmt::format(
            "has {} places for {} parameters and three of each edge ({}); expected at least "
            "{}, better three times as many. Measure{}",
            problem.count(), problem.fitted.size(), names_of(problem.fitted),
            problem.unknowns() + 1, advice_of(problem.fitted, false)));
  }
  const double guess = problem.sigma_guess_um();
  std::vector<EdgeProblem::Sample> left_out;
  const auto line_of = [&](const EdgeProblem::Sample& r) {
    return measured.edges[r.edge].samples[r.sample].line;
  };
  const auto place = [&](const EdgeProblem::Sample& r) {
    return fmt::format("line {}", line_of(r));
  };
  // Pictures have been looked through; what their means miss is how light spreads, not one place.
  const Settled s =
      settle(problem, &EdgeProblem::samples, combined(problem, {0.3 * guess, guess, 2 * guess}, {}),
             measured.source, false, !o.keep_outliers && !pictures, place, left_out);
  tell_parameters(problem, s, false, o.gaussians, fit);
  const SpreadState found = problem.at(s.values.data());
  double squares = 0;
  const auto tell = [&](const EdgeProblem::Sample& r, bool out) {
    const KnifeEdge& e = measured.edges[r.edge];
    const EdgeSample& sample = e.samples[r.sample];
    const auto at = problem.place_of(s.values.data(), r.edge);
    const double step = at.high - at.low;
    const double measured_share = (sample.intensity - at.low) / step;
    const double found_share = (problem.found(found, at, r) - at.low) / step;
    fit.residuals.push_back({e.source, sample.line, e.depth_um, WidthKind::line, 0, r.edge,
                             sample.at_um - at.at_um, measured_share, found_share, out});
    if (!out) squares += std::pow(measured_share - found_share, 2);
    if (out) {
      fit.notes.push_back(fmt::format(
          "Line {} does not belong to the others and is left out: it is {:.1f} % of the edge's "
          "step off.",
          sample.line, 100 * (measured_share - found_share)));
    }
  };
  for (const auto& r : problem.samples) tell(r, false);
  for (const auto& r : left_out) tell(r, true);
  std::stable_sort(fit.residuals.begin(), fit.residuals.end(),
                   [](const SpreadResidual& a, const SpreadResidual& b) {
                     return std::pair(a.edge, a.at_um) < std::pair(b.edge, b.at_um);
                   });
  fit.rms = std::sqrt(squares / static_cast<double>(problem.count()));
  constexpr double most_rms = 0.1;
  if (fit.rms > most_rms) {
    throw InputError(
        measured.source, "",
        fmt::format("is no edge whose light spreads by Gaussians: {:.0f} % of the step "
                    "are left in the mean square; expected one straight edge, dark on "
                    "one side and bright on the other",
                    100 * fit.rms));
  }
  if (!several && deepest > 0 && found.scatter == 0) {
    fit.notes.push_back(
        fmt::format("All edges were seen through {:g} um: sigma_um is that of there.", deepest));
  }
  judge_parameters(fit);
  if (o.gaussians == 1) compare_with_two(problem, s, fit);
  check_reach(fit, o);
  return fit;
}

}  // namespace

SpreadFit fit_spread(const SpreadMeasurements& measured, const SpreadFitOptions& options) {
  const bool of_widths = !measured.widths.empty();
  if (of_widths == !measured.edges.empty()) {
    throw InputError(
        measured.source, "",
        "expected either widths or edges, and some of them; fit one, then hold what it "
        "found with --fix for the other");
  }
  check_options(options, of_widths);
  const SpreadState start = state_before(options);
  if (!holds(start, 0) || start.scatter < 0) {
    throw InputError(
        "what is held makes no spread; expected sigma_um of 0 or more, sigma2_um above it, weight2 "
        "and dark of 0 to less than 1, dose above 0, scatter_um2_per_um of 0 or more");
  }
  SpreadFit fit = of_widths ? fit_widths(measured, options) : fit_edges(measured, options);
  if (const std::string words = repeats_of(measured); !words.empty())
    fit.notes.push_back(words + ".");
  return fit;
}

}  // namespace slicecorr::resins
