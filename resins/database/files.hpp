// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Files that appear whole or not at all, and the lock of a folder.
#pragma once

#include <string>

namespace slicecorr::resins {

/// Holds a lock on the folder, alone among all threads and processes; waits for it. The folder is
/// made when it is missing. Throws `DeviceError`, or `Cancelled` when a signal arrives while
/// waiting.
class FolderLock {
 public:
  explicit FolderLock(const std::string& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int fd_ = -1;
};

/// Writes beside `path`, flushes, renames, flushes the folder: after a kill or a power cut there is
/// the old file or the new one. Hold the folder's lock. Throws `DeviceError`.
void write_durably(const std::string& path, const std::string& bytes);
/// Appends a line and flushes it; a line that a kill cut short stays alone on its line.
void append_line_durably(const std::string& path, const std::string& line);
/// Makes a folder, and its entry in its parent, last.
void make_folder(const std::string& path);

}  // namespace slicecorr::resins
