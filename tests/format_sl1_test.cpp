// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// SL1 archives: as PrusaSlicer writes them, as old programs wrote them, and changed in place.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>

#include "real_files.hpp"
#include "slicecorr/pipeline.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::Entries;
using test::Images;
using test::TemporaryFolder;
using test::to_bytes;

constexpr const char* kConfig =
    "action = print\nexpTime = 3\nexpTimeFirst = 20\nfileCreationTimestamp = 2024-02-08 at "
    "19:52:50 UTC\njobDir = part\nlayerHeight = 0.1\nmaterialName = Grey @0.10\nnumFade = 10\n"
    "numFast = 4\nnumSlow = 2\nprintProfile = 0.1 Fast\nprinterModel = SL1S\nprinterProfile = My "
    "SL1S\n";
constexpr const char* kSettings =
    "display_height = 4.2\ndisplay_mirror_x = 1\ndisplay_mirror_y = 0\ndisplay_orientation = "
    "portrait\ndisplay_pixels_x = 30\ndisplay_pixels_y = 70\ndisplay_width = 1.5\nexposure_time = "
    "3\nfaded_layers = 10\ninitial_exposure_time = 20\ninitial_layer_height = 0.1\nlayer_height = "
    "0.1\n";

/// A PNG made here, row filter 0: `row(y)` are the bytes of a row.
template <class Row>
Bytes make_png(std::uint32_t width, std::uint32_t height, std::uint8_t depth, std::uint8_t colour,
               const Row& row) {
  Bytes raw;
  for (std::uint32_t y = 0; y < height; ++y) {
    raw.push_back(0);
    const Bytes bytes = row(y);
    raw.insert(raw.end(), bytes.begin(), bytes.end());
  }
  Bytes packed(compressBound(raw.size()));
  uLongf size = packed.size();
  compress(packed.data(), &size, raw.data(), raw.size());
  packed.resize(size);
  Bytes png{0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};
  const auto u32 = [](std::size_t v) {
    return Bytes{static_cast<std::uint8_t>(v >> 24), static_cast<std::uint8_t>(v >> 16),
                 static_cast<std::uint8_t>(v >> 8), static_cast<std::uint8_t>(v)};
  };
  const auto chunk = [&](const char* type, const Bytes& data) {
    Bytes body(type, type + 4);
    body.insert(body.end(), data.begin(), data.end());
    const Bytes length = u32(data.size());
    const Bytes crc = u32(crc32(0, body.data(), static_cast<uInt>(body.size())));
    for (const Bytes& part : {length, body, crc}) png.insert(png.end(), part.begin(), part.end());
  };
  Bytes header = u32(width);
  const Bytes h = u32(height);
  header.insert(header.end(), h.begin(), h.end());
  header.insert(header.end(), {depth, colour, 0, 0, 0});
  chunk("IHDR", header);
  chunk("IDAT", packed);
  chunk("IEND", {});
  return png;
}

Bytes grey_png(const Images& images, int n) {
  const Grid& g = images.grid;
  return make_png(static_cast<std::uint32_t>(g.width_px), static_cast<std::uint32_t>(g.height_px),
                  8, 0, [&](std::uint32_t y) {
                    const std::uint8_t* const row =
                        images.slices[static_cast<std::size_t>(n)].data() +
                        static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width_px);
                    return Bytes(row, row + g.width_px);
                  });
}

std::string name_of(int n) {
  char text[32];
  std::snprintf(text, sizeof text, "part%05d.png", n);
  return text;
}

/// As a slicer writes it, and with entries that nobody knows, out of order.
Entries foreign(const Images& images) {
  Entries entries{{"thumbnail/thumbnail400x400.png", to_bytes("no picture at all")},
                  {"config.ini", to_bytes(kConfig)}};
  for (int n : {3, 0, 5, 1, 2, 4}) entries.push_back({name_of(n), grey_png(images, n)});
  entries.push_back({"notes/of the user.txt", Bytes(3000, 'x')});
  entries.push_back({"prusaslicer.ini", to_bytes(kSettings)});
  entries.push_back({"mask.png", to_bytes("another picture")});
  return entries;
}

