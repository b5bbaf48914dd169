// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/folders.hpp"

#include <fmt/format.h>
#include <sys/inotify.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::post {

namespace {

constexpr std::uint32_t kMask = IN_CLOSE_WRITE | IN_MOVED_TO | IN_MOVED_FROM | IN_DELETE |
                                IN_CREATE | IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR;

bool is_below(const std::string& path, const std::string& folder) {
  return path == folder || path.rfind(folder + "/", 0) == 0;
}

}  // namespace

Folders::FolderLock::FolderLock(const std::string& folder) {
  struct stat status;
  if (::stat(folder.c_str(), &status) != 0) return;
  // A name that is no file; only one socket can have it.
  const std::string name =
      fmt::format("slicecorr-post watches {:x}:{:x}", status.st_dev, status.st_ino);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::copy(name.begin(), name.end(), address.sun_path + 1);
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket_ < 0) throw DeviceError(detail::errno_message("watching folders", "not possible"));
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size) == 0) return;
  const int error = errno;
  ::close(socket_);
  socket_ = -1;
  if (error != EADDRINUSE) {
    throw DeviceError(detail::errno_message("watching folders", "not possible", error));
  }
}

Folders::FolderLock::~FolderLock() {
  if (socket_ >= 0) ::close(socket_);
}

Folders::Folders() : inotify_(::inotify_init1(IN_CLOEXEC | IN_NONBLOCK)) {
  if (inotify_ < 0) throw DeviceError(detail::errno_message("watching folders", "not possible"));
}

Folders::~Folders() { ::close(inotify_); }

bool Folders::add(const std::string& folder) {
  const bool known = std::any_of(watched_.begin(), watched_.end(),
                                 [&](const auto& w) { return w.second.path == folder; });
  if (known) return true;
  FolderLock lock(folder);
  if (!lock.held()) return false;
  const int number = ::inotify_add_watch(inotify_, folder.c_str(), kMask);
  if (number < 0) {
    if (errno == ENOENT || errno == ENOTDIR) return false;
    throw DeviceError(detail::errno_message(
        folder, errno == ENOSPC ? "can't be watched: the system's limit of watches "
                                  "(fs.inotify.max_user_watches) is reached"
                                : "can't be watched"));
  }
  watched_.insert_or_assign(number, Watched{folder, std::move(lock)});
  return true;
}

std::vector<std::string> Folders::paths() const {
  std::vector<std::string> paths;
  for (const auto& [number, watched] : watched_) paths.push_back(watched.path);
  return paths;
}

void Folders::remove_below(const std::string& folder) {
  for (auto it = watched_.begin(); it != watched_.end();) {
    if (is_below(it->second.path, folder)) {
      ::inotify_rm_watch(inotify_, it->first);
      it = watched_.erase(it);
    } else {
      ++it;
    }
  }
}

std::vector<Folders::FileEvent> Folders::take() {
  std::vector<FileEvent> events;
  alignas(inotify_event) std::array<char, 65536> buffer;
  for (;;) {
    const ssize_t bytes = ::read(inotify_, buffer.data(), buffer.size());
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) {
      if (bytes < 0 && errno != EAGAIN) {
        throw DeviceError(detail::errno_message("watching folders", "failed"));
      }
      return events;
    }
    for (ssize_t at = 0; at < bytes;) {
      inotify_event event;
      std::memcpy(&event, buffer.data() + at, sizeof event);
      const char* const name = buffer.data() + at + sizeof event;
      at += static_cast<ssize_t>(sizeof event + event.len);
      if ((event.mask & IN_Q_OVERFLOW) != 0) {
        events.push_back({FileEvent::Kind::lost, {}});
        continue;
      }
      const auto found = watched_.find(event.wd);
      if (found == watched_.end()) continue;  // of a folder that was left meanwhile
      const std::string folder = found->second.path;
      if ((event.mask & (IN_DELETE_SELF | IN_MOVE_SELF | IN_IGNORED | IN_UNMOUNT)) != 0) {
        remove_below(folder);
        events.push_back({FileEvent::Kind::unwatched, folder});
        continue;
      }
      if (event.len == 0) continue;
      const std::string path = (folder == "/" ? "" : folder) + "/" + name;
      if ((event.mask & IN_ISDIR) != 0) {
        if ((event.mask & (IN_CREATE | IN_MOVED_TO)) != 0) {
          events.push_back({FileEvent::Kind::new_folder, path});
        } else if ((event.mask & IN_MOVED_FROM) != 0) {
          remove_below(path);
        }
      } else if ((event.mask & (IN_CLOSE_WRITE | IN_MOVED_TO)) != 0) {
        events.push_back({FileEvent::Kind::written, path});
      } else if ((event.mask & (IN_DELETE | IN_MOVED_FROM)) != 0) {
        events.push_back({FileEvent::Kind::gone, path});
      }
    }
  }
}

}  // namespace slicecorr::post
