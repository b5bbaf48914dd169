// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file plate.hpp
/// What a browser shows of parts before they are printed: triangles in the round, and layers.
///
/// Three files in a folder, all little-endian:
///
///     plate.json   sizes, counts, what is wrong with the parts
///     plate.bin    "SCP1", uint32 triangles, float32 lower[3], upper[3] (mm on the plate, z from the
///                  platform), then 9 uint16 per triangle: x, y, z of its corners, 0 at lower and
///                  65535 at upper
///     layers.bin   "SCL1", uint32 layers, uint64 offsets[layers + 1] from the file's begin, then a
///                  PNG per layer: the box of pixels that any layer lights
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::farm::detail {

/// Most triangles that are sent.
inline constexpr std::size_t kMostShownTriangles = 120'000;
/// Layers are sent in images of at most so many pixels a side.
inline constexpr int kMostLayerPixels = 2048;

/// The mesh with corners joined that lie close together, until it has at most `most` triangles.
TriangleMesh simplified(const TriangleMesh& mesh, std::size_t most);

/// Faces of a stack's cells, at most `most_cells` a side, where it has no mesh: mm, as `on_plate` has
/// meshes.
TriangleMesh cell_faces(const SliceSource& stack, int most_cells);

std::string triangles_file(const TriangleMesh& mesh);

/// One layer of layers.bin; empty when the file has no such layer, or is none.
std::string layer_png(const std::string& path, std::int64_t layer);

struct PlateJob {
  std::string stack;        ///< sliced, or an archive of slices
  cli::MeshOptions meshes;  ///< that were sliced, and how they share the plate; no parts: none
  std::string printer;
  double layer_um = 0;  ///< where the stack says none
  std::string folder;   ///< to write to
};

/// Writes the three files. Throws `InputError`, `DeviceError`, `Cancelled`.
void write_plate(const PlateJob& job, const ExecutionContext& context);

}  // namespace slicecorr::farm::detail
