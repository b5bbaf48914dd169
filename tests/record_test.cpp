// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Records, their figures in all units, and the checks of definition files.
#include "slicecorr/resins/record.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string kResinText = R"(name = "r"
[cure]
model = "kinetic"
m = 0.99
absorbance_height_um = 408.0
absorbance_base = "e"
critical_dose_prime = 64.0
dose_factor = 5.0
[inhibition]
beta = 0.73
absorbance_height_um = 37.8
absorbance_base = "e"
[provenance]
source = "table 3.1"
)";

class Files : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("slicecorr-record-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  fs::path folder_;
};

// --- Figures

TEST(Figures, ArealAndVolumetricBothBases) {
  // Dissertation: 50, 15, 65 mJ/cm² at 2000 um and 15 at 1500 um, base 10.
  for (const auto& [areal, height, volumetric] : {std::tuple{50.0, 2000.0, 575.65},
                                                  {15.0, 2000.0, 172.69},
                                                  {65.0, 2000.0, 748.34},
                                                  {15.0, 1500.0, 230.26}}) {
    Resin r;
    r.absorbance_height10_um = height;
    r.critical_dose_mj_cm3 = volumetric;
    const ResinFigures f = figures_of(r);
    EXPECT_NEAR(f.aim_mj_cm2, areal, areal * 0.005 / volumetric);
    EXPECT_DOUBLE_EQ(f.height_e_um * std::log(10.0), height);
    EXPECT_DOUBLE_EQ(f.aim_mj_cm3, volumetric);
    EXPECT_EQ(f.gel_mj_cm3, 0);
  }
}

TEST(Figures, KineticWithInhibition) {
  const ResinFigures f = figures_of(parse_record(kResinText, "r.toml").resin);
  EXPECT_NEAR(f.height_e_um, 408, 1e-9);
  EXPECT_NEAR(f.gel_prime, 64, 1e-12);
  EXPECT_NEAR(f.aim_prime, 320, 1e-12);
  EXPECT_NEAR(f.gel_prime_volumetric, 64 / std::pow(0.0408, 0.99), 1e-9);
  EXPECT_EQ(f.gel_mj_cm2, 0);  // intensity times time says nothing with m = 0.99
  EXPECT_NEAR(f.huv_e_um, 37.8, 1e-12);
  // betaV = betaA huv / hb: 6.76e-2 in the dissertation's table 4.1 with its fitted 0.73.
  EXPECT_NEAR(f.beta_volumetric, 0.73 * 37.8 / 408, 1e-12);
  EXPECT_EQ(f.dose_factor, 5);
}

TEST(Figures, AimIsGelDoseTimesFactorInEveryForm) {
  const std::string head = "[cure]\nabsorbance_height_um = 170\nabsorbance_base = \"e\"\n";
  const ResinFigures a = figures_of(parse_resin(head + "gel_dose_mj_cm2 = 5.0\n", "r.toml"));
  const ResinFigures b = figures_of(
      parse_resin(head + "gel_dose_mj_cm3 = " + std::to_string(5 / 0.017) + "\n", "r.toml"));
  const ResinFigures c = figures_of(parse_resin(
      head + "model = \"kinetic\"\ncritical_dose_prime = 5.0\ndose_factor = 5.0\n", "r.toml"));
  for (const ResinFigures& f : {a, b, c}) {
    EXPECT_NEAR(f.gel_mj_cm2, 5, 1e-6);
    EXPECT_NEAR(f.gel_mj_cm3, 5 / 0.017, 1e-4);
    EXPECT_NEAR(f.aim_mj_cm2, 25, 1e-5);
    EXPECT_NEAR(f.aim_prime, 25, 1e-5);
    EXPECT_NEAR(f.aim_prime_volumetric, f.aim_mj_cm3, 1e-9);
  }
}

// --- Records

