// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Every format and back: images, sizes and times stay, and what a format can't say is told.
#include <gtest/gtest.h>

#include <algorithm>

#include "real_files.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/turned.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {

/// Else GoogleTest prints its bytes.
void PrintTo(const FormatInfo& format, std::ostream* out) { *out << format.name; }

namespace {

using test::Bytes;
using test::Images;
using test::TemporaryFolder;

std::string file_of(const FormatInfo& format) {
  return format.endings.empty() ? "made_" + format.name : "made" + format.endings.front();
}

class EveryFormat : public testing::TestWithParam<FormatInfo> {};
/// Those that are made from nothing and hold all grey values; the others are in print_files_test.
std::vector<FormatInfo> whole_formats() {
  std::vector<FormatInfo> formats = archive_formats();
  std::erase_if(formats, [](const FormatInfo& f) {
    const FormatLimits limits = limits_of_format(f.name);
    return !limits.made_new || limits.levels < 256;
  });
  return formats;
}
INSTANTIATE_TEST_SUITE_P(Convert, EveryFormat, testing::ValuesIn(whole_formats()),
                         [](const testing::TestParamInfo<FormatInfo>& info) {
                           std::string name = info.param.name;
                           std::replace_if(
                               name.begin(), name.end(), [](char c) { return !std::isalnum(c); },
                               '_');
                           return name;
                         });

StackInfo info_with_times(const Grid& grid) {
  StackInfo info = test::info_of(grid);
  info.kind = StackKind::foreign;
  info.exposure_s = 2.5;
  info.bottom_exposure_s = 30;
  info.bottom_layers = 1;
  return info;
}

void put(const TemporaryFolder& folder, const std::string& from, const StackFile& to,
         std::string* told = nullptr) {
  ExecutionContext context;
  context.notice = [&](const std::string& text) {
    if (told) *told += text + "\n";
  };
  convert_stack(StackReader(from, folder.path(), {}, {50, 50, 50}), to, context);
}

TEST_P(EveryFormat, ThereAndBackIsTheSame) {
  const TemporaryFolder folder;
  for (const int width : {63, 64, 65}) {
    Images images = test::random_images(width, 41, 7, static_cast<unsigned>(width));
    images.grid.pixel_x_um = images.grid.pixel_y_um = 50;
    images.grid.layer_um = 50;
    std::filesystem::create_directory(folder / std::to_string(width));
    const std::string base = folder / (std::to_string(width) + "/");
    test::write_stack(base + "in.uvj", images, info_with_times(images.grid));
    StackFile file(base + file_of(GetParam()));
    file.format = GetParam().name;
    std::string told;
    put(folder, base + "in.uvj", file, &told);
    const StackReader made(file.path, folder.path(), {}, {50, 50, 50});
    EXPECT_EQ(made.info().format, GetParam().name);
    EXPECT_EQ(test::read_images(made), images.slices);
    EXPECT_EQ(made.info().kind, StackKind::foreign);
    const bool says_times = made.info().exposure_s > 0;
    // Only images alone can't say how long they are shown; then that is told.
    if (!says_times) {
      EXPECT_NE(told.find("expos"), std::string::npos) << told;
    }
    StackFile back(base + "back.uvj");
    put(folder, file.path, back);
    const StackReader again(back.path, folder.path());
    EXPECT_EQ(test::read_images(again), images.slices);
    EXPECT_EQ(again.grid().layer_um, 50);
    EXPECT_NEAR(again.grid().pixel_x_um, 50, 0.05);
    EXPECT_NEAR(again.grid().pixel_y_um, 50, 0.05);
    for (int n = 0; says_times && n < 7; ++n) {
      EXPECT_NEAR(layer_exposure_s(process_of_times(again.info()), n), n == 0 ? 30 : 2.5, 0.005)
          << n;
    }
  }
}

TEST_P(EveryFormat, TheSameInputGivesTheSameBytes) {
  const TemporaryFolder folder;
  const Images images = test::random_images(40, 30, 5, 3);
  test::write_stack(folder / "in.uvj", images, info_with_times(images.grid));
  Bytes first;
  for (const char* sub : {"one", "two"}) {
    std::filesystem::create_directory(folder / sub);
    StackFile file(folder / (std::string(sub) + "/" + file_of(GetParam())));
    file.format = GetParam().name;
    put(folder, folder / "in.uvj", file);
    Bytes bytes;
    if (std::filesystem::is_directory(file.path)) {
      std::map<std::string, Bytes> files;
      for (const auto& entry : std::filesystem::directory_iterator(file.path)) {
        files[entry.path().filename().string()] = test::read_file(entry.path().string());
      }
      for (const auto& [name, data] : files) {
        bytes.insert(bytes.end(), name.begin(), name.end());
        bytes.insert(bytes.end(), data.begin(), data.end());
      }
    } else {
      bytes = test::read_file(file.path);
    }
    EXPECT_FALSE(bytes.empty());
    if (first.empty()) first = bytes;
    EXPECT_EQ(bytes, first);
  }
}

TEST_P(EveryFormat, CorrectedStacksKeepAllTheirParameters) {
  const TemporaryFolder folder;
  Images images = test::random_images(40, 30, 6, 9);
  images.grid.pixel_x_um = images.grid.pixel_y_um = 50;
  images.grid.layer_um = 50;
  test::write_stack(folder / "target.uvj", images, info_with_times(images.grid));
  const StackReader target(folder / "target.uvj", folder.path());
  slicecorr::Setup setup;
  setup.printer.name = "small";
  setup.printer.width_px = 40;
  setup.printer.height_px = 30;
  setup.printer.pixel_x_um = setup.printer.pixel_y_um = 50;
  setup.printer.calibration = {{0, 0}, {255, 20}};
  setup.resin.name = "resin";
  setup.resin.absorbance_height10_um = 400;
  setup.resin.critical_dose_mj_cm3 = 100;
  setup.process = process_of_times(target.info());
  StackFile file(folder / file_of(GetParam()));
  file.format = GetParam().name;
  const Correction made = correct_stack(target, setup, file, {});
  const StackReader stack(file.path, folder.path());
  EXPECT_EQ(stack.info().kind, StackKind::corrected);
  EXPECT_EQ(stack.info().printer, setup.printer);
  EXPECT_EQ(stack.info().resin, setup.resin);
  EXPECT_EQ(stack.info().process, setup.process);
  EXPECT_EQ(verify_stack(stack, target, setup).to_json(), made.after.to_json());
  // Changed by somebody else, it is noticed.
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const StackReader quiet(file.path, folder.path(), context);
  EXPECT_EQ(told, "");
}

TEST_P(EveryFormat, ImagesArePutInPlaceAndNothingElseChanges) {
  const TemporaryFolder folder;
  Images images = test::random_images(40, 30, 6, 9);
  const Images other = test::random_images(40, 30, 6, 10);
  images.grid.layer_um = 33;  // some formats hold whole micrometres
  StackFile file(folder / file_of(GetParam()));
  file.format = GetParam().name;
  test::write_stack(folder / "a.uvj", images, info_with_times(images.grid));
  test::write_stack(folder / "b.uvj", other, info_with_times(images.grid));
  put(folder, folder / "a.uvj", file);
  const auto others = [&](const std::string& path) {
    return StackReader(path, folder.path(), {}, {50, 50, 50}).other_entries();
  };
  const std::vector<std::string> before = others(file.path);
  StackFile in_place = file;
  in_place.keep_from = file.path;
  put(folder, folder / "b.uvj", in_place);
  EXPECT_EQ(test::read_images(StackReader(file.path, folder.path(), {}, {50, 50, 50})),
            other.slices);
  EXPECT_EQ(others(file.path), before);
  EXPECT_EQ(folder.count(), 3) << "something is left beside";
}

TEST(Formats, ImagesOfThePlateAreTurnedToTheDisplay) {
  const TemporaryFolder folder;
  const Images plate = test::random_images(40, 30, 3, 21);
  test::write_stack(folder / "plate.uvj", plate, test::info_of(plate.grid));
  const StackReader stack(folder / "plate.uvj", folder.path());
  // As an SL1's: x of the plate runs up, y to the right.
  Printer printer;
  printer.width_px = 30;
  printer.height_px = 40;
  printer.orientation = Orientation{true, true, false};
  const FittedSlices turned = FittedSlices::for_display(stack, printer, folder.path());
  convert_stack(stack, folder / "display.sl1", {}, &*turned);
  const StackReader display(folder / "display.sl1", folder.path());
  EXPECT_EQ(display.info().orientation, *printer.orientation);
  ASSERT_EQ(display.grid().width_px, 30);
  ASSERT_EQ(display.grid().height_px, 40);
  EXPECT_EQ(display.grid().pixel_x_um, plate.grid.pixel_y_um);
  const std::vector<Bytes> images = test::read_images(display);
  for (std::size_t n = 0; n < 3; ++n) {
    for (std::size_t row = 0; row < 40; ++row) {
      for (std::size_t column = 0; column < 30; ++column) {
        const std::size_t x = 39 - row, plate_row = 29 - column;
        ASSERT_EQ(images[n][row * 30 + column], plate.slices[n][plate_row * 40 + x])
            << n << " " << row << " " << column;
      }
    }
  }
}

TEST(Formats, AreNamedByTheirEndings) {
  const auto named = [](const std::string& path) { return format_of(StackFile(path)); };
  EXPECT_EQ(named("a/b.uvj"), "uvj");
  EXPECT_EQ(named("a.SL1S"), "sl1");
  EXPECT_EQ(named("x.rgb.cws"), "rgb-cws");
  EXPECT_EQ(named("x.cws"), "cws");
  EXPECT_EQ(named("images/"), "folder");
  for (const char* path : {"x", "x.png", ".uvj", "x.uvj.bak", ""}) {
    EXPECT_THROW(named(path), InputError) << path;
  }
  try {
    named("part.zip");
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("chitubox"), std::string::npos) << error.what();
  }
}

