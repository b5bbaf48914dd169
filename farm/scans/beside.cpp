// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "scans/beside.hpp"

#include <filesystem>

#include "slicecorr/error.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

std::string beside_this_program(const std::string& name) {
  std::error_code error;
  const fs::path own = fs::read_symlink("/proc/self/exe", error);
  if (error) throw DeviceError("/proc/self/exe: can't be read: " + error.message());
  return (own.parent_path() / name).string();
}

std::string last_said(const CommandResult& result) {
  const std::string& said = result.err;
  const std::size_t end = said.find_last_not_of(" \r\n");
  if (end == std::string::npos) return {};
  const std::size_t line = said.find_last_of("\r\n", end);
  std::string text = said.substr(line == std::string::npos ? 0 : line + 1, end - (line + 1) + 1);
  // "slicecorr: message": who reads it in a browser has no programs.
  for (const char* program : {"slicecorr: ", "resinctl: ", "slicefarm: ", "printbridge: "}) {
    if (text.starts_with(program)) text.erase(0, std::string(program).size());
  }
  return text;
}

CommandResult run_beside(std::vector<std::string> arguments, const std::string& folder) {
  constexpr auto most = std::chrono::hours(2);  // a server ends its children earlier
  const std::string name = arguments[0];
  arguments[0] = beside_this_program(name);
  CommandLimits limits;
  limits.folder = folder;
  CommandResult result = run_command(arguments, most, {}, {}, limits);
  if (result.ok()) return result;
  std::string text = last_said(result);
  if (text.empty()) text = name + ": " + result.complaint();
  constexpr int refused = 2, infeasible = 3;  // exit codes of the contract
  if (result.exit_code == refused) throw InputError(text);
  if (result.exit_code == infeasible) throw InfeasibleError(text);
  throw DeviceError(text);
}

}  // namespace slicecorr::farm::detail
