// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <zlib.h>

#include <functional>

#include "rounds.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::Entries;
using test::Images;
using test::TemporaryFolder;

/// A small sound stack, its entries, and a place for damaged ones.
class Damage : public testing::Test {
 protected:
  Damage() {
    images_ = test::random_images(40, 50, 4, 21);
    StackInfo info = test::info_of(images_.grid);
    info.kind = StackKind::corrected;
    info.printer = Printer{"p", 40, 50, 50, 40.5, 8, 405, {{0, 0}, {255, 9}}, 0, 0, {}};
    info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 0, 0, 1, {}};
    info.process.emplace();
    info.process->speed_mm_h = 10;
    info.process->omega_max = 5;
    test::write_stack(folder_ / "sound.uvj", images_, info);
    entries_ = test::unzip(folder_ / "sound.uvj");
  }

  /// Must throw `InputError` whose message holds the file and `part`.
  void expect_refused(const std::string& path, const std::string& part = "") {
    try {
      const StackReader reader(path, folder_.path());
      FAIL() << "read, expected an error with: " << part;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(path), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
    }
  }

  void expect_entries_refused(const Entries& entries, const std::string& part,
                              bool deflate = false) {
    test::make_zip(folder_ / "bad.uvj", entries, deflate);
    expect_refused(folder_ / "bad.uvj", part);
  }

  /// `config.json` with one piece of text replaced.
  void expect_config_refused(const std::string& from, const std::string& to,
                             const std::string& part) {
    Entries entries = entries_;
    std::string text = test::to_text(test::entry(entries, "config.json"));
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    test::entry(entries, "config.json") = test::to_bytes(text);
    SCOPED_TRACE(to);
    expect_entries_refused(entries, part);
  }

  /// Reading damaged bytes either fails as promised or gives what was there before.
  bool survives(const Bytes& bytes, const std::vector<Bytes>& expected) {
    test::write_file(folder_ / "bad.uvj", bytes);
    try {
      const StackReader reader(folder_ / "bad.uvj", folder_.path());
      EXPECT_EQ(test::read_images(reader), expected);
      return true;
    } catch (const InputError&) {
      return false;
    }
  }

  TemporaryFolder folder_;
  Images images_;
  Entries entries_;
};

void append_chunk(Bytes& png, const std::string& type, const Bytes& data) {
  const auto put = [&](std::uint64_t v) {
    for (int shift = 24; shift >= 0; shift -= 8)
      png.push_back(static_cast<std::uint8_t>(v >> shift));
  };
  put(data.size());
  const std::size_t start = png.size();
  png.insert(png.end(), type.begin(), type.end());
  png.insert(png.end(), data.begin(), data.end());
  put(crc32(0, &png[start], static_cast<uInt>(png.size() - start)));
}

Bytes deflated(const Bytes& raw) {
  uLongf size = compressBound(raw.size());
  Bytes out(size);
  compress2(out.data(), &size, raw.data(), raw.size(), 6);
  out.resize(size);
  return out;
}

/// A PNG of 40 x 50 with correct chunk checksums around anything.
Bytes make_png(const Bytes& idat, Bytes header = {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 0},
               const std::function<void(Bytes&)>& before_data = nullptr) {
  Bytes png{0x89, 'P', 'N', 'G', 13, 10, 26, 10};
  append_chunk(png, "IHDR", header);
  if (before_data) before_data(png);
  append_chunk(png, "IDAT", idat);
  append_chunk(png, "IEND", {});
  return png;
}

TEST_F(Damage, TruncatedAtEveryLength) {
  const Bytes bytes = test::read_file(folder_ / "sound.uvj");
  EXPECT_TRUE(survives(bytes, images_.slices));
  for (std::size_t n = 0; n < bytes.size(); n += n < 200 || n + 200 > bytes.size() ? 1 : 37) {
    EXPECT_FALSE(survives(Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n)), {}))
        << n;
  }
}

