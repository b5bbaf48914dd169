// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The engine of this machine alone, with scripts for workers; and leases, with an engine of the
// test's own.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <thread>

#include "farm_fixture.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/service.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::HasSubstr;
using testing::IsEmpty;

class LocalEngineTest : public testing::Test {
 protected:
  /// A script stands for the worker: $1 is "worker", $2 the attempt's folder.
  void script(const std::string& body) {
    write_file(dir / "worker", "#!/bin/sh\n" + body + "\n");
    fs::permissions(dir / "worker", fs::perms::owner_all);
  }
  std::unique_ptr<Engine> engine(int jobs = 2) {
    LocalEngineOptions o;
    o.program = dir / "worker";
    o.jobs = jobs;
    o.cores = 2;
    o.memory_mb = 1000;
    return make_local_engine(o);
  }
  Task task(const std::string& token) {
    Task t;
    t.token = token;
    t.folder = dir / token;
    t.memory_mb = 300;
    fs::create_directories(t.folder);
    return t;
  }
  TaskReport until_ended(Engine& e) {
    for (;;) {
      for (const TaskReport& r : e.poll()) {
        if (r.state == TaskState::ended) return r;
      }
      e.wait(std::chrono::seconds(10), -1);
    }
  }

  FarmFolderOfTest dir;
};

TEST_F(LocalEngineTest, TellsHowTasksEnd) {
  script("echo said; exit 3");
  const auto e = engine();
  ASSERT_NE(e->submit({task("a")}).at(0), "");
  TaskReport r = until_ended(*e);
  EXPECT_EQ(r.token, "a");
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_EQ(r.signal, 0);
  EXPECT_EQ(text_of_file(dir / "a/log.txt"), "said\n");
  script("kill -9 $$");
  e->submit({task("b")});
  r = until_ended(*e);
  EXPECT_EQ(r.signal, SIGKILL);
  EXPECT_EQ(r.exit_code, -1);
  EXPECT_THAT(e->poll(), IsEmpty()) << "an end is told once";
}

TEST_F(LocalEngineTest, WhatCannotStartIsTold) {
  const auto e = engine();
  Task t = task("a");
  fs::remove_all(t.folder);
  EXPECT_EQ(e->submit({t}).at(0), "");
  const TaskReport r = until_ended(*e);
  EXPECT_EQ(r.reason, Reason::engine_failed);
  EXPECT_THAT(r.message, HasSubstr("log.txt"));
  // No such program: the child says so by its exit code.
  e->submit({task("b")});
  EXPECT_EQ(until_ended(*e).exit_code, 127);
}

TEST_F(LocalEngineTest, RoomIsWhatIsLeft) {
  script("exec sleep 1000");
  const auto e = engine(3);
  const EngineCapacity before = e->capacity();
  EXPECT_EQ(before.tasks, 3);
  EXPECT_EQ(before.cores, 2);
  EXPECT_EQ(before.largest_memory_mb, 1000);
  e->submit({task("a"), task("b")});
  const EngineCapacity after = e->capacity();
  EXPECT_EQ(after.tasks, 1);
  EXPECT_EQ(after.cores, 0);
  EXPECT_LE(after.memory_mb, 400);
  // One core each while jobs wait, all of them for the last; never more memory than there is.
  EXPECT_EQ(e->share({2, 1000, 1000, 8}, 5, 100, 10).threads, 4);
  EXPECT_EQ(e->share({8, 1000, 1000, 8}, 50, 100, 10).threads, 1);
  EXPECT_EQ(e->share({8, 1000, 1000, 8}, 1, 100, 10).threads, 8);
  EXPECT_EQ(e->share({8, 1000, 1000, 8}, 1, 100, 10).memory_mb, 170);
  EXPECT_EQ(e->share({8, 125, 1000, 8}, 1, 100, 10).threads, 3);
  EXPECT_EQ(e->share({1, 1000, 1000, 0}, 1, 100, 10).threads, 1);
}

