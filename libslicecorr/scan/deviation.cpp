// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "parallel/silent.hpp"
#include "scan/point_tree.hpp"
#include "scan/upright.hpp"
#include "scan/vectors.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr {

using namespace detail;

namespace {

/// Faces that are steeper than this are walls: 60 degrees from the plane of the plate.
constexpr double kWall = 0.5;
/// A face so near to the platform lies on it, mm.
constexpr double kOnPlatformMm = 0.02;
constexpr int kSlabs = 10;
constexpr std::size_t kWorst = 10, kUnseenPlaces = 10, kCoverSamples = 20'000;
constexpr double kGapEdgesMm[] = {0.2, 0.5, 1, 2, 5};
constexpr std::size_t kGapClasses = std::size(kGapEdgesMm) + 1;

/// Numbers of one class.
class Group {
 public:
  void add(double um) { off_um_.push_back(um); }
  DeviationFigures figures(std::string name) {
    DeviationFigures f;
    f.name = std::move(name);
    f.points = off_um_.size();
    if (off_um_.empty()) return f;
    for (double& um : off_um_) {
      f.mean_um += um;
      um = std::abs(um);
      f.mean_abs_um += um;
      f.largest_um = std::max(f.largest_um, um);
    }
    f.mean_um /= static_cast<double>(f.points);
    f.mean_abs_um /= static_cast<double>(f.points);
    f.p95_um = value_at(off_um_, 0.95);
    return f;
  }

 private:
  std::vector<double> off_um_;
};

enum Facing : std::size_t { sideways, to_platform, to_window, on_platform, kFacings };
constexpr std::string_view kFacingNames[] = {"sideways", "facing the platform", "facing the window",
                                             "on the platform"};

Facing facing_of(const NearestPlace& place) {
  if (place.normal[2] >= kWall) return to_window;
  if (place.normal[2] > -kWall) return sideways;
  return place.point[2] < kOnPlatformMm ? on_platform : to_platform;
}

/// What is measured of a point.
struct Measured {
  NearestPlace place;
  Facing facing = sideways;
  double gap_mm = -1;  ///< of faces towards the platform
  bool near = false;
};

std::vector<Measured> measure(const std::vector<Point3>& points, const Pose& pose,
                              const TriangleMesh& surface, const MeshDistance& distance,
                              double reach_mm, const ExecutionContext& context) {
  const UprightLines lines(surface);
  std::vector<Measured> found(points.size());
  constexpr std::size_t chunk_points = 1024;
  parallel_for(context, "deviations", (points.size() + chunk_points - 1) / chunk_points,
               [&](std::size_t chunk) {
                 const std::size_t end = std::min(points.size(), (chunk + 1) * chunk_points);
                 for (std::size_t i = chunk * chunk_points; i < end; ++i) {
                   const auto place = distance.nearest(pose.of(points[i]), reach_mm);
                   if (!place) continue;
                   Measured& m = found[i];
                   m = {*place, facing_of(*place), -1, true};
                   if (m.facing != to_platform) continue;
                   Point3 from = place->point;
                   from[2] -= 1e-3;
                   m.gap_mm = from[2] - std::max(lines.below(from).value_or(0.0), 0.0);
                 }
               });
  return found;
}

/// The largest deviations, each apart from the others.
std::vector<WorstPlace> worst_of(const std::vector<Measured>& measured, double apart_mm) {
  std::vector<const NearestPlace*> order;
  for (const Measured& m : measured) {
    if (m.near) order.push_back(&m.place);
  }
  std::stable_sort(order.begin(), order.end(), [](const NearestPlace* a, const NearestPlace* b) {
    return std::abs(a->signed_mm) > std::abs(b->signed_mm);
  });
  std::vector<WorstPlace> worst;
  for (const NearestPlace* place : order) {
    if (worst.size() == kWorst) break;
    const bool apart = std::all_of(worst.begin(), worst.end(), [&](const WorstPlace& w) {
      return length(difference(w.place, place->point)) >= apart_mm;
    });
    if (apart) worst.push_back({place->point, 1e3 * place->signed_mm});
  }
  return worst;
}

/// What of the surface no point is near to.
void add_unseen(Deviation& d, const TriangleMesh& surface, double diagonal,
                const ExecutionContext& context) {
  const SurfaceSamples samples = sample_surface(surface, kCoverSamples);
  const double each = samples.area_mm2 / static_cast<double>(samples.points.size());
  if (d.places.empty()) {
    d.unseen_share = 1;
    return;
  }
  // Three times as far as points are from each other, were they all over the surface.
  const double spacing = std::sqrt(samples.area_mm2 / static_cast<double>(d.places.size()));
  const double far = std::max({3 * spacing, 0.01 * diagonal, 1e-6});
  const PointTree tree(d.places);
  std::vector<std::uint8_t> unseen(samples.points.size());
  constexpr std::size_t chunk_points = 1000;
  parallel_for(silent(context), "", samples.points.size() / chunk_points, [&](std::size_t chunk) {
    for (std::size_t i = chunk * chunk_points; i < (chunk + 1) * chunk_points; ++i) {
      unseen[i] = tree.nearest(samples.points[i]).square > far * far;
    }
  });
  // By the cubes of an eighth of the diagonal.
  const PointBox box(surface.vertices);
  const double side = diagonal / 8;
  std::vector<UnseenPlace> cubes(1000);
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    if (!unseen[i]) continue;
    d.unseen_share += 1.0 / static_cast<double>(samples.points.size());
    std::size_t cube = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      cube = 10 * cube + static_cast<std::size_t>(std::clamp(
                             std::floor((samples.points[i][k] - box.low[k]) / side), 0.0, 9.0));
    }
    cubes[cube].area_mm2 += each;
    cubes[cube].place = sum(cubes[cube].place, samples.points[i], each);
  }
  std::stable_sort(cubes.begin(), cubes.end(), [](const UnseenPlace& a, const UnseenPlace& b) {
    return a.area_mm2 > b.area_mm2;
  });
  for (const UnseenPlace& cube : cubes) {
    if (cube.area_mm2 == 0 || d.unseen.size() == kUnseenPlaces) break;
    d.unseen.push_back({scaled(cube.place, 1 / cube.area_mm2), cube.area_mm2});
  }
}

}  // namespace

