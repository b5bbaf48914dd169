// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What gets in the way on the first day with the programs, tried as somebody would who does not know
/// them yet: a design of another scale, a mesh without units, a name with a slip, a picture of another
/// kind.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include "ladder.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

const Command kPrinter{"--printer", "small.toml"};
const Command kLayers{"--layer-um", "50"};
const Command kLight{"--resin", "figure-2-2", "--speed-mm-h", "1000"};

class FirstDay : public ProgramFixture {
 protected:
  FirstDay() {
    write("small.toml", kSmallPrinter);
    write_stl(folder_ / "ladder.stl", ladder());
  }
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  void make_stack() const {
    made_once("FirstDay", folder_, {"target.uvj", "part.uvj"}, [&] {
      good(Command{"slice", "ladder.stl", "-o", "target.uvj"} + kPrinter + kLayers);
      good(Command{"correct", "target.uvj", "-o", "part.uvj"} + kPrinter + kLight);
    });
  }
};

TEST_F(FirstDay, ADesignOfAnotherScaleIsRefusedAtOnce) {
  make_stack();
  const Command solid{"solid", "part.uvj", "-o", "printed.stl", "--design", "ladder.stl"};
  for (const auto& [scale, fits] : {std::pair{"2", "0.5"}, {"0.5", "2"}, {"25.4", "0.0394"}}) {
    bad(2, solid + Command{"--scale", scale},
        {"the design is", "but the stack shows 4.00 x 2.00 x",
         std::string("a scale of about ") + fits, "would fit"});
  }
  bad(2, solid + Command{"--rotate-deg", "0,90,0", "--scale", "0.1"},
      {"the design is 0.25 x 0.20 x 0.40 mm",
       "turned, and with a scale of about 10, it would fit"});
  // Turned, it has other sides; aside, the right ones in another place.
  bad(2, solid + Command{"--rotate-deg", "0,90,0"}, {"the design is 2.50 x 2.00 x 4.00 mm"});
  bad(2, solid + Command{"--center-mm", "1,1"}, {"lies beside what the stack shows"});
  const RunResult right = good(solid);
  EXPECT_NE(right.err.find("walls and the steps of pixels included"), std::string::npos);
}

TEST_F(FirstDay, AStackWithSupportsMayBeLargerThanItsDesign) {
  TriangleMesh all = ladder();
  add_box(all, {-3, -1.5, 0}, {3, 1.5, 0.3});
  write_stl(folder_ / "raft.stl", all);
  good(Command{"slice", "raft.stl", "-o", "target.uvj"} + kPrinter + kLayers);
  good(Command{"correct", "target.uvj", "-o", "part.uvj"} + kPrinter + kLight);
  good({"solid", "part.uvj", "-o", "printed.stl", "--design", "ladder.stl"});
}

TEST_F(FirstDay, WordsWithASlipAreNamed) {
  const auto farm = [&](const Command& arguments) {
    return run_program(Command{SLICECORR_BIN_DIR "/slicefarm"} + arguments, options_);
  };
  bad(2, {"slise"}, {"'slise' is no command; did you mean 'slice'?"});
  // The right list: `solve` is a command of another.
  bad(2, {"solve"}, {"'solve' is no command; did you mean 'tomo solve'?"});
  bad(2, {"tomo", "slove"},
      {"'slove' is no command; did you mean 'solve'?", "See slicecorr tomo --help"});
  const RunResult unlike = call({"qwertyuiop"});
  EXPECT_EQ(unlike.exit_code, 2);
  EXPECT_NE(unlike.err.find("expected one of slice, correct,"), std::string::npos) << unlike.err;
  EXPECT_NE(unlike.err.find(", tomo, "), std::string::npos) << unlike.err;
  EXPECT_EQ(unlike.err.find("solve"), std::string::npos) << unlike.err;
  // Words that people use for commands of ours, with a slip, too.
  bad(2, {"predict"}, {"'predict' is no command; did you mean 'verify'?"});
  for (const auto& [word, command] : {std::pair{"wroker", "run"}, {"queue", "status"}}) {
    const RunResult r = farm({word});
    EXPECT_NE(r.err.find(std::string("did you mean '") + command + "'?"), std::string::npos)
        << r.err;
  }
  // A name that is begun, without its dashes, is no slip of a shorter one.
  bad(2, Command{"slice", "ladder.stl", "-o", "t.uvj", "--printer", "elegoo-mars4"} + kLayers,
      {"did you mean 'elegoo-mars-4-max'?"});
  // What is not for people is not offered.
  const RunResult of_the_farm = farm({"qwertyuiop"});
  EXPECT_EQ(of_the_farm.err.find("worker"), std::string::npos) << of_the_farm.err;
  EXPECT_EQ(of_the_farm.err.find("plate"), std::string::npos) << of_the_farm.err;
  // The slip comes before what is missing because of it.
  bad(2, {"slice", "ladder.stl", "--printr", "small.toml"},
      {"'--printr' is no option of slice; did you mean '--printer'?"});
  bad(2, {"slice", "--qwertyuiop=3"}, {"'--qwertyuiop' is no option of slice\n"});
  bad(2, Command{"slice", "ladder.stl", "-o", "t.uvj", "--thread", "3"} + kPrinter + kLayers,
      {"'--thread' is no option of slice; did you mean '--threads'?"});
  bad(2, {"--layer-um", "50", "slice"}, {"'--layer-um' comes after slice\n"});
  bad(2, {"slice"}, {"is required"});
  EXPECT_EQ(good({"help"}).out, good({"--help"}).out);
  EXPECT_EQ(good({"help", "tomo", "solve"}).out, good({"tomo", "solve", "--help"}).out);
}

