// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The text format of Prometheus, version 0.0.4.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace slicecorr::cli {

/// Writes metrics of one program, whose names all begin alike. Values that are not finite are NaN.
class Exposition {
 public:
  using Labels = std::vector<std::pair<const char*, std::string>>;
  /// `prefix`: "slicefarm_"; `common`: labels of every value.
  explicit Exposition(std::string prefix, Labels common = {})
      : prefix_(std::move(prefix)), common_(std::move(common)) {}

  /// The values that follow are of this name; `type`: counter or gauge. Each name once.
  void begin(const char* name, const char* type, const char* help);
  void value(double v, const Labels& labels = {});
  void one(const char* name, const char* type, const char* help, double v);
  /// `counts` of values up to each of `bounds`, which rise, not summed; the last count is of those
  /// above all bounds.
  void histogram(const char* name, const char* help, std::span<const double> bounds,
                 std::span<const std::uint64_t> counts, double sum);
  const std::string& text() const { return text_; }

 private:
  void line(const std::string& name, double v, const Labels& labels);

  std::string prefix_, name_, text_;
  Labels common_;
};

}  // namespace slicecorr::cli
