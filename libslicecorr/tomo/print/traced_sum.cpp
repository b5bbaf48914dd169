// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The direct sum of level light that is traced through a vial that is not round, or has rods. Each pixel is
// many rays, whose ways through voxels count by their exact lengths; with the operators of the solver it
// shares how a ray goes (vial_trace.hpp) and no more.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "tomo/print/direct_sum.hpp"
#include "tomo/print/rows_of_slices.hpp"
#include "tomo/print/traced_walk.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Places along a side of a voxel that lies on a wall.
constexpr int kPlaces = 8;
/// Runs of the schedule whose light is followed together.
constexpr std::size_t kAtOnce = 16;

/// What a column of voxels gets of a pixel's light, times the seconds of a cell of the schedule.
struct Deposit {
  std::uint32_t voxel = 0;
  std::uint32_t pixel = 0;
  double share = 0;
};

class TracedSum final : public DirectSum {
 public:
  TracedSum(const Judged& judged, const ExecutionContext& context)
      : judged_(judged),
        grid_(judged.bench.grid),
        light_(*judged.bench.traced),
        walk_(grid_, light_, *judged.job.printer.vial, context),
        n_(static_cast<std::size_t>(judged.bench.grid.voxels)),
        slices_(static_cast<std::size_t>(judged.bench.grid.slices)) {
    const auto quiet = slicecorr::detail::silent(context);
    const LitRuns runs(judged.schedule, grid_.angles);
    const std::vector<double> shown = light_of_slices(judged, true);
    sum_.assign(n_ * n_ * slices_, 0);
    std::vector<std::vector<Deposit>> found(kAtOnce);
    for (std::size_t first = 0; first < runs.all().size(); first += kAtOnce) {
      const std::size_t count = std::min(kAtOnce, runs.all().size() - first);
      parallel_for(quiet, "", count,
                   [&](std::size_t k) { found[k] = deposits_of(runs.all()[first + k], shown); });
      parallel_for(quiet, "", n_, [&](std::size_t y) {
        for (std::size_t k = 0; k < count; ++k) {
          add_row(y, found[k], runs.all()[first + k], shown);
        }
      });
    }
  }

  void add(int column, int row_of_voxels, std::vector<double>& sum) const override {
    const std::size_t at =
        static_cast<std::size_t>(row_of_voxels) * n_ + static_cast<std::size_t>(column);
    for (std::size_t z = 0; z < slices_; ++z) sum[z] += sum_[at * slices_ + z];
  }

 private:
  /// Sums by voxels, of which few are met.
  struct Met {
    std::vector<double> share;
    std::vector<std::uint32_t> voxels;
    void add(std::size_t voxel, double by) {
      if (share[voxel] == 0) voxels.push_back(static_cast<std::uint32_t>(voxel));
      share[voxel] += by;
    }
  };

  double lit_of(const LitRun& run, std::size_t pixel, std::size_t z,
                const std::vector<double>& shown) const {
    double lit = 0;
    for (const Schedule::Part& part : *run.parts) {
      lit += part.exposed_s * (part.angle == kBlackFrame
                                   ? judged_.bench.mw_cm2.front()
                                   : shown[(static_cast<std::size_t>(part.angle) *
                                                static_cast<std::size_t>(grid_.pixels) +
                                            pixel) *
                                               slices_ +
                                           z]);
    }
    return lit;
  }

  std::vector<Deposit> deposits_of(const LitRun& run, const std::vector<double>& shown) const {
    std::vector<Deposit> all;
    if (run.parts->empty()) return all;
    const double cell_rad = 2 * std::numbers::pi / judged_.schedule.cells();
    const auto cells = static_cast<double>(run.end - run.first);
    // Twice as many angles as the operators take.
    const int count = 2 * traced_angles(grid_, cells * cell_rad);
    const double wide = cells / count;
    const TracedStrips points(grid_, light_, 0, wide * cell_rad);
    Met met{std::vector<double>(n_ * n_), {}};
    for (int i = 0; i < grid_.pixels; ++i) {
      const auto pixel = static_cast<std::size_t>(i);
      bool lit = false;
      for (std::size_t z = 0; z < slices_; ++z) lit = lit || lit_of(run, pixel, z, shown) > 0;
      if (!lit) continue;
      met.voxels.clear();
      for (int k = 0; k < count; ++k) {
        const double th = cell_rad * (static_cast<double>(run.first) - 0.5 + (k + 0.5) * wide);
        if (judged_.at == JudgedAt::centres) {
          points.of_pixel(th, i, light_.bundles.front(), [&](const TracedShare& s) {
            met.add(static_cast<std::size_t>(s.y) * n_ + static_cast<std::size_t>(s.x),
                    s.share * wide);
          });
        } else {
          follow(th, i, wide, met);
        }
      }
      for (const std::uint32_t v : met.voxels) {
        all.push_back({v, static_cast<std::uint32_t>(i), met.share[v]});
        met.share[v] = 0;
      }
    }
    std::stable_sort(all.begin(), all.end(),
                     [](const Deposit& a, const Deposit& b) { return a.voxel < b.voxel; });
    return all;
  }

