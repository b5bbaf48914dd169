/// Figures of predictions for people to read.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/predict.hpp"

namespace slicecorr::cli {

/// Whose dose in flowing resin a prediction tells: that of the light which the correction planned, or
/// of the light which images show.
enum class FlowLightOf { plan, images };
/// The human summary of a prediction.
std::string summary(const Prediction& after, const std::optional<Prediction>& before,
                    FlowLightOf flow = FlowLightOf::plan);
/// The same figures of several predictions side by side, each under its heading.
struct Figures {
  std::string heading;
  const Prediction* prediction;
};
std::string figures_table(const std::vector<Figures>& columns);

}  // namespace slicecorr::cli
