// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Where pixels really land: maps against lenses in closed form, and slices against places that the test finds
// by itself, point by point.
#include "slicecorr/distortion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>

#include "ladder.hpp"
#include "memory_slices.hpp"
#include "meshes.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/grid_part.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;
using Place = std::array<double, 2>;
/// From places of the image, px, to mm on the plate.
using Lens = std::function<Place(double, double)>;

constexpr int kWide = 120, kHigh = 80;
constexpr double kPx = 0.05;  // mm

Printer display() {
  Printer p;
  p.name = "p";
  p.width_px = kWide;
  p.height_px = kHigh;
  p.pixel_x_um = p.pixel_y_um = 1e3 * kPx;
  p.calibration = {{0, 0}, {255, 100}};
  return p;
}

/// r + k r³ about the middle of the display.
Lens barrel(double k) {
  return [k](double x_px, double y_px) {
    const double x = (x_px - kWide / 2.0) * kPx, y = (kHigh / 2.0 - y_px) * kPx;
    const double more = 1 + k * (x * x + y * y);
    return Place{x * more + kWide * kPx / 2, y * more + kHigh * kPx / 2};
  };
}

/// A projector that leans: a plane seen from a side.
Lens keystone(double p) {
  return [p](double x_px, double y_px) {
    const double x = (x_px - kWide / 2.0) * kPx, y = (kHigh / 2.0 - y_px) * kPx, w = 1 + p * x;
    return Place{x / w + kWide * kPx / 2, y / w + kHigh * kPx / 2};
  };
}

std::vector<DistortionPoint> marks_of(const Lens& lens, int across = 9, int down = 7) {
  std::vector<DistortionPoint> points;
  for (int j = 0; j < down; ++j) {
    for (int i = 0; i < across; ++i) {
      const double x = kWide * (0.05 + 0.9 * i / (across - 1)),
                   y = kHigh * (0.05 + 0.9 * j / (down - 1));
      const Place at = lens(x, y);
      points.push_back({x, y, at[0], at[1]});
    }
  }
  return points;
}

/// Greatest way between what a map and a lens say, mm, once shift and turn as a whole are taken out of the
/// lens as the map does: by least squares over its marks.
double off(const Distortion& map, const Lens& lens) {
  // What is left of the lens over all places may be shifted by the mean of the marks alone: these lenses
  // are even about the middle, or small shifts that the comparison of distances leaves out.
  double most = 0;
  for (int i = 0; i < 20; ++i) {
    const double x0 = kWide * (i + 0.5) / 20, y0 = kHigh * (((i * 7) % 20) + 0.5) / 20;
    const double x1 = kWide - x0 / 2, y1 = kHigh - y0 / 3;
    const auto at = [&](double x, double y) {
      return map.place_mm(2 * x / kWide - 1, 2 * y / kHigh - 1);
    };
    const Place a = at(x0, y0), b = at(x1, y1), c = lens(x0, y0), d = lens(x1, y1);
    most = std::max(most, std::abs(std::hypot(a[0] - b[0], a[1] - b[1]) -
                                   std::hypot(c[0] - d[0], c[1] - d[1])));
  }
  return most;
}

