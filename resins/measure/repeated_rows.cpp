// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/repeated_rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

std::string repeats_in_words(std::vector<std::vector<double>> rows) {
  constexpr std::size_t least_rows = 4, least_run = 6, most_places = 4;
  std::map<std::vector<double>, std::vector<std::size_t>> places;
  std::vector<const std::vector<std::size_t>*> same;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (double& cell : rows[i]) {
      if (std::isnan(cell)) cell = -std::numeric_limits<double>::infinity();
    }
    auto& of_row = places[rows[i]];
    of_row.push_back(i);
    same.push_back(&of_row);
  }
  const std::size_t n = same.size(), often = n > 0 ? same.front()->size() : 0;
  const bool whole = often > 1 && places.size() >= least_rows && places.size() * often == n &&
                     std::ranges::all_of(
                         places, [&](const auto& of_row) { return of_row.second.size() == often; });
  std::size_t repeated = whole ? n - places.size() : 0;
  for (std::size_t at = 0; at < n && !whole;) {
    std::size_t longest = 0;
    const auto& earlier = *same[at];
    for (std::size_t k = 0; k < std::min(earlier.size(), most_places) && earlier[k] < at; ++k) {
      const std::size_t from = earlier[k];
      std::size_t run = 0;
      while (at + run < n && from + run < at && same[from + run] == same[at + run]) ++run;
      longest = std::max(longest, run);
    }
    if (longest >= least_run) repeated += longest;
    at += longest >= least_run ? longest : 1;
  }
  if (repeated == 0) return {};
  return fmt::format(
      "{} of {} measurements repeat earlier ones digit for digit: was a table pasted or given twice? "
      "Then leave the copies out: they make intervals {:.2g} times too narrow",
      repeated, n, std::sqrt(static_cast<double>(n) / static_cast<double>(n - repeated)));
}

void check_given_once(const std::vector<std::string>& paths) {
  for (std::size_t i = 0; i < paths.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      std::error_code error;
      if (paths[i] == paths[k] || std::filesystem::equivalent(paths[i], paths[k], error)) {
        throw InputError(paths[i], "", "is given twice; expected each file once");
      }
    }
  }
}

}  // namespace slicecorr::resins
