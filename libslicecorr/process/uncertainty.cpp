// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/uncertainty.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/units.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

namespace {

constexpr std::array<std::string_view, 9> kWords = {"ha",    "dc",    "m",    "aim",     "light",
                                                    "stray", "speed", "time", "exchange"};
constexpr std::array<std::string_view, 12> kAllWords = {
    "fit", "ha", "dc", "m", "aim", "light", "stray", "speed", "time", "flat", "noise", "exchange"};

bool relative(UncertainInput input) {
  using enum UncertainInput;
  return input != m && input != stray && input != exchange;
}

/// The greatest standard deviation of an input: a share, or in its own unit.
double most_sd(UncertainInput input) {
  return input == UncertainInput::stray ? kMostStraySd : kMostRelativeSd;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

/// Calls `take` with each part of `text` between commas.
template <typename Take>
void for_parts(std::string_view text, Take take) {
  while (true) {
    const std::size_t comma = text.find(',');
    take(trimmed(text.substr(0, comma)));
    if (comma == std::string_view::npos) return;
    text.remove_prefix(comma + 1);
  }
}

[[noreturn]] void fail(const std::string& message) {
  throw InputError("uncertain inputs", "", message);
}

/// What `resinctl fit` wrote of a covariance: "h_um, dc_mj_cm2: [[4.1, 0.2], [0.2, 0.03]]".
struct WrittenCovariance {
  std::vector<std::string> names;
  std::vector<double> matrix;
};

WrittenCovariance read_covariance(const TomlTable& provenance) {
  const char* const key = "covariance";
  const std::string text = provenance.text(key, "");
  const auto wrong = [&](const std::string& what) {
    provenance.fail(key,
                    fmt::format("{}; expected names, a colon and the rows of a square matrix, as "
                                "resinctl fit writes them",
                                what));
  };
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos) {
    wrong(fmt::format("is '{}', which is no covariance", text::printable(text)));
  }
  WrittenCovariance read;
  for_parts(std::string_view(text).substr(0, colon),
            [&](std::string_view name) { read.names.emplace_back(name); });
  std::string numbers = text.substr(colon + 1);
  // Rows are told by their number of columns alone, which the names say.
  for (char& c : numbers) {
    if (c == '[' || c == ']') c = ' ';
  }
  for_parts(numbers, [&](std::string_view cell) {
    const auto value = number_in_text(cell);
    if (!value || !std::isfinite(*value)) wrong("has something that is no number");
    read.matrix.push_back(*value);
  });
  if (read.matrix.size() != read.names.size() * read.names.size()) {
    wrong(fmt::format("has {} names and {} numbers", read.names.size(), read.matrix.size()));
  }
  return read;
}

/// Takes ha, dc and m from the covariance in a resin's file.
void take_fit(const ResinText& resin, Uncertainty& out) {
  const char* const without =
      "expected a resin that resinctl fit wrote, or its errors by hand: "
      "ha=8%,dc=10%";
  if (resin.text.empty()) {
    fail(fmt::format("fit asks for the covariance in the resin's file, which is not given here; {}",
                     without));
  }
  const toml::table root_table = parse_toml(resin.text, resin.source);
  const TomlTable root(root_table, resin.source);
  const auto provenance = root.table("provenance");
  if (!provenance || !provenance->has("covariance") ||
      provenance->text("covariance", "") == "unknown") {
    throw InputError(
        resin.source, "provenance.covariance",
        fmt::format("missing, which errors from the fit need: the resin was not fitted to "
                    "measurements here; {}",
                    without));
  }
  const WrittenCovariance fit = read_covariance(*provenance);
  const Resin parsed = parse_resin(resin.text, resin.source);
  const TomlTable cure = root.required_table("cure");
  // Values of the fit itself: what it measured is the dose that gels, areal, and the height, base e.
  const double height_um = units::height_e_from_10(parsed.absorbance_height10_um);
  const auto known =
      [&](const std::string& name) -> std::optional<std::pair<UncertainInput, double>> {
    if (name == "h_um") return std::pair{UncertainInput::ha, height_um};
    if (name == "m") return std::pair{UncertainInput::m, 1.0};
    if (name == "dc_mj_cm2" && parsed.gel_dose_mj_cm3 > 0) {
      return std::pair{UncertainInput::dc, units::areal_from_volumetric(parsed.gel_dose_mj_cm3,
                                                                        dose_height_e_um(parsed))};
    }
    if (name == "critical_dose_s" && is_relative(parsed)) {
      return std::pair{UncertainInput::dc, critical_dose_s(parsed)};
    }
    if (const auto prime = cure.number("critical_dose_prime", 0, 1e9);
        name == "critical_dose_prime" && prime) {
      return std::pair{UncertainInput::dc, *prime};
    }
    return std::nullopt;
  };
  std::vector<std::size_t> rows;
  std::vector<double> scale;
  for (std::size_t i = 0; i < fit.names.size(); ++i) {
    const auto input = known(fit.names[i]);
    if (!input) continue;  // of dead zones
    out.inputs.push_back(input->first);
    scale.push_back(input->second);
    rows.push_back(i);
  }
  if (rows.empty()) {
    provenance->fail("covariance", "has neither h_um nor a gel dose that the file gives, too");
  }
  const std::size_t width = fit.names.size();
  for (std::size_t a = 0; a < rows.size(); ++a) {
    for (std::size_t b = 0; b < rows.size(); ++b) {
      out.covariance.push_back(fit.matrix[rows[a] * width + rows[b]] / (scale[a] * scale[b]));
    }
  }
  out.from_fit = true;
}

/// Adds an input that is off by itself.
void add_alone(Uncertainty& u, UncertainInput input, double sd) {
  const std::size_t n = u.inputs.size();
  std::vector<double> wider((n + 1) * (n + 1), 0.0);
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = 0; b < n; ++b) wider[a * (n + 1) + b] = u.covariance[a * n + b];
  }
  wider.back() = sd * sd;
  u.inputs.push_back(input);
  u.covariance = std::move(wider);
}

