// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/completion_words.hpp"

#include <algorithm>
#include <utility>

#include "support/text/ascii.hpp"

namespace slicecorr::cli::completion {

std::vector<const Command*> all_of(const Command& program) {
  std::vector<const Command*> all{&program};
  for (const Command& sub : program.commands) {
    const std::vector<const Command*> below = all_of(sub);
    all.insert(all.end(), below.begin(), below.end());
  }
  return all;
}

std::string replaced(std::string text, std::string_view what, std::string_view with) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size()) {
    text.replace(at, what.size(), with);
  }
  return text;
}

std::string escaped(std::string_view text, std::string_view characters) {
  std::string out;
  for (const char c : text) {
    if (characters.find(c) != std::string_view::npos) out += '\\';
    out += c;
  }
  return out;
}

bool is_plain(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || is_digit(c) || c == '-' || c == '_' ||
           c == '.';
  });
}

std::string in_quotes(std::string_view text) {
  return "'" + replaced(std::string(text), "'", R"('\'')") + "'";
}

std::string words_quoted(const std::vector<std::string>& words,
                         std::string (*quoted)(std::string_view)) {
  std::string out;
  for (const std::string& word : words) {
    out += (out.empty() ? "" : " ") + (is_plain(word) ? word : quoted(word));
  }
  return out;
}

std::string frame_of(std::string_view frame, const std::string& program) {
  std::string text = replaced(std::string(frame), "@PROGRAM@", program);
  return replaced(std::move(text), "@FN@", "_" + replaced(program, "-", "_"));
}

}  // namespace slicecorr::cli::completion
