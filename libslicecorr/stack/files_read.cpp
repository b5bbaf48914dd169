// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Which files can be made, and which of them a printer reads, as its own file says.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/process.hpp"
#include "stack/formats/archive_format.hpp"
#include "support/files/text_file.hpp"
#include "support/text/ascii.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

bool keeps_settings(const std::string& path, const StackInfo& info) {
  return info.kind == StackKind::foreign || !print_file_facts(path).empty();
}

void check_can_be_made(const StackFile& file, bool uneven) {
  if (!file.keep_from.empty()) return;
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  const std::string of_format = fmt::format("files of the format {}", format.name());
  if (!format.made_new()) {
    throw InputError(
        file.path, "",
        of_format +
            " are only changed, not made from nothing; expected a format that can be "
            "made new, or three steps: slice the part into UVJ, convert that with a file "
            "of the printer's own slicer as the template, and correct the result");
  }
  if (uneven && !format.says_heights()) {
    throw InputError(file.path, "",
                     of_format +
                         " can't say that layers are of different heights; expected a format "
                         "that can, as GOO, CTB or UVJ");
  }
}

namespace {

detail::PrintersLift lift_of(const std::string& format) {
  for (const detail::ArchiveFormat* f : detail::all_archive_formats()) {
    if (f->name() == format) return f->printers_lift();
  }
  return detail::PrintersLift::not_known;
}

}  // namespace

bool printers_always_lift(const std::string& format) {
  return lift_of(format) == detail::PrintersLift::always;
}

void check_lifts(const StackFile& file, const Process& process, bool said, ChoiceNames names) {
  if (said || process.mode != ExposureMode::continuous) return;
  const std::string format = format_of(file);
  if (!printers_always_lift(format)) return;
  throw InputError(
      file.path, "",
      fmt::format(
          "printers that read files of the format {} lift after each layer; expected no {}, but {} "
          "layerwise; {} continuous only where the platform does not lift",
          format, setting_name(names, "speed_mm_h"), setting_name(names, "mode"),
          setting_name(names, "mode")));
}

std::string holds_without_lifts(const std::string& format, const Process& process) {
  const detail::PrintersLift lift = lift_of(format);
  if (lift == detail::PrintersLift::not_known || process.mode != ExposureMode::continuous)
    return {};
  return fmt::format(
      "All this holds only where the platform moves while slices are shown: printers that read files of the "
      "format {} lift after each layer{}.",
      format, lift == detail::PrintersLift::always ? "" : " as a rule");
}

std::string doubted_grey_in_words(const std::string& printer) {
  const std::string path = find_definition(printer, "printer");
  const toml::table table = parse_toml(read_text_file(path), path);
  const TomlTable root(table, path);
  const std::string grey = root.required_table("display").text("grey", "shown");
  if (grey != "said to be none") return {};
  return fmt::format(
      "printer '{}' is said to show no grey at all (its file: [display] grey): then greys of a correction come "
      "out black or white, and nothing that is told of the print holds. Look first: slicecorr testpart levels "
      "shows its levels one after the other",
      root.text("name", printer));
}

std::vector<std::string> endings_read_by(const std::string& printer) {
  const std::string path = find_definition(printer, "printer");
  const toml::table table = parse_toml(read_text_file(path), path);
  const TomlTable root(table, path);
  const toml::node* const reads = table.get("reads");
  if (!reads) return {};
  const auto wrong = [&] { root.fail("reads", "expected endings of files, as [\".ctb\"]"); };
  const toml::array* const list = reads->as_array();
  if (!list || list->empty()) wrong();
  std::vector<std::string> endings;
  for (const toml::node& one : *list) {
    const auto ending = one.value<std::string>();
    if (!ending || ending->size() < 2 || ending->front() != '.') wrong();
    endings.push_back(lower_case(*ending));
  }
  return endings;
}

std::string not_read_in_words(const std::string& printer, const StackFile& file) {
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  if (&format == &detail::uvj_format() || !file.keep_from.empty()) return {};
  const std::vector<std::string> read = endings_read_by(printer);
  if (read.empty()) return {};
  const std::string name = lower_case(std::filesystem::path(file.path).filename().string());
  const auto ends = [&](std::string_view ending) { return name.ends_with(ending); };
  if (std::any_of(read.begin(), read.end(), ends)) return {};
  const std::vector<std::string_view> of_format = format.endings();
  // A name without an ending of the format may be given one of the printer's.
  const bool named_otherwise = std::none_of(of_format.begin(), of_format.end(), ends);
  const bool same_format = std::any_of(read.begin(), read.end(), [&](const std::string& ending) {
    return std::find(of_format.begin(), of_format.end(), ending) != of_format.end();
  });
  if (named_otherwise && same_format) return {};
  return fmt::format("is a file of the format {}, and printer '{}' reads {}", format.name(),
                     printer, fmt::join(read, ", "));
}

void check_read_by(const std::string& printer, const StackFile& file) {
  const std::string words = not_read_in_words(printer, file);
  if (words.empty()) return;
  throw InputError(file.path, "",
                   words +
                       " (reads); expected one of these, UVJ to be converted, or a file of its "
                       "slicer whose settings stay");
}

}  // namespace slicecorr
