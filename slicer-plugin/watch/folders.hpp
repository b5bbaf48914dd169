/// What happens in folders, as the kernel tells it.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "post/files.hpp"

namespace slicecorr::post {

/// Folders followed through inotify, each locked against other watchers. For one thread.
class Folders {
 public:
  struct Event {
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
  std::vector<Event> take();

 private:
  struct Watched {
    std::string path;
    Lock lock;
  };
  void remove_below(const std::string& folder);
  int inotify_;
  std::map<int, Watched> watched_;
};

}  // namespace slicecorr::post
