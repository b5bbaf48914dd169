// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `tomo solve` and `tomo verify` as a user calls them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "stack_fixture.hpp"
#include "tomo_definitions.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

/// Debian's interpreter: the one that its package python3-numpy serves.
constexpr const char* kPython = "/usr/bin/python3";

class TomoProgram : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  void SetUp() override {
    test::write_file(path("bench.toml"), test::to_bytes(test::bench_printer_toml(true)));
    test::write_file(path("resin.toml"), test::to_bytes(test::bench_resin_toml("0.5")));
    Box<std::uint8_t> part{3, 33, 33, std::vector<std::uint8_t>(3 * 33 * 33)};
    for (int z = 0; z < 3; ++z) {
      for (int y = 12; y < 21; ++y) {
        for (int x = 12; x < 21 - 2 * z; ++x) part.values[part.at(z, y, x)] = 255;
      }
    }
    write_npy(path("part.npy"), part);
  }
  /// The sum over the job's frames in Python gives the doses of d.npy.
  void expect_python_agrees(const std::string& job) const {
    test::RunOptions options;
    options.folder = folder_.path();
    const test::RunResult python = test::run_program(
        {kPython, SLICECORR_SOURCE_DIR "/tests/tomo_direct_sum.py", job, "p.npy"}, options);
    ASSERT_EQ(python.exit_code, 0) << python.out << python.err;
    const Box<float> ours = read_dose_npy(path("d.npy")), theirs = read_dose_npy(path("p.npy"));
    double largest = 0, off = 0;
    for (int y = 0; y < ours.ny; ++y) {
      for (int x = 0; x < ours.nx; ++x) {
        const std::size_t at = ours.at(0, y, x);
        largest = std::max<double>(largest, theirs.values[at]);
        off = std::max<double>(off, std::abs(ours.values[at] - theirs.values[at]));
      }
    }
    EXPECT_GT(largest, 20.0);
    // Eight points along each side of a voxel: a point sees the one or the other of two pixels, which is wrong by a sixteenth
    // of a voxel at most, alike in all directions on the axis alone.
    EXPECT_LE(off, 0.015 * largest);
  }
  test::RunResult call(const std::vector<std::string>& words) const {
    test::RunOptions options;
    options.folder = folder_.path();
    std::vector<std::string> command{SLICECORR_BIN_DIR "/slicecorr", "--quiet", "tomo"};
    command.insert(command.end(), words.begin(), words.end());
    return test::run_program(command, options);
  }
  std::vector<std::string> solve(const std::string& to) const {
    return {"solve",     "--volume",   "part.npy", "--voxel-mm", "0.25",
            "--printer", "bench.toml", "--resin",  "resin.toml", "-o",
            to,          "--angles",   "60",       "--json",     "-"};
  }
  test::TemporaryFolder folder_;
};

TEST_F(TomoProgram, SolveAndVerifyAgreeAndSoDoesADirectSumInPython) {
  const test::RunResult solved = call(solve("a.frames"));
  ASSERT_EQ(solved.exit_code, 0) << solved.err;
  const auto figures = nlohmann::json::parse(solved.out);
  EXPECT_EQ(figures["feasible"], true);
  EXPECT_EQ(figures["ver"], 0.0);
  const test::RunResult verified = call({"verify", "a.frames", "--dose", "d.npy", "--json", "-"});
  ASSERT_EQ(verified.exit_code, 0) << verified.err;
  auto again = nlohmann::json::parse(verified.out);
  again["contrast_bound"] = figures["contrast_bound"];  // only the solve knows
  // And only verify looks at the middles of voxels, some of which edges of pixels leave short.
  EXPECT_EQ(again["gel_below_dose"]["means"], 0.0);
  EXPECT_GE(again["gel_below_dose"]["centres"], 0.0);
  EXPECT_LE(again["gel_below_dose"]["centres"], 1.0);
  EXPECT_TRUE(figures["gel_below_dose"]["centres"].is_null());
  again["gel_below_dose"]["centres"] = nullptr;
  EXPECT_EQ(again, figures);
  EXPECT_EQ(call(solve("b.frames")).exit_code, 0);
  EXPECT_EQ(test::read_file(path("a.frames")), test::read_file(path("b.frames")));

  expect_python_agrees("a.frames");
}

