// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// An F on the screen: what its eight ways say of a printer, by hand-made screens that turn and mirror; the part
// that shows it; and `resinctl new-printer`, which asks for it.
#include "slicecorr/letter_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>

#include "program_fixture.hpp"
#include "refusal.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

using Rows = std::vector<std::string>;

// Ways to turn pictures, made of rows of letters and sharing no code with the library.
Rows quarter(const Rows& p) {  // counter-clockwise
  Rows q(p[0].size(), std::string(p.size(), ' '));
  for (std::size_t y = 0; y < p.size(); ++y) {
    for (std::size_t x = 0; x < p[0].size(); ++x) q[p[0].size() - 1 - x][y] = p[y][x];
  }
  return q;
}
Rows left_to_right(Rows p) {
  for (std::string& row : p) std::reverse(row.begin(), row.end());
  return p;
}
Rows top_to_bottom(Rows p) {
  std::reverse(p.begin(), p.end());
  return p;
}
/// What a screen does: quarter turns, then mirrored or not.
Rows screen(Rows p, int quarters, bool mirrors) {
  for (int i = 0; i < quarters; ++i) p = quarter(p);
  return mirrors ? left_to_right(p) : p;
}
/// From the plate to the images that the display shows, as orientation.hpp says it in words.
Rows for_display(const Rows& plate, const Orientation& o) {
  Rows image = o.portrait ? quarter(plate) : plate;
  if (o.mirror_x) image = left_to_right(image);
  if (o.mirror_y) image = top_to_bottom(image);
  return image;
}
const Rows kF = {"#####", "#    ", "#    ", "#### ", "#    ", "#    ", "#    "};
const Rows kPlate = {"abc", "def"};  // no two places alike

int picture_like(const Rows& seen) {
  int found = 0;
  for (int number = 1; number <= 8; ++number) {
    if (letter_seen(kLetterTurns[static_cast<std::size_t>(number - 1)]) != seen) continue;
    EXPECT_EQ(found, 0);
    found = number;
  }
  EXPECT_NE(found, 0);
  return found;
}

TEST(Letter, EachWayIsOneOfEight) {
  std::set<Rows> all;
  for (const Turn& turn : kLetterTurns) all.insert(letter_seen(turn));
  EXPECT_EQ(all.size(), 8U);
  EXPECT_EQ(letter_seen(kLetterTurns[0]), kF);
  EXPECT_EQ(letter_seen(kLetterTurns[kRightLetter - 1]), left_to_right(kF));
}

TEST(Letter, TellsTheOrientationOfAnyScreen) {
  for (int way = 0; way < 8; ++way) {
    const int quarters = way % 4;
    const bool mirrors = way >= 4;
    // Shown as it is, or turned by what the printer's file said before.
    for (int said = 0; said < 8; ++said) {
      const Orientation before{(said & 1) != 0, (said & 2) != 0, (said & 4) != 0};
      const int number = picture_like(screen(for_display(kF, before), quarters, mirrors));
      const Orientation after = orientation_of_letter(number, before);
      // The part hangs head down from the platform, its front at the front: from above, left is right.
      EXPECT_EQ(screen(for_display(kPlate, after), quarters, mirrors), left_to_right(kPlate))
          << way << " " << said;
      EXPECT_EQ(after == before, number == kRightLetter);
    }
    // An F that is upright in the images themselves is one on a landscape display that mirrors nothing.
    const int number = picture_like(screen(kF, quarters, mirrors));
    EXPECT_EQ(orientation_of_letter(number), orientation_of_letter(number, Orientation{}));
  }
  for (const int number : {0, 9, -1}) {
    EXPECT_THAT(refusal([&] { orientation_of_letter(number); }), HasSubstr("from 1 to 8"));
  }
}

TEST(Letter, LinesAreReadBackAsTheyWereMeant) {
  for (int said = 0; said < 8; ++said) {
    const Orientation o{(said & 1) != 0, (said & 2) != 0, (said & 4) != 0};
    std::string text = "[display]\nwidth_px = 16\nheight_px = 9\npixel_um = 50\n";
    for (const std::string& line : orientation_lines(o)) text += line + "\n";
    text += "[blue]\ncalibration = [[0, 0], [255, 1]]\n";
    EXPECT_EQ(parse_printer(text, "p.toml").orientation, o) << text;
  }
}

TEST(Letter, FillsAnImageOfAnySize) {
  for (const auto& [wide, high] : {std::pair{160, 120}, {1440, 2560}, {70, 90}, {5, 7}, {3, 2}}) {
    const GreyImage image = letter_image(wide, high);
    ASSERT_EQ(image.pixels.size(), static_cast<std::size_t>(wide) * static_cast<std::size_t>(high));
    const auto lit = std::count(image.pixels.begin(), image.pixels.end(), 255);
    const int dot = std::max(1, std::min(wide / 7, high / 9));
    // 5 + 4 and the five others of the stem.
    if (wide >= 5 && high >= 7) {
      EXPECT_EQ(lit, 14 * dot * dot) << wide;
    }
    EXPECT_EQ(lit + std::count(image.pixels.begin(), image.pixels.end(), 0), wide * high);
  }
}

class LetterProgram : public ProgramFixture {
 protected:
  RunResult new_printer(const std::string& answers, const std::string& more = "") const {
    return run_program(
        {"/bin/sh", "-c",
         "printf '" + answers + "' | " SLICECORR_BIN_DIR "/resinctl new-printer -o . " + more},
        options_);
  }
  std::string text_in(const std::string& name) const { return to_text(read_file(folder_ / name)); }
  const std::string kAnswers = "mine\\n160\\n120\\n50\\n\\n405\\n0 1\\n255 100\\n\\n800\\n\\n";
};

