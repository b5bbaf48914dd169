// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Spread and scatter of light from scans of an edge and pictures of one; what is written of it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>

#include "edge_pictures.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/spread_fit.hpp"
#include "slicecorr/stack.hpp"
#include "spread_lab.hpp"

namespace slicecorr::resins {
namespace {

using test::Lab;
using test::measured;
using test::normal;
using test::printer_of_lab;
using test::refusal;
using test::scan;
using test::scans;
using test::with;
using testing::HasSubstr;

/// How often 95 % intervals may hold the truth in so many runs: three standard deviations less.
double least_inside(int runs) { return 0.95 * runs - 3 * std::sqrt(0.95 * 0.05 * runs); }

TEST(SpreadCoverage, IntervalsOfEdgesHoldTheTruthAsOftenAsTheySay) {
  int sigma = 0, scatter = 0;
  const int runs = test::rounds(40);
  for (int run = 0; run < runs; ++run) {
    const auto seed = static_cast<unsigned>(10 * run);
    const SpreadFit fit = fit_spread(
        scans({scan(40, 0.02, seed), scan(std::sqrt(1600 + 400 * 2.5), 0.02, seed + 1, 400)}));
    const SpreadParameter &s = fit.parameter("sigma_um"), &k = fit.parameter("scatter_um2_per_um");
    sigma += s.ci95[0] <= 40 && 40 <= s.ci95[1];
    scatter += k.ci95[0] <= 2.5 && 2.5 <= k.ci95[1];
  }
  EXPECT_GE(sigma, least_inside(runs));
  EXPECT_GE(scatter, least_inside(runs));
  RecordProperty("sigma", sigma);
  RecordProperty("scatter", scatter);
}

TEST(SpreadFit, ExactEdgesGiveExactParameters) {
  EXPECT_NEAR(fit_spread(scans({scan(40, 0, 1)})).parameter("sigma_um").value, 40, 40e-6);
  // From bright to dark.
  KnifeEdge falls = scan(25, 0, 1);
  for (EdgeSample& s : falls.samples) s.intensity = 50 - s.intensity;
  EXPECT_NEAR(fit_spread(scans({falls})).parameter("sigma_um").value, 25, 25e-6);
  const SpreadFit deep =
      fit_spread(scans({scan(30, 0, 1), scan(std::sqrt(900 + 3.0 * 500), 0, 1, 500),
                        scan(std::sqrt(900 + 3.0 * 900), 0, 1, 900)}));
  EXPECT_NEAR(deep.parameter("sigma_um").value, 30, 30e-6);
  EXPECT_NEAR(deep.parameter("scatter_um2_per_um").value, 3, 3e-6);
  SpreadFitOptions two;
  two.gaussians = 2;
  const SpreadFit halo = fit_spread(scans({scan(0, 0, 1, 0, {{20, 0.8}, {70, 0.2}})}), two);
  EXPECT_NEAR(halo.parameter("sigma_um").value, 20, 20e-6);
  EXPECT_NEAR(halo.parameter("sigma2_um").value, 70, 70e-6);
  EXPECT_NEAR(halo.parameter("weight2").value, 0.2, 1e-6);
  ASSERT_EQ(halo.spread().gaussians.size(), 2U);
  EXPECT_NEAR(halo.spread().gaussians[0].weight, 0.8, 1e-6);
}

TEST(SpreadFit, EdgesThatAreNoneAreRefused) {
  const auto says = [](KnifeEdge e) { return refusal([&] { fit_spread(scans({std::move(e)})); }); };
  KnifeEdge e = scan(40, 0, 1);
  e.samples.resize(4);
  EXPECT_THAT(says(e), HasSubstr("4 places of an edge; expected at least 5"));
  e = scan(40, 0, 1);
  for (EdgeSample& s : e.samples) s.at_um /= 1000;
  EXPECT_THAT(says(e), HasSubstr("look like millimetres"));
  e = scan(40, 0.001, 1);
  for (EdgeSample& s : e.samples) s.intensity = 7 + 0.01 * (s.line % 5);
  EXPECT_THAT(says(e), HasSubstr("shows no edge"));
  // A bar, brighter on one side.
  e = scan(40, 0, 1);
  for (EdgeSample& s : e.samples) {
    s.intensity = 5 + 10 * normal(s.at_um / 10) + (std::abs(s.at_um) < 100 ? 30 : 0);
  }
  EXPECT_THAT(says(e), testing::AnyOf(HasSubstr("no edge whose light"), HasSubstr("can't tell"),
                                      HasSubstr("more than a fifth")));
  // Sharper than any place can tell.
  e = scan(0.001, 0, 1);
  EXPECT_THAT(says(e), HasSubstr("can't tell sigma_um"));
  // Further than the display is wide.
  Printer small = printer_of_lab();
  small.width_px = small.height_px = 3;
  SpreadFitOptions o = with(small);
  EXPECT_THAT(refusal([&] { fit_spread(scans({scan(40, 0, 1)}), o); }),
              HasSubstr("further than the display's shorter side"));
}

TEST(CameraPicture, HasAllThatAPngTellsOfLight) {
  const std::string file = (std::filesystem::path(::testing::TempDir()) /
                            fmt::format("slicecorr-camera-{}.png", ::getpid()))
                               .string();
  std::mt19937 random(3);
  constexpr int w = 23, h = 17;
  for (const auto& [colour, channels] : {std::pair{PNG_COLOR_TYPE_GRAY, 1},
                                         {PNG_COLOR_TYPE_GRAY_ALPHA, 2},
                                         {PNG_COLOR_TYPE_RGB, 3},
                                         {PNG_COLOR_TYPE_RGB_ALPHA, 4}}) {
    std::vector<std::uint8_t> bytes;
    std::vector<double> wanted;
    for (int i = 0; i < w * h; ++i) {
      double light = 0, opaque = 1;
      for (int c = 0; c < channels; ++c) {
        const auto v = static_cast<int>(random() % 65536);
        bytes.push_back(static_cast<std::uint8_t>(v >> 8));
        bytes.push_back(static_cast<std::uint8_t>(v & 255));
        const bool alpha = channels % 2 == 0 && c == channels - 1;
        if (alpha) opaque = v / 65535.0;
        if (!alpha) light += v / (channels < 3 ? 1.0 : 3.0);
      }
      wanted.push_back(light * opaque);
    }
    test::write_png(file, w, h, 16, colour, bytes);
    const CameraPicture picture = read_camera_png(file);
    ASSERT_EQ(picture.width_px, w);
    ASSERT_EQ(picture.height_px, h);
    EXPECT_EQ(picture.white, 65535);
    ASSERT_EQ(picture.pixels.size(), wanted.size());
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      // Rounded twice where colours are averaged and dimmed.
      ASSERT_NEAR(picture.pixels[i], wanted[i], 1.01) << channels << " " << i;
    }
  }
  test::write_png(file, 2, 2, 8, PNG_COLOR_TYPE_GRAY, {0, 7, 200, 255});
  const CameraPicture small = read_camera_png(file);
  EXPECT_EQ(small.white, 255);
  EXPECT_EQ(small.pixels, (std::vector<std::uint16_t>{0, 7, 200, 255}));
  std::filesystem::remove(file);
}

class EdgePicture : public testing::TestWithParam<double> {
 protected:
  std::string path(const std::string& name) const {
    return (std::filesystem::path(::testing::TempDir()) /
            fmt::format("slicecorr-edge-{}-{}.png", ::getpid(), name))
        .string();
  }
  double sigma_of(const KnifeEdge& edge) const {
    SpreadMeasurements m;
    m.edges.push_back(edge);
    return fit_spread(m).parameter("sigma_um").value;
  }
};

TEST_P(EdgePicture, ItsSpreadIsFoundAtEveryAngle) {
  const std::string file = path("angle");
  for (const double sigma_px : {0.8, 3.0, 7.5}) {
    for (const bool level : {false, true}) {
      if (level && sigma_px != 3.0) continue;
      test::EdgePictureOptions o;
      o.angle_deg = GetParam();
      o.sigma_px = sigma_px;
      o.level = level;
      // A few hundred pixels where light changes are enough, and 6 sigma of even light beside them.
      (level ? o.height : o.width) = 110;
      (level ? o.width : o.height) = 64;
      test::write_edge_picture(file, o);
      const KnifeEdge e = read_edge_picture(file, 2.5, 0);
      EXPECT_NEAR(std::abs(e.angle_deg), GetParam(), 0.005) << sigma_px;
      // 65536 levels, hundreds of pixels where light changes.
      EXPECT_NEAR(sigma_of(e), 2.5 * sigma_px, 2.5 * sigma_px * 5e-4) << sigma_px << level;
      // Noise of one part in a hundred, 8 bits; of the widest and the narrowest at one angle.
      if (sigma_px != 3.0 && GetParam() != 3.0) continue;
      o.noise = 0.01;
      o.bits = 8;
      test::write_edge_picture(file, o);
      EXPECT_NEAR(sigma_of(read_edge_picture(file, 2.5, 0)), 2.5 * sigma_px, 2.5 * sigma_px * 0.015)
          << sigma_px;
    }
  }
  std::filesystem::remove(file);
}
INSTANTIATE_TEST_SUITE_P(Angles, EdgePicture, testing::Values(0.0, 3.0, 5.0));

TEST_F(EdgePicture, ThatHasNoEdgeIsRefused) {
  const std::string file = path("bad");
  const auto says = [&](const std::function<void(test::EdgePictureOptions&)>& spoil) {
    test::EdgePictureOptions o;
    o.width = 120;
    o.height = 48;
    spoil(o);
    test::write_edge_picture(file, o);
    return refusal([&] { read_edge_picture(file, 2.5, 0); });
  };
  EXPECT_THAT(says([](auto& o) { o.high = 1.3; }), HasSubstr("is overexposed"));
  EXPECT_THAT(says([](auto& o) {
                o.high = o.low;
                o.noise = 0.01;
              }),
              HasSubstr("shows no edge"));
  EXPECT_THAT(says([](auto& o) { o.angle_deg = 30; }), HasSubstr("leans by 30.0 degrees"));
  EXPECT_THAT(says([](auto& o) {
                o.height = 96;
                o.bar_px = 36;
              }),
              HasSubstr("no single straight edge"));
  EXPECT_THAT(says([](auto& o) {
                o.off_px = 55;
                o.sigma_px = 7;
              }),
              testing::AnyOf(HasSubstr("expected more of both sides"), HasSubstr("shows no")));
  EXPECT_THAT(says([](auto& o) { o.width = 9; }), HasSubstr("at least 16"));
  std::ofstream(file) << "no picture";
  EXPECT_THAT(refusal([&] { read_edge_picture(file, 2.5, 0); }), HasSubstr("is no PNG"));
  std::filesystem::remove(file);
}

TEST_F(EdgePicture, DustIsLeftOut) {
  const std::string file = path("dust");
  test::EdgePictureOptions o;
  o.noise = 0.01;
  o.specks = 40;
  test::write_edge_picture(file, o);
  const KnifeEdge e = read_edge_picture(file, 2.5, 0);
  EXPECT_THAT(e.notes, testing::Contains(HasSubstr("dust perhaps")));
  EXPECT_NEAR(sigma_of(e), 2.5 * o.sigma_px, 2.5 * o.sigma_px * 0.015);
  std::filesystem::remove(file);
}

TEST(SpreadCoverage, IntervalsOfPicturesHoldTheTruthAsOftenAsTheySay) {
  const std::string file = (std::filesystem::path(::testing::TempDir()) /
                            fmt::format("slicecorr-edge-{}-coverage.png", ::getpid()))
                               .string();
  int inside = 0;
  const int runs = test::rounds(10);
  for (int run = 0; run < runs; ++run) {
    // What an interval says must hold for any number of pixels.
    test::EdgePictureOptions o;
    o.width = 48;
    o.height = 32;
    o.off_px = 1.3;
    o.noise = 0.02;
    o.angle_deg = 3;
    o.seed = static_cast<unsigned>(run);
    test::write_edge_picture(file, o);
    SpreadMeasurements m;
    m.edges.push_back(read_edge_picture(file, 1, 0));
    const SpreadParameter p = fit_spread(m).parameter("sigma_um");
    inside += p.ci95[0] <= o.sigma_px && o.sigma_px <= p.ci95[1];
  }
  EXPECT_GE(inside, least_inside(runs));
  RecordProperty("inside", inside);
  std::filesystem::remove(file);
}

TEST(SpreadFit, FilesTakeWhatWasFound) {
  const std::string printer =
      "name = \"mine\"\n[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n[blue] # lamp\n"
      "calibration = [[0, 1.0], [255, 100.0]]\nspread = \"kernel.png\"\nspread_pitch_um = 5.0\n";
  const std::string resin =
      "name = \"mine\"\n[cure]\nabsorbance_height_um = 2000.0\nabsorbance_base = 10\n"
      "gel_dose_mj_cm3 = 20.0\n";
  const SpreadFit deep =
      fit_spread(scans({scan(30, 0.005, 1), scan(std::sqrt(900 + 3.0 * 500), 0.005, 2, 500)}));
  const Printer with_spread =
      parse_printer(printer_with_spread(printer, "mine.toml", deep), "mine.toml");
  ASSERT_EQ(with_spread.spread.gaussians.size(), 1U);
  EXPECT_NEAR(with_spread.spread.gaussians[0].sigma_um, deep.parameter("sigma_um").value, 1e-3);
  EXPECT_THAT(printer_with_spread(printer, "mine.toml", deep), HasSubstr("[blue] # lamp"));
  const Resin scattering = parse_resin(resin_with_scatter(resin, "mine.toml", deep), "mine.toml");
  EXPECT_NEAR(scattering.scatter_um2_per_um, deep.parameter("scatter_um2_per_um").value, 1e-4);
  EXPECT_THAT(deep.to_toml(),
              testing::AllOf(HasSubstr("[blue]\nspread = [["), HasSubstr("scatter_um2_per_um = ")));
  SpreadFit uv = deep;
  uv.light = "uv";
  const std::string lamp = printer + "[uv]\ncalibration = [[0, 0.0], [255, 10.0]]\n";
  const Printer inhibiting = parse_printer(
      printer_with_spread(lamp + "kind = \"patterned\"\n", "mine.toml", uv), "mine.toml");
  EXPECT_EQ(inhibiting.uv->spread.gaussians.size(), 1U);
  EXPECT_TRUE(inhibiting.spread.gaussians.empty());
  // That of a flood is even.
  EXPECT_THAT(refusal([&] { printer_with_spread(lamp, "mine.toml", uv); }), HasSubstr("flood"));
  // What was not told is not written.
  const SpreadFit flat = fit_spread(scans({scan(30, 0.005, 1)}));
  EXPECT_THAT(refusal([&] { resin_with_scatter(resin, "mine.toml", flat); }),
              HasSubstr("the scatter was not fitted"));
  const SpreadFit same = fit_spread(scans({scan(30, 0.02, 1), scan(30, 0.02, 2, 500)}));
  EXPECT_THAT(refusal([&] { resin_with_scatter(resin, "mine.toml", same); }),
              HasSubstr("can't be told from 0"));
  EXPECT_THAT(refusal([&] { printer_with_spread(resin, "mine.toml", deep); }),
              HasSubstr("mine.toml"));
  // Pictures of both kinds.
  EXPECT_THAT(spread_fit_svg(deep),
              testing::AllOf(HasSubstr("Knife edges"), HasSubstr("500 um deep")));
  const Printer lab = printer_of_lab();
  EXPECT_THAT(spread_fit_svg(fit_spread(measured(Lab(), 2, 1), with(lab))),
              testing::AllOf(HasSubstr("Printed widths"), HasSubstr("gaps")));
}

/// How wide the light of a row of pixels prints about a place: each pixel is spread by itself.
double width_in_row(const std::vector<double>& light, double pitch, double sigma, double dose,
                    double middle_um, bool gap) {
  const auto dose_at = [&](double x) {
    double sum = light.front();
    for (std::size_t i = 0; i < light.size(); ++i) {
      const double from = static_cast<double>(i) * pitch;
      sum += (light[i] - light.front()) *
             (normal((x - from) / sigma) - normal((x - from - pitch) / sigma));
    }
    return dose * sum;
  };
  const bool gelled = dose_at(middle_um) >= 1;
  if (gelled == gap) return 0;
  const auto alike = [&](double x) { return (dose_at(x) >= 1) == gelled; };
  double ends[2] = {};
  for (const int way : {-1, 1}) {
    double in = middle_um;
    while (alike(in + 5 * way) && std::abs(in - middle_um) < 1500) in += 5 * way;
    double out = in + 5 * way;
    for (int i = 0; i < 30; ++i) {
      const double middle = 0.5 * (in + out);
      (alike(middle) ? in : out) = middle;
    }
    ends[way > 0] = in;
  }
  return ends[1] - ends[0];
}

// From the part that is printed to the printer's file, through the programs. The print is made up
// from the stack's own image.
TEST(SpreadProgram, ATestPartIsMadeMeasuredAndFitted) {
  namespace fs = std::filesystem;
  const fs::path folder =
      fs::path(::testing::TempDir()) / fmt::format("slicecorr-spread-{}", ::getpid());
  fs::create_directories(folder);
  const fs::path bin = SLICECORR_BIN_DIR;
  const std::string printer_file = (folder / "my-printer.toml").string();
  std::ofstream(printer_file)
      << "name = \"my-printer\"\n[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n"
         "[blue]\ncalibration = [[0, 1.0], [255, 100.0]] # measured\n";
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"HOME", folder.string()}, {"XDG_CONFIG_HOME", ""}, {"SLICECORR_DB", ""}};
  auto ran =
      test::run_program({(bin / "slicecorr").string(), "testpart", "--printer", "my-printer.toml",
                         "-o", "part.uvj", "--form", "form.csv", "--picture", "part.png"},
                        options);
  ASSERT_EQ(ran.exit_code, 0) << ran.err;
  const StackReader stack((folder / "part.uvj").string(), folder.string());
  EXPECT_EQ(stack.info().kind, StackKind::target);
  EXPECT_EQ(stack.grid().layers, 10);
  std::vector<std::uint8_t> image(1280 * 800);
  stack.read_slice(3, image.data());
  EXPECT_EQ(read_camera_png((folder / "part.png").string()).pixels,
            std::vector<std::uint16_t>(image.begin(), image.end()));
  // Upright ones are measured along the row in which they are all cut, gaps along another one.
  std::ifstream form(folder / "form.csv");
  std::ofstream filled(folder / "widths.csv");
  std::map<std::string, std::vector<std::pair<int, int>>> runs;
  std::map<std::string, std::vector<double>> rows;
  for (int y = 0; y < 800; ++y) {
    std::vector<std::pair<int, int>> lit, dark;
    int begin = 0;
    for (int x = 1; x <= 1280; ++x) {
      if (x < 1280 && image[y * 1280 + x] == image[y * 1280 + x - 1]) continue;
      (image[y * 1280 + begin] ? lit : dark).emplace_back(begin, x);
      begin = x;
    }
    std::vector<double> light;
    for (int x = 0; x < 1280; ++x) light.push_back(image[y * 1280 + x] ? 1.0 : 0.01);
    const auto counts = [](const std::vector<std::pair<int, int>>& all, std::size_t from) {
      if (all.size() < from + 12) return false;
      for (int n = 1; n <= 12; ++n) {
        const auto& [a, b] = all[from + static_cast<std::size_t>(n) - 1];
        if (b - a != n) return false;
      }
      return true;
    };
    if (!runs.contains("line") && counts(lit, 0)) runs["line"] = lit, rows["line"] = light;
    if (!runs.contains("gap") && counts(dark, 1)) {
      dark.erase(dark.begin());
      runs["gap"] = dark, rows["gap"] = light;
    }
  }
  ASSERT_EQ(runs.size(), 2U);
  std::map<std::string, std::size_t> done;
  for (std::string line; std::getline(form, line);) {
    const std::string name = line.substr(0, line.find(','));
    const std::string kind = name.find("line") != std::string::npos ? "line" : "gap";
    if (line.starts_with("upright ")) {
      const auto& [a, b] = runs[kind][done[kind]++];
      const double width = width_in_row(rows[kind], 50, 45, 3.2, 25.0 * (a + b), kind == "gap");
      line = fmt::format("{},{},{},{},", name, kind, 50 * (b - a), width);
    }
    filled << line << "\n";
  }
  filled.close();
  ran = test::run_program(
      {(bin / "resinctl").string(), "fit-spread", "widths.csv", "--printer", "my-printer.toml",
       "--json", "-", "--plot", "widths.svg", "--write", "my-printer.toml"},
      options);
  ASSERT_EQ(ran.exit_code, 0) << ran.err;
  const auto json = nlohmann::json::parse(ran.out);
  EXPECT_NEAR(json["parameters"]["sigma_um"]["value"].get<double>(), 45, 1e-3);
  EXPECT_NEAR(json["parameters"]["dose"]["value"].get<double>(), 3.2, 1e-4);
  EXPECT_EQ(json["kind"], "widths");
  EXPECT_EQ(json["measurements"].get<int>() + 1, 24);
  EXPECT_TRUE(fs::exists(folder / "widths.svg"));
  const Printer found = load_printer(printer_file);
  ASSERT_EQ(found.spread.gaussians.size(), 1U);
  EXPECT_NEAR(found.spread.gaussians[0].sigma_um, 45, 1e-3);
  EXPECT_TRUE(fs::exists(folder / ".history" / "my-printer"));
  // What can't be is wrong usage.
  for (const std::vector<std::string>& more : {std::vector<std::string>{"part.png"},
                                               {"widths.csv", "--exposure-s", "3"},
                                               {"part.png", "--pitch-um", "50"},
                                               {"widths.csv", "--write-resin", "nowhere.toml"},
                                               {"widths.csv", "part.png", "--pitch-um", "3"}}) {
    std::vector<std::string> command = {(bin / "resinctl").string(), "fit-spread"};
    command.insert(command.end(), more.begin(), more.end());
    const auto refused = test::run_program(command, options);
    EXPECT_EQ(refused.exit_code, 2) << more.back() << refused.out;
    EXPECT_FALSE(refused.err.empty());
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace slicecorr::resins
