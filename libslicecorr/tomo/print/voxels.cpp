// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/voxels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slice/placing.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/plate.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"

namespace slicecorr::tomo {

using detail::distance_mm;

namespace {

/// Throws for a part that reaches over the resin.
void check_radius(const TriangleMesh& mesh, const PartFrame& frame, const Printer& printer) {
  double radius_mm = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!mesh.adds(i)) continue;
    for (const std::uint32_t v : mesh.triangles[i]) {
      const Point3& corner = mesh.vertices[v];
      radius_mm =
          std::max(radius_mm, std::hypot(corner[0] - frame.axis_x_mm, corner[1] - frame.axis_y_mm));
    }
  }
  const double inner_mm = printer.vial->inner_mm;
  if (radius_mm <= inner_mm * (1 + 1e-9)) return;
  throw InputError(
      fmt::format("the part reaches {:.3f} mm from the axis, the resin ends at {:g} mm; expected a "
                  "part scaled by at most {:.4f}",
                  radius_mm, inner_mm, std::floor(1e4 * inner_mm / radius_mm) * 1e-4));
}

/// Voxels as the slicer's display.
Printer voxel_plate(const std::string& name, int nx, int ny, double voxel_mm) {
  Printer plate;
  plate.name = name;
  plate.width_px = nx;
  plate.height_px = ny;
  plate.pixel_x_um = plate.pixel_y_um = voxel_mm * 1e3;
  plate.bit_depth = 8;
  return plate;
}

Box<std::uint8_t> empty_box(int slices, int ny, int nx) {
  Box<std::uint8_t> box{slices, ny, nx, {}};
  box.values.assign(static_cast<std::size_t>(slices) * static_cast<std::size_t>(ny) *
                        static_cast<std::size_t>(nx),
                    0);
  return box;
}

}  // namespace

double detail::distance_mm(int n, int x, int y, double voxel_mm) {
  return std::hypot(x - 0.5 * (n - 1), y - 0.5 * (n - 1)) * voxel_mm;
}

void detail::check_in_vial(int n, int x, int y, int z, double voxel_mm, const Printer& printer) {
  const auto nearest = [&](int i) { return std::max(0.0, std::abs(i - 0.5 * (n - 1)) - 0.5); };
  const double inner_mm = printer.vial->inner_mm;
  if (std::hypot(nearest(x), nearest(y)) * voxel_mm < inner_mm) return;
  throw InputError(fmt::format(
      "the insert reaches {:.3f} mm from the axis, at x = {:.3f}, y = {:.3f} mm in slice {}; the "
      "resin ends at {:g} mm; expected an insert inside the vial",
      distance_mm(n, x, y, voxel_mm), (x - 0.5 * (n - 1)) * voxel_mm,
      (y - 0.5 * (n - 1)) * voxel_mm, z, inner_mm));
}

Box<std::uint8_t> detail::beside_resin(const Box<std::uint8_t>& part, const Printer& printer,
                                       double voxel_mm) {
  Box<std::uint8_t> beside = empty_box(part.nz, part.ny, part.nx);
  const ResinArea area(*printer.vial);
  for (int y = 0; y < part.ny; ++y) {
    for (int x = 0; x < part.nx; ++x) {
      const FlatPoint place{(x - 0.5 * (part.nx - 1)) * voxel_mm,
                            (y - 0.5 * (part.ny - 1)) * voxel_mm};
      // What is farther away than all resin is in no grid of light.
      if (std::hypot(place.x_mm, place.y_mm) > printer.vial->inner_mm * (1 + 1e-9)) continue;
      if (area.has(place)) continue;
      for (int z = 0; z < part.nz; ++z) {
        beside.values[beside.at(z, y, x)] = 255;
        if (part.values[part.at(z, y, x)] < 255) continue;
        throw InputError(fmt::format(
            "the part reaches into the vial's wall or a rod at x = {:.3f}, y = {:.3f} mm from the "
            "axis in slice {}; expected it within the resin, whose wall is {:.3f} mm from the axis "
            "where it is nearest",
            place.x_mm, place.y_mm, z, nearest_wall_mm(*printer.vial)));
      }
    }
  }
  return beside;
}

namespace {

/// All slices of a mesh on a display of voxels.
Box<std::uint8_t> coverage_with(TriangleMesh mesh, const Printer& plate,
                                const SliceOptions& options, const ExecutionContext& context) {
  const int nx = plate.width_px, ny = plate.height_px;
  const MeshSlices slices(std::move(mesh), plate, options, context);
  Box<std::uint8_t> part = empty_box(slices.grid().layers, ny, nx);
  const PixelBox whole{0, 0, nx, ny};
  slices.read_band(whole, [&](int z, const std::uint8_t* rows) {
    if (!rows) return;
    // Image rows run from the largest y down.
    for (int row = 0; row < ny; ++row) {
      std::copy_n(rows + static_cast<std::ptrdiff_t>(row) * nx, nx,
                  &part.values[part.at(z, ny - 1 - row, 0)]);
    }
  });
  return part;
}

slicecorr::detail::PartBox box_of_part(const TriangleMesh& part, const ExecutionContext& context) {
  if (part.triangles.empty()) throw InputError("there is no triangle to slice");
  return slicecorr::detail::box_of(part, context);
}

}  // namespace

