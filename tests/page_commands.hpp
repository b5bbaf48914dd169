// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Commands of a page of docs/, to be run as they stand.
#pragma once

#include <fstream>
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

}  // namespace slicecorr::test
