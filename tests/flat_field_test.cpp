// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A display that does not shine evenly: corrections and predictions with it, and what stacks say of it. Truth: a place that gets f of the light is a printer whose calibration
// is f times as strong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "flat_fields.hpp"
#include "ladder.hpp"
#include "real_files.hpp"
#include "run_program.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/volume.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

using namespace flat;

TEST_F(FlatFieldTest, OneEverywhereIsNone) {
  const MemorySlices target = random_target(kGrid, 1);
  for (const Mode& mode : modes()) {
    const Settings flat = with(mode.setup, uniform(200, 200));
    const Correction none = correct_stack(target, mode.setup, path("none.uvj"), {.before = true});
    const Correction one = correct_stack(target, flat, path("one.uvj"), {.before = true});
    EXPECT_EQ(none.after.to_json(), one.after.to_json()) << mode.name;
    EXPECT_EQ(none.before->to_json(), one.before->to_json());
    const StackReader a(path("none.uvj"), folder_.string()), b(path("one.uvj"), folder_.string());
    EXPECT_EQ(MemorySlices(a), MemorySlices(b));
    EXPECT_EQ(MemorySlices(CorrectedSlices(target, mode.setup)),
              MemorySlices(CorrectedSlices(target, flat)));
  }
}

// Byte for byte, through all the machinery for uneven light: three pixels at the edge, where
// nothing is, keep it from being flat.
TEST_F(FlatFieldTest, AllEquallyDimIsADimPrinter) {
  const MemorySlices target = random_target(kGrid, 2);
  for (const Mode& mode : modes()) {
    if (mode.setup.process.uv.kind == UvKind::patterned) continue;
    Values values(256, 217);
    values[0] = values[15] = values[255] = 216;
    const Settings dim = with(mode.setup, field_of(16, 16, values, 255));
    Settings scaled = mode.setup;
    scaled.printer = dimmed(mode.setup.printer, 217.0 / 255);
    const MemorySlices by_field{CorrectedSlices(target, dim)};
    const MemorySlices by_printer{CorrectedSlices(target, scaled)};
    EXPECT_EQ(by_field.grid().layers, by_printer.grid().layers) << mode.name;
    EXPECT_EQ(by_field, by_printer) << mode.name;
    const Correction a = correct_stack(target, dim, path("a.uvj"), {.before = true});
    const Correction b = correct_stack(target, scaled, path("b.uvj"), {.before = true});
    // Figures, too; black light of 216 is less than that of 217.
    EXPECT_EQ(a.after.to_json(), b.after.to_json()) << mode.name;
    EXPECT_EQ(a.before->to_json(), b.before->to_json()) << mode.name;
    EXPECT_EQ(verify_stack(by_field, target, dim).to_json(), a.after.to_json()) << mode.name;
  }
}

TEST_F(FlatFieldTest, ACheckerboardIsTheUnionOfTwoCorrections) {
  Values board(256);
  for (std::size_t i = 0; i < 256; ++i) board[i] = (i + i / 16) % 2 ? 250 : 240;
  const MemorySlices target = random_target(kGrid, 3);
  for (const Mode& mode : modes()) {
    // Black that gives no light: slices after the last lit one change nothing.
    Settings setup = mode.setup;
    setup.printer.calibration.front().intensity_mw_cm2 = 0;
    // Under UV light columns are chosen with all slices in sight that will be shown, and the
    // brighter half alone needs fewer: see the next test.
    if (setup.process.uv.kind != UvKind::off) continue;
    const MemorySlices both{CorrectedSlices(target, with(setup, field_of(16, 16, board, 255)))};
    Settings dim = setup, bright = setup;
    dim.printer = dimmed(setup.printer, 240.0 / 255);
    bright.printer = dimmed(setup.printer, 250.0 / 255);
    const MemorySlices parts[2] = {MemorySlices(CorrectedSlices(target, dim)),
                                   MemorySlices(CorrectedSlices(target, bright))};
    // Levels at the end of a part follow from how many slices there are to choose from.
    ASSERT_EQ(both.grid().layers, parts[0].grid().layers);
    ASSERT_EQ(both.grid().layers, parts[1].grid().layers);
    for (int n = 0; n < both.grid().layers; ++n) {
      for (int y = 0; y < 16; ++y) {
        for (int x = 0; x < 16; ++x) {
          const MemorySlices& part = parts[(x + y * 17) % 2];
          const int expected = n < part.grid().layers ? part.at(n, x, y) : 0;
          ASSERT_EQ(both.at(n, x, y), expected) << mode.name << ": " << n << " " << x << " " << y;
        }
      }
    }
  }
}

