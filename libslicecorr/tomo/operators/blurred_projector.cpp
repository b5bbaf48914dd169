// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/blurred_projector.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "base/kernels.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/turbidity.hpp"
#include "tomo/operators/measured_blur.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Narrowest resolved variance of scatter, in voxels squared: below it Gaussians are mixed with sharp
/// light.
constexpr double kLeastScatter = 0.36;

double below(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

/// Numbers of this variance at whole pixels.
std::vector<float> numbers_of(double variance) {
  if (variance < 1e-9) return {1};
  if (variance < 0.3) {
    return {static_cast<float>(1 - variance), static_cast<float>(variance / 2)};
  }
  // Sums over pixels are wider by a pixel's own box.
  const double sigma = std::sqrt(variance - kBox);
  const int reach = static_cast<int>(std::ceil(kSpreadReachSigmas * sigma + 0.5));
  std::vector<double> all;
  all.reserve(static_cast<std::size_t>(reach) + 1);
  double sum = 0;
  for (int k = 0; k <= reach; ++k) {
    all.push_back(below((k + 0.5) / sigma) - below((k - 0.5) / sigma));
    sum += k == 0 ? all.back() : 2 * all.back();
  }
  std::vector<float> numbers(all.size());
  std::transform(all.begin(), all.end(), numbers.begin(),
                 [&](double v) { return static_cast<float>(v / sum); });
  return numbers;
}

/// What of a variance boxes hold.
double in_boxes(double variance) {
  return variance < kBox ? variance : variance < 2 * kBox ? kBox : 2 * kBox;
}

/// Numbers of a blur along an axis, of light from k pixels on.
struct Taps {
  const std::vector<float>& numbers;
  bool even = true, back = false;
  int reach = even ? static_cast<int>(numbers.size()) - 1 : static_cast<int>(numbers.size()) / 2;
  float at(int k) const {
    // Light that goes k pixels on comes from there.
    const int i = even ? std::abs(k) : reach + (back ? k : -k);
    return numbers[static_cast<std::size_t>(i)];
  }
};

/// to[i] += sum over k of taps[k] from[i + k], of `rows` numbers; light beyond them is dark.
SLICECORR_CLONES
void add_row(const Taps& taps, int rows, const float* from, float* to) {
  for (int k = -taps.reach; k <= taps.reach; ++k) {
    const float number = taps.at(k);
    const int first = std::max(0, -k), end = std::min(rows, rows - k);
    for (int r = first; r < end; ++r) to[r] += number * from[r + k];
  }
}
SLICECORR_CLONES
void add_times(float number, int rows, const float* from, float* to) {
  for (int r = 0; r < rows; ++r) to[r] += number * from[r];
}

/// Variances that scatter has at the depths of hats: none, then twice as much from one to the next.
std::vector<double> variances_mm2(const Resin& resin, const BlurPlaces& places) {
  std::vector<double> all{0};
  const double per_mm = resin.scatter_um2_per_um * 1e-3, most = per_mm * places.most_way_mm;
  if (!(most > 0)) return all;
  // The first hat is at least an eighth of the way wide, as maps of rays tell no finer ones.
  double next = std::max(kLeastScatter * places.voxel_mm * places.voxel_mm, most / 8);
  for (; all.back() < most; next *= 2) all.push_back(std::min(next, most));
  return all;
}

/// What of the light goes sideways by a variance, and at which depth.
struct ScatteredLight {
  double variance_mm2 = 0;
  DepthShare depth;
};

/// Of light that a turbid resin scatters: Gaussians from kLeastSigmaMm on, each twice as wide, the last one as
/// wide as the resin, which stands for all that leave it.
constexpr double kLeastSigmaMm = 0.03;
std::vector<ScatteredLight> turbid_light(const Resin& resin, const BlurPlaces& places) {
  constexpr int kSteps = 48;
  const double reach = turbid_reach(resin.turbidity, places.most_way_mm);
  if (reach > kMostTurbidity) {
    throw InputError(
        resin.name, "extinction_per_cm",
        fmt::format(
            "(1 - g) tau is {:.3g} over the {:.3g} mm through the resin; expected {:g} at most: "
            "light that is scattered more often is no beam any more, and not counted",
            reach, places.most_way_mm, kMostTurbidity));
  }
  std::vector<double> sigmas{0};
  for (double s = kLeastSigmaMm; sigmas.back() < places.most_way_mm; s *= 2) sigmas.push_back(s);
  std::vector<std::vector<float>> shares(sigmas.size());
  const double step_mm = places.most_way_mm / kSteps;
  for (int k = 0; k <= kSteps; ++k) {
    const std::vector<double> at = turbid_shares(resin.turbidity, step_mm * k, sigmas);
    for (std::size_t i = 0; i < at.size(); ++i) shares[i].push_back(static_cast<float>(at[i]));
  }
  std::vector<ScatteredLight> all;
  for (std::size_t i = 0; i < sigmas.size(); ++i) {
    ScatteredLight light{sigmas[i] * sigmas[i], {}};
    light.depth.table = std::make_shared<const std::vector<float>>(std::move(shares[i]));
    light.depth.step_mm = step_mm;
    all.push_back(std::move(light));
  }
  return all;
}

/// Of all light, by the resin: hats over the variances of a Gaussian that grows, or what kicks leave.
std::vector<ScatteredLight> scattered_light(const Resin& resin, const BlurPlaces& places) {
  if (resin.turbidity.scatters()) return turbid_light(resin, places);
  const std::vector<double> variances = variances_mm2(resin, places);
  const double per_mm = resin.scatter_um2_per_um * 1e-3;
  std::vector<ScatteredLight> all;
  for (std::size_t i = 0; i < variances.size(); ++i) {
    ScatteredLight light{variances[i], {}};
    if (i > 0) light.depth.from_mm = variances[i - 1] / per_mm;
    if (i + 1 < variances.size()) light.depth.to_mm = variances[i + 1] / per_mm;
    if (i > 0) light.depth.peak_mm = variances[i] / per_mm;
    all.push_back(std::move(light));
  }
  return all;
}

class BlurredProjector final : public Projector {
 public:
  BlurredProjector(const TomoGrid& grid, std::vector<BlurredTerm> terms)
      : grid_(grid), terms_(std::move(terms)) {}

  Shape shape() const override { return grid_.shape(); }

  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    const std::size_t cells = grid_.voxels_of_block();
    std::fill_n(field, cells, 0.0F);
    Array<float> blurred(grid_.light_of_block()), of_term(cells);
    for (const auto& [blur, projector] : terms_) {
      const float* from = light;
      if (!blur.none()) {
        std::fill(blurred.begin(), blurred.end(), 0.0F);
        add_frames(blur, light, blurred.data(), false, context);
        from = blurred.data();
      }
      projector->adjoint(block, from, of_term.data(), context);
      for (std::size_t i = 0; i < cells; ++i) field[i] += of_term[i];
    }
  }

  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    const std::size_t pixels = grid_.light_of_block();
    std::fill_n(light, pixels, 0.0F);
    Array<float> of_term(pixels);
    for (const auto& [blur, projector] : terms_) {
      projector->forward(block, field, of_term.data(), context);
      if (blur.none()) {
        for (std::size_t i = 0; i < pixels; ++i) light[i] += of_term[i];
      } else {
        add_frames(blur, of_term.data(), light, true, context);
      }
    }
  }

 private:
  void add_frames(const ImageBlur& blur, const float* from, float* to, bool back,
                  const ExecutionContext& context) const {
    const auto lanes = static_cast<std::size_t>(grid_.light_lanes());
    const FrameShape frame{grid_.pixels, grid_.rows, lanes};
    const std::size_t size = static_cast<std::size_t>(grid_.pixels) * lanes;
    parallel_for(slicecorr::detail::silent(context), "", static_cast<std::size_t>(grid_.angles),
                 [&](std::size_t m) {
                   (back ? add_blurred_back : add_blurred)(blur, frame, from + m * size,
                                                           to + m * size);
                 });
  }

  TomoGrid grid_;
  std::vector<BlurredTerm> terms_;
};

}  // namespace

