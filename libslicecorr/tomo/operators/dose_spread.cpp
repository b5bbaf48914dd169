// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/dose_spread.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/kernels.hpp"
#include "parallel/silent.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Dose farther away than this many standard deviations is not followed: 6e-5 of all.
constexpr double kDeviations = 4;
/// Terms of a series that are smaller in all than this are left out.
constexpr double kNegligible = 1e-8;
constexpr std::size_t kColumnsAChunk = 64;
constexpr std::size_t kNumbersAThread = 200000;

/// out = add u + factor (share (L b - b / share)) - out for one column; `beside` are its neighbours'
/// numbers. All arrays have `count` numbers.
SLICECORR_CLONES
void whole_column(std::size_t count, int neighbours, const float* const* beside, float along_z,
                  float share, float add, float factor, const float* u, const float* b,
                  float* out) {
  const float own = static_cast<float>(neighbours);
  const auto put = [&](std::size_t z, float flow) {
    for (int k = 0; k < neighbours; ++k) flow -= beside[k][z];
    out[z] = add * u[z] + factor * (share * flow - b[z]) - out[z];
  };
  if (count == 1) {
    put(0, own * b[0]);
    return;
  }
  put(0, own * b[0] + along_z * (b[0] - b[1]));
  if (neighbours == 4) {
    const float *b0 = beside[0], *b1 = beside[1], *b2 = beside[2], *b3 = beside[3];
    for (std::size_t z = 1; z + 1 < count; ++z) {
      const float flow =
          4 * b[z] - (b0[z] + b1[z]) - (b2[z] + b3[z]) + along_z * (2 * b[z] - b[z - 1] - b[z + 1]);
      out[z] = add * u[z] + factor * (share * flow - b[z]) - out[z];
    }
  } else {
    for (std::size_t z = 1; z + 1 < count; ++z) {
      put(z, own * b[z] + along_z * (2 * b[z] - b[z - 1] - b[z + 1]));
    }
  }
  put(count - 1, own * b[count - 1] + along_z * (b[count - 1] - b[count - 2]));
}

/// The same with what is open (1) and what is not (0).
SLICECORR_CLONES
void open_column(std::size_t count, int neighbours, const float* const* beside,
                 const float* const* beside_open, const float* open, float along_z, float share,
                 float add, float factor, const float* u, const float* b, float* out) {
  for (std::size_t z = 0; z < count; ++z) {
    float flow = 0;
    for (int k = 0; k < neighbours; ++k) flow += beside_open[k][z] * (b[z] - beside[k][z]);
    if (z > 0) flow += along_z * open[z - 1] * (b[z] - b[z - 1]);
    if (z + 1 < count) flow += along_z * open[z + 1] * (b[z] - b[z + 1]);
    out[z] = open[z] * (add * u[z] + factor * (share * flow - b[z]) - out[z]);
  }
}

}  // namespace

DoseSpread::DoseSpread(const TomoGrid& grid, const Box<std::uint8_t>& insert, double farthest_mm)
    : grid_(grid) {
  const double side = grid.voxel_mm(), height = grid.slice_height_mm();
  pad_ = static_cast<int>(std::ceil(kDeviations * farthest_mm / height)) + 1;
  count_ = static_cast<std::size_t>(grid.slices + 2 * pad_);
  stride_ = (count_ + 15) / 16 * 16;
  along_z_ = static_cast<float>(side * side / (height * height));
  // Four neighbours of weight 1 and two along z: Gershgorin's circles.
  most_ = 2 * (4 + 2.0 * along_z_);
  const auto n = static_cast<std::size_t>(grid.voxels);
  column_of_.assign(n * n, -1);
  for (int y = 0; y < grid.voxels; ++y) {
    const TomoGrid::Range row = grid.inside(y);
    for (int x = row.first; x < row.end; ++x) {
      column_of_[static_cast<std::size_t>(y) * n + static_cast<std::size_t>(x)] =
          static_cast<int>(columns_.size());
      columns_.push_back({x, y, {}, 0});
    }
  }
  for (Column& c : columns_) {
    constexpr int kSides[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    for (const auto& side_of : kSides) {
      const int x = c.x + side_of[0], y = c.y + side_of[1];
      if (x < 0 || y < 0 || x >= grid.voxels || y >= grid.voxels) continue;
      const int there = column_of_[static_cast<std::size_t>(y) * n + static_cast<std::size_t>(x)];
      if (there >= 0) c.beside[static_cast<std::size_t>(c.neighbours++)] = there;
    }
  }
  if (insert.values.empty()) return;
  open_.assign(size(), 0.0F);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    for (std::size_t k = 0; k < count_; ++k) {
      const int z = std::clamp(static_cast<int>(k) - pad_, 0, grid.slices - 1);
      open_[i * stride_ + k] =
          insert.values[insert.at(z, columns_[i].y, columns_[i].x)] == 0 ? 1.0F : 0.0F;
    }
  }
}

