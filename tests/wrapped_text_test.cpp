// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Helps on terminals of any width.
#include "support/text/wrapped_text.hpp"

#include <gtest/gtest.h>

#include <random>
#include <sstream>
#include <string>
#include <vector>

namespace slicecorr {
namespace {

TEST(WrappedText, WhatGoesOnStandsBelowTheDescription) {
  EXPECT_EQ(
      wrapped_text("  --name TEXT          What somebody calls the printer, as long as it is\n"
                   "short\n",
                   48),
      "  --name TEXT          What somebody calls the\n"
      "                       printer, as long as it is\n"
      "short\n");
  // A plain line goes on as deep as it began.
  EXPECT_EQ(wrapped_text("  one two three four five six seven eight nine ten", 40),
            "  one two three four five six seven\n  eight nine ten");
  // 40 characters, of which each is two bytes.
  std::string wide;
  for (int i = 0; i < 40; ++i) wide += "\xc2\xb5";
  EXPECT_EQ(wrapped_text(wide + " x", 40), wide + "\nx");
}

TEST(WrappedText, NarrowTerminalsAndLongWordsAreLeft) {
  const std::string line(100, 'x');
  EXPECT_EQ(wrapped_text(line + " y", 39), line + " y");
  EXPECT_EQ(wrapped_text(line + " y", 40), line + "\ny");
  EXPECT_EQ(wrapped_text("", 80), "");
  EXPECT_EQ(wrapped_text("\n\n", 80), "\n\n");
}

// Only spaces become line ends, and no line is longer than it must be.
TEST(WrappedText, NoWordIsLost) {
  std::mt19937 random(7);
  const auto words = [](const std::string& text) {
    std::istringstream in(text);
    std::vector<std::string> all;
    for (std::string word; in >> word;) all.push_back(word);
    return all;
  };
  for (int round = 0; round < 200; ++round) {
    std::string text(random() % 8, ' ');
    for (unsigned n = random() % 60; n > 0; --n) {
      text += std::string(1 + random() % 12, 'a');
      text += std::string(random() % 9 == 0 ? 3 : 1, ' ');
      if (random() % 20 == 0) text += '\n';
    }
    const std::size_t width = 40 + random() % 60;
    const std::string wrapped = wrapped_text(text, width);
    EXPECT_EQ(words(wrapped), words(text));
    std::istringstream lines(wrapped);
    for (std::string line; std::getline(lines, line);) {
      const std::size_t end = line.find_last_not_of(' ');
      if (end == line.npos) continue;
      EXPECT_LE(end + 1, width + 12) << line;  // a word of 12 at most stands too far out
    }
  }
}

}  // namespace
}  // namespace slicecorr
