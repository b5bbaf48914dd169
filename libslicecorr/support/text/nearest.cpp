// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/text/nearest.hpp"

#include <algorithm>
#include <vector>

namespace slicecorr {
namespace {

std::string without_dashes(std::string_view word) {
  std::string letters(word);
  std::erase_if(letters, [](char c) { return c == '-' || c == '_'; });
  return letters;
}

}  // namespace

std::string nearest(std::string_view word, std::span<const std::string_view> known) {
  std::string best;
  std::size_t least = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string_view candidate : known) {
    // Levenshtein distance, a row at a time.
    std::vector<std::size_t> row(candidate.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
    for (std::size_t i = 0; i < word.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i + 1;
      for (std::size_t j = 0; j < candidate.size(); ++j) {
        const std::size_t swap = diagonal + (word[i] == candidate[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, swap});
      }
    }
    if (row.back() < least) {
      least = row.back();
      best = candidate;
    }
  }
  if (best.empty()) return best;
  // "mars4" is the beginning of "mars-4-max" rather than a slip of "mars".
  const std::string letters = without_dashes(word);
  for (const std::string_view candidate : known) {
    if (without_dashes(candidate).starts_with(letters)) return std::string(candidate);
  }
  return best;
}

}  // namespace slicecorr
