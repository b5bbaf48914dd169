// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/projector.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <string>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "tomo/operators/axis_projector.hpp"
#include "tomo/operators/beam_kernels.hpp"
#include "tomo/operators/frame_kernels.hpp"
#include "tomo/operators/slice_kernels.hpp"

namespace slicecorr::tomo {
namespace {

using detail::ParallelBeam;
using slicecorr::detail::silent;

/// e^(alpha u) must stay a single-precision number; light that has to pass so much resin is gone.
constexpr double kMostAlphaRadius = 40;

void refuse(const std::string& place, const std::string& message) {
  throw InputError("optics", place, message);
}

void check_table(const char* name, const std::vector<double>& table, int pixels) {
  if (table.empty()) return;
  if (table.size() != static_cast<std::size_t>(pixels)) {
    refuse(name, "must have one number per pixel, " + std::to_string(pixels) + ", has " +
                     std::to_string(table.size()));
  }
  for (std::size_t i = 0; i < table.size(); ++i) {
    if (!std::isfinite(table[i])) refuse(name, "pixel " + std::to_string(i) + " is not a number");
  }
}

void check_optics(const TomoGrid& grid, const RayTables& optics) {
  const double depth = optics.alpha_per_mm * grid.radius_mm;
  if (!(optics.alpha_per_mm >= 0)) refuse("alpha_per_mm", "must be 0 or more");
  if (!(depth <= kMostAlphaRadius)) {
    refuse("alpha_per_mm", "no light reaches the axis: alpha R is " + std::to_string(depth) +
                               ", at most " + std::to_string(kMostAlphaRadius) +
                               " is computed; use less absorber");
  }
  check_table("weight", optics.weight, grid.pixels);
  check_table("turn_rad", optics.turn_rad, grid.pixels);
  check_table("line_mm", optics.line_mm, grid.pixels);
  for (const double w : optics.weight) {
    if (w < 0) refuse("weight", "must be 0 or more");
  }
  for (std::size_t i = 1; i < optics.line_mm.size(); ++i) {
    if (!(optics.line_mm[i] > optics.line_mm[i - 1])) {
      refuse("line_mm", "must rise from pixel to pixel, does not at " + std::to_string(i));
    }
  }
}

class BeamProjector final : public Projector {
 public:
  /// `at_axis`: light is given at the plane of the axis, and alpha may be negative.
  BeamProjector(const TomoGrid& grid, const RayTables& optics, std::shared_ptr<const Shadow> shadow,
                bool at_axis = false)
      : shadow_(std::move(shadow)) {
    grid.check();
    if (!at_axis) check_optics(grid, optics);
    if (shadow_ != nullptr && !(shadow_->grid == grid)) {
      throw InputError("insert", "", "its shadow must have the grid of the part");
    }
    make_beam(grid, optics);
    make_columns(grid, optics, at_axis);
    beam_.slice = detail::make_slice_tables(beam_);
  }

