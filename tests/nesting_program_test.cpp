// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Texts nested as deep as no program writes them, in each kind of file in which one is read, given to
// each program that reads it: refused with 2, never a program that ends by a signal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

constexpr int kDeep = 100'000;

std::string repeated(const std::string& text, int n) {
  std::string all;
  for (int i = 0; i < n; ++i) all += text;
  return all;
}
std::string lists() { return repeated("[", kDeep) + repeated("]", kDeep); }
std::string json_with(const std::string& start) {
  return "{" + start + "\"deep\":" + lists() + "}";
}
std::string elements(const std::string& in) {
  return "<" + in + ">" + repeated("<a>", kDeep) + repeated("</a>", kDeep) + "</" + in + ">";
}
std::string names() { return "a" + repeated(".a", kDeep / 2) + " = 1\n"; }

class Nesting : public ProgramFixture {
 protected:
  Entries archive(const std::string& entry_name, const std::string& text, const char* image) {
    Entries entries;
    entries.emplace_back(entry_name, to_bytes(text));
    if (image) entries.emplace_back(image, to_bytes("x"));
    return entries;
  }
  void refused(const std::string& program, const Command& arguments, const std::string& word) {
    const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/" + program} + arguments, options_);
    EXPECT_EQ(r.exit_code, 2) << ::testing::PrintToString(program) << " "
                              << ::testing::PrintToString(arguments) << "\n"
                              << r.err.substr(0, 1000);
    EXPECT_THAT(r.err, ::testing::HasSubstr(word)) << ::testing::PrintToString(arguments);
    EXPECT_LT(r.err.size(), 2000U);
    EXPECT_THAT(r.err, ::testing::Not(::testing::HasSubstr("exception")));
  }
};

TEST_F(Nesting, ArchivesOfOthers) {
  const std::string deep = "nested more than 64 deep";
  const struct {
    const char* file;
    const char* entry;
    std::string text;
    const char* image;
  } archives[] = {
      {"a.uvj", "config.json", json_with("\"Properties\":{},"), "slice/00000000.png"},
      {"a.vdt", "manifest.json", json_with("\"machine\":{},"), "0.png"},
      {"a.nanodlp", "meta.json", json_with(""), "1.png"},
      {"plate.nanodlp", "plate.json", json_with(""), "1.png"},
      {"a.zip", "printsettings", json_with(""), "slice_1.png"},
      {"u.zip", "manifest.uvtools", elements("Manifest"), "1.png"},
      {"v.zip", "a.xml", elements("root"), "0.png"},
      {"job.zip", "tomo.json", json_with(""), nullptr},
  };
  for (const auto& a : archives) {
    make_zip(folder_ / a.file, archive(a.entry, a.text, a.image), true);
    for (const Command& command :
         {Command{"convert", a.file, "--output", "b.uvj"}, Command{"verify", a.file},
          Command{"section", a.file, "--row", "1", "--output", "b.png"}}) {
      const RunResult r = call(command);
      EXPECT_EQ(r.exit_code, 2) << a.file << " " << command[0] << "\n" << r.err.substr(0, 500);
      EXPECT_LT(r.err.size(), 2000U) << a.file;
    }
    const RunResult post = run_program({SLICECORR_BIN_DIR "/slicecorr-post", a.file}, options_);
    EXPECT_EQ(post.exit_code, 2) << a.file << "\n" << post.err.substr(0, 500);
  }
  refused("slicecorr", {"convert", "a.uvj", "--output", "b.uvj"}, deep);
  refused("slicecorr", {"convert", "a.vdt", "--output", "b.uvj"}, deep);
  refused("slicecorr", {"tomo", "verify", "job.zip"}, "");
}

TEST_F(Nesting, DefinitionsAndLists) {
  const std::string deep = "names of more than 16 parts";
  write("p.toml", names());
  write("list.json", "{\"depth_penetration_curve\":" + lists() + "}");
  write("r.csv", "intensity_mw_cm2,exposure_s,cured_height_um\n5,20,100\n");
  make_zip(folder_ / "part.zip", {}, false);
  write("part.stl", "solid a\nendsolid a\n");
  refused("slicecorr",
          {"run", "part.stl", "--printer", "p.toml", "--layer-um", "50", "--resin", "benchy-resin",
           "--speed-mm-h", "500", "--output", "o.uvj"},
          deep);
  refused("slicecorr", {"run", "part.stl", "--resin", "p.toml", "--output", "o.uvj"}, "");
  const RunResult valid =
      run_program({SLICECORR_BIN_DIR "/resinctl", "validate", "p.toml"}, options_);
  EXPECT_EQ(valid.exit_code, 2);
  EXPECT_THAT(valid.out, ::testing::HasSubstr(deep));
  refused("resinctl", {"show", "p.toml"}, "");
  refused("resinctl", {"import", "list.json"}, "nested more than 64 deep");
  refused("slicecorr-post", {"--config", "p.toml", "part.zip"}, deep);
  write("printer.toml", kSmallPrinter);
  refused("printbridge", {"print", "part.zip", "--printer", "p.toml", "--sink", "null"}, deep);
  refused("slicefarm", {"submit", "p.toml", "--dir", "farm", "--dry-run"}, deep);
}

}  // namespace
}  // namespace slicecorr::test
