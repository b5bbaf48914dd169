// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Changes of single keys leave every other byte of a TOML text alone.
#include "../resins/database/toml_edit.hpp"

#include <gtest/gtest.h>

#include <string>

#include "slicecorr/error.hpp"
#include "support/toml/toml_plus_plus.hpp"

namespace slicecorr::resins {
namespace {

const std::string kText =
    "# A resin; µ and ² count as one character each.\n"
    "name = \"a\"   # stays\n"
    "notes = '²²'\n"
    "\n"
    "[cure] # the table\n"
    "  m = 1.0  # µ²\n"
    "# above\n"
    "dose = 5\n"
    "points = [\n"
    "  [0, 1], # first\n"
    "  [255, 2],\n"
    "] # end\n"
    "\n"
    "# about provenance\n"
    "[provenance]\n"
    "source = \"x\"\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

TEST(TomlEdit, ReplacesAValueAndNothingElse) {
  TomlEdit edit(kText, "a.toml");
  edit.set("cure", "m", "0.99");
  EXPECT_EQ(edit.text(), replaced(kText, "m = 1.0", "m = 0.99"));
  edit.set("cure", "m", "1.0");
  EXPECT_EQ(edit.text(), kText);
  edit.set("", "notes", "\"³\"");
  EXPECT_EQ(edit.text(), replaced(kText, "'²²'", "\"³\""));
}

TEST(TomlEdit, ReplacesAnArrayOverSeveralLines) {
  TomlEdit edit(kText, "a.toml");
  edit.set("cure", "points", "[[0, 9]]");
  EXPECT_EQ(edit.text(),
            replaced(kText, "[\n  [0, 1], # first\n  [255, 2],\n] # end", "[[0, 9]] # end"));
}

TEST(TomlEdit, NewKeysGoToTheEndOfTheirTable) {
  TomlEdit edit(kText, "a.toml");
  edit.set("", "version", "2");
  EXPECT_EQ(edit.text(), replaced(kText, "# stays\n", "# stays\nversion = 2\n"));
  TomlEdit second(kText, "a.toml");
  second.set("cure", "factor", "5.0");
  EXPECT_EQ(second.text(), replaced(kText, "] # end\n", "] # end\nfactor = 5.0\n"));
  TomlEdit third(kText, "a.toml");
  third.set("uv", "beta", "1.5");
  EXPECT_EQ(third.text(), kText + "\n[uv]\nbeta = 1.5\n");
}

TEST(TomlEdit, TextsWithoutALineEndOrAnything) {
  TomlEdit edit("name = \"a\"", "a.toml");
  edit.set("", "version", "2");
  edit.set("cure", "m", "1.0");
  EXPECT_EQ(edit.text(), "name = \"a\"\nversion = 2\n\n[cure]\nm = 1.0\n");
  TomlEdit empty("", "a.toml");
  empty.set("", "name", "\"b\"");
  EXPECT_EQ(empty.text(), "name = \"b\"\n");
}

TEST(TomlEdit, LineEndsOfWindowsStay) {
  TomlEdit edit("name = \"a\"\r\n[cure]\r\nm = 1.0\r\n", "a.toml");
  edit.set("cure", "m", "2.0");
  EXPECT_EQ(edit.text(), "name = \"a\"\r\n[cure]\r\nm = 2.0\r\n");
}

TEST(TomlEdit, RemovesWholeLines) {
  TomlEdit edit(kText, "a.toml");
  edit.remove("cure", "points");
  EXPECT_EQ(edit.text(),
            replaced(kText, "points = [\n  [0, 1], # first\n  [255, 2],\n] # end\n", ""));
  edit.remove("cure", "nothing");
  edit.remove("nowhere", "nothing");
  EXPECT_FALSE(edit.has("cure", "points"));
  EXPECT_TRUE(edit.has("cure", "m"));
}

TEST(TomlEdit, CommentsAboveAKeyAreReplaced) {
  TomlEdit edit(kText, "a.toml");
  edit.set_comment("cure", "dose", "# new\n# lines");
  EXPECT_EQ(edit.text(), replaced(kText, "# above\n", "# new\n# lines\n"));
  edit.set_comment("cure", "dose", "");
  EXPECT_EQ(edit.text(), replaced(kText, "# above\n", ""));
  TomlEdit first("# one\n# two\nname = \"a\"\n", "a.toml");
  first.set_comment("", "name", "# three");
  EXPECT_EQ(first.text(), "# three\nname = \"a\"\n");
}

TEST(TomlEdit, WhatItCannotDoIsRefusedAndLeavesTheText) {
  for (const char* text : {"cure = { m = 1.0 }\n", "cure.m = 1.0\n[other]\nx = 1\n"}) {
    TomlEdit edit(text, "a.toml");
    EXPECT_THROW(edit.set("cure", "dose", "5.0"), InputError) << text;
    EXPECT_EQ(edit.text(), text);
  }
  TomlEdit line("cure = { m = 1.0, n = 2.0 }\n", "a.toml");
  EXPECT_THROW(line.remove("cure", "m"), InputError);
  EXPECT_THROW(TomlEdit("name = ", "a.toml"), InputError);
}

TEST(TomlEdit, TextsAndNumbersReadBackAsThemselves) {
  for (const std::string& text : {std::string("plain"), std::string("a \"b\" \\ c"),
                                  std::string("line\nend\ttab\r"), std::string("\x01\x7F µ²")}) {
    const toml::table t = toml::parse("v = " + toml_text(text));
    EXPECT_EQ(t["v"].value<std::string>(), text);
  }
  for (const double number : {5.0, 0.1, 1e-9, 123456.0, 1.5e300, 1234567.0}) {
    const toml::table t = toml::parse("v = " + toml_number(number));
    ASSERT_TRUE(t["v"].is_floating_point()) << toml_number(number);
    EXPECT_DOUBLE_EQ(*t["v"].value<double>(), number);
  }
}

}  // namespace
}  // namespace slicecorr::resins
