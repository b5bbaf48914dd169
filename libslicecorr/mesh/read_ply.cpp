// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// PLY is read here and not through OpenMesh, which misreads lists that are counted by more than a
// byte, coordinates that are whole numbers or in another order, lists other than the corners and
// faces before vertices, goes on when the file ends early, and writes its doubts to stderr.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <limits>
#include <span>

#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

/// What a value is in the file.
struct ValueKind {
  std::size_t bytes = 0;  ///< 0: no kind that PLY knows
  bool real = false, has_sign = false;
};

struct Property {
  std::string name, type, count_type;
  ValueKind kind, count_kind;
  bool list = false;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  std::string format;
  std::vector<Element> elements;
  std::size_t body = 0;  // where the records begin
  bool binary() const { return format != "ascii"; }
};

ValueKind kind_of(std::string_view type) {
  struct Named {
    std::string_view name, other_name;
    ValueKind kind;
  };
  static constexpr Named kinds[] = {
      {"char", "int8", {1, false, true}},    {"uchar", "uint8", {1, false, false}},
      {"short", "int16", {2, false, true}},  {"ushort", "uint16", {2, false, false}},
      {"int", "int32", {4, false, true}},    {"uint", "uint32", {4, false, false}},
      {"float", "float32", {4, true, true}}, {"double", "float64", {8, true, true}}};
  for (const Named& k : kinds) {
    if (type == k.name || type == k.other_name) return k.kind;
  }
  return {};
}

void parse_property(WordReader& words, std::vector<Element>& elements) {
  if (elements.empty()) words.fail("'property' before any 'element'");
  const Element& element = elements.back();
  Property property;
  property.type = words.word_in_line();
  property.list = property.type == "list";
  if (property.list) {
    property.count_type = words.word_in_line();
    property.count_kind = kind_of(property.count_type);
    property.type = words.word_in_line();
  }
  property.kind = kind_of(property.type);
  property.name = words.word_in_line();
  const std::string shown = "property '" + property.name + "' of element '" + element.name + "'";
  if (property.list && (property.count_kind.bytes == 0 || property.count_kind.real)) {
    words.fail(shown + ": a list whose count is '" + property.count_type +
               "', expected an integer type");
  }
  if (property.kind.bytes == 0 || property.name.empty()) {
    words.fail(shown + " is of unknown type '" + property.type + "'");
  }
  elements.back().properties.push_back(property);
}

Header parse_header(std::string_view text, const std::string& path) {
  // The header is text, the rest may not be: lines are only looked for up to "end_header".
  if (!text.starts_with("ply")) {
    throw InputError(path, "", "is not a PLY file: expected 'ply' at the start and 'end_header'");
  }
  // Lines end as the first one does. A CR before an LF belongs to the line's end, also where only
  // the last line of the header has one; where lines end in a CR alone, an LF is the first byte of
  // the records.
  const bool cr_alone = text.substr(3, 1) == "\r" && text.substr(3, 2) != "\r\n";
  Header header;
  std::size_t last = text.npos;
  for (std::size_t at = 0; at < text.size() && last == text.npos;) {
    const std::size_t end = std::min(text.find(cr_alone ? '\r' : '\n', at), text.size());
    const std::string_view line = text.substr(at, end - at);
    if (line.substr(0, line.find_first_of(" \t\r")) == "end_header") last = at;
    at = std::min(end + 1, text.size());
    header.body = at;
  }
  if (last == text.npos) {
    throw InputError(path, "", "is not a PLY file: expected 'ply' at the start and 'end_header'");
  }

  WordReader words(text.substr(0, last), path);
  words.skip_line();
  for (; !words.at_end(); words.skip_line()) {
    const std::string_view word = words.word_in_line();
    if (word == "format") {
      header.format = words.word_in_line();
    } else if (word == "element") {
      Element element;
      element.name = words.word_in_line();
      const std::int64_t count = words.integer(words.word_in_line(), "a count");
      if (count < 0) words.fail("negative count of element '" + element.name + "'");
      element.count = static_cast<std::uint64_t>(count);
      header.elements.push_back(element);
    } else if (word == "property") {
      parse_property(words, header.elements);
    } else if (word != "comment" && word != "obj_info") {
      words.fail("unknown header word '" + std::string(word.substr(0, 40)) + "'");
    }
  }
  if (header.format != "ascii" && header.format != "binary_little_endian" &&
      header.format != "binary_big_endian") {
    throw InputError(path, "header",
                     "format '" + header.format +
                         "', expected ascii, binary_little_endian or binary_big_endian");
  }
  return header;
}

/// Where the mesh is in a record.
struct Places {
  const Element* vertices = nullptr;
  std::array<std::size_t, 3> coordinates{};  ///< the properties x, y and z
  const Element* faces = nullptr;
  std::size_t corners = 0;  ///< the property with their list
  const Element* strips = nullptr;
  std::size_t strip_corners = 0;
};

const Element* find_element(const Header& header, std::string_view name, const std::string& path) {
  const Element* found = nullptr;
  for (const Element& element : header.elements) {
    if (element.name != name) continue;
    if (found) {
      throw InputError(path, "header", "element '" + std::string(name) + "' appears twice");
    }
    found = &element;
  }
  return found;
}

