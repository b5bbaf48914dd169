// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Definitions that are handed in: what goes along, what does not, and what is refused.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "database/toml_edit.hpp"
#include "exchange/personal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/measurements.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST(Personal, PathsAndAddresses) {
  for (const char* text :
       {"/home/jo/films.csv", "see \"/tmp/x\"", "from ~/goo.toml", "C:\\Users\\jo", "(d:/goo)",
        "\\\\server\\share", "file:///goo", "file=/srv/goo", "../goo.csv", "./goo", "/root"}) {
    EXPECT_THAT(path_or_address_in(text), HasSubstr("a path")) << text;
  }
  for (const char* text : {"jo@example.org", "Jo <jo.m+x@mail.example.org>", "by ü@example.de;",
                           "jo@lab-pc", "a@b.de", "x@y"}) {
    EXPECT_THAT(path_or_address_in(text), HasSubstr("an e-mail address")) << text;
  }
  for (const char* text :
       {"", "mW/cm²", "1 / 2", "and/or", "KB-101/104", "https://example.org/a/b?c=d",
        "github.com/umag/resinsim docs/kb", "PrusaSlicer @0.05", "resin@0.05", "Strong-X @0.05 mm",
        "a: /", "R² 0.99, n 12", "[[0, 1], [255, 4]]", "@example.org", "jo@", "5 µm",
        "at @50 um"}) {
    EXPECT_THAT(path_or_address_in(text), IsEmpty()) << text;
  }
}

TEST(Personal, Names) {
  const std::vector<std::string> names = {"", "jo", "root", "jmiller", "Jo Miller", "lab-pc"};
  for (const char* text : {"jmiller", "by JMiller.", "jmiller's films", "x-jmiller-2",
                           "films of Jo Miller", "on LAB-PC"}) {
    EXPECT_THAT(name_in(text, names), Not(IsEmpty())) << text;
  }
  for (const char* text : {"jo", "JO's films", "by jo", "(Jo)", "jo-2", "films of jo_"}) {
    EXPECT_EQ(name_in(text, names), "jo") << text;
  }
  EXPECT_EQ(name_in("films by k, dried", {"k"}), "k");
  EXPECT_EQ(name_in("Ed measured", {"in", "a", "ed"}), "ed");
  EXPECT_EQ(name_in("made in a lab, n = 12, 3 x 5 mm, x: 3", {"in", "a", "n", "x", "mm", "lab"}),
            "x");
  for (const char* text : {"in a lab, n = 12, n 12, 3 x 5 mm", "I did it"}) {
    EXPECT_THAT(name_in(text, {"in", "a", "n", "x", "mm", "lab", "i", "it"}), IsEmpty()) << text;
  }
  EXPECT_EQ(names_of_person("Jo M. Miller-Röß"),
            (std::vector<std::string>{"Jo M. Miller-Röß", "Jo", "Miller", "Röß"}));
  EXPECT_EQ(names_of_person(""), std::vector<std::string>{""});
  for (const char* text :
       {"", "joe", "root", "jmillers", "ajmiller", "banjo", "Miller", "lab pc"}) {
    EXPECT_THAT(name_in(text, names), IsEmpty()) << text;
  }
  EXPECT_THAT(name_in("raspberrypi and user", {"raspberrypi", "user"}), IsEmpty());
}

class Share : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("slicecorr-share-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string put(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return (folder_ / name).string();
  }
  /// What the refusal says.
  static std::string refusal(const std::string& path,
                             const std::vector<std::string>& names = {"jmiller"}) {
    const Shared made = share_definition(path, "", names);
    std::string text;
    for (const Finding& f : made.wrong) text += f.to_text() + "\n";
    EXPECT_TRUE(text.empty() || (made.text.empty() && made.attachments.empty()));
    return text.empty() ? "taken" : text;
  }
  fs::path folder_;
};

