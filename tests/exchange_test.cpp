// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Definitions from and for other programs.
#include "slicecorr/resins/exchange.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

std::string refusal(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "nothing was refused";
}

class Exchange : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("slicecorr-exchange-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  /// What is wrong with a text that was made; nothing, one hopes.
  std::string wrong_with(const Imported& made) {
    for (const Attachment& a : made.attachments) write(a.stem + a.extension, a.bytes);
    std::string all;
    for (const Finding& f : validate_definition(write(made.name + ".toml", made.text))) {
      all += f.to_text() + "\n";
    }
    return all;
  }
  fs::path folder_;
};

// --- PrusaSlicer

/// Presets as the maker's bundle has them, of a resin that is known: exposure = tc e^(layer / h).
std::string bundle(double height_um, double critical_time_s) {
  std::string text =
      "# comment\n[vendor]\nname = V\n[sla_material:*common*]\nexposure_time = 99\n"
      "material_vendor = Maker\n[sla_material:*fine*]\ninherits = *common*\n"
      "material_colour = #112233\n";
  for (const double layer : {25.0, 50.0, 100.0}) {
    text += fmt::format(
        "[sla_material:Grey Goo @{:g} SL1S]\ninherits = *common*; *fine*\n"
        "compatible_prints_condition = layer_height == {:g}\nexposure_time = {:.17g}\n",
        layer / 1000, layer / 1000, critical_time_s * std::exp(layer / height_um));
  }
  return text + "[printer:P]\nexposure_time = 3\n";
}

TEST_F(Exchange, PrusaSlicerGivesBackTheResinThatMadeTheTimes) {
  const auto made = import_definitions(write("p.ini", bundle(180, 2.5)), {.intensity_mw_cm2 = 4});
  ASSERT_EQ(made.size(), 1U);
  EXPECT_EQ(made[0].name, "grey-goo-sl1s");
  EXPECT_EQ(wrong_with(made[0]), "");
  const ResinRecord r = parse_record(made[0].text, "grey-goo-sl1s.toml");
  const ResinFigures f = figures_of(r.resin);
  // Ten digits are written.
  EXPECT_NEAR(f.height_e_um, 180, 180e-9);
  EXPECT_NEAR(f.aim_mj_cm2, 10, 10e-9);
  EXPECT_EQ(f.gel_mj_cm3, 0);
  EXPECT_EQ(r.maker, "Maker");
  EXPECT_EQ(r.colour, "#112233");
  EXPECT_EQ(r.product, "Grey Goo");
  for (const std::string& a : made[0].assumptions) EXPECT_THAT(made[0].text, HasSubstr("# - " + a));
  EXPECT_THAT(made[0].text, AllOf(HasSubstr("upper bound of the gel dose"), HasSubstr("R² 1.000"),
                                  HasSubstr("4 mW/cm²")));
}

TEST_F(Exchange, ProfilesThatCannotGiveAHeight) {
  const std::string path = write(
      "p.ini",
      "[sla_material:One @0.05]\nexposure_time = 2\n"
      "[sla_material:Flat @0.05]\nexposure_time = 2\n[sla_material:Flat @0.1]\nexposure_time = 2\n"
      "[sla_material:None @0.05]\nmaterial_type = x\n"
      "[sla_material:Orphan @0.05]\ninherits = *gone*\nexposure_time = 3\n"
      "[sla_material:Good @0.05]\nexposure_time = 2\n[sla_material:Good @0.1]\nexposure_time = "
      "3\n");
  EXPECT_THAT(refusal([&] { import_definitions(path, {}); }), HasSubstr("--intensity-mw-cm2"));
  std::vector<std::string> left_out;
  ImportOptions options{.intensity_mw_cm2 = 3};
  EXPECT_EQ(import_definitions(path, options, &left_out).size(), 1U);
  EXPECT_THAT(left_out, testing::UnorderedElementsAre(
                            AllOf(HasSubstr("'One'"), HasSubstr("one layer height only (50 um)")),
                            AllOf(HasSubstr("'Flat'"), HasSubstr("don't rise")),
                            AllOf(HasSubstr("line 7"), HasSubstr("no exposure_time")),
                            AllOf(HasSubstr("'Orphan'"), HasSubstr("one layer height only"))));
  options.only = "One";
  EXPECT_THAT(refusal([&] { import_definitions(path, options); }), HasSubstr("--height-um"));
  options.height_um = 100;
  const auto made = import_definitions(path, options);
  ASSERT_EQ(made.size(), 1U);
  const ResinFigures f = figures_of(parse_resin(made[0].text, "one.toml"));
  EXPECT_NEAR(f.aim_mj_cm2, 3 * 2 * std::exp(-0.5), 1e-7);
  options.only = "Orphan";
  EXPECT_THAT(import_definitions(path, options)[0].text, HasSubstr("inherits '*gone*'"));
  const std::string circle = write("c.ini", "[sla_material:A]\ninherits = A\nexposure_time = 1\n");
  EXPECT_THAT(refusal([&] { import_definitions(circle, options = {.intensity_mw_cm2 = 1}); }),
              HasSubstr("line 1: preset 'A' inherits from itself"));
}

