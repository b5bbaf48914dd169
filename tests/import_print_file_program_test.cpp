// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `resinctl import` of print files, whose times and light make a resin, and of profiles of printers, which
/// make none.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "print_file_fixture.hpp"
#include "program_fixture.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ImportPrintFile : public ProgramFixture {
 protected:
  RunResult import(const Command& arguments) const {
    // Not into the database that is there.
    return run_program(
        Command{SLICECORR_BIN_DIR "/resinctl", "import", "--folder", "."} + arguments, options_);
  }
  /// The resin that a file makes, with what its slicer assumed told.
  Resin made(const std::string& file, const Command& more) const {
    const RunResult r =
        import(Command{file, "--intensity-mw-cm2", "4", "--height-um", "120", "--dry-run"} + more);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return parse_resin(r.out, file);
  }
};

/// Dose that the far side of a layer gets: areal, of 2.5 s and 50 um, at 4 mW/cm² and 120 um base e.
double dose_of(double light_share) { return light_share * 4 * 2.5 * std::exp(-50.0 / 120); }

TEST_F(ImportPrintFile, TimesAndLightMakeAResin) {
  const SmallFile goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  const SmallFile ctb = small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0));
  for (const SmallFile& file : {goo, ctb}) {
    write_file(folder_ / file.name, file.bytes);
    const Resin r = made(file.name, {"--wavelength-nm", "405", "--name", "my-goo"});
    EXPECT_EQ(r.name, "my-goo");
    EXPECT_EQ(r.wavelength_nm, 405);
    EXPECT_NEAR(units::height_e_from_10(r.absorbance_height10_um), 120, 1e-6) << file.name;
    // Ten digits are written, of times in single precision.
    EXPECT_NEAR(units::areal_from_volumetric(r.critical_dose_mj_cm3, dose_height_e_um(r)),
                dose_of(1), 1e-6)
        << file.name;
    const std::string text =
        import({file.name, "--intensity-mw-cm2", "4", "--height-um", "120", "--dry-run"}).out;
    EXPECT_THAT(text, AllOf(HasSubstr("4 layers of 50 um"), HasSubstr("2.5 s is the exposure"),
                            HasSubstr("first 1 layers get 30 s"), HasSubstr("255 of 255"),
                            HasSubstr("upper bound of the gel dose")));
  }
}

TEST_F(ImportPrintFile, LightBelowFullCountsAsThatShare) {
  SmallFile goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  // docs/print-files.md: light of bottom and of normal layers, 16 bits, big end first.
  constexpr std::size_t bottom = 0x2fb71, normal = 0x2fb73;
  goo.bytes[normal + 1] = 102;
  goo.bytes[bottom + 1] = 204;
  write_file(folder_ / "dim.goo", goo.bytes);
  const Resin r = made("dim.goo", {});
  EXPECT_NEAR(units::areal_from_volumetric(r.critical_dose_mj_cm3, dose_height_e_um(r)),
              dose_of(0.4), 1e-6);
  const std::string text =
      import({"dim.goo", "--intensity-mw-cm2", "4", "--height-um", "120", "--dry-run"}).out;
  EXPECT_THAT(text, AllOf(HasSubstr("102 of 255"), HasSubstr("204 of 255 for bottom layers"),
                          HasSubstr("0.4 of it counts")));
  goo.bytes[normal + 1] = 0;
  write_file(folder_ / "dark.goo", goo.bytes);
  const RunResult dark = import({"dark.goo", "--intensity-mw-cm2", "4", "--height-um", "120"});
  EXPECT_EQ(dark.exit_code, 2);
  EXPECT_THAT(dark.err, AllOf(HasSubstr("dark.goo"), HasSubstr("0 of 255")));
}

TEST_F(ImportPrintFile, SavesItAndSaysWhatIsMissing) {
  const SmallFile goo = small_new("goo", *detail::goo_code(kFileWidth, kFileHeight, false));
  write_file(folder_ / "Grey Part.goo", goo.bytes);
  const RunResult no_light = import({"Grey Part.goo", "--height-um", "120"});
  EXPECT_EQ(no_light.exit_code, 2);
  EXPECT_THAT(no_light.err, AllOf(HasSubstr("Grey Part.goo"), HasSubstr("--intensity-mw-cm2")));
  const RunResult no_height = import({"Grey Part.goo", "--intensity-mw-cm2", "4"});
  EXPECT_EQ(no_height.exit_code, 2);
  EXPECT_THAT(no_height.err, HasSubstr("--height-um"));
  const RunResult saved =
      import({"Grey Part.goo", "--intensity-mw-cm2", "4", "--height-um", "120"});
  ASSERT_EQ(saved.exit_code, 0) << saved.err;
  EXPECT_THAT(saved.out, HasSubstr("grey-part.toml"));
  // A file that is cut, or no print file at all, is refused as itself.
  write_file(folder_ / "cut.goo", Bytes(goo.bytes.begin(), goo.bytes.begin() + 5000));
  write("no.ctb", "exposure = 3\n");
  for (const char* name : {"cut.goo", "no.ctb", "gone.goo"}) {
    const RunResult r = import({name, "--intensity-mw-cm2", "4", "--height-um", "120"});
    EXPECT_EQ(r.exit_code, 2) << name;
    EXPECT_THAT(r.err, HasSubstr(name));
  }
}

