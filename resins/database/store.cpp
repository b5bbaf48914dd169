// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Saving definitions, and their history.
//
// Order of a change, under the folder's lock: the present text goes to .history/NAME/VERSION.toml,
// a line about the new version to .history/NAME/log, then the new text is renamed into place. A
// kill before the rename leaves the present file with a copy of itself in the history and a line
// about a version that is not there; readers know both and the next change repeats them.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <map>
#include <sstream>

#include "database/files.hpp"
#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/database.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

constexpr int kGreatestVersion = 1000000000;

/// Version that a text says it is; 1 when it says nothing, nothing when it can't be read.
std::optional<int> version_in(const std::string& text) {
  const auto root = try_toml(text);
  if (!root) return std::nullopt;
  const toml::node* node = root->get("version");
  if (!node) return 1;
  const auto* whole = node->as_integer();
  if (!whole || **whole < 1 || **whole > kGreatestVersion) return std::nullopt;
  return static_cast<int>(**whole);
}

fs::path history_folder(const fs::path& folder, const std::string& name) {
  return folder / ".history" / name;
}

/// Numbers of the versions kept in the history.
std::vector<int> kept_versions(const fs::path& folder) {
  std::vector<int> numbers;
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator(folder, ec)) {
    const fs::path& path = entry.path();
    const std::string stem = path.stem().string();
    const bool digits = !stem.empty() && stem.size() < 10 && stem[0] != '0' &&
                        stem.find_first_not_of("0123456789") == std::string::npos;
    if (path.extension() == ".toml" && digits) numbers.push_back(std::stoi(stem));
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

struct LogLine {
  std::string date, message;
};
/// Lines "VERSION <tab> DATE <tab> MESSAGE"; the last one about a version counts.
std::map<int, LogLine> read_log(const fs::path& path) {
  std::map<int, LogLine> lines;
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) return lines;
  std::istringstream in(read_text_file(path.string()));
  for (std::string line; std::getline(in, line);) {
    const std::size_t first = line.find('\t');
    const std::size_t second = first == std::string::npos ? first : line.find('\t', first + 1);
    if (second == std::string::npos) continue;
    const int number = std::atoi(line.c_str());
    if (number < 1) continue;
    lines[number] = {line.substr(first + 1, second - first - 1), line.substr(second + 1)};
  }
  return lines;
}

std::string now_utc() {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr)));
}

std::string one_line(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  }
  return text;
}

void check_text(const std::string& text, const std::string& path, std::string_view kind) {
  std::string errors;
  for (const Finding& f : validate_text(text, path, kind)) {
    if (f.warning) continue;
    if (!errors.empty()) errors += '\n';
    errors += f.to_text();
  }
  if (!errors.empty()) throw InputError(errors);
}

void check_name(const std::string& name, std::string_view kind) {
  if (is_stable_name(name)) return;
  throw InputError(fmt::format(
      "'{}' is no {} name; expected at most 100 lower case letters, digits, '-', '.', '_', a "
      "letter or digit first",
      name, kind));
}

/// What stands at a path, if anything does.
std::optional<std::string> present_text(const fs::path& path) {
  std::error_code ec;
  if (!fs::exists(fs::symlink_status(path, ec))) return std::nullopt;
  return read_text_file(path.string());
}

}  // namespace

std::string writable_folder() {
  const char* own = std::getenv("SLICECORR_DB");
  std::string folder = own && *own ? own : user_definition_folder();
  if (folder.empty()) {
    throw InputError("no folder to write to; expected $SLICECORR_DB, $XDG_CONFIG_HOME or $HOME");
  }
  make_folder(folder);
  return folder;
}

