#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

#include "mesh/mesh_parts.hpp"

namespace slicecorr {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// The edges of a mesh. A degenerate triangle has none: its two long sides lie on each other, so
/// that its neighbours meet as if it were not there.
class EdgeMap {
 public:
  struct Edge {
    std::uint32_t first = kNone, second = kNone;  // corners 3 * triangle + k where they begin
    std::uint32_t triangles = 0;
  };

  explicit EdgeMap(const TriangleMesh& mesh);
  const std::vector<Edge>& edges() const { return edges_; }
  /// The edge that begins at corner 3 * triangle + k; `kNone` in degenerate triangles.
  std::uint32_t edge_at(std::size_t corner) const { return edge_of_corner_[corner]; }
  bool degenerate(std::size_t triangle) const { return edge_of_corner_[3 * triangle] == kNone; }
  /// Whether the two triangles of an edge run along it the same way.
  bool same_way(const Edge& edge) const { return rises(edge.first) == rises(edge.second); }

 private:
  bool rises(std::uint32_t corner) const {
    const auto& triangle = mesh_.triangles[corner / 3];
    return triangle[corner % 3] < triangle[(corner % 3 + 1) % 3];
  }
  const TriangleMesh& mesh_;
  std::vector<Edge> edges_;
  std::vector<std::uint32_t> edge_of_corner_;
};

void require_valid(const TriangleMesh& mesh) {
  if (mesh.triangles.size() > kNone / 3) throw InputError("the mesh has too many triangles");
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t index : mesh.triangles[t]) {
      if (index < mesh.vertices.size()) continue;
      throw InputError("triangle " + std::to_string(t + 1) + ": vertex index " +
                       std::to_string(index) + " is out of range, the mesh has " +
                       std::to_string(mesh.vertices.size()) + " vertices");
    }
  }
}

bool is_degenerate(const TriangleMesh& mesh, const std::array<std::uint32_t, 3>& triangle) {
  const Point3& a = mesh.vertices[triangle[0]];
  const Point3& b = mesh.vertices[triangle[1]];
  const Point3& c = mesh.vertices[triangle[2]];
  return a == b || b == c || c == a;
}

EdgeMap::EdgeMap(const TriangleMesh& mesh)
    : mesh_(mesh), edge_of_corner_(3 * mesh.triangles.size(), kNone) {
  // Closed meshes have 1.5 edges per triangle, loose triangles 3.
  const std::size_t size = std::bit_ceil(std::max<std::size_t>(16, 4 * mesh.triangles.size()));
  struct Slot {
    std::uint64_t key;
    std::uint32_t edge;
  };
  std::vector<Slot> slots(size, Slot{0, kNone});
  edges_.reserve(mesh.triangles.size() * 3 / 2);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& triangle = mesh.triangles[t];
    if (is_degenerate(mesh, triangle)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(triangle[k], triangle[(k + 1) % 3]);
      const std::uint64_t key = std::uint64_t{low} << 32 | high;
      std::size_t slot = detail::mix(key) & (size - 1);
      while (slots[slot].edge != kNone && slots[slot].key != key) slot = (slot + 1) & (size - 1);
      if (slots[slot].edge == kNone) {
        slots[slot] = {key, static_cast<std::uint32_t>(edges_.size())};
        edges_.emplace_back();
      }
      Edge& edge = edges_[slots[slot].edge];
      const auto corner = static_cast<std::uint32_t>(3 * t + k);
      if (edge.triangles == 0) edge.first = corner;
      if (edge.triangles == 1) edge.second = corner;
      ++edge.triangles;
      edge_of_corner_[corner] = slots[slot].edge;
    }
  }
}

