// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/square_projector.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "tomo/operators/cell_lines.hpp"
#include "tomo/operators/directions.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/shade.hpp"
#include "tomo/operators/square_kernels.hpp"

namespace slicecorr::tomo::detail {

namespace {

using slicecorr::detail::silent;

/// Directions whose light is made ready together, and of these those that a row adds at once.
constexpr int kBatch = 16;
/// Rows of voxels that one thread takes.
constexpr int kRows = 8;

class SquareProjector final : public Projector {
 public:
  SquareProjector(const TomoGrid& grid, const RayTables& optics, const Volume* insert)
      : grid_(grid),
        lit_(static_cast<float>(optics.lit)),
        first_mm_(optics.line_mm.empty() ? grid.pixel_at_mm(0) : optics.line_mm[0]) {
    grid.check();
    std::vector<float> entry;
    double most_mm = 0;
    for (int i = 0; i < grid.pixels; ++i) {
      const double t = first_mm_ + i * grid.pixel_mm;
      if (!optics.line_mm.empty() &&
          std::abs(optics.line_mm[static_cast<std::size_t>(i)] - t) > 1e-6 * grid.pixel_mm) {
        throw InputError("optics", "line_mm", "must be as far apart as the grid's pixels");
      }
      const double r = grid.radius_mm;
      const double chord = std::sqrt(std::max(0.0, r * r - t * t));
      const double weight = optics.weight.empty() ? 1 : optics.weight[static_cast<std::size_t>(i)];
      entry.push_back(static_cast<float>(weight * std::exp(-optics.alpha_per_mm * chord)));
      if (weight > 0) most_mm = std::max(most_mm, std::min(std::abs(t), r));
    }
    const bool turned = !optics.turn_rad.empty();
    directions_ = Directions::of(grid.angles, most_mm, grid.voxel_mm(), turned);
    if (turned) {
      lines_.emplace(grid, optics, directions_, std::move(entry));
    } else {
      lines_.emplace(grid, directions_, std::move(entry));
    }
    make_dimming(optics.alpha_per_mm);
    // A voxel's diagonal and its way while the vial turns, in pixels.
    const double widest =
        (std::sqrt(2.0) * grid.voxel_mm() + grid.radius_mm * directions_.width_rad()) /
            grid.pixel_mm +
        3 * kLeastBox;
    taps_ = static_cast<int>(std::ceil(widest)) + 1;
    if (insert != nullptr) cast(*insert);
  }

