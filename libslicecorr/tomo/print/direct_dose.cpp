// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses of a job by a direct sum, to judge what the solver's operators say.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/ray_sources.hpp"
#include "tomo/print/changing_resin.hpp"

namespace slicecorr::tomo {

namespace {

using detail::RaySource;

/// The projector's pixel whose light comes to a line in the resin, and the turn of the vial at which
/// it does, in telecentric light: t = n_outside q / n and th' = th + delta(q).
struct Source {
  double column = 0;
  double turn_rad = 0;
  double mw_cm2_share = 0;  ///< of a pixel's irradiance that is left at u = 0 without absorption
};

/// What an insert hides, found by following each line from the voxel against the light, one row of
/// voxels after another. Lengths are in voxels; x and y count them.
class Insert {
 public:
  Insert(const Box<std::uint8_t>& insert, int slices)
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

  std::size_t words() const { return words_; }
  /// Sets the bits of the slices in which something opaque lies at (x, y) or from there on along
  /// (dx, dy), a unit vector. Whether there are any.
  bool hides(int x, int y, double dx, double dy, std::vector<std::uint64_t>& slices) const {
    if (opaque_.empty() || x0_ > x1_) return false;
    std::fill(slices.begin(), slices.end(), 0);
    bool any = add(x, y, slices);
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
        if (narrow(column - x, dx, inside)) any |= add(column, row, slices);
      }
    }
    return any;
  }

 private:
  static constexpr double kFar = 1e30;
  /// Squares are taken smaller by this, so that lines along their edges and through their corners
  /// pass.
  static constexpr double kHalf = 0.5 - 1e-6;
  struct Way {
    double from = 0, to = kFar;
  };
  /// Keeps the part of the way on which |d s - offset| is below half a voxel; false: nothing is left.
  static bool narrow(int offset, double d, Way& way) {
    if (std::abs(d) < 1e-12) return std::abs(offset) < kHalf;
    const double a = (offset - kHalf) / d, b = (offset + kHalf) / d;
    way.from = std::max(way.from, std::min(a, b));
    way.to = std::min(way.to, std::max(a, b));
    return way.from < way.to;
  }
  std::size_t at(int x, int y) const {
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(n_) +
            static_cast<std::size_t>(x)) *
           words_;
  }
  bool add(int x, int y, std::vector<std::uint64_t>& slices) const {
    std::uint64_t any = 0;
    for (std::size_t w = 0; w < words_; ++w) any |= slices[w] |= opaque_[at(x, y) + w];
    return any != 0;
  }

  int n_;
  std::size_t words_;
  std::vector<std::uint64_t> opaque_;  ///< [y][x], bits of slices
  int x0_ = std::numeric_limits<int>::max(), x1_ = -1, y0_ = x0_, y1_ = -1;
};

