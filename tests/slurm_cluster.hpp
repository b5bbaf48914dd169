/// @file slurm_cluster.hpp
/// A private Slurm cluster for one test: tests/slurm_up.sh as a child, which is told through a pipe
/// what to kill. Stops with the object, or with this process.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

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

/// Waits until something holds; false when it does not in this time.
template <typename Holds>
bool eventually(Holds holds, std::chrono::seconds most = std::chrono::seconds(120)) {
  const auto end = std::chrono::steady_clock::now() + most;
  while (!holds()) {
    if (std::chrono::steady_clock::now() > end) return false;
    ::usleep(10'000);
  }
  return true;
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

class SlurmCluster {
 public:
  /// `configuration`: lines added to slurm.conf.
  SlurmCluster(const std::string& folder, int nodes, int cpus = 2,
               const std::string& configuration = {})
      : folder_(folder) {
    // A port that was free may be taken before the daemon binds it.
    for (int tries = 0; tries < 3; ++tries) {
      if (start(nodes, cpus, configuration)) return;
      stop();
      std::filesystem::remove_all(folder_);
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

  static std::vector<int> free_ports(int count) {
    std::vector<int> ports, sockets;
    for (int i = 0; i < count; ++i) {
      const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
      sockaddr_in address{};
      address.sin_family = AF_INET;
      address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      socklen_t size = sizeof address;
      auto* a = reinterpret_cast<sockaddr*>(&address);
      if (s < 0 || ::bind(s, a, size) != 0 || ::getsockname(s, a, &size) != 0) {
        throw std::runtime_error("no free port");
      }
      ports.push_back(ntohs(address.sin_port));
      sockets.push_back(s);
    }
    for (const int s : sockets) ::close(s);
    return ports;
  }

  bool start(int nodes, int cpus, const std::string& lines) {
    std::filesystem::create_directories(folder_);
    std::vector<std::string> arguments = {SLICECORR_SOURCE_DIR "/tests/slurm_up.sh", folder_};
    for (const int port : free_ports(nodes + 1)) arguments.push_back(std::to_string(port));
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
    pid_ = ::fork();
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
  pid_t pid_ = -1;
  int to_ = -1, from_ = -1;
};

}  // namespace slicecorr::test
