// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Zip archives as other programs write them: read, changed in place, damaged.

#include <gmock/gmock.h>

#include "format_fixture.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;

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
    f.entries.emplace_back(
        "plate.json",
        to_bytes("{\"Path\":\"x\",\"LayersCount\":3,\"Odd\":[1],\"CureTimes\":null,\"ZMax\":0.3}"));
    f.entries.emplace_back("profile.json",
                           to_bytes("{\n  \"Title\": \"Clear\",\n  \"Zzz\": 1.50,\n"
                                    "  \"CureTime\": 3.0,\n  \"SupportCureTime\": 10,\n"
                                    "  \"SupportLayerNumber\": 1,\n  \"Aaa\": null\n}"));
    f.entries.emplace_back(
        "info.json",
        to_bytes(
            "[{\"AreaCount\":2,\"MaxX\":5},{\"AreaCount\":1,\"MaxX\":4},{\"AreaCount\":1,\"MaxX\":4}]"));
    f.entries.emplace_back(
        "slicer.json",
        to_bytes(
            "{\"PWidth\":5,\"PHeight\":4,\"XPixelSize\":0.05,\"YPixelSize\":0.05,\"Thickness\":100,\"LayerCount\":0}"));
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

/// Of a time that is written in another way nothing may be left beside the new one.
TEST(InPlaceTimes, AreReplacedWhole) {
  TemporaryFolder folder;
  Foreign f = foreign_archive("cws");
  std::string config = nova_config(5, 4, 3), gcode = nova_gcode(5, 4, {30000, 2000, 2000});
  replace(config, "= 2000\n", "= 2e3\n");
  replace(gcode, "= 2000 ms", "= 2.0e3 ms");
  entry(f.entries, "slice.conf") = to_bytes(config);
  entry(f.entries, "cube.gcode") = to_bytes(gcode);
  const std::string in = folder / "in.zip";
  const auto write = [&] {
    make_foreign_zip(in, f.entries);
    StackFile file(folder / "out.zip");
    file.format = f.format;
    file.keep_from = in;
    StackInfo info = StackReader::read_info(in);
    info.exposure_s = 3;
    info.layer_exposure_s.clear();
    write_file_as(file, f.images, info);
  };
  write();
  Entries after = unzip(folder / "out.zip");
  EXPECT_THAT(to_text(entry(after, "slice.conf")), HasSubstr("layers_expo_ms          = 3000\n"));
  EXPECT_THAT(to_text(entry(after, "cube.gcode")), HasSubstr("= 3000 ms"));
  EXPECT_EQ(StackReader::read_info(folder / "out.zip").exposure_s, 3);
  for (const char* time : {"0x7D0", "2_000", "2,000", "2 000", "2e", "2.0.0"}) {
    entry(f.entries, "slice.conf") = to_bytes([&] {
      std::string other = config;
      replace(other, "= 2e3\n", "= " + std::string(time) + "\n");
      return other;
    }());
    try {
      write();
      ADD_FAILURE() << time;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(std::string("layers_expo_ms is ") + time));
    }
  }
}

/// What is written is read back before it takes the archive's name.
TEST(InPlaceTimes, ThatCantBeWrittenLeaveTheArchiveAsItIs) {
  TemporaryFolder folder;
  Foreign f = foreign_archive("chitubox");
  // Waits of 4 s more in the light of layer 1, which stay: 2 s can't be written.
  std::string gcode = to_text(entry(f.entries, "run.gcode"));
  const std::string light = "M106 S255;light on\r\n";
  const std::size_t at = gcode.find(light, gcode.find("LAYER_START:1")) + light.size();
  const std::size_t end = gcode.find("\r\n", at) + 2;
  gcode.insert(end, "G4 P4000;\r\n");
  entry(f.entries, "run.gcode") = to_bytes(gcode);
  const std::string in = folder / "in.zip";
  make_foreign_zip(in, f.entries);
  const Bytes before = read_file(in);
  StackFile file(in);
  file.format = f.format;
  file.keep_from = in;
  StackInfo info = StackReader::read_info(in);
  info.exposure_s = 2;
  info.layer_exposure_s.clear();
  try {
    write_file_as(file, f.images, info);
    ADD_FAILURE() << "written";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("plans 2 s for slice 1, the archive says 4 s"));
    EXPECT_THAT(e.what(), HasSubstr("is left as it is"));
    EXPECT_EQ(std::string(e.what()).find(".part"), std::string::npos) << e.what();
  }
  EXPECT_EQ(read_file(in), before);
  EXPECT_EQ(folder.count(), 1);
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
  write_file_as(file(), random_images(5, 4, 3, 26), info, told.context());
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

const Damage kDamages[] = {
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
    {"generic", "manifest.uvtools", "</Manifest>", "", "manifest.uvtools: is not valid XML"},
    {"generic", "manifest.uvtools", "<Manifest>", "<Manifest/><M>", "is not valid XML"},
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
    {"nanodlp", "plate.json", "{", "[", "plate.json: is not valid JSON"},
    {"nanodlp", "plate.json", "\"CureTimes\":null", "\"CureTimes\":[1,2,-3]",
     "CureTimes[2] is no number"},
    {"nanodlp", "plate.json", "\"CureTimes\":null", "\"DynamicThickness\":[50,50,2500]",
     "is 2500 um high, expected up to 1000 um"},
    {"nanodlp", "slicer.json", "\"PWidth\":5", "\"PWidth\":6", "expected 6 x 4, or 2 x 4 in RGB"},
    {"nanodlp", "slicer.json", "\"PWidth\":5", "\"PWidth\":{}", "PWidth is a list or object"},
    {"nanodlp", "slicer.json", "\"Thickness\":100", "\"Thickness\":0.1",
     "says layers of 0.1 um, expected 1 to 1000 um"},
};
INSTANTIATE_TEST_SUITE_P(Table, Damaged, ::testing::ValuesIn(kDamages), [](const auto& c) {
  return std::string(c.param.format) + "_" + std::to_string(c.index);
});

}  // namespace
}  // namespace slicecorr::test
