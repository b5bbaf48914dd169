// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What programs say reaches those who can be told, and harms nothing where nobody can be: stderr
/// closed or full, names that would move a terminal's cursor.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "post_fixture.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

class Streams : public PostFolder {
 protected:
  Streams() { write_stl(folder_ / "ladder.stl", ladder()); }
  /// A command of the shell in the folder; `slicecorr` and the others are found.
  RunResult shell(const std::string& command) const {
    return run_program({"/bin/sh", "-c", "PATH=" SLICECORR_BIN_DIR ":$PATH; " + command}, options_);
  }
};

/// By day each of the ways to say nothing meets some of the programs and files that are refused, and
/// each of these some way; by night all meet all.
TEST_F(Streams, AStderrThatCantBeWrittenChangesNothing) {
  const std::string slice = "slicecorr slice ladder.stl -o {} --layer-um 50 --printer small.toml";
  ASSERT_EQ(shell(fmt::format(fmt::runtime(slice), "told.uvj")).exit_code, 0);
  ASSERT_EQ(shell("slicecorr correct told.uvj -o told-part.uvj --printer small.toml --resin "
                  "figure-2-2 --speed-mm-h 800")
                .exit_code,
            0);
  int count = 0;
  for (const char* nobody : {"2>&-", "2>/dev/full", "2>&- >&- <&-", "2>/dev/null"}) {
    SCOPED_TRACE(nobody);
    const std::string name = fmt::format("n{}", ++count);
    RunResult r = shell(fmt::format(fmt::runtime(slice), name + ".uvj") + " " + nobody);
    EXPECT_EQ(r.exit_code, 0);
    EXPECT_EQ(bytes(name + ".uvj"), bytes("told.uvj")) << "nothing said is in the archive";
    r =
        shell(fmt::format("slicecorr correct {0}.uvj -o {0}-part.uvj --printer small.toml --resin "
                          "figure-2-2 --speed-mm-h 800 {1}",
                          name, nobody));
    EXPECT_EQ(r.exit_code, 0);
    EXPECT_EQ(bytes(name + "-part.uvj"), bytes("told-part.uvj"));
    // Errors keep their codes, of usage and of input, whatever the program.
    const std::vector<std::string> wrong{"slicecorr --no-such-option",
                                         "slicecorr-post --no-such-option",
                                         "resinctl --no-such-option",
                                         "slicefarm --no-such-option",
                                         "printbridge --no-such-option",
                                         "printer-sim --no-such-option",
                                         "slicecorr info missing.uvj",
                                         "slicecorr-post missing.uvj",
                                         "printbridge print missing.uvj --printer small.toml"};
    for (std::size_t i = 0; i < wrong.size(); ++i) {
      if (!by_night() && i % 4 != static_cast<std::size_t>(count % 4)) continue;
      EXPECT_EQ(shell(wrong[i] + " " + nobody).exit_code, 2) << wrong[i];
    }
  }
#ifndef __SANITIZE_THREAD__  // whose runtime writes a file of its own before main
  // Limits on files' sizes: the archive can't be written, and that is said with its own code.
  const RunResult r = shell(
      "ulimit -f 0; slicecorr slice ladder.stl -o big.uvj --layer-um 50 --printer small.toml "
      "2>err.txt");
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_FALSE(there("big.uvj"));
#endif
  // A stdout that is closed is told as before.
  EXPECT_EQ(shell("slicecorr info told.uvj >&-").exit_code, 4);
  EXPECT_EQ(shell("slicecorr info told.uvj >/dev/full").exit_code, 4);
  EXPECT_EQ(shell("slicecorr --help >/dev/full").exit_code, 4);
}

/// Escape sequences, a bell, line ends and bytes that are no UTF-8.
const std::string kHostile =
    "a\x1b[2Jb\ac\nd\xff\xc2\x9b"
    "e\r";

bool is_harmless(const std::string& text, bool lines) {
  return text == (lines ? text::readable(text) : text::printable(text));
}

TEST_F(Streams, NamesFromFilesDoNotReachATerminalRaw) {
  Sl1Options o;
  o.printer_profile = "Works \x1b[31m\a Two \xff";
  o.material = "Resin \x1b]0;title\a";
  make_sl1(folder_ / "part.sl1", o);
  RunResult r = shell("slicecorr info part.sl1");
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(is_harmless(r.out, true)) << r.out;
  r = shell("slicecorr info part.sl1 --json -");
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(is_harmless(r.out, true)) << r.out;
  EXPECT_TRUE(nlohmann::json::accept(r.out));
  // Entries of archives.
  Entries entries = unzip(folder_ / "part.sl1");
  entries.emplace_back("x\x1b[2J/../y", Bytes{1});
  make_zip(folder_ / "names.sl1", entries);
  r = shell("slicecorr info names.sl1");
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
  // TOML, its keys and values.
  write("odd.toml", "name = \"a\\u001b[2Jb\\nslicecorr: all is well\"\n\"k\\u0007\" = 1\n");
  r = shell("slicecorr slice ladder.stl -o t.uvj --layer-um 50 --printer odd.toml");
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
  std::string named = kPostPrinter;
  named.replace(named.find("small"), 5, "a\\u001b[2Jb\\nslicecorr: all is well");
  write("named.toml", named);
  r = shell(
      "slicecorr slice ladder.stl -o t.uvj --layer-um 50 --printer named.toml --center-mm 1,1");
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("beyond the display of 'a?[2Jb slicecorr: all is well'"));
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
  // Files whose own names do it.
  write_stl(folder_ / "evil\x1b[2J\n\xff.stl", ladder());
  r = shell("slicecorr slice evil* -o t.uvj --layer-um 50 --printer small.toml");
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
  // An OFF with words where numbers belong.
  write("bad.off", "OFF\n3 1 0\n0 0 \x1b[2J\n");
  r = shell("slicecorr slice bad.off -o t.uvj --layer-um 50 --printer small.toml");
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
  r = shell("slicecorr \"$(printf 'no\\033[2Jsuch')\"");
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
}

