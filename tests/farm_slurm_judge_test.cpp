// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the engine asks of Slurm, and what it concludes from what Slurm says of its tasks. No
// cluster is needed here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "engine/slurm_tasks.hpp"
#include "engine/slurm_text.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slurm_answers.hpp"
#include "support/process/command.hpp"

namespace slicecorr::farm::detail {
namespace {

namespace fs = std::filesystem;
using slicecorr::test::captured;
using slicecorr::test::Folder;
using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::HasSubstr;

// --- submitting ---------------------------------------------------------------------------------

TEST(Needs, FollowFromTaskAndSettings) {
  Task task;
  task.threads = 3;
  task.memory_mb = 1600;
  task.expected_s = 600;
  task.labels = {"gpu", "fast", "customer-7"};
  SlurmEngineOptions options;
  options.partition = "farm";
  options.label_map = {"gpu=gres:gpu:1", "fast=partition:quick", "fast=constraint:avx2",
                       "big=bigmem"};
  const Needs n = needs_of(task, options);
  EXPECT_EQ(n.threads, 3);
  EXPECT_EQ(n.memory_mb, 1856);  // 1600 + 100 + 128, in steps of 64
  EXPECT_EQ(n.time_min, 120);    // ten times ten minutes, rounded up
  EXPECT_EQ(n.partition, "quick");
  EXPECT_EQ(n.gres, "gpu:1");
  EXPECT_EQ(n.constraint, "avx2");
  task.expected_s = 0;
  EXPECT_EQ(needs_of(task, options).time_min, 0);
}

TEST(Needs, OfTheLargestWorkerFitItsNode) {
  auto nodes = parse_nodes(captured("nodes-22.05.txt"));
  const Cluster c = cluster_of(nodes, "farm");
  EXPECT_EQ(c.nodes.size(), 2u);
  EXPECT_EQ(c.cores, 2);  // the other node is being drained
  EXPECT_EQ(c.idle_cores, 1);
  EXPECT_EQ(c.largest_cores, 2);
  EXPECT_THROW(cluster_of(nodes, "nowhere"), InputError);
  for (std::int64_t node_mb = 1000; node_mb < 70'000; node_mb += 777) {
    nodes[0].memory_mb = nodes[1].memory_mb = node_mb;
    Task task;
    task.memory_mb = cluster_of(nodes, "").largest_memory_mb;
    EXPECT_LE(needs_of(task, {}).memory_mb, node_mb);
    // No more is given away than the steps take.
    EXPECT_GE(needs_of(task, {}).memory_mb, node_mb - 128);
  }
}

TEST(Needs, PriorityIsNiceness) {
  Task task;
  const auto nice = [&](int priority) {
    task.priority = priority;
    return needs_of(task, {}).nice;
  };
  EXPECT_LT(nice(5), nice(0));
  EXPECT_LT(nice(0), nice(-5));
  // Users may not be less nice than 0, and Slurm's numbers have an end.
  EXPECT_EQ(nice(1'000'000), 0);
  EXPECT_LE(nice(std::numeric_limits<int>::min()), 2147483645);
}

TEST(Needs, MappingsAreChecked) {
  for (const char* good : {"a=b", "a=gres:gpu:2", "a=partition:p", "a=constraint:x&y"}) {
    EXPECT_NO_THROW(check_label(good)) << good;
  }
  for (const char* bad : {"", "a", "=b", "a=", "a=gres:", "a=b c", "a=b\nc"}) {
    EXPECT_THROW(check_label(bad), InputError) << bad;
  }
  Task task;
  task.labels = {"a", "b"};
  SlurmEngineOptions two;
  two.label_map = {"a=partition:x", "b=partition:y"};
  EXPECT_THROW(needs_of(task, two), InputError);
}

TEST(Names, OfJobsAreTame) {
  EXPECT_EQ(job_name({"bracket v2,left"}), "bracket_v2_left");
  EXPECT_EQ(job_name({"a", "b", "c"}), "a+2");
  EXPECT_EQ(job_name({std::string(100, 'x'), "b"}).size(), 40u);
}

TEST(Script, StartsAnAttemptOnce) {
  const Folder folder;
  const std::string store = folder.path() + "/it's a $store";
  const Batch batch{"ba", {"a1", "a2"}};
  fs::create_directories(store + "/attempts/a2");
  const std::string program = folder.path() + "/work er";
  std::ofstream(program) << "#!/bin/sh\necho \"$@\"\nexit 3\n";
  fs::permissions(program, fs::perms::owner_all);
  const auto run = [&](const char* index) {
    return run_command({"sh"}, milliseconds(20000), job_script(batch, store, program),
                       {std::string("SLURM_ARRAY_TASK_ID=") + index});
  };
  // No order yet: the node does not see what the service sees.
  EXPECT_EQ(run("1").exit_code, script_no_folder);
  EXPECT_EQ(run("0").exit_code, script_no_folder);
  EXPECT_EQ(run("7").exit_code, script_no_folder);
  EXPECT_FALSE(fs::exists(store + "/attempts/a1"));
  std::ofstream(store + "/attempts/a2/order.json") << "{}";
  const auto first = run("1");
  EXPECT_EQ(first.exit_code, 3);
  EXPECT_EQ(first.out, "worker " + store + "/attempts/a2\n");
  EXPECT_EQ(run("1").exit_code, script_started);
}

TEST(Submission, SaysAllThatSlurmMustKnow) {
  const Folder folder;
  const BatchFolder batches(folder.path());
  SlurmEngineOptions options;
  options.account = "lab";
  options.throttle = 4;
  options.sbatch_arguments = {"--exclusive=user"};
  Needs n;
  n.threads = 2;
  n.memory_mb = 900;
  n.time_min = 60;
  n.nice = 700;
  n.gres = "gpu:1";
  const auto a =
      sbatch_arguments(n, {"ba", {"a1", "a2", "a3"}}, batches, folder.path(), "x", options);
  for (const std::string& wanted :
       {std::string("sbatch"), std::string("--parsable"), std::string("--array=0-2%4"),
        std::string("--no-requeue"), std::string("--open-mode=append"), std::string("--nice=700"),
        std::string("--mem=900M"), std::string("--cpus-per-task=2"), std::string("--time=60"),
        std::string("--gres=gpu:1"), std::string("--account=lab"), std::string("--exclusive=user"),
        "--comment=slicefarm:" + batches.farm() + ":ba",
        "--output=" + folder.path() + "/slurm/ba/%a.txt"}) {
    EXPECT_NE(std::find(a.begin(), a.end(), wanted), a.end()) << wanted;
  }
}

TEST(Batches, AreWrittenAndFoundAgain) {
  const Folder folder;
  std::string farm;
  {
    const BatchFolder batches(folder.path());
    farm = batches.farm();
    EXPECT_EQ(farm.size(), 32u);
    batches.write({"ba", {"a1", "a2"}});
    fs::create_directories(folder.path() + "/attempts/a2");
    std::ofstream(folder.path() + "/slurm/ba/1.txt") << "slurm's own";
    EXPECT_TRUE(fs::exists(folder.path() + "/attempts/a2/log.txt"));
    EXPECT_TRUE(batches.has_attempt("a2"));
    EXPECT_FALSE(batches.has_attempt("a1"));
  }
  const BatchFolder again(folder.path());
  EXPECT_EQ(again.farm(), farm);
  ASSERT_EQ(again.read_all().size(), 1u);
  EXPECT_THAT(again.read("ba")->tasks, ElementsAre("a1", "a2"));
  // Damaged and foreign ones are none.
  fs::create_directories(folder.path() + "/slurm/bb");
  std::ofstream(folder.path() + "/slurm/bb/batch.json") << "{\"tasks\": [\"../../x\"]}";
  EXPECT_FALSE(again.read("bb"));
  EXPECT_FALSE(again.read("../attempts"));
  again.remove("ba");
  EXPECT_FALSE(again.read("ba"));
  EXPECT_TRUE(fs::exists(folder.path() + "/attempts/a2/log.txt"));
}

// --- judging ------------------------------------------------------------------------------------

TEST(Sight, IsOfThisFarmOnly) {
  const auto jobs = parse_squeue(captured("squeue-22.05.json"));
  const Sightings s = sightings(jobs, "f00", {});
  EXPECT_TRUE(s.tasks.contains({"bb", 0}));
  EXPECT_EQ(s.tasks.at({"aa", 1}).id, "2_1");
  EXPECT_TRUE(s.tasks.contains({"ff", 303}));
  EXPECT_FALSE(s.tasks.contains({"ff", 1}));
  EXPECT_TRUE(s.doubles.empty());
  EXPECT_TRUE(sightings(jobs, "f0", {}).tasks.empty());
}

TEST(Sight, OfACutListCountsAsWaiting) {
  const auto jobs = parse_squeue(captured("squeue-cut-22.05.json"));
  const Sightings s = sightings(jobs, "f00", {{"ff", 304}});
  EXPECT_EQ(s.tasks.size(), 304u);
  EXPECT_EQ(s.tasks.at({"ff", 303}).job.phase, SlurmPhase::waiting);
}

SlurmJob job(SlurmPhase phase, const std::string& state, int exit_code = -1, int signal = 0) {
  SlurmJob j;
  j.id = j.array = 57;
  j.tasks = {3};
  j.phase = phase;
  j.state = state;
  j.exit_code = exit_code;
  j.signal = signal;
  j.node = phase == SlurmPhase::waiting ? "" : "n1";
  j.comment = "slicefarm:f:ba";
  return j;
}

TEST(Sight, PrefersWhatRunsAndNamesDoubles) {
  SlurmJob runs = job(SlurmPhase::running, "RUNNING");
  SlurmJob waits = job(SlurmPhase::waiting, "PENDING");
  waits.id = waits.array = 58;
  for (const auto& jobs : {std::vector{runs, waits}, std::vector{waits, runs}}) {
    const Sightings s = sightings(jobs, "f", {});
    EXPECT_EQ(s.tasks.at({"ba", 3}).id, "57_3");
    EXPECT_THAT(s.doubles, ElementsAre("58_3"));
  }
  // A second start that was refused says nothing of the first.
  SlurmJob refused = job(SlurmPhase::ended, "FAILED", script_started);
  refused.id = refused.array = 59;
  for (const auto& jobs : {std::vector{runs, refused}, std::vector{refused, runs}}) {
    EXPECT_EQ(sightings(jobs, "f", {}).tasks.at({"ba", 3}).id, "57_3");
  }
}

class Judge : public testing::Test {
 protected:
  Judge() {
    held_.token = "a1";
    held_.folder = "/store/attempts/a1";
    held_.place = {"ba", 3};
    held_.since_ms = 1000;
  }
  std::optional<TaskReport> see(const SlurmJob& j, std::int64_t now,
                                WorkerTrace left = WorkerTrace::nothing) {
    const Sight sight{j, "57_3"};
    return judge(held_, &sight, left, now, now, patience_);
  }
  std::optional<TaskReport> miss(std::int64_t now, WorkerTrace left = WorkerTrace::nothing) {
    return judge(held_, nullptr, left, now, now, patience_);
  }
  HeldTask held_;
  Patience patience_;
};

TEST_F(Judge, TellsEachChangeOnce) {
  SlurmJob waits = job(SlurmPhase::waiting, "PENDING");
  waits.reason = "Resources";
  auto r = see(waits, 2000);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->state, TaskState::waiting);
  EXPECT_EQ(r->message, "in Slurm: Resources");
  EXPECT_FALSE(see(waits, 3000));
  r = see(job(SlurmPhase::running, "RUNNING"), 4000);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->state, TaskState::running);
  EXPECT_EQ(r->node, "n1");
  EXPECT_FALSE(see(job(SlurmPhase::running, "RUNNING"), 5000));
  EXPECT_FALSE(see(job(SlurmPhase::ending, "COMPLETING"), 6000));
  r = see(job(SlurmPhase::ended, "COMPLETED", 0), 7000, WorkerTrace::result);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->state, TaskState::ended);
  EXPECT_EQ(r->reason, Reason::none);
}

