// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How definitions are found, with the files that they name, and the ones that are shipped.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "definition_texts.hpp"
#include "refusal.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/same_light.hpp"

namespace slicecorr {
namespace {

using namespace test;

namespace fs = std::filesystem;
using testing::HasSubstr;

class DefinitionFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() / ("slicecorr_definition_files_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    for (const char* name : {"SLICECORR_DB", "XDG_CONFIG_HOME", "HOME"}) {
      const char* value = std::getenv(name);
      before_.emplace_back(name, value ? std::optional<std::string>(value) : std::nullopt);
    }
    unsetenv("SLICECORR_DB");
    set("XDG_CONFIG_HOME", folder_ / "no-config");
    set("HOME", folder_ / "no-home");
  }
  void TearDown() override {
    for (const auto& [name, value] : before_) {
      if (value) {
        setenv(name.c_str(), value->c_str(), 1);
      } else {
        unsetenv(name.c_str());
      }
    }
    fs::remove_all(folder_);
  }
  static void set(const char* name, const fs::path& value) { setenv(name, value.c_str(), 1); }
  std::string write(const fs::path& name, const std::string& text) const {
    const fs::path path = folder_ / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
    return path.string();
  }

  fs::path folder_;

 private:
  std::vector<std::pair<std::string, std::optional<std::string>>> before_;
};

TEST_F(DefinitionFiles, ByPath) {
  EXPECT_EQ(load_printer(write("one.toml", kPrinter)).name, "dlp-1");
  EXPECT_EQ(load_resin(write("a b/two.toml", kResin)).name, "r-1");
  ResinOverrides o;
  o.dc_mj_cm3 = 7;
  EXPECT_EQ(load_resin(write("two.toml", kResin), o).critical_dose_mj_cm3, 7);
  const std::string missing = (folder_ / "none.toml").string();
  EXPECT_THAT(refusal([&] { load_printer(missing); }), testing::StartsWith(missing));
  EXPECT_THAT(refusal([&] { load_resin(missing); }), testing::StartsWith(missing));
  fs::create_directories(folder_ / "folder.toml");
  EXPECT_THAT(refusal([&] { load_resin((folder_ / "folder.toml").string()); }),
              HasSubstr("folder.toml"));
  // A complaint names the file as it was given.
  const std::string bad = write("bad.toml", with(kPrinter, "width_px = 1280", "width_px = 0"));
  EXPECT_THAT(refusal([&] { load_printer(bad); }),
              testing::StartsWith(bad + ": line 4: display.width_px: "));
  const std::string empty = write("empty.toml", "");
  EXPECT_THAT(refusal([&] { load_printer(empty); }),
              testing::StartsWith(empty + ": line 1: display: missing"));
  EXPECT_THAT(refusal([&] { load_resin(empty); }),
              testing::StartsWith(empty + ": line 1: cure: missing"));
}

TEST_F(DefinitionFiles, WindowsLineEndsAndByteOrderMark) {
  std::string text = "\xEF\xBB\xBF";
  for (const char c : kPrinter) text += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(load_printer(write("dos.toml", text)), parse_printer(kPrinter, "dos.toml"));
}

TEST_F(DefinitionFiles, ByName) {
  const auto named = [](const std::string& text, const char* was, const char* name) {
    return with(text, was, std::string("name = \"") + name + "\"");
  };
  const auto resin = [&](const char* name) { return named(kResin, "name = \"r-1\"", name); };
  EXPECT_THAT(refusal([&] { load_resin("test-resin"); }),
              testing::AllOf(HasSubstr("no resin 'test-resin'"), HasSubstr("no-config")));
  // The user's folder ...
  write("config/slicecorr/test-resin.toml", resin("user"));
  set("XDG_CONFIG_HOME", folder_ / "config");
  EXPECT_EQ(load_resin("test-resin").name, "user");
  // ... or the one below his home ...
  unsetenv("XDG_CONFIG_HOME");
  write("home/.config/slicecorr/resins/test-resin.toml", resin("home"));
  set("HOME", folder_ / "home");
  EXPECT_EQ(load_resin("test-resin").name, "home");
  // ... comes after $SLICECORR_DB.
  set("SLICECORR_DB", folder_ / "db");
  EXPECT_EQ(load_resin("test-resin").name, "home");
  write("db/resins/test-resin.toml", resin("below"));
  EXPECT_EQ(load_resin("test-resin").name, "below");
  write("db/test-resin.toml", resin("db"));
  EXPECT_EQ(load_resin("test-resin").name, "db");
  write("db/printers/test-printer.toml", kPrinter);
  EXPECT_EQ(load_printer("test-printer").name, "dlp-1");
  EXPECT_EQ(find_definition("test-printer", "printer"),
            (folder_ / "db/printers/test-printer.toml").string());
  // $SLICECORR_DB comes before what is shipped.
  write("db/egg-resin.toml", resin("mine"));
  EXPECT_EQ(load_resin("egg-resin").name, "mine");
  const std::string message = refusal([&] { load_printer("no-such"); });
  EXPECT_THAT(message, HasSubstr("no printer 'no-such'; looked for no-such.toml in "));
  EXPECT_THAT(message, HasSubstr((folder_ / "db").string()));
  EXPECT_THAT(message, HasSubstr((folder_ / "home").string()));
}

