// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printers, as text and JSON.
#include <fmt/format.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "describe.hpp"
#include "describe_lines.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

std::string reach_line(const Printer& p, double n, const std::string& what) {
  return line("reach", fmt::format("light from all sides up to {:.4g} mm from the axis, in {}",
                                   reach_mm(p, n), what));
}

/// What makes a printer a tomographic one; empty for others. `in`: the resin asked for.
std::string tomography_text(const Printer& p, const Resin* in) {
  std::string out;
  if (p.vial) {
    const Vial& v = *p.vial;
    out += "\nVial\n";
    if (v.shape == VialShape::square) {
      out +=
          line("across",
               fmt::format("square, {:g} mm outside, walls of {:g} mm, {}", v.side_mm, v.wall_mm,
                           v.corner_mm > 0 ? fmt::format("corners of {:g} mm radius", v.corner_mm)
                                           : std::string("sharp corners")));
    } else if (v.shape == VialShape::outline) {
      out += line(
          "across",
          fmt::format("an outline of {} corners, {:g} mm from the axis at most, walls of {:g} mm",
                      v.outline.size(), v.outer_mm, v.wall_mm));
    } else {
      out += line("across", fmt::format("{:g} mm outside, {:g} mm inside (radii {:g} and {:g})",
                                        2 * v.outer_mm, 2 * v.inner_mm, v.outer_mm, v.inner_mm));
    }
    for (const Rod& rod : v.rods) {
      out += line(rod.n > 0 ? "glass rod" : "metal rod",
                  fmt::format("{:g} mm at ({:g}, {:g}) mm, {}", rod.diameter_mm, rod.x_mm, rod.y_mm,
                              rod.n > 0 ? fmt::format("of index {:g}", rod.n)
                                        : fmt::format("reflects {:g} %", 100 * rod.reflects)));
    }
    out += line("refractive index",
                fmt::format("{:g} outside{}, {:g} of the wall", v.n_outside,
                            v.n_outside < 1.01 ? " (air)" : " (a bath)", v.n_wall));
    if (v.jacket_outer_mm > 0) {
      out += line("second wall",
                  fmt::format("radii {:g} and {:g} mm, of index {:g}; {:g} between the walls",
                              v.jacket_outer_mm, v.jacket_inner_mm, v.n_jacket, v.n_between));
    }
    if (v.traced()) {
      out += line("light", "is traced; slicecorr tomo limits says which angles reach which resin");
    } else if (p.optics) {
      if (in) {
        out += reach_line(p, index_of(*in), fmt::format("{} (n = {:g})", in->name, in->n));
      } else if (v.n_outside < 1.01) {
        out += reach_line(p, 1.5, "a resin of index 1.5 (--resin names one)");
      } else {
        out += reach_line(p, v.n_outside, "a resin of the bath's index (--resin names another)");
      }
    }
    if (in) {
      out += line("alpha R", fmt::format("{:.4g}: {:.3g} % of the light comes to the axis",
                                         absorption_per_mm(*in) * v.inner_mm,
                                         100 * std::exp(-absorption_per_mm(*in) * v.inner_mm)));
    }
  }
  if (p.bath) {
    const Bath& b = *p.bath;
    out += "\nBath\n";
    out += line("window", fmt::format("{:g} mm before the axis, {:g} mm thick, of index {:g}",
                                      b.window_mm, b.wall_mm, b.n_wall));
    out += line("liquid", fmt::format("of index {:g}", b.n));
  }
  if (p.optics) {
    const Optics& o = *p.optics;
    out += "\nOptics\n";
    out += line("kind", o.kind == OpticsKind::pinhole
                            ? fmt::format("pinhole: light from a point {:g} mm from the axis",
                                          o.distance_mm)
                            : "telecentric: parallel light");
    if (o.half_angle_deg > 0) {
      out += line("cone of a pixel",
                  fmt::format("{:g} degrees from its middle, {} ray{}", o.half_angle_deg,
                              o.rays_per_pixel, o.rays_per_pixel == 1 ? "" : "s"));
    }
    if (o.axis_right_px != 0 || o.axis_up_px != 0) {
      out += line("axes in the image", fmt::format("{:g} pixels right, {:g} up of its middle",
                                                   o.axis_right_px, o.axis_up_px));
    }
    if (o.tilt_deg != 0) {
      out += line("tilt", fmt::format("the axis leans by {:g} degrees to the right", o.tilt_deg));
    }
  }
  if (p.rotation) {
    const Rotation& r = *p.rotation;
    out += "\nRotation\n";
    out += line("speed", fmt::format("{:g} degrees a second, {:.4g} s a turn, {} seen from above",
                                     r.deg_s, r.turn_s(), name_of(r.direction)));
    if (r.max_fps > 0) {
      out += line("frames per turn",
                  fmt::format("at most {}, at {:g} a second", most_frames_per_turn(r), r.max_fps));
    }
    if (!r.wobble.empty()) {
      out += line("wobble", fmt::format("{} angles, up to {:.3g} pixels to a side", r.wobble.size(),
                                        most_wobble_px(r)));
    }
  }
  return out;
}

