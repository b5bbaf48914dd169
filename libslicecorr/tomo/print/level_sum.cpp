// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The direct sum of light that stays in its slice.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "slicecorr/tomo/shown.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/directions.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/shade.hpp"
#include "tomo/print/direct_sum.hpp"
#include "tomo/print/rows_of_slices.hpp"
#include "tomo/print/steady_kernels.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// What light of a place across the image becomes in the resin: a table over places, 16 to a column.
class LevelLight {
 public:
  LevelLight(const Printer& printer, double n, const Bench& bench)
      : first_(-1), magnified_(n / printer.vial->n_outside) {
    const double window = chief_ray(printer, 0, 0).transmittance;
    for (int k = 0; k <= kFine * (bench.grid.pixels + 2); ++k) {
      const double q =
          pixel_x_mm(printer, bench.window.first_column + first_ + static_cast<double>(k) / kFine);
      const bool in = !misses(*printer.vial, n, q, 0);
      turn_.push_back(in ? turned_rad(*printer.vial, n, q, 0) : 0);
      share_.push_back(in ? transmittance(*printer.vial, n, q, 0) * magnified_ * window : 0);
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
        cell == last ? 1 : two_boxes_below(static_cast<double>(cell) + 0.5 - at, one, other);
    if (up_to > before) use(cell, up_to - before);
    before = std::max(before, up_to);
  }
}
class LevelSum final : public DirectSum {
 public:
  explicit LevelSum(const Judged& judged)
      : judged_(judged),
        printer_(judged.job.printer),
        bench_(judged.bench),
        schedule_(judged.schedule),
        runs_(judged.schedule, judged.bench.grid.angles),
        n_(index_of(judged.job.resin)),
        alpha_(absorption_per_mm(judged.job.resin)),
        lit_(judged.bench.rays.lit),
        level_(judged.job.insert, judged.bench.grid.slices),
        across_(printer_, n_, bench_) {
    const TomoGrid& g = bench_.grid;
    constexpr int kCellsPerStep = Schedule::kCellsPerStep;
    // Directions of a cell of the schedule, in which light goes on by a quarter of a voxel at most. The
    // same directions for frames as planned and as shown.
    const double arc = judged.arc();
    steady_ = !across_.turns() && !bench_.places.moved() && printer_.rotation->wobble.empty();
    arc_of_cell_ = arc * g.angles / schedule_.cells();
    const auto parts = static_cast<int>(std::ceil(4 * arc / kCellsPerStep));
    directions_ = std::clamp(parts, 1, 12) * kCellsPerStep * g.angles / schedule_.cells();
    if (steady_) make_steady();
    black_.assign(static_cast<std::size_t>(g.slices), bench_.mw_cm2.front());
    light_ = light_of_slices(judged, steady_);
  }

  void add(int column, int row_of_voxels, std::vector<double>& sum) const override {
    if (steady_) {
      add_steady(column, row_of_voxels, sum);
      return;
    }
    const bool by_frame = sum.size() > static_cast<std::size_t>(bench_.grid.slices);
    const TomoGrid& g = bench_.grid;
    const double x = g.voxel_at_mm(column), y = g.voxel_at_mm(row_of_voxels);
    std::vector<std::uint64_t> hidden(level_.words());
    const int count = schedule_.cells() * directions_;
    // Elsewhere it does not matter where the stage stands.
    const bool by_stage = by_frame || bench_.places.moved() || bench_.places.uneven();
    const double first_mm =
        pixel_x_mm(printer_, bench_.window.first_column) * printer_.vial->n_outside / n_;
    const double cell_rad = 2 * std::numbers::pi / schedule_.cells();
    for (int k = 0; k < count; ++k) {
      const double in_cells = (k + 0.5) / directions_ - 0.5, th = in_cells * cell_rad;
      const double c = std::cos(th), s = std::sin(th);
      const double t = x * c + y * s, u = -x * s + y * c;
      const double one = judged_.side_mm() * std::abs(c) / g.pixel_mm,
                   other = judged_.side_mm() * std::abs(s) / g.pixel_mm;
      const Boxes<double> boxes(one, other, std::abs(u) * cell_rad / directions_ / g.pixel_mm);
      const double place = (t - first_mm) / g.pixel_mm, reach = boxes.reach();
      const bool shaded = level_.hides(column, row_of_voxels, s, -c, hidden);
      // Piece by piece of the voxel, as columns cut it.
      double edge = place - reach, before = 0, turned = across_.at(edge).turn_rad;
      while (edge < place + reach - 1e-9) {
        double next = std::min(place + reach, next_edge(edge));
        // Pieces whose light is turned by more than a direction's width are cut again.
        double turned_next = across_.at(next).turn_rad;
        const double cuts =
            std::ceil(std::abs(turned_next - turned) / cell_rad * directions_ - 1e-6);
        if (cuts > 1) {
          next = std::min(next, edge + (next - edge) / std::min(cuts, 16.0));
          turned_next = across_.at(next).turn_rad;
        }
        const double up_to = next >= place + reach ? 1 : boxes.below(next - place);
        const double middle = (edge + next) / 2;
        const LevelLight::At from = across_.at(middle);
        double met = up_to - before;
        if (lit_ < 1) {
          // Of the piece that which its pixel lights.
          const double pixel = std::floor(middle + 0.5);
          const double low = std::max(edge, pixel - lit_ / 2),
                       high = std::min(next, pixel + lit_ / 2);
          met = high > low ? (boxes.below(high - place) - boxes.below(low - place)) / lit_ : 0;
        }
        if (from.share > 0 && met > 0) {
          const double t_ray = first_mm + middle * g.pixel_mm;
          const double half =
              std::sqrt(std::max(0.0, bench_.radius_mm * bench_.radius_mm - t_ray * t_ray));
          const double share = met * from.share * std::exp(-alpha_ * (half + u)) / directions_;
          each_cell(in_cells - from.turn_rad / cell_rad, 1.0 / directions_, 0,
                    [&](long cell, double of_cell) {
                      for (const Schedule::Part& part : schedule_.at(cell)) {
                        const int stage = by_stage ? judged_.angle_near(cell) : 0;
                        add(part.angle, stage, middle, share * of_cell * part.exposed_s,
                            shaded ? &hidden : nullptr,
                            sum.data() + (by_frame ? judged_.frame_at(stage) *
                                                         static_cast<std::size_t>(g.slices)
                                                   : 0));
                      }
                    });
        }
        before = std::max(before, up_to);
        edge = next;
        turned = turned_next;
      }
    }
  }

