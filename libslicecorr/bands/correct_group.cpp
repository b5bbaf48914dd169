// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/correct_group.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "bands/pixels_of_levels.hpp"
#include "bands/robust_design.hpp"
#include "base/coded_band.hpp"

namespace slicecorr::detail {

namespace {

/// The edge heights of the node after the last slice, where no slice is shown that has it as its
/// upper node, in tiles. `heights`: null without.
void add_last_heights(BandPredictor& predictor, int slice, const std::uint8_t* heights,
                      std::size_t columns) {
  constexpr std::size_t lanes = BandPredictor::kTileColumns;
  const std::uint8_t empty[lanes] = {};
  for (std::size_t b = 0; b < columns; b += lanes) {
    const std::size_t width = std::min(lanes, columns - b);
    std::uint8_t part[lanes] = {};
    if (heights) std::copy_n(heights + b, width, part);
    predictor.add_tile({b, width, slice, 1}, nullptr, {empty, heights ? part : nullptr});
  }
}

/// Solves a plain band in tiles, which are predicted while they lie in the nearest cache.
void solve_in_tiles(BandCorrector& corrector, const CorrectionPlan& plan, const GroupListeners& to,
                    const BandCorrector::Sink& sink) {
  using Tile = BandCorrector::Tile;
  static_assert(Tile::kStride == BandPredictor::kTileColumns);
  const PixelsOfLevels pixels_of(plan.levels.size());
  std::vector<std::uint8_t> room;
  corrector.solve(sink, [&](const Tile& t) {
    const auto size = static_cast<std::size_t>(t.slices) * Tile::kStride;
    const std::uint8_t* const lit = pixels_of(t.levels, size, room);
    to.after->add_tile({t.first_column, t.columns, t.first_slice, t.slices}, lit,
                       {t.coverage, t.heights});
    if (!to.before) return;
    // Slices after the part's end belong to the correction, not to the target.
    const int inside = std::clamp(plan.layers - t.first_slice, 0, t.slices);
    to.before->add_tile({t.first_column, t.columns, t.first_slice + inside, t.slices - inside},
                        nullptr, t.coverage + static_cast<std::size_t>(inside) * Tile::kStride);
    to.before->add_tile({t.first_column, t.columns, t.first_slice, inside}, t.coverage, t.coverage);
  });
}

/// The slices of a band that is kept from the last slice on, from the first on.
CodedBand upright(const CodedBand& upwards) {
  CodedBand shown(upwards.columns());
  for (int n = upwards.slices(); n-- > 0;) shown.append_of(upwards, n);
  return shown;
}

/// Corrects a group so that features and gaps hold although inputs are off. What prints is measured
/// against the design itself, not against what was aimed at.
void correct_robustly(const PlacePlans& plans, const DesignGroup& group, const GroupListeners& to,
                      const ExecutionContext& context) {
  const CorrectionPlan& plan = plans.plan(group.value);
  const RobustAsk ask{*plans.robust(), plans.cases(group.value),
                      group.doses ? &*group.doses : nullptr};
  CodedDesign design(group.columns, group.heights != nullptr, group.left_alone);
  group.read(Surface::mesh, [&](int n, const std::uint8_t* rows, const std::uint8_t* heights) {
    design.append(rows, heights);
    if (to.design) to.design(n, rows, heights);
  });
  const RobustLevels made = robust_levels(plan, ask, design, context);
  const int slices = plan.all_layers;
  const PixelsOfLevels pixels_of(plan.levels.size());
  std::vector<std::uint8_t> levels(group.columns), room;
  // Pixels from the last slice to the first.
  const auto pixels = [&](const CodedBand& upwards, const PutRows& put) {
    for (int at = 0; at < slices; ++at) {
      const bool black = upwards.black(at);
      if (!black) upwards.read(at, levels.data());
      put(slices - 1 - at, black ? nullptr : pixels_of(levels.data(), group.columns, room));
    }
  };
  const auto predict = [&](BandPredictor* predictor, const CodedBand& upwards) {
    if (predictor) predict_shown(*predictor, {upright(upwards), slices}, design, context);
  };
  CodedBand shown(group.columns), plain(group.columns);
  pixels(made.levels, [&](int n, const std::uint8_t* rows) {
    shown.append(rows);
    to.put(n, rows);
    if (to.watch) to.watch->add_slice(n, rows);
  });
  predict(to.after, shown);
  if (to.plain) {
    pixels(made.plain, [&](int, const std::uint8_t* rows) { plain.append(rows); });
    predict(to.plain, plain);
  }
  if (to.robust) to.robust->merge(made.figures);
}

}  // namespace

void correct_group(const CorrectionPlan& plan, const DesignGroup& group, const GroupListeners& to,
                   const ExecutionContext& context) {
  const std::size_t columns = group.columns;
  BandCorrector corrector = group.doses ? BandCorrector(plan, columns, group.doses->of_columns())
                                        : BandCorrector(plan, columns, group.left_alone != nullptr);
  if (to.most) corrector.keep_light(to.most);
  LeftAloneRows left_rows(group.left_alone);
  const bool in_tiles = to.after && plan.model.is_plain() && !group.left_alone && !group.doses &&
                        !plan.merge_one_slice_gaps;
  CodedBand heights(columns);
  group.read(Surface::mesh, [&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
    if ((n & 63) == 0) context.check_cancelled();
    corrector.add_layer(rows, its_heights, left_rows.at(n));
    if (to.design) to.design(n, rows, its_heights);
    if (!to.after) return;
    if (!in_tiles) heights.append(its_heights);
    if (n != plan.all_layers) return;
    if (in_tiles) return add_last_heights(*to.after, n, its_heights, columns);
    const std::uint8_t* const dark = nullptr;
    to.after->add_slice(n, dark, {nullptr, its_heights});
  });
  const PixelsOfLevels pixels_of(plan.levels.size());
  std::vector<std::uint8_t> pixels, height_rows(columns), sliced(columns);
  const BandCorrector::Sink sink = [&](int n, const std::uint8_t* levels,
                                       const std::uint8_t* coverage, bool dark) {
    if ((n & 63) == 0) context.check_cancelled();
    if (in_tiles) return to.put(n, dark ? nullptr : pixels_of(levels, columns, pixels));
    const std::uint8_t* const lit = pixels_of(levels, columns, pixels);
    to.put(n, dark ? nullptr : lit);
    if (to.watch) to.watch->add_slice(n, dark ? nullptr : lit);
    if (!to.after) return;
    const bool has_heights = n < heights.slices() && !heights.black(n);
    if (has_heights) heights.read(n, height_rows.data());
    const std::uint8_t* const left = left_rows.at(n);
    to.after->add_slice(n, lit, {coverage, has_heights ? height_rows.data() : nullptr, left});
    if (!to.before) return;
    const std::uint8_t* const before =
        n < plan.layers ? as_sliced(coverage, left, sliced) : nullptr;
    to.before->add_slice(n, before, {coverage, nullptr, left});
  };
  if (in_tiles) {
    solve_in_tiles(corrector, plan, to, sink);
  } else {
    corrector.solve(sink);
  }
}

void correct_group(const PlacePlans& plans, const DesignGroup& group, const GroupListeners& to,
                   const ExecutionContext& context) {
  if (plans.robust()) return correct_robustly(plans, group, to, context);
  GroupListeners kept = to;
  kept.most = plans.even_levels(group.value, group.place);
  correct_group(plans.plan(group.value), group, kept, context);
}

void correct_band(const SliceSource& target, const PlacePlans& plans, const PixelBox& band,
                  const PutRows& put, const ExecutionContext& context) {
  DesignBand(target, plans.models().map(), band)
      .each(
          plans.all_layers(),
          [&](const DesignGroup& group, const PutRows& put_rows) {
            correct_group(plans, group, {put_rows}, context);
          },
          put);
}

}  // namespace slicecorr::detail