bool light_goes_sideways(const Printer& printer, const Resin& resin) {
  return !printer.spread.none() || resin.scatter_um2_per_um > 0 || resin.turbidity.scatters();
}

std::vector<BlurredLight> blurred_light(const Printer& printer, const Resin& resin,
                                        const BlurPlaces& places) {
  const PixelProfile across{places.wide == 1 ? std::sqrt(printer.fill_factor) : 1, 0},
      up{places.high == 1 ? std::sqrt(printer.fill_factor) : 1, 0};
  std::optional<MeasuredBlur> measured;
  if (printer.spread.picture) {
    measured = measured_blur(*printer.spread.picture, 1e-3 * printer.pixel_x_um * places.wide,
                             1e-3 * printer.pixel_y_um * places.high);
  }
  std::vector<SpreadGaussian> gaussians = printer.spread.gaussians;
  if (gaussians.empty()) gaussians.push_back({0, 1});
  double weights = 0;
  for (const SpreadGaussian& g : gaussians) weights += g.weight;
  std::vector<BlurredLight> terms;
  for (const auto& [variance_mm2, its_depth] : scattered_light(resin, places)) {
    const auto& depth = its_depth;  // lambdas take no bindings
    for (const SpreadGaussian& g : gaussians) {
      const auto square = [](double v) { return v * v; };
      const double columns = square(g.sigma_um / (printer.pixel_x_um * places.wide)) +
                             variance_mm2 * square(places.columns_per_mm) +
                             (measured ? measured->columns_left : 0),
                   rows = square(g.sigma_um / (printer.pixel_y_um * places.high)) +
                          variance_mm2 * square(places.rows_per_mm) +
                          (measured ? measured->rows_left : 0);
      BlurredLight one{across, up, depth, {}};
      one.across.soft = std::sqrt(in_boxes(columns) / kBox);
      one.up.soft = std::sqrt(in_boxes(rows) / kBox);
      // Gaussians that are as soft are one sum.
      const auto same = std::find_if(terms.begin(), terms.end(), [&](const BlurredLight& t) {
        return t.depth.peak_mm == depth.peak_mm && t.depth.table == depth.table &&
               t.across.soft == one.across.soft && t.up.soft == one.up.soft;
      });
      BlurredLight& term = same == terms.end() ? terms.emplace_back(std::move(one)) : *same;
      ImageBlur::Gaussian sum{g.weight / weights, numbers_of(columns - in_boxes(columns)),
                              numbers_of(rows - in_boxes(rows))};
      if (measured) {
        for (const auto& [along, up_along] : measured->products) {
          term.blur.sum.push_back(
              {1, widened(along, sum.columns), widened(up_along, sum.rows), false});
        }
      } else {
        term.blur.sum.push_back(std::move(sum));
      }
    }
  }
  for (BlurredLight& term : terms) {
    const ImageBlur::Gaussian& first = term.blur.sum.front();
    if (term.blur.sum.size() == 1 && first.even && first.weight == 1 && first.columns.size() == 1 &&
        first.rows.size() == 1) {
      term.blur.sum.clear();
    }
  }
  return terms;
}

