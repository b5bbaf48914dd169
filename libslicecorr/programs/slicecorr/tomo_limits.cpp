// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo_limits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "programs/common/setup_options.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::cli {

namespace {

std::string what_is(std::string_view name) {
  if (name == "voxel") return "side of a voxel";
  if (name == "pixel") return "width of a pixel in the resin";
  if (name == "row") return "height of a row on the axis";
  if (name == "turn") return "way of the part's rim while a frame is shown";
  if (name == "aperture") return "width of a pixel's cone of light at the part's rim";
  return "half a wave over the numerical aperture";
}

/// Which angles lose which part of a vial that is not round.
std::string lit_in_words(const std::vector<tomo::LitAt>& turned) {
  if (turned.empty()) return {};
  const auto worst =
      std::min_element(turned.begin(), turned.end(),
                       [](const tomo::LitAt& a, const tomo::LitAt& b) { return a.lit < b.lit; });
  const auto whole = std::count_if(turned.begin(), turned.end(),
                                   [](const tomo::LitAt& a) { return a.dark_from_mm == 0; });
  std::string text = fmt::format("of {} angles {} light all of the resin", turned.size(), whole);
  if (worst->dark_from_mm > 0) {
    text += fmt::format("; turned by {:g} degrees {:.3g} % of it is dark, from {:.3g} mm on",
                        worst->turned_deg, 100 * (1 - worst->lit), worst->dark_from_mm);
  }
  const auto most = std::max_element(
      turned.begin(), turned.end(),
      [](const tomo::LitAt& a, const tomo::LitAt& b) { return a.reflected < b.reflected; });
  if (most->reflected > 0) {
    text += fmt::format("; turned by {:g} degrees walls reflect {:.3g} % of the light as a whole",
                        most->turned_deg, 100 * most->reflected);
  }
  return text + " (--json has all angles)\n";
}

std::string in_words(const tomo::Limits& l) {
  std::string text = fmt::format("a part of {:.4g} mm radius, {} angles\n", l.radius_mm, l.angles);
  for (const tomo::Limit& w : l.widths) {
    text += fmt::format("{:>10.1f} um  {}{}\n", 1e3 * w.mm, what_is(w.name),
                        &w == &l.widths.front() ? ": this limits" : "");
  }
  if (l.half_angle_deg > 0) {
    text += fmt::format(
        "aperture: {:.4g} degrees in the resin, NA {:.4g}; one of {:.4g} degrees in air keeps within a "
        "voxel, with {:.3g} of the light\n",
        l.half_angle_deg, l.numerical_aperture, l.most_half_angle_deg, l.light_share);
  }
  text += lit_in_words(l.turned);
  text += fmt::format("alpha R {:.4g}; prints are shortest at an absorption of {:.4g} /cm\n",
                      l.alpha_r, l.best_absorption_per_cm);
  if (l.grams_per_kg < 0) {
    text += "the resin absorbs more than that without any initiator\n";
  } else if (l.grams_per_kg > 0) {
    text += fmt::format(
        "initiator: {:.4g} g for a kg of resin; what the resin's file says are {:.4g} g\n",
        l.grams_per_kg, l.grams_now);
  }
  return text;
}

int limits(const TomoLimitOptions& o, const ExecutionContext& context, Console& console) {
  check_output(o.json, {});
  const Printer printer = load_printer(o.printer);
  const Resin resin = load_resin(o.resin);
  tell_unread(printer.unread, context);
  tell_unread(resin.unread, context);
  const tomo::Limits l = tomo::limits_of(printer, resin, o.asked);
  if (o.json.empty()) {
    print_result(in_words(l));
  } else {
    print_or_write(o.json, l.to_json());
    console.say(in_words(l));
  }
  return kDone;
}

}  // namespace

void add_tomo_limits(Program& program, CLI::App* group, TomoLimitOptions& o) {
  CLI::App* sub = program.add_to(
      group, "limits",
      "Say how fine a printer prints, what limits it, and how much initiator to take",
      [&o](const ExecutionContext& context, Console& console) {
        return limits(o, context, console);
      });
  sub->add_option("--printer", o.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name")->required();
  sub->add_option("--radius-mm", o.asked.radius_mm,
                  "Of the part [as far as light of all directions reaches]")
      ->check(number_above_zero());
  sub->add_option("--voxel-mm", o.asked.voxel_mm, "Voxels that are wanted [the height of a row]")
      ->check(number_above_zero());
  sub->add_option("--angles", o.asked.angles, "Frames of a turn [as many as the projector shows]")
      ->check(CLI::Range(3, 100000));
  sub->add_option("--epsilon-per-m-cm", o.asked.epsilon_per_m_cm,
                  "Initiator: decadic molar absorption at the printer's wavelength, 1/(M cm)")
      ->check(number_above_zero());
  sub->add_option("--molar-mass-g", o.asked.molar_mass_g, "Initiator: grams a mol")
      ->check(number_above_zero());
  sub->add_option("--density-g-cm3", o.asked.density_g_cm3, "Of the resin")
      ->check(number_above_zero())
      ->capture_default_str();
  sub->add_option("--without-per-cm", o.asked.without_per_cm,
                  "Absorption of the resin without initiator, base e, 1/cm")
      ->check(number_in(0, 1e6))
      ->capture_default_str();
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
}

}  // namespace slicecorr::cli
