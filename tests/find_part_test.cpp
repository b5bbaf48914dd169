// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts in archives that a rasteriser of the test's own made of them: random boxes, anywhere, turned and
/// mirrored, with supports; what is left alone outside of them against a growth voxel by voxel.
#include "slicecorr/find_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "memory_slices.hpp"
#include "meshes.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

constexpr double kSideUm = 100, kSliceUm = 50;

/// A box of a part, mm.
struct Box {
  Point3 low, high;
};
using Boxes = std::vector<Box>;

TriangleMesh mesh_of(const Boxes& boxes) {
  TriangleMesh mesh;
  for (const Box& b : boxes) append(mesh, box(b.low, b.high));
  return mesh;
}

Box hull(const Boxes& boxes) {
  Box all = boxes.front();
  for (const Box& b : boxes) {
    for (std::size_t k = 0; k < 3; ++k) {
      all.low[k] = std::min(all.low[k], b.low[k]);
      all.high[k] = std::max(all.high[k], b.high[k]);
    }
  }
  return all;
}

/// Mirrored in x, then turned by quarters counter-clockwise, then moved so that its least corner is at
/// `low`.
Boxes put(Boxes boxes, bool mirrored, int quarters, const Point3& low) {
  for (Box& b : boxes) {
    if (mirrored) {
      b = {{-b.high[0], b.low[1], b.low[2]}, {-b.low[0], b.high[1], b.high[2]}};
    }
    for (int q = 0; q < quarters; ++q) {
      b = {{-b.high[1], b.low[0], b.low[2]}, {-b.low[1], b.high[0], b.high[2]}};
    }
  }
  const Box all = hull(boxes);
  for (Box& b : boxes) {
    for (std::size_t k = 0; k < 3; ++k) {
      b.low[k] += low[k] - all.low[k];
      b.high[k] += low[k] - all.low[k];
    }
  }
  return boxes;
}

/// Lights the voxels whose middles lie in one of the boxes, which are mm of the plate and above the platform.
void light(MemorySlices& slices, const Boxes& boxes, std::uint8_t value = 255) {
  const Grid& g = slices.grid();
  for (int n = 0; n < g.layers; ++n) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) {
        const Point3 p{(x + 0.5) * kSideUm * 1e-3, (g.height_px - y - 0.5) * kSideUm * 1e-3,
                       (n + 0.5) * kSliceUm * 1e-3};
        for (const Box& b : boxes) {
          bool inside = true;
          for (std::size_t k = 0; k < 3; ++k) inside &= p[k] > b.low[k] && p[k] < b.high[k];
          if (inside) slices.at(n, x, y) = value;
        }
      }
    }
  }
}

/// Boxes that hang together, as no turn nor mirror leaves them.
Boxes random_part(std::mt19937& random) {
  const auto in = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  const double x = in(1.5, 3.0), y = in(1.0, 2.5), z = in(0.4, 1.2);
  return {{{0, 0, 0}, {x, y, z}},
          {{0, 0, 0}, {in(0.3, 0.7), in(0.3, 0.6), z + in(0.5, 1.5)}},
          {{x - 0.1, y * 0.6, z * 0.3}, {x + in(0.4, 1.0), y * 0.9, z * 0.9}}};
}

/// Pillars from the platform up to below something.
Boxes supports_below(const Boxes& part, std::mt19937& random) {
  const Box all = hull(part);
  Boxes pillars{
      {{all.low[0] - 0.4, all.low[1] - 0.4, 0}, {all.high[0] + 0.4, all.high[1] + 0.4, 0.2}}};
  for (int i = 0; i < 6; ++i) {
    const auto at = [&](std::size_t k) {
      return std::uniform_real_distribution<double>(part[0].low[k], part[0].high[k] - 0.3)(random);
    };
    const double x = at(0), y = at(1);
    pillars.push_back({{x, y, 0}, {x + 0.3, y + 0.3, part[0].low[2]}});
  }
  return pillars;
}

