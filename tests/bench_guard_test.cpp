// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// scripts/bench-guard as it judges counts, without building anything; and what scripts/bench says
/// of a stored run.
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
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

/// Reads the script argv[1] with its modules once, then runs it in a process forked for each list of
/// words in argv[2]. Prints exit code, stdout and stderr of each.
constexpr const char* kForEach = R"(
import json, os, sys, tempfile, traceback
script, lines = sys.argv[1], json.loads(sys.argv[2])
with open(script) as file:
    code = compile(file.read(), script, "exec")
exec(code, {"__name__": "imported", "__file__": script})
said = []
for words in lines:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            sys.argv = [script, *words]
            status = 1
            try:
                exec(code, {"__name__": "__main__", "__file__": script})
            except SystemExit as end:
                status = end.code
            except BaseException:
                traceback.print_exc()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
        said.append([status, *texts])
print(json.dumps(said))
)";

/// The script with each of these lists of words. What it says must be words, too.
std::vector<RunResult> run_each(const char* script, const std::vector<Command>& lines) {
  const RunResult all = run_program({kPython, "-c", kForEach, script, Json(lines).dump()});
  std::vector<RunResult> results(lines.size());
  EXPECT_EQ(all.exit_code, 0) << all.err;
  if (all.exit_code != 0) return results;
  const Json said = Json::parse(all.out);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    results[i].exit_code = said.at(i).at(0).get<int>();
    results[i].out = said.at(i).at(1).get<std::string>();
    results[i].err = said.at(i).at(2).get<std::string>();
    EXPECT_EQ(results[i].err.find("Traceback"), std::string::npos) << results[i].err;
  }
  return results;
}

class BenchGuard : public testing::Test {
 protected:
  /// Counts of two sides and what else is said.
  struct Counts {
    std::string base, head;
    Command options = {};
  };
  std::vector<RunResult> compare(const std::vector<Counts>& all) {
    std::vector<Command> lines;
    for (const Counts& c : all) {
      const std::string number = std::to_string(lines.size());
      const std::string base = folder_ / (number + "-base.json");
      const std::string head = folder_ / (number + "-head.json");
      write_file(base, to_bytes(c.base));
      write_file(head, to_bytes(c.head));
      lines.push_back(Command{"--counts", base, head} + c.options);
    }
    return run_each(kGuard, lines);
  }
  RunResult bench(const Json& stored) {
    write_file(folder_ / "stored.json", to_bytes(stored.dump()));
    return run_program(
        {kPython, kBench, "--from", folder_ / "stored.json", "--out", folder_ / "out"});
  }
  TemporaryFolder folder_;
};

TEST_F(BenchGuard, EqualCountsPass) {
  const RunResult r =
      compare({{R"({"slice": [1000, 1001]})", R"({"slice": [1000, 1000]})"}}).front();
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.out.find("| slice | 0.00 | 0.00 | 1.0000 |"), std::string::npos) << r.out;
  // The spread of the base: one in a thousand.
  EXPECT_NE(r.out.find("Noise between equal runs: 0.1000 %"), std::string::npos) << r.out;
}

TEST_F(BenchGuard, GrowthBeyondTheToleranceFails) {
  const std::string base = R"({"slice": [1000000], "run": [1000000]})";
  const auto results = compare({{base, R"({"slice": [1030000], "run": [1000000]})"},
                                {base, R"({"slice": [1000000], "run": [1030001]})"},
                                {base, R"({"slice": [1], "run": [1030001]})", {"--tolerance", "4"}},
                                {base, R"({"slice": [1], "run": [1040000]})"}});
  EXPECT_EQ(results[0].exit_code, 0);
  const RunResult& r = results[1];
  EXPECT_EQ(r.exit_code, 1) << r.err;
  EXPECT_NE(r.out.find("| run | 1.00 | 1.03 | 1.0300 | GROWN |"), std::string::npos) << r.out;
  EXPECT_NE(r.out.find("run takes 3.0 % more instructions."), std::string::npos) << r.out;
  EXPECT_EQ(results[2].exit_code, 0);
  // Less in one job does not pay for more in another.
  EXPECT_EQ(results[3].exit_code, 1);
}

