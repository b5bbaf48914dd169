// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/definition_json.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "process/vat_window_keys.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/vial.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/vial_json.hpp"
#include "support/json/read_json.hpp"
#include "support/text/base64.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::ordered_json;
using Node = JsonNode<nlohmann::json>;

constexpr double kLargest = JsonSource::kLargest;

Json calibration_json(const std::vector<CalibrationPoint>& calibration) {
  Json points = Json::array();
  for (const CalibrationPoint& c : calibration) {
    points.push_back({{"level", c.level}, {"intensity_mw_cm2", c.intensity_mw_cm2}});
  }
  return points;
}

std::vector<CalibrationPoint> read_calibration(const Node& node) {
  std::vector<CalibrationPoint> points;
  for (const Node& point : node.list(2, 65536)) {
    const CalibrationPoint c{point["level"].number(0, kLargest),
                             point["intensity_mw_cm2"].number(0, kLargest)};
    if (!points.empty() &&
        (c.level <= points.back().level || c.intensity_mw_cm2 < points.back().intensity_mw_cm2)) {
      point.fail("a level above and an intensity not below those before it");
    }
    points.push_back(c);
  }
  return points;
}

std::vector<AxisWobble> read_wobble(const Node& node) {
  std::vector<AxisWobble> wobble;
  for (const Node& point : node.list(1, 1000000)) {
    constexpr double most_px = 1e4;
    const auto numbers = point.list(3, 3);
    const AxisWobble w{numbers[0].number(0, 360), numbers[1].number(-most_px, most_px),
                       numbers[2].number(-most_px, most_px)};
    if (!(w.angle_deg < 360) || (!wobble.empty() && w.angle_deg <= wobble.back().angle_deg)) {
      point.fail("angles that rise, from 0 to below 360");
    }
    wobble.push_back(w);
  }
  return wobble;
}

Json spread_json(const LightSpread& spread) {
  if (spread.picture) {
    return {{"width_px", spread.picture->width_px},
            {"height_px", spread.picture->height_px},
            {"pitch_um", spread.picture->pitch_um},
            {"values", base64(*spread.picture->values)}};
  }
  Json list = Json::array();
  for (const SpreadGaussian& g : spread.gaussians) {
    list.push_back(Json::array({g.sigma_um, g.weight}));
  }
  Json json;
  json["gaussians"] = std::move(list);
  return json;
}

/// Of a table `node` that may have a "spread"; `printer` has its display.
LightSpread read_spread(const Node& node, const Printer& printer) {
  LightSpread spread;
  if (!node.has("spread")) return spread;
  const Node s = node["spread"];
  if (s.has("values")) {
    SpreadPicture picture;
    picture.width_px = s["width_px"].integer(1, kMostSpreadPixels);
    picture.height_px = s["height_px"].integer(1, kMostSpreadPixels);
    picture.pitch_um = s["pitch_um"].positive();
    auto values = from_base64(s["values"].string());
    if (!values ||
        values->size() != static_cast<std::size_t>(picture.width_px) * picture.height_px) {
      s["values"].fail("a byte for each pixel, in base 64");
    }
    picture.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(*values));
    try {
      check_spread_picture(picture, printer, "spread");
    } catch (const InputError& e) {
      s["values"].fail(std::string("a picture that fits; it ") + e.what());
    }
    spread.picture = std::move(picture);
    return spread;
  }
  double sum = 0;
  for (const Node& pair : s["gaussians"].list(1, kMostSpreadGaussians)) {
    const auto numbers = pair.list(2, 2);
    spread.gaussians.push_back({numbers[0].number(0, kLargest), numbers[1].number(0, 2)});
    sum += spread.gaussians.back().weight;
    const double most_um =
        std::min(printer.width_px * printer.pixel_x_um, printer.height_px * printer.pixel_y_um);
    if (kSpreadReachSigmas * spread.gaussians.back().sigma_um > most_um) {
      pair.fail("a sigma whose light stays within the display's shorter side");
    }
  }
  if (!(std::abs(sum - 1) <= kSpreadWeights)) s["gaussians"].fail("weights that add up to 1");
  return spread;
}

