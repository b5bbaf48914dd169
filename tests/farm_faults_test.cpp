// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What goes wrong at night: workers and services that are killed at any place, full disks, locked
// databases, inputs that vanish. Whatever happens, every job ends with the files that slicecorr
// writes, once, and nothing half-written has a final name.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sqlite3.h>
#include <sys/mount.h>
#include <sys/wait.h>

#include <cstdlib>
#include <random>
#include <regex>
#include <thread>

#include "farm_fixture.hpp"
#include "rounds.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/service.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::AnyOf;
using testing::Contains;
using testing::Each;
using testing::ElementsAre;
using testing::IsEmpty;

class FarmFaults : public FarmPrograms {
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
        if (text_of_file("/proc/" + pid + "/cmdline").find(a.token) != std::string::npos) {
          list.push_back(std::stoi(pid));
        }
      }
    }
    return list;
  }
  /// Works on after whatever happened; then all must be in order.
  void finish_and_check() {
    const RunResult r = run_all();
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
    EXPECT_THAT(leftovers(dir / "out"), IsEmpty());
    EXPECT_TRUE(fs::is_empty(farm_dir() + "/store/attempts"));
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
      const bool renamed = j.name != fs::path(j.parts[0]).stem();
      for (const char* ending : {".uvj", ".html", ".json"}) {
        if (!fs::exists(base + ending) || (renamed && ending != std::string(".uvj"))) continue;
        EXPECT_TRUE(text_of_file(base + ending) == text_of_file(reference(j.parts[0]) + ending))
            << base << ending;
      }
    }
  }
};

struct WorkerFault {
  const char* fault;
  Reason reason;
};

class FarmWorkerFaults : public FarmFaults, public testing::WithParamInterface<WorkerFault> {};

