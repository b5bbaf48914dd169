// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a program takes, as the scripts of completion need it; private to `completion`.
#pragma once

#include <string>
#include <vector>

namespace slicecorr::cli::completion {

/// More values than anybody types.
inline constexpr int kMany = 999999;

enum class Files { none, any, toml, folders };

struct Value {
  std::vector<std::string> words;
  std::string names;  ///< a kind of `completion_names`; empty: none
  Files files = Files::none;
  int least = 0;             ///< values that follow the option, at least
  int most = 0;              ///< at most; 0: a flag
  bool attached = false;     ///< a flag that may have a value after "="
  bool with_commas = false;  ///< several in one word
  std::string title;         ///< a word for it
};

struct Option {
  std::vector<std::string> names;  ///< with their dashes
  std::string text;
  Value value;
  bool again = false;  ///< may be given several times
};

struct Command {
  std::string path;  ///< "tomo solve"; empty: the program
  std::string name, text;
  std::vector<Option> options;
  std::vector<Value> positionals;
  std::vector<Command> commands;
};

std::string bash_script(const Command& program);
std::string zsh_script(const Command& program);
std::string fish_script(const Command& program);

}  // namespace slicecorr::cli::completion
