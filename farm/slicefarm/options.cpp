// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <pwd.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "commands.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm {

void FarmOptions::add_to(CLI::App& app) {
  app.add_option("--dir", dir, "Folder of the farm [" + default_farm_folder() + "]");
}

FarmFolder FarmOptions::open(const std::string& store) const {
  return open_folder(dir.empty() ? default_farm_folder() : dir, store);
}

FarmFolder FarmOptions::existing() const {
  const std::string root = dir.empty() ? default_farm_folder() : dir;
  std::error_code error;
  if (!std::filesystem::exists(root + "/farm.sqlite", error)) {
    throw InputError(root, "", "is no farm; expected a folder that slicefarm submit has used");
  }
  return open_folder(root);
}

std::string user_name() {
  if (const char* name = std::getenv("USER"); name && *name) return name;
  if (const passwd* entry = getpwuid(geteuid())) return entry->pw_name;
  return std::to_string(geteuid());
}

}  // namespace slicecorr::farm
