// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/commands.hpp"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

namespace slicecorr::post {

std::string Commands::start(const std::vector<std::string>& command, const std::string& about) {
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& text : command) arguments.push_back(const_cast<char*>(text.c_str()));
  arguments.push_back(nullptr);

  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  // Signals as any program expects them, not as a watcher has them.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none, ours;
  sigemptyset(&none);
  sigemptyset(&ours);
  for (const int signal : {SIGINT, SIGTERM, SIGIO, SIGXFSZ}) sigaddset(&ours, signal);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &ours);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);

  pid_t child = 0;
  const int error =
      ::posix_spawnp(&child, arguments[0], &files, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) return std::generic_category().message(error);
  running_.push_back({child, command[0], about});
  return {};
}

bool Commands::runs(const std::string& program) const {
  return std::any_of(running_.begin(), running_.end(),
                     [&](const Running& r) { return r.program == program; });
}

std::vector<Commands::Failed> Commands::reap() {
  std::vector<Failed> failed;
  std::erase_if(running_, [&](const Running& r) {
    int status = 0;
    const pid_t ended = ::waitpid(r.child, &status, WNOHANG);
    if (ended == r.child && status != 0) failed.push_back({r.program, r.about});
    return ended != 0;
  });
  return failed;
}

}  // namespace slicecorr::post