std::string refusal(const std::vector<DistortionPoint>& points) {
  try {
    fit_distortion(points, display());
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(Distortion, BarrelComesOutOfAGridExactlyAndKeystoneNearly) {
  for (const double k : {-0.01, 0.004, 0.0}) {
    const Distortion map = fit_distortion(marks_of(barrel(k)), display());
    EXPECT_LT(off(map, barrel(k)), 1e-10) << k;
    EXPECT_LT(map.rms_um, 1e-6);
    // Farthest at the outermost marks.
    const double r = std::hypot(0.45 * kWide * kPx, 0.45 * kHigh * kPx);
    EXPECT_NEAR(map.most_off_um, 1e3 * std::abs(k) * r * r * r, 1e-6);
  }
  // p x reaches 0.03: what is left is its cube, of 3 mm.
  const Distortion map = fit_distortion(marks_of(keystone(0.01)), display());
  EXPECT_LT(off(map, keystone(0.01)), 3 * 0.03 * 0.03 * 0.03);
  EXPECT_GT(map.most_off_um, 30);
}

TEST(Distortion, PlacesOfTheImageAreFoundAgain) {
  const Distortion map = fit_distortion(marks_of(barrel(-0.01)), display());
  std::mt19937 random(7);
  std::uniform_real_distribution<double> share(0, 1);
  for (int i = 0; i < 200; ++i) {
    const double x = kWide * share(random), y = kHigh * share(random);
    const Place mm = barrel(-0.01)(x, y);
    const auto back = image_place(map, display(), mm[0], mm[1]);
    ASSERT_TRUE(back);
    EXPECT_NEAR((*back)[0], x, 1e-8);
    EXPECT_NEAR((*back)[1], y, 1e-8);
  }
  EXPECT_FALSE(image_place(map, display(), -1, 2));
}

TEST(Distortion, ShiftAndTurnOfWhatWasMeasuredDoNotCount) {
  std::vector<DistortionPoint> turned = marks_of(barrel(0.004));
  for (DistortionPoint& p : turned) {
    const double x = p.x_mm, y = p.y_mm;
    p.x_mm = std::cos(0.3) * x - std::sin(0.3) * y - 17;
    p.y_mm = std::sin(0.3) * x + std::cos(0.3) * y + 4;
  }
  const Distortion a = fit_distortion(marks_of(barrel(0.004)), display()),
                   b = fit_distortion(turned, display());
  for (std::size_t i = 0; i < Distortion::kTerms; ++i) {
    EXPECT_NEAR(a.x_mm[i], b.x_mm[i], 1e-10);
    EXPECT_NEAR(a.y_mm[i], b.y_mm[i], 1e-10);
  }
}

TEST(Distortion, RefusesWhatCannotBe) {
  const std::vector<DistortionPoint> good = marks_of(barrel(0.004));
  EXPECT_EQ(refusal(good), "");
  EXPECT_THAT(refusal({good.begin(), good.begin() + 19}), HasSubstr("expected 20 or more"));
  std::vector<DistortionPoint> bad = good;
  for (DistortionPoint& p : bad) p.y_mm = -p.y_mm;
  EXPECT_THAT(refusal(bad), HasSubstr("mirrored"));
  bad = good;
  bad[31].x_mm += 0.2;
  EXPECT_THAT(refusal(bad), HasSubstr("off what all others say"));
  bad = good;
  for (DistortionPoint& p : bad) p.x_mm *= 10, p.y_mm *= 10;
  EXPECT_THAT(refusal(bad), HasSubstr("where pixels of"));
  bad.clear();
  for (const DistortionPoint& p : good) {
    if (p.x_px < 0.7 * kWide) bad.push_back(p);
  }
  EXPECT_THAT(refusal(bad), HasSubstr("of the display's width"));
  EXPECT_THAT(refusal(marks_of(barrel(0.004), 9, 3)), HasSubstr("too few lines"));
}

TEST(Distortion, LinesOfTheTaughtLengthStayStraight) {
  const Printer p = display();
  for (const double k : {-0.01, 0.004}) {
    const Distortion map = fit_distortion(marks_of(barrel(k)), p);
    const double length = straight_mm(map, p);
    double most = 0;
    for (int i = 0; i < 60; ++i) {
      const double x = 0.4 + 5.0 * i / 60, angle = 0.1 * i, y = 0.4 + 3.0 * ((i * 13) % 60) / 60;
      const auto at = [&](double share) {
        return image_place(map, p, x + share * length * std::cos(angle),
                           y + share * length * std::sin(angle));
      };
      const auto a = at(-0.5), b = at(0), c = at(0.5);
      if (!a || !b || !c) continue;
      most = std::max(
          most, std::hypot((*b)[0] - ((*a)[0] + (*c)[0]) / 2, (*b)[1] - ((*a)[1] + (*c)[1]) / 2));
    }
    EXPECT_LE(most, 0.02);
    EXPECT_GT(most, 0.0005);  // and not many times too short
  }
}

TEST(Distortion, PixelsThatAreSmallerAreBrighter) {
  const Printer p = display();
  const auto field = light_by_pitch(fit_distortion(marks_of(barrel(-0.01)), p), p);
  ASSERT_TRUE(field);
  EXPECT_FALSE(field->of_plate);
  // Area by differences of the lens: r (1 + k r²) has (1 + k r²)(1 + 3 k r²) of it.
  const auto area = [](double r) { return (1 - 0.01 * r * r) * (1 - 0.03 * r * r); };
  for (int y = 0; y < field->height_px; y += 5) {
    for (int x = 0; x < field->width_px; x += 5) {
      const double r = std::hypot(((x + 0.5) / field->width_px - 0.5) * kWide * kPx,
                                  ((y + 0.5) / field->height_px - 0.5) * kHigh * kPx);
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(field->width_px) +
                      static_cast<std::size_t>(x);
      EXPECT_NEAR((*field->values)[at], field->reference / area(r), 0.51);
    }
  }
  EXPECT_FALSE(light_by_pitch(fit_distortion(marks_of(barrel(0)), p), p));
}

TEST(Distortion, CrossesOfTheTargetAreWhereTheirTableSays) {
  Printer large = display();
  large.width_px = 1200, large.height_px = 800;
  const GridPart part(large, 50, 30);
  const MemorySlices images(part);
  const MeasuringForm form = part.form();
  ASSERT_EQ(form.rows.size(), 63U);
  std::vector<DistortionPoint> points;
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    const double x = *form.number(i, "x_px", 0, 1200), y = *form.number(i, "y_px", 0, 800);
    // As far lit to all sides: the middle of what is lit about it is the cross's.
    double sum_x = 0, sum_y = 0, lit = 0;
    for (int b = static_cast<int>(y) - 35; b <= static_cast<int>(y) + 35; ++b) {
      for (int a = static_cast<int>(x) - 35; a <= static_cast<int>(x) + 35; ++a) {
        if (images.at(0, a, b) == 0) continue;
        sum_x += a + 0.5, sum_y += b + 0.5, ++lit;
      }
    }
    ASSERT_GT(lit, 400);
    EXPECT_NEAR(sum_x / lit, x, 1e-9);
    EXPECT_NEAR(sum_y / lit, y, 1e-9);
    points.push_back({x, y, x * kPx, 40 - y * kPx});
  }
  EXPECT_LT(fit_distortion(points, large).most_off_um, 1e-6);
  EXPECT_THROW(GridPart(display(), 50, 30), InputError);
}

/// Share of a pixel that lies in the mesh, by points that the lens says where they land.
double covered(const Lens& lens, int x, int y, const std::function<bool(Place)>& inside) {
  constexpr int kPoints = 24;
  int count = 0;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      count += inside(lens(x + (i + 0.5) / kPoints, y + (j + 0.5) / kPoints)) ? 1 : 0;
    }
  }
  return 1.0 * count / (kPoints * kPoints);
}

