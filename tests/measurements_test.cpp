// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of measurements: what is read, and what is refused with file, line and column.
#include "slicecorr/resins/measurements.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <fstream>
#include <random>

#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::resins {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::string kCured = "intensity_mw_cm2,exposure_s,cured_height_um\n";
const std::string kZones = "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n";

std::string refusal(const std::string& text) {
  try {
    const Measurements m = parse_measurements(text, "a.csv");
    ADD_FAILURE() << "read " << m.cured.size() << " + " << m.dead_zones.size() << " rows of\n"
                  << text.substr(0, 200);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(Measurements, CuredHeightsWithIntensityAndTime) {
  const Measurements m = parse_measurements(kCured + "20,4,60.5\n10,8,61\n", "a.csv");
  ASSERT_EQ(m.cured.size(), 2U);
  EXPECT_TRUE(m.dead_zones.empty());
  EXPECT_EQ(m.cured[0].blue_mw_cm2, 20);
  EXPECT_EQ(m.cured[0].exposure_s, 4);
  EXPECT_EQ(m.cured[0].dose_mj_cm2, 80);
  EXPECT_EQ(m.cured[0].height_um, 60.5);
  EXPECT_EQ(m.cured[0].sigma_um, 0);
  EXPECT_EQ(m.cured[0].origin.line, 2);
  EXPECT_EQ(m.cured[1].origin.line, 3);
  EXPECT_THAT(m.sources, ElementsAre("a.csv"));
  EXPECT_THAT(m.warnings, IsEmpty());
}

TEST(Measurements, DosesAlone) {
  const Measurements m =
      parse_measurements("dose_mJ_cm2,cured_height_um\n8.59955,244.239\n", "a.csv");
  ASSERT_EQ(m.cured.size(), 1U);
  EXPECT_EQ(m.cured[0].dose_mj_cm2, 8.59955);
  EXPECT_EQ(m.cured[0].blue_mw_cm2, 0);
  EXPECT_EQ(m.cured[0].exposure_s, 0);
}

TEST(Measurements, TwoOfIntensityTimeAndDoseGiveTheThird) {
  const auto by_intensity =
      parse_measurements("intensity_mw_cm2,dose_mj_cm2,cured_height_um\n20,80,60\n", "a.csv");
  EXPECT_EQ(by_intensity.cured.at(0).exposure_s, 4);
  const auto by_time =
      parse_measurements("exposure_s,dose_mj_cm2,cured_height_um\n4,80,60\n", "a.csv");
  EXPECT_EQ(by_time.cured.at(0).blue_mw_cm2, 20);
  const std::string all = "intensity_mw_cm2,exposure_s,dose_mj_cm2,cured_height_um\n";
  EXPECT_EQ(parse_measurements(all + "20,4,80.5,60\n", "a.csv").cured.at(0).dose_mj_cm2, 80);
  EXPECT_THAT(refusal(all + "20,4,8,60\n"),
              AllOf(HasSubstr("a.csv: line 2, column 3 (dose_mj_cm2)"), HasSubstr("80 mJ/cm2")));
}

TEST(Measurements, DeadZonesAndZeroAmongThem) {
  const Measurements m = parse_measurements(kZones + "100,200,30,16.7\n200,100,30,0\n", "a.csv");
  ASSERT_EQ(m.dead_zones.size(), 2U);
  EXPECT_EQ(m.dead_zones[0].uv_mw_cm2, 200);
  EXPECT_EQ(m.dead_zones[0].dead_zone_um, 16.7);
  EXPECT_EQ(m.dead_zones[1].dead_zone_um, 0);
}

TEST(Measurements, HandledSilently) {
  const Measurements plain = parse_measurements(kCured + "20,4,60.5\n10,8,61\n", "a.csv");
  const std::string header = " Exposure_s , CURED_HEIGHT_UM,intensity_mw_cm2 ";
  for (const std::string& text : std::vector<std::string>{
           "\xEF\xBB\xBF" + kCured + "20,4,60.5\n10,8,61\n",
           kCured + "20,4,60.5\r\n10,8,61\r\n",
           "intensity_mw_cm2,exposure_s,cured_height_um\r20,4,60.5\r10,8,61\r",
           kCured + "20,4,60.5\n10,8,61",
           "# by hand\n\n" + kCured +
               "\n20, 4 ,6.05e1 # a note, with a comma\n\n+10,8,61.000\n,,\n",
           header + "\n4,60.5,20\n8,61,10\n",
           kCured + "\"20\",\"4\",\" 60.5 \"\n10,8,61\n",
           kCured + "20,4,60.5,,\n10,8,61\n",
       }) {
    const Measurements m = parse_measurements(text, "a.csv");
    EXPECT_THAT(m.warnings, IsEmpty()) << text;
    ASSERT_EQ(m.cured.size(), 2U) << text;
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_EQ(m.cured[i].blue_mw_cm2, plain.cured[i].blue_mw_cm2) << text;
      EXPECT_EQ(m.cured[i].exposure_s, plain.cured[i].exposure_s) << text;
      EXPECT_EQ(m.cured[i].height_um, plain.cured[i].height_um) << text;
    }
  }
}

TEST(Measurements, ExtraColumnsAreNamedAndIgnored) {
  const Measurements m = parse_measurements(
      "operator,intensity_mw_cm2,exposure_s,,cured_height_um,dead_zone\n"
      "\"Smith, J. \"\"x\"\"\",20,4,,60.5,7\n",
      "a.csv");
  EXPECT_EQ(m.cured.at(0).height_um, 60.5);
  EXPECT_THAT(m.warnings, ElementsAre("a.csv: column 1 ('operator') is not used",
                                      "a.csv: column 4 has no name and is not used",
                                      "a.csv: column 6 ('dead_zone') is not used"));
}

TEST(Measurements, ScatterOfAMeasurement) {
  const std::string header = "intensity_mw_cm2,exposure_s,cured_height_um,sigma_um\n";
  const Measurements m = parse_measurements(header + "20,4,60,2.5\n20,4,61,\n", "a.csv");
  EXPECT_EQ(m.cured.at(0).sigma_um, 2.5);
  EXPECT_EQ(m.cured.at(1).sigma_um, 0);
  EXPECT_THAT(refusal(header + "20,4,60,0\n"), HasSubstr("line 2, column 4 (sigma_um)"));
  EXPECT_THAT(refusal(header + "20,4,60,-1\n"), HasSubstr("line 2, column 4 (sigma_um)"));
}

TEST(Measurements, MillimetresAreSuspected) {
  const Measurements m = parse_measurements(kCured + "20,4,0.244\n20,8,0.4\n", "a.csv");
  EXPECT_THAT(m.warnings, ElementsAre(HasSubstr("are the heights in mm?")));
}

struct Bad {
  std::string text;
  std::vector<std::string> words;
};

TEST(Measurements, WrongNumbersAreRefusedWithTheirPlace) {
  const std::string place = "a.csv: line 3, column 3 (cured_height_um)";
  const std::string good = kCured + "20,4,60\n";
  for (const auto& [text, words] : std::vector<Bad>{
           {good + "20,4,sixty\n", {place, "'sixty'", "no number"}},
           {good + "20,4,60 um\n", {place, "'60 um'", "no number"}},
           {good + "20,4,0x3C\n", {place, "no number"}},
           {good + "20,4,--5\n", {place, "no number"}},
           {good + "20,4,+-5\n", {place, "no number"}},
           {good + "20,4,\n", {place, "is empty"}},
           {good + "20,4,\"60,5\"\n", {place, "'60,5'", "decimal comma"}},
           {good + "20,4,inf\n", {place, "'inf'", "not finite"}},
           {good + "20,4,-Infinity\n", {place, "not finite"}},
           {good + "20,4,nan\n", {place, "'nan'", "not finite"}},
           {good + "20,4,1e999\n", {place, "too large"}},
           {good + "20,4,1e-999\n", {place, "too small"}},
           {good + "20,4,0\n", {place, "is 0", "leave out rows"}},
           {good + "20,4,-12\n", {place, "is -12", "leave out rows"}},
           {good + "0,4,60\n", {"line 3, column 1 (intensity_mw_cm2)", "above 0"}},
           {good + "20,-4,60\n", {"line 3, column 2 (exposure_s)", "is -4"}},
           {good + "1e200,1e200,60\n", {"line 3", "overflows"}},
           {kZones + "0,200,30,16\n", {"line 2, column 1 (blue_mw_cm2)"}},
           {kZones + "100,0,30,16\n", {"line 2, column 2 (uv_mw_cm2)", "no dead zone"}},
           {kZones + "100,200,0,16\n", {"line 2, column 3 (exposure_s)"}},
           {kZones + "100,200,30,-1\n", {"line 2, column 4 (dead_zone_um)", "is -1"}},
           {kZones + "100,200,30,nan\n", {"line 2, column 4 (dead_zone_um)", "not finite"}},
       }) {
    const std::string message = refusal(text);
    for (const std::string& word : words) EXPECT_THAT(message, HasSubstr(word)) << text;
  }
}

TEST(Measurements, WrongTablesAreRefused) {
  for (const auto& [text, words] : std::vector<Bad>{
           {"", {"a.csv", "no table", "cured_height_um"}},
           {"\n  \n# only a comment\n", {"a.csv", "no table"}},
           {"\xEF\xBB\xBF", {"a.csv", "no table"}},
           {kCured, {"a.csv", "header row", "no measurements"}},
           {kCured + "# nothing\n\n,,\n", {"no measurements"}},
           {"20,4,60\n10,8,61\n", {"line 1", "names of columns"}},
           {"intensity,exposure_s,cured_height_um\n20,4,60\n",
            {"line 1", "intensity_mw_cm2 is missing", "intensity, exposure_s"}},
           {"intensity_mw_cm2,exposure_s\n20,4\n", {"line 1", "cured_height_um is missing"}},
           {"intensity_mw_cm2,cured_height_um\n20,4\n", {"exposure_s is missing"}},
           {"blue_mw_cm2,dead_zone_um\n20,4\n", {"uv_mw_cm2, exposure_s is missing"}},
           {"intensity_mw_cm2,exposure_s,Exposure_s,cured_height_um\n20,4,4,60\n",
            {"line 1", "column 2 and column 3", "named"}},
           {"note,note,dose_mj_cm2,cured_height_um\na,b,4,60\n", {"column 1 and column 2"}},
           {"dose_mj_cm2,cured_height_um,dead_zone_um\n4,60,5\n", {"one kind"}},
           {"intensity_mw_cm2;exposure_s;cured_height_um\n20;4;60,5\n",
            {"line 1", "semicolons", "commas", "decimal points"}},
           {"intensity_mw_cm2\texposure_s\tcured_height_um\n20\t4\t60\n", {"line 1", "tabs"}},
           {kCured + "20,4,60\n20,4\n", {"line 3", "2 fields", "3 columns"}},
           {kCured + "20,4,60,5\n", {"line 2", "4 fields", "decimal comma"}},
           {"dose_mj_cm2,cured_height_um\n8,5,244,2\n", {"line 2", "decimal comma"}},
           {kCured + "20;4;60\n", {"line 2", "semicolons"}},
           {kCured + "20,4,\"60\n20,8,70\n", {"line 2", "not closed"}},
           {kCured + "20,4,\"60\"5\n", {"line 2", "closing quote"}},
           {"dose_mj_cm2,uv_mw_cm2,cured_height_um\n80,5,60\n",
            {"column 2 (uv_mw_cm2)", "without UV"}},
           {std::string("PK\x03\x04rubbish", 11), {"workbook"}},
           {std::string("\xFF\xFEi\0n\0", 6), {"UTF-16"}},
           {kCured + std::string("20,4,6\0\n", 8), {"line 2", "0x00"}},
           {std::string(200000, 'x'), {"line 1", "longer than"}},
       }) {
    const std::string message = refusal(text);
    for (const std::string& word : words)
      EXPECT_THAT(message, HasSubstr(word)) << text.substr(0, 99);
  }
}

// Whatever the bytes, there is an error or measurements that could be right: nothing else.
TEST(Measurements, RubbishNeverBecomesMeasurements) {
  std::mt19937 random(1);
  const std::string valid = kCured + "20,4,60.5\r\n10,8,61 # x\n\"5\",16,6.2e1\n";
  int refused = 0;
  for (int round = 0; round < 20000; ++round) {
    std::string text = valid;
    if (round % 2 == 0) {
      // Bytes at random.
      text.resize(random() % 200);
      for (char& c : text) c = static_cast<char>(random());
    } else {
      for (int k = 0; k < 1 + round % 3; ++k) {
        const std::size_t at = random() % text.size();
        switch (random() % 3) {
          case 0:
            text[at] = "0123456789,.;\"#\r\n-+e\0x"[random() % 22];
            break;
          case 1:
            text.erase(at, 1 + random() % 5);
            break;
          default:
            text.insert(at, text.substr(random() % text.size(), random() % 9));
        }
        if (text.empty()) text = "x";
      }
    }
    try {
      const Measurements m = parse_measurements(text, "a.csv");
      ASSERT_FALSE(m.cured.empty()) << text;
      for (const CuredHeight& c : m.cured) {
        ASSERT_TRUE(std::isfinite(c.height_um) && c.height_um > 0) << text;
        ASSERT_TRUE(std::isfinite(c.dose_mj_cm2) && c.dose_mj_cm2 > 0) << text;
      }
    } catch (const InputError& e) {
      ++refused;
      ASSERT_THAT(e.what(), HasSubstr("a.csv")) << text;
    }
  }
  EXPECT_GT(refused, 10000);
}

class MeasurementFiles : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    test::write_file(folder_ / name, test::to_bytes(text));
    return folder_ / name;
  }
  test::TemporaryFolder folder_;
};

