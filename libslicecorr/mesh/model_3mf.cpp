// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// 3MF is read here and not through lib3mf: version 1.8, that of Debian 12, refuses valid files (groups
// of metadata, composite materials) and skips beams and slices. The XML is read element by element, so
// that memory is that of the mesh, not of a tree.
#include "mesh/model_3mf.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "mesh/mesh_parts.hpp"
#include "mesh/properties_3mf.hpp"
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

constexpr std::string_view kCore = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
constexpr std::string_view kMaterials =
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02";
constexpr std::string_view kProduction =
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06";
constexpr std::string_view kSlices = "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07";
constexpr std::string_view kBeams =
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02";
constexpr std::string_view kBalls =
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07";
constexpr std::string_view kTriangleSets =
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07";
constexpr std::string_view kCompatibility =
    "http://schemas.openxmlformats.org/markup-compatibility/2006";
/// What is read, or says nothing of geometry.
constexpr std::string_view kReadSpaces[] = {kCore,  kMaterials, kProduction,   kSlices,
                                            kBeams, kBalls,     kTriangleSets, kCompatibility};

bool is_read(std::string_view space) {
  for (const std::string_view known : kReadSpaces) {
    if (space == known) return true;
  }
  return false;
}

/// Calls `each(word)` for the words of a list.
template <class Each>
void for_words(std::string_view text, const Each& each) {
  while (!text.empty()) {
    const std::size_t begin = std::min(text.find_first_not_of(" \t\r\n"), text.size());
    text.remove_prefix(begin);
    const std::size_t end = std::min(text.find_first_of(" \t\r\n"), text.size());
    if (end > 0) each(text.substr(0, end));
    text.remove_prefix(end);
  }
}

/// Where in the model an element lies.
enum class In3mf {
  nothing,
  model,
  resources,
  object,
  mesh,
  vertices,
  triangles,
  components,
  lattice,
  beams,
  balls,
  stack,
  slice,
  slice_points,
  polygon,
  property_group,
  build,
  item,
  metadata_group,
  skipped
};

class ModelReader3mf final : public Xml3mf {
 public:
  using Xml3mf::Xml3mf;

  Model3mf take() {
    if (!resources_) fail_in_model("has no element 'resources'");
    if (!build_) fail_in_model("has no element 'build'");
    for (const auto& [space, name] : unread_) {
      model_.notes.push_back("elements of the extension " + space + " ('" + name +
                             "') are not read; the file does not require them");
    }
    return std::move(model_);
  }

 private:
  void element_begins(const XmlElement& element, std::size_t depth) override {
    if (depth == 0) {
      inside_.push_back(begin_model(element));
      return;
    }
    const In3mf in = inside_.back();
    inside_.push_back(in == In3mf::skipped ? in : begin_in(in, element));
  }

  void element_ends(std::size_t) override {
    const In3mf ended = inside_.back();
    inside_.pop_back();
    if (ended == In3mf::object) end_object();
    if (ended == In3mf::mesh) end_mesh();
    if (ended == In3mf::slice) end_slice();
    if (ended == In3mf::polygon) end_polygon();
  }

  [[noreturn]] void fail_in_model(const std::string& what) const {
    throw InputError(path_, part_, "the element 'model' " + what);
  }
  [[noreturn]] void fail_unknown(const XmlElement& element) const {
    fail("unknown element '" + std::string(element.name.substr(0, 80)) + "'");
  }

