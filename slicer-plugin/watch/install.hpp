// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A folder that systemd's manager of a user has watched, whenever the user is signed in: a unit that runs
/// `slicecorr-post --watch`, and a rule in the config file that says how to correct what comes there.
#pragma once

#include <string>
#include <vector>

#include "post/settings.hpp"

namespace slicecorr::post {

struct WatchInstall {
  std::string folder;                  ///< as it was given
  std::string config;                  ///< config file; empty: the usual one
  Values values;                       ///< of the rule
  std::vector<std::string> options{};  ///< of the program, beside those that every unit has
};

/// What was done, a sentence in each line; what `slicecorr-post` is to say.
struct WatchInstalled {
  std::string text;
  /// Why the manager could not be told; empty: it was. All files are written.
  std::string problem{};
};

/// Sets unit and rule up, in the place of those that were there for the folder, and starts the watch.
/// Throws `InputError` where the folder or the settings are wrong, before anything is written, `DeviceError`
/// where something can't be.
WatchInstalled install_watch(const WatchInstall& install);
/// Stops the watch and takes both away again. Throws `InputError` where there is neither.
WatchInstalled uninstall_watch(const WatchInstall& install);

/// Name of the unit that watches a folder: "slicecorr-watch-home-me-slices.service", the folder as
/// systemd-escape --path names it. `folder`: absolute.
std::string watch_unit_name(const std::string& folder);
/// The unit's text. `program`: path of slicecorr-post.
std::string watch_unit_text(const std::string& folder, const std::string& program,
                            const std::vector<std::string>& options);
/// `text` of a config file with the rule of a folder in the place of the one that `install_watch` put
/// there, or without one where `rule` is empty. All else stays byte for byte.
std::string with_watch_rule(const std::string& text, const std::string& folder,
                            const std::string& rule);

}  // namespace slicecorr::post
