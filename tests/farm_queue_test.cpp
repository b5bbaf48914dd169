// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The durable queue: what must hold whoever uses it, at once and in any order.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include "farm_fixture.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string keyed(int n) { return fmt::format("k{}", n); }

class FarmQueue : public testing::Test {
 protected:
  std::string path() const { return dir / "farm.sqlite"; }
  Queue open() { return Queue(path(), clock); }
  JobId submit(Queue& q, NewJob j) { return q.submit({std::move(j)}, "anna", "test").at(0); }
  Job job(JobId id) { return *ReadModel(path(), clock).job(id); }
  /// Raw SQL, past all of our code; the error's text, empty when there was none.
  std::string raw(const std::string& sql) {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
    char* error = nullptr;
    sqlite3_exec(db, sql.c_str(), nullptr, nullptr, &error);
    const std::string text = error ? error : "";
    sqlite3_free(error);
    sqlite3_close(db);
    return text;
  }
  std::vector<std::string> rows(const std::string& sql) {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open(path().c_str(), &db), SQLITE_OK);
    std::vector<std::string> list;
    const auto add = [](void* to, int n, char** values, char**) {
      std::string row;
      for (int i = 0; i < n; ++i) row += std::string(i ? "|" : "") + (values[i] ? values[i] : "");
      static_cast<std::vector<std::string>*>(to)->push_back(row);
      return 0;
    };
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), add, &list, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
    return list;
  }

  FarmFolderOfTest dir;
  TestClock clock;
};

TEST_F(FarmQueue, AnEmptyFileIsNoNewFarm) {
  for (const std::size_t bytes : {0, 1, 100, 4096}) {
    std::ofstream(path(), std::ios::binary) << std::string(bytes, '\0');
    for (const bool read : {false, true}) {
      try {
        if (read) {
          static_cast<void>(ReadModel(path(), clock));
        } else {
          static_cast<void>(open());
        }
        ADD_FAILURE() << bytes << " bytes became a farm";
      } catch (const InputError& e) {
        EXPECT_THAT(e.what(), HasSubstr("expected the database of a farm")) << bytes;
      }
    }
    EXPECT_EQ(std::filesystem::file_size(path()), bytes);
    std::filesystem::remove(path());
  }
  // Many at once make one, whole from the moment that it is there, and leave nothing else.
  std::vector<std::thread> makers;
  for (int i = 0; i < 8; ++i) makers.emplace_back([&] { open(); });
  for (std::thread& t : makers) t.join();
  for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
    EXPECT_TRUE(entry.path().filename().string().starts_with("farm.sqlite")) << entry.path();
  }
}

TEST_F(FarmQueue, MoreUrgentJobsComeFirst) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  const auto add = [&](const char* key, int priority, std::int64_t ready_by) {
    NewJob j = job_with_key(key, key);
    j.priority = priority;
    j.ready_by_ms = ready_by;
    return submit(q, j);
  };
  const JobId last = add("a", 0, kNoDeadline), late = add("b", 0, 2000), soon = add("c", 0, 1000);
  const JobId high = add("d", 5, kNoDeadline), low = add("e", -1, 10);
  std::vector<JobId> order;
  while (const auto c = q.claim(any_job(service))) order.push_back(c->job.id);
  EXPECT_THAT(order, ElementsAre(high, soon, late, last, low));
}

TEST_F(FarmQueue, NobodyClaimsWhatAnotherHas) {
  constexpr int processes = 8, jobs = 400;
  {
    Queue q = open();
    std::vector<NewJob> list;
    for (int i = 0; i < jobs; ++i) list.push_back(job_with_key(keyed(i)));
    q.submit(list, "anna", "test");
  }
  std::vector<pid_t> children;
  for (int p = 0; p < processes; ++p) {
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      int code = 0;
      try {
        Queue q(path());
        const std::string service = q.start_service("local", 2, 1000);
        std::ofstream out(dir / ("claims" + std::to_string(p)));
        while (const auto c = q.claim(any_job(service))) {
          if (!q.begin_commit(c->token) ||
              !q.finish(c->token, some_result(), ended(Reason::none), false)) {
            code = 1;
          }
          out << c->job.id << "\n";
        }
      } catch (const std::exception&) {
        code = 2;
      }
      ::_exit(code);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(status, 0);
  }
  std::vector<JobId> claimed;
  int busy = 0;
  for (int p = 0; p < processes; ++p) {
    std::ifstream in(dir / ("claims" + std::to_string(p)));
    const std::size_t before = claimed.size();
    for (JobId id = 0; in >> id;) claimed.push_back(id);
    busy += claimed.size() > before;
  }
  std::sort(claimed.begin(), claimed.end());
  ASSERT_EQ(claimed.size(), static_cast<std::size_t>(jobs));
  EXPECT_EQ(std::adjacent_find(claimed.begin(), claimed.end()), claimed.end());
  EXPECT_GE(busy, 1);
  EXPECT_THAT(rows("SELECT state, count(*), count(DISTINCT key) FROM jobs GROUP BY state"),
              ElementsAre("done|400|400"));
  EXPECT_THAT(rows("SELECT count(*) FROM attempts"), ElementsAre("400"));
}

