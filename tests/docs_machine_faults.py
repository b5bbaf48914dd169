#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Prints on the machine of docs_machine.py with faults, and judges them by the machine's own log.

    docs_machine_faults.py --bin build/bin --count 40            # every fault, frames by seed
    docs_machine_faults.py --bin build/bin --count 1000 --moments --seed 7
    docs_machine_faults.py --bin build/bin --turn                # a job on a machine that turns a vial

Lamps must be off before the stage is told to stop, stay off, and be off at the end; put off by what
the bridge writes wherever the machine takes it, and else by the machine's own watchdog. The bridge
must not say that lamps are off when they are not. A job without a fault shows each frame of each
turn once, at its angle, and in the light. Prints one line of JSON per print and a summary;
exit code 0: all held.
"""

import argparse
import json
import os
import random
import struct
import subprocess
import sys
import tempfile
import time

import docs_machine
from docs_machine import BENCH, BORNE, CYCLE_S, FAULTS, MAPS, OWN_ACT, OWN_WATCHDOG, WATCHDOG_S

TRAVEL_MM = 2
# Of jobs. A frame is shown for 15 degrees, 0.25 s or eight cycles.
TURN_DEG_S, ANGLES, TRAVEL_TURNS = 60, 24, 20


def box_stl(path, x_mm, y_mm, z_mm):
    corners = [(x, y, z) for z in (0, z_mm) for y in (0, y_mm) for x in (0, x_mm)]
    faces = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4), (2, 6, 3),
             (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)]
    with open(path, "w") as out:
        out.write("solid box\n")
        for face in faces:
            out.write("facet normal 0 0 0\nouter loop\n")
            for corner in face:
                out.write("vertex %g %g %g\n" % corners[corner])
            out.write("endloop\nendfacet\n")
        out.write("endsolid box\n")


def block_npy(path, slices, size, inside):
    """A volume of NumPy: 255 where inside(z, y, x)."""
    head = "{'descr': '|u1', 'fortran_order': False, 'shape': (%d, %d, %d), }" % (
        slices, size, size)
    head += " " * (-(len(head) + 11) % 64) + "\n"
    with open(path, "wb") as out:
        out.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())
        out.write(bytes(255 if inside(z, y, x) else 0 for z in range(slices) for y in range(size)
                        for x in range(size)))


def replaced(text, what, by):
    if what not in text:
        raise SystemExit(f"the printer file has no '{what}'")
    return text.replace(what, by, 1)


class Bench:
    """What is printed, and the printer's file but its registers."""
    maps = [m for m in MAPS.values() if not m.turns]
    travel = 1000 * TRAVEL_MM

    def __init__(self, bin_folder, printers, folder, slices):
        self.bin, self.folder = bin_folder, folder
        with open(os.path.join(printers, "dual-wavelength-dlp.toml")) as f:
            text = f.read()
        text = text[:text.index("# Holding registers")]
        for what, by in (
                ("width_px = 1280", "width_px = 32"), ("height_px = 800", "height_px = 24"),
                ("travel_mm = 100", f"travel_mm = {TRAVEL_MM}"),
                ("lift_mm = 3", "lift_mm = 1"), ("\nwarm_up_s = 2\n", "\nwarm_up_s = 0.1\n"),
                ("acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 10"),
                *self.limits):
            text = replaced(text, what, by)
        self.printer_text = text
        mesh, target = os.path.join(folder, "box.stl"), os.path.join(folder, "target.uvj")
        self.stack, printer = os.path.join(folder, "box.uvj"), os.path.join(folder, "plain.toml")
        box_stl(mesh, 0.8, 0.6, 0.05 * slices)
        with open(printer, "w") as f:
            f.write(text)
        for command in (
                ["slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50",
                 "--antialias", "off"],
                ["correct", target, "-o", self.stack, "--printer", printer, "--resin",
                 "custom-resin-1", "--speed-mm-h", "300", "--uv-mw-cm2", "200"]):
            self.run(command)

    limits = (("cycle_s = 0.01", f"cycle_s = {CYCLE_S}"),
              ("response_timeout_s = 0.04", f"response_timeout_s = {docs_machine.RESPONSE_S}"),
              ("heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 0.6"),
              ("watchdog_s = 0.3", f"watchdog_s = {WATCHDOG_S}"))

    def run(self, command):
        done = subprocess.run([os.path.join(self.bin, "slicecorr"), *command, "--quiet"],
                              capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(done.stderr)

    def print_on(self, map_, fault, number, at_frame=None, at_cycle=None, seed=1):
        machine = docs_machine.Machine(map_, self.travel, fault=fault, at_frame=at_frame,
                                       at_cycle=at_cycle, seed=seed)
        server = docs_machine.Server(machine)
        printer = os.path.join(self.folder, f"{number}.toml")
        with open(printer, "w") as f:
            f.write(self.printer_text + map_.toml(server.where))
        started = time.monotonic()
        try:
            done = subprocess.run(
                [os.path.join(self.bin, "printbridge"), "print", self.stack, "--printer", printer,
                 "--dir", os.path.join(self.folder, f"state{number}"), "--sink", "null",
                 "--lockstep", "--quiet"], capture_output=True, text=True, timeout=120)
            code, said = done.returncode, done.stderr
        except subprocess.TimeoutExpired:
            code, said = None, "no end after 120 s"
        server.end()
        os.unlink(printer)
        lit_at_end = machine.blue > 0 or machine.uv > 0
        machine.run_out()
        return {"map": map_.name, "fault": fault, "at_frame": at_frame, "at_cycle": at_cycle,
                "code": code, "said": said.strip(), "seconds": round(time.monotonic() - started, 2),
                "connections": server.opened, "cycles": machine.cycles, "lit_when_it_left": lit_at_end,
                "log": machine.log}


class TurnBench(Bench):
    maps = [m for m in MAPS.values() if m.turns]
    travel = 360 * TRAVEL_TURNS

    def __init__(self, bin_folder, printers, folder, _):
        self.bin, self.folder = bin_folder, folder
        with open(os.path.join(printers, "model-tomography-bench.toml")) as f:
            text = f.read()
        text = text[:text.index("# Holding registers")]
        for what, by in (
                ("width_px = 512", "width_px = 64"), ("height_px = 512", "height_px = 16"),
                ("pixel_um = 50.0", "pixel_um = 200"), ("[255, 2.0]", "[255, 20.0]"),
                ("outer_mm = 13.5", "outer_mm = 6"), ("inner_mm = 12.5", "inner_mm = 5"),
                ("deg_s = 25", f"deg_s = {TURN_DEG_S}"),
                ("travel_turns = 1000", f"travel_turns = {TRAVEL_TURNS}"),
                ("acceleration_deg_s2 = 50", "acceleration_deg_s2 = 100"),
                # The machine's clock stands while it refuses requests, for three cycles of 1.8.
                ("tolerance_deg = 1", "tolerance_deg = 6"), *self.limits):
            text = replaced(text, what, by)
        self.printer_text = text
        volume, printer = os.path.join(folder, "block.npy"), os.path.join(folder, "plain.toml")
        self.stack = os.path.join(folder, "block.frames")
        block_npy(volume, 2, 30, lambda z, y, x: 11 <= y < 20 and 9 <= x < 18)
        with open(printer, "w") as f:
            f.write(self.printer_text)
        figures = os.path.join(folder, "block.json")
        self.run(["tomo", "solve", "--volume", volume, "--voxel-mm", "0.2", "--printer", printer,
                  "--resin", "model-tomography-resin", "--angles", str(ANGLES), "--iterations",
                  "10", "-o", self.stack, "--json", figures])
        with open(figures) as f:
            self.turns = json.load(f)["turns"]


def judge_turns(result, turns, encoder):
    """What is wrong with a print of a job without a fault, by the machine's log."""
    if result["code"] != 0:
        return [f"exit code {result['code']}"]
    wrong = []
    shown = [e for e in result["log"] if e["what"] == "frame" and e["frame"] >= 0]
    if [e["frame"] for e in shown] != [n % ANGLES for n in range(turns * ANGLES)]:
        wrong.append(f"{len(shown)} frames, or not in their order")
    if not all(e["blue"] > 0.9 for e in shown):
        wrong.append("a frame without light")
    step, cycle = 360 / ANGLES, TURN_DEG_S * CYCLE_S
    for n, e in enumerate(shown):
        # It is told in the exchange after the frame was handed to the display, ahead of its angle;
        # without an encoder it is not known to a cycle where the vial is.
        begin = (n % ANGLES - 0.5) * step
        off = (e["stage"] - begin + 180) % 360 - 180
        if not -2 * cycle <= off <= (2 if encoder else 3) * cycle:
            wrong.append(f"frame {n} at {e['stage']}, {off} from its place")
            break
    end = result["log"][-1]
    if abs((end["stage"] + 180) % 360 - 180) > 0.01 or end["speed"] != 0:
        wrong.append(f"the vial ends at {end['stage']}, {end['speed']} degrees a second")
    return wrong


def judge(result):
    """What is wrong, by the machine's own log; an empty list: nothing."""
    wrong, log, fault = [], result["log"], result["fault"]
    begun = next((i for i, e in enumerate(log) if e["what"] == "fault begins"), None)
    lamps = [(i, e) for i, e in enumerate(log) if e["what"] == "lamps"]

    def lit_before(place):
        last = [e for i, e in lamps if i < place]
        return bool(last) and (last[-1]["blue"] > 0 or last[-1]["uv"] > 0)

    end = log[-1]
    if end["blue"] > 0 or end["uv"] > 0:
        wrong.append("a lamp is lit at the end")
    if result["code"] is None:
        wrong.append("it has no end")
    stop = next((i for i, e in enumerate(log) if e["what"] == "stop is written" or
                 e["what"] == "command" and e["command"] == "stop"), None)
    sticks = fault in ("lamp-sticks", "uv-sticks")
    refused = fault in ("refuse-blue", "refuse-uv")
    if stop is not None:
        if lit_before(stop) and not sticks and not refused:
            wrong.append("lamps were on when the stage was told to stop")
        if any(e["blue"] > 0 or e["uv"] > 0 for i, e in lamps if i > stop) and not sticks:
            wrong.append("a lamp came on after the stop")
    if begun is None:
        # The print was over before, or it never began.
        if result["code"] not in (0, 4):
            wrong.append(f"exit code {result['code']}")
        return wrong
    borne = fault in BORNE
    if borne and result["code"] != 0:
        wrong.append(f"exit code {result['code']}: this is borne")
    if not borne and result["code"] not in (0, 4):
        wrong.append(f"exit code {result['code']}")
    if result["code"] == 4:
        lit = log[begun]["blue"] > 0 or log[begun]["uv"] > 0 or any(
            e["blue"] > 0 or e["uv"] > 0 for i, e in lamps if i > begun)
        by = [e["by"] for i, e in lamps if i > begun and e["blue"] == 0 and e["uv"] == 0]
        if lit and fault not in OWN_WATCHDOG | OWN_ACT and by[-1:] != ["written"]:
            wrong.append(f"lamps were put off by {by[-1:]}, not by the bridge")
        # From the fault to the dark: what is borne without an answer, then the watchdog's time.
        if by:
            dark = next(e for i, e in lamps if i > begun and e["blue"] == 0 and e["uv"] == 0)
            took = dark["at_s"] - log[begun]["at_s"]
            # A lamp that stays as bright as it is asked to be is found when it is asked for less.
            if not sticks and took > 2 + 2 * WATCHDOG_S:
                wrong.append(f"lamps were on for {took:.2f} s more")
        if result["lit_when_it_left"] and "State: lamps are off" in result["said"]:
            wrong.append("it says that lamps are off, and they are not")
    if result["code"] == 0 and not borne and fault in FAULTS and result["lit_when_it_left"]:
        wrong.append("printed, and a lamp is lit")
    return wrong


def cases(bench, count, seed, moments, slices):
    """Each fault on a map that suits it, over and over, with maps and moments by the seed."""
    chosen = random.Random(seed)
    names = [name for name in FAULTS if name not in BENCH and
             any(docs_machine.suits(name, m) for m in bench.maps)]
    number = 0
    while number < count:
        chosen.shuffle(names)
        for fault in names:
            maps = [m for m in bench.maps if docs_machine.suits(fault, m)]
            map_ = chosen.choice(maps)
            when = ({"at_cycle": chosen.randrange(5, 330)} if moments else
                    {"at_frame": chosen.randrange(0, 10) * slices // 10})
            yield map_, fault, when
            number += 1
            if number == count:
                return


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--bin", required=True)
    here = os.path.dirname(os.path.abspath(__file__))
    options.add_argument("--printers", default=os.path.join(here, "..", "resins", "printers"))
    options.add_argument("--count", type=int, help="of prints with faults [each fault once]")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--moments", action="store_true", help="at random cycles, not at frames")
    options.add_argument("--turn", action="store_true", help="a job, on machines that turn a vial")
    options.add_argument("--only", help="one fault, on every map that suits it")
    options.add_argument("--part", default="0/1", help="i/n: every n-th of them")
    options.add_argument("--logs", help="a folder for the logs of those that did not hold")
    o = options.parse_args()
    part, parts = (int(x) for x in o.part.split("/"))
    bad, ran, codes, began = 0, 0, {}, 0
    with tempfile.TemporaryDirectory() as folder:
        # Enough of them where every moment counts, and the first frames of a turn.
        slices = 10 if o.moments or o.turn else 4
        bench = (TurnBench if o.turn else Bench)(o.bin, o.printers, folder, slices)
        count = len(FAULTS) - len(BENCH) if o.count is None else o.count
        if o.only:
            todo = [(m, o.only, {"at_frame": 3}) for m in bench.maps
                    if docs_machine.suits(o.only, m)]
        else:
            todo = list(cases(bench, count, o.seed, o.moments, slices))
            if o.turn:
                todo = [(m, None, {}) for m in bench.maps] + todo
        for number, (map_, fault, when) in enumerate(todo):
            if number % parts != part:
                continue
            result = bench.print_on(map_, fault, number, seed=o.seed + number, **when)
            wrong = judge(result)
            if fault is None:
                wrong += judge_turns(result, bench.turns, "stage_deg" in map_.read)
            ran += 1
            bad += 1 if wrong else 0
            began += any(e["what"] == "fault begins" for e in result["log"])
            codes[str(result["code"])] = codes.get(str(result["code"]), 0) + 1
            line = {k: v for k, v in result.items() if k != "log"}
            print(json.dumps({"number": number, **line, "wrong": wrong}), flush=True)
            if wrong and o.logs:
                os.makedirs(o.logs, exist_ok=True)
                with open(os.path.join(o.logs, f"{number}.json"), "w") as f:
                    json.dump({**result, "wrong": wrong}, f, indent=1)
    print(json.dumps({"prints": ran, "faults_begun": began, "did_not_hold": bad, "codes": codes}))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
