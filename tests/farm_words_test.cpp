// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Words in names and inputs of jobs: found by lists of letters, and as by looking at each job.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "farm_fixture.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;

class FarmWords : public testing::Test {
 protected:
  std::string path() const { return dir / "farm.sqlite"; }

  /// Past all of our code: what others do to the record.
  void raw(const std::string& sql) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(db);
    sqlite3_close(db);
  }
  /// As many jobs as the last one, but for their names.
  void multiply(int count) {
    raw(fmt::format(
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {}) INSERT INTO "
        "jobs(batch, state, name, user, labels, parts, priority, ready_by_ms, key, output_folder, "
        "expected_s, expected_bytes, submitted_ms) SELECT batch, state, printf('common-%05d', i), "
        "user, labels, parts, priority, ready_by_ms, key, output_folder, expected_s, "
        "expected_bytes, submitted_ms FROM n, (SELECT * FROM jobs ORDER BY id DESC LIMIT 1)",
        count));
  }
  void to_version_6() {
    for (const char* sql :
         {"DROP TRIGGER jobs_worded", "DROP TABLE job_letters", "DROP TABLE job_words",
          "DROP INDEX jobs_texts", "PRAGMA user_version = 6"}) {
      raw(sql);
    }
  }
  std::int64_t version() {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
    std::int64_t version = 0;
    sqlite3_exec(
        db, "PRAGMA user_version",
        [](void* to, int, char** values, char**) {
          *static_cast<std::int64_t*>(to) = std::stoll(values[0]);
          return 0;
        },
        &version, nullptr);
    sqlite3_close(db);
    return version;
  }

  FarmFolderOfTest dir;
  TestClock clock;
};

/// Characters of one to four bytes, and those that mean something to SQL, JSON and lists of words.
const std::vector<std::string> kLetters{"a", "b", "A", "0", "1", "é", "日", "本", "😀",  "\"", "'",
                                        "%", "*", "_", " ", "-", ".", "(",  "^",  "\\", "/"};

std::string random_text(std::mt19937& random, std::size_t least, std::size_t most) {
  std::string text;
  for (std::size_t n = least + random() % (most - least + 1); n > 0; --n) {
    text += kLetters[random() % kLetters.size()];
  }
  return text;
}

