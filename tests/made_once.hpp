// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file made_once.hpp
/// Inputs that several tests want alike: programs make them for the first of these tests alone.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "stack_fixture.hpp"

namespace slicecorr::test {

/// Puts files of these names into the folder. `make` writes them there; what it wrote is kept by the
/// name `what`, for the next test.
inline void made_once(const std::string& what, const TemporaryFolder& folder,
                      const std::vector<std::string>& names, const std::function<void()>& make) {
  static std::map<std::string, std::vector<Bytes>> known;
  const auto found = known.find(what);
  if (found != known.end()) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      write_file(folder / names[i], found->second.at(i));
    }
    return;
  }
  make();
  std::vector<Bytes> files;
  for (const std::string& name : names) files.push_back(read_file(folder / name));
  known.emplace(what, std::move(files));
}

}  // namespace slicecorr::test