// Every column is what the definition makes of it with the model of its place, and meets the
// constraints.
TEST_F(FlatFieldTest, EveryColumnHasTheModelOfItsPlace) {
  std::mt19937 random(5);
  Values values(256);
  for (std::uint8_t& v : values) v = static_cast<std::uint8_t>(200 + random() % 56);
  const MemorySlices target = random_target(kGrid, 6, false);
  for (const Mode& mode : modes()) {
    const Settings setup = with(mode.setup, field_of(16, 16, values));
    const MemorySlices corrected{CorrectedSlices(target, setup)};
    const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
    const int levels = setup.printer.levels();
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        std::vector<std::uint8_t> coverage;
        for (int n = 0; n < kGrid.layers; ++n) coverage.push_back(target.at(n, x, y));
        const CorrectionPlan plan(models.model_at(x, y), setup.process, kGrid.layers,
                                  corrected.grid().layers);
        const auto expected = solve_column(plan, coverage);
        for (int n = 0; n < corrected.grid().layers; ++n) {
          ASSERT_EQ(corrected.at(n, x, y),
                    pixel_of_level(expected[static_cast<std::size_t>(n)], levels))
              << mode.name << ": " << n << " " << x << " " << y;
        }
      }
    }
    const Prediction p = verify_stack(corrected, target, setup);
    const Prediction even = verify_stack(CorrectedSlices(target, mode.setup), target, mode.setup);
    // What the even correction reaches in these columns, this one reaches, too.
    EXPECT_EQ(p.target_voxels, even.target_voxels);
    EXPECT_LE(p.undercure_voxels, even.undercure_voxels) << mode.name;
    EXPECT_LE(p.cure_through_voxels, even.cure_through_voxels + even.target_voxels / 200)
        << mode.name;
    EXPECT_LT(p.height_error_um.mean(), 1.2 * even.height_error_um.mean() + 0.5) << mode.name;
  }
}

// The dose is proportional to the light, and above a feature it falls to 1/10 over ha: a correction
// that does not know that its place is f times as bright moves each upper edge by ha log10 f.
TEST_F(FlatFieldTest, NotKnowingItMovesEdges) {
  MemorySlices target(kGrid);
  for (int n = 20; n < 30; ++n) target.at(n, 8, 8) = 255;
  Settings even = even_setup();
  even.printer.calibration.front().intensity_mw_cm2 = 0;
  const MemorySlices unaware{CorrectedSlices(target, even)};
  const double error = verify_stack(unaware, target, even).greatest_overreach_um;
  for (const int value : {210, 230, 255}) {
    Values values(256, 200);
    values[8 * 16 + 8] = static_cast<std::uint8_t>(value);
    const Settings truth = with(even, field_of(16, 16, values, 200));
    const double shift = 2000 * std::log10(value / 200.0);
    const Prediction wrong = verify_stack(unaware, target, truth);
    // The upper edge may lie on either side, within the tolerance of edges.
    EXPECT_NEAR(wrong.greatest_overreach_um, error + shift, 0.05 * 1.44 + error);
    const Prediction right = verify_stack(CorrectedSlices(target, truth), target, truth);
    EXPECT_LT(right.greatest_overreach_um, 2.5);
    EXPECT_EQ(right.undercure_voxels, 0U);
  }
  // Dimmer: under the upper edge the dose falls to 1 as steeply as it can, by 1/10 over ha, so that
  // f times it reaches 1 that much later.
  const CureModel model = make_cure_model(even.printer, even.resin, even.process, 50);
  Values values(256, 200);
  values[8 * 16 + 8] = 180;
  const Prediction dim = verify_stack(unaware, target, with(even, field_of(16, 16, values, 200)));
  // The three slices before the edge are not all black: 4 % of the levels are kept for them.
  EXPECT_NEAR(dim.greatest_shortfall_um, 2000 * std::log10(200.0 / 180), 3 * model.level_step_um());
}

