// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Recordings of prints with an even dead zone: what was shown as planned prints what the stack prints, and UV images
// that go by place are kept, and compared with those that belong to the slices.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <vector>

#include "recorded_slices.hpp"
#include "refusal.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/recording_writer.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"
#include "uv_models.hpp"

// A namespace of its own: tests that are compiled together have names like these, too.
namespace slicecorr::even_recording {
namespace {

using test::MemorySlices;
using test::RecordedSlices;
using test::refusal;
using test::TemporaryFolder;
using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;
using Showing = Recording::Showing;

constexpr int kSlices = 24;
constexpr Grid kGrid{12, 10, kSlices, 100, 100, 50};
constexpr double kLampMwCm2 = 275;

std::shared_ptr<const Bytes> shared(Bytes bytes) {
  return std::make_shared<const Bytes>(std::move(bytes));
}

slicecorr::Setup even_setup(bool by_place) {
  slicecorr::Setup s;
  s.printer = test::uv::uv_printer(0, 400);
  s.printer.width_px = kGrid.width_px;
  s.printer.height_px = kGrid.height_px;
  s.printer.pixel_x_um = s.printer.pixel_y_um = 100;
  s.printer.uv->patterned = by_place;
  s.resin = test::uv::resin_1(1.0);
  s.resin.viscosity_pa_s = 0.3;
  s.process = test::process(300);
  s.process.even_dead_zone = by_place ? EvenDeadZone::both : EvenDeadZone::blue;
  s.process.uv.kind = by_place ? UvKind::patterned : UvKind::per_slice;
  for (int n = 0; n < kSlices; ++n) s.process.uv.slice_mw_cm2.push_back(n < 10 ? 230 : 250);
  EvenLight light;
  light.columns = 2;
  light.rows = 1;
  light.pitch_um = 600;
  light.gap_um = 80;
  light.slices = {0, kSlices - 1};
  light.blue = shared({90, 140, 95, 120});
  if (by_place) light.uv = shared({200, 230, 210, 245});
  s.process.even_light = light;
  return s;
}

MemorySlices random_images(unsigned seed) {
  std::mt19937 random(seed);
  MemorySlices images(kGrid);
  for (int y = 0; y < kGrid.height_px; ++y) {
    for (int x = 0; x < kGrid.width_px; ++x) {
      std::uint8_t value = 0;
      for (int n = 0; n < kSlices; ++n) {
        if (random() % 4 == 0)
          value = static_cast<std::uint8_t>(random() % 2 * (80 + random() % 70));
        images.at(n, x, y) = value;
      }
    }
  }
  return images;
}

/// One image per slice with the light of the plan.
Recording as_planned(const slicecorr::Setup& setup) {
  Recording r;
  for (int n = 0; n < kSlices; ++n) {
    const bool by_place = setup.process.uv.kind == UvKind::patterned;
    const Showing showing{
        n,
        1.0,
        by_place ? kLampMwCm2 : setup.process.uv.slice_mw_cm2[static_cast<std::size_t>(n)],
        0.0,
        0.0,
        0.0,
        1.0};
    r.add_slice({&showing, 1});
  }
  return r;
}

void expect_same_doses(const SliceSource& recorded, const SliceSource& stack,
                       const slicecorr::Setup& setup) {
  for (const auto& [x, y] : {std::pair{1, 4}, {10, 8}, {5, 0}}) {
    const auto rows = probe_stack(recorded, nullptr, setup, x, y);
    const auto as_stack = probe_stack(stack, nullptr, setup, x, y);
    ASSERT_EQ(rows.size(), as_stack.size());
    for (std::size_t n = 0; n < rows.size(); ++n) {
      EXPECT_EQ(rows[n].dose, as_stack[n].dose) << n;
      EXPECT_EQ(rows[n].dose_middle, as_stack[n].dose_middle) << n;
    }
  }
}

TEST(EvenRecording, AsPlannedItPrintsWhatTheStackPrints) {
  for (const bool by_place : {false, true}) {
    const slicecorr::Setup setup = even_setup(by_place);
    const MemorySlices stack = random_images(1);
    expect_same_doses(RecordedSlices(stack, as_planned(setup)), stack, setup);
    // Half of the light under half of the UV light gives half of the dose, whatever the law between them.
    Recording dim;
    for (int n = 0; n < kSlices; ++n) {
      Showing showing = as_planned(setup).of(n)[0];
      showing.light = showing.blue_share = 0.5;
      showing.uv_mw_cm2 *= 0.5;
      dim.add_slice({&showing, 1});
    }
    const auto half = probe_stack(RecordedSlices(stack, dim), nullptr, setup, 5, 5);
    const auto whole = probe_stack(stack, nullptr, setup, 5, 5);
    for (std::size_t n = 0; n < half.size(); ++n) {
      EXPECT_NEAR(half[n].dose, 0.5 * whole[n].dose, 1e-12 * (1 + whole[n].dose)) << n;
    }
  }
}

/// A print of images under UV images by place, as a machine shows them.
struct Shown {
  slicecorr::Setup setup = even_setup(true);
  MemorySlices images = random_images(2);
  StackInfo info;
  std::vector<Bytes> blue, uv;