TEST(Record, Words) {
  const ResinRecord r = parse_record(
      "name = \"r\"\nversion = 3\nmaker = \"M\"\nproduct = \"P\"\nchemistry = \"acrylate\"\n"
      "colour = \"red\"\nnotes = \"N\"\n[cure]\nwavelength_nm = 405\nabsorbance_height_um = 100\n"
      "absorbance_base = 10\ncritical_dose_mj_cm3 = 100\n[provenance]\nsource = \"S\"\n"
      "date = 2020-05-01\nscatter = 1.5\nmeasurements = [\"a.csv\", \"see page 3\", \"b.csv\"]\n",
      "r.toml");
  EXPECT_EQ(r.version, 3);
  EXPECT_EQ(r.maker + r.product + r.chemistry + r.colour + r.notes, "MPacrylateredN");
  EXPECT_EQ(r.wavelength_nm, 405);
  EXPECT_EQ(r.measurements, (std::vector<std::string>{"a.csv", "b.csv"}));
  EXPECT_EQ(r.provenance.at("date"), "2020-05-01");
  EXPECT_EQ(r.provenance.at("scatter"), "1.5");
  EXPECT_EQ(r.resin.critical_dose_mj_cm3, 100);
  EXPECT_THROW(parse_record("name = \"r\"\n", "r.toml"), InputError);
  EXPECT_THROW(load_record("no-such-resin"), InputError);
}

// --- Checks

struct Wrong {
  const char *line, *replacement;  ///< a line of kResinText and what stands there instead
  int at;                          ///< line that the finding names
  const char *key, *says;
  bool warning = false;
};

class OneThingWrong : public Files, public testing::WithParamInterface<Wrong> {};

TEST_P(OneThingWrong, IsFoundOnceWithItsLine) {
  const Wrong& w = GetParam();
  std::string text = kResinText;
  const std::size_t at = text.find(w.line);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, std::string(w.line).size(), w.replacement);
  const auto found = validate_definition(write("r.toml", text));
  ASSERT_EQ(found.size(), 1U) << [&] {
    std::string all;
    for (const Finding& f : found) all += f.to_text() + "\n";
    return all;
  }();
  EXPECT_EQ(found[0].line, w.at) << found[0].to_text();
  EXPECT_EQ(found[0].key, w.key);
  EXPECT_THAT(found[0].message, HasSubstr(w.says));
  EXPECT_EQ(found[0].warning, w.warning);
}

INSTANTIATE_TEST_SUITE_P(
    Resin, OneThingWrong,
    testing::Values(
        Wrong{"m = 0.99", "mm = 0.99", 4, "cure.mm", "did you mean 'm'?"},
        Wrong{"absorbance_base", "absorbence_base", 6, "cure.absorbence_base",
              "did you mean 'absorbance_base'?"},
        Wrong{"[provenance]", "[provenence]", 13, "provenence", "did you mean 'provenance'?"},
        Wrong{"[cure]", "wavelength_nm = 405\n[cure]", 2, "wavelength_nm",
              "under [cure] or [inhibition] or [chemistry]"},
        Wrong{"[cure]", "qwertz = 1\n[cure]", 2, "qwertz", "--schema"},
        Wrong{"[cure]", "version = 0\n[cure]", 2, "version", "expected 1 to"},
        Wrong{"[cure]", "maker = 5\n[cure]", 2, "maker", "text in quotes"},
        Wrong{"\"r\"", "\"R\"", 1, "name", "lower case"},
        Wrong{"\"r\"", "\"s\"", 1, "name", "the file is r.toml"},
        Wrong{"name = \"r\"\n", "", 0, "name", "missing", true},
        Wrong{"\"kinetic\"", "\"cubic\"", 3, "cure.model", "expected one of \"jacobs\""},
        Wrong{"m = 0.99", "m = 2.5", 4, "cure.m", "at most 2"},
        Wrong{"m = 0.99", "m = \"1\"", 4, "cure.m", "expected a number"},
        Wrong{"408.0", "-1", 5, "cure.absorbance_height_um", "above 0"},
        Wrong{"408.0", "nan", 5, "cure.absorbance_height_um", "above 0"},
        Wrong{"absorbance_base = \"e\"\ncritical", "absorbance_base = 2\ncritical", 6,
              "cure.absorbance_base", "10 or \"e\""},
        Wrong{"critical_dose_prime = 64.0\n", "", 2, "cure.critical_dose_prime", "missing"},
        Wrong{"dose_factor = 5.0", "dose_factor = 0.5", 8, "cure.dose_factor", "below the gel dose",
              true},
        Wrong{"dose_factor = 5.0", "gel_dose_mj_cm2 = 3", 8, "cure.gel_dose_mj_cm2",
              "does not count", true},
        Wrong{"beta = 0.73\n", "", 9, "inhibition.beta", "missing"},
        Wrong{"37.8", "500.0", 11, "inhibition.absorbance_height_um", "expected less than"},
        Wrong{"source = \"table 3.1\"", "source = { a = 1 }", 14, "provenance.source",
              "expected a text"},
        Wrong{"source = \"table 3.1\"", "measurements = [\"gone.csv\"]", 14,
              "provenance.measurements", "gone.csv is not there"},
        // 64/10^0.99 s without, 64/10^1.29 s with a trace of UV light.
        Wrong{"[provenance]", "m = 1.29\n[provenance]", 13, "inhibition.m",
              "gel after 3.28 s in place of 6.55 s", true},
        Wrong{"[provenance]", "[composition]\na = 60\nb = 50\n[provenance]", 13, "composition",
              "110 wt%"},
        Wrong{"[provenance]", "[composition]\na = 160\n[provenance]", 14, "composition.a",
              "at most 100"}));

