// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "picture/canvas.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "picture/letters.hpp"
#include "support/text/base64.hpp"
#include "support/text/escape.hpp"

namespace slicecorr::detail {

namespace {

std::string hex(Colour c) { return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]); }

/// At most two decimals, never "-0".
std::string number(double v) {
  std::string s = fmt::format("{:.2f}", v);
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

std::string as_file(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

/// Dots of letters are squares of this many pixels; a letter takes six of them.
constexpr int kDot = 2, kAdvance = 6 * kDot;

}  // namespace

std::unique_ptr<Canvas> make_canvas(bool svg, const std::string& words) {
  if (svg) return std::make_unique<SvgCanvas>(words);
  return std::make_unique<PixelCanvas>();
}

double round_length(double most) {
  const double ten = std::pow(10.0, std::floor(std::log10(most)));
  for (const double times : {5.0, 2.0}) {
    if (times * ten <= most) return times * ten;
  }
  return ten;
}

void SvgCanvas::rect(double x, double y, double width, double height, Colour colour) {
  body_ += fmt::format(R"(<rect x="{}" y="{}" width="{}" height="{}" fill="{}"/>)", number(x),
                       number(y), number(width), number(height), hex(colour));
}

void SvgCanvas::image(double x, double y, const ColourImage& image) {
  body_ += fmt::format(
      R"(<image x="{}" y="{}" width="{}" height="{}" style="image-rendering:pixelated" href="data:image/png;base64,{}"/>)",
      number(x), number(y), image.width_px, image.height_px, base64(encode_png(image)));
}

void SvgCanvas::lines(const std::vector<Segment>& segments, Colour colour, double width) {
  if (segments.empty()) return;
  std::string path;
  double x = NAN, y = NAN;
  for (const Segment& s : segments) {
    if (s.x0 != x || s.y0 != y) path += fmt::format("M{} {}", number(s.x0), number(s.y0));
    path += fmt::format("L{} {}", number(s.x1), number(s.y1));
    x = s.x1;
    y = s.y1;
  }
  body_ += fmt::format(
      R"(<path d="{}" fill="none" stroke="{}" stroke-width="{}" stroke-linecap="round"/>)", path,
      hex(colour), number(width));
}

void SvgCanvas::text(double x, double y, std::string_view words) {
  body_ += fmt::format(R"(<text x="{}" y="{}">{}</text>)", number(x), number(y),
                       escape_markup(std::string(words)));
}

// Letters of this size are about 8.6 wide on average in the wider fonts.
double SvgCanvas::width_of(std::string_view words) const {
  return 8.6 * static_cast<double>(letters_of(words).size());
}

std::string SvgCanvas::file(double width, double height) const {
  return fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" class="drawn" viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="{2}"><style>.drawn{{max-width:100%;height:auto}}.drawn text{{font:16px system-ui,sans-serif;fill:{3}}}</style><rect width="{0}" height="{1}" fill="#fff"/>{4}</svg>)",
      number(width), number(height), escape_markup(words_), hex(kInk), body_);
}

void PixelCanvas::set(int x, int y, Colour colour) {
  if (x < 0 || y < 0) return;
  const auto row = static_cast<std::size_t>(y), at = 3 * static_cast<std::size_t>(x);
  if (rows_.size() <= row) rows_.resize(row + 1);
  if (rows_[row].size() < at + 3) rows_[row].resize(at + 3, 255);
  std::copy(colour.begin(), colour.end(), rows_[row].begin() + static_cast<std::ptrdiff_t>(at));
}

void PixelCanvas::rect(double x, double y, double width, double height, Colour colour) {
  for (auto py = std::lround(y); py < std::lround(y + height); ++py) {
    for (auto px = std::lround(x); px < std::lround(x + width); ++px) {
      set(static_cast<int>(px), static_cast<int>(py), colour);
    }
  }
}

void PixelCanvas::image(double x, double y, const ColourImage& image) {
  const int left = static_cast<int>(std::lround(x)), top = static_cast<int>(std::lround(y));
  for (int py = 0; py < image.height_px; ++py) {
    for (int px = 0; px < image.width_px; ++px) {
      const std::uint8_t* const from =
          &image.rgb[3 * (static_cast<std::size_t>(py) * static_cast<std::size_t>(image.width_px) +
                          static_cast<std::size_t>(px))];
      set(left + px, top + py, {from[0], from[1], from[2]});
    }
  }
}

void PixelCanvas::lines(const std::vector<Segment>& segments, Colour colour, double width) {
  const int reach = static_cast<int>(std::ceil(width / 2));
  for (const Segment& s : segments) {
    const double length = std::max(std::abs(s.x1 - s.x0), std::abs(s.y1 - s.y0));
    const int steps = std::max(1, static_cast<int>(std::ceil(2 * length)));
    for (int i = 0; i <= steps; ++i) {
      const double x = s.x0 + (s.x1 - s.x0) * i / steps, y = s.y0 + (s.y1 - s.y0) * i / steps;
      const int cx = static_cast<int>(std::floor(x)), cy = static_cast<int>(std::floor(y));
      for (int py = cy - reach; py <= cy + reach; ++py) {
        for (int px = cx - reach; px <= cx + reach; ++px) {
          // Pixels whose middle lies under the pen.
          if (std::hypot(px + 0.5 - x, py + 0.5 - y) <= std::max(0.5, width / 2)) {
            set(px, py, colour);
          }
        }
      }
    }
  }
}

void PixelCanvas::text(double x, double y, std::string_view words) {
  double left = std::round(x);
  const double top = std::round(y) - 7 * kDot;
  for (const Letter& letter : letters_of(words)) {
    for (int column = 0; column < 5; ++column) {
      for (int row = 0; row < 8; ++row) {
        if ((letter[static_cast<std::size_t>(column)] >> row & 1U) == 0) continue;
        rect(left + column * kDot, top + row * kDot, kDot, kDot, kInk);
      }
    }
    left += kAdvance;
  }
}

double PixelCanvas::width_of(std::string_view words) const {
  return kAdvance * static_cast<double>(letters_of(words).size());
}

std::string PixelCanvas::file(double width, double height) const {
  ColourImage image{std::max(1, static_cast<int>(std::ceil(width))),
                    std::max(1, static_cast<int>(std::ceil(height))),
                    {}};
  const std::size_t bytes = 3 * static_cast<std::size_t>(image.width_px);
  image.rgb.assign(bytes * static_cast<std::size_t>(image.height_px), 255);
  for (std::size_t y = 0;
       y < std::min<std::size_t>(rows_.size(), static_cast<std::size_t>(image.height_px)); ++y) {
    std::copy_n(rows_[y].begin(), std::min(bytes, rows_[y].size()),
                image.rgb.begin() + static_cast<std::ptrdiff_t>(y * bytes));
  }
  return as_file(encode_png(image));
}

}  // namespace slicecorr::detail
