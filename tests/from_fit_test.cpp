// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin files made of fits.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/exchange.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

FitResult made_fit(FitModel model, const std::vector<std::pair<std::string, double>>& parameters) {
  FitResult fit;
  fit.model = model;
  for (const auto& [name, value] : parameters) {
    Parameter p;
    p.name = name;
    p.value = value;
    p.stderr_ = value / 100;
    fit.parameters.push_back(p);
  }
  const std::size_t n = parameters.size();
  fit.covariance.assign(n * n, 0);
  for (std::size_t i = 0; i < n; ++i) fit.covariance[i * n + i] = 0.25;
  fit.r2 = 0.985;
  fit.rmse_um = 12.3456;
  fit.n = 36;
  fit.sources = {"some/where/heights.csv"};
  return fit;
}
const FitResult kJacobs = made_fit(FitModel::jacobs, {{"h_um", 260}, {"dc_mj_cm2", 223}});
const FitResult kKinetic =
    made_fit(FitModel::kinetic, {{"h_um", 408}, {"m", 0.99}, {"critical_dose_prime", 64}});
const FitResult kSteady = made_fit(FitModel::dead_zone_steady, {{"beta", 0.73}, {"huv_um", 37.8}});
const FitResult kTransient =
    made_fit(FitModel::dead_zone_transient, {{"beta", 4.84}, {"huv_um", 100}, {"m", 1.29}});

/// Of the text, put beside an empty table of measurements so that names can be followed.
std::string wrong_with(const std::string& text, const std::string& name) {
  const fs::path folder =
      fs::path(testing::TempDir()) / ("slicecorr-fit-text-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "heights.csv") << "dose_mj_cm2,cured_height_um\n10,100\n20,200\n40,300\n";
  std::ofstream(folder / (name + ".toml")) << text;
  std::string all;
  for (const Finding& f : validate_definition((folder / (name + ".toml")).string())) {
    all += f.to_text() + "\n";
  }
  fs::remove_all(folder);
  return all;
}

TEST(TextFromFit, Jacobs) {
  const std::string text = record_text_from_fit("r", {kJacobs}, nullptr);
  EXPECT_EQ(wrong_with(text, "r"), "");
  const ResinFigures f = figures_of(parse_resin(text, "r.toml"));
  EXPECT_NEAR(f.height_e_um, 260, 1e-9);
  // Seven digits are written.
  EXPECT_NEAR(f.gel_mj_cm2, 223, 223e-7);
  EXPECT_NEAR(f.aim_mj_cm2, 5 * 223, 5 * 223e-7);
  EXPECT_THAT(text, HasSubstr("# Volumetric, of 223 mJ/cm² areal.\ngel_dose_mj_cm3 = "));
  EXPECT_THAT(text, HasSubstr("dose_factor = 5.0"));
  const ResinRecord r = parse_record(text, "r.toml");
  EXPECT_EQ(r.measurements, std::vector<std::string>{"heights.csv"});
  EXPECT_EQ(r.provenance.at("fit"), "jacobs: R² 0.985, RMSE 12.35 um, n 36");
  EXPECT_EQ(r.provenance.at("standard_errors"), "h_um 2.6, dc_mj_cm2 2.23");
  EXPECT_EQ(r.provenance.at("covariance"), "h_um, dc_mj_cm2: [[0.25, 0], [0, 0.25]]");
  EXPECT_EQ(text, record_text_from_fit("r", {kJacobs}, nullptr));
}

// What ended at a bound was not measured: no file, unless the bound was asked for, and then no variance.
TEST(TextFromFit, WhatEndedAtABoundIsNotWritten) {
  FitResult fit = kKinetic;
  fit.parameters[1].at_bound = true;
  const double unknown = std::nan("");
  for (const std::size_t i : {1, 3, 4, 5, 7}) fit.covariance[i] = unknown;
  try {
    record_text_from_fit("r", {fit}, nullptr);
    ADD_FAILURE() << "was written";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("m ended at its bound, 0.99"));
  }
  fit.parameters[1].bound_given = true;
  const std::string text = record_text_from_fit("r", {fit}, nullptr);
  EXPECT_THAT(text,
              HasSubstr("covariance = \"h_um, critical_dose_prime: [[0.25, 0], [0, 0.25]]\""));
  EXPECT_THAT(text, HasSubstr("m at its bound"));
  EXPECT_EQ(wrong_with(text, "r"), "");
  // As earlier versions wrote it.
  std::string old = text;
  old.replace(old.find("[[0.25"), 6, "[[nan");
  EXPECT_THAT(wrong_with(old, "r"), HasSubstr("provenance.covariance"));
}

