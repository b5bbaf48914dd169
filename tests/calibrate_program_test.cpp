// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// From a vat and a pair of calipers to a corrected print, as docs/calipers.md goes it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string_view>

#include "films_lab.hpp"
#include "ladder.hpp"
#include "page_commands.hpp"
#include "print_file_fixture.hpp"
#include "program_fixture.hpp"
#include "rounds.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

/// A display of gamma 2.2, and a resin.
HiddenPrinter hidden_printer() {
  HiddenPrinter p;
  for (int g = 0; g <= 255; ++g) p.share.push_back(std::pow(g / 255.0, 2.2));
  return p;
}

class CalibrateProgram : public ProgramFixture {
 protected:
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  std::string text_of(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  /// Fills in a table of `testpart films`, whose cells end with an empty one.
  void fill_in(const std::string& form, double off_um) const {
    const HiddenPrinter hidden = hidden_printer();
    std::mt19937 random(1);
    std::istringstream lines(text_of(form));
    std::string filled;
    for (std::string line; std::getline(lines, line);) {
      int square = 0, level = 0;
      double s = 0;
      if (std::sscanf(line.c_str(), "%d,%d,%lf,", &square, &level, &s) == 3) {
        const double um = read_by_calipers(hidden.film_um(level, s), off_um, random);
        if (um > 0) line += fmt::format("{:.4f}", um);
      }
      filled += line + "\n";
    }
    write(form, filled);
  }
  static constexpr const char* kKnown =
      "level,exposure_s,thickness_um\n255,2,59.69\n255,4,104.85\n255,8,150.00\n255,16,195.15\n"
      "128,16,95.80\n";
};

TEST_F(CalibrateProgram, TheFiguresAreInItsJson) {
  write("dark.toml", kUnlitPrinter);
  write("films.csv", kKnown);
  const RunResult r = resinctl({"calibrate", "films.csv", "--printer", "dark.toml", "-o", "p.toml",
                                "--resin-out", "r.toml", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(r.out);
  EXPECT_NEAR(j["absorbance_height_um"]["value"].get<double>(), 150, 0.02);
  EXPECT_EQ(j["absorbance_height_um"]["ci95"].size(), 2u);
  EXPECT_NEAR(j["gel_s"]["value"].get<double>(), 0.8, 2e-4);
  EXPECT_EQ(j["gel_s"]["ci95"].size(), 2u);
  ASSERT_EQ(j["light"].size(), 2u);
  EXPECT_EQ(j["light"][0]["level"], 128);
  EXPECT_NEAR(j["light"][0]["share"].get<double>(), 0.2176, 5e-5);
  EXPECT_EQ(j["light"][1]["share"], 1.0);
  EXPECT_EQ(j["unit"], "of the brightest level");
  EXPECT_THAT(j["measure_next"].dump(), HasSubstr("level 128 at a second time"));
  EXPECT_EQ(load_printer(folder_ / "p.toml").unit, LightUnit::brightest);
  EXPECT_NEAR(critical_dose_s(load_resin(folder_ / "r.toml")), 0.8, 2e-4);
  // What other commands say of them.
  const RunResult valid = resinctl({"validate", "p.toml", "r.toml"});
  EXPECT_EQ(valid.exit_code, 0) << valid.out << valid.err;
  EXPECT_THAT(resinctl({"show", "p.toml"}).out, HasSubstr("0 to 1 of the brightest level"));
  EXPECT_THAT(resinctl({"show", "r.toml"}).out, HasSubstr("0.8 s of full light"));
  EXPECT_EQ(json::parse(resinctl({"show", "r.toml", "--json", "-"}).out)["unit"],
            "of the brightest level");
  EXPECT_THAT(
      resinctl({"predict", "--printer", "p.toml", "--resin", "r.toml", "--exposure-s", "8"}).out,
      AllOf(HasSubstr("cured 150 um high"), testing::Not(HasSubstr("mJ"))));
  const Command mw{"export", "r.toml", "--format", "csv"};
  EXPECT_EQ(resinctl(mw).exit_code, 2);
  EXPECT_EQ(resinctl({"calibrate", "films.csv", "--printer", "dark.toml", "--full-mw-cm2", "4.5",
                      "-o", "p.toml", "--resin-out", "r.toml"})
                .exit_code,
            0);
  EXPECT_EQ(load_printer(folder_ / "p.toml").calibration.back().intensity_mw_cm2, 4.5);
  EXPECT_EQ(resinctl(mw).exit_code, 0);
}

TEST_F(CalibrateProgram, ATableThatWasPastedTwiceIsTold) {
  write("dark.toml", kUnlitPrinter);
  const std::string rows = std::string(kKnown).substr(std::string(kKnown).find('\n') + 1);
  const auto told = [&](const std::string& more) {
    write("films.csv", kKnown + more);
    const RunResult r = resinctl({"calibrate", "films.csv", "--printer", "dark.toml"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r.out + r.err;
  };
  // The same square read again is one more measurement.
  EXPECT_THAT(told("255,8,150.00\n"), testing::Not(HasSubstr("digit for digit")));
  EXPECT_THAT(told(rows), HasSubstr("5 of 10 measurements repeat earlier ones digit for digit"));
}

TEST_F(CalibrateProgram, WhatIsWrongLeavesNothingBehind) {
  write("dark.toml", kUnlitPrinter);
  write("films.csv", kKnown);
  write("one.csv", "level,exposure_s,thickness_um\n255,2,59.69\n");
  write("zero.csv", std::string(kKnown) + "128,8,0\n");
  const auto before = folder_.count();
  const auto refused = [&](const std::string& films, const std::string& printer,
                           const std::string& output) {
    const RunResult r =
        resinctl({"calibrate", films, "--printer", printer, "-o", output, "--resin-out", "r.toml"});
    EXPECT_EQ(r.exit_code, 2) << r.err;
    return r.err;
  };
  EXPECT_THAT(refused("one.csv", "dark.toml", "p.toml"), HasSubstr("one.csv: line 2"));
  EXPECT_THAT(refused("zero.csv", "dark.toml", "p.toml"), HasSubstr("zero.csv: line 7"));
  EXPECT_THAT(refused("no.csv", "dark.toml", "p.toml"), HasSubstr("no.csv"));
  EXPECT_THAT(refused("films.csv", "nobody", "p.toml"), HasSubstr("no printer 'nobody'"));
  refused("films.csv", "dark.toml", "dark.toml");
  refused("films.csv", "dark.toml", "films.csv");
  refused("films.csv", "dark.toml", "r.toml");
  EXPECT_EQ(resinctl({"calibrate", "films.csv", "--printer", "dark.toml", "--full-mw-cm2", "0"})
                .exit_code,
            2);
  EXPECT_EQ(folder_.count(), before);
  // A lamp that inhibits counts against light in mW/cm².
  EXPECT_THAT(refused("films.csv", "dual-wavelength-dlp", "p.toml"),
              AllOf(HasSubstr("blue.unit"), HasSubstr("[uv]")));
}

// A calibration that somebody measures later is one of mW/cm².
TEST_F(CalibrateProgram, AMeasuredCalibrationTakesTheUnitAway) {
  write("dark.toml", kUnlitPrinter);
  write("films.csv", kKnown);
  ASSERT_EQ(
      resinctl({"calibrate", "films.csv", "--printer", "dark.toml", "-o", "mine.toml"}).exit_code,
      0);
  write("light.csv", "0,0.01\n128,1\n255,4.5\n");
  const RunResult r = resinctl({"import", "light.csv", "--format", "calibration", "--printer",
                                "mine.toml", "--name", "measured", "--folder", "db"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const Printer measured = load_printer(folder_ / "db/measured.toml");
  EXPECT_EQ(measured.unit, LightUnit::mw_cm2);
  EXPECT_EQ(measured.calibration.back().intensity_mw_cm2, 4.5);
}

TEST_F(CalibrateProgram, CommandsOfItsPageRun) {
  std::size_t run = 0;
  const std::string lgs = real_file("slices/binary/uv3dp_microsupports3.lgs");
  const std::string path = "PATH=" SLICECORR_BIN_DIR ":$PATH; ";
  // Both programs' commands in the order of the page.
  for (const std::string& line : page_commands(SLICECORR_SOURCE_DIR "/docs/calipers.md", "")) {
    if (!line.starts_with("slicecorr") && !line.starts_with("resinctl")) continue;
    SCOPED_TRACE(line);
    if (line.find("from-the-slicer.lgs") != std::string::npos) {
      if (!lacks(lgs).empty()) continue;
      std::filesystem::copy_file(lgs, folder_ / "from-the-slicer.lgs");
    }
    if (line.starts_with("slicecorr correct") || line.starts_with("slicecorr-post")) {
      // What a slicer exported: four layers, 2.5 s each.
      good(
          {"testpart", "f", "--printer", "elegoo-saturn", "--exposure-s", "2.5", "-o", "part.ctb"});
    }
    const RunResult r = run_program({"/bin/sh", "-c", path + line}, options_);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    // The seconds are of this display's light: that they may be of another's is not told.
    EXPECT_EQ(
        r.err.find("shares of the brightest level of printer 'my-saturn'") != std::string::npos,
        line.find("--resin my-resin.toml") != std::string::npos)
        << r.err;
    EXPECT_EQ(r.err.find("in seconds of the full light"), std::string::npos) << r.err;
    if (line.find("-o films.ctb") != std::string::npos) fill_in("films.csv", 0);
    ++run;
  }
  EXPECT_GE(run, lacks(lgs).empty() ? 6u : 5u);
  const Resin resin = load_resin(folder_ / "my-resin.toml");
  EXPECT_NEAR(resin.absorbance_height10_um, 150, 0.01);
  EXPECT_NEAR(critical_dose_s(resin), 0.8, 1e-4);
  const Printer printer = load_printer(folder_ / "my-saturn.toml");
  for (const CalibrationPoint& p : printer.calibration) {
    EXPECT_NEAR(p.intensity_mw_cm2, std::pow(p.level / 255, 2.2), 1e-5);
  }
  const RunResult info = good({"info", "corrected.ctb"});
  EXPECT_THAT(info.out, AllOf(HasSubstr("my-saturn"), HasSubstr("s of full light")));
  EXPECT_EQ(info.out.find("mW/cm"), std::string::npos);
  const RunResult guessed = good({"info", "guessed.ctb"});
  EXPECT_THAT(guessed.out, AllOf(HasSubstr("assumed, not measured"), HasSubstr("elegoo-saturn"),
                                 HasSubstr("a typical monochrome LCD of 405 nm")));
  EXPECT_EQ(json::parse(good({"info", "guessed.ctb", "--json", "-"}).out)["assumed"],
            "mono-lcd-405");
  EXPECT_EQ(resin.display, "my-saturn");
  // A resin in another unit is refused before the work.
  bad(2,
      {"correct", "films.ctb", "-o", "x.ctb", "--printer", "my-saturn.toml", "--resin",
       "liqcreate-strong-x-405nm", "--mode", "layerwise"},
      {"my-saturn", "of the brightest level", "liqcreate-strong-x-405nm", "mW/cm2"});
}

TEST_F(CalibrateProgram, SecondsOfAnotherDisplayAreToldEverywhere) {
  write("dark.toml", kUnlitPrinter);
  write("films.csv", kKnown);
  ASSERT_EQ(resinctl({"calibrate", "films.csv", "--printer", "dark.toml", "-o", "mine.toml",
                      "--resin-out", "r.toml"})
                .exit_code,
            0);
  const auto changed = [&](const char* from, const char* to, const std::string& was,
                           const std::string& now) {
    std::string text = text_of(from);
    const std::size_t at = text.find(was);
    ASSERT_NE(at, std::string::npos) << text;
    write(to, text.replace(at, was.size(), now));
  };
  changed("mine.toml", "twin.toml", "name = \"mine\"", "name = \"twin\"");
  changed("r.toml", "nameless.toml", "display = \"mine\"\n", "");
  good({"testpart", "f", "--printer", "dark.toml", "--exposure-s", "2.5", "-o", "part.uvj"});
  // Who forgets the mode has a file with times.
  bad(2, {"correct", "part.uvj", "-o", "x.uvj", "--printer", "mine.toml", "--resin", "r.toml"},
      {"--speed-mm-h is required: without --mode the print is continuous", "--mode layerwise"});
  struct Case {
    const char *printer, *resin, *words;
    json named;
  };
  for (const Case& c :
       {Case{"mine.toml", "r.toml", "", {}},
        Case{"twin.toml", "r.toml", "printer 'mine', not of printer 'twin'", "mine"},
        Case{"mine.toml", "nameless.toml", "its file does not name", {}}}) {
    SCOPED_TRACE(c.words);
    const bool told = *c.words != 0;
    const auto says = [&](const std::string& text) {
      EXPECT_EQ(text.find(told ? c.words : "of the full light of") != std::string::npos, told)
          << text;
    };
    const auto has = [&](const json& j) {
      EXPECT_EQ(j.contains("other_display"), told);
      if (told) {
        EXPECT_EQ(j["other_display"], c.named);
      }
    };
    const Command with{"--printer", c.printer, "--resin", c.resin, "--mode", "layerwise"};
    says(good(Command{"correct", "part.uvj", "-o", "out.uvj", "--json", "out.json"} + with).err);
    has(json::parse(text_of("out.json")));
    says(good({"info", "out.uvj"}).out);
    has(json::parse(good({"info", "out.uvj", "--json", "-"}).out));
    says(good({"verify", "out.uvj", "--target", "part.uvj", "--json", "out.json"}).err);
    has(json::parse(text_of("out.json")));
    good({"report", "out.uvj", "--target", "part.uvj", "-o", "out.html"});
    std::string page = text_of("out.html");
    for (std::size_t at = 0; (at = page.find("&#39;", at)) != std::string::npos;)
      page.replace(at, 5, "'");
    says(page);
    if (c.named.is_null()) continue;
    // A job of the farm ends well, with that as a warning; who submits is told, too.
    const auto slicefarm = [&](Command words) {
      words.insert(words.begin(), SLICECORR_BIN_DIR "/slicefarm");
      words.insert(words.end(), {"--dir", "farm"});
      RunResult r = run_program(words, options_);
      EXPECT_EQ(r.exit_code, 0) << r.err;
      return r;
    };
    says(slicefarm(Command{"submit", "part.uvj"} + with).err);
    slicefarm({"run", "--until-empty"});
    const json jobs = json::parse(slicefarm({"status", "--json", "-"}).out);
    says(jobs.dump());
  }
}

// A part without an archive, on a printer whose light nobody measured.
TEST_F(CalibrateProgram, RunTellsWhatIsAssumed) {
  write("dark.toml", kUnlitPrinter);
  TriangleMesh part;
  add_box(part, {-2, -1, 0}, {-1, 1, 1.5});
  add_box(part, {-1, -1, 1}, {1, 1, 1.5});
  write_stl(folder_ / "part.stl", part);
  const Command light = {"--printer", "dark.toml", "--resin",  "liqcreate-strong-x-405nm",
                         "--mode",    "layerwise", "--assume", "typical"};
  const RunResult run =
      good(Command{"run", "part.stl", "-o", "part.uvj", "--layer-um", "50", "--exposure-s", "2.5"} +
           light);
  EXPECT_THAT(run.err, HasSubstr("assumed, not measured"));
  const json j = json::parse(text_of("part.json"));
  EXPECT_EQ(j["assumed"], "mono-lcd-405");
  EXPECT_EQ(j["joints"]["not_holding_voxels"], 0);
  EXPECT_TRUE(j.contains("uncertainty"));
  EXPECT_THAT(text_of("part.html"), HasSubstr("assumed, not measured"));
  // Another band where one is asked for.
  good(Command{"run", "part.stl", "-o", "sure.uvj", "--layer-um", "50", "--exposure-s", "2.5",
               "--uncertain", "ha=1%"} +
       light);
  const auto half_um = [](const json& of) {
    return of["uncertainty"]["upper_edges"]["half_width95_um"]["mean"].get<double>();
  };
  EXPECT_LT(half_um(json::parse(text_of("sure.json"))), half_um(j));
  // What is found, and not said, is no exposure that prints.
  bad(2, Command{"plan", "part.stl", "--layer-um", "50"} + light, {"--assume", "exposures"});
}

// A file that was made from a template is corrected in place, too: what the template said stays.
TEST_F(CalibrateProgram, FilesOfATemplateAreCorrectedInPlace) {
  const std::string lgs = real_file("slices/binary/uv3dp_microsupports3.lgs");
  if (const std::string why = lacks(lgs); !why.empty()) GTEST_SKIP() << why;
  TriangleMesh part;
  add_box(part, {-2, -1, 0}, {-1, 1, 1.5});
  add_box(part, {-1, -1, 1}, {1, 1, 1.5});
  write_stl(folder_ / "part.stl", part);
  good(
      {"slice", "part.stl", "-o", "part.uvj", "--printer", "longer-orange-10", "--layer-um", "50"});
  good({"convert", "part.uvj", "-o", "part.lgs", "--template", lgs});
  good({"correct", "part.lgs", "-o", "corrected.lgs", "--printer", "longer-orange-10", "--resin",
        "liqcreate-strong-x-405nm", "--mode", "layerwise", "--assume", "typical"});
  const json before = json::parse(good({"info", "part.lgs", "--json", "-"}).out),
             after = json::parse(good({"info", "corrected.lgs", "--json", "-"}).out);
  EXPECT_EQ(after["print_time_s"], before["print_time_s"]);
  EXPECT_EQ(after["assumed"], "mono-lcd-405");
}

/// How many layers of two files of the same part show something else.
int changed_layers(const std::string& a, const std::string& b, const std::string& scratch) {
  const auto sums = [&](const std::string& path) {
    const StackReader stack(path, scratch);
    const Grid& g = stack.grid();
    std::vector<std::size_t> of(static_cast<std::size_t>(g.layers));
    constexpr int rows_at_once = 64;
    for (int y = 0; y < g.height_px; y += rows_at_once) {
      const PixelBox band{0, y, g.width_px, std::min(g.height_px, y + rows_at_once)};
      const std::size_t count =
          static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
      stack.read_band(band, [&](int layer, const std::uint8_t* rows) {
        const std::string_view bytes(reinterpret_cast<const char*>(rows), rows ? count : 0);
        std::size_t& sum = of[static_cast<std::size_t>(layer)];
        sum = sum * 31 + std::hash<std::string_view>{}(bytes);
      });
    }
    return of;
  };
  const std::vector<std::size_t> was = sums(a), is = sums(b);
  int changed = 0;
  for (std::size_t n = 0; n < was.size(); ++n) changed += was[n] != is.at(n);
  return changed;
}

// The way of the page with real files of real slicers: films, what they tell, the part corrected into a new
// file and in place. It prints nearer to the design; by night the two of which the page tells.
TEST_F(CalibrateProgram, RealFilesAreCorrected) {
  if (const std::string why = lacks(real_file("slices/binary")); !why.empty()) GTEST_SKIP() << why;
  struct File {
    const char *printer, *name, *ending;
  };
  std::vector<File> files = {{"longer-orange-10", "uv3dp_microsupports3.lgs", ".lgs"}};
  if (by_night()) {
    files.push_back({"elegoo-saturn", "msla_saturn.v4.ctb", ".ctb"});
    files.push_back({"elegoo-mars-4-max", "msla_mars4max.goo.gz", ".goo"});
  }
  for (const File& f : files) {
    SCOPED_TRACE(f.name);
    const std::string part = std::string("part") + f.ending, out = std::string("out") + f.ending,
                      films = std::string("films") + f.ending;
    write_file(folder_ / part, real_print_file(f.name));
    std::filesystem::remove(folder_ / "films.csv");
    Command make{"testpart", "films", "--printer", f.printer, "-o", films};
    // Those of the page are made new; LGS files only from another one.
    if (f.ending == std::string(".lgs")) make = make + Command{"--template", part};
    good(make);
    fill_in("films.csv", 10);
    const RunResult r = resinctl({"calibrate", "films.csv", "--printer", f.printer, "-o", "my.toml",
                                  "--resin-out", "resin.toml"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const Command with{"--printer", "my.toml", "--resin", "resin.toml", "--mode", "layerwise"};
    good(Command{"correct", part, "-o", out} + with);
    const int layers = StackReader::read_info(folder_ / part).grid.layers;
    // Those that have something over a gap, or all that reaches into one.
    EXPECT_GT(changed_layers(folder_ / part, folder_ / out, folder_.path()), 0.5 * layers);
    const std::string in_place = std::string("in-place") + f.ending;
    std::filesystem::copy_file(folder_ / part, folder_ / in_place);
    const RunResult post = run_program(
        Command{SLICECORR_BIN_DIR "/slicecorr-post"} + with + Command{in_place}, options_);
    ASSERT_EQ(post.exit_code, 0) << post.err;
    EXPECT_EQ(read_file(folder_ / in_place), read_file(folder_ / out)) << "in place as beside";
    const json before = figures(part, part, with), after = figures(out, part);
    EXPECT_LT(after["height_error_um"]["mean_abs"].get<double>(),
              before["height_error_um"]["mean_abs"].get<double>());
    EXPECT_LT(after["cure_through_voxels"].get<double>(),
              0.5 * before["cure_through_voxels"].get<double>());
    EXPECT_EQ(after["joints"]["not_holding_voxels"], 0);
    EXPECT_GE(after["joints"]["least"].get<double>(), 1.2 * (1 - 1e-9));
  }
}

}  // namespace
}  // namespace slicecorr::test
