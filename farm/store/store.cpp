// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/fs.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <memory>

#include "programs/common/make_part.hpp"
#include "store/title.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/sha256.hpp"
#include "support/files/temporary.hpp"
#include "support/files/temporary_path.hpp"
#include "support/text/escape.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using cli::Sha256;
using slicecorr::detail::errno_message;

namespace {

bool means_full(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG; }

[[noreturn]] void fail(const std::string& path, const std::string& what, int error = errno) {
  const std::string text = errno_message(path, what, error);
  if (means_full(error)) throw DiskFull(text);
  throw DeviceError(text);
}

struct Descriptor {
  int fd = -1;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

/// Calls `sink(data, size)` with all bytes of a file.
template <typename Sink>
std::int64_t read_all(int fd, const std::string& path, Sink sink) {
  std::string buffer(std::size_t{1} << 20, '\0');
  std::int64_t bytes = 0;
  for (;;) {
    const ssize_t n = ::read(fd, buffer.data(), buffer.size());
    if (n == 0) return bytes;
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail(path, "can't be read");
    sink(buffer.data(), static_cast<std::size_t>(n));
    bytes += n;
  }
}

void write_all(int fd, const std::string& path, const char* data, std::size_t size) {
  while (size > 0) {
    const ssize_t n = ::write(fd, data, size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail(path, "can't be written");
    data += n;
    size -= static_cast<std::size_t>(n);
  }
}

int open_new(const std::string& path) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (fd < 0) fail(path, "can't be written");
  return fd;
}

int open_to_read(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) {
    throw InputError(path, "",
                     std::string("can't be read: ") + std::generic_category().message(errno));
  }
  return fd;
}

void make_folders(const std::string& path) {
  std::error_code error;
  slicecorr::detail::make_lasting_folder(path, error);
  if (error) fail(path, "can't be made", error.value());
}

/// Name of a result's file in the cache.
std::string cache_name(const std::string& ending) {
  if (ending == "html") return "report.html";
  if (ending == "json") return "figures.json";
  return result_name("stack", ending);
}

void damaged(const std::string& path) {
  throw InputError(path, "", "is not what was recorded of it, by size or SHA-256");
}

}  // namespace

std::string sha256_of_text(const std::string& text) {
  Sha256 hash;
  hash.add(text.data(), text.size());
  return hash.hex();
}

ResultFile sha256_of_file(const std::string& path) {
  const Descriptor file{open_to_read(path)};
  Sha256 hash;
  ResultFile result;
  result.bytes =
      read_all(file.fd, path, [&](const char* data, std::size_t n) { hash.add(data, n); });
  result.sha256 = hash.hex();
  return result;
}

std::string stored_ending(const std::string& path) {
  const fs::path name = fs::path(path).filename();
  const fs::path last = name.extension(), before = name.stem().extension();
  std::string ending = last.string();
  if (last == ".gz" || last == ".GZ" || before == ".rgb") ending = before.string() + ending;
  const bool plain =
      ending.size() <= 16 &&
      ending.find_first_not_of(".abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789") ==
          ending.npos;
  return plain ? ending : "";
}

namespace {

/// The folder of the record, which is on a local disk: locks need no file there, and none is left.
int lock_folder(const FarmFolder& folder, int kind) {
  const int fd = ::open(folder.root.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) fail(folder.root, "can't be read");
  int done = 0;
  do {
    done = ::flock(fd, kind);
  } while (done != 0 && errno == EINTR);
  if (done == 0) return fd;
  const int why = errno;
  ::close(fd);
  if (why == EWOULDBLOCK) return -1;
  fail(folder.root, "can't be locked", why);
}

}  // namespace

InputLock InputLock::shared(const FarmFolder& folder) {
  return InputLock(lock_folder(folder, LOCK_SH));
}

std::optional<InputLock> InputLock::alone(const FarmFolder& folder) {
  const int fd = lock_folder(folder, LOCK_EX | LOCK_NB);
  if (fd < 0) return std::nullopt;
  return InputLock(fd);
}

void InputLock::release() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

