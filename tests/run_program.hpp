// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run_program.hpp
/// Runs a program as a user would: own arguments, environment and folder; takes what it prints.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace slicecorr::test {

/// Instrumented programs take several times as long.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kSlowdown = 8;
#else
inline constexpr int kSlowdown = 1;
#endif

/// A program and its arguments, or some of these.
using Command = std::vector<std::string>;

inline Command operator+(Command left, const Command& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

struct RunOptions {
  /// Added to the environment of the test, or put in its place there.
  std::map<std::string, std::string> environment;
  std::string folder;         ///< working folder; empty: that of the test
  std::string stdout_path;    ///< where stdout goes; empty: to `RunResult::out`
  rlim_t largest_file = 0;    ///< no file may grow beyond this many bytes; 0: no limit
  bool unprivileged = false;  ///< as nobody, where the test is root
  int signal = 0;             ///< sent once, as soon as `signal_when` holds
  std::function<bool(const std::string& out, const std::string& err)> signal_when;
  std::chrono::milliseconds timeout{60000};  ///< killed after this, times kSlowdown
};

struct RunResult {
  int exit_code = -1;  ///< 128 + number when a signal ended it, as a shell says it
  bool timed_out = false;
  bool signalled = false;  ///< the signal was sent while it ran
  std::string out, err;
};

/// Texts as `execve` takes them. They are this test's own and die with it.
class TextList {
 public:
  explicit TextList(std::vector<std::string> texts) : texts_(std::move(texts)) {
    for (std::string& s : texts_) pointers_.push_back(s.data());
    pointers_.push_back(nullptr);
  }
  TextList(const TextList&) = delete;
  TextList& operator=(const TextList&) = delete;
  char* const* data() const { return pointers_.data(); }

 private:
  std::vector<std::string> texts_;
  std::vector<char*> pointers_;
};

/// The environment of this test, with these variables added, or in place of those of their names.
inline std::vector<std::string> environment_with(const std::map<std::string, std::string>& more) {
  std::vector<std::string> variables;
  for (char** v = environ; *v != nullptr; ++v) {
    const std::string text = *v;
    if (!more.contains(text.substr(0, text.find('=')))) variables.push_back(text);
  }
  for (const auto& [name, value] : more) variables.push_back(name + "=" + value);
  return variables;
}

// Programs are started by vfork. After a fork each page that the test writes to is copied: up to
// 4 ms for each MiB on a virtual machine, which tests with large images feel.
// All memory is taken before, and the child makes system calls alone.

inline RunResult run_program(const Command& command, const RunOptions& options = {}) {
  using Clock = std::chrono::steady_clock;
  const TextList argv(command), envp(environment_with(options.environment));
  int out[2], err[2];
  if (::pipe2(out, O_CLOEXEC) != 0 || ::pipe2(err, O_CLOEXEC) != 0) {
    throw std::runtime_error("no pipes");
  }
  // To change user is told to all threads of a memory, and this one would be shared.
  constexpr uid_t nobody = 65534;
  const volatile bool as_nobody =  // in memory: registers may not last through vfork
      options.unprivileged && ::geteuid() == 0;
  const pid_t child = as_nobody ? ::fork() : ::vfork();
  if (child < 0) throw std::runtime_error("no process");
  if (child == 0) {
    int to = out[1];
    if (!options.stdout_path.empty()) {
      to = ::open(options.stdout_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    }
    const int nothing = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    bool ready = ::dup2(nothing, STDIN_FILENO) >= 0 && ::dup2(to, STDOUT_FILENO) >= 0 &&
                 ::dup2(err[1], STDERR_FILENO) >= 0;
    if (!options.folder.empty()) ready = ready && ::chdir(options.folder.c_str()) == 0;
    if (options.largest_file > 0) {
      const rlimit limit{options.largest_file, options.largest_file};
      ready = ready && ::setrlimit(RLIMIT_FSIZE, &limit) == 0;
    }
    if (as_nobody) {
      // Opened while we may: nobody can't enter root's home, where the program may lie.
      const int program = ::open(argv.data()[0], O_RDONLY | O_CLOEXEC);
      ready = ready && program >= 0 && ::setgid(nobody) == 0 && ::setuid(nobody) == 0;
      if (ready) ::fexecve(program, argv.data(), envp.data());
    }
    if (ready) ::execve(argv.data()[0], argv.data(), envp.data());
    ::_exit(127);
  }
  ::close(out[1]);
  ::close(err[1]);

  RunResult result;
  std::array<pollfd, 2> pipes{{{out[0], POLLIN, 0}, {err[0], POLLIN, 0}}};
  const std::array<std::string*, 2> texts{&result.out, &result.err};
  const Clock::time_point end = Clock::now() + options.timeout * kSlowdown;
  // What a signal waits for may be a file; else there is nothing to look after but the time.
  const int look_ms = options.signal != 0 ? 2 : 100;
  while (pipes[0].fd >= 0 || pipes[1].fd >= 0) {
    ::poll(pipes.data(), pipes.size(), look_ms);
    for (std::size_t i = 0; i < pipes.size(); ++i) {
      if (pipes[i].fd < 0 || pipes[i].revents == 0) continue;
      std::array<char, 65536> buffer;
      const ssize_t n = ::read(pipes[i].fd, buffer.data(), buffer.size());
      if (n > 0) {
        texts[i]->append(buffer.data(), static_cast<std::size_t>(n));
      } else if (n == 0) {
        pipes[i].fd = -1;
      }
    }
    if (options.signal != 0 && !result.signalled &&
        (!options.signal_when || options.signal_when(result.out, result.err))) {
      result.signalled = ::kill(child, options.signal) == 0;
    }
    if (!result.timed_out && Clock::now() > end) {
      result.timed_out = true;
      ::kill(child, SIGKILL);
    }
  }
  ::close(out[0]);
  ::close(err[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return result;
}

}  // namespace slicecorr::test
