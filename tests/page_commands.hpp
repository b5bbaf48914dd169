// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Commands of a page of docs/, to be run as they stand.
#pragma once

#include <fstream>
#include <regex>
#include <string>
#include <vector>

namespace slicecorr::test {

/// Indented lines that begin with a word, continued lines joined.
inline std::vector<std::string> page_commands(const std::string& page, const std::string& word) {
  std::ifstream lines(page);
  std::vector<std::string> commands;
  bool open = false;
  for (std::string line; std::getline(lines, line);) {
    const bool begins = line.starts_with("    " + word);
    if (!begins && !open) continue;
    line.erase(0, line.find_first_not_of(' '));
    if (begins) commands.emplace_back();
    open = line.ends_with('\\');
    if (open) line.pop_back();
    commands.back() += line;
  }
  return commands;
}

/// Indented lines that begin with one of our programs, continued lines joined.
/// What follows a program in the background belongs to it, up to the end of its paragraph.
inline std::vector<std::string> our_commands(const std::string& page) {
  static const std::regex ours(
      " {4,}(slicecorr |slicecorr-post |slicecorr-uvtools |resinctl |slicefarm |printer-sim |"
      "printbridge ).*");
  std::ifstream lines(page);
  std::vector<std::string> commands;
  bool open = false, together = false;
  for (std::string line; std::getline(lines, line);) {
    const bool begins = std::regex_match(line, ours);
    together = together && line.rfind("    ", 0) == 0;
    if (!begins && !open && !together) continue;
    line.erase(0, line.find_first_not_of(' '));
    if (together && !open) commands.back() += '\n';
    if (begins && !together) commands.emplace_back();
    open = !line.empty() && line.back() == '\\';
    if (open) line.pop_back();
    commands.back() += line;
    if (!line.empty() && line.back() == '&') together = true;
  }
  return commands;
}

}  // namespace slicecorr::test
