// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// PLY. OpenMesh parses it, but misreads lists other than the corners, properties before the corners
// and faces before vertices, and goes on when the file ends early. So it gets a file with nothing
// but points and corners, whose completeness is checked here.
#include <algorithm>

#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

struct Property {
  std::string name, type, count_type;  // count_type is empty unless it is a list
  bool kept = false;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  std::string format;
  std::vector<Element> elements;
  std::size_t body = 0;   // where the records begin
  std::size_t lines = 0;  // of the header
  bool binary() const { return format != "ascii"; }
};

std::size_t size_of(std::string_view type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "int" || type == "uint" || type == "int32" || type == "uint32") return 4;
  if (type == "float" || type == "float32") return 4;
  if (type == "double" || type == "float64") return 8;
  return 0;
}

bool is_integer(std::string_view type) {
  return size_of(type) > 0 && type.substr(0, 5) != "float" && type != "double";
}

void parse_property(WordReader& words, std::vector<Element>& elements) {
  if (elements.empty()) words.fail("'property' before any 'element'");
  Property property;
  property.type = words.word_in_line();
  if (property.type == "list") {
    property.count_type = words.word_in_line();
    property.type = words.word_in_line();
    if (!is_integer(property.count_type)) {
      words.fail("a list whose count is '" + property.count_type + "', expected an integer type");
    }
  }
  property.name = words.word_in_line();
  if (size_of(property.type) == 0 || property.name.empty()) {
    words.fail("property '" + property.name + "' of unknown type '" + property.type + "'");
  }
  elements.back().properties.push_back(property);
}

