// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// import, export.
#include <fmt/format.h>
#include <pwd.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "describe.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
using cli::Console;
namespace fs = std::filesystem;

struct ImportArguments {
  std::string file, folder, message;
  ImportOptions options;
  bool replace = false, dry_run = false;
};

int import_file(const ImportArguments& a, Console& console) {
  std::vector<std::string> left_out;
  const auto made = import_definitions(a.file, a.options, &left_out);
  const Replace replace = a.replace ? Replace::keep_history : Replace::refuse;
  if (a.dry_run) {
    for (const Imported& d : made) cli::print_result(d.text + (made.size() > 1 ? "\n" : ""));
  } else {
    const std::string folder = a.folder.empty() ? writable_folder() : a.folder;
    // All or nothing, as far as names go.
    for (const Imported& d : made) must_be_free(folder, d, replace);
    for (const Imported& d : made) {
      const Saved saved =
          save_imported(d, folder, replace,
                        a.message.empty() ? fmt::format("imported from {}", a.file) : a.message);
      console.say(fmt::format("{} {}: {} version {}", d.kind, d.name,
                              saved.unchanged ? "the same already as" : "saved as", saved.version));
      for (const std::string& assumption : d.assumptions) console.say("  - " + assumption);
      cli::print_result(saved.path + "\n");
    }
  }
  for (const std::string& why : left_out) console.say("left out: " + why);
  console.say(fmt::format("{} made, {} left out", made.size(), left_out.size()));
  return cli::kDone;
}

struct ExportArguments {
  std::string name, format = "toml", output = "-";
  double layer_um = 0, intensity_mw_cm2 = 0;
  bool share = false;
};

std::string export_printer(const Located& at, const std::string& format) {
  const Printer printer = load_display(at.path);
  if (format == "toml") return with_its_files(at.path, at.kind).text;
  if (format == "json") return printer_json(printer, at.path) + "\n";
  if (format == "csv") {
    if (!light_is_measured(printer)) {
      throw InputError(at.path, "blue.calibration", "is " + how_to_measure_light(printer));
    }
    refuse_relative(printer, "a table");
    std::string text = "grey_level,intensity_mw_cm2\n";
    for (const CalibrationPoint& p : printer.calibration) {
      text += fmt::format("{:g},{:.10g}\n", p.level, p.intensity_mw_cm2);
    }
    return text;
  }
  throw InputError(at.path, "", "is a printer; expected --format toml, json or csv");
}

/// Names of whoever runs the program and of the computer, which nobody wants to hand in.
std::vector<std::string> private_names() {
  std::vector<std::string> names;
  const auto add = [&](const char* name) {
    if (name && *name) names.emplace_back(name);
  };
  for (const char* variable : {"USER", "LOGNAME"}) add(std::getenv(variable));
  passwd entry{};
  passwd* found = nullptr;
  std::vector<char> buffer(std::size_t{1} << 14);
  if (::getpwuid_r(::getuid(), &entry, buffer.data(), buffer.size(), &found) == 0 && found) {
    add(found->pw_name);
    // The full name; behind commas stand other things.
    const std::string about = found->pw_gecos ? found->pw_gecos : "";
    const std::string full_name = about.substr(0, about.find(','));
    for (const std::string& name : names_of_person(full_name)) add(name.c_str());
    add(fs::path(found->pw_dir ? found->pw_dir : "").filename().c_str());
  }
  const char* const home = std::getenv("HOME");
  // Without the slash that it may end with.
  add(fs::path(home ? home : "").lexically_normal().append("").parent_path().filename().c_str());
  std::array<char, 256> host{};
  if (::gethostname(host.data(), host.size() - 1) == 0) {
    const std::string whole = host.data();
    add(whole.c_str());
    add(whole.substr(0, whole.find('.')).c_str());
  }
  return names;
}

/// A measurement file beside what is handed in: there already with other bytes, it is somebody's own.
void must_be_new(const std::string& path, const std::string& bytes) {
  std::error_code ec;
  if (!fs::exists(fs::symlink_status(path, ec)) || read_text_file(path) == bytes) return;
  throw InputError(path, "",
                   "is there already and holds something else; expected another name for -o, or "
                   "another folder");
}

int share(const ExportArguments& a, const Located& at, Console& console) {
  if (a.format != "toml" || a.layer_um > 0 || a.intensity_mw_cm2 > 0) {
    throw InputError(
        "--share makes a .toml file; expected no other --format, no --layer-um and no "
        "--intensity-mw-cm2 with it");
  }
  const bool file = a.output != "-";
  if (file && !a.output.ends_with(".toml")) {
    throw InputError(a.output, "", "ends otherwise; expected the name of a .toml file");
  }
  const Shared made =
      share_definition(at.path, file ? fs::path(a.output).stem().string() : "", private_names());
  if (!made.wrong.empty()) {
    std::string text;
    for (const Finding& f : made.wrong) text += f.to_text() + "\n";
    cli::print_result(text);
    console.say(fmt::format("{} can't be handed in as it is; docs/sharing.md", at.path));
    return cli::kInput;
  }
  if (!file && !made.attachments.empty()) {
    throw InputError(at.path, "provenance.measurements",
                     "names files, which go along; expected -o FILE.toml");
  }
  if (!file) {
    cli::print_result(made.text);
  } else {
    cli::check_output(a.output, {at.path});
    const auto beside = [&](const Attachment& m) {
      return (fs::path(a.output).parent_path() / (m.stem + m.extension)).string();
    };
    for (const Attachment& m : made.attachments) must_be_new(beside(m), m.bytes);
    // The files first: the text that names them is never without them.
    for (const Attachment& m : made.attachments) {
      cli::write_text_file(beside(m), m.bytes);
      console.say(fmt::format("{}: written", beside(m)));
    }
    cli::write_text_file(a.output, made.text);
    console.say(fmt::format("{}: written; read it, then hand it in (docs/sharing.md)", a.output));
    for (const Finding& f : validate_definition(a.output)) console.say(f.to_text());
  }
  for (const std::string& what : made.left_out) console.say("left out: " + what);
  return cli::kDone;
}

