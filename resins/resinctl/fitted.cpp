// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fitted.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace fs = std::filesystem;

void read_fixed(const std::vector<std::string>& texts, const char* example,
                std::set<std::string>& held, std::map<std::string, double>& fixed) {
  for (const std::string& text : texts) {
    const std::size_t sign = text.find('=');
    const std::string name = text.substr(0, sign);
    if (sign == std::string::npos) {
      held.insert(name);
      continue;
    }
    const auto value = cli::number_of(text.substr(sign + 1));
    if (!value) {
      throw InputError(
          fmt::format("--fix {}: expected NAME or NAME=VALUE, such as {}", text, example));
    }
    fixed.emplace(name, *value);
  }
}

void say_saved(const resins::Saved& saved, cli::Console& console) {
  console.say(saved.unchanged ? fmt::format("{}: unchanged", saved.path)
                              : fmt::format("{}: version {} written, the one before is kept",
                                            saved.path, saved.version));
}

void copy_its_files(const std::string& from, const std::string& to) {
  const fs::path there = fs::absolute(to).parent_path();
  std::error_code error;
  if (fs::equivalent(fs::absolute(from).parent_path(), there, error)) return;
  for (const resins::Attachment& a : resins::with_its_files(from, "printer").attachments) {
    // The calibration becomes part of the new file.
    if (a.table == "blue" && a.key == "calibration") continue;
    const std::string path = (there / (a.stem + a.extension)).string();
    if (fs::exists(path, error)) {
      if (read_text_file(path) == a.bytes) continue;
      throw InputError(path, "",
                       "is there already and differs from the file of that name beside the "
                       "printer's; expected another folder for the new file");
    }
    cli::write_text_file(path, a.bytes);
  }
}

}  // namespace slicecorr::resinctl