TEST_F(TomoProgram, FramesOfACrookedMachineAreSummedTheSameInPython) {
  const test::Bytes bytes = test::read_file(path("bench.toml"));
  const std::string straight(bytes.begin(), bytes.end());
  std::string table = "angle_deg,right_px,up_px\n";
  for (int k = 0; k < 24; ++k) {
    table += fmt::format("{},{:.3f},{:.1f}\n", 15 * k, 0.8 * std::sin(0.9 * k), (k % 4) * 0.7 - 1);
  }
  test::write_file(path("wobble.csv"), test::to_bytes(table));
  GreyImage flat{48, 40, {}};
  for (int i = 0; i < 48 * 40; ++i) {
    flat.pixels.push_back(static_cast<std::uint8_t>(120 + 2 * (i % 48) + i / 48));
  }
  const auto png = encode_png(flat);
  test::write_file(path("flat.png"), png);
  const auto with = [&](const std::string& optics, const std::string& display) {
    std::string text = straight;
    text.replace(text.find("[rotation]\n"), 11, optics + "[rotation]\nwobble = \"wobble.csv\"\n");
    text.replace(text.find("bit_depth"), 0, display);
    test::write_file(path("bench.toml"), test::to_bytes(text));
  };
  for (const bool leaning : {true, false}) {
    with(leaning ? "tilt_deg = 4\naxis_right_px = 0.4\n" : "",
         leaning ? "" : "flat_field = \"flat.png\"\nflat_field_reference = 200\n");
    // Any light will do.
    auto words = solve("a.frames");
    words.insert(words.end(), {"--method", "osmo", "--iterations", "10", "--at-mm", "0.75,-0.5,1"});
    const test::RunResult solved = call(words);
    ASSERT_LE(solved.exit_code, 5) << solved.err;
    ASSERT_NE(solved.exit_code, 2) << solved.err;
    const test::RunResult verified = call({"verify", "a.frames", "--dose", "d.npy", "--json", "-"});
    EXPECT_EQ(verified.exit_code, solved.exit_code) << verified.err;
    expect_python_agrees("a.frames");
  }
}

