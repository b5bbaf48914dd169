// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Sections: checks, distances from the outline, the gap that the flow feels.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/flow_section.hpp"

namespace slicecorr {
namespace {

bool positive(double v) { return std::isfinite(v) && v > 0; }

void check_size(const FlowSection& s, const std::string& name, std::string_view what,
                std::size_t size) {
  if (size == s.size()) return;
  throw InputError(name, std::string(what),
                   fmt::format("{} numbers for {} x {} cells", size, s.width, s.height));
}

/// First and last column or row with a cell of part.
struct Extent {
  int low = 0, high = -1;
  void add(int at) {
    if (high < low) low = high = at;
    low = std::min(low, at);
    high = std::max(high, at);
  }
  int cells() const { return high - low + 1; }
};

/// Squares of distances along one row or column, f(x) = least of g(k) + (x - k)² pitch²
/// (Felzenszwalb and Huttenlocher).
void least_parabolas(std::vector<double>& g, double pitch) {
  const std::size_t n = g.size();
  std::vector<double> start(n + 1), answer(n);
  std::vector<std::size_t> vertex(n);
  std::size_t last = 0;
  const auto meet = [&](std::size_t a, std::size_t b) {
    const double xa = static_cast<double>(a) * pitch, xb = static_cast<double>(b) * pitch;
    return (g[b] + xb * xb - g[a] - xa * xa) / (2 * (xb - xa));
  };
  start[0] = -std::numeric_limits<double>::infinity();
  start[1] = std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < n; ++k) {
    double at = meet(vertex[last], k);
    while (last > 0 && at <= start[last]) at = meet(vertex[--last], k);
    vertex[++last] = k;
    start[last] = at;
    start[last + 1] = std::numeric_limits<double>::infinity();
  }
  last = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const double x = static_cast<double>(k) * pitch;
    while (start[last + 1] < x) ++last;
    const double d = x - static_cast<double>(vertex[last]) * pitch;
    answer[k] = g[vertex[last]] + d * d;
  }
  g = answer;
}

}  // namespace

FlowSection section_of_coverage(int width, int height, double pitch_x_um, double pitch_y_um,
                                std::vector<float> coverage) {
  FlowSection s;
  s.width = width;
  s.height = height;
  s.pitch_x_um = pitch_x_um;
  s.pitch_y_um = pitch_y_um;
  s.coverage = std::move(coverage);
  for (const float c : s.coverage) {
    s.cells.push_back(c >= 0.5f ? FlowCell::part : FlowCell::bath);
  }
  check_section(s);
  return s;
}

void check_section(const FlowSection& s, const std::string& name) {
  if (s.width <= 0 || s.height <= 0) {
    throw InputError(name, "size", fmt::format("{} x {} cells; expected some", s.width, s.height));
  }
  if (!positive(s.pitch_x_um) || !positive(s.pitch_y_um)) {
    throw InputError(name, "pitch",
                     fmt::format("{} x {} um; expected more than 0", s.pitch_x_um, s.pitch_y_um));
  }
  check_size(s, name, "cells", s.cells.size());
  if (!s.coverage.empty()) check_size(s, name, "coverage", s.coverage.size());
  if (!s.voids.empty()) check_size(s, name, "voids", s.voids.size());
  Extent columns, rows;
  for (std::size_t i = 0; i < s.size(); ++i) {
    const FlowCell cell = s.cells[i];
    if (!s.coverage.empty() && cell != FlowCell::blind) {
      const float c = s.coverage[i];
      if (!(c >= 0 && c <= 1) || (c >= 0.5f) != (cell == FlowCell::part)) {
        throw InputError(name, "coverage",
                         fmt::format("{} in a cell of {}; expected half to 1 in part, less in bath",
                                     c, cell == FlowCell::part ? "part" : "bath"));
      }
    }
    if (!s.voids.empty() && cell == FlowCell::blind && s.voids[i] < 0) {
      throw InputError(name, "voids", "a blind cell without a void");
    }
    if (cell == FlowCell::bath) continue;
    const auto width = static_cast<std::size_t>(s.width);
    columns.add(static_cast<int>(i % width));
    rows.add(static_cast<int>(i / width));
  }
  if (std::find(s.cells.begin(), s.cells.end(), FlowCell::part) == s.cells.end()) {
    throw InputError(name, "cells", "no cell is part; expected at least one lit cell");
  }
  if (columns.cells() < 3 || rows.cells() < 3) {
    throw InputError(name, "pitch",
                     fmt::format("cells of {} x {} um are more than a third of the section of {} x "
                                 "{} cells; expected finer ones",
                                 s.pitch_x_um, s.pitch_y_um, columns.cells(), rows.cells()));
  }
}