TEST_F(Damage, EveryByteFlipped) {
  const Bytes bytes = test::read_file(folder_ / "sound.uvj");
  // By day every third: each bit of a byte in its turn, and one byte at least of each number.
  const std::size_t step = test::by_night() ? 1 : 3;
  std::size_t read = 0;
  for (std::size_t i = 0; i < bytes.size(); i += step) {
    Bytes bad = bytes;
    bad[i] ^= static_cast<std::uint8_t>(1u << i % 8);
    read += survives(bad, images_.slices) ? 1 : 0;
    if (HasFailure()) FAIL() << "byte " << i;
  }
  // Times, attributes and previews may change without harm; images may not.
  EXPECT_LT(read * step, 2000);
}

TEST_F(Damage, FlippedBytesInsideOfImages) {
  // The checksum of the zip is made anew, so that those of the PNG have to find it.
  const Bytes sound = test::entry(entries_, "slice/00000001.png");
  for (std::size_t i = 0; i < sound.size(); i += 3) {
    Entries entries = entries_;
    test::entry(entries, "slice/00000001.png")[i] ^= static_cast<std::uint8_t>(1u << i % 8);
    expect_entries_refused(entries, "slice/00000001.png");
    if (HasFailure()) FAIL() << "byte " << i;
  }
}

TEST_F(Damage, ReferenceArchive) {
  SLICECORR_NEEDS_FILE(test::reference_uvj());
  const Bytes bytes = test::read_file(test::reference_uvj());
  const auto sound = test::read_images(StackReader(test::reference_uvj(), folder_.path()));
  std::mt19937 random(1);
  for (int trial = 0; trial < (test::by_night() ? 150 : 6); ++trial) {
    const std::size_t at = random() % bytes.size();
    Bytes bad = bytes;
    bad[at] ^= static_cast<std::uint8_t>(1 + random() % 255);
    survives(bad, sound);
    EXPECT_FALSE(
        survives(Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(at)), {}));
    if (HasFailure()) FAIL() << "byte " << at;
  }
}

TEST_F(Damage, FilesThatAreNoArchive) {
  expect_refused(folder_ / "none.uvj", "No such file");
  expect_refused("/dev/null", "not a file");
  test::write_file(folder_ / "bad.uvj", {});
  expect_refused(folder_ / "bad.uvj", "zip");
  test::write_file(folder_ / "bad.uvj", test::to_bytes("solid cube"));
  expect_refused(folder_ / "bad.uvj", "zip");
}

TEST_F(Damage, SlicesMissingExtraAndMisnamed) {
  const auto without = [&](const std::string& name) {
    Entries entries = entries_;
    std::erase_if(entries, [&](const auto& e) { return e.first == name; });
    return entries;
  };
  const auto with = [&](const std::string& name) {
    Entries entries = entries_;
    entries.emplace_back(name, test::entry(entries, "slice/00000000.png"));
    return entries;
  };
  expect_entries_refused(without("config.json"), "config.json: is missing");
  expect_entries_refused(without("slice/00000000.png"), "slice/00000000.png: is missing");
  expect_entries_refused(without("slice/00000002.png"), "slice/00000002.png: is missing");
  expect_entries_refused(without("slice/00000003.png"), "slice/00000003.png: is missing");
  expect_entries_refused(with("slice/00000004.png"), "too many");
  for (const std::string name : {"slice/4.png", "slice/000000004.png", "slice/00000004.PNG",
                                 "slice/0000000x.png", "slice/notes.txt", "slice/00000001.png.bak",
                                 "slice/sub/00000004.png", "slice/-0000001.png"}) {
    SCOPED_TRACE(name);
    expect_entries_refused(with(name), "slice/");
  }
  for (const std::string name :
       {"../a", "a/../b", "a/..", "/etc/passwd", "a\\b", "C:/a", "..", "..\\a"}) {
    SCOPED_TRACE(name);
    expect_entries_refused(with(name), "name");
  }
  // What is not ours does no harm, nor does a preview that is missing.
  Entries more = without("preview/tiny.png");
  for (const auto& name : {"notes.txt", "a..b/..c", "slice/", "uv/00000000.png"}) {
    more.emplace_back(name, Bytes{});
  }
  test::make_zip(folder_ / "good.uvj", more, true);
  EXPECT_EQ(test::read_images(StackReader(folder_ / "good.uvj", folder_.path())), images_.slices);
}