TEST_F(Files, EverythingThatIsWrongIsFound) {
  const auto found = validate_definition(write("a.toml", R"(name = "b"
colour = 7
[cure]
model = "jacobs"
absorbance_height_um = -3
absorbance_base = 7
gel_dose_mj_cm3 = 1
gel_dose_mj_cm2 = 1
dose_facto = 2
)"));
  std::vector<std::string> keys;
  for (const Finding& f : found) keys.push_back(std::to_string(f.line) + " " + f.key);
  EXPECT_THAT(keys, testing::ElementsAre("1 name", "2 colour", "5 cure.absorbance_height_um",
                                         "6 cure.absorbance_base", "8 cure.gel_dose_mj_cm2",
                                         "9 cure.dose_facto"));
}

TEST_F(Files, GelDosesUnderUvLightThatBelongToTheirExponentAreFine) {
  const auto check = [&](const std::string& more) {
    std::string all;
    for (const Finding& f : validate_definition(
             write("r.toml",
                   "name = \"r\"\n[cure]\nmodel = \"kinetic\"\nm = 1.03\n"
                   "absorbance_height_um = 1631\nabsorbance_base = \"e\"\n"
                   "critical_dose_prime = 238\ndose_factor = 5\n[inhibition]\nbeta = 4.84\n"
                   "absorbance_height_um = 100\nabsorbance_base = \"e\"\n" +
                       more))) {
      all += f.to_text();
    }
    return all;
  };
  EXPECT_EQ(check(""), "");
  EXPECT_EQ(check("m = 1.03\n"), "");
  EXPECT_THAT(check("m = 1.29\n"), testing::HasSubstr("in place of"));
  // 238 100^0.26 = 788: the same time at 100 mW/cm², and a longer one below it.
  EXPECT_EQ(check("m = 1.29\ncritical_dose_prime = 788\n"), "");
  EXPECT_THAT(check("m = 1.29\ncritical_dose_prime = 500\n"), testing::HasSubstr("in place of"));
  // An exponent below that of the cure fails where light is weak.
  EXPECT_THAT(check("m = 0.7\ncritical_dose_prime = 52\n"), testing::HasSubstr("at 10 mW/cm²"));
}

TEST_F(Files, LightMayStandAtTheTop) {
  const std::string dose = "[cure]\ngel_dose_mj_cm3 = 20.0\n";
  const auto check = [&](const std::string& top, const std::string& cure = "") {
    std::string all;
    for (const Finding& f :
         validate_definition(write("r.toml", "name = \"r\"\n" + top + dose + cure))) {
      all += f.to_text().substr(f.to_text().rfind("r.toml")) + "\n";
    }
    return all;
  };
  EXPECT_EQ(check("absorption_per_cm = 0.8\nactive_absorption_per_cm = 0.4\nn = 1.5\n"), "");
  EXPECT_EQ(check("", "absorption_per_cm = 0.8\nn = 1.5\ninhibition_dose_mj_cm3 = 0\n"), "");
  EXPECT_EQ(check("n = 0.5\nabsorption_per_cm = 0.8\n"),
            "r.toml:2: n: is 0.5; expected a number of at least 1 and at most 3\n");
  EXPECT_EQ(
      check("n = 1.5\n"),
      "r.toml:3: cure.absorbance_height_um: missing; expected a number, or absorption_per_cm\n");
  EXPECT_EQ(check("absorbtion_per_cm = 0.8\nabsorption_per_cm = 0.8\n"),
            "r.toml:2: absorbtion_per_cm: unknown key; did you mean 'absorption_per_cm'?\n");
  EXPECT_EQ(
      check("absorption_per_cm = 0.8\nactive_absorption_per_cm = 0.9\n"),
      "r.toml:3: active_absorption_per_cm: is 0.9; expected at most the 0.8 per cm that absorb "
      "in all\n");
  EXPECT_EQ(
      check("absorption_per_cm = 0.8\n", "absorbance_height_um = 12000\nabsorbance_base = \"e\"\n"),
      "r.toml:2: absorption_per_cm: is 0.8, but the absorbance height of 12000 um in base e is "
      "0.83333 per cm; expected the same, or one of them\n");
  // What cures is what doses count: 25 mJ/cm² by 0.4 per cm are 10 mJ/cm³.
  EXPECT_EQ(check("absorption_per_cm = 0.8\nactive_absorption_per_cm = 0.4\n",
                  "critical_dose_mj_cm2 = 250\ndose_factor = 5\n"),
            "");
}

TEST_F(Files, TomographicPrinters) {
  const std::string display =
      "name = \"p\"\n[display]\nwidth_px = 128\nheight_px = 80\npixel_um = 50\n"
      "[blue]\ncalibration = [[0, 0.0], [255, 9.0]]\n";
  const std::string vial = "[vial]\nouter_mm = 3.0\ninner_mm = 2.5\n";
  const std::string optics = "[optics]\nkind = \"telecentric\"\n";
  const std::string rotation = "[rotation]\ndeg_s = 25\ndirection = \"clockwise\"\n";
  const auto check = [&](const std::string& text) {
    std::string all;
    for (const Finding& f : validate_definition(write("p.toml", display + text))) {
      all += f.to_text().substr(f.to_text().rfind("p.toml")) + "\n";
    }
    return all;
  };
  EXPECT_EQ(check(vial + optics + rotation), "");
  EXPECT_EQ(check(vial + optics + "half_angle_deg = 6\nrays_per_pixel = 13\n" + rotation), "");
  EXPECT_EQ(check(vial + rotation),
            "p.toml:8: warning: vial: is of no use without [optics]; expected [vial], [optics] and "
            "[rotation] together\n");
  EXPECT_THAT(check(vial + optics + "half_angle_deg = 6\n" + rotation),
              HasSubstr("p.toml:13: warning: optics.half_angle_deg: does not count with one ray"));
  EXPECT_THAT(check(vial + optics + "rays_per_pixel = 13\n" + rotation),
              HasSubstr("p.toml:13: warning: optics.rays_per_pixel: does not count without"));
  EXPECT_THAT(check(vial + optics + "[rotation]\ndeg_s = 25\n"),
              HasSubstr("p.toml:13: rotation.direction: missing; it is required"));
  EXPECT_THAT(check("[vial]\nouter_mm = 3.0\ninner_mm = 3.5\n" + optics + rotation),
              HasSubstr("p.toml:10: vial.inner_mm: is 3.5; expected less than outer_mm, 3"));
  EXPECT_THAT(check(vial + "n_wal = 1.5\n" + optics + rotation),
              HasSubstr("vial.n_wal: unknown key; did you mean 'n_wall'?"));
}

TEST_F(Files, DosesThatContradict) {
  const std::string head =
      "name = \"r\"\n[cure]\nabsorbance_height_um = 100\nabsorbance_base = \"e\"\n";
  const auto check = [&](const std::string& doses) {
    std::string all;
    for (const Finding& f : validate_definition(write("r.toml", head + doses))) {
      all += f.to_text() + "\n";
    }
    return all;
  };
  // 5 mJ/cm² over 100 um are 500 mJ/cm³.
  EXPECT_EQ(check("gel_dose_mj_cm2 = 5.0\ncritical_dose_mj_cm3 = 2500\ndose_factor = 5\n"), "");
  EXPECT_THAT(check("gel_dose_mj_cm2 = 5.0\ncritical_dose_mj_cm3 = 2000\ndose_factor = 5\n"),
              HasSubstr("r.toml:6: cure.critical_dose_mj_cm3: is 2000 mJ/cm³, but gel dose times "
                        "dose_factor is 2500"));
  EXPECT_THAT(check("gel_dose_mj_cm2 = 5.0\ncritical_dose_mj_cm3 = 400\n"),
              HasSubstr("below the gel dose of 500"));
  EXPECT_THAT(check("critical_dose_mj_cm3 = 400\ndose_factor = 5\n"), HasSubstr("does not count"));
  EXPECT_THAT(check("gel_dose_mj_cm3 = 5\ncritical_dose_prime = 3\n"), HasSubstr("kinetic"));
}

TEST_F(Files, HeightsInMillimetresAreAskedAfter) {
  const auto check = [&](const std::string& um) {
    return validate_definition(
        write("r.toml", "name = \"r\"\n[cure]\nabsorbance_height_um = " + um +
                            "\nabsorbance_base = \"10\"\ngel_dose_mj_cm3 = 5\n"));
  };
  EXPECT_THAT(check("5"), ::testing::IsEmpty());
  const auto found = check("0.2");
  ASSERT_EQ(found.size(), 1U);
  EXPECT_TRUE(found.front().warning);
  EXPECT_THAT(found.front().to_text(),
              HasSubstr("r.toml:3: warning: cure.absorbance_height_um: is 0.2 um, less than any "
                        "resin is known to have; is it 0.2 mm, which are 200 um?"));
}

TEST_F(Files, FilesThatAreNoDefinitions) {
  const auto only = [&](const std::string& path) {
    const auto found = validate_definition(path);
    EXPECT_EQ(found.size(), 1U) << path;
    return found.empty() ? std::string() : found[0].to_text();
  };
  EXPECT_THAT(only((folder_ / "gone.toml").string()), HasSubstr("is not a file"));
  EXPECT_THAT(only(folder_.string()), HasSubstr("is not a file"));
  EXPECT_THAT(only(write("a.toml", "")), HasSubstr("neither a resin"));
  EXPECT_THAT(only(write("a.toml", "name = \"a\"\nx = \n")), HasSubstr("a.toml:2: is not TOML"));
  EXPECT_THAT(only(write("a.toml", std::string("\x7F"
                                               "ELF\0\0\0",
                                               7))),
              HasSubstr("zero bytes"));
  EXPECT_THAT(only(write("a.toml", "name = \"\xFF\xFE\"\n")), HasSubstr("is not TOML"));
  EXPECT_THAT(only(write("a.toml", std::string(5U << 20, '#'))), HasSubstr("at most 4 MiB"));
}

const std::string kPrinterText = R"(name = "p"
[display]
width_px = 100
height_px = 50
pixel_um = 50.0
[blue]
calibration = [
  [0, 1.0],
  [255, 100.0],
]
)";

