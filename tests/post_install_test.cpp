// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A watch that systemd runs: unit and rule are set up and taken away again; outcomes are told beside the file
/// and on the desktop, where there is one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "post_fixture.hpp"
#include "refusal.hpp"
#include "watch/install.hpp"

namespace slicecorr::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
namespace fs = std::filesystem;

TEST(WatchUnit, HasTheNameThatSystemdGivesToAPath) {
  using post::watch_unit_name;
  EXPECT_EQ(watch_unit_name("/home/me/slices"), "slicecorr-watch-home-me-slices.service");
  EXPECT_EQ(watch_unit_name("/"), "slicecorr-watch--.service");
  EXPECT_EQ(watch_unit_name("/a-b/.c d"), "slicecorr-watch-a\\x2db-.c\\x20d.service");
  if (!fs::exists("/usr/bin/systemd-escape")) GTEST_SKIP() << "systemd-escape is not installed";
  for (const std::string folder :
       {"/home/me/slices", "/", "/.hidden", "/a-b/.c d", "/m\xc3\xbc/%h", "/x:y_z/1.2", "/a\\b"}) {
    const RunResult r = run_program({"/usr/bin/systemd-escape", "--path", folder}, {});
    EXPECT_EQ("slicecorr-watch-" + r.out.substr(0, r.out.size() - 1) + ".service",
              watch_unit_name(folder));
  }
}

TEST(WatchUnit, QuotesWhatSystemdWouldTakeApart) {
  const std::string text =
      post::watch_unit_text("/a b/%h $X \"q\"\\", "/usr/bin/slicecorr-post", {"--jobs", "2"});
  EXPECT_THAT(text, HasSubstr("ExecStart=\"/usr/bin/slicecorr-post\" \"--jobs\" \"2\" --watch \"/a "
                              "b/%%h $$X \\\"q\\\"\\\\\"\n"));
  EXPECT_THAT(text, HasSubstr("exported to /a b/%%h $X"));
}

TEST(WatchRule, IsPutInAndTakenOutAndAllElseStays) {
  const std::string own = "# mine\n[default]\nomega_max = 4\n\n[[rule]]\nfile = \"d*\"";
  const std::string with = post::with_watch_rule(own, "/in", "[[rule]]\nfolder = \"/in\"\n");
  EXPECT_TRUE(with.starts_with(own + "\n# slicecorr-post --install-watch /in\n[[rule]]\n"));
  EXPECT_EQ(post::with_watch_rule(with, "/in", ""), own + "\n");
  EXPECT_EQ(post::with_watch_rule("", "/in", ""), "");
  EXPECT_EQ(post::with_watch_rule(own, "/in", ""), own);
  // Another folder's stays, and one is replaced where it stands.
  const std::string both =
      post::with_watch_rule(with, "/in/more", "[[rule]]\nfolder = \"/in/more\"\n");
  EXPECT_EQ(post::with_watch_rule(both, "/in/more", ""), with);
  const std::string other = post::with_watch_rule(both, "/in", "[[rule]]\nfolder = \"/new\"\n");
  EXPECT_LT(other.find("\"/new\""), other.find("\"/in/more\""));
  EXPECT_EQ(other.find("folder = \"/in\""), other.npos);
  // Half of it is nobody's to guess.
  EXPECT_THAT(
      refusal([&] { post::with_watch_rule("# slicecorr-post --install-watch /in\n", "/in", ""); }),
      HasSubstr("not that of its end"));
}

class InstallWatch : public PostFolder {
 protected:
  InstallWatch() {
    fs::create_directories(folder_ / "bin");
    fs::create_directories(folder_ / "in $HOME %h");
    write("bin/systemctl", "#!/bin/sh\necho \"$*\" >> \"" + (folder_ / "told") + "\"\n");
    fs::permissions(folder_ / "bin/systemctl", fs::perms::owner_all);
    options_.environment["PATH"] = (folder_ / "bin") + ":/usr/bin:/bin";
  }
  std::string text_of(const std::string& name) const {
    const Bytes bytes = read_file(folder_ / name);
    return {bytes.begin(), bytes.end()};
  }
  bool there(const std::string& name) const {
    return fs::exists(fs::symlink_status(folder_ / name));
  }
  std::string unit() const {
    return "config/systemd/user/" + post::watch_unit_name(folder_ / "in $HOME %h");
  }
  std::string link() const {
    return "config/systemd/user/default.target.wants/" +
           post::watch_unit_name(folder_ / "in $HOME %h");
  }
  const std::string in_ = "in $HOME %h", rules_ = "config/slicecorr/post.toml";
};

