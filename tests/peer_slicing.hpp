// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file peer_slicing.hpp
/// Our slices beside those of PrusaSlicer (2.5, Debian's prusa-slicer), pixel by pixel.
///
/// Both cut at mid-layer, fill by the non-zero rule and centre the part's bounding box. What may
/// differ follows from how the two draw:
///
///  - *Position.* PrusaSlicer keeps corners and cut heights as floats (24 bits: about 2e-6 mm at 30
///    mm, rounded about three times) and cuts as integers of 1e-6 mm. Its rasteriser (AGG) then
///    rounds corners to 1/256 pixel, and where an edge crosses a border of a pixel rounds down to
///    1/256. On each axis that is at most 1/512 + 1/256 pixel, so an edge is off by at most
///    d = sqrt(2) 3/512 pixel + 6e-6 mm (1 + cot s), s the slope of its facet, which turns an error
///    of height into one of place. Ours is exact to double precision.
///  - *Coverage.* An edge of length l in a pixel that is off by d changes its area by at most d l.
///    PrusaSlicer shows floor(256 A), at most 255, ours is round(255 A): one level apart at most.
///    So grey values differ by at most 1 + 256 sum(d l), rounded.
///  - *Outlines that share a pixel.* PrusaSlicer paints outlines over each other, 1 - (1-a)(1-b)
///    for areas a and b that should add: k equal parts lose 1 - k a - (1-a)^k < 1/e of full light.
///  - *Antialiasing off.* PrusaSlicer lights a pixel of which half is covered, ours one whose
///  centre
///    is. A single straight edge gives the same unless the centre is within d of it. At corners
///    and in thin places the two rules differ, but only where an edge enters the pixel: no further
///    than 1/sqrt(2) + d from its centre.
///  - *The last layer.* PrusaSlicer leaves out a layer that is not full; ours is there when its
///    middle is inside.
#pragma once

#include <png.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <numeric>
#include <unordered_map>

#include "ladder.hpp"
#include "run_program.hpp"
#include "slicecorr/slice.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

inline constexpr double kPixel = 0.05, kLayer = 0.1;
inline constexpr int kWidth = 640, kHeight = 640;

inline std::string peer() {
  for (const char* path : {"/usr/bin/prusa-slicer", "/usr/local/bin/prusa-slicer"}) {
    if (::access(path, X_OK) == 0) return path;
  }
  return {};
}

inline Printer display() {
  Printer p;
  p.name = "peer";
  p.width_px = kWidth;
  p.height_px = kHeight;
  p.pixel_x_um = p.pixel_y_um = kPixel * 1e3;
  p.calibration = {{0, 1}, {255, 100}};
  return p;
}

inline Bytes decode(const Bytes& png, int& width, int& height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&image, png.data(), png.size())) return {};
  image.format = PNG_FORMAT_GRAY;
  Bytes pixels(PNG_IMAGE_SIZE(image));
  png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr);
  width = static_cast<int>(image.width);
  height = static_cast<int>(image.height);
  return pixels;
}

/// The layers of an SL1 archive: entries that end in five digits and .png.
inline std::vector<Bytes> read_sl1(const std::string& path, int& width, int& height) {
  std::map<std::string, Bytes> named;
  for (auto& [name, data] : unzip(path)) {
    const std::string stem = fs::path(name).stem().string();
    if (name.ends_with(".png") && name.find('/') == std::string::npos) {
      named[stem] = decode(data, width, height);
    }
  }
  std::vector<Bytes> layers;
  for (auto& [name, pixels] : named) layers.push_back(std::move(pixels));
  return layers;
}

struct PeerResult {
  int exit_code = 0;
  bool timed_out = false;
  double seconds = 0;
  std::string says;
  std::vector<Bytes> layers;
};

