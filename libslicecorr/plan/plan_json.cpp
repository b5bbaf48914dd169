// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/plan.hpp"
#include "slicecorr/same_light.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr {

namespace {

using nlohmann::ordered_json;

ordered_json of(const PlanPlace& p) {
  if (p.x < 0) return nullptr;
  return {{"x", p.x}, {"y", p.y}, {"first_slice", p.first}, {"last_slice", p.last}};
}
ordered_json of(const SpeedRange& r) { return {r.least_mm_h, r.greatest_mm_h}; }
ordered_json of(const std::vector<SpeedRange>& ranges) {
  ordered_json j = ordered_json::array();
  for (const SpeedRange& r : ranges) j.push_back(of(r));
  return j;
}
ordered_json of(const std::optional<BestGap>& best) {
  if (!best) return nullptr;
  return {{"speed_mm_h", best->speed_mm_h}, {"contrast", best->contrast}};
}

/// Null where lifts are not known.
ordered_json all_s(const PrintTime& time) {
  return time.all_s() ? ordered_json(*time.all_s()) : ordered_json();
}

ordered_json of(const PlanPoint& p) {
  ordered_json j;
  if (p.exposure_s > 0) {
    j["exposure_s"] = p.exposure_s;
  } else {
    j["speed_mm_h"] = p.speed_mm_h;
  }
  j["keeps"] = p.keeps;
  j["prints"] = p.prints;
  if (p.prints) {
    j["max_abs_um"] = p.max_abs_um;
    j["max_abs_at"] = of(p.max_abs_at);
    j["mean_abs_um"] = p.mean_abs_um;
    j["contrast"] = p.contrast_at.x >= 0 ? ordered_json(p.contrast) : ordered_json();
    j["contrast_at"] = of(p.contrast_at);
    j["lost_features"] = p.lost;
    j["split_features"] = p.split;
    j["gaps_below_contrast"] = p.narrow;
    j["edges_beyond_tolerance"] = p.off;
    j["extra_slices"] = p.extra_slices;
    j["time_s"] = p.time_s;
    j["print_time_s"] = all_s(p.print_time());
    j["all_columns"] = p.all_columns;
  }
  if (!p.keeps) {
    j["limited_by"] = p.limited_by;
    j["why"] = p.why;
  }
  return j;
}
ordered_json of(const std::vector<PlanPoint>& points) {
  ordered_json j = ordered_json::array();
  for (const PlanPoint& p : points) j.push_back(of(p));
  return j;
}

}  // namespace

