// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file slurm_cluster.hpp
/// A private Slurm cluster for one test: tests/slurm_up.sh as a child, which is told through a pipe
/// what to kill. Stops with the object, or with this process.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "eventually.hpp"

namespace slicecorr::test {

/// Whether the programs are there.
inline bool has_slurm() {
  const char* const programs[] = {"munged", "munge", "slurmctld", "slurmd", "sbatch"};
  for (const char* program : programs) {
    bool found = false;
    for (const char* folder : {"/usr/sbin/", "/usr/bin/", "/sbin/", "/bin/", "/usr/local/bin/"}) {
      found = found || ::access((std::string(folder) + program).c_str(), X_OK) == 0;
    }
    if (!found) return false;
  }
  return true;
}

/// Why no cluster can be started here; empty: it can.
inline std::string no_slurm() {
  if (!has_slurm()) return "Slurm is not installed (scripts/setup --all)";
  addrinfo* found = nullptr;
  if (::getaddrinfo("localhost", nullptr, nullptr, &found) != 0) {
    return "localhost has no address here (/etc/hosts), which Slurm's daemons need";
  }
  ::freeaddrinfo(found);
  return {};
}

/// Processes whose environment, as they were started with it, has this line.
inline std::vector<pid_t> processes_with(const std::string& variable) {
  std::vector<pid_t> list;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != name.npos) continue;
    std::ifstream file("/proc/" + name + "/environ", std::ios::binary);
    for (std::string line; std::getline(file, line, '\0');) {
      if (line == variable) list.push_back(std::stoi(name));
    }
  }
  return list;
}

/// Why Slurm can't limit memory through cgroups here; empty: it can.
inline std::string no_cgroups() {
  if (::geteuid() != 0) return "limits by cgroups take root";
  const std::string groups = "/sys/fs/cgroup/";
  for (const std::string controller : {"memory", "freezer"}) {
    const std::string probe = groups + controller + "/slurm_probe_" + std::to_string(::getpid());
    if (::access((groups + controller + "/tasks").c_str(), W_OK) != 0 ||
        ::mkdir(probe.c_str(), 0777) != 0) {
      return groups + controller + " is no cgroup (version 1) that can be written";
    }
    ::rmdir(probe.c_str());
  }
  return {};
}

/// A port of the loopback, out of those that the kernel gives to outgoing connections, that no test
/// on this machine gets as long as this one has it: daemons may leave it and come back.
class ReservedPort {
 public:
  ReservedPort() {
    std::random_device random;
    constexpr unsigned lowest = 10'000, count = 22'000;
    const unsigned begin = random() % count;
    for (unsigned i = 0; i < count; ++i) {
      port_ = static_cast<int>(lowest + (begin + i) % count);
      if (reserve() && is_free()) return;
      release();
    }
    throw std::runtime_error("no free port");
  }
  ~ReservedPort() { release(); }
  ReservedPort(const ReservedPort&) = delete;
  ReservedPort& operator=(const ReservedPort&) = delete;
  int port() const { return port_; }

 private:
  /// A name in the abstract namespace goes with the process that has it, however that ends.
  bool reserve() {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string name = "slicecorr-test-port-" + std::to_string(port_);
    name.copy(address.sun_path + 1, name.size());
    socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
    return ::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) == 0;
  }
  bool is_free() const {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port_));
    const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool free = ::bind(s, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
    ::close(s);
    return free;
  }
  void release() {
    if (socket_ >= 0) ::close(socket_);
    socket_ = -1;
  }
  int port_ = 0, socket_ = -1;
};

class SlurmCluster {
 public:
  /// `configuration`: lines added to slurm.conf. `cgroups`: memory is limited through them.
  SlurmCluster(const std::string& folder, int nodes, int cpus = 2,
               const std::string& configuration = {}, bool cgroups = false) {
    // Others than tests may take a port before the daemon binds it.
    for (int tries = 0; tries < 3; ++tries) {
      folder_ = folder;
      if (tries > 0) folder_.append("-").append(std::to_string(tries));
      if (start(nodes, cpus, configuration, cgroups)) return;
      stop();
    }
    throw std::runtime_error("Slurm does not start: " + errors_);
  }
  ~SlurmCluster() { stop(); }
  SlurmCluster(const SlurmCluster&) = delete;
  SlurmCluster& operator=(const SlurmCluster&) = delete;

