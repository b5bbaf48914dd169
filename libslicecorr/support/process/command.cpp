// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/process/command.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <system_error>

#include "slicecorr/error.hpp"
#include "support/process/memory_limit.hpp"

namespace slicecorr {

namespace {

void close_fd(int& fd) {
  if (fd >= 0) ::close(fd);
  fd = -1;
}

/// The file that a shell would run; empty when there is none.
std::string find_program(const std::string& name) {
  if (name.find('/') != name.npos) return name;
  const char* text = std::getenv("PATH");
  const std::string path = text ? text : "/usr/local/bin:/usr/bin:/bin";
  for (std::size_t at = 0; at <= path.size();) {
    const std::size_t colon = std::min(path.find(':', at), path.size());
    std::string file = path.substr(at, colon - at);
    file.append("/").append(name);
    if (colon > at && ::access(file.c_str(), X_OK) == 0) return file;
    at = colon + 1;
  }
  return {};
}

/// In the child, before the program: system calls only.
bool bound(const CommandLimits& limits) {
  const auto set = [](int what, std::int64_t most) {
    const rlimit limit{static_cast<rlim_t>(most), static_cast<rlim_t>(most)};
    return most <= 0 || ::setrlimit(static_cast<__rlimit_resource_t>(what), &limit) == 0;
  };
  if (limits.nice > 0 && ::setpriority(PRIO_PROCESS, 0, limits.nice) != 0) return false;
  if (!limits.folder.empty() && ::chdir(limits.folder.c_str()) != 0) return false;
  return set(RLIMIT_CPU, static_cast<std::int64_t>(std::ceil(limits.cpu_s))) &&
         set(RLIMIT_DATA, kLimitsMemory ? limits.data_bytes : 0) &&
         set(RLIMIT_FSIZE, limits.file_bytes);
}

}  // namespace

std::string CommandResult::complaint() const {
  if (!started) return err;
  if (timed_out) return "no answer in time";
  if (too_long) return "the answer is too long";
  std::size_t end = err.find_last_not_of(" \n");
  if (end == err.npos) return "exit code " + std::to_string(exit_code);
  ++end;
  const std::size_t line = err.rfind('\n', end - 1);
  const std::size_t begin = line == err.npos ? 0 : line + 1;
  return err.substr(begin, end - begin);
}

Command::Command(const std::vector<std::string>& arguments, std::chrono::milliseconds most,
                 std::string input, const std::vector<std::string>& environment,
                 const CommandLimits& limits)
    : input_(std::move(input)), begin_(SteadyTime::now()), most_(most) {
  // All memory is taken before the fork: the child only makes system calls.
  const std::string program = find_program(arguments.at(0));
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& s : arguments) argv.push_back(const_cast<char*>(s.c_str()));
  argv.push_back(nullptr);
  std::vector<char*> envp;
  for (char** v = environ; v != nullptr && *v != nullptr; ++v) {
    const std::string text = *v;
    bool replaced = false;
    for (const std::string& e : environment) {
      replaced = replaced || text.compare(0, e.find('=') + 1, e, 0, e.find('=') + 1) == 0;
    }
    if (!replaced) envp.push_back(*v);
  }
  for (const std::string& e : environment) envp.push_back(const_cast<char*>(e.c_str()));
  envp.push_back(nullptr);

  std::array<int, 2> in{-1, -1}, out{-1, -1}, err{-1, -1};
  // A socket instead of a pipe for stdin, since writing to a program that has ended must not raise
  // SIGPIPE.
  const bool piped = !program.empty() &&
                     ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, in.data()) == 0 &&
                     ::pipe2(out.data(), O_CLOEXEC) == 0 && ::pipe2(err.data(), O_CLOEXEC) == 0;
  const pid_t parent = ::getpid();
  if (piped) pid_ = ::fork();
  if (pid_ == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::setpgid(0, 0);
    sigset_t none;
    ::sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    ::signal(SIGPIPE, SIG_DFL);
    if (bound(limits) && ::getppid() == parent && ::dup2(in[0], STDIN_FILENO) >= 0 &&
        ::dup2(out[1], STDOUT_FILENO) >= 0 && ::dup2(err[1], STDERR_FILENO) >= 0) {
      // Connections of a server, which it did not open itself, may lack close-on-exec.
      ::close_range(STDERR_FILENO + 1, ~0U, 0);
      ::execve(program.c_str(), argv.data(), envp.data());
    }
    ::_exit(127);
  }
  const int why = errno;
  for (int* fd : {&in[0], &out[1], &err[1]}) close_fd(*fd);
  in_ = in[1];
  out_ = out[0];
  err_ = err[0];
  if (pid_ < 0) {
    for (int* fd : {&in_, &out_, &err_}) close_fd(*fd);
    result_.started = false;
    result_.err = arguments[0] + (program.empty() ? ": there is no such program"
                                                  : ": " + std::generic_category().message(why));
    ended_ = true;
    return;
  }
  for (const int fd : {in_, out_, err_}) ::fcntl(fd, F_SETFL, O_NONBLOCK);
  give();
}