Header parse_header(std::string_view text, const std::string& path) {
  // The header is text, the rest may not be: lines are only looked for up to "end_header".
  if (!text.starts_with("ply")) {
    throw InputError(path, "", "is not a PLY file: expected 'ply' at the start and 'end_header'");
  }
  const bool crlf = text.substr(3, 2) == "\r\n";
  Header header;
  std::size_t last = text.npos;
  for (std::size_t at = 0; at < text.size() && last == text.npos; ++header.lines) {
    const std::size_t end = std::min(text.find_first_of("\r\n", at), text.size());
    const std::string_view line = text.substr(at, end - at);
    if (line.substr(0, line.find_first_of(" \t")) == "end_header") last = at;
    at = std::min(end + (crlf && text.substr(end, 2) == "\r\n" ? 2 : 1), text.size());
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

Element& find_element(Header& header, const std::string& name, const std::string& path) {
  Element* found = nullptr;
  for (Element& element : header.elements) {
    if (element.name != name) continue;
    if (found) throw InputError(path, "header", "element '" + name + "' appears twice");
    found = &element;
  }
  if (!found) throw InputError(path, "header", "has no element '" + name + "'");
  return *found;
}

// Marks what the mesh needs, and refuses headers that lack it.
void choose_properties(Header& header, const std::string& path) {
  int coordinates = 0;
  for (Property& property : find_element(header, "vertex", path).properties) {
    // In this order, as copied records keep theirs.
    if (coordinates < 3 && property.name == std::string(1, "xyz"[coordinates])) {
      if (!property.count_type.empty()) continue;
      property.kept = true;
      ++coordinates;
    }
  }
  if (coordinates < 3) throw InputError(path, "header", "vertices lack the properties x, y, z");
  int lists = 0;
  for (Property& property : find_element(header, "face", path).properties) {
    if (property.name != "vertex_indices" && property.name != "vertex_index") continue;
    if (property.count_type.empty() || !is_integer(property.type)) continue;
    property.kept = true;
    ++lists;
  }
  if (lists != 1) {
    throw InputError(path, "header",
                     "faces need one integer list vertex_indices, found " + std::to_string(lists));
  }
}

// No count is believed before the file is seen to be long enough for it.
void check_counts(const Header& header, std::size_t body_bytes, const std::string& path) {
  for (const Element& element : header.elements) {
    std::size_t least = 0;  // bytes of the shortest record
    for (const Property& property : element.properties) {
      const bool list = !property.count_type.empty();
      if (header.binary()) {
        least += list ? size_of(property.count_type) : size_of(property.type);
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

[[noreturn]] void throw_short(const std::string& path, const Element& element,
                              std::uint64_t record) {
  throw InputError(path, "",
                   "the file ends after " + std::to_string(record) + " of " +
                       std::to_string(element.count) + " '" + element.name + "' records");
}

// Copies the chosen properties of one element's records from a binary body.
class BinaryBody {
 public:
  BinaryBody(std::string_view bytes, std::size_t at, bool big, const std::string& path)
      : bytes_(bytes), at_(at), big_(big), path_(path) {}

  void copy(const Element& element, std::string& out) {
    for (std::uint64_t record = 0; record < element.count; ++record) {
      for (const Property& property : element.properties) {
        std::size_t length = size_of(property.type);
        const std::size_t begin = at_;
        if (!property.count_type.empty()) {
          const std::size_t count_size = size_of(property.count_type);
          if (bytes_.size() - at_ < count_size) throw_short(path_, element, record);
          std::uint64_t count = 0;
          for (std::size_t i = 0; i < count_size; ++i) {
            const std::size_t byte = big_ ? i : count_size - 1 - i;
            count = count << 8 | static_cast<unsigned char>(bytes_[at_ + byte]);
          }
          at_ += count_size;
          length *= count;  // at most 8 * 2^32
        }
        if (bytes_.size() - at_ < length) throw_short(path_, element, record);
        at_ += length;
        if (property.kept) out.append(bytes_, begin, at_ - begin);
      }
    }
  }

 private:
  std::string_view bytes_;
  std::size_t at_;
  bool big_;
  const std::string& path_;
};

// The same from a text, where every word is checked, as OpenMesh would take "abc" as the end.
void copy_text(WordReader& words, const Element& element, const std::string& path,
               std::string& out) {
  for (std::uint64_t record = 0; record < element.count; ++record) {
    for (const Property& property : element.properties) {
      std::int64_t values = 1;
      const auto next = [&] {
        const std::string_view word = words.word();
        if (word.empty()) throw_short(path, element, record);
        return word;
      };
      if (!property.count_type.empty()) {
        values = words.integer(next(), "a list length");
        if (values < 0) words.fail("a negative list length");
        if (property.kept) out += std::to_string(values) + ' ';
      }
      for (; values > 0; --values) {
        const std::string_view word = next();
        if (!property.kept) continue;
        if (is_integer(property.type) && !property.count_type.empty()) {
          out += std::to_string(words.integer(word, "a vertex index"));
        } else {
          words.number(word, "a coordinate");
          out += word;
        }
        out += ' ';
      }
    }
    out += '\n';
  }
}

}  // namespace

TriangleMesh read_ply(std::string_view bytes, const std::string& path) {
  Header header = parse_header(bytes, path);
  choose_properties(header, path);
  check_counts(header, bytes.size() - header.body, path);

  std::string vertices, faces;
  BinaryBody binary(bytes, header.body, header.format == "binary_big_endian", path);
  WordReader words(bytes, path);
  if (!header.binary()) {
    // Counting the header's lines again is cheap, and errors then name lines of the file.
    for (std::size_t i = 0; i < header.lines; ++i) words.skip_line();
  }
  std::string plain = "ply\nformat " + header.format + " 1.0\n";
  std::size_t vertex_count = 0, face_count = 0;
  for (const Element& element : header.elements) {
    const bool is_vertex = element.name == "vertex";
    std::string& out = is_vertex ? vertices : faces;  // other elements copy nothing
    if (header.binary()) {
      binary.copy(element, out);
    } else if (is_vertex || element.name == "face") {
      copy_text(words, element, path, out);
    } else {
      std::string nothing;
      copy_text(words, element, path, nothing);
    }
    if (is_vertex) vertex_count = element.count;
    if (element.name == "face") face_count = element.count;
  }
  if (face_count == 0) throw_no_triangles(path);
  for (const std::string name : {"vertex", "face"}) {
    const Element& element = find_element(header, name, path);
    plain += "element " + name + " " + std::to_string(element.count) + "\n";
    for (const Property& property : element.properties) {
      if (!property.kept) continue;
      if (name == "vertex") {
        plain += "property " + property.type + " " + property.name + "\n";
      } else {
        plain += "property list " + property.count_type + " " + property.type + " vertex_indices\n";
      }
    }
  }
  plain += "end_header\n" + vertices + faces;
  return parse_with_openmesh(std::move(plain), "ply", header.binary(), vertex_count, face_count,
                             path);
}

}  // namespace slicecorr::detail
