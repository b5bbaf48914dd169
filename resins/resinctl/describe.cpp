// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "describe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "slicecorr/beam_vat.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

/// How many characters a UTF-8 text has.
std::size_t width_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string line(const char* what, const std::string& value) {
  return value.empty() ? "" : fmt::format("  {:<22}{}\n", what, value);
}

/// Four digits, without an exponent for large numbers.
std::string four_digits(double value) {
  return value >= 1e4 && value < 1e15 ? fmt::format("{:.0f}", value) : fmt::format("{:.4g}", value);
}

/// A dose analogue in its unit.
std::string prime(double value, double m, LightUnit unit = LightUnit::mw_cm2) {
  return m == 1.0 ? fmt::format("{} {}", four_digits(value), unit_of_dose(unit))
                  : fmt::format("{} (mW/cm²)^{:g}·s", four_digits(value), m);
}

bool gel_is_known(const ResinRecord& r) {
  if (r.resin.gel_dose_mj_cm3 > 0 || r.resin.has_gel_time() || is_relative(r.resin)) return true;
  // Without a factor, a kinetic file gives the dose aimed at.
  return r.resin.critical_dose_prime > 0 && r.text.find("dose_factor") != std::string::npos;
}

/// A and B of a time to gel, `times` as long.
std::string gel_time_text(const Resin& resin, double times) {
  return fmt::format("{}/i + {}/sqrt(i) s", four_digits(times * resin.gel_a_mj_cm2),
                     four_digits(times * resin.gel_b_sqrt_mw_cm2_s));
}

std::string dose_line(const char* what, const ResinFigures& f, const Resin& resin, bool aim) {
  const double m = resin.m;
  if (is_relative(resin)) {
    return line(what, fmt::format("{} {} areal", four_digits(aim ? f.aim_mj_cm2 : f.gel_mj_cm2),
                                  unit_of_dose(resin.unit)));
  }
  if (m == 1.0) {
    return line(what, fmt::format("{} mJ/cm² areal, {} mJ/cm³ volumetric",
                                  four_digits(aim ? f.aim_mj_cm2 : f.gel_mj_cm2),
                                  four_digits(aim ? f.aim_mj_cm3 : f.gel_mj_cm3)));
  }
  return line(what,
              fmt::format("{} (mW/cm²)^{:g}·s areal, {} (mW/cm³)^{:g}·s volumetric",
                          four_digits(aim ? f.aim_prime : f.gel_prime), m,
                          four_digits(aim ? f.aim_prime_volumetric : f.gel_prime_volumetric), m));
}

std::string provenance_text(const std::map<std::string, std::string>& provenance) {
  std::string out;
  for (const auto& [key, value] : provenance) out += line(key.c_str(), value);
  return out.empty() ? "" : "\nWhere it comes from\n" + out;
}

std::string in_plain_words(const ResinRecord& r, const ResinFigures& f) {
  const double m = r.resin.m;
  std::string out = "\nWhat correction aims at\n";
  if (r.resin.has_gel_time()) {
    const GelTime g{r.resin.gel_a_mj_cm2, r.resin.gel_b_sqrt_mw_cm2_s};
    const double even = std::pow(g.A / g.B, 2);
    return out +
           fmt::format(
               "  Light of i mW/cm² gels the resin in {}; correction aims at {:.4g} times that.\n"
               "  Below {:.3g} mW/cm² the dose rules (m near 1), above it the root of the "
               "intensity (m near 1/2):\n"
               "  at 1, 10 and 100 mW/cm² m is {:.3f}, {:.3f} and {:.3f}.\n",
               gel_time_text(r.resin, 1 / f.dose_factor), f.dose_factor, even, local_exponent(g, 1),
               local_exponent(g, 10), local_exponent(g, 100));
  }
  if (is_relative(r.resin)) {
    return out +
           fmt::format(
               "  {}: the brightest level of the printer gels a surface in that time. Doses are "
               "in its unit, and go with its file alone.\n",
               prime(f.aim_prime, m, r.resin.unit));
  }
  if (gel_is_known(r)) {
    out += fmt::format(
        "  The resin gels at {}. Correction aims at {:.4g} times that, {}:\n"
        "  aiming at the gel dose itself loses fine features.\n",
        prime(f.gel_prime, m), f.dose_factor, prime(f.aim_prime, m));
  } else {
    out += fmt::format(
        "  Correction aims at {}. The file gives this dose itself, not a gel dose with a factor.\n",
        prime(f.aim_prime, m));
  }
  if (m == 1.0) {
    out += fmt::format("  In options of slicecorr: --dc-mj-cm3 {:.6g} --ha-um {:.6g}\n",
                       f.aim_mj_cm3, f.height10_um);
  } else {
    out += fmt::format(
        "  m = {:g}: twice the intensity needs {:.3g} times the exposure, not half of it.\n", m,
        std::pow(2.0, -m));
  }
  return out;
}

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

}  // namespace