Saved save_definition(const std::string& folder, const std::string& name, const std::string& text,
                      std::string_view kind, Replace replace, const std::string& message,
                      std::optional<int> expected_version) {
  check_name(name, kind);
  const fs::path path = fs::path(folder) / (name + ".toml");
  check_text(text, path.string(), kind);

  const FolderLock lock(folder);
  const fs::path kept = history_folder(folder, name);
  const std::vector<int> numbers = kept_versions(kept);
  const int greatest = numbers.empty() ? 0 : numbers.back();
  const auto present = present_text(path);

  Saved saved;
  saved.path = path.string();
  saved.replaced = present.has_value();
  if (const auto is = kind_of_definition(path.string()); present && is && *is != kind) {
    throw InputError(path.string(), "", fmt::format("is a {}; expected another name", *is));
  }
  int present_version = greatest;
  bool edited_by_hand = false;
  if (present) {
    const auto said = version_in(*present);
    present_version = said.value_or(greatest + 1);
    // A number that the history gave to another text: the file was changed by hand since.
    if (said && *said <= greatest) {
      const fs::path same = kept / fmt::format("{}.toml", *said);
      std::error_code ec;
      if (!fs::exists(same, ec) || read_text_file(same.string()) != *present) {
        present_version = greatest + 1;
      }
    }
    edited_by_hand = present_version != said;
    if (expected_version && *expected_version != said.value_or(0)) {
      throw InputError(path.string(), "",
                       fmt::format("is version {} now, not {}; someone else changed it meanwhile",
                                   said.value_or(0), *expected_version));
    }
    if (said && !edited_by_hand) {
      TomlEdit same(text, path.string());
      same.set("", "version", std::to_string(*said));
      TomlEdit old(*present, path.string());
      old.set("", "version", std::to_string(*said));
      if (same.text() == old.text()) {
        saved.version = *said;
        saved.replaced = false;
        saved.unchanged = true;
        return saved;
      }
    }
    if (replace == Replace::refuse) {
      throw InputError(path.string(), "",
                       "is there already; ask to replace it, and its text goes to the history");
    }
  } else if (expected_version && *expected_version != 0) {
    throw InputError(path.string(), "",
                     fmt::format("is not there; expected version {}", *expected_version));
  }

  saved.version = std::max(present_version, greatest) + 1;
  TomlEdit numbered(text, path.string());
  numbered.set("", "version", std::to_string(saved.version));

  // A first version without a word about it needs no history.
  if (present || !numbers.empty() || !message.empty()) make_folder(kept.string());
  if (present) {
    write_durably((kept / fmt::format("{}.toml", present_version)).string(), *present);
    if (edited_by_hand) {
      append_line_durably((kept / "log").string(),
                          fmt::format("{}\t{}\tchanged by hand", present_version, now_utc()));
    }
  }
  if (present || !numbers.empty() || !message.empty()) {
    append_line_durably((kept / "log").string(),
                        fmt::format("{}\t{}\t{}", saved.version, now_utc(), one_line(message)));
  }
  write_durably(path.string(), numbered.text());
  return saved;
}

std::string save_beside(const std::string& folder, const std::string& name,
                        const std::string& extension, const std::string& bytes) {
  check_name(name, "file");
  const FolderLock lock(folder);
  for (int n = 1;; ++n) {
    std::string file = fmt::format("{}{}{}", name, n > 1 ? fmt::format("-{}", n) : "", extension);
    const fs::path path = fs::path(folder) / file;
    const auto present = present_text(path);
    if (present && *present == bytes) return file;
    if (present) continue;
    write_durably(path.string(), bytes);
    return file;
  }
}

std::string save_measurements(const std::string& folder, const std::string& name,
                              const std::string& csv_path) {
  return save_beside(folder, name, ".csv", read_text_file(csv_path));
}

std::vector<Version> history(const std::string& name, std::string_view kind) {
  const fs::path path = find_definition(name, kind);
  const fs::path kept = history_folder(path.parent_path(), path.stem().string());
  const auto log = read_log(kept / "log");
  const auto describe = [&](Version v) {
    if (const auto at = log.find(v.number); at != log.end()) {
      v.date = at->second.date;
      v.message = at->second.message;
    }
    return v;
  };
  const std::string present = read_text_file(path.string());
  const std::vector<int> numbers = kept_versions(kept);
  const int now = version_in(present).value_or(numbers.empty() ? 1 : numbers.back() + 1);
  std::vector<Version> versions;
  for (const int number : numbers) {
    const fs::path file = kept / fmt::format("{}.toml", number);
    // A change that was killed leaves a copy of the present text.
    if (number == now && read_text_file(file.string()) == present) continue;
    versions.push_back(describe({number, "", "", file.string(), false}));
  }
  versions.push_back(describe({now, "", "", path.string(), true}));
  return versions;
}

std::string text_of_version(const std::string& name, int number, std::string_view kind) {
  std::string known;
  const auto versions = history(name, kind);
  // From the end: the present text counts where a file changed by hand took a number twice.
  for (auto v = versions.rbegin(); v != versions.rend(); ++v) {
    if (v->number == number) return read_text_file(v->path);
    known = std::to_string(v->number) + (known.empty() ? "" : ", ") + known;
  }
  throw InputError(fmt::format("{} has no version {}; known versions: {}", name, number, known));
}

}  // namespace slicecorr::resins
