// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/shade.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::tomo::detail {

namespace {

constexpr double kFar = 1e30;
/// Squares are taken smaller by this, so that lines along their edges and through their corners
/// pass.
constexpr double kHalf = 0.5 - 1e-6;

struct Way {
  double from = 0, to = kFar;
};
/// Keeps the part of the way on which |d s - offset| is below half a voxel; false: nothing is left.
bool narrow(int offset, double d, Way& way) {
  if (std::abs(d) < 1e-12) return std::abs(offset) < kHalf;
  const double a = (offset - kHalf) / d, b = (offset + kHalf) / d;
  way.from = std::max(way.from, std::min(a, b));
  way.to = std::min(way.to, std::max(a, b));
  return way.from < way.to;
}

}  // namespace

Box<std::uint8_t> box_of(const Volume& volume) {
  const TomoGrid& g = volume.grid;
  Box<std::uint8_t> box{g.slices, g.voxels, g.voxels, {}};
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) box.values.push_back(volume.coverage[g.voxel(x, y, z)]);
    }
  }
  return box;
}

LevelShade::LevelShade(const Box<std::uint8_t>& insert, int slices)
    : n_(insert.nx), words_((static_cast<std::size_t>(slices) + 63) / 64) {
  if (insert.values.empty()) return;
  opaque_.assign(static_cast<std::size_t>(n_) * static_cast<std::size_t>(n_) * words_, 0);
  for (int z = 0; z < slices; ++z) {
    for (int y = 0; y < n_; ++y) {
      for (int x = 0; x < n_; ++x) {
        if (insert.values[insert.at(z, y, x)] == 0) continue;
        opaque_[at(x, y) + static_cast<std::size_t>(z) / 64] |= std::uint64_t{1} << (z % 64);
        x0_ = std::min(x0_, x), x1_ = std::max(x1_, x);
        y0_ = std::min(y0_, y), y1_ = std::max(y1_, y);
      }
    }
  }
}

std::size_t LevelShade::at(int x, int y) const {
  return (static_cast<std::size_t>(y) * static_cast<std::size_t>(n_) +
          static_cast<std::size_t>(x)) *
         words_;
}

bool LevelShade::add(int x, int y, std::vector<std::uint64_t>& slices) const {
  std::uint64_t any = 0;
  for (std::size_t w = 0; w < words_; ++w) any |= slices[w] |= opaque_[at(x, y) + w];
  return any != 0;
}

bool LevelShade::hides(int x, int y, double dx, double dy,
                       std::vector<std::uint64_t>& slices) const {
  if (!any()) return false;
  std::fill(slices.begin(), slices.end(), 0);
  bool met = add(x, y, slices);
  for (int row = y0_; row <= y1_; ++row) {
    Way way;
    if (!narrow(row - y, dy, way)) continue;
    // Columns between both ends of the way through this row.
    double from = x0_, to = x1_;
    if (way.to < kFar) {
      from = std::max(from, std::floor(x + std::min(way.from * dx, way.to * dx)) - 1);
      to = std::min(to, std::ceil(x + std::max(way.from * dx, way.to * dx)) + 1);
    }
    for (int column = static_cast<int>(from); column <= static_cast<int>(to); ++column) {
      Way inside = way;
      if (narrow(column - x, dx, inside)) met |= add(column, row, slices);
    }
  }
  return met;
}

RisingShade::RisingShade(const Box<std::uint8_t>& insert) : insert_(insert) {
  for (int y = 0; y < insert.ny; ++y) {
    for (int x = 0; x < insert.nx; ++x) {
      for (int z = 0; z < insert.nz; ++z) {
        if (insert.values[insert.at(z, y, x)] == 0) continue;
        const double middle_x = 0.5 * (insert.nx - 1), middle_y = 0.5 * (insert.ny - 1);
        radius_ = std::max(radius_, std::hypot(x - middle_x, y - middle_y) + 1);
      }
    }
  }
}

bool RisingShade::hides(int x, int y, int z, double th, double slope) const {
  if (radius_ == 0) return false;
  const double dx = std::sin(th), dy = -std::cos(th);
  const double px = x - 0.5 * (insert_.nx - 1), py = y - 0.5 * (insert_.ny - 1);
  // From where the ray comes into the insert's circle to where it leaves it.
  const double nearest = -(px * dx + py * dy), beside = px * dy - py * dx;
  if (std::abs(beside) > radius_) return false;
  const double half = std::sqrt(radius_ * radius_ - beside * beside);
  for (double way = std::max(0.0, nearest - half); way <= nearest + half; way += 0.25) {
    const auto at_x = static_cast<int>(std::lround(x + way * dx)),
               at_y = static_cast<int>(std::lround(y + way * dy)),
               at_z = static_cast<int>(std::lround(z - way * slope));
    if (at_x < 0 || at_x >= insert_.nx || at_y < 0 || at_y >= insert_.ny || at_z < 0 ||
        at_z >= insert_.nz) {
      continue;
    }
    if (insert_.values[insert_.at(at_z, at_y, at_x)] != 0) return true;
  }
  return false;
}

}  // namespace slicecorr::tomo::detail