TEST_F(LocalEngineTest, CancelEndsTheWholeGroup) {
  // A worker that ignores the request, with a child of its own that does, too.
  script("trap '' TERM; sleep 1000 & echo $! > $2/child; while :; do sleep 1000; done");
  const auto e = engine();
  e->submit({task("a")});
  ASSERT_TRUE(comes([&] { return text_of_file(dir / "a/child").ends_with("\n"); }));
  const pid_t child = std::stoi(text_of_file(dir / "a/child"));
  e->cancel({"a", "unknown"});
  const TaskReport r = until_ended(*e);
  EXPECT_EQ(r.signal, SIGKILL);
  EXPECT_TRUE(comes([&] {
    const std::string stat = text_of_file(fmt::format("/proc/{}/stat", child));
    return stat.empty() || stat.find(") Z") != stat.npos;
  }));
}

TEST_F(LocalEngineTest, WorkersDieWithTheirService) {
  script("echo $$ > $2/pid; exec sleep 1000");
  const pid_t service = ::fork();
  ASSERT_GE(service, 0);
  if (service == 0) {
    const auto e = engine();
    e->submit({task("a")});
    ::pause();
    ::_exit(0);
  }
  ASSERT_TRUE(comes([&] { return text_of_file(dir / "a/pid").ends_with("\n"); }));
  const pid_t worker = std::stoi(text_of_file(dir / "a/pid"));
  EXPECT_EQ(::kill(worker, 0), 0);
  ::kill(service, SIGKILL);
  ::waitpid(service, nullptr, 0);
  EXPECT_TRUE(comes([&] {
    const std::string stat = text_of_file(fmt::format("/proc/{}/stat", worker));
    return stat.empty() || stat.find(") Z") != stat.npos;
  }));
}

TEST_F(LocalEngineTest, SurvivorsOfAnotherServiceAreEndedOnlyWhenTheyAreOurs) {
  const auto e = engine();
  const std::string token = "0123456789abcdef0123456789abcdef";
  const auto start = [&](const std::string& argument) {
    const pid_t child = ::fork();
    if (child == 0) {
      ::setpgid(0, 0);
      ::execl("/bin/sh", "sh", "-c", "while :; do read x; done", argument.c_str(), nullptr);
      ::_exit(127);
    }
    ::setpgid(child, child);
    return child;
  };
  // The name of the process is there after the exec.
  const auto begun = [&](pid_t pid) {
    return comes([&] {
      return text_of_file(fmt::format("/proc/{}/cmdline", pid)).find("read x") != std::string::npos;
    });
  };
  const auto started_at = [](pid_t pid) {
    const std::string stat = text_of_file(fmt::format("/proc/{}/stat", pid));
    std::istringstream rest(stat.substr(stat.rfind(')') + 2));
    std::string word;
    for (int field = 3; field <= 22; ++field) rest >> word;
    return word;
  };
  const pid_t ours = start("worker/" + token), other = start("something else");
  ASSERT_TRUE(begun(ours));
  ASSERT_TRUE(begun(other));
  Attempt a, b, c;
  a.token = b.token = c.token = token;
  a.engine_id = fmt::format("{}.{}", ours, started_at(ours));
  b.engine_id = fmt::format("{}.{}", other, started_at(other));
  c.engine_id = fmt::format("{}.1", other);
  EXPECT_THAT(e->adopt({a, b, c}), IsEmpty());
  int status = 0;
  EXPECT_EQ(::waitpid(ours, &status, 0), ours);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  EXPECT_EQ(::kill(other, 0), 0) << "a process of somebody else was ended";
  EXPECT_EQ(::waitpid(other, &status, WNOHANG), 0);
  ::kill(other, SIGKILL);
  ::waitpid(other, &status, 0);
}

// --- leases, with an engine and a clock of the test ----------------------------------------------

/// Tasks run until the test says how they end.
class HeldEngine final : public Engine {
 public:
  std::string name() const override { return "held"; }
  EngineCapacity capacity() override { return {4, 10000, 10000, 4}; }
  std::vector<std::string> submit(const std::vector<Task>& tasks) override {
    for (const Task& t : tasks) {
      const std::lock_guard lock(mutex);
      held.insert(t.token);
      ++submitted;
    }
    return std::vector<std::string>(tasks.size(), "1");
  }
  std::vector<TaskReport> poll() override {
    const std::lock_guard lock(mutex);
    return std::exchange(reports, {});
  }
  void wait(std::chrono::milliseconds, int) override { ::poll(nullptr, 0, 1); }
  void cancel(const std::vector<std::string>& tokens) override {
    const std::lock_guard lock(mutex);
    for (const std::string& t : tokens) {
      if (held.erase(t) == 0) continue;
      cancelled.insert(t);
      TaskReport r;
      r.token = t;
      r.state = TaskState::ended;
      r.signal = SIGKILL;
      reports.push_back(r);
    }
  }
  std::vector<std::string> adopt(const std::vector<Attempt>&) override { return {}; }
  std::vector<FarmNode> nodes() override { return {}; }
  bool outlives_service() const override { return false; }

