// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>
#include <string_view>

#include "programs/common/completion_words.hpp"

namespace slicecorr::cli::completion {

namespace {

std::string bash_words(const std::vector<std::string>& words) {
  return words_quoted(words, in_quotes);
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

}  // namespace slicecorr::cli::completion