std::string PrintPlan::to_json() const {
  ordered_json j;
  const bool continuous = mode == ExposureMode::continuous;
  j["mode"] = continuous ? "continuous" : "layerwise";
  j[continuous ? "speed_mm_h" : "exposure_s"] = continuous ? at.speed_mm_h : at.exposure_s;
  j["limited_by"] = limited_by;
  j["limit"] = limit;
  j["limit_at"] = of(limit_place);
  j["tolerance_um"] = ask.tolerance_um;
  j["gap_contrast"] = ask.gap_contrast;
  j["light_error"] = ask.light_error;
  j["printer"] = setup.printer.name;
  j["resin"] = setup.resin.name;
  if (const auto other = other_wavelength(setup.printer, setup.resin)) {
    j["other_wavelength"] = {{"printer_nm", other->printer_nm}, {"resin_nm", other->resin_nm}};
  }
  j["layer_um"] = layer_um;
  j["layers"] = layers;
  j["extra_slices"] = at.extra_slices;
  const PlanPoint& best = along_z ? *along_z : at;
  j["light_s"] = best.time_s;
  j["print_time_s"] = all_s(best.print_time());
  if (!continuous) {
    j["layer_s"] = detail::own_json<ordered_json>(
        layer_time(setup.process, setup.lift_times, layer_um).to_json());
  }
  j["lamp_share"] = lamp_share;
  j["omega_max"] = setup.process.omega_max >= kNoCap ? ordered_json("inf")
                                                     : ordered_json(setup.process.omega_max);
  j["edge_aim_um"] =
      setup.process.edge_aim_um > 0 ? ordered_json(setup.process.edge_aim_um) : ordered_json();
  j["uv_mw_cm2"] = setup.process.uv.kind == UvKind::constant
                       ? ordered_json(setup.process.uv.uv_mw_cm2)
                       : ordered_json();
  j["at"] = of(at);
  j["faster"] = faster ? of(*faster) : ordered_json();
  j["slower"] = slower ? of(*slower) : ordered_json();
  j["curve"] = of(curve);
  ordered_json by_tolerance = ordered_json::array();
  for (const PlanTolerance& t : tolerances) {
    ordered_json one =
        t.at ? of(*t.at) : ordered_json{{continuous ? "speed_mm_h" : "exposure_s", nullptr}};
    one["tolerance_um"] = t.tolerance_um;
    one["limited_by"] = t.limited_by;
    by_tolerance.push_back(std::move(one));
  }
  j["tolerance_curve"] = by_tolerance;
  if (light) {
    j["light"] = {{"smax_mm_h", light->smax_mm_h},
                  {"smin_mm_h", light->smin_mm_h},
                  {"lam_um", light->lam_um},
                  {"full", light->full(at.speed_mm_h)},
                  {"black", light->black(at.speed_mm_h)},
                  {"burst_um", light->burst_um(at.speed_mm_h)}};
    j["ranges_mm_h"] = of(ranges);
  }
  ordered_json list = ordered_json::array();
  for (const PlanGap& g : gaps) {
    list.push_back({{"slices", g.slices},
                    {"um", g.slices * layer_um},
                    {"at_platform", g.at_platform},
                    {"beside_grey", g.beside_grey},
                    {"left_out", g.left_out},
                    {"pixels", g.count},
                    {"first", of(g.place)},
                    {"ranges_mm_h", of(g.ranges)},
                    {"best", of(g.best)}});
  }
  j["gaps"] = list;
  list = ordered_json::array();
  for (const PlanFeature& f : features) {
    list.push_back({{"slices", f.slices},
                    {"um", f.slices * layer_um},
                    {"pixels", f.count},
                    {"first", of(f.place)}});
  }
  j["features"] = list;
  list = ordered_json::array();
  for (const PlanStep& s : steps) {
    list.push_back({{"change", s.change},
                    {"speed_mm_h", s.speed_mm_h ? ordered_json(*s.speed_mm_h) : ordered_json()},
                    {"range_mm_h", s.range ? of(*s.range) : ordered_json()},
                    {"held_back", s.held_back},
                    {"best", of(s.best)}});
  }
  j["next_steps"] = list;
  j["suction"] = nullptr;
  if (suction) {
    j["suction"] = {{"slice", suction->slice},
                    {"speed_limit_mm_h", suction->speed_limit_mm_h},
                    {"limit_pa", suction->limit_pa},
                    {"limit_given", suction->limit_given},
                    {"gap_um", suction->gap.gap_um}};
  }
  if (setup.process.ramp == Ramp::lamp_follows) {
    j["ramp"] = "lamp-follows";
    j["ramp_mm"] = setup.process.ramp_mm;
  }
  j["stage_mm_h"] = stage_mm_h > 0 ? ordered_json(stage_mm_h) : ordered_json();
  j["slice_speed_mm_h"] =
      slice_speed_mm_h.empty() ? ordered_json() : ordered_json(slice_speed_mm_h);
  j["along_z"] = nullptr;
  if (!slice_speed_mm_h.empty()) {
    const bool stay = setup.process.slice_lamps == SliceLamps::stay;
    ordered_json z = along_z ? of(*along_z) : ordered_json::object();
    z["lamps"] = stay ? "stay" : "follow";
    z["speed_mm_h"] = setup.process.speed_mm_h;
    z["time_s"] = along_z ? along_z->time_s : at.time_s;
    z["uniform_time_s"] = uniform_time_s;
    j["along_z"] = z;
  }
  j["with"] = with;
  j["dose_factor"] = dose_factor ? ordered_json(*dose_factor) : ordered_json();
  j["chosen"] = chosen;
  list = ordered_json::array();
  for (const PlanOrientation& o : orientations) {
    ordered_json one{{"rotate_deg", o.rotate_deg}, {"prints", o.prints}, {"chosen", o.chosen}};
    if (o.prints) {
      if (continuous) {
        one["speed_mm_h"] = o.speed_mm_h;
      } else {
        one["exposure_s"] = o.exposure_s;
      }
      one["light_s"] = o.time.light_s;
      one["print_time_s"] = all_s(o.time);
      one["layers"] = o.layers;
    }
    one["limited_by"] = o.limited_by;
    list.push_back(std::move(one));
  }
  j["orientations"] = list;
  j["notes"] = notes;
  j["columns"] = {
      {"part", part_columns}, {"distinct", distinct_columns}, {"judged", judged_columns}};
  j["corrections"] = tried.size();
  j["tried"] = of(tried);
  return j.dump(2);
}

}  // namespace slicecorr
