// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Ember archives: new ones, changed ones, damaged ones, real ones, and what is refused by name.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "foreign_fixture.hpp"
#include "real_files.hpp"
#include "tar_fixture.hpp"

namespace slicecorr {
namespace {

using Json = nlohmann::ordered_json;
using test::Entries;
using test::expect_refused;
using test::file;
using test::foreign_info;
using test::Images;
using test::kFacts;
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

// ---- Ember ---------------------------------------------------------------------------------

constexpr const char* kEmberSettings =
    "{ \"Settings\": { \"JobName\": \"cube\", \"LayerThicknessMicrons\": 25,\n"
    "  \"FirstExposureSec\": 5.5, \"BurnInLayers\": 2, \"BurnInExposureSec\": 4,\n"
    "  \"ModelExposureSec\": 1.5, \"ModelSeparationRPM\": 12 }, \"Other\": [1] }";

class Ember : public testing::Test {
 protected:
  Entries foreign(const std::string& settings = kEmberSettings, int layers = 5) const {
    Entries entries{{"notes", to_bytes("mine")}};
    for (int n : {1, 0, 4, 2, 3}) {
      if (n >= layers) continue;
      entries.emplace_back("slice_" + std::to_string(n + 1) + ".png",
                           png_of(images_, static_cast<std::size_t>(n)));
    }
    if (!settings.empty()) entries.emplace_back("printsettings", to_bytes(settings));
    return entries;
  }
  std::string make(const Entries& entries) {
    test::make_zip(folder_ / "a.zip", entries);
    return folder_ / "a.zip";
  }
  StackInfo info_with(const std::string& settings, const std::string& csv = "") {
    Entries entries = foreign(settings);
    if (!csv.empty()) entries.emplace_back("layersettings.csv", to_bytes(csv));
    return StackReader::read_info(make(entries));
  }
  TemporaryFolder folder_;
  Images images_ = stamped_images(70, 30, 5, 31);
};

TEST_F(Ember, SaysWhatItIs) {
  const StackReader reader(make(foreign()), folder_.path(), {}, kFacts);
  const StackInfo& info = reader.info();
  EXPECT_EQ(test::read_images(reader), images_.slices);
  EXPECT_EQ(info.format, "ember");
  EXPECT_EQ(info.grid.layer_um, 25);
  EXPECT_EQ(info.grid.pixel_x_um, kFacts.pixel_x_um) << "not the Ember's display";
  EXPECT_EQ(info.profiles.print, "cube");
  // Layer 1, then two burn-in layers, then the model.
  EXPECT_EQ(info.exposure_s, 1.5);
  EXPECT_THAT(info.layer_exposure_s, ElementsAre(5.5, 4, 4, 1.5, 1.5));
}

TEST_F(Ember, ItsDisplayHasPixelsOf50Micrometres) {
  const Images images = test::random_images(1280, 800, 2, 32);
  test::make_zip(folder_ / "a.zip",
                 {{"slice_1.png", png_of(images, 0)}, {"slice_2.png", png_of(images, 1)}});
  const StackInfo info = StackReader::read_info(folder_ / "a.zip");
  EXPECT_EQ(info.grid.pixel_x_um, 50);
  EXPECT_EQ(info.grid.pixel_y_um, 50);
  EXPECT_EQ(info.grid.layer_um, 0) << "the printer's own setting, which nobody knows";
}

TEST_F(Ember, Exposures) {
  const auto settings = [](const std::string& values) {
    return "{\"Settings\":{\"LayerThicknessMicrons\":25" + values + "}}";
  };
  StackInfo info = info_with(settings(
      ",\"FirstExposureSec\":4,\"BurnInLayers\":1,\"BurnInExposureSec\":4,\"ModelExposureSec\":2"));
  EXPECT_EQ(info.bottom_exposure_s, 4);
  EXPECT_EQ(info.bottom_layers, 2);
  EXPECT_EQ(info.exposure_s, 2);
  EXPECT_TRUE(info.layer_exposure_s.empty());
  // Without burn-in layers the first is the only one of its kind.
  info = info_with(settings(",\"FirstExposureSec\":4,\"ModelExposureSec\":2"));
  EXPECT_EQ(info.bottom_layers, 1);
  EXPECT_TRUE(info.layer_exposure_s.empty());
  info = info_with(settings(",\"ModelExposureSec\":\"2.5\""));
  EXPECT_EQ(info.exposure_s, 2.5) << "in quotes, as the first portal wrote it";
  EXPECT_EQ(info.bottom_layers, 0);
  info = info_with(settings(""));
  EXPECT_EQ(info.exposure_s, 0);
}

TEST_F(Ember, TimesOfSingleLayers) {
  for (const std::string end : {"\r\n", "\r", "\n"}) {
    const std::string csv = "Layer, ModelExposureSec ,FirstExposureSec,LayerThicknessMicrons" +
                            end + " a comment,3,3" + end + "5, 2.25,,50, more" + end + "1,9" + end +
                            "4" + end + "99,7" + end;
    Notices notices;
    Entries entries = foreign();
    entries.emplace_back("layersettings.csv", to_bytes(csv));
    const StackReader reader(make(entries), folder_.path(), notices.context, kFacts);
    // Layer 1 is no model layer, so that its ModelExposureSec says nothing.
    EXPECT_THAT(reader.info().layer_exposure_s, ElementsAre(5.5, 4, 4, 1.5, 2.25));
    EXPECT_THAT(reader.info().layer_heights_um, ElementsAre(25, 25, 25, 25, 50));
  }
}

TEST_F(Ember, ImagesReplacedLeaveAllElseAsItWas) {
  const Entries before = foreign();
  make(before);
  StackInfo info = StackReader::read_info(folder_ / "a.zip");
  info.grid.layers = 7;
  info.layer_exposure_s.insert(info.layer_exposure_s.end(), {1.5, 1.5});
  const Images others = like(images_, 7, 33);
  test::write_stack(file(folder_ / "a.zip", "ember", folder_ / "a.zip"), others, info);
  const Entries after = test::unzip(folder_ / "a.zip");
  ASSERT_EQ(after.size(), before.size() + 2);
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].first, before[i].first);
    EXPECT_EQ(after[i].second == before[i].second, !before[i].first.ends_with(".png"))
        << before[i].first;
  }
  EXPECT_EQ(after[7].first, "slice_6.png");
  EXPECT_EQ(after[8].first, "slice_7.png");
  EXPECT_EQ(test::read_images(StackReader(folder_ / "a.zip", folder_.path(), {}, kFacts)),
            others.slices);
}

