// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo_targets.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "support/files/lasting_folder.hpp"
#include "target_page.hpp"

namespace slicecorr::cli {

namespace {

namespace fs = std::filesystem;

tomo::TargetKind kind_named(const std::string& name) {
  if (name == "focus") return tomo::TargetKind::focus;
  if (name == "scale") return tomo::TargetKind::scale;
  if (name == "direction") return tomo::TargetKind::direction;
  if (name == "light") return tomo::TargetKind::light;
  if (name == "dose") return tomo::TargetKind::dose;
  if (name == "threshold") return tomo::TargetKind::threshold;
  return tomo::TargetKind::axis;
}

int target(const TomoTargetOptions& o, const ExecutionContext& context, Console& console) {
  const Printer printer = load_printer(o.printer);
  tell_unread(printer.unread, context);
  const tomo::TargetKind kind = kind_named(o.kind);
  const auto pictures = tomo::target_pictures(kind, printer);
  const fs::path folder = o.output.empty() ? fs::path(".") : fs::path(o.output);
  std::error_code ec;
  slicecorr::detail::make_lasting_folder(folder.string(), ec);
  if (!fs::is_directory(folder)) {
    throw DeviceError(folder.string() + " can't be made; expected a folder for the pictures");
  }
  std::string names;
  for (const tomo::TargetPicture& p : pictures) {
    const auto png = encode_png(p.image);
    const std::string path = (folder / (p.name + ".png")).string();
    write_text_file(path, std::string(png.begin(), png.end()));
    names += (names.empty() ? "" : ", ") + p.name + ".png";
  }
  const std::string page = (folder / (o.kind + ".html")).string();
  write_text_file(page, target_page(kind, printer, pictures));
  console.say(fmt::format("{}: what to do; {}: to show", page, names));
  return kDone;
}

}  // namespace

void add_tomo_targets(Program& program, CLI::App* group, TomoTargetOptions& o) {
  CLI::App* sub = program.add_to(
      group, "target",
      "Make pictures to show, and a page that says how to set the printer up by them",
      [&o](const ExecutionContext& context, Console& console) {
        return target(o, context, console);
      });
  sub->add_option("KIND", o.kind,
                  "axis: offset, tilt and wobble; focus; scale: pixels and distance; direction: of "
                  "the stage; light: levels and flat-field; dose: of resin by light and time; "
                  "threshold: light below which it never gels")
      ->required()
      ->check(CLI::IsMember({"axis", "focus", "scale", "direction", "light", "dose", "threshold"}));
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("-o,--output", o.output, "Folder for the pictures and the page [this one]")
      ->check(value_is(ValueKind::folder));
}

}  // namespace slicecorr::cli
