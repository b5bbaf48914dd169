// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The eight ways in which the plate can lie in images: the corner table of the slicer that made it,
// the algebra of turns, and slices seen turned.
#include "slicecorr/orientation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "ladder.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/turned.hpp"

namespace slicecorr::test {
namespace {

std::vector<Orientation> all_orientations() {
  std::vector<Orientation> all;
  for (int i = 0; i < 8; ++i) all.push_back({(i & 1) != 0, (i & 2) != 0, (i & 4) != 0});
  return all;
}

std::vector<Turn> all_turns() {
  std::vector<Turn> all;
  for (int i = 0; i < 8; ++i) all.push_back({(i & 1) != 0, (i & 2) != 0, (i & 4) != 0});
  return all;
}

/// Where plate corner (0, 0) lands, as PrusaSlicer's exports have it: mirror x and y in the name.
struct CornerCase {
  Orientation orientation;
  bool right, bottom;
};
const std::vector<CornerCase> kCorners = {
    {{false, false, false}, false, true}, {{false, true, false}, true, true},
    {{false, false, true}, false, false}, {{false, true, true}, true, false},
    {{true, false, false}, true, true},   {{true, true, false}, false, true},
    {{true, false, true}, true, false},   {{true, true, true}, false, false},
};

constexpr Grid kPlate{7, 5, 3, 50, 40, 25};

TEST(Orientation, PlateCornerLandsWhereTheSlicerPutsIt) {
  ASSERT_EQ(kCorners.size(), 8U);
  for (const CornerCase& c : kCorners) {
    const Turn turn = turn_from_plate(c.orientation);
    const Grid image = turned(kPlate, turn);
    EXPECT_EQ(image.width_px, c.orientation.portrait ? 5 : 7);
    EXPECT_EQ(image.height_px, c.orientation.portrait ? 7 : 5);
    EXPECT_EQ(image.pixel_x_um, c.orientation.portrait ? 40 : 50);
    EXPECT_EQ(image.pixel_y_um, c.orientation.portrait ? 50 : 40);
    // Corner (0, 0) of the plate is the lower left pixel of its image.
    const Pixel at = turned(Pixel{0, 4}, turn, kPlate.width_px, kPlate.height_px);
    EXPECT_EQ(at, (Pixel{c.right ? image.width_px - 1 : 0, c.bottom ? image.height_px - 1 : 0}))
        << in_words(c.orientation);
    // And the other way: under that pixel's outer corner lies the plate's.
    const PlatePlace place = place_on_plate(image, c.orientation, c.right ? image.width_px : 0,
                                            c.bottom ? image.height_px : 0);
    EXPECT_EQ(place.x_mm, 0);
    EXPECT_EQ(place.y_mm, 0);
    const PlatePlace far = place_on_plate(image, c.orientation, c.right ? 0 : image.width_px,
                                          c.bottom ? 0 : image.height_px);
    EXPECT_DOUBLE_EQ(far.x_mm, 7 * 0.05);
    EXPECT_DOUBLE_EQ(far.y_mm, 5 * 0.04);
  }
}

// Portrait turns counter-clockwise: x of the plate runs up, y to the left.
TEST(Orientation, AxesRunAsDocumented) {
  const auto moved = [](const Orientation& o, int dx, int dy) {
    const Turn t = turn_from_plate(o);
    const Pixel a = turned(Pixel{3, 2}, t, 7, 5), b = turned(Pixel{3 + dx, 2 - dy}, t, 7, 5);
    return Pixel{b.x - a.x, b.y - a.y};
  };
  EXPECT_EQ(moved({}, 1, 0), (Pixel{1, 0}));
  EXPECT_EQ(moved({}, 0, 1), (Pixel{0, -1}));
  EXPECT_EQ(moved({true, false, false}, 1, 0), (Pixel{0, -1}));
  EXPECT_EQ(moved({true, false, false}, 0, 1), (Pixel{-1, 0}));
  EXPECT_EQ(moved({true, true, false}, 0, 1), (Pixel{1, 0}));
  EXPECT_EQ(moved({true, false, true}, 1, 0), (Pixel{0, 1}));
}

TEST(Orientation, EveryPixelHasOnePlaceAndComesBack) {
  for (const Orientation& o : all_orientations()) {
    const Turn t = turn_from_plate(o);
    const Grid image = turned(kPlate, t);
    std::vector<int> seen(35, 0);
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < 7; ++x) {
        const Pixel p = turned(Pixel{x, y}, t, 7, 5);
        ASSERT_TRUE(p.x >= 0 && p.x < image.width_px && p.y >= 0 && p.y < image.height_px);
        ++seen[static_cast<std::size_t>(p.y * image.width_px + p.x)];
        EXPECT_EQ(turned(p, t.inverse(), image.width_px, image.height_px), (Pixel{x, y}));
        // The middle of the pixel lies where it lay before.
        const PlatePlace a = place_on_plate(image, o, p.x + 0.5, p.y + 0.5);
        EXPECT_DOUBLE_EQ(a.x_mm, (x + 0.5) * 0.05);
        EXPECT_DOUBLE_EQ(a.y_mm, (5 - y - 0.5) * 0.04);
      }
    }
    EXPECT_THAT(seen, testing::Each(1));
    EXPECT_EQ(turned(turned(kPlate, t), t.inverse()).width_px, 7);
  }
}

