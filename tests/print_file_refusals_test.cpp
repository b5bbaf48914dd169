// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is wrong with binary print files, told by place; what they can't hold.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "newer_print_file_fixture.hpp"
#include "refusal.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"

namespace slicecorr::test {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

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
  EXPECT_THAT(with(table + 0x24, 0), HasSubstr("below the one before it"));
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
  EXPECT_THAT(byte(14, 5), HasSubstr("is 5, expected 2 to 4"));
  EXPECT_THAT(refusal(cxdlp, [](FileMaker& m) { m.u8(0); }), HasSubstr("1 bytes follow"));
}

TEST_F(PrintFileRefusals, OfCxdlp4) {
  const SmallFile cxdlp = small_cxdlp4(0x1234567);
  const std::size_t head = kCxdlp4Head;
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, cxdlp.bytes.data() + at, 4);
    return v;
  };
  const auto with = [&](std::size_t at, std::uint32_t value) {
    return refusal(cxdlp, [&](FileMaker& m) { m.set_u32(at, value); });
  };
  const std::size_t table = u32(head + 0x20), layer = u32(table + 0x0c);
  EXPECT_THAT(with(head, 0), HasSubstr("0 x 0 pixels"));
  EXPECT_THAT(with(head + 0x24, 0), HasSubstr("0 layers"));
  EXPECT_THAT(with(head + 0x24, 70000), HasSubstr("70000 layers"));
  EXPECT_THAT(with(head + 0x24, 60000), HasSubstr("layer table"));
  EXPECT_THAT(with(head + 0x38, 0x43), HasSubstr("print settings have 67 bytes"));
  EXPECT_THAT(with(head + 0x34, u32(head + 0x48)), HasSubstr("overlaps"));
  EXPECT_THAT(with(head + 0x48, 0x7fffffff), HasSubstr("the file ends"));
  EXPECT_THAT(with(table + 0x0c, 0x7fffffff), HasSubstr("the file ends"));
  // Into itself, and into the layer before.
  EXPECT_THAT(with(table + 0x0c, static_cast<std::uint32_t>(table)), HasSubstr("overlaps"));
  EXPECT_THAT(with(table + 0x28 + 0x0c, static_cast<std::uint32_t>(layer)), HasSubstr("overlaps"));
  EXPECT_THAT(with(table + 0x10, 0x2c), HasSubstr("no data"));
  EXPECT_THAT(with(table + 0x14, 1), HasSubstr("the type 1"));
  EXPECT_THAT(with(table + 4, 0x7fc00000), HasSubstr("exposure is nan"));
  EXPECT_THAT(with(layer, 0), HasSubstr("checksum"));
  EXPECT_THAT(refusal(cxdlp, [&](FileMaker& m) { m.bytes.resize(head + 60); }),
              HasSubstr("the file ends"));
  EXPECT_THAT(refusal(cxdlp, [](FileMaker& m) { m.u8(0); }),
              AnyOf(HasSubstr("checksum"), HasSubstr("overlaps")));
}

TEST_F(PrintFileRefusals, OfWorkshop518) {
  const SmallFile pm5s = small_workshop_518();
  const auto u32 = [&](std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, pm5s.bytes.data() + at, 4);
    return v;
  };
  const auto with = [&](std::size_t at, std::uint32_t value) {
    return refusal(pm5s, [&](FileMaker& m) { m.set_u32(at, value); });
  };
  const std::size_t second = u32(0x38);
  EXPECT_THAT(with(0x38, 0x7fffffff), HasSubstr("the file ends"));
  EXPECT_THAT(with(0x38, u32(0x24)), HasSubstr("expected the name SUBIMGS"));
  EXPECT_THAT(with(second + 0x10, kFileLayers + 1), HasSubstr("expected as many as LAYERDEF"));
  EXPECT_THAT(with(second + 0x0c, 5), HasSubstr("in 5 bytes"));
  EXPECT_THAT(with(second + 0x18, 5), HasSubstr("layer 0 elsewhere than LAYERDEF"));
  EXPECT_THAT(with(second + 0x18 + 0x2c + 4, 5), HasSubstr("layer 1 elsewhere"));
}

