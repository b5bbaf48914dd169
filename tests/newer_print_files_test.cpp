// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What print files of newer printers say: Anycubic's zip, CXDLP 4, Photon Workshop 518, CTB 5.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <map>
#include <string_view>

#include "newer_print_file_fixture.hpp"
#include "program_fixture.hpp"
#include "refusal.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/formats/exposure_pattern.hpp"

namespace slicecorr::test {

void PrintTo(const SmallFile& file, std::ostream* out);

namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class NewerPrintFiles : public testing::Test {
 protected:
  std::string put(const SmallFile& small) {
    write_file(folder_ / small.name, small.bytes);
    return folder_ / small.name;
  }
  StackReader reader(const SmallFile& small, std::string* told = nullptr) {
    ExecutionContext context;
    if (told) context.notice = [told](const std::string& text) { *told += text + "\n"; };
    return {put(small), folder_.path(), context};
  }
  /// The zip with a text of its settings replaced.
  static SmallFile zip_with(const std::vector<std::pair<std::string, std::string>>& changes) {
    SmallFile small = small_anycubic_zip();
    Entries entries = anycubic_entries(small.slices);
    Bytes& bytes = entry(entries, "anycubic_photon_resins.pwsp");
    std::string text(bytes.begin(), bytes.end());
    for (const auto& [what, by] : changes) {
      const std::size_t at = text.find(what);
      EXPECT_NE(at, text.npos) << what;
      text.replace(at, what.size(), by);
    }
    bytes = to_bytes(text);
    small.bytes = zip_bytes(entries);
    return small;
  }
  TemporaryFolder folder_;
};

TEST_F(NewerPrintFiles, TheZipSaysItsLifts) {
  const StackReader plain = reader(small_anycubic_zip());
  EXPECT_EQ(plain.info().profiles.printer, "Small");
  EXPECT_EQ(plain.info().profiles.material, "Grey");
  EXPECT_EQ(plain.info().own_print_time_s, 500);
  EXPECT_FALSE(plain.info().orientation_known);
  ASSERT_TRUE(plain.info().lift_times);
  LiftMotion wanted;
  wanted.up_mm = 6;
  wanted.up_mm_s = 3;
  wanted.back_mm_s = 4;
  wanted.before_light_s = 0.5;
  wanted.after_lift_s = 0.25;
  EXPECT_EQ(plain.info().lift_times->normal, wanted);
  EXPECT_EQ(plain.info().lift_times->bottom, wanted);
  EXPECT_TRUE(plain.info().lift_times->layers.empty());

  const StackReader stages =
      reader(zip_with({{"\"multi_state_used\": 0", "\"multi_state_used\": 1"}}));
  ASSERT_TRUE(stages.info().lift_times);
  // The stage next to the film is the first one up and the last one back.
  wanted.up_mm = 1;
  wanted.up_mm_s = 2;
  wanted.back_2_mm = 1;
  wanted.back_2_mm_s = 2.5;
  wanted.up_2_mm = 3;
  wanted.up_2_mm_s = 4;
  wanted.back_mm_s = 6;
  EXPECT_EQ(stages.info().lift_times->normal, wanted);
  EXPECT_EQ(stages.info().lift_times->bottom.up_2_mm, 4);
  EXPECT_EQ(stages.info().lift_times->bottom.back_2_mm_s, 1.5);
}

TEST_F(NewerPrintFiles, TheZipsOwnTimesCountWhereItsMarkIsSet) {
  // The head says 40 s for three layers, the list for one.
  std::string told;
  const StackReader by_head =
      reader(zip_with({{"\"bott_layers\": 1", "\"bott_layers\": 3"}}), &told);
  EXPECT_EQ(layer_exposure_s(process_of_times(by_head.info()), 2), 40);
  EXPECT_THAT(told, HasSubstr("do not heed times of single layers"));
  told.clear();
  const StackReader by_list =
      reader(zip_with({{"\"bott_layers\": 1", "\"bott_layers\": 3"},
                       {"\"use_indivi_layerpara\": 0", "\"use_indivi_layerpara\": 1"}}),
             &told);
  EXPECT_EQ(layer_exposure_s(process_of_times(by_list.info()), 2), 2.5);
  EXPECT_EQ(told, "");
  reader(zip_with({{"\"use_indivi_layerpara\": 0", "\"use_indivi_layerpara\": true"},
                   {"\"multi_state_used\": 0", "\"multi_state_used\": 1"}}),
         &told);
  EXPECT_THAT(told, HasSubstr("lifts have two stages"));
}

/// The printer may choose exposures by itself: told, and no other ones are written.
TEST_F(NewerPrintFiles, ExposuresThatThePrinterChoosesAreTold) {
  SmallFile pm5s = small_workshop_518();
  std::uint32_t header;
  std::memcpy(&header, pm5s.bytes.data() + 0x14, 4);
  pm5s.bytes[header + 0x6c] = 1;
  for (const SmallFile& small :
       {zip_with({{"\"intelli_mode\": 0", "\"intelli_mode\": 1"}}), pm5s}) {
    SCOPED_TRACE(small.name);
    std::string told;
    const StackReader stack = reader(small, &told);
    EXPECT_THAT(told, HasSubstr("printer chooses exposures by itself"));
    StackFile file(folder_ / ("out_" + small.name));
    file.format = small.format;
    file.keep_from = folder_ / small.name;
    convert_stack(stack, file, {});
    EXPECT_EQ(read_file(file.path), small.bytes);
    StackInfo info = stack.info();
    info.exposure_s = 3;
    EXPECT_THAT(refusal([&] {
                  write_stack(file, {stack.grid(), small.slices}, info);
                }),
                HasSubstr("printer chooses exposures by itself"));
  }
}

/// Of a zip only the entries change that have to; our record is one more.
TEST_F(NewerPrintFiles, TheZipKeepsItsOtherEntries) {
  const SmallFile small = small_anycubic_zip();
  const StackReader stack = reader(small);
  Images images{stack.grid(), small.slices};
  images.slices[2][100] = 255;
  images.slices[2][101] = 0;
  StackFile file(folder_ / "out.pm7");
  file.keep_from = folder_ / small.name;
  StackInfo info = stack.info();
  info.kind = StackKind::target;
  write_stack(file, images, info);
  EXPECT_EQ(StackReader::read_info(file.path).kind, StackKind::target);
  EXPECT_FALSE(std::filesystem::exists(record_beside(file.path)));
  EXPECT_EQ(StackReader(file.path, folder_.path()).images_changed(), false);
  const Entries before = unzip(folder_ / small.name), after = unzip(file.path);
  ASSERT_EQ(after.size(), before.size() + 1);
  EXPECT_EQ(after.back().first, "slicecorr.json");
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].first, before[i].first);
    EXPECT_EQ(after[i].second == before[i].second, before[i].first != "layer_images/layer_2.pw0Img")
        << before[i].first;
  }
}

