// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Workers as processes of this machine.

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <thread>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"
#include "support/files/errno_message.hpp"
#include "values/process_mark.hpp"

namespace slicecorr::farm {

namespace {

using SteadyTime = std::chrono::steady_clock;

/// Share of the free memory that workers get; the rest is for caches and other programs.
constexpr double kShareOfFreeMemory = 0.8;

/// A worker that was asked to end gets this long.
constexpr auto kPatience = std::chrono::milliseconds(800);

/// Longest wait at a time where the kernel can't tell of the ends of processes.
constexpr auto kBlindWait = std::chrono::milliseconds(50);

std::int64_t number_in(const std::string& path) {
  std::ifstream file(path);
  std::int64_t value = -1;
  file >> value;
  return file ? value : -1;
}

/// Throws `DeviceError`: who does not know how much is free would wait for it for ever.
std::int64_t available_memory_mb() {
  constexpr const char* path = "/proc/meminfo";
  std::ifstream file(path);
  if (!file) throw DeviceError(slicecorr::detail::errno_message(path, "can't be read"));
  std::string name;
  std::int64_t kb = 0, available = 0;
  for (std::string unit; file >> name >> kb; std::getline(file, unit)) {
    if (name == "MemAvailable:") available = kb / 1024;
  }
  // Containers may have less than the machine: cgroup v2, then v1.
  const auto limited = [&](const char* limit, const char* used) {
    const std::int64_t most = number_in(limit), now = number_in(used);
    if (most > 0 && now >= 0 && most < (std::int64_t{1} << 60)) {
      available = std::min(available, std::max<std::int64_t>(0, (most - now) >> 20));
    }
  };
  limited("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current");
  limited("/sys/fs/cgroup/memory/memory.limit_in_bytes",
          "/sys/fs/cgroup/memory/memory.usage_in_bytes");
  return available;
}

std::int64_t resident_mb(pid_t pid) {
  std::ifstream file(fmt::format("/proc/{}/statm", pid));
  std::int64_t size = 0, resident = 0;
  if (!(file >> size >> resident)) return 0;
  return resident * ::sysconf(_SC_PAGESIZE) >> 20;
}

int usable_cores() {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (::sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
  return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

class LocalEngine final : public Engine {
 public:
  explicit LocalEngine(const LocalEngineOptions& options) : options_(options) {
    if (options_.cores <= 0) options_.cores = usable_cores();
    if (options_.jobs <= 0) options_.jobs = options_.cores;
    if (options_.memory_mb <= 0) {
      options_.memory_mb = static_cast<std::int64_t>(static_cast<double>(available_memory_mb()) *
                                                     kShareOfFreeMemory);
    }
  }
  ~LocalEngine() override {
    for (const auto& [token, w] : workers_) ::kill(-w.pid, SIGKILL);
    for (const auto& [token, w] : workers_) {
      while (::waitpid(w.pid, nullptr, 0) < 0 && errno == EINTR) {
      }
      if (w.pidfd >= 0) ::close(w.pidfd);
    }
  }

  std::string name() const override { return "local"; }
  bool outlives_service() const override { return false; }

  EngineCapacity capacity() override {
    EngineCapacity capacity;
    std::int64_t promised = 0, not_taken = 0;
    int threads = 0;
    for (const auto& [token, w] : workers_) {
      promised += w.task.memory_mb;
      not_taken += std::max<std::int64_t>(0, w.task.memory_mb - resident_mb(w.pid));
      threads += w.task.threads;
    }
    capacity.tasks = options_.jobs - static_cast<int>(workers_.size());
    capacity.cores = std::max(0, options_.cores - threads);
    // What was free at the start may be in use by others now.
    const auto now = static_cast<std::int64_t>(static_cast<double>(available_memory_mb()) * 0.9);
    capacity.memory_mb =
        std::max<std::int64_t>(0, std::min(options_.memory_mb - promised, now - not_taken));
    capacity.largest_memory_mb = options_.memory_mb;
    return capacity;
  }

  std::vector<std::string> submit(const std::vector<Task>& tasks) override {
    std::vector<std::string> ids;
    ids.reserve(tasks.size());
    for (const Task& task : tasks) ids.push_back(start(task));
    return ids;
  }

  std::vector<TaskReport> poll() override {
    std::vector<TaskReport> reports = std::move(failed_);
    failed_.clear();
    const auto now = SteadyTime::now();
    for (auto it = workers_.begin(); it != workers_.end();) {
      Worker& w = it->second;
      if (w.asked && now >= w.force_at) ::kill(-w.pid, SIGKILL);
      int status = 0;
      rusage used{};
      const pid_t ended = ::wait4(w.pid, &status, WNOHANG, &used);
      if (ended == 0 || (ended < 0 && errno == EINTR)) {
        if (!w.told) {
          reports.push_back(report(w, TaskState::running));
          w.told = true;
        }
        ++it;
        continue;
      }
      TaskReport r = report(w, TaskState::ended);
      if (ended == w.pid) {
        if (WIFEXITED(status)) r.exit_code = WEXITSTATUS(status);
        if (WIFSIGNALED(status)) r.signal = WTERMSIG(status);
        r.cpu_s = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                  static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec) * 1e-6;
        r.peak_mb = used.ru_maxrss / 1024;
      } else {
        r.reason = Reason::engine_failed;
        r.message = fmt::format("the worker can't be waited for: {}", std::strerror(errno));
      }
      // No process of its group may stay behind.
      ::kill(-w.pid, SIGKILL);
      if (w.pidfd >= 0) ::close(w.pidfd);
      reports.push_back(std::move(r));
      it = workers_.erase(it);
    }
    return reports;
  }

  void wait(std::chrono::milliseconds most, int wake_fd) override {
    std::vector<pollfd> waits;
    if (wake_fd >= 0) waits.push_back({wake_fd, POLLIN, 0});
    const auto now = SteadyTime::now();
    for (const auto& [token, w] : workers_) {
      if (w.pidfd >= 0) {
        waits.push_back({w.pidfd, POLLIN, 0});
      } else {
        most = std::min(most, kBlindWait);
      }
      if (w.asked) {
        most = std::min(most, std::chrono::duration_cast<std::chrono::milliseconds>(
                                  std::max(w.force_at - now, SteadyTime::duration(kBlindWait))));
      }
    }
    if (!failed_.empty()) return;
    ::poll(waits.data(), waits.size(), static_cast<int>(most.count()));
  }

  void cancel(const std::vector<std::string>& tokens) override {
    for (const std::string& token : tokens) {
      const auto found = workers_.find(token);
      if (found == workers_.end() || found->second.asked) continue;
      found->second.asked = true;
      found->second.force_at = SteadyTime::now() + kPatience;
      ::kill(-found->second.pid, SIGTERM);
    }
  }

  std::vector<std::string> adopt(const std::vector<Attempt>& attempts) override {
    // Workers die with their service; one that did not (its parent was gone before it could ask
    // for that) is ended here, if it is really ours.
    for (const Attempt& a : attempts) {
      const std::size_t point = a.engine_id.find('.');
      if (point == a.engine_id.npos) continue;
      const long pid = std::atol(a.engine_id.c_str());
      const std::int64_t start = std::atoll(a.engine_id.c_str() + point + 1);
      if (pid <= 1 || start == 0 || detail::mark_of(pid).start != start) continue;
      std::ifstream file(fmt::format("/proc/{}/cmdline", pid), std::ios::binary);
      const std::string command(std::istreambuf_iterator<char>(file), {});
      if (command.find(a.token) != command.npos) ::kill(static_cast<pid_t>(-pid), SIGKILL);
    }
    return {};
  }

  std::vector<FarmNode> nodes() override {
    FarmNode node;
    char name[256] = {};
    ::gethostname(name, sizeof name - 1);
    node.name = name;
    node.state = workers_.empty() ? "idle" : "busy";
    node.cores = options_.cores;
    node.memory_mb = options_.memory_mb;
    for (const auto& [token, w] : workers_) {
      node.cores_used += w.task.threads;
      node.memory_used_mb += w.task.memory_mb;
    }
    return {node};
  }

 private:
  struct Worker {
    Task task;
    pid_t pid = 0;
    int pidfd = -1;
    bool told = false, asked = false;
    SteadyTime::time_point force_at{};
  };

  TaskReport report(const Worker& w, TaskState state) const {
    TaskReport r;
    r.token = w.task.token;
    r.state = state;
    return r;
  }

  std::string start(const Task& task) {
    const auto fail = [&](const std::string& what) {
      TaskReport r;
      r.token = task.token;
      r.state = TaskState::ended;
      r.reason = Reason::engine_failed;
      r.message = fmt::format("{}: {}", what, std::strerror(errno));
      failed_.push_back(std::move(r));
      return std::string();
    };
    // All memory is taken before the fork: the child only makes system calls.
    const std::string log_path = task.folder + "/log.txt";
    const char* argv[] = {options_.program.c_str(), "worker", task.folder.c_str(), nullptr};
    const int log = ::open(log_path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    const int nothing = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (log < 0 || nothing < 0) {
      std::string id = fail(log_path + ": can't be written");
      if (log >= 0) ::close(log);
      if (nothing >= 0) ::close(nothing);
      return id;
    }
    const pid_t parent = ::getpid();
    const pid_t child = ::fork();
    if (child == 0) {
      ::setpgid(0, 0);
      // The worker dies with the service; the service may be gone already, which is asked after
      // this.
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() != parent) ::_exit(127);
      sigset_t none;
      sigemptyset(&none);
      ::sigprocmask(SIG_SETMASK, &none, nullptr);
      ::dup2(nothing, STDIN_FILENO);
      ::dup2(log, STDOUT_FILENO);
      ::dup2(log, STDERR_FILENO);
      // When memory runs out the kernel should kill a worker first.
      const int oom = ::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
      if (oom >= 0) {
        [[maybe_unused]] const ssize_t n = ::write(oom, "500", 3);
      }
      ::execv(argv[0], const_cast<char**>(argv));
      ::_exit(127);
    }
    ::close(log);
    ::close(nothing);
    if (child < 0) return fail("no process");
    ::setpgid(child, child);  // parent and child both do it: one of them is first
    Worker w;
    w.task = task;
    w.pid = child;
    w.pidfd = static_cast<int>(::syscall(SYS_pidfd_open, child, 0));
    if (w.pidfd >= 0) ::fcntl(w.pidfd, F_SETFD, FD_CLOEXEC);
    std::string id = fmt::format("{}.{}", child, detail::mark_of(child).start);
    workers_.emplace(task.token, std::move(w));
    return id;
  }

  LocalEngineOptions options_;
  std::map<std::string, Worker> workers_;
  std::vector<TaskReport> failed_;
};

}  // namespace

std::unique_ptr<Engine> make_local_engine(const LocalEngineOptions& options) {
  return std::make_unique<LocalEngine>(options);
}

}  // namespace slicecorr::farm
