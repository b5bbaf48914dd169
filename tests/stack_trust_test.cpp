// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a stack says is believed only where it goes together: its parameters with their checksum
/// and with the archive around them, a target with the stack that it is to be measured against, a
/// part with the display that it is to be printed on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "format_fixture.hpp"
#include "ladder.hpp"
#include "program_fixture.hpp"
#include "refusal.hpp"
#include "slicecorr/pipeline.hpp"
#include "stack/block_check.hpp"
#include "stack/formats/uvj_config.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

StackInfo corrected_info() {
  StackInfo info = info_of({40, 30, 6, 50, 50, 25});
  info.kind = StackKind::corrected;
  info.target_layers = 4;
  info.part_volume_mm3 = 1.0 / 3;
  info.program = "slicecorr \xc3\xa9 \"test\"";
  Printer p;
  p.name = "small";
  p.width_px = 40;
  p.height_px = 30;
  p.pixel_x_um = p.pixel_y_um = 50;
  p.calibration = {{0, 1.0 / 7}, {255, 100}};
  info.printer = p;
  Resin r;
  r.name = "resin";
  r.absorbance_height10_um = 2000.0 / 3;
  r.critical_dose_mj_cm3 = 576;
  info.resin = r;
  Process process;
  process.speed_mm_h = 800;
  info.process = process;
  return info;
}

/// Another value of the same kind.
json changed(const json& value) {
  if (value.is_boolean()) return !value.get<bool>();
  if (value.is_number_integer()) return value.get<std::int64_t>() + 1;
  if (value.is_number()) return value.get<double>() * (1 + 1e-15) + 1e-300;
  if (value.is_string()) return value.get<std::string>() + ".";
  return {value, 1};
}

TEST(BlockChecksum, IsOfTheWordsAndNotOfTheirLayout) {
  const std::string text = detail::write_uvj_config(corrected_info(), {7});
  const auto read = [](const std::string& config) {
    return detail::parse_uvj_config(config, "f.uvj");
  };
  EXPECT_TRUE(read(text).info.parameters_checked);
  const json config = json::parse(text);
  // Sorted by key, in one line, widely set, in ASCII with escapes.
  for (const std::string& other :
       {config.dump(), config.dump(8, '\t'), config.dump(-1, ' ', true)}) {
    const auto contents = read(other);
    EXPECT_TRUE(contents.info.parameters_checked) << other;
    EXPECT_TRUE(contents.warnings.empty());
  }
  // Numbers as other programs write them.
  std::string numbers = config.dump();
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"\"speed_mm_h\":800.0", "\"speed_mm_h\":8e2"},
           {"\"critical_dose_mj_cm3\":576.0", "\"critical_dose_mj_cm3\":576"},
           {"\"bit_depth\":8", "\"bit_depth\":8.0"},
           {"\"travel_mm\":0.0", "\"travel_mm\":-0.0"}}) {
    const auto at = numbers.find(from);
    ASSERT_NE(at, std::string::npos) << from << numbers;
    numbers.replace(at, from.size(), to);
  }
  EXPECT_TRUE(read(numbers).info.parameters_checked);
  // What others add beside our block.
  json more = config;
  more["their"] = {{"speed_mm_h", 1}};
  more["Properties"]["Their"] = 5;
  EXPECT_TRUE(read(more.dump()).info.parameters_checked);
}

TEST(BlockChecksum, FindsEveryChange) {
  const json block = json::parse(detail::write_provenance(corrected_info(), {7, 9}));
  const std::uint32_t crc = detail::block_crc32(block);
  EXPECT_EQ(block[detail::kBlockCrc32Key], crc);
  int leaves = 0;
  const json flat = block.flatten();
  for (const auto& [path, value] : flat.items()) {
    json other = block;
    json& leaf = other[json::json_pointer(path)];
    leaf = changed(leaf);
    if (path == std::string("/") + detail::kBlockCrc32Key) {
      EXPECT_EQ(detail::block_crc32(other), crc);
      continue;
    }
    EXPECT_NE(detail::block_crc32(other), crc) << path;
    json without = block;
    const json::json_pointer pointer(path);
    if (without[pointer.parent_pointer()].is_object()) {
      without[pointer.parent_pointer()].erase(pointer.back());
      EXPECT_NE(detail::block_crc32(without), crc) << path;
    }
    ++leaves;
  }
  EXPECT_GT(leaves, 30);
  json more = block;
  more["process"]["theirs"] = 1;
  EXPECT_NE(detail::block_crc32(more), crc);
  // Depth is bounded, whatever a file holds.
  json deep = 1;
  for (int i = 0; i < 100000; ++i) deep = json::array({std::move(deep)});
  more["process"]["theirs"] = std::move(deep);
  EXPECT_NE(detail::block_crc32(more), crc);
}