inline PeerResult slice_with_peer(const std::string& mesh, const std::string& folder,
                                  bool antialias, double scale = 1, int timeout_s = 60,
                                  bool automatic = false) {
  const std::string out = folder + "/peer.sl1";
  const auto text = [](double v) { return std::to_string(v); };
  const std::string x = text(kWidth * kPixel), y = text(kHeight * kPixel);
  RunOptions options;
  options.folder = folder;
  options.environment = {{"HOME", folder}};
  options.timeout = std::chrono::seconds(timeout_s);
  const auto start = Clock::now();
  std::vector<std::string> command{peer(),
                                   "--export-sla",
                                   "--layer-height",
                                   text(kLayer),
                                   "--initial-layer-height",
                                   text(kLayer),
                                   "--supports-enable=0",
                                   "--pad-enable=0",
                                   "--display-width",
                                   x,
                                   "--display-height",
                                   y,
                                   "--display-pixels-x",
                                   std::to_string(kWidth),
                                   "--display-pixels-y",
                                   std::to_string(kHeight),
                                   "--bed-shape",
                                   "0x0," + x + "x0," + x + "x" + y + ",0x" + y,
                                   "--display-orientation",
                                   "landscape",
                                   "--display-mirror-x=0",
                                   "--slice-closing-radius",
                                   "0",
                                   "--gamma-correction",
                                   antialias ? "1" : "0",
                                   "--scale",
                                   text(scale),
                                   "--output",
                                   out,
                                   mesh};
  if (!automatic) {
    command.insert(command.end() - 3,
                   {"--dont-arrange", "--center",
                    text(kWidth * kPixel / 2) + "," + text(kHeight * kPixel / 2)});
  }
  const RunResult r = run_program(command, options);
  PeerResult result{r.exit_code,
                    r.timed_out,
                    std::chrono::duration<double>(Clock::now() - start).count(),
                    r.err,
                    {}};
  if (fs::exists(out)) {
    int width = 0, height = 0;
    result.layers = read_sl1(out, width, height);
    fs::remove(out);
  }
  return result;
}

/// A piece of a contour, in pixels of the image, with what may be wrong with its place at the peer.
struct Edge {
  double ax, ay, bx, by, off;
  std::uint32_t outline;
};

/// The contours at the middle of layer n, cut as the headers say.
class Contours {
 public:
  explicit Contours(const TriangleMesh& mesh) : mesh_(mesh) {
    const MeshReport r = inspect(mesh);
    for (const Point3& v : mesh.vertices) {
      corners_.push_back({(v[0] - (r.lower[0] + r.upper[0]) / 2) / kPixel + kWidth / 2.0,
                          ((r.lower[1] + r.upper[1]) / 2 - v[1]) / kPixel + kHeight / 2.0,
                          (v[2] - r.lower[2]) / kLayer});
    }
  }
  std::vector<Edge> at(int n) const {
    const double z = n + 0.5;
    std::vector<Edge> edges;
    std::vector<std::uint32_t> parent;
    const auto root = [&](std::uint32_t i) {
      while (parent[i] != i) i = parent[i] = parent[parent[i]];
      return i;
    };
    std::unordered_map<std::uint64_t, std::uint32_t> first;  // outline of each cut mesh edge
    for (const auto& t : mesh_.triangles) {
      double place[2][2];
      std::uint64_t keys[2];
      int cuts = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = std::min(t[k], t[(k + 1) % 3]), b = std::max(t[k], t[(k + 1) % 3]);
        const Point3 &p = corners_[a], &q = corners_[b];
        if ((p[2] >= z) == (q[2] >= z)) continue;
        const double s = (z - p[2]) / (q[2] - p[2]);
        place[cuts][0] = p[0] + s * (q[0] - p[0]);
        place[cuts][1] = p[1] + s * (q[1] - p[1]);
        keys[cuts++] = static_cast<std::uint64_t>(a) << 32 | b;
      }
      if (cuts < 2) continue;
      const Point3 &o = corners_[t[0]], &p = corners_[t[1]], &q = corners_[t[2]];
      const double u[3] = {p[0] - o[0], p[1] - o[1], (p[2] - o[2]) * kLayer / kPixel};
      const double v[3] = {q[0] - o[0], q[1] - o[1], (q[2] - o[2]) * kLayer / kPixel};
      const double flat = std::abs(u[0] * v[1] - u[1] * v[0]);
      const double steep =
          std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]) + 1e-300;
      const double off = std::sqrt(2.0) * 3 / 512 + 6e-6 / kPixel * (1 + flat / steep);
      const auto index = static_cast<std::uint32_t>(edges.size());
      parent.push_back(index);
      edges.push_back({place[0][0], place[0][1], place[1][0], place[1][1], off, index});
      for (const std::uint64_t key : keys) {
        const auto [at, fresh] = first.try_emplace(key, index);
        if (!fresh) parent[root(index)] = root(at->second);
      }
    }
    for (Edge& e : edges) e.outline = root(e.outline);
    return edges;
  }

 private:
  const TriangleMesh& mesh_;
  std::vector<Point3> corners_;
};

