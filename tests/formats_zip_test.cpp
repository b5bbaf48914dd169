// Zip archives of Chitubox, CWS, NanoDLP and of images alone: new ones read back, foreign ones
// changed in place, damaged ones, real ones.

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "format_fixture.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

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
  write_file_as(file(), images, info, told.job());
  const StackInfo read = read_as_foreign();
  if (GetParam().layer_times) {
    EXPECT_EQ(read.layer_exposure_s, info.layer_exposure_s);
    EXPECT_EQ(told.all(), "");
  } else {
    EXPECT_TRUE(read.layer_exposure_s.empty());
    EXPECT_THAT(told.all(), HasSubstr("holds no exposure times: set 3 s at the printer, which "
                                      "can't show layers for different times"));
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
  write_file_as(file(), images, info, told.job());
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
  EXPECT_EQ(names_of(entries),
            (std::vector<std::string>{"run.gcode", "preview.png", "preview_cropping.png",
                                      "slicecorr.json", "1.png", "2.png"}));
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
  EXPECT_EQ(names_of(unzip(folder / "part2.cws")),
            (std::vector<std::string>{"slice.conf", "part2_.gcode", "slicecorr.json",
                                      "part2_0000.png", "part2_0001.png"}));
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
  write_file_as(path, images, info, told.job());
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

/// slice.conf and G-code as NovaMaker writes them.
std::string nova_config(int width, int height, int layers) {
  return "# nova3d.cn NovaMaker v2.4.4 64-bits 2021-12-14 16:24:42\n# conf version 1.0\n\n"
         "xppm                    = 20\nyppm                    = 20\nxres                    = " +
         std::to_string(width) + "\nyres                    = " + std::to_string(height) +
         "\nthickness               = 0.050\nlayers_num              = " + std::to_string(layers) +
         "\nhead_layers_num         = 1\nlayers_expo_ms          = 2000\n"
         "head_layers_expo_ms     = 30000\nwait_before_expo_ms     = 2000\n";
}

std::string nova_layer(int n, int ms) {
  return ";<Slice> " + std::to_string(n) + "\nM106 S255\n;<Delay> " + std::to_string(ms) +
         "\nM106 S0\n;<Slice> Blank\nG1 Z4.000 F100\nG1 Z-3.950 F100\n;<Delay> 6800\n\n";
}

const char* const nova_end = "M18 ;Disable Motors\nM106 SO\nG1 Z80.0\n;<Completed>\n";

std::string nova_gcode(int width, int height, const std::vector<int>& ms) {
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
  return text + nova_end;
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

// ---- Archives of other programs, in place

/// As Chitubox writes it, with lines of Windows.
std::string chitubox_gcode(int layers) {
  std::string text =
      ";fileName:cube.stl\n;machineType:Phrozen Sonic\n;estimatedPrintTime:401.8\n;volume:0\n"
      ";resin:Aqua\n;weight:0\n;layerHeight:0.1\n;resolutionX:5\n;resolutionY:4\n;machineX:0.25\n"
      ";machineY:0.2\n;machineZ:250\n;projectType:LCD_mirror\n;normalExposureTime:3\n"
      ";bottomLayExposureTime:10\n;bottomLayerExposureTime:10\n;normalDropSpeed:120\n"
      ";bottomLayCount:1\n;bottomLayerCount:1\n;mirror:1\n;totalLayer:" +
      std::to_string(layers) +
      "\n;unknown:ab:c d\n;START_GCODE_BEGIN\nG21;\nG90;\nM106 S0;\nG28 Z0;\n\n"
      ";START_GCODE_END\n\n";
  for (int n = 0; n < layers; ++n) {
    const std::string z = std::to_string(n + 1), k = std::to_string(n);
    text += ";LAYER_START:" + k + "\n;currPos:0." + z + "\nM6054 \"" + z +
            ".png\";show Image\nG0 Z6." + z + " F120;\nG0 Z0." + z +
            " F120;\nG4 P4000;\nM106 S255;light on\nG4 P" + (n == 0 ? "10000" : "3000") +
            ";\nM106 S0; light off\n\n;LAYER_END\n\n";
  }
  text += ";END_GCODE_BEGIN\nM106 S0;\nG1 Z250 F25;\nM18;\n\n;END_GCODE_END\n";
  std::string windows;
  for (const char c : text) windows += c == '\n' ? "\r\n" : std::string(1, c);
  return windows;
}

struct Foreign {
  std::string format;
  Entries entries;  ///< in an order of no use
  Images images;
  std::vector<std::string> names;  ///< of the images
};

Foreign foreign_archive(const std::string& format) {
  Foreign f{format, {}, random_images(5, 4, 3, 21), {"1.png", "2.png", "3.png"}};
  f.images.grid = {5, 4, 3, 50, 50, 100};
  const Bytes note = to_bytes("what nobody knows");
  f.entries.emplace_back("notes/readme.txt", note);
  if (format == "cws") f.names = {"cube000.png", "cube001.png", "cube002.png"};
  // Last first.
  for (int n : {2, 0}) {
    f.entries.emplace_back(
        f.names[static_cast<std::size_t>(n)],
        png_of(f.images.slices[static_cast<std::size_t>(n)], 5, 4, PNG_FORMAT_GRAY));
  }
  if (format == "chitubox") {
    f.entries.emplace_back("run.gcode", to_bytes(chitubox_gcode(3)));
    f.entries.emplace_back("preview.png", png_of(Bytes(6), 3, 2, PNG_FORMAT_GRAY));
  } else if (format == "generic") {
    f.entries.emplace_back(
        "manifest.uvtools",
        to_bytes("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<Manifest>\n"
                 "  <CreatedBy>UVtools v5</CreatedBy><!-- kept -->\n  <Odd>1</Odd>\n"
                 "  <LayerHeight>0.1</LayerHeight>\n  <ResolutionX>5</ResolutionX>\n"
                 "  <ResolutionY>4</ResolutionY>\n  <DisplayWidth>0.25</DisplayWidth>\n"
                 "  <DisplayHeight>0.2</DisplayHeight>\n  <MachineZ>0</MachineZ>\n</Manifest>"));
  } else if (format == "cws") {
    f.entries.emplace_back("cube.gcode", to_bytes(nova_gcode(5, 4, {30000, 2000, 2000})));
    f.entries.emplace_back("slice.conf", to_bytes(nova_config(5, 4, 3)));
    f.images.grid.layer_um = 50;
  } else {
    f.entries.emplace_back("plate.json", to_bytes("{\"Path\":\"x\",\"LayersCount\":3,\"Odd\":[1],"
                                                  "\"CureTimes\":null,\"ZMax\":0.3}"));
    f.entries.emplace_back("profile.json",
                           to_bytes("{\n  \"Title\": \"Clear\",\n  \"Zzz\": 1.50,\n"
                                    "  \"CureTime\": 3.0,\n  \"SupportCureTime\": 10,\n"
                                    "  \"SupportLayerNumber\": 1,\n  \"Aaa\": null\n}"));
    f.entries.emplace_back("info.json", to_bytes("[{\"AreaCount\":2,\"MaxX\":5},{\"AreaCount\":1,"
                                                 "\"MaxX\":4},{\"AreaCount\":1,\"MaxX\":4}]"));
    f.entries.emplace_back("slicer.json",
                           to_bytes("{\"PWidth\":5,\"PHeight\":4,\"XPixelSize\":0.05,"
                                    "\"YPixelSize\":0.05,\"Thickness\":100,\"LayerCount\":0}"));
    f.entries.emplace_back("meta.json", to_bytes("{\"format_version\":2,\"distro\":\"athena\"}"));
  }
  f.entries.emplace_back(f.names[1], png_of(f.images.slices[1], 5, 4, PNG_FORMAT_GRAY));
  return f;
}

class InPlace : public ::testing::TestWithParam<const char*> {
 protected:
  TemporaryFolder folder_;
  Foreign foreign_ = foreign_archive(GetParam());
  std::string in_ = folder_ / "in.zip", out_ = folder_ / "out.zip";
  StackInfo info_;

  void SetUp() override {
    make_foreign_zip(in_, foreign_.entries);
    const StackReader reader(in_, folder_.path());
    info_ = reader.info();
    EXPECT_EQ(read_images(reader), foreign_.images.slices);
  }
  StackFile file() const {
    StackFile f(out_);
    f.format = GetParam();
    f.keep_from = in_;
    return f;
  }
  bool is_image(const std::string& name) const {
    return std::find(foreign_.names.begin(), foreign_.names.end(), name) != foreign_.names.end();
  }
};
INSTANTIATE_TEST_SUITE_P(Formats, InPlace,
                         ::testing::Values("chitubox", "generic", "cws", "nanodlp"),
                         [](const auto& c) { return std::string(c.param); });

TEST_P(InPlace, IsRead) {
  EXPECT_EQ(info_.format, GetParam());
  EXPECT_EQ(info_.kind, StackKind::foreign);
  EXPECT_EQ(info_.target_layers, 3);
  EXPECT_EQ(info_.grid.layers, 3);
  EXPECT_NEAR(info_.grid.pixel_x_um, 50, 1e-9);
  EXPECT_NEAR(info_.grid.pixel_y_um, 50, 1e-9);
  EXPECT_NEAR(info_.grid.layer_um, foreign_.images.grid.layer_um, 1e-9);
  EXPECT_TRUE(info_.layer_exposure_s.empty());
  const bool cws = foreign_.format == "cws", timed = foreign_.format != "generic";
  EXPECT_EQ(info_.exposure_s, timed ? (cws ? 2 : 3) : 0);
  EXPECT_EQ(info_.bottom_exposure_s, timed ? (cws ? 30 : 10) : 0);
  EXPECT_EQ(info_.bottom_layers, timed ? 1 : 0);
  EXPECT_EQ(info_.orientation.mirror_x, cws || foreign_.format == "chitubox");
  if (foreign_.format == "chitubox") {
    EXPECT_EQ(info_.profiles.printer, "Phrozen Sonic");
    EXPECT_EQ(info_.profiles.material, "Aqua");
  }
}

TEST_P(InPlace, OnlyImagesChange) {
  const Images other = random_images(5, 4, 3, 22);
  write_file_as(file(), other, info_);
  const std::vector<RawEntry> before = raw_entries(in_), after = raw_entries(out_);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].name, before[i].name);
    EXPECT_EQ(after[i].comment, before[i].comment);
    EXPECT_EQ(after[i].time, before[i].time);
    if (!is_image(before[i].name)) {
      EXPECT_EQ(after[i], before[i]) << before[i].name;
    }
  }
  EXPECT_EQ(read_images(StackReader(out_, folder_.path())), other.slices);
}

