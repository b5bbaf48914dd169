// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Recorded stacks as files: written image by image, read back, and refused where they are wrong.
#include "slicecorr/recording.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "models.hpp"
#include "run_program.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/recording_writer.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using nlohmann::json;
using test::Bytes;
using test::Images;
using test::TemporaryFolder;
using testing::HasSubstr;
using Showing = Recording::Showing;

constexpr const char* kTable = "slicecorr/recording.csv";

std::string refusal(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "nothing was thrown";
}

/// What a corrected stack of these images says of itself.
StackInfo print_info(const Grid& grid) {
  StackInfo info;
  info.grid = grid;
  info.kind = StackKind::corrected;
  info.printer = test::linear_printer(1, 100);
  info.printer->width_px = grid.width_px;
  info.printer->height_px = grid.height_px;
  info.printer->pixel_x_um = grid.pixel_x_um;
  info.printer->pixel_y_um = grid.pixel_y_um;
  info.resin = test::resin(576, 2000);
  info.process = test::process(1000);
  info.target_layers = grid.layers;
  info.part_volume_mm3 = 1.5;
  return info;
}

/// Each image in the slice of its number, a quarter late; numbers that need all their digits.
Recording late(int images) {
  Recording r;
  for (int n = 0; n < images; ++n) {
    const double z = n * 1000.0 / 30;
    const std::vector<Showing> showings{
        {n - 1, 0.25 / 3, 0, z, z + 1.0 / 3, 277.7, 1.0 / 3},
        {n, 0.75, 1e-7 * n, z + 1.0 / 3, z + 1000.0 / 30, 277.8, 1}};
    r.add_slice(showings);
  }
  return r;
}

void write(const std::string& path, const Images& images, const Recording& recording,
           const ExecutionContext& context = {}) {
  RecordingWriter writer(path, print_info(images.grid), context);
  for (std::size_t n = 0; n < images.slices.size(); ++n) {
    EXPECT_EQ(writer.add_image(images.slices[n].data()), static_cast<int>(n));
  }
  EXPECT_EQ(writer.images(), images.grid.layers);
  writer.finish(recording);
}

TEST(RecordingFile, SaysWhatWasWritten) {
  const TemporaryFolder folder;
  const Images images = test::random_images(61, 70, 37, 4);
  Recording recording = late(37);
  // Slices at the end in which nothing was lit.
  recording.add_slice({});
  recording.add_slice({});
  write(folder / "a.uvj", images, recording);
  EXPECT_EQ(folder.count(), 1);
  const StackReader reader(folder / "a.uvj", folder.path());
  const StackInfo& info = reader.info();
  EXPECT_EQ(info.kind, StackKind::recorded);
  EXPECT_EQ(test::read_images(reader), images.slices);
  EXPECT_FALSE(reader.images_changed());
  ASSERT_NE(reader.recording(), nullptr);
  EXPECT_EQ(*reader.recording(), recording);
  const StackInfo print = print_info(images.grid);
  EXPECT_EQ(info.printer, print.printer);
  EXPECT_EQ(info.resin, print.resin);
  EXPECT_EQ(info.process, print.process);
  EXPECT_EQ(info.target_layers, 37);
  EXPECT_EQ(info.part_volume_mm3, 1.5);
  EXPECT_EQ(info.grid.layers, 37);
  EXPECT_NEAR(info.grid.layer_um, 1000.0 / 30, 1e-9);
  // 0.25 / 3 + 0.75 of the plan's time in each of the 37 slices, less the first showing of slice 0.
  EXPECT_NEAR(light_on_s(info), 37 * (0.25 / 3 + 0.75) * 1000 / 30 * 3.6 / 1000, 1e-9);
  // A stack is found to be one without its images, too.
  EXPECT_EQ(*StackReader::read_info(folder / "a.uvj").recording, recording);
}