bool is_given(const LightSpread& spread) { return !spread.gaussians.empty() || spread.picture; }

/// What tomographic printers have besides.
void read_tomography(const Node& node, Printer& p) {
  if (node.has("vial")) {
    const Node v = node["vial"];
    p.vial = Vial{v["outer_mm"].positive(), v["inner_mm"].positive(), v["n_outside"].number(1, 3),
                  v["n_wall"].number(1, 3)};
    if (v.has("jacket_outer_mm")) {
      p.vial->jacket_outer_mm = v["jacket_outer_mm"].positive();
      p.vial->jacket_inner_mm = v["jacket_inner_mm"].positive();
      p.vial->n_between = v["n_between"].number(1, 3);
      p.vial->n_jacket = v["n_jacket"].number(1, 3);
    }
    read_shape(v, *p.vial);
    if (const auto wrong = wrong_vial(*p.vial)) v[wrong->key].fail("radii that go with the others");
  }
  if (node.has("optics")) {
    const Node o = node["optics"];
    p.optics = Optics{static_cast<OpticsKind>(o["kind"].choice({"telecentric", "pinhole"})),
                      o["distance_mm"].number(0, kLargest),
                      o["half_angle_deg"].number(0, 45),
                      o["rays_per_pixel"].integer(1, 1000),
                      o["axis_right_px"].number(-kMostPixelsAcross, kMostPixelsAcross),
                      o["axis_up_px"].number(-1e5, 1e5),
                      o.has("tilt_deg") ? o["tilt_deg"].number(-45, 45) : 0};
    if (p.optics->kind == OpticsKind::pinhole &&
        p.optics->distance_mm <= (p.vial ? p.vial->outside_mm() : 0)) {
      o["distance_mm"].fail("more than the vial's outer radius");
    }
  }
  if (node.has("rotation")) {
    const Node r = node["rotation"];
    p.rotation = Rotation{
        r["deg_s"].positive(),
        static_cast<TurnDirection>(r["direction"].choice({"clockwise", "counterclockwise"})),
        r["max_fps"].number(0, kLargest)};
    if (r.has("wobble")) p.rotation->wobble = read_wobble(r["wobble"]);
  }
  if (node.has("bath")) {
    const Node b = node["bath"];
    p.bath = Bath{b["window_mm"].positive(), b["n"].number(1, 3), b["wall_mm"].number(0, kLargest),
                  b["n_wall"].number(1, 3)};
    if (const auto wrong = wrong_bath(p)) b[wrong->key].fail("what goes with vial and optics");
  }
}

/// What a printer file can say of lifts.
constexpr std::pair<const char*, double LiftMotion::*> kMotionFigures[] = {
    {"up_mm", &LiftMotion::up_mm},
    {"up_mm_s", &LiftMotion::up_mm_s},
    {"back_mm_s", &LiftMotion::back_mm_s},
    {"before_light_s", &LiftMotion::before_light_s},
    {"acceleration_mm_s2", &LiftMotion::acceleration_mm_s2},
};

}  // namespace

Json orientation_json(const Orientation& o) {
  return {{"portrait", o.portrait}, {"mirror_x", o.mirror_x}, {"mirror_y", o.mirror_y}};
}

Orientation read_orientation(const Node& node) {
  return {node["portrait"].flag(), node["mirror_x"].flag(), node["mirror_y"].flag()};
}

