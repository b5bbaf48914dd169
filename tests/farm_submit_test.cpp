// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Jobs files and what is made of them: every error with its place, and nothing queued before all is
// right.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "farm_errors.hpp"
#include "farm_fixture.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::vector<std::string> toml_errors(const std::string& text) {
  return errors_of([&] { parse_jobs_toml(text, "jobs.toml"); });
}
std::vector<std::string> csv_errors(const std::string& text) {
  return errors_of([&] { parse_jobs_csv(text, "jobs.csv"); });
}

TEST(JobsFile, TomlSaysAllThereIs) {
  const auto jobs = parse_jobs_toml(R"(
[defaults]
printer = "small"
resin = "clear"
layer_um = 50

[[job]]
part = "a.stl"
speed_mm_h = 700
omega_max = "inf"

[[job]]
parts = ["b.stl", "c.stl"]
resin = "other"
mode = "layerwise"
exposure_s = 2.5
bottom_layers = 4
omega_max = 1.5
center_mm = [1.5, 2]
rotate_deg = [0, 90, 0]
scale = 2
copies = 3
priority = -4
ready_by = "07:00"
labels = ["night", "gpu"]
user = "berta"
out = "corrected"
name = "plate"
format = "sl1"
)",
                                    "jobs.toml");
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0].where, "jobs.toml: line 7");
  EXPECT_THAT(jobs[0].parts, ElementsAre("a.stl"));
  EXPECT_EQ(jobs[0].setup.printer, "small");
  EXPECT_EQ(jobs[0].setup.resin, "clear");
  EXPECT_EQ(jobs[0].setup.speed_mm_h, 700);
  EXPECT_EQ(jobs[0].layer_um, 50);
  EXPECT_EQ(jobs[0].copies, 1);
  const JobRequest& j = jobs[1];
  EXPECT_EQ(j.where, "jobs.toml: line 12");
  EXPECT_THAT(j.parts, ElementsAre("b.stl", "c.stl"));
  EXPECT_EQ(j.setup.resin, "other");
  EXPECT_EQ(j.setup.mode, "layerwise");
  EXPECT_EQ(j.setup.exposure_s, 2.5);
  EXPECT_EQ(j.setup.bottom_layers, 4);
  EXPECT_EQ(j.setup.omega_max, "1.5");
  EXPECT_THAT(j.center_mm, ElementsAre(1.5, 2));
  EXPECT_THAT(j.rotate_deg, ElementsAre(0, 90, 0));
  EXPECT_EQ(j.scale, 2);
  EXPECT_EQ(j.copies, 3);
  EXPECT_EQ(j.priority, -4);
  EXPECT_EQ(j.ready_by, "07:00");
  EXPECT_THAT(j.labels, ElementsAre("night", "gpu"));
  EXPECT_EQ(j.user, "berta");
  EXPECT_EQ(j.out, "corrected");
  EXPECT_EQ(j.name, "plate");
  EXPECT_EQ(j.format, "sl1");
}

TEST(JobsFile, ListsOfSlices) {
  const auto toml = parse_jobs_toml(
      "[[job]]\npart = \"a.stl\"\nslice_speed_mm_h = [800, 400]\nslice_lamps = \"stay\"\n",
      "jobs.toml");
  EXPECT_THAT(toml[0].setup.slice_speed_mm_h, ElementsAre(800, 400));
  EXPECT_EQ(toml[0].setup.slice_lamps, "stay");
  const auto csv = parse_jobs_csv("part,layer_exposure_s\na.stl,30; 8;2.5\n", "jobs.csv");
  EXPECT_THAT(csv[0].setup.layer_exposure_s, ElementsAre(30, 8, 2.5));
  EXPECT_THAT(errors_of([] {
                parse_jobs_toml("[[job]]\npart = \"a.stl\"\nslice_speed_mm_h = [800, -4]\n",
                                "j.toml");
              }),
              ElementsAre(HasSubstr("expected a list, each a number above 0")));
  // Of a request over HTTP all lists together are bounded, copies counted.
  std::string list = "[1";
  for (int n = 0; n < 1000; ++n) list += ",1";
  const std::string job =
      R"({"part": "a.stl", "slice_speed_mm_h": )" + list + R"(], "copies": 1000})";
  EXPECT_THAT(errors_of([&] { parse_jobs_json(R"({"jobs": [)" + job + "]}", "request"); }),
              ElementsAre(HasSubstr("has lists of more than 1000000 numbers, copies counted")));
}

