// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// An even dead zone through the programs: light found for small parts, judged by a sweep with the
// images that were written, and what is refused.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "chapter_iv_resins.hpp"
#include "ladder.hpp"
#include "lattice.hpp"
#include "meshes.hpp"
#include "program_fixture.hpp"
#include "rounds.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/flow_part.hpp"
#include "slicecorr/flow_section.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;

class EvenDeadZoneProgram : public ProgramFixture {
 protected:
  EvenDeadZoneProgram() {
    options_.timeout = std::chrono::minutes(4);
    printer("patterned.toml", "patterned");
    printer("flood.toml", "flood");
    resin("resin.toml", "viscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n", kInhibition);
    TriangleMesh disc;
    add_strut(disc, {0, 0, 0}, {0, 0, 1.5}, 4.0, 180);
    write_stl(folder_ / "disc.stl", disc);
    // A prism of four sides: its radius is half a diagonal.
    TriangleMesh square;
    add_strut(square, {0, 0, 0}, {0, 0, 1.0}, 4.0 * std::sqrt(2.0), 4);
    write_stl(folder_ / "square.stl", square);
  }

  static constexpr const char* kInhibition =
      "[inhibition]\nbeta = 0.799895\nabsorbance_height_um = 38\nabsorbance_base = \"e\"\n";
  void printer(const std::string& name, const std::string& kind,
               const std::string& more = "") const {
    std::ofstream(folder_ / name)
        << "name = \"vat\"\n"
        << more
        << "[display]\nwidth_px = 260\nheight_px = 260\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n[uv]\nkind = \""
        << kind << "\"\ncalibration = [[0, 0.0], [255, 275.0]]\n[stage]\nmax_speed_mm_h = 5000\n";
  }
  /// Resin 2 of the dissertation's table 4.1, areal.
  void resin(const std::string& name, const std::string& more,
             const std::string& inhibition) const {
    std::ofstream(folder_ / name)
        << "name = \"r2\"\n"
        << more
        << "[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 408\nabsorbance_base = \"e\"\n"
           "critical_dose_mj_cm3 = 1600\n"
        << inhibition;
  }
  void done(const Command& arguments) const {
    const RunResult r = call(arguments);
    ASSERT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
  }
  /// Slices and corrects a part; what `verify` says of it, and in `told` what `correct` said.
  json print(const std::string& part, const std::string& printer, const std::string& kind,
             const std::string& gap_um, std::string* told = nullptr) const {
    done({"slice", part + ".stl", "-o", part + ".uvj", "--printer", printer, "--layer-um", "50"});
    const RunResult corrected =
        call({"correct", part + ".uvj", "-o", "out.uvj", "--printer", printer, "--resin",
              "resin.toml", "--speed-mm-h", "300", "--even-dead-zone", kind, "--gap-um", gap_um});
    EXPECT_EQ(corrected.exit_code, 0) << corrected.err;
    if (told != nullptr) *told = corrected.err;
    const RunResult r =
        call({"verify", "out.uvj", "--target", part + ".uvj", "--json", "-", "--quiet"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r.exit_code == 0 ? json::parse(r.out) : json();
  }
  void bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(arguments) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "no.uvj"));
  }
};

/// The dose of one slice by a sweep of the test's own, with the light of the images as they lie in the
/// archive: means over what of each cell is part.
DoseSummary swept(const std::string& stack_path, const std::string& target_path, int slice,
                  const std::string& folder) {
  const StackReader stack(stack_path, folder), target(target_path, folder);
  const EvenLight& light = *stack.info().process->even_light;
  FlowPartOptions options;
  options.pitch_um = light.pitch_um;
  options.gap_um = light.gap_um;
  const FlowPart part(target, options);
  const FlowGrid& cells = part.grid();
  const Grid& grid = stack.info().grid;
  const auto pixels = static_cast<std::size_t>(grid.width_px * grid.height_px);
  std::vector<std::uint8_t> blue(pixels), uv(pixels), covered(pixels);
  stack.read_slice(slice, blue.data());
  target.read_slice(slice, covered.data());
  const bool patterned = stack.has_uv_images();
  if (patterned) stack.read_uv_slice(slice, uv.data());
  std::vector<double> blue_sum(cells.cells(), 0), uv_sum(blue_sum), count(blue_sum);
  for (int y = 0; y < grid.height_px; ++y) {
    for (int x = 0; x < grid.width_px; ++x) {
      const auto i = static_cast<std::size_t>(y * grid.width_px + x);
      if (covered[i] == 0) continue;
      const auto cx = static_cast<int>(((x + 0.5) * 50 - cells.left_um) / cells.pitch_um);
      const auto cy = static_cast<int>(((y + 0.5) * 50 - cells.top_um) / cells.pitch_um);
      const auto c = static_cast<std::size_t>(cy * cells.columns + cx);
      blue_sum[c] += covered[i] * 200.0 * blue[i] / 255;
      uv_sum[c] += covered[i] * 275.0 * uv[i] / 255;
      count[c] += covered[i];
    }
  }
  const std::vector<double>& schedule = stack.info().process->uv.slice_mw_cm2;
  for (std::size_t c = 0; c < count.size(); ++c) {
    if (count[c] > 0) blue_sum[c] /= count[c];
    uv_sum[c] =
        patterned
            ? (count[c] > 0 ? uv_sum[c] / count[c] : 0)
            : schedule[std::min<std::size_t>(static_cast<std::size_t>(slice), schedule.size() - 1)];
  }
  const FlowSection section = part.section(static_cast<std::size_t>(part.mask_of(slice)));
  const SectionSweep sweep(section, solve_pressure(section), chapter_iv_resin2(), 300,
                           std::vector{light.gap_um});
  return summarise(section, sweep.dose(blue_sum, uv_sum));
}

