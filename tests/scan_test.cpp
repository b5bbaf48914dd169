// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Scans of prints: poses that are known, distances in closed form, what is refused.
#include "slicecorr/scan.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <random>

#include "meshes.hpp"
#include "rounds.hpp"
#include "scan_lab.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;

/// The part as its pixels are, one surface.
const TriangleMesh& hook_mesh() {
  static const TriangleMesh mesh = [] {
    const MemorySlices part = hook_part();
    const slicecorr::Setup setup = lab_setup();
    return solid_mesh(MemorySlices(CorrectedSlices(part, setup)), models_of(setup, part));
  }();
  return mesh;
}

std::string refusal(const Scan& scan, const TriangleMesh& surface) {
  try {
    register_scan(scan, surface, MeshDistance(surface));
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

// Distance and side of a box in closed form, from inside, beside faces, edges and corners.
TEST(NearestPlace, OfABoxIsThatOfTheClosedForm) {
  const TriangleMesh mesh = box({0, 0, 0}, {3, 2, 1});
  const MeshDistance distance(mesh);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1, 4);
  for (int i = 0; i < 2000; ++i) {
    const Point3 p{any(random), any(random), any(random)};
    const Point3 high{3, 2, 1};
    double outside = 0, inside = 1e9;
    for (std::size_t k = 0; k < 3; ++k) {
      const double over = std::max({p[k] - high[k], -p[k], 0.0});
      outside += over * over;
      inside = std::min({inside, p[k], high[k] - p[k]});
    }
    const double expected = outside > 0 ? std::sqrt(outside) : -inside;
    const auto near = distance.nearest(p, 10);
    ASSERT_TRUE(near);
    EXPECT_NEAR(near->signed_mm, expected, 1e-12);
    EXPECT_NEAR(distance.to(p), std::abs(expected), 1e-12);
    EXPECT_NEAR(detail::length(detail::difference(p, near->point)), std::abs(expected), 1e-12);
    EXPECT_EQ(distance.nearest(p, 0.99 * std::abs(expected)).has_value(), false);
  }
}

// Samples lie on the surface, so the pose that was hidden leaves no distance at all.
TEST(RegisterScan, FindsAKnownPose) {
  std::mt19937 random(7);
  const MeshDistance distance(hook_mesh());
  for (int round = 0; round < rounds(1); ++round) {
    const Pose pose = random_pose(random);
    const Scan scan = scanned(hook_mesh(), pose, 6000, {}, random);
    const Registration r = register_scan(scan, hook_mesh(), distance);
    EXPECT_LT(pose_error_mm(pose, r.pose, hook_mesh()), 1e-6) << round;
    EXPECT_LT(r.median_um, 1e-3);
    EXPECT_EQ(r.within_share, 1);
  }
}

// 20 um of noise on 4000 points: along an axis about a sixth of them hold the part, to 20 um / sqrt(700) = 0.8 um, and turns,
// held half a millimetre from the middle, reach the corners 2 mm away, to 3 um; eight corners lie within three of them.
// The points of a stick beside the part pull only where no normals tell them from the wall: a twentieth of all within
// 200 um of one wall, with a tenth of the points, by Tukey's weights less than 20 um each.
TEST(RegisterScan, FindsAPoseByTwoThirdsWithNoiseAndDust) {
  std::mt19937 random(11);
  const MeshDistance distance(hook_mesh());
  for (int round = 0; round < rounds(1); ++round) {
    for (const bool normals : {true, false}) {
      const Pose pose = random_pose(random);
      const Scan scan = scanned(hook_mesh(), pose, 6000, {20, true, true, normals}, random);
      const Registration r = register_scan(scan, hook_mesh(), distance);
      EXPECT_LT(pose_error_mm(pose, r.pose, hook_mesh()), normals ? 0.01 : 0.02)
          << round << normals;
      EXPECT_EQ(r.sided, normals);
    }
  }
}

TEST(RegisterScan, SameBitsForAnyThreads) {
  std::mt19937 random(3);
  const MeshDistance distance(hook_mesh());
  const Scan scan = scanned(hook_mesh(), random_pose(random), 3000, {10, false, true}, random);
  ExecutionContext one, four;
  one.threads = 1;
  four.threads = 4;
  const Registration a = register_scan(scan, hook_mesh(), distance, one);
  const Registration b = register_scan(scan, hook_mesh(), distance, four);
  EXPECT_EQ(a.pose.turn, b.pose.turn);
  EXPECT_EQ(a.pose.shift, b.pose.shift);
  const Deviation d = deviation_from(scan, a.pose, hook_mesh(), distance, "design", 0.3, one);
  const Deviation e = deviation_from(scan, b.pose, hook_mesh(), distance, "design", 0.3, four);
  EXPECT_EQ(d.all.mean_um, e.all.mean_um);
  EXPECT_EQ(d.unseen_share, e.unseen_share);
}

TEST(RegisterScan, RefusesMirrorImagesAndOtherParts) {
  std::mt19937 random(5);
  TriangleMesh mirrored = hook_mesh();
  for (Point3& v : mirrored.vertices) v[1] = -v[1];
  const Pose pose = random_pose(random);
  EXPECT_THAT(refusal(scanned(inverted(mirrored), pose, 4000, {10}, random), hook_mesh()),
              HasSubstr("mirror image"));
  // As long from corner to corner.
  const TriangleMesh ball = sphere(1.9, 4);
  EXPECT_THAT(refusal(scanned(ball, pose, 4000, {10}, random), hook_mesh()),
              HasSubstr("another part"));
  EXPECT_EQ(refusal(scanned(hook_mesh(), pose, 4000, {10}, random), hook_mesh()), "");
}

// Halves that differ by a bump of 0.6 mm and by half a millimetre of a shelf, as a mirrored display makes them.
TEST(RegisterScan, RefusesMirrorImagesOfPartsThatAreNearlySymmetric) {
  const TriangleMesh part = box({-3, -2, 0}, {3, 2, 1}) + box({-3, -2, 1}, {-2, 2, 4}) +
                            box({2, -2, 1}, {3, 2, 4}) + box({-2, -2, 3}, {-1, 2, 4}) +
                            box({1.5, -2, 3}, {2, 2, 4}) + box({-0.3, -0.3, 1}, {0.3, 0.3, 1.6}) +
                            box({0.5, 1, 1}, {1.1, 1.6, 1.6});
  TriangleMesh mirrored = part;
  for (Point3& v : mirrored.vertices) v[0] = -v[0];
  mirrored = inverted(mirrored);
  std::mt19937 random(6);
  const Pose pose = random_pose(random);
  EXPECT_THAT(refusal(scanned(mirrored, pose, 6000, {8}, random), part), HasSubstr("mirror image"));
  EXPECT_EQ(refusal(scanned(part, pose, 6000, {8}, random), part), "");
  // A part that is symmetric fits both ways alike.
  const TriangleMesh even = box({-3, -2, 0}, {3, 2, 1}) + box({-3, -1, 1}, {3, 1, 2});
  EXPECT_EQ(refusal(scanned(even, pose, 6000, {8}, random), even), "");
}

// A box that printed 30 um too far towards the platform and 10 um too little towards the window.
TEST(ScanDeviation, IsThatOfTheClosedFormByClass) {
  const TriangleMesh design = box({0, 0, 1}, {4, 3, 2}) + box({0, 0, 0}, {4, 3, 0.4});
  const TriangleMesh printed = box({0, 0, 0.97}, {4, 3, 1.99}) + box({0, 0, 0}, {4, 3, 0.4});
  std::mt19937 random(1);
  const Scan scan = scanned(printed, {}, 40'000, {}, random);
  const Deviation d = deviation_from(scan, {}, design, MeshDistance(design), "design", 0.2);
  EXPECT_EQ(d.beside, 0U);
  const auto of = [&](const std::vector<DeviationFigures>& groups, std::string_view name) {
    for (const DeviationFigures& f : groups) {
      if (f.name == name) return f;
    }
    ADD_FAILURE() << name;
    return DeviationFigures{};
  };
  const DeviationFigures platform = of(d.facing, "facing the platform");
  // 12 mm² of the face, and walls of 14 by 0.03 mm below it whose nearest places are its edges, 15 um away in the mean.
  const double expected_um = (12 * 30 + 14 * 0.03 * 15) / (12 + 14 * 0.03);
  EXPECT_NEAR(platform.mean_um, expected_um, 0.2);
  EXPECT_NEAR(platform.largest_um, 30, 1e-6);
  // 12 mm² of 2 * 12 + 2 * 12 of faces and some walls, and the other faces towards the window are right.
  EXPECT_NEAR(of(d.facing, "facing the window").mean_um, -5, 0.2);
  EXPECT_NEAR(of(d.facing, "on the platform").mean_abs_um, 0, 1e-6);
  EXPECT_EQ(of(d.gaps, "0.5 to 1 mm").mean_um, platform.mean_um);
  EXPECT_EQ(of(d.gaps, "0.5 to 1 mm").points, platform.points);
  EXPECT_EQ(d.unseen_share, 0);
  ASSERT_FALSE(d.worst.empty());
  EXPECT_NEAR(d.worst[0].deviation_um, 30, 1e-6);
}

/// Each triangle is divided at a place of its own, again and again, so that some get small and thin.
TriangleMesh divided(TriangleMesh mesh, int times, std::mt19937& random) {
  std::uniform_real_distribution<double> even(0.05, 0.95);
  for (int k = 0; k < times; ++k) {
    const std::size_t count = mesh.triangles.size();
    for (std::size_t i = 0; i < count; ++i) {
      const auto [a, b, c] = mesh.triangles[i];
      const double u = even(random), v = even(random) * (1 - u);
      Point3 p{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        p[axis] = (1 - u - v) * mesh.vertices[a][axis] + u * mesh.vertices[b][axis] +
                  v * mesh.vertices[c][axis];
      }
      const auto middle = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(p);
      mesh.triangles[i] = {a, b, middle};
      mesh.triangles.push_back({b, c, middle});
      mesh.triangles.push_back({c, a, middle});
    }
  }
  return mesh;
}

// 24 triangles or 17,496 of very different sizes: the same scan.
TEST(ScanDeviation, AnotherTriangulationTellsTheSame) {
  const TriangleMesh design = box({0, 0, 1}, {4, 3, 2}) + box({0, 0, 0}, {4, 3, 0.4});
  const TriangleMesh printed = box({0, 0, 0.97}, {4, 3, 1.99}) + box({0, 0, 0}, {4, 3, 0.4});
  std::mt19937 random(1);
  const MeshDistance distance(design);
  const auto off = [&](const TriangleMesh& mesh) {
    const Scan scan = scanned(mesh, {}, 40'000, {}, random);
    return deviation_from(scan, {}, design, distance, "design", 0.2);
  };
  const Deviation one = off(printed), other = off(divided(printed, 6, random));
  // Deviations lie within 0 and 30 um, sd below 15: means of 40,000 places to 4 of 15 / 200.
  EXPECT_NEAR(one.all.mean_um, other.all.mean_um, 0.3);
  EXPECT_NEAR(one.all.mean_abs_um, other.all.mean_abs_um, 0.3);
  EXPECT_NEAR(one.all.p95_um, other.all.p95_um, 0.3);
  EXPECT_EQ(other.unseen_share, 0);
}

// What was not scanned is a share of the surface that is known: x above 2 of a box of 4 by 1 by 1.
TEST(ScanDeviation, SaysWhatWasNotSeen) {
  const TriangleMesh design = box({0, 0, 0}, {4, 1, 1});
  std::mt19937 random(1);
  Scan scan = scanned(design, {}, 40'000, {}, random);
  std::erase_if(scan.points, [](const Point3& p) { return p[0] > 2; });
  scan.normals.clear();
  const Deviation d = deviation_from(scan, {}, design, MeshDistance(design), "design", 0.2);
  // Half of all, but for what lies near to what was seen: within three times the mean distance of points, sqrt(18 mm² /
  // 20,000), all around four sides of 1 mm; a place at the other end sees no more. 20,000 samples are right to 0.4 %.
  EXPECT_LT(d.unseen_share, 0.5);
  EXPECT_GT(d.unseen_share, 0.5 - 4 * 3 * std::sqrt(18 / 20e3) / 18 - 0.005);
  ASSERT_FALSE(d.unseen.empty());
  EXPECT_GT(d.unseen[0].place[0], 2);
}

TEST(ReadScan, GuessesUnitsAndReadsPoints) {
  const TemporaryFolder folder;
  const TriangleMesh part = box({0, 0, 0}, {30, 20, 10});
  const SurfaceSamples samples = sample_surface(part, 500);
  const auto text = [&](double unit) {
    std::string ply =
        "ply\nformat ascii 1.0\nelement vertex 500\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
    std::string obj;
    for (const Point3& p : samples.points) {
      const std::string line = fmt::format("{} {} {}\n", p[0] / unit, p[1] / unit, p[2] / unit);
      ply += line;
      obj += "v " + line;
    }
    return std::pair(ply, obj);
  };
  for (const auto& [name, mm] :
       {std::pair("um", 1e-3), {"mm", 1.0}, {"cm", 10.0}, {"inch", 25.4}, {"m", 1e3}}) {
    const auto [ply, obj] = text(mm);
    for (const auto& [file, bytes] : {std::pair("s.ply", ply), {"s.obj", obj}}) {
      write_file(folder / file, to_bytes(bytes));
      const Scan scan = read_scan(folder / file, part);
      EXPECT_EQ(scan.unit, name);
      ASSERT_EQ(scan.points.size(), 500U);
      EXPECT_NEAR(scan.points[17][1], samples.points[17][1], 1e-9);
      EXPECT_EQ(scan.triangles, 0U);
    }
  }
  ScanReading inches;
  inches.unit = "inch";
  EXPECT_EQ(read_scan(folder / "s.ply", part, inches).unit, "inch");
  write_file(folder / "s.obj", to_bytes("v 0 0 0\nv 1 0 0\n"));
  EXPECT_THROW(read_scan(folder / "s.obj", part), InputError);
  write_file(folder / "s.ply", to_bytes(text(7e4).first));
  EXPECT_THROW(read_scan(folder / "s.ply", part), InputError);
  // As meshes such files are refused as before.
  EXPECT_THROW(read_mesh(folder / "s.ply"), InputError);
}

/// A box of 40 x 30 x 20 voxels in one of 60 x 50 x 40 whose corner voxels are half full along x.
float voxel(int x, int y, int z) {
  const bool inside = y >= 10 && y < 40 && z >= 10 && z < 30;
  if (!inside || x < 9 || x > 49) return 20;
  return x == 9 || x == 49 ? 110 : 200;
}

// Voxels of 100 um: faces across x lie in the middle of the half voxels, the others between full and empty ones.
void expect_box(const Scan& scan) {
  const detail::PointBox box(scan.points);
  EXPECT_NEAR(box.high[0] - box.low[0], 4.0, 0.02);
  EXPECT_NEAR(box.high[1] - box.low[1], 3.0, 0.02);
  EXPECT_NEAR(box.high[2] - box.low[2], 2.0, 0.02);
  EXPECT_THAT(scan.notes.at(0), HasSubstr("threshold 110"));
}

TEST(ReadScan, OfAVolumeIsItsSurface) {
  const TemporaryFolder folder;
  const TriangleMesh part = box({0, 0, 0}, {4, 3, 2});
  std::string header = "{'descr': '|u1', 'fortran_order': False, 'shape': (40, 50, 60), }";
  header.resize(117, ' ');
  std::string npy = std::string("\x93NUMPY\1\0\x76\0", 10) + header + "\n";
  ScanReading reading;
  reading.voxel_um = 100;
  std::filesystem::create_directory(folder / "slices");
  for (int z = 0; z < 40; ++z) {
    std::string pixels;
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 60; ++x)
        pixels += static_cast<char>(static_cast<unsigned char>(voxel(x, y, z)));
    }
    npy += pixels;
    // The plainest TIFF: one strip, no packing.
    std::string tiff("II*\0\x08\0\0\0\x08\0", 10);
    const auto entry = [&](int tag, int kind, std::uint32_t value) {
      for (const std::uint32_t number :
           {static_cast<std::uint32_t>(tag) | static_cast<std::uint32_t>(kind) << 16, 1U, value}) {
        for (int byte = 0; byte < 4; ++byte) tiff += static_cast<char>(number >> (8 * byte) & 255);
      }
    };
    entry(256, 3, 60);
    entry(257, 3, 50);
    entry(258, 3, 8);
    entry(259, 3, 1);
    entry(262, 3, 1);
    entry(273, 4, 110);
    entry(278, 3, 50);
    entry(279, 4, 3000);
    tiff += std::string(4, '\0');
    ASSERT_EQ(tiff.size(), 110U);
    write_file(folder / fmt::format("slices/{:03}.tif", z), to_bytes(tiff + pixels));
  }
  write_file(folder / "part.npy", to_bytes(npy));
  expect_box(read_scan(folder / "part.npy", part, reading));
  expect_box(read_scan(folder / "slices", part, reading));
  EXPECT_THROW(read_scan(folder / "part.npy", part), InputError);
  write_file(folder / "part.npy", to_bytes(npy.substr(0, npy.size() - 1)));
  EXPECT_THROW(read_scan(folder / "part.npy", part, reading), InputError);
  write_file(folder / "slices/017.tif", to_bytes("II*"));
  EXPECT_THROW(read_scan(folder / "slices", part, reading), InputError);
  std::filesystem::create_directory(folder / "empty");
  EXPECT_THROW(read_scan(folder / "empty", part, reading), InputError);
  reading.voxel_um = 5000;
  write_file(folder / "part.npy", to_bytes(npy));
  EXPECT_THROW(read_scan(folder / "part.npy", part, reading), InputError);
}

}  // namespace
}  // namespace slicecorr::test
