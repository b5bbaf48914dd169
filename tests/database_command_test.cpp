// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program as a user runs it: list, show, validate, add, history, diff, restore, import, export.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <zip.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "ladder.hpp"
#include "run_program.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

class Resinctl : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("slicecorr-resinctl-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "db");
  }
  void TearDown() override { fs::remove_all(folder_); }

  test::RunResult run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), (fs::path(SLICECORR_BIN_DIR) / "resinctl").string());
    test::RunOptions options;
    options.folder = folder_.string();
    options.environment["SLICECORR_DB"] = (folder_ / "db").string();
    return test::run_program(arguments, options);
  }
  /// stdout of a run that must succeed.
  std::string ok(const std::vector<std::string>& arguments) {
    const auto result = run(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return result.out;
  }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  std::string read(const fs::path& path) {
    std::ifstream in(folder_ / path, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  fs::path folder_;
};

std::string goo(const std::string& dose) {
  return "name = \"goo\" # mine\nmaker = \"Acme\"\n[cure]\nwavelength_nm = 405\n"
         "absorbance_height_um = 170.0\nabsorbance_base = \"e\"\ngel_dose_mj_cm2 = " +
         dose + "\n";
}
const char* kHeights = "dose_mj_cm2,cured_height_um\n10,118\n20,236\n40,353\n80,471\n";

TEST_F(Resinctl, ListFindsByWhatIsAsked) {
  const auto count = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"list", "--json", "-"});
    return json::parse(ok(arguments)).size();
  };
  const std::size_t all = count({});
  EXPECT_GE(all, 37U);
  EXPECT_EQ(count({"--maker", "liqcreate", "--wavelength-nm", "385"}), 7U);
  EXPECT_EQ(count({"liqcreate", "black"}), 2U);
  EXPECT_EQ(count({"--height-um", "500:"}) + count({"--height-um", ":499.9"}), all);
  EXPECT_EQ(count({"--printers"}), 47U);
  const std::string table = ok({"list", "--maker", "MakerJuice"});
  EXPECT_THAT(table,
              AllOf(HasSubstr("NAME"), HasSubstr("makerjuice-standard-yellow"),
                    HasSubstr("67 (mW/cm²)^0.99·s"), HasSubstr("(5 x gel)"), HasSubstr("386.8")));
  const auto none = run({"list", "nothing-like-this"});
  EXPECT_EQ(none.exit_code, 0);
  EXPECT_THAT(none.err, HasSubstr("0 resins"));
  // Makers of printers are none of resins; what helps is told.
  const auto printers = run({"list", "elegoo"});
  EXPECT_EQ(printers.exit_code, 0);
  EXPECT_THAT(printers.err,
              AllOf(HasSubstr("no resin here has 'elegoo'"),
                    HasSubstr("7 printers do: resinctl list --printers elegoo"),
                    HasSubstr("slicecorr testpart films"), HasSubstr("docs/calipers.md")));
  EXPECT_EQ(count({"--printers", "Elegoo"}), 7U);
  EXPECT_THAT(run({"list", "liqcreate", "gray"}).err,
              HasSubstr("'liqcreate' has 14, 'gray' has none"));
  EXPECT_THAT(run({"list", "liqcraete"}).err, HasSubstr("did you mean 'liqcreate'?"));
  EXPECT_THAT(run({"list", "--maker", "anycubic"}).err, HasSubstr("--printers anycubic"));
  EXPECT_THAT(run({"list", "tough", "--wavelength-nm", "300"}).err,
              HasSubstr("4 resins have these words"));
  EXPECT_EQ(count({"tough-x"}), 2U);
  EXPECT_EQ(count({"TOUGHX", "405nm"}), 1U);
  for (const char* heights : {"5", "9:5"}) {
    EXPECT_EQ(run({"list", "--height-um=" + std::string(heights)}).exit_code, 2) << heights;
  }
}