TEST_F(NewerPrintFiles, TheZipIsKnownByItsEntries) {
  const SmallFile small = small_anycubic_zip();
  write_file(folder_ / "part.zip", small.bytes);
  EXPECT_EQ(StackReader::read_info(folder_ / "part.zip").format, "anycubic-zip");
  EXPECT_EQ(format_of(StackFile(folder_ / "a.pwsz")), "anycubic-zip");
  EXPECT_EQ(format_of(StackFile(folder_ / "a.pm7m")), "anycubic-zip");
}

TEST_F(NewerPrintFiles, Cxdlp4SaysItsLiftsLightAndMirror) {
  std::string told;
  const StackReader stack = reader(small_cxdlp4(0), &told);
  EXPECT_EQ(told, "");
  EXPECT_EQ(stack.info().profiles.printer, "CL-103L");
  EXPECT_TRUE(stack.info().orientation_known);
  EXPECT_TRUE(stack.info().orientation.mirror_x);
  ASSERT_TRUE(stack.info().lift_times);
  const LiftMotion& m = stack.info().lift_times->normal;
  // Lifts are told as a whole: 5 mm, of which 1 mm is the second stage.
  EXPECT_EQ(m.up_mm, 4);
  EXPECT_NEAR(m.up_mm_s, 80 / 60.0, 1e-9);
  EXPECT_EQ(m.up_2_mm, 1);
  EXPECT_EQ(m.up_2_mm_s, 3);
  EXPECT_EQ(m.back_mm_s, 2.5);
  EXPECT_EQ(m.back_2_mm, 2);
  EXPECT_EQ(m.before_lift_s, 0.75);
  EXPECT_EQ(m.after_lift_s, 0.25);
  EXPECT_EQ(m.before_light_s, 0.5);
  EXPECT_EQ(stack.info().lift_times->bottom.up_mm, 4);
  EXPECT_EQ(stack.info().lift_times->bottom.up_mm_s, 1);
  EXPECT_TRUE(stack.info().light_share.empty());

  StackInfo info = stack.info();
  info.light_share.assign(kFileLayers, 128 / 255.0);
  info.light_share[0] = 1;
  StackFile file(folder_ / "dim.cxdlp");
  file.keep_from = folder_ / small_cxdlp4(0).name;
  write_stack(file, {stack.grid(), small_cxdlp4(0).slices}, info);
  const StackInfo dim = StackReader::read_info(file.path);
  EXPECT_EQ(detail::share_of_layer(dim, 0), 1);
  for (int n = 1; n < kFileLayers; ++n) {
    EXPECT_NEAR(detail::share_of_layer(dim, n), 128 / 255.0, 1e-12) << n;
  }
  // The mark is not set, so no layer has light of its own.
  info.light_share[2] = 1;
  EXPECT_THAT(refusal([&] {
                write_stack(file, {stack.grid(), small_cxdlp4(0).slices}, info);
              }),
              HasSubstr("light of their own"));
}

