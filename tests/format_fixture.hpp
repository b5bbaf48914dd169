// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file format_fixture.hpp
/// Archives of other programs, made and looked at past the library.
#pragma once

#include <png.h>
#include <time.h>

#include <algorithm>
#include <string>
#include <vector>

#include "stack_fixture.hpp"

namespace slicecorr::test {

/// PNG of 8 bits by libpng: `format` is PNG_FORMAT_GRAY, _RGB or _RGBA. Rows use filters.
inline Bytes png_of(const Bytes& pixels, int width, int height, png_uint_32 format) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = format;
  png_alloc_size_t size = 0;
  EXPECT_TRUE(png_image_write_to_memory(&image, nullptr, &size, 0, pixels.data(), 0, nullptr));
  Bytes png(size);
  EXPECT_TRUE(png_image_write_to_memory(&image, png.data(), &size, 0, pixels.data(), 0, nullptr));
  png.resize(size);
  return png;
}

struct Picture {
  int width = 0, height = 0;
  bool colour = false;
  Bytes rgb;
};
inline Picture picture_of(const Bytes& png) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_memory(&image, png.data(), png.size()));
  Picture p{static_cast<int>(image.width),
            static_cast<int>(image.height),
            (image.format & PNG_FORMAT_FLAG_COLOR) != 0,
            {}};
  image.format = PNG_FORMAT_RGB;
  p.rgb.resize(PNG_IMAGE_SIZE(image));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, p.rgb.data(), 0, nullptr));
  return p;
}

/// Three neighbouring grey pixels as one RGB pixel; the row's end is black.
inline Bytes packed_png(const Bytes& grey, int width, int height, bool blue_first) {
  const int wide = (width + 2) / 3;
  Bytes rgb(static_cast<std::size_t>(3 * wide * height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int channel = blue_first ? 2 - x % 3 : x % 3;
      rgb[static_cast<std::size_t>(3 * (y * wide + x / 3) + channel)] =
          grey[static_cast<std::size_t>(y * width + x)];
    }
  }
  return png_of(rgb, wide, height, PNG_FORMAT_RGB);
}

/// An entry as it lies in a zip.
struct RawEntry {
  std::string name, comment;
  Bytes packed;
  time_t time = 0;
  int method = 0;
  bool operator==(const RawEntry&) const = default;
};

inline std::vector<RawEntry> raw_entries(const std::string& path) {
  std::vector<RawEntry> entries;
  zip_t* const zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
  EXPECT_NE(zip, nullptr) << path;
  if (zip == nullptr) return entries;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(zip_get_num_entries(zip, 0)); ++i) {
    zip_stat_t status;
    zip_stat_index(zip, i, 0, &status);
    RawEntry e{status.name, "", Bytes(status.comp_size), status.mtime, status.comp_method};
    zip_uint32_t length = 0;
    if (const char* const text = zip_file_get_comment(zip, i, &length, 0)) {
      e.comment.assign(text, length);
    }
    zip_file_t* const file = zip_fopen_index(zip, i, ZIP_FL_COMPRESSED);
    EXPECT_EQ(zip_fread(file, e.packed.data(), e.packed.size()),
              static_cast<zip_int64_t>(e.packed.size()));
    zip_fclose(file);
    entries.push_back(std::move(e));
  }
  zip_discard(zip);
  return entries;
}

/// A zip whose entries have times, comments and compressions that are not ours.
inline void make_foreign_zip(const std::string& path, const Entries& entries) {
  zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  ASSERT_NE(zip, nullptr);
  for (const auto& [name, data] : entries) {
    zip_source_t* const source = zip_source_buffer(zip, data.data(), data.size(), 0);
    const zip_int64_t index = zip_file_add(zip, name.c_str(), source, 0);
    ASSERT_GE(index, 0) << name;
    const auto i = static_cast<zip_uint64_t>(index);
    zip_set_file_compression(zip, i, i % 2 == 0 ? ZIP_CM_DEFLATE : ZIP_CM_STORE, 9);
    zip_file_set_mtime(zip, i, 1400000000 + static_cast<time_t>(100 * i), 0);
    const std::string comment = "comment of " + name;
    zip_file_set_comment(zip, i, comment.c_str(), static_cast<zip_uint16_t>(comment.size()), 0);
  }
  ASSERT_EQ(zip_close(zip), 0);
}

