// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm on a Slurm cluster: what it asks of the cluster, and what the cluster refuses. Memory,
// labels, arrays, nodes that take no work.

#include <gmock/gmock.h>

#include "farm_slurm_fixture.hpp"

namespace slicecorr::farm {
namespace {

using testing::HasSubstr;

class FarmOnSlurmWithLimits : public FarmOnSlurm {
 protected:
  /// The only job's first attempt runs a program that knows no limit in its worker's place:
  /// `reader` is what reads the output that is too large to be kept. Gives the job's attempts.
  std::vector<Attempt> expect_ended_for_memory(const std::string& reader) {
    const std::string program = folder_ + "/worker.sh";
    std::ofstream(program) << "#!/bin/sh\nif mkdir " << folder_ << "/once 2>/dev/null\n"
                           << "then head -c 1500M /dev/zero | tail | " << reader << "\n"
                           << "else exec " << kSlicefarm << " \"$@\"\nfi\n";
    fs::permissions(program, fs::perms::owner_all);
    ServiceRun run;
    run.arguments = {"--worker-program", program};
    EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
    expect_all_done_once(1);
    const std::vector<Attempt> attempts = model().attempts(1);
    EXPECT_EQ(attempts.size(), 2u);
    if (!attempts.empty()) {
      EXPECT_EQ(attempts[0].reason, Reason::out_of_memory) << attempts[0].message;
    }
    return attempts;
  }
};

TEST_F(FarmOnSlurm, TheWorkersOwnLimitStopsAJobThatTakesTooMuch) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "sanitizers take memory of their own";
  start_cluster(1);
  submit({part("eats", 4, 4, 2), part("other", 5, 4, 2)});
  ServiceRun run;
  run.environment["SLICEFARM_TEST_FAULT"] = "correct:memory:1@eats";
  EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
  expect_all_done_once(2);
  const std::vector<Attempt> attempts = model().attempts(1);
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].reason, Reason::out_of_memory);
  EXPECT_GT(attempts[1].memory_mb, attempts[0].memory_mb);
}

TEST_F(FarmOnSlurmWithLimits, SlurmsLimitStopsWhatGetsAroundTheWorkers) {
  start_cluster(1, 2,
                "JobAcctGatherType=jobacct_gather/linux\nJobAcctGatherFrequency=1\n"
                "JobAcctGatherParams=OverMemoryKill");
  submit({part("eats", 4, 4, 2)});
  expect_ended_for_memory("sleep 60");
}

TEST_F(FarmOnSlurmWithLimits, SlurmsLimitByCgroupsDoesSo) {
  if (const std::string why = test::no_cgroups(); !why.empty()) GTEST_SKIP() << why;
  start_cluster(1, 2, "", true);
  submit({part("eats", 4, 4, 2)});
  const std::vector<Attempt> attempts = expect_ended_for_memory("wc -c");
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_THAT(attempts[0].message, HasSubstr("over Slurm's memory limit"));
  EXPECT_GT(attempts[1].memory_mb, attempts[0].memory_mb);
}

TEST_F(FarmOnSlurm, WorkersThatCrashAreTriedAgainAndDamagedPartsAreNot) {
  start_cluster(1);
  submit({part("crash", 4, 4, 2), part("kill", 5, 4, 2)});
  ServiceRun run;
  run.environment["SLICEFARM_TEST_FAULT"] = "read:segv:1@crash";
  EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
  expect_all_done_once(2);
  const std::vector<Attempt> attempts = model().attempts(1);
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].reason, Reason::worker_crashed) << attempts[0].message;
}

TEST_F(FarmOnSlurm, LabelsAskForNodes) {
  start_cluster(2);
  // Only what is mapped means something to Slurm; no node has this feature.
  submit({part("a", 4, 4, 2)}, {"--label", "customer-7"});
  submit({part("b", 5, 4, 2)}, {"--label", "fast"});
  command({"set", "slurm-label.fast=constraint:nowhere", "max-attempts=1"});
  EXPECT_EQ(wait_for(start_service()), 5) << services_log();
  EXPECT_EQ(model().job(1)->state, JobState::done);
  EXPECT_EQ(model().job(2)->state, JobState::failed);
  EXPECT_EQ(model().job(2)->reason, Reason::engine_failed);
  EXPECT_THAT(model().job(2)->message, HasSubstr("feature"));
  change_settings({{"slurm-label.fast", "none"}});
  command({"retry", "2"});
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  expect_all_done_once(2);
}

TEST_F(FarmOnSlurm, ArraysKeepWithinTheClustersLimit) {
  start_cluster(2, 2, "MaxArraySize=3");
  submit(small_parts(7));
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  EXPECT_THAT(batch_folders(), testing::IsEmpty()) << "they go without a collector";
  expect_all_done_once(7);
}

TEST_F(FarmOnSlurm, NodesAreListed) {
  start_cluster(2);
  submit({part("a", 4, 4, 2)});
  ASSERT_EQ(run_program({"/usr/bin/scontrol", "update", "nodename=n2", "state=drain",
                         "reason=to be mended"})
                .exit_code,
            0);
  const auto r = run_program({kSlicefarm, "nodes", "--engine", "slurm", "--dir", farm()});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("n1"));
  EXPECT_THAT(r.out, HasSubstr("DRAIN"));
  const auto none = run_program(
      {kSlicefarm, "nodes", "--engine", "slurm", "--dir", farm(), "--partition", "nowhere"});
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("nowhere"));
}

TEST_F(FarmOnSlurm, ItIsToldWhyNothingRuns) {
  start_cluster(1);
  submit({part("a", 4, 4, 2)});
  const auto is_told = [&](const std::string& text) {
    return eventually([&] { return services_log().find(text) != std::string::npos; });
  };
  ASSERT_EQ(run_program({"/usr/bin/scontrol", "update", "nodename=n1", "state=drain",
                         "reason=to be mended"})
                .exit_code,
            0);
  ServiceRun run;
  run.until_empty = false;
  const pid_t service = start_service(run);
  EXPECT_TRUE(is_told("no node of Slurm takes work: n1 is IDLE+DRAIN (to be mended)\n"));
  EXPECT_TRUE(eventually([&] {
    const auto services = model().services();
    return !services.empty() && services.back().doing.find("to be mended") != std::string::npos;
  }));
  cluster_->tell("stop-controller");
  EXPECT_TRUE(is_told("no answer from Slurm: squeue --json: "));
  cluster_->tell("start-controller");
  // While its nodes report to it, the controller may refuse, or do it and say that it can't.
  EXPECT_TRUE(eventually([&] {
    run_program({"/usr/bin/scontrol", "update", "nodename=n1", "state=resume"});
    return run_program({"/usr/bin/sinfo", "-h", "-N", "-o", "%T"}).out == "idle\n";
  })) << services_log();
  EXPECT_TRUE(is_told("slurm works again\n")) << services_log();
  EXPECT_TRUE(is_told("job 1 a: done"));
  EXPECT_TRUE(eventually([&] { return batch_folders().empty(); }, seconds(10)))
      << "they go while the service runs";
  ::kill(service, SIGTERM);
  wait_for(service);
  expect_all_done_once(1);
}

TEST_F(FarmOnSlurm, WithoutAControllerTheServiceDoesNotStart) {
  start_cluster(1);
  submit({part("a", 4, 4, 2)});
  cluster_->tell("stop-controller");
  EXPECT_EQ(wait_for(start_service()), 4);
  EXPECT_THAT(services_log(), HasSubstr("controller"));
  EXPECT_EQ(count(JobState::queued), 1);
}

}  // namespace
}  // namespace slicecorr::farm
