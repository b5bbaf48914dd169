// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/temporary.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary_path.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::string_view kEnding = ".part";
/// Of the file's name: the zip library adds to it, and names have at most 255 bytes.
constexpr std::size_t kMostNameBytes = 180;

void sync(const std::string& path, int flags) {
  const int file = ::open(path.c_str(), flags | O_CLOEXEC);
  if (file < 0) throw DeviceError(errno_message(path, "can't be opened"));
  const int result = ::fsync(file);
  const int error = errno;
  ::close(file);
  // EINVAL: the file system can't, as is usual for folders on some.
  if (result != 0 && error != EINVAL)
    throw DeviceError(errno_message(path, "can't be written", error));
}

struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

void copy_file(const std::string& from, const std::string& to) {
  const Descriptor in{::open(from.c_str(), O_RDONLY | O_CLOEXEC)};
  if (in.fd < 0) throw InputError(errno_message(from, "can't be read"));
  const Descriptor out{::open(to.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600)};
  if (out.fd < 0) throw DeviceError(errno_message(to, "can't be written"));
  std::vector<std::uint8_t> buffer(std::size_t{1} << 20);
  for (;;) {
    const ssize_t n = ::read(in.fd, buffer.data(), buffer.size());
    if (n == 0) return;
    if (n < 0) throw InputError(errno_message(from, "can't be read"));
    for (ssize_t done = 0; done < n;) {
      const ssize_t written =
          ::write(out.fd, buffer.data() + done, static_cast<std::size_t>(n - done));
      if (written < 0) throw DeviceError(errno_message(to, "can't be written"));
      done += written;
    }
  }
}

/// Whether a folder has a note of less than a day.
bool tells_of_work(const std::filesystem::path& folder) {
  std::error_code none;
  const auto written = std::filesystem::last_write_time(folder / kInWork, none);
  return !none && std::filesystem::file_time_type::clock::now() - written < std::chrono::hours(24);
}

void remove_all_but_note(const std::filesystem::path& folder) {
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end;
       at.increment(error)) {
    std::error_code ignored;
    if (at->path().filename() != kInWork) std::filesystem::remove_all(at->path(), ignored);
  }
}

}  // namespace

PathParts path_parts(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return {".", path};
  return {slash == 0 ? "/" : path.substr(0, slash), path.substr(slash + 1)};
}

std::string temporary_path(const std::string& path) {
  static std::atomic<unsigned> counter{0};
  const PathParts place = path_parts(path);
  return place.folder + "/." + place.file.substr(0, kMostNameBytes) + "." +
         text_of(this_process()) + "-" + std::to_string(counter++) + std::string(kEnding);
}

std::string make_temporary(const std::string& path, bool make_folder) {
  remove_left_over(path_parts(path).folder);
  for (int attempt = 0; attempt < 1000; ++attempt) {
    std::string name = temporary_path(path);
    if (make_folder) {
      if (::mkdir(name.c_str(), 0777) == 0) return name;
    } else {
      const Descriptor file{::open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666)};
      if (file.fd >= 0) return name;
    }
    if (errno != EEXIST) break;
  }
  throw DeviceError(errno_message(path, "can't be written"));
}

void check_may_replace(const std::string& path) {
  struct stat file, folder;
  if (::stat(path.c_str(), &file) != 0) return;
  if (::access(path.c_str(), W_OK) != 0) throw DeviceError(errno_message(path, "can't be written"));
  if (::stat(path_parts(path).folder.c_str(), &folder) != 0 || (folder.st_mode & S_ISVTX) == 0)
    return;
  const uid_t user = ::geteuid();
  if (user != 0 && user != file.st_uid && user != folder.st_uid) {
    throw DeviceError(errno_message(path, "can't be replaced, it belongs to someone else", EPERM));
  }
}

void check_new_file(const std::string& path) {
  const PathParts place = path_parts(path);
  struct stat status;
  if (::stat(place.folder.c_str(), &status) != 0) {
    throw DeviceError(errno_message(path, "can't be written"));
  }
  const bool taken = ::stat(path.c_str(), &status) == 0;
  if (place.file.empty() || (taken && !S_ISREG(status.st_mode))) {
    throw DeviceError(path + ": can't be written: is no ordinary file");
  }
  check_may_replace(path);
  const Temporary trial{make_temporary(path)};
}

