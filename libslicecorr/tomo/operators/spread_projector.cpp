// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/spread_projector.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::tomo::detail {

namespace {

class SpreadProjector final : public Projector {
 public:
  SpreadProjector(std::shared_ptr<const Projector> of_light, const TomoGrid& grid,
                  std::shared_ptr<const DoseSpread> spread, SpreadSeries series)
      : of_light_(std::move(of_light)),
        from_(grid),
        spread_(std::move(spread)),
        series_(std::move(series)),
        grid_(spread_grid(grid)) {}

  Shape shape() const override { return grid_.shape(); }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    Array<float> numbers(spread_->size(), 0.0F);
    const auto lanes = static_cast<std::size_t>(grid_.lanes());
    each_column([&](int x, int y, std::size_t at) {
      std::copy_n(field + column(x, y) * lanes, grid_.slices, numbers.data() + at);
    });
    spread_->apply(series_, numbers, context);
    each_block(context, [&](std::size_t b, const ExecutionContext& inside) {
      Array<float> part(from_.voxels_of_block(), 0.0F);
      const auto part_lanes = static_cast<std::size_t>(from_.lanes());
      each_column([&](int x, int y, std::size_t at) {
        std::copy_n(numbers.data() + at + b * part_lanes, from_.lanes_used(b),
                    part.data() + column(x, y) * part_lanes);
      });
      if (same_light()) {
        of_light_->forward(b, part.data(), light, inside);
        return;
      }
      Array<float> lines(from_.light_of_block());
      of_light_->forward(b, part.data(), lines.data(), inside);
      each_light_row(b, [&](std::size_t in, std::size_t out, std::size_t count) {
        std::copy_n(lines.data() + in, count, light + out);
      });
    });
    if (!same_light()) clear_unused(light);
  }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    Array<float> numbers(spread_->size(), 0.0F);
    each_block(context, [&](std::size_t b, const ExecutionContext& inside) {
      Array<float> part(from_.voxels_of_block());
      const auto part_lanes = static_cast<std::size_t>(from_.lanes());
      if (same_light()) {
        of_light_->adjoint(b, light, part.data(), inside);
      } else {
        Array<float> lines(from_.light_of_block(), 0.0F);
        each_light_row(b, [&](std::size_t in, std::size_t out, std::size_t count) {
          std::copy_n(light + out, count, lines.data() + in);
        });
        of_light_->adjoint(b, lines.data(), part.data(), inside);
      }
      each_column([&](int x, int y, std::size_t at) {
        std::copy_n(part.data() + column(x, y) * part_lanes, from_.lanes_used(b),
                    numbers.data() + at + b * part_lanes);
      });
    });
    spread_->apply(series_, numbers, context);
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    const auto lanes = static_cast<std::size_t>(grid_.lanes());
    each_column([&](int x, int y, std::size_t at) {
      std::copy_n(numbers.data() + at, grid_.slices, field + column(x, y) * lanes);
    });
  }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    if (grid_.slices != 1 || slices.size() != 1) {
      throw InputError("slices", "", "share the dose that spreads");
    }
    return make_spread_projector(of_light_->of_slices(slices), from_, spread_, series_);
  }

 private:
  bool same_light() const { return grid_ == from_; }
  std::size_t column(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid_.voxels) +
           static_cast<std::size_t>(x);
  }
  template <class Use>
  void each_column(const Use& use) const {
    for (int y = 0; y < grid_.voxels; ++y) {
      const TomoGrid::Range row = grid_.inside(y);
      for (int x = row.first; x < row.end; ++x) use(x, y, spread_->at(x, y));
    }
  }
  template <class Use>
  void each_block(const ExecutionContext& context, const Use& use) const {
    const std::size_t blocks = from_.blocks();
    const ExecutionContext inside = inside_block(context, blocks);
    parallel_for(slicecorr::detail::silent(context), "", blocks,
                 [&](std::size_t b) { use(b, inside); });
  }
  /// use(from, to, count): where the numbers of a pixel are in a block of light, and in all light.
  template <class Use>
  void each_light_row(std::size_t block, const Use& use) const {
    const auto lanes = static_cast<std::size_t>(from_.light_lanes()),
               all_lanes = static_cast<std::size_t>(grid_.light_lanes()),
               used = static_cast<std::size_t>(from_.lanes_used(block));
    const std::size_t pixels =
        static_cast<std::size_t>(grid_.angles) * static_cast<std::size_t>(grid_.pixels);
    for (std::size_t p = 0; p < pixels; ++p) use(p * lanes, p * all_lanes + block * lanes, used);
  }
  /// Rows that stand for no slice.
  void clear_unused(float* light) const {
    const auto lanes = static_cast<std::size_t>(grid_.light_lanes());
    const auto used = static_cast<std::size_t>(grid_.slices);
    for (std::size_t at = 0; at < grid_.light_of_block(); at += lanes) {
      std::fill(light + at + used, light + at + lanes, 0.0F);
    }
  }

  std::shared_ptr<const Projector> of_light_;
  TomoGrid from_;
  std::shared_ptr<const DoseSpread> spread_;
  SpreadSeries series_;
  TomoGrid grid_;
};

}  // namespace

TomoGrid spread_grid(const TomoGrid& grid) {
  if (grid.coupled() || grid.slices < 2) return grid;
  TomoGrid spread = grid;
  spread.rows = grid.slices;
  spread.slice_mm = grid.slice_height_mm();
  spread.lowest_mm = -0.5 * (grid.slices - 1) * spread.slice_mm;
  return spread;
}

std::unique_ptr<Projector> make_spread_projector(std::shared_ptr<const Projector> of_light,
                                                 const TomoGrid& grid,
                                                 std::shared_ptr<const DoseSpread> spread,
                                                 SpreadSeries series) {
  return std::make_unique<SpreadProjector>(std::move(of_light), grid, std::move(spread),
                                           std::move(series));
}

Target spread_target(const Target& target) {
  Target spread = target;
  spread.grid = spread_grid(target.grid);
  if (spread.grid == target.grid) return spread;
  const std::size_t numbers = spread.grid.blocks() * spread.grid.voxels_of_block();
  spread.kinds.assign(numbers, Kind::neither);
  const auto prepare = [&](Array<float>& of, float outside) {
    if (!of.empty()) of.assign(numbers, outside);
  };
  prepare(spread.least, 0);
  prepare(spread.most, std::numeric_limits<float>::infinity());
  prepare(spread.weight, 0);
  for (int z = 0; z < target.grid.slices; ++z) {
    for (int y = 0; y < target.grid.voxels; ++y) {
      for (int x = 0; x < target.grid.voxels; ++x) {
        const std::size_t to = spread.grid.voxel(x, y, z), from = target.grid.voxel(x, y, z);
        spread.kinds[to] = target.kinds[from];
        if (!spread.least.empty()) spread.least[to] = target.least[from];
        if (!spread.most.empty()) spread.most[to] = target.most[from];
        if (!spread.weight.empty()) spread.weight[to] = target.weight[from];
      }
    }
  }
  return spread;
}

Light light_of_slices(Light light, const TomoGrid& grid) {
  if (light.grid == grid) return light;
  Light slices(grid);
  for (int m = 0; m < grid.angles; ++m) {
    for (int i = 0; i < grid.pixels; ++i) {
      for (int z = 0; z < grid.slices; ++z) {
        slices.values[grid.pixel(m, i, z)] = light.values[light.grid.pixel(m, i, z)];
      }
    }
  }
  return slices;
}

}  // namespace slicecorr::tomo::detail
