// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// STL is read here and not through OpenMesh: its readers drop degenerate triangles, merge vertices
// with an epsilon, accept files cut in the middle, and take the count of a binary file on trust.
// This is also no slower (a hash instead of a std::map).
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>

#include "mesh/mesh_parts.hpp"
#include "parallel/silent.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kHeader = 84, kRecord = 50;
constexpr std::size_t kCornersPerChunk = 3 << 15;

bool same_word(std::string_view word, std::string_view keyword) {
  if (word.size() != keyword.size()) return false;
  for (std::size_t i = 0; i < word.size(); ++i) {
    if (lower_case(word[i]) != keyword[i]) return false;
  }
  return true;
}

// Many binary files begin with "solid" too, so the word alone proves nothing. Text has no zero
// bytes; a binary record holds some as good as always.
bool looks_ascii(std::string_view bytes) {
  WordReader words(bytes, "");
  if (!same_word(words.word(), "solid")) return false;
  return bytes.substr(0, 1024).find('\0') == std::string::npos;
}

std::uint32_t little_u32(const char* at) {
  std::uint32_t value = 0;
  if constexpr (std::endian::native == std::endian::little) {
    std::memcpy(&value, at, sizeof value);
    return value;
  }
  for (int i = 3; i >= 0; --i) value = value << 8 | static_cast<unsigned char>(at[i]);
  return value;
}

/// Corners by the place they are at, three floats as they are in the file.
struct Corner {
  float x, y, z;
  bool operator==(const Corner&) const = default;
};

inline Corner corner_at(std::string_view bytes, std::size_t corner) {
  const char* at = bytes.data() + kHeader + corner / 3 * kRecord + 12 + 12 * (corner % 3);
  // Adding 0 turns -0 into 0: the same place.
  return {std::bit_cast<float>(little_u32(at)) + 0.0F,
          std::bit_cast<float>(little_u32(at + 4)) + 0.0F,
          std::bit_cast<float>(little_u32(at + 8)) + 0.0F};
}

std::uint64_t hash_of(const Corner& p) {
  const std::uint64_t xy =
      std::uint64_t{std::bit_cast<std::uint32_t>(p.x)} << 32 | std::bit_cast<std::uint32_t>(p.y);
  return mix(mix(xy + 0x9e3779b97f4a7c15u) ^ std::bit_cast<std::uint32_t>(p.z));
}

constexpr std::uint32_t kFree = std::numeric_limits<std::uint32_t>::max();

/// Memory that nothing is written to before it is used: clearing it would be one thread's work.
std::unique_ptr<std::uint32_t[]> uncleared(std::size_t size) {
  return std::make_unique_for_overwrite<std::uint32_t[]>(size);
}

std::size_t corner_chunks(std::size_t corners) {
  return (corners + kCornersPerChunk - 1) / kCornersPerChunk;
}

/// Calls `each(corner)` for the corners of a chunk.
template <class Each>
void in_chunk(std::size_t chunk, std::size_t corners, const Each& each) {
  const std::size_t end = std::min(corners, kCornersPerChunk * (chunk + 1));
  for (std::size_t c = kCornersPerChunk * chunk; c < end; ++c) each(c);
}

void require_finite_corners(std::string_view bytes, const std::string& path, std::size_t corners) {
  for (std::size_t c = 0; c < corners; ++c) {
    const Corner p = corner_at(bytes, c);
    require_finite({p.x, p.y, p.z}, path, "triangle " + std::to_string(c / 3 + 1));
  }
}

enum class Found { all, too_small, not_finite };

