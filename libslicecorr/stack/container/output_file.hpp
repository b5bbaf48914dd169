// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {

/// A file that is there and is written to, by all threads, each at its own place. Throws `DeviceError` that names
/// the file as people know it.
class OutputFile {
 public:
  OutputFile(const std::string& file, std::string shown_path)
      : path_(std::move(shown_path)), fd_(::open(file.c_str(), O_WRONLY | O_CLOEXEC)) {
    if (fd_ < 0) fail();
  }
  ~OutputFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void write(std::span<const std::uint8_t> data, std::uint64_t offset) const {
    for (std::size_t done = 0; done < data.size();) {
      const ssize_t n =
          ::pwrite(fd_, data.data() + done, data.size() - done, static_cast<off_t>(offset + done));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) fail();
      done += static_cast<std::size_t>(n);
    }
  }
  /// Begins to move what was written there to the disk: less to wait for at the end.
  void begin_sync(std::uint64_t from, std::uint64_t to) const {
    if (from == to) return;  // a length of 0 would mean all of the file
    // If this fails, syncing at the end just takes longer.
    [[maybe_unused]] const int result = ::sync_file_range(
        fd_, static_cast<off_t>(from), static_cast<off_t>(to - from), SYNC_FILE_RANGE_WRITE);
  }
  /// Closes the file; some file systems tell only then that there is no room.
  void close() {
    const int fd = std::exchange(fd_, -1);
    if (::close(fd) != 0) fail();
  }

 private:
  [[noreturn]] void fail() const { throw DeviceError(errno_message(path_, "can't be written")); }

  std::string path_;
  int fd_;
};

}  // namespace slicecorr::detail
