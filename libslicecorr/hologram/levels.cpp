// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"
#include "stack/png/png.hpp"

namespace slicecorr {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// The level whose phase is nearest to a share of a turn.
class NearestLevel {
 public:
  explicit NearestLevel(const PhaseDisplay& display) : stroke_(display.stroke_turns.value_or(1)) {
    for (int k = 0; k < display.levels; ++k) {
      grey_.push_back(static_cast<std::uint8_t>(256 * k / display.levels));
      turns_.push_back(stroke_ * grey_.back() / 256);
    }
  }

  std::uint8_t of(double turns) const {
    const auto levels = static_cast<std::ptrdiff_t>(grey_.size());
    std::ptrdiff_t best = 0;
    double least = away(turns, 0);
    const auto look = [&](std::ptrdiff_t k) {
      if (k < 0 || k >= levels) return;
      const double d = away(turns, k);
      if (d < least - 1e-12) {
        least = d;
        best = k;
      }
    };
    // A stroke of more than a turn shows a phase more than once, a shorter one maybe only by its
    // last level.
    for (double whole = 0; whole <= stroke_; ++whole) {
      const auto near =
          static_cast<std::ptrdiff_t>((turns + whole) / stroke_ * static_cast<double>(levels));
      for (std::ptrdiff_t k = near - 1; k <= near + 2; ++k) look(k);
    }
    look(levels - 1);
    return grey_[static_cast<std::size_t>(best)];
  }

 private:
  double away(double turns, std::ptrdiff_t k) const {
    const double d = turns - turns_[static_cast<std::size_t>(k)];
    return std::abs(d - std::round(d));
  }
  double stroke_;
  std::vector<std::uint8_t> grey_;
  std::vector<double> turns_;
};

}  // namespace

GreyImage grey_of_phase(const PhaseDisplay& display, const std::vector<float>& phase_rad) {
  const NearestLevel nearest(display);
  GreyImage image{display.width_px, display.height_px, {}};
  image.pixels.reserve(phase_rad.size());
  for (const float s : phase_rad) {
    const double turns = s / kTurn;
    image.pixels.push_back(nearest.of(turns - std::floor(turns)));
  }
  return image;
}

std::vector<float> phase_of_grey(const PhaseDisplay& display, const GreyImage& shown) {
  std::vector<float> phase;
  phase.reserve(shown.pixels.size());
  const double turns = display.stroke_turns.value_or(1);
  for (const std::uint8_t g : shown.pixels) {
    phase.push_back(static_cast<float>(kTurn * turns * g / 256));
  }
  return phase;
}

std::vector<std::uint8_t> encode_phase_png(const GreyImage& shown, const std::string& made) {
  const std::vector<std::uint8_t> plain = encode_png(shown);
  // Between the header, which comes first and has one size, and the image.
  constexpr std::ptrdiff_t kHeaderEnd = 8 + 25;
  std::vector<std::uint8_t> png(plain.begin(), plain.begin() + kHeaderEnd);
  const std::size_t start = detail::begin_chunk("tEXt", png);
  for (const char c : "Comment") png.push_back(static_cast<std::uint8_t>(c));  // with its 0
  png.insert(png.end(), made.begin(), made.end());
  detail::end_chunk(start, png);
  png.insert(png.end(), plain.begin() + kHeaderEnd, plain.end());
  return png;
}

}  // namespace slicecorr
