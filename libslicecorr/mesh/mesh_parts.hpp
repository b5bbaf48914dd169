// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Private to the module mesh: what the readers of the single formats share.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Room for a whole file. Unlike that of a string it isn't cleared before the file is read into it,
/// which takes longer than reading a large one.
class FileBytes {
 public:
  char* data() { return data_.get(); }
  std::size_t size() const { return size_; }
  std::string_view view() const { return {data_.get(), size_}; }
  /// What is added is undefined.
  void resize(std::size_t size);

 private:
  struct Free {
    void operator()(char* data) const { std::free(data); }
  };
  std::unique_ptr<char, Free> data_;
  std::size_t size_ = 0;
};

/// The whole content of a file, unpacked when its name ends in `.gz`. Plain ones are read by all
/// threads.
FileBytes read_bytes(const std::string& path, const ExecutionContext& context);

/// A finaliser with good avalanche (splitmix64), so that grids of coordinates do not cluster.
inline std::uint64_t mix(std::uint64_t x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9u;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

/// Gives equal points the same index, in the order of first appearance.
class VertexPool {
 public:
  explicit VertexPool(std::size_t expected);
  /// -0.0 and 0.0 are the same place; both are stored as 0.0.
  std::uint32_t index(const Point3& point);
  std::vector<Point3> take() { return std::move(points_); }

 private:
  void grow();
  static constexpr std::uint32_t kFree = std::numeric_limits<std::uint32_t>::max();
  std::vector<Point3> points_;
  std::vector<std::uint32_t> slots_;  // indices into points_, open addressing
  std::size_t mask_ = 0;
};

/// Collects what a reader finds in an indexed file, then makes the mesh: checks indices, splits
/// polygons into fans, merges equal vertices and drops those that no face uses.
class PolygonMesh {
 public:
  explicit PolygonMesh(std::string path) : path_(std::move(path)) {}
  std::size_t add_vertex(const Point3& point);
  void set_vertex(std::size_t index, const Point3& point) { vertices_.at(index) = point; }
  /// `line` is told in errors about this face; 0 when the format has no lines.
  void begin_face(std::size_t line = 0);
  void add_corner(std::int64_t index) { corners_.push_back(index); }
  std::size_t vertex_count() const { return vertices_.size(); }
  std::size_t face_count() const { return first_corner_.size(); }
  /// `or_points`: where there is no face at all, all points, without a triangle.
  TriangleMesh finish(bool or_points = false);

 private:
  std::string path_;
  std::vector<Point3> vertices_;
  std::vector<std::int64_t> corners_;  // as the file gives them, checked in finish()
  std::vector<std::size_t> first_corner_;
  std::vector<std::size_t> lines_;
};

/// Throws `InputError` unless the point is finite.
void require_finite(const Point3& point, const std::string& path, const std::string& place);

/// Throws the `InputError` for a file without triangles.
[[noreturn]] void throw_no_triangles(const std::string& path);

/// A text without the byte-order mark of UTF-8 that it may begin with. Throws `InputError` where it has
/// that of UTF-16 or UTF-32.
std::string_view without_mark(std::string_view text, const std::string& path);

/// Reads words from a text whose lines end in LF, CR or CRLF, and counts the lines.
class WordReader {
 public:
  WordReader(std::string_view text, const std::string& path) : text_(text), path_(path) {}
  /// The next word of the whole text; empty at its end.
  std::string_view word();
  /// The next word of the current line; empty at the end of the line (which is not passed).
  std::string_view word_in_line();
  void skip_line();
  bool at_end();
  /// A backslash at the end of a line joins the next one to it (OBJ).
  void join_continued_lines() { joins_lines_ = true; }
  /// `#` starts a comment up to the end of the line.
  void skip_comments() { skips_comments_ = true; }
  std::size_t line() const { return line_; }
  std::string place() const { return "line " + std::to_string(line_); }
  /// The word as a finite number; an error names the line, what it is and the word.
  double number(std::string_view word, const char* what) const;
  std::int64_t integer(std::string_view word, const char* what) const;
  [[noreturn]] void fail(const std::string& message) const;

 private:
  bool pass_gap(bool in_line);
  void pass_line_end();
  std::string_view text_;
  const std::string& path_;
  std::size_t at_ = 0;
  std::size_t line_ = 1;
  bool joins_lines_ = false;
  bool skips_comments_ = false;
};

TriangleMesh read_stl(std::string_view bytes, const std::string& path,
                      const ExecutionContext& context);
/// `notes`: as for `read_3mf`. `or_points`: as for `PolygonMesh::finish`.
TriangleMesh read_obj(std::string_view bytes, const std::string& path,
                      std::vector<std::string>& notes, bool or_points);
TriangleMesh read_off(std::string_view bytes, const std::string& path);
TriangleMesh read_ply(std::string_view bytes, const std::string& path, bool or_points);

/// Also gives the length of the file's unit in mm. `placement`: how the mesh is scaled later, which
/// says how finely round beams are cut into triangles. `notes`: gets a line for each kind of thing in
/// the file that is no part of the mesh.
TriangleMesh read_3mf(std::string_view bytes, const std::string& path, const Placement& placement,
                      double& unit_mm, std::vector<std::string>& notes);

/// The factor from lengths of a file to mm, where its own unit is so long.
double scale_to_mm(const Placement& placement, double file_unit_mm);

/// Lets OpenMesh parse `text` (extension `off`), which must be in its plainest form.
TriangleMesh parse_with_openmesh(std::string text, const std::string& extension, bool binary,
                                 std::size_t vertices, std::size_t faces, const std::string& path);

}  // namespace slicecorr::detail
