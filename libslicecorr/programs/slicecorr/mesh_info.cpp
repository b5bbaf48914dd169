// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a mesh file holds, as it would print.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::cli::commands {
namespace {

/// The volume inside, what overlaps counted once and what is taken away not at all, what is inside out
/// turned, as slicing does: by slices, some
/// 500 of 1000 pixels across, each of them exact.
double sliced_volume_mm3(const TriangleMesh& mesh, const MeshReport& report,
                         const EdgeDefects& edge_defects, const ExecutionContext& context) {
  const auto size = [&](std::size_t k) { return report.upper[k] - report.lower[k]; };
  Printer plate;
  plate.name = "info";
  plate.bit_depth = 8;
  plate.pixel_x_um = plate.pixel_y_um = std::max(size(0), size(1)) * 1e3 / 1024;
  if (!(plate.pixel_x_um > 0) || !(size(2) > 0)) return 0;
  plate.width_px = static_cast<int>(std::ceil(size(0) * 1e3 / plate.pixel_x_um)) + 2;
  plate.height_px = static_cast<int>(std::ceil(size(1) * 1e3 / plate.pixel_x_um)) + 2;
  SliceOptions options;
  options.layer_um = std::clamp(size(2) * 1e3 / 512, 1.0, 1000.0);
  if (size(2) * 1e3 < options.layer_um) return 0;
  ExecutionContext quiet = context;
  quiet.notice = nullptr;
  quiet.progress = nullptr;
  const MeshSlices slices(mesh, plate, options, quiet, &edge_defects);
  constexpr int rows = 32;
  std::atomic<std::uint64_t> sum = 0;
  parallel_for(quiet, "", static_cast<std::size_t>((plate.height_px + rows - 1) / rows),
               [&](std::size_t band) {
                 const int y0 = static_cast<int>(band) * rows;
                 const PixelBox box{0, y0, plate.width_px, std::min(y0 + rows, plate.height_px)};
                 const auto pixels =
                     static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
                 std::uint64_t own = 0;
                 slices.read_band(box, [&](int, const std::uint8_t* values) {
                   if (!values) return;
                   for (std::size_t i = 0; i < pixels; ++i) own += values[i];
                 });
                 sum += own;
               });
  return static_cast<double>(sum) / 255 * plate.pixel_x_um * plate.pixel_y_um * options.layer_um *
         1e-9;
}

}  // namespace

int mesh_info(const Arguments& a, const ExecutionContext& context) {
  std::vector<std::string> notes;
  ExecutionContext quiet = context;
  quiet.notice = nullptr;  // told below
  const TriangleMesh mesh = read_mesh(a.input, {}, quiet, &notes);
  EdgeDefects edge_defects;
  const MeshReport r = inspect(mesh, context, &edge_defects);
  const double volume_ml = sliced_volume_mm3(mesh, r, edge_defects, context) * 1e-3;
  const auto size = [&](std::size_t k) { return r.upper[k] - r.lower[k]; };
  if (a.json.empty()) {
    std::string text = fmt::format("{:<12} {} {}, {} corners, {} {}\n", "mesh", r.triangles,
                                   r.triangles == 1 ? "triangle" : "triangles", r.vertices,
                                   r.bodies, r.bodies == 1 ? "body" : "bodies");
    text += fmt::format("{:<12} {:.3f} x {:.3f} x {:.3f} mm, from {:.3f}, {:.3f}, {:.3f} mm\n",
                        "size", size(0), size(1), size(2), r.lower[0], r.lower[1], r.lower[2]);
    text += fmt::format("{:<12} {:.4g} ml\n", "volume", volume_ml);
    text += fmt::format("{:<12} {}\n", "faults", r.defects.any() ? describe(r.defects) : "none");
    for (const std::string& note : notes) text += fmt::format("{:<12} {}\n", "of the file", note);
    print_result(text);
    return kDone;
  }
  const MeshDefects& d = r.defects;
  nlohmann::ordered_json json{{"file", a.input},
                              {"triangles", r.triangles},
                              {"vertices", r.vertices},
                              {"bodies", r.bodies},
                              {"lower_mm", r.lower},
                              {"upper_mm", r.upper},
                              {"volume_ml", volume_ml},
                              {"defects",
                               {{"open_edges", d.open_edges},
                                {"crowded_edges", d.crowded_edges},
                                {"misoriented_edges", d.misoriented_edges},
                                {"flipped_triangles", d.flipped_triangles},
                                {"inside_out_bodies", d.inside_out_bodies},
                                {"all_inside_out", d.all_inside_out},
                                {"degenerate_triangles", d.degenerate_triangles},
                                {"zero_area_triangles", d.zero_area_triangles},
                                {"duplicate_triangles", d.duplicate_triangles}}},
                              {"notes", notes}};
  print_or_write(a.json, json.dump(2));
  return kDone;
}

}  // namespace slicecorr::cli::commands
