// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The module slicecorr-meshes: OpenMesh's readers with an importer that just collects, as a half-edge
// mesh would drop or duplicate non-manifold faces; and Expat, which reads the XML of 3MF.
#include <expat.h>

#include <OpenMesh/Core/IO/IOManager.hh>
#include <OpenMesh/Core/IO/importer/BaseImporter.hh>
#include <OpenMesh/Core/System/omstream.hh>
#include <exception>
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

/// Between the namespace and the name that Expat gives as one; no character of either.
constexpr char kSeparator = '\n';

/// A text while Expat reads it. No exception may pass through its frames.
class XmlRun {
 public:
  explicit XmlRun(XmlSink& sink) : sink_(sink), parser_(XML_ParserCreateNS("UTF-8", kSeparator)) {
    if (parser_ == nullptr) throw std::bad_alloc();
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, on_begin, on_end);
    XML_SetStartNamespaceDeclHandler(parser_, on_prefix);
    XML_SetXmlDeclHandler(parser_, on_declaration);
    XML_SetStartDoctypeDeclHandler(parser_, on_document_type);
    sink_.line = [this] { return line(); };
  }
  XmlRun(const XmlRun&) = delete;
  XmlRun& operator=(const XmlRun&) = delete;
  ~XmlRun() {
    sink_.line = nullptr;
    XML_ParserFree(parser_);
  }

  bool parse(const std::function<std::string_view()>& piece, XmlFault& fault) {
    for (bool first = true;; first = false) {
      const std::string_view bytes = piece();
      if (first &&
          bytes.substr(0, 4).find_first_of(std::string_view("\0\xfe\xff", 3)) != bytes.npos) {
        fault = {"is not in UTF-8", 1};
        return false;
      }
      const auto size = static_cast<int>(bytes.size());
      const XML_Status status = XML_Parse(parser_, bytes.data(), size, bytes.empty());
      if (thrown_) std::rethrow_exception(thrown_);
      if (status != XML_STATUS_OK) {
        fault = {refused_.empty() ? XML_ErrorString(XML_GetErrorCode(parser_)) : refused_, line()};
        return false;
      }
      if (bytes.empty()) return true;
    }
  }

 private:
  template <class Do>
  void safely(const Do& what) {
    if (thrown_ || !refused_.empty()) return;
    try {
      what();
    } catch (...) {
      thrown_ = std::current_exception();
      XML_StopParser(parser_, XML_FALSE);
    }
  }
  void refuse(const char* words) {
    refused_ = words;
    XML_StopParser(parser_, XML_FALSE);
  }
  std::size_t line() const { return static_cast<std::size_t>(XML_GetCurrentLineNumber(parser_)); }
  static std::pair<std::string_view, std::string_view> parts_of(const XML_Char* full) {
    const std::string_view name(full);
    const std::size_t at = name.find(kSeparator);
    if (at == name.npos) return {{}, name};
    return {name.substr(0, at), name.substr(at + 1)};
  }
  static XmlRun& run_of(void* data) { return *static_cast<XmlRun*>(data); }
  static void XMLCALL on_begin(void* data, const XML_Char* name, const XML_Char** attributes) {
    XmlRun& run = run_of(data);
    run.safely([&] {
      run.attributes_.clear();
      for (; *attributes != nullptr; attributes += 2) {
        const auto [space, own] = parts_of(attributes[0]);
        run.attributes_.push_back({space, own, attributes[1]});
      }
      const auto [space, own] = parts_of(name);
      run.sink_.begin({space, own, run.attributes_});
    });
  }
  static void XMLCALL on_end(void* data, const XML_Char*) {
    XmlRun& run = run_of(data);
    run.safely([&] { run.sink_.end(); });
  }
  static void XMLCALL on_prefix(void* data, const XML_Char* prefix, const XML_Char* space) {
    XmlRun& run = run_of(data);
    run.safely([&] { run.sink_.prefix(prefix ? prefix : "", space ? space : ""); });
  }
  static void XMLCALL on_declaration(void* data, const XML_Char*, const XML_Char* encoding, int) {
    if (encoding == nullptr) return;
    std::string name(encoding);
    for (char& c : name) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    if (name != "utf-8") run_of(data).refuse("says that it is not in UTF-8");
  }
  static void XMLCALL on_document_type(void* data, const XML_Char*, const XML_Char*,
                                       const XML_Char*, int) {
    run_of(data).refuse("declares a document type, which 3MF does not allow");
  }

  XmlSink& sink_;
  XML_Parser parser_;
  std::vector<XmlAttribute> attributes_;
  std::exception_ptr thrown_;
  std::string refused_;
};

bool parse_xml(const std::function<std::string_view()>& piece, XmlSink& sink, XmlFault& fault) {
  return XmlRun(sink).parse(piece, fault);
}

constexpr MeshFunctions kFunctions{.parse = parse, .parse_xml = parse_xml};

}  // namespace
}  // namespace slicecorr::detail

extern "C" __attribute__((visibility("default"))) const slicecorr::detail::MeshFunctions*
slicecorr_mesh_functions() {
  return &slicecorr::detail::kFunctions;
}
