// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file real_files.hpp
/// Real meshes, archives and measurements that others made. What may be redistributed lies in
/// tests/data, with where it comes from and under which licence; the rest in a folder that the
/// build was told of (SLICECORR_TEST_DATA), which a clone may lack.
#pragma once

#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace slicecorr::test {

/// The path of `name` ("meshes/clean/3DBenchy.stl"), whether it is there or not.
inline std::string real_file(const std::string& name) {
  const std::string own = SLICECORR_SOURCE_DIR "/tests/data/" + name;
  return std::filesystem::exists(own) ? own : SLICECORR_TEST_DATA "/" + name;
}

/// All files below the folder `name`, sorted by their names; each once.
inline std::vector<std::string> real_files(const std::string& name) {
  namespace fs = std::filesystem;
  std::map<std::string, std::string> found;
  for (const char* root : {SLICECORR_SOURCE_DIR "/tests/data/", SLICECORR_TEST_DATA "/"}) {
    const fs::path folder = root + name;
    if (!fs::exists(folder)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.is_regular_file()) {
        found.emplace(fs::relative(entry.path(), folder).string(), entry.path().string());
      }
    }
  }
  std::vector<std::string> paths;
  for (const auto& [_, path] : found) paths.push_back(path);
  return paths;
}

/// Why a test that needs `path` can't run; empty when it can.
inline std::string lacks(const std::string& path) {
  if (std::filesystem::exists(path)) return {};
  if (!std::filesystem::exists(SLICECORR_TEST_DATA)) {
    return "no folder of real data beside tests/data: " SLICECORR_TEST_DATA;
  }
  return path + " is not there";
}

/// `path` as the name of a test: letters and digits.
inline std::string name_of(const std::string& path) {
  std::string name = path;
  for (char& c : name) {
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  }
  return name;
}

}  // namespace slicecorr::test

/// Ends the test as skipped where the real file is not there.
#define SLICECORR_NEEDS_FILE(path) \
  if (const std::string why = slicecorr::test::lacks(path); !why.empty()) GTEST_SKIP() << why
