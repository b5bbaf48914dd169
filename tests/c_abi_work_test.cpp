// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the C interface does: slices in place and in memory, every code by a real cause, cancelling, threads.
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "c_abi.hpp"
#include "memory_slices.hpp"

namespace slicecorr::test {
namespace {

class CAbiWork : public CAbiLadder {};

TEST_F(CAbiWork, CorrectsInPlace) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const StackReader target(target_path_, folder_.path());
  correct_stack(target, ladder_setup(printer_), folder_ / "expected.uvj", {});
  const StackHandle stack = open_stack(target_path_);
  ASSERT_EQ(
      slicecorr_correct(stack.get(), setup.get(), target_path_.c_str(), nullptr, nullptr, nullptr),
      SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(read_file(target_path_), read_file(folder_ / "expected.uvj"));
  EXPECT_EQ(folder_.count(), 2);
  // Never twice, not even by a handle that was opened before.
  EXPECT_EQ(
      slicecorr_correct(stack.get(), setup.get(), target_path_.c_str(), nullptr, nullptr, nullptr),
      SLICECORR_BAD_INPUT);
  EXPECT_NE(std::string(slicecorr_error_text()).find("was changed after it was opened"),
            std::string::npos);
  const StackHandle again = open_stack(target_path_);
  EXPECT_EQ(
      slicecorr_correct(again.get(), setup.get(), target_path_.c_str(), nullptr, nullptr, nullptr),
      SLICECORR_BAD_INPUT);
  EXPECT_EQ(read_file(target_path_), read_file(folder_ / "expected.uvj"));
}

TEST_F(CAbiWork, ALoadedStackNeedsItsFileNoMore) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const StackReader reader(target_path_, folder_.path());
  const Correction expected =
      correct_stack(reader, ladder_setup(printer_), folder_ / "expected.uvj", {});
  const StackHandle stack = open_stack(target_path_);
  uint8_t pixel_row[96 * 64];
  EXPECT_EQ(slicecorr_stack_get(stack.get(), 0, pixel_row, 96), SLICECORR_BAD_CALL);
  ASSERT_EQ(slicecorr_stack_load(stack.get(), nullptr), SLICECORR_OK) << slicecorr_error_text();
  ASSERT_EQ(slicecorr_stack_load(stack.get(), nullptr), SLICECORR_OK);
  std::filesystem::remove(target_path_);
  EXPECT_EQ(c_images(stack.get()), read_images(reader));
  ASSERT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), nullptr,
                              nullptr, nullptr),
            SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(read_file(folder_ / "made.uvj"), read_file(folder_ / "expected.uvj"));
  EXPECT_EQ(slicecorr_stack_put(stack.get(), 0, pixel_row, 96), SLICECORR_BAD_CALL);
}

TEST_F(CAbiWork, SlicesComeAndGoWithAnyStrideAndOrder) {
  const int width = 100, height = 70, layers = 9, stride = 131;
  const Images images = random_images(width, height, layers, 3);
  const slicecorr_grid grid{sizeof grid, width, height, layers, 0, 50, 50, 50};
  StackHandle stack;
  ASSERT_EQ(slicecorr_stack_create(&grid, out(stack)), SLICECORR_OK);
  std::vector<std::thread> threads;
  for (int first = 0; first < 3; ++first) {
    threads.emplace_back([&, first] {
      for (int n = first; n < layers - 1; n += 3) {
        const Bytes& from = images.slices[static_cast<std::size_t>(n)];
        Bytes rows(stride * height, 99);
        for (int y = 0; y < height; ++y) {
          // Even slices lie upside down.
          const int at = n % 2 == 0 ? height - 1 - y : y;
          std::copy_n(from.begin() + y * width, width, rows.begin() + at * stride);
        }
        const bool down = n % 2 == 0;
        EXPECT_EQ(
            slicecorr_stack_put(stack.get(), n, rows.data() + (down ? (height - 1) * stride : 0),
                                down ? -stride : stride),
            SLICECORR_OK)
            << slicecorr_error_text();
      }
    });
  }
  for (std::thread& t : threads) t.join();
  std::vector<Bytes> expected = images.slices;
  expected.back().assign(expected.back().size(), 0);  // never put
  EXPECT_EQ(c_images(stack.get()), expected);
  Bytes upside_down(stride * height, 55);
  ASSERT_EQ(
      slicecorr_stack_get(stack.get(), 2, upside_down.data() + (height - 1) * stride, -stride),
      SLICECORR_OK);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < stride; ++x) {
      const int v =
          x < width ? expected[2][static_cast<std::size_t>((height - 1 - y) * width + x)] : 55;
      ASSERT_EQ(upside_down[static_cast<std::size_t>(y * stride + x)], v) << x << ", " << y;
    }
  }
  // Put again, it is another slice.
  const Bytes black(static_cast<std::size_t>(width * height), 0);
  ASSERT_EQ(slicecorr_stack_put(stack.get(), 1, black.data(), width), SLICECORR_OK);
  expected[1] = black;
  EXPECT_EQ(c_images(stack.get()), expected);
  for (const int slice : {-1, layers}) {
    EXPECT_EQ(slicecorr_stack_put(stack.get(), slice, black.data(), width), SLICECORR_BAD_CALL);
  }
  EXPECT_EQ(slicecorr_stack_put(stack.get(), 0, black.data(), width - 1), SLICECORR_BAD_CALL);
  EXPECT_EQ(slicecorr_stack_put(stack.get(), 0, black.data(), 1 - width), SLICECORR_BAD_CALL);
}

