// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic prints in jobs files, and what is made of them: fields in their place, keys, estimates,
// refusals.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <fstream>
#include <iterator>

#include "farm_errors.hpp"
#include "farm_tomo.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/setup.hpp"
#include "submit/tomographic.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(TomoJobsFile, TomlAndCsvAndJsonSayTheSame) {
  const auto toml = parse_jobs_toml(R"([defaults]
mode = "tomography"
max_time_s = 600
[[job]]
part = "a.stl"
voxel_mm = 0.1
method = "osmo"
window = "ram-lak"
angles = 360
iterations = 20
clip_sigma = 3
stop_error = 0.005
beyond_reach = true
insert = ["core.stl", "pin.stl"]
)",
                                    "jobs.toml");
  const auto csv = parse_jobs_csv(
      "part,mode,max_time_s,voxel_mm,method,window,angles,iterations,clip_sigma,stop_error,"
      "beyond_reach,insert\n"
      "a.stl,tomography,600,0.1,osmo,ram-lak,360,20,3,0.005,true,core.stl; pin.stl\n",
      "jobs.csv");
  const auto json = parse_jobs_json(
      R"({"defaults": {"mode": "tomography", "max_time_s": 600}, "jobs": [{"part": "a.stl",
          "voxel_mm": 0.1, "method": "osmo", "window": "ram-lak", "angles": 360, "iterations": 20,
          "clip_sigma": 3, "stop_error": 0.005, "beyond_reach": true,
          "insert": ["core.stl", "pin.stl"]}]})",
      "request");
  for (const auto& jobs : {toml, csv, json}) {
    ASSERT_EQ(jobs.size(), 1U);
    const JobRequest& j = jobs[0];
    EXPECT_EQ(j.setup.mode, "tomography");
    EXPECT_EQ(j.voxel_mm, 0.1);
    EXPECT_EQ(j.method, "osmo");
    EXPECT_EQ(j.window, "ram-lak");
    EXPECT_EQ(j.angles, 360);
    EXPECT_EQ(j.iterations, 20);
    EXPECT_EQ(j.clip_sigma, 3);
    EXPECT_EQ(j.stop_error, 0.005);
    EXPECT_EQ(j.max_time_s, 600);
    EXPECT_TRUE(j.beyond_reach);
    EXPECT_THAT(j.inserts, ElementsAre("core.stl", "pin.stl"));
  }
  EXPECT_TRUE(toml[0].said.at("mode").default_);
  EXPECT_FALSE(toml[0].said.at("angles").default_);
  EXPECT_EQ(toml[0].said.at("angles").where, "jobs.toml: line 9");
}

TEST(TomoJobsFile, ValuesOutOfRangeHaveTheirLine) {
  EXPECT_THAT(
      errors_of([] {
        parse_jobs_toml(
            "[[job]]\npart = \"a.stl\"\nvoxel_mm = 0\nmethod = \"magic\"\n"
            "angles = 2\niterations = 1.5\nmax_time_s = -1\n"
            "beyond_reach = \"yes\"\nwindow = 3\ninsert = 4\n",
            "jobs.toml");
      }),
      ElementsAre("jobs.toml: line 3: voxel_mm is 0, expected a number above 0",
                  "jobs.toml: line 4: method is 'magic', expected one of ladder, osmo, "
                  "kelly, fbp",
                  "jobs.toml: line 5: angles is 2, expected a whole number from 3 to 100000",
                  HasSubstr("jobs.toml: line 6: iterations is 1.5"),
                  HasSubstr("jobs.toml: line 7: max_time_s is -1"),
                  "jobs.toml: line 8: beyond_reach is 'yes', expected true or false",
                  HasSubstr("jobs.toml: line 9: window is 3"),
                  HasSubstr("jobs.toml: line 10: insert is 4")));
}

TEST(TomoJobsFile, TheExampleOfTheDocsIsRead) {
  const std::string page = text_of_file(SLICECORR_SOURCE_DIR "/docs/farm-tomography.md");
  std::size_t at = page.find("    [defaults]");
  ASSERT_NE(at, page.npos);
  std::string text;
  // Up to the first line that is not indented.
  for (std::size_t end = 0; at < page.size(); at = end + 1) {
    end = page.find('\n', at);
    const std::string line = page.substr(at, end - at);
    if (!line.empty() && !line.starts_with("    ")) break;
    text += (line.empty() ? line : line.substr(4)) + "\n";
  }
  const auto jobs = parse_jobs_toml(text, "docs/farm-tomography.md");
  ASSERT_EQ(jobs.size(), 4U);
  EXPECT_EQ(jobs[0].max_time_s, 600);
  EXPECT_THAT(jobs[1].inserts, ElementsAre("shaft.stl"));
  EXPECT_EQ(jobs[2].method, "osmo");
  EXPECT_EQ(jobs[3].setup.mode, "continuous");
}

