// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/distortion.hpp"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

namespace {

constexpr std::size_t kPowers = Distortion::kPowers, kTerms = Distortion::kTerms;
/// The map is looked at from edge to edge in so many steps each way.
constexpr int kSteps = 32;
/// How far marks must reach, of 2: from u = -0.8 to 0.8.
constexpr double kLeastReach = 1.6;
/// A place of the image may lie so far outside of it, in u and v.
constexpr double kMostOutside = 0.1;

struct Powers {
  std::array<double, kPowers> value, slope, bend;
};
Powers powers_of(double u) {
  return {{1, u, u * u, u * u * u}, {0, 1, 2 * u, 3 * u * u}, {0, 0, 2, 6 * u}};
}

double sum_of(const std::array<double, kTerms>& factors, const std::array<double, kPowers>& a,
              const std::array<double, kPowers>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < kPowers; ++i) {
    for (std::size_t j = 0; j < kPowers; ++j) sum += factors[kPowers * i + j] * a[i] * b[j];
  }
  return sum;
}

/// Calls `each(u, v)` from edge to edge.
template <class Each>
void over_display(const Each& each) {
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) each(2.0 * i / kSteps - 1, 2.0 * j / kSteps - 1);
  }
}

double area_of(const std::array<double, 4>& slopes) {
  return slopes[0] * slopes[3] - slopes[1] * slopes[2];
}

/// Takes shift and turn as a whole out of measured places, so that they lie about where pixels say.
void lay_upon(const std::vector<std::array<double, 2>>& even,
              std::vector<DistortionPoint>& points) {
  double mean[4] = {};
  const auto n = static_cast<double>(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    mean[0] += even[i][0] / n, mean[1] += even[i][1] / n;
    mean[2] += points[i].x_mm / n, mean[3] += points[i].y_mm / n;
  }
  double along = 0, across = 0, mirrored_along = 0, mirrored_across = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double ex = even[i][0] - mean[0], ey = even[i][1] - mean[1];
    const double x = points[i].x_mm - mean[2], y = points[i].y_mm - mean[3];
    along += x * ex + y * ey, across += x * ey - y * ex;
    mirrored_along += x * ex - y * ey, mirrored_across += x * ey + y * ex;
  }
  if (std::hypot(mirrored_along, mirrored_across) > std::hypot(along, across)) {
    throw InputError(
        "the measured places are mirrored; expected y_mm that grows where y_px falls, as on the plate seen "
        "from the side of the part");
  }
  const double turn = std::atan2(across, along), c = std::cos(turn), s = std::sin(turn);
  for (DistortionPoint& p : points) {
    const double x = p.x_mm - mean[2], y = p.y_mm - mean[3];
    p.x_mm = mean[0] + c * x - s * y;
    p.y_mm = mean[1] + s * x + c * y;
  }
}

}  // namespace

std::array<double, 2> Distortion::place_mm(double u, double v) const {
  const Powers a = powers_of(u), b = powers_of(v);
  return {sum_of(x_mm, a.value, b.value), sum_of(y_mm, a.value, b.value)};
}

std::array<double, 4> Distortion::slopes_mm(double u, double v) const {
  const Powers a = powers_of(u), b = powers_of(v);
  return {sum_of(x_mm, a.slope, b.value), sum_of(x_mm, a.value, b.slope),
          sum_of(y_mm, a.slope, b.value), sum_of(y_mm, a.value, b.slope)};
}

