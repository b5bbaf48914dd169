#include "slice/edge_heights.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "slicecorr/target.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kX = 0, kY = 1, kZ = 2;

/// Where a column's line meets the surface, as a number that sorts by height: the bits of the
/// height, the last one replaced by the direction. Heights are slices from one layer's height below
/// the middle of layer 0, so that node n lies between n and n + 1; they are positive, so that their
/// bits rise as they do.
using Crossing = std::uint64_t;
constexpr Crossing kDirection = 1;

Crossing crossing_of(double height, bool forwards) {
  return (std::bit_cast<std::uint64_t>(height) & ~kDirection) | (forwards ? 1 : 0);
}
double height_of(Crossing c) { return std::bit_cast<double>(c & ~kDirection); }
int winding_of(Crossing c) { return c & kDirection ? 1 : -1; }

/// A triangle where a row's centres cut it.
struct RowCut {
  double x, height;  ///< of its left end
  double slope;      ///< slices per pixel
  double low, high;  ///< heights of its ends
  int first, past;   ///< columns
  bool forwards;     ///< from left to right
};

/// One column after another, row by row.
class EdgeFinder {
 public:
  EdgeFinder(const PlacedMesh& mesh, const PixelBox& box)
      : mesh_(mesh), box_(box), width_(static_cast<std::size_t>(box.width())), ends_(width_ + 1) {}

  void find(std::span<const std::uint32_t> candidates);
  BandEdges take();

 private:
  /// With its node.
  struct Found {
    std::uint32_t column;
    std::uint32_t node_and_height;
  };
  void cut(std::uint32_t triangle, double y);
  void find_row(std::uint32_t first_column);
  void find_column(std::uint32_t column, std::span<Crossing> crossings);

  const PlacedMesh& mesh_;
  const PixelBox box_;
  const std::size_t width_;
  std::vector<RowCut> cuts_;         ///< of the present row
  std::vector<std::size_t> ends_;    ///< per column: where its crossings end; one column more
  std::vector<Crossing> crossings_;  ///< of the present row, column by column
  std::vector<Found> found_;
  BandEdges result_;
};

/// Adds the cut of a triangle by the centres of a row. Points of edges are computed from the corner
/// with the lower index on, so that both triangles of an edge get the same bits.
void EdgeFinder::cut(std::uint32_t triangle, double y) {
  const auto& t = mesh_.triangles[triangle];
  double x[2], height[2];
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint32_t a = t[k], b = t[k == 2 ? 0 : k + 1];
    const bool a_beyond = mesh_.corners[a][kY] >= y, b_beyond = mesh_.corners[b][kY] >= y;
    if (a_beyond == b_beyond) continue;
    if (a > b) std::swap(a, b);
    const Point3 &p = mesh_.corners[a], &q = mesh_.corners[b];
    const double s = (y - p[kY]) / (q[kY] - p[kY]);
    x[b_beyond] = p[kX] + s * (q[kX] - p[kX]);
    height[b_beyond] = p[kZ] + s * (q[kZ] - p[kZ]) + 1;
  }
  const bool forwards = x[0] < x[1];
  const int left = forwards ? 0 : 1;
  const int first = std::max(first_centre(x[left]), box_.x0);
  const int past = std::min(first_centre(x[1 - left]), box_.x1);
  if (first >= past) return;
  const auto [low, high] = std::minmax(height[0], height[1]);
  const double slope = (height[1 - left] - height[left]) / (x[1 - left] - x[left]);
  cuts_.push_back({x[left], height[left], slope, low, high, first, past, forwards});
}

void EdgeFinder::find_column(std::uint32_t column, std::span<Crossing> crossings) {
  int winding = 0;
  for (const Crossing c : crossings) winding += winding_of(c);
  if (winding != 0) return;
  std::sort(crossings.begin(), crossings.end());
  for (std::size_t i = 0; i < crossings.size();) {
    // Rounding may put the end of a part a trifle above the middle of the layer that it ends in.
    const int node = std::min(static_cast<int>(height_of(crossings[i])), mesh_.layers);
    const double above = node + 1;
    const bool before = winding != 0;
    double from = node, solid = 0;
    for (; i < crossings.size(); ++i) {
      double height = height_of(crossings[i]);
      if (height >= above) {
        if (node < mesh_.layers) break;
        height = above;
      }
      if (winding != 0) solid += height - from;
      from = height;
      winding += winding_of(crossings[i]);
    }
    const bool after = winding != 0;
    if (after) solid += above - from;
    if (before == after) {
      if (before || !(solid > 0)) continue;
      ++result_.thin_columns;
      result_.thin_slices += solid;
      result_.thickest_slices = std::max(result_.thickest_slices, solid);
      continue;
    }
    const std::uint8_t byte = edge_height_byte((before ? solid : 1 - solid) - 0.5);
    if (node == 0 && byte == edge_height_byte(0)) continue;
    found_.push_back({column, static_cast<std::uint32_t>(node) << 8 | byte});
  }
}