  Shape shape() const override { return beam_.grid.shape(); }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    auto part = std::make_unique<BeamProjector>(*this);
    part->beam_.grid.slices = static_cast<int>(slices.size());
    part->beam_.slice = detail::make_slice_tables(part->beam_);
    if (shadow_ == nullptr) return part;
    const TomoGrid& to = part->beam_.grid;
    auto shadow =
        std::make_shared<Shadow>(Shadow{to, Array<float>(to.blocks() * to.light_of_block())});
    for (int m = 0; m < to.angles; ++m) {
      for (int i = 0; i < to.pixels; ++i) {
        for (int z = 0; z < to.slices; ++z) {
          shadow->hit_mm[to.pixel(m, i, z)] =
              shadow_->hit_mm[beam_.grid.pixel(m, i, slices[static_cast<std::size_t>(z)])];
        }
      }
    }
    part->shadow_ = std::move(shadow);
    return part;
  }

  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    if (!folded_ && !turned_ && !lines_) {
      detail::beam_forward(beam_, hit(block), field, light, quiet);
      weigh(light, quiet);
      return;
    }
    if (folded_ && !turned_ && !lines_) {
      detail::beam_forward(beam_, hit(block), field, light, quiet);
      unfold(light, quiet);
      return;
    }
    Array<float>& lines = scratch();
    lines.resize(beam_.grid.light_of_block());
    detail::beam_forward(beam_, hit(block), field, lines.data(), quiet);
    if (folded_) unfold(lines.data(), quiet);
    if (!folded_) weigh(lines.data(), quiet);
    turn_back(lines.data(), light);
  }

  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = worth(context);
    if (plain_entry_ && !folded_ && !turned_ && !lines_) {
      detail::beam_adjoint(beam_, hit(block), light, field, quiet);
      return;
    }
    Array<float>& lines = scratch();
    lines.resize(beam_.grid.light_of_block());
    const bool turned = turned_ || lines_;
    if (turned) turn(light, lines.data());
    weigh_and_fold(turned ? lines.data() : light, lines.data(), quiet);
    detail::beam_adjoint(beam_, hit(block), lines.data(), field, quiet);
  }

 private:
  /// The context without callbacks, with as many threads as have a millisecond's work each: to start
  /// and end them takes a part of that.
  ExecutionContext worth(const ExecutionContext& context) const {
    ExecutionContext quiet = silent(context);
    const double work = static_cast<double>(beam_.grid.voxels_of_block()) * beam_.grid.angles / 5e6;
    quiet.threads = static_cast<int>(std::clamp(work, 1.0, 1.0 * thread_count(context)));
    return quiet;
  }
  std::size_t frame_size() const {
    return static_cast<std::size_t>(beam_.grid.pixels) * beam_.grid.lanes();
  }
  const float* hit(std::size_t block) const {
    return shadow_ == nullptr ? nullptr
                              : shadow_->hit_mm.data() + block * beam_.grid.light_of_block();
  }
  static Array<float>& scratch() {
    static thread_local Array<float> numbers;
    return numbers;
  }

  void make_beam(const TomoGrid& grid, const RayTables& optics) {
    beam_.grid = grid;
    beam_.shadow = shadow_ != nullptr;
    beam_.attenuated = optics.alpha_per_mm != 0;
    // Without attenuation or insert a line is the same from both ends.
    folded_ = !beam_.attenuated && shadow_ == nullptr && grid.angles % 2 == 0;
    const int n = grid.voxels, count = folded_ ? grid.angles / 2 : grid.angles;
    if (grid.angles % 4 == 0) beam_.turns = folded_ ? 2 : 4;
    const double step = grid.voxel_mm() / grid.pixel_mm;
    for (int y = 0; y < n; ++y) beam_.inside.push_back(grid.inside(y));
    const std::size_t numbers = static_cast<std::size_t>(count) * n;
    if (beam_.attenuated) {
      beam_.ex.resize(numbers);
      beam_.ey.resize(numbers);
    }
    if (shadow_ != nullptr) {
      beam_.ux.resize(numbers);
      beam_.uy.resize(numbers);
    }
    for (int m = 0; m < count; ++m) {
      const double c = std::cos(grid.angle_rad(m)), s = std::sin(grid.angle_rad(m));
      beam_.angles.push_back(
          {step * c, step * s, 0.5 * (grid.pixels - 1) - 0.5 * (n - 1) * step * (c + s)});
      for (int i = 0; i < n; ++i) {
        const std::size_t at = static_cast<std::size_t>(m) * n + i;
        const double x = grid.voxel_at_mm(i);
        if (beam_.attenuated) {
          beam_.ex[at] = static_cast<float>(std::exp(optics.alpha_per_mm * x * s));
          beam_.ey[at] = static_cast<float>(std::exp(-optics.alpha_per_mm * x * c));
        }
        if (shadow_ != nullptr) {
          beam_.ux[at] = static_cast<float>(-x * s);
          beam_.uy[at] = static_cast<float>(x * c);
        }
      }
    }
  }

  void make_columns(const TomoGrid& grid, const RayTables& optics, bool at_axis) {
    const int pixels = grid.pixels;
    const double radius = grid.radius_mm;
    entry_.resize(pixels);
    for (int i = 0; i < pixels; ++i) {
      const double t = grid.pixel_at_mm(i);
      const double chord = std::sqrt(std::max(0.0, radius * radius - t * t));
      entry_[i] = at_axis ? 1 : static_cast<float>(std::exp(-optics.alpha_per_mm * chord));
    }
    turned_ = !optics.turn_rad.empty();
    lines_ = !optics.line_mm.empty();
    if (!lines_ && !optics.weight.empty()) {
      for (int i = 0; i < pixels; ++i) {
        entry_[i] = static_cast<float>(entry_[i] * optics.weight[i]);
      }
    }
    plain_entry_ = std::all_of(entry_.begin(), entry_.end(), [](float e) { return e == 1; });
    sources_.resize(pixels);
    const double step = 2 * std::numbers::pi / grid.angles;
    for (int i = 0; i < pixels; ++i) {
      // The one or two columns of pixels whose rays run beside this line.
      int column = i;
      double share = 0;
      bool dark = false;
      if (lines_) {
        const double t = grid.pixel_at_mm(i);
        const auto& lines = optics.line_mm;
        const auto above = std::upper_bound(lines.begin(), lines.end(), t);
        dark = above == lines.begin() || t > lines.back();
        column = std::clamp(static_cast<int>(above - lines.begin()) - 1, 0, pixels - 2);
        share = (t - lines[column]) / (lines[column + 1] - lines[column]);
      }
      if (dark) continue;
      for (const int k : {0, 1}) {
        const double part = k == 0 ? 1 - share : share;
        if (part == 0) continue;
        const double weight =
            lines_ && !optics.weight.empty() ? part * optics.weight[column + k] : part;
        const double back = turned_ ? -optics.turn_rad[column + k] / step : 0;
        const double whole = std::floor(back);
        Source& source = sources_[i];
        for (const int later : {0, 1}) {
          const double w = weight * (later == 0 ? 1 - (back - whole) : back - whole);
          if (w == 0) continue;
          int shift = static_cast<int>(std::fmod(whole + later, grid.angles));
          if (shift < 0) shift += grid.angles;
          source.term[source.terms++] = {column + k, shift, static_cast<float>(w)};
        }
      }
    }
  }

  /// Light along the lines, of the light that pixels show.
  void turn(const float* light, float* lines) const {
    const TomoGrid& grid = beam_.grid;
    const std::size_t lanes = grid.lanes();
    if (!turned_ && !lines_) {
      std::copy_n(light, grid.light_of_block(), lines);
      return;
    }
    for (int m = 0; m < grid.angles; ++m) {
      for (int i = 0; i < grid.pixels; ++i) {
        float* to = lines + (static_cast<std::size_t>(m) * grid.pixels + i) * lanes;
        std::fill_n(to, lanes, 0.0f);
        for (int k = 0; k < sources_[i].terms; ++k) {
          const Term& term = sources_[i].term[k];
          const float* from = light + pixel_of(m, term) * lanes;
          for (std::size_t l = 0; l < lanes; ++l) to[l] += term.weight * from[l];
        }
      }
    }
  }

  /// The transpose of `turn`.
  void turn_back(const float* lines, float* light) const {
    const TomoGrid& grid = beam_.grid;
    const std::size_t lanes = grid.lanes();
    if (!turned_ && !lines_) {
      std::copy_n(lines, grid.light_of_block(), light);
      return;
    }
    std::fill_n(light, grid.light_of_block(), 0.0f);
    for (int m = 0; m < grid.angles; ++m) {
      for (int i = 0; i < grid.pixels; ++i) {
        const float* from = lines + (static_cast<std::size_t>(m) * grid.pixels + i) * lanes;
        for (int k = 0; k < sources_[i].terms; ++k) {
          const Term& term = sources_[i].term[k];
          float* to = light + pixel_of(m, term) * lanes;
          for (std::size_t l = 0; l < lanes; ++l) to[l] += term.weight * from[l];
        }
      }
    }
  }

  void each_angle(int count, const ExecutionContext& context,
                  const std::function<void(int)>& use) const {
    constexpr int kAtOnce = 16;
    parallel_for(context, "", static_cast<std::size_t>((count + kAtOnce - 1) / kAtOnce),
                 [&](std::size_t piece) {
                   const int first = static_cast<int>(piece) * kAtOnce;
                   for (int m = first; m < std::min(first + kAtOnce, count); ++m) use(m);
                 });
  }

  void weigh(float* lines, const ExecutionContext& context) const {
    if (plain_entry_) return;
    const int lanes = beam_.grid.lanes();
    each_angle(beam_.grid.angles, context, [&](int m) {
      detail::weigh_frame(lines + m * frame_size(), entry_.data(), beam_.grid.pixels, lanes,
                          lines + m * frame_size());
    });
  }

  /// Light by its weights; of folded angles, with the light of the other direction added, in which
  /// pixels are in reverse. In place where both are the same.
  void weigh_and_fold(const float* light, float* lines, const ExecutionContext& context) const {
    const TomoGrid& grid = beam_.grid;
    if (!folded_) {
      each_angle(grid.angles, context, [&](int m) {
        detail::weigh_frame(light + m * frame_size(), entry_.data(), grid.pixels, grid.lanes(),
                            lines + m * frame_size());
      });
      return;
    }
    const int half = grid.angles / 2;
    each_angle(half, context, [&](int m) {
      detail::fold_frames(light + m * frame_size(), light + (m + half) * frame_size(),
                          entry_.data(), grid.pixels, grid.lanes(), lines + m * frame_size());
    });
  }

  /// Copies the first half of the angles to the other directions, and weighs both.
  void unfold(float* lines, const ExecutionContext& context) const {
    const TomoGrid& grid = beam_.grid;
    const int half = grid.angles / 2;
    each_angle(half, context, [&](int m) {
      detail::unfold_frame(lines + m * frame_size(), entry_.data(), grid.pixels, grid.lanes(),
                           lines + (m + half) * frame_size());
    });
  }

  struct Term {
    int column = 0, shift = 0;  ///< of the pixel, and angles ahead
    float weight = 0;
  };
  struct Source {
    int terms = 0;
    Term term[4];
  };
  std::size_t pixel_of(int m, const Term& term) const {
    int angle = m + term.shift;
    if (angle >= beam_.grid.angles) angle -= beam_.grid.angles;
    return static_cast<std::size_t>(angle) * beam_.grid.pixels + term.column;
  }

  std::shared_ptr<const Shadow> shadow_;
  ParallelBeam beam_;
  bool folded_ = false, turned_ = false, lines_ = false, plain_entry_ = false;
  std::vector<float> entry_;
  std::vector<Source> sources_;
};

}  // namespace

