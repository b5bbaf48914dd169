// VDT, VDA, Ember archives and folders of images: new ones, changed ones, damaged ones, real ones.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tar_fixture.hpp"

namespace slicecorr {
namespace {

using Json = nlohmann::ordered_json;
using test::Bytes;
using test::Entries;
using test::Images;
using test::TemporaryFolder;
using test::to_bytes;
using test::to_text;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr MissingFacts facts{50, 40, 25};

Bytes png_of(const Images& images, std::size_t n) {
  return encode_png({images.grid.width_px, images.grid.height_px, images.slices[n]});
}

void expect_refused(const std::string& path, const std::string& expected) {
  SCOPED_TRACE(expected);
  try {
    const StackReader reader(path, std::filesystem::temp_directory_path(), {}, facts);
    FAIL() << "read, expected an error with: " << expected;
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr(path));
    EXPECT_THAT(error.what(), HasSubstr(expected));
  }
}

/// What a job is told.
struct Notices {
  std::vector<std::string> texts;
  Job job;
  Notices() {
    job.notice = [this](const std::string& text) { texts.push_back(text); };
  }
  std::string all() const {
    std::string all;
    for (const std::string& text : texts) all += text + "\n";
    return all;
  }
};

/// A stack of another program: nothing of ours is in the archive.
StackInfo foreign_info(const Grid& grid) {
  StackInfo info = test::info_of(grid);
  info.kind = StackKind::foreign;
  return info;
}

/// Makes every slice different from those of other seeds.
void stamp(Images& images, unsigned seed) {
  for (Bytes& slice : images.slices) slice[0] = static_cast<std::uint8_t>(seed);
}

Images stamped_images(int width, int height, int layers, unsigned seed) {
  Images images = test::random_images(width, height, layers, seed);
  stamp(images, seed);
  return images;
}

Images like(const Images& images, int layers, unsigned seed) {
  Images other = test::random_images(images.grid.width_px, images.grid.height_px, layers, seed);
  Grid grid = images.grid;
  grid.layers = layers;
  other.grid = grid;
  stamp(other, seed);
  return other;
}

StackFile file(const std::string& path, const std::string& format,
               const std::string& keep_from = "") {
  StackFile f(path);
  f.format = format;
  f.keep_from = keep_from;
  return f;
}

std::vector<std::string> names_of(const Entries& entries) {
  std::vector<std::string> names;
  for (const auto& [name, data] : entries) names.push_back(name);
  return names;
}

// ---- new archives of all formats -----------------------------------------------------------

struct Case {
  std::string format, path;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.format; }

class NewArchive : public testing::TestWithParam<Case> {};

TEST_P(NewArchive, IsReadBackAsItWas) {
  const TemporaryFolder folder;
  const Images images = test::random_images(70, 30, 12, 3);
  for (const StackKind kind : {StackKind::target, StackKind::corrected}) {
    StackInfo info = test::info_of(images.grid);
    info.kind = kind;
    info.part_volume_mm3 = 4.25;
    if (kind == StackKind::corrected) {
      info.printer = Printer{"p", 70, 30, 40.5, 1000.0 / 30, 8, 405, {{0, 0}, {255, 9}}, 0, 0, {}};
      info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 1, {}};
      info.process.emplace();
      info.process->speed_mm_h = 10;
      info.target_layers = 10;
    }
    const std::string path = folder / GetParam().path;
    std::filesystem::remove_all(path);
    test::write_stack(file(path, GetParam().format), images, info);
    const StackReader reader(path, folder.path());
    const StackInfo& read = reader.info();
    EXPECT_EQ(test::read_images(reader), images.slices);
    EXPECT_EQ(read.format, GetParam().format);
    EXPECT_EQ(read.kind, kind);
    EXPECT_EQ(read.grid.layers, 12);
    // Of Ember archives only whole micrometres are left, which was told.
    const bool rounded = GetParam().format.starts_with("ember");
    EXPECT_EQ(read.grid.layer_um, rounded ? 33 : images.grid.layer_um);
    EXPECT_EQ(read.grid.pixel_x_um, images.grid.pixel_x_um);
    EXPECT_EQ(read.grid.pixel_y_um, images.grid.pixel_y_um);
    EXPECT_EQ(read.target_layers, info.target_layers);
    EXPECT_EQ(read.part_volume_mm3, 4.25);
    EXPECT_EQ(read.printer, info.printer);
    EXPECT_EQ(read.resin, info.resin);
    EXPECT_EQ(read.process, info.process);
    EXPECT_EQ(StackReader::read_info(path).format, GetParam().format);
    EXPECT_EQ(folder.count(), 1) << "something is left over";
  }
}

