// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Suction over height, and maps of the worst slices.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "picture/canvas.hpp"
#include "slicecorr/flow_report.hpp"
#include "slicecorr/limit.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr {

namespace {

using detail::Canvas;
using detail::Colour;
using detail::Segment;
using namespace page;

constexpr double kMargin = 16, kChartHeight = 440, kChartTop = 92, kMapSide = 250;
constexpr Colour kGrid{222, 226, 230}, kLineColour{11, 79, 160}, kLimit{190, 30, 30};
constexpr Colour kGround{255, 255, 255};
constexpr Colour kLow{120, 165, 215}, kBath{240, 246, 250}, kBlind{206, 180, 222};

struct Size {
  double width = 0, height = 0;
};

/// From pale yellow over red to nearly black, 0..1.
Colour heat(double share) {
  static constexpr std::array<std::array<double, 3>, 5> kStops{
      {{255, 247, 214}, {254, 204, 110}, {240, 110, 60}, {190, 20, 45}, {60, 5, 35}}};
  const double at = std::clamp(share, 0.0, 1.0) * (kStops.size() - 1);
  const auto low = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  const double part = at - static_cast<double>(low);
  Colour c{};
  for (std::size_t i = 0; i < 3; ++i) {
    c[i] = static_cast<std::uint8_t>(
        std::lround(kStops[low][i] + part * (kStops[low + 1][i] - kStops[low][i])));
  }
  return c;
}

std::string pressure(double pa) {
  return pa >= 1e5   ? fmt::format("{:.4g} bar", pa * 1e-5)
         : pa >= 1e3 ? fmt::format("{:.4g} kPa", pa * 1e-3)
                     : fmt::format("{:.3g} Pa", pa);
}

/// A chart with height downwards from the platform.
class HeightChart {
 public:
  HeightChart(Canvas& canvas, double left, double width, double most_mm, double most)
      : canvas_(canvas), left_(left), width_(width), most_mm_(most_mm), most_(most) {}

  void axes(const std::string& title, bool words_at_side) {
    canvas_.text(left_, kChartTop - 28, title);
    std::vector<Segment> grid;
    for (const chart::Tick& t : chart::ticks_of({"", false, 0, most_}, 4)) {
      if (t.label.empty()) continue;
      grid.push_back({x(t.value), kChartTop, x(t.value), kChartTop + kChartHeight});
      canvas_.text(x(t.value) - canvas_.width_of(t.label) / 2, kChartTop - 6, t.label);
    }
    for (const chart::Tick& t : chart::ticks_of({"", false, 0, most_mm_}, 8)) {
      if (t.label.empty()) continue;
      grid.push_back({left_, y(t.value), left_ + width_, y(t.value)});
      if (words_at_side) {
        canvas_.text(left_ - 8 - canvas_.width_of(t.label), y(t.value) + 5, t.label);
      }
    }
    canvas_.lines(grid, kGrid, 1);
    const double right = left_ + width_, foot = kChartTop + kChartHeight;
    canvas_.lines({{left_, kChartTop, right, kChartTop}, {left_, kChartTop, left_, foot}},
                  detail::kInk, 1);
  }
  void line(const std::vector<SliceFlow>& slices, double layer_um, Colour colour, double width,
            const std::function<double(const SliceFlow&)>& value) {
    std::vector<Segment> segments;
    for (std::size_t i = 0; i + 1 < slices.size(); ++i) {
      segments.push_back({x(value(slices[i])), y(height(slices[i], layer_um)),
                          x(value(slices[i + 1])), y(height(slices[i + 1], layer_um))});
    }
    // A single slice is a dash.
    if (slices.size() == 1) {
      const double at = y(height(slices[0], layer_um)), to = x(value(slices[0]));
      segments.push_back({to - 4, at, to + 4, at});
    }
    canvas_.lines(segments, colour, width);
  }
  void mark(double value, Colour colour) {
    canvas_.lines({{x(value), kChartTop, x(value), kChartTop + kChartHeight}}, colour, 1.5);
  }
  void ring(const SliceFlow& slice, double layer_um, double value, const std::string& word) {
    const double cx = x(value), cy = y(height(slice, layer_um));
    canvas_.rect(cx - 3, cy - 3, 6, 6, kLimit);
    const double wide = canvas_.width_of(word);
    const double from = cx + 8 + wide < left_ + width_ ? cx + 8 : cx - 8 - wide;
    canvas_.rect(from - 2, cy - 7, wide + 4, 14, kGround);  // curves pass beside the word
    canvas_.text(from, cy + 5, word);
  }
  double x(double value) const { return left_ + width_ * std::clamp(value / most_, 0.0, 1.0); }
  double y(double mm) const { return kChartTop + kChartHeight * mm / most_mm_; }
  static double height(const SliceFlow& s, double layer_um) {
    return (s.slice + 0.5) * layer_um * 1e-3;
  }

