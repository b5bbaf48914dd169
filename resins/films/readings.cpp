// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of films that were measured.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "measure/number_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/resins/films_fit.hpp"

namespace slicecorr::resins {

namespace {

/// A form's squares are those of a display; another one's levels would be taken for this one's.
void check_form(const MeasuringForm& form, const Printer& printer) {
  const Grid plate = plate_grid(printer);
  const auto same = [&](const char* name, int here) {
    const double there = form.fact(name, 1, 1e6);
    if (there == here) return;
    throw InputError(form.source, name,
                     fmt::format("is {:g} in its first line, and {} of printer '{}'; expected the "
                                 "films of that printer",
                                 there, here, printer.name));
  };
  same("width_px", plate.width_px);
  same("height_px", plate.height_px);
  same("levels", printer.levels());
}

}  // namespace

FilmReadings read_films(const std::string& path, const Printer& printer) {
  expect_form_of(path, {"films"});
  if (const auto form = read_form(path)) check_form(*form, printer);
  const int top = printer.levels() - 1;
  const std::vector<NumberColumn> columns = {
      {.name = "level",
       .low = 0,
       .high = static_cast<double>(top),
       .required = true,
       .may_be_empty = false},
      {.name = "exposure_s",
       .low = kLeastFilmS,
       .high = kMostFilmS,
       .required = true,
       .may_be_empty = false},
      {.name = "thickness_um", .low = kLeastFilmUm, .high = kMostFilmUm, .required = true},
      {.name = "square", .low = 0, .high = 1e6}};
  FilmReadings all;
  all.source = path;
  read_number_table(
      path, columns, "level, exposure_s and thickness_um", "films",
      [&](int line, const std::string& place, const std::vector<double>& values) {
        if (values[0] != std::floor(values[0])) {
          throw InputError(path, place,
                           fmt::format("level is {:g}; expected a whole number from 0 "
                                       "to {}",
                                       values[0], top));
        }
        if (std::isnan(values[2])) {
          ++all.not_measured;
          return;
        }
        all.films.push_back({line, static_cast<int>(values[0]), values[1], values[2]});
      });
  const auto thickest = std::ranges::max_element(all.films, {}, &FilmReading::thickness_um);
  if (thickest != all.films.end() && thickest->thickness_um < kThinnestPeeledUm) {
    throw InputError(
        path, fmt::format("line {}", thickest->line),
        fmt::format("the thickest film is {:g} um thick, and none below {:g} um can be "
                    "peeled; expected thickness_um in um (0.12 mm are 120)",
                    thickest->thickness_um, kThinnestPeeledUm));
  }
  return all;
}

}  // namespace slicecorr::resins
