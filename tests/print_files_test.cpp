// Binary print files: codes, small files of every kind, real ones.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "print_file_fixture.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::test {

void PrintTo(const SmallFile& file, std::ostream* out) { *out << file.name; }

namespace {

using detail::LayerCodecPtr;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

// ---- codes ------------------------------------------------------------------------------------

struct NamedCode {
  const char* name;
  std::function<LayerCodecPtr(int, int)> make;
  int levels;
};
void PrintTo(const NamedCode& code, std::ostream* out) { *out << code.name; }

const NamedCode kCodes[] = {
    {"ctb", [](int w, int h) { return detail::ctb_code(w, h, 0); }, 128},
    {"ctb_ciphered", [](int w, int h) { return detail::ctb_code(w, h, 0xdccff65e); }, 128},
    {"photon", [](int w, int h) { return detail::bit_sets_code(w, h, 1, false); }, 2},
    {"photon_8", [](int w, int h) { return detail::bit_sets_code(w, h, 8, false); }, 9},
    {"pws", [](int w, int h) { return detail::bit_sets_code(w, h, 4, true); }, 5},
    {"phz", [](int w, int h) { return detail::phz_code(w, h, 77777, detail::PhzCipher::phz); },
     125},
    {"fdg", [](int w, int h) { return detail::phz_code(w, h, 77777, detail::PhzCipher::fdg); },
     125},
    {"goo", [](int w, int h) { return detail::goo_code(w, h, false); }, 256},
    {"goo_16", [](int w, int h) { return detail::goo_code(w, h, true); }, 16},
    {"pw0", [](int w, int h) { return detail::pw0_code(w, h, false); }, 16},
    {"pw0_2", [](int w, int h) { return detail::pw0_code(w, h, true); }, 2},
    {"lgs", [](int w, int h) { return detail::lgs_code(w, h); }, 16},
    {"cxdlp", [](int w, int h) { return detail::cxdlp_code(w, h); }, 256},
};

class LayerCodes : public testing::TestWithParam<NamedCode> {};
INSTANTIATE_TEST_SUITE_P(Print, LayerCodes, testing::ValuesIn(kCodes),
                         [](const auto& info) { return std::string(info.param.name); });

const std::string kFile = "part.bin";

TEST_P(LayerCodes, HasItsLevelsAndKeepsThem) {
  const LayerCodecPtr codec = GetParam().make(8, 8);
  EXPECT_EQ(detail::levels_of(codec->shown()), GetParam().levels);
  EXPECT_EQ(codec->shown()[0], 0);
  EXPECT_EQ(codec->shown()[255], 255);
  for (const std::uint8_t v : codec->shown()) EXPECT_EQ(codec->shown()[v], v);
  for (int v = 1; v < 256; ++v) {
    EXPECT_LE(codec->shown()[static_cast<std::size_t>(v) - 1],
              codec->shown()[static_cast<std::size_t>(v)]);
  }
}

TEST_P(LayerCodes, ThereAndBackIsTheSame) {
  const int count = rounds(20);
  for (int round = 0; round < count; ++round) {
    std::mt19937 random(static_cast<unsigned>(round));
    const int width = 1 + static_cast<int>(random() % 90),
              height = 1 + static_cast<int>(random() % 70);
    const LayerCodecPtr codec = GetParam().make(width, height);
    for (int n = 0; const Bytes& image : random_images(width, height, 3, random()).slices) {
      Bytes pixels = image, back(image.size(), 7);
      for (std::uint8_t& v : pixels) v = codec->shown()[v];
      const std::vector<Bytes> pieces = coded(*codec, n, pixels);
      EXPECT_EQ(codec->decode(pieces, back.data(), {kFile, n}), 0u);
      ASSERT_EQ(back, pixels) << "round " << round;
      ++n;
    }
  }
}

/// Runs longer than any length of the code, and of all lengths around powers of two.
TEST_P(LayerCodes, LongRuns) {
  for (const int side : {125, 128, 512, 2047, 4097}) {
    const LayerCodecPtr codec = GetParam().make(side, 1100);
    Bytes pixels(codec->pixel_count(), codec->shown()[128]), back(pixels.size());
    for (const std::uint8_t value : {0, 255, 200}) {
      std::fill(pixels.begin(), pixels.end() - 3, codec->shown()[value]);
      const std::vector<Bytes> pieces = coded(*codec, 3, pixels);
      EXPECT_EQ(codec->decode(pieces, back.data(), {kFile, 3}), 0u);
      EXPECT_EQ(back, pixels);
    }
  }
}

/// Whatever bytes come: an image, or a refusal that names file and layer. Never a byte beyond.
TEST_P(LayerCodes, DamagedBytesAreRefusedOrGiveAnImage) {
  const LayerCodecPtr codec = GetParam().make(31, 17);
  const int count = rounds(400);
  std::mt19937 random(11);
  const Images images = random_images(31, 17, 4, 2);
  Bytes pixels(codec->pixel_count());
  for (int round = 0; round < count; ++round) {
    Bytes image = images.slices[static_cast<std::size_t>(round % 4)];
    for (std::uint8_t& v : image) v = codec->shown()[v];
    std::vector<Bytes> pieces = coded(*codec, 0, image);
    Bytes& piece = pieces[random() % pieces.size()];
    for (unsigned hits = 1 + random() % 4; hits > 0 && !piece.empty(); --hits) {
      switch (random() % 3) {
        case 0:
          piece[random() % piece.size()] = static_cast<std::uint8_t>(random());
          break;
        case 1:
          piece.resize(random() % piece.size());
          break;
        default:
          piece.insert(piece.begin() + static_cast<std::ptrdiff_t>(random() % piece.size()),
                       static_cast<std::uint8_t>(random()));
      }
    }
    // In memory of its own size, so that a byte beyond is one beyond the heap's block.
    for (Bytes& p : pieces) p.shrink_to_fit();
    try {
      codec->decode(pieces, pixels.data(), {kFile, 5});
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("part.bin: layer 5: "));
    }
  }
}

