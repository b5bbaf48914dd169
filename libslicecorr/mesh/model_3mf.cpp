// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// 3MF is read here and not through lib3mf: version 1.8, that of Debian 12, refuses valid files (groups
// of metadata, composite materials) and skips beams and slices. The XML is read element by element, so
// that memory is that of the mesh, not of a tree.
// What extensions say is in model_extensions_3mf.cpp.
#include "mesh/model_3mf.hpp"

#include <charconv>
#include <cmath>

#include "mesh/mesh_parts.hpp"
#include "mesh/model_reader_3mf.hpp"
#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {

Transform3mf combine(const Transform3mf& inner, const Transform3mf& outer) {
  Transform3mf result;
  for (std::size_t r = 0; r < 4; ++r) {
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = r == 3 ? outer.rows[3][c] : 0.0;
      for (std::size_t k = 0; k < 3; ++k) sum += inner.rows[r][k] * outer.rows[k][c];
      result.rows[r][c] = sum;
    }
  }
  return result;
}

namespace {

/// What is read, or says nothing of geometry.
constexpr std::string_view kReadSpaces[] = {spaces_3mf::kCore,         spaces_3mf::kMaterials,
                                            spaces_3mf::kProduction,   spaces_3mf::kSlices,
                                            spaces_3mf::kBeams,        spaces_3mf::kBalls,
                                            spaces_3mf::kTriangleSets, spaces_3mf::kCompatibility};

bool is_read(std::string_view space) {
  for (const std::string_view known : kReadSpaces) {
    if (space == known) return true;
  }
  return false;
}

}  // namespace

Model3mf ModelReader3mf::take() {
  if (!resources_) fail_in_model("has no element 'resources'");
  if (!build_) fail_in_model("has no element 'build'");
  for (const auto& [space, name] : unread_) {
    model_.notes.push_back("elements of the extension " + space + " ('" + name +
                           "') are not read; the file does not require them");
  }
  return std::move(model_);
}

void ModelReader3mf::element_begins(const XmlElement& element, std::size_t depth) {
  if (depth == 0) {
    inside_.push_back(begin_model(element));
    return;
  }
  const In3mf in = inside_.back();
  inside_.push_back(in == In3mf::skipped ? in : begin_in(in, element));
}

void ModelReader3mf::element_ends(std::size_t) {
  const In3mf ended = inside_.back();
  inside_.pop_back();
  if (ended == In3mf::object) end_object();
  if (ended == In3mf::mesh) end_mesh();
  if (ended == In3mf::slice) end_slice();
  if (ended == In3mf::polygon) end_polygon();
}

void ModelReader3mf::fail_in_model(const std::string& what) const {
  throw InputError(path_, part_, "the element 'model' " + what);
}

void ModelReader3mf::fail_unknown(const XmlElement& element) const {
  fail("unknown element '" + std::string(element.name.substr(0, 80)) + "'");
}

In3mf ModelReader3mf::begin_model(const XmlElement& element) {
  if (element.name != "model" || element.space != spaces_3mf::kCore) {
    fail("the element '" + std::string(element.name.substr(0, 80)) + "' of '" +
         std::string(element.space.substr(0, 200)) + "' is no 3MF model, expected that of " +
         std::string(spaces_3mf::kCore));
  }
  std::string_view value;
  if (has(element, {}, "unit", value)) model_.unit_mm = unit_mm(value);
  if (has(element, {}, "requiredextensions", value)) {
    for_words(value, [&](std::string_view prefix) { require(prefix); });
  }
  if (has(element, {}, "recommendedextensions", value)) {
    for_words(value, [&](std::string_view prefix) {
      const std::string space = space_of(prefix);
      if (is_read(space)) return;
      model_.notes.push_back("the extension '" + std::string(prefix) + "' (" + space +
                             ") is recommended by the file, and not read");
    });
  }
  if (has(element, spaces_3mf::kCompatibility, "Ignorable", value)) {
    for_words(value, [&](std::string_view prefix) { ignorable_.insert(space_of(prefix)); });
  }
  return In3mf::model;
}

double ModelReader3mf::unit_mm(std::string_view unit) const {
  struct Unit {
    std::string_view name;
    double mm;
  };
  constexpr Unit units[] = {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10},
                            {"inch", 25.4},    {"foot", 304.8},   {"meter", 1000}};
  for (const Unit& u : units) {
    if (unit == u.name) return u.mm;
  }
  fail("unknown unit '" + std::string(unit.substr(0, 40)) +
       "', expected micron, millimeter, centimeter, inch, foot or meter");
}

