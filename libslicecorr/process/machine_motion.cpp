// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/machine_motion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/limit.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {
namespace {

constexpr double kMmHFromUmS = 3.6, kUmFromMm = 1000;
/// Where nobody asked for ramps outside, the platform may be this share of the absorbance height
/// (base 10) above the window when the first slice comes: the dose there is 11 % less.
constexpr double kUnaskedRunUp = 0.05;

double speed_um_s(const Process& process, int slice) {
  return slice_speed_mm_h(process, slice) / kMmHFromUmS;
}

void check_travel(const MovedPrint& print, const MachineMotion& machine, double top_um) {
  if (!(machine.travel_um > 0) || top_um <= machine.travel_um) return;
  const int less = static_cast<int>(std::ceil((top_um - machine.travel_um) / print.layer_um));
  throw InfeasibleError(fmt::format(
      "the print ends {:.3f} mm above the window with its ramps, the stage of printer '{}' "
      "reaches {:g} mm; {}",
      top_um / kUmFromMm, machine.printer, machine.travel_um / kUmFromMm,
      less < print.slices ? fmt::format("{} slices of {:g} um less would do", less, print.layer_um)
                          : fmt::format("it begins at {:g} mm (home_mm), which leaves no room",
                                        machine.home_um / kUmFromMm)));
}

PrintMotion by_layers(const MovedPrint& print, const MachineMotion& machine) {
  const double least_s = kCyclesPerSlice * machine.cycle_s;
  for (int n = 0; n < std::max(1, print.slices); ++n) {
    const double exposure_s = layer_exposure_s(print.process, n);
    if (exposure_s >= least_s) continue;
    throw InfeasibleError(
        fmt::format("layer {} is exposed for {:g} s, with exchanges every {:g} s at least {:g} "
                    "s can be timed",
                    n, exposure_s, machine.cycle_s, least_s));
  }
  PrintMotion motion;
  motion.start_um = machine.home_um;
  motion.end_um = motion.start_um + print.slices * print.layer_um;
  check_travel(print, machine, motion.end_um);
  return motion;
}

/// Light at `um_s` where it is for `light_um_s`, as a share; dark below what the lamp does.
bool lit(const MovedPrint& print, const MachineMotion& machine, double um_s, double light_um_s) {
  return std::pow(um_s / light_um_s, 1 / print.m) >= machine.least_blue_share;
}

/// Where each slice has light for its own speed: whether the blue lamp can follow the stage while it
/// changes its speed, which it does in the faster slice.
void check_changes(const MovedPrint& print, const MachineMotion& machine) {
  const auto speed = [&](int n) {
    return speed_um_s(print.process, std::clamp(n, 0, std::max(0, print.slices - 1)));
  };
  for (int n = 0; n < print.slices; ++n) {
    const double least = std::min(speed(n - 1), speed(n + 1));
    if (least >= speed(n) || lit(print, machine, least, speed(n))) continue;
    throw InfeasibleError(fmt::format(
        "the stage changes its speed between {:.4g} and {:.4g} mm/h in slice {}, and the blue lamp of "
        "printer '{}' is dark below {:g} % of its light (min_share); correct the part for speeds that "
        "change less from slice to slice",
        least * kMmHFromUmS, speed(n) * kMmHFromUmS, n, machine.printer,
        100 * machine.least_blue_share));
  }
}

/// Whether the stage gets from the speed of each slice to that of the next, in the faster of both.
void check_steps(const MovedPrint& print, const MachineMotion& machine) {
  if (!(machine.acceleration_um_s2 > 0) || !(print.layer_um > 0)) return;
  // Tables of speeds are rounded.
  constexpr double kRounding = 1e-3;
  for (int n = 0; n + 1 < print.slices; ++n) {
    const double here = speed_um_s(print.process, n), next = speed_um_s(print.process, n + 1);
    const double um = slice_height_um(print.process, print.layer_um, here > next ? n : n + 1);
    const double most = 2 * machine.acceleration_um_s2 * um;
    if (std::abs(here * here - next * next) <= most * (1 + kRounding)) continue;
    const double slow = std::min(here, next);
    throw InfeasibleError(fmt::format(
        "slices {} and {} go at {:.4g} and {:.4g} mm/h, and within a slice of {:g} um the stage of printer '{}' "
        "gets from {:.4g} to {} mm/h at most (acceleration_mm_s2); correct the part for speeds that change "
        "less from slice to slice",
        n, n + 1, here * kMmHFromUmS, next * kMmHFromUmS, um, machine.printer, slow * kMmHFromUmS,
        at_most(std::sqrt(slow * slow + most) * kMmHFromUmS)));
  }
}

/// Speeds of slices, and whether stage and blue lamp can follow them.
void check_slice_speeds(const MovedPrint& print, const MachineMotion& machine) {
  const Process& process = print.process;
  if (process.slice_speed_mm_h.empty()) return;
  check_steps(print, machine);
  if (slices_differ(process)) return check_changes(print, machine);
  const auto slowest =
      std::min_element(process.slice_speed_mm_h.begin(), process.slice_speed_mm_h.end());
  if (lit(print, machine, *slowest, process.speed_mm_h)) return;
  throw InfeasibleError(fmt::format(
      "slice {} goes at {:.4g} mm/h, {:.3g} % of the {:g} mm/h that the light is for, and the blue "
      "lamp of printer '{}' is dark below {:g} % of its light (min_share); correct the part for at "
      "least {} mm/h there, or for a lower speed",
      slowest - process.slice_speed_mm_h.begin(), *slowest, 100 * *slowest / process.speed_mm_h,
      process.speed_mm_h, machine.printer, 100 * machine.least_blue_share,
      at_least(process.speed_mm_h * std::pow(machine.least_blue_share, print.m))));
}

/// The greatest speed of a slice that can be timed, mm/h.
double timed_mm_h(const MachineMotion& machine, double layer_um) {
  return layer_um / (kCyclesPerSlice * machine.cycle_s) * kMmHFromUmS;
}

/// Whether the stage and the exchanges with the machine can keep up.
void check_speed(const MovedPrint& print, const MachineMotion& machine) {
  const std::vector<double>& speeds = print.process.slice_speed_mm_h;
  const double v = (speeds.empty() ? print.process.speed_mm_h
                                   : *std::max_element(speeds.begin(), speeds.end())) /
                   kMmHFromUmS;
  if (machine.max_speed_um_s > 0 && v > machine.max_speed_um_s * (1 + 1e-9)) {
    throw InfeasibleError(fmt::format(
        "the stack is printed at {:g} mm/h, the stage of printer '{}' reaches {:g} mm/h; correct "
        "the part for at most that speed",
        v * kMmHFromUmS, machine.printer, machine.max_speed_um_s * kMmHFromUmS));
  }
  if (!(print.layer_um > 0)) return;
  const double slice_s = print.layer_um / v;
  if (slice_s < kCyclesPerSlice * machine.cycle_s) {
    throw InfeasibleError(fmt::format(
        "a slice of {:g} um passes in {:.3g} ms at {:g} mm/h, with exchanges every "
        "{:g} ms (cycle_s) it must take {:g} ms; print at {} mm/h or slower, or "
        "with higher slices",
        print.layer_um, slice_s * 1e3, v * kMmHFromUmS, machine.cycle_s * 1e3,
        kCyclesPerSlice * machine.cycle_s * 1e3, at_most(timed_mm_h(machine, print.layer_um))));
  }
}

/// The least share of its light at which the lamp follows that is lit the least.
double least_share(const MachineMotion& machine, bool uv) {
  return std::max(machine.least_blue_share, uv ? machine.least_uv_share : 0.0);
}

/// What the dimmest share of a lamp leaves dark at both ends of ramps.
void check_dark_ends(const MovedPrint& print, const MachineMotion& machine, double ramp_um) {
  const double least = least_share(machine, print.process.uv.kind != UvKind::off);
  const double dark_um = ramp_um * std::pow(least, 2 * print.m);
  if (dark_um <= machine.max_late_um) return;
  throw InfeasibleError(fmt::format(
      "the lamps of printer '{}' can't follow the stage below {:g} % of their light: {:.1f} um "
      "would stay dark at both ends, {:g} um are borne (max_late_um); correct the part with {} "
      "outside, or with a ramp of {} mm or less",
      machine.printer, least * 100, dark_um, machine.max_late_um, setting_name(print.names, "ramp"),
      at_most(ramp_um * machine.max_late_um / dark_um / kUmFromMm)));
}

/// The stage's own ramp, or the longer one that is asked for.
void choose_ramp(const MovedPrint& print, const MachineMotion& machine, PrintMotion& motion) {
  const Process& process = print.process;
  const double v = process.speed_mm_h / kMmHFromUmS;
  motion.ramp_um = v * v / (2 * machine.acceleration_um_s2);
  motion.acceleration_um_s2 = machine.acceleration_um_s2;
  const double asked_um = process.ramp_mm * kUmFromMm;
  if (process.ramp_mm > 0 && asked_um < motion.ramp_um * (1 - 1e-9)) {
    throw InfeasibleError(fmt::format(
        "the stack's ramps are {:g} mm long, the stage of printer '{}' takes {:.4g} mm to {:g} "
        "mm/h; correct the part with {} {} or more",
        process.ramp_mm, machine.printer, motion.ramp_um / kUmFromMm, process.speed_mm_h,
        setting_name(print.names, "ramp_mm"), at_least(motion.ramp_um / kUmFromMm)));
  }
  motion.ramp = process.ramp == Ramp::lamp_follows ? Ramp::lamp_follows : Ramp::outside;
  if (process.ramp_mm > 0) {
    motion.ramp_um = asked_um;
    motion.acceleration_um_s2 = v * v / (2 * asked_um);
  }
}

}  // namespace