TEST_P(FarmWorkerFaults, IsRecordedAndTriedAgain) {
  if (SLICECORR_SANITIZED && GetParam().reason == Reason::out_of_memory) {
    GTEST_SKIP() << "sanitizers take memory of their own";
  }
  const std::string part = make_part(1);
  submit_parts({part, make_part(2)}, {"--out", dir / "out"});
  if (std::string(GetParam().fault).find("hang") != std::string::npos) {
    // Instrumented programs take seconds to begin.
    change_settings({{"hang-s", SLICECORR_SANITIZED ? "15" : "1"}});
  }
  const bool delayed = GetParam().reason == Reason::disk_full;
  if (delayed) {
    RunOptions o;
    o.environment = {{"SLICEFARM_TEST_FAULT", std::string(GetParam().fault) + ":1@bridge-1"}};
    o.signal = SIGTERM;
    o.signal_when = [&](const std::string&, const std::string& err) {
      return err.find("job 1 bridge-1: put back") != std::string::npos &&
             err.find("job 2 bridge-2: done") != std::string::npos;
    };
    EXPECT_EQ(farm("run", {}, o).exit_code, 130);
    EXPECT_THAT(leftovers(dir / "out"), IsEmpty());
    without_delays();
    ASSERT_EQ(run_all().exit_code, 0);
  } else {
    const RunResult r =
        run_all({{"SLICEFARM_TEST_FAULT", std::string(GetParam().fault) + ":1@bridge-1"}});
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  EXPECT_THAT(reasons(1), ElementsAre(GetParam().reason, Reason::none)) << attempts(1)[0].message;
  EXPECT_THAT(reasons(2), ElementsAre(Reason::none)) << "one crash takes one job";
  check();
}

INSTANTIATE_TEST_SUITE_P(Kinds, FarmWorkerFaults,
                         testing::Values(WorkerFault{"start:kill", Reason::worker_killed},
                                         WorkerFault{"read:kill", Reason::worker_killed},
                                         WorkerFault{"correct:kill", Reason::worker_killed},
                                         WorkerFault{"report:kill", Reason::worker_killed},
                                         WorkerFault{"check:kill", Reason::worker_killed},
                                         WorkerFault{"end:kill", Reason::worker_killed},
                                         WorkerFault{"correct:crash", Reason::worker_crashed},
                                         WorkerFault{"correct:segv", Reason::worker_crashed},
                                         WorkerFault{"report:exit=1", Reason::worker_crashed},
                                         WorkerFault{"end:exit=0", Reason::worker_crashed},
                                         WorkerFault{"correct:hang", Reason::hung},
                                         WorkerFault{"correct:memory", Reason::out_of_memory},
                                         WorkerFault{"correct:full", Reason::disk_full},
                                         WorkerFault{"report:full", Reason::disk_full}),
                         [](const testing::TestParamInfo<WorkerFault>& info) {
                           std::string name = info.param.fault;
                           for (char& c : name) {
                             if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
                           }
                           return name;
                         });

/// The programs that people get know nothing of faults.
TEST_F(FarmFaults, TheShippedProgramsHaveNone) {
  RunOptions asked;
  asked.environment = {{"SLICEFARM_TEST_FAULT", "start:crash"},
                       {"SLICEFARM_TEST_SERVICE_FAULT", "claimed"},
                       {"USER", "anna"}};
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  const RunResult r = program("slicefarm", {"run", "--dir", farm_dir(), "--until-empty"}, asked);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(reasons(1), ElementsAre(Reason::none));
  for (const char* name :
       {"slicecorr", "slicecorr-post", "slicefarm", "resinctl", "printbridge", "printer-sim"}) {
    const std::string bytes = text_of_file(std::string(SLICECORR_BIN_DIR) + "/" + name);
    EXPECT_GT(bytes.size(), 100'000u) << name;
    EXPECT_EQ(bytes.find("_TEST_"), std::string::npos) << name;
  }
  EXPECT_NE(text_of_file(SLICECORR_FAULTY_SLICEFARM).find("SLICEFARM_TEST_FAULT"),
            std::string::npos);
}

TEST_F(FarmFaults, AWorkerThatAlwaysCrashesIsGivenUp) {
  submit_parts({make_part(1)});
  ASSERT_EQ(run_all({{"SLICEFARM_TEST_FAULT", "correct:crash"}}).exit_code, 5);
  EXPECT_EQ(jobs()[0].state, JobState::failed);
  EXPECT_EQ(jobs()[0].reason, Reason::worker_crashed);
  EXPECT_EQ(attempts(1).size(), 3u);
  for (const Attempt& a : attempts(1)) EXPECT_TRUE(fs::exists(a.log)) << a.log;
}

/// The service is killed at a place of its own code, the Nth time that it comes there.
class FarmServiceFaults : public FarmFaults, public testing::WithParamInterface<const char*> {};

TEST_P(FarmServiceFaults, LosesNothingAndDoesNothingTwice) {
  submit_parts({make_part(1), make_part(2), make_part(3)}, {"--out", dir / "out"});
  submit_parts({make_part(1)}, {"--out", dir / "out", "--name", "bridge-1-again"});
  int killed = 0;
  for (const int n : {1, 2}) {
    const RunResult r = run_all(
        {{"SLICEFARM_TEST_SERVICE_FAULT", fmt::format("{}:{}", GetParam(), n)}}, {"--jobs", "2"});
    killed += r.exit_code == 128 + SIGKILL;
    expect_whole_outputs();
  }
  EXPECT_GE(killed, 1) << "the fault never came";
  ASSERT_EQ(run_all().exit_code, 0);
  // The copy has its own name in its report.
  const Job again = jobs().at(3);
  EXPECT_EQ(again.state, JobState::done);
  EXPECT_EQ(text_of_file(again.output("uvj")), text_of_file(reference(make_part(1)) + ".uvj"));
  for (const Job& j : jobs()) {
    EXPECT_EQ(j.state, JobState::done);
    if (j.id < 4) expect_same_files(dir / "out/" + j.name, reference(j.parts[0]));
    EXPECT_THAT(reasons(j.id), testing::AllOf(Contains(Reason::none).Times(1),
                                              Each(AnyOf(Reason::none, Reason::lease_lost))));
    EXPECT_EQ(j.attempts, 0) << "a killed service is no fault of the job";
  }
  EXPECT_THAT(leftovers(dir / "out"), IsEmpty());
  EXPECT_TRUE(fs::is_empty(farm_dir() + "/store/attempts"));
}

INSTANTIATE_TEST_SUITE_P(Places, FarmServiceFaults,
                         testing::Values("claimed", "ordered", "started", "ended", "committing",
                                         "cached", "delivered", "finished"),
                         [](const auto& info) { return std::string(info.param); });

TEST_F(FarmFaults, WorkThatWasFinishedWhenTheServiceDiedIsNotDoneAgain) {
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  const RunResult r = run_all({{"SLICEFARM_TEST_SERVICE_FAULT", "ended"}});
  ASSERT_EQ(r.exit_code, 128 + SIGKILL);
  finish_and_check();
  EXPECT_EQ(attempts(1).size(), 1u) << "its result stood in the attempt's folder";
}

/// Workers broken at some stage and the service killed at some place of its code, or after the Kth
/// line that it says.
TEST_F(FarmFaults, BrokenAtRandomPlacesNothingIsLost) {
  std::mt19937 random(7);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  const int count = by_night() ? 8 : 4;
  std::vector<std::string> parts;
  for (int i = 0; i < count; ++i) parts.push_back(make_part(i));
  submit_parts(parts, {"--out", dir / "out"});
  change_settings({{"max-attempts", "100"}});
  const char* faults[] = {"kill", "crash", "segv", "exit=1", "memory", "kill"};
  const char* stages[] = {"start", "read", "correct", "report", "check", "end"};
  const char* places[] = {"claimed",    "ordered", "started",   "ended",
                          "committing", "cached",  "delivered", "finished"};
  int killed = 0;
  const int rounds = by_night() ? test::rounds(8) : 4;
  for (int round = 0; round < rounds; ++round) {
    std::map<std::string, std::string> environment;
    RunOptions o;
    // One of: a worker, the service, both.
    const int kind = pick(3);
    if (kind != 1)
      environment["SLICEFARM_TEST_FAULT"] =
          fmt::format("{}:{}@-{}", stages[pick(6)], faults[pick(6)], pick(count));
    if (kind != 0 && pick(2)) {
      environment["SLICEFARM_TEST_SERVICE_FAULT"] =
          fmt::format("{}:{}", places[pick(8)], 1 + pick(3));
    }
    const int lines = 1 + pick(6);
    o.environment = environment;
    o.signal = SIGKILL;
    o.signal_when = [lines](const std::string&, const std::string& err) {
      return std::count(err.begin(), err.end(), '\n') >= lines;
    };
    if (kind == 0)
      o.signal_when = [](const std::string&, const std::string& err) {
        return err.find("put back") != std::string::npos || err.find(" done,") != std::string::npos;
      };
    const RunResult r = farm("run", {"--jobs", "2", "--until-empty"}, o);
    killed += r.exit_code == 128 + SIGKILL;
    expect_whole_outputs();
    // Start again with new work now and then, so that rounds don't find all done.
    if (jobs().back().state == JobState::done) {
      submit_parts({make_part(8 + round)}, {"--out", dir / "out"});
    }
  }
  EXPECT_GE(killed, rounds / 2);
  finish_and_check();
}

/// kill -9 of a worker, of the service, of both, whenever it comes.
TEST_F(FarmFaults, KilledAtRandomMomentsNothingIsLost) {
  std::mt19937 random(11);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  change_settings({{"max-attempts", "100"}});
  int next = 0, killed_workers = 0, killed_services = 0;
  const int rounds = by_night() ? test::rounds(6) : 4;
  for (int round = 0; round < rounds; ++round) {
    SCOPED_TRACE(round);
    if (all_over()) {
      submit_parts({make_part(next), make_part(next + 1), make_part(next + 2)},
                   {"--out", dir / "out"});
      next += 3;
    }
    enum { worker, service_alone, both } kind = static_cast<decltype(kind)>(round % 3);
    RunningService service(farm_dir(), {"--jobs", "2"});
    std::vector<pid_t> pids;
    ASSERT_TRUE(comes([&] { return !(pids = workers()).empty() || all_over(); }));
    ::poll(nullptr, 0, pick(60));  // a worker is done in about a tenth of a second
    if (kind != service_alone) {
      pids = workers();
      if (!pids.empty()) {
        killed_workers += ::kill(pids[random() % pids.size()], SIGKILL) == 0;
      }
    }
    // After a worker the service goes on; it is stopped when it has said what it saw.
    if (kind == worker) {
      ::poll(nullptr, 0, pick(300));
      EXPECT_EQ(service.end(SIGTERM), 130);
    } else {
      EXPECT_EQ(service.end(SIGKILL), 128 + SIGKILL);
      ++killed_services;
    }
    expect_whole_outputs();
  }
  EXPECT_GE(killed_workers, rounds / 3);
  EXPECT_GE(killed_services, rounds / 3);
  finish_and_check();
  for (const Job& j : jobs()) {
    EXPECT_THAT(reasons(j.id), Each(AnyOf(Reason::none, Reason::lease_lost, Reason::stopped,
                                          Reason::worker_killed)));
  }
}

/// Frozen for longer than its lease: another service takes the job over.
TEST_F(FarmFaults, AServiceThatWasFrozenEndsTheWorkerOfALostLease) {
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  RunningService service(farm_dir(), {"--until-empty"},
                         {{"SLICEFARM_TEST_FAULT", "correct:hang:1"}});
  ASSERT_TRUE(comes([&] { return !attempts(1).empty() && attempts(1)[0].stage == "correct"; }));
  const std::vector<pid_t> pids = workers();
  ASSERT_EQ(pids.size(), 1u);
  ::kill(service.pid(), SIGSTOP);
  TestClock later;
  later.wall = system_clock().wall_ms();
  later.steady = system_clock().steady_ms() + kLeaseMs + 1000;
  Queue queue(database(), later);
  const std::string token = attempts(1)[0].token;
  ASSERT_TRUE(queue.adopt(token, queue.start_service("local", 1, 1)));
  ASSERT_TRUE(queue.give_up(token, ended(Reason::lease_lost)));
  ::kill(service.pid(), SIGCONT);
  EXPECT_EQ(service.wait(), 0);
  EXPECT_NE(::kill(pids[0], 0), 0) << "the worker is still there";
  EXPECT_THAT(reasons(1), ElementsAre(Reason::lease_lost, Reason::none));
  check();
}

/// The wall clock is set to and fro by days while jobs run.
TEST_F(FarmFaults, AClockThatIsSetAgainAndAgainHarmsNothing) {
  struct SetClock final : FarmClock {
    std::int64_t wall_ms() const override { return system_clock().wall_ms() + offset_ms; }
    std::int64_t steady_ms() const override { return system_clock().steady_ms(); }
    std::string boot_id() const override { return system_clock().boot_id(); }
    std::atomic<std::int64_t> offset_ms{0};
  } clock;
  const int count = by_night() ? 16 : 6;
  std::vector<std::string> parts;
  for (int i = 0; i < count; ++i) parts.push_back(make_part(i));
  submit_parts(parts, {"--out", dir / "out"});
  const FarmFolder folder = open_folder(farm_dir());
  LocalEngineOptions local;
  local.program = std::string(SLICECORR_BIN_DIR) + "/slicefarm";
  local.jobs = local.cores = 2;
  local.memory_mb = 2000;
  const auto engine = make_local_engine(local);
  ServiceOptions options;
  options.clock = &clock;
  options.until_empty = true;
  options.renewal_ms = 20;
  std::atomic<bool> stop{false}, over{false};
  ServiceTotals totals;
  std::thread service([&] {
    totals = run_service(folder, *engine, options, stop);
    over = true;
  });
  std::mt19937 random(13);
  int times = 0;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!over && std::chrono::steady_clock::now() < end) {
    clock.offset_ms = static_cast<std::int64_t>(random() % 345'600'000) - 172'800'000;
    ++times;
    ::poll(nullptr, 0, 5);
  }
  EXPECT_TRUE(over);
  stop = true;
  service.join();
  EXPECT_EQ(totals.done, count);
  EXPECT_GE(times, 20);
  for (const Job& j : jobs()) EXPECT_THAT(reasons(j.id), ElementsAre(Reason::none));
  check();
}

TEST_F(FarmFaults, InputsMayGoOnceTheyAreSubmitted) {
  std::vector<std::string> parts;
  std::map<std::string, std::string> references;  // by the name of the part
  for (int i = 0; i < test::rounds(4); ++i) {
    parts.push_back(make_part(i));
    references[fs::path(parts.back()).stem()] = reference(parts.back());
  }
  submit_parts(parts, {"--out", dir / "out"});
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::string& part = parts[i];
    switch (i % 4) {
      case 0:
        fs::remove(part);
        break;
      case 1:
        write_file(part, "changed");
        break;
      case 2:
        fs::resize_file(part, fs::file_size(part) / 2);
        break;
      case 3:
        fs::remove(part);
        fs::create_directory(part);
        break;
    }
  }
  ASSERT_EQ(run_all().exit_code, 0);
  for (const Job& j : jobs()) {
    EXPECT_EQ(j.state, JobState::done);
    expect_same_files(j.output_folder + "/" + j.name, references.at(j.name));
  }
}