TEST_F(EvenDeadZoneProgram, ADiscBecomesEvenWithBothLights) {
  std::string told;
  const json j = print("disc", "patterned.toml", "both", "120", &told);
  const json& flow = j["flow"];
  EXPECT_EQ(flow["gap_um"], 120);
  // Slices 0, 20 and the last, those half way between, and more where they did not fit; they are one section.
  ASSERT_GE(flow["slices"].size(), 5U);
  for (const json& s : flow["slices"]) {
    // As in even_dead_zone_test.
    const double within = s["within_10_percent"], ring = 1 - std::pow(1 - 0.125 / 4, 2);
    EXPECT_GT(within, 0.91 * 0.91 - 2 * ring) << s;
    EXPECT_LT(s["without"]["within_10_percent"], 0.4) << s;
    EXPECT_LT(s["window_dose"], 1) << s;
    EXPECT_GT(s["dose"]["mean"].get<double>(), 1 - 0.55 * (1 - within) - 0.01) << s;
    EXPECT_LT(s["dose"]["mean"].get<double>(), 1) << s;
    // Even dose is an even dead zone.
    const auto width = [](const json& light) {
      return light["dead_zone_um"]["max"].get<double>() -
             light["dead_zone_um"]["min"].get<double>();
    };
    EXPECT_LT(width(s), width(s["without"])) << s;
    // What verify says is what the images of the archive do: cells on the outline alone, of which it
    // leaves out those that are lit by less than a quarter, may differ: at most half of the ring, whose dose is
    // off by half. By day of the first and the last slice.
    if (!by_night() && s != flow["slices"].front() && s != flow["slices"].back()) continue;
    const DoseSummary own =
        swept(folder_ / "out.uvj", folder_ / "disc.uvj", s["slice"], folder_.path());
    EXPECT_NEAR(own.within_10, s["within_10_percent"].get<double>(), 0.02);
    EXPECT_NEAR(own.mean, s["dose"]["mean"].get<double>(), ring / 2 * 0.5);
  }
  // It prints before the flow is steady, too: light that was made for flowing resin alone would stick.
  const json& first = j["first_slices"];
  EXPECT_GE(first["slices"], 24);
  EXPECT_EQ(first["prints"], true);
  EXPECT_FALSE(first.contains("sticks"));
  EXPECT_THAT(told, HasSubstr("slices print before the flow is steady"));
  // The part itself is no worse for it: solid, nothing lost.
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_EQ(j["lost_features"], 0);
  EXPECT_EQ(j["split_features"], 0);
  // The stack says what it was made with.
  const RunResult info = call({"info", "out.uvj", "--json", "-", "--quiet"});
  const json said = json::parse(info.out);
  EXPECT_EQ(said["even_dead_zone"], "both");
  EXPECT_EQ(said["gap_um"], 120);
  EXPECT_THAT(call({"info", "out.uvj", "--quiet"}).out,
              HasSubstr("dead zone    even although resin flows, 120 um (both)\n"));
  // Whoever asks for suction gets that of this gap, and is sent to who knows the dose.
  const RunResult pulled = call({"flow", "out.uvj", "--json", "-", "--quiet"});
  ASSERT_EQ(pulled.exit_code, 0) << pulled.err;
  const json suction = json::parse(pulled.out);
  EXPECT_EQ(suction["gap_um"], 120);
  EXPECT_THAT(suction["gap_from"].get<std::string>(), HasSubstr("the light is for"));
  EXPECT_THAT(suction["no_dose"].get<std::string>(), HasSubstr("slicecorr verify"));
}

