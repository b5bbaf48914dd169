// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/text/display_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "support/text/utf8.hpp"

namespace slicecorr::text {

namespace {

using detail::kNoCharacter;
using detail::next_character;

/// Columns of a character: the blocks that terminals agree on.
int width_of(char32_t c) {
  const auto in = [c](char32_t low, char32_t high) { return c >= low && c <= high; };
  if (in(0x300, 0x36F) || in(0x200B, 0x200D) || in(0xFE00, 0xFE0F) || in(0x20D0, 0x20FF)) return 0;
  const bool wide = in(0x1100, 0x115F) || in(0x2E80, 0xA4CF) || in(0xAC00, 0xD7A3) ||
                    in(0xF900, 0xFAFF) || in(0xFE30, 0xFE6F) || in(0xFF00, 0xFF60) ||
                    in(0xFFE0, 0xFFE6) || in(0x1F300, 0x1FAFF) || in(0x20000, 0x3FFFD);
  return wide ? 2 : 1;
}

bool moves_or_turns(char32_t c) {
  return c < 0x20 || (c >= 0x7F && c < 0xA0) || (c >= 0x200E && c <= 0x200F) ||
         (c >= 0x2028 && c <= 0x202E) || (c >= 0x2060 && c <= 0x206F) || c == 0xFEFF || c == 0x061C;
}

}  // namespace

std::string duration(double s) {
  if (!std::isfinite(s) || s < 0) return "-";
  if (s < 10) return fmt::format("{:.1f} s", s);
  const auto whole = std::int64_t{std::llround(std::min(s, 1e12))};
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  if (whole < std::int64_t{48} * 3600)
    return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
  return fmt::format("{} d {:02} h", whole / 86400, whole / 3600 % 24);
}

namespace {

constexpr const char* kByteUnits[] = {"B", "kB", "MB", "GB", "TB", "PB"};

std::size_t byte_unit(double n) {
  std::size_t unit = 0;
  for (; n >= 999.95 && unit + 1 < std::size(kByteUnits); ++unit) n /= 1000;
  return unit;
}

std::string bytes_in(double n, std::size_t unit, int decimals) {
  if (!std::isfinite(n) || n < 0) return "-";
  return fmt::format("{:.{}f} {}", n / std::pow(1000.0, static_cast<double>(unit)),
                     unit == 0 ? 0 : decimals, kByteUnits[unit]);
}

}  // namespace

std::string bytes(double n) { return bytes_in(n, byte_unit(n), 1); }

std::pair<std::string, std::string> bytes_apart(double a, double b) {
  if (a == b) return {bytes(a), bytes(b)};
  for (int decimals = 1;; ++decimals) {
    std::pair<std::string, std::string> texts{bytes_in(a, byte_unit(a), decimals),
                                              bytes_in(b, byte_unit(b), decimals)};
    // A single byte shows with three decimals for each unit.
    const bool all = decimals >= 3 * static_cast<int>(byte_unit(a));
    if (texts.first != texts.second || all) return texts;
  }
}

std::string count(std::int64_t n) {
  std::string digits = std::to_string(n);
  const std::size_t sign = n < 0 ? 1 : 0;
  for (std::size_t at = digits.size(); at > sign + 3;) digits.insert(at -= 3, 1, ',');
  return digits;
}

std::string figure(double value) {
  if (!std::isfinite(value)) return "-";
  constexpr double all_digits = 999.5, too_small = 5e-10;
  if (std::abs(value) < too_small) return "0";
  if (std::abs(value) >= all_digits) {
    return count(std::llround(std::clamp(value, -9e18, 9e18)));
  }
  // Of a number as it is rounded: 9.999 is 10.0.
  const std::string rounded = fmt::format("{:.2e}", value);
  const int exponent = std::stoi(rounded.substr(rounded.find('e') + 1));
  std::string text = fmt::format("{:.{}f}", value, 2 - exponent);
  if (text.find('.') != text.npos) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
  }
  return text;
}

namespace {

std::string shown(std::string_view text, bool keep_lines) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t from = at;
    const char32_t c = next_character(text, at);
    if (keep_lines && (c == '\n' || c == '\t')) {
      out += static_cast<char>(c);
    } else if (c == '\n' || c == '\t' || c == '\r') {
      out += ' ';
    } else if (c == kNoCharacter || moves_or_turns(c)) {
      out += '?';
    } else {
      out += text.substr(from, at - from);
    }
  }
  return out;
}

}  // namespace

std::string printable(std::string_view text) { return shown(text, false); }
std::string readable(std::string_view text) { return shown(text, true); }

int columns_of(std::string_view text) {
  int columns = 0;
  for (std::size_t at = 0; at < text.size();) columns += width_of(next_character(text, at));
  return columns;
}

std::string clipped(std::string_view text, int columns) {
  if (columns <= 0) return {};
  if (columns_of(text) <= columns) return std::string(text);
  int used = 0;
  std::size_t at = 0;
  while (at < text.size()) {
    std::size_t next = at;
    const int width = width_of(next_character(text, next));
    if (used + width > columns - 1) break;
    used += width;
    at = next;
  }
  return std::string(text.substr(0, at)) + "…";
}

std::string padded(std::string_view text, int columns, bool right) {
  std::string out = clipped(text, columns);
  const std::string room(static_cast<std::size_t>(std::max(0, columns - columns_of(out))), ' ');
  return right ? room + out : out + room;
}

std::string bar(double fraction, int columns) {
  static constexpr const char* kEighths[] = {" ", "▏", "▎", "▍", "▌", "▋", "▊", "▉"};
  const double f = std::isfinite(fraction) ? std::clamp(fraction, 0.0, 1.0) : 0;
  const int filled = static_cast<int>(std::floor(f * columns * 8 + 1e-9));
  std::string out;
  for (int i = 0; i < columns; ++i) {
    const int here = filled - i * 8;
    out += here >= 8 ? "█" : kEighths[std::max(0, here)];
  }
  return out;
}

std::string table(const std::vector<std::string>& headings,
                  const std::vector<std::vector<std::string>>& rows, int most_columns) {
  std::vector<int> widths;
  std::vector<bool> right;
  for (const std::string& h : headings) {
    right.push_back(!h.empty() && h[0] == '>');
    widths.push_back(columns_of(h) - (right.back() ? 1 : 0));
  }
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size() && i < widths.size(); ++i) {
      widths[i] = std::max(widths[i], columns_of(row[i]));
    }
  }
  std::string out;
  const auto line = [&](const std::vector<std::string>& cells, bool heading) {
    std::string text;
    for (std::size_t i = 0; i < cells.size() && i < widths.size(); ++i) {
      const std::string_view cell =
          heading && right[i] ? std::string_view(cells[i]).substr(1) : std::string_view(cells[i]);
      if (i > 0) text += "  ";
      text += padded(cell, widths[i], right[i]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    out += (most_columns > 0 ? clipped(text, most_columns) : text) + "\n";
  };
  line(headings, true);
  for (const auto& row : rows) line(row, false);
  return out;
}

}  // namespace slicecorr::text