Images six_images() { return test::random_images(70, 30, 6, 5); }

Setup setup_for(const Grid& g) {
  Setup s;
  s.printer.name = "small";
  s.printer.width_px = g.width_px;
  s.printer.height_px = g.height_px;
  s.printer.pixel_x_um = g.pixel_x_um;
  s.printer.pixel_y_um = g.pixel_y_um;
  s.printer.calibration = {{0, 0}, {255, 20}};
  s.resin.name = "resin";
  s.resin.absorbance_height10_um = 400;
  s.resin.critical_dose_mj_cm3 = 100;
  s.process.mode = ExposureMode::layerwise;
  return s;
}

TEST(Sl1, SaysWhatItIsAsThePrinterReadsIt) {
  const TemporaryFolder folder;
  const Images images = six_images();
  test::make_zip(folder / "part.sl1", foreign(images));
  const StackReader reader(folder / "part.sl1", folder.path());
  const StackInfo& info = reader.info();
  EXPECT_EQ(info.format, "sl1");
  EXPECT_EQ(info.kind, StackKind::foreign);
  EXPECT_EQ(info.grid.layers, 6);
  // Portrait: the image's columns run along the display's y.
  EXPECT_DOUBLE_EQ(info.grid.pixel_x_um, 60);
  EXPECT_DOUBLE_EQ(info.grid.pixel_y_um, 50);
  EXPECT_DOUBLE_EQ(info.grid.layer_um, 100);
  EXPECT_EQ(info.orientation, (Orientation{true, true, false}));
  EXPECT_EQ(info.profiles.printer, "My SL1S");
  EXPECT_EQ(info.profiles.material, "Grey @0.10");
  EXPECT_EQ(test::read_images(reader), images.slices);
  // The firmware's rule: 20 s, then 17/9 s less each time, 3 s from layer 9 on.
  const Process p = process_of_times(info);
  for (int n = 0; n < 14; ++n) {
    EXPECT_NEAR(layer_exposure_s(p, n), n < 9 ? 20 - n * 17.0 / 9 : 3, 1e-12) << n;
  }
}

TEST(Sl1, CorrectedInPlaceKeepsEverythingElseByteForByte) {
  const TemporaryFolder folder;
  const std::string path = folder / "part.sl1";
  const Images images = six_images();
  for (const bool deflate : {false, true}) {
    test::make_zip(path, foreign(images), deflate);
    int code = 0;
    zip_t* const zip = zip_open(path.c_str(), 0, &code);
    ASSERT_NE(zip, nullptr);
    zip_set_archive_comment(zip, "made by hand", 12);
    zip_file_set_comment(zip, 2, "an image", 8, 0);
    zip_file_set_comment(zip, 8, "a text", 6, 0);
    for (zip_uint64_t i = 0; i < 11; ++i) {
      zip_file_set_dostime(zip, i, static_cast<zip_uint16_t>(0x6000 + i), 0x5000, 0);
      zip_file_set_external_attributes(zip, i, 0, ZIP_OPSYS_UNIX, 0100640u << 16);
    }
    ASSERT_EQ(zip_close(zip), 0);
    const Entries before = test::unzip(path);
    {
      const StackReader target(path, folder.path());
      slicecorr::Setup setup = setup_for(target.grid());
      setup.process = process_of_times(target.info());
      StackFile file(path);
      file.keep_from = path;
      correct_stack(target, setup, file, {});
    }
    const Entries after = test::unzip(path);
    ASSERT_EQ(after.size(), before.size() + 1);
    int changed = 0;
    for (std::size_t i = 0; i < before.size(); ++i) {
      EXPECT_EQ(after[i].first, before[i].first);
      const bool image = before[i].first.starts_with("part0");
      changed += after[i].second != before[i].second;
      if (!image) {
        EXPECT_EQ(after[i].second, before[i].second) << before[i].first;
      }
    }
    EXPECT_EQ(changed, 6);
    EXPECT_EQ(after.back().first, "slicecorr.json");
    zip_t* const now = zip_open(path.c_str(), ZIP_RDONLY, &code);
    ASSERT_NE(now, nullptr);
    int length = 0;
    EXPECT_STREQ(zip_get_archive_comment(now, &length, 0), "made by hand");
    zip_uint32_t comment = 0;
    const char* const of_image = zip_file_get_comment(now, 2, &comment, 0);
    EXPECT_EQ(std::string(of_image, comment), "an image");
    for (zip_uint64_t i = 0; i < 11; ++i) {
      zip_stat_t s;
      zip_stat_index(now, i, 0, &s);
      struct tm t {};
      localtime_r(&s.mtime, &t);
      EXPECT_EQ(t.tm_hour, 12);
      EXPECT_EQ(t.tm_sec, 2 * static_cast<int>(i)) << s.name;
      EXPECT_EQ(s.comp_method, deflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE) << s.name;
      zip_uint8_t system = 0;
      zip_uint32_t attributes = 0;
      zip_file_get_external_attributes(now, i, 0, &system, &attributes);
      EXPECT_EQ(attributes >> 16, 0100640u);
    }
    zip_discard(now);
    EXPECT_EQ(folder.count(), 1) << "temporary files are left";
    EXPECT_EQ(StackReader::read_info(path).kind, StackKind::corrected);
    std::filesystem::remove(path);
  }
}

