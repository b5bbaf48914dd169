// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Print files beside a second reader, which was written after the published layouts and shares nothing with
// the library (print_files.py): what the library reads of real files is what that one reads, and what the
// programs write is what that one reads back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "newer_print_file_fixture.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/formats/exposure_pattern.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;

/// Debian's interpreter; the reader needs nothing but its own modules.
constexpr const char* kPython = "/usr/bin/python3";
/// By day so many layers of large files are compared that they have 3e7 pixels, which the second
/// reader takes a second for; at night all of them.
int step_of(const Grid& g) {
  const double pixels = 1.0 * g.width_px * g.height_px * g.layers;
  return rounds(1) > 1 ? 1 : static_cast<int>(std::ceil(pixels / 3e7));
}

/// What the second reader says of a file and of every `step`th of its layers.
json second_reader(const std::string& path, int layers, int step) {
  std::vector<std::string> command{kPython, SLICECORR_SOURCE_DIR "/tests/print_files.py", path};
  for (int n = 0; n < layers; n += step) command.push_back(std::to_string(n));
  RunOptions options;
  options.timeout = std::chrono::minutes(20);
  const RunResult r = run_program(command, options);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  return r.exit_code == 0 ? json::parse(r.out) : json();
}

/// CRC-32 of the pixels of every `step`th layer, as the library reads them.
std::map<int, std::uint32_t> checksums(const StackReader& stack, int step) {
  const Grid& g = stack.grid();
  const auto pixels = static_cast<std::size_t>(g.width_px) * static_cast<std::size_t>(g.height_px);
  Bytes slice(pixels);
  std::map<int, std::uint32_t> sums;
  for (int n = 0; n < g.layers; n += step) {
    stack.read_slice(n, slice.data());
    sums[n] = static_cast<std::uint32_t>(::crc32(0, slice.data(), static_cast<uInt>(pixels)));
  }
  return sums;
}

/// All that both readers tell, of the same file; what the second one said to `told`.
void expect_same(const std::string& path, json* told = nullptr) {
  SCOPED_TRACE(path);
  const StackReader stack(path, std::filesystem::path(path).parent_path().string());
  const StackInfo& info = stack.info();
  const Grid& g = stack.grid();
  const int step = step_of(g);
  const json second = second_reader(path, g.layers, step);
  if (told) *told = second;
  ASSERT_TRUE(second.is_object());
  EXPECT_EQ(second["format"], info.format);
  EXPECT_EQ(second["size"], json({g.width_px, g.height_px}));
  EXPECT_EQ(second["count"], g.layers);
  // Single precision in the files, four decimals in what the second one prints.
  EXPECT_NEAR(second["exposure_s"].get<double>(), info.exposure_s, 6e-5);
  EXPECT_NEAR(second["bottom_s"].get<double>(), info.bottom_exposure_s, 6e-5);
  EXPECT_EQ(second["bottom_layers"], info.bottom_layers);
  ASSERT_EQ(second["times"].size(), static_cast<std::size_t>(g.layers));
  for (int n = 0; n < g.layers; ++n) {
    const auto i = static_cast<std::size_t>(n);
    const double time_s = detail::light_on_of_layer(info, n);
    ASSERT_NEAR(second["times"][i].get<double>(), time_s, 1e-4 + 1e-3 * time_s) << n;
    const double z_um = 1e3 * second["heights"][i].get<double>();
    ASSERT_NEAR(z_um, (n + 1) * g.layer_um, 1 + 1e-3 * z_um) << n;
  }
  if (second.contains("bed")) {
    EXPECT_NEAR(second["bed"][0].get<double>(), g.width_px * g.pixel_x_um * 1e-3, 1e-3);
    EXPECT_NEAR(second["bed"][1].get<double>(), g.height_px * g.pixel_y_um * 1e-3, 1e-3);
  }
  if (second.contains("mirror")) {
    EXPECT_EQ(second["mirror"],
              json({int{info.orientation.mirror_x}, int{info.orientation.mirror_y}}));
  }
  const auto first = checksums(stack, step);
  ASSERT_EQ(second["layers"].size(), first.size());
  for (const auto& [n, sum] : first) {
    ASSERT_EQ(second["layers"][std::to_string(n)].get<std::uint32_t>(), sum) << "layer " << n;
  }
}

