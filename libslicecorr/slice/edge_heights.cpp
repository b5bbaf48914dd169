// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/edge_heights.hpp"

#include <algorithm>
#include <bit>
#include <optional>
#include <utility>

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
/// Where volumes are taken away, the tag takes eleven bits more: what is left resolves 1e-6 slices.
constexpr Crossing kLowBits = 0xfff;

Crossing crossing_of(double height, bool forwards) {
  return (std::bit_cast<std::uint64_t>(height) & ~kDirection) | (forwards ? 1 : 0);
}
Crossing crossing_of(double height, bool forwards, SolidRule::Tag tag) {
  return (std::bit_cast<std::uint64_t>(height) & ~kLowBits) | Crossing{tag} << 1 |
         (forwards ? 1 : 0);
}
int winding_of(Crossing c) { return c & kDirection ? 1 : -1; }

/// One winding for all triangles.
struct PlainCrossings {
  int winding = 0;
  static double height_of(Crossing c) { return std::bit_cast<double>(c & ~kDirection); }
  void clear() { winding = 0; }
  void cross(Crossing c) { winding += winding_of(c); }
  bool inside() const { return winding != 0; }
  bool balanced() const { return winding == 0; }
};

/// One for each tag.
struct RuledCrossings {
  SolidWindings windings;
  static double height_of(Crossing c) { return std::bit_cast<double>(c & ~kLowBits); }
  void clear() { windings.clear(); }
  void cross(Crossing c) {
    windings.add(static_cast<SolidRule::Tag>((c & kLowBits) >> 1), winding_of(c));
  }
  bool inside() const { return windings.inside(); }
  bool balanced() const { return windings.balanced(); }
};

/// A triangle where a row's centres cut it.
struct RowCut {
  double x, height;          ///< of its left end
  double slope;              ///< slices per pixel
  double low, high;          ///< heights of its ends
  std::int32_t first, past;  ///< columns
  bool forwards;             ///< from left to right
  SolidRule::Tag tag;
};

/// An edge of a triangle that crosses rows. Points are computed from the corner with the lower index
/// on, so that both triangles of an edge get the same bits.
struct RowEdge {
  double x, y, z, dx, dz, per_dy;
  RowEdge() = default;
  RowEdge(const Point3& p, const Point3& q)
      : x(p[kX]), y(p[kY]), z(p[kZ]), dx(q[kX] - x), dz(q[kZ] - z), per_dy(1 / (q[kY] - y)) {}
};

/// One column after another, row by row.
class EdgeFinder {
 public:
  EdgeFinder(const PlacedMesh& mesh, const PixelBox& box)
      : mesh_(mesh), box_(box), width_(static_cast<std::size_t>(box.width())), ends_(width_ + 1) {
    if (mesh.rule) ruled_.emplace(RuledCrossings{SolidWindings(*mesh.rule)});
  }

  void find(std::span<const std::uint32_t> candidates);
  BandEdges take();

 private:
  /// With its node.
  struct Found {
    std::uint32_t column;
    std::uint32_t node_and_height;
  };
  void cut(std::uint32_t triangle);
  void find_row(std::span<const RowCut> cuts, std::uint32_t first_column);
  template <class Crossings>
  void find_column(std::uint32_t column, std::span<Crossing> crossings, Crossings& windings);
  /// An edge so many slices from the middle above its node, on the platform's side.
  void add_edge(std::uint32_t column, int node, double from_middle) {
    const std::uint8_t byte = edge_height_byte(from_middle - 0.5);
    if (node == 0 && byte == edge_height_byte(0)) return;
    found_.push_back({column, static_cast<std::uint32_t>(node) << 8 | byte});
  }
  void add_thin(std::uint32_t column, double from, double solid) {
    if (!(solid > 0)) return;
    ++result_.thin_columns;
    result_.thin_slices += solid;
    if (solid <= result_.thickest_slices) return;
    result_.thickest_slices = solid;
    result_.thickest_column = column;
    // Heights are counted from one layer below the middle of layer 0.
    result_.thickest_from = from - 1;
  }

  const PlacedMesh& mesh_;
  const PixelBox box_;
  const std::size_t width_;
  std::vector<RowCut> cuts_;          ///< row by row
  std::vector<std::size_t> row_end_;  ///< per row: where its cuts end, in `cuts_`
  std::vector<std::uint32_t> ends_;   ///< per column: where its crossings end; one column more
  std::vector<Crossing> crossings_;   ///< of the present row, column by column
  std::vector<Found> found_;
  PlainCrossings plain_;
  std::optional<RuledCrossings> ruled_;
  BandEdges result_;
};