TEST(Sl1, ImagesOfNewArchivesAreDeflatedOnceMore) {
  const TemporaryFolder folder;
  // A block on a large display: rows repeat, and with them what a PNG makes of them.
  Images images{{2000, 1000, 3, 50, 50, 50}, {}};
  for (int n = 0; n < 3; ++n) {
    Bytes pixels(2000 * 1000);
    for (int i = 0; i < 2000 * 1000; ++i) {
      const int x = i % 2000, y = i / 2000;
      const bool lit = x >= 800 && x < 1200 + n && y >= 300 && y < 700;
      pixels[static_cast<std::size_t>(i)] = lit ? 255 : 0;
    }
    images.slices.push_back(std::move(pixels));
  }
  for (const char* name : {"a.sl1", "a.zip", "a.uvj"}) {
    SCOPED_TRACE(name);
    const std::string path = folder / name;
    StackFile file(path);
    if (path.ends_with(".zip")) file.format = "generic";
    Bytes first;
    for (const int threads : {1, 2, 8}) {
      ExecutionContext context;
      context.threads = threads;
      test::write_stack(file, images, test::info_of(images.grid), context);
      if (threads == 1) first = test::read_file(path);
      EXPECT_EQ(test::read_file(path), first) << threads;
    }
    zip_t* const zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
    ASSERT_NE(zip, nullptr);
    zip_uint64_t sizes = 0, packed = 0;
    for (zip_int64_t i = 0; i < zip_get_num_entries(zip, 0); ++i) {
      zip_stat_t s;
      ASSERT_EQ(zip_stat_index(zip, static_cast<zip_uint64_t>(i), 0, &s), 0);
      const std::string entry = s.name;
      if (!entry.ends_with(".png") || s.size < 2000) continue;
      sizes += s.size;
      packed += s.comp_size;
      EXPECT_EQ(s.comp_method, path.ends_with(".uvj") ? ZIP_CM_STORE : ZIP_CM_DEFLATE) << entry;
    }
    zip_discard(zip);
    ASSERT_GT(sizes, 0U);
    if (!path.ends_with(".uvj")) {
      EXPECT_LT(packed, sizes / 2);
    }
    const StackReader reader(path, folder.path());
    EXPECT_EQ(test::read_images(reader), images.slices);
  }
}

