// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A farm to which things happen, and what must hold whatever happens: every job ends with the files that
/// slicecorr writes, once, and nothing half-written has a final name.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <filesystem>
#include <string>
#include <vector>

#include "farm_fixture.hpp"

namespace slicecorr::farm {

class FarmFaults : public slicecorr::test::FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    quick_settings();
  }
  std::vector<Job> jobs() {
    JobFilter f;
    f.limit = 100000;
    return ReadModel(database()).jobs(f);
  }
  std::vector<Attempt> attempts(JobId id) { return ReadModel(database()).attempts(id); }
  std::vector<Reason> reasons(JobId id) {
    std::vector<Reason> list;
    for (const Attempt& a : attempts(id)) list.push_back(a.reason);
    return list;
  }
  /// Jobs that were put back for want of room wait by the clock; not in a test.
  void without_delays() {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
    sqlite3_busy_timeout(db, 10000);
    EXPECT_EQ(sqlite3_exec(db, "UPDATE jobs SET not_before_ms = 0", nullptr, nullptr, nullptr),
              SQLITE_OK);
    sqlite3_close(db);
  }
  bool all_over() {
    for (const Job& j : jobs()) {
      if (j.state == JobState::queued || j.state == JobState::running) return false;
    }
    return true;
  }
  /// Workers of this farm that live now.
  std::vector<pid_t> workers() {
    std::vector<pid_t> list;
    for (const Job& j : jobs()) {
      if (j.state != JobState::running) continue;
      for (const Attempt& a : attempts(j.id)) {
        if (a.phase == "ended" || a.engine_id.empty()) continue;
        const std::string pid = a.engine_id.substr(0, a.engine_id.find('.'));
        // The record may name the worker of a service that was killed.
        if (slicecorr::test::text_of_file("/proc/" + pid + "/cmdline").find(a.token) !=
            std::string::npos) {
          list.push_back(std::stoi(pid));
        }
      }
    }
    return list;
  }
  /// Works on after whatever happened; then all must be in order.
  void finish_and_check() {
    const slicecorr::test::RunResult r = run_all();
    ASSERT_EQ(r.exit_code, 0) << r.err;
    check();
  }
  void check() {
    for (const Job& j : jobs()) {
      SCOPED_TRACE(fmt::format("job {} {}: {}", j.id, j.name, j.message));
      EXPECT_EQ(j.state, JobState::done);
      expect_same_files(j.output_folder + "/" + j.name, reference(j.parts.at(0)));
      int ends = 0;
      for (const FarmEvent& e : ReadModel(database()).events(0, 100000, j.id))
        ends += e.kind == "done";
      EXPECT_EQ(ends, 1) << "done twice, or never";
      for (const Attempt& a : attempts(j.id)) EXPECT_EQ(a.phase, "ended");
      int successes = 0;
      for (const Attempt& a : attempts(j.id)) successes += a.reason == Reason::none;
      EXPECT_EQ(successes, 1);
    }
    EXPECT_THAT(leftovers(dir / "out"), testing::IsEmpty());
    EXPECT_TRUE(std::filesystem::is_empty(farm_dir() + "/store/attempts"));
    // What is in the cache is whole.
    const FarmFolder folder = open_folder(farm_dir());
    for (const Job& j : jobs()) {
      const auto result = Queue(database()).cached(j.key);
      ASSERT_TRUE(result);
      EXPECT_TRUE(check_cached(folder, j.key, result->files));
    }
  }
  /// Nothing under a final name is anything but whole, at any time.
  void expect_whole_outputs() {
    for (const Job& j : jobs()) {
      const std::string base = j.output_folder + "/" + j.name;
      // Reports carry the job's name.
      const bool renamed = j.name != std::filesystem::path(j.parts[0]).stem();
      for (const char* ending : {".uvj", ".html", ".json"}) {
        if (!std::filesystem::exists(base + ending) || (renamed && ending != std::string(".uvj")))
          continue;
        EXPECT_TRUE(slicecorr::test::text_of_file(base + ending) ==
                    slicecorr::test::text_of_file(reference(j.parts[0]) + ending))
            << base << ending;
      }
    }
  }
};

}  // namespace slicecorr::farm
