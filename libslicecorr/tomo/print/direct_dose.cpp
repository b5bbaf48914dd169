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
#include "tomo/operators/directions.hpp"
#include "tomo/operators/ray_sources.hpp"
#include "tomo/operators/shade.hpp"
#include "tomo/print/changing_resin.hpp"

namespace slicecorr::tomo {

namespace {

using detail::RaySource;

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

/// What light of a place across the image becomes in the resin: a table over places, 16 to a column.
class LevelLight {
 public:
  LevelLight(const Printer& printer, double n, const Bench& bench)
      : first_(-1), magnified_(n / printer.vial->n_outside) {
    for (int k = 0; k <= kFine * (bench.grid.pixels + 2); ++k) {
      const double q =
          pixel_x_mm(printer, bench.window.first_column + first_ + static_cast<double>(k) / kFine);
      const bool in = !misses(*printer.vial, n, q, 0);
      turn_.push_back(in ? turned_rad(*printer.vial, n, q, 0) : 0);
      share_.push_back(in ? transmittance(*printer.vial, n, q, 0) * magnified_ : 0);
      in_.push_back(in);
    }
  }
  struct At {
    double turn_rad = 0;
    double share = 0;  ///< of a pixel's irradiance that is left without absorption; 0: it misses
  };
  At at(double place) const {
    const double f = (place - first_) * kFine;
    const auto k = static_cast<long>(std::floor(f));
    if (k < 0 || k + 1 >= static_cast<long>(turn_.size())) return {};
    const auto i = static_cast<std::size_t>(k);
    // Where a ray of the two misses, the other tells.
    if (!in_[i] || !in_[i + 1]) {
      const std::size_t j = f - static_cast<double>(k) < 0.5 ? i : i + 1;
      return {turn_[j], share_[j]};
    }
    const double w = f - static_cast<double>(k);
    return {turn_[i] + w * (turn_[i + 1] - turn_[i]), share_[i] + w * (share_[i + 1] - share_[i])};
  }