/// Faces between lit and dark voxels.
double faces_of(const MemorySlices& slices) {
  const Grid& g = slices.grid();
  int faces = 0;
  for (int n = 0; n + 1 < g.layers; ++n) {
    for (int y = 0; y + 1 < g.height_px; ++y) {
      for (int x = 0; x + 1 < g.width_px; ++x) {
        const std::uint8_t here = slices.at(n, x, y);
        faces += (here != slices.at(n, x + 1, y)) + (here != slices.at(n, x, y + 1)) +
                 (here != slices.at(n + 1, x, y));
      }
    }
  }
  return faces;
}

Grid plate_of(int width, int height, int layers) {
  return {width, height, layers, kSideUm, kSideUm, kSliceUm};
}

TEST(FindPart, AnywhereInAllTurns) {
  std::mt19937 random(58);
  for (int round = 0; round < rounds(16); ++round) {
    SCOPED_TRACE(round);
    const Boxes part = random_part(random);
    const bool mirrored = (round & 4) != 0;
    const int quarters = round & 3;
    const auto in = [&](double a, double b) {
      return std::uniform_real_distribution<double>(a, b)(random);
    };
    const Boxes there =
        put(part, mirrored, quarters, {in(0.6, 7), in(0.6, 4), round % 5 == 0 ? 0 : in(0.5, 2)});
    MemorySlices archive(plate_of(120, 90, 100));
    const bool lifted = hull(there).low[2] > 0;
    if (lifted) light(archive, supports_below(there, random));
    light(archive, there);
    const SoughtPart sought(mesh_of(part), archive.grid());
    const auto places = sought.find(archive);
    ASSERT_EQ(places.size(), 1U);
    const PartPlace& p = places[0];
    // Six pillars touch it, over at most 4 x 4 pixels each of a thousand faces or more; the rest is
    // rounding at edges.
    MemorySlices alone(archive.grid());
    light(alone, there);
    EXPECT_GT(faces_of(alone), 960);
    EXPECT_GT(p.agreement, 0.85);
    const Box all = hull(there);
    // A place is whole voxels: half a voxel off at most; and its box is up to one larger than the part.
    EXPECT_NEAR(p.box.x0, all.low[0] * 10, 1.501);
    EXPECT_NEAR(p.box.x1, all.high[0] * 10, 1.501);
    EXPECT_NEAR(90 - p.box.y1, all.low[1] * 10, 1.501);
    EXPECT_NEAR(p.first_slice, all.low[2] * 20, 1.001);
    const std::string words = in_words(p, archive.grid(), archive.frame());
    EXPECT_EQ(words.find("mirrored") != words.npos, mirrored) << words;
    const std::string turned =
        quarters ? "turned by " + std::to_string(90 * quarters) + " degrees" : "";
    EXPECT_THAT(words, HasSubstr(turned));
    EXPECT_EQ(words.find("turned") != words.npos, quarters != 0) << words;
    EXPECT_EQ(words.find("on the platform") != words.npos, p.first_slice <= 0) << words;

    // The same for any number of threads.
    ExecutionContext one;
    one.threads = 1;
    const auto again = sought.find(archive, one);
    ASSERT_EQ(again.size(), 1U);
    EXPECT_EQ(again[0].turn, p.turn);
    EXPECT_EQ(again[0].first_slice, p.first_slice);
    EXPECT_EQ(again[0].agreement, p.agreement);

    // What lies outside: everything but what is next to a lit voxel of the part at this place.
    const auto part_slices = std::make_shared<const SoughtPart>(mesh_of(part), archive.grid());
    const OutsideParts outside(archive, {{part_slices, p}});
    MemorySlices lit(archive.grid());
    part_slices->read_band(p, {0, 0, 120, 90}, [&](int n, const std::uint8_t* rows) {
      if (!rows || n + p.first_slice < 0 || n + p.first_slice >= 100) return;
      for (int i = 0; i < 120 * 90; ++i) lit.at(n + p.first_slice, i % 120, i / 120) = rows[i];
    });
    MemorySlices expected = archive;
    double sum = 0;
    for (int n = 0; n < 100; ++n) {
      for (int y = 0; y < 90; ++y) {
        for (int x = 0; x < 120; ++x) {
          bool near = false;
          for (int m = std::max(0, n - 1); m <= std::min(99, n + 1); ++m) {
            for (int v = std::max(0, y - 1); v <= std::min(89, y + 1); ++v) {
              for (int u = std::max(0, x - 1); u <= std::min(119, x + 1); ++u) {
                near |= lit.at(m, u, v) != 0;
              }
            }
          }
          if (near) expected.at(n, x, y) = 0;
          sum += expected.at(n, x, y);
        }
      }
    }
    EXPECT_EQ(MemorySlices(outside), expected);
    EXPECT_NEAR(outside.volume_mm3(), sum / 255 * 0.1 * 0.1 * 0.05, 1e-9);
    // Nothing of the part itself is left alone but crumbs of rounding.
    int left = 0;
    for (int n = 0; n < 100; ++n) {
      for (int y = 0; y < 90; ++y) {
        for (int x = 0; x < 120; ++x) left += alone.at(n, x, y) && expected.at(n, x, y);
      }
    }
    EXPECT_EQ(left, 0);
    EXPECT_EQ(lifted, outside.volume_mm3() > 0);
  }
}

