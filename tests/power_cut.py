#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What files would be after a power cut at each point of a run.

    power_cut.py --bin build/bin --library build/tests/power-cut.so [--json FILE] [CASE...]

Programs run with the library loaded before them, which writes down writes, waits for the disk, and names in
their order, with what files held then. The worst disk keeps nothing of a file but what was waited for, while
names come at once; and it loses names whose folder was not waited for, folders that were made among them. Under this disk

- a name that counts leads to the old file or the new one, whole, at every point;
- what a program that ended well has named is there;
- of a database with its write-ahead log every state on the way opens, is sound, and has no job less than before;
  a job that it calls done has its outputs on the disk; a job that waits has its inputs there;
- of what is appended to (journals, tables) every line but the last is whole.

A line of JSON per case on stdout; exit code 0: all held.
"""

import argparse
import http.client
import json
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import zlib

import kills_parts
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs

# What a power cut may spoil, because nothing of it is believed afterwards: attempts that it ended, entries of the cache
# before their hashes are compared, logs and sockets, and what has no name that counts.
GIVEN_UP = ("/store/attempts/", "/store/cache/", "/logs/")
APPENDED = (".jsonl", ".csv")
DATABASE = ".sqlite"


def counts(path):
    return not os.path.basename(path).startswith(".") and not any(g in path for g in GIVEN_UP) and "/." not in path


def text_of(path):
    with open(path, "rb") as file:
        return file.read()


class Disk:
    """What is certain to be on the disk, event by event."""

    def __init__(self, folder, copies):
        self.folder, self.copies = folder, copies
        self.kept = {}       # path -> bytes that were waited for; None: nothing yet
        self.now = {}        # path -> bytes of a database or its log, whatever was waited for
        self.written = set() # since they were waited for
        self.unsaid = {}     # folder -> names in it that may be lost
        self.made = set()    # folders whose own names may be lost
        self.named, self.wrong, self.points, self.states = set(), [], 0, 0
        self.jobs = {}       # of the database, the last state seen
        self.before = set()  # there before the run
        self.synced_all = False

    def fail(self, text):
        text = text.replace(self.folder + "/", "")
        if text not in self.wrong:
            self.wrong.append(text)

    def copy(self, name):
        return text_of(os.path.join(self.copies, name))

    def below(self, folder):
        return [p for p in self.written if p.startswith(folder + "/")]

    def event(self, what, *more):
        self.points += 1
        if what == "write":
            self.written.add(more[0])
        elif what == "all":
            self.written.clear()
            self.unsaid.clear()
            self.made.clear()
            self.synced_all = True
        elif what == "folder":
            self.unsaid.pop(more[0], None)
            self.made = {p for p in self.made if os.path.dirname(p) != more[0]}
        elif what == "made":
            self.made.add(more[0])
        elif what == "sync":
            self.written.discard(more[0])
            if more[1] != "-":
                self.kept[more[0]] = self.now[more[0]] = self.copy(more[1])
                self.look(more[0])
        elif what == "with":
            self.now[more[0]] = self.copy(more[1])
        elif what == "gone":
            self.kept.pop(more[0], None)
            self.now.pop(more[0], None)
            self.written.discard(more[0])
        elif what == "name":
            self.rename(*more)

    def rename(self, from_, to, copy):
        self.made.discard(from_)
        if copy == "-":
            moved = [p for p in [*self.kept, *self.written] if p.startswith(from_ + "/")]
            if counts(to) and self.below(from_):
                self.fail(f"{to} has its name before what is in it is on the disk")
            for path in moved:
                new = to + path[len(from_):]
                if path in self.kept:
                    self.kept[new] = self.kept.pop(path)
                if path in self.written:
                    self.written.discard(path)
                    self.written.add(new)
        else:
            is_, was = self.copy(copy), self.kept.get(from_)
            if was is None and from_ not in self.written and (from_ in self.before or self.synced_all):
                was = is_
            if counts(to) and was != is_:
                self.fail(f"{to} has its name before its bytes are on the disk"
                          f" ({len(was) if was is not None else 'none'} of {len(is_)})")
            self.kept[to] = self.kept.pop(from_, None) or was
            self.written.discard(from_)
        self.named.add(to)
        if counts(to):
            self.unsaid.setdefault(os.path.dirname(to), set()).add(to)

    def look(self, path):
        if not counts(path):
            return
        if path.endswith(APPENDED):
            lines = self.kept[path].split(b"\n")[:-1]
            for line in lines:
                if path.endswith(".jsonl") and line:
                    try:
                        json.loads(line)
                    except ValueError:
                        self.fail(f"{path} has the line {line[:60]}")
            if path.endswith(".csv") and len({line.count(b",") for line in lines}) > 1:
                self.fail(f"{path} has rows of different lengths")
        if DATABASE in path:
            base = path[:path.index(DATABASE) + len(DATABASE)]
            for main in (self.kept.get(base), self.now.get(base)):
                if main:
                    self.database(base, main, self.kept.get(base + "-wal"))

    def database(self, base, main, wal):
        self.states += 1
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "db")
            for ending, data in (("", main), ("-wal", wal)):
                if data is not None:
                    with open(path + ending, "wb") as file:
                        file.write(data)
            try:
                with sqlite3.connect(path) as db:
                    sound = db.execute("PRAGMA integrity_check").fetchone()[0]
                    if sound != "ok":
                        self.fail(f"{base}: {sound}")
                    jobs = {row[0]: row[1:] for row in db.execute("SELECT j.id, j.state, j.output_folder, j.name, w.format "
                                                                    "FROM jobs j JOIN works w ON w.key = j.key")}
                    inputs = [row[0] for row in db.execute("SELECT file FROM inputs")]
            except sqlite3.Error as error:
                self.fail(f"{base}: {error}")
                return
            finally:
                if "db" in locals():
                    db.close()
        if set(self.jobs) - set(jobs):
            self.fail(f"{base}: jobs {sorted(set(self.jobs) - set(jobs))} are no more there")
        self.jobs = jobs
        certain = {p for p in self.named if p not in set().union(*self.unsaid.values(), set())}
        for state, out, name, form in jobs.values():
            for ending in (form, "html", "json"):
                if state == "done" and os.path.join(out, f"{name}.{ending}") not in certain | self.before:
                    self.fail(f"{base} calls {name} done before {name}.{ending} is on the disk")
        for file in inputs:
            where = os.path.join(os.path.dirname(base), "store/inputs", file[:2], file)
            if where not in certain | self.before:
                self.fail(f"{base} knows the input {file} before it is on the disk")

    def end(self):
        for names in self.unsaid.values():
            for name in names:
                self.fail(f"{name} may lose its name")
        for name in self.named:
            if counts(name) and os.path.exists(name):
                for folder in self.made:
                    if name.startswith(folder + "/"):
                        self.fail(f"{name} is in {folder}, which may lose its name")


class Case:
    def __init__(self, options, name):
        self.name, self.folder = name, os.path.realpath(tempfile.mkdtemp(prefix="power-"))
        self.copies = self.folder + "-copies"
        os.mkdir(self.copies)
        self.programs = Programs(options.bin, self.folder)
        self.library = os.path.abspath(options.library)
        self.disk = None
        self.points, self.states, self.named, self.wrong = 0, 0, set(), []
        self.jobs = {}

    def path(self, name):
        return os.path.join(self.folder, name)

    def judged(self, *words, code=0, beside=None):
        """Runs a program to its end; with `beside`, a server, which is asked for something while it runs, and ended then."""
        before = {os.path.join(at, n) for at, folders, files in os.walk(self.folder) for n in files + folders}
        databases = {p: text_of(p) for p in before if DATABASE in p and os.path.isfile(p)}
        with open(os.path.join(self.copies, "log"), "w"):
            pass
        more = {"LD_PRELOAD": self.library, "POWER_SAVE": self.copies, "ASAN_OPTIONS": "verify_asan_link_order=0"}
        if beside:
            server = self.programs.start(*words, more=more, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            beside(server.stdout.readline().decode().strip().split("//")[-1].rstrip("/"))
            server.terminate()
            _, said = server.communicate(timeout=20)
            done = subprocess.CompletedProcess(words, 0 if server.returncode == 130 else server.returncode, "", said.decode())
        else:
            done = self.programs.run(*words, more=more)
        disk = Disk(self.folder, self.copies)
        disk.before, disk.jobs = before, self.jobs
        disk.kept.update(databases)
        disk.now.update(databases)
        if done.returncode != code:
            disk.fail(f"{' '.join(map(str, words))}: {done.returncode}: {done.stderr.strip()}")
        with open(os.path.join(self.copies, "log"), errors="surrogateescape") as log:
            for line in log:
                parts = line.rstrip("\n").split("\t")
                parts[1:] = [os.path.normpath(p) if p.startswith("/") else p for p in parts[1:]]
                if len(parts) == 1 or parts[1].startswith(self.folder + "/") or parts[1] == self.folder:
                    disk.event(*parts)
        disk.end()
        self.points += disk.points
        self.states += disk.states
        self.named |= {n for n in disk.named if counts(n)}
        self.wrong += disk.wrong
        self.jobs = disk.jobs
        for name in os.listdir(self.copies):
            os.unlink(os.path.join(self.copies, name))
        return done

    def end(self):
        for folder in (self.folder, self.copies):
            shutil.rmtree(folder, ignore_errors=True)
        return {"case": self.name, "points": self.points, "names": len(self.named), "states of a database": self.states,
                "wrong": self.wrong}


def stacks(case):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    kills_parts.sl1(case.path("part.sl1"), 8)
    case.judged("slicecorr", "slice", "part.stl", "-o", "t.uvj", "--layer-um", "50", "--printer", "small.toml")
    case.judged("slicecorr", "correct", "t.uvj", "-o", "c.uvj", *SPEED, *LIGHT)
    for _ in range(2):
        case.judged("slicecorr", "run", "part.stl", "-o", "r.uvj", "--layer-um", "50", *SPEED, *LIGHT)
        for name in ("out.tar.gz", "out.cws", "out.goo", "slices/"):
            case.judged("slicecorr", "convert", "part.sl1", "-o", name)
    case.judged("slicecorr", "report", "c.uvj", "--target", "t.uvj", "-o", "page.html")
    case.judged("slicecorr", "solid", "c.uvj", "-o", "solid.stl")
    case.judged("slicecorr", "info", "c.uvj", "--json", "info.json")


def png(path, side):
    """A grey square of `side` pixels on black, twice as wide."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + bytes(255 if side // 2 <= x < side + side // 2 and side // 2 <= y < side + side // 2 else 0
                                  for x in range(2 * side)) for y in range(2 * side))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 2 * side, 2 * side, 8, 0, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def pictures(case):
    """Commands that write several pictures make their folder, and those above it."""
    png(case.path("target.png"), 16)
    case.judged("slicecorr", "hologram", "target.png", "-o", "phase.png", "--pitch-um", "8", "--wavelength-nm", "532", "--focal-mm", "100",
                "--steps", "3", "--stack", "seen/depth", "--stack-mm=0,1,1")
    case.judged("slicecorr", "tomo", "target", "scale", "--printer", "webber-vial", "-o", "bench/scale")


