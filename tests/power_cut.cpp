// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loaded before a program (LD_PRELOAD), it writes down what a power cut would ask for: in POWER_LOG a line for each
/// write into a file ("W DEVICE INODE"), each wait until a file or folder is on the disk ("S DEVICE INODE"), and each new
/// name ("R DEVICE INODE FOLDER-DEVICE FOLDER-INODE NAME"). Processes that it starts add to the same file.
///
/// With POWER_SAVE, a folder, its file "log" gets lines with whole paths and tabs between, and the folder what files held
/// at these moments, as copies with numbers for names: "sync PATH COPY", "name FROM TO COPY" ("-" for a folder),
/// "made PATH" (a folder), "folder PATH" (its names are on the disk), "all" (syncfs: everything is), "gone PATH",
/// "write PATH"; of a database and its write-ahead log each is saved when the other is synced ("with PATH COPY").
/// power_cut.py judges them.
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <string>
#include <string_view>

namespace {

template <class Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

/// In one write, past what is counted here; a file opened for appending keeps the order of processes.
void tell(const std::string& line) {
  static const char* const path = std::getenv("POWER_LOG");
  if (path == nullptr) return;
  const long file =
      ::syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (file < 0) return;
  ::syscall(SYS_write, file, line.data(), line.size());
  ::syscall(SYS_close, file);
}

std::string known(const struct stat& s) {
  return std::to_string(s.st_dev) + " " + std::to_string(s.st_ino);
}

/// --- with POWER_SAVE ---

const char* save_folder() {
  static const char* const folder = std::getenv("POWER_SAVE");
  return folder;
}

void save_line(const std::string& line) {
  const std::string path = std::string(save_folder()) + "/log";
  const long file = ::syscall(SYS_openat, AT_FDCWD, path.c_str(),
                              O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (file < 0) return;
  ::syscall(SYS_write, file, line.data(), line.size());
  ::syscall(SYS_close, file);
}

/// A copy of what a file holds now; its name, "-" when there is none.
std::string saved(const std::string& path) {
  static std::atomic<unsigned> count{0};
  const long from = ::syscall(SYS_openat, AT_FDCWD, path.c_str(), O_RDONLY | O_CLOEXEC, 0);
  if (from < 0) return "-";
  struct stat s {};
  ::fstat(static_cast<int>(from), &s);
  std::string name = "-";
  if (S_ISREG(s.st_mode)) {
    name = std::to_string(::getpid()) + "-" + std::to_string(++count);
    const std::string copy = std::string(save_folder()) + "/" + name;
    const long to = ::syscall(SYS_openat, AT_FDCWD, copy.c_str(),
                              O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    char buffer[65536];
    for (long n = 0; (n = ::syscall(SYS_read, from, buffer, sizeof buffer)) > 0;) {
      ::syscall(SYS_write, to, buffer, n);
    }
    ::syscall(SYS_close, to);
  }
  ::syscall(SYS_close, from);
  return name;
}

std::string path_of(int file) {
  char path[4096];
  const ssize_t n =
      ::readlink(("/proc/self/fd/" + std::to_string(file)).c_str(), path, sizeof path);
  return n > 0 ? std::string(path, static_cast<std::size_t>(n)) : std::string();
}

std::string whole_path(const char* path) {
  if (*path == '/') return path;
  char folder[4096];
  return ::getcwd(folder, sizeof folder) ? std::string(folder) + "/" + path : path;
}

void save_sync(int file, const struct stat& s) {
  if (!save_folder()) return;
  const std::string path = path_of(file);
  if (S_ISDIR(s.st_mode)) return save_line("folder\t" + path + "\n");
  save_line("sync\t" + path + "\t" + saved(path) + "\n");
  constexpr std::string_view wal = "-wal";
  const std::string other =
      path.ends_with(wal) ? path.substr(0, path.size() - wal.size()) : path + std::string(wal);
  if (const std::string copy = saved(other); copy != "-") {
    save_line("with\t" + other + "\t" + copy + "\n");
  }
}

void tell_of(const char* what, int file) {
  struct stat s {};
  if (::fstat(file, &s) != 0 || (!S_ISREG(s.st_mode) && !S_ISDIR(s.st_mode))) return;
  static thread_local std::string last;
  if (*what == 'S') save_sync(file, s);
  const std::string line = std::string(what) + " " + known(s) + "\n";
  // Of a hundred writes in a row one is enough.
  if (line == last && *what == 'W') return;
  last = line;
  tell(line);
  if (*what == 'W' && save_folder()) save_line("write\t" + path_of(file) + "\n");
}

void tell_name(const char* from, const char* to) {
  struct stat s {
  }, folder{};
  const std::string name = to;
  const std::size_t slash = name.rfind('/');
  const std::string in = slash == std::string::npos ? "." : name.substr(0, slash + 1);
  if (::stat(from, &s) != 0) return;
  if (save_folder()) {
    save_line("name\t" + whole_path(from) + "\t" + whole_path(to) + "\t" + saved(from) + "\n");
  }
  if (!S_ISREG(s.st_mode) || ::stat(in.c_str(), &folder) != 0) return;
  tell("R " + known(s) + " " + known(folder) + " " + name + "\n");
}

}  // namespace

extern "C" {

int fsync(int fd) {
  const int result = real<int(int)>("fsync")(fd);
  tell_of("S", fd);
  return result;
}
int fdatasync(int fildes) {
  const int result = real<int(int)>("fdatasync")(fildes);
  tell_of("S", fildes);
  return result;
}
ssize_t write(int fd, const void* buf, size_t n) {
  tell_of("W", fd);
  return real<ssize_t(int, const void*, size_t)>("write")(fd, buf, n);
}
ssize_t writev(int fd, const struct iovec* iovec, int count) {
  tell_of("W", fd);
  return real<ssize_t(int, const struct iovec*, int)>("writev")(fd, iovec, count);
}
ssize_t pwrite64(int fd, const void* buf, size_t n, off64_t offset) {
  tell_of("W", fd);
  return real<ssize_t(int, const void*, size_t, off64_t)>("pwrite64")(fd, buf, n, offset);
}
int syncfs(int fd) noexcept {
  const int result = real<int(int)>("syncfs")(fd);
  if (save_folder()) save_line("all\n");
  return result;
}
int told_unlink(const char* path) noexcept __asm__("unlink");
int told_unlink(const char* path) noexcept {
  const int result = real<int(const char*)>("unlink")(path);
  if (result == 0 && save_folder()) save_line("gone\t" + whole_path(path) + "\n");
  return result;
}
int told_mkdir(const char* path, mode_t mode) noexcept __asm__("mkdir");
int told_mkdir(const char* path, mode_t mode) noexcept {
  const int result = real<int(const char*, mode_t)>("mkdir")(path, mode);
  if (result == 0 && save_folder()) save_line("made\t" + whole_path(path) + "\n");
  return result;
}
int link(const char* from, const char* to) noexcept {
  tell_name(from, to);
  return real<int(const char*, const char*)>("link")(from, to);
}
// Under names of their own: one of their parameters has a name in the C library's headers that C++ keeps.
int told_rename(const char* from, const char* to) noexcept __asm__("rename");
int told_rename(const char* from, const char* to) noexcept {
  tell_name(from, to);
  return real<int(const char*, const char*)>("rename")(from, to);
}
int told_renameat2(int from_folder, const char* from, int to_folder, const char* to,
                   unsigned flags) noexcept __asm__("renameat2");
int told_renameat2(int from_folder, const char* from, int to_folder, const char* to,
                   unsigned flags) noexcept {
  if (from_folder == AT_FDCWD && to_folder == AT_FDCWD) tell_name(from, to);
  return real<int(int, const char*, int, const char*, unsigned)>("renameat2")(from_folder, from,
                                                                              to_folder, to, flags);
}

}  // extern "C"