TEST_F(TomoProgram, APartIsPrintedAroundAnInsert) {
  // A ring of 1 to 2 mm around a rod of 0.5 mm beside the middle.
  Box<std::uint8_t> part{3, 33, 33, std::vector<std::uint8_t>(3 * 33 * 33)}, rod = part;
  for (int z = 0; z < 3; ++z) {
    for (int y = 0; y < 33; ++y) {
      for (int x = 0; x < 33; ++x) {
        const double r = std::hypot(x - 16, y - 16);
        if (r >= 4 && r < 8) part.values[part.at(z, y, x)] = 255;
        if (std::hypot(x - 17, y - 16) < 2.2 && z < 2) rod.values[rod.at(z, y, x)] = 1;
      }
    }
  }
  write_npy(path("part.npy"), part);
  write_npy(path("rod.npy"), rod);
  auto words = solve("a.frames");
  words.insert(words.end(), {"--insert", "rod.npy"});
  const test::RunResult solved = call(words);
  ASSERT_EQ(solved.exit_code, 0) << solved.out << solved.err;
  const auto figures = nlohmann::json::parse(solved.out);
  EXPECT_EQ(figures["ver"], 0.0);
  EXPECT_EQ(figures["jaccard"]["dose"], 1.0);
  const TomoJob job = read_job(path("a.frames"));
  EXPECT_EQ(job.insert.values, rod.values);
  EXPECT_EQ(figures["gel_voxels"].get<std::size_t>(),
            static_cast<std::size_t>(std::count(part.values.begin(), part.values.end(), 255)));
  const test::RunResult verified = call({"verify", "a.frames", "--dose", "d.npy", "--json", "-"});
  ASSERT_EQ(verified.exit_code, 0) << verified.err;
  EXPECT_EQ(nlohmann::json::parse(verified.out)["contrast"], figures["contrast"]);
  expect_python_agrees("a.frames");
  // Without its insert the same frames print something else.
  TomoJob without = job;
  without.insert = {};
  EXPECT_NE(dose_of(without).values, dose_of(job).values);

  // A mesh beside a mesh, turned and scaled alike.
  for (const std::string name : {"part.off", "rod.off"}) {
    const double h = name == "part.off" ? 0.1 : 0.02, x = name == "part.off" ? 0 : 0.16;
    std::string text = "OFF\n8 12 0\n";
    const TriangleMesh mesh = box_mesh({x - h, -h, -0.05}, {x + h, h, 0.05});
    for (const Point3& v : mesh.vertices) text += fmt::format("{} {} {}\n", v[0], v[1], v[2]);
    for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
    test::write_file(path(name), test::to_bytes(text));
  }
  const test::RunResult meshes = call(
      {"solve",  "part.off",   "--insert", "rod.off",   "--scale",      "10",      "--rotate-deg",
       "0,0,90", "--voxel-mm", "0.25",     "--printer", "bench.toml",   "--resin", "resin.toml",
       "-o",     "m.frames",   "--angles", "60",        "--iterations", "20"});
  ASSERT_THAT(meshes.exit_code, testing::AnyOf(0, 5)) << meshes.err;
  const TomoJob turned = read_job(path("m.frames"));
  // The rod of 0.4 mm stood at x = 1.6 mm of the part: now at y, in voxel 22.
  EXPECT_GT(turned.insert.values[turned.insert.at(1, 22, 16)], 0);
  EXPECT_EQ(turned.insert.values[turned.insert.at(1, 16, 22)], 0);
}

TEST_F(TomoProgram, InsertsThatCanNotBeAreRefused) {
  Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  const auto with = [&](const std::string& name, auto&& opaque) {
    Box<std::uint8_t> insert{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
    for (int y = 0; y < 33; ++y) {
      for (int x = 0; x < 33; ++x) {
        insert.values[insert.at(0, y, x)] = opaque(x - 16, y - 16) ? 255 : 0;
      }
    }
    write_npy(path(name), insert);
    auto words = solve("a.frames");
    words.insert(words.end(), {"--insert", name});
    const test::RunResult result = call(words);
    EXPECT_FALSE(std::filesystem::exists(path("a.frames")));
    return result;
  };
  for (int y = 14; y < 19; ++y) {
    for (int x = 14; x < 19; ++x) part.values[part.at(0, y, x)] = 255;
  }
  write_npy(path("part.npy"), part);
  test::RunResult r = with("in.npy", [](int x, int y) { return x == 2 && y == -1; });
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("slice 0: voxel 18, 15 is part and insert at once"));
  r = with("out.npy", [](int x, int y) { return x == 16 && y == 16; });
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("the insert reaches 5.657 mm from the axis"));
  r = with("wall.npy", [](int x, int y) { return std::hypot(x, y) > 5 && std::hypot(x, y) < 8; });
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("the part's voxel 14, 14 in slice 0 is lit from no angle"));
  write_npy(path("two.npy"), Box<std::uint8_t>{2, 33, 33, std::vector<std::uint8_t>(2 * 33 * 33)});
  auto words = solve("a.frames");
  words.insert(words.end(), {"--insert", "two.npy"});
  r = call(words);
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("two.npy: has 33 x 33 x 2 voxels, the part 33 x 33 x 1"));
}

