// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The service's loop, its settings, and what it tells.

#include "slicecorr/farm/service.hpp"

#include <fmt/format.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "service/service_loop.hpp"
#include "slicecorr/farm/store.hpp"

namespace slicecorr::farm {

namespace detail {

namespace {

/// How long the service sleeps at most: a cancellation or a setting is seen within this time.
constexpr auto kLongestWait = std::chrono::milliseconds(200);
constexpr std::int64_t kOrphanIntervalMs = 5000;
constexpr std::int64_t kDiskIntervalMs = 2000;
constexpr std::int64_t kGcIntervalMs = 600'000;
/// Disks and databases may fail for so long before the service gives up.
constexpr std::int64_t kLongestTroubleMs = 600'000;

}  // namespace

ServiceLoop::ServiceLoop(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
                         const std::atomic<bool>& stop)
    : folder_(folder),
      engine_(engine),
      options_(options),
      stop_(stop),
      clock_(*options.clock),
      queue_(folder.database(), clock_),
      settings_(queue_.settings()),
      first_event_(queue_.last_event()),
      wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  int cores = 0;
  std::int64_t memory_mb = 0;
  for (const FarmNode& n : engine_.nodes()) {
    if (!n.usable) continue;
    cores += n.cores;
    memory_mb += n.memory_mb;
  }
  id_ = queue_.start_service(engine_.name(), cores, memory_mb);
  leases_ =
      std::make_unique<LeaseKeeper>(folder.database(), clock_, id_, options.renewal_ms, wake_fd_);
}
ServiceLoop::~ServiceLoop() {
  leases_.reset();
  if (wake_fd_ >= 0) ::close(wake_fd_);
}

ServiceTotals ServiceLoop::run() {
  while (!stop_) {
    bool started = false;
    try {
      if (!round(started)) break;
      trouble_since_ms_ = 0;
    } catch (const DeviceError& e) {
      endure(e);
    }
    if (!started) engine_.wait(kLongestWait, wake_fd_);
    drain_wake();
  }
  stop_running();
  engine_.tidy(true);
  totals_.failed = queue_.failed_since(first_event_);
  leases_.reset();
  queue_.stop_service(id_);
  return totals_;
}

bool ServiceLoop::round(bool& started) {
  read_settings();
  put_back_taken();
  end_lost();
  end_cancelled();
  settle_ended();
  note_progress();
  if (due(orphans_at_, kOrphanIntervalMs)) recover();
  settle_adopted();
  const std::string doing = why_idle();
  const std::string trouble = doing.empty() ? engine_.trouble() : "";
  leases_->set_doing(!doing.empty() ? doing : trouble.empty() ? "working" : trouble);
  tell_change(doing);
  tell_trouble(trouble);
  if (!doing.empty()) engine_.withdraw();
  started = doing.empty() && start_jobs();
  if (settings_.draining && running_.empty()) {
    say("drained");
    return false;
  }
  if (options_.until_empty && running_.empty() && !started && queue_.unfinished() == 0) {
    return false;
  }
  collect();
  return true;
}

void ServiceLoop::endure(const DeviceError& e) {
  const std::int64_t now = clock_.steady_ms();
  if (trouble_since_ms_ == 0) {
    trouble_since_ms_ = now;
    say(fmt::format("{}; trying on", e.what()));
  } else if (now - trouble_since_ms_ > kLongestTroubleMs) {
    throw e;
  }
  engine_.wait(std::chrono::seconds(1), -1);
}

void ServiceLoop::say(const std::string& text) {
  if (options_.say) options_.say(text);
}

bool ServiceLoop::due(std::int64_t& at, std::int64_t interval_ms) {
  const std::int64_t now = clock_.steady_ms();
  if (at != 0 && now - at < interval_ms) return false;
  at = now;
  return true;
}

void ServiceLoop::drain_wake() {
  std::uint64_t count = 0;
  [[maybe_unused]] const ssize_t n = ::read(wake_fd_, &count, sizeof count);
}

void ServiceLoop::read_settings() {
  const std::int64_t version = queue_.data_version();
  if (version == data_version_) return;
  data_version_ = version;
  settings_ = queue_.settings();
  cancellations_ = queue_.cancellations(id_);
  changed_ = true;
}

std::string ServiceLoop::why_idle() {
  if (settings_.draining) return "draining";
  if (settings_.paused) return "paused";
  if (!in_night_window(settings_, local_minute(clock_.wall_ms()))) {
    return "outside the night window";
  }
  if (due(disk_at_, kDiskIntervalMs)) {
    full_folders_.clear();
    const std::int64_t limit = settings_.min_free_mb << 20;
    std::string low;
    for (const std::string& path : {folder_.store, folder_.root}) {
      const std::int64_t free = free_bytes(path);
      if (free < limit) low = too_little_room(path, free, limit);
    }
    if (!low.empty() && disk_low_.empty()) queue_.add_event("disk_low", low);
    if (low.empty() && !disk_low_.empty()) queue_.add_event("disk_ok", "");
    disk_low_ = low;
  }
  return disk_low_.empty() ? "" : "disk full: " + disk_low_;
}

void ServiceLoop::tell_change(const std::string& doing) {
  if (doing == told_) return;
  const std::string night = "outside the night window";
  if (doing == night) queue_.add_event("night_ended", "");
  if (told_ == night && doing.empty()) queue_.add_event("night_began", "");
  say(doing.empty() ? "working" : doing);
  told_ = doing;
}

void ServiceLoop::tell_trouble(const std::string& trouble) {
  if (trouble == told_trouble_) return;
  say(trouble.empty() ? engine_.name() + " works again" : trouble);
  told_trouble_ = trouble;
}

void ServiceLoop::collect() {
  if (settings_.cache_max_mb <= 0 || !due(gc_at_, kGcIntervalMs)) return;
  GcOptions o;
  o.max_mb = settings_.cache_max_mb;
  collect_garbage(folder_, queue_, o);
}

}  // namespace detail

ServiceTotals run_service(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
                          const std::atomic<bool>& stop) {
  return detail::ServiceLoop(folder, engine, options, stop).run();
}

}  // namespace slicecorr::farm