TEST_F(FarmFaults, WhenTheFarmsOwnCopyGoesTheJobSaysSo) {
  submit_parts({make_part(1), make_part(2)}, {"--out", dir / "out"});
  const FarmFolder folder = open_folder(farm_dir());
  const StoredInput one = store_input(folder, make_part(1)),
                    two = store_input(folder, make_part(2));
  fs::remove(folder.input(one.file));
  write_file(folder.input(two.file), "damaged");
  ASSERT_EQ(run_all().exit_code, 5);
  for (const Job& j : jobs()) {
    EXPECT_EQ(j.state, JobState::failed);
    EXPECT_EQ(j.reason, Reason::input_gone);
    EXPECT_EQ(attempts(j.id).size(), 1u);
  }
  // Submitted and tried again, it is there again.
  store_input(folder, make_part(1));
  store_input(folder, make_part(2));
  ASSERT_EQ(farm("retry", {"1", "2"}).exit_code, 0);
  finish_and_check();
}

TEST_F(FarmFaults, ALockedDatabaseIsWaitedFor) {
  submit_parts({make_part(1), make_part(2)}, {"--out", dir / "out"});
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open(database().c_str(), &other), SQLITE_OK);
  // Held from the first start on until the service must have met it: its worker has ended.
  std::thread holder;
  RunOptions o;
  bool locked = false;
  o.timeout = std::chrono::minutes(3);
  o.signal = SIGCONT;  // harmless: the condition is what counts
  o.signal_when = [&](const std::string&, const std::string& err) {
    if (!locked && err.find("started") != std::string::npos) {
      locked = sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr) == SQLITE_OK;
      return false;
    }
    if (!locked) return false;
    const auto finished = [&] {
      for (const auto& e : fs::directory_iterator(farm_dir() + "/store/attempts")) {
        if (fs::exists(e.path() / "result.json")) return true;
      }
      return false;
    };
    if (!finished()) return false;
    sqlite3_exec(other, "COMMIT", nullptr, nullptr, nullptr);
    return true;
  };
  const RunResult r = farm("run", {"--until-empty"}, o);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(locked);
  sqlite3_close(other);
  check();
}