TEST_F(Ember, AddedLayersGetTheTimeOfTheLast) {
  Entries before = foreign();
  before.emplace_back("layersettings.csv", to_bytes("Layer,ModelExposureSec\r\n5,3\r\n"));
  make(before);
  StackInfo info = StackReader::read_info(folder_ / "a.zip");
  EXPECT_THAT(info.layer_exposure_s, ElementsAre(5.5, 4, 4, 1.5, 3));
  info.grid.layers = 7;
  test::write_stack(file(folder_ / "b.zip", "ember", folder_ / "a.zip"), like(images_, 7, 37),
                    info);
  EXPECT_THAT(StackReader::read_info(folder_ / "b.zip").layer_exposure_s,
              ElementsAre(5.5, 4, 4, 1.5, 3, 3, 3));
  Entries after = test::unzip(folder_ / "b.zip");
  EXPECT_EQ(to_text(test::entry(after, "printsettings")), kEmberSettings);
  EXPECT_EQ(to_text(test::entry(after, "layersettings.csv")),
            "Layer,ModelExposureSec,FirstExposureSec,BurnInExposureSec\r\n5,3\r\n6,3,3,3\r\n"
            "7,3,3,3\r\n");
}

TEST_F(Ember, OtherExposuresInAKeptArchive) {
  make(foreign());
  StackInfo info = StackReader::read_info(folder_ / "a.zip");
  info.layer_exposure_s.clear();
  info.exposure_s = 2;
  info.bottom_exposure_s = 8;
  info.bottom_layers = 3;
  test::write_stack(file(folder_ / "b.zip", "ember", folder_ / "a.zip"), images_, info);
  Entries after = test::unzip(folder_ / "b.zip");
  EXPECT_EQ(names_of(after), names_of(foreign())) << "nothing is added";
  Json expected = Json::parse(kEmberSettings);
  expected["Settings"]["FirstExposureSec"] = 8;
  expected["Settings"]["BurnInExposureSec"] = 8;
  expected["Settings"]["ModelExposureSec"] = 2;
  EXPECT_EQ(Json::parse(to_text(test::entry(after, "printsettings"))), expected);
  // Times that the settings can't say go to the table, whose other columns stay.
  Entries before = foreign();
  before.emplace_back("layersettings.csv",
                      to_bytes("Layer,ModelApproachWaitMS\r\nsee below\r\n2,100\r\n"));
  make(before);
  info.layer_exposure_s = {1, 2, 3, 2, 2};
  test::write_stack(file(folder_ / "b.zip", "ember", folder_ / "a.zip"), images_, info);
  after = test::unzip(folder_ / "b.zip");
  EXPECT_EQ(to_text(test::entry(after, "layersettings.csv")),
            "Layer,ModelApproachWaitMS,FirstExposureSec,BurnInExposureSec,ModelExposureSec\r\n"
            "see below\r\n2,100,2,2,2\r\n1,,1,1,1\r\n3,,3,3,3\r\n4,,2,2,2\r\n5,,2,2,2\r\n");
  EXPECT_THAT(StackReader::read_info(folder_ / "b.zip").layer_exposure_s,
              ElementsAre(1, 2, 3, 2, 2));
}

