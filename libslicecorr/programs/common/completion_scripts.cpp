// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/completion_scripts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <string_view>
#include <utility>

namespace slicecorr::cli::completion {

namespace {

/// All commands of a tree, the program first.
std::vector<const Command*> all_of(const Command& program) {
  std::vector<const Command*> all{&program};
  for (const Command& sub : program.commands) {
    const std::vector<const Command*> below = all_of(sub);
    all.insert(all.end(), below.begin(), below.end());
  }
  return all;
}

std::string replaced(std::string text, std::string_view what, std::string_view with) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size()) {
    text.replace(at, what.size(), with);
  }
  return text;
}

/// With a backslash before each of these characters.
std::string escaped(std::string_view text, std::string_view characters) {
  std::string out;
  for (const char c : text) {
    if (characters.find(c) != std::string_view::npos) out += '\\';
    out += c;
  }
  return out;
}

/// No shell sees more than a word in it.
bool is_plain(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || is_digit(c) || c == '-' || c == '_' ||
           c == '.';
  });
}

/// For bash and zsh: nothing within single quotes is read.
std::string in_quotes(std::string_view text) {
  return "'" + replaced(std::string(text), "'", R"('\'')") + "'";
}

std::string bash_words(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) {
    out += (out.empty() ? "" : " ") + (is_plain(word) ? word : in_quotes(word));
  }
  return out;
}

/// The part of a script that is the same for all programs, with the program's name, and a word of it
/// that names of functions and variables begin with.
std::string frame_of(std::string_view frame, const std::string& program) {
  std::string text = replaced(std::string(frame), "@PROGRAM@", program);
  return replaced(std::move(text), "@FN@", "_" + replaced(program, "-", "_"));
}

constexpr std::string_view kBashHead =
    R"(# bash completion of @PROGRAM@, as "@PROGRAM@ --completion bash" prints it.
# shellcheck shell=bash

# What there is at a place: subcommands and options of the command $1; of its option $2, or of its
# positional of that number, what values are and how many follow.
# shellcheck disable=SC2034
@FN@_at() {
  commands=() options=() words=() names='' files='' least=0 most=0 commas=''
  case $1 in
)";

constexpr std::string_view kBashTail = R"(    *) return 1 ;;
  esac
}

