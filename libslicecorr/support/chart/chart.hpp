// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chart.hpp
/// A small layer to draw with: axes, lines, bands, points and words, as SVG that needs nothing
/// else.
///
/// A picture is a column of panels of equal width under a title and a legend, with notes below. It
/// is 640 units wide with text of 16, so that it can be read at 400 px. Colours follow the reader's
/// choice of light or dark; series differ by shape as well as by colour. Numbers that are not
/// finite, and those that a logarithmic axis can't show, leave gaps. The same input gives the same
/// bytes.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::chart {

/// Four significant digits, as people write them: 1234, 0.0567, 1.2e-05.
std::string figure(double value);

struct Tick {
  double value = 0;
  std::string label;  ///< empty: a minor one
};

struct Axis {
  std::string title;  ///< with its unit
  bool logarithmic = false;
  double low = 0, high = 1;
  bool downwards = false;        ///< of a vertical axis: `low` at the top
  std::vector<Tick> ticks = {};  ///< in place of round values: times of day; empty: round values
};
/// A range that holds all `values` with some room around them. From 0 on where `from_zero` and none
/// is below it.
Axis axis_over(std::string title, bool logarithmic, const std::vector<double>& values,
               bool from_zero = false);

/// Round values in the axis' range, about `most` of them with labels.
std::vector<Tick> ticks_of(const Axis& axis, int most);

struct Point {
  double x = 0, y = 0;
};

/// How a line or band looks: class of the picture's style sheet.
enum class Style {
  fit,
  other,
  reference,
  mark,
  series,  ///< one of six colours
  step,    ///< one of `kSteps` colours of things that follow each other
};
inline constexpr int kSteps = 8;

class Panel {
 public:
  /// `height` of the drawing alone; `x_labels`: whether the horizontal axis has its words here.
  Panel(Axis x, Axis y, double height, bool x_labels = true);

  void line(const std::vector<Point>& points, Style style, int series = 0);
  /// Between two lines over the same x.
  void band(const std::vector<Point>& low, const std::vector<Point>& high, Style style,
            int series = 0);
  /// Counts in bins of equal width from 0 to `most`, as steps from the axis' lower end on.
  void bins(const std::vector<double>& counts, double most, int series);
  /// A measurement; `words`: shown when pointed at.
  void point(Point p, int series, const std::string& words = {});
  /// An error bar of half-length `error` about a value.
  void bar(Point p, int series, double error);
  /// A ring about a point, with a word beside it.
  void ring(Point p, const std::string& text);
  /// A dot of the model, not of the data.
  void dot(Point p);
  /// Lines across the panel with words at their end. `row` keeps words apart.
  void vertical(double x, const std::string& text, int row = 0);
  void horizontal(double y, const std::string& text, bool below = false);
  void words(Point p, const std::string& text, double dx = 8, double dy = -8,
             std::string_view anchor = "start");

  /// With all axes; `top` is where the panel begins in the picture.
  std::string svg(double top) const;
  double full_height() const;

 private:
  double px(double x) const;
  double py(double y) const;
  bool shows(Point p) const;
  void halo(double x, double y, const std::string& text, std::string_view anchor);

  Axis x_, y_;
  double height_;
  bool x_labels_;
  std::string body_, text_;
};

class Picture {
 public:
  /// `words`: what the picture shows, for those who do not see it.
  Picture(std::string title, std::string words);
  void add(const Panel& panel) { panels_.push_back(panel); }
  void legend_point(int series, const std::string& text);
  void legend_line(Style style, const std::string& text, int series = 0);
  void legend_band(Style style, const std::string& text, int series = 0);
  void legend_bar(const std::string& text);
  void legend_ring(const std::string& text);
  /// A line below the panels; long ones are broken.
  void note(const std::string& text);
  std::string svg() const;

 private:
  struct Entry {
    std::string key, text;
  };
  std::string title_, words_;
  std::vector<Entry> legend_;
  std::vector<Panel> panels_;
  std::vector<std::string> notes_;
};

/// Breaks a text into lines of at most `columns` characters, at spaces.
std::vector<std::string> wrapped(const std::string& text, int columns);

}  // namespace slicecorr::chart