/// Another process writes to the database for long moments, and dies in the middle of one.
TEST_F(FarmFaults, ADatabaseThatIsLockedAgainAndAgainIsWaitedFor) {
  std::vector<std::string> parts;
  const int jobs_in_all = by_night() ? test::rounds(12) : 5;
  for (int i = 0; i < jobs_in_all; ++i) parts.push_back(make_part(i));
  submit_parts({parts[0]}, {"--out", dir / "out"});
  const std::string path = database(), count = dir / "locks";
  const unsigned locked_ms = by_night() ? 200 : 80, free_ms = by_night() ? 50 : 20;
  const pid_t other = ::fork();
  ASSERT_GE(other, 0);
  if (other == 0) {
    sqlite3* db = nullptr;
    std::mt19937 random(19);
    if (sqlite3_open(path.c_str(), &db) != SQLITE_OK) ::_exit(1);
    sqlite3_busy_timeout(db, 60000);
    for (;;) {
      if (sqlite3_exec(db, "BEGIN EXCLUSIVE", nullptr, nullptr, nullptr) == SQLITE_OK) {
        std::ofstream(count, std::ios::app) << '.';
        ::poll(nullptr, 0, static_cast<int>(random() % locked_ms));
        sqlite3_exec(db, "COMMIT", nullptr, nullptr, nullptr);
      }
      ::poll(nullptr, 0, static_cast<int>(random() % free_ms));
    }
  }
  parts.erase(parts.begin());
  submit_parts(parts, {"--out", dir / "out"});
  const RunResult r = run_all();
  ::kill(other, SIGKILL);
  ::waitpid(other, nullptr, 0);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_GE(fs::file_size(count), by_night() ? 10U : 5U) << "it was hardly ever locked";
  for (const Job& j : jobs()) EXPECT_THAT(reasons(j.id), ElementsAre(Reason::none));
  check();
}

