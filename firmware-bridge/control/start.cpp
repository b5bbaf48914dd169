// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a machine says against a print on it.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {
namespace {

/// Limits of what a machine can measure: a workshop is not colder and no resin bears to be hotter,
/// °C; and how many times faster or brighter than possible counts as wrong.
constexpr double kColdestC = -40, kHottestC = 400, kTimesFaster = 4, kTimesBrighter = 2;
/// A stage may be measured beyond the ends of its travel by so many times its tolerance.
constexpr double kTolerancesBeyond = 2;

class Reasons {
 public:
  void add(bool is, const std::string& why) {
    if (is) text_ += (text_.empty() ? "" : ", ") + why;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

}  // namespace

std::string impossible(const Machine& machine, const Status& s) {
  const Stage& stage = machine.stage;
  const double beyond = kTolerancesBeyond * stage.tolerance_um;
  if (!(s.stage_um >= -beyond) ||
      (stage.travel_um > 0 && !(s.stage_um <= stage.travel_um + beyond))) {
    if (stage.turns()) {
      return fmt::format(
          "the machine says that its stage is at {:.2f}°; it counts {:g} turns from its index on",
          s.stage_um / stage.um_per_deg, stage.travel_um / stage.turn_um());
    }
    return fmt::format(
        "the machine says that its stage is at {:.3f} mm; its travel is 0 to {:g} mm",
        s.stage_um * 1e-3, stage.travel_um * 1e-3);
  }
  const double fastest = kTimesFaster * stage.fastest_um_s();
  if (s.stage_speed_um_s && fastest > 0 && !(std::abs(*s.stage_speed_um_s) <= fastest)) {
    if (stage.turns()) {
      return fmt::format(
          "the machine says that its stage turns by {:.1f} °/s; its fastest is {:g} °/s",
          *s.stage_speed_um_s / stage.um_per_deg, fastest / kTimesFaster / stage.um_per_deg);
    }
    return fmt::format("the machine says that its stage goes {:.1f} mm/h; its fastest is {:g} mm/h",
                       *s.stage_speed_um_s * 3.6, fastest / kTimesFaster * 3.6);
  }
  if (s.temperature_c && !(*s.temperature_c >= kColdestC && *s.temperature_c <= kHottestC)) {
    return fmt::format("the machine says that it is {:.1f} °C warm", *s.temperature_c);
  }
  const auto light = [](double share, double most, double tolerance) {
    return share >= -tolerance && share <= kTimesBrighter * most + tolerance;
  };
  if (!light(s.blue_measured, machine.blue.max_share, machine.blue.tolerance)) {
    return fmt::format("the machine says that its blue lamp gives {:.1f} % of full light",
                       s.blue_measured * 100);
  }
  const double uv = machine.printer.uv ? machine.printer.uv->max_mw_cm2() : 0;
  if (uv > 0 && s.uv_measured && !light(*s.uv_measured / uv, 1, machine.uv.tolerance)) {
    return fmt::format(
        "the machine says that its UV lamp gives {:.1f} mW/cm²; its most is {:g} mW/cm²",
        *s.uv_measured, uv);
  }
  return {};
}

std::string lit(const Machine& machine, const Status& s) {
  Reasons reasons;
  reasons.add(s.blue_measured > machine.blue.tolerance,
              fmt::format("the blue lamp shines ({:.1f} % of full light)", s.blue_measured * 100));
  const double uv = machine.printer.uv ? machine.printer.uv->max_mw_cm2() : 0;
  reasons.add(uv > 0 && s.uv_measured.value_or(0) > machine.uv.tolerance * uv,
              fmt::format("the UV lamp shines ({:.1f} mW/cm²)", s.uv_measured.value_or(0)));
  return reasons.text();
}

std::string interlocks(const Machine& machine, const Status& s) {
  Reasons reasons;
  reasons.add(s.door_open, "a door or cover is open");
  reasons.add(s.stop_pressed, "the stop button is pressed");
  reasons.add(s.over_temperature ||
                  (s.temperature_c && *s.temperature_c > machine.limits.max_temperature_c),
              "it is too hot");
  return reasons.text();
}

std::string against_start(const Machine& machine, const Status& s, bool machine_is_clear) {
  if (const auto wrong = impossible(machine, s); !wrong.empty()) {
    return wrong + ": see to its sensors, and whether [modbus.read] has the right registers";
  }
  Reasons reasons;
  reasons.add(s.state == MachineState::fault, "the machine is in a fault of its own");
  reasons.add(s.state == MachineState::stopped, "the machine is stopped");
  reasons.add(s.state == MachineState::running, "the machine runs, and nobody drives it");
  reasons.add(s.watchdog_tripped, "its watchdog has switched it off");
  reasons.add(s.lamp_failed, "it says that a lamp failed");
  reasons.add(s.stage_failed, "it says that its stage failed");
  reasons.add(s.latched.value_or(false), "it says that a print has failed on it");
  reasons.add(s.job_kept.value_or(false), "a print on it has not ended (job)");
  const std::string shines = lit(machine, s), open = interlocks(machine, s);
  reasons.add(!shines.empty(), shines);
  const bool reset = !reasons.text().empty();
  reasons.add(!open.empty(), open);
  if (reset) {
    return reasons.text() +
           ": see why, whether a part is on it and lamps are off, then `printbridge reset`";
  }
  if (!open.empty()) return open + ": see to it";
  if (machine.stage.turns() && !machine.has_encoder()) return {};
  // A machine that remembers failed or unfinished prints would say so; then home is not checked.
  if (machine_is_clear || s.latched || s.job_kept) return {};
  const Stage& stage = machine.stage;
  if (stage.turns()) {
    const double off_um = std::abs(std::remainder(s.stage_um, stage.turn_um()));
    if (off_um <= stage.tolerance_um) return {};
    return fmt::format(
        "the vial stands at {:.2f}°, not at a whole turn, as after a print that did not end: there "
        "may be a part in it. See that its resin is fresh, then print with --machine-is-clear",
        s.stage_um / stage.um_per_deg);
  }
  if (s.stage_um <= stage.home_um + stage.tolerance_um ||
      s.stage_um >= stage.travel_um - stage.tolerance_um) {
    return {};
  }
  return fmt::format(
      "the stage stands at {:.3f} mm, as after a print that did not end: there may be a part on "
      "it. See that platform and window are clear, then print with --machine-is-clear",
      s.stage_um * 1e-3);
}

std::string in_words(const Left& left) {
  if (!left.touched) return "nothing was moved or lit";
  std::string text;
  if (left.heard && !left.dark) {
    text = "A LAMP STILL SHINES, switch the machine off";
  } else if (left.heard) {
    text = "lamps are off";
  }
  if (left.heard && left.stands) {
    text += "; the stage has stopped";
  } else if (left.heard) {
    text += "; NOT CONFIRMED that the stage stands: go and look";
  } else if (left.bridge_gone) {
    text =
        "NOT CONFIRMED that lamps are off and the stage stands, the program that printed is gone: "
        "the machine's watchdog should have seen to it; go and look, and switch it off if not";
  } else if (left.lamps_taken) {
    text =
        "NOT CONFIRMED that lamps are off and the stage stands: the machine took the order to put "
        "lamps off and has said nothing since; go and look, and switch it off if not";
  } else {
    text =
        "NOT CONFIRMED that lamps are off and the stage stands, the machine did not answer: its "
        "watchdog should have seen to it; go and look, and switch it off if not";
  }
  if (!left.measured) return text + "; nothing was measured";
  text += "; last measured";
  if (left.measured_s_ago) {
    text += left.time.empty() ? fmt::format(" {:.2f} s ago", *left.measured_s_ago)
                              : fmt::format(" {:.2f} s before {}", *left.measured_s_ago, left.time);
  }
  text += fmt::format(": blue light {:.1f} %", left.blue_measured * 100);
  if (left.uv_measured) text += fmt::format(", UV light {:.1f} mW/cm²", *left.uv_measured);
  if (left.stage_deg) return text + fmt::format(", stage at {:.2f}°", *left.stage_deg);
  if (left.stage_um) return text + fmt::format(", stage at {:.3f} mm", *left.stage_um * 1e-3);
  return text;
}

}  // namespace slicecorr::bridge