std::string ModelReader3mf::space_of(std::string_view prefix) const {
  const auto found = spaces_.find(prefix);
  if (found == spaces_.end()) {
    fail("the prefix '" + std::string(prefix.substr(0, 40)) + "' stands for no namespace");
  }
  return found->second;
}

void ModelReader3mf::require(std::string_view prefix) const {
  const std::string space = space_of(prefix);
  if (is_read(space)) return;
  fail("requires the extension '" + std::string(prefix.substr(0, 40)) + "' (" + space +
       "), which is not read: without it another part would print");
}

In3mf ModelReader3mf::skip_foreign(const XmlElement& element) {
  if (!is_read(element.space) && !ignorable_.contains(element.space)) {
    unread_.emplace(element.space, element.name);
  }
  return In3mf::skipped;
}

In3mf ModelReader3mf::begin_in(In3mf in, const XmlElement& element) {
  const bool core = element.space == spaces_3mf::kCore;
  const std::string_view name = element.name;
  switch (in) {
    case In3mf::model:
      if (!core) return skip_foreign(element);
      if (name == "metadata") return add_metadata(element);
      if (name == "resources") return once(resources_, In3mf::resources, element);
      if (name == "build") return once(build_, In3mf::build, element);
      fail_unknown(element);
    case In3mf::resources:
      return begin_resource(element);
    case In3mf::object:
      return begin_in_object(element);
    case In3mf::metadata_group:
      return In3mf::skipped;
    case In3mf::mesh:
      return begin_in_mesh(element);
    case In3mf::vertices:
      if (core && name == "vertex") return add_vertex(element);
      fail_unknown(element);
    case In3mf::triangles:
      if (core && name == "triangle") return add_triangle(element);
      fail_unknown(element);
    case In3mf::components:
      if (!core || name != "component") fail_unknown(element);
      object_.components.push_back(reference(element));
      return In3mf::skipped;
    case In3mf::lattice:
      if (element.space == spaces_3mf::kBeams && name == "beams") return In3mf::beams;
      if (element.space == spaces_3mf::kBalls && name == "balls") return In3mf::balls;
      if (element.space == spaces_3mf::kBeams && name == "beamsets") return In3mf::skipped;
      if (element.space == spaces_3mf::kBeams) fail_unknown(element);
      return skip_foreign(element);
    case In3mf::beams:
      if (element.space == spaces_3mf::kBeams && name == "beam") return add_beam(element);
      fail_unknown(element);
    case In3mf::balls:
      if (element.space == spaces_3mf::kBalls && name == "ball") return add_ball(element);
      fail_unknown(element);
    case In3mf::stack:
      return begin_in_stack(element);
    case In3mf::slice:
      if (element.space != spaces_3mf::kSlices) return skip_foreign(element);
      if (name == "vertices") return In3mf::slice_points;
      if (name == "polygon") return begin_polygon(element);
      fail_unknown(element);
    case In3mf::slice_points:
      if (element.space != spaces_3mf::kSlices || name != "vertex") fail_unknown(element);
      slice().points.push_back({number(element, "x"), number(element, "y")});
      return In3mf::skipped;
    case In3mf::polygon:
      if (element.space != spaces_3mf::kSlices || name != "segment") fail_unknown(element);
      slice().contours.back().push_back(whole(element, "v2", 0));
      return In3mf::skipped;
    case In3mf::property_group:
      check_property(element);
      return In3mf::skipped;
    case In3mf::build:
      if (!core) return skip_foreign(element);
      if (name != "item") fail_unknown(element);
      return add_item(element);
    case In3mf::item:
    case In3mf::skipped:
    case In3mf::nothing:
      break;
  }
  return In3mf::skipped;
}

In3mf ModelReader3mf::once(bool& seen, In3mf in, const XmlElement& element) const {
  if (seen) fail("the element '" + std::string(element.name) + "' is there twice");
  seen = true;
  return in;
}

In3mf ModelReader3mf::add_metadata(const XmlElement& element) {
  const std::string name(text(element, "name"));
  // Descriptions and the like may be several.
  const bool single = name == "Title" || name == "Application" || name == "Rating" ||
                      name == "CreationDate" || name == "ModificationDate";
  if (metadata_.insert(name).second || !single) return In3mf::skipped;
  fail("the metadata '" + name + "' are there twice");
}