/// Sorts the crossings of `cuts_` by column and looks at each of them.
void EdgeFinder::find_row(std::uint32_t first_column) {
  std::fill(ends_.begin(), ends_.end(), std::size_t{0});
  const auto index = [this](int x) { return static_cast<std::size_t>(x - box_.x0); };
  // Begins and ends first, whose running sum is the number of crossings of each column.
  for (const RowCut& c : cuts_) {
    ++ends_[index(c.first)];
    --ends_[index(c.past)];
  }
  std::size_t here = 0, sum = 0;
  for (std::size_t& end : ends_) {
    here += end;
    end = sum;  // for now where the column's crossings begin
    sum += here;
  }
  crossings_.resize(sum);
  for (const RowCut& c : cuts_) {
    std::size_t* const ends = ends_.data() + index(c.first);
    const auto count = static_cast<std::size_t>(c.past - c.first);
    const double offset = c.first + 0.5 - c.x;
    for (std::size_t i = 0; i < count; ++i) {
      const double height = c.height + (offset + static_cast<double>(i)) * c.slope;
      crossings_[ends[i]++] = crossing_of(std::clamp(height, c.low, c.high), c.forwards);
    }
  }
  std::size_t begin = 0;
  for (std::size_t x = 0; x < width_; ++x) {
    const std::size_t end = ends_[x];
    if (end > begin) {
      find_column(first_column + static_cast<std::uint32_t>(x),
                  std::span(crossings_).subspan(begin, end - begin));
    }
    begin = end;
  }
}

void EdgeFinder::find(std::span<const std::uint32_t> candidates) {
  // The triangles of each row.
  const auto rows = static_cast<std::size_t>(box_.height());
  const auto each_row = [&](std::uint32_t triangle, const auto& see) {
    const auto& t = mesh_.triangles[triangle];
    const auto [low, high] =
        std::minmax({mesh_.corners[t[0]][kY], mesh_.corners[t[1]][kY], mesh_.corners[t[2]][kY]});
    const int first = std::max(first_centre(low), box_.y0);
    const int past = std::min(first_centre(high), box_.y1);
    for (int y = first; y < past; ++y) see(static_cast<std::size_t>(y - box_.y0));
  };
  std::vector<std::size_t> begin(rows + 2, 0);
  for (const std::uint32_t t : candidates) {
    each_row(t, [&](std::size_t row) { ++begin[row + 2]; });
  }
  for (std::size_t row = 2; row < begin.size(); ++row) begin[row] += begin[row - 1];
  std::vector<std::uint32_t> of_rows(begin.back());
  for (const std::uint32_t t : candidates) {
    each_row(t, [&](std::size_t row) { of_rows[begin[row + 1]++] = t; });
  }
  for (std::size_t row = 0; row < rows; ++row) {
    if (begin[row] == begin[row + 1]) continue;
    cuts_.clear();
    const double y = box_.y0 + static_cast<double>(row) + 0.5;
    for (std::size_t i = begin[row]; i < begin[row + 1]; ++i) cut(of_rows[i], y);
    find_row(static_cast<std::uint32_t>(row * width_));
  }
}

/// Sorts the edges by node.
BandEdges EdgeFinder::take() {
  auto& begin = result_.begin;
  begin.assign(static_cast<std::size_t>(mesh_.layers) + 3, 0);
  for (const Found& f : found_) ++begin[(f.node_and_height >> 8) + 2];
  for (std::size_t n = 2; n < begin.size(); ++n) begin[n] += begin[n - 1];
  result_.edges.resize(found_.size());
  for (const Found& f : found_) {
    result_.edges[begin[(f.node_and_height >> 8) + 1]++] = {
        f.column, static_cast<std::uint8_t>(f.node_and_height)};
  }
  begin.pop_back();
  return std::move(result_);
}

}  // namespace

int first_centre(double at) { return static_cast<int>(std::floor(at - 0.5)) + 1; }

BandEdges edges_of_columns(const PlacedMesh& mesh, std::span<const std::uint32_t> candidates,
                           const PixelBox& box) {
  EdgeFinder finder(mesh, box);
  if (!box.empty()) finder.find(candidates);
  return finder.take();
}

}  // namespace slicecorr::detail
