#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What a killed program leaves in a folder goes with the next run there of any other.

    left_behind.py --bin build/bin [--followers A,B] [--json FILE] [KILLED...]

Each program that writes into folders that people choose is killed (kill -9) as soon as something temporary of it stands in
the folder; then each of these programs, one after the other, makes a file of its own there, and nothing temporary may
be left. Two kills of each kind with each follower: one as soon as there is something, one a moment later, where it lives
so long. Where a program that corrects in place is killed, the note of which file it was stays, for who watches the folder has to take
that up again. A line of JSON per killed program on stdout; exit code 0: all held.
"""

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time

import kills_parts
from cases import add_options, run_cases
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs, hidden

TRIES = 40


class Case:
    def __init__(self, options):
        self.folder = tempfile.mkdtemp(prefix="left-")
        self.programs = Programs(options.bin, self.folder)
        self.wrong, self.told = [], {"kills": 0, "left a file": 0, "followers": 0, "runs that were too quick": 0}
        box_stl(self.path("part.stl"), 2, 1.5, 1)
        kills_parts.sl1(self.path("part.sl1"), 60)
        kills_parts.sl1(self.path("small.sl1"), 4)
        self.programs.sound("slicecorr", "run", "part.stl", "-o", "made.uvj", "--layer-um", "50", *SPEED, *LIGHT, "--quiet")
        self.printed()

    def path(self, name):
        return os.path.join(self.folder, name)

    def tell(self, text):
        if text not in self.wrong:
            self.wrong.append(text)
            print(f"left_behind: {text}", file=sys.stderr, flush=True)

    def printed(self):
        """A print whose report can be written anywhere."""
        mesh, target, stack = kills_parts.fast_printer(self.path("fast.toml"), 2)
        printer = self.path("fast.toml")
        self.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
        self.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um",
                            "110", *SPEED)
        sim, modbus = self.programs.machine(printer)
        try:
            self.programs.sound("printbridge", "print", stack, "--printer", printer, "--dir", "state", "--modbus", modbus, "--sink", "null",
                                "--lockstep")
        finally:
            sim.terminate()
            sim.wait()

    def fresh(self):
        shutil.rmtree(self.path("out"), ignore_errors=True)
        os.mkdir(self.path("out"))
        shutil.copy(self.path("part.sl1"), self.path("out/old.sl1"))

    def left(self):
        """What is temporary; earlier versions of resins stay, and the note of a file that was being corrected."""
        names = [n for n in hidden(self.path("out")) if n != ".history"]
        found = []
        for name in names:
            path = self.path(f"out/{name}")
            if name.startswith(".slicecorr-post-") and os.path.isdir(path) and os.listdir(path) == ["in-work"]:
                continue
            found.append(name)
        return found

    def killed(self, words, later_s):
        """Whether it left something. The whole session is killed: workers, too."""
        process = self.programs.start(*words)
        while process.poll() is None and not self.left():
            pass
        time.sleep(later_s)
        hit = process.poll() is None
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
        self.told["kills"] += hit
        return bool(self.left())

    def end(self):
        shutil.rmtree(self.folder, ignore_errors=True)


def run(case, out):
    return ["slicecorr", "run", "part.stl", "-o", f"out/{out}.uvj", "--layer-um", "50", *SPEED, *LIGHT, "--quiet"]


def convert(case, out):
    return ["slicecorr", "convert", "part.sl1", "-o", f"out/{out}.tar.gz", "--quiet"]


def folder(case, out):
    return ["slicecorr", "convert", "part.sl1", "-o", f"out/{out}/", "--quiet"]


def report(case, out):
    return ["slicecorr", "report", "made.uvj", "-o", f"out/{out}-page.html", "--quiet"]


def info(case, out):
    return ["slicecorr", "info", "part.sl1", "--json", f"out/{out}-info.json"]


def post(case, out):
    shutil.copy(case.path("part.sl1"), case.path(f"out/{out}.sl1"))
    return ["slicecorr-post", *LIGHT, "--threads", "1", "--quiet", f"out/{out}.sl1"]


def add(case, out):
    return ["resinctl", "add", "figure-2-2", "--replace", "-o", "out", "--quiet"]


def farm(case, out):
    shutil.rmtree(case.path("farm"), ignore_errors=True)
    case.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT, "--out", "out", "--name",
                        out, "--quiet")
    case.programs.sound("slicefarm", "set", "--dir", "farm", "min-free-mb=0")
    return ["slicefarm", "run", "--dir", "farm", "--until-empty", "--jobs", "1", "--quiet"]


def bridge(case, out):
    return ["printbridge", "report", "--printer", "fast.toml", "--dir", "state", "-o", f"out/{out}-print.html"]


PROGRAMS = {f.__name__: f for f in (run, convert, folder, report, info, post, add, farm, bridge)}


def followed(killed, case, followers):
    for name in followers:
        follower = PROGRAMS[name]
        for later_s in (0, 0.002):
            for _ in range(TRIES):
                case.fresh()
                if case.killed(killed(case, "dead"), later_s):
                    break
                case.told["runs that were too quick"] += 1
            else:
                if later_s == 0:
                    case.tell(f"{killed.__name__} was never killed with something left, before {name}")
                continue
            case.told["left a file"] += 1
            before = case.left()
            done = case.programs.run(*follower(case, "next"))
            if done.returncode != 0:
                case.tell(f"{name} after {killed.__name__}: {done.returncode}: {done.stderr.strip()[-300:]}")
            case.told["followers"] += 1
            after = case.left()
            if after:
                case.tell(f"{name} after {killed.__name__} leaves {after} of {before}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--followers", default=",".join(PROGRAMS), help="programs that run next, with commas between them")
    add_options(parser)
    options = parser.parse_args()
    followers = options.followers.split(",")
    return run_cases(options, PROGRAMS, lambda: Case(options), lambda killed, case: followed(killed, case, followers),
                     lambda case: case.told)


if __name__ == "__main__":
    sys.exit(main())