/// The farm's own disk (record, store, outputs) is filled by somebody while jobs run.
TEST_F(FarmFaults, ADiskThatIsFullAgainAndAgainLosesNothing) {
  if (::mount("tmpfs", farm_dir().c_str(), "tmpfs", 0, "size=24m") != 0) {
    GTEST_SKIP() << "needs to mount a small disk: root only";
  }
  struct Unmount {
    std::string path;
    ~Unmount() { ::umount2(path.c_str(), MNT_DETACH); }
  } unmount{farm_dir()};
  quick_settings();
  std::mt19937 random(23);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  const std::string filler = farm_dir() + "/filler";
  int next = 0, filled = 0;
  const int rounds = by_night() ? test::rounds(4) : 3;
  for (int round = 0; round < rounds; ++round) {
    SCOPED_TRACE(round);
    if (all_over()) {
      submit_parts({make_part(next), make_part(next + 1)}, {"--out", farm_dir() + "/out"});
      next += 2;
    }
    without_delays();
    RunningService service(farm_dir(), {"--jobs", "2"});
    ASSERT_TRUE(comes([&] { return !workers().empty() || all_over(); }));
    ::poll(nullptr, 0, pick(400));
    {
      // Up to the last page, or nearly.
      std::ofstream file(filler, std::ios::binary);
      const std::string page(4096, 'x');
      while (file.write(page.data(), 4096).flush()) {
      }
      ++filled;
    }
    std::error_code error;
    if (pick(2)) fs::resize_file(filler, fs::file_size(filler) - (4096u << pick(6)), error);
    ::poll(nullptr, 0, pick(1000));
    // With no room for its last words it says so by exit code 4.
    EXPECT_THAT(service.end(round % 3 == 2 ? SIGKILL : SIGTERM), AnyOf(130, 4, 128 + SIGKILL));
    fs::remove(filler);
    expect_whole_outputs();
  }
  EXPECT_EQ(filled, rounds);
  without_delays();
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  check();
  EXPECT_THAT(leftovers(farm_dir() + "/out"), IsEmpty());
  for (const Job& j : jobs()) EXPECT_EQ(j.attempts, 0) << "a full disk is no fault of the job";
}