 private:
  static constexpr int kFine = 16;
  double first_, magnified_;
  std::vector<double> turn_, share_;
  std::vector<bool> in_;
};

/// Calls use(cell, share) for the cells of a schedule that light in directions `one` cells wide, of
/// rays that differ by `other` cells, meets; `at` is its middle.
template <class Use>
void each_cell(double at, double one, double other, const Use& use) {
  const double reach = (one + other) / 2;
  const auto first = static_cast<long>(std::floor(at - reach + 0.5)),
             last = static_cast<long>(std::ceil(at + reach - 0.5));
  double before = 0;
  for (long cell = first; cell <= last; ++cell) {
    const double up_to =
        cell == last ? 1
                     : detail::two_boxes_below(static_cast<double>(cell) + 0.5 - at, one, other);
    if (up_to > before) use(cell, up_to - before);
    before = std::max(before, up_to);
  }
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
        level_(job.insert, bench.grid.slices),
        rising_(job.insert) {
    const TomoGrid& g = bench.grid;
    // Directions in a cell, so that light of one goes on by a quarter of a voxel, or by half of one
    // where its way is counted.
    const double part_mm = part_radius_mm(job.part, job.sampling.voxel_mm);
    const double radius_mm =
        part_mm > 0 ? std::min(bench.radius_mm, part_mm + g.voxel_mm()) : bench.radius_mm;
    const double arc = 2 * std::numbers::pi / g.angles * radius_mm / g.voxel_mm();
    const auto parts = static_cast<int>(std::ceil((g.coupled() ? 1 : 4) * arc / kCellsPerStep));
    // The same directions for frames as planned and as shown.
    directions_ = std::clamp(parts, 1, 12) * kCellsPerStep * g.angles / schedule_.cells();
    if (g.coupled()) {
      sources_.emplace(printer_, n_, alpha_, g.lowest_mm,
                       g.lowest_mm + g.slice_height_mm() * (g.slices - 1), context);
      for (int ray = 0; ray < bench.lab->per_pixel; ++ray) take_turns(ray);
      return;
    }
    across_.emplace(printer_, n_, bench);
    // z innermost, as light of one pixel goes to all slices alike.
    const auto slices = static_cast<std::size_t>(g.slices);
    black_.assign(slices, bench.mw_cm2.front());
    light_.resize(static_cast<std::size_t>(g.angles) * static_cast<std::size_t>(g.pixels) * slices);
    const std::vector<Meets> rows = rows_of_slices();
    for (int m = 0; m < g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        double* const to = &light_[row(m, i)];
        for (const Meets& r : rows) {
          const double lit = bench.mw_cm2[r.shown < 0 ? 0 : job.levels[g.pixel(m, i, r.shown)]];
          to[r.slice] += r.share * lit;
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
    std::vector<std::uint64_t> hidden(level_.words());
    const int count = schedule_.cells() * directions_;
    const double first_mm =
        pixel_x_mm(printer_, bench_.window.first_column) * printer_.vial->n_outside / n_;
    const double cell_rad = 2 * std::numbers::pi / schedule_.cells();
    for (int k = 0; k < count; ++k) {
      const double in_cells = (k + 0.5) / directions_ - 0.5, th = in_cells * cell_rad;
      const double c = std::cos(th), s = std::sin(th);
      const double t = x * c + y * s, u = -x * s + y * c;
      const double one = g.voxel_mm() * std::abs(c) / g.pixel_mm,
                   other = g.voxel_mm() * std::abs(s) / g.pixel_mm;
      const double place = (t - first_mm) / g.pixel_mm, reach = (one + other) / 2;
      const bool shaded = level_.hides(column, row_of_voxels, s, -c, hidden);
      // Piece by piece of the voxel, as columns cut it.
      double edge = place - reach, before = 0;
      while (edge < place + reach - 1e-9) {
        double next = std::min(place + reach, next_edge(edge));
        // Pieces whose light is turned by more than a direction's width are cut again.
        const double turns = std::abs(across_->at(next).turn_rad - across_->at(edge).turn_rad);
        const double cuts = std::ceil(turns / cell_rad * directions_ - 1e-6);
        if (cuts > 1) next = std::min(next, edge + (next - edge) / std::min(cuts, 16.0));
        const double up_to =
            next >= place + reach ? 1 : detail::two_boxes_below(next - place, one, other);
        const double middle = (edge + next) / 2;
        const LevelLight::At from = across_->at(middle);
        if (from.share > 0 && up_to > before) {
          const double t_ray = first_mm + middle * g.pixel_mm;
          const double half =
              std::sqrt(std::max(0.0, bench_.radius_mm * bench_.radius_mm - t_ray * t_ray));
          const double share =
              (up_to - before) * from.share * std::exp(-alpha_ * (half + u)) / directions_;
          each_cell(
              in_cells - from.turn_rad / cell_rad, 1.0 / directions_, 0,
              [&](long cell, double of_cell) {
                for (const Schedule::Part& part : schedule_.at(cell)) {
                  const int stage = angle_near(cell);
                  add(part.angle, stage, middle, share * of_cell * part.exposed_s,
                      shaded ? &hidden : nullptr,
                      sum.data() +
                          (by_frame ? frame_at(stage) * static_cast<std::size_t>(g.slices) : 0));
                }
              });
        }
        before = std::max(before, up_to);
        edge = next;
      }
    }
  }

 private:
  /// Rows that show a slice's light meet other slices, too, where they are not as high as slices, or
  /// lie between them.
  struct Meets {
    std::size_t slice = 0;
    int shown = -1;  ///< whose light, or black
    double share = 0;
  };
  std::vector<Meets> rows_of_slices() const {
    const TomoGrid& g = bench_.grid;
    std::vector<Meets> all;
    const auto slices = static_cast<std::size_t>(g.slices);
    if (bench_.places.moved() || bench_.places.uneven()) {
      for (std::size_t z = 0; z < slices; ++z) all.push_back({z, static_cast<int>(z), 1});
      return all;
    }
    const double height = g.slice_height_mm(), pitch = printer_.pixel_y_um * 1e-3;
    for (std::size_t z = 0; z < slices; ++z) {
      const double low = bench_.places.lowest_mm() + height * (static_cast<double>(z) - 0.5),
                   high = low + height;
      double lit = 0;
      for (int r = 0; r < printer_.height_px; ++r) {
        const double at = pixel_z_mm(printer_, r);
        const double meets = std::min(high, at + pitch / 2) - std::max(low, at - pitch / 2);
        if (!(meets > 1e-9 * height)) continue;
        const int shown = bench_.places.lit_by(0, bench_.window.first_column, r).row;
        lit += meets / height;
        if (!all.empty() && all.back().slice == z && all.back().shown == shown) {
          all.back().share += meets / height;
        } else {
          all.push_back({z, shown, meets / height});
        }
      }
      // The darkness beside the image is not even black light.
      if (lit > 0 && std::abs(lit - 1) < 1e-6 && all.back().slice == z && all.back().share == lit) {
        all.back().share = 1;
      }
    }
    return all;
  }

  /// Where the next column begins; of frames that follow an axis, after a quarter of one.
  double next_edge(double place) const {
    const double fine = bench_.places.moved() ? 4 : 1;
    return (std::floor((place + 0.5) * fine + 1e-9) + 1) / fine - 0.5;
  }

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
  /// the column in which a place lies, which may be another in each slice.
  void add(int frame, int stage, double place, double weight,
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
        const auto column = static_cast<int>(
            std::floor((places.moved() ? places.column_of(stage, place, slice) : place) + 0.5));
        if (column < 0 || column >= g.pixels) continue;
        sum[z] += weight * light(frame, stage, column, slice);
      }
      return;
    }
    const auto column = static_cast<int>(std::floor(place + 0.5));
    if (column < 0 || column >= g.pixels) return;
    const double* const lit = frame == kBlackFrame ? black_.data() : &light_[row(frame, column)];
    for (std::size_t z = 0; z < slices; ++z) {
      if (in_resin(z)) sum[z] += weight * lit[z];
    }
  }

  /// How much more the rays of a column are turned than those of the one before.
  void take_turns(int ray) {
    const LabRays& lab = *bench_.lab;
    const auto at = [&](int c) -> const LabRay& {
      return lab.rays[(static_cast<std::size_t>(c) * static_cast<std::size_t>(lab.rows) +
                       static_cast<std::size_t>(lab.rows / 2)) *
                          static_cast<std::size_t>(lab.per_pixel) +
                      static_cast<std::size_t>(ray)];
    };
    for (int c = 0; c < lab.columns; ++c) {
      const int a = c > 0 && at(c - 1).half_mm > 0 ? c - 1 : c,
                b = c + 1 < lab.columns && at(c + 1).half_mm > 0 ? c + 1 : c;
      const bool known = b > a && at(c).half_mm > 0;
      turns_.push_back(known ? (at(b).turn_rad - at(a).turn_rad) / (b - a) : 0);
    }
  }
  double turn_of_column(int ray, double column) const {
    const auto columns = static_cast<long>(bench_.lab->columns);
    const long c = std::clamp(std::lround(column), 0L, columns - 1);
    return turns_[static_cast<std::size_t>(ray * columns + c)];
  }

  /// The same where slices share light.
  void add_rays(int column, int row_of_voxels, std::vector<double>& sum) const {
    const TomoGrid& g = bench_.grid;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    const auto slices = static_cast<std::size_t>(g.slices);
    const bool by_frame = sum.size() > slices;
    std::vector<RaySource> sources(slices);
    const int count = schedule_.cells() * directions_;
    const double cell_rad = 2 * std::numbers::pi / schedule_.cells(),
                 width_rad = cell_rad / directions_;
    for (int k = 0; k < count; ++k) {
      const double in_cells = (k + 0.5) / directions_ - 0.5, th = in_cells * cell_rad;
      const double c = std::cos(th), s = std::sin(th);
      const double t = x * c + y * s, u = -x * s + y * c;
      for (int ray = 0; ray < sources_->rays(); ++ray) {
        sources_->along_z(ray, t, u, g.lowest_mm, g.slice_height_mm(), sources);
        for (std::size_t z = 0; z < slices; ++z) {
          const RaySource& from = sources[z];
          if (!(from.share > 0)) continue;
          if (rising_.hides(column, row_of_voxels, static_cast<int>(z), th, from.slope)) continue;
          const Seen seen{from, ray, in_cells - from.turn_rad / cell_rad,
                          g.voxel_mm() * std::abs(c) * from.along,
                          std::hypot(g.voxel_mm() * s, u * width_rad) * from.along};
          add_ray(seen, [&](int stage) -> double& {
            return sum[z + (by_frame ? frame_at(stage) * slices : 0)];
          });
        }
      }
    }
  }

  /// A voxel's light by one ray of its pixels.
  struct Seen {
    const RaySource& from;
    int ray = 0;
    double at = 0;              ///< cell of the schedule in which it comes
    double one = 0, other = 0;  ///< widths of the voxel, columns
  };
  template <class To>
  void add_ray(const Seen& seen, const To& to) const {
    const TomoGrid& g = bench_.grid;
    const RaySource& from = seen.from;
    const double cell_rad = 2 * std::numbers::pi / schedule_.cells();
    // By where a steady axis would be shown; wobble moves the image by whole pixels.
    const FramePlaces::Place here{from.column - bench_.window.first_column,
                                  bench_.window.rows - 1 - (from.row - bench_.window.first_row)};
    const double by_column = turn_of_column(seen.ray, here.pixel) / cell_rad;
    const double high = g.slice_height_mm() * from.up,
                 tilted = g.voxel_mm() * std::abs(from.slope) * from.up;
    const double wide = (seen.one + seen.other) / 2, tall = (high + tilted) / 2;
    const auto c0 = std::lround(here.pixel - wide), c1 = std::lround(here.pixel + wide);
    const auto r0 = std::lround(here.row - tall), r1 = std::lround(here.row + tall);
    const auto share_of = [](long i, double place, double one, double other) {
      const double edge = static_cast<double>(i) - place;
      return detail::two_boxes_below(edge + 0.5, one, other) -
             detail::two_boxes_below(edge - 0.5, one, other);
    };
    thread_local std::vector<double> row_shares;
    row_shares.clear();
    for (long r = r0; r <= r1; ++r) row_shares.push_back(share_of(r, here.row, high, tilted));
    for (long i = c0; i <= c1; ++i) {
      const double f = share_of(i, here.pixel, seen.one, seen.other) * from.share / directions_;
      if (!(f > 0)) continue;
      const double at = seen.at - by_column * (static_cast<double>(i) - here.pixel);
      each_cell(at, 1.0 / directions_, std::abs(by_column), [&](long cell, double of_cell) {
        for (const Schedule::Part& part : schedule_.at(cell)) {
          const int stage = angle_near(cell);
          to(stage) +=
              f * of_cell * part.exposed_s * light_of_rows(part.angle, stage, i, r0, row_shares);
        }
      });
    }
  }

  /// Light of a column of the image of a steady axis, mW/cm², by these shares of its rows from `first`.
  double light_of_rows(int frame, int stage, long column, long first,
                       const std::vector<double>& shares) const {
    const TomoGrid& g = bench_.grid;
    const FramePlaces& places = bench_.places;
    const int m = frame == kBlackFrame ? stage : frame;
    // Where the frame of m has what the stage's axis shows here.
    const long i = column + std::lround(places.right_px(stage)) - std::lround(places.right_px(m));
    if (i < 0 || i >= g.pixels) return 0;
    const long low = first + std::lround(places.up_px(stage)) - std::lround(places.up_px(m)),
               from = std::max(0L, low),
               end = std::min<long>(g.rows, low + static_cast<long>(shares.size()));
    const std::uint16_t* const levels = &job_.levels[g.pixel(m, static_cast<int>(i), 0)];
    const bool uneven = places.uneven();
    double light = 0;
    for (long r = from; r < end; ++r) {
      const double lit = bench_.mw_cm2[frame == kBlackFrame ? 0 : levels[r]] *
                         shares[static_cast<std::size_t>(r - low)];
      light += uneven ? lit * places.share(m, static_cast<int>(i), static_cast<int>(r)) : lit;
    }
    return light;
  }

  std::size_t row(int m, int i) const {
    const TomoGrid& g = bench_.grid;
    return (static_cast<std::size_t>(m) * static_cast<std::size_t>(g.pixels) +
            static_cast<std::size_t>(i)) *
           static_cast<std::size_t>(g.slices);
  }

  const TomoJob& job_;
  const Printer& printer_;
  const Bench& bench_;
  const Schedule schedule_;
  double n_, alpha_;
  detail::LevelShade level_;
  detail::RisingShade rising_;
  int directions_ = 1;                         ///< in a cell of the schedule
  std::optional<detail::RaySources> sources_;  ///< where slices share light
  std::vector<double> turns_;                  ///< [ray][column], rad
  std::optional<LevelLight> across_;           ///< else
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
