// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;
using detail::errno_message;

namespace {

using detail::kWorkFolder;

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw DeviceError(errno_message(path, what));
}

}  // namespace

std::optional<FileIdentity> identity_of(const std::string& path) {
  struct stat status;
  if (::stat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return std::nullopt;
  return FileIdentity{status.st_dev, status.st_ino, status.st_size,
                      std::int64_t{status.st_mtim.tv_sec} * 1000000000 + status.st_mtim.tv_nsec};
}

std::optional<Lock> Lock::try_take(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) {
    if (errno == ENOENT) return std::nullopt;
    throw InputError(errno_message(path, "can't be read"));
  }
  Lock lock(file);
  if (::flock(file, LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) return std::nullopt;
    // Some network file systems have no locks; then there is nothing to be had.
    if (errno != ENOLCK && errno != EOPNOTSUPP && errno != EINVAL) fail(path, "can't be locked");
  }
  // What was locked may have been put aside meanwhile.
  struct stat opened, named;
  if (::fstat(file, &opened) != 0 || ::stat(path.c_str(), &named) != 0 ||
      opened.st_ino != named.st_ino || opened.st_dev != named.st_dev) {
    return std::nullopt;
  }
  return lock;
}

Lock::~Lock() {
  if (file_ >= 0) ::close(file_);
}

WorkFolder::WorkFolder(const std::string& folder) {
  std::string name =
      fmt::format("{}/{}{}-XXXXXX", folder, kWorkFolder, detail::text_of(detail::this_process()));
  if (::mkdtemp(name.data()) == nullptr) fail(folder, "nothing can be written in this folder");
  path_ = name;
}

WorkFolder::~WorkFolder() {
  std::error_code ec;
  fs::remove_all(path_, ec);
}

bool WorkFolder::is_one(const std::string& name) {
  const auto known = detail::temporary_name(name);
  return known && known->file.empty();
}

bool WorkFolder::is_named_in(const std::string& message) {
  const std::string path = message.substr(0, message.find(": "));
  return path.find(fmt::format("/{}", kWorkFolder)) != std::string::npos;
}

std::string WorkFolder::without(std::string text) {
  for (std::size_t at = 0; (at = text.find(kWorkFolder, at)) != std::string::npos;) {
    const std::size_t end = text.find('/', at);
    const bool whole = (at == 0 || text[at - 1] == '/') && end != std::string::npos &&
                       is_one(text.substr(at, end - at));
    if (whole) {
      text.erase(at, end + 1 - at);
    } else {
      at += kWorkFolder.size();
    }
  }
  return text;
}

std::vector<std::string> WorkFolder::remove_stale(const std::string& folder,
                                                  const std::string& only) {
  std::vector<std::string> in_work;
  detail::remove_left_over(folder, [&](const std::string& path) {
    std::ifstream note(fs::path(path) / detail::kInWork);
    if (!note && errno != ENOENT) return false;  // what it says is not known
    std::string name;
    if (!std::getline(note, name, '\0')) return true;
    if (!only.empty() && name != only) return false;
    in_work.push_back(name);
    return true;
  });
  return in_work;
}

void keep_copy(const std::string& from, const std::string& to, bool replace,
               const std::string& scratch) {
  const std::string made = scratch + "/copy";
  detail::link_or_copy(from, made);
  detail::sync_file(made);
  const unsigned flags = replace ? 0 : RENAME_NOREPLACE;
  if (::renameat2(AT_FDCWD, made.c_str(), AT_FDCWD, to.c_str(), flags) != 0) {
    std::error_code ec;
    const bool there = errno == EEXIST || (!replace && fs::exists(to, ec));
    if (there) throw InputError(to, "", "is there already");
    // Not all file systems can refuse by themselves.
    if (errno != EINVAL && errno != ENOSYS) fail(to, "can't be made");
    rename_file(made, to);
  }
  detail::sync_folder(detail::path_parts(to).folder);
}

bool same_contents(const std::string& a, const std::string& b) {
  std::error_code ec;
  if (fs::equivalent(a, b, ec)) return true;
  const auto size_a = fs::file_size(a, ec);
  if (ec) return false;
  const auto size_b = fs::file_size(b, ec);
  if (ec || size_a != size_b) return false;
  std::ifstream left(a, std::ios::binary), right(b, std::ios::binary);
  std::array<char, 65536> x, y;
  do {
    left.read(x.data(), x.size());
    right.read(y.data(), y.size());
    if (left.gcount() != right.gcount() ||
        !std::equal(x.begin(), x.begin() + left.gcount(), y.begin())) {
      return false;
    }
  } while (left && right);
  return left.eof() && right.eof();
}

void rename_file(const std::string& from, const std::string& to) {
  if (::rename(from.c_str(), to.c_str()) != 0) fail(to, "can't be put in place");
}

}  // namespace slicecorr::post
