// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Supports through the C interface: given by themselves, or as what lies outside of a part in an archive.
#include <gmock/gmock.h>

#include <algorithm>

#include "c_abi.hpp"
#include "slicecorr/left_alone.hpp"

namespace slicecorr::test {
namespace {

class CAbiSupports : public CAbiLadder {
 protected:
  /// A target corrected, made and verified with a setup's supports is what the pipeline makes of it.
  void expect_as_in_cpp(const slicecorr_stack* target, const slicecorr_setup* setup,
                        const Correction& expected) const {
    FiguresHandle after, before, verified;
    const std::string path = folder_ / "made.uvj";
    ASSERT_EQ(slicecorr_correct(target, setup, path.c_str(), nullptr, out(after), out(before)),
              SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(read_file(path), read_file(folder_ / "expected.uvj"));
    EXPECT_EQ(json_of(after), expected.after.to_json());
    EXPECT_EQ(json_of(before), expected.before->to_json());
    const StackHandle made = open_stack(path);
    ASSERT_EQ(slicecorr_verify(made.get(), target, setup, nullptr, out(verified)), SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(json_of(verified), expected.after.to_json());
  }
};

TEST_F(CAbiSupports, SupportsAreLeftAlone) {
  const StackReader target(target_path_, folder_.path());
  // A pillar through the ladder's middle.
  Images pillar;
  pillar.grid = target.grid();
  const auto area = static_cast<std::size_t>(pillar.grid.width_px * pillar.grid.height_px);
  for (int n = 0; n < pillar.grid.layers; ++n) {
    Bytes& slice = pillar.slices.emplace_back(area, std::uint8_t{0});
    if (n < 25) slice[area / 2 + static_cast<std::size_t>(pillar.grid.width_px) / 2] = 200;
  }
  const std::string path = folder_ / "pillar.uvj";
  write_stack(path, pillar, info_of(pillar.grid));
  const slicecorr::Setup setup = ladder_setup(printer_);
  const LeftAloneFiles wanted(target, {path}, {}, setup.printer, folder_.path());
  const Correction expected =
      correct_stack(*wanted, setup, folder_ / "expected.uvj", {.before = true});
  EXPECT_EQ(expected.after.left_alone_voxels, 25U);

  Settings settings = ladder_settings(printer_);
  settings.emplace_back("leave_alone", path);
  const SetupHandle s = c_setup(settings);
  const StackHandle t = open_stack(target_path_);
  expect_as_in_cpp(t.get(), s.get(), expected);
  StackHandle corrected;
  FiguresHandle after, predicted;
  ASSERT_EQ(slicecorr_correct_in_memory(t.get(), s.get(), nullptr, out(corrected), out(after)),
            SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(json_of(after), expected.after.to_json());
  double volume = 0;
  EXPECT_EQ(slicecorr_stack_number(corrected.get(), "part_volume_mm3", &volume), SLICECORR_OK);
  EXPECT_EQ(volume, expected.info.part_volume_mm3);
  ASSERT_EQ(slicecorr_predict(t.get(), s.get(), nullptr, out(predicted)), SLICECORR_OK);
  EXPECT_EQ(not_in_time(json_of(predicted)), not_in_time(expected.before->to_json()));
  // Also for who asks before the work.
  EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_OK) << slicecorr_error_text();
  ASSERT_EQ(slicecorr_setup_set_text(s.get(), "uncertain", "ha=5%"), SLICECORR_OK);
  ASSERT_EQ(slicecorr_setup_set_text(s.get(), "robust", "on"), SLICECORR_OK);
  EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_OK) << slicecorr_error_text();
  // What isn't there, and numbers out of range.
  const SetupHandle none = c_setup(ladder_settings(printer_));
  ASSERT_EQ(slicecorr_setup_set_text(none.get(), "leave_alone", "/nowhere.uvj"), SLICECORR_OK);
  EXPECT_EQ(slicecorr_correct_in_memory(t.get(), none.get(), nullptr, out(corrected), nullptr),
            SLICECORR_BAD_INPUT);
  for (const double bad : {-0.1, 1.1}) {
    EXPECT_EQ(slicecorr_setup_set_number(none.get(), "platform_reflectance", bad),
              SLICECORR_BAD_INPUT);
  }
  EXPECT_EQ(slicecorr_setup_set_number(none.get(), "platform_reflectance", 0), SLICECORR_OK);
}

/// The ladder and a block on a raft, with a pillar between.
TEST_F(CAbiSupports, PartsInside) {
  const auto file = [&](const std::string& name, const TriangleMesh& mesh) {
    write_stl(folder_ / name, mesh);
    return folder_ / name;
  };
  const auto slice = [&](const TriangleMesh& mesh, const std::string& name) {
    write_target(MeshSlices(mesh, parse_printer(printer_, "printer"), SliceOptions{}),
                 folder_ / name);
    return folder_ / name;
  };
  TriangleMesh raised = ladder();
  for (Point3& v : raised.vertices) v[2] += 0.4;
  const std::string part = file("ladder.stl", raised);
  TriangleMesh cube;
  add_box(cube, {1.2, 1.2, 0.15}, {1.6, 1.5, 0.95});
  const std::string block = file("block.stl", cube);
  TriangleMesh all = raised;
  add_box(all, {1.2, 1.2, 0.15}, {1.6, 1.5, 0.95});
  add_box(all, {-2.2, -1.4, 0}, {2.2, 1.5, 0.15});
  add_box(all, {-1.6, -0.2, 0.1}, {-1.4, 0.2, 0.45});
  const std::string archive = slice(all, "all.uvj");
  const StackReader target(archive, folder_.path());
  const slicecorr::Setup setup = ladder_setup(printer_);
  const StackHandle t = open_stack(archive);
  std::uint64_t left_before = 0;
  for (const std::vector<std::string>& files :
       {std::vector<std::string>{part}, std::vector<std::string>{part, block}}) {
    SCOPED_TRACE(files.size());
    const LeftAloneFiles wanted(target, {}, {}, setup.printer, folder_.path(), {}, {files, {}});
    const Correction expected =
        correct_stack(*wanted, setup, folder_ / "expected.uvj", {.before = true});
    ASSERT_GT(expected.after.left_alone_voxels, 3U * 88 * 50);
    Settings settings = ladder_settings(printer_);
    std::string lines;
    for (const std::string& path : files) lines += path + "\n";
    settings.emplace_back("part_inside", lines);
    const SetupHandle s = c_setup(settings);
    EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_OK) << slicecorr_error_text();
    expect_as_in_cpp(t.get(), s.get(), expected);
    // The second part is no support any more.
    const std::uint64_t left = expected.after.left_alone_voxels;
    if (files.size() == 2) {
      EXPECT_LT(left + std::uint64_t{4 * 4 * 10}, left_before);
    }
    left_before = left;
  }
  // The same part in centimetres, lying on its side: turned and scaled it is the same, in a unit or by its
  // longest side; as it stands it is not there.
  TriangleMesh aside = raised;
  for (Point3& v : aside.vertices) v = {v[0] / 10, v[2] / 10, -v[1] / 10};
  const std::string lying = file("lying.stl", aside);
  Placement placed;
  placed.scale = 10;
  placed.rotate_deg = {90, 0, 0};
  const LeftAloneFiles turned(target, {}, {}, setup.printer, folder_.path(), {}, {{lying}, placed});
  const Correction of_turned =
      correct_stack(*turned, setup, folder_ / "expected.uvj", {.before = true});
  ASSERT_GT(of_turned.after.left_alone_voxels, 3U * 88 * 50);
  const double about_xyz[] = {90, 0, 0};
  double longest = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto [low, high] =
        std::minmax_element(raised.vertices.begin(), raised.vertices.end(),
                            [k](const Point3& a, const Point3& b) { return a[k] < b[k]; });
    longest = std::max(longest, (*high)[k] - (*low)[k]);
  }
  for (const auto& [name, value] : {std::pair("scale", 10.0), std::pair("fit_mm", longest)}) {
    SCOPED_TRACE(name);
    Settings settings = ladder_settings(printer_);
    settings.emplace_back("part_inside", lying);
    const SetupHandle s = c_setup(settings);
    ASSERT_EQ(slicecorr_setup_set_number(s.get(), name, value), SLICECORR_OK);
    EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_BAD_INPUT)
        << "lies on its side";
    ASSERT_EQ(slicecorr_setup_set_numbers(s.get(), "rotate_deg", about_xyz, 3), SLICECORR_OK);
    expect_as_in_cpp(t.get(), s.get(), of_turned);
    ASSERT_EQ(slicecorr_setup_set_text(s.get(), "units", "inch"), SLICECORR_OK);
    if (std::string(name) == "scale") {
      EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_BAD_INPUT);
    }
    const auto refused = [&](const char* words) {
      EXPECT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_BAD_INPUT);
      EXPECT_THAT(slicecorr_error_text(), ::testing::HasSubstr(words));
    };
    ASSERT_EQ(slicecorr_setup_set_numbers(s.get(), "rotate_deg", about_xyz, 2), SLICECORR_OK);
    refused("rotate_deg has 2 numbers; expected three");
    ASSERT_EQ(slicecorr_setup_set_number(s.get(), "scale", 10), SLICECORR_OK);
    ASSERT_EQ(slicecorr_setup_set_number(s.get(), "fit_mm", 10), SLICECORR_OK);
    refused("exclude each other");
    ASSERT_EQ(slicecorr_setup_set_text(s.get(), "part_inside", ""), SLICECORR_OK);
    refused("expected part_inside");
  }
  // A mesh that the archive does not hold, or that is not there.
  TriangleMesh other;
  add_box(other, {0, 0, 0}, {3, 0.5, 0.5});
  add_box(other, {0, 0, 0}, {0.5, 2, 1});
  for (const auto& [path, words] :
       {std::pair(file("other.stl", other), "is not in the archive: at best"),
        std::pair(std::string("/nowhere.stl"), "/nowhere.stl")}) {
    SCOPED_TRACE(path);
    const SetupHandle none = c_setup(ladder_settings(printer_));
    ASSERT_EQ(slicecorr_setup_set_text(none.get(), "part_inside", path.c_str()), SLICECORR_OK);
    EXPECT_EQ(slicecorr_check(t.get(), none.get(), nullptr), SLICECORR_BAD_INPUT);
    EXPECT_THAT(slicecorr_error_text(), ::testing::HasSubstr(words));
    StackHandle corrected;
    EXPECT_EQ(slicecorr_correct_in_memory(t.get(), none.get(), nullptr, out(corrected), nullptr),
              SLICECORR_BAD_INPUT);
    EXPECT_THAT(slicecorr_error_text(), ::testing::HasSubstr(words));
  }
}

}  // namespace
}  // namespace slicecorr::test
