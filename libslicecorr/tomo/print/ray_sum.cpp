// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The direct sum of light that rises, falls or spreads.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "slicecorr/tomo/shown.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/blurred_projector.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/ray_sources.hpp"
#include "tomo/operators/shade.hpp"
#include "tomo/print/direct_sum.hpp"
#include "tomo/print/steady_kernels.hpp"

namespace slicecorr::tomo::detail {

namespace {

class RaySum final : public DirectSum {
 public:
  RaySum(const Judged& judged, const ExecutionContext& context)
      : judged_(judged),
        job_(judged.job),
        bench_(judged.bench),
        schedule_(judged.schedule),
        runs_(judged.schedule, judged.bench.grid.angles),
        rising_(judged.job.insert),
        sources_(judged.job.printer, index_of(judged.job.resin),
                 absorption_per_mm(judged.job.resin), judged.bench.grid.lowest_mm,
                 judged.bench.grid.lowest_mm +
                     judged.bench.grid.slice_height_mm() * (judged.bench.grid.slices - 1),
                 context) {
    const TomoGrid& g = bench_.grid;
    // Light falls on voxels for as long as it is shown, in closed form, which bears two voxels.
    directions_ = std::clamp(static_cast<int>(std::ceil(judged.arc() / 2)), 1, 64);
    for (int ray = 0; ray < bench_.lab->per_pixel; ++ray) take_turns(ray);
    wobbles_ = !job_.printer.rotation->wobble.empty();
    light_lanes_ = static_cast<std::size_t>(g.light_lanes());
    frame_size_ = static_cast<std::size_t>(g.pixels) * light_lanes_;
    const bool sharp = bench_.blur.size() == 1 && bench_.blur.front().blur.none();
    if (!wobbles_ || !sharp) make_images();
  }

  void add(int column, int row_of_voxels, std::vector<double>& sum) const override {
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
      for (int ray = 0; ray < sources_.rays(); ++ray) {
        sources_.along_z(ray, t, u, g.lowest_mm, g.slice_height_mm(), sources);
        const auto lit = [](const RaySource& from) { return from.share > 0; };
        auto middle = std::find_if(sources.begin() + g.slices / 2, sources.end(), lit);
        if (middle == sources.end()) middle = std::find_if(sources.begin(), sources.end(), lit);
        if (middle == sources.end()) continue;
        const double side = judged_.side_mm() * middle->along;
        SeenColumn seen{side * std::abs(c),
                        side * std::abs(s),
                        judged_.height_mm() * middle->up,
                        judged_.side_mm() * std::abs(middle->slope) * middle->up,
                        turn_of_column(ray, middle->column - bench_.window.first_column) / cell_rad,
                        u * cell_rad * middle->along,
                        wide};
        for (std::size_t z = 0; z < slices; ++z) {
          const RaySource& from = sources[z];
          if (!(from.share > 0)) continue;
          if (rising_.hides(column, row_of_voxels, static_cast<int>(z), th, from.slope)) continue;
          add_ray(seen, from, in_cells - from.turn_rad / cell_rad, [&](int stage) -> double& {
            return sum[z + (by_frame ? judged_.frame_at(stage) * slices : 0)];
          });
        }
      }
    }
  }

