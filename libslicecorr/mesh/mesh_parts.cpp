// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/mesh_parts.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <new>

namespace slicecorr::detail {

void FileBytes::resize(std::size_t size) {
  void* const room = std::realloc(data_.get(), std::max<std::size_t>(size, 1));
  if (room == nullptr) throw std::bad_alloc();
  (void)data_.release();
  data_.reset(static_cast<char*>(room));
  size_ = size;
}

VertexPool::VertexPool(std::size_t expected) {
  const std::size_t size = std::bit_ceil(std::max<std::size_t>(16, 2 * expected));
  slots_.assign(size, kFree);
  mask_ = size - 1;
  points_.reserve(expected);
}

std::uint32_t VertexPool::index(const Point3& point) {
  const Point3 p{point[0] + 0.0, point[1] + 0.0, point[2] + 0.0};  // -0.0 + 0.0 is 0.0
  std::uint64_t hash = mix(std::bit_cast<std::uint64_t>(p[0]) + 0x9e3779b97f4a7c15u);
  hash = mix(hash ^ std::bit_cast<std::uint64_t>(p[1]));
  hash = mix(hash ^ std::bit_cast<std::uint64_t>(p[2]));
  std::size_t slot = hash & mask_;
  while (slots_[slot] != kFree) {
    if (points_[slots_[slot]] == p) return slots_[slot];
    slot = (slot + 1) & mask_;
  }
  const std::size_t count = points_.size();
  if (count >= kFree) throw InputError("the mesh has more than 4294967294 vertices");
  slots_[slot] = static_cast<std::uint32_t>(count);
  points_.push_back(p);
  if (2 * points_.size() > slots_.size()) grow();
  return static_cast<std::uint32_t>(count);
}

void VertexPool::grow() {
  std::vector<Point3> points = std::move(points_);
  slots_.assign(2 * slots_.size(), kFree);
  mask_ = slots_.size() - 1;
  points_.clear();
  points_.reserve(2 * points.size());
  for (const Point3& point : points) index(point);
}

void require_finite(const Point3& point, const std::string& path, const std::string& place) {
  if (std::isfinite(point[0]) && std::isfinite(point[1]) && std::isfinite(point[2])) return;
  throw InputError(path, place, "a coordinate is not finite");
}

void throw_no_triangles(const std::string& path) {
  throw InputError(path, "", "holds no triangles");
}

std::size_t PolygonMesh::add_vertex(const Point3& point) {
  vertices_.push_back(point);
  return vertices_.size() - 1;
}

void PolygonMesh::begin_face(std::size_t line) {
  first_corner_.push_back(corners_.size());
  if (line > 0) lines_.push_back(line);
}

TriangleMesh PolygonMesh::finish(bool or_points) {
  if (first_corner_.empty() && !(or_points && !vertices_.empty())) throw_no_triangles(path_);
  for (std::size_t i = 0; i < vertices_.size(); ++i) {
    require_finite(vertices_[i], path_, "vertex " + std::to_string(i + 1));
  }
  if (first_corner_.empty()) return {std::move(vertices_), {}};
  TriangleMesh mesh;
  mesh.triangles.reserve(first_corner_.size());
  VertexPool pool(vertices_.size());
  constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> merged(vertices_.size(), unused);
  first_corner_.push_back(corners_.size());
  for (std::size_t face = 0; face + 1 < first_corner_.size(); ++face) {
    const std::size_t begin = first_corner_[face], end = first_corner_[face + 1];
    const auto place = [&] {
      const std::string name = "face " + std::to_string(face + 1);
      return lines_.empty() ? name : name + " (line " + std::to_string(lines_[face]) + ")";
    };
    if (end - begin < 3) {
      throw InputError(path_, place(),
                       "has " + std::to_string(end - begin) + " corners, expected at least 3");
    }
    for (std::size_t k = begin; k < end; ++k) {
      const std::int64_t index = corners_[k];
      if (index < 0 || static_cast<std::size_t>(index) >= vertices_.size()) {
        throw InputError(path_, place(),
                         "vertex index " + std::to_string(index) + " (counted from 0) is out of " +
                             "range, the file has " + std::to_string(vertices_.size()) +
                             " vertices");
      }
      if (merged[index] == unused) merged[index] = pool.index(vertices_[index]);
    }
    for (std::size_t k = begin + 1; k + 1 < end; ++k) {
      mesh.triangles.push_back(
          {merged[corners_[begin]], merged[corners_[k]], merged[corners_[k + 1]]});
    }
  }
  mesh.vertices = pool.take();
  return mesh;
}

namespace {
bool ends_line(char c) { return c == '\n' || c == '\r'; }
bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f' || c == '\0'; }
}  // namespace

std::string_view without_mark(std::string_view text, const std::string& path) {
  if (text.starts_with("\xef\xbb\xbf")) return text.substr(3);
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff") ||
      text.starts_with(std::string_view("\0\0\xfe\xff", 4))) {
    throw InputError(path, "", "is a text in UTF-16 or UTF-32, expected UTF-8");
  }
  return text;
}

