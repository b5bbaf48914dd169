// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "picture/canvas.hpp"
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

/// What was lit and has not gelled.
constexpr Rgb kLate{214, 40, 40};
constexpr detail::Colour kFrame{150, 150, 150};

Rgb paler(Rgb c) {
  for (double& v : c) v = 0.5 * (255 + v);
  return c;
}

/// Times to gel of small features are several times those of large ones: colours go with their logarithm.
struct Times {
  double first = 1e-9, last = 1e-9;
  double share(double t) const { return std::log(t / first) / std::log(last / first); }
  double at(double share) const { return first * std::pow(last / first, share); }
};
Times times_of(const PatternRun& run, const LightPattern& target) {
  const PatternFigures f = figures_of(run, target);
  Times times;
  if (f.lit_gelled > 0) times.first = std::max(f.first_s, 1e-9);
  for (const double t : run.gel_time_s) {
    if (std::isfinite(t)) times.last = std::max(times.last, t);
  }
  times.last = std::max(times.last, times.first * 1.01);
  return times;
}

/// Each pixel as `times` x `times`.
ColourImage magnified(const ColourImage& image, int times) {
  ColourImage out{image.width_px * times, image.height_px * times, {}};
  out.rgb.reserve(3 * static_cast<std::size_t>(out.width_px) *
                  static_cast<std::size_t>(out.height_px));
  for (int y = 0; y < out.height_px; ++y) {
    for (int x = 0; x < out.width_px; ++x) {
      const std::size_t from =
          3 * (static_cast<std::size_t>(y / times) * static_cast<std::size_t>(image.width_px) +
               static_cast<std::size_t>(x / times));
      out.rgb.insert(out.rgb.end(), image.rgb.begin() + static_cast<std::ptrdiff_t>(from),
                     image.rgb.begin() + static_cast<std::ptrdiff_t>(from + 3));
    }
  }
  return out;
}

}  // namespace

ColourImage gel_time_picture(const PatternRun& run, const LightPattern& target) {
  const Times times = times_of(run, target);
  ColourImage image{run.width, run.height, {}};
  image.rgb.reserve(3 * run.gel_time_s.size());
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    const bool lit = target.share[k] >= 0.5F, gelled = std::isfinite(run.gel_time_s[k]);
    const Rgb c = gelled ? (lit ? colour_of(times.share(run.gel_time_s[k]))
                                : paler(colour_of(times.share(run.gel_time_s[k]))))
                  : lit  ? kLate
                         : Rgb{255, 255, 255};
    for (const double v : c) image.rgb.push_back(static_cast<std::uint8_t>(std::lround(v)));
  }
  return image;
}

std::string gel_time_sheet(const PatternRun& run, const LightPattern& target, double cell_um,
                           const std::string& name, bool svg) {
  constexpr int edge = 16, wide = 640, bar = 14, bar_width = 240;
  constexpr double line = detail::Canvas::kLine;
  const PatternFigures f = figures_of(run, target);
  const std::string words = fmt::format("{}: {} of {} lit cells gelled", name, f.lit_gelled, f.lit);
  const std::string more =
      fmt::format("and {} dark ones; cells of {:g} um", f.dark_gelled_at_end, cell_um);
  const auto canvas = detail::make_canvas(svg, words + " " + more);
  const ColourImage map =
      magnified(gel_time_picture(run, target), std::max(1, wide / std::max(1, run.width)));
  double y = edge + 2 * line;
  canvas->text(edge, y - line - 6, words);
  canvas->text(edge, y - 6, more);
  canvas->image(edge, y, map);
  y += map.height_px + line;
  // A round length of at most a third of the picture.
  const double per_px = cell_um * run.width / map.width_px;
  const double um = detail::round_length(per_px * map.width_px / 3.0);
  canvas->rect(edge, y - 8, um / per_px, 3, detail::kInk);
  canvas->text(edge + um / per_px + 8, y, fmt::format("{:g} um", um));
  y += line;
  const Times times = times_of(run, target);
  if (f.gelled > 0) {
    ColourImage scale{bar_width, bar, {}};
    for (int row = 0; row < bar; ++row) {
      for (int x = 0; x < bar_width; ++x) {
        for (const double v : colour_of((x + 0.5) / bar_width)) {
          scale.rgb.push_back(static_cast<std::uint8_t>(std::lround(v)));
        }
      }
    }
    canvas->text(edge, y, "gels at");
    const double from = edge + canvas->width_of("gels at") + 12;
    canvas->image(from, y - bar, scale);
    y += line;
    double past = 0;
    for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const std::string text = fmt::format("{:.3g} s", times.at(share));
      const double x = from + share * bar_width - canvas->width_of(text) / 2;
      if (x < past) continue;
      canvas->text(x, y, text);
      past = x + canvas->width_of(text) + 6;
    }
    y += line;
  }
  double x = edge;
  const auto key = [&](const Rgb& colour, const char* text) {
    canvas->rect(x, y - 12, 14, 14, kFrame);
    canvas->rect(x + 1, y - 11, 12, 12,
                 {static_cast<std::uint8_t>(colour[0]), static_cast<std::uint8_t>(colour[1]),
                  static_cast<std::uint8_t>(colour[2])});
    canvas->text(x + 20, y, text);
    x += 20 + canvas->width_of(text) + 24;
  };
  if (f.dark_gelled_at_end > 0) key(paler(colour_of(0.5)), "paler: dark, and gelled");
  if (f.lit_gelled < f.lit) key(kLate, "lit, and not gelled");
  key({255, 255, 255}, "dark");
  const double widest =
      std::max({static_cast<double>(edge + map.width_px), edge + canvas->width_of(words),
                edge + canvas->width_of(more), x});
  return canvas->file(widest + edge, y + edge);
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
    // Two words beside each other would hide each other.
    const bool told = !corrected || &run == corrected;
    panel.ring({o.time_s, o.jaccard}, told ? figure(o.jaccard) : std::string());
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