TEST(Sl1, OtherTimesAndAddedSlicesChangeNothingButTheirNumbers) {
  const TemporaryFolder folder;
  const std::string path = folder / "part.sl1", out = folder / "out.sl1";
  Images images = six_images();
  images.slices.back().assign(images.slices.back().size(), 255);
  test::make_zip(path, foreign(images));
  const StackReader target(path, folder.path());
  slicecorr::Setup setup = setup_for(target.grid());
  setup.process = {};
  setup.process.speed_mm_h = 500;
  StackFile file(out);
  file.keep_from = path;
  correct_stack(target, setup, file, {});
  const StackInfo info = StackReader::read_info(out);
  ASSERT_GT(info.grid.layers, 6);
  Entries entries = test::unzip(out);
  // 0.1 mm at 500 mm/h are 0.72 s.
  std::string expected = kConfig;
  const auto replace = [&](const std::string& from, const std::string& to) {
    expected.replace(expected.find(from), from.size(), to);
  };
  replace("expTime = 3\n", "expTime = 0.72\n");
  replace("expTimeFirst = 20", "expTimeFirst = 0.72");
  replace("numFade = 10", "numFade = 2");
  replace("numFast = 4", "numFast = " + std::to_string(info.grid.layers - 2));
  EXPECT_EQ(test::to_text(test::entry(entries, "config.ini")), expected);
  expected = kSettings;
  replace("exposure_time = 3\n", "exposure_time = 0.72\n");
  replace("faded_layers = 10", "faded_layers = 2");
  replace("initial_exposure_time = 20", "initial_exposure_time = 0.72");
  EXPECT_EQ(test::to_text(test::entry(entries, "prusaslicer.ini")), expected);
  EXPECT_FALSE(test::entry(entries, name_of(info.grid.layers - 1)).empty());
}

TEST(Sl1, KindsOfImagesAreKept) {
  struct Kind {
    std::uint8_t depth, colour;
    std::vector<int> bytes;  ///< of a pixel: value (-1) or what is given
    bool kept;
  };
  const Kind kinds[] = {{8, 0, {-1}, true},
                        {8, 2, {-1, -1, -1}, true},
                        {8, 6, {-1, -1, -1, 255}, true},
                        {8, 4, {-1, 255}, true},
                        {16, 0, {-1, -1}, true},
                        {16, 6, {-1, -1, -1, -1, -1, -1, 255, 255}, true}};
  const Images images = six_images();
  for (const Kind& kind : kinds) {
    const TemporaryFolder folder;
    const std::string path = folder / "part.sl1";
    Entries entries = foreign(images);
    for (int n = 0; n < 6; ++n) {
      test::entry(entries, name_of(n)) =
          make_png(70, 30, kind.depth, kind.colour, [&](std::uint32_t y) {
            Bytes row;
            for (std::size_t x = 0; x < 70; ++x) {
              const std::uint8_t value = images.slices[static_cast<std::size_t>(n)][y * 70 + x];
              for (const int b : kind.bytes) {
                row.push_back(b < 0 ? value : static_cast<std::uint8_t>(b));
              }
            }
            return row;
          });
    }
    test::make_zip(path, entries);
    const StackReader target(path, folder.path());
    EXPECT_EQ(test::read_images(target), images.slices);
    StackFile file(folder / "out.sl1");
    file.keep_from = path;
    convert_stack(target, file);
    Entries after = test::unzip(file.path);
    const Bytes& png = test::entry(after, name_of(3));
    EXPECT_EQ(png[24], kind.depth);
    EXPECT_EQ(png[25], kind.colour);
    EXPECT_EQ(test::read_images(StackReader(file.path, folder.path())), images.slices);
  }
}