TEST_F(Damage, DoubledEntries) {
  // The zip library makes no doubled names, so one is renamed behind its back.
  Bytes bytes = test::read_file(folder_ / "sound.uvj");
  const std::string from = "slice/00000002.png";
  int renamed = 0;
  for (auto at = bytes.begin();; ++renamed) {
    at = std::search(at, bytes.end(), from.begin(), from.end());
    if (at == bytes.end()) break;
    at[13] = '1';
  }
  EXPECT_EQ(renamed, 2);
  test::write_file(folder_ / "bad.uvj", bytes);
  expect_refused(folder_ / "bad.uvj", "");
}

TEST_F(Damage, ConfigValues) {
  expect_config_refused("{", "", "JSON");
  expect_config_refused("\"X\": 40", "\"X\": 0", "Properties.Size.X is 0, expected a whole number");
  expect_config_refused("\"X\": 40", "\"X\": 65537", "65536");
  expect_config_refused("\"X\": 40", "\"X\": 40.5", "whole");
  expect_config_refused("\"X\": 40", "\"X\": -40", "whole");
  expect_config_refused("\"X\": 40", "\"X\": \"40\"", "whole");
  expect_config_refused("\"X\": 40", "\"X\": null", "whole");
  expect_config_refused("\"X\": 40", "\"X\": [40]", "a list");
  expect_config_refused("\"X\": 40", "\"X\": NaN", "JSON");
  expect_config_refused("\"X\": 40", "\"X\": 1e999", "JSON");
  expect_config_refused("\"X\": 40", "\"x\": 40", "Properties.Size.X is missing");
  expect_config_refused("\"X\": 40", "\"X\": 41", "48.780488 um in the archive");
  expect_config_refused("\"X\": 40", "\"X\": \"\xff\"", "JSON");
  expect_config_refused("\"X\": 2.0", "\"X\": 0", "above 0");
  expect_config_refused("\"X\": 2.0", "\"X\": 1e9", "1000 um");
  expect_config_refused("\"X\": 2.0", "\"X\": 1e-9", "1 to");
  expect_config_refused("\"Layers\": 4", "\"Layers\": 0", "whole");
  expect_config_refused("\"Layers\": 4", "\"Layers\": 1000001", "1000000");
  expect_config_refused("\"Layers\": 4", "\"Layers\": 5", "slice/00000004.png: is missing");
  expect_config_refused("\"Layers\": 4", "\"Layers\": 3", "too many");
  expect_config_refused("\"LayerHeight\": 0.0333", "\"LayerHeight\": -0.0333", "above 0");
  expect_config_refused("\"LayerHeight\": 0.0333", "\"LayerHeight\": 1.1e0, \"a\": 0.0333",
                        "1000 um");
  expect_config_refused("\"LightOnTime\": ", "\"LightOnTime\": -", "LightOnTime");
  expect_config_refused("\"Properties\": {", "\"Properties\": 5, \"P\": {", "an object");
  expect_config_refused("\"Layers\": [", "\"Layers\": 7, \"L\": [", "Layers is 7");
  expect_config_refused("\"format\": 1", "\"format\": 16",
                        "newer version of this program: format 16, this program reads up to 15");
  // What the second version has besides must be there.
  expect_config_refused("\"format\": 1", "\"format\": 2", "process.exposure_s is missing");
  expect_config_refused("\"format\": 1", "\"format\": 0", "format");
  expect_config_refused("\"kind\": \"corrected\"", "\"kind\": \"mystery\"", "\"target\" or");
  expect_config_refused("\"mode\": \"continuous\"", "\"mode\": \"stepped\"", "continuous");
  expect_config_refused("\"printer\"", "\"printers\"", "slicecorr.printer is missing");
  expect_config_refused("\"bit_depth\": 8", "\"bit_depth\": 9", "bit_depth");
  expect_config_refused("\"level\": 255", "\"level\": 254", "level 255");
  expect_config_refused("\"m\": 1.0", "\"m\": 0", "resin.m");
  expect_config_refused("\"speed_mm_h\": 10.0", "\"speed_mm_h\": \"fast\"", "speed_mm_h");
  expect_config_refused("\"omega_max\": 5.0", "\"omega_max\": 0.5", "omega_max");
  expect_config_refused("\"images_crc32\": ", "\"images_crc32\": -", "images_crc32");
  expect_config_refused("\"slicecorr\": {", "\"slicecorr\": [1], \"s\": {", "slicecorr is a list");
  Entries entries = entries_;
  test::entry(entries, "config.json") = Bytes(1 << 20, '[');
  expect_entries_refused(entries, "JSON");
  test::entry(entries, "config.json") = {};
  expect_entries_refused(entries, "JSON");
  test::entry(entries, "config.json") = Bytes((64 << 20) + 100000, ' ');
  expect_entries_refused(entries, "expected at most", true);
}