TEST_F(FarmQueue, TheSameWorkWaitsForTheOneThatDoesIt) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  const JobId first = submit(q, job_with_key("k", "a")), second = submit(q, job_with_key("k", "b"));
  const JobId third = submit(q, job_with_key("k", "c"));
  EXPECT_EQ(job(second).follows, first);
  EXPECT_EQ(job(third).follows, first);
  const auto c = q.claim(any_job(service));
  ASSERT_TRUE(c);
  EXPECT_EQ(c->job.id, first);
  EXPECT_FALSE(q.claim(any_job(service)));
  ASSERT_TRUE(q.begin_commit(c->token));
  ASSERT_TRUE(q.finish(c->token, some_result(), ended(Reason::none), false));
  const auto hit = q.claim(any_job(service));
  ASSERT_TRUE(hit);
  EXPECT_TRUE(hit->cached);
  EXPECT_EQ(hit->job.id, second);
  ClaimRequest only = any_job(service);
  only.cached_key = "other";
  EXPECT_FALSE(q.claim(only));
  only.cached_key = "k";
  const auto next = q.claim(only);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->job.id, third);
}

TEST_F(FarmQueue, AMoreUrgentJobWithTheSameWorkLeads) {
  Queue q = open();
  const JobId first = submit(q, job_with_key("k", "a"));
  NewJob urgent = job_with_key("k", "b");
  urgent.priority = 9;
  const JobId second = submit(q, urgent);
  EXPECT_EQ(job(first).follows, second);
  EXPECT_EQ(job(second).follows, 0);
  ASSERT_TRUE(q.set_priority(first, 10, "anna"));
  EXPECT_EQ(job(second).follows, first);
}

TEST_F(FarmQueue, WhenTheLeaderIsCancelledTheNextOneLeads) {
  Queue q = open();
  const JobId first = submit(q, job_with_key("k", "a")), second = submit(q, job_with_key("k", "b"));
  const JobId third = submit(q, job_with_key("k", "c"));
  EXPECT_EQ(q.cancel(first, "anna"), CancelOutcome::cancelled);
  EXPECT_EQ(job(first).state, JobState::cancelled);
  EXPECT_EQ(job(second).follows, 0);
  EXPECT_EQ(job(third).follows, second);
}

TEST_F(FarmQueue, BadInputFailsAllThatShareItAndIsNotTriedAgain) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  const JobId first = submit(q, job_with_key("k", "a")), second = submit(q, job_with_key("k", "b"));
  const auto c = q.claim(any_job(service));
  ASSERT_TRUE(q.give_up(c->token, ended(Reason::bad_input, "no mesh")));
  for (const JobId id : {first, second}) {
    EXPECT_EQ(job(id).state, JobState::failed);
    EXPECT_EQ(job(id).reason, Reason::bad_input);
    EXPECT_EQ(job(id).message, "no mesh");
  }
  EXPECT_FALSE(q.claim(any_job(service)));
}

TEST_F(FarmQueue, RetriesAreCappedWithReasonsAndDelays) {
  Queue q = open();
  q.change_settings({{"max-attempts", "3"}, {"retry-delay-s", "5"}}, "anna");
  const std::string service = q.start_service("local", 2, 1000);
  const JobId id = submit(q, job_with_key("k"));
  for (const std::int64_t delay_ms : {5000, 10000}) {
    const auto c = q.claim(any_job(service));
    ASSERT_TRUE(c);
    ASSERT_TRUE(q.give_up(c->token, ended(Reason::worker_killed)));
    EXPECT_EQ(job(id).state, JobState::queued);
    EXPECT_EQ(job(id).reason, Reason::worker_killed);
    EXPECT_EQ(job(id).not_before_ms, clock.wall + delay_ms);
    EXPECT_FALSE(q.claim(any_job(service)));
    clock.wall += delay_ms;
  }
  const auto c = q.claim(any_job(service));
  ASSERT_TRUE(c);
  EXPECT_EQ(c->number, 3);
  ASSERT_TRUE(q.give_up(c->token, ended(Reason::worker_killed)));
  EXPECT_EQ(job(id).state, JobState::failed);
  EXPECT_EQ(job(id).attempts, 3);
  ASSERT_TRUE(q.retry(id, "anna"));
  EXPECT_EQ(job(id).attempts, 0);
  EXPECT_TRUE(q.claim(any_job(service)));
}