TEST_P(InPlace, LayersAndTimesAreChangedInTheirPlaces) {
  Images other = random_images(5, 4, 5, 23);
  StackInfo info = info_;
  info.grid.layers = 5;
  info.exposure_s = 4.5;
  info.bottom_exposure_s = 20;
  info.bottom_layers = 2;
  other.grid = info.grid;
  write_file_as(file(), other, info);
  const StackReader reader(out_, folder_.path());
  EXPECT_EQ(read_images(reader), other.slices);
  if (foreign_.format != "generic") {
    EXPECT_EQ(reader.info().exposure_s, 4.5);
    EXPECT_EQ(reader.info().bottom_exposure_s, 20);
    EXPECT_EQ(reader.info().bottom_layers, 2);
    EXPECT_TRUE(reader.info().layer_exposure_s.empty());
  }
  Entries before = foreign_.entries, after = unzip(out_);
  ASSERT_EQ(after.size(), before.size() + 2);
  const auto text = [](Entries& entries, const char* name) {
    return to_text(entry(entries, name));
  };
  const auto lines = [](std::string t) {
    std::string windows;
    for (const char c : t) windows += c == '\n' ? "\r\n" : std::string(1, c);
    return windows;
  };
  std::vector<std::string> changed;
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].first, before[i].first);
    if (!is_image(before[i].first) && after[i].second != before[i].second) {
      changed.push_back(before[i].first);
    }
  }
  using Names = std::vector<std::string>;
  if (foreign_.format == "generic") {
    EXPECT_EQ(changed, Names{});
    EXPECT_EQ(after.back().first, "5.png");
  } else if (foreign_.format == "chitubox") {
    EXPECT_EQ(changed, Names{"run.gcode"});
    EXPECT_EQ(after.back().first, "5.png");
    std::string expected = chitubox_gcode(5);
    replace(expected, "normalExposureTime:3\r", "normalExposureTime:4.5\r");
    replace(expected, "bottomLayExposureTime:10\r", "bottomLayExposureTime:20\r");
    replace(expected, "bottomLayerExposureTime:10\r", "bottomLayerExposureTime:20\r");
    replace(expected, "bottomLayCount:1\r", "bottomLayCount:2\r");
    replace(expected, "bottomLayerCount:1\r", "bottomLayerCount:2\r");
    replace(expected, "G4 P10000;", "G4 P20000;");
    replace(expected, "G4 P3000;", "G4 P20000;");
    for (int n = 0; n < 3; ++n) replace(expected, "G4 P3000;", "G4 P4500;");
    EXPECT_EQ(text(after, "run.gcode"), expected);
    EXPECT_THAT(expected, HasSubstr(lines(";LAYER_START:4\n;currPos:0.5\nM6054 \"5.png\"")));
  } else if (foreign_.format == "cws") {
    EXPECT_EQ(changed, (Names{"cube.gcode", "slice.conf"}));
    EXPECT_EQ(after.back().first, "cube004.png");
    std::string gcode = nova_gcode(5, 4, {20000, 20000, 4500, 4500, 4500});
    replace(gcode, "= 2000 ms", "= 4500 ms");
    replace(gcode, "= 30000 ms", "= 20000 ms");
    replace(gcode, "Bottom Layers = 1 )", "Bottom Layers = 2 )");
    EXPECT_EQ(text(after, "cube.gcode"), gcode);
    std::string config = nova_config(5, 4, 5);
    replace(config, "= 2000\nhead_layers_expo_ms     = 30000",
            "= 4500\nhead_layers_expo_ms     = 20000");
    replace(config, "head_layers_num         = 1", "head_layers_num         = 2");
    EXPECT_EQ(text(after, "slice.conf"), config);
  } else {
    EXPECT_EQ(changed, (Names{"plate.json", "profile.json", "info.json"}));
    EXPECT_EQ(text(after, "plate.json"),
              "{\"Path\":\"x\",\"LayersCount\":5,\"Odd\":[1],\"CureTimes\":null,\"ZMax\":0.3}");
    EXPECT_EQ(text(after, "profile.json"),
              "{\n  \"Title\": \"Clear\",\n  \"Zzz\": 1.5,\n  \"CureTime\": 4.5,\n"
              "  \"SupportCureTime\": 20.0,\n  \"SupportLayerNumber\": 2,\n  \"Aaa\": null\n}");
    EXPECT_THAT(text(after, "info.json"),
                HasSubstr("{\"AreaCount\":1,\"MaxX\":4},{\"AreaCount\":0,\"MaxX\":0},{"));
  }
}