TEST(RecordingFile, BytesDoNotDependOnThreads) {
  const TemporaryFolder folder;
  const Images images = test::random_images(90, 101, 50, 8);
  ExecutionContext one, four;
  one.threads = 1;
  four.threads = 4;
  write(folder / "one.uvj", images, late(50), one);
  write(folder / "four.uvj", images, late(50), four);
  EXPECT_EQ(test::read_file(folder / "one.uvj"), test::read_file(folder / "four.uvj"));
}

TEST(RecordingFile, AStoppedPrintHasARecord) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 3, 8);
  std::atomic<bool> stop{true};
  ExecutionContext context;
  context.cancel = &stop;
  write(folder / "a.uvj", images, late(3), context);
  EXPECT_EQ(test::read_images(StackReader(folder / "a.uvj", folder.path())), images.slices);
}

TEST(RecordingFile, NothingShownIsARecordToo) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 1, 8);
  RecordingWriter writer(folder / "a.uvj", print_info(images.grid));
  Recording dark;
  const Showing nothing{-1, 0, 0, 0, 50, 100, 0};
  dark.add_slice({&nothing, 1});
  writer.finish(dark);
  const StackReader reader(folder / "a.uvj", folder.path());
  EXPECT_EQ(reader.grid().layers, 1);
  EXPECT_EQ(reader.pixel_sum(), 0u);
  EXPECT_EQ(*reader.recording(), dark);
}

TEST(RecordingFile, NothingIsLeftOfAWriterThatDidNotFinish) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 1, 8);
  {
    RecordingWriter writer(folder / "a.uvj", print_info(images.grid));
    writer.add_image(images.slices[0].data());
  }
  EXPECT_EQ(folder.count(), 0);
}

TEST(RecordingFile, PatternedUvImagesAreComparedWithTheirSlices) {
  const TemporaryFolder folder;
  const Images images = test::random_images(30, 20, 3, 2);
  StackInfo info = print_info(images.grid);
  info.printer->uv = UvLamp{365, true, {{0, 0}, {255, 300}}};
  info.resin->inhibition = Inhibition{0.7, 30, 1, 0};
  info.process->uv.kind = UvKind::patterned;
  info.process->uv.dead_zone_um = 5;
  // The images that a corrected stack of these slices has.
  Bytes map(256);
  {
    RecordingWriter writer(folder / "map.uvj", info);
    Images all = test::random_images(30, 20, 1, 2);
    for (std::size_t i = 0; i < 600; ++i) all.slices[0][i] = static_cast<std::uint8_t>(i % 256);
    writer.add_image(all.slices[0].data(), all.slices[0].data());
    writer.finish({});
    const StackReader reader(folder / "map.uvj", folder.path());
    Bytes uv(600);
    reader.read_uv_slice(0, uv.data());
    std::copy_n(uv.begin(), 256, map.begin());
    EXPECT_GT(map[255], map[10]);
    EXPECT_EQ(reader.recording()->other_uv_images, std::vector{0});
  }
  RecordingWriter writer(folder / "a.uvj", info);
  for (std::size_t n = 0; n < 3; ++n) {
    Bytes uv = images.slices[n];
    for (std::uint8_t& v : uv) v = map[v];
    if (n == 1) uv[77] ^= 1;
    writer.add_image(images.slices[n].data(), uv.data());
  }
  writer.add_image(images.slices[0].data(), nullptr);
  writer.finish({});
  EXPECT_EQ(StackReader::read_info(folder / "a.uvj").recording->other_uv_images,
            (std::vector{1, 3}));
}

