// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What goes wrong at night: workers and services that are killed at any place, frozen, or told another time.
// Whatever happens, every job ends with the files that slicecorr writes, once.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <random>

#include "farm_faults_fixture.hpp"
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
  const int rounds = by_night() ? slicecorr::test::rounds(8) : 4;
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
  const int rounds = by_night() ? slicecorr::test::rounds(6) : 4;
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
  EXPECT_GE(times, 10);
  for (const Job& j : jobs()) EXPECT_THAT(reasons(j.id), ElementsAre(Reason::none));
  check();
}

}  // namespace
}  // namespace slicecorr::farm