TEST_F(Damage, ImagesThatLie) {
  const Bytes raw(41 * 50), good = deflated(raw);
  const auto refuse = [&](const Bytes& png, const std::string& part) {
    Entries entries = entries_;
    test::entry(entries, "slice/00000002.png") = png;
    SCOPED_TRACE(part);
    expect_entries_refused(entries, part);
  };
  EXPECT_EQ(decode_png(make_png(good), 40, 50, "f", "i").pixels, Bytes(2000));
  refuse({}, "not a PNG");
  refuse(test::to_bytes("P5 40 50 255"), "not a PNG");
  refuse(encode_png({41, 50, Bytes(2050)}), "41 x 50 pixels, expected 40 x 50");
  refuse(encode_png({50, 40, Bytes(2000)}), "50 x 40");
  refuse(make_png(deflated(Bytes(41 * 50 - 1))), "end too early");
  refuse(make_png(deflated(Bytes(41 * 50 + 1))), "more data");
  refuse(make_png(deflated(Bytes(50 << 20))), "more data");
  Bytes bad = good;
  bad.back() ^= 1;
  refuse(make_png(bad), "damaged");
  bad = good;
  bad.push_back(0);
  refuse(make_png(bad), "behind");
  bad = good;
  bad.pop_back();
  refuse(make_png(bad), "early");
  bad = good;
  bad[0] ^= 1;
  refuse(make_png(bad), "damaged");
  refuse(make_png({}), "too little data");
  bad = raw;
  bad[41 * 7] = 5;
  refuse(make_png(deflated(bad)), "row 7 of the PNG has the unknown filter 5");
  for (const Bytes& format : {Bytes{8, 1, 0, 0, 0}, Bytes{3, 0, 0, 0, 0}, Bytes{16, 3, 0, 0, 0},
                              Bytes{8, 0, 1, 0, 0}, Bytes{8, 0, 0, 1, 0}, Bytes{8, 0, 0, 0, 2}}) {
    Bytes header{0, 0, 0, 40, 0, 0, 0, 50};
    header.insert(header.end(), format.begin(), format.end());
    refuse(make_png(good, header), "format");
  }
  const Bytes palette{0, 0, 0, 40, 0, 0, 0, 50, 8, 3, 0, 0, 0};
  refuse(make_png(good, palette), "no palette");
  refuse(make_png(good, palette, [](Bytes& png) { append_chunk(png, "PLTE", {1, 2}); }), "palette");
  const Bytes rgb{0, 0, 0, 40, 0, 0, 0, 50, 8, 2, 0, 0, 0};
  refuse(make_png(good, rgb), "early");
  refuse(make_png(deflated(Bytes(121 * 50, 6)), rgb), "unknown filter 6");
  refuse(make_png(good, {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 1}), "early");
  // Interlaced data that fit, with an unknown filter.
  refuse(make_png(deflated(Bytes(2000 + 7 + 7 + 6 + 13 + 12 + 25 + 25, 9)),
                  {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 1}),
         "unknown filter 9");
  refuse(make_png(good, {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 0},
                  [](Bytes& png) { append_chunk(png, "CRIT", {}); }),
         "unknown kind");
  bad = make_png(good);
  bad.push_back(0);
  refuse(bad, "behind its end");
  bad.resize(bad.size() - 13);
  refuse(bad, "end chunk is missing");
  // Interlaced images are decoded: all pixels 64 in the seven passes.
  Bytes passes;
  for (const auto& [w, h] :
       {std::pair(5, 7), {5, 7}, {10, 6}, {10, 13}, {20, 12}, {20, 25}, {40, 25}}) {
    for (int y = 0; y < h; ++y) {
      passes.push_back(0);
      passes.insert(passes.end(), static_cast<std::size_t>(w), 64);
    }
  }
  const Bytes woven = make_png(deflated(passes), {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 1});
  EXPECT_EQ(decode_png(woven, 40, 50, "f", "i").pixels, Bytes(2000, 64));
  // A grey key and chunks that don't matter are fine.
  const Bytes keyed = make_png(deflated(Bytes(41 * 50, 0)),
                               {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 0}, [](Bytes& png) {
                                 append_chunk(png, "tRNS", {0, 0});
                               });
  EXPECT_EQ(decode_png(keyed, 40, 50, "f", "i").pixels, Bytes(2000));
  const Bytes noted = make_png(good, {0, 0, 0, 40, 0, 0, 0, 50, 8, 0, 0, 0, 0},
                               [](Bytes& png) { append_chunk(png, "gAMA", {1}); });
  EXPECT_EQ(decode_png(noted, 40, 50, "f", "i").pixels, Bytes(2000));
}