/// The first parts are copied, the last one finds no room: nothing of it stays.
TEST_F(FarmFaults, ASubmissionThatFindsNoRoomLeavesNoInputs) {
  const auto inputs = [&] {
    std::vector<std::string> list;
    for (const auto& e : fs::recursive_directory_iterator(farm_dir() + "/store/inputs")) {
      if (e.is_regular_file()) list.push_back(e.path().filename().string());
    }
    return list;
  };
  submit_parts({make_part(1)});
  const std::vector<std::string> before = inputs();
  ASSERT_EQ(before.size(), 1u);
  // A part that is larger than any file may be, larger than the database.
  const std::string large = dir / "large.stl";
  std::vector<BoxMm> boxes;
  for (int i = 0; i < 2000; ++i) {
    const auto x = static_cast<float>(i % 20) * 0.1F, y = static_cast<float>(i / 20 % 10) * 0.1F,
               z = static_cast<float>(i / 200) * 0.1F;
    boxes.push_back({x, x + 0.1F, y, y + 0.1F, z, z + 0.1F});
  }
  write_file(large, stl_of(boxes));
  std::vector<std::string> arguments = {make_part(1), make_part(2), make_part(3), large};
  const auto process = process_options();
  arguments.insert(arguments.end(), process.begin(), process.end());
  RunOptions o;
  o.largest_file = 900'000;
  ASSERT_GT(fs::file_size(large), o.largest_file);
  ASSERT_LT(fs::file_size(database()), o.largest_file);
  const RunResult no_room = farm("submit", arguments, o);
  EXPECT_EQ(no_room.exit_code, 4) << no_room.err;
  EXPECT_THAT(inputs(), ElementsAre(before[0]));
  // All are copied, but the record has no room for the jobs.
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db,
                         "CREATE TRIGGER full BEFORE INSERT ON jobs BEGIN SELECT RAISE(ABORT, "
                         "'database or disk is full'); END",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_EQ(farm("submit", arguments).exit_code, 4);
  EXPECT_THAT(inputs(), ElementsAre(before[0]));
  ASSERT_EQ(sqlite3_exec(db, "DROP TRIGGER full", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  // With room again all goes well; what waited meanwhile does, too.
  EXPECT_EQ(farm("submit", arguments).exit_code, 0);
  EXPECT_EQ(inputs().size(), 4u);
  finish_and_check();
}

TEST_F(FarmFaults, AFullDiskPausesAndLosesNothing) {
  // A disk of its own for the outputs: 8 MB, of which other files take nearly all.
  const std::string disk = dir / "disk";
  fs::create_directories(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=8m") != 0) {
    GTEST_SKIP() << "needs to mount a small disk: root only";
  }
  struct Unmount {
    std::string path;
    ~Unmount() { ::umount2(path.c_str(), MNT_DETACH); }
  } unmount{disk};
  const std::string part = make_part(1);
  reference(part);
  submit_parts({part}, {"--out", disk});
  submit_parts({make_part(2)}, {"--out", dir / "out"});
  write_file(disk + "/other", std::string(8100 << 10, 'x'));
  RunOptions o;
  o.signal = SIGTERM;
  o.signal_when = [](const std::string&, const std::string& err) {
    return err.find("job 1 bridge-1: put back") != std::string::npos &&
           err.find("job 2 bridge-2: done") != std::string::npos;
  };
  const RunResult r = farm("run", {}, o);
  EXPECT_EQ(r.exit_code, 130) << r.err;
  EXPECT_EQ(jobs()[0].state, JobState::queued);
  EXPECT_EQ(jobs()[0].reason, Reason::disk_full);
  // Two figures that say why, and are not the same.
  const std::string why = jobs()[0].message.substr(disk.size());
  std::smatch figures;
  ASSERT_TRUE(std::regex_match(
      why, figures, std::regex("(?:: )([0-9.]+ [kM]?B) free, ([0-9.]+ [kM]?B) are wanted")))
      << why;
  EXPECT_NE(figures[1], figures[2]);
  EXPECT_EQ(jobs()[0].attempts, 0);
  EXPECT_EQ(jobs()[1].state, JobState::done) << "other disks have room";
  EXPECT_THAT(leftovers(disk), IsEmpty());
  EXPECT_FALSE(fs::exists(disk + "/bridge-1.uvj"));
  fs::resize_file(disk + "/other", 0);
  without_delays();
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(jobs()[0].state, JobState::done);
  expect_same_files(disk + "/bridge-1", reference(part));
}

TEST_F(FarmFaults, AServiceThatCannotWriteItsFolderEndsWithoutHarm) {
  // No file may grow beyond some kB: neither database, orders, logs nor results.
  const rlim_t limits[] = {2048, 512, 20'000, 70'000, 110'000, 200'000};
  for (int round = 0; round < test::rounds(4); ++round) {
    SCOPED_TRACE(limits[round % 6]);
    submit_parts({make_part(round)}, {"--out", dir / "out"});
    RunOptions o;
    o.largest_file = limits[round % 6];
    o.timeout = std::chrono::seconds(60);
    o.signal = SIGTERM;
    o.signal_when = [](const std::string&, const std::string& err) {
      return err.find("put back") != err.npos || err.find("trying on") != err.npos;
    };
    const RunResult r = farm("run", {"--until-empty"}, o);
    EXPECT_THAT(r.exit_code, AnyOf(0, 4, 130)) << r.err;
    expect_whole_outputs();
    without_delays();
  }
  finish_and_check();
}

}  // namespace
}  // namespace slicecorr::farm
