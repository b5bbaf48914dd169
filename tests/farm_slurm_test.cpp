// The farm on a Slurm cluster: each test starts one of its own, with virtual nodes on this machine,
// runs slicefarm on it as a shop would, and kills daemons, workers and services in the middle.

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/store.hpp"
#include "slurm_cluster.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;
using test::eventually;
using test::run_program;
using test::SlurmCluster;
using testing::HasSubstr;

const std::string slicefarm = SLICECORR_BIN_DIR "/slicefarm";

std::string text_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

bool is_alive(pid_t pid) {
  const std::string stat = text_of("/proc/" + std::to_string(pid) + "/stat");
  return !stat.empty() && stat.find(") Z") == stat.npos;
}

/// Workers of attempts in this farm: token and process.
std::map<std::string, pid_t> workers(const std::string& store) {
  std::map<std::string, pid_t> found;
  const std::string prefix = store + "/attempts/";
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != name.npos) continue;
    std::istringstream command(text_of("/proc/" + name + "/cmdline"));
    std::string program, verb, folder;
    std::getline(command, program, '\0');
    std::getline(command, verb, '\0');
    std::getline(command, folder, '\0');
    if (verb == "worker" && folder.starts_with(prefix)) {
      found[folder.substr(prefix.size())] = std::stoi(name);
    }
  }
  return found;
}

struct ServiceRun {
  std::vector<std::string> arguments;
  std::map<std::string, std::string> environment;
  bool until_empty = true;
};

class FarmOnSlurm : public testing::Test {
 protected:
  void SetUp() override {
    if (!test::has_slurm()) {
      GTEST_SKIP() << "slurmctld, slurmd or munged is not installed (scripts/setup --all)";
    }
    std::string path = (fs::temp_directory_path() / "farm-on-slurm-XXXXXX").string();
    folder_ = ::mkdtemp(path.data());
    ::setenv("SLICECORR_DB", SLICECORR_DB_DIR, 1);
  }
  void TearDown() override {
    if (folder_.empty()) return;
    for (const pid_t service : services_) ::kill(service, SIGKILL);
    for (const pid_t service : services_) ::waitpid(service, nullptr, 0);
    const std::string variable = cluster_ ? cluster_->variable() : "";
    cluster_.reset();
    if (!variable.empty()) {
      std::vector<pid_t> left = test::processes_with(variable);
      std::erase(left, ::getpid());
      EXPECT_TRUE(left.empty()) << "processes of the cluster are left";
    }
    if (HasFailure()) {
      std::cerr << "--- service\n" << text_of(folder_ + "/service.log");
    }
    fs::remove_all(folder_);
  }

  void start_cluster(int nodes, int cpus = 2, const std::string& configuration = {},
                     bool cgroups = false) {
    cluster_ =
        std::make_unique<SlurmCluster>(folder_ + "/slurm", nodes, cpus, configuration, cgroups);
    ::setenv("SLURM_CONF", cluster_->configuration().c_str(), 1);
  }

  std::string farm() const { return folder_ + "/farm"; }
  std::string store() const { return farm() + "/store"; }
  std::string out() const { return folder_ + "/out"; }

  /// A box; every one differs from every other.
  std::string part(const std::string& name, double x_mm, double y_mm, double z_mm) {
    TriangleMesh mesh;
    test::add_box(mesh, {0, 0, 0}, {x_mm, y_mm, z_mm});
    test::add_box(mesh, {0, 0, z_mm + 0.5}, {x_mm, y_mm, z_mm + 1});
    const std::string path = folder_ + "/" + name + ".stl";
    test::write_stl(path, mesh);
    return path;
  }
  std::vector<std::string> small_parts(int count) {
    std::vector<std::string> paths;
    for (int i = 0; i < count; ++i) {
      paths.push_back(part("part" + std::to_string(i), 3 + 0.5 * i, 5, 2 + 0.1 * i));
    }
    return paths;
  }
  /// Takes some seconds.
  std::string large_part(const std::string& name) { return part(name, 40, 30, 18); }

  static std::vector<std::string> process_options() {
    return {"--printer",    SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml",
            "--resin",      "benchy-resin",
            "--layer-um",   "50",
            "--speed-mm-h", "800"};
  }