std::string percent(double share) { return fmt::format("{:.4g} %", 100 * share); }

/// A standard deviation; `most`: bound of the number as it is written.
double number_of(std::string_view word, std::string_view value, bool is_relative, double most) {
  const bool has_sign = !value.empty() && value.back() == '%';
  const std::string shown = text::printable(std::string(value));
  if (is_relative != has_sign) {
    fail(fmt::format("{} is '{}'; expected {}", word, shown,
                     is_relative ? "a standard deviation in %, as 8%"
                                 : "a standard deviation without %: it is not relative"));
  }
  const auto number = number_in_text(trimmed(has_sign ? value.substr(0, value.size() - 1) : value));
  if (!number || !(*number > 0) || *number > most) {
    fail(fmt::format("{} is '{}'; expected a number above 0 and at most {:g}{}", word, shown, most,
                     is_relative ? " %" : ""));
  }
  return is_relative ? *number / 100 : *number;
}

}  // namespace

const char* word_of(UncertainInput input) { return kWords[static_cast<std::size_t>(input)].data(); }

double Uncertainty::variance(UncertainInput a, UncertainInput b) const {
  const auto place = [&](UncertainInput x) {
    return static_cast<std::size_t>(std::find(inputs.begin(), inputs.end(), x) - inputs.begin());
  };
  const std::size_t i = place(a), j = place(b), n = inputs.size();
  return i < n && j < n ? covariance[i * n + j] : 0.0;
}

double Uncertainty::sd(UncertainInput input) const { return std::sqrt(variance(input, input)); }