const std::string kPrinter =
    kSmallPrinter + std::string("[stage]\ntravel_mm = 100\nmax_speed_mm_h = 3000\n");
const Command kSetup{"--printer", "small.toml", "--resin", "figure-2-2"};

class Trust : public ProgramFixture {
 protected:
  Trust() {
    write("small.toml", kPrinter);
    write_stl(folder_ / "ladder.stl", ladder());
  }
  /// Wants exit 2 and gives what is said.
  std::string refused(const Command& arguments) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 2) << ::testing::PrintToString(arguments) << r.out << r.err;
    return r.err;
  }
  void slice(const std::string& mesh, const std::string& out, const Command& more = {}) const {
    good(Command{"slice", mesh, "-o", out, "--layer-um", "50", "--printer", "small.toml"} + more);
  }
  void correct(const std::string& in, const std::string& out) const {
    good(Command{"correct", in, "-o", out, "--speed-mm-h", "800"} + kSetup);
  }
  void box(const std::string& name, const Point3& low, const Point3& high) const {
    TriangleMesh mesh;
    add_box(mesh, low, high);
    write_stl(folder_ / name, mesh);
  }
  /// The stack with another record.
  void edit(const std::string& from, const std::string& to,
            const std::function<void(json& config)>& change,
            const std::string& record = "config.json") const {
    Entries entries = unzip(folder_ / from);
    Bytes& data = entry(entries, record);
    json config = json::parse(to_text(data));
    change(config);
    data = to_bytes(config.dump());
    make_zip(folder_ / to, entries);
  }
};

class TrustedStack : public Trust {
 protected:
  TrustedStack() {
    // Made once: each test gets the same two files.
    static const std::pair<Bytes, Bytes> made = [this] {
      slice("ladder.stl", "target.uvj");
      correct("target.uvj", "part.uvj");
      return std::pair(read_file(folder_ / "target.uvj"), read_file(folder_ / "part.uvj"));
    }();
    write_file(folder_ / "target.uvj", made.first);
    write_file(folder_ / "part.uvj", made.second);
  }
  /// What is said of a stack that is not read. Programs say it with exit code 2, as other tests see.
  std::string not_read(const std::string& stack) const {
    return refusal([&] { StackReader::read_info(folder_ / stack); });
  }
  /// All that reads a stack's record.
  std::vector<Command> readers(const std::string& stack) const {
    return {{"info", stack},
            {"verify", stack, "--target", "target.uvj"},
            {"probe", stack, "--x", "80", "--y", "60"},
            {"section", stack, "--target", "target.uvj", "-o", "s.png"},
            {"solid", stack, "-o", "s.stl"},
            {"report", stack, "--target", "target.uvj", "-o", "r.html"},
            {"simulate", stack, "--x", "80", "--y", "60", "-o", "s.csv"},
            {"convert", stack, "-o", "other.sl1"},
            Command{"correct", stack, "-o", "again.uvj", "--speed-mm-h", "800"} + kSetup};
  }
};

TEST_F(TrustedStack, AnEditedProcessIsRefusedByAllThatReadIt) {
  // The archive's times go with it: only the checksum tells.
  edit("part.uvj", "edited.uvj", [](json& config) {
    EXPECT_EQ(config["slicecorr"]["process"]["speed_mm_h"], 800);
    config["slicecorr"]["process"]["speed_mm_h"] = 1200;
    config["Properties"]["Exposure"]["LightOnTime"] = 0.15;
    for (json& layer : config["Layers"]) layer["Exposure"]["LightOnTime"] = 0.15;
  });
  for (const Command& reader : readers("edited.uvj")) {
    EXPECT_THAT(refused(reader), AllOf(HasSubstr("edited.uvj"), HasSubstr("checksum"),
                                       HasSubstr("correct the part again")));
  }
  for (const char* made : {"s.png", "s.stl", "r.html", "s.csv", "other.sl1", "again.uvj"}) {
    EXPECT_FALSE(std::filesystem::exists(folder_ / made)) << made;
  }
  const RunResult post = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kSetup + Command{"edited.uvj"}, options_);
  EXPECT_EQ(post.exit_code, 2) << post.err;
  EXPECT_THAT(post.err, HasSubstr("checksum"));
  const RunResult farm =
      run_program({SLICECORR_BIN_DIR "/slicefarm", "submit", "edited.uvj", "--dir", "farm",
                   "--printer", "small.toml", "--resin", "figure-2-2", "--speed-mm-h", "800"},
                  options_);
  EXPECT_EQ(farm.exit_code, 2) << farm.out << farm.err;
  EXPECT_THAT(farm.out + farm.err, HasSubstr("checksum"));
  EXPECT_THROW(StackReader(folder_ / "edited.uvj", folder_.path()), InputError);
}

