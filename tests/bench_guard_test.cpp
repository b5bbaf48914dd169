/// scripts/bench-guard as it judges counts, without building anything; and what scripts/bench says
/// of a stored run.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <tuple>

#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using Json = nlohmann::json;

/// Debian's interpreter: what else may be called python3 takes ten times as long to begin.
constexpr const char* kPython = "/usr/bin/python3";
constexpr const char* kGuard = SLICECORR_SOURCE_DIR "/scripts/bench-guard";
constexpr const char* kBench = SLICECORR_SOURCE_DIR "/scripts/bench";

class BenchGuard : public testing::Test {
 protected:
  RunResult compare(const std::string& base, const std::string& head,
                    const std::vector<std::string>& options = {}) {
    write_file(folder_ / "base.json", to_bytes(base));
    write_file(folder_ / "head.json", to_bytes(head));
    std::vector<std::string> command{kPython, kGuard, "--counts", folder_ / "base.json",
                                     folder_ / "head.json"};
    command.insert(command.end(), options.begin(), options.end());
    return run_program(command);
  }
  RunResult bench(const Json& stored) {
    write_file(folder_ / "stored.json", to_bytes(stored.dump()));
    return run_program(
        {kPython, kBench, "--from", folder_ / "stored.json", "--out", folder_ / "out"});
  }
  TemporaryFolder folder_;
};

TEST_F(BenchGuard, EqualCountsPass) {
  const RunResult r = compare(R"({"slice": [1000, 1001]})", R"({"slice": [1000, 1000]})");
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.out.find("| slice | 0.00 | 0.00 | 1.0000 |"), std::string::npos) << r.out;
  // The spread of the base: one in a thousand.
  EXPECT_NE(r.out.find("Noise between equal runs: 0.1000 %"), std::string::npos) << r.out;
}

TEST_F(BenchGuard, GrowthBeyondTheToleranceFails) {
  const std::string base = R"({"slice": [1000000], "run": [1000000]})";
  EXPECT_EQ(compare(base, R"({"slice": [1030000], "run": [1000000]})").exit_code, 0);
  const RunResult r = compare(base, R"({"slice": [1000000], "run": [1030001]})");
  EXPECT_EQ(r.exit_code, 1) << r.err;
  EXPECT_NE(r.out.find("| run | 1.00 | 1.03 | 1.0300 | GROWN |"), std::string::npos) << r.out;
  EXPECT_NE(r.out.find("run takes 3.0 % more instructions."), std::string::npos) << r.out;
  EXPECT_EQ(compare(base, R"({"slice": [1], "run": [1030001]})", {"--tolerance", "4"}).exit_code,
            0);
  // Less in one job does not pay for more in another.
  EXPECT_EQ(compare(base, R"({"slice": [1], "run": [1040000]})").exit_code, 1);
}

TEST_F(BenchGuard, TheLeastOfSeveralCountsIsCompared) {
  EXPECT_EQ(compare(R"({"slice": [1000, 2000]})", R"({"slice": [5000, 1000]})").exit_code, 0);
  EXPECT_EQ(compare(R"({"slice": [1000, 2000]})", R"({"slice": [2000, 2000]})").exit_code, 1);
}

TEST_F(BenchGuard, JobsOfOneSideOnly) {
  // A new job has nothing to grow from; one that is gone can't be judged.
  const RunResult more = compare(R"({"slice": [10]})", R"({"slice": [10], "run": [99]})");
  EXPECT_EQ(more.exit_code, 0) << more.err;
  EXPECT_NE(more.out.find("| run | - | 0.00 | - | new |"), std::string::npos) << more.out;
  const RunResult less = compare(R"({"slice": [10], "run": [9]})", R"({"slice": [10]})");
  EXPECT_EQ(less.exit_code, 2);
  EXPECT_NE(less.err.find("no count for: run"), std::string::npos) << less.err;
}

TEST_F(BenchGuard, BadCountsAreRefusedByName) {
  const std::string good = R"({"slice": [10]})";
  // Both files are read alike: each kind of damage is in one of them, the first and the second in
  // turn.
  bool first = false;
  for (const std::string bad : {"", "{", "[]", "{}", "3", R"({"slice": []})", R"({"slice": 10})",
                                R"({"slice": [0]})", R"({"slice": [-4]})", R"({"slice": [1.5]})",
                                R"({"slice": ["10"]})", R"({"slice": [true]})"}) {
    first = !first;
    const RunResult r = first ? compare(bad, good) : compare(good, bad);
    EXPECT_EQ(r.exit_code, 2) << bad;
    EXPECT_NE(r.err.find(first ? "base.json" : "head.json"), std::string::npos) << r.err;
    EXPECT_EQ(r.err.find("Traceback"), std::string::npos) << r.err;
  }
}