std::string aligned(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width_of(row[i]));
  }
  std::string out;
  for (const auto& row : rows) {
    std::string text;
    for (std::size_t i = 0; i < row.size(); ++i) {
      text += row[i] + std::string(widths[i] - width_of(row[i]) + 2, ' ');
    }
    text.erase(text.find_last_not_of(' ') + 1);
    out += text + "\n";
  }
  return out;
}

std::string gel_dose_text(const ResinRecord& r) {
  if (r.resin.has_gel_time()) return gel_time_text(r.resin, 1 / r.resin.dose_factor);
  return gel_is_known(r) ? prime(figures_of(r.resin).gel_prime, r.resin.m, r.resin.unit) : "-";
}

std::string aim_text(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  if (r.resin.has_gel_time()) return fmt::format("{:.4g} x gel", f.dose_factor);
  const std::string dose = prime(f.aim_prime, r.resin.m, r.resin.unit);
  return gel_is_known(r) ? fmt::format("{} ({:.4g} x gel)", dose, f.dose_factor) : dose;
}

namespace {

std::string chemistry_text(const Chemistry& c) {
  std::string out = "\nChemistry\n";
  out += line("end groups", fmt::format("{:.4g} mol/l; gels when {:.4g} % of them are used up",
                                        c.groups_mol_l, 100 * c.gel_conversion));
  out += line("initiator",
              fmt::format("{:.4g} mol/l, {:.4g} l/(mol cm) base 10 at {:g} nm, quantum yield {:g}",
                          c.initiator_mol_l, c.absorptivity_l_mol_cm / units::kLn10,
                          c.wavelength_nm, c.quantum_yield));
  out += line("oxygen", fmt::format("{:.4g} mol/l", c.oxygen_mol_l));
  if (c.inhibitor_mol_l > 0)
    out += line("inhibitor", fmt::format("{:.4g} mol/l", c.inhibitor_mol_l));
  out += line("rates, l/(mol s)",
              fmt::format("initiation {:.4g}, propagation {:.4g}, termination {:.4g} (of pairs: "
                          "chains vanish at twice this)",
                          c.initiation_l_mol_s, c.propagation_l_mol_s, c.termination_l_mol_s));
  out += line(
      "", fmt::format(
              "chains with oxygen {:.4g}{}{}", c.oxygen_l_mol_s,
              c.initiator_oxygen_l_mol_s > 0
                  ? fmt::format(", initiator with oxygen {:.4g}", c.initiator_oxygen_l_mol_s)
                  : "",
              c.inhibitor_mol_l > 0 ? fmt::format(", with inhibitor {:.4g}", c.inhibitor_l_mol_s)
                                    : ""));
  const auto d = [](const char* what, const std::optional<double>& um2_s) {
    return um2_s ? fmt::format("{} {:.4g}", what, *um2_s) : fmt::format("{} not given", what);
  };
  out += line("diffusion, um²/s",
              fmt::format("{}, {}, {}{} at {:g} K", d("oxygen", c.oxygen_um2_s),
                          d("initiator", c.initiator_um2_s), d("its radicals", c.radical_um2_s),
                          c.inhibitor_mol_l > 0 ? ", " + d("inhibitor", c.inhibitor_um2_s) : "",
                          c.temperature_k));
  out += line("dims light", fmt::format("to 1/e over {} um", four_digits(light_height_um(c))));
  const GelTime g = gel_time_of(c);
  out += line("time to gel, s", fmt::format("{:.4g} / I + {:.4g} / sqrt(I), I in mW/cm²: oxygen "
                                            "first, then chains",
                                            g.A, g.B));
  for (const double i : {1.0, 10.0, 100.0}) {
    out += line("", fmt::format("at {:g} mW/cm² {} s, of which {} s inhibited; local m = {:.3f}", i,
                                four_digits(gel_time_s(g, i)), four_digits(inhibition_time_s(c, i)),
                                local_exponent(g, i)));
  }
  if (inhibition_time_used_up_s(c, 1) > 1e300) {
    out += line("", fmt::format("it never gels: radicals of all initiator do not use up oxygen and "
                                "inhibitor; {:.4g} mol/l would",
                                least_initiator_mol_l(c)));
  }
  return out;
}

}  // namespace