 private:
  /// Light of all frames, and of black, blurred as each term says; black last.
  void make_images() {
    const TomoGrid& g = bench_.grid;
    const std::size_t count = static_cast<std::size_t>(g.angles) + 1;
    // Footprints read up to 8 numbers on.
    Array<float> sharp(count * frame_size_ + 8);
    for (int m = 0; m <= g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int r = 0; r < g.rows; ++r) {
          const bool black = m == g.angles;
          const double lit = bench_.mw_cm2[black ? 0 : job_.levels[g.pixel(m, i, r)]];
          sharp[static_cast<std::size_t>(m) * frame_size_ +
                static_cast<std::size_t>(i) * light_lanes_ + static_cast<std::size_t>(r)] =
              static_cast<float>(lit * bench_.places.share(wobbles_ && !black ? m : 0, i, r));
        }
      }
    }
    const FrameShape frame{g.pixels, g.rows, light_lanes_};
    for (std::size_t k = 0; k < bench_.blur.size(); ++k) {
      const ImageBlur& blur = bench_.blur[k].blur;
      if (blur.none() && k + 1 == bench_.blur.size()) {
        // It takes as much as all frames.
        images_.push_back(std::move(sharp));
        return;
      }
      if (blur.none()) {
        images_.push_back(sharp);
        continue;
      }
      Array<float>& blurred = images_.emplace_back(sharp.size());
      for (std::size_t m = 0; m < count; ++m) {
        add_blurred(blur, frame, sharp.data() + m * frame_size_, blurred.data() + m * frame_size_);
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
    double one = 0, other = 0, up = 0, tilted = 0;  ///< sides of a voxel, in columns and in rows
    double by_column = 0;  ///< cells of the schedule by which light is turned from column to column
    double by_cell = 0;    ///< columns by which a voxel moves while the vial turns by a cell
    double wide = 1;       ///< cells of a direction
  };

  /// Of a pixel whose middle lies there.
  static double boxes_share(const Boxes<double>& boxes, double middle, double lit) {
    return (boxes.below(middle + lit / 2) - boxes.below(middle - lit / 2)) / lit;
  }

  /// Shares of those of some pixels that a voxel at `place` meets; the first of them. `shares` may have
  /// more numbers, which are 0.
  struct Pixels {
    int count = 0;   ///< of the image
    double lit = 1;  ///< share of a pixel's side
  };
  static int take_shares(const Boxes<double>& boxes, double place, const Pixels& pixels,
                         std::vector<float>& shares) {
    const int first = nearest(place - boxes.reach()), last = nearest(place + boxes.reach());
    shares.clear();
    if (pixels.lit < 1) {
      for (int i = std::max(first, 0); i <= std::min(last, pixels.count - 1); ++i) {
        shares.push_back(static_cast<float>(boxes_share(boxes, i - place, pixels.lit)));
      }
      return std::max(first, 0);
    }
    double before = 0;
    for (int i = first; i <= last; ++i) {
      const double up_to = i == last ? 1 : boxes.below(i + 0.5 - place);
      if (i >= 0 && i < pixels.count) shares.push_back(static_cast<float>(up_to - before));
      before = up_to;
    }
    return std::max(first, 0);
  }

  /// Adds a voxel's light by one ray of its pixels; `at`: the cell of the schedule in which it comes.
  template <class To>
  void add_ray(const SeenColumn& seen, const RaySource& from, double at, const To& to) const {
    for (std::size_t k = 0; k < bench_.blur.size(); ++k) {
      const double of_depth = bench_.blur[k].depth.at(from.way_mm);
      if (of_depth > 0) add_term(k, of_depth * from.share, seen, from, at, to);
    }
  }
  /// The same of one term of the light, of which so much comes there.
  template <class To>
  void add_term(std::size_t term, double share, const SeenColumn& seen, const RaySource& from,
                double at, const To& to) const {
    const PixelProfile &across = bench_.blur[term].across, &upwards = bench_.blur[term].up;
    const bool by_levels = wobbles_ && images_.empty();
    // By where a steady axis would be shown; wobble moves the image by whole pixels.
    const double pixel = from.column - bench_.window.first_column,
                 row = bench_.window.rows - 1 - (from.row - bench_.window.first_row);
    const TomoGrid& g = bench_.grid;
    thread_local std::vector<float> rows, columns;
    constexpr int kFar = 1 << 24;
    const int first_row = take_shares(Boxes<double>(seen.up, seen.tilted, upwards.soft), row,
                                      {wobbles_ ? kFar : g.rows, upwards.lit}, rows);
    if (rows.empty()) return;
    const std::size_t count = rows.size();
    rows.resize((count + 7) / 8 * 8);
    const auto add = [&](const LitRun& run, double cells, int first) {
      for (const Schedule::Part& part : *run.parts) {
        double light = 0;
        if (wobbles_) {
          for (std::size_t i = 0; i < columns.size(); ++i) {
            const int here = first + static_cast<int>(i);
            const std::span<const float> shares = std::span(rows).first(count);
            light +=
                columns[i] *
                (by_levels || part.angle == kBlackFrame
                     ? light_of_rows(part.angle, run.stage, here, first_row, shares)
                     : blurred_rows(images_[term], part.angle, run.stage, here, first_row, shares));
          }
        } else if (!columns.empty()) {
          const std::size_t at = part.angle == kBlackFrame
                                     ? static_cast<std::size_t>(g.angles) * frame_size_
                                     : static_cast<std::size_t>(part.angle) * frame_size_;
          light = footprint_light({columns.data(), rows.data(), static_cast<int>(columns.size()),
                                   static_cast<int>(rows.size())},
                                  images_[term].data() + at +
                                      static_cast<std::size_t>(first) * light_lanes_ +
                                      static_cast<std::size_t>(first_row),
                                  light_lanes_);
        }
        to(run.stage) += share * cells * part.exposed_s * light;
      }
    };
    // Of a direction each frame has the part in which it is shown, and the voxel's place then.
    const auto boxes_of = [&](double cells) {
      return Boxes<double>(seen.one, seen.other,
                           std::hypot(std::abs(seen.by_cell) * cells, across.soft));
    };
    // Columns of a voxel may be taken to be turned alike where that moves little of their light to
    // another frame.
    constexpr double kAlike = 0.03;
    const Pixels most{wobbles_ ? kFar : g.pixels, across.lit};
    const double reach = boxes_of(seen.wide).reach();
    if (std::abs(seen.by_column) * reach < kAlike * seen.wide) {
      runs_.each(at - seen.wide / 2, at + seen.wide / 2,
                 [&](double middle, double cells, const LitRun& run) {
                   const double place = pixel + seen.by_cell * (middle - at);
                   add(run, cells, take_shares(boxes_of(cells), place, most, columns));
                 });
      return;
    }
    columns.resize(1);
    const int last = nearest(pixel + reach + 0.5 * std::abs(seen.by_cell) * seen.wide);
    for (int i = nearest(pixel - reach - 0.5 * std::abs(seen.by_cell) * seen.wide); i <= last;
         ++i) {
      if (i < 0 || i >= most.count) continue;
      const double here = at - seen.by_column * (i - pixel);
      runs_.each(here - seen.wide / 2, here + seen.wide / 2,
                 [&](double middle, double cells, const LitRun& run) {
                   const Boxes<double> boxes = boxes_of(cells);
                   const double edge = i - pixel - seen.by_cell * (middle - here);
                   columns[0] = static_cast<float>(boxes_share(boxes, edge, across.lit));
                   if (columns[0] > 0) add(run, cells, i);
                 });
    }
  }

  /// Where the frame of angle m has what the axis shows at `column` and `row` while the stage stands at
  /// `stage`.
  struct Moved {
    int column = 0, row = 0;
  };
  Moved moved(int m, int stage, int column, int row) const {
    const FramePlaces& places = bench_.places;
    if (!wobbles_) return {column, row};
    return {
        column +
            static_cast<int>(std::lround(places.right_px(stage)) - std::lround(places.right_px(m))),
        row + static_cast<int>(std::lround(places.up_px(stage)) - std::lround(places.up_px(m)))};
  }
  /// The same of a blurred image of a frame.
  double blurred_rows(const Array<float>& image, int frame, int stage, int column, int first,
                      std::span<const float> shares) const {
    const TomoGrid& g = bench_.grid;
    const auto [i, low] = moved(frame, stage, column, first);
    if (i < 0 || i >= g.pixels) return 0;
    const int end = std::min(g.rows, low + static_cast<int>(shares.size()));
    const float* const of_column = image.data() + static_cast<std::size_t>(frame) * frame_size_ +
                                   static_cast<std::size_t>(i) * light_lanes_;
    double light = 0;
    for (int r = std::max(0, low); r < end; ++r) {
      light += double{of_column[r]} * shares[static_cast<std::size_t>(r - low)];
    }
    return light;
  }

  /// Light of a column of the image of a steady axis, mW/cm², by these shares of its rows from `first`.
  double light_of_rows(int frame, int stage, int column, int first,
                       std::span<const float> shares) const {
    const TomoGrid& g = bench_.grid;
    const FramePlaces& places = bench_.places;
    const int m = frame == kBlackFrame ? stage : frame;
    const auto [i, low] = moved(m, stage, column, first);
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

  const Judged judged_;
  const TomoJob& job_;
  const Bench& bench_;
  const Schedule& schedule_;
  const LitRuns runs_;
  RisingShade rising_;
  RaySources sources_;
  int directions_ = 1;         ///< of a step
  std::vector<double> turns_;  ///< [ray][column], rad
  bool wobbles_ = false;
  std::size_t light_lanes_ = 0, frame_size_ = 0;
  /// By terms of the light: that of all frames, and of black, as light lies; sharp light of frames that
  /// follow an axis is read from levels.
  std::vector<Array<float>> images_;
};

}  // namespace

std::unique_ptr<DirectSum> make_ray_sum(const Judged& judged, const ExecutionContext& context) {
  return std::make_unique<RaySum>(judged, context);
}

}  // namespace slicecorr::tomo::detail
