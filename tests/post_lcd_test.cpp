// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What owners of an LCD printer run into on their first day: speeds for printers that lift, files that were
/// corrected already, light that is assumed, and words that are written apart.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "post_fixture.hpp"
#include "slicecorr/even_greys.hpp"

namespace slicecorr::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr const char* kDark =
    "name = \"dark\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n[blue]\n"
    "wavelength_nm = 405\ncalibration = \"to be measured\"\n[stage]\ntravel_mm = 100\n";
const Command kGuess{"--printer", "dark.toml", "--resin", "liqcreate-strong-x-405nm",
                     "--assume",  "typical"};

class PostLcd : public PostFolder {
 protected:
  PostLcd() {
    make_sl1(folder_ / "part.sl1");
    write("dark.toml", kDark);
    // That of the database then, not one of the user's own.
    fs::remove(folder_ / "db/liqcreate-strong-x-405nm.toml");
    make_ctb();
  }
  void make_ctb() const { ok({"convert", "part.sl1", "-o", "part.ctb"}); }
  RunResult slicecorr(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments, options_);
  }
  RunResult ok(const Command& arguments) const {
    RunResult r = slicecorr(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r;
  }
  static void refused(const RunResult& r, const std::vector<std::string>& words) {
    EXPECT_EQ(r.exit_code, 2) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
  }
};

TEST_F(PostLcd, PrintersThatLiftTakeNoSpeed) {
  const Command speed = kSmall + Command{"--speed-mm-h", "900"};
  const Bytes before = bytes("part.ctb");
  const std::vector<std::string> why{"the format ctb lift after each layer",
                                     "expected no --speed-mm-h",
                                     "--mode continuous only where the platform does not lift"};
  refused(post(speed + Command{"part.ctb"}), why);
  refused(slicecorr(Command{"correct", "part.ctb", "-o", "other.uvj"} + speed), why);
  refused(slicecorr(Command{"correct", "part.sl1", "-o", "other.ctb"} + speed), why);
  EXPECT_EQ(bytes("part.ctb"), before);
  EXPECT_FALSE(there("other.uvj") || there("other.ctb"));
  // Who says that nothing lifts is heard, and told until when it holds.
  const RunResult said = good(speed + Command{"--mode", "continuous", "part.ctb"});
  EXPECT_THAT(said.err, AllOf(HasSubstr("printers that read them lift after each"),
                              HasSubstr("All this holds only where the platform moves"),
                              HasSubstr("the format ctb lift after each layer.")));
  // Machines of people's own read SL1 archives, too: told, not refused.
  const RunResult sl1 = good(speed + Command{"part.sl1"});
  EXPECT_THAT(sl1.err, AllOf(HasSubstr("SL1 archives can't say that the platform moves"),
                             HasSubstr("the format sl1 lift after each layer as a rule.")));
}

TEST_F(PostLcd, AConvertedPrintThatMovesIsTold) {
  const RunResult made =
      ok(Command{"correct", "part.sl1", "-o", "s.uvj", "--speed-mm-h", "900"} + kSmall);
  EXPECT_THAT(made.err, Not(HasSubstr("lift after each")));
  for (const char* to : {"s.sl1", "s.goo"}) {
    EXPECT_THAT(ok({"convert", "s.uvj", "-o", to}).err,
                HasSubstr("printers that read them lift after each"));
  }
  // Layer by layer there is nothing to tell.
  EXPECT_THAT(good(kSmall + Command{"part.sl1"}).err, Not(HasSubstr("lift after each")));
}

TEST_F(PostLcd, WhatWasCorrectedAlreadyIsSeen) {
  const char* const words = "look as if they were corrected already";
  EXPECT_THAT(good(kSmall + Command{"part.ctb"}).err, Not(HasSubstr(words)));
  refused(post(kSmall + Command{"part.ctb"}), {"is already corrected"});
  // As on a stick: without what says so.
  fs::create_directory(folder_ / "usb");
  fs::copy_file(folder_ / "part.ctb", folder_ / "usb/part.ctb");
  EXPECT_THAT(ok(Command{"correct", "usb/part.ctb", "-o", "usb/again.ctb"} + kSmall +
                 Command{"--mode", "layerwise"})
                  .err,
              HasSubstr(words));
  EXPECT_THAT(good(kSmall + Command{"usb/part.ctb"}).err, HasSubstr(words));
}

/// A source of one slice.
class OneSlice : public SliceSource {
 public:
  explicit OneSlice(GreyImage image) : image_(std::move(image)) {}
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> rows;
    for (int y = band.y0; y < band.y1; ++y) {
      const auto from = image_.pixels.begin() + y * image_.width_px;
      rows.insert(rows.end(), from + band.x0, from + band.x1);
    }
    sink(0, rows.data());
  }

 private:
  GreyImage image_;
  Grid grid_{image_.width_px, image_.height_px, 1, 50, 50, 50};
};

// One grey over an area counts, but not a line of it, a ramp, nor white.
TEST(EvenGreys, AreasCount) {
  GreyImage image{60, 8, std::vector<std::uint8_t>(480)};
  const auto at = [&](int x, int y) -> std::uint8_t& {
    return image.pixels[static_cast<std::size_t>(y * 60 + x)];
  };
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 10; ++x) at(x, y) = 90;                                        // 8 x 6
    for (int x = 20; x < 30; ++x) at(x, y) = 255;                                      // white
    for (int x = 30; x < 40; ++x) at(x, y) = static_cast<std::uint8_t>(10 * x - 250);  // a ramp
    at(50, y) = at(51, y) = 70;                                                        // lines
  }
  const EvenGreys found = even_greys(OneSlice(image));
  EXPECT_EQ(found.pixels, 48U);
  EXPECT_EQ(found.lit_pixels, 8U * 32);
  EXPECT_EQ(found.layers, 1);
  EXPECT_EQ(found.first, 0);
  EXPECT_FALSE(found.look_corrected());  // less than a hundred
  EXPECT_TRUE((EvenGreys{100, 200000, 1, 0}).look_corrected());
  EXPECT_FALSE((EvenGreys{100, 202000, 1, 0}).look_corrected());
}