TEST(JobsFile, CsvSaysTheSame) {
  const auto jobs = parse_jobs_csv(
      "\xef\xbb\xbf# of Tuesday\r\n"
      "part,printer,layer_um,copies,labels,center_mm,name\r\n"
      "a.stl,small,50,,,,\r\n"
      "\r\n"
      "\"b, c.stl\",small, 25 ,2,night; gpu,1.5;2,\"the \"\"big\"\" one\"\r\n",
      "jobs.csv");
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0].where, "jobs.csv: line 3");
  EXPECT_THAT(jobs[0].parts, ElementsAre("a.stl"));
  EXPECT_EQ(jobs[0].copies, 1);
  EXPECT_EQ(jobs[1].where, "jobs.csv: line 5");
  EXPECT_THAT(jobs[1].parts, ElementsAre("b, c.stl"));
  EXPECT_EQ(jobs[1].layer_um, 25);
  EXPECT_EQ(jobs[1].copies, 2);
  EXPECT_THAT(jobs[1].labels, ElementsAre("night", "gpu"));
  EXPECT_THAT(jobs[1].center_mm, ElementsAre(1.5, 2));
  EXPECT_EQ(jobs[1].name, "the \"big\" one");
}

TEST(JobsFile, JsonToo) {
  const auto jobs = parse_jobs_json(
      R"({"defaults": {"printer": "small"}, "jobs": [{"part": "a.stl", "copies": 2,
          "labels": ["x"], "center_mm": [1, 2]}, {"part": "b.stl", "printer": "large"}]})",
      "request");
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0].setup.printer, "small");
  EXPECT_EQ(jobs[0].copies, 2);
  EXPECT_THAT(jobs[0].center_mm, ElementsAre(1, 2));
  EXPECT_EQ(jobs[1].setup.printer, "large");
  EXPECT_EQ(jobs[1].where, "request: job 2");
}

TEST(JobsFile, EveryErrorHasItsLine) {
  EXPECT_THAT(
      toml_errors("[[job]]\npart = \"a.stl\"\nlayer_um = \"fifty\"\nspead_mm_h = 3\n"
                  "\n[[job]]\ncopies = 2.5\nmode = \"other\"\n"),
      ElementsAre("jobs.toml: line 3: layer_um is 'fifty', expected a number from 1 to 1000",
                  "jobs.toml: line 4: 'spead_mm_h' is not known; expected speed_mm_h?",
                  "jobs.toml: line 7: copies is 2.5, expected a whole number from 1 to 10000",
                  "jobs.toml: line 8: mode is 'other', expected one of continuous, layerwise, "
                  "tomography"));
  EXPECT_THAT(toml_errors("[[job]]\npart = \"a.stl\nx"),
              ElementsAre(HasSubstr("jobs.toml: line 2")));
  EXPECT_THAT(toml_errors("[job]\npart = \"a.stl\"\n"),
              ElementsAre(HasSubstr("jobs.toml: line 1: 'job' is not known here")));
  EXPECT_THAT(toml_errors("jobs = 3\n"), ElementsAre(HasSubstr("expected [defaults] and [[job]]")));
  EXPECT_THAT(toml_errors(""), ElementsAre("jobs.toml: has no [[job]]"));
  EXPECT_THAT(toml_errors("[[job]]\nready_by = 07:00:00\n"),
              ElementsAre(HasSubstr("jobs.toml: line 2: ready_by is neither")));
  EXPECT_THAT(toml_errors("[[job]]\nscale = 0\nscale_ = 1\nlabels = [1, \"x\"]\n"),
              ElementsAre(HasSubstr("line 2: scale is 0, expected a number above 0"),
                          HasSubstr("line 3: 'scale_' is not known"), HasSubstr("line 4: labels")));
}

TEST(JobsFile, EveryErrorOfATableHasItsLine) {
  EXPECT_THAT(csv_errors("part,layer_um\na.stl,x\nb.stl\nc.stl,5,6\n\"d.stl,5\n"),
              ElementsAre("jobs.csv: line 2: layer_um is 'x', expected a number from 1 to 1000",
                          "jobs.csv: line 3: has 1 fields, expected 2 as in the header",
                          "jobs.csv: line 4: has 3 fields, expected 2 as in the header",
                          "jobs.csv: line 5: a quoted field has no end"));
  EXPECT_THAT(csv_errors("part,layers_um\n"),
              ElementsAre("jobs.csv: line 1: column 'layers_um' is not known; expected layer_um?"));
  EXPECT_THAT(csv_errors("part,part\n"), ElementsAre(HasSubstr("is there twice")));
  EXPECT_THAT(csv_errors("part\n"), ElementsAre("jobs.csv: has no jobs below its header"));
  EXPECT_THAT(csv_errors("\n# nothing\n"), ElementsAre(HasSubstr("is empty")));
  EXPECT_THAT(csv_errors("part\n\"a\"b\n"), ElementsAre(HasSubstr("text after a quoted field")));
}