TEST_F(Ember, NewOnesSayOnlyWhatThePrinterKnows) {
  StackInfo info = foreign_info({1280, 800, 3, 50, 50, 25});
  info.exposure_s = 2;
  info.bottom_exposure_s = 6;
  info.bottom_layers = 2;
  const Images images = [&] {
    Images i = test::random_images(1280, 800, 3, 34);
    i.grid = info.grid;
    return i;
  }();
  Notices notices;
  test::write_stack(file(folder_ / "my part.tar.gz", ""), images, info, notices.context);
  test::write_stack(file(folder_ / "my part.zip", "ember"), images, info, notices.context);
  EXPECT_EQ(notices.all(), "") << "all of it can be said";
  Entries zip = test::unzip(folder_ / "my part.zip");
  // The printer counts all PNGs of a tar.gz, so there may be no preview.
  EXPECT_THAT(names_of(zip),
              ElementsAre("printsettings", "slice_1.png", "slice_2.png", "slice_3.png"));
  const auto tar = test::read_tar_gz(folder_ / "my part.tar.gz");
  ASSERT_EQ(tar.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(tar[i].name, zip[i].first);
    EXPECT_EQ(tar[i].data, zip[i].second);
  }
  const Json json = Json::parse(to_text(zip[0].second));
  EXPECT_EQ(json, Json::parse(R"({"Settings":{"JobName":"my part","LayerThicknessMicrons":25,
      "FirstExposureSec":6.0,"BurnInLayers":1,"BurnInExposureSec":6.0,"ModelExposureSec":2.0}})"));
  // Types must be those of the firmware's defaults, or the printer refuses the archive.
  EXPECT_TRUE(json["Settings"]["LayerThicknessMicrons"].is_number_integer());
  EXPECT_TRUE(json["Settings"]["BurnInLayers"].is_number_integer());
  const StackReader reader(folder_ / "my part.tar.gz", folder_.path());
  EXPECT_EQ(reader.info().format, "ember-tar");
  EXPECT_EQ(reader.info().grid.pixel_x_um, 50);
  EXPECT_EQ(reader.info().bottom_layers, 2);
  EXPECT_EQ(reader.info().bottom_exposure_s, 6);
  EXPECT_EQ(test::read_images(reader), images.slices);
}

