// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// list, show, validate.
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "commands.hpp"
#include "describe.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/plots.hpp"
#include "slicecorr/same_light.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::resinctl {

namespace {

namespace fs = std::filesystem;
using namespace resins;
using cli::Console;
using nlohmann::ordered_json;

struct ListArguments {
  std::vector<std::string> words;
  std::string maker, chemistry, height_um, json;
  double wavelength_nm = 0;
  bool printers = false;
};

/// LOW:HIGH; either side may be empty.
void set_heights(const std::string& text, Query& query) {
  if (text.empty()) return;
  const std::size_t colon = text.find(':');
  const auto side = [&](const std::string& part) -> std::optional<double> {
    if (part.empty()) return std::nullopt;
    const auto value = cli::number_of(part);
    if (!value || *value < 0) {
      throw InputError(fmt::format(
          "--height-um {}: expected LOW:HIGH, such as 100:300 or :50, in um, base e", text));
    }
    return value;
  };
  if (colon == std::string::npos) side("-");
  query.least_height_um = side(text.substr(0, colon));
  query.greatest_height_um = side(text.substr(colon + 1));
  if (query.least_height_um && query.greatest_height_um &&
      *query.least_height_um > *query.greatest_height_um) {
    throw InputError(fmt::format("--height-um {}: LOW is above HIGH", text));
  }
}

/// Where stdout is a terminal too narrow for the rows, without their last columns: first the file.
std::vector<std::vector<std::string>> fitting(std::vector<std::vector<std::string>> rows,
                                              Console& console) {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return rows;
  const auto widest = [&] {
    const std::string text = aligned(rows);
    std::size_t most = 0;
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      most = std::max(most, end - at);
      at = end + 1;
    }
    return most;
  };
  const std::size_t all = rows.front().size();
  while (rows.front().size() > 2 && widest() > size.ws_col) {
    for (auto& row : rows) row.pop_back();
  }
  if (rows.front().size() < all) {
    console.say("(the window is too narrow for all columns; --json - has them)");
  }
  return rows;
}

void put_list(const std::string& json, const ordered_json& list,
              const std::vector<std::vector<std::string>>& rows, const char* what,
              Console& console) {
  if (json.empty()) {
    cli::print_result(aligned(fitting(rows, console)));
  } else {
    cli::print_or_write(json, list.dump(2));
  }
  const std::size_t n = rows.size() - 1;
  console.say(fmt::format("{} {}{}", n, what, n == 1 ? "" : "s"));
}

int list_printers(const ListArguments& a, const std::string& words, Console& console) {
  if (!a.maker.empty() || !a.chemistry.empty() || !a.height_um.empty()) {
    throw InputError("--maker, --chemistry and --height-um are for resins");
  }
  std::vector<std::vector<std::string>> rows = {
      {"NAME", "PIXELS", "UM", "NM", "MW/CM²", "UV MW/CM²", "VIAL MM", "FILE"}};
  auto list = ordered_json::array();
  for (const Definition& d : list_definitions("printer")) {
    try {
      const Printer p = load_display(d.path);
      std::istringstream in(words);
      bool fits = a.wavelength_nm == 0 ||
                  (p.wavelength_nm > 0 && same_light(p.wavelength_nm, a.wavelength_nm));
      for (std::string word; in >> word;) fits = fits && d.name.find(word) != std::string::npos;
      if (!fits) continue;
      rows.push_back(
          {d.name, fmt::format("{} x {}", p.width_px, p.height_px),
           p.pixel_x_um == p.pixel_y_um ? fmt::format("{:g}", p.pixel_x_um)
                                        : fmt::format("{:g} x {:g}", p.pixel_x_um, p.pixel_y_um),
           p.wavelength_nm > 0 ? fmt::format("{:g}", p.wavelength_nm) : "-",
           light_is_measured(p)
               ? fmt::format("{:g} to {:g}{}", p.calibration.front().intensity_mw_cm2,
                             p.calibration.back().intensity_mw_cm2,
                             is_relative(p) ? fmt::format(" {}", unit_of_light(p.unit)) : "")
               : std::string(kToBeMeasured),
           p.uv ? fmt::format("{:g} to {:g}", p.uv->min_mw_cm2(), p.uv->max_mw_cm2()) : "-",
           p.vial ? fmt::format("{:g}", 2 * p.vial->inner_mm) : "-", d.path});
      list.push_back(slicecorr::detail::own_json<nlohmann::ordered_json>(printer_json(p, d.path)));
    } catch (const Error& e) {
      console.say(e.what());
    }
  }
  put_list(a.json, list, rows, "printer", console);
  return cli::kDone;
}

int list(const ListArguments& a, const ExecutionContext&, Console& console) {
  std::string words;
  for (const std::string& word : a.words) words += word + " ";
  if (a.printers) return list_printers(a, words, console);
  Query query;
  query.words = words;
  query.maker = a.maker;
  query.chemistry = a.chemistry;
  if (a.wavelength_nm > 0) query.wavelength_nm = a.wavelength_nm;
  set_heights(a.height_um, query);
  std::vector<Finding> problems;
  std::vector<std::vector<std::string>> rows = {
      {"NAME", "MAKER", "NM", "H UM (E)", "H UM (10)", "GEL DOSE", "AIM", "FILE"}};
  auto list = ordered_json::array();
  for (const ResinRecord& r : find_records(query, &problems)) {
    const ResinFigures f = figures_of(r.resin);
    rows.push_back({r.name, r.maker.empty() ? "-" : r.maker,
                    r.wavelength_nm > 0 ? fmt::format("{:g}", r.wavelength_nm) : "-",
                    fmt::format("{:.4g}", f.height_e_um), fmt::format("{:.4g}", f.height10_um),
                    gel_dose_text(r), aim_text(r), r.path});
    list.push_back(
        slicecorr::detail::own_json<nlohmann::ordered_json>(export_record(r, "json", 0, 0)));
  }
  put_list(a.json, list, rows, "resin", console);
  for (const Finding& p : problems) console.say(p.message);
  return cli::kDone;
}

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
  const auto l = std::make_shared<ListArguments>();
  CLI::App* sub = program.add(
      "list", "Resins (or printers) of the database, one a line, with gel dose and aim.",
      [l](const ExecutionContext& context, Console& console) {
        return list(*l, context, console);
      });
  sub->add_option("WORDS", l->words,
                  "All of them must occur in name, maker, product, chemistry, colour or notes")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--maker", l->maker, "Part of the maker's name")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--chemistry", l->chemistry, "Part of the chemistry")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--wavelength-nm", l->wavelength_nm, "Curing light within 10 nm of this")
      ->check(cli::number_above_zero());
  sub->add_option("--height-um", l->height_um,
                  "LOW:HIGH, absorbance height in base e; either may be left out")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_flag("--printers", l->printers, "Printers instead");
  sub->add_option("--json", l->json, "Write JSON to this file, - for stdout");

  const auto s = std::make_shared<ShowArguments>();
  sub = program.add("show",
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