TEST_F(Judge, AResultIsTheEndWhateverSlurmSays) {
  auto r = see(job(SlurmPhase::running, "RUNNING"), 2000, WorkerTrace::result);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->state, TaskState::ended);
  EXPECT_EQ(r->reason, Reason::none);
  r = miss(2000, WorkerTrace::result);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::none);
}

TEST_F(Judge, WaitsForAResultThatIsToBecomeVisible) {
  EXPECT_FALSE(see(job(SlurmPhase::ended, "COMPLETED", 0), 2000));
  EXPECT_FALSE(see(job(SlurmPhase::ended, "COMPLETED", 0), 2000 + patience_.result_ms - 1));
  const auto r = see(job(SlurmPhase::ended, "COMPLETED", 0), 2000 + patience_.result_ms);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::output_invalid);
}

TEST_F(Judge, EndsHaveReasons) {
  const auto reason = [&](const char* state, int exit_code, int signal) {
    HeldTask held = held_;
    const Sight sight{job(SlurmPhase::ended, state, exit_code, signal), "57_3"};
    auto r = judge(held, &sight, WorkerTrace::nothing, 2000, 2000, patience_);
    if (!r) r = judge(held, &sight, WorkerTrace::nothing, 99'000, 99'000, patience_);
    return r->reason;
  };
  EXPECT_EQ(reason("NODE_FAIL", -1, 0), Reason::worker_killed);
  EXPECT_EQ(reason("OUT_OF_MEMORY", -1, 9), Reason::out_of_memory);
  EXPECT_EQ(reason("TIMEOUT", -1, 15), Reason::hung);
  EXPECT_EQ(reason("PREEMPTED", -1, 15), Reason::stopped);
  EXPECT_EQ(reason("CANCELLED", -1, 15), Reason::worker_killed);
  EXPECT_EQ(reason("BOOT_FAIL", -1, 0), Reason::worker_killed);
  EXPECT_EQ(reason("FAILED", -1, 11), Reason::none);  // by its signal
  EXPECT_EQ(reason("FAILED", 1, 0), Reason::none);    // by its exit code
  EXPECT_EQ(reason("FAILED", 127, 0), Reason::engine_failed);
  EXPECT_EQ(reason("FAILED", script_no_folder, 0), Reason::engine_failed);
  EXPECT_EQ(reason("FAILED", script_no_write, 0), Reason::device_failed);
  EXPECT_EQ(reason("FAILED", script_started, 0), Reason::lease_lost);
  EXPECT_EQ(reason("FAILED", 0, 0), Reason::engine_failed);
}