TEST(Sl1, OneBitImagesBecomeGreyAndThatIsTold) {
  const TemporaryFolder folder;
  const Images images = six_images();
  Entries entries = foreign(images);
  for (int n = 0; n < 6; ++n) {
    test::entry(entries, name_of(n)) =
        make_png(70, 30, 1, 0, [](std::uint32_t y) { return Bytes(9, y % 2 ? 0xf0 : 0x00); });
  }
  test::make_zip(folder / "part.sl1", entries);
  const StackReader target(folder / "part.sl1", folder.path());
  StackFile file(folder / "out.sl1");
  file.keep_from = folder / "part.sl1";
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  convert_stack(target, file, context);
  EXPECT_NE(told.find("fewer than 8 bits"), std::string::npos) << told;
  EXPECT_EQ(test::read_images(StackReader(file.path, folder.path())), test::read_images(target));
}

TEST(Sl1, NewArchivesReadBackTheSame) {
  const TemporaryFolder folder;
  const Images images = six_images();
  StackInfo info = test::info_of(images.grid);
  info.exposure_s = 2.5;
  info.bottom_exposure_s = 30;
  info.bottom_layers = 1;
  info.fade_layers = 3;
  info.orientation = {true, false, true};
  info.profiles = {"printer = x", "resin", "fine"};
  test::write_stack(folder / "new.sl1s", images, info);
  const StackReader reader(folder / "new.sl1s", folder.path());
  const StackInfo& now = reader.info();
  EXPECT_EQ(test::read_images(reader), images.slices);
  EXPECT_EQ(now.kind, StackKind::target);
  EXPECT_EQ(now.orientation, info.orientation);
  EXPECT_EQ(now.grid.pixel_x_um, info.grid.pixel_x_um);
  EXPECT_EQ(now.grid.pixel_y_um, info.grid.pixel_y_um);
  EXPECT_EQ(now.grid.layer_um, info.grid.layer_um);
  EXPECT_EQ(process_of_times(now), process_of_times(info));
  EXPECT_EQ(now.profiles.printer, info.profiles.printer);
  const Entries entries = test::unzip(folder / "new.sl1s");
  EXPECT_EQ(entries.front().first, "config.ini");
  EXPECT_EQ(entries[1].first, "prusaslicer.ini");
  EXPECT_EQ(entries[4].first, "new00000.png");
}

TEST(Sl1, DamagedArchivesAreNamedAndStay) {
  struct Damage {
    const char* what;
    void (*doit)(Entries&);
    std::vector<std::string> words;
  };
  const auto drop = [](Entries& e, const std::string& name) {
    std::erase_if(e, [&](const auto& entry) { return entry.first == name; });
  };
  static const auto dropped = drop;
  static const auto replaced = [](Entries& e, const char* entry, const std::string& from,
                                  const std::string& to) {
    std::string text = test::to_text(test::entry(e, entry));
    text.replace(text.find(from), from.size(), to);
    test::entry(e, entry) = to_bytes(text);
  };
  const Damage damages[] = {
      {"no images",
       [](Entries& e) {
         for (int n = 0; n < 6; ++n) dropped(e, name_of(n));
       },
       {"no layer images", "part00000.png"}},
      {"gap", [](Entries& e) { dropped(e, name_of(2)); }, {"part00003.png", "image 2 is missing"}},
      {"end missing",
       [](Entries& e) { dropped(e, name_of(5)); },
       {"part00005.png", "is missing", "6 layers"}},
      {"start missing",
       [](Entries& e) {
         dropped(e, name_of(0));
         dropped(e, name_of(1));
       },
       {"part00002.png", "missing"}},
      {"two prefixes",
       [](Entries& e) {
         for (auto& [name, data] : e)
           if (name == name_of(4)) name = "q00004.png";
         replaced(e, "config.ini", "jobDir = part", "jobDir = other");
       },
       {"jobDir", "other"}},
      {"exposure no number",
       [](Entries& e) { replaced(e, "config.ini", "expTime = 3", "expTime = 3s"); },
       {"config.ini", "expTime is 3s", "expected a number"}},
      {"negative fade",
       [](Entries& e) { replaced(e, "config.ini", "numFade = 10", "numFade = -1"); },
       {"numFade is -1"}},
      {"display of no size",
       [](Entries& e) {
         replaced(e, "prusaslicer.ini", "display_pixels_x = 30", "display_pixels_x = 0");
       },
       {"prusaslicer.ini", "display_pixels_x is 0"}},
      {"an image of another size",
       [](Entries& e) {
         test::entry(e, name_of(3)) =
             make_png(70, 29, 8, 0, [](std::uint32_t) { return Bytes(70); });
       },
       {"part00003.png", "70 x 29", "70 x 30"}},
      {"no PNG",
       [](Entries& e) { test::entry(e, name_of(3)) = to_bytes("GIF89a"); },
       {"part00003.png", "not a PNG"}},
      {"newer provenance",
       [](Entries& e) {
         e.push_back({"slicecorr.json", to_bytes("{\"format\": 99}")});
       },
       {"slicecorr.json", "newer version", "99"}},
      {"broken provenance",
       [](Entries& e) {
         e.push_back({"slicecorr.json", to_bytes("{")});
       },
       {"slicecorr.json", "not valid JSON"}},
  };
  for (const Damage& damage : damages) {
    const TemporaryFolder folder;
    const std::string path = folder / "part.sl1";
    Entries entries = foreign(six_images());
    damage.doit(entries);
    test::make_zip(path, entries);
    const Bytes before = test::read_file(path);
    try {
      const StackReader reader(path, folder.path());
      ADD_FAILURE() << damage.what << " was read";
    } catch (const InputError& error) {
      const std::string text = error.what();
      EXPECT_EQ(text.rfind(path, 0), 0u) << text;
      for (const std::string& word : damage.words) {
        EXPECT_NE(text.find(word), std::string::npos) << damage.what << ": " << text;
      }
    }
    EXPECT_EQ(test::read_file(path), before);
  }
}

