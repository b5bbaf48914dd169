// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file repeated_rows.hpp
/// Measurements that are there twice. Every row counts as a measurement of its own, whatever fit reads it: who measures
/// a thing again writes it again, and may well read the same. What is told is what looks like a copy. Pure and
/// thread-safe.
#pragma once

#include <string>
#include <vector>

namespace slicecorr::resins {

/// Rows that say again, digit for digit, what earlier ones said, as a sentence: a table that was pasted twice would count
/// as new measurements. Whole tables are known by each row's being there equally often, pieces by a run of rows that
/// stands there before; fewer than four rows, or a run of fewer than six, repeat by chance, of which "" is said.
/// `rows`: in their order; NaN: an empty cell.
std::string repeats_in_words(std::vector<std::vector<double>> rows);

/// Throws `InputError` naming the file that is among `paths` twice: the same rows again would make every interval too
/// narrow.
void check_given_once(const std::vector<std::string>& paths);

}  // namespace slicecorr::resins
