// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Our slices beside those of PrusaSlicer: what may differ is in peer_slicing.hpp.
#include <gtest/gtest.h>

#include "peer_slicing.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

class Peer : public ::testing::Test {
 protected:
  void SetUp() override {
    if (peer().empty()) GTEST_SKIP() << "prusa-slicer is not installed (scripts/setup --all)";
  }
  TemporaryFolder folder_;
};

/// Every `step`th of the models from `first` on, so much smaller.
void expect_explained(std::size_t first, std::size_t step, double smaller,
                      const std::string& folder) {
  for (std::size_t i = first; i < std::size(kPeerModels); i += step) {
    PeerModel m = kPeerModels[i];
    m.longest_mm /= smaller;
    SCOPED_TRACE(m.name);
    const std::string path = real_file(m.file);
    SLICECORR_NEEDS_FILE(path);
    const PeerFigures figures = compare_with_peer(m, path, folder);
    ASSERT_EQ(figures.says, "");
    const Figures& f = figures.figures;
    EXPECT_GE(f.more, 0);
    EXPECT_LE(f.more, 1);
    EXPECT_EQ(f.unexplained, 0U);
    EXPECT_EQ(f.off_unexplained, 0U);
  }
}
TEST_F(Peer, RealMeshesDifferByNoMoreThanTheRasterisersExplain) {
  expect_explained(2, 2, 3, folder_.path());
}
using PeerNight = Peer;
TEST_F(PeerNight, LargerRealMeshesAndOthersDifferByNoMoreEither) {
  expect_explained(0, 1, 1, folder_.path());
}

// Its own arrangement may put the part elsewhere; the comparisons ask for the exact place.
TEST_F(Peer, PutsThePartWhereAsked) {
  TriangleMesh mesh;
  add_box(mesh, {0, 0, 0}, {10, 6, 1});
  write_stl(folder_ / "part.stl", mesh);
  const PeerResult own = slice_with_peer(folder_ / "part.stl", folder_.path(), true, 1, 60, true);
  const PeerResult told = slice_with_peer(folder_ / "part.stl", folder_.path(), true);
  ASSERT_EQ(own.layers.size(), 10U) << own.says;
  ASSERT_EQ(told.layers.size(), 10U) << told.says;
  const auto b = middle(told.layers[5]);
  EXPECT_NEAR(b[0], kWidth / 2.0, 0.01);
  EXPECT_NEAR(b[1], kHeight / 2.0, 0.01);
}

// An SL1 file made elsewhere (PrusaSlicer 2.7.1) of a mesh at hand. An elephant foot compensation
// shrinks its lower layers; only the top one shows the design, with outlines closed by 5 um. Turned
// by a multiple of 90 degrees and mirrored; its place is found by the box of lit pixels.
TEST(PeerFile, TopLayerOfTheReferencePair) {
  const std::string sl1 = real_file("slices/sl1/UVtools_demo_file.sl1s");
  const std::string stl = real_file("meshes/clean/UVtools_demo_file.stl");
  SLICECORR_NEEDS_FILE(sl1);
  SLICECORR_NEEDS_FILE(stl);
  int width = 0, height = 0;
  const auto layers = read_sl1(sl1, width, height);
  ASSERT_EQ(layers.size(), 10U);
  ASSERT_EQ(width, 1620);
  ASSERT_EQ(height, 2560);
  const auto area_of = [](const Bytes& p) {
    return std::accumulate(p.begin(), p.end(), 0.0) / 255 * kPixel * kPixel;
  };
  const auto box_of = [&](const Bytes& pixels) {
    PixelBox b{width, height, 0, 0};
    for (int i = 0; i < width * height; ++i) {
      if (pixels[static_cast<std::size_t>(i)] < 128) continue;
      b = b.united({i % width, i / width, i % width + 1, i / width + 1});
    }
    return b;
  };
  Printer printer = display();
  printer.width_px = width;
  printer.height_px = height;
  double overlap = 0, area = 0;
  for (const double turn : {90.0, 270.0}) {
    Placement placement;
    placement.rotate_deg = {0, 0, turn};
    const TriangleMesh mesh = read_mesh(stl, placement);
    const Bytes ours = read_images(MeshSlices(mesh, printer, {kLayer * 1e3, true, {}, {}})).back();
    area = area_of(ours);
    for (const bool mirrored : {false, true}) {
      Bytes theirs = layers.back();
      for (int y = 0; y < height && mirrored; ++y) {
        const auto row = theirs.begin() + static_cast<std::ptrdiff_t>(y) * width;
        std::reverse(row, row + width);
      }
      const PixelBox p = box_of(ours), q = box_of(theirs);
      double both = 0, either = 0;
      for (int y = std::max(0, p.y0 - 4); y < std::min(height, p.y1 + 4); ++y) {
        for (int x = std::max(0, p.x0 - 4); x < std::min(width, p.x1 + 4); ++x) {
          const int u = std::clamp(x - p.x0 + q.x0, 0, width - 1);
          const int v = std::clamp(y - p.y0 + q.y0, 0, height - 1);
          const auto [low, high] = std::minmax(ours[static_cast<std::size_t>(y * width + x)],
                                               theirs[static_cast<std::size_t>(v * width + u)]);
          both += low;
          either += high;
        }
      }
      overlap = std::max(overlap, both / either);
    }
  }
  const double theirs = area_of(layers.back());
  EXPECT_NEAR(area, 1390.655, 0.1);
  // Closing by 5 um only adds.
  EXPECT_NEAR(theirs, area, 2e-4 * area);
  EXPECT_GT(overlap, 0.97);
}

}  // namespace
}  // namespace slicecorr::test