TEST_F(CAbiWork, ConvertsArchivesAndWritesTargetsInMemory) {
  const StackReader reader(target_path_, folder_.path());
  StackHandle stack = open_stack(target_path_);
  ASSERT_EQ(slicecorr_convert(stack.get(), (folder_ / "made.sl1").c_str(), nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  const StackReader converted(folder_ / "made.sl1", folder_.path());
  EXPECT_EQ(converted.info().format, "sl1");
  EXPECT_EQ(read_images(converted), read_images(reader));

  const Grid& g = reader.grid();
  const slicecorr_grid grid{sizeof grid, g.width_px,   g.height_px,  g.layers,
                            0,           g.pixel_x_um, g.pixel_y_um, g.layer_um};
  ASSERT_EQ(slicecorr_stack_create(&grid, out(stack)), SLICECORR_OK);
  const std::vector<Bytes> images = read_images(reader);
  for (int n = 0; n < g.layers; ++n) {
    ASSERT_EQ(
        slicecorr_stack_put(stack.get(), n, images[static_cast<std::size_t>(n)].data(), g.width_px),
        SLICECORR_OK);
  }
  // It is for a display unless one says that it lies like the plate, as that of `slice` does.
  ASSERT_EQ(slicecorr_convert(stack.get(), (folder_ / "made.uvj").c_str(), nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_TRUE(StackReader::read_info(folder_ / "made.uvj").for_display);
  ASSERT_EQ(slicecorr_stack_set_number(stack.get(), "mirror_x", 1), SLICECORR_OK);
  ASSERT_EQ(slicecorr_convert(stack.get(), (folder_ / "made.uvj").c_str(), nullptr), SLICECORR_OK);
  EXPECT_EQ(StackReader::read_info(folder_ / "made.uvj").orientation,
            (Orientation{false, true, false}));
  ASSERT_EQ(slicecorr_stack_set_number(stack.get(), "mirror_x", 0), SLICECORR_OK);
  ASSERT_EQ(slicecorr_stack_set_number(stack.get(), "for_display", 0), SLICECORR_OK);
  EXPECT_EQ(slicecorr_stack_set_number(stack.get(), "for_display", 0.5), SLICECORR_BAD_INPUT);
  const StackHandle archive = open_stack(target_path_);
  EXPECT_EQ(slicecorr_stack_set_number(archive.get(), "portrait", 1), SLICECORR_BAD_CALL);
  ASSERT_EQ(slicecorr_convert(stack.get(), (folder_ / "made.uvj").c_str(), nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(read_file(folder_ / "made.uvj"), read_file(target_path_));
  EXPECT_EQ(slicecorr_convert(stack.get(), (folder_ / "made.xyz").c_str(), nullptr),
            SLICECORR_BAD_INPUT);
}

TEST_F(CAbiWork, WantedDoses) {
  const StackReader target(target_path_, folder_.path());
  const Grid& g = target.grid();
  const std::string resin = SLICECORR_DB_DIR "/figure-2-2.toml";
  const SetupHandle setup =
      c_setup({{"printer_toml", printer_}, {"resin", resin}, {"speed_mm_h", "1000"}});
  SetupChoices choices;
  choices.printer_toml = printer_;
  choices.resin = resin;
  choices.speed_mm_h = 1000;
  const StackHandle stack = open_stack(target_path_);
  const slicecorr_grid grid{sizeof grid, g.width_px,   g.height_px,  g.layers,
                            0,           g.pixel_x_um, g.pixel_y_um, g.layer_um};
  StackHandle doses;
  ASSERT_EQ(slicecorr_stack_create(&grid, out(doses)), SLICECORR_OK);
  MemorySlices bytes(g);
  for (int n = 0; n < g.layers; ++n) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) bytes.at(n, x, y) = static_cast<std::uint8_t>(x + 3 * n);
    }
    ASSERT_EQ(slicecorr_stack_put(doses.get(), n, &bytes.at(n, 0, 0), g.width_px), SLICECORR_OK);
  }
  DoseTarget wanted;
  wanted.images = &bytes;
  wanted.scale = DoseScale::even(2.5);
  wanted.scale.side = DoseSide::at_least;
  name_ranges(wanted);
  const GradedTarget graded(target, wanted);
  const Correction expected =
      correct_stack(graded, resolve_setup(choices, nullptr, &target.info(), ChoiceNames::fields),
                    folder_ / "expected.uvj", {});
  ASSERT_EQ(slicecorr_stack_set_doses(stack.get(), doses.get(), 2.5, "at-least"), SLICECORR_OK);
  doses.reset();
  FiguresHandle after;
  ASSERT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), nullptr,
                              out(after), nullptr),
            SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(read_file(folder_ / "made.uvj"), read_file(folder_ / "expected.uvj"));
  EXPECT_EQ(json_of(after), expected.after.to_json());
  EXPECT_NE(json_of(after).find("\"regions\""), std::string::npos);
  StackHandle corrected;
  ASSERT_EQ(
      slicecorr_correct_in_memory(stack.get(), setup.get(), nullptr, out(corrected), out(after)),
      SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(c_images(corrected.get()),
            read_images(StackReader(folder_ / "made.uvj", folder_.path())));
  EXPECT_EQ(json_of(after), expected.after.to_json());

  // Taken back, and what is refused.
  ASSERT_EQ(slicecorr_stack_set_doses(stack.get(), nullptr, 0, nullptr), SLICECORR_OK);
  ASSERT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), nullptr,
                              out(after), nullptr),
            SLICECORR_OK);
  EXPECT_EQ(json_of(after).find("\"regions\""), std::string::npos);
  EXPECT_EQ(slicecorr_stack_set_doses(stack.get(), stack.get(), 2, nullptr), SLICECORR_BAD_CALL);
  slicecorr_grid other = grid;
  other.layers -= 1;
  ASSERT_EQ(slicecorr_stack_create(&other, out(doses)), SLICECORR_OK);
  EXPECT_EQ(slicecorr_stack_set_doses(stack.get(), doses.get(), 0.5, nullptr), SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_stack_set_doses(stack.get(), doses.get(), 2, "above"), SLICECORR_BAD_INPUT);
  ASSERT_EQ(slicecorr_stack_set_doses(stack.get(), doses.get(), 2, nullptr), SLICECORR_OK);
  EXPECT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), nullptr,
                              out(after), nullptr),
            SLICECORR_BAD_INPUT);
}