/// Length of the part of an edge that lies in a square; negative when none does.
inline double length_in(const Edge& e, double x0, double y0, double x1, double y1) {
  const double dx = e.bx - e.ax, dy = e.by - e.ay;
  double from = 0, to = 1;
  const auto cut = [&](double start, double way, double low, double high) {
    if (way == 0) {
      if (start < low || start > high) to = -1;
      return;
    }
    const double s = (low - start) / way, t = (high - start) / way;
    from = std::max(from, std::min(s, t));
    to = std::min(to, std::max(s, t));
  };
  cut(e.ax, dx, x0, x1);
  cut(e.ay, dy, y0, y1);
  return to < from ? -1 : (to - from) * std::hypot(dx, dy);
}

/// What may differ in a pixel: area, and whether parts of several outlines are in it.
struct Slack {
  double area = 0, off = 0;
  std::uint32_t outline = 0;
  bool several = false;
};

inline std::unordered_map<int, Slack> slack_of(const std::vector<Edge>& edges) {
  std::unordered_map<int, Slack> slack;
  for (const Edge& e : edges) {
    const double d = e.off;
    const auto [left, right] = std::minmax(e.ax, e.bx);
    const auto [top, bottom] = std::minmax(e.ay, e.by);
    for (int y = std::max(0, static_cast<int>(std::floor(top - d)));
         y <= std::min<double>(kHeight - 1, bottom + d); ++y) {
      for (int x = std::max(0, static_cast<int>(std::floor(left - d)));
           x <= std::min<double>(kWidth - 1, right + d); ++x) {
        // The edge may come in from beside the pixel.
        const double length = length_in(e, x - d, y - d, x + 1 + d, y + 1 + d);
        if (length < 0) continue;
        const auto [at, fresh] = slack.try_emplace(y * kWidth + x);
        Slack& s = at->second;
        if (fresh) s.outline = e.outline;
        s.several |= s.outline != e.outline;
        s.area += d * (length + 2 * d);
        s.off = std::max(s.off, d);
      }
    }
  }
  return slack;
}

inline double distance_to(const Edge& e, double x, double y) {
  const double dx = e.bx - e.ax, dy = e.by - e.ay, square = dx * dx + dy * dy;
  const double t =
      square > 0 ? std::clamp(((x - e.ax) * dx + (y - e.ay) * dy) / square, 0.0, 1.0) : 0;
  return std::hypot(x - e.ax - t * dx, y - e.ay - t * dy);
}

struct Figures {
  int layers = 0, more = 0;
  std::uint64_t lit = 0;
  std::uint64_t grey = 0, one = 0, further = 0, several = 0, unexplained = 0;
  int greatest = 0;
  double ratio = 0;  ///< greatest share of its bound that a grey value uses, single outlines
  std::uint64_t off = 0, near = 0, corner = 0, off_unexplained = 0;
  double furthest = 0;
  double volume_ratio = 0, time_ratio = 0;
};

