// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What became of a file: said by the program that corrects it to the one that watches.
#pragma once

#include <string>

#include "post/correct_file.hpp"
#include "support/process/command.hpp"

namespace slicecorr::post {

struct Done {
  std::string path;
  enum class Kind {
    corrected,
    already,
    left_alone,
    not_readable,
    in_use,
    failed,
    cancelled,
    killed  ///< a signal ended the program that read it
  } kind;
  int code = 0;  ///< exit code that the program would have had
  /// What went wrong, or of a correction, each on a line: the verdict, figures, remarks.
  std::string message;
  double seconds = 0;
  FileIdentity made;    ///< of the corrected file
  std::string verdict;  ///< `name_of` the outcome of a correction; empty else
};

/// The option with which `slicecorr-post` says `done_json` in place of words. Not for people.
inline constexpr const char* kDoneFlag = "--tell-watcher";

/// Corrects one file; throws nothing.
Done correct_and_tell(const std::string& path, const PostRequest& request,
                      const ExecutionContext& given);
/// A line of JSON, all but `path` and `seconds`.
std::string done_json(const Done& done);
/// What a program that was to print such a line has said, however it ended.
Done done_in(const CommandResult& result, const std::string& path);

}  // namespace slicecorr::post