// ---- small files ------------------------------------------------------------------------------

class SmallPrintFiles : public testing::TestWithParam<SmallFile> {
 protected:
  SmallPrintFiles() : path_(folder_ / GetParam().name) { write_file(path_, GetParam().bytes); }
  StackReader reader(ExecutionContext context = {}) const {
    return {path_, folder_.path(), context};
  }
  TemporaryFolder folder_;
  std::string path_;
};
INSTANTIATE_TEST_SUITE_P(Print, SmallPrintFiles, testing::ValuesIn(small_print_files()),
                         [](const auto& info) { return name_of(info.param.name); });

TEST_P(SmallPrintFiles, AreRead) {
  const StackReader r = reader();
  EXPECT_EQ(r.info().format, GetParam().format);
  EXPECT_EQ(r.info().kind, StackKind::foreign);
  EXPECT_EQ(r.grid().layers, kFileLayers);
  EXPECT_NEAR(r.grid().pixel_x_um, 50, 1e-3);
  EXPECT_NEAR(r.grid().pixel_y_um, 50, 1e-3);
  EXPECT_NEAR(r.grid().layer_um, 50, 1e-3);
  EXPECT_EQ(read_images(r), GetParam().slices);
  EXPECT_GT(r.info().exposure_s, 0);
  EXPECT_GT(r.info().bottom_layers, 0);
}

TEST_P(SmallPrintFiles, RewrittenWithoutAChangeTheyAreTheSameBytes) {
  const std::string out = folder_ / ("out_" + GetParam().name);
  StackFile file(out);
  file.keep_from = path_;
  convert_stack(reader(), file, {});
  EXPECT_EQ(read_file(out), GetParam().bytes);
}

Images changed_images(const StackReader& r, int layers) {
  Images images{r.grid(), read_images(r)};
  images.grid.layers = layers;
  // One pixel of one layer, and what is added.
  images.slices[2][5 * kFileWidth + 7] = images.slices[2][5 * kFileWidth + 7] > 0 ? 0 : 255;
  images.slices.resize(static_cast<std::size_t>(layers), images.slices.back());
  return images;
}