TEST_F(FarmQueue, ReasonsDecide) {
  struct Row {
    Reason reason;
    JobState state;
    int counted;
  };
  const Row table[] = {
      {Reason::bad_input, JobState::failed, 1},      {Reason::infeasible, JobState::failed, 1},
      {Reason::input_gone, JobState::failed, 1},     {Reason::too_large, JobState::failed, 1},
      {Reason::worker_killed, JobState::queued, 1},  {Reason::worker_crashed, JobState::queued, 1},
      {Reason::hung, JobState::queued, 1},           {Reason::lease_lost, JobState::queued, 0},
      {Reason::stopped, JobState::queued, 0},        {Reason::out_of_memory, JobState::queued, 1},
      {Reason::disk_full, JobState::queued, 0},      {Reason::device_failed, JobState::queued, 1},
      {Reason::output_invalid, JobState::queued, 1}, {Reason::engine_failed, JobState::queued, 1},
      {Reason::cancelled, JobState::cancelled, 0}};
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  for (const Row& row : table) {
    SCOPED_TRACE(name_of(row.reason));
    EXPECT_EQ(reason_named(name_of(row.reason)), row.reason);
    const JobId id = submit(q, job_with_key(std::string("k") + name_of(row.reason)));
    NewJob urgent;
    ASSERT_TRUE(q.set_priority(id, 100 + static_cast<int>(id), "anna"));
    const auto c = q.claim(any_job(service));
    ASSERT_TRUE(c);
    ASSERT_EQ(c->job.id, id);
    ASSERT_TRUE(q.give_up(c->token, ended(row.reason)));
    EXPECT_EQ(job(id).state, row.state);
    EXPECT_EQ(job(id).attempts, row.counted);
    EXPECT_EQ(job(id).reason, row.reason);
    EXPECT_EQ(job(id).token, "");
  }
}

TEST_F(FarmQueue, AJobThatTakesItsServiceWithItIsGivenUpAtLast) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  const JobId id = submit(q, job_with_key("k"));
  int tries = 0;
  while (const auto c = q.claim(any_job(service))) {
    ++tries;
    ASSERT_LE(tries, 100);
    q.give_up(c->token, ended(Reason::lease_lost));
  }
  EXPECT_EQ(job(id).state, JobState::failed);
  EXPECT_GT(tries, 10);
}

TEST_F(FarmQueue, ADiskThatStaysFullIsWaitedForLongerAndLonger) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  const JobId id = submit(q, job_with_key("k"));
  std::int64_t last = 0;
  for (int i = 0; i < 12; ++i) {
    const auto c = q.claim(any_job(service));
    ASSERT_TRUE(c) << i;
    q.give_up(c->token, ended(Reason::disk_full));
    const std::int64_t delay = job(id).not_before_ms - clock.wall;
    EXPECT_GE(delay, last);
    EXPECT_LE(delay, kLongestDelayMs);
    last = delay;
    clock.wall += delay;
  }
  EXPECT_EQ(last, kLongestDelayMs);
  EXPECT_EQ(job(id).state, JobState::queued);
}

TEST_F(FarmQueue, AnOldTokenChangesNothing) {
  Queue a = open(), b = open();
  const std::string service = a.start_service("local", 2, 1000);
  const JobId id = submit(a, job_with_key("k"));
  const auto first = a.claim(any_job(service));
  ASSERT_TRUE(a.give_up(first->token, ended(Reason::lease_lost)));
  const auto second = b.claim(any_job(service));
  ASSERT_TRUE(second);
  EXPECT_NE(first->token, second->token);
  // The first attempt comes back: nobody listens.
  EXPECT_FALSE(a.begin_commit(first->token));
  EXPECT_FALSE(a.finish(first->token, some_result(), ended(Reason::none), false));
  EXPECT_EQ(a.give_up(first->token, ended(Reason::bad_input)), std::nullopt);
  EXPECT_EQ(job(id).state, JobState::running);
  EXPECT_EQ(job(id).token, second->token);
  // Nor can anything be finished that was not begun.
  EXPECT_FALSE(b.finish(second->token, some_result(), ended(Reason::none), false));
  ASSERT_TRUE(b.begin_commit(second->token));
  ASSERT_TRUE(b.finish(second->token, some_result(), ended(Reason::none), false));
  EXPECT_FALSE(b.finish(second->token, some_result(), ended(Reason::none), false));
  EXPECT_EQ(job(id).state, JobState::done);
  EXPECT_THAT(rows("SELECT count(*) FROM events WHERE kind = 'done'"), ElementsAre("1"));
}

TEST_F(FarmQueue, LeasesExpireBySteadyTimeOnly) {
  Queue a = open(), b = open();
  const std::string one = a.start_service("local", 2, 1000);
  const std::string two = b.start_service("local", 2, 1000);
  submit(a, job_with_key("k"));
  const auto c = a.claim(any_job(one));
  // Clocks that are set, either way, take no lease away.
  for (const std::int64_t jump : {-86'400'000, 2 * 86'400'000}) {
    clock.wall += jump;
    EXPECT_THAT(b.orphans(), IsEmpty());
    EXPECT_FALSE(b.adopt(c->token, two));
  }
  clock.steady += kLeaseRenewalMs * 3;
  EXPECT_THAT(a.renew(one, {c->token}, ""), IsEmpty());
  clock.steady += kLeaseMs;
  EXPECT_THAT(b.orphans(), IsEmpty()) << "renewed until exactly now";
  clock.steady += 1;
  ASSERT_EQ(b.orphans().size(), 1u);
  EXPECT_TRUE(b.orphans()[0].lease_expired);
  EXPECT_TRUE(b.orphans()[0].owner_alive) << "this very process";
  ASSERT_TRUE(b.adopt(c->token, two));
  EXPECT_FALSE(a.adopt(c->token, one)) << "adopted a moment ago";
  // The old owner hears that it lost.
  EXPECT_THAT(a.renew(one, {c->token}, ""), ElementsAre(c->token));
  EXPECT_THAT(b.renew(two, {c->token}, ""), IsEmpty());
}

