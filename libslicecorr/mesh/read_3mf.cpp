// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// 3MF through lib3mf: units, components, transforms and all build items.
#include <cmath>

#include "mesh/mesh_module.hpp"
#include "mesh/mesh_parts.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kMostTriangles = 100'000'000;

const Lib3mf& lib3mf() { return mesh_functions().lib3mf; }

/// Owns one object of lib3mf.
class Handle {
 public:
  Handle() = default;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    if (object_) lib3mf().release(object_);
  }
  NMR::PLib3MFBase* get() const { return object_; }
  NMR::PLib3MFBase** out() { return &object_; }

 private:
  NMR::PLib3MFBase* object_ = nullptr;
};

/// Row vectors, as in the file: p' = (p, 1) * m, with the fourth column left out.
struct Transform {
  std::array<Point3, 4> rows{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};

  Point3 apply(const Point3& p) const {
    Point3 result;
    for (int c = 0; c < 3; ++c) {
      result[c] = p[0] * rows[0][c] + p[1] * rows[1][c] + p[2] * rows[2][c] + rows[3][c];
    }
    return result;
  }
  double determinant() const {
    const auto& [a, b, c, shift] = rows;
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
};

// First `inner`, then `outer`.
Transform combine(const Transform& inner, const Transform& outer) {
  Transform result;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 3; ++c) {
      double sum = r == 3 ? outer.rows[3][c] : 0.0;
      for (int k = 0; k < 3; ++k) sum += inner.rows[r][k] * outer.rows[k][c];
      result.rows[r][c] = sum;
    }
  }
  return result;
}

Transform from_lib(const NMR::MODELTRANSFORM& transform) {
  Transform result;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 3; ++c) result.rows[r][c] = transform.m_fFields[c][r];
  }
  return result;
}

