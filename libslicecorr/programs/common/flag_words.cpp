// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/flag_words.hpp"

#include <fmt/format.h>

#include <regex>
#include <string_view>

namespace slicecorr::cli {

namespace {

/// Whether all that the option checks takes the word; of options that check nothing none.
bool takes(CLI::Option& option, const std::string& word) {
  std::string changed = word;
  bool checked = false;
  try {
    for (int i = 0;; ++i) {
      const CLI::Validator& check = *option.get_validator(i);
      if (!check(changed).empty()) return false;
      checked = true;
    }
  } catch (const CLI::OptionNotFound&) {
    return checked;  // that was the last
  }
}

/// The flag of this name that takes a word of `words` of the command or what it belongs to; null without.
CLI::Option* flag_named(CLI::App* command, const std::string& name) {
  for (CLI::App* at = command; at != nullptr; at = at->get_parent()) {
    CLI::Option* const option = at->get_option_no_throw(name);
    if (option != nullptr) return option->get_items_expected_max() == 0 ? option : nullptr;
  }
  return nullptr;
}

}  // namespace

std::string word_apart(CLI::App& app, const std::vector<char*>& words) {
  CLI::App* command = &app;
  for (std::size_t n = 1; n < words.size(); ++n) {
    const std::string word = words[n];
    if (word == "--") break;
    if (!word.starts_with("--")) {
      const auto called = [&](CLI::App* below) { return below->get_name() == word; };
      const std::vector<CLI::App*> below = command->get_subcommands(called);
      if (!below.empty()) command = below.front();
      continue;
    }
    if (n + 1 == words.size() || word.find('=') != std::string::npos) continue;
    const std::string next = words[n + 1];
    CLI::Option* const flag = flag_named(command, word);
    // What takes anything has no words.
    if (flag == nullptr || !takes(*flag, next) || takes(*flag, next + "?")) continue;
    return fmt::format("{0} {1}: write {0}={1}; a file of that name is ./{1}", word, next);
  }
  return {};
}

std::string with_flag_words(const std::string& help) {
  static const std::regex words(R"((--[a-z-]+)(\{[a-z]+\})? :\{([a-z0-9,-]+)\})");
  return std::regex_replace(help, words, "$1[=$3]");
}

}  // namespace slicecorr::cli