TEST_F(Files, Printers) {
  const auto check = [&](const std::string& from, const std::string& to) {
    std::string text = kPrinterText;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos);
    text.replace(at, from.size(), to);
    std::string all;
    for (const Finding& f : validate_definition(write("p.toml", text))) all += f.to_text() + "\n";
    return all;
  };
  EXPECT_EQ(check("x", "x"), "");
  EXPECT_THAT(check("width_px", "widht_px"), HasSubstr(":3: display.widht_px: unknown key; did you "
                                                       "mean 'width_px'?"));
  EXPECT_THAT(check("= 100\n", "= 0\n"), HasSubstr(":3: display.width_px: is 0; expected 1 to"));
  EXPECT_THAT(check("50.0", "[50.0, -1]"), HasSubstr(":5: display.pixel_um: is -1"));
  EXPECT_THAT(check("[0, 1.0]", "[0, 200.0]"), HasSubstr(":9: blue.calibration: point 2: the curve "
                                                         "must not fall"));
  EXPECT_THAT(check("[0, 1.0]", "[1, 1.0]"), HasSubstr("expected 0 to 255"));
  EXPECT_THAT(check("[0, 1.0]", "[0, \"a\"]"), HasSubstr(":8: blue.calibration: point 1"));
  EXPECT_THAT(check("pixel_um", "mirror = \"z\"\npixel_um"), HasSubstr("\"none\", \"x\", \"y\""));
  EXPECT_THAT(
      check("[blue]", "[uv]\nkind = \"spot\"\n[blue]"),
      testing::AllOf(HasSubstr("uv.kind: is 'spot'"), HasSubstr("uv.calibration: missing")));
  EXPECT_EQ(check("[blue]", "[modbus.registers]\nspeed = 7\n[blue]"), "");
}

