// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A scan against all that it is measured against.
#include <fmt/format.h>

#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr {

TriangleMesh predicted_surface(const SliceSource& shown, const PlaceModels& models,
                               double most_triangles, const ExecutionContext& context) {
  SolidOptions options;
  options.reduce = size_of_solid(shown, models, context).reduction(most_triangles);
  if (options.reduce > 1) {
    context.tell(fmt::format(
        "what was predicted to print is taken at one pixel in {} along x and y", options.reduce));
  }
  return solid_mesh(shown, models, options, context);
}

ComparedScan compare_scan(const std::string& path, const std::vector<ScanSurface>& surfaces,
                          const ScanAsk& ask, const ExecutionContext& context) {
  if (surfaces.empty()) {
    throw InputError(
        "nothing to measure against; expected the stack that was printed, the design, or both");
  }
  std::vector<MeshDistance> distances;
  distances.reserve(surfaces.size());
  for (const ScanSurface& surface : surfaces) distances.emplace_back(surface.mesh);
  // What was predicted to print lies nearer to the print, where there is a stack.
  const ScanSurface& poser = surfaces.back();
  ComparedScan done;
  done.scan = read_scan(path, poser.mesh, ask.reading, context);
  ScanComparison& c = done.comparison;
  c.scan = path;
  c.unit = done.scan.unit;
  c.points = done.scan.points.size();
  c.triangles = done.scan.triangles;
  c.notes = done.scan.notes;
  c.posed_by = poser.against;
  c.registration = register_scan(done.scan, poser.mesh, distances.back(), context);
  const double reach_mm = 1e-3 * (ask.reach_um > 0 ? ask.reach_um : c.registration.reach_um);
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    c.deviations.push_back(deviation_from(done.scan, c.registration.pose, surfaces[i].mesh,
                                          distances[i], surfaces[i].against, reach_mm, context));
  }
  return done;
}

}  // namespace slicecorr