TEST_F(BenchGuard, TheLeastOfSeveralCountsIsCompared) {
  const auto results = compare({{R"({"slice": [1000, 2000]})", R"({"slice": [5000, 1000]})"},
                                {R"({"slice": [1000, 2000]})", R"({"slice": [2000, 2000]})"}});
  EXPECT_EQ(results[0].exit_code, 0);
  EXPECT_EQ(results[1].exit_code, 1);
}

TEST_F(BenchGuard, JobsOfOneSideOnly) {
  // A new job has nothing to grow from; one that is gone can't be judged.
  const auto results = compare({{R"({"slice": [10]})", R"({"slice": [10], "run": [99]})"},
                                {R"({"slice": [10], "run": [9]})", R"({"slice": [10]})"}});
  const RunResult& more = results[0];
  EXPECT_EQ(more.exit_code, 0) << more.err;
  EXPECT_NE(more.out.find("| run | - | 0.00 | - | new |"), std::string::npos) << more.out;
  const RunResult& less = results[1];
  EXPECT_EQ(less.exit_code, 2);
  EXPECT_NE(less.err.find("no count for: run"), std::string::npos) << less.err;
}

TEST_F(BenchGuard, BadCountsAreRefusedByName) {
  const std::string good = R"({"slice": [10]})";
  // Both files are read alike: each kind of damage is in one of them, the first and the second in
  // turn.
  const std::vector<std::string> wrong{"",
                                       "{",
                                       "[]",
                                       "{}",
                                       "3",
                                       R"({"slice": []})",
                                       R"({"slice": 10})",
                                       R"({"slice": [0]})",
                                       R"({"slice": [-4]})",
                                       R"({"slice": [1.5]})",
                                       R"({"slice": ["10"]})",
                                       R"({"slice": [true]})"};
  std::vector<Counts> all;
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    all.push_back(i % 2 == 0 ? Counts{wrong[i], good} : Counts{good, wrong[i]});
  }
  const auto results = compare(all);
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    const RunResult& r = results[i];
    EXPECT_EQ(r.exit_code, 2) << wrong[i];
    EXPECT_NE(r.err.find(i % 2 == 0 ? "base.json" : "head.json"), std::string::npos) << r.err;
  }
}

TEST_F(BenchGuard, WrongUse) {
  const auto results = run_each(kGuard, {{},
                                         {"--counts", "a.json"},
                                         {"a", "b", "--tolerance", "-1"},
                                         {"a", "b", "--repeats", "0"},
                                         {"a", "b", "--only", "knit"},
                                         {"--programs", kGuard, kGuard},
                                         {"--kept", "a.json", "--counts", "b", "c"},
                                         {"--write", "b", "c"},
                                         {"--kept", "a.json", folder_ / "no-program"},
                                         {"no-such-commit", "--only", "slice"}});
  for (const RunResult& r : results) EXPECT_EQ(r.exit_code, 2) << r.err;
  // A program of which its make_part is not built.
  EXPECT_NE(results[5].err.find("--target make_part"), std::string::npos) << results[5].err;
  const RunResult& unknown = results.back();
  EXPECT_NE(unknown.err.find("no-such-commit"), std::string::npos) << unknown.err;
  // As people call them.
  EXPECT_EQ(run_program({kGuard, "--help"}).exit_code, 0);
  EXPECT_EQ(run_program({kBench, "--help"}).exit_code, 0);
}

/// Counts of another compiler say nothing; files that hold none are refused by name.
TEST_F(BenchGuard, KeptCounts) {
  if (run_program({"/usr/bin/env", "valgrind", "--version"}).exit_code != 0) {
    GTEST_SKIP() << "valgrind is not installed";
  }
  const std::string program = SLICECORR_BIN_DIR "/slicecorr";
  const auto guard = [&](const std::string& kept) {
    write_file(folder_ / "kept.json", to_bytes(kept));
    return Command{"--kept", folder_ / "kept.json", program};
  };
  std::vector<RunResult> results;
  for (const char* const kept :
       {R"({"built_with": {"compiler": "another"}, "counts": {"slice": [10]}})",
        R"({"slice": [10]})", R"({"built_with": {}, "counts": {"slice": [0]}})",
        R"({"built_with": 3, "counts": {}})", "{"}) {
    results.push_back(run_each(kGuard, {guard(kept)}).front());
  }
  EXPECT_EQ(results[0].exit_code, 77) << results[0].err;
  EXPECT_NE(results[0].err.find("another"), std::string::npos) << results[0].err;
  for (std::size_t i = 1; i < results.size(); ++i) {
    EXPECT_EQ(results[i].exit_code, 2) << i << results[i].err;
    EXPECT_NE(results[i].err.find("kept.json"), std::string::npos) << results[i].err;
  }
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
            measurement("convert", true, 2, {2}, 10), measurement("correct", true, 2, {4.2}, 211),
            measurement("verify", true, 2, {1.8}, 10),
            measurement("slice without heights", true, 2, {1}, 110),
            measurement("run", true, 2, {1.8432}, 10)}}};
}