Distortion fit_distortion(const std::vector<DistortionPoint>& points, const Printer& printer) {
  if (points.size() < kFewestMarks) {
    throw InputError(
        fmt::format("{} places are measured; expected {} or more", points.size(), kFewestMarks));
  }
  const Grid plate = plate_grid(printer);
  const double px = plate.pixel_x_um * 1e-3, py = plate.pixel_y_um * 1e-3;
  std::vector<DistortionPoint> placed = points;
  std::vector<std::array<double, 2>> even, uv;
  for (const DistortionPoint& p : placed) {
    even.push_back({p.x_px * px, (plate.height_px - p.y_px) * py});
    uv.push_back({2 * p.x_px / plate.width_px - 1, 2 * p.y_px / plate.height_px - 1});
  }
  for (std::size_t k = 0; k < 2; ++k) {
    const auto [low, high] = std::minmax_element(
        uv.begin(), uv.end(), [&](const auto& a, const auto& b) { return a[k] < b[k]; });
    if ((*high)[k] - (*low)[k] >= kLeastReach) continue;
    throw InputError(
        fmt::format("the marks take up {:.3g} % of the display's {}; expected {:.3g} % or more",
                    50 * ((*high)[k] - (*low)[k]), k == 0 ? "width" : "height", 50 * kLeastReach));
  }
  lay_upon(even, placed);
  const auto rows = static_cast<Eigen::Index>(placed.size());
  Eigen::MatrixXd terms(rows, static_cast<Eigen::Index>(kTerms));
  Eigen::MatrixXd wanted(rows, 2);
  Distortion map;
  double off = 0;
  const double diagonal_mm = std::hypot(plate.width_px * px, plate.height_px * py);
  for (Eigen::Index r = 0; r < rows; ++r) {
    const auto i = static_cast<std::size_t>(r);
    const Powers a = powers_of(uv[i][0]), b = powers_of(uv[i][1]);
    for (std::size_t t = 0; t < kTerms; ++t) {
      terms(r, static_cast<Eigen::Index>(t)) = a.value[t / kPowers] * b.value[t % kPowers];
    }
    wanted(r, 0) = placed[i].x_mm;
    wanted(r, 1) = placed[i].y_mm;
    const double missed = std::hypot(placed[i].x_mm - even[i][0], placed[i].y_mm - even[i][1]);
    if (missed > 0.1 * diagonal_mm) {
      throw InputError(fmt::format(
          "the mark at {:g}, {:g} px lies {:.3g} mm from where pixels of {:g} x {:g} um have it; expected "
          "measured places, in mm, of this display",
          points[i].x_px, points[i].y_px, missed, plate.pixel_x_um, plate.pixel_y_um));
    }
    map.most_off_um = std::max(map.most_off_um, 1e3 * missed);
    off += 1e6 * missed * missed / static_cast<double>(rows);
  }
  map.rms_off_um = std::sqrt(off);
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(terms);
  qr.setThreshold(1e-9);
  if (qr.rank() < static_cast<Eigen::Index>(kTerms)) {
    throw InputError(
        "the marks lie on too few lines; expected four places or more along x and along y");
  }
  const Eigen::MatrixXd factors = qr.solve(wanted);
  for (std::size_t t = 0; t < kTerms; ++t) {
    map.x_mm[t] = factors(static_cast<Eigen::Index>(t), 0);
    map.y_mm[t] = factors(static_cast<Eigen::Index>(t), 1);
  }
  map.points = static_cast<int>(rows);
  const Eigen::VectorXd missed = (terms * factors - wanted).rowwise().squaredNorm();
  map.rms_um = 1e3 * std::sqrt(missed.mean());
  // One that has more than a third of all squares is a slip, unless all are met to half a pixel.
  Eigen::Index worst = 0;
  const double most = missed.maxCoeff(&worst);
  if (most > missed.sum() / 3 && std::sqrt(most) > 0.5 * std::max(px, py)) {
    const DistortionPoint& p = points[static_cast<std::size_t>(worst)];
    throw InputError(fmt::format(
        "the mark at {:g}, {:g} px is {:.3g} um off what all others say; expected it measured again, or left "
        "out",
        p.x_px, p.y_px, 1e3 * std::sqrt(most)));
  }
  // v runs down, y up: the area is below 0 wherever the map does not fold.
  over_display([&](double u, double v) {
    if (area_of(map.slopes_mm(u, v)) < 0) return;
    throw InputError("the map of the display folds; expected places that lie like their pixels");
  });
  return map;
}

std::optional<std::array<double, 2>> image_place(const Distortion& map, const Printer& printer,
                                                 double x_mm, double y_mm) {
  const Grid plate = plate_grid(printer);
  const double width_mm = plate.width_px * plate.pixel_x_um * 1e-3;
  const double height_mm = plate.height_px * plate.pixel_y_um * 1e-3;
  double u = 2 * x_mm / width_mm - 1, v = 1 - 2 * y_mm / height_mm;
  for (int round = 0; round < 30; ++round) {
    const auto [x, y] = map.place_mm(u, v);
    const std::array<double, 4> s = map.slopes_mm(u, v);
    const double area = area_of(s), dx = x_mm - x, dy = y_mm - y;
    if (!(area < 0) || std::abs(u) > 2 || std::abs(v) > 2) return std::nullopt;
    const double du = (s[3] * dx - s[1] * dy) / area, dv = (s[0] * dy - s[2] * dx) / area;
    u += du;
    v += dv;
    if (std::abs(du) + std::abs(dv) > 1e-13) continue;
    if (std::max(std::abs(u), std::abs(v)) > 1 + kMostOutside) return std::nullopt;
    return std::array{0.5 * (u + 1) * plate.width_px, 0.5 * (v + 1) * plate.height_px};
  }
  // Newton's steps end in rounding: what is left is far below a pixel.
  if (std::max(std::abs(u), std::abs(v)) > 1 + kMostOutside) return std::nullopt;
  return std::array{0.5 * (u + 1) * plate.width_px, 0.5 * (v + 1) * plate.height_px};
}

