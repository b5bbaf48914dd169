/// @file plots.hpp
/// Pictures of fits and resins: self-contained SVG and HTML, light and dark.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// Working curve on a logarithmic axis of dose: data, fit, 95 % band, residuals below
/// (figure 3.7a).
std::string working_curve_svg(const FitResult& fit);
/// Height against D and against D' side by side (figure 3.3): shows whether the data collapse.
std::string collapse_svg(const FitResult& jacobs, const FitResult& kinetic);
/// Dead zone against the ratio of UV to blue with data, fit and band (figures 3.5a, 3.7b).
std::string dead_zone_svg(const FitResult& fit);
/// Curing fronts over time with z0, zf and zb marked (figure 3.4b).
std::string fronts_svg(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                       double greatest_time_s);
/// Working curve, and dead zone where the resin has one, from a record's parameters alone.
std::string record_svg(const ResinRecord& record);

/// A page about a resin: figures in all units, provenance, history, pictures of its fits.
std::string resin_page(const ResinRecord& record, const std::vector<FitResult>& fits);

}  // namespace slicecorr::resins
