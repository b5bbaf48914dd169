// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Folders that slicers export into, watched: every archive that appears is corrected.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "post/correct_file.hpp"
#include "watch/log.hpp"

namespace slicecorr::post {

struct WatchOptions {
  std::vector<std::string> folders;
  bool recursive = false;
  bool new_only = false;  ///< not what is there at the start, but for work that a kill cut short
  bool once = false;      ///< stop when nothing is left to do
  int jobs = 1;           ///< files at once
  /// A file counts as written when size and time stayed the same for so long and no one writes it.
  double settle_s = 1;
  /// An archive that does not open is given up when nothing was added to it for so long.
  double patience_s = 10;
  bool notify = false;           ///< through notify-send
  bool text_beside = false;      ///< what became of a file as FILE.txt beside it
  std::string on_done, on_fail;  ///< programs, called with the file
};

struct WatchResult {
  int corrected = 0, failed = 0;
  int code = 0;  ///< exit code of all that failed, where they have one; else 2; 0: none failed
};

/// Watches until `context.cancel` is set and a signal comes, then throws `Cancelled`; with `once`
/// until nothing is left. Failures of files go to the log. Throws `InputError` when a folder is not
/// there or another watcher has it, `DeviceError` when watching is not possible.
WatchResult watch(const WatchOptions& options, const PostRequest& request, Log& log,
                  const ExecutionContext& context);

}  // namespace slicecorr::post