TEST_P(SmallPrintFiles, ChangedImagesAndMoreLayersAreReadBack) {
  for (const int layers : {kFileLayers, kFileLayers + 3, kFileLayers - 1}) {
    const std::string out = folder_ / ("out_" + GetParam().name);
    const StackReader r = reader();
    const Images images = changed_images(r, layers);
    StackFile file(out);
    file.keep_from = path_;
    StackInfo info = r.info();
    info.grid.layers = info.target_layers = layers;
    write_stack(file, images, info);
    const StackReader back(out, folder_.path());
    EXPECT_EQ(read_images(back), images.slices) << layers;
    EXPECT_EQ(back.info().exposure_s, r.info().exposure_s);
    EXPECT_EQ(back.info().bottom_layers, r.info().bottom_layers);
    EXPECT_EQ(back.info().layer_exposure_s, r.info().layer_exposure_s);
    // And the same file again from the changed one.
    StackFile again(folder_ / ("again_" + GetParam().name));
    again.keep_from = out;
    convert_stack(back, again, {});
    EXPECT_EQ(read_file(again.path), read_file(out));
  }
}

TEST_P(SmallPrintFiles, ExposuresAreChangedWhereTheyAreAskedFor) {
  const StackReader r = reader();
  StackInfo info = r.info();
  info.exposure_s = 3;
  info.bottom_exposure_s = 50;
  info.bottom_layers = 3;
  info.fade_layers = 0;
  info.layer_exposure_s.clear();
  StackFile file(folder_ / ("out_" + GetParam().name));
  file.keep_from = path_;
  write_stack(file, {r.grid(), read_images(r)}, info);
  const StackReader back(file.path, folder_.path());
  EXPECT_NEAR(back.info().exposure_s, 3, 1e-6);
  EXPECT_NEAR(back.info().bottom_exposure_s, 50, 1e-6);
  EXPECT_EQ(back.info().bottom_layers, 3);
  EXPECT_TRUE(back.info().layer_exposure_s.empty());
  EXPECT_EQ(read_images(back), GetParam().slices);
}

/// The record lies beside, and counts for the file that it is of.
TEST_P(SmallPrintFiles, ARecordBesideIsBelievedOnlyOfItsOwnFile) {
  const StackReader r = reader();
  StackFile file(folder_ / ("out_" + GetParam().name));
  file.keep_from = path_;
  StackInfo info = r.info();
  info.kind = StackKind::target;
  write_stack(file, {r.grid(), read_images(r)}, info);
  ASSERT_TRUE(std::filesystem::exists(record_beside(file.path)));
  EXPECT_EQ(StackReader::read_info(file.path).kind, StackKind::target);
  EXPECT_EQ(StackReader(file.path, folder_.path()).images_changed(), false);
  // Exported anew, with another layer.
  StackFile other(folder_ / ("other_" + GetParam().name));
  other.keep_from = path_;
  StackInfo foreign = r.info();
  write_stack(other, changed_images(r, kFileLayers), foreign);
  EXPECT_FALSE(std::filesystem::exists(record_beside(other.path)));
  std::filesystem::copy_file(other.path, file.path,
                             std::filesystem::copy_options::overwrite_existing);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  EXPECT_EQ(StackReader(file.path, folder_.path(), context).info().kind, StackKind::foreign);
  EXPECT_THAT(told, HasSubstr("is of another file"));
  // Renamed, a file takes its record along, and one of the old file goes.
  rename_with_record(other.path, file.path);
  EXPECT_FALSE(std::filesystem::exists(record_beside(file.path)));
}

/// The same bytes for any damage: read, or refused with the file's name. No crash, no hang.
TEST_P(SmallPrintFiles, RandomDamageIsRefusedOrRead) {
  const int count = rounds(150);
  std::mt19937 random(3);
  const std::string path = folder_ / ("damaged_" + GetParam().name);
  // Most of GOO and CXDLP are previews: damage is wanted elsewhere.
  std::vector<std::size_t> places;
  const Bytes& sound = GetParam().bytes;
  for (std::size_t i = 0; i < sound.size(); ++i) {
    if (i < 256 || sound[i] != 0 || (i > 0 && sound[i - 1] != 0)) places.push_back(i);
  }
  for (int round = 0; round < count; ++round) {
    Bytes bytes = sound;
    if (random() % 8 == 0) bytes.resize(random() % bytes.size());
    for (unsigned hits = 1 + random() % 3; hits > 0; --hits) {
      const std::size_t at = places[random() % places.size()];
      if (at >= bytes.size()) continue;
      constexpr std::uint8_t values[] = {0, 1, 0x7f, 0x80, 0xff};
      bytes[at] = random() % 2 ? values[random() % 5] : static_cast<std::uint8_t>(random());
    }
    write_file(path, bytes);
    try {
      StackReader(path, folder_.path(), {}, {50, 50, 50});
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(path));
    }
  }
}