  In3mf begin_model(const XmlElement& element) {
    if (element.name != "model" || element.space != kCore) {
      fail("the element '" + std::string(element.name.substr(0, 80)) + "' of '" +
           std::string(element.space.substr(0, 200)) + "' is no 3MF model, expected that of " +
           std::string(kCore));
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
    if (has(element, kCompatibility, "Ignorable", value)) {
      for_words(value, [&](std::string_view prefix) { ignorable_.insert(space_of(prefix)); });
    }
    return In3mf::model;
  }

  double unit_mm(std::string_view unit) const {
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

  std::string space_of(std::string_view prefix) const {
    const auto found = spaces_.find(prefix);
    if (found == spaces_.end()) {
      fail("the prefix '" + std::string(prefix.substr(0, 40)) + "' stands for no namespace");
    }
    return found->second;
  }

  void require(std::string_view prefix) const {
    const std::string space = space_of(prefix);
    if (is_read(space)) return;
    fail("requires the extension '" + std::string(prefix.substr(0, 40)) + "' (" + space +
         "), which is not read: without it another part would print");
  }

  /// Elements of other namespaces are left out, and told.
  In3mf skip_foreign(const XmlElement& element) {
    if (!is_read(element.space) && !ignorable_.contains(element.space)) {
      unread_.emplace(element.space, element.name);
    }
    return In3mf::skipped;
  }

  In3mf begin_in(In3mf in, const XmlElement& element) {
    const bool core = element.space == kCore;
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
        if (element.space == kBeams && name == "beams") return In3mf::beams;
        if (element.space == kBalls && name == "balls") return In3mf::balls;
        if (element.space == kBeams && name == "beamsets") return In3mf::skipped;
        if (element.space == kBeams) fail_unknown(element);
        return skip_foreign(element);
      case In3mf::beams:
        if (element.space == kBeams && name == "beam") return add_beam(element);
        fail_unknown(element);
      case In3mf::balls:
        if (element.space == kBalls && name == "ball") return add_ball(element);
        fail_unknown(element);
      case In3mf::stack:
        return begin_in_stack(element);
      case In3mf::slice:
        if (element.space != kSlices) return skip_foreign(element);
        if (name == "vertices") return In3mf::slice_points;
        if (name == "polygon") return begin_polygon(element);
        fail_unknown(element);
      case In3mf::slice_points:
        if (element.space != kSlices || name != "vertex") fail_unknown(element);
        slice().points.push_back({number(element, "x"), number(element, "y")});
        return In3mf::skipped;
      case In3mf::polygon:
        if (element.space != kSlices || name != "segment") fail_unknown(element);
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

  In3mf once(bool& seen, In3mf in, const XmlElement& element) const {
    if (seen) fail("the element '" + std::string(element.name) + "' is there twice");
    seen = true;
    return in;
  }

  In3mf add_metadata(const XmlElement& element) {
    const std::string name(text(element, "name"));
    // Descriptions and the like may be several.
    const bool single = name == "Title" || name == "Application" || name == "Rating" ||
                        name == "CreationDate" || name == "ModificationDate";
    if (metadata_.insert(name).second || !single) return In3mf::skipped;
    fail("the metadata '" + name + "' are there twice");
  }

  /// The id of a resource, which no other may have.
  std::uint32_t new_id(const XmlElement& element) {
    const std::uint32_t id = whole(element, "id", 1);
    if (!ids_.insert(id).second) {
      fail("the id " + std::to_string(id) + " belongs to another resource, too");
    }
    return id;
  }

  In3mf begin_resource(const XmlElement& element) {
    const std::string_view name = element.name;
    if (element.space == kCore && name == "object") return begin_object(element);
    if (element.space == kSlices && name == "slicestack") {
      const std::uint32_t id = new_id(element);
      stack_ = &model_.slices[id];
      stack_->line = line();
      std::string_view value;
      if (has(element, {}, "zbottom", value)) stack_->bottom = number(value, "zbottom");
      return In3mf::stack;
    }
    if (element.space == kMaterials || (element.space == kCore && name == "basematerials")) {
      return begin_properties(element);
    }
    if (element.space == kCore || element.space == kSlices) fail_unknown(element);
    return skip_foreign(element);
  }

  void refuse(const std::string& wrong, const XmlElement& element) const {
    if (!wrong.empty()) fail("the element '" + std::string(element.name) + "' " + wrong);
  }

  In3mf begin_properties(const XmlElement& element) {
    using Kind = Properties3mf::Kind;
    const Kind kind = Properties3mf::kind_of(element.name);
    const std::uint32_t id = new_id(element);
    std::vector<std::uint32_t> named;
    if (kind == Kind::texture) {
      text(element, "path");
      const std::string_view type = text(element, "contenttype");
      if (type != "image/png" && type != "image/jpeg") {
        fail("a texture of the content type '" + std::string(type.substr(0, 40)) +
             "', expected image/png or image/jpeg");
      }
    } else if (kind == Kind::texture_places) {
      named.push_back(whole(element, "texid", 1));
    } else if (kind == Kind::composites) {
      named.push_back(whole(element, "matid", 1));
      for_words(text(element, "matindices"),
                [&](std::string_view word) { whole(word, "matindices", 0); });
    } else if (kind == Kind::multiple) {
      for_words(text(element, "pids"),
                [&](std::string_view word) { named.push_back(whole(word, "pids", 1)); });
    }
    refuse(properties_.add(id, kind, named), element);
    return In3mf::property_group;
  }

  void check_property(const XmlElement& element) const {
    const std::string_view name = element.name;
    if (name == "color") {
      check_colour(text(element, "color"));
    } else if (name == "base") {
      text(element, "name");
      check_colour(text(element, "displaycolor"));
    } else if (name == "tex2coord") {
      number(element, "u");
      number(element, "v");
    } else if (name == "composite") {
      for_words(text(element, "values"), [&](std::string_view word) { number(word, "values"); });
    } else if (name == "multi") {
      for_words(text(element, "pindices"),
                [&](std::string_view word) { whole(word, "pindices", 0); });
    }
  }

  void check_colour(std::string_view colour) const {
    const bool sound = (colour.size() == 7 || colour.size() == 9) && colour[0] == '#' &&
                       colour.find_first_not_of("0123456789abcdefABCDEF", 1) == colour.npos;
    if (!sound) {
      fail("a colour '" + std::string(colour.substr(0, 40)) + "', expected #RRGGBB or #RRGGBBAA");
    }
  }

  /// The pid of an element, where it has one.
  void check_properties(const XmlElement& element) {
    std::string_view value;
    if (!has(element, {}, "pid", value)) return;
    const std::uint32_t id = whole(value, "pid", 1);
    if (id == sound_properties_) return;
    refuse(properties_.check_used(id), element);
    sound_properties_ = id;
  }

  In3mf begin_object(const XmlElement& element) {
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
    if (has(element, kSlices, "slicestackid", value)) {
      object_.slices = whole(value, "slicestackid", 1);
    }
    if (has(element, kSlices, "slicepath", value)) object_.slices_path = value;
    if (has(element, kSlices, "meshresolution", value)) {
      if (value != "lowres" && value != "fullres") {
        fail("meshresolution '" + std::string(value.substr(0, 40)) +
             "', expected fullres or lowres");
      }
      object_.coarse_mesh = value == "lowres";
    }
    if (object_.coarse_mesh && object_.slices == 0) {
      fail("the mesh of the object " + std::to_string(object_.id) +
           " stands in for slices (lowres), and the object names none");
    }
    return In3mf::object;
  }

  Type3mf type_named(std::string_view name) const {
    if (name == "model") return Type3mf::model;
    if (name == "solidsupport") return Type3mf::solid_support;
    if (name == "support") return Type3mf::support;
    if (name == "surface") return Type3mf::surface;
    if (name == "other") return Type3mf::other;
    fail("an object of the type '" + std::string(name.substr(0, 40)) +
         "', expected model, solidsupport, support, surface or other");
  }

  In3mf begin_in_object(const XmlElement& element) {
    if (element.space != kCore) return skip_foreign(element);
    if (element.name == "metadatagroup") return In3mf::metadata_group;
    if (element.name == "mesh") return once(geometry_, In3mf::mesh, element);
    if (element.name == "components") return once(geometry_, In3mf::components, element);
    fail_unknown(element);
  }

  void end_object() {
    if (!geometry_) {
      throw InputError(path_, part_ + ", line " + std::to_string(object_.line),
                       "the object " + std::to_string(object_.id) +
                           " has neither a mesh nor components that are read");
    }
    model_.objects.emplace(object_.id, std::move(object_));
  }

  In3mf begin_in_mesh(const XmlElement& element) {
    if (element.space == kBeams && element.name == "beamlattice") return begin_lattice(element);
    if (element.space != kCore) return skip_foreign(element);
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

  In3mf add_vertex(const XmlElement& element) {
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

  double coordinate(std::string_view text, unsigned axis) const {
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error == std::errc() && end == text.data() + text.size() && std::isfinite(value)) {
      return value;
    }
    // Names for errors, and blanks around a number, are rare.
    return number(trimmed(text), std::string(1, "xyz"[axis]) + " of vertex " +
                                     std::to_string(object_.vertices.size() + 1));
  }

  In3mf add_triangle(const XmlElement& element) {
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

  void end_mesh() {
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
    for (std::size_t i = 0; i < lattice.balls.size(); ++i)
      check(lattice.balls[i].vertex, "ball", i);
  }

  In3mf begin_lattice(const XmlElement& element) {
    if (object_.lattice) fail("the element 'beamlattice' is there twice");
    if (object_.type != Type3mf::model && object_.type != Type3mf::solid_support) {
      fail("beams in an object that is no model and no solidsupport");
    }
    Lattice3mf& lattice = object_.lattice.emplace();
    lattice.radius = positive(element, "radius");
    std::string_view value;
    // Early files lack it; beams without length are left out anyway.
    if (has(element, {}, "minlength", value)) lattice.least_length = number(value, "minlength");
    if (has(element, {}, "cap", value)) lattice.cap = cap_named(value);
    for (const std::string_view name : {"clippingmode", "clipping"}) {
      if (!has(element, {}, name, value)) continue;
      if (value == "inside") {
        lattice.clipping = Lattice3mf::Clipping::inside;
      } else if (value == "outside") {
        lattice.clipping = Lattice3mf::Clipping::outside;
      } else if (value != "none") {
        fail("clippingmode '" + std::string(value.substr(0, 40)) +
             "', expected none, inside or outside");
      }
    }
    if (lattice.clipping != Lattice3mf::Clipping::none) {
      lattice.clipping_mesh = whole(element, "clippingmesh", 1);
      const auto found = model_.objects.find(lattice.clipping_mesh);
      if (found == model_.objects.end() || !found->second.components.empty() ||
          found->second.lattice) {
        fail("clippingmesh " + std::to_string(lattice.clipping_mesh) +
             " is no object with nothing but a mesh before this one");
      }
    }
    for (const std::string_view space : {kBalls, std::string_view()}) {
      if (has(element, space, "ballmode", value)) {
        if (value == "all") {
          lattice.ball_mode = Lattice3mf::Balls::all;
        } else if (value == "mixed") {
          lattice.ball_mode = Lattice3mf::Balls::mixed;
        } else if (value != "none") {
          fail("ballmode '" + std::string(value.substr(0, 40)) + "', expected none, mixed or all");
        }
      }
      if (has(element, space, "ballradius", value)) {
        lattice.ball_radius = radius(value, "ballradius");
      }
    }
    if (lattice.ball_mode == Lattice3mf::Balls::all && !lattice.ball_radius) {
      fail("balls at all vertices (ballmode) without a ballradius");
    }
    return In3mf::lattice;
  }

  double radius(std::string_view text, std::string_view what) const {
    const double value = number(text, what);
    if (!(value > 0)) fail("a number above 0 expected for " + std::string(what));
    return value;
  }

  Cap3mf cap_named(std::string_view name) const {
    if (name == "sphere") return Cap3mf::sphere;
    if (name == "hemisphere") return Cap3mf::hemisphere;
    if (name == "butt") return Cap3mf::butt;
    fail("a cap '" + std::string(name.substr(0, 40)) + "', expected sphere, hemisphere or butt");
  }

  In3mf add_beam(const XmlElement& element) {
    Lattice3mf& lattice = *object_.lattice;
    Lattice3mf::Beam beam{whole(element, "v1", 0),
                          whole(element, "v2", 0),
                          lattice.radius,
                          lattice.radius,
                          lattice.cap,
                          lattice.cap};
    std::string_view value;
    if (has(element, {}, "r1", value)) beam.r1 = beam.r2 = radius(value, "r1");
    if (has(element, {}, "r2", value)) {
      beam.r2 = radius(value, "r2");
      std::string_view first;
      if (!has(element, {}, "r1", first)) fail("a beam has r2 without r1");
    }
    if (has(element, {}, "cap1", value)) beam.cap1 = cap_named(value);
    if (has(element, {}, "cap2", value)) beam.cap2 = cap_named(value);
    if (beam.v1 == beam.v2) {
      fail("beam " + std::to_string(lattice.beams.size() + 1) + " begins and ends at one vertex");
    }
    lattice.beams.push_back(beam);
    return In3mf::skipped;
  }

  In3mf add_ball(const XmlElement& element) {
    Lattice3mf& lattice = *object_.lattice;
    Lattice3mf::Ball ball{whole(element, "vindex", 0), 0};
    std::string_view value;
    if (has(element, {}, "r", value)) {
      ball.radius = radius(value, "r");
    } else if (lattice.ball_radius) {
      ball.radius = *lattice.ball_radius;
    } else {
      fail("a ball without a radius, and the lattice has no ballradius");
    }
    lattice.balls.push_back(ball);
    return In3mf::skipped;
  }

  In3mf begin_in_stack(const XmlElement& element) {
    if (element.space != kSlices) return skip_foreign(element);
    if (element.name == "slice") {
      if (!stack_->references.empty())
        fail("slices beside references to slices, expected one kind");
      Slices3mf::Slice& slice = stack_->slices.emplace_back();
      slice.line = line();
      slice.top = number(element, "ztop");
      return In3mf::slice;
    }
    if (element.name != "sliceref") fail_unknown(element);
    if (!stack_->slices.empty()) fail("slices beside references to slices, expected one kind");
    stack_->references.push_back(
        {whole(element, "slicestackid", 1), std::string(text(element, "slicepath")), line()});
    return In3mf::skipped;
  }

  Slices3mf::Slice& slice() { return stack_->slices.back(); }

  In3mf begin_polygon(const XmlElement& element) {
    slice().contours.push_back({whole(element, "startv", 0)});
    return In3mf::polygon;
  }

  void end_polygon() {
    std::vector<std::uint32_t>& contour = slice().contours.back();
    for (const std::uint32_t point : contour) {
      if (point < slice().points.size()) continue;
      fail("vertex " + std::to_string(point) + " (counted from 0) is out of range, the slice has " +
           std::to_string(slice().points.size()));
    }
    if (contour.size() > 1 && contour.front() == contour.back()) {
      contour.pop_back();
    } else {
      slice().open = true;
    }
  }

  void end_slice() {
    const auto& slices = stack_->slices;
    // The first one is looked at where it is known what lies below.
    if (slices.size() < 2 || slices.back().top > slices[slices.size() - 2].top) return;
    throw InputError(path_, part_ + ", line " + std::to_string(slices.back().line),
                     "a slice whose top (ztop) is not above what lies below it");
  }

  Component3mf reference(const XmlElement& element) const {
    Component3mf found;
    found.line = line();
    found.object = whole(element, "objectid", 1);
    std::string_view value;
    if (has(element, kProduction, "path", value)) found.path = value;
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

  In3mf add_item(const XmlElement& element) {
    Item3mf item{reference(element)};
    std::string_view value;
    if (has(element, {}, "printable", value)) item.printable = value != "0" && value != "false";
    model_.items.push_back(std::move(item));
    return In3mf::item;
  }

  Model3mf model_;
  std::vector<In3mf> inside_;
  bool resources_ = false, build_ = false, geometry_ = false;
  std::set<std::string> metadata_;
  std::set<std::uint32_t> ids_;
  std::set<std::string, std::less<>> ignorable_;
  std::map<std::string, std::string> unread_;  ///< by namespace, the first element's name
  Properties3mf properties_;
  std::uint32_t sound_properties_ = 0;
  Object3mf object_;
  Slices3mf* stack_ = nullptr;
};

}  // namespace

Model3mf read_model_3mf(const Package3mf& package, const std::string& part,
                        const std::string& path) {
  ModelReader3mf reader(path, part);
  package.read_xml(part, reader);
  return reader.take();
}

}  // namespace slicecorr::detail
