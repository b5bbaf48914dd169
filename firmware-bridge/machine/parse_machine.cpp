// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "machine/parse_map.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::bridge {

namespace {

constexpr double kUmPerMm = 1000, kUmSPerMmH = 1000.0 / 3600;

Stage parse_stage(const TomlTable& t) {
  // Whether the speed may change is for who plans prints.
  constexpr std::array<std::string_view, 11> known{
      "max_speed_mm_h", "travel_mm", "acceleration_mm_s2", "tolerance_um",
      "home_mm",        "lift_mm",   "lift_speed_mm_h",    "return_speed_mm_h",
      "settle_s",       "wait_s",    "variable_speed"};
  detail::only_keys(t, known);
  Stage s;
  s.max_speed_um_s = t.required_number("max_speed_mm_h", 0, 1e6) * kUmSPerMmH;
  s.travel_um = t.required_number("travel_mm", 0, 1e4) * kUmPerMm;
  s.acceleration_um_s2 = t.required_number("acceleration_mm_s2", 0, 1e5) * kUmPerMm;
  if (s.acceleration_um_s2 < 1) {
    t.fail("acceleration_mm_s2",
           fmt::format("is {:g}; expected at least 0.001", s.acceleration_um_s2 / kUmPerMm));
  }
  s.tolerance_um = t.number("tolerance_um", 0, 1e4).value_or(s.tolerance_um);
  s.home_um = t.number("home_mm", 0, 1e4, true).value_or(0) * kUmPerMm;
  if (s.home_um >= s.travel_um) {
    t.fail("home_mm", fmt::format("is {:g}; expected less than the travel of {:g} mm",
                                  s.home_um / kUmPerMm, s.travel_um / kUmPerMm));
  }
  s.lift_um = t.number("lift_mm", 0, 1e3, true).value_or(s.lift_um / kUmPerMm) * kUmPerMm;
  if (s.lift_um > s.travel_um) {
    t.fail("lift_mm", fmt::format("is {:g}; expected at most the travel of {:g} mm",
                                  s.lift_um / kUmPerMm, s.travel_um / kUmPerMm));
  }
  if (const auto speed = t.number("lift_speed_mm_h", 0, 1e6)) {
    s.lift_speed_um_s = *speed * kUmSPerMmH;
  } else {
    s.lift_speed_um_s = s.max_speed_um_s;
  }
  s.return_speed_um_s =
      t.number("return_speed_mm_h", 0, 1e6).value_or(s.lift_speed_um_s / kUmSPerMmH) * kUmSPerMmH;
  // The printer file was read before: it has one of the two.
  const char* const wait = t.has("wait_s") ? "wait_s" : "settle_s";
  s.settle_s = t.number(wait, 0, kMostLiftWaitS, true).value_or(s.settle_s);
  return s;
}

/// Of a stage that turns a vial: arcs at the vial's inner wall.
Stage parse_turning_stage(const TomlTable& t, const Printer& printer) {
  constexpr std::array<std::string_view, 4> known{"acceleration_deg_s2", "tolerance_deg",
                                                  "max_deg_s", "travel_turns"};
  detail::only_keys(t, known);
  Stage s;
  s.um_per_deg = printer.vial->inner_mm * kUmPerMm * std::numbers::pi / 180;
  const double print_deg_s = printer.rotation->deg_s;
  const double fastest_deg_s = t.number("max_deg_s", 0, 1e5).value_or(print_deg_s);
  if (fastest_deg_s < print_deg_s) {
    t.fail("max_deg_s", fmt::format("is {:g}; expected at least the {:g} at which it prints "
                                    "(rotation.deg_s)",
                                    fastest_deg_s, print_deg_s));
  }
  s.max_speed_um_s = s.lift_speed_um_s = s.return_speed_um_s = fastest_deg_s * s.um_per_deg;
  s.acceleration_um_s2 = t.required_number("acceleration_deg_s2", 0, 1e6) * s.um_per_deg;
  s.tolerance_um = t.number("tolerance_deg", 0, 90).value_or(1) * s.um_per_deg;
  s.travel_um = t.integer("travel_turns", 2, 1000000, 1000) * s.turn_um();
  s.lift_um = s.settle_s = 0;
  return s;
}

LampDrive parse_lamp(const TomlTable& lamps, std::string_view key, bool shares) {
  LampDrive lamp;
  const auto given = lamps.table(key);
  if (!given) return lamp;
  const TomlTable& t = *given;
  constexpr std::array<std::string_view, 5> known{"min_share", "max_share", "tolerance", "settle_s",
                                                  "warm_up_s"};
  detail::only_keys(t, known);
  lamp.min_share = t.number("min_share", 0, 1, true).value_or(0);
  if (t.has("max_share") && !shares) {
    t.fail("max_share", "is given; the calibration under [uv] says how bright this lamp gets");
  }
  lamp.max_share = t.number("max_share", 1, 10, true).value_or(1);
  lamp.tolerance = t.number("tolerance", 0, 0.5).value_or(lamp.tolerance);
  lamp.settle_s = t.number("settle_s", 0, 60, true).value_or(lamp.settle_s);
  lamp.warm_up_s = t.number("warm_up_s", 0, 3600, true).value_or(0);
  return lamp;
}

MachineLimits parse_limits(const TomlTable& t, const Stage& stage) {
  const std::string_view max_late = stage.turns() ? "max_late_deg" : "max_late_um";
  const std::array<std::string_view, 9> known{
      "cycle_s",         "response_timeout_s", "heartbeat_timeout_s", "watchdog_s", max_late,
      "max_late_frames", "display_latency_s",  "max_temperature_c",   "ring_frames"};
  detail::only_keys(t, known);
  MachineLimits l;
  l.cycle_s = t.number("cycle_s", 0.001, 0.1, true).value_or(l.cycle_s);
  l.response_timeout_s =
      t.number("response_timeout_s", 0.005, 1, true).value_or(l.response_timeout_s);
  l.heartbeat_timeout_s =
      t.number("heartbeat_timeout_s", 0.02, 10, true).value_or(l.heartbeat_timeout_s);
  l.watchdog_s = t.number("watchdog_s", 0.02, 10, true).value_or(l.watchdog_s);
  if (stage.turns()) {
    l.max_late_um = t.number(max_late, 0, 90).value_or(0) * stage.um_per_deg;
  } else {
    l.max_late_um = t.number(max_late, 0, 1e4).value_or(l.max_late_um);
  }
  l.max_late_frames = t.integer("max_late_frames", 0, 1000000, l.max_late_frames);
  l.display_latency_s = t.number("display_latency_s", 0, 1, true).value_or(l.display_latency_s);
  l.max_temperature_c = t.number("max_temperature_c", 0, 200).value_or(l.max_temperature_c);
  l.ring_frames = t.integer("ring_frames", 8, 1024, l.ring_frames);
  return l;
}

/// An exchange takes a response timeout for each of its requests, and one may be lost.
void check_times(const TomlTable& t, const MachineLimits& l, int requests) {
  const std::string two =
      requests == 1 ? fmt::format("two response timeouts of {:g} s", l.response_timeout_s)
                    : fmt::format(
                          "two exchanges of {} requests (by [modbus]), each with a response "
                          "timeout of {:g} s: {:g} s",
                          requests, l.response_timeout_s, 2 * requests * l.response_timeout_s);
  if (l.heartbeat_timeout_s < 2 * requests * l.response_timeout_s) {
    t.fail("heartbeat_timeout_s",
           fmt::format("is {:g}; expected at least {}", l.heartbeat_timeout_s, two));
  }
  if (l.watchdog_s < 3 * l.cycle_s || l.watchdog_s < 2 * requests * l.response_timeout_s) {
    t.fail("watchdog_s", fmt::format("is {:g}; expected at least three cycles of {:g} s and {}",
                                     l.watchdog_s, l.cycle_s, two));
  }
}

constexpr std::array<std::string_view, 4> kChannelNames{"red", "green", "blue", "all"};

Channel parse_channel(const TomlTable& t, std::string_view key, Channel fallback, bool all) {
  const std::string name = t.text(key, std::string(name_of(fallback)));
  const auto end = all ? kChannelNames.end() : kChannelNames.end() - 1;
  const auto found = std::find(kChannelNames.begin(), end, name);
  if (found == end) {
    t.fail(key, fmt::format("is '{}'; expected \"red\", \"green\"{} \"blue\"{}", name,
                            all ? "," : " or", all ? " or \"all\"" : ""));
  }
  return static_cast<Channel>(found - kChannelNames.begin());
}

Projector parse_projector(const TomlTable& t, bool patterned) {
  constexpr std::array<std::string_view, 3> known{"blue", "uv", "output"};
  detail::only_keys(t, known);
  Projector p;
  p.blue = parse_channel(t, "blue", patterned ? Channel::blue : Channel::all, true);
  if (t.has("uv") && !patterned) {
    t.fail("uv", "is given; expected kind = \"patterned\" under [uv], and no [uv_display]");
  }
  p.uv = parse_channel(t, "uv", p.uv, false);
  if (patterned && (p.blue == p.uv || p.blue == Channel::all)) {
    const std::string_view key = t.has("uv") ? "uv" : "blue";
    t.fail(key, fmt::format("puts blue and UV images into the same channel (\"{}\", \"{}\"); "
                            "expected one of its own for each",
                            name_of(p.blue), name_of(p.uv)));
  }
  p.output = t.text("output", "");
  return p;
}

/// How the plate lies in the images of the UV display.
Orientation parse_orientation(const TomlTable& t, const Orientation& fallback) {
  Orientation o = fallback;
  if (t.has("orientation")) {
    const std::string side = t.text("orientation", "");
    if (side != "landscape" && side != "portrait") {
      t.fail("orientation", fmt::format("is '{}'; expected \"landscape\" or \"portrait\"", side));
    }
    o.portrait = side == "portrait";
  }
  const toml::node* const mirror = t.node("mirror");
  if (!mirror) return o;
  const std::string way = mirror->is_boolean()  ? (**mirror->as_boolean() ? "x" : "none")
                          : mirror->is_string() ? **mirror->as_string()
                                                : "";
  if (way != "none" && way != "x" && way != "y" && way != "xy") {
    t.fail("mirror", "expected true, false, \"none\", \"x\", \"y\" or \"xy\"");
  }
  o.mirror_x = way.find('x') != std::string::npos;
  o.mirror_y = way.find('y') != std::string::npos;
  return o;
}

/// Size that a display must have which shows the plate's pixels so.
Grid shown_grid(const Printer& printer, const Orientation& orientation) {
  return turned(plate_grid(printer), turn_from_plate(orientation));
}

UvDisplay parse_uv_display(const TomlTable& root, const TomlTable& t, const Machine& m) {
  constexpr std::array<std::string_view, 7> known{"width_px",  "height_px", "mirror", "orientation",
                                                  "latency_s", "channel",   "output"};
  detail::only_keys(t, known);
  const Printer& printer = m.printer;
  if (!printer.uv || !printer.uv->patterned) {
    root.fail("uv_display", "is given; expected kind = \"patterned\" under [uv], too");
  }
  if (printer.rotation) root.fail("uv_display", "is given; expected no [rotation] with it");
  UvDisplay d;
  d.orientation = parse_orientation(t, printer.orientation.value_or(Orientation{}));
  const Grid shown = shown_grid(printer, d.orientation);
  d.width_px = t.integer("width_px", 1, kMostPixelsAcross, shown.width_px);
  d.height_px = t.integer("height_px", 1, kMostPixelsAcross, shown.height_px);
  if (d.width_px != shown.width_px || d.height_px != shown.height_px) {
    t.fail(d.width_px != shown.width_px ? "width_px" : "height_px",
           fmt::format("makes {} x {} pixels; expected {} x {}, which lie on those of [display]",
                       d.width_px, d.height_px, shown.width_px, shown.height_px));
  }
  d.latency_s = t.number("latency_s", 0, 1, true).value_or(m.limits.display_latency_s);
  d.channel = parse_channel(t, "channel", Channel::all, true);
  d.output = t.text("output", "");
  return d;
}

}  // namespace