// ---- what is refused ---------------------------------------------------------------------------

class PrintFileRefusals : public testing::Test {
 protected:
  /// The message for a small file, changed by `damage`.
  std::string refusal(const SmallFile& file, const std::function<void(FileMaker&)>& damage,
                      bool big = false) {
    FileMaker m(big);
    m.bytes = file.bytes;
    damage(m);
    write_file(folder_ / file.name, m.bytes);
    try {
      StackReader(folder_ / file.name, folder_.path());
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(folder_ / file.name));
      return e.what();
    }
    return "read";
  }
  TemporaryFolder folder_;
};

TEST_F(PrintFileRefusals, OfCtb) {
  const SmallFile ctb = small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0));
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, ctb.bytes.data() + at, 4);
    return v;
  };
  const std::size_t table = u32(0x40), layer = u32(table + 0x0c);
  const auto with = [&](std::size_t at, std::uint32_t value) {
    return refusal(ctb, [&](FileMaker& m) { m.set_u32(at, value); });
  };
  EXPECT_THAT(with(4, 9), HasSubstr("version 9"));
  EXPECT_THAT(with(0x34, 0), HasSubstr("0 x 30 pixels"));
  EXPECT_THAT(with(0x34, 40000), HasSubstr("40000 x 30"));
  EXPECT_THAT(with(0x44, 0), HasSubstr("0 layers"));
  EXPECT_THAT(with(0x44, 70000), HasSubstr("70000 layers"));
  EXPECT_THAT(with(0x44, 60000), HasSubstr("layer table"));
  EXPECT_THAT(with(0x40, 0x7fffffff), HasSubstr("the file ends"));
  EXPECT_THAT(with(0x24, 0x7fc00000), HasSubstr("exposure is nan"));
  EXPECT_THAT(with(0x24, 0xbf800000), HasSubstr("exposure is -1"));
  EXPECT_THAT(with(0x70, 100000), HasSubstr("preview"));
  EXPECT_THAT(with(table + 0x0c, 0x7fffffff), HasSubstr("the file ends"));
  EXPECT_THAT(with(table + 0x14, 1), HasSubstr("the file ends"));
  EXPECT_THAT(with(table + 0x10, 0), HasSubstr("no data"));
  EXPECT_THAT(with(table + 0x10, u32(table + 0x10) + 1), HasSubstr("not the copy of record 0"));
  EXPECT_THAT(with(table + 0x18, 0x55), HasSubstr("expected 54h"));
  EXPECT_THAT(with(table + 0x24, u32(table)), HasSubstr("not above the one before it"));
  EXPECT_THAT(with(layer - 0x54, 0), HasSubstr("not the copy"));
  EXPECT_THAT(refusal(ctb, [&](FileMaker& m) { m.bytes[layer + 1] = 0xf1; }), HasSubstr("byte F0"));
  EXPECT_THAT(refusal(ctb, [&](FileMaker& m) { m.bytes[layer + 2] = 0xff; }),
              AnyOf(HasSubstr("beyond the image"), HasSubstr("code ends after")));
  EXPECT_THAT(with(u32(0x68) + 0x20, 300), HasSubstr("at most 256"));
  EXPECT_THAT(with(0, 0x12fd0107), HasSubstr("encrypted .ctb"));
}

