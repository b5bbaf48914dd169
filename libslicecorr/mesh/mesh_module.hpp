// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What OpenMesh and Expat do for us, behind a module that is loaded when a mesh needs them: thousands
/// of names are looked up for OpenMesh, a tenth of the time in which programs start.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Gets what OpenMesh finds, in the order of the file.
class MeshSink {
 public:
  virtual ~MeshSink() = default;
  virtual void add_vertex(const Point3& point) = 0;
  virtual void set_vertex(std::size_t index, const Point3& point) = 0;
  virtual void add_face(std::span<const int> corners) = 0;
  virtual std::size_t vertex_count() const = 0;
  virtual std::size_t face_count() const = 0;
};

/// `space` is the URI of a name's namespace, empty where it has none. Texts live until the call ends.
struct XmlAttribute {
  std::string_view space, name, value;
};
struct XmlElement {
  std::string_view space, name;
  std::span<const XmlAttribute> attributes;
};

/// Gets the elements of an XML text while it is read.
class XmlSink {
 public:
  virtual ~XmlSink() = default;
  /// A prefix of the element that begins next stands for this namespace.
  virtual void prefix(std::string_view prefix, std::string_view space) = 0;
  virtual void begin(const XmlElement& element) = 0;
  virtual void end() = 0;
  /// The line of the text that is being read. Costs time; for errors.
  std::function<std::size_t()> line;
};

struct XmlFault {
  std::string words;
  std::size_t line = 0;
};

struct MeshFunctions {
  /// Lets OpenMesh parse the text; false where something is not a number, or too large for one.
  /// Thread-safe. What the sink throws passes through.
  bool (*parse)(std::string text, const std::string& extension, bool binary, MeshSink& sink);
  /// Lets Expat parse an XML text that comes piece by piece, the last one empty. In UTF-8 only, and
  /// without a document type, so that it has no entities of its own. False, with what is wrong in
  /// `fault`, where it is no such text. Thread-safe. What `piece` and the sink throw passes through.
  bool (*parse_xml)(const std::function<std::string_view()>& piece, XmlSink& sink, XmlFault& fault);
};

/// Loads the module at the first call. Thread-safe. Throws `DeviceError` when it is not there.
const MeshFunctions& mesh_functions();

/// Name of the function by which the module gives its functions.
inline constexpr const char* kMeshModuleEntry = "slicecorr_mesh_functions";

}  // namespace slicecorr::detail
