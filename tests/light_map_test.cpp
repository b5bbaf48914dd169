// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light by place of a display that does not shine evenly, and the models of places.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>

#include "flat_fields.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::test {
namespace {

using namespace flat;
using testing::HasSubstr;

// ---- light by place -------------------------------------------------------------------------

TEST(LightMap, WithoutOneAllIsEven) {
  const LightMap map(linear_printer(1, 100), kGrid, {});
  EXPECT_TRUE(map.even());
  EXPECT_EQ(map.factor(map.value(3, 4)), 1);
  // All pixels of a box count with the reference, and nothing else does; of an empty one none.
  std::array<std::uint64_t, 256> expected{};
  EXPECT_EQ(map.counts({3, 4, 3, 9}), expected);
  expected[map.reference()] = 13 * 5;
  EXPECT_EQ(map.counts({3, 4, 16, 9}), expected);
}

TEST(LightMap, AsManyValuesAsPixelsAreTakenAsTheyAre) {
  Printer p = linear_printer(1, 100);
  Values values(256);
  for (std::size_t i = 0; i < 256; ++i) values[i] = static_cast<std::uint8_t>(i);
  p.flat_field = field_of(16, 16, values, 200);
  const LightMap map(p, kGrid, {});
  EXPECT_FALSE(map.even());
  Values read(256);
  map.values({0, 0, 16, 16}, read.data());
  EXPECT_EQ(read, values);
  EXPECT_EQ(map.factor(50), 0.25);
  EXPECT_EQ(map.greatest(), 255);
  const auto counts = map.counts({0, 0, 16, 2});
  EXPECT_EQ(counts[31], 1U);
  EXPECT_EQ(counts[32], 0U);
}

// Middles of pixels against middles of samples, linear between them and flat outside.
TEST(LightMap, FewValuesAreInterpolated) {
  Printer p = linear_printer(1, 100);
  p.width_px = 4;
  p.height_px = 2;
  const Grid grid{4, 2, 1, 50, 50, 50};
  p.flat_field = field_of(2, 1, {0, 200});
  const LightMap map(p, grid, {});
  for (int y = 0; y < 2; ++y) {
    EXPECT_EQ(map.value(0, y), 0);
    EXPECT_EQ(map.value(1, y), 50);
    EXPECT_EQ(map.value(2, y), 150);
    EXPECT_EQ(map.value(3, y), 200);
  }
  // A plane stays one: 10 (x + 2 y) at the middles of samples.
  p.width_px = 60;
  p.height_px = 40;
  Values plane;
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 6; ++x) plane.push_back(static_cast<std::uint8_t>(10 * (x + 2 * y)));
  }
  p.flat_field = field_of(6, 4, plane);
  const LightMap fine(p, {60, 40, 1, 50, 50, 50}, {});
  for (int y = 5; y < 35; ++y) {
    for (int x = 5; x < 55; ++x) {
      // 10 ((x + 0.5) / 10 - 0.5 + 2 ((y + 0.5) / 10 - 0.5)) = x + 2 y - 13.5, halves go up.
      EXPECT_EQ(fine.value(x, y), x + 2 * y - 13) << x << " " << y;
    }
  }
  // And many values for few pixels.
  p.width_px = p.height_px = 2;
  p.flat_field = field_of(4, 4, {0, 0, 9, 9, 0, 0, 9, 9, 40, 40, 80, 80, 40, 40, 80, 80});
  const LightMap coarse(p, {2, 2, 1, 50, 50, 50}, {});
  EXPECT_EQ(coarse.value(0, 0), 0);
  EXPECT_EQ(coarse.value(1, 0), 9);
  EXPECT_EQ(coarse.value(1, 1), 80);
}

TEST(LightMap, NeighbouringValuesCanBeJoined) {
  Printer p = linear_printer(1, 100);
  Values values(256);
  for (std::size_t i = 0; i < 256; ++i) values[i] = static_cast<std::uint8_t>(i);
  p.flat_field = field_of(16, 16, values);
  LightMap map(p, kGrid, {});
  map.coarsen(7);
  for (int i = 1; i < 256; ++i) {
    EXPECT_LE(std::abs(map.value(i % 16, i / 16) - i), 3) << i;
    EXPECT_EQ(map.value(i % 16, i / 16), std::min(255, i / 7 * 7 + 3));
  }
  EXPECT_EQ(map.value(0, 0), 0);
}