TEST_F(PrintFileRefusals, OfPhoton) {
  const SmallFile photon = small_photon(4);
  const auto with = [&](std::size_t at, std::uint32_t value) {
    return refusal(photon, [&](FileMaker& m) { m.set_u32(at, value); });
  };
  EXPECT_THAT(with(0x5c, 0), HasSubstr("0 sets"));
  EXPECT_THAT(with(0x5c, 65), HasSubstr("65 sets"));
  EXPECT_THAT(with(0x5c, 60), HasSubstr("layer table"));
  EXPECT_THAT(with(0x64, 5), HasSubstr("ciphered"));
  // The first layer's data one byte further on than they are, into the next one's.
  std::uint32_t offset;
  std::memcpy(&offset, photon.bytes.data() + 0xac + 0x0c, 4);
  EXPECT_THAT(with(0xac + 0x0c, offset + 1), HasSubstr("overlaps"));
}

TEST_F(PrintFileRefusals, OfGoo) {
  const SmallFile goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  const auto byte = [&](std::size_t at, std::uint8_t value) {
    return refusal(
        goo, [&](FileMaker& m) { m.bytes[at] = value; }, true);
  };
  constexpr std::size_t first = 0x2fb95, data = first + 0x46;
  EXPECT_THAT(byte(0x2fb8e, 0x70), HasSubstr("little-endian"));
  EXPECT_THAT(byte(first + 0x40, 0), HasSubstr("0D 0A"));
  EXPECT_THAT(byte(data, 0x54), HasSubstr("55h"));
  EXPECT_THAT(byte(data + 1, 0xc1), HasSubstr("check byte"));
  EXPECT_THAT(byte(goo.bytes.size() - 1, 1), HasSubstr("end mark"));
  EXPECT_THAT(byte(first + 0x42, 0x70), HasSubstr("the file ends"));
}

TEST_F(PrintFileRefusals, OfWorkshop) {
  const SmallFile pwmx = small_workshop(false);
  const auto with = [&](std::size_t at, std::uint32_t value) {
    return refusal(pwmx, [&](FileMaker& m) { m.set_u32(at, value); });
  };
  EXPECT_THAT(with(0x0c, 519), HasSubstr("version 519"));
  EXPECT_THAT(with(0x24, 0), HasSubstr("no table LAYERDEF"));
  EXPECT_THAT(with(0x24, 0x20), HasSubstr("expected the name LAYERDEF"));
  std::uint32_t colours;
  std::memcpy(&colours, pwmx.bytes.data() + 0x20, 4);
  EXPECT_THAT(with(colours + 4, 15), HasSubstr("expected 16"));
  std::uint32_t layers;
  std::memcpy(&layers, pwmx.bytes.data() + 0x24, 4);
  EXPECT_THAT(with(layers + 0x10, 3), HasSubstr("for 3 layers"));
  EXPECT_THAT(with(layers + 0x14 + 0x14, 0), HasSubstr("0 mm thick"));
  EXPECT_THAT(with(layers + 0x14 + 4, 0), HasSubstr("no data"));
}

TEST_F(PrintFileRefusals, OfCxdlp) {
  const SmallFile cxdlp = small_cxdlp(3);
  const auto byte = [&](std::size_t at, std::uint8_t value) {
    return refusal(
        cxdlp, [&](FileMaker& m) { m.bytes[at] = value; }, true);
  };
  EXPECT_THAT(byte(cxdlp.bytes.size() - 1, cxdlp.bytes.back() ^ 1), HasSubstr("checksum"));
  EXPECT_THAT(byte(300, 5), HasSubstr("checksum"));
  EXPECT_THAT(byte(14, 4), HasSubstr("version 4"));
  EXPECT_THAT(refusal(cxdlp, [](FileMaker& m) { m.u8(0); }), HasSubstr("1 bytes follow"));
}

TEST_F(PrintFileRefusals, WhatIsClosedIsToldWithWhatWorksInstead) {
  write_file(folder_ / "a.ctb", {0x07, 0x01, 0xfd, 0x12, 4, 0, 0, 0});
  write_file(folder_ / "b.form", to_bytes("whatever it starts with"));
  for (const char* name : {"a.ctb", "b.form"}) {
    try {
      StackReader(folder_ / name, folder_.path());
      ADD_FAILURE() << name;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("encrypted"));
      EXPECT_THAT(e.what(), HasSubstr(".goo"));
    }
  }
}

