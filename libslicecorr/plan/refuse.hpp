// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Why nothing prints a part as asked, and what would.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "plan/trial.hpp"

namespace slicecorr::detail {

/// A bound that is none of the light's.
struct Bound {
  double most_mm_h = std::numeric_limits<double>::infinity();
  std::string word, words;
  void take(double mm_h, const std::string& its_word, const std::string& its_words) {
    if (!(mm_h < most_mm_h)) return;
    most_mm_h = mm_h;
    word = its_word;
    words = its_words;
  }
};

/// Throws `InfeasibleError` saying why no speed keeps what is asked for, and what is nearest.
[[noreturn]] void refuse_plan(const PlanAsk& ask, const std::optional<PlanLight>& light,
                              const std::vector<PlanGap>& gaps, const Trials& trials,
                              const std::vector<PlanPoint>& tried, const Bound& bound);

}  // namespace slicecorr::detail
