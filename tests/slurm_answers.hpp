// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file slurm_answers.hpp
/// Answers of Slurm 22.05 as they were captured (tests/slurm), and a folder for files of the
/// engine.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace slicecorr::test {

inline std::string captured(const std::string& name) {
  std::ifstream in(SLICECORR_SOURCE_DIR "/tests/slurm/" + name, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  EXPECT_FALSE(text.str().empty()) << name;
  return text.str();
}

class Folder {
 public:
  Folder() {
    std::string path = (std::filesystem::temp_directory_path() / "farm-slurm-XXXXXX").string();
    path_ = ::mkdtemp(path.data());
  }
  ~Folder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace slicecorr::test
