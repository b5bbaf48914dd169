// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>

#include "programs/common/completion_words.hpp"

namespace slicecorr::cli::completion {

namespace {

constexpr std::string_view kZshHead = R"(#compdef @PROGRAM@
# zsh completion of @PROGRAM@, as "@PROGRAM@ --completion zsh" prints it.

# Names of the kind $1 that the program knows now, and files.
@FN@_names() {
  local -a definitions
  definitions=("${(@f)$("$program" --completion-names $1 2>/dev/null </dev/null)}")
  definitions=("${(@)definitions:#}")
  local files="_path_files -g '*.toml(-.) *(-/)'"
  [[ $2 == any ]] && files=_files
  _alternative "names:${1}:compadd -a definitions" "files:file:$files"
}
)";

constexpr std::string_view kZshTail = R"(
@FN@() {
  local program=${(Q)words[1]}
  [[ $program == '~/'* ]] && program=$HOME/${program#'~/'}
  @FN@_at
}

# Loaded by a name in $fpath, or read by source.
if [[ $funcstack[1] == @FN_FILE@ ]]; then
  @FN@ "$@"
else
  compdef @FN@ @PROGRAM@
fi
)";

/// The name of the function for a command.
std::string zsh_function(const Command& command, const std::string& program) {
  std::string name = frame_of("@FN@_at", program);
  if (!command.path.empty()) name += "_" + replaced(command.path, " ", "_");
  return name;
}

/// What follows an option, or what a positional is.
std::string zsh_values(const Value& value, const std::string& program, int least, int most) {
  std::string action = " ";
  if (!value.words.empty()) {
    for (const std::string& word : value.words) {
      action += (action == " " ? "" : " ") + escaped(word, " \\\"'`$()[]{}<>|&;*?~#=^!:");
    }
    action.erase(0, 1);
    action = value.with_commas ? "_values -s , " + value.title + " " + action : "(" + action + ")";
  } else if (!value.names.empty()) {
    // With a space before it no more words are put into it.
    action = fmt::format(" {} {} {}", frame_of("@FN@_names", program), value.names,
                         value.files == Files::any ? "any" : "toml");
  } else if (value.files == Files::any) {
    action = "_files";
  } else if (value.files == Files::folders) {
    action = "_files -/";
  }
  std::string out;
  for (int i = 0; i < most; ++i) {
    out += (i < least ? ":" : "::") + escaped(value.title, "\\:") + ":" + action;
  }
  return out;
}

std::vector<std::string> zsh_option(const Option& option, const std::string& program) {
  // Further values than these are rare, and their option can be given again.
  constexpr int most_values = 8;
  const Value& value = option.value;
  const int most = value.attached ? 1 : std::min(value.most, most_values);
  const std::string tail =
      "[" + escaped(option.text, "\\[]") + "]" + zsh_values(value, program, value.least, most);
  const std::string before = option.again ? "*" : fmt::format("({})", fmt::join(option.names, " "));
  std::vector<std::string> specs;
  for (const std::string& name : option.names) {
    const bool is_long = name.starts_with("--");
    const char* const sign = value.attached ? "=-" : value.most == 0 ? "" : is_long ? "=" : "+";
    specs.push_back(in_quotes(before + name + sign + tail));
  }
  return specs;
}

}  // namespace

std::string zsh_script(const Command& program) {
  std::string out = frame_of(kZshHead, program.name);
  for (const Command* command : all_of(program)) {
    std::vector<std::string> specs;
    for (const Option& option : command->options) {
      const std::vector<std::string> these = zsh_option(option, program.name);
      specs.insert(specs.end(), these.begin(), these.end());
    }
    int place = 0;
    for (const Value& value : command->positionals) {
      const std::string at = value.most >= kMany ? "*" : std::to_string(++place);
      specs.push_back(in_quotes(at + zsh_values(value, program.name, 1, 1)));
    }
    const std::string function = zsh_function(*command, program.name);
    if (command->commands.empty()) {
      out += fmt::format("\n{}() {{\n  _arguments -S : \\\n    {}\n}}\n", function,
                         fmt::join(specs, " \\\n    "));
      continue;
    }
    std::string names, calls;
    for (const Command& sub : command->commands) {
      names += "        " + in_quotes(escaped(sub.name, "\\:") + ":" + sub.text) + "\n";
      calls += fmt::format("        {}) {} && ret=0 ;;\n", in_quotes(sub.name),
                           zsh_function(sub, program.name));
    }
    out += fmt::format(R"(
{0}() {{
  local curcontext=$curcontext state state_descr ret=1
  local -a line commands
  local -A opt_args
  _arguments -C -S : \
    {1} \
    '(-): :->command' '(-)*:: :->rest' && ret=0
  case $state in
    command)
      commands=(
{2}      )
      _describe -t commands command commands && ret=0 ;;
    rest)
      curcontext=${{curcontext%:*:*}}:{3}-$line[1]:
      case $line[1] in
{4}      esac ;;
  esac
  return ret
}}
)",
                       function, fmt::join(specs, " \\\n    "), names, program.name, calls);
  }
  return out + replaced(frame_of(kZshTail, program.name), "@FN_FILE@", "_" + program.name);
}

}  // namespace slicecorr::cli::completion
