// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Options whose word may be left out (--backup, --backup=replace): what stands behind them is no word of
/// theirs, so that a file may. People who write it so all the same are told.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace slicecorr::cli {

/// What to say of `--backup replace` among `words`, of which the first names the program; empty where nothing
/// of the kind is there.
std::string word_apart(CLI::App& app, const std::vector<char*>& words);

/// A help text with "--backup[=keep,replace,no]" in place of CLI11's own way to say it.
std::string with_flag_words(const std::string& help);

}  // namespace slicecorr::cli
