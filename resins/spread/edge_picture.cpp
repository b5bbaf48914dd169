// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A straight edge in a camera's picture: where it lies, and what it shows by the distance from it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fit/least_squares.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/spread_fit.hpp"
#include "spread/model.hpp"

namespace slicecorr::resins {

namespace {

constexpr int kLeastSide = 16;
constexpr double kMostLeanDeg = 20;
/// Of a normal distribution over the median of its absolute values.
constexpr double kOfMedian = 1.4826;

/// A picture whose edge is upright, in shares of white.
struct Upright {
  int width = 0, height = 0;
  std::vector<float> light;
  double at(int x, int y) const {
    return light[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)];
  }
};

double mean_over(const Upright& p, int x0, int x1, int y0, int y1) {
  double sum = 0;
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) sum += p.at(x, y);
  }
  return sum / (static_cast<double>(x1 - x0) * (y1 - y0));
}

Upright upright(const CameraPicture& picture) {
  Upright p{picture.width_px, picture.height_px, {}};
  p.light.reserve(picture.pixels.size());
  for (const std::uint16_t v : picture.pixels) {
    p.light.push_back(static_cast<float>(v) / static_cast<float>(picture.white));
  }
  const int w = p.width, h = p.height;
  const double across = mean_over(p, w - w / 6, w, 0, h) - mean_over(p, 0, w / 6, 0, h);
  const double down = mean_over(p, 0, w, h - h / 6, h) - mean_over(p, 0, w, 0, h / 6);
  if (std::abs(across) >= std::abs(down)) return p;
  Upright turned{h, w, {}};
  for (int x = 0; x < w; ++x) {
    for (int y = 0; y < h; ++y) turned.light.push_back(static_cast<float>(p.at(x, y)));
  }
  return turned;
}

/// An upright edge, places in pixels.
struct Line {
  double low = 0, high = 1;
  double column = 0, lean = 0;  ///< where it is in the middle row, columns per row
  double sigma = 1;
  double distance(double x, double y) const {
    return (x - column - lean * y) / std::hypot(1, lean);
  }
};

/// Some of the pixels, spread over the picture, against a line.
class LineProblem : public LeastSquares {
 public:
  LineProblem(const Upright& p, double step) : p_(p), step_(step) {
    constexpr double most = 20000;
    const double all = static_cast<double>(p.light.size());
    const auto stride = static_cast<std::size_t>(std::max(1.0, std::ceil(all / most)));
    for (std::size_t i = 0; i < p.light.size(); i += stride) taken_.push_back(i);
  }
  static Line line_of(const double* v) { return {v[0], v[1], v[2], v[3], v[4]}; }
  std::size_t count() const override { return taken_.size(); }
  std::size_t unknowns() const override { return 5; }
  double step(std::size_t unknown, double) const override {
    return unknown < 2 ? 1e-4 * step_ : unknown == 3 ? 1e-4 / p_.height : 1e-4;
  }
  bool residuals(const double* values, double* out) const override {
    const Line l = line_of(values);
    if (!(l.sigma > 0.02)) return false;
    for (const std::size_t i : taken_) {
      const auto width = static_cast<std::size_t>(p_.width);
      const std::size_t column = i % width, row = i / width;
      const double t =
          l.distance(static_cast<double>(column), static_cast<double>(row) - 0.5 * (p_.height - 1));
      // Most pixels lie where an integral in doubles is 0 or 1 to 2e-19.
      const double at = t / l.sigma, share = at < -9 ? 0 : at > 9 ? 1 : normal_integral(at);
      *out++ = p_.light[i] - l.low - (l.high - l.low) * share;
    }
    return true;
  }

 private:
  const Upright& p_;
  double step_;
  std::vector<std::size_t> taken_;
};

/// Where the mean of rows crosses a value, and how far it takes from 16 to 84 per cent.
struct Crossing {
  double at = 0, width = 1;
};
Crossing crossing_of(const Upright& p, int y0, int y1, double low, double high) {
  double at = 0;
  int between = 0;
  for (int x = 0; x < p.width; ++x) {
    const double share = (mean_over(p, x, x + 1, y0, y1) - low) / (high - low);
    // All light that is missing on the high side, and there is on the low one, moves it.
    at += 1 - std::clamp(share, 0.0, 1.0);
    between += share > 0.16 && share < 0.84;
  }
  return {at - 0.5, std::max(0.6, 0.5 * between)};
}

/// The straight edge of the picture, and the noise of its pixels.
struct Found {
  Line line;
  double noise = 0;
};
Found find_line(const Upright& p, const std::string& path) {
  const int w = p.width, h = p.height;
  const double low = mean_over(p, 0, w / 6, 0, h), high = mean_over(p, w - w / 6, w, 0, h);
  std::vector<double> differences;
  for (int y = 0; y < h; ++y) {
    for (int x = 1; x < w; x += 2) {
      differences.push_back(std::abs(p.at(x, y) - p.at(x - 1, y)));
    }
  }
  const double noise = kOfMedian / std::numbers::sqrt2 * median(std::move(differences));
  const double step = std::abs(high - low);
  if (!(step > 5 * noise) || step < 0.01) {
    throw InputError(path, "",
                     fmt::format("shows no edge: one side is {:.2g} of white brighter than the "
                                 "other, pixels scatter by {:.2g}; expected the picture of one "
                                 "straight edge of light, upright or level",
                                 step, noise));
  }
  const Crossing top = crossing_of(p, 0, h / 2, low, high),
                 bottom = crossing_of(p, h / 2, h, low, high);
  std::vector<double> values = {low, high, 0.5 * (top.at + bottom.at),
                                (bottom.at - top.at) / (0.5 * h), 0.5 * (top.width + bottom.width)};
  const LineProblem problem(p, step);
  const double cost = minimise(problem, values, 1e-10, 100);
  Found found{LineProblem::line_of(values.data()), noise};
  const double rms = std::sqrt(cost / static_cast<double>(problem.count()));
  // A halo of a tenth of the light misses by less.
  constexpr double most = 0.08;
  if (!(rms < std::max(most * step, 2 * noise)) ||
      !(std::abs(found.line.high - found.line.low) < 1.5 * step)) {
    throw InputError(path, "",
                     "shows no single straight edge, dark on one side and bright on the other; "
                     "expected that alone: cut the picture to it");
  }
  const double angle = std::abs(std::atan(found.line.lean)) * 180 / std::numbers::pi;
  if (angle > kMostLeanDeg) {
    throw InputError(
        path, "",
        fmt::format("shows an edge that leans by {:.1f} degrees; expected at most {:g} "
                    "from upright or level: turn the camera",
                    angle, kMostLeanDeg));
  }
  return found;
}