/// The vat of a printer that prints with beams; empty for others. `in`: the resin asked for.
std::string beams_text(const std::optional<BeamVat>& vat, const Printer& p, const Resin* in) {
  if (!vat) return {};
  std::string out = "\nBeams\n";
  const auto& mm = vat->inside_mm;
  out += line("vat", fmt::format("{:g} x {:g} x {:g} mm inside", mm[0], mm[1], mm[2]));
  for (const BeamWay& w : vat->ways) {
    out += line(("from " + side_of(w)).c_str(),
                fmt::format("display {}, about column {:g}, row {:g}{}", w.display, w.column_px,
                            w.row_px, w.mirror ? ", mirrored" : ""));
  }
  out += line("displays", fmt::format("{}", vat->displays()));
  if (vat->phase) {
    out +=
        line("light", fmt::format("delayed by pixels of {:g} um, {} levels, behind a lens of {:g} "
                                  "mm; images {:g} mm right, {:g} mm up",
                                  vat->phase->pitch_um, vat->phase->levels, vat->phase->focal_mm,
                                  vat->phase->dx_mm, vat->phase->dy_mm));
  } else {
    out += line("image",
                fmt::format("up to {:.4g} x {:.4g} mm on a display of its own",
                            p.width_px * p.pixel_x_um * 1e-3, p.height_px * p.pixel_y_um * 1e-3));
  }
  if (in) {
    const double left = std::exp(-absorption_per_cm(*in) * 0.1 * mm[0]);
    out += line("through the vat", fmt::format("{:.3g} % of the light, along x", 100 * left));
  }
  return out;
}

}  // namespace