TEST_F(FlatFieldTest, SameBytesForAnyNumberOfThreads) {
  // Several bands of rows, so that there is work to share.
  const Grid grid{24, 42, 20, 50, 50, 50};
  const MemorySlices target = random_target(grid, 7);
  std::mt19937 random(8);
  Values values(4 * 7);
  for (std::uint8_t& v : values) v = static_cast<std::uint8_t>(240 + random() % 2 * 4);
  for (const Mode& mode : modes()) {
    Settings setup = with(mode.setup, field_of(4, 7, values));
    setup.printer.width_px = 24;
    setup.printer.height_px = 42;
    std::string first, figures, page;
    for (const int threads : {1, 5}) {
      ExecutionContext context;
      context.threads = threads;
      const Correction c = correct_stack(target, setup, path("t.uvj"),
                                         {.before = true, .volume_cells = 12}, context);
      if (first.empty()) {
        first = bytes(path("t.uvj"));
        figures = c.after.to_json() + c.before->to_json();
      }
      EXPECT_EQ(bytes(path("t.uvj")), first) << mode.name;
      EXPECT_EQ(c.after.to_json() + c.before->to_json(), figures) << mode.name;
      const StackReader stack(path("t.uvj"), folder_.string(), context);
      EXPECT_EQ(verify_stack(stack, target, setup, context).to_json(), c.after.to_json())
          << mode.name;
      EXPECT_TRUE(*c.volume == reduce_volume(stack, target, setup, 12, context)) << mode.name;
    }
  }
}

TEST_F(FlatFieldTest, SectionsProbesAndVolumesSeeThePlace) {
  std::mt19937 random(9);
  Values values(256);
  for (std::uint8_t& v : values) v = static_cast<std::uint8_t>(210 + random() % 9 * 5);
  const MemorySlices target = random_target(kGrid, 10);
  for (const Mode& mode : modes()) {
    const Settings setup = with(mode.setup, field_of(16, 16, values));
    const MemorySlices stack{CorrectedSlices(target, setup)};
    const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
    const Section s = section_of(stack, target, setup, 8);
    const ReducedVolume v = reduce_volume(stack, target, setup, 160);
    for (int x = s.x0; x < s.x0 + s.width; ++x) {
      std::vector<std::uint8_t> pixels;
      for (int n = 0; n < stack.grid().layers; ++n) pixels.push_back(stack.at(n, x, 8));
      const ColumnDose dose = column_dose(models.model_at(x, 8), pixels);
      const auto rows = probe_stack(stack, &target, setup, x, 8);
      const double factor = values[static_cast<std::size_t>(8 * 16 + x)] / 255.0;
      const ColumnHistory history = simulate_column(stack, &target, setup, x, 8, {1, {}});
      for (int n = 0; n < stack.grid().layers; ++n) {
        const auto k = static_cast<std::size_t>(n);
        ASSERT_EQ(rows[k].dose_middle, dose.middle[k]) << mode.name;
        ASSERT_DOUBLE_EQ(
            rows[k].intensity_mw_cm2,
            level_intensities(mode.setup.printer)[static_cast<std::size_t>(rows[k].grey)] * factor);
        const std::size_t at =
            k * static_cast<std::size_t>(s.width) + static_cast<std::size_t>(x - s.x0);
        ASSERT_EQ(s.dose[at], static_cast<float>(dose.middle[k]));
      }
      const auto& column =
          v.columns[static_cast<std::size_t>((8 - v.box.y0) * v.nx + x - v.box.x0)];
      EXPECT_EQ(column.x, x);
      EXPECT_DOUBLE_EQ(column.light, factor);
    }
    // At the end of the print a section over time is the section.
    const SectionHistory history =
        simulate_section(stack, &target, setup, 8, {print_clock(setup, stack.grid()).total_s()});
    for (std::size_t i = 0; i < s.dose.size(); ++i) {
      if (std::abs(s.dose[i] - 1) > 1e-6) {
        ASSERT_EQ(history.frames[0].gelled[i] != 0, s.dose[i] >= 1) << mode.name;
      }
    }
  }
}

