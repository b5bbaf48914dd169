// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_jobs.hpp
/// Jobs as the record keeps them, without inputs: for tests and benchmarks of queue and views.
#pragma once

#include <string>

#include "slicecorr/farm/queue.hpp"

namespace slicecorr::test {

inline farm::NewJob job_with_key(const std::string& key, const std::string& name = "part",
                                 const std::string& user = "anna") {
  farm::NewJob j;
  j.work.key = key;
  j.work.spec_json = "{}";
  j.work.setup_json = "{}";
  j.work.setup_hash = "hash";
  j.work.kind = "run";
  j.work.printer = "printer";
  j.work.resin = "resin";
  j.work.format = "uvj";
  j.work.rate_class = "run continuous";
  j.work.layers = 10;
  j.work.voxels = 1'000'000;
  j.work.base_memory_mb = 100;
  j.work.thread_memory_mb = 10;
  j.name = name;
  j.user = user;
  j.parts = {"/parts/" + name + ".stl"};
  j.results_folder = "/results/";
  j.expected_s = 2;
  return j;
}

}  // namespace slicecorr::test
