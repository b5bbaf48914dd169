// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What slices give the nodes above them where light of each distance spreads by a kernel of its own: in a
/// resin that scatters, of any exponent m, and in a bath that ends.
///
/// Light I of slice n is spread before it counts, so that a slice at a distance of j gives node n - j
///
///     g a^j (G_j I)^m
///
/// which is no sum over pixels and does not follow from slice to slice. Distances share a kernel
/// (`distance_blurs`), and those from f to t - 1 follow from node to node among themselves:
///
///     A(k) = a A(k + 1) + g a^f F(k + f) - g a^t F(k + t),   F = (G I)^m
///
/// Images are kept as they are shown, once where slices show the same, and spread anew only around what
/// changes. Each pixel is the same sum in the same order whatever the window.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "cure/distance_blurs.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr::detail {

/// For one thread at a time.
class DistanceSums {
 public:
  using Image = std::vector<std::uint8_t>;
  /// An image over `Scene::images`, and its share of the slice's dose.
  struct Lit {
    std::shared_ptr<const Image> image;
    double weight = 1;
  };
  struct Scene {
    PixelBox window{};   ///< whose doses are asked for
    PixelBox images{};   ///< what images cover
    PixelBox display{};  ///< beyond it it is dark
    double a = 0;        ///< what a slice leaves of a dose
    double m = 1;        ///< exponent of light
    double gain = 0;     ///< g: what the light of a slice adds to the dose at its node
    /// Writes what the pixels of a box of the display shine, in what is spread; null: a black image.
    std::function<void(const Image* image, const PixelBox& box, double* light)> shine{};
  };
  /// `blurs` must outlive this.
  DistanceSums(const std::vector<DistanceBlur>& blurs, Scene scene);

  /// The slice before the one that was added last, the last slice first; empty: it is dark.
  void add(std::vector<Lit> lit);
  /// To be called once before each `add`: what the slices that were added have left of doses at the
  /// end of the slice that is added next, before it takes its share a of that. Over the window.
  const std::vector<double>& next();

 private:
  /// (G I)^m of an image over the window.
  struct Spread {
    std::shared_ptr<const Image> image{};
    std::shared_ptr<const std::vector<double>> light{};
  };
  using Field = std::shared_ptr<const std::vector<double>>;
  struct Distance {
    const DistanceBlur* of;
    Spread come, gone;  ///< spread last
    /// Of few slices: the light of each, which need not be spread again when it goes.
    std::deque<std::vector<std::pair<Field, double>>> kept;
    std::vector<double> sum;
  };
  const std::vector<Lit>* shown(int slices) const;
  void come(Distance& distance);
  void go(Distance& distance);
  const Field& spread(const DistanceBlur& of, Spread& spread,
                      const std::shared_ptr<const Image>& image);
  PixelBox changed(const Spread& spread, const Image* image) const;

  Scene scene_;
  std::vector<Distance> distances_;  ///< without the own
  std::size_t longest_ = 0;          ///< slices that are remembered
  std::deque<std::vector<Lit>> shown_;
  std::vector<double> left_, in_, out_;
};

}  // namespace slicecorr::detail