class UnionFind {
 public:
  explicit UnionFind(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  // The lower index wins: with halved paths that is fast enough.
  void unite(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

std::size_t count_bodies(const TriangleMesh& mesh, const EdgeMap& map) {
  UnionFind bodies(mesh.triangles.size());
  for (std::size_t corner = 0; corner < 3 * mesh.triangles.size(); ++corner) {
    const std::uint32_t edge = map.edge_at(corner);
    if (edge == kNone) continue;
    bodies.unite(static_cast<std::uint32_t>(corner / 3), map.edges()[edge].first / 3);
  }
  std::size_t count = 0;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    count += !map.degenerate(t) && bodies.root(t) == t;
  }
  return count;
}

Point3 minus(const Point3& a, const Point3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Point3 cross(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double largest(const Point3& a) {
  return std::max({std::abs(a[0]), std::abs(a[1]), std::abs(a[2])});
}

// On a line up to what rounding can do: corners that were on one before scaling and turning still
// count, slivers whose corners a float tells apart do not.
bool has_zero_area(const Point3& a, const Point3& b, const Point3& c) {
  const Point3 u = minus(b, a), v = minus(c, a);
  const double reach = std::max({largest(a), largest(b), largest(c)});
  const double length = std::max(largest(u), largest(v));
  const double rounding = 8 * std::numeric_limits<double>::epsilon() * reach * length;
  return largest(cross(u, v)) <= rounding;
}

std::size_t count_duplicates(const TriangleMesh& mesh, const EdgeMap& map) {
  const std::size_t size = std::bit_ceil(std::max<std::size_t>(16, 2 * mesh.triangles.size()));
  std::vector<std::uint32_t> slots(size, kNone);
  const auto sorted = [&](std::size_t t) {
    auto corners = mesh.triangles[t];
    std::sort(corners.begin(), corners.end());
    return corners;
  };
  std::size_t count = 0;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (map.degenerate(t)) continue;
    const auto corners = sorted(t);
    const std::uint64_t two = std::uint64_t{corners[0]} << 32 | corners[1];
    std::size_t slot = detail::mix(detail::mix(two) ^ corners[2]) & (size - 1);
    while (slots[slot] != kNone && sorted(slots[slot]) != corners) slot = (slot + 1) & (size - 1);
    if (slots[slot] == kNone) {
      slots[slot] = t;
    } else {
      ++count;
    }
  }
  return count;
}

std::vector<bool> find_flipped(const TriangleMesh& mesh, const EdgeMap& map) {
  const std::size_t count = mesh.triangles.size();
  std::vector<bool> turned(count, false), seen(count, false);
  std::vector<std::uint32_t> part;  // of one connected part: visited, then still to visit
  for (std::uint32_t start = 0; start < count; ++start) {
    if (seen[start] || map.degenerate(start)) continue;
    part.assign(1, start);
    seen[start] = true;
    std::size_t turned_count = 0;
    for (std::size_t next = 0; next < part.size(); ++next) {
      const std::uint32_t t = part[next];
      turned_count += turned[t];
      for (std::uint32_t corner = 3 * t; corner < 3 * t + 3; ++corner) {
        const EdgeMap::Edge& edge = map.edges()[map.edge_at(corner)];
        if (edge.triangles != 2) continue;
        const std::uint32_t other = (edge.first == corner ? edge.second : edge.first) / 3;
        if (seen[other]) continue;
        seen[other] = true;
        turned[other] = turned[t] != map.same_way(edge);
        part.push_back(other);
      }
    }
    if (2 * turned_count > part.size()) {
      for (const std::uint32_t t : part) turned[t] = !turned[t];
    }
  }
  return turned;
}

}  // namespace

std::vector<bool> flipped_triangles(const TriangleMesh& mesh) {
  require_valid(mesh);
  return find_flipped(mesh, EdgeMap(mesh));
}

MeshReport inspect(const TriangleMesh& mesh) {
  require_valid(mesh);
  MeshReport report;
  report.vertices = mesh.vertices.size();
  report.triangles = mesh.triangles.size();
  if (mesh.triangles.empty()) return report;

  report.lower = report.upper = mesh.vertices[mesh.triangles[0][0]];
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) {
      for (int k = 0; k < 3; ++k) {
        report.lower[k] = std::min(report.lower[k], mesh.vertices[index][k]);
        report.upper[k] = std::max(report.upper[k], mesh.vertices[index][k]);
      }
    }
  }

  const EdgeMap map(mesh);
  MeshDefects& defects = report.defects;
  double six_volumes = 0;
  // Tetrahedra from a corner of the box: from the origin, far parts would lose digits.
  const Point3 apex = report.lower;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Point3& a = mesh.vertices[mesh.triangles[t][0]];
    const Point3& b = mesh.vertices[mesh.triangles[t][1]];
    const Point3& c = mesh.vertices[mesh.triangles[t][2]];
    if (map.degenerate(t)) {
      ++defects.degenerate_triangles;
      continue;
    }
    if (has_zero_area(a, b, c)) ++defects.zero_area_triangles;
    const Point3 normal = cross(minus(b, apex), minus(c, apex));
    const Point3 arm = minus(a, apex);
    six_volumes += arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2];
  }
  report.volume = six_volumes / 6;
  for (const EdgeMap::Edge& edge : map.edges()) {
    if (edge.triangles == 1) ++defects.open_edges;
    if (edge.triangles > 2) ++defects.crowded_edges;
    if (edge.triangles == 2 && map.same_way(edge)) ++defects.misoriented_edges;
  }
  defects.duplicate_triangles = count_duplicates(mesh, map);
  const std::vector<bool> flipped = find_flipped(mesh, map);
  defects.flipped_triangles =
      static_cast<std::size_t>(std::count(flipped.begin(), flipped.end(), true));
  report.bodies = count_bodies(mesh, map);
  return report;
}

std::string describe(const MeshDefects& defects) {
  std::string text;
  const auto add = [&](std::size_t count, const char* one, const char* many) {
    if (count == 0) return;
    if (!text.empty()) text += ", ";
    text += std::to_string(count) + " " + (count == 1 ? one : many);
  };
  add(defects.open_edges, "open edge", "open edges");
  add(defects.crowded_edges, "edge of more than two triangles", "edges of more than two triangles");
  add(defects.misoriented_edges, "misoriented edge", "misoriented edges");
  add(defects.flipped_triangles, "flipped triangle", "flipped triangles");
  add(defects.degenerate_triangles, "degenerate triangle", "degenerate triangles");
  add(defects.zero_area_triangles, "triangle of zero area", "triangles of zero area");
  add(defects.duplicate_triangles, "duplicate triangle", "duplicate triangles");
  return text;
}

void append(TriangleMesh& mesh, const TriangleMesh& part) {
  if (mesh.vertices.size() + part.vertices.size() >= kNone) {
    throw InputError("the meshes have too many vertices together");
  }
  const auto offset = static_cast<std::uint32_t>(mesh.vertices.size());
  const std::size_t count = part.triangles.size();  // `part` may be `mesh` itself
  mesh.vertices.reserve(mesh.vertices.size() + part.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
  mesh.triangles.reserve(mesh.triangles.size() + count);
  for (std::size_t t = 0; t < count; ++t) {
    const auto& corners = part.triangles[t];
    mesh.triangles.push_back({corners[0] + offset, corners[1] + offset, corners[2] + offset});
  }
}

}  // namespace slicecorr