std::string describe_printer(const Printer& p, const std::string& path, const Resin* in) {
  const toml::table root_table = parse_toml(read_text_file(path), path);
  const TomlTable root(root_table, path);
  std::string out =
      fmt::format("{}   printer, version {}\n", p.name, root.integer("version", 1, 1000000000, 1));
  for (const char* key : {"maker", "product", "notes"}) out += line(key, root.text(key, ""));
  out += line("file", path);
  out += "\nDisplay\n";
  out += line("pixels",
              fmt::format("{} x {} of {:g} x {:g} um: {:.4g} x {:.4g} mm", p.width_px, p.height_px,
                          p.pixel_x_um, p.pixel_y_um, p.width_px * p.pixel_x_um / 1000,
                          p.height_px * p.pixel_y_um / 1000));
  out += line("grey levels", fmt::format("{}", p.levels()));
  const TomlTable display = root.required_table("display");
  if (const std::string field = display.text("flat_field", ""); !field.empty()) {
    out += line("flat-field",
                fmt::format("{}: least {:.4g}, mean {:.4g} of the brightest place", field,
                            display.number("flat_field_least", 0, 1, true).value_or(0),
                            display.number("flat_field_mean", 0, 1, true).value_or(0)));
    if (p.flat_field) out += line("", "curing light " + light_in_words(p));
  }
  if (p.distortion) {
    out += line("distortion", display.text("distortion", "") + ": " + distortion_in_words(p));
  }
  out += "\nCuring light\n";
  if (p.wavelength_nm > 0) out += line("wavelength", fmt::format("{:g} nm", p.wavelength_nm));
  if (light_is_measured(p)) {
    const double low = p.calibration.front().intensity_mw_cm2;
    const double high = p.calibration.back().intensity_mw_cm2;
    out += line("intensity", fmt::format("{:g} to {:g} {} at the {}, {} calibration points", low,
                                         high, unit_of_light(p.unit), p.vial ? "axis" : "window",
                                         p.calibration.size()));
    if (low > 0) {
      out += line("contrast", fmt::format("{:.4g} : 1 (black still shines)", high / low));
    }
  } else {
    out += line("intensity", how_to_measure_light(p));
  }
  if (p.grey == GreyLight::pulsed) {
    out += line("grey", "by pulses: full light for a share of the time");
  }
  if (!p.spread.none()) out += line("spread", spread_in_words(p.spread));
  if (p.uv) {
    out += "\nUV light\n";
    if (p.uv->wavelength_nm > 0)
      out += line("wavelength", fmt::format("{:g} nm", p.uv->wavelength_nm));
    out +=
        line("kind", p.uv->patterned ? "patterned: an image per slice" : "flood: the whole window");
    out += line("intensity",
                fmt::format("{:g} to {:g} mW/cm²", p.uv->min_mw_cm2(), p.uv->max_mw_cm2()));
    if (p.uv_flat_field) {
      const FlatField& field = *p.uv_flat_field;
      out += line("flat-field", fmt::format("{:.3g} to {:.3g} % of the calibration",
                                            100.0 * field.least() / field.reference,
                                            100.0 * field.greatest() / field.reference));
    }
    if (!p.uv->spread.none()) out += line("spread", spread_in_words(p.uv->spread));
  }
  if (p.max_speed_mm_h > 0 || p.travel_mm > 0) {
    out += "\nStage\n";
    if (p.max_speed_mm_h > 0) out += line("fastest", fmt::format("{:g} mm/h", p.max_speed_mm_h));
    if (p.travel_mm > 0) out += line("travel", fmt::format("{:g} mm", p.travel_mm));
  }
  std::string vat;
  if (p.resin_depth_um > 0) {
    vat += line("resin", fmt::format("{:g} um deep", p.resin_depth_um));
  }
  if (p.platform_reflectance > 0) {
    vat += line("platform",
                fmt::format("sends back {:.4g} % of the light", 100 * p.platform_reflectance));
  }
  if (p.suction_limit_pa > 0) {
    vat += line("suction", fmt::format("at most {:g} Pa under the part", p.suction_limit_pa));
  }
  if (!vat.empty()) out += "\nVat\n" + vat;
  out += tomography_text(p, in);
  out += beams_text(parse_beam_vat(read_text_file(path), path, p), p, in);
  std::map<std::string, std::string> provenance;
  if (const auto table = root.table("provenance")) {
    for (const auto& [key, node] : table->raw()) {
      provenance[std::string(key.str())] = node.value_or(std::string("..."));
    }
  }
  return out + provenance_text(provenance);
}

