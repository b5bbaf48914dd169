// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What scans told, in words.
#include <fmt/format.h>

#include <cmath>

#include "slicecorr/resins/scan_tune.hpp"

namespace slicecorr::resins {

std::string ScanTuneResult::to_text(const Printer& printer, const Resin& resin,
                                    const TunePrior& prior) const {
  std::string out = fmt::format("known before: {}\n\n", prior.text);
  out += fmt::format("{:34} {:>11} {:>22}   {}\n", "", "found", "95 % within", "");
  const auto of = [&](ScanInput input) -> const ScanFinding& {
    return findings[static_cast<std::size_t>(input)];
  };
  const auto line = [&](const char* name, ScanInput input, auto in_unit) {
    const ScanFinding& f = of(input);
    const double low = in_unit(f.value - 1.96 * f.sd), high = in_unit(f.value + 1.96 * f.sd);
    out += fmt::format("{:34} {:11.5g} {:>22}   {}\n", name, in_unit(f.value),
                       fmt::format("{:.5g} to {:.5g}", std::min(low, high), std::max(low, high)),
                       f.told() ? "told" : "not told by these parts");
  };
  line("absorbance height, um", ScanInput::ha,
       [&](double x) { return resin.absorbance_height10_um * std::exp(x); });
  line("light over dose, to before", ScanInput::light, [](double x) { return std::exp(x); });
  const double light = std::exp(-of(ScanInput::light).value);
  line("stray light, mW/cm²", ScanInput::stray, [&](double x) { return x * light; });
  if (tuned.lift_exchange) {
    line("exchanged at a lift, share", ScanInput::exchange,
         [&](double x) { return exchange_before(printer) + x; });
  }
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
  out += fmt::format(
      "\n{} points of {} scan{}, {} left out (beside the part, or where the surface comes and goes); noise of a point "
      "{:.3g} um\n",
      points, registrations.size(), registrations.size() == 1 ? "" : "s", left_out, noise_um);
  out += fmt::format(
      "the surface is off by {:.3g} um rms before and {:.3g} um after: {:.3g} % of it stays unexplained\n",
      before_um, after_um,
      before_um > 0 ? 100 * std::min(1.0, after_um * after_um / (before_um * before_um)) : 0.0);
  if (tuned.shrinkage) {
    out += fmt::format("the resin {}: slices of meshes count it from now on\n",
                       shrinkage_in_words(*tuned.shrinkage));
  }
  out +=
      "not sought in scans: light that spreads or scatters, black that differs from place to place, the dead zone "
      "under UV light; the parts spread, flat-field and dead-zone tell them\n";
  for (const std::string& text : not_apart) out += "not told apart by these parts: " + text + "\n";
  for (const Unexplained& u : unexplained) {
    out += fmt::format(
        "unexplained: {:+.1f} um at {:.2f}, {:.2f}, {:.2f} mm ({} points): warped, broken or misprinted?\n",
        u.mean_um, u.place[0], u.place[1], u.place[2], u.points);
  }
  return out;
}

}  // namespace slicecorr::resins
