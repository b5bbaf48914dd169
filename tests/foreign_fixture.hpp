// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file foreign_fixture.hpp
/// Stacks and archives for the tests of formats.
#pragma once

#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <vector>

#include "stack_fixture.hpp"

namespace slicecorr::test {

inline constexpr MissingFacts kFacts{50, 40, 25};

inline Bytes png_of(const Images& images, std::size_t n) {
  return encode_png({images.grid.width_px, images.grid.height_px, images.slices[n]});
}

inline void expect_refused(const std::string& path, const std::string& expected) {
  SCOPED_TRACE(expected);
  try {
    const StackReader reader(path, std::filesystem::temp_directory_path(), {}, kFacts);
    FAIL() << "read, expected an error with: " << expected;
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(path));
    EXPECT_THAT(error.what(), testing::HasSubstr(expected));
  }
}

/// What a context is told.
struct Notices {
  std::vector<std::string> texts;
  ExecutionContext context;
  Notices() {
    context.notice = [this](const std::string& text) { texts.push_back(text); };
  }
  std::string all() const {
    std::string all;
    for (const std::string& text : texts) all += text + "\n";
    return all;
  }
};

/// A stack of another program: nothing of ours is in the archive.
inline StackInfo foreign_info(const Grid& grid) {
  StackInfo info = info_of(grid);
  info.kind = StackKind::foreign;
  return info;
}

/// Makes every slice different from those of other seeds.
inline void stamp(Images& images, unsigned seed) {
  for (Bytes& slice : images.slices) slice[0] = static_cast<std::uint8_t>(seed);
}

inline Images stamped_images(int width, int height, int layers, unsigned seed) {
  Images images = random_images(width, height, layers, seed);
  stamp(images, seed);
  return images;
}

inline Images like(const Images& images, int layers, unsigned seed) {
  Images other = random_images(images.grid.width_px, images.grid.height_px, layers, seed);
  Grid grid = images.grid;
  grid.layers = layers;
  other.grid = grid;
  stamp(other, seed);
  return other;
}

inline StackFile file(const std::string& path, const std::string& format,
                      const std::string& keep_from = "") {
  StackFile f(path);
  f.format = format;
  f.keep_from = keep_from;
  return f;
}

inline std::vector<std::string> names_of(const Entries& entries) {
  std::vector<std::string> names;
  for (const auto& [name, data] : entries) names.push_back(name);
  return names;
}

}  // namespace slicecorr::test