/// A solve that is killed, or stopped, goes on to the bytes of one that was not.
TEST_F(TomoProgram, GoesOnWhereItWasStopped) {
  const std::string left = path("a.frames.resume");
  for (const std::string method : {"osmo", "ladder"}) {
    const auto words = [&](const std::string& to, const std::vector<std::string>& more) {
      auto all = solve(to);
      all.insert(all.end(), {"--method", method, "--iterations", method == "osmo" ? "150" : "60"});
      all.insert(all.end(), more.begin(), more.end());
      return all;
    };
    ASSERT_THAT(call(words("whole.frames", {})).exit_code, testing::AnyOf(0, 5));
    for (const int signal : {SIGKILL, SIGINT}) {
      // By day each method and each signal once.
      if (!test::by_night() && (method == "osmo") != (signal == SIGKILL)) continue;
      SCOPED_TRACE(method + ", signal " + std::to_string(signal));
      test::RunOptions options;
      options.folder = folder_.path();
      options.signal = signal;
      options.signal_when = [&](const std::string&, const std::string&) {
        return std::filesystem::exists(left);
      };
      std::vector<std::string> command{SLICECORR_BIN_DIR "/slicecorr", "tomo"};
      for (const std::string& word : words("a.frames", {"--checkpoint-s", "0"})) {
        command.push_back(word);
      }
      const test::RunResult stopped = test::run_program(command, options);
      ASSERT_TRUE(stopped.signalled);
      EXPECT_EQ(stopped.exit_code, signal == SIGKILL ? 128 + SIGKILL : 130);
      EXPECT_TRUE(std::filesystem::exists(left));
      EXPECT_FALSE(std::filesystem::exists(path("a.frames")));
      if (signal == SIGINT) {
        EXPECT_THAT(stopped.err, HasSubstr("--resume goes on from there"));
      }

      // Of another solve it is refused, and stays.
      auto other = words("a.frames", {"--resume"});
      *(std::find(other.begin(), other.end(), "--angles") + 1) = "61";
      test::RunResult refused = call(other);
      EXPECT_EQ(refused.exit_code, 2);
      EXPECT_THAT(refused.err,
                  testing::AllOf(HasSubstr("a.frames.resume: is of a solve with another printer, "
                                           "resin, number of angles or size of voxels"),
                                 HasSubstr("a solve that does not go on from it starts anew")));
      other = words("a.frames", {"--resume", "--window", "ram-lak"});
      EXPECT_THAT(call(other).err, HasSubstr("of a solve with other options"));
      EXPECT_TRUE(std::filesystem::exists(left));

      EXPECT_THAT(call(words("a.frames", {"--resume"})).exit_code, testing::AnyOf(0, 5));
      EXPECT_EQ(test::read_file(path("a.frames")), test::read_file(path("whole.frames")));
      EXPECT_FALSE(std::filesystem::exists(left));
      std::filesystem::remove(path("a.frames"));
    }
  }
  // Without anything to go on from it starts anew.
  const auto quick = [&](const std::string& to) {
    auto all = solve(to);
    all.insert(all.end(), {"--method", "osmo", "--iterations", "10"});
    return all;
  };
  auto anew = quick("a.frames");
  anew.push_back("--resume");
  EXPECT_THAT(call(anew).exit_code, testing::AnyOf(0, 5));
  EXPECT_THAT(call(quick("b.frames")).exit_code, testing::AnyOf(0, 5));
  EXPECT_EQ(test::read_file(path("a.frames")), test::read_file(path("b.frames")));
  // Damage is told.
  test::write_file(left, test::to_bytes("slicecorr tomo solve 1\nand nothing else"));
  const test::RunResult damaged = call(anew);
  EXPECT_EQ(damaged.exit_code, 2);
  EXPECT_THAT(damaged.err, HasSubstr("a.frames.resume: is damaged"));
}

