// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/half_edges.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <limits>
#include <string>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
/// The sides of so many vertices fit the caches while they are sorted.
constexpr std::size_t kVerticesPerChunk = 1 << 14;
/// Sides are handed out to no more chunks at once than this: each is a place in memory that is
/// written to.
constexpr std::size_t kMostChunks = 512;
constexpr std::size_t kTrianglesPerPart = 1 << 15, kMostParts = 256;

void throw_invalid(const TriangleMesh& mesh) {
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t index : mesh.triangles[t]) {
      if (index < mesh.vertices.size()) continue;
      throw InputError("triangle " + std::to_string(t + 1) + ": vertex index " +
                       std::to_string(index) + " is out of range, the mesh has " +
                       std::to_string(mesh.vertices.size()) + " vertices");
    }
  }
}

}  // namespace

HalfEdges::HalfEdges(const TriangleMesh& mesh, const ExecutionContext& context)
    : mesh_(mesh),
      vertices_per_chunk_(std::bit_ceil(
          std::max(kVerticesPerChunk, (mesh.vertices.size() + kMostChunks - 1) / kMostChunks))) {
  const std::size_t triangles = mesh.triangles.size();
  // Corners are kept with one more bit.
  if (triangles > kNone / 6) throw InputError("the mesh has too many triangles");
  const ExecutionContext quiet = silent(context);
  const std::size_t chunks = (mesh.vertices.size() + vertices_per_chunk_ - 1) / vertices_per_chunk_;
  const int shift = std::countr_zero(vertices_per_chunk_);
  const std::size_t per_part =
      std::max(kTrianglesPerPart, (triangles + kMostParts - 1) / kMostParts);
  const std::size_t parts = (triangles + per_part - 1) / per_part;
  const auto sides_of = [&](std::size_t part, const auto& each) {
    const std::size_t end = std::min(triangles, (part + 1) * per_part);
    for (std::size_t t = part * per_part; t < end; ++t) {
      const auto& v = mesh.triangles[t];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = v[k], b = v[k == 2 ? 0 : k + 1];
        if (a != b) each(a, b, static_cast<std::uint32_t>(3 * t + k));
      }
    }
  };
  degenerate_ = std::make_unique_for_overwrite<std::uint8_t[]>(triangles);
  // Of each part and chunk: how many sides, then where they go.
  std::vector<std::size_t> at(parts * chunks, 0);
  std::atomic<bool> invalid = false;
  parallel_for(quiet, "", parts, [&](std::size_t part) {
    const std::size_t end = std::min(triangles, (part + 1) * per_part);
    for (std::size_t t = part * per_part; t < end; ++t) {
      const auto& v = mesh.triangles[t];
      if (std::max({v[0], v[1], v[2]}) >= mesh.vertices.size()) {
        invalid = true;
        return;
      }
      const Point3 &a = mesh.vertices[v[0]], &b = mesh.vertices[v[1]], &c = mesh.vertices[v[2]];
      degenerate_[t] = a == b || b == c || c == a;
    }
    std::size_t* const count = at.data() + part * chunks;
    sides_of(part, [&](std::uint32_t a, std::uint32_t b, std::uint32_t) {
      ++count[std::min(a, b) >> shift];
    });
  });
  if (invalid) throw_invalid(mesh);
  begin_.resize(chunks + 1);
  std::size_t sum = 0;
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    begin_[chunk] = sum;
    for (std::size_t k = chunk; k < at.size(); k += chunks) sum += std::exchange(at[k], sum);
  }
  begin_[chunks] = sum;
  sides_ = std::make_unique_for_overwrite<Side[]>(sum);
  parallel_for(quiet, "", parts, [&](std::size_t part) {
    std::size_t* const next = at.data() + part * chunks;
    sides_of(part, [&](std::uint32_t a, std::uint32_t b, std::uint32_t corner) {
      const std::uint32_t low = std::min(a, b);
      sides_[next[low >> shift]++] = {low, {std::max(a, b), corner, a < b}};
    });
  });
}