class PrintFilesPython : public testing::TestWithParam<const char*> {
 protected:
  /// The real file, unpacked; empty where it is not there.
  std::string original() const {
    const std::string name = GetParam();
    const Bytes bytes = real_print_file(name);
    if (bytes.empty()) return {};
    std::string path = folder_ / name;
    if (path.ends_with(".gz")) path.resize(path.size() - 3);
    write_file(path, bytes);
    return path;
  }
  void good(std::vector<std::string> command) const {
    command.insert(command.begin(), {SLICECORR_BIN_DIR "/slicecorr", "--quiet"});
    RunOptions options;
    options.timeout = std::chrono::minutes(20);
    const RunResult r = run_program(command, options);
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  /// As it is; its pixels in new files, and back into the first as a template, which gives the first.
  void write_and_read_back() const {
    const std::string file = original();
    if (file.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + GetParam()));
    json before, made;
    expect_same(file, &before);
    const std::string goo = folder_ / "made.goo", ctb = folder_ / "made.ctb",
                      back = folder_ / ("back" + std::filesystem::path(file).extension().string());
    good({"convert", file, "-o", goo});
    expect_same(goo, &made);
    for (const char* key :
         {"size", "count", "layers", "times", "exposure_s", "bottom_s", "bottom_layers"}) {
      EXPECT_EQ(made[key], before[key]) << key;
    }
    good({"convert", goo, "-o", ctb});
    expect_same(ctb);
    good({"convert", goo, "-o", back, "--template", file});
    EXPECT_TRUE(read_file(back) == read_file(file)) << "other bytes";
  }
  TemporaryFolder folder_;
};
// What is written and read back below, by day or at night, is read there, too.
INSTANTIATE_TEST_SUITE_P(Real, PrintFilesPython,
                         testing::Values("msla_saturn.v4.ctb", "msla_mars4max.goo.gz",
                                         "msla_photon_mono_x.v516.pwmx.gz"),
                         [](const auto& info) { return name_of(info.param); });

TEST_P(PrintFilesPython, BothReadTheSame) {
  const std::string file = original();
  if (file.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + GetParam()));
  expect_same(file);
}

using PrintFilesPythonWritten = PrintFilesPython;
INSTANTIATE_TEST_SUITE_P(Real, PrintFilesPythonWritten,
                         testing::Values("mariner_pyramid.v3.ctb", "msla_photon_mono.v515.pwmo.gz"),
                         [](const auto& info) { return name_of(info.param); });
TEST_P(PrintFilesPythonWritten, AreReadBack) { write_and_read_back(); }

using PrintFilesPythonNight = PrintFilesPython;
INSTANTIATE_TEST_SUITE_P(Real, PrintFilesPythonNight,
                         testing::Values("msla_saturn.v4.ctb", "msla_mars4max.goo.gz",
                                         "msla_photon_mono_x.v516.pwmx.gz",
                                         "msla_photon_mono_4k.v516.pwma.gz",
                                         "msla_photon_m3.v516.pm3.gz"),
                         [](const auto& info) { return name_of(info.param); });
TEST_P(PrintFilesPythonNight, LargeOnesAreReadBack) { write_and_read_back(); }

TEST(PrintFilesPythonToo, SmallOnesWithAllLevels) {
  const TemporaryFolder folder;
  for (const SmallFile& small :
       {small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0)),
        small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false)),
        small_workshop(false)}) {
    write_file(folder / small.name, small.bytes);
    json second;
    expect_same(folder / small.name, &second);
    // Its pixels are those that were meant.
    for (std::size_t n = 0; n < small.slices.size(); ++n) {
      const Bytes& slice = small.slices[n];
      EXPECT_EQ(second["layers"][std::to_string(n)].get<std::uint32_t>(),
                ::crc32(0, slice.data(), static_cast<uInt>(slice.size())));
    }
  }
}

