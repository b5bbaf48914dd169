# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A machine, written from docs/printer-files.md alone: Modbus over raw sockets and a serial line, with
register maps of its own, faults by name, and a log of what it was told and did. Its stage goes along
a line, counted in um, or turns, counted in degrees.

It shares no code with the bridge or its simulator. Its clock is that of a print in lockstep: time
passes by one control cycle with each sequence number that it is given. Lamp set-points that fall
count as soon as they are written; everything else counts when the sequence number is.
"""

import argparse
import json
import os
import random
import select
import socket
import struct
import sys
import threading
import time
import tty

CYCLE_S = 0.03
WATCHDOG_S = 0.6
RESPONSE_S = 0.05

# ---- register maps: signal -> (address, type, scale, offset) ----

INPUTS = {
    "sequence_echo": (3, "u16", 1, 0),
    "state": (0, "u16", 1, 0),
    "stage_um": (1, "i32", 0.1, 0),
    "stage_speed_um_s": (4, "i32", 0.01, 0),
    "blue_measured": (6, "u16", 0.0005, 0),
    "uv_measured": (7, "u16", 0.05, 0),
    "temperature_c": (8, "i16", 0.1, 0),
}
BITS = ["door_open", "stop_pressed", "lamp_failed", "stage_failed", "over_temperature",
        "watchdog_tripped"]


def moved(signals, by):
    return {name: (place[0] + by,) + tuple(place[1:]) for name, place in signals.items()}


BLOCK = {
    "command": (0, "u16", 1, 0),
    "blue_share": (1, "u16", 0.0005, 0),
    "target_um": (2, "i32", 0.1, 0),
    "speed_um_s": (4, "u32", 0.01, 0),
    "acceleration_um_s2": (6, "u32", 1, 0),
    "uv_mw_cm2": (8, "u16", 0.05, 0),
    "watchdog_s": (9, "u16", 0.001, 0),
    "heartbeat": (10, "u16", 1, 0),
    "frame": (11, "i16", 1, 0),
    "sequence": (12, "u16", 1, 0),
}
GAPS = {
    "target_um": (7, "i32", 0.1, 0),
    "speed_um_s": (9, "u32", 0.01, 0),
    "acceleration_um_s2": (11, "u32", 1, 0),
    "uv_mw_cm2": (40, "u16", 0.05, 0),
    "blue_share": (41, "u16", 0.0005, 0),
    "command": (60, "u16", 1, 0),
    "watchdog_s": (61, "u16", 0.001, 0),
    "heartbeat": (62, "u16", 1, 0),
    "frame": (63, "i16", 1, 0),
    "sequence": (80, "u16", 1, 0),
}

# A stage that turns, without UV light.
INPUTS_TURN = {
    "state": (0, "u16", 1, 0),
    "sequence_echo": (1, "u16", 1, 0),
    "stage_deg": (2, "i32", 0.001, 0),
    "stage_speed_deg_s": (4, "i32", 0.002, 0),
    "blue_measured": (6, "u16", 0.0005, 0),
    "temperature_c": (8, "i16", 0.1, 0),
}
BLOCK_TURN = {
    "command": (0, "u16", 1, 0),
    "blue_share": (1, "u16", 0.0005, 0),
    "target_deg": (2, "i32", 0.001, 0),
    "speed_deg_s": (4, "u32", 0.001, 0),
    "acceleration_deg_s2": (6, "u32", 0.1, 0),
    "watchdog_s": (8, "u16", 0.001, 0),
    "heartbeat": (9, "u16", 1, 0),
    "frame": (10, "i16", 1, 0),
    "sequence": (11, "u16", 1, 0),
}
GAPS_TURN = {
    "blue_share": (3, "u16", 0.0005, 0),
    "target_deg": (20, "i32", -0.002, 500),
    "speed_deg_s": (22, "u32", 0.001, 0),
    "acceleration_deg_s2": (24, "u32", 0.1, 0),
    "frame": (26, "i16", 1, 0),
    "watchdog_s": (27, "u16", 0.001, 0),
    "command": (40, "u16", 1, 0),
    "heartbeat": (41, "u16", 1, 0),
    "sequence": (42, "u16", 1, 0),
}
STANDARD = {"off": 0, "run": 1, "stop": 2, "reset": 3}
STATES = {"idle": 0, "running": 1, "stopped": 2, "fault": 3}


class Map:
    def __init__(self, name, exchange, write, read_at, order="big", unit=1, serial=False,
                 commands=None, states=None, job=False, read=None):
        self.name, self.exchange, self.order, self.unit = name, exchange, order, unit
        self.serial = serial
        self.write = dict(write)
        self.read = moved(read or INPUTS, read_at)
        self.turns = "target_deg" in self.write
        # What the stage's signals are called.
        self.target, self.speed, self.acceleration = (
            ("target_deg", "speed_deg_s", "acceleration_deg_s2") if self.turns else
            ("target_um", "speed_um_s", "acceleration_um_s2"))
        self.bits = {bit: (read_at + 9, n) for n, bit in enumerate(BITS)}
        if job:
            last = max(a for a, *_ in self.write.values()) + 1
            self.write["job"] = (last, "u16", 1, 0)
            self.read["job_kept"] = (read_at + 10, "u16", 1, 0)
            self.bits["latched"] = (read_at + 9, 9)
        self.commands, self.states = commands or STANDARD, states or STATES

    def toml(self, where):
        lines = ["[modbus]", f'transport = "{"rtu" if self.serial else "tcp"}"']
        lines += [f'device = "{where}"'] if self.serial else [f"port = {where}"]
        lines += [f"unit = {self.unit}", f'word_order = "{self.order}"',
                  f'exchange = "{self.exchange}"']
        for title, signals in (("write", self.write), ("read", self.read)):
            lines.append(f"[modbus.{title}]")
            for name, (address, kind, scale, offset) in signals.items():
                lines.append(f'{name} = {{ address = {address}, type = "{kind}", scale = {scale}, '
                             f'offset = {offset} }}')
        for name, (address, bit) in self.bits.items():
            lines.append(f"{name} = {{ address = {address}, bit = {bit} }}")
        for title, words in (("commands", self.commands), ("states", self.states)):
            lines.append(f"[modbus.{title}]")
            lines += [f"{word} = {raw}" for word, raw in words.items()]
        return "\n".join(lines) + "\n"


MAPS = {
    "block": Map("block", "fc23", moved(BLOCK, 200), 300, unit=5),
    "gaps": Map("gaps", "fc16+fc3", GAPS, 500, order="little",
                commands={"off": 10, "run": 20, "stop": 30, "reset": 40},
                states={"idle": 7, "running": 8, "stopped": 9, "fault": 11}),
    "inputs": Map("inputs", "fc16+fc4", BLOCK, 0, unit=255, job=True),
    "turn": Map("turn", "fc23", moved(BLOCK_TURN, 40), 90, unit=3, job=True, read=INPUTS_TURN),
    # No encoder: of its stage it tells the speed alone.
    "blind": Map("blind", "fc16+fc4", GAPS_TURN, 700, order="little", unit=9,
                 commands={"off": 3, "run": 5, "stop": 9, "reset": 17},
                 read={k: v for k, v in INPUTS_TURN.items() if k != "stage_deg"}),
    "line": Map("line", "fc16+fc3", moved(BLOCK, 4096), 8192, unit=17, serial=True),
}


def registers_of(kind):
    return 2 if kind in ("i32", "u32") else 1


# ---- faults ----

# name -> what happens; "wire" faults may last some requests only.
FAULTS = {
    # the wire
    "refuse-target": "writes that cover the target are answered by exception 4",
    "refuse-speed": "those that cover the speed, by exception 3",
    "refuse-sequence": "those that cover the sequence number, by exception 4",
    "refuse-heartbeat": "those that cover the heartbeat, by exception 6",
    "refuse-command": "those that cover the command, by exception 2",
    "refuse-frame": "those that cover the frame, by exception 3",
    "refuse-blue": "those that cover the blue lamp, by exception 4",
    "refuse-uv": "those that cover the UV lamp, by exception 4",
    "refuse-writes": "all that write, by exception 4",
    "refuse-reads": "all that read, by exception 4",
    "refuse-all": "all, by exception 4",
    "refuse-function-23": "function 23 is not known any more",
    "busy": "exception 6 to the next 3 requests",
    "close-each": "the connection is closed after each answer",
    "close-each-refusing": "so, and writes that cover the target are refused",
    "close-once": "the connection is closed",
    "close-before": "the connection is closed before each answer",
    "hang-up": "connections are closed at once",
    "silent": "requests are carried out and not answered",
    "deaf": "requests are neither carried out nor answered",
    "silent-once": "one request is carried out and not answered",
    "silent-reads": "what only reads is not answered",
    "trickle": "answers come byte by byte, each after 20 ms",
    "late-once": "an answer comes 100 ms late",
    "wrong-unit": "another unit answers",
    "wrong-length": "the length in the header is wrong",
    "wrong-transaction": "answers belong to another request",
    "wrong-protocol": "the protocol in the header is not 0",
    "wrong-function": "answers are of another function",
    "wrong-count": "answers carry one register less",
    "wrong-checksum": "the checksum of answers is wrong",
    "garbage": "answers are random bytes",
    "half": "half of each answer",
    "twice": "each answer twice",
    "wrong-once": "one answer belongs to another request",
    # the machine
    "restart": "the controller starts anew",
    "door": "the door opens",
    "stop-button": "the stop button is pressed",
    "hot": "it gets too hot",
    "lamp-failed": "it says that a lamp failed, which is dark",
    "stage-failed": "it says that its stage failed, which stands",
    "fault": "a fault of its own",
    "stopped": "it is stopped",
    "idle": "it is idle",
    "stuck-stage": "the stage stands",
    "stage-jumps": "the stage jumps by 100 um, or 20 degrees",
    "stage-falls": "the stage jumps back by as much",
    "lamp-sticks": "blue no longer follows, only the relay puts it off",
    "uv-sticks": "UV no longer follows, only the relay puts it off",
    "lamp-drifts": "blue is 30 % brighter than asked",
    "lamp-fades": "blue is 30 % dimmer than asked",
    "uv-fails": "UV is dark",
    "unknown-state": "its state is none of the map's",
    "echo-frozen": "the sequence number that it gives back stays",
    "echo-random": "the sequence number that it gives back is a random one",
    "impossible-stage": "its stage is said to be 61.5 mm high, or at 1,000,000 degrees",
    "impossible-temperature": "it is said to be -3276.8 degrees warm",
    "impossible-light": "its blue lamp is said to give 3000 %",
    # of the bench: a machine that was built wrongly
    "no-watchdog": "it has no watchdog",
    "no-stop-alone": "a stop counts with the sequence number only",
    "forgives": "it runs again without a reset",
}
BENCH = {"no-watchdog", "no-stop-alone", "forgives"}
BORNE = {"busy", "close-each", "close-once", "silent-once", "late-once", "wrong-once", "twice"}
# The lamps can't be put off by what is written: the machine's own watchdog must.
OWN_WATCHDOG = {"refuse-blue", "refuse-uv", "refuse-writes", "refuse-all", "close-before",
                "hang-up", "deaf", "lamp-sticks", "uv-sticks"}
# It acts itself.
OWN_ACT = {"restart", "door", "stop-button", "hot", "fault", "stopped", "idle"}
TCP_ONLY = {"wrong-length", "wrong-transaction", "wrong-protocol", "close-each", "close-once",
            "close-each-refusing", "close-before", "hang-up"}
SERIAL_ONLY = {"wrong-checksum"}
FC23_ONLY = {"refuse-function-23"}

# Signal, of the stage by what it is on every map, and exception.
REFUSED = {"refuse-target": ("target", 4), "refuse-speed": ("speed", 3),
           "refuse-sequence": ("sequence", 4), "refuse-heartbeat": ("heartbeat", 6),
           "refuse-command": ("command", 2), "refuse-frame": ("frame", 3),
           "refuse-blue": ("blue_share", 4), "refuse-uv": ("uv_mw_cm2", 4),
           "close-each-refusing": ("target", 4)}
UV_ONLY = {"refuse-uv", "uv-sticks", "uv-fails"}
ENCODER_ONLY = {"stage-jumps", "stage-falls", "impossible-stage"}


def suits(fault, map_):
    if fault in TCP_ONLY and map_.serial or fault in SERIAL_ONLY and not map_.serial:
        return False
    if fault in UV_ONLY and "uv_mw_cm2" not in map_.write:
        return False
    if fault in ENCODER_ONLY and map_.turns and "stage_deg" not in map_.read:
        return False
    return fault not in FC23_ONLY or map_.exchange == "fc23"


class Exception_(Exception):
    def __init__(self, code):
        super().__init__(code)
        self.code = code


class Machine:
    """Registers, stage, lamps and watchdog."""

    def __init__(self, map_, travel, home=0, fault=None, at_frame=None, at_cycle=None, seed=1,
                 lockstep=True):
        """`travel`, `home`: in um, or of a stage that turns in degrees."""
        self.map = map_
        self.travel = travel
        self.fault, self.at_frame, self.at_cycle = fault, at_frame, at_cycle
        self.random = random.Random(seed)
        self.lock = threading.RLock()
        self.lockstep, self.began = lockstep, time.monotonic()
        self.log = []
        self.now_s, self.cycles = 0.0, 0
        self.raw = {}  # holding registers that are written
        for name, (address, kind, *_) in map_.write.items():
            for i in range(registers_of(kind)):
                self.raw[address + i] = 0
        self.put("command", map_.commands["off"])
        self.taken = {name: self.get(name) for name in map_.write}
        self.heartbeat, self.fed_s = None, 0.0
        self.echo = 0
        self.state = "idle"
        self.wait_for_off = False
        self.stage, self.speed = float(home), 0.0
        self.blue, self.uv = 0.0, 0.0
        self.stuck, self.rest_s = False, 0.0
        self.flags = {bit: False for bit in BITS}
        self.latched = False
        self.began_fault = False
        self.left = None  # requests that a fault of the wire still lasts

    # registers

    def get(self, name):
        address, kind, scale, offset = self.map.write[name]
        words = [self.raw[address + i] for i in range(registers_of(kind))]
        if self.map.order == "little":
            words.reverse()
        bits = 0
        for word in words:
            bits = bits << 16 | word
        size = 16 * len(words)
        if kind[0] == "i" and bits >> (size - 1):
            bits -= 1 << size
        return bits * scale + offset

    def put(self, name, raw):
        self.raw[self.map.write[name][0]] = raw

    def status_words(self):
        values = {
            "sequence_echo": self.echo, "state": self.map.states[self.state],
            "stage_um": self.stage, "stage_speed_um_s": self.speed,
            "stage_deg": self.stage, "stage_speed_deg_s": self.speed,
            "blue_measured": self.blue, "uv_measured": self.uv, "temperature_c": 24.0,
            "job_kept": self.taken.get("job", 0),
        }
        if self.on("unknown-state"):
            values["state"] = 99
        if self.on("echo-random"):
            values["sequence_echo"] = self.random.randrange(1, 65536)
        if self.on("impossible-stage"):
            values["stage_um"], values["stage_deg"] = 61500, 1e6
        if self.on("impossible-temperature"):
            values["temperature_c"] = -3276.8
        if self.on("impossible-light"):
            values["blue_measured"] = 30.0
        if self.flags["over_temperature"]:
            values["temperature_c"] = 90
        words = {}
        for name, (address, kind, scale, offset) in self.map.read.items():
            size = 16 * registers_of(kind)
            raw = round((values[name] - offset) / scale)
            low = -(1 << (size - 1)) if kind[0] == "i" else 0
            raw = max(low, min(raw, (1 << (size - (kind[0] == "i"))) - 1)) & ((1 << size) - 1)
            parts = [raw >> 16, raw & 0xffff] if size == 32 else [raw]
            if self.map.order == "little":
                parts.reverse()
            for i, part in enumerate(parts):
                words[address + i] = part
        for name, (address, bit) in self.map.bits.items():
            is_ = self.latched if name == "latched" else self.flags[name]
            words[address] = words.get(address, 0) | (1 << bit if is_ else 0)
        return words

    # the log

    def tell(self, what, **more):
        self.log.append({"at_s": round(self.now_s, 4), "cycle": self.cycles, "what": what, **more})

    # faults

    def on(self, name):
        return self.began_fault and self.fault == name

    def begin_fault_if_due(self):
        if self.fault is None or self.began_fault:
            return
        due = (self.at_cycle is not None and self.cycles >= self.at_cycle or
               self.at_frame is not None and self.taken["frame"] >= self.at_frame)
        if not due:
            return
        self.began_fault = True
        self.tell("fault begins", fault=self.fault, blue=self.blue, uv=self.uv)
        self.left = {"busy": 3, "silent-once": 1, "late-once": 1, "wrong-once": 1,
                     "close-once": 1}.get(self.fault)
        acts = {"door": "door_open", "stop-button": "stop_pressed", "hot": "over_temperature"}
        if self.fault in acts:
            self.flags[acts[self.fault]] = True
            self.trip(self.fault)
        elif self.fault == "lamp-failed":
            self.flags["lamp_failed"] = True
        elif self.fault == "stage-failed":
            self.flags["stage_failed"] = self.stuck = True
        elif self.fault == "fault":
            self.trip("of its own")
        elif self.fault in ("stopped", "idle"):
            self.dark(self.fault)
            self.state = self.fault
            self.wait_for_off = True
        elif self.fault == "restart":
            self.dark("restart")
            self.state, self.echo, self.speed = "idle", 0, 0.0
            self.wait_for_off = True
        elif self.fault == "stuck-stage":
            self.stuck = True
        elif self.fault == "stage-jumps":
            self.stage += 20 if self.map.turns else 100
        elif self.fault == "stage-falls":
            self.stage -= 20 if self.map.turns else 100

    def wire(self, *names):
        """Whether one of these faults of the wire shall happen to this request."""
        if not self.began_fault or self.fault not in names:
            return False
        if self.left is not None:
            if self.left == 0:
                return False
            self.left -= 1
        return True

    # what it does

    def shine(self, blue, uv, by):
        if self.on("lamp-sticks") and by != "relay":
            blue = self.blue
        elif self.on("lamp-drifts") and blue > 0:
            blue *= 1.3
        elif self.on("lamp-fades"):
            blue *= 0.7
        elif self.on("lamp-failed"):
            blue = 0.0
        if self.on("uv-sticks") and by != "relay":
            uv = self.uv
        elif self.on("uv-fails"):
            uv = 0.0
        if (blue, uv) != (self.blue, self.uv):
            self.tell("lamps", blue=round(blue, 4), uv=round(uv, 2), by=by)
        self.blue, self.uv = blue, uv

    def uv_asked(self):
        return self.taken.get("uv_mw_cm2", 0)

    def dark(self, by):
        self.shine(0.0, 0.0, by)

    def trip(self, why):
        self.dark("relay")
        self.state = "fault"
        self.latched = self.latched or bool(self.taken.get("job", 0))
        self.tell("trips", why=why)

    def word_of(self, raw):
        for word, value in self.map.commands.items():
            if value == raw:
                return word
        return None

    def written(self, addresses):
        """Set-points were written: what falls counts at once, the rest with the sequence number."""
        command = self.word_of(self.get("command"))
        if command is None:
            raise Exception_(3)
        covered = {name for name, (address, kind, *_) in self.map.write.items()
                   if address in addresses}
        if "command" in covered and command == "stop" and self.taken["command"] != self.get("command"):
            self.tell("stop is written")
        if not covered.isdisjoint(("blue_share", "uv_mw_cm2")):
            blue = self.get("blue_share")
            uv = self.get("uv_mw_cm2") if "uv_mw_cm2" in self.map.write else 0
            self.taken["blue_share"] = min(self.taken["blue_share"], blue)
            self.taken["uv_mw_cm2"] = min(self.uv_asked(), uv)
            if blue == 0 and uv == 0 and addresses.isdisjoint({self.map.write["sequence"][0]}):
                self.tell("lamps alone, 0")
            self.act("written")
        if "command" in covered and command == "stop" and "sequence" not in covered and \
                not self.on("no-stop-alone"):
            self.taken["command"] = self.get("command")
            self.act("written")
        if "sequence" in covered and self.get("sequence") != self.taken["sequence"]:
            before, frame = self.taken["command"], self.taken["frame"]
            self.pass_cycle()
            self.taken = {name: self.get(name) for name in self.map.write}
            if not self.on("echo-frozen"):
                self.echo = int(self.taken["sequence"])
            if self.taken["heartbeat"] != self.heartbeat:
                self.heartbeat, self.fed_s = self.taken["heartbeat"], self.now_s
            if self.taken["command"] != before:
                self.tell("command", command=command, blue=self.taken["blue_share"],
                          uv=self.uv_asked())
            if self.taken["frame"] != frame:
                self.tell("frame", frame=self.taken["frame"], stage=round(self.stage, 4),
                          blue=self.blue)
            self.act("written")
            self.begin_fault_if_due()

    def act(self, by):
        command = self.word_of(self.taken["command"])
        if command != "run":
            self.wait_for_off = False
        if command == "reset" and not any(
                self.flags[f] for f in ("door_open", "stop_pressed", "over_temperature")):
            if self.state == "fault":
                self.state, self.flags["watchdog_tripped"] = "idle", False
            self.latched = False
        if self.state == "fault" and self.on("forgives") and command == "run" and \
                self.fed_s == self.now_s:
            self.state = "idle"
        if self.state == "fault":
            return
        if command == "run" and not self.wait_for_off:
            if self.state != "running":
                self.state, self.fed_s = "running", self.now_s
            self.shine(self.taken["blue_share"], self.uv_asked(), by)
            return
        self.dark(by)
        if command == "stop":
            self.latched = self.latched or bool(self.taken.get("job", 0))
            self.state = "stopped"
        elif command in ("off", "reset"):
            self.state = "idle"

    def pass_cycle(self):
        self.cycles += 1
        if self.lockstep:
            self.pass_time(CYCLE_S)

    def pass_time(self, seconds):
        self.now_s += seconds
        self.move(seconds)
        watched = self.state == "running" or self.blue > 0 or self.uv > 0
        watchdog = min(self.taken["watchdog_s"] or WATCHDOG_S, WATCHDOG_S)
        if self.on("no-watchdog"):
            return
        if watched and self.state != "fault" and self.now_s - self.fed_s > watchdog:
            self.flags["watchdog_tripped"] = True
            self.trip("watchdog")

    def move(self, seconds):
        """Along a trapezoid: no faster than from where it can still stop."""
        if self.stuck:
            self.speed = 0.0
            return
        running = self.state == "running"
        target = min(max(self.taken[self.map.target], 0.0), self.travel)
        accelerate = max(self.taken[self.map.acceleration], 1.0)
        step = 0.0005
        self.rest_s += seconds
        while self.rest_s >= step:
            way = target - self.stage
            if not running and self.speed == 0:
                self.rest_s = 0.0
                break
            # As fast as it may be, and not yet braking when this time is over.
            ahead = way if self.speed > 0 else -way
            if running and abs(self.speed) == self.taken[self.map.speed] and ahead > (
                    abs(self.speed) * (self.rest_s + 2 * step) + self.speed ** 2 / (2 * accelerate)):
                self.stage += self.speed * self.rest_s
                self.rest_s = 0.0
                break
            self.rest_s -= step
            wanted = 0.0
            if running:
                left = max(0.0, abs(way) - abs(self.speed) * step)  # when this step is over
                wanted = min(self.taken[self.map.speed], (2 * accelerate * left) ** 0.5)
                wanted = wanted if way > 0 else -wanted
            most = accelerate * step
            change = max(-most, min(most, wanted - self.speed))
            near = 8 * accelerate * step * step  # the way of braking from four steps' change
            if running and abs(way) < near and abs(self.speed) < 4 * most:
                self.stage, self.speed, self.rest_s = target, 0.0, 0.0
                break
            # The mean of both speeds: exact for a constant acceleration.
            self.stage += (self.speed + change / 2) * step
            self.speed = wanted if abs(change) < most else self.speed + change

    def run_out(self):
        """The bridge has gone: time passes, and nobody feeds the watchdog."""
        with self.lock:
            for _ in range(round(2 * WATCHDOG_S / CYCLE_S) + 2):
                self.pass_time(CYCLE_S)
            self.tell("end", blue=self.blue, uv=self.uv, state=self.state,
                      stage=round(self.stage, 4), speed=round(self.speed, 4))

    # Modbus, without the header

    def carry_out(self, pdu):
        function = pdu[0]
        if not self.lockstep:
            self.pass_time(max(0.0, time.monotonic() - self.began - self.now_s))
        try:
            if self.wire("refuse-all", "busy"):
                raise Exception_(6 if self.fault == "busy" else 4)
            if function in (3, 4):
                if (function == 4) != (self.map.exchange == "fc16+fc4"):
                    raise Exception_(1)
                if self.wire("refuse-reads"):
                    raise Exception_(4)
                return self.read(function, *struct.unpack(">HH", pdu[1:5]))
            if function == 16:
                first, count = struct.unpack(">HH", pdu[1:5])
                self.write(first, count, pdu[6:])
                return bytes([16]) + pdu[1:5]
            if function == 23:
                if self.map.exchange != "fc23" or self.wire("refuse-function-23"):
                    raise Exception_(1)
                if self.wire("refuse-reads"):
                    raise Exception_(4)
                read_at, reads, first, count = struct.unpack(">HHHH", pdu[1:9])
                self.write(first, count, pdu[10:])
                return self.read(23, read_at, reads)
            raise Exception_(1)
        except Exception_ as e:
            return bytes([function | 0x80, e.code])

    def read(self, function, first, count):
        if not 1 <= count <= 125:
            raise Exception_(3)
        words = dict(self.status_words())
        if function != 4:
            words.update(self.raw)
        known = [a for a in words]
        if first < min(known) or first + count - 1 > max(known):
            raise Exception_(2)
        return bytes([function, 2 * count]) + b"".join(
            struct.pack(">H", words.get(first + i, 0)) for i in range(count))

    def write(self, first, count, data):
        if len(data) != 2 * count:
            raise Exception_(3)
        addresses = set(range(first, first + count))
        if not addresses <= set(self.raw):
            raise Exception_(2)
        if self.wire("refuse-writes"):
            raise Exception_(4)
        if self.fault in REFUSED:
            signal, code = REFUSED[self.fault]
            name = {"target": self.map.target, "speed": self.map.speed}.get(signal, signal)
            if self.map.write[name][0] in addresses and self.wire(self.fault):
                raise Exception_(code)
        before = dict(self.raw)
        for i in range(count):
            self.raw[first + i] = struct.unpack(">H", data[2 * i:2 * i + 2])[0]
        try:
            self.written(addresses)
        except Exception_:
            self.raw = before
            raise


def crc_of_byte(crc):
    for _ in range(8):
        crc = (crc >> 1) ^ 0xa001 if crc & 1 else crc >> 1
    return crc


CRC_OF_BYTES = [crc_of_byte(byte) for byte in range(256)]


def crc16(data):
    crc = 0xffff
    for byte in data:
        crc = crc >> 8 ^ CRC_OF_BYTES[(crc ^ byte) & 0xff]
    return struct.pack("<H", crc)


class Server:
    """The wire of a machine: TCP, or a pseudo terminal."""

    def __init__(self, machine):
        self.machine, self.ending = machine, False
        self.opened = 0
        # Closed to end the thread, which else sleeps until somebody asks for something.
        self.woken, self.wake = os.pipe()
        if machine.map.serial:
            self.master, self.slave = os.openpty()
            tty.setraw(self.master)
            tty.setraw(self.slave)
            self.where = os.ttyname(self.slave)
            self.thread = threading.Thread(target=self.serve_line, daemon=True)
        else:
            self.listener = socket.socket()
            self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.listener.bind(("127.0.0.1", 0))
            self.listener.listen(16)
            self.where = self.listener.getsockname()[1]
            self.thread = threading.Thread(target=self.serve_tcp, daemon=True)
        self.thread.start()

    def end(self):
        self.ending = True
        os.close(self.wake)
        self.thread.join()
        os.close(self.woken)
        if self.machine.map.serial:
            os.close(self.master)
            os.close(self.slave)
        else:
            self.listener.close()

    def answer(self, frame_of, pdu):
        """Bytes to send for a request, and whether to close; none: nothing."""
        m = self.machine
        with m.lock:
            if m.wire("deaf"):
                return b"", False
            if m.wire("close-before"):
                return b"", True
            reads_only = pdu[0] in (3, 4)
            answer = m.carry_out(pdu)
            if m.wire("silent", "silent-once") or reads_only and m.wire("silent-reads"):
                return b"", False
            wrong = next((w for w in ("wrong-unit", "wrong-length", "wrong-transaction",
                                      "wrong-protocol", "wrong-checksum", "wrong-once")
                          if m.wire(w)), None)
            if m.wire("wrong-function"):
                answer = bytes([answer[0] ^ 1]) + answer[1:]
            if m.wire("wrong-count") and answer[0] in (3, 4, 23):
                answer = bytes([answer[0], answer[1] - 2]) + answer[2:-2]
            frame = frame_of(answer, wrong)
            if m.wire("garbage"):
                frame = bytes(m.random.randrange(256) for _ in range(len(frame)))
            if m.wire("half"):
                frame = frame[:len(frame) // 2]
            if m.wire("twice"):
                frame += frame
            late = m.wire("late-once")
            close = m.on("close-each") or m.on("close-each-refusing") or m.wire("close-once")
            slow = m.on("trickle")
        if late:
            time.sleep(2 * RESPONSE_S)
        return (frame, close, slow) if slow else (frame, close)

    def serve_tcp(self):
        clients = {}
        while not self.ending:
            ready, _, _ = select.select([self.woken, self.listener] + list(clients), [], [])
            for s in ready:
                if s == self.woken:
                    break
                if s is self.listener:
                    client, _ = s.accept()
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self.opened += 1
                    with self.machine.lock:
                        self.machine.tell("connected")
                        hang_up = self.machine.on("hang-up")
                    if hang_up:
                        client.close()
                    else:
                        clients[client] = b""
                    continue
                try:
                    data = s.recv(4096)
                except OSError:
                    data = b""
                if not data or self.machine.on("hang-up"):
                    del clients[s]
                    s.close()
                    continue
                clients[s] += data
                if not self.serve_requests(s, clients):
                    del clients[s]
                    s.close()
        for s in clients:
            s.close()

    def serve_requests(self, s, clients):
        unit = self.machine.map.unit
        while len(clients[s]) >= 8:
            transaction, protocol, length, asked = struct.unpack(">HHHB", clients[s][:7])
            if len(clients[s]) < 6 + length:
                return True
            pdu, clients[s] = clients[s][7:6 + length], clients[s][6 + length:]
            if protocol != 0 or asked != unit:
                continue

            def frame_of(answer, wrong):
                return struct.pack(
                    ">HHHB",
                    transaction ^ (0x55 if wrong in ("wrong-transaction", "wrong-once") else 0),
                    7 if wrong == "wrong-protocol" else 0,
                    len(answer) + 1 + (4 if wrong == "wrong-length" else 0),
                    (unit ^ 2) if wrong == "wrong-unit" else unit) + answer

            frame, close, *slow = self.answer(frame_of, pdu)
            try:
                if slow:
                    for byte in frame:
                        s.sendall(bytes([byte]))
                        time.sleep(0.02)
                        if select.select([s], [], [], 0)[0] and not s.recv(1, socket.MSG_PEEK):
                            return False
                else:
                    s.sendall(frame)
            except OSError:
                return False
            if close:
                return False
        return True

    def serve_line(self):
        held = b""
        while not self.ending:
            if self.woken in select.select([self.woken, self.master], [], [])[0]:
                break
            try:
                held += os.read(self.master, 4096)
            except OSError:
                time.sleep(0.01)
                continue
            while True:
                size = self.request_bytes(held)
                if size is None or len(held) < size:
                    break
                request, held = held[:size], held[size:]
                if crc16(request[:-2]) != request[-2:]:
                    held = b""
                    break
                if request[0] != self.machine.map.unit:
                    continue

                def frame_of(answer, wrong):
                    unit = self.machine.map.unit ^ (2 if wrong == "wrong-unit" else 0)
                    frame = bytes([unit]) + answer
                    crc = crc16(frame)
                    if wrong in ("wrong-checksum", "wrong-once"):
                        crc = bytes([crc[0] ^ 1, crc[1]])
                    return frame + crc

                frame, _, *slow = self.answer(frame_of, request[1:-2])
                if slow:
                    for byte in frame:
                        os.write(self.master, bytes([byte]))
                        time.sleep(0.02)
                        if select.select([self.master], [], [], 0)[0]:
                            break
                elif frame:
                    os.write(self.master, frame)

    @staticmethod
    def request_bytes(held):
        if len(held) < 2:
            return None
        if held[1] in (3, 4):
            return 8
        if held[1] == 16:
            return 9 + held[6] if len(held) > 6 else None
        return 13 + held[10] if len(held) > 10 else None


def main():
    """On a bench, in real time: each says where it is and its part of a printer file; they end with stdin."""
    options = argparse.ArgumentParser()
    options.add_argument("machine", nargs="+", help="MAP, or MAP:FAULT")
    options.add_argument("--travel", type=float, default=2, help="mm, or turns")
    o = options.parse_args()
    servers = []
    for name in o.machine:
        map_name, _, fault = name.partition(":")
        if map_name not in MAPS or fault and fault not in FAULTS:
            options.error(f"no machine '{name}'")
        map_ = MAPS[map_name]
        machine = Machine(map_, o.travel * (360 if map_.turns else 1000), fault=fault or None,
                          at_cycle=0, lockstep=False)
        machine.begin_fault_if_due()
        servers.append(Server(machine))
        print(json.dumps({"toml": map_.toml(servers[-1].where)}), flush=True)
    sys.stdin.read()
    for server in servers:
        server.end()
        for entry in server.machine.log:
            print(json.dumps(entry))


if __name__ == "__main__":
    main()
