// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Studies over HTTP: what they make, what they refuse, their bounds and their end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "farm_lab.hpp"
#include "run_program.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm {
namespace {

using namespace test;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Studies, APlateShowsWhatIsSliced) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  const json s = study(sam, of_ladder("plate", ladder_of(farm, sam)));
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plate = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_EQ(plate["layers"], 50);
  EXPECT_EQ(plate["triangles"], 48);
  EXPECT_EQ(plate["shown_triangles"], 48);
  EXPECT_EQ(plate["plate_mm"], (json{64.0, 40.0}));
  // 4 x 2 x 2.5 mm in the middle of the plate.
  const std::vector<double> lower = plate["lower_mm"], upper = plate["upper_mm"];
  const std::vector<double> expected_lower{30, 19, 0}, expected_upper{34, 21, 2.5};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(lower[k], expected_lower[k], 1e-6);
    EXPECT_NEAR(upper[k], expected_upper[k], 1e-6);
  }
  EXPECT_NEAR(plate["volume_ml"].get<double>(), (2 * 1 * 2 * 2.5 + 2 * 2 * 2 * 0.5) * 1e-3, 1e-6);
  // Triangles: places within the box, in steps of 1/65535.
  const std::string bin = file_of(sam, s, "plate.bin");
  ASSERT_EQ(bin.size(), 32U + 18 * 48);
  EXPECT_EQ(bin.substr(0, 4), "SCP1");
  float box[6];
  std::memcpy(box, bin.data() + 8, sizeof box);
  std::set<long> heights;
  for (std::size_t i = 0; i < 48 * 3; ++i) {
    std::uint16_t at[3];
    std::memcpy(at, bin.data() + 32 + 6 * i, sizeof at);
    heights.insert(std::lround(1000 * (box[2] + at[2] * (box[5] - box[2]) / 65535.0)));
  }
  EXPECT_EQ(heights, (std::set<long>{0, 550, 1050, 1550, 2050, 2500}));
  // Layers: two rails of 20 x 40 pixels, a rung between them in slices 11 to 20.
  const std::string token = s["study"];
  EXPECT_EQ(plate["box_px"], (json{600, 380, 680, 420}));
  for (const auto& [layer, lit] :
       {std::pair{0, 1600}, {10, 1600}, {11, 3200}, {20, 3200}, {49, 1600}}) {
    const auto answer =
        sam.Get(fmt::format("/api/v1/studies/{}/layers/{}.png", token, layer).c_str());
    ASSERT_EQ(status_of(answer), 200);
    const GreyImage image =
        decode_png({answer->body.begin(), answer->body.end()}, 80, 40, "layer", "layer");
    EXPECT_EQ(std::count(image.pixels.begin(), image.pixels.end(), 255), lit) << layer;
  }
  for (const char* bad :
       {"50.png", "-1.png", "01.png", "x.png", "..%2fplate.json", "4294967296.png"}) {
    EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + token + "/layers/" + bad).c_str())), 404)
        << bad;
  }
  for (const char* bad : {"design.uvj", "..%2f..%2ffarm.sqlite", "layers.bin", "check.html"}) {
    EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + token + "/files/" + bad).c_str())), 404)
        << bad;
  }
}

TEST(Studies, PartsOnOnePlate) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("plate", ladder_of(farm, sam));
  request["parts"].push_back(request["parts"][0]);
  // As in their files they overlap, with names, volume and place.
  json s = study(sam, request);
  EXPECT_EQ(s["state"], "failed");
  EXPECT_EQ(s["exit_code"], 2);
  EXPECT_THAT(s["message"].get<std::string>(),
              ::testing::AllOf(HasSubstr("ladder.stl overlap: "), HasSubstr("mm³ belong to both")));
  request["overlap"] = "join";
  s = study(sam, request);
  EXPECT_EQ(s["state"], "done") << s.dump();
  request["arrange"] = true;
  request["spacing_mm"] = 2;
  s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  json plate = json::parse(file_of(sam, s, "plate.json"));
  ASSERT_EQ(plate["parts"].size(), 2U);
  const auto x = [&](std::size_t k) { return plate["parts"][k]["x_mm"].get<double>(); };
  const auto y = [&](std::size_t k) { return plate["parts"][k]["y_mm"].get<double>(); };
  // 4 x 2 mm each, at least 2 mm apart.
  EXPECT_TRUE(std::abs(x(0) - x(1)) >= 6 || std::abs(y(0) - y(1)) >= 4);
  EXPECT_EQ(plate["parts"][1]["from"], 48);
  EXPECT_EQ(plate["parts"][1]["to"], 96);
  // Put by hand to where they were arranged they are the same layers; elsewhere, turned, others.
  json put = request;
  put.erase("arrange");
  put.erase("spacing_mm");
  put.erase("overlap");
  put["places_mm"] = {x(0), y(0), x(1), y(1)};
  put["quarter_turns"] = {0, 0};
  s = study(sam, put);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json again = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_EQ(again["box_px"], plate["box_px"]);
  EXPECT_EQ(again["volume_ml"], plate["volume_ml"]);
  put["places_mm"] = {10, 10, 50, 30};
  put["quarter_turns"] = {0, 1};
  s = study(sam, put);
  ASSERT_EQ(s["state"], "done") << s.dump();
  plate = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_NEAR(x(0), 10, 1e-6);
  EXPECT_NEAR(y(1), 30, 1e-6);
  EXPECT_EQ(plate["parts"][1]["quarter_turns"], 1);
  // Pixels of 50 um: from x 8 to 51 mm; the plate's 40 mm less 31 is row 180.
  EXPECT_EQ(plate["box_px"], (json{160, 160, 1020, 620}));
  for (const auto& [key, value] : std::map<std::string, json>{{"arrange", "yes"},
                                                              {"places_mm", "1,2"},
                                                              {"places_mm", json::array()},
                                                              {"overlap", 3}}) {
    json bad = request;
    bad[key] = value;
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies", bad)), 400) << key;
  }
}