TEST_F(TrustedStack, WhatContradictsItselfIsRefusedWithBothValues) {
  // Without its checksum, too.
  const auto said = [&](const std::function<void(json & config)>& change) {
    edit("part.uvj", "edited.uvj", [&](json& config) {
      config["slicecorr"].erase("block_crc32");
      change(config);
    });
    return not_read("edited.uvj");
  };
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["process"]["speed_mm_h"] = 1200; }),
              AllOf(HasSubstr("0.15 s at 1200 mm/h"), HasSubstr("archive says 0.225 s")));
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["grid"]["layer_um"] = 25; }),
              AllOf(HasSubstr("the height of layers is 25 um"), HasSubstr("50 um in the archive")));
  EXPECT_THAT(said([](json& c) { c["Properties"]["Size"]["LayerHeight"] = 0.025; }),
              AllOf(HasSubstr("the height of layers is 50 um"), HasSubstr("25 um in the archive")));
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["grid"]["pixel_x_um"] = 47; }),
              HasSubstr("the width of pixels is 47 um"));
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["target_layers"] = 5000; }),
              HasSubstr("its part has 5000 layers, the archive "));
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["printer"]["width_px"] = 170; }),
              AllOf(HasSubstr("160 x 120 pixels"), HasSubstr("170 x 120 pixels")));
  EXPECT_THAT(said([](json& c) {
                for (json& layer : c["Layers"]) layer["Exposure"]["LightOnTime"] = 0.5;
              }),
              HasSubstr("archive says 0.5 s"));
  // Layer by layer the first exposure, too.
  good(Command{"correct", "target.uvj", "-o", "part.uvj", "--mode", "layerwise", "--exposure-s",
               "2", "--bottom-exposure-s", "2.5", "--bottom-layers", "3"} +
       kSetup);
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["process"]["bottom_exposure_s"] = 5; }),
              AllOf(HasSubstr("plans 5 s"), HasSubstr("archive says 2.5 s")));
  EXPECT_THAT(said([](json& c) { c["slicecorr"]["process"]["exposure_s"] = 2.25; }),
              AllOf(HasSubstr("plans 2.25 s"), HasSubstr("archive says 2 s")));
  // A target's record says how many layers it has.
  edit("target.uvj", "edited.uvj", [](json& c) { c["slicecorr"]["target_layers"] = 49; });
  EXPECT_THAT(refused({"info", "edited.uvj"}), HasSubstr("its part has 49 layers, the archive 50"));
}

TEST_F(TrustedStack, OtherKeysMayChange) {
  const std::string before =
      good({"verify", "part.uvj", "--target", "target.uvj", "--json", "-"}).out;
  edit("part.uvj", "edited.uvj", [](json& c) {
    c["Properties"]["AntiAliasLevel"] = 4;
    c["Properties"]["Exposure"]["LiftHeight"] = 5;
    c["Their"] = {{"notes", "painted"}};
  });
  const RunResult r = good({"verify", "edited.uvj", "--target", "target.uvj", "--json", "-"});
  EXPECT_EQ(r.out, before);
  EXPECT_THAT(r.err, Not(HasSubstr("checksum")));
  EXPECT_EQ(json::parse(good({"info", "edited.uvj", "--json", "-"}).out)["parameters_checked"],
            true);
}

