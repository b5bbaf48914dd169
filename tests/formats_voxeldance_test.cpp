// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// VDT and VDA archives: new ones, changed ones, damaged ones.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "foreign_fixture.hpp"

namespace slicecorr {
namespace {

using Json = nlohmann::ordered_json;
using test::Bytes;
using test::Entries;
using test::expect_refused;
using test::file;
using test::foreign_info;
using test::Images;
using test::like;
using test::names_of;
using test::Notices;
using test::png_of;
using test::stamped_images;
using test::TemporaryFolder;
using test::to_bytes;
using test::to_text;
using testing::ElementsAre;
using testing::HasSubstr;

// ---- VDT -----------------------------------------------------------------------------------

constexpr const char* kVdtManifest = R"({
  "application_name": "Tango",
  "application_version": "2.1",
  "create_datetime": "2021-04-09 17:48:46",
  "file_version": 1,
  "future": {"key": [1, 2.50, "x"]},
  "machine": {"name": "Printer 8K", "lcd_width": 3.5, "lcd_height": 1.2, "resolution_x": 70,
              "resolution_y": 30, "x_mirror": true, "y_mirror": false},
  "advanced_parameters": {"light_pwm": 200},
  "resin": {"name": "Grey"},
  "print": {"layer_thickness": 0.05, "bottom_layers": 2, "transition_layer": 0,
            "bottom_exposure_time": 20, "exposure_time": 2.5, "lift_distance": 6},
  "layers": [
    {"height": 0.05, "exposure_time": 20, "light_pwm": 200, "lift_distance": 6, "mine": 1},
    {"height": 0.1, "exposure_time": 20, "light_pwm": 200, "lift_distance": 6, "mine": 2},
    {"height": 0.15, "exposure_time": 2.5, "light_pwm": 200, "lift_distance": 6, "mine": 3},
    {"height": 0.2, "exposure_time": 2.5, "light_pwm": 200, "lift_distance": 6, "mine": 4}
  ]
})";

class Vdt : public testing::Test {
 protected:
  Entries foreign(const std::string& manifest = kVdtManifest) const {
    return {{"Preview_FLT.png", to_bytes("no picture")},
            {"2.png", png_of(images_, 2)},
            {"0.png", png_of(images_, 0)},
            {"thesis/notes.txt", Bytes(5000, 'n')},
            {"manifest.json", to_bytes(manifest)},
            {"3.png", png_of(images_, 3)},
            {"1.png", png_of(images_, 1)},
            {"uvtools.bin", Bytes{0, 255, 7}}};
  }
  std::string make(const Entries& entries) {
    test::make_zip(folder_ / "a.vdt", entries, true);
    return folder_ / "a.vdt";
  }
  /// The manifest with one piece of text replaced.
  std::string with(const std::string& from, const std::string& to) const {
    std::string text = kVdtManifest;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  }
  void expect_manifest_refused(const std::string& from, const std::string& to,
                               const std::string& expected) {
    SCOPED_TRACE(to);
    expect_refused(make(foreign(with(from, to))), expected);
  }
  TemporaryFolder folder_;
  Images images_ = stamped_images(70, 30, 4, 11);
};

TEST_F(Vdt, SaysWhatItIs) {
  const StackReader reader(make(foreign()), folder_.path());
  const StackInfo& info = reader.info();
  EXPECT_EQ(test::read_images(reader), images_.slices);
  EXPECT_EQ(info.format, "vdt");
  EXPECT_EQ(info.kind, StackKind::foreign);
  EXPECT_EQ(info.grid.layers, 4);
  EXPECT_EQ(info.target_layers, 4);
  EXPECT_DOUBLE_EQ(info.grid.pixel_x_um, 50);
  EXPECT_DOUBLE_EQ(info.grid.pixel_y_um, 40);
  EXPECT_DOUBLE_EQ(info.grid.layer_um, 50);
  EXPECT_EQ(info.orientation, (Orientation{false, true, false}));
  EXPECT_EQ(info.profiles.printer, "Printer 8K");
  EXPECT_EQ(info.profiles.material, "Grey");
  EXPECT_EQ(info.program, "Tango 2.1");
  EXPECT_EQ(info.exposure_s, 2.5);
  EXPECT_EQ(info.bottom_exposure_s, 20);
  EXPECT_EQ(info.bottom_layers, 2);
  EXPECT_TRUE(info.layer_exposure_s.empty()) << "the times of layers say nothing else";
}

