// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "service/leases.hpp"

#include <unistd.h>

#include <chrono>
#include <optional>

#include "slicecorr/error.hpp"

namespace slicecorr::farm::detail {

LeaseKeeper::LeaseKeeper(const std::string& database, const FarmClock& clock,
                         const std::string& service, std::int64_t interval_ms, int wake_fd)
    : clock_(clock),
      service_(service),
      interval_ms_(interval_ms),
      renewed_steady_ms_(clock.steady_ms()),
      wake_fd_(wake_fd) {
  thread_ = std::thread([this, database] { run(database); });
}

LeaseKeeper::~LeaseKeeper() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void LeaseKeeper::add(const std::string& token) {
  const std::lock_guard lock(mutex_);
  tokens_.insert(token);
}

void LeaseKeeper::remove(const std::string& token) {
  const std::lock_guard lock(mutex_);
  tokens_.erase(token);
}

void LeaseKeeper::set_doing(const std::string& doing) {
  {
    const std::lock_guard lock(mutex_);
    if (doing_ == doing) return;
    doing_ = doing;
    tell_ = true;
  }
  changed_.notify_all();
}

std::vector<std::string> LeaseKeeper::take_lost() {
  const std::lock_guard lock(mutex_);
  return std::exchange(lost_, {});
}

void LeaseKeeper::run(const std::string& database) {
  std::optional<Queue> queue;
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait_for(lock, std::chrono::milliseconds(interval_ms_),
                      [this] { return stop_ || tell_; });
    if (stop_) return;
    tell_ = false;
    const std::vector<std::string> tokens(tokens_.begin(), tokens_.end());
    const std::string doing = doing_;
    lock.unlock();
    std::vector<std::string> lost;
    const std::int64_t before = clock_.steady_ms();
    bool renewed = false;
    try {
      if (!queue) queue.emplace(database, clock_);
      lost = queue->renew(service_, tokens, doing);
      renewed = true;
    } catch (const Error&) {
      // The next try follows soon; only the age of the last success counts.
    }
    lock.lock();
    if (renewed) {
      renewed_steady_ms_ = before;
    } else if (before - renewed_steady_ms_ > kLeaseMs - interval_ms_) {
      // Other services may take these attempts over any moment: they count as lost.
      lost = tokens;
    }
    // An attempt that was finished meanwhile has no lease, which is no loss.
    for (const std::string& token : lost) {
      if (tokens_.erase(token) > 0) lost_.push_back(token);
    }
    if (!lost.empty() && wake_fd_ >= 0) {
      const std::uint64_t one = 1;
      [[maybe_unused]] const ssize_t n = ::write(wake_fd_, &one, sizeof one);
    }
  }
}

}  // namespace slicecorr::farm::detail
