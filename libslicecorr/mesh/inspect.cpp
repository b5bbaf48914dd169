#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "mesh/half_edges.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using detail::HalfEdge;
using detail::HalfEdges;

namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// Sets of connected triangles, joined by any number of threads at once.
class Bodies {
 public:
  explicit Bodies(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  std::uint32_t root(std::uint32_t i) {
    for (;;) {
      std::uint32_t up = load(i);
      if (up == i) return i;
      const std::uint32_t upper = load(up);
      if (up == upper) return up;
      // Halves the path; whoever was faster did no harm.
      std::atomic_ref(parent_[i]).compare_exchange_weak(up, upper, std::memory_order_relaxed);
      i = upper;
    }
  }
  // The lower index wins, so that no circle can come about.
  void unite(std::uint32_t a, std::uint32_t b) {
    for (;;) {
      a = root(a);
      b = root(b);
      if (a == b) return;
      if (a < b) std::swap(a, b);
      std::uint32_t expected = a;
      if (std::atomic_ref(parent_[a])
              .compare_exchange_strong(expected, b, std::memory_order_relaxed)) {
        return;
      }
    }
  }

 private:
  std::uint32_t load(std::uint32_t i) {
    return std::atomic_ref(parent_[i]).load(std::memory_order_relaxed);
  }
  std::vector<std::uint32_t> parent_;
};

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

/// Of the sides of one edge that belong to triangles whose third corner is the highest, those
/// whose triangle has an equal one before it.
std::size_t count_repeated(const TriangleMesh& mesh, std::span<const HalfEdge> sides,
                           std::vector<std::uint32_t>& thirds) {
  thirds.clear();
  for (const HalfEdge& side : sides) {
    const std::uint32_t third = mesh.triangles[side.corner / 3][(side.corner % 3 + 2) % 3];
    if (third > side.high) thirds.push_back(third);
  }
  if (thirds.size() < 2) return 0;
  std::sort(thirds.begin(), thirds.end());
  return thirds.size() -
         static_cast<std::size_t>(std::unique(thirds.begin(), thirds.end()) - thirds.begin());
}

/// What a chunk of the mesh adds to its report.
struct Part {
  double six_volumes = 0;
  MeshDefects defects;
};

}  // namespace

std::vector<bool> flipped_triangles(const TriangleMesh& mesh, const Job& job) {
  return detail::flipped(HalfEdges(mesh, job), job);
}

MeshReport inspect(const TriangleMesh& mesh, const Job& job) {
  const HalfEdges halves(mesh, job);
  MeshReport report;
  report.vertices = mesh.vertices.size();
  report.triangles = mesh.triangles.size();
  if (mesh.triangles.empty()) return report;

  report.lower = report.upper = mesh.vertices[mesh.triangles[0][0]];
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) {
      for (std::size_t k = 0; k < 3; ++k) {
        report.lower[k] = std::min(report.lower[k], mesh.vertices[index][k]);
        report.upper[k] = std::max(report.upper[k], mesh.vertices[index][k]);
      }
    }
  }

  const Job quiet = detail::silent(job);
  MeshDefects& defects = report.defects;
  // Tetrahedra from a corner of the box: from the origin, far parts would lose digits.
  const Point3 apex = report.lower;
  // Summed chunk by chunk, so that the sum does not depend on threads.
  constexpr std::size_t kChunk = 1 << 16;
  std::vector<Part> parts((mesh.triangles.size() + kChunk - 1) / kChunk);
  parallel_for(quiet, "", parts.size(), [&](std::size_t i) {
    Part part;
    const std::size_t end = std::min(mesh.triangles.size(), (i + 1) * kChunk);
    for (std::size_t t = i * kChunk; t < end; ++t) {
      if (halves.degenerate(t)) {
        ++part.defects.degenerate_triangles;
        continue;
      }
      const Point3& a = mesh.vertices[mesh.triangles[t][0]];
      const Point3& b = mesh.vertices[mesh.triangles[t][1]];
      const Point3& c = mesh.vertices[mesh.triangles[t][2]];
      if (has_zero_area(a, b, c)) ++part.defects.zero_area_triangles;
      const Point3 normal = cross(minus(b, apex), minus(c, apex));
      const Point3 arm = minus(a, apex);
      part.six_volumes += arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2];
    }
    parts[i] = part;
  });
  double six_volumes = 0;
  for (const Part& part : parts) {
    six_volumes += part.six_volumes;
    defects.degenerate_triangles += part.defects.degenerate_triangles;
    defects.zero_area_triangles += part.defects.zero_area_triangles;
  }
  report.volume = six_volumes / 6;

  struct Scratch {
    MeshDefects defects;
    std::vector<HalfEdge> sides;
    std::vector<std::uint32_t> thirds;
  };
  std::vector<Scratch> chunks(halves.chunks());
  Bodies bodies(mesh.triangles.size());
  halves.for_each(job, [&](std::size_t chunk, std::uint32_t, std::span<const HalfEdge> all) {
    Scratch& s = chunks[chunk];
    s.sides.clear();
    for (const HalfEdge& side : all) {
      if (!halves.degenerate(side.corner / 3)) s.sides.push_back(side);
    }
    const std::size_t n = s.sides.size();
    if (n == 1) ++s.defects.open_edges;
    if (n > 2) ++s.defects.crowded_edges;
    if (n < 2) return;
    if (n == 2 && halves.rises(s.sides[0].corner) == halves.rises(s.sides[1].corner)) {
      ++s.defects.misoriented_edges;
    }
    for (std::size_t i = 1; i < n; ++i) {
      bodies.unite(s.sides[i].corner / 3, s.sides[0].corner / 3);
    }
    s.defects.duplicate_triangles += count_repeated(mesh, s.sides, s.thirds);
  });
  for (const Scratch& s : chunks) {
    defects.open_edges += s.defects.open_edges;
    defects.crowded_edges += s.defects.crowded_edges;
    defects.misoriented_edges += s.defects.misoriented_edges;
    defects.duplicate_triangles += s.defects.duplicate_triangles;
  }
  if (defects.misoriented_edges > 0) {
    const std::vector<bool> turned = detail::flipped(halves, job);
    defects.flipped_triangles =
        static_cast<std::size_t>(std::count(turned.begin(), turned.end(), true));
  }
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    report.bodies += !halves.degenerate(t) && bodies.root(t) == t;
  }
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
