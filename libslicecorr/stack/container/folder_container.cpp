// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/folder_container.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <set>
#include <system_error>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::detail {
namespace {

struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

std::string without_slashes(std::string path) {
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  return path;
}

/// What is in a folder, and in the folders in it.
struct Listing {
  struct File {
    std::string name;
    std::uint64_t bytes = 0;
  };
  std::vector<File> files;
  std::vector<std::string> folders;
  std::vector<std::string> others;  ///< links, devices, folders in folders
};

void list_folder(const std::string& path, const std::string& prefix, Listing& list) {
  const std::string folder = prefix.empty() ? path : path + "/" + prefix;
  const int follow = prefix.empty() ? 0 : O_NOFOLLOW;
  const int file =
      ::open(without_slashes(folder).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | follow);
  DIR* const opened = file < 0 ? nullptr : ::fdopendir(file);
  if (opened == nullptr) {
    const std::string message = errno_message(folder, "can't be read");
    if (file >= 0) ::close(file);
    throw InputError(message);
  }
  const std::unique_ptr<DIR, int (*)(DIR*)> guard(opened, &::closedir);
  for (;;) {
    errno = 0;
    const dirent* const entry = ::readdir(opened);
    if (entry == nullptr) {
      if (errno != 0) throw InputError(errno_message(folder, "can't be read"));
      return;
    }
    const std::string_view entry_name = entry->d_name;
    if (entry_name == "." || entry_name == "..") continue;
    const std::string name = prefix + std::string(entry_name);
    struct stat status;
    if (::fstatat(::dirfd(opened), entry->d_name, &status, AT_SYMLINK_NOFOLLOW) != 0) {
      if (errno == ENOENT) continue;  // removed just now
      throw InputError(errno_message(path + "/" + name, "can't be read"));
    }
    if (S_ISREG(status.st_mode)) {
      list.files.push_back({name, static_cast<std::uint64_t>(status.st_size)});
    } else if (S_ISDIR(status.st_mode) && prefix.empty()) {
      list.folders.push_back(name);
      list_folder(path, name + "/", list);
    } else {
      list.others.push_back(name);
    }
  }
}

Listing list_of(const std::string& path) {
  Listing list;
  list_folder(path, "", list);
  return list;
}

class FolderContainer final : public Container {
 public:
  explicit FolderContainer(const std::string& path)
      : Container(path), folder_{::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)} {
    if (folder_.fd < 0) throw InputError(errno_message(path, "can't be read"));
    for (Listing::File& file : list_of(path).files) {
      entries_.push_back({std::move(file.name), 0, file.bytes});
    }
    finish_list();
    for (std::size_t i = 0; i < entries_.size(); ++i) entries_[i].index = i;
  }

  ContainerKind kind() const override { return ContainerKind::folder; }