TEST_F(FlatFieldTest, SolidAndComparisonSeeThePlace) {
  MemorySlices target(kGrid);
  for (int n = 10; n < 30; ++n) {
    for (int y = 4; y < 12; ++y) {
      for (int x = 4; x < 12; ++x) target.at(n, x, y) = 255;
    }
  }
  Settings even = even_setup();
  const MemorySlices unaware{CorrectedSlices(target, even)};
  Values values(256, 200);
  for (std::size_t i = 0; i < 256; ++i) values[i] = i % 16 < 8 ? 200 : 240;
  const Settings truth = with(even, field_of(16, 16, values, 200));
  const PlaceModels models(truth.printer, truth.resin, truth.process, kGrid, {});
  const MeshReport wrong = inspect(solid_mesh(unaware, models));
  const MeshReport right = inspect(solid_mesh(CorrectedSlices(target, truth), models));
  EXPECT_EQ(wrong.defects.open_edges, 0U);
  EXPECT_EQ(right.defects.open_edges, 0U);
  // 2000 um log10(240 / 200) above the upper edge at 500 um, but for what is in the dark there.
  EXPECT_NEAR(wrong.lower[2], 0.5 - 2 * std::log10(1.2), 0.02);
  EXPECT_NEAR(right.lower[2], 0.5, 0.005);
  const Comparison c = compare_methods(target, truth);
  EXPECT_EQ(c.ours.to_json(),
            verify_stack(CorrectedSlices(target, truth), target, truth).to_json());
  EXPECT_EQ(c.uncorrected.cure_through_voxels,
            verify_stack(target, target, truth).cure_through_voxels);
}

TEST_F(FlatFieldTest, UvPerSliceHoldsTheDeadZoneAtEveryPlace) {
  const MemorySlices target = random_target(kGrid, 11);
  Settings setup = modes()[4].setup;
  setup.process.uv = {UvKind::per_slice, 0, 15, {}};
  Values values(256);
  for (std::size_t i = 0; i < 256; ++i) values[i] = static_cast<std::uint8_t>(180 + i % 3 * 25);
  Settings uneven = with(setup, field_of(16, 16, values, 200));
  uneven.process = schedule_uv(target, uneven);
  const std::vector<double>& uv = uneven.process.uv.slice_mw_cm2;
  const MemorySlices shown(CorrectedSlices(target, uneven));
  ASSERT_EQ(uv.size(), static_cast<std::size_t>(shown.grid().layers));
  const Kinetics kinetics = make_kinetics(uneven.resin, true, true);
  const LightMap map(uneven.printer, kGrid, {});
  for (int n = 0; n < shown.grid().layers; ++n) {
    for (int i = 0; i < 256; ++i) {
      const int x = i % 16, y = i / 16;
      const double blue = (1 + 99.0 * shown.at(n, x, y) / 255) * map.factor(map.value(x, y));
      if (shown.at(n, x, y) == 0) continue;
      ASSERT_GE(uv[static_cast<std::size_t>(n)], uv_for_dead_zone(kinetics, blue, 15) * (1 - 1e-9))
          << n << " " << x << " " << y;
    }
  }
}

// ---- what can't be printed ------------------------------------------------------------------