TEST_F(ImportPrintFile, RealFilesOfOthers) {
  for (const char* name : {"msla_mars4max.goo.gz", "mariner_pyramid.v3.ctb", "msla_saturn.v4.ctb",
                           "msla_photon_mono.v515.pwmo.gz"}) {
    SLICECORR_NEEDS_FILE(real_file(std::string("slices/binary/") + name));
    std::string plain = name;
    if (plain.ends_with(".gz")) plain.resize(plain.size() - 3);
    write_file(folder_ / plain, real_print_file(name));
    const StackInfo info = StackReader::read_info(folder_ / plain);
    const Resin r = made(plain, {"--name", "real"});
    double share = 1;
    for (const auto& [what, value] : print_file_facts(folder_ / plain)) {
      if (what == "light") share = std::stod(value) / 255;
    }
    const double expected = share * 4 * info.exposure_s * std::exp(-info.grid.layer_um / 120);
    EXPECT_NEAR(units::areal_from_volumetric(r.critical_dose_mj_cm3, dose_height_e_um(r)), expected,
                1e-6 * expected)
        << name;
  }
}

TEST_F(ImportPrintFile, ProfilesOfPrintersAreToldToBePrinters) {
  write("prusa.ini",
        "# generated\nprinter_technology = SLA\nprinter_model = SL1\ndisplay_height = 120.96\n"
        "display_width = 68.04\ndisplay_mirror_x = 1\ndisplay_mirror_y = 0\n"
        "display_orientation = portrait\ndisplay_pixels_x = 1440\ndisplay_pixels_y = 2560\n"
        "min_exposure_time = 1\nmax_exposure_time = 120\n");
  write("machine.json",
        "{\n \"machineName\": \"Works\",\n \"resolutionX\": 3840,\n \"resolutionY\": 2400,\n"
        " \"machineX\": 192,\n \"machineY\": 120\n}\n");
  const RunResult prusa = import({"prusa.ini", "--intensity-mw-cm2", "4", "--height-um", "120"});
  EXPECT_EQ(prusa.exit_code, 2);
  EXPECT_THAT(prusa.err, AllOf(HasSubstr("prusa.ini"), HasSubstr("profile of a printer"),
                               HasSubstr("1440 x 2560 pixels of 47.25 x 47.25 um"),
                               HasSubstr("portrait, mirrored in x"), HasSubstr("new-printer"),
                               Not(HasSubstr("mirrored in y"))));
  const RunResult other = import({"machine.json"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, AllOf(HasSubstr("profile of a printer"),
                               HasSubstr("3840 x 2400 pixels of 50 x 50 um")));
  // With exposure times it is a resin's, whatever else it says.
  write("resin.txt",
        "resolutionX = 3840\nresolutionY = 2400\nlayerHeight = 0.05\nexposureTime = 2.5\n");
  const Resin r = made("resin.txt", {"--name", "goo"});
  EXPECT_NEAR(units::areal_from_volumetric(r.critical_dose_mj_cm3, dose_height_e_um(r)), dose_of(1),
              1e-6);
  // Printers beside resins in a bundle are told and left out.
  write("bundle.ini",
        "[printer:Works S]\ndisplay_pixels_x = 1440\n[printer:Melts]\nnozzle_diameter = 0.4\n"
        "[sla_material:Grey @0.05]\nexposure_time = 2.5\n");
  const RunResult bundle = import({"bundle.ini", "--intensity-mw-cm2", "4", "--height-um", "120"});
  EXPECT_EQ(bundle.exit_code, 0) << bundle.err;
  EXPECT_THAT(bundle.err, AllOf(HasSubstr("'Works S' is a printer, not a resin"),
                                HasSubstr("1 made, 1 left out"), Not(HasSubstr("Melts"))));
}

}  // namespace
}  // namespace slicecorr::test
