// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_filled.hpp
/// A farm in a folder of its own, filled through the queue's own functions: every state, every
/// reason.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "farm_jobs.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm::test {

/// Stands still unless it is moved. Boot and start are the machine's, so that programs which go by
/// the real clock find the test's own process alive.
class HandClock : public FarmClock {
 public:
  explicit HandClock(std::int64_t wall_ms = system_clock().wall_ms()) : wall_ms_(wall_ms) {}
  std::int64_t wall_ms() const override { return wall_ms_; }
  std::int64_t steady_ms() const override { return steady_ms_; }
  std::string boot_id() const override { return system_clock().boot_id(); }
  void pass(double seconds) {
    wall_ms_ += static_cast<std::int64_t>(seconds * 1000);
    steady_ms_ += static_cast<std::int64_t>(seconds * 1000);
  }

 private:
  std::atomic<std::int64_t> wall_ms_;
  std::atomic<std::int64_t> steady_ms_{system_clock().steady_ms()};
};

inline void write_file(const std::string& path, const std::string& text) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

class Farm {
 public:
  explicit Farm(std::int64_t wall_ms = system_clock().wall_ms() - 3600'000)
      : clock(wall_ms),
        root((std::filesystem::path(::testing::TempDir()) /
              fmt::format("farm-{}-{}", ::getpid(), ++made_))
                 .string()),
        folder(open_folder(root)),
        queue(folder.database(), clock),
        service(queue.start_service("local", 2, 4000)) {}
  ~Farm() {
    std::error_code error;
    std::filesystem::remove_all(root, error);
  }
  Farm(const Farm&) = delete;
  Farm& operator=(const Farm&) = delete;

  NewJob job(const std::string& name, const std::string& key_of = {}) {
    // 64 hex digits that differ by the text.
    std::uint64_t h = 1469598103934665603ULL;
    for (const char c : key_of.empty() ? name : key_of) {
      h = (h ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
    }
    NewJob j =
        slicecorr::test::job_with_key(fmt::format("{0:016x}{0:016x}{0:016x}{0:016x}", h), name);
    j.work.printer = "dual-wavelength-dlp";
    j.work.resin = "benchy-resin";
    j.work.layers = 770;
    j.work.voxels = 200'000'000;
    j.results_folder = folder.root + "/results/";
    j.expected_s = 12;
    j.expected_bytes = 4'000'000;
    return j;
  }

  std::vector<JobId> submit(const std::vector<NewJob>& jobs) {
    return queue.submit(jobs, "anna", "test");
  }

  Claim claim() {
    ClaimRequest request;
    request.service = service;
    request.engine = "local";
    request.free_memory_mb = 4000;
    auto claim = queue.claim(request);
    if (!claim) throw std::runtime_error("nothing to claim");
    queue.record_start(claim->token, "1", 1, 400);
    return *claim;
  }

  /// The claimed job is done after some seconds of the farm's time.
  void finish(const Claim& claim, double seconds, const ResultFigures& figures,
              bool from_cache = false) {
    clock.pass(seconds);
    const std::string stem = folder.results(claim.job.id) + "/" + claim.job.name;
    ResultRecord result;
    result.figures = figures;
    result.program = "slicefarm test";
    result.wall_s = seconds;
    for (const auto& [ending, text] :
         {std::pair{"uvj", std::string(5000, 'z')},
          std::pair{"html", std::string("<!doctype html><title>part</title>the part's page")},
          std::pair{"json", std::string("{}\n")}}) {
      if (claim.job.name.find('/') == std::string::npos) {
        write_file(stem + "." + ending, text);
      }
      result.files.push_back(
          {ending, static_cast<std::int64_t>(text.size()), std::string(64, 'a')});
    }
    AttemptEnd end;
    end.node = from_cache ? "" : "night-owl";
    end.exit_code = 0;
    end.wall_s = seconds;
    end.cpu_s = seconds * 0.95;
    end.peak_mb = 180;
    ASSERT_TRUE(queue.begin_commit(claim.token));
    ASSERT_TRUE(queue.finish(claim.token, result, end, from_cache));
  }

  void give_up(const Claim& claim, double seconds, Reason reason, const std::string& message,
               const std::string& log = {}) {
    clock.pass(seconds);
    if (!log.empty()) write_file(folder.log(claim.job.id, claim.number), log);
    AttemptEnd end;
    end.reason = reason;
    end.message = message;
    end.node = "night-owl";
    end.exit_code = reason == Reason::bad_input ? 2 : 1;
    end.wall_s = seconds;
    end.cpu_s = seconds * 0.5;
    ASSERT_TRUE(queue.give_up(claim.token, end));
  }

  void set(const std::string& name, const std::string& value) {
    queue.change_settings({{name, value}}, "test");
  }

  ReadModel model() { return ReadModel(folder.database(), clock); }

  HandClock clock;
  std::string root;
  FarmFolder folder;
  Queue queue;
  std::string service;

 private:
  static inline int made_ = 0;
};

/// All reasons for which a job can end.
inline constexpr Reason kFinalReasons[] = {
    Reason::bad_input,     Reason::infeasible,     Reason::input_gone,   Reason::too_large,
    Reason::worker_killed, Reason::worker_crashed, Reason::hung,         Reason::out_of_memory,
    Reason::device_failed, Reason::output_invalid, Reason::engine_failed};

inline ResultFigures figures_with(double max_um, std::int64_t lost = 0) {
  ResultFigures f;
  f.layers = 770;
  f.height_mean_um = max_um / 20;
  f.height_p95_um = max_um / 4;
  f.height_max_um = max_um;
  f.lost_features = lost;
  f.target_voxels = 12'345'678;
  return f;
}

inline constexpr const char* kNastyName = "<img src=x onerror=alert(1)>&\"'";
/// Clears the screen, sets the title, turns the direction of writing.
inline constexpr const char* kTerminalName = "bad\033[2J\033]0;title\007\u202Ename\x80";

/// What a test knows of a filled farm.
struct Filled {
  std::vector<JobId> failed;  ///< in the order of `kFinalReasons`
  std::vector<JobId> done;
  JobId cached = 0, running = 0, follower = 0, queued = 0, again = 0, cancelled = 0, nasty = 0,
        terminal = 0;
};

/// A night: every state, every reason, names that would do harm.
inline Filled fill(Farm& farm) {
  Filled f;
  farm.set("max-attempts", "1");
  for (const Reason reason : kFinalReasons) {
    const std::string name = std::string("fails-") + name_of(reason);
    f.failed.push_back(farm.submit({farm.job(name)})[0]);
    farm.give_up(farm.claim(), 40, reason, fmt::format("what happened: {}", name_of(reason)),
                 fmt::format("slicing\nline before the last\nlast line of {}\n", name));
  }
  farm.set("max-attempts", "3");
  for (int i = 0; i < 6; ++i) {
    const auto id = farm.submit({farm.job(fmt::format("gyroid-{}", i))})[0];
    f.done.push_back(id);
    farm.finish(farm.claim(), 70 + 30 * i, figures_with(3 + 10 * i, i == 5 ? 17 : 0));
  }
  f.nasty = farm.submit({farm.job(kNastyName)})[0];
  farm.finish(farm.claim(), 30, figures_with(999));
  f.cached = farm.submit({farm.job("gyroid-again", "gyroid-0")})[0];
  farm.finish(farm.claim(), 0.1, figures_with(3), true);
  f.cancelled = farm.submit({farm.job("not-wanted")})[0];
  farm.queue.cancel(f.cancelled, "anna");
  f.again = farm.submit({farm.job("flaky")})[0];
  farm.give_up(farm.claim(), 20, Reason::worker_killed, "ended by signal 9", "half of a log\n");
  NewJob running = farm.job("elephant-40mm");
  running.priority = 9;
  f.running = farm.submit({running})[0];
  const Claim claim = farm.claim();
  farm.clock.pass(6);
  farm.queue.record_progress({{claim.token, "correct", "night-owl", 0.6, 462}});
  write_file(farm.folder.attempt(claim.token) + "/log.txt", "reading\ncorrecting\n");
  f.follower = farm.submit({farm.job("elephant-copy", "elephant-40mm")})[0];
  NewJob queued = farm.job("benchy-日本");
  queued.user = "bert";
  queued.labels = {"clear", "rush"};
  queued.priority = 5;
  queued.ready_by_ms = farm.clock.wall_ms() + 3600'000;
  f.queued = farm.submit({queued})[0];
  f.terminal = farm.submit({farm.job(kTerminalName)})[0];
  farm.queue.renew(farm.service, {claim.token}, "working");
  return f;
}

}  // namespace slicecorr::farm::test