TEST_F(TrustedStack, EarlierStacksAreReadAndSaidToHaveNoChecksum) {
  edit("part.uvj", "old.uvj", [](json& c) { c["slicecorr"].erase("block_crc32"); });
  for (Command reader : readers("old.uvj")) {
    if (reader[0] == "correct") continue;  // of a corrected stack
    const RunResult r = good(reader);
    EXPECT_THAT(r.out + r.err, AnyOf(HasSubstr("has no checksum of its parameters"),
                                     HasSubstr("checksum     of the images alone")));
  }
  EXPECT_EQ(json::parse(good({"info", "old.uvj", "--json", "-"}).out)["parameters_checked"], false);
  // Written anew it has one.
  good({"convert", "old.uvj", "-o", "new.uvj"});
  EXPECT_THAT(good({"info", "new.uvj"}).out, Not(HasSubstr("checksum")));
  EXPECT_EQ(StackReader::read_info(folder_ / "new.uvj").process->speed_mm_h, 800);
}

TEST_F(TrustedStack, TheBridgeTakesOnlyWhatHasItsChecksum) {
  edit("part.uvj", "old.uvj", [](json& c) { c["slicecorr"].erase("block_crc32"); });
  edit("part.uvj", "edited.uvj", [](json& c) { c["slicecorr"]["resin"]["m"] = 0.9; });
  const std::string shipped = SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml";
  const auto print = [&](const std::string& stack) {
    return run_program({SLICECORR_BIN_DIR "/printbridge", "print", stack, "--printer", shipped,
                        "--dir", folder_ / "state", "--dry-run", "--sink", "null"},
                       options_);
  };
  RunResult r = print("edited.uvj");
  EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_THAT(r.err, HasSubstr("its parameters were changed after the stack was made"));
  r = print("old.uvj");
  EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_THAT(r.err, HasSubstr("has no checksum of its parameters"));
  // The stack as it was made goes on to the next check.
  EXPECT_THAT(print("part.uvj").err, HasSubstr("was made for another printer"));
}

TEST_F(TrustedStack, RecordsInOtherFormatsToo) {
  for (const auto& [file, format] :
       std::vector<std::pair<std::string, std::string>>{{"part.sl1", "sl1"},
                                                        {"c.zip", "chitubox"},
                                                        {"part.cws", "cws"},
                                                        {"part.vdt", "vdt"},
                                                        {"part.nanodlp", "nanodlp"},
                                                        {"e.zip", "ember"},
                                                        {"g.zip", "generic"},
                                                        {"v.zip", "vda"}}) {
    SCOPED_TRACE(format);
    good({"convert", "part.uvj", "-o", file, "--format", format});
    EXPECT_THAT(good({"info", file}).out, Not(HasSubstr("checksum")));
    const auto crc = [&, &file = file](const char* record, const char* key, const json& value) {
      edit(
          file, "edited.zip", [&](json& block) { block[record][key] = value; }, "slicecorr.json");
      return not_read("edited.zip");
    };
    EXPECT_THAT(crc("resin", "absorbance_height10_um", 1900), HasSubstr("checksum"));
    EXPECT_THAT(crc("process", "speed_mm_h", 1200), HasSubstr("edited.zip"));
  }
  // Two records contradict each other, whatever they say.
  Entries entries = unzip(folder_ / "part.uvj");
  entries.emplace_back("slicecorr.json", entry(entries, "config.json"));
  make_zip(folder_ / "two.uvj", entries);
  EXPECT_THAT(refused({"info", "two.uvj"}), HasSubstr("second record"));
}

TEST_F(TrustedStack, HeightsThatAFormatRoundsAreNoContradiction) {
  // The Ember's archives hold whole micrometres, and that is what it prints.
  good({"slice", "ladder.stl", "-o", "fine.uvj", "--layer-um", "12.4", "--printer", "small.toml"});
  correct("fine.uvj", "fine.tar.gz");
  EXPECT_EQ(StackReader::read_info(folder_ / "fine.tar.gz").grid.layer_um, 12);
  EXPECT_THAT(good({"probe", "fine.tar.gz", "--x", "80", "--y", "60"}).err,
              HasSubstr("the height of layers is 12 um, as the archive rounds the 12.4 um"));
}

class TrustedTarget : public TrustedStack {
 protected:
  /// All that takes a target.
  std::vector<Command> readers(const std::string& stack, const std::string& target) const {
    return {{"verify", stack, "--target", target},
            {"probe", stack, "--x", "80", "--y", "60", "--target", target},
            {"section", stack, "--target", target, "-o", "s.png"},
            {"solid", stack, "--target", target, "-o", "s.stl"},
            {"report", stack, "--target", target, "-o", "r.html"},
            {"simulate", stack, "--x", "80", "--y", "60", "--target", target, "-o", "s.csv"}};
  }
};