TEST(JobsFile, JsonErrorsNameTheJob) {
  const auto errors = [](const std::string& text) {
    return errors_of([&] { parse_jobs_json(text, "request"); });
  };
  EXPECT_THAT(errors("{"), ElementsAre(HasSubstr("request")));
  EXPECT_THAT(errors("{}"), ElementsAre(HasSubstr("expected {\"jobs\"")));
  EXPECT_THAT(errors(R"({"jobs": [{"part": "a"}, {"part": 3, "copies": 0}, 5], "x": 1})"),
              ElementsAre(HasSubstr("'x' is not known"), HasSubstr("request: job 2: copies is 0"),
                          HasSubstr("request: job 2: part is 3"),
                          HasSubstr("request: job 3: is no object")));
}

TEST(JobsFile, JsonIsBoundedBeforeAnythingIsMadeOfIt) {
  const auto errors = [](const std::string& text) {
    return errors_of([&] { parse_jobs_json(text, "request"); });
  };
  std::string jobs;
  for (int i = 0; i < 40; ++i) jobs += std::string(i ? "," : "") + R"({"part":"a","copies":10000})";
  EXPECT_THAT(errors("{\"jobs\":[" + jobs + "]}"),
              ElementsAre(HasSubstr("has 400000 jobs, copies counted; expected at most 2000")));
  jobs.clear();
  for (int i = 0; i < 2001; ++i) jobs += std::string(i ? "," : "") + "{}";
  EXPECT_THAT(errors("{\"jobs\":[" + jobs + "]}"), ElementsAre(HasSubstr("has 2001 jobs")));
  EXPECT_THAT(errors("{\"jobs\":" + std::string(60'000, '[') + std::string(60'000, ']') + "}"),
              ElementsAre(HasSubstr("nested more than 16 deep")));
  std::string keys;
  for (int i = 0; i < 1000; ++i) keys += fmt::format("{}\"k{}\":1", i ? "," : "", i);
  std::string wrong;
  for (int i = 0; i < 20; ++i) wrong += std::string(i ? "," : "") + "{" + keys + "}";
  EXPECT_LE(errors("{\"jobs\":[" + wrong + "]}").size(), 1100U) << "of one job, then no more";
}

// --- what is made of requests -------------------------------------------------------------------

class Prepare : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    folder = open_folder(farm_dir());
    queue.emplace(folder.database());
  }
  JobRequest request(const std::string& part) const {
    JobRequest r;
    r.where = "here";
    r.parts = {part};
    r.layer_um = 50;
    r.setup.printer = dir / "small.toml";
    r.setup.resin = dir / "clear.toml";
    r.setup.speed_mm_h = 700;
    return r;
  }
  Submission prepared(const std::vector<JobRequest>& requests, bool store = true) {
    return prepare(requests, folder, *queue, "anna", store, {});
  }
  std::string key_of(const JobRequest& r) { return prepared({r}).jobs.at(0).work.key; }
  std::vector<std::string> refused(const std::vector<JobRequest>& requests) {
    return errors_of([&] { prepared(requests); });
  }
  std::size_t files_in(const std::string& path) const {
    std::size_t n = 0;
    for (const auto& e : fs::recursive_directory_iterator(path)) n += e.is_regular_file();
    return n;
  }

  FarmFolder folder;
  std::optional<Queue> queue;
};