TEST_F(FirstDay, WhatWasMeantIsSaid) {
  const Command slice = Command{"slice", "ladder.stl", "-o", "t.uvj"} + kPrinter;
  bad(2, slice + Command{"--layer-um", "0.05"}, {"--layer-um", "0.05 mm is 50"});
  bad(2, Command{"correct", "ladder.stl", "-o", "part.uvj"} + kPrinter + kLight,
      {"ladder.stl: is a mesh; expected a slice archive: ", "`slicecorr run` slices and corrects"});
  // The ladder has 4 x 2 x 2.5 mm, the display 8 x 6 mm.
  bad(2, slice + kLayers + Command{"--scale", "3"},
      {"at 0.666 times this size, a longest side of 7.9 mm, it fits"});
  bad(2, slice + kLayers + Command{"--scale", "1e12"}, {"e-12 times this size"});
  bad(2, slice + kLayers + Command{"--center-mm", "0,0"}, {"; in the middle it fits"});
  // What is told fits.
  good(slice + kLayers + Command{"--scale", "1.998"});
}

TEST_F(FirstDay, ALargeSurfaceIsReducedUnlessSomebodyAsksForAll) {
  make_stack();
  // A small part is not reduced: the same bytes as all of it.
  const auto reduce = [&](const Command& more) {
    const RunResult r = good(Command{"solid", "part.uvj", "-o", "s.stl", "--json", "-"} + more);
    return nlohmann::json::parse(r.out)["reduce"].get<int>();
  };
  EXPECT_EQ(reduce({}), 1);
  const Bytes by_itself = read_file(folder_ / "s.stl");
  EXPECT_EQ(reduce({"--reduce", "1"}), 1);
  EXPECT_EQ(read_file(folder_ / "s.stl"), by_itself);
  EXPECT_EQ(reduce({"--reduce", "3"}), 3);
  EXPECT_LT(read_file(folder_ / "s.stl").size(), by_itself.size());
}

TEST_F(FirstDay, FitMmScalesWhateverTheUnits) {
  // The ladder's longest side is 4 mm.
  const Command slice = Command{"slice", "ladder.stl"} + kPrinter + kLayers;
  good(slice + Command{"--scale", "1.5", "-o", "scaled.uvj"});
  const Bytes scaled = read_file(folder_ / "scaled.uvj");
  for (const char* units : {"mm", "inch", "m"}) {
    good(slice + Command{"--fit-mm", "6", "--units", units, "-o", "fitted.uvj"});
    // Factors that come about otherwise differ by their last bits: as slices, by nothing.
    EXPECT_EQ(images("fitted.uvj"), images("scaled.uvj")) << units;
  }
  good(slice + Command{"--fit-mm", "6", "-o", "fitted.uvj"});
  EXPECT_EQ(read_file(folder_ / "fitted.uvj"), scaled);
  // Turned upright it is 4 mm high, and fits by that.
  good(slice + Command{"--fit-mm", "2", "--rotate-deg", "0,90,0", "-o", "upright.uvj"});
  EXPECT_EQ(images("upright.uvj").size(), 40U);
  bad(2, slice + Command{"--fit-mm", "6", "--scale", "2", "-o", "x.uvj"}, {"--fit-mm", "--scale"});
  bad(2, slice + Command{"--fit-mm", "0", "-o", "x.uvj"}, {"--fit-mm"});
  bad(2, slice + Command{"--fit-mm", "nan", "-o", "x.uvj"}, {"--fit-mm"});
}