TEST_F(FarmQueue, AfterAnotherStartOfTheMachineAllLeasesAreOver) {
  Queue a = open();
  const std::string one = a.start_service("local", 2, 1000);
  submit(a, job_with_key("k"));
  const auto c = a.claim(any_job(one));
  clock.boot = "another start";
  clock.steady = 1;  // began anew
  ASSERT_EQ(a.orphans().size(), 1u);
  EXPECT_FALSE(a.orphans()[0].owner_alive);
  const std::string two = a.start_service("local", 2, 1000);
  EXPECT_TRUE(a.adopt(c->token, two));
}

TEST_F(FarmQueue, AServiceWhoseProcessIsGoneLosesItsAttemptsAtOnce) {
  Queue q = open();
  submit(q, job_with_key("k"));
  const pid_t child = ::fork();
  if (child == 0) {
    Queue mine(path(), clock);
    const std::string service = mine.start_service("local", 2, 1000);
    ::_exit(mine.claim(any_job(service)) ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_EQ(status, 0);
  const auto orphans = q.orphans();
  ASSERT_EQ(orphans.size(), 1u);
  EXPECT_FALSE(orphans[0].owner_alive);
  EXPECT_FALSE(orphans[0].lease_expired);
  EXPECT_TRUE(q.adopt(orphans[0].attempt.token, q.start_service("local", 2, 1000)));
}

TEST_F(FarmQueue, OnlyOneOfManyAdoptsAnOrphan) {
  Queue q = open();
  const std::string gone = q.start_service("local", 2, 1000);
  submit(q, job_with_key("k"));
  const auto c = q.claim(any_job(gone));
  clock.steady += kLeaseMs + 1;
  std::atomic<int> adopted{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      Queue mine(path(), clock);
      const std::string service = mine.start_service("local", 2, 1000);
      if (mine.adopt(c->token, service)) ++adopted;
    });
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(adopted, 1);
}

TEST_F(FarmQueue, AClockSetBackDoesNotHoldRetriesForever) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  submit(q, job_with_key("k"));
  const auto c = q.claim(any_job(service));
  q.give_up(c->token, ended(Reason::worker_killed));
  EXPECT_FALSE(q.claim(any_job(service))) << "its delay is not over";
  clock.wall -= 86'400'000;
  EXPECT_TRUE(q.claim(any_job(service)));
}

TEST_F(FarmQueue, CancelInEveryState) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  EXPECT_EQ(q.cancel(77, "anna"), CancelOutcome::unknown);
  const JobId queued = submit(q, job_with_key("a"));
  EXPECT_EQ(q.cancel(queued, "anna"), CancelOutcome::cancelled);
  EXPECT_EQ(q.cancel(queued, "anna"), CancelOutcome::too_late);
  // Running: its service is asked, and whatever the attempt ends with, the job is cancelled.
  const JobId running = submit(q, job_with_key("b"));
  auto c = q.claim(any_job(service));
  EXPECT_EQ(q.cancel(running, "anna"), CancelOutcome::asked);
  EXPECT_THAT(q.cancellations(service), ElementsAre(c->token));
  EXPECT_FALSE(q.begin_commit(c->token));
  ASSERT_TRUE(q.give_up(c->token, ended(Reason::worker_killed)));
  EXPECT_EQ(job(running).state, JobState::cancelled);
  EXPECT_THAT(q.cancellations(service), IsEmpty());
  // Committing: too late.
  const JobId committing = submit(q, job_with_key("c"));
  c = q.claim(any_job(service));
  ASSERT_TRUE(q.begin_commit(c->token));
  EXPECT_EQ(q.cancel(committing, "anna"), CancelOutcome::too_late);
  ASSERT_TRUE(q.finish(c->token, some_result(), ended(Reason::none), false));
  EXPECT_EQ(job(committing).state, JobState::done);
  EXPECT_EQ(q.cancel(committing, "anna"), CancelOutcome::too_late);
  EXPECT_FALSE(q.retry(committing, "anna"));
  EXPECT_TRUE(q.retry(running, "anna"));
}

TEST_F(FarmQueue, UsersHaveLimits) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  q.change_settings({{"user-running", "1"}, {"user-running.berta", "2"}}, "root");
  for (const char* user : {"anna", "berta"}) {
    for (int i = 0; i < 3; ++i) {
      submit(q, job_with_key(user + std::to_string(i), user + std::to_string(i), user));
    }
  }
  std::map<std::string, int> running;
  while (const auto c = q.claim(any_job(service))) ++running[c->job.user];
  EXPECT_EQ(running["anna"], 1);
  EXPECT_EQ(running["berta"], 2);
  q.change_settings({{"user-queued", "4"}}, "root");
  submit(q, job_with_key("x", "x", "anna"));
  try {
    submit(q, job_with_key("y", "y", "anna"));
    FAIL() << "more than 4";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("user-queued"));
  }
  EXPECT_THAT(rows("SELECT count(*) FROM jobs WHERE name = 'y'"), ElementsAre("0"));
}

