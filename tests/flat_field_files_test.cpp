// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Files that say how uneven a display is: keys, pictures, and real ones through the programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "flat_fields.hpp"
#include "ladder.hpp"
#include "real_files.hpp"
#include "run_program.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test::flat {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class FlatFieldFiles : public FlatFieldTest {
 protected:
  void write(const std::string& name, const std::vector<std::uint8_t>& data) const {
    std::ofstream(path(name), std::ios::binary)
        .write(reinterpret_cast<const char*>(data.data()),
               static_cast<std::streamsize>(data.size()));
  }
  /// A printer of 128 x 80 pixels with these keys in [display].
  std::string printer(const std::string& keys) const {
    std::ofstream(path("p.toml")) << "name = \"p\"\n[display]\nwidth_px = 128\nheight_px = 80\n"
                                     "pixel_um = 50\n"
                                  << keys << "[blue]\ncalibration = [[0, 1], [255, 100]]\n";
    return path("p.toml");
  }
};

TEST_F(FlatFieldFiles, KeysAreRead) {
  write("even.png", encode_png(GreyImage{2, 1, {128, 240}}));
  const Printer p = load_printer(printer("flat_field = \"even.png\"\nmirror = \"xy\"\n"));
  ASSERT_TRUE(p.flat_field);
  EXPECT_EQ(p.flat_field->reference, 240);
  EXPECT_FALSE(p.flat_field->of_plate);
  EXPECT_EQ(*p.flat_field->values, (Values{128, 240}));
  EXPECT_EQ(*p.orientation, (Orientation{false, true, true}));
  const Printer q = load_printer(printer(
      "flat_field = \"even.png\"\nflat_field_reference = 255\nflat_field_frame = \"plate\"\n"
      "orientation = \"landscape\"\n"));
  EXPECT_EQ(q.flat_field->reference, 255);
  EXPECT_TRUE(q.flat_field->of_plate);
  EXPECT_EQ(*q.orientation, Orientation{});
  EXPECT_EQ(light_in_words(q), "50.2 to 94.1 % of the calibration");
  EXPECT_FALSE(load_printer(printer("")).flat_field);
  EXPECT_FALSE(load_printer(printer("")).orientation);
  EXPECT_EQ(*load_printer(printer("mirror = true\n")).orientation,
            (Orientation{false, true, false}));
  // Also where the file comes as a text.
  SetupChoices c;
  c.printer_toml = "[display]\nwidth_px = 128\nheight_px = 80\npixel_um = 50\nflat_field = \"" +
                   path("even.png") + "\"\n[blue]\ncalibration = [[0, 1], [255, 100]]\n";
  c.resin = SLICECORR_DB_DIR "/benchy-resin.toml";
  c.speed_mm_h = 800;
  EXPECT_TRUE(resolve_setup(c, nullptr, nullptr, ChoiceNames::fields).printer.flat_field);
}

TEST_F(FlatFieldFiles, BadOnesAreRefusedWithFileAndKey) {
  const auto said = [&](const std::string& keys) {
    return refusal([&] { load_printer(printer(keys)); });
  };
  const auto at_key = [&](int line, const std::string& key) {
    return HasSubstr(path("p.toml") + ": line " + std::to_string(line) + ": display." + key + ": ");
  };
  EXPECT_THAT(said("flat_field = \"gone.png\"\n"),
              AllOf(at_key(6, "flat_field"), HasSubstr("gone.png is not a file")));
  EXPECT_THAT(said("flat_field = 3\n"), AllOf(at_key(6, "flat_field"), HasSubstr("name of a PNG")));
  write("text.png", {'h', 'e', 'l', 'l', 'o'});
  EXPECT_THAT(said("flat_field = \"text.png\"\n"),
              AllOf(at_key(6, "flat_field"), HasSubstr("text.png: is no PNG image")));
  write("black.png", encode_png(GreyImage{4, 2, Values(8, 0)}));
  EXPECT_THAT(said("flat_field = \"black.png\"\n"),
              AllOf(at_key(6, "flat_field"), HasSubstr("is black")));
  auto cut = encode_png(GreyImage{64, 40, Values(64 * 40, 77)});
  cut.resize(cut.size() / 2);
  write("cut.png", cut);
  EXPECT_THAT(said("flat_field = \"cut.png\"\n"), at_key(6, "flat_field"));
  write("turned.png", encode_png(GreyImage{6, 10, Values(60, 200)}));
  EXPECT_THAT(said("flat_field = \"turned.png\"\n"),
              AllOf(at_key(6, "flat_field"), HasSubstr("6 x 10 pixels"),
                    HasSubstr("shape of the display, 128 x 80")));
  // ... but it may cover a plate that lies turned in the display.
  EXPECT_TRUE(load_printer(printer("flat_field = \"turned.png\"\nflat_field_frame = \"plate\"\n"
                                   "orientation = \"portrait\"\n"))
                  .flat_field);
  write("square.png", encode_png(GreyImage{100, 100, Values(10000, 200)}));
  EXPECT_THAT(said("flat_field = \"square.png\"\n"), HasSubstr("100 x 100 pixels"));
  // More than any camera has, told by its header alone: the pixels are not there.
  auto large = encode_png(GreyImage{128, 80, Values(128 * 80, 77)});
  for (const auto& [at, size] : {std::pair{16, 16000}, {20, 10000}}) {
    for (int k = 0; k < 4; ++k) {
      large[static_cast<std::size_t>(at + k)] = static_cast<std::uint8_t>(size >> (24 - 8 * k));
    }
  }
  write("large.png", large);
  EXPECT_THAT(said("flat_field = \"large.png\"\n"),
              AllOf(at_key(6, "flat_field"), HasSubstr("16000 x 10000 pixels"),
                    HasSubstr("at most 100000000 of them for a display of 128 x 80")));
  write("coarse.png", encode_png(GreyImage{8, 8, Values(64, 200)}));
  EXPECT_TRUE(load_printer(printer("flat_field = \"coarse.png\"\n")).flat_field);
  const std::string good = "flat_field = \"coarse.png\"\n";
  EXPECT_THAT(said(good + "flat_field_frame = \"bed\"\n"), at_key(7, "flat_field_frame"));
  EXPECT_THAT(said(good + "flat_field_reference = 0\n"), at_key(7, "flat_field_reference"));
  EXPECT_THAT(said(good + "flat_field_reference = 256\n"), at_key(7, "flat_field_reference"));
  EXPECT_THAT(said("flat_field_frame = \"plate\"\n"), at_key(6, "flat_field_frame"));
  EXPECT_THAT(said("mirror = \"z\"\n"), at_key(6, "mirror"));
  EXPECT_THAT(said("orientation = \"upright\"\n"), at_key(6, "orientation"));
}

