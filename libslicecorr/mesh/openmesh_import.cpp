// The only place that talks to OpenMesh: an importer that just collects, as a half-edge mesh would
// drop or duplicate non-manifold faces.
#include <OpenMesh/Core/IO/IOManager.hh>
#include <OpenMesh/Core/IO/importer/BaseImporter.hh>
#include <OpenMesh/Core/System/omstream.hh>
#include <locale>
#include <mutex>
#include <sstream>

#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

using namespace OpenMesh;  // NOLINT: the interface names two dozen of its types

class Collector final : public IO::BaseImporter {
 public:
  explicit Collector(const std::string& path) : mesh_(path) {}
  PolygonMesh& mesh() { return mesh_; }

  VertexHandle add_vertex(const Vec3f& p) override {
    return VertexHandle(static_cast<int>(mesh_.add_vertex({p[0], p[1], p[2]})));
  }
  VertexHandle add_vertex(const Vec3d& p) override {
    return VertexHandle(static_cast<int>(mesh_.add_vertex({p[0], p[1], p[2]})));
  }
  VertexHandle add_vertex() override {
    return VertexHandle(static_cast<int>(mesh_.add_vertex(Point3{})));
  }
  void set_point(VertexHandle vertex, const Vec3f& p) override {
    mesh_.set_vertex(static_cast<std::size_t>(vertex.idx()), {p[0], p[1], p[2]});
  }
  FaceHandle add_face(const VHandles& corners) override {
    mesh_.begin_face();
    for (const VertexHandle corner : corners) mesh_.add_corner(corner.idx());
    return FaceHandle(static_cast<int>(mesh_.face_count() - 1));
  }
  std::size_t n_vertices() const override { return mesh_.vertex_count(); }
  std::size_t n_faces() const override { return mesh_.face_count(); }
  std::size_t n_edges() const override { return 0; }

  // Nothing below matters for a solid.
  HalfedgeHandle add_edge(VertexHandle, VertexHandle) override { return HalfedgeHandle(); }
  FaceHandle add_face(HalfedgeHandle) override { return FaceHandle(); }
  void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec2f>&) override {}
  void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec3f>&) override {}
  void set_face_texindex(FaceHandle, int) override {}
  void set_halfedge(VertexHandle, HalfedgeHandle) override {}
  void set_normal(VertexHandle, const Vec3f&) override {}
  void set_normal(VertexHandle, const Vec3d&) override {}
  void set_color(VertexHandle, const Vec3uc&) override {}
  void set_color(VertexHandle, const Vec4uc&) override {}
  void set_color(VertexHandle, const Vec3f&) override {}
  void set_color(VertexHandle, const Vec4f&) override {}
  void set_texcoord(VertexHandle, const Vec2f&) override {}
  void set_status(VertexHandle, const Attributes::StatusInfo&) override {}
  void set_next(HalfedgeHandle, HalfedgeHandle) override {}
  void set_face(HalfedgeHandle, FaceHandle) override {}
  void request_face_texcoords2D() override {}
  void set_texcoord(HalfedgeHandle, const Vec2f&) override {}
  void set_texcoord(VertexHandle, const Vec3f&) override {}
  void set_texcoord(HalfedgeHandle, const Vec3f&) override {}
  void set_status(HalfedgeHandle, const Attributes::StatusInfo&) override {}
  void set_color(EdgeHandle, const Vec3uc&) override {}
  void set_color(EdgeHandle, const Vec4uc&) override {}
  void set_color(EdgeHandle, const Vec3f&) override {}
  void set_color(EdgeHandle, const Vec4f&) override {}
  void set_status(EdgeHandle, const Attributes::StatusInfo&) override {}
  void set_normal(FaceHandle, const Vec3f&) override {}
  void set_normal(FaceHandle, const Vec3d&) override {}
  void set_color(FaceHandle, const Vec3uc&) override {}
  void set_color(FaceHandle, const Vec4uc&) override {}
  void set_color(FaceHandle, const Vec3f&) override {}
  void set_color(FaceHandle, const Vec4f&) override {}
  void set_status(FaceHandle, const Attributes::StatusInfo&) override {}
  void add_texture_information(int, std::string) override {}

 private:
  PolygonMesh mesh_;
};

}  // namespace

TriangleMesh parse_with_openmesh(std::string text, const std::string& extension, bool binary,
                                 std::size_t vertices, std::size_t faces, const std::string& path) {
  Collector collector(path);
  {
    // OpenMesh's readers are global objects that keep state while they read.
    static std::mutex mutex;
    const std::lock_guard lock(mutex);
    omlog().disable();
    omout().disable();
    omerr().disable();
    std::istringstream in(std::move(text));
    in.imbue(std::locale::classic());
    // The readers do not look at the stream's state; this stops them where it goes bad.
    in.exceptions(std::ios::failbit | std::ios::badbit);
    IO::Options options;
    if (binary) options += IO::Options::Binary;
    bool done = false;
    try {
      done = IO::IOManager().read(in, extension, collector, options);
    } catch (const std::ios_base::failure&) {
      done = false;
    }
    const PolygonMesh& mesh = collector.mesh();
    if (!done || mesh.vertex_count() != vertices || mesh.face_count() != faces) {
      throw InputError(path, "",
                       "can't be read: after " + std::to_string(mesh.vertex_count()) + " of " +
                           std::to_string(vertices) + " vertices and " +
                           std::to_string(mesh.face_count()) + " of " + std::to_string(faces) +
                           " faces something is not a number, or too large for one");
    }
  }
  return collector.mesh().finish();
}

}  // namespace slicecorr::detail