TEST_F(InstallWatch, SetsUnitAndRuleUpAndTakesThemAway) {
  const std::string own = "# mine\n[default]\nomega_max = 4\n";
  write(rules_, own);
  good(kSmall + Command{"--install-watch", in_, "--jobs", "2", "--recursive", "--log", "a.log"});
  const std::string rules = text_of(rules_);
  EXPECT_TRUE(rules.starts_with(own));
  EXPECT_THAT(rules, AllOf(HasSubstr("folder = \"" + (folder_ / in_) + "\"\n"),
                           HasSubstr("printer = \"" + (folder_ / "small.toml") + "\""),
                           HasSubstr("backup = \"replace\""), HasSubstr("ha_um = \"110\"")));
  EXPECT_THAT(text_of(unit()), AllOf(HasSubstr("\"--notify\" \"--text-beside\" \"--config\""),
                                     HasSubstr("\"--recursive\" \"--jobs\" \"2\" \"--log\" \"" +
                                               (folder_ / "a.log")),
                                     HasSubstr("--watch \"" + (folder_ / "in $$HOME %%h") + "\"")));
  EXPECT_EQ(fs::canonical(folder_ / link()), fs::canonical(folder_ / unit()));
  const std::string name = fs::path(unit()).filename().string();
  EXPECT_EQ(text_of("told"),
            "--user --no-ask-password daemon-reload\n--user --no-ask-password "
            "restart " +
                name + "\n");
  if (fs::exists("/usr/bin/systemd-analyze")) {
    RunOptions options = options_;
    options.environment["XDG_RUNTIME_DIR"] = folder_.path();
    const RunResult r = run_program(
        {"/usr/bin/systemd-analyze", "--user", "--man=no", "verify", folder_ / unit()}, options);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err, Not(HasSubstr(name))) << r.err;
  }
  // What the rule says of a file there; elsewhere it says nothing.
  make_sl1(folder_ / in_ + "/part.sl1");
  EXPECT_THAT(good({"--show-rule", folder_ / in_ + "/part.sl1"}).out,
              HasSubstr("watch of " + (folder_ / in_)));
  // Again, with other settings: in the place of the first.
  good(Command{"--printer", "small.toml", "--install-watch", in_});
  EXPECT_THAT(text_of(rules_), Not(HasSubstr("ha_um")));
  good({"--uninstall-watch", in_});
  EXPECT_EQ(text_of(rules_), own);
  EXPECT_FALSE(there(unit()));
  EXPECT_FALSE(there(link()));
  EXPECT_THAT(text_of("told"), HasSubstr("stop " + name + "\n"));
  const RunResult twice = post({"--uninstall-watch", in_});
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_THAT(twice.err, HasSubstr("no watch was set up for it"));
}

TEST_F(InstallWatch, WithoutAManagerAllIsWrittenAndThatIsTold) {
  write("bin/systemctl",
        "#!/bin/sh\necho 'Failed to connect to bus: No medium found' >&2\nexit 1\n");
  const RunResult r = post({"--install-watch", in_});
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_THAT(r.err, AllOf(HasSubstr("is watched by the unit"), HasSubstr("No medium found"),
                           HasSubstr("signs in again")));
  EXPECT_TRUE(there(unit()));
  EXPECT_TRUE(there(link()));
  options_.environment["PATH"] = folder_.path();
  const RunResult away = post({"--uninstall-watch", in_});
  EXPECT_EQ(away.exit_code, 4);
  EXPECT_THAT(away.err, HasSubstr("systemctl"));
  EXPECT_FALSE(there(unit()));
  EXPECT_FALSE(there(link()));
}