 private:
  Canvas& canvas_;
  double left_, width_, most_mm_, most_;
};

/// The map of a slice in a square of `kMapSide`, with its words below.
void draw_map(Canvas& canvas, const FlowMap& map, const FlowPicture& p, double left) {
  const FlowSection& s = map.section;
  const double most = std::max(map.flow.suction_pa, 1e-30);
  const int side = std::max(s.width, s.height);
  const int scale = std::max(1, static_cast<int>(kMapSide) / side);
  const int shrink = std::max(1, static_cast<int>(std::ceil(side / kMapSide)));
  ColourImage image;
  image.width_px = s.width * scale / shrink;
  image.height_px = s.height * scale / shrink;
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {
      const std::size_t k = s.index(std::min(s.width - 1, x * shrink / scale),
                                    std::min(s.height - 1, y * shrink / scale));
      const Colour c = s.cells[k] == FlowCell::bath    ? kBath
                       : s.cells[k] == FlowCell::blind ? kBlind
                                                       : heat(map.suction_pa[k] / most);
      image.rgb.insert(image.rgb.end(), c.begin(), c.end());
    }
  }
  canvas.text(left, kChartTop - 28,
              fmt::format("slice {}, {:.3f} mm", map.flow.slice,
                          HeightChart::height(map.flow, p.layer_um)));
  canvas.text(left, kChartTop - 6,
              fmt::format("{}, {:.3g} N", pressure(map.flow.suction_pa), map.flow.force_n));
  canvas.image(left, kChartTop, image);
  double foot = kChartTop + image.height_px + Canvas::kLine;
  canvas.text(left, foot, fmt::format("at x {:.2f}, y {:.2f} mm", map.flow.x_mm, map.flow.y_mm));
  canvas.text(left, foot += Canvas::kLine,
              fmt::format("at most {} mm/h", at_most(map.flow.speed_limit_mm_h)));
  canvas.text(left, foot += Canvas::kLine,
              fmt::format("map {:.3g} x {:.3g} mm", s.width * s.pitch_x_um * 1e-3,
                          s.height * s.pitch_y_um * 1e-3));
  ColourImage scale_bar;
  scale_bar.width_px = static_cast<int>(kMapSide);
  scale_bar.height_px = 10;
  for (int i = 0; i < scale_bar.width_px * scale_bar.height_px; ++i) {
    const Colour c = heat((i % scale_bar.width_px) / (kMapSide - 1));
    scale_bar.rgb.insert(scale_bar.rgb.end(), c.begin(), c.end());
  }
  canvas.image(left, foot + 10, scale_bar);
  foot += 20 + Canvas::kLine - 4;
  const std::string greatest = pressure(map.flow.suction_pa);
  canvas.text(left, foot, "0");
  canvas.text(left + kMapSide - canvas.width_of(greatest), foot, greatest);
}

