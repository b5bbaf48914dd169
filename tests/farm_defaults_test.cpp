// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a jobs file says for all jobs: it holds where it has a place, and is passed over elsewhere. All
// errors of a file are told at once. What nobody measured is told before the night.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <random>

#include "farm_errors.hpp"
#include "farm_fixture.hpp"
#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/misfit.hpp"
#include "slicecorr/settings.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class PrepareDefaults : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    folder = open_folder(farm_dir());
    queue.emplace(folder.database());
    write_file(dir / "a.stl", bridge_stl(1));
    write_file(dir / "b.stl", bridge_stl(2));
    write_file(dir / "c.stl", bridge_stl(3));
  }
  /// Jobs of a file whose [defaults] begin with printer, resin and layer height, on lines 2 to 4.
  std::vector<JobRequest> requests(const std::string& text) const {
    write_file(
        dir / "jobs.toml",
        "[defaults]\nprinter = \"small.toml\"\nresin = \"clear.toml\"\nlayer_um = 50\n" + text);
    return read_jobs_to_check(dir / "jobs.toml");
  }
  Submission prepared(const std::vector<JobRequest>& requests) {
    told.clear();
    ExecutionContext context;
    context.notice = [this](const std::string& text) { told.push_back(text); };
    return prepare(requests, folder, *queue, "anna", false, context);
  }
  Submission of(const std::string& text) { return prepared(requests(text)); }
  std::vector<std::string> refused(const std::string& text) {
    return errors_of([&] { of(text); });
  }
  std::string line(int n) const { return fmt::format("{}: line {}", dir / "jobs.toml", n); }

  FarmFolder folder;
  std::optional<Queue> queue;
  std::vector<std::string> told;
};

TEST_F(PrepareDefaults, ArePassedOverInJobsThatHaveNoPlaceForThem) {
  const std::string with_default = "speed_mm_h = 700\nramp = \"outside\"\nramp_mm = 1\n";
  const std::string jobs =
      "[[job]]\npart = \"a.stl\"\n"
      "[[job]]\npart = \"b.stl\"\nmode = \"layerwise\"\nexposure_s = 6\n"
      "[[job]]\npart = \"c.stl\"\nplan = true\n";
  const Submission all = of(with_default + jobs);
  ASSERT_EQ(all.jobs.size(), 3U);
  const auto process = [&](std::size_t n) {
    return parse_setup_json(all.jobs[n].work.setup_json, "setup").process;
  };
  EXPECT_EQ(process(0).speed_mm_h, 700);
  EXPECT_EQ(process(0).ramp, Ramp::outside);
  EXPECT_EQ(process(1).mode, ExposureMode::layerwise);
  EXPECT_EQ(process(1).exposure_s, 6);
  EXPECT_EQ(process(1).ramp, Ramp::none);
  EXPECT_NE(all.estimates[2].planned, "");
  const auto once = [&](const std::string& what) {
    return std::count_if(told.begin(), told.end(),
                         [&](const std::string& text) { return text.find(what) != text.npos; });
  };
  EXPECT_EQ(once(line(5) + ": the default speed_mm_h is passed over"), 2) << "two reasons";
  EXPECT_EQ(once(line(6) + ": the default ramp is passed over"), 1);
  EXPECT_EQ(once(line(7) + ": the default ramp_mm is passed over"), 1);
  EXPECT_EQ(once(": 1 of 3 jobs"), 4);
  // The same jobs as without those defaults.
  const Submission none =
      of("[[job]]\npart = \"b.stl\"\nmode = \"layerwise\"\nexposure_s = 6\n"
         "[[job]]\npart = \"c.stl\"\nplan = true\nramp = \"outside\"\nramp_mm = 1\n");
  EXPECT_EQ(none.jobs[0].work.key, all.jobs[1].work.key);
  EXPECT_EQ(none.jobs[1].work.key, all.jobs[2].work.key);
}