TEST(TextFromFit, KineticWithDeadZones) {
  const std::string text = record_text_from_fit("r", {kKinetic, kSteady}, nullptr);
  EXPECT_EQ(wrong_with(text, "r"), "");
  const Resin r = parse_resin(text, "r.toml");
  const Kinetics k = make_kinetics(r, true, false);
  // The dissertation's Resin 1 gives back its dead zone.
  EXPECT_NEAR(steady_dead_zone_um(k, 100, 200), 15.766, 5e-4);
  EXPECT_EQ(k.m, 0.99);
  EXPECT_NEAR(k.critical_dose_prime, 64, 1e-9);
  EXPECT_NEAR(figures_of(r).aim_prime, 320, 1e-9);
  EXPECT_THAT(text, HasSubstr("dead_zone_fit = \"deadzone-steady"));
  const Resin t = parse_resin(record_text_from_fit("r", {kKinetic, kTransient}, nullptr), "r.toml");
  EXPECT_EQ(t.inhibition->m, 1.29);
  EXPECT_EQ(t.m, 0.99);
}

TEST(TextFromFit, Joint) {
  const FitResult joint = made_fit(FitModel::joint, {{"h_um", 1631},
                                                     {"m", 1.03},
                                                     {"critical_dose_prime", 238},
                                                     {"beta", 4.84},
                                                     {"huv_um", 100},
                                                     {"m_uv", 1.29}});
  const std::string text = record_text_from_fit("r", {joint}, nullptr);
  // The fit has one gel dose for both exponents: its reader is told what comes of it.
  EXPECT_THAT(wrong_with(text, "r"),
              HasSubstr("warning: inhibition.m: is 1.29, and 1.03 in [cure]"));
  const Resin r = parse_resin(text, "r.toml");
  EXPECT_EQ(r.m, 1.03);
  EXPECT_EQ(r.inhibition->m, 1.29);
  EXPECT_NEAR(steady_dead_zone_um(make_kinetics(r, true, false), 100, 100), 167.99, 5e-3);
}

TEST(TextFromFit, AFittedHeightTakesThePlaceOfAnAbsorption) {
  const std::string old =
      "name = \"old\"\nabsorption_per_cm = 0.8\nactive_absorption_per_cm = 0.4\n[cure]\n"
      "gel_dose_mj_cm3 = 20.0\n";
  const ResinRecord previous = parse_record(old, "old.toml");
  const std::string text = record_text_from_fit("new", {kJacobs}, &previous);
  EXPECT_EQ(wrong_with(text, "new"), "");
  EXPECT_THAT(text, Not(HasSubstr("absorption_per_cm = 0.8")));
  EXPECT_THAT(text, HasSubstr("active_absorption_per_cm = 0.4"));
  // The gel dose is that of what cures.
  const Resin r = parse_resin(text, "new.toml");
  const double areal = figures_of(r).gel_mj_cm2;
  EXPECT_NEAR(r.gel_dose_mj_cm3, .4 * areal, 1e-6 * areal);
  double fitted = 0;
  for (const auto& p : kJacobs.parameters) {
    if (p.name == "dc_mj_cm2") fitted = p.value;
  }
  EXPECT_NEAR(areal, fitted, 1e-6 * fitted);
}