TEST_F(Resinctl, ListForAPrinter) {
  const auto names = [&](std::vector<std::string> arguments, std::string* err = nullptr) {
    arguments.insert(arguments.begin(), {"list", "--json", "-"});
    const auto result = run(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    if (err) *err = result.err;
    std::vector<std::string> all;
    for (const auto& resin : json::parse(result.out)) all.push_back(resin["name"]);
    return all;
  };
  std::string err;
  const std::size_t all = names({}).size();
  const auto at405 = names({"--for", "prusa-sl1s"}, &err);
  EXPECT_THAT(at405, testing::Contains("liqcreate-strong-x-405nm"));
  EXPECT_THAT(at405, testing::Not(testing::Contains("liqcreate-strong-x-385nm")));
  // Those that say no wavelength come last, and are told.
  EXPECT_THAT(
      std::vector<std::string>(at405.end() - 4, at405.end()),
      testing::ElementsAre("bis-ema-tpo", "bis-ema-tpo-gel-time", "da-2-ppo", "figure-2-2"));
  EXPECT_THAT(err, AllOf(HasSubstr(std::to_string(all - at405.size()) +
                                   " measured at 365, 385, 460 nm, where the light of 'prusa-sl1s' "
                                   "has 405 nm"),
                         HasSubstr("4 of them do not say the wavelength")));
  // Nothing is known of this one's light: none is left out, and that is told.
  EXPECT_EQ(names({"--for", "elegoo-mars"}, &err).size(), all);
  EXPECT_THAT(err, AllOf(HasSubstr("does not say the wavelength"), HasSubstr("to be measured")));
  EXPECT_LT(names({"--for", "elegoo-mars", "--wavelength-nm", "405"}).size(), at405.size());
  // In units of its brightest level nothing that is shipped goes with it.
  write("mine.toml",
        "name = \"mine\"\n[display]\nwidth_px = 100\nheight_px = 80\npixel_um = 50\n[blue]\n"
        "wavelength_nm = 405\nunit = \"of the brightest level\"\n"
        "calibration = [[0, 0.0], [255, 1.0]]\n");
  EXPECT_TRUE(names({"--for", "mine.toml"}, &err).empty());
  EXPECT_THAT(err, HasSubstr("whose doses count light in another unit"));
  write("db/goo.toml",
        "name = \"goo\"\n[cure]\nwavelength_nm = 405\nunit = \"of the brightest level\"\n"
        "absorbance_height_um = 150\nabsorbance_base = 10\ncritical_dose_s = 0.8\n");
  EXPECT_THAT(names({"--for", "mine.toml"}), testing::ElementsAre("goo"));
  EXPECT_THAT(names({"--for", "prusa-sl1s", "goo"}, &err), testing::IsEmpty());
  EXPECT_THAT(err, HasSubstr("left out: 1 whose doses"));
  EXPECT_EQ(run({"list", "--for", "egg-resin"}).exit_code, 2);
  EXPECT_EQ(run({"list", "--printers", "--for", "ember"}).exit_code, 2);
}

TEST_F(Resinctl, ShowConvertsAndSaysWhatIsAimedAt) {
  write("goo.toml", goo("5.0"));
  const std::string text = ok({"show", "goo.toml"});
  EXPECT_THAT(text, AllOf(HasSubstr("170 um base e"), HasSubstr("391.44 um base 10"),
                          HasSubstr("5 mJ/cm² areal, 294.1 mJ/cm³ volumetric"),
                          HasSubstr("25 mJ/cm² areal, 1471 mJ/cm³ volumetric"),
                          HasSubstr("Correction aims at 5 times that, 25 mJ/cm²"),
                          HasSubstr("--dc-mj-cm3 1470.59 --ha-um 391.439")));
  const json j = json::parse(ok({"show", "goo.toml", "--json", "-"}));
  EXPECT_NEAR(j["absorbance_height_um"]["base_10"], 170 * std::log(10.0), 1e-9);
  EXPECT_NEAR(j["gel_dose"]["mj_cm3"], 5 / 0.017, 1e-9);
  EXPECT_NEAR(j["aim"]["mj_cm2"], 25, 1e-9);
  EXPECT_THAT(ok({"show", "custom-resin-1"}),
              AllOf(HasSubstr("0.73 areal, 0.06763 volumetric"), HasSubstr("UV above 1.37 times")));
  EXPECT_THAT(ok({"show", "ember"}), HasSubstr("500 : 1"));
  EXPECT_EQ(json::parse(ok({"show", "ember", "--json", "-"}))["width_px"], 1280);
  EXPECT_EQ(run({"show", "ember", "--html", "x.html"}).exit_code, 2);
  EXPECT_THAT(run({"show", "embre"}).err, HasSubstr("did you mean 'ember'?"));
  ok({"show", "goo.toml", "--html", "goo.html"});
  EXPECT_THAT(read("goo.html"), HasSubstr("<html"));
}

TEST_F(Resinctl, ShowTellsOfLightThatSpreads) {
  write("wide.toml",
        "name = \"wide\"\n[display]\nwidth_px = 640\nheight_px = 480\npixel_um = 50\n[blue]\n"
        "calibration = [[0, 1], [255, 100]]\nspread = [[15, 0.9], [120, 0.1]]\n[uv]\n"
        "kind = \"patterned\"\ncalibration = [[0, 0], [255, 100]]\nspread = [[40, 1]]\n");
  EXPECT_THAT(ok({"show", "wide.toml"}),
              AllOf(HasSubstr("Gaussians: 90 % with sigma 15 um, 10 % with sigma 120 um"),
                    HasSubstr("Gaussian, sigma 40 um")));
  const json j = json::parse(ok({"show", "wide.toml", "--json", "-"}));
  EXPECT_EQ(j["spread"], json::parse("[[15, 0.9], [120, 0.1]]"));
  EXPECT_EQ(j["uv"]["spread"], json::parse("[[40, 1]]"));
  write("milky.toml", goo("5.0") + "scatter_um2_per_um = 4\n");
  // sqrt(4 * 391.44)
  EXPECT_THAT(ok({"show", "milky.toml"}), HasSubstr("4 um² per um: sigma 39.6 um"));
  EXPECT_EQ(json::parse(ok({"show", "milky.toml", "--json", "-"}))["scatter_um2_per_um"], 4);
}

TEST_F(Resinctl, ShowTellsOfTomography) {
  const std::string dry = ok({"show", "webber-vial"});
  EXPECT_THAT(dry, AllOf(HasSubstr("25 mm outside, 23.6 mm inside (radii 12.5 and 11.8)"),
                         HasSubstr("1 outside (air), 1.48 of the wall"),
                         HasSubstr("up to 8.333 mm from the axis, in a resin of index 1.5"),
                         HasSubstr("pinhole: light from a point 99.5 mm from the axis"),
                         HasSubstr("12 degrees a second, 30 s a turn, clockwise seen from above"),
                         HasSubstr("at most 1800, at 60 a second")));
  EXPECT_THAT(ok({"show", "webber-vial", "--resin", "webber-dudma-pegda"}),
              AllOf(HasSubstr("up to 8.335 mm from the axis, in webber-dudma-pegda (n = 1.49969)"),
                    HasSubstr("0.472: 62.4 % of the light comes to the axis")));
  EXPECT_THAT(ok({"show", "kelly-projector-and-vial"}),
              AllOf(HasSubstr("1.5 outside (a bath)"), HasSubstr("up to 12.5 mm"),
                    HasSubstr("telecentric: parallel light"), HasSubstr("at most 360, at 25")));
  EXPECT_THAT(ok({"list", "--printers", "vial"}), AllOf(HasSubstr("VIAL MM"), HasSubstr("23.6")));
  const json j = json::parse(ok({"show", "webber-vial", "--json", "-"}));
  EXPECT_EQ(j["vial"]["inner_mm"], 11.8);
  EXPECT_EQ(j["optics"]["distance_mm"], 99.5);
  EXPECT_EQ(j["rotation"]["direction"], "clockwise");
  EXPECT_EQ(j["rotation"]["frames_per_turn"], 1800);
  write("goo.toml", goo("5.0") +
                        "active_absorption_per_cm = 29.4\nn = 1.5\n"
                        "inhibition_dose_mj_cm3 = 3\n");
  EXPECT_THAT(ok({"show", "goo.toml"}),
              AllOf(HasSubstr("58.82 per cm in base e, of which 29.4 cure"),
                    HasSubstr("5 mJ/cm² areal, 147 mJ/cm³ volumetric"),
                    HasSubstr("refractive index      1.5"), HasSubstr("3 mJ/cm³, before the gel")));
  const json r = json::parse(ok({"show", "goo.toml", "--json", "-"}));
  EXPECT_NEAR(r["absorption_per_cm"], 1e4 / 170, 1e-10);
  EXPECT_EQ(r["active_absorption_per_cm"], 29.4);
  // Where it says nothing.
  const auto blind = run({"show", "webber-vial", "--resin", "benchy-resin"});
  EXPECT_EQ(blind.exit_code, 2);
  EXPECT_THAT(blind.err, HasSubstr("does not say its refractive index"));
  EXPECT_THAT(run({"show", "ember", "--resin", "goo.toml"}).err,
              HasSubstr("--resin is for a vial"));
  EXPECT_THAT(run({"show", "goo.toml", "--resin", "goo.toml"}).err, HasSubstr("is for printers"));
}

TEST_F(Resinctl, ValidateNamesFileLineAndWhatIsWrong) {
  EXPECT_EQ(ok({"validate"}), "");
  write("goo.toml", goo("-5") + "dose_facto = 3\n");
  const auto result = run({"validate", "goo.toml", "gone.toml"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_EQ(result.out,
            "goo.toml:7: cure.gel_dose_mj_cm2: is -5; expected a number above 0 and at most 1e+09\n"
            "goo.toml:8: cure.dose_facto: unknown key; did you mean 'dose_factor'?\n"
            "gone.toml: is not a file that can be read\n");
  EXPECT_THAT(result.err, HasSubstr("2 files, 3 errors, 0 warnings"));
  write("goo.toml", goo("5.0") + "dose_factor = 0.5\n");
  const auto warned = run({"validate", "goo.toml"});
  EXPECT_EQ(warned.exit_code, 0);
  EXPECT_THAT(warned.out, HasSubstr("goo.toml:8: warning: cure.dose_factor"));
  // What slicecorr-post reads lies there, too, and is no definition.
  write("db/post.toml",
        "[default]\nprinter = \"elegoo-saturn\"\n[[rule]]\nmaterial_profile = \"*\"\n");
  EXPECT_THAT(ok({"list", "--printers"}), testing::Not(HasSubstr("post")));
  ok({"validate"});
  write("db/broken.toml", "[cure\n");
  EXPECT_EQ(run({"validate"}).exit_code, 2);
}

TEST_F(Resinctl, TheDocumentedSchemaIsTheOneInTheProgram) {
  std::ifstream in(fs::path(SLICECORR_SOURCE_DIR) / "docs" / "resin-files.md");
  std::stringstream document;
  document << in.rdbuf();
  for (const char* kind : {"resin", "printer"}) {
    EXPECT_THAT(document.str(), HasSubstr(ok({"validate", "--schema", kind})));
  }
}

TEST_F(Resinctl, AddHistoryDiffRestore) {
  write("goo.toml", goo("5.0"));
  write("heights.csv", kHeights);
  EXPECT_EQ(ok({"add", "goo.toml", "heights.csv", "-m", "first fit"}),
            (folder_ / "db/goo.toml").string() + "\n");
  EXPECT_THAT(read("db/goo.toml"), AllOf(HasSubstr("# mine"), HasSubstr("version = 1"),
                                         HasSubstr("measurements = [\"goo.csv\"]")));
  EXPECT_EQ(read("db/goo.csv"), kHeights);
  write("goo.toml", goo("6.0"));
  const auto refused = run({"add", "goo.toml"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--replace"));
  EXPECT_THAT(read("db/goo.toml"), HasSubstr("= 5.0"));
  ok({"add", "goo.toml", "--replace", "-m", "measured again"});
  const std::string versions = ok({"history", "goo"});
  EXPECT_THAT(versions,
              AllOf(HasSubstr("first fit"), HasSubstr("2 (now)"), HasSubstr("measured again")));
  const std::string diff = ok({"diff", "goo"});
  EXPECT_THAT(diff,
              AllOf(HasSubstr("--- goo version 1\n+++ goo version 2\n"),
                    HasSubstr("-gel_dose_mj_cm2 = 5.0\n"), HasSubstr("+gel_dose_mj_cm2 = 6.0\n")));
  EXPECT_EQ(ok({"diff", "goo", "2", "2"}), "");
  EXPECT_THAT(run({"diff", "goo", "7"}).err, HasSubstr("known versions: 1, 2"));
  ok({"restore", "goo", "1"});
  EXPECT_THAT(read("db/goo.toml"), AllOf(HasSubstr("= 5.0"), HasSubstr("version = 3")));
  EXPECT_THAT(ok({"history", "goo"}), HasSubstr("version 1 restored"));
  EXPECT_EQ(ok({"validate", "goo"}), "");
}

TEST_F(Resinctl, ShippedDefinitionsAreNotHiddenUnasked) {
  const std::string shipped = read(fs::path(SLICECORR_DB_DIR) / "da-2-ppo.toml");
  write("da-2-ppo.toml", shipped + "\n# changed\n");
  write("da-2-ppo.csv", kHeights);
  const auto refused = run({"add", "da-2-ppo.toml"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("would hide"));
  ok({"add", "da-2-ppo.toml", "--replace"});
  // The shipped text is version 1 of one's own, with the measurements that it names.
  EXPECT_THAT(ok({"history", "da-2-ppo"}), AllOf(HasSubstr("as in "), HasSubstr("2 (now)")));
  EXPECT_THAT(ok({"diff", "da-2-ppo"}), HasSubstr("+# changed\n"));
  EXPECT_EQ(read("db/da-2-ppo.csv"), read(fs::path(SLICECORR_DB_DIR) / "da-2-ppo.csv"));
  EXPECT_EQ(read("db/da-2-ppo-2.csv"), kHeights);
  EXPECT_EQ(ok({"validate"}), "");
  // A name alone is copied, to be changed there.
  ok({"add", "egg-resin"});
  EXPECT_THAT(read("db/egg-resin.toml"), HasSubstr("version = 1"));
}

TEST_F(Resinctl, AddChecksFirst) {
  write("goo.toml", goo("-1"));
  const auto wrong = run({"add", "goo.toml"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("goo.toml:7: cure.gel_dose_mj_cm2"));
  write("goo.toml", goo("1"));
  write("bad.csv", "x\n1\n");
  EXPECT_EQ(run({"add", "goo.toml", "bad.csv"}).exit_code, 2);
  EXPECT_EQ(run({"add", "goo.toml", "gone.csv"}).exit_code, 2);
  EXPECT_TRUE(fs::is_empty(folder_ / "db")) << "nothing was to be written";
}

TEST_F(Resinctl, AFullDiskLeavesWhatWasThere) {
  write("goo.toml", goo("5.0"));
  ok({"add", "goo.toml"});
  const std::string before = read("db/goo.toml");
  write("goo.toml", goo("6.0"));
  test::RunOptions options;
  options.folder = folder_.string();
  options.environment["SLICECORR_DB"] = (folder_ / "db").string();
  options.largest_file = 100;  // less than a definition has
  const auto result = test::run_program(
      {(fs::path(SLICECORR_BIN_DIR) / "resinctl").string(), "add", "goo.toml", "--replace"},
      options);
  EXPECT_EQ(result.exit_code, 4) << result.err;
  EXPECT_EQ(read("db/goo.toml"), before);
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "db")) {
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
  }
  ok({"add", "goo.toml", "--replace"});
  EXPECT_THAT(ok({"history", "goo"}), HasSubstr("2 (now)"));
}

TEST_F(Resinctl, ImportSaysWhatItAssumed) {
  write("p.txt", "resin = Goo\nlayerHeight = 0.05\nexposureTime = 2.5\n");
  EXPECT_THAT(run({"import", "p.txt"}).err, HasSubstr("--intensity-mw-cm2"));
  EXPECT_THAT(run({"import", "p.txt", "--intensity-mw-cm2", "3"}).err, HasSubstr("--height-um"));
  const std::vector<std::string> good = {
      "import", "p.txt", "--intensity-mw-cm2", "3", "--height-um", "180", "--name", "my-goo"};
  const auto made = run(good);
  EXPECT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(made.out, (folder_ / "db/my-goo.toml").string() + "\n");
  EXPECT_THAT(made.err, AllOf(HasSubstr("upper bound of the gel dose"), HasSubstr("1 made")));
  EXPECT_EQ(run(good).exit_code, 0) << "the same again is no replacement";
  write("p.txt", "resin = Goo\nlayerHeight = 0.05\nexposureTime = 3.5\n");
  EXPECT_EQ(run(good).exit_code, 2);
  EXPECT_THAT(ok({"show", "my-goo"}), HasSubstr("The file gives this dose itself"));
  EXPECT_EQ(ok({"validate"}), "");
}

TEST_F(Resinctl, MeasurementsOfPrintersAreKeptBesideThem) {
  write("c.csv", "0,0.1\n128,3\n255,20\n");
  ok({"import", "c.csv", "--printer", "ember", "--name", "my-ember"});
  write(
      "uv.toml", "uvSensorData = [" + [] {
        std::string numbers;
        for (int i = 0; i < 60; ++i) numbers += std::to_string(100 + i) + ",";
        return numbers;
      }() + "]\n");
  ok({"import", "uv.toml", "--printer", "my-ember", "--replace"});
  EXPECT_TRUE(fs::exists(folder_ / "db/my-ember-flat-field.png"));
  EXPECT_THAT(ok({"show", "my-ember"}),
              AllOf(HasSubstr("version 2"), HasSubstr("3 calibration points"),
                    HasSubstr("curing light 62.7 to 100 %")));
  EXPECT_EQ(ok({"validate"}), "");
  EXPECT_EQ(ok({"export", "my-ember", "--format", "csv"}),
            "grey_level,intensity_mw_cm2\n0,0.1\n128,3\n255,20\n");
}

TEST_F(Resinctl, ExportForOthers) {
  write("goo.toml", "# by Jo\n" + goo("5.0") +
                        "[provenance]\nsource = \"measured\"\n"
                        "measured_with = \"calipers\"\nmeasurements = \"heights.csv\"\n");
  write("heights.csv", kHeights);
  const std::vector<std::string> command = {"export", "--share", "goo.toml", "-o", "acme-goo.toml"};
  const auto refused = run(command);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.out, AllOf(HasSubstr("goo.toml: product: missing"),
                                 HasSubstr("goo.toml: provenance.date: says no year")));
  EXPECT_FALSE(fs::exists(folder_ / "acme-goo.toml") || fs::exists(folder_ / "acme-goo.csv"));
  write("goo.toml", "product = \"Goo\"\n" + read("goo.toml") + "date = 2026\n");
  const auto done = run(command);
  EXPECT_EQ(done.exit_code, 0) << done.err;
  EXPECT_THAT(read("acme-goo.toml"),
              AllOf(HasSubstr("name = \"acme-goo\""),
                    HasSubstr("measurements = [\"acme-goo.csv\"]"), testing::Not(HasSubstr("#"))));
  EXPECT_THAT(read("acme-goo.csv"), HasSubstr("\n80,471,\n"));
  ok({"validate", "acme-goo.toml"});
  ok(command);
  // Somebody's own measurements are not written over.
  write("acme-goo.csv", "mine");
  EXPECT_EQ(run(command).exit_code, 2);
  EXPECT_EQ(read("acme-goo.csv"), "mine");
  EXPECT_THAT(run({"export", "--share", "goo.toml"}).err, HasSubstr("expected -o FILE.toml"));
  EXPECT_EQ(run({"export", "--share", "goo.toml", "-o", "goo.toml"}).exit_code, 2);
  EXPECT_EQ(run({"export", "--share", "goo.toml", "-o", "x.csv"}).exit_code, 2);
  EXPECT_EQ(run({"export", "--share", "goo.toml", "--format", "json"}).exit_code, 2);
  // Whose computer it is.
  ::setenv("USER", "calipers", 1);
  EXPECT_THAT(run(command).out, HasSubstr("provenance.measured_with: holds 'calipers'"));
  ::unsetenv("USER");
  // A display that nobody measured may be handed in, too.
  ok({"export", "--share", "elegoo-mars", "-o", "elegoo-mars.toml"});
  EXPECT_THAT(read("elegoo-mars.toml"), HasSubstr("calibration = \"to be measured\""));
}

TEST_F(Resinctl, UsageErrors) {
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"show"},
                                             {"show", "no-such-thing"},
                                             {"history", "no-such-thing"},
                                             {"restore", "egg-resin", "0"},
                                             {"restore", "egg-resin", "9"},
                                             {"export", "egg-resin", "--format", "xml"},
                                             {"export", "egg-resin", "--format", "prusaslicer"},
                                             {"import", "gone.ini"},
                                             {"validate", "x.toml", "--schema", "resin"}}) {
    EXPECT_EQ(run(wrong).exit_code, 2) << testing::PrintToString(wrong);
  }
}

/// A member of an archive as text.
std::string member(const fs::path& archive, const char* name) {
  zip_t* zip = zip_open(archive.c_str(), ZIP_RDONLY, nullptr);
  if (!zip) return "";
  std::string text(1 << 16, 0);
  zip_file_t* file = zip_fopen(zip, name, 0);
  const zip_int64_t read = file ? zip_fread(file, text.data(), text.size()) : 0;
  if (file) zip_fclose(file);
  zip_discard(zip);
  text.resize(static_cast<std::size_t>(std::max<zip_int64_t>(read, 0)));
  return text;
}

TEST_F(Resinctl, PrusaSlicerReadsTheMaterial) {
  if (std::system("command -v prusa-slicer >/dev/null") != 0) {
    GTEST_SKIP() << "prusa-slicer is not installed";
  }
  ok({"export", "liqcreate-premium-black-405nm", "--format", "prusaslicer", "--layer-um", "50",
      "--intensity-mw-cm2", "4", "-o", "m.ini"});
  test::write_stl((folder_ / "part.stl").string(), test::ladder());
  test::RunOptions options;
  options.folder = folder_.string();
  const auto sliced = test::run_program(
      {"/bin/sh", "-c",
       "prusa-slicer --load m.ini --export-sla --layer-height 0.05 --supports-enable=0 "
       "--pad-enable=0 --display-width 128 --display-height 81 --display-pixels-x 640 "
       "--display-pixels-y 405 --bed-shape 0x0,128x0,128x81,0x81 --output a.sl1 part.stl"},
      options);
  ASSERT_EQ(sliced.exit_code, 0) << sliced.out << sliced.err;
  const std::string config = member(folder_ / "a.sl1", "config.ini");
  // 25 mJ/cm² at 4 mW/cm², through 50 um of a resin of 170 um.
  const double seconds = 25.0 / 4 * std::exp(50.0 / 170);
  const auto value = [&](const std::string& key) {
    const std::size_t at = config.find("\n" + key + " = ");
    return at == std::string::npos ? -1 : std::stod(config.substr(at + key.size() + 4));
  };
  EXPECT_NEAR(value("expTime"), seconds, 5e-4 * seconds) << config;
  EXPECT_NEAR(value("expTimeFirst"), 4.4 * seconds, 5e-4 * 4.4 * seconds);
  EXPECT_EQ(value("layerHeight"), 0.05);
  EXPECT_THAT(config, HasSubstr("materialName = liqcreate-premium-black-405nm @0.05"));
}

}  // namespace
}  // namespace slicecorr