TEST_F(FirstDay, NamesWithASlipAreTold) {
  const Command slice{"slice", "ladder.stl", "-o", "x.uvj", "--layer-um", "50", "--printer"};
  bad(2, slice + Command{"dual-wavelenght-dlp"}, {"did you mean 'dual-wavelength-dlp'?"});
  const RunResult far = call(slice + Command{"zzzz"});
  EXPECT_EQ(far.err.find("did you mean"), std::string::npos);
  good(Command{"slice", "ladder.stl", "-o", "target.uvj"} + kPrinter + kLayers);
  bad(2,
      Command{"correct", "target.uvj", "-o", "x.uvj", "--speed-mm-h", "800", "--resin",
              "benchy-rezin"} +
          kPrinter,
      {"did you mean 'benchy-resin'?"});
}

TEST_F(FirstDay, APrinterComesFromQuestions) {
  const std::string answers =
      "mine\\n160\\n120\\n50\\n\\n405\\n0 1\\n64 20.5\\n128 40\\n192 61\\n224 80\\n255 100\\n\\n800\\n\\n";
  const auto ask = [&](const std::string& lines) {
    return run_program({"/bin/sh", "-c",
                        "printf '" + lines + "' | " SLICECORR_BIN_DIR "/resinctl new-printer -o ."},
                       options_);
  };
  const RunResult made = ask(answers);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_NE(made.err.find("--printer mine"), std::string::npos);
  good({"slice", "ladder.stl", "-o", "t.uvj", "--layer-um", "50", "--printer", "mine.toml"});
  // The same again is the same; another of that name is refused.
  EXPECT_EQ(ask(answers).exit_code, 0);
  std::string other = answers;
  other.replace(other.find("20.5"), 4, "21.5");
  EXPECT_EQ(ask(other).exit_code, 2);
  for (const auto& [lines, word] :
       {std::pair{"Mine!\\n", "no name"},
        {"two\\n160\\n120\\n50\\n\\n405\\n0 1\\n128 40\\n\\n", "level 255"},
        {"two\\n160\\n120\\n50\\n\\n405\\n0 1\\n128 40\\n255 30\\n\\n", "falls"},
        {"two\\nwide\\n", "no number"},
        {"two\\n", "ends; expected an answer"}}) {
    const RunResult r = ask(lines);
    EXPECT_EQ(r.exit_code, 2) << lines;
    EXPECT_NE(r.err.find(word), std::string::npos) << r.err;
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "two.toml"));
}