TEST_F(Vdt, TimesOfSingleLayers) {
  make(foreign(with("0.15, \"exposure_time\": 2.5", "0.15, \"exposure_time\": 7")));
  EXPECT_THAT(StackReader::read_info(folder_ / "a.vdt").layer_exposure_s,
              ElementsAre(20, 20, 7, 2.5));
  // A fade is one where it is one.
  make(foreign(with("0.15, \"exposure_time\": 2.5", "0.15, \"exposure_time\": 11.25")));
  const StackInfo info = StackReader::read_info(folder_ / "a.vdt");
  EXPECT_EQ(info.fade_layers, 1);
  EXPECT_TRUE(info.layer_exposure_s.empty());
}

TEST_F(Vdt, HeightsAndLightOfSingleLayers) {
  make(foreign(with("\"height\": 0.15", "\"height\": 0.18")));
  EXPECT_THAT(StackReader::read_info(folder_ / "a.vdt").layer_heights_um,
              ElementsAre(50, 50, 80, 20));
  make(foreign(with("\"exposure_time\": 2.5, \"light_pwm\": 200", "\"light_pwm\": 100")));
  EXPECT_THAT(StackReader::read_info(folder_ / "a.vdt").light_share,
              ElementsAre(200.0 / 255, 200.0 / 255, 100.0 / 255, 200.0 / 255));
}

TEST_F(Vdt, ImagesReplacedLeaveAllElseAsItWas) {
  const Entries before = foreign();
  make(before);
  StackInfo info = StackReader::read_info(folder_ / "a.vdt");
  const Images others = like(images_, 4, 12);
  for (const std::string name : {"b.vdt", "a.vdt"}) {
    test::write_stack(file(folder_ / name, "", folder_ / "a.vdt"), others, info);
    const Entries after = test::unzip(folder_ / name);
    ASSERT_EQ(names_of(after), names_of(before));
    for (std::size_t i = 0; i < before.size(); ++i) {
      const bool image = before[i].first.size() == 5 && before[i].first.ends_with(".png");
      EXPECT_EQ(after[i].second == before[i].second, !image) << before[i].first;
    }
    EXPECT_EQ(test::read_images(StackReader(folder_ / name, folder_.path())), others.slices);
  }
}

TEST_F(Vdt, AddedLayersAndOtherTimes) {
  make(foreign());
  StackInfo info = StackReader::read_info(folder_ / "a.vdt");
  info.exposure_s = 3;
  info.bottom_layers = 1;
  info.grid.layers = 6;
  const Images others = like(images_, 6, 13);
  test::write_stack(file(folder_ / "b.vdt", "", folder_ / "a.vdt"), others, info);
  Entries after = test::unzip(folder_ / "b.vdt");
  EXPECT_EQ(after.size(), 10u);
  EXPECT_EQ(after[8].first, "4.png");
  EXPECT_EQ(after[9].first, "5.png");
  EXPECT_EQ(test::entry(after, "thesis/notes.txt"), Bytes(5000, 'n'));
  Json expected = Json::parse(kVdtManifest);
  expected["print"]["exposure_time"] = 3.0;
  expected["print"]["bottom_layers"] = 1;
  for (int n : {1, 2, 3}) expected["layers"][static_cast<std::size_t>(n)]["exposure_time"] = 3.0;
  for (const double height : {0.25, 0.3}) {
    Json layer = expected["layers"][3];
    layer["height"] = height;
    expected["layers"].push_back(layer);
  }
  EXPECT_EQ(Json::parse(to_text(test::entry(after, "manifest.json"))).dump(2), expected.dump(2));
  const StackReader reader(folder_ / "b.vdt", folder_.path());
  EXPECT_EQ(test::read_images(reader), others.slices);
  EXPECT_EQ(reader.info().exposure_s, 3);
  EXPECT_EQ(reader.info().bottom_layers, 1);
}