TEST_F(PrintFileRefusals, CorrectionsWithMoreLevelsThanAFileHas) {
  Printer printer;
  printer.name = "eight";
  printer.bit_depth = 8;
  printer.calibration = {{0, 0}, {255, 10}};
  const auto fitted = [&](const SmallFile& small, std::string* told = nullptr) {
    write_file(folder_ / small.name, small.bytes);
    StackFile file(folder_ / ("out" + small.name.substr(small.name.rfind('.'))));
    file.format = small.format;
    file.keep_from = folder_ / small.name;
    ExecutionContext context;
    context.notice = [&](const std::string& text) {
      if (told) *told += text;
    };
    return printer_for_file(printer, file, {kFileWidth, kFileHeight, 1, 50, 50, 50}, context);
  };
  std::string told;
  EXPECT_EQ(fitted(small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false)), &told),
            printer);
  EXPECT_EQ(told, "");
  const Printer ctb =
      fitted(small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0)), &told);
  EXPECT_EQ(ctb.bit_depth, 7);
  EXPECT_THAT(told, HasSubstr("holds 128 grey levels"));
  ASSERT_EQ(ctb.calibration.size(), 128u);
  // The file shows level 64 as 129 of 255.
  EXPECT_NEAR(ctb.calibration[64].intensity_mw_cm2, 10 * 129 / 255.0, 1e-12);
  EXPECT_EQ(fitted(small_lgs()).bit_depth, 4);
  // Five levels: four of them.
  const Printer four = fitted(small_photon(4));
  EXPECT_EQ(four.bit_depth, 2);
  EXPECT_NEAR(four.calibration[1].intensity_mw_cm2, 2.5, 0.02);
  EXPECT_THROW(fitted(small_photon(1)), InputError);
  printer.bit_depth = 1;
  printer.calibration = {{0, 0}, {1, 10}};
  EXPECT_EQ(fitted(small_photon(1)), printer);
}

TEST_F(PrintFileRefusals, TimesThatAFileCannotSayAreRefusedBeforeAnythingIsComputed) {
  struct Case {
    SmallFile file;
    double exposure_s, bottom_s;
    int bottom_layers, fade_layers;
    const char* words;  ///< none: they can be said
  };
  const auto goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  for (const Case& c :
       {Case{small_cxdlp(3), 2.53, 40, 1, 0, "tenths of a second"},
        Case{small_cxdlp(3), 2.5, 40, 1, 2, "fade"}, Case{small_cxdlp(3), 2.6, 41, 1, 0, nullptr},
        Case{small_lgs(), 6.1, 40, 1, 2, "fade"}, Case{small_lgs(), 6.123, 40, 3, 0, nullptr},
        Case{small_workshop(true), 2.2, 40, 1, 2, "fade"},
        Case{small_photon(4), 8.1, 60, 2, 3, "fade"}, Case{goo, 2.7, 30, 1, 4, nullptr}}) {
    SCOPED_TRACE(c.file.name);
    const std::string path = folder_ / c.file.name;
    write_file(path, c.file.bytes);
    const StackReader target(path, folder_.path());
    StackFile file(folder_ / ("out" + c.file.name.substr(c.file.name.rfind('.'))));
    file.format = c.file.format;
    file.keep_from = path;
    StackInfo info;
    info.kind = StackKind::corrected;
    info.grid = target.grid();
    info.process.emplace();
    info.process->mode = ExposureMode::layerwise;
    info.process->exposure_s = c.exposure_s;
    info.process->bottom_exposure_s = c.bottom_s;
    info.process->bottom_layers = c.bottom_layers;
    info.process->fade_layers = c.fade_layers;
    const auto before = folder_.count();
    if (c.words) {
      EXPECT_THAT(test::refusal([&] { check_file_times(file, info); }),
                  AllOf(HasSubstr(path), HasSubstr(c.words)));
    } else {
      check_file_times(file, info);
    }
    // The file's own times can always be said.
    check_file_times(file, target.info());
    EXPECT_EQ(folder_.count(), before);
  }
}

