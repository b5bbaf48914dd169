#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Wall clocks that jump (libfaketime) and programs that are stopped for a while (SIGSTOP).

    clocks.py --bin build/bin [--stop-s S] [--jumps N] [--json FILE] [CASE...]

Jumps are by a minute, an hour, and a day, to and fro, several a second, of the program alone: the machine that it drives
and who watches it have the true time. The steady clock does not jump, as with a real one. A line of JSON per case on stdout;
exit code 0: all held; 77: there is no libfaketime.
"""

import argparse
import csv
import glob
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request

import kills_parts
from cases import add_options, run_cases
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs, sha256

JUMPS = ["+1d", "+0", "-1d", "+1h", "-1h", "+1m", "-1m", "+2d", "-2d", "+30d"]


def libfaketime():
    found = glob.glob("/usr/lib/*/faketime/libfaketime.so.1")
    return found[0] if found else None


class Case:
    def __init__(self, options):
        self.folder = tempfile.mkdtemp(prefix="clocks-")
        self.programs = Programs(options.bin, self.folder)
        self.options, self.wrong, self.told = options, [], {}
        self.ended, self.jumped = threading.Event(), 0

    def path(self, name):
        return os.path.join(self.folder, name)

    def tell(self, text):
        self.wrong.append(text)
        print(f"clocks: {text}", file=sys.stderr, flush=True)

    def jumping(self):
        """The environment of a program whose wall clock jumps from now on."""
        path = self.path("jump")
        with open(path, "w") as file:
            file.write("+0")

        def jump():
            while not self.ended.wait(0.15):
                with open(path + ".new", "w") as file:
                    file.write(JUMPS[self.jumped % len(JUMPS)])
                os.rename(path + ".new", path)
                self.jumped += 1
        threading.Thread(target=jump, daemon=True).start()
        return {"LD_PRELOAD": libfaketime(), "FAKETIME_TIMESTAMP_FILE": path, "FAKETIME_NO_CACHE": "1",
                "FAKETIME_DONT_FAKE_MONOTONIC": "1", "DONT_FAKE_MONOTONIC": "1",
                # Files keep the times that they have.
                "NO_FAKE_STAT": "1"}

    def end(self):
        self.ended.set()
        shutil.rmtree(self.folder, ignore_errors=True)

    # --- farm

    def queue(self, jobs):
        box_stl(self.path("part.stl"), 2, 1.5, 1)
        for n in range(jobs):
            self.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", "--speed-mm-h", 800 + n,
                                *LIGHT, "--out", "out", "--name", f"part{n}")
        self.programs.sound("slicefarm", "set", "--dir", "farm", "retry-delay-s=0", "min-free-mb=0")

    def rows(self, sql):
        with sqlite3.connect(f"file:{self.path('farm/farm.sqlite')}?mode=ro", uri=True) as db:
            return db.execute(sql).fetchall()

    def all_done_once(self):
        states = [s for s, in self.rows("SELECT state FROM jobs")]
        if set(states) != {"done"}:
            self.tell(f"jobs are {states}")
        attempts = self.rows("SELECT job, COUNT(*) FROM attempts GROUP BY job HAVING COUNT(*) > 1")
        if attempts:
            self.tell(f"jobs with several attempts: {attempts}, {self.rows('SELECT reason, COUNT(*) FROM attempts GROUP BY reason')}")

    # --- bridge

    def machine(self, slices):
        mesh, target, stack = kills_parts.fast_printer(self.path("fast.toml"), slices)
        printer = self.path("fast.toml")
        self.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
        self.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um", "110",
                            *SPEED)
        self.events = self.path("events.jsonl")
        self.sim = self.programs.start("printer-sim", "--printer", printer, "--listen", "127.0.0.1:0", "--frames", "tcp:127.0.0.1:0",
                                       "--record-events", self.events, "-o", "shown.uvj", "--quiet", stdout=subprocess.PIPE)
        where = json.loads(self.sim.stdout.readline())
        modbus = where["modbus"] if where["modbus"].startswith("tcp:") else "tcp:" + where["modbus"]
        return ["printbridge", "print", stack, "--printer", printer, "--dir", "state", "--modbus", modbus, "--sink", where["frames"],
                "--machine-is-clear"]

    def seen(self):
        with open(self.events) as file:
            return [json.loads(line) for line in file if line.endswith("\n") and "event" in line]

    def wait_for(self, event, most_s=20):
        until = time.monotonic() + most_s
        while time.monotonic() < until:
            if os.path.exists(self.events) and any(e.get("event") == event for e in self.seen()):
                return True
            time.sleep(0.02)
        return False

    def frames(self):
        paths = glob.glob(self.path("state/*/frames.csv"))
        with open(paths[0]) as file:
            return list(csv.DictReader(file))

    def end_sim(self):
        self.sim.terminate()
        self.sim.wait()


def lit(events):
    on = set()
    for e in events:
        what = e.get("event", "")
        if what in ("blue on", "uv on"):
            on.add(what.split()[0])
        if what in ("blue off", "uv off"):
            on.discard(what.split()[0])
    return on


def farm_jumps(case):
    case.queue(case.options.jobs)
    begin = time.monotonic()
    done = case.programs.run("slicefarm", "run", "--dir", "farm", "--until-empty", more=case.jumping(), timeout=120)
    case.told = {"jumps": case.jumped, "seconds": round(time.monotonic() - begin, 1)}
    if done.returncode != 0:
        case.tell(f"ends with {done.returncode}: {done.stderr.strip()[-300:]}")
    case.all_done_once()


def bridge_jumps(case):
    words = case.machine(8)
    begin = time.monotonic()
    done = case.programs.run(*words, more=case.jumping(), timeout=120)
    case.told = {"jumps": case.jumped, "seconds": round(time.monotonic() - begin, 1)}
    case.end_sim()
    if done.returncode != 0:
        case.tell(f"ends with {done.returncode}: {done.stderr.strip()[-300:]}")
    late = [r["frame"] for r in case.frames() if r["late"] != "0"]
    if late:
        case.tell(f"late frames: {late}")
    if any(e.get("event") in ("watchdog", "fault") for e in case.seen()):
        case.tell("the machine saw a fault")


def watch_jumps(case):
    os.mkdir(case.path("in"))
    watch = case.programs.start("slicecorr-post", *LIGHT, "--watch", "in", "--settle-s", "0.5", more=case.jumping(), stderr=subprocess.PIPE)
    begin = time.monotonic()
    time.sleep(0.5)
    kills_parts.sl1(case.path("new.sl1"), 8)
    old = sha256(case.path("new.sl1"))
    shutil.move(case.path("new.sl1"), case.path("in/part.sl1"))
    while sha256(case.path("in/part.sl1")) == old and time.monotonic() < begin + 30 and watch.poll() is None:
        time.sleep(0.05)
    case.told = {"jumps": case.jumped, "seconds": round(time.monotonic() - begin, 1)}
    if sha256(case.path("in/part.sl1")) == old:
        case.tell("not corrected in 30 s: " + (watch.stderr.read().decode()[-300:] if watch.poll() is not None else ""))
    watch.terminate()
    watch.wait()


def bridge_stopped(case):
    """The machine's watchdog puts the light off; the bridge, awake again, says that it slept, and shows nothing late."""
    words = case.machine(12)
    bridge = case.programs.start(*words, stderr=subprocess.PIPE)
    if not case.wait_for("frame 3"):
        case.tell("no frame 3")
    os.kill(bridge.pid, signal.SIGSTOP)
    begin = time.monotonic()
    if not case.wait_for("watchdog", 5):
        case.tell("no watchdog")
    dark_s = time.monotonic() - begin
    time.sleep(max(0, case.options.stop_s - dark_s))
    while_stopped = lit(case.seen())
    if while_stopped:
        case.tell(f"lamps on while it is stopped: {while_stopped}")
    before = [e.get("event") for e in case.seen()]
    os.kill(bridge.pid, signal.SIGCONT)
    try:
        _, said = bridge.communicate(timeout=20)
    except subprocess.TimeoutExpired:
        bridge.kill()
        _, said = bridge.communicate()
        case.tell("no end 20 s after it went on")
    after = [e.get("event") for e in case.seen()][len(before):]
    case.told = {"stopped_s": case.options.stop_s, "code": bridge.returncode, "dark_s": round(dark_s, 2)}
    if bridge.returncode != 4:
        case.tell(f"ends with {bridge.returncode}")
    if "stopped" not in said.decode():
        case.tell(f"does not say that it was stopped: {said.decode()[-300:]}")
    if "blue on" in after or "uv on" in after:
        case.tell("a lamp went on afterwards")
    shown = [e for e in after if e and e.startswith("frame ")]
    if shown and lit(case.seen()):
        case.tell(f"shown afterwards, in light: {shown}")
    case.end_sim()


