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
#include <thread>

#include "farm_fixture.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::AnyOf;
using testing::Contains;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class FarmFaults : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    quick_settings();
  }
  /// Rounds of the tests that kill at random places: more by SLICECORR_FARM_ROUNDS.
  static int rounds(int few) {
    const char* text = std::getenv("SLICECORR_FARM_ROUNDS");
    return text ? std::max(few, std::atoi(text)) : few;
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
      for (const Event& e : ReadModel(database()).events(0, 100000, j.id)) ends += e.kind == "done";
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
      for (const char* ending : {".uvj", ".html", ".json"}) {
        if (!fs::exists(base + ending)) continue;
        EXPECT_EQ(text_of_file(base + ending), text_of_file(reference(j.parts[0]) + ending))
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
  const std::string part = make_part(1);
  submit_parts({part, make_part(2)}, {"--out", dir / "out"});
  if (std::string(GetParam().fault).find("hang") != std::string::npos) {
    ASSERT_EQ(farm("set", {"hang-s=1"}).exit_code, 0);
  }
  // Jobs that were put back for want of room wait 10 s by the clock; not in a test.
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
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
    sqlite3_exec(db, "UPDATE jobs SET not_before_ms = 0", nullptr, nullptr, nullptr);
    sqlite3_close(db);
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

TEST_F(FarmFaults, AWorkerThatAlwaysCrashesIsGivenUp) {
  submit_parts({make_part(1)});
  ASSERT_EQ(run_all({{"SLICEFARM_TEST_FAULT", "correct:crash"}}).exit_code, 0);
  EXPECT_EQ(jobs()[0].state, JobState::failed);
  EXPECT_EQ(jobs()[0].reason, Reason::worker_crashed);
  EXPECT_EQ(attempts(1).size(), 3u);
  for (const Attempt& a : attempts(1)) EXPECT_TRUE(fs::exists(a.log)) << a.log;
}

/// The service is killed at a place of its own code, the Nth time that it comes there.
class FarmServiceFaults : public FarmFaults, public testing::WithParamInterface<const char*> {};

TEST_P(FarmServiceFaults, LosesNothingAndDoesNothingTwice) {
  submit_parts({make_part(1), make_part(2), make_part(3)}, {"--out", dir / "out"});
  submit_parts({make_part(1)}, {"--out", dir / "out", "--name",
                                "bridge-1"
                                "-again"});
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

/// Service and workers killed at random moments: after the Kth line that the service says, or when
/// a worker has come to some stage.
TEST_F(FarmFaults, KilledAtRandomMomentsNothingIsLost) {
  std::mt19937 random(7);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  std::vector<std::string> parts;
  for (int i = 0; i < 8; ++i) parts.push_back(make_part(i));
  submit_parts(parts, {"--out", dir / "out"});
  ASSERT_EQ(farm("set", {"max-attempts=100"}).exit_code, 0);
  const char* stages[] = {"start", "read", "correct", "report", "check", "end"};
  const char* places[] = {"claimed",    "ordered", "started",   "ended",
                          "committing", "cached",  "delivered", "finished"};
  int killed = 0;
  for (int round = 0; round < rounds(12); ++round) {
    std::map<std::string, std::string> environment;
    RunOptions o;
    // One of: a worker, the service, both.
    const int kind = pick(3);
    if (kind != 1)
      environment["SLICEFARM_TEST_FAULT"] = fmt::format("{}:kill@-{}", stages[pick(6)], pick(8));
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
  EXPECT_GE(killed, rounds(12) / 2);
  finish_and_check();
}

TEST_F(FarmFaults, InputsMayGoOnceTheyAreSubmitted) {
  const std::string part = make_part(1), other = make_part(2);
  reference(part);
  reference(other);
  submit_parts({part, other}, {"--out", dir / "out"});
  fs::remove(part);
  write_file(other, "changed");
  ASSERT_EQ(run_all().exit_code, 0);
  for (const Job& j : jobs()) {
    EXPECT_EQ(j.state, JobState::done);
    expect_same_files(j.output_folder + "/" + j.name, dir / "reference/" + j.name);
  }
}

TEST_F(FarmFaults, WhenTheFarmsOwnCopyGoesTheJobSaysSo) {
  submit_parts({make_part(1), make_part(2)}, {"--out", dir / "out"});
  const FarmFolder folder = open_folder(farm_dir());
  const StoredInput one = store_input(folder, make_part(1)),
                    two = store_input(folder, make_part(2));
  fs::remove(folder.input(one.file));
  write_file(folder.input(two.file), "damaged");
  ASSERT_EQ(run_all().exit_code, 0);
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

TEST_F(FarmFaults, AFullDiskPausesAndLosesNothing) {
  // A disk of its own for the outputs: 200 kB, of which other files take most.
  const std::string disk = dir / "disk";
  fs::create_directories(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=256k") != 0) {
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
  write_file(disk + "/other", std::string(240 << 10, 'x'));
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
  EXPECT_EQ(jobs()[0].attempts, 0);
  EXPECT_EQ(jobs()[1].state, JobState::done) << "other disks have room";
  EXPECT_THAT(leftovers(disk), IsEmpty());
  EXPECT_FALSE(fs::exists(disk + "/bridge-1.uvj"));
  fs::resize_file(disk + "/other", 0);
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
  sqlite3_exec(db, "UPDATE jobs SET not_before_ms = 0", nullptr, nullptr, nullptr);
  sqlite3_close(db);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(jobs()[0].state, JobState::done);
  expect_same_files(disk + "/bridge-1", reference(part));
}

TEST_F(FarmFaults, AServiceThatCannotWriteItsFolderEndsWithoutHarm) {
  // No file may grow beyond a few kB: neither database, orders nor logs.
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  RunOptions o;
  o.largest_file = 2048;
  o.timeout = std::chrono::seconds(60);
  o.signal = SIGTERM;
  o.signal_when = [](const std::string&, const std::string& err) {
    return err.find("put back") != std::string::npos;
  };
  const RunResult r = farm("run", {"--until-empty"}, o);
  EXPECT_THAT(r.exit_code, AnyOf(4, 130)) << r.err;
  expect_whole_outputs();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
  sqlite3_exec(db, "UPDATE jobs SET not_before_ms = 0", nullptr, nullptr, nullptr);
  sqlite3_close(db);
  finish_and_check();
}

}  // namespace
}  // namespace slicecorr::farm