  Shown() {
    info.kind = StackKind::corrected;
    info.grid = kGrid;
    info.printer = setup.printer;
    info.resin = setup.resin;
    info.process = setup.process;
    const EvenUvImages uv_images(setup, kGrid, image_frame(info));
    for (int n = 0; n < kSlices; ++n) {
      Bytes rows;
      for (int y = 0; y < kGrid.height_px; ++y) {
        for (int x = 0; x < kGrid.width_px; ++x) rows.push_back(images.at(n, x, y));
      }
      blue.push_back(rows);
      for (int y = 0; y < kGrid.height_px; ++y) {
        const auto width = static_cast<std::size_t>(kGrid.width_px);
        uv_images.make_row(n, y,
                           std::span(rows).subspan(static_cast<std::size_t>(y) * width, width));
      }
      uv.push_back(rows);
    }
  }
  void write(const std::string& path, const Recording& recording) const {
    RecordingWriter writer(path, info);
    for (std::size_t n = 0; n < blue.size(); ++n) writer.add_image(blue[n].data(), uv[n].data());
    writer.finish(recording);
  }
};

TEST(EvenRecording, UvImagesByPlaceAreKeptAndCompared) {
  const TemporaryFolder folder;
  Shown shown;
  // The last fifth of each slice still shows nothing new: the next image comes as late.
  Recording late;
  for (int n = 0; n < kSlices; ++n) {
    std::vector<Showing> showings;
    if (n > 0) showings.push_back({n - 1, 0.2, kLampMwCm2, 0, 0, 0, 1});
    showings.push_back({n, 0.8, kLampMwCm2, 0, 0, 0, 1});
    late.add_slice(showings);
  }
  for (const Recording& recording : {as_planned(shown.setup), late}) {
    shown.write(folder / "a.uvj", recording);
    const StackReader read(folder / "a.uvj", folder.path());
    EXPECT_EQ(read.recording()->other_uv_images, std::vector<int>{});
    Bytes image(shown.uv[0].size());
    for (int n = 0; n < kSlices; ++n) {
      read.read_uv_slice(n, image.data());
      EXPECT_EQ(image, shown.uv[static_cast<std::size_t>(n)]) << n;
    }
    if (recording == late) continue;
    expect_same_doses(read, shown.images, shown.setup);
  }
  // One pixel of one image is other light, and is told; so is an image that was not there.
  shown.uv[7][33] ^= 8;
  shown.write(folder / "b.uvj", as_planned(shown.setup));
  const StackReader other(folder / "b.uvj", folder.path());
  EXPECT_EQ(other.recording()->other_uv_images, std::vector{7});
  EXPECT_THAT(refusal([&] { probe_stack(other, nullptr, shown.setup, 3, 3); }),
              HasSubstr("first that of image 7"));
}

}  // namespace
}  // namespace slicecorr::even_recording
