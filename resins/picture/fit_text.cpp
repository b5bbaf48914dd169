// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "picture/fit_text.hpp"

#include <fmt/format.h>

#include <cctype>
#include <cmath>

#include "support/chart/chart.hpp"

namespace slicecorr::resins {

std::string titled(const std::string& name, std::string title) {
  if (!name.empty()) return name + ": " + title;
  title[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(title[0])));
  return title;
}

std::string prime_unit(double m) {
  if (m == 1) return "mJ/cm²";
  return fmt::format("(mW/cm²)^{:.3g} s", m);
}

std::string symbol_of(const std::string& parameter) {
  if (parameter == "h_um") return "h";
  if (parameter == "dc_mj_cm2") return "Dc";
  if (parameter == "critical_dose_prime") return "D′c";
  if (parameter == "gel_a_mj_cm2") return "A";
  if (parameter == "gel_b_sqrt_mw_cm2_s") return "B";
  if (parameter == "beta") return "β";
  if (parameter == "huv_um") return "huv";
  if (parameter == "m_uv") return "m under UV";
  return parameter;
}

std::string parameter_words(const Parameter& p) {
  std::string text = fmt::format("{} = {}", symbol_of(p.name), chart::figure(p.value));
  if (!p.unit.empty()) text += " " + p.unit;
  if (p.fixed) return text + " (given, not fitted)";
  if (std::isfinite(p.ci95[0]) && std::isfinite(p.ci95[1])) {
    text += fmt::format(" (95 %: {} to {})", chart::figure(p.ci95[0]), chart::figure(p.ci95[1]));
  } else {
    text += " (the data do not say how sure)";
  }
  if (p.bootstrap95) {
    text += fmt::format(", bootstrap {} to {}", chart::figure((*p.bootstrap95)[0]),
                        chart::figure((*p.bootstrap95)[1]));
  }
  if (p.at_bound) text += ", at its bound";
  return text;
}

}  // namespace slicecorr::resins
