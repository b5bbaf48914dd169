// STL is read here and not through OpenMesh: its readers drop degenerate triangles, merge vertices
// with an epsilon, accept files cut in the middle, and take the count of a binary file on trust.
// This is also no slower (a hash instead of a std::map).
#include <cmath>
#include <cstring>

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

double little_float(const char* at) { return std::bit_cast<float>(little_u32(at)); }

TriangleMesh read_binary(const std::string& bytes, const std::string& path, std::size_t count) {
  TriangleMesh mesh;
  mesh.triangles.reserve(count);
  VertexPool pool(count / 2 + 3);  // closed meshes have about half as many vertices as triangles
  for (std::size_t t = 0; t < count; ++t) {
    const char* record = bytes.data() + kHeader + t * kRecord + 12;  // past the normal
    std::array<std::uint32_t, 3> triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const char* at = record + 12 * k;
      const Point3 point{little_float(at), little_float(at + 4), little_float(at + 8)};
      if (!std::isfinite(point[0] + point[1] + point[2])) {
        require_finite(point, path, "triangle " + std::to_string(t + 1));
      }
      triangle[k] = pool.index(point);
    }
    mesh.triangles.push_back(triangle);
  }
  mesh.vertices = pool.take();
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

TriangleMesh read_stl(const std::string& bytes, const std::string& path) {
  TriangleMesh mesh;
  const std::size_t count = bytes.size() < kHeader ? 0 : little_u32(bytes.data() + 80);
  if (bytes.size() >= kHeader && bytes.size() == kHeader + kRecord * count) {
    mesh = read_binary(bytes, path, count);
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
