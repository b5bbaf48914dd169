// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/mesh_module.hpp"
#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

class Collected final : public MeshSink {
 public:
  explicit Collected(const std::string& path) : mesh(path) {}
  void add_vertex(const Point3& point) override { mesh.add_vertex(point); }
  void set_vertex(std::size_t index, const Point3& point) override {
    mesh.set_vertex(index, point);
  }
  void add_face(std::span<const int> corners) override {
    mesh.begin_face();
    for (const int corner : corners) mesh.add_corner(corner);
  }
  std::size_t vertex_count() const override { return mesh.vertex_count(); }
  std::size_t face_count() const override { return mesh.face_count(); }

  PolygonMesh mesh;
};

}  // namespace

TriangleMesh parse_with_openmesh(std::string text, const std::string& extension, bool binary,
                                 std::size_t vertices, std::size_t faces, const std::string& path) {
  Collected found(path);
  const bool done = mesh_functions().parse(std::move(text), extension, binary, found);
  if (!done || found.vertex_count() != vertices || found.face_count() != faces) {
    throw InputError(path, "",
                     "can't be read: after " + std::to_string(found.vertex_count()) + " of " +
                         std::to_string(vertices) + " vertices and " +
                         std::to_string(found.face_count()) + " of " + std::to_string(faces) +
                         " faces something is not a number, or too large for one");
  }
  return found.mesh.finish();
}

}  // namespace slicecorr::detail