TEST_F(Exchange, TheMakersWholeBundle) {
  const fs::path data = test::real_file("profiles/PrusaResearchSLA_1.0.4.ini");
  SLICECORR_NEEDS_FILE(data.string());
  std::vector<std::string> left_out;
  const auto made = import_definitions(data.string(), {.intensity_mw_cm2 = 4}, &left_out);
  // 101 resins with three layer heights or more, one of which does not rise, and those with two.
  EXPECT_GE(made.size(), 100U);
  for (const Imported& m : made) {
    EXPECT_EQ(wrong_with(m), "");
    const ResinFigures f = figures_of(parse_resin(m.text, m.name));
    EXPECT_TRUE(f.height_e_um > 30 && f.height_e_um < 1000) << m.name << " " << f.height_e_um;
    EXPECT_TRUE(f.aim_mj_cm2 > 1 && f.aim_mj_cm2 < 500) << m.name << " " << f.aim_mj_cm2;
  }
  EXPECT_FALSE(left_out.empty());
}

// --- Other profiles

TEST_F(Exchange, KeysAndValues) {
  const ImportOptions options{.intensity_mw_cm2 = 3, .wavelength_nm = 405, .height_um = 200};
  const double expected = 3 * 2.5 * std::exp(-50.0 / 200);
  for (const char* text :
       {"[Profile]\nResinName = Goo\nBottomExposureTime = 30\nExposureTime = 2.5\nLayerHeight = "
        "0.05\n",
        "\xEF\xBB\xBFname: Goo\r\nLayer height: 0.05 mm\r\nExposure time: 2.5s\r\n",
        ";resin:Goo\n;layerHeight:0.05\n;normalExposureTime:2.5\n;bottomLayerExposureTime:30\n",
        "{\n \"resin\": \"Goo\",\n \"layerThickness\": \"50 um\",\n \"exposureTime\": \"2500 "
        "ms\"\n}\n"}) {
    const auto made = import_definitions(write("p.txt", text), options);
    ASSERT_EQ(made.size(), 1U) << text;
    EXPECT_EQ(made[0].name, "goo") << text;
    EXPECT_EQ(wrong_with(made[0]), "");
    const ResinRecord r = parse_record(made[0].text, "goo.toml");
    EXPECT_NEAR(figures_of(r.resin).aim_mj_cm2, expected, 1e-8) << text;
    EXPECT_EQ(r.wavelength_nm, 405);
  }
  const auto refused = [&](const std::string& text) {
    return refusal([&] { import_definitions(write("p.txt", text), options); });
  };
  EXPECT_THAT(refused("layerHeight = 0.05\n"), HasSubstr("has no exposure time"));
  EXPECT_THAT(refused("exposureTime = 2\n"), HasSubstr("has no layer height"));
  EXPECT_THAT(refused("a\nexposureTime = soon\n"), HasSubstr("line 2: exposureTime: is 'soon'"));
  EXPECT_THAT(refused("exposureTime = -1\n"), HasSubstr("above 0"));
  EXPECT_THAT(refused("exposureTime = 2 mm\n"), HasSubstr("is in mm"));
  EXPECT_THAT(refused("exposureTime = 2\nexposureTime = 3\n"), HasSubstr("a second exposure time"));
  EXPECT_THAT(refused("layerHeight = 50\n"), HasSubstr("at most 1 mm"));
  EXPECT_THAT(refused(std::string("PK\3\4", 4)), HasSubstr("is an archive"));
  EXPECT_THAT(refused(std::string("a\0b", 3)), HasSubstr("neither text"));
  EXPECT_THAT(refused(std::string(500000, 'x') + " = 1"), HasSubstr("has no"));
}

// --- Anycubic

std::string anycubic(const std::string& curve, const std::string& property) {
  return "{\"machine_extern\":{\"user_resins\":[{\"property\":{" + property +
         "},\"depth_penetration_curve\":" + curve + "}]}}";
}