inline Figures compare(const TriangleMesh& mesh, const std::vector<Bytes>& on,
                       const std::vector<Bytes>& off) {
  Figures f;
  const auto start = Clock::now();
  const MeshSlices smooth(mesh, display(), {kLayer * 1e3, true, {}, {}});
  const auto ours = read_images(smooth);
  f.time_ratio = std::chrono::duration<double>(Clock::now() - start).count();
  const auto ours_off = read_images(MeshSlices(mesh, display(), {kLayer * 1e3, false, {}, {}}));
  f.layers = static_cast<int>(std::min(ours.size(), on.size()));
  f.more = static_cast<int>(ours.size()) - static_cast<int>(on.size());
  const Contours contours(mesh);
  double sum = 0, sum_peer = 0;
  for (std::size_t n = 0; n < static_cast<std::size_t>(f.layers); ++n) {
    const auto edges = contours.at(static_cast<int>(n));
    const auto slack = slack_of(edges);
    const std::uint8_t *const smooth_a = ours[n].data(), *const smooth_b = on[n].data(),
                              *const hard_a = ours_off[n].data(), *const hard_b = off[n].data();
    std::uint64_t level = 0, level_peer = 0;
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const int a = smooth_a[i], b = smooth_b[i];
      f.lit += a != 0;
      level += static_cast<std::uint64_t>(a);
      level_peer += static_cast<std::uint64_t>(b);
      const bool off_differs = hard_a[i] != hard_b[i];
      if (a == b && !off_differs) continue;
      const auto at = slack.find(i);
      const Slack s = at == slack.end() ? Slack{} : at->second;
      const double shared = s.several ? 256 / std::numbers::e : 0;
      const double bound = 1 + 256 * s.area;
      if (a != b) {
        ++f.grey;
        const int difference = std::abs(a - b);
        (difference == 1 ? f.one : f.further) += 1;
        if (difference <= std::floor(bound)) {
          if (!s.several) {
            f.greatest = std::max(f.greatest, difference);
            f.ratio = std::max(f.ratio, difference / bound);
          }
        } else if (difference <= bound + shared) {
          ++f.several;
        } else {
          ++f.unexplained;
        }
      }
      if (off_differs) {
        ++f.off;
        double nearest = 1e300;
        const double x = i % kWidth + 0.5, y = i / kWidth + 0.5;
        for (const Edge& e : edges) nearest = std::min(nearest, distance_to(e, x, y));
        f.furthest = std::max(f.furthest, nearest);
        // Half covered or not, within what coverage may differ by; and an edge in the pixel.
        const bool rule = (hard_b[i] ? a : 255 - a) + bound + shared >= 127.5;
        if (nearest <= s.off) {
          ++f.near;
        } else if (rule && nearest <= std::sqrt(0.5) + s.off) {
          ++f.corner;
        } else {
          ++f.off_unexplained;
        }
      }
    }
    sum += static_cast<double>(level);
    sum_peer += static_cast<double>(level_peer);
  }
  f.volume_ratio = sum_peer / sum;
  return f;
}

/// A mesh that both slice, scaled until its longest side is `longest_mm`.
struct PeerModel {
  const char *name, *file;
  double longest_mm;
};
inline constexpr PeerModel kPeerModels[] = {
    {"3DBenchy", "meshes/clean/3DBenchy.stl", 24},
    {"bunny", "meshes/clean/stanford_bunny_7k_closed.off", 22},
    {"femur", "meshes/clean/cgal_femur.off", 25},
    {"diamond TPMS", "meshes/clean/tpms_diamond_51.stl", 20},
    {"turbine", "meshes/clean/cgal_turbine.off", 20},
    {"lens cap", "meshes/clean/photonic3d_lenscap-36mm.stl", 25}};

struct PeerFigures {
  std::string says;  ///< why there is nothing to compare; else empty
  Figures figures;
  double peer_s = 0;  ///< how long the peer took, antialiased
};

inline PeerFigures compare_with_peer(const PeerModel& m, const std::string& path,
                                     const std::string& folder) {
  TriangleMesh mesh = read_mesh(path);
  const MeshReport r = inspect(mesh);
  double longest = 0;
  for (std::size_t k = 0; k < 3; ++k) longest = std::max(longest, r.upper[k] - r.lower[k]);
  for (Point3& v : mesh.vertices) {
    for (std::size_t k = 0; k < 3; ++k) v[k] = (v[k] - r.lower[k]) * m.longest_mm / longest;
  }
  const std::string file = folder + "/part.stl";
  write_stl(file, mesh);
  mesh = read_mesh(file);
  const PeerResult on = slice_with_peer(file, folder, true);
  const PeerResult off = slice_with_peer(file, folder, false);
  if (on.layers.empty()) return {"no layers: " + on.says, {}, 0};
  if (on.layers.size() != off.layers.size()) return {"layers differ: " + off.says, {}, 0};
  if (on.layers[0].size() != static_cast<std::size_t>(kWidth * kHeight)) {
    return {"images of another size", {}, 0};
  }
  return {"", compare(mesh, on.layers, off.layers), on.seconds};
}

/// Centre of light of an image, in pixels.
inline std::array<double, 2> middle(const Bytes& pixels) {
  double sum = 0, x = 0, y = 0;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    const double v = pixels[static_cast<std::size_t>(i)];
    sum += v;
    x += v * (i % kWidth + 0.5);
    y += v * (i / kWidth + 0.5);
  }
  return {x / sum, y / sum};
}

}  // namespace slicecorr::test
