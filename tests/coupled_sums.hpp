// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Small designs whose columns are corrected together, and doses that are summed here, pixel by pixel.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <vector>

#include "correct/coupled.hpp"
#include "cure/distance_blurs.hpp"
#include "models.hpp"

namespace slicecorr::test::together {

using detail::CoupledCorrection;
using detail::CoupledOptions;
using detail::DistanceBlur;
using detail::LightBlur;

inline constexpr double kPixelUm = 50, kLayerUm = 50;

/// Voxels of a small design, layer by layer, row by row.
struct Design {
  int width, height, layers;
  std::vector<std::uint8_t> coverage;
  Design(int w, int h, int n)
      : width(w), height(h), layers(n), coverage(static_cast<std::size_t>(w * h * n), 0) {}
  std::size_t at(int x, int y, int n) const {
    return static_cast<std::size_t>((n * height + y) * width + x);
  }
  void fill(const PixelBox& box, int first, int past, std::uint8_t value) {
    for (int n = first; n < past; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) coverage[at(x, y, n)] = value;
      }
    }
  }
  /// Shown as it is: a support.
  std::vector<std::uint8_t> left_alone;
  void leave_alone(const PixelBox& box, int first, int past, std::uint8_t pixel) {
    left_alone.resize(coverage.size(), 0);
    for (int n = first; n < past; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) {
          coverage[at(x, y, n)] = 0;
          left_alone[at(x, y, n)] = pixel;
        }
      }
    }
  }
  std::uint8_t left(int x, int y, int n) const {
    return !left_alone.empty() && n < layers && x >= 0 && y >= 0 && x < width && y < height
               ? left_alone[at(x, y, n)]
               : 0;
  }
  std::uint8_t of(int x, int y, int n) const {
    return n < layers && x >= 0 && y >= 0 && x < width && y < height ? coverage[at(x, y, n)] : 0;
  }
};

struct Setting {
  double sigma_px = 0.8, kappa = 0, margin = 0;
  int rounds = 8, threads = 2, patch_px = 32;
  /// Pixels of the display around the design.
  int border = 0;
  /// Light falls to this share along x; 1: even.
  double uneven = 1;
  double share_at(int x) const { return 1 - (1 - uneven) * std::clamp(x / 40.0, 0.0, 1.0); }
  bool hand_on = true;
};

inline LightSpread spread_of(double sigma_px) { return {{{sigma_px * kPixelUm, 1}}, std::nullopt}; }

inline CorrectionPlan plan_of(const Design& design, const CureModel& model) {
  const int last = design.layers - 1;
  return {model, process(1000), design.layers, slices_with_burst(model, design.layers, last)};
}

inline CoupledCorrection::DesignReader reader_of(const Design& design) {
  return [&design](const PixelBox& box, const CoupledCorrection::LayerSink& sink) {
    std::vector<std::uint8_t> rows, left;
    for (int n = 0; n < design.layers; ++n) {
      rows.clear();
      left.clear();
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) {
          rows.push_back(design.of(x, y, n));
          left.push_back(design.left(x, y, n));
        }
      }
      sink(n, rows.data(), nullptr, design.left_alone.empty() ? nullptr : left.data());
    }
  };
}

/// How light spreads on its way; empty: it does not scatter.
inline std::vector<DistanceBlur> distances_of(const CureModel& model, const LightSpread& spread,
                                              double kappa) {
  return detail::distance_blurs(spread,
                                {.um2_per_um = kappa,
                                 .height_e_um = kLayerUm / (model.eta * std::log(10.0)),
                                 .slice_um = kLayerUm,
                                 .pixel_x_um = kPixelUm,
                                 .pixel_y_um = kPixelUm},
                                0);
}
inline std::vector<DistanceBlur> distances_of(const CureModel& model, const Setting& setting) {
  return distances_of(model, spread_of(setting.sigma_px), setting.kappa);
}

inline CoupledOptions options_of(const Setting& setting,
                                 const std::vector<DistanceBlur>& distances) {
  CoupledOptions options{setting.rounds, setting.margin, setting.patch_px, {}, setting.hand_on};
  if (!distances.empty()) options.distances = &distances;
  if (setting.uneven == 1) return options;
  options.shares = [setting](const PixelBox& box, double* shares) {
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) *shares++ = setting.share_at(x);
    }
  };
  return options;
}