TEST_F(FlatFieldTest, ADimPlaceIsRefusedWhereThePartIs) {
  MemorySlices target(kGrid);
  for (int n = 0; n < 40; ++n) {
    target.at(n, 3, 4) = target.at(n, 12, 4) = target.at(n, 3, 11) = 255;
  }
  // Full light gels at up to 6250 mm/h; at 3 / 255 of it up to 73.5 mm/h.
  Values values(256, 255);
  values[11 * 16 + 3] = 3;
  values[4 * 16 + 12] = 30;
  const Settings setup = with(even_setup(), field_of(16, 16, values));
  const std::string text = refusal([&] { CorrectedSlices(target, setup); });
  EXPECT_THAT(text, AllOf(HasSubstr("at 2 of its pixels, the dimmest 3, 11, which gets 0.01176"),
                          HasSubstr("print slower than 73.5")));
  try {
    CorrectedSlices(target, setup);
  } catch (const InfeasibleError&) {
  } catch (...) {
    ADD_FAILURE() << "expected an InfeasibleError";
  }
  // Slow enough it prints: the message was true.
  Settings slow = setup;
  slow.process.speed_mm_h = 73.5;
  for (CalibrationPoint& p : slow.printer.calibration) p.intensity_mw_cm2 -= p.level == 0 ? 1 : 0;
  const Prediction p = verify_stack(CorrectedSlices(target, slow), target, slow);
  EXPECT_EQ(p.undercure_voxels, 0U);
  // In the dark beside the part nothing is asked of it.
  values[11 * 16 + 3] = values[4 * 16 + 12] = 255;
  values[11 * 16 + 12] = 3;
  values[0] = 0;
  const Settings beside = with(even_setup(), field_of(16, 16, values));
  EXPECT_EQ(verify_stack(CorrectedSlices(target, beside), target, beside).undercure_voxels, 0U);
  EXPECT_EQ(MemorySlices(CorrectedSlices(target, beside)),
            MemorySlices(CorrectedSlices(target, even_setup())));
  values[4 * 16 + 3] = 0;
  EXPECT_THAT(
      refusal([&] { CorrectedSlices(target, with(even_setup(), field_of(16, 16, values))); }),
      HasSubstr("no light: 1 pixels, the first 3, 4"));
}

TEST_F(FlatFieldTest, BlackMustNotGelAnywhereOnTheDisplay) {
  MemorySlices target(kGrid);
  target.at(5, 3, 4) = 255;
  Values values(256, 20);
  values[15 * 16 + 2] = 255;
  // Black gels below 62.5 mm/h where light is full, 12.75 times as strong as that of the part.
  Settings setup = with(even_setup(), field_of(16, 16, values, 20));
  setup.process.speed_mm_h = 600;
  EXPECT_THAT(refusal([&] { CorrectedSlices(target, setup); }),
              AllOf(HasSubstr("brightest place of the display, pixel 2, 15"),
                    HasSubstr("print faster than 796.88 mm/h")));
}

// Slices after the part's end are those that the dimmest lit column needs, at the end of the part.
TEST_F(FlatFieldTest, TheDimmestLitPlaceSaysHowManySlicesCome) {
  MemorySlices target(kGrid);
  for (int n = 0; n < 40; ++n) target.at(n, 3, 4) = 255;
  for (int n = 0; n < 20; ++n) target.at(n, 12, 4) = 255;
  const auto slices = [&](int left, int right, int between) {
    Values values(256, 255);
    values[4 * 16 + 3] = static_cast<std::uint8_t>(left);
    values[4 * 16 + 12] = static_cast<std::uint8_t>(right);
    values[4 * 16 + 8] = static_cast<std::uint8_t>(between);
    return CorrectedSlices(target, with(even_setup(), field_of(16, 16, values))).grid().layers;
  };
  const int full = slices(255, 255, 255), dim = slices(60, 255, 255);
  EXPECT_EQ(full, CorrectedSlices(target, even_setup()).grid().layers);
  EXPECT_GT(dim, full);
  EXPECT_EQ(slices(255, 60, 255), full);  // its column ends far before
  EXPECT_EQ(slices(255, 255, 60), full);  // nothing is there
}

// ---- stacks ---------------------------------------------------------------------------------

