// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/detached.hpp"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

namespace slicecorr::farm::detail {

pid_t start_detached(const std::vector<std::string>& arguments, const std::string& log) {
  // All memory is taken before the fork.
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& s : arguments) argv.push_back(const_cast<char*>(s.c_str()));
  argv.push_back(nullptr);
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  ::setsid();
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  const int in = ::open("/dev/null", O_RDONLY);
  const int out = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (in < 0 || out < 0 || ::dup2(in, STDIN_FILENO) < 0 || ::dup2(out, STDOUT_FILENO) < 0 ||
      ::dup2(out, STDERR_FILENO) < 0) {
    ::_exit(127);
  }
  ::close_range(STDERR_FILENO + 1, ~0U, 0);
  ::execvp(argv[0], argv.data());
  ::_exit(127);
}

}  // namespace slicecorr::farm::detail
