// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/maker.hpp"

#include <fmt/format.h>
#include <linux/magic.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <fstream>
#include <sstream>

namespace slicecorr::detail {
namespace {

/// Fields of /proc/PID/stat after the name, which may hold anything.
struct Stat {
  char state = 0;
  unsigned long long started = 0;
};
Stat stat_of(long pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
  std::string text;
  std::getline(file, text, '\0');
  const std::size_t name = text.rfind(')');
  if (name == std::string::npos) return {};
  std::istringstream rest(text.substr(name + 1));
  Stat s;
  rest >> s.state;
  std::string skipped;
  for (int field = 4; field < 22; ++field) rest >> skipped;
  rest >> s.started;
  return rest ? s : Stat{};
}

/// /proc may be that of another container.
bool proc_is_ours() {
  std::array<char, 32> text{};
  const ssize_t n = ::readlink("/proc/self", text.data(), text.size() - 1);
  return n > 0 && std::string(text.data()) == std::to_string(::getpid());
}

unsigned long this_boot() {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string text;
  file >> text;
  unsigned long number = 0;
  std::from_chars(text.data(), text.data() + std::min<std::size_t>(8, text.size()), number, 16);
  return number;
}

/// File systems that one computer alone has. Those of a network, and those that we do not know, are not among them.
bool is_own_disk(const std::string& folder) {
  struct statfs s {};
  if (::statfs(folder.c_str(), &s) != 0) return false;
  constexpr unsigned long zfs = 0x2FC12FC1, ntfs3 = 0x7366746E, bcachefs = 0xCA451A4E,
                          exfat = 0x2011BAB0, jfs = 0x3153464A, xfs = 0x58465342;
  constexpr std::array own{static_cast<unsigned long>(EXT4_SUPER_MAGIC),
                           static_cast<unsigned long>(BTRFS_SUPER_MAGIC),
                           static_cast<unsigned long>(F2FS_SUPER_MAGIC),
                           static_cast<unsigned long>(TMPFS_MAGIC),
                           static_cast<unsigned long>(RAMFS_MAGIC),
                           static_cast<unsigned long>(OVERLAYFS_SUPER_MAGIC),
                           static_cast<unsigned long>(MSDOS_SUPER_MAGIC),
                           static_cast<unsigned long>(REISERFS_SUPER_MAGIC),
                           zfs,
                           ntfs3,
                           bcachefs,
                           exfat,
                           jfs,
                           xfs};
  // Of some systems the word is signed.
  const auto type = static_cast<unsigned long>(s.f_type) & 0xFFFFFFFFUL;
  return std::find(own.begin(), own.end(), type) != own.end();
}

}  // namespace

Maker this_process() {
  Maker maker;
  maker.pid = ::getpid();
  maker.boot = this_boot();
  struct stat room;
  if (!proc_is_ours() || ::stat("/proc/self/ns/pid", &room) != 0) return maker;
  maker.room = static_cast<unsigned long>(room.st_ino);
  maker.started = stat_of(maker.pid).started;
  return maker;
}

std::string text_of(const Maker& maker) {
  return fmt::format("{}-{}-{:x}-{:08x}", maker.pid, maker.started, maker.room, maker.boot);
}

std::optional<Maker> maker_of(std::string_view text) {
  const char* at = text.data();
  const char* const end = at + text.size();
  const auto read = [&](auto& number, int base, char after) {
    const auto [rest, error] = std::from_chars(at, end, number, base);
    if (error != std::errc() || (after != 0 && (rest == end || *rest != after))) return false;
    at = rest + (after != 0 ? 1 : 0);
    return true;
  };
  Maker maker;
  if (!read(maker.pid, 10, '-') || !read(maker.started, 10, '-') || !read(maker.room, 16, '-') ||
      !read(maker.boot, 16, 0) || at != end || maker.pid <= 0) {
    return std::nullopt;
  }
  return maker;
}

bool is_gone(const Maker& maker, const std::string& folder) {
  const Maker we = this_process();
  if (maker.boot == 0 || we.boot == 0) return false;
  if (maker.boot != we.boot) return is_own_disk(folder);
  // Numbers of another container say nothing here.
  if (maker.room == 0 || maker.room != we.room) return false;
  if (::kill(static_cast<pid_t>(maker.pid), 0) != 0) return errno == ESRCH;
  const Stat now = stat_of(maker.pid);
  // Another has got its number; or it has ended, and nobody has asked how.
  if (now.started == 0 || maker.started == 0) return false;
  return now.started != maker.started || now.state == 'Z';
}

}  // namespace slicecorr::detail