  void command(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), slicefarm);
    arguments.insert(arguments.end(), {"--dir", farm()});
    const auto r = run_program(arguments);
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  void submit(const std::vector<std::string>& parts, std::vector<std::string> more = {}) {
    std::vector<std::string> a = {"submit"};
    a.insert(a.end(), parts.begin(), parts.end());
    for (const std::string& o : process_options()) a.push_back(o);
    a.insert(a.end(), {"--out", out()});
    a.insert(a.end(), more.begin(), more.end());
    command(a);
    command({"set", "retry-delay-s=0"});
  }

  /// A service in the background.
  pid_t start_service(const ServiceRun& run = {}) {
    std::vector<std::string> a = {slicefarm,  "run",   "--dir",          farm(),
                                  "--engine", "slurm", "--slurm-poll-s", "0.3"};
    if (run.until_empty) a.emplace_back("--until-empty");
    a.insert(a.end(), run.arguments.begin(), run.arguments.end());
    std::vector<char*> argv;
    for (std::string& s : a) argv.push_back(s.data());
    argv.push_back(nullptr);
    const std::string log = folder_ + "/service.log";
    const int fd = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    for (const auto& [name, value] : run.environment) ::setenv(name.c_str(), value.c_str(), 1);
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::dup2(fd, STDOUT_FILENO);
      ::dup2(fd, STDERR_FILENO);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    for (const auto& [name, value] : run.environment) ::unsetenv(name.c_str());
    ::close(fd);
    services_.push_back(pid);
    return pid;
  }
  /// 128 + signal when one ended it; -1 when it does not end.
  int wait_for(pid_t service, seconds most = seconds(200)) {
    int status = 0;
    const bool ended =
        eventually([&] { return ::waitpid(service, &status, WNOHANG) == service; }, most);
    if (!ended) return -1;
    std::erase(services_, service);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  void kill_service(pid_t service) {
    ::kill(service, SIGKILL);
    wait_for(service);
  }

  ReadModel model() { return ReadModel(farm() + "/farm.sqlite"); }
  std::int64_t count(JobState state) {
    return model().summary().jobs[static_cast<std::size_t>(state)];
  }
  std::string services_log() { return text_of(folder_ + "/service.log"); }

  /// All jobs done, each once, nothing open and nothing left over.
  void expect_all_done_once(int jobs) {
    ReadModel m = model();
    EXPECT_EQ(count(JobState::done), jobs);
    std::map<JobId, int> done;
    for (const Event& e : m.events(0, 100'000)) {
      if (e.kind == "done") ++done[e.job];
    }
    EXPECT_EQ(done.size(), static_cast<std::size_t>(jobs));
    for (const auto& [id, times] : done) EXPECT_EQ(times, 1) << "job " << id;
    JobFilter all;
    all.limit = 100'000;
    for (const Job& j : m.jobs(all)) {
      int succeeded = 0;
      for (const Attempt& a : m.attempts(j.id)) {
        EXPECT_EQ(a.phase, "ended") << "job " << j.id;
        succeeded += a.reason == Reason::none;
      }
      EXPECT_EQ(succeeded, 1) << "job " << j.id;
      // What was delivered is what was made.
      for (const ResultFile& f : j.files) {
        EXPECT_EQ(sha256_of_file(j.output(f.ending)).sha256, f.sha256) << j.output(f.ending);
      }
    }
    // A service that was killed right after it recorded the end leaves a folder to the collector.
    command({"gc", "--older-than-days", "1000"});
    EXPECT_TRUE(fs::is_empty(store() + "/attempts"));
    std::size_t files = 0;
    for (const auto& entry : fs::directory_iterator(out())) {
      EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path();
      ++files;
    }
    EXPECT_EQ(files, static_cast<std::size_t>(jobs) * 3);
  }

  std::string squeue(const std::string& format) {
    return run_program(
               {"/usr/bin/squeue", "--noheader", "--array", "--sort=t", "--format=" + format})
        .out;
  }

  std::string folder_;
  std::unique_ptr<SlurmCluster> cluster_;
  std::vector<pid_t> services_;
};

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

// --- a night -------------------------------------------------------------------------------------

TEST_F(FarmOnSlurm, ANightInSmallWithBothDaemonsKilledGivesTheBytesOfTheLocalEngine) {
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
  std::vector<std::string> a = {slicefarm, "submit"};
  a.insert(a.end(), parts.begin(), parts.end());
  for (const std::string& o : process_options()) a.push_back(o);
  a.insert(a.end(), {"--out", local, "--dir", folder_ + "/farm2"});
  ASSERT_EQ(run_program(a).exit_code, 0);
  test::RunOptions patient;
  patient.timeout = seconds(200);
  const auto run =
      run_program({slicefarm, "run", "--until-empty", "--dir", folder_ + "/farm2"}, patient);
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
  ASSERT_TRUE(eventually([&] { return !is_alive(worker); }));
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
  constexpr int jobs = 16;
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
    std::cout << what << ": cancelled in " << s << " s\n";
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

// --- memory, labels, refusals --------------------------------------------------------------------

TEST_F(FarmOnSlurm, TheWorkersOwnLimitStopsAJobThatTakesTooMuch) {
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

TEST_F(FarmOnSlurm, SlurmsLimitStopsWhatGetsAroundTheWorkers) {
  start_cluster(1, 2,
                "JobAcctGatherType=jobacct_gather/linux\nJobAcctGatherFrequency=1\n"
                "JobAcctGatherParams=OverMemoryKill");
  submit({part("eats", 4, 4, 2)});
  // In the worker's place, a program that knows no limit, at the first attempt.
  const std::string program = folder_ + "/worker.sh";
  std::ofstream(program) << "#!/bin/sh\nif mkdir " << folder_ << "/once 2>/dev/null\n"
                         << "then head -c 1500M /dev/zero | tail | sleep 60\n"
                         << "else exec " << slicefarm << " \"$@\"\nfi\n";
  fs::permissions(program, fs::perms::owner_all);
  ServiceRun run;
  run.arguments = {"--worker-program", program};
  EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
  expect_all_done_once(1);
  const std::vector<Attempt> attempts = model().attempts(1);
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].reason, Reason::out_of_memory) << attempts[0].message;
}

TEST_F(FarmOnSlurm, SlurmsLimitByCgroupsDoesSo) {
  if (const std::string why = test::no_cgroups(); !why.empty()) GTEST_SKIP() << why;
  start_cluster(1, 2, "", true);
  submit({part("eats", 4, 4, 2)});
  const std::string program = folder_ + "/worker.sh";
  std::ofstream(program) << "#!/bin/sh\nif mkdir " << folder_ << "/once 2>/dev/null\n"
                         << "then head -c 1500M /dev/zero | tail | wc -c\n"
                         << "else exec " << slicefarm << " \"$@\"\nfi\n";
  fs::permissions(program, fs::perms::owner_all);
  ServiceRun run;
  run.arguments = {"--worker-program", program};
  EXPECT_EQ(wait_for(start_service(run)), 0) << services_log();
  expect_all_done_once(1);
  const std::vector<Attempt> attempts = model().attempts(1);
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].reason, Reason::out_of_memory) << attempts[0].message;
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
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  EXPECT_EQ(model().job(1)->state, JobState::done);
  EXPECT_EQ(model().job(2)->state, JobState::failed);
  EXPECT_EQ(model().job(2)->reason, Reason::engine_failed);
  EXPECT_THAT(model().job(2)->message, HasSubstr("feature"));
  command({"set", "slurm-label.fast=none"});
  command({"retry", "2"});
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  expect_all_done_once(2);
}

TEST_F(FarmOnSlurm, ArraysKeepWithinTheClustersLimit) {
  start_cluster(2, 2, "MaxArraySize=3");
  submit(small_parts(7));
  EXPECT_EQ(wait_for(start_service()), 0) << services_log();
  expect_all_done_once(7);
}

TEST_F(FarmOnSlurm, NodesAreListed) {
  start_cluster(2);
  submit({part("a", 4, 4, 2)});
  ASSERT_EQ(run_program({"/usr/bin/scontrol", "update", "nodename=n2", "state=drain",
                         "reason=to be mended"})
                .exit_code,
            0);
  const auto r = run_program({slicefarm, "nodes", "--engine", "slurm", "--dir", farm()});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("n1"));
  EXPECT_THAT(r.out, HasSubstr("DRAIN"));
  const auto none = run_program(
      {slicefarm, "nodes", "--engine", "slurm", "--dir", farm(), "--partition", "nowhere"});
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
    return services_log().find("slurm works again\n") != std::string::npos;
  })) << services_log();
  EXPECT_TRUE(eventually([&] { return count(JobState::done) == 1; }));
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
