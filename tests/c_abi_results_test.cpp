// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the C interface gives is what the C++ pipeline gives, byte for byte, whatever the print.
#include <nlohmann/json.hpp>
#include <thread>

#include "c_abi.hpp"
#include "memory_slices.hpp"

namespace slicecorr::test {
namespace {

/// A way to print, and a target for it.
struct Case {
  const char* name;
  std::string printer;
  Settings settings;
  SetupChoices choices;
  bool random = false;  ///< random coverage instead of the ladder
  bool uneven = false;  ///< the display shines unevenly
};

std::vector<Case> cases() {
  const std::string inhibited = SLICECORR_DB_DIR "/custom-resin-1.toml";
  const std::string plain = SLICECORR_DB_DIR "/figure-2-2.toml";
  std::vector<Case> all;
  const auto add = [&](const char* name, const std::string& printer, const std::string& resin,
                       Settings settings, auto choose, bool random = false) {
    SetupChoices c;
    c.printer_toml = printer;
    c.resin = resin;
    choose(c);
    settings.insert(settings.end(), {{"printer_toml", printer}, {"resin", resin}});
    all.push_back({name, printer, settings, c, random});
  };
  add("continuous", printer_toml(96, 64), plain, {{"speed_mm_h", "1000"}},
      [](SetupChoices& c) { c.speed_mm_h = 1000; });
  add(
      "random coverage, capped, few levels", printer_toml(150, 90, "[50.0, 40.5]", 4), plain,
      {{"speed_mm_h", "900"}, {"omega_max", "2.5"}, {"one_slice_gaps", "merge"}},
      [](SetupChoices& c) {
        c.speed_mm_h = 900;
        c.omega_max = "2.5";
        c.one_slice_gaps = "merge";
      },
      true);
  add("layerwise", printer_toml(96, 64), plain,
      {{"mode", "layerwise"},
       {"exposure_s", "2"},
       {"bottom_exposure_s", "2.5"},
       {"bottom_layers", "2"},
       {"fade_layers", "3"}},
      [](SetupChoices& c) {
        c.mode = "layerwise";
        c.exposure_s = 2;
        c.bottom_exposure_s = 2.5;
        c.bottom_layers = 2;
        c.fade_layers = 3;
      });
  add("a bath that ends below a platform that reflects", printer_toml(96, 64), plain,
      {{"speed_mm_h", "1000"}, {"resin_depth_um", "3000"}, {"platform_reflectance", "0.2"}},
      [](SetupChoices& c) {
        c.speed_mm_h = 1000;
        c.resin_depth_um = 3000;
        c.platform_reflectance = 0.2;
      });
  add("UV per slice", printer_toml(96, 64), inhibited,
      {{"speed_mm_h", "100"}, {"dead_zone_um", "20"}, {"window_cure", "allow"}},
      [](SetupChoices& c) {
        c.speed_mm_h = 100;
        c.dead_zone_um = 20;
        c.window_cure = "allow";
      });
  add("UV patterned", printer_toml(96, 64, "50", 8, "patterned"), inhibited,
      {{"speed_mm_h", "100"}, {"dead_zone_um", "20"}, {"window_cure", "allow"}},
      [](SetupChoices& c) {
        c.speed_mm_h = 100;
        c.dead_zone_um = 20;
        c.window_cure = "allow";
      });
  all.push_back(all.front());
  all.back().name = "uneven light";
  all.back().uneven = true;
  return all;
}

std::string without_places(const std::string& json) {
  auto figures = nlohmann::ordered_json::parse(json);
  for (const char* bodies : {"islands", "sealed_cavities", "cups"}) {
    for (auto& body : figures[bodies]) {
      body.erase("x_mm");
      body.erase("y_mm");
    }
  }
  return figures.dump();
}

/// Slices that callbacks give and take.
struct Exchange {
  std::vector<Bytes> given, taken;
  std::vector<int> order;
  int stop_giving = -1, stop_taking = -1;
  std::thread::id thread = std::this_thread::get_id();

  static int give(void* user, int slice, uint8_t* pixels) {
    auto& e = *static_cast<Exchange*>(user);
    EXPECT_EQ(std::this_thread::get_id(), e.thread);
    e.order.push_back(slice);
    const Bytes& from = e.given[static_cast<std::size_t>(slice)];
    // A source may leave black pixels alone.
    for (std::size_t i = 0; i < from.size(); ++i) {
      EXPECT_EQ(pixels[i], 0);
      if (from[i]) pixels[i] = from[i];
    }
    return slice == e.stop_giving;
  }
  static int take(void* user, int slice, int slices, const uint8_t* pixels) {
    auto& e = *static_cast<Exchange*>(user);
    EXPECT_EQ(std::this_thread::get_id(), e.thread);
    EXPECT_EQ(slice, static_cast<int>(e.taken.size()));
    EXPECT_LT(slice, slices);
    e.taken.emplace_back(pixels, pixels + e.given.front().size());
    return slice == e.stop_taking;
  }
};

TEST(CAbiResults, EqualThoseOfTheCppPipelineByteForByte) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const TemporaryFolder folder;
    Settings settings = c.settings;
    SetupChoices choices = c.choices;
    if (c.uneven) {
      // From 70 to 100 % across, in a file of its own beside the printer's.
      GreyImage light{7, 5, {}};
      for (int i = 0; i < 35; ++i) light.pixels.push_back(static_cast<uint8_t>(180 + i % 7 * 12));
      write_file(folder / "light.png", encode_png(light));
      std::string text = c.printer;
      text.insert(text.find("[blue]"), "flat_field = \"light.png\"\n");
      write_file(folder / "printer.toml", to_bytes(text));
      settings.emplace_back("printer", folder / "printer.toml");
      choices.printer_toml.clear();
      choices.printer = folder / "printer.toml";
    }
    const std::string target_path = folder / "target.uvj";
    if (c.random) {
      Images images = random_images(150, 90, 70, 7);
      images.grid.layer_um = 40;
      write_stack(target_path, images, info_of(images.grid));
    } else {
      write_ladder(target_path, c.printer);
    }
    const StackReader target(target_path, folder.path());
    const slicecorr::Setup setup =
        resolve_setup(choices, nullptr, &target.info(), ChoiceNames::fields);
    const Correction expected =
        correct_stack(target, setup, folder / "expected.uvj", {.before = true});
    const StackReader expected_stack(folder / "expected.uvj", folder.path());
    const std::vector<Bytes> images = read_images(expected_stack);
    const SetupHandle s = c_setup(settings);
    const StackHandle t = open_stack(target_path);
    FiguresHandle after, before;

