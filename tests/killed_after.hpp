// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file killed_after.hpp
/// Programs that are killed while they run, to see what they leave.
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "run_program.hpp"

namespace slicecorr::test {

/// Starts the program, gives it that much time, kills it. Whether it was still running.
inline bool killed_after(const Command& command, const RunOptions& options,
                         std::chrono::microseconds time) {
  const TextList argv(command), envp(environment_with(options.environment));
  const pid_t child = ::vfork();
  if (child == 0) {
    const int nothing = ::open("/dev/null", O_RDWR | O_CLOEXEC);
    ::dup2(nothing, STDOUT_FILENO);
    ::dup2(nothing, STDERR_FILENO);
    if (::chdir(options.folder.c_str()) == 0) ::execve(argv.data()[0], argv.data(), envp.data());
    ::_exit(127);
  }
  std::this_thread::sleep_for(time);  // the moment itself, nothing is awaited
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFSIGNALED(status);
}

}  // namespace slicecorr::test