TEST_F(MeasurementFiles, SeveralFilesOfBothKinds) {
  const std::string a = write("a.csv", kCured + "20,4,60\n");
  const std::string b = write("b.csv", kZones + "100,200,30,16\n");
  const std::string c = write("c.csv", "dose_mj_cm2,cured_height_um\n90,70\n");
  const Measurements m = read_measurements({a, b, c});
  EXPECT_THAT(m.sources, ElementsAre(a, b, c));
  ASSERT_EQ(m.cured.size(), 2U);
  ASSERT_EQ(m.dead_zones.size(), 1U);
  EXPECT_EQ(m.cured[1].origin.source, 2);
  EXPECT_EQ(m.dead_zones[0].origin.source, 1);
}

TEST_F(MeasurementFiles, TheSameFileTwiceIsRefused) {
  const std::string a = write("a.csv", kCured + "20,4,60\n");
  EXPECT_THROW(read_measurements({a, a}), InputError);
  EXPECT_THROW(read_measurements({a, folder_ / "./a.csv"}), InputError);
  EXPECT_THROW(read_measurements({}), InputError);
}

TEST_F(MeasurementFiles, WhatIsNoFileIsRefused) {
  for (const std::string& path : {folder_ / "none.csv", folder_.path()}) {
    try {
      read_measurements({path});
      ADD_FAILURE() << path;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(path));
    }
  }
}