double straight_mm(const Distortion& map, const Printer& printer) {
  constexpr double kMostBend = 0.02;
  // A line of length L bows by at most the greatest second derivative times L²/8. That of the image over
  // the plate is the plate's over the image, turned round by the slopes on both sides of it.
  const Grid plate = plate_grid(printer);
  double most = 0;
  over_display([&](double u, double v) {
    const Powers a = powers_of(u), b = powers_of(v);
    double bend = 0;
    for (const auto& factors : {map.x_mm, map.y_mm}) {
      bend += std::abs(sum_of(factors, a.bend, b.value)) +
              2 * std::abs(sum_of(factors, a.slope, b.slope)) +
              std::abs(sum_of(factors, a.value, b.bend));
    }
    const std::array<double, 4> s = map.slopes_mm(u, v);
    const double size = std::hypot(std::hypot(s[0], s[1]), std::hypot(s[2], s[3]));
    // The least slope of the map, from below: its area over its size.
    const double least = std::abs(area_of(s)) / size;
    const double px_of_u = 0.5 * std::max(plate.width_px, plate.height_px);
    most = std::max(most, px_of_u * bend / (least * least * least));
  });
  return most > 0 ? std::sqrt(8 * kMostBend / most) : std::numeric_limits<double>::infinity();
}

PitchRange pitch_range(const Distortion& map, const Printer& printer) {
  const Grid plate = plate_grid(printer);
  constexpr double infinity = std::numeric_limits<double>::infinity();
  PitchRange range{infinity, 0, infinity, 0};
  over_display([&](double u, double v) {
    const std::array<double, 4> s = map.slopes_mm(u, v);
    const double x = 2e3 * std::hypot(s[0], s[2]) / plate.width_px;
    const double y = 2e3 * std::hypot(s[1], s[3]) / plate.height_px;
    range.least_x_um = std::min(range.least_x_um, x);
    range.greatest_x_um = std::max(range.greatest_x_um, x);
    range.least_y_um = std::min(range.least_y_um, y);
    range.greatest_y_um = std::max(range.greatest_y_um, y);
  });
  return range;
}

std::optional<FlatField> light_by_pitch(const Distortion& map, const Printer& printer) {
  constexpr int kSide = 64;
  const Grid plate = plate_grid(printer);
  FlatField field;
  const double longer = std::max(plate.width_px, plate.height_px);
  field.width_px = std::max(1, static_cast<int>(std::lround(kSide * plate.width_px / longer)));
  field.height_px = std::max(1, static_cast<int>(std::lround(kSide * plate.height_px / longer)));
  // A printer that does not say how the plate lies in its images shows them as they are.
  field.of_plate = printer.orientation.has_value();
  const double middle = std::abs(area_of(map.slopes_mm(0, 0)));
  std::vector<double> light;
  for (int y = 0; y < field.height_px; ++y) {
    for (int x = 0; x < field.width_px; ++x) {
      const double u = (2.0 * x + 1) / field.width_px - 1, v = (2.0 * y + 1) / field.height_px - 1;
      light.push_back(middle / std::abs(area_of(map.slopes_mm(u, v))));
    }
  }
  const auto [least, most] = std::minmax_element(light.begin(), light.end());
  if (*most - *least < *most / 255) return std::nullopt;
  field.reference = std::clamp(static_cast<int>(std::lround(255 / *most)), 1, 255);
  std::vector<std::uint8_t> values;
  values.reserve(light.size());
  for (const double share : light) {
    values.push_back(
        static_cast<std::uint8_t>(std::clamp(std::lround(field.reference * share), 1L, 255L)));
  }
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(values));
  return field;
}

std::string distortion_in_words(const Printer& printer) {
  if (!printer.distortion) return {};
  const Distortion& d = *printer.distortion;
  const PitchRange p = pitch_range(d, printer);
  return fmt::format(
      "up to {:.0f} um from an even grid ({:.0f} um rms), pixels of {:.4g} to {:.4g} by {:.4g} to {:.4g} um; "
      "{} marks, met to {:.2g} um rms",
      d.most_off_um, d.rms_off_um, p.least_x_um, p.greatest_x_um, p.least_y_um, p.greatest_y_um,
      d.points, d.rms_um);
}

}  // namespace slicecorr