TEST_F(DefinitionFiles, NoNames) {
  set("SLICECORR_DB", folder_ / "db");
  write("outside.toml", kResin);
  write("db/below/inside.toml", kResin);
  for (const char* name : {"", "../outside", "below/inside", ".", "..", ".hidden", "/etc/passwd"}) {
    EXPECT_THAT(refusal([&] { load_resin(name); }), HasSubstr("is no resin name")) << name;
  }
}

std::string printer_with_csv(const std::string& csv) {
  return with(kPrinter, kCalibrationLine, "calibration = \"" + csv + "\"");
}

TEST_F(DefinitionFiles, CalibrationFromCsv) {
  const std::vector<CalibrationPoint> expected = {{0, 1}, {128, 31.5}, {255, 100}};
  const std::string file = write("printers/p.toml", printer_with_csv("curves/c.csv"));
  for (const char* text : {"0,1\n128,31.5\n255,100\n", "grey,mW/cm2\n0,1\n128,31.5\n255,100",
                           "# measured\n\n0, 1\n 128 , 3.15e1 \n\n# end\n255,\t100.0\n",
                           "level,intensity\r\n0,1\r\n128,31.5\r\n255,100\r\n"}) {
    write("printers/curves/c.csv", text);
    EXPECT_EQ(load_printer(file).calibration, expected) << text;
  }
  // The path is relative to the toml file, whatever the working folder is.
  EXPECT_EQ(load_printer((folder_ / "printers/../printers/p.toml").string()).calibration, expected);
  const std::string absolute =
      write("p2.toml", printer_with_csv((folder_ / "printers/curves/c.csv").string()));
  EXPECT_EQ(load_printer(absolute).calibration, expected);
}

TEST_F(DefinitionFiles, WrongCsv) {
  const std::string file = write("p.toml", printer_with_csv("c.csv"));
  const std::string csv = (folder_ / "c.csv").string();
  const auto complaint = [&](const char* text) {
    write("c.csv", text);
    return refusal([&] { load_printer(file); });
  };
  EXPECT_THAT(refusal([&] { load_printer(file); }),
              testing::AllOf(HasSubstr("line 10: blue.calibration"), HasSubstr(csv)));  // missing
  for (const char* text : {"0,1\n128\n255,9\n", "0,1\nx,3\n255,9\n", "0,1\n128,3,4\n255,9\n",
                           "0,1\n128;3\n255,9\n", "0,1\n128,\n255,9\n"}) {
    EXPECT_THAT(complaint(text), testing::AllOf(HasSubstr(csv + ": line 2: "),
                                                HasSubstr("expected 'grey level, mW/cm²'")))
        << text;
  }
  // The rules of the curve are those of calibrations in the file.
  const auto at = [&](const std::string& text) {
    return HasSubstr(file + ": line 10: blue.calibration: " + text);
  };
  EXPECT_THAT(complaint("0,5\n255,4\n"), at("point 2: the curve must not fall"));
  EXPECT_THAT(complaint("0,5\n9,6\n8,6\n255,7\n"), at("point 3: grey levels must rise"));
  EXPECT_THAT(complaint("0,5\n254,6\n"), at("goes from level 0 to 254"));
  EXPECT_THAT(complaint(""), at("expected at least two points"));
  EXPECT_THAT(complaint("only,words\n"), at("expected at least two points"));
}