TEST_F(LetterProgram, APlateWithAnFAndASheetThatSaysWhatItMeans) {
  // A display that lies across: an image of it is 120 wide and 160 high.
  write("turned.toml",
        "name = \"turned\"\n[display]\nwidth_px = 120\nheight_px = 160\npixel_um = 50.0\n"
        "orientation = \"portrait\"\nmirror = \"x\"\n[blue]\ncalibration = \"to be measured\"\n");
  const RunResult made = good({"testpart", "f", "--printer", "turned.toml", "-o", "f.goo",
                               "--picture", "f.png", "--exposure-s", "12"});
  EXPECT_THAT(made.err, AllOf(HasSubstr("f.html"), HasSubstr("turned.toml")));
  // What the display shows is the upright F of the plate, turned as the file says.
  const GreyImage plate = letter_image(160, 120);
  const Bytes shown = grey_of_png(read_file(folder_ / "f.png"));
  ASSERT_EQ(shown.size(), plate.pixels.size());
  Rows rows;
  for (int y = 0; y < 120; ++y) {
    rows.emplace_back(plate.pixels.begin() + y * 160, plate.pixels.begin() + (y + 1) * 160);
  }
  std::string expected;
  for (const std::string& row : for_display(rows, {true, true, false})) expected += row;
  EXPECT_EQ(std::string(shown.begin(), shown.end()), expected);
  const std::string sheet = text_in("f.html");
  EXPECT_THAT(sheet, AllOf(HasSubstr("How does the F stand?"), HasSubstr("12 s"),
                           HasSubstr("Picture 2 is right"), HasSubstr("turned.toml")));
  for (int number = 1; number <= 8; ++number) {
    const Orientation o = orientation_of_letter(number, {true, true, false});
    const std::string lines =
        std::regex_replace(orientation_lines(o)[0], std::regex("\""), "&quot;");
    EXPECT_THAT(sheet, HasSubstr("<td>" + std::string(lines))) << number;
  }
  const auto info = nlohmann::json::parse(good({"info", "f.goo", "--json", "-"}).out);
  EXPECT_EQ(info["layers"], 4);
  EXPECT_EQ(info["light_s"], 48.0);
  // There is no table to fill in, and a picture that is not there is no F.
  bad(2, {"testpart", "f", "--printer", "turned.toml", "-o", "x.uvj", "--form", "x.csv"},
      {"--form", "does not take it"});
  bad(2, {"testpart", "f", "--printer", "turned.toml", "-o", "x.uvj", "--picture", "turned.toml"},
      {"turned.toml"});
}

TEST_F(LetterProgram, NewPrinterAsksForIt) {
  for (int number = 1; number <= 8; ++number) {
    const RunResult made = new_printer(kAnswers + std::to_string(number) + "\\n", "--replace");
    ASSERT_EQ(made.exit_code, 0) << made.err;
    EXPECT_THAT(made.err, AllOf(HasSubstr("How does an F stand on your screen?"),
                                HasSubstr("#####"), Not(HasSubstr("testpart f"))));
    const Printer p = parse_printer(text_in("mine.toml"), "mine.toml");
    EXPECT_EQ(p.orientation, orientation_of_letter(number)) << number;
    EXPECT_EQ(p.wavelength_nm, 405);
    EXPECT_EQ(p.max_speed_mm_h, 800);
  }
  // The eight pictures stand in their order, the pictures of a row side by side.
  const std::string words = new_printer(kAnswers + "2\\n", "--replace").err;
  EXPECT_THAT(words, HasSubstr("  #####         #####             #         #"));
}

TEST_F(LetterProgram, WhoDoesNotKnowIsToldHowToSeeIt) {
  // An empty answer, and a script that ends before the question.
  for (const std::string& answers : {kAnswers + "\\n", kAnswers}) {
    const RunResult made = new_printer(answers, "--replace --picture f.png");
    ASSERT_EQ(made.exit_code, 0) << made.err;
    EXPECT_THAT(made.err, AllOf(HasSubstr("testpart f --printer mine"), HasSubstr("f.png")));
    EXPECT_FALSE(parse_printer(text_in("mine.toml"), "mine.toml").orientation);
    const GreyImage f = letter_image(160, 120);
    EXPECT_EQ(grey_of_png(read_file(folder_ / "f.png")), f.pixels);
  }
  for (const char* wrong : {"9", "0", "F", "1.5", "-1"}) {
    std::filesystem::remove(std::string(folder_ / "mine.toml"));
    const RunResult r = new_printer(kAnswers + wrong + "\\n");
    EXPECT_EQ(r.exit_code, 2) << wrong;
    EXPECT_THAT(r.err, HasSubstr("expected a number from 1 to 8"));
    EXPECT_FALSE(std::filesystem::exists(std::string(folder_ / "mine.toml")));
  }
}

// The page of the farm draws the same pictures in the same order.
TEST(Letter, ThePageHasTheSamePictures) {
  std::ifstream in(SLICECORR_SOURCE_DIR "/farm/views/page/materials.js");
  const std::string script{std::istreambuf_iterator<char>(in), {}};
  std::string turns, letter;
  for (const Turn& t : kLetterTurns) {
    turns += (turns.empty() ? "[" : ", [") + std::to_string(t.swap_axes) + ", " +
             std::to_string(t.flip_x) + ", " + std::to_string(t.flip_y) + "]";
  }
  for (const std::string_view row : kLetterF) {
    letter += (letter.empty() ? "'" : ", '") + std::string(row) + "'";
  }
  EXPECT_THAT(script, AllOf(HasSubstr("letterTurns = [" + turns + "]"),
                            HasSubstr("letterF = [" + letter + "]")));
}

}  // namespace
}  // namespace slicecorr::test
