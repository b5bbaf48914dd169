// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What pictures with words are drawn on: an SVG, whose words stay text, or pixels.
///
/// Units are pixels of an ordinary screen, y downwards; files of pixels have two along each, for dense ones. The
/// ground is white. The same calls give the same bytes. Not
/// thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/picture.hpp"

namespace slicecorr::detail {

using Colour = std::array<std::uint8_t, 3>;
inline constexpr Colour kInk{27, 31, 36};

/// From (x0, y0) to (x1, y1).
struct Segment {
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

class Canvas {
 public:
  virtual ~Canvas() = default;
  Canvas(const Canvas&) = delete;
  Canvas& operator=(const Canvas&) = delete;

  static constexpr double kLine = 22;  ///< from a line of words to the next

  virtual void rect(double x, double y, double width, double height, Colour colour) = 0;
  /// At its own size.
  virtual void image(double x, double y, const ColourImage& image) = 0;
  virtual void lines(const std::vector<Segment>& segments, Colour colour, double width) = 0;
  /// From x to the right; y is the foot of the letters.
  virtual void text(double x, double y, std::string_view words) = 0;
  /// How wide words are, or a little less.
  virtual double width_of(std::string_view words) const = 0;
  /// The picture up to this size, as a file.
  virtual std::string file(double width, double height) const = 0;

 protected:
  Canvas() = default;
};

class SvgCanvas final : public Canvas {
 public:
  /// `words`: what the picture shows, for those who do not see it.
  explicit SvgCanvas(std::string words) : words_(std::move(words)) {}
  void rect(double x, double y, double width, double height, Colour colour) override;
  void image(double x, double y, const ColourImage& image) override;
  void lines(const std::vector<Segment>& segments, Colour colour, double width) override;
  void text(double x, double y, std::string_view words) override;
  double width_of(std::string_view words) const override;
  std::string file(double width, double height) const override;

 private:
  std::string words_, body_;
};

class PixelCanvas final : public Canvas {
 public:
  void rect(double x, double y, double width, double height, Colour colour) override;
  void image(double x, double y, const ColourImage& image) override;
  void lines(const std::vector<Segment>& segments, Colour colour, double wide) override;
  /// In letters of DejaVu Sans; what there is no letter for is "?".
  void text(double x, double y, std::string_view words) override;
  double width_of(std::string_view words) const override;
  std::string file(double width, double height) const override;

 private:
  void set(int x, int y, Colour colour);
  /// `share`: 0..15 of the colour over what is there.
  void blend(int x, int y, Colour colour, int share);
  std::vector<std::vector<std::uint8_t>> rows_;
};

/// An SVG, or pixels; `words` as SvgCanvas takes them.
std::unique_ptr<Canvas> make_canvas(bool svg, const std::string& words);

/// The longest round length, 1, 2 or 5 times a power of ten, that is at most `most`, which is above
/// 0: for scale bars.
double round_length(double most);

}  // namespace slicecorr::detail