TEST_F(FarmQueue, MemoryIsWaitedForAndOvertakenOnlyWhenAllowed) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  NewJob large = job_with_key("large", "large");
  large.work.base_memory_mb = 900;
  large.priority = 1;
  submit(q, large);
  const JobId small = submit(q, job_with_key("small", "small"));
  ClaimRequest r = any_job(service);
  r.free_memory_mb = 500;
  r.may_overtake = false;
  EXPECT_FALSE(q.claim(r));
  r.may_overtake = true;
  const auto c = q.claim(r);
  ASSERT_TRUE(c);
  EXPECT_EQ(c->job.id, small);
}

TEST_F(FarmQueue, WhatRanOutOfMemoryNeedsTwiceAsMuch) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  submit(q, job_with_key("k"));
  auto c = q.claim(any_job(service));
  q.record_start(c->token, "1", 1, 150);
  q.give_up(c->token, ended(Reason::out_of_memory));
  clock.wall += kLongestDelayMs;
  ClaimRequest r = any_job(service);
  r.free_memory_mb = 299;  // it had 150
  EXPECT_FALSE(q.claim(r));
  r.free_memory_mb = 300;
  c = q.claim(r);
  ASSERT_TRUE(c);
  EXPECT_EQ(c->memory_failures, 1);
  EXPECT_EQ(c->last_memory_mb, 150);
}

TEST_F(FarmQueue, WhatNeedsMoreThanThereEverIsDoesNotWaitForEver) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 250);
  submit(q, job_with_key("k"));
  auto c = q.claim(any_job(service));
  q.record_start(c->token, "1", 1, 150);
  q.give_up(c->token, ended(Reason::out_of_memory));
  clock.wall += kLongestDelayMs;
  ClaimRequest r = any_job(service);
  r.largest_memory_mb = 250;  // less than twice what it had
  r.free_memory_mb = 249;
  EXPECT_FALSE(q.claim(r)) << "others have some of it now";
  r.free_memory_mb = 250;
  EXPECT_TRUE(q.claim(r)) << "it gets all there is, or is refused";
}

TEST_F(FarmQueue, TheSameOutputIsNotPromisedTwice) {
  Queue q = open();
  NewJob j = job_with_key("a", "part");
  j.output_folder = "/out";
  const JobId id = submit(q, j);
  NewJob other = job_with_key("b", "part");
  other.output_folder = "/out";
  EXPECT_EQ(q.unfinished_output("/out", "part"), id);
  EXPECT_THROW(submit(q, other), InputError);
  q.cancel(id, "anna");
  EXPECT_EQ(q.unfinished_output("/out", "part"), 0);
  submit(q, other);
}

TEST_F(FarmQueue, EventsCanOnlyBeAdded) {
  Queue q = open();
  submit(q, job_with_key("k"));
  EXPECT_THAT(raw("UPDATE events SET text = 'x'"), HasSubstr("append-only"));
  EXPECT_THAT(raw("DELETE FROM events"), HasSubstr("append-only"));
  EXPECT_EQ(raw("INSERT INTO events(at_ms, kind, text) VALUES(1, 'x', 'y')"), "");
}

TEST_F(FarmQueue, ForeignAndNewerDatabasesAreRefusedByName) {
  const auto message = [&](const std::string& file) -> std::string {
    try {
      Queue q(file, clock);
      return "";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(file));
      return e.what();
    }
  };
  { Queue q = open(); }
  EXPECT_EQ(raw("PRAGMA user_version = 1000"), "");
  EXPECT_THAT(message(path()), HasSubstr("newer"));
  EXPECT_EQ(raw("PRAGMA application_id = 1"), "");
  EXPECT_THAT(message(path()), HasSubstr("another program"));
  write_file(dir / "text", std::string(5000, 'x'));
  EXPECT_THAT(message(dir / "text"), HasSubstr("expected the database of a farm"));
  EXPECT_THROW(ReadModel(dir / "nothing"), InputError);
  EXPECT_FALSE(fs::exists(dir / "nothing"));
  write_file(dir / "empty", "");
  EXPECT_THROW(ReadModel(dir / "empty"), InputError);
  EXPECT_THROW(Queue((dir / "no") + "/such/folder"), DeviceError);
}

TEST_F(FarmQueue, AListThatTheDiskChangedIsNoDefectOfTheProgram) {
  Queue q = open();
  submit(q, job_with_key("k"));
  ASSERT_EQ(raw("UPDATE jobs SET parts = '[\"a' || char(1)"), "");
  try {
    ReadModel(path(), clock).jobs({});
    FAIL() << "read";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::AllOf(HasSubstr(path()), HasSubstr("damaged")));
  }
}

// Found by the fuzzer of records: the refusal did not say whose setting it is.
TEST_F(FarmQueue, ASettingThatTheDiskChangedIsRefusedByTheRecordsName) {
  Queue q = open();
  ASSERT_EQ(raw("INSERT INTO settings (name, value) VALUES ('', '1')"), "");
  try {
    ReadModel(path(), clock).settings();
    FAIL() << "read";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::AllOf(HasSubstr(path()), HasSubstr("is no setting")));
  }
}