TEST_F(Prepare, TheKeyIsWhatDecidesTheOutput) {
  const std::string part = make_part(1);
  const JobRequest base = request(part);
  const std::string key = key_of(base);
  EXPECT_EQ(key.size(), 64u);
  EXPECT_EQ(key_of(base), key);
  // What decides nothing: where it lies and goes, what it is called, who wants it when.
  JobRequest same = base;
  fs::copy_file(part, dir / "elsewhere.stl");
  same.parts = {dir / "elsewhere.stl"};
  same.name = "other";
  same.out = dir / "out";
  same.user = "berta";
  same.priority = 7;
  same.labels = {"x"};
  same.ready_by = "07:00";
  EXPECT_EQ(key_of(same), key);
  // A definition under another path with the same content.
  fs::copy_file(dir / "small.toml", dir / "copy.toml");
  same.setup.printer = dir / "copy.toml";
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
  differs("two parts", [&](JobRequest& r) {
    r.parts.push_back(r.parts[0]);
    r.plate.overlap = "join";
  });
  differs("two parts side by side", [&](JobRequest& r) {
    r.parts.push_back(r.parts[0]);
    r.plate.arrange = true;
    r.plate.spacing_mm = 0.2;
  });
  differs("two parts further apart", [&](JobRequest& r) {
    r.parts.push_back(r.parts[0]);
    r.plate.arrange = true;
    r.plate.spacing_mm = 0.3;
  });
  differs("layer", [](JobRequest& r) { r.layer_um = 25; });
  differs("surface", [](JobRequest& r) { r.setup.surface = "slices"; });
  differs("antialias", [](JobRequest& r) { r.antialias = "off"; });
  differs("scale", [](JobRequest& r) { r.scale = 1.0000001; });
  differs("center", [](JobRequest& r) { r.center_mm = {2.4, 1.5}; });
  differs("rotation", [](JobRequest& r) { r.rotate_deg = {0, 0, 90}; });
  differs("speed", [](JobRequest& r) { r.setup.speed_mm_h = 700.0000000001; });
  differs("omega max", [](JobRequest& r) { r.setup.omega_max = "2"; });
  differs("gaps", [](JobRequest& r) { r.setup.one_slice_gaps = "merge"; });
  differs("edge aim", [](JobRequest& r) { r.setup.edge_aim_um = 0.5; });
  differs("shortfall", [](JobRequest& r) { r.setup.gap_shortfall = 0.2; });
  differs("resin depth", [](JobRequest& r) { r.setup.resin_depth_um = 5000; });
  differs("platform", [](JobRequest& r) { r.setup.platform_reflectance = 0.2; });
  differs("supports", [&](JobRequest& r) { r.leave_alone = {part}; });
  differs("other supports", [&](JobRequest& r) { r.leave_alone = {part, part}; });
  differs("features", [](JobRequest& r) {
    r.setup.omega_max = "2";
    r.setup.platform_features = "uncapped";
  });
  differs("overhangs", [](JobRequest& r) { r.setup.overhangs = "early"; });
  differs("dose", [](JobRequest& r) { r.setup.dc_mj_cm3 = 231; });
  differs("height", [](JobRequest& r) { r.setup.ha_um = 1501; });
  differs("ramp", [](JobRequest& r) {
    r.setup.ramp = "outside";
    r.setup.ramp_mm = 1;
  });
  differs("mode", [](JobRequest& r) {
    r.setup.mode = "layerwise";
    r.setup.speed_mm_h = 0;
    r.setup.exposure_s = 0.5;
  });
  differs("printer", [&](JobRequest& r) {
    std::string text = kSmallPrinterToml;
    text.replace(text.find("100.0]]"), 7, "100.5]]");
    write_file(dir / "other.toml", text);
    r.setup.printer = dir / "other.toml";
  });
  differs("format", [](JobRequest& r) { r.format = "sl1"; });
  // Formats that name their entries after the file.
  differs("format and name", [](JobRequest& r) {
    r.format = "sl1";
    r.name = "x";
  });
}

TEST_F(Prepare, CopiesOfAPartShareAPlate) {
  const std::string part = make_part(1);
  const auto copies = [&](const std::string& text) {
    JobRequest r = request(text);
    r.plate.spacing_mm = 0.2;
    return r;
  };
  const Submission two = prepared({copies(part + "*2")});
  ASSERT_EQ(two.jobs.size(), 1U);
  const WorkSpec spec = parse_spec(two.jobs[0].work.spec_json);
  ASSERT_EQ(spec.inputs.size(), 2U);
  EXPECT_EQ(spec.inputs[0].file, spec.inputs[1].file);
  EXPECT_TRUE(spec.plate.arrange);
  EXPECT_EQ(two.jobs[0].name, fs::path(part).stem().string());
  // The same as saying it twice, and other than one.
  JobRequest said = copies(part);
  said.parts = {part, part};
  said.plate.arrange = true;
  EXPECT_EQ(key_of(said), two.jobs[0].work.key);
  EXPECT_NE(key_of(request(part)), two.jobs[0].work.key);
  // A file of that name is a part.
  fs::copy_file(part, part + "*3.stl");
  EXPECT_EQ(parse_spec(prepared({request(part + "*3.stl")}).jobs[0].work.spec_json).inputs.size(),
            1U);
  EXPECT_THAT(refused({copies(part + "*20")}), ElementsAre(HasSubstr("plates of small's display")));
  EXPECT_THAT(refused({request(part + "*0")}), ElementsAre(HasSubstr("expected 1 to 1000 copies")));
  JobRequest turned = request(part + "*2");
  turned.setup.mode = "tomography";
  EXPECT_THAT(refused({turned}),
              ElementsAre(HasSubstr("copies have no place in a tomographic print")));
}

