/// slicecorr-post on every archive format, and on files that change under its hands.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "post_fixture.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class PostFormats : public PostFolder {
 protected:
  PostFormats() { make_sl1(folder_ / "part.sl1"); }
};

TEST_F(PostFormats, EachInPlaceAndBack) {
  int tried = 0;
  for (const FormatInfo& format : archive_formats()) {
    if (format.name == "folder") continue;
    ASSERT_FALSE(format.endings.empty()) << format.name;
    SCOPED_TRACE(format.name);
    const std::string name = "export-" + format.name + format.endings.front();
    const RunResult converted =
        run_program({SLICECORR_BIN_DIR "/slicecorr", "convert", "part.sl1", "-o", name, "--format",
                     format.name, "--printer", "small.toml"},
                    options_);
    if (converted.exit_code != 0) {
      // An Ember has one display; the reason must be that.
      EXPECT_THAT(converted.err, HasSubstr("1280")) << format.name;
      continue;
    }
    ++tried;
    const Bytes before = bytes(name);
    good(kSmall + Command{"--exposure-s", "0.1", "--backup", name});
    EXPECT_EQ(bytes(name + ".orig"), before);
    const StackInfo info = StackReader::read_info(folder_ / name);
    EXPECT_EQ(info.kind, StackKind::corrected);
    EXPECT_EQ(info.format, format.name);
    EXPECT_EQ(info.grid.layers, 50);
    EXPECT_EQ(post(kSmall + Command{name}).exit_code, 2) << "a second time";
    const Bytes first = bytes(name);
    good(kSmall + Command{"--exposure-s", "0.1", "--again", name});
    EXPECT_EQ(bytes(name), first);
    good({"--undo", name});
    EXPECT_EQ(bytes(name), before);
  }
  EXPECT_GE(tried, 5);
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
