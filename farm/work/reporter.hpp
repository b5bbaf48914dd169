// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file reporter.hpp
/// How a worker tells how far it is. Thread-safe.
#pragma once

#include <chrono>
#include <mutex>
#include <string>
#include <vector>

#include "slicecorr/farm/work.hpp"

namespace slicecorr::farm::detail {

/// A share of the whole time, 0..1.
struct Phase {
  const char* name;
  double from, until;
};

std::string host_name();

/// Tells how far the work is, in its file, and which stage it has come to.
class Reporter {
 public:
  /// The second of the phases is that in which the work is done. `order` must outlive this.
  Reporter(const std::string& folder, const WorkOrder& order, std::vector<Phase> phases);
  void begin(std::size_t phase);
  void progress(double done);
  void set_layers(int layers);

 private:
  static constexpr std::size_t kWorkPhase = 1;

  void move(double done, bool always);

  std::mutex mutex_;
  std::string folder_;
  const WorkOrder& order_;
  std::vector<Phase> phases_;
  ProgressNote note_;
  std::size_t phase_ = 0;
  bool told_working_ = false;
  int layers_ = 0;
  std::chrono::steady_clock::time_point told_{};
};

}  // namespace slicecorr::farm::detail
