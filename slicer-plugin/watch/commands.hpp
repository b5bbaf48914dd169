// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Programs that are told what became of a file.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace slicecorr::post {

/// Starts programs, without a shell and without waiting for them. For one thread.
class Commands {
 public:
  /// `command[0]` is looked up in PATH when it has no slash. Gives what went wrong; empty when it
  /// was started.
  std::string start(const std::vector<std::string>& command);
  /// Takes leave of those that have ended.
  void reap();

 private:
  std::vector<pid_t> running_;
};

}  // namespace slicecorr::post