TEST_F(CAbiWork, CheckKnowsWhichPlacesAreLit) {
  const StackHandle stack = open_stack(target_path_);
  const PixelBox lit = StackReader(target_path_, folder_.path()).bounds();
  for (const bool dim_part : {false, true}) {
    SCOPED_TRACE(dim_part);
    GreyImage light{96, 64, {}};
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 96; ++x) {
        const bool part = x >= lit.x0 && x < lit.x1 && y >= lit.y0 && y < lit.y1;
        light.pixels.push_back(part == dim_part ? 3 : 255);
      }
    }
    write_file(folder_ / "light.png", encode_png(light));
    std::string text = printer_;
    text.insert(text.find("[blue]"), "flat_field = \"light.png\"\n");
    write_file(folder_ / "printer.toml", to_bytes(text));
    const SetupHandle setup = c_setup({{"printer", folder_ / "printer.toml"},
                                       {"resin", SLICECORR_DB_DIR "/figure-2-2.toml"},
                                       {"speed_mm_h", "1000"}});
    const slicecorr_status checked = slicecorr_check(stack.get(), setup.get(), nullptr);
    const std::string said = slicecorr_error_text();
    EXPECT_EQ(checked, dim_part ? SLICECORR_INFEASIBLE : SLICECORR_OK) << said;
    EXPECT_EQ(slicecorr_correct(stack.get(), setup.get(), (folder_ / "made.uvj").c_str(), nullptr,
                                nullptr, nullptr),
              checked)
        << slicecorr_error_text();
    if (dim_part) {
      EXPECT_EQ(said, slicecorr_error_text());
    }
  }
}