TEST_F(FirstDay, ReadingsBecomeAFlatField) {
  // A display of 8 x 6 mm whose light falls by a fifth from left to right: six readings on the plane.
  std::string readings = "x_mm,y_mm,light\n";
  for (const double x : {1.0, 4.0, 7.0}) {
    for (const double y : {1.5, 4.5}) {
      readings +=
          std::to_string(x) + "," + std::to_string(y) + "," + std::to_string(10 - 0.25 * x) + "\n";
    }
  }
  write("readings.csv", readings);
  const Command import{"import", "readings.csv", "--printer", "small.toml", "-o", "db"};
  std::filesystem::create_directory(folder_ / "db");
  const RunResult made = resinctl(import + Command{"--calibrated-at-mm", "4,3"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_NE(made.err.find("Light in nine parts"), std::string::npos) << made.err;
  const std::string toml = to_text(read_file(folder_ / "db/small.toml"));
  EXPECT_NE(toml.find("flat_field_frame = \"plate\""), std::string::npos) << toml;
  // At the middle 9 of at most 10: the plane comes out to a hundredth.
  const auto at = toml.find("flat_field_reference = ");
  ASSERT_NE(at, std::string::npos);
  EXPECT_NEAR(std::stod(toml.substr(at + 23)), 255 * 9 / 10.0, 0.02 * 255);
  const Bytes picture = grey_of_png(read_file(folder_ / "db/small-flat-field.png"));
  ASSERT_EQ(picture.size(), 64U * 48U);
  for (std::size_t row = 0; row < 48; ++row) {
    EXPECT_GE(picture[64 * row], 250) << row;
    EXPECT_NEAR(picture[64 * row + 63], 0.8 * 255, 0.02 * 255) << row;
  }
  good({"slice", "ladder.stl", "-o", "t.uvj", "--layer-um", "50", "--printer", "db/small.toml"});
  // What can't be is refused with its line.
  const auto refused = [&](const std::string& text, const std::string& word) {
    write("bad.csv", "x_mm,y_mm,light\n" + text);
    const RunResult r = resinctl({"import", "bad.csv", "--printer", "small.toml", "-o", "db"});
    EXPECT_EQ(r.exit_code, 2) << text;
    EXPECT_NE(r.err.find(word), std::string::npos) << r.err;
  };
  refused("1,1,5\n2,2,5\n", "three or more");
  refused("1,1,5\n2,2,5\n3,3,5\n", "on a line");
  refused("1,1,5\n80,2,5\n3,3,5\n", "expected a place on the display");
  refused("1,1,5\n2,2,0\n3,3,5\n", "expected more than 0");
  refused("1,1,5\n2,,1\n3,3,5\n", "is empty");
  refused("0,1,5\n9.2,2,5\n3,3,5\n", "expected a place on the display");
  refused("3,3,5\n3,3,5\n3,3,5\n", "on a line");
  refused("0.1,0.1,5\n0.7,0.1,5\n0.4,0.5,5\n", "were these cm?");
  refused("1,1,5\n2,1,5\n1.5,5,5\n", "x_mm: goes from 1 to 2 mm of 8 mm");
}

TEST_F(FirstDay, ReadingsOfLightThatFallsToTheRimKeepItsShape) {
  // Light that falls by a fifth and a tenth from the middle on, as displays' does: twelve exact readings tell it.
  const auto light = [](double x, double y) {
    return 10 - 2 * std::pow(x / 4 - 1, 2) - std::pow(y / 3 - 1, 2);
  };
  const auto table = [&](double times) {
    std::string text = "x_mm,y_mm,light\n";
    for (const double x : {0.5, 3.0, 5.5, 7.5}) {
      for (const double y : {0.5, 3.0, 5.5}) {
        const double reading = light(x, y) * (x == 3 && y == 3 ? times : 1);
        text += std::to_string(x) + "," + std::to_string(y) + "," + std::to_string(reading) + "\n";
      }
    }
    return text;
  };
  std::filesystem::create_directory(folder_ / "db");
  const Command import{"import", "readings.csv", "--printer", "small.toml", "-o", "db"};
  write("readings.csv", table(1));
  const RunResult made = resinctl(import);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(made.err.find("contradicted"), std::string::npos) << made.err;
  const Bytes picture = grey_of_png(read_file(folder_ / "db/small-flat-field.png"));
  ASSERT_EQ(picture.size(), 64U * 48U);
  // To a value of the picture: half of one for its rounding, as much for that of the brightest.
  for (int row = 0; row < 48; ++row) {
    for (int column = 0; column < 64; ++column) {
      const double is = light((column + 0.5) / 8, 6 - (row + 0.5) / 8);
      EXPECT_NEAR(picture[static_cast<std::size_t>(64 * row + column)], 25.5 * is, 1)
          << column << " " << row;
    }
  }
  // One that is three times too high is named: x 3, y 3 stands in line 6.
  write("readings.csv", table(3));
  const RunResult wrong = resinctl(import + Command{"--replace"});
  EXPECT_EQ(wrong.exit_code, 0) << wrong.err;
  EXPECT_NE(wrong.err.find("the reading of line 6, 29.625, is contradicted"), std::string::npos)
      << wrong.err;
}

TEST_F(FirstDay, PicturesAreWhatTheirNamesSay) {
  const RunResult other = resinctl({"plot", "benchy-resin", "-o", "a.gif"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("a.gif: expected a name that ends in .svg, .png, .pdf or .html"),
            std::string::npos)
      << other.err;
  const bool converter = std::filesystem::exists("/usr/bin/rsvg-convert");
  for (const auto& [name, begin] : {std::pair{"a.png", "\x89PNG"}, {"a.pdf", "%PDF-"}}) {
    const RunResult r = resinctl({"plot", "benchy-resin", "-o", name});
    if (!converter) {
      EXPECT_EQ(r.exit_code, 2);
      EXPECT_NE(r.err.find("librsvg2-bin"), std::string::npos) << r.err;
      continue;
    }
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(to_text(read_file(folder_ / name)).rfind(begin, 0), 0U) << name;
  }
  // Nothing of what was made on the way is left.
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
    EXPECT_FALSE(entry.path().filename().string().starts_with(".resinctl")) << entry.path();
  }
}

TEST_F(FirstDay, ASectionSaysWhatItShows) {
  make_stack();
  good({"section", "part.uvj", "--target", "target.uvj", "-o", "section.png"});
  const Bytes png = read_file(folder_ / "section.png");
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_memory(&image, png.data(), png.size()) != 0);
  image.format = PNG_FORMAT_RGB;
  Bytes pixels(PNG_IMAGE_SIZE(image));
  ASSERT_TRUE(png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr) != 0);
  // Each colour of the legend, in its last lines; ink for words above the sections.
  const auto rows = [&](unsigned from, unsigned to) {
    std::set<std::array<int, 3>> colours;
    for (std::size_t i = std::size_t{3} * image.width * from; i < std::size_t{3} * image.width * to;
         i += 3) {
      colours.insert({pixels[i], pixels[i + 1], pixels[i + 2]});
    }
    return colours;
  };
  const auto legend = rows(image.height - 140, image.height);
  for (const std::array<int, 3>& colour :
       {std::array{128, 134, 140}, {214, 48, 49}, {38, 103, 214}, {176, 182, 188}}) {
    EXPECT_TRUE(legend.contains(colour)) << colour[0];
  }
  EXPECT_TRUE(rows(0, 80).contains({27, 31, 36}));
}

