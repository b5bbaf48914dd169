// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "views/moment_text.hpp"

#include <algorithm>
#include <cstdlib>

#include "slicecorr/farm/clock.hpp"

namespace slicecorr::farm::text {

std::string moment(std::int64_t ms, std::int64_t now_ms) {
  if (ms <= 0) return "-";
  const std::string text = local_time_text(ms);
  constexpr std::int64_t half_day_ms = std::int64_t{12} * 3600 * 1000;
  return std::abs(ms - now_ms) < half_day_ms ? text.substr(11) : text.substr(0, 16);
}

std::string to_the_minute(std::int64_t ms, std::int64_t now_ms) {
  const std::string text = moment(ms, now_ms);
  return text.size() == 8 ? text.substr(0, 5) : text;
}

std::string without_folders(const std::string& message) {
  std::string text;
  for (std::size_t at = 0; at < message.size();) {
    const std::size_t end = std::min(message.find("; ", at), message.size());
    const std::string piece = message.substr(at, end - at);
    const std::size_t slash = piece.rfind('/', piece.find(": "));
    text += (text.empty() ? "" : "; ") + piece.substr(slash == piece.npos ? 0 : slash + 1);
    at = end + 2;
  }
  return text;
}

}  // namespace slicecorr::farm::text
