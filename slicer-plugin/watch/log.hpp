// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One line per event, to a file or to stderr.
#pragma once

#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::post {

struct LogLine {
  std::string event;    ///< "corrected", "failed", "watching", ...
  std::string file;     ///< may be empty
  std::string message;  ///< sentences, each on a line; the log puts them on one
  double seconds = -1;  ///< the work took; below 0: not said
  int code = -1;        ///< exit code that the program would have had; below 0: not said
  bool trouble = false;
  std::string verdict = {};  ///< `Done::verdict`
};

/// Lines are only added, each with one write. A file that was renamed or removed, as log rotation
/// does, is opened anew. Thread-safe as far as one write is.
class Log {
 public:
  /// `path` empty: stderr; then `quiet` leaves what goes well out. Throws `DeviceError` when the
  /// file can't be written.
  Log(std::string path, bool json, bool quiet = false);
  ~Log();
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;
  void add(const LogLine& line);

 private:
  void open();
  std::string path_;
  bool json_, quiet_;
  int file_ = -1;
};

}  // namespace slicecorr::post
