// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file post_fixture.hpp
/// Exports as a slicer makes them, small, and slicecorr-post run on them.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <png.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "run_program.hpp"
#include "stack_fixture.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::test {

/// Full light of 100 mW/cm²: with a resin of 576 mJ/cm³ and 110 um, 0.07837 s just gel 50 um.
inline constexpr const char* kPostPrinter =
    "name = \"small\"\nmaker = \"Works\"\nproduct = \"Small One\"\n[display]\nwidth_px = 160\n"
    "height_px = 120\npixel_um = 50.0\n[blue]\nwavelength_nm = 405\n"
    "calibration = [[0, 1.0], [255, 100.0]]\n[stage]\ntravel_mm = 100\nmax_speed_mm_h = 2000\n";
inline const Command kSmall{"--printer", "small.toml", "--resin", "figure-2-2", "--ha-um", "110"};

/// The name of a folder that a correction leaves that is killed.
inline std::string work_folder_of_the_dead() {
  detail::Maker maker = detail::this_process();
  ++maker.started;
  return std::string(detail::kWorkFolder) + detail::text_of(maker) + "-Ab12cD";
}

struct Sl1Options {
  int width_px = 160, height_px = 120, layers = 50;
  double pixel_um = 50;
  double exposure_s = 0.1, first_s = 0.2;
  int fade = 4;
  std::string printer_profile = "Works Small One", material = "Figure 2-2";
  std::string stamp = "2024-05-01 at 12:00:00 UTC";
  int seed = 0;  ///< another part for each
};

/// The ladder's rails and rungs over the middle of the image, slice by slice; grey at one edge.
inline GreyImage ladder_slice(const Sl1Options& o, int layer) {
  GreyImage image{o.width_px, o.height_px, {}};
  image.pixels.resize(static_cast<std::size_t>(o.width_px * o.height_px));
  const bool rung = (layer >= 11 && layer < 21) || (layer >= 31 && layer < 41);
  for (int y = o.height_px / 3; y < o.height_px / 2 + o.seed; ++y) {
    for (int x = o.width_px / 4; x < o.width_px * 3 / 4; ++x) {
      const bool rail = x < o.width_px / 3 || x >= o.width_px * 2 / 3;
      if (!rail && !rung) continue;
      image.pixels[static_cast<std::size_t>(y * o.width_px + x)] =
          static_cast<std::uint8_t>(y == o.height_px / 3 ? 100 : 255);
    }
  }
  return image;
}

/// What PrusaSlicer 2.5 puts into an SL1 archive, as far as anyone reads it.
inline void make_sl1(const std::string& path, const Sl1Options& o = {}) {
  Entries entries;
  const std::string job = std::filesystem::path(path).stem().string();
  entries.emplace_back(
      "config.ini",
      to_bytes(fmt::format("action = print\nexpTime = {}\nexpTimeFirst = {}\n"
                           "fileCreationTimestamp = {}\njobDir = {}\nlayerHeight = 0.05\n"
                           "materialName = {}\nnumFade = {}\nnumFast = {}\nnumSlow = 0\n"
                           "printProfile = 0.05 Normal\nprinterModel = SL1\nprinterProfile = {}\n",
                           o.exposure_s, o.first_s, o.stamp, job, o.material, o.fade, o.layers,
                           o.printer_profile)));
  entries.emplace_back(
      "prusaslicer.ini",
      to_bytes(fmt::format("display_height = {}\ndisplay_width = {}\ndisplay_mirror_x = 0\n"
                           "display_mirror_y = 0\ndisplay_orientation = landscape\n"
                           "display_pixels_x = {}\ndisplay_pixels_y = {}\nlayer_height = 0.05\n"
                           "initial_layer_height = 0.05\n",
                           o.height_px * o.pixel_um * 1e-3, o.width_px * o.pixel_um * 1e-3,
                           o.width_px, o.height_px)));
  entries.emplace_back("thumbnail/thumbnail400x400.png", encode_png(GreyImage{2, 1, {7, 9}}));
  entries.emplace_back("notes of someone else.bin", Bytes{0, 1, 2, 255});
  for (int n = 0; n < o.layers; ++n) {
    entries.emplace_back(fmt::format("{}{:05}.png", job, n), encode_png(ladder_slice(o, n)));
  }
  make_zip(path, entries, true);
}

/// Decoded by libpng, past our code.
inline GreyImage png_pixels(const Bytes& png) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0);
  EXPECT_EQ(image.format, static_cast<png_uint_32>(PNG_FORMAT_GRAY)) << "8-bit grey as before";
  image.format = PNG_FORMAT_GRAY;
  GreyImage out{static_cast<int>(image.width), static_cast<int>(image.height), {}};
  out.pixels.resize(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, out.pixels.data(), 0, nullptr), 0);
  return out;
}

/// A name ends like the image of a slice.
inline bool is_layer_image(const std::string& name) {
  return name.size() > 9 && name.ends_with(".png") && name.find('/') == std::string::npos &&
         name.find_first_not_of("0123456789", name.size() - 9) == name.size() - 4;
}

/// A folder with the small printer in it, where slicecorr-post is run.
class PostFolder : public ::testing::Test {
 protected:
  PostFolder() {
    options_.folder = folder_.path();
    options_.environment = {{"SLICECORR_DB", folder_ / "db"},
                            {"HOME", folder_.path()},
                            {"XDG_CONFIG_HOME", folder_ / "config"},
                            {"SLIC3R_PP_OUTPUT_NAME", ""},
                            {"SLIC3R_PP_HOST", ""}};
    std::filesystem::create_directories(folder_ / "db/printers");
    std::filesystem::create_directories(folder_ / "config/slicecorr");
    std::filesystem::copy(SLICECORR_DB_DIR, folder_ / "db",
                          std::filesystem::copy_options::recursive);
    write("db/printers/small.toml", kPostPrinter);
    write("small.toml", kPostPrinter);
  }
  RunResult post(const Command& arguments) const { return post(arguments, options_); }
  RunResult post(const Command& arguments, const RunOptions& options) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr-post"} + arguments, options);
  }
  RunResult good(const Command& arguments) const {
    RunResult r = post(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r;
  }
  void write(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
  }
  Bytes bytes(const std::string& name) const { return read_file(folder_ / name); }
  std::string text(const std::string& name) const { return to_text(bytes(name)); }
  bool there(const std::string& name) const {
    return std::filesystem::exists(std::filesystem::symlink_status(folder_ / name));
  }
  /// Names in the folder, hidden ones too.
  std::vector<std::string> names(const std::string& below = "") const {
    std::vector<std::string> all;
    for (const auto& e : std::filesystem::directory_iterator(folder_ / below)) {
      all.push_back(e.path().filename().string());
    }
    std::sort(all.begin(), all.end());
    return all;
  }

  TemporaryFolder folder_;
  RunOptions options_;
};

}  // namespace slicecorr::test