TEST_F(CAbiWork, EveryCodeHasItsCause) {
  const StackHandle stack = open_stack(target_path_);
  const std::string made = folder_ / "made.uvj";
  const auto correct = [&](const Settings& more, const std::string& path) {
    Settings settings = ladder_settings(printer_);
    settings.insert(settings.end(), more.begin(), more.end());
    const SetupHandle setup = c_setup(settings);
    const slicecorr_status checked = slicecorr_check(stack.get(), setup.get(), nullptr);
    const slicecorr_status done =
        slicecorr_correct(stack.get(), setup.get(), path.c_str(), nullptr, nullptr, nullptr);
    // The check finds what is wrong with the setup, without looking at an image.
    EXPECT_EQ(checked, done == SLICECORR_DEVICE ? SLICECORR_OK : done) << slicecorr_error_text();
    return done;
  };
  const auto says = [](const std::string& words) {
    EXPECT_NE(std::string(slicecorr_error_text()).find(words), std::string::npos)
        << slicecorr_error_text();
  };
  EXPECT_EQ(correct({{"resin", "no-such-resin"}}, made), SLICECORR_BAD_INPUT);
  says("no-such-resin");
  EXPECT_EQ(correct({{"printer_toml", "name = "}}, made), SLICECORR_BAD_INPUT);
  says("printer_toml: line 1");
  EXPECT_EQ(correct({{"printer_toml", printer_toml(90, 64)}}, made), SLICECORR_BAD_INPUT);
  says("96 x 64");
  EXPECT_EQ(correct({{"exposure_s", "3"}}, made), SLICECORR_BAD_INPUT);
  says("expected mode layerwise");
  EXPECT_EQ(correct({{"speed_mm_h", ""}}, made), SLICECORR_BAD_INPUT);
  says("speed_mm_h is required");
  EXPECT_EQ(correct({{"speed_mm_h", "50000"}}, made), SLICECORR_INFEASIBLE);
  says("mm/h");
  EXPECT_EQ(correct({}, folder_ / "no/such/folder/made.uvj"), SLICECORR_DEVICE);
  EXPECT_EQ(correct({}, "/proc/made.uvj"), SLICECORR_DEVICE);

  // Not checkable without images.
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const auto to = [&](const std::string& path) {
    return slicecorr_correct(stack.get(), setup.get(), path.c_str(), nullptr, nullptr, nullptr);
  };
  EXPECT_EQ(to(folder_ / "made.xyz"), SLICECORR_BAD_INPUT);
  EXPECT_EQ(to(""), SLICECORR_BAD_INPUT);

  Bytes damaged = read_file(target_path_);
  const auto after = [&](Bytes::iterator from, std::string_view words) {
    return std::search(from, damaged.end(), words.begin(), words.end());
  };
  const auto data = after(after(damaged.begin(), "slice/"), "IDAT");
  ASSERT_GT(damaged.end() - data, 20);
  *(data + 12) ^= 0x5A;
  write_file(folder_ / "damaged.uvj", damaged);
  StackHandle other;
  if (slicecorr_stack_open((folder_ / "damaged.uvj").c_str(), out(other)) == SLICECORR_OK) {
    EXPECT_EQ(slicecorr_stack_load(other.get(), nullptr), SLICECORR_BAD_INPUT);
  }
  says("damaged.uvj");
  std::filesystem::remove(folder_ / "damaged.uvj");

  // A stack of another size against this target; an uncorrected one without a setup.
  const slicecorr_grid grid{sizeof grid, 96, 60, 50, 0, 50, 50, 50};
  ASSERT_EQ(slicecorr_stack_create(&grid, out(other)), SLICECORR_OK);
  FiguresHandle figures;
  EXPECT_EQ(slicecorr_verify(other.get(), stack.get(), setup.get(), nullptr, out(figures)),
            SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_verify(stack.get(), stack.get(), nullptr, nullptr, out(figures)),
            SLICECORR_BAD_INPUT);
  says("expected printer");
  // All black.
  const slicecorr_grid black_grid{sizeof grid, 96, 64, 50, 0, 50, 50, 50};
  ASSERT_EQ(slicecorr_stack_create(&black_grid, out(other)), SLICECORR_OK);
  StackHandle corrected;
  EXPECT_EQ(slicecorr_correct_in_memory(other.get(), setup.get(), nullptr, out(corrected), nullptr),
            SLICECORR_BAD_INPUT);
  says("nothing in the part is solid");
  EXPECT_EQ(slicecorr_correct(other.get(), setup.get(), made.c_str(), nullptr, nullptr, nullptr),
            SLICECORR_BAD_INPUT);

  ASSERT_EQ(slicecorr_predict(stack.get(), setup.get(), nullptr, out(figures)), SLICECORR_OK);
  EXPECT_EQ(slicecorr_figures_require(figures.get(), "height_error_um.max_abs", 1e6), SLICECORR_OK);
  EXPECT_EQ(slicecorr_figures_require(figures.get(), "height_error_um.max_abs", 10),
            SLICECORR_MISSED);
  says("allowed are 10");
  EXPECT_EQ(slicecorr_figures_require(figures.get(), "grey_dose_error.mean_abs", 0), SLICECORR_OK);
  EXPECT_EQ(slicecorr_figures_require(figures.get(), "beauty", 0), SLICECORR_UNKNOWN_NAME);
  EXPECT_EQ(slicecorr_figures_require(figures.get(), "iou", std::nan("")), SLICECORR_BAD_CALL);
  EXPECT_EQ(folder_.count(), 1);

  // The handles have seen all that and still work.
  EXPECT_EQ(to(made), SLICECORR_OK) << slicecorr_error_text();
}