TEST(Distortion, SlicesLieWherePixelsLand) {
  Printer p = display();
  const Lens lens = barrel(-0.01);
  p.distortion = fit_distortion(marks_of(lens), p);
  // A plate of two triangles a side, and one that stands turned beside it.
  const TriangleMesh mesh = box({0, 0, 0}, {3.6, 2.2, 0.2});
  const MeshSlices slices(mesh, p, {});
  const MemorySlices images(slices);
  const Place middle = lens(kWide / 2.0, kHigh / 2.0);
  const auto inside = [&](Place at) {
    return std::abs(at[0] - middle[0]) < 1.8 && std::abs(at[1] - middle[1]) < 1.1;
  };
  double most = 0, sum = 0;
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kWide; ++x) {
      const double told = images.at(1, x, y) / 255.0;
      most = std::max(most, std::abs(told - covered(lens, x, y, inside)));
      sum += told;
    }
  }
  // Points miss a straight outline by half a row of them (1/48); it bows by 0.02 px; a level is 1/255.
  EXPECT_LT(most, 1.0 / 48 + 0.02 + 1.0 / 255 + 0.01);
  // Without the map it is another image.
  const MemorySlices even(MeshSlices(mesh, display(), {}));
  double differ = 0;
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kWide; ++x)
      differ = std::max(differ, std::abs(images.at(1, x, y) - even.at(1, x, y)) / 255.0);
  }
  EXPECT_GT(differ, 0.5);
  EXPECT_GT(sum, 3.6 * 2.2 / (kPx * kPx));  // smaller pixels: more of them
  // What no pixel reaches is refused by its place.
  const TriangleMesh wide = box({0, 0, 0}, {5.99, 3.99, 0.2});
  EXPECT_THROW(MeshSlices(wide, p, {}), InputError);
  EXPECT_NO_THROW(MeshSlices(wide, display(), {}));
}

