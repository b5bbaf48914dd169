// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// OBJ and OFF.
#include <cfloat>
#include <cmath>

#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {

namespace {

/// What follows a point: nothing, its weight, or its colour with or without a weight.
void check_rest_of_vertex(WordReader& words) {
  double first = 1;
  int rest = 0;
  for (auto word = words.word_in_line(); !word.empty(); word = words.word_in_line()) {
    const double value = words.number(word, "a weight or colour");
    if (rest++ == 0) first = value;
  }
  if (rest == 1 && first != 1) {
    words.fail("a vertex has the weight " + std::to_string(first) +
               ", expected 1: weights belong to curves, which can't be read");
  }
  if (rest != 0 && rest != 1 && rest != 3 && rest != 4) {
    words.fail("a vertex has " + std::to_string(3 + rest) +
               " numbers, expected 3, with a weight 4, with a colour 6 or 7");
  }
}

/// Statements that make a surface without corners, or read another file that may.
bool is_free_form(std::string_view keyword) {
  for (const std::string_view word :
       {"cstype", "curv", "curv2", "surf", "bzp", "bsp", "call", "csh"}) {
    if (keyword == word) return true;
  }
  return false;
}

}  // namespace

// OBJ is read here and not through OpenMesh, which drops repeated corners of a face (and with them
// degenerate triangles), rounds to float, takes indices out of range as they are and opens the
// material files that a mesh names.
TriangleMesh read_obj(std::string_view bytes, const std::string& path,
                      std::vector<std::string>& notes, bool or_points) {
  std::size_t without_area = 0;
  PolygonMesh mesh(path);
  WordReader words(without_mark(bytes, path), path);
  words.join_continued_lines();
  words.skip_comments();
  while (!words.at_end()) {
    const std::string_view keyword = words.word_in_line();
    if (keyword == "v") {
      Point3 point;
      for (double& x : point) x = words.number(words.word_in_line(), "a coordinate");
      check_rest_of_vertex(words);
      mesh.add_vertex(point);
    } else if (keyword == "f" || keyword == "fo") {
      mesh.begin_face(words.line());
      for (auto word = words.word_in_line(); !word.empty(); word = words.word_in_line()) {
        // "vertex/texture/normal": only the first matters.
        const std::int64_t index = words.integer(word.substr(0, word.find('/')), "a vertex index");
        if (index == 0) {
          words.fail("face " + std::to_string(mesh.face_count()) +
                     ": vertex index 0, expected 1 or more, or a negative one");
        }
        const auto count = static_cast<std::int64_t>(mesh.vertex_count());
        if (index < -count) {
          words.fail("face " + std::to_string(mesh.face_count()) + ": vertex index " +
                     std::to_string(index) + " is out of range, there are " +
                     std::to_string(count) + " vertices before it");
        }
        mesh.add_corner(index > 0 ? index - 1 : count + index);
      }
    } else if (keyword == "l" || keyword == "p") {
      ++without_area;
    } else if (is_free_form(keyword)) {
      words.fail(
          "'" + std::string(keyword) +
          "': curves and surfaces of free form can't be read, expected faces of corners (f)");
    }
    words.skip_line();
  }
  if (without_area > 0) {
    notes.push_back(std::to_string(without_area) +
                    (without_area == 1 ? " line or point" : " lines and points") +
                    " left out: no solid");
  }
  return mesh.finish(or_points);
}

namespace {

void copy_coordinates(WordReader& words, std::string& out) {
  for (int k = 0; k < 3; ++k) {
    const std::string_view word = words.word_in_line();
    const double value = words.number(word, "a coordinate");
    if (std::abs(value) > FLT_MAX) words.fail("a coordinate is not finite (too large)");
    out.append(word).push_back(k < 2 ? ' ' : '\n');
  }
}

}  // namespace

// OpenMesh misreads comments, blank lines, counts on the first line and missing counts, and goes on
// when the text ends early. So it gets the text with nothing but counts, points and corners.
TriangleMesh read_off(std::string_view marked_bytes, const std::string& path) {
  const std::string_view bytes = without_mark(marked_bytes, path);
  WordReader words(bytes, path);
  words.skip_comments();
  std::string_view word = words.word();
  if (!word.ends_with("OFF")) words.fail("is not an OFF file: expected 'OFF' at the start");
  // ST, C, N: texture, colours, normals, all after the point. 4 and n: other dimensions.
  if (word.find_first_of("4n") != word.npos) {
    words.fail("'" + std::string(word) + "': only three-dimensional OFF files can be read");
  }
  word = words.word();
  if (word == "BINARY") words.fail("binary OFF files can't be read, expected a text");
  const std::int64_t vertices = words.integer(word, "the number of vertices");
  const std::int64_t faces = words.integer(words.word(), "the number of faces");
  words.skip_line();
  // A point takes at least 6 bytes ("0 0 0\n"), a face 8; the last line may lack its end.
  const auto most = static_cast<std::int64_t>(bytes.size());
  if (vertices < 0 || faces < 0 || vertices > most / 6 + 1 || faces > most / 8 + 1) {
    words.fail("the counts (" + std::to_string(vertices) + " vertices, " + std::to_string(faces) +
               " faces) do not fit the size of the file, " + std::to_string(bytes.size()) +
               " bytes");
  }
  std::string plain = "OFF\n" + std::to_string(vertices) + " " + std::to_string(faces) + " 0\n";
  plain.reserve(bytes.size() + 64);
  const auto require_more = [&](const char* what, std::int64_t done, std::int64_t all) {
    if (words.at_end()) {
      words.fail("the file ends after " + std::to_string(done) + " of " + std::to_string(all) +
                 " " + what);
    }
  };
  for (std::int64_t i = 0; i < vertices; ++i) {
    require_more("vertices", i, vertices);
    copy_coordinates(words, plain);
    words.skip_line();
  }
  for (std::int64_t i = 0; i < faces; ++i) {
    require_more("faces", i, faces);
    const std::int64_t corners = words.integer(words.word_in_line(), "a number of corners");
    if (corners < 3) {
      words.fail("face " + std::to_string(i + 1) + ": " + std::to_string(corners) +
                 " corners, expected at least 3");
    }
    plain += std::to_string(corners);
    for (std::int64_t k = 0; k < corners; ++k) {
      const std::int64_t index = words.integer(words.word_in_line(), "a vertex index");
      if (index < 0 || index >= vertices) {
        words.fail("face " + std::to_string(i + 1) + ": vertex index " + std::to_string(index) +
                   " is out of range, expected 0 to " + std::to_string(vertices - 1));
      }
      plain.append(" ").append(std::to_string(index));
    }
    plain += '\n';
    words.skip_line();
  }
  if (faces == 0) throw_no_triangles(path);
  return parse_with_openmesh(std::move(plain), "off", false, static_cast<std::size_t>(vertices),
                             static_cast<std::size_t>(faces), path);
}

}  // namespace slicecorr::detail