TEST_F(Exchange, AnycubicCurve) {
  const std::string curve =
      R"({"light_intensity":9000.0,"safety_coefficient":1.6,"current_tempcurve_selector":-1,
      "temperature_coefficients":[{"temperature":10,"x_coefficient":184.27,"y_compensation":1675.8},
      {"temperature":25.0,"x_coefficient":197.78,"y_compensation":1803.2}]})";
  const std::string property =
      R"("name":"Goo@1","brand_name":"B","resin_name":"Goo","target_temperature":24.0)";
  const auto made = import_definitions(write("a.json", anycubic(curve, property)), {});
  ASSERT_EQ(made.size(), 1U);
  EXPECT_EQ(wrong_with(made[0]), "");
  const ResinFigures f = figures_of(parse_resin(made[0].text, "goo-1.toml"));
  EXPECT_NEAR(f.height_e_um, 197.78, 1e-9);
  // Depth 0: 197.78 ln(E) = 1803.2 with E in uJ/cm².
  EXPECT_NEAR(197.78 * std::log(f.gel_mj_cm2 * 1000), 1803.2, 1e-6);
  EXPECT_DOUBLE_EQ(f.dose_factor, 5);
  EXPECT_THAT(made[0].text, AllOf(HasSubstr("not verified"), HasSubstr("nearest to the target")));
  std::string selected = curve;
  selected.replace(selected.find("-1"), 2, "0");
  const auto cold = import_definitions(write("a.json", anycubic(selected, property)), {});
  EXPECT_NEAR(figures_of(parse_resin(cold[0].text, "goo-1.toml")).height_e_um, 184.27, 1e-9);
}

TEST_F(Exchange, AnycubicFilesThatAreWrong) {
  const auto refused = [&](const std::string& text) {
    return refusal([&] { import_definitions(write("a.json", text), {.format = "anycubic"}); });
  };
  EXPECT_THAT(refused("{\"a\": }"), HasSubstr("is not valid JSON"));
  EXPECT_THAT(refused("{}"), HasSubstr("nothing to import"));
  EXPECT_THAT(refused(anycubic("[[1,2]]", "")), HasSubstr("expected temperature_coefficients"));
  EXPECT_THAT(refused(anycubic("{\"temperature_coefficients\":[]}", "\"name\":\"n\"")),
              HasSubstr("has no temperature_coefficients"));
  EXPECT_THAT(refused(anycubic("{\"temperature_coefficients\":[{\"temperature\":1}]}", "")),
              HasSubstr("temperature_coefficients/0: has no number x_coefficient"));
  EXPECT_THAT(
      refused(anycubic(
          "{\"temperature_coefficients\":[{\"temperature\":1,\"x_coefficient\":0,\"y_compensation\":5}]}",
          "")),
      HasSubstr("which no resin has"));
}

// --- Tables, and round trips

TEST_F(Exchange, TableOfWorkingCurves) {
  const std::string path =
      write("t.csv",
            "# comment\nresin,wavelength_nm,Dp_um,Ec_mJ_cm2,confidence,source\n"
            "Goo,405,170,5.00,B,\"page 3, table \"\"2\"\"\"\nGoo,385,90,2.47,,\nDim,405,50,,,\n");
  std::vector<std::string> left_out;
  const auto made = import_definitions(path, {}, &left_out);
  ASSERT_EQ(made.size(), 2U);
  EXPECT_EQ(made[0].name, "goo-405nm");
  EXPECT_EQ(made[1].name, "goo-385nm");
  EXPECT_THAT(left_out, testing::ElementsAre(AllOf(HasSubstr("line 5"), HasSubstr("Ec_mJ_cm2"))));
  for (const Imported& m : made) EXPECT_EQ(wrong_with(m), "");
  const ResinRecord r = parse_record(made[0].text, "goo-405nm.toml");
  EXPECT_EQ(r.provenance.at("source"), "page 3, table \"2\"");
  EXPECT_EQ(r.provenance.at("confidence"), "B");
  EXPECT_NEAR(figures_of(r.resin).gel_mj_cm2, 5, 1e-12);
  EXPECT_NEAR(figures_of(r.resin).aim_mj_cm2, 25, 1e-11);
  const auto refused = [&](const std::string& text) {
    return refusal([&] { import_definitions(write("t.csv", text), {.format = "table"}); });
  };
  EXPECT_THAT(refused(""), HasSubstr("is empty"));
  EXPECT_THAT(refused("resin,a\n"), HasSubstr("no column dp_um"));
  EXPECT_THAT(refused("resin,dp_um,dp_um\n"), HasSubstr("stands twice"));
  EXPECT_THAT(refused("resin,dp_um,ec_mj_cm2\nx,1,2,3\n"), HasSubstr("line 2: has 4 cells"));
  EXPECT_THAT(refused("resin,dp_um,ec_mj_cm2\nx,ten,2\n"), HasSubstr("is 'ten'"));
  EXPECT_THAT(refused("resin,dp_um,ec_mj_cm2\nx,-1,2\n"), HasSubstr("above 0"));
  EXPECT_THAT(refused("resin,dp_um,ec_mj_cm2\nx,1,2\nX,3,4\n"), HasSubstr("the name 'x' twice"));
}