TEST_F(CAbiWork, RefusesToCureToTheWindow) {
  Settings settings = {{"printer_toml", printer_},
                       {"resin", SLICECORR_DB_DIR "/custom-resin-1.toml"},
                       {"speed_mm_h", "100"},
                       {"uv_mw_cm2", "0.001"}};
  const StackHandle stack = open_stack(target_path_);
  const std::string made = folder_ / "made.uvj";
  const auto expect = [&](slicecorr_status expected, const std::string& words) {
    const SetupHandle setup = c_setup(settings);
    StackHandle corrected;
    for (const bool in_memory : {false, true}) {
      const slicecorr_status status =
          in_memory ? slicecorr_correct_in_memory(stack.get(), setup.get(), nullptr, out(corrected),
                                                  nullptr)
                    : slicecorr_correct(stack.get(), setup.get(), made.c_str(), nullptr, nullptr,
                                        nullptr);
      EXPECT_EQ(status, expected) << in_memory << slicecorr_error_text();
      EXPECT_NE(std::string(slicecorr_error_text()).find(words), std::string::npos)
          << slicecorr_error_text();
    }
    EXPECT_EQ(corrected != nullptr, expected == SLICECORR_OK);
    EXPECT_EQ(std::filesystem::exists(made), expected == SLICECORR_OK);
  };
  expect(SLICECORR_INFEASIBLE, "would cure to the window");
  settings.emplace_back("window_cure", "allow");
  expect(SLICECORR_OK, "");
}

