// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A picture of a part cut open that can be read without the program beside it.

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "picture/canvas.hpp"
#include "report/cure_colours.hpp"
#include "slicecorr/report.hpp"

namespace slicecorr {

namespace {

using detail::Canvas;
using detail::Colour;

constexpr int kMostSide = 640;
constexpr double kEdge = 16, kGap = 24, kPatch = 14;

std::string length_in_words(double um) {
  return um >= 1000 ? fmt::format("{:g} mm", um * 1e-3) : fmt::format("{:g} um", um);
}

}  // namespace

std::string section_sheet(const Section& before, const Section& after, double pixel_x_um,
                          double layer_um, const std::string& caption, bool svg) {
  const ColourImage left = cure_picture(before, pixel_x_um, layer_um, kMostSide);
  const ColourImage right = cure_picture(after, pixel_x_um, layer_um, kMostSide);
  const std::vector<std::pair<Colour, std::string>> legend{
      {detail::kRight, "as designed"},
      {detail::kCureThrough, "cured through"},
      {detail::kUndercure, "undercured"},
      {detail::kGreyPrinted, "designed grey, printed"}};
  const auto sheet = detail::make_canvas(svg, caption + "; left as sliced, right this stack");
  Canvas& canvas = *sheet;
  double y = kEdge + Canvas::kLine;
  double widest = 2 * kEdge + left.width_px + kGap + right.width_px;
  canvas.text(kEdge, y, caption);
  widest = std::max(widest, 2 * kEdge + canvas.width_of(caption));
  y += 1.5 * Canvas::kLine;
  const double second =
      kEdge + std::max<double>(left.width_px, canvas.width_of("as sliced")) + kGap;
  canvas.text(kEdge, y, "as sliced");
  canvas.text(second, y, "this stack");
  widest = std::max(widest, second + canvas.width_of("this stack") + kEdge);
  y += 0.5 * Canvas::kLine;
  canvas.image(kEdge, y, left);
  canvas.image(second, y, right);
  // Both on white: a hair-line says where a picture ends.
  for (const auto& [x, image] : {std::pair{kEdge, &left}, std::pair{second, &right}}) {
    const double r = x + image->width_px, foot = y + image->height_px;
    canvas.lines({{x, y, r, y}, {r, y, r, foot}, {r, foot, x, foot}, {x, foot, x, y}},
                 detail::kGreyEmpty, 1);
  }
  y += std::max(left.height_px, right.height_px) + Canvas::kLine;
  // px of the picture for each um.
  const double scale = left.width_px / (before.width * pixel_x_um);
  const double bar_um = detail::round_length(std::max(left.width_px, 30) / 2.5 / scale);
  canvas.rect(kEdge, y - 4, bar_um * scale, 4, detail::kInk);
  const std::string words = length_in_words(bar_um);
  canvas.text(kEdge + bar_um * scale + 10, y, words);
  widest = std::max(widest, kEdge + bar_um * scale + 10 + canvas.width_of(words) + kEdge);
  y += 1.5 * Canvas::kLine;
  double x = kEdge;
  for (const auto& [colour, meaning] : legend) {
    const double wide = kPatch + 8 + canvas.width_of(meaning) + kGap;
    if (x > kEdge && x + wide > std::max(widest, 480.0)) {
      x = kEdge;
      y += Canvas::kLine;
    }
    canvas.rect(x, y - kPatch, kPatch, kPatch, colour);
    canvas.text(x + kPatch + 8, y, meaning);
    x += wide;
    widest = std::max(widest, x - kGap + kEdge);
  }
  return canvas.file(widest, y + kEdge);
}

}  // namespace slicecorr