def service_stopped(case):
    """For less than its lease: it goes on. Workers are not stopped."""
    case.queue(3)
    service = case.programs.start("slicefarm", "run", "--dir", "farm", "--until-empty", "--jobs", "1")
    time.sleep(0.3)
    os.kill(service.pid, signal.SIGSTOP)
    time.sleep(min(case.options.stop_s, 30))
    os.kill(service.pid, signal.SIGCONT)
    try:
        if service.wait(60) != 0:
            case.tell(f"ends with {service.returncode}")
    except subprocess.TimeoutExpired:
        service.kill()
        case.tell("no end")
    case.told = {"stopped_s": min(case.options.stop_s, 30)}
    case.all_done_once()


def server_stopped(case):
    """What was asked meanwhile is answered when it goes on; a page that waits for news gets them."""
    case.queue(1)
    server = case.programs.start("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", stdout=subprocess.PIPE)
    address = server.stdout.readline().decode().strip().rstrip("/")
    answers = []

    def ask(path):
        try:
            with urllib.request.urlopen(address + path, timeout=case.options.stop_s + 20) as answer:
                answers.append((answer.status, len(answer.read())))
        except OSError as error:
            answers.append((0, str(error)))
    ask("/api/v1/overview")
    os.kill(server.pid, signal.SIGSTOP)
    threads = [threading.Thread(target=ask, args=(p,)) for p in ("/", "/api/v1/overview", "/metrics", "/api/v1/jobs")]
    for t in threads:
        t.start()
    time.sleep(case.options.stop_s)
    os.kill(server.pid, signal.SIGCONT)
    for t in threads:
        t.join()
    ask("/api/v1/overview")
    case.told = {"stopped_s": case.options.stop_s, "answers": len(answers)}
    # Connections that were silent for longer than the server waits are closed; what is asked anew is answered.
    if case.options.stop_s < 10 and any(status != 200 for status, _ in answers):
        case.tell(f"answers: {answers}")
    if answers[-1][0] != 200 or server.poll() is not None:
        case.tell(f"after it went on: {answers[-1]}, {server.poll()}")
    server.terminate()
    server.wait()