std::string printer_json(const Printer& p, const std::string& path) {
  nlohmann::ordered_json j;
  j["kind"] = "printer";
  j["name"] = p.name;
  j["width_px"] = p.width_px;
  j["height_px"] = p.height_px;
  j["pixel_um"] = {p.pixel_x_um, p.pixel_y_um};
  j["bit_depth"] = p.bit_depth;
  if (p.wavelength_nm > 0) j["wavelength_nm"] = p.wavelength_nm;
  const auto curve = [](const std::vector<CalibrationPoint>& points) {
    auto list = nlohmann::ordered_json::array();
    for (const CalibrationPoint& c : points) list.push_back({c.level, c.intensity_mw_cm2});
    return list;
  };
  if (light_is_measured(p)) {
    j["unit"] = unit_in_files(p.unit);
    j["calibration"] = curve(p.calibration);
  } else {
    j["calibration"] = kToBeMeasured;
  }
  // Which files it takes, by their endings.
  if (const auto reads = endings_read_by(path); !reads.empty()) j["reads"] = reads;
  const auto spread_in = [](nlohmann::ordered_json& at, const LightSpread& spread) {
    for (const SpreadGaussian& g : spread.gaussians) at["spread"].push_back({g.sigma_um, g.weight});
    if (!spread.picture) return;
    at["spread"] = {{"width_px", spread.picture->width_px},
                    {"height_px", spread.picture->height_px},
                    {"pitch_um", spread.picture->pitch_um}};
  };
  spread_in(j, p.spread);
  if (p.uv) {
    j["uv"]["kind"] = p.uv->patterned ? "patterned" : "flood";
    if (p.uv->wavelength_nm > 0) j["uv"]["wavelength_nm"] = p.uv->wavelength_nm;
    j["uv"]["calibration"] = curve(p.uv->calibration);
    spread_in(j["uv"], p.uv->spread);
  }
  if (p.max_speed_mm_h > 0) j["max_speed_mm_h"] = p.max_speed_mm_h;
  if (p.travel_mm > 0) j["travel_mm"] = p.travel_mm;
  if (p.resin_depth_um > 0) j["resin_depth_um"] = p.resin_depth_um;
  if (p.platform_reflectance > 0) j["platform_reflectance"] = p.platform_reflectance;
  if (p.suction_limit_pa > 0) j["suction_limit_pa"] = p.suction_limit_pa;
  if (p.vial) {
    j["vial"] = {{"outer_mm", p.vial->outer_mm},
                 {"inner_mm", p.vial->inner_mm},
                 {"n_outside", p.vial->n_outside},
                 {"n_wall", p.vial->n_wall}};
    if (p.vial->jacket_outer_mm > 0) {
      j["vial"].update({{"jacket_outer_mm", p.vial->jacket_outer_mm},
                        {"jacket_inner_mm", p.vial->jacket_inner_mm},
                        {"n_between", p.vial->n_between},
                        {"n_jacket", p.vial->n_jacket}});
    }
    if (p.vial->traced()) j["vial"]["shape"] = name_of(p.vial->shape);
    if (p.vial->shape != VialShape::round) j["vial"]["wall_mm"] = p.vial->wall_mm;
    if (p.vial->shape == VialShape::square) {
      j["vial"]["side_mm"] = p.vial->side_mm;
      j["vial"]["corner_mm"] = p.vial->corner_mm;
    }
    for (const FlatPoint& c : p.vial->outline) {
      j["vial"]["outline"].push_back({c.x_mm, c.y_mm});
    }
    for (const Rod& rod : p.vial->rods) {
      j["vial"]["rods"].push_back({{"x_mm", rod.x_mm},
                                   {"y_mm", rod.y_mm},
                                   {"diameter_mm", rod.diameter_mm},
                                   {"n", rod.n},
                                   {"reflects", rod.reflects}});
    }
  }
  if (p.bath) {
    j["bath"] = {{"window_mm", p.bath->window_mm},
                 {"n", p.bath->n},
                 {"wall_mm", p.bath->wall_mm},
                 {"n_wall", p.bath->n_wall}};
  }
  if (p.fill_factor < 1) j["fill_factor"] = p.fill_factor;
  if (p.optics) {
    const Optics& o = *p.optics;
    j["optics"]["kind"] = name_of(o.kind);
    if (o.kind == OpticsKind::pinhole) j["optics"]["distance_mm"] = o.distance_mm;
    j["optics"]["half_angle_deg"] = o.half_angle_deg;
    j["optics"]["rays_per_pixel"] = o.rays_per_pixel;
    j["optics"]["axis_right_px"] = o.axis_right_px;
    j["optics"]["axis_up_px"] = o.axis_up_px;
    if (o.tilt_deg != 0) j["optics"]["tilt_deg"] = o.tilt_deg;
  }
  if (p.rotation) {
    j["rotation"] = {{"deg_s", p.rotation->deg_s},
                     {"direction", name_of(p.rotation->direction)},
                     {"turn_s", p.rotation->turn_s()}};
    if (p.rotation->max_fps > 0) {
      j["rotation"]["max_fps"] = p.rotation->max_fps;
      j["rotation"]["frames_per_turn"] = most_frames_per_turn(*p.rotation);
    }
    for (const AxisWobble& w : p.rotation->wobble) {
      j["rotation"]["wobble"].push_back({w.angle_deg, w.right_px, w.up_px});
    }
  }
  if (const auto vat = parse_beam_vat(read_text_file(path), path, p)) {
    j["beams"]["vat_mm"] = vat->inside_mm;
    j["beams"]["displays"] = vat->displays();
    for (const BeamWay& w : vat->ways) {
      j["beams"]["ways"].push_back({{"from", side_of(w)},
                                    {"display", w.display},
                                    {"middle_px", {w.column_px, w.row_px}},
                                    {"mirror", w.mirror}});
    }
    if (vat->phase) j["beams"]["focal_mm"] = vat->phase->focal_mm;
  }
  j["path"] = path;
  return j.dump(2);
}

}  // namespace slicecorr::resinctl