TEST(Studies, AnArchiveWithSupports) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  TriangleMesh all = slicecorr::test::ladder();
  slicecorr::test::add_box(all, {-3, -2, -0.6}, {3, 2, -0.4});
  slicecorr::test::add_box(all, {-1.6, -0.2, -0.4}, {-1.3, 0.2, 0});
  slicecorr::test::add_box(all, {1.3, -0.2, -0.4}, {1.6, 0.2, 0});
  slicecorr::test::write_stl(farm.root + "/all.stl", all);
  const auto sliced = slicecorr::test::run_program(
      {std::string(SLICECORR_BIN_DIR) + "/slicecorr", "slice", farm.root + "/all.stl", "--layer-um",
       "50", "--printer", "dual-wavelength-dlp", "-o", farm.root + "/all.uvj"});
  ASSERT_EQ(sliced.exit_code, 0) << sliced.err;
  json request = of_ladder("check", upload(sam, "all.uvj", bytes_of(farm.root + "/all.uvj")));
  request["speed_mm_h"] = 800;
  request["part_inside"] = {ladder_of(farm, sam)};
  json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  // The raft alone: 4 slices of 120 x 80 pixels.
  EXPECT_GT(json::parse(file_of(sam, s, "check.json"))["left_alone_voxels"], 4 * 120 * 80);
  request["scale"] = 0.8;
  s = study(sam, request);
  EXPECT_EQ(s["state"], "failed");
  EXPECT_THAT(s["message"].get<std::string>(), HasSubstr("is not in the archive"));
  request["parts"] = request["part_inside"];
  EXPECT_EQ(status_of(post(sam, "/api/v1/studies", request)), 400);
}

TEST(Studies, AnArchiveHasLayersAndCells) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  slicecorr::test::write_stl(farm.root + "/ladder.stl", slicecorr::test::ladder());
  const auto sliced = slicecorr::test::run_program(
      {std::string(SLICECORR_BIN_DIR) + "/slicecorr", "slice", farm.root + "/ladder.stl",
       "--layer-um", "50", "--printer", "dual-wavelength-dlp", "-o", farm.root + "/ladder.uvj"});
  ASSERT_EQ(sliced.exit_code, 0) << sliced.err;
  const std::string part = upload(sam, "ladder.uvj", bytes_of(farm.root + "/ladder.uvj"));
  json request = of_ladder("plate", part);
  request.erase("layer_um");
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plate = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_EQ(plate["from"], "slices");
  EXPECT_EQ(plate["layers"], 50);
  const std::vector<double> lower = plate["lower_mm"], upper = plate["upper_mm"];
  EXPECT_NEAR(lower[0], 30, 1e-6);
  EXPECT_NEAR(lower[1], 19, 1e-6);
  EXPECT_NEAR(upper[2], 2.5, 1e-6);
  // Pixels are cells here: faces of 80 x 40 x 50 cells. Rails and rungs from all sides: each quad is
  // two triangles.
  const int rail = 2 * (20 * 40) + 2 * 50 * (20 + 40), rung = 40 * 40 + 40 * 10;
  // A rung covers 40 x 10 faces of either rail and has none at its own ends.
  EXPECT_EQ(plate["shown_triangles"], 2 * (2 * rail + 2 * 2 * rung - 2 * 2 * 40 * 10));
  const json check = study(sam, [&] {
    json r = request;
    r["kind"] = "check";
    r["speed_mm_h"] = 800;
    return r;
  }());
  ASSERT_EQ(check["state"], "done") << check.dump();
  EXPECT_EQ(json::parse(file_of(sam, check, "check.json"))["layer_um"], 50.0);
  EXPECT_EQ(file_of(sam, check, "section.png").substr(1, 3), "PNG");
}

