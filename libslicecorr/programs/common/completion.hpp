// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Completion of commands in bash, zsh and fish: scripts made from a program's own options, so that
/// they can't fall behind them.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace slicecorr::cli {

/// What a value is. Options say it by `value_is` only where this rule would be wrong: words of
/// CLI::IsMember are offered; numbers have nothing to offer; --printer, --resin and positionals of
/// these names are definitions; type DIR and names that end in dir or folder are folders; else it is
/// a file.
enum class ValueKind {
  text,  ///< nothing can be offered
  file,
  folder,
  printer,        ///< a name, or a .toml file
  resin,          ///< the same
  definition,     ///< a printer or a resin
  format,         ///< of an archive
  resin_or_file,  ///< a resin's name, or a file of any kind
};
/// Takes every value; tells completion what it is.
CLI::Validator value_is(ValueKind kind);
/// Takes every value; completion offers these words. For options that check their words later.
CLI::Validator value_such_as(const std::vector<std::string>& words);

/// The shells of `completion_script`.
const std::vector<std::string>& completion_shells();
/// The script of a program for a shell: what it offers are the commands and options of `app`, but
/// those without a group, which are not for people.
std::string completion_script(CLI::App& app, const std::string& shell);

/// Names that the scripts ask their program for when a user presses Tab: of the kind "printer",
/// "resin", or "definition" for both, one a line, whatever is wrong with their files.
std::string completion_names(const std::string& kind);

}  // namespace slicecorr::cli