TEST_F(Vdt, NewOnesSayEveryLayer) {
  StackInfo info = foreign_info({70, 30, 4, 47.25, 50, 33.3});
  info.orientation = {false, false, true};
  info.profiles = {"my printer", "my resin", ""};
  info.exposure_s = 2;
  info.layer_exposure_s = {9, 2, 4, 2};
  test::write_stack(folder_ / "part.vdt", like(images_, 4, 14), info);
  Entries entries = test::unzip(folder_ / "part.vdt");
  EXPECT_THAT(names_of(entries),
              ElementsAre("manifest.json", "Preview_FLT.png", "Preview_FLT_48.png", "0.png",
                          "1.png", "2.png", "3.png"));
  const Json json = Json::parse(to_text(test::entry(entries, "manifest.json")));
  EXPECT_EQ(json["file_version"], 1);
  EXPECT_EQ(json["machine"]["lcd_width"], 3.3075);
  EXPECT_EQ(json["machine"]["resolution_y"], 30);
  ASSERT_EQ(json["layers"].size(), 4u);
  EXPECT_EQ(json["layers"][2]["exposure_time"], 4);
  EXPECT_EQ(json["layers"][2]["height"], 0.0999);
  EXPECT_EQ(json["layers"][2]["light_pwm"], 255);
  EXPECT_FALSE(json["layers"][2].contains("lift_distance")) << "only the printer's owner knows";
  const GreyImage preview = decode_png(test::entry(entries, "Preview_FLT_48.png"), 48, 48, "", "");
  EXPECT_EQ(preview.width_px, 48);
  const StackInfo read = StackReader::read_info(folder_ / "part.vdt");
  EXPECT_EQ(read.grid.pixel_x_um, 47.25);
  EXPECT_EQ(read.grid.pixel_y_um, 50);
  EXPECT_EQ(read.grid.layer_um, 33.3);
  EXPECT_EQ(read.orientation, info.orientation);
  EXPECT_EQ(read.layer_exposure_s, info.layer_exposure_s);
  EXPECT_EQ(read.profiles.material, "my resin");
}

TEST_F(Vdt, ContinuousOnesNeitherLiftNorStayBrightOnRamps) {
  StackInfo info = test::info_of({70, 30, 4, 50, 50, 50});
  info.kind = StackKind::corrected;
  info.printer = Printer{"p", 70, 30, 50, 50, 8, 405, {{0, 0}, {255, 9}}, 0, 0, {}};
  info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 0, 0, 1, {}};
  info.process.emplace();
  info.process->speed_mm_h = 90;  // 2 s per slice
  info.process->ramp = Ramp::lamp_follows;
  info.process->ramp_mm = 0.1;
  Notices notices;
  test::write_stack(folder_ / "part.vdt", like(images_, 4, 15), info, notices.context);
  EXPECT_THAT(notices.all(), HasSubstr("platform moves"));
  Entries entries = test::unzip(folder_ / "part.vdt");
  const Json json = Json::parse(to_text(test::entry(entries, "manifest.json")));
  EXPECT_EQ(json["print"]["lift_distance"], 0);
  // The middle of slices 0 and 3 is at a quarter of the ramp, where the speed is half of the full
  // one: twice the time, half the light.
  for (int n = 0; n < 4; ++n) {
    const Json& layer = json["layers"][static_cast<std::size_t>(n)];
    const SliceLight light = slice_light(*info.process, 1, 50, n, 4);
    EXPECT_EQ(layer["lift_distance"], 0);
    EXPECT_EQ(layer["exposure_time"], light.time_s);
    EXPECT_EQ(layer["light_pwm"], std::lround(255 * light.share));
  }
  EXPECT_EQ(json["layers"][0]["exposure_time"], 4);
  EXPECT_EQ(json["layers"][0]["light_pwm"], 128);
}