TEST_F(Files, FlatFieldMustBeThereAndAsStated) {
  GreyImage image{2, 1, {100, 200}};
  const auto png = encode_png(image);
  write("even.png", {png.begin(), png.end()});
  const auto check = [&](const std::string& lines) {
    std::string text = kPrinterText;
    text.insert(text.find("[blue]"), lines);
    std::string all;
    for (const Finding& f : validate_definition(write("p.toml", text))) all += f.to_text() + "\n";
    return all;
  };
  EXPECT_EQ(check("flat_field = \"even.png\"\nflat_field_least = 0.5\nflat_field_mean = 0.75\n"),
            "");
  EXPECT_THAT(check("flat_field = \"even.png\"\nflat_field_least = 0.9\n"),
              HasSubstr(":7: display.flat_field_least: is 0.9, but even.png has 0.5000"));
  EXPECT_THAT(check("flat_field = \"gone.png\"\n"), HasSubstr(":6: display.flat_field"));
  write("even.png", "no image");
  EXPECT_THAT(check("flat_field = \"even.png\"\n"), HasSubstr("is no PNG image"));
}

TEST_F(Files, MeasurementsMustParse) {
  write("bad.csv", "a,b\n1,2\n");
  std::string text = kResinText + "measurements = [\"bad.csv\"]\n";
  const auto found = validate_definition(write("r.toml", text));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].line, 15);
  EXPECT_EQ(found[0].key, "provenance.measurements");
  EXPECT_THAT(found[0].message, HasSubstr("bad.csv"));
}