TEST_F(FarmQueue, ManyJobsAreListedByTheirIndexesAndCountedByTriggers) {
  Queue q = open();
  std::vector<NewJob> jobs;
  for (int i = 0; i < 60; ++i) {
    NewJob j = job_with_key(fmt::format("k{}", i), fmt::format("part-{}", i), i % 2 ? "a" : "b");
    if (i % 3 == 0) j.labels = {"rush", "rush"};
    j.priority = i % 4;
    jobs.push_back(j);
  }
  q.submit(jobs, "a", "test");
  ReadModel model(path(), clock);
  // Against a look at all of them.
  const std::vector<Job> all = model.jobs({});
  ASSERT_EQ(all.size(), 60U);
  using Order = JobFilter::Order;
  for (const std::string user : {"", "a", "b"}) {
    for (const std::string label : {"", "rush", "none"}) {
      for (const Order order : {Order::id, Order::newest, Order::urgency}) {
        for (const std::int64_t offset : {0, 7}) {
          JobFilter f;
          f.states = {JobState::queued};
          if (order != Order::urgency && label.empty() && offset == 0) f.states.clear();
          f.user = user;
          f.label = label;
          f.order = order;
          f.offset = offset;
          std::vector<Job> want;
          for (const Job& j : all) {
            const bool labelled = label.empty() || (!j.labels.empty() && label == "rush");
            if ((user.empty() || j.user == user) && labelled) want.push_back(j);
          }
          EXPECT_EQ(model.count(f), static_cast<std::int64_t>(want.size()));
          std::sort(want.begin(), want.end(), [&](const Job& x, const Job& y) {
            if (order == Order::newest) return x.id > y.id;
            if (order == Order::urgency && x.priority != y.priority) return x.priority > y.priority;
            return x.id < y.id;
          });
          want.erase(want.begin(),
                     want.begin() + std::min<std::ptrdiff_t>(offset, std::ssize(want)));
          std::vector<JobId> ids, wanted;
          for (const Job& j : model.jobs(f)) ids.push_back(j.id);
          for (const Job& j : want) wanted.push_back(j.id);
          EXPECT_EQ(ids, wanted) << user << " " << label << " " << static_cast<int>(order);
        }
      }
    }
  }
}

TEST_F(FarmQueue, ARecordOfVersion1IsBroughtUp) {
  {
    Queue q = open();
    submit(q, job_with_key("k"));
  }
  for (const char* sql :
       {"DROP TABLE tomo_works", "DROP TABLE tomo_results", "DROP TABLE stack_times",
        "DROP TABLE stack_verdicts", "DROP TABLE scans", "DROP TABLE scan_nexts",
        "DROP INDEX jobs_in_state", "DROP INDEX jobs_of_user", "DROP INDEX jobs_queued_of_user",
        "DROP TRIGGER jobs_labelled", "DROP TABLE job_labels", "DROP TRIGGER jobs_worded",
        "DROP TABLE job_letters", "DROP TABLE job_words", "DROP INDEX jobs_texts",
        "PRAGMA user_version = 1"}) {
    ASSERT_EQ(raw(sql), "");
  }
  // By whoever comes first, if only to read.
  EXPECT_EQ(ReadModel(path(), clock).jobs({}).at(0).name, "part");
  EXPECT_THAT(rows("PRAGMA user_version"), ElementsAre("7"));
  Queue q = open();
  NewJob tomo = job_with_key("t");
  tomo.work.voxel_angle_steps = 4'000'000;
  tomo.work.rate_class = "tomo osmo";
  tomo.priority = 1;
  submit(q, tomo);
  const auto c = q.claim(any_job(q.start_service("local", 1, 1000)));
  ASSERT_TRUE(q.begin_commit(c->token));
  ResultRecord result = some_result();
  const double none = std::numeric_limits<double>::infinity();
  result.figures.tomo = TomoFigures{1.25, none, 0.001, 7, 100.8, false};
  AttemptEnd e = ended(Reason::none);
  e.cpu_s = kFixedJobS + 2;
  ASSERT_TRUE(q.finish(c->token, result, e, false));
  EXPECT_NEAR(q.rates("tomo osmo").units_per_s, 2e6, 1);
  for (const ResultFigures& f :
       {*ReadModel(path(), clock).job(c->job.id)->figures, q.cached("t")->figures}) {
    ASSERT_TRUE(f.tomo);
    EXPECT_EQ(f.tomo->contrast, 1.25);
    EXPECT_EQ(f.tomo->contrast_bound, none);
    EXPECT_EQ(f.tomo->ver, 0.001);
    EXPECT_EQ(f.tomo->turns, 7);
    EXPECT_EQ(f.tomo->print_time_s, 100.8);
    EXPECT_FALSE(f.tomo->feasible);
  }
}