constexpr const char* kGoo =
    "# Of jmiller, /home/jmiller/goo.toml\nname = \"goo\" # mine\nversion = 7\nmaker = \"Acme\"\n"
    "product = \"Goo\"\ntags = [\"tough\", \"abs-like\"]\n[cure]\nwavelength_nm = 405\n"
    "absorbance_height_um = 170.25 # jmiller's\nabsorbance_base = \"e\"\ngel_dose_mj_cm2 = 5.1\n"
    "[provenance]\nsource = \"measured\"\nmeasured_with = \"calipers\"\ndate = 2026\n"
    "measurements = [\"films.csv\", \"and one by eye\"]\n\"wt %\" = 1e-3\nat = 2026-11-29\n";

TEST_F(Share, AResinWithItsMeasurements) {
  const std::string path = put("goo.toml", kGoo);
  put("films.csv",
      "# jmiller, /home/jmiller\nintensity_mw_cm2,exposure_s,cured_height_um,by,sigma_um\n"
      "3.3333333333333335,1,118.1,jmiller,\n3,2,236,jmiller,0.5 # jmiller\n");
  const Shared made = share_definition(path, "acme-goo", {"jmiller"});
  EXPECT_EQ(made.text,
            "name = \"acme-goo\"\nmaker = \"Acme\"\nproduct = \"Goo\"\n"
            "tags = [\"tough\", \"abs-like\"]\n\n[cure]\nwavelength_nm = 405\n"
            "absorbance_height_um = 170.25\nabsorbance_base = \"e\"\ngel_dose_mj_cm2 = 5.1\n\n"
            "[provenance]\nat = 2026-11-29\ndate = 2026\nmeasured_with = \"calipers\"\n"
            "measurements = [\"acme-goo.csv\", \"and one by eye\"]\nsource = \"measured\"\n"
            "\"wt %\" = 0.001\n");
  ASSERT_EQ(made.attachments.size(), 1U);
  EXPECT_EQ(made.attachments[0].stem + made.attachments[0].extension, "acme-goo.csv");
  EXPECT_EQ(made.attachments[0].bytes,
            "intensity_mw_cm2,exposure_s,cured_height_um,sigma_um\n"
            "3.3333333333333335,1,118.1,\n3,2,236,0.5\n");
  ASSERT_EQ(made.left_out.size(), 1U);
  EXPECT_THAT(made.left_out[0], AllOf(HasSubstr("films.csv"), HasSubstr("'by'")));
  // Where it lies with its measurements it passes.
  const std::string shared = put("acme-goo.toml", made.text);
  put("acme-goo.csv", made.attachments[0].bytes);
  EXPECT_THAT(validate_definition(shared), IsEmpty());
}

TEST_F(Share, MeasurementsOfAllKinds) {
  for (const char* table :
       {"dose_mj_cm2,cured_height_um\n10,118\n20,236\n",
        "intensity_mw_cm2,exposure_s,dose_mj_cm2,cured_height_um\n2,5,10,118\n4,5,20,236\n",
        "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um,sigma_um\n1,2,3,40,1\n1,3,3,50,\n"}) {
    const Measurements was = parse_measurements(table, "a.csv");
    const Measurements is = parse_measurements(measurements_as_csv(was), "b.csv");
    EXPECT_THAT(is.warnings, IsEmpty());
    ASSERT_EQ(is.cured.size(), was.cured.size());
    ASSERT_EQ(is.dead_zones.size(), was.dead_zones.size());
    for (std::size_t i = 0; i < was.cured.size(); ++i) {
      EXPECT_EQ(is.cured[i].blue_mw_cm2, was.cured[i].blue_mw_cm2);
      EXPECT_EQ(is.cured[i].exposure_s, was.cured[i].exposure_s);
      EXPECT_EQ(is.cured[i].dose_mj_cm2, was.cured[i].dose_mj_cm2);
      EXPECT_EQ(is.cured[i].height_um, was.cured[i].height_um);
    }
    for (std::size_t i = 0; i < was.dead_zones.size(); ++i) {
      EXPECT_EQ(is.dead_zones[i].uv_mw_cm2, was.dead_zones[i].uv_mw_cm2);
      EXPECT_EQ(is.dead_zones[i].dead_zone_um, was.dead_zones[i].dead_zone_um);
      EXPECT_EQ(is.dead_zones[i].sigma_um, was.dead_zones[i].sigma_um);
    }
  }
}