    // Archive to archive.
    ASSERT_EQ(slicecorr_check(t.get(), s.get(), nullptr), SLICECORR_OK) << slicecorr_error_text();
    ASSERT_EQ(slicecorr_correct(t.get(), s.get(), (folder / "made.uvj").c_str(), nullptr,
                                out(after), out(before)),
              SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(read_file(folder / "made.uvj"), read_file(folder / "expected.uvj"));
    EXPECT_EQ(json_of(after), expected.after.to_json());
    EXPECT_EQ(json_of(before), expected.before->to_json());
    FiguresHandle predicted;
    ASSERT_EQ(slicecorr_predict(t.get(), s.get(), nullptr, out(predicted)), SLICECORR_OK);
    const slicecorr::Setup scheduled{setup.printer, setup.resin, *expected.info.process};
    EXPECT_EQ(json_of(predicted), verify_stack(target, target, scheduled).to_json());
    if (scheduled.process.uv.kind == UvKind::off) {
      EXPECT_EQ(not_in_time(json_of(predicted)), not_in_time(json_of(before)));
    }

    // In memory: without figures, then with them.
    StackHandle corrected;
    ASSERT_EQ(slicecorr_correct_in_memory(t.get(), s.get(), nullptr, out(corrected), nullptr),
              SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(c_images(corrected.get()), images);
    ASSERT_EQ(slicecorr_correct_in_memory(t.get(), s.get(), nullptr, out(corrected), out(after)),
              SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(c_images(corrected.get()), images);
    EXPECT_EQ(json_of(after), expected.after.to_json());
    EXPECT_STREQ(slicecorr_stack_text(corrected.get(), "kind"), "corrected");
    EXPECT_STREQ(slicecorr_stack_text(corrected.get(), "printer"), "small");
    double volume = 0;
    EXPECT_EQ(slicecorr_stack_number(corrected.get(), "part_volume_mm3", &volume), SLICECORR_OK);
    EXPECT_EQ(volume, expected.info.part_volume_mm3);

    // Both know how they are printed.
    const StackHandle made = open_stack(folder / "made.uvj");
    for (const slicecorr_stack* stack : {made.get(), corrected.get()}) {
      FiguresHandle verified;
      ASSERT_EQ(slicecorr_verify(stack, t.get(), nullptr, nullptr, out(verified)), SLICECORR_OK)
          << slicecorr_error_text();
      EXPECT_EQ(json_of(verified), expected.after.to_json());
    }

    // Slices through callbacks.
    Exchange exchange;
    exchange.given = read_images(target);
    const Grid& g = target.grid();
    const slicecorr_grid grid{sizeof grid, g.width_px,   g.height_px,  g.layers,
                              0,           g.pixel_x_um, g.pixel_y_um, g.layer_um};
    ASSERT_EQ(slicecorr_correct_slices(&grid, Exchange::give, &exchange, s.get(), nullptr,
                                       Exchange::take, &exchange, out(after)),
              SLICECORR_OK)
        << slicecorr_error_text();
    EXPECT_EQ(exchange.taken, images);
    // Nobody says how these images lie on the plate: places of bodies are those in the images.
    EXPECT_EQ(without_places(json_of(after)), without_places(expected.after.to_json()));
    std::vector<int> in_order(static_cast<std::size_t>(g.layers));
    for (int n = 0; n < g.layers; ++n) in_order[static_cast<std::size_t>(n)] = n;
    EXPECT_EQ(exchange.order, in_order);

    // UV light of each slice, and of each pixel, as the archive has it.
    double uv[2000];
    size_t count = 0;
    ASSERT_EQ(slicecorr_stack_numbers(corrected.get(), "uv_slice_mw_cm2", uv, 2000, &count),
              SLICECORR_OK);
    const std::vector<double>& slices = expected.info.process->uv.slice_mw_cm2;
    EXPECT_EQ(count, slices.empty() ? 0U : images.size());
    for (size_t n = 0; n < count; ++n) EXPECT_EQ(uv[n], slices[std::min(n, slices.size() - 1)]);
    ASSERT_EQ(slicecorr_stack_numbers(corrected.get(), "uv_of_pixel", uv, 2000, &count),
              SLICECORR_OK);
    const bool patterned = setup.process.uv.kind == UvKind::patterned;
    EXPECT_EQ(count, patterned ? 256U : 0U);
    if (patterned) {
      Entries entries = unzip(folder / "made.uvj");
      for (const int n : {0, 20, g.layers - 1}) {
        char name[40];
        std::snprintf(name, sizeof name, "uv/%08d.png", n);
        const GreyImage shown = decode_png(entry(entries, name), g.width_px, g.height_px, "", name);
        const Bytes& blue = images[static_cast<std::size_t>(n)];
        for (std::size_t i = 0; i < blue.size(); ++i) ASSERT_EQ(shown.pixels[i], uv[blue[i]]);
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr::test