TEST_F(Vdt, Damages) {
  Entries entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first == "1.png"; });
  expect_refused(make(entries), "2.png: follows a gap: image 1 is missing");
  entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first == "3.png"; });
  expect_refused(make(entries), "manifest.json: lists 4 layers, but there are 3 images");
  entries = foreign();
  entries.emplace_back("01.png", png_of(images_, 1));
  expect_refused(make(entries), "has the number of another image");
  entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first.size() == 5; });
  expect_refused(make(entries), "has no layer images, expected 0.png on");
  entries = foreign();
  test::entry(entries, "2.png") = encode_png({71, 30, Bytes(71 * 30)});
  expect_refused(make(entries), "2.png");
  test::entry(entries, "2.png") = to_bytes("no picture");
  expect_refused(make(entries), "2.png");

  expect_manifest_refused("\"file_version\": 1,", "\"file_version\": 1,,", "not valid JSON");
  expect_manifest_refused("\"layers\": [", "\"layers\": 5, \"x\": [", "layers is 5");
  expect_manifest_refused("\"layers\": [", "\"Layers\": [", "layers is missing");
  expect_manifest_refused("\"layers\": [", "\"layers\": [7, ", "layers");
  expect_manifest_refused("\"machine\": {", "\"machine\": 5, \"m\": {", "machine is 5");
  expect_manifest_refused("\"print\": {", "\"prints\": {", "print is missing");
  expect_manifest_refused("\"resolution_x\": 70", "\"resolution_x\": 71", "expected 71 x 30");
  expect_manifest_refused("\"resolution_x\": 70", "\"resolution_x\": -70", "resolution_x is -70");
  expect_manifest_refused("\"resolution_x\": 70", "\"resolution_x\": 1e9", "65536");
  expect_manifest_refused("\"lcd_width\": 3.5", "\"lcd_width\": \"wide\"", "lcd_width");
  expect_manifest_refused("\"lcd_width\": 3.5", "\"lcd_width\": 3500", "1 to 1000 um");
  expect_manifest_refused("\"layer_thickness\": 0.05", "\"layer_thickness\": 50", "1 to 1000 um");
  expect_manifest_refused("\"layer_thickness\": 0.05", "\"layer_thickness\": -1", "-1");
  expect_manifest_refused("\"x_mirror\": true", "\"x_mirror\": 1", "true or false");
  expect_manifest_refused("\"bottom_layers\": 2", "\"bottom_layers\": 2.5", "whole");
  expect_manifest_refused(
      "\"exposure_time\": 20, \"light_pwm\": 200, \"lift_distance\": 6, \"mine\": 2",
      "\"exposure_time\": -2", "layers[1].exposure_time is -2");
  expect_manifest_refused("\"light_pwm\": 200, \"lift_distance\": 6, \"mine\": 3",
                          "\"light_pwm\": 256", "layers[2].light_pwm is 256");
  expect_refused(make(foreign(std::string(1 << 20, '['))), "JSON");
  expect_refused(make(foreign("")), "JSON");
}

// ---- VDA -----------------------------------------------------------------------------------