TEST_F(BenchGuard, WrongUse) {
  for (const std::vector<std::string>& words : {std::vector<std::string>{},
                                                {"--counts", "a.json"},
                                                {"a", "b", "--tolerance", "-1"},
                                                {"a", "b", "--repeats", "0"},
                                                {"a", "b", "--only", "knit"}}) {
    std::vector<std::string> command{kPython, kGuard};
    command.insert(command.end(), words.begin(), words.end());
    EXPECT_EQ(run_program(command).exit_code, 2);
  }
  const RunResult unknown = run_program({kPython, kGuard, "no-such-commit", "--only", "slice"});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("no-such-commit"), std::string::npos) << unknown.err;
  // As people call them.
  EXPECT_EQ(run_program({kGuard, "--help"}).exit_code, 0);
  EXPECT_EQ(run_program({kBench, "--help"}).exit_code, 0);
}

Json measurement(const std::string& job, bool antialias, int threads,
                 const std::vector<double>& walls, double peak_mib) {
  Json runs = Json::array();
  for (const double wall : walls) {
    runs.push_back(
        {{"wall_s", wall}, {"user_s", wall}, {"system_s", 0}, {"peak_mib", peak_mib}, {"load", 0}});
  }
  return {{"part", "gyroid"},       {"display", "2k"},    {"layer_um", 10}, {"job", job},
          {"antialias", antialias}, {"threads", threads}, {"runs", runs},   {"output_bytes", 1}};
}

Json stored_run() {
  Json verified{{"layers", 1000},
                {"target_voxels", 1},
                {"printed_voxels", 1},
                {"cure_through_voxels", 0},
                {"undercure_voxels", 0}};
  return {{"machine",
           {{"date", "d"},
            {"commit", "c"},
            {"changed_since_commit", false},
            {"cpu", "a < b"},
            {"cores", 2},
            {"memory_gib", 1},
            {"system", "s"},
            {"compiler", "g"},
            {"build_type", "Release"}}},
          {"peer", "PrusaSlicer-9"},
          {"quick", false},
          {"skipped", Json::array()},
          {"wrong", Json::array()},
          {"stages", Json::array()},
          {"outputs",
           {{{"part", "gyroid"}, {"display", "2k"}, {"layer_um", 10}, {"verified", verified}}}},
          {"measurements",
           {// In pairs 12, 11 and 13 times; the medians alone would say 10.
            measurement("prusaslicer", true, 2, {12, 110, 1300}, 400),
            measurement("slice", true, 2, {1, 10, 100}, 299),
            measurement("slice", true, 1, {1.9, 19, 190}, 301),
            measurement("convert", true, 2, {2}, 10), measurement("correct", true, 2, {3.1}, 10),
            measurement("run", true, 2, {1.8432}, 10)}}};
}

TEST_F(BenchGuard, PromisesOfAStoredRun) {
  const RunResult r = bench(stored_run());
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const std::string place = ": gyroid lattice, 2560 x 1440, 10 um: ";
  for (const std::string& line :
       {"1 reached slice, antialiased" + place + "12.0 times", "2 MISSED  correct" + place + "1.55",
        "3 reached run" + place + "2.00 G voxels/s", "4 reached program slice" + place + "1.90",
        "5 reached slice, 2 threads" + place + "299 MiB",
        "5 MISSED  slice, 1 threads" + place + "301 MiB"}) {
    EXPECT_NE(r.out.find(line), std::string::npos) << line << "\n" << r.out;
  }
  const std::string svg = to_text(read_file(folder_ / "out/performance.svg"));
  EXPECT_NE(svg.find("a &lt; b"), std::string::npos);
  EXPECT_NE(svg.find("12.0 ×"), std::string::npos);
  EXPECT_FALSE(read_file(folder_ / "out/performance.md").empty());
}

TEST_F(BenchGuard, AStoredRunThatWasWrongStaysWrong) {
  Json stored = stored_run();
  stored["wrong"].push_back("slice 3 is dark");
  const RunResult r = bench(stored);
  EXPECT_EQ(r.exit_code, 1);
  EXPECT_NE(r.err.find("WRONG: slice 3 is dark"), std::string::npos) << r.err;
}