PrintMotion print_motion(const MovedPrint& print, const MachineMotion& machine) {
  const Process& process = print.process;
  if (process.mode == ExposureMode::layerwise) return by_layers(print, machine);
  check_slice_speeds(print, machine);
  check_speed(print, machine);
  PrintMotion motion;
  choose_ramp(print, machine, motion);
  const double height_um = print.slices * print.layer_um;
  motion.start_um = machine.home_um;
  if (motion.ramp == Ramp::lamp_follows) {
    check_dark_ends(print, machine, motion.ramp_um);
    motion.end_um = motion.start_um + height_um;
    check_travel(print, machine, motion.end_um);
    return motion;
  }
  const double begin_um_s = speed_um_s(process, 0);
  const double share = begin_um_s * kMmHFromUmS / process.speed_mm_h;
  motion.run_up_um =
      motion.ramp_um * share * share + kReactionCycles * machine.cycle_s * begin_um_s;
  if (process.ramp == Ramp::none &&
      motion.run_up_um > kUnaskedRunUp * print.absorbance_height10_um) {
    throw InfeasibleError(fmt::format(
        "the stage of printer '{}' takes {:.0f} um to reach {:g} mm/h, and the stack does not say "
        "what happens meanwhile; correct the part with {} lamp-follows {} {}, or "
        "with {} outside, which leaves a gap of that height above the first slice",
        machine.printer, motion.run_up_um, process.speed_mm_h, setting_name(print.names, "ramp"),
        setting_name(print.names, "ramp_mm"), at_least(motion.ramp_um / kUmFromMm),
        setting_name(print.names, "ramp")));
  }
  motion.start_um += motion.run_up_um;
  motion.end_um = motion.start_um + height_um;
  check_travel(print, machine, motion.end_um + motion.ramp_um);
  return motion;
}