# Sets REPLY to $1 without the quotes of the shell.
@FN@_plain() {
  local text=$1 quote='' character
  local -i i
  REPLY=''
  for ((i = 0; i < ${#text}; i++)); do
    character=${text:i:1}
    if [[ $character == \\ && $quote != \' ]]; then
      i+=1
      REPLY+=${text:i:1}
    elif [[ $character == "$quote" ]]; then
      quote=''
    elif [[ -z $quote && $character == [\'\"] ]]; then
      quote=$character
    else
      REPLY+=$character
    fi
  done
}

# Offers those of the words after $2 that begin with $2, each after $1.
@FN@_offer() {
  local word
  for word in "${@:3}"; do
    [[ $word == "$2"* ]] && COMPREPLY+=("$1$word")
  done
}

# Offers values, of which $2 is there, after $1.
@FN@_values() {
  local before=$1 value=$2 word program REPLY
  local -a found=()
  if [[ -n $commas && $value == *,* ]]; then
    before+=${value%,*},
    value=${value##*,}
  fi
  for word in "${words[@]}"; do
    [[ ,${before##*=} == *",$word,"* ]] || @FN@_offer "$before" "$value" "$word"
  done
  if [[ -z $names ]]; then
    case $files in
      # What readline finds by itself it quotes and marks best.
      any) compopt -o default 2>/dev/null ;;
      folders) compopt -o dirnames 2>/dev/null ;;
    esac
    return
  fi
  compopt -o filenames 2>/dev/null
  @FN@_plain "${COMP_WORDS[0]/#\~\//$HOME/}"
  program=$REPLY
  @FN@_plain "$value"
  value=$REPLY
  mapfile -t found < <("$program" --completion-names "$names" 2>/dev/null </dev/null)
  @FN@_offer "$before" "$value" "${found[@]}"
  if [[ $files == toml ]]; then
    mapfile -t found < <(compgen -f -X '!*.toml' -- "$value"; compgen -d -- "$value")
  else
    mapfile -t found < <(compgen -f -- "$value")
  fi
  COMPREPLY+=("${found[@]/#/"$before"}")
}

@FN@() {
  local path='' option='' ended='' names files least most commas word gap typed current before
  local -a commands options words line=()
  local -i i place=1 taken=0 cut
  local rest=${COMP_LINE-}
  COMPREPLY=()

  # Words up to the cursor. Bash ends words at = and :, too; what stands together is one word here.
  for ((i = 0; i <= COMP_CWORD; i++)); do
    word=${COMP_WORDS[i]}
    gap=${rest%%[![:space:]]*}
    rest=${rest#"$gap"}
    typed=$word
    if [[ -n ${COMP_LINE-} ]] && ((i == COMP_CWORD)); then
      cut=$((COMP_POINT - ${#COMP_LINE} + ${#rest}))
      ((cut >= 0 && cut < ${#word})) && typed=${word:0:cut}
    fi
    if ((i == 0)); then
      line+=("$typed")
    elif [[ -n ${COMP_LINE-} && -z $gap && -n $word ]] ||
      [[ -z ${COMP_LINE-} && ($word == '=' || ${line[-1]} == --*=) ]]; then
      line[-1]+=$typed
    else
      line+=("$typed")
    fi
    rest=${rest#"$word"}
  done
  current=${line[-1]}

  # Which command it is, and what the last word is of.
  for word in "${line[@]:1:${#line[@]}-2}"; do
    if [[ -n $option && $taken -lt $least && $word != --?* ]] ||
      [[ -n $option && $taken -lt $most && $word != -?* ]]; then
      taken+=1
      ((taken < most)) || option=''
      continue
    fi
    option=''
    if [[ -z $ended && $word == -- ]]; then
      ended=1
    elif [[ -z $ended && $word == -?* ]]; then
      @FN@_at "$path" "$word"
      ((most == 0)) || option=$word
      taken=0
    else
      @FN@_at "$path" ''
      if [[ " ${commands[*]} " == *" $word "* ]]; then
        path+="${path:+ }$word"
        place=1
      else
        place+=1
      fi
    fi
  done

  @FN@_at "$path" "$option"
  if [[ -n $option && ($taken -lt $least ||
    ($taken -lt $most && $current != -* && -n ${words[*]}$names$files)) ]]; then
    @FN@_values '' "$current"
  elif [[ -z $ended && $current == --*=* ]]; then
    @FN@_at "$path" "${current%%=*}"
    @FN@_values "${current%%=*}=" "${current#*=}"
  elif [[ -z $ended && $current == -* ]]; then
    @FN@_offer '' "$current" "${options[@]}"
  elif ((${#commands[@]} > 0)); then
    @FN@_offer '' "$current" "${commands[@]}"
  else
    @FN@_at "$path" "$place"
    if ((most > 0)); then
      @FN@_values '' "$current"
    elif [[ -z $ended && -z $current ]]; then
      COMPREPLY=("${options[@]}")
    fi
  fi

  # Bash puts what is offered in the place of its own last word.
  before=${current%"$typed"}
  [[ -n ${typed//[=:]/} ]] || before=$current
  COMPREPLY=("${COMPREPLY[@]#"$before"}")
}

complete -F @FN@ @PROGRAM@
)";

std::string bash_value(const Value& value) {
  std::string out;
  const auto set = [&](const std::string& what) { out += (out.empty() ? "" : " ") + what; };
  std::vector<std::string> words;
  for (const std::string& word : value.words) words.push_back(in_quotes(word));
  if (!words.empty()) set(fmt::format("words=({})", fmt::join(words, " ")));
  if (!value.names.empty()) set("names=" + value.names);
  if (value.files == Files::any) set("files=any");
  if (value.files == Files::toml) set("files=toml");
  if (value.files == Files::folders) set("files=folders");
  if (value.least > 0) set(fmt::format("least={}", value.least));
  if (value.most > 0) set(fmt::format("most={}", value.most));
  if (value.with_commas) set("commas=1");
  return out;
}

}  // namespace

std::string bash_script(const Command& program) {
  std::string out = frame_of(kBashHead, program.name);
  for (const Command* command : all_of(program)) {
    std::vector<std::string> names, options;
    for (const Command& sub : command->commands) names.push_back(sub.name);
    // Options whose values are alike share a line.
    std::map<std::string, std::vector<std::string>> alike;
    for (const Option& option : command->options) {
      options.insert(options.end(), option.names.begin(), option.names.end());
      std::vector<std::string>& these = alike[bash_value(option.value)];
      these.insert(these.end(), option.names.begin(), option.names.end());
    }
    out += fmt::format("    {})\n", in_quotes(command->path));
    if (!names.empty()) out += fmt::format("      commands=({})\n", bash_words(names));
    out += fmt::format("      options=({})\n      case $2 in\n", bash_words(options));
    for (const auto& [value, these] : alike) {
      if (value.empty()) continue;
      out += fmt::format("        {}) {} ;;\n", fmt::join(these, " | "), value);
    }
    int place = 0;
    for (const Value& value : command->positionals) {
      // One that takes many takes all that follow.
      const std::string places = value.most >= kMany ? "[1-9]*" : std::to_string(++place);
      out += fmt::format("        {}) {} ;;\n", places, bash_value(value));
    }
    out += "      esac ;;\n";
  }
  return out + frame_of(kBashTail, program.name);
}

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

namespace {

/// Within single quotes fish reads \\ and \' only.
std::string fish_in_quotes(std::string_view text) { return "'" + escaped(text, "\\'") + "'"; }

std::string fish_words(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) {
    out += (out.empty() ? "" : " ") + (is_plain(word) ? word : fish_in_quotes(word));
  }
  return out;
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