constexpr const char* kVdaManifest =
    "\xef\xbb\xbf<?xml version=\"1.0\" encoding=\"utf-8\"?>\r\n<!-- by hand -->\r\n<root>\r\n"
    "  <FileInfo><Version><Major>1</Major><Minor>2</Minor></Version><Written><By "
    "ApplicationName=\"Additive\" ApplicationVersion=\"4\" new='&amp;' /></Written></FileInfo>\r\n"
    "  <Slices>\r\n    <thickness>0.05</thickness>\r\n    <startHeight>0.05</startHeight>\r\n"
    "    <endHeight>0.15</endHeight>\r\n    <layersCount>3</layersCount>\r\n  </Slices>\r\n"
    "  <Machines>\r\n    <Resolution>70*30P</Resolution>\r\n    "
    "<PixelXSize>47.25um</PixelXSize>\r\n"
    "    <PixelYSize>50um</PixelYSize>\r\n    <XLength>3.31</XLength>\r\n    "
    "<YWidth>1.5</YWidth>\r\n"
    "    <Unknown a=\"b\">  <![CDATA[<x>]]> </Unknown>\r\n  </Machines>\r\n"
    "  <Layers>\r\n"
    "    "
    "<VDALayer><Index>0</Index><zvalue>0.05</zvalue><filename>0001.png</filename></VDALayer>\r\n"
    "    <VDALayer><Index>1</Index><zvalue>0.1</zvalue><filename>0002.png</filename></VDALayer>\r\n"
    "    "
    "<VDALayer><Index>2</Index><zvalue>0.15</zvalue><filename>0003.png</filename></VDALayer>\r\n"
    "  </Layers>\r\n</root>\r\n";

class Vda : public testing::Test {
 protected:
  Entries foreign(const std::string& manifest = kVdaManifest) const {
    return {{"0002.png", png_of(images_, 1)},
            {"readme", to_bytes("read me")},
            {"0001.png", png_of(images_, 0)},
            {"part.xml", to_bytes(manifest)},
            {"0003.png", png_of(images_, 2)}};
  }
  std::string make(const Entries& entries) {
    test::make_zip(folder_ / "a.zip", entries);
    return folder_ / "a.zip";
  }
  std::string with(const std::string& from, const std::string& to) const {
    std::string text = kVdaManifest;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  }
  void expect_manifest_refused(const std::string& from, const std::string& to,
                               const std::string& expected) {
    SCOPED_TRACE(to);
    expect_refused(make(foreign(with(from, to))), expected);
  }
  TemporaryFolder folder_;
  Images images_ = stamped_images(70, 30, 3, 21);
};

TEST_F(Vda, SaysWhatItIs) {
  const StackReader reader(make(foreign()), folder_.path());
  const StackInfo& info = reader.info();
  EXPECT_EQ(test::read_images(reader), images_.slices);
  EXPECT_EQ(info.format, "vda");
  EXPECT_EQ(info.kind, StackKind::foreign);
  EXPECT_EQ(info.grid.layers, 3);
  EXPECT_EQ(info.grid.pixel_x_um, 47.25) << "and not what the rounded length makes";
  EXPECT_EQ(info.grid.pixel_y_um, 50);
  EXPECT_EQ(info.grid.layer_um, 50);
  EXPECT_EQ(info.program, "Additive 4");
  EXPECT_EQ(info.exposure_s, 0);
  EXPECT_TRUE(info.layer_exposure_s.empty());
  EXPECT_THAT(reader.other_entries(), ElementsAre("part.xml", "readme"));
}

TEST_F(Vda, LengthCountsWhenTheyDisagree) {
  Notices notices;
  make(foreign(with("47.25um", "50um")));
  const StackReader reader(folder_ / "a.zip", folder_.path(), notices.context);
  EXPECT_NEAR(reader.grid().pixel_x_um, 3310.0 / 70, 1e-6);
  EXPECT_THAT(notices.all(), HasSubstr("PixelXSize 50 um"));
  make(foreign(with("<PixelXSize>47.25um</PixelXSize>", "")));
  EXPECT_NEAR(StackReader::read_info(folder_ / "a.zip").grid.pixel_x_um, 3310.0 / 70, 1e-6);
}