/// Adds a triangle's cuts to their rows.
void EdgeFinder::cut(std::uint32_t triangle) {
  const auto& t = mesh_.triangles[triangle];
  // Corners by y, sorted without branches, which would be random. From the lowest to the highest
  // goes one edge, through the middle one two.
  std::uint32_t low = t[0], middle = t[1], high = t[2];
  double y_low = mesh_.corners[low][kY], y_middle = mesh_.corners[middle][kY],
         y_high = mesh_.corners[high][kY];
  bool turned = false;  // whether the corners run the other way than the triangle's
  const auto put_in_order = [&](std::uint32_t& a, std::uint32_t& b, double& y_a, double& y_b) {
    const bool swap = y_a > y_b;
    const std::uint32_t first = swap ? b : a;
    const double y_first = swap ? y_b : y_a;
    b = swap ? a : b;
    y_b = swap ? y_a : y_b;
    a = first;
    y_a = y_first;
    turned ^= swap;
  };
  put_in_order(low, middle, y_low, y_middle);
  put_in_order(middle, high, y_middle, y_high);
  put_in_order(low, middle, y_low, y_middle);
  const int first_row = std::max(first_centre(y_low), box_.y0);
  const int past_row = std::min(first_centre(y_high), box_.y1);
  const int bend = std::clamp(first_centre(y_middle), first_row, past_row);
  const auto edge = [this](std::uint32_t a, std::uint32_t b) {
    return a < b ? RowEdge(mesh_.corners[a], mesh_.corners[b])
                 : RowEdge(mesh_.corners[b], mesh_.corners[a]);
  };
  const RowEdge whole = edge(low, high);
  RowEdge half;
  for (int row = first_row; row < past_row; ++row) {
    if (row == bend) {
      half = edge(middle, high);
    } else if (row == first_row) {
      half = edge(low, middle);
    }
    const double y = row + 0.5;
    const double s = (y - whole.y) * whole.per_dy, r = (y - half.y) * half.per_dy;
    const double x0 = whole.x + s * whole.dx, x1 = half.x + r * half.dx;
    const bool to_right = x0 < x1;
    const int first = std::max(first_centre(std::max(0.0, to_right ? x0 : x1)), box_.x0);
    const int past = std::min(first_centre(std::max(0.0, to_right ? x1 : x0)), box_.x1);
    if (first >= past) continue;
    const double z0 = whole.z + s * whole.dz + 1, z1 = half.z + r * half.dz + 1;
    cuts_[row_end_[static_cast<std::size_t>(row - box_.y0)]++] = {
        to_right ? x0 : x1,
        to_right ? z0 : z1,
        (z1 - z0) / (x1 - x0),
        std::min(z0, z1),
        std::max(z0, z1),
        first,
        past,
        to_right != turned,
        mesh_.rule ? mesh_.tags[triangle] : SolidRule::Tag{0}};
  }
}

/// By exchanges without branches, which are as good as random here.
void sort_few(std::span<Crossing> crossings) {
  for (std::size_t i = 1; i < crossings.size(); ++i) {
    for (std::size_t k = i; k > 0; --k) {
      const Crossing a = crossings[k - 1], b = crossings[k];
      crossings[k - 1] = std::min(a, b);
      crossings[k] = std::max(a, b);
    }
  }
}

template <class Crossings>
void EdgeFinder::find_column(std::uint32_t column, std::span<Crossing> crossings,
                             Crossings& windings) {
  constexpr std::size_t few = 8;
  const auto height_of = [](Crossing c) { return Crossings::height_of(c); };
  if (crossings.size() % 2 != 0) return;
  windings.clear();
  for (const Crossing c : crossings) windings.cross(c);
  if (!windings.balanced()) return;
  if (crossings.size() <= few) {
    sort_few(crossings);
  } else {
    std::sort(crossings.begin(), crossings.end());
  }
  for (std::size_t i = 0; i < crossings.size();) {
    const double first = height_of(crossings[i]);
    // Rounding may put the end of a part a trifle above the middle of the layer that it ends in.
    const int node = std::min(static_cast<int>(first), mesh_.layers);
    const double past = node + 1;
    const bool before = windings.inside();
    const bool alone = i + 1 == crossings.size() || height_of(crossings[i + 1]) >= past;
    if (alone && node < mesh_.layers) {
      windings.cross(crossings[i++]);
      if (before != windings.inside()) add_edge(column, node, first - node);
      continue;
    }
    double from = node, solid = 0;
    for (; i < crossings.size(); ++i) {
      double height = height_of(crossings[i]);
      if (height >= past) {
        if (node < mesh_.layers) break;
        height = past;
      }
      if (windings.inside()) solid += height - from;
      from = height;
      windings.cross(crossings[i]);
    }
    const bool after = windings.inside();
    if (after) solid += past - from;
    if (before != after) {
      add_edge(column, node, before ? solid : 1 - solid);
    } else if (!before) {
      add_thin(column, first, solid);
    }
  }
}

