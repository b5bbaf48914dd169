// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "picture/canvas.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "picture/dejavu_letters.hpp"
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

/// Pixels of a file along each unit of a canvas: pictures are sharp on dense screens.
constexpr int kDense = 2;

const InkLetter& ink_of(std::uint32_t code) {
  const auto* const found =
      std::lower_bound(std::begin(kDejaVuLetters), std::end(kDejaVuLetters), code,
                       [](const InkLetter& letter, std::uint32_t c) { return letter.code < c; });
  if (found != std::end(kDejaVuLetters) && found->code == code) return *found;
  return ink_of('?');
}

/// The letters of a text in UTF-8; what there is none for is "?".
std::vector<const InkLetter*> inked(std::string_view words) {
  std::vector<const InkLetter*> letters;
  std::uint32_t code = 0;
  int more = 0;
  for (const char c : words) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0U) == 0x80U) {
      if (more == 0) continue;
      code = code << 6U | (byte & 0x3FU);
      if (--more == 0) letters.push_back(&ink_of(code));
      continue;
    }
    more = byte >= 0xF0 ? 3 : byte >= 0xE0 ? 2 : byte >= 0xC0 ? 1 : 0;
    code = more == 3 ? byte & 0x07U : more == 2 ? byte & 0x0FU : more == 1 ? byte & 0x1FU : byte;
    if (more == 0) letters.push_back(&ink_of(code));
  }
  return letters;
}

int share_of(char digit) { return digit <= '9' ? digit - '0' : digit - 'a' + 10; }

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

void PixelCanvas::blend(int x, int y, Colour colour, int share) {
  const auto row = static_cast<std::size_t>(y), at = 3 * static_cast<std::size_t>(x);
  const bool there = x >= 0 && y >= 0 && row < rows_.size() && at + 3 <= rows_[row].size();
  Colour mixed = colour;
  for (std::size_t k = 0; k < 3; ++k) {
    const int ground = there ? rows_[row][at + k] : 255;
    mixed[k] = static_cast<std::uint8_t>((ground * (15 - share) + colour[k] * share + 7) / 15);
  }
  set(x, y, mixed);
}

void PixelCanvas::rect(double x, double y, double width, double height, Colour colour) {
  for (auto py = std::lround(y * kDense); py < std::lround((y + height) * kDense); ++py) {
    for (auto px = std::lround(x * kDense); px < std::lround((x + width) * kDense); ++px) {
      set(static_cast<int>(px), static_cast<int>(py), colour);
    }
  }
}

void PixelCanvas::image(double x, double y, const ColourImage& image) {
  const int left = static_cast<int>(std::lround(x)) * kDense,
            top = static_cast<int>(std::lround(y)) * kDense;
  for (int py = 0; py < kDense * image.height_px; ++py) {
    for (int px = 0; px < kDense * image.width_px; ++px) {
      const std::uint8_t* const from =
          &image.rgb[3 * (static_cast<std::size_t>(py / kDense) *
                              static_cast<std::size_t>(image.width_px) +
                          static_cast<std::size_t>(px / kDense))];
      set(left + px, top + py, {from[0], from[1], from[2]});
    }
  }
}

void PixelCanvas::lines(const std::vector<Segment>& segments, Colour colour, double wide) {
  const double width = wide * kDense;
  const int reach = static_cast<int>(std::ceil(width / 2));
  for (const Segment& one : segments) {
    const Segment s{one.x0 * kDense, one.y0 * kDense, one.x1 * kDense, one.y1 * kDense};
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
  int left = static_cast<int>(std::lround(x * kDense));
  const int foot = static_cast<int>(std::lround(y * kDense));
  for (const InkLetter* const letter : inked(words)) {
    const char* ink = letter->ink;
    for (int row = 0; row < letter->height; ++row) {
      for (int column = 0; column < letter->width; ++column) {
        const int share = share_of(*ink++);
        if (share > 0) blend(left + letter->left + column, foot - letter->top + row, kInk, share);
      }
    }
    left += letter->advance;
  }
}

double PixelCanvas::width_of(std::string_view words) const {
  int wide = 0;
  for (const InkLetter* const letter : inked(words)) wide += letter->advance;
  return static_cast<double>(wide) / kDense;
}

std::string PixelCanvas::file(double width, double height) const {
  ColourImage image{std::max(1, kDense * static_cast<int>(std::ceil(width))),
                    std::max(1, kDense * static_cast<int>(std::ceil(height))),
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