TEST_F(EvenDeadZoneProgram, ASquareBecomesMoreEvenWithBlueUnderAFlood) {
  std::string told;
  const json j = print("square", "flood.toml", "blue", "120", &told);
  const json& flow = j["flow"];
  // §8: 77 % with blue by place at this gap in Chebyshev patterns, 20 % with constant light (at 80 um).
  EXPECT_GT(flow["within_10_percent"], 0.6) << flow;
  EXPECT_LT(flow["without"]["within_10_percent"], 0.35) << flow;
  const json& s = flow["slices"][0];
  const DoseSummary own =
      swept(folder_ / "out.uvj", folder_ / "square.uvj", s["slice"], folder_.path());
  // As of the disc: cells on the outline alone may differ, half of the ring of cells of 125 um.
  const double ring = 1 - std::pow(1 - 0.125 / 4, 2);
  EXPECT_NEAR(own.within_10, s["within_10_percent"].get<double>(), ring / 2);
  EXPECT_EQ(j["undercure_voxels"], 0);
  // Those who correct are told what those who verify are.
  const RunResult seen = call({"verify", "out.uvj", "--target", "square.uvj"});
  EXPECT_THAT(seen.out, HasSubstr("by the light that the images show"));
  EXPECT_THAT(seen.out, HasSubstr("dead zone over lit pixels, if resin stood still: "));
  EXPECT_THAT(told, HasSubstr("by the light that the images show"));
}

TEST_F(EvenDeadZoneProgram, TheGapIsOneThatColumnsCanPrintWith) {
  // What comes out best where this disc's resin gels leaves a third of its voxels undercured.
  TriangleMesh disc;
  add_strut(disc, {0, 0, 0}, {0, 0, 1.0}, 3.0, 180);
  write_stl(folder_ / "small.stl", disc);
  done(
      {"slice", "small.stl", "-o", "small.uvj", "--printer", "patterned.toml", "--layer-um", "50"});
  const auto print = [&](const Command& gap) {
    const RunResult corrected =
        call(Command{"correct", "small.uvj", "-o", "out.uvj", "--printer", "patterned.toml",
                     "--resin", "resin.toml", "--speed-mm-h", "500", "--even-dead-zone", "both"} +
             gap);
    EXPECT_EQ(corrected.exit_code, 0) << corrected.err;
    const RunResult r =
        call({"verify", "out.uvj", "--target", "small.uvj", "--json", "-", "--quiet"});
    return std::pair(corrected.err, json::parse(r.out));
  };
  const auto [told, j] = print({});
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_THAT(told, HasSubstr("is taken, which leaves none"));
  // The first choice, asked for by name, is kept, and the words say what to do.
  const auto [thick, k] = print({"--gap-um", "219.8"});
  EXPECT_NEAR(k["flow"]["gap_um"].get<double>(), 219.8, 1e-9);
  EXPECT_GT(k["undercure_voxels"].get<double>(), 0.1 * k["target_voxels"].get<double>());
  EXPECT_LT(j["flow"]["gap_um"].get<double>(), 219.8);
  EXPECT_THAT(thick, HasSubstr("a thinner one"));
  EXPECT_THAT(thick, testing::Not(HasSubstr("grey levels")));
}

