// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Saving definitions together with the files that they name.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>

#include "database/record_text.hpp"
#include "database/toml_edit.hpp"
#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

/// The text with another version number, to compare texts without it.
std::string without_version(const std::string& text) {
  TomlEdit edit(text, "");
  edit.remove("", "version");
  return edit.text();
}

/// A definition of that name that one in `folder` would hide, where names are looked up there.
std::optional<Definition> hidden_by(const std::string& folder, const std::string& name) {
  std::error_code ec;
  if (fs::exists(fs::path(folder) / (name + ".toml"), ec)) return std::nullopt;
  bool looked_up = false;
  for (const char* kind : {"resin", "printer"}) {
    for (const std::string& f : definition_folders(kind)) {
      looked_up = looked_up || fs::equivalent(f, folder, ec);
    }
  }
  if (!looked_up) return std::nullopt;
  for (const char* kind : {"resin", "printer"}) {
    for (const Definition& d : list_definitions(kind)) {
      if (d.name == name && !fs::equivalent(fs::path(d.path).parent_path(), folder, ec)) return d;
    }
  }
  return std::nullopt;
}

/// A list of names for provenance.measurements, each once.
std::string measurement_list(const std::vector<std::string>& saved) {
  std::vector<std::string> all;
  for (const std::string& name : saved) {
    if (std::find(all.begin(), all.end(), name) == all.end()) all.push_back(name);
  }
  return toml_texts(all);
}

/// Saves the attachments and names them in the text.
std::string place_files(const Imported& d, const std::string& folder) {
  TomlEdit edit(d.text, d.name + ".toml");
  std::vector<std::string> measurements;
  for (const Attachment& a : d.attachments) {
    const std::string file = save_beside(folder, a.stem, a.extension, a.bytes);
    if (a.key == "measurements") {
      measurements.push_back(file);
    } else {
      edit.set(a.table, a.key, toml_text(file));
    }
  }
  if (!measurements.empty()) {
    edit.set("provenance", "measurements", measurement_list(measurements));
  }
  return edit.text();
}

}  // namespace

Imported with_its_files(const std::string& path, const std::string& kind) {
  Imported d;
  d.kind = kind;
  d.text = read_text_file(path);
  const toml::table root = parse_toml(d.text, path);
  const std::string stem = fs::path(path).stem().string();
  d.name = root["name"].value_or(stem);
  const auto attach = [&](const char* table, const char* key, const std::string& file) {
    const fs::path beside = fs::path(path).parent_path() / file;
    std::error_code ec;
    if (!fs::is_regular_file(beside, ec)) {
      throw InputError(path, fmt::format("{}.{}", table, key),
                       fmt::format("{} is not there; expected the file beside this one", file));
    }
    d.attachments.push_back({table, key, fs::path(file).stem().string(),
                             fs::path(file).extension().string(), read_text_file(beside.string())});
  };
  if (const toml::node* node = root["provenance"]["measurements"].node(); node && kind == "resin") {
    for (const std::string& file : csv_names(*node)) attach("provenance", "measurements", file);
  }
  for (const auto& [table, key] : {std::pair{"display", "flat_field"},
                                   {"display", "distortion"},
                                   {"blue", "calibration"},
                                   {"blue", "spread"},
                                   {"uv", "calibration"},
                                   {"uv", "flat_field"},
                                   {"uv", "spread"},
                                   {"rotation", "wobble"}}) {
    if (const auto file = root[table][key].value<std::string>();
        file && kind == "printer" && *file != kToBeMeasured) {
      attach(table, key, *file);
    }
  }
  // Beside a definition all files bear its name or one that is stable.
  for (Attachment& a : d.attachments) {
    const std::string stable = stable_name_of(a.stem);
    a.stem = stable.empty() ? d.name : stable;
  }
  return d;
}

void must_be_free(const std::string& folder, const Imported& d, Replace replace) {
  if (replace == Replace::keep_history) return;
  const fs::path path = fs::path(folder) / (d.name + ".toml");
  std::error_code ec;
  if (fs::exists(path, ec)) {
    bool same = false;
    try {
      same = without_version(read_text_file(path.string())) == without_version(d.text);
    } catch (const InputError&) {
      // What can't be read is another text.
    }
    if (same) return;
    throw InputError(path.string(), "",
                     "is there already; --replace puts the new text in its place and keeps the old "
                     "one in the history, --name gives the new one another name");
  }
  if (const auto other = hidden_by(folder, d.name)) {
    throw InputError(other->path, "",
                     fmt::format("is a {} of the same name, which this one would hide; --replace "
                                 "does so and keeps its text in the history, --name gives the new "
                                 "one another name",
                                 d.kind));
  }
}

Saved save_imported(const Imported& d, const std::string& folder, Replace replace,
                    const std::string& message) {
  must_be_free(folder, d, replace);
  if (const auto other = hidden_by(folder, d.name)) {
    const Imported old = with_its_files(other->path, d.kind);
    save_definition(folder, d.name, place_files(old, folder), d.kind, Replace::refuse,
                    "as in " + other->path);
  }
  return save_definition(folder, d.name, place_files(d, folder), d.kind, replace, message);
}

}  // namespace slicecorr::resins
