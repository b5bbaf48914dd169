// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/limit.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace slicecorr {

namespace {

double read(const std::string& text) {
  double value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

/// Nearest number of so many digits, and the one next to it on the side of `value` asked for.
double rounded(double value, int digits, bool up) {
  if (value == 0 || !std::isfinite(value)) return value;
  const double nearest = read(fmt::format("{:.{}e}", value, digits - 1));
  if (up ? nearest >= value : nearest <= value) return nearest;
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(value))) - digits + 1);
  return read(fmt::format("{:.{}e}", up ? nearest + unit : nearest - unit, digits - 1));
}

}  // namespace

double rounded_down(double value, int digits) { return rounded(value, digits, false); }
double rounded_up(double value, int digits) { return rounded(value, digits, true); }

std::string at_most(double limit, int digits) {
  return fmt::format("{}", rounded_down(limit, digits));
}
std::string at_least(double limit, int digits) {
  return fmt::format("{}", rounded_up(limit, digits));
}

}  // namespace slicecorr