TEST_F(TomoProgram, WrongUseIsToldByName) {
  EXPECT_EQ(call({}).exit_code, 2);
  EXPECT_EQ(call({"print"}).exit_code, 2);
  const test::RunResult neither =
      call({"solve", "--printer", "bench.toml", "--resin", "resin.toml", "-o", "a.frames"});
  EXPECT_EQ(neither.exit_code, 2);
  EXPECT_THAT(neither.err, HasSubstr("--volume"));
  auto beside = solve("a.frames");
  beside.insert(beside.end(), {"--center-mm", "1,1"});
  EXPECT_THAT(call(beside).err, HasSubstr("--center-mm"));
  // Voxels are not turned or scaled, and have one size.
  for (const std::vector<std::string>& more : {std::vector<std::string>{"--scale", "2"},
                                               {"--fit-mm", "9"},
                                               {"--rotate-deg", "0,0,90"},
                                               {"--units", "inch"},
                                               {"--layer-um", "300"}}) {
    auto turned = solve("a.frames");
    turned.insert(turned.end(), more.begin(), more.end());
    const test::RunResult r = call(turned);
    EXPECT_EQ(r.exit_code, 2) << more[0];
    EXPECT_THAT(r.err, HasSubstr(more[0]));
  }
  auto clipped = solve("a.frames");
  clipped.insert(clipped.end(), {"--clip-sigma", "3"});
  EXPECT_THAT(call(clipped).err, HasSubstr("expected --method osmo"));
  clipped.insert(clipped.end(), {"--method", "osmo", "--stop-error", "0.005"});
  EXPECT_THAT(call(clipped).exit_code, testing::AnyOf(0, 5));
  std::filesystem::remove(path("a.frames"));
  EXPECT_EQ(call({"verify", "part.npy"}).exit_code, 2);
  EXPECT_EQ(call({"verify", "none.frames"}).exit_code, 2);
  auto slow = solve("a.frames");
  slow.insert(slow.end(), {"--max-time-s", "1"});
  const test::RunResult late = call(slow);
  EXPECT_EQ(late.exit_code, 3);
  EXPECT_THAT(late.err, HasSubstr("a turn of 14.4 s at least, longer than the 1 s allowed"));
  EXPECT_FALSE(std::filesystem::exists(path("a.frames")));
}

