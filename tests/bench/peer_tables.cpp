// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The tables of docs/slicing.md: real meshes as PrusaSlicer and our slicer make them.
/// scripts/peer-slicing puts them there.
///
///     peer_tables clean|dirty
#include <cstdio>

#include "peer_slicing.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

int clean() {
  const TemporaryFolder folder;
  std::printf(
      "| mesh | layers | lit pixels | grey differs | by 1 | by more | greatest (of its bound) | "
      "shared by outlines | off differs | centre on the edge | corners, thin places | furthest, px "
      "| unexplained | coverage, theirs / ours | time, theirs / ours "
      "|\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const PeerModel& m : kPeerModels) {
    const PeerFigures figures = compare_with_peer(m, real_file(m.file), folder.path());
    if (!figures.says.empty()) {
      std::fprintf(stderr, "%s: %s\n", m.name, figures.says.c_str());
      return 1;
    }
    const Figures& f = figures.figures;
    std::printf(
        "| %s | %d%s | %llu | %llu | %llu | %llu | %d (%.0f %%) | %llu | %llu | %llu | %llu | %.3f "
        "| %llu | %.6f | %.1f |\n",
        m.name, f.layers, f.more ? " + 1" : "", static_cast<unsigned long long>(f.lit),
        static_cast<unsigned long long>(f.grey), static_cast<unsigned long long>(f.one),
        static_cast<unsigned long long>(f.further), f.greatest, 100 * f.ratio,
        static_cast<unsigned long long>(f.several), static_cast<unsigned long long>(f.off),
        static_cast<unsigned long long>(f.near), static_cast<unsigned long long>(f.corner),
        f.furthest, static_cast<unsigned long long>(f.unexplained + f.off_unexplained),
        f.volume_ratio, figures.peer_s / f.time_ratio);
  }
  return 0;
}

int dirty() {
  const TemporaryFolder folder;
  std::printf(
      "| mesh | defects | PrusaSlicer | ours | lit area, theirs / ours |\n"
      "|---|---|---|---|---|\n");
  for (const fs::path path : real_files("meshes/dirty")) {
    std::string ours_says, defects = "-", peer_says, ratio = "-", file = path.string();
    double scale = 1, a = 0, b = 0;
    try {
      const MeshReport r = inspect(read_mesh(file));
      if (r.defects.any()) defects = describe(r.defects);
      double longest = 0;
      for (std::size_t k = 0; k < 3; ++k) longest = std::max(longest, r.upper[k] - r.lower[k]);
      Placement placement;
      placement.scale = scale = 20 / longest;
      const TriangleMesh mesh = read_mesh(file, placement);
      // PrusaSlicer reads STL and OBJ.
      if (path.extension() == ".ply" || path.extension() == ".off") {
        file = folder / "part.stl";
        write_stl(file, mesh);
        scale = 1;
        peer_says = "as STL: ";
      }
      const MeshSlices slices(mesh, display(), {kLayer * 1e3, true, {}, {}});
      const auto ours = read_images(slices);
      for (const Bytes& layer : ours) a += std::accumulate(layer.begin(), layer.end(), 0.0);
      ours_says = std::to_string(ours.size()) + " layers";
      const SliceReport& report = slices.report();
      if (report.bridges) {
        ours_says += ", " + std::to_string(report.bridges) + " bridges";
      }
      if (report.turned_triangles) {
        ours_says += ", " + std::to_string(report.turned_triangles) + " triangles turned";
      }
    } catch (const InputError& e) {
      ours_says = e.what();
      const std::size_t at = ours_says.find(path.string() + ": ");
      if (at != std::string::npos) ours_says.erase(at, path.string().size() + 2);
      ours_says = "refused: " + ours_says;
    }
    const PeerResult p = slice_with_peer(file, folder.path(), true, scale, 10);
    for (const Bytes& layer : p.layers) b += std::accumulate(layer.begin(), layer.end(), 0.0);
    if (p.timed_out) {
      peer_says += "no end after 10 s";
    } else if (p.layers.empty()) {
      peer_says += "no file, exit code " + std::to_string(p.exit_code);
    } else {
      peer_says += std::to_string(p.layers.size()) + " layers";
    }
    if (a > 0 && b > 0) ratio = std::to_string(b / a);
    std::printf("| %s | %s | %s | %s | %s |\n", path.filename().c_str(), defects.c_str(),
                peer_says.c_str(), ours_says.c_str(), ratio.c_str());
    std::fflush(stdout);
  }
  return 0;
}

int run(const std::string& table) {
  if (peer().empty()) {
    std::fprintf(stderr, "prusa-slicer is not installed\n");
    return 77;
  }
  if (table == "clean") return clean();
  if (table == "dirty") return dirty();
  std::fprintf(stderr, "usage: peer_tables clean|dirty\n");
  return 2;
}

}  // namespace
}  // namespace slicecorr::test

int main(int argc, char** argv) { return slicecorr::test::run(argc == 2 ? argv[1] : ""); }
