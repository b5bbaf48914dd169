// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "hand_over.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <string_view>
#include <system_error>

#include "programs/common/tune_options.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

void become(const std::string& program, char** argv) {
  std::error_code error;
  const auto here = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string path = (here.parent_path() / program).string();
  // What it says of errors is said by the program that was typed: argv[0] stays that.
  execv(path.c_str(), argv);
  throw InputError(
      path, "",
      fmt::format("does this command and can't be started ({}); expected it beside slicecorr",
                  std::generic_category().message(errno)));
}

void add_tune(Program& program, char** argv) {
  const auto options = std::make_shared<TuneOptions>();
  CLI::App* sub = program.add(
      "tune",
      "Find what resin and light really are from test parts that were measured (resinctl does "
      "it)",
      [argv, options](const ExecutionContext&, Console&) -> int { become("resinctl", argv); });
  // Read by resinctl; here they are what completion offers.
  options->add_to(*sub, false);
}

int own_arguments(int argc, char** argv) {
  int at = 1;
  // What may stand before a command.
  while (at < argc && std::string_view(argv[at]).starts_with("--")) {
    at += std::string_view(argv[at]) == "--threads" ? 2 : 1;
  }
  return at < argc && std::string_view(argv[at]) == "tune" ? at + 1 : argc;
}

}  // namespace slicecorr::cli
