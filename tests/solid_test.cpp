// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The printed surface as a mesh: closed on any stack, in the right place on stacks whose dose is
/// known in closed form, and its distance to a design.
#include "slicecorr/solid.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <random>

#include "ladder.hpp"
#include "models.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

/// A stack in memory.
class Memory final : public SliceSource {
 public:
  Memory(Images images, const PixelBox& box) : images_(std::move(images)), box_(box) {}
  const Grid& grid() const override { return images_.grid; }
  PixelBox bounds() const override { return box_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    Bytes rows;
    for (int n = 0; n < grid().layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        const auto from = images_.slices[static_cast<std::size_t>(n)].begin() +
                          static_cast<std::ptrdiff_t>(y) * grid().width_px;
        rows.insert(rows.end(), from + band.x0, from + band.x1);
      }
      sink(n, rows.data());
    }
  }

 private:
  Images images_;
  PixelBox box_;
};

/// Black but for a box of pixels and slices [first, last).
Memory lit_box(const Grid& grid, const PixelBox& box, int first, int last) {
  Images images;
  images.grid = grid;
  for (int n = 0; n < grid.layers; ++n) {
    Bytes pixels(static_cast<std::size_t>(grid.width_px * grid.height_px));
    for (int y = box.y0; y < box.y1 && n >= first && n < last; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        pixels[static_cast<std::size_t>(y * grid.width_px + x)] = 255;
      }
    }
    images.slices.push_back(std::move(pixels));
  }
  return {std::move(images), box};
}

void expect_closed(const MeshReport& r) {
  EXPECT_EQ(r.defects.open_edges, 0U);
  EXPECT_EQ(r.defects.misoriented_edges, 0U);
  EXPECT_EQ(r.defects.crowded_edges, 0U);
  EXPECT_EQ(r.defects.degenerate_triangles, 0U);
  EXPECT_GT(r.volume, 0);
}

constexpr Grid kGrid{24, 20, 30, 50, 40, 50};

// Full light in slices 10 to 19, black elsewhere: where the dose is 1 above and in the run follows
// from (A.32) and (A.35).
TEST(Solid, EdgesInZAreThoseOfTheClosedForm) {
  const CureModel model = figure_2_2();
  const Memory stack = lit_box(kGrid, {6, 5, 14, 12}, 10, 20);
  const MeshReport r = inspect(solid_mesh(stack, model));
  expect_closed(r);
  const double black = model.phi_min(), light = model.phi_max();
  const auto after = [&](double start, double phi, double slices) {
    return phi + (start - phi) * std::pow(10.0, -slices * model.eta);
  };
  const double below = after(0, black, 10), top = after(below, light, 10);
  ASSERT_GT(top, 1.0);
  const double upper_edge = 10 - std::log10((top - black) / (1 - black)) / model.eta;
  const double lower_edge = 20 - std::log10((light - below) / (light - 1)) / model.eta;
  // Cured through to the platform or not, the file's z grows from the platform.
  EXPECT_NEAR(r.lower[2], std::max(0.0, upper_edge) * 0.05, 0.05 / 1024 + 1e-6);
  EXPECT_NEAR(r.upper[2], lower_edge * 0.05, 0.05 / 1024 + 1e-6);
}

// Between columns the surface lies between the centres of a lit and a dark pixel: within half a
// pixel of their border. x and y as `slice` places parts: row 0 has the largest y.
TEST(Solid, CorrectedBoxHasTheBoxsPlaceAndVolume) {
  const Memory target = lit_box(kGrid, {6, 5, 14, 12}, 8, 20);
  slicecorr::Setup setup{linear_printer(1, 100), resin(576, 2000), process(1000)};
  setup.printer.width_px = kGrid.width_px;
  setup.printer.height_px = kGrid.height_px;
  setup.printer.pixel_y_um = kGrid.pixel_y_um;
  const CorrectedSlices corrected(target, setup);
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  const MeshReport r = inspect(solid_mesh(corrected, model));
  expect_closed(r);
  EXPECT_EQ(r.bodies, 1U);
  const auto within_half = [](double value, double border, double pixel) {
    EXPECT_GT(value, border - 0.5 * pixel);
    EXPECT_LT(value, border + 0.5 * pixel);
  };
  within_half(r.lower[0], 6 * 0.05, 0.05);
  within_half(r.upper[0], 14 * 0.05, 0.05);
  within_half(r.lower[1], (20 - 12) * 0.04, 0.04);
  within_half(r.upper[1], (20 - 5) * 0.04, 0.04);
  // The edges of the column as probed.
  const auto rows = probe_stack(corrected, &target, setup, 8, 8);
  double first = -1, last = -1;
  for (std::size_t n = rows.size(); n-- > 0;) {
    const double below = n + 1 < rows.size() ? rows[n + 1].dose : 0;
    if ((rows[n].dose >= 1) == (below >= 1)) continue;
    const double z = static_cast<double>(n) + 1 - model.crossing(rows[n].phi, below);
    (below < 1 ? last : first) = z * 0.05;
  }
  // An edge lies within the levels' step of its node.
  EXPECT_NEAR(first, 0.4, 1e-3 * model.level_step_um());
  EXPECT_NEAR(last, 1.0, 1e-3 * model.level_step_um());
  EXPECT_NEAR(r.lower[2], first, 0.05 / 1024 + 1e-6);
  EXPECT_NEAR(r.upper[2], last, 0.05 / 1024 + 1e-6);
  const double height = last - first;
  EXPECT_GT(r.volume, 7 * 6 * 0.05 * 0.04 * height);
  EXPECT_LT(r.volume, 9 * 8 * 0.05 * 0.04 * height);
}