/// What an insert hides from rays that rise: followed from the voxel against the light, by quarters
/// of a voxel.
class RisingShade {
 public:
  explicit RisingShade(const Box<std::uint8_t>& insert) : insert_(insert) {
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

  bool hides(int x, int y, int z, double th, double slope) const {
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

 private:
  const Box<std::uint8_t>& insert_;
  double radius_ = 0;  ///< voxels; 0: no insert
};

/// When which frame is lit: for each of a turn's cells of angle the frames, by their angle (or
/// `kBlackFrame`), and for how long, s.
class Schedule {
 public:
  struct Part {
    int angle = 0;
    double exposed_s = 0;
  };
  explicit Schedule(int cells) : cells_(static_cast<std::size_t>(cells)) {}
  int cells() const { return static_cast<int>(cells_.size()); }
  /// Any whole number stands for the cell of that angle.
  const std::vector<Part>& at(long cell) const { return cells_[place(cell)]; }
  void add(long cell, int angle, double exposed_s) {
    std::vector<Part>& parts = cells_[place(cell)];
    for (Part& part : parts) {
      if (part.angle != angle) continue;
      part.exposed_s += exposed_s;
      return;
    }
    parts.push_back({angle, exposed_s});
  }

 private:
  std::size_t place(long cell) const {
    const long n = static_cast<long>(cells_.size());
    return static_cast<std::size_t>((cell % n + n) % n);
  }
  std::vector<std::vector<Part>> cells_;
};

/// Each frame at its own angle, for its share of all turns.
Schedule planned(const TomoJob& job, const Bench& bench) {
  Schedule schedule(bench.grid.angles);
  const double each_s = bench.exposure.turn_s * job.turns / bench.grid.angles;
  for (int m = 0; m < bench.grid.angles; ++m) schedule.add(m, m, each_s);
  return schedule;
}

/// Cells of angle in a frame's step: an odd number, so that its own angle is the middle of one.
constexpr int kCellsPerStep = 5;

Schedule scheduled(std::span<const Showing> shown, const Bench& bench) {
  Schedule schedule(kCellsPerStep * bench.grid.angles);
  const double cells_per_deg = schedule.cells() / 360.0;
  for (const Showing& s : shown) {
    const int angle = s.frame == kBlackFrame ? kBlackFrame : bench.frame_of_angle(s.frame);
    const double light_s = s.exposed_s * s.share;
    // th falls where the vial turns counterclockwise.
    const double side = (bench.clockwise ? 1 : -1) * cells_per_deg;
    const double a = side * s.from_deg + 0.5, b = side * s.to_deg + 0.5;
    const double low = std::min(a, b), high = std::max(a, b), width = high - low;
    const auto first = static_cast<long>(std::floor(low));
    if (!(width > 1e-9)) {
      schedule.add(first, angle, light_s);
      continue;
    }
    // Whole turns leave the same in each cell.
    const int cells = schedule.cells();
    const double whole = std::floor(width / cells), end = high - whole * cells;
    for (int cell = 0; whole > 0 && cell < cells; ++cell) {
      schedule.add(cell, angle, light_s * whole / width);
    }
    for (long cell = first; static_cast<double>(cell) < end; ++cell) {
      const double from = std::max(low, static_cast<double>(cell)),
                   to = std::min(end, static_cast<double>(cell) + 1);
      if (to > from) schedule.add(cell, angle, light_s * (to - from) / width);
    }
  }
  return schedule;
}

class DirectSum {
 public:
  DirectSum(const TomoJob& job, const Bench& bench, Schedule schedule,
            const ExecutionContext& context)
      : job_(job),
        printer_(job.printer),
        bench_(bench),
        schedule_(std::move(schedule)),
        n_(index_of(job.resin)),
        alpha_(absorption_per_mm(job.resin)),
        insert_(job.insert, bench.grid.slices),
        opaque_(job.insert) {
    // z innermost, as light of one pixel goes to all slices alike.
    const TomoGrid& g = bench.grid;
    if (g.coupled()) {
      sources_.emplace(printer_, n_, alpha_, g.lowest_mm,
                       g.lowest_mm + g.slice_height_mm() * (g.slices - 1), context);
      return;
    }
    const auto slices = static_cast<std::size_t>(g.slices);
    black_.assign(slices, bench.mw_cm2.front());
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

  /// Adds the dose of the print over alpha_a to every slice of a column of voxels: all of it, or with
  /// `sum` of as many as frames and slices what comes while each frame of a turn is shown.
  void add(int column, int row_of_voxels, std::vector<double>& sum) const {
    if (sources_) {
      add_rays(column, row_of_voxels, sum);
      return;
    }
    const bool by_frame = sum.size() > static_cast<std::size_t>(bench_.grid.slices);
    const TomoGrid& g = bench_.grid;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    std::vector<std::uint64_t> hidden(insert_.words());
    const int cells = schedule_.cells();
    for (int k = 0; k < cells; ++k) {
      const double th = 2 * std::numbers::pi * k / cells;
      const double t = x * std::cos(th) + y * std::sin(th),
                   u = -x * std::sin(th) + y * std::cos(th);
      const Source from = source_of(t);
      const double half = std::sqrt(std::max(0.0, bench_.radius_mm * bench_.radius_mm - t * t));
      const double share = from.mw_cm2_share * std::exp(-alpha_ * (half + u));
      const double m = k - from.turn_rad / (2 * std::numbers::pi) * cells;
      const auto m0 = static_cast<long>(std::floor(m));
      if (schedule_.at(m0).empty() && schedule_.at(m0 + 1).empty()) continue;
      const bool shaded = insert_.hides(column, row_of_voxels, std::sin(th), -std::cos(th), hidden);
      const double i = from.column - bench_.window.first_column;
      const double wm = m - static_cast<double>(m0);
      for (const int b : {0, 1}) {
        const double of_angle = share * (b ? wm : 1 - wm);
        if (of_angle == 0) continue;
        for (const Schedule::Part& part : schedule_.at(m0 + b)) {
          const int stage = angle_near(m0 + b);
          add(part.angle, stage, i, of_angle * part.exposed_s, shaded ? &hidden : nullptr,
              sum.data() + (by_frame ? frame_at(stage) * static_cast<std::size_t>(g.slices) : 0));
        }
      }
    }
  }

 private:
  /// Of the job's angles, the one nearest to a cell of the schedule.
  int angle_near(long cell) const {
    const long angles = bench_.grid.angles, cells = schedule_.cells();
    const auto m = std::lround(static_cast<double>(cell) * static_cast<double>(angles) /
                               static_cast<double>(cells));
    return static_cast<int>((m % angles + angles) % angles);
  }

  /// Light of a column of the frame of one angle, or of black, on a slice while the stage stands at
  /// `stage`: where the projector shines unevenly the pixel's own, and of an axis that has moved up
  /// or down since the frame's angle, of another slice of the frame.
  double light(int frame, int stage, int column, int z) const {
    double mw_cm2 = bench_.mw_cm2.front();
    if (frame != kBlackFrame) {
      const int own = bench_.places.slice_shown(frame, stage, z);
      if (own >= 0) mw_cm2 = light_[row(frame, column) + static_cast<std::size_t>(own)];
    }
    return mw_cm2 * bench_.places.share(stage, column, z);
  }

  /// Where in a turn the frame of that angle is shown.
  std::size_t frame_at(int stage) const {
    return static_cast<std::size_t>(bench_.frame_of_angle(stage));
  }

  /// Adds what the frame of one angle, or black, leaves while the stage stands at `stage`: light of
  /// a pixel that may lie between two columns, and in others from slice to slice.
  void add(int frame, int stage, double pixel, double weight,
           const std::vector<std::uint64_t>* hidden, double* sum) const {
    const TomoGrid& g = bench_.grid;
    const auto slices = static_cast<std::size_t>(g.slices);
    const FramePlaces& places = bench_.places;
    const auto in_resin = [&](std::size_t z) {
      return !hidden || !((*hidden)[z / 64] >> (z % 64) & 1);
    };
    if (places.moved() || places.uneven()) {
      for (std::size_t z = 0; z < slices; ++z) {
        if (!in_resin(z)) continue;
        const int slice = static_cast<int>(z);
        const double column = places.column_of(stage, pixel, slice);
        const auto first = static_cast<int>(std::floor(column));
        for (const int a : {0, 1}) {
          const double of_column = a ? column - first : 1 - (column - first);
          if (of_column == 0 || first + a < 0 || first + a >= g.pixels) continue;
          sum[z] += weight * of_column * light(frame, stage, first + a, slice);
        }
      }
      return;
    }
    const auto first = static_cast<int>(std::floor(pixel));
    for (const int a : {0, 1}) {
      const double of_column = weight * (a ? pixel - first : 1 - (pixel - first));
      if (of_column == 0 || first + a < 0 || first + a >= g.pixels) continue;
      const double* const lit =
          frame == kBlackFrame ? black_.data() : &light_[row(frame, first + a)];
      for (std::size_t z = 0; z < slices; ++z) {
        if (in_resin(z)) sum[z] += of_column * lit[z];
      }
    }
  }

  /// The same where slices share light.
  void add_rays(int column, int row_of_voxels, std::vector<double>& sum) const {
    const TomoGrid& g = bench_.grid;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    const auto slices = static_cast<std::size_t>(g.slices);
    const bool by_frame = sum.size() > slices;
    std::vector<RaySource> sources(slices);
    const int cells = schedule_.cells();
    for (int k = 0; k < cells; ++k) {
      const double th = 2 * std::numbers::pi * k / cells;
      const double t = x * std::cos(th) + y * std::sin(th),
                   u = -x * std::sin(th) + y * std::cos(th);
      for (int ray = 0; ray < sources_->rays(); ++ray) {
        sources_->along_z(ray, t, u, g.lowest_mm, g.slice_height_mm(), sources);
        for (std::size_t z = 0; z < slices; ++z) {
          const RaySource& from = sources[z];
          if (!(from.share > 0)) continue;
          const double m = k - from.turn_rad / (2 * std::numbers::pi) * cells;
          const auto m0 = static_cast<long>(std::floor(m));
          const double wm = m - static_cast<double>(m0);
          if (schedule_.at(m0).empty() && schedule_.at(m0 + 1).empty()) continue;
          if (opaque_.hides(column, row_of_voxels, static_cast<int>(z), th, from.slope)) continue;
          for (const int b : {0, 1}) {
            const double of_angle = from.share * (b ? wm : 1 - wm);
            const int stage = angle_near(m0 + b);
            double& to = sum[z + (by_frame ? frame_at(stage) * slices : 0)];
            for (const Schedule::Part& part : schedule_.at(m0 + b)) {
              to += of_angle * part.exposed_s * light_at(part.angle, stage, from);
            }
          }
        }
      }
    }
  }

  /// Light of a place in the image of a steady axis, mW/cm².
  double light_at(int frame, int stage, const RaySource& from) const {
    const TomoGrid& g = bench_.grid;
    const FramePlaces& places = bench_.places;
    const int m = frame == kBlackFrame ? stage : frame;
    const FramePlaces::Place at =
        places.place_of(m, from.column + places.right_px(stage), from.row - places.up_px(stage));
    const auto i0 = static_cast<int>(std::floor(at.pixel)),
               r0 = static_cast<int>(std::floor(at.row));
    const double wi = at.pixel - i0, wr = at.row - r0;
    double light = 0;
    for (const int a : {0, 1}) {
      for (const int b : {0, 1}) {
        const int i = i0 + a, r = r0 + b;
        if (i < 0 || i >= g.pixels || r < 0 || r >= g.rows) continue;
        const std::size_t level = frame == kBlackFrame ? 0 : job_.levels[g.pixel(m, i, r)];
        light +=
            (a ? wi : 1 - wi) * (b ? wr : 1 - wr) * bench_.mw_cm2[level] * places.share(m, i, r);
      }
    }
    return light;
  }

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

  const TomoJob& job_;
  const Printer& printer_;
  const Bench& bench_;
  const Schedule schedule_;
  double n_, alpha_;
  Insert insert_;
  RisingShade opaque_;
  std::optional<detail::RaySources> sources_;  ///< where slices share light
  /// Else: [angle][pixel][slice] of the calibration, and of black [slice].
  std::vector<double> light_, black_;
};

/// In resin that stays as it is, all the light of the print; else that of `turns` one by one, which
/// bring the same light each.
Box<float> dose_of(const TomoJob& job, const Bench& bench, Schedule schedule, int turns,
                   const ExecutionContext& context) {
  const TomoGrid& grid = bench.grid;
  const DirectSum direct(job, bench, std::move(schedule), context);
  const double per_unit = bench.exposure.alpha_a_per_cm;
  Box<float> dose{grid.slices, grid.voxels, grid.voxels, {}};
  dose.values.assign(static_cast<std::size_t>(grid.slices) * static_cast<std::size_t>(grid.voxels) *
                         static_cast<std::size_t>(grid.voxels),
                     0.0F);
  const auto slices = static_cast<std::size_t>(grid.slices);
  const bool comes_back = bench.resupply_mj_cm3_s > 0;
  if (comes_back || job.resin.dose_diffusion_m2_s > 0) {
    detail::check_spread(bench, job.resin, turns);
    detail::TurnDose turn{std::move(dose), {}, {}, {}};
    if (comes_back) turn.lowest = turn.highest = turn.rise = turn.gain;
    const auto frames = comes_back ? static_cast<std::size_t>(grid.angles) : std::size_t{1};
    const double share = per_unit / turns;
    const double back =
        bench.resupply_mj_cm3_s * bench.exposure.turn_s / static_cast<double>(frames);
    parallel_for(context, "judge", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
      const int y = static_cast<int>(row);
      std::vector<double> sum(frames * slices);
      std::vector<detail::TurnOfVoxel> voxels(slices);
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        std::fill(sum.begin(), sum.end(), 0.0);
        direct.add(x, y, sum);
        std::fill(voxels.begin(), voxels.end(), detail::TurnOfVoxel{});
        for (std::size_t k = 0; k < sum.size(); ++k) voxels[k % slices].add(share * sum[k], back);
        for (std::size_t z = 0; z < slices; ++z) {
          const detail::TurnOfVoxel& voxel = voxels[z];
          const std::size_t v = turn.gain.at(static_cast<int>(z), y, x);
          turn.gain.values[v] = static_cast<float>(voxel.gain);
          if (!comes_back) continue;
          turn.lowest.values[v] = static_cast<float>(voxel.lowest);
          turn.highest.values[v] = static_cast<float>(voxel.highest);
          turn.rise.values[v] = static_cast<float>(voxel.rise);
        }
      }
    });
    return detail::effective_dose(bench, job.resin, job.insert, turns, turn,
                                  slicecorr::detail::silent(context));
  }
  parallel_for(context, "judge", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    std::vector<double> sum(slices);
    const TomoGrid::Range range = grid.inside(y);
    for (int x = range.first; x < range.end; ++x) {
      std::fill(sum.begin(), sum.end(), 0.0);
      direct.add(x, y, sum);
      for (int z = 0; z < grid.slices; ++z) {
        dose.values[dose.at(z, y, x)] =
            static_cast<float>(per_unit * sum[static_cast<std::size_t>(z)]);
      }
    }
  });
  return dose;
}

}  // namespace

Box<float> dose_of(const TomoJob& job, const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  return dose_of(job, bench, planned(job, bench), job.turns, context);
}

Box<float> dose_of(const TomoJob& job, std::span<const Showing> shown,
                   const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  double lit_s = 0;
  for (const Showing& s : shown) lit_s += s.frame == kBlackFrame ? 0 : s.exposed_s;
  const double turns = std::clamp(std::round(lit_s / bench.exposure.turn_s), 1.0, 1e9);
  return dose_of(job, bench, scheduled(shown, bench), static_cast<int>(turns), context);
}

}  // namespace slicecorr::tomo