Box<std::uint8_t> detail::coverage_of(TriangleMesh mesh, const std::string& name, int nx, int ny,
                                      double voxel_mm, const ExecutionContext& context) {
  SliceOptions options;
  options.layer_um = voxel_mm * 1e3;
  return coverage_with(std::move(mesh), voxel_plate(name, nx, ny, voxel_mm), options, context);
}

Box<std::uint8_t> voxelise(TriangleMesh mesh, const Printer& printer, double voxel_mm,
                           const ExecutionContext& context) {
  const int n = voxels_across(printer, voxel_mm);
  check_radius(mesh, frame_of(mesh, context), printer);
  return detail::coverage_of(std::move(mesh), printer.name, n, n, voxel_mm, context);
}

PlacedVoxels voxelise(std::vector<PlacedPart> parts, const Printer& printer, double voxel_mm,
                      const ExecutionContext& context) {
  if (parts.empty()) throw InputError("there is no part to slice");
  const int n = voxels_across(printer, voxel_mm);
  std::vector<TriangleMesh> meshes;
  for (PlacedPart& part : parts) {
    const slicecorr::detail::PartBox box = box_of_part(part.mesh, context);
    for (Point3& v : part.mesh.vertices) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double from = k == 2 && part.on_base ? box.low[k] : box.middle(k);
        v[k] += part.at_mm[k] - from;
      }
    }
    try {
      check_radius(part.mesh, {}, printer);
    } catch (const InputError& e) {
      throw InputError(part.name, "", e.what());
    }
    meshes.push_back(std::move(part.mesh));
  }
  const Printer plate = voxel_plate(printer.name, n, n, voxel_mm);
  TriangleMesh all;
  for (const TriangleMesh& mesh : meshes) append(all, mesh);
  const slicecorr::detail::PartBox box = box_of_part(all, context);
  const double middle_mm = 0.5 * n * voxel_mm;
  SliceOptions options;
  options.layer_um = voxel_mm * 1e3;
  options.center_mm = {{middle_mm + box.middle(0), middle_mm + box.middle(1)}};
  if (const auto o = find_overlap(meshes, plate, options, context)) {
    throw InputError(fmt::format(
        "{} and {} overlap: {:.4g} mm³ belong to both, the lowest at x = {:.2f}, y = {:.2f} mm from "
        "the axis, z = {:.3f} mm; expected parts beside or above each other",
        parts[o->first].name, parts[o->second].name, o->volume_mm3, o->x_mm - middle_mm,
        o->y_mm - middle_mm, box.low[2] + o->z_mm));
  }
  meshes.clear();
  PlacedVoxels voxels{coverage_with(std::move(all), plate, options, context), 0};
  voxels.middle_z_mm = box.low[2] + 0.5 * voxels.part.nz * voxel_mm;
  return voxels;
}

PartFrame frame_of(const TriangleMesh& part, const ExecutionContext& context) {
  const slicecorr::detail::PartBox box = box_of_part(part, context);
  return {box.middle(0), box.middle(1), box.low[2]};
}

