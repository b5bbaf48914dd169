/// What every program that slices can be told of its meshes.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::cli {

struct MeshOptions {
  std::vector<std::string> parts;
  double layer_um = 0;
  std::string antialias = "on";
  std::string surface = "slices";
  std::vector<double> center_mm;
  std::string units = "auto";
  double scale = 1.0;
  std::vector<double> rotate_deg;
  void add_to(CLI::App& app);
  /// Only how meshes are turned, scaled and placed; `add_to` has these, too.
  void add_placement_to(CLI::App& app);
  /// Whether targets have edge heights.
  void add_surface_to(CLI::App& app);
  Surface wanted_surface() const { return surface == "mesh" ? Surface::mesh : Surface::slices; }
  Placement placement() const;
  SliceOptions slice_options() const;
};

struct PlateParts {
  TriangleMesh mesh;
  EdgeDefects edge_defects;
};

/// Reads and places all parts; tells their figures and defects through `context`.
PlateParts read_parts(const MeshOptions& options, const ExecutionContext& context);

/// Reads all parts to be sliced for this printer.
MeshSlices slice_parts(const MeshOptions& options, const Printer& printer,
                       const ExecutionContext& context);

}  // namespace slicecorr::cli
