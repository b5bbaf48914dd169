// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file fuzz.hpp
/// What the fuzzers have in common: files in memory, and what a refusal has to be.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "slicecorr/error.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::fuzz {

/// A folder, in memory where that is possible, that goes when the program ends.
class Folder {
 public:
  Folder() {
    path_ = ::access("/dev/shm", W_OK) == 0 ? "/dev/shm/slicecorr-fuzz-XXXXXX"
                                            : "/tmp/slicecorr-fuzz-XXXXXX";
    if (!::mkdtemp(path_.data())) std::abort();
  }
  ~Folder() {
    std::error_code left;
    std::filesystem::remove_all(path_, left);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const std::string& path() const { return path_; }
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

[[noreturn]] inline void fail(const std::string& what) {
  fmt::print(stderr, "found: {}\n", what);
  std::abort();
}

inline std::string text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

inline void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

inline std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// One thread: what is found is found again.
inline ExecutionContext one_thread() {
  ExecutionContext context;
  context.threads = 1;
  return context;
}

/// Calls `read`, which may refuse with an `InputError` that names one of these files, and nothing
/// else. Whether it did not.
template <class Read>
bool read_or_refuse(const Read& read, const std::string& path, const std::string& other = {}) {
  try {
    read();
    return true;
  } catch (const InputError& e) {
    const std::string what = e.what();
    if (what.find(path) == std::string::npos &&
        (other.empty() || what.find(other) == std::string::npos)) {
      fail("a refusal names no file: " + what);
    }
    return false;
  }
}

}  // namespace slicecorr::fuzz
