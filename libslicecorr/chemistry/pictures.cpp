#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "slicecorr/chemistry_pictures.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr {

namespace {

using Rgb = std::array<double, 3>;

/// From yellow over green to dark blue, as even to the eye as five places make it.
Rgb colour_of(double share) {
  constexpr std::array<Rgb, 5> places{
      {{253, 231, 37}, {94, 201, 98}, {33, 145, 140}, {59, 82, 139}, {68, 1, 84}}};
  const double at = std::clamp(share, 0.0, 1.0) * (places.size() - 1);
  const std::size_t k = std::min(static_cast<std::size_t>(at), places.size() - 2);
  const double w = at - static_cast<double>(k);
  Rgb c;
  for (std::size_t j = 0; j < 3; ++j) c[j] = places[k][j] + w * (places[k + 1][j] - places[k][j]);
  return c;
}

}  // namespace

ColourImage gel_time_picture(const PatternRun& run, const LightPattern& target) {
  const PatternFigures f = figures_of(run, target);
  double last = 0;
  for (const double t : run.gel_time_s) {
    if (std::isfinite(t)) last = std::max(last, t);
  }
  const double first = f.lit_gelled > 0 ? f.first_s : 0;
  ColourImage image{run.width, run.height, {}};
  image.rgb.reserve(3 * run.gel_time_s.size());
  // Times to gel of small features are several times those of large ones.
  const double span = std::log(std::max(last, first * 1.01) / std::max(first, 1e-9));
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    const bool lit = target.share[k] >= 0.5F;
    Rgb c{255, 255, 255};
    if (std::isfinite(run.gel_time_s[k])) {
      c = colour_of(std::log(run.gel_time_s[k] / std::max(first, 1e-9)) / span);
      constexpr double pale = 0.5;
      if (!lit) {
        for (double& v : c) v = 255 - pale * (255 - v);
      }
    } else if (lit) {
      c = {214, 40, 40};
    }
    for (const double v : c) image.rgb.push_back(static_cast<std::uint8_t>(std::lround(v)));
  }
  return image;
}

std::string overlap_svg(const PatternRun& even, const PatternRun* corrected,
                        const LightPattern& target, double end_s, const std::string& name) {
  using chart::figure;
  const Overlap best = best_overlap(even, target);
  std::string words =
      fmt::format("As shown at best {} at {} s", figure(best.jaccard), figure(best.time_s));
  if (corrected) {
    const Overlap better = best_overlap(*corrected, target);
    words += fmt::format("; corrected {} at {} s", figure(better.jaccard), figure(better.time_s));
  }
  chart::Picture picture(name + ": how like the image what has gelled is", words + ".");
  chart::Panel panel({"time, s", false, 0, end_s}, {"Jaccard index", false, 0, 1.05}, 260);
  const auto draw = [&](const PatternRun& run, int series, const char* what) {
    std::vector<chart::Point> points;
    for (const Overlap& o : overlap_over_time(run, target, end_s, 400)) {
      points.push_back({o.time_s, o.jaccard});
    }
    panel.line(points, chart::Style::series, series);
    const Overlap o = best_overlap(run, target);
    panel.ring({o.time_s, o.jaccard}, figure(o.jaccard));
    picture.legend_line(chart::Style::series, what, series);
  };
  draw(even, 0, "even light");
  if (corrected) draw(*corrected, 1, "corrected");
  picture.add(panel);
  picture.note(words + ".");
  return picture.svg();
}

std::vector<std::uint8_t> grey_of_pattern(const LightPattern& pattern, int refine) {
  const int width = pattern.width / refine, height = pattern.height / refine;
  std::vector<std::uint8_t> grey;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      for (int j = 0; j < refine; ++j) {
        for (int i = 0; i < refine; ++i) {
          sum += static_cast<double>(pattern.at(x * refine + i, y * refine + j));
        }
      }
      grey.push_back(static_cast<std::uint8_t>(std::lround(255 * sum / (refine * refine))));
    }
  }
  return grey;
}

}  // namespace slicecorr