def post(case):
    kills_parts.sl1(case.path("part.sl1"), 8)
    case.judged("slicecorr-post", *LIGHT, "--backup", "--report=both", "part.sl1")
    case.judged("slicecorr-post", "--undo", "part.sl1")


def resins(case):
    os.mkdir(case.path("own"))
    for more in ([], ["--replace", "-m", "again"]):
        case.judged("resinctl", "add", "figure-2-2", "-o", "own", *more)


def farm(case):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    for n in range(3):
        case.judged("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", "--speed-mm-h", 800 + n, *LIGHT,
                    "--out", "out", "--name", f"part{n}")
    case.judged("slicefarm", "run", "--dir", "farm", "--until-empty")
    states = [job[0] for job in case.jobs.values()]
    if states != ["done"] * 3:
        case.wrong.append(f"after the last wait for the disk the record says {states}")
    case.judged("slicefarm", "gc", "--dir", "farm")


def served(case):
    """Parts that the server has said to have, and jobs that it has said to have queued."""
    token = "0123456789abcdef" * 2
    with open(os.open(case.path("token"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
        file.write(token + "\n")
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)

    def ask(address):
        def sent(method, path, body):
            connection = http.client.HTTPConnection(address, timeout=20)
            connection.request(method, path, body, {"Authorization": "Bearer " + token, "Content-Type": "application/json"})
            answer = connection.getresponse()
            text = answer.read()
            if answer.status not in (200, 201):
                case.wrong.append(f"{path}: {answer.status} {text[:200]}")
            return json.loads(text)
        for n in range(2):
            part = sent("PUT", "/api/v1/parts/part.stl", text_of(case.path("part.stl")))["part"]
            sent("POST", "/api/v1/jobs", json.dumps({"jobs": [{"parts": [part], "name": f"up{n}", "printer": "small", "resin": "figure-2-2",
                                                               "ha_um": 110, "layer_um": 50, "speed_mm_h": 800}]}))
        sent("PUT", "/api/v1/parts/waits.stl", text_of(case.path("part.stl")))
    case.judged("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", "--token-file", case.path("token"), beside=ask)
    if len(case.jobs) != 2:
        case.wrong.append(f"after the last wait for the disk the record has {len(case.jobs)} jobs")


def machines(case):
    """What is known of a printer on the network: what was sent, and what was started."""
    with kills_parts.octoprint(case.programs):
        kills_parts.sl1(case.path("part.sl1"), 8)
        case.judged("slicefarm", "machines", "send", "part.sl1", "octo", "--dir", "farm")
        case.judged("slicefarm", "machines", "start", "octo", "--plate-is-empty", "--vat-is-filled", "--dir", "farm")
        case.judged("slicefarm", "machines", "stop", "octo", "--dir", "farm")


def bridge(case):
    mesh, target, stack = kills_parts.fast_printer(case.path("fast.toml"), 3)
    printer = case.path("fast.toml")
    case.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
    case.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um",
                        "110", *SPEED)
    for fault in ([], ["--fault", "lamp-fails@frame:1"]):
        sim = case.programs.start("printer-sim", "--printer", printer, "--listen", "127.0.0.1:0", "--frames", "tcp:127.0.0.1:0",
                                  "--quiet", *fault, stdout=subprocess.PIPE)
        try:
            where = json.loads(sim.stdout.readline())
            modbus = where["modbus"] if where["modbus"].startswith("tcp:") else "tcp:" + where["modbus"]
            words = ["printbridge", "print", stack, "--printer", printer, "--dir", "state", "--modbus", modbus, "--sink",
                     where["frames"], "--machine-is-clear"]
            case.judged(*words, code=4 if fault else 0)
            case.judged("printbridge", "report", "--printer", printer, "--dir", "state", "-o", "print.html")
        finally:
            sim.terminate()
            sim.wait()


CASES = {f.__name__: f for f in (stacks, pictures, post, resins, farm, served, machines, bridge)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--library", required=True)
    parser.add_argument("--json", help="also write the lines here")
    parser.add_argument("cases", nargs="*", metavar="CASE")
    options = parser.parse_args()
    wrong = 0
    for name in options.cases or CASES:
        case = Case(options, name)
        try:
            CASES[name](case)
        finally:
            line = case.end()
        wrong += len(line["wrong"])
        print(json.dumps(line), flush=True)
        if options.json:
            with open(options.json, "a") as file:
                file.write(json.dumps(line) + "\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