Shadow cast_shadow(const Volume& insert) {
  const TomoGrid& grid = insert.grid;
  grid.check();
  Shadow shadow{grid, Array<float>(grid.blocks() * grid.light_of_block(),
                                   std::numeric_limits<float>::infinity())};
  const double centre = 0.5 * (grid.pixels - 1);
  for (int m = 0; m < grid.angles; ++m) {
    const double c = std::cos(grid.angle_rad(m)), s = std::sin(grid.angle_rad(m));
    // Half of the square's width as seen from here, and of its depth on the way through its middle.
    const double half = 0.5 * grid.voxel_mm() * (std::abs(c) + std::abs(s));
    const double deep = 0.5 * grid.voxel_mm() / std::max(std::abs(c), std::abs(s));
    for (int z = 0; z < grid.slices; ++z) {
      for (int y = 0; y < grid.voxels; ++y) {
        const TomoGrid::Range row = grid.inside(y);
        for (int x = row.first; x < row.end; ++x) {
          if (insert.coverage[grid.voxel(x, y, z)] == 0) continue;
          const double px = grid.voxel_at_mm(x), py = grid.voxel_at_mm(y);
          const double f = (px * c + py * s) / grid.pixel_mm + centre;
          const auto u = static_cast<float>(-px * s + py * c - deep);
          const double reach = half / grid.pixel_mm;
          const int nearest = static_cast<int>(std::lround(f));
          const int first = std::min(nearest, static_cast<int>(std::ceil(f - reach)));
          const int last = std::max(nearest, static_cast<int>(std::floor(f + reach)));
          for (int i = std::max(first, 0); i <= std::min(last, grid.pixels - 1); ++i) {
            float& hit = shadow.hit_mm[grid.pixel(m, i, z)];
            hit = std::min(hit, u);
          }
        }
      }
    }
  }
  return shadow;
}

std::unique_ptr<Projector> make_projector(const TomoGrid& grid, const RayTables& optics,
                                          std::shared_ptr<const Shadow> shadow) {
  return std::make_unique<BeamProjector>(grid, optics, std::move(shadow));
}

std::unique_ptr<Projector> detail::make_axis_projector(const TomoGrid& grid, double alpha_per_mm) {
  return std::make_unique<BeamProjector>(grid, RayTables{.alpha_per_mm = alpha_per_mm}, nullptr,
                                         true);
}

Light forward(const Projector& projector, const ExecutionContext& context, const Field& field) {
  Light light(field.grid);
  forward(projector, context, field.values, light.values);
  return light;
}

Field adjoint(const Projector& projector, const ExecutionContext& context, const Light& light) {
  Field field(light.grid);
  adjoint(projector, context, light.values, field.values);
  return field;
}

}  // namespace slicecorr::tomo
