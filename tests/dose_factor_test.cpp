// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The dose to aim at, changed on the command line: one way for resins from files and for those that
// stacks record, for every model.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "models.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

Resin parsed(const std::string& cure, const ResinOverrides& overrides = {}) {
  return parse_resin("name = \"r\"\n[cure]\n" + cure +
                         "\nabsorbance_height_um = 408.0\nabsorbance_base = \"e\"\n"
                         "[inhibition]\nbeta = 0.73\nabsorbance_height_um = 37.8\n"
                         "absorbance_base = \"e\"\n",
                     "r.toml", overrides);
}

TEST(DoseFactor, IsAimOverGelOfEveryModel) {
  const std::vector<std::string> files{
      "model = \"jacobs\"\ngel_dose_mj_cm3 = 100.0\ndose_factor = 3.0",
      "model = \"jacobs\"\ngel_dose_mj_cm2 = 10.0",
      "model = \"jacobs\"\ncritical_dose_mj_cm3 = 576.0",
      "model = \"jacobs\"\ncritical_dose_mj_cm3 = 576.0\ngel_dose_mj_cm3 = 115.2",
      "model = \"kinetic\"\nm = 0.99\ncritical_dose_prime = 64.0\ndose_factor = 5.0",
      "model = \"kinetic\"\nm = 0.8\ncritical_dose_prime = 64.0",
      "model = \"kinetic\"\nm = 1.0\ncritical_dose_prime = 64.0\ndose_factor = 2.0"};
  for (const std::string& file : files) {
    SCOPED_TRACE(file);
    const Resin plain = parsed(file);
    for (const double factor : {0.5, 1.0, 2.0, 7.5}) {
      const Resin r = parsed(file, {{}, {}, factor});
      EXPECT_EQ(r.dose_factor, factor);
      for (const bool inhibited : {false, true}) {
        const double gel = make_kinetics(r, inhibited, false).critical_dose_prime;
        EXPECT_NEAR(gel, make_kinetics(plain, inhibited, false).critical_dose_prime, 1e-12 * gel);
        EXPECT_NEAR(make_kinetics(r, inhibited, true).critical_dose_prime, factor * gel,
                    1e-12 * factor * gel);
      }
      // What a stack records is changed alike, and twice the same is once.
      EXPECT_EQ(with_overrides(r, {{}, {}, factor}).critical_dose_prime, r.critical_dose_prime);
      const Resin again = with_overrides(plain, {{}, {}, factor});
      EXPECT_EQ(again, r);
    }
    EXPECT_EQ(with_overrides(plain, {}), plain);
  }
}

TEST(DoseFactor, ADoseInMjCm3IsForMOf1FromFilesAndStacksAlike) {
  const std::string kinetic = "model = \"kinetic\"\nm = 0.99\ncritical_dose_prime = 64.0";
  for (const bool recorded : {false, true}) {
    try {
      recorded ? with_overrides(parsed(kinetic), {99, {}, {}}) : parsed(kinetic, {99, {}, {}});
      ADD_FAILURE() << "was taken";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("resin with m = 1"));
      EXPECT_THAT(e.what(), HasSubstr("dose factor"));
    }
    const std::string jacobs = "model = \"jacobs\"\ngel_dose_mj_cm3 = 100.0";
    const Resin r =
        recorded ? with_overrides(parsed(jacobs), {400, {}, {}}) : parsed(jacobs, {400, {}, {}});
    EXPECT_EQ(r.critical_dose_mj_cm3, 400);
    EXPECT_EQ(r.dose_factor, 4);
  }
  for (const double wrong : {0.0, -1.0, 1001.0}) {
    EXPECT_THROW(parsed(kinetic, {{}, {}, wrong}), InputError);
    EXPECT_THROW(with_overrides(parsed(kinetic), {{}, {}, wrong}), InputError);
  }
  EXPECT_THROW(with_overrides(parsed("model = \"jacobs\"\ngel_dose_mj_cm3 = 1.0"), {5, {}, 5}),
               InputError);
}

