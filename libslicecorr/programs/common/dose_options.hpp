// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What programs that correct can be told of the doses that are wanted of a part's features.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/turned.hpp"
#include "slicecorr/uneven_slices.hpp"

namespace slicecorr::cli {

struct DoseOptions {
  std::string target;                ///< a stack of 8-bit images
  double most = 0;                   ///< the dose of its white; 0: not said
  std::vector<std::string> regions;  ///< MESH=VALUE
  std::string side;                  ///< empty: nearest
  /// Where the part is no mesh that was read: the meshes that it was sliced from.
  std::vector<std::string> designs;

  void add_to(CLI::App& app);
  bool any() const { return !target.empty() || !regions.empty(); }
  /// Files that are read.
  std::vector<std::string> inputs() const;
};

/// A target with the doses that the options ask for; without options the target alone.
class WantedDoses {
 public:
  /// `target` must outlive this. `meshes`: how meshes are turned and placed. `part`: null where the
  /// part is no mesh; then regions lie beside the designs of the options or, without, where their
  /// files have them on the plate, mm from its corner and from the platform. Throws `InputError`.
  WantedDoses(const DoseOptions& options, const SliceSource& target, const Printer& printer,
              const MeshOptions& meshes, const MeshSlices* part, const MissingFacts& missing,
              const std::string& scratch, const ExecutionContext& context);
  WantedDoses(const WantedDoses&) = delete;
  WantedDoses& operator=(const WantedDoses&) = delete;
  const SliceSource& operator*() const { return graded_ ? *graded_ : *target_; }

 private:
  void read_regions(const DoseOptions& options, const Printer& printer, const MeshOptions& meshes,
                    const MeshSlices* part, const ExecutionContext& context);

  const SliceSource* target_;
  std::optional<StackReader> stack_;
  std::vector<std::unique_ptr<const MeshInLayers>> slices_;
  std::optional<RegionImages> images_;
  std::optional<FittedSlices> fitted_;
  DoseTarget doses_;
  std::optional<GradedTarget> graded_;
};

}  // namespace slicecorr::cli
