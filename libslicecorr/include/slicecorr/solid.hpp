// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file solid.hpp
/// The part that a stack will print, as a closed triangle mesh: the surface on which the dose is 1.
///
/// Frame of the mesh: mm, x and y of the plate from its corner 00, z from the platform (0) towards
/// the window: the frame in which `slice` places its parts. Images that are turned or mirrored are
/// put the right way round as far as their archive says how they lie; else they are taken for those
/// of `slice`. Doses are known at pixel centres and nodes. Between nodes of one column the surface
/// is exact, from the closed form of the dose inside a layer; between neighbouring columns the dose
/// is linear. Space is cut into tetrahedra, so there are no ambiguous cases, and the surface is
/// always closed.
///
/// What the resin says becomes of a part after printing (`Resin::shrinkage` of the models) is in all surfaces and
/// distances: it shrinks about the middle of what the images show, and towards the platform; walls of the first
/// layers stand out. Models that were made without a resin know nothing of it.
///
/// All functions are thread-safe as long as no two write the same file. What does not fit throws
/// `InputError`, a failing disk `DeviceError`, a cancelled `context` `Cancelled`.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "slicecorr/cure.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// The place of a surface that is nearest to a point.
struct NearestPlace {
  Point3 point{};        ///< on the surface, mm
  Point3 normal{};       ///< of the triangle there, outwards, of length 1
  double signed_mm = 0;  ///< distance of the point, above 0 outside
  std::uint32_t triangle = 0;
};

/// The distance of points to a mesh. Immutable and thread-safe once made.
class MeshDistance {
 public:
  /// Throws `InputError` when the mesh has no triangle, or a coordinate is not finite.
  explicit MeshDistance(const TriangleMesh& mesh);
  ~MeshDistance();
  MeshDistance(MeshDistance&&) noexcept;
  /// From `point` to the nearest point of any triangle, in the mesh's units.
  double to(const Point3& point) const;
  /// The nearest place, which is within `most_mm` > 0; nothing where there is none. Where triangles meet, the one
  /// says the side that is seen most face on. Triangles without area are passed over.
  std::optional<NearestPlace> nearest(const Point3& point, double most_mm) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A mesh where `MeshSlices` puts it on the display: the middle of its bounding box at `center_mm`
/// (else the middle of the display), its least z at 0.
TriangleMesh on_plate(const TriangleMesh& mesh, const Printer& printer,
                      const std::optional<std::array<double, 2>>& center_mm = {});

/// How a mesh that was put `on_plate` lies to what `stack` shows, which is `height_mm` high. Throws `InputError` when the stack
/// can't show that mesh: more than a quarter (and four pixels or slices) too large along an axis, or
/// beside it, too small along all axes by the same factor of 1.2 or more, or along all axes by more
/// than 3. Supports may make a stack larger than its design, but not like that.
void check_design_size(const SliceSource& stack, double height_mm, const TriangleMesh& design);

/// How many triangles a surface will have, before it is made.
struct SolidSize {
  double of_areas = 0;  ///< triangles across: a quarter of them at every second pixel
  double of_walls = 0;  ///< triangles of walls: half of them at every second pixel
  /// About, at every `reduce`th pixel.
  double triangles(int reduce) const;
  /// The least reduction of at most 64 that has no more than `most` triangles; 64 where none has.
  int reduction(double most) const;
};

/// Counts triangles at every 4th and every 8th pixel; takes a twelfth of the time of the whole
/// surface, and reading the stack twice. Right to about a tenth for shapes that are larger than
/// 16 pixels.
SolidSize size_of_solid(const SliceSource& stack, const PlaceModels& models,
                        const ExecutionContext& context = {});

struct SolidOptions {
  int reduce = 1;                        ///< take every Nth pixel in x and y, 1..64
  const MeshDistance* design = nullptr;  ///< measures the distance of the surface, when given
  /// Draw what these rows of the image show alone, [first, past); nothing: all. Where it is cut it may stand open.
  std::optional<std::array<int, 2>> rows{};
  /// Keep triangles alone for whose box, by its least and largest corner (mm, of the surface as it is given), this says
  /// so; nothing: all. The surface may then stand open. Called by several threads at once.
  std::function<bool(const Point3&, const Point3&)> wanted{};
};
/// In which row of the images a place of the plate is shown; may lie beside them.
double image_row_of(const SliceSource& stack, double x_mm, double y_mm);

struct SolidReport {
  std::uint64_t triangles = 0;
  double volume_mm3 = 0;    ///< enclosed by the surface, >= 0
  Point3 lower{}, upper{};  ///< bounding box, mm
  /// From the surface's vertices (without those on the platform) to the design; empty without one.
  Histogram distance_um;
};

/// Writes the surface to `path`: binary STL (.stl), binary PLY (.ply) or 3MF (.3mf), complete or
/// not at all. Memory is that of the bands at work, 256 MiB of triangles (what is more waits in a
/// scratch file beside `path`) and for PLY and 3MF the vertices. The bytes do not depend on
/// threads. Throws `InputError` when nothing prints, or the name ends in something else.
SolidReport write_solid(const SliceSource& stack, const PlaceModels& models,
                        const std::string& path, const SolidOptions& options = {},
                        const ExecutionContext& context = {});

/// The same figures without a file: the surface is drawn and measured only.
SolidReport measure_solid(const SliceSource& stack, const PlaceModels& models,
                          const SolidOptions& options = {}, const ExecutionContext& context = {});

/// The same surface in memory.
TriangleMesh solid_mesh(const SliceSource& stack, const PlaceModels& models,
                        const SolidOptions& options = {}, const ExecutionContext& context = {});

}  // namespace slicecorr