TEST_P(NewArchive, IsTheSameEachTime) {
  const TemporaryFolder folder;
  const Images images = test::random_images(40, 50, 5, 4);
  std::vector<Bytes> written[2];
  for (int i = 0; i < 2; ++i) {
    const std::string sub = folder / std::to_string(i);
    std::filesystem::create_directory(sub);
    const std::string path = sub + "/" + GetParam().path;
    Job job;
    job.threads = 1 + i;
    test::write_stack(file(path, GetParam().format), images, test::info_of(images.grid), job);
    if (std::filesystem::is_directory(path)) {
      std::vector<std::string> files;
      for (const auto& e : std::filesystem::directory_iterator(path)) files.push_back(e.path());
      std::sort(files.begin(), files.end());
      EXPECT_EQ(files.size(), 6u);
      for (const std::string& f : files) written[i].push_back(test::read_file(f));
    } else {
      written[i].push_back(test::read_file(path));
    }
  }
  EXPECT_EQ(written[0], written[1]);
}

INSTANTIATE_TEST_SUITE_P(Formats, NewArchive,
                         testing::Values(Case{"vdt", "a.vdt"}, Case{"vda", "a.zip"},
                                         Case{"ember", "a.zip"}, Case{"ember-tar", "a.tar.gz"},
                                         Case{"folder", "a"}),
                         [](const auto& info) {
                           std::string name = info.param.format;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(NewArchive, ImagesInUvLightAreKeptBesideTheSlices) {
  const TemporaryFolder folder;
  const Images images = stamped_images(40, 50, 3, 5);
  StackInfo info = test::info_of(images.grid);
  info.kind = StackKind::corrected;
  info.printer = Printer{
      "p", 40, 50, 50, 50, 8, 405, {{0, 0}, {255, 9}}, 0, 0, UvLamp{365, true, {{0, 0}, {255, 9}}}};
  info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 1, {}};
  info.resin->inhibition = Inhibition{0.7, 30, 1, 0};
  info.process.emplace();
  info.process->speed_mm_h = 10;
  info.process->uv.kind = UvKind::patterned;
  info.process->uv.dead_zone_um = 50;
  const std::string path = folder / GetParam().path;
  {
    StackWriter writer(file(path, GetParam().format), images.grid, {});
    std::array<std::uint8_t, 256> inverse;
    for (std::size_t v = 0; v < 256; ++v) inverse[v] = static_cast<std::uint8_t>(255 - v);
    writer.set_uv_pattern(inverse);
    StackWriter::BandEncoder encoder(writer, 0, 50);
    for (int n = 0; n < 3; ++n) {
      encoder.put(n, 0, 40, images.slices[static_cast<std::size_t>(n)].data());
    }
    writer.finish(info, {});
  }
  Notices notices;
  const StackReader reader(path, folder.path(), notices.job);
  EXPECT_EQ(test::read_images(reader), images.slices);
  EXPECT_EQ(reader.info().process->uv, info.process->uv);
  EXPECT_EQ(notices.all().find("UV images were changed"), std::string::npos) << notices.all();
}

TEST(FormatNames, EndingsChoose) {
  EXPECT_EQ(format_of("a.vdt"), "vdt");
  EXPECT_EQ(format_of("a.TAR.GZ"), "ember-tar");
  EXPECT_EQ(format_of("a.tgz"), "ember-tar");
  EXPECT_EQ(format_of("some.where/"), "folder");
  EXPECT_EQ(format_of(file("a.zip", "vda")), "vda");
}

// ---- VDT -----------------------------------------------------------------------------------

constexpr const char* vdt_manifest = R"({
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
  Entries foreign(const std::string& manifest = vdt_manifest) const {
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
    std::string text = vdt_manifest;
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

TEST_F(Vdt, TellsWhatItCantTakeIn) {
  Notices notices;
  make(foreign(with("\"height\": 0.15", "\"height\": 0.18")));
  (void)StackReader(folder_ / "a.vdt", folder_.path(), notices.job);
  EXPECT_THAT(notices.all(), HasSubstr("layer 2 is 80 um high, others 50 um"));
  notices.texts.clear();
  make(foreign(with("\"exposure_time\": 2.5, \"light_pwm\": 200", "\"light_pwm\": 100")));
  (void)StackReader(folder_ / "a.vdt", folder_.path(), notices.job);
  EXPECT_THAT(notices.all(), HasSubstr("light_pwm is 200 in layer 0 and 100 in layer 2"));
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
  Json expected = Json::parse(vdt_manifest);
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
  info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 1, {}};
  info.process.emplace();
  info.process->speed_mm_h = 90;  // 2 s per slice
  info.process->ramp = Ramp::lamp_follows;
  info.process->ramp_mm = 0.1;
  Notices notices;
  test::write_stack(folder_ / "part.vdt", like(images_, 4, 15), info, notices.job);
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

constexpr const char* vda_manifest =
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
  Entries foreign(const std::string& manifest = vda_manifest) const {
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
    std::string text = vda_manifest;
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
  const StackReader reader(folder_ / "a.zip", folder_.path(), notices.job);
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
      "    <VDALayer><Index>2</Index><zvalue>0.15</zvalue><filename>0003.png"
      "</filename></VDALayer>\r\n";
  replace(layer, layer +
                     "    <VDALayer><Index>3</Index><zvalue>0.2</zvalue><filename>0004.png"
                     "</filename></VDALayer>\r\n    <VDALayer><Index>4</Index><zvalue>0.25</zvalue>"
                     "<filename>0005.png</filename></VDALayer>\r\n");
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
  test::write_stack(file(folder_ / "part 1.zip", "vda"), like(images_, 3, 24), info, notices.job);
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

// ---- Ember ---------------------------------------------------------------------------------

constexpr const char* ember_settings =
    "{ \"Settings\": { \"JobName\": \"cube\", \"LayerThicknessMicrons\": 25,\n"
    "  \"FirstExposureSec\": 5.5, \"BurnInLayers\": 2, \"BurnInExposureSec\": 4,\n"
    "  \"ModelExposureSec\": 1.5, \"ModelSeparationRPM\": 12 }, \"Other\": [1] }";

class Ember : public testing::Test {
 protected:
  Entries foreign(const std::string& settings = ember_settings, int layers = 5) const {
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
  const StackReader reader(make(foreign()), folder_.path(), {}, facts);
  const StackInfo& info = reader.info();
  EXPECT_EQ(test::read_images(reader), images_.slices);
  EXPECT_EQ(info.format, "ember");
  EXPECT_EQ(info.grid.layer_um, 25);
  EXPECT_EQ(info.grid.pixel_x_um, facts.pixel_x_um) << "not the Ember's display";
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
    const StackReader reader(make(entries), folder_.path(), notices.job, facts);
    // Layer 1 is no model layer, so that its ModelExposureSec says nothing.
    EXPECT_THAT(reader.info().layer_exposure_s, ElementsAre(5.5, 4, 4, 1.5, 2.25));
    EXPECT_THAT(notices.all(), HasSubstr("makes layer 5 50 um high, others 25 um"));
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
  EXPECT_EQ(test::read_images(StackReader(folder_ / "a.zip", folder_.path(), {}, facts)),
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
  EXPECT_EQ(to_text(test::entry(after, "printsettings")), ember_settings);
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
  Json expected = Json::parse(ember_settings);
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
  test::write_stack(file(folder_ / "my part.tar.gz", ""), images, info, notices.job);
  test::write_stack(file(folder_ / "my part.zip", "ember"), images, info, notices.job);
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
  test::write_stack(file(folder_ / "a.tar.gz", ""), like(images_, 5, 35), info, notices.job);
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
  EXPECT_EQ(test::read_images(StackReader(folder_ / "a.tar.gz", folder_.path(), {}, facts)),
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
  expect_refused(make({{"printsettings", to_bytes(ember_settings)}}),
                 "has no layer images, expected slice_1.png on");
  const auto refused = [&](const std::string& settings, const std::string& expected) {
    SCOPED_TRACE(settings);
    expect_refused(make(foreign(settings)), expected);
  };
  refused("{", "printsettings: not valid JSON");
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

std::string sample(const std::string& name) {
  return std::string(SLICECORR_TEST_DATA) + "/slices/" + name;
}

TEST(RealFiles, EmberArchives) {
  if (!std::filesystem::exists(sample("ember/print.zip"))) {
    GTEST_SKIP() << "no test data at " << sample("ember/print.zip");
  }
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
  if (!std::filesystem::exists(example)) GTEST_SKIP() << "no test data at " << example;
  expect_refused(example,
                 "example.json: is a JSON print file of the Nordin group (schema version "
                 "5.0.0): each of its layers is a list of images");
  expect_refused(sample("nordin/190219_mzi_serpentine_v2.zip"),
                 "Nordin group (schema version 0.2)");
}

// ---- folders -------------------------------------------------------------------------------

class ImageFolder : public testing::Test {
 protected:
  std::string make(const Entries& files) {
    std::filesystem::remove_all(folder_ / "in");
    std::filesystem::create_directory(folder_ / "in");
    for (const auto& [name, data] : files) {
      const std::string path = folder_ / ("in/" + name);
      std::filesystem::create_directories(std::filesystem::path(path).parent_path());
      test::write_file(path, data);
    }
    return folder_ / "in";
  }
  /// Images of one stack by these names, in this order.
  Entries named(const std::vector<std::string>& names) const {
    Entries files;
    for (std::size_t n = 0; n < names.size(); ++n) files.emplace_back(names[n], png_of(images_, n));
    return files;
  }
  TemporaryFolder folder_;
  Images images_ = stamped_images(70, 30, 11, 41);
};

TEST_F(ImageFolder, NumbersCountHoweverTheyAreWritten) {
  const std::vector<std::vector<std::string>> ways{
      {"0.png", "1.png", "2.png", "3.png", "4.png", "5.png", "6.png", "7.png", "8.png", "9.png",
       "10.png"},
      {"slice_1.png", "slice_2.png", "slice_3.png", "slice_4.png", "slice_5.png", "slice_6.png",
       "slice_7.png", "slice_8.png", "slice_9.png", "slice_10.png", "slice_11.png"},
      {"a0001.png", "a0002.png", "a0003.png", "a0004.png", "a0005.png", "a0006.png", "a0007.png",
       "a0008.png", "a0009.png", "a0010.png", "a0011.png"}};
  for (const auto& names : ways) {
    SCOPED_TRACE(names.front());
    Entries files = named(names);
    files.emplace_back("notes.txt", to_bytes("notes"));
    files.emplace_back("cover.png", to_bytes("no slice"));
    files.emplace_back("thumbs/1.png", to_bytes("no slice"));
    const StackReader reader(make(files), folder_.path(), {}, facts);
    EXPECT_EQ(test::read_images(reader), images_.slices);
    EXPECT_EQ(reader.info().format, "folder");
    EXPECT_EQ(reader.info().kind, StackKind::foreign);
    EXPECT_EQ(reader.grid().pixel_x_um, facts.pixel_x_um);
  }
  const StackInfo info = StackReader::read_info(folder_ / "in");
  EXPECT_EQ(info.grid.pixel_x_um, 0);
  EXPECT_EQ(info.grid.layer_um, 0);
}

TEST_F(ImageFolder, TheLargestSetOfImagesCounts) {
  Notices notices;
  Entries files = named({"a1.png", "a2.png", "a3.png"});
  files.emplace_back("preview1.png", to_bytes("no slice"));
  files.emplace_back("preview2.png", to_bytes("no slice"));
  const StackReader reader(make(files), folder_.path(), notices.job, facts);
  EXPECT_EQ(reader.grid().layers, 3);
  EXPECT_THAT(notices.all(), HasSubstr("2 images named previewNUMBER.png left out"));
  files.emplace_back("preview3.png", to_bytes("no slice"));
  expect_refused(make(files), "as many images named aNUMBER.png as previewNUMBER.png");
}

TEST_F(ImageFolder, ChangedOnesKeepTheirNames) {
  Entries before = named({"s0008.png", "s0009.png"});
  before = named(
      {"s1.png", "s2.png", "s3.png", "s4.png", "s5.png", "s6.png", "s7.png", "s8.png", "s9.png"});
  before.emplace_back("notes.txt", to_bytes("notes"));
  make(before);
  StackInfo info = test::info_of(images_.grid);
  info.target_layers = 9;
  const Images others = like(images_, 11, 42);
  for (const std::string name : {"out", "in"}) {
    test::write_stack(file(folder_ / name, "folder", folder_ / "in"), others, info);
    EXPECT_EQ(test::read_file(folder_ / (name + "/notes.txt")), to_bytes("notes"));
    EXPECT_TRUE(std::filesystem::exists(folder_ / (name + "/s11.png")));
    const StackReader reader(folder_ / name, folder_.path());
    EXPECT_EQ(test::read_images(reader), others.slices);
    EXPECT_EQ(reader.info().kind, StackKind::target);
    EXPECT_EQ(reader.grid().pixel_y_um, images_.grid.pixel_y_um) << "slicecorr.json says it";
    EXPECT_THAT(reader.other_entries(), ElementsAre("notes.txt", "slicecorr.json"));
  }
  EXPECT_EQ(folder_.count(), 2);
}

TEST_F(ImageFolder, Damages) {
  expect_refused(make({}), "has no layer images");
  expect_refused(make({{"notes.txt", to_bytes("x")}, {"cover.png", to_bytes("x")}}),
                 "has no layer images");
  expect_refused(make(named({"0.png", "1.png", "3.png"})), "3.png: follows a gap: image 2");
  expect_refused(make(named({"2.png", "3.png"})), "2.png: is the first image, expected number 0");
  expect_refused(make(named({"1.png", "01.png", "2.png"})), "has the number of another image");
  Entries files = named({"0.png", "1.png"});
  files[1].second = encode_png({71, 30, Bytes(71 * 30)});
  expect_refused(make(files), "1.png");
  files[1].second = Bytes(10);
  expect_refused(make(files), "1.png");
  files[0].second = to_bytes("no picture");
  expect_refused(make(files), "0.png");
  make(named({"0.png"}));
  try {
    const StackReader reader(folder_ / "in", folder_.path());
    FAIL() << "sizes are not known";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("pixels"));
  }
}

TEST_F(ImageFolder, ForeignFoldersAreNotReplaced) {
  make(named({"0.png"}));
  EXPECT_THROW(test::write_stack(folder_ / "in/", images_, test::info_of(images_.grid)),
               InputError);
  EXPECT_EQ(test::read_file(folder_ / "in/0.png"), png_of(images_, 0));
  test::write_stack(folder_ / "ours/", images_, test::info_of(images_.grid));
  const Images others = like(images_, 3, 43);
  test::write_stack(folder_ / "ours/", others, test::info_of(others.grid));
  EXPECT_EQ(test::read_images(StackReader(folder_ / "ours", folder_.path())), others.slices);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "ours/00000003.png"));
}

}  // namespace
}  // namespace slicecorr