bool take_ramp(const MachineMotion& machine, double m, double absorbance_height10_um,
               Process& process) {
  if (process.mode != ExposureMode::continuous || process.ramp != Ramp::none) return false;
  const auto takes = [&](const Process& p) {
    try {
      print_motion({p, m, absorbance_height10_um, 0, 0}, machine);
      return true;
    } catch (const InfeasibleError&) {
      return false;
    }
  };
  if (takes(process)) return false;
  const double v = process.speed_mm_h / kMmHFromUmS;
  Process follows = process;
  follows.ramp = Ramp::lamp_follows;
  follows.ramp_mm = rounded_up(v * v / (2 * machine.acceleration_um_s2) / kUmFromMm);
  if (!takes(follows)) return false;
  process = std::move(follows);
  return true;
}

MostSpeed most_speed(const MovedPrint& print, const MachineMotion& machine) {
  MostSpeed most{rounded_down(timed_mm_h(machine, print.layer_um), 6),
                 fmt::format("printbridge needs {:g} ms for a slice of {:g} um (cycle_s)",
                             kCyclesPerSlice * machine.cycle_s * 1e3, print.layer_um)};
  const double least = least_share(machine, print.process.uv.kind != UvKind::off);
  if (!(least > 0)) return most;
  // A ramp is v^2 / 2a. Where lamps follow, least^2m of it stays dark; where they do not, ramp and
  // reaction are the run-up.
  const double a = machine.acceleration_um_s2, react_um_s = kReactionCycles * machine.cycle_s * a;
  const double follows_um_s = std::sqrt(2 * a * machine.max_late_um) * std::pow(least, -print.m);
  const double outside_um_s =
      std::sqrt(react_um_s * react_um_s + 2 * a * kUnaskedRunUp * print.absorbance_height10_um) -
      react_um_s;
  // Ramps are told with five digits.
  const double ramps_mm_h =
      rounded_down(std::max(follows_um_s, outside_um_s) * kMmHFromUmS * (1 - 1e-4), 6);
  if (ramps_mm_h < most.mm_h) {
    most = {ramps_mm_h,
            fmt::format("beyond it the ramps of printer '{}' would be dark for more than {:g} um "
                        "(min_share, max_late_um)",
                        machine.printer, machine.max_late_um)};
  }
  return most;
}

