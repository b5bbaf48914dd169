// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fitted.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr::resinctl {

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

}  // namespace slicecorr::resinctl
