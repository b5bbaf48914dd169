// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file exposition_reader.hpp
/// A strict reader of the text format of Prometheus.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

/// Of each value, as it stands in the text: "name{labels}".
using Metrics = std::map<std::string, double>;

/// The text format, strictly: HELP and TYPE before the values of a name, once; known types; label
/// syntax; no value twice; counters end in _total, others don't; histograms have buckets that rise,
/// up to +Inf, which holds as many as _count; a line end at the end.
inline Metrics check_metrics(const std::string& text) {
  Metrics metrics;
  if (text.empty() || text.back() != '\n') {
    ADD_FAILURE() << "no line end at the end";
    return metrics;
  }
  const std::regex help("# HELP ([a-zA-Z_:][a-zA-Z0-9_:]*) (.+)"),
      type("# TYPE ([a-zA-Z_:][a-zA-Z0-9_:]*) (counter|gauge|histogram)"),
      value(
          R"re(([a-zA-Z_:][a-zA-Z0-9_:]*)(\{([a-z_]+="([^"\\]|\\["\\n])*",?)*\})? (NaN|[-+0-9.e]+))re"),
      bound(R"re(,?le="([-+0-9.eInf]+)")re");
  std::set<std::string> helped, typed;
  std::string name, kind;
  struct Histogram {
    double bound = -std::numeric_limits<double>::infinity(), count = 0;
    bool sum = false, counted = false;
  };
  std::map<std::string, Histogram> histograms;  // by name and labels without le
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch m;
    if (std::regex_match(line, m, help)) {
      EXPECT_TRUE(helped.insert(m[1]).second) << line;
      name = m[1];
      continue;
    }
    if (std::regex_match(line, m, type)) {
      EXPECT_EQ(m[1], name) << line;
      EXPECT_TRUE(typed.insert(m[1]).second) << line;
      kind = m[2];
      EXPECT_EQ(kind == "counter", name.ends_with("_total")) << line;
      continue;
    }
    if (!std::regex_match(line, m, value)) {
      ADD_FAILURE() << line;
      continue;
    }
    EXPECT_TRUE(typed.contains(name)) << line;
    double number = std::numeric_limits<double>::quiet_NaN();
    if (m[5] != "NaN") {
      std::size_t used = 0;
      number = std::stod(m[5], &used);
      EXPECT_EQ(used, m[5].str().size()) << line;
    }
    if (kind == "counter") {
      EXPECT_GE(number, 0) << line;
    }
    EXPECT_TRUE(metrics.emplace(m[1].str() + m[2].str(), number).second) << line;
    if (kind != "histogram") {
      EXPECT_EQ(m[1], name) << line;
      continue;
    }
    const std::string labels = m[2], part = m[1].str().substr(name.size());
    std::string others = std::regex_replace(labels, bound, "");
    if (others == "{}") others.clear();
    Histogram& h = histograms[name + others];
    if (part == "_bucket") {
      std::smatch le;
      if (!std::regex_search(labels, le, bound)) {
        ADD_FAILURE() << "a bucket without le: " << line;
        continue;
      }
      const double at =
          le[1] == "+Inf" ? std::numeric_limits<double>::infinity() : std::stod(le[1]);
      EXPECT_GT(at, h.bound) << line;
      EXPECT_GE(number, h.count) << line;
      EXPECT_FALSE(h.sum || h.counted) << line;
      h.bound = at;
      h.count = number;
    } else if (part == "_sum") {
      h.sum = true;
    } else {
      EXPECT_EQ(part, "_count") << line;
      EXPECT_EQ(number, h.count) << line;
      EXPECT_TRUE(std::isinf(h.bound)) << "no bucket +Inf: " << line;
      h.counted = true;
    }
  }
  for (const auto& [which, h] : histograms) EXPECT_TRUE(h.sum && h.counted) << which;
  return metrics;
}

/// What promtool says, where it is installed ($PROMTOOL, or /usr/bin/promtool).
inline ::testing::AssertionResult promtool_agrees(const std::string& text) {
  const char* const named = std::getenv("PROMTOOL");
  const std::string tool = named != nullptr ? named : "/usr/bin/promtool";
  if (!std::filesystem::exists(tool)) return ::testing::AssertionSuccess();
  const TemporaryFolder folder;
  write_file(folder / "metrics.txt", to_bytes(text));
  const auto result =
      run_program({"/bin/sh", "-c", tool + " check metrics < " + (folder / "metrics.txt")});
  if (result.exit_code == 0 && (result.out + result.err).empty()) {
    return ::testing::AssertionSuccess();
  }
  return ::testing::AssertionFailure() << result.out << result.err;
}

}  // namespace slicecorr::test