TEST_F(FarmWords, AreFoundAsByLookingAtEachJob) {
  std::mt19937 random(7);
  {
    Queue q(path(), clock);
    for (int batch = 0; batch < 4; ++batch) {
      std::vector<NewJob> jobs;
      for (int i = 0; i < 100; ++i) {
        NewJob j = job_with_key(fmt::format("k{}-{}", batch, i % 50), random_text(random, 1, 12),
                                i % 3 ? "anna" : "bert");
        j.parts = {"/" + random_text(random, 1, 9), random_text(random, 0, 3)};
        if (i % 4 == 0) j.labels = {"rush"};
        j.priority = static_cast<int>(random() % 3);
        jobs.push_back(std::move(j));
      }
      q.submit(jobs, "anna", "test");
    }
    for (JobId id = 1; id <= 400; id += 7) q.cancel(id, "test");
  }
  // More of these than are looked at one by one.
  multiply(10'050);
  ReadModel model(path(), clock);
  JobFilter all;
  all.limit = 100'000;
  const std::vector<Job> jobs = model.jobs(all);
  ASSERT_EQ(jobs.size(), 10'450U);
  // Inputs are looked for as the record has them.
  std::map<JobId, std::string> parts;
  for (const Job& j : jobs) {
    parts[j.id] = "[";
    for (const std::string& p : j.parts) {
      std::string text;
      for (const char c : p)
        text += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
      parts[j.id] += (parts[j.id].size() > 1 ? ",\"" : "\"") + text + "\"";
    }
    parts[j.id] += "]";
  }
  std::vector<std::string> words{"common",
                                 "common-00007",
                                 "co",
                                 "c",
                                 "-0",
                                 "0",
                                 "]",
                                 "\"]",
                                 "[\"",
                                 "[\"/",
                                 "zz",
                                 "z",
                                 "nothing-is-called-this",
                                 "common-common",
                                 "\xff",
                                 "\xe6\x97",
                                 std::string("a\0b", 3),
                                 "\n",
                                 "a\n[",
                                 "AND",
                                 "a OR b",
                                 "NEAR(a b)"};
  for (int i = 0; i < 300; ++i) {
    if (i % 3 == 0) {
      words.push_back(random_text(random, 1, 4));
      continue;
    }
    // A piece of what there is, from one character to another.
    const Job& j = jobs[random() % 400];
    const std::string& text = i % 3 == 1 ? j.name : parts[j.id];
    std::vector<std::size_t> places;
    for (std::size_t at = 0; at <= text.size(); ++at) {
      if (at == text.size() || (static_cast<unsigned char>(text[at]) & 0xC0) != 0x80) {
        places.push_back(at);
      }
    }
    const std::size_t from = random() % (places.size() - 1);
    const std::size_t to = from + 1 + random() % (places.size() - 1 - from);
    words.push_back(text.substr(places[from], places[to] - places[from]));
  }
  int found_jobs = 0;
  for (const std::string& word : words) {
    for (int filtered = 0; filtered < 4; ++filtered) {
      JobFilter f;
      f.limit = 100'000;
      f.text = word;
      if (filtered % 2 == 1) f.states = {JobState::queued};
      if (filtered == 2) f.user = "bert";
      if (filtered == 3) f.label = "rush";
      std::vector<JobId> want, have;
      for (const Job& j : jobs) {
        // Of a character's bytes none is found alone.
        const bool whole = (static_cast<unsigned char>(word[0]) & 0xC0) != 0x80;
        const bool there = whole && (j.name.find(word) != std::string::npos ||
                                     parts[j.id].find(word) != std::string::npos);
        if (!there || (!f.states.empty() && j.state != JobState::queued) ||
            (!f.user.empty() && j.user != f.user) || (!f.label.empty() && j.labels.empty())) {
          continue;
        }
        want.push_back(j.id);
      }
      for (const Job& j : model.jobs(f)) have.push_back(j.id);
      EXPECT_EQ(have, want) << word << " " << filtered;
      EXPECT_EQ(model.count(f), static_cast<std::int64_t>(want.size())) << word << " " << filtered;
      found_jobs += static_cast<int>(want.size());
      if (filtered != 1) continue;
      // The same in the order of the queue, a page of it.
      std::sort(want.begin(), want.end(), [&](JobId a, JobId b) {
        const Job &x = jobs[static_cast<std::size_t>(a - 1)],
                  &y = jobs[static_cast<std::size_t>(b - 1)];
        return std::tuple(-x.priority, x.ready_by_ms, x.id) <
               std::tuple(-y.priority, y.ready_by_ms, y.id);
      });
      f.order = JobFilter::Order::urgency;
      f.offset = 2;
      f.limit = 5;
      have.clear();
      for (const Job& j : model.jobs(f)) have.push_back(j.id);
      const auto from = want.begin() + std::min<std::ptrdiff_t>(2, std::ssize(want));
      const auto to = from + std::min<std::ptrdiff_t>(5, want.end() - from);
      EXPECT_EQ(have, std::vector(from, to)) << word;
    }
  }
  EXPECT_GT(found_jobs, 50'000);
}

TEST_F(FarmWords, OfAnOlderRecordAreFoundWhenItIsBroughtUp) {
  {
    Queue q(path(), clock);
    q.submit({job_with_key("k", "elephant"), job_with_key("l", "mouse")}, "anna", "test");
  }
  to_version_6();
  JobFilter f;
  f.text = "phan";
  ReadModel model(path(), clock);
  EXPECT_EQ(version(), 7);
  ASSERT_EQ(model.jobs(f).size(), 1U);
  EXPECT_EQ(model.jobs(f)[0].name, "elephant");
  // And what comes after.
  Queue(path(), clock).submit({job_with_key("m", "phantom")}, "anna", "test");
  EXPECT_EQ(model.count(f), 2);
}

/// Whoever is killed while it brings a record up leaves the older one, which the next one brings up.
TEST_F(FarmWords, AKillWhileARecordIsBroughtUpLosesNothing) {
  {
    Queue q(path(), clock);
    q.submit({job_with_key("k", "elephant")}, "anna", "test");
  }
  multiply(20'000);
  int killed = 0;
  for (int round = 0; round < 10; ++round) {
    if (version() == 7) to_version_6();
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      static_cast<void>(Queue(path(), clock));
      ::_exit(0);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1 + 12 * round));
    ::kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    killed += WIFSIGNALED(status) ? 1 : 0;
    const std::int64_t after = version();
    EXPECT_TRUE(after == 6 || after == 7) << after;
    ReadModel model(path(), clock);
    JobFilter f;
    for (const auto& [word, jobs] : std::map<std::string, int>{
             {"elephant", 20'001}, {"common", 20'000}, {"n-000", 99}, {"zz", 0}}) {
      f.text = word;
      EXPECT_EQ(model.count(f), jobs) << word;
    }
  }
  EXPECT_GT(killed, 0);
}

}  // namespace
}  // namespace slicecorr::farm
