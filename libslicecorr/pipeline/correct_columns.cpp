// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/correct_columns.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"

namespace slicecorr::detail {

namespace {

/// The edge heights of the node after the last slice, where no slice is shown that has it as its
/// upper node. `heights`: null without.
void add_last_heights(BandPredictor& predictor, const CorrectionPlan& plan,
                      const std::uint8_t* heights, std::size_t columns, bool in_tiles) {
  const std::uint8_t* const dark = nullptr;
  if (!in_tiles) {
    predictor.add_slice(plan.all_layers, dark, nullptr, heights);
    return;
  }
  constexpr std::size_t lanes = BandPredictor::kTileColumns;
  const std::uint8_t empty[lanes] = {};
  for (std::size_t b = 0; b < columns; b += lanes) {
    const std::size_t width = std::min(lanes, columns - b);
    std::uint8_t part[lanes] = {};
    if (heights) std::copy_n(heights + b, width, part);
    predictor.add_tile(b, width, plan.all_layers, 1, nullptr, empty, heights ? part : nullptr);
  }
}

}  // namespace

void correct_columns(const CorrectionPlan& plan, std::size_t columns, const DesignReader& read,
                     const CodedBand* left_alone, const BandDoses* doses,
                     BandCorrector::ColumnLevels most, const ColumnSinks& out,
                     const ExecutionContext& context) {
  BandCorrector corrector = doses ? BandCorrector(plan, columns, *doses)
                                  : BandCorrector(plan, columns, left_alone != nullptr);
  if (most) corrector.keep_light(std::move(most));
  LeftAloneRows left_rows(left_alone);
  const bool in_tiles = plan.model.is_plain() && !left_alone && !doses;
  CodedBand heights(columns);
  read([&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
    if ((n & 63) == 0) context.check_cancelled();
    corrector.add_layer(rows, its_heights, left_rows.at(n));
    if (n == plan.all_layers) add_last_heights(out.after, plan, its_heights, columns, in_tiles);
    if (!in_tiles) heights.append(its_heights);
  });
  std::uint8_t pixel_of[256] = {};
  for (int level = 0; level < plan.levels.size(); ++level) {
    pixel_of[level] = static_cast<std::uint8_t>(pixel_of_level(level, plan.levels.size()));
  }
  const bool all_levels = plan.levels.size() == 256;
  std::vector<std::uint8_t> pixels(columns);
  const auto shown = [&](const std::uint8_t* levels) {
    if (all_levels) return levels;
    for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
    return static_cast<const std::uint8_t*>(pixels.data());
  };
  if (in_tiles) {
    using Tile = BandCorrector::Tile;
    static_assert(Tile::kStride == BandPredictor::kTileColumns);
    std::vector<std::uint8_t> tile_pixels;
    const auto look = [&](const Tile& t) {
      const auto size = static_cast<std::size_t>(t.slices) * Tile::kStride;
      const std::uint8_t* lit = t.levels;
      if (!all_levels) {
        tile_pixels.resize(size);
        for (std::size_t k = 0; k < size; ++k) tile_pixels[k] = pixel_of[t.levels[k]];
        lit = tile_pixels.data();
      }
      out.after.add_tile(t.first_column, t.columns, t.first_slice, t.slices, lit, t.coverage,
                         t.heights);
      if (!out.before) return;
      // Slices after the part's end belong to the correction, not to the target.
      const int inside = std::clamp(plan.layers - t.first_slice, 0, t.slices);
      out.before->add_tile(t.first_column, t.columns, t.first_slice + inside, t.slices - inside,
                           nullptr, t.coverage + static_cast<std::size_t>(inside) * Tile::kStride);
      out.before->add_tile(t.first_column, t.columns, t.first_slice, inside, t.coverage,
                           t.coverage);
    };
    corrector.solve(
        [&](int n, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
          if ((n & 63) == 0) context.check_cancelled();
          out.put(n, dark ? nullptr : shown(levels));
        },
        look);
    return;
  }
  std::vector<std::uint8_t> height_rows(columns), sliced(columns);
  corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
    if ((n & 63) == 0) context.check_cancelled();
    const std::uint8_t* const lit = shown(levels);
    out.put(n, dark ? nullptr : lit);
    if (out.watch) out.watch->add_slice(n, dark ? nullptr : lit);
    const bool has_heights = n < heights.slices() && !heights.black(n);
    if (has_heights) heights.read(n, height_rows.data());
    const std::uint8_t* const left = left_rows.at(n);
    out.after.add_slice(n, lit, coverage, has_heights ? height_rows.data() : nullptr, left);
    if (!out.before) return;
    const std::uint8_t* const before =
        n < plan.layers ? as_sliced(coverage, left, sliced) : nullptr;
    out.before->add_slice(n, before, coverage, nullptr, left);
  });
}

}  // namespace slicecorr::detail