std::optional<MachineMotion> parse_machine_motion(const std::string& text,
                                                  const std::string& source) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  const auto stage = root.table("stage");
  if (!stage || !root.has("modbus") || !stage->has("acceleration_mm_s2")) return std::nullopt;
  const Printer printer = parse_printer(text, source);
  MachineMotion machine;
  machine.printer = printer.name;
  machine.max_speed_um_s = printer.max_speed_mm_h / kMmHFromUmS;
  machine.travel_um = printer.travel_mm * kUmFromMm;
  machine.acceleration_um_s2 = stage->required_number("acceleration_mm_s2", 0, 1e5) * kUmFromMm;
  machine.home_um = stage->number("home_mm", 0, 1e4, true).value_or(0) * kUmFromMm;
  if (const auto bridge = root.table("bridge")) {
    machine.cycle_s = bridge->number("cycle_s", 0.001, 0.1, true).value_or(machine.cycle_s);
    machine.max_late_um = bridge->number("max_late_um", 0, 1e4).value_or(machine.max_late_um);
  }
  const auto of_lamp = [&](const char* lamp, const char* key, double most, double otherwise) {
    const auto lamps = root.table("lamps");
    const auto table = lamps ? lamps->table(lamp) : std::nullopt;
    return table ? table->number(key, 0, most, true).value_or(otherwise) : otherwise;
  };
  machine.least_blue_share = of_lamp("blue", "min_share", 1, 0);
  machine.blue_warm_up_s = of_lamp("blue", "warm_up_s", 3600, 0);
  machine.blue_settle_s = of_lamp("blue", "settle_s", 60, machine.blue_settle_s);
  if (printer.uv) {
    machine.least_uv_share = std::max(of_lamp("uv", "min_share", 1, 0),
                                      printer.uv->min_mw_cm2() / printer.uv->max_mw_cm2());
  }
  return machine;
}

std::optional<MachineMotion> load_machine_motion(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  return parse_machine_motion(read_text_file(path), path);
}

}  // namespace slicecorr