  void add_row(std::size_t y, const std::vector<Deposit>& deposits, const LitRun& run,
               const std::vector<double>& shown) {
    const auto below = [](const Deposit& d, std::size_t voxel) { return d.voxel < voxel; };
    auto at = std::lower_bound(deposits.begin(), deposits.end(), y * n_, below);
    for (; at != deposits.end() && at->voxel < (y + 1) * n_; ++at) {
      double* const to = sum_.data() + std::size_t{at->voxel} * slices_;
      for (std::size_t z = 0; z < slices_; ++z) {
        to[z] += at->share * lit_of(run, at->pixel, z, shown);
      }
    }
  }

  /// All rays of a pixel while the vial stands so.
  void follow(double th, int pixel, double cells, Met& met) const {
    const double lit_mm = light_.lit * light_.pitch_mm;
    const int rays = std::max(
        2, static_cast<int>(std::ceil(TracedWalk::kRaysOfVoxel * lit_mm / grid_.voxel_mm())));
    const double power =
        cells * light_.pitch_mm / rays * light_.transmitted / (grid_.voxel_mm() * grid_.voxel_mm());
    TracedRay ray;
    for (int r = 0; r < rays; ++r) {
      const double column = pixel + light_.lit * ((r + 0.5) / rays - 0.5);
      light_.vial.trace(th, light_.line(column, light_.bundles.front()), ray);
      for (const TracedPiece& piece : ray.pieces) {
        walk_.through(ray, piece, [&](std::size_t voxel, double left, double /*way*/) {
          met.add(voxel, power * piece.power * left);
        });
      }
    }
  }

  const Judged judged_;
  const TomoGrid& grid_;
  const TracedLight& light_;
  TracedWalk walk_;
  std::size_t n_, slices_;
  std::vector<double> sum_;  ///< [y][x][slice]
};

}  // namespace

double TracedWalk::resin_within(const ResinArea& area, int x, int y) const {
  const FlatPoint middle{grid_.voxel_at_mm(x), grid_.voxel_at_mm(y)};
  if (area.within_mm(middle) > grid_.voxel_mm()) return 1;
  int in = 0;
  for (int i = 0; i < kPlaces; ++i) {
    for (int j = 0; j < kPlaces; ++j) {
      const auto at = [&](int v, int k) {
        return grid_.voxel_at_mm(v) + grid_.voxel_mm() * ((k + 0.5) / kPlaces - 0.5);
      };
      in += area.has({at(x, i), at(y, j)});
    }
  }
  return std::max(in, 1) / double{kPlaces * kPlaces};
}

TracedWalk::TracedWalk(const TomoGrid& grid, const TracedLight& light, const Vial& vial,
                       const ExecutionContext& context)
    : grid_(grid), light_(light) {
  const ResinArea area(vial);
  const auto n = static_cast<std::size_t>(grid.voxels);
  filled_.assign(n * n, 0);
  parallel_for(slicecorr::detail::silent(context), "", n, [&](std::size_t y) {
    for (std::size_t x = 0; x < n; ++x) {
      if (!light_.resin[y * n + x]) continue;
      filled_[y * n + x] = resin_within(area, static_cast<int>(x), static_cast<int>(y));
    }
  });
}

std::unique_ptr<DirectSum> make_traced_sum(const Judged& judged, const ExecutionContext& context) {
  if (judged.bench.traced->rows) return make_rising_sum(judged, context);
  return std::make_unique<TracedSum>(judged, context);
}

}  // namespace slicecorr::tomo::detail
