// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// slicecorr-post on one file: what changes and what does not, rules, backup, undo, refusals, and
/// that a kill at any moment leaves the old or the new file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "killed_after.hpp"
#include "post/config.hpp"
#include "post/files.hpp"
#include "post/profiles.hpp"
#include "post_fixture.hpp"
#include "rounds.hpp"
#include "support/files/sha256.hpp"

namespace slicecorr::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Post : public PostFolder {
 protected:
  Post() { make_sl1(folder_ / "part.sl1"); }
  /// Fails with the code and words, changes nothing.
  void bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    const auto names_before = names();
    const Bytes before = there("part.sl1") ? bytes("part.sl1") : Bytes{};
    const RunResult r = post(arguments);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(arguments) << r.err;
    for (const auto& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_EQ(names(), names_before);
    if (!before.empty()) {
      EXPECT_EQ(bytes("part.sl1"), before);
    }
  }
};

TEST_F(Post, ChangesLayerImagesAndNothingElse) {
  const Entries before = unzip(folder_ / "part.sl1");
  ASSERT_EQ(::chmod((folder_ / "part.sl1").c_str(), 0640), 0);
  const RunResult said = good(kSmall + Command{"part.sl1"});
  EXPECT_THAT(said.err, HasSubstr("part.sl1: 50 slices corrected, printer 'small'"));
  EXPECT_THAT(
      said.err,
      HasSubstr("layer by layer, 0.1 s each; the first layer 0.2 s, then 2 in steps between"));
  EXPECT_THAT(said.err, HasSubstr("height error, mean"));
  EXPECT_THAT(names(), ::testing::ElementsAre("config", "db", "part.sl1", "small.toml"));

  const Entries after = unzip(folder_ / "part.sl1");
  ASSERT_EQ(after.size(), before.size() + 1);
  EXPECT_EQ(after.back().first, "slicecorr.json");
  int images = 0, changed = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    ASSERT_EQ(after[i].first, before[i].first);
    if (!is_layer_image(before[i].first)) {
      EXPECT_EQ(after[i].second, before[i].second) << before[i].first;
      continue;
    }
    ++images;
    const GreyImage was = png_pixels(before[i].second), is = png_pixels(after[i].second);
    EXPECT_EQ(is.width_px, was.width_px);
    EXPECT_EQ(is.height_px, was.height_px);
    changed += is.pixels != was.pixels;
  }
  EXPECT_EQ(images, 50);
  // The first layers over the gaps; the others keep their light.
  EXPECT_GE(changed, 2);
  struct stat status;
  ASSERT_EQ(::stat((folder_ / "part.sl1").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0640U);
}

TEST_F(Post, ShowsWhatCorrectShows) {
  fs::copy_file(folder_ / "part.sl1", folder_ / "target.sl1");
  const Command setup{"--printer", "small.toml", "--resin", "figure-2-2"};
  const Command ways[] = {{"--ha-um", "110", "--mode", "layerwise"}, {"--speed-mm-h", "900"}};
  for (const Command& way : ways) {
    SCOPED_TRACE(way.front());
    fs::copy_file(folder_ / "target.sl1", folder_ / "part.sl1",
                  fs::copy_options::overwrite_existing);
    good(setup + way + Command{"part.sl1"});
    const RunResult r = run_program(
        Command{SLICECORR_BIN_DIR "/slicecorr", "correct", "target.sl1", "-o", "correct.uvj"} +
            setup + way,
        options_);
    ASSERT_EQ(r.exit_code, 0) << r.err;
    std::vector<Bytes> expected, images;
    for (const auto& [name, data] : unzip(folder_ / "correct.uvj")) {
      if (name.starts_with("slice/")) expected.push_back(png_pixels(data).pixels);
    }
    for (const auto& [name, data] : unzip(folder_ / "part.sl1")) {
      if (is_layer_image(name)) images.push_back(png_pixels(data).pixels);
    }
    EXPECT_GE(images.size(), 50U);
    EXPECT_EQ(images, expected);
  }
}