TEST(Solid, PartsOnThePlatformAndAtTheImagesBorderAreClosed) {
  const CureModel model = figure_2_2();
  const Memory stack = lit_box(kGrid, {0, 0, 24, 20}, 0, 30);
  const MeshReport r = inspect(solid_mesh(stack, model));
  expect_closed(r);
  EXPECT_EQ(r.lower[2], 0);
  EXPECT_GT(r.lower[0], -0.025);
  EXPECT_LT(r.upper[0], 24 * 0.05 + 0.025);
}

TEST(Solid, AnyStackGivesAClosedSurface) {
  std::mt19937 random(7);
  const auto number = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const CureModel model =
      make_cure_model(linear_printer(1, 100), resin(576, 300), process(1000), 50);
  const int rounds = by_night() ? 60 : 24;
  for (int i = 0; i < rounds; ++i) {
    SCOPED_TRACE(i);
    Images images;
    images.grid = {number(1, 40), number(1, 50), number(1, 25), 50, 50, 50};
    const int share = number(1, 9);
    for (int n = 0; n < images.grid.layers; ++n) {
      Bytes pixels(static_cast<std::size_t>(images.grid.width_px * images.grid.height_px));
      for (auto& p : pixels) {
        p = number(0, 9) < share ? std::uint8_t{255} : static_cast<std::uint8_t>(number(0, 60));
      }
      images.slices.push_back(std::move(pixels));
    }
    const PixelBox all{0, 0, images.grid.width_px, images.grid.height_px};
    const Memory stack(std::move(images), all);
    for (const int reduce : {1, 2, 5}) {
      try {
        const TriangleMesh mesh = solid_mesh(stack, model, {reduce, nullptr});
        expect_closed(inspect(mesh));
      } catch (const InputError& e) {
        EXPECT_NE(std::string(e.what()).find("nothing"), std::string::npos);
      }
    }
  }
}

TEST(Solid, FilesHoldTheSameSurfaceAndDoNotDependOnThreads) {
  const TemporaryFolder folder;
  const Memory stack = lit_box({60, 90, 30, 50, 50, 50}, {10, 8, 50, 80}, 2, 20);
  const CureModel model = figure_2_2();
  ExecutionContext one;
  one.threads = 1;
  ExecutionContext four;
  four.threads = 4;
  const SolidReport r = write_solid(stack, model, folder / "a.stl", {}, one);
  write_solid(stack, model, folder / "b.stl", {}, four);
  EXPECT_EQ(read_file(folder / "a.stl"), read_file(folder / "b.stl"));
  write_solid(stack, model, folder / "a.ply");
  write_solid(stack, model, folder / "a.3mf");
  EXPECT_EQ(folder.count(), 4U);
  for (const char* name : {"a.stl", "a.ply", "a.3mf"}) {
    SCOPED_TRACE(name);
    const MeshReport m = inspect(read_mesh(folder / name));
    expect_closed(m);
    EXPECT_EQ(m.triangles, r.triangles);
    EXPECT_NEAR(m.volume, r.volume_mm3, 1e-5 * r.volume_mm3);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(m.upper[k], r.upper[k], 1e-6);
  }
}

TEST(Solid, RefusesWhatHasNoSurface) {
  const TemporaryFolder folder;
  const CureModel model = figure_2_2();
  const Memory dark = lit_box(kGrid, {6, 5, 14, 12}, 10, 11);
  EXPECT_THROW(write_solid(dark, model, folder / "a.stl"), InputError);
  const Memory stack = lit_box(kGrid, {6, 5, 14, 12}, 10, 20);
  EXPECT_THROW(write_solid(stack, model, folder / "a.obj"), InputError);
  EXPECT_THROW(write_solid(stack, model, folder / "a.stl", {0, nullptr}), InputError);
  EXPECT_THROW(write_solid(stack, model, folder / "none/a.stl"), DeviceError);
  EXPECT_EQ(folder.count(), 0U);
}

