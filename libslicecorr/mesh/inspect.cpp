// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "mesh/half_edges.hpp"
#include "mesh/inside_out.hpp"
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
  bool is_root(std::uint32_t i) const { return parent_[i] == i; }
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
    const std::uint32_t third = mesh.triangles[side.triangle()][(side.corner() % 3 + 2) % 3];
    if (third > side.high()) thirds.push_back(third);
  }
  if (thirds.size() < 2) return 0;
  std::sort(thirds.begin(), thirds.end());
  return thirds.size() -
         static_cast<std::size_t>(std::unique(thirds.begin(), thirds.end()) - thirds.begin());
}

constexpr std::size_t kChunk = 1 << 16;

/// What a chunk of the mesh adds to its report.
struct Tally {
  Point3 lower{}, upper{};
  double six_volumes = 0;
  std::size_t bodies = 0;
  MeshDefects defects;
};

/// The report of a mesh that has triangles, made in passes over its triangles and its edges.
class Inspection {
 public:
  Inspection(const TriangleMesh& mesh, const HalfEdges& halves, const ExecutionContext& context)
      : mesh_(mesh),
        halves_(halves),
        context_(context),
        quiet_(detail::silent(context)),
        tallies_((mesh.triangles.size() + kChunk - 1) / kChunk),
        bodies_(mesh.triangles.size()) {
    report_.vertices = mesh.vertices.size();
    report_.triangles = mesh.triangles.size();
  }

  void find_box();
  /// After `find_box`: the volume, and triangles without area.
  void measure_triangles();
  /// Defects of edges and the bodies that they join; `edge_defects` may be null.
  void check_edges(EdgeDefects* edge_defects);
  /// After `check_edges`.
  void count_bodies();
  /// After `count_bodies`.
  void find_inside_out(EdgeDefects* edge_defects);
  const MeshReport& report() const { return report_; }

 private:
  /// What a chunk of the edges adds to the report, and memory for one edge at a time.
  struct EdgeTally {
    MeshDefects defects;
    std::vector<EdgeDefects::OpenEdge> open;
    std::vector<HalfEdge> sides;
    std::vector<std::uint32_t> thirds;
  };

  // Sums are made chunk by chunk, so that they do not depend on threads.
  template <typename Each>
  void in_chunks(const Each& each) {
    parallel_for(quiet_, "", tallies_.size(), [&](std::size_t i) {
      each(tallies_[i], i * kChunk, std::min(mesh_.triangles.size(), (i + 1) * kChunk));
    });
  }
  /// `all`: sides of the edge from vertex `low`. Joins the bodies of its triangles.
  void check_edge(EdgeTally& tally, std::uint32_t low, std::span<const HalfEdge> all,
                  bool keep_open);

  const TriangleMesh& mesh_;
  const HalfEdges& halves_;
  const ExecutionContext& context_;
  const ExecutionContext quiet_;
  std::vector<Tally> tallies_;
  Bodies bodies_;
  MeshReport report_;
};

void Inspection::find_box() {
  in_chunks([&](Tally& tally, std::size_t begin, std::size_t end) {
    tally.lower.fill(std::numeric_limits<double>::infinity());
    tally.upper.fill(-std::numeric_limits<double>::infinity());
    for (std::size_t t = begin; t < end; ++t) {
      if (!mesh_.adds(t)) continue;
      for (const std::uint32_t index : mesh_.triangles[t]) {
        for (std::size_t k = 0; k < 3; ++k) {
          tally.lower[k] = std::min(tally.lower[k], mesh_.vertices[index][k]);
          tally.upper[k] = std::max(tally.upper[k], mesh_.vertices[index][k]);
        }
      }
    }
  });
  report_.lower = tallies_[0].lower;
  report_.upper = tallies_[0].upper;
  for (const Tally& tally : tallies_) {
    for (std::size_t k = 0; k < 3; ++k) {
      report_.lower[k] = std::min(report_.lower[k], tally.lower[k]);
      report_.upper[k] = std::max(report_.upper[k], tally.upper[k]);
    }
  }
}