TEST_F(FarmQueue, TimesOfPrintsAreKept) {
  // Lifts known, not known, and a result of which no time was told.
  const std::vector<std::optional<StackTime>> times{StackTime{120, 900.5}, StackTime{120, {}}, {}};
  for (std::size_t i = 0; i < times.size(); ++i) {
    Queue q = open();
    const std::string key = "k" + std::to_string(i);
    submit(q, job_with_key(key));
    const auto c = q.claim(any_job(q.start_service("local", 1, 1000)));
    ASSERT_TRUE(q.begin_commit(c->token));
    ResultRecord result = some_result();
    result.figures.time = times[i];
    ASSERT_TRUE(q.finish(c->token, result, ended(Reason::none), false));
    for (const ResultFigures& f :
         {*ReadModel(path(), clock).job(c->job.id)->figures, q.cached(key)->figures}) {
      ASSERT_EQ(f.time.has_value(), times[i].has_value());
      if (!f.time) continue;
      EXPECT_EQ(f.time->light_s, 120);
      EXPECT_EQ(f.time->print_s, times[i]->print_s);
    }
  }
  ResultFigures f;
  f.time = StackTime{120, 900.5};
  EXPECT_THAT(in_words(f), HasSubstr("prints in 15 min"));
  f.time = StackTime{120, {}};
  EXPECT_THAT(in_words(f), HasSubstr("of light, lifts not known"));
  f.verdict = ResultVerdict{"look", "Prints. One gap is narrow."};
  EXPECT_THAT(in_words(f), testing::StartsWith("Prints. One gap is narrow. (largest height error"));
}

TEST_F(FarmQueue, WhatPrintsComeToIsKept) {
  // Of a result that was made before it was told there is none.
  const std::vector<std::optional<ResultVerdict>> verdicts{ResultVerdict{"fails", "Breaks."}, {}};
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    Queue q = open();
    const std::string key = "k" + std::to_string(i);
    submit(q, job_with_key(key));
    const auto c = q.claim(any_job(q.start_service("local", 1, 1000)));
    ASSERT_TRUE(q.begin_commit(c->token));
    ResultRecord result = some_result();
    result.figures.verdict = verdicts[i];
    ASSERT_TRUE(q.finish(c->token, result, ended(Reason::none), false));
    const Job job = *ReadModel(path(), clock).job(c->job.id);
    for (const ResultFigures& f : {*job.figures, q.cached(key)->figures}) {
      ASSERT_EQ(f.verdict.has_value(), verdicts[i].has_value());
      if (!f.verdict) continue;
      EXPECT_EQ(f.verdict->outcome, "fails");
      EXPECT_EQ(f.verdict->words, "Breaks.");
    }
    EXPECT_EQ(job_json(job).find("Breaks.") != std::string::npos, verdicts[i].has_value());
  }
}

TEST_F(FarmQueue, ManyMakeTheSameDatabaseAtOnce) {
  std::atomic<int> failed{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&, i] {
      try {
        Queue q(path(), clock);
        q.submit({job_with_key(keyed(i))}, "anna", "test");
      } catch (const std::exception&) {
        ++failed;
      }
    });
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(failed, 0);
  EXPECT_THAT(rows("SELECT count(*) FROM jobs"), ElementsAre("8"));
}