TEST_P(InPlace, LayersCanBeAddedWithTheirTimes) {
  Images other = random_images(5, 4, 4, 24);
  StackInfo info = info_;
  info.grid.layers = 4;
  other.grid = info.grid;
  write_file_as(file(), other, info);
  const StackInfo read = StackReader::read_info(out_);
  EXPECT_EQ(read.grid.layers, 4);
  EXPECT_EQ(read.exposure_s, info_.exposure_s);
  EXPECT_EQ(read.bottom_exposure_s, info_.bottom_exposure_s);
  EXPECT_TRUE(read.layer_exposure_s.empty());
}

TEST_P(InPlace, LayersAreNeverTakenAway) {
  Images other = random_images(5, 4, 2, 25);
  StackInfo info = info_;
  info.grid.layers = 2;
  other.grid = info.grid;
  try {
    write_file_as(file(), other, info);
    FAIL() << "a stack with fewer layers was put in place";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("has 3 layers, expected at most the 2 of the stack"));
  }
  EXPECT_FALSE(std::filesystem::exists(out_));
}

TEST_P(InPlace, TimesOfSingleLayersAreHeldOrTold) {
  StackInfo info = info_;
  info.layer_exposure_s = {9, 1.5, 2};
  info.bottom_exposure_s = info.bottom_layers = 0;
  info.exposure_s = 2;
  Told told;
  write_file_as(file(), random_images(5, 4, 3, 26), info, told.job());
  const StackInfo read = StackReader::read_info(out_);
  if (foreign_.format == "generic") {
    EXPECT_THAT(told.all(), HasSubstr("can't show layers for different times"));
  } else {
    EXPECT_EQ(read.layer_exposure_s, info.layer_exposure_s);
  }
}