TEST(Studies, APlanIsThatOfTheProgram) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("plan", ladder_of(farm, sam));
  request["tolerance_um"] = 25;
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plan = json::parse(file_of(sam, s, "plan.json"));
  const auto direct = slicecorr::test::run_program({std::string(SLICECORR_BIN_DIR) + "/slicecorr",
                                                    "plan", farm.root + "/ladder.stl", "--layer-um",
                                                    "50", "--printer", "dual-wavelength-dlp",
                                                    "--resin", "benchy-resin", "--json", "-"});
  ASSERT_EQ(direct.exit_code, 0) << direct.err;
  EXPECT_EQ(plan["speed_mm_h"], json::parse(direct.out)["speed_mm_h"]);
  EXPECT_EQ(plan["limit"], json::parse(direct.out)["limit"]);
  EXPECT_THAT(file_of(sam, s, "plan.svg"), HasSubstr("<svg"));
  // What can't be printed says so, with the exit code of physics.
  request["tolerance_um"] = 0.001;
  const json refused = study(sam, request);
  EXPECT_EQ(refused["state"], "failed");
  EXPECT_EQ(refused["exit_code"], 3);
  EXPECT_FALSE(refused["message"].get<std::string>().empty());
  EXPECT_THAT(refused["message"].get<std::string>(), Not(HasSubstr(farm.root)));
}

TEST(Studies, ACheckHasFiguresAndTheWorstPlace) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("check", ladder_of(farm, sam));
  request["speed_mm_h"] = 800;
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json figures = json::parse(file_of(sam, s, "check.json"));
  EXPECT_LT(figures["height_error_um"]["max_abs"].get<double>(),
            figures["uncorrected"]["height_error_um"]["max_abs"].get<double>());
  EXPECT_EQ(file_of(sam, s, "section.png").substr(1, 3), "PNG");
  const auto page =
      sam.Get(("/api/v1/studies/" + s["study"].get<std::string>() + "/files/check.html").c_str());
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"), HasSubstr("sandbox"));
  // The part is named, its folders are not.
  request["parts"] = {upload(sam, "broken.stl", std::string(200, 'x'))};
  const json broken = study(sam, request);
  EXPECT_EQ(broken["state"], "failed");
  EXPECT_EQ(broken["exit_code"], 2);
  EXPECT_THAT(broken["message"].get<std::string>(), HasSubstr("broken.stl"));
  EXPECT_THAT(broken["message"].get<std::string>(), Not(HasSubstr("uploads/")));
}

TEST(Studies, TakeTheSettingsOfPrograms) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("check", ladder_of(farm, sam));
  request.update({{"speed_mm_h", 800},
                  {"omega_max", "inf"},
                  {"gap_shortfall", 0.3},
                  {"surface", "slices"},
                  {"slice_speed_mm_h", {800, 800, 400}},
                  {"slice_lamps", "stay"}});
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  request["slice_lamps"] = "follow";
  const json follows = study(sam, request);
  ASSERT_EQ(follows["state"], "done") << follows.dump();
  EXPECT_NE(file_of(sam, s, "section.png"), file_of(sam, follows, "section.png"));
  for (const json& bad : std::vector<json>{{{"gap_shortfall", 0.7}},
                                           {{"omega_max", 0.5}},
                                           {{"omega_max", "most"}},
                                           {{"surface", "moon"}},
                                           {{"slice_speed_mm_h", 800}},
                                           {{"slice_speed_mm_h", {800, -1}}},
                                           {{"slice_speed_mm_h", json::array()}},
                                           {{"bottom_layers", 1.5}}}) {
    json other = request;
    other.update(bad);
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies", other)), 400) << bad.dump();
  }
}

