// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Whether a target can be the one that a stack is to be measured against.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>

#include "bands/bands.hpp"
#include "parallel/silent.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

namespace {

/// How the columns of a stack and a target overlap.
struct SharedVoxels {
  std::uint64_t both = 0;             ///< columns lit in the stack in which something is designed
  std::uint64_t stack_only = 0;       ///< lit, with nothing designed
  std::uint64_t full_only = 0;        ///< with a voxel of coverage 1, never lit
  std::uint64_t coverage = 0;         ///< sum of the target's values
  int stack_end = 0, target_end = 0;  ///< 1 more than the last slice that is not black
  bool full = false;                  ///< the target has a voxel of coverage 1

  bool lit() const { return both + stack_only > 0; }
  void merge(const SharedVoxels& o) {
    both += o.both;
    stack_only += o.stack_only;
    full_only += o.full_only;
    coverage += o.coverage;
    stack_end = std::max(stack_end, o.stack_end);
    target_end = std::max(target_end, o.target_end);
    full = full || o.full;
  }
};

/// The greatest value of each column of a band; gives 1 more than the last slice not black.
int greatest_values(const SliceSource& source, const PixelBox& band,
                    const ExecutionContext& context, std::vector<std::uint8_t>& most,
                    std::uint64_t* sum) {
  int end = 0;
  source.read_band(band, [&](int n, const std::uint8_t* rows) {
    if ((n & 63) == 0) context.check_cancelled();
    if (!rows) return;
    std::uint8_t any = 0;
    for (std::size_t k = 0; k < most.size(); ++k) {
      any |= rows[k];
      most[k] = std::max(most[k], rows[k]);
    }
    if (any) end = n + 1;
    if (any && sum) *sum = std::accumulate(rows, rows + most.size(), *sum);
  });
  return end;
}

/// Throws `InputError` where target or stack have layers of different heights, and the other one's are
/// not the same.
void check_heights(const StackInfo& info, const SliceSource& target, const std::string& name) {
  const LayerHeights heights = target.heights();
  const Grid& grid = target.grid();
  const bool alike =
      info.layer_heights_um.empty() && (!info.process || info.process->layer_heights_um.empty());
  if (heights.alike() && alike) return;
  for (int n = 0; n < grid.layers; ++n) {
    const double um = heights.of(n, grid.layer_um), shown_um = layer_height_um(info, n);
    if (std::abs(um - shown_um) <= 0.01 * um) continue;
    throw InputError(
        name, "",
        fmt::format("can't be the target of this stack: its layer {} is {:g} um high, that "
                    "of the stack {:g} um; expected the same heights",
                    n, um, shown_um));
  }
}

SharedVoxels overlap_of(const SliceSource& stack, const SliceSource& target,
                        const ExecutionContext& context) {
  SharedVoxels all;
  std::mutex merging;
  const auto bands = detail::bands_of(stack.grid(), stack.bounds().united(target.bounds()));
  parallel_for(detail::silent(context), "", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    std::vector<std::uint8_t> lit(detail::columns_of(band), 0), designed = lit;
    SharedVoxels o;
    o.stack_end = greatest_values(stack, band, context, lit, nullptr);
    o.target_end = greatest_values(target, band, context, designed, &o.coverage);
    if (target.left_alone()) {
      o.target_end = std::max(o.target_end, greatest_values(*target.left_alone(), band, context,
                                                            designed, &o.coverage));
    }
    for (std::size_t k = 0; k < lit.size(); ++k) {
      o.both += lit[k] && designed[k];
      o.stack_only += lit[k] && !designed[k];
      o.full_only += !lit[k] && designed[k] == 255;
      o.full = o.full || designed[k] == 255;
    }
    const std::lock_guard lock(merging);
    all.merge(o);
  });
  return all;
}

}  // namespace