std::vector<double> outline_distance_um(const FlowSection& s) {
  // From the middles of bath cells, less the half pitch that the outline lies before them. A ring of
  // bath goes around everything.
  const auto width = static_cast<std::size_t>(s.width), height = static_cast<std::size_t>(s.height);
  const double far = 1e9 * (s.pitch_x_um * s.width + s.pitch_y_um * s.height);
  std::vector<double> squares((width + 2) * (height + 2), 0.0);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      if (s.cells[y * width + x] != FlowCell::bath) squares[(y + 1) * (width + 2) + x + 1] = far;
    }
  }
  std::vector<double> line;
  for (std::size_t y = 0; y < height + 2; ++y) {
    const auto row = squares.begin() + static_cast<std::ptrdiff_t>(y * (width + 2));
    line.assign(row, row + static_cast<std::ptrdiff_t>(width + 2));
    least_parabolas(line, s.pitch_x_um);
    std::copy(line.begin(), line.end(), row);
  }
  for (std::size_t x = 0; x < width + 2; ++x) {
    line.clear();
    for (std::size_t y = 0; y < height + 2; ++y) line.push_back(squares[y * (width + 2) + x]);
    least_parabolas(line, s.pitch_y_um);
    for (std::size_t y = 0; y < height + 2; ++y) squares[y * (width + 2) + x] = line[y];
  }
  const double half = 0.5 * std::min(s.pitch_x_um, s.pitch_y_um);
  std::vector<double> distance(s.size(), 0.0);
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.cells[i] == FlowCell::bath) continue;
    distance[i] = std::sqrt(squares[(i / width + 1) * (width + 2) + i % width + 1]) - half;
  }
  return distance;
}

std::vector<double> felt_gap_um(const FlowSection& s, std::span<const double> gap_um,
                                double slope) {
  check_section(s);
  check_size(s, "section", "gap_um", gap_um.size());
  if (!positive(slope)) throw InputError("section", "slope", "expected more than 0");
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (std::size_t i = 0; i < s.size(); ++i) {
    if (s.cells[i] != FlowCell::part) continue;
    if (!positive(gap_um[i])) {
      throw InputError("section", "gap_um", fmt::format("{}; expected more than 0", gap_um[i]));
    }
    least = std::min(least, gap_um[i]);
    most = std::max(most, gap_um[i]);
  }
  const double reach = (most - least) / slope;
  const int across = static_cast<int>(std::min(reach / s.pitch_x_um, 1.0 * s.width));
  const int along = static_cast<int>(std::min(reach / s.pitch_y_um, 1.0 * s.height));
  std::vector<double> felt(s.size(), 0.0);
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      if (s.cells[s.index(x, y)] != FlowCell::part) continue;
      double gap = gap_um[s.index(x, y)];
      for (int v = std::max(0, y - along); v <= std::min(s.height - 1, y + along); ++v) {
        for (int u = std::max(0, x - across); u <= std::min(s.width - 1, x + across); ++u) {
          if (s.cells[s.index(u, v)] != FlowCell::part) continue;
          const double distance = std::hypot((u - x) * s.pitch_x_um, (v - y) * s.pitch_y_um);
          gap = std::min(gap, gap_um[s.index(u, v)] + slope * distance);
        }
      }
      felt[s.index(x, y)] = gap;
    }
  }
  return felt;
}

}  // namespace slicecorr