namespace {

Json field_json(const FlatField& f, const char* entry) {
  return {{"file", entry},
          {"width_px", f.width_px},
          {"height_px", f.height_px},
          {"frame", f.of_plate ? "plate" : "image"},
          {"reference", f.reference},
          {"crc32", flat_field_crc32(f)}};
}

/// All but its values.
FlatField read_field(const Node& f) {
  FlatField field;
  field.width_px = f["width_px"].integer(1, kMostPixelsAcross);
  field.height_px = f["height_px"].integer(1, kMostPixelsAcross);
  if (!is_image_size(field.width_px, field.height_px)) {
    f["width_px"].fail("a picture of at most " + std::to_string(kMostPixels) + " pixels");
  }
  field.of_plate = f["frame"].choice({"image", "plate"}) == 1;
  field.reference = f["reference"].integer(1, 255);
  return field;
}

/// Its numbers as they are: a stack was made by this map, whatever the table says later.
Json distortion_json(const Distortion& d) {
  return {{"x_mm", d.x_mm},
          {"y_mm", d.y_mm},
          {"points", d.points},
          {"rms_um", d.rms_um},
          {"most_off_um", d.most_off_um},
          {"rms_off_um", d.rms_off_um}};
}

Distortion read_distortion(const Node& node) {
  Distortion d;
  for (const auto& [key, factors] : {std::pair{"x_mm", &d.x_mm}, {"y_mm", &d.y_mm}}) {
    const auto numbers = node[key].list(Distortion::kTerms, Distortion::kTerms);
    for (std::size_t i = 0; i < numbers.size(); ++i)
      (*factors)[i] = numbers[i].number(-kLargest, kLargest);
  }
  d.points = node["points"].integer(0, 1000000);
  d.rms_um = node["rms_um"].number(0, kLargest);
  d.most_off_um = node["most_off_um"].number(0, kLargest);
  d.rms_off_um = node["rms_off_um"].number(0, kLargest);
  return d;
}

}  // namespace

Json printer_json(const Printer& p) {
  Json json = {{"name", p.name},
               {"width_px", p.width_px},
               {"height_px", p.height_px},
               {"pixel_x_um", p.pixel_x_um},
               {"pixel_y_um", p.pixel_y_um},
               {"bit_depth", p.bit_depth},
               {"wavelength_nm", p.wavelength_nm},
               {"calibration", calibration_json(p.calibration)},
               {"max_speed_mm_h", p.max_speed_mm_h},
               {"travel_mm", p.travel_mm}};
  if (is_relative(p)) json["unit"] = unit_in_files(p.unit);
  if (p.uv) {
    json["uv"] = {{"wavelength_nm", p.uv->wavelength_nm},
                  {"kind", p.uv->patterned ? "patterned" : "flood"},
                  {"calibration", calibration_json(p.uv->calibration)}};
    if (is_given(p.uv->spread)) json["uv"]["spread"] = spread_json(p.uv->spread);
  }
  if (is_given(p.spread)) json["spread"] = spread_json(p.spread);
  if (p.orientation) json["orientation"] = orientation_json(*p.orientation);
  if (p.flat_field) json["flat_field"] = field_json(*p.flat_field, kFlatFieldEntry);
  if (p.uv_flat_field) json["uv_flat_field"] = field_json(*p.uv_flat_field, kUvFlatFieldEntry);
  if (p.grey == GreyLight::pulsed) json["grey"] = "pulsed";
  if (p.fill_factor < 1) json["fill_factor"] = p.fill_factor;
  if (p.distortion) json["distortion"] = distortion_json(*p.distortion);
  for (const auto& [key, member] : kWindowKeys) {
    if (p.window.*member > 0) json["window"][key] = p.window.*member;
  }
  if (p.resin_depth_um > 0) json["resin_depth_um"] = p.resin_depth_um;
  if (p.platform_reflectance > 0) json["platform_reflectance"] = p.platform_reflectance;
  if (p.lifts == Lifts::none) json["lifts"] = "none";
  if (p.lift_exchange >= 0) json["lift_exchange"] = p.lift_exchange;
  if (p.model) json["model"] = true;
  if (p.lift_exchange_sd > 0) json["lift_exchange_sd"] = p.lift_exchange_sd;
  if (p.suction_limit_pa > 0) json["suction_limit_pa"] = p.suction_limit_pa;
  if (p.adhesion_kpa > 0) json["adhesion_kpa"] = p.adhesion_kpa;
  if (p.lift_motion) {
    for (const auto& [key, member] : kMotionFigures)
      json["lift_motion"][key] = *p.lift_motion.*member;
  }
  if (p.vial) {
    json["vial"] = {{"outer_mm", p.vial->outer_mm},
                    {"inner_mm", p.vial->inner_mm},
                    {"n_outside", p.vial->n_outside},
                    {"n_wall", p.vial->n_wall}};
    if (p.vial->jacket_outer_mm > 0) {
      json["vial"].update({{"jacket_outer_mm", p.vial->jacket_outer_mm},
                           {"jacket_inner_mm", p.vial->jacket_inner_mm},
                           {"n_between", p.vial->n_between},
                           {"n_jacket", p.vial->n_jacket}});
    }
    json["vial"].update(shape_json(*p.vial));
  }
  if (p.optics) {
    json["optics"] = {{"kind", name_of(p.optics->kind)},
                      {"distance_mm", p.optics->distance_mm},
                      {"half_angle_deg", p.optics->half_angle_deg},
                      {"rays_per_pixel", p.optics->rays_per_pixel},
                      {"axis_right_px", p.optics->axis_right_px},
                      {"axis_up_px", p.optics->axis_up_px}};
    if (p.optics->tilt_deg != 0) json["optics"]["tilt_deg"] = p.optics->tilt_deg;
  }
  if (p.bath) {
    json["bath"] = {{"window_mm", p.bath->window_mm},
                    {"n", p.bath->n},
                    {"wall_mm", p.bath->wall_mm},
                    {"n_wall", p.bath->n_wall}};
  }
  if (p.rotation) {
    json["rotation"] = {{"deg_s", p.rotation->deg_s},
                        {"direction", name_of(p.rotation->direction)},
                        {"max_fps", p.rotation->max_fps}};
    for (const AxisWobble& w : p.rotation->wobble) {
      json["rotation"]["wobble"].push_back({w.angle_deg, w.right_px, w.up_px});
    }
  }
  return json;
}

