// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the engine for Slurm makes of Slurm's answers: captured ones of Slurm 22.05 (tests/slurm),
// and what follows from them. No cluster is needed here.

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
using testing::EndsWith;
using testing::HasSubstr;

const SlurmJob& job_of(const std::vector<SlurmJob>& jobs, const std::string& comment) {
  for (const SlurmJob& j : jobs) {
    if (j.comment == comment) return j;
  }
  throw std::runtime_error("no job " + comment);
}

// --- commands -----------------------------------------------------------------------------------

TEST(Commands, GiveOutputsAndExitCodeAndTakeInput) {
  const auto r = run_command({"sh", "-c", "cat; echo err >&2; exit 7"}, milliseconds(20000), "in");
  EXPECT_EQ(r.out, "in");
  EXPECT_EQ(r.err, "err\n");
  EXPECT_EQ(r.exit_code, 7);
  EXPECT_FALSE(r.ok());
  EXPECT_EQ(r.complaint(), "err");
}

TEST(Commands, PassOnArgumentsAsTheyAre) {
  const std::string odd = "a b'c\"$(false);*\n%x";
  EXPECT_EQ(run_command({"printf", "%s", odd}, milliseconds(20000)).out, odd);
}

TEST(Commands, TakeInputThatNobodyReads) {
  // More than any pipe holds: giving it must neither block nor raise SIGPIPE.
  const std::string much(8 << 20, 'x');
  EXPECT_TRUE(run_command({"true"}, milliseconds(20000), much).ok());
}

TEST(Commands, TakeMuchOutput) {
  const auto r = run_command({"head", "-c", "3000000", "/dev/zero"}, milliseconds(20000));
  EXPECT_EQ(r.out.size(), 3'000'000u);
  EXPECT_TRUE(r.ok());
}

TEST(Commands, AreKilledWithWhatTheyStartedWhenTimeIsUp) {
  const Folder folder;
  const std::string file = folder.path() + "/pid";
  const auto r =
      run_command({"sh", "-c", "sleep 1000 & echo $! >" + file + "; wait"}, milliseconds(300));
  EXPECT_TRUE(r.timed_out);
  EXPECT_FALSE(r.ok());
  long pid = 0;
  std::ifstream(file) >> pid;
  ASSERT_GT(pid, 1);
  const auto gone = [&] {
    std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
    std::string text;
    std::getline(stat, text);
    return text.empty() || text.find(") Z") != text.npos;
  };
  for (int i = 0; i < 1000 && !gone(); ++i) ::usleep(10000);
  EXPECT_TRUE(gone());
}

TEST(Commands, SayWhatIsMissing) {
  const auto r = run_command({"slicefarm-no-such-program"}, milliseconds(1000));
  EXPECT_FALSE(r.started);
  EXPECT_FALSE(r.ok());
  EXPECT_THAT(r.complaint(), HasSubstr("slicefarm-no-such-program"));
}

TEST(Commands, ReplaceVariables) {
  const auto r =
      run_command({"sh", "-c", "echo $HOME"}, milliseconds(20000), "", {"HOME=elsewhere"});
  EXPECT_EQ(r.out, "elsewhere\n");
}

// --- squeue -------------------------------------------------------------------------------------

TEST(Squeue, IsReadAsSlurm2205GivesIt) {
  const auto jobs = parse_squeue(captured("squeue-22.05.json"));
  ASSERT_EQ(jobs.size(), 9u);
  const SlurmJob& failed = job_of(jobs, "slicefarm:f00:bb");
  EXPECT_EQ(failed.phase, SlurmPhase::ended);
  EXPECT_EQ(failed.state, "FAILED");
  EXPECT_EQ(failed.exit_code, 3);
  EXPECT_EQ(failed.signal, 0);
  EXPECT_EQ(failed.array, 3);
  EXPECT_THAT(failed.tasks, ElementsAre(0));
  const SlurmJob& crashed = job_of(jobs, "slicefarm:f00:cc");
  EXPECT_EQ(crashed.exit_code, -1);
  EXPECT_EQ(crashed.signal, 11);
  EXPECT_EQ(job_of(jobs, "slicefarm:f00:dd").exit_code, 0);
  EXPECT_EQ(job_of(jobs, "slicefarm:f00:ee").state, "CANCELLED");
  EXPECT_EQ(job_of(jobs, "oom").signal, 9);
  const SlurmJob& held = job_of(jobs, "other");
  EXPECT_EQ(held.phase, SlurmPhase::waiting);
  EXPECT_EQ(held.reason, "JobHeldUser");
  EXPECT_EQ(held.array, 0);
  const SlurmJob& waiting = job_of(jobs, "slicefarm:f00:ff");
  EXPECT_EQ(waiting.tasks.size(), 104u);
  EXPECT_EQ(waiting.tasks.back(), 303);
  EXPECT_FALSE(waiting.more_tasks);
  EXPECT_EQ(job_of(jobs, "slicefarm:f00:aa").phase, SlurmPhase::running);
}