TEST_F(Share, WhatIsRefusedIsNamed) {
  std::string whole = kGoo;
  whole.replace(whole.find("[\"films.csv\", "), 14, "[");
  const auto with = [&](const char* table, const char* key, const char* value) {
    TomlEdit edit(whole, "goo.toml");
    *value ? edit.set(table, key, value) : edit.remove(table, key);
    return refusal(put("goo.toml", edit.text()));
  };
  EXPECT_EQ(refusal(put("goo.toml", whole)), "taken");
  const struct {
    const char *table, *key, *value, *says;
  } wrong[] = {
      {"", "maker", "", "maker: missing"},
      {"", "product", "\"  \"", "product: missing"},
      {"cure", "wavelength_nm", "", "cure.wavelength_nm: missing"},
      {"provenance", "source", "", "provenance.source: missing"},
      {"provenance", "measured_with", "", "provenance.measured_with: missing"},
      {"provenance", "measurements", "", "provenance.measurements: missing"},
      {"provenance", "date", "", "provenance.date: says no year"},
      {"provenance", "date", "\"last year\"", "provenance.date: says no year"},
      {"provenance", "date", "\"20261 films\"", "provenance.date: says no year"},
      {"provenance", "source", "\"/home/x/y.csv\"", "provenance.source: holds a path"},
      {"provenance", "source", "\"ask x@example.org\"", "holds an e-mail address"},
      {"provenance", "source", "\"by JMiller\"", "holds 'jmiller', the name of a user"},
      {"provenance", "of_jmiller", "1", "provenance.of_jmiller: holds 'jmiller'"},
      {"provenance", "lists", "[\"a\", \"~/b\"]", "provenance.lists: holds a path"},
      {"", "notes", "\"jmiller's\"", "notes: holds"},
      {"", "product", "\"mail x@example.org\"", "product: holds an e-mail address"},
      {"", "aliases", "[\"C:\\\\goo\"]", "aliases: holds a path"},
      {"provenance", "tuning", "\"tuned with p, 0 to 1 mW/cm2: ha, light, stray: [[1]]\"",
       "provenance.tuning: says that the resin was tuned"},
      {"cure", "colour", "\"grey\"", "cure.colour: unknown key"},
  };
  for (const auto& w : wrong) {
    EXPECT_THAT(with(w.table, w.key, w.value), HasSubstr(w.says)) << w.key << w.value;
  }
  for (const char* year : {"2026", "\"November 2026\"", "2026-11-29", "\"1999/2000\""}) {
    EXPECT_EQ(with("provenance", "date", year), "taken") << year;
  }
  // A maker may be called as a user is.
  EXPECT_EQ(with("", "maker", "\"JMiller\""), "taken");
  // All at once.
  EXPECT_THAT(refusal(put("goo.toml",
                          "name = \"goo\"\n[cure]\nabsorbance_height_um = 100\n"
                          "absorbance_base = 10\ngel_dose_mj_cm2 = 5\n")),
              AllOf(HasSubstr("maker: "), HasSubstr("wavelength_nm: "), HasSubstr("source: "),
                    HasSubstr("measured_with: "), HasSubstr("date: ")));
  EXPECT_THROW(share_definition(put("goo.toml", whole), "No Name", {}), InputError);
  EXPECT_THAT(refusal((folder_ / "none.toml").string()), HasSubstr("is not a file"));
  EXPECT_THAT(refusal(put("goo.toml", "x")), HasSubstr("is not TOML"));
}