UvDisplay uv_display_like_blue(const Machine& machine) {
  const Printer& p = machine.printer;
  if (!p.uv || !p.uv->patterned) {
    throw InputError(machine.path, "uv",
                     fmt::format("printer '{}' shows no UV images; expected kind = \"patterned\" "
                                 "for a UV display",
                                 p.name));
  }
  if (p.rotation) {
    throw InputError(machine.path, "rotation",
                     "a vial that turns has no UV display; expected no --uv-sink");
  }
  return {p.width_px,
          p.height_px,
          p.orientation.value_or(Orientation{}),
          machine.limits.display_latency_s,
          Channel::all,
          ""};
}

Machine uv_display_machine(const Machine& machine) {
  const UvDisplay& d = *machine.uv_display;
  Machine m = machine;
  m.printer.width_px = d.width_px;
  m.printer.height_px = d.height_px;
  m.printer.orientation = d.orientation;
  m.printer.uv.reset();
  m.limits.display_latency_s = d.latency_s;
  m.projector = {d.channel, Channel::red, d.output};
  m.uv_display.reset();
  return m;
}

std::string_view name_of(Channel channel) {
  return kChannelNames[static_cast<std::size_t>(channel)];
}

Machine parse_machine(std::string_view text, const std::string& source) {
  Machine m;
  m.printer = complete_printer(text, source);
  m.path = source;
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  const TomlTable stage = root.required_table("stage");
  if (m.printer.rotation) {
    require_tomographic(m.printer);
    m.stage = parse_turning_stage(stage, m.printer);
    m.limits.max_late_um = 0;
  } else {
    m.stage = parse_stage(stage);
  }
  if (const auto lamps = root.table("lamps")) {
    constexpr std::array<std::string_view, 2> known{"blue", "uv"};
    detail::only_keys(*lamps, known);
    m.blue = parse_lamp(*lamps, "blue", true);
    m.uv = parse_lamp(*lamps, "uv", false);
    if (lamps->has("uv") && !m.printer.uv) {
      lamps->fail("uv", "is given; expected a table [uv] with its calibration, too");
    }
  }
  if (const auto bridge = root.table("bridge")) m.limits = parse_limits(*bridge, m.stage);
  if (const auto display = root.table("uv_display")) {
    m.uv_display = parse_uv_display(root, *display, m);
  }
  // On two displays each has its own channels.
  const bool patterned = m.printer.uv && m.printer.uv->patterned && !m.uv_display;
  if (const auto projector = root.table("projector")) {
    m.projector = parse_projector(*projector, patterned);
  } else if (patterned) {
    m.projector.blue = Channel::blue;
  }
  if (const auto modbus = root.table("modbus")) m.modbus = detail::parse_map(*modbus, m);
  const auto bridge = root.table("bridge");
  check_times(bridge ? *bridge : root, m.limits, m.modbus ? requests_of(*m.modbus) : 1);
  return m;
}

void Machine::connect_to(const std::string& where) {
  if (!modbus) {
    throw InputError(
        path, "modbus",
        "is missing; expected the register map of this printer (docs/printer-files.md)");
  }
  if (where.empty()) return;
  const auto colon = where.rfind(':');
  if (where.starts_with("tcp:") && colon > 4) {
    int port = 0;
    const char *const begin = where.data() + colon + 1, *const end = where.data() + where.size();
    const auto read = std::from_chars(begin, end, port);
    if (read.ec == std::errc() && read.ptr == end && port >= 1 && port <= 65535) {
      modbus->transport = Transport::tcp;
      modbus->host = where.substr(4, colon - 4);
      modbus->port = port;
      return;
    }
  } else if (where.starts_with("rtu:") && where.size() > 4) {
    modbus->transport = Transport::rtu;
    modbus->device = where.substr(4);
    return;
  }
  throw InputError(fmt::format("--modbus is '{}', expected tcp:HOST:PORT or rtu:DEVICE", where));
}

Machine load_machine(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  return parse_machine(read_text_file(path), path);
}

}  // namespace slicecorr::bridge