TEST(Squeue, WithoutControllerIsNoEmptyList) {
  // Exit code 0 and "jobs": [] is what 22.05 gave.
  try {
    parse_squeue(captured("squeue-down-22.05.json"));
    FAIL();
  } catch (const DeviceError& e) {
    EXPECT_THAT(e.what(), HasSubstr("Failed while looking for jobs"));
  }
}

TEST(Squeue, TellsThatAListOfTasksWasCut) {
  const auto jobs = parse_squeue(captured("squeue-cut-22.05.json"));
  ASSERT_EQ(jobs.size(), 1u);
  EXPECT_TRUE(jobs[0].more_tasks);
  // The last number before the dots may be cut itself.
  EXPECT_EQ(jobs[0].tasks.back(), 40);
}

TEST(Squeue, IsReadAsNewerOnesGiveIt) {
  // By the format's description; not captured.
  const auto jobs = parse_squeue(R"({"errors": [], "jobs": [
    {"job_id": 12, "array_job_id": {"set": true, "infinite": false, "number": 11},
     "array_task_id": {"set": true, "infinite": false, "number": 0}, "array_task_string": "",
     "job_state": ["CANCELLED", "COMPLETING"], "state_reason": "None", "comment": "c", "nodes": "n1",
     "exit_code": {"status": ["SIGNALED"], "return_code": {"set": false, "number": 0},
                   "signal": {"id": {"set": true, "infinite": false, "number": 15}, "name": "TERM"}}},
    {"job_id": 13, "array_job_id": {"set": true, "infinite": false, "number": 13},
     "array_task_id": {"set": false, "infinite": false, "number": 0}, "array_task_string": "1,4-5",
     "job_state": ["PENDING"], "state_reason": "Priority", "comment": "d", "nodes": ""},
    {"job_id": 14, "array_job_id": {"set": true, "infinite": false, "number": 0},
     "job_state": ["FAILED"], "comment": "e",
     "exit_code": {"status": ["ERROR"], "return_code": {"set": true, "infinite": false, "number": 3},
                   "signal": {"id": {"set": false, "infinite": false, "number": 0}}}}]})");
  ASSERT_EQ(jobs.size(), 3u);
  EXPECT_EQ(jobs[0].phase, SlurmPhase::ending);
  EXPECT_THAT(jobs[0].tasks, ElementsAre(0));
  EXPECT_THAT(jobs[1].tasks, ElementsAre(1, 4, 5));
  EXPECT_EQ(jobs[1].phase, SlurmPhase::waiting);
  EXPECT_EQ(jobs[2].exit_code, 3);
  EXPECT_EQ(jobs[2].array, 0);
}

TEST(Squeue, RefusesWhatIsNotWhole) {
  const std::string whole = captured("squeue-22.05.json");
  for (const std::size_t cut :
       {std::size_t{0}, std::size_t{1}, whole.size() / 3, whole.size() - 3}) {
    EXPECT_THROW(parse_squeue(whole.substr(0, cut)), DeviceError) << cut;
  }
  for (
      const char* text :
      {"[]", "null", "{}", R"({"jobs": 3})", R"({"jobs": [3]})", R"({"jobs": [{}]})",
       R"({"jobs": [{"job_id": 1}]})", R"({"jobs": [{"job_id": "1", "job_state": "RUNNING"}]})",
       R"({"jobs": [{"job_id": 1, "job_state": []}]})",
       R"({"jobs": [{"job_id": 1, "job_state": "RUNNING", "comment": 3}]})",
       R"({"jobs": [{"job_id": 1, "array_job_id": 1, "array_task_string": "1-x", "job_state": "PENDING"}]})",
       R"({"errors": [{"error": "no"}], "jobs": []})"}) {
    EXPECT_THROW(parse_squeue(text), DeviceError) << text;
  }
}

TEST(Squeue, BelievesThatStatesItDoesNotKnowRun) {
  const auto jobs = parse_squeue(R"({"jobs": [{"job_id": 1, "job_state": "NEW_IN_2030"}]})");
  EXPECT_EQ(jobs.at(0).phase, SlurmPhase::running);
}

TEST(TaskLists, AreTakenApart) {
  bool more = false;
  EXPECT_THAT(parse_task_list("3", more), ElementsAre(3));
  EXPECT_THAT(parse_task_list("0-2,5,8-12:2%4", more), ElementsAre(0, 1, 2, 5, 8, 10, 12));
  EXPECT_TRUE(parse_task_list("", more).empty());
  EXPECT_FALSE(more);
  EXPECT_THAT(parse_task_list("1,2,3...%2", more), ElementsAre(1, 2));
  EXPECT_TRUE(more);
  for (const char* bad : {"a", "1,,2", "3-1", "1-5:0", "-1", "1-99999999999", "1-2-3"}) {
    EXPECT_THROW(parse_task_list(bad, more), DeviceError) << bad;
  }
}

// --- other answers ------------------------------------------------------------------------------