TEST_F(Prepare, PartsLieWhereTheyAreSaidToLie) {
  const std::string part = make_part(1);
  JobRequest r = request(part);
  r.parts = {part, part};
  r.plate.overlap = "join";
  r.plate.places_mm = {2, 1.5, 2, 1.5};
  const std::string same = key_of(r);
  r.plate.quarter_turns = {0, 1};
  EXPECT_NE(key_of(r), same);
  const WorkSpec spec = parse_spec(prepared({r}).jobs[0].work.spec_json);
  EXPECT_EQ(spec.plate, r.plate);
  r.plate.overlap = "refuse";
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("overlap")));
  r.plate.places_mm = {2, 1.5};
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("1 places and 2 quarter turns for 2 parts")));
  r.plate.places_mm = {2, 1.5, 1000, 1.5};
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("beyond the display")));
  r.plate.places_mm = {2, 1.5, 2, 1.5};
  r.plate.arrange = true;
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("expected one of them")));
  // Sizes and turns of their own are part of the work, copies each with them.
  r.plate = {};
  r.plate.arrange = true;
  r.plate.own_fit_mm = {1, 1.5};
  r.plate.own_rotate_deg = {0, 0, 90, 0, 0, 0};
  r.parts = {part, part + "*2"};
  const WorkSpec own = parse_spec(prepared({r}).jobs[0].work.spec_json);
  EXPECT_THAT(own.plate.own_fit_mm, ElementsAre(1, 1.5, 1.5));
  EXPECT_THAT(own.plate.own_rotate_deg, ElementsAre(0, 0, 90, 0, 0, 0, 0, 0, 0));
  EXPECT_EQ(own.inputs.size(), 3U);
  r.plate.own_fit_mm = {1};
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("expected one for each part")));
  const auto wrong = [&](const std::string& line) {
    return errors_of(
        [&] { parse_jobs_toml("[[job]]\npart = \"a.stl\"\n" + line + "\n", "j.toml"); });
  };
  EXPECT_THAT(wrong("quarter_turns = [0, 4]"), ElementsAre(HasSubstr("whole numbers from 0 to 3")));
  EXPECT_THAT(wrong("quarter_turns = [0.5]"), ElementsAre(HasSubstr("whole numbers from 0 to 3")));
  EXPECT_THAT(wrong("places_mm = \"here\""), ElementsAre(HasSubstr("a list of numbers")));
}

TEST_F(Prepare, InputsAreKeptByContentOnce) {
  const std::string part = make_part(1);
  fs::copy_file(part, dir / "twin.stl");
  const Submission s = prepared({request(part), request(dir / "twin.stl"), request(make_part(2))});
  EXPECT_EQ(files_in(folder.store + "/inputs"), 2u);
  EXPECT_EQ(s.jobs[0].work.key, s.jobs[1].work.key);
  EXPECT_FALSE(s.estimates[0].duplicate);
  EXPECT_TRUE(s.estimates[1].duplicate);
  const std::string file = s.jobs[0].work.input_files.at(0);
  EXPECT_EQ(text_of_file(folder.input(file)), text_of_file(part));
  EXPECT_TRUE(file.ends_with(".stl"));
  // The store's copy is damaged and the part submitted again: mended.
  write_file(folder.input(file), "damaged");
  prepared({request(part)});
  EXPECT_EQ(text_of_file(folder.input(file)), text_of_file(part));
  EXPECT_THAT(leftovers(folder.store), IsEmpty());
}

TEST_F(Prepare, ADryRunWritesNothing) {
  const Submission s = prepared({request(make_part(1))}, false);
  EXPECT_EQ(files_in(folder.store), 0u);
  const Estimate& e = s.estimates.at(0);
  // 1.05 mm high legs, 0.5 mm above: 31 layers; 2.6 x 1 mm at 50 um.
  EXPECT_EQ(e.layers, 31);
  EXPECT_EQ(e.voxels, 31 * 52 * 20);
  EXPECT_GT(e.seconds, 0);
  EXPECT_GT(e.disk_bytes, 0);
  EXPECT_GT(e.memory_mb, 0);
  EXPECT_FALSE(e.measured);
}