TEST_F(Damage, Bombs) {
  Entries entries = entries_;
  test::entry(entries, "slice/00000003.png") = Bytes(40 << 20, 0);
  expect_entries_refused(entries, "expected at most", true);
  expect_entries_refused(entries, "expected at most", false);
  // A huge image in few bytes is refused before memory for it is taken.
  entries = {{"config.json", test::to_bytes(R"({"Properties":{"Size":{"X":31000,"Y":31000,
      "Millimeter":{"X":1550,"Y":1550},"Layers":1,"LayerHeight":0.05}}})")},
             {"slice/00000000.png", make_png(deflated(Bytes(1000)),
                                             {0, 0, 0x79, 0x18, 0, 0, 0x79, 0x18, 8, 0, 0, 0, 0})}};
  expect_entries_refused(entries, "too little data");
  test::entry(entries, "config.json") =
      test::to_bytes(R"({"Properties":{"Size":{"X":65536,"Y":65536,
      "Millimeter":{"X":3276,"Y":3276},"Layers":1,"LayerHeight":0.05}}})");
  expect_entries_refused(entries, "1000000000 pixels");
}

TEST_F(Damage, ChangedImagesAreANoticeOnly) {
  std::vector<std::string> notices;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { notices.push_back(text); };
  (void)StackReader(folder_ / "sound.uvj", folder_.path(), context);
  EXPECT_TRUE(notices.empty());
  Entries entries = entries_;
  test::entry(entries, "slice/00000003.png") = encode_png({40, 50, Bytes(2000, 77)});
  test::make_zip(folder_ / "changed.uvj", entries);
  const StackReader reader(folder_ / "changed.uvj", folder_.path(), context);
  EXPECT_EQ(test::read_images(reader)[3], Bytes(2000, 77));
  ASSERT_EQ(notices.size(), 1u);
  EXPECT_NE(notices[0].find("images were changed"), std::string::npos);
}

}  // namespace
}  // namespace slicecorr