TEST_F(TrustedTarget, AnotherPartIsRefused) {
  box("low.stl", {-2, -1, 0}, {2, 1, 0.6});
  box("beside.stl", {0, 0, 0}, {1.5, 1.5, 2.5});
  box("solid.stl", {-2, -1, 0}, {2, 1, 2.5});
  slice("low.stl", "low.uvj");
  slice("beside.stl", "beside.uvj", {"--center-mm", "7,5"});
  slice("solid.stl", "solid.uvj");
  for (const Command& reader : readers("part.uvj", "low.uvj")) {
    EXPECT_THAT(refused(reader), AllOf(HasSubstr("low.uvj"),
                                       HasSubstr("it has 12 layers, the stack was made from 50")));
  }
  for (const char* made : {"s.png", "s.stl", "r.html", "s.csv"}) {
    EXPECT_FALSE(std::filesystem::exists(folder_ / made)) << made;
  }
  EXPECT_THAT(refused({"verify", "part.uvj", "--target", "beside.uvj"}),
              HasSubstr("it lies elsewhere, or is another part"));
  // As high and as wide: 1.49 times as much in it, which slicing otherwise could make; told.
  EXPECT_THAT(good({"verify", "part.uvj", "--target", "solid.uvj"}).err,
              HasSubstr("another part of the same height and place"));
  TriangleMesh plate_and_post;
  add_box(plate_and_post, {-2, -1, 0}, {2, 1, 0.3F});
  add_box(plate_and_post, {-0.1F, -0.1F, 0}, {0.1F, 0.1F, 2.5});
  write_stl(folder_ / "post.stl", plate_and_post);
  slice("post.stl", "post.uvj");
  EXPECT_THAT(refused({"verify", "part.uvj", "--target", "post.uvj"}),
              AllOf(HasSubstr("it holds 2.48"), HasSubstr("mm³")));
}

TEST_F(TrustedTarget, SlicesThatWereNotCorrectedAreComparedWhereTheyOverlap) {
  box("low.stl", {-2, -1, 0}, {2, 1, 0.6});
  box("beside.stl", {0, 0, 0}, {1.5, 1.5, 2.5});
  slice("low.stl", "low.uvj");
  slice("beside.stl", "beside.uvj", {"--center-mm", "7,5"});
  const auto verify = [&](const std::string& stack, const std::string& target) {
    return Command{"verify", stack, "--target", target, "--speed-mm-h", "800"} + kSetup;
  };
  good(verify("target.uvj", "target.uvj"));
  EXPECT_THAT(refused(verify("target.uvj", "low.uvj")),
              HasSubstr("the 12., that of the stack the 50."));
  EXPECT_THAT(refused(verify("low.uvj", "target.uvj")), HasSubstr("can't be the target"));
  EXPECT_THAT(refused(verify("target.uvj", "beside.uvj")), HasSubstr("only 0 are both"));
  // Light on the part that is too weak to print it is an answer, and said.
  const RunResult r = good(verify("target.uvj", "target.uvj") + Command{"--dc-mj-cm3", "100000"});
  EXPECT_THAT(r.err, HasSubstr("nothing of the part prints"));
}