TEST(LightMap, EightOrientations) {
  // A display of 5 x 3 pixels, or 3 x 5.
  for (int i = 0; i < 8; ++i) {
    const Orientation o{(i & 1) != 0, (i & 2) != 0, (i & 4) != 0};
    const Turn turn = turn_from_plate(o);
    const Grid plate{5, 3, 1, 50, 40, 50};
    const Grid display = turned(plate, turn);
    Printer p = linear_printer(1, 100);
    p.orientation = o;
    p.width_px = display.width_px;
    p.height_px = display.height_px;
    p.pixel_x_um = display.pixel_x_um;
    p.pixel_y_um = display.pixel_y_um;
    EXPECT_EQ(plate_grid(p).width_px, 5);
    EXPECT_EQ(plate_grid(p).pixel_y_um, 40);
    Values values(15);
    for (std::size_t k = 0; k < 15; ++k) values[k] = static_cast<std::uint8_t>(10 + k);
    const auto in = [&](const FlatField& f, const Pixel& at) {
      return (*f.values)[static_cast<std::size_t>(at.y * f.width_px + at.x)];
    };
    const ImageFrame ours, archive{Turn{}, o}, silent{Turn{}, std::nullopt};
    // Measured as the display shows its images.
    p.flat_field = field_of(display.width_px, display.height_px, values);
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 5; ++x) {
        const Pixel shown = turned(Pixel{x, y}, turn, 5, 3);
        EXPECT_EQ(LightMap(p, plate, ours).value(x, y), in(*p.flat_field, shown));
        EXPECT_EQ(LightMap(p, display, archive).value(shown.x, shown.y), in(*p.flat_field, shown));
        EXPECT_EQ(LightMap(p, display, silent).value(shown.x, shown.y), in(*p.flat_field, shown));
      }
    }
    // Measured over the plate.
    p.flat_field = field_of(5, 3, values, 255, true);
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 5; ++x) {
        const Pixel shown = turned(Pixel{x, y}, turn, 5, 3);
        EXPECT_EQ(LightMap(p, plate, ours).value(x, y), in(*p.flat_field, {x, y}));
        EXPECT_EQ(LightMap(p, display, archive).value(shown.x, shown.y), in(*p.flat_field, {x, y}));
        EXPECT_EQ(LightMap(p, display, silent).value(shown.x, shown.y), in(*p.flat_field, {x, y}));
        // Turned slices keep the light that they get.
        const ImageFrame back = turned(archive, turn.inverse());
        EXPECT_EQ(LightMap(p, plate, back).value(x, y), in(*p.flat_field, {x, y}));
      }
    }
  }
}

TEST(LightMap, ArchiveAndPrinterThatContradictEachOther) {
  Printer p = linear_printer(1, 100);
  const ImageFrame mirrored{Turn{}, Orientation{false, true, false}};
  Values values(256, 100);
  values[0] = 255;
  p.flat_field = field_of(16, 16, values, 255, true);
  // The printer says nothing: the archive's word counts.
  EXPECT_EQ(LightMap(p, kGrid, mirrored).value(15, 0), 255);
  p.orientation = Orientation{};
  EXPECT_THAT(
      refusal([&] { LightMap(p, kGrid, mirrored); }),
      AllOf(HasSubstr("landscape by the printer"),
            HasSubstr("landscape, mirrored in x by the archive"), HasSubstr("flat_field_frame")));
  // What is measured in images fits the archive's images, whatever they show.
  p.flat_field->of_plate = false;
  EXPECT_EQ(LightMap(p, kGrid, mirrored).value(0, 0), 255);
  EXPECT_THAT(refusal([&] {
                LightMap(p, {8, 16, 1, 50, 50, 50}, {});
              }),
              HasSubstr("8 x 16 pixels"));
}

TEST(PlaceModels, ADimPlaceIsADimPrinter) {
  for (const Mode& mode : modes()) {
    const Settings setup = with(mode.setup, field_of(2, 1, {128, 255}, 255));
    const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
    const CureModel& dim = models.model(128);
    Printer dimmer = mode.setup.printer;
    for (CalibrationPoint& c : dimmer.calibration) c.intensity_mw_cm2 *= 128.0 / 255;
    Process process = mode.setup.process;
    if (process.uv.kind == UvKind::patterned) continue;  // its UV light is set for full light
    const CureModel expected = make_cure_model(dimmer, setup.resin, process, 50);
    EXPECT_EQ(dim.level_phi, expected.level_phi) << mode.name;
    EXPECT_EQ(dim.a, expected.a);
    EXPECT_EQ(models.model(255).level_phi,
              make_cure_model(mode.setup.printer, setup.resin, process, 50).level_phi);
  }
}

// A pattern can't know places: the same grey level has the same UV light everywhere, enough for the
// brightest. Elsewhere the dead zone is thicker, never thinner.
TEST(PlaceModels, UvLightIsThatOfTheBrightestPlace) {
  const Settings setup = with(modes()[5].setup, field_of(2, 1, {128, 255}, 255));
  const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
  const InhibitedKernel& dim = *models.model(128).inhibited();
  const InhibitedKernel& bright = *models.model(255).inhibited();
  EXPECT_EQ(dim.uv_levels(), bright.uv_levels());
  for (int level = 20; level < 256; ++level) {
    EXPECT_GE(bright.dead_zone_um(0, level), 15 * (1 - 1e-9));
    EXPECT_GT(dim.dead_zone_um(0, level), bright.dead_zone_um(0, level));
  }
}

// Where UV light has so many intensities that values of light would have to share tables that differ by
// more than half a per cent, edges would lie elsewhere than is told.
TEST(PlaceModels, LightThatCannotBeToldApartIsRefused) {
  // All of 101 values, then those of its ends alone, which have room.
  Values all(256);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::uint8_t>(155 + i % 101);
  Settings setup = with(modes()[5].setup, field_of(16, 16, all, 255));
  setup.process.uv = {UvKind::constant, 50, 0, {}};
  EXPECT_NO_THROW(PlaceModels(setup.printer, setup.resin, setup.process, kGrid, {}));
  setup.process.uv = {UvKind::per_slice, 0, 0, {}};
  for (int n = 0; n < 60; ++n) setup.process.uv.slice_mw_cm2.push_back(20 + 0.5 * n);
  try {
    const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
    FAIL() << "60 intensities of UV light at 101 values of light";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("display.flat_field"));
    EXPECT_THAT(e.what(), testing::HasSubstr("expected UV light of one intensity"));
  }
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i % 16 < 8 ? 155 : 255;
  setup.printer.flat_field = field_of(16, 16, all, 255);
  EXPECT_NO_THROW(PlaceModels(setup.printer, setup.resin, setup.process, kGrid, {}));
}

// ---- correction -----------------------------------------------------------------------------

}  // namespace
}  // namespace slicecorr::test
