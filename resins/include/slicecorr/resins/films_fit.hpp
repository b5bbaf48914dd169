// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file films_fit.hpp
/// A printer's grey levels and a resin from films that were measured with calipers
/// (`slicecorr testpart films`), without a power meter.
///
/// A square of level g that was lit for t cures
///
///     Cd = ha log10(I(g) t / (I_1 t_c))
///
/// thick: ha is the absorbance height (base 10), t_c the time in which the brightest level gels a
/// surface, I(g) / I_1 the level's light in shares of the brightest one's. With s = log10(I(g) / I_1)
/// this is linear in ha, in -ha log10(t_c) and in ha s, so there is one least sum of squares; shares
/// never fall with the level.
///
/// Plain values; functions are thread-safe.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// A square that was measured.
struct FilmReading {
  int line = 0;             ///< of the file
  int level = 0;            ///< 0..the printer's greatest
  double exposure_s = 0;    ///< > 0
  double thickness_um = 0;  ///< > 0
};

struct FilmReadings {
  std::string source;
  std::vector<FilmReading> films;
  int not_measured = 0;  ///< rows without a thickness
};

/// Limits of what a table may say.
/// Thinner films tear when they are peeled.
inline constexpr double kThinnestPeeledUm = 30;
inline constexpr double kLeastFilmUm = 1, kMostFilmUm = 5000, kLeastFilmS = 1e-3, kMostFilmS = 1e5;

/// A table with the columns level, exposure_s and thickness_um, and `square` for people, in any order;
/// or the form of a part 'films', which must be of this printer's display and unchanged but for what is
/// filled in. Rows without a thickness count as not measured. Throws `InputError` naming file and line.
FilmReadings read_films(const std::string& path, const Printer& printer);

struct FilmFigure {
  double value = 0, standard_error = 0;  ///< of ha, um; of others of their natural logarithm
  std::array<double, 2> ci95{};          ///< NaN where no film is left to tell scatter
};

/// The light of a level.
struct FilmLevel {
  int level = 0;
  FilmFigure share;     ///< of the brightest level's light, 0..1; that level's is 1
  int films = 0;        ///< that count
  bool joined = false;  ///< with the level above: measured alone it would be brighter than that
};

/// Measured less found.
struct FilmResidual {
  FilmReading film;
  double found_um = 0;
  bool left_out = false;  ///< an outlier
};

struct FilmsFit {
  std::string source;
  FilmFigure absorbance_height_um;  ///< base 10
  FilmFigure gel_s;                 ///< at the brightest level
  /// Of the absorbance height and of the logarithm of `gel_s`; NaN where no film is left to tell scatter.
  double covariance_um = 0;
  std::vector<FilmLevel> light;  ///< rising; the last is the printer's brightest
  std::vector<FilmResidual> residuals;
  std::vector<std::string> warnings;      ///< sentences
  std::vector<std::string> measure_next;  ///< sentences
  int used = 0, freedom = 0;
  double rms_um = 0;

  std::string to_text() const;
  std::string to_json() const;
};

/// Films that can't belong to the others (p < 0.01 for the worst of all) are left out, up to a fifth.
/// Throws `InputError` where the films leave something open, with what to measure.
FilmsFit fit_films(const FilmReadings& readings, const Printer& printer);

/// The text of a printer file with the light that was found, the rest of it as it stands, under a new
/// name. `full_mw_cm2`: of the brightest level, where somebody measured it; 0: light stays in units of
/// that level. Where no grey level was measured the display becomes one of black and white.
std::string printer_with_films(const std::string& text, const std::string& source,
                               const std::string& name, const FilmsFit& fit, double full_mw_cm2);
/// The text of a resin file of this light, for that printer.
std::string resin_of_films(const std::string& name, const Printer& printer, const FilmsFit& fit,
                           double full_mw_cm2);

}  // namespace slicecorr::resins
