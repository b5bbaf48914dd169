// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a print file says of single layers is what is printed: light below full, times that count, layers
/// of different heights, several exposures of a layer, through the program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program_fixture.hpp"
#include "real_files.hpp"
#include "tar_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// 320 x 200 pixels: two legs on the platform, pixel 90, 130 in one of them, and from layer 20 on a bridge
/// between them, pixel 150, 130 in it.
/// 10 s as a rule, 20 s for the first two of 40 layers of 50 um.
constexpr double kRuleS = 10, kBottomS = 20, kHaUm = 150;
constexpr int kSaidLayers = 40, kSaidBelow = 20;

/// A row of `probe`.
struct Probed {
  double z_um = 0, dose = 0;
  int grey = 0;
};

class PrintFileSays : public ProgramFixture {
 protected:
  PrintFileSays() {
    // 6 gel doses at the window in 10 s of full light; black without light, so that closed forms hold.
    write("wide.toml",
          "name = \"wide\"\n[display]\nwidth_px = 320\nheight_px = 200\npixel_um = 50.0\n[blue]\n"
          "calibration = [[0, 0.0], [255, 6.0]]\n");
    write("plain.toml",
          "name = \"plain\"\n[cure]\nabsorbance_height_um = 150\nabsorbance_base = 10\n"
          "gel_dose_mj_cm2 = 10\n");
  }
  const Command kWith{"--printer", "wide.toml", "--resin", "plain.toml", "--mode", "layerwise"};

  /// A file of tests/data, unpacked, in the folder.
  std::string reported(const std::string& name) const {
    const std::string plain = real_file("print_files/" + name),
                      packed = real_file("print_files/" + name + ".gz");
    const bool zipped = !std::filesystem::exists(plain);
    write_file(folder_ / name, zipped ? gunzip(read_file(packed)) : read_file(plain));
    return name;
  }
  json info(const std::string& name) const {
    return json::parse(good({"info", name, "--json", "-"}).out);
  }
  std::vector<Probed> probe(const std::string& name, int x, int y, const Command& with) const {
    std::istringstream rows(
        good(Command{"probe", name, "--x", std::to_string(x), "--y", std::to_string(y)} + with)
            .out);
    std::string line;
    std::getline(rows, line);
    std::vector<Probed> all;
    while (std::getline(rows, line)) {
      std::istringstream cells(line);
      Probed p;
      char comma = 0;
      double slice = 0, intensity = 0, phi = 0;
      cells >> slice >> comma >> p.z_um >> comma >> p.grey >> comma >> intensity >> comma >> phi >>
          comma >> p.dose;
      all.push_back(p);
    }
    return all;
  }
  /// Whether two files print the same, but for the last digits.
  void expect_same_print(const std::string& a, const std::string& b) const {
    json one = figures(a, a, kWith), other = figures(b, b, kWith);
    for (const char* key : {"joints", "height_error_um", "dose", "gap_contrast", "printed_voxels",
                            "cure_through_voxels", "undercure_voxels"}) {
      const json flat = one[key].is_object() ? one[key].flatten() : json{{"value", one[key]}};
      const json also = other[key].is_object() ? other[key].flatten() : json{{"value", other[key]}};
      for (const auto& [name, value] : flat.items()) {
        if (!value.is_number()) continue;
        ASSERT_TRUE(also.contains(name)) << key << name;
        const double wanted = value.get<double>();
        EXPECT_NEAR(also[name].get<double>(), wanted, 1e-6 * std::abs(wanted) + 1e-9)
            << key << name;
      }
    }
  }

