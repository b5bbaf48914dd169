// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file measurements.hpp
/// Measurements of resins, read from CSV (contract: "resinctl"). Plain values; all functions are
/// thread-safe and throw `InputError`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::resins {

/// Where a measurement stands.
struct Origin {
  int source = 0;  ///< index into `Measurements::sources`
  int line = 0;    ///< from 1
};

/// Height of a sample that was exposed to curing light alone.
struct CuredHeight {
  double blue_mw_cm2 = 0;  ///< 0 when only the dose is known
  double exposure_s = 0;   ///< 0 when only the dose is known
  double dose_mj_cm2 = 0;  ///< > 0 always: intensity times time where those are known
  double height_um = 0;    ///< > 0
  double sigma_um = 0;     ///< scatter of this measurement, column `sigma_um`; 0: not given
  Origin origin;
};

/// Height of the resin that stayed liquid between window and cured part.
struct DeadZone {
  double blue_mw_cm2 = 0;   ///< > 0
  double uv_mw_cm2 = 0;     ///< > 0
  double exposure_s = 0;    ///< > 0
  double dead_zone_um = 0;  ///< >= 0
  double sigma_um = 0;      ///< as of CuredHeight
  Origin origin;
};

struct Measurements {
  std::vector<std::string> sources;  ///< paths as given
  std::vector<CuredHeight> cured;
  std::vector<DeadZone> dead_zones;
  std::vector<std::string> warnings;  ///< what was handled while reading, with file and line
};

/// Reads one or several files, each with its own header row; a file holds cured heights or dead
/// zones. Throws `InputError` with file, line, column and what was expected. A measurement is never
/// dropped or changed without a warning; one that can't be right (no number, not finite, not above
/// zero) is an error. Bounded memory: refuses files of more than `kMaxMeasurements` rows.
Measurements read_measurements(const std::vector<std::string>& paths,
                               const ExecutionContext& context = {});
/// The same from text; `source` names it in messages.
Measurements parse_measurements(const std::string& text, const std::string& source);

/// The measurements of one file as such a file again: known columns and their numbers, no comments, no
/// columns of others. What it is read from is the same to the last bit, but for doses of rows that have
/// intensity and time, which follow from these.
std::string measurements_as_csv(const Measurements& measurements);

inline constexpr int kMaxMeasurements = 1000000;

}  // namespace slicecorr::resins
