// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <tuple>

#include "slice/placing.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/plate.hpp"

namespace slicecorr {

namespace {

constexpr int kCells = 1000, kWordBits = 64;

/// Rows of cells, bits of 64.
class CellRows {
 public:
  CellRows(int width, int height)
      : width_(width),
        height_(height),
        words_(static_cast<std::size_t>((width + kWordBits - 1) / kWordBits)),
        bits_(words_ * static_cast<std::size_t>(height), 0) {}
  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t words() const { return words_; }
  std::uint64_t* row(int y) { return bits_.data() + static_cast<std::size_t>(y) * words_; }
  const std::uint64_t* row(int y) const {
    return bits_.data() + static_cast<std::size_t>(y) * words_;
  }
  void set(int x0, int x1, int y) {
    for (int x = std::max(x0, 0); x < std::min(x1, width_); ++x) {
      row(y)[x / kWordBits] |= std::uint64_t{1} << (x % kWordBits);
    }
  }
  bool at(int x, int y) const { return (row(y)[x / kWordBits] >> (x % kWordBits) & 1) != 0; }
  std::uint64_t count() const {
    std::uint64_t sum = 0;
    for (const std::uint64_t w : bits_) sum += static_cast<std::uint64_t>(__builtin_popcountll(w));
    return sum;
  }

 private:
  int width_, height_;
  std::size_t words_;
  std::vector<std::uint64_t> bits_;
};

/// The cells that the outline of a part touches, from the corner of its box at the least x and y on.
CellRows outline_of(const TriangleMesh& mesh, const detail::PartBox& box, double cell_mm) {
  // A part as long as so many cells takes no more of them, whatever rounding adds.
  const auto cells = [&](std::size_t k) {
    return std::max(1, static_cast<int>(std::ceil(box.size(k) / cell_mm - 1e-6)));
  };
  CellRows rows(cells(0), cells(1));
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!mesh.adds(t)) continue;
    const auto& triangle = mesh.triangles[t];
    std::array<std::array<double, 2>, 3> p;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 2; ++k) {
        p[i][k] = (mesh.vertices[triangle[i]][k] - box.low[k]) / cell_mm;
      }
    }
    const auto [least, most] = std::minmax({p[0][1], p[1][1], p[2][1]});
    const int last = std::min(rows.height() - 1, static_cast<int>(std::floor(most)));
    const int first = std::clamp(static_cast<int>(std::floor(least)), 0, last);
    for (int y = first; y <= last; ++y) {
      // What of the triangle lies in the row: corners there, and where edges cross its two borders.
      double left = 1e300, right = -1e300;
      const auto take = [&](double x) {
        left = std::min(left, x);
        right = std::max(right, x);
      };
      for (std::size_t i = 0; i < 3; ++i) {
        const auto &a = p[i], &b = p[(i + 1) % 3];
        if (a[1] >= y && a[1] <= y + 1) take(a[0]);
        for (const double border : {static_cast<double>(y), y + 1.0}) {
          if ((a[1] < border) != (b[1] < border)) {
            take(a[0] + (b[0] - a[0]) * (border - a[1]) / (b[1] - a[1]));
          }
        }
      }
      if (left > right) continue;
      const int from = std::min(static_cast<int>(std::floor(left)), rows.width() - 1);
      rows.set(from, static_cast<int>(std::floor(right)) + 1, y);
    }
  }
  return rows;
}

/// The same with all cells that are so near, in a square; the part's corner is at (by, by).
CellRows grown(const CellRows& rows, int by) {
  CellRows out(rows.width() + 2 * by, rows.height() + 2 * by);
  for (int y = 0; y < rows.height(); ++y) {
    for (int x = 0; x < rows.width(); ++x) {
      if (!rows.at(x, y)) continue;
      for (int j = y; j <= y + 2 * by; ++j) out.set(x, x + 2 * by + 1, j);
    }
  }
  return out;
}

/// Whether a part with its corner at (x, y) meets none of the cells that are taken.
bool fits(const CellRows& taken, const CellRows& part, int x, int y) {
  const int shift = x % kWordBits;
  const auto first = static_cast<std::size_t>(x / kWordBits);
  for (int j = 0; j < part.height(); ++j) {
    const std::uint64_t* const row = taken.row(y + j) + first;
    const std::uint64_t* const own = part.row(j);
    for (std::size_t w = 0; w < part.words(); ++w) {
      if (((own[w] << shift) & row[w]) != 0) return false;
      const std::uint64_t over = shift == 0 ? 0 : own[w] >> (kWordBits - shift);
      if (over != 0 && (over & row[w + 1]) != 0) return false;
    }
  }
  return true;
}

/// A part in one of its turns.
struct Shape {
  int quarters;
  CellRows outline, kept_clear;
};

struct Plate {
  CellRows taken;
  /// By part that is like another: below this row, or left of this cell in it, its shapes do not fit.
  std::map<std::pair<std::size_t, int>, std::pair<int, int>> from;
};

