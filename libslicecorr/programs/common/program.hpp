// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What every program of the project does alike: subcommands, exit codes, progress, interruption,
/// and files that appear whole or not at all.
#pragma once

#include <CLI/CLI.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "programs/common/completion.hpp"
#include "slicecorr/parallel.hpp"
#include "support/process/failure.hpp"

namespace slicecorr::detail {
struct Temporary;
}

namespace slicecorr::cli {

/// Exit codes of the contract.
enum ExitCode {
  kDone = 0,
  kDefect = 1,
  kInput = 2,
  kInfeasible = 3,
  kDevice = 4,
  kMissed = 5,  ///< a tolerance; of a farm that has nothing left to do: jobs failed
  kInterrupted = 130,
};

/// Of what ended a program's work.
ExitCode exit_code(Failure::Kind kind);

/// Progress and remarks on stderr: a line that is rewritten on a terminal, plain lines else.
class Console {
 public:
  explicit Console(bool quiet);
  /// Nothing but errors is said.
  bool quiet() const { return quiet_; }
  /// A context that reports here and stops on SIGINT and SIGTERM.
  ExecutionContext context(int threads);
  void say(const std::string& text);
  void clear();

 private:
  void progress(std::string_view stage, double done);

  bool quiet_, terminal_, line_ = false;
  std::string stage_;
  int percent_ = -1;
  std::chrono::steady_clock::time_point told_ = std::chrono::steady_clock::now();
};

/// To stderr, with what could move a terminal's cursor or is no UTF-8 as "?". Where stderr can't be
/// written (closed, full disk) the text is lost, and nothing else.
void write_stderr(std::string_view text);

/// Whether SIGINT or SIGTERM came since `Program::run` began.
bool interrupted();

/// A program with subcommands, or with one action of its own; each takes --threads and --quiet,
/// too.
class Program {
 public:
  using Action = std::function<int(const ExecutionContext&, Console&)>;
  Program(const std::string& name, const std::string& description, const std::string& example);
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  /// Adds a subcommand; its options are added to what comes back.
  CLI::App* add(const std::string& name, const std::string& text, Action action);
  /// Adds a subcommand that only has subcommands of its own, and one of these.
  CLI::App* add_group(const std::string& name, const std::string& text);
  CLI::App* add_to(CLI::App* group, const std::string& name, const std::string& text,
                   Action action);
  /// Makes it a program without subcommands; its options are added to what comes back.
  CLI::App* only(Action action);
  /// Subcommands ("tomo solve" is one of a group) with the examples that their help shows in place of
  /// the program's own.
  void examples(const std::vector<std::pair<std::string, std::string>>& lines);
  /// Parses, calls the action of the subcommand, turns errors into messages and exit codes.
  int run(int argc, char** argv);

 private:
  void add_completion();
  std::string failure_message(const CLI::Error& error) const;
  /// What is said of a word that is no command of this group, or no option of this command.
  std::string no_command(const CLI::App& group, const std::string& word) const;
  std::string no_option(const CLI::App& command, const std::string& word) const;

  CLI::App app_;
  std::string example_;
  Action only_;
  int threads_ = 0;
  bool quiet_ = false;
  std::string printed_;  ///< in place of a command
  std::vector<std::pair<CLI::App*, Action>> actions_;
};

/// Puts the options that are added while it lives under a heading of their own in the help.
class OptionGroup {
 public:
  OptionGroup(CLI::App& app, const std::string& heading)
      : app_(app), before_(app.option_defaults()->get_group()) {
    app_.option_defaults()->group(heading);
  }
  ~OptionGroup() { app_.option_defaults()->group(before_); }
  OptionGroup(const OptionGroup&) = delete;
  OptionGroup& operator=(const OptionGroup&) = delete;

 private:
  CLI::App& app_;
  std::string before_;
};

/// Accepts finite numbers only, from `least` to `most`; `above`: `least` itself is not accepted.
CLI::Validator number_in(double least, double most, bool above = false);
CLI::Validator number_above_zero();
/// Heights of layers in micrometres, 1 to 1000. Says so where millimetres were meant.
CLI::Validator layer_height();
/// The whole text as a finite number.
std::optional<double> number_of(const std::string& text);

/// The ending of a file that is to be written, one of these. Throws `InputError`.
std::string ending_of(const std::string& output, const std::vector<std::string>& endings);
/// Before the work: throws `InputError` when an output would replace one of the inputs, and
/// `DeviceError` when it can't be written. Empty: none; -: stdout.
void check_output(const std::string& output, const std::vector<std::string>& inputs);
/// Writes results; throws `DeviceError` when stdout can't take them. On a terminal what could move
/// its cursor is "?".
void print_result(const std::string& text);
/// A text that is written already, under a temporary name beside its place. Throws `DeviceError`.
class PendingFile {
 public:
  PendingFile(const std::string& path, const std::string& text);
  ~PendingFile();
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  /// Gives it its name. Without it nothing is left behind.
  void publish();

 private:
  std::string path_;
  std::unique_ptr<detail::Temporary> temporary_;  ///< null: written straight, see write_text_file
};
/// Writes to a temporary file beside `path`, then renames it; straight into what is no ordinary
/// file.
void write_text_file(const std::string& path, const std::string& text);
/// To stdout when `where` is -, else to that file; with a line end.
void print_or_write(const std::string& where, const std::string& text);
/// The folder of a path, for scratch files; where nothing can be written there, the system's.
std::string folder_of(const std::string& path);

}  // namespace slicecorr::cli