TEST(Orientation, TurnsFormAGroup) {
  for (const Turn& a : all_turns()) {
    EXPECT_TRUE(a.then(a.inverse()).is_identity());
    EXPECT_TRUE(a.inverse().then(a).is_identity());
    for (const Turn& b : all_turns()) {
      EXPECT_EQ(a.then(b).mirrors(), a.mirrors() != b.mirrors());
      const Pixel step = turned(Pixel{4, 1}, a, 7, 5);
      const Grid image = turned(kPlate, a);
      EXPECT_EQ(turned(step, b, image.width_px, image.height_px),
                turned(Pixel{4, 1}, a.then(b), 7, 5));
    }
  }
  for (const Orientation& from : all_orientations()) {
    for (const Orientation& to : all_orientations()) {
      EXPECT_EQ(turned(from, turn_between(from, to)), to);
    }
  }
}

TEST(Orientation, Words) {
  EXPECT_EQ(in_words({}), "landscape");
  EXPECT_EQ(in_words({true, true, false}), "portrait, mirrored in x");
  EXPECT_EQ(in_words({true, false, true}), "portrait, mirrored in y");
  EXPECT_EQ(in_words({false, true, true}), "landscape, mirrored in x and y");
}

/// Random runs in a box; some slices are black.
MemorySlices some_slices(const Grid& grid, const PixelBox& box, unsigned seed) {
  std::mt19937 random(seed);
  MemorySlices slices(grid);
  for (int n = 0; n < grid.layers; ++n) {
    if (random() % 4 == 0) continue;
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        const unsigned r = random() % 8;
        slices.at(n, x, y) = static_cast<std::uint8_t>(r < 4 ? 0 : r < 7 ? 255 : random());
      }
    }
  }
  return slices;
}

class TurnedSlicesTest : public testing::Test {
 protected:
  std::string folder_ = std::filesystem::temp_directory_path().string();
};

// Wider and higher than a band of rows, and not by whole bands.
constexpr Grid kGrid{83, 61, 9, 50, 40, 25};
constexpr PixelBox kLit{5, 3, 77, 59};

TEST_F(TurnedSlicesTest, EveryVoxelIsWhereTheTurnPutsIt) {
  const MemorySlices source = some_slices(kGrid, kLit, 1);
  for (const Turn& t : all_turns()) {
    const TurnedSlices slices(source, t, folder_);
    const MemorySlices all(slices);
    EXPECT_EQ(all.grid().width_px, t.swap_axes ? 61 : 83);
    EXPECT_EQ(all.grid().pixel_x_um, t.swap_axes ? 40 : 50);
    for (int n = 0; n < kGrid.layers; ++n) {
      for (int y = 0; y < kGrid.height_px; ++y) {
        for (int x = 0; x < kGrid.width_px; ++x) {
          const Pixel p = turned(Pixel{x, y}, t, kGrid.width_px, kGrid.height_px);
          ASSERT_EQ(all.at(n, p.x, p.y), source.at(n, x, y)) << n << " " << x << " " << y;
        }
      }
    }
    const PixelBox lit = turned(source.bounds(), t, kGrid.width_px, kGrid.height_px);
    EXPECT_EQ(slices.bounds().x0, lit.x0);
    EXPECT_EQ(slices.bounds().y1, lit.y1);
    EXPECT_EQ(*slices.frame().orientation, turned(Orientation{}, t));
  }
}

TEST_F(TurnedSlicesTest, TurnedBackIsTheSource) {
  const MemorySlices source = some_slices(kGrid, kLit, 2);
  for (const Turn& t : all_turns()) {
    const TurnedSlices there(source, t, folder_);
    const TurnedSlices back(there, t.inverse(), folder_);
    EXPECT_EQ(MemorySlices(back), source);
    EXPECT_EQ(back.frame(), source.frame());
  }
}

