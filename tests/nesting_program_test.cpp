// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Texts nested as deep as no program writes them, in each kind of file in which one is read, given to
// each program that reads it: refused with 2, never a program that ends by a signal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "program_fixture.hpp"
#include "slicecorr/stack.hpp"

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
  const std::string json = "is no JSON that is read here: it is nested more than 64 deep",
                    xml = "is no XML that is read here: it is nested more than 64 deep";
  const Bytes png = encode_png(GreyImage{2, 2, {0, 255, 255, 0}});
  const struct {
    const char* file;
    const char* image;
    std::vector<std::pair<std::string, std::string>> texts;
    std::string says;  ///< entry and reader: that it came so far
  } archives[] = {
      {"a.uvj",
       "slice/00000000.png",
       {{"config.json", json_with("\"Properties\":{},")}},
       "config.json: " + json},
      {"a.vdt",
       "0.png",
       {{"manifest.json", json_with("\"machine\":{},")}},
       "manifest.json: " + json},
      {"a.nanodlp",
       "1.png",
       {{"meta.json", json_with("")}, {"plate.json", "{}"}},
       "meta.json: " + json},
      {"plate.nanodlp",
       "1.png",
       {{"meta.json", "{}"}, {"plate.json", json_with("")}, {"profile.json", "{}"}},
       "plate.json: " + json},
      {"a.zip", "slice_1.png", {{"printsettings", json_with("")}}, "printsettings: " + json},
      {"u.zip", "1.png", {{"manifest.uvtools", elements("Manifest")}}, "manifest.uvtools: " + xml},
      {"v.zip", "0.png", {{"a.xml", elements("root")}}, "a.xml: " + xml},
  };
  for (const auto& a : archives) {
    Entries entries{{a.image, png}};
    for (const auto& [name, text] : a.texts) entries.emplace_back(name, to_bytes(text));
    make_zip(folder_ / a.file, entries, true);
    for (const Command& command :
         {Command{"convert", a.file, "--output", "b.uvj"}, Command{"verify", a.file},
          Command{"section", a.file, "--row", "1", "--output", "b.png"}}) {
      refused("slicecorr", command, command[0] == "convert" ? a.says : "");
    }
    refused("slicecorr-post", {a.file}, "");
  }
  make_zip(folder_ / "job.frames", {{"config.json", to_bytes(json_with(""))}}, true);
  refused("slicecorr", {"tomo", "verify", "job.frames"}, "config.json: " + json);
}

TEST_F(Nesting, DefinitionsAndLists) {
  const std::string deep = "names of more than 16 parts";
  write("p.toml", names());
  write("list.json", "{\"depth_penetration_curve\":" + lists() + "}");
  make_zip(folder_ / "part.zip", {}, false);
  write("part.stl", "solid a\nendsolid a\n");
  refused("slicecorr",
          {"run", "part.stl", "--printer", "p.toml", "--layer-um", "50", "--resin", "benchy-resin",
           "--speed-mm-h", "500", "--output", "o.uvj"},
          deep);
  write("printer.toml", kSmallPrinter);
  refused("slicecorr",
          {"run", "part.stl", "--printer", "printer.toml", "--layer-um", "50", "--resin", "p.toml",
           "--speed-mm-h", "500", "--output", "o.uvj"},
          deep);
  const RunResult valid =
      run_program({SLICECORR_BIN_DIR "/resinctl", "validate", "p.toml"}, options_);
  EXPECT_EQ(valid.exit_code, 2);
  EXPECT_THAT(valid.out, ::testing::HasSubstr(deep));
  refused("resinctl", {"show", "p.toml"}, deep);
  refused("resinctl", {"import", "list.json"}, "nested more than 64 deep");
  refused("slicecorr-post", {"--config", "p.toml", "part.zip"}, deep);
  refused("printbridge", {"print", "part.zip", "--printer", "p.toml", "--sink", "null"}, deep);
  refused("slicefarm", {"submit", "p.toml", "--dir", "farm", "--dry-run"}, deep);
}

}  // namespace
}  // namespace slicecorr::test