TEST_F(Exchange, MeasurementsAreNoResin) {
  const auto refused = [&](const char* header) {
    const std::string path = write("m.csv", header + std::string("\n255,1,120\n"));
    return refusal([&] { import_definitions(path, {}); });
  };
  EXPECT_THAT(refused("intensity_mw_cm2,exposure_s,cured_height_um"), HasSubstr("resinctl fit"));
  EXPECT_THAT(refused("level,exposure_s,thickness_um"), HasSubstr("resinctl calibrate"));
}

TEST_F(Exchange, LightOfAResinSurvivesExportAndImport) {
  const ResinRecord r = parse_record(
      "name = \"r\"\n[cure]\nwavelength_nm = 405\nabsorption_per_cm = 0.8\n"
      "active_absorption_per_cm = 0.4\nn = 1.49969\ninhibition_dose_mj_cm3 = 3\n"
      "inhibition_resupply_mj_cm3_s = 0.02\ndose_diffusion_m2_s = 5e-12\n"
      "scatter_um2_per_um = 1.5\nviscosity_pa_s = 0.3\ninhibitor_life_s = 0\ngel_dose_mj_cm3 = 20\n",
      "r.toml");
  const auto back = import_definitions(write("x.csv", export_record(r, "csv", 0, 0)), {});
  ASSERT_EQ(back.size(), 1U);
  EXPECT_EQ(wrong_with(back[0]), "");
  const Resin again = parse_resin(back[0].text, "r.toml");
  EXPECT_NEAR(absorption_per_cm(again), .8, 1e-9);
  EXPECT_EQ(again.active_absorption_per_cm, .4);
  EXPECT_EQ(again.n, 1.49969);
  EXPECT_EQ(again.inhibition_dose_mj_cm3, 3);
  EXPECT_EQ(again.inhibition_resupply_mj_cm3_s, .02);
  EXPECT_EQ(again.dose_diffusion_m2_s, 5e-12);
  EXPECT_EQ(again.scatter_um2_per_um, 1.5);
  EXPECT_EQ(again.viscosity_pa_s, 0.3);
  EXPECT_EQ(again.inhibitor_life_s, 0);
  EXPECT_NEAR(again.gel_dose_mj_cm3, 20, 1e-8);
}

