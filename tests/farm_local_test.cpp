// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm as a shop uses it: parts in, the same files out that slicecorr writes, and all the ways
// to stop, hold and hurry it.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <nlohmann/json.hpp>
#include <optional>

#include "engine/slurm_tasks.hpp"
#include "farm_fixture.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/token.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class FarmLocal : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    quick_settings();
  }
  Job job(JobId id) { return *ReadModel(database()).job(id); }
  std::vector<Attempt> attempts(JobId id) { return ReadModel(database()).attempts(id); }
  std::vector<std::string> events(JobId id) {
    std::vector<std::string> kinds;
    for (const FarmEvent& e : ReadModel(database()).events(0, 1000, id)) kinds.push_back(e.kind);
    return kinds;
  }
};

TEST_F(FarmLocal, ResultsAreThoseOfSlicecorr) {
  std::vector<std::string> parts;
  for (int i = 0; i < 4; ++i) parts.push_back(make_part(7 * i));
  submit_parts(parts, {"--out", dir / "out"});
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("4 done"));
  for (const std::string& part : parts) {
    expect_same_files((dir / "out/") + fs::path(part).stem().string(), reference(part));
  }
  for (JobId id = 1; id <= 4; ++id) {
    const Job j = job(id);
    EXPECT_EQ(j.state, JobState::done);
    EXPECT_THAT(events(id), ElementsAre("submitted", "started", "done"));
    // The record says what was delivered.
    for (const ResultFile& f : j.files) {
      const ResultFile now = sha256_of_file(j.output(f.ending));
      EXPECT_EQ(now.sha256, f.sha256);
      EXPECT_EQ(now.bytes, f.bytes);
    }
    // And what it will print: the figures of the JSON beside it.
    const json figures = json::parse(text_of_file(j.output("json")));
    ASSERT_TRUE(j.figures);
    EXPECT_EQ(j.figures->height_max_um, figures["height_error_um"]["max_abs"]);
    EXPECT_EQ(j.figures->layers, figures["layers"]);
  }
  EXPECT_THAT(leftovers(dir / "out"), IsEmpty());
  EXPECT_THAT(leftovers(farm_dir()), IsEmpty());
  EXPECT_TRUE(fs::is_empty(farm_dir() + "/store/attempts"));
}

