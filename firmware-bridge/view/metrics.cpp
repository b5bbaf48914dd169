// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <cmath>

#include "slicecorr/bridge/view.hpp"
#include "slicecorr/version.hpp"
#include "support/metrics/exposition.hpp"

namespace slicecorr::bridge {

std::string metrics_text(const Seen& seen, const FaultCounts& faults) {
  const PrintState& s = seen.state;
  const PrintFacts& f = seen.facts;
  const auto or_nan = [](const std::optional<double>& value) { return value.value_or(NAN); };
  cli::Exposition t("printbridge_", {{"printer", seen.printer}});
  t.begin("build_info", "gauge", "Version of the program.");
  t.value(1, {{"version", version}});
  t.one("up", "gauge", "1: a print runs and answers.", seen.running);
  t.begin("phase", "gauge", "1 for the phase of the print that runs, or in which the last ended.");
  for (int i = 0; i <= static_cast<int>(Phase::failed); ++i) {
    const auto phase = static_cast<Phase>(i);
    t.value(seen.known && phase == s.phase, {{"phase", std::string(name_of(phase))}});
  }
  t.one("latched", "gauge", "1: a fault that nobody has looked at; nothing prints before a reset.",
        seen.latched);
  t.begin("faults_total", "counter", "Faults in the journal, which begins anew with each print.");
  for (const auto& [fault, count] : faults) {
    t.value(count, {{"reason", std::string(name_of(fault))}});
  }
  // What follows is of a print; without one nothing is said rather than something wrong.
  if (!seen.known) return t.text();
  t.one("frames", "gauge", "Frames of the print.", f.frames);
  t.one("frames_shown_total", "counter", "Frames that the display has shown, of this print.",
        s.frames_shown);
  t.one("frames_late_total", "counter", "Frames that count as late, of this print.", s.late_frames);
  const Lateness& l = s.lateness;
  if (f.turns()) {
    t.histogram("frame_lateness_degrees", "How late frames began, along the stage's turn.",
                Lateness::kBoundsDeg, l.deg, l.sum_deg);
    t.one("frame_lateness_worst_degrees", "gauge", "Latest frame, along the stage's turn.",
          latest_um(s) / f.um_per_deg);
  }
  if (!f.layerwise) {
    t.histogram("frame_lateness_um",
                "How late frames began, along the stage's way; where it turns, at the vial's wall.",
                Lateness::kBoundsUm, l.um, l.sum_um);
    t.one("frame_lateness_worst_um", "gauge",
          "Latest frame, along the stage's way; where it turns, at the vial's wall.", latest_um(s));
  }
  std::array<double, Lateness::kBoundsMs.size()> seconds{};
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    seconds[i] = Lateness::kBoundsMs[i] / 1e3;
  }
  t.histogram("frame_lateness_seconds",
              "How late frames began; layer by layer how much too long exposures were.", seconds,
              l.ms, l.sum_ms * 1e-3);
  t.one("frame_lateness_worst_seconds", "gauge", "The greatest of these.", l.worst_ms * 1e-3);
  if (f.turns()) {
    t.one("turn", "gauge", "Turn that is shown, from 1; 0 before the first frame.", turn_of(f, s));
    const int turns = f.frames / f.angles;
    t.one("turns", "gauge", "Turns of the print.", turns);
    t.one("angle_degrees", "gauge", "Angle of the stage within its turn, from the index on.",
          angle_in_turn_deg(f, s));
    t.one("speed_degrees_per_second", "gauge", "Speed of the stage, measured.",
          s.speed_um_s / f.um_per_deg);
    t.one("stage_error_degrees", "gauge", "Measured less commanded angle of the stage.",
          s.stage_error_um / f.um_per_deg);
    t.one("stage_error_worst_degrees", "gauge", "Its largest size in this print.",
          s.worst_stage_error_um / f.um_per_deg);
  } else {
    t.one("z_um", "gauge", "Height of the stage above the first slice's begin.",
          s.stage_um - f.start_um);
    t.one("speed_um_per_second", "gauge", "Speed of the stage, measured.", s.speed_um_s);
    t.one("stage_error_um", "gauge", "Measured less commanded position of the stage.",
          s.stage_error_um);
    t.one("stage_error_worst_um", "gauge", "Its largest size in this print.",
          s.worst_stage_error_um);
  }
  t.begin("blue_share", "gauge", "Blue lamp, 1: as calibrated.");
  t.value(s.blue_share, {{"of", "asked"}});
  t.value(s.blue_measured, {{"of", "measured"}});
  if (f.uv || s.uv_measured) {
    t.begin("uv_mw_cm2", "gauge", "UV lamp.");
    t.value(s.uv_mw_cm2, {{"of", "asked"}});
    t.value(or_nan(s.uv_measured), {{"of", "measured"}});
  }
  if (s.temperature_c) {
    t.one("temperature_celsius", "gauge", "Temperature that the machine measures.",
          *s.temperature_c);
  }
  t.one("missed_cycles_total", "counter", "Control cycles that began more than one cycle late.",
        s.missed_cycles);
  if (seen.running && seen.around.ready_frames) {
    t.one("frames_ready", "gauge", "Frames that are decoded ahead.", *seen.around.ready_frames);
  }
  t.one("frames_ring", "gauge", "Frames that are decoded ahead at most.", f.ring_frames);
  t.one("elapsed_seconds", "gauge", "Since the program began, of this print.", s.at_s);
  t.one("left_seconds", "gauge", "Until the last slice's end, as planned; NaN: not known.",
        or_nan(seen.left_s));
  return t.text();
}

}  // namespace slicecorr::bridge