TEST_F(Vda, ImagesReplacedLeaveAllElseAsItWas) {
  const Entries before = foreign();
  make(before);
  const StackInfo info = StackReader::read_info(folder_ / "a.zip");
  const Images others = like(images_, 3, 22);
  for (const std::string name : {"b.zip", "a.zip"}) {
    test::write_stack(file(folder_ / name, "vda", folder_ / "a.zip"), others, info);
    const Entries after = test::unzip(folder_ / name);
    ASSERT_EQ(names_of(after), names_of(before));
    for (std::size_t i = 0; i < before.size(); ++i) {
      EXPECT_EQ(after[i].second == before[i].second, !before[i].first.ends_with(".png"))
          << before[i].first;
    }
    EXPECT_EQ(test::read_images(StackReader(folder_ / name, folder_.path())), others.slices);
  }
}

TEST_F(Vda, AddedLayersChangeNothingElseInTheManifest) {
  make(foreign());
  StackInfo info = StackReader::read_info(folder_ / "a.zip");
  info.grid.layers = 5;
  const Images others = like(images_, 5, 23);
  test::write_stack(file(folder_ / "b.zip", "vda", folder_ / "a.zip"), others, info);
  Entries after = test::unzip(folder_ / "b.zip");
  ASSERT_EQ(after.size(), 7u);
  EXPECT_EQ(after[5].first, "0004.png");
  EXPECT_EQ(after[6].first, "0005.png");
  std::string expected = with("<layersCount>3<", "<layersCount>5<");
  const auto replace = [&](const std::string& from, const std::string& to) {
    const std::size_t at = expected.find(from);
    ASSERT_NE(at, std::string::npos);
    expected.replace(at, from.size(), to);
  };
  replace("<endHeight>0.15<", "<endHeight>0.25<");
  const std::string layer =
      "    "
      "<VDALayer><Index>2</Index><zvalue>0.15</zvalue><filename>0003.png</filename></VDALayer>\r\n";
  replace(
      layer,
      layer +
          "    "
          "<VDALayer><Index>3</Index><zvalue>0.2</zvalue><filename>0004.png</filename></VDALayer>\r\n "
          "   "
          "<VDALayer><Index>4</Index><zvalue>0.25</zvalue><filename>0005.png</filename></VDALayer>\r\n");
  // Readers take both ways to write it alike.
  replace("new='&amp;' />", "new=\"&amp;\"/>");
  EXPECT_EQ(to_text(test::entry(after, "part.xml")), expected);
  EXPECT_EQ(test::read_images(StackReader(folder_ / "b.zip", folder_.path())), others.slices);
}