/// As a stack records it and is read again.
Resin as_recorded(const Resin& resin) {
  const Printer printer = parse_printer(
      "name = \"p\"\n[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50.0\n[blue]\n"
      "calibration = [[0, 1.0], [255, 100.0]]\n",
      "p.toml");
  return parse_definitions_json(definitions_json(printer, resin), "block").second;
}

// What changes a resin changes its file and what was read of it alike; a dose stays as it was told.
TEST(DoseFactor, AnotherHeightIsTheSameToFilesAndStacks) {
  struct Case {
    std::string file;
    bool areal_aim, areal_gel;
  };
  const std::string jacobs = "model = \"jacobs\"\n", kinetic = "model = \"kinetic\"\n";
  for (const Case& c :
       {Case{jacobs + "gel_dose_mj_cm3 = 100.0\ndose_factor = 3.0", false, false},
        Case{jacobs + "gel_dose_mj_cm2 = 10.0", true, true},
        Case{jacobs + "critical_dose_mj_cm3 = 576.0\ngel_dose_mj_cm2 = 5.0", false, true},
        Case{jacobs + "critical_dose_mj_cm2 = 20.0\ngel_dose_mj_cm3 = 115.2", true, false},
        Case{kinetic + "m = 1.0\ncritical_dose_prime = 64.0\ngel_dose_mj_cm2 = 3.0", true, true},
        Case{kinetic + "m = 0.8\ncritical_dose_prime = 64.0", true, false}}) {
    SCOPED_TRACE(c.file);
    const Resin plain = parsed(c.file);
    for (const ResinOverrides& o : {ResinOverrides{{}, 60.0, {}}, ResinOverrides{{}, 900.0, 2.0},
                                    ResinOverrides{99.0, 60.0, {}}}) {
      if (o.dc_mj_cm3 && plain.m != 1) continue;
      const Resin read = parsed(c.file, o), changed = with_overrides(plain, o);
      EXPECT_EQ(read, changed);
      EXPECT_EQ(changed.absorbance_height10_um, *o.ha_um);
      // A stack's own copy, changed later, is the same again.
      EXPECT_EQ(with_overrides(as_recorded(plain), o), changed);
      const double volume = dose_height_e_um(plain) / dose_height_e_um(changed);
      EXPECT_NEAR(changed.gel_dose_mj_cm3, plain.gel_dose_mj_cm3 * (c.areal_gel ? volume : 1),
                  1e-12 * changed.gel_dose_mj_cm3);
      EXPECT_EQ(changed.critical_dose_prime,
                o.dc_mj_cm3
                    ? 0
                    : plain.critical_dose_prime * (o.dose_factor ? 2 / plain.dose_factor : 1));
      if (plain.critical_dose_mj_cm3 == 0) continue;
      if (o.dc_mj_cm3) {
        EXPECT_EQ(changed.critical_dose_mj_cm3, 99);
      } else if (!o.dose_factor) {
        EXPECT_NEAR(changed.critical_dose_mj_cm3,
                    plain.critical_dose_mj_cm3 * (c.areal_aim ? volume : 1),
                    1e-12 * changed.critical_dose_mj_cm3);
      }
      if (changed.gel_dose_mj_cm3 > 0 && plain.critical_dose_prime == 0) {
        EXPECT_NEAR(changed.critical_dose_mj_cm3 / changed.gel_dose_mj_cm3, changed.dose_factor,
                    1e-12 * changed.dose_factor);
      }
    }
  }
}

TEST(DoseFactor, SetupsSayIt) {
  SetupChoices c;
  c.printer_toml =
      "name = \"p\"\n[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50.0\n[blue]\n"
      "calibration = [[0, 1.0], [255, 100.0]]\n";
  c.resin = SLICECORR_DB_DIR "/custom-resin-1.toml";
  c.speed_mm_h = 100;
  EXPECT_EQ(resolve_setup(c, nullptr, nullptr, ChoiceNames::fields).resin.critical_dose_prime, 320);
  c.dose_factor = 2;
  const slicecorr::Setup setup = resolve_setup(c, nullptr, nullptr, ChoiceNames::fields);
  EXPECT_EQ(setup.resin.critical_dose_prime, 128);
  EXPECT_EQ(parse_setup_json(setup_json(setup), "test").resin, setup.resin);
  c.dc_mj_cm3 = 5;
  try {
    resolve_setup(c, nullptr, nullptr, ChoiceNames::fields);
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("dc_mj_cm3 and dose_factor"));
  }
}

