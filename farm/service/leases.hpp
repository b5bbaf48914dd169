// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file leases.hpp
/// Renews the leases of a service's attempts from a thread of its own, so that nothing the service
/// does can hold them up.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "slicecorr/farm/queue.hpp"

namespace slicecorr::farm::detail {

class LeaseKeeper {
 public:
  /// `wake_fd`: an eventfd that is written to when a lease is lost.
  LeaseKeeper(const std::string& database, const FarmClock& clock, const std::string& service,
              std::int64_t interval_ms, int wake_fd);
  ~LeaseKeeper();
  void add(const std::string& token);
  void remove(const std::string& token);
  void set_doing(const std::string& doing);
  /// Tokens whose lease was lost since the last call; they are no longer kept.
  std::vector<std::string> take_lost();

 private:
  void run(const std::string& database);

  const FarmClock& clock_;
  std::string service_, doing_;
  std::int64_t interval_ms_, renewed_steady_ms_;
  int wake_fd_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::set<std::string> tokens_;
  std::vector<std::string> lost_;
  bool stop_ = false, tell_ = false;
  std::thread thread_;
};

}  // namespace slicecorr::farm::detail