StoredInput store_input(const FarmFolder& folder, const std::string& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    throw InputError(path, "", "is a folder; expected a file (zip the images)");
  }
  const Descriptor in{open_to_read(path)};
  const std::string temporary = slicecorr::detail::make_temporary(
      folder.store + "/inputs/" + fs::path(path).stem().string().substr(0, 40));
  slicecorr::detail::Temporary remover{temporary};
  StoredInput stored;
  {
    const Descriptor out{::open(temporary.c_str(), O_WRONLY | O_CLOEXEC)};
    if (out.fd < 0) fail(temporary, "can't be written");
    Sha256 hash;
    stored.bytes = read_all(in.fd, path, [&](const char* data, std::size_t n) {
      hash.add(data, n);
      write_all(out.fd, temporary, data, n);
    });
    stored.sha256 = hash.hex();
    stored.file = stored.sha256 + stored_ending(path);
    if (check_input(folder, stored.file, stored.sha256, true)) return stored;
  }
  const std::string place = folder.input(stored.file);
  make_folders(fs::path(place).parent_path().string());
  slicecorr::detail::put_in_place(remover, place);
  return stored;
}

bool check_input(const FarmFolder& folder, const std::string& file, const std::string& sha256,
                 bool thorough) {
  const std::string path = folder.input(file);
  if (!thorough) return ::access(path.c_str(), R_OK) == 0;
  try {
    return sha256_of_file(path).sha256 == sha256;
  } catch (const Error&) {
    return false;
  }
}

void put_in_cache(const FarmFolder& folder, const std::string& key, const std::string& out_folder,
                  const std::string& name, const std::vector<ResultFile>& files) {
  const std::string entry = folder.cache_entry(key);
  const std::string fresh = folder.store + "/cache/" + key.substr(0, 2) + "/." + key + "." +
                            fs::path(out_folder).parent_path().filename().string();
  make_folders(fresh);
  for (const ResultFile& f : files) {
    const std::string from = out_folder + "/" + result_name(name, f.ending);
    const std::string to = fresh + "/" + cache_name(f.ending);
    std::error_code error;
    const auto bytes = static_cast<std::int64_t>(fs::file_size(from, error));
    if (error) {
      // Moved already, when the service was killed in the middle of this.
      for (const std::string& place : {to, entry + "/" + cache_name(f.ending)}) {
        error.clear();
        if (static_cast<std::int64_t>(fs::file_size(place, error)) == f.bytes && !error) break;
      }
      if (error) damaged(from);
      continue;
    }
    if (bytes != f.bytes) damaged(from);
    if (::rename(from.c_str(), to.c_str()) != 0) fail(from, "can't be moved");
  }
  std::error_code empty;
  if (fs::is_empty(fresh, empty) && ::rmdir(fresh.c_str()) == 0) {
    if (!check_cached(folder, key, files)) damaged(entry);
    return;
  }
  // What is there already may be damaged, or of this same attempt before the service was killed.
  if (::rename(fresh.c_str(), entry.c_str()) == 0) return;
  if (errno != ENOTEMPTY && errno != EEXIST) fail(entry, "can't be written");
  if (check_cached(folder, key, files)) {
    std::error_code error;
    fs::remove_all(fresh, error);
    return;
  }
  remove_from_cache(folder, key);
  if (::rename(fresh.c_str(), entry.c_str()) != 0) fail(entry, "can't be written");
}

bool check_cached(const FarmFolder& folder, const std::string& key,
                  const std::vector<ResultFile>& files) {
  if (files.empty()) return false;
  try {
    for (const ResultFile& f : files) {
      const ResultFile now = sha256_of_file(folder.cache_entry(key) + "/" + cache_name(f.ending));
      if (now.bytes != f.bytes || now.sha256 != f.sha256) return false;
    }
  } catch (const Error&) {
    return false;
  }
  return true;
}

/// What names of parts of a delivery begin with: of which attempt they are. Who made them follows (maker.hpp), so that any
/// program removes them when that process was killed; the next service knows them by the attempt, also on another computer.
std::string part_of_delivery(const std::string& name, const std::string& ending,
                             const std::string& token) {
  return result_name(name.substr(0, 120), ending) + "." + token;
}