def machines_jumps(case):
    """A printer on the network is sent a file, started once, and followed to its end."""
    with kills_parts.octoprint(case.programs, "--trap", "layers=150") as (_, asked):
        kills_parts.sl1(case.path("part.sl1"), 40)
        more = case.jumping()
        watch = case.programs.start("slicefarm", "machines", "watch", "--interval-s", "0.5", "--dir", "farm", more=more,
                                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        for words in (["send", "part.sl1", "octo"], ["start", "octo", "--plate-is-empty", "--vat-is-filled"]):
            done = case.programs.run("slicefarm", "machines", *words, "--dir", "farm", more=more)
            if done.returncode != 0:
                case.tell(f"{words[0]} ends with {done.returncode}: {done.stderr.strip()[-300:]}")
        until, state = time.monotonic() + 30, None
        while state != "finished" and time.monotonic() < until:
            listed = case.programs.run("slicefarm", "machines", "list", "--json", "-", "--dir", "farm", more=more)
            state = json.loads(listed.stdout)[0]["state"] if listed.returncode == 0 else listed.stderr
            time.sleep(0.1)
        if state != "finished":
            case.tell(f"the machine is {state}")
        time.sleep(1.5)
        watch.terminate()
        said = watch.communicate()[0].decode()
        begun = [e for e in asked("log")["log"] if e["what"] == "begun"]
    if len(begun) != 1:
        case.tell(f"begun {len(begun)} times")
    if "finished" not in said:
        case.tell(f"who watches was not told of the end: {said[-300:]}")
    case.told = {"jumps": case.jumped}


def server_jumps(case):
    """What is asked is answered, a part that was uploaded is queued, and what it can't know any more it says."""
    token = "0123456789abcdef" * 2
    with open(os.open(case.path("token"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
        file.write(token + "\n")
    case.queue(1)
    server = case.programs.start("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", "--token-file", case.path("token"),
                                 more=case.jumping(), stdout=subprocess.PIPE)
    address = server.stdout.readline().decode().strip().rstrip("/")

    def ask(path, method="GET", body=None):
        request = urllib.request.Request(address + path, body, {"Authorization": "Bearer " + token, "Content-Type": "application/json"}, method=method)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.read()
    with open(case.path("part.stl"), "rb") as file:
        mesh = file.read()
    answers, queued, gone = 0, 0, 0
    for n in range(case.options.jobs):
        for view in ("/api/v1/overview", "/metrics", "/api/v1/events", "/api/v1/jobs?state=queued&order=urgency", "/report"):
            status, body = ask(view)
            answers += 1
            if status != 200:
                case.tell(f"{view}: {status} {body[:200]}")
        status, body = ask("/api/v1/parts/part.stl", "PUT", mesh)
        if status != 201:
            case.tell(f"upload: {status} {body[:200]}")
            continue
        time.sleep(0.2)
        # What has waited for too long goes when another comes.
        ask("/api/v1/parts/other.stl", "PUT", mesh)
        job = {"parts": [json.loads(body)["part"]], "name": f"up{n}", "printer": "small", "resin": "figure-2-2", "ha_um": 110, "layer_um": 50,
               "speed_mm_h": 800}
        status, body = ask("/api/v1/jobs", "POST", json.dumps({"jobs": [job]}).encode())
        queued += status in (200, 201)
        gone += status == 400 and b"upload" in body
        if status not in (200, 201):
            case.told.setdefault("refused", body.decode()[:200])
    case.told |= {"jumps": case.jumped, "answers": answers, "queued": queued, "uploads that a jump made old": gone}
    if queued + gone != case.options.jobs:
        case.tell(f"{case.options.jobs} parts: {queued} queued, {gone} gone")
    server.terminate()
    if server.wait(20) not in (0, 130):
        case.tell(f"ends with {server.returncode}")


def machine_stopped(case):
    """The machine's controller hangs: the bridge ends the print by itself, says why, and no second print begins."""
    words = case.machine(12)
    bridge = case.programs.start(*words, stderr=subprocess.PIPE)
    if not case.wait_for("frame 3"):
        case.tell("no frame 3")
    os.kill(case.sim.pid, signal.SIGSTOP)
    begin = time.monotonic()
    try:
        _, said = bridge.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        bridge.kill()
        _, said = bridge.communicate()
        case.tell("no end 60 s after the machine was stopped")
    ended_s = time.monotonic() - begin
    if bridge.returncode != 4 or b"NOT CONFIRMED" not in said:
        case.tell(f"ends with {bridge.returncode}: {said.decode()[-300:]}")
    again = case.programs.run(*words)
    if again.returncode != 4:
        case.tell(f"a print after it ends with {again.returncode}: {again.stderr[-300:]}")
    time.sleep(max(0, case.options.stop_s - (time.monotonic() - begin)))
    os.kill(case.sim.pid, signal.SIGCONT)
    time.sleep(1)
    if lit(case.seen()):
        case.tell(f"lamps on a second after the machine went on: {lit(case.seen())}")
    case.told = {"stopped_s": case.options.stop_s, "code": bridge.returncode, "ended_s": round(ended_s, 2),
                 "says": [line for line in said.decode().splitlines() if line.strip()][-4:]}
    case.end_sim()


def page_stopped(case):
    """The page of a bridge, stopped while somebody looks at it: the print does not mind, the page comes again."""
    words = case.machine(36)
    page = case.programs.start("printbridge", "serve", "--printer", case.path("fast.toml"), "--dir", "state", "--listen", "127.0.0.1:0",
                               stdout=subprocess.PIPE)
    address = page.stdout.readline().decode().strip().rstrip("/")
    bridge = case.programs.start(*words)
    case.wait_for("frame 3")
    os.kill(page.pid, signal.SIGSTOP)
    answers = []

    def ask(path):
        try:
            with urllib.request.urlopen(address + path, timeout=case.options.stop_s + 20) as answer:
                answers.append(answer.status)
        except OSError as error:
            answers.append(str(error))
    threads = [threading.Thread(target=ask, args=(p,)) for p in ("/", "/metrics")]
    for t in threads:
        t.start()
    if bridge.wait(60) != 0:
        case.tell(f"the print ends with {bridge.returncode}")
    late = [r["frame"] for r in case.frames() if r["late"] != "0"]
    if late:
        case.tell(f"late frames: {late}")
    time.sleep(case.options.stop_s)
    os.kill(page.pid, signal.SIGCONT)
    for t in threads:
        t.join()
    ask("/")
    if answers[-1] != 200 or page.poll() is not None:
        case.tell(f"after it went on: {answers}, {page.poll()}")
    case.told = {"stopped_s": case.options.stop_s, "answers": answers}
    page.terminate()
    page.wait()
    case.end_sim()


CASES = {f.__name__: f for f in (farm_jumps, bridge_jumps, watch_jumps, machines_jumps, server_jumps, bridge_stopped, machine_stopped,
                                 page_stopped, service_stopped, server_stopped)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--stop-s", type=float, default=3)
    parser.add_argument("--jobs", type=int, default=12)
    add_options(parser)
    options = parser.parse_args()
    if not libfaketime():
        print("clocks: no libfaketime (scripts/setup installs it)", file=sys.stderr)
        return 77
    return run_cases(options, CASES, lambda: Case(options), lambda ask, case: ask(case), lambda case: case.told)


if __name__ == "__main__":
    sys.exit(main())
