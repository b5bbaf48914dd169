// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "exchange/personal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>

#include "slicecorr/resins/exchange.hpp"
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
  // "resin@0.05" is a height; "jo@lab" is somebody.
  return piece.size() > at + 1 && of_word(piece[at + 1]) && !is_digit(piece[at + 1]);
}

/// Names that many users and computers have: they tell nothing of anybody.
constexpr std::string_view kOfMany[] = {
    "account", "admin",  "administrator", "computer", "debian",    "default", "guest",
    "lab",     "live",   "local",         "pi",       "localhost", "printer", "raspberrypi",
    "root",    "system", "test",          "ubuntu",   "user"};
/// Words and units of two letters, which a name can't be told from.
constexpr std::string_view kShortWords[] = {"an", "as", "at", "be", "by", "cm", "do", "dr", "go",
                                            "he", "if", "in", "is", "it", "mj", "ml", "mm", "mw",
                                            "my", "nm", "no", "of", "on", "or", "so", "to", "uk",
                                            "um", "up", "us", "uv", "we", "wt"};

bool one_of(std::string_view word, std::span<const std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// Whether the letter text[at] stands for a quantity, as in "n = 12" and "3 x 5", or is an article.
bool is_plain_letter(std::string_view text, std::size_t at) {
  if (text[at] == 'a' || text[at] == 'i') return true;
  const std::string_view blanks = " =";
  const std::size_t after = text.find_first_not_of(blanks, at + 1);
  const std::size_t before =
      at == 0 ? std::string_view::npos : text.find_last_not_of(blanks, at - 1);
  return (after != std::string_view::npos && is_digit(text[after])) ||
         (before != std::string_view::npos && is_digit(text[before]));
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
  const std::string low = lower_case(text);
  for (const std::string& name : names) {
    const std::string looked_for = lower_case(name);
    if (looked_for.empty() || one_of(looked_for, kOfMany) || one_of(looked_for, kShortWords)) {
      continue;
    }
    for (std::size_t at = 0; (at = low.find(looked_for, at)) != std::string::npos; ++at) {
      const std::size_t end = at + looked_for.size();
      const bool begins = at == 0 || !of_word(low[at - 1]);
      if (!begins || (end != low.size() && of_word(low[end]))) continue;
      if (looked_for.size() > 1 || !is_plain_letter(low, at)) return name;
    }
  }
  return {};
}

std::vector<std::string> names_of_person(const std::string& full_name) {
  std::vector<std::string> names{full_name};
  for (std::size_t at = 0; at < full_name.size();) {
    std::size_t end = at;
    while (end < full_name.size() && of_word(full_name[end])) ++end;
    // Initials are told from letters by nobody.
    if (end - at > 1) names.push_back(full_name.substr(at, end - at));
    at = std::max(end, at + 1);
  }
  return names;
}

}  // namespace slicecorr::resins
