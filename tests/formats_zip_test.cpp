// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Zip archives of Chitubox, CWS, NanoDLP and of images alone: new ones read back, packed images,
// real archives.

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "format_fixture.hpp"
#include "models.hpp"
#include "real_files.hpp"
#include "rounds.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

// ---- New archives

struct NewCase {
  const char* format;
  const char* file;
  bool exposures, layer_times;  ///< whether it holds them
};

class NewArchive : public ::testing::TestWithParam<NewCase> {
 protected:
  TemporaryFolder folder_;
  std::string path_ = folder_ / GetParam().file;
  StackFile file() const {
    StackFile f(path_);
    f.format = GetParam().format;
    return f;
  }
  /// As another program would have written it: without our block.
  StackInfo read_as_foreign() const {
    Entries entries = unzip(path_);
    std::erase_if(entries, [](const auto& e) { return e.first == "slicecorr.json"; });
    const std::string other = folder_ / ("foreign-" + std::string(GetParam().file));
    make_zip(other, entries, true);
    return StackReader::read_info(other);
  }
};

INSTANTIATE_TEST_SUITE_P(Formats, NewArchive,
                         ::testing::Values(NewCase{"chitubox", "part.zip", true, true},
                                           NewCase{"generic", "part.zip", false, false},
                                           NewCase{"cws", "part.cws", true, true},
                                           NewCase{"rgb-cws", "part.rgb.cws", true, true},
                                           NewCase{"nanodlp", "part.nanodlp", true, true},
                                           NewCase{"rgb-nanodlp", "part.rgb.nanodlp", true, true}),
                         [](const auto& c) {
                           std::string name = c.param.format;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

StackInfo timed_info(const Grid& grid) {
  StackInfo info = info_of(grid);
  info.exposure_s = 2.5;
  info.bottom_exposure_s = 12;
  info.bottom_layers = 2;
  return info;
}

void expect_same_grid(const Grid& a, const Grid& b) {
  EXPECT_EQ(a.width_px, b.width_px);
  EXPECT_EQ(a.height_px, b.height_px);
  EXPECT_EQ(a.layers, b.layers);
  // Nanometres of a display a metre wide, over its pixels.
  EXPECT_NEAR(a.pixel_x_um, b.pixel_x_um, 1e-3);
  EXPECT_NEAR(a.pixel_y_um, b.pixel_y_um, 1e-3);
  EXPECT_NEAR(a.layer_um, b.layer_um, 1e-3);
}

TEST_P(NewArchive, IsReadBack) {
  Images images = random_images(36, 21, 7, 5);
  StackInfo info = timed_info(images.grid);
  info.part_volume_mm3 = 1.25;
  write_file_as(file(), images, info);
  const StackReader reader(path_, folder_.path());
  EXPECT_EQ(read_images(reader), images.slices);
  const StackInfo& read = reader.info();
  EXPECT_EQ(read.format, GetParam().format);
  EXPECT_EQ(read.kind, StackKind::target);
  EXPECT_EQ(read.program, info.program);
  EXPECT_EQ(read.part_volume_mm3, info.part_volume_mm3);
  expect_same_grid(read.grid, images.grid);
  if (GetParam().exposures) {
    EXPECT_EQ(read.exposure_s, 2.5);
    EXPECT_EQ(read.bottom_exposure_s, 12);
    EXPECT_EQ(read.bottom_layers, 2);
  }
}

TEST_P(NewArchive, SaysAllWithoutOurBlock) {
  const Images images = random_images(36, 21, 7, 6);
  StackInfo info = timed_info(images.grid);
  info.orientation.mirror_x = true;
  info.profiles.material = "Clear";
  write_file_as(file(), images, info);
  const StackInfo read = read_as_foreign();
  EXPECT_EQ(read.format, GetParam().format);
  EXPECT_EQ(read.kind, StackKind::foreign);
  EXPECT_EQ(read.target_layers, 7);
  expect_same_grid(read.grid, images.grid);
  EXPECT_TRUE(read.layer_exposure_s.empty());
  EXPECT_EQ(read.fade_layers, 0);
  EXPECT_EQ(read.exposure_s, GetParam().exposures ? 2.5 : 0);
  EXPECT_EQ(read.bottom_exposure_s, GetParam().exposures ? 12 : 0);
  EXPECT_EQ(read.bottom_layers, GetParam().exposures ? 2 : 0);
  if (!GetParam().exposures) return;
  EXPECT_TRUE(read.orientation.mirror_x);
  if (std::string_view(GetParam().format).find("cws") == std::string_view::npos) {
    EXPECT_EQ(read.profiles.material, "Clear");
  }
}

TEST_P(NewArchive, HoldsFadingLayers) {
  const Images images = random_images(6, 5, 9, 7);
  StackInfo info = timed_info(images.grid);
  info.fade_layers = 3;
  write_file_as(file(), images, info);
  const StackInfo read = read_as_foreign();
  if (!GetParam().exposures) return;
  EXPECT_EQ(read.exposure_s, 2.5);
  EXPECT_EQ(read.bottom_layers, 2);
  EXPECT_EQ(read.fade_layers, 3);
  EXPECT_TRUE(read.layer_exposure_s.empty());
}

TEST_P(NewArchive, HoldsOrTellsTimesOfLayers) {
  const Images images = random_images(6, 5, 4, 8);
  StackInfo info = info_of(images.grid);
  info.exposure_s = 3;
  info.layer_exposure_s = {3, 4.5, 0.25, 3};
  Told told;
  write_file_as(file(), images, info, told.context());
  const StackInfo read = read_as_foreign();
  const std::string_view format = GetParam().format;
  const bool gcode = format == "chitubox" || format.ends_with("cws");
  if (GetParam().layer_times) {
    EXPECT_EQ(read.layer_exposure_s, info.layer_exposure_s);
    EXPECT_THAT(told.all(),
                gcode ? HasSubstr("archives says 3 s for all layers: times of single layers are in "
                                  "the G-code, which printers run")
                      : HasSubstr(""));
    EXPECT_EQ(told.all().empty(), !gcode) << told.all();
  } else {
    EXPECT_TRUE(read.layer_exposure_s.empty());
    EXPECT_THAT(told.all(), HasSubstr("holds no exposure times: set 3 s at the printer, which "
                                      "can't show layers for different times"));
  }
}

// What of a list a head has words for is in it: printers and people go by it, too.
TEST_P(NewArchive, HeadsSayTheFirstLayersOfAList) {
  const Images images = random_images(6, 5, 8, 8);
  const std::vector<double> list{12, 12, 10, 4, 2.5, 2.5, 2.5, 2.5};
  StackInfo plain = info_of(images.grid);
  plain.exposure_s = 2.5;
  plain.layer_exposure_s = list;
  // Of a corrected stack the process has the list.
  StackInfo corrected = plain;
  corrected.layer_exposure_s.clear();
  corrected.kind = StackKind::corrected;
  corrected.printer = linear_printer(1, 100);
  corrected.printer->width_px = 6;
  corrected.printer->height_px = 5;
  corrected.printer->pixel_x_um = images.grid.pixel_x_um;
  corrected.printer->pixel_y_um = images.grid.pixel_y_um;
  corrected.resin = resin(576, 2000);
  corrected.process = process_of_times(plain);
  if (!GetParam().layer_times) return;
  for (const StackInfo& info : {plain, corrected}) {
    Told told;
    write_file_as(file(), images, info, told.context());
    const StackInfo read = read_as_foreign();
    EXPECT_EQ(read.layer_exposure_s, list);
    EXPECT_EQ(read.exposure_s, 2.5);
    EXPECT_EQ(read.bottom_exposure_s, 12);
    EXPECT_EQ(read.bottom_layers, 2);
    const std::string_view format = GetParam().format;
    if (format != "chitubox" && format != "cws") continue;
    EXPECT_THAT(
        told.all(),
        HasSubstr("archives says 12 s for the first 2 layers, and 2.5 s for all layers after "
                  "them: times of single layers are in the G-code"));
    Entries entries = unzip(path_);
    const std::string text = to_text(entry(entries, format == "cws" ? "slice.conf" : "run.gcode"));
    const std::vector<const char*> of_cws{"head_layers_num         = 2\n",
                                          "head_layers_expo_ms     = 12000\n",
                                          "layers_expo_ms          = 2500\n"},
        of_chitubox{";bottomLayerCount:2\n", ";bottomLayerExposureTime:12\n", ";bottomLayCount:2\n",
                    ";normalExposureTime:2.5\n"};
    for (const char* line : format == "cws" ? of_cws : of_chitubox) {
      EXPECT_THAT(text, HasSubstr(line));
    }
  }
}

TEST_P(NewArchive, TellsThatItKnowsNoMovingPlatform) {
  const Images images = random_images(6, 5, 4, 9);
  StackInfo info = info_of(images.grid);
  info.kind = StackKind::corrected;
  info.printer.emplace();
  info.printer->name = "dlp";
  info.printer->width_px = 6;
  info.printer->height_px = 5;
  info.printer->pixel_x_um = info.grid.pixel_x_um;
  info.printer->pixel_y_um = info.grid.pixel_y_um;
  info.printer->calibration = {{0, 0}, {255, 10}};
  info.resin.emplace();
  info.resin->name = "clear";
  info.resin->absorbance_height10_um = 1000;
  info.resin->critical_dose_mj_cm3 = 100;
  info.process.emplace();
  // 33.333 um in 0.2 s.
  info.process->speed_mm_h = images.grid.layer_um * 1e-3 / 0.2 * 3600;
  Told told;
  write_file_as(file(), images, info, told.context());
  EXPECT_THAT(told.all(), HasSubstr("can't say that the platform moves while slices are shown: "
                                    "each slice is shown for 0.2 s"));
  EXPECT_EQ(StackReader::read_info(path_).process->speed_mm_h, info.process->speed_mm_h);
  const StackInfo read = read_as_foreign();
  if (GetParam().exposures) {
    EXPECT_NEAR(read.exposure_s, 0.2, 1e-9);
  }
}

TEST_P(NewArchive, IsTheSameEveryTime) {
  const Images images = random_images(36, 21, 3, 10);
  write_file_as(file(), images, timed_info(images.grid));
  const Bytes first = read_file(path_);
  write_file_as(file(), images, timed_info(images.grid));
  EXPECT_EQ(read_file(path_), first);
}

// ---- What printers read of new archives

std::vector<std::string> names_of(const Entries& entries) {
  std::vector<std::string> names;
  for (const auto& e : entries) names.push_back(e.first);
  return names;
}

TEST(NewChitubox, GcodeIsThatOfChitubox) {
  TemporaryFolder folder;
  Images images = random_images(4, 3, 2, 1);
  images.grid.pixel_x_um = images.grid.pixel_y_um = 50;
  images.grid.layer_um = 100;
  StackInfo info = info_of(images.grid);
  info.exposure_s = 3;
  info.bottom_exposure_s = 10;
  info.bottom_layers = 1;
  StackFile file(folder / "part.zip");
  file.format = "chitubox";
  write_file_as(file, images, info);
  Entries entries = unzip(file.path);
  EXPECT_THAT(names_of(entries),
              UnorderedElementsAre("run.gcode", "preview.png", "preview_cropping.png",
                                   "slicecorr.json", "1.png", "2.png"));
  const std::string text = to_text(entry(entries, "run.gcode"));
  for (const char* line :
       {";layerHeight:0.1\n", ";resolutionX:4\n", ";resolutionY:3\n", ";machineX:0.2\n",
        ";machineY:0.15\n", ";normalExposureTime:3\n", ";bottomLayerExposureTime:10\n",
        ";bottomLayerCount:1\n", ";totalLayer:2\n"}) {
    EXPECT_THAT(text, HasSubstr(line));
  }
  EXPECT_THAT(text, HasSubstr(";START_GCODE_BEGIN\nG21;\nG90;\nM106 S0;\nG28 Z0;\n\n"
                              ";START_GCODE_END\n\n"
                              ";LAYER_START:0\n;currPos:0.1\nM6054 \"1.png\";show Image\n"
                              "G0 Z5.1 F60;\nG0 Z0.1 F150;\nG4 P0;\nM106 S255;light on\n"
                              "G4 P10000;\nM106 S0; light off\n\n;LAYER_END\n\n"
                              ";LAYER_START:1\n;currPos:0.2\nM6054 \"2.png\";show Image\n"
                              "G0 Z5.2 F60;\nG0 Z0.2 F150;\nG4 P0;\nM106 S255;light on\n"
                              "G4 P3000;\nM106 S0; light off\n\n;LAYER_END\n\n"
                              ";END_GCODE_BEGIN\n"));
}

TEST(NewCws, NamesNeverRunIntoNumbers) {
  TemporaryFolder folder;
  const Images images = random_images(4, 3, 2, 1);
  write_file_as(folder / "part2.cws", images, info_of(images.grid));
  EXPECT_THAT(names_of(unzip(folder / "part2.cws")),
              UnorderedElementsAre("slice.conf", "part2_.gcode", "slicecorr.json", "part2_0000.png",
                                   "part2_0001.png"));
}

TEST(NewNanoDlp, JsonHasWhatReadersNeed) {
  TemporaryFolder folder;
  Images images = random_images(6, 3, 2, 1);
  images.grid.pixel_x_um = images.grid.pixel_y_um = 50;
  write_file_as(folder / "part.nanodlp", images, timed_info(images.grid));
  Entries entries = unzip(folder / "part.nanodlp");
  const auto json = [&](const char* name) {
    return nlohmann::json::parse(to_text(entry(entries, name)));
  };
  EXPECT_EQ(json("plate.json")["LayersCount"], 2);
  EXPECT_EQ(json("slicer.json")["PWidth"], 6);
  EXPECT_EQ(json("slicer.json")["XPixelSize"], 0.05);
  EXPECT_EQ(json("profile.json")["SupportCureTime"], 12);
  EXPECT_TRUE(json("meta.json").contains("format_version"));
}

// ---- Three pixels in one

class Packed : public ::testing::TestWithParam<std::tuple<const char*, int>> {};
INSTANTIATE_TEST_SUITE_P(Widths, Packed,
                         ::testing::Combine(::testing::Values("cws", "nanodlp"),
                                            ::testing::Values(1, 2, 3, 6, 7, 8, 100)));

TEST_P(Packed, PixelsStandInTheChannelsOfTheFormat) {
  const auto [kind, width] = GetParam();
  const bool blue_first = std::string(kind) == "cws";
  TemporaryFolder folder;
  const std::string path = folder / (blue_first ? "part.rgb.cws" : "part.nanodlp");
  const Images images = random_images(width, 5, 6, 11);
  Told told;
  StackInfo info = info_of(images.grid);
  info.exposure_s = 1;
  write_file_as(path, images, info, told.context());
  EXPECT_EQ(told.all().find("no multiple of three") != std::string::npos, width % 3 != 0);
  EXPECT_EQ(read_images(StackReader(path, folder.path())), images.slices);
  Entries entries = unzip(path);
  for (int n = 0; n < 6; ++n) {
    const std::string name =
        blue_first ? "part000" + std::to_string(n) + ".png" : std::to_string(n + 1) + ".png";
    const Picture picture = picture_of(entry(entries, name));
    const Bytes& grey = images.slices[static_cast<std::size_t>(n)];
    EXPECT_EQ(picture.rgb, picture_of(packed_png(grey, width, 5, blue_first)).rgb);
    EXPECT_TRUE(picture.colour);
    EXPECT_EQ(picture.width, (width + 2) / 3);
  }
}

TEST_P(Packed, OfOtherProgramsAreReadAndKept) {
  const auto [kind, width] = GetParam();
  const bool blue_first = std::string(kind) == "cws";
  TemporaryFolder folder;
  const Images images = random_images(width, 5, 3, 12);
  Entries entries;
  if (blue_first) {
    entries = {{"slice.conf", to_bytes(nova_config(width, 5, 3))},
               {"cube.gcode", to_bytes(nova_gcode(width, 5, {30000, 2000, 2000}))}};
  } else {
    entries = {
        {"meta.json", to_bytes("{\"distro\":\"athena\"}")},
        {"slicer.json", to_bytes("{\"PWidth\":" + std::to_string(width) + ",\"PHeight\":5}")},
        {"plate.json", to_bytes("{\"LayersCount\":3}")},
        {"profile.json", to_bytes("{\"Depth\":50}")}};
  }
  for (int n = 0; n < 3; ++n) {
    entries.emplace_back(
        blue_first ? "cube00" + std::to_string(n) + ".png" : std::to_string(n + 1) + ".png",
        packed_png(images.slices[static_cast<std::size_t>(n)], width, 5, blue_first));
  }
  const std::string path = folder / "in.zip";
  make_foreign_zip(path, entries);
  const MissingFacts missing{50, 50, 50};
  const StackReader reader(path, folder.path(), {}, missing);
  EXPECT_EQ(reader.info().format, blue_first ? "rgb-cws" : "nanodlp");
  EXPECT_EQ(read_images(reader), images.slices);

  Images other = random_images(width, 5, 3, 13);
  StackFile file(folder / "out.zip");
  file.format = reader.info().format;
  file.keep_from = path;
  StackInfo info = reader.info();
  write_file_as(file, other, info);
  EXPECT_EQ(read_images(StackReader(file.path, folder.path(), {}, missing)), other.slices);
  EXPECT_EQ(picture_of(unzip(file.path).back().second).rgb,
            picture_of(packed_png(other.slices.back(), width, 5, blue_first)).rgb);
}

// ---- Real archives

std::string real(const std::string& name) { return test::real_file("slices/" + name); }

/// The archive with images of 64 x 36 pixels.
std::string with_small_images(const std::string& path, const TemporaryFolder& folder) {
  Entries entries = unzip(path);
  for (auto& [name, data] : entries) {
    if (name.ends_with(".png")) {
      data = png_of(Bytes(64 * 36 * 4, 255), 64, 36, PNG_FORMAT_RGBA);
    } else {
      std::string text = to_text(data);
      replace(text, "(X Resolution            = 1920 )", "(X Resolution            = 64 )");
      replace(text, "(Y Resolution            = 1080 )", "(Y Resolution            = 36 )");
      data = to_bytes(text);
    }
  }
  make_foreign_zip(folder / "small.zip", entries);
  return folder / "small.zip";
}

TEST(RealArchives, CreationWorkshopWithoutItsLastSlice) {
  const std::string path = real("cws/diagrid_creation_workshop.zip");
  SLICECORR_NEEDS_FILE(path);
  TemporaryFolder folder;
  Told told;
  const StackReader reader(path, folder.path(), told.context());
  const StackInfo& info = reader.info();
  EXPECT_EQ(info.format, "cws");
  EXPECT_EQ(info.grid.width_px, 1920);
  EXPECT_EQ(info.grid.height_px, 1080);
  EXPECT_EQ(info.grid.layers, 65);
  EXPECT_NEAR(info.grid.pixel_x_um, 1000 / 26.25174, 1e-6);
  EXPECT_NEAR(info.grid.pixel_y_um, 1000 / 26.25182, 1e-6);
  EXPECT_NEAR(info.grid.layer_um, 100, 1e-9);
  EXPECT_EQ(info.exposure_s, 4);
  EXPECT_EQ(info.bottom_exposure_s, 15);
  EXPECT_EQ(info.bottom_layers, 3);
  EXPECT_TRUE(info.layer_exposure_s.empty());
  EXPECT_EQ(info.orientation, (Orientation{false, false, true}));
  EXPECT_EQ(info.profiles.printer, "UV_DLP");
  EXPECT_THAT(told.all(), HasSubstr("has 65 of 66 slices, the last ones are missing"));
  EXPECT_GT(reader.pixel_sum(), 0u);

  // In place: the images stay RGBA, and the G-code has the layer that is added already. By day with small
  // images, as their size changes nothing.
  const std::string kept = by_night() ? path : with_small_images(path, folder);
  StackInfo changed = StackReader(kept, folder.path()).info();
  EXPECT_EQ(changed.grid.layers, 65);
  changed.grid.layers = 66;
  Images images = random_images(8, 8, 66, 1);
  images.grid = changed.grid;
  const auto pixels = static_cast<std::size_t>(changed.grid.width_px * changed.grid.height_px);
  for (Bytes& slice : images.slices) slice.assign(pixels, 0);
  for (const std::size_t n : {0u, 65u}) images.slices[n].assign(pixels, 200);
  StackFile file(folder / "out.zip");
  file.format = "cws";
  file.keep_from = kept;
  write_file_as(file, images, changed);
  const std::vector<RawEntry> before = raw_entries(kept), after = raw_entries(file.path);
  ASSERT_EQ(after.size(), before.size() + 1);
  EXPECT_EQ(after.front(), before.front());
  EXPECT_EQ(after.back().name, "diagrid_s0065.png");
  Told second;
  const StackReader again(file.path, folder.path(), second.context());
  EXPECT_EQ(second.all(), "");
  EXPECT_EQ(again.pixel_sum(), std::uint64_t{2} * pixels * 200);
}

TEST(RealArchives, NanoDlpInGrey) {
  const std::string path = real("nanodlp/resinsim_mini_SYNTHETIC.nanodlp");
  SLICECORR_NEEDS_FILE(path);
  TemporaryFolder folder;
  const StackReader reader(path, folder.path());
  const StackInfo& info = reader.info();
  EXPECT_EQ(info.format, "nanodlp");
  EXPECT_EQ(info.grid.width_px, 8);
  EXPECT_EQ(info.grid.height_px, 8);
  EXPECT_EQ(info.grid.layers, 3);
  EXPECT_NEAR(info.grid.pixel_x_um, 50, 1e-9);
  EXPECT_NEAR(info.grid.pixel_y_um, 50, 1e-9);
  EXPECT_NEAR(info.grid.layer_um, 50, 1e-9);
  EXPECT_EQ(info.exposure_s, 2);
  EXPECT_EQ(info.bottom_exposure_s, 8);
  EXPECT_EQ(info.bottom_layers, 1);
  EXPECT_EQ(info.profiles.printer, "athena");
  EXPECT_EQ(info.profiles.material, "Fixture Resin");
  // info.json: 32, 16 and 8 pixels of the slices are lit.
  std::vector<int> lit;
  for (const Bytes& slice : read_images(reader)) {
    lit.push_back(static_cast<int>(std::count(slice.begin(), slice.end(), 255)));
  }
  EXPECT_EQ(lit, (std::vector<int>{32, 16, 8}));

  StackFile file(folder / "out.nanodlp");
  file.keep_from = path;
  Images images = random_images(8, 8, 3, 4);
  write_file_as(file, images, info);
  EXPECT_EQ(read_images(StackReader(file.path, folder.path())), images.slices);
  const std::vector<RawEntry> before = raw_entries(path), after = raw_entries(file.path);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!before[i].name.ends_with(".png")) {
      EXPECT_EQ(after[i], before[i]);
    }
  }
}

}  // namespace
}  // namespace slicecorr::test
