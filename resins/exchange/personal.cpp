// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "exchange/personal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "support/text/ascii.hpp"

namespace slicecorr::resins {

namespace {

bool is_letter(char c) { return lower_case(c) >= 'a' && lower_case(c) <= 'z'; }
/// Of a word; what is not ASCII is a letter.
bool of_word(char c) { return is_letter(c) || is_digit(c) || static_cast<unsigned char>(c) > 0x7F; }

/// What stands between blanks, quotes, brackets and the like, in order.
std::vector<std::string_view> pieces_of(std::string_view text) {
  constexpr std::string_view between = " \t\r\n\"'`()[]{}<>,;=|";
  std::vector<std::string_view> pieces;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = text.find_first_not_of(between, at);
    if (begin == std::string_view::npos) break;
    const std::size_t end = std::min(text.find_first_of(between, begin), text.size());
    pieces.push_back(text.substr(begin, end - begin));
    at = end;
  }
  return pieces;
}

bool is_path(std::string_view piece) {
  const std::string low = lower_case(piece);
  for (const char* begins : {"~/", "./", "../", "file:", "\\\\"}) {
    if (low.starts_with(begins)) return true;
  }
  if (piece.size() > 1 && piece[0] == '/' && of_word(piece[1])) return true;
  // C:\ and C:/ of a drive; "https:/" has more letters before its colon.
  return piece.size() > 2 && is_letter(piece[0]) && piece[1] == ':' &&
         (piece[2] == '\\' || piece[2] == '/');
}

bool is_address(std::string_view piece) {
  const std::size_t at = piece.find('@');
  if (at == std::string_view::npos || at == 0 || !of_word(piece[at - 1])) return false;
  const std::size_t point = piece.find('.', at);
  // "resin@0.05" is a height.
  return point != std::string_view::npos && point > at + 1 && piece.size() > point + 2 &&
         is_letter(piece[point + 1]) && is_letter(piece[point + 2]);
}

}  // namespace

std::string path_or_address_in(std::string_view text) {
  for (const std::string_view piece : pieces_of(text)) {
    if (is_path(piece)) return fmt::format("a path, '{}'", piece);
    if (is_address(piece)) return fmt::format("an e-mail address, '{}'", piece);
  }
  return {};
}

std::string name_in(std::string_view text, const std::vector<std::string>& names) {
  constexpr std::array<std::string_view, 9> of_many = {"admin",     "computer", "debian",
                                                       "localhost", "printer",  "raspberrypi",
                                                       "root",      "ubuntu",   "user"};
  const std::string low = lower_case(text);
  for (const std::string& name : names) {
    const std::string looked_for = lower_case(name);
    if (looked_for.size() < 3 ||
        std::find(of_many.begin(), of_many.end(), looked_for) != of_many.end()) {
      continue;
    }
    for (std::size_t at = 0; (at = low.find(looked_for, at)) != std::string::npos; ++at) {
      const std::size_t end = at + looked_for.size();
      const bool begins = at == 0 || !of_word(low[at - 1]);
      if (begins && (end == low.size() || !of_word(low[end]))) return name;
    }
  }
  return {};
}

}  // namespace slicecorr::resins