TEST_F(InstallWatch, WhatIsWrongIsRefusedBeforeAnythingIsWritten) {
  const auto bad = [&](const Command& arguments, const std::string& words) {
    const RunResult r = post(arguments);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_THAT(r.err, HasSubstr(words));
    EXPECT_FALSE(there(unit()));
    EXPECT_FALSE(there("told"));
  };
  bad({"--install-watch", "nowhere"}, "is not a folder");
  bad({"--install-watch", in_, "--printer", "no-such-printer"}, "no-such-printer");
  bad({"--install-watch", in_, "--once"}, "--install-watch stands without");
  bad({"--install-watch", in_, "--uninstall-watch", in_}, "stands without");
  bad({"--install-watch", in_, "part.sl1"}, "stands without");
  write(rules_, "omega = 4\n");
  bad({"--install-watch", in_}, "post.toml");
  EXPECT_EQ(text_of(rules_), "omega = 4\n");
  // An earlier rule for the folder is told.
  write(rules_, "[[rule]]\nname = \"all\"\nfile = \"*\"\nomega_max = 3\n");
  EXPECT_THAT(good({"--install-watch", in_}).err, HasSubstr("all, line 1, comes before it"));
}

TEST_F(InstallWatch, OutcomesAreToldBesideTheFile) {
  fs::create_directory(folder_ / "in");
  make_sl1(folder_ / "in/part.sl1");
  write("in/bad.sl1", "nothing");
  make_sl1(folder_ / "in/theirs.sl1");
  write("in/theirs.sl1.txt", "a note of somebody else");
  const Command watch = kSmall + Command{"--watch", "in",         "--once", "--patience-s",
                                         "0",       "--settle-s", "0.05",   "--text-beside"};
  const RunResult r = post(watch);
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(
      text_of("in/part.sl1.txt"),
      AllOf(
          HasSubstr("slicecorr-post: Slices corrected, but will not print as designed\npart.sl1\n\n"
                    "Does not print as designed: "),
          HasSubstr("\n50 slices, "), HasSubstr("\nmean height error ")));
  EXPECT_THAT(
      text_of("in/bad.sl1.txt"),
      AllOf(HasSubstr("slicecorr-post: Slices not corrected\nbad.sl1\n\n"), HasSubstr("archive")));
  EXPECT_EQ(text_of("in/theirs.sl1.txt"), "a note of somebody else");
  EXPECT_THAT(r.err, HasSubstr("theirs.sl1.txt is a file of somebody else"));
  // The text goes with the file's next outcome.
  make_sl1(folder_ / "in/bad.sl1");
  EXPECT_EQ(post(watch).exit_code, 0);
  EXPECT_THAT(text_of("in/bad.sl1.txt"), HasSubstr("Slices corrected"));
}

/// Who reads the first line alone knows what the print comes to, and it says what the same file alone says.
TEST_F(InstallWatch, TheVerdictComesFirst) {
  const std::string fails = "slicecorr-post: Slices corrected, but will not print as designed\n",
                    designed = "slicecorr-post: Slices corrected\n";
  std::set<std::string> titles;
  Command fast = kSmall + Command{"--speed-mm-h", "800"};
  fast[5] = "2000";
  for (const Command& how : {kSmall, fast}) {
    fs::create_directory(folder_ / "in");
    make_sl1(folder_ / "in/part.sl1");
    make_sl1(folder_ / "alone.sl1");
    const std::string alone = good(how + Command{"alone.sl1"}).err;
    const bool good_print = alone.find("\nPrints as designed. ") != alone.npos;
    const std::size_t at =
        alone.find(good_print ? "Prints as designed. " : "Does not print as designed: ");
    ASSERT_NE(at, std::string::npos) << alone;
    const std::string verdict = alone.substr(at, alone.find('\n', at) - at);
    const std::string path = folder_ / "in/part.sl1";
    const Command watch = how + Command{"--watch", "in", "--once", "--settle-s", "0.05"};
    EXPECT_EQ(good(watch + Command{"--text-beside", "--log", "w.log"}).err, "");
    const std::string text = text_of("in/part.sl1.txt");
    const std::string& title = good_print ? designed : fails;
    titles.insert(title);
    EXPECT_THAT(text, StartsWith(title + "part.sl1\n\n" + verdict + "\n"));
    EXPECT_THAT(text_of("w.log"), HasSubstr(" corrected " + path + ": " + verdict + " "));
    // Sentences stay whole, whatever marks they have.
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) EXPECT_FALSE(line.starts_with(' ')) << line;
    make_sl1(path);
    good(watch + Command{"--log", "w.json", "--log-json"});
    const auto json =
        nlohmann::json::parse(text_of("w.json").substr(text_of("w.json").rfind("{\"time")));
    EXPECT_THAT(json["message"].get<std::string>(), StartsWith(verdict + " "));
    EXPECT_EQ(json["verdict"], good_print ? "as-designed" : "fails");
    fs::remove_all(folder_ / "in");
    fs::remove(folder_ / "w.log");
    fs::remove(folder_ / "w.json");
  }
  EXPECT_TRUE(titles.contains(fails));
}