/// Each column with the light of its place.
inline detail::CodedBand columns_alone(const Design& design, const CorrectionPlan& plan,
                                       const Setting& setting, const PixelBox& box) {
  std::vector<std::vector<std::uint8_t>> columns;
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      CureModel model = plan.model;
      for (double& phi : model.level_phi) phi *= setting.share_at(x);
      std::vector<std::uint8_t> coverage;
      for (int n = 0; n < design.layers; ++n) coverage.push_back(design.of(x, y, n));
      columns.push_back(
          solve_column({model, process(1000), design.layers, plan.all_layers}, coverage));
    }
  }
  detail::CodedBand band(columns.size());
  std::vector<std::uint8_t> row(columns.size());
  for (int n = plan.all_layers; n-- > 0;) {
    for (std::size_t k = 0; k < row.size(); ++k) {
      row[k] = columns[k][static_cast<std::size_t>(n)];
    }
    band.append(row.data());
  }
  return band;
}

class Coupled {
 public:
  Coupled(const Design& design, const CorrectionPlan& plan, const Setting& setting)
      : distances_(distances_of(plan.model, setting)),
        blur_(distances_.empty() ? LightBlur(spread_of(setting.sigma_px), kPixelUm, kPixelUm)
                                 : distances_.front().blur),
        correction_(plan, blur_, {0, 0, design.width, design.height},
                    {-setting.border, -setting.border, design.width + setting.border,
                     design.height + setting.border},
                    options_of(setting, distances_)),
        slices_(plan.all_layers),
        size_(static_cast<std::size_t>(design.width * design.height)) {
    context_.threads = setting.threads;
    const auto alone = [&](const PixelBox& box) {
      return columns_alone(design, plan, setting, box);
    };
    correction_.solve_columns(reader_of(design), !design.left_alone.empty(), context_,
                              setting.uneven == 1 ? CoupledCorrection::ColumnLevels{} : alone);
  }
  CoupledCorrection* operator->() { return &correction_; }
  const ExecutionContext& context() const { return context_; }
  void run() {
    while (correction_.improve(context_)) {
    }
  }
  /// Levels, the first slice first.
  std::vector<std::uint8_t> levels(const Design& design) const {
    std::vector<std::uint8_t> all(size_ * static_cast<std::size_t>(slices_));
    correction_.read({0, 0, design.width, design.height}, [&](int n, const std::uint8_t* slice) {
      if (slice) {
        std::copy_n(slice, size_, all.data() + size_ * static_cast<std::size_t>(n));
      }
    });
    return all;
  }

 private:
  std::vector<DistanceBlur> distances_;
  LightBlur blur_;
  CoupledCorrection correction_;
  ExecutionContext context_;
  int slices_;
  std::size_t size_;
};

/// The share of a pixel's light that falls `x` pixels further, along one axis.
inline double share(int x, double sigma_px) {
  if (sigma_px <= 0) return x == 0 ? 1 : 0;
  const double scale = sigma_px * std::sqrt(2.0);
  return (std::erf((x + 0.5) / scale) - std::erf((x - 0.5) / scale)) / 2;
}

/// Slices over a display, `border` pixels wider than a design on each side.
class Images {
 public:
  Images(const Design& design, const CorrectionPlan& plan, const std::vector<std::uint8_t>& levels,
         const Setting& setting)
      : setting_(setting),
        width_(design.width + 2 * setting.border),
        height_(design.height + 2 * setting.border),
        m_(plan.model.m) {
    const int b = setting.border;
    for (int n = 0; n < plan.all_layers; ++n) {
      std::vector<double>& image = shine_.emplace_back();
      for (int y = 0; y < height_; ++y) {
        for (int x = 0; x < width_; ++x) {
          const bool inside = x >= b && y >= b && x < width_ - b && y < height_ - b;
          const auto i =
              static_cast<std::size_t>((n * design.height + y - b) * design.width + x - b);
          image.push_back(
              std::pow(plan.levels.phi(inside ? levels[i] : 0) * setting.share_at(x - b), 1 / m_));
        }
      }
    }
  }
  std::size_t size() const { return shine_.front().size(); }
  /// What slice `n` gives by the spread at the window alone.
  std::vector<double> light(int n) const {
    const int reach = static_cast<int>(std::ceil(6 * setting_.sigma_px)) + 1;
    const std::vector<double> across = summed(shine_[static_cast<std::size_t>(n)], reach, 1, 0);
    std::vector<double> light = summed(across, reach, 0, 1);
    for (double& v : light) v = std::pow(v, m_);
    return light;
  }
  /// What slice `n` gives by a kernel.
  std::vector<double> light(int n, const LightBlur& blur) const {
    const PixelBox box{0, 0, width_, height_};
    std::vector<double> light(size());
    blur.apply(shine_[static_cast<std::size_t>(n)].data(), box, light.data(), box);
    for (double& v : light) v = std::pow(v, m_);
    return light;
  }