TEST_F(TurnedSlicesTest, BoxesArePartsOfTheWholeImage) {
  const MemorySlices source = some_slices(kGrid, kLit, 3);
  std::mt19937 random(4);
  for (const Turn& t : all_turns()) {
    const TurnedSlices slices(source, t, folder_);
    const MemorySlices all(slices);
    const Grid& g = slices.grid();
    for (int i = 0; i < 30; ++i) {
      const auto pick = [&](int most) { return static_cast<int>(random() % unsigned(most)); };
      PixelBox box{pick(g.width_px), pick(g.height_px), 0, 0};
      box.x1 = box.x0 + 1 + pick(g.width_px - box.x0);
      box.y1 = box.y0 + 1 + pick(g.height_px - box.y0);
      int next = 0;
      slices.read_band(box, [&](int n, const std::uint8_t* rows) {
        ASSERT_EQ(n, next++);
        for (int y = box.y0; y < box.y1; ++y) {
          for (int x = box.x0; x < box.x1; ++x) {
            const int at = (y - box.y0) * box.width() + x - box.x0;
            ASSERT_EQ(rows ? rows[at] : 0, all.at(n, x, y));
          }
        }
      });
      EXPECT_EQ(next, g.layers);
    }
  }
}

TEST_F(TurnedSlicesTest, NothingLit) {
  const MemorySlices dark(kGrid);
  for (const Turn& t : all_turns()) {
    const TurnedSlices slices(dark, t, folder_);
    EXPECT_TRUE(slices.bounds().empty());
    int slices_read = 0;
    slices.read_band({2, 3, 5, 9}, [&](int, const std::uint8_t* rows) {
      EXPECT_EQ(rows, nullptr);
      ++slices_read;
    });
    EXPECT_EQ(slices_read, kGrid.layers);
  }
}

// More slices than are turned at a time.
TEST_F(TurnedSlicesTest, LongStacks) {
  const Grid grid{5, 3, 10000, 50, 50, 50};
  MemorySlices source(grid);
  for (int n = 0; n < grid.layers; n += 7)
    source.at(n, n % 5, n % 3) = static_cast<std::uint8_t>(n);
  const TurnedSlices slices(source, {true, true, false}, folder_);
  const MemorySlices all(slices);
  for (int n = 0; n < grid.layers; ++n) {
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 5; ++x) {
        const Pixel p = turned(Pixel{x, y}, {true, true, false}, 5, 3);
        ASSERT_EQ(all.at(n, p.x, p.y), source.at(n, x, y));
      }
    }
  }
}

TEST_F(TurnedSlicesTest, CancelledWhileTurning) {
  const MemorySlices source = some_slices(kGrid, kLit, 5);
  std::atomic<bool> stop{true};
  ExecutionContext context;
  context.cancel = &stop;
  EXPECT_THROW(TurnedSlices(source, {true, false, false}, folder_, context), Cancelled);
}

// A right-handed part: three arms of different lengths. Its print has them in the same places and
// encloses the same volume, whichever way its images lie.
TEST_F(TurnedSlicesTest, SolidIsTheRightWayRound) {
  const Grid grid{24, 16, 12, 50, 40, 50};
  MemorySlices source(grid);
  const auto fill = [&](int x0, int y0, int x1, int y1, int n0, int n1) {
    for (int n = n0; n < n1; ++n) {
      for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) source.at(n, x, y) = 255;
      }
    }
  };
  fill(4, 9, 16, 12, 0, 12);  // along x
  fill(4, 4, 7, 12, 0, 12);   // along y
  fill(13, 9, 16, 12, 4, 12);
  const CureModel model =
      make_cure_model(linear_printer(0, 100), resin(576, 100), process(1000), 50);
  const TriangleMesh plain = solid_mesh(source, model);
  const MeshReport expected = inspect(plain);
  ASSERT_GT(expected.volume, 0);
  const auto middle = [](const TriangleMesh& mesh) {
    Point3 sum{};
    for (const Point3& v : mesh.vertices) {
      for (std::size_t k = 0; k < 3; ++k)
        sum[k] += v[k] / static_cast<double>(mesh.vertices.size());
    }
    return sum;
  };
  for (const Turn& t : all_turns()) {
    const TurnedSlices slices(source, t, folder_);
    const TriangleMesh mesh = solid_mesh(slices, model);
    const MeshReport r = inspect(mesh);
    EXPECT_EQ(r.defects.open_edges, 0U);
    EXPECT_EQ(r.defects.misoriented_edges, 0U);
    // Facing outwards: a mirrored surface would have a negative volume. Cells are cut into
    // tetrahedra along one diagonal, which turns with the image: the surface between columns
    // may move by less than a pixel, what of the box it is alike.
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(r.lower[k], expected.lower[k], 1e-5) << k;
      EXPECT_NEAR(r.upper[k], expected.upper[k], 1e-5) << k;
    }
    EXPECT_NEAR(r.volume, expected.volume, 0.02 * expected.volume);
    for (std::size_t k = 0; k < 2; ++k) EXPECT_NEAR(middle(mesh)[k], middle(plain)[k], 0.03);
  }
}

