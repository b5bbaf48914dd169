// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string_view>
#include <vector>

#include "slicecorr/resins/database.hpp"

namespace slicecorr::resins {

namespace {

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    lines.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

struct Line {
  char mark = ' ';  ///< ' ' in both, '-' in the old, '+' in the new
  std::string_view text;
};

/// Lines of both texts in order, by the longest common subsequence.
std::vector<Line> align(const std::vector<std::string_view>& a,
                        const std::vector<std::string_view>& b) {
  std::size_t head = 0, tail = 0;
  while (head < a.size() && head < b.size() && a[head] == b[head]) ++head;
  while (tail < a.size() - head && tail < b.size() - head &&
         a[a.size() - 1 - tail] == b[b.size() - 1 - tail]) {
    ++tail;
  }
  const std::size_t n = a.size() - head - tail, m = b.size() - head - tail;
  std::vector<Line> out;
  for (std::size_t i = 0; i < head; ++i) out.push_back({' ', a[i]});
  // Texts of definitions are short; where they are not, what differs is shown as one block.
  constexpr std::size_t most_cells = 16'000'000;
  std::size_t i = 0, j = 0;
  if (n > 0 && m > 0 && n * m <= most_cells) {
    // length[i][j]: longest common subsequence of what follows.
    std::vector<std::uint32_t> length((n + 1) * (m + 1), 0);
    const auto at = [&](std::size_t r, std::size_t c) -> std::uint32_t& {
      return length[r * (m + 1) + c];
    };
    for (std::size_t r = n; r-- > 0;) {
      for (std::size_t c = m; c-- > 0;) {
        at(r, c) = a[head + r] == b[head + c] ? at(r + 1, c + 1) + 1
                                              : std::max(at(r + 1, c), at(r, c + 1));
      }
    }
    while (i < n && j < m) {
      if (a[head + i] == b[head + j]) {
        out.push_back({' ', a[head + i++]});
        ++j;
      } else if (at(i + 1, j) >= at(i, j + 1)) {
        out.push_back({'-', a[head + i++]});
      } else {
        out.push_back({'+', b[head + j++]});
      }
    }
  }
  for (; i < n; ++i) out.push_back({'-', a[head + i]});
  for (; j < m; ++j) out.push_back({'+', b[head + j]});
  for (std::size_t k = a.size() - tail; k < a.size(); ++k) out.push_back({' ', a[k]});
  return out;
}

}  // namespace

std::string difference(const std::string& old_text, const std::string& new_text,
                       const std::string& old_name, const std::string& new_name) {
  constexpr std::size_t context = 3;
  const auto lines = align(lines_of(old_text), lines_of(new_text));
  std::string out;
  std::size_t old_line = 1, new_line = 1;  // of lines[done]
  std::size_t done = 0;
  const auto pass = [&](std::size_t to) {
    for (; done < to; ++done) {
      if (lines[done].mark != '+') ++old_line;
      if (lines[done].mark != '-') ++new_line;
    }
  };
  for (std::size_t at = 0; at < lines.size(); ++at) {
    if (lines[at].mark == ' ') continue;
    // A hunk goes on while the next change is within two contexts.
    std::size_t last = at;
    for (std::size_t k = at + 1; k < lines.size() && k <= last + 2 * context + 1; ++k) {
      if (lines[k].mark != ' ') last = k;
    }
    const std::size_t begin = std::max(at, done + context) - context;
    const std::size_t end = std::min(lines.size(), last + context + 1);
    pass(begin);
    std::size_t olds = 0, news = 0;
    std::string body;
    for (std::size_t k = begin; k < end; ++k) {
      olds += lines[k].mark != '+';
      news += lines[k].mark != '-';
      body += fmt::format("{}{}\n", lines[k].mark, lines[k].text);
    }
    if (out.empty()) out = fmt::format("--- {}\n+++ {}\n", old_name, new_name);
    out += fmt::format("@@ -{},{} +{},{} @@\n{}", olds ? old_line : old_line - 1, olds,
                       news ? new_line : new_line - 1, news, body);
    pass(end);
    at = end - 1;
  }
  return out;
}

}  // namespace slicecorr::resins
