// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Bounds of JSON and TOML that others wrote: what is beyond them is refused before anything is made
// of it, and nothing else is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <string>

#include "slicecorr/error.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Json = nlohmann::json;

/// What a text is refused with; "read" where it is not.
std::string said_of(const std::function<void()>& read) {
  try {
    read();
  } catch (const InputError& e) {
    return e.what();
  }
  return "read";
}

std::string repeated(const std::string& text, int n) {
  std::string all;
  for (int i = 0; i < n; ++i) all += text;
  return all;
}

int depth_of(const Json& json) {
  int most = 0;
  if (json.is_structured()) {
    for (const auto& item : json) most = std::max(most, depth_of(item));
    ++most;
  }
  return most;
}

TEST(ForeignJson, NestingIsBounded) {
  const auto read = [](const std::string& text) {
    return said_of([&] { detail::read_json(text, {"a.json", "entry"}); });
  };
  EXPECT_EQ(read(repeated("[", 64) + repeated("]", 64)), "read");
  EXPECT_EQ(read(repeated("[", 65) + repeated("]", 65)),
            "a.json: entry: is no JSON that is read here: it is nested more than 64 deep");
  for (const int deep : {1'000, 100'000, 5'000'000}) {
    EXPECT_THAT(read(repeated("[", deep)), HasSubstr("more than 64 deep"));
    EXPECT_THAT(read(repeated("{\"a\":", deep)), HasSubstr("more than 64 deep"));
    EXPECT_TRUE(detail::try_json(repeated("[", deep) + repeated("]", deep)).is_discarded());
  }
  // Brackets in texts nest nothing, whatever is escaped in them.
  EXPECT_EQ(read("[\"" + repeated("[{", 100) + "\"]"), "read");
  EXPECT_EQ(read("[\"" + repeated("\\\"[", 100) + "\"]"), "read");
  EXPECT_THAT(read("[\"\\\\\"," + repeated("[", 100)), HasSubstr("more than 64 deep"));
}

TEST(ForeignJson, ValuesAndBytesAreBounded) {
  const auto read = [](const std::string& text, const detail::JsonBounds& bounds) {
    return said_of([&] { detail::read_json(text, {"a", ""}, bounds); });
  };
  EXPECT_EQ(read("[1,2,3,4]", {100, 4, 4}), "read");
  EXPECT_THAT(read("[1,2,3,4,5,6]", {100, 4, 4}), HasSubstr("more than 4 values"));
  EXPECT_EQ(read("[1,2]", {5, 4, 4}), "read");
  EXPECT_THAT(read("[1,2] ", {5, 4, 4}), HasSubstr("more than 5 B"));
}

TEST(ForeignJson, SaysWhereItIsWrongWithoutNamesOfALibrary) {
  const auto read = [](const std::string& text) {
    return said_of([&] { detail::read_json(text, {"a.json", ""}); });
  };
  EXPECT_THAT(read("{\n  \"a\": x}"),
              AllOf(HasSubstr("a.json: is not valid JSON: line 2, column 8"),
                    ::testing::Not(HasSubstr("exception"))));
  EXPECT_THAT(read("1e999"), HasSubstr("is not valid JSON"));
  EXPECT_THAT(read(""), HasSubstr("is not valid JSON"));
  // It does not repeat a megabyte, nor what would move a terminal's cursor.
  const std::string long_one = read("[\"" + std::string(1'000'000, 'x'));
  EXPECT_LT(long_one.size(), 500U);
  EXPECT_THAT(read("[\x1b[2J"), ::testing::Not(HasSubstr("\x1b")));
}

// Against the depth of what the parser makes of it.
TEST(ForeignJson, RandomTexts) {
  std::mt19937 random(7);
  const std::function<Json(int)> make = [&](int room) -> Json {
    const unsigned kind = random() % 6;
    if (room == 0 || kind < 2) {
      constexpr const char* kTexts[] = {"[", "a\\\"]}", "\\", ",", "{\"", "\xc3\xa9"};
      return kind == 0 ? Json(kTexts[random() % 6]) : Json(random() % 100);
    }
    Json json = kind < 4 ? Json::array() : Json::object();
    for (unsigned n = random() % 4; n > 0; --n) {
      if (json.is_array()) {
        json.push_back(make(room - 1));
      } else {
        json[std::string(random() % 3, '"') + static_cast<char>('[' + random() % 3)] =
            make(room - 1);
      }
    }
    return json;
  };
  int deep = 0;
  for (int i = 0; i < 3000; ++i) {
    const Json json = make(8);
    const std::string text = json.dump(i % 3 - 1);
    const int depth = depth_of(json);
    deep += depth > 3 ? 1 : 0;
    EXPECT_EQ(detail::beyond_bounds(text, {1 << 20, depth, 1 << 20}), "") << text;
    if (depth > 0) {
      EXPECT_NE(detail::beyond_bounds(text, {1 << 20, depth - 1, 1 << 20}), "") << text;
    }
    EXPECT_EQ(detail::try_json(text), json);
  }
  EXPECT_GT(deep, 300);
}