  void read(const Entry& entry, std::uint64_t limit,
            std::vector<std::uint8_t>& out) const override {
    const std::string shown = shown_name(entry.name);
    if (entry.bytes > limit) {
      throw InputError(path_, shown,
                       "file has " + std::to_string(entry.bytes) + " bytes, expected at most " +
                           std::to_string(limit));
    }
    const std::size_t slash = entry.name.find('/');
    const bool deeper = slash != std::string::npos;
    const Descriptor inner{deeper ? ::openat(folder_.fd, entry.name.substr(0, slash).c_str(),
                                             O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)
                                  : -1};
    // Non-blocking, so that a pipe that took the file's place is not waited for.
    const Descriptor file{::openat(deeper ? inner.fd : folder_.fd,
                                   entry.name.c_str() + (deeper ? slash + 1 : 0),
                                   O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC)};
    if (file.fd < 0) throw InputError(errno_message(path_ + ": " + shown, "can't be read"));
    struct stat status;
    if (::fstat(file.fd, &status) != 0 || !S_ISREG(status.st_mode) ||
        static_cast<std::uint64_t>(status.st_size) != entry.bytes) {
      throw InputError(path_, shown, "was changed since the folder was opened");
    }
    out.resize(entry.bytes);
    for (std::size_t done = 0; done < out.size();) {
      const ssize_t n = ::read(file.fd, out.data() + done, out.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw InputError(errno_message(path_ + ": " + shown, "can't be read"));
      if (n == 0) throw InputError(path_, shown, "was changed while it was read");
      done += static_cast<std::size_t>(n);
    }
  }

 private:
  Descriptor folder_;
};

/// Removes a temporary folder at the end of its scope unless it was renamed.
struct TemporaryFolder {
  std::string path;
  bool keep = false;
  ~TemporaryFolder() {
    std::error_code error;
    if (!keep) std::filesystem::remove_all(path, error);
  }
};

bool same_place(const std::string& a, const std::string& b) {
  struct stat first, second;
  return ::stat(a.c_str(), &first) == 0 && ::stat(b.c_str(), &second) == 0 &&
         first.st_dev == second.st_dev && first.st_ino == second.st_ino;
}

/// Names of images that this program gives, see format_folder.cpp.
bool is_image_name(const std::string& name) {
  const std::size_t slash = name.find('/');
  const std::string file = slash == std::string::npos ? name : name.substr(slash + 1);
  return (slash == std::string::npos || name.starts_with("uv/")) && file.size() > 4 &&
         file.ends_with(".png") &&
         std::all_of(file.begin(), file.end() - 4, [](char c) { return c >= '0' && c <= '9'; });
}

void copy_file(const std::string& from, const std::string& to) {
  std::error_code error;
  std::filesystem::copy_file(from, to, error);
  if (error) throw DeviceError(to + ": can't be written: " + error.message());
  copy_mode(from, to);
  struct stat status;
  if (::stat(from.c_str(), &status) != 0) return;
  const timespec times[2] = {status.st_atim, status.st_mtim};
  ::utimensat(AT_FDCWD, to.c_str(), times, 0);
}

void write_file(const std::string& path, const std::vector<std::uint8_t>& data) {
  const Descriptor file{::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666)};
  if (file.fd < 0) throw DeviceError(errno_message(path, "can't be written"));
  for (std::size_t done = 0; done < data.size();) {
    const ssize_t n = ::write(file.fd, data.data() + done, data.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw DeviceError(errno_message(path, "can't be written"));
    done += static_cast<std::size_t>(n);
  }
}

class FolderOutput final : public ContainerOutput {
 public:
  /// `path` without slashes at the end, and no link.
  FolderOutput(const std::string& path, std::string keep_from)
      : ContainerOutput(path), keep_from_(std::move(keep_from)) {
    struct stat status;
    if (::stat(folder_.c_str(), &status) != 0) {
      throw DeviceError(errno_message(path, "folder of the output can't be used"));
    }
    if (file_.empty() || file_ == "." || file_ == "..") {
      throw InputError(path, "", "can't be replaced, expected the name of a folder");
    }
    if (!keep_from_.empty()) {
      if (same_place(folder_, keep_from_)) {
        throw InputError(path, "",
                         "lies in the folder that is kept, expected a name outside of it");
      }
      keeps_in_place_ = same_place(path_, keep_from_);
      take_kept();
    }
    if (exists()) check_replaceable(path_);
    const TemporaryFolder trial{make_temporary(path_, true)};
  }

  void finish(const ExecutionContext& context, const Check& check) override;

 private:
  /// False when nothing is there; throws when it is no folder.
  bool exists() const {
    struct stat status;
    if (::lstat(path_.c_str(), &status) != 0) {
      if (errno == ENOENT) return false;
      throw DeviceError(errno_message(path_, "can't be written"));
    }
    if (!S_ISDIR(status.st_mode)) {
      throw InputError(path_, "", "is a file, expected a folder or a new name");
    }
    return true;
  }
  void take_kept() {
    kept_ = list_of(keep_from_);
    refuse_others(kept_, keep_from_);
    kept_names_.clear();
    for (const Listing::File& file : kept_.files) kept_names_.insert(file.name);
  }
  static void refuse_others(const Listing& list, const std::string& path) {
    if (list.others.empty()) return;
    throw InputError(path, shown_name(list.others.front()),
                     "is a link or lies deeper than one folder, and would be lost; expected plain "
                     "files, or another folder to write to");
  }
  void check_replaceable(const std::string& now_at) const;
  void fill(const std::string& temporary, const ExecutionContext& context);
  void put_in_place(TemporaryFolder& temporary, const ExecutionContext& context);