/// Sorts the crossings of a row by column and looks at each of them.
void EdgeFinder::find_row(std::span<const RowCut> cuts, std::uint32_t first_column) {
  const auto index = [this](int x) { return static_cast<std::size_t>(x - box_.x0); };
  std::size_t left = width_, right = 0;
  // Begins and ends first, whose running sum is the number of crossings of each column.
  for (const RowCut& c : cuts) {
    const std::size_t first = index(c.first), past = index(c.past);
    ++ends_[first];
    --ends_[past];
    left = std::min(left, first);
    right = std::max(right, past);
  }
  std::uint32_t here = 0, sum = 0;
  for (std::size_t x = left; x < right; ++x) {
    here += ends_[x];
    ends_[x] = sum;  // for now where the column's crossings begin
    sum += here;
  }
  if (crossings_.size() < sum) crossings_.resize(sum);
  for (const RowCut& c : cuts) {
    std::uint32_t* const ends = ends_.data() + index(c.first);
    const int count = c.past - c.first;
    const double offset = c.first + 0.5 - c.x;
    for (int i = 0; i < count; ++i) {
      const double height = c.height + (offset + i) * c.slope;
      const double within = std::clamp(height, c.low, c.high);
      crossings_[ends[i]++] =
          ruled_ ? crossing_of(within, c.forwards, c.tag) : crossing_of(within, c.forwards);
    }
  }
  std::uint32_t begin = 0;
  for (std::size_t x = left; x < right; ++x) {
    const std::uint32_t end = std::exchange(ends_[x], 0);
    if (end > begin) {
      ++result_.columns;
      const std::uint32_t column = first_column + static_cast<std::uint32_t>(x);
      const std::span<Crossing> crossings = std::span(crossings_).subspan(begin, end - begin);
      if (ruled_) {
        find_column(column, crossings, *ruled_);
      } else {
        find_column(column, crossings, plain_);
      }
    }
    begin = end;
  }
  if (left < right) ends_[right] = 0;
}

void EdgeFinder::find(std::span<const std::uint32_t> candidates) {
  // How many triangles may cut each row: begins and ends first, then their running sum.
  const auto rows = static_cast<std::size_t>(box_.height());
  std::vector<std::size_t> begins(rows + 1, 0);
  std::vector<std::uint32_t> cutting;
  cutting.reserve(candidates.size());
  for (const std::uint32_t triangle : candidates) {
    const auto& t = mesh_.triangles[triangle];
    const double y[3] = {mesh_.corners[t[0]][kY], mesh_.corners[t[1]][kY], mesh_.corners[t[2]][kY]};
    const int first = std::max(first_centre(std::min({y[0], y[1], y[2]})), box_.y0);
    const int past = std::min(first_centre(std::max({y[0], y[1], y[2]})), box_.y1);
    if (first >= past) continue;
    ++begins[static_cast<std::size_t>(first - box_.y0)];
    --begins[static_cast<std::size_t>(past - box_.y0)];
    cutting.push_back(triangle);
  }
  std::size_t here = 0, sum = 0;
  for (std::size_t& begin : begins) {
    here += begin;
    begin = sum;
    sum += here;
  }
  cuts_.resize(sum);
  row_end_.assign(begins.begin(), begins.end());
  for (const std::uint32_t triangle : cutting) cut(triangle);
  for (std::size_t row = 0; row < rows; ++row) {
    find_row(std::span(cuts_).subspan(begins[row], row_end_[row] - begins[row]),
             static_cast<std::uint32_t>(row * width_));
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

BandEdges edges_of_columns(const PlacedMesh& mesh, std::span<const std::uint32_t> candidates,
                           const PixelBox& box) {
  EdgeFinder finder(mesh, box);
  if (!box.empty()) finder.find(candidates);
  return finder.take();
}

}  // namespace slicecorr::detail