TEST(RecordingWriterRefuses, WhatCantBeARecord) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 2, 8);
  const StackInfo info = print_info(images.grid);
  EXPECT_THAT(refusal([&] { RecordingWriter(folder / "a.sl1", info); }), HasSubstr("name.uvj"));
  EXPECT_THAT(refusal([&] { RecordingWriter(folder / "none/a.uvj", info); }),
              HasSubstr("expected a new file in a folder that is there"));
  StackInfo less = info;
  less.resin.reset();
  EXPECT_THAT(refusal([&] { RecordingWriter(folder / "a.uvj", less); }),
              HasSubstr("expected a corrected stack"));
  const auto finish = [&](const Showing& showing) {
    RecordingWriter writer(folder / "a.uvj", info);
    writer.add_image(images.slices[0].data());
    writer.add_image(images.slices[1].data());
    Recording r;
    r.add_slice({});
    r.add_slice({&showing, 1});
    return refusal([&] { writer.finish(r); });
  };
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinite = std::numeric_limits<double>::infinity();
  EXPECT_THAT(finish({2, 1, 0, 0, 0, 0, 1}), HasSubstr("slice 1: image 2; expected -1"));
  EXPECT_THAT(finish({-2, 1, 0, 0, 0, 0, 1}), HasSubstr("image -2"));
  EXPECT_THAT(finish({0, -0.5, 0, 0, 0, 0, 1}), HasSubstr("light -0.5"));
  EXPECT_THAT(finish({0, nan, 0, 0, 0, 0, 1}), HasSubstr("light nan"));
  EXPECT_THAT(finish({0, 1, infinite, 0, 0, 0, 1}), HasSubstr("uv_mw_cm2 inf"));
  EXPECT_THAT(finish({0, 1, 0, nan, 0, 0, 1}), HasSubstr("no number"));
  EXPECT_THAT(finish({0, 1, 0, 0, 0, 0, -1}), HasSubstr("blue_share -1"));
  EXPECT_EQ(finish({1, 1, 0, -3, 0, -20, 1}), "nothing was thrown");
}

// ---- damaged files ---------------------------------------------------------------------------

class RecordingDamage : public testing::Test {
 protected:
  RecordingDamage() {
    write(folder_ / "a.uvj", images_, late(5));
    entries_ = test::unzip(folder_ / "a.uvj");
  }
  std::string table() { return test::to_text(test::entry(entries_, kTable)); }
  /// Puts another table into the archive; the block goes with it where `honest`.
  std::string read_with(const std::string& table, bool honest, int slices = 5, int showings = 10) {
    test::Entries entries = entries_;
    test::entry(entries, kTable) = test::to_bytes(table);
    if (honest) {
      json config = json::parse(test::to_text(test::entry(entries, "config.json")));
      json& facts = config["slicecorr"]["recording"];
      facts["slices"] = slices;
      facts["parts"] = showings;
      facts["crc32"] = crc_of(table);
      test::entry(entries, "config.json") = test::to_bytes(config.dump());
    }
    return read(entries);
  }
  std::string read(const test::Entries& entries) {
    std::filesystem::remove(folder_ / "b.uvj");
    test::make_zip(folder_ / "b.uvj", entries);
    return refusal([&] { StackReader(folder_ / "b.uvj", folder_.path()); });
  }
  std::string read_with_block(const std::function<void(json&)>& change) {
    test::Entries entries = entries_;
    json config = json::parse(test::to_text(test::entry(entries, "config.json")));
    change(config["slicecorr"]);
    test::entry(entries, "config.json") = test::to_bytes(config.dump());
    return read(entries);
  }
  /// CRC-32 bit by bit.
  static std::uint32_t crc_of(const std::string& text) {
    std::uint32_t crc = 0xffffffff;
    for (const char c : text) {
      crc ^= static_cast<std::uint8_t>(c);
      for (int k = 0; k < 8; ++k) crc = crc & 1 ? crc >> 1 ^ 0xedb88320 : crc >> 1;
    }
    return ~crc;
  }
  std::string replaced(const std::string& from, const std::string& to) {
    std::string text = table();
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << text;
    return at == std::string::npos ? text : text.replace(at, from.size(), to);
  }

  TemporaryFolder folder_;
  Images images_ = test::random_images(20, 20, 5, 8);
  test::Entries entries_;
};