TEST(FlowKeys, AreReadAtTheTopAndInTheirTables) {
  const std::string cure =
      "[cure]\nabsorbance_height_um = 550\nabsorbance_base = \"e\"\ngel_dose_mj_cm3 = 40\n";
  const Resin none = parse_resin(cure, "r.toml");
  EXPECT_EQ(none.viscosity_pa_s, 0);
  EXPECT_TRUE(std::isinf(none.inhibitor_life_s));
  for (const std::string& text : {"viscosity_pa_s = 0.3\ninhibitor_life_s = 0\n" + cure,
                                  cure + "viscosity_pa_s = 0.3\ninhibitor_life_s = 0\n"}) {
    const Resin r = parse_resin(text, "r.toml");
    EXPECT_EQ(r.viscosity_pa_s, 0.3);
    EXPECT_EQ(r.inhibitor_life_s, 0);
  }
  for (const char* wrong : {"viscosity_pa_s = 0", "viscosity_pa_s = inf", "viscosity_pa_s = nan",
                            "inhibitor_life_s = -1", "inhibitor_life_s = inf"}) {
    EXPECT_THROW(parse_resin(cure + wrong + "\n", "r.toml"), InputError) << wrong;
  }
  const std::string display =
      "[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50\n"
      "[blue]\ncalibration = [[0, 1], [255, 100]]\n";
  const std::string vat = "[vat]\nsuction_limit_pa = 20000\n";
  EXPECT_EQ(parse_printer(display, "p.toml").suction_limit_pa, 0);
  EXPECT_EQ(parse_printer(display + vat, "p.toml").suction_limit_pa, 20000);
  EXPECT_EQ(parse_printer("suction_limit_pa = 2e4\n" + display, "p.toml").suction_limit_pa, 20000);
  EXPECT_THROW(parse_printer("suction_limit_pa = 2e4\n" + display + vat, "p.toml"), InputError);
  for (const char* wrong : {"0", "-5", "nan", "101326"}) {
    EXPECT_THROW(
        parse_printer(std::string("suction_limit_pa = ") + wrong + "\n" + display, "p.toml"),
        InputError)
        << wrong;
  }
}

TEST_F(DefinitionFiles, LightThatIsToBeMeasuredIsRefusedWhereItIsNeeded) {
  const std::string text = with(kPrinter, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                                "calibration = \"to be measured\"");
  const std::string file = write("dark.toml", text);
  const Printer display = load_display(file);
  EXPECT_FALSE(light_is_measured(display));
  EXPECT_TRUE(display.calibration.empty());
  const Printer whole = parse_printer(kPrinter, "dark.toml");
  EXPECT_TRUE(light_is_measured(whole));
  EXPECT_EQ(parse_display(kPrinter, "dark.toml"), whole);
  Printer same = display;
  same.calibration = whole.calibration;
  EXPECT_EQ(same, whole);
  for (const auto& load : {std::function([&] { load_printer(file); }),
                           std::function([&] { parse_printer(text, file); }),
                           std::function([&] { complete_printer(text, file); })}) {
    EXPECT_THAT(
        refusal(load),
        testing::AllOf(testing::StartsWith(file), testing::HasSubstr("line "),
                       testing::HasSubstr("blue.calibration: is to be measured"),
                       testing::HasSubstr("printer 'dlp-1'"), testing::HasSubstr("power meter"),
                       testing::HasSubstr("255"), testing::HasSubstr("testpart levels"),
                       testing::HasSubstr("resinctl import")));
  }
  // Nothing else stands for it, and nothing else is forgiven.
  for (const char* other : {"\"To be measured\"", "\"\"", "\"unknown\"", "[]", "0"}) {
    const std::string wrong = with(kPrinter, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                                   std::string("calibration = ") + other);
    EXPECT_THROW(parse_display(wrong, "p.toml"), InputError) << other;
  }
  EXPECT_THROW(parse_display(with(text, "width_px = 1280", "width_pixels = 1280"), "p.toml"),
               InputError);
}

// Prints without a vial do not count what inhibitors take, and say so.
TEST_F(DefinitionFiles, InhibitorsOfVialsAreTold) {
  const auto told = [](const char* printer, const char* resin) {
    std::string all;
    for (const std::string& text :
         definition_notices(load_printer(printer), load_resin(resin), false)) {
      all += text + "\n";
    }
    return all;
  };
  EXPECT_THAT(
      told("dual-wavelength-dlp", "kelly-bpagda-pegda"),
      testing::HasSubstr("inhibition_resupply_mj_cm3_s), which count in tomographic prints alone"));
  EXPECT_THAT(told("kelly-projector-and-vial", "kelly-bpagda-pegda"),
              testing::Not(testing::HasSubstr("tomographic prints alone")));
  EXPECT_THAT(told("dual-wavelength-dlp", "benchy-resin"),
              testing::Not(testing::HasSubstr("tomographic prints alone")));
}

TEST_F(DefinitionFiles, ModelsOfPrintersAreToldAndMayBeAssumed) {
  Resin resin;
  resin.name = "r";
  const auto told = [&](const Printer& printer) {
    std::string all;
    for (const std::string& text : definition_notices(printer, resin, false)) all += text + "\n";
    return all;
  };
  const Printer model = load_printer("prusa-sl1s");
  EXPECT_TRUE(model.model);
  EXPECT_THAT(told(model),
              testing::HasSubstr("printer 'prusa-sl1s' is a model: its light is made up"));
  const Printer assumed = with_assumed_light(model, AssumedLight::mono_lcd_405);
  EXPECT_FALSE(assumed.model);
  Printer own = model;
  own.model = false;
  EXPECT_THAT(told(own), testing::Not(testing::HasSubstr("is a model")));
  EXPECT_THAT(refusal([&] { with_assumed_light(own, AssumedLight::mono_lcd_405); }),
              testing::HasSubstr("is measured: expected nothing to be assumed"));
}