inline void write_file_as(const StackFile& file, const Images& images, const StackInfo& info,
                          const ExecutionContext& context = {}) {
  const Grid& grid = images.grid;
  StackWriter writer(file, grid, context);
  StackWriter::BandEncoder encoder(writer, 0, grid.height_px);
  for (int n = 0; n < grid.layers; ++n) {
    encoder.put(n, 0, grid.width_px, images.slices[static_cast<std::size_t>(n)].data());
  }
  writer.finish(info, {2, 1, {7, 9}});
}

/// Collects what a context is told.
struct Told {
  std::vector<std::string> texts;
  ExecutionContext context() {
    ExecutionContext context;
    context.notice = [this](const std::string& text) { texts.push_back(text); };
    return context;
  }
  std::string all() const {
    std::string list;
    for (const std::string& t : texts) list += t + "\n";
    return list;
  }
};

inline void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, text.npos) << from;
  text.replace(at, from.size(), to);
}

/// slice.conf and G-code as NovaMaker writes them.
inline std::string nova_config(int width, int height, int layers) {
  return "# nova3d.cn NovaMaker v2.4.4 64-bits 2021-12-14 16:24:42\n# conf version 1.0\n\n"
         "xppm                    = 20\nyppm                    = 20\nxres                    = " +
         std::to_string(width) + "\nyres                    = " + std::to_string(height) +
         "\nthickness               = 0.050\nlayers_num              = " + std::to_string(layers) +
         "\nhead_layers_num         = 1\nlayers_expo_ms          = 2000\n"
         "head_layers_expo_ms     = 30000\nwait_before_expo_ms     = 2000\n";
}

inline std::string nova_layer(int n, int ms) {
  return ";<Slice> " + std::to_string(n) + "\nM106 S255\n;<Delay> " + std::to_string(ms) +
         "\nM106 S0\n;<Slice> Blank\nG1 Z4.000 F100\nG1 Z-3.950 F100\n;<Delay> 6800\n\n";
}

inline constexpr const char* kNovaEnd = "M18 ;Disable Motors\nM106 SO\nG1 Z80.0\n;<Completed>\n";

inline std::string nova_gcode(int width, int height, const std::vector<int>& ms) {
  std::string text =
      "; nova3d.cn NovaMaker v2.4.4 64-bits 2021-12-14 16:24:42\n"
      ";(****Build and Slicing Parameters****)\n;(Pix per mm X            = 20 )\n"
      ";(Pix per mm Y            = 20 )\n;(X Resolution            = " +
      std::to_string(width) + " )\n;(Y Resolution            = " + std::to_string(height) +
      " )\n;(Layer Thickness         = 0.05000 mm )\n;(Layer Time              = 2000 ms )\n"
      ";(Render Outlines         = False\n;(Bottom Layers Time      = 30000 ms )\n"
      ";(Number of Bottom Layers = 1 )\n;(Flip X                  = True)\n"
      ";(Flip Y                  = False)\n;Number of Slices         = " +
      std::to_string(ms.size()) +
      "\n;(****Machine Configuration ******)  \n;(Machine Type            = UV_LCD)  \n\n"
      "G28\nG21 ;Set units to be mm\nG91 ;Relative Positioning\nM17 ;Enable motors\n"
      "<Slice> Blank\nM106 S0\n\n";
  for (std::size_t n = 0; n < ms.size(); ++n) text += nova_layer(static_cast<int>(n), ms[n]);
  return text + kNovaEnd;
}

}  // namespace slicecorr::test