TEST(TomoDefinitions, AreReadBackBitForBit) {
  Printer printer = load_printer(SLICECORR_PRINTERS_DIR "/webber-vial.toml");
  const Resin resin = load_resin(SLICECORR_DB_DIR "/webber-dudma-pegda.toml");
  const auto again = [&] {
    const std::string text = definitions_json(printer, resin);
    const auto read = parse_definitions_json(text, "the job's setup");
    EXPECT_EQ(definitions_json(read.first, read.second), text);
    EXPECT_EQ(read.second, resin);
    return read.first;
  };
  EXPECT_EQ(again(), printer);
  FlatField field;
  field.width_px = 3;
  field.height_px = 2;
  field.reference = 200;
  field.values = std::make_shared<const std::vector<std::uint8_t>>(
      std::vector<std::uint8_t>{200, 190, 180, 170, 160, 200});
  printer.flat_field = field;
  EXPECT_EQ(*again().flat_field->values, *field.values);

  const auto refused = [](const std::string& text) -> std::string {
    try {
      parse_definitions_json(text, "the job's setup");
    } catch (const InputError& e) {
      return e.what();
    }
    return "taken";
  };
  EXPECT_THAT(refused("{"), HasSubstr("the job's setup"));
  EXPECT_THAT(refused("{}"), HasSubstr("printer is missing"));
  std::string text = definitions_json(printer, resin);
  text.replace(text.find("flat_field_png"), 14, "flat_field_pnk");
  EXPECT_THAT(refused(text), HasSubstr("flat_field_png"));
}

class PrepareTomography : public FarmTomography {
 protected:
  void SetUp() override {
    FarmTomography::SetUp();
    folder = open_folder(farm_dir());
    queue.emplace(folder.database());
  }
  JobRequest request(const std::string& part) const {
    JobRequest r;
    r.where = "here";
    r.parts = {part};
    r.setup.mode = "tomography";
    r.setup.printer = dir / "vial.toml";
    r.setup.resin = dir / "gel.toml";
    r.voxel_mm = 0.25;
    r.method = "osmo";
    r.iterations = 3;
    return r;
  }
  Submission prepared(const std::vector<JobRequest>& requests) {
    return prepare(requests, folder, *queue, "anna", true, {});
  }
  std::string key_of(const JobRequest& r) { return prepared({r}).jobs.at(0).work.key; }
  std::vector<std::string> refused(const std::vector<JobRequest>& requests) {
    return errors_of([&] { prepared(requests); });
  }
  /// What is wrong with the jobs of this file, in its folder.
  std::vector<std::string> refused_file(const std::string& text) {
    write_file(dir / "jobs.toml", text);
    std::vector<std::string> errors =
        errors_of([&] { prepared(read_jobs_file(dir / "jobs.toml")); });
    for (std::string& e : errors) {
      if (e.starts_with(dir.path() + "/")) e.erase(0, dir.path().size() + 1);
    }
    return errors;
  }

  FarmFolder folder;
  std::optional<Queue> queue;
};