  std::string configuration() const { return folder_ + "/slurm.conf"; }
  std::string variable() const { return "SLURM_CONF=" + configuration(); }

  /// One of the script's commands; throws unless it was done.
  void tell(const std::string& command) {
    const std::string line = command + "\n";
    if (::write(to_, line.data(), line.size()) != static_cast<ssize_t>(line.size()) ||
        read_line(60) != "OK") {
      throw std::runtime_error("slurm_up.sh: " + command + " failed");
    }
  }

  /// Stops everything; what is still there afterwards, besides this process, is a mistake.
  void stop() {
    if (pid_ <= 0) return;
    ::close(to_);
    int status = 0;
    const bool ended = eventually([&] { return ::waitpid(pid_, &status, WNOHANG) == pid_; },
                                  std::chrono::seconds(60));
    if (!ended) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, &status, 0);
    }
    ::close(from_);
    pid_ = -1;
    // Killed already; the kernel may take a moment.
    eventually([&] { return left_over().empty(); }, std::chrono::seconds(5));
    for (const pid_t pid : left_over()) ::kill(pid, SIGKILL);
  }

 private:
  std::vector<pid_t> left_over() const {
    std::vector<pid_t> list = processes_with(variable());
    std::erase(list, ::getpid());
    return list;
  }

  bool start(int nodes, int cpus, const std::string& lines, bool cgroups) {
    std::filesystem::create_directories(folder_);
    ports_ = std::vector<ReservedPort>(static_cast<std::size_t>(nodes) + 1);
    std::vector<std::string> arguments = {SLICECORR_SOURCE_DIR "/tests/slurm_up.sh", folder_};
    for (const ReservedPort& p : ports_) arguments.push_back(std::to_string(p.port()));
    std::vector<char*> argv;
    for (std::string& a : arguments) argv.push_back(a.data());
    argv.push_back(nullptr);
    int to[2], from[2];
    if (::pipe2(to, O_CLOEXEC) != 0 || ::pipe2(from, O_CLOEXEC) != 0) {
      throw std::runtime_error("no pipes");
    }
    const std::string path = folder_ + "/up.err";
    const int err = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    ::setenv("SLURM_UP_CPUS", std::to_string(cpus).c_str(), 1);
    ::setenv("SLURM_UP_CONF", lines.c_str(), 1);
    if (lines.empty()) ::unsetenv("SLURM_UP_CONF");
    ::unsetenv("SLURM_UP_CGROUPS");
    ::unsetenv("SLURM_UP_NAMES");
    if (cgroups) {
      ::setenv("SLURM_UP_CGROUPS", "1", 1);
      // Groups are named by their node.
      ::setenv("SLURM_UP_NAMES", ("p" + arguments.back() + "n").c_str(), 1);
    }
    pid_ = ::vfork();
    if (pid_ == 0) {
      // stdin ends when this process does: the script then stops everything.
      ::dup2(to[0], STDIN_FILENO);
      ::dup2(from[1], STDOUT_FILENO);
      ::dup2(err, STDERR_FILENO);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(to[0]);
    ::close(from[1]);
    ::close(err);
    to_ = to[1];
    from_ = from[0];
    if (read_line(90) == "READY") return true;
    std::ifstream file(path);
    std::ostringstream text;
    text << file.rdbuf();
    errors_ = text.str();
    return false;
  }

  std::string read_line(int most_s) {
    std::string line;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(most_s);
    for (;;) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
                            end - std::chrono::steady_clock::now())
                            .count();
      pollfd fd{from_, POLLIN, 0};
      if (left <= 0 || ::poll(&fd, 1, static_cast<int>(left)) <= 0) return "";
      char c = 0;
      if (::read(from_, &c, 1) != 1) return "";
      if (c == '\n') return line;
      line += c;
    }
  }

  std::string folder_, errors_;
  std::vector<ReservedPort> ports_;
  pid_t pid_ = -1;
  int to_ = -1, from_ = -1;
};

}  // namespace slicecorr::test
