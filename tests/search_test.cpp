// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Words that find resins, and which resins go with a printer.
#include "slicecorr/resins/search.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "database/toml_edit.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/same_light.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;

TEST(Search, CapitalsBlanksAndHyphensCountForNothing) {
  const std::vector<std::string> texts = {"Acme",    "ABS Like 3.0",       "grey",   "405 nm",
                                          "Tough-X", "DA-2 + 0.7 wt% PPO", "Ü-Resin"};
  for (const char* found : {"",
                            "  ",
                            "acme",
                            "ACM",
                            "abs-like",
                            "abslike",
                            "Abs_Like",
                            "abs like",
                            "gray",
                            "GREY",
                            "405nm",
                            "405",
                            "405-nm",
                            "tough x",
                            "toughx",
                            "da2",
                            "+",
                            "%",
                            "acme grey 405nm",
                            "Ü"}) {
    EXPECT_TRUE(words_occur(found, texts)) << found;
  }
  for (const char* not_found : {"abs-likes", "white", "grey white", "385", "tough-y", "*", "Ä",
                                // Words are looked for in one text each.
                                "acmeabs", "like405"}) {
    EXPECT_FALSE(words_occur(not_found, texts)) << not_found;
  }
  EXPECT_TRUE(words_occur("transparent", std::vector<std::string>{"Clear"}));
  EXPECT_TRUE(words_occur("clear", std::vector<std::string>{"semitransparent"}));
  EXPECT_FALSE(words_occur("x", std::vector<std::string>{}));
  EXPECT_EQ(words_in(" a  b\ta "), (std::vector<std::string>{"a", "b"}));
}

TEST(Search, AliasesTagsAndWavelengthAreSearched) {
  const ResinRecord r = parse_record(
      "name = \"r\"\naliases = [\"Super Goo\", \"SG-1\"]\ntags = [\"ABS-like\"]\n[cure]\n"
      "wavelength_nm = 405\nabsorbance_height_um = 100\nabsorbance_base = 10\n"
      "critical_dose_mj_cm3 = 100\n",
      "r.toml");
  EXPECT_EQ(r.aliases, (std::vector<std::string>{"Super Goo", "SG-1"}));
  EXPECT_TRUE(words_occur("supergoo sg1 abs-like 405nm", searched_texts(r)));
  EXPECT_FALSE(words_occur("385nm", searched_texts(r)));
}

TEST(Search, WhatHelpsWhereNothingIsFound) {
  const SearchHelp none = search_help("liqcreat-x grey");
  ASSERT_EQ(none.alone.size(), 2U);
  EXPECT_EQ(none.resins, 0U);
  EXPECT_EQ(none.alone[0], (std::pair<std::string, std::size_t>("liqcreat-x", 0)));
  EXPECT_THAT(none.near, ::testing::Contains("liqcreate"));
  EXPECT_EQ(none.printers, 0U);
  const SearchHelp maker = search_help("Elegoo");
  EXPECT_EQ(maker.resins, 0U);
  EXPECT_GE(maker.printers, 7U);
  const SearchHelp some = search_help("liqcreate black");
  EXPECT_EQ(some.resins, 2U);
  EXPECT_GE(some.alone[0].second, 14U);
  EXPECT_TRUE(search_help(" ").alone.empty());
}

// No fact is invented: each word of them stands in what the file says of maker, product and source.
TEST(Shipped, AliasesAndTagsSayNothingNew) {
  int files = 0, with = 0;
  for (const auto& entry : fs::directory_iterator(SLICECORR_DB_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++files;
    const ResinRecord r = load_record(entry.path().string());
    std::vector<std::string> said = {r.name, r.maker, r.product, r.chemistry, r.colour};
    for (const auto& [key, text] : r.provenance) said.push_back(text);
    std::vector<std::string> words = r.aliases;
    words.insert(words.end(), r.tags.begin(), r.tags.end());
    with += words.empty() ? 0 : 1;
    for (const std::string& word : words) EXPECT_TRUE(words_occur(word, said)) << r.name << word;
  }
  EXPECT_GE(files, 44);
  EXPECT_GE(with, 42);
}

TEST(Search, WhichResinsGoWithAPrinter) {
  const auto printer = [](double nm, const char* unit, const char* calibration) {
    return parse_display(
        fmt::format("name = \"p\"\n[display]\nwidth_px = 100\nheight_px = 80\npixel_um = 50.0\n"
                    "[blue]\n{}unit = \"{}\"\ncalibration = {}\n",
                    nm > 0 ? fmt::format("wavelength_nm = {}\n", nm) : "", unit, calibration),
        "p.toml");
  };
  const auto resin = [](double nm, const char* dose) {
    return parse_resin(fmt::format("name = \"r\"\n[cure]\n{}absorbance_height_um = 200\n"
                                   "absorbance_base = 10\n{}\n",
                                   nm > 0 ? fmt::format("wavelength_nm = {}\n", nm) : "", dose),
                       "r.toml");
  };
  constexpr const char *mw = "mW/cm2", *full = "of the brightest level";
  constexpr const char *lit = "[[0, 0.0], [255, 1.0]]", *unlit = "\"to be measured\"";
  constexpr const char *absolute = "gel_dose_mj_cm2 = 5.0",
                       *relative = "unit = \"of the brightest level\"\ncritical_dose_s = 0.8";
  const Printer at405 = printer(405, mw, lit);
  EXPECT_EQ(misfit(at405, resin(405, absolute)), std::nullopt);
  EXPECT_EQ(misfit(at405, resin(415, absolute)), std::nullopt);
  EXPECT_EQ(misfit(at405, resin(395, absolute)), std::nullopt);
  EXPECT_EQ(misfit(at405, resin(415.5, absolute)), Misfit::wavelength);
  EXPECT_EQ(misfit(at405, resin(385, relative)), Misfit::wavelength);
  EXPECT_EQ(misfit(at405, resin(405, relative)), Misfit::unit);
  EXPECT_EQ(misfit(printer(405, full, lit), resin(405, relative)), std::nullopt);
  EXPECT_EQ(misfit(printer(405, full, lit), resin(405, absolute)), Misfit::unit);
  // What one of the two does not say leaves nothing out.
  EXPECT_EQ(misfit(at405, resin(0, absolute)), std::nullopt);
  EXPECT_EQ(misfit(printer(0, mw, lit), resin(385, absolute)), std::nullopt);
  EXPECT_EQ(misfit(printer(0, mw, lit), resin(385, relative)), Misfit::unit);
  for (const char* dose : {absolute, relative}) {
    EXPECT_EQ(misfit(printer(405, mw, unlit), resin(405, dose)), std::nullopt);
    EXPECT_EQ(misfit(printer(405, mw, unlit), resin(385, dose)), Misfit::wavelength);
  }
  Resin tuned = resin(405, absolute);
  tuned.tuned_with = "q, 0 to 1 mW/cm2";
  EXPECT_EQ(misfit(at405, tuned), Misfit::tuned);
  EXPECT_EQ(misfit(printer(405, mw, unlit), tuned), std::nullopt);
  tuned.tuned_with = printer_and_light(at405);
  EXPECT_EQ(misfit(at405, tuned), std::nullopt);
}

}  // namespace
}  // namespace slicecorr::resins
