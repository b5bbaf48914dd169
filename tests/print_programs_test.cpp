// Binary print files through the programs, and read by a second reader, tests/print_files.py.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <nlohmann/json.hpp>

#include "post_fixture.hpp"
#include "print_file_fixture.hpp"
#include "slicecorr/print_file.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class PrintPrograms : public PostFolder {
 protected:
  PrintPrograms() { make_sl1(folder_ / "part.sl1"); }
  RunResult run(const Command& arguments) {
    Command command{SLICECORR_BIN_DIR "/" + arguments[0]};
    command.insert(command.end(), arguments.begin() + 1, arguments.end());
    return run_program(command, options_);
  }
  RunResult must(const Command& arguments) {
    RunResult r = run(arguments);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r;
  }
  /// What the second reader says of a file.
  json second_reader(const std::string& path, const Command& layers = {}) {
    const RunResult r = run_program(
        Command{"/usr/bin/env", "python3", SLICECORR_SOURCE_DIR "/tests/print_files.py", path} +
            layers,
        options_);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r.exit_code == 0 ? json::parse(r.out) : json();
  }
  /// Both readers see the same.
  void compare(const std::string& path, const Command& layers = {}) {
    const json other = second_reader(path, layers);
    ASSERT_FALSE(other.is_null());
    const StackReader r(path, folder_.path());
    const StackInfo& info = r.info();
    EXPECT_EQ(other["format"], info.format);
    EXPECT_EQ(other["size"], json({r.grid().width_px, r.grid().height_px}));
    ASSERT_EQ(other["count"], r.grid().layers);
    EXPECT_NEAR(other["exposure_s"].get<double>(), info.exposure_s, 1e-3);
    EXPECT_NEAR(other["bottom_s"].get<double>(), info.bottom_exposure_s, 1e-3);
    EXPECT_EQ(other["bottom_layers"], info.bottom_layers);
    Process times;
    times.mode = ExposureMode::layerwise;
    times.exposure_s = info.exposure_s;
    times.bottom_exposure_s = info.bottom_exposure_s;
    times.bottom_layers = info.bottom_layers;
    times.fade_layers = info.fade_layers;
    times.layer_exposure_s = info.layer_exposure_s;
    for (int n = 0; n < r.grid().layers; ++n) {
      EXPECT_NEAR(other["times"][static_cast<std::size_t>(n)].get<double>(),
                  layer_exposure_s(times, n), 0.01)
          << n;
      EXPECT_NEAR(other["heights"][static_cast<std::size_t>(n)].get<double>(),
                  (n + 1) * r.grid().layer_um * 1e-3, 0.02)
          << n;
    }
    Bytes pixels(static_cast<std::size_t>(r.grid().width_px) *
                 static_cast<std::size_t>(r.grid().height_px));
    for (const auto& [layer, crc] : other["layers"].items()) {
      r.read_slice(std::stoi(layer), pixels.data());
      EXPECT_EQ(crc, ::crc32(0, pixels.data(), static_cast<uInt>(pixels.size())))
          << "layer " << layer;
    }
  }
};

TEST_F(PrintPrograms, ASecondReaderSeesTheSameInNewAndCorrectedFiles) {
  for (const std::string ending : {"ctb", "goo"}) {
    const std::string made = "new." + ending, out = "corrected." + ending;
    must({"slicecorr", "convert", "part.sl1", "-o", made, "--printer", "small.toml"});
    compare(folder_ / made);
    const RunResult r = must(Command{"slicecorr", "correct", made, "-o", out} + kSmall +
                             Command{"--exposure-s", "0.1"});
    EXPECT_EQ(r.err.find("holds 128 grey levels") != std::string::npos, ending == "ctb") << r.err;
    compare(folder_ / out);
    EXPECT_EQ(StackReader::read_info(folder_ / out).kind, StackKind::corrected);
    must({"slicecorr", "verify", out, "--target", made, "--json", "-"});
    EXPECT_EQ(run(Command{"slicecorr", "correct", out, "-o", "again." + ending} + kSmall).exit_code,
              2);
    // Without its record it is a file like any other.
    fs::remove(record_beside(folder_ / out));
    EXPECT_EQ(StackReader::read_info(folder_ / out).kind, StackKind::foreign);
  }
}

