// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm on a Slurm cluster: each test starts one of its own, with virtual nodes on this machine,
// runs slicefarm on it as a shop would, and kills daemons, workers and services in the middle.

#include <gmock/gmock.h>

#include "farm_slurm_fixture.hpp"

namespace slicecorr::farm {
namespace {

using testing::HasSubstr;

// --- the cluster of the tests --------------------------------------------------------------------

/// With `script`, the script that looks after it is killed, too, as a whole tree of processes is
/// when a test takes too long.
class KilledTest : public FarmOnSlurm, public testing::WithParamInterface<bool> {};

TEST_P(KilledTest, LeavesNoProcess) {
  const std::string folder = folder_ + "/slurm";
  const std::string variable = "SLURM_CONF=" + folder + "/slurm.conf";
  int ready[2];
  ASSERT_EQ(::pipe2(ready, O_CLOEXEC), 0);
  const pid_t killed = ::fork();
  if (killed == 0) {
    try {
      SlurmCluster cluster(folder, 2);
      ::setenv("SLURM_CONF", cluster.configuration().c_str(), 1);
      const auto r = run_program(
          {"/usr/bin/sbatch", "--chdir=/", "--output=/dev/null", "--wrap=exec sleep 1000"});
      if (r.exit_code == 0 && eventually([] {
            return run_program({"/usr/bin/squeue", "-h", "-o", "%T"}).out == "RUNNING\n";
          })) {
        (void)!::write(ready[1], "x", 1);
      }
      for (;;) ::pause();
    } catch (const std::exception&) {
    }
    ::_exit(1);
  }
  ::close(ready[1]);
  char c = 0;
  ASSERT_EQ(::read(ready[0], &c, 1), 1) << "no job runs";
  ::close(ready[0]);
  // munged, slurmctld, two slurmd, and as soon as the job really runs a slurmstepd and the job.
  EXPECT_TRUE(eventually([&] { return test::processes_with(variable).size() >= 6; }));
  if (GetParam()) {
    for (const auto& entry : fs::directory_iterator("/proc")) {
      const std::string stat = text_of(entry.path().string() + "/stat");
      const std::size_t end = stat.rfind(") ");
      if (end == stat.npos || std::atoi(stat.c_str() + end + 4) != killed) continue;
      ::kill(std::stoi(entry.path().filename().string()), SIGKILL);
    }
  }
  ::kill(killed, SIGKILL);
  ::waitpid(killed, nullptr, 0);
  EXPECT_TRUE(eventually([&] { return test::processes_with(variable).empty(); }, seconds(30)));
}
INSTANTIATE_TEST_SUITE_P(Of, KilledTest, testing::Bool(),
                         [](const auto& p) { return p.param ? "TestAndScript" : "Test"; });

/// In a bare root folder, say. Tests that need no cgroups must not need their file system.
TEST(Cluster, StartsWhereNoCgroupFileSystemIsMounted) {
  if (const std::string why = test::no_slurm(); !why.empty()) GTEST_SKIP() << why;
  if (::geteuid() != 0) GTEST_SKIP() << "only root takes file systems away";
  std::string folder = (fs::temp_directory_path() / "farm-on-slurm-XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const test::ReservedPort controller, node;
  // In a space of mounts of its own; without input it ends as soon as it is ready.
  const auto r = run_program({"/usr/bin/unshare", "--mount", "/bin/sh", "-c",
                              "if grep -q ' /sys/fs/cgroup' /proc/mounts; then umount -R "
                              "/sys/fs/cgroup || exit 77; fi; exec \"$0\" \"$@\"",
                              SLICECORR_SOURCE_DIR "/tests/slurm_up.sh", folder,
                              std::to_string(controller.port()), std::to_string(node.port())});
  fs::remove_all(folder);
  if (r.exit_code == 77 || r.err.starts_with("unshare: "))
    GTEST_SKIP() << "can't be taken away: " << r.err;
  EXPECT_EQ(r.out, "READY\n") << r.err;
}

// --- a night -------------------------------------------------------------------------------------

class FarmOnSlurmNight : public FarmOnSlurm {};

TEST_F(FarmOnSlurmNight, BothDaemonsKilledGivesTheBytesOfTheLocalEngine) {
  constexpr int jobs = 24;
  start_cluster(2);
  // Begins first, and runs while daemons are killed.
  submit({large_part("large")}, {"--priority", "2"});
  std::vector<std::string> parts = small_parts(jobs - 1);
  submit(parts, {"--priority", "1"});
  parts.push_back(folder_ + "/large.stl");
  const pid_t service = start_service();
  ASSERT_TRUE(eventually([&] { return count(JobState::done) >= 3; })) << services_log();
  cluster_->tell("stop-controller");
  ASSERT_TRUE(eventually([&] { return squeue("%i").empty(); }));
  cluster_->tell("start-controller");
  ASSERT_TRUE(eventually([&] { return count(JobState::done) >= 8; })) << services_log();
  cluster_->tell("stop-node n1");
  cluster_->tell("start-node n1");
  EXPECT_EQ(wait_for(service), 0);
  expect_all_done_once(jobs);

  // The same on this machine, and one of them without any farm.
  const std::string local = folder_ + "/local";
  std::vector<std::string> a = {kSlicefarm, "submit"};
  a.insert(a.end(), parts.begin(), parts.end());
  for (const std::string& o : process_options()) a.push_back(o);
  a.insert(a.end(), {"--out", local, "--dir", folder_ + "/farm2"});
  ASSERT_EQ(run_program(a).exit_code, 0);
  test::RunOptions patient;
  patient.timeout = seconds(200);
  const auto run =
      run_program({kSlicefarm, "run", "--until-empty", "--dir", folder_ + "/farm2"}, patient);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::size_t compared = 0;
  for (const auto& entry : fs::directory_iterator(local)) {
    const std::string name = entry.path().filename().string();
    EXPECT_EQ(text_of(entry.path().string()), text_of(out() + "/" + name)) << name;
    ++compared;
  }
  EXPECT_EQ(compared, jobs * 3u);
  a = {SLICECORR_BIN_DIR "/slicecorr", "run", parts[0], "-o", folder_ + "/one.uvj"};
  for (const std::string& o : process_options()) a.push_back(o);
  ASSERT_EQ(run_program(a).exit_code, 0);
  EXPECT_EQ(text_of(folder_ + "/one.uvj"), text_of(out() + "/part0.uvj"));
}

// --- daemons and nodes ---------------------------------------------------------------------------

TEST_F(FarmOnSlurm, AWorkerThatWasBelievedDeadComesBackAndChangesNothing) {
  start_cluster(2);
  submit({large_part("late")});
  const pid_t service = start_service();
  std::map<std::string, pid_t> first;
  ASSERT_TRUE(eventually([&] { return !(first = workers(store())).empty(); })) << services_log();
  const auto [token, worker] = *first.begin();
  // It stands still, and the daemon of its node dies: to Slurm the node is lost.
  ASSERT_EQ(::kill(worker, SIGSTOP), 0);
  std::string node;
  ASSERT_TRUE(eventually([&] {
    node = squeue("%N");
    node = node.substr(0, node.find('\n'));
    return !node.empty();
  }));
  cluster_->tell("stop-node " + node);
  EXPECT_EQ(wait_for(service), 0) << services_log();
  expect_all_done_once(1);
  const std::vector<Attempt> attempts = model().attempts(1);
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].reason, Reason::worker_killed);
  EXPECT_THAT(attempts[0].message, HasSubstr("node lost"));

