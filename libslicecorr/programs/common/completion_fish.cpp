// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <string_view>

#include "programs/common/completion_words.hpp"

namespace slicecorr::cli::completion {

namespace {

/// Within single quotes fish reads \\ and \' only.
std::string fish_in_quotes(std::string_view text) { return "'" + escaped(text, "\\'") + "'"; }

std::string fish_words(const std::vector<std::string>& words) {
  return words_quoted(words, fish_in_quotes);
}

constexpr std::string_view kFishHead =
    R"(# fish completion of @PROGRAM@, as "@PROGRAM@ --completion fish" prints it.

# Whether the command $argv[1] is what the cursor is after; with a number, at that positional of it,
# or, with a further word, at that one or a later one.
function _@FN@_at
    set -l line (commandline -opc)
    if test "$line" != "$_@FN@_line"
        set -g _@FN@_line "$line"
        set -g _@FN@_path ''
        set -g _@FN@_place 1
        set -g _@FN@_many ''
        set -l waits no
        set -l ended no
        set -e line[1]
        for word in $line
            if test $waits = yes
                set waits no
                continue
            end
            if test $ended = no
                string match -q -- '-?*' $word; and set _@FN@_many ''
                switch $word
                    case --
                        set ended yes
                        continue
                    case '--*=*'
                        continue
                    case '-?*'
                        _@FN@_takes $_@FN@_path $word; and set waits yes
                        _@FN@_takes_many $_@FN@_path $word; and set _@FN@_many $word
                        continue
                end
            end
            test -n "$_@FN@_many"; and continue
            set -l path (string trim -- "$_@FN@_path $word")
            if test $_@FN@_place -eq 1; and _@FN@_knows $path
                set _@FN@_path $path
            else
                set _@FN@_place (math $_@FN@_place + 1)
            end
        end
    end
    test "$_@FN@_path" = $argv[1]; or return 1
    set -q argv[2]; or return 0
    string match -q -- '--*=*' (commandline -ct); and return 1
    test $_@FN@_place -eq $argv[2]; and return 0
    set -q argv[3]; and test $_@FN@_place -gt $argv[2]
end

# Whether what is at the cursor may be a further value of the option $argv[2] of the command $argv[1].
function _@FN@_after
    _@FN@_at $argv[1]; or return 1
    string match -q -- '--*=*' (commandline -ct); and return 1
    test "$_@FN@_many" = $argv[2]
end

# The word at the cursor, without an option and = before it.
function _@FN@_word
    commandline -ct | string replace -r -- '^--[^=]*=' ''
end

# Names of a kind that the program knows now; with a further word, .toml files and folders, too.
function _@FN@_names
    set -l program (commandline -opc)[1]
    set program (string replace -r -- '^~/' "$HOME/" $program)
    $program --completion-names $argv[1] 2>/dev/null </dev/null | string replace -r '$' \t$argv[1]
    set -q argv[2]; or return 0
    complete -C "'' "(_@FN@_word) | string match -r -- '.*(?:\.toml|/)$'
end

function _@FN@_folders
    complete -C "'' "(_@FN@_word) | string match -r -- '.*/$'
end

# Words with commas between them, each once.
function _@FN@_list
    set -l before (_@FN@_word | string match -r -- '.*,'; or echo)
    for word in $argv
        contains -- $word (string split -- , $before); or echo $before$word
    end
end
)";

std::string fish_values(const Value& value, const std::string& program) {
  const auto call = [&](const std::string& what) {
    return frame_of("(_@FN@_" + what + ")", program);
  };
  if (value.with_commas) return "-f -a " + fish_in_quotes(call("list " + fish_words(value.words)));
  if (!value.words.empty()) return "-f -a " + fish_in_quotes(fish_words(value.words));
  if (!value.names.empty()) {
    const bool any = value.files == Files::any;
    return (any ? "-F -a " : "-f -a ") +
           fish_in_quotes(call("names " + value.names + (any ? "" : " toml")));
  }
  if (value.files == Files::folders) return "-f -a " + fish_in_quotes(call("folders"));
  return value.files == Files::any ? "-F" : "-f";
}

}  // namespace

std::string fish_script(const Command& program) {
  std::string out = frame_of(kFishHead, program.name);
  const std::string name = frame_of("_@FN@", program.name);
  std::vector<std::string> takes, many, knows;
  const std::vector<const Command*> commands = all_of(program);
  for (const Command* command : commands) {
    if (!command->path.empty()) knows.push_back(command->path);
    for (const Option& option : command->options) {
      for (const std::string& n : option.names) {
        if (option.value.least > 0) takes.push_back(command->path + " " + n);
        if (option.value.most > 1) many.push_back(command->path + " " + n);
      }
    }
  }
  out += fmt::format(R"(
# Whether the option $argv[2] of the command $argv[1] waits for a value.
function {0}_takes
    contains -- "$argv[1] $argv[2]" {1}
end

# Whether further values of it may follow.
function {0}_takes_many
    contains -- "$argv[1] $argv[2]" {2}
end

# Whether there is such a command.
function {0}_knows
    contains -- $argv[1] {3}
end

complete -c {4} -f
)",
                     name, fish_words(takes), fish_words(many), fish_words(knows), program.name);
  for (const Command* command : commands) {
    const auto complete = [&](const std::string& where, const std::string& what,
                              const char* when = "at") {
      const std::string condition =
          fmt::format("{}_{} {}{}", name, when, fish_in_quotes(command->path), where);
      out +=
          fmt::format("complete -c {} -n {} {}\n", program.name, fish_in_quotes(condition), what);
    };
    for (const Command& sub : command->commands) {
      complete(" 1", fmt::format("-a {} -d {}", fish_in_quotes(fish_words({sub.name})),
                                 fish_in_quotes(sub.text)));
    }
    int place = 0;
    for (const Value& value : command->positionals) {
      const bool many = value.most >= kMany;
      complete(fmt::format(" {}{}", many ? place + 1 : ++place, many ? " more" : ""),
               fish_values(value, program.name));
    }
    for (const Option& option : command->options) {
      std::string what;
      for (const std::string& n : option.names) {
        const bool is_long = n.starts_with("--");
        what += fmt::format("{} {} ", is_long ? "-l" : "-s", n.substr(is_long ? 2 : 1));
      }
      if (option.value.least > 0) what += "-r ";
      if (option.value.most > 0 || option.value.attached) {
        what += fish_values(option.value, program.name) + " ";
      }
      complete("", what + "-d " + fish_in_quotes(option.text));
      if (option.value.most < 2) continue;
      for (const std::string& n : option.names) {
        complete(" " + n, fish_values(option.value, program.name), "after");
      }
    }
  }
  return out;
}

}  // namespace slicecorr::cli::completion