void check_uncertainty(const Uncertainty& u) {
  const std::size_t n = u.inputs.size();
  if (u.covariance.size() != n * n) throw Error("a covariance that is not square");
  Eigen::MatrixXd c(n, n);
  const auto name = [&](std::size_t i) { return word_of(u.inputs[i]); };
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      const double here = u.covariance[i * n + j], there = u.covariance[j * n + i];
      // Written with six digits.
      if (std::abs(here - there) > 1e-5 * std::max(std::abs(here), std::abs(there))) {
        throw InputError(fmt::format(
            "the covariance of {} and {} is {:g} one way and {:g} the other; expected a symmetric one",
            name(i), name(j), here, there));
      }
      c(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = here;
    }
  }
  // An eigenvalue says nothing of whom it is about: the pair that is most alike is.
  const auto not_positive = [&](const std::string& why) {
    std::size_t a = 0, b = 0;
    double most = -1;
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = i + 1; j < n; ++j) {
        const double variances = u.covariance[i * n + i] * u.covariance[j * n + j];
        const double alike =
            std::abs(u.covariance[i * n + j]) / std::sqrt(std::max(variances, 1e-300));
        if (alike <= most) continue;
        most = alike;
        a = i;
        b = j;
      }
    }
    const std::string whose =
        n < 2 ? std::string(name(0))
              : fmt::format("{} and {}, of correlation {:.6g}", name(a), name(b), most);
    throw InputError(fmt::format(
        "the covariance is of no errors that there could be: {}; see {}; expected no eigenvalue below 0",
        why, whose));
  };
  for (std::size_t i = 0; i < n; ++i) {
    const double variance = u.covariance[i * n + i];
    if (!(variance >= 0) || !std::isfinite(variance)) {
      not_positive(fmt::format("the variance of {} is {:g}", name(i), variance));
    }
    const double sd = std::sqrt(variance);
    if (sd > most_sd(u.inputs[i])) {
      throw InputError(fmt::format(
          "{} is off by a standard deviation of {}; expected at most {}: beyond it nothing can be said "
          "to first order",
          name(i), relative(u.inputs[i]) ? percent(sd) : fmt::format("{:g}", sd),
          relative(u.inputs[i]) ? percent(most_sd(u.inputs[i]))
                                : fmt::format("{:g}", most_sd(u.inputs[i]))));
    }
  }
  for (const auto& [what, sd] : {std::pair{"flat", u.flat}, std::pair{"noise", u.noise}}) {
    if (!(sd >= 0) || sd > kMostRelativeSd) {
      throw InputError(
          fmt::format("{} is {}; expected 0 to {}", what, percent(sd), percent(kMostRelativeSd)));
    }
  }
  if (n == 0) return;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(c, Eigen::EigenvaluesOnly);
  const double least = solver.eigenvalues().minCoeff(), greatest = solver.eigenvalues().maxCoeff();
  if (least < -1e-12 * greatest) {
    not_positive(
        fmt::format("it has an eigenvalue of {:.3g}, the greatest being {:.3g}", least, greatest));
  }
}

Uncertainty parse_uncertainty(std::string_view text, ExposureMode mode, double full_light_mw_cm2,
                              const ResinText& resin) {
  Uncertainty u;
  u.text = std::string(trimmed(text));
  u.reference_mw_cm2 = full_light_mw_cm2;
  std::vector<std::string> seen;
  const auto twice = [&](std::string_view word) {
    if (std::find(seen.begin(), seen.end(), word) != seen.end()) {
      fail(fmt::format("the error of {} is given twice; expected it once", word));
    }
    seen.emplace_back(word);
  };
  // The fit comes first: what is given by hand is beside it.
  for_parts(u.text, [&](std::string_view part) {
    if (part != "fit") return;
    twice("fit");
    take_fit(resin, u);
    u.reference_mw_cm2 = 1;  // in whose units D'c of a fit is
  });
  for (const UncertainInput input : u.inputs) seen.emplace_back(word_of(input));
  for_parts(u.text, [&](std::string_view part) {
    if (part == "fit") return;
    const std::size_t equal = part.find('=');
    const std::string_view word = trimmed(part.substr(0, equal));
    if (std::find(kAllWords.begin(), kAllWords.end(), word) == kAllWords.end()) {
      const std::string close = nearest(word, kAllWords);
      fail(fmt::format(
          "'{}' is no input whose error is known{}; expected some of fit, ha, dc, m, aim, "
          "light, stray, speed, time, flat, noise, exchange, as in ha=8%,dc=10%",
          text::printable(std::string(word)),
          close.empty() ? "" : fmt::format("; did you mean {}?", close)));
    }
    if (equal == std::string_view::npos) {
      fail(fmt::format("{} has no number; expected one, as in {}={}", word, word,
                       word == "m"                             ? "0.02"
                       : word == "stray" || word == "exchange" ? "0.1"
                                                               : "8%"));
    }
    twice(word);
    const std::string_view value = trimmed(part.substr(equal + 1));
    constexpr double most_percent = 100 * kMostRelativeSd;
    if (word == "flat" || word == "noise") {
      (word == "flat" ? u.flat : u.noise) = number_of(word, value, true, most_percent);
      return;
    }
    const auto at = std::find(kWords.begin(), kWords.end(), word) - kWords.begin();
    const auto input = static_cast<UncertainInput>(at);
    if (input == (mode == ExposureMode::layerwise ? UncertainInput::speed : UncertainInput::time)) {
      fail(mode == ExposureMode::layerwise
               ? "speed is off, and layer by layer there is none; expected time"
               : "time is off, which is exposure layer by layer; expected speed");
    }
    if (input == UncertainInput::exchange && mode != ExposureMode::layerwise) {
      fail(
          "exchange is off, which is of lifts, and continuously there are none; expected layer by "
          "layer exposure");
    }
    const double most = relative(input) ? most_percent : most_sd(input);
    add_alone(u, input, number_of(word, value, relative(input), most));
  });
  check_uncertainty(u);
  return u;
}

}  // namespace slicecorr