/// Jobs that lost something, or that others made.
TEST_F(TomoProgram, DamagedJobsAreRefusedByName) {
  TomoJob job = random_job(bench_printer(), 5, 24);
  job.insert = job.part;
  for (std::size_t i = 0; i < job.insert.values.size(); ++i) {
    job.insert.values[i] = job.part.values[i] == 0 && i % 5 == 0 ? 7 : 0;
  }
  write_job(path("a.frames"), job);
  // A change, in which `f` maps names to contents, and what is said of it.
  const std::vector<std::pair<std::string, std::string>> changes = {
      {"pass", ""},
      {"del f['insert/00000003.png']", "insert/00000003.png: is missing"},
      {"c['insert'] = False", "insert is false, expected true"},
      {"del f['part/00000002.png']", "part/00000002.png: is missing"},
      {"del f['config.json']", "config.json: is missing"},
      {"del f['frame/00000007.png']", "frame/: has 23 images; expected 24, one per angle"},
      {"f['frame/00000024.png'] = f.pop('frame/00000007.png')", "frame/00000007.png: is missing"},
      {"f['frame/00000007.png'] = f['part/00000000.png']", "frame/00000007.png: "},
      {"f['frame/00000007.png'] = b'no picture'", "frame/00000007.png: "},
      {"c['format'] = 2", "has format 2; this program knows up to 1"},
      {"c['voxels'][1] += 2", "voxels"},
      {"c['turns'] = 0", "turns is 0"},
      {"c['turns'] += 1", "what it says was changed after the job was made (checksum)"},
      {"c['turn_s'] *= 2", "turn_s is "},
      {"del c['turn_s']", "turn_s is missing"},
      {"c['pitch_mm'] *= 2", "pitch_mm is "},
      {"del c['pitch_mm']", "pitch_mm is missing"},
      {"c['direction'] = 'cw' if c['direction'] == 'ccw' else 'ccw'", "direction is "},
      {"del c['direction']", "direction is missing"},
      {"c['calibration'][0][1] += 1", "calibration[0][1] is "},
      {"c['resin']['name'] = 'x'", "what it says was changed"},
      {"n = sorted(x for x in f if x.startswith('frame/')); "
       "f.update(zip(n, [f[x] for x in reversed(n)]))",
       "its images were changed after the job was made (checksum)"},
      {"f['frame/00000003.png'], f['frame/00000004.png'] = f['frame/00000004.png'], "
       "f['frame/00000003.png']",
       "its images were changed"},
      {"f.update({x: f['frame/00000003.png'] for x in f if x.startswith('frame/')})",
       "its images were changed"},
      {"f['part/00000002.png'] = f['part/00000003.png']; f['part/00000003.png'] = "
       "f['part/00000001.png']",
       ""},
      {"del c['printer']['rotation']", "rotation"}};
  test::RunOptions options;
  options.folder = folder_.path();
  test::Command command{kPython, "-c",
                        "import json, sys, zipfile\n"
                        "for i, change in enumerate(sys.argv[1:]):\n"
                        "    z = zipfile.ZipFile('a.frames')\n"
                        "    f = {n: z.read(n) for n in z.namelist()}\n"
                        "    c = json.loads(f['config.json'])\n"
                        "    exec(change)\n"
                        "    if 'config.json' in f: f['config.json'] = json.dumps(c)\n"
                        "    z = zipfile.ZipFile('%d.frames' % i, 'w')\n"
                        "    for n in f: z.writestr(n, f[n])\n"
                        "    z.close()\n"};
  for (const auto& [change, said] : changes) command.push_back(change);
  const test::RunResult made = test::run_program(command, options);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const test::RunResult verified = call({"verify", std::to_string(i) + ".frames"});
    EXPECT_EQ(verified.exit_code, i == 0 ? 5 : 2) << changes[i].first;
    if (i == 0) {
      EXPECT_EQ(verified.err, "");
    } else {
      EXPECT_THAT(verified.err, HasSubstr(changes[i].second)) << changes[i].first;
    }
  }
}

/// Light from a point: all commands take the job.
TEST_F(TomoProgram, APinholeGoesAllTheWay) {
  const auto bytes = test::read_file(path("bench.toml"));
  std::string text(bytes.begin(), bytes.end());
  const std::string from = "kind = \"telecentric\"";
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, from.size(),
               "kind = \"pinhole\"\ndistance_mm = 100\nhalf_angle_deg = 1\nrays_per_pixel = 3");
  // Blurred, with gaps between pixels, in a tank.
  text.replace(text.find("[blue]\n"), 7, "[blue]\nspread = [[80, 0.8], [300, 0.2]]\n");
  text.replace(text.find("bit_depth"), 0, "fill_factor = 0.8\n");
  text.replace(text.find("n_outside = 1.0\n"), 16, "");
  text += "[bath]\nwindow_mm = 20\nn = 1.5\nwall_mm = 2\n";
  test::write_file(path("bench.toml"), test::to_bytes(text));
  auto words = solve("a.frames");
  words.insert(words.end(), {"--method", "osmo", "--beyond-reach"});
  const test::RunResult r = call(words);
  EXPECT_THAT(r.exit_code, testing::AnyOf(0, 5)) << r.err;
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"verify", path("a.frames"), "--json", "-"},
        {"section", path("a.frames"), "-o", path("a.png")},
        {"report", path("a.frames"), "-o", path("a.html")},
        {"video", path("a.frames"), "-o", path("a.y4m")}}) {
    const test::RunResult done = call(more);
    EXPECT_THAT(done.exit_code, testing::AnyOf(0, 5)) << more.front() << ": " << done.err;
  }
  for (const char* name : {"a.png", "a.html", "a.y4m"}) {
    EXPECT_TRUE(std::filesystem::exists(path(name))) << name;
  }
}