  // Now it goes on to its end.
  std::map<std::string, fs::file_time_type> before;
  for (const auto& e : fs::directory_iterator(out())) before[e.path()] = e.last_write_time();
  ASSERT_TRUE(is_alive(worker));
  ASSERT_EQ(::kill(worker, SIGCONT), 0);
  ASSERT_TRUE(eventually([&, worker = worker] { return !is_alive(worker); }));
  EXPECT_EQ(wait_for(start_service()), 0);
  expect_all_done_once(1);
  for (const auto& e : fs::directory_iterator(out())) {
    EXPECT_EQ(e.last_write_time(), before[e.path()]) << e.path();
  }
  EXPECT_FALSE(fs::exists(store() + "/attempts/" + token));
}

TEST_F(FarmOnSlurm, ANodeThatLosesPowerLosesItsAttemptsOnly) {
  start_cluster(2);
  submit({large_part("a"), part("b", 40, 30, 17), part("c", 40, 30, 16), part("d", 40, 30, 15)});
  const pid_t service = start_service();
  ASSERT_TRUE(eventually([&] { return workers(store()).size() >= 3; })) << services_log();
  cluster_->tell("power-off n1");
  cluster_->tell("start-node n1");
  EXPECT_EQ(wait_for(service), 0) << services_log();
  expect_all_done_once(4);
}

TEST_F(FarmOnSlurm, AControllerThatForgotItsLastSecondsLosesNothing) {
  start_cluster(1, 2);
  submit(small_parts(6));
  const pid_t service = start_service();
  // Killed again and again, each time as soon as something has been given to it.
  for (int i = 0; i < 3; ++i) {
    const auto begun = model().summary().attempts;
    eventually([&] { return model().summary().attempts > begun || count(JobState::done) == 6; },
               seconds(20));
    cluster_->tell("stop-controller");
    cluster_->tell("start-controller");
  }
  EXPECT_EQ(wait_for(service), 0) << services_log();
  expect_all_done_once(6);
}

TEST_F(FarmOnSlurm, CancelledTasksThatAControllerBringsBackAreCancelledAgain) {
  start_cluster(1, 1);
  submit({part("hang", 4, 4, 2), part("b", 5, 4, 2), part("c", 6, 4, 2)});
  ServiceRun run;
  run.until_empty = false;
  run.environment["SLICEFARM_TEST_FAULT"] = "correct:hang@hang";
  start_service(run);
  ASSERT_TRUE(eventually([&] {
    const std::string states = squeue("%T");
    return states.find("RUNNING") != states.npos && states.find("PENDING") != states.npos &&
           workers(store()).size() == 1;
  })) << services_log();
  // The controller is killed right after it was told; what it knows of that is chance.
  command({"cancel", "1", "2", "3"});
  ASSERT_TRUE(eventually([&] { return count(JobState::cancelled) == 3; })) << services_log();
  cluster_->tell("stop-controller");
  cluster_->tell("start-controller");
  EXPECT_TRUE(eventually([&] {
    const auto r = run_program({"/usr/bin/squeue", "--noheader", "--array", "--format=%i %T"});
    return r.exit_code == 0 && r.out.find("RUNNING") == r.out.npos &&
           r.out.find("PENDING") == r.out.npos;
  })) << squeue("%i %T");
  EXPECT_TRUE(eventually([&] { return workers(store()).empty(); }));
  EXPECT_EQ(count(JobState::cancelled), 3);
  EXPECT_FALSE(fs::exists(out()) && !fs::is_empty(out()));
}

// --- the service ---------------------------------------------------------------------------------

TEST_F(FarmOnSlurm, AServiceKilledAtAnyStageIsTakenOver) {
  // More than are given to Slurm at a time.
  constexpr int jobs = 10;
  start_cluster(2);
  submit(small_parts(jobs));
  // Each takes over from the one before; none of them comes further than its stage.
  for (const std::string stage : {"claimed", "ordered", "started", "ended", "committing", "cached",
                                  "delivered", "finished"}) {
    ServiceRun killed;
    killed.environment["SLICEFARM_TEST_SERVICE_FAULT"] = stage;
    EXPECT_EQ(wait_for(start_service(killed)), 128 + SIGKILL) << stage << services_log();
  }
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  expect_all_done_once(jobs);
}

TEST_F(FarmOnSlurm, WorkGoesOnWithoutItsServiceAndIsAdopted) {
  start_cluster(1);
  submit({large_part("large")});
  const pid_t service = start_service();
  ASSERT_TRUE(eventually([&] { return !workers(store()).empty(); })) << services_log();
  kill_service(service);
  EXPECT_EQ(workers(store()).size(), 1u);
  EXPECT_EQ(wait_for(start_service()), 0);
  expect_all_done_once(1);
  // Adopted, not done again.
  EXPECT_EQ(model().attempts(1).size(), 1u);
}

TEST_F(FarmOnSlurm, ServiceAndControllerKilledTogether) {
  start_cluster(2);
  submit(small_parts(8));
  const pid_t service = start_service();
  ASSERT_TRUE(eventually([&] { return count(JobState::done) >= 1; })) << services_log();
  kill_service(service);
  cluster_->tell("stop-controller");
  cluster_->tell("start-controller");
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  expect_all_done_once(8);
}

TEST_F(FarmOnSlurm, TomographicPrintsHaveTheBytesOfTheProgram) {
  start_cluster(1);
  const std::vector<std::string> how = {
      "--printer",    SLICECORR_PRINTERS_DIR "/model-tomography-bench.toml",
      "--resin",      "model-tomography-resin",
      "--voxel-mm",   "0.5",
      "--method",     "osmo",
      "--iterations", "3"};
  const std::vector<std::string> parts = {part("wide", 6, 3, 1), part("long", 3, 8, 1.5)};
  for (const std::string& p : parts) {
    std::vector<std::string> arguments = {"submit", p, "--mode", "tomography", "--out", out()};
    arguments.insert(arguments.end(), how.begin(), how.end());
    command(arguments);
  }
  submit({part("plain", 3, 3, 2)});
  ServiceRun run;
  EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
  for (const std::string& p : parts) {
    const std::string name = fs::path(p).stem().string(), base = folder_ + "/program-" + name;
    std::vector<std::string> arguments = {SLICECORR_BIN_DIR "/slicecorr",
                                          "tomo",
                                          "solve",
                                          p,
                                          "-o",
                                          base + ".frames",
                                          "--json",
                                          base + ".json"};
    arguments.insert(arguments.end(), how.begin(), how.end());
    const auto made = run_program(arguments);
    ASSERT_TRUE(made.exit_code == 0 || made.exit_code == 5) << made.err;
    for (const char* ending : {".frames", ".json"}) {
      EXPECT_TRUE(text_of(out() + "/" + name + ending) == text_of(base + ending)) << name << ending;
    }
  }
  EXPECT_TRUE(fs::exists(out() + "/plain.uvj"));
}

// --- cancelling, pausing -------------------------------------------------------------------------

TEST_F(FarmOnSlurm, RunningAndWaitingJobsAreCancelled) {
  // Whatever is killed earlier than that, Slurm has not killed by itself.
  start_cluster(1, 1, "KillWait=100");
  // Long enough to be in the middle of it.
  submit({part("runs", 60, 38, 90)});
  submit({part("hang", 4, 4, 2), part("waits", 5, 4, 2)});
  ServiceRun run;
  run.until_empty = false;
  run.arguments = {"--queue-ahead", "3"};
  run.environment["SLICEFARM_TEST_FAULT"] = "correct:hang@hang";
  start_service(run);
  const auto cancel = [&](JobId id, const std::string& what) {
    const auto begin = std::chrono::steady_clock::now();
    command({"cancel", std::to_string(id)});
    EXPECT_TRUE(eventually([&] { return model().job(id)->state == JobState::cancelled; }))
        << services_log();
    const double s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    RecordProperty(what + "_cancelled_ms", static_cast<int>(s * 1000));
  };
  // One core: the first runs, the others wait in Slurm.
  ASSERT_TRUE(eventually([&] {
    return workers(store()).size() == 1 && squeue("%T") == "PENDING\nPENDING\nRUNNING\n";
  })) << services_log()
      << squeue("%T");
  cancel(3, "waiting");
  const auto worker_of = [&](JobId id) -> pid_t {
    const auto all = workers(store());
    const auto found = all.find(model().job(id)->token);
    return found == all.end() ? 0 : found->second;
  };
  pid_t worker = worker_of(1);
  ASSERT_GT(worker, 1);
  cancel(1, "running");
  EXPECT_TRUE(eventually([&] { return !is_alive(worker); }));
  // One that does not listen.
  ASSERT_TRUE(eventually([&] { return (worker = worker_of(2)) > 1; })) << services_log();
  EXPECT_TRUE(eventually(
      [&] { return services_log().find("job 1 runs: cancelled") != std::string::npos; }));
  ASSERT_TRUE(eventually([&] {
    const std::string status = text_of("/proc/" + std::to_string(worker) + "/status");
    const std::size_t at = status.find("SigBlk:");
    return at != status.npos &&
           (std::strtoull(status.c_str() + at + 7, nullptr, 16) >> (SIGTERM - 1) & 1) != 0;
  })) << services_log();
  cancel(2, "deaf");
  EXPECT_TRUE(eventually([&] { return !is_alive(worker); }, seconds(50)));
  EXPECT_TRUE(eventually([&] { return squeue("%i").empty(); }));
  EXPECT_FALSE(fs::exists(out()) && !fs::is_empty(out()));
}

TEST_F(FarmOnSlurm, PauseTakesBackWhatWaits) {
  start_cluster(1, 1);
  submit({large_part("runs")});
  submit(small_parts(3));
  ServiceRun run;
  run.until_empty = false;
  const pid_t service = start_service(run);
  ASSERT_TRUE(eventually([&] {
    return workers(store()).size() == 1 && squeue("%T").find("PENDING") != std::string::npos;
  })) << services_log();
  command({"pause"});
  ASSERT_TRUE(eventually([&] { return squeue("%T").find("PENDING") == std::string::npos; }));
  ASSERT_TRUE(eventually([&] { return count(JobState::queued) >= 2; })) << services_log();
  ASSERT_TRUE(eventually([&] { return count(JobState::running) == 0; })) << services_log();
  EXPECT_EQ(count(JobState::done) + count(JobState::queued), 4);
  command({"resume"});
  ASSERT_TRUE(eventually([&] { return count(JobState::done) == 4; })) << services_log();
  ::kill(service, SIGTERM);
  wait_for(service);
  expect_all_done_once(4);
  for (JobId id = 1; id <= 4; ++id) EXPECT_EQ(model().job(id)->attempts <= 1, true) << id;
}

}  // namespace
}  // namespace slicecorr::farm