int export_definition(const ExportArguments& a, Console& console) {
  const Located at = locate(a.name);
  if (a.share) return share(a, at, console);
  const std::string text = at.kind == "printer" ? export_printer(at, a.format)
                                                : export_record(load_record(at.path), a.format,
                                                                a.layer_um, a.intensity_mw_cm2);
  if (a.output == "-") {
    cli::print_result(text);
  } else {
    cli::check_output(a.output, {at.path});
    cli::write_text_file(a.output, text);
    console.say(fmt::format("{}: written", a.output));
  }
  return cli::kDone;
}

}  // namespace

void add_exchange(cli::Program& program) {
  const auto i = std::make_shared<ImportArguments>();
  CLI::App* sub = program.add(
      "import",
      "Makes definitions of foreign files and saves them in your own database: profiles of "
      "PrusaSlicer, UVtools and others, Anycubic's resin profiles, print files (GOO, CTB and others), tables of Dp and Ec, measured "
      "calibrations, lookup tables and flat-fields of printers. Says what it assumed, also in the "
      "files.",
      [i](const ExecutionContext&, Console& console) { return import_file(*i, console); });
  sub->add_option("FILE", i->file, "What to import")->required();
  sub->add_option("--format", i->options.format, "What FILE is")
      ->check(
          CLI::IsMember({"auto", "prusaslicer", "uvtools", "anycubic", "table", "calibration",
                         "uv-calibration", "lut", "flat-field", "correction-mask", "print-file"}))
      ->capture_default_str();
  sub->add_option("--only", i->options.only, "Only presets whose name holds this")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--name", i->options.name, "Name of the result, when there is one")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--intensity-mw-cm2", i->options.intensity_mw_cm2,
                  "Of the printer a profile is for, at the window: turns its times into doses; of "
                  "full light, where a calibration or lookup table is relative")
      ->check(cli::number_above_zero());
  sub->add_option("--wavelength-nm", i->options.wavelength_nm,
                  "Of the light, where FILE does not say")
      ->check(cli::number_in(100, 2000, true));
  sub->add_option("--height-um", i->options.height_um,
                  "Absorbance height, base e, where a profile with one layer height can't give it")
      ->check(cli::number_above_zero());
  sub->add_option("--printer", i->options.printer,
                  "Printer that a calibration, lookup table or flat-field belongs to");
  sub->add_option("--frame", i->options.frame,
                  "flat-field: its picture or readings lie like the plate, or like the display's "
                  "images [readings: the plate; pictures: as their shape says]")
      ->check(CLI::IsMember({"plate", "image"}));
  sub->add_option(
         "--calibrated-at-mm", i->options.calibrated_at_mm,
         "flat-field of readings: X,Y of the place where the calibration was measured [the "
         "brightest]")
      ->delimiter(',')
      ->expected(2)
      ->check(cli::number_in(-1e4, 1e4));
  sub->add_option("-m,--message", i->message, "Why, for the history")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("-o,--folder", i->folder, "Save into this folder instead");
  sub->add_flag("--replace", i->replace,
                "Put them in the place of those of the same name, which go to the history");
  sub->add_flag("--dry-run", i->dry_run, "Print the definitions instead of saving them");

  const auto e = std::make_shared<ExportArguments>();
  sub = program.add(
      "export", "One resin (or printer) for other programs.",
      [e](const ExecutionContext&, Console& console) { return export_definition(*e, console); });
  sub->add_option("NAME", e->name, "Name, or path of a .toml file")
      ->check(cli::value_is(cli::ValueKind::definition))
      ->required();
  sub->add_option("--format", e->format,
                  "toml, json, csv (a table that import reads), prusaslicer (a material)")
      ->check(CLI::IsMember({"toml", "json", "csv", "prusaslicer"}))
      ->capture_default_str();
  sub->add_flag(
      "--share", e->share,
      "A file for others (docs/sharing.md): checked, with all that a reader needs to judge "
      "it, without comments, paths, addresses and names of users and computers");
  sub->add_option("--layer-um", e->layer_um, "Slice height, for prusaslicer")
      ->check(cli::number_in(1, 1000));
  sub->add_option("--intensity-mw-cm2", e->intensity_mw_cm2,
                  "Of the printer at the window, for prusaslicer")
      ->check(cli::number_above_zero());
  sub->add_option("-o,--output", e->output, "File to write, - for stdout")->capture_default_str();
}

}  // namespace slicecorr::resinctl
