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
    throw InputError(file.path, "",
                     of_format +
                         " are only changed, not made from nothing; expected a file of the "
                         "same printer as the template, or a format that can be made new");
  }
  if (uneven && !format.says_heights()) {
    throw InputError(file.path, "",
                     of_format +
                         " can't say that layers are of different heights; expected a format "
                         "that can, as GOO, CTB or UVJ");
  }
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
