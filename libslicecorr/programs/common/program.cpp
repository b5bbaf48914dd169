// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <new>
#include <optional>
#include <set>
#include <sstream>
#include <system_error>

#include "programs/common/flag_words.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/version.hpp"
#include "support/files/temporary.hpp"
#include "support/text/display_text.hpp"
#include "support/text/nearest.hpp"
#include "support/text/wrapped_text.hpp"

namespace hwy::platform {
/// Highway's shared library asks for it whenever it is loaded and measures for 13 ms, twice what a
/// short command takes; only its benchmarks use the answer. The library calls the first one that is
/// defined, which is this.
std::uint64_t TimerResolution();               // NOLINT(readability-identifier-naming)
std::uint64_t TimerResolution() { return 1; }  // NOLINT(readability-identifier-naming)
}  // namespace hwy::platform

namespace slicecorr::cli {

namespace {

std::atomic<bool> cancelled{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set from a signal handler");

void on_signal(int) { cancelled = true; }

/// Not by stdio: it keeps what could not be written, and tries again.
void write_all_stderr(std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(STDERR_FILENO, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

/// Where one of the three is closed, the next file that is opened gets its number, and what is said
/// would be written into it. What is closed stays without use: stdout still can't be written.
void occupy_standard_files() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (::fcntl(fd, F_GETFD) != -1 || errno != EBADF) continue;
    // The lowest number that is free.
    const int flags = fd == STDERR_FILENO ? O_WRONLY : O_RDONLY;
    [[maybe_unused]] const int taken = ::open("/dev/null", flags);
  }
}

/// How long a long command that is piped says nothing.
constexpr std::chrono::seconds kQuietTime{5};

constexpr const char* kFooter =
    "Exit codes: 0 done; 1 a defect of the program; 2 wrong usage or input; 3 physically "
    "infeasible; 4 disk or device failed; 5 a tolerance was missed, or jobs failed; 130 "
    "interrupted.";

/// Helps as wide as the terminal; elsewhere as they are. What goes on stands below where it began.
std::string wrapped(const std::string& text) {
  struct winsize size {};
  if (::isatty(STDOUT_FILENO) != 1 || ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) return text;
  return wrapped_text(text, size.ws_col);
}

/// Commands that are for people.
bool is_command(const CLI::App* app) {
  return !app->get_name().empty() && !app->get_group().empty();
}

std::string commands_of(const CLI::App& group) {
  std::string names;
  for (const CLI::App* const command : group.get_subcommands(is_command)) {
    names += (names.empty() ? "" : ", ") + command->get_name();
  }
  return names;
}

/// What people call commands: the command of the program that is meant.
struct AlsoCalled {
  std::string_view program, word, command;
};
constexpr AlsoCalled kAlsoCalled[] = {
    {"slicecorr", "predict", "verify"},    {"slicecorr", "fix", "correct"},
    {"slicecorr", "view", "section"},      {"slicecorr", "preview", "section"},
    {"slicecorr", "speed", "plan"},        {"slicecorr", "inspect", "info"},
    {"slicefarm", "worker", "run"},        {"slicefarm", "work", "run"},
    {"slicefarm", "start", "run"},         {"slicefarm", "add", "submit"},
    {"slicefarm", "queue", "status"},      {"slicefarm", "list", "status"},
    {"slicefarm", "server", "serve"},      {"slicefarm", "web", "serve"},
    {"slicefarm", "delete", "cancel"},     {"slicefarm", "remove", "cancel"},
    {"slicefarm", "printers", "machines"}, {"printbridge", "start", "print"},
    {"printbridge", "run", "print"},       {"printbridge", "continue", "resume"}};

/// The closest of these, empty where none is close.
std::string nearest(const std::string& word, const std::vector<std::string>& names) {
  const std::vector<std::string_view> views(names.begin(), names.end());
  return slicecorr::nearest(word, views);
}

}  // namespace

bool interrupted() { return cancelled; }

void write_stderr(std::string_view text) { write_all_stderr(text::readable(text)); }

Console::Console(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

ExecutionContext Console::context(int threads) {
  ExecutionContext context;
  context.threads = threads;
  context.cancel = &cancelled;
  if (quiet_) return context;
  context.notice = [this](const std::string& text) { say(text::printable(text)); };
  context.progress = [this](std::string_view stage, double done) { progress(stage, done); };
  return context;
}

void Console::say(const std::string& text) {
  if (quiet_) return;
  clear();
  write_stderr(text + "\n");
}

void Console::clear() {
  if (line_) write_all_stderr("\r\033[K");
  line_ = false;
}

void Console::progress(std::string_view stage, double done) {
  const int percent = static_cast<int>(done * 100);
  if (stage == stage_ && percent == percent_) return;
  const bool ended = percent >= 100;
  if (terminal_) {
    write_all_stderr(fmt::format("\r\033[K{} {:3d} %", text::printable(stage), percent));
    line_ = true;
    if (ended) clear();
  } else if (ended && (stage != stage_ || percent_ < 100)) {
    write_stderr(fmt::format("{}: done\n", stage));
    told_ = std::chrono::steady_clock::now();
  } else if (const auto now = std::chrono::steady_clock::now();
             !ended && now - told_ > kQuietTime) {
    // Nobody who waits at the end of a pipe is left to wonder.
    write_stderr(fmt::format("{}: {} %\n", stage, percent));
    told_ = now;
  }
  stage_ = stage;
  percent_ = percent;
}

Program::Program(const std::string& name, const std::string& description,
                 const std::string& example)
    : app_(description, name), example_(example.empty() ? "" : "Example: " + example + "\n") {
  app_.set_version_flag("--version", fmt::format("{} {}", name, version));
  app_.add_option("--threads", threads_, "Number of threads [all cores]")
      ->check(CLI::Range(0, 4096));
  app_.add_flag("--quiet", quiet_, "Nothing but errors on stderr");
  add_completion();
  app_.require_subcommand(1);
  app_.fallthrough();
  app_.footer(example_ + "Every command takes --threads and --quiet.\n" + kFooter);
  app_.failure_message([this](const CLI::App*, const CLI::Error& e) { return failure_message(e); });
}

void Program::add_completion() {
  app_.add_option_function<std::string>(
          "--completion",
          [this](const std::string& shell) {
            printed_ = completion_script(app_, shell);
            throw CLI::Success();  // before what is missing is judged, as for --help
          },
          "Print completions for bash, zsh or fish")
      ->trigger_on_parse()
      ->option_text("SHELL")
      ->check(CLI::IsMember(completion_shells()));
}

CLI::App* Program::add(const std::string& name, const std::string& text, Action action) {
  return add_to(&app_, name, text, std::move(action));
}

CLI::App* Program::add_group(const std::string& name, const std::string& text) {
  CLI::App* group = app_.add_subcommand(name, text);
  group->require_subcommand(1);
  return group;
}

CLI::App* Program::add_to(CLI::App* group, const std::string& name, const std::string& text,
                          Action action) {
  CLI::App* sub = group->add_subcommand(name, text);
  actions_.emplace_back(sub, std::move(action));
  return sub;
}

void Program::examples(const std::vector<std::pair<std::string, std::string>>& lines) {
  std::set<const CLI::App*> groups;
  for (const auto& [command, line] : lines) {
    const std::string footer =
        "Example: " + line + "\nEvery command takes --threads and --quiet.\n" + kFooter;
    CLI::App* sub = &app_;
    std::istringstream names(command);
    for (std::string name; names >> name;) {
      // A group's is that of the first of its commands.
      if (sub != &app_ && groups.insert(sub).second) sub->footer(footer);
      sub = sub->get_subcommand(name);
    }
    sub->footer(footer);
  }
}

CLI::App* Program::only(Action action) {
  only_ = std::move(action);
  app_.require_subcommand(0);
  app_.footer(example_ + kFooter);
  return &app_;
}

std::string Program::failure_message(const CLI::Error& e) const {
  const CLI::App* called = &app_;
  std::string words;  // as they were called
  while (!called->get_subcommands().empty()) {
    called = called->get_subcommands().front();
    words += called->get_name() + " ";
  }
  const std::vector<std::string> left = app_.remaining(true);
  const auto option = std::find_if(left.begin(), left.end(), [](const std::string& word) {
    return word.size() > 1 && word[0] == '-' && !number_of(word);
  });
  std::string text = e.what();
  // CLI11 says what is missing before it looks at what it does not know.
  const bool required = e.get_name() == "RequiredError";
  const bool extra = e.get_exit_code() == static_cast<int>(CLI::ExitCodes::ExtrasError);
  if (required && !only_ && !called->get_subcommands(is_command).empty()) {
    text = left.empty() ? "expected a command: " + commands_of(*called)
                        : no_command(*called, left.front());
  } else if ((required || extra) && option != left.end()) {
    text = no_option(*called, option->substr(0, option->find('=')));
  }
  return fmt::format("{0}: {1}\nSee {0} {2}--help\n", app_.get_name(), text, words);
}

std::string Program::no_command(const CLI::App& group, const std::string& word) const {
  // Who forgets `tomo` before `solve` is told.
  for (const CLI::App* const command : app_.get_subcommands(is_command)) {
    for (const CLI::App* const below : command->get_subcommands(is_command)) {
      if (below->get_name() == word) {
        return fmt::format("'{0}' is no command; did you mean '{1} {0}'?", word,
                           command->get_name());
      }
    }
  }
  std::vector<std::string> names;
  for (const CLI::App* const command : group.get_subcommands(is_command)) {
    names.push_back(command->get_name());
  }
  std::string near = nearest(word, names);
  if (near.empty()) {
    std::vector<std::string> words;
    for (const AlsoCalled& also : kAlsoCalled) {
      if (also.program == group.get_name()) words.emplace_back(also.word);
    }
    const std::string called = nearest(word, words);
    for (const AlsoCalled& also : kAlsoCalled) {
      if (!called.empty() && also.program == group.get_name() && also.word == called) {
        near = also.command;
      }
    }
  }
  if (!near.empty()) return fmt::format("'{}' is no command; did you mean '{}'?", word, near);
  return fmt::format("'{}' is no command; expected one of {}", word, commands_of(group));
}

std::string Program::no_option(const CLI::App& command, const std::string& word) const {
  std::vector<std::string> names;
  for (const CLI::App* const from : {&command, &app_}) {
    for (const CLI::Option* const option : from->get_options()) {
      if (option->get_group().empty()) continue;
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
  }
  // Known, but written before the command that it is of.
  if (std::find(names.begin(), names.end(), word) != names.end()) {
    return fmt::format("'{}' comes after {}", word, command.get_name());
  }
  const std::string near = nearest(word, names);
  return fmt::format("'{}' is no option of {}{}", word, command.get_name(),
                     near.empty() ? "" : fmt::format("; did you mean '{}'?", near));
}

int Program::run(int argc, char** argv) {
  const auto finish = [&](int code) {
    if ((std::fflush(stdout) != 0 || std::ferror(stdout)) && code == kDone) {
      write_stderr(app_.get_name() + ": stdout can't be written\n");
      return static_cast<int>(kDevice);
    }
    return code;
  };
  occupy_standard_files();
  std::signal(SIGXFSZ, SIG_IGN);
  // What the scripts of --completion ask; no option, since it is not for people.
  if (argc == 3 && std::string_view(argv[1]) == "--completion-names") {
    const std::string names = completion_names(argv[2]);
    std::fwrite(names.data(), 1, names.size(), stdout);
    return finish(kDone);
  }
  // "help run" is "run --help".
  std::vector<char*> words(argv, argv + argc);
  std::string help = "--help";
  if (argc > 1 && std::string_view(argv[1]) == "help" && !only_) {
    words.erase(words.begin() + 1);
    words.push_back(help.data());
  }
  if (const std::string apart = word_apart(app_, words); !apart.empty()) {
    write_stderr(fmt::format("{}: {}\n", app_.get_name(), text::printable(apart)));
    return finish(kInput);
  }
  try {
    app_.parse(static_cast<int>(words.size()), words.data());
  } catch (const CLI::ParseError& e) {
    std::ostringstream out, err;
    const int code = app_.exit(e, out, err) == 0 ? kDone : kInput;
    const std::string text = printed_ + wrapped(with_flag_words(out.str()));
    std::fwrite(text.data(), 1, text.size(), stdout);
    write_stderr(err.str());
    return finish(code);
  }

  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);

  Console console(quiet_);
  const auto fail = [&](int code, const std::string& text) {
    console.clear();
    write_stderr(fmt::format("{}: {}\n", app_.get_name(), text::printable(text)));
    return code;
  };
  try {
    for (const auto& [command, act] : actions_) {
      if (command->parsed()) return finish(act(console.context(threads_), console));
    }
    return only_ ? finish(only_(console.context(threads_), console)) : kInput;
  } catch (...) {
    const Failure failure = failure_at_hand();
    const bool stopped = failure.kind == Failure::Kind::cancelled;
    return fail(exit_code(failure.kind),
                stopped ? "interrupted; nothing was left half-made" : failure.text);
  }
}

ExitCode exit_code(Failure::Kind kind) {
  switch (kind) {
    case Failure::Kind::cancelled:
      return kInterrupted;
    case Failure::Kind::input:
      return kInput;
    case Failure::Kind::infeasible:
      return kInfeasible;
    case Failure::Kind::defect:
      return kDefect;
    default:
      return kDevice;
  }
}

std::optional<double> number_of(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != 0 || !std::isfinite(value)) return std::nullopt;
  return value;
}

CLI::Validator number_in(double least, double most, bool above) {
  const bool open = most >= std::numeric_limits<double>::max();
  const std::string expected =
      open    ? fmt::format("a number {} {}", above ? "above" : "of at least", least)
      : above ? fmt::format("a number above {} and at most {}", least, most)
              : fmt::format("a number from {} to {}", least, most);
  const auto check = [=](std::string& text) -> std::string {
    const auto value = number_of(text);
    if (value && *value <= most && (above ? *value > least : *value >= least)) return {};
    return fmt::format("is {}, expected {}", text, expected);
  };
  return {check, "", "number"};
}

CLI::Validator layer_height() {
  const auto check = [number = number_in(1, 1000)](std::string& text) -> std::string {
    std::string wrong = number(text);
    const auto value = number_of(text);
    if (wrong.empty() || !value || *value < 1e-3 || *value >= 1) return wrong;
    return fmt::format("{}; {:g} mm is {:g}", wrong, *value, *value * 1000);
  };
  return {check, "", "number"};
}

CLI::Validator number_above_zero() {
  return number_in(0, std::numeric_limits<double>::max(), true);
}

std::string folder_of(const std::string& path) {
  const auto parent = std::filesystem::path(path).parent_path();
  std::string folder = parent.empty() ? "." : parent.string();
  // Inputs may lie where nothing can be written.
  if (::access(folder.c_str(), W_OK) == 0) return folder;
  std::error_code error;
  const auto temporary = std::filesystem::temp_directory_path(error);
  return error ? folder : temporary.string();
}

std::string ending_of(const std::string& output, const std::vector<std::string>& endings) {
  std::string ending = std::filesystem::path(output).extension().string();
  if (std::find(endings.begin(), endings.end(), ending) != endings.end()) return ending;
  std::string list;
  for (const std::string& e : endings) list += (list.empty() ? "" : " or ") + e;
  throw InputError(output, "", "expected a name that ends in " + list);
}

void check_output(const std::string& output, const std::vector<std::string>& inputs) {
  if (output.empty() || output == "-") return;
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!input.empty() && std::filesystem::equivalent(output, input, error)) {
      throw InputError(output, "", "is an input; expected an output of another name");
    }
  }
  std::string path = output;
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  const bool exists = std::filesystem::exists(status);
  if (path != output || std::filesystem::is_directory(status)) {
    // A folder of slices: it is replaced by another beside it.
    if (exists && !std::filesystem::is_directory(status)) return;  // its writer says what is wrong
    const detail::Temporary trial{detail::make_temporary(path)};
  } else if (exists && !std::filesystem::is_regular_file(status)) {
    if (::access(path.c_str(), W_OK) != 0) {
      throw DeviceError(fmt::format("{}: can't be written: {}", output, std::strerror(errno)));
    }
  } else {
    detail::check_new_file(path);
  }
}