TEST_F(FarmLocal, NamesWithMarkupAndOtherLettersComeThrough) {
  const std::string part = dir / "a<b>&\"ü 1.stl";
  write_file(part, bridge_stl(3));
  submit_parts({part}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  expect_same_files(dir / "out/a<b>&\"ü 1", reference(part));
}

TEST_F(FarmLocal, ArchivesAreCorrectedAndKeepTheirFormat) {
  const std::string part = make_part(1);
  for (const char* ending : {"uvj", "sl1"}) {
    SCOPED_TRACE(ending);
    const std::string target = dir / (std::string("target.") + ending);
    RunResult r = program("slicecorr", {"slice", part, "-o", target, "--printer",
                                        dir / "small.toml", "--layer-um", "50"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const std::string out = dir / (std::string("out-") + ending);
    submit_parts({target}, {"--out", out});
    ASSERT_EQ(run_all().exit_code, 0);
    const std::string expected = dir / (std::string("expected/target.") + ending);
    fs::create_directories(dir / "expected");
    r = program("slicecorr", {"correct", target, "-o", expected, "--printer", dir / "small.toml",
                              "--resin", dir / "clear.toml", "--speed-mm-h", "700"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(text_of_file(out + "/target." + ending), text_of_file(expected));
    EXPECT_TRUE(fs::exists(out + "/target.html"));
    EXPECT_TRUE(fs::exists(out + "/target.json"));
  }
}

TEST_F(FarmLocal, TheSameWorkAgainIsDoneAtOnceWithoutAService) {
  const std::string part = make_part(1);
  submit_parts({part}, {"--out", dir / "one"});
  ASSERT_EQ(run_all().exit_code, 0);
  // Another name and folder, the content the same; nobody runs.
  fs::copy_file(part, dir / "twin.stl");
  const RunResult r = submit_parts({dir / "twin.stl"}, {"--out", dir / "two", "--copies", "2"});
  EXPECT_THAT(r.err, HasSubstr("2 of them done from the cache"));
  expect_same_files(dir / "two/twin", reference(dir / "twin.stl"));
  EXPECT_EQ(text_of_file(dir / "two/twin-2.uvj"), text_of_file(dir / "one/bridge-1.uvj"));
  EXPECT_TRUE(job(2).from_cache);
  EXPECT_EQ(attempts(2).at(0).engine, "cache");
}

TEST_F(FarmLocal, TheSameWorkIsDoneOnceAtATime) {
  const std::string part = make_part(1);
  submit_parts({part}, {"--out", dir / "out", "--copies", "5"});
  submit_parts({part}, {"--out", dir / "more", "--copies", "5"});
  ASSERT_EQ(run_all({}, {"--jobs", "4"}).exit_code, 0);
  int worked = 0;
  for (JobId id = 1; id <= 10; ++id) {
    EXPECT_EQ(job(id).state, JobState::done);
    worked += attempts(id).at(0).engine == "local";
  }
  EXPECT_EQ(worked, 1);
}

TEST_F(FarmLocal, ADamagedCacheIsNoticedAndTheWorkDoneAgain) {
  const std::string part = make_part(1);
  submit_parts({part}, {"--out", dir / "one"});
  ASSERT_EQ(run_all().exit_code, 0);
  const std::string key = job(1).key;
  const std::string stack = open_folder(farm_dir()).cache_entry(key) + "/stack.uvj";
  std::string bytes = text_of_file(stack);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  write_file(stack, bytes);
  submit_parts({part}, {"--out", dir / "two"});
  EXPECT_FALSE(fs::exists(dir / "two/bridge-1.uvj")) << "a damaged stack was delivered";
  EXPECT_EQ(job(2).state, JobState::queued);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_FALSE(job(2).from_cache);
  expect_same_files(dir / "two/bridge-1", reference(part));
}

TEST_F(FarmLocal, BadInputIsFoundOutOnceAndSaid) {
  // Feasible by its grid, but the archive's images are damaged: only the worker sees it.
  const std::string target = dir / "target.uvj";
  RunResult r = program("slicecorr", {"slice", make_part(1), "-o", target, "--printer",
                                      dir / "small.toml", "--layer-um", "50"});
  ASSERT_EQ(r.exit_code, 0);
  std::string bytes = text_of_file(target);
  // The last image is a slice; the first ones are previews, which nobody needs.
  const std::size_t at = bytes.rfind("IDAT");
  ASSERT_NE(at, bytes.npos);
  bytes[at + 12] = static_cast<char>(bytes[at + 12] ^ 0x55);
  write_file(target, bytes);
  submit_parts({target}, {"--copies", "2"});
  ASSERT_EQ(run_all().exit_code, 5);
  for (const JobId id : {1, 2}) {
    EXPECT_EQ(job(id).state, JobState::failed);
    EXPECT_EQ(job(id).reason, Reason::bad_input);
  }
  EXPECT_EQ(attempts(1).size(), 1u);
  EXPECT_EQ(attempts(2).size(), 0u);
  const RunResult logs = farm("logs", {"1"});
  EXPECT_THAT(logs.out, HasSubstr("bad_input"));
  EXPECT_THAT(farm("status").out, HasSubstr("2 failed"));
}

TEST_F(FarmLocal, CancelEndsARunningWorkerThatIsDeaf) {
  submit_parts({make_part(1), make_part(2)});
  RunningService service(farm_dir(), {"--jobs", "2"},
                         {{"SLICEFARM_TEST_FAULT", "correct:hang@bridge-1"}});
  ASSERT_TRUE(comes([&] { return !attempts(1).empty() && attempts(1)[0].stage == "correct"; }));
  const RunResult r = farm("cancel", {"1"});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  ASSERT_TRUE(comes([&] { return job(1).state == JobState::cancelled; }));
  const std::string id = attempts(1).at(0).engine_id;
  EXPECT_NE(::kill(std::stoi(id), 0), 0) << "the worker is still there";
  EXPECT_FALSE(fs::exists(job(1).output("uvj")));
  ASSERT_TRUE(comes([&] { return job(2).state == JobState::done; }));
  EXPECT_EQ(service.end(SIGTERM), 130);
  EXPECT_EQ(farm("cancel", {"99"}).exit_code, 2);
  EXPECT_EQ(farm("retry", {"2"}).exit_code, 2);
  ASSERT_EQ(farm("retry", {"1"}).exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(job(1).state, JobState::done);
}

TEST_F(FarmLocal, AServiceMayBeStoppedAndStartedAtAnyTime) {
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  {
    RunningService service(farm_dir(), {}, {{"SLICEFARM_TEST_FAULT", "correct:hang"}});
    ASSERT_TRUE(comes([&] { return !attempts(1).empty() && attempts(1)[0].stage == "correct"; }));
    const pid_t worker = std::stoi(attempts(1)[0].engine_id);
    EXPECT_EQ(service.end(SIGTERM), 130);
    EXPECT_NE(::kill(worker, 0), 0) << "its worker is still there";
  }
  EXPECT_EQ(job(1).state, JobState::queued);
  EXPECT_EQ(job(1).reason, Reason::stopped);
  EXPECT_EQ(job(1).attempts, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  expect_same_files(dir / "out/bridge-1", reference(make_part(1)));
}

TEST_F(FarmLocal, PausedFarmsStartNothing) {
  submit_parts({make_part(1)});
  ASSERT_EQ(farm("pause").exit_code, 0);
  RunningService service(farm_dir(), {"--until-empty"});
  const auto doing = [&]() -> std::string {
    const auto list = ReadModel(database()).services();
    return list.empty() || !list[0].alive ? "" : list[0].doing;
  };
  ASSERT_TRUE(comes([&] { return doing() == "paused"; }));
  EXPECT_EQ(job(1).state, JobState::queued);
  ASSERT_EQ(farm("resume").exit_code, 0);
  EXPECT_EQ(service.wait(), 0);
  EXPECT_EQ(job(1).state, JobState::done);
}

TEST_F(FarmLocal, DrainedServicesEnd) {
  submit_parts({make_part(1)});
  ASSERT_EQ(farm("drain").exit_code, 0);
  RunningService service(farm_dir());
  EXPECT_EQ(service.wait(), 0);
  EXPECT_EQ(job(1).state, JobState::queued);
  ASSERT_EQ(farm("resume").exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(job(1).state, JobState::done);
}

TEST_F(FarmLocal, OutsideTheNightWindowNothingStarts) {
  submit_parts({make_part(1)});
  // A window that is at the other side of the clock.
  const int now = local_minute(system_clock().wall_ms());
  const std::string window =
      minute_text((now + 11 * 60) % 1440) + "-" + minute_text((now + 13 * 60) % 1440);
  ASSERT_EQ(farm("set", {"night=" + window}).exit_code, 0);
  RunningService service(farm_dir(), {"--until-empty"});
  ASSERT_TRUE(comes([&] {
    const auto list = ReadModel(database()).services();
    return !list.empty() && list[0].doing == "outside the night window";
  }));
  EXPECT_EQ(job(1).state, JobState::queued);
  ASSERT_EQ(farm("set", {"night=off"}).exit_code, 0);
  EXPECT_EQ(service.wait(), 0);
  EXPECT_EQ(job(1).state, JobState::done);
}

TEST_F(FarmLocal, WithTooLittleRoomOnTheDiskNothingStarts) {
  submit_parts({make_part(1)});
  ASSERT_EQ(farm("set", {"min-free-mb=1000000000"}).exit_code, 0);
  RunningService service(farm_dir(), {"--until-empty"});
  ASSERT_TRUE(comes([&] {
    const auto list = ReadModel(database()).services();
    return !list.empty() && list[0].doing.starts_with("disk full");
  }));
  EXPECT_THAT(ReadModel(database()).services()[0].doing, HasSubstr("B free, 1.0 PB are wanted"));
  EXPECT_EQ(job(1).state, JobState::queued);
  ASSERT_EQ(farm("set", {"min-free-mb=0"}).exit_code, 0);
  EXPECT_EQ(service.wait(), 0);
  EXPECT_EQ(job(1).state, JobState::done);
  std::vector<std::string> kinds;
  for (const FarmEvent& e : ReadModel(database()).events(0, 1000)) kinds.push_back(e.kind);
  EXPECT_THAT(kinds, testing::Contains("disk_low"));
  EXPECT_THAT(kinds, testing::Contains("disk_ok"));
}

TEST_F(FarmLocal, WhatRanOutOfMemoryGetsMore) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "sanitizers take memory of their own";
  submit_parts({make_part(1)}, {"--out", dir / "out"});
  ASSERT_EQ(run_all({{"SLICEFARM_TEST_FAULT", "correct:memory:1"}}).exit_code, 0);
  const auto list = attempts(1);
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0].reason, Reason::out_of_memory) << list[0].message;
  // The worker's own limit stopped it, near to where it should.
  EXPECT_LT(list[0].peak_mb, list[0].memory_mb + 200);
  EXPECT_GE(list[1].memory_mb, 2 * list[0].memory_mb);
  EXPECT_EQ(job(1).state, JobState::done);
  expect_same_files(dir / "out/bridge-1", reference(make_part(1)));
}

TEST_F(FarmLocal, WhatNeedsMoreMemoryThanThereIsFails) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "sanitizers take memory of their own";
  submit_parts({make_part(1)});
  const RunResult r = run_all({{"SLICEFARM_TEST_FAULT", "correct:memory"}}, {"--memory-mb", "300"});
  ASSERT_EQ(r.exit_code, 5) << r.err;
  EXPECT_EQ(job(1).state, JobState::failed);
  EXPECT_THAT(name_of(job(1).reason), testing::AnyOf("too_large", "out_of_memory"));
  for (const Attempt& a : attempts(1)) EXPECT_LE(a.memory_mb, 300);
}

TEST_F(FarmLocal, PrioritiesCanBeChangedWhileJobsWait) {
  submit_parts({make_part(1), make_part(2), make_part(3)});
  ASSERT_EQ(farm("priority", {"3", "--to", "5"}).exit_code, 0);
  ASSERT_EQ(farm("priority", {"2", "--ready-by", "07:00"}).exit_code, 0);
  EXPECT_EQ(farm("priority", {"44", "--to", "5"}).exit_code, 2);
  ASSERT_EQ(run_all({}, {"--jobs", "1"}).exit_code, 0);
  EXPECT_LE(job(3).started_ms, job(2).started_ms);
  EXPECT_LE(job(2).started_ms, job(1).started_ms);
}

/// A batch of Slurm's stays as long as one of its attempts is open.
TEST_F(FarmLocal, GarbageIsNoBatchThatAnAttemptNeeds) {
  submit_parts({make_part(1)});
  const FarmFolder folder = open_folder(farm_dir());
  Queue queue(folder.database());
  const auto claim = queue.claim(any_job(queue.start_service("slurm", 1, 1000)));
  ASSERT_TRUE(claim);
  const detail::BatchFolder batches(folder.store);
  const detail::Batch batch{random_token(), {random_token(), claim->token}};
  batches.write(batch);
  ASSERT_EQ(farm("gc").exit_code, 0);
  EXPECT_TRUE(fs::exists(batches.path(batch.token) + "/batch.json"));
  ASSERT_TRUE(queue.give_up(claim->token, ended(Reason::lease_lost)));
  ASSERT_EQ(farm("gc").exit_code, 0);
  EXPECT_FALSE(fs::exists(batches.path(batch.token)));
}

/// Inputs that no record knows: a submission was killed in the middle of its copies.
TEST_F(FarmLocal, GarbageIsWhatAKilledSubmissionCopied) {
  submit_parts({make_part(1)});
  const FarmFolder folder = open_folder(farm_dir());
  const std::string needed = folder.input(store_input(folder, make_part(1)).file);
  const std::string stray = folder.input(store_input(folder, make_part(2)).file);
  const std::string half = folder.store + "/inputs/.bridge-3.12345.part.aB3dE";
  write_file(half, "solid");
  {
    const InputLock at_work = InputLock::shared(folder);
    const RunResult r = farm("gc");
    EXPECT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err, HasSubstr("0 inputs"));
    EXPECT_THAT(r.err, HasSubstr("inputs stay while a submission is at work"));
    EXPECT_TRUE(fs::exists(stray)) << "its jobs may be about to be queued";
  }
  EXPECT_THAT(farm("gc", {"--dry-run"}).err, HasSubstr("2 inputs"));
  EXPECT_TRUE(fs::exists(stray));
  const RunResult r = farm("gc");
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("2 inputs"));
  EXPECT_FALSE(fs::exists(stray));
  EXPECT_FALSE(fs::exists(half));
  EXPECT_TRUE(fs::exists(needed));
  EXPECT_EQ(run_all().exit_code, 0);
}

/// The commands of docs/farm-backup.md on backup and repair, as somebody would type them.
TEST_F(FarmLocal, DocsOnBackupAndRepairRun) {
  if (!fs::exists("/usr/bin/sqlite3")) GTEST_SKIP() << "sqlite3 is not installed";
  std::vector<std::string> blocks;
  {
    std::ifstream page(std::string(SLICECORR_SOURCE_DIR) + "/docs/farm-backup.md");
    bool here = false, block = false;
    for (std::string line; std::getline(page, line);) {
      if (line.starts_with("## ")) here = line == "## Backup and repair";
      if (!here) continue;
      const bool indented = line.starts_with("    ");
      if (indented && !block) blocks.emplace_back();
      if (indented) blocks.back() += line.substr(4) + "\n";
      block = indented;
    }
  }
  ASSERT_EQ(blocks.size(), 5u);
  const std::string &backup = blocks[0], &restore = blocks[1], &look = blocks[2],
                    &reindex = blocks[3], &save = blocks[4];
  const auto type = [&](const std::string& script) {
    RunOptions o;
    o.environment = {{"DIR", farm_dir()}, {"BACKUP", dir / "backup"}};
    return run_program({"/bin/sh", "-c", script}, o);
  };
  const auto sql = [&](const std::string& text) {
    return type("sqlite3 \"$DIR/farm.sqlite\" \"" + text + "\"").out;
  };
  const auto count = [&](JobState state) {
    return ReadModel(database()).summary().jobs[static_cast<std::size_t>(state)];
  };
  quick_settings();
  submit_parts({make_part(1), make_part(2)}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  submit_parts({make_part(3), make_part(4)}, {"--out", dir / "out"});
  {
    RunningService service(farm_dir(), {"--jobs", "1"},
                           {{"SLICEFARM_TEST_FAULT", "correct:hang@bridge-3"}});
    ASSERT_TRUE(comes([&] { return job(3).state == JobState::running; }));
    for (int i = 0; i < 2; ++i) {  // the second time over the first
      const RunResult r = type("set -e\n" + backup);
      ASSERT_EQ(r.exit_code, 0) << r.err;
    }
  }
  // The disk is lost.
  fs::remove_all(farm_dir());
  const RunResult restored = type("set -e\n" + restore);
  ASSERT_EQ(restored.exit_code, 0) << restored.err;
  EXPECT_EQ(type(look).out, "ok\n");
  const RunResult worked = run_all();
  ASSERT_EQ(worked.exit_code, 0) << worked.err;
  for (int id = 1; id <= 4; ++id) {
    EXPECT_EQ(job(id).state, JobState::done);
    expect_same_files(dir / ("out/bridge-" + std::to_string(id)), reference(make_part(id)));
  }
  EXPECT_EQ(attempts(2).size(), 1u) << "not done again";

  // An index that misses a row.
  sql("PRAGMA writable_schema = 1; CREATE TABLE keep AS SELECT * FROM sqlite_master WHERE name = "
      "'jobs_by_state'; DELETE FROM sqlite_master WHERE name = 'jobs_by_state'");
  sql("UPDATE jobs SET ended_ms = 5 WHERE id = 2; PRAGMA writable_schema = 1; INSERT INTO "
      "sqlite_master SELECT * FROM keep; DROP TABLE keep");
  EXPECT_EQ(type(look).out, "row 2 missing from index jobs_by_state\n");
  EXPECT_EQ(type(reindex).exit_code, 0);
  EXPECT_EQ(type(look).out, "ok\n");

  // Pages of events, attempts and an index are lost while a job runs and another one waits.
  submit_parts({make_part(5), make_part(6)}, {"--out", dir / "out"});
  EXPECT_EQ(run_all({{"SLICEFARM_TEST_SERVICE_FAULT", "claimed"}}).exit_code, 128 + SIGKILL);
  EXPECT_EQ(job(5).state, JobState::running);
  sql("PRAGMA wal_checkpoint(TRUNCATE)");
  std::istringstream pages(sql(
      "SELECT rootpage FROM sqlite_master WHERE name IN ('events', 'attempts', 'jobs_by_key')"));
  {
    std::fstream file(database(), std::ios::in | std::ios::out | std::ios::binary);
    for (int page = 0; pages >> page;) {
      ASSERT_GT(page, 1);
      file.seekp((page - 1) * 4096L);
      file << std::string(4096, 'Z');
    }
  }
  EXPECT_THAT(type(look).out, HasSubstr("in database main"));
  const RunResult refused = run_all();
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("database disk image is malformed"));
  const RunResult saved = type("set -e\n" + save);
  ASSERT_EQ(saved.exit_code, 0) << saved.err;
  EXPECT_EQ(type(look).out, "ok\n");
  EXPECT_EQ(count(JobState::done), 4);
  EXPECT_EQ(count(JobState::queued), 2);
  EXPECT_EQ(count(JobState::running), 0);
  const RunResult again = run_all();
  ASSERT_EQ(again.exit_code, 0) << again.err;
  for (const int id : {5, 6}) {
    expect_same_files(dir / ("out/bridge-" + std::to_string(id)), reference(make_part(id)));
  }
  EXPECT_EQ(count(JobState::done), 6);
  EXPECT_TRUE(fs::exists(farm_dir() + "/damaged/farm.sqlite"));
}

TEST_F(FarmLocal, UntilEmptyTellsByItsExitCodeThatJobsFailed) {
  submit_parts({make_part(1), make_part(2)});
  change_settings({{"max-attempts", "1"}});
  const std::map<std::string, std::string> fault = {
      {"SLICEFARM_TEST_FAULT", "correct:crash@bridge-2"}};
  const RunResult r = run_all(fault);
  EXPECT_EQ(r.exit_code, 5) << r.err;
  EXPECT_THAT(r.err, HasSubstr("1 done, 0 of them from the cache; 1 failed"));
  // What failed before is no failure of this one.
  EXPECT_EQ(run_all().exit_code, 0);
  ASSERT_EQ(farm("retry", {"2"}).exit_code, 0);
  EXPECT_EQ(run_all(fault).exit_code, 5);
  ASSERT_EQ(farm("retry", {"2"}).exit_code, 0);
  EXPECT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(job(2).state, JobState::done);
  // Cancelled is what somebody wanted.
  submit_parts({make_part(3)});
  ASSERT_EQ(farm("cancel", {"3"}).exit_code, 0);
  EXPECT_EQ(run_all().exit_code, 0);
  // A service that is told to end did what it was told.
  submit_parts({make_part(4)});
  RunningService service(farm_dir(), {}, {{"SLICEFARM_TEST_FAULT", "correct:crash"}});
  EXPECT_TRUE(comes([&] { return job(4).state == JobState::failed; }));
  ASSERT_EQ(farm("drain").exit_code, 0);
  EXPECT_EQ(service.wait(), 0);
}

TEST_F(FarmLocal, GarbageGoesAndWhatIsNeededStays) {
  const std::string one = make_part(1), two = make_part(2);
  submit_parts({one, two}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  const FarmFolder folder = open_folder(farm_dir());
  // Of these results one is waited for again: paused, because a hit would be served at once.
  Queue queue(folder.database());
  NewJob again = job_with_key(job(1).key, "again");
  again.work.setup_hash = "x";
  again.results_folder = dir / "results/";
  queue.submit({again}, "anna", "test");
  fs::create_directories(folder.store + "/attempts/" + random_token());
  // What a service that gave work to Slurm and was killed leaves: batches whole, torn and just
  // made.
  const detail::BatchFolder batches(folder.store);
  const detail::Batch whole{random_token(), {random_token(), random_token()}},
      torn{random_token(), {random_token()}}, fresh{random_token(), {}}, old{random_token(), {}};
  for (const detail::Batch& b : {whole, torn}) batches.write(b);
  fs::remove(batches.path(torn.token) + "/batch.json");
  for (const detail::Batch& b : {fresh, old}) fs::create_directories(batches.path(b.token));
  fs::last_write_time(batches.path(old.token),
                      fs::file_time_type::clock::now() - std::chrono::hours(2));
  ASSERT_EQ(farm("gc", {"--older-than-days", "0", "--dry-run"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(batches.path(whole.token)));
  EXPECT_TRUE(fs::exists(folder.cache_entry(job(2).key)));
  const RunResult r = farm("gc", {"--older-than-days", "0"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(fs::exists(folder.cache_entry(job(1).key))) << "needed by a queued job";
  EXPECT_FALSE(fs::exists(folder.cache_entry(job(2).key)));
  EXPECT_TRUE(fs::is_empty(folder.store + "/attempts"));
  for (const detail::Batch& b : {whole, torn, old}) {
    EXPECT_FALSE(fs::exists(fs::symlink_status(batches.path(b.token))));
  }
  EXPECT_TRUE(fs::exists(batches.path(fresh.token))) << "somebody may be about to fill it";
  EXPECT_TRUE(fs::exists(folder.store + "/slurm/farm.id"));
  EXPECT_TRUE(fs::exists(dir / "out/bridge-1.uvj"));
  EXPECT_TRUE(fs::exists(dir / "out/bridge-2.uvj"));
  // Inputs of the last day stay: jobs that need them may be on their way.
  EXPECT_TRUE(fs::exists(folder.input(store_input(folder, one).file)));
  // What was collected is made again when it is wanted.
  submit_parts({two}, {"--out", dir / "new"});
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_FALSE(job(4).from_cache);
  expect_same_files(dir / "new/bridge-2", reference(two));
}

TEST_F(FarmLocal, StatusTellsWhatThereIs) {
  EXPECT_EQ(program("slicefarm", {"status", "--dir", dir / "nowhere"}).exit_code, 2);
  submit_parts({make_part(1)}, {"--label", "night"});
  submit_parts({make_part(2)});
  RunResult r = farm("status");
  EXPECT_THAT(r.out, HasSubstr("2 queued"));
  EXPECT_THAT(r.out, HasSubstr("no service is running"));
  const json all = json::parse(farm("status", {"--json", "-"}).out);
  EXPECT_EQ(all["jobs"]["queued"], 2);
  EXPECT_EQ(all["list"].size(), 2u);
  const json some = json::parse(farm("status", {"--json", "-", "--label", "night"}).out);
  ASSERT_EQ(some["list"].size(), 1u);
  EXPECT_EQ(some["list"][0]["name"], "bridge-1");
  ASSERT_EQ(run_all().exit_code, 0);
  r = farm("status", {"--state", "done"});
  EXPECT_THAT(r.out, HasSubstr("2 done"));
  EXPECT_THAT(r.out, HasSubstr("largest height error"));
  // One alone: what it came to, and where that is.
  r = farm("status", {"2"});
  EXPECT_THAT(r.out, testing::StartsWith("job 2 bridge-2: done\n"));
  EXPECT_THAT(r.out, HasSubstr(job(2).output("uvj") + "\n"));
  EXPECT_EQ(json::parse(farm("status", {"2", "--json", "-"}).out)["name"], "bridge-2");
  EXPECT_EQ(farm("status", {"3"}).exit_code, 2);
  EXPECT_EQ(farm("status", {"2", "--state", "done"}).exit_code, 2);
}

/// Printers whose display is uneven, mirrored or turned: the setup in the order says all of it.
TEST_F(FarmLocal, EveryDisplayGivesTheBytesOfSlicecorr) {
  const auto picture = [&](const std::string& name, const std::vector<std::uint8_t>& levels) {
    const auto bytes = encode_png({3, 2, levels});
    write_file(dir / name, std::string(bytes.begin(), bytes.end()));
    return "flat_field = \"" + name + "\"\n";
  };
  const std::string one = picture("one.png", {200, 210, 220, 230, 240, 250}),
                    two = picture("two.png", {200, 210, 220, 230, 240, 251});
  const std::map<std::string, std::string> displays = {
      {"plain", ""},
      {"uneven", one},
      {"another", two},
      {"mirrored", "mirror = \"x\"\n"},
      {"uneven-mirrored", one + "mirror = \"y\"\n"},
      {"portrait", "orientation = \"portrait\"\nmirror = \"x\"\n"},
      {"uneven-portrait", one + "orientation = \"portrait\"\nmirror = \"x\"\n"}};
  const std::string part = make_part(3);
  const std::vector<std::string> how = {"--resin", dir / "clear.toml", "--speed-mm-h", "700"};
  const auto with = [&](std::vector<std::string> list, const std::vector<std::string>& more) {
    list.insert(list.end(), more.begin(), more.end());
    list.insert(list.end(), how.begin(), how.end());
    return list;
  };
  fs::create_directories(dir / "direct");
  struct Expected {
    std::string made, expected;
    std::vector<std::string> endings;
  };
  std::vector<Expected> all;
  int numbers = 0;
  for (const auto& [name, keys] : displays) {
    SCOPED_TRACE(name);
    std::string toml = kSmallPrinterToml;
    toml.insert(toml.find("bit_depth"), keys);
    const std::string printer = dir / (name + ".toml");
    write_file(printer, toml);
    // How a display lies is told by the file, and how even it is by the levels in it.
    std::vector<std::string> formats{"uvj"};
    if (name.ends_with("mirrored") || name.ends_with("portrait")) formats.emplace_back("sl1");
    // By day each display has one format, and one of mesh and slices.
    const int number = numbers++;
    if (!by_night()) formats = {formats[static_cast<std::size_t>(number) / 2 % formats.size()]};
    for (const std::string& format : formats) {
      // From a mesh, and from slices that another program could have made.
      const std::string base = name + "-" + format;
      RunResult r;
      if (by_night() || number % 2 == 0) {
        r = farm("submit", with({part, "--name", base, "--format", format, "--printer", printer,
                                 "--layer-um", "50", "--out", dir / "out"},
                                {}));
        ASSERT_EQ(r.exit_code, 0) << r.err;
        r = program("slicecorr", with({"run", part, "-o", dir / ("direct/" + base + "." + format),
                                       "--printer", printer, "--layer-um", "50"},
                                      {}));
        ASSERT_EQ(r.exit_code, 0) << r.err;
        all.push_back({dir / ("out/" + base), dir / ("direct/" + base), {format, "html", "json"}});
      }
      if (number % 2 == 0 && !by_night()) continue;
      const std::string target = dir / (base + "-slices." + format);
      r = program("slicecorr",
                  {"slice", part, "-o", target, "--printer", printer, "--layer-um", "50"});
      ASSERT_EQ(r.exit_code, 0) << r.err;
      r = farm("submit", with({target, "--printer", printer, "--out", dir / "out"}, {}));
      ASSERT_EQ(r.exit_code, 0) << r.err;
      const std::string corrected = dir / ("direct/" + base + "-slices." + format);
      r = program("slicecorr",
                  with({"correct", target, "-o", corrected, "--printer", printer}, {}));
      ASSERT_EQ(r.exit_code, 0) << r.err;
      all.push_back(
          {dir / ("out/" + base + "-slices"), dir / ("direct/" + base + "-slices"), {format}});
    }
  }
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  for (const Expected& e : all) {
    for (const std::string& ending : e.endings) {
      ASSERT_TRUE(fs::exists(e.made + "." + ending)) << e.made << "." << ending;
      EXPECT_TRUE(text_of_file(e.made + "." + ending) == text_of_file(e.expected + "." + ending))
          << e.made << "." << ending;
    }
  }
  std::set<std::string> keys;
  for (JobId id = 1; id <= static_cast<JobId>(all.size()); ++id) {
    EXPECT_EQ(job(id).state, JobState::done);
    EXPECT_FALSE(job(id).from_cache) << job(id).name;
    keys.insert(job(id).key);
  }
  EXPECT_EQ(keys.size(), all.size()) << "another display, another key";
}

TEST_F(FarmLocal, RealMeshes) {
  const std::string mesh = slicecorr::test::real_file("meshes/clean/photonic3d_lenscap-36mm.stl");
  SLICECORR_NEEDS_FILE(mesh);
  const std::vector<std::string> process = {
      "--printer", "dual-wavelength-dlp", "--resin", "benchy-resin", "--layer-um",
      "200",       "--speed-mm-h",        "800",     "--scale",      "0.5"};
  std::vector<std::string> arguments = {mesh, "--out", dir / "out"};
  arguments.insert(arguments.end(), process.begin(), process.end());
  ASSERT_EQ(farm("submit", arguments).exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  fs::create_directories(dir / "direct");
  arguments = {"run", mesh, "-o", dir / "direct/photonic3d_lenscap-36mm.uvj"};
  arguments.insert(arguments.end(), process.begin(), process.end());
  ASSERT_EQ(program("slicecorr", arguments).exit_code, 0);
  expect_same_files(dir / "out/photonic3d_lenscap-36mm", dir / "direct/photonic3d_lenscap-36mm");
}

}  // namespace
}  // namespace slicecorr::farm
