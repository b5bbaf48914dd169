// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The direct sum of traced light that rises, falls or spreads on its way. Each pixel is many rays side by side and
// through its aperture, whose ways through voxels count by their exact lengths; how high each row's light is on such
// a way is worked out for its own edges. With the operators of the solver it shares how a ray goes and no more.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "tomo/print/direct_sum.hpp"
#include "tomo/print/traced_walk.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Runs of the schedule whose doses are worked out at the same time.
constexpr std::size_t kRunsAtOnce = 4;
/// How much narrower bundles are than those of the solver's operators.
constexpr double kNarrower = 0.25;

/// A row's edge where its light passes the plane of the axis, and by how much it rises there.
struct RowEdge {
  double z_mm = 0, by_mm = 0;
};

class RisingSum final : public DirectSum {
 public:
  RisingSum(const Judged& judged, const ExecutionContext& context)
      : judged_(judged),
        grid_(judged.bench.grid),
        light_(*judged.bench.traced),
        rows_(*light_.rows),
        walk_(grid_, light_, *judged.job.printer.vial, context),
        bundles_(bundles_of(grid_, rows_, kNarrower)),
        n_(static_cast<std::size_t>(grid_.voxels)),
        slices_(static_cast<std::size_t>(grid_.slices)) {
    const LitRuns runs(judged.schedule, grid_.angles);
    take_edges();
    sum_.assign(n_ * n_ * slices_, 0);
    std::vector<std::vector<double>> doses(kRunsAtOnce);
    for (std::size_t first = 0; first < runs.all().size(); first += kRunsAtOnce) {
      const std::size_t count = std::min(kRunsAtOnce, runs.all().size() - first);
      parallel_for(slicecorr::detail::silent(context), "", count, [&](std::size_t k) {
        doses[k].assign(sum_.size(), 0);
        add_run(runs.all()[first + k], doses[k]);
      });
      for (std::size_t k = 0; k < count; ++k) {
        for (std::size_t i = 0; i < sum_.size(); ++i) sum_[i] += doses[k][i];
      }
    }
  }

  void add(int column, int row_of_voxels, std::vector<double>& sum) const override {
    const std::size_t at =
        static_cast<std::size_t>(row_of_voxels) * n_ + static_cast<std::size_t>(column);
    for (std::size_t z = 0; z < slices_; ++z) sum[z] += sum_[at * slices_ + z];
  }

 private:
  /// Places of a pixel's rays beside each other: fewer where its aperture has many.
  void take_edges() {
    const auto rays = static_cast<double>(rows_.points.size());
    const double per_pixel = TracedWalk::kRaysOfVoxel * light_.lit * light_.pitch_mm /
                             grid_.voxel_mm() / std::sqrt(rays);
    beside_ =
        judged_.at == JudgedAt::centres ? 1 : std::max(2, static_cast<int>(std::ceil(per_pixel)));
    for (std::size_t ray = 0; ray < rows_.points.size(); ++ray) {
      for (int i = 0; i < grid_.pixels; ++i) {
        for (int b = 0; b < beside_; ++b) {
          for (int r = 0; r <= grid_.rows; ++r) {
            const TracedLine line = rows_.line(column_of(i, b), r - 0.5, static_cast<int>(ray));
            edges_.push_back({line.z_mm, light_.vial.n_outside() * line.kz});
          }
        }
      }
    }
  }
  double column_of(int pixel, int beside) const {
    return pixel + light_.lit * ((beside + 0.5) / beside_ - 0.5);
  }
  const RowEdge* edges_of(int ray, int pixel, int beside) const {
    const int place = (ray * grid_.pixels + pixel) * beside_ + beside;
    return edges_.data() +
           static_cast<std::size_t>(place) * (static_cast<std::size_t>(grid_.rows) + 1);
  }

  /// What a pixel shows in a run, mW/cm² times seconds of a cell.
  double lit_of(const LitRun& run, int pixel, int row) const {
    const FramePlaces& places = judged_.bench.places;
    double lit = 0;
    for (const Schedule::Part& part : *run.parts) {
      const bool black = part.angle == kBlackFrame;
      const int m = black ? run.stage : part.angle;
      const std::size_t level = black ? 0 : judged_.job.levels[grid_.pixel(m, pixel, row)];
      lit += part.exposed_s * judged_.bench.mw_cm2[level] * places.share(m, pixel, row);
    }
    return lit;
  }