TEST_F(PrepareDefaults, WhatAJobSaysItselfIsNeverPassedOver) {
  const std::string by_default =
                        "[[job]]\npart = \"a.stl\"\nmode = \"layerwise\"\nexposure_s = 6\n",
                    by_itself = by_default + "speed_mm_h = 700\n",
                    fits = "[[job]]\npart = \"b.stl\"\n";
  // In both orders: the two are alike but for who says the speed.
  for (const auto& [text, at] : {std::pair{by_default + by_itself + fits, 10},
                                 std::pair{by_itself + by_default + fits, 6}}) {
    EXPECT_THAT(
        refused("speed_mm_h = 700\n" + text),
        ElementsAre(line(at) + ": speed_mm_h is for continuous exposure; expected exposure_s "
                               "with mode layerwise"));
  }
  EXPECT_THAT(refused("[[job]]\npart = \"a.stl\"\nplan = true\nspeed_mm_h = 700\n"),
              ElementsAre(HasSubstr("speed_mm_h is what plan finds")));
  // Where all are to be planned, one that says its speed is not.
  const Submission one =
      of("plan = true\n[[job]]\npart = \"a.stl\"\nspeed_mm_h = 700\n"
         "[[job]]\npart = \"b.stl\"\n");
  EXPECT_EQ(one.estimates[0].planned, "");
  EXPECT_NE(one.estimates[1].planned, "");
}

TEST_F(PrepareDefaults, ThatFitNoJobAreRefusedWhereTheyStand) {
  const std::string layerwise = "[[job]]\npart = \"a.stl\"\nmode = \"layerwise\"\nexposure_s = 6\n";
  EXPECT_THAT(refused("speed_mm_h = 700\n" + layerwise),
              ElementsAre(HasSubstr(line(5) + ": speed_mm_h is for continuous exposure")));
  // A job's own word that a default has no place for: the default is named.
  EXPECT_THAT(refused("mode = \"layerwise\"\n[[job]]\npart = \"a.stl\"\nspeed_mm_h = 700\n"),
              ElementsAre(AllOf(HasSubstr(line(6) + ": speed_mm_h is for continuous exposure"),
                                HasSubstr("(mode is a default, " + line(5) + ")"))));
  // Light is never left out in silence.
  EXPECT_THAT(refused("uv_mw_cm2 = 5\n[[job]]\npart = \"a.stl\"\nspeed_mm_h = 700\n"),
              ElementsAre(AllOf(HasSubstr(line(6) + ": uv_mw_cm2: resin"),
                                HasSubstr("uv_mw_cm2 is a default, " + line(5) + ")"))));
}

/// Of five jobs four are wrong in ways that are found at different times.
TEST_F(PrepareDefaults, AllErrorsAreToldAtOnce) {
  const std::string jobs =
      "speed_mm_h = 700\n"
      "[[job]]\npart = \"a.stl\"\nlayer_um = \"fifty\"\n"
      "[[job]]\npart = \"gone.stl\"\n"
      "[[job]]\npart = \"b.stl\"\nplan = true\nexposure_s = 2\n"
      "[[job]]\npart = \"b.stl\"\nfit_mm = 2\nscale = 3\n"
      "[[job]]\npart = \"c.stl\"\nfor = \"nobody\"\n"
      "[[job]]\npart = \"c.stl\"\n";
  EXPECT_THAT(refused(jobs),
              ElementsAre(HasSubstr(line(8) + ": layer_um is 'fifty'"),
                          AllOf(HasSubstr(line(9)), HasSubstr("gone.stl: is not there")),
                          HasSubstr(line(11) + ": exposure_s is what plan finds"),
                          HasSubstr(line(15) + ": fit_mm and scale exclude each other"),
                          HasSubstr(line(19) + ": ")));
  const RunResult all = farm("submit", {dir / "jobs.toml"});
  EXPECT_EQ(all.exit_code, 2);
  EXPECT_THAT(all.err, AllOf(HasSubstr("queues the 1 of 6 jobs that can be done"),
                             HasSubstr("line 8: "), HasSubstr("line 19: ")));
  const RunResult some = farm("submit", {dir / "jobs.toml", "--skip-bad"});
  EXPECT_EQ(some.exit_code, 0) << some.err;
  EXPECT_THAT(some.err, HasSubstr("job 1 queued"));
}

