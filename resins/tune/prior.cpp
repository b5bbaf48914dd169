// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is known of resin and light before they are measured.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/uncertainty.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"
#include "support/toml/toml_table.hpp"
#include "tune/files.hpp"
#include "tune/matrix.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kSd = 0.1, kLightSd = 0.03, kStraySd = 0.3, kStraySdOfFull = 0.01,
                 kExchangeSd = 0.3;

/// In words: "stray light 0.3 mW/cm²".
std::string stray_known(LightUnit unit) {
  return unit == LightUnit::mw_cm2
             ? fmt::format("stray light {:g} mW/cm²", kStraySd)
             : fmt::format("stray light {:g} of the brightest level's", kStraySdOfFull);
}

/// Takes "[[1, 2, 3], [4, 5, 6], [7, 8, 9]]" as the covariance of the first `size` unknowns.
void take_matrix(const std::string& text, const std::string& source, std::size_t size,
                 TuneMatrix& m) {
  std::size_t at = 0, count = 0;
  while (count < size * size) {
    at = text.find_first_of("-0123456789.", at);
    if (at == std::string::npos) break;
    const std::size_t end = std::min(text.find_first_of(",] ", at), text.size());
    const auto value = number_in_text(text.substr(at, end - at));
    if (!value) break;
    m[count / size][count % size] = *value;
    ++count;
    at = end;
  }
  if (count == size * size && at != std::string::npos &&
      text.find_first_of("-0123456789.", at) == std::string::npos) {
    return;
  }
  throw InputError(
      source, "provenance.tuning",
      fmt::format("is '{}'; expected {} x {} numbers, the covariance that slicecorr tune "
                  "writes",
                  text::printable(text), size, size));
}

}  // namespace

TunePrior default_prior(LightUnit unit) {
  const double stray = unit == LightUnit::mw_cm2 ? kStraySd : kStraySdOfFull;
  return {{{{kSd * kSd, 0, 0, 0},
            {0, kSd * kSd, 0, 0},
            {0, 0, stray * stray, 0},
            {0, 0, 0, kExchangeSd * kExchangeSd}}},
          fmt::format("ha 10 %, light over dose 10 %, {} (nothing better is known)",
                      stray_known(unit))};
}

TunePrior foreign_prior(double height_sd, double light_sd) {
  TunePrior prior = default_prior();
  prior.covariance[0][0] = height_sd * height_sd;
  prior.covariance[1][1] = light_sd * light_sd;
  prior.text = fmt::format(
      "ha to a factor of {:.2g}, light over dose to one of {:.2g} (95 %): the resin was measured elsewhere; "
      "stray light 0.3 mW/cm²",
      std::exp(1.96 * height_sd), std::exp(1.96 * light_sd));
  return prior;
}

TunePrior prior_of(const std::string& resin_text, const std::string& resin_source,
                   const Printer& printer) {
  const toml::table root = parse_toml(resin_text, resin_source);
  const auto provenance = TomlTable(root, resin_source).table("provenance");
  TunePrior prior = default_prior(printer.unit);
  if (!provenance) return prior;
  if (provenance->has("tuning")) {
    const std::string text = provenance->text("tuning", "");
    for (const bool exchange : {false, true}) {
      const std::string with = tuned_with(printer, exchange);
      if (!text.starts_with(with)) continue;
      take_matrix(text.substr(with.size()), resin_source, exchange ? kTuned : kExchange,
                  prior.covariance);
      prior.text = "what was found by the tuning before, in the resin's file";
      try {
        check_prior(prior);
      } catch (const InputError& e) {
        throw InputError(resin_source, "provenance.tuning", e.what());
      }
      return prior;
    }
  }
  if (!provenance->has("covariance") || provenance->text("covariance", "") == "unknown") {
    return prior;
  }
  const Uncertainty u =
      parse_uncertainty("fit", ExposureMode::continuous, 1, {resin_text, resin_source});
  using enum UncertainInput;
  if (u.sd(ha) == 0 || u.sd(dc) == 0) return prior;
  prior.covariance[0][0] = u.variance(ha, ha);
  prior.covariance[1][1] = u.variance(dc, dc) + kLightSd * kLightSd;
  prior.covariance[0][1] = prior.covariance[1][0] = -u.variance(ha, dc);
  prior.text = "the covariance in the resin's file, light 3 %, " + stray_known(printer.unit);
  if (provenance->has("tuning")) {
    prior.text += " (it was tuned with another printer or calibration)";
  }
  check_prior(prior);
  return prior;
}

void check_prior(const TunePrior& prior) {
  const TuneMatrix& s = prior.covariance;
  for (std::size_t i = 0; i < kTuned; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      const bool pair = i != j;
      const double limit = std::sqrt(std::max(0.0, s[i][i] * s[j][j]));
      const bool sound = std::isfinite(s[i][j]) && (pair ? std::abs(s[i][j]) < limit : s[i][i] > 0);
      if (sound && std::abs(s[i][j] - s[j][i]) <= 1e-12 * limit) continue;
      throw InputError(fmt::format(
          "the covariance of {} and {} is {:g}, and {:g} the other way; expected a symmetric one of "
          "errors that are above 0 and don't follow from each other",
          kTunedNames[i], kTunedNames[j], s[i][j], s[j][i]));
    }
  }
  const Eigen::SelfAdjointEigenSolver<TunedMatrix> solver(matrix_of(s));
  if (!(solver.eigenvalues()[0] > 0)) {
    throw InputError(fmt::format(
        "the covariance of ha, light, stray and exchange has the eigenvalue {:g}; expected all "
        "above 0",
        solver.eigenvalues()[0]));
  }
}

}  // namespace slicecorr::resins
