// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "scan/vectors.hpp"
#include "scan/volume.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/mesh_or_points.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr {

using namespace detail;

namespace {

constexpr std::size_t kLeastPoints = 100;

struct NamedUnit {
  std::string_view name;
  double mm;
};
constexpr NamedUnit kUnits[] = {{"mm", 1}, {"um", 1e-3}, {"cm", 10}, {"inch", 25.4}, {"m", 1000}};

/// The unit that was asked for, or the one in which the diagonals are most alike.
NamedUnit unit_of(const std::string& path, double numbers, double surface_mm,
                  const std::string& asked) {
  NamedUnit best = kUnits[0];
  const auto off = [&](const NamedUnit& unit) {
    return std::abs(std::log(numbers * unit.mm / surface_mm));
  };
  bool named = false;
  for (const NamedUnit& unit : kUnits) {
    if (asked == unit.name) {
      best = unit;
      named = true;
    }
    if (asked == "auto" && off(unit) < off(best)) best = unit;
  }
  if (!named && asked != "auto") {
    throw InputError(path, "",
                     fmt::format("unit '{}'; expected auto, um, mm, cm, inch or m", asked));
  }
  if (!named && off(best) > std::log(4.0)) {
    throw InputError(
        path, "",
        fmt::format(
            "is {:.4g} long from corner to corner, the surface {:.4g} mm; expected a scan of "
            "that part in um, mm, cm, inch or m",
            numbers, surface_mm));
  }
  return best;
}

/// The box of all but the outermost thousandth along each axis: dust far away makes no size.
double size_without_dust(const std::vector<Point3>& points) {
  PointBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<double> along;
    along.reserve(points.size());
    for (const Point3& p : points) along.push_back(p[k]);
    box.low[k] = value_at(along, 0.001);
    box.high[k] = value_at(along, 0.999);
  }
  return box.diagonal();
}

}  // namespace

SurfaceSamples sample_surface(const TriangleMesh& mesh, std::size_t count) {
  SurfaceSamples samples;
  std::vector<double> up_to;
  up_to.reserve(mesh.triangles.size());
  const auto normal_of = [&](std::size_t i) {
    const auto& t = mesh.triangles[i];
    const Point3& a = mesh.vertices[t[0]];
    return crossed(difference(mesh.vertices[t[1]], a), difference(mesh.vertices[t[2]], a));
  };
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    samples.area_mm2 += 0.5 * length(normal_of(i));
    up_to.push_back(samples.area_mm2);
  }
  if (!(samples.area_mm2 > 0))
    throw InputError("a surface has no area; expected triangles with one");
  samples.points.reserve(count);
  samples.normals.reserve(count);
  std::size_t triangle = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto at = static_cast<double>(i) + 0.5;
    const double area = at / static_cast<double>(count) * samples.area_mm2;
    while (triangle + 1 < up_to.size() && up_to[triangle] < area) ++triangle;
    // Roberts' sequence in the unit square, folded into a triangle.
    double u = at * 0.7548776662466927, v = at * 0.5698402909980532;
    u -= std::floor(u);
    v -= std::floor(v);
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const auto& t = mesh.triangles[triangle];
    const Point3& a = mesh.vertices[t[0]];
    const Point3 along_b = difference(mesh.vertices[t[1]], a),
                 along_c = difference(mesh.vertices[t[2]], a);
    samples.points.push_back(sum(sum(a, along_b, u), along_c, v));
    const Point3 n = normal_of(triangle);
    samples.normals.push_back(scaled(n, 1 / std::max(length(n), 1e-300)));
  }
  return samples;
}

namespace {

/// The points of a volume, in mm, and what is said of it.
Scan volume_scan(const std::string& path, const TriangleMesh& surface, const ScanReading& reading,
                 const ExecutionContext& context) {
  if (!(reading.voxel_um > 0)) {
    throw InputError(path, "", "is a volume; expected the side of its voxels, too");
  }
  if (reading.unit != "auto") {
    throw InputError(path, "",
                     "is a volume, whose voxels have their side in um; expected no unit with it");
  }
  Scan scan;
  scan.source = path;
  scan.unit = "voxels";
  scan.points =
      points_of_volume(path, std::max<std::size_t>(reading.most_points, 1000), scan.notes, context);
  for (Point3& p : scan.points) p = scaled(p, 1e-3 * reading.voxel_um);
  const double size = size_without_dust(scan.points),
               surface_mm = PointBox(surface.vertices).diagonal();
  if (!(size > 0.25 * surface_mm && size < 4 * surface_mm)) {
    throw InputError(
        path, "",
        fmt::format(
            "is {:.4g} mm from corner to corner with voxels of {:g} um, the surface {:.4g} mm; "
            "expected a scan of that part",
            size, reading.voxel_um, surface_mm));
  }
  for (const std::string& note : scan.notes) context.tell(path + ": " + note);
  return scan;
}

}  // namespace

Scan read_scan(const std::string& path, const TriangleMesh& surface, const ScanReading& reading,
               const ExecutionContext& context) {
  if (is_volume(path)) return volume_scan(path, surface, reading, context);
  if (reading.voxel_um != 0) {
    throw InputError(
        path, "",
        "is no volume (.npy, or a folder of TIFF slices); expected no side of voxels with it");
  }
  TriangleMesh mesh = read_mesh_or_points(path, context);
  Scan scan;
  scan.source = path;
  scan.triangles = mesh.triangles.size();
  if (mesh.vertices.size() < kLeastPoints && mesh.triangles.empty()) {
    throw InputError(path, "",
                     fmt::format("has {} points; expected {} or more of a scan",
                                 mesh.vertices.size(), kLeastPoints));
  }
  const std::size_t most = std::max<std::size_t>(reading.most_points, 1000);
  if (mesh.triangles.empty()) {
    const std::size_t every = (mesh.vertices.size() + most - 1) / most;
    if (every > 1) {
      scan.notes.push_back(
          fmt::format("{} points, of which one in {} is taken", mesh.vertices.size(), every));
    }
    for (std::size_t i = 0; i < mesh.vertices.size(); i += every)
      scan.points.push_back(mesh.vertices[i]);
  } else {
    SurfaceSamples samples = sample_surface(
        mesh, std::clamp<std::size_t>(scan.triangles, std::min<std::size_t>(50'000, most), most));
    scan.points = std::move(samples.points);
    scan.normals = std::move(samples.normals);
  }
  const double numbers = size_without_dust(scan.points);
  const double surface_mm = PointBox(surface.vertices).diagonal();
  if (!(numbers > 0)) throw InputError(path, "", "has no size; expected a scan of a part");
  const NamedUnit unit = unit_of(path, numbers, surface_mm, reading.unit);
  scan.unit = unit.name;
  scan.notes.push_back(fmt::format(
      "numbers are taken as {}{}: {:.4g} mm from corner to corner, the surface {:.4g} mm",
      unit.name, reading.unit == "auto" ? ", which fits best" : ", as asked", numbers * unit.mm,
      surface_mm));
  for (Point3& p : scan.points) p = scaled(p, unit.mm);
  for (const std::string& note : scan.notes) context.tell(path + ": " + note);
  return scan;
}

}  // namespace slicecorr
