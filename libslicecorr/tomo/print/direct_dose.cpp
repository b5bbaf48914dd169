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
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/ray_sources.hpp"
#include "tomo/operators/shade.hpp"
#include "tomo/print/changing_resin.hpp"
#include "tomo/print/schedule.hpp"
#include "tomo/print/steady_kernels.hpp"

namespace slicecorr::tomo {

namespace {

using detail::RaySource;
using detail::Schedule;

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
  /// Whether the vial turns light of any place.
  bool turns() const {
    return std::any_of(turn_.begin(), turn_.end(), [](double t) { return std::abs(t) > 1e-12; });
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
  // Both are rounded from far below 0 on.
  constexpr int kFar = 1 << 24;
  const auto first = static_cast<long>(at - reach + 0.5 + kFar) - kFar,
             last = kFar - static_cast<long>(kFar - (at + reach - 0.5));
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
        runs_(schedule_, bench.grid.angles),
        n_(index_of(job.resin)),
        alpha_(absorption_per_mm(job.resin)),
        level_(job.insert, bench.grid.slices),
        rising_(job.insert) {
    const TomoGrid& g = bench.grid;
    constexpr int kCellsPerStep = Schedule::kCellsPerStep;
    // Directions of a step, of light that a vial turns by column of a cell, of which light goes on by a
    // quarter of a voxel at most.
    const double part_mm = part_radius_mm(job.part, job.sampling.voxel_mm);
    const double radius_mm =
        part_mm > 0 ? std::min(bench.radius_mm, part_mm + g.voxel_mm()) : bench.radius_mm;
    const double arc = 2 * std::numbers::pi / g.angles * radius_mm / g.voxel_mm();
    if (!g.coupled()) across_.emplace(printer_, n_, bench);
    steady_ =
        across_ && !across_->turns() && !bench.places.moved() && printer_.rotation->wobble.empty();
    arc_of_cell_ = arc * g.angles / schedule_.cells();
    // Light falls on voxels for as long as it is shown, in closed form, which bears two voxels.
    directions_ = std::clamp(static_cast<int>(std::ceil(arc / 2)), 1, 64);
    if (!g.coupled() && !steady_) {
      // The same directions for frames as planned and as shown.
      const auto parts = static_cast<int>(std::ceil(4 * arc / kCellsPerStep));
      directions_ = std::clamp(parts, 1, 12) * kCellsPerStep * g.angles / schedule_.cells();
    }
    if (g.coupled()) {
      sources_.emplace(printer_, n_, alpha_, g.lowest_mm,
                       g.lowest_mm + g.slice_height_mm() * (g.slices - 1), context);
      for (int ray = 0; ray < bench.lab->per_pixel; ++ray) take_turns(ray);
      wobbles_ = !printer_.rotation->wobble.empty();
      light_lanes_ = static_cast<std::size_t>(g.light_lanes());
      frame_size_ = static_cast<std::size_t>(g.pixels) * light_lanes_;
      if (!wobbles_) make_image();
      return;
    }
    if (steady_) make_steady();
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
        if (!steady_ || !bench.places.uneven()) continue;
        for (std::size_t z = 0; z < slices; ++z) {
          to[z] *= bench.places.share(m, i, static_cast<int>(z));
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
    if (steady_) {
      add_steady(column, row_of_voxels, sum);
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
      const detail::Boxes<double> boxes(one, other,
                                        std::abs(u) * cell_rad / directions_ / g.pixel_mm);
      const double place = (t - first_mm) / g.pixel_mm, reach = boxes.reach();
      const bool shaded = level_.hides(column, row_of_voxels, s, -c, hidden);
      // Piece by piece of the voxel, as columns cut it.
      double edge = place - reach, before = 0;
      while (edge < place + reach - 1e-9) {
        double next = std::min(place + reach, next_edge(edge));
        // Pieces whose light is turned by more than a direction's width are cut again.
        const double turns = std::abs(across_->at(next).turn_rad - across_->at(edge).turn_rad);
        const double cuts = std::ceil(turns / cell_rad * directions_ - 1e-6);
        if (cuts > 1) next = std::min(next, edge + (next - edge) / std::min(cuts, 16.0));
        const double up_to = next >= place + reach ? 1 : boxes.below(next - place);
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

  /// What does not depend on the voxel, of light that keeps its direction, and its columns.
  void make_steady() {
    const TomoGrid& g = bench_.grid;
    const double first_mm =
        pixel_x_mm(printer_, bench_.window.first_column) * printer_.vial->n_outside / n_;
    constexpr int kWithin = 4;
    for (int i = 0; i < g.pixels; ++i) {
      double sum = 0;
      for (int k = 0; k < kWithin; ++k) {
        const double at = i + (k + 0.5) / kWithin - 0.5, t = first_mm + at * g.pixel_mm;
        const double half = std::sqrt(std::max(0.0, bench_.radius_mm * bench_.radius_mm - t * t));
        sum += across_->at(at).share * std::exp(-alpha_ * half);
      }
      of_column_.push_back(sum / kWithin);
    }
    for (const detail::LitRun& run : runs_.all()) {
      if (run.parts->empty()) continue;
      const long cells = run.end - run.first;
      const int count = std::clamp(
          static_cast<int>(std::ceil(static_cast<double>(cells) * arc_of_cell_ / 2)), 1, 64);
      const double wide = static_cast<double>(cells) / count,
                   cell_rad = 2 * std::numbers::pi / schedule_.cells();
      for (int k = 0; k < count; ++k) {
        const double th = cell_rad * (static_cast<double>(run.first) - 0.5 + (k + 0.5) * wide);
        const double side = g.voxel_mm() / g.pixel_mm;
        detail::SteadyDirection d;
        d.cosine = std::cos(th);
        d.sine = std::sin(th);
        d.turn_px = wide * cell_rad / g.pixel_mm;
        d.boxes = {side * std::abs(d.cosine), side * std::abs(d.sine)};
        steady_directions_.push_back(d);
        runs_of_directions_.emplace_back(&run, wide);
        for (int i = 0; i < g.voxels; ++i) {
          dim_x_.push_back(wide * std::exp(alpha_ * g.voxel_at_mm(i) * d.sine));
          dim_y_.push_back(std::exp(-alpha_ * g.voxel_at_mm(i) * d.cosine));
        }
        const double reach =
            d.boxes.outer + std::max(detail::kLeastBox, bench_.radius_mm * d.turn_px) / 2;
        taps_ = std::max(taps_, static_cast<int>(std::ceil(2 * reach)) + 1);
      }
    }
    first_mm_ = first_mm;
  }

  /// The same of such light.
  void add_steady(int column, int row_of_voxels, std::vector<double>& sum) const {
    const TomoGrid& g = bench_.grid;
    const auto slices = static_cast<std::size_t>(g.slices), n = static_cast<std::size_t>(g.voxels);
    const bool by_frame = sum.size() > slices;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    std::vector<std::uint64_t> hidden(level_.words());
    const detail::SteadyVoxel voxel{x, y, first_mm_, g.pixel_mm};
    int first[detail::kSteadyAtOnce];
    thread_local std::vector<double> shares;
    shares.resize(static_cast<std::size_t>(taps_ * detail::kSteadyAtOnce));
    for (std::size_t k0 = 0; k0 < steady_directions_.size(); k0 += detail::kSteadyAtOnce) {
      const std::size_t count =
          std::min<std::size_t>(detail::kSteadyAtOnce, steady_directions_.size() - k0);
      detail::steady_shares(&steady_directions_[k0], static_cast<int>(count), voxel, taps_, first,
                            shares.data());
      for (std::size_t at = 0; at < count; ++at) {
        const std::size_t k = k0 + at;
        const detail::SteadyDirection& d = steady_directions_[k];
        const detail::LitRun& run = *runs_of_directions_[k].first;
        const double dims = dim_x_[k * n + static_cast<std::size_t>(column)] *
                            dim_y_[k * n + static_cast<std::size_t>(row_of_voxels)];
        const bool shaded = level_.hides(column, row_of_voxels, d.sine, -d.cosine, hidden);
        double* const to = sum.data() + (by_frame ? frame_at(run.stage) * slices : std::size_t{0});
        for (int tap = 0; tap < taps_; ++tap) {
          const int i = first[at] + tap;
          const double share = shares[static_cast<std::size_t>(tap) * detail::kSteadyAtOnce + at];
          if (share == 0 || i < 0 || i >= g.pixels) continue;
          add_steady(run, i, share * dims * of_column_[static_cast<std::size_t>(i)],
                     shaded ? &hidden : nullptr, to);
        }
      }
    }
  }
  /// Light of a column while a run lasts.
  void add_steady(const detail::LitRun& run, int i, double of_pixel,
                  const std::vector<std::uint64_t>* hidden, double* to) const {
    const auto slices = static_cast<std::size_t>(bench_.grid.slices);
    for (const Schedule::Part& part : *run.parts) {
      const bool black = part.angle == kBlackFrame;
      const double* const lit = black ? black_.data() : &light_[row(part.angle, i)];
      const double weight = of_pixel * part.exposed_s;
      for (std::size_t z = 0; z < slices; ++z) {
        if (hidden && ((*hidden)[z / 64] >> (z % 64) & 1)) continue;
        to[z] +=
            weight * lit[z] * (black ? bench_.places.share(run.stage, i, static_cast<int>(z)) : 1);
      }
    }
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

  void make_image() {
    const TomoGrid& g = bench_.grid;
    // Footprints read up to 8 numbers on.
    image_.resize((static_cast<std::size_t>(g.angles) + 1) * frame_size_ + 8);
    for (int m = 0; m <= g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int r = 0; r < g.rows; ++r) {
          const bool black = m == g.angles;
          const double lit = bench_.mw_cm2[black ? 0 : job_.levels[g.pixel(m, i, r)]];
          image_[static_cast<std::size_t>(m) * frame_size_ +
                 static_cast<std::size_t>(i) * light_lanes_ + static_cast<std::size_t>(r)] =
              static_cast<float>(lit * bench_.places.share(0, i, r));
        }
      }
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
    const int columns = bench_.lab->columns;
    const int c = std::clamp(nearest(column), 0, columns - 1);
    return turns_[static_cast<std::size_t>(ray * columns + c)];
  }
  /// To a whole number, from -65536 on.
  static int nearest(double v) { return static_cast<int>(v + 65536.5) - 65536; }

  /// A column of voxels as it looks along one ray of pixels: as in its middle, as sizes hardly change
  /// along z.
  struct SeenColumn {
    detail::Boxes<double> across, upwards;  ///< of a voxel, in columns and rows
    double by_column = 0;  ///< cells of the schedule by which light is turned from column to column
    double by_cell = 0;    ///< columns by which a voxel moves while the vial turns by a cell
    double wide = 1;       ///< cells of a direction
  };

  /// The same where slices share light.
  void add_rays(int column, int row_of_voxels, std::vector<double>& sum) const {
    const TomoGrid& g = bench_.grid;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    const auto slices = static_cast<std::size_t>(g.slices);
    const bool by_frame = sum.size() > slices;
    std::vector<RaySource> sources(slices);
    const int count = g.angles * directions_;
    const double wide = static_cast<double>(schedule_.cells()) / count,
                 cell_rad = 2 * std::numbers::pi / schedule_.cells();
    for (int k = 0; k < count; ++k) {
      const double in_cells = k * wide, th = in_cells * cell_rad;
      const double c = std::cos(th), s = std::sin(th);
      const double t = x * c + y * s, u = -x * s + y * c;
      for (int ray = 0; ray < sources_->rays(); ++ray) {
        sources_->along_z(ray, t, u, g.lowest_mm, g.slice_height_mm(), sources);
        const auto lit = [](const RaySource& from) { return from.share > 0; };
        auto middle = std::find_if(sources.begin() + g.slices / 2, sources.end(), lit);
        if (middle == sources.end()) middle = std::find_if(sources.begin(), sources.end(), lit);
        if (middle == sources.end()) continue;
        const double side = g.voxel_mm() * middle->along;
        SeenColumn seen{{side * std::abs(c), side * std::abs(s)},
                        {g.slice_height_mm() * middle->up,
                         g.voxel_mm() * std::abs(middle->slope) * middle->up, 0},
                        turn_of_column(ray, middle->column - bench_.window.first_column) / cell_rad,
                        u * cell_rad * middle->along,
                        wide};
        for (std::size_t z = 0; z < slices; ++z) {
          const RaySource& from = sources[z];
          if (!(from.share > 0)) continue;
          if (rising_.hides(column, row_of_voxels, static_cast<int>(z), th, from.slope)) continue;
          add_ray(seen, from, in_cells - from.turn_rad / cell_rad, [&](int stage) -> double& {
            return sum[z + (by_frame ? frame_at(stage) * slices : 0)];
          });
        }
      }
    }
  }

  /// Shares of those of `count` pixels that a voxel at `place` meets; the first of them. `shares` may have
  /// more numbers, which are 0.
  static int take_shares(const detail::Boxes<double>& boxes, double place, int count,
                         std::vector<float>& shares) {
    const int first = nearest(place - boxes.reach()), last = nearest(place + boxes.reach());
    shares.clear();
    double before = 0;
    for (int i = first; i <= last; ++i) {
      const double up_to = i == last ? 1 : boxes.below(i + 0.5 - place);
      if (i >= 0 && i < count) shares.push_back(static_cast<float>(up_to - before));
      before = up_to;
    }
    return std::max(first, 0);
  }

  /// Adds a voxel's light by one ray of its pixels; `at`: the cell of the schedule in which it comes.
  template <class To>
  void add_ray(const SeenColumn& seen, const RaySource& from, double at, const To& to) const {
    // By where a steady axis would be shown; wobble moves the image by whole pixels.
    const double pixel = from.column - bench_.window.first_column,
                 row = bench_.window.rows - 1 - (from.row - bench_.window.first_row);
    const TomoGrid& g = bench_.grid;
    thread_local std::vector<float> rows, columns;
    const int first_row = take_shares(seen.upwards, row, wobbles_ ? 1 << 24 : g.rows, rows);
    if (rows.empty()) return;
    const std::size_t count = rows.size();
    rows.resize((count + 7) / 8 * 8);
    const auto add = [&](const detail::LitRun& run, double cells, int first) {
      for (const Schedule::Part& part : *run.parts) {
        double light = 0;
        if (wobbles_) {
          for (std::size_t i = 0; i < columns.size(); ++i) {
            light += columns[i] * light_of_rows(part.angle, run.stage, first + static_cast<int>(i),
                                                first_row, std::span(rows).first(count));
          }
        } else if (!columns.empty()) {
          const std::size_t at = part.angle == kBlackFrame
                                     ? static_cast<std::size_t>(g.angles) * frame_size_
                                     : static_cast<std::size_t>(part.angle) * frame_size_;
          light = detail::footprint_light(
              {columns.data(), rows.data(), static_cast<int>(columns.size()),
               static_cast<int>(rows.size())},
              image_.data() + at + static_cast<std::size_t>(first) * light_lanes_ +
                  static_cast<std::size_t>(first_row),
              light_lanes_);
        }
        to(run.stage) += from.share * cells * part.exposed_s * light;
      }
    };
    // Of a direction each frame has the part in which it is shown, and the voxel's place then.
    const auto boxes_of = [&](double cells) {
      detail::Boxes<double> boxes = seen.across;
      boxes.take_third(std::abs(seen.by_cell) * cells);
      return boxes;
    };
    // Columns of a voxel may be taken to be turned alike where that moves little of their light to
    // another frame.
    constexpr double kAlike = 0.03;
    const int most = wobbles_ ? 1 << 24 : g.pixels;
    const double reach = boxes_of(seen.wide).reach();
    if (std::abs(seen.by_column) * reach < kAlike * seen.wide) {
      runs_.each(at - seen.wide / 2, at + seen.wide / 2,
                 [&](double middle, double cells, const detail::LitRun& run) {
                   const double place = pixel + seen.by_cell * (middle - at);
                   add(run, cells, take_shares(boxes_of(cells), place, most, columns));
                 });
      return;
    }
    columns.resize(1);
    const int last = nearest(pixel + reach + 0.5 * std::abs(seen.by_cell) * seen.wide);
    for (int i = nearest(pixel - reach - 0.5 * std::abs(seen.by_cell) * seen.wide); i <= last;
         ++i) {
      if (i < 0 || i >= most) continue;
      const double here = at - seen.by_column * (i - pixel);
      runs_.each(here - seen.wide / 2, here + seen.wide / 2,
                 [&](double middle, double cells, const detail::LitRun& run) {
                   const detail::Boxes<double> boxes = boxes_of(cells);
                   const double edge = i - pixel - seen.by_cell * (middle - here);
                   columns[0] =
                       static_cast<float>(boxes.below(edge + 0.5) - boxes.below(edge - 0.5));
                   if (columns[0] > 0) add(run, cells, i);
                 });
    }
  }

  /// Light of a column of the image of a steady axis, mW/cm², by these shares of its rows from `first`.
  double light_of_rows(int frame, int stage, int column, int first,
                       std::span<const float> shares) const {
    const TomoGrid& g = bench_.grid;
    const FramePlaces& places = bench_.places;
    const int m = frame == kBlackFrame ? stage : frame;
    int i = column, low = first;
    if (wobbles_) {
      // Where the frame of m has what the stage's axis shows here.
      i += static_cast<int>(std::lround(places.right_px(stage)) - std::lround(places.right_px(m)));
      low += static_cast<int>(std::lround(places.up_px(stage)) - std::lround(places.up_px(m)));
    }
    if (i < 0 || i >= g.pixels) return 0;
    const int from = std::max(0, low),
              end = std::min(g.rows, low + static_cast<int>(shares.size()));
    const std::uint16_t* const levels =
        job_.levels.data() + (static_cast<std::size_t>(m) * static_cast<std::size_t>(g.pixels) +
                              static_cast<std::size_t>(i)) *
                                 light_lanes_;
    const bool uneven = places.uneven();
    double light = 0;
    for (int r = from; r < end; ++r) {
      const double lit = bench_.mw_cm2[frame == kBlackFrame ? 0 : levels[r]] *
                         shares[static_cast<std::size_t>(r - low)];
      light += uneven ? lit * places.share(m, i, r) : lit;
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
  const detail::LitRuns runs_;
  double n_, alpha_;
  detail::LevelShade level_;
  detail::RisingShade rising_;
  double arc_of_cell_ = 0;  ///< voxels by which a part's rim moves in a cell of the schedule
  int directions_ = 1;  ///< of a step; where a vial turns level light, of a cell of the schedule
  std::optional<detail::RaySources> sources_;  ///< where slices share light
  std::vector<double> turns_;                  ///< [ray][column], rad
  bool wobbles_ = false;
  std::size_t light_lanes_ = 0, frame_size_ = 0;
  Array<float> image_;  ///< light of all frames, and of black, as light lies; where nothing wobbles
  std::optional<LevelLight> across_;  ///< else
  bool steady_ = false;               ///< and it keeps its direction and its columns
  double first_mm_ = 0;               ///< then: t of the first column
  int taps_ = 1;                      ///< columns that a voxel may meet
  std::vector<detail::SteadyDirection> steady_directions_;
  std::vector<std::pair<const detail::LitRun*, double>> runs_of_directions_;  ///< and cells
  std::vector<double> of_column_;      ///< what of its light comes to u = 0, for a direction's time
  std::vector<double> dim_x_, dim_y_;  ///< [direction][voxel]
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
  return dose_of(job, bench, detail::planned(job, bench), job.turns, context);
}

Box<float> dose_of(const TomoJob& job, std::span<const Showing> shown,
                   const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  double lit_s = 0;
  for (const Showing& s : shown) lit_s += s.frame == kBlackFrame ? 0 : s.exposed_s;
  const double turns = std::clamp(std::round(lit_s / bench.exposure.turn_s), 1.0, 1e9);
  return dose_of(job, bench, detail::scheduled(shown, bench), static_cast<int>(turns), context);
}

}  // namespace slicecorr::tomo
