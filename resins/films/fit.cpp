// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Absorbance height, seconds to gel and the light of levels, from films.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "films/advice.hpp"
#include "fit/least_squares.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/films_fit.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
/// Sets of steps that are tried: there are a few for each level.
constexpr int kMostSets = 2000;

/// Thickness is linear in its unknowns: ha, -ha log10(t_c), and for each level but the brightest the
/// thickness by which a film of it is thinner than one of the level above, which is at least 0.
class FilmProblem final : public LeastSquares {
 public:
  /// `levels`: those that were measured, falling; the first is the brightest.
  FilmProblem(std::vector<FilmReading> films, std::vector<int> levels)
      : films_(std::move(films)), levels_(std::move(levels)) {
    for (std::size_t k = 1; k < levels_.size(); ++k) free_.push_back(k);
  }
  std::size_t count() const override { return films_.size(); }
  std::size_t unknowns() const override { return 2 + free_.size(); }
  double step(std::size_t, double value) const override { return 1e-3 * std::max(1.0, value); }
  bool residuals(const double* values, double* out) const override {
    for (const FilmReading& film : films_) *out++ = film.thickness_um - found(values, film);
    return true;
  }
  bool jacobian(const double*, Eigen::MatrixXd& out) const override {
    out.resize(static_cast<Eigen::Index>(count()), static_cast<Eigen::Index>(unknowns()));
    for (std::size_t i = 0; i < films_.size(); ++i) {
      for (std::size_t k = 0; k < unknowns(); ++k) {
        out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = -slope(films_[i], k);
      }
    }
    return true;
  }
  double found(const double* values, const FilmReading& film) const {
    double um = 0;
    for (std::size_t k = 0; k < unknowns(); ++k) um += values[k] * slope(film, k);
    return um;
  }
  /// What a film's thickness is to an unknown.
  double slope(const FilmReading& film, std::size_t unknown) const {
    if (unknown == 0) return std::log10(film.exposure_s);
    if (unknown == 1) return 1;
    return film.level <= levels_[free_[unknown - 2]] ? -1 : 0;
  }
  /// Whether all levels are as bright as the one above or darker, and none that is taken to be as bright
  /// had better be darker; else changes the step that is furthest from that.
  bool join_or_part(const std::vector<double>& values) {
    std::size_t worst = free_.size();
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const double least = worst < free_.size() ? values[2 + worst] : 0;
      if (values[2 + i] < least) worst = i;
    }
    if (worst < free_.size()) {
      free_.erase(free_.begin() + static_cast<std::ptrdiff_t>(worst));
      return false;
    }
    double most = kLeastGainUm;
    std::size_t best = 0;
    for (std::size_t k = 1; k < levels_.size(); ++k) {
      if (std::find(free_.begin(), free_.end(), k) != free_.end()) continue;
      // By how much these films are thinner than what is found of them, in all.
      double thinner_um = 0;
      for (const FilmReading& film : films_) {
        if (film.level <= levels_[k]) thinner_um += found(values.data(), film) - film.thickness_um;
      }
      if (thinner_um <= most) continue;
      most = thinner_um;
      best = k;
    }
    if (best == 0) return true;
    free_.insert(std::lower_bound(free_.begin(), free_.end(), best), best);
    return false;
  }
  const std::vector<int>& levels() const { return levels_; }
  /// The levels, by their place among `levels`, that have a step of their own.
  const std::vector<std::size_t>& steps() const { return free_; }
  const std::vector<FilmReading>& films() const { return films_; }

 private:
  /// Below what rounding leaves, far below what can be measured.
  static constexpr double kLeastGainUm = 1e-6;
  std::vector<FilmReading> films_;
  std::vector<int> levels_;
  std::vector<std::size_t> free_;
};

std::vector<int> levels_of(const std::vector<FilmReading>& films) {
  std::set<int, std::greater<>> all;
  for (const FilmReading& film : films) all.insert(film.level);
  return {all.begin(), all.end()};
}

struct Solved {
  FilmProblem problem;
  std::vector<double> values;
  FitShape shape;
};

Solved solve(const std::vector<FilmReading>& films, const std::string& source) {
  Solved s{FilmProblem(films, levels_of(films)), {}, {}};
  bool found = false;
  // Until nothing is to be changed: then it is the least that there is.
  for (int tries = 0; tries < kMostSets; ++tries) {
    s.values.assign(s.problem.unknowns(), 1.0);
    s.values[0] = 100;
    found = std::isfinite(minimise(s.problem, s.values, kFine, 200));
    if (!found || s.problem.join_or_part(s.values)) break;
    found = false;
  }
  if (found) s.shape = shape_of(s.problem, s.values);
  if (!found || !s.shape.holds || s.shape.unscaled.size() == 0) {
    throw InputError(source, "", "leaves something open; expected films of more times");
  }
  return s;
}

