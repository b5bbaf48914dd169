// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The module slicecorr-meshes: OpenMesh's readers with an importer that just collects, as a half-edge
// mesh would drop or duplicate non-manifold faces; and lib3mf.
#include <OpenMesh/Core/IO/IOManager.hh>
#include <OpenMesh/Core/IO/importer/BaseImporter.hh>
#include <OpenMesh/Core/System/omstream.hh>
#include <locale>
#include <mutex>
#include <sstream>
#include <utility>
#include <vector>

#include "mesh/mesh_module.hpp"

namespace slicecorr::detail {
namespace {

using namespace OpenMesh;  // NOLINT: the interface names two dozen of its types

class Collector final : public IO::BaseImporter {
 public:
  explicit Collector(MeshSink& sink) : sink_(sink) {}

  VertexHandle add_vertex(const Vec3f& p) override { return add({p[0], p[1], p[2]}); }
  VertexHandle add_vertex(const Vec3d& p) override { return add({p[0], p[1], p[2]}); }
  VertexHandle add_vertex() override { return add(Point3{}); }
  void set_point(VertexHandle vertex, const Vec3f& p) override {
    sink_.set_vertex(static_cast<std::size_t>(vertex.idx()), {p[0], p[1], p[2]});
  }
  FaceHandle add_face(const VHandles& corners) override {
    corners_.clear();
    for (const VertexHandle corner : corners) corners_.push_back(corner.idx());
    sink_.add_face(corners_);
    return FaceHandle(static_cast<int>(sink_.face_count() - 1));
  }
  std::size_t n_vertices() const override { return sink_.vertex_count(); }
  std::size_t n_faces() const override { return sink_.face_count(); }
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
  VertexHandle add(const Point3& point) {
    sink_.add_vertex(point);
    return VertexHandle(static_cast<int>(sink_.vertex_count() - 1));
  }
  MeshSink& sink_;
  std::vector<int> corners_;
};

bool parse(std::string text, const std::string& extension, bool binary, MeshSink& sink) {
  Collector collector(sink);
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
  try {
    return IO::IOManager().read(in, extension, collector, options);
  } catch (const std::ios_base::failure&) {
    return false;
  }
}

constexpr MeshFunctions kFunctions{
    .parse = parse,
    .lib3mf =
        {
            .builditem_getobjectresource = NMR::lib3mf_builditem_getobjectresource,
            .builditem_getobjecttransform = NMR::lib3mf_builditem_getobjecttransform,
            .builditem_hasobjecttransform = NMR::lib3mf_builditem_hasobjecttransform,
            .builditemiterator_getcurrent = NMR::lib3mf_builditemiterator_getcurrent,
            .builditemiterator_movenext = NMR::lib3mf_builditemiterator_movenext,
            .component_getobjectresource = NMR::lib3mf_component_getobjectresource,
            .component_gettransform = NMR::lib3mf_component_gettransform,
            .component_hastransform = NMR::lib3mf_component_hastransform,
            .componentsobject_getcomponent = NMR::lib3mf_componentsobject_getcomponent,
            .componentsobject_getcomponentcount = NMR::lib3mf_componentsobject_getcomponentcount,
            .createmodel = NMR::lib3mf_createmodel,
            .getlasterror = NMR::lib3mf_getlasterror,
            .meshobject_gettrianglecount = NMR::lib3mf_meshobject_gettrianglecount,
            .meshobject_gettriangleindices = NMR::lib3mf_meshobject_gettriangleindices,
            .meshobject_getvertexcount = NMR::lib3mf_meshobject_getvertexcount,
            .meshobject_getvertices = NMR::lib3mf_meshobject_getvertices,
            .model_getbuilditems = NMR::lib3mf_model_getbuilditems,
            .model_getunit = NMR::lib3mf_model_getunit,
            .model_queryreader = NMR::lib3mf_model_queryreader,
            .object_iscomponentsobject = NMR::lib3mf_object_iscomponentsobject,
            .object_ismeshobject = NMR::lib3mf_object_ismeshobject,
            .reader_getwarningcount = NMR::lib3mf_reader_getwarningcount,
            .reader_getwarningutf8 = NMR::lib3mf_reader_getwarningutf8,
            .reader_readfrombuffer = NMR::lib3mf_reader_readfrombuffer,
            .release = NMR::lib3mf_release,
        },
};

}  // namespace
}  // namespace slicecorr::detail

extern "C" __attribute__((visibility("default"))) const slicecorr::detail::MeshFunctions*
slicecorr_mesh_functions() {
  return &slicecorr::detail::kFunctions;
}
