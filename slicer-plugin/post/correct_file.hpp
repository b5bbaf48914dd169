// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One file that a slicer has exported, corrected in place, and put back.
#pragma once

#include <string>
#include <vector>

#include "post/decide.hpp"
#include "post/files.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::post {

/// The file can't be judged now: another run has it, or it was changed meanwhile.
class InUse : public InputError {
 public:
  using InputError::InputError;
};

struct PostOutcome {
  bool left_alone = false;  ///< as a rule says; only `rule` is filled then
  std::string rule;
  Setup setup;
  Correction correction;
  std::string format;                ///< of the file
  std::vector<std::string> written;  ///< backup and reports
  /// What an earlier run wrote beside the file, of what it was then; taken away.
  std::vector<std::string> removed;
  FileIdentity identity;  ///< of the new file
};

/// Corrects `path`: at any moment the file is either the old or the new one, whole. Throws
/// `AlreadyCorrected`, `NotReadable`, `InUse`, `InputError`, `InfeasibleError`, `DeviceError`,
/// `Cancelled`; the file is as it was then.
PostOutcome correct_file(const std::string& path, const PostRequest& request,
                         const ExecutionContext& given);

/// How `correct_file` would go about it. Changes nothing.
Decision preview(const std::string& path, const PostRequest& request);

/// Puts the backup of a corrected file in its place, and takes away what was written beside the
/// corrected one: gives the names of that. Throws `InputError` when there is no backup, or it is not
/// what the file was made from.
std::vector<std::string> undo(const std::string& path, const PostRequest& request,
                              const ExecutionContext& context);

/// The figures of an outcome, as reports have them.
std::string figures_json(const PostOutcome& outcome);

}  // namespace slicecorr::post