// Files of slicers with anti-aliasing.
TEST(EvenGreys, RealFilesOfSlicersHaveFew) {
  for (const char* name : {"slices/binary/mariner_pyramid.v3.ctb", "slices/sl1/numbers.sl1",
                           "slices/binary/uv3dp_microsupports3.lgs"}) {
    SCOPED_TRACE(name);
    const TemporaryFolder scratch;
    const StackReader stack(real_file(name), scratch.path(), {}, {50, 50, 50});
    const EvenGreys found = even_greys(stack);
    RecordProperty(fs::path(name).stem().string(), std::to_string(found.pixels));
    EXPECT_FALSE(found.look_corrected()) << found.pixels << " of " << found.lit_pixels;
  }
}

TEST_F(PostLcd, WhatIsAssumedIsToldWhereverItCounts) {
  Sl1Options o;
  o.exposure_s = 2.5;
  o.first_s = 30;
  make_sl1(folder_ / "part.sl1", o);
  make_ctb();
  const auto told = [](const RunResult& r) {
    EXPECT_THAT(r.err, AllOf(HasSubstr("assumed, not measured"),
                             HasSubstr("is from the database, not measured on this printer"),
                             HasSubstr("a factor of 2.7 (95 %)")));
  };
  told(good(kGuess + Command{"--backup", "part.ctb"}));
  const Command verify{"verify", "part.ctb", "--target", "part.ctb.orig", "--json", "-"};
  const RunResult alone = ok(verify);
  told(alone);
  told(ok({"report", "part.ctb", "--target", "part.ctb.orig", "-o", "part.html"}));
  // Options that are repeated change nothing.
  const auto a = nlohmann::json::parse(alone.out),
             b = nlohmann::json::parse(ok(verify + kGuess).out);
  EXPECT_EQ(a["assumed"], "mono-lcd-405");
  EXPECT_EQ(b["assumed"], "mono-lcd-405");
  const double least = a["joints"]["least"], again = b["joints"]["least"];
  // 1.2 times sqrt(2.5): what holds, with its margin, and at most all light (times 2 more).
  EXPECT_GE(least, 1.2 * std::sqrt(2.5) * 0.99);
  EXPECT_NEAR(again, least, 1e-9 * least);
  ASSERT_TRUE(a.contains("loose_bodies"));
  EXPECT_EQ(a["loose_bodies"], b["loose_bodies"]);
  EXPECT_EQ(a["cure_through_voxels"], b["cure_through_voxels"]);
  EXPECT_NEAR(a["height_error_um"]["mean_abs"], b["height_error_um"]["mean_abs"], 1e-9);
  // The way to the figures is said.
  refused(slicecorr({"verify", "part.ctb"}),
          {"part.ctb.orig lies beside the stack", "expected --target part.ctb.orig"});
  refused(slicecorr(Command{"verify", "part.ctb.orig", "--target", "part.ctb.orig"} + kGuess),
          {"expected --mode layerwise, which takes the archive's exposure times"});
}

TEST_F(PostLcd, PrintersSaidToShowNoGrey) {
  const char* const words = "is said to show no grey at all";
  EXPECT_THAT(good(kGuess + Command{"part.ctb"}).err, Not(HasSubstr(words)));
  make_ctb();
  std::string dark = kDark;
  dark.insert(dark.find("[blue]"), "grey = \"said to be none\"\n");
  write("dark.toml", dark);
  EXPECT_THAT(good(kGuess + Command{"part.sl1"}).err, HasSubstr(words));
}

TEST_F(PostLcd, WordsThatAreWrittenApart) {
  refused(post(kSmall + Command{"--backup", "replace", "part.sl1"}), {"--backup=replace"});
  refused(slicecorr(Command{"correct", "part.sl1", "-o", "x.uvj", "--other-wavelength", "take"} +
                    kSmall),
          {"--other-wavelength=take"});
  EXPECT_THAT(good({"--help"}).out,
              AllOf(HasSubstr("--backup[=keep,replace,no]"),
                    HasSubstr("--other-wavelength[=refuse,take]"), Not(HasSubstr("{keep}"))));
}

TEST_F(PostLcd, WatchingOnceEndsAsWhatFailed) {
  fs::create_directory(folder_ / "in");
  Sl1Options weak;
  weak.exposure_s = weak.first_s = 0.001;
  make_sl1(folder_ / "in/weak.sl1", weak);
  const Command watch =
      kSmall + Command{"--watch", "in", "--once", "--settle-s", "0.05", "--patience-s", "0"};
  EXPECT_EQ(post(kSmall + Command{"in/weak.sl1"}).exit_code, 3);
  EXPECT_EQ(post(watch).exit_code, 3);
  write("in/bad.sl1", "nothing");
  EXPECT_EQ(post(watch).exit_code, 2);
}

TEST_F(PostLcd, TheWayIntoFilesThatAreOnlyChangedIsSaid) {
  refused(slicecorr({"convert", "part.sl1", "-o", "part.pwmx"}),
          {"slice the part into UVJ", "as the template", "correct the result"});
}

}  // namespace
}  // namespace slicecorr::test