std::string describe_resin(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  const double m = r.resin.m;
  std::string out = fmt::format("{}   resin, version {}\n", r.name, r.version);
  out += line("maker", r.maker) + line("product", r.product) +
         line("also called", fmt::format("{}", fmt::join(r.aliases, ", "))) +
         line("kind", fmt::format("{}", fmt::join(r.tags, ", "))) + line("chemistry", r.chemistry) +
         line("colour", r.colour) + line("notes", r.notes);
  out += line("file", r.path);
  out += "\nCuring\n";
  out +=
      line("model", r.resin.has_gel_time()                    ? "time to gel, A/i + B/sqrt(i)"
                    : r.resin.model == CureModelKind::kinetic ? fmt::format("kinetic, m = {:g}", m)
                                                              : "Jacobs' working curve, m = 1");
  if (r.wavelength_nm > 0) out += line("wavelength", fmt::format("{:g} nm", r.wavelength_nm));
  out += line("absorbance height", fmt::format("{:.5g} um base e (light falls to 1/e), {:.5g} um "
                                               "base 10 (to 1/10)",
                                               f.height_e_um, f.height10_um));
  const double all = absorption_per_cm(r.resin), cures = curing_absorption_per_cm(r.resin);
  out += line("absorption",
              cures < all ? fmt::format("{:.4g} per cm in base e, of which {:.4g} cure", all, cures)
                          : fmt::format("{:.4g} per cm in base e", all));
  if (r.resin.n > 0) out += line("refractive index", fmt::format("{:g}", r.resin.n));
  if (r.resin.inhibition_dose_mj_cm3 > 0) {
    out += line("inhibition dose", fmt::format("{:.4g} mJ/cm³, before the gel dose (tomographic)",
                                               r.resin.inhibition_dose_mj_cm3));
  }
  if (r.resin.inhibition_resupply_mj_cm3_s > 0) {
    out += line("inhibition resupply",
                fmt::format("{:.4g} mJ/cm³ a second", r.resin.inhibition_resupply_mj_cm3_s));
  }
  if (r.resin.dose_diffusion_m2_s > 0) {
    out += line("diffusion of dose",
                fmt::format("{:.4g} m²/s: {:.3g} um along each axis in a minute (tomographic)",
                            r.resin.dose_diffusion_m2_s, 1e3 * dose_spread_mm(r.resin, 60)));
  }
  if (r.resin.viscosity_pa_s > 0) {
    out += line("viscosity", fmt::format("{:.4g} Pa·s", r.resin.viscosity_pa_s));
  }
  if (std::isfinite(r.resin.inhibitor_life_s)) {
    out += line("life of inhibitor", fmt::format("{:.4g} s", r.resin.inhibitor_life_s));
  }
  if (r.resin.scatter_um2_per_um > 0) {
    out += line("scatter of light",
                fmt::format("{:g} um² per um: sigma {:.3g} um at the absorbance height (base 10)",
                            r.resin.scatter_um2_per_um,
                            std::sqrt(r.resin.scatter_um2_per_um * f.height10_um)));
  }
  if (r.resin.shrinkage.any()) {
    out += line("after printing", shrinkage_in_words(r.resin.shrinkage));
  }
  if (r.resin.has_gel_time()) {
    out += line("time to gel", gel_time_text(r.resin, 1 / f.dose_factor));
    out += line("time aimed at", gel_time_text(r.resin, 1));
  } else {
    if (gel_is_known(r)) out += dose_line("gel dose", f, r.resin, false);
    out += dose_line("dose aimed at", f, r.resin, true);
  }
  if (gel_is_known(r)) out += line("dose factor", fmt::format("{:.4g}", f.dose_factor));
  if (r.resin.bleaches()) {
    const Bleaching& b = *r.resin.bleaching;
    out += line("bleaches",
                fmt::format("to an absorbance height of {:.5g} um base e, by {:.4g} mJ/cm² of "
                            "light to 1/e",
                            units::height_e_from_10(b.absorbance_height10_um), b.dose_mj_cm2));
  }
  if (r.resin.inhibition) {
    const Inhibition& i = *r.resin.inhibition;
    out += "\nInhibition by UV light\n";
    out += line("absorbance height",
                fmt::format("{:.5g} um base e, {:.5g} um base 10", f.huv_e_um, f.huv10_um));
    out += line("beta", fmt::format("{:.4g} areal, {:.4g} volumetric", f.beta, f.beta_volumetric));
    out += line("m", fmt::format("{:g}", i.m));
    if (i.critical_dose_prime > 0) {
      out += line("gel dose", prime(i.critical_dose_prime, i.m));
    }
    out += line("dead zone from", fmt::format("UV above {:.4g} times blue", 1 / f.beta));
  }
  if (r.resin.chemistry) out += chemistry_text(*r.resin.chemistry);
  out += in_plain_words(r, f);
  return out + provenance_text(r.provenance);
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
