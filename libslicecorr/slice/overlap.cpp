// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <mutex>
#include <tuple>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "parallel/silent.hpp"
#include "slice/placing.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/plate.hpp"

namespace slicecorr {

namespace {

using detail::PartBox;

constexpr int kRows = 16;
/// Parts of a voxel by which all is moved: faces of parts that touch do not lie on middles of voxels then.
constexpr double kAsideX = 1.7e-5, kAsideY = 2.3e-5, kAsideZ = 1.3e-5;

bool meet(const PartBox& a, const PartBox& b) {
  for (std::size_t k = 0; k < 3; ++k) {
    if (a.low[k] >= b.high[k] || b.low[k] >= a.high[k]) return false;
  }
  return true;
}

PixelBox common(const PixelBox& a, const PixelBox& b) {
  return {std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
}

/// What two parts have in common: voxels, and the lowest of them.
struct Common {
  std::uint64_t voxels = 0;
  int slice = std::numeric_limits<int>::max(), x = 0, y = 0;
};

Common common_of(const MeshSlices& a, const MeshSlices& b, const ExecutionContext& context) {
  const PixelBox box = common(a.bounds(), b.bounds());
  Common all;
  if (box.empty()) return all;
  const auto bands = static_cast<std::size_t>((box.height() + kRows - 1) / kRows);
  std::mutex merging;
  parallel_for(detail::silent(context), "", bands, [&](std::size_t k) {
    const int y0 = box.y0 + static_cast<int>(k) * kRows;
    const PixelBox band{box.x0, y0, box.x1, std::min(box.y1, y0 + kRows)};
    const auto columns =
        static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
    detail::CodedBand coded(columns);
    a.read_band(band, [&](int, const std::uint8_t* rows) { coded.append(rows); });
    std::vector<std::uint8_t> other(columns);
    Common own;
    b.read_band(band, [&](int n, const std::uint8_t* rows) {
      if (!rows || n >= coded.slices() || coded.black(n)) return;
      coded.read(n, other.data());
      for (std::size_t i = 0; i < columns; ++i) {
        if (rows[i] == 0 || other[i] == 0) continue;
        ++own.voxels;
        if (n < own.slice) {
          own.slice = n;
          own.x = band.x0 + static_cast<int>(i % static_cast<std::size_t>(band.width()));
          own.y = band.y0 + static_cast<int>(i / static_cast<std::size_t>(band.width()));
        }
      }
    });
    const std::lock_guard lock(merging);
    all.voxels += own.voxels;
    const auto key = [](const Common& c) { return std::array{c.slice, c.y, c.x}; };
    if (key(own) < key(all)) std::tie(all.slice, all.x, all.y) = std::tie(own.slice, own.x, own.y);
  });
  return all;
}

}  // namespace

std::optional<PartOverlap> find_overlap(const std::vector<TriangleMesh>& parts,
                                        const Printer& printer, const SliceOptions& options,
                                        const ExecutionContext& context) {
  std::vector<PartBox> boxes;
  PartBox all;
  all.low.fill(std::numeric_limits<double>::infinity());
  all.high.fill(-std::numeric_limits<double>::infinity());
  for (const TriangleMesh& part : parts) {
    boxes.push_back(detail::box_of(part, context));
    for (std::size_t k = 0; k < 3; ++k) {
      all.low[k] = std::min(all.low[k], boxes.back().low[k]);
      all.high[k] = std::max(all.high[k], boxes.back().high[k]);
    }
  }
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t k = i + 1; k < parts.size(); ++k) {
      if (meet(boxes[i], boxes[k])) pairs.emplace_back(i, k);
    }
  }
  if (pairs.empty()) return std::nullopt;
  const Grid plate = plate_grid(printer);
  const detail::Placing at = detail::placing_of(plate, options);
  const double platform_mm = detail::platform_z_mm(all, options);
  const auto sliced = [&](std::size_t i) {
    SliceOptions own;
    own.layer_um = options.layer_um;
    own.raised_um = 0;
    own.antialias = false;
    own.center_mm = {
        at.cx + boxes[i].middle(0) - all.middle(0) + kAsideX * plate.pixel_x_um * 1e-3,
        at.cy + boxes[i].middle(1) - all.middle(1) + kAsideY * plate.pixel_y_um * 1e-3};
    own.platform_z_mm = platform_mm - kAsideZ * options.layer_um * 1e-3;
    // A part by itself that prints nothing, or does not fit, is the business of who slices them all.
    try {
      return std::make_unique<MeshSlices>(parts[i], printer, own, detail::silent(context));
    } catch (const InputError&) {
      return std::unique_ptr<MeshSlices>{};
    }
  };
  std::optional<PartOverlap> worst;
  std::size_t before = parts.size();
  std::unique_ptr<MeshSlices> first;
  for (const auto& [i, k] : pairs) {
    context.check_cancelled();
    if (i != before) first = sliced(i);
    before = i;
    const std::unique_ptr<MeshSlices> second = sliced(k);
    if (!first || !second) continue;
    const Common both = common_of(*first, *second, context);
    const double voxel_mm3 = plate.pixel_x_um * plate.pixel_y_um * options.layer_um * 1e-9;
    const double volume = static_cast<double>(both.voxels) * voxel_mm3;
    if (both.voxels == 0 || (worst && worst->volume_mm3 >= volume)) continue;
    worst = PartOverlap{i,
                        k,
                        volume,
                        (both.x + 0.5) * plate.pixel_x_um * 1e-3,
                        (plate.height_px - both.y - 0.5) * plate.pixel_y_um * 1e-3,
                        both.slice * options.layer_um * 1e-3};
  }
  return worst;
}

}  // namespace slicecorr
