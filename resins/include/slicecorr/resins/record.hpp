// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file record.hpp
/// A resin as the shop keeps it: all that a resin file holds, more than the cure model needs.
///
/// Plain values; all functions are thread-safe and throw `InputError` with file, line and key.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// A resin file with its words and figures, beside `slicecorr::Resin` (what the cure model needs).
struct ResinRecord {
  std::string name;  ///< stable: lower case letters, digits, '-', '.', '_'; the file's stem
  int version = 1;   ///< rises with every change that is saved
  std::string maker, product, chemistry, colour, notes;
  std::vector<std::string> aliases;               ///< other names of the product
  std::vector<std::string> tags;                  ///< words that say its kind
  double wavelength_nm = 0;                       ///< of the curing light; 0: not given
  Resin resin;                                    ///< the [cure] and [inhibition] tables, checked
  std::map<std::string, std::string> provenance;  ///< source, date, place, measurements, fit ...
  std::vector<std::string> measurements;          ///< CSV files beside the record, as written
  std::string path;                               ///< where it was read from
  std::string text;                               ///< as it stands in the file, comments included
};

/// One thing wrong with a definition file.
struct Finding {
  std::string file;
  int line = 0;  ///< 0: the whole file
  std::string key, message;
  bool warning = false;         ///< worth a look, but usable
  std::string to_text() const;  ///< FILE:LINE: KEY: MESSAGE, with `warning:` before the key
};

/// Everything that is wrong with a resin or printer file: unknown keys, wrong types, values out of
/// range, doses that contradict each other, measurements that can't be read, a name that is not the
/// file's. Empty when all is well. Never throws on content.
std::vector<Finding> validate_definition(const std::string& path);

/// The keys that a definition of a kind ("resin" or "printer") may hold, as a Markdown table.
std::string schema_table(std::string_view kind);

ResinRecord load_record(const std::string& name_or_path);
ResinRecord parse_record(std::string_view text, const std::string& source);

/// All areal/volumetric and base 10/base e forms of a resin's figures, for showing.
struct ResinFigures {
  double height_e_um = 0, height10_um = 0;         ///< absorbance height of the curing light
  double gel_mj_cm2 = 0, gel_mj_cm3 = 0;           ///< m = 1; 0 when there is none
  double aim_mj_cm2 = 0, aim_mj_cm3 = 0;           ///< what correction aims at
  double gel_prime = 0, gel_prime_volumetric = 0;  ///< D'c areal, and over hb^m
  double aim_prime = 0, aim_prime_volumetric = 0;  ///< the same of the dose aimed at
  double dose_factor = 1;                          ///< dose aimed at over gel dose
  double huv_e_um = 0, huv10_um = 0, beta = 0, beta_volumetric = 0;  ///< 0 without inhibition
};
ResinFigures figures_of(const Resin& resin);

}  // namespace slicecorr::resins