std::size_t find_corners(const Element& element, const std::string& path) {
  std::size_t found = 0;
  int lists = 0;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const Property& property = element.properties[i];
    if (property.name != "vertex_indices" && property.name != "vertex_index") continue;
    if (!property.list || property.kind.real) continue;
    found = i;
    ++lists;
  }
  if (lists == 1) return found;
  throw InputError(path, "header",
                   "element '" + element.name + "' needs one integer list vertex_indices, found " +
                       std::to_string(lists));
}

Places find_places(const Header& header, const std::string& path, bool or_points) {
  Places places;
  places.vertices = find_element(header, "vertex", path);
  if (!places.vertices) throw InputError(path, "header", "has no element 'vertex'");
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string name(1, "xyz"[k]);
    int found = 0;
    for (std::size_t i = 0; i < places.vertices->properties.size(); ++i) {
      const Property& property = places.vertices->properties[i];
      if (property.name != name || property.list) continue;
      places.coordinates[k] = i;
      ++found;
    }
    if (found != 1) {
      throw InputError(path, "header",
                       "element 'vertex' needs one property '" + name +
                           "' that is no list, found " + std::to_string(found));
    }
  }
  places.faces = find_element(header, "face", path);
  places.strips = find_element(header, "tristrips", path);
  if (!places.faces && !places.strips && !or_points) {
    throw InputError(path, "header", "has neither an element 'face' nor 'tristrips'");
  }
  if (places.faces) places.corners = find_corners(*places.faces, path);
  if (places.strips) places.strip_corners = find_corners(*places.strips, path);
  return places;
}

// No count is believed before the file is seen to be long enough for it.
void check_counts(const Header& header, std::size_t body_bytes, const std::string& path) {
  for (const Element& element : header.elements) {
    std::size_t least = 0;  // bytes of the shortest record
    for (const Property& property : element.properties) {
      if (header.binary()) {
        least += property.list ? property.count_kind.bytes : property.kind.bytes;
      } else {
        least += 2;
      }
    }
    if (element.count > (body_bytes + 1) / std::max<std::size_t>(least, 1)) {
      throw InputError(path, "header",
                       "the file is too short for its " + std::to_string(element.count) + " '" +
                           element.name + "' records: " + std::to_string(body_bytes) +
                           " bytes follow the header");
    }
  }
}

/// What a value or list belongs to, for errors.
struct Place {
  const Element& element;
  std::uint64_t record;
  const Property& property;

  std::string words() const {
    return "'" + property.name + "' of " + element.name + " " + std::to_string(record + 1);
  }
};

[[noreturn]] void throw_short(const std::string& path, const Place& at) {
  throw InputError(path, "",
                   "the file ends after " + std::to_string(at.record) + " of " +
                       std::to_string(at.element.count) + " '" + at.element.name +
                       "' records, in the property '" + at.property.name + "'");
}

/// Values of a binary body, one after another.
class BinaryBody {
 public:
  BinaryBody(std::string_view bytes, std::size_t at, bool big, const std::string& path)
      : bytes_(bytes), at_(at), big_(big), path_(path) {}

  /// Records have no lines.
  std::size_t line() const { return 0; }
  double number(const Place& at) { return value(at.property.kind, at); }
  std::int64_t index(const Place& at) { return whole(at.property.kind, at); }
  /// The length of a list, whose values are in the file.
  std::uint64_t length(const Place& at) {
    const std::int64_t count = whole(at.property.count_kind, at);
    if (count < 0) {
      throw InputError(path_, at.words(), "a list of " + std::to_string(count) + " values");
    }
    const auto length = static_cast<std::uint64_t>(count);
    if (length > (bytes_.size() - at_) / at.property.kind.bytes) throw_short(path_, at);
    return length;
  }
  void skip(std::uint64_t values, const Place& at) {
    const std::uint64_t bytes = values * at.property.kind.bytes;
    if (bytes_.size() - at_ < bytes) throw_short(path_, at);
    at_ += bytes;
  }

 private:
  std::uint64_t bits(const ValueKind& kind, const Place& at) {
    if (bytes_.size() - at_ < kind.bytes) throw_short(path_, at);
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < kind.bytes; ++i) {
      const std::size_t byte = big_ ? i : kind.bytes - 1 - i;
      bits = bits << 8 | static_cast<unsigned char>(bytes_[at_ + byte]);
    }
    at_ += kind.bytes;
    return bits;
  }
  std::int64_t whole(const ValueKind& kind, const Place& at) {
    const std::uint64_t value = bits(kind, at);
    if (!kind.has_sign) return static_cast<std::int64_t>(value);
    const std::uint64_t sign = std::uint64_t{1} << (8 * kind.bytes - 1);
    return static_cast<std::int64_t>((value ^ sign) - sign);
  }
  double value(const ValueKind& kind, const Place& at) {
    if (!kind.real) return static_cast<double>(whole(kind, at));
    const std::uint64_t value = bits(kind, at);
    if (kind.bytes == 8) return std::bit_cast<double>(value);
    return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(value)));
  }

  std::string_view bytes_;
  std::size_t at_;
  bool big_;
  const std::string& path_;
};