TEST(Distortion, ProgramsTakeTellAndRefuseIt) {
  const TemporaryFolder folder;
  RunOptions options;
  options.folder = folder.path();
  options.environment = {{"SLICECORR_DB", ""}, {"HOME", folder.path()}, {"XDG_CONFIG_HOME", ""}};
  const auto printer = [&](const char* more) {
    std::ofstream(folder / "p.toml")
        << "name = \"p\"\n[display]\nwidth_px = 120\nheight_px = 80\npixel_um = 50\n"
           "distortion = \"marks.csv\"\n"
        << "[blue]\ncalibration = [[0, 0.0], [255, 100.0]]\n"
        << more;
  };
  const auto table = [&](const std::string& head) {
    std::ofstream out(folder / "marks.csv");
    out << head << "\n";
    for (const DistortionPoint& p : marks_of(barrel(-0.01))) {
      out << p.x_px << "," << p.y_px << "," << p.x_mm << "," << p.y_mm << "\n";
    }
    out << "1,1,,\n";  // one that nobody could measure
  };
  table("x_px,y_px,x_mm,y_mm");
  printer("");
  write_stl(folder / "b.stl", box({0, 0, 0}, {3.6, 2.2, 0.2}));
  std::ofstream(folder / "r.toml")
      << "name = \"r\"\n[cure]\nabsorbance_height_um = 800\nabsorbance_base = 10\n"
         "critical_dose_mj_cm3 = 200\n";
  const Command slice{SLICECORR_BIN_DIR "/slicecorr",
                      "run",
                      "b.stl",
                      "-o",
                      "b.uvj",
                      "--printer",
                      "p.toml",
                      "--resin",
                      "r.toml",
                      "--layer-um",
                      "50",
                      "--speed-mm-h",
                      "300",
                      "--quiet"};
  const RunResult made = run_program(slice, options);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const StackInfo info = StackReader::read_info(folder / "b.uvj");
  ASSERT_TRUE(info.printer && info.printer->distortion);
  // The stack keeps the map, number by number, and the light that follows from it.
  EXPECT_EQ(*info.printer->distortion, *load_printer(folder / "p.toml").distortion);
  EXPECT_TRUE(info.printer->flat_field);
  const RunResult told = run_program({SLICECORR_BIN_DIR "/slicecorr", "info", "b.uvj"}, options);
  EXPECT_THAT(told.out, HasSubstr("distortion   up to"));
  const RunResult figures =
      run_program({SLICECORR_BIN_DIR "/slicecorr", "info", "b.uvj", "--json", "-"}, options);
  const auto j = nlohmann::json::parse(figures.out);
  EXPECT_NEAR(j["distortion"]["most_off_um"].get<double>(), info.printer->distortion->most_off_um,
              1e-9);
  EXPECT_EQ(j["distortion"]["points"], 63);
  const auto refused = [&](const char* words) {
    const RunResult r = run_program(slice, options);
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_THAT(r.err, HasSubstr(words));
  };
  printer("[optics]\nkind = \"telecentric\"\n");
  refused("distortion");
  printer("");
  table("x,y,a,b");
  refused("expected the head x_px,y_px,x_mm,y_mm");
  std::ofstream(folder / "marks.csv") << "x_px,y_px,x_mm,y_mm\n1,2,3\n";
  refused("expected four columns");
  std::ofstream(folder / "marks.csv") << "x_px,y_px,x_mm,y_mm\n1,2,3,x\n";
  refused("expected a number as y_mm");
  std::filesystem::remove(folder / "marks.csv");
  refused("is not a file that can be read");
}

}  // namespace
}  // namespace slicecorr::test