 private:
  std::vector<double> summed(const std::vector<double>& in, int reach, int dx, int dy) const {
    std::vector<double> shares;
    for (int k = 0; k <= reach; ++k) shares.push_back(share(k, setting_.sigma_px));
    std::vector<double> out;
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        double& sum = out.emplace_back(0);
        for (int k = -reach; k <= reach; ++k) {
          const int i = x + k * dx, j = y + k * dy;
          if (i < 0 || j < 0 || i >= width_ || j >= height_) continue;
          sum += shares[static_cast<std::size_t>(std::abs(k))] *
                 in[static_cast<std::size_t>(j * width_ + i)];
        }
      }
    }
    return out;
  }

  Setting setting_;
  int width_, height_;
  double m_;
  std::vector<std::vector<double>> shine_;
};

/// Doses at nodes, by direct sums over all slices of what each gives from its distance.
inline std::vector<std::vector<double>> scattered_doses(
    const Images& images, const CorrectionPlan& plan, const std::vector<DistanceBlur>& distances) {
  const double a = std::pow(10, -plan.model.eta);
  std::vector<std::vector<double>> doses(static_cast<std::size_t>(plan.all_layers),
                                         std::vector<double>(images.size(), 0));
  for (int n = 0; n < plan.all_layers; ++n) {
    for (const DistanceBlur& d : distances) {
      const std::vector<double> light = images.light(n, d.blur);
      for (int j = d.from; j <= n && j < d.to; ++j) {
        std::vector<double>& dose = doses[static_cast<std::size_t>(n - j)];
        const double share = (1 - a) * std::pow(a, j);
        for (std::size_t i = 0; i < dose.size(); ++i) dose[i] += share * light[i];
      }
    }
  }
  return doses;
}

/// What is wrong in the design and around it, `border` pixels wide, by direct sums over the images.
struct Direct {
  std::uint64_t through = 0, under = 0, parted = 0;
  double loss = 0;
  std::vector<double> middle;  ///< of the layers, with the border
};
inline Direct judge(const Design& design, const CorrectionPlan& plan,
                    const std::vector<std::uint8_t>& levels, const Setting& setting) {
  const int b = setting.border, w = design.width + 2 * b, h = design.height + 2 * b;
  const double hs = plan.model.eta;
  const double a = std::pow(10, -hs), root_a = std::pow(10, -hs / 2);
  const bool layerwise = plan.model.mode == ExposureMode::layerwise;
  const Images images(design, plan, levels, setting);
  const std::vector<DistanceBlur> distances = distances_of(plan.model, setting);
  std::vector<std::vector<double>> scattered;
  if (!distances.empty()) scattered = scattered_doses(images, plan, distances);
  const std::size_t size = images.size();
  Direct direct;
  std::vector<double> light(size), dose(size, 0);
  direct.middle.resize(size * static_cast<std::size_t>(plan.all_layers));
  for (int n = plan.all_layers; n-- > 0;) {
    if (scattered.empty()) light = images.light(n);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const auto i = static_cast<std::size_t>(y * w + x);
        double next = scattered.empty() ? (1 - a) * light[i] + a * dose[i]
                                        : scattered[static_cast<std::size_t>(n)][i];
        double middle = (next + root_a * dose[i]) / (1 + root_a);
        if (layerwise) {
          // From inside the layer: what slice n and later ones leave at its window, on its way up.
          const double window = plan.model.ratio(n) * light[i] + dose[i];
          next = a * window;
          middle = root_a * window;
        }
        dose[i] = next;
        direct.middle[static_cast<std::size_t>(n) * size + i] = middle;
        const int cover = design.left(x - b, y - b, n) ? 128 : design.of(x - b, y - b, n);
        if (cover == 255 && middle < 1) ++direct.under;
        const bool holds = n == 0 || design.of(x - b, y - b, n - 1) == 255;
        direct.parted += layerwise && cover == 255 && holds && middle >= 1 && next < 1;
        if (cover == 255) direct.loss += std::pow(std::max(0.0, 1 - next), 2) / 2;
        if (cover == 0 && middle >= 1) {
          ++direct.through;
          direct.loss += std::pow(middle - 1, 2) / 2;
        }
      }
    }
  }
  return direct;
}

}  // namespace slicecorr::test::together
