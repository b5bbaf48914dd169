// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts as slices, whose layers are alike or of different heights.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/uneven_slices.hpp"

namespace slicecorr::cli {

/// How meshes are cut for layers of these heights: layers of different heights are found in thin ones.
MeshOptions cut_for(const LayerHeights& heights, const MeshOptions& mesh);

/// `adaptive_heights` of all parts together with the meshes among what is left alone, which may stand
/// lower: heights count from the platform. `least_and_most_um`: two numbers.
LayerHeights adaptive_heights_of(const MeshOptions& mesh,
                                 const std::vector<std::string>& left_alone,
                                 const std::vector<double>& least_and_most_um);

/// The options --layers and --adaptive-um of programs that slice, in place of their --layer-um.
void add_heights_to(CLI::App& app, std::string& table, std::vector<double>& adaptive_um);

/// What a print says of the slices of its parts.
struct LayersWanted {
  LayerHeights heights{};
  Surface surface = Surface::slices;
  std::vector<std::string> left_alone{};
};

/// Throws as `slice_parts` and `thin_slice_um`.
class PartSlices {
 public:
  PartSlices(const MeshOptions& options, const Printer& printer, const LayersWanted& wanted,
             const ExecutionContext& context, PartFacts* facts = nullptr);
  PartSlices(const PartSlices&) = delete;
  PartSlices& operator=(const PartSlices&) = delete;

  const SliceSource& operator*() const;
  bool uneven() const { return uneven_.has_value(); }
  /// The meshes as they are cut, in layers alike.
  const MeshSlices& cuts() const { return cuts_; }
  const MeshesLeftAlone& place() const { return place_; }

 private:
  MeshesLeftAlone place_;  // before the cuts, which fill it
  MeshSlices cuts_;
  std::optional<UnevenSlices> uneven_;
};

}  // namespace slicecorr::cli
