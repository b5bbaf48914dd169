// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// G-code of slices in the dialects of several programs, and what tells zip formats apart.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <random>
#include <string_view>

#include "format_fixture.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/layer_gcode.hpp"

namespace slicecorr::test {
namespace {

using detail::kChituboxGcode;
using detail::kCwsGcode;
using detail::LayerGcode;
using ::testing::AllOf;
using ::testing::HasSubstr;

const auto kNoTimes = [](int) { return std::optional<double>(); };

LayerGcode parse(const std::string& text, const detail::GcodeDialect& dialect) {
  return {text, dialect, "part.zip", "run.gcode"};
}

// ---- What is an exposure

TEST(Exposures, AreTheWaitsInLight) {
  const LayerGcode g = parse(
      "G90\nM6054 \"1.png\"\nG0 Z5 F60\nG0 Z0.05 F60\nG4 P4000\nM106 S255\nG4 P1500\nG4 P500\n"
      "M106 S0\nG4 P700\nM6054 \"2.png\"\nM106 S128\nG4 P2.5\nM106 S0\n",
      kChituboxGcode);
  EXPECT_TRUE(g.shows(2));
  EXPECT_FALSE(g.shows(3));
  EXPECT_EQ(g.exposures_s(2), (std::vector<double>{2, 0.0025}));
  EXPECT_EQ(g.light(2), (std::vector<double>{255, 128}));
  EXPECT_EQ(g.places_mm(2), (std::vector<double>{0.05, 0.05}));
}

/// Creation Workshop leaves the light to the blank image.
TEST(Exposures, WithoutSwitchedLightAreTheWaitsWhileShown) {
  const LayerGcode g = parse(
      ";********** Pre-Slice Start ********\n;<Delay> 99\n;<Slice> 0 \n;<Delay> 15000 \n"
      ";<Slice> Blank \nG4 P1500;\nG1 Z3.0 F100.0\n;<Delay> 5100\n;<Slice> 1 \n;<Delay> 4000 \n"
      ";<Slice> Blank \n;<Delay> 5100\n",
      kCwsGcode);
  EXPECT_EQ(g.exposures_s(2), (std::vector<double>{15, 4}));
}

/// UVtools moves and waits while the image is shown, and switches the light.
TEST(Exposures, WaitsBeforeTheLightDoNotCount) {
  const LayerGcode g = parse(
      ";LAYER_START:0\n;PositionZ:0.05mm\n;<Slice> 0\nG1 Z4 F60\n;<Delay> 04000\nG1 Z-3.95 F60\n"
      ";<Delay> 03950\n;<Delay> 2000\nM106 S255\n;<Delay> 30000\nM106 S0\n;<Slice> Blank\n"
      ";<Delay> 100\n;LAYER_END\n",
      kCwsGcode);
  EXPECT_EQ(g.exposures_s(1), (std::vector<double>{30}));
}

TEST(Exposures, AreNotThereWhenALayerHasNone) {
  EXPECT_TRUE(parse("M6054 \"1.png\"\nM106 S9\nM106 S0\n", kChituboxGcode).exposures_s(1).empty());
  EXPECT_TRUE(parse("", kChituboxGcode).exposures_s(1).empty());
  EXPECT_FALSE(parse("M6054 \"2.png\"\nM6054 \"1.png\"\n", kChituboxGcode).shows(2));
}

/// A number of which only a part would be replaced becomes another one.
TEST(Exposures, AreWholeNumbersOfMillisecondsOrRefused) {
  const auto refusal = [](const std::string& wait, const detail::GcodeDialect& dialect) {
    const std::string text = dialect.first == 1
                                 ? "M6054 \"1.png\"\nM106 S255\n" + wait + "\nM106 S0\n"
                                 : ";<Slice> 0\n" + wait + "\n;<Slice> Blank\n";
    try {
      return fmt::format("{}", parse(text, dialect).exposures_s(1).at(0));
    } catch (const InputError& e) {
      return std::string(e.what());
    }
  };
  for (const char* good :
       {"G4 P8000", "G4 P8000;", "G4 P8000 ; 8 s", "G4 P 8000.0", "G4 P8000.\r", "G4 P08000"}) {
    EXPECT_EQ(refusal(good, kChituboxGcode), "8") << good;
  }
  for (const char* bad : {"G4 P8e3", "G4 P8_000", "G4 P8 000", "G4 P8,000", "G4 P0x1F40", "G4 S8",
                          "G4 X8", "G4 P8000S1", "G4 P-8", "G4 P", "G4 P8.5.2"}) {
    EXPECT_THAT(refusal(bad, kChituboxGcode),
                AllOf(HasSubstr("run.gcode"), HasSubstr(bad), HasSubstr("expected G4 P")));
  }
  for (const char* good : {";<Delay> 8000", ";<Delay> 8000 \r", ";<Delay>8000 ; of light"}) {
    EXPECT_EQ(refusal(good, kCwsGcode), "8") << good;
  }
  for (const char* bad :
       {";<Delay> 8e3", ";<Delay> 8_000", ";<Delay> 0x1F40", ";<Delay> 8 000", ";<Delay> -8"}) {
    EXPECT_THAT(refusal(bad, kCwsGcode), HasSubstr("expected ;<Delay>"));
  }
}

TEST(Numbers, AreReadWithTheirUnitsOrNotAtAll) {
  const auto read = [](const std::string& text) {
    const auto number = detail::leading_number(text);
    return number ? fmt::format("{}+{}", number->value, text.substr(number->length)) : "";
  };
  EXPECT_EQ(read("8000"), "8000+");
  EXPECT_EQ(read("8e3"), "8000+");
  EXPECT_EQ(read("8.5e3 ms )"), "8500+ ms )");
  EXPECT_EQ(read("4000 ms )"), "4000+ ms )");
  EXPECT_EQ(read("0.05mm )"), "0.05+mm )");
  EXPECT_EQ(read("21.16402 px/mm )"), "21.16402+ px/mm )");
  EXPECT_EQ(read("21.16402px/mm"), "21.16402+px/mm");
  EXPECT_EQ(read("4000 ) 12"), "4000+ ) 12");
  EXPECT_EQ(read("-1"), "-1+");
  for (const char* text : {"8_000", "8,000", "8 000", "8'000", "0x1F40", "8e", "8e+", "8.5.2",
                           "8-9", "ms", "", "nan", "inf", "1e999"}) {
    EXPECT_EQ(read(text), "") << text;
  }
}

// ---- Changes

TEST(Changes, NothingChangesWhereNothingMust) {
  const std::string text = "M6054 \"1.png\"\nM106 S255\nG4 P 1000.0 ;x\nM106 S0";
  EXPECT_EQ(parse(text, kChituboxGcode).changed(1, 0.05, kNoTimes), text);
  EXPECT_EQ(parse(text, kChituboxGcode).changed(1, 0.05, [](int) { return 1.0004; }), text);
  EXPECT_EQ(parse(text, kChituboxGcode).changed(1, 0.05, [](int) { return 2.0; }),
            "M6054 \"1.png\"\nM106 S255\nG4 P 2000 ;x\nM106 S0");
}

TEST(Changes, OfSeveralWaitsTheFirstTakesTheRest) {
  EXPECT_EQ(parse("M6054 \"1.png\"\nM106 S255\nG4 P1000\nG4 P300\nM106 S0\n", kChituboxGcode)
                .changed(1, 0.05, [](int) { return 2.0; }),
            "M6054 \"1.png\"\nM106 S255\nG4 P1700\nG4 P300\nM106 S0\n");
}

std::string workshop_layer(int n, int ms) {
  const std::string k = std::to_string(n);
  return ";********** Pre-Slice " + k + " ********\nG4 P0;\n;********** Layer " + k +
         " ********\n;<Slice> " + k + " \n;<Delay> " + std::to_string(ms) +
         " \n;<Slice> Blank \n;********** Lift Sequence " + k +
         " ********\nG1 Z3.0 F100.0\n;<Takes> 1800\nG1 Z-2.9 F100.0\n;<Delay> 5100\n";
}

TEST(Changes, AddedLayersCountOnInRelativeMoves) {
  const std::string head = "G21 ;Set units to be mm\nG91 ;Relative\n;** Header End **\n";
  const std::string foot = ";********** Footer Start ********\nM18\n;<Completed>\n";
  const std::string text =
      head + workshop_layer(0, 15000) + workshop_layer(1, 4000) + workshop_layer(2, 4000) + foot;
  EXPECT_EQ(parse(text, kCwsGcode).changed(5, 0.1, kNoTimes),
            head + workshop_layer(0, 15000) + workshop_layer(1, 4000) + workshop_layer(2, 4000) +
                workshop_layer(3, 4000) + workshop_layer(4, 4000) + foot);
  EXPECT_EQ(parse(text, kCwsGcode).changed(4, 0.1, [](int n) { return n == 3 ? 7.0 : 4.0; }),
            head + workshop_layer(0, 4000) + workshop_layer(1, 4000) + workshop_layer(2, 4000) +
                workshop_layer(3, 7000) + foot);
}

/// Heights keep the number of decimals that they are written with.
TEST(Changes, AddedLayersRiseInAbsoluteMoves) {
  const auto layer = [](int n, const char* lift, const char* z) {
    return ";LAYER_START:" + std::to_string(n) + "\n;PositionZ:" + z + "mm\nM6054 \"" +
           std::to_string(n + 1) + ".png\";Show\nG0 Z" + lift + " F60;Lift\nG0 Z" + z +
           " F120;Retract\nM106 S255;\nG4 P2500;\nM106 S0;\n;LAYER_END\n\n";
  };
  const std::string head = ";START_GCODE_BEGIN\nG21;\nG90;\n;END_GCODE_BEGIN\n\n";
  const std::string foot = ";START_GCODE_END\nM106 S0;\nG1 Z150 F100;\n";
  const std::string two = head + layer(0, "5.050", "0.050") + layer(1, "5.100", "0.100");
  EXPECT_EQ(parse(two + foot, kChituboxGcode).changed(4, 0.05, kNoTimes),
            two + layer(2, "5.150", "0.150") + layer(3, "5.200", "0.200") + foot);
  const std::string one = head + layer(0, "5", "1");
  EXPECT_EQ(parse(one + foot, kChituboxGcode).changed(2, 1, kNoTimes),
            one + layer(1, "6", "2") + foot);
  EXPECT_EQ(parse(one + foot, kChituboxGcode).changed(2, 0.05, kNoTimes),
            one + layer(1, "5.05", "1.05") + foot);
}

TEST(Changes, AreRefusedWhereTheTextHasNoPlace) {
  const auto message = [](const std::string& text, int layers, auto times) -> std::string {
    try {
      parse(text, kChituboxGcode).changed(layers, 0.05, times);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  const auto two_s = [](int) { return std::optional<double>(2); };
  EXPECT_THAT(message("G21\n", 1, kNoTimes), HasSubstr("part.zip: run.gcode: shows no images"));
  EXPECT_THAT(message("M6054 \"1.png\"\n", 1, two_s), HasSubstr("has no exposure time of image 1"));
  EXPECT_THAT(message("M6054 \"1.png\"\nM106 S1\nG4 P5\nM106 S0\nM18", 2, kNoTimes), "");
}

// ---- Which format

std::string format_of_entries(const std::vector<std::string>& names,
                              const std::string& gcode = "") {
  TemporaryFolder folder;
  const Bytes png = png_of(Bytes(12), 4, 3, PNG_FORMAT_GRAY);
  Entries entries;
  for (const std::string& name : names) {
    entries.emplace_back(name, name.ends_with(".png")     ? png
                               : name.ends_with(".gcode") ? to_bytes(gcode)
                                                          : to_bytes("{}"));
  }
  make_zip(folder / "part.zip", entries);
  try {
    return StackReader::read_info(folder / "part.zip").format;
  } catch (const InputError& error) {
    return error.what();
  }
}

TEST(Recognition, GoesByEntries) {
  EXPECT_EQ(format_of_entries({"1.png", "2.png"}), "generic");
  EXPECT_EQ(format_of_entries({"1.png", "preview.png", "preview_cropping.png"}), "generic");
  EXPECT_EQ(format_of_entries({"1.png", "run.gcode"}, "G21\nM6054 \"1.png\"\n"), "chitubox");
  EXPECT_EQ(format_of_entries({"run0.png", "run.gcode"}, "G21\n;<Slice> 0\n;<Delay> 7\n"), "cws");
  EXPECT_EQ(format_of_entries({"a0.png", "a1.png", "odd7.png", "x.gcode"}, "G21\n;<Slice> 0\n"),
            "cws");
  // Images that belong to something else.
  EXPECT_THAT(format_of_entries({"1.png", "unknown.json"}), HasSubstr("known format"));
  EXPECT_THAT(format_of_entries({"1.png", "part.gcode"}, "G28\n"), HasSubstr("known format"));
  EXPECT_THAT(format_of_entries({"a0.png", "x.gcode", "y.gcode"}, ";<Slice> 0\n"),
              HasSubstr("y.gcode: is a second G-code"));
}

TEST(Recognition, GcodeWithOtherPowerCountsAndOtherOrderIsToldOf) {
  TemporaryFolder folder;
  const Bytes png = png_of(Bytes(12), 4, 3, PNG_FORMAT_GRAY);
  const auto told_of = [&](const std::string& gcode) {
    make_zip(folder / "part.zip", {{"1.png", png}, {"2.png", png}, {"run.gcode", to_bytes(gcode)}});
    Told told;
    const StackReader reader(folder / "part.zip", folder.path(), told.context(), {50, 50, 50});
    return told.all();
  };
  const std::string one = "G90\nM6054 \"1.png\"\nM106 S255\nG4 P9\nM106 S0\n";
  EXPECT_EQ(told_of(one + "M6054 \"2.png\"\nM106 S255\nG4 P9\nM106 S0\n"), "");
  EXPECT_EQ(told_of(one + "M6054 \"2.png\"\nM106 S99\nG4 P9\nM106 S0\n"), "");
  EXPECT_EQ(StackReader::read_info(folder / "part.zip").light_share,
            (std::vector<double>{1, 99.0 / 255}));
  try {
    told_of(one + "M6054 \"2.png\"\nM106 S256\nG4 P9\nM106 S0\n");
    ADD_FAILURE() << "more than full light";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("layer 1 is lit with 256 of 255"));
  }
  EXPECT_THAT(told_of(one), HasSubstr("does not show images 1 to 2 in this order"));
}

/// Creation Workshop lists the slices in a manifest, too.
TEST(CreationWorkshop, ManifestListsAddedSlices) {
  TemporaryFolder folder;
  const std::string manifest =
      "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<manifest FileVersion=\"1\">\n  <Models />\n"
      "  <!-- odd --><Slices>\n    <Slice>\n      <name>a000.png</name>\n    </Slice>\n"
      "  </Slices>\n  <GCode><name>a.gcode</name></GCode>\n</manifest>\n";
  const std::string gcode =
      ";Number of Slices        =  1\nG91\n;LAYER_START:0\n;<Slice> 0\n;<Delay> 7000\n"
      ";<Slice> Blank\nG1 Z0.1 F9\n;LAYER_END\nM18\n";
  make_foreign_zip(folder / "a.cws", {{"manifest.xml", to_bytes(manifest)},
                                      {"a000.png", png_of(Bytes(12), 4, 3, PNG_FORMAT_GRAY)},
                                      {"a.gcode", to_bytes(gcode)}});
  StackFile file(folder / "b.cws");
  file.keep_from = folder / "a.cws";
  StackInfo info = StackReader::read_info(file.keep_from);
  EXPECT_EQ(info.exposure_s, 7);
  Images images = random_images(4, 3, 3, 1);
  info.grid = images.grid;
  write_file_as(file, images, info);
  Entries entries = unzip(file.path);
  std::string expected = manifest;
  replace(expected, "    </Slice>\n  </Slices>",
          "    </Slice>\n    <Slice>\n      <name>a001.png</name>\n    </Slice>\n    <Slice>\n"
          "      <name>a002.png</name>\n    </Slice>\n  </Slices>");
  EXPECT_EQ(to_text(entry(entries, "manifest.xml")), expected);
  const std::string layer = ";<Slice> 0\n;<Delay> 7000\n;<Slice> Blank\nG1 Z0.1 F9\n;LAYER_END\n";
  EXPECT_THAT(to_text(entry(entries, "a.gcode")),
              HasSubstr(";Number of Slices        =  3\nG91\n;LAYER_START:0\n" + layer +
                        ";LAYER_START:1\n;<Slice> 1" + layer.substr(10) +
                        ";LAYER_START:2\n;<Slice> 2" + layer.substr(10) + "M18\n"));
  EXPECT_EQ(StackReader::read_info(file.path).grid.layers, 3);
}

/// Some programs say the slicer's settings in options.json.
TEST(NanoDlp, OptionsStandInForTheSlicer) {
  TemporaryFolder folder;
  make_zip(
      folder / "a.nanodlp",
      {{"meta.json", to_bytes("{\"format_version\":3,\"distro\":\"dragonfruit\"}")},
       {"slicer.json", to_bytes("{\"mode\":\"v3\"}")},
       {"options.json",
        to_bytes(
            "{\"PWidth\":12,\"PHeight\":3,\"XPixelSize\":0.02,\"YPixelSize\":0.03,\"Thickness\":40,\"DisplayController\":1,\"DynamicThickness\":null}")},
       {"plate.json", to_bytes("{\"LayersCount\":1,\"CureTimes\":[4,5]}")},
       {"profile.json", to_bytes("{\"CureTime\":2.5,\"SupportLayerNumber\":0}")},
       {"override.json", to_bytes("{\"CureTime\":3.5}")},
       {"1.png", packed_png(Bytes(36, 9), 12, 3, false)}});
  Told told;
  const StackReader reader(folder / "a.nanodlp", folder.path(), told.context());
  EXPECT_EQ(reader.info().format, "nanodlp");
  EXPECT_NEAR(reader.grid().pixel_x_um, 20, 1e-9);
  EXPECT_NEAR(reader.grid().pixel_y_um, 30, 1e-9);
  EXPECT_NEAR(reader.grid().layer_um, 40, 1e-9);
  EXPECT_EQ(reader.info().exposure_s, 3.5);
  EXPECT_EQ(reader.pixel_sum(), 36u * 9);
  EXPECT_THAT(told.all(), HasSubstr("CureTimes has 2 times for 1 layers"));
}

// ---- Whatever stands in the texts

/// Changed bytes, cut and doubled pieces: read or refused, never anything else.
TEST(DamagedTexts, AreReadOrRefused) {
  TemporaryFolder folder;
  const Bytes png = png_of(Bytes(12), 4, 3, PNG_FORMAT_GRAY);
  const std::vector<Entries> archives{
      {{"run.gcode", to_bytes(";layerHeight:0.1\n;resolutionX:4\n;machineX:0.2\n;totalLayer:2\n"
                              ";normalExposureTime:3\n;bottomLayerCount:1\nG90\n;LAYER_START:0\n"
                              "M6054 \"1.png\"\nM106 S255\nG4 P9\nM106 S0\nM6054 \"2.png\"\n")},
       {"1.png", png},
       {"2.png", png}},
      {{"manifest.uvtools",
        to_bytes(
            "<?xml "
            "version=\"1.0\"?><Manifest><LayerHeight>0.1</LayerHeight><ResolutionX>4</ResolutionX></Manifest>")},
       {"1.png", png}},
      {{"a.gcode", to_bytes(";(X Resolution = 4 )\n;(Layer Time = 9 ms )\n;(Pix per mm X = 20 )\n"
                            ";Number of Slices = 1\nG91\n;<Slice> 0\n;<Delay> 9\n;<Slice> Blank")},
       {"slice.conf", to_bytes("xres = 4\nlayers_num = 1\nthickness = 0.05\nxppm = 20\n")},
       {"a0.png", png}},
      {{"plate.json", to_bytes("{\"LayersCount\":1,\"CureTimes\":[2.5],\"DynamicThickness\":[]}")},
       {"slicer.json", to_bytes("{\"PWidth\":4,\"XPixelSize\":0.05,\"Thickness\":50}")},
       {"profile.json", to_bytes("{\"CureTime\":2,\"SupportLayerNumber\":1,\"Depth\":50}")},
       {"meta.json", to_bytes("{\"distro\":\"x\"}")},
       {"1.png", png}}};
  std::mt19937 random(3);
  using namespace std::string_view_literals;
  const std::string_view pieces = "0123456789.:=\"'<>(){}[];-+eE \n\r\t\0\xff"sv;
  int read = 0, refused = 0;
  for (int round = 0; round < 1500; ++round) {
    Entries entries = archives[random() % archives.size()];
    Bytes& text = entries[random() % (entries.size() - 1)].second;
    if (text.empty() || text == png) continue;
    for (unsigned k = 1 + random() % 3; k > 0 && !text.empty(); --k) {
      const auto at = text.begin() + static_cast<std::ptrdiff_t>(random() % text.size());
      const unsigned kind = random() % 4;
      if (kind == 0) *at = static_cast<std::uint8_t>(pieces[random() % pieces.size()]);
      if (kind == 1) text.erase(at);
      if (kind == 2) text.resize(static_cast<std::size_t>(at - text.begin()));
      if (kind == 3) {
        const Bytes copy(at, text.end());
        text.insert(text.end(), copy.begin(), copy.end());
      }
    }
    make_zip(folder / "x.zip", entries);
    try {
      StackReader::read_info(folder / "x.zip");
      ++read;
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(read, 100);
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace slicecorr::test