TEST(Formats, EveryArchiveOfOthersIsReadOrRefusedWithAReason) {
  const std::map<std::string, std::string> refused = {{"corrupt.zip", "zip"},
                                                      {"print_naming_gap.zip", "slice_3.png"},
                                                      {"print_no_slices.zip", "slice_1.png"},
                                                      {"190219_mzi_serpentine_v2.zip", "Nordin"},
                                                      {"schema_v5_example.zip", "Nordin"},
                                                      {"schema_v5.json", "zip"},
                                                      {"test_corrupted.sl1", ""},
                                                      {"test_nolayer.sl1", "no layer images"}};
  const TemporaryFolder scratch;
  int read = 0;
  for (const std::filesystem::path path : test::real_files("slices")) {
    const std::string name = path.filename().string();
    // RealArchives reads it, and what is told of it.
    if (name == "diagrid_creation_workshop.zip") continue;
    std::string told, error;
    ExecutionContext context;
    context.notice = [&](const std::string& text) { told += text; };
    // Their images are read in print_files_test; some of them are packed once more.
    const bool binary = path.parent_path().filename() == "binary";
    try {
      if (binary) {
        StackReader::read_info(path.string());
      } else {
        const StackReader reader(path.string(), scratch.path(), context, {50, 50, 50});
        EXPECT_GT(reader.pixel_sum(), 0u) << name;
        ++read;
      }
    } catch (const InputError& e) {
      error = e.what();
      EXPECT_EQ(error.rfind(path.string(), 0), 0u) << error;
    }
    if (binary) continue;
    const auto expected = refused.find(name);
    EXPECT_EQ(error.empty(), expected == refused.end()) << name << ": " << error;
    if (expected != refused.end()) {
      EXPECT_NE(error.find(expected->second), std::string::npos) << error;
    }
    EXPECT_EQ(!told.empty(), name == "Resin_calibration_linear_object.sl1") << name << ": " << told;
  }
  // One of them lies in tests/data.
  EXPECT_EQ(read, std::filesystem::exists(SLICECORR_TEST_DATA) ? 8 : 1);
}

}  // namespace
}  // namespace slicecorr