/// For each corner the first one at its place, by a hash table that all threads fill at once: a
/// slot is taken for good by whoever comes first, and keeps the lowest corner of its place.
Found find_first(std::string_view bytes, std::size_t corners, std::size_t size,
                 const ExecutionContext& context, std::uint32_t* first) {
  constexpr std::size_t most_probes = 4096, recent_corners = 4096,
                        slots_per_chunk = std::size_t{1} << 18;
  constexpr std::size_t ahead_corners = 16;
  // Neighbouring triangles share corners: most places were seen a moment ago, and the table is
  // larger than the caches. Whoever was seen in this chunk is not after the corner at hand.
  struct Recent {
    Corner place;
    std::uint32_t slot = kFree;
  };
  const auto slots = uncleared(size);
  parallel_for(context, "", (size + slots_per_chunk - 1) / slots_per_chunk, [&](std::size_t chunk) {
    const std::size_t from = slots_per_chunk * chunk;
    std::fill_n(slots.get() + from, std::min(slots_per_chunk, size - from), kFree);
  });
  std::atomic<Found> result = Found::all;
  parallel_for(context, "", corner_chunks(corners), [&](std::size_t chunk) {
    const std::size_t end = std::min(corners, kCornersPerChunk * (chunk + 1));
    std::vector<Recent> recent(recent_corners);
    // Slots are asked for some corners ahead: the table is far from the processor.
    std::array<std::uint64_t, ahead_corners> hashes;
    const auto look_ahead = [&](std::size_t c) {
      if (c >= end) return;
      hashes[c % ahead_corners] = hash_of(corner_at(bytes, c));
      __builtin_prefetch(&slots[hashes[c % ahead_corners] & (size - 1)], 1);
    };
    const std::size_t begin = kCornersPerChunk * chunk;
    for (std::size_t c = begin; c < begin + ahead_corners; ++c) look_ahead(c);
    for (std::size_t c = begin; c < end && result.load(std::memory_order_relaxed) == Found::all;
         ++c) {
      const auto corner = static_cast<std::uint32_t>(c);
      const Corner place = corner_at(bytes, c);
      const std::uint64_t hash = hashes[c % ahead_corners];
      look_ahead(c + ahead_corners);
      Recent& seen = recent[hash >> 32 & (recent_corners - 1)];
      if (seen.slot != kFree && seen.place == place) {
        first[c] = seen.slot;
        continue;
      }
      if (!(std::isfinite(place.x) && std::isfinite(place.y) && std::isfinite(place.z))) {
        result = Found::not_finite;
        return;
      }
      std::size_t slot = hash & (size - 1);
      for (std::size_t probes = 0;; slot = (slot + 1) & (size - 1)) {
        std::atomic_ref<std::uint32_t> held(slots[slot]);
        std::uint32_t other = held.load(std::memory_order_relaxed);
        if (other == kFree &&
            held.compare_exchange_strong(other, corner, std::memory_order_relaxed))
          break;
        if (corner_at(bytes, other) == place) {
          while (corner < other &&
                 !held.compare_exchange_weak(other, corner, std::memory_order_relaxed)) {
          }
          break;
        }
        if (++probes == most_probes) {
          // What is not finite is said, also where the table is full.
          Found none = Found::all;
          result.compare_exchange_strong(none, Found::too_small);
          return;
        }
      }
      first[c] = static_cast<std::uint32_t>(slot);
      seen = {place, first[c]};
    }
  });
  if (result != Found::all) return result;
  parallel_for(context, "", corner_chunks(corners), [&](std::size_t chunk) {
    in_chunk(chunk, corners, [&](std::size_t c) { first[c] = slots[first[c]]; });
  });
  return Found::all;
}

/// Equal corners get one index, in the order of first appearance.
TriangleMesh read_binary(std::string_view bytes, const std::string& path, std::size_t count,
                         const ExecutionContext& context) {
  if (count > std::numeric_limits<std::uint32_t>::max() / 3) {
    throw InputError(path, "", "has more than 1431655765 triangles");
  }
  const ExecutionContext quiet = silent(context);
  const std::size_t corners = 3 * count, chunks = corner_chunks(corners);
  TriangleMesh mesh;
  mesh.triangles.resize(count);
  std::uint32_t* const first = mesh.triangles[0].data();
  // Closed meshes have about half as many vertices as triangles, loose triangles six times as many.
  std::size_t size = std::bit_ceil(std::max<std::size_t>(64, 3 * count / 2));
  for (;; size *= 4) {
    const Found found = find_first(bytes, corners, size, quiet, first);
    if (found == Found::all) break;
    if (found == Found::not_finite) require_finite_corners(bytes, path, corners);
  }
  // Numbers in the order of first appearance.
  const auto number = uncleared(corners);
  std::vector<std::uint32_t> vertices(chunks + 1, 0);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    std::uint32_t sum = 0;
    in_chunk(chunk, corners, [&](std::size_t c) { sum += first[c] == c; });
    vertices[chunk + 1] = sum;
  });
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) vertices[chunk + 1] += vertices[chunk];
  mesh.vertices.resize(vertices[chunks]);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    std::uint32_t next = vertices[chunk];
    in_chunk(chunk, corners, [&](std::size_t c) {
      if (first[c] != c) return;
      const Corner p = corner_at(bytes, c);
      mesh.vertices[next] = {p.x, p.y, p.z};
      number[c] = next++;
    });
  });
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    in_chunk(chunk, corners, [&](std::size_t c) { first[c] = number[first[c]]; });
  });
  return mesh;
}

