// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/shared_object.hpp"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>
#include <vector>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace fs = std::filesystem;

namespace {

/// Where modules may lie: beside what this code is part of, then where they were installed or
/// built.
std::vector<fs::path> folders() {
  std::vector<fs::path> all;
  if (const char* given = std::getenv("SLICECORR_MODULES"); given && *given)
    all.emplace_back(given);
  if (const fs::path folder = own_folder(); !folder.empty()) {
    all.push_back(folder / "slicecorr");
    all.push_back(folder.parent_path() / SLICECORR_LIBDIR / "slicecorr");
  }
  all.emplace_back(SLICECORR_INSTALLED_MODULES);
  if (const fs::path built = SLICECORR_BUILT_MODULES; !built.empty()) all.push_back(built);
  return all;
}

}  // namespace

fs::path own_folder() {
  Dl_info here{};
  if (::dladdr(reinterpret_cast<const void*>(&module_entry), &here) == 0 || !here.dli_fname) {
    return {};
  }
  std::error_code error;
  const fs::path file = fs::canonical(here.dli_fname, error);
  return error ? fs::path() : file.parent_path();
}

void* module_entry(const char* file_name, const char* entry_name, const char* what_it_does) {
  std::string looked;
  for (const fs::path& folder : folders()) {
    const fs::path path = folder / file_name;
    std::error_code error;
    if (!fs::exists(path, error)) {
      looked += (looked.empty() ? "" : ", ") + folder.string();
      continue;
    }
    void* const module = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    void* const entry = module ? ::dlsym(module, entry_name) : nullptr;
    if (!entry) throw DeviceError(path.string() + ": can't be loaded: " + ::dlerror());
    return entry;
  }
  throw DeviceError(std::string(file_name) + ", which " + what_it_does + ", is in none of " +
                    looked + "; expected it there, or in $SLICECORR_MODULES");
}

}  // namespace slicecorr::detail
