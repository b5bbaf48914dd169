// STL is read here and not through OpenMesh: its readers drop degenerate triangles, merge vertices
// with an epsilon, accept files cut in the middle, and take the count of a binary file on trust.
// This is also no slower (a hash instead of a std::map).
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "mesh/half_edges.hpp"
#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kHeader = 84, kRecord = 50;

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool same_word(std::string_view word, std::string_view keyword) {
  if (word.size() != keyword.size()) return false;
  for (std::size_t i = 0; i < word.size(); ++i) {
    if (lower(word[i]) != keyword[i]) return false;
  }
  return true;
}

// Many binary files begin with "solid" too, so the word alone proves nothing. Text has no zero
// bytes; a binary record holds some as good as always.
bool looks_ascii(const std::string& bytes) {
  WordReader words(bytes, "");
  if (!same_word(words.word(), "solid")) return false;
  return bytes.substr(0, 1024).find('\0') == std::string::npos;
}

std::uint32_t little_u32(const char* at) {
  std::uint32_t value = 0;
  for (int i = 3; i >= 0; --i) value = value << 8 | static_cast<unsigned char>(at[i]);
  return value;
}

/// Corners by the place they are at, three floats as they are in the file.
struct Place {
  float x, y, z;
  bool operator==(const Place&) const = default;
};

Place place_at(const char* at) {
  // Adding 0 turns -0 into 0: the same place.
  return {std::bit_cast<float>(little_u32(at)) + 0.0F,
          std::bit_cast<float>(little_u32(at + 4)) + 0.0F,
          std::bit_cast<float>(little_u32(at + 8)) + 0.0F};
}

std::uint64_t hash_of(const Place& p) {
  const std::uint64_t xy =
      std::uint64_t{std::bit_cast<std::uint32_t>(p.x)} << 32 | std::bit_cast<std::uint32_t>(p.y);
  return mix(mix(xy + 0x9e3779b97f4a7c15u) ^ std::bit_cast<std::uint32_t>(p.z));
}

/// Equal corners get one index, in the order of first appearance. Corners are dealt out by their
/// hash, equal ones to the same share; shares are independent of each other.
TriangleMesh read_binary(const std::string& bytes, const std::string& path, std::size_t count,
                         const Job& job) {
  if (count > std::numeric_limits<std::uint32_t>::max() / 3) {
    throw InputError(path, "", "has more than 1431655765 triangles");
  }
  const Job quiet = silent(job);
  constexpr std::size_t kChunk = 1 << 15;
  constexpr std::size_t kShares = 256;
  const std::size_t chunks = (count + kChunk - 1) / kChunk, corners = 3 * count;
  const auto corner_at = [&](std::size_t corner) {
    return bytes.data() + kHeader + corner / 3 * kRecord + 12 +
           12 * (corner % 3);  // past the normal
  };
  const auto corners_of = [&](std::size_t chunk, const auto& each) {
    const std::size_t end = std::min(corners, 3 * kChunk * (chunk + 1));
    for (std::size_t c = 3 * kChunk * chunk; c < end; ++c) each(c);
  };
  // How many corners of each chunk go to each share; then where they begin there.
  std::vector<std::array<std::uint32_t, kShares>> begin(chunks);
  std::vector<std::uint8_t> share(corners);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    auto& counts = begin[chunk];
    counts.fill(0);
    corners_of(chunk, [&](std::size_t c) {
      const Place p = place_at(corner_at(c));
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        require_finite({p.x, p.y, p.z}, path, "triangle " + std::to_string(c / 3 + 1));
      }
      share[c] = static_cast<std::uint8_t>(hash_of(p) >> 56);
      ++counts[share[c]];
    });
  });
  std::array<std::uint32_t, kShares + 1> share_begin{};
  std::uint32_t sum = 0;
  for (std::size_t s = 0; s < kShares; ++s) {
    share_begin[s] = sum;
    for (auto& counts : begin) sum += std::exchange(counts[s], sum);
  }
  share_begin[kShares] = sum;
  std::vector<std::uint32_t> dealt(corners);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    auto& at = begin[chunk];
    corners_of(chunk,
               [&](std::size_t c) { dealt[at[share[c]]++] = static_cast<std::uint32_t>(c); });
  });
  share = {};
  // For each corner the first one at its place.
  TriangleMesh mesh;
  mesh.triangles.resize(count);
  std::uint32_t* const first = mesh.triangles[0].data();
  parallel_for(quiet, "", kShares, [&](std::size_t s) {
    const std::size_t n = share_begin[s + 1] - share_begin[s];
    const std::size_t size = std::bit_ceil(std::max<std::size_t>(16, n));  // closed: n / 6 places
    struct Slot {
      Place place;
      std::uint32_t corner;
    };
    constexpr std::uint32_t kFree = std::numeric_limits<std::uint32_t>::max();
    std::vector<Slot> slots(2 * size, Slot{{}, kFree});
    for (std::size_t i = 0; i < n; ++i) {
      const std::uint32_t c = dealt[share_begin[s] + i];
      const Place p = place_at(corner_at(c));
      std::size_t slot = hash_of(p) & (2 * size - 1);
      while (slots[slot].corner != kFree && !(slots[slot].place == p)) {
        slot = (slot + 1) & (2 * size - 1);
      }
      if (slots[slot].corner == kFree) slots[slot] = {p, c};
      first[c] = slots[slot].corner;
    }
  });
  dealt = {};
  // Numbers in the order of first appearance.
  std::vector<std::uint32_t> number(corners), vertices(chunks + 1, 0);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    corners_of(chunk, [&](std::size_t c) { vertices[chunk + 1] += first[c] == c; });
  });
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) vertices[chunk + 1] += vertices[chunk];
  mesh.vertices.resize(vertices[chunks]);
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    std::uint32_t next = vertices[chunk];
    corners_of(chunk, [&](std::size_t c) {
      if (first[c] != c) return;
      const Place p = place_at(corner_at(c));
      mesh.vertices[next] = {p.x, p.y, p.z};
      number[c] = next++;
    });
  });
  parallel_for(quiet, "", chunks, [&](std::size_t chunk) {
    corners_of(chunk, [&](std::size_t c) { first[c] = number[first[c]]; });
  });
  return mesh;
}

// Several solids may follow each other. Normals are skipped: they are often wrong, and the order of
// the corners says the same.
TriangleMesh read_ascii(const std::string& bytes, const std::string& path) {
  TriangleMesh mesh;
  VertexPool pool(bytes.size() / 500);
  WordReader words(bytes, path);
  bool in_solid = false;
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
  for (std::string_view word = words.word(); !word.empty(); word = words.word()) {
    if (same_word(word, "solid")) {
      in_solid = true;
      solid_line = words.line();
      words.skip_line();
    } else if (same_word(word, "endsolid")) {
      in_solid = false;
      words.skip_line();
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

TriangleMesh read_stl(const std::string& bytes, const std::string& path, const Job& job) {
  TriangleMesh mesh;
  const std::size_t count = bytes.size() < kHeader ? 0 : little_u32(bytes.data() + 80);
  if (bytes.size() >= kHeader && bytes.size() == kHeader + kRecord * count) {
    if (count > 0) mesh = read_binary(bytes, path, count, job);
  } else if (looks_ascii(bytes)) {
    mesh = read_ascii(bytes, path);
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