void print_result(const std::string& text) {
  std::string safe;
  std::string_view shown = text;
  if (::isatty(STDOUT_FILENO) == 1) shown = safe = text::readable(text);
  if (std::fwrite(shown.data(), 1, shown.size(), stdout) != shown.size() ||
      std::fflush(stdout) != 0) {
    throw DeviceError(fmt::format("stdout can't be written: {}", std::strerror(errno)));
  }
}

PendingFile::PendingFile(const std::string& path, const std::string& text) : path_(path) {
  const auto fail = [&](int code) {
    throw DeviceError(fmt::format("{}: can't be written: {}", path, std::strerror(code)));
  };
  // A device or pipe is written to: renaming would put a file in its place.
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  const bool straight = std::filesystem::exists(status) &&
                        !std::filesystem::is_regular_file(status) &&
                        !std::filesystem::is_directory(status);
  if (!straight) {
    // NOLINTNEXTLINE: the end of what std::make_unique copies from would remove the file.
    temporary_.reset(new detail::Temporary{detail::make_temporary(path)});
  }
  std::FILE* const file = std::fopen((straight ? path : temporary_->path).c_str(), "wb");
  if (!file) fail(errno);
  const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size();
  const int write_error = errno;
  const bool closed = std::fclose(file) == 0;
  if (!written || !closed) fail(written ? errno : write_error);
}

PendingFile::~PendingFile() = default;

void PendingFile::publish() {
  if (temporary_) detail::put_in_place(*temporary_, path_);
}

void write_text_file(const std::string& path, const std::string& text) {
  PendingFile(path, text).publish();
}

void print_or_write(const std::string& where, const std::string& text) {
  if (where == "-") {
    print_result(text + "\n");
  } else {
    write_text_file(where, text + "\n");
  }
}

}  // namespace slicecorr::cli
