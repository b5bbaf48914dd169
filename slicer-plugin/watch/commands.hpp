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
  /// `command[0]` is looked up in PATH when it has no slash. `about`: the file that it is told of.
  /// Gives what went wrong; empty when it was started.
  std::string start(const std::vector<std::string>& command, const std::string& about);
  /// One that has ended in another way than well.
  struct Failed {
    std::string program, about;
  };
  /// Takes leave of those that have ended.
  std::vector<Failed> reap();
  bool any() const { return !running_.empty(); }
  /// Whether one of this name runs.
  bool runs(const std::string& program) const;

 private:
  struct Running {
    pid_t child;
    std::string program, about;
  };
  std::vector<Running> running_;
};

}  // namespace slicecorr::post