TEST_F(DefinitionFiles, ShippedOnesParseAndAreFoundByName) {
  int printers = 0, resins = 0;
  for (const auto& entry : fs::directory_iterator(SLICECORR_PRINTERS_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++printers;
    const std::string name = entry.path().stem().string();
    const Printer p = load_display(entry.path().string());
    EXPECT_EQ(p.name, name);
    set("SLICECORR_DB", SLICECORR_PRINTERS_DIR);
    EXPECT_EQ(load_display(name), p);
    unsetenv("SLICECORR_DB");
    EXPECT_EQ(load_display(name), p);  // the source's own database, found from the build folder
    if (light_is_measured(p)) {
      EXPECT_EQ(load_printer(name), p);
    } else {
      EXPECT_THAT(refusal([&] { load_printer(name); }), testing::HasSubstr("to be measured"));
    }
  }
  // Half of a name finds all that have it.
  set("SLICECORR_DB", SLICECORR_DB_DIR);
  EXPECT_THAT(refusal([&] { load_resin("benchy"); }),
              testing::HasSubstr("no resin 'benchy'; did you mean 'benchy-resin'?"));
  unsetenv("SLICECORR_DB");
  for (const auto& entry : fs::directory_iterator(SLICECORR_DB_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++resins;
    const std::string name = entry.path().stem().string();
    const Resin r = load_resin(entry.path().string());
    EXPECT_EQ(r.name, name);
    EXPECT_GT(r.absorbance_height10_um, 0);
    EXPECT_TRUE(r.has_gel_time() ? r.gel_a_mj_cm2 > 0 && r.gel_b_sqrt_mw_cm2_s > 0
                                 : r.critical_dose_mj_cm3 + r.critical_dose_prime > 0)
        << name;
    EXPECT_EQ(load_resin(name), r);
  }
  EXPECT_GE(printers, 1);
  EXPECT_GE(resins, 1);
}

using testing::ElementsAre;
using testing::IsEmpty;

TEST(UnreadWords, EachIsNamedWithItsLine) {
  EXPECT_THAT(parse_printer(kPrinter, "p.toml").unread.sentences, IsEmpty());
  EXPECT_THAT(parse_resin(kResin, "r.toml").unread.sentences, IsEmpty());
  const std::string slips =
      "speling = 3\n" + kPrinter +
      "travl_mm = 3\n[lamps.red]\nmin_share = 0.1\n[lamps.blue]\nmin_shar = 0.1\n";
  EXPECT_THAT(
      parse_printer(slips, "p.toml").unread.sentences,
      ElementsAre(
          "p.toml:1: speling: unknown key. It counts for nothing",
          "p.toml:15: stage.travl_mm: unknown key; did you mean 'travel_mm'? It counts for nothing",
          "p.toml:16: lamps.red: unknown table. It counts for nothing",
          "p.toml:19: lamps.blue.min_shar: unknown key; did you mean 'min_share'? It counts for nothing"));
  EXPECT_THAT(
      parse_resin("m = 2\n" + kResin, "r.toml").unread.sentences,
      ElementsAre(
          "r.toml:1: m: stands outside of its table; expected it under [cure] or [inhibition]. It "
          "counts for nothing"));
}

TEST(UnreadWords, AreManyOrOfAStranger) {
  std::string text = kResin;
  for (int i = 0; i < 25; ++i) text += "\n[x" + std::to_string(i) + "]\n";
  const auto told = parse_resin(text, "r.toml").unread.sentences;
  ASSERT_EQ(told.size(), 11U);
  EXPECT_EQ(told.back(), "r.toml: 15 more that are not known count for nothing, too");
  // What could move a terminal's cursor does not reach it.
  const auto harm = parse_resin(kResin + "\"a\\u001b[2J\" = 1\n", "r.toml").unread.sentences;
  EXPECT_THAT(harm, IsEmpty());  // [provenance] takes any word
  const auto named = parse_resin("\"a\\u001b[2J\" = 1\n" + kResin, "r.toml").unread.sentences;
  ASSERT_EQ(named.size(), 1U);
  EXPECT_EQ(named[0].find('\x1b'), std::string::npos);
  // It makes no other printer of it.
  EXPECT_EQ(parse_printer("speling = 3\n" + kPrinter, "p.toml"), parse_printer(kPrinter, "p.toml"));
}

}  // namespace
}  // namespace slicecorr
