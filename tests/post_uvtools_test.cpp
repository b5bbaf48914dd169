// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The way through UVtools, with a stub that takes UVtoolsCmd's arguments: "convert IN TYPE OUT"
/// and "copy-parameters IN OUT". Its "ctb" is a UVJ archive under another name.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "post_fixture.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Uvtools : public PostFolder {
 protected:
  Uvtools() {
    write("UVtoolsCmd",
          "#!/bin/bash\necho \"$*\" >>\"" + (folder_ / "calls") +
              "\"\ncase $1 in\n"
              "  convert)\n"
              // Like the real one, some failures end with 0.
              "    if [[ $3 == nothing ]]; then echo 'Unable to find a valid encoder'; exit 0; fi\n"
              "    cp \"$2\" \"$4\" ;;\n"
              "  copy-parameters) [[ -s $2 && -s $3 ]] ;;\n"
              "  *) exit 1 ;;\n"
              "esac\n");
    fs::permissions(folder_ / "UVtoolsCmd", fs::perms::owner_all);
    options_.environment["UVTOOLSCMD"] = folder_ / "UVtoolsCmd";
    options_.environment["SLICECORR_POST"] = SLICECORR_BIN_DIR "/slicecorr-post";
    make_sl1(folder_ / "part.sl1");
  }
  RunResult wrapper(const Command& arguments) const {
    return run_program(
        Command{SLICECORR_SOURCE_DIR "/slicer-plugin/uvtools/slicecorr-uvtools"} + arguments,
        options_);
  }
};

TEST_F(Uvtools, FormatsThatWeReadAreCorrectedDirectlyAndConverted) {
  const Bytes before = bytes("part.sl1");
  const RunResult r = wrapper(Command{"--to", "goo"} + kSmall + Command{"--backup", "part.sl1"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(bytes("part.sl1.orig"), before);
  EXPECT_NE(bytes("part.sl1"), before);
  EXPECT_EQ(bytes("part.goo"), bytes("part.sl1"));
  EXPECT_THAT(r.out, HasSubstr("part.goo"));
  EXPECT_THAT(text("calls"), HasSubstr("convert " + (folder_ / "part.sl1") + " goo "));
}

TEST_F(Uvtools, OtherFormatsGoThereAndBack) {
  fs::rename(folder_ / "part.sl1", folder_ / "my part.ctb");
  const Bytes before = bytes("my part.ctb");
  const RunResult r =
      wrapper(Command{"--encoder", "Chitubox"} + kSmall + Command{"--backup", "my part.ctb"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(bytes("my part.ctb.orig"), before);
  EXPECT_NE(bytes("my part.ctb"), before);
  EXPECT_THAT(text("calls"), HasSubstr(" uvj "));
  EXPECT_THAT(text("calls"), HasSubstr(" Chitubox "));
  EXPECT_THAT(text("calls"), HasSubstr("copy-parameters " + (folder_ / "my part.ctb")));
  EXPECT_EQ(StackReader::read_info(folder_ / "my part.ctb").kind, StackKind::corrected);
}

TEST_F(Uvtools, FailuresLeaveTheFileAsItWas) {
  fs::rename(folder_ / "part.sl1", folder_ / "part.ctb");
  const Bytes before = bytes("part.ctb");
  const auto names_before = names();
  struct Wrong {
    int code;
    Command arguments;
    std::string words;
  };
  const Wrong cases[] = {
      {2, {"none.ctb"}, "none.ctb: is not a file"},
      {2, {"--watch", "."}, "is for slicecorr-post itself"},
      {2, {"--printer", "none", "part.ctb"}, "no printer 'none'"},
      {3, kSmall + Command{"--exposure-s", "0.01", "part.ctb"}, "expose for at least"},
      {4, Command{"--encoder", "nothing"} + kSmall + Command{"part.ctb"},
       "could not convert it to nothing: Unable to find"},
  };
  for (const Wrong& wrong : cases) {
    const RunResult r = wrapper(wrong.arguments);
    EXPECT_EQ(r.exit_code, wrong.code) << r.err;
    EXPECT_THAT(r.err, HasSubstr(wrong.words));
    EXPECT_EQ(bytes("part.ctb"), before);
    fs::remove(folder_ / "calls");
    EXPECT_EQ(names(), names_before);
  }
}

}  // namespace
}  // namespace slicecorr::test
