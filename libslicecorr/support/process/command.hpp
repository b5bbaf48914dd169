// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file command.hpp
/// Programs that this one runs: without a shell, with a time limit, and without waiting for them.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace slicecorr {

struct CommandResult {
  int exit_code = -1;  ///< -1: a signal ended it, or it could not be started
  int signal = 0;      ///< that ended it; 0: none
  bool started = true;
  bool timed_out = false;
  bool too_long = false;  ///< it printed more than `Command::kLongestOutput`
  std::string out, err;
  bool ok() const { return exit_code == 0 && !timed_out && !too_long; }
  /// For messages: the last line of stderr, else how it ended.
  std::string complaint() const;
};

/// Bounds on a program beside its time; 0: none.
struct CommandLimits {
  double cpu_s = 0;
  std::int64_t data_bytes = 0, file_bytes = 0;
  int nice = 0;        ///< added to its niceness
  std::string folder;  ///< that it works in; empty: that of this process
};

/// A program that runs. It is killed when it takes longer than allowed, when this object goes, and
/// when this process ends. An object belongs to one thread, that which made it.
class Command {
 public:
  /// Most bytes that a program may print on either stream: far more than any answer that is used.
  static constexpr std::size_t kLongestOutput = std::size_t{256} << 20;

  /// `arguments[0]` is found in $PATH. `environment`: "NAME=value", put in the place of what this
  /// process has. `input` is its stdin.
  Command(const std::vector<std::string>& arguments, std::chrono::milliseconds most,
          std::string input = {}, const std::vector<std::string>& environment = {},
          const CommandLimits& limits = {});
  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  /// Takes what the program has printed; true when it has ended and `result` is whole. Does not
  /// block.
  bool done();
  /// The same, but waits for the end up to `most`.
  bool wait(std::chrono::milliseconds most);
  const CommandResult& result() const { return result_; }
  /// Asks it to end, with SIGTERM.
  void ask_to_end() const;
  /// What it has printed on stderr so far.
  const std::string& said() const { return result_.err; }
  /// Descriptors that become readable when there is something to take; for poll(2).
  std::vector<int> descriptors() const;
  double seconds() const;  ///< from start to end, or till now

 private:
  using SteadyTime = std::chrono::steady_clock;
  void take(int& descriptor, std::string& text);
  void give();
  void kill_it();

  pid_t pid_ = -1;
  int in_ = -1, out_ = -1, err_ = -1;
  std::string input_;
  std::size_t given_ = 0;
  SteadyTime::time_point begin_, end_;
  std::chrono::milliseconds most_;
  bool ended_ = false;
  CommandResult result_;
};

/// Runs a program to its end and gives what it printed.
CommandResult run_command(const std::vector<std::string>& arguments, std::chrono::milliseconds most,
                          const std::string& input = {},
                          const std::vector<std::string>& environment = {},
                          const CommandLimits& limits = {});

}  // namespace slicecorr