TEST(Sbatch, GivesItsNumber) {
  EXPECT_EQ(parse_sbatch("57\n"), 57);
  EXPECT_EQ(parse_sbatch("57;farmtest\n"), 57);
  for (const char* bad : {"", "\n", "Submitted batch job 57", "0", "57x", "-3"}) {
    EXPECT_THROW(parse_sbatch(bad), DeviceError) << bad;
  }
}

TEST(Sbatch, RefusalsAreToldApart) {
  // Texts as 22.05 gave them, and of slurm_errno.
  EXPECT_EQ(refusal_of("sbatch: error: Batch job submission failed: Unable to contact slurm "
                       "controller (connect failure)"),
            Refusal::unsure);
  EXPECT_EQ(refusal_of("sbatch: error: Batch job submission failed: Socket timed out on send/recv "
                       "operation"),
            Refusal::unsure);
  EXPECT_EQ(refusal_of("sbatch: error: Batch job submission failed: Job violates accounting/QOS "
                       "policy (job submit limit, user's size and/or time limits)"),
            Refusal::later);
  EXPECT_EQ(
      refusal_of("sbatch: error: Batch job submission failed: Requested node configuration is not "
                 "available"),
      Refusal::for_good);
  EXPECT_EQ(refusal_of("sbatch: error: Batch job submission failed: Invalid feature specification"),
            Refusal::for_good);
}

TEST(Scontrol, FieldsKeepSpacesAndEqualsSigns) {
  const auto f = parse_fields(
      "NodeName=n1 OS=Linux 6.1 #1 SMP  ReqB:S:C:T=0:0:*:* Reason=to be mended [root@now] ");
  EXPECT_EQ(f.at("NodeName"), "n1");
  EXPECT_EQ(f.at("OS"), "Linux 6.1 #1 SMP");
  EXPECT_EQ(f.at("ReqB:S:C:T"), "0:0:*:*");
  EXPECT_EQ(f.at("Reason"), "to be mended [root@now]");
}

TEST(Scontrol, NodesAreRead) {
  const auto nodes = parse_nodes(captured("nodes-22.05.txt"));
  ASSERT_EQ(nodes.size(), 2u);
  EXPECT_EQ(nodes[0].name, "n1");
  EXPECT_EQ(nodes[0].state, "MIXED");
  EXPECT_TRUE(nodes[0].usable);
  EXPECT_EQ(nodes[0].cores, 2);
  EXPECT_EQ(nodes[0].cores_used, 1);
  EXPECT_EQ(nodes[0].memory_mb, 6000);
  EXPECT_EQ(nodes[0].memory_used_mb, 64);
  EXPECT_THAT(nodes[0].partitions, ElementsAre("farm"));
  EXPECT_TRUE(nodes[0].features.empty());
  EXPECT_EQ(nodes[1].state, "MIXED+DRAIN");
  EXPECT_FALSE(nodes[1].usable);
  for (const char* state : {"DOWN*", "IDLE*", "IDLE+DRAIN", "DOWN+NOT_RESPONDING", "FAIL"}) {
    const auto n = parse_nodes(std::string("NodeName=a State=") + state +
                               " CPUTot=4 CPUAlloc=0 RealMemory=10 AllocMem=0");
    EXPECT_FALSE(n.at(0).usable) << state;
  }
  EXPECT_THROW(parse_nodes("slurm_load_node error: Unable to contact slurm controller"),
               DeviceError);
  EXPECT_THROW(parse_nodes("NodeName=n1 State=IDLE CPUTot=x CPUAlloc=0 RealMemory=1 AllocMem=0"),
               DeviceError);
}

TEST(Scontrol, ItIsSaidWhyNoNodeWorks) {
  const auto node = [](const std::string& name, const std::string& state, const std::string& why) {
    return "NodeName=" + name + " State=" + state +
           " CPUTot=4 CPUAlloc=0 RealMemory=1000 AllocMem=0 Partitions=farm" +
           (why.empty() ? "" : " Reason=" + why) + "\n";
  };
  const auto why = [](const std::string& nodes) {
    return no_node_works(cluster_of(parse_nodes(nodes), "farm"));
  };
  const std::string drained =
      node("n1", "IDLE+DRAIN", "Duplicate jobid [slurm@2026-03-01T20:00:00]");
  EXPECT_EQ(why(drained + node("n2", "IDLE", "")), "");
  EXPECT_EQ(why(drained + node("n2", "DOWN*", "")),
            "no node of Slurm takes work: n1 is IDLE+DRAIN (Duplicate jobid); n2 is DOWN*");
  EXPECT_THAT(why(drained + drained + drained + drained + drained), EndsWith("); 2 more"));
}

TEST(Scontrol, ConfigurationIsRead) {
  const auto c = parse_config(captured("config-22.05.txt"));
  EXPECT_EQ(c.at("MaxArraySize"), "10001");
  EXPECT_EQ(c.at("SLURM_VERSION"), "22.05.8");
  EXPECT_THROW(parse_config(""), DeviceError);
}

}  // namespace
}  // namespace slicecorr::farm::detail
