// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "exchange/light_readings.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "exchange/csv.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

/// Values along the longer side: far finer than any display's light changes.
constexpr int kMostSide = 64;
/// A meter's head may stand over the rim by this.
constexpr double kBesideMm = 1;
/// Share of a side that readings must cover.
constexpr double kLeastCovered = 0.5;
/// Readings of which a surface of second order leaves some to contradict it.
constexpr std::size_t kCurved = 9;

const char* light_column(const CsvTable& table) {
  for (const char* name : {"light", "intensity_mw_cm2"}) {
    if (table.has(name)) return name;
  }
  return nullptr;
}

std::vector<LightReading> read(const ImportSource& source, double width_mm, double height_mm) {
  const CsvTable table(source.text, source.path);
  const char* const light = light_column(table);
  std::vector<LightReading> readings;
  for (const CsvTable::Row& row : table.rows()) {
    const auto number = [&](const char* column) {
      const auto value = table.number(row, column);
      if (!value) table.fail(row, column, "is empty; expected a number");
      return *value;
    };
    const LightReading r{number("x_mm"), number("y_mm"), number(light), row.line};
    if (!(r.light > 0))
      table.fail(row, light, fmt::format("is {:g}; expected more than 0", r.light));
    const auto inside = [&](const char* column, double value, double most) {
      if (value >= -kBesideMm && value <= most + kBesideMm) return;
      table.fail(
          row, column,
          fmt::format("is {:g} mm; expected a place on the display, 0 to {:g} mm", value, most));
    };
    inside("x_mm", r.x_mm, width_mm);
    inside("y_mm", r.y_mm, height_mm);
    readings.push_back(r);
  }
  if (readings.size() < 3) {
    throw InputError(source.path, "",
                     fmt::format("has {} readings; expected three or more, over the whole display",
                                 readings.size()));
  }
  return readings;
}

/// The plane that fits the readings best around a place, there; `apart_mm`: how far readings lie
/// apart.
double light_at(const std::vector<LightReading>& readings, double x_mm, double y_mm,
                double apart_mm) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double weights = 0, mean = 0;
  for (const LightReading& r : readings) {
    const double dx = (r.x_mm - x_mm) / apart_mm, dy = (r.y_mm - y_mm) / apart_mm;
    const double weight = std::exp(-0.5 * (dx * dx + dy * dy)) + 1e-9;
    const Eigen::Vector3d v(1, dx, dy);
    normal += weight * v * v.transpose();
    right += weight * r.light * v;
    weights += weight;
    mean += weight * r.light;
  }
  // A little stiffness against slopes, where few readings are near: a thousandth of a reading's say.
  normal(1, 1) += 1e-3 * weights;
  normal(2, 2) += 1e-3 * weights;
  const Eigen::Vector3d plane = normal.ldlt().solve(right);
  return std::isfinite(plane[0]) ? plane[0] : mean / weights;
}

/// The surface of second order over the display that fits readings best; nothing where they are too few or do not
/// curve both ways.
class LightCurve {
 public:
  LightCurve(const std::vector<LightReading>& readings, double width_mm, double height_mm)
      : width_mm_(width_mm), height_mm_(height_mm) {
    if (readings.size() < kCurved) return;
    const auto rows = static_cast<Eigen::Index>(readings.size());
    Eigen::MatrixXd terms(rows, 6);
    Eigen::VectorXd light(rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const LightReading& r = readings[static_cast<std::size_t>(i)];
      terms.row(i) = terms_at(r.x_mm, r.y_mm).transpose();
      light[i] = r.light;
    }
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver(terms);
    solver.setThreshold(1e-3);
    if (solver.rank() == 6) weights_ = solver.solve(light);
  }
  bool none() const { return weights_.isZero(); }
  double at(double x_mm, double y_mm) const { return weights_.dot(terms_at(x_mm, y_mm)); }

 private:
  Eigen::Matrix<double, 6, 1> terms_at(double x_mm, double y_mm) const {
    const double u = 2 * x_mm / width_mm_ - 1, v = 2 * y_mm / height_mm_ - 1;
    return {1, u, v, u * u, u * v, v * v};
  }
  double width_mm_, height_mm_;
  Eigen::Matrix<double, 6, 1> weights_ = Eigen::Matrix<double, 6, 1>::Zero();
};

/// The light of all places, by readings.
class LightSurface {
 public:
  LightSurface(std::vector<LightReading> readings, double width_mm, double height_mm)
      : curve_(readings, width_mm, height_mm),
        left_(std::move(readings)),
        apart_mm_(std::sqrt(width_mm * height_mm / static_cast<double>(left_.size()))) {
    for (LightReading& r : left_) r.light -= curve_.at(r.x_mm, r.y_mm);
  }
  double at(double x_mm, double y_mm) const {
    return curve_.at(x_mm, y_mm) + light_at(left_, x_mm, y_mm, apart_mm_);
  }

 private:
  LightCurve curve_;
  std::vector<LightReading> left_;  ///< what readings differ from the curve
  double apart_mm_;
};

