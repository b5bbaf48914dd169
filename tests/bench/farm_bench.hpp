// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_bench.hpp
/// What the farm's benchmarks have in common: jobs of a long queue, and a table of times.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "farm_jobs.hpp"
#include "slicecorr/farm/clock.hpp"

namespace slicecorr::bench {

/// Prints a row of a table: what, how often, median and greatest time of one.
inline void measure(const std::string& what, int times, const std::function<void()>& action) {
  using Time = std::chrono::steady_clock;
  std::vector<double> list;
  for (int i = 0; i < times; ++i) {
    const auto begin = Time::now();
    action();
    list.push_back(std::chrono::duration<double>(Time::now() - begin).count());
  }
  std::sort(list.begin(), list.end());
  fmt::print("| {} | {} | {:.2f} ms | {:.2f} ms |\n", what, times, list[list.size() / 2] * 1e3,
             list.back() * 1e3);
}

/// Jobs of ten users, five priorities, every third with a deadline; part-000123.
inline farm::NewJob job_of(int i) {
  farm::NewJob j = test::job_with_key(fmt::format("{:064x}", i), fmt::format("part-{:06}", i),
                                      fmt::format("user-{}", i % 10));
  j.work.spec_json = std::string(400, ' ');
  j.work.setup_hash = std::string(64, 'h');
  j.work.layers = 500;
  j.work.voxels = 100'000'000;
  j.work.base_memory_mb = 300;
  if (i % 100 == 0) j.labels = {"rush"};
  j.priority = i % 5;
  if (i % 3 == 0) j.ready_by_ms = farm::system_clock().wall_ms() + i * 1000;
  return j;
}

}  // namespace slicecorr::bench
