// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file limit.hpp
/// Limits as messages name them: whoever types the number back gets what works.
///
/// A limit that is rounded to the nearest digits fails every other time. Pure functions,
/// thread-safe; none throws.
#pragma once

#include <string>

namespace slicecorr {

/// Digits of limits in messages.
inline constexpr int kLimitDigits = 5;

/// The greatest number of so many significant digits at or below `value`, and the least at or above
/// it; 0, infinities and NaN as they are. digits: 1..17.
double rounded_down(double value, int digits = kLimitDigits);
double rounded_up(double value, int digits = kLimitDigits);

/// The same as text that reads back as just that number.
std::string at_most(double limit, int digits = kLimitDigits);
std::string at_least(double limit, int digits = kLimitDigits);

}  // namespace slicecorr
