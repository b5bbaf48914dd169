// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loaded before a program (LD_PRELOAD), it writes down what a power cut would ask for: in POWER_LOG a line for each
/// write into a file ("W DEVICE INODE"), each wait until a file or folder is on the disk ("S DEVICE INODE"), and each new
/// name ("R DEVICE INODE FOLDER-DEVICE FOLDER-INODE NAME"). Processes that it starts add to the same file.
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

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

void tell_of(const char* what, int file) {
  struct stat s {};
  if (::fstat(file, &s) != 0 || (!S_ISREG(s.st_mode) && !S_ISDIR(s.st_mode))) return;
  static thread_local std::string last;
  const std::string line = std::string(what) + " " + known(s) + "\n";
  // Of a hundred writes in a row one is enough.
  if (line == last && *what == 'W') return;
  last = line;
  tell(line);
}

void tell_name(const char* from, const char* to) {
  struct stat s {
  }, folder{};
  const std::string name = to;
  const std::size_t slash = name.rfind('/');
  const std::string in = slash == std::string::npos ? "." : name.substr(0, slash + 1);
  if (::stat(from, &s) != 0 || !S_ISREG(s.st_mode) || ::stat(in.c_str(), &folder) != 0) return;
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