TEST(ForeignJson, MembersForgive) {
  const Json json = {{"n", 5.5}, {"whole", 1e300}, {"text", "x"}, {"flag", true}, {"list", {1}}};
  for (const Json& none : {Json(), Json(5), Json::array({1}), Json("n"), Json::object()}) {
    EXPECT_EQ(detail::number_in(none, "n"), std::nullopt);
    EXPECT_EQ(detail::whole_in(none, "n", 7), 7);
    EXPECT_FALSE(detail::flag_in(none, "flag"));
    EXPECT_EQ(detail::text_in(none, "text"), "");
  }
  EXPECT_EQ(detail::number_in(json, "n"), 5.5);
  EXPECT_EQ(detail::number_in(json, "text"), std::nullopt);
  EXPECT_EQ(detail::whole_in(json, "whole", 0), 2'000'000'000);
  EXPECT_EQ(detail::text_in(json, "n"), "");
  EXPECT_EQ(detail::text_in(json, "text"), "x");
  EXPECT_TRUE(detail::flag_in(json, "flag"));
  EXPECT_FALSE(detail::flag_in(json, "n"));
}

TEST(ForeignToml, NamesInNamesAreBounded) {
  const auto read = [](const std::string& text) {
    return said_of([&] { parse_toml(text, "a.toml"); });
  };
  const std::string deep = "a" + repeated(".a", 50'000);
  const std::string refused = "is not TOML: names of more than 16 parts";
  EXPECT_EQ(read("a" + repeated(".a", 15) + " = 1\n"), "read");
  EXPECT_THAT(read("a" + repeated(".a", 16) + " = 1\n"), HasSubstr("line 1: " + refused));
  EXPECT_THAT(read("# one\nx = 1\n" + deep + " = 1\n"), HasSubstr("line 3: " + refused));
  EXPECT_THAT(read("[" + deep + "]\n"), HasSubstr(refused));
  EXPECT_THAT(read("[[" + deep + "]]\n"), HasSubstr(refused));
  EXPECT_THAT(read("a" + repeated(" . \"b\"", 50'000) + " = 1\n"), HasSubstr(refused));
  EXPECT_THAT(read("x = {" + deep + " = 1}\n"), HasSubstr(refused));
  EXPECT_THAT(read("x = {y = \"\"\"\n\"\"\"\"\", " + deep + " = 1}\n"),
              HasSubstr("line 2: " + refused));
  EXPECT_THAT(read("x = '''\n\\''', " + deep + " = 1\n"), HasSubstr(refused));
  EXPECT_THAT(read("x = " + repeated("[", 50'000)), HasSubstr(refused));
  EXPECT_THAT(read("x = " + repeated("{a=", 50'000)), HasSubstr(refused));
  EXPECT_EQ(read("x = " + repeated("[", 32) + repeated("]", 32) + "\n"), "read");
}

TEST(ForeignToml, DotsElsewhereAreFree) {
  const auto read = [](const std::string& text) {
    return said_of([&] { parse_toml(text, "a.toml"); });
  };
  const std::string dots(1000, '.');
  EXPECT_EQ(read("# " + dots + "\na = 1 # " + dots + "\n"), "read");
  EXPECT_EQ(read("a = \"" + dots + "\\\"" + dots + "\"\n"), "read");
  EXPECT_EQ(read("a = '" + dots + "\\'\nb = \"it's " + dots + "\"\n"), "read");
  EXPECT_EQ(read("a = \"\"\"\n" + dots + "\n\"x\"\" " + dots + "\\\"\"\"\"\n"), "read");
  EXPECT_EQ(read("a = '''\n" + dots + "''x " + dots + "'''\n"), "read");
  EXPECT_EQ(read("\"" + dots + "\" = 1\n"), "read");
  EXPECT_EQ(read("a = [" + repeated("1.5, ", 1000) + "]\n"), "read");
  EXPECT_EQ(read("a = [\n" + repeated("  [0.5, 1.5], # x.y\n", 1000) + "]\n"), "read");
  EXPECT_THAT(read("a = \"" + dots), HasSubstr("line 1: is not TOML"));
  EXPECT_THAT(read("a = \"\"\"" + dots), HasSubstr("is not TOML"));
  EXPECT_THAT(read("\""), HasSubstr("is not TOML"));
  EXPECT_THAT(read("a = 1\n\n[b\n"), HasSubstr("line 3: is not TOML"));
}

}  // namespace
}  // namespace slicecorr
