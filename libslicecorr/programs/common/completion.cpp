// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/completion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <set>
#include <string_view>
#include <utility>

#include "programs/common/completion_scripts.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/stack.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {
namespace {

using completion::Command, completion::Files, completion::kMany, completion::Option,
    completion::Value;

/// Names of validators that only tell what a value is, before the kind or the words.
constexpr std::string_view kKindMark = "value:";
constexpr std::string_view kWordsMark = "values:";
/// An option's text in a few words: until its first end, without the default in brackets.
std::string short_text(std::string_view text) {
  constexpr std::size_t least = 32;
  constexpr int most_columns = 72;
  int depth = 0;
  std::size_t end = text.size();
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::string_view here = text.substr(i);
    if (text[i] == '(') ++depth;
    if (text[i] == ')') --depth;
    const bool ends = here.starts_with("; ") || here.starts_with(": ") || here.starts_with(". ");
    if ((depth == 0 && i >= least && ends) || (i > 0 && here.starts_with(" ["))) {
      end = i;
      break;
    }
  }
  std::string cut = text::printable(text.substr(0, end));
  if (cut.ends_with('.')) cut.pop_back();
  return text::clipped(cut, most_columns);
}

/// The words of CLI::IsMember, which describes itself as "{a,b}".
std::vector<std::string> words_of_set(std::string_view description) {
  std::vector<std::string> words;
  if (!description.starts_with('{') || !description.ends_with('}')) return words;
  description = description.substr(1, description.size() - 2);
  while (!description.empty()) {
    const std::size_t comma = std::min(description.find(','), description.size());
    words.emplace_back(description.substr(0, comma));
    description.remove_prefix(std::min(comma + 1, description.size()));
  }
  return words;
}

std::vector<CLI::Validator*> validators_of(CLI::Option& option) {
  std::vector<CLI::Validator*> all;
  try {
    for (int i = 0;; ++i) all.push_back(option.get_validator(i));
  } catch (const CLI::OptionNotFound&) {  // how CLI11 tells the end
  }
  return all;
}

void be_kind(Value& value, std::string_view kind) {
  if (kind == "format") {
    for (const FormatInfo& f : archive_formats()) value.words.push_back(f.name);
    return;
  }
  value.files = kind == "file" || kind == "resin_or_file" ? Files::any
                : kind == "folder"                        ? Files::folders
                : kind == "text"                          ? Files::none
                                                          : Files::toml;
  if (kind == "printer" || kind == "definition") value.names = kind;
  if (kind.starts_with("resin")) value.names = "resin";
}