TEST_F(Ember, NewOnesTellWhatIsLost) {
  StackInfo info = foreign_info({70, 30, 5, 50, 40, 33.3});
  info.exposure_s = 2;
  info.layer_exposure_s = {8, 6, 4, 3, 5};
  Notices notices;
  test::write_stack(file(folder_ / "a.tar.gz", ""), like(images_, 5, 35), info, notices.context);
  EXPECT_THAT(notices.all(), HasSubstr("1280 x 800 pixels of 50 um, this stack has 70 x 30"));
  EXPECT_THAT(notices.all(), HasSubstr("33.3 um become 33 um"));
  EXPECT_THAT(StackReader::read_info(folder_ / "a.tar.gz").layer_exposure_s,
              ElementsAre(8, 6, 4, 3, 5));
}

TEST_F(Ember, TarGzKeepsEverythingElse) {
  std::vector<test::TarEntry> before{{"./", {}, '5', 0755, 1000, 1000, 1400000000, "jane", "jane"}};
  long time = 1400000001;
  for (const auto& [name, data] : foreign()) {
    before.push_back({"./" + name, data, '0', 0640, 1000, 1000, time++, "jane", "jane"});
  }
  test::make_tar_gz(folder_ / "a.tar.gz", before);
  const StackInfo info = StackReader::read_info(folder_ / "a.tar.gz");
  EXPECT_EQ(info.format, "ember-tar");
  const Images others = like(images_, 5, 36);
  test::write_stack(file(folder_ / "a.tar.gz", "", folder_ / "a.tar.gz"), others, info);
  auto after = test::read_tar_gz(folder_ / "a.tar.gz");
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) {
    if (before[i].name.ends_with(".png")) {
      EXPECT_NE(after[i].data, before[i].data);
      after[i].data = before[i].data;
    }
    EXPECT_EQ(after[i], before[i]) << before[i].name;
  }
  EXPECT_EQ(test::read_images(StackReader(folder_ / "a.tar.gz", folder_.path(), {}, kFacts)),
            others.slices);
}

TEST_F(Ember, Damages) {
  Entries entries = foreign();
  std::erase_if(entries, [](const auto& e) { return e.first == "slice_3.png"; });
  expect_refused(make(entries), "slice_4.png: follows a gap: image 3 is missing");
  entries = foreign();
  entries.emplace_back("slice_04.png", png_of(images_, 1));
  expect_refused(make(entries), "has the number of another image");
  entries = foreign();
  entries.emplace_back("slice_0.png", png_of(images_, 1));
  expect_refused(make(entries), "slice_0.png");
  expect_refused(make({{"printsettings", to_bytes(kEmberSettings)}}),
                 "has no layer images, expected slice_1.png on");
  const auto refused = [&](const std::string& settings, const std::string& expected) {
    SCOPED_TRACE(settings);
    expect_refused(make(foreign(settings)), expected);
  };
  refused("{", "printsettings: is not valid JSON");
  refused("{}", "Settings is missing");
  refused("[]", "the file is a list, expected an object");
  refused("{\"Settings\":5}", "Settings is 5");
  refused("{\"Settings\":{\"LayerThicknessMicrons\":0}}", "LayerThicknessMicrons is 0");
  refused("{\"Settings\":{\"LayerThicknessMicrons\":\"thin\"}}",
          "LayerThicknessMicrons is \"thin\"");
  refused("{\"Settings\":{\"LayerThicknessMicrons\":2000}}", "1000");
  refused("{\"Settings\":{\"ModelExposureSec\":-1}}", "ModelExposureSec is -1");
  refused("{\"Settings\":{\"ModelExposureSec\":null}}", "ModelExposureSec is null");
  refused("{\"Settings\":{\"BurnInLayers\":1.5}}", "whole");
  refused("{\"Settings\":{\"JobName\":5}}", "JobName is 5, expected a text");
  const auto table_refused = [&](const std::string& csv, const std::string& expected) {
    SCOPED_TRACE(csv);
    Entries e = foreign();
    e.emplace_back("layersettings.csv", to_bytes(csv));
    expect_refused(make(e), expected);
  };
  table_refused("Layer,A,A\n1,2,3\n", "layersettings.csv: has two columns named A");
  table_refused("Layer,A\n2,2\n3,1\n2,3\n", "has two rows for layer 2");
  table_refused("Layer,ModelExposureSec\n4,long\n", "ModelExposureSec of layer 4 is long");
  table_refused("Layer,ModelExposureSec\n4,-2\n", "ModelExposureSec of layer 4 is -2");
}

