// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// slicecorr-post on every archive format, and on files that change under its hands.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "post_fixture.hpp"
#include "rounds.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class PostFormats : public PostFolder {
 protected:
  PostFormats() { make_sl1(folder_ / "part.sl1"); }
};

/// Formats that are not corrected in place, with the reason. All others must be.
const std::map<std::string, std::string> kNotInPlace = {
    {"folder", "no file that a rename could replace; slicecorr correct writes folders"},
    {"photon", "not made from nothing, as this test does; in print_files_test"},
    {"photon-workshop", "the same"},
    {"phz", "the same"},
    {"fdg", "the same"},
    {"cxdlp", "the same"},
    {"lgs", "the same"},
    {"anycubic-zip", "the same; in newer_print_files_test"},
};

/// By day every format is corrected, and one of three further runs is tried on it in turn; by night
/// all three on each.
TEST_F(PostFormats, EachInPlaceAndBack) {
  // An Ember has one display.
  std::string wide = kPostPrinter;
  wide.replace(wide.find("160"), 3, "1280");
  wide.replace(wide.find("120"), 3, "800");
  write("wide.toml", wide);
  Sl1Options wide_part;
  wide_part.width_px = 1280;
  wide_part.height_px = 800;
  wide_part.layers = 15;
  make_sl1(folder_ / "wide.sl1", wide_part);
  std::set<std::string> known;
  int further = 0;
  for (const FormatInfo& format : archive_formats()) {
    known.insert(format.name);
    if (kNotInPlace.contains(format.name)) continue;
    SCOPED_TRACE(format.name);
    ASSERT_FALSE(format.endings.empty());
    const std::string base = format.name.starts_with("ember") ? "wide" : "small";
    const std::string part = base == "wide" ? "wide.sl1" : "part.sl1";
    Command setup = kSmall;
    std::replace(setup.begin(), setup.end(), std::string("small.toml"), base + ".toml");
    const std::string name = "export-" + format.name + format.endings.front();
    const RunResult converted =
        run_program({SLICECORR_BIN_DIR "/slicecorr", "convert", part, "-o", name, "--format",
                     format.name, "--printer", base + ".toml"},
                    options_);
    ASSERT_EQ(converted.exit_code, 0) << converted.err;
    const Bytes before = bytes(name);
    const RunResult told = good(setup + Command{"--exposure-s", "0.1", "--backup", name});
    EXPECT_THAT(told.err, Not(HasSubstr(".slicecorr-post-")))
        << "where it is made tells nobody anything";
    EXPECT_EQ(bytes(name + ".orig"), before);
    const StackInfo info = StackReader::read_info(folder_ / name);
    EXPECT_EQ(info.kind, StackKind::corrected);
    EXPECT_EQ(info.format, format.name);
    EXPECT_EQ(info.grid.layers, base == "wide" ? wide_part.layers : Sl1Options().layers);
    const int chosen = further++ % 3;
    if (by_night() || chosen == 0) {
      EXPECT_EQ(post(setup + Command{name}).exit_code, 2) << "a second time";
    }
    if (by_night() || chosen == 1) {
      const Bytes first = bytes(name);
      good(setup + Command{"--exposure-s", "0.1", "--again", name});
      EXPECT_EQ(bytes(name), first);
    }
    if (by_night() || chosen == 2) {
      good({"--undo", name});
      EXPECT_EQ(bytes(name), before);
    }
  }
  for (const auto& [name, reason] : kNotInPlace) {
    EXPECT_TRUE(known.contains(name)) << name << ", said to be " << reason << ", is no format";
  }
}

TEST_F(PostFormats, FolderIsNotAFile) {
  fs::create_directory(folder_ / "stack");
  const RunResult r = post(kSmall + Command{"stack"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("stack: is a folder; expected an archive"));
}

TEST_F(PostFormats, AnExportThatComesMeanwhileIsNotLost) {
  Sl1Options o;
  o.layers = 600;
  make_sl1(folder_ / "part.sl1", o);
  o.seed = 1;
  make_sl1(folder_ / "next.sl1", o);
  const Bytes next = bytes("next.sl1");
  RunOptions options = options_;
  bool exported = false;
  options.signal = SIGURG;  // never sent: the look at what it says is the moment
  options.signal_when = [&](const std::string&, const std::string& err) {
    if (!exported && err.find("read: done") != std::string::npos) {
      fs::rename(folder_ / "next.sl1", folder_ / "part.sl1");
      exported = true;
    }
    return false;
  };
  const RunResult r = post(kSmall + Command{"--threads", "1", "--backup", "part.sl1"}, options);
  ASSERT_TRUE(exported);
  if (r.exit_code == 0) GTEST_SKIP() << "it was faster than the export";
  EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_THAT(r.err, HasSubstr("part.sl1: was changed while it was being corrected"));
  EXPECT_EQ(bytes("part.sl1"), next);
  EXPECT_FALSE(there("part.sl1.orig"));
  EXPECT_EQ(names().size(), 4U) << ::testing::PrintToString(names());
}

}  // namespace
}  // namespace slicecorr::test