void check_target(const SliceSource& stack, const StackInfo& info, const SliceSource& target,
                  const std::string& name, std::optional<std::uint64_t> pixel_sum,
                  const ExecutionContext& context) {
  const Grid& grid = target.grid();
  check_same_voxels(stack.grid(), grid);
  refuse_recording(target);
  check_heights(info, target, name);
  if (info.process && info.process->surface == Surface::mesh && !target.edge_heights()) {
    context.tell(name +
                 ": knows no edge heights, to which the stack was corrected: errors are measured "
                 "from its slices; expected the target as sliced (.uvj)");
  }
  const auto volume_of = [&](std::uint64_t sum) {
    return static_cast<double>(sum) / 255.0 * grid.pixel_x_um * grid.pixel_y_um * grid.layer_um *
           1e-9;
  };
  // A sum of whole numbers times the same sizes: equal to the last bits if it is the same part.
  const auto is_its = [&](double volume_mm3) {
    return info.part_volume_mm3 > 0 &&
           std::abs(volume_mm3 - info.part_volume_mm3) <= 1e-9 * volume_mm3;
  };
  const PixelBox lit = stack.bounds(), designed = target.bounds();
  const bool inside = lit.x0 >= designed.x0 && lit.x1 <= designed.x1 && lit.y0 >= designed.y0 &&
                      lit.y1 <= designed.y1;
  if (info.kind != StackKind::foreign && info.target_layers == grid.layers && inside && pixel_sum &&
      is_its(volume_of(*pixel_sum))) {
    return;
  }
  const SharedVoxels o = overlap_of(stack, target, context);
  if (!o.full) detail::refuse_vanished(target, name);
  const auto refuse = [&](const std::string& what) {
    throw InputError(name, "",
                     "can't be the target of this stack: " + what +
                         "; expected the slices of the part that the stack is to print");
  };

  const bool corrected = info.kind == StackKind::corrected;
  const bool made_from = corrected || info.kind == StackKind::recorded;
  const double volume_mm3 = volume_of(o.coverage);
  // Sums of pixels tell volumes where layers are alike.
  const bool alike = !info.process || info.process->layer_heights_um.empty();
  const bool volume_known = made_from && info.part_volume_mm3 > 0 && alike;
  const bool same_volume = volume_known && is_its(volume_mm3);

  // Compare heights; black slices at the end of a target print nothing and don't count.
  if (made_from && info.target_layers > 0) {
    const bool black_more = grid.layers > info.target_layers && o.target_end <= info.target_layers;
    if (grid.layers != info.target_layers && !same_volume && !black_more) {
      refuse(fmt::format("it has {} layers, the stack was made from {}", grid.layers,
                         info.target_layers));
    }
    if (grid.layers != info.target_layers && !black_more) {
      context.tell(fmt::format(
          "{}: has {} layers, the stack was made from {}: the same part at another height, from "
          "which all edges are off, unless its first layers are left out there",
          name, grid.layers, info.target_layers));
    }
  } else if (!made_from && o.lit()) {
    // Stacks of other programs may go on after the part's end to cure it through.
    const bool too_high =
        info.kind == StackKind::target && o.stack_end > 2 * std::int64_t{o.target_end};
    if (too_high || o.target_end > 2 * std::int64_t{o.stack_end}) {
      refuse(fmt::format("its last lit layer is the {}., that of the stack the {}.", o.target_end,
                         o.stack_end));
    }
  }

  // Compare places. Where a target is sliced otherwise (anti-aliased or not), pixels at its rim
  // differ.
  const std::uint64_t columns = o.both + o.stack_only + o.full_only;
  if (corrected ? 2 * o.both < columns : o.lit() && o.both == 0) {
    refuse(
        fmt::format("of {} pixels that are lit in the stack or covered in the target only {} are "
                    "both: it lies elsewhere, or is another part",
                    columns, o.both));
  }
  if (!volume_known || same_volume) return;
  const double ratio = volume_mm3 / info.part_volume_mm3;
  if (ratio < 0.5 || ratio > 2) {
    refuse(fmt::format("it holds {:.6g} mm³, the stack was made from {:.6g} mm³", volume_mm3,
                       info.part_volume_mm3));
  }
  context.tell(
      fmt::format("{}: holds {:.8g} mm³, the stack was made from {:.8g} mm³: it is sliced "
                  "otherwise, or another part of the same height and place",
                  name, volume_mm3, info.part_volume_mm3));
}

}  // namespace slicecorr
