// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/mesh_module.hpp"

#include "support/files/shared_object.hpp"

namespace slicecorr::detail {

const MeshFunctions& mesh_functions() {
  static const MeshFunctions* const functions = reinterpret_cast<const MeshFunctions* (*)()>(
      module_entry("slicecorr-meshes.so", kMeshModuleEntry, "reads meshes of this kind"))();
  return *functions;
}

}  // namespace slicecorr::detail