TEST(TextFromFit, WordsAndCommentsOfTheRecordStay) {
  const std::string old =
      "# The blue one.\nname = \"old\"\nmaker = \"M\" # whose\n\n[cure]\nmodel = \"jacobs\"\n"
      "wavelength_nm = 405\nabsorbance_height_um = 2000.0 # once\nabsorbance_base = 10\n"
      "critical_dose_mj_cm3 = 576.0\n\n[composition]\na = 1.5\n\n[provenance]\n"
      "source = \"our lab\"\nplace = \"bench 3\"\n";
  const ResinRecord previous = parse_record(old, "old.toml");
  const std::string text = record_text_from_fit("new", {kKinetic}, &previous);
  EXPECT_EQ(wrong_with(text, "new"), "");
  for (const char* kept : {"# The blue one.", "maker = \"M\" # whose", "wavelength_nm = 405",
                           "# once", "a = 1.5", "source = \"our lab\"", "place = \"bench 3\""}) {
    EXPECT_THAT(text, HasSubstr(kept));
  }
  EXPECT_THAT(text, Not(HasSubstr("576")));
  const Resin r = parse_resin(text, "new.toml");
  EXPECT_EQ(r.name, "new");
  EXPECT_NEAR(figures_of(r).height_e_um, 408, 1e-9);
  // A factor that someone chose stays; a later Jacobs fit takes the kinetic figures away.
  ResinRecord chosen = parse_record(text, "new.toml");
  chosen.text.replace(chosen.text.find("dose_factor = 5.0"), 17, "dose_factor = 3.0");
  const std::string again = record_text_from_fit("new", {kJacobs}, &chosen);
  EXPECT_EQ(wrong_with(again, "new"), "");
  EXPECT_EQ(figures_of(parse_resin(again, "new.toml")).dose_factor, 3);
  EXPECT_THAT(again, Not(HasSubstr("critical_dose_prime")));
}

TEST(TextFromFit, DeadZonesOfARecordThatHasACure) {
  const ResinRecord previous =
      parse_record(record_text_from_fit("r", {kKinetic}, nullptr), "r.toml");
  const Resin r = parse_resin(record_text_from_fit("r", {kSteady}, &previous), "r.toml");
  EXPECT_EQ(r.m, 0.99);
  EXPECT_NEAR(r.inhibition->beta, 0.73, 1e-12);
  EXPECT_THROW(record_text_from_fit("r", {kSteady}, nullptr), InputError);
  EXPECT_THROW(record_text_from_fit("r", {}, nullptr), InputError);
  EXPECT_THROW(record_text_from_fit("R r", {kJacobs}, nullptr), InputError);
  EXPECT_THROW(record_text_from_fit("r", {made_fit(FitModel::jacobs, {{"h_um", NAN}})}, nullptr),
               InputError);
}

TEST(TextFromFit, MeasurementsThatOtherFitsStandOnStayNamed) {
  const fs::path folder =
      fs::path(testing::TempDir()) / ("slicecorr-fit-files-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "heights.csv") << "dose_mj_cm2,cured_height_um\n10,100\n20,200\n";
  std::ofstream(folder / "zones.csv")
      << "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n10,20,30,16\n";
  const auto source = [&](FitResult fit, const char* name) {
    fit.sources = {(folder / name).string()};
    return fit;
  };
  ResinRecord record =
      parse_record(record_text_from_fit("r", {source(kKinetic, "heights.csv")}, nullptr), "r.toml");
  record.path = (folder / "r.toml").string();
  const std::string both =
      record_text_from_fit("r", {source(kSteady, "zones.csv")}, &record, folder.string());
  EXPECT_THAT(both, HasSubstr("measurements = [\"heights.csv\", \"zones.csv\"]"));
  record = parse_record(both, record.path);
  // New heights stand in the place of the old ones.
  EXPECT_THAT(record_text_from_fit("r", {source(kKinetic, "new.csv")}, &record, folder.string()),
              HasSubstr("measurements = [\"zones.csv\", \"new.csv\"]"));
  fs::remove_all(folder);
}

TEST(TextFromFit, MeasurementsAreNamedFromTheFolderOfTheFile) {
  EXPECT_THAT(record_text_from_fit("r", {kJacobs}, nullptr, "some"),
              HasSubstr("measurements = [\"where/heights.csv\"]"));
  EXPECT_THAT(record_text_from_fit("r", {kJacobs}, nullptr, "other"),
              HasSubstr("measurements = [\"../some/where/heights.csv\"]"));
}

}  // namespace
}  // namespace slicecorr::resins