TEST(FindPart, AllCopies) {
  std::mt19937 random(5);
  const Boxes part = random_part(random);
  MemorySlices archive(plate_of(200, 160, 90));
  const std::vector<std::tuple<bool, int, Point3>> wanted{{false, 0, {1.03, 1.21, 0.5}},
                                                          {false, 0, {7.2, 1.4, 1.0}},
                                                          {false, 1, {1.5, 8.37, 0.5}},
                                                          {false, 2, {12.2, 9.0, 0.52}}};
  for (const auto& [mirrored, quarters, low] : wanted) {
    const Boxes there = put(part, mirrored, quarters, low);
    light(archive, supports_below(there, random));
    light(archive, there);
  }
  // Another part beside them.
  light(archive, {{{13, 2, 0}, {17, 5, 2}}});
  const auto places = SoughtPart(mesh_of(part), archive.grid()).find(archive);
  ASSERT_EQ(places.size(), 4U);
  for (const auto& [mirrored, quarters, low] : wanted) {
    const double x = low[0] * 10, y = low[1] * 10, z = low[2] * 20;
    EXPECT_EQ(std::count_if(places.begin(), places.end(),
                            [&](const PartPlace& p) {
                              return std::abs(p.box.x0 - x) < 1.51 &&
                                     std::abs(160 - p.box.y1 - y) < 1.51 &&
                                     std::abs(p.first_slice - z) < 1.01;
                            }),
              1);
  }
}

TEST(FindPart, IsNotWhereItIsNot) {
  std::mt19937 random(12);
  for (int round = 0; round < rounds(4); ++round) {
    SCOPED_TRACE(round);
    const Boxes part = random_part(random);
    const Boxes other{{{0, 0, 0}, {3, 0.5, 0.6}}, {{1.2, 0, 0}, {1.7, 2.5, 0.6}}};
    const auto agreement = [&](const Boxes& lit, const Boxes& sought) {
      MemorySlices archive(plate_of(120, 90, 100));
      light(archive, lit);
      const auto places = SoughtPart(mesh_of(sought), archive.grid()).find(archive);
      return places.empty() ? 0.0 : places[0].agreement;
    };
    const Boxes there = put(part, false, 0, {3, 3, 1});
    EXPECT_GT(agreement(there, part), 0.97);
    // Another part; a block that holds it; the part twice as large, and a tenth.
    EXPECT_LT(agreement(there, other), kLeastAgreement);
    EXPECT_LT(agreement({{{1, 1, 0}, {11, 8, 5}}}, part), kLeastAgreement);
    Boxes larger = part;
    for (Box& b : larger) {
      for (std::size_t k = 0; k < 3; ++k) b.low[k] *= 1.2, b.high[k] *= 1.2;
    }
    EXPECT_LT(agreement(there, larger), kLeastAgreement);
    // Turned by other than quarters.
    MemorySlices archive(plate_of(120, 90, 100));
    light(archive, there);
    const auto places = SoughtPart(turned(mesh_of(part), 0, 0.5), archive.grid()).find(archive);
    EXPECT_LT(places.empty() ? 0.0 : places[0].agreement, kLeastAgreement);
  }
}

