// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file resins_text.hpp
/// Checks of text that the resin programs write.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <regex>
#include <string>
#include <vector>

namespace slicecorr::test {

/// What is wrong with `text` as XML: tags that do not match, bare < or &, attributes without
/// quotes or twice. Empty when nothing is.
inline std::string xml_fault(const std::string& text) {
  std::vector<std::string> open;
  std::size_t at = 0;
  const auto near = [&] { return " near '" + text.substr(at, 60) + "'"; };
  static const std::regex tag(R"re(^<(/?)([A-Za-z][\w:-]*)((?:\s+[\w:-]+="[^"<]*")*)\s*(/?)>)re");
  static const std::regex attribute(R"re(([\w:-]+)=")re");
  static const std::regex entity(R"re(^&(lt|gt|amp|quot|#\d+);)re");
  while (at < text.size()) {
    const char c = text[at];
    std::smatch m;
    const auto from = text.begin() + static_cast<std::ptrdiff_t>(at);
    if (c == '&') {
      if (!std::regex_search(from, text.end(), m, entity)) return "bare &" + near();
      at += static_cast<std::size_t>(m.length());
    } else if (c == '<') {
      // Only as far as the tag's end: regular expressions on long texts are slow.
      const std::size_t end = text.find('>', at);
      if (end == std::string::npos) return "no end of tag" + near();
      const std::string piece = text.substr(at, end + 1 - at);
      if (!std::regex_match(piece, m, tag)) {
        // A long path is too much for std::regex's recursion: look at what is around it.
        const std::size_t quotes =
            static_cast<std::size_t>(std::count(piece.begin(), piece.end(), '"'));
        if (piece.size() < 2000 || quotes % 2 != 0) return "bad tag" + near();
        const bool closes = piece[piece.size() - 2] == '/';
        if (!closes) open.push_back(piece.substr(1, piece.find(' ') - 1));
      } else {
        const std::string attributes = m[3];
        std::vector<std::string> names;
        for (std::sregex_iterator i(attributes.begin(), attributes.end(), attribute), e; i != e;
             ++i) {
          if (std::find(names.begin(), names.end(), (*i)[1]) != names.end()) {
            return "attribute twice" + near();
          }
          names.push_back((*i)[1]);
        }
        if (m[1] == "/") {
          if (open.empty() || open.back() != m[2]) return "does not match" + near();
          open.pop_back();
        } else if (m[4] != "/") {
          open.push_back(m[2]);
        }
      }
      at = end + 1;
    } else {
      if (static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') return "control" + near();
      ++at;
    }
  }
  return open.empty() ? "" : "never closed: " + open.back();
}

/// Sound XML with one svg root that scales, both colour schemes, words for those who do not see it,
/// and numbers that are finite.
inline void expect_sound_svg(const std::string& svg) {
  EXPECT_EQ(xml_fault(svg), "");
  EXPECT_EQ(svg.rfind("<svg xmlns=\"http://www.w3.org/2000/svg\"", 0), 0U);
  EXPECT_NE(svg.find("viewBox=\"0 0 640 "), std::string::npos);
  EXPECT_NE(svg.find("prefers-color-scheme:dark"), std::string::npos);
  EXPECT_NE(svg.find("aria-label=\""), std::string::npos);
  // "nan" and "inf" as numbers, not in words.
  std::size_t from = 0;
  for (const char* word : {"nan", "inf"}) {
    while ((from = svg.find(word, from)) != std::string::npos) {
      const bool letter_before =
          from > 0 && std::isalpha(static_cast<unsigned char>(svg[from - 1]));
      const bool letter_after =
          from + 3 < svg.size() && std::isalpha(static_cast<unsigned char>(svg[from + 3]));
      EXPECT_TRUE(letter_before || letter_after) << svg.substr(from > 40 ? from - 40 : 0, 80);
      from += 3;
    }
    from = 0;
  }
  EXPECT_EQ(svg.find("-0\""), std::string::npos);
}

}  // namespace slicecorr::test