std::string sample(const std::string& name) { return test::real_file("slices/" + name); }

TEST(RealFiles, EmberArchives) {
  SLICECORR_NEEDS_FILE(sample("ember/print.zip"));
  const TemporaryFolder folder;
  const StackReader zip(sample("ember/print.zip"), folder.path());
  EXPECT_EQ(zip.info().format, "ember");
  EXPECT_EQ(zip.grid().layers, 2);
  EXPECT_EQ(zip.grid().width_px, 1280);
  EXPECT_EQ(zip.grid().height_px, 800);
  EXPECT_EQ(zip.grid().pixel_x_um, 50);
  EXPECT_EQ(zip.grid().layer_um, 10);
  EXPECT_EQ(zip.info().profiles.print, "MyPrintJob");
  EXPECT_GT(zip.pixel_sum(), 0u);
  const StackReader tar(sample("ember/print.tar.gz"), folder.path());
  EXPECT_EQ(tar.info().format, "ember-tar");
  const auto slices = test::read_images(zip);
  EXPECT_EQ(test::read_images(tar), slices);
  // Damaged ones: each says what is wrong.
  expect_refused(sample("ember/corrupt.zip"), "not a sound zip archive");
  expect_refused(sample("ember/print_naming_gap.zip"), "slice_3.png: follows a gap: image 2 is");
  expect_refused(sample("ember/print_no_slices.zip"), "has no layer images, expected slice_1.png");

  // Changed: everything else stays.
  Images images{zip.grid(), slices};
  std::reverse(images.slices[0].begin(), images.slices[0].end());
  const std::string changed = folder / "print.tar.gz";
  test::write_stack(file(changed, "", sample("ember/print.tar.gz")), images, tar.info());
  const auto before =
      test::parse_tar(test::gunzip(test::read_file(sample("ember/print.tar.gz"))), true);
  auto after = test::read_tar_gz(changed);
  ASSERT_EQ(after.size(), 3u);
  EXPECT_EQ(after[0], before[0]);
  for (const std::size_t i : {1u, 2u}) {
    after[i].data = before[i].data;
    EXPECT_EQ(after[i], before[i]);
  }
  EXPECT_EQ(test::read_images(StackReader(changed, folder.path())), images.slices);
}

TEST(RealFiles, NordinPrintFilesAreRefusedByName) {
  const std::string example = sample("nordin/schema_v5_example.zip");
  SLICECORR_NEEDS_FILE(example);
  expect_refused(example,
                 "example.json: is a JSON print file of the Nordin group (schema version 5.0.0): "
                 "each of its layers is a list of images");
  expect_refused(sample("nordin/190219_mzi_serpentine_v2.zip"),
                 "Nordin group (schema version 0.2)");
}

}  // namespace
}  // namespace slicecorr