// A stopwatch at the printer shows the same of a file that was converted, to CTB and to GOO: stages, ways,
// speeds, and waits. The bytes are looked at past the reader, at the places of the published layouts.
TEST_F(NewerPrintFiles, NewFilesSayTheLiftsOfTheFileThatWasRead) {
  const StackReader stack = reader(small_cxdlp4(0));
  const auto f32 = [](const Bytes& bytes, std::size_t at, bool big) {
    std::uint32_t v;
    std::memcpy(&v, bytes.data() + at, 4);
    return std::bit_cast<float>(big ? __builtin_bswap32(v) : v);
  };
  const auto u32 = [](const Bytes& bytes, std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  for (const bool own : {false, true}) {
    StackInfo info = stack.info();
    ASSERT_TRUE(info.lift_times && info.lift_times->by_archive);
    info.bottom_layers = info.lift_times->bottom_layers = 1;
    info.bottom_exposure_s = 40;
    info.lift_times->bottom.up_mm = 7;
    // Heads of CTB files have no waits of bottom layers.
    if (own) info.lift_times->bottom.before_light_s = 3;
    for (const char* name : {"new.ctb", "new.goo"}) {
      SCOPED_TRACE(testing::Message() << name << own);
      const StackFile file(folder_ / name);
      write_stack(file, {stack.grid(), small_cxdlp4(0).slices}, info);
      const StackInfo again = StackReader::read_info(file.path);
      ASSERT_TRUE(again.lift_times);
      for (int n = 0; n < kFileLayers; ++n) {
        const LiftMotion &a = info.lift_times->of(n), &b = again.lift_times->of(n);
        EXPECT_EQ(a.up_mm, b.up_mm);
        EXPECT_NEAR(a.up_mm_s, b.up_mm_s, 1e-6);
        EXPECT_EQ(a.up_2_mm, b.up_2_mm);
        EXPECT_EQ(a.up_2_mm_s, b.up_2_mm_s);
        EXPECT_EQ(a.back_mm_s, b.back_mm_s);
        EXPECT_EQ(a.back_2_mm, b.back_2_mm);
        EXPECT_EQ(a.before_lift_s, b.before_lift_s);
        EXPECT_EQ(a.after_lift_s, b.after_lift_s);
        EXPECT_NEAR(dark_time(a, 50).all_s(), dark_time(b, 50).all_s(), 1e-5) << n;
      }
    }
    const Bytes ctb = read_file(folder_ / "new.ctb"), goo = read_file(folder_ / "new.goo");
    const std::size_t print = u32(ctb, 0x54), v4 = u32(ctb, u32(ctb, 0x68) + 0x40);
    EXPECT_EQ(f32(ctb, print, false), 9);        // bottom lift: 7 mm and a second stage of 2
    EXPECT_EQ(f32(ctb, print + 8, false), 5);    // lift
    EXPECT_EQ(f32(ctb, print + 12, false), 80);  // its speed
    EXPECT_EQ(f32(ctb, v4 + 0x18, false), 0.5F);
    EXPECT_EQ(f32(ctb, v4 + 0x1c, false), 0.25F);
    EXPECT_EQ(f32(ctb, v4 + 0x20, false), 0.75F);
    EXPECT_EQ(f32(goo, 0x2fb11 + 12, true), 0.75F);
    EXPECT_EQ(f32(goo, 0x2fb11 + 16, true), 0.25F);
    EXPECT_EQ(f32(goo, 0x2fb11 + 20, true), 0.5F);
    EXPECT_EQ(f32(goo, 0x2fb11 + 8, true), own ? 3 : 0.5F);
  }
}

// A format that has no place for lifts says which are left behind.
TEST_F(NewerPrintFiles, LiftsThatAreLeftBehindAreTold) {
  const StackReader stack = reader(small_cxdlp4(0));
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& line) { told += line + "\n"; };
  write_stack(folder_ / "new.sl1", {stack.grid(), small_cxdlp4(0).slices}, stack.info(), context);
  EXPECT_THAT(told, HasSubstr("lifts of the file that was read, 5 mm at "));
  EXPECT_THAT(told, HasSubstr("the file names an SL1, which has 1440 x 2560"));
}

