// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <cctype>
#include <cmath>
#include <filesystem>
#include <set>
#include <string_view>

#include "database/schema.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/search.hpp"
#include "slicecorr/rules_file.hpp"
#include "slicecorr/same_light.hpp"
#include "support/text/ascii.hpp"
#include "support/text/nearest.hpp"

namespace slicecorr::resins {

namespace {

bool holds(const std::string& text, const std::string& part) {
  return lower_case(text).find(lower_case(part)) != std::string::npos;
}

bool fits(const ResinRecord& r, const Query& q) {
  if (!words_occur(q.words, searched_texts(r))) return false;
  if (!holds(r.maker, q.maker) || !holds(r.chemistry, q.chemistry)) return false;
  // Lamps of one kind differ by some nanometres: 460 finds a fit made at 458.
  if (q.wavelength_nm && (r.wavelength_nm == 0 || !same_light(r.wavelength_nm, *q.wavelength_nm))) {
    return false;
  }
  const double height = figures_of(r.resin).height_e_um;
  return !(q.least_height_um && height < *q.least_height_um) &&
         !(q.greatest_height_um && height > *q.greatest_height_um);
}

}  // namespace

std::vector<ResinRecord> find_records(const Query& query, std::vector<Finding>* problems) {
  std::vector<ResinRecord> found;
  for (const Definition& d : list_definitions("resin")) {
    try {
      ResinRecord record = load_record(d.path);
      if (fits(record, query)) found.push_back(std::move(record));
    } catch (const Error& e) {
      if (problems) problems->push_back({d.path, 0, "", e.what(), false});
    }
  }
  return found;
}

Located locate(const std::string& name_or_path) {
  if (name_or_path.ends_with(".toml")) {
    std::error_code ec;
    if (!std::filesystem::is_regular_file(name_or_path, ec)) {
      throw InputError(name_or_path, "", "is not a file that can be read");
    }
    // A file that is neither is told by whoever reads it as a resin.
    return {kind_of_definition(name_or_path).value_or("resin"),
            std::filesystem::path(name_or_path).stem().string(), name_or_path};
  }
  std::vector<std::string> names;
  for (const char* kind : {"resin", "printer"}) {
    for (const Definition& d : list_definitions(kind)) {
      if (d.name == name_or_path) return {kind, d.name, d.path};
      names.push_back(d.name);
    }
  }
  const std::vector<std::string_view> known(names.begin(), names.end());
  const std::string near = nearest(name_or_path, known);
  throw InputError(
      fmt::format("no resin or printer '{}'; {}'resinctl list' and 'resinctl list --printers' show "
                  "those known",
                  name_or_path, near.empty() ? "" : fmt::format("did you mean '{}'? ", near)));
}

std::vector<std::string> all_definition_files() {
  std::set<std::string> paths;
  std::vector<std::string> files;
  for (const char* kind : {"resin", "printer"}) {
    for (const std::string& folder : definition_folders(kind)) {
      std::error_code ec;
      std::set<std::string> here;
      for (const auto& entry : std::filesystem::directory_iterator(folder, ec)) {
        const auto& path = entry.path();
        if (path.extension() != ".toml" || path.filename().string()[0] == '.') continue;
        if (is_rules_file(path.string())) continue;
        if (paths.insert(std::filesystem::weakly_canonical(path, ec).string()).second) {
          here.insert(path.string());
        }
      }
      files.insert(files.end(), here.begin(), here.end());
    }
  }
  return files;
}

}  // namespace slicecorr::resins