Command::~Command() {
  if (pid_ > 0) {
    kill_it();
    ::waitpid(pid_, nullptr, 0);
  }
  for (int* fd : {&in_, &out_, &err_}) close_fd(*fd);
}

void Command::kill_it() {
  // Kills its group, for what it may have started; and itself, in case it has not made its group
  // yet.
  ::kill(-pid_, SIGKILL);
  ::kill(pid_, SIGKILL);
}

void Command::ask_to_end() const {
  if (pid_ > 0) ::kill(pid_, SIGTERM);
}

void Command::give() {
  while (in_ >= 0 && given_ < input_.size()) {
    const ssize_t n = ::send(in_, input_.data() + given_, input_.size() - given_, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n < 0) break;
    given_ += static_cast<std::size_t>(n);
  }
  close_fd(in_);
}

void Command::take(int& descriptor, std::string& text) {
  std::array<char, 65536> buffer;
  while (descriptor >= 0) {
    const ssize_t n = ::read(descriptor, buffer.data(), buffer.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) return close_fd(descriptor);
    if (text.size() + static_cast<std::size_t>(n) > kLongestOutput) {
      result_.too_long = true;
      kill_it();
      return close_fd(descriptor);
    }
    text.append(buffer.data(), static_cast<std::size_t>(n));
  }
}

bool Command::done() {
  if (ended_) return true;
  give();
  take(out_, result_.out);
  take(err_, result_.err);
  if (!result_.timed_out && SteadyTime::now() - begin_ > most_) {
    result_.timed_out = true;
    kill_it();
  }
  int status = 0;
  const pid_t gone = ::waitpid(pid_, &status, WNOHANG);
  if (gone == 0) return false;
  pid_ = -1;
  take(out_, result_.out);
  take(err_, result_.err);
  if (gone > 0 && WIFEXITED(status)) result_.exit_code = WEXITSTATUS(status);
  if (gone > 0 && WIFSIGNALED(status)) result_.signal = WTERMSIG(status);
  for (int* fd : {&in_, &out_, &err_}) close_fd(*fd);
  end_ = SteadyTime::now();
  return ended_ = true;
}

bool Command::wait(std::chrono::milliseconds most) {
  const auto until = SteadyTime::now() + most;
  while (!done()) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(until - SteadyTime::now()).count();
    if (left <= 0) return false;
    std::vector<pollfd> fds;
    for (const int fd : descriptors()) fds.push_back({fd, POLLIN, 0});
    if (in_ >= 0) fds.push_back({in_, POLLOUT, 0});
    // Time limits, and programs that close their outputs and live on, are noticed by looking again.
    ::poll(fds.data(), fds.size(),
           static_cast<int>(std::min<long long>(left, fds.empty() ? 2 : 20)));
  }
  return true;
}

std::vector<int> Command::descriptors() const {
  std::vector<int> list;
  for (const int fd : {out_, err_}) {
    if (fd >= 0) list.push_back(fd);
  }
  return list;
}

double Command::seconds() const {
  return std::chrono::duration<double>((ended_ ? end_ : SteadyTime::now()) - begin_).count();
}

CommandResult run_command(const std::vector<std::string>& arguments, std::chrono::milliseconds most,
                          const std::string& input, const std::vector<std::string>& environment,
                          const CommandLimits& limits) {
  Command command(arguments, most, input, environment, limits);
  while (!command.wait(most + std::chrono::seconds(1))) {
  }
  return command.result();
}

}  // namespace slicecorr