TEST(Sl1, ArchivesOfOthers) {
  const std::string folder = test::real_file("slices/sl1") + "/";
  SLICECORR_NEEDS_FILE(folder);
  struct Sample {
    const char* file;
    int layers, width_px, height_px;
    double pixel_um, layer_um, light_s;
  };
  // Light: by the firmware's rule from the numbers in config.ini.
  const Sample samples[] = {
      {"UVtools_demo_file.sl1s", 10, 1620, 2560, 50, 100, 115},
      {"layer_change.sl1", 32, 1440, 2560, 47.25, 50, 3.2},
      {"numbers.sl1", 2, 1440, 2560, 47.25, 50, 2},
      // 35 s, 21.25 s, then 18 layers of 7.5 s.
      {"Resin_calibration_linear_object.sl1", 20, 1440, 2560, 47.25, 50, 35 + 21.25 + 18 * 7.5}};
  const TemporaryFolder scratch;
  for (const Sample& s : samples) {
    const StackReader reader(folder + s.file, scratch.path());
    const StackInfo& info = reader.info();
    EXPECT_EQ(info.grid.layers, s.layers) << s.file;
    EXPECT_EQ(info.grid.width_px, s.width_px) << s.file;
    EXPECT_EQ(info.grid.height_px, s.height_px) << s.file;
    EXPECT_DOUBLE_EQ(info.grid.pixel_x_um, s.pixel_um) << s.file;
    EXPECT_DOUBLE_EQ(info.grid.layer_um, s.layer_um) << s.file;
    EXPECT_NEAR(light_on_s(info), s.light_s, 1e-9) << s.file;
  }
  // Its volume, in mm3 to two digits.
  const StackReader demo(folder + "UVtools_demo_file.sl1s", scratch.path());
  EXPECT_NEAR(static_cast<double>(demo.pixel_sum()) / 255 * 50 * 50 * 100 * 1e-9, 1287.58, 0.005);
  for (const char* bad : {"test_corrupted.sl1", "test_nolayer.sl1"}) {
    EXPECT_THROW(StackReader(folder + bad, scratch.path()), InputError) << bad;
  }
}

}  // namespace
}  // namespace slicecorr