  // ---- GOO files, byte by byte ----------------------------------------------------------------
  static std::uint32_t u32(const Bytes& b, std::size_t at) {
    return std::uint32_t{b[at]} << 24 | std::uint32_t{b[at + 1]} << 16 |
           std::uint32_t{b[at + 2]} << 8 | b[at + 3];
  }
  static void set_u32(Bytes& b, std::size_t at, std::uint32_t v) {
    for (int i = 0; i < 4; ++i)
      b[at + static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(v >> (24 - 8 * i));
  }
  static void set_f32(Bytes& b, std::size_t at, double v) {
    set_u32(b, at, std::bit_cast<std::uint32_t>(static_cast<float>(v)));
  }
  static float f32(const Bytes& b, std::size_t at) { return std::bit_cast<float>(u32(b, at)); }
  /// Where the heads of the layers stand.
  static std::vector<std::size_t> layers_of(const Bytes& goo) {
    std::vector<std::size_t> at;
    std::size_t next = u32(goo, 0x2fb8e);
    for (std::uint32_t n = 0; n < u32(goo, 0x2faee); ++n) {
      at.push_back(next);
      next += 0x46 + u32(goo, next + 0x42) + 2;
    }
    return at;
  }
  static constexpr std::size_t kFlag = 0x2fb75, kLightAt = 0x2fb73, kBottomLightAt = 0x2fb71,
                               kZ = 6, kTime = 0x0a, kOwnLight = 0x3e;
  /// Each layer with a time and light of its own, which printers heed.
  std::string with_own(const std::string& name, const std::vector<double>& times_s,
                       int light) const {
    Bytes goo = read_file(folder_ / name);
    goo[kFlag] = 1;
    const auto at = layers_of(goo);
    for (std::size_t n = 0; n < at.size(); ++n) {
      set_f32(goo, at[n] + kTime, times_s[std::min(n, times_s.size() - 1)]);
      goo[at[n] + kOwnLight] = 0;
      goo[at[n] + kOwnLight + 1] = static_cast<std::uint8_t>(light);
    }
    const std::string made = "own_" + std::to_string(light) + "_" + name;
    write_file(folder_ / made, goo);
    return made;
  }
};

// ---- light --------------------------------------------------------------------------------------

TEST_F(PrintFileSays, LightBelowFullIsToldPerLayerOrForAll) {
  const double half = 128.0 / 255;
  for (const char* name : {"uvj_pwm128.uvj", "chitubox_pwm128.zip"}) {
    EXPECT_NEAR(info(reported(name))["light_share"].get<double>(), half, 1e-12) << name;
  }
  // Bottom layers of these two are lit fully.
  for (const char* name : {"light_128.goo", "light_128.ctb"}) {
    const json share = info(reported(name))["light_share"];
    ASSERT_EQ(share.size(), static_cast<std::size_t>(kSaidLayers)) << name;
    for (std::size_t n = 0; n < share.size(); ++n) {
      EXPECT_NEAR(share[n].get<double>(), n < 2 ? 1.0 : half, 1e-12) << name << n;
    }
    EXPECT_THAT(good({"info", name}).out,
                HasSubstr("50.2 % of full light, 100 % for the first 2 layers"));
  }
  EXPECT_EQ(info(reported("layers_of_two_heights.goo"))["light_share"], 1.0);
}

TEST_F(PrintFileSays, HalfTheLightIsHalfTheDose) {
  const double half = 128.0 / 255;
  for (const char* name :
       {"light_128.goo", "light_128.ctb", "uvj_pwm128.uvj", "chitubox_pwm128.zip"}) {
    const bool bottoms = std::string(name).starts_with("light");
    const std::vector<Probed> column = probe(reported(name), 150, 130, kWith);
    ASSERT_EQ(column.size(), static_cast<std::size_t>(kSaidLayers)) << name;
    // Omega at node n, seen from below: what the exposures from n on leave there.
    double expected = 0;
    for (int n = kSaidLayers; n-- > 0;) {
      const Probed& p = column[static_cast<std::size_t>(n)];
      const double share = bottoms && n < 2 ? 1.0 : half;
      const double gel_doses = p.grey == 255 ? share * (n < 2 ? kBottomS : kRuleS) * 6 / 10 : 0;
      expected = (expected + gel_doses) * std::pow(10.0, -50 / kHaUm);
      EXPECT_NEAR(p.dose, expected, 1e-6 * expected + 1e-9) << name << n;
    }
  }
}

TEST_F(PrintFileSays, LessLightForLongerIsTheSamePrintAndTheSameCorrection) {
  reported("light_128.goo");
  std::vector<double> full_s, half_s;
  for (int n = 0; n < kSaidLayers; ++n) {
    half_s.push_back(n < 2 ? 24 : 12);
    full_s.push_back(half_s.back() * 128 / 255);
  }
  const std::string dim = with_own("light_128.goo", half_s, 128),
                    bright = with_own("light_128.goo", full_s, 255);
  expect_same_print(dim, bright);
  for (const std::string& name : {dim, bright}) {
    const RunResult r = good(Command{"correct", name, "-o", "c_" + name} + kWith);
    EXPECT_EQ(r.err.find("50.2 % of full light") != std::string::npos, name == dim) << r.err;
  }
  const Bytes a = read_file(folder_ / ("c_" + dim)), b = read_file(folder_ / ("c_" + bright));
  const Bytes was = read_file(folder_ / dim);
  const auto at = layers_of(a);
  ASSERT_EQ(a.size(), b.size());
  bool corrected = a.size() != was.size();
  for (std::size_t n = 0; n < at.size(); ++n) {
    // The light stays, and what is shown is the same.
    EXPECT_EQ(a[at[n] + kOwnLight + 1], 128) << n;
    EXPECT_EQ(b[at[n] + kOwnLight + 1], 255) << n;
    const std::size_t bytes = u32(a, at[n] + 0x42);
    EXPECT_TRUE(std::equal(a.begin() + static_cast<std::ptrdiff_t>(at[n] + 0x46),
                           a.begin() + static_cast<std::ptrdiff_t>(at[n] + 0x46 + bytes),
                           b.begin() + static_cast<std::ptrdiff_t>(at[n] + 0x46)))
        << n;
  }
  EXPECT_TRUE(corrected);
  // Read back, the record says the light, too.
  const json stored = info("c_" + dim);
  EXPECT_EQ(stored["kind"], "corrected");
  EXPECT_NEAR(stored["light_share"].get<double>(), 128.0 / 255, 1e-12);
}

TEST_F(PrintFileSays, LightIsChosenAndWrittenOrRefused) {
  reported("light_128.goo");
  write("full.csv", "slice,light_share\n0,1\n");
  good(Command{"correct", "light_128.goo", "-o", "full.goo", "--light-share", "full.csv"} + kWith);
  const Bytes full = read_file(folder_ / "full.goo");
  EXPECT_EQ(full[kLightAt + 1], 255);
  EXPECT_EQ(full[layers_of(full)[7] + kOwnLight + 1], 255);
  EXPECT_EQ(info("full.goo")["light_share"], 1.0);
  write("odd.csv", "slice,light_share\n0,0.7777\n");
  bad(2, Command{"correct", "light_128.goo", "-o", "odd.goo", "--light-share", "odd.csv"} + kWith,
      {"1/255"});
  write("above.csv", "slice,light_share\n0,1.5\n");
  bad(2, Command{"correct", "light_128.goo", "-o", "x.goo", "--light-share", "above.csv"} + kWith,
      {"light"});
  // Formats without a place for light.
  bad(2, {"convert", "light_128.goo", "-o", "dim.sl1"}, {"sl1", "less than full light", "layer 2"});
  // Formats with one keep it.
  for (const char* name : {"dim.ctb", "dim.uvj", "dim.vdt", "dim.cws"}) {
    good({"convert", "light_128.goo", "-o", name});
    const json share = info(name)["light_share"];
    ASSERT_EQ(share.size(), static_cast<std::size_t>(kSaidLayers)) << name;
    EXPECT_NEAR(share[1].get<double>(), 1, 1e-12) << name;
    EXPECT_NEAR(share[39].get<double>(), 128.0 / 255, 1e-12) << name;
  }
  Bytes dark = read_file(folder_ / "light_128.goo");
  dark[kLightAt + 1] = 0;
  write_file(folder_ / "dark.goo", dark);
  bad(2, {"info", "dark.goo"}, {"layer 2 is lit with 0 of 255"});
}

// ---- times --------------------------------------------------------------------------------------

TEST_F(PrintFileSays, TimesThatAPrinterDoesNotHeedDoNotCount) {
  for (const char* name : {"flag_off_layer_times_stale.goo", "flag_off_layer_times_stale.ctb"}) {
    const json j = info(reported(name));
    // Two of 20 s, 38 of 10 s; the table says 30 s for each.
    EXPECT_NEAR(j["light_s"].get<double>(), 2 * kBottomS + 38 * kRuleS, 1e-6) << name;
    EXPECT_THAT(good({"info", name}).err, HasSubstr("do not heed times of single layers")) << name;
  }
  // Set, the mark makes them count.
  Bytes heeded = read_file(folder_ / "flag_off_layer_times_stale.goo");
  heeded[kFlag] = 1;
  write_file(folder_ / "heeded.goo", heeded);
  EXPECT_NEAR(info("heeded.goo")["light_s"].get<double>(), 40 * 30, 1e-6);
}

TEST_F(PrintFileSays, TransitionLayersFadeEvenlyAndAreKept) {
  const std::string name = reported("transition_5_uvtools_times.goo");
  // 20 s for two layers, then five in steps of 10/6 s, then 10 s.
  const double sum_s = 2 * kBottomS + 5 * 15 + 33 * kRuleS;
  EXPECT_NEAR(info(name)["light_s"].get<double>(), sum_s, 1e-6);
  EXPECT_THAT(good({"info", name}).err, HasSubstr("17.76"));
  for (const char* to : {"faded.ctb", "again.goo"}) {
    good({"convert", name, "-o", to});
    EXPECT_NEAR(info(to)["light_s"].get<double>(), sum_s, 1e-3) << to;
    const std::string text = good({"info", to}).out;
    EXPECT_THAT(text, HasSubstr("not heeded")) << to;
    EXPECT_THAT(text, testing::ContainsRegex("transition layers +5")) << to;
  }
  // Times that are really of single layers need the mark, which is told.
  std::vector<double> times_s{20, 20, 11, 13, 12};
  times_s.resize(kSaidLayers, 10);
  const RunResult r = good({"convert", with_own(name, times_s, 255), "-o", "uneven.ctb"});
  EXPECT_THAT(r.err, HasSubstr("which some do not"));
  EXPECT_THAT(good({"info", "uneven.ctb"}).out, HasSubstr(" heeded"));
}

// Steps of any size stay beside a new exposure, as far on the way to it as they were; where an archive can't list them,
// its head says the nearest that it has words for.
TEST_F(PrintFileSays, UnevenTransitionLayersStayBesideANewExposure) {
  std::vector<double> times_s{20, 20, 17.5, 15};
  times_s.resize(kSaidLayers, 10);
  const std::string name = with_own(reported("transition_5_uvtools_times.goo"), times_s, 255);
  const Command anew = kWith + Command{"--exposure-s", "12"};
  const RunResult r = good(Command{"correct", name, "-o", "new.goo"} + anew);
  EXPECT_THAT(
      r.err,
      HasSubstr(
          "the archive's longer first exposures stay, in steps to the new one: 12 to 20 s each"));
  EXPECT_THAT(r.err, testing::Not(HasSubstr("are not kept")));
  const Bytes goo = read_file(folder_ / "new.goo");
  const std::vector<double> wanted_s{20, 20, 18, 16, 12, 12};
  const auto layers = layers_of(goo);
  for (std::size_t n = 0; n < wanted_s.size(); ++n) {
    EXPECT_NEAR(f32(goo, layers[n] + kTime), wanted_s[n], 1e-5) << n;
  }
  EXPECT_NEAR(f32(goo, layers.back() + kTime), 12, 1e-5);
  EXPECT_EQ(goo[kFlag], 1);
  // Its head, for printers that do not heed the list: exposure, that of bottom layers, how many, transition layers.
  EXPECT_EQ(f32(goo, 0x2fb08), 12);
  EXPECT_EQ(f32(goo, 0x2fb29), 20);
  EXPECT_EQ(u32(goo, 0x2fb2d), 2U);
  EXPECT_EQ(goo[0x2fb93] * 256 + goo[0x2fb94], 2);
  // Said anew they are others, and one that is no longer than the new one is none.
  good(Command{"correct", name, "-o", "said.goo", "--bottom-layers", "3", "--bottom-exposure-s",
               "30"} +
       anew);
  const Bytes said = read_file(folder_ / "said.goo");
  EXPECT_NEAR(f32(said, layers_of(said)[2] + kTime), 30, 1e-5);
  EXPECT_NEAR(f32(said, layers_of(said)[3] + kTime), 12, 1e-5);
  EXPECT_THAT(good(Command{"correct", name, "-o", "all.goo", "--exposure-s", "25"} + kWith).err,
              HasSubstr("are not kept: every layer gets 25 s"));
  // An SL1 has a first exposure and even steps.
  const RunResult sl1 = good({"convert", name, "-o", "faded.sl1"});
  EXPECT_THAT(
      sl1.err,
      HasSubstr("20 s is written for the first, 10 s for all others, and 2 layers in even steps"));
  Entries entries = unzip(folder_ / "faded.sl1");
  const std::string config = to_text(entry(entries, "config.ini"));
  for (const char* line : {"expTime = 10\n", "expTimeFirst = 20\n", "numFade = 4\n"}) {
    EXPECT_THAT(config, HasSubstr(line));
  }
}

// ---- several exposures ----------------------------------------------------------------------------

TEST_F(PrintFileSays, AnImageOfAPixelBeforeTheFirstIsAnotherExposureOfIt) {
  for (const char* name : {"uvtools_dummy_first_layer.goo", "uvtools_dummy_first_layer.ctb"}) {
    const json j = info(reported(name));
    const bool goo = std::string(name).ends_with("goo");
    EXPECT_EQ(j["layers"], goo ? 40 : 39) << name;
    EXPECT_EQ(j["exposures"].size(), goo ? 41U : 40U) << name;
    // In the CTB file the first image is all of the layer's.
    EXPECT_EQ(j["exposures"][0]["spot"], goo) << name;
    EXPECT_EQ(j["exposures"][1]["spot"], false) << name;
    EXPECT_EQ(j["exposures"][1]["layer"], 0) << name;
    EXPECT_EQ(j["loose_bodies"], 0) << name;
    EXPECT_NEAR(j["height_mm"].get<double>(), (goo ? 40 : 39) * 0.05, 1e-9) << name;
    const std::string out = std::string("corrected_") + name;
    good(Command{"correct", name, "-o", out} + kWith);
    EXPECT_EQ(info(out)["layers"], j["layers"]) << name;
    EXPECT_EQ(info(out)["exposures"].size(), j["exposures"].size()) << name;
    EXPECT_EQ(figures(out, name)["joints"]["not_holding_voxels"], 0) << name;
  }
  // The dummy stays byte for byte.
  const Bytes before = read_file(folder_ / "uvtools_dummy_first_layer.goo"),
              after = read_file(folder_ / "corrected_uvtools_dummy_first_layer.goo");
  const auto at = layers_of(before);
  EXPECT_TRUE(std::equal(before.begin() + static_cast<std::ptrdiff_t>(at[0]),
                         before.begin() + static_cast<std::ptrdiff_t>(at[1]),
                         after.begin() + static_cast<std::ptrdiff_t>(at[0])));
  EXPECT_NE(before, after);
}

TEST_F(PrintFileSays, DosesOfExposuresOfOneLayerAddUp) {
  reported("uvtools_dummy_first_layer.goo");
  Bytes goo = read_file(folder_ / "uvtools_dummy_first_layer.goo");
  const auto at = layers_of(goo);
  // Images 1 and 2 at the same place: 20 + 20 s of the same image; all later ones a layer lower.
  for (std::size_t n = 2; n < at.size(); ++n)
    set_f32(goo, at[n] + kZ, 0.05 * static_cast<double>(n - 1));
  write_file(folder_ / "twice.goo", goo);
  const json twice = info("twice.goo");
  EXPECT_EQ(twice["layers"], 39);
  // The spot's light, 0.01 s of 1 / 255, adds to nothing but its pixel.
  std::vector<Probed> column = probe("twice.goo", 90, 130, kWith);
  ASSERT_EQ(column.size(), 39U);
  double expected = 0;
  for (int n = 39; n-- > 0;) {
    const double s = n == 0 ? 40 : 10;
    expected = (expected + s * 0.6) * std::pow(10.0, -50 / kHaUm);
    EXPECT_NEAR(column[static_cast<std::size_t>(n)].dose, expected, 1e-6 * expected) << n;
  }
  good(Command{"correct", "twice.goo", "-o", "twice_c.goo"} + kWith);
  EXPECT_EQ(info("twice_c.goo")["exposures"].size(), 41U);
  // As a stack of ours it is one exposure of 40 s, which is told.
  const RunResult r = good({"convert", "twice.goo", "-o", "joined.uvj"});
  EXPECT_THAT(r.err, HasSubstr("41 exposures of 39 layers become one of each"));
  EXPECT_NEAR(info("joined.uvj")["light_s"].get<double>(), 40 + 38 * 10, 1e-6);
  // A test of exposures: other images at one place. Printed as it is, but no part.
  const std::vector<std::size_t> now = layers_of(goo);
  Bytes other = goo;
  // From image 19 on all are at its place: two of the legs alone, then those of the bridge.
  for (std::size_t n = 19; n < now.size(); ++n)
    set_f32(other, now[n] + kZ, f32(other, now[19] + kZ));
  write_file(folder_ / "finder.goo", other);
  const json finder = info("finder.goo");
  EXPECT_EQ(finder["layers"], 18);
  bad(2, Command{"correct", "finder.goo", "-o", "x.goo"} + kWith,
      {"layer 17", "exposed more than once"});
  bad(2, {"convert", "finder.goo", "-o", "x.uvj"}, {"exposed more than once"});
  // Doses add up pixel by pixel: 22 exposures of 10 s in a leg, the last 20 of them in the bridge.
  for (const auto& [x, times] : {std::pair{90, 22}, std::pair{150, 20}}) {
    const std::vector<Probed> all = probe("finder.goo", x, 130, kWith);
    ASSERT_EQ(all.size(), 18U);
    EXPECT_NEAR(all[17].dose, times * 6 * std::pow(10.0, -50 / kHaUm), 1e-6 * all[17].dose) << x;
  }
  Bytes falls = goo;
  set_f32(falls, now[5] + kZ, 0.01);
  write_file(folder_ / "falls.goo", falls);
  bad(2, {"info", "falls.goo"}, {"layer 5", "below the one before it"});
}

// ---- heights --------------------------------------------------------------------------------------

TEST_F(PrintFileSays, LayersOfTwoHeightsAreTold) {
  for (const char* name : {"layers_of_two_heights.goo", "layers_of_two_heights.ctb",
                           "chitubox_two_heights.zip", "cws_two_heights.cws"}) {
    const json j = info(reported(name));
    ASSERT_EQ(j["layer_um"].size(), static_cast<std::size_t>(kSaidLayers)) << name;
    for (std::size_t n = 0; n < j["layer_um"].size(); ++n) {
      EXPECT_NEAR(j["layer_um"][n].get<double>(), n < kSaidBelow ? 50 : 100, 1e-9) << name << n;
    }
    EXPECT_NEAR(j["height_mm"].get<double>(), 3, 1e-9) << name;
    // 6800 pixels in the lower 1 mm, 13200 in the upper 2 mm, of 50 x 50 um.
    EXPECT_NEAR(j["resin_volume_ml"].get<double>(), (6800 * 1 + 13200 * 2) * 0.0025e-3, 1e-9)
        << name;
    EXPECT_THAT(good({"info", name}).out, HasSubstr("50 to 100 um, 3.000 mm in all"));
  }
  EXPECT_EQ(info(reported("light_128.goo"))["layer_um"], 50.0);
}

TEST_F(PrintFileSays, DosesInLayersOfTwoHeightsAreSumsOverTheirPlaces) {
  for (const char* name : {"layers_of_two_heights.goo", "chitubox_two_heights.zip"}) {
    const std::vector<Probed> column = probe(reported(name), 150, 130, kWith);
    ASSERT_EQ(column.size(), static_cast<std::size_t>(kSaidLayers)) << name;
    for (int n = 0; n < kSaidLayers; ++n) {
      const auto node_um = [](int k) {
        return k <= kSaidBelow ? 50.0 * k : 1000 + 100.0 * (k - kSaidBelow);
      };
      const Probed& p = column[static_cast<std::size_t>(n)];
      EXPECT_NEAR(p.z_um, node_um(n), 1e-9) << n;
      double sum = 0;
      for (int k = n; k < kSaidLayers; ++k) {
        const double s = k < 2 ? kBottomS : kRuleS;
        if (column[static_cast<std::size_t>(k)].grey != 255) continue;
        sum += s * 0.6 * std::pow(10.0, -(node_um(k + 1) - node_um(n)) / kHaUm);
      }
      EXPECT_NEAR(p.dose, sum, 1e-6 * sum + 1e-9) << name << n;
    }
  }
}

TEST_F(PrintFileSays, LayersOfTwoHeightsAreCorrectedByTheirOwn) {
  reported("layers_of_two_heights.goo");
  good(Command{"correct", "layers_of_two_heights.goo", "-o", "two.goo"} + kWith);
  const json f = figures("two.goo", "layers_of_two_heights.goo");
  EXPECT_EQ(f["joints"]["not_holding_voxels"], 0);
  EXPECT_GE(f["joints"]["least"].get<double>(), 1.2 - 1e-9);
  EXPECT_EQ(f["undercure_voxels"], 0);
  EXPECT_EQ(f["layer_um"].size(), static_cast<std::size_t>(kSaidLayers));
  // The bridge that begins at 1 mm, by a sum of its own over what is shown.
  const std::vector<Probed> column = probe("two.goo", 150, 130, {});
  ASSERT_EQ(column.size(), static_cast<std::size_t>(kSaidLayers));
  ASSERT_EQ(column[0].grey, 0);
  double edge_dose = 0;
  for (int k = kSaidBelow; k < kSaidLayers; ++k) {
    const double own = 6 * column[static_cast<std::size_t>(k)].grey / 255.0;
    // Each layer of 100 um holds by its own exposure.
    EXPECT_GE(own * std::pow(10.0, -100 / kHaUm), 1.2 - 1e-6) << k;
    edge_dose += own * std::pow(10.0, -100.0 * (k - kSaidBelow + 1) / kHaUm);
  }
  const double over_um = kHaUm * std::log10(edge_dose);
  EXPECT_NEAR(f["height_error_um"]["max_abs"].get<double>(), over_um, 0.01);
  // As sliced it reaches further.
  const json sliced = figures("layers_of_two_heights.goo", "layers_of_two_heights.goo", kWith);
  EXPECT_GE(sliced["height_error_um"]["max_abs"].get<double>(), over_um - 1e-6);
  // The file's places stay.
  const Bytes before = read_file(folder_ / "layers_of_two_heights.goo"),
              after = read_file(folder_ / "two.goo");
  const auto a = layers_of(before), b = layers_of(after);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t n = 0; n < a.size(); ++n)
    EXPECT_EQ(f32(before, a[n] + kZ), f32(after, b[n] + kZ)) << n;
}

