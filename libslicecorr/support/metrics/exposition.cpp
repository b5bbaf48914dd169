// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/metrics/exposition.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

namespace slicecorr::cli {

namespace {

std::string escape_label(const std::string& s) {
  std::string out;
  for (const char c : s) {
    if (c == '\\' || c == '"') out += '\\';
    out += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return out;
}

}  // namespace

void Exposition::begin(const char* name, const char* type, const char* help) {
  name_ = prefix_ + name;
  text_ += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n", name_, help, type);
}

void Exposition::line(const std::string& name, double v, const Labels& labels) {
  text_ += name;
  const char* before = "{";
  for (const Labels* const list : {static_cast<const Labels*>(&common_), &labels}) {
    for (const auto& [label, text] : *list) {
      text_ += fmt::format("{}{}=\"{}\"", before, label, escape_label(text));
      before = ",";
    }
  }
  if (*before == ',') text_ += "}";
  text_ += std::isfinite(v) ? fmt::format(" {}\n", v) : std::string(" NaN\n");
}

void Exposition::value(double v, const Labels& labels) { line(name_, v, labels); }

void Exposition::one(const char* name, const char* type, const char* help, double v) {
  begin(name, type, help);
  value(v);
}

void Exposition::histogram(const char* name, const char* help, std::span<const double> bounds,
                           std::span<const std::uint64_t> counts, double sum) {
  begin(name, "histogram", help);
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    all += counts[i];
    line(name_ + "_bucket", static_cast<double>(all),
         {{"le", i < bounds.size() ? fmt::format("{}", bounds[i]) : std::string("+Inf")}});
  }
  line(name_ + "_sum", sum, {});
  line(name_ + "_count", static_cast<double>(all), {});
}

}  // namespace slicecorr::cli