TEST_F(Exchange, EveryShippedResinSurvivesExportAndImport) {
  int resins = 0;
  for (const auto& entry : fs::directory_iterator(SLICECORR_DB_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++resins;
    const ResinRecord r = load_record(entry.path().string());
    EXPECT_EQ(export_record(r, "toml", 0, 0), r.text);
    const auto back = import_definitions(write("x.csv", export_record(r, "csv", 0, 0)), {});
    ASSERT_EQ(back.size(), 1U) << r.name;
    EXPECT_EQ(wrong_with(back[0]), "");
    const ResinRecord b = parse_record(back[0].text, r.name + ".toml");
    EXPECT_EQ(b.name, r.name);
    EXPECT_EQ(b.wavelength_nm, r.wavelength_nm);
    EXPECT_EQ(b.resin.m, r.resin.m);
    const ResinFigures x = figures_of(r.resin), y = figures_of(b.resin);
    const auto same = [&](double one, double other) {
      EXPECT_NEAR(one, other, 1e-8 * one) << r.name;
    };
    same(x.height_e_um, y.height_e_um);
    same(x.gel_prime, y.gel_prime);
    same(x.aim_prime, y.aim_prime);
    same(x.aim_mj_cm3, y.aim_mj_cm3);
    same(x.beta, y.beta);
    EXPECT_EQ(b.resin.model == CureModelKind::gel_time, r.resin.has_gel_time());
    same(r.resin.gel_a_mj_cm2, b.resin.gel_a_mj_cm2);
    same(r.resin.gel_b_sqrt_mw_cm2_s, b.resin.gel_b_sqrt_mw_cm2_s);
    same(x.huv10_um, y.huv10_um);
    EXPECT_THAT(export_record(r, "json", 0, 0), HasSubstr("\"name\": \"" + r.name + "\""));
    EXPECT_THROW(export_record(r, "xml", 0, 0), InputError);
  }
  EXPECT_GE(resins, 37);
}

TEST_F(Exchange, PrusaSlicerTimesCureTheLayerToTheAim) {
  for (const char* name : {"liqcreate-premium-black-405nm", "formlabs-standard-clear"}) {
    const ResinRecord r =
        load_record((fs::path(SLICECORR_DB_DIR) / (std::string(name) + ".toml")).string());
    const std::string text = export_record(r, "prusaslicer", 50, 4);
    double seconds = 0;
    const std::size_t at = text.find("\nexposure_time = ");
    ASSERT_NE(at, std::string::npos);
    seconds = std::stod(text.substr(at + 17));
    const Kinetics k = make_kinetics(r.resin, false, true);
    // Four digits are written.
    EXPECT_NEAR(dose_prime_at(k, 4, 0, 50, seconds), k.critical_dose_prime,
                1e-3 * k.critical_dose_prime);
    EXPECT_THROW(export_record(r, "prusaslicer", 0, 4), InputError);
    EXPECT_THROW(export_record(r, "prusaslicer", 50, 0), InputError);
    EXPECT_THROW(export_record(r, "prusaslicer", 90000, 4), InfeasibleError);
  }
}

// --- Printers

std::string ember() { return (fs::path(SLICECORR_PRINTERS_DIR) / "ember.toml").string(); }

TEST_F(Exchange, CalibrationReplacesThatOfThePrinter) {
  const std::string path = write("c.csv", "grey,mW/cm2\n0,0.1\n128,5\n255,20.2\n255,19.8\n200,9\n");
  const auto made = import_definitions(path, {.name = "my-ember", .printer = ember()});
  ASSERT_EQ(made.size(), 1U);
  EXPECT_EQ(made[0].kind, "printer");
  EXPECT_EQ(wrong_with(made[0]), "");
  const Printer p = parse_printer(made[0].text, "my-ember.toml");
  EXPECT_EQ(p.name, "my-ember");
  EXPECT_EQ(p.width_px, 1280);
  EXPECT_EQ(p.calibration,
            (std::vector<CalibrationPoint>{{0, 0.1}, {128, 5}, {200, 9}, {255, 20}}));
  EXPECT_THAT(made[0].text, AllOf(HasSubstr("5 readings at 4 levels"), HasSubstr("averaged"),
                                  testing::Not(HasSubstr("a model printer"))));
  const auto refused = [&](const std::string& text, const std::string& printer) {
    return refusal([&] { import_definitions(write("c.csv", text), {.printer = printer}); });
  };
  EXPECT_THAT(refused("0,1\n255,2\n", ""), HasSubstr("--printer"));
  EXPECT_THAT(refused("0,1\n255,2\n", "no-such-printer"), HasSubstr("no-such-printer"));
  EXPECT_THAT(refused("10,1\n255,2\n", ember()), HasSubstr("no reading of black, level 0"));
  EXPECT_THAT(refused("0,1\n128,9\n255,5\n", ember()), HasSubstr("the curve falls"));
  EXPECT_THAT(refused("0,1\n255,-2\n", ember()), HasSubstr("at least 0"));
  EXPECT_THAT(refused("a,b\n0,x\n255,1\n", ember()), HasSubstr("is 'x'"));
  EXPECT_THAT(refused("a,b,c\n", ember()), HasSubstr("has 3 columns"));
  EXPECT_THAT(refused("0,1\n", ember()), HasSubstr("fewer than two"));
}

TEST_F(Exchange, ScatterOfAMeterIsSmoothedAndSaid) {
  // 10.1 and 9.9 become 10: isotonic least squares; 0.1 of 20 is within 2 %.
  const auto made =
      import_definitions(write("c.csv", "0,1\n100,10.1\n101,9.9\n255,20\n"), {.printer = ember()});
  const Printer p = parse_printer(made[0].text, "ember.toml");
  EXPECT_EQ(p.calibration[1].intensity_mw_cm2, 10);
  EXPECT_EQ(p.calibration[2].intensity_mw_cm2, 10);
  EXPECT_THAT(made[0].text, HasSubstr("greatest change 0.1 mW/cm²"));
}

/// 256 rows: one value each, or level and value.
std::string lookup_table(const std::string& header, bool with_levels,
                         const std::function<double(int)>& light) {
  std::string text = header;
  for (int level = 0; level < 256; ++level) {
    if (with_levels) text += std::to_string(level) + ",";
    text += fmt::format("{}\n", light(level));
  }
  return text;
}

TEST_F(Exchange, LookupTablesAreTheCalibrationLevelByLevel) {
  // Any curve that 7 digits hold: level²/1024.
  const auto light = [](int level) { return level * level / 1024.0; };
  for (const std::string header : {"", "light\n", "\xEF\xBB\xBF# from the maker\r\nlight\r\n"}) {
    for (const bool with_levels : {false, true}) {
      std::string first = header;
      if (with_levels) {
        if (const auto at = first.find("light"); at != std::string::npos) {
          first.insert(at, "level,");
        }
      }
      const std::string path = write("curve.csv", lookup_table(first, with_levels, light));
      for (const char* format : {"lut", "auto"}) {
        const auto made =
            import_definitions(path, {.format = format, .name = "p", .printer = ember()});
        EXPECT_EQ(wrong_with(made[0]), "");
        const Printer p = parse_printer(made[0].text, "p.toml");
        ASSERT_EQ(p.calibration.size(), 256U);
        for (int level = 0; level < 256; ++level) {
          const auto& point = p.calibration[static_cast<std::size_t>(level)];
          EXPECT_EQ(point.level, level);
          EXPECT_NEAR(point.intensity_mw_cm2, light(level), 5e-7 * light(level));
        }
      }
    }
  }
  // The ending says it, too.
  EXPECT_EQ(
      import_definitions(write("curve.lut", lookup_table("", false, light)), {.printer = ember()})
          .size(),
      1U);
}

TEST_F(Exchange, RelativeLookupTablesNeedTheFullLight) {
  const std::string path =
      write("curve.csv", lookup_table("", false, [](int level) { return level; }));
  const auto made = import_definitions(path, {.intensity_mw_cm2 = 51, .printer = ember()});
  const Printer p = parse_printer(made[0].text, "ember.toml");
  EXPECT_EQ(p.calibration[255].intensity_mw_cm2, 51);
  EXPECT_EQ(p.calibration[5].intensity_mw_cm2, 1);
  EXPECT_THAT(made[0].text, HasSubstr("greatest value, 255, was taken for the 51 mW/cm²"));
  EXPECT_THAT(refusal([&] {
                import_definitions(write("d.csv", lookup_table("", false, [](int) { return 0; })),
                                   {.intensity_mw_cm2 = 51, .printer = ember()});
              }),
              HasSubstr("dark at every level"));
}

TEST_F(Exchange, LookupTablesAreRefusedByTheirLine) {
  const auto rising = [](int level) { return 0.1 * level; };
  const auto refused = [&](const std::string& text) {
    return refusal(
        [&] { import_definitions(write("c.csv", text), {.format = "lut", .printer = ember()}); });
  };
  const std::string good = lookup_table("light\n", false, rising);
  const std::string both = lookup_table("level,light\n", true, rising);
  const auto with = [](std::string text, const std::string& what, const std::string& instead) {
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return text.replace(at, what.size(), instead);
  };
  EXPECT_THAT(refused(good + "25.6\n"),
              AllOf(HasSubstr("line 258"), HasSubstr("too many"), HasSubstr("expected 256")));
  EXPECT_THAT(refused(good.substr(0, good.rfind("25.5"))),
              AllOf(HasSubstr("line 256"), HasSubstr("ends at level 254"), HasSubstr("256 rows")));
  EXPECT_THAT(refused("light\n"), HasSubstr("256 rows"));
  EXPECT_THAT(refused(with(good, "\n12.5\n", "\nnan\n")),
              AllOf(HasSubstr("line 127"), HasSubstr("'nan'")));
  EXPECT_THAT(refused(with(good, "\n12.5\n", "\ninf\n")), HasSubstr("'inf'"));
  EXPECT_THAT(refused(with(good, "\n12.5\n", "\n1e999\n")), HasSubstr("'1e999'"));
  EXPECT_THAT(refused(with(good, "\n12.5\n", "\n-1\n")),
              AllOf(HasSubstr("line 127"), HasSubstr("at least 0")));
  EXPECT_THAT(refused(with(good, "\n12.5\n", "\n20\n")),
              AllOf(HasSubstr("line 127"), HasSubstr("falls"), HasSubstr("level 125")));
  EXPECT_THAT(refused(with(both, "\n125,", "\n126,")),
              AllOf(HasSubstr("line 127"), HasSubstr("is level 126; expected 125")));
  EXPECT_THAT(refused(with(both, "\n125,12.5\n", "\n")), HasSubstr("is level 126; expected 125"));
  EXPECT_THAT(refused(with(both, "\n125,12.5\n", "\n125,\n")),
              AllOf(HasSubstr("line 127"), HasSubstr("is empty")));
  EXPECT_THAT(refused(with(both, "\n125,", "\n125.5,")), HasSubstr("is level 125.5"));
  EXPECT_THAT(refused("a,b,c\n1,2,3\n"), HasSubstr("has 3 columns"));
  EXPECT_THAT(refusal([&] {
                import_definitions(write("c.csv", good),
                                   {.format = "uv-calibration", .printer = ember()});
              }),
              HasSubstr("has 1 column; expected two"));
  // Of a display of 4 bits, 16 rows.
  const std::string ember4 =
      write("ember4.toml",
            "name = \"ember4\"\n[display]\nwidth_px = 16\nheight_px = 16\npixel_um = 50\nbit_depth "
            "= 4\n[blue]\ncalibration = [[0, 0], [15, 9]]\n");
  EXPECT_THAT(refusal([&] { import_definitions(write("c.csv", good), {.printer = ember4}); }),
              AllOf(HasSubstr("line 18"), HasSubstr("expected 16")));
}

TEST_F(Exchange, CalibrationsMayBeginWithAPointOfEqualNumbers) {
  const auto made = import_definitions(write("c.csv", "0,0\n255,20\n"), {.printer = ember()});
  EXPECT_EQ(parse_printer(made[0].text, "ember.toml").calibration,
            (std::vector<CalibrationPoint>{{0, 0}, {255, 20}}));
}

TEST_F(Exchange, ReadingsOfAUvMeterAsJson) {
  // What the firmware of the SL1 writes with its meter of 15 sensors: 3 rows of 5.
  const auto readings = [](const std::string& values, const std::string& type = "0") {
    return "{\n  \"uvDateTime\": \"14.10.2019 12:11:43\",\n  \"uvFoundPwm\": 210,\n"
           "  \"uvSensorData\": [" +
           values + "],\n  \"uvSensorType\": " + type + "\n}\n";
  };
  std::string fifteen;
  for (int i = 1; i <= 15; ++i) fifteen += fmt::format("{}{}", i > 1 ? ", " : "", i * 17.0);
  const auto made = import_definitions(write("uv.json", readings(fifteen)), {.printer = ember()});
  EXPECT_EQ(wrong_with(made[0]), "");
  EXPECT_THAT(made[0].text,
              AllOf(HasSubstr("15 sensors of the printer's UV meter, 3 rows of 5"),
                    HasSubstr("flat_field_least = 0.06667"), HasSubstr("flat_field_mean = 0.5333"),
                    HasSubstr("uv.json, 5 x 3 values")));
  ASSERT_EQ(made[0].attachments.size(), 1U);
  const std::string& png = made[0].attachments[0].bytes;
  const GreyImage image = decode_png({png.begin(), png.end()}, 5, 3, "made", "flat-field");
  for (std::size_t i = 0; i < 15; ++i) EXPECT_EQ(image.pixels[i], 17 * (i + 1));
  // TOML has them, too, and JSON those of 60.
  EXPECT_EQ(import_definitions(write("uv.toml", "uvSensorData = [" + fifteen + "]\n"),
                               {.printer = ember()})[0]
                .attachments[0]
                .bytes,
            png);
  std::string sixty;
  for (int i = 1; i <= 60; ++i) sixty += fmt::format("{}{}", i > 1 ? ", " : "", i);
  EXPECT_THAT(import_definitions(write("uv.json", readings(sixty)), {.printer = ember()})[0].text,
              HasSubstr("60 sensors of the printer's UV meter, 6 rows of 10"));
  const auto refused = [&](const std::string& text) {
    return refusal([&] { import_definitions(write("uv.json", text), {.printer = ember()}); });
  };
  EXPECT_THAT(refused(readings("1, 2, 3")), AllOf(HasSubstr("has 3 numbers"), HasSubstr("15")));
  EXPECT_THAT(refused(readings(fifteen + ", 9")), HasSubstr("has 16 numbers"));
  EXPECT_THAT(refused(readings("1, null" + fifteen.substr(6))), HasSubstr("uvSensorData[1]"));
  EXPECT_THAT(refused(readings("1, \"2\"" + fifteen.substr(6))), HasSubstr("uvSensorData[1]"));
  EXPECT_THAT(refused(readings("-1" + fifteen.substr(2))), HasSubstr("uvSensorData[0]"));
  EXPECT_THAT(refused(readings("1e999" + fifteen.substr(2))), HasSubstr("is not valid JSON"));
  EXPECT_THAT(refused(readings("NaN" + fifteen.substr(2))), HasSubstr("is not valid JSON"));
  EXPECT_THAT(refused(readings(fifteen, "1")), HasSubstr("uvSensorType: is 1"));
  EXPECT_THAT(refused("{\"uvSensorData\": null}"), HasSubstr("is no list"));
  EXPECT_THAT(refused(readings(fifteen).substr(0, 80)), HasSubstr("is not valid JSON"));
  std::string dark = "0";
  for (int i = 1; i < 15; ++i) dark += ", 0";
  EXPECT_THAT(refused(readings(dark)), HasSubstr("is black"));
}

TEST_F(Exchange, FlatFields) {
  const auto bytes = encode_png({2, 2, {200, 100, 150, 150}});
  const std::string png = write("f.png", {bytes.begin(), bytes.end()});
  const auto flat = import_definitions(png, {.printer = ember()});
  ASSERT_EQ(flat[0].attachments.size(), 1U);
  EXPECT_EQ(wrong_with(flat[0]), "");
  EXPECT_THAT(flat[0].text,
              AllOf(HasSubstr("flat_field_least = 0.5\n"), HasSubstr("flat_field_mean = 0.75\n"),
                    HasSubstr("flat_field_reference")));
  EXPECT_EQ(flat[0].attachments[0].bytes, std::string(bytes.begin(), bytes.end()));
  const auto mask = import_definitions(png, {.format = "correction-mask", .printer = ember()});
  EXPECT_EQ(wrong_with(mask[0]), "");
  // 100 / (200, 100, 150, 150): 0.5, 1, 2/3, 2/3, in steps of 1/255.
  EXPECT_THAT(mask[0].text, HasSubstr("flat_field_least = 0.502"));
  EXPECT_THAT(mask[0].text, HasSubstr("flat_field_mean = 0.7088"));
  const auto black = encode_png({1, 1, {0}});
  const std::string none = write("n.png", {black.begin(), black.end()});
  EXPECT_THAT(refusal([&] { import_definitions(none, {.printer = ember()}); }),
              HasSubstr("is black"));
  EXPECT_THAT(
      refusal([&] { import_definitions(none, {.format = "correction-mask", .printer = ember()}); }),
      HasSubstr("black"));
  EXPECT_THAT(refusal([&] { import_definitions(png, {}); }), HasSubstr("--printer"));
}

TEST_F(Exchange, RealFlatFields) {
  const fs::path data = test::real_file("projector");
  SLICECORR_NEEDS_FILE(data.string());
  const auto sl1 =
      import_definitions((data / "sl1_uv_calibration_60pt.toml").string(), {.printer = ember()});
  EXPECT_EQ(wrong_with(sl1[0]), "");
  // Least 106, greatest 171, mean of the 60 values 143.28: 0.6199 and 0.8379, in steps of 1/255.
  EXPECT_THAT(sl1[0].text,
              AllOf(HasSubstr("flat_field_least = 0.6196"), HasSubstr("flat_field_mean = 0.837")));
  const auto mask = import_definitions((data / "nordin_graycorr_20241202-XU19030146.png").string(),
                                       {.format = "correction-mask", .printer = ember()});
  EXPECT_EQ(wrong_with(mask[0]), "");
  EXPECT_THAT(mask[0].text, HasSubstr("2560 x 1600 values"));
  // Across a portrait display it can only be a map of the plate.
  const auto portrait = import_definitions((data / "sl1_uv_calibration_60pt.toml").string(),
                                           {.printer = SLICECORR_PRINTERS_DIR "/prusa-sl1s.toml"});
  EXPECT_EQ(wrong_with(portrait[0]), "");
  EXPECT_THAT(portrait[0].text, HasSubstr("flat_field_frame = \"plate\""));
  const auto square = encode_png(GreyImage{100, 100, std::vector<std::uint8_t>(10000, 200)});
  const std::string file = write("square.png", {square.begin(), square.end()});
  EXPECT_THAT(refusal([&] { import_definitions(file, {.printer = ember()}); }),
              HasSubstr("in the shape of the display"));
}

}  // namespace
}  // namespace slicecorr::resins