TEST(Studies, RefusesWhatIsNoStudy) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  const std::string part = ladder_of(farm, sam);
  for (const json& bad :
       std::vector<json>{{{"kind", "shell"}},
                         {{"kind", 7}},
                         {{"parts", {"/etc/passwd"}}},
                         {{"parts", {farm.root + "/ladder.stl"}}},
                         {{"parts", {"upload:../../ladder.stl"}}},
                         {{"parts", {"upload:" + std::string(32, 'a') + "/ladder.stl"}}},
                         {{"parts", json::array()}},
                         {{"parts", part}},
                         {{"parts", {part, 7}}},
                         {{"printer", "/etc/printer.toml"}},
                         {{"printer", "../printer"}},
                         {{"printer", "--help"}},
                         {{"printer", "printer.toml"}},
                         {{"printer", "a b"}},
                         {{"printer", nullptr}},
                         {{"resin", "x;y"}},
                         {{"layer_um", "50"}},
                         {{"layer_um", nullptr}},
                         {{"tolerance_um", true}},
                         {{"mode", "-x"}},
                         {{"mode", "a=b"}},
                         {{"rotate_deg", {1, 2}}},
                         {{"rotate_deg", "0,0,0"}},
                         {{"-o", "/tmp/x"}},
                         {{"json", "/tmp/x"}}}) {
    json request = of_ladder("plan", part);
    request.update(bad);
    const auto answer = post(sam, "/api/v1/studies", request);
    EXPECT_EQ(status_of(answer), 400) << bad.dump() << answer->body;
    EXPECT_THAT(answer->body, Not(HasSubstr("/tmp/x"))) << bad.dump();
  }
  for (const char* token : {"..", "..%2f..", "a", "00000000000000000000000000000000"}) {
    EXPECT_EQ(status_of(sam.Get((std::string("/api/v1/studies/") + token).c_str())), 404) << token;
  }
}

TEST(Studies, RunBesideTheServerAndEndWhenTold) {
  Farm farm;
  ServeOptions options = with_accounts();
  options.children.programs = scripts(farm, {{"slicecorr", "echo begun > begun; sleep 600\n"}});
  options.children.most_waiting = 1;
  const Served served(farm, options);
  auto sam = client_of(served, kSubmit), olga = client_of(served, kOther);
  const json request = of_ladder("plan", ladder_of(farm, sam));
  const std::string first = body_of(post(sam, "/api/v1/studies", request))["study"];
  const auto state = [&](const std::string& token) {
    return body_of(sam.Get(("/api/v1/studies/" + token).c_str()))["state"];
  };
  for (int i = 0; i < 200 && state(first) != "running"; ++i) ::usleep(20'000);
  ASSERT_EQ(state(first), "running");
  for (int i = 0; i < 200 && !fs::exists(farm.root + "/studies/" + first + "/begun"); ++i) {
    ::usleep(20'000);
  }
  const std::string second = body_of(post(sam, "/api/v1/studies", request))["study"];
  EXPECT_EQ(body_of(sam.Get(("/api/v1/studies/" + second).c_str()))["before"], 0);
  EXPECT_EQ(status_of(post(sam, "/api/v1/studies", request)), 503);
  // The server answers meanwhile.
  EXPECT_EQ(status_of(sam.Get("/api/v1/overview")), 200);
  EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + first + "/files/plan.json").c_str())), 409);
  EXPECT_EQ(status_of(post(olga, "/api/v1/studies/" + first + "/cancel", json::object())), 403);
  for (const std::string& token : {second, first}) {
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies/" + token + "/cancel", json::object())), 200);
    EXPECT_EQ(ended_study(sam, token)["state"], "cancelled");
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies/" + token + "/cancel", json::object())), 409);
  }
  // Nothing of it runs on: a third one begins.
  const std::string third = body_of(post(sam, "/api/v1/studies", request))["study"];
  for (int i = 0; i < 200 && state(third) != "running"; ++i) ::usleep(20'000);
  EXPECT_EQ(state(third), "running");
}  // the server ends the third one

TEST(Studies, ProgramsAreBounded) {
  Farm farm;
  ServeOptions options = with_accounts();
  options.children.programs =
      scripts(farm, {{"slicecorr",
                      "case $1 in plan) sleep 600;; run) head -c 3000000 /dev/zero > big;; "
                      "slice) echo design; env > seen; pwd >> seen; exit 7;; esac\n"},
                     {"resinctl", "echo wrote > $HOME/never; exit 1\n"}});
  options.children.study_s = SLICECORR_SANITIZED ? 5 : 0.5;
  options.children.file_bytes = 1 << 20;
  const Served served(farm, options);
  auto sam = client_of(served, kSubmit);
  const std::string part = ladder_of(farm, sam);
  const json slow = study(sam, of_ladder("plan", part));
  EXPECT_EQ(slow["state"], "failed");
  EXPECT_THAT(slow["message"].get<std::string>(), HasSubstr("took too long"));
  const json large = study(sam, of_ladder("check", part));
  EXPECT_EQ(large["state"], "failed") << large.dump();
  for (const auto& entry : fs::recursive_directory_iterator(farm.root + "/studies")) {
    if (!entry.is_regular_file()) continue;
    EXPECT_LE(entry.file_size(), 1U << 20) << entry.path();
  }
  const json failed = study(sam, of_ladder("plate", part));
  EXPECT_EQ(failed["state"], "failed");
  EXPECT_EQ(failed["exit_code"], 7);
}

}  // namespace
}  // namespace slicecorr::farm