/// The rule that `ValueKind` tells.
void find_kind(CLI::Option& option, Value& value) {
  const std::vector<CLI::Validator*> validators = validators_of(option);
  for (const CLI::Validator* v : validators) {
    const std::string_view name = v->get_name();
    if (name.starts_with(kKindMark)) return be_kind(value, name.substr(kKindMark.size()));
    value.words = name.starts_with(kWordsMark) ? words_of_set(name.substr(kWordsMark.size()))
                                               : words_of_set(v->get_description());
    if (!value.words.empty()) return;
  }
  const std::string type = option.get_type_name();
  const bool number =
      type.starts_with("INT") || type.starts_with("UINT") || type.starts_with("FLOAT") ||
      std::any_of(validators.begin(), validators.end(),
                  [](const CLI::Validator* v) { return v->get_name() == "number"; });
  if (number) return;
  std::vector<std::string> names = option.get_lnames();
  names.push_back(lower_case(option.get_name(true, false)));
  const auto named = [&](std::string_view end) {
    return std::any_of(names.begin(), names.end(),
                       [&](const std::string& name) { return name.ends_with(end); });
  };
  const auto is = [&](const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  be_kind(value, is("printer")                                                ? "printer"
                 : is("resin")                                                ? "resin"
                 : type.starts_with("DIR") || named("dir") || named("folder") ? "folder"
                                                                              : "file");
}

/// How many values may follow an option, as CLI11 counts them.
void find_count(const CLI::Option& option, Value& value) {
  value.least = std::min(option.get_type_size_min(), option.get_items_expected_min());
  value.most = option.get_items_expected_max();
  if (value.most >= CLI::detail::expected_max_vector_size / 16 && !option.get_allow_extra_args()) {
    value.most = option.get_type_size_max();
  }
  // Several values with commas are one word.
  if (option.get_delimiter() != '\0' && value.most > 0) value.least = value.most = 1;
  value.most = std::min(value.most, kMany);
  value.with_commas = option.get_delimiter() == ',' && !value.words.empty();
}

Value value_of(CLI::Option& option) {
  Value value;
  value.title = lower_case(option.get_lnames().empty() ? option.get_name(true, false)
                                                       : option.get_lnames().front());
  find_count(option, value);
  const bool flag = value.most == 0;
  if (flag && validators_of(option).empty()) return value;
  find_kind(option, value);
  value.with_commas = option.get_delimiter() == ',' && !value.words.empty();
  value.attached = flag;
  return value;
}

Option option_of(CLI::Option& from) {
  Option option;
  for (const std::string& name : from.get_snames()) option.names.push_back("-" + name);
  for (const std::string& name : from.get_lnames()) option.names.push_back("--" + name);
  option.text = short_text(from.get_description());
  option.value = value_of(from);
  option.again = from.get_items_expected_max() > 1 && from.get_delimiter() == '\0';
  if (from.get_multi_option_policy() != CLI::MultiOptionPolicy::Throw) option.again = true;
  if (option.value.most == 0) option.again = false;
  return option;
}

/// `common`: what the program takes after every command, too.
Command command_of(CLI::App& app, const std::string& path, const std::vector<Option>& common) {
  Command command;
  command.path = path;
  command.name = app.get_name();
  command.text = short_text(app.get_description());
  for (CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    if (option->nonpositional()) command.options.push_back(option_of(*option));
    if (option->get_positional()) {
      command.positionals.push_back(value_of(*option));
      command.positionals.back().most = std::min(option->get_items_expected_max(), kMany);
    }
  }
  if (app.get_parent()) {
    command.options.insert(command.options.end(), common.begin(), common.end());
  }
  for (CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (sub->get_group().empty()) continue;
    command.commands.push_back(
        command_of(*sub, path.empty() ? sub->get_name() : path + " " + sub->get_name(), common));
  }
  return command;
}

/// The description of a program, from its options.
Command program_of(CLI::App& app) {
  std::vector<Option> common;
  for (CLI::Option* option : app.get_options()) {
    if (option->get_group().empty() || !option->nonpositional()) continue;
    if (option == app.get_help_ptr() || option == app.get_version_ptr()) continue;
    if (option->check_lname("completion")) continue;
    common.push_back(option_of(*option));
  }
  return command_of(app, "", common);
}
}  // namespace

CLI::Validator value_is(ValueKind kind) {
  const char* const name = kind == ValueKind::text         ? "text"
                           : kind == ValueKind::file       ? "file"
                           : kind == ValueKind::folder     ? "folder"
                           : kind == ValueKind::printer    ? "printer"
                           : kind == ValueKind::resin      ? "resin"
                           : kind == ValueKind::definition ? "definition"
                           : kind == ValueKind::format     ? "format"
                                                           : "resin_or_file";
  return {[](std::string&) { return std::string(); }, "", std::string(kKindMark) + name};
}

CLI::Validator value_such_as(const std::vector<std::string>& words) {
  return {[](std::string&) { return std::string(); }, "",
          fmt::format("{}{{{}}}", kWordsMark, fmt::join(words, ","))};
}

const std::vector<std::string>& completion_shells() {
  static const std::vector<std::string> shells{"bash", "zsh", "fish"};
  return shells;
}

std::string completion_script(CLI::App& app, const std::string& shell) {
  const Command program = program_of(app);
  return shell == "bash"  ? completion::bash_script(program)
         : shell == "zsh" ? completion::zsh_script(program)
                          : completion::fish_script(program);
}

std::string completion_names(const std::string& kind) {
  std::set<std::string> names;
  for (const char* const one : {"printer", "resin"}) {
    if (kind != one && kind != "definition") continue;
    try {
      for (const Definition& d : list_definitions(one)) names.insert(d.name);
    } catch (const std::exception&) {  // who presses Tab wants no message
    }
  }
  std::string text;
  for (const std::string& name : names) {
    if (name.find('\n') == std::string::npos) text += name + "\n";
  }
  return text;
}

}  // namespace slicecorr::cli