/// What is changed in files of newer printers is right everywhere that they say it: layers that are added and
/// taken away, other times, pixels.
TEST(PrintFilesPythonToo, NewerOnesAreChangedAndReadBack) {
  const TemporaryFolder folder;
  for (const SmallFile& small : {small_anycubic_zip(), small_cxdlp4(0), small_cxdlp4(0x1234567),
                                 small_workshop_518(), small_ctb5()}) {
    SCOPED_TRACE(small.name);
    const std::string path = folder / small.name, out = folder / ("out_" + small.name);
    write_file(path, small.bytes);
    json before;
    expect_same(path, &before);
    for (std::size_t n = 0; n < small.slices.size(); ++n) {
      const Bytes& slice = small.slices[n];
      EXPECT_EQ(before["layers"][std::to_string(n)].get<std::uint32_t>(),
                ::crc32(0, slice.data(), static_cast<uInt>(slice.size())));
    }
    const StackReader stack(path, folder.path());
    for (const int layers : {kFileLayers - 1, kFileLayers + 2}) {
      Images images{stack.grid(), small.slices};
      images.grid.layers = layers;
      images.slices[1][77] = images.slices[1][77] > 0 ? 0 : 255;
      images.slices.resize(static_cast<std::size_t>(layers), images.slices.back());
      StackInfo info = stack.info();
      info.grid.layers = info.target_layers = layers;
      info.exposure_s = 3;
      info.bottom_exposure_s = 50;
      info.bottom_layers = 2;
      StackFile file(out);
      file.format = small.format;
      file.keep_from = path;
      write_stack(file, images, info);
      json after;
      expect_same(out, &after);
      EXPECT_EQ(after["count"], layers);
      EXPECT_EQ(after["exposure_s"], 3);
      EXPECT_EQ(after["bottom_s"], 50);
      EXPECT_EQ(after["bottom_layers"], 2);
      EXPECT_NE(after["layers"]["1"], before["layers"]["1"]);
      EXPECT_EQ(after["layers"]["0"], before["layers"]["0"]);
      if (before.contains("print_time_s")) {
        // 500 s were 40 s and three times 2.5 s of light, the rest lies between layers.
        const double dark_s = (500 - 47.5) / 4;
        EXPECT_NEAR(after["print_time_s"].get<double>(), 100 + 3 * (layers - 2) + dark_s * layers,
                    0.51);
      }
    }
  }
}

// A correction in place: ciphered layers, longer than before, and times of their own.
TEST(PrintFilesPythonToo, ACorrectedFileIsReadBack) {
  const Bytes bytes = real_print_file("mariner_pyramid.v3.ctb");
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file("slices/binary/mariner_pyramid.v3.ctb"));
  const TemporaryFolder folder;
  write_file(folder / "part.ctb", bytes);
  write_file(
      folder / "mars.toml",
      to_bytes("name = \"mars\"\n[display]\nwidth_px = 1440\nheight_px = 2560\npixel_um = "
               "47.25\nmirror = \"x\"\n[blue]\nwavelength_nm = 405\ncalibration = [[0, 0.01], "
               "[255, 3.0]]\n"));
  RunOptions options;
  options.environment = {{"SLICECORR_DB", SLICECORR_DB_DIR}};
  const RunResult r = run_program({SLICECORR_BIN_DIR "/slicecorr",
                                   "--quiet",
                                   "correct",
                                   folder / "part.ctb",
                                   "-o",
                                   folder / "corrected.ctb",
                                   "--printer",
                                   folder / "mars.toml",
                                   "--resin",
                                   "liqcreate-strong-x-405nm",
                                   "--mode",
                                   "layerwise",
                                   "--lifts",
                                   "none",
                                   "--exposure-s",
                                   "30",
                                   "--bottom-layers",
                                   "3",
                                   "--bottom-exposure-s",
                                   "60"},
                                  options);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  json before, after;
  expect_same(folder / "part.ctb", &before);
  expect_same(folder / "corrected.ctb", &after);
  EXPECT_NE(before["layers"], after["layers"]);
  EXPECT_EQ(after["exposure_s"], 30);
  EXPECT_EQ(after["bottom_s"], 60);
  EXPECT_EQ(after["bottom_layers"], 3);
  for (const char* key : {"version", "size", "count", "bed", "heights"}) {
    EXPECT_EQ(before[key], after[key]) << key;
  }
}

}  // namespace
}  // namespace slicecorr::test