// ---- Damages

struct Damage {
  const char* format;
  const char* entry;  ///< that is changed
  const char* from;   ///< null: the entry goes
  const char* to;     ///< null: the entry is renamed to `from`
  const char* message;
};

class Damaged : public ::testing::TestWithParam<Damage> {};

TEST_P(Damaged, IsRefusedByName) {
  const Damage& d = GetParam();
  TemporaryFolder folder;
  Foreign f = foreign_archive(d.format);
  if (d.from == nullptr) {
    std::erase_if(f.entries, [&](const auto& e) { return e.first == d.entry; });
  } else if (d.to == nullptr) {
    for (auto& e : f.entries) {
      if (e.first == d.entry) e.first = d.from;
    }
  } else {
    std::string text = to_text(entry(f.entries, d.entry));
    replace(text, d.from, d.to);
    entry(f.entries, d.entry) = to_bytes(text);
  }
  const std::string path = folder / "damaged.zip";
  make_foreign_zip(path, f.entries);
  try {
    const StackReader reader(path, folder.path(), {}, {50, 50, 50});
    FAIL() << "was read as " << reader.info().format;
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr(path));
    EXPECT_THAT(error.what(), HasSubstr(d.message));
  }
}

const Damage damages[] = {
    {"chitubox", "2.png", nullptr, nullptr, "3.png: follows a gap: image 2 is missing"},
    {"chitubox", "1.png", nullptr, nullptr, "image 1 is missing"},
    {"chitubox", "3.png", nullptr, nullptr, "run.gcode: totalLayer is 3, but there are 2 images"},
    {"chitubox", "3.png", "02.png", nullptr, "has the number of another image"},
    {"chitubox", "1.png", "0.png", nullptr, "0.png"},
    {"chitubox", "run.gcode", ";totalLayer:3", ";totalLayer:4", "totalLayer is 4, but there are 3"},
    {"chitubox", "run.gcode", ";totalLayer:3", ";totalLayer:2.5", "expected a whole number"},
    {"chitubox", "run.gcode", ";totalLayer:3", ";totalLayer:1e7", "from 0 to 1000000"},
    {"chitubox", "run.gcode", ";totalLayer:3", ";totalLayer:x",
     "totalLayer is x, expected a number"},
    {"chitubox", "run.gcode", ";resolutionX:5", ";resolutionX:6",
     "1.png: is 5 x 4 pixels, expected 6 x 4, as run.gcode says"},
    {"chitubox", "run.gcode", ";resolutionX:5", ";resolutionX:70000", "from 0 to 65536"},
    {"chitubox", "run.gcode", ";machineX:0.25", ";machineX:25", "says pixels of 5000 um, expected"},
    {"chitubox", "run.gcode", ";machineX:0.25", ";machineX:nan", "machineX is nan"},
    {"chitubox", "run.gcode", ";layerHeight:0.1", ";layerHeight:100", "says layers of 100000 um"},
    {"chitubox", "run.gcode", ";normalExposureTime:3", ";normalExposureTime:-3",
     "normalExposureTime is -3"},
    {"generic", "2.png", nullptr, nullptr, "image 2 is missing"},
    {"generic", "manifest.uvtools", "</Manifest>", "", "manifest.uvtools: is no XML"},
    {"generic", "manifest.uvtools", "<Manifest>", "<Manifest/><M>", "is no XML"},
    {"generic", "manifest.uvtools", "ResolutionX>5", "ResolutionX>7", "expected 7 x 4"},
    {"generic", "manifest.uvtools", "LayerHeight>0.1", "LayerHeight>thin", "LayerHeight is thin"},
    {"cws", "cube001.png", nullptr, nullptr, "cube002.png: follows a gap: image 1 is missing"},
    {"cws", "cube000.png", nullptr, nullptr, "image 0 is missing"},
    {"cws", "slice.conf", "layers_num              = 3", "layers_num              = 2",
     "slice.conf: says 2 slices, but there are 3 images"},
    {"cws", "slice.conf", "xres                    = 5", "xres                    = 13",
     "expected 13 x 4, or 5 x 4 in RGB, as slice.conf says"},
    {"cws", "slice.conf", "yres                    = 4", "yres                    = 5",
     "expected 5 x 5"},
    {"cws", "slice.conf", "xppm                    = 20", "xppm                    = 0.5",
     "says pixels of 2000 um"},
    {"cws", "slice.conf", "thickness               = 0.050", "thickness               = thin",
     "thickness is thin, expected a number"},
    {"nanodlp", "2.png", nullptr, nullptr, "image 2 is missing"},
    {"nanodlp", "profile.json", nullptr, nullptr, "profile.json: is missing"},
    {"nanodlp", "plate.json", "\"LayersCount\":3", "\"LayersCount\":30",
     "plate.json: LayersCount is 30, but there are 3 images"},
    {"nanodlp", "plate.json", "\"LayersCount\":3", "\"LayersCount\":\"3\"",
     "LayersCount is \"3\", expected a number"},
    {"nanodlp", "plate.json", "{", "[", "plate.json: is no JSON"},
    {"nanodlp", "plate.json", "\"CureTimes\":null", "\"CureTimes\":[1,2,-3]",
     "CureTimes[2] is no number"},
    {"nanodlp", "plate.json", "\"CureTimes\":null", "\"DynamicThickness\":[50,50,25]",
     "layers of different heights"},
    {"nanodlp", "slicer.json", "\"PWidth\":5", "\"PWidth\":6", "expected 6 x 4, or 2 x 4 in RGB"},
    {"nanodlp", "slicer.json", "\"PWidth\":5", "\"PWidth\":{}", "PWidth is a list or object"},
    {"nanodlp", "slicer.json", "\"Thickness\":100", "\"Thickness\":0.1",
     "says layers of 0.1 um, expected 1 to 1000 um"},
};
INSTANTIATE_TEST_SUITE_P(Table, Damaged, ::testing::ValuesIn(damages), [](const auto& c) {
  return std::string(c.param.format) + "_" + std::to_string(c.index);
});

