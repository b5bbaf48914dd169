/// @file metrics_reader.hpp
/// A strict reader of what `/metrics` gives: Prometheus' text format 0.0.4.
#pragma once

#include <gtest/gtest.h>

#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace slicecorr::test {

/// Fails the test unless: HELP and TYPE come before the values of a name, once; types are known;
/// labels have their syntax; no value comes twice; counters end in _total, others don't; the text
/// ends with a line's end.
inline void check_metrics(const std::string& text) {
  ASSERT_FALSE(text.empty());
  ASSERT_EQ(text.back(), '\n');
  const std::regex help("# HELP ([a-zA-Z_:][a-zA-Z0-9_:]*) (.+)"),
      type("# TYPE ([a-zA-Z_:][a-zA-Z0-9_:]*) (counter|gauge)"),
      value(
          R"re(([a-zA-Z_:][a-zA-Z0-9_:]*)(\{([a-z_]+="([^"\\]|\\["\\n])*",?)*\})? (NaN|[-+0-9.e]+))re");
  std::set<std::string> helped, typed, seen;
  std::string name;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch m;
    if (std::regex_match(line, m, help)) {
      EXPECT_TRUE(helped.insert(m[1]).second) << line;
      name = m[1];
    } else if (std::regex_match(line, m, type)) {
      EXPECT_EQ(m[1], name) << line;
      EXPECT_TRUE(typed.insert(m[1]).second) << line;
      EXPECT_EQ(m[2] == "counter", name.ends_with("_total")) << line;
    } else {
      ASSERT_TRUE(std::regex_match(line, m, value)) << line;
      EXPECT_EQ(m[1], name) << line;
      EXPECT_TRUE(typed.contains(m[1])) << line;
      EXPECT_TRUE(seen.insert(m[1].str() + m[2].str()).second) << line;
      if (m[5] != "NaN") {
        std::size_t used = 0;
        (void)std::stod(m[5], &used);
        EXPECT_EQ(used, m[5].str().size()) << line;
      }
    }
  }
}

}  // namespace slicecorr::test