  Shape shape() const override { return grid_.shape(); }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    auto part = std::make_unique<SquareProjector>(*this);
    part->grid_.slices = static_cast<int>(slices.size());
    if (shade_.empty()) return part;
    const auto from = static_cast<std::size_t>(grid_.lanes()),
               to = static_cast<std::size_t>(part->grid_.lanes());
    part->shade_.assign(part->grid_.blocks() * rows_of_block(), {});
    for (std::size_t z = 0; z < slices.size(); ++z) {
      const auto slice = static_cast<std::size_t>(slices[z]);
      for (std::size_t row = 0; row < rows_of_block(); ++row) {
        for (const Shaded& s : shade_[slice / from * rows_of_block() + row]) {
          if ((s.slices >> (slice % from) & 1) == 0) continue;
          part->shade(z / to * rows_of_block() + row, s.x, 1U << (z % to));
        }
      }
    }
    return part;
  }

  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    const std::size_t padded = padded_size();
    Array<float> lines(kBatch * padded);
    for (int k0 = 0; k0 < directions_.count(); k0 += kBatch) {
      const int count = std::min(kBatch, directions_.count() - k0);
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        float* const to = lines.data() + i * padded;
        std::fill_n(to, margin(), 0.0F);
        std::fill_n(to + padded - margin(), margin(), 0.0F);
        lines_->of_cell(k0 + static_cast<int>(i), lanes(), light, to + margin());
      });
      parallel_for(quiet, "", pieces(), [&](std::size_t piece) {
        Scratch& scratch = thread_scratch();
        for (int y = static_cast<int>(piece) * kRows; y < end_of(piece); ++y) {
          const TomoGrid::Range in = grid_.inside(y);
          if (in.first >= in.end) continue;
          for (int i = 0; i < count; ++i) {
            const SquareRow row = row_of(k0 + i, y, in);
            weigh(row, scratch);
            gather_row(row, grid_.lanes(), scratch.first.data(), scratch.weights.data(),
                       masks(block, k0 + i, y, in, scratch),
                       lines.data() + static_cast<std::size_t>(i) * padded + margin(),
                       field + grid_.voxel(in.first, y, 0));
          }
        }
      });
    }
  }

  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    const std::size_t padded = padded_size();
    Array<float> lines(kBatch * padded);
    for (int k0 = 0; k0 < directions_.count(); k0 += kBatch) {
      const int count = std::min(kBatch, directions_.count() - k0);
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        Scratch& scratch = thread_scratch();
        const int k = k0 + static_cast<int>(i);
        float* const to = lines.data() + i * padded;
        std::fill_n(to, padded, 0.0F);
        for (int y = 0; y < grid_.voxels; ++y) {
          const TomoGrid::Range in = grid_.inside(y);
          if (in.first >= in.end) continue;
          const SquareRow row = row_of(k, y, in);
          weigh(row, scratch);
          scatter_row(row, grid_.lanes(), scratch.first.data(), scratch.weights.data(),
                      masks(block, k, y, in, scratch), field + grid_.voxel(in.first, y, 0),
                      to + margin());
        }
      });
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.pixels), [&](std::size_t i) {
        for (int k = k0; k < k0 + count; ++k) {
          lines_->back(k, static_cast<int>(i), lanes(),
                       lines.data() + static_cast<std::size_t>(k - k0) * padded + margin(), light);
        }
      });
    }
  }

 private:
  struct Shaded {
    int x = 0;
    std::uint32_t slices = 0;  ///< of the block, that are dark
  };
  struct Scratch {
    std::vector<int> first;
    Array<float> weights;
    std::vector<std::uint32_t> masks;
  };
  static Scratch& thread_scratch() {
    static thread_local Scratch scratch;
    return scratch;
  }

  ExecutionContext worth(const ExecutionContext& context) const {
    ExecutionContext quiet = silent(context);
    const double work = static_cast<double>(grid_.voxels_of_block()) * directions_.count() / 5e6;
    quiet.threads = static_cast<int>(std::clamp(work, 1.0, 1.0 * thread_count(context)));
    return quiet;
  }
  std::size_t lanes() const { return static_cast<std::size_t>(grid_.lanes()); }
  /// Dark pixels on either side, for voxels whose light lies beside the image.
  std::size_t margin() const { return static_cast<std::size_t>(taps_) * lanes(); }
  std::size_t padded_size() const {
    return static_cast<std::size_t>(grid_.pixels) * lanes() + 2 * margin();
  }
  std::size_t pieces() const {
    return static_cast<std::size_t>((grid_.voxels + kRows - 1) / kRows);
  }
  int end_of(std::size_t piece) const {
    return std::min(grid_.voxels, (static_cast<int>(piece) + 1) * kRows);
  }
  std::size_t rows_of_block() const {
    return static_cast<std::size_t>(directions_.count()) * static_cast<std::size_t>(grid_.voxels);
  }

  void make_dimming(double alpha_per_mm) {
    const auto n = static_cast<std::size_t>(grid_.voxels);
    const auto count = static_cast<std::size_t>(directions_.count());
    for (std::size_t k = 0; k < count; ++k) {
      const double th = directions_.angle_rad(static_cast<int>(k));
      cosine_.push_back(std::cos(th));
      sine_.push_back(std::sin(th));
    }
    if (alpha_per_mm == 0) return;
    ex_.resize(count * n);
    ey_.resize(count * n);
    for (std::size_t k = 0; k < count; ++k) {
      for (std::size_t i = 0; i < n; ++i) {
        const double x = grid_.voxel_at_mm(static_cast<int>(i));
        ex_[k * n + i] = static_cast<float>(std::exp(alpha_per_mm * x * sine_[k]));
        ey_[k * n + i] = static_cast<float>(std::exp(-alpha_per_mm * x * cosine_[k]));
      }
    }
  }

  SquareRow row_of(int k, int y, const TomoGrid::Range& in) const {
    const auto at = static_cast<std::size_t>(k);
    const double c = cosine_[at], s = sine_[at];
    const double x_mm = grid_.voxel_at_mm(in.first), y_mm = grid_.voxel_at_mm(y);
    const double side = grid_.voxel_mm() / grid_.pixel_mm;
    const double turn = directions_.width_rad() / grid_.pixel_mm;
    SquareRow row;
    row.count = in.end - in.first;
    row.place = (x_mm * c + y_mm * s - first_mm_) / grid_.pixel_mm;
    row.step = static_cast<float>(side * c);
    row.one = static_cast<float>(side * std::abs(c));
    row.other = static_cast<float>(side * std::abs(s));
    row.u = static_cast<float>((y_mm * c - x_mm * s) * turn);
    row.u_step = static_cast<float>(-grid_.voxel_mm() * s * turn);
    row.taps = taps_;
    row.lit = lit_;
    if (!ex_.empty()) {
      const std::size_t first = at * static_cast<std::size_t>(grid_.voxels);
      row.dim = ex_.data() + first + in.first;
      row.dim_row = ey_[first + static_cast<std::size_t>(y)];
    }
    return row;
  }

  /// Weights of a row; those of voxels whose light lies beside the image meet its dark margin.
  void weigh(const SquareRow& row, Scratch& scratch) const {
    const auto n = static_cast<std::size_t>(row.count);
    scratch.first.resize(n);
    scratch.weights.resize(n * static_cast<std::size_t>(taps_));
    weigh_row(row, scratch.first.data(), scratch.weights.data());
    for (int& i : scratch.first) i = std::clamp(i, -taps_, grid_.pixels);
  }

  void shade(std::size_t row, int x, std::uint32_t slices) {
    std::vector<Shaded>& all = shade_[row];
    const auto at =
        std::lower_bound(all.begin(), all.end(), x, [](const Shaded& s, int v) { return s.x < v; });
    if (at != all.end() && at->x == x) {
      at->slices |= slices;
    } else {
      all.insert(at, {x, slices});
    }
  }

  void cast(const Volume& insert) {
    if (!(insert.grid == grid_)) throw InputError("insert", "", "must have the grid of the part");
    const LevelShade opaque(box_of(insert), grid_.slices);
    shade_.assign(grid_.blocks() * rows_of_block(), {});
    const std::size_t L = lanes();
    parallel_for({}, "", static_cast<std::size_t>(directions_.count()), [&](std::size_t k) {
      std::vector<std::uint64_t> hidden(opaque.words());
      for (int y = 0; y < grid_.voxels; ++y) {
        const TomoGrid::Range in = grid_.inside(y);
        for (int x = in.first; x < in.end; ++x) {
          if (!opaque.hides(x, y, sine_[k], -cosine_[k], hidden)) continue;
          for (int z = 0; z < grid_.slices; ++z) {
            const auto slice = static_cast<std::size_t>(z);
            if ((hidden[slice / 64] >> (slice % 64) & 1) == 0) continue;
            shade(slice / L * rows_of_block() + k * static_cast<std::size_t>(grid_.voxels) +
                      static_cast<std::size_t>(y),
                  x, 1U << (slice % L));
          }
        }
      }
    });
  }

  Masks masks(std::size_t block, int k, int y, const TomoGrid::Range& in, Scratch& scratch) const {
    if (shade_.empty()) return nullptr;
    const std::vector<Shaded>& dark =
        shade_[block * rows_of_block() +
               static_cast<std::size_t>(k) * static_cast<std::size_t>(grid_.voxels) +
               static_cast<std::size_t>(y)];
    if (dark.empty()) return nullptr;
    scratch.masks.assign(static_cast<std::size_t>(in.end - in.first), ~0U);
    for (const Shaded& s : dark) {
      scratch.masks[static_cast<std::size_t>(s.x - in.first)] = ~s.slices;
    }
    return scratch.masks.data();
  }

  TomoGrid grid_;
  float lit_;
  double first_mm_;
  Directions directions_;
  int taps_ = 0;
  std::optional<CellLines> lines_;
  std::vector<double> cosine_, sine_;       ///< of the directions
  Array<float> ex_, ey_;                    ///< [direction][voxel]
  std::vector<std::vector<Shaded>> shade_;  ///< [block][direction][y]; empty: no insert
};

}  // namespace

std::unique_ptr<Projector> make_square_projector(const TomoGrid& grid, const RayTables& optics,
                                                 const Volume* insert) {
  return std::make_unique<SquareProjector>(grid, optics, insert);
}

}  // namespace slicecorr::tomo::detail