class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path), pool_(1024) {}

  TriangleMesh read(FileBytes& bytes, double& unit_mm) {
    if (lib3mf().createmodel(model_.out()) != LIB3MF_OK) {
      throw InputError(path_, "", "lib3mf can't make a model");
    }
    Handle reader;
    check(lib3mf().model_queryreader(model_.get(), "3mf", reader.out()), model_);
    check(lib3mf().reader_readfrombuffer(reader.get(), reinterpret_cast<BYTE*>(bytes.data()),
                                         bytes.size()),
          reader);
    refuse_warnings(reader);
    unit_mm = read_unit();
    Handle items;
    check(lib3mf().model_getbuilditems(model_.get(), items.out()), model_);
    for (;;) {
      BOOL more = 0;
      check(lib3mf().builditemiterator_movenext(items.get(), &more), items);
      if (!more) break;
      Handle item, object;
      check(lib3mf().builditemiterator_getcurrent(items.get(), item.out()), items);
      check(lib3mf().builditem_getobjectresource(item.get(), object.out()), item);
      BOOL has_transform = 0;
      NMR::MODELTRANSFORM transform;
      check(lib3mf().builditem_hasobjecttransform(item.get(), &has_transform), item);
      if (has_transform) {
        check(lib3mf().builditem_getobjecttransform(item.get(), &transform), item);
      }
      add_object(object, has_transform ? from_lib(transform) : Transform());
    }
    if (mesh_.triangles.empty()) throw_no_triangles(path_);
    mesh_.vertices = pool_.take();
    return std::move(mesh_);
  }

 private:
  void check(int result, const Handle& object) const {
    if (result == LIB3MF_OK) return;
    DWORD code = 0;
    LPCSTR text = nullptr;
    lib3mf().getlasterror(object.get(), &code, &text);
    throw InputError(path_, "",
                     std::string("lib3mf: ") + (text && *text ? text : "unknown error") + " (" +
                         std::to_string(code) + ")");
  }

  // What lib3mf only warns of, but which may leave out or misplace material. Its other warnings are
  // about attributes, metadata and thumbnails.
  void refuse_warnings(const Handle& reader) const {
    constexpr DWORD invalid_unit = 0x801E, extension_required = 0x8092, unknown_element = 0x80A6;
    DWORD count = 0;
    check(lib3mf().reader_getwarningcount(reader.get(), &count), reader);
    for (DWORD i = 0; i < count; ++i) {
      DWORD code = 0;
      ULONG needed = 0;
      char text[512] = "";
      lib3mf().reader_getwarningutf8(reader.get(), i, &code, text, sizeof text, &needed);
      if (code != invalid_unit && code != extension_required && code != unknown_element) continue;
      throw InputError(path_, "",
                       std::string("lib3mf: ") + text + " (" + std::to_string(code) + ")");
    }
  }

  double read_unit() const {
    DWORD unit = NMR::MODELUNIT_MILLIMETER;
    check(lib3mf().model_getunit(model_.get(), &unit), model_);
    switch (unit) {
      case NMR::MODELUNIT_MICROMETER:
        return 0.001;
      case NMR::MODELUNIT_MILLIMETER:
        return 1.0;
      case NMR::MODELUNIT_CENTIMETER:
        return 10.0;
      case NMR::MODELUNIT_INCH:
        return 25.4;
      case NMR::MODELUNIT_FOOT:
        return 304.8;
      case NMR::MODELUNIT_METER:
        return 1000.0;
    }
    throw InputError(path_, "", "unknown unit " + std::to_string(unit));
  }

  void add_object(const Handle& object, const Transform& transform) {
    BOOL is_mesh = 0, is_components = 0;
    check(lib3mf().object_ismeshobject(object.get(), &is_mesh), object);
    if (is_mesh) return add_mesh(object, transform);
    check(lib3mf().object_iscomponentsobject(object.get(), &is_components), object);
    if (!is_components) return;
    DWORD count = 0;
    check(lib3mf().componentsobject_getcomponentcount(object.get(), &count), object);
    for (DWORD i = 0; i < count; ++i) {
      Handle component, child;
      check(lib3mf().componentsobject_getcomponent(object.get(), i, component.out()), object);
      check(lib3mf().component_getobjectresource(component.get(), child.out()), component);
      BOOL has_transform = 0;
      check(lib3mf().component_hastransform(component.get(), &has_transform), component);
      Transform inner;
      if (has_transform) {
        NMR::MODELTRANSFORM own;
        check(lib3mf().component_gettransform(component.get(), &own), component);
        inner = from_lib(own);
      }
      add_object(child, combine(inner, transform));
    }
  }

  void add_mesh(const Handle& object, const Transform& transform) {
    DWORD vertex_count = 0, triangle_count = 0;
    check(lib3mf().meshobject_getvertexcount(object.get(), &vertex_count), object);
    check(lib3mf().meshobject_gettrianglecount(object.get(), &triangle_count), object);
    if (mesh_.triangles.size() + triangle_count > kMostTriangles) {
      throw InputError(path_, "", "more than " + std::to_string(kMostTriangles) + " triangles");
    }
    if (triangle_count == 0) return;
    std::vector<NMR::MODELMESHVERTEX> vertices(vertex_count);
    std::vector<NMR::MODELMESHTRIANGLE> triangles(triangle_count);
    DWORD got = 0;
    check(lib3mf().meshobject_getvertices(object.get(), vertices.data(), vertex_count, &got),
          object);
    check(lib3mf().meshobject_gettriangleindices(object.get(), triangles.data(), triangle_count,
                                                 &got),
          object);
    constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
    std::vector<std::uint32_t> merged(vertex_count, unused);
    const bool mirrored = transform.determinant() < 0;  // turns the inside out
    for (DWORD t = 0; t < triangle_count; ++t) {
      std::array<std::uint32_t, 3> triangle;
      for (int k = 0; k < 3; ++k) {
        const DWORD index = triangles[t].m_nIndices[k];
        if (index >= vertex_count) {
          throw InputError(path_, "triangle " + std::to_string(t + 1),
                           "vertex index " + std::to_string(index) + " is out of range");
        }
        if (merged[index] == unused) {
          const FLOAT* at = vertices[index].m_fPosition;
          const Point3 point = transform.apply({at[0], at[1], at[2]});
          require_finite(point, path_, "vertex " + std::to_string(index + 1));
          merged[index] = pool_.index(point);
        }
        triangle[k] = merged[index];
      }
      if (mirrored) std::swap(triangle[1], triangle[2]);
      mesh_.triangles.push_back(triangle);
    }
  }

  const std::string& path_;
  Handle model_;
  VertexPool pool_;
  TriangleMesh mesh_;
};

}  // namespace

TriangleMesh read_3mf(FileBytes& bytes, const std::string& path, double& unit_mm) {
  check_3mf(bytes.view(), path);
  return Reader(path).read(bytes, unit_mm);
}

}  // namespace slicecorr::detail
