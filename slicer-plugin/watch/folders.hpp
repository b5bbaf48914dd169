// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What happens in folders, as the kernel tells it.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace slicecorr::post {

/// Folders followed through inotify, each claimed against other watchers on this machine. For one
/// thread.
class Folders {
 public:
  struct FileEvent {
    enum class Kind {
      written,     ///< a file was closed after writing, or moved here
      gone,        ///< a file was removed or moved away
      new_folder,  ///< to be added when folders in folders count
      lost,        ///< events were dropped: all must be looked at again
      unwatched,   ///< a watched folder is gone
    } kind;
    std::string path;
  };

  /// Throws `DeviceError` when the kernel can't.
  Folders();
  ~Folders();
  Folders(const Folders&) = delete;
  Folders& operator=(const Folders&) = delete;

  /// False when another watcher has the folder, or it is gone. Throws `DeviceError`.
  bool add(const std::string& folder);
  std::size_t count() const { return watched_.size(); }
  /// The folders watched.
  std::vector<std::string> paths() const;
  /// Readable when there are events.
  int descriptor() const { return inotify_; }
  /// All that there are now, without waiting.
  std::vector<FileEvent> take();

 private:
  /// Goes with the process, however it ends. Not a lock on the folder: as long as it is open, the
  /// kernel does not tell that it is gone.
  class FolderLock {
   public:
    explicit FolderLock(const std::string& folder);
    ~FolderLock();
    FolderLock(FolderLock&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
    FolderLock& operator=(FolderLock&& other) noexcept {
      std::swap(socket_, other.socket_);
      return *this;
    }
    bool held() const { return socket_ >= 0; }

   private:
    int socket_ = -1;
  };
  struct Watched {
    std::string path;
    FolderLock lock;
  };
  void remove_below(const std::string& folder);
  int inotify_;
  std::map<int, Watched> watched_;
};

}  // namespace slicecorr::post