std::uint32_t ModelReader3mf::new_id(const XmlElement& element) {
  const std::uint32_t id = whole(element, "id", 1);
  if (!ids_.insert(id).second) {
    fail("the id " + std::to_string(id) + " belongs to another resource, too");
  }
  return id;
}

In3mf ModelReader3mf::begin_resource(const XmlElement& element) {
  const std::string_view name = element.name;
  if (element.space == spaces_3mf::kCore && name == "object") return begin_object(element);
  if (element.space == spaces_3mf::kSlices && name == "slicestack") {
    const std::uint32_t id = new_id(element);
    stack_ = &model_.slices[id];
    stack_->line = line();
    std::string_view value;
    if (has(element, {}, "zbottom", value)) stack_->bottom = number(value, "zbottom");
    return In3mf::stack;
  }
  if (element.space == spaces_3mf::kMaterials ||
      (element.space == spaces_3mf::kCore && name == "basematerials")) {
    return begin_properties(element);
  }
  if (element.space == spaces_3mf::kCore || element.space == spaces_3mf::kSlices)
    fail_unknown(element);
  return skip_foreign(element);
}

void ModelReader3mf::refuse(const std::string& wrong, const XmlElement& element) const {
  if (!wrong.empty()) fail("the element '" + std::string(element.name) + "' " + wrong);
}

In3mf ModelReader3mf::begin_object(const XmlElement& element) {
  object_ = {};
  object_.id = new_id(element);
  object_.line = line();
  geometry_ = false;
  std::string_view value;
  if (has(element, {}, "type", value)) object_.type = type_named(value);
  check_properties(element);
  if (has(element, {}, "pindex", value)) {
    whole(value, "pindex", 0);
    if (!has(element, {}, "pid", value)) {
      fail("the object " + std::to_string(object_.id) + " has a pindex without a pid");
    }
  }
  if (has(element, spaces_3mf::kSlices, "slicestackid", value)) {
    object_.slices = whole(value, "slicestackid", 1);
  }
  if (has(element, spaces_3mf::kSlices, "slicepath", value)) object_.slices_path = value;
  if (has(element, spaces_3mf::kSlices, "meshresolution", value)) {
    if (value != "lowres" && value != "fullres") {
      fail("meshresolution '" + std::string(value.substr(0, 40)) + "', expected fullres or lowres");
    }
    object_.coarse_mesh = value == "lowres";
  }
  if (object_.coarse_mesh && object_.slices == 0) {
    fail("the mesh of the object " + std::to_string(object_.id) +
         " stands in for slices (lowres), and the object names none");
  }
  return In3mf::object;
}

Type3mf ModelReader3mf::type_named(std::string_view name) const {
  if (name == "model") return Type3mf::model;
  if (name == "solidsupport") return Type3mf::solid_support;
  if (name == "support") return Type3mf::support;
  if (name == "surface") return Type3mf::surface;
  if (name == "other") return Type3mf::other;
  fail("an object of the type '" + std::string(name.substr(0, 40)) +
       "', expected model, solidsupport, support, surface or other");
}

In3mf ModelReader3mf::begin_in_object(const XmlElement& element) {
  if (element.space != spaces_3mf::kCore) return skip_foreign(element);
  if (element.name == "metadatagroup") return In3mf::metadata_group;
  if (element.name == "mesh") return once(geometry_, In3mf::mesh, element);
  if (element.name == "components") return once(geometry_, In3mf::components, element);
  fail_unknown(element);
}

void ModelReader3mf::end_object() {
  if (!geometry_) {
    throw InputError(path_, part_ + ", line " + std::to_string(object_.line),
                     "the object " + std::to_string(object_.id) +
                         " has neither a mesh nor components that are read");
  }
  model_.objects.emplace(object_.id, std::move(object_));
}

In3mf ModelReader3mf::begin_in_mesh(const XmlElement& element) {
  if (element.space == spaces_3mf::kBeams && element.name == "beamlattice")
    return begin_lattice(element);
  if (element.space != spaces_3mf::kCore) return skip_foreign(element);
  if (element.name == "vertices") {
    for (const XmlAttribute& attribute : element.attributes) {
      if (ignorable_.contains(attribute.space)) continue;
      fail("the element 'vertices' has the attribute '" +
           std::string(attribute.name.substr(0, 40)) + "', expected none");
    }
    return In3mf::vertices;
  }
  if (element.name == "triangles") return In3mf::triangles;
  fail_unknown(element);
}

