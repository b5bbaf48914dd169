// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What extensions of 3MF say in a model: materials, which are checked alone, beams and balls, slices.
#include "mesh/model_reader_3mf.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

In3mf ModelReader3mf::begin_properties(const XmlElement& element) {
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

void ModelReader3mf::check_property(const XmlElement& element) const {
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

void ModelReader3mf::check_colour(std::string_view colour) const {
  const bool sound = (colour.size() == 7 || colour.size() == 9) && colour[0] == '#' &&
                     colour.find_first_not_of("0123456789abcdefABCDEF", 1) == colour.npos;
  if (!sound) {
    fail("a colour '" + std::string(colour.substr(0, 40)) + "', expected #RRGGBB or #RRGGBBAA");
  }
}

void ModelReader3mf::check_properties(const XmlElement& element) {
  std::string_view value;
  if (!has(element, {}, "pid", value)) return;
  const std::uint32_t id = whole(value, "pid", 1);
  if (id == sound_properties_) return;
  refuse(properties_.check_used(id), element);
  sound_properties_ = id;
}

In3mf ModelReader3mf::begin_lattice(const XmlElement& element) {
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
  for (const std::string_view space : {spaces_3mf::kBalls, std::string_view()}) {
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

double ModelReader3mf::radius(std::string_view text, std::string_view what) const {
  const double value = number(text, what);
  if (!(value > 0)) fail("a number above 0 expected for " + std::string(what));
  return value;
}

Cap3mf ModelReader3mf::cap_named(std::string_view name) const {
  if (name == "sphere") return Cap3mf::sphere;
  if (name == "hemisphere") return Cap3mf::hemisphere;
  if (name == "butt") return Cap3mf::butt;
  fail("a cap '" + std::string(name.substr(0, 40)) + "', expected sphere, hemisphere or butt");
}

In3mf ModelReader3mf::add_beam(const XmlElement& element) {
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

In3mf ModelReader3mf::add_ball(const XmlElement& element) {
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

In3mf ModelReader3mf::begin_in_stack(const XmlElement& element) {
  if (element.space != spaces_3mf::kSlices) return skip_foreign(element);
  if (element.name == "slice") {
    if (!stack_->references.empty()) fail("slices beside references to slices, expected one kind");
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

In3mf ModelReader3mf::begin_polygon(const XmlElement& element) {
  slice().contours.push_back({whole(element, "startv", 0)});
  return In3mf::polygon;
}

void ModelReader3mf::end_polygon() {
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

void ModelReader3mf::end_slice() {
  const auto& slices = stack_->slices;
  // The first one is looked at where it is known what lies below.
  if (slices.size() < 2 || slices.back().top > slices[slices.size() - 2].top) return;
  throw InputError(path_, part_ + ", line " + std::to_string(slices.back().line),
                   "a slice whose top (ztop) is not above what lies below it");
}

}  // namespace slicecorr::detail
