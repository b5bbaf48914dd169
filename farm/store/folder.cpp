// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/folder.hpp"

#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/open_to_all.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using slicecorr::detail::make_own_folder;

namespace {

/// File systems of other machines, where SQLite's locks and shared memory don't hold.
bool is_network(const std::string& path) {
  struct statfs s {};
  if (::statfs(path.c_str(), &s) != 0) return false;
  constexpr long cifs = 0xFF534D42, smb2 = 0xFE534D42, lustre = 0x0BD00BD0, ceph = 0x00C36400,
                 gpfs = 0x47504653;
  for (const long type : {long{NFS_SUPER_MAGIC}, long{SMB_SUPER_MAGIC}, cifs, smb2, lustre, ceph,
                          gpfs, long{AFS_SUPER_MAGIC}, long{V9FS_MAGIC}}) {
    if (static_cast<long>(s.f_type) == type) return true;
  }
  return false;
}

}  // namespace

std::string FarmFolder::cache_entry(const std::string& key) const {
  return store + "/cache/" + key.substr(0, 2) + "/" + key;
}
std::string FarmFolder::input(const std::string& file) const {
  return store + "/inputs/" + file.substr(0, 2) + "/" + file;
}
std::string FarmFolder::log(long long job, int number) const {
  return fmt::format("{}/logs/{}-{}.txt", root, job, number);
}
std::string FarmFolder::results(long long job) const {
  return fmt::format("{}/results/{}", root, job);
}

std::string default_farm_folder() {
  if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state) {
    return std::string(state) + "/slicecorr/farm";
  }
  const char* home = std::getenv("HOME");
  return std::string(home && *home ? home : ".") + "/.local/state/slicecorr/farm";
}

FarmFolder open_folder(const std::string& root, const std::string& store) {
  FarmFolder folder;
  folder.root = fs::absolute(root).lexically_normal().string();
  while (folder.root.size() > 1 && folder.root.back() == '/') folder.root.pop_back();
  make_own_folder(folder.root);
  if (is_network(folder.root)) {
    throw InputError(folder.root, "",
                     "is on a network file system, where a database's locks can't be trusted; "
                     "expected a folder on a local disk (--store may be shared)");
  }
  // Where the store is, is said once, when the farm is made.
  const std::string note = folder.root + "/store.path";
  folder.store = folder.root + "/store";
  std::ifstream file(note);
  if (!file && errno != ENOENT) {
    throw DeviceError(slicecorr::detail::errno_message(note, "can't be read"));
  }
  if (file) {
    std::getline(file, folder.store);
    if (!store.empty() && fs::absolute(store).lexically_normal() != fs::path(folder.store)) {
      throw InputError(folder.root, "", "has its store in " + folder.store + ", not in " + store);
    }
  } else if (!store.empty()) {
    const std::string wanted = fs::absolute(store).lexically_normal().string();
    std::error_code error;
    if (fs::exists(folder.store, error) && wanted != folder.store) {
      throw InputError(folder.root, "", "has its store in " + folder.store + ", not in " + store);
    }
    folder.store = wanted;
    make_own_folder(folder.store);
    slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(note)};
    {
      std::ofstream out(part.path);
      out << folder.store << "\n";
    }
    slicecorr::detail::put_in_place(part, note);
  }
  for (const char* name : {"", "/inputs", "/attempts", "/cache"})
    make_own_folder(folder.store + name);
  for (const char* name : {"/logs", "/results"}) make_own_folder(folder.root + name);
  // Who can change these chooses what this user's programs do.
  for (const char* name :
       {"/store.path", "/farm.sqlite", "/notify.toml", "/machines.toml", "/bridges.toml"}) {
    slicecorr::detail::refuse_open_to_all(folder.root + name);
  }
  return folder;
}

}  // namespace slicecorr::farm