TEST_F(PrepareTomography, TheKeyIsWhatDecidesTheBytes) {
  const std::string part = make_part(1);
  const JobRequest base = request(part);
  const std::string key = key_of(base);
  EXPECT_EQ(key_of(base), key);
  JobRequest same = base;
  same.name = "other";
  same.out = dir / "out";
  same.priority = 7;
  // Said in another way: the same side of a voxel, the angles that it gets anyhow.
  same.voxel_mm = 0;
  same.layer_um = 250;
  same.angles = 180;
  EXPECT_EQ(key_of(same), key);

  std::map<std::string, std::string> keys = {{key, "base"}};
  const auto differs = [&](const std::string& what,
                           const std::function<void(JobRequest&)>& change) {
    JobRequest r = base;
    change(r);
    const auto [other, fresh] = keys.emplace(key_of(r), what);
    EXPECT_TRUE(fresh) << what << " and " << other->second << " have the same key";
  };
  differs("part", [&](JobRequest& r) { r.parts = {make_part(2)}; });
  differs("volume", [&](JobRequest& r) { r.parts = {make_volume("v.npy", 3)}; });
  differs("voxel", [](JobRequest& r) { r.voxel_mm = 0.2; });
  differs("method", [](JobRequest& r) { r.method = "kelly"; });
  differs("window", [](JobRequest& r) { r.window = "kelly"; });
  differs("angles", [](JobRequest& r) { r.angles = 90; });
  differs("iterations", [](JobRequest& r) { r.iterations = 4; });
  differs("clip", [](JobRequest& r) { r.clip_sigma = 3; });
  differs("stop", [](JobRequest& r) { r.stop_error = 0.01; });
  differs("time", [](JobRequest& r) { r.max_time_s = 1000; });
  differs("reach", [](JobRequest& r) { r.beyond_reach = true; });
  differs("scale", [](JobRequest& r) { r.scale = 1.01; });
  differs("rotation", [](JobRequest& r) { r.rotate_deg = {0, 0, 90}; });
  write_file(dir / "core.stl", stl_of({{1, 1.5F, 0.2F, 0.7F, 0, 0.5F}}));
  differs("insert", [&](JobRequest& r) { r.inserts = {dir / "core.stl"}; });
  differs("printer", [&](JobRequest& r) {
    std::string text = kVialPrinterToml;
    text.replace(text.find("deg_s = 25"), 10, "deg_s = 24");
    write_file(dir / "slow.toml", text);
    r.setup.printer = dir / "slow.toml";
  });
  differs("resin", [&](JobRequest& r) {
    std::string text = kVialResinToml;
    text.replace(text.find("absorption_per_cm = 2.0"), 23, "absorption_per_cm = 2.1");
    write_file(dir / "dim.toml", text);
    r.setup.resin = dir / "dim.toml";
  });
}

TEST_F(PrepareTomography, EstimatesAreThoseOfTheGrid) {
  // 27 voxels across the vial, 4 slices: solved one by one. Usual angles of a part of 1 mm: 180.
  const Submission s = prepared({request(make_volume("v.npy", 4))});
  const Work& w = s.jobs.at(0).work;
  EXPECT_EQ(w.kind, "tomo");
  EXPECT_EQ(w.format, "frames");
  EXPECT_EQ(w.layers, 4);
  EXPECT_EQ(w.voxels, 4 * 29 * 29);
  EXPECT_EQ(w.rate_class, "tomo osmo slice by slice");
  // Three steps, and four that judging costs.
  EXPECT_EQ(w.voxel_angle_steps, std::int64_t{4} * 29 * 29 * 180 * 7);
  EXPECT_FALSE(s.estimates[0].measured);
  // Ten slices are computed in lanes for sixteen.
  const Submission lanes = prepared({request(make_volume("w.npy", 10))});
  EXPECT_EQ(lanes.jobs.at(0).work.rate_class, "tomo osmo");
  EXPECT_EQ(lanes.jobs[0].work.voxel_angle_steps, std::int64_t{16} * 29 * 29 * 180 * 7);

  // What was measured is per voxel, angle and step.
  submit(s, folder, *queue, "anna", "test");
  const std::string service = queue->start_service("local", 1, 1000);
  const auto c = queue->claim(any_job(service));
  ASSERT_TRUE(c);
  ASSERT_TRUE(queue->begin_commit(c->token));
  AttemptEnd e = ended(Reason::none);
  e.cpu_s = kFixedJobS + 3;
  ResultRecord result = some_result();
  result.figures.tomo = TomoFigures{1.5, 2, 0, 5, 72, true};
  ASSERT_TRUE(queue->finish(c->token, result, e, false));
  JobRequest longer = request(make_volume("v.npy", 4));
  longer.iterations = 10;
  const Estimate again = prepared({longer}).estimates.at(0);
  EXPECT_TRUE(again.measured);
  EXPECT_NEAR(again.seconds, kFixedJobS + 3.0 * 14 / 7, 1e-9);
}

TEST_F(PrepareTomography, RaysAndDoseThatSpreadsTakeLonger) {
  const std::int64_t level =
      prepared({request(make_volume("v.npy", 10))}).jobs.at(0).work.voxel_angle_steps;
  std::string resin = kVialResinToml;
  const std::string absorbs = "absorption_per_cm = 2.0";
  ASSERT_NE(resin.find(absorbs), std::string::npos);
  resin.insert(resin.find(absorbs), "dose_diffusion_m2_s = 1e-13\n");
  write_file(dir / "spreads.toml", resin);
  JobRequest spreads = request(make_volume("v.npy", 10));
  spreads.setup.resin = dir / "spreads.toml";
  EXPECT_EQ(prepared({spreads}).jobs.at(0).work.voxel_angle_steps, 5 * level);

  std::ifstream file(dir / "vial.toml");
  std::string printer{std::istreambuf_iterator<char>(file), {}};
  const std::size_t optics = printer.find("[optics]");
  ASSERT_NE(optics, std::string::npos);
  printer.insert(printer.find('\n', optics) + 1, "half_angle_deg = 1\nrays_per_pixel = 4\n");
  write_file(dir / "spread-light.toml", printer);
  JobRequest rays = request(make_volume("v.npy", 10));
  rays.setup.printer = dir / "spread-light.toml";
  // Sixteen lanes of voxels for ten slices, as without rays.
  EXPECT_EQ(prepared({rays}).jobs.at(0).work.voxel_angle_steps, 3 * 4 * level);
}

