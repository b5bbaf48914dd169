// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Fits of published measurements against what their authors found (docs/fits.md has the table).
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "real_files.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {
namespace {

/// Rows of numbers of a table, past comments and header; the first field may be a word.
std::vector<std::vector<double>> rows_of(const std::string& name,
                                         std::vector<std::string>* words = nullptr) {
  std::ifstream in(test::real_file("cure/" + name));
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    std::vector<double> row;
    std::string field, word;
    for (int k = 0; std::getline(fields, field, ','); ++k) {
      char* end = nullptr;
      const double value = std::strtod(field.c_str(), &end);
      if (*end == 0 || *end == '\r') {
        row.push_back(value);
      } else if (k == 0) {
        word = field;
      }
    }
    if (row.empty()) continue;
    rows.push_back(row);
    if (words) words->push_back(word);
  }
  return rows;
}

class FitReal : public ::testing::Test {
 protected:
  void SetUp() override {
    SLICECORR_NEEDS_FILE(test::real_file("cure/da2/working_curve_measured.csv"));
  }
};

TEST_F(FitReal, WorkingCurveOfDa2) {
  std::string csv = "dose_mj_cm2,cured_height_um\n";
  for (const auto& row : rows_of("da2/working_curve_measured.csv")) {
    csv += fmt::format("{},{}\n", row.at(0), 1000 * row.at(1));
  }
  const FitResult r = fit(parse_measurements(csv, "da2"), FitModel::jacobs);
  EXPECT_EQ(r.n, 13);
  // The same least squares, as printed beside the data.
  EXPECT_NEAR(r.value("h_um"), 527.4, 0.05);
  EXPECT_NEAR(r.value("dc_mj_cm2"), 5.54, 0.005);
  EXPECT_NEAR(r.rmse_um, 22.7, 0.05);
  // The authors' 550 um and 5.6 mJ/cm²: their dose lies in our interval, their height just outside.
  const Parameter &h = *r.find("h_um"), &dc = *r.find("dc_mj_cm2");
  EXPECT_LT(std::abs(h.value / 550 - 1), 0.05);
  EXPECT_LT(h.ci95[1], 550);
  EXPECT_GT(h.ci95[1], 540);
  EXPECT_LT(dc.ci95[0], 5.6);
  EXPECT_GT(dc.ci95[1], 5.6);
}

/// Value at x of a table of (x, y), between its rows.
double at(const std::vector<std::vector<double>>& table, double x) {
  for (std::size_t i = 1; i < table.size(); ++i) {
    if (table[i][0] < x) continue;
    const double share = (x - table[i - 1][0]) / (table[i][0] - table[i - 1][0]);
    return table[i - 1][1] + share * (table[i][1] - table[i - 1][1]);
  }
  return NAN;
}

TEST(FitSpectra, HeightsFromSpectra) {
  std::vector<std::string> names;
  const auto published = rows_of("spectra/penetration_depth_from_absorbance.csv", &names);
  ASSERT_EQ(published.size(), 11U);
  for (std::size_t i = 0; i < published.size(); ++i) {
    const auto spectrum = rows_of("spectra/absorbance_93um_" + names[i] + ".csv");
    ASSERT_GT(spectrum.size(), 900U) << names[i];
    const std::array<double, 3> wavelengths = {365, 385, 405};
    for (std::size_t k = 0; k < 3; ++k) {
      const double height = units::height_e_from_absorbance(93, at(spectrum, wavelengths[k]));
      // Printed with one decimal.
      EXPECT_NEAR(height, published[i].at(k), 0.051) << names[i] << " " << wavelengths[k];
    }
  }
}

}  // namespace
}  // namespace slicecorr::resins