std::size_t DoseSpread::at(int x, int y) const {
  const int column =
      column_of_[static_cast<std::size_t>(y) * static_cast<std::size_t>(grid_.voxels) +
                 static_cast<std::size_t>(x)];
  if (column < 0) return kNone;
  return static_cast<std::size_t>(column) * stride_ + static_cast<std::size_t>(pad_);
}

SpreadSeries DoseSpread::series(const std::function<double(double)>& f) const {
  // The least number of nodes that tells all terms that count, by doubling.
  for (std::size_t nodes = 16;; nodes *= 2) {
    std::vector<double> at(nodes);
    double largest = 0;
    for (std::size_t j = 0; j < nodes; ++j) {
      const double angle =
          std::numbers::pi * (static_cast<double>(j) + 0.5) / static_cast<double>(nodes);
      at[j] = f(0.5 * most_ * (1 + std::cos(angle)));
      largest = std::max(largest, std::abs(at[j]));
    }
    SpreadSeries terms(nodes);
    for (std::size_t k = 0; k < nodes; ++k) {
      double sum = 0;
      for (std::size_t j = 0; j < nodes; ++j) {
        sum += at[j] * std::cos(std::numbers::pi * static_cast<double>(k) *
                                (static_cast<double>(j) + 0.5) / static_cast<double>(nodes));
      }
      terms[k] = sum * (k == 0 ? 1.0 : 2.0) / static_cast<double>(nodes);
    }
    double rest = 0;
    std::size_t kept = nodes;
    while (kept > 1 && rest + std::abs(terms[kept - 1]) <= kNegligible * largest) {
      rest += std::abs(terms[--kept]);
    }
    if (kept > nodes / 2 && nodes < 8192) continue;
    terms.resize(kept);
    return terms;
  }
}

void DoseSpread::step(std::size_t column, float add, float factor, const float* first,
                      const float* last, float* out) const {
  const Column& c = columns_[column];
  const std::size_t from = column * stride_;
  const float share = static_cast<float>(2 / most_);
  const float* beside[4] = {};
  const float* open[4] = {};
  for (int k = 0; k < c.neighbours; ++k) {
    const std::size_t there =
        static_cast<std::size_t>(c.beside[static_cast<std::size_t>(k)]) * stride_;
    beside[k] = last + there;
    if (!open_.empty()) open[k] = open_.data() + there;
  }
  if (open_.empty()) {
    whole_column(count_, c.neighbours, beside, along_z_, share, add, factor, first + from,
                 last + from, out + from);
  } else {
    open_column(count_, c.neighbours, beside, open, open_.data() + from, along_z_, share, add,
                factor, first + from, last + from, out + from);
  }
}

void DoseSpread::apply(const SpreadSeries& f, Array<float>& numbers,
                       const ExecutionContext& context) const {
  // Clenshaw: b_k = f_k u + 2 X b_(k+1) - b_(k+2), f(L) u = f_0 u + X b_1 - b_2, with
  // X = 2 L / most - 1.
  Array<float> later(size(), 0.0F), latest(size(), 0.0F);
  const std::size_t chunks = (columns_.size() + kColumnsAChunk - 1) / kColumnsAChunk;
  const ExecutionContext worth = slicecorr::detail::silent(context, size(), kNumbersAThread);
  for (std::size_t k = f.size(); k-- > 0;) {
    context.check_cancelled();
    parallel_for(worth, "", chunks, [&](std::size_t chunk) {
      const std::size_t end = std::min(columns_.size(), (chunk + 1) * kColumnsAChunk);
      for (std::size_t c = chunk * kColumnsAChunk; c < end; ++c) {
        step(c, static_cast<float>(f[k]), k == 0 ? 1.0F : 2.0F, numbers.data(), later.data(),
             latest.data());
      }
    });
    later.swap(latest);
  }
  numbers.swap(later);
}

double spread_for(double kappa, double lambda) { return std::exp(-kappa * lambda); }

double spread_of_turns(int turns, double kappa, double lambda) {
  const double one = kappa * lambda;
  if (one <= 0) return 1;
  return std::exp(-0.5 * one) * std::expm1(-turns * one) / (turns * std::expm1(-one));
}

}  // namespace slicecorr::tomo::detail