// --- What is shipped

std::vector<fs::path> shipped(const char* folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  return files;
}

TEST(Shipped, DefinitionsAreClean) {
  int files = 0;
  for (const char* folder : {SLICECORR_DB_DIR, SLICECORR_PRINTERS_DIR}) {
    for (const fs::path& path : shipped(folder)) {
      ++files;
      for (const Finding& f : validate_definition(path.string())) ADD_FAILURE() << f.to_text();
    }
  }
  EXPECT_GE(files, 40);
}

TEST(Shipped, EveryResinSaysWhereItComesFromAndWhatItAimsAt) {
  for (const fs::path& path : shipped(SLICECORR_DB_DIR)) {
    const ResinRecord r = load_record(path.string());
    EXPECT_FALSE(r.provenance.at("source").empty()) << path;
    EXPECT_TRUE(r.provenance.contains("measurements")) << path;
    const ResinFigures f = figures_of(r.resin);
    if (r.resin.has_gel_time()) continue;  // times, no doses
    EXPECT_GT(f.aim_prime, 0) << path;
    if (r.text.find("gel_dose") != std::string::npos || r.resin.m != 1.0) {
      // Measured resins aim at 5 gel doses, models of chemistry at the gel dose.
      EXPECT_EQ(f.dose_factor, r.resin.chemistry ? 1 : 5) << path;
    }
  }
}