TEST_F(PrepareTomography, MemoryGrowsWithLightAndDose) {
  const Printer printer = load_printer(dir / "vial.toml");
  const Resin resin = load_resin(dir / "gel.toml");
  const auto needs = [&](int slices, int angles, tomo::Method method) {
    return detail::tomo_memory_needs(tomo::make_bench(printer, resin, {0.125, slices, angles}),
                                     method);
  };
  const auto small = needs(32, 180, tomo::Method::osmo);
  const auto more = needs(32, 720, tomo::Method::osmo);
  EXPECT_GT(more.base_mb, small.base_mb);
  EXPECT_GT(needs(32, 720, tomo::Method::ladder).thread_mb, more.thread_mb);
  // Light of a block is 4 bytes x 720 angles x 58 pixels x 32 lanes: 5.1 MB; the ladder's descent
  // holds at least 2 x 5 + 6 of them in each thread.
  EXPECT_GE(needs(32, 720, tomo::Method::ladder).thread_mb, 16 * 5);
}

TEST_F(PrepareTomography, FieldsOfOtherModesAreRefusedWhereTheyStand) {
  make_part(1);
  make_volume("v.npy", 3);
  const std::string head =
      "[defaults]\nprinter = \"vial.toml\"\nresin = \"gel.toml\"\nmode = \"tomography\"\n"
      "voxel_mm = 0.25\n";
  EXPECT_THAT(refused_file(head + "[[job]]\npart = \"bridge-1.stl\"\nmethod = \"osmo\"\n"),
              IsEmpty());
  EXPECT_THAT(
      refused_file(head + "[[job]]\npart = \"bridge-1.stl\"\nspeed_mm_h = 700\nsurface = \"mesh\"\n"
                          "center_mm = [1, 1]\ndc_mj_cm3 = 20\n"
                          "[[job]]\npart = \"v.npy\"\nname = \"b\"\nscale = 2\n"
                          "[[job]]\npart = \"bridge-1.stl\"\nname = \"c\"\nmode = \"continuous\"\n"
                          "printer = \"small.toml\"\nresin = \"clear.toml\"\nlayer_um = 50\n"
                          "speed_mm_h = 700\nangles = 180\n"),
      ElementsAre(HasSubstr("jobs.toml: line 8: speed_mm_h has no place in a tomographic print"),
                  HasSubstr("jobs.toml: line 9: surface has no place"),
                  HasSubstr("jobs.toml: line 10: center_mm has no place"),
                  HasSubstr("jobs.toml: line 11: dc_mj_cm3 has no place"),
                  HasSubstr("jobs.toml: line 15: scale has no place with a volume"),
                  HasSubstr("jobs.toml: line 24: angles is for tomographic prints; expected mode "
                            "tomography with it")));
  // Defaults are for the jobs that they fit; one that fits none was meant otherwise.
  const std::string mixed =
      "[defaults]\nlayer_um = 50\nspeed_mm_h = 700\nmethod = \"osmo\"\n"
      "[[job]]\npart = \"bridge-1.stl\"\nprinter = \"small.toml\"\nresin = \"clear.toml\"\n";
  EXPECT_THAT(refused_file(mixed),
              ElementsAre(HasSubstr("jobs.toml: line 4: method is for tomographic prints")));
  EXPECT_THAT(
      refused_file(mixed + "[[job]]\npart = \"bridge-1.stl\"\nname = \"t\"\nmode = \"tomography\"\n"
                           "printer = \"vial.toml\"\nresin = \"gel.toml\"\nvoxel_mm = 0.25\n"),
      IsEmpty());
  // The command line's, too.
  make_part(2);
  const RunResult r =
      farm("submit", {make_part(2), "--printer", dir / "vial.toml", "--resin", dir / "gel.toml",
                      "--mode", "tomography", "--voxel-mm", "0.25", "--speed-mm-h", "700"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("bridge-2.stl: --speed-mm-h has no place in a tomographic print"));
}

TEST_F(PrepareTomography, WhatCanNotBePrintedIsRefusedBeforeTheNight) {
  const std::string part = make_part(1), volume = make_volume("v.npy", 3);
  const auto why = [&](const std::function<void(JobRequest&)>& change) -> std::string {
    JobRequest r = request(part);
    change(r);
    const auto errors = refused({r});
    return errors.size() == 1 ? errors[0] : fmt::format("{} errors", errors.size());
  };
  const auto with_text = [&](const char* from, const std::string& what, const std::string& by) {
    std::string text = from;
    text.replace(text.find(what), what.size(), by);
    const std::string path = dir / "changed.toml";
    write_file(path, text);
    return path;
  };
  EXPECT_THAT(why([&](JobRequest& r) { r.setup.printer = dir / "small.toml"; }), HasSubstr("vial"));
  EXPECT_THAT(why([&](JobRequest& r) { r.setup.printer.clear(); }),
              HasSubstr("printer is missing"));
  EXPECT_THAT(why([&](JobRequest& r) {
                r.setup.printer = with_text(kVialPrinterToml,
                                            "[rotation]\ndeg_s = 25\ndirection = \"clockwise\"\n"
                                            "max_fps = 60\n",
                                            "");
              }),
              HasSubstr("rotation"));
  EXPECT_THAT(
      why([&](JobRequest& r) { r.setup.resin = with_text(kVialResinToml, "n = 1.5\n", ""); }),
      HasSubstr("refractive index"));
  EXPECT_THAT(why([](JobRequest& r) { r.scale = 2.6; }), HasSubstr("mm from the axis"));
  EXPECT_THAT(why([&](JobRequest& r) {
                r.parts = {volume};
                r.voxel_mm = 0;
                r.layer_um = 250;
              }),
              HasSubstr("voxel_mm is missing"));
  EXPECT_THAT(why([&](JobRequest& r) {
                r.parts = {volume, part};
              }),
              HasSubstr("expected meshes, or one volume"));
  EXPECT_THAT(why([&](JobRequest& r) { r.parts = {dir / "small.toml"}; }),
              HasSubstr("expected meshes, or one volume"));
  EXPECT_THAT(why([&](JobRequest& r) { r.parts = {dir / "gone.stl"}; }), HasSubstr("is not there"));
  EXPECT_THAT(why([&](JobRequest& r) { r.inserts = {dir / "gone.stl"}; }),
              HasSubstr("gone.stl: is not there"));
  EXPECT_THAT(why([](JobRequest& r) { r.format = "sl1"; }), HasSubstr("written as frames"));
  EXPECT_THAT(why([](JobRequest& r) { r.angles = 3000; }), HasSubstr("864 frames in a turn"));
  EXPECT_THAT(why([](JobRequest& r) { r.voxel_mm = 0.1; }), HasSubstr("rows are 0.125 mm high"));
  EXPECT_THAT(why([](JobRequest& r) {
                r.method = "ladder";
                r.clip_sigma = 3;
              }),
              HasSubstr("expected method osmo"));
  EXPECT_THAT(why([](JobRequest& r) {
                r.method = "";
                r.clip_sigma = 3;
              }),
              HasSubstr("method osmo"));
  // The insert is where the part is.
  EXPECT_THAT(why([&](JobRequest& r) { r.inserts = {part}; }), HasSubstr("insert"));
  EXPECT_THAT(why([&](JobRequest& r) {
                r.said["voxel_mm"] = {"here", false};
                r.said["layer_um"] = {"here", false};
                r.layer_um = 250;
              }),
              HasSubstr("voxel_mm and layer_um are two ways"));
  // A volume is no archive of slices.
  EXPECT_THAT(why([&](JobRequest& r) {
                r.parts = {volume};
                r.setup.mode = "";
              }),
              HasSubstr("is a volume; expected mode tomography"));
  write_file(dir / "cut.npy", text_of_file(volume).substr(0, 100));
  EXPECT_THAT(why([&](JobRequest& r) { r.parts = {dir / "cut.npy"}; }), HasSubstr("cut.npy"));
  EXPECT_EQ(queue->unfinished(), 0);

  // Physics alone has an exit code of its own: a turn takes 14.4 s.
  std::vector<std::string> arguments = tomo_options();
  arguments.insert(arguments.begin(), {part, "--mode", "tomography", "--max-time-s", "10"});
  const RunResult r = farm("submit", arguments);
  EXPECT_EQ(r.exit_code, 3) << r.err;
  EXPECT_THAT(r.err, HasSubstr("a turn of 14.4 s"));
}

}  // namespace
}  // namespace slicecorr::farm