Box<std::uint8_t> voxelise_insert(TriangleMesh insert, const PartFrame& frame,
                                  const Box<std::uint8_t>& part, const Printer& printer,
                                  double voxel_mm, const ExecutionContext& context) {
  const int n = voxels_across(printer, voxel_mm);
  if (insert.triangles.empty()) throw InputError("there is no triangle in the insert");
  const slicecorr::detail::PartBox box = slicecorr::detail::box_of(insert, context);
  const double top_mm = frame.low_z_mm + part.nz * voxel_mm;
  if (box.high[2] <= frame.low_z_mm + 0.5 * voxel_mm || box.low[2] >= top_mm) {
    throw InputError(fmt::format(
        "the insert lies from z = {:.3f} to {:.3f} mm, the part from {:.3f} to {:.3f}; expected an "
        "insert in the part's coordinates, beside it",
        box.low[2], box.high[2], frame.low_z_mm, top_mm));
  }
  // A display about the axis on which all of it fits, and whole slices below the part's if need be.
  const double half_mm =
      std::max({frame.axis_x_mm - box.low[0], box.high[0] - frame.axis_x_mm,
                frame.axis_y_mm - box.low[1], box.high[1] - frame.axis_y_mm, 0.0});
  if (!(half_mm < 0.4 * kMostAlongAxis * voxel_mm)) {
    throw InputError(
        fmt::format("the insert reaches {:.3f} mm from the axis, the resin ends at {:g} "
                    "mm; expected an insert inside the vial",
                    half_mm, printer.vial->inner_mm));
  }
  const int beside = std::max(0, static_cast<int>(std::ceil(half_mm / voxel_mm)) - n / 2);
  const int below =
      std::max(0, static_cast<int>(std::ceil((frame.low_z_mm - box.low[2]) / voxel_mm)));
  SliceOptions options;
  options.layer_um = voxel_mm * 1e3;
  options.platform_z_mm = frame.low_z_mm - below * voxel_mm;
  const double middle_mm = 0.5 * (n + 2 * beside) * voxel_mm;
  options.center_mm = {
      {middle_mm + box.middle(0) - frame.axis_x_mm, middle_mm + box.middle(1) - frame.axis_y_mm}};
  const int across = n + 2 * beside;
  const MeshSlices slices(std::move(insert), voxel_plate(printer.name, across, across, voxel_mm),
                          options, context);
  Box<std::uint8_t> voxels = empty_box(part.nz, n, n);
  const PixelBox bounds = slices.bounds();
  const int past = std::min(below + part.nz, slices.grid().layers);
  if (past <= below) return voxels;
  slices.read_slices(bounds, below, past, [&](int slice, const std::uint8_t* rows) {
    if (!rows) return;
    const int z = slice - below;
    for (int row = bounds.y0; row < bounds.y1; ++row) {
      for (int column = bounds.x0; column < bounds.x1; ++column) {
        const std::uint8_t covered = *rows++;
        if (covered == 0) continue;
        const int x = column - beside, y = n - 1 - (row - beside);
        detail::check_in_vial(n, x, y, z, voxel_mm, printer);
        if (x < 0 || x >= n || y < 0 || y >= n) continue;  // resin beside the outermost voxels
        const std::size_t at = voxels.at(z, y, x);
        if (part.values[at] < 255 || covered >= 128) voxels.values[at] = covered;
      }
    }
  });
  return voxels;
}

namespace {

/// `around`: what stands beside the volume, and may lie outside of the vial.
template <class T>
Box<T> placed_amid(const Box<T>& volume, const Printer& printer, double voxel_mm,
                   const std::array<double, 2>& by_mm, T around) {
  require_tomographic(printer);
  std::array<int, 2> by{};
  for (std::size_t k = 0; k < 2; ++k) {
    const double voxels = by_mm[k] / voxel_mm;
    if (!(std::abs(voxels - std::round(voxels)) < 1e-6) || std::abs(voxels) > kMostAlongAxis) {
      throw InputError(fmt::format(
          "the volume is to be moved by {:g} mm along {}, its voxels are {:g} mm wide; expected "
          "whole voxels",
          by_mm[k], "xy"[k], voxel_mm));
    }
    by[k] = static_cast<int>(std::lround(voxels));
  }
  if (volume.nx != volume.ny) {
    throw InputError(
        fmt::format("the volume is {} x {} voxels across; expected as many along x as "
                    "along y",
                    volume.nx, volume.ny));
  }
  const int n = voxels_across(printer, voxel_mm);
  // An even volume has no voxel on the axis: its voxels lie half a voxel beside those of the grid.
  const int shift = (n - volume.nx - (n - volume.nx) % 2) / 2;
  const auto across = static_cast<std::size_t>(n);
  Box<T> part{volume.nz, n, n,
              std::vector<T>(static_cast<std::size_t>(volume.nz) * across * across, around)};
  for (int z = 0; z < volume.nz; ++z) {
    for (int y = 0; y < volume.ny; ++y) {
      for (int x = 0; x < volume.nx; ++x) {
        const T value = volume.values[volume.at(z, y, x)];
        if (value == around) continue;
        const int px = x + shift + by[0], py = y + shift + by[1];
        if (px < 0 || px >= n || py < 0 || py >= n) {
          throw InputError(fmt::format(
              "voxel {}, {}, {} of the volume lies {:.3f} mm from the axis, the resin ends at {:g} "
              "mm; expected a smaller part, or smaller voxels",
              x, y, z, distance_mm(n, px, py, voxel_mm), printer.vial->inner_mm));
        }
        part.values[part.at(z, py, px)] = value;
      }
    }
  }
  return part;
}

}  // namespace

Box<std::uint8_t> placed(const Box<std::uint8_t>& volume, const Printer& printer, double voxel_mm) {
  return placed(volume, printer, voxel_mm, {});
}

Box<std::uint8_t> placed(const Box<std::uint8_t>& volume, const Printer& printer, double voxel_mm,
                         const std::array<double, 2>& by_mm) {
  return placed_amid<std::uint8_t>(volume, printer, voxel_mm, by_mm, 0);
}

Box<float> placed(const Box<float>& volume, const Printer& printer, double voxel_mm, float around) {
  return placed_amid(volume, printer, voxel_mm, {}, around);
}

double part_radius_mm(const Box<std::uint8_t>& part, double voxel_mm) {
  double radius = 0;
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        if (part.values[part.at(z, y, x)] == 0) continue;
        radius = std::max(radius, distance_mm(part.nx, x, y, voxel_mm));
      }
    }
  }
  return radius;
}

}  // namespace slicecorr::tomo