TEST(PrintFiles, FormatsSayWhatTheyCanHold) {
  EXPECT_TRUE(limits_of_format("goo").made_new);
  EXPECT_EQ(limits_of_format("goo").levels, 256);
  EXPECT_TRUE(limits_of_format("ctb").made_new);
  EXPECT_EQ(limits_of_format("ctb").levels, 128);
  EXPECT_TRUE(limits_of_format("sl1").made_new);
  for (const char* name : {"photon", "photon-workshop", "phz", "fdg", "cxdlp", "lgs"}) {
    EXPECT_FALSE(limits_of_format(name).made_new) << name;
  }
}

TEST(PrintFiles, WhatIsOnlyChangedIsNotMadeFromNothing) {
  const TemporaryFolder folder;
  const Images images = random_images(8, 8, 2, 1);
  try {
    write_stack(folder / "a.lgs", images, info_of(images.grid));
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("as the template"));
  }
}

// ---- real files --------------------------------------------------------------------------------

struct RealPrintFile {
  const char *name, *format;
  int layers, width_px, height_px, levels_found;
};
void PrintTo(const RealPrintFile& file, std::ostream* out) { *out << file.name; }

constexpr RealPrintFile kReal[] = {
    {"pfe_smilie.v1.photon", "photon", 13, 1440, 2560, 2},
    {"pyphotonfile_reference.v1.photon", "photon", 10, 1440, 2560, 2},
    {"mariner_pyramid.v3.ctb", "ctb", 50, 1440, 2560, 76},
    {"msla_saturn.v4.ctb", "ctb", 426, 3840, 2400, 82},
    {"msla_mars4max.goo.gz", "goo", 426, 5760, 3600, 194},
    {"msla_photon_mono.v515.pwmo.gz", "photon-workshop", 426, 1620, 2560, 2},
    {"msla_photon_mono_x.v516.pwmx.gz", "photon-workshop", 426, 3840, 2400, 2},
    {"msla_photon_mono_4k.v516.pwma.gz", "photon-workshop", 426, 3840, 2400, 2},
    {"msla_photon_m3.v516.pm3.gz", "photon-workshop", 426, 4096, 2560, 2},
    {"msla_halot_one_plus.v3.cxdlp.gz", "cxdlp", 622, 4320, 2560, 2},
    {"uv3dp_microsupports3.lgs", "lgs", 251, 480, 854, 16},
};

class RealPrintFiles : public testing::TestWithParam<RealPrintFile> {};
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFiles, testing::ValuesIn(kReal),
                         [](const auto& info) { return name_of(info.param.name); });

void read_and_rewrite(const RealPrintFile& real) {
  const Bytes bytes = real_print_file(real.name);
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + real.name));
  const TemporaryFolder folder;
  write_file(folder / "in.bin", bytes);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const StackReader r(folder / "in.bin", folder.path(), context);
  EXPECT_EQ(told, "");
  EXPECT_EQ(r.info().format, real.format);
  EXPECT_EQ(r.grid().layers, real.layers);
  EXPECT_EQ(r.grid().width_px, real.width_px);
  EXPECT_EQ(r.grid().height_px, real.height_px);
  EXPECT_EQ(r.grid().layer_um, 50);
  StackFile out(folder / "out.bin");
  out.format = real.format;
  out.keep_from = folder / "in.bin";
  convert_stack(r, out, context);
  EXPECT_TRUE(read_file(out.path) == bytes) << "other bytes";
}

/// Of files of one program, one version and one kind of pixels the first by day, the others at night.
std::vector<RealPrintFile> real_files(bool night) {
  std::vector<RealPrintFile> files;
  for (const RealPrintFile& real : kReal) {
    const std::string name = real.name;
    const bool sibling =
        name == "msla_photon_mono_4k.v516.pwma.gz" || name == "msla_photon_m3.v516.pm3.gz";
    if (sibling == night) files.push_back(real);
  }
  return files;
}
using RealPrintFilesWhole = RealPrintFiles;
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFilesWhole, testing::ValuesIn(real_files(false)),
                         [](const auto& info) { return name_of(info.param.name); });
TEST_P(RealPrintFilesWhole, AreReadAndRewrittenToTheSameBytes) { read_and_rewrite(GetParam()); }

