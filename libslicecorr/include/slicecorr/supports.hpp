// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file supports.hpp
/// What goes with what: the one table that says which features of a print are not counted together.
/// Every program asks it before the work; what the table does not name is counted. Pure and
/// thread-safe.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// What makes a print other than plain: continuous light, even and in columns, in deep resin.
enum class Feature {
  layerwise,
  uv_constant,
  uv_per_slice,
  uv_patterned,
  even_dead_zone,
  gel_time,
  bleaching,
  spread,         ///< light goes from pixel to pixel (light_spreads.hpp)
  uneven_light,   ///< a flat-field
  vat_depth,      ///< resin that ends
  reflectance,    ///< a platform that sends light back
  lifts,          ///< layer by layer: each layer holds when the platform lifts
  exchange,       ///< with lifts that replace a part of the liquid resin
  lamps_stay,     ///< slices that go slower get more light
  dim_light,      ///< layers that get less than all of the light
  own_light,      ///< layers that get different shares of it
  own_heights,    ///< layer by layer: layers of different heights
  moved_heights,  ///< continuous: slices of different heights
  edge_heights,   ///< edges aimed at where the mesh has them
  left_alone,
  wanted_doses,
  capped_dose,
  robust,
  derivatives,  ///< how sure figures are
  pulsed_grey,  ///< grey by pulses, where that is not the same as less light
  uneven_uv,    ///< a UV lamp that does not shine evenly
  fading_uv,    ///< a UV lamp that gives less and less of what is asked of it
};
inline constexpr int kFeatures = static_cast<int>(Feature::fading_uv) + 1;

/// What people call it, with the field or key that brings it: "UV light per slice (dead_zone_um)".
std::string name_of(Feature feature);

enum class Verdict {
  refused,        ///< before the work, with these words
  not_corrected,  ///< the same where a part is corrected; figures of a stack count both
  without,        ///< the first of the two is left out, and this is told
  alone,          ///< each column is corrected by itself, and this is told; predictions count both
};
struct Unsupported {
  Feature a, b;
  Verdict verdict;
  /// "{printer}" and "{resin}" stand for their names.
  const char* words;
};
/// All pairs that are not counted together, in the order in which they are told.
std::span<const Unsupported> unsupported();

/// What is reckoned of a resin besides the light of slices, each in a way of its own.
enum class LawUse {
  flow,
  tomography,
  beams,
  uv_exposure,
  part_times,
  part_tuning,
  scan_tuning,
  gel_times,
  absorber,
  tables,
  assumed_light,
  exponent_errors,
  skins,  ///< of films over gaps, in a correction
};
/// "tomographic printing".
const char* name_of(LawUse use);
/// A law of cure, of those whose doses are no sums of light, that is not counted in a use.
struct UncountedLaw {
  LawUse use;
  Feature law;
  /// "{resin}" stands for its name, "{use}" for the use's.
  const char* words;
};
std::span<const UncountedLaw> uncounted_laws();
/// Throws `InputError` with the words of the table where the resin's law is not counted there.
void refuse_law(const Resin& resin, LawUse use);

/// The features of a print's light.
std::vector<Feature> features_of(const Printer& printer, const Resin& resin,
                                 const Process& process);

/// The first pair of the table that is among `features` and has this verdict.
const Unsupported* find_unsupported(std::span<const Feature> features, Verdict verdict);

/// Throws `InputError` with the words of the table where two of these do not go together.
void check_supported(std::span<const Feature> features, const std::string& printer = {},
                     const std::string& resin = {});
/// The same of a print's light; also where printer and resin tell it in different units
/// (light_unit.hpp).
void check_supported(const Printer& printer, const Resin& resin, const Process& process);
/// Of a correction: what is refused in all that is done, and what is not corrected for.
void check_corrected(const Printer& printer, const Resin& resin, const Process& process);
/// The process without edge heights where these are not counted, and why; null where they are.
const char* leave_out_heights(const Printer& printer, const Resin& resin, Process& process);
/// The same of a cap of the dose; null also where there is none.
const char* leave_out_cap(const Printer& printer, const Resin& resin, Process& process);
/// The same of lifts.
const char* leave_out_lifts(const Printer& printer, const Resin& resin, Process& process);

}  // namespace slicecorr