namespace {

/// Figures of a chemistry, with their keys and the most that they may be; all of them above 0 but for
/// those that may be 0.
struct ChemistryFigure {
  const char* key;
  double Chemistry::*member;
  double most;
  bool above_0;
};
constexpr ChemistryFigure kChemistryFigures[] = {
    {"groups_mol_l", &Chemistry::groups_mol_l, kMostConcentration, true},
    {"initiator_mol_l", &Chemistry::initiator_mol_l, kMostConcentration, true},
    {"oxygen_mol_l", &Chemistry::oxygen_mol_l, kMostConcentration, false},
    {"inhibitor_mol_l", &Chemistry::inhibitor_mol_l, kMostConcentration, false},
    {"wavelength_nm", &Chemistry::wavelength_nm, 2000, true},
    {"absorptivity_e_l_mol_cm", &Chemistry::absorptivity_l_mol_cm, kMostAbsorptivity * 3, true},
    {"other_absorption_per_cm", &Chemistry::other_absorption_per_cm, 1e6, false},
    {"quantum_yield", &Chemistry::quantum_yield, 1, true},
    {"initiation_l_mol_s", &Chemistry::initiation_l_mol_s, kMostRate, true},
    {"propagation_l_mol_s", &Chemistry::propagation_l_mol_s, kMostRate, true},
    {"termination_pairs_l_mol_s", &Chemistry::termination_l_mol_s, kMostRate, true},
    {"oxygen_l_mol_s", &Chemistry::oxygen_l_mol_s, kMostRate, false},
    {"initiator_oxygen_l_mol_s", &Chemistry::initiator_oxygen_l_mol_s, kMostRate, false},
    {"inhibitor_l_mol_s", &Chemistry::inhibitor_l_mol_s, kMostRate, false},
    {"gel_conversion", &Chemistry::gel_conversion, 1, true},
    {"temperature_k", &Chemistry::temperature_k, 1000, true},
};
constexpr std::pair<const char*, std::optional<double> Chemistry::*> kDiffusivities[] = {
    {"initiator_um2_s", &Chemistry::initiator_um2_s},
    {"radical_um2_s", &Chemistry::radical_um2_s},
    {"oxygen_um2_s", &Chemistry::oxygen_um2_s},
    {"inhibitor_um2_s", &Chemistry::inhibitor_um2_s},
};

Json chemistry_json(const Chemistry& c) {
  Json json = Json::object();
  if (!c.family.empty()) json["family"] = c.family;
  for (const ChemistryFigure& f : kChemistryFigures) json[f.key] = c.*f.member;
  for (const auto& [key, member] : kDiffusivities) {
    if (c.*member) json[key] = *(c.*member);
  }
  return json;
}

Chemistry read_chemistry(const Node& node) {
  Chemistry c;
  if (node.has("family")) c.family = node["family"].string();
  for (const ChemistryFigure& f : kChemistryFigures) {
    c.*f.member = f.above_0 ? node[f.key].positive(f.most) : node[f.key].number(0, f.most);
  }
  if (c.gel_conversion >= 1) node["gel_conversion"].fail("a number below 1");
  for (const auto& [key, member] : kDiffusivities) {
    if (node.has(key)) c.*member = node[key].number(0, kMostDiffusivity);
  }
  return c;
}

}  // namespace