TEST_F(Prepare, LightThatSpreadsTakesLonger) {
  std::string text = kSmallPrinterToml;
  text.replace(text.find("[blue]\n"), 7, "[blue]\nspread = [[40.0, 1.0]]\n");
  write_file(dir / "blurred.toml", text);
  const Submission even = prepared({request(make_part(1))}, false);
  JobRequest r = request(make_part(1));
  r.setup.printer = dir / "blurred.toml";
  const Submission together = prepared({r}, false);
  r.setup.spread_correction = "off";
  const Submission alone = prepared({r}, false);
  EXPECT_EQ(together.jobs[0].work.rate_class, even.jobs[0].work.rate_class + " together");
  EXPECT_EQ(alone.jobs[0].work.rate_class, even.jobs[0].work.rate_class);
  EXPECT_GT(together.estimates[0].seconds - kFixedJobS,
            10 * (even.estimates[0].seconds - kFixedJobS));
  EXPECT_EQ(alone.estimates[0].seconds, even.estimates[0].seconds);
  EXPECT_EQ(alone.estimates[0].memory_mb, even.estimates[0].memory_mb);
}

TEST_F(Prepare, CopiesAreTheSameWork) {
  JobRequest r = request(make_part(1));
  r.copies = 3;
  r.out = dir / "out";
  const Submission s = prepared({r});
  ASSERT_EQ(s.jobs.size(), 3u);
  EXPECT_EQ(s.jobs[0].name, "bridge-1");
  EXPECT_EQ(s.jobs[1].name, "bridge-1-2");
  EXPECT_EQ(s.jobs[2].name, "bridge-1-3");
  EXPECT_EQ(s.jobs[0].work.key, s.jobs[2].work.key);
}

TEST_F(Prepare, AllThatIsWrongIsToldAndNothingQueued) {
  write_file(dir / "empty.stl", "");
  write_file(dir / "large.stl", stl_of({{0, 50, 0, 1, 0, 1}}));
  std::vector<JobRequest> list;
  const auto add = [&](const std::string& where, const std::string& part,
                       const std::function<void(JobRequest&)>& change = {}) {
    JobRequest r = request(part);
    r.where = where;
    if (change) change(r);
    list.push_back(r);
  };
  const std::string part = make_part(1);
  add("1", part);
  add("2", dir / "missing.stl");
  add("3", dir / "empty.stl");
  add("4", dir / "large.stl");
  add("5", part, [](JobRequest& r) { r.setup.printer = "no-such-printer"; });
  add("6", part, [](JobRequest& r) { r.setup.speed_mm_h = 0; });
  add("7", part, [](JobRequest& r) {
    r.setup.speed_mm_h = 1999;
    r.setup.dc_mj_cm3 = 1e5;
  });
  add("8", part, [](JobRequest& r) { r.layer_um = 0; });
  add("9", part, [](JobRequest& r) { r.ready_by = "7 o'clock"; });
  add("10", part, [](JobRequest& r) { r.format = "docx"; });
  add("11", part, [](JobRequest& r) { r.name = "a/b"; });
  add("12", part, [&](JobRequest& r) { r.out = dir / "empty.stl/out"; });
  add("13", dir.path());
  add("14", part, [](JobRequest& r) { r.parts.clear(); });
  add("15", dir / "small.toml");
  const std::vector<std::string> errors = refused(list);
  std::vector<std::string> places;
  for (const std::string& e : errors) places.push_back(e.substr(0, e.find(':')));
  EXPECT_THAT(places, ElementsAre("2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12", "13",
                                  "14", "15"))
      << fmt::format("{}", fmt::join(errors, "\n"));
  EXPECT_EQ(queue->unfinished(), 0);
  EXPECT_EQ(files_in(folder.store), 0u);
}

TEST_F(Prepare, HowSureGoesWithTheJob) {
  JobRequest r = request(make_part(1));
  const std::string plain = key_of(r);
  r.uncertain = "ha=5%,dc=5%";
  const Submission s = prepared({r});
  ASSERT_EQ(s.jobs.size(), 1u);
  EXPECT_NE(s.jobs[0].work.key, plain);
  const WorkSpec spec = parse_spec(s.jobs[0].work.spec_json);
  EXPECT_EQ(spec.uncertain, "ha=5%,dc=5%");
  EXPECT_FALSE(spec.robust);
  JobRequest robust = r;
  robust.robust = true;
  EXPECT_NE(key_of(robust), key_of(r));
  robust.uncertain.clear();
  EXPECT_THAT(refused({robust}), ElementsAre(HasSubstr("robust")));
  r.uncertain = "ha=99%";
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("30 %")));
}

