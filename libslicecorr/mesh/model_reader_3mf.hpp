// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Reads the XML of a model part, element by element (model_3mf.cpp).
#pragma once

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "mesh/model_3mf.hpp"
#include "mesh/properties_3mf.hpp"
#include "mesh/spaces_3mf.hpp"

namespace slicecorr::detail {

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

  Model3mf take();

 private:
  void element_begins(const XmlElement& element, std::size_t depth) override;
  void element_ends(std::size_t) override;
  [[noreturn]] void fail_in_model(const std::string& what) const;
  [[noreturn]] void fail_unknown(const XmlElement& element) const;
  In3mf begin_model(const XmlElement& element);
  double unit_mm(std::string_view unit) const;
  std::string space_of(std::string_view prefix) const;
  void require(std::string_view prefix) const;
  /// Elements of other namespaces are left out, and told.
  In3mf skip_foreign(const XmlElement& element);
  In3mf begin_in(In3mf in, const XmlElement& element);
  In3mf once(bool& seen, In3mf in, const XmlElement& element) const;
  In3mf add_metadata(const XmlElement& element);
  /// The id of a resource, which no other may have.
  std::uint32_t new_id(const XmlElement& element);
  In3mf begin_resource(const XmlElement& element);
  void refuse(const std::string& wrong, const XmlElement& element) const;
  In3mf begin_object(const XmlElement& element);
  Type3mf type_named(std::string_view name) const;
  In3mf begin_in_object(const XmlElement& element);
  void end_object();
  In3mf begin_in_mesh(const XmlElement& element);
  In3mf add_vertex(const XmlElement& element);
  double coordinate(std::string_view text, unsigned axis) const;
  In3mf add_triangle(const XmlElement& element);
  void end_mesh();
  Component3mf reference(const XmlElement& element) const;
  In3mf add_item(const XmlElement& element);

  // Of extensions (model_extensions_3mf.cpp).
  In3mf begin_properties(const XmlElement& element);
  void check_property(const XmlElement& element) const;
  void check_colour(std::string_view colour) const;
  /// The pid of an element, where it has one.
  void check_properties(const XmlElement& element);
  In3mf begin_lattice(const XmlElement& element);
  double radius(std::string_view text, std::string_view what) const;
  Cap3mf cap_named(std::string_view name) const;
  In3mf add_beam(const XmlElement& element);
  In3mf add_ball(const XmlElement& element);
  In3mf begin_in_stack(const XmlElement& element);
  Slices3mf::Slice& slice() { return stack_->slices.back(); }
  In3mf begin_polygon(const XmlElement& element);
  void end_polygon();
  void end_slice();

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

}  // namespace slicecorr::detail