TEST_F(NewerPrintFiles, Cxdlp4sOwnSettingsCountWhereItsMarkIsSet) {
  const auto u32 = [](const Bytes& bytes, std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, bytes.data() + at, 4);
    return v;
  };
  const auto f32 = [&](const Bytes& bytes, std::size_t at) {
    return std::bit_cast<float>(u32(bytes, at));
  };
  const auto layer = [&](const Bytes& bytes, std::size_t n) {
    return u32(bytes, u32(bytes, kCxdlp4Head + 0x20) + n * 0x28 + 0x0c);
  };
  for (const bool marked : {false, true}) {
    SCOPED_TRACE(marked);
    const SmallFile small = small_cxdlp4(0, [&](FileMaker& m) {
      m.set_u32(u32(m.bytes, kCxdlp4Head + 0x48) + 0x1c, marked ? 1 : 0);
      m.set_f32(u32(m.bytes, kCxdlp4Head + 0x20) + 2 * 0x28 + 4, 7);
      m.set_f32(layer(m.bytes, 2) + 0x28, 51);
      m.set_f32(layer(m.bytes, 2), 9);
    });
    const StackReader stack = reader(small);
    EXPECT_EQ(layer_exposure_s(process_of_times(stack.info()), 2), marked ? 7 : 2.5);
    EXPECT_NEAR(detail::share_of_layer(stack.info(), 2), marked ? 0.2 : 1, 1e-12);
    EXPECT_EQ(detail::share_of_layer(stack.info(), 1), 1);
    ASSERT_TRUE(stack.info().lift_times);
    EXPECT_EQ(stack.info().lift_times->of(2).up_mm, marked ? 8 : 4);
    // Light is changed in the head and in each layer.
    StackInfo info = stack.info();
    info.light_share.assign(kFileLayers, 102 / 255.0);
    StackFile file(folder_ / "dim.cxdlp");
    file.keep_from = folder_ / small.name;
    write_stack(file, {stack.grid(), small.slices}, info);
    const Bytes dim = read_file(file.path);
    EXPECT_EQ(u32(dim, kCxdlp4Head + 0x40), 102u << 16 | 102);
    for (std::size_t n = 0; n < kFileLayers; ++n) EXPECT_EQ(f32(dim, layer(dim, n) + 0x28), 102);
  }
}

TEST_F(NewerPrintFiles, Cxdlp4WithTwoKindsOfExposuresIsTold) {
  const SmallFile small = small_cxdlp4(0, [](FileMaker& m) {
    std::uint32_t slicer;
    std::memcpy(&slicer, m.bytes.data() + kCxdlp4Head + 0x48, 4);
    m.set_f32(slicer + 0x34, 9);
  });
  std::string told;
  EXPECT_EQ(reader(small, &told).info().exposure_s, 2.5);
  EXPECT_THAT(told,
              HasSubstr("2.5 and 40 s in the settings of the print, which count, 9 and 40 s"));
}