TEST_F(Vda, NewOnesAreWhatUvtoolsWrites) {
  StackInfo info = foreign_info({70, 30, 3, 47.25, 50, 25});
  info.exposure_s = 3;
  info.orientation.mirror_x = true;
  Notices notices;
  test::write_stack(file(folder_ / "part 1.zip", "vda"), like(images_, 3, 24), info,
                    notices.context);
  EXPECT_THAT(notices.all(), HasSubstr("no exposure times: the printer must be set to 3 s"));
  EXPECT_THAT(notices.all(), HasSubstr("mirrored"));
  Entries entries = test::unzip(folder_ / "part 1.zip");
  EXPECT_THAT(names_of(entries), ElementsAre("part 1.xml", "0001.png", "0002.png", "0003.png"));
  EXPECT_EQ(to_text(test::entry(entries, "part 1.xml")), R"(<?xml version="1.0" encoding="utf-8"?>
<root>
  <FileInfo>
    <Version>
      <Major>1</Major>
      <Minor>2</Minor>
    </Version>
    <Written>
      <By ApplicationName="slicecorr" ApplicationVersion="slicecorr test" />
      <When>1980-01-01 00:00:00Z</When>
    </Written>
  </FileInfo>
  <Slices>
    <Count>1</Count>
    <thickness>0.025</thickness>
    <startHeight>0.025</startHeight>
    <endHeight>0.075</endHeight>
    <layersCount>3</layersCount>
  </Slices>
  <Machines>
    <FileType>ZIP File</FileType>
    <Resolution>70*30P</Resolution>
    <PixelXSize>47.25um</PixelXSize>
    <PixelYSize>50um</PixelYSize>
    <Anti-Aliasing>1</Anti-Aliasing>
    <XLength>3.3075</XLength>
    <YWidth>1.5</YWidth>
    <ZHeight>0</ZHeight>
  </Machines>
  <Layers>
    <VDALayer>
      <Index>0</Index>
      <zvalue>0.025</zvalue>
      <filename>0001.png</filename>
    </VDALayer>
    <VDALayer>
      <Index>1</Index>
      <zvalue>0.05</zvalue>
      <filename>0002.png</filename>
    </VDALayer>
    <VDALayer>
      <Index>2</Index>
      <zvalue>0.075</zvalue>
      <filename>0003.png</filename>
    </VDALayer>
  </Layers>
</root>
)");
  const StackInfo read = StackReader::read_info(folder_ / "part 1.zip");
  EXPECT_EQ(read.grid.pixel_x_um, 47.25);
  EXPECT_EQ(read.grid.layer_um, 25);
}

TEST_F(Vda, Damages) {
  Entries entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first == "0002.png"; });
  expect_refused(make(entries), "0003.png: follows a gap: image 2 is missing");
  entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first == "0001.png"; });
  expect_refused(make(entries), "0002.png: follows a gap: image 1 is missing");
  entries = foreign();
  entries.emplace_back("3.png", png_of(images_, 1));
  expect_refused(make(entries), "has the number of another image");
  entries = foreign();
  entries.emplace_back("0000.png", png_of(images_, 1));
  expect_refused(make(entries), "0000.png");
  entries = foreign();
  entries.emplace_back("0004.png", png_of(images_, 1));
  expect_refused(make(entries), "part.xml: says 3 layers, but there are 4 images");

  expect_refused(make(foreign("")), "part.xml");
  expect_refused(make(foreign("<root>")), "not valid XML");
  expect_refused(make(foreign("<other/>")), "expected <root> with <Slices> and <Machines>");
  expect_manifest_refused("</Slices>", "</Slice>", "not valid XML");
  expect_manifest_refused("<layersCount>3<", "<layersCount>4<", "says 4 layers");
  expect_manifest_refused("<layersCount>3<", "<layersCount><", "layersCount is empty");
  expect_manifest_refused("<layersCount>3<", "<layersCount>-3<", "layersCount is -3");
  expect_manifest_refused("<layersCount>3<", "<layersCount>1e7<", "1000000");
  expect_manifest_refused("<layersCount>3<", "<layersCount>2.5<", "whole");
  expect_manifest_refused("<layersCount>3</layersCount>", "", "layersCount is missing");
  expect_manifest_refused("<thickness>0.05<", "<thickness>thin<", "thickness is thin");
  expect_manifest_refused("<thickness>0.05<", "<thickness>50<", "1 to 1000 um");
  expect_manifest_refused("70*30P", "70x30", "expected WIDTH*HEIGHTP");
  expect_manifest_refused("70*30P", "71*30P", "expected 71 x 30");
  expect_manifest_refused("70*30P", "nan*30P", "Resolution is nan");
  expect_manifest_refused("47.25um", "wide", "PixelXSize is wide");
  expect_manifest_refused("<XLength>3.31<", "<XLength>3.31mm<", "XLength is 3.31mm");
  expect_manifest_refused("<filename>0002.png<", "<filename>0003.png<",
                          "layer 1 is 0003.png, expected 0002.png");
  expect_manifest_refused("<filename>0002.png</filename>", "", "layer 1 is 0003.png");
}

}  // namespace
}  // namespace slicecorr