TEST_F(FarmQueue, AWriterWaitsForAnother) {
  Queue q = open();
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open(path().c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  std::atomic<bool> begun{false}, done{false};
  std::thread writer([&] {
    Queue mine(path(), clock);
    begun = true;
    mine.submit({job_with_key("k")}, "anna", "test");
    done = true;
  });
  while (!begun) std::this_thread::yield();
  // Readers don't wait, and see nothing of it.
  EXPECT_EQ(ReadModel(path(), clock).count({}), 0);
  EXPECT_FALSE(done) << "it can't be done while the lock is held";
  ASSERT_EQ(sqlite3_exec(other, "COMMIT", nullptr, nullptr, nullptr), SQLITE_OK);
  writer.join();
  sqlite3_close(other);
  EXPECT_EQ(ReadModel(path(), clock).count({}), 1);
}

TEST_F(FarmQueue, RatesFollowWhatWasMeasured) {
  Queue q = open();
  const std::string service = q.start_service("local", 2, 1000);
  EXPECT_EQ(q.rates("run continuous").units_per_s, 0);
  for (int i = 0; i < 300; ++i) {
    submit(q, job_with_key(keyed(i)));
    const auto c = q.claim(any_job(service));
    ASSERT_TRUE(q.begin_commit(c->token));
    AttemptEnd e = ended(Reason::none);
    // First slow, then at 10 million voxels per second besides the fixed part.
    e.cpu_s = kFixedJobS + (i < 50 ? 10.0 : 0.1);
    ASSERT_TRUE(q.finish(c->token, some_result(), e, false));
  }
  // After 250 more what the slow ones weigh: 0.98^250 * 50 * 10 of about 5 s, in seconds.
  EXPECT_NEAR(q.rates("run continuous").units_per_s, 1e7, 0.5e7);
  EXPECT_EQ(q.rates("run continuous").samples, 300);
  EXPECT_EQ(q.rates("run layerwise").samples, 0);
}

TEST_F(FarmQueue, SettingsAreCheckedAndKept) {
  Queue q = open();
  q.change_settings({{"night", "20:00-07:00"}, {"min-free-mb", "77"}, {"user-running.x", "3"}},
                    "a");
  const FarmSettings s = open().settings();
  EXPECT_EQ(s.night_from, 20 * 60);
  EXPECT_EQ(s.night_until, 7 * 60);
  EXPECT_EQ(s.min_free_mb, 77);
  EXPECT_EQ(running_limit(s, "x"), 3);
  EXPECT_EQ(running_limit(s, "y"), 0);
  for (const auto& [name, value] :
       std::vector<std::pair<std::string, std::string>>{{"night", "25:00-07:00"},
                                                        {"night", "20:00"},
                                                        {"night", "07:00-07:00"},
                                                        {"min-free-mb", "-1"},
                                                        {"min-free-mb", "1x"},
                                                        {"hang-s", "0"},
                                                        {"paused", "maybe"},
                                                        {"max-attempts", "0"},
                                                        {"colour", "red"}}) {
    SCOPED_TRACE(name + "=" + value);
    EXPECT_THROW(q.change_settings({{"min-free-mb", "5"}, {name, value}}, "a"), InputError);
  }
  EXPECT_EQ(open().settings(), s) << "all or nothing";
  for (int minute = 0; minute < 24 * 60; ++minute) {
    EXPECT_EQ(in_night_window(s, minute), minute >= 20 * 60 || minute < 7 * 60);
  }
}

/// Whatever is done in whatever order, the record stays in order.
TEST_F(FarmQueue, InvariantsHoldForRandomWork) {
  std::mt19937 random(20260301);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  Queue q = open();
  q.change_settings({{"retry-delay-s", "0"}, {"max-attempts", "2"}}, "a");
  std::vector<std::string> services = {q.start_service("local", 2, 1000),
                                       q.start_service("local", 2, 1000)};
  std::vector<std::string> tokens;  // every token there ever was
  const Reason reasons[] = {Reason::worker_killed, Reason::bad_input,     Reason::lease_lost,
                            Reason::stopped,       Reason::out_of_memory, Reason::disk_full};
  for (int step = 0; step < 3000; ++step) {
    // Mostly of late attempts, sometimes of one long gone.
    const int known = static_cast<int>(tokens.size());
    const int back = pick(10) ? pick(std::min(known, 6) + 1) : pick(known + 1);
    const std::string token =
        back == 0 ? "none" : tokens[tokens.size() - static_cast<std::size_t>(back)];
    switch (pick(9)) {
      case 0: {
        NewJob j = job_with_key(keyed(pick(12)), "n", pick(2) ? "anna" : "berta");
        j.priority = pick(3);
        submit(q, j);
        break;
      }
      case 1:
      case 2:
        if (const auto c = q.claim(any_job(services[static_cast<std::size_t>(pick(2))]))) {
          tokens.push_back(c->token);
        }
        break;
      case 3:
        q.begin_commit(token);
        break;
      case 4:
        q.finish(token, some_result(), ended(Reason::none), pick(2) == 0);
        break;
      case 5:
        q.give_up(token, ended(reasons[pick(6)]));
        break;
      case 6:
        q.cancel(1 + pick(60), "a");
        break;
      case 7:
        q.retry(1 + pick(60), "a");
        break;
      case 8:
        if (pick(4) == 0) q.forget_result(keyed(pick(12)), "");
        if (pick(4) == 0) q.set_priority(1 + pick(60), pick(5), "a");
        clock.wall += pick(400'000);
        break;
    }
    if (step % 10 != 0) continue;
    // A running job has an open attempt, and every open attempt a running job.
    EXPECT_THAT(rows("SELECT id FROM jobs WHERE state = 'running' AND NOT EXISTS(SELECT 1 "
                     "FROM attempts a WHERE a.token = jobs.token AND a.phase <> 'ended')"),
                IsEmpty());
    EXPECT_THAT(rows("SELECT token FROM attempts a WHERE phase <> 'ended' AND NOT EXISTS(SELECT 1 "
                     "FROM jobs j WHERE j.token = a.token AND j.state = 'running')"),
                IsEmpty());
    // Of the unfinished jobs with a key one leads, unless the result is there.
    EXPECT_THAT(rows("SELECT key FROM jobs WHERE state IN ('queued', 'running') AND follows = 0 "
                     "AND key NOT IN (SELECT key FROM results WHERE stored) "
                     "GROUP BY key HAVING count(*) > 1 AND sum(state = 'running') <= 1"),
                IsEmpty());
    // Nobody waits for a job that is over, and nobody but queued jobs waits.
    EXPECT_THAT(rows("SELECT id FROM jobs j WHERE follows <> 0 "
                     "AND (state <> 'queued' OR NOT EXISTS(SELECT 1 FROM jobs l "
                     "WHERE l.id = j.follows AND l.key = j.key "
                     "AND l.state IN ('queued', 'running')))"),
                IsEmpty());
    // Kept counts are true.
    EXPECT_EQ(rows("SELECT user, state, follower, jobs, expected_s, from_cache FROM counts "
                   "WHERE jobs <> 0 ORDER BY 1, 2, 3"),
              rows("SELECT user, state, follows <> 0, count(*), sum(expected_s), sum(from_cache) "
                   "FROM jobs GROUP BY 1, 2, 3 ORDER BY 1, 2, 3"));
  }
  EXPECT_GT(tokens.size(), 100u) << "the test did something";
  EXPECT_THAT(rows("SELECT count(*) > 20 FROM jobs WHERE state = 'done'"), ElementsAre("1"));
}

}  // namespace
}  // namespace slicecorr::farm