TEST_F(PrintPrograms, ASecondReaderSeesTheSameInRealFiles) {
  for (const std::string name : {"mariner_pyramid.v3.ctb", "msla_mars4max.goo.gz",
                                 "msla_photon_mono.v515.pwmo.gz", "msla_photon_m3.v516.pm3.gz"}) {
    const Bytes bytes = real_print_file(name);
    if (bytes.empty()) GTEST_SKIP() << lacks(real_file("slices/binary/" + name));
    write_file(folder_ / "real.bin", bytes);
    SCOPED_TRACE(name);
    compare(folder_ / "real.bin", {"0", "7", "25", "49"});
  }
}

/// What cannot be made from nothing is made from another file of the same printer.
TEST_F(PrintPrograms, TemplatesGetThePartsLayers) {
  Images small = random_images(kSmallWidth, kSmallHeight, 6, 77);
  small.grid.pixel_x_um = small.grid.pixel_y_um = small.grid.layer_um = 50;
  StackInfo info = info_of(small.grid);
  info.kind = StackKind::foreign;
  write_stack(folder_ / "part.uvj", small, info);
  for (const SmallFile& file : small_print_files()) {
    SCOPED_TRACE(file.name);
    write_file(folder_ / file.name, file.bytes);
    const std::string out = "out_" + file.name;
    must({"slicecorr", "convert", "part.uvj", "-o", out, "--format", file.format, "--template",
          file.name});
    const StackReader a(folder_ / out, folder_.path()), b(folder_ / file.name, folder_.path());
    EXPECT_EQ(a.grid().layers, 6);
    EXPECT_EQ(a.info().exposure_s, b.info().exposure_s);
    // From there into a format that holds all levels: the same images.
    must({"slicecorr", "convert", out, "-o", "whole.goo"});
    EXPECT_EQ(read_images(StackReader(folder_ / "whole.goo", folder_.path())), read_images(a));
  }
}

TEST_F(PrintPrograms, InfoShowsWhatTheFileSays) {
  must({"slicecorr", "convert", "part.sl1", "-o", "a.goo", "--printer", "small.toml"});
  const RunResult text = must({"slicecorr", "info", "a.goo"});
  EXPECT_THAT(text.out, HasSubstr("format goo"));
  EXPECT_THAT(text.out, HasSubstr("grey levels  256"));
  EXPECT_THAT(text.out, HasSubstr("lift "));
  const json j = json::parse(must({"slicecorr", "info", "a.goo", "--json", "-"}).out);
  EXPECT_EQ(j["archive"]["grey levels"], "256");
}

/// slicecorr-post in place and back, on files that are not made from nothing.
TEST_F(PrintPrograms, PostCorrectsInPlaceAndBack) {
  // A display of 160 x 120: that of the small printer.
  for (const std::string name : {"a.ctb", "a.goo"}) {
    must({"slicecorr", "convert", "part.sl1", "-o", name, "--printer", "small.toml"});
    const Bytes before = read_file(folder_ / name);
    must(Command{"slicecorr-post"} + kSmall + Command{"--exposure-s", "0.1", "--backup", name});
    EXPECT_TRUE(fs::exists(record_beside(folder_ / name)));
    EXPECT_EQ(run(Command{"slicecorr-post"} + kSmall + Command{name}).exit_code, 2)
        << "a second time";
    must({"slicecorr-post", "--undo", name});
    EXPECT_EQ(read_file(folder_ / name), before);
    EXPECT_FALSE(fs::exists(record_beside(folder_ / name)));
  }
}

TEST_F(PrintPrograms, TheFarmWritesThem) {
  const std::string farm = folder_ / "farm";
  const Command place{"--farm", farm};
  must(Command{"slicefarm", "submit", "part.sl1"} + place + kSmall +
       Command{"--exposure-s", "0.1", "--out", "done", "--out-format", "goo"});
  must(Command{"slicefarm", "run", "--until-empty"} + place);
  const std::string made = folder_ / "done/part.goo";
  EXPECT_EQ(StackReader::read_info(made).kind, StackKind::corrected);
  compare(made);
}

}  // namespace
}  // namespace slicecorr::test