/// The same of a text, where every word is checked.
class TextBody {
 public:
  TextBody(std::string_view bytes, const Header& header, const std::string& path)
      : words_(bytes, path), path_(path), most_(bytes.size()) {
    // Counting the header's lines again is cheap, and errors then name lines of the file.
    WordReader head(bytes.substr(0, header.body), path);
    while (!head.at_end()) head.skip_line();
    while (words_.line() < head.line()) words_.skip_line();
  }

  std::size_t line() const { return words_.line(); }
  double number(const Place& at) {
    if (!at.property.kind.real) return static_cast<double>(whole(at, ": a coordinate"));
    const std::string_view word = next(at);
    double value = 0;
    if (!plain(word, value) || !std::isfinite(value)) {
      value = words_.number(word, (at.words() + ": a coordinate").c_str());
    }
    if (at.property.kind.bytes == 8) return value;
    if (std::abs(value) > static_cast<double>(std::numeric_limits<float>::max())) {
      words_.fail(at.words() + ": a coordinate '" + std::string(word.substr(0, 40)) +
                  "' is not finite (too large)");
    }
    return static_cast<double>(static_cast<float>(value));
  }
  std::int64_t index(const Place& at) { return whole(at, ": a vertex index"); }
  std::uint64_t length(const Place& at) {
    const std::int64_t count = whole(at, ": a list length");
    if (count < 0) words_.fail(at.words() + ": a list of " + std::to_string(count) + " values");
    if (static_cast<std::uint64_t>(count) > most_) throw_short(path_, at);
    return static_cast<std::uint64_t>(count);
  }
  void skip(std::uint64_t values, const Place& at) {
    for (; values > 0; --values) next(at);
  }

 private:
  /// Whether the word is just this: names for errors are only made where they are needed.
  template <class Number>
  static bool plain(std::string_view word, Number& value) {
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    return error == std::errc() && end == word.data() + word.size();
  }
  std::int64_t whole(const Place& at, const char* what) {
    const std::string_view word = next(at);
    std::int64_t value = 0;
    return plain(word, value) ? value : words_.integer(word, (at.words() + what).c_str());
  }
  std::string_view next(const Place& at) {
    const std::string_view word = words_.word();
    if (word.empty()) throw_short(path_, at);
    return word;
  }
  WordReader words_;
  const std::string& path_;
  std::size_t most_;
};

/// Adds the triangles of strips that -1 parts from each other: every second one is turned.
void add_strips(std::span<const std::int64_t> corners, std::size_t line, PolygonMesh& mesh) {
  std::size_t begin = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] == -1) {
      begin = i + 1;
    } else if (i >= begin + 2) {
      const bool turned = (i - begin) % 2 != 0;
      mesh.begin_face(line);
      mesh.add_corner(corners[turned ? i - 1 : i - 2]);
      mesh.add_corner(corners[turned ? i - 2 : i - 1]);
      mesh.add_corner(corners[i]);
    }
  }
}

template <class Body>
TriangleMesh read_body(Body& body, const Header& header, const Places& places,
                       const std::string& path, bool or_points) {
  PolygonMesh mesh(path);
  std::vector<std::int64_t> corners;
  for (const Element& element : header.elements) {
    const bool vertices = &element == places.vertices;
    const bool faces = &element == places.faces, strips = &element == places.strips;
    for (std::uint64_t record = 0; record < element.count; ++record) {
      Point3 point{};
      for (std::size_t i = 0; i < element.properties.size(); ++i) {
        const Property& property = element.properties[i];
        const Place at{element, record, property};
        const auto axis = static_cast<std::size_t>(
            std::find(places.coordinates.begin(), places.coordinates.end(), i) -
            places.coordinates.begin());
        if (vertices && axis < 3) {
          point[axis] = body.number(at);
        } else if ((faces && i == places.corners) || (strips && i == places.strip_corners)) {
          corners.clear();
          for (std::uint64_t left = body.length(at); left > 0; --left) {
            corners.push_back(body.index(at));
          }
          if (strips) {
            add_strips(corners, body.line(), mesh);
          } else {
            mesh.begin_face(body.line());
            for (const std::int64_t corner : corners) mesh.add_corner(corner);
          }
        } else {
          body.skip(property.list ? body.length(at) : 1, at);
        }
      }
      if (vertices) mesh.add_vertex(point);
    }
  }
  return mesh.finish(or_points);
}

}  // namespace

TriangleMesh read_ply(std::string_view marked_bytes, const std::string& path, bool or_points) {
  const std::string_view bytes = without_mark(marked_bytes, path);
  const Header header = parse_header(bytes, path);
  const Places places = find_places(header, path, or_points);
  check_counts(header, bytes.size() - header.body, path);
  if (header.binary()) {
    BinaryBody body(bytes, header.body, header.format == "binary_big_endian", path);
    return read_body(body, header, places, path, or_points);
  }
  TextBody body(bytes, header, path);
  return read_body(body, header, places, path, or_points);
}

}  // namespace slicecorr::detail
