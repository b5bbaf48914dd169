// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file database.hpp
/// The database of resins and printers: folders of TOML files, their history, and safe changes.
///
/// A folder holds NAME.toml and, for every earlier version, .history/NAME/VERSION.toml. Changes
/// take the folder's lock, are written beside and renamed: concurrent changes come one after the
/// other, and a kill leaves the old file or the new one. Functions are thread-safe, and safe
/// against other processes. Names and texts that can't be used throw `InputError`, failing disks
/// `DeviceError`.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// What `resinctl list` can ask for; empty and unset fields ask for nothing.
struct Query {
  /// Words that must all occur in what is said of the resin (search.hpp).
  std::string words = "";
  std::string maker = "", chemistry = "";
  std::optional<double> wavelength_nm = std::nullopt;  ///< within 10 nm
  /// Absorbance height, base e.
  std::optional<double> least_height_um = std::nullopt, greatest_height_um = std::nullopt;
};
/// Resins of all folders by name that fit; files that can't be read are told in `problems`.
std::vector<ResinRecord> find_records(const Query& query, std::vector<Finding>* problems = nullptr);

/// A resin or printer that was found.
struct Located {
  std::string kind, name, path;
};
/// Finds a resin, else a printer, by name in all folders, or by the path of its file. Throws
/// `InputError` with the known name that is nearest.
Located locate(const std::string& name_or_path);
/// Every definition file of all folders, also those that are hidden by one of the same name or are
/// neither resin nor printer.
std::vector<std::string> all_definition_files();

/// Folder that changes are written to: `$SLICECORR_DB` when set, else the user's; made if missing.
std::string writable_folder();

/// A version of a record that is kept.
struct Version {
  int number = 0;       ///< from 1
  std::string date;     ///< when it was saved: ISO 8601, UTC; empty when it came without
  std::string message;  ///< why, as given; "changed by hand" for a text found past this library
  std::string path;
  bool current = false;
};
/// Oldest first, the present one last.
std::vector<Version> history(const std::string& name, std::string_view kind = "resin");
/// Text of one version.
std::string text_of_version(const std::string& name, int number, std::string_view kind = "resin");
/// Lines that differ, like diff -u; empty when none does.
std::string difference(const std::string& old_text, const std::string& new_text,
                       const std::string& old_name, const std::string& new_name);

enum class Replace { refuse, keep_history };
struct Saved {
  std::string path;
  int version = 1;
  bool replaced = false, unchanged = false;
};
/// Writes `text` (checked first) as NAME.toml into `folder`, with `version` set in it to one more
/// than the greatest there has been. An existing file is kept in the history, also one that was
/// changed by hand or is broken; with `refuse` it is an `InputError`. A text that differs in
/// nothing but its version is not saved again. `expected_version`: refuses when the present one is
/// another (someone else changed it meanwhile).
Saved save_definition(const std::string& folder, const std::string& name, const std::string& text,
                      std::string_view kind, Replace replace, const std::string& message,
                      std::optional<int> expected_version = std::nullopt);
/// Puts bytes into `folder` as NAME[-N] with `extension` (".png"), unless they are there. Never
/// replaces a file. Returns the file's name.
std::string save_beside(const std::string& folder, const std::string& name,
                        const std::string& extension, const std::string& bytes);
/// Puts a CSV beside a record under NAME[-N].csv; the same bytes are not stored twice. Returns the
/// file's name.
std::string save_measurements(const std::string& folder, const std::string& name,
                              const std::string& csv_path);

}  // namespace slicecorr::resins