/// Every setting, in both modes, at values of its table: what is named as too many was said, and without it the
/// next word is another one.
TEST_F(PrepareDefaults, MisfitsNameWhatIsSaid) {
  std::mt19937 random(7);
  std::set<std::string> named;
  for (int round = 0; round < 100; ++round) {
    SetupChoices choices;
    choices.printer = "dual-wavelength-dlp";
    choices.resin = "benchy-resin";
    choices.mode = round % 2 == 0 ? "layerwise" : "continuous";
    for (const Setting& s : settings()) {
      if (random() % 4 != 0 || s.name == "mode" || s.name.ends_with("_toml")) continue;
      std::visit(
          [&](auto chosen) {
            using Value = std::decay_t<decltype(choices.*chosen)>;
            const double number = std::min(std::max(s.range.least + 1, 1.0), s.range.most);
            if constexpr (std::is_same_v<Value, std::string>) {
              if (!s.words.empty()) choices.*chosen = s.words[random() % s.words.size()];
            } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
              choices.*chosen = {number};
            } else {
              choices.*chosen = static_cast<Value>(number);
            }
          },
          s.chosen);
    }
    for (int step = 0;; ++step) {
      ASSERT_LT(step, 40);
      try {
        resolve_setup(choices, nullptr, nullptr, ChoiceNames::fields);
        break;
      } catch (const MisfitError& e) {
        ASSERT_FALSE(e.settings().empty());
        const Setting* const s = find_setting(e.settings().front());
        ASSERT_NE(s, nullptr) << e.what();
        ASSERT_TRUE(is_said(*s, choices)) << e.what();
        named.insert(std::string(s->name));
        static const SetupChoices unset;
        std::visit([&](auto chosen) { choices.*chosen = unset.*chosen; }, s->chosen);
      } catch (const Error&) {
        break;  // what no leaving out mends
      }
    }
  }
  for (const char* name : {"speed_mm_h", "ramp", "exposure_s", "lifts", "lift_exchange"}) {
    EXPECT_TRUE(named.contains(name)) << name;
  }
}

TEST_F(PrepareDefaults, WhatNobodyMeasuredIsToldAtOnce) {
  const std::string job = "[[job]]\npart = \"a.stl\"\n";
  const auto spec = [](const Submission& s) { return parse_spec(s.jobs.at(0).work.spec_json); };
  EXPECT_THAT(spec(of("speed_mm_h = 700\n" + job)).warnings, IsEmpty());
  EXPECT_THAT(told, IsEmpty());
  const auto database =
      HasSubstr("resin 'benchy-resin' is from the database, not measured on this");
  EXPECT_THAT(spec(of(job + "speed_mm_h = 700\nresin = \"benchy-resin\"\n")).warnings,
              ElementsAre(database));
  EXPECT_THAT(told, Contains(database));
  // Printed by assumed light on a display that is said to show no grey.
  const auto warnings =
      spec(of(job + "printer = \"elegoo-mars\"\nresin = \"liqcreate-strong-x-405nm\"\n"
                    "assume = \"typical\"\nmode = \"layerwise\"\nexposure_s = 8\n"))
          .warnings;
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("'elegoo-mars' is said to show no grey at all"),
                                    HasSubstr("'liqcreate-strong-x-405nm' is from the database")));
  for (const std::string& text : warnings) EXPECT_THAT(told, Contains(text));
  EXPECT_THAT(told, Contains(HasSubstr("assumed, not measured: grey levels")));
}

/// A stack of meshes leaves its design beside it: another job may not write there.
TEST_F(PrepareDefaults, DesignsBesideStacksAreOutputsToo) {
  const std::string stack = dir / "a-target.uvj";
  ASSERT_EQ(program("slicecorr", {"slice", dir / "a.stl", "-o", stack, "--printer",
                                  dir / "small.toml", "--layer-um", "50"})
                .exit_code,
            0);
  const std::string mesh = "speed_mm_h = 700\nout = \"out\"\n[[job]]\npart = \"a.stl\"\n",
                    slices = "[[job]]\npart = \"a-target.uvj\"\nlayer_um = 50\n";
  EXPECT_THAT(
      refused(mesh + slices),
      ElementsAre(AllOf(HasSubstr(line(9)), HasSubstr("a-target.uvj is written by " + line(7)))));
  EXPECT_THAT(refused(mesh + slices + "name = \"b\"\n"), IsEmpty());
  // Beside its part.
  EXPECT_THAT(
      refused(
          "speed_mm_h = 700\nout = \".\"\n[[job]]\npart = \"a.stl\"\n[[job]]\npart = \"a-target.uvj\"\nname = \"b\"\n"),
      ElementsAre(AllOf(HasSubstr(line(7)), HasSubstr("a-target.uvj is an input"))));
  // What is queued counts.
  submit(prepare(requests(mesh), folder, *queue, "anna", true, {}), folder, *queue, "anna", "test");
  EXPECT_THAT(refused("speed_mm_h = 700\nout = \"out\"\n" + slices),
              ElementsAre(HasSubstr("job 1, which is not finished, writes a there")));
}

}  // namespace
}  // namespace slicecorr::farm