std::optional<TemporaryName> temporary_name(const std::string& file) {
  constexpr std::size_t kAny = 6;
  std::string_view name = file;
  if (name.starts_with(kWorkFolder)) {
    name.remove_prefix(kWorkFolder.size());
    if (name.size() <= kAny + 1 || name[name.size() - kAny - 1] != '-') return std::nullopt;
    const auto maker = maker_of(name.substr(0, name.size() - kAny - 1));
    if (!maker) return std::nullopt;
    return TemporaryName{*maker, ""};
  }
  const std::size_t at = name.rfind(kEnding);
  if (at == std::string_view::npos || name.front() != '.') return std::nullopt;
  // The zip library adds a point and six characters, SQLite what its files beside a database are called.
  const std::string_view rest = name.substr(at + kEnding.size());
  const bool zip = rest.size() == kAny + 1 && rest.front() == '.';
  const bool database = rest == "-wal" || rest == "-shm" || rest == "-journal";
  if (!rest.empty() && !zip && !database) return std::nullopt;
  name = name.substr(0, at);
  const std::size_t point = name.rfind('.'), count = name.rfind('-');
  if (point == 0 || count == std::string_view::npos || count < point || count + 1 == name.size() ||
      name.find_first_not_of("0123456789", count + 1) != std::string_view::npos) {
    return std::nullopt;
  }
  const auto maker = maker_of(name.substr(point + 1, count - point - 1));
  if (!maker) return std::nullopt;
  return TemporaryName{*maker, std::string(name.substr(1, point - 1))};
}

void remove_left_over(const std::string& folder,
                      const std::function<bool(const std::string& path)>& known) {
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end;
       at.increment(error)) {
    const auto name = temporary_name(at->path().filename().string());
    if (!name || !is_gone(name->maker, folder)) continue;
    struct stat status;
    const bool ours = ::lstat(at->path().c_str(), &status) == 0 && !S_ISLNK(status.st_mode) &&
                      status.st_uid == ::geteuid();
    if (!ours) continue;
    std::error_code ignored;
    if (tells_of_work(at->path()) && !(known && known(at->path().string()))) {
      remove_all_but_note(at->path());
    } else {
      std::filesystem::remove_all(at->path(), ignored);
    }
  }
}

void sync_file(const std::string& path) { sync(path, O_WRONLY); }
void sync_folder(const std::string& path) { sync(path, O_RDONLY | O_DIRECTORY); }

Temporary::~Temporary() {
  if (!keep) ::unlink(path.c_str());
}

void put_in_place(Temporary& temporary, const std::string& path) {
  sync_file(temporary.path);
  if (::rename(temporary.path.c_str(), path.c_str()) != 0) {
    throw DeviceError(errno_message(path, "can't be written"));
  }
  temporary.keep = true;
  sync_folder(path_parts(path).folder);
}

void copy_mode(const std::string& from, const std::string& to) {
  struct stat status;
  if (::stat(from.c_str(), &status) != 0) return;
  // Who may change the folder may have put a link in the place of what we made: it is not followed.
  // The owner first: changing it clears some bits of the mode. Not allowed to most; no harm then.
  constexpr int kItself = AT_SYMLINK_NOFOLLOW;
  [[maybe_unused]] const int owner =
      ::fchownat(AT_FDCWD, to.c_str(), status.st_uid, status.st_gid, kItself);
  // Some file systems keep no modes; without a free descriptor none can be given.
  if (::fchmodat(AT_FDCWD, to.c_str(), status.st_mode & 07777, kItself) != 0 &&
      (errno == EMFILE || errno == ENFILE)) {
    throw DeviceError(errno_message(to, "can't be given its mode"));
  }
}

void link_or_copy(const std::string& from, const std::string& to) {
  // Following a link to the file itself.
  if (::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
  if (errno == EEXIST) throw DeviceError(errno_message(to, "can't be made"));
  copy_file(from, to);
  copy_mode(from, to);
}

}  // namespace slicecorr::detail
