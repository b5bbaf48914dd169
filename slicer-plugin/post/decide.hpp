// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How a file is to be corrected: what options, rules and the archive itself say together.
#pragma once

#include <string>
#include <vector>

#include "post/config.hpp"
#include "post/settings.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr::post {

/// The file shows light already: correcting it once more would correct the correction.
class AlreadyCorrected : public InputError {
 public:
  using InputError::InputError;
};
/// The archive can't be read: damaged, no archive at all, or not whole yet.
class NotReadable : public InputError {
 public:
  using InputError::InputError;
};

/// What a slicer that calls us says in its environment.
struct SlicerCall {
  bool by_slicer = false;    ///< SLIC3R_PP_OUTPUT_NAME or SLIC3R_PP_HOST is set
  std::string output_name;   ///< the path that the file will get; empty when it goes elsewhere
  ArchiveProfiles profiles;  ///< SLIC3R_*_SETTINGS_ID, when called by a slicer
};
SlicerCall slicer_call_from_environment();

/// What holds for all files of a run.
struct PostRequest {
  Config config;
  Values given;  ///< on the command line
  SlicerCall slicer;
  bool again = false;  ///< correct the backup of a corrected file anew
  PartsInside parts;   ///< that the archive holds beside supports
  /// The same as options, for programs that correct files for a watcher.
  std::vector<std::string> part_options;
  /// Of a watcher, whose folder others may write to: a link is refused, so that nobody has a file elsewhere changed.
  bool watched = false;
};

struct Decision {
  StackInfo info;
  PostSettings settings;
  Setup setup;  ///< not when the file is left alone
  MissingFacts missing;
  std::string rule;  ///< "rule 'x' (post.toml, line 5)"; empty without
  std::string printer_from, resin_from, exposure_from;
};

/// `named`: the path that rules look at. Throws `NotReadable`, `AlreadyCorrected`, and `InputError`
/// with what is missing or does not fit.
Decision decide(const std::string& archive, const std::string& named, const PostRequest& request);

/// The decision as lines for people.
std::string describe(const Decision& decision);

/// "printer 'x', resin 'y', layer by layer, 2.5 s each"
std::string in_one_line(const Printer& printer, const Resin& resin, const Process& process);

/// Throws `NotReadable`.
StackInfo read_archive(const std::string& path);

}  // namespace slicecorr::post