TEST_F(Prepare, SpeedsAreFoundWherePlanIsAsked) {
  JobRequest r = request(make_part(1));
  r.plan = true;
  r.setup.speed_mm_h = 0;
  const Submission s = prepared({r});
  ASSERT_EQ(s.jobs.size(), 1u);
  const double speed = json::parse(s.jobs[0].work.setup_json)["process"]["speed_mm_h"];
  EXPECT_GT(speed, 10);
  EXPECT_THAT(s.estimates[0].planned, HasSubstr(fmt::format("{:g} mm/h, limited by", speed)));
  EXPECT_THAT(s.jobs[0].labels, ElementsAre(fmt::format("planned {:g} mm/h", speed)));
  // The same work as if the speed had been said.
  JobRequest said = request(r.parts[0]);
  said.setup.speed_mm_h = speed;
  EXPECT_EQ(key_of(said), s.jobs[0].work.key);
  // More light error or contrast than any speed keeps is refused like other physics.
  JobRequest far = r;
  far.tolerance_um = 0.01;
  far.where = "far";
  JobRequest both = r;
  both.where = "both";
  both.said["speed_mm_h"] = {"both", false};
  const std::vector<std::string> errors = refused({r, far, both});
  ASSERT_EQ(errors.size(), 2u);
  EXPECT_THAT(errors[0], HasSubstr("far: no speed prints this part as asked"));
  EXPECT_THAT(errors[1], HasSubstr("both: speed_mm_h is what plan finds"));
  const auto jobs = parse_jobs_toml(
      "[[job]]\npart = \"a.stl\"\nplan = true\ntolerance_um = 12.5\ngap_contrast = 0.03\n",
      "jobs.toml");
  ASSERT_EQ(jobs.size(), 1u);
  EXPECT_TRUE(jobs[0].plan);
  EXPECT_EQ(jobs[0].tolerance_um, 12.5);
  EXPECT_EQ(jobs[0].gap_contrast, 0.03);
}

TEST_F(Prepare, OutputsMustNotMeet) {
  const std::string part = make_part(1);
  JobRequest a = request(part), b = request(make_part(2));
  a.where = "a";
  b.where = "b";
  a.out = b.out = dir / "out";
  b.name = "bridge-1";
  EXPECT_THAT(refused({a, b}), ElementsAre(HasSubstr("is written by a, too")));
  b.name = "";
  b.copies = 2;
  JobRequest c = request(part);
  c.out = dir / "out";
  c.name = "bridge-2-2";
  EXPECT_THAT(refused({a, b, c}), ElementsAre(HasSubstr("is written by b, too")));
  submit(prepared({a}), folder, *queue, "anna", "test");
  EXPECT_THAT(refused({a}), ElementsAre(HasSubstr("will be written by job 1")));
  // In the farm's own folder every job has its place.
  a.out.clear();
  EXPECT_THAT(refused({a, a}), IsEmpty());
}

TEST_F(Prepare, AnOutputNeverReplacesAnInput) {
  const std::string stack = dir / "part.uvj";
  auto arguments = process_options();
  arguments.resize(6);                                            // without the speed
  arguments.erase(arguments.begin() + 2, arguments.begin() + 4);  // nor the resin
  std::vector<std::string> slice = {"slice", make_part(1), "-o", stack};
  slice.insert(slice.end(), arguments.begin(), arguments.end());
  ASSERT_EQ(program("slicecorr", slice).exit_code, 0);
  JobRequest r = request(stack);
  r.out = dir.path();
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("is an input")));
  r.name = "corrected";
  EXPECT_THAT(refused({r}), IsEmpty());
  // What is said of meshes is not passed over; a default is for the jobs that it fits.
  for (const char* key : {"arrange", "scale"}) {
    r.said = {{key, {"line 7", false}}};
    EXPECT_THAT(refused({r}), ElementsAre(HasSubstr(std::string("line 7: ") + key +
                                                    " is for meshes; the slices of an archive")));
    r.said = {{key, {"line 2", true}}};
    EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("line 2")));
    EXPECT_THAT(refused({r,
                         [&] {
                           JobRequest mesh = request(make_part(2));
                           mesh.said = r.said;
                           return mesh;
                         }()}),
                IsEmpty());
  }
}