In3mf ModelReader3mf::add_vertex(const XmlElement& element) {
  Point3 point{};
  unsigned found = 0;
  for (const XmlAttribute& attribute : element.attributes) {
    if (!attribute.space.empty() || attribute.name.size() != 1) continue;
    const unsigned axis = static_cast<unsigned>(attribute.name[0]) - 'x';
    if (axis > 2) continue;
    point[axis] = coordinate(attribute.value, axis);
    found |= 1U << axis;
  }
  if (found != 7) {
    fail("vertex " + std::to_string(object_.vertices.size() + 1) +
         " lacks one of the attributes x, y and z");
  }
  if (object_.vertices.size() == 0x7fffffff) fail("more vertices than 3MF allows");
  object_.vertices.push_back(point);
  return In3mf::skipped;
}

double ModelReader3mf::coordinate(std::string_view text, unsigned axis) const {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc() && end == text.data() + text.size() && std::isfinite(value)) {
    return value;
  }
  // Names for errors, and blanks around a number, are rare.
  return number(trimmed(text), std::string(1, "xyz"[axis]) + " of vertex " +
                                   std::to_string(object_.vertices.size() + 1));
}

In3mf ModelReader3mf::add_triangle(const XmlElement& element) {
  std::array<std::uint32_t, 3> corners{};
  unsigned found = 0;
  for (const XmlAttribute& attribute : element.attributes) {
    if (!attribute.space.empty() || attribute.name.size() != 2 || attribute.name[0] != 'v') {
      continue;
    }
    const unsigned k = static_cast<unsigned>(attribute.name[1]) - '1';
    if (k > 2) continue;
    corners[k] = whole(trimmed(attribute.value), attribute.name, 0);
    if (corners[k] >= object_.vertices.size()) {
      fail("triangle " + std::to_string(object_.triangles.size() + 1) + ": vertex " +
           std::to_string(corners[k]) + " (counted from 0) is out of range, there are " +
           std::to_string(object_.vertices.size()));
    }
    found |= 1U << k;
  }
  if (found != 7) {
    fail("triangle " + std::to_string(object_.triangles.size() + 1) +
         " lacks one of the attributes v1, v2 and v3");
  }
  if (object_.triangles.size() == kMost3mfTriangles) {
    fail("more than " + std::to_string(kMost3mfTriangles) + " triangles");
  }
  check_properties(element);
  object_.triangles.push_back(corners);
  return In3mf::skipped;
}

void ModelReader3mf::end_mesh() {
  const std::size_t vertices = object_.vertices.size();
  if (!object_.lattice) return;
  const auto check = [&](std::uint32_t vertex, const char* what, std::size_t index) {
    if (vertex < vertices) return;
    fail(std::string(what) + " " + std::to_string(index + 1) + " of the object " +
         std::to_string(object_.id) + ": vertex " + std::to_string(vertex) +
         " (counted from 0) is out of range, there are " + std::to_string(vertices));
  };
  const Lattice3mf& lattice = *object_.lattice;
  for (std::size_t i = 0; i < lattice.beams.size(); ++i) {
    check(lattice.beams[i].v1, "beam", i);
    check(lattice.beams[i].v2, "beam", i);
  }
  for (std::size_t i = 0; i < lattice.balls.size(); ++i) check(lattice.balls[i].vertex, "ball", i);
}

Component3mf ModelReader3mf::reference(const XmlElement& element) const {
  Component3mf found;
  found.line = line();
  found.object = whole(element, "objectid", 1);
  std::string_view value;
  if (has(element, spaces_3mf::kProduction, "path", value)) found.path = value;
  if (!has(element, {}, "transform", value)) return found;
  std::size_t count = 0;
  for_words(value, [&](std::string_view word) {
    const double entry = number(word, "transform");
    if (count < 12) found.transform.rows[count / 3][count % 3] = entry;
    ++count;
  });
  if (count != 12) {
    fail("a transform of " + std::to_string(count) + " numbers, expected 12");
  }
  if (found.transform.determinant() == 0) fail("a transform that leaves no volume");
  return found;
}

In3mf ModelReader3mf::add_item(const XmlElement& element) {
  Item3mf item{reference(element)};
  std::string_view value;
  if (has(element, {}, "printable", value)) item.printable = value != "0" && value != "false";
  model_.items.push_back(std::move(item));
  return In3mf::item;
}

Model3mf read_model_3mf(const Package3mf& package, const std::string& part,
                        const std::string& path) {
  ModelReader3mf reader(path, part);
  package.read_xml(part, reader);
  return reader.take();
}

}  // namespace slicecorr::detail
