// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "database/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;
using detail::errno_message;

/// A file descriptor that is closed.
class Descriptor {
 public:
  Descriptor(const std::string& path, int flags)
      : fd_(::open(path.c_str(), flags | O_CLOEXEC, 0666)) {
    if (fd_ < 0) throw DeviceError(errno_message(path, "can't be opened"));
  }
  ~Descriptor() { ::close(fd_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

void write_all(int fd, const std::string& bytes, const std::string& path) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw DeviceError(errno_message(path, "can't be written"));
    done += static_cast<std::size_t>(n);
  }
  if (::fsync(fd) != 0) throw DeviceError(errno_message(path, "can't be flushed"));
}

void flush_folder(const std::string& folder) {
  const Descriptor d(folder.empty() ? "." : folder, O_RDONLY | O_DIRECTORY);
  // Some file systems can't flush folders; their renames are durable enough on their own.
  if (::fsync(d.fd()) != 0 && errno != EINVAL) {
    throw DeviceError(errno_message(folder, "can't be flushed"));
  }
}

}  // namespace

FolderLock::FolderLock(const std::string& folder) {
  make_folder(folder);
  // The folder itself: no file is left lying about.
  const std::string& path = folder;
  fd_ = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd_ < 0) throw DeviceError(errno_message(path, "can't be opened"));
  if (::flock(fd_, LOCK_EX) != 0) {
    const int error = errno;
    ::close(fd_);
    if (error == EINTR) throw Cancelled();
    throw DeviceError(errno_message(path, "can't be locked", error));
  }
  detail::remove_left_over(folder);
}

FolderLock::~FolderLock() { ::close(fd_); }

void write_durably(const std::string& path, const std::string& bytes) {
  detail::Temporary part{detail::make_temporary(path)};
  {
    const Descriptor d(part.path, O_WRONLY);
    write_all(d.fd(), bytes, path);
  }
  detail::put_in_place(part, path);
}

void append_line_durably(const std::string& path, const std::string& line) {
  const bool fresh = ::access(path.c_str(), F_OK) != 0;
  const Descriptor d(path, O_RDWR | O_CREAT | O_APPEND);
  std::string bytes = line + "\n";
  const off_t size = ::lseek(d.fd(), 0, SEEK_END);
  char last = '\n';
  if (size > 0 && ::pread(d.fd(), &last, 1, size - 1) == 1 && last != '\n')
    bytes.insert(bytes.begin(), '\n');
  write_all(d.fd(), bytes, path);
  if (fresh) flush_folder(fs::path(path).parent_path().string());
}

void make_folder(const std::string& path) {
  std::error_code ec;
  slicecorr::detail::make_lasting_folder(path, ec);
  if (ec) throw DeviceError(path + ": the folder can't be made: " + ec.message());
}

}  // namespace slicecorr::resins
