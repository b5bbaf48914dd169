// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Meshes through the program: what a file says is what is sliced, or it is refused; what is left out is
/// told in a line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "program_fixture.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class MeshProgram : public ProgramFixture {
 protected:
  MeshProgram() {
    write(
        "coarse.toml",
        "name = \"coarse\"\n[display]\nwidth_px = 320\nheight_px = 240\npixel_um = 250.0\n[blue]\n"
        "calibration = [[0, 0.0], [255, 100.0]]\n");
  }
  RunResult slice(const std::string& part) const {
    return call({"slice", part, "-o", "out.uvj", "--printer", "coarse.toml", "--layer-um", "100"});
  }
  json info(const std::string& file) const {
    return json::parse(good({"info", file, "--json", "-"}).out);
  }
};

TEST_F(MeshProgram, ReportedMeshesHaveTheirVolume) {
  const struct {
    const char *name, *note;
    double volume_ml;
  } files[] = {
      {"prusa_negative_volume.3mf", "1 negative volume taken away from the part", 3.0},
      {"bambu_negative_part.3mf", "1 negative volume taken away from the part", 3.0},
      {"prusa_support_blocker.3mf", "1 support blocker left out", 4.0},
      {"item_printable_0.3mf", "1 item left out: switched off", 1.0},
      {"type_support.3mf", "1 object of the type 'support' left out", 1.0},
      {"slices_lowres_mesh.3mf", "1 object made of the slices", 0.16},
      {"valid_composite.3mf", "", 1.0},
      {"valid_object_metadatagroup.3mf", "", 1.0},
      {"ply_ascii_list_uint.ply", "", 0.072},
      {"ply_int_coords.ply", "", 0.072},
      {"ply_list_uint_int.ply", "", 0.072},
      {"ply_list_ushort_int.ply", "", 0.072},
      {"ply_mixed_newline.ply", "", 0.072},
      {"ply_zyx.ply", "", 0.072},
      {"obj_bom.obj", "", 0.072},
      {"stl_ascii_bom.stl", "", 0.072},
  };
  for (const auto& f : files) {
    const std::string path = real_file(std::string("meshes/reported/") + f.name);
    ASSERT_TRUE(std::filesystem::exists(path)) << path;
    const RunResult sliced = slice(path);
    ASSERT_EQ(sliced.exit_code, 0) << f.name << sliced.err;
    EXPECT_THAT(sliced.err, HasSubstr(f.note)) << f.name;
    EXPECT_NEAR(info("out.uvj")["resin_volume_ml"].get<double>(), f.volume_ml, 1e-6) << f.name;
    const json said = info(path);
    EXPECT_NEAR(said["volume_ml"].get<double>(), f.volume_ml, 2e-3 * f.volume_ml) << f.name;
    EXPECT_EQ(said["notes"].empty(), *f.note == '\0') << f.name;
    EXPECT_THAT(said["notes"].dump(), HasSubstr(f.note)) << f.name;
    EXPECT_THAT(good({"info", path}).out, HasSubstr(f.note)) << f.name;
  }
}

TEST_F(MeshProgram, BeamsOfARequiredExtensionAreRead) {
  const std::string path = real_file("meshes/reported/beam_lattice_required.3mf");
  const RunResult sliced = slice(path);
  ASSERT_EQ(sliced.exit_code, 0) << sliced.err;
  EXPECT_THAT(sliced.err, HasSubstr("3 beams with round faces"));
  // A cube, and beside it three struts of 10, 10 and 6 mm with balls at their ends.
  const json said = info(path);
  EXPECT_NEAR(said["upper_mm"][0].get<double>(), 19, 0.01);
  EXPECT_GT(said["volume_ml"].get<double>(), 1.08);
  EXPECT_LT(said["volume_ml"].get<double>(), 1.1);
}

TEST_F(MeshProgram, WhatCannotBeReadIsRefusedByName) {
  bad(2,
      {"slice", real_file("meshes/reported/type_other.3mf"), "-o", "out.uvj", "--printer",
       "coarse.toml", "--layer-um", "100"},
      {"type_other.3mf: 3D/3dmodel.model, line 2", "of the type 'other'"});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.uvj"));
  write(
      "broken.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 one 0\n3 0 1 2\n");
  const RunResult broken =
      bad(2, {"info", "broken.ply"}, {"broken.ply: line 12", "'y' of vertex 3", "'one'"});
  // One line, and nothing that a library wrote.
  EXPECT_EQ(std::count(broken.err.begin(), broken.err.end(), '\n'), 1) << broken.err;
  bad(2, {"info", "missing.3mf"}, {"missing.3mf: no such file"});
}

}  // namespace
}  // namespace slicecorr::test