// Several solids may follow each other. Normals are skipped: they are often wrong, and the order of
// the corners says the same.
TriangleMesh read_ascii(std::string_view bytes, const std::string& path) {
  TriangleMesh mesh;
  VertexPool pool(bytes.size() / 500);
  WordReader words(bytes, path);
  bool in_solid = false, facet_begins = false;
  std::size_t solid_line = 0;
  std::vector<std::uint32_t> corners;
  const auto expect = [&](std::string_view keyword, const char* where) {
    const std::string_view word = words.word();
    if (same_word(word, keyword)) return;
    words.fail(word.empty()
                   ? "the file ends inside a facet, expected '" + std::string(keyword) + "'"
                   : "expected '" + std::string(keyword) + "' " + where + ", found '" +
                         std::string(word.substr(0, 40)) + "'");
  };
  // A name may be any words of the line; what follows it there, where a file has no lines, begins
  // with "facet normal". True where that was read.
  const auto skip_name = [&] {
    bool facet = false;
    for (auto word = words.word_in_line(); !word.empty(); word = words.word_in_line()) {
      if (facet && same_word(word, "normal")) return true;
      facet = same_word(word, "facet");
    }
    words.skip_line();
    return false;
  };
  for (;;) {
    std::string_view word = facet_begins ? "facet" : words.word();
    facet_begins = false;
    if (word.empty()) break;
    if (same_word(word, "solid")) {
      in_solid = true;
      solid_line = words.line();
      facet_begins = skip_name();
    } else if (same_word(word, "endsolid")) {
      facet_begins = skip_name();
      in_solid = facet_begins;
    } else if (same_word(word, "facet")) {
      const std::size_t facet_line = words.line();
      for (word = words.word(); !same_word(word, "outer"); word = words.word()) {
        if (word.empty() || same_word(word, "facet") || same_word(word, "endfacet")) {
          words.fail("the facet of line " + std::to_string(facet_line) + " has no 'outer loop'");
        }
      }
      expect("loop", "after 'outer'");
      corners.clear();
      for (word = words.word(); same_word(word, "vertex"); word = words.word()) {
        Point3 point;
        for (double& x : point) x = words.number(words.word(), "a coordinate");
        corners.push_back(pool.index(point));
      }
      if (!same_word(word, "endloop")) {
        words.fail(word.empty() ? "the file ends inside a facet, expected 'endloop'"
                                : "expected 'vertex' or 'endloop', found '" +
                                      std::string(word.substr(0, 40)) + "'");
      }
      expect("endfacet", "after 'endloop'");
      if (corners.size() < 3) {
        words.fail("the facet of line " + std::to_string(facet_line) + " has " +
                   std::to_string(corners.size()) + " corners, expected at least 3");
      }
      for (std::size_t k = 1; k + 1 < corners.size(); ++k) {
        mesh.triangles.push_back({corners[0], corners[k], corners[k + 1]});
      }
    } else {
      words.fail("expected 'facet', 'solid' or 'endsolid', found '" +
                 std::string(word.substr(0, 40)) + "'");
    }
  }
  if (in_solid) {
    words.fail("the file ends inside the solid of line " + std::to_string(solid_line) +
               ", expected 'endsolid'");
  }
  mesh.vertices = pool.take();
  return mesh;
}

}  // namespace

TriangleMesh read_stl(std::string_view bytes, const std::string& path,
                      const ExecutionContext& context) {
  TriangleMesh mesh;
  const std::size_t count = bytes.size() < kHeader ? 0 : little_u32(bytes.data() + 80);
  if (bytes.size() >= kHeader && bytes.size() == kHeader + kRecord * count) {
    if (count > 0) mesh = read_binary(bytes, path, count, context);
  } else if (const std::string_view text = without_mark(bytes, path); looks_ascii(text)) {
    mesh = read_ascii(text, path);
  } else if (bytes.size() < kHeader) {
    throw InputError(
        path, "",
        "is not an STL file: " + std::to_string(bytes.size()) +
            " bytes, and neither 'solid' at the start nor a binary header of 84 bytes");
  } else {
    throw InputError(path, "",
                     "is not an ascii STL, and as a binary one its size does not fit its count: " +
                         std::to_string(count) + " triangles need " +
                         std::to_string(kHeader + kRecord * count) + " bytes, the file has " +
                         std::to_string(bytes.size()));
  }
  if (mesh.triangles.empty()) throw_no_triangles(path);
  return mesh;
}

}  // namespace slicecorr::detail
