// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/open_to_all.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>

#include "slicecorr/error.hpp"
#include "support/files/lasting_folder.hpp"

namespace slicecorr::detail {

void refuse_open_to_all(const std::string& path) {
  struct stat s {};
  if (::stat(path.c_str(), &s) != 0 || (s.st_mode & S_IWOTH) == 0) return;
  throw InputError(
      path, "",
      fmt::format("may be changed by every user (mode {:04o}); expected one that only its "
                  "owner or group may write to (chmod o-w)",
                  s.st_mode & 07777));
}

void make_own_folder(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (make_lasting_folder(path))
    fs::permissions(path, fs::perms::others_write, fs::perm_options::remove, error);
  refuse_open_to_all(path);
}

}  // namespace slicecorr::detail
