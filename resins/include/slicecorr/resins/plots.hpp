// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file plots.hpp
/// Pictures of fits and resins: self-contained SVG and HTML, light and dark.
///
/// Each SVG stands alone and may also be put into a page as it is; `name` (a resin's, say) comes
/// first in its title. All functions are thread-safe and throw `InputError` when there is nothing
/// to draw: a fit without measurements of the kind, a resin without a dose.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// Working curve on a logarithmic axis of dose (Jacobs) or dose analogue (kinetic, joint): data by
/// intensity, fit, 95 % band, gel dose and the dose that correction aims at, residuals below
/// (figure 3.7a). `dose_factor`: aim over gel dose.
std::string working_curve_svg(const FitResult& fit, double dose_factor = kDefaultDoseFactor,
                              const std::string& name = {});
/// Height against D and against D' one above the other (figure 3.3): shows whether the data
/// collapse.
std::string collapse_svg(const FitResult& jacobs, const FitResult& kinetic,
                         const std::string& name = {});
/// Dead zone against the ratio of UV to blue with data, fit and band, residuals below (figures
/// 3.5a, 3.7b).
std::string dead_zone_svg(const FitResult& fit, const std::string& name = {});
/// Curing fronts over time with z0, zf and zb marked (figure 3.4b), and the window seen closer.
/// `greatest_time_s` 0: chosen so that the fronts show.
std::string fronts_svg(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                       double greatest_time_s = 0, const std::string& name = {});
/// Working curve, and dead zone where the resin has one, from a record's parameters alone.
std::string record_svg(const ResinRecord& record);

/// Fits of the measurements that a record keeps beside it.
struct RecordFits {
  std::vector<FitResult> fits;        ///< Jacobs, kinetic, dead zone: those that can be made
  std::vector<std::string> problems;  ///< why others can't, with file and line
};
/// Heights: Jacobs, and kinetic where there are several intensities. Dead zones:
/// `dead_zone_model`, on the record's own blue parameters. Never throws on measurements.
RecordFits fits_of_record(const ResinRecord& record, const ExecutionContext& context = {});
/// What a dead-zone fit takes from a resin: `options` with its blue law at the gel dose.
FitOptions on_resin(const Resin& resin, FitOptions options = {});
/// The one that the record's provenance names; else transient when the record says an exponent or a
/// dose for UV light, else steady.
FitModel dead_zone_model(const ResinRecord& record);
/// Whether the heights were cured at two intensities or more, so that m can be asked for.
bool has_intensities(const Measurements& data);

/// A page about a resin: figures in all units, provenance, history, pictures of its fits.
std::string resin_page(const ResinRecord& record, const std::vector<FitResult>& fits,
                       const std::vector<Version>& versions = {});

}  // namespace slicecorr::resins
