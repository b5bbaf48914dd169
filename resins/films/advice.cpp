// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "films/advice.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/repeated_rows.hpp"

namespace slicecorr::resins::detail {

namespace {

/// Films of times that lie closer together tell little of how thickness grows with time.
constexpr double kTimesApart = 4;
/// Between two levels a printer's light is taken for straight; of a power g it is off by
/// g (g - 1) / 8 ln(b/a)² of the light, here 7 % for g = 3.
constexpr double kLevelsApart = 1.35;
/// Light that is known less well than this moves an edge by more than the calipers can tell.
constexpr double kWideUm = 15;
/// Calipers tell a film to this.
constexpr double kCalipersUm = 10;

std::map<int, std::set<double>> times_of(const FilmReadings& readings) {
  std::map<int, std::set<double>> times;
  for (const FilmReading& film : readings.films) times[film.level].insert(film.exposure_s);
  return times;
}

std::string list_of(const std::vector<int>& levels) {
  std::string text;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    text += fmt::format("{}{}", i == 0 ? "" : i + 1 < levels.size() ? ", " : " and ", levels[i]);
  }
  return text;
}

const char* levels_word(const std::vector<int>& levels) {
  return levels.size() == 1 ? "level" : "levels";
}

}  // namespace

void check_films(const FilmReadings& readings, const Printer& printer) {
  const int top = printer.levels() - 1;
  const auto times = times_of(readings);
  if (readings.films.size() < 2) {
    throw InputError(
        readings.source,
        readings.films.empty() ? "" : fmt::format("line {}", readings.films[0].line),
        fmt::format(
            "{} of {}; expected two or more, of the brightest level and of times that differ",
            readings.films.empty() ? "no thickness was measured" : "is the only film measured",
            readings.films.size() + static_cast<std::size_t>(readings.not_measured)));
  }
  const auto at_top = times.find(top);
  if (at_top == times.end()) {
    throw InputError(
        readings.source, "level",
        fmt::format("no film is of the brightest level, {}, against which all others are counted; "
                    "measure squares of that level",
                    top));
  }
  if (std::none_of(times.begin(), times.end(), [](const auto& t) { return t.second.size() > 1; })) {
    const double s = *at_top->second.begin();
    throw InputError(
        readings.source, "exposure_s",
        fmt::format(
            "no level has films of two times, the brightest one of {:g} s alone: how thickness "
            "grows with the exposure, the absorbance height, can't be told; measure squares "
            "of level {} at two times or more, {:g} s and {:g} s, say",
            s, top, s / kTimesApart, s));
  }
}

void advise(const FilmReadings& readings, const Printer& printer, FilmsFit& fit) {
  const auto next = [&](std::string text) { fit.measure_next.push_back(std::move(text)); };
  const auto warn = [&](std::string text) { fit.warnings.push_back(std::move(text)); };
  for (const FilmResidual& r : fit.residuals) {
    if (!r.left_out) continue;
    warn(fmt::format(
        "line {}: level {}, {:g} s: {:g} um can't belong to the others, which say {:.4g} "
        "um: left out",
        r.film.line, r.film.level, r.film.exposure_s, r.film.thickness_um, r.found_um));
  }
  std::vector<std::vector<double>> rows;
  for (const FilmReading& film : readings.films) {
    rows.push_back({static_cast<double>(film.level), film.exposure_s, film.thickness_um});
  }
  if (std::string words = repeats_in_words(std::move(rows)); !words.empty()) warn(std::move(words));
  if (readings.not_measured > 0) {
    warn(fmt::format("{} {} not measured", readings.not_measured,
                     readings.not_measured == 1 ? "square was" : "squares were"));
  }
  for (const FilmLevel& l : fit.light) {
    if (!l.joined) continue;
    warn(fmt::format(
        "level {} came out no darker than the next brighter one: both get the same light",
        l.level));
  }
  if (fit.rms_um > kCalipersUm) {
    const auto off_um = [](const FilmResidual& r) {
      return r.left_out ? 0 : std::abs(r.film.thickness_um - r.found_um);
    };
    const FilmResidual& worst = *std::ranges::max_element(fit.residuals, {}, off_um);
    warn(fmt::format(
        "films lie {:.3g} um from what was found, more than calipers are off: some contradict each other, "
        "most of all line {} (level {}, {:g} s: {:g} um, found {:.4g}). Look whether squares were mixed up, "
        "and measure these again before anything is printed with it",
        fit.rms_um, worst.film.line, worst.film.level, worst.film.exposure_s,
        worst.film.thickness_um, worst.found_um));
  }
  double shortest = kMostFilmS, longest = 0;
  for (const FilmResidual& r : fit.residuals) {
    if (r.left_out || r.film.level != printer.levels() - 1) continue;
    shortest = std::min(shortest, r.film.exposure_s);
    longest = std::max(longest, r.film.exposure_s);
  }
  if (longest < kTimesApart * shortest) {
    next(longest > shortest
             ? fmt::format(
                   "the brightest level at times that differ by a factor of {:g} or more: they "
                   "go from {:g} to {:g} s",
                   kTimesApart, shortest, longest)
             : fmt::format(
                   "the brightest level at a second time, {:g} s, say: it has {:g} s alone, and "
                   "the absorbance height is that of the grey levels",
                   longest / kTimesApart, longest));
  }
  if (fit.freedom < 1) {
    next(
        "any squares again: with as many films as unknowns nothing tells how sure the figures are");
  }
  std::vector<int> alone, unsure;
  const int top = printer.levels() - 1;
  for (const FilmLevel& l : fit.light) {
    if (l.level < top && l.films < 2) alone.push_back(l.level);
    const double wide_um =
        fit.absorbance_height_um.value * std::log10(l.share.value / l.share.ci95[0]);
    if (l.level < top && wide_um > kWideUm) unsure.push_back(l.level);
  }
  if (!alone.empty()) {
    next(
        fmt::format("{} {} at a second time, or again: one film alone has nothing that it could "
                    "contradict",
                    levels_word(alone), list_of(alone)));
  }
  if (!unsure.empty()) {
    next(fmt::format("{} {} again: the light is not known well enough to place an edge to {:g} um",
                     levels_word(unsure), list_of(unsure), kWideUm));
  }
  if (fit.light.size() < 2) {
    next(
        "grey levels: of the brightest level alone nothing is known of the others, and a printer file "
        "can say black and white (bit_depth = 1) alone");
    return;
  }
  std::vector<int> between;
  for (std::size_t i = 1; i < fit.light.size(); ++i) {
    const int low = fit.light[i - 1].level, high = fit.light[i].level;
    if (low > 0 && high > kLevelsApart * low && high - low > 2) between.push_back((low + high) / 2);
  }
  if (!between.empty()) {
    next(fmt::format(
        "{} {}: between levels that were measured light is taken for straight, and they "
        "lie far apart",
        levels_word(between), list_of(between)));
  }
  if (const FilmLevel& darkest = fit.light.front(); darkest.level > 0) {
    warn(
        fmt::format("below level {} light is taken to fall straight to none at black: neither was "
                    "measured, and films of darker levels need longer times",
                    darkest.level));
  }
  if (!printer.flat_field) return;
  warn(
      "the printer's flat-field was not counted: squares lie where its light is near that of the middle");
}

}  // namespace slicecorr::resins::detail
