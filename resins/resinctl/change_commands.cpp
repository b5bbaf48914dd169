// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// add, history, diff, restore.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>

#include "commands.hpp"
#include "describe.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::resinctl {

namespace {

namespace fs = std::filesystem;
using namespace resins;
using cli::Console;

struct AddArguments {
  std::string definition, message, folder;
  std::vector<std::string> data;
  bool replace = false;
};

void tell(const Saved& saved, Console& console) {
  if (saved.unchanged) {
    console.say(fmt::format("{}: version {} says the same already; nothing was written", saved.path,
                            saved.version));
  } else {
    console.say(fmt::format("{}: saved as version {}{}", saved.path, saved.version,
                            saved.replaced ? "; the one before is in the history" : ""));
  }
  cli::print_result(saved.path + "\n");
}

int add(const AddArguments& a, const ExecutionContext& context, Console& console) {
  const Located at = locate(a.definition);
  Imported d = with_its_files(at.path, at.kind);
  if (!a.data.empty()) {
    if (d.kind != "resin")
      throw InputError(at.path, "", "is a printer; measurements are of resins");
    for (const std::string& w : read_measurements(a.data, context).warnings) console.say(w);
  }
  for (const std::string& csv : a.data) {
    std::ifstream in(csv, std::ios::binary);
    if (!in) throw InputError(slicecorr::detail::errno_message(csv, "can't be read"));
    std::stringstream bytes;
    bytes << in.rdbuf();
    if (!in) throw InputError(csv, "", "can't be read");
    // The definition may name it already.
    const bool known = std::any_of(d.attachments.begin(), d.attachments.end(),
                                   [&](const auto& other) { return other.bytes == bytes.str(); });
    if (known) continue;
    d.attachments.push_back({"provenance", "measurements", d.name, ".csv", bytes.str()});
  }
  const std::string folder = a.folder.empty() ? writable_folder() : a.folder;
  std::error_code ec;
  // A name without data copies a definition of another folder to one's own, to be changed there.
  const bool copy = a.data.empty() && !a.definition.ends_with(".toml") &&
                    !fs::equivalent(fs::path(at.path).parent_path(), folder, ec);
  tell(save_imported(d, folder, a.replace || copy ? Replace::keep_history : Replace::refuse,
                     a.message.empty() ? "added" : a.message),
       console);
  return cli::kDone;
}

int show_history(const std::string& name, Console&) {
  const Located at = locate(name);
  std::vector<std::vector<std::string>> rows = {{"VERSION", "SAVED", "MESSAGE", "FILE"}};
  for (const Version& v : history(at.path, at.kind)) {
    rows.push_back({fmt::format("{}{}", v.number, v.current ? " (now)" : ""),
                    v.date.empty() ? "-" : v.date, v.message.empty() ? "-" : v.message, v.path});
  }
  cli::print_result(aligned(rows));
  return cli::kDone;
}

struct DiffArguments {
  std::string name;
  int old_version = 0, new_version = 0;
};

int diff(const DiffArguments& a, Console& console) {
  const Located at = locate(a.name);
  const auto versions = history(at.path, at.kind);
  const int newer = a.new_version > 0 ? a.new_version : versions.back().number;
  int older = a.old_version;
  if (older == 0) {
    if (versions.size() < 2) {
      console.say(fmt::format("{} has one version only, {}", at.name, versions.back().number));
      return cli::kDone;
    }
    older = versions[versions.size() - 2].number;
  }
  const std::string text = difference(
      text_of_version(at.path, older, at.kind), text_of_version(at.path, newer, at.kind),
      fmt::format("{} version {}", at.name, older), fmt::format("{} version {}", at.name, newer));
  cli::print_result(text);
  if (text.empty()) console.say(fmt::format("versions {} and {} are the same", older, newer));
  return cli::kDone;
}

struct RestoreArguments {
  std::string name, message;
  int version = 0;
};

int restore(const RestoreArguments& a, Console& console) {
  const Located at = locate(a.name);
  const std::string text = text_of_version(at.path, a.version, at.kind);
  const int now = history(at.path, at.kind).back().number;
  tell(save_definition(
           cli::folder_of(at.path), fs::path(at.path).stem().string(), text, at.kind,
           Replace::keep_history,
           a.message.empty() ? fmt::format("version {} restored", a.version) : a.message, now),
       console);
  return cli::kDone;
}

}  // namespace

void add_changes(cli::Program& program) {
  const auto a = std::make_shared<AddArguments>();
  CLI::App* sub = program.add(
      "add",
      "Checks a definition and saves it with its measurements in your own database ($SLICECORR_DB, "
      "else the user's folder); prints the path.",
      [a](const ExecutionContext& context, Console& console) { return add(*a, context, console); });
  sub->add_option("DEFINITION", a->definition,
                  "A .toml file, or the name of a resin that is there: to add measurements, or to "
                  "copy it to your own database")
      ->check(cli::value_is(cli::ValueKind::resin))
      ->required();
  sub->add_option("DATA", a->data, "CSV files with measurements, kept beside the resin");
  sub->add_option("-m,--message", a->message, "Why, for the history")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("-o,--folder", a->folder, "Save into this folder instead");
  sub->add_flag("--replace", a->replace,
                "Put it in the place of one of that name, which goes to the history");

  const auto h = std::make_shared<std::string>();
  sub = program.add(
      "history", "All versions of a resin or printer, oldest first.",
      [h](const ExecutionContext&, Console& console) { return show_history(*h, console); });
  sub->add_option("NAME", *h, "Name, or path of a .toml file")
      ->check(cli::value_is(cli::ValueKind::definition))
      ->required();

  const auto d = std::make_shared<DiffArguments>();
  sub = program.add("diff", "What differs between two versions, as diff -u prints it.",
                    [d](const ExecutionContext&, Console& console) { return diff(*d, console); });
  sub->add_option("NAME", d->name, "Name, or path of a .toml file")
      ->check(cli::value_is(cli::ValueKind::definition))
      ->required();
  sub->add_option("OLD", d->old_version, "Version; without it the last but one")
      ->check(CLI::Range(1, 1000000000));
  sub->add_option("NEW", d->new_version, "Version; without it the present one")
      ->check(CLI::Range(1, 1000000000));

  const auto r = std::make_shared<RestoreArguments>();
  sub =
      program.add("restore",
                  "Makes an earlier version the present one; what stands there now stays in the "
                  "history.",
                  [r](const ExecutionContext&, Console& console) { return restore(*r, console); });
  sub->add_option("NAME", r->name, "Name, or path of a .toml file")
      ->check(cli::value_is(cli::ValueKind::definition))
      ->required();
  sub->add_option("VERSION", r->version, "Its number")
      ->required()
      ->check(CLI::Range(1, 1000000000));
  sub->add_option("-m,--message", r->message, "Why, for the history")
      ->check(cli::value_is(cli::ValueKind::text));
}

}  // namespace slicecorr::resinctl