// From the mesh to an archive for a portrait, mirrored display and back to the plate.
TEST_F(TurnedSlicesTest, ArchivesForADisplayThroughThePrograms) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(folder_) / ("display-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  // An L that no turn but the right one puts in its place.
  TriangleMesh mesh;
  add_box(mesh, {0, 0, 0}, {6, 1, 2});
  add_box(mesh, {0, 1, 0.5}, {1, 4, 2});
  write_stl((folder / "l.stl").string(), mesh);
  RunOptions options;
  options.folder = folder.string();
  const auto ok = [&](const std::string& arguments) {
    std::vector<std::string> command{SLICECORR_BIN_DIR "/slicecorr"};
    std::istringstream words(arguments);
    for (std::string w; words >> w;) command.push_back(w);
    const RunResult r = run_program(command, options);
    EXPECT_EQ(r.exit_code, 0) << arguments << "\n" << r.err;
    return r.out + r.err;
  };
  const std::string how =
      " --printer prusa-sl1s --resin benchy-resin --other-wavelength --ha-um 150 --mode layerwise --exposure-s 20";
  // Other archives know no edge heights.
  ok("slice l.stl -o t.uvj --surface slices --printer prusa-sl1s --layer-um 100 --center-mm 30,20");
  ok("slice l.stl -o t.sl1 --printer prusa-sl1s --layer-um 100 --center-mm 30,20");
  EXPECT_THAT(ok("info t.uvj"), testing::HasSubstr("2560 x 1620 pixels"));
  EXPECT_THAT(ok("info t.sl1"), testing::AllOf(testing::HasSubstr("1620 x 2560 pixels"),
                                               testing::HasSubstr("portrait, mirrored in x")));
  ok("correct t.uvj -o c.uvj" + how);
  ok("correct t.uvj -o c.sl1" + how);
  ok("correct t.sl1 -o d.sl1" + how);
  const auto figures = [&](const std::string& stacks) {
    auto json = nlohmann::json::parse(ok("verify " + stacks + " --json - --quiet"));
    json.erase("worst_pixel");  // the first in its image
    return json;
  };
  const auto expected = figures("c.uvj --target t.uvj");
  EXPECT_EQ(figures("c.sl1 --target t.uvj"), expected);
  EXPECT_EQ(figures("c.uvj --target t.sl1"), expected);
  EXPECT_EQ(figures("d.sl1 --target t.sl1"), expected);
  for (const char* stack : {"c.uvj", "c.sl1", "d.sl1"}) {
    const std::string said = ok(std::string("solid ") + stack +
                                " --design l.stl -o s.stl --center-mm 30,20 --json f.json");
    std::ifstream in(folder / "f.json");
    const auto json = nlohmann::json::parse(in);
    // Half a pixel, and what cures above the arm.
    EXPECT_NEAR(json["lower_mm"][0].get<double>(), 27, 0.03) << stack;
    EXPECT_NEAR(json["upper_mm"][0].get<double>(), 33, 0.03) << stack;
    EXPECT_NEAR(json["lower_mm"][1].get<double>(), 18, 0.03) << stack;
    EXPECT_LT(json["distance_um"]["max_abs"].get<double>(), 40) << stack;
  }
  EXPECT_THAT(ok("section c.sl1 --target t.uvj -o s.png"),
              testing::HasSubstr("along y of the plate at x = "));
  EXPECT_THAT(ok("section c.uvj --target t.uvj -o s.png"),
              testing::HasSubstr("along x of the plate at y = "));
  fs::remove_all(folder);
}

// An archive that does not say how it lies is taken for one of `slice`.
TEST(Orientation, UnknownIsTakenForThePlate) {
  const Grid grid{8, 8, 6, 50, 50, 50};
  MemorySlices source(grid);
  for (int n = 0; n < 6; ++n) source.at(n, 1, 1) = 255;
  MemorySlices unknown = source;
  unknown.set_frame({Turn{}, std::nullopt});
  const CureModel model =
      make_cure_model(linear_printer(0, 100), resin(576, 100), process(1000), 50);
  EXPECT_EQ(solid_mesh(unknown, model).vertices, solid_mesh(source, model).vertices);
}

}  // namespace
}  // namespace slicecorr::test