TEST_F(Judge, AbsenceCountsOnlyWhenItLasts) {
  // A listing from before the submission says nothing.
  EXPECT_FALSE(miss(900));
  EXPECT_EQ(held_.absences, 0);
  EXPECT_FALSE(miss(2000));
  EXPECT_FALSE(miss(2001));
  EXPECT_FALSE(miss(2002));
  EXPECT_FALSE(see(job(SlurmPhase::running, "RUNNING"), 2500)->state == TaskState::ended);
  EXPECT_FALSE(miss(3000));
  EXPECT_FALSE(miss(3000 + patience_.absent_ms - 1));
  const auto r = miss(3000 + patience_.absent_ms);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::lease_lost);
  EXPECT_THAT(r->message, HasSubstr("57_3"));
}

TEST_F(Judge, CancelledTasksEndWhenTheyVanish) {
  see(job(SlurmPhase::waiting, "PENDING"), 2000);
  held_.cancelled_ms = 3000;
  EXPECT_FALSE(judge(held_, nullptr, WorkerTrace::nothing, 2999, 3100, patience_));
  const auto r = judge(held_, nullptr, WorkerTrace::nothing, 3000, 3100, patience_);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::cancelled);
}

TEST_F(Judge, CancelledTasksEndWithoutSlurmWhenPatienceIsOver) {
  see(job(SlurmPhase::running, "RUNNING"), 2000);
  held_.cancelled_ms = 3000;
  EXPECT_FALSE(judge(held_, nullptr, WorkerTrace::nothing, -1, 3100, patience_));
  const std::int64_t late = 3000 + patience_.cancel_ms;
  EXPECT_TRUE(judge(held_, nullptr, WorkerTrace::nothing, -1, late, patience_));
  EXPECT_TRUE(see(job(SlurmPhase::ending, "COMPLETING"), late));
}