 private:
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
        sum += across_.at(at).share * std::exp(-alpha_ * half);
      }
      of_column_.push_back(sum / kWithin);
    }
    for (const LitRun& run : runs_.all()) {
      if (run.parts->empty()) continue;
      const long cells = run.end - run.first;
      const int count = std::clamp(
          static_cast<int>(std::ceil(static_cast<double>(cells) * arc_of_cell_ / 2)), 1, 64);
      const double wide = static_cast<double>(cells) / count,
                   cell_rad = 2 * std::numbers::pi / schedule_.cells();
      for (int k = 0; k < count; ++k) {
        const double th = cell_rad * (static_cast<double>(run.first) - 0.5 + (k + 0.5) * wide);
        const double side = judged_.side_mm() / g.pixel_mm;
        SteadyDirection d;
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
        const double reach = d.boxes.outer + std::max(kLeastBox, bench_.radius_mm * d.turn_px) / 2;
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
    const SteadyVoxel voxel{x, y, first_mm_, g.pixel_mm, lit_};
    int first[kSteadyAtOnce];
    thread_local std::vector<double> shares;
    shares.resize(static_cast<std::size_t>(taps_ * kSteadyAtOnce));
    for (std::size_t k0 = 0; k0 < steady_directions_.size(); k0 += kSteadyAtOnce) {
      const std::size_t count =
          std::min<std::size_t>(kSteadyAtOnce, steady_directions_.size() - k0);
      steady_shares(&steady_directions_[k0], static_cast<int>(count), voxel, taps_, first,
                    shares.data());
      for (std::size_t at = 0; at < count; ++at) {
        const std::size_t k = k0 + at;
        const SteadyDirection& d = steady_directions_[k];
        const LitRun& run = *runs_of_directions_[k].first;
        const double dims = dim_x_[k * n + static_cast<std::size_t>(column)] *
                            dim_y_[k * n + static_cast<std::size_t>(row_of_voxels)];
        const bool shaded = level_.hides(column, row_of_voxels, d.sine, -d.cosine, hidden);
        double* const to =
            sum.data() + (by_frame ? judged_.frame_at(run.stage) * slices : std::size_t{0});
        for (int tap = 0; tap < taps_; ++tap) {
          const int i = first[at] + tap;
          const double share = shares[static_cast<std::size_t>(tap) * kSteadyAtOnce + at];
          if (share == 0 || i < 0 || i >= g.pixels) continue;
          add_steady(run, i, share * dims * of_column_[static_cast<std::size_t>(i)],
                     shaded ? &hidden : nullptr, to);
        }
      }
    }
  }
  /// Light of a column while a run lasts.
  void add_steady(const LitRun& run, int i, double of_pixel,
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
  std::size_t row(int m, int i) const {
    const TomoGrid& g = bench_.grid;
    return (static_cast<std::size_t>(m) * static_cast<std::size_t>(g.pixels) +
            static_cast<std::size_t>(i)) *
           static_cast<std::size_t>(g.slices);
  }

  const Judged judged_;
  const Printer& printer_;
  const Bench& bench_;
  const Schedule& schedule_;
  const LitRuns runs_;
  double n_, alpha_;
  double lit_;  ///< share of a pixel's side
  LevelShade level_;
  LevelLight across_;
  double arc_of_cell_ = 0;  ///< voxels by which a part's rim moves in a cell of the schedule
  int directions_ = 1;      ///< of a cell of the schedule
  bool steady_ = false;     ///< light keeps its direction and its columns
  double first_mm_ = 0;     ///< then: t of the first column
  int taps_ = 1;            ///< columns that a voxel may meet
  std::vector<SteadyDirection> steady_directions_;
  std::vector<std::pair<const LitRun*, double>> runs_of_directions_;  ///< and cells
  std::vector<double> of_column_;      ///< what of its light comes to u = 0, for a direction's time
  std::vector<double> dim_x_, dim_y_;  ///< [direction][voxel]
  /// [angle][pixel][slice] of the calibration, and of black [slice].
  std::vector<double> light_, black_;
};

}  // namespace

std::unique_ptr<DirectSum> make_level_sum(const Judged& judged) {
  return std::make_unique<LevelSum>(judged);
}

}  // namespace slicecorr::tomo::detail