/// On a page, the page has the title.
Size draw(Canvas& canvas, const FlowPicture& p, bool title = true) {
  if (title) canvas.text(kMargin, 24, p.title);
  double most_mm = p.layer_um * 1e-3, most_pa = 0, most_dose = 0;
  for (const SliceFlow& s : p.slices) {
    most_mm = std::max(most_mm, (s.slice + 1) * p.layer_um * 1e-3);
    most_pa = std::max(most_pa, s.suction_pa);
    if (s.dose) most_dose = std::max(most_dose, s.dose->max);
  }
  const bool limit_shown = p.limit_pa < 1.5 * most_pa;
  if (limit_shown) most_pa = std::max(most_pa, p.limit_pa);
  const double unit = most_pa >= 1e5 ? 1e-5 : most_pa >= 1e3 ? 1e-3 : 1;
  const char* const name = most_pa >= 1e5 ? "bar" : most_pa >= 1e3 ? "kPa" : "Pa";
  double left = kMargin + 56;
  canvas.text(kMargin, kChartTop - 6, "mm");
  HeightChart suction(canvas, left, 300, most_mm, std::max(most_pa * unit * 1.05, 1e-12));
  suction.axes(fmt::format("suction, {}", name), true);
  if (limit_shown) suction.mark(p.limit_pa * unit, kLimit);
  const auto suction_of = [&](const SliceFlow& s) { return s.suction_pa * unit; };
  suction.line(p.slices, p.layer_um, kLineColour, 2, suction_of);
  for (const FlowMap& m : p.maps) {
    suction.ring(m.flow, p.layer_um, m.flow.suction_pa * unit, fmt::format("{}", m.flow.slice));
  }
  left += 300 + 28;
  if (most_dose > 0) {
    std::vector<SliceFlow> with_dose;
    for (const SliceFlow& s : p.slices) {
      if (s.dose) with_dose.push_back(s);
    }
    HeightChart dose(canvas, left, 200, most_mm, most_dose * 1.05);
    dose.axes("dose at the front", false);
    dose.mark(1, kLimit);
    dose.line(with_dose, p.layer_um, kLow, 1.5, [](const SliceFlow& s) { return s.dose->min; });
    dose.line(with_dose, p.layer_um, kLow, 1.5, [](const SliceFlow& s) { return s.dose->max; });
    dose.line(with_dose, p.layer_um, kLineColour, 2,
              [](const SliceFlow& s) { return s.dose->mean; });
    left += 200 + 28;
  }
  for (const FlowMap& m : p.maps) {
    draw_map(canvas, m, p, left);
    left += kMapSide + 28;
  }
  double foot = kChartTop + kChartHeight + 30;
  canvas.text(kMargin, foot,
              fmt::format("Platform up; {:g} mm/h, gap {:.4g} um. {} {}.", p.speed_mm_h, p.gap_um,
                          limit_shown ? "Red line in suction:" : "Beyond what is drawn:",
                          p.limit_given ? pressure(p.limit_pa) + ", what the printer bears"
                                        : "1 bar, where resin cavitates"));
  foot += Canvas::kLine;
  canvas.text(kMargin, foot, "Maps: pale to dark is suction, bluish the bath, violet blind voids.");
  if (most_dose > 0) {
    foot += Canvas::kLine;
    canvas.text(kMargin, foot, "Dose: least, mean and greatest of a slice; red, 1: resin gels.");
  }
  return {std::max(left, 760.0), foot + kMargin};
}

Markup slice_rows(const FlowPicture& p) {
  const bool dosed =
      std::any_of(p.slices.begin(), p.slices.end(), [](const SliceFlow& s) { return s.dose; });
  Table table({}, "slices", true);
  table.columns("slice", "mm", "suction", "force, N", "most mm/h", "x, mm", "y, mm");
  if (dosed) table.columns("dose", "within 10 %", "window's dose", "dead zone, um");
  for (const SliceFlow& s : p.slices) {
    table.begin();
    table.cells(s.slice, fmt::format("{:.3f}", HeightChart::height(s, p.layer_um)),
                pressure(s.suction_pa), fmt::format("{:.3g}", s.force_n),
                at_most(s.speed_limit_mm_h), fmt::format("{:.2f}", s.x_mm),
                fmt::format("{:.2f}", s.y_mm));
    if (s.dose) {
      table.cells(fmt::format("{:.3g}–{:.3g}–{:.3g}", s.dose->min, s.dose->mean, s.dose->max),
                  fmt::format("{:.1f} %", 100 * s.dose->within_10),
                  fmt::format("{:.3g}", s.dose->max_window),
                  fmt::format("{:.0f}–{:.0f}", s.dead_zone_min_um, s.dead_zone_max_um));
    } else if (dosed) {
      table.cells("", "", "", "");
    }
  }
  return table;
}

std::string svg_of(const FlowPicture& picture, bool title) {
  std::string words = picture.title;
  for (const FlowMap& m : picture.maps) {
    words += fmt::format(". Slice {}: {} at most", m.flow.slice, pressure(m.flow.suction_pa));
  }
  detail::SvgCanvas canvas(words);
  const Size size = draw(canvas, picture, title);
  return canvas.file(size.width, size.height);
}

}  // namespace

std::string flow_svg(const FlowPicture& picture) { return svg_of(picture, true); }

std::string flow_png(const FlowPicture& picture) {
  detail::PixelCanvas canvas;
  const Size size = draw(canvas, picture);
  return canvas.file(size.width, size.height);
}

std::string flow_page(const FlowPicture& picture) {
  Page page(picture.title, {page_tiles_css});
  page += drawing(svg_of(picture, false));
  for (const std::string& note : picture.notes) page += markup("<p>{}</p>", note);
  page += slice_rows(picture);
  return page.html() + "\n";
}

}  // namespace slicecorr