/// A figure f of the unknowns with its interval: f ± t s, or, of a logarithm, e^f within that.
FilmFigure figure_of(const Solved& s, double value, const Eigen::VectorXd& slope, bool logarithm) {
  const auto n = static_cast<double>(s.problem.count()),
             freedom = n - static_cast<double>(s.problem.unknowns());
  FilmFigure f{logarithm ? std::exp(value) : value, kNone, {kNone, kNone}};
  if (freedom < 1) return f;
  const double variance = s.shape.residual.squaredNorm() / freedom;
  f.standard_error = std::sqrt(std::max(0.0, variance * slope.dot(s.shape.unscaled * slope)));
  const double by = student_t_quantile(0.975, freedom) * f.standard_error;
  f.ci95 = logarithm ? std::array{std::exp(value - by), std::exp(value + by)}
                     : std::array{value - by, value + by};
  return f;
}

void take_figures(const Solved& s, FilmsFit& fit) {
  const double ha = s.values[0], b = s.values[1];
  const auto count = static_cast<Eigen::Index>(s.problem.unknowns());
  Eigen::VectorXd slope = Eigen::VectorXd::Zero(count);
  slope(0) = 1;
  fit.absorbance_height_um = figure_of(s, ha, slope, false);
  // ln t_c = -ln 10 b / ha.
  slope(0) = units::kLn10 * b / (ha * ha);
  slope(1) = -units::kLn10 / ha;
  fit.gel_s = figure_of(s, -units::kLn10 * b / ha, slope, true);
  fit.covariance_um =
      s.shape.unscaled.row(0).dot(slope) * s.shape.residual.squaredNorm() /
      (static_cast<double>(s.problem.count()) - static_cast<double>(s.problem.unknowns()));
  std::map<int, int> films;
  for (const FilmReading& film : s.problem.films()) ++films[film.level];
  // ln share = -ln 10 (sum of steps) / ha.
  const auto& levels = s.problem.levels();
  double down = 0;
  slope.setZero();
  for (std::size_t k = 0, step = 0; k < levels.size(); ++k) {
    FilmLevel level;
    level.level = levels[k];
    level.films = films[levels[k]];
    const bool own = step < s.problem.steps().size() && s.problem.steps()[step] == k;
    level.joined = k > 0 && !own;
    if (own) {
      const auto at = static_cast<Eigen::Index>(2 + step++);
      down += s.values[static_cast<std::size_t>(at)];
      slope(at) = -units::kLn10 / ha;
    }
    slope(0) = units::kLn10 * down / (ha * ha);
    level.share = figure_of(s, -units::kLn10 * down / ha, slope, true);
    // As bright as the brightest one, and no brighter.
    if (down == 0) level.share = {1, 0, {1, 1}};
    level.share.ci95[1] = std::min(level.share.ci95[1], 1.0);
    fit.light.push_back(level);
  }
  std::reverse(fit.light.begin(), fit.light.end());
}

}  // namespace

FilmsFit fit_films(const FilmReadings& readings, const Printer& printer) {
  detail::check_films(readings, printer);
  FilmsFit fit;
  fit.source = readings.source;
  std::vector<FilmReading> films = readings.films;
  std::vector<FilmReading> left_out;
  Solved s = solve(films, readings.source);
  for (;;) {
    // Calipers show 10 um: what is half of that away belongs.
    constexpr double rounding_um = 5;
    const auto which = outlier_of(s.shape, s.problem.unknowns(), rounding_um);
    if (!which) break;
    // All others are counted against the brightest level.
    const int top = printer.levels() - 1;
    const auto of_top = std::count_if(films.begin(), films.end(),
                                      [&](const FilmReading& f) { return f.level == top; });
    if (films[*which].level == top && of_top == 1) break;
    if (5 * (left_out.size() + 1) > readings.films.size()) {
      throw InputError(
          readings.source, fmt::format("line {}", films[*which].line),
          fmt::format(
              "does not go with the others, and more than a fifth of the films do not: "
              "expected {:.4g} um there; measure again, or look whether squares were mixed up",
              s.problem.found(s.values.data(), films[*which])));
    }
    left_out.push_back(films[*which]);
    films.erase(films.begin() + static_cast<std::ptrdiff_t>(*which));
    s = solve(films, readings.source);
  }
  take_figures(s, fit);
  if (!(fit.absorbance_height_um.value > 0 && fit.gel_s.value > 1e-6)) {
    throw InputError(readings.source, "",
                     "has films that do not grow with their exposure; expected thicker ones for "
                     "longer times: look whether times and thicknesses were mixed up");
  }
  fit.used = static_cast<int>(films.size());
  fit.freedom = fit.used - static_cast<int>(s.problem.unknowns());
  fit.rms_um = std::sqrt(s.shape.residual.squaredNorm() / static_cast<double>(films.size()));
  for (const FilmReading& film : readings.films) {
    const bool out = std::any_of(left_out.begin(), left_out.end(),
                                 [&](const FilmReading& o) { return o.line == film.line; });
    fit.residuals.push_back({film, s.problem.found(s.values.data(), film), out});
  }
  detail::advise(readings, printer, fit);
  return fit;
}

}  // namespace slicecorr::resins
