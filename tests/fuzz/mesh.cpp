// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a mesh of one format, for clang's fuzzer: they are read or refused with an `InputError`
// that names the file. What is read is a mesh whose triangles have their corners, at finite places.
#include "slicecorr/mesh.hpp"

#include <cmath>

#include "fuzz.hpp"
#include "stack_fixture.hpp"

using namespace slicecorr;

namespace {

/// A 3MF is a zip with checksums: the bytes are those of the model in it.
void write_3mf(const std::string& path, const std::string& model) {
  const std::string types =
      R"(<?xml version="1.0" encoding="UTF-8"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>)";
  const std::string relations =
      R"(<?xml version="1.0" encoding="UTF-8"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>)";
  test::make_zip(path, {{"[Content_Types].xml", test::to_bytes(types)},
                        {"_rels/.rels", test::to_bytes(relations)},
                        {"3D/3dmodel.model", test::to_bytes(model)}});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  const std::string path = folder / "part." SLICECORR_FUZZ_FORMAT;
  if (path.ends_with(".3mf")) {
    write_3mf(path, fuzz::text_of(data, size));
  } else {
    fuzz::write(path, fuzz::text_of(data, size));
  }
  TriangleMesh mesh;
  if (!fuzz::read_or_refuse([&] { mesh = read_mesh(path, {}, fuzz::one_thread()); }, path)) {
    return 0;
  }
  if (mesh.triangles.empty()) fuzz::fail("a mesh without triangles is read");
  for (const Point3& p : mesh.vertices) {
    for (const double x : p) {
      if (!std::isfinite(x)) fuzz::fail("a vertex is not finite");
    }
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t v : triangle) {
      if (v >= mesh.vertices.size()) fuzz::fail("a triangle has a corner that there is not");
    }
  }
  const MeshReport report = inspect(mesh, fuzz::one_thread());
  if (report.triangles != mesh.triangles.size()) fuzz::fail("the report has other triangles");
  return 0;
}
