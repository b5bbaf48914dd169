// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_browser.hpp
/// The pages of a farm in a real browser, served by the programs as they are.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>

#include "devtools.hpp"
#include "farm_served.hpp"

namespace slicecorr::farm::test {

using slicecorr::test::chromium;
using slicecorr::test::DrivenPage;

inline const std::string kSubmit(40, 's'), kOperate(40, 'p');

/// A table of cured heights, to be fitted.
inline std::string heights_of_a_resin() {
  std::string csv = "intensity_mw_cm2,exposure_s,cured_height_um\n";
  // Heights of the kinetic law h/m ln(I^m t / D'c), nearly: h = 120 um, m = 0.8, D'c = 12.
  for (const double i : {5.0, 15.0}) {
    for (const double t : {6.0, 10.0, 16.0, 25.0, 40.0}) {
      csv +=
          fmt::format("{},{},{:.3f}\n", i, t, 150 * std::log(std::pow(i, 0.8) * t / 12) + t / 50);
    }
  }
  return csv;
}

/// A lab's farm, its server and a browser.
class LabInABrowser : public ::testing::Test {
 protected:
  void SetUp() override {
    if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
    std::filesystem::create_directories(farm_.root + "/db");
    ::setenv("SLICECORR_DB", (farm_.root + "/db").c_str(), 1);
    options_.accounts = {{"sam", Role::submit, kSubmit}, {"pia", Role::operate, kOperate}};
    options_.submit = make_submitter({farm_.folder, {}, "web"});
    // The programs as they are, but for a machine that is always ready.
    options_.children.programs = farm_.root + "/programs";
    std::filesystem::create_directories(options_.children.programs);
    for (const char* program : {"slicecorr", "slicefarm", "resinctl"}) {
      std::filesystem::create_symlink(std::string(SLICECORR_BIN_DIR) + "/" + program,
                                      options_.children.programs + "/" + program);
    }
    const std::string bridge = options_.children.programs + "/printbridge";
    write_file(bridge,
               "#!/bin/sh\n[ $1 = status ] && echo '{\"running\": false, \"phase\": "
               "\"done\"}'\nexit 0\n");
    std::filesystem::permissions(bridge, std::filesystem::perms::owner_all);
  }
  void TearDown() override { ::unsetenv("SLICECORR_DB"); }

  void serve() {
    served_ = std::make_unique<Served>(farm_, options_);
    page_ = std::make_unique<DrivenPage>();
    page_->look_like(1300, 900, false);
  }
  std::string at(const std::string& path) const {
    return fmt::format("http://127.0.0.1:{}{}", served_->port, path);
  }
  void open(const std::string& path) {
    page_->open(at(path));
    page_->wait_for("document.body.dataset.ready === 'yes'");
  }
  void sign_in(const std::string& token) {
    page_->click("#who button");
    page_->set("token", token);
    page_->click("#ask button");
    page_->wait_for("document.body.dataset.ready === 'yes' && me.role !== 'look'");
  }
  /// The page as it is now on a desk and on a phone, light and dark, by day one of both each;
  /// nothing is wider than a phone.
  void pictures(const std::string& name) {
    const std::filesystem::path out =
        std::filesystem::path(SLICECORR_BIN_DIR).parent_path() / "farm-pictures";
    for (const int width : {400, 1300}) {
      for (const bool dark : {false, true}) {
        if (!slicecorr::test::by_night() && dark != (width == 400)) continue;
        page_->look_like(width, 900, dark);
        ::usleep(300'000);  // pictures are drawn anew
        EXPECT_EQ(page_->eval("document.documentElement.scrollWidth"), width) << name;
        page_->picture(out / fmt::format("{}-{}-{}.png", name, width, dark ? "dark" : "light"));
      }
    }
    page_->look_like(1300, 900, false);
  }
  void see(const std::string& id) {
    page_->wait_for("!document.getElementById('" + id +
                    "').hidden || !trouble.hidden || document.getElementById('said-here') || " +
                    "document.querySelector('.controls .holds')");
    ASSERT_EQ(page_->eval("document.getElementById('" + id + "').hidden"), false)
        << page_->text("all");
  }

  Farm farm_;
  ServeOptions options_;
  std::unique_ptr<Served> served_;
  std::unique_ptr<DrivenPage> page_;
};

}  // namespace slicecorr::farm::test