TEST_F(BenchGuard, WithoutPrusaSlicerNothingIsSaidOfIt) {
  Json stored = stored_run();
  stored["measurements"].erase(0);
  stored["peer"] = nullptr;
  const RunResult r = bench(stored);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(r.out.find("\n1 "), std::string::npos) << r.out;
  EXPECT_NE(r.out.find("without PrusaSlicer"), std::string::npos) << r.out;
}

/// scripts/bench with these words; what it says must be words, too.
RunResult bench_says(const std::vector<std::string>& words) {
  std::vector<std::string> command{kPython, kBench};
  command.insert(command.end(), words.begin(), words.end());
  const RunResult r = run_program(command);
  EXPECT_EQ(r.err.find("Traceback"), std::string::npos) << r.err;
  return r;
}

TEST_F(BenchGuard, WhatIsNoStoredRunIsRefused) {
  const std::string stored = folder_ / "stored.json";
  const RunResult missing = bench_says({"--from", stored});
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_NE(missing.err.find(stored + ": can't be read: No such file"), std::string::npos)
      << missing.err;
  EXPECT_EQ(bench_says({"--from", folder_ / "."}).exit_code, 2);
  for (const std::string bad : {"", "{", "[]", "3", "null", "{}", "\xff", R"({"slice": [10]})"}) {
    write_file(stored, to_bytes(bad));
    const RunResult r = bench_says({"--from", stored});
    EXPECT_EQ(r.exit_code, 2) << bad;
    EXPECT_NE(r.err.find(stored), std::string::npos) << r.err;
  }
}

TEST_F(BenchGuard, StoredRunsOfAnotherShapeAreRefusedByPlace) {
  using Pointer = Json::json_pointer;
  const auto refused = [&](const Json& run, const std::string& place) {
    write_file(folder_ / "stored.json", to_bytes(run.dump()));
    const RunResult r = bench_says({"--from", folder_ / "stored.json"});
    EXPECT_EQ(r.exit_code, 2) << place;
    EXPECT_NE(r.err.find(place), std::string::npos) << r.err;
    EXPECT_EQ(r.out, "");
  };
  for (const char* key : {"machine", "peer", "quick", "measurements", "outputs", "stages"}) {
    Json run = stored_run();
    run.erase(key);
    refused(run, std::string("no '") + key + "'");
  }
  const std::vector<std::tuple<std::string, Json, std::string>> changes{
      {"/machine/cores", 0, "machine.cores: 0"},
      {"/machine/cpu", 7, "machine.cpu"},
      {"/measurements", Json::object(), "measurements: expected a list"},
      {"/measurements/0/part", "teapot", "measurements[0].part: 'teapot'"},
      {"/measurements/1/runs", Json::array(), "measurements[1].runs"},
      {"/measurements/1/runs/2/wall_s", 0, "measurements[1].runs[2].wall_s: 0"},
      {"/measurements/1/runs/2/peak_mib", true, "measurements[1].runs[2].peak_mib"},
      {"/outputs/0/verified/layers", "many", "outputs[0].verified.layers"},
      {"/stages", {{{"program", "stages"}, {"name", "run"}, {"runs", {1}}}}, "stages[0].runs"},
  };
  for (const auto& [at, value, place] : changes) {
    Json run = stored_run();
    run[Pointer(at)] = value;
    refused(run, place);
  }
}