void Inspection::measure_triangles() {
  // Tetrahedra from a corner of the box: from the origin, far tallies would lose digits.
  const Point3 apex = report_.lower;
  in_chunks([&](Tally& tally, std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      if (halves_.degenerate(t)) {
        ++tally.defects.degenerate_triangles;
        continue;
      }
      const Point3& a = mesh_.vertices[mesh_.triangles[t][0]];
      const Point3& b = mesh_.vertices[mesh_.triangles[t][1]];
      const Point3& c = mesh_.vertices[mesh_.triangles[t][2]];
      if (has_zero_area(a, b, c)) ++tally.defects.zero_area_triangles;
      const Point3 normal = cross(minus(b, apex), minus(c, apex));
      const Point3 arm = minus(a, apex);
      const double six_volumes = arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2];
      if (mesh_.adds(t)) {
        tally.six_volumes += six_volumes;
      } else if (mesh_.role_of(t) == SolidRole::taken_away) {
        tally.six_volumes -= six_volumes;
      }
    }
  });
  double six_volumes = 0;
  for (const Tally& tally : tallies_) {
    six_volumes += tally.six_volumes;
    report_.defects.degenerate_triangles += tally.defects.degenerate_triangles;
    report_.defects.zero_area_triangles += tally.defects.zero_area_triangles;
  }
  report_.volume = six_volumes / 6;
}

void Inspection::check_edge(EdgeTally& tally, std::uint32_t low, std::span<const HalfEdge> all,
                            bool keep_open) {
  std::vector<HalfEdge>& sides = tally.sides;
  sides.clear();
  std::int32_t surplus = 0;
  for (const HalfEdge& side : all) {
    surplus += side.rises() ? 1 : -1;
    if (!halves_.degenerate(side.triangle())) sides.push_back(side);
  }
  if (keep_open && surplus != 0) tally.open.push_back({low, all[0].high(), surplus});
  const std::size_t n = sides.size();
  if (n == 1) ++tally.defects.open_edges;
  if (n > 2) ++tally.defects.crowded_edges;
  if (n < 2) return;
  if (n == 2 && sides[0].rises() == sides[1].rises()) ++tally.defects.misoriented_edges;
  for (std::size_t i = 1; i < n; ++i) bodies_.unite(sides[i].triangle(), sides[0].triangle());
  tally.defects.duplicate_triangles += count_repeated(mesh_, sides, tally.thirds);
}

void Inspection::check_edges(EdgeDefects* edge_defects) {
  std::vector<EdgeTally> tallies(halves_.chunks());
  halves_.for_each(context_,
                   [&](std::size_t chunk, std::uint32_t low, std::span<const HalfEdge> all) {
                     check_edge(tallies[chunk], low, all, edge_defects != nullptr);
                   });
  MeshDefects& defects = report_.defects;
  for (const EdgeTally& tally : tallies) {
    defects.open_edges += tally.defects.open_edges;
    defects.crowded_edges += tally.defects.crowded_edges;
    defects.misoriented_edges += tally.defects.misoriented_edges;
    defects.duplicate_triangles += tally.defects.duplicate_triangles;
  }
  if (defects.misoriented_edges > 0) {
    const std::vector<bool> turned = detail::flipped(halves_, context_);
    defects.flipped_triangles =
        static_cast<std::size_t>(std::count(turned.begin(), turned.end(), true));
    if (edge_defects) {
      *edge_defects = {detail::indices_of(turned), detail::open_edges(halves_, turned, context_)};
    }
  } else if (edge_defects) {
    std::vector<std::vector<EdgeDefects::OpenEdge>> open;
    open.reserve(tallies.size());
    for (EdgeTally& tally : tallies) open.push_back(std::move(tally.open));
    edge_defects->open = detail::joined(open);
  }
}

void Inspection::count_bodies() {
  in_chunks([&](Tally& tally, std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      tally.bodies += !halves_.degenerate(t) && bodies_.is_root(static_cast<std::uint32_t>(t));
    }
  });
  for (const Tally& tally : tallies_) report_.bodies += tally.bodies;
}

void Inspection::find_inside_out(EdgeDefects* edge_defects) {
  MeshDefects& defects = report_.defects;
  // Through holes nobody knows what lies in what.
  if (defects.open_edges + defects.misoriented_edges > 0) return;
  if (report_.bodies < 2) {
    defects.all_inside_out = mesh_.shares.empty() && report_.volume < 0;
    return;
  }
  const detail::InsideOut found = detail::inside_out(
      mesh_, [&](std::size_t t) { return bodies_.root(static_cast<std::uint32_t>(t)); });
  defects.inside_out_bodies = found.bodies;
  if (edge_defects) edge_defects->flipped = found.triangles;
  defects.all_inside_out = mesh_.shares.empty() && found.bodies == 0 && report_.volume < 0;
}

}  // namespace

