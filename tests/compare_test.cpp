// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr compare` as its users call it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "run_program.hpp"

namespace slicecorr::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CompareTest : public ::testing::Test {
 protected:
  CompareTest()
      : folder_(fs::path(::testing::TempDir()) /
                ("slicecorr-compare-" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
    write_stl((folder_ / "ladder.stl").string(), ladder());
    options_.folder = folder_.string();
    options_.environment = {{"SLICECORR_DB", SLICECORR_DB_DIR}};
  }
  ~CompareTest() override { fs::remove_all(folder_); }

  RunResult call(const std::string& name, const Command& more) const {
    Command command{
        SLICECORR_BIN_DIR "/slicecorr", name,      "ladder.stl", "--layer-um", "50", "--printer",
        "dual-wavelength-dlp",          "--resin", "figure-2-2"};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command, options_);
  }
  json read(const std::string& file) const { return json::parse(std::ifstream(folder_ / file)); }
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  const fs::path folder_;
  RunOptions options_;
};

TEST_F(CompareTest, TableOnStdoutAndNothingElse) {
  const RunResult r = call("compare", {"--speed-mm-h", "1000"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(files(), 1U);
  std::istringstream lines(r.out);
  std::string head, line;
  std::getline(lines, head);
  for (const char* heading : {"uncorrected", "erase, N = ", "Z comp., N = ", "grey table",
                              "corrected to slices", "corrected"}) {
    EXPECT_NE(head.find(heading), std::string::npos) << heading;
  }
  for (const char* row :
       {"height error, mean", "height error, 95 % within", "height error, largest",
        "gap voxels cured through", "feature voxels undercured", "column features lost",
        "column gaps merged", "overlap with the design"}) {
    EXPECT_NE(r.out.find(row), std::string::npos) << row;
  }
  while (std::getline(lines, line)) EXPECT_EQ(line.size(), head.size()) << line;
  EXPECT_EQ(call("compare", {"--speed-mm-h", "1000", "--threads", "1"}).out, r.out);
}

TEST_F(CompareTest, JsonHoldsTheFiguresOfEachMethod) {
  const RunResult r = call("compare", {"--speed-mm-h", "1000", "--json", "-", "--quiet"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(r.err, "");
  EXPECT_EQ(files(), 1U);
  json j = json::parse(r.out);
  ASSERT_EQ(j.size(), 6U);
  // What `run` says of the same part.
  ASSERT_EQ(call("run", {"--speed-mm-h", "1000", "-o", "ladder.uvj"}).exit_code, 0);
  json ours = read("ladder.json");
  json uncorrected = ours["uncorrected"];
  // Of times, and of what slices light, `run` alone tells.
  for (const char* key : {"uncorrected", "light_s", "print_time_s", "largest_area_change"}) {
    ASSERT_EQ(ours.erase(key), 1U) << key;
  }
  ours["best_n"] = uncorrected["best_n"] = nullptr;
  EXPECT_EQ(j["ours"], ours);
  // `run` does not follow in time what uncorrected light prints.
  for (const char* key : {"in_time", "time_step_um"}) {
    ASSERT_EQ(j["uncorrected"].erase(key), 1U);
    ASSERT_EQ(uncorrected.erase(key), 1U);
  }
  EXPECT_EQ(j["uncorrected"], uncorrected);
  for (const char* method : {"erase", "z_compensation", "table"}) {
    for (const auto& [key, value] : ours.items()) EXPECT_TRUE(j[method].contains(key)) << key;
    EXPECT_EQ(j[method]["target_voxels"], ours["target_voxels"]);
    EXPECT_GT(j[method]["height_error_um"]["mean_abs"], ours["height_error_um"]["mean_abs"]);
  }
  // All edges of the ladder lie on nodes: heights change nothing.
  EXPECT_EQ(j["ours_to_slices"]["surface_error_um"], ours["surface_error_um"]);
  EXPECT_TRUE(j["erase"]["best_n"].is_number_integer());
  EXPECT_TRUE(j["table"]["best_n"].is_null());
  EXPECT_LT(j["erase"]["height_error_um"]["mean_abs"],
            j["uncorrected"]["height_error_um"]["mean_abs"]);
}

TEST_F(CompareTest, JsonFileBesideTheTable) {
  const RunResult r = call("compare", {"--speed-mm-h", "1000", "--json", "figures.json"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.out.find("grey table"), std::string::npos);
  EXPECT_EQ(files(), 2U);
  const json j = read("figures.json");
  EXPECT_NE(r.out.find("erase, N = " + j["erase"]["best_n"].dump()), std::string::npos);
}

TEST_F(CompareTest, ExitCodes) {
  EXPECT_EQ(call("compare", {}).exit_code, 2);
  EXPECT_EQ(call("compare", {"--speed-mm-h", "1000", "--scale", "1000"}).exit_code, 2);
  EXPECT_EQ(call("compare", {"--speed-mm-h", "1000", "--json", "ladder.stl"}).exit_code, 2);
  const RunResult dim = call("compare", {"--speed-mm-h", "1000", "--dc-mj-cm3", "1e5"});
  EXPECT_EQ(dim.exit_code, 3);
  EXPECT_NE(dim.err.find("never gels"), std::string::npos);
  EXPECT_EQ(call("compare", {"--speed-mm-h", "1000", "--json", "no/folder.json"}).exit_code, 4);
  options_.stdout_path = "/dev/full";
  EXPECT_EQ(call("compare", {"--speed-mm-h", "1000"}).exit_code, 4);
}

}  // namespace
}  // namespace slicecorr::test