TEST_F(BenchGuard, PromisesOfAStoredRun) {
  const RunResult r = bench(stored_run());
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const std::string place = ": gyroid lattice, 2560 x 1440, 10 um: ";
  for (const std::string& line :
       {"1 reached slice, antialiased" + place + "12.0 times", "2 MISSED  correct" + place + "2.10",
        "2 reached verify" + place + "0.90",
        "3 reached run" + place + "59.7 times as fast as PrusaSlicer",
        "5 MISSED  correct" + place + "101 MiB more", "4 reached program slice" + place + "1.90",
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

TEST_F(BenchGuard, WhatIsNoStoredRunIsRefused) {
  const std::string stored = folder_ / "stored.json";
  const std::vector<std::string> wrong{"",     "{",  "[]",   "3",
                                       "null", "{}", "\xff", R"({"slice": [10]})"};
  std::vector<Command> lines{{"--from", stored}, {"--from", folder_ / "."}};
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    const std::string path = folder_ / ("wrong" + std::to_string(i));
    write_file(path, to_bytes(wrong[i]));
    lines.push_back({"--from", path});
  }
  const auto results = run_each(kBench, lines);
  EXPECT_NE(results[0].err.find(stored + ": can't be read: No such file"), std::string::npos)
      << results[0].err;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    EXPECT_EQ(results[i].exit_code, 2) << lines[i][1] << results[i].err;
    if (i != 1) {
      EXPECT_NE(results[i].err.find(lines[i][1]), std::string::npos) << results[i].err;
    }
  }
}

TEST_F(BenchGuard, StoredRunsOfAnotherShapeAreRefusedByPlace) {
  using Pointer = Json::json_pointer;
  std::vector<Command> lines;
  std::vector<std::string> places;
  const auto add = [&](const Json& run, const std::string& place) {
    const std::string path = folder_ / (std::to_string(lines.size()) + ".json");
    write_file(path, to_bytes(run.dump()));
    lines.push_back({"--from", path});
    places.push_back(place);
  };
  for (const char* key : {"machine", "peer", "quick", "measurements", "outputs", "stages"}) {
    Json run = stored_run();
    run.erase(key);
    add(run, std::string("no '") + key + "'");
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
    add(run, place);
  }
  const auto results = run_each(kBench, lines);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const RunResult& r = results[i];
    EXPECT_EQ(r.exit_code, 2) << places[i];
    EXPECT_NE(r.err.find(places[i]), std::string::npos) << r.err;
    EXPECT_EQ(r.out, "");
  }
}

TEST_F(BenchGuard, PortionsOfOtherMachinesAreNotJoined) {
  Json other = stored_run();
  other["machine"]["cores"] = 4;
  write_file(folder_ / "a.json", to_bytes(stored_run().dump()));
  write_file(folder_ / "b.json", to_bytes(other.dump()));
  const RunResult r =
      run_each(kBench, {{"--from", folder_ / "a.json", "--from", folder_ / "b.json"}}).front();
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_NE(r.err.find("differ in cores: 2 and 4"), std::string::npos) << r.err;
}

TEST_F(BenchGuard, FoldersThatAreNotThere) {
  const std::string nowhere = folder_ / "nowhere";
  write_file(folder_ / "file", to_bytes("x"));
  const auto results = run_each(kBench, {{"--data", nowhere},
                                         {"--build", nowhere},
                                         {"--json", nowhere + "/out.json"},
                                         {"--out", folder_ / "file"}});
  for (const RunResult& r : results) EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_NE(results[0].err.find("--data: no folder " + nowhere), std::string::npos)
      << results[0].err;
  EXPECT_NE(results[1].err.find("no " + nowhere + "/bin/slicecorr"), std::string::npos)
      << results[1].err;
}

