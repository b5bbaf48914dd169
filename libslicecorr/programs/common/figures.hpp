// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Figures of predictions for people to read.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/predict.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::cli {

/// The human summary of a prediction.
std::string summary(const Prediction& after, const std::optional<Prediction>& before);
/// That a verdict holds only where nothing lifts, as a line behind the summary; mostly empty.
std::string lifts_line(const std::string& format, const Process& process);
/// All figures as JSON: those of `Prediction::to_json`, and what slices light where that is known.
std::string figures_json(const Prediction& p);
/// The same figures of several predictions side by side, each under its heading.
struct Figures {
  std::string heading;
  const Prediction* prediction;
};
std::string figures_table(const std::vector<Figures>& columns);

}  // namespace slicecorr::cli