TEST_F(PrintFileRefusals, OfAnycubicZip) {
  const std::vector<Bytes> slices = slices_of_16();
  const Entries sound = anycubic_entries(slices);
  const auto with = [&](const std::function<void(Entries&)>& damage) {
    Entries entries = sound;
    damage(entries);
    return refusal({"small.pm7", "anycubic-zip", zip_bytes(entries), slices}, [](FileMaker&) {});
  };
  const auto replaced = [&](const std::string& name, const std::string& what,
                            const std::string& by) {
    return with([&](Entries& entries) {
      Bytes& bytes = entry(entries, name);
      std::string text(bytes.begin(), bytes.end());
      const std::size_t at = text.find(what);
      ASSERT_NE(at, text.npos) << what;
      bytes = to_bytes(text.replace(at, what.size(), by));
    });
  };
  const auto without = [&](const std::string& name) {
    return with(
        [&](Entries& e) { std::erase_if(e, [&](auto& one) { return one.first == name; }); });
  };
  const std::string settings = "anycubic_photon_resins.pwsp", list = "layers_controller.conf";
  EXPECT_EQ(with([](Entries&) {}), "read");
  const std::pair<const char*, std::pair<std::string, const char*>> wrong_settings[] = {
      {R"("res_x": 40)", {R"("res_x": 400000)", "400000 x 30 pixels"}},
      {R"("res_x": 40,)", {"", "res_x is missing"}},
      {R"(["mine"])", {R"(["yours"])", "resin \"yours\""}},
      {R"(["mine"])", {"[]", "active_resins"}},
      {R"("bott_layers": 1)", {R"("bott_layers": -1)", "bott_layers is -1"}},
      {R"("exposure_time": 2.5)", {R"("exposure_time": "2.5")", "exposure_time"}},
      {R"("exposure_time": 2.5)", {R"("exposure_time": 1e300)", "exposure_time"}},
      {"{", {"[", "anycubic_photon_resins.pwsp"}}};
  for (const auto& [what, rest] : wrong_settings) {
    EXPECT_THAT(replaced(settings, what, rest.first), HasSubstr(rest.second)) << what;
  }
  EXPECT_THAT(replaced(list, R"("count": 4)", R"("count": 5)"), HasSubstr("count is 5"));
  EXPECT_THAT(replaced(list, R"("layer_index": 2)", R"("layer_index": 3)"),
              HasSubstr("paras[2].layer_index is 3, expected 2"));
  EXPECT_THAT(replaced(list, "0.05000000074505806", "0"), HasSubstr("layer_thickness"));
  EXPECT_THAT(without("layer_images/layer_3.pw0Img"),
              HasSubstr("lists 4 layers, but there are 3 images"));
  EXPECT_THAT(without("layer_images/layer_1.pw0Img"), HasSubstr("image 1 is missing"));
  EXPECT_THAT(without(list), HasSubstr("is no slice archive"));
  EXPECT_THAT(with([](Entries& e) { entry(e, "layer_images/layer_1.pw0Img").resize(3); }),
              AnyOf(HasSubstr("layer 1: its code"), HasSubstr("cut off")));
  EXPECT_THAT(with([](Entries& e) { entry(e, "layer_images/layer_1.pw0Img").resize(5000); }),
              AnyOf(HasSubstr("layer_1.pw0Img"), HasSubstr("layer 1")));
  EXPECT_THAT(with([](Entries& e) { entry(e, "scene.slice").resize(100); }),
              HasSubstr("scene.slice"));
  EXPECT_THAT(with([](Entries& e) { entry(e, "scene.slice")[0x64] = 5; }),
              HasSubstr("lists other layers than the archive's 4"));
  EXPECT_THAT(with([](Entries& e) { entry(e, "scene.slice")[0] = 'X'; }),
              HasSubstr("ANYCUBIC-PWSZ"));
  // Outlines, which the printer fills: what to do instead is told.
  EXPECT_THAT(with([](Entries& e) {
                for (auto& [name, bytes] : e) {
                  if (name.ends_with(".pw0Img")) name.replace(name.size() - 6, 6, "pwszImg");
                }
              }),
              AllOf(HasSubstr("layer_0.pwszImg"), HasSubstr("anti-aliasing of 8 or more")));
}

TEST_F(PrintFileRefusals, WhatIsClosedIsToldWithWhatWorksInstead) {
  write_file(folder_ / "a.ctb", {0x07, 0x01, 0xfd, 0x12, 4, 0, 0, 0});
  write_file(folder_ / "b.form", to_bytes("whatever it starts with"));
  for (const char* name : {"a.ctb", "b.form"}) {
    try {
      const StackReader reader(folder_ / name, folder_.path());
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

TEST_F(PrintFileRefusals, OtherHeightsThanAFileHasAreRefusedBeforeAnythingIsComputed) {
  const auto goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  for (const SmallFile& small :
       {small_cxdlp(3), small_lgs(), small_workshop(true), small_photon(4), goo}) {
    SCOPED_TRACE(small.name);
    const std::string path = folder_ / small.name;
    write_file(path, small.bytes);
    StackInfo info = StackReader::read_info(path);
    const double um = info.grid.layer_um;
    StackFile file(folder_ / ("out" + small.name.substr(small.name.rfind('.'))));
    file.format = small.format;
    file.keep_from = path;
    check_file_times(file, info);
    const auto refused = [&](double kept_um, double part_um) {
      EXPECT_THAT(test::refusal([&] { check_file_times(file, info); }),
                  AllOf(HasSubstr(path), HasSubstr(fmt::format("is {:g} um high", kept_um)),
                        HasSubstr(fmt::format("that of the part {:g} um", part_um))));
    };
    // Within what a file rounds they are the same.
    info.grid.layer_um = um * (1 + 0.9e-3);
    check_file_times(file, info);
    info.grid.layer_um = um * (1 + 1.1e-3);
    EXPECT_THROW(check_file_times(file, info), InputError);
    info.grid.layer_um = 0.6 * um;
    refused(um, 0.6 * um);
    // More layers than the file has are as high as its last.
    info.grid.layers = 1000;
    info.grid.layer_um = um;
    check_file_times(file, info);
    info.layer_heights_um.assign(1000, um);
    info.layer_heights_um.back() = 2 * um;
    EXPECT_THAT(test::refusal([&] { check_file_times(file, info); }), HasSubstr("its layer 999"));
    // Of a file that does not say it nobody knows.
    info.layer_heights_um.clear();
    info.grid.layer_um = 0;
    check_file_times(file, info);
  }
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
        Case{small_cxdlp(3), 7000, 7000, 1, 0, "at most 6553.5 s"},
        Case{small_cxdlp(3), 6553, 65536, 1, 0, "65535 s of bottom layers"},
        Case{small_cxdlp(3), 6553.5, 65535, 1, 0, nullptr},
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

}  // namespace
}  // namespace slicecorr::test