  std::mutex mutex;
  std::set<std::string> held, cancelled;
  std::vector<TaskReport> reports;
  std::atomic<int> submitted{0};
};

/// A service with one job, as long as the test runs.
class FarmLeases : public testing::Test {
 protected:
  void SetUp() override {
    queue.change_settings({{"min-free-mb", "0"}}, "test");
    NewJob j = job_with_key("k");
    j.work.spec_json =
        R"({"kind":"run","inputs":[],"layer_um":50,"antialias":"on","units":"auto","scale":1,"center_mm":[],"rotate_deg":[],"format":"uvj","ending":"uvj","name":""})";
    j.results_folder = dir / "results/";
    queue.submit({j}, "anna", "test");
    options.clock = &clock;
    options.renewal_ms = 1;  // as often as it can, against a clock that jumps
    service = std::thread([&] { run_service(folder, engine, options, stop); });
  }
  void TearDown() override { end(); }
  void end() {
    stop = true;
    if (service.joinable()) service.join();
  }

  FarmFolderOfTest dir;
  const FarmFolder folder = open_folder(dir / "farm");
  TestClock clock;
  Queue queue{folder.database(), clock};
  HeldEngine engine;
  std::atomic<bool> stop{false};
  ServiceOptions options;
  std::thread service;
};

TEST_F(FarmLeases, ALostLeaseEndsTheWorkerAndTheOldAttemptIsNotHeard) {
  ASSERT_TRUE(comes([&] { return engine.submitted == 1; }));
  std::string first;
  {
    const std::lock_guard lock(engine.mutex);
    first = *engine.held.begin();
  }
  // Another service believes the first one frozen: it takes the attempt over and gives it up.
  std::string second;
  ASSERT_TRUE(comes([&] {
    clock.steady += kLeaseMs + 1;
    const std::string other = queue.start_service("held", 1, 1);
    return queue.adopt(first, other);
  }));
  ASSERT_TRUE(queue.give_up(first, ended(Reason::lease_lost)));
  // The first one hears of it and ends its worker; the job is done by a new attempt.
  ASSERT_TRUE(comes([&] {
    const std::lock_guard lock(engine.mutex);
    return engine.cancelled.contains(first);
  }));
  ASSERT_TRUE(comes([&] { return engine.submitted == 2; }));
  {
    const std::lock_guard lock(engine.mutex);
    ASSERT_EQ(engine.held.size(), 1u);
    second = *engine.held.begin();
  }
  EXPECT_NE(first, second);
  EXPECT_FALSE(queue.begin_commit(first));
  EXPECT_EQ(ReadModel(folder.database(), clock).job(1)->token, second);
  end();
  EXPECT_EQ(ReadModel(folder.database(), clock).job(1)->state, JobState::queued);
}

TEST_F(FarmLeases, SettingTheClockDisturbsNobody) {
  ASSERT_TRUE(comes([&] { return engine.submitted == 1; }));
  const std::int64_t wall = clock.wall;
  for (const std::int64_t jump : {-86'400'000LL, 86'400'000LL, -3'600'000LL, 0LL}) {
    clock.wall = wall + jump;
    // A few renewals pass: the time at which it was last seen follows the clock.
    ASSERT_TRUE(comes([&] {
      const auto list = ReadModel(folder.database(), clock).services();
      return !list.empty() && list[0].seen_ms == wall + jump;
    }));
    EXPECT_EQ(engine.submitted, 1);
    EXPECT_THAT(queue.orphans(), IsEmpty());
    const std::lock_guard lock(engine.mutex);
    EXPECT_THAT(engine.cancelled, IsEmpty());
  }
}

}  // namespace
}  // namespace slicecorr::farm
