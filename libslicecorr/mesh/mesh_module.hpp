// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What OpenMesh and lib3mf do for us, behind a module that is loaded when a mesh needs them: thousands
/// of names are looked up for them, a tenth of the time in which programs start.
#pragma once

#include <Model/COM/NMR_DLLInterfaces.h>

#include <cstddef>
#include <span>
#include <string>

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

/// lib3mf's functions, which have these names after `lib3mf_`.
struct Lib3mf {
  decltype(&NMR::lib3mf_builditem_getobjectresource) builditem_getobjectresource;
  decltype(&NMR::lib3mf_builditem_getobjecttransform) builditem_getobjecttransform;
  decltype(&NMR::lib3mf_builditem_hasobjecttransform) builditem_hasobjecttransform;
  decltype(&NMR::lib3mf_builditemiterator_getcurrent) builditemiterator_getcurrent;
  decltype(&NMR::lib3mf_builditemiterator_movenext) builditemiterator_movenext;
  decltype(&NMR::lib3mf_component_getobjectresource) component_getobjectresource;
  decltype(&NMR::lib3mf_component_gettransform) component_gettransform;
  decltype(&NMR::lib3mf_component_hastransform) component_hastransform;
  decltype(&NMR::lib3mf_componentsobject_getcomponent) componentsobject_getcomponent;
  decltype(&NMR::lib3mf_componentsobject_getcomponentcount) componentsobject_getcomponentcount;
  decltype(&NMR::lib3mf_createmodel) createmodel;
  decltype(&NMR::lib3mf_getlasterror) getlasterror;
  decltype(&NMR::lib3mf_meshobject_gettrianglecount) meshobject_gettrianglecount;
  decltype(&NMR::lib3mf_meshobject_gettriangleindices) meshobject_gettriangleindices;
  decltype(&NMR::lib3mf_meshobject_getvertexcount) meshobject_getvertexcount;
  decltype(&NMR::lib3mf_meshobject_getvertices) meshobject_getvertices;
  decltype(&NMR::lib3mf_model_getbuilditems) model_getbuilditems;
  decltype(&NMR::lib3mf_model_getunit) model_getunit;
  decltype(&NMR::lib3mf_model_queryreader) model_queryreader;
  decltype(&NMR::lib3mf_object_iscomponentsobject) object_iscomponentsobject;
  decltype(&NMR::lib3mf_object_ismeshobject) object_ismeshobject;
  decltype(&NMR::lib3mf_reader_getwarningcount) reader_getwarningcount;
  decltype(&NMR::lib3mf_reader_getwarningutf8) reader_getwarningutf8;
  decltype(&NMR::lib3mf_reader_readfrombuffer) reader_readfrombuffer;
  decltype(&NMR::lib3mf_release) release;
};

struct MeshFunctions {
  /// Lets OpenMesh parse the text; false where something is not a number, or too large for one.
  /// Thread-safe. What the sink throws passes through.
  bool (*parse)(std::string text, const std::string& extension, bool binary, MeshSink& sink);
  Lib3mf lib3mf;
};

/// Loads the module at the first call. Thread-safe. Throws `DeviceError` when it is not there.
const MeshFunctions& mesh_functions();

/// Name of the function by which the module gives its functions.
inline constexpr const char* kMeshModuleEntry = "slicecorr_mesh_functions";

}  // namespace slicecorr::detail