using RealPrintFilesNight = RealPrintFiles;
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFilesNight, testing::ValuesIn(real_files(true)),
                         [](const auto& info) { return name_of(info.param.name); });
TEST_P(RealPrintFilesNight, AreReadAndRewrittenToTheSameBytes) { read_and_rewrite(GetParam()); }

/// Our codes make the bytes of the slicers' own where these write longest runs. By day every seventh
/// layer of what has black and white alone is looked at.
TEST_P(RealPrintFiles, CodesAreThoseOfTheSlicer) {
  const RealPrintFile& real = GetParam();
  const int step = rounds(1) == 1 && real.layers > 400 && real.levels_found == 2 ? 7 : 1;
  const Bytes bytes = real_print_file(real.name);
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + real.name));
  const TemporaryFolder folder;
  write_file(folder / "in.bin", bytes);
  const detail::BinaryFile file(folder / "in.bin");
  const detail::ArchiveContents contents = detail::read_contents(file);
  const auto pieces = static_cast<std::size_t>(contents.codec->pieces());
  int same = 0, seen = 0;
  std::set<std::uint8_t> levels;
  Bytes pixels(contents.codec->pixel_count());
  for (std::size_t n = 0; n < static_cast<std::size_t>(real.layers);
       n += static_cast<std::size_t>(step)) {
    std::vector<Bytes> old(pieces);
    for (std::size_t p = 0; p < pieces; ++p) {
      const auto& place = contents.places[n * pieces + p];
      file.read_at(place.offset, place.size, old[p], "layer");
    }
    contents.codec->decode(old, pixels.data(), {real.name, static_cast<int>(n)});
    detail::each_pixel_run(pixels.data(), pixels.size(),
                           [&](std::uint8_t v, std::size_t) { levels.insert(v); });
    same += coded(*contents.codec, static_cast<int>(n), pixels) == old;
    ++seen;
  }
  EXPECT_EQ(static_cast<int>(levels.size()), real.levels_found);
  RecordProperty("same_layers", same);
  const bool longest_runs =
      std::string(real.format) != "ctb" && std::string(real.format) != "photon";
  if (longest_runs) {
    EXPECT_EQ(same, seen);
  }
}

/// One of the two has the sets of each layer together. Read as printers read it, it is a stack of its
/// own, whose sets are nested like those of the other: nothing in the file tells.
TEST(RealPrintFilesToo, OfEightSetsHaveNineLevels) {
  const std::string zip = real_file("slices/binary/photonsters_aa_test.cbddlp.zip");
  if (const std::string why = lacks(zip); !why.empty()) GTEST_SKIP() << why;
  const TemporaryFolder folder;
  int read = 0;
  for (const auto& [name, entry] : unzip(zip)) {
    write_file(folder / "in.cbddlp", entry);
    const StackReader r(folder / "in.cbddlp", folder.path());
    EXPECT_EQ(r.grid().layers, 8);
    std::set<std::uint8_t> levels;
    for (const Bytes& slice : read_images(r)) levels.insert(slice.begin(), slice.end());
    EXPECT_EQ(levels.size(), 9u);
    StackFile out(folder / "out.cbddlp");
    out.keep_from = folder / "in.cbddlp";
    convert_stack(r, out, {});
    EXPECT_TRUE(read_file(out.path) == entry) << name;
    ++read;
  }
  EXPECT_EQ(read, 2);
}

TEST(RealPrintFilesToo, OneThatLacksAPixelIsReadAndTold) {
  const Bytes bytes = real_print_file("pyphotonfile_short_layer.v1.photon");
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file("slices/binary"));
  const TemporaryFolder folder;
  write_file(folder / "in.photon", bytes);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const StackReader r(folder / "in.photon", folder.path(), context);
  EXPECT_THAT(told, HasSubstr("by 1 pixels, which are taken as black"));
  StackFile out(folder / "out.photon");
  out.keep_from = folder / "in.photon";
  convert_stack(r, out, context);
  EXPECT_EQ(read_file(out.path), bytes);
}

}  // namespace
}  // namespace slicecorr::test