/// The reading without which the others lie far better on a curve, as a sentence; empty: none.
std::string contradicted_in_words(const std::vector<LightReading>& readings, double width_mm,
                                  double height_mm) {
  constexpr std::size_t most = 400;
  constexpr double better = 0.3, apart = 0.1;
  if (readings.size() <= kCurved || readings.size() > most) return {};
  const auto rms = [&](const std::vector<LightReading>& some, const LightCurve& curve) {
    double sum = 0;
    for (const LightReading& r : some) sum += std::pow(curve.at(r.x_mm, r.y_mm) - r.light, 2);
    return std::sqrt(sum / static_cast<double>(some.size()));
  };
  const double all = rms(readings, LightCurve(readings, width_mm, height_mm));
  double least = better * all;
  std::string words;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    std::vector<LightReading> others = readings;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const LightCurve curve(others, width_mm, height_mm);
    const LightReading& r = readings[i];
    const double expected = curve.at(r.x_mm, r.y_mm), without = rms(others, curve);
    if (curve.none() || without >= least || std::abs(r.light - expected) < apart * expected)
      continue;
    least = without;
    words = fmt::format(
        "the reading of line {}, {:g}, is contradicted by the others, which say {:.3g} there: read it again",
        r.line, r.light, expected);
  }
  return words;
}

void check_places(const std::vector<LightReading>& readings, double width_mm, double height_mm,
                  const std::string& path) {
  const auto covered = [&](double LightReading::*place, double side_mm, const char* column) {
    const auto [least, most] =
        std::minmax_element(readings.begin(), readings.end(),
                            [&](const auto& a, const auto& b) { return a.*place < b.*place; });
    const double from = (*least).*place, to = (*most).*place;
    if (to - from >= kLeastCovered * side_mm) return;
    const bool cm = (to - from) * 10 >= kLeastCovered * side_mm && to * 10 <= side_mm + kBesideMm;
    throw InputError(
        path, column,
        fmt::format(
            "goes from {:g} to {:g} mm of {:g} mm; expected readings over the whole display{}",
            from, to, side_mm, cm ? ": were these cm?" : ""));
  };
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const LightReading& r : readings) middle += Eigen::Vector2d(r.x_mm, r.y_mm);
  middle /= static_cast<double>(readings.size());
  for (const LightReading& r : readings) {
    const Eigen::Vector2d d = Eigen::Vector2d(r.x_mm, r.y_mm) - middle;
    spread += d * d.transpose();
  }
  if (spread.determinant() <= 1e-4 * spread.trace() * spread.trace()) {
    throw InputError(path, "",
                     "has all its readings on a line; expected them over the whole display");
  }
  covered(&LightReading::x_mm, width_mm, "x_mm");
  covered(&LightReading::y_mm, height_mm, "y_mm");
}

}  // namespace

bool is_light_readings(const std::string& text, const std::string& path) {
  if (text.starts_with("\x89PNG") || text.find("x_mm") == std::string::npos) return false;
  const CsvTable table(text, path, CsvTable::Header::optional);
  return table.has("x_mm") && table.has("y_mm") && light_column(table) != nullptr;
}

double LightMapOfReadings::value_at(double x_mm, double y_mm) const {
  const int column =
      std::clamp(static_cast<int>(x_mm / width_mm * image.width_px), 0, image.width_px - 1);
  const int row = std::clamp(static_cast<int>((height_mm - y_mm) / height_mm * image.height_px), 0,
                             image.height_px - 1);
  return image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) +
                      static_cast<std::size_t>(column)];
}

LightMapOfReadings map_of_readings(const ImportSource& source, double width_mm, double height_mm) {
  const std::vector<LightReading> readings = read(source, width_mm, height_mm);
  check_places(readings, width_mm, height_mm, source.path);
  const LightSurface surface(readings, width_mm, height_mm);
  LightMapOfReadings map;
  map.width_mm = width_mm;
  map.height_mm = height_mm;
  const double longer = std::max(width_mm, height_mm);
  map.image.width_px = std::max(2, static_cast<int>(std::lround(kMostSide * width_mm / longer)));
  map.image.height_px = std::max(2, static_cast<int>(std::lround(kMostSide * height_mm / longer)));
  const auto [least, most] =
      std::minmax_element(readings.begin(), readings.end(),
                          [](const auto& a, const auto& b) { return a.light < b.light; });
  std::vector<double> light;
  for (int row = 0; row < map.image.height_px; ++row) {
    const double y_mm = height_mm * (1 - (row + 0.5) / map.image.height_px);
    for (int column = 0; column < map.image.width_px; ++column) {
      const double x_mm = width_mm * (column + 0.5) / map.image.width_px;
      // Beyond the outermost readings a slope may go on for a while, not for ever.
      light.push_back(std::clamp(surface.at(x_mm, y_mm), 0.5 * least->light, 1.25 * most->light));
    }
  }
  map.brightest = *std::max_element(light.begin(), light.end());
  for (const double l : light) {
    map.image.pixels.push_back(static_cast<std::uint8_t>(std::lround(255 * l / map.brightest)));
  }
  for (const LightReading& r : readings) {
    map.off_mean += std::abs(surface.at(r.x_mm, r.y_mm) - r.light);
  }
  map.off_mean /= static_cast<double>(readings.size()) * map.brightest;
  map.contradicted = contradicted_in_words(readings, width_mm, height_mm);
  for (const double row : {5.0, 3.0, 1.0}) {
    for (const double column : {1.0, 3.0, 5.0}) {
      map.ninths.push_back(map.value_at(width_mm * column / 6, height_mm * row / 6) / 255);
    }
  }
  return map;
}

}  // namespace slicecorr::resins