  std::string keep_from_;
  bool keeps_in_place_ = false;
  Listing kept_;
  std::set<std::string> kept_names_;
};

/// Throws when removing the folder, which is named `path_` to the user, would lose something.
void FolderOutput::check_replaceable(const std::string& now_at) const {
  const Listing list = list_of(now_at);
  refuse_others(list, path_);
  if (list.files.empty() && list.folders.empty()) return;
  const auto is_ours = [](const Listing::File& file) { return file.name == kProvenanceEntry; };
  if (!keeps_in_place_ && std::none_of(list.files.begin(), list.files.end(), is_ours)) {
    throw InputError(path_, "",
                     "is there and was not written by slicecorr (it has no " +
                         std::string(kProvenanceEntry) +
                         "), so it is not replaced; expected a new name");
  }
  for (const Listing::File& file : list.files) {
    if (kept_names_.contains(file.name)) continue;
    if (!keeps_in_place_ && (is_ours(file) || is_image_name(file.name))) continue;
    throw InputError(path_, shown_name(file.name),
                     keeps_in_place_
                         ? "was added while the folder was written, which is not replaced"
                         : "was not written by slicecorr, so the folder is not replaced; expected "
                           "a new name");
  }
}

void FolderOutput::finish(const ExecutionContext& context, const Check& check) {
  context.check_cancelled();
  TemporaryFolder temporary{make_temporary(path_, true)};
  fill(temporary.path, context);
  if (!keep_from_.empty()) copy_mode(keep_from_, temporary.path);
  context.check_cancelled();
  if (check) check(temporary.path);
  put_in_place(temporary, context);
  context.report("write", 1);
}

void FolderOutput::fill(const std::string& temporary, const ExecutionContext& context) {
  std::set<std::string> folders;
  const auto make_folder_of = [&](const std::string& name) {
    const std::size_t slash = name.find('/');
    if (slash == std::string::npos || !folders.insert(name.substr(0, slash)).second) return;
    const std::string folder = temporary + "/" + name.substr(0, slash);
    if (::mkdir(folder.c_str(), 0777) != 0) {
      throw DeviceError(errno_message(path_, "can't be written"));
    }
    if (!keep_from_.empty()) copy_mode(keep_from_ + "/" + name.substr(0, slash), folder);
  };
  std::set<std::string> changed;
  for (const Source& source : sources_) changed.insert(source.name);
  if (!keep_from_.empty()) {
    take_kept();
    for (const std::string& folder : kept_.folders) make_folder_of(folder + "/");
    for (const Listing::File& file : kept_.files) {
      context.check_cancelled();
      if (changed.contains(file.name)) continue;
      const std::string from = keep_from_ + "/" + file.name, to = temporary + "/" + file.name;
      if (keeps_in_place_) {
        link_or_copy(from, to);
      } else {
        copy_file(from, to);
      }
    }
  }
  double done = 0, total = 1;
  for (const Source& source : sources_) total += static_cast<double>(source.size);
  std::vector<std::uint8_t> data;
  for (const Source& source : sources_) {
    context.check_cancelled();
    source.make(data);
    make_folder_of(source.name);
    const std::string to = temporary + "/" + source.name;
    write_file(to, data);
    if (!keep_from_.empty()) copy_mode(keep_from_ + "/" + source.name, to);
    done += static_cast<double>(source.size);
    context.report("write", done / total);
  }
  // One call for all files: waiting for thousands of them one by one takes minutes.
  const Descriptor folder{::open(temporary.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (folder.fd < 0 || ::syncfs(folder.fd) != 0) {
    throw DeviceError(errno_message(path_, "can't be written"));
  }
}

void FolderOutput::put_in_place(TemporaryFolder& temporary, const ExecutionContext& context) {
  const auto fail = [&](int error) {
    const bool unable = error == EINVAL || error == ENOSYS;
    throw DeviceError(unable ? path_ +
                                   ": this file system can't exchange two folders in one step; "
                                   "expected a new name"
                             : errno_message(path_, "can't be written", error));
  };
  if (!exists()) {
    // Where the file system can't rename like this, a plain rename replaces an empty folder at
    // most.
    int result =
        ::renameat2(AT_FDCWD, temporary.path.c_str(), AT_FDCWD, path_.c_str(), RENAME_NOREPLACE);
    if (result != 0 && (errno == EINVAL || errno == ENOSYS)) {
      result = ::rename(temporary.path.c_str(), path_.c_str());
    }
    if (result != 0) fail(errno);
    temporary.keep = true;
    sync_folder(folder_);
    return;
  }
  check_replaceable(path_);
  const auto exchange = [&] {
    if (::renameat2(AT_FDCWD, temporary.path.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) !=
        0) {
      fail(errno);
    }
  };
  exchange();
  // From here on the old folder has the temporary name, and must not be lost by an error.
  temporary.keep = true;
  try {
    // Files may have been added to it up to the exchange.
    check_replaceable(temporary.path);
    sync_folder(folder_);
  } catch (...) {
    exchange();
    temporary.keep = false;
    throw;
  }
  std::error_code error;
  std::filesystem::remove_all(temporary.path, error);
  if (error) {
    context.tell(path_ + ": the folder that was there before can't be removed, it is left at " +
                 temporary.path + ": " + error.message());
  }
}

}  // namespace

std::unique_ptr<Container> open_folder(const std::string& path) {
  return std::make_unique<FolderContainer>(without_slashes(path));
}

std::unique_ptr<ContainerOutput> make_folder_output(const std::string& path,
                                                    const std::string& keep_from) {
  std::string place = without_slashes(path);
  // Of a link what it leads to is replaced, not the link.
  struct stat status;
  if (::lstat(place.c_str(), &status) == 0 && S_ISLNK(status.st_mode)) {
    if (char* const real = ::realpath(place.c_str(), nullptr)) {
      place = real;
      ::free(real);
    }
  }
  return std::make_unique<FolderOutput>(place, without_slashes(keep_from));
}

}  // namespace slicecorr::detail