TEST_F(FlatFieldTest, StacksCarryIt) {
  const MemorySlices target = random_target(kGrid, 12);
  Values values(10 * 6);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<std::uint8_t>(190 + i);
  Settings setup = with(even_setup(), field_of(10, 6, values, 249, true));
  setup.printer.orientation = Orientation{true, true, false};
  for (const char* name : {"a.uvj", "a.sl1"}) {
    const Correction c = correct_stack(target, setup, path(name), {});
    const StackReader stack(path(name), folder_.string());
    ASSERT_TRUE(stack.info().printer && stack.info().printer->flat_field) << name;
    EXPECT_EQ(*stack.info().printer, setup.printer);
    const Settings recorded{*stack.info().printer, *stack.info().resin, *stack.info().process};
    EXPECT_EQ(verify_stack(stack, target, recorded).to_json(), c.after.to_json());
    EXPECT_EQ(StackReader::read_info(path(name)).printer, stack.info().printer);
  }
  const auto block = [&](const std::string& name) {
    Entries entries = unzip(path(name));
    const Bytes& text = entry(entries, "config.json");
    return nlohmann::json::parse(text.begin(), text.end())["slicecorr"];
  };
  EXPECT_EQ(block("a.uvj")["format"], 3);
  // Others keep their version.
  correct_stack(target, even_setup(), path("even.uvj"), {});
  EXPECT_EQ(block("even.uvj")["format"], 1);
  EXPECT_FALSE(block("even.uvj")["printer"].contains("flat_field"));
  EXPECT_FALSE(block("even.uvj").contains("frame"));
}

TEST_F(FlatFieldTest, StacksWhosePictureIsDamagedAreRefused) {
  const MemorySlices target = random_target(kGrid, 13);
  correct_stack(target, with(even_setup(), field_of(2, 1, {200, 255})), path("a.uvj"), {});
  const auto name = std::string("slicecorr/flat-field.png");
  const auto with_entry = [&](const std::string& file, const std::vector<std::uint8_t>& data) {
    Entries entries = unzip(path("a.uvj"));
    entry(entries, name) = data;
    make_zip(path(file), entries);
  };
  with_entry("b.uvj", encode_png(GreyImage{2, 1, {201, 255}}));
  EXPECT_THAT(refusal([&] { StackReader(path("b.uvj"), folder_.string()); }),
              AllOf(HasSubstr(path("b.uvj")), HasSubstr(name), HasSubstr("corrected with")));
  with_entry("c.uvj", encode_png(GreyImage{1, 2, {200, 255}}));
  EXPECT_THAT(refusal([&] { StackReader::read_info(path("c.uvj")); }), HasSubstr(name));
  with_entry("d.uvj", {'x'});
  EXPECT_THAT(refusal([&] { StackReader(path("d.uvj"), folder_.string()); }), HasSubstr(name));
  Entries without = unzip(path("a.uvj"));
  std::erase_if(without, [&](const auto& e) { return e.first == name; });
  make_zip(path("e.uvj"), without);
  EXPECT_THAT(refusal([&] { StackReader::read_info(path("e.uvj")); }),
              HasSubstr(name + ": is missing"));
}

// An archive made for a display keeps that, and which places of the display it is corrected for.
TEST_F(FlatFieldTest, ArchivesOfAPrinterStayAsItsDisplayShowsThem) {
  MemorySlices target = random_target(kGrid, 14);
  const Orientation sl1s{true, true, false};
  target.set_frame({Turn{}, sl1s});
  Values values(256);
  for (std::size_t i = 0; i < 256; ++i) values[i] = static_cast<std::uint8_t>(180 + i / 4);
  Settings setup = with(even_setup(), field_of(16, 16, values));
  setup.printer.orientation = sl1s;
  const Correction c = correct_stack(target, setup, path("a.uvj"), {});
  const StackReader stack(path("a.uvj"), folder_.string());
  EXPECT_EQ(stack.frame(), target.frame());
  EXPECT_EQ(verify_stack(stack, target, setup).to_json(), c.after.to_json());
  // The same slices as ones of the plate are turned on their way: other places, other levels.
  target.set_frame({});
  EXPECT_FALSE(MemorySlices(CorrectedSlices(target, setup)) == MemorySlices(stack));
  EXPECT_EQ(verify_stack(CorrectedSlices(target, setup), target, setup).undercure_voxels, 0U);
}

}  // namespace
}  // namespace slicecorr::test
