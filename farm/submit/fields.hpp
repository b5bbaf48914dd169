// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file fields.hpp
/// The keys of jobs files, whatever the file's kind: what each sets, and how its value is checked.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <variant>
#include <vector>

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::farm::detail {

/// The mode of tomographic prints, beside those of the settings.
inline constexpr const char* kTomographyMode = "tomography";

/// A value as a file has it: a word, a number, yes or no, or a list of words or numbers.
struct Value {
  std::variant<std::string, double, bool, std::vector<std::string>, std::vector<double>> value;
  /// Of a table of text (CSV), where numbers are words, too.
  bool from_text = false;
  std::string where;  ///< "jobs.toml: line 7"
};

/// Sets what `key` says. Gives the error, empty when there is none.
std::string set_field(JobRequest& request, const std::string& key, const Value& value);

/// The setting of heights of layers, which command lines say by a table (`--layers`).
inline constexpr const char* kLayerHeights = "layer_heights_um";

/// Makes a field what it is where nobody says it.
void unset_field(JobRequest& request, const std::string& key);

/// What kind of job a request is for.
enum class JobKind {
  meshes,               ///< to be sliced
  archive,              ///< of slices
  archive_around_part,  ///< with supports, around a mesh
  tomographic_mesh,
  tomographic_volume
};
inline bool is_tomographic(JobKind kind) { return kind >= JobKind::tomographic_mesh; }
JobKind kind_of(const JobRequest& request);
/// Why `key` has no place in a job of this kind; empty when it has one. `name`: of the key in
/// messages.
std::string misfit(const std::string& key, const std::string& name, JobKind kind);

/// Makes everything that was said until now a default for jobs that are still to come.
void make_defaults(JobRequest& request);

/// All fields that decide what is made, as one text: requests with the same make the same.
std::string work_text(const JobRequest& request);

/// What each key takes, as OpenAPI describes it, by name.
nlohmann::ordered_json field_schemas();

/// All keys, for messages.
std::vector<std::string> field_names();

/// Parts that are said as PART*N become so many, which are arranged. Throws `InputError`.
void expand_copies(JobRequest& request);

/// Paths of parts, printers, resins and outputs count from the folder of the jobs file.
void make_paths_absolute(JobRequest& request, const std::string& folder);

bool is_volume(const std::string& path);
/// File name without its endings.
std::string stem_of(const std::string& path);

}  // namespace slicecorr::farm::detail