TEST_F(Prepare, DeadlinesAreTheNextTimeClocksShowThem) {
  JobRequest r = request(make_part(1));
  r.ready_by = "07:00";
  const std::int64_t now = system_clock().wall_ms();
  const std::int64_t by = prepared({r}).jobs[0].ready_by_ms;
  EXPECT_GT(by, now);
  EXPECT_LE(by - now, 25 * 3'600'000) << "25 hours on the day that summer time ends";
  EXPECT_EQ(local_minute(by), 7 * 60);
  r.ready_by = "2999-12-31 23:59";
  EXPECT_GT(prepared({r}).jobs[0].ready_by_ms, by);
  r.ready_by = "1999-12-31 23:59";
  EXPECT_THAT(refused({r}), ElementsAre(HasSubstr("which is over")));
}

TEST_F(Prepare, WhatWasMeasuredIsUsedForEstimates) {
  const Submission first = prepared({request(make_part(1))});
  submit(first, folder, *queue, "anna", "test");
  const std::string service = queue->start_service("local", 1, 1000);
  const auto c = queue->claim(any_job(service));
  ASSERT_TRUE(c);
  ASSERT_TRUE(queue->begin_commit(c->token));
  AttemptEnd e = ended(Reason::none);
  e.cpu_s = kFixedJobS + 2;
  ASSERT_TRUE(queue->finish(c->token, some_result(), e, false));
  const Estimate again = prepared({request(make_part(2))}).estimates.at(0);
  EXPECT_TRUE(again.measured);
  EXPECT_NEAR(again.seconds,
              kFixedJobS + 2.0 * static_cast<double>(again.voxels) /
                               static_cast<double>(first.estimates[0].voxels),
              1e-9);
}

// --- the program --------------------------------------------------------------------------------

TEST_F(FarmPrograms, SubmitRefusesAFileAsAWhole) {
  make_part(1);
  write_file(dir / "jobs.toml", fmt::format(R"([defaults]
printer = "small.toml"
resin = "clear.toml"
layer_um = 50
speed_mm_h = 700
[[job]]
part = "bridge-1.stl"
[[job]]
part = "nothing.stl"
[[job]]
part = "bridge-1.stl"
speed_mm_h = 100000
)"));
  const RunResult r = farm("submit", {dir / "jobs.toml"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("jobs.toml: line 8: "));
  EXPECT_THAT(r.err, HasSubstr("nothing.stl: is not there"));
  EXPECT_THAT(r.err, HasSubstr("jobs.toml: line 10: "));
  EXPECT_EQ(ReadModel(database()).count({}), 0);
}

TEST_F(FarmPrograms, SubmitTakesPathsFromTheFilesFolderAndOptionsAsDefaults) {
  make_part(1);
  make_part(2);
  write_file(dir / "jobs.csv", "part,resin,out\nbridge-1.stl,clear.toml,done\nbridge-2.stl,,\n");
  RunOptions o;
  o.folder = "/";
  const RunResult r =
      farm("submit",
           {dir / "jobs.csv", "--printer", dir / "small.toml", "--resin", dir / "clear.toml",
            "--layer-um", "50", "--speed-mm-h", "700", "--label", "night", "--json", "-"},
           o);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json jobs = json::parse(r.out)["jobs"];
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0]["id"], 1);
  EXPECT_EQ(jobs[0]["where"], (dir / "jobs.csv") + ": line 2");
  ReadModel model(database());
  EXPECT_EQ(model.job(1)->output_folder, dir / "done");
  EXPECT_EQ(model.job(2)->output_folder, farm_dir() + "/results/2");
  EXPECT_EQ(model.job(1)->user, "anna");
  EXPECT_THAT(model.job(2)->labels, ElementsAre("night"));
}

TEST_F(FarmPrograms, ADryRunSaysWhatItWouldTake) {
  const RunResult r =
      farm("submit", {make_part(1), "--printer", dir / "small.toml", "--resin", dir / "clear.toml",
                      "--layer-um", "50", "--speed-mm-h", "700", "--dry-run", "--copies", "2"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("bridge-1-2"));
  EXPECT_THAT(r.out, HasSubstr("with another job"));
  EXPECT_THAT(r.out, HasSubstr("2 jobs"));
  EXPECT_EQ(ReadModel(database()).count({}), 0);
}

}  // namespace
}  // namespace slicecorr::farm