class DoseFactorProgram : public ::testing::Test {
 protected:
  DoseFactorProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", SLICECORR_DB_DIR}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    write_stl(folder_ / "ladder.stl", ladder());
    write_file(folder_ / "small.toml",
               to_bytes("name = \"small\"\n[display]\nwidth_px = 160\nheight_px = 120\n"
                        "pixel_um = 50.0\n[blue]\ncalibration = [[0, 0.2], [255, 100.0]]\n"));
    call(0, {"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
             "small.toml"});
  }
  RunResult call(int code, Command arguments) const {
    arguments.insert(arguments.begin(), SLICECORR_BIN_DIR "/slicecorr");
    RunResult r = run_program(arguments, options_);
    EXPECT_EQ(r.exit_code, code) << testing::PrintToString(arguments) << r.err;
    return r;
  }
  json verified(Command more) const {
    Command all{"verify", "out.uvj", "--target", "target.uvj", "--json", "-", "--quiet"};
    all.insert(all.end(), more.begin(), more.end());
    return json::parse(call(0, all).out);
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(DoseFactorProgram, StacksOfAnyResinCarryIt) {
  for (const char* resin : {"custom-resin-1", "figure-2-2"}) {
    SCOPED_TRACE(resin);
    const double recorded = *resin == 'c' ? 5 : 1;
    const Command correct{"correct",    "target.uvj", "-o",  "out.uvj",      "--printer",
                          "small.toml", "--resin",    resin, "--speed-mm-h", "400"};
    Command doubled = correct;
    doubled.insert(doubled.end(), {"--dose-factor", "2"});
    call(0, doubled);
    EXPECT_EQ(StackReader::read_info(folder_ / "out.uvj").resin->dose_factor, 2);
    const json plain = verified({});
    EXPECT_GE(plain["dose"]["min_inside"], 1);
    EXPECT_EQ(plain["undercure_voxels"], 0);
    // Said again it is the same; another one scales every dose by their ratio.
    EXPECT_EQ(verified({"--dose-factor", "2"}), plain);
    const json other = verified({"--dose-factor", "4"});
    EXPECT_NEAR(other["dose"]["max_inside"].get<double>(),
                plain["dose"]["max_inside"].get<double>() / 2, 1e-9);
    call(0, correct);
    EXPECT_EQ(StackReader::read_info(folder_ / "out.uvj").resin->dose_factor, recorded);
  }
  // A dose in mJ/cm³ says nothing of a kinetic resin, wherever that comes from.
  const Command kinetic{"correct",      "target.uvj", "-o",      "out.uvj",
                        "--printer",    "small.toml", "--resin", "custom-resin-1",
                        "--speed-mm-h", "400"};
  call(0, kinetic);
  Command dc = kinetic;
  dc.insert(dc.end(), {"--dc-mj-cm3", "500"});
  EXPECT_THAT(call(2, dc).err, HasSubstr("dose factor"));
  for (const Command& command :
       {Command{"verify", "out.uvj", "--target", "target.uvj"},
        Command{"probe", "out.uvj", "--x", "80", "--y", "60"},
        Command{"report", "out.uvj", "--target", "target.uvj", "-o", "r.html"}}) {
    Command bad = command;
    bad.insert(bad.end(), {"--dc-mj-cm3", "500"});
    EXPECT_THAT(call(2, bad).err, HasSubstr("dose factor"));
  }
  EXPECT_THAT(call(2, {"verify", "out.uvj", "--target", "target.uvj", "--dc-mj-cm3", "500",
                       "--dose-factor", "2"})
                  .err,
              HasSubstr("--dc-mj-cm3 and --dose-factor"));
}

}  // namespace
}  // namespace slicecorr::test
