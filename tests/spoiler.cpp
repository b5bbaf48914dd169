// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loaded before a program (LD_PRELOAD), it spoils one of its inputs at a chosen moment: at the
/// n-th call of this process that opens or reads it, just before that call. By the environment:
/// SPOIL_FILE, SPOIL_AT (from 1), SPOIL_HOW (unlink, truncate: to half, empty). When it has done
/// it, it makes SPOIL_FILE.spoilt.
#include <dlfcn.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

template <class Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

/// Which file it is, known since the first look at it.
struct Target {
  const char* path = std::getenv("SPOIL_FILE");
  long at = std::getenv("SPOIL_AT") ? std::atol(std::getenv("SPOIL_AT")) : 0;
  struct stat status {};
  bool known = path != nullptr && ::stat(path, &status) == 0;
  std::atomic<long> calls{0};
};
Target& target() {
  static Target* const t = new Target;  // used until the very end
  return *t;
}

[[gnu::destructor]] void tell_calls() {
  if (target().path == nullptr) return;
  const int file = ::creat((std::string(target().path) + ".calls").c_str(), 0666);
  ::dprintf(file, "%ld", target().calls.load());
  ::close(file);
}

void spoil() {
  const char* how = std::getenv("SPOIL_HOW");
  const char* path = target().path;
  int result = -1;
  if (how != nullptr && std::strcmp(how, "unlink") == 0) result = ::unlink(path);
  if (how != nullptr && std::strcmp(how, "truncate") == 0) {
    result = ::truncate(path, target().status.st_size / 2);
  }
  if (how != nullptr && std::strcmp(how, "empty") == 0) result = ::truncate(path, 0);
  if (result == 0) ::close(::creat((std::string(path) + ".spoilt").c_str(), 0666));
}

void count(const struct stat& status) {
  Target& t = target();
  if (status.st_dev != t.status.st_dev || status.st_ino != t.status.st_ino) return;
  if (++t.calls == t.at) spoil();
}
void see(int file) {
  struct stat status;
  if (target().known && ::fstat(file, &status) == 0) count(status);
}
void see(const char* path) {
  struct stat status;
  if (target().known && ::stat(path, &status) == 0) count(status);
}

}  // namespace

// With the names that the parameters have in the C library's headers.
extern "C" {

int open(const char* file, int oflag, ...) {
  va_list list;
  va_start(list, oflag);
  const mode_t mode = (oflag & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  see(file);
  return real<int(const char*, int, ...)>("open")(file, oflag, mode);
}
int open64(const char* file, int oflag, ...) {
  va_list list;
  va_start(list, oflag);
  const mode_t mode = (oflag & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  see(file);
  return real<int(const char*, int, ...)>("open64")(file, oflag, mode);
}
FILE* fopen(const char* filename, const char* modes) {
  see(filename);
  return real<FILE*(const char*, const char*)>("fopen")(filename, modes);
}
FILE* fopen64(const char* filename, const char* modes) {
  see(filename);
  return real<FILE*(const char*, const char*)>("fopen64")(filename, modes);
}
ssize_t read(int fd, void* buf, size_t nbytes) {
  see(fd);
  return real<ssize_t(int, void*, size_t)>("read")(fd, buf, nbytes);
}
ssize_t pread(int fd, void* buf, size_t nbytes, off_t offset) {
  see(fd);
  return real<ssize_t(int, void*, size_t, off_t)>("pread")(fd, buf, nbytes, offset);
}
ssize_t pread64(int fd, void* buf, size_t nbytes, off64_t offset) {
  see(fd);
  return real<ssize_t(int, void*, size_t, off64_t)>("pread64")(fd, buf, nbytes, offset);
}
size_t fread(void* ptr, size_t size, size_t n, FILE* stream) {
  see(::fileno(stream));
  return real<size_t(void*, size_t, size_t, FILE*)>("fread")(ptr, size, n, stream);
}
int linkat(int fromfd, const char* from, int tofd, const char* to, int flags) {
  see(from);
  return real<int(int, const char*, int, const char*, int)>("linkat")(fromfd, from, tofd, to,
                                                                      flags);
}

}  // extern "C"