TEST_F(Post, AFirstExposureStaysOnlyWhereItIsLonger) {
  const Command anew = kSmall + Command{"--backup", "--again", "part.sl1", "--exposure-s"};
  const auto config = [&] {
    Entries entries = unzip(folder_ / "part.sl1");
    return to_text(entry(entries, "config.ini"));
  };
  const RunResult kept = good(anew + Command{"0.15"});
  EXPECT_THAT(kept.err, HasSubstr("the archive's longer first exposure stays: 0.15 s each; the "
                                  "first layer 0.2 s, then 2 in steps between\n"));
  EXPECT_THAT(config(), AllOf(HasSubstr("expTime = 0.15\n"), HasSubstr("expTimeFirst = 0.2\n")));
  const RunResult left = good(anew + Command{"0.3"});
  EXPECT_THAT(left.err, HasSubstr("the archive's first exposure of 0.2 s is not longer than the "
                                  "new one: layers get 0.3 s from the first on\n"));
  EXPECT_THAT(left.err, HasSubstr("layer by layer, 0.3 s each\n"));
  EXPECT_THAT(config(), AllOf(HasSubstr("expTime = 0.3\n"), HasSubstr("expTimeFirst = 0.3\n")));
  // As the archive has it, there is nothing to be told.
  EXPECT_THAT(good(anew + Command{"0.1"}).err, Not(HasSubstr("first exposure")));
  // Times with which nothing gels, the first as little as the others.
  Sl1Options weak;
  weak.exposure_s = 0.05;
  weak.first_s = 0.06;
  make_sl1(folder_ / "part.sl1", weak);
  good(kSmall + Command{"--exposure-s", "0.2", "part.sl1"});
}

TEST_F(Post, ContinuousWritesItsTimesAndSlices) {
  good({"--printer", "small", "--resin", "figure-2-2", "--speed-mm-h", "900", "part.sl1"});
  Entries entries = unzip(folder_ / "part.sl1");
  // 50 um at 900 mm/h take 0.2 s.
  EXPECT_THAT(to_text(entry(entries, "config.ini")), HasSubstr("expTime = 0.2\n"));
  const auto images = std::count_if(entries.begin(), entries.end(),
                                    [](const auto& e) { return is_layer_image(e.first); });
  EXPECT_THAT(to_text(entry(entries, "config.ini")),
              HasSubstr("numFast = " + std::to_string(images)));
}

TEST_F(Post, IsNotCorrectedTwice) {
  good(kSmall + Command{"part.sl1"});
  bad(2, kSmall + Command{"part.sl1"},
      {"part.sl1: is already corrected", "printer 'small'", "figure-2-2",
       "layer by layer, 0.1 s each; the first layer 0.2 s", "--again"});
  bad(2, kSmall + Command{"--again", "part.sl1"}, {"part.sl1.orig", "no backup"});
}