/// Through notify-send, to a service on a bus of the test's own.
TEST_F(InstallWatch, OutcomesAreToldOnTheDesktop) {
  for (const char* program : {"/usr/bin/dbus-run-session", "/usr/bin/notify-send"}) {
    if (!fs::exists(program)) GTEST_SKIP() << program << " is not installed";
  }
  if (run_program({"/usr/bin/python3", "-c", "import dbus, gi"}, {}).exit_code != 0) {
    GTEST_SKIP() << "python3-dbus and python3-gi are not installed";
  }
  fs::create_directory(folder_ / "in");
  make_sl1(folder_ / "in/part.sl1");
  write("in/bad.sl1", "nothing");
  const std::string heard = folder_ / "heard", wait = "i=0; while [ $i -lt 300 ] && ! ";
  write("run", "#!/bin/sh\n/usr/bin/python3 " SLICECORR_SOURCE_DIR "/tests/fake_notifications.py " +
                   heard + " &\n" + wait + "[ -e " + heard +
                   " ]; do sleep 0.1; i=$((i+1)); done\n\"$@\"\ncode=$?\n" + wait +
                   "[ \"$(wc -l < " + heard +
                   ")\" = 2 ]; do sleep 0.1; i=$((i+1)); done\nkill %1 2>/dev/null\nexit $code\n");
  fs::permissions(folder_ / "run", fs::perms::owner_all);
  const RunResult r = run_program(
      Command{"/usr/bin/dbus-run-session", "--", folder_ / "run",
              SLICECORR_BIN_DIR "/slicecorr-post"} +
          kSmall +
          Command{"--watch", "in", "--once", "--patience-s", "0", "--settle-s", "0.05", "--notify"},
      options_);
  EXPECT_EQ(r.exit_code, 2) << r.err;
  std::map<std::string, std::string> told;
  std::istringstream lines(text_of("heard"));
  for (std::string line; std::getline(lines, line);) {
    const auto json = nlohmann::json::parse(line);
    EXPECT_EQ(json["program"], "slicecorr");
    told[json["title"]] = json["text"];
  }
  ASSERT_EQ(told.size(), 2u) << r.err;
  EXPECT_THAT(told["Slices corrected, but will not print as designed"],
              HasSubstr("part.sl1\nDoes not print as designed: "));
  EXPECT_THAT(told["Slices not corrected"], AllOf(HasSubstr("bad.sl1"), HasSubstr("archive")));
}

/// Without a desktop that is a line of the log, and the text beside the file is there all the same.
TEST_F(InstallWatch, WithoutADesktopThatIsTold) {
  fs::create_directory(folder_ / "in");
  make_sl1(folder_ / "in/part.sl1");
  make_sl1(folder_ / "in/second.sl1");
  write("bin/notify-send", "#!/bin/sh\nexit 1\n");
  fs::permissions(folder_ / "bin/notify-send", fs::perms::owner_all);
  const RunResult r = post(kSmall + Command{"--watch", "in", "--once", "--settle-s", "0.05",
                                            "--notify", "--text-beside"});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("not-told " + (folder_ / "in/part.sl1") + ": notify-send failed"));
  EXPECT_TRUE(there("in/part.sl1.txt"));
  EXPECT_TRUE(there("in/second.sl1.txt"));
}

}  // namespace
}  // namespace slicecorr::test