// ---- Real archives

std::string real(const std::string& name) { return SLICECORR_TEST_DATA "/slices/" + name; }

TEST(RealArchives, CreationWorkshopWithoutItsLastSlice) {
  const std::string path = real("cws/diagrid_creation_workshop.zip");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  TemporaryFolder folder;
  Told told;
  const StackReader reader(path, folder.path(), told.job());
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

  // In place: the images stay RGBA, and the G-code has the layer that is added already.
  Images images = random_images(8, 8, 66, 1);
  images.grid = info.grid;
  images.grid.layers = 66;
  for (Bytes& slice : images.slices) slice.assign(1920 * 1080, 200);
  StackFile file(folder / "out.zip");
  file.format = "cws";
  file.keep_from = path;
  StackInfo changed = info;
  changed.grid.layers = 66;
  write_file_as(file, images, changed);
  const std::vector<RawEntry> before = raw_entries(path), after = raw_entries(file.path);
  ASSERT_EQ(after.size(), before.size() + 1);
  EXPECT_EQ(after.front(), before.front());
  EXPECT_EQ(after.back().name, "diagrid_s0065.png");
  Told second;
  const StackReader again(file.path, folder.path(), second.job());
  EXPECT_EQ(second.all(), "");
  EXPECT_EQ(again.pixel_sum(), std::uint64_t{66} * 1920 * 1080 * 200);
}

TEST(RealArchives, NanoDlpInGrey) {
  const std::string path = real("nanodlp/resinsim_mini_SYNTHETIC.nanodlp");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
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
