// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/lasting_folder.hpp"

#include <unistd.h>

#include <filesystem>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::detail {

bool make_lasting_folder(const std::string& path, std::error_code& error) {
  namespace fs = std::filesystem;
  fs::path at = fs::absolute(path, error).lexically_normal();
  if (error) return false;
  if (!at.has_filename()) at = at.parent_path();
  std::vector<fs::path> parents;
  for (std::error_code none; !fs::exists(at, none) && at != at.parent_path();
       at = at.parent_path()) {
    parents.push_back(at.parent_path());
  }
  const bool made = fs::create_directories(path, error);
  if (error) return false;
  for (const fs::path& p : parents) {
    // Of a folder that may be gone through and not be looked at nobody can wait for the names.
    if (::access(p.c_str(), R_OK) == 0) sync_folder(p.string());
  }
  return made;
}

bool make_lasting_folder(const std::string& path) {
  std::error_code error;
  const bool made = make_lasting_folder(path, error);
  if (error) throw DeviceError(path + ": can't be made: " + error.message());
  return made;
}

}  // namespace slicecorr::detail