TEST_F(NewerPrintFiles, Workshop518SaysItsLifts) {
  const StackReader stack = reader(small_workshop_518());
  EXPECT_EQ(stack.info().profiles.printer, "Small");
  ASSERT_TRUE(stack.info().lift_times);
  EXPECT_EQ(stack.info().lift_times->normal.up_mm, 1);
  EXPECT_EQ(stack.info().lift_times->normal.up_2_mm, 3);
  EXPECT_EQ(stack.info().lift_times->bottom.up_mm, 2);
  EXPECT_EQ(limits_of_format("photon-workshop").made_new, false);
}

TEST_F(NewerPrintFiles, Ctb5SaysItsResin) {
  const StackReader stack = reader(small_ctb5());
  EXPECT_EQ(stack.info().profiles.printer, "Small");
  EXPECT_EQ(stack.info().profiles.material, "Grey");
}

// ---- programs ---------------------------------------------------------------------------------

class NewerPrintFilesProgram : public ProgramFixture,
                               public testing::WithParamInterface<SmallFile> {
 protected:
  NewerPrintFilesProgram() {
    write("lcd.toml",
          "name = \"lcd\"\nmaker = \"Works\"\nproduct = \"Lcd\"\n[display]\nwidth_px = 40\n"
          "height_px = 30\npixel_um = 50.0\nmirror = \"x\"\n[blue]\nwavelength_nm = 405\n"
          "calibration = [[0, 0.002], [255, 4.0]]\n[stage]\ntravel_mm = 100\n");
    write_file(folder_ / part(), GetParam().bytes);
  }
  static std::string part() { return GetParam().name; }
  RunResult run(const std::string& program, const Command& arguments) const {
    const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/" + program} + arguments, options_);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r;
  }
  /// Of a file; of a zip its entries without our record, in which the SHA-256 of the backup stands.
  Entries bytes_of(const std::string& name) const {
    if (GetParam().format != "anycubic-zip") return {{"", read_file(folder_ / name)}};
    Entries entries = unzip(folder_ / name);
    std::erase_if(entries, [](const auto& e) { return e.first == "slicecorr.json"; });
    return entries;
  }
  const Command light_{"--printer", "lcd.toml", "--resin", "liqcreate-strong-x-405nm"};
  const Command layers_{"--mode", "layerwise", "--exposure-s", "24"};
};
INSTANTIATE_TEST_SUITE_P(Small, NewerPrintFilesProgram,
                         testing::Values(small_anycubic_zip(), small_cxdlp4(0x1234567),
                                         small_workshop_518(), small_ctb5()),
                         [](const auto& info) { return name_of(info.param.name); });

TEST_P(NewerPrintFilesProgram, PostCorrectsInPlaceAsCorrectDoes) {
  const std::string wanted = "wanted" + part().substr(part().rfind('.'));
  const RunResult corrected =
      run("slicecorr", Command{"correct", part(), "-o", wanted} + light_ + layers_);
  EXPECT_THAT(corrected.err, HasSubstr("holds"));  // fewer grey levels than the printer has
  run("slicecorr-post", light_ + layers_ + Command{"--backup", part()});
  EXPECT_TRUE(bytes_of(part()) == bytes_of(wanted));
  const StackInfo info = StackReader::read_info(folder_ / part());
  EXPECT_EQ(info.kind, StackKind::corrected);
  EXPECT_TRUE(info.parameters_checked);
  EXPECT_EQ(info.format, GetParam().format);
  EXPECT_EQ(info.exposure_s, 24);
  EXPECT_NE(read_images(StackReader(folder_ / part(), folder_.path())), GetParam().slices);
  // The second reader finds nothing wrong with it.
  const RunResult second = run_program(
      {"/usr/bin/python3", SLICECORR_SOURCE_DIR "/tests/print_files.py", folder_ / part()}, {});
  EXPECT_EQ(second.exit_code, 0) << second.err;
  // Not twice, and back.
  EXPECT_EQ(
      run_program(Command{SLICECORR_BIN_DIR "/slicecorr-post"} + light_ + layers_ + Command{part()},
                  options_)
          .exit_code,
      2);
  run("slicecorr-post", {"--undo", part()});
  EXPECT_EQ(read_file(folder_ / part()), GetParam().bytes);
}

