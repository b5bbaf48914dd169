// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/resins/design.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::resins {

std::string Recommendation::to_json() const {
  using nlohmann::ordered_json;
  const auto number = [](double v) { return slicecorr::detail::finite_or_null(v); };
  const auto range_of = [&](const std::optional<HeightRange>& r) {
    return r ? ordered_json({{"least_um", r->least_um}, {"greatest_um", r->greatest_um}})
             : ordered_json();
  };
  ordered_json j;
  j["feasible"] = feasible;
  j["present_height10_um"] = present_height10_um;
  if (feasible) {
    j["present_fits"] = present_fits;
    j["height10_um"] = height10_um;
    j["height_e_um"] = height_e_um;
    j["absorber_factor"] = absorber_factor;
  }
  j["range10"] = range_of(range);
  if (feasible) {
    j["range10"]["least_because"] = least_because;
    j["range10"]["greatest_because"] = greatest_because;
  }
  j["uncorrected"] = {{"range10", range_of(range_uncorrected)},
                      {"best_error_um", number(best_uncorrected_error_um)},
                      {"best_height10_um", number(best_uncorrected_height10_um)}};
  if (feasible) {
    j["uncorrected"]["over_um"] = number(uncorrected.over_um);
    j["uncorrected"]["under_um"] = number(uncorrected.under_um);
    j["corrected_error_um"] = number(corrected_error_um);
    j["um_per_percent_of_light"] = number(um_per_percent_of_light);
    j["phi"] = {{"max", phi_max}, {"min", phi_min}};
    j["fastest_mm_h"] = fastest_mm_h;
    j["slowest_mm_h"] = slowest_mm_h;
    j["burst_um"] = number(burst_um);
    j["gap_um"] = gap_um;
    j["gap_contrast"] = gap_contrast;
    if (uv_needed_mw_cm2 > 0) {
      j["uv_needed_mw_cm2"] = number(uv_needed_mw_cm2);
      j["phi_with_uv"] = number(phi_with_uv);
    }
  }
  if (places) {
    j["places"] = {{"least_light", places->least_light},
                   {"greatest_light", places->greatest_light},
                   {"share_met", places->share_met},
                   {"fastest_mm_h", places->fastest_mm_h},
                   {"slowest_mm_h", places->slowest_mm_h}};
  }
  if (height_for_omega_um) {
    j["feature_for_dose"] = {{"least_height_um", number(*height_for_omega_um)},
                             {"omega", peak.omega},
                             {"below_top_um", number(peak.below_top_um)}};
  }
  const auto disc_of = [](const EvenDisc& d) {
    return ordered_json{{"height_e_um", d.height_e_um},   {"gap_um", d.gap_um},
                        {"blue_mw_cm2", d.blue_mw_cm2},   {"uv_mw_cm2", d.uv_mw_cm2},
                        {"share_within", d.share_within}, {"mean_square", d.mean_square},
                        {"suction_pa", d.suction_pa},     {"force_n", d.force_n},
                        {"fastest_mm_h", d.fastest_mm_h}, {"gap_at_limit", d.gap_at_limit}};
  };
  if (disc) j["disc"] = disc_of(*disc);
  if (disc_present) j["disc_present"] = disc_of(*disc_present);
  if (disc_most_even) j["disc_most_even"] = disc_of(*disc_most_even);
  j["text"] = reasons;
  j["warnings"] = warnings;
  if (!feasible) j["ways_out"] = ways_out;
  return j.dump(2);
}

}  // namespace slicecorr::resins