TEST_F(CAbiWork, PropertiesSayWhatTheArchiveSays) {
  const SetupHandle setup = c_setup(ladder_settings(printer_));
  const std::string made = folder_ / "made.uvj";
  const StackHandle stack = open_stack(target_path_);
  ASSERT_EQ(slicecorr_correct(stack.get(), setup.get(), made.c_str(), nullptr, nullptr, nullptr),
            SLICECORR_OK);
  const StackHandle corrected = open_stack(made);
  const StackInfo info = StackReader::read_info(made);
  const auto number = [](const StackHandle& s, const char* name) {
    double value = -1;
    EXPECT_EQ(slicecorr_stack_number(s.get(), name, &value), SLICECORR_OK) << name;
    return value;
  };
  const auto text = [](const StackHandle& s, const char* name) {
    const char* const t = slicecorr_stack_text(s.get(), name);
    return std::string(t ? t : "(null)");
  };
  const std::map<std::string, double> expected = {{"width_px", 96},
                                                  {"height_px", 64},
                                                  {"layers", info.grid.layers},
                                                  {"pixel_x_um", 50},
                                                  {"pixel_y_um", 50},
                                                  {"layer_um", 50},
                                                  {"target_layers", 50},
                                                  {"part_volume_mm3", info.part_volume_mm3},
                                                  {"speed_mm_h", 1000},
                                                  {"light_s", light_on_s(info)},
                                                  {"print_time_s", light_on_s(info)},
                                                  {"own_print_time_s", 0},
                                                  {"corrected", 1},
                                                  {"for_display", 0},
                                                  {"portrait", 0},
                                                  {"in_memory", 0}};
  for (const auto& [name, value] : expected) {
    EXPECT_EQ(number(corrected, name.c_str()), value) << name;
  }
  EXPECT_GT(info.grid.layers, 50);
  EXPECT_EQ(text(corrected, "kind"), "corrected");
  EXPECT_EQ(text(corrected, "mode"), "continuous");
  EXPECT_EQ(text(corrected, "path"), made);
  EXPECT_EQ(text(corrected, "format"), "uvj");
  EXPECT_EQ(text(corrected, "printer"), "small");
  EXPECT_EQ(text(corrected, "resin"), info.resin->name);
  EXPECT_EQ(text(stack, "kind"), "target");
  EXPECT_EQ(text(stack, "printer"), "");
  EXPECT_EQ(text(stack, "beauty"), "(null)");
  EXPECT_EQ(number(stack, "corrected"), 0);
  double value = 0;
  EXPECT_EQ(slicecorr_stack_number(stack.get(), "beauty", &value), SLICECORR_UNKNOWN_NAME);
  // What the archive says is not overruled.
  EXPECT_EQ(slicecorr_stack_set_number(stack.get(), "layer_um", 25), SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_stack_set_number(stack.get(), "layers", 25), SLICECORR_UNKNOWN_NAME);

  // Exposure times of a layerwise stack, also to a list that is too short for them.
  Settings settings = ladder_settings(printer_);
  settings.back() = {"mode", "layerwise"};
  settings.insert(settings.end(),
                  {{"exposure_s", "2"}, {"bottom_exposure_s", "2.5"}, {"bottom_layers", "2"}});
  const SetupHandle layerwise = c_setup(settings);
  ASSERT_EQ(
      slicecorr_correct(stack.get(), layerwise.get(), made.c_str(), nullptr, nullptr, nullptr),
      SLICECORR_OK)
      << slicecorr_error_text();
  const StackHandle timed = open_stack(made);
  double times[4] = {-1, -1, -1, -1};
  size_t count = 0;
  ASSERT_EQ(slicecorr_stack_numbers(timed.get(), "layer_exposure_s", times, 3, &count),
            SLICECORR_OK);
  EXPECT_EQ(count, 50U);
  EXPECT_EQ(times[0], 2.5);
  EXPECT_EQ(times[1], 2.5);
  EXPECT_EQ(times[2], 2);
  EXPECT_EQ(times[3], -1);
  EXPECT_EQ(number(timed, "exposure_s"), 2);
  EXPECT_EQ(text(timed, "mode"), "layerwise");
}

}  // namespace
}  // namespace slicecorr::test