std::vector<bool> flipped_triangles(const TriangleMesh& mesh, const ExecutionContext& context) {
  return detail::flipped(HalfEdges(mesh, context), context);
}

MeshReport inspect(const TriangleMesh& mesh, const ExecutionContext& context,
                   EdgeDefects* edge_defects) {
  const HalfEdges halves(mesh, context);
  if (edge_defects) *edge_defects = {};
  if (mesh.triangles.empty()) {
    MeshReport report;
    report.vertices = mesh.vertices.size();
    return report;
  }
  Inspection inspection(mesh, halves, context);
  inspection.find_box();
  inspection.measure_triangles();
  inspection.check_edges(edge_defects);
  inspection.count_bodies();
  inspection.find_inside_out(edge_defects);
  return inspection.report();
}

std::string describe(const MeshDefects& defects) {
  std::string text = defects.all_inside_out ? "all inside out, cut as if turned" : "";
  const auto add = [&](std::size_t count, const char* one, const char* many) {
    if (count == 0) return;
    if (!text.empty()) text += ", ";
    text += std::to_string(count) + " " + (count == 1 ? one : many);
  };
  add(defects.open_edges, "open edge", "open edges");
  add(defects.crowded_edges, "edge of more than two triangles", "edges of more than two triangles");
  add(defects.misoriented_edges, "misoriented edge", "misoriented edges");
  add(defects.flipped_triangles, "flipped triangle", "flipped triangles");
  add(defects.inside_out_bodies, "body inside out beside others, which is turned",
      "bodies inside out beside others, which are turned");
  add(defects.degenerate_triangles, "degenerate triangle", "degenerate triangles");
  add(defects.zero_area_triangles, "triangle of zero area", "triangles of zero area");
  add(defects.duplicate_triangles, "duplicate triangle", "duplicate triangles");
  return text;
}

namespace {

/// Before the triangles are appended.
void append_shares(TriangleMesh& mesh, const TriangleMesh& part) {
  std::vector<TriangleMesh::Share> more = part.shares;
  if (more.empty() && !part.triangles.empty()) more.emplace_back();
  if (mesh.shares.empty() && !mesh.triangles.empty()) mesh.shares.emplace_back();
  std::uint32_t solids = 0;
  for (const TriangleMesh::Share& share : mesh.shares) solids = std::max(solids, share.solid + 1);
  for (TriangleMesh::Share share : more) {
    share.first += static_cast<std::uint32_t>(mesh.triangles.size());
    share.solid += solids;
    mesh.shares.push_back(share);
  }
}

}  // namespace

SolidRole TriangleMesh::role_of(std::size_t triangle) const {
  if (shares.empty()) return SolidRole::added;
  const auto next =
      std::upper_bound(shares.begin(), shares.end(), triangle,
                       [](std::size_t t, const Share& share) { return t < share.first; });
  return std::prev(next)->role;
}

void append(TriangleMesh& mesh, const TriangleMesh& part) {
  if (mesh.vertices.size() + part.vertices.size() >= kNone) {
    throw InputError("the meshes have too many vertices together");
  }
  const auto offset = static_cast<std::uint32_t>(mesh.vertices.size());
  const std::size_t count = part.triangles.size();  // `part` may be `mesh` itself
  if (!mesh.shares.empty() || !part.shares.empty()) append_shares(mesh, part);
  mesh.vertices.reserve(mesh.vertices.size() + part.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
  mesh.triangles.reserve(mesh.triangles.size() + count);
  for (std::size_t t = 0; t < count; ++t) {
    const auto& corners = part.triangles[t];
    mesh.triangles.push_back({corners[0] + offset, corners[1] + offset, corners[2] + offset});
  }
}

void append(EdgeDefects& edge_defects, const TriangleMesh& mesh, const EdgeDefects& part) {
  const auto vertices = static_cast<std::uint32_t>(mesh.vertices.size());
  const auto triangles = static_cast<std::uint32_t>(mesh.triangles.size());
  for (const std::uint32_t t : part.flipped) edge_defects.flipped.push_back(t + triangles);
  for (const EdgeDefects::OpenEdge& e : part.open) {
    edge_defects.open.push_back({e.low + vertices, e.high + vertices, e.surplus});
  }
}

}  // namespace slicecorr