TEST_F(RecordingDamage, UnchangedIsRead) {
  EXPECT_EQ(read_with(table(), true), "nothing was thrown");
}

TEST_F(RecordingDamage, TheTableMustBeThatOfTheBlock) {
  EXPECT_THAT(read_with(table().substr(0, 200), false), HasSubstr("is damaged"));
  EXPECT_THAT(read_with(replaced("0.75", "0.76"), false), HasSubstr("is damaged"));
  test::Entries entries = entries_;
  std::erase_if(entries, [](const auto& e) { return e.first == kTable; });
  EXPECT_THAT(read(entries), AllOf(HasSubstr(kTable), HasSubstr("is missing")));
}

TEST_F(RecordingDamage, RowsThatCantBeAreRefusedByTheirLine) {
  const auto with_row = [&](const std::string& row) {
    return read_with(replaced("\n0,-1,", "\n" + row + "\n0,-1,"), true);
  };
  EXPECT_THAT(with_row("0,0,1,0,0,0,0"), HasSubstr("line 2: expected 8 columns"));
  EXPECT_THAT(with_row("0,0,1,0,0,0,0,1,1"), HasSubstr("line 2: expected 8 columns"));
  EXPECT_THAT(with_row("0,0.5,1,0,0,0,0,1"), HasSubstr("line 2: expected two whole numbers"));
  EXPECT_THAT(with_row("0,0,one,0,0,0,0,1"), HasSubstr("line 2"));
  EXPECT_THAT(with_row("0,0,,0,0,0,0,1"), HasSubstr("line 2"));
  EXPECT_THAT(with_row("0,99999999999,1,0,0,0,0,1"), HasSubstr("line 2"));
  EXPECT_THAT(with_row("3,0,1,0,0,0,0,1"), HasSubstr("line 3: expected slices that rise"));
  EXPECT_THAT(with_row("-1,0,1,0,0,0,0,1"), HasSubstr("line 2: expected slices that rise"));
  EXPECT_THAT(with_row("5,0,1,0,0,0,0,1"), HasSubstr("line 2: expected a slice below 5"));
  EXPECT_THAT(with_row("0,5,1,0,0,0,0,1"), HasSubstr("slice 0: image 5; expected -1"));
  EXPECT_THAT(with_row("0,0,-1,0,0,0,0,1"), HasSubstr("slice 0: light -1"));
  EXPECT_THAT(with_row("0,0,nan,0,0,0,0,1"), HasSubstr("light nan"));
  EXPECT_THAT(with_row("0,0,1,-2,0,0,0,1"), HasSubstr("uv_mw_cm2 -2"));
  EXPECT_THAT(with_row("0,0,1,0,inf,0,0,1"), HasSubstr("no number"));
  std::string text = table();
  text.pop_back();
  EXPECT_THAT(read_with(text, true), HasSubstr("expected a whole line"));
  EXPECT_THAT(read_with(replaced("slice,", "layer,"), true),
              HasSubstr("line 1: expected the columns"));
  EXPECT_THAT(read_with("", true), HasSubstr("line 1"));
}

TEST_F(RecordingDamage, TheBlockIsChecked) {
  const auto facts = [&](const char* key, const json& value) {
    return read_with_block([&](json& block) { block["recording"][key] = value; });
  };
  EXPECT_THAT(facts("slices", 1000001), HasSubstr("slices"));
  EXPECT_THAT(facts("slices", -1), HasSubstr("slices"));
  EXPECT_THAT(facts("slices", 4), HasSubstr("expected a slice below 4"));
  EXPECT_THAT(facts("parts", 2000000000), HasSubstr("parts"));
  EXPECT_THAT(facts("crc32", "x"), HasSubstr("crc32"));
  EXPECT_THAT(facts("other_uv_images", json::array({5})), HasSubstr("other_uv_images"));
  EXPECT_THAT(read_with_block([](json& b) { b.erase("recording"); }), HasSubstr("recording"));
  EXPECT_THAT(read_with_block([](json& b) { b.erase("resin"); }), HasSubstr("resin"));
  // More showings than the table may have room for.
  EXPECT_THAT(read_with(table() + std::string(10000, ' '), true, 5, 0), HasSubstr(kTable));
}

