// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Files that are changed while other programs, and other runs of this one, use their folder.
///
/// All throw `DeviceError` when the file system fails.
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace slicecorr::post {

/// What tells whether a file is still the one that was looked at.
struct FileIdentity {
  dev_t device = 0;
  ino_t inode = 0;
  off_t bytes = 0;
  std::int64_t modified_ns = 0;
  bool operator==(const FileIdentity&) const = default;
};
/// Nothing when there is no ordinary file.
std::optional<FileIdentity> identity_of(const std::string& path);

/// An open file or folder, locked against other runs of this program as long as this lives. The
/// system drops the lock when the process ends, however it ends.
class Lock {
 public:
  /// Nothing when another has it, or there is nothing at `path` any more.
  static std::optional<Lock> try_take(const std::string& path);
  ~Lock();
  Lock(Lock&& other) noexcept : file_(other.file_) { other.file_ = -1; }
  Lock& operator=(Lock&& other) noexcept {
    std::swap(file_, other.file_);
    return *this;
  }

 private:
  explicit Lock(int file) : file_(file) {}
  int file_;
};

/// A hidden folder beside a file for what is made on the way; gone with all that is in it when this
/// ends. Its name says whose it is, so that the next run of any program removes what a killed one left.
class WorkFolder {
 public:
  explicit WorkFolder(const std::string& folder);
  ~WorkFolder();
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const std::string& path() const { return path_; }

  static bool is_one(const std::string& name);
  /// Whether a message, "PATH: WHAT", is about a path in such a folder.
  static bool is_named_in(const std::string& message);
  /// The text with files in such folders named as if they lay beside them.
  static std::string without(std::string text);
  /// Removes those of killed runs in `folder`; gives the names of the files that were in work. With `only` those that
  /// had that file; of the others it stays who had which.
  static std::vector<std::string> remove_stale(const std::string& folder,
                                               const std::string& only = "");

 private:
  std::string path_;
};

/// A copy of `from` under the name `to`, whole from the moment that it is there: a hard link where
/// the file system has them. `scratch`: a folder beside `to`. Throws `InputError` when `to` is
/// there and not to be replaced.
void keep_copy(const std::string& from, const std::string& to, bool replace,
               const std::string& scratch);
bool same_contents(const std::string& a, const std::string& b);
void rename_file(const std::string& from, const std::string& to);

}  // namespace slicecorr::post