/// Each refusal with its exit code: 2 what was asked for is wrong, 3 it can't be printed.
TEST_F(TomoProgram, RefusalsHaveTheirExitCodes) {
  const auto with = [&](const std::string& file, const std::string& from, const std::string& to,
                        std::vector<std::string> more, int code) {
    const auto bytes = test::read_file(path(file));
    std::string text(bytes.begin(), bytes.end());
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    test::write_file(path(file), test::to_bytes(text.replace(at, from.size(), to)));
    auto words = solve("a.frames");
    words.insert(words.end(), more.begin(), more.end());
    const test::RunResult r = call(words);
    test::write_file(path(file), bytes);
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_FALSE(std::filesystem::exists(path("a.frames")));
    EXPECT_FALSE(std::filesystem::exists(path("a.frames.resume")));
    return r.err;
  };
  EXPECT_THAT(with("resin.toml", "absorption_per_cm = 0.5", "absorption_per_cm = 7.5", {}, 3),
              HasSubstr("no light prints this part"));
  EXPECT_THAT(with("bench.toml", "[0, 0.002]", "[0, 0.5]", {}, 3),
              HasSubstr("black light alone gels void"));
  EXPECT_THAT(with("resin.toml", "gel_dose_mj_cm3 = 20.0",
                   "gel_dose_mj_cm3 = 20.0\ninhibition_resupply_mj_cm3_s = 10.0", {}, 3),
              HasSubstr("inhibitor comes back"));
  EXPECT_THAT(with("resin.toml", "gel_dose_mj_cm3 = 20.0",
                   "gel_dose_mj_cm3 = 20.0\ndose_diffusion_m2_s = 1e-6", {}, 3),
              HasSubstr("in which its dose spreads by"));
  EXPECT_THAT(with("resin.toml", "gel_dose_mj_cm3 = 20.0",
                   "gel_dose_mj_cm3 = 20.0\ndose_diffusion_m2_s = -1e-12", {}, 2),
              HasSubstr("cure.dose_diffusion_m2_s: is -1e-12"));
  EXPECT_THAT(with("resin.toml", "gel_dose_mj_cm3 = 20.0", "gel_dose_mj_cm3 = 2000.0",
                   {"--max-time-s", "15"}, 3),
              testing::AllOf(HasSubstr("printing takes"), HasSubstr("turns")));
  EXPECT_THAT(with("bench.toml", "[[0, 0.002], [255, 2.0]]", "[[0, 2.0], [255, 2.0]]", {}, 2),
              HasSubstr("expected a calibration that rises"));
  EXPECT_THAT(with("bench.toml", "max_fps = 60", "max_fps = 4", {}, 2),
              HasSubstr("shows 57 frames in a turn at most, not 60"));
  EXPECT_THAT(with("bench.toml", "telecentric", "pinhole\"\ndistance_mm = 4\n#", {}, 2),
              HasSubstr("distance_mm"));
  EXPECT_THAT(with("bench.toml", "inner_mm = 4.0", "inner_mm = 4.5", {}, 2),
              HasSubstr("vial.inner_mm"));
  EXPECT_THAT(with("bench.toml", "direction = \"counterclockwise\"\n", "", {}, 2),
              HasSubstr("rotation.direction: missing"));
  EXPECT_THAT(with("bench.toml", "height_px = 40", "height_px = 2", {}, 2),
              HasSubstr("0.5 mm high"));
  EXPECT_THAT(
      with("bench.toml", "outer_mm = 4.5\ninner_mm = 4.0", "outer_mm = 0.9\ninner_mm = 0.8", {}, 2),
      HasSubstr("the resin ends at 0.8 mm"));
  EXPECT_THAT(
      with("bench.toml", "outer_mm = 4.5\ninner_mm = 4.0", "outer_mm = 2\ninner_mm = 1.9", {}, 2),
      testing::AllOf(HasSubstr("light from all directions 1.333 mm"),
                     HasSubstr("scaled by at most"), HasSubstr("beyond that reach")));
}

}  // namespace
}  // namespace slicecorr::tomo
