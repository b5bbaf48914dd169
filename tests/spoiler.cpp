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

extern "C" {

int open(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  see(path);
  return real<int(const char*, int, ...)>("open")(path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  see(path);
  return real<int(const char*, int, ...)>("open64")(path, flags, mode);
}
FILE* fopen(const char* path, const char* mode) {
  see(path);
  return real<FILE*(const char*, const char*)>("fopen")(path, mode);
}
FILE* fopen64(const char* path, const char* mode) {
  see(path);
  return real<FILE*(const char*, const char*)>("fopen64")(path, mode);
}
ssize_t read(int file, void* to, size_t size) {
  see(file);
  return real<ssize_t(int, void*, size_t)>("read")(file, to, size);
}
ssize_t pread(int file, void* to, size_t size, off_t from) {
  see(file);
  return real<ssize_t(int, void*, size_t, off_t)>("pread")(file, to, size, from);
}
ssize_t pread64(int file, void* to, size_t size, off64_t from) {
  see(file);
  return real<ssize_t(int, void*, size_t, off64_t)>("pread64")(file, to, size, from);
}
size_t fread(void* to, size_t size, size_t n, FILE* file) {
  see(::fileno(file));
  return real<size_t(void*, size_t, size_t, FILE*)>("fread")(to, size, n, file);
}
int linkat(int from_folder, const char* from, int to_folder, const char* to, int flags) {
  see(from);
  return real<int(int, const char*, int, const char*, int)>("linkat")(from_folder, from, to_folder,
                                                                      to, flags);
}

}  // extern "C"