Json resin_json(const Resin& r) {
  Json json = {{"name", r.name},
               {"model", name_of(r.model)},
               {"m", r.m},
               {"absorbance_height10_um", r.absorbance_height10_um},
               {"critical_dose_mj_cm3", r.critical_dose_mj_cm3},
               {"critical_dose_prime", r.critical_dose_prime},
               {"gel_dose_mj_cm3", r.gel_dose_mj_cm3},
               {"dose_factor", r.dose_factor}};
  const auto given = [&](const char* key, double value) {
    if (value > 0) json[key] = value;
  };
  if (is_relative(r)) json["unit"] = unit_in_files(r.unit);
  given("gel_a_mj_cm2", r.gel_a_mj_cm2);
  given("gel_b_sqrt_mw_cm2_s", r.gel_b_sqrt_mw_cm2_s);
  given("active_absorption_per_cm", r.active_absorption_per_cm);
  given("n", r.n);
  given("inhibition_dose_mj_cm3", r.inhibition_dose_mj_cm3);
  given("inhibition_resupply_mj_cm3_s", r.inhibition_resupply_mj_cm3_s);
  given("dose_diffusion_m2_s", r.dose_diffusion_m2_s);
  given("scatter_um2_per_um", r.scatter_um2_per_um);
  if (r.turbidity.extinction_per_cm > 0) {
    json["extinction_per_cm"] = r.turbidity.extinction_per_cm;
    json["albedo"] = r.turbidity.albedo;
    json["anisotropy"] = r.turbidity.anisotropy;
  }
  given("viscosity_pa_s", r.viscosity_pa_s);
  given("green_strength", r.green_strength);
  given("wavelength_nm", r.wavelength_nm);
  if (!r.tuned_with.empty()) json["tuned_with"] = r.tuned_with;
  if (!r.display.empty()) json["display"] = r.display;
  if (r.areal_critical_dose) json["areal_critical_dose"] = true;
  if (r.areal_gel_dose) json["areal_gel_dose"] = true;
  if (std::isfinite(r.inhibitor_life_s)) json["inhibitor_life_s"] = r.inhibitor_life_s;
  if (r.inhibition) {
    json["inhibition"] = {{"beta", r.inhibition->beta},
                          {"absorbance_height10_um", r.inhibition->absorbance_height10_um},
                          {"m", r.inhibition->m},
                          {"critical_dose_prime", r.inhibition->critical_dose_prime}};
    if (r.inhibition->wavelength_nm > 0) {
      json["inhibition"]["wavelength_nm"] = r.inhibition->wavelength_nm;
    }
  }
  if (r.bleaching) {
    json["bleaching"] = {{"absorbance_height10_um", r.bleaching->absorbance_height10_um},
                         {"dose_mj_cm2", r.bleaching->dose_mj_cm2}};
  }
  if (r.chemistry) json["chemistry"] = chemistry_json(*r.chemistry);
  if (r.shrinkage.any()) json["shrinkage"] = own_json<Json>(r.shrinkage.to_json());
  return json;
}

namespace {

/// A stack says nothing of mW/cm².
LightUnit read_unit(const Node& node) {
  if (!node.has("unit")) return LightUnit::mw_cm2;
  node["unit"].choice({std::string(unit_in_files(LightUnit::brightest))});
  return LightUnit::brightest;
}

}  // namespace