TEST_F(RecordingDamage, VersionsAreHeld) {
  json config = json::parse(test::to_text(test::entry(entries_, "config.json")));
  EXPECT_EQ(config["slicecorr"]["format"], 4);
  EXPECT_EQ(config["slicecorr"]["kind"], "recorded");
  EXPECT_THAT(read_with_block([](json& b) { b["format"] = 16; }),
              HasSubstr("made by a newer version of this program: format 16"));
  // What readers of format 3 know does not include a recording.
  EXPECT_THAT(read_with_block([](json& b) { b["format"] = 3; }), HasSubstr("kind"));
}

TEST(RecordingFormat, OtherStacksStayAsTheyAre) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 2, 8);
  test::write_stack(folder / "a.uvj", images, print_info(images.grid));
  const test::Entries entries = test::unzip(folder / "a.uvj");
  for (const auto& [name, data] : entries) {
    if (name != "config.json") continue;
    const json block = json::parse(test::to_text(data))["slicecorr"];
    EXPECT_EQ(block["format"], 1);
    EXPECT_FALSE(block.contains("recording"));
  }
}

// ---- programs --------------------------------------------------------------------------------

class RecordingProgram : public testing::Test {
 protected:
  RecordingProgram() {
    // A block on the platform, corrected for its printer, and what a machine showed of it: each
    // frame a tenth of a slice late.
    Images target{{16, 12, 20, 50, 50, 50}, {}};
    for (int n = 0; n < 20; ++n) {
      Bytes pixels(16 * 12);
      for (std::size_t y = 3; y < 9; ++y) {
        for (std::size_t x = 4; x < 12; ++x) pixels[y * 16 + x] = 255;
      }
      target.slices.push_back(pixels);
    }
    test::write_stack(target_, target, test::info_of(target.grid));
    StackInfo info = print_info(target.grid);
    const slicecorr::Setup setup{*info.printer, *info.resin, *info.process};
    correct_stack(StackReader(target_, folder_.path()), setup, corrected_, {}, {});
    const StackReader stack(corrected_, folder_.path());
    RecordingWriter writer(recorded_, stack.info());
    Recording late;
    Bytes pixels(16 * 12);
    for (int n = 0; n < stack.grid().layers; ++n) {
      stack.read_slice(n, pixels.data());
      writer.add_image(pixels.data());
      const double z = 50.0 * n;
      const std::vector<Showing> showings{{n - 1, 0.1, 0, z, z + 5, 277.8, 1},
                                          {n, 0.9, 0, z + 5, z + 50, 277.8, 1}};
      late.add_slice(showings);
    }
    // The end of the last one lies beyond the plan.
    const double z = 50.0 * stack.grid().layers;
    const Showing rest{stack.grid().layers - 1, 0.1, 0, z, z + 5, 277.8, 1};
    late.add_slice({&rest, 1});
    writer.finish(late);
  }
  test::RunResult run(const std::vector<std::string>& arguments) {
    std::vector<std::string> command{SLICECORR_BIN_DIR "/slicecorr"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return test::run_program(command);
  }

  TemporaryFolder folder_;
  std::string target_ = folder_ / "target.uvj", corrected_ = folder_ / "corrected.uvj",
              recorded_ = folder_ / "shown.uvj";
};

TEST_F(RecordingProgram, InfoSaysIt) {
  const auto words = run({"info", recorded_});
  EXPECT_EQ(words.exit_code, 0) << words.err;
  EXPECT_THAT(words.out, HasSubstr("kind         recorded"));
  EXPECT_THAT(words.out, HasSubstr("slices with light, of 2 images at most"));
  EXPECT_THAT(words.out, HasSubstr("light        0.1 to 1 of that of the plan"));
  const json j = json::parse(run({"info", recorded_, "--json", "-"}).out);
  EXPECT_EQ(j["kind"], "recorded");
  EXPECT_EQ(j["recording"]["slices"], j["layers"]);
  EXPECT_EQ(j["recording"]["most_images_in_a_slice"], 2);
  EXPECT_EQ(j["target_layers"], 20);
  // The way of all images at the speed that was measured; dark in between, which nobody has timed.
  const double lit_s = (50 * j["recording"]["images"].get<double>() + 5) / 277.8;
  EXPECT_NEAR(j["light_s"], lit_s, 1e-9);
  EXPECT_TRUE(j["print_time_s"].is_null());
  EXPECT_THAT(words.out,
              HasSubstr("with light, as recorded: nobody has timed what was dark between"));
}

TEST_F(RecordingProgram, VerifyProbeReportAndSectionFollowIt) {
  const auto verify = run({"verify", recorded_, "--target", target_, "--json", "-"});
  ASSERT_EQ(verify.exit_code, 0) << verify.err;
  const json shown = json::parse(verify.out);
  const json planned =
      json::parse(run({"verify", corrected_, "--target", target_, "--json", "-"}).out);
  EXPECT_EQ(shown["layers"], planned["layers"].get<int>() + 1);
  EXPECT_EQ(shown["target_voxels"], planned["target_voxels"]);
  // Everything comes 5 um late, and so does the end of the block.
  const double moved = shown["height_error_um"]["max_abs"].get<double>() -
                       planned["height_error_um"]["max_abs"].get<double>();
  // Edges of the plan lie on either side, within their tolerance.
  EXPECT_NEAR(moved, 5, 2 * 0.05 * 1.44);
  const auto probe = run({"probe", recorded_, "--x", "5", "--y", "5", "--target", target_});
  EXPECT_EQ(probe.exit_code, 0) << probe.err;
  EXPECT_EQ(std::count(probe.out.begin(), probe.out.end(), '\n'), 1 + shown["layers"].get<int>());
  EXPECT_EQ(run({"report", recorded_, "--target", target_, "-o", folder_ / "r.html"}).exit_code, 0);
  EXPECT_THAT(test::to_text(test::read_file(folder_ / "r.html")), HasSubstr("recorded"));
  EXPECT_EQ(run({"section", recorded_, "--target", target_, "-o", folder_ / "s.png"}).exit_code, 0);
  EXPECT_EQ(run({"solid", recorded_, "-o", folder_ / "s.stl"}).exit_code, 0);
  EXPECT_EQ(run({"verify", recorded_, "--target", target_, "--max-height-error-um", "3"}).exit_code,
            5);
}

TEST_F(RecordingProgram, OthersRefuseItByName) {
  const auto refused = [&](const std::vector<std::string>& arguments, const char* why) {
    const auto result = run(arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments[0] << result.err;
    EXPECT_THAT(result.err, HasSubstr(why)) << arguments[0];
  };
  refused({"convert", recorded_, "-o", folder_ / "x.sl1"}, "recording");
  refused({"convert", recorded_, "-o", folder_ / "x.uvj"}, "recording");
  refused({"correct", recorded_, "-o", folder_ / "x.uvj", "--printer", "dual-wavelength-dlp",
           "--resin", "egg-resin", "--speed-mm-h", "800"},
          "recording");
  refused({"verify", corrected_, "--target", recorded_}, "recording");
  refused({"simulate", recorded_, "--x", "5", "--y", "5", "-o", folder_ / "x.svg"}, "recording");
  refused({"verify", recorded_, "--target", target_, "--speed-mm-h", "500"},
          "are those of that print");
  EXPECT_EQ(folder_.count(), 3);
}

}  // namespace
}  // namespace slicecorr