TEST_F(Judge, WithdrawnTasksAreStopped) {
  see(job(SlurmPhase::waiting, "PENDING"), 2000);
  held_.cancelled_ms = 3000;
  held_.withdrawn = true;
  const auto r = miss(3100);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::stopped);
  // One that just started when it was taken back.
  EXPECT_EQ(see(job(SlurmPhase::ended, "CANCELLED", -1, 15), 3200)->reason, Reason::stopped);
}

TEST_F(Judge, AskedToStopByOthersWaitsForSlurmsReason) {
  EXPECT_EQ(see(job(SlurmPhase::ending, "COMPLETING"), 2000, WorkerTrace::stopped)->state,
            TaskState::running);
  EXPECT_EQ(see(job(SlurmPhase::ended, "TIMEOUT", -1, 15), 2100, WorkerTrace::stopped)->reason,
            Reason::hung);
}

TEST_F(Judge, GivesUpWhatCanNeverStart) {
  SlurmJob never = job(SlurmPhase::waiting, "PENDING");
  never.reason = "PartitionTimeLimit";
  see(never, 2000);
  EXPECT_FALSE(see(never, 2000 + patience_.refused_ms - 1));
  const auto r = see(never, 2000 + patience_.refused_ms);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->reason, Reason::engine_failed);
  EXPECT_THAT(r->message, HasSubstr("PartitionTimeLimit"));
}

TEST(Log, TellsThatMemoryWasTheReason) {
  const Folder folder;
  const std::string path = folder.path() + "/log.txt";
  EXPECT_FALSE(says_over_memory(path));
  std::ofstream(path) << "it exceeded memory limit, somebody said\n";
  EXPECT_FALSE(says_over_memory(path));
  std::ofstream(path, std::ios::app)
      << "slurmstepd-n1: error: Step 1.4294967291 hit memory limit at least once\n"
         "slurmstepd-n1: error: StepId=1.batch exceeded memory limit (209715200 > 52428800), being "
         "killed\n";
  EXPECT_TRUE(says_over_memory(path));
}

}  // namespace
}  // namespace slicecorr::farm::detail
