// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What goes wrong at night with files: inputs that vanish, locked databases, full disks. Whatever happens,
// every job ends with the files that slicecorr writes, once, or says why it can't.

#include <gmock/gmock.h>
#include <sqlite3.h>
#include <sys/mount.h>

#include <random>
#include <regex>

#include "farm_faults_fixture.hpp"
#include "rounds.hpp"
#include "slicecorr/farm/service.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::AnyOf;
using testing::ElementsAre;
using testing::IsEmpty;

TEST_F(FarmFaults, InputsMayGoOnceTheyAreSubmitted) {
  std::vector<std::string> parts;
  std::map<std::string, std::string> references;  // by the name of the part
  for (int i = 0; i < slicecorr::test::rounds(4); ++i) {
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
  const int jobs_in_all = by_night() ? slicecorr::test::rounds(12) : 5;
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
  if (::mount("tmpfs", farm_dir().c_str(), "tmpfs", 0, "size=24m,mode=755") != 0) {
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
  const int rounds = by_night() ? slicecorr::test::rounds(4) : 3;
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
  for (int round = 0; round < slicecorr::test::rounds(4); ++round) {
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