TEST_F(TrustedTarget, TheSameDesignInAnotherFormIsTaken) {
  // No other form knows edge heights. That a target does not, though the stack was corrected to
  // them, is told.
  good({"convert", "target.uvj", "-o", "no-heights.sl1"});
  EXPECT_THAT(good({"verify", "part.uvj", "--target", "no-heights.sl1"}).err,
              HasSubstr("knows no edge heights"));
  EXPECT_THAT(good({"verify", "part.uvj", "--target", "target.uvj"}).err,
              Not(HasSubstr("edge heights")));
  slice("ladder.stl", "target.uvj", {"--surface", "slices"});
  correct("target.uvj", "part.uvj");
  const std::string same =
      good({"verify", "part.uvj", "--target", "target.uvj", "--json", "-"}).out;
  const auto silent = [&](const std::string& target) {
    const RunResult r = good({"verify", "part.uvj", "--target", target, "--json", "-"});
    EXPECT_EQ(r.out, same) << target;
    EXPECT_THAT(r.err, Not(HasSubstr("holds")));
  };
  // Another format, and black layers after the end, more or fewer.
  good({"convert", "target.uvj", "-o", "target.sl1"});
  silent("target.sl1");
  good({"convert", "target.uvj", "-o", "slices/"});
  silent("slices");
  const StackReader target(folder_ / "target.uvj", folder_.path());
  Images images{target.grid(), read_images(target)};
  for (int n = 0; n < 3; ++n) images.slices.emplace_back(images.slices.front().size());
  images.grid.layers += 3;
  write_stack(folder_ / "longer.uvj", images, info_of(images.grid));
  RunResult r = good({"verify", "part.uvj", "--target", "longer.uvj", "--json", "-"});
  EXPECT_EQ(r.out, same);
  correct("longer.uvj", "longer-part.uvj");
  r = good({"verify", "longer-part.uvj", "--target", "target.uvj"});
  EXPECT_THAT(r.err, Not(HasSubstr("holds")));
  // Sliced without anti-aliasing, off the pixels by a third: the rim differs, which is told.
  slice("ladder.stl", "smooth.uvj", {"--center-mm", "4.017,3.017"});
  slice("ladder.stl", "hard.uvj", {"--center-mm", "4.017,3.017", "--antialias", "off"});
  correct("smooth.uvj", "smooth-part.uvj");
  EXPECT_THAT(good({"verify", "smooth-part.uvj", "--target", "hard.uvj"}).err,
              HasSubstr("sliced otherwise"));
}

TEST_F(Trust, APartThatVanishesIsRefusedWithTheCause) {
  // A part of 90 mm in metres: over four pixels, 81 % of each.
  box("tiny.stl", {0, 0, 0}, {0.09F, 0.09F, 0.1F});
  const Command sliced{"--layer-um", "50", "--printer", "small.toml"},
      how = Command{"--speed-mm-h", "800"} + kSetup + Command{"--layer-um", "50"};
  const auto says = [](const std::string& text) {
    EXPECT_THAT(text, AllOf(HasSubstr("nothing would print"), HasSubstr("units and scale"),
                            HasSubstr("the fullest by 81.2 %"),
                            HasSubstr("2 x 2 pixels of 50 x 50 um and 2 layers of 50 um")));
  };
  says(refused(Command{"slice", "tiny.stl", "-o", "t.uvj"} + sliced));
  says(refused(Command{"run", "tiny.stl", "-o", "t.uvj"} + how));
  says(refused(Command{"compare", "tiny.stl", "-o", "t.html"} + how));
  // Nothing lies under the middles of pixels.
  EXPECT_THAT(refused(Command{"slice", "tiny.stl", "-o", "t.uvj", "--antialias", "off",
                              "--center-mm", "4.005,3.005", "--scale", "0.3"} +
                      sliced),
              AllOf(HasSubstr("nothing would print"), HasSubstr("all slices are empty")));
  EXPECT_THAT(refused(Command{"slice", "tiny.stl", "-o", "t.uvj", "--scale", "0.1"} + sliced),
              AllOf(HasSubstr("thinner than half a layer"), HasSubstr("units and scale")));
  for (const char* made : {"t.uvj", "t.html", "t.json"}) {
    EXPECT_FALSE(std::filesystem::exists(folder_ / made)) << made;
  }
  // With its units it is a part of 90 mm again, which this display has no room for.
  EXPECT_THAT(refused(Command{"slice", "tiny.stl", "-o", "t.uvj", "--units", "m"} + sliced),
              HasSubstr("beyond the display"));
  // Archives of other programs that are grey throughout.
  Entries slices;
  for (int n = 0; n < 3; ++n) {
    slices.emplace_back(std::to_string(n + 1) + ".png",
                        encode_png(GreyImage{160, 120, Bytes(160 * 120, 200)}));
  }
  make_zip(folder_ / "grey.zip", slices);
  EXPECT_THAT(refused(Command{"correct", "grey.zip", "-o", "t.uvj"} + how),
              AllOf(HasSubstr("nothing would print"), HasSubstr("grey value 200 of 255")));
  const RunResult post = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr-post"} + how + Command{"grey.zip"}, options_);
  EXPECT_EQ(post.exit_code, 2) << post.err;
  EXPECT_THAT(post.err, HasSubstr("nothing would print"));
  EXPECT_EQ(unzip(folder_ / "grey.zip"), slices);
}

}  // namespace
}  // namespace slicecorr::test