Printer read_printer(const Node& node) {
  Printer p;
  p.name = node["name"].string();
  p.width_px = node["width_px"].integer(1, kMostPixelsAcross);
  p.height_px = node["height_px"].integer(1, kMostPixelsAcross);
  p.pixel_x_um = node["pixel_x_um"].positive();
  p.pixel_y_um = node["pixel_y_um"].positive();
  p.bit_depth = node["bit_depth"].integer(1, 8);
  p.wavelength_nm = node["wavelength_nm"].number(0, kLargest);
  p.calibration = read_calibration(node["calibration"]);
  if (p.calibration.front().level != 0 || p.calibration.back().level != p.levels() - 1) {
    node["calibration"].fail("points from level 0 to level " + std::to_string(p.levels() - 1));
  }
  p.unit = read_unit(node);
  p.spread = read_spread(node, p);
  if (node.has("uv")) {
    const Node uv = node["uv"];
    p.uv = UvLamp{uv["wavelength_nm"].number(0, kLargest),
                  uv["kind"].choice({"flood", "patterned"}) == 1,
                  read_calibration(uv["calibration"]), read_spread(uv, p)};
  }
  if (node.has("orientation")) p.orientation = read_orientation(node["orientation"]);
  if (node.has("flat_field")) p.flat_field = read_field(node["flat_field"]);
  if (node.has("uv_flat_field")) p.uv_flat_field = read_field(node["uv_flat_field"]);
  if (node.has("distortion")) p.distortion = read_distortion(node["distortion"]);
  if (node.has("window")) {
    for (const auto& [key, member] : kWindowKeys) {
      if (node["window"].has(key)) p.window.*member = node["window"][key].positive();
    }
  }
  read_tomography(node, p);
  p.max_speed_mm_h = node["max_speed_mm_h"].number(0, kLargest);
  p.travel_mm = node["travel_mm"].number(0, kLargest);
  if (node.has("fill_factor")) {
    p.fill_factor = node["fill_factor"].positive();
    if (p.fill_factor > 1) node["fill_factor"].fail("at most 1");
  }
  if (node.has("grey")) {
    p.grey = node["grey"].choice({"steady", "pulsed"}) == 1 ? GreyLight::pulsed : GreyLight::steady;
  }
  if (node.has("resin_depth_um")) {
    p.resin_depth_um = node["resin_depth_um"].number(0, kMostDepthUm);
  }
  if (node.has("platform_reflectance")) {
    p.platform_reflectance = node["platform_reflectance"].number(0, 1);
  }
  if (node.has("lifts")) p.lifts = Lifts(node["lifts"].choice({"none", "each"}));
  if (node.has("lift_exchange")) p.lift_exchange = node["lift_exchange"].number(0, 1);
  p.model = node.has("model") && node["model"].flag();
  if (node.has("lift_exchange_sd")) p.lift_exchange_sd = node["lift_exchange_sd"].number(0, 1);
  if (node.has("suction_limit_pa")) {
    p.suction_limit_pa = node["suction_limit_pa"].number(0, kMostSuctionPa);
  }
  if (node.has("adhesion_kpa")) p.adhesion_kpa = node["adhesion_kpa"].number(0, kMostAdhesionKpa);
  if (node.has("lift_motion")) {
    LiftMotion motion;
    const Node m = node["lift_motion"];
    for (const auto& [key, member] : kMotionFigures) {
      if (m.has(key)) motion.*member = m[key].number(0, kLargest);
    }
    if (motion.up_mm > 0 && !(motion.up_mm_s > 0 && motion.back_mm_s > 0)) {
      m["up_mm"].fail("speeds up and back above 0 with it");
    }
    p.lift_motion = motion;
  }
  return p;
}

