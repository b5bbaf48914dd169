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
/// All functions are thread-safe as long as no two write the same file. What does not fit throws
/// `InputError`, a failing disk `DeviceError`, a cancelled `context` `Cancelled`.
#pragma once

#include <array>
#include <cstdint>
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

/// The distance of points to a mesh. Immutable and thread-safe once made.
class MeshDistance {
 public:
  /// Throws `InputError` when the mesh has no triangle, or a coordinate is not finite.
  explicit MeshDistance(const TriangleMesh& mesh);
  ~MeshDistance();
  MeshDistance(MeshDistance&&) noexcept;
  /// From `point` to the nearest point of any triangle, in the mesh's units.
  double to(const Point3& point) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A mesh where `MeshSlices` puts it on the display: the middle of its bounding box at `center_mm`
/// (else the middle of the display), its least z at 0.
TriangleMesh on_plate(const TriangleMesh& mesh, const Printer& printer,
                      const std::optional<std::array<double, 2>>& center_mm = {});

struct SolidOptions {
  int reduce = 1;                        ///< take every Nth pixel in x and y, 1..64
  const MeshDistance* design = nullptr;  ///< measures the distance of the surface, when given
};

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

/// The same surface in memory.
TriangleMesh solid_mesh(const SliceSource& stack, const PlaceModels& models,
                        const SolidOptions& options = {}, const ExecutionContext& context = {});

}  // namespace slicecorr
