// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The config file of slicecorr-post: defaults, and rules that say by folder, file name and the
/// slicer's profiles how a file is corrected.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "post/settings.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::post {

/// What rules look at.
struct Subject {
  std::string path;  ///< absolute
  ArchiveProfiles profiles;
};

struct Rule {
  std::string name;   ///< given, or "rule N"
  unsigned line = 0;  ///< in the config file
  // Patterns as a shell has them, *, ? and []; a rule matches when all that are given do. Profiles
  // are compared whatever the case. A folder stands for itself and all below it; a pattern without
  // a slash is the name of one of them.
  std::optional<std::string> folder, file, printer_profile, material_profile;
  Values values;
};

struct Config {
  std::string path;  ///< empty: there is none
  Values defaults;
  std::vector<Rule> rules;
  /// The first rule that matches; null when none does.
  const Rule* match(const Subject& subject) const;
};

bool matches(const Rule& rule, const Subject& subject);

/// Checks everything before use: keys, values, printers and resins that are named, and that the
/// settings of each rule over the defaults go together. Throws `InputError` with the line.
Config parse_config(std::string_view text, const std::string& path);

/// Of `path`; of `$XDG_CONFIG_HOME/slicecorr/post.toml` when empty, which need not be there.
Config load_config(const std::string& path);

}  // namespace slicecorr::post