// How high the machine builds stays in each new file whose format says it, as the file said it or the printer that is
// named; read at the places of the published layouts.
TEST_P(NewerPrintFilesProgram, NewFilesSayHowHighTheMachineIs) {
  const std::map<std::string, double> said{
      {"anycubic-zip", 100}, {"cxdlp", 180}, {"photon-workshop", 200}, {"ctb", 180}};
  const double mm = said.at(GetParam().format);
  EXPECT_EQ(StackReader::read_info(folder_ / part()).machine_height_mm, mm);
  const auto f32 = [&](const std::string& name, std::size_t at, bool big) {
    const Bytes bytes = read_file(folder_ / name);
    std::uint32_t v;
    std::memcpy(&v, bytes.data() + at, 4);
    return std::bit_cast<float>(big ? __builtin_bswap32(v) : v);
  };
  const auto text_of = [&](const std::string& name, const std::string& of) {
    Entries entries = unzip(folder_ / name);
    return to_text(entry(entries, of));
  };
  const auto expect = [&](const Command& with, double wanted_mm, const std::string& stem) {
    SCOPED_TRACE(stem);
    for (const char* ending : {".goo", "-again.ctb", "-zip.zip", ".cws", ".sl1", ".vdt"}) {
      Command command{"convert", part(), "-o", stem + ending};
      if (std::string_view(ending) == "-zip.zip")
        command = command + Command{"--format", "chitubox"};
      EXPECT_THAT(good(command + with).err, Not(HasSubstr("height of the machine is not known")));
    }
    EXPECT_EQ(f32(stem + ".goo", 0x2faf8 + 8, true), static_cast<float>(wanted_mm));
    // Into its own format a file keeps what it says.
    const bool kept = GetParam().format == "ctb";
    EXPECT_EQ(f32(stem + "-again.ctb", 0x10, false), static_cast<float>(kept ? mm : wanted_mm));
    const std::string number = fmt::format("{:g}", wanted_mm);
    EXPECT_THAT(text_of(stem + "-zip.zip", "run.gcode"), HasSubstr(";machineZ:" + number + "\n"));
    EXPECT_THAT(text_of(stem + ".cws", stem + ".gcode"),
                HasSubstr("Platform Z Size         = " + number + "mm"));
    EXPECT_THAT(text_of(stem + ".sl1", "prusaslicer.ini"),
                HasSubstr("max_print_height = " + number + "\n"));
    EXPECT_EQ(StackReader::read_info(folder_ / (stem + ".vdt")).machine_height_mm, wanted_mm);
  };
  expect({}, mm, "as-read");
  expect({"--printer", "lcd.toml"}, 100, "of-printer");
  // A correction for a printer whose file does not say it, and on through a UVJ, which has it in our block alone.
  const std::string lcd = to_text(read_file(folder_ / "lcd.toml"));
  write("low.toml", lcd.substr(0, lcd.find("[stage]")));
  good({"correct", part(), "-o", "c.uvj", "--printer", "low.toml", "--resin",
        "liqcreate-strong-x-405nm", "--mode", "layerwise", "--exposure-s", "24"});
  EXPECT_EQ(StackReader::read_info(folder_ / "c.uvj").machine_height_mm, mm);
  good({"convert", "c.uvj", "-o", "c.cws"});
  EXPECT_THAT(text_of("c.cws", "c.gcode"),
              HasSubstr(fmt::format("Platform Z Size         = {:g}mm", mm)));
}

TEST_P(NewerPrintFilesProgram, InfoTellsWhatTheFileSays) {
  const RunResult text = good({"info", part()});
  for (const char* words : {"exposure", "display", "lift", "anti-aliasing",
                            "times of single layers", "grey levels", "time shown"}) {
    EXPECT_THAT(text.out, HasSubstr(words));
  }
  // Its times make a resin, as those of other print files do.
  const RunResult made = run("resinctl", {"import", part(), "--intensity-mw-cm2", "4",
                                          "--height-um", "120", "--dry-run", "--name", "made"});
  EXPECT_THAT(made.out, HasSubstr("2.5 s is the exposure"));
}

}  // namespace
}  // namespace slicecorr::test
