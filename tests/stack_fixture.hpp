// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file stack_fixture.hpp
/// Temporary folders, random stacks, and zips made past the library.
#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>
#include <zip.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {

using Bytes = std::vector<std::uint8_t>;

/// A folder that is removed with all its contents.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "slicecorr.XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TemporaryFolder() {
    // Programs that were ended may write for a moment longer.
    for (int tries = 0; tries < 40; ++tries) {
      std::error_code error;
      std::filesystem::remove_all(path_, error);
      if (!error) return;
      ::usleep(50'000);
    }
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  /// Number of files, hidden ones too.
  std::ptrdiff_t count() const {
    return std::distance(std::filesystem::directory_iterator(path_),
                         std::filesystem::directory_iterator());
  }

 private:
  std::string path_;
};

inline Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline void write_file(const std::string& path, const Bytes& data) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(data.data()), static_cast<std::streamsize>(data.size()));
}

inline Bytes to_bytes(const std::string& text) { return {text.begin(), text.end()}; }
inline std::string to_text(const Bytes& data) { return {data.begin(), data.end()}; }

/// Slices as plain arrays.
struct Images {
  Grid grid;
  std::vector<Bytes> slices;
};

/// Runs of random length and value, black slices and noise, all inside a random box.
inline Images random_images(int width, int height, int layers, unsigned seed) {
  std::mt19937 random(seed);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  Images images{{width, height, layers, 50, 40.5, 1000.0 / 30}, {}};
  for (int n = 0; n < layers; ++n) {
    Bytes pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    const int style = below(4);
    const int x0 = below(width), x1 = x0 + 1 + below(width - x0);
    const int y0 = below(height), y1 = y0 + 1 + below(height - y0);
    for (int y = y0; style != 0 && y < y1; ++y) {
      int left = 0, value = 0;
      for (int x = x0; x < x1; ++x) {
        if (left-- == 0) {
          left = style == 1 ? 0 : below(40);
          value = style == 2 ? 255 * below(2) : below(256);
        }
        pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
               static_cast<std::size_t>(x)] = static_cast<std::uint8_t>(value);
      }
    }
    images.slices.push_back(std::move(pixels));
  }
  return images;
}

inline StackInfo info_of(const Grid& grid) {
  StackInfo info;
  info.grid = grid;
  info.kind = StackKind::target;
  info.target_layers = grid.layers;
  info.program = "slicecorr test";
  return info;
}

inline void write_stack(const StackFile& file, const Images& images, const StackInfo& info,
                        const ExecutionContext& context = {},
                        const GreyImage& preview = {2, 1, {7, 9}}) {
  const Grid& grid = images.grid;
  StackWriter writer(file, grid, context);
  const int rows = band_rows(grid);
  const auto bands = static_cast<std::size_t>((grid.height_px + rows - 1) / rows);
  parallel_for(context, "encode", bands, [&](std::size_t band) {
    const int y0 = static_cast<int>(band) * rows, y1 = std::min(grid.height_px, y0 + rows);
    StackWriter::BandEncoder encoder(writer, y0, y1);
    for (int n = 0; n < grid.layers; ++n) {
      const Bytes& pixels = images.slices[static_cast<std::size_t>(n)];
      encoder.put(n, 0, grid.width_px, &pixels[static_cast<std::size_t>(y0 * grid.width_px)]);
    }
  });
  writer.finish(info, preview);
}

/// All images of a source, read in one box.
inline std::vector<Bytes> read_images(const SliceSource& source, const PixelBox& box) {
  std::vector<Bytes> slices;
  const auto size = static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
  source.read_band(box, [&](int slice, const std::uint8_t* rows) {
    EXPECT_EQ(slice, static_cast<int>(slices.size()));
    slices.push_back(rows == nullptr ? Bytes(size) : Bytes(rows, rows + size));
  });
  return slices;
}

inline std::vector<Bytes> read_images(const SliceSource& source) {
  return read_images(source, {0, 0, source.grid().width_px, source.grid().height_px});
}

using Entries = std::vector<std::pair<std::string, Bytes>>;

inline Entries unzip(const std::string& path) {
  Entries entries;
  zip_t* const zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
  EXPECT_NE(zip, nullptr) << path;
  for (zip_uint64_t i = 0;
       zip != nullptr && i < static_cast<zip_uint64_t>(zip_get_num_entries(zip, 0)); ++i) {
    zip_stat_t status;
    zip_stat_index(zip, i, 0, &status);
    Bytes data(status.size);
    zip_file_t* const file = zip_fopen_index(zip, i, 0);
    EXPECT_EQ(zip_fread(file, data.data(), data.size()), static_cast<zip_int64_t>(data.size()));
    zip_fclose(file);
    entries.emplace_back(status.name, std::move(data));
  }
  if (zip != nullptr) zip_discard(zip);
  return entries;
}

inline void make_zip(const std::string& path, const Entries& entries, bool deflate = false) {
  zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  ASSERT_NE(zip, nullptr);
  for (const auto& [name, data] : entries) {
    zip_source_t* const source = zip_source_buffer(zip, data.data(), data.size(), 0);
    const zip_int64_t index = zip_file_add(zip, name.c_str(), source, ZIP_FL_ENC_GUESS);
    ASSERT_GE(index, 0) << name;
    zip_set_file_compression(zip, static_cast<zip_uint64_t>(index),
                             deflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE, 0);
  }
  ASSERT_EQ(zip_close(zip), 0);
}

inline Bytes& entry(Entries& entries, const std::string& name) {
  for (auto& [n, data] : entries) {
    if (n == name) return data;
  }
  ADD_FAILURE() << "no entry " << name;
  return entries.front().second;
}

inline std::string reference_uvj() { return real_file("slices/uvj/reference.uvj"); }

}  // namespace slicecorr::test