TEST(FindPart, RefusesWhatCanNotBeThere) {
  const Boxes part{{{0, 0, 0}, {2, 1, 1}}};
  const auto why = [&](const Grid& grid) {
    try {
      SoughtPart(mesh_of(part), grid);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("no error");
  };
  EXPECT_THAT(why(plate_of(15, 8, 40)), HasSubstr("beyond the display"));
  EXPECT_THAT(why(plate_of(40, 30, 10)), HasSubstr("is 20 slices high; the archive has 10"));
  // Fits turned by a quarter only.
  EXPECT_EQ(why(plate_of(12, 30, 40)), "no error");
  MemorySlices archive(plate_of(12, 30, 40));
  EXPECT_TRUE(SoughtPart(mesh_of(part), archive.grid()).find(archive).empty());
  light(archive, put(part, false, 1, {0.1, 0.5, 0.5}));
  const auto places = SoughtPart(mesh_of(part), archive.grid()).find(archive);
  ASSERT_EQ(places.size(), 1U);
  EXPECT_EQ(places[0].agreement, 1.0);
  EXPECT_EQ(places[0].first_slice, 10);
  EXPECT_EQ(places[0].box.x0, 1);
  EXPECT_EQ(places[0].box.y0, 5);
}

/// As the plate lies in the images.
TEST(FindPart, TellsPlacesOfThePlate) {
  std::mt19937 random(3);
  const Boxes part = random_part(random);
  MemorySlices plate(plate_of(120, 90, 80));
  light(plate, put(part, false, 0, {2, 1, 0.5}));
  const Box all = hull(put(part, false, 0, {2, 1, 0.5}));
  for (const bool portrait : {false, true}) {
    for (const bool mirror_x : {false, true}) {
      const Orientation o{portrait, mirror_x, false};
      const Turn turn = turn_from_plate(o);
      MemorySlices archive(turned(plate.grid(), turn));
      archive.set_frame({Turn{}, o});
      for (int n = 0; n < 80; ++n) {
        for (int y = 0; y < 90; ++y) {
          for (int x = 0; x < 120; ++x) {
            const Pixel p = turned(Pixel{x, y}, turn, 120, 90);
            archive.at(n, p.x, p.y) = plate.at(n, x, y);
          }
        }
      }
      const auto places = SoughtPart(mesh_of(part), archive.grid()).find(archive);
      ASSERT_EQ(places.size(), 1U);
      const std::string words = in_words(places[0], archive.grid(), archive.frame());
      EXPECT_THAT(words, ::testing::Not(HasSubstr("turned")));
      EXPECT_THAT(words, ::testing::Not(HasSubstr("mirrored")));
      double x = 0, y = 0;
      ASSERT_EQ(std::sscanf(words.c_str(), "x %lf, y %lf mm", &x, &y), 2) << words;
      EXPECT_NEAR(x, 0.5 * (all.low[0] + all.high[0]), 0.11);
      EXPECT_NEAR(y, 0.5 * (all.low[1] + all.high[1]), 0.11);
    }
  }
}

/// Cells of several pixels and slices on the way: a part whose middle is far from any cell's.
TEST(FindPart, OnALargePlate) {
  std::mt19937 random(9);
  const Boxes small = random_part(random);
  Boxes part = small;
  for (Box& b : part) {
    for (std::size_t k = 0; k < 2; ++k) b.low[k] *= 8, b.high[k] *= 8;
  }
  MemorySlices archive(plate_of(700, 400, 120));
  const Boxes there = put(part, true, 1, {31.37, 2.44, 1.23});
  light(archive, supports_below(there, random));
  light(archive, there);
  light(archive, {{{1, 1, 0}, {20, 20, 5}}});
  const auto places = SoughtPart(mesh_of(part), archive.grid()).find(archive);
  ASSERT_EQ(places.size(), 1U);
  EXPECT_GT(places[0].agreement, 0.97);
  const Box all = hull(there);
  EXPECT_NEAR(places[0].box.x0, all.low[0] * 10, 1.501);
  EXPECT_NEAR(400 - places[0].box.y1, all.low[1] * 10, 1.501);
  EXPECT_NEAR(places[0].first_slice, all.low[2] * 20, 1.001);
}

}  // namespace
}  // namespace slicecorr::test
