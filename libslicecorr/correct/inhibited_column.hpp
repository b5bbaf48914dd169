/// Correction of pixel columns under inhibiting UV light (physics.md §5 asks for it; the rule is
/// explained in docs/inhibition.md).
///
/// A slice hardly acts on its own node: the kernel is 0 in the dead zone and greatest at z0 above
/// the window. Solving each slice for its own node makes light swing between its limits. So slice n
/// is chosen for the nodes up to `lag` slices above it, together: the least level with which each
/// of them still reaches its dose, if the slices to come keep that level as long as they belong to
/// the same body, and black after it. A node once promised its dose never asks for more light later
/// than it was promised: levels settle. Lower edges further ahead ask for light as soon as full
/// light from the next slice on would come too late.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// Layers [first, end) of a column have this coverage, 1..255.
struct CoverageRun {
  std::int32_t first = 0, end = 0;
  std::uint8_t coverage = 0;
  bool operator==(const CoverageRun&) const = default;
};

/// Light that black does not give: entries of the kernel's tables less those of level 0, per UV
/// setting, with running sums over the distance.
class ExtraLight {
 public:
  ExtraLight(const InhibitedKernel& kernel, InhibitedKernel::LayerPosition place);
  /// What a slice of level l adds j layers above its own.
  double one(int setting, int l, int j) const;
  const double* row(int setting, int j) const {
    return tables_[static_cast<std::size_t>(setting)].data() + j * levels_;
  }
  /// Sum of one(l, i) over i < j.
  double sum(int setting, int l, int j) const;

 private:
  int near_, levels_;
  double a_;
  std::vector<std::vector<double>> tables_, sums_;
};

/// What all columns share.
struct InhibitedPlan {
  InhibitedPlan(const CureModel& model, bool merge_one_slice_gaps, int layers, int all_layers);

  std::shared_ptr<const InhibitedKernel> kernel;
  ExtraLight node_light, middle_light;
  std::vector<double> ratio;  ///< per slice; empty: all 1
  int near, levels, layers, all_layers;
  /// Highest level in use, per setting.
  std::vector<int> caps;
  int steady = 0;     ///< lowest level whose steady dose is at least 1, in the first setting
  double inside = 1;  ///< what nodes inside features demand
  int holding = 0;    ///< lowest level whose steady dose is what nodes inside features demand
  int reach = 0;      ///< slices of full light that lift the dose from 0 to 1
  double layer_um = 0;
  bool merge_one_slice_gaps = false;
  bool uniform = true;                         ///< one setting and one exposure for all slices
  std::vector<int> lags;                       ///< to be tried, the best guess first
  std::vector<double> dark_node, dark_middle;  ///< dose that black slices alone leave, per layer
  std::vector<double> dark_far;  ///< of dark_node, what slices near and more layers away leave
  /// The same at InhibitedKernel::samples places of each layer; layer by layer only.
  std::vector<float> dark_fine;
  double tolerance_um = 1;  ///< edges nearer than this are good enough
};

/// Chooses the levels of columns one by one; keeps its buffers. For one thread.
class InhibitedColumn {
 public:
  explicit InhibitedColumn(const InhibitedPlan& plan);
  ~InhibitedColumn();
  /// `runs`: what is covered, first layer first. Returns the levels of all slices; valid until the
  /// next call.
  const std::vector<std::uint8_t>& solve(const std::vector<CoverageRun>& runs);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::detail
