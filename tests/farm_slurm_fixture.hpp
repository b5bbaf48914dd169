// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_slurm_fixture.hpp
/// A farm on a Slurm cluster of the test's own, with virtual nodes on this machine.
#pragma once

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
#include <utility>

#include "farm_program.hpp"
#include "ladder.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/store.hpp"
#include "slurm_cluster.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using std::chrono::seconds;
using test::eventually;
using test::kSlicefarm;
using test::run_program;
using test::SlurmCluster;

inline std::string text_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

inline bool is_alive(pid_t pid) {
  const std::string stat = text_of("/proc/" + std::to_string(pid) + "/stat");
  return !stat.empty() && stat.find(") Z") == stat.npos;
}

/// Workers of attempts in this farm: token and process.
inline std::map<std::string, pid_t> workers(const std::string& store) {
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
    if (const std::string why = test::no_slurm(); !why.empty()) GTEST_SKIP() << why;
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
    std::error_code error;
    fs::remove_all(folder_, error);
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
    arguments.insert(arguments.begin(), kSlicefarm);
    arguments.insert(arguments.end(), {"--dir", farm()});
    const auto r = run_program(arguments);
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  /// As `slicefarm set` does it, without a program.
  void change_settings(const std::vector<std::pair<std::string, std::string>>& changes) const {
    Queue(open_folder(farm()).database()).change_settings(changes, "anna");
  }
  void submit(const std::vector<std::string>& parts, std::vector<std::string> more = {}) {
    std::vector<std::string> a = {"submit"};
    a.insert(a.end(), parts.begin(), parts.end());
    for (const std::string& o : process_options()) a.push_back(o);
    a.insert(a.end(), {"--out", out()});
    a.insert(a.end(), more.begin(), more.end());
    command(a);
    change_settings({{"retry-delay-s", "0"}});
  }

  /// A service in the background.
  pid_t start_service(const ServiceRun& run = {}) {
    std::vector<std::string> a = {test::slicefarm_for(run.environment),
                                  "run",
                                  "--dir",
                                  farm(),
                                  "--engine",
                                  "slurm",
                                  "--slurm-poll-s",
                                  "0.3"};
    if (run.until_empty) a.emplace_back("--until-empty");
    a.insert(a.end(), run.arguments.begin(), run.arguments.end());
    std::vector<char*> argv;
    for (std::string& s : a) argv.push_back(s.data());
    argv.push_back(nullptr);
    const std::string log = folder_ + "/service.log";
    const int fd = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    for (const auto& [name, value] : run.environment) ::setenv(name.c_str(), value.c_str(), 1);
    const pid_t pid = ::vfork();
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
    for (const FarmEvent& e : m.events(0, 100'000)) {
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
    const FarmFolder folder = open_folder(farm());
    Queue queue(folder.database());
    collect_garbage(folder, queue, {.older_than_days = 1000});
    EXPECT_TRUE(fs::is_empty(store() + "/attempts"));
    EXPECT_THAT(batch_folders(), testing::IsEmpty());
    std::size_t files = 0;
    for (const auto& entry : fs::directory_iterator(out())) {
      EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path();
      ++files;
    }
    // Stack, report, figures and design of each.
    EXPECT_EQ(files, static_cast<std::size_t>(jobs) * 4);
  }

  /// What the engine keeps of the tasks that it gave to Slurm.
  std::vector<std::string> batch_folders() const {
    std::vector<std::string> list;
    for (const auto& entry : fs::directory_iterator(store() + "/slurm")) {
      if (entry.is_directory()) list.push_back(entry.path().filename().string());
    }
    return list;
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

}  // namespace slicecorr::farm