/// Names of images as programs of other places write them, without saying how. By day one of the two
/// programs meets each kind of name in turn, by night both.
TEST_F(Streams, ImageNamesInAnyEncodingAreKeptAndContinued) {
  struct Case {
    const char *what, *stem;
  };
  std::size_t kind = 0;
  for (const Case& c : {Case{"CP437",
                             "\x81"
                             "berhang"},
                        {"Latin-1",
                         "pi\xe8"
                         "ce"},
                        {"GBK", "\xc1\xe3\xbc\xfe"},
                        {"Shift-JIS", "\x95\x94\x95\x69"},
                        {"UTF-8", "\xc3\xa9t\xc3\xa9"},
                        {"control", "a\x01z\x1b"}}) {
    SCOPED_TRACE(c.what);
    make_sl1(folder_ / (std::string(c.stem) + ".sl1"));
    std::filesystem::rename(folder_ / (std::string(c.stem) + ".sl1"), folder_ / "part.sl1");
    const Entries before = unzip(folder_ / "part.sl1");
    const std::pair<std::string, std::string> programs[] = {
        {"slicecorr correct part.sl1 -o out.sl1", "out.sl1"},
        {"slicecorr-post part.sl1", "part.sl1"}};
    ++kind;
    for (std::size_t which = 0; which < std::size(programs); ++which) {
      if (!by_night() && kind % std::size(programs) != which) continue;
      const auto& [command, name] = programs[which];
      const RunResult r =
          shell(command + " --printer small.toml --resin figure-2-2 --ha-um 110 --speed-mm-h 800");
      EXPECT_EQ(r.exit_code, 0) << command << r.err;
      EXPECT_TRUE(is_harmless(r.err, true)) << r.err;
      const StackReader stack(folder_ / name, folder_.path());
      EXPECT_GT(stack.grid().layers, 50) << "slices were added";
      // Old names as they were, the added ones after them alike.
      zip_t* const zip = zip_open((folder_ / name).c_str(), ZIP_RDONLY, nullptr);
      ASSERT_NE(zip, nullptr);
      int images = 0;
      for (zip_int64_t i = 0; i < zip_get_num_entries(zip, 0); ++i) {
        const std::string raw = zip_get_name(zip, static_cast<zip_uint64_t>(i), ZIP_FL_ENC_RAW);
        if (is_layer_image(raw)) {
          EXPECT_TRUE(raw.starts_with(c.stem)) << name;
          ++images;
        }
      }
      EXPECT_EQ(images, stack.grid().layers);
      zip_discard(zip);
    }
  }
}

/// Where the system gives fewer threads, fewer do it; memory that it does not give is no defect of the program.
TEST_F(Streams, ThreadsAndMemoryThatAreNotToBeHad) {
  const std::string run =
      "slicecorr run ladder.stl -o out.uvj --layer-um 50 --printer small.toml --resin "
      "figure-2-2 --speed-mm-h 800 --threads 4";
  if (::geteuid() == 0) {
    // Root has as many as it likes.
    RunOptions nobody = options_;
    nobody.unprivileged = true;
    std::filesystem::permissions(folder_.path(), std::filesystem::perms::all);
    // A checkout in root's own folder is nobody's to run.
    const bool runs =
        run_program({"/bin/bash", "-c", "test -x " SLICECORR_BIN_DIR "/slicecorr"}, nobody)
            .exit_code == 0;
    for (int threads = 1; runs && threads <= 3; ++threads) {
      RunResult r = run_program(
          {"/bin/bash", "-c",
           fmt::format("ulimit -u {}; exec " SLICECORR_BIN_DIR "/slicecorr run ladder.stl -o "
                       "out.uvj --layer-um 50 --printer small.toml --resin figure-2-2 "
                       "--speed-mm-h 800 --threads 6",
                       threads)},
          nobody);
      EXPECT_EQ(r.exit_code, 0) << "with fewer threads, then" << r.err;
    }
  }
  for (const int kib : {60'000, 80'000, 100'000}) {
    const RunResult r = shell(fmt::format("ulimit -v {}; {}", kib, run));
    EXPECT_THAT(r.exit_code, testing::AnyOf(0, 4)) << kib << r.err;
  }
}

TEST(Words, ReadableKeepsLinesAndNothingThatMoves) {
  EXPECT_EQ(text::readable("a\tb\nµm \x1b[2J\r\a\xff"), "a\tb\nµm ?[2J ??");
  EXPECT_EQ(text::printable(kHostile), "a?[2Jb?c d??e ");
}

}  // namespace
}  // namespace slicecorr::test
