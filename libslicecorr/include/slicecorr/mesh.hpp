// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file mesh.hpp
/// Reading meshes, reporting their defects, placing them. Lengths are mm unless a name says
/// otherwise.
///
/// Supported: STL (ascii and binary, any line ending, several solids in a file), OBJ, PLY and 3MF by
/// readers of our own; OFF through OpenMesh; each also gzip-compressed (name ends in `.gz`).
/// Polygons are split into triangles as fans. 3MF with its units, components and transforms, beam
/// lattices, slices in place of a coarse mesh, and the volumes that slicers' projects take away from
/// parts, or that are none.
///
/// Plain values; all functions are thread-safe on different objects. What can't be read or used
/// throws `InputError`, a cancelled `context` `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/shrinkage.hpp"

namespace slicecorr {

using Point3 = std::array<double, 3>;

/// What triangles do to a solid.
enum class SolidRole : std::uint8_t {
  added,       ///< the solid is what they enclose ...
  taken_away,  ///< ... but nothing that these enclose, ...
  kept_within  ///< ... and, where there are such, only what lies inside them
};

/// An indexed triangle soup. Vertices are merged only where their coordinates are exactly equal.
struct TriangleMesh {
  std::vector<Point3> vertices;
  /// Indices into `vertices`, counter-clockwise seen from outside.
  std::vector<std::array<std::uint32_t, 3>> triangles;
  /// The triangles from `first` on, up to the next share's.
  struct Share {
    std::uint32_t first = 0;
    std::uint32_t solid = 0;
    SolidRole role = SolidRole::added;
  };
  /// Empty: all triangles are added to one solid. Else the first share begins with the first
  /// triangle, they follow each other, and no vertex is in two of them. The mesh is the union of its
  /// solids.
  std::vector<Share> shares = {};

  /// Whether a triangle bounds what is added to a solid: only these give the mesh its size.
  bool adds(std::size_t triangle) const {
    return shares.empty() || role_of(triangle) == SolidRole::added;
  }
  SolidRole role_of(std::size_t triangle) const;
};

/// What is wrong with a mesh. Nothing of it is changed in the mesh.
struct MeshDefects {
  std::size_t open_edges = 0;         ///< edges of one triangle only
  std::size_t crowded_edges = 0;      ///< edges of more than two triangles: bodies that touch
  std::size_t misoriented_edges = 0;  ///< edges whose two triangles run along them the same way
  std::size_t flipped_triangles =
      0;  ///< least number of triangles to turn so that neighbours agree
  std::size_t degenerate_triangles = 0;  ///< two corners at the same place
  std::size_t zero_area_triangles = 0;   ///< three different corners on a line
  std::size_t duplicate_triangles = 0;   ///< the same three corners as an earlier triangle
  /// Bodies that lie in no other and whose triangles all face inwards, beside bodies that are as they
  /// should be; only of meshes without open and misoriented edges.
  std::size_t inside_out_bodies = 0;
  /// All triangles face inwards, with or without hollows; of such meshes, too. It prints as it is.
  bool all_inside_out = false;
  bool any() const {
    return inside_out_bodies || all_inside_out || open_edges || crowded_edges ||
           misoriented_edges || flipped_triangles || degenerate_triangles || zero_area_triangles ||
           duplicate_triangles;
  }
};

/// Where triangles don't fit together: what slicing asks of a mesh besides its triangles, and what
/// `inspect` finds on its way.
struct EdgeDefects {
  /// An edge that its triangles do not run along equally often both ways, once those of `flipped`
  /// are turned: contours break there.
  struct OpenEdge {
    std::uint32_t low, high;  ///< vertices, low < high
    std::int32_t surplus;     ///< triangles that run from low to high, less those that run back
  };
  /// Those that `flipped_triangles` marks, and those of bodies that are inside out, rising.
  std::vector<std::uint32_t> flipped;
  std::vector<OpenEdge> open;  ///< by their vertices, rising
};

/// Figures of a mesh, in the units of its coordinates.
struct MeshReport {
  std::size_t vertices = 0, triangles = 0;
  std::size_t bodies = 0;  ///< parts connected through shared edges
  /// Signed volume, cubic units; meaningful for closed meshes whose bodies do not overlap. What is
  /// taken away counts as if it lay inside, what is kept within not at all.
  double volume = 0;
  Point3 lower{}, upper{};  ///< bounding box of what is added
  MeshDefects defects;
};

enum class Units { automatic, mm, inch, m };  ///< `automatic`: the file's own, else mm
/// "mm", "inch", "m"; `automatic` of all others ("auto").
Units units_named(std::string_view name);

/// How a mesh is turned and scaled before slicing: units, then scale, then rotation about x, y and
/// z (fixed axes, in that order, degrees).
struct Placement {
  Units units = Units::automatic;
  double scale = 1.0;   ///< a factor, > 0
  Point3 rotate_deg{};  ///< about x, y and z
  /// What the part will shrink by: it becomes as much larger, after it was turned, about the file's origin.
  Shrinkage shrinkage{};
};

/// Whether a file of this name is read as a mesh.
bool is_mesh_name(const std::string& path);

/// Reads one file and applies `placement`. The result is in mm, at the place the file says. What of
/// the file is no part of the mesh is told through `context`, a line for each kind, and added to
/// `notes` where that is not null (without the file's name).
/// Throws `InputError` when the file can't be read, holds no triangle, requires what is not read, or a
/// coordinate is not finite.
TriangleMesh read_mesh(const std::string& path, const Placement& placement = {},
                       const ExecutionContext& context = {},
                       std::vector<std::string>* notes = nullptr);

/// Widens a box, from `low` to `high`, by the triangles of a mesh that add material.
void widen_box(const TriangleMesh& mesh, Point3& low, Point3& high);

/// The factor with which the longest side of all files together, as `placement` turns and scales them,
/// is `longest_mm` > 0. Throws as `read_mesh`, and where they have no size.
double fit_scale(const std::vector<std::string>& files, const Placement& placement,
                 double longest_mm);

/// Counts triangles, bodies and defects; O(triangles). Writes to `edge_defects`, when it is not
/// null, which edges are open and which triangles are turned.
MeshReport inspect(const TriangleMesh& mesh, const ExecutionContext& context = {},
                   EdgeDefects* edge_defects = nullptr);

/// For each triangle whether it must be turned so that neighbours over two-triangle edges agree, by
/// the majority of each body. All false for a well-oriented mesh, also one with cavities.
std::vector<bool> flipped_triangles(const TriangleMesh& mesh, const ExecutionContext& context = {});

/// One line on the defects in words ("12 open edges, 3 flipped triangles"); empty when there are
/// none.
std::string describe(const MeshDefects& defects);

/// Appends `part` to `mesh`.
void append(TriangleMesh& mesh, const TriangleMesh& part);

/// Appends the edge defects of a part to those of the mesh that the part is to be appended to.
void append(EdgeDefects& edge_defects, const TriangleMesh& mesh, const EdgeDefects& part);

}  // namespace slicecorr