std::vector<ResultFile> deliver(const FarmFolder& folder, const std::string& key,
                                const std::vector<ResultFile>& files,
                                const std::string& output_folder, const std::string& name,
                                const std::string& token) {
  make_folders(output_folder);
  struct Parts {
    std::vector<std::string> paths;
    ~Parts() {
      for (const std::string& p : paths) ::unlink(p.c_str());
    }
  } parts;
  slicecorr::detail::remove_left_over(output_folder);
  std::vector<ResultFile> delivered;
  for (const ResultFile& f : files) {
    const std::string from = folder.cache_entry(key) + "/" + cache_name(f.ending);
    const std::string part = slicecorr::detail::temporary_path(
        output_folder + "/" + part_of_delivery(name, f.ending, token));
    parts.paths.push_back(part);
    const Descriptor in{open_to_read(from)};
    const Descriptor out{open_new(part)};
    ResultFile result = f;
    Sha256 hash;
    if (f.ending == "html") {
      std::string text;
      read_all(in.fd, from, [&](const char* data, std::size_t n) {
        hash.add(data, n);
        text.append(data, n);
      });
      if (hash.hex() != f.sha256) damaged(from);
      const std::string stand_in = detail::title_stand_in(key);
      const std::string title = escape_markup(name);
      for (std::size_t at = 0; (at = text.find(stand_in, at)) != text.npos; at += title.size()) {
        text.replace(at, stand_in.size(), title);
      }
      write_all(out.fd, part, text.data(), text.size());
      result.bytes = static_cast<std::int64_t>(text.size());
      result.sha256 = sha256_of_text(text);
    } else {
      // Shares the blocks where the file system can; the content is hashed all the same.
      const bool cloned = ::ioctl(out.fd, FICLONE, in.fd) == 0;
      const std::int64_t bytes = read_all(in.fd, from, [&](const char* data, std::size_t n) {
        hash.add(data, n);
        if (!cloned) write_all(out.fd, part, data, n);
      });
      if (bytes != f.bytes || hash.hex() != f.sha256) damaged(from);
    }
    if (::fsync(out.fd) != 0) fail(part, "can't be written");
    delivered.push_back(result);
  }
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::string place = output_folder + "/" + result_name(name, files[i].ending);
    if (::rename(parts.paths[i].c_str(), place.c_str()) != 0) fail(place, "can't be written");
  }
  // Else those who measure the new stack would count what an older one of this name left alone.
  const auto has = [&](const char* ending) {
    return std::any_of(files.begin(), files.end(),
                       [&](const ResultFile& f) { return f.ending == ending; });
  };
  if (has(cli::kTargetEnding) && !has(cli::kLeftAloneEnding)) {
    ::unlink((output_folder + "/" + result_name(name, cli::kLeftAloneEnding)).c_str());
  }
  slicecorr::detail::sync_folder(output_folder);
  return delivered;
}

void remove_delivery_parts(const std::string& output_folder, const std::string& name,
                           const std::string& format, const std::string& token) {
  std::vector<std::string> begins;
  for (const std::string& ending :
       {format, std::string("html"), std::string("json"), std::string(cli::kTargetEnding),
        std::string(cli::kLeftAloneEnding), format + ".slicecorr"}) {
    begins.push_back("." + part_of_delivery(name, ending, token) + ".");
  }
  std::error_code error;
  for (fs::directory_iterator at(output_folder, error), end; !error && at != end;
       at.increment(error)) {
    const std::string file = at->path().filename().string();
    const bool of_it = std::any_of(begins.begin(), begins.end(),
                                   [&](const std::string& b) { return file.starts_with(b); });
    if (of_it) ::unlink(at->path().c_str());
  }
}

void remove_from_cache(const FarmFolder& folder, const std::string& key) {
  std::error_code error;
  fs::remove_all(folder.cache_entry(key), error);
}

void remove_attempt(const FarmFolder& folder, const std::string& token) {
  if (token.size() != 32) return;  // never the folder of all attempts
  std::error_code error;
  fs::remove_all(folder.attempt(token), error);
}

std::int64_t free_bytes(const std::string& path) {
  for (fs::path at = fs::absolute(path);; at = at.parent_path()) {
    struct statvfs s {};
    if (::statvfs(at.c_str(), &s) == 0) {
      return static_cast<std::int64_t>(s.f_bavail) * static_cast<std::int64_t>(s.f_frsize);
    }
    if (at == at.parent_path()) return 0;
  }
}

}  // namespace slicecorr::farm