TEST_F(PrintFileSays, LayersOfTwoHeightsAreCountedWhileThePlatformMoves) {
  reported("layers_of_two_heights.goo");
  const Command moving{"--printer", "wide.toml",  "--resin",      "plain.toml",
                       "--mode",    "continuous", "--speed-mm-h", "20"};
  good(Command{"correct", "layers_of_two_heights.goo", "-o", "moved.goo"} + moving);
  const json f = figures("moved.goo", "layers_of_two_heights.goo", moving);
  EXPECT_EQ(f["undercure_voxels"], 0);
  EXPECT_EQ(f["cure_through_voxels"], 0);
  EXPECT_EQ(f["layer_um"][19], 50);
  EXPECT_EQ(f["layer_um"][20], 100);
  // All heights at 20 mm/h, as the file says, too: 0.18 s for each um.
  double um = 0;
  for (const json& height : f["layer_um"]) um += height.get<double>();
  const json told = info("moved.goo");
  EXPECT_NEAR(told["print_time_s"].get<double>(), 0.18 * um, 1e-6);
  EXPECT_NEAR(told["own_print_time_s"].get<double>(), 0.18 * um, 1);
}

TEST_F(PrintFileSays, WhatDoesNotCountHeightsRefusesThemByName) {
  reported("layers_of_two_heights.goo");
  good(Command{"correct", "layers_of_two_heights.goo", "-o", "x.goo", "--lift-exchange", "0.5"} +
       kWith);
  good(Command{"verify", "layers_of_two_heights.goo", "--target", "layers_of_two_heights.goo",
               "--uncertain", "ha=5%"} +
       kWith);
  bad(2,
      Command{"plan", "layers_of_two_heights.goo", "--printer", "wide.toml", "--resin",
              "plain.toml", "--mode", "layerwise"},
      {"different heights"});
  // Formats with places keep them, others refuse.
  for (const char* name : {"two.ctb", "two.uvj", "two.zip", "two.cws", "two.nanodlp", "two.vdt"}) {
    Command to{"convert", "layers_of_two_heights.goo", "-o", name};
    if (std::string(name) == "two.zip") to = to + Command{"--format", "chitubox"};
    good(to);
    const json j = info(name);
    ASSERT_EQ(j["layer_um"].size(), static_cast<std::size_t>(kSaidLayers)) << name;
    EXPECT_NEAR(j["layer_um"][19].get<double>(), 50, 1e-9) << name;
    EXPECT_NEAR(j["layer_um"][20].get<double>(), 100, 1e-9) << name;
  }
  bad(2, {"convert", "layers_of_two_heights.goo", "-o", "two.sl1"}, {"sl1", "different heights"});
}

TEST_F(PrintFileSays, ABlankFirstLayerIsToldByEveryCommand) {
  reported("first_layer_blank.sl1");
  const std::string words = "on nothing when they begin: the largest from 50 um on";
  EXPECT_THAT(good({"info", "first_layer_blank.sl1"}).out, HasSubstr(words));
  const Command with = kWith + Command{"--exposure-s", "10"};
  EXPECT_THAT(good(Command{"correct", "first_layer_blank.sl1", "-o", "blank.sl1"} + with).err,
              HasSubstr(words));
  EXPECT_THAT(
      good(Command{"verify", "first_layer_blank.sl1", "--target", "first_layer_blank.sl1"} + with)
          .err,
      HasSubstr(words));
}

}  // namespace
}  // namespace slicecorr::test