/// A build folder whose programs are scripts.
class Substitutes {
 public:
  explicit Substitutes(std::string folder) : folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_ + "/bin");
    write_file(folder_ + "/CMakeCache.txt", to_bytes("CMAKE_BUILD_TYPE:STRING=Release\n"));
    // As many bytes as the gyroid has.
    script("make_part", "truncate -s $((84 + 50 * 317084)) \"$2\"");
    script("make_lattice", "exit 3");
    script("compare_slices", "echo '" + std::string(kComparison) + "'");
    script("stages", "exit 3");
    script("codec", "exit 3");
    slicecorr("echo '" + std::string(kFigures) + "'");
  }
  /// `figures` prints what `run` and `verify` write.
  void slicecorr(const std::string& figures) const {
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
  void script(const std::string& name, const std::string& body) const {
    const std::string path = folder_ + "/bin/" + name;
    write_file(path, to_bytes("#!/bin/sh\n" + body + "\n"));
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  }
  /// What scripts/bench is told to measure them.
  Command measured() const {
    return {"--build",     folder_,     "--only", "gyroid",        "--quick",
            "--no-stages", "--no-peer", "--out",  folder_ + "/out"};
  }

 private:
  static constexpr const char* kComparison =
      R"({"slices": 3, "triangles": 4, "bands": 5, "samples": [], "wrong": []})";
  static constexpr const char* kFigures =
      R"({"layers": 3, "target_voxels": 9, "printed_voxels": 9, "cure_through_voxels": 0,)"
      R"( "undercure_voxels": 0, "uncorrected": {"layers": 3, "target_voxels": 9,)"
      R"( "printed_voxels": 9, "cure_through_voxels": 1, "undercure_voxels": 0}})";
  std::string folder_;
};

class BenchOfSubstitutes : public BenchGuard {
 protected:
  /// A build folder for each of these, in which `change` does something to it.
  std::vector<RunResult> measure(
      const std::vector<std::function<void(const Substitutes&)>>& changes) {
    std::vector<Command> lines;
    for (const auto& change : changes) {
      const Substitutes build(folder_ / ("build" + std::to_string(lines.size())));
      change(build);
      lines.push_back(build.measured());
    }
    return run_each(kBench, lines);
  }
};

TEST_F(BenchOfSubstitutes, AreMeasured) {
  const RunResult r = measure({[](const Substitutes&) {}}).front();
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.out.find("run: gyroid lattice"), std::string::npos) << r.out;
}

TEST_F(BenchOfSubstitutes, OutputsThatCantBeReadAreWrong) {
  const std::vector<std::string> wrong{"echo nothing", "true", "echo []", R"(echo '{"layers": 3}')",
                                       R"(echo '{"layers": "3"}')"};
  std::vector<std::function<void(const Substitutes&)>> changes;
  for (const std::string& figures : wrong) {
    changes.emplace_back([&](const Substitutes& build) { build.slicecorr(figures); });
  }
  const auto results = measure(changes);
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    const RunResult& r = results[i];
    EXPECT_EQ(r.exit_code, 1) << wrong[i];
    EXPECT_NE(r.err.find("WRONG: gyroid lattice, 2560 x 1440, 50 um: "), std::string::npos)
        << r.err;
    EXPECT_NE(r.err.find("/run.json: "), std::string::npos) << r.err;
  }
}

TEST_F(BenchOfSubstitutes, ProgramsThatSayNothingAreWrong) {
  std::vector<std::function<void(const Substitutes&)>> changes;
  for (const char* body : {"echo 3", "true", "echo '{'", "echo damaged >&2; exit 2"}) {
    changes.emplace_back(
        [body](const Substitutes& build) { build.script("compare_slices", body); });
  }
  changes.emplace_back([](const Substitutes& build) { build.script("slicecorr", "true"); });
  changes.emplace_back(
      [](const Substitutes& build) { build.script("make_part", "echo short > \"$2\""); });
  const auto results = measure(changes);
  for (std::size_t i = 0; i < results.size(); ++i) EXPECT_EQ(results[i].exit_code, 1) << i;
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NE(results[i].err.find("WRONG: gyroid lattice"), std::string::npos) << results[i].err;
  }
  EXPECT_NE(results[4].err.find("on.uvj: was not written"), std::string::npos) << results[4].err;
  EXPECT_NE(results[5].err.find("did not write 317084 triangles"), std::string::npos)
      << results[5].err;
}

}  // namespace
}  // namespace slicecorr::test