TEST_F(FirstDay, ASectionHasRealLettersAsSvg) {
  make_stack();
  good({"section", "part.uvj", "--target", "target.uvj", "-o", "section.svg"});
  const std::string svg = to_text(read_file(folder_ / "section.svg"));
  EXPECT_TRUE(svg.starts_with("<svg ")) << svg.substr(0, 80);
  for (const char* words : {"as sliced", "this stack", "as designed", "cured through", "undercured",
                            "platform up", "data:image/png;base64,"}) {
    EXPECT_NE(svg.find(words), std::string::npos) << words;
  }
  EXPECT_EQ(svg.find("http", svg.find("xmlns") + 40), std::string::npos) << "needs the network";
  const RunResult r = call({"section", "part.uvj", "--target", "target.uvj", "-o", "section.jpg"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_NE(r.err.find("expected a name that ends in .png or .svg"), std::string::npos) << r.err;
}

TEST_F(FirstDay, ARefusalLayerByLayerNamesTheDoseFactor) {
  write("five.toml",
        "name = \"five\"\n[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 110.0\n"
        "absorbance_base = 10\ngel_dose_mj_cm3 = 576.0\ndose_factor = 5.0\n");
  good(Command{"slice", "ladder.stl", "-o", "target.uvj"} + kPrinter + kLayers);
  const Command correct = Command{"correct",   "target.uvj", "-o",        "x.uvj",        "--mode",
                                  "layerwise", "--resin",    "five.toml", "--exposure-s", "0.1"} +
                          kPrinter + Command{"--lifts", "none"};
  bad(3, correct,
      {"does not gel through", "5 times the gel dose of resin 'five'", "--dose-factor"});
  good(correct + Command{"--dose-factor", "1"});
  // With lifts it is the gel dose that a layer must have, and more of it at its joint.
  bad(2, correct + Command{"--lifts", "sometimes"}, {"--lifts"});
}

TEST_F(FirstDay, WhatRunLeavesIsLookedAtWithoutNamingItsTarget) {
  const RunResult run =
      good(Command{"run", "ladder.stl", "-o", "o.uvj"} + kPrinter + kLayers + kLight);
  EXPECT_NE(run.err.find("o-target.uvj: the design as sliced ("), std::string::npos) << run.err;
  // The same as with the target that slice makes.
  good(Command{"slice", "ladder.stl", "-o", "t.uvj"} + kPrinter + kLayers);
  EXPECT_EQ(read_file(folder_ / "t.uvj"), read_file(folder_ / "o-target.uvj"));
  for (const Command& look : std::vector<Command>{{"verify", "o.uvj", "--json", "-"},
                                                  {"section", "o.uvj", "-o", "s.svg"},
                                                  {"report", "o.uvj", "-o", "o.html"}}) {
    const RunResult by_itself = good(look);
    EXPECT_EQ(by_itself.out, good(look + Command{"--target", "t.uvj"}).out) << look.front();
  }
  // A column is there when it is asked for.
  EXPECT_EQ(good({"probe", "o.uvj", "--x", "80", "--y", "60"}).out.find("target"),
            std::string::npos);
  bad(2, {"verify", "o.uvj", "--target", "target.uvj"},
      {"there is no such file", "o-target.uvj lies beside the stack: leave --target out"});
  // Gone, and another part's in its place.
  std::filesystem::remove(folder_ / "o-target.uvj");
  bad(2, {"section", "o.uvj", "-o", "s.svg"},
      {"is measured against the design", "slicecorr slice PART.stl -o o-target.uvj"});
  good(Command{"slice", "ladder.stl", "-o", "o-target.uvj", "--rotate-deg", "0,0,90"} + kPrinter +
       kLayers);
  bad(2, {"verify", "o.uvj"}, {"o-target.uvj"});
}

/// Names below "Subcommands:" in a help.
std::vector<std::string> commands_in(const std::string& help) {
  std::vector<std::string> names;
  std::istringstream lines(help.substr(std::min(help.find("Subcommands:"), help.size())));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line) && !line.empty()) {
    if (line.size() > 2 && line.starts_with("  ") && line[2] != ' ') {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  return names;
}

/// Each command shows how it is called, and what slicecorr shows is no wrong usage.
TEST_F(FirstDay, EveryCommandHasAnExampleOfItsOwn) {
  for (const char* program : {"slicecorr", "resinctl", "slicefarm", "printbridge"}) {
    std::vector<Command> left{{}};
    int seen = 0;
    while (!left.empty()) {
      const Command at = left.back();
      left.pop_back();
      const Command name{std::string(SLICECORR_BIN_DIR) + "/" + program};
      const std::string help = run_program(name + at + Command{"--help"}, options_).out;
      const std::vector<std::string> below = commands_in(help);
      for (const std::string& command : below) left.push_back(at + Command{command});
      if (at.empty()) continue;
      ++seen;
      const std::size_t example = help.find("Example");
      ASSERT_NE(example, std::string::npos)
          << program << " " << fmt::format("{}", fmt::join(at, " "));
      // Of commands that two programs have, the one that most people call.
      const std::string call = fmt::format(" {}", fmt::join(at, " "));
      const std::size_t begin = help.find(call, example);
      ASSERT_NE(begin, std::string::npos) << call << ": " << help.substr(example);
      if (program != std::string_view("slicecorr") || !below.empty()) continue;
      std::istringstream words(help.substr(begin, help.find('\n', begin) - begin));
      Command typed{std::string(SLICECORR_BIN_DIR) + "/slicecorr"};
      for (std::string word; words >> word;) typed.push_back(word);
      const RunResult r = run_program(typed, options_);
      for (const char* wrong : {"is no option", "is no command", " required", " not in {"}) {
        EXPECT_EQ(r.err.find(wrong), std::string::npos) << r.err;
      }
    }
    EXPECT_GT(seen, 8) << program;
  }
}

TEST_F(FirstDay, AThinnedOutSurfaceIsMeasuredWhole) {
  std::string fine(kSmallPrinter);
  for (const auto& [from, to] :
       {std::pair<std::string, std::string>{"width_px = 160", "width_px = 1200"},
        {"height_px = 120", "height_px = 800"},
        {"pixel_um = 50", "pixel_um = 4"}}) {
    ASSERT_NE(fine.find(from), std::string::npos) << from;
    fine.replace(fine.find(from), from.size(), to);
  }
  write("fine.toml", fine);
  good(Command{"run", "ladder.stl", "-o", "fine.uvj", "--printer", "fine.toml"} + kLayers + kLight);
  const auto figures = [&](const Command& more) {
    const RunResult r =
        good(Command{"solid", "fine.uvj", "-o", "f.stl", "--json", "-", "--design", "ladder.stl"} +
             more);
    return std::pair(nlohmann::json::parse(r.out), r.err);
  };
  const auto [by_itself, said] = figures({});
  EXPECT_GT(by_itself["reduce"], 1);
  EXPECT_LT(by_itself["triangles"], 1200000);
  EXPECT_NE(said.find("measured on the whole surface"), std::string::npos) << said;
  EXPECT_EQ(std::filesystem::file_size(folder_ / "f.stl"),
            84 + 50 * by_itself["triangles"].get<std::uintmax_t>());
  const auto whole = figures({"--reduce", "1"}).first;
  EXPECT_GT(whole["triangles"], 1200000);
  for (const char* key : {"volume_mm3", "lower_mm", "upper_mm", "distance_um"}) {
    EXPECT_EQ(by_itself[key], whole[key]) << key;
  }
}

}  // namespace
}  // namespace slicecorr::test