TriangleMesh sphere(const Point3& middle, double radius, int steps) {
  TriangleMesh mesh;
  const auto at = [&](int i, int j) {
    const double polar = std::numbers::pi * i / steps, round = std::numbers::pi * j / steps;
    return Point3{middle[0] + radius * std::sin(polar) * std::cos(round),
                  middle[1] + radius * std::sin(polar) * std::sin(round),
                  middle[2] + radius * std::cos(polar)};
  };
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; j < 2 * steps; ++j) mesh.vertices.push_back(at(i, j));
  }
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < 2 * steps; ++j) {
      const auto index = [&](int row, int column) {
        return static_cast<std::uint32_t>(row * 2 * steps + column % (2 * steps));
      };
      const std::uint32_t a = index(i, j), b = index(i + 1, j), c = index(i + 1, j + 1),
                          d = index(i, j + 1);
      if (i + 1 < steps) mesh.triangles.push_back({a, b, c});
      if (i > 0) mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

// Facets of 1/40 of a half turn stay within r (1 - cos(pi/80)^2) = 1.54e-3 r of the sphere.
TEST(MeshDistance, OfASphereIsKnown) {
  const MeshDistance distance(sphere({1, -2, 3}, 2.0, 40));
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> radius(0.0, 9.0);
  for (int i = 0; i < 500; ++i) {
    Point3 d{normal(random), normal(random), normal(random)};
    const double length = std::hypot(d[0], d[1], d[2]), r = radius(random);
    for (double& v : d) v *= r / length;
    EXPECT_NEAR(distance.to({1 + d[0], -2 + d[1], 3 + d[2]}), std::abs(r - 2.0), 3.2e-3) << r;
  }
}

// The grid finds what looking at each triangle alone finds.
TEST(MeshDistance, IsTheLeastOverAllTriangles) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-1, 1), small(-0.2, 0.2), wide(-3, 3);
  TriangleMesh soup;
  std::vector<MeshDistance> single;
  for (std::uint32_t i = 0; i < 60; ++i) {
    const Point3 p{place(random), place(random), 0.3 * place(random)};
    TriangleMesh one;
    for (int k = 0; k < 3; ++k) {
      one.vertices.push_back({p[0] + small(random), p[1] + small(random), p[2] + small(random)});
    }
    if (i % 10 == 0) one.vertices[2] = one.vertices[1];  // without area
    one.triangles = {{0, 1, 2}};
    append(soup, one);
    single.emplace_back(one);
  }
  const MeshDistance all(soup);
  for (int i = 0; i < 1000; ++i) {
    const Point3 p{wide(random), wide(random), wide(random)};
    double least = 1e300;
    for (const MeshDistance& one : single) least = std::min(least, one.to(p));
    EXPECT_NEAR(all.to(p), least, 1e-12);
  }
}

slicecorr::Setup small_setup() {
  slicecorr::Setup setup{linear_printer(1, 100), resin(576, 2000), process(1000)};
  setup.printer.width_px = 400;
  setup.printer.height_px = 300;
  return setup;
}

// A sphere of 3 mm, corrected: the print stays within about a voxel of it, where the uncorrected
// stack cures far through.
TEST(Solid, DistanceToTheDesignTellsCorrectedFromUncorrected) {
  const slicecorr::Setup setup = small_setup();
  const TriangleMesh design = sphere({0, 0, 0}, 1.5, 30);
  const MeshSlices target(design, setup.printer, {50, true, {}, {}});
  const CorrectedSlices corrected(target, setup);
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  const MeshDistance distance(on_plate(design, setup.printer));
  const TemporaryFolder folder;
  const SolidOptions options{1, &distance};
  const SolidReport good = write_solid(corrected, model, folder / "good.stl", options);
  const SolidReport bad = write_solid(target, model, folder / "bad.stl", options);
  // Slices and pixels are steps of 50 um with the design in the middle: half a step on the whole,
  // and never a voxel's diagonal, 87 um, and the levels' step.
  EXPECT_LT(good.distance_um.mean(), 25);
  EXPECT_LT(good.distance_um.greatest(), 100);
  EXPECT_GT(bad.distance_um.greatest(), 500);
  // All of the surface half a step off.
  EXPECT_NEAR(good.volume_mm3, inspect(design).volume, 4 * std::numbers::pi * 2.25 * 0.025);
}

TEST(Solid, Benchy) {
  const std::string path = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  const slicecorr::Setup setup = small_setup();
  Placement placement;
  placement.scale = by_night() ? 0.15 : 0.12;
  const TriangleMesh design = read_mesh(path, placement);
  const MeshSlices target(design, setup.printer, {50, true, {}, {}});
  const CorrectedSlices corrected(target, setup);
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  const MeshDistance distance(on_plate(design, setup.printer));
  const TemporaryFolder folder;
  const SolidReport r = write_solid(corrected, model, folder / "benchy.stl", {1, &distance});
  const MeshReport m = inspect(read_mesh(folder / "benchy.stl"));
  EXPECT_EQ(m.defects.open_edges, 0U);
  EXPECT_EQ(m.defects.misoriented_edges, 0U);
  EXPECT_LT(r.distance_um.mean(), 25);
  // What lacks is a shell as thick at every size: up to 5 % at a quarter of it, more of smaller ones.
  const double volume = 15550.5 * std::pow(placement.scale, 3);
  EXPECT_NEAR(r.volume_mm3, volume, 0.0125 / placement.scale * volume);
}

}  // namespace
}  // namespace slicecorr::test