Deviation deviation_from(const Scan& scan, const Pose& pose, const TriangleMesh& surface,
                         const MeshDistance& distance, std::string_view against, double reach_mm,
                         const ExecutionContext& context) {
  if (!(reach_mm > 0)) {
    throw InputError(fmt::format("a reach of {} mm; expected a number above 0", reach_mm));
  }
  const PointBox box(surface.vertices);
  const std::vector<Measured> measured =
      measure(scan.points, pose, surface, distance, reach_mm, context);
  Deviation d;
  d.against = against;
  d.reach_um = 1e3 * reach_mm;
  Group all, facing[kFacings], slabs[kSlabs], gaps[kGapClasses];
  const double high = std::max(box.high[2], 1e-9);
  double squares = 0;
  for (const Measured& m : measured) {
    if (!m.near) {
      ++d.beside;
      continue;
    }
    const double um = 1e3 * m.place.signed_mm;
    squares += um * um;
    all.add(um);
    facing[m.facing].add(um);
    slabs[std::clamp(static_cast<int>(kSlabs * m.place.point[2] / high), 0, kSlabs - 1)].add(um);
    if (m.gap_mm >= 0) {
      const auto* edge = std::upper_bound(std::begin(kGapEdgesMm), std::end(kGapEdgesMm), m.gap_mm);
      gaps[edge - std::begin(kGapEdgesMm)].add(um);
    }
    d.places.push_back(m.place.point);
    d.off_um.push_back(static_cast<float>(um));
    d.normals.push_back({static_cast<float>(m.place.normal[0]),
                         static_cast<float>(m.place.normal[1]),
                         static_cast<float>(m.place.normal[2])});
  }
  d.all = all.figures("all");
  d.rms_um = d.places.empty() ? 0 : std::sqrt(squares / static_cast<double>(d.places.size()));
  for (std::size_t i = 0; i < kFacings; ++i) {
    d.facing.push_back(facing[i].figures(std::string(kFacingNames[i])));
  }
  for (int i = 0; i < kSlabs; ++i) {
    d.heights.push_back(slabs[i].figures(
        fmt::format("{:.3g} to {:.3g} mm", high * i / kSlabs, high * (i + 1) / kSlabs)));
  }
  for (std::size_t i = 0; i < kGapClasses; ++i) {
    const std::string name =
        i == 0                 ? fmt::format("up to {:g} mm", kGapEdgesMm[0])
        : i + 1 == kGapClasses ? fmt::format("above {:g} mm", kGapEdgesMm[i - 1])
                               : fmt::format("{:g} to {:g} mm", kGapEdgesMm[i - 1], kGapEdgesMm[i]);
    d.gaps.push_back(gaps[i].figures(name));
  }
  d.worst = worst_of(measured, 0.05 * box.diagonal());
  add_unseen(d, surface, box.diagonal(), context);
  return d;
}

}  // namespace slicecorr