// Real flat-fields through the programs: import, then a part in one go.
TEST_F(FlatFieldFiles, RealOnesThroughThePrograms) {
  const fs::path data = test::real_file("projector");
  SLICECORR_NEEDS_FILE(data.string());
  const std::string bin = SLICECORR_BIN_DIR;
  RunOptions options;
  options.environment["SLICECORR_DB"] = folder_.string();
  options.folder = folder_.string();
  const auto ok = [&](std::vector<std::string> command) {
    const RunResult r = run_program(command, options);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r.out + r.err;
  };
  write_stl(path("ladder.stl"), ladder());
  struct Real {
    std::string file, format;
  };
  for (const Real& real : {Real{"nordin_graycorr_20241202-XU19030146.png", "correction-mask"},
                           Real{"sl1_uv_calibration_60pt.toml", "flat-field"}}) {
    ok({bin + "/resinctl", "import", (data / real.file).string(), "--format", real.format,
        "--printer", "dual-wavelength-dlp", "--name", "uneven", "--replace"});
    ok({bin + "/resinctl", "validate", path("uneven.toml")});
    const Printer printer = load_printer(path("uneven.toml"));
    ASSERT_TRUE(printer.flat_field);
    // The dimmest corner of the display, where the calibration is furthest off.
    ok({bin + "/slicecorr", "run", "ladder.stl", "-o", "l.uvj", "--printer", "uneven", "--resin",
        "benchy-resin", "--layer-um", "50", "--speed-mm-h", "800", "--center-mm", "3,3"});
    // Its light changes nothing of the target, nor of a correction for even light.
    if (!fs::exists(path("t.uvj"))) {
      ok({bin + "/slicecorr", "slice", "ladder.stl", "-o", "t.uvj", "--printer", "uneven",
          "--layer-um", "50", "--center-mm", "3,3"});
      ok({bin + "/slicecorr", "correct", "t.uvj", "-o", "e.uvj", "--printer", "dual-wavelength-dlp",
          "--resin", "benchy-resin", "--speed-mm-h", "800"});
    }
    const auto verified = nlohmann::json::parse(
        ok({bin + "/slicecorr", "verify", "l.uvj", "--target", "t.uvj", "--json", "-", "--quiet"}));
    const auto promised = nlohmann::json::parse(bytes(path("l.json")));
    EXPECT_EQ(verified["height_error_um"], promised["height_error_um"]);
    EXPECT_EQ(verified["undercure_voxels"], 0);
    EXPECT_EQ(verified["cure_through_voxels"], 0);
    EXPECT_LT(verified["height_error_um"]["mean_abs"], 2.5);
    // Corrected for even light, the same part comes out worse by what ha log10 f says.
    const auto unaware =
        nlohmann::json::parse(ok({bin + "/slicecorr", "verify", "e.uvj", "--target", "t.uvj",
                                  "--printer", "uneven", "--json", "-", "--quiet"}));
    EXPECT_GT(unaware["height_error_um"]["max_abs"], 10);
    const std::string said = ok({bin + "/slicecorr", "info", "l.uvj"});
    EXPECT_THAT(said, HasSubstr("light"));
    EXPECT_THAT(bytes(path("l.html")), HasSubstr("\"light\":{\"factors\""));
  }
}

}  // namespace
}  // namespace slicecorr::test::flat