TEST_F(EvenDeadZoneProgram, BytesDoNotDependOnThreads) {
  done({"slice", "square.stl", "-o", "square.uvj", "--printer", "patterned.toml", "--layer-um",
        "50"});
  const Command correct{"correct",  "square.uvj", "--printer",        "patterned.toml",
                        "--resin",  "resin.toml", "--speed-mm-h",     "300",
                        "--gap-um", "120",        "--even-dead-zone", "constant",
                        "--quiet"};
  done(correct + Command{"-o", "one.uvj", "--threads", "1"});
  done(correct + Command{"-o", "four.uvj", "--threads", "4"});
  const auto bytes = [&](const char* name) {
    std::ifstream in(folder_ / name, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_EQ(bytes("one.uvj"), bytes("four.uvj"));
}

TEST_F(EvenDeadZoneProgram, WhatCannotBeIsRefused) {
  done({"slice", "square.stl", "-o", "square.uvj", "--printer", "flood.toml", "--layer-um", "50"});
  resin("thick.toml", "", kInhibition);
  resin("plain.toml", "viscosity_pa_s = 0.3\n", "");
  std::ofstream(folder_ / "dark.toml")
      << "name = \"dark\"\n[display]\nwidth_px = 260\nheight_px = 260\npixel_um = 50\n"
         "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n[stage]\nmax_speed_mm_h = 5000\n";
  printer("weak.toml", "flood", "suction_limit_pa = 50\n");
  const auto correct = [](const std::string& printer, const std::string& resin,
                          const Command& more) {
    return Command{"correct",   "square.uvj", "-o",      "no.uvj",
                   "--printer", printer,      "--resin", resin} +
           more;
  };
  const Command even{"--speed-mm-h", "300", "--even-dead-zone", "blue"};
  bad(2, correct("flood.toml", "thick.toml", even), {"thick.toml: viscosity_pa_s"});
  bad(2, correct("flood.toml", "plain.toml", even), {"--even-dead-zone", "[inhibition]"});
  bad(2, correct("dark.toml", "resin.toml", even), {"--even-dead-zone", "[uv]"});
  bad(2, correct("flood.toml", "resin.toml", {"--speed-mm-h", "300", "--even-dead-zone", "both"}),
      {"both", "floods"});
  bad(2, correct("flood.toml", "resin.toml", even + Command{"--uv-mw-cm2", "200"}),
      {"--even-dead-zone", "--uv-mw-cm2"});
  bad(2, correct("flood.toml", "resin.toml", even + Command{"--gap-um", "-3"}), {"--gap-um"});
  bad(2, correct("flood.toml", "resin.toml", {"--speed-mm-h", "300", "--even-dead-zone", "green"}),
      {"--even-dead-zone", "green"});
  bad(2,
      correct("flood.toml", "resin.toml",
              {"--mode", "layerwise", "--exposure-s", "2", "--even-dead-zone", "blue"}),
      {"an even dead zone", "layer by layer"});
  bad(3, correct("weak.toml", "resin.toml", even + Command{"--gap-um", "120"}), {"suction"});
  // What is even once the flow is steady, and sticks before: with the slice, the time and the place.
  std::ofstream(folder_ / "dim.toml")
      << "name = \"dim\"\n[display]\nwidth_px = 260\nheight_px = 260\npixel_um = 50\n"
         "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n[uv]\nkind = \"flood\"\n"
         "calibration = [[0, 0.0], [255, 100.0]]\n[stage]\nmax_speed_mm_h = 5000\n";
  bad(3,
      correct("dim.toml", "resin.toml",
              {"--speed-mm-h", "300", "--even-dead-zone", "constant", "--gap-um", "60"}),
      {"even dead zone of 60 um", "sticks to the window in slice", "less speed"});
}

TEST_F(EvenDeadZoneProgram, WhatIsLeftAloneIsKeptOffTheWindowAlthoughTheUvLampFades) {
  write_stl(folder_ / "part.stl", box({-1.5, -1.5, 0}, {1.5, 1.5, 0.6}));
  write_stl(folder_ / "post.stl", box({2.2, -0.3, 0}, {2.8, 0.3, 0.6}));
  std::ofstream(folder_ / "log.csv") << "slice,uv_lamp_share\n0,1\n5,0.95\n";
  const auto run = [](const std::string& printer, const std::string& kind, const std::string& out) {
    return Command{"run",
                   "part.stl",
                   "-o",
                   out,
                   "--printer",
                   printer,
                   "--resin",
                   "resin.toml",
                   "--layer-um",
                   "50",
                   "--speed-mm-h",
                   "300",
                   "--even-dead-zone",
                   kind,
                   "--gap-um",
                   "60",
                   "--leave-alone",
                   "post.stl",
                   "--uv-lamp-log",
                   "log.csv"};
  };
  done(run("patterned.toml", "both", "out.uvj"));
  const StackReader stack(folder_ / "out.uvj", folder_.path());
  const Grid& grid = stack.info().grid;
  const auto pixels = static_cast<std::size_t>(grid.width_px * grid.height_px);
  std::vector<std::uint8_t> blue(pixels), uv(pixels);
  // The plate's middle is that of both, 0.65 mm beside the part's: the post's lies 37 pixels beside it.
  for (int n = 0; n < 12; ++n) {
    stack.read_slice(n, blue.data());
    stack.read_uv_slice(n, uv.data());
    for (int y = 128; y < 132; ++y) {
      for (int x = 165; x < 169; ++x) {
        const auto i = static_cast<std::size_t>(y * grid.width_px + x);
        ASSERT_EQ(blue[i], 255) << n << " " << x << " " << y;
        const double comes = 275.0 * uv[i] / 255 * (n < 5 ? 1 : 0.95);
        EXPECT_GE(0.799895 * comes, 200 * (1 - 1e-9)) << n << " " << x << " " << y;
      }
    }
  }
  // With less than that no pattern can.
  std::ofstream(folder_ / "log.csv") << "slice,uv_lamp_share\n0,1\n5,0.9\n";
  bad(3, run("patterned.toml", "both", "no.uvj"),
      {"what is left alone would stick to the window in slice 5"});
}

}  // namespace
}  // namespace slicecorr