// Lines that end on or around the edges of the blocks in which a file is read.
TEST_F(MeasurementFiles, LinesAcrossBlocks) {
  for (const char* end : {"\n", "\r\n", "\r"}) {
    for (int shift = 0; shift < 8; ++shift) {
      std::string text = "#" + std::string(static_cast<std::size_t>(shift), '-') + end +
                         "dose_mj_cm2,cured_height_um" + end;
      const int rows = 40000;
      for (int i = 1; i <= rows; ++i) text += fmt::format("{},{}{}", i, 2 * i, end);
      const Measurements m = read_measurements({write("long.csv", text)});
      ASSERT_EQ(m.cured.size(), static_cast<std::size_t>(rows));
      for (int i = 1; i <= rows; ++i) {
        const CuredHeight& c = m.cured[static_cast<std::size_t>(i - 1)];
        ASSERT_EQ(c.dose_mj_cm2, i);
        ASSERT_EQ(c.height_um, 2 * i);
        ASSERT_EQ(c.origin.line, i + 2);
      }
    }
  }
}

TEST_F(MeasurementFiles, MillionsOfRows) {
  const std::string path = folder_ / "many.csv";
  std::string block;
  for (int i = 0; i < 10000; ++i) block += "20.125,4.0625,160.25\n";
  std::ofstream out(path, std::ios::binary);
  out << kCured;
  for (int i = 0; i < kMaxMeasurements / 10000; ++i) out << block;
  out.close();
  EXPECT_EQ(read_measurements({path}).cured.size(), static_cast<std::size_t>(kMaxMeasurements));

  std::ofstream more(path, std::ios::binary | std::ios::app);
  more << block;
  more.close();
  try {
    read_measurements({path});
    ADD_FAILURE() << "more than a million rows were read";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), AllOf(HasSubstr("line 1000002"), HasSubstr("at most 1000000")));
  }
}

TEST_F(MeasurementFiles, ReadingCanBeCancelled) {
  const std::string path = write(
      "a.csv", kCured + [] {
        std::string rows;
        for (int i = 0; i < 10000; ++i) rows += "20,4,60\n";
        return rows;
      }());
  const std::atomic<bool> cancel{true};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(read_measurements({path}, context), Cancelled);
}

}  // namespace
}  // namespace slicecorr::resins