TEST(Shipped, TheDissertationsResinsGiveItsCheckValues) {
  const auto of = [](const char* name) {
    return load_record((fs::path(SLICECORR_DB_DIR) / (std::string(name) + ".toml")).string()).resin;
  };
  const Resin one = of("custom-resin-1"), two = of("custom-resin-2");
  // Dead zone, first gel and front as physics.md lists them, to their last printed digit.
  const Kinetics a = make_kinetics(one, true, false);
  EXPECT_NEAR(steady_dead_zone_um(a, 100, 200), 15.766, 5e-4);
  EXPECT_NEAR(first_gel(a, 100, 200).z_um, 114.87, 5e-3);
  EXPECT_NEAR(first_gel(a, 100, 200).time_s, 0.97507, 5e-6);
  // The exponent that was refitted under UV light is not shipped: no gel dose goes with it.
  Kinetics b = make_kinetics(two, true, false);
  EXPECT_EQ(b.m, 1.03);
  EXPECT_NEAR(steady_dead_zone_um(b, 100, 100), 167.99, 5e-3);
  // A trace of UV light does not make it gel sooner: 238/100^1.03 s.
  EXPECT_NEAR(first_gel(b, 100, 1e-6).time_s, 2.0729, 5e-4);
  b.m = 1.29;
  EXPECT_NEAR(curing_fronts(b, 100, 100, 15)->front_um, 178.64, 5e-3);
  EXPECT_NEAR(cured_height_um(make_kinetics(one, false, false), 100, 10), 1113.9, 0.05);
  EXPECT_NEAR(cured_height_um(make_kinetics(two, false, false), 100, 10), 2491.9, 0.05);
  for (const auto& [name, prime, height, m] :
       {std::tuple{"makerjuice-standard-yellow", 67.0, 168.0, 0.99},
        {"formlabs-standard-clear", 148.0, 238.0, 0.91},
        {"cps-pr57-black", 117.0, 99.0, 1.07}}) {
    const ResinFigures f = figures_of(of(name));
    EXPECT_NEAR(f.gel_prime, prime, 1e-9) << name;
    EXPECT_NEAR(f.height_e_um, height, 1e-9) << name;
    EXPECT_EQ(of(name).m, m) << name;
  }
}

TEST(Shipped, PublishedCurvesAreThoseOfTheTable) {
  const std::string table = test::real_file("cure/resin_parameters.csv");
  SLICECORR_NEEDS_FILE(table);
  std::ifstream in(table);
  std::map<std::string, std::pair<double, double>> shipped_curves;
  for (const fs::path& path : shipped(SLICECORR_DB_DIR)) {
    const ResinRecord r = load_record(path.string());
    const ResinFigures f = figures_of(r.resin);
    shipped_curves[r.name] = {f.height_e_um, f.gel_mj_cm2};
  }
  int rows = 0;
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> cells;
    std::istringstream cut(line);
    for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
    if (line[0] == '#' || cells.size() < 4 || cells[1].empty() || cells[1] == "wavelength_nm" ||
        cells[3].empty()) {
      continue;
    }
    ++rows;
    const bool found =
        std::any_of(shipped_curves.begin(), shipped_curves.end(), [&](const auto& curve) {
          return curve.first.ends_with("-" + cells[1] + "nm") &&
                 std::abs(curve.second.first - std::stod(cells[2])) < 1e-9 &&
                 std::abs(curve.second.second - std::stod(cells[3])) < 1e-9;
        });
    EXPECT_TRUE(found) << line;
  }
  EXPECT_EQ(rows, 26);
}

TEST(Shipped, PrintersOfTheIssueAreThere) {
  const auto of = [](const char* name) {
    return load_printer(
        (fs::path(SLICECORR_PRINTERS_DIR) / (std::string(name) + ".toml")).string());
  };
  const Printer ember = of("ember"), sl1s = of("prusa-sl1s"), lcd = of("generic-lcd-gamma3");
  EXPECT_EQ(std::tuple(ember.width_px, ember.height_px, ember.pixel_x_um, ember.wavelength_nm),
            std::tuple(1280, 800, 50.0, 405.0));
  EXPECT_EQ(std::tuple(sl1s.width_px, sl1s.height_px, sl1s.pixel_x_um, sl1s.wavelength_nm),
            std::tuple(1620, 2560, 50.0, 405.0));
  // The LCD's points stand for 0.01 + 2.99 (level/255)^3 within 0.1 % at all 256 levels.
  std::size_t i = 0;
  for (int level = 0; level < 256; ++level) {
    while (lcd.calibration[i + 1].level < level) ++i;
    const CalibrationPoint &a = lcd.calibration[i], &b = lcd.calibration[i + 1];
    const double line = a.intensity_mw_cm2 + (b.intensity_mw_cm2 - a.intensity_mw_cm2) *
                                                 (level - a.level) / (b.level - a.level);
    const double law = 0.01 + 2.99 * std::pow(level / 255.0, 3);
    EXPECT_NEAR(line, law, 1e-3 * law) << level;
  }
}

}  // namespace
}  // namespace slicecorr::resins