TEST_F(Post, BackupUndoAndAgain) {
  const Bytes original = bytes("part.sl1");
  const RunResult said = good(kSmall + Command{"--backup", "part.sl1"});
  EXPECT_THAT(said.err, HasSubstr("part.sl1.orig"));
  EXPECT_EQ(bytes("part.sl1.orig"), original);
  const Bytes first = bytes("part.sl1");
  ASSERT_NE(first, original);

  good(kSmall + Command{"--again", "--exposure-s", "0.15", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1.orig"), original);
  EXPECT_NE(bytes("part.sl1"), first);
  good(kSmall + Command{"--again", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1"), first) << "the same as from the original";

  good({"--undo", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1"), original);
  EXPECT_FALSE(there("part.sl1.orig"));
  bad(2, {"--undo", "part.sl1"}, {"part.sl1: is not corrected"});
}

TEST_F(Post, UndoTakesOnlyTheFilesOwnOriginal) {
  good(kSmall + Command{"--backup", "part.sl1"});
  Sl1Options other;
  other.seed = 1;
  for (const char* what :
       {"another part", "fewer slices", "another time", "no archive", "itself corrected"}) {
    fs::remove(folder_ / "part.sl1.orig");
    if (what == std::string("no archive")) {
      write("part.sl1.orig", "no archive");
    } else if (what == std::string("itself corrected")) {
      fs::copy_file(folder_ / "part.sl1", folder_ / "part.sl1.orig");
    } else {
      other.layers = what == std::string("fewer slices") ? 40 : 50;
      // The same slices, and all else but a line of settings.
      other.seed = what == std::string("another time") ? 0 : 1;
      other.stamp = other.seed == 0 ? "2025-05-01 at 12:00:00 UTC" : Sl1Options().stamp;
      make_sl1(folder_ / "part.sl1.orig", other);
    }
    SCOPED_TRACE(what);
    bad(2, {"--undo", "part.sl1"}, {"part.sl1.orig"});
    bad(2, kSmall + Command{"--again", "part.sl1"}, {"part.sl1.orig"});
  }
}

TEST_F(Post, WithoutAChecksumSlicesTellTheOriginal) {
  const Bytes original = bytes("part.sl1");
  good(kSmall + Command{"--backup", "part.sl1"});
  Entries entries = unzip(folder_ / "part.sl1");
  auto block = nlohmann::ordered_json::parse(to_text(entry(entries, "slicecorr.json")));
  EXPECT_EQ(block["original_sha256"], cli::sha256_of_contents(folder_ / "part.sl1.orig"));
  // As older versions wrote it.
  block.erase("original_sha256");
  block.erase("block_crc32");
  entry(entries, "slicecorr.json") = to_bytes(block.dump());
  make_zip(folder_ / "part.sl1", entries, true);
  fs::rename(folder_ / "part.sl1.orig", folder_ / "mine");
  Sl1Options other;
  other.seed = 1;
  make_sl1(folder_ / "part.sl1.orig", other);
  bad(2, {"--undo", "part.sl1"}, {"part.sl1.orig", "mm³"});
  fs::rename(folder_ / "mine", folder_ / "part.sl1.orig");
  good({"--undo", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1"), original);
}

TEST_F(Post, BackupGivesWayOnlyWhenAsked) {
  const Bytes original = bytes("part.sl1");
  write("part.sl1.orig", "something else");
  bad(2, kSmall + Command{"--backup", "part.sl1"},
      {"part.sl1.orig: is there already", "--backup=replace"});
  EXPECT_EQ(text("part.sl1.orig"), "something else");
  good(kSmall + Command{"--backup=replace", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1.orig"), original);
  // The same contents may be there: a killed run leaves that.
  good({"--undo", "part.sl1"});
  fs::copy_file(folder_ / "part.sl1", folder_ / "part.sl1.orig");
  good(kSmall + Command{"--backup", "part.sl1"});
  EXPECT_EQ(bytes("part.sl1.orig"), original);
}

TEST_F(Post, SymbolicLinksStay) {
  fs::create_directory(folder_ / "real");
  fs::rename(folder_ / "part.sl1", folder_ / "real/part.sl1");
  fs::create_symlink("real/part.sl1", folder_ / "part.sl1");
  const Bytes original = bytes("part.sl1");
  good(kSmall + Command{"--backup", "part.sl1"});
  EXPECT_TRUE(fs::is_symlink(folder_ / "part.sl1"));
  EXPECT_NE(bytes("real/part.sl1"), original);
  EXPECT_EQ(bytes("real/part.sl1.orig"), original);
}

TEST_F(Post, Reports) {
  good(kSmall + Command{"--report=both", "part.sl1"});
  EXPECT_THAT(text("part.sl1.html"), HasSubstr("<html"));
  const auto figures = nlohmann::json::parse(text("part.sl1.json"));
  EXPECT_EQ(figures["layers"], 50);
  EXPECT_LT(figures["height_error_um"]["mean_abs"],
            figures["uncorrected"]["height_error_um"]["mean_abs"]);
}

TEST_F(Post, WhatLiesBesideIsOfTheFileAsItIs) {
  good(kSmall + Command{"--backup", "--report=both", "part.sl1"});
  const std::string page = text("part.sl1.html"), figures = text("part.sl1.json");
  write("part.sl1.txt", "slicecorr-post: Slices corrected\npart.sl1\n");
  // Corrected anew: what is made anew is replaced, what is not goes.
  const RunResult again =
      good(kSmall + Command{"--again", "--exposure-s", "0.15", "--report=json", "part.sl1"});
  EXPECT_NE(text("part.sl1.json"), figures);
  EXPECT_FALSE(there("part.sl1.html"));
  EXPECT_FALSE(there("part.sl1.txt"));
  EXPECT_THAT(again.err, AllOf(HasSubstr("also written: " + (folder_ / "part.sl1.json")),
                               HasSubstr("taken away: " + (folder_ / "part.sl1.html")),
                               HasSubstr("taken away: " + (folder_ / "part.sl1.txt"))));
  EXPECT_THAT(good({"--undo", "part.sl1"}).err,
              HasSubstr("taken away: " + (folder_ / "part.sl1.json")));
  EXPECT_FALSE(there("part.sl1.json"));
  // What somebody else wrote stays, whatever it is called; so does what a refused run does not touch.
  for (const char* ending : {".html", ".json", ".txt"}) {
    write(std::string("part.sl1") + ending, "{\"mine\": \"<html>\"}");
  }
  good(kSmall + Command{"--backup", "part.sl1"});
  bad(2, kSmall + Command{"part.sl1"}, {"already corrected"});
  good({"--undo", "part.sl1"});
  for (const char* ending : {".html", ".json", ".txt"}) {
    EXPECT_EQ(text(std::string("part.sl1") + ending), "{\"mine\": \"<html>\"}");
  }
  // An export over the corrected file takes its old page along.
  write("part.sl1.html", page);
  good(kSmall + Command{"part.sl1"});
  EXPECT_FALSE(there("part.sl1.html"));
}

TEST_F(Post, WorkFoldersAreNamedToNobody) {
  const auto without = [](const std::string& text) { return post::WorkFolder::without(text); };
  const std::string work = work_folder_of_the_dead(), shorter = work.substr(0, work.size() - 1);
  EXPECT_EQ(without("/a/" + work + "/x.ctb: holds /a/" + work + "/y"), "/a/x.ctb: holds /a/y");
  EXPECT_EQ(without(work + "/x.ctb"), "x.ctb");
  for (const std::string& text :
       {std::string(), std::string("/a/x.ctb"), "/a/" + std::string(detail::kWorkFolder),
        "/a/" + shorter + "/x", "/a/" + work, "/a/my" + work + "/x"}) {
    EXPECT_EQ(without(text), text);
  }
}

TEST_F(Post, WrongUse) {
  bad(2, {}, {"expected a FILE"});
  bad(2, kSmall + Command{"none.sl1"}, {"none.sl1: is not a file"});
  bad(2, kSmall + Command{"."}, {"is a folder", "--watch"});
  bad(2, kSmall + Command{"part.sl1", "--watch", "."}, {"expected a FILE"});
  bad(2, {"--undo", "--again", "part.sl1"}, {"--undo stands alone"});
  bad(2, {"--undo", "--watch", "."}, {"are for one FILE"});
  bad(2, {"--printer", "small", "--resin", "nothing", "part.sl1"}, {"no resin 'nothing'"});
  bad(2, kSmall + Command{"--speed-mm-h", "-1", "part.sl1"}, {"--speed-mm-h", "above 0"});
  bad(2, kSmall + Command{"--speed-mm-h", "100", "--exposure-s", "1", "part.sl1"},
      {"part.sl1: ", "exposure times are for layer by layer"});
  bad(2, kSmall + Command{"--layer-um", "25", "part.sl1"}, {"50 um high", "25"});
  bad(2, kSmall + Command{"--backup=maybe", "part.sl1"}, {"--backup"});
  bad(2, kSmall + Command{"--config", "none.toml", "part.sl1"}, {"none.toml"});
}

TEST_F(Post, ArchivesThatDoNotFit) {
  Sl1Options o;
  o.width_px = 120;
  o.height_px = 160;
  make_sl1(folder_ / "part.sl1", o);
  bad(2, kSmall + Command{"part.sl1"}, {"part.sl1: its images have 120 x 160", "turned by 90"});
  o.height_px = 100;
  make_sl1(folder_ / "part.sl1", o);
  bad(2, kSmall + Command{"part.sl1"}, {"120 x 100", "printer 'small' has 160 x 120"});
  o = {};
  o.pixel_um = 47.25;
  make_sl1(folder_ / "part.sl1", o);
  bad(2, kSmall + Command{"part.sl1"}, {"pixels are 47.25 x 47.25", "'small' are 50 x 50"});
  o = {};
  o.exposure_s = o.first_s = 0;
  make_sl1(folder_ / "part.sl1", o);
  bad(2, kSmall + Command{"part.sl1"}, {"part.sl1: --exposure-s is required"});
  o.exposure_s = o.first_s = 0.05;
  make_sl1(folder_ / "part.sl1", o);
  bad(3, kSmall + Command{"part.sl1"}, {"part.sl1: ", "at least 0.094"});
  Bytes whole = bytes("part.sl1");
  whole.resize(whole.size() / 2);
  write_file(folder_ / "part.sl1", whole);
  bad(2, kSmall + Command{"part.sl1"}, {"part.sl1"});
  write("part.sl1", "");
  bad(2, kSmall + Command{"part.sl1"}, {"part.sl1"});
}

TEST_F(Post, FolderThatCanNotBeWritten) {
  const Bytes original = bytes("part.sl1");
  constexpr auto read = fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read;
  constexpr auto enter = fs::perms::owner_exec | fs::perms::group_exec | fs::perms::others_exec;
  fs::permissions(folder_.path(), read | enter);
  RunOptions options = options_;
  options.unprivileged = true;
  const RunResult r = post(kSmall + Command{"part.sl1"}, options);
  fs::permissions(folder_.path(), fs::perms::owner_all);
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_EQ(bytes("part.sl1"), original);
}

TEST_F(Post, FullDiskLeavesTheFileAsItWas) {
  const auto before = names();
  const Bytes original = bytes("part.sl1");
  RunOptions options = options_;
  options.largest_file = original.size() / 4;
  const RunResult r = post(kSmall + Command{"part.sl1"}, options);
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_EQ(bytes("part.sl1"), original);
  EXPECT_EQ(names(), before);
}

TEST_F(Post, InterruptedLeavesTheFileAsItWas) {
  const Bytes original = bytes("part.sl1");
  const auto before = names();
  RunOptions options = options_;
  options.signal = SIGTERM;
  options.signal_when = [](const std::string&, const std::string& err) {
    return err.find("read: done") != std::string::npos;
  };
  const RunResult r = post(kSmall + Command{"part.sl1"}, options);
  // The signal may come when all is done.
  if (r.exit_code == 0) GTEST_SKIP() << "it was faster than the signal";
  EXPECT_EQ(r.exit_code, 130) << r.err;
  EXPECT_EQ(bytes("part.sl1"), original);
  EXPECT_EQ(names(), before);
}

TEST_F(Post, AsASlicerCallsIt) {
  // The slicer hands over a copy; rules, backup and reports are for the name of the export.
  fs::create_directory(folder_ / "exports");
  fs::rename(folder_ / "part.sl1", folder_ / "temporary.pp");
  const Bytes original = bytes("temporary.pp");
  write("config/slicecorr/post.toml",
        "[[rule]]\nfolder = \"exports\"\nfile = \"part.sl1\"\nprinter = \"small\"\n"
        "resin = \"figure-2-2\"\nha_um = 110\nbackup = true\nreport = \"json\"\n");
  RunOptions options = options_;
  options.environment["SLIC3R_PP_HOST"] = "File";
  options.environment["SLIC3R_PP_OUTPUT_NAME"] = folder_ / "exports/part.sl1";
  const RunResult r = post({folder_ / "temporary.pp"}, options);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, Not(HasSubstr("read: done")));
  EXPECT_NE(bytes("temporary.pp"), original);
  EXPECT_EQ(bytes("exports/part.sl1.orig"), original);
  EXPECT_TRUE(there("exports/part.sl1.json"));
  // A failure is one line.
  const RunResult failed = post({folder_ / "temporary.pp"}, options);
  EXPECT_EQ(failed.exit_code, 2);
  EXPECT_EQ(std::count(failed.err.begin(), failed.err.end(), '\n'), 1) << failed.err;
  // Profiles from the environment serve where the archive has none.
  Sl1Options o;
  o.printer_profile = "";
  o.material = "";
  make_sl1(folder_ / "temporary.pp", o);
  options.environment["SLIC3R_PP_OUTPUT_NAME"] = folder_ / "exports/other.sl1";
  options.environment["SLIC3R_PRINTER_SETTINGS_ID"] = "Works Small One";
  options.environment["SLIC3R_SLA_MATERIAL_SETTINGS_ID"] = "Resin Figure 2 2";
  const RunResult shown =
      post({"--ha-um", "110", "--show-rule", folder_ / "temporary.pp"}, options);
  EXPECT_EQ(shown.exit_code, 0) << shown.err;
  EXPECT_THAT(shown.out,
              HasSubstr("printer   small, from the archive's profile 'Works Small One'"));
}

/// A setting of a rule that does not go with the command line: nobody typed it.
TEST_F(Post, MessagesSayWhatRulesSaid) {
  write("config/slicecorr/post.toml",
        "[default]\nbackup = true\nomega_max = 3\n\n"
        "[[rule]]\nname = \"lifts\"\nfile = \"*.sl1\"\nlift_exchange = 0.4\nha_um = 2000\n");
  const RunResult r = post(kSmall + Command{"--speed-mm-h", "800", "part.sl1"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("--lift-exchange is for layer by layer exposure"));
  EXPECT_THAT(r.err, HasSubstr("lift-exchange by rule 'lifts' ("));
  EXPECT_THAT(r.err, HasSubstr("omega-max by [default] of "));
  EXPECT_THAT(r.err, Not(HasSubstr("ha-um by"))) << "the command line said it";
}

TEST_F(Post, RulesChooseByFolderFileAndProfiles) {
  write("config/slicecorr/post.toml",
        "[default]\nprinter = \"small\"\nresin = \"figure-2-2\"\nomega_max = 3\nha_um = 110\n\n"
        "[[rule]]\nname = \"leave\"\nfile = \"draft*\"\nleave_alone = true\n\n"
        "[[rule]]\nname = \"fast\"\nmaterial_profile = \"*2-2\"\nfolder = \"~/fast\"\n"
        "speed_mm_h = 900\nha_um = 2000\n\n"
        "[[rule]]\nprinter_profile = \"works SMALL*\"\nexposure_s = 0.3\nomega-max = \"inf\"\n");
  const auto shown = [&](const std::string& file) { return good({"--show-rule", file}).out; };
  std::string out = shown("part.sl1");
  EXPECT_THAT(out, HasSubstr("rule 'rule 3'"));
  EXPECT_THAT(out, HasSubstr("line 19"));
  EXPECT_THAT(out, HasSubstr("layer by layer, 0.3 s each, from rule 'rule 3'"));
  EXPECT_THAT(out, HasSubstr("note      the archive's first exposure of 0.2 s is not longer"));
  EXPECT_THAT(out, HasSubstr("printer   small, from [default] of"));
  fs::create_directories(folder_ / "fast/deeper");
  fs::copy_file(folder_ / "part.sl1", folder_ / "fast/deeper/part.sl1");
  out = shown("fast/deeper/part.sl1");
  EXPECT_THAT(out, HasSubstr("rule 'fast'"));
  EXPECT_THAT(out, HasSubstr("continuous, 900 mm/h"));
  // The command line goes over a rule; a speed puts aside its times.
  EXPECT_THAT(good({"--speed-mm-h", "800", "--ha-um", "2000", "--show-rule", "part.sl1"}).out,
              HasSubstr("800 mm/h, from the command line"));
  Sl1Options other;
  other.printer_profile = "Unknown";
  make_sl1(folder_ / "draft 1.sl1", other);
  EXPECT_THAT(shown("draft 1.sl1"), HasSubstr("is left alone"));
  const Bytes before = bytes("draft 1.sl1");
  EXPECT_THAT(good({"draft 1.sl1"}).err, HasSubstr("left alone, as rule 'leave'"));
  EXPECT_EQ(bytes("draft 1.sl1"), before);
  // Showing changes nothing.
  EXPECT_EQ(names("fast/deeper"), std::vector<std::string>{"part.sl1"});
}

TEST_F(Post, ProfilesOfTheArchiveNameDefinitions) {
  const std::string out = good({"--ha-um", "110", "--show-rule", "part.sl1"}).out;
  EXPECT_THAT(out, HasSubstr("printer   small, from the archive's profile 'Works Small One'"));
  EXPECT_THAT(out, HasSubstr("resin     figure-2-2, 110 um base 10, from the archive's profile"));
  Sl1Options o;
  o.material = "Unheard-of";
  make_sl1(folder_ / "part.sl1", o);
  bad(2, {"part.sl1"},
      {"part.sl1: no resin is given", "'Unheard-of'", "material_profile = \"Unheard-of\""});
}

TEST_F(Post, ConfigIsCheckedWhole) {
  struct Wrong {
    std::string config;
    std::vector<std::string> words;
  };
  const std::vector<Wrong> cases = {
      {"[default]\nprinterr = \"small\"\n", {"line 2: printerr", "did you mean 'printer'?"}},
      {"[defaults]\n", {"line 1: defaults", "did you mean 'default'?"}},
      {"[[rule]]\nfile = \"*\"\nspeed_mmh = 3\n", {"line 3: speed_mmh", "'speed_mm_h'"}},
      {"[[rule]]\nfile = \"*\"\nspeed_mm_h = -3\n", {"line 3: speed_mm_h", "above 0"}},
      {"[[rule]]\nfile = \"*\"\nspeed_mm_h = \"fast\"\n", {"line 3: speed_mm_h", "fast"}},
      {"[[rule]]\nfile = \"*\"\nmode = \"layered\"\n", {"line 3: mode", "layered"}},
      {"[[rule]]\nresin = \"figure-2-2\"\n", {"line 1: rule", "matches every file"}},
      {"[[rule]]\nfile = \"a/b\"\n", {"line 2: file", "'folder'"}},
      {"[[rule]]\nfolder = \"a/b\"\n", {"line 2: folder", "from / or ~"}},
      {"[[rule]]\nfile = 3\n", {"line 2: file", "text in quotes"}},
      {"[rule]\nfile = \"*\"\n", {"line 1: rule", "[[rule]]"}},
      {"[default]\nprinter = \"smal\"\n", {"line 2: printer", "no printer 'smal'"}},
      {"[default]\nbackup = \"sometimes\"\n", {"line 2: backup"}},
      {"[default]\nomega_max = 2\nomega-max = 3\n", {"given twice"}},
      {"[default]\nprinter = [1]\n", {"line 2: printer", "expected a number, a text"}},
      {"[default]\nprinter = \"small\"\nresin = \"figure-2-2\"\n\n[[rule]]\nfile = \"*\"\n"
       "uv_mw_cm2 = 3\n",
       {"line 5", "--uv-mw-cm2"}},
      {"[default\n", {"line 1", "is not TOML"}},
  };
  for (const Wrong& wrong : cases) {
    SCOPED_TRACE(wrong.config);
    write("config/slicecorr/post.toml", wrong.config);
    auto words = wrong.words;
    words.push_back("post.toml");
    bad(2, kSmall + Command{"part.sl1"}, words);
  }
}

TEST(PostProfiles, WordsOfTheProfileFindTheDefinition) {
  ::setenv("SLICECORR_DB", SLICECORR_PRINTERS_DIR, 1);
  using post::definition_of_profile;
  EXPECT_EQ(definition_of_profile("Original Prusa SL1S SPEED", "printer"), "prusa-sl1s");
  EXPECT_EQ(definition_of_profile("My Autodesk Ember, left", "printer"), "ember");
  EXPECT_EQ(definition_of_profile("Original Prusa SL1", "printer"), "");
  EXPECT_EQ(definition_of_profile("", "printer"), "");
  // Words that make it another model: its light would be another's.
  EXPECT_EQ(definition_of_profile("ELEGOO Mars 4 Max", "printer"), "elegoo-mars-4-max");
  EXPECT_EQ(definition_of_profile("Elegoo Mars 0.05 mm", "printer"), "elegoo-mars");
  EXPECT_EQ(definition_of_profile("Anycubic Photon Mono X", "printer"), "anycubic-photon-mono-x");
  for (const char* other : {"Elegoo Mars 5", "Elegoo Mars Pro", "Elegoo Saturn 2", "Photon M3 Max",
                            "Anycubic Photon Mono X2"}) {
    EXPECT_EQ(definition_of_profile(other, "printer"), "") << other;
  }
  // For each wavelength there is one; without a wavelength it is not known which.
  EXPECT_EQ(definition_of_profile("Liqcreate Strong-X @0.05", "resin", 405),
            "liqcreate-strong-x-405nm");
  EXPECT_EQ(definition_of_profile("Liqcreate Strong-X @0.05", "resin", 385),
            "liqcreate-strong-x-385nm");
  EXPECT_EQ(definition_of_profile("Liqcreate Strong-X @0.05", "resin"), "");
  EXPECT_EQ(definition_of_profile("Formlabs Standard Clear V4", "resin", 405),
            "formlabs-standard-clear");
  // Whoever measured a printer means the file with the light.
  const TemporaryFolder mine;
  const std::string text = "name = \"bright\"\nmaker = \"Elegoo\"\nproduct = \"Mars 4 Max\"\n";
  write_file(mine / "bright.toml",
             to_bytes(text + "[display]\n[blue]\ncalibration = [[0, 1], [255, 3]]\n"));
  ::setenv("SLICECORR_DB", mine.path().c_str(), 1);
  EXPECT_EQ(definition_of_profile("ELEGOO Mars 4 Max", "printer"), "bright");
  ::unsetenv("SLICECORR_DB");
}

TEST(PostFiles, OneRunAtATimeHasAFile) {
  const TemporaryFolder folder;
  write_file(folder / "a", {1});
  auto first = post::Lock::try_take(folder / "a");
  ASSERT_TRUE(first);
  EXPECT_FALSE(post::Lock::try_take(folder / "a"));
  first.reset();
  EXPECT_TRUE(post::Lock::try_take(folder / "a"));
  EXPECT_FALSE(post::Lock::try_take(folder / "none"));
}

TEST(PostFiles, WorkFoldersOfTheDeadGoThoseOfTheLivingStay) {
  const TemporaryFolder folder;
  const std::string dead = work_folder_of_the_dead();
  fs::create_directory(folder / dead);
  write_file(folder / (dead + "/part.sl1"), {1});
  write_file(folder / (dead + "/in-work"), to_bytes(std::string("part.sl1\0", 9)));
  fs::create_directory(folder / "mine");
  std::string link = dead;
  link.back() = 'Y';
  fs::create_symlink("mine", folder / link);
  const post::WorkFolder alive(folder.path());
  EXPECT_EQ(post::WorkFolder::remove_stale(folder.path()), std::vector<std::string>{"part.sl1"});
  EXPECT_FALSE(fs::exists(folder / dead));
  EXPECT_TRUE(fs::exists(alive.path()));
  EXPECT_TRUE(fs::exists(folder / "mine"));
}

TEST_F(Post, KilledAtAnyMomentItIsTheOldOrTheNewFile) {
  // Large enough for reading, correcting and writing to take their time.
  Sl1Options o;
  o.layers = 200;
  make_sl1(folder_ / "part.sl1", o);
  const Bytes old_file = bytes("part.sl1");
  const Command command = Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kSmall +
                          Command{"--backup", "--threads", "1", "part.sl1"};
  const auto start = std::chrono::steady_clock::now();
  ASSERT_EQ(run_program(command, options_).exit_code, 0);
  auto whole = std::chrono::duration_cast<std::chrono::microseconds>(
      std::chrono::steady_clock::now() - start);
  const Bytes new_file = bytes("part.sl1");
  ASSERT_NE(old_file, new_file);

  std::mt19937 random(1);
  int killed = 0;
  const int kills = by_night() ? rounds(12) : 6;
  for (int i = 0; i < kills; ++i) {
    write_file(folder_ / "part.sl1", old_file);
    fs::remove(folder_ / "part.sl1.orig");
    // Half of the moments in the last third, where files change their places.
    const double from = i % 2 == 0 ? 0.0 : 0.66;
    const double at = from + (1.02 - from) * static_cast<double>(random()) / 4294967296.0;
    const bool hit = killed_after(command, options_,
                                  std::chrono::microseconds(static_cast<long>(at * whole.count())));
    killed += hit;
    // On a busy machine the first run took longer than the others do.
    if (!hit) whole -= whole / 10;
    const Bytes left = bytes("part.sl1");
    ASSERT_TRUE(left == old_file || left == new_file) << "kill " << i << " at " << at;
    if (there("part.sl1.orig")) {
      ASSERT_EQ(bytes("part.sl1.orig"), old_file);
    }
    // The next run does it, or says that it is done; nothing of the killed one stays.
    const RunResult next = run_program(command, options_);
    ASSERT_EQ(next.exit_code, left == old_file ? 0 : 2) << next.err;
    ASSERT_EQ(bytes("part.sl1"), new_file);
    ASSERT_EQ(names().size(), 5U) << ::testing::PrintToString(names());
  }
  EXPECT_GE(killed, kills / 5) << "of those that should have been killed while they ran";
}

TEST_F(Post, TwoRunsOnOneFileDoItOnce) {
  Sl1Options o;
  o.layers = 400;
  make_sl1(folder_ / "part.sl1", o);
  RunResult a, b;
  std::thread other([&] { a = post(kSmall + Command{"part.sl1"}); });
  b = post(kSmall + Command{"part.sl1"});
  other.join();
  EXPECT_EQ(std::min(a.exit_code, b.exit_code), 0) << a.err << b.err;
  EXPECT_EQ(std::max(a.exit_code, b.exit_code), 2) << a.err << b.err;
  EXPECT_THAT(a.err + b.err, ::testing::AnyOf(HasSubstr("by another slicecorr-post"),
                                              HasSubstr("already corrected")));
}

}  // namespace
}  // namespace slicecorr::test
