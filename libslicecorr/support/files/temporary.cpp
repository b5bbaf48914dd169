// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/temporary.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {
namespace {

constexpr const char* kEnding = ".part";
/// Of the file's name: the zip library adds to it, and names have at most 255 bytes.
constexpr std::size_t kMostNameBytes = 200;

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

void remove_left_over(const PathParts& place) {
  const std::string file = place.file.substr(0, kMostNameBytes);
  std::error_code error;
  for (std::filesystem::directory_iterator at(place.folder, error), end; !error && at != end;
       at.increment(error)) {
    const TemporaryName name = temporary_name(at->path().filename().string());
    if (!name.is_one || name.file != file) continue;
    if (::kill(static_cast<pid_t>(name.pid), 0) == 0 || errno != ESRCH) continue;
    std::error_code ignored;
    std::filesystem::remove_all(at->path(), ignored);
  }
}

}  // namespace

PathParts path_parts(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return {".", path};
  return {slash == 0 ? "/" : path.substr(0, slash), path.substr(slash + 1)};
}

std::string make_temporary(const std::string& path, bool make_folder) {
  static std::atomic<unsigned> counter{0};
  const PathParts place = path_parts(path);
  remove_left_over(place);
  for (int attempt = 0; attempt < 1000; ++attempt) {
    std::string name = place.folder + "/." + place.file.substr(0, kMostNameBytes) + "." +
                       std::to_string(::getpid()) + "-" + std::to_string(counter++) + kEnding;
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

TemporaryName temporary_name(const std::string& file) {
  std::string name = file;
  // The zip library adds a point and six characters.
  const std::size_t at = name.rfind(kEnding);
  if (at == std::string::npos || name.empty() || name.front() != '.') return {};
  const std::size_t rest = name.size() - at - std::string(kEnding).size();
  if (rest != 0 && !(rest == 7 && name[name.size() - 7] == '.')) return {};
  name.resize(at);
  const std::size_t point = name.rfind('.');
  if (point == std::string::npos || point == 0) return {};
  const std::string numbers = name.substr(point + 1);
  char* end = nullptr;
  const long pid = std::strtol(numbers.c_str(), &end, 10);
  if (end == numbers.c_str() || *end != '-' || pid <= 0) return {};
  const std::string count = end + 1;
  if (count.empty() || count.find_first_not_of("0123456789") != std::string::npos) return {};
  return {true, pid, name.substr(1, point - 1)};
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
  // The owner first: changing it clears some bits of the mode. Not allowed to most; no harm then.
  [[maybe_unused]] const int owner = ::chown(to.c_str(), status.st_uid, status.st_gid);
  ::chmod(to.c_str(), status.st_mode & 07777);
}

void link_or_copy(const std::string& from, const std::string& to) {
  // Following a link to the file itself.
  if (::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
  if (errno == EEXIST) throw DeviceError(errno_message(to, "can't be made"));
  copy_file(from, to);
  copy_mode(from, to);
}

}  // namespace slicecorr::detail