/// What there is at about one distance.
struct Bin {
  double places = 0, squares = 0;
  std::vector<double> light;
};

}  // namespace

KnifeEdge read_edge_picture(const std::string& path, double pitch_um, double depth_um) {
  const CameraPicture picture = read_camera_png(path);
  if (std::min(picture.width_px, picture.height_px) < kLeastSide) {
    throw InputError(path, "",
                     fmt::format("is {} x {} pixels; expected at least {} along each side",
                                 picture.width_px, picture.height_px, kLeastSide));
  }
  const auto white = std::count(picture.pixels.begin(), picture.pixels.end(), picture.white);
  const double share = static_cast<double>(white) / static_cast<double>(picture.pixels.size());
  constexpr double most_white = 0.005;
  if (share > most_white) {
    throw InputError(path, "",
                     fmt::format("is overexposed: {:.1f} % of its pixels are white; expected a "
                                 "picture whose bright side is below white, taken again with less "
                                 "light or time",
                                 100 * share));
  }
  const Upright p = upright(picture);
  const auto [line, noise] = find_line(p, path);
  const double cosine = 1 / std::hypot(1, line.lean);
  // So far it can be looked at on both sides in every row.
  const double lean = 0.5 * std::abs(line.lean) * p.height;
  const double room = (std::min(line.column, p.width - 1 - line.column) - lean) * cosine;
  constexpr double least_room = 4;  // of sigma
  if (room < least_room * line.sigma) {
    throw InputError(
        path, "",
        fmt::format("ends {:.0f} um beside its edge, whose light needs {:.0f} um to "
                    "get even; expected more of both sides",
                    std::max(0.0, room) * pitch_um, least_room * line.sigma * pitch_um));
  }
  // Fine bins where light changes; finer ones than a 24th of sigma would tell no more of it.
  const double near = 6 * line.sigma + 2, fine = std::max(0.125, line.sigma / 24),
               far = 0.5 * p.width + lean + near;
  const auto fine_bins = static_cast<std::size_t>(std::ceil(2 * near / fine));
  const auto side_bins = static_cast<std::size_t>(std::ceil(far));
  std::vector<Bin> bins(fine_bins + 2 * (2 * side_bins + 2));
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const double t = line.distance(x, y - 0.5 * (p.height - 1));
      std::size_t bin = 0;
      if (std::abs(t) < near) {
        bin = std::min(fine_bins - 1, static_cast<std::size_t>((t + near) / fine));
      } else {
        const auto out = static_cast<std::size_t>(std::abs(t) - near);
        bin = fine_bins + (t < 0 ? 0 : 2 * side_bins + 2) + std::min(out, 2 * side_bins + 1);
      }
      bins[bin].places += t;
      bins[bin].squares += t * t;
      bins[bin].light.push_back(p.at(x, y));
    }
  }
  KnifeEdge edge;
  edge.source = path;
  edge.depth_um = depth_um;
  edge.angle_deg = std::atan(line.lean) * 180 / std::numbers::pi;
  edge.box_um = {pitch_um * cosine, pitch_um * cosine * std::abs(line.lean)};
  std::size_t dust = 0;
  for (Bin& b : bins) {
    if (b.light.empty()) continue;
    const double n = static_cast<double>(b.light.size());
    const double middle = median(b.light), place = b.places / n;
    std::vector<double> off;
    for (const double v : b.light) off.push_back(std::abs(v - middle));
    // Places in a bin differ, too.
    const double scatter =
        std::max({noise, kOfMedian * median(std::move(off)), 0.25 / picture.white});
    double sum = 0, counted = 0;
    for (const double v : b.light) {
      if (b.light.size() > 4 && std::abs(v - middle) > 7 * scatter) {
        ++dust;
        continue;
      }
      sum += v;
      ++counted;
    }
    const double variance = std::max(0.0, b.squares / n - place * place);
    edge.samples.push_back(
        {0, place * pitch_um, sum / counted, counted, variance * pitch_um * pitch_um});
  }
  if (dust > 0) {
    edge.notes.push_back(fmt::format(
        "{}: {} pixels that can't belong to those at their distance, dust perhaps, are left out.",
        path, dust));
  }
  if (line.sigma < 0.5) {
    edge.notes.push_back(
        fmt::format("{}: the light spreads over less than a pixel of the camera; expect more of a "
                    "picture that is magnified further.",
                    path));
  }
  std::sort(edge.samples.begin(), edge.samples.end(),
            [](const EdgeSample& a, const EdgeSample& b) { return a.at_um < b.at_um; });
  return edge;
}

}  // namespace slicecorr::resins
