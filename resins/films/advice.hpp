// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whether films tell what is asked of them, and which ones would tell more.
#pragma once

#include "slicecorr/resins/films_fit.hpp"

namespace slicecorr::resins::detail {

/// Throws `InputError`, with what to measure, where nothing can be found of these.
void check_films(const FilmReadings& readings, const Printer& printer);

/// Adds what is to be known of a fit, and what to measure next.
void advise(const FilmReadings& readings, const Printer& printer, FilmsFit& fit);

}  // namespace slicecorr::resins::detail