TriangleMesh turned(const TriangleMesh& mesh, const detail::PartBox& box, int quarters) {
  TriangleMesh out = mesh;
  constexpr std::array<int, 4> cosine{1, 0, -1, 0}, sine{0, 1, 0, -1};
  const auto q = static_cast<std::size_t>(quarters);
  for (Point3& v : out.vertices) {
    const double x = v[0] - box.middle(0), y = v[1] - box.middle(1);
    v[0] = box.middle(0) + cosine[q] * x - sine[q] * y;
    v[1] = box.middle(1) + sine[q] * x + cosine[q] * y;
  }
  return out;
}

}  // namespace

std::vector<ArrangedPart> arrange(const std::vector<TriangleMesh>& parts,
                                  const ArrangeOptions& options,
                                  const std::function<std::string(std::size_t)>& name,
                                  const ExecutionContext& context) {
  if (!(options.width_mm > 0 && options.height_mm > 0 && options.spacing_mm >= 0)) {
    throw InputError("parts are arranged on a display above 0 mm, 0 mm or more apart");
  }
  const double cell_mm = std::max(options.width_mm, options.height_mm) / kCells;
  const int width = static_cast<int>(std::floor(options.width_mm / cell_mm * (1 + 1e-12))),
            height = static_cast<int>(std::floor(options.height_mm / cell_mm * (1 + 1e-12)));
  const int clear = static_cast<int>(std::ceil(options.spacing_mm / cell_mm * (1 - 1e-12)));
  // Copies share their shapes.
  std::vector<std::size_t> like(parts.size());
  std::vector<std::vector<Shape>> shapes(parts.size());
  std::vector<detail::PartBox> boxes;
  std::vector<std::uint64_t> area(parts.size(), 0);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    context.check_cancelled();
    boxes.push_back(detail::box_of(parts[i], context));
    like[i] = i;
    for (std::size_t k = 0; k < i; ++k) {
      if (like[k] == k && parts[k].vertices == parts[i].vertices &&
          parts[k].triangles == parts[i].triangles) {
        like[i] = k;
        break;
      }
    }
    if (like[i] != i) {
      area[i] = area[like[i]];
      continue;
    }
    for (const int quarters : options.turn ? std::vector<int>{0, 1, 2, 3} : std::vector<int>{0}) {
      const TriangleMesh mesh = turned(parts[i], boxes[i], quarters);
      CellRows outline = outline_of(mesh, detail::box_of(mesh, context), cell_mm);
      area[i] = outline.count();
      if (outline.width() > width || outline.height() > height) continue;
      CellRows kept_clear = grown(outline, clear);
      shapes[i].push_back({quarters, std::move(outline), std::move(kept_clear)});
    }
    if (shapes[i].empty()) {
      throw InputError(fmt::format(
          "{} is {:.3g} x {:.3g} mm from above, more than the display's {:.4g} x {:.4g} mm; expected a "
          "smaller part, or one that is turned",
          name(i), boxes[i].size(0), boxes[i].size(1), options.width_mm, options.height_mm));
    }
  }
  std::vector<std::size_t> order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::tuple(area[b], like[a]) < std::tuple(area[a], like[b]);
  });
  std::vector<Plate> plates;
  std::vector<ArrangedPart> places(parts.size());
  for (const std::size_t i : order) {
    context.check_cancelled();
    const auto& own = shapes[like[i]];
    for (std::size_t p = 0;; ++p) {
      // Rows have a word more, into which parts at the border may be shifted.
      if (p == plates.size()) plates.push_back({CellRows(width + kWordBits, height), {}});
      Plate& plate = plates[p];
      int best_end = height + 1, best_x = 0, best_y = 0;
      const Shape* best = nullptr;
      for (const Shape& shape : own) {
        auto& from = plate.from[{like[i], shape.quarters}];
        bool found = false;
        for (int y = from.first; !found && y + shape.outline.height() <= height; ++y) {
          if (y + shape.outline.height() >= best_end) break;
          int x = y == from.first ? from.second : 0;
          for (; !found && x + shape.outline.width() <= width; ++x) {
            if (!fits(plate.taken, shape.outline, x, y)) continue;
            found = true;
            best_end = y + shape.outline.height();
            best_x = x;
            best_y = y;
            best = &shape;
            from = {y, x};
          }
        }
      }
      if (!best) continue;
      for (int y = 0; y < best->kept_clear.height(); ++y) {
        const int at = best_y - clear + y;
        if (at < 0 || at >= height) continue;
        for (int x = 0; x < best->kept_clear.width(); ++x) {
          if (best->kept_clear.at(x, y))
            plate.taken.set(best_x - clear + x, best_x - clear + x + 1, at);
        }
      }
      const detail::PartBox box =
          detail::box_of(turned(parts[i], boxes[i], best->quarters), context);
      places[i] = {static_cast<int>(p),
                   best->quarters,
                   {best_x * cell_mm - box.low[0], best_y * cell_mm - box.low[1], -box.low[2]}};
      break;
    }
  }
  return places;
}

TriangleMesh at_place(const TriangleMesh& part, const ArrangedPart& place) {
  TriangleMesh out = turned(part, detail::box_of(part, {}), place.quarters);
  for (Point3& v : out.vertices) {
    for (std::size_t k = 0; k < 3; ++k) v[k] += place.move_mm[k];
  }
  return out;
}

}  // namespace slicecorr
