// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What scans told, in words.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/resins/scan_tune.hpp"
#include "tune/scan_inputs.hpp"

namespace slicecorr::resins {

namespace {

/// Share of the deviations beyond which an answer is doubted.
constexpr double kDoubtedShare = 0.1;
/// What stays off by less is no matter of a print, um.
constexpr double kDoubtedUm = 1;

/// What of these prints was taken for what the files say, and what tells it.
std::string not_sought(const ScanTuneResult& r, const Printer& printer) {
  std::string what;
  if (!r.finding(ScanInput::spread).sought) {
    what += printer.spread.picture ? "light that spreads as a picture says, "
                                   : "light that spreads (none is believed to, unless asked), ";
  }
  if (!r.finding(ScanInput::scatter).sought) {
    what += "light that scatters (none is believed to, unless asked), ";
  }
  return "not sought: " + what +
         "black that differs from place to place; the parts spread and flat-field tell them\n";
}

}  // namespace

std::string ScanTuneResult::to_text(const Printer& printer, const Resin& resin,
                                    const TunePrior& prior) const {
  std::string out = fmt::format("known before: {}\n\n", prior.text);
  out += fmt::format("{:34} {:>11} {:>22}   {}\n", "", "found", "95 % within", "");
  const auto line = [&](const char* name, ScanInput input, auto in_unit) {
    const ScanFinding& f = finding(input);
    if (!f.sought) return;
    const double low = in_unit(f.value - 1.96 * f.sd), high = in_unit(f.value + 1.96 * f.sd);
    out += fmt::format("{:34} {:11.5g} {:>22}   {}\n", name, in_unit(f.value),
                       fmt::format("{:.5g} to {:.5g}", std::min(low, high), std::max(low, high)),
                       f.told() ? "told" : "not told by these parts");
  };
  line("absorbance height, um", ScanInput::ha,
       [&](double x) { return resin.absorbance_height10_um * std::exp(x); });
  line("light over dose, to before", ScanInput::light, [](double x) { return std::exp(x); });
  const double light = std::exp(-finding(ScanInput::light).value);
  line("stray light, mW/cm²", ScanInput::stray, [&](double x) { return x * light; });
  line("exchanged at a lift, share", ScanInput::exchange,
       [&](double x) { return std::clamp(exchange_before(printer) + x, 0.0, 1.0); });
  // Beside what the file says already.
  const auto per_cent = [](double before) {
    return [before](double x) { return 100 - (100 - before) * (1 - x); };
  };
  const Shrinkage& s = resin.shrinkage;
  line("shrinkage in the plane, %", ScanInput::shrinkage_plane, per_cent(s.plane_per_cent));
  line("shrinkage along z, %", ScanInput::shrinkage_z, per_cent(s.z_per_cent));
  line("walls stand out by, um", ScanInput::walls, [](double mm) { return 1e3 * mm; });
  line("first layers grow by, um", ScanInput::first_layers,
       [&](double mm) { return s.growth_um + 1e3 * mm; });
  line("light spreads, um", ScanInput::spread,
       [&](double um) { return std::max(0.0, spread_width_um(printer.spread) + um); });
  line("light scatters, um² per um", ScanInput::scatter,
       [&](double x) { return std::max(0.0, resin.scatter_um2_per_um + x); });
  line("beta of the dead zone", ScanInput::dead_zone,
       [&](double x) { return resin.inhibition ? resin.inhibition->beta * std::exp(x) : 0; });
  out += fmt::format(
      "\n{} points of {} scan{}, {} left out (beside the part, or where the surface comes and goes); noise of a point "
      "{:.3g} um\n",
      points, registrations.size(), registrations.size() == 1 ? "" : "s", left_out, noise_um);
  const double share =
      before_um > 0 ? std::min(1.0, after_um * after_um / (before_um * before_um)) : 0.0;
  out += fmt::format(
      "the surface is off by {:.3g} um rms before and {:.3g} um after: {:.3g} % of it stays unexplained\n",
      before_um, after_um, 100 * share);
  if (share > kDoubtedShare && after_um > kDoubtedUm) {
    out +=
        "more than a tenth stays unexplained: something else is off, and what was found may stand for it; don't print by "
        "the new files before you know what (scan compare shows where)\n";
  }
  if (finding(ScanInput::dead_zone).sought) {
    out +=
        "under UV light edges stay at layers and jump to the next: what is true may lie beyond these intervals, beta "
        "by some per cent\n";
  }
  if (tuned.shrinkage) {
    out += fmt::format("the resin {}: slices of meshes count it from now on\n",
                       shrinkage_in_words(*tuned.shrinkage));
  }
  out += not_sought(*this, printer);
  for (const std::string& text : not_apart) out += "not told apart by these parts: " + text + "\n";
  for (const Unexplained& u : unexplained) {
    out += fmt::format(
        "unexplained: {:+.1f} um at {:.2f}, {:.2f}, {:.2f} mm ({} points): warped, broken or misprinted?\n",
        u.mean_um, u.place[0], u.place[1], u.place[2], u.points);
  }
  return out;
}

}  // namespace slicecorr::resins