  void add_run(const LitRun& run, std::vector<double>& dose) const {
    if (run.parts->empty()) return;
    std::vector<double> lit;
    for (int i = 0; i < grid_.pixels; ++i) {
      for (int r = 0; r < grid_.rows; ++r) lit.push_back(lit_of(run, i, r));
    }
    const double cell_rad = 2 * std::numbers::pi / judged_.schedule.cells();
    const auto cells = static_cast<double>(run.end - run.first);
    // Twice as many angles as the operators take.
    const int count = 2 * traced_angles(grid_, cells * cell_rad);
    const double wide = cells / count;
    const TracedStrips points(grid_, light_, 0, wide * cell_rad);
    // Of a row's light, as much goes through each ray.
    const double unit = wide * rows_.row_mm / static_cast<double>(rows_.points.size());
    for (int k = 0; k < count; ++k) {
      const double th = cell_rad * (static_cast<double>(run.first) - 0.5 + (k + 0.5) * wide);
      for (const TracedBundle& bundle : bundles_) {
        for (int i = 0; i < grid_.pixels; ++i) {
          const double* const of_rows = lit.data() + static_cast<std::size_t>(i * grid_.rows);
          if (judged_.at == JudgedAt::centres) {
            points.of_pixel(th, i, bundle, [&](const TracedShare& s) {
              const std::size_t v =
                  static_cast<std::size_t>(s.y) * n_ + static_cast<std::size_t>(s.x);
              at_points(bundle, edges_of(bundle.ray, i, 0), s.rise_mm,
                        [&](int row, int z, double per_mm) {
                          dose[v * slices_ + static_cast<std::size_t>(z)] +=
                              unit * s.share * per_mm * of_rows[row];
                        });
            });
          } else {
            follow({th, i, &bundle}, unit, of_rows, dose);
          }
        }
      }
    }
  }

  struct Followed {
    double th = 0;
    int pixel = 0;
    const TracedBundle* bundle = nullptr;
  };
  /// Rays beside each other of a pixel's bundle.
  void follow(const Followed& of, double unit, const double* lit, std::vector<double>& dose) const {
    const double power = unit * light_.pitch_mm / beside_ /
                         (grid_.voxel_mm() * grid_.voxel_mm() * grid_.slice_height_mm());
    TracedRay ray;
    for (int b = 0; b < beside_; ++b) {
      const TracedLine line = light_.line(column_of(of.pixel, b), *of.bundle);
      light_.vial.trace(of.th, line, ray);
      const RowEdge* const edges = edges_of(of.bundle->ray, of.pixel, b);
      for (const TracedPiece& piece : ray.pieces) {
        const double there = power * line.transmittance * piece.power;
        walk_.through(ray, piece, [&](std::size_t v, double left, double way) {
          const double rise = piece.rise_mm + way * ray.rise_per_mm;
          within(*of.bundle, edges, rise, [&](int row, int z, double share) {
            dose[v * slices_ + static_cast<std::size_t>(z)] += there * left * share * lit[row];
          });
        });
      }
    }
  }

  /// Calls use(row, slice, share) for the share of each row's light that is in a slice there.
  template <class Use>
  void within(const TracedBundle& bundle, const RowEdge* edges, double rise_mm,
              const Use& use) const {
    const double h = grid_.slice_height_mm(), foot = grid_.lowest_mm - h / 2;
    for (int r = bundle.first_row; r < bundle.end_row; ++r) {
      const double low = edges[r].z_mm + edges[r].by_mm * rise_mm,
                   high = edges[r + 1].z_mm + edges[r + 1].by_mm * rise_mm;
      const double middle = (low + high) / 2, half = rows_.lit * (high - low) / 2;
      const int first = std::max(0, static_cast<int>(std::floor((middle - half - foot) / h)));
      for (int z = first; z < grid_.slices && foot + h * z < middle + half; ++z) {
        const double in =
            std::min(middle + half, foot + h * (z + 1)) - std::max(middle - half, foot + h * z);
        if (in > 0) use(r, z, in / (2 * half));
      }
    }
  }
  /// Calls use(row, slice, per_mm) for slices whose middles a row lights: its share of a mm there.
  template <class Use>
  void at_points(const TracedBundle& bundle, const RowEdge* edges, double rise_mm,
                 const Use& use) const {
    const double h = grid_.slice_height_mm();
    for (int r = bundle.first_row; r < bundle.end_row; ++r) {
      const double low = edges[r].z_mm + edges[r].by_mm * rise_mm,
                   high = edges[r + 1].z_mm + edges[r + 1].by_mm * rise_mm;
      const double middle = (low + high) / 2, half = rows_.lit * (high - low) / 2;
      const int first =
          std::max(0, static_cast<int>(std::ceil((middle - half - grid_.lowest_mm) / h)));
      for (int z = first; z < grid_.slices && grid_.lowest_mm + h * z < middle + half; ++z) {
        use(r, z, 1 / (2 * half));
      }
    }
  }

  const Judged judged_;
  const TomoGrid& grid_;
  const TracedLight& light_;
  const TracedRows& rows_;
  TracedWalk walk_;
  std::vector<TracedBundle> bundles_;
  std::size_t n_, slices_;
  int beside_ = 1;              ///< rays of a pixel beside each other
  std::vector<RowEdge> edges_;  ///< [ray][pixel][beside][edge]
  std::vector<double> sum_;     ///< [y][x][slice]
};

}  // namespace

std::unique_ptr<DirectSum> make_rising_sum(const Judged& judged, const ExecutionContext& context) {
  return std::make_unique<RisingSum>(judged, context);
}

}  // namespace slicecorr::tomo::detail