HalfEdges::Sorted HalfEdges::sorted(std::size_t chunk) const {
  const std::size_t first = chunk * vertices_per_chunk_;
  const std::size_t vertices = std::min(mesh_.vertices.size() - first, vertices_per_chunk_);
  const std::span<const Side> all(sides_.get() + begin_[chunk], begin_[chunk + 1] - begin_[chunk]);
  Sorted s;
  // Counted two places further on: filling moves the beginnings to where they belong.
  s.begin.resize(vertices + 2, 0);
  for (const Side& side : all) ++s.begin[side.low - first + 2];
  for (std::size_t v = 2; v < s.begin.size(); ++v) s.begin[v] += s.begin[v - 1];
  s.sides = std::make_unique_for_overwrite<HalfEdge[]>(all.size());
  for (const Side& side : all) s.sides[s.begin[side.low - first + 1]++] = side.half;
  s.begin.pop_back();
  // Corners of equal edges are in order already.
  for (std::size_t v = 0; v < vertices; ++v) {
    HalfEdge* const from = s.sides.get() + s.begin[v];
    HalfEdge* const to = s.sides.get() + s.begin[v + 1];
    if (to - from > 32) {
      std::stable_sort(from, to,
                       [](const HalfEdge& a, const HalfEdge& b) { return a.high() < b.high(); });
      continue;
    }
    for (HalfEdge* i = from + 1; i < to; ++i) {
      const HalfEdge side = *i;
      HalfEdge* k = i;
      for (; k > from && side.high() < k[-1].high(); --k) *k = k[-1];
      *k = side;
    }
  }
  return s;
}

std::vector<bool> flipped(const HalfEdges& halves, const ExecutionContext& context) {
  const std::size_t count = halves.mesh().triangles.size();
  std::vector<bool> turned(count, false);
  // Across edges of two triangles, the side that the other one has.
  std::vector<std::uint32_t> mate(3 * count, kNone);
  std::atomic<bool> any = false;
  halves.for_each(context, [&](std::size_t, std::uint32_t, std::span<const HalfEdge> sides) {
    std::uint32_t two[2] = {};
    std::size_t n = 0;
    for (const HalfEdge& side : sides) {
      if (halves.degenerate(side.triangle())) continue;
      if (n < 2) two[n] = side.corner();
      ++n;
    }
    if (n != 2) return;
    mate[two[0]] = two[1];
    mate[two[1]] = two[0];
    if (halves.rises(two[0]) == halves.rises(two[1])) any.store(true, std::memory_order_relaxed);
  });
  if (!any) return turned;

  std::vector<bool> seen(count, false);
  std::vector<std::uint32_t> part;  // of one connected part: visited, then still to visit
  for (std::uint32_t start = 0; start < count; ++start) {
    if (seen[start] || halves.degenerate(start)) continue;
    part.assign(1, start);
    seen[start] = true;
    std::size_t turned_count = 0;
    for (std::size_t next = 0; next < part.size(); ++next) {
      const std::uint32_t t = part[next];
      turned_count += turned[t];
      for (std::uint32_t corner = 3 * t; corner < 3 * t + 3; ++corner) {
        if (mate[corner] == kNone) continue;
        const std::uint32_t other = mate[corner] / 3;
        if (seen[other]) continue;
        seen[other] = true;
        turned[other] = turned[t] != (halves.rises(corner) == halves.rises(mate[corner]));
        part.push_back(other);
      }
    }
    if (2 * turned_count > part.size()) {
      for (const std::uint32_t t : part) turned[t] = !turned[t];
    }
  }
  return turned;
}

std::vector<EdgeDefects::OpenEdge> open_edges(const HalfEdges& halves,
                                              const std::vector<bool>& turned,
                                              const ExecutionContext& context) {
  std::vector<std::vector<EdgeDefects::OpenEdge>> found(halves.chunks());
  halves.for_each(context,
                  [&](std::size_t chunk, std::uint32_t low, std::span<const HalfEdge> sides) {
                    std::int32_t surplus = 0;
                    for (const HalfEdge& side : sides) {
                      const bool turns = !turned.empty() && turned[side.triangle()];
                      surplus += side.rises() != turns ? 1 : -1;
                    }
                    if (surplus != 0) found[chunk].push_back({low, sides[0].high(), surplus});
                  });
  return joined(found);
}

EdgeDefects edge_defects_of(const TriangleMesh& mesh, const ExecutionContext& context) {
  const HalfEdges halves(mesh, context);
  const std::vector<bool> turned = flipped(halves, context);
  return {indices_of(turned), open_edges(halves, turned, context)};
}

}  // namespace slicecorr::detail
