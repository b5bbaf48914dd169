// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Commands and words of completion scripts, whatever the shell.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "programs/common/completion_scripts.hpp"

namespace slicecorr::cli::completion {

/// All commands of a tree, the program first.
std::vector<const Command*> all_of(const Command& program);
std::string replaced(std::string text, std::string_view what, std::string_view with);
/// With a backslash before each of these characters.
std::string escaped(std::string_view text, std::string_view characters);
/// No shell sees more than a word in it.
bool is_plain(std::string_view text);
/// For bash and zsh: nothing within single quotes is read.
std::string in_quotes(std::string_view text);
/// Words with blanks between, those in quotes that need them.
std::string words_quoted(const std::vector<std::string>& words,
                         std::string (*quoted)(std::string_view));
/// The part of a script that is the same for all programs, with the program's name, and a word of it
/// that names of functions and variables begin with.
std::string frame_of(std::string_view frame, const std::string& program);

}  // namespace slicecorr::cli::completion