TEST_F(BenchGuard, PortionsOfOtherMachinesAreNotJoined) {
  Json other = stored_run();
  other["machine"]["cores"] = 4;
  write_file(folder_ / "a.json", to_bytes(stored_run().dump()));
  write_file(folder_ / "b.json", to_bytes(other.dump()));
  const RunResult r = bench_says({"--from", folder_ / "a.json", "--from", folder_ / "b.json"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_NE(r.err.find("differ in cores: 2 and 4"), std::string::npos) << r.err;
}

TEST_F(BenchGuard, FoldersThatAreNotThere) {
  const std::string nowhere = folder_ / "nowhere";
  const RunResult data = bench_says({"--data", nowhere});
  EXPECT_EQ(data.exit_code, 2);
  EXPECT_NE(data.err.find("--data: no folder " + nowhere), std::string::npos) << data.err;
  const RunResult build = bench_says({"--build", nowhere});
  EXPECT_EQ(build.exit_code, 2);
  EXPECT_NE(build.err.find("no " + nowhere + "/bin/slicecorr"), std::string::npos) << build.err;
  EXPECT_EQ(bench_says({"--json", nowhere + "/out.json"}).exit_code, 2);
  write_file(folder_ / "file", to_bytes("x"));
  EXPECT_EQ(bench_says({"--out", folder_ / "file"}).exit_code, 2);
}

/// A build folder whose programs are scripts.
class BenchOfSubstitutes : public BenchGuard {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(folder_ / "build/bin");
    write_file(folder_ / "build/CMakeCache.txt", to_bytes("CMAKE_BUILD_TYPE:STRING=Release\n"));
    // As many bytes as the gyroid has.
    script("make_part", "truncate -s $((84 + 50 * 317084)) \"$2\"");
    script("compare_slices", "echo '" + std::string(kComparison) + "'");
    script("stages", "exit 3");
    script("codec", "exit 3");
    slicecorr("echo '" + std::string(kFigures) + "'");
  }
  /// `figures` prints what `run` and `verify` write.
  void slicecorr(const std::string& figures) {
    script("slicecorr", "figures() { " + figures +
                            "; }\n"
                            "while [ $# -gt 0 ]; do\n"
                            "  case $1 in\n"
                            "    -o) echo slices > \"$2\"; case $2 in */run.uvj) figures > "
                            "\"${2%.uvj}.json\" ;; esac ;;\n"
                            "    --json) figures > \"$2\" ;;\n"
                            "  esac\n"
                            "  shift\n"
                            "done");
  }
  void script(const std::string& name, const std::string& body) {
    const std::string path = folder_ / ("build/bin/" + name);
    write_file(path, to_bytes("#!/bin/sh\n" + body + "\n"));
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  }
  RunResult measure() {
    return bench_says({"--build", folder_ / "build", "--only", "gyroid", "--quick", "--no-stages",
                       "--no-peer", "--out", folder_ / "out"});
  }
  static constexpr const char* kComparison =
      R"({"slices": 3, "triangles": 4, "bands": 5, "samples": [], "wrong": []})";
  static constexpr const char* kFigures =
      R"({"layers": 3, "target_voxels": 9, "printed_voxels": 9, "cure_through_voxels": 0,)"
      R"( "undercure_voxels": 0, "uncorrected": {"layers": 3, "target_voxels": 9,)"
      R"( "printed_voxels": 9, "cure_through_voxels": 1, "undercure_voxels": 0}})";
};

TEST_F(BenchOfSubstitutes, AreMeasured) {
  const RunResult r = measure();
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.out.find("run: gyroid lattice"), std::string::npos) << r.out;
}

TEST_F(BenchOfSubstitutes, OutputsThatCantBeReadAreWrong) {
  for (const char* figures : {"echo nothing", "true", "echo []", R"(echo '{"layers": 3}')",
                              R"(echo '{"layers": "3"}')"}) {
    slicecorr(figures);
    const RunResult r = measure();
    EXPECT_EQ(r.exit_code, 1) << figures;
    EXPECT_NE(r.err.find("WRONG: gyroid lattice, 2560 x 1440, 50 um: "), std::string::npos)
        << r.err;
    EXPECT_NE(r.err.find("/run.json: "), std::string::npos) << r.err;
  }
}

TEST_F(BenchOfSubstitutes, ProgramsThatSayNothingAreWrong) {
  for (const char* body : {"echo 3", "true", "echo '{'", "echo damaged >&2; exit 2"}) {
    script("compare_slices", body);
    const RunResult r = measure();
    EXPECT_EQ(r.exit_code, 1) << body;
    EXPECT_NE(r.err.find("WRONG: gyroid lattice"), std::string::npos) << r.err;
  }
  SetUp();
  script("slicecorr", "true");
  const RunResult nothing = measure();
  EXPECT_EQ(nothing.exit_code, 1);
  EXPECT_NE(nothing.err.find("on.uvj: was not written"), std::string::npos) << nothing.err;
  script("make_part", "echo short > \"$2\"");
  const RunResult part = measure();
  EXPECT_EQ(part.exit_code, 1);
  EXPECT_NE(part.err.find("did not write 317084 triangles"), std::string::npos) << part.err;
}

}  // namespace
}  // namespace slicecorr::test
