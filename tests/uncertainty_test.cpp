// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What users say of errors, and what a fit says.
#include "slicecorr/uncertainty.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

Uncertainty parsed(const std::string& text, const ResinText& resin = {},
                   ExposureMode mode = ExposureMode::continuous) {
  return parse_uncertainty(text, mode, 100, resin);
}

std::string refusal(const std::string& text, const ResinText& resin = {},
                    ExposureMode mode = ExposureMode::continuous) {
  try {
    parsed(text, resin, mode);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

ResinText fitted(const std::string& covariance) {
  return {
      "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nm = 1.0\nabsorbance_height_um = 868.6\n"
      "absorbance_base = \"e\"\ngel_dose_mj_cm3 = 115.127\ndose_factor = 5.0\n"
      "[provenance]\ncovariance = \"" +
          covariance + "\"\n",
      "r.toml"};
}

TEST(Uncertainty, NumbersByHand) {
  const Uncertainty u =
      parsed("ha=8%, dc=10%,light=3% ,speed=1%,stray=0.2,m=0.02,flat=2%,noise=1%");
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::ha), 0.08);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::dc), 0.10);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::light), 0.03);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::speed), 0.01);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::stray), 0.2);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::m), 0.02);
  EXPECT_EQ(u.sd(UncertainInput::aim), 0);
  EXPECT_DOUBLE_EQ(u.flat, 0.02);
  EXPECT_DOUBLE_EQ(u.noise, 0.01);
  EXPECT_EQ(u.variance(UncertainInput::ha, UncertainInput::dc), 0);
  EXPECT_EQ(u.reference_mw_cm2, 100);
  EXPECT_FALSE(u.from_fit);
}

TEST(Uncertainty, WhatCannotBeIsRefused) {
  EXPECT_THAT(refusal("ha=8%,ha=9%"), HasSubstr("ha is given twice"));
  EXPECT_THAT(refusal("ha=31%"), HasSubstr("at most 30 %"));
  EXPECT_THAT(refusal("ha=0.08"), HasSubstr("in %"));
  EXPECT_THAT(refusal("m=2%"), HasSubstr("without %"));
  EXPECT_THAT(refusal("ha=-3%"), HasSubstr("above 0"));
  EXPECT_THAT(refusal("ha=nan%"), HasSubstr("above 0"));
  EXPECT_THAT(refusal("ligth=3%"), HasSubstr("did you mean light"));
  EXPECT_THAT(refusal("ha"), HasSubstr("has no number"));
  EXPECT_THAT(refusal(""), HasSubstr("no input"));
  EXPECT_THAT(refusal("time=3%"), HasSubstr("expected speed"));
  EXPECT_THAT(refusal("speed=3%", {}, ExposureMode::layerwise), HasSubstr("expected time"));
  EXPECT_THAT(refusal("fit"), HasSubstr("resin's file, which is not given"));
  EXPECT_THAT(refusal("fit", {"name = \"r\"\n[cure]\ncritical_dose_mj_cm3 = 5\n"
                              "absorbance_height_um = 500\n",
                              "r.toml"}),
              testing::AllOf(HasSubstr("r.toml"), HasSubstr("by hand: ha=8%")));
}

// Six doses from 1.5 to 9 gel doses: correlation 0.90492 of ln ha and ln Dc.
TEST(Uncertainty, FitIsReadAsItsCovariance) {
  // 868.6 um, sd 1 %; areal dose 115.127 mJ/cm³ times 0.08686 cm = 10 mJ/cm², sd 1.43806 %.
  const double h = 8.686, d = 0.143806;
  const auto text = [&](double correlation) {
    return "h_um, dc_mj_cm2: [[" + std::to_string(h * h) + ", " +
           std::to_string(correlation * h * d) + "], [" + std::to_string(correlation * h * d) +
           ", " + std::to_string(d * d) + "]]";
  };
  const Uncertainty u = parsed("fit,light=0.6%,speed=0.2%", fitted(text(0.90492)));
  EXPECT_TRUE(u.from_fit);
  // Written with six decimals.
  EXPECT_NEAR(u.sd(UncertainInput::ha), 0.01, 1e-7);
  EXPECT_NEAR(u.sd(UncertainInput::dc), 0.0143806, 1e-6);
  EXPECT_NEAR(u.variance(UncertainInput::ha, UncertainInput::dc), 0.90492 * 0.01 * 0.0143806, 1e-8);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::light), 0.006);
  EXPECT_EQ(u.reference_mw_cm2, 1);
  EXPECT_THAT(refusal("fit,ha=3%", fitted(text(0.9))), HasSubstr("ha is given twice"));
  EXPECT_THAT(refusal("fit", fitted(text(1.2))),
              testing::AllOf(HasSubstr("ha and dc"), HasSubstr("eigenvalue")));
  EXPECT_THAT(refusal("fit", fitted("h_um, dc_mj_cm2: [[75, 1], [2, 0.02]]")),
              testing::AllOf(HasSubstr("ha and dc"), HasSubstr("symmetric")));
  EXPECT_THAT(refusal("fit", fitted("h_um, dc_mj_cm2: [[75, 1], [2]]")),
              HasSubstr("2 names and 3"));
  EXPECT_THAT(refusal("fit", fitted("unknown")), HasSubstr("not fitted"));
  EXPECT_THAT(refusal("fit", fitted("h_um, dc_mj_cm2: [[-75, 0], [0, 0.02]]")),
              HasSubstr("variance of ha"));
  EXPECT_THAT(refusal("fit", fitted("h_um, dc_mj_cm2: [[90000, 0], [0, 0.02]]")),
              HasSubstr("30 %"));
}

TEST(Uncertainty, TheExchangeIsAShareOfItsOwn) {
  const auto layerwise = ExposureMode::layerwise;
  const Uncertainty u = parsed("exchange=0.1,time=1%", {}, layerwise);
  EXPECT_DOUBLE_EQ(u.sd(UncertainInput::exchange), 0.1);
  EXPECT_STREQ(word_of(UncertainInput::exchange), "exchange");
  EXPECT_THAT(refusal("exchange=10%", {}, layerwise), HasSubstr("without %"));
  EXPECT_THAT(refusal("exchange=0.31", {}, layerwise), HasSubstr("at most 0.3"));
  EXPECT_THAT(refusal("exchange", {}, layerwise), HasSubstr("exchange=0.1"));
  EXPECT_THAT(refusal("exchange=0.1"), HasSubstr("expected layer by layer"));
  EXPECT_THAT(refusal("exchang=0.1", {}, layerwise), HasSubstr("did you mean exchange"));
}

}  // namespace
}  // namespace slicecorr
