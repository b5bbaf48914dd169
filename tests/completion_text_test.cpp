// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Texts that a shell could take for code in what completes commands. Which commands and options are
// offered is tested by completion.py, with the programs.

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "programs/common/completion.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;

// Short enough to be shown whole.
const std::vector<std::string> kTexts = {
    "$(touch made) `touch made` ${HOME}",      R"(it's "quoted", and ';touch made;')",
    R"(a\b \$(touch made) ends with \)",       "x]y[z:w ](touch made)",
    "100 %d *? ~ # & | < > ! {a,b} \xc2\xb5m",
};

class CompletionText : public testing::Test {
 protected:
  CompletionText() : folder_(temporary_.path()) {
    for (std::size_t i = 0; i < kTexts.size(); ++i) {
      app_.add_flag("--flag" + std::to_string(i), kTexts[i]);
    }
    CLI::App* sub = app_.add_subcommand("sub", kTexts[0]);
    sub->add_option("--words", word_, "Words")->check(cli::value_such_as(kTexts));
  }
  ~CompletionText() override { EXPECT_FALSE(fs::exists(folder_ / "made")); }
  /// What a shell prints of `code` after the script; the script alone prints nothing.
  std::string run(const std::string& shell, const std::string& code) {
    std::ofstream(folder_ / "script") << cli::completion_script(app_, shell);
    std::ofstream(folder_ / "code") << code;
    test::RunOptions options;
    options.environment = {{"HOME", folder_.string()}};
    options.folder = folder_.string();
    const test::RunResult result = test::run_program({"/usr/bin/" + shell, "code"}, options);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(result.err, "");
    return result.out;
  }
  static bool is_there(const std::string& shell) { return fs::exists("/usr/bin/" + shell); }

  test::TemporaryFolder temporary_;
  fs::path folder_;
  CLI::App app_{"Takes texts", "hostile"};
  std::string word_;
};

std::string lines_of(const std::vector<std::string>& texts) {
  std::string lines;
  for (const std::string& text : texts) lines += text + "\n";
  return lines;
}

TEST_F(CompletionText, BashOffersWordsAsTheyAre) {
  const std::string out = run("bash", R"(source ./script
COMP_WORDS=(hostile sub --words '') COMP_CWORD=3 COMP_LINE='hostile sub --words ' COMP_POINT=20
_hostile
printf '%s\n' "${COMPREPLY[@]}"
)");
  EXPECT_NE(out.find(kTexts[0] + "\n"), std::string::npos) << out;
  EXPECT_NE(out.find(kTexts[2] + "\n"), std::string::npos) << out;
  EXPECT_NE(out.find(kTexts[3] + "\n"), std::string::npos) << out;
}

TEST_F(CompletionText, ZshShowsTextsAsTheyAre) {
  if (!is_there("zsh")) GTEST_SKIP() << "zsh is not installed";
  // What _arguments gets; it reads a text until the first ] that has no backslash before it.
  const std::string out = run("zsh", R"(compdef() { :; }
_describe() { print -rl -- "${(@P)@[-1]}"; }
_arguments() {
  local spec
  for spec in "$@"; do
    [[ $spec == *--flag* ]] && print -r -- "${${spec#*\[}%\]}"
  done
  state=command
}
source ./script
_hostile_at
)");
  std::vector<std::string> expected = kTexts;
  expected[2] = R"(a\\b \\$(touch made) ends with \\)";
  expected[3] = R"(x\]y\[z:w \](touch made))";
  expected.push_back("sub:" + kTexts[0]);
  EXPECT_EQ(out, lines_of(expected));
}

TEST_F(CompletionText, FishShowsTextsAsTheyAre) {
  if (!is_there("fish")) GTEST_SKIP() << "fish is not installed";
  const std::string out = run("fish", R"(source ./script
complete -C 'hostile --flag' | string split -f 2 \t
complete -C 'hostile s' | string split -f 2 \t
)");
  std::vector<std::string> expected = kTexts;
  expected.push_back(kTexts[0]);
  EXPECT_EQ(out, lines_of(expected));
}

}  // namespace
}  // namespace slicecorr
