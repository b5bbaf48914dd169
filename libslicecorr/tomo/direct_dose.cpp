// Doses of a job by a direct sum, to judge what the solver's operators say.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

namespace {

/// The projector's pixel whose light comes to a line in the resin, and the turn of the vial at which
/// it does, in telecentric light: t = n_outside q / n and th' = th + delta(q).
struct Source {
  double column = 0;
  double turn_rad = 0;
  double mw_cm2_share = 0;  ///< of a pixel's irradiance that is left at u = 0 without absorption
};

class DirectSum {
 public:
  DirectSum(const TomoJob& job, const Bench& bench)
      : printer_(job.printer),
        bench_(bench),
        n_(index_of(job.resin)),
        alpha_(absorption_per_mm(job.resin)) {
    // z innermost, as light of one pixel goes to all slices alike.
    const TomoGrid& g = bench.grid;
    const auto slices = static_cast<std::size_t>(g.slices);
    light_.resize(static_cast<std::size_t>(g.angles) * static_cast<std::size_t>(g.pixels) * slices);
    for (int m = 0; m < g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int z = 0; z < g.slices; ++z) {
          light_[row(m, i) + static_cast<std::size_t>(z)] =
              bench.mw_cm2[job.levels[g.pixel(m, i, z)]];
        }
      }
    }
  }

  /// Adds the dose of one turn over alpha_a T_rot to every slice of a column of voxels.
  void add(double x, double y, std::vector<double>& sum) const {
    const TomoGrid& g = bench_.grid;
    for (int k = 0; k < g.angles; ++k) {
      const double th = 2 * std::numbers::pi * k / g.angles;
      const double t = x * std::cos(th) + y * std::sin(th),
                   u = -x * std::sin(th) + y * std::cos(th);
      const Source from = source_of(t);
      const double half = std::sqrt(std::max(0.0, bench_.radius_mm * bench_.radius_mm - t * t));
      const double share = from.mw_cm2_share * std::exp(-alpha_ * (half + u)) / g.angles;
      const double i = from.column - bench_.first_column;
      const double m = k - from.turn_rad / (2 * std::numbers::pi) * g.angles;
      const auto i0 = static_cast<int>(std::floor(i)), m0 = static_cast<int>(std::floor(m));
      const double wi = i - i0, wm = m - m0;
      for (const int a : {0, 1}) {
        for (const int b : {0, 1}) {
          const double weight = share * (a ? wi : 1 - wi) * (b ? wm : 1 - wm);
          if (weight == 0 || i0 + a < 0 || i0 + a >= g.pixels) continue;
          const double* const lit =
              &light_[row(((m0 + b) % g.angles + g.angles) % g.angles, i0 + a)];
          for (std::size_t z = 0; z < sum.size(); ++z) sum[z] += weight * lit[z];
        }
      }
    }
  }

 private:
  std::size_t row(int m, int i) const {
    const TomoGrid& g = bench_.grid;
    return (static_cast<std::size_t>(m) * static_cast<std::size_t>(g.pixels) +
            static_cast<std::size_t>(i)) *
           static_cast<std::size_t>(g.slices);
  }
  Source source_of(double t) const {
    const Vial& vial = *printer_.vial;
    const double q = t * n_ / vial.n_outside;
    if (misses(vial, n_, q, 0)) return {};
    // X grows by a pixel's pitch from column to column.
    const double column = (q - pixel_x_mm(printer_, 0)) / (printer_.pixel_x_um * 1e-3);
    return {column, turned_rad(vial, n_, q, 0),
            transmittance(vial, n_, q, 0) * n_ / vial.n_outside};
  }

  const Printer& printer_;
  const Bench& bench_;
  double n_, alpha_;
  std::vector<double> light_;  ///< [angle][pixel][slice]
};

}  // namespace

Box<float> dose_of(const TomoJob& job, const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& grid = bench.grid;
  const DirectSum direct(job, bench);
  const double per_unit = bench.exposure.alpha_a_per_cm * bench.exposure.turn_s * job.turns;
  Box<float> dose{grid.slices, grid.voxels, grid.voxels, {}};
  dose.values.assign(static_cast<std::size_t>(grid.slices) * static_cast<std::size_t>(grid.voxels) *
                         static_cast<std::size_t>(grid.voxels),
                     0.0F);
  parallel_for(context, "judge", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    std::vector<double> sum(static_cast<std::size_t>(grid.slices));
    const TomoGrid::Range range = grid.inside(y);
    for (int x = range.first; x < range.end; ++x) {
      std::fill(sum.begin(), sum.end(), 0.0);
      direct.add(grid.voxel_at_mm(x), grid.voxel_at_mm(y), sum);
      for (int z = 0; z < grid.slices; ++z) {
        dose.values[dose.at(z, y, x)] =
            static_cast<float>(per_unit * sum[static_cast<std::size_t>(z)]);
      }
    }
  });
  return dose;
}

}  // namespace slicecorr::tomo