SpreadReach reach_of_spread(const Printer& printer) {
  double most_um = 0;
  if (const auto& picture = printer.spread.picture) {
    most_um = 0.5 * picture->pitch_um * std::max(picture->width_px, picture->height_px);
  }
  for (const SpreadGaussian& g : printer.spread.gaussians) {
    if (g.weight > 0) most_um = std::max(most_um, kSpreadReachSigmas * g.sigma_um);
  }
  if (!(most_um > 0)) return {};
  return {static_cast<int>(std::ceil(most_um / printer.pixel_x_um)) + 1,
          static_cast<int>(std::ceil(most_um / printer.pixel_y_um)) + 1};
}

namespace {

void add_blurred_either(const ImageBlur& blur, const FrameShape& frame, bool back,
                        const float* from, float* to) {
  static thread_local Array<float> rows;
  rows.resize(static_cast<std::size_t>(frame.columns) * static_cast<std::size_t>(frame.rows));
  const auto of = [&](int c) { return static_cast<std::size_t>(c) * frame.pitch; };
  const auto row = [&](int c) {
    return rows.data() + static_cast<std::size_t>(c) * static_cast<std::size_t>(frame.rows);
  };
  for (const ImageBlur::Gaussian& g : blur.sum) {
    std::fill(rows.begin(), rows.end(), 0.0F);
    for (int c = 0; c < frame.columns; ++c) {
      add_row({g.rows, g.even, back}, frame.rows, from + of(c), row(c));
    }
    const Taps columns{g.columns, g.even, back};
    const int reach = columns.reach;
    for (int c = 0; c < frame.columns; ++c) {
      const int first = std::max(-reach, -c), last = std::min(reach, frame.columns - 1 - c);
      for (int k = first; k <= last; ++k) {
        const float number = static_cast<float>(g.weight) * columns.at(k);
        add_times(number, frame.rows, row(c + k), to + of(c));
      }
    }
  }
}

}  // namespace

void add_blurred(const ImageBlur& blur, const FrameShape& frame, const float* from, float* to) {
  add_blurred_either(blur, frame, false, from, to);
}
void add_blurred_back(const ImageBlur& blur, const FrameShape& frame, const float* from,
                      float* to) {
  add_blurred_either(blur, frame, true, from, to);
}

std::unique_ptr<Projector> make_blurred_projector(const TomoGrid& grid,
                                                  std::vector<BlurredTerm> terms) {
  return std::make_unique<BlurredProjector>(grid, std::move(terms));
}

}  // namespace slicecorr::tomo::detail