void WordReader::pass_line_end() {
  if (text_[at_] == '\r' && at_ + 1 < text_.size() && text_[at_ + 1] == '\n') ++at_;
  ++at_;
  ++line_;
}

// Moves to the next word; false when the text (or the line, for `in_line`) ends before it.
bool WordReader::pass_gap(bool in_line) {
  while (at_ < text_.size()) {
    const char c = text_[at_];
    if (is_blank(c)) {
      ++at_;
    } else if (joins_lines_ && c == '\\' && at_ + 1 < text_.size() && ends_line(text_[at_ + 1])) {
      ++at_;
      pass_line_end();
    } else if (skips_comments_ && c == '#') {
      while (at_ < text_.size() && !ends_line(text_[at_])) ++at_;
    } else if (ends_line(c)) {
      if (in_line) return false;
      pass_line_end();
    } else {
      return true;
    }
  }
  return false;
}

std::string_view WordReader::word() {
  pass_gap(false);
  return word_in_line();
}

std::string_view WordReader::word_in_line() {
  if (!pass_gap(true)) return {};
  const std::size_t begin = at_;
  while (at_ < text_.size() && !is_blank(text_[at_]) && !ends_line(text_[at_])) {
    if (skips_comments_ && text_[at_] == '#') break;
    if (joins_lines_ && text_[at_] == '\\' && at_ + 1 < text_.size() && ends_line(text_[at_ + 1])) {
      break;
    }
    ++at_;
  }
  return text_.substr(begin, at_ - begin);
}

void WordReader::skip_line() {
  while (!word_in_line().empty()) {
  }
  if (at_ < text_.size()) pass_line_end();
}

bool WordReader::at_end() { return !pass_gap(false); }

void WordReader::fail(const std::string& message) const {
  throw InputError(path_, place(), message);
}

double WordReader::number(std::string_view word, const char* what) const {
  if (word.empty()) fail(std::string(what) + " is missing");
  std::string_view digits = word;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const bool whole = end == digits.data() + digits.size();
  const std::string shown(word.substr(0, 40));
  if (error == std::errc::result_out_of_range && whole) {
    // Too small or too large? Only too large has no minus in its exponent.
    if (digits.find("e-") != digits.npos || digits.find("E-") != digits.npos) return 0;
    fail(std::string(what) + " '" + shown + "' is not finite (too large)");
  }
  if (error != std::errc() || !whole) {
    fail(std::string(what) + " expected, found '" + shown + "'");
  }
  if (!std::isfinite(value)) fail(std::string(what) + " '" + shown + "' is not finite");
  return value;
}

std::int64_t WordReader::integer(std::string_view word, const char* what) const {
  if (word.empty()) fail(std::string(what) + " is missing");
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) {
    fail(std::string(what) + " expected, found '" + std::string(word.substr(0, 40)) + "'");
  }
  return value;
}

}  // namespace slicecorr::detail
