// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// show, validate.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>

#include "commands.hpp"
#include "describe.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/plots.hpp"
#include "slicecorr/same_light.hpp"

namespace slicecorr::resinctl {

namespace {

namespace fs = std::filesystem;
using namespace resins;
using cli::Console;

struct ShowArguments {
  std::string name, json, html, resin;
};

int show(const ShowArguments& a, const ExecutionContext& context, Console& console) {
  const Located at = locate(a.name);
  if (at.kind == "printer") {
    if (!a.html.empty()) throw InputError(at.path, "", "is a printer; --html is for resins");
    const Printer printer = load_display(at.path);
    std::optional<Resin> resin;
    if (!a.resin.empty()) {
      if (!printer.vial && !load_beam_vat(at.path, printer)) {
        throw InputError(
            at.path, "vial",
            "is missing, and [beams], too; --resin is for a vial, or a vat with beams");
      }
      resin = load_resin(a.resin);
      for (const std::string& text : light_notices(printer, *resin, false)) console.say(text);
    }
    if (a.json.empty()) {
      cli::print_result(describe_printer(printer, at.path, resin ? &*resin : nullptr));
    } else {
      cli::check_output(a.json, {at.path});
      cli::print_or_write(a.json, printer_json(printer, at.path));
    }
    return cli::kDone;
  }
  if (!a.resin.empty()) throw InputError(at.path, "", "is a resin; --resin is for printers");
  const ResinRecord record = load_record(at.path);
  if (!a.json.empty()) {
    cli::check_output(a.json, {at.path});
    std::string json = export_record(record, "json", 0, 0);
    json.pop_back();
    cli::print_or_write(a.json, json);
  } else if (a.html.empty()) {
    cli::print_result(describe_resin(record));
  }
  if (!a.html.empty()) {
    cli::check_output(a.html, {at.path});
    const RecordFits fits = fits_of_record(record, context);
    for (const std::string& problem : fits.problems) console.say(problem);
    cli::write_text_file(a.html, resin_page(record, fits.fits, history(at.path, at.kind)));
    console.say(fmt::format("{}: written", a.html));
  }
  return cli::kDone;
}

struct ValidateArguments {
  std::vector<std::string> files;
  std::string schema;
};

int validate(const ValidateArguments& a, const ExecutionContext&, Console& console) {
  if (!a.schema.empty()) {
    if (!a.files.empty()) throw InputError("--schema prints the schema; expected no FILE with it");
    cli::print_result(schema_table(a.schema));
    return cli::kDone;
  }
  std::vector<std::string> files;
  for (const std::string& given : a.files) {
    std::error_code ec;
    if (given.ends_with(".toml") || fs::exists(given, ec)) {
      files.push_back(given);
    } else {
      files.push_back(locate(given).path);
    }
  }
  if (a.files.empty()) files = all_definition_files();
  std::size_t errors = 0, warnings = 0;
  std::string text;
  for (const std::string& file : files) {
    for (const Finding& f : validate_definition(file)) {
      (f.warning ? warnings : errors) += 1;
      text += f.to_text() + "\n";
    }
  }
  cli::print_result(text);
  console.say(fmt::format("{} file{}, {} error{}, {} warning{}", files.size(),
                          files.size() == 1 ? "" : "s", errors, errors == 1 ? "" : "s", warnings,
                          warnings == 1 ? "" : "s"));
  return errors > 0 ? cli::kInput : cli::kDone;
}

}  // namespace

void add_database(cli::Program& program) {
  const auto s = std::make_shared<ShowArguments>();
  CLI::App* sub =
      program.add("show",
                  "One resin or printer: figures in all units, what correction aims at, where "
                  "the figures come from.",
                  [s](const ExecutionContext& context, Console& console) {
                    return show(*s, context, console);
                  });
  sub->add_option("NAME", s->name, "Name, or path of a .toml file")
      ->check(cli::value_is(cli::ValueKind::definition))
      ->required();
  sub->add_option("--json", s->json, "Write JSON to this file, - for stdout");
  sub->add_option(
      "--resin", s->resin,
      "For a tomographic printer, or one with beams: the resin for whose light it is told");
  sub->add_option("--html", s->html, "Write a page with figures, history and pictures of its fits");

  const auto v = std::make_shared<ValidateArguments>();
  sub = program.add("validate",
                    "Checks definition files and prints what is wrong as FILE:LINE: KEY: MESSAGE. "
                    "Exit code 2 when there is an error; warnings alone are no error.",
                    [v](const ExecutionContext& context, Console& console) {
                      return validate(*v, context, console);
                    });
  sub->add_option("FILE", v->files, "Files or names; without any the whole database")
      ->check(cli::value_is(cli::ValueKind::definition));
  sub->add_option("--schema", v->schema, "Print what a resin or printer file may hold")
      ->check(CLI::IsMember({"resin", "printer"}));

  add_changes(program);
  add_exchange(program);
  add_new_printer(program);
}

}  // namespace slicecorr::resinctl
