#include "mesh/half_edges.hpp"

#include <algorithm>
#include <atomic>
#include <limits>
#include <string>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t kTrianglesPerChunk = 1 << 15;
constexpr std::size_t kVerticesPerChunk = 1 << 14;

void require_valid(const TriangleMesh& mesh) {
  if (mesh.triangles.size() > kNone / 3) throw InputError("the mesh has too many triangles");
  std::uint32_t most = 0;
  for (const auto& t : mesh.triangles) most = std::max({most, t[0], t[1], t[2]});
  if (mesh.triangles.empty() || most < mesh.vertices.size()) return;
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

HalfEdges::HalfEdges(const TriangleMesh& mesh, const Job& job) : mesh_(mesh) {
  require_valid(mesh);
  const Job quiet = silent(job);
  const std::size_t triangles = mesh.triangles.size();
  const std::size_t chunks = (triangles + kTrianglesPerChunk - 1) / kTrianglesPerChunk;
  degenerate_.resize(triangles);
  begin_.assign(mesh.vertices.size() + 2, 0);
  const bool alone = thread_count(quiet) == 1;
  const auto next = [alone](std::uint32_t& count) {
    return alone ? count++
                 : std::atomic_ref<std::uint32_t>(count).fetch_add(1, std::memory_order_relaxed);
  };
  const auto sides_of = [&](std::size_t chunk, const auto& each) {
    const std::size_t end = std::min(triangles, (chunk + 1) * kTrianglesPerChunk);
    for (std::size_t t = chunk * kTrianglesPerChunk; t < end; ++t) {
      const auto& v = mesh.triangles[t];
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = v[k], b = v[k == 2 ? 0 : k + 1];
        if (a != b) each(std::min(a, b), std::max(a, b), static_cast<std::uint32_t>(3 * t + k));
      }
    }
  };
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    const std::size_t end = std::min(triangles, (chunk + 1) * kTrianglesPerChunk);
    for (std::size_t t = chunk * kTrianglesPerChunk; t < end; ++t) {
      const auto& v = mesh.triangles[t];
      const Point3 &a = mesh.vertices[v[0]], &b = mesh.vertices[v[1]], &c = mesh.vertices[v[2]];
      degenerate_[t] = a == b || b == c || c == a;
    }
    sides_of(chunk,
             [&](std::uint32_t low, std::uint32_t, std::uint32_t) { next(begin_[low + 2]); });
  });
  for (std::size_t v = 2; v < begin_.size(); ++v) begin_[v] += begin_[v - 1];
  sides_.resize(begin_.back());
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    sides_of(chunk, [&](std::uint32_t low, std::uint32_t high, std::uint32_t corner) {
      sides_[next(begin_[low + 1])] = {high, corner};
    });
  });
  // Whoever came first: from here on the order is that of the mesh.
  parallel_for(quiet, "", this->chunks(), [&](std::size_t chunk) {
    const std::size_t end = std::min(mesh.vertices.size(), (chunk + 1) * kVerticesPerChunk);
    for (std::size_t v = chunk * kVerticesPerChunk; v < end; ++v) {
      HalfEdge* const from = sides_.data() + begin_[v];
      HalfEdge* const to = sides_.data() + begin_[v + 1];
      const auto before = [](const HalfEdge& a, const HalfEdge& b) {
        return a.high != b.high ? a.high < b.high : a.corner < b.corner;
      };
      if (to - from > 32) {
        std::sort(from, to, before);
        continue;
      }
      for (HalfEdge* i = from + 1; i < to; ++i) {
        const HalfEdge side = *i;
        HalfEdge* k = i;
        for (; k > from && before(side, k[-1]); --k) *k = k[-1];
        *k = side;
      }
    }
  });
}

std::size_t HalfEdges::chunks() const {
  return (mesh_.vertices.size() + kVerticesPerChunk - 1) / kVerticesPerChunk;
}

void HalfEdges::for_each(
    const Job& job,
    const std::function<void(std::size_t, std::uint32_t, std::span<const HalfEdge>)>& each) const {
  parallel_for(silent(job), "", chunks(), [&](std::size_t chunk) {
    const std::size_t end = std::min(mesh_.vertices.size(), (chunk + 1) * kVerticesPerChunk);
    for (std::size_t v = chunk * kVerticesPerChunk; v < end; ++v) {
      for (std::uint32_t i = begin_[v]; i < begin_[v + 1];) {
        std::uint32_t past = i + 1;
        while (past < begin_[v + 1] && sides_[past].high == sides_[i].high) ++past;
        each(chunk, static_cast<std::uint32_t>(v), {sides_.data() + i, past - i});
        i = past;
      }
    }
  });
}

std::vector<bool> flipped(const HalfEdges& halves, const Job& job) {
  const std::size_t count = halves.mesh().triangles.size();
  std::vector<bool> turned(count, false);
  // Across edges of two triangles, the side that the other one has.
  std::vector<std::uint32_t> mate(3 * count, kNone);
  std::atomic<bool> any = false;
  halves.for_each(job, [&](std::size_t, std::uint32_t, std::span<const HalfEdge> sides) {
    std::uint32_t two[2] = {};
    std::size_t n = 0;
    for (const HalfEdge& side : sides) {
      if (halves.degenerate(side.corner / 3)) continue;
      if (n < 2) two[n] = side.corner;
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

std::vector<OpenEdge> open_edges(const HalfEdges& halves, const std::vector<bool>& turned,
                                 const Job& job) {
  std::vector<std::vector<OpenEdge>> found(halves.chunks());
  halves.for_each(job, [&](std::size_t chunk, std::uint32_t low, std::span<const HalfEdge> sides) {
    std::int32_t surplus = 0;
    for (const HalfEdge& side : sides) {
      surplus += halves.rises(side.corner) != turned[side.corner / 3] ? 1 : -1;
    }
    if (surplus != 0) found[chunk].push_back({low, sides[0].high, surplus});
  });
  std::vector<OpenEdge> all;
  for (const auto& edges : found) all.insert(all.end(), edges.begin(), edges.end());
  return all;
}

}  // namespace slicecorr::detail