TEST_F(Share, APrinterWithoutWhatIsOfOneMachine) {
  const std::string path = put(
      "mine.toml",
      "name = \"mine\" # secret\nmaker = \"Acme\"\nproduct = \"Box\"\n[display]\nwidth_px = 100\n"
      "height_px = 80\npixel_um = [50.0, 40.5]\nmirror = true\n[blue]\ncalibration = \"levels.csv\"\n"
      "[modbus]\nhost = \"lab-pc.example.org\"\nport = 1502\n[lamps.blue]\nmin_share = 0.02\n"
      "[provenance]\nsource = \"s\"\nmeasured_with = \"a meter\"\ndate = \"2026\"\n"
      "measurements = \"3 readings\"\n");
  put("levels.csv", "# lab-pc\ngrey_level,mw_cm2\n0,0\n128,0.7\n255,3.14159265358979\n");
  const Shared made = share_definition(path, "", {"lab-pc"});
  EXPECT_EQ(made.text,
            "name = \"mine\"\nmaker = \"Acme\"\nproduct = \"Box\"\n\n[display]\nwidth_px = 100\n"
            "height_px = 80\npixel_um = [50.0, 40.5]\nmirror = true\n\n[blue]\n"
            "calibration = [[0, 0], [128, 0.7], [255, 3.14159265358979]]\n\n[lamps.blue]\n"
            "min_share = 0.02\n\n[provenance]\ndate = \"2026\"\nmeasured_with = \"a meter\"\n"
            "measurements = \"3 readings\"\nsource = \"s\"\n");
  EXPECT_THAT(made.left_out, ::testing::ElementsAre(HasSubstr("[modbus]")));
}

/// What a file for others needs, where a shipped one does not have it.
std::string completed(const std::string& path, const std::string& kind) {
  TomlEdit edit(read_text_file(path), path);
  const auto need = [&](const char* table, const char* key, const char* value) {
    if (!edit.has(table, key)) edit.set(table, key, value);
  };
  for (const char* key : {"maker", "product"}) need("", key, "\"M\"");
  if (kind == "resin") need("cure", "wavelength_nm", "405");
  need("provenance", "measured_with", "\"a ruler\"");
  edit.set("provenance", "date", "2026");
  return edit.text();
}

// All that is shipped says the same when it was handed in, and handing it in again changes nothing.
TEST_F(Share, ShippedDefinitionsStayWhatTheyAre) {
  int seen = 0;
  for (const auto& [kind, from] :
       {std::pair{"resin", SLICECORR_DB_DIR}, {"printer", SLICECORR_PRINTERS_DIR}}) {
    for (const auto& entry : fs::directory_iterator(from)) {
      if (!entry.is_regular_file()) continue;
      if (entry.path().extension() != ".toml") {
        fs::copy_file(entry.path(), folder_ / entry.path().filename(),
                      fs::copy_options::skip_existing);
        continue;
      }
    }
    for (const auto& entry : fs::directory_iterator(from)) {
      if (entry.path().extension() != ".toml") continue;
      ++seen;
      const std::string name = entry.path().filename().string();
      const std::string path = put(name, completed(entry.path().string(), kind));
      const Shared made = share_definition(path, "", {});
      for (const Finding& f : made.wrong) ADD_FAILURE() << f.to_text();
      EXPECT_THAT(made.text, Not(HasSubstr("\n#"))) << name;
      for (const Attachment& a : made.attachments) put(a.stem + a.extension, a.bytes);
      const std::string was = read_text_file(path);
      const std::string again = put(name, made.text);
      EXPECT_EQ(share_definition(again, "", {}).text, made.text) << name;
      if (kind == std::string("resin")) {
        const auto json = [&](const std::string& text) {
          return nlohmann::json::parse(export_record(parse_record(text, path), "json", 0, 0));
        };
        auto old = json(was);
        old.erase("version");
        auto now = json(made.text);
        now.erase("version");
        EXPECT_EQ(now, old) << name;
      } else {
        const Printer old = parse_display(was, path), now = parse_display(made.text, path);
        ASSERT_EQ(now.calibration.size(), old.calibration.size()) << name;
        for (std::size_t i = 0; i < old.calibration.size(); ++i) {
          EXPECT_EQ(now.calibration[i].level, old.calibration[i].level);
          EXPECT_EQ(now.calibration[i].intensity_mw_cm2, old.calibration[i].intensity_mw_cm2);
        }
        EXPECT_EQ(now.pixel_y_um, old.pixel_y_um);
        EXPECT_EQ(now.max_speed_mm_h, old.max_speed_mm_h);
        EXPECT_EQ(now.wavelength_nm, old.wavelength_nm);
        EXPECT_EQ(now.uv.has_value(), old.uv.has_value());
        EXPECT_EQ(now.vial.has_value(), old.vial.has_value());
      }
    }
  }
  EXPECT_GE(seen, 44 + 47);
}

}  // namespace
}  // namespace slicecorr::resins