Resin read_resin(const Node& node) {
  Resin r;
  r.name = node["name"].string();
  constexpr CureModelKind models[] = {CureModelKind::jacobs, CureModelKind::kinetic,
                                      CureModelKind::gel_time};
  r.model = models[node["model"].choice({"jacobs", "kinetic", "gel-time"})];
  r.unit = read_unit(node);
  r.m = node["m"].positive(2);
  r.absorbance_height10_um = node["absorbance_height10_um"].positive();
  r.critical_dose_mj_cm3 = node["critical_dose_mj_cm3"].number(0, kLargest);
  r.critical_dose_prime = node["critical_dose_prime"].number(0, kLargest);
  r.gel_dose_mj_cm3 = node["gel_dose_mj_cm3"].number(0, kLargest);
  if (r.has_gel_time()) {
    r.gel_a_mj_cm2 = node["gel_a_mj_cm2"].positive();
    r.gel_b_sqrt_mw_cm2_s = node["gel_b_sqrt_mw_cm2_s"].positive();
  } else if (r.critical_dose_mj_cm3 == 0 && r.critical_dose_prime == 0) {
    node["critical_dose_mj_cm3"].fail("a number above 0, or a critical_dose_prime above 0");
  }
  if (node.has("dose_factor")) r.dose_factor = node["dose_factor"].positive();
  const auto given = [&](const char* key, double least, double most) {
    return node.has(key) ? node[key].number(least, most) : 0;
  };
  // A stack says nothing of it where all that absorbs cures.
  r.active_absorption_per_cm = given("active_absorption_per_cm", 0, absorption_per_cm(r));
  r.n = given("n", 1, 3);
  r.inhibition_dose_mj_cm3 = given("inhibition_dose_mj_cm3", 0, kLargest);
  r.inhibition_resupply_mj_cm3_s = given("inhibition_resupply_mj_cm3_s", 0, kLargest);
  r.dose_diffusion_m2_s = given("dose_diffusion_m2_s", 0, kMostDiffusion);
  r.scatter_um2_per_um = given("scatter_um2_per_um", 0, kMostScatter);
  if (node.has("extinction_per_cm")) {
    r.turbidity = {node["extinction_per_cm"].positive(), node["albedo"].number(0, 1),
                   node["anisotropy"].number(0, 0.995)};
  }
  r.viscosity_pa_s = given("viscosity_pa_s", 0, kMostViscosity);
  r.green_strength = given("green_strength", 1, 10);
  r.wavelength_nm = given("wavelength_nm", 0, kLargest);
  if (node.has("tuned_with")) r.tuned_with = node["tuned_with"].string();
  if (node.has("display")) r.display = node["display"].string();
  r.areal_critical_dose = node.has("areal_critical_dose") && node["areal_critical_dose"].flag();
  r.areal_gel_dose = node.has("areal_gel_dose") && node["areal_gel_dose"].flag();
  if (node.has("inhibitor_life_s")) {
    r.inhibitor_life_s = node["inhibitor_life_s"].number(0, kMostLifeS);
  }
  if (node.has("inhibition")) {
    const Node i = node["inhibition"];
    r.inhibition = Inhibition{i["beta"].positive(), i["absorbance_height10_um"].positive(),
                              i["m"].positive(2), i["critical_dose_prime"].number(0, kLargest),
                              i.has("wavelength_nm") ? i["wavelength_nm"].number(0, kLargest) : 0};
  }
  if (node.has("bleaching")) {
    const Node b = node["bleaching"];
    r.bleaching = Bleaching{b["absorbance_height10_um"].positive(), b["dose_mj_cm2"].positive()};
    if (r.bleaching->absorbance_height10_um < r.absorbance_height10_um) {
      b["absorbance_height10_um"].fail("at least that of the fresh resin");
    }
  }
  if (node.has("chemistry")) r.chemistry = read_chemistry(node["chemistry"]);
  if (node.has("shrinkage")) r.shrinkage = read_shrinkage(node["shrinkage"]);
  return r;
}

Shrinkage read_shrinkage(const Node& node) {
  Shrinkage s;
  s.plane_per_cent = node["plane_per_cent"].number(Shrinkage::kLeast, Shrinkage::kMost);
  s.z_per_cent = node["z_per_cent"].number(Shrinkage::kLeast, Shrinkage::kMost);
  s.growth_um = node["first_layers_growth_um"].number(0, Shrinkage::kMostGrowthUm);
  s.height_um = node["first_layers_height_um"].positive(Shrinkage::kMostHeightUm);
  return s;
}

}  // namespace slicecorr::detail
