#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Programs that may open few files (RLIMIT_NOFILE), from 3 (their streams) up to as many as they need.

    starved.py --bin build/bin [--step N] [--most N] [--json FILE] [CASE...]

At each limit a program does its work, or says why not (the system's "Too many open files", by which its person
finds the limit) and ends with 2 or 4; it never crashes, hangs, or calls itself defect; what has a final name is whole,
and nothing temporary stays. With 3 the system can't even load programs. A line of JSON per case on stdout; exit
code 0: all held.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request

import kills_parts
from cases import add_options, run_cases
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs, hidden, sha256

REASON = ("Too many open files", "too many open files")


class Case:
    def __init__(self, bin_folder):
        self.folder = tempfile.mkdtemp(prefix="starved-")
        self.programs = Programs(bin_folder, self.folder)
        self.wrong, self.said, self.enough = [], 0, None

    def path(self, name):
        return os.path.join(self.folder, name)

    def tell(self, limit, text):
        self.wrong.append(f"{limit}: {text}")
        print(f"starved: {limit}: {text}", file=sys.stderr, flush=True)

    def limited(self, limit, words, timeout=60):
        def few():
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
        return self.programs.run(*words, preexec_fn=few, timeout=timeout)

    def judge(self, limit, done):
        """Whether the work was done."""
        if done.returncode == 0:
            return True
        # The system's loader, before any of ours runs.
        if done.returncode == 127 and "error while loading shared libraries" in done.stderr:
            self.said += 1
            return False
        if done.returncode not in (2, 4):
            self.tell(limit, f"ends with {done.returncode}: {done.stderr.strip()[-300:]}")
        elif not any(r in done.stderr for r in REASON):
            self.tell(limit, f"does not say why: {done.stderr.strip()[-300:]}")
        else:
            self.said += 1
        return False

    def sweep(self, words, outputs, step, most, reset=None):
        """`outputs`: names below the folder; their bytes are what the first run without a limit makes."""
        if reset:
            reset()
        self.programs.sound(*words)
        want = {o: sha256(self.path(o)) for o in outputs if os.path.isfile(self.path(o))}
        good = 0
        for limit in range(3, most, step):
            if reset:
                reset()
            else:
                for o in outputs:
                    if os.path.exists(self.path(o)):
                        os.unlink(self.path(o))
            before = {o: sha256(self.path(o)) for o in outputs if os.path.isfile(self.path(o))}
            try:
                done = self.judge(limit, self.limited(limit, words))
            except subprocess.TimeoutExpired:
                self.tell(limit, "no end after 60 s")
                continue
            for o in outputs:
                now = sha256(self.path(o)) if os.path.isfile(self.path(o)) else None
                if now not in (want.get(o), before.get(o)) or (done and now is None):
                    self.tell(limit, f"{o} is {'half' if now else 'gone'}")
            left = [h for h in hidden(self.folder) if ".part" in h or ".slicecorr" in h]
            if left:
                self.tell(limit, f"left {left}")
            if done:
                self.enough = self.enough or limit
                good += 1
                if good >= 3:
                    break
        else:
            self.tell(most, "was never enough")

    def end(self):
        shutil.rmtree(self.folder, ignore_errors=True)


def run(case, step, most):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    case.sweep(["slicecorr", "run", "part.stl", "-o", "o.uvj", "--layer-um", "50", *SPEED, *LIGHT, "--threads", "2"],
               ["o.uvj", "o.html", "o.json"], step, most)


def convert(case, step, most):
    kills_parts.sl1(case.path("part.sl1"), 8)
    case.sweep(["slicecorr", "convert", "part.sl1", "-o", "o.uvj"], ["o.uvj"], step, most)


def post(case, step, most):
    kills_parts.sl1(case.path("old.sl1"), 8)
    case.sweep(["slicecorr-post", *LIGHT, "part.sl1"], ["part.sl1"], step, most,
               lambda: shutil.copy(case.path("old.sl1"), case.path("part.sl1")))


def add(case, step, most):
    case.sweep(["resinctl", "add", "figure-2-2", "-o", "own"], ["own/figure-2-2.toml"], step, most,
               lambda: shutil.rmtree(case.path("own"), ignore_errors=True))


def submit(case, step, most):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    case.sweep(["slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT, "--out", "out"], [], step, most,
               lambda: shutil.rmtree(case.path("farm"), ignore_errors=True))


def farm(case, step, most):
    """The service: a job is done, waits, or has failed with a reason; and is done when there is no limit."""
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    words = ["slicefarm", "run", "--dir", "farm", "--until-empty", "--jobs", "1"]
    good = 0
    for limit in range(3, most, 2 * step):
        for name in ("farm", "out"):
            shutil.rmtree(case.path(name), ignore_errors=True)
        case.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT, "--out", "out")
        case.programs.sound("slicefarm", "set", "--dir", "farm", "retry-delay-s=0", "min-free-mb=0")
        try:
            done = case.limited(limit, words, 10)
        except subprocess.TimeoutExpired as late:
            # It says what is wrong, and tries on for minutes: others may close their files.
            if not any(r in (late.stderr or b"").decode() for r in REASON):
                case.tell(limit, f"no end after 10 s, and does not say why: {late.stderr}")
            case.said += 1
            done = None
        if done is None:
            pass
        elif done.returncode == 5:
            logs = case.programs.run("slicefarm", "logs", "1", "--dir", "farm").stdout
            if not any(r in logs + done.stderr for r in REASON):
                case.tell(limit, f"a job failed and its log does not say why: {logs[-300:]}")
            case.said += 1
        elif case.judge(limit, done):
            case.enough = case.enough or limit
            good += 1
        case.programs.run("slicefarm", "retry", "1", "--dir", "farm")
        case.programs.sound(*words)
        if not os.path.exists(case.path("out/part.uvj")):
            case.tell(limit, "the job is lost")
        if good >= 3:
            return


def served(case, limits, words):
    """A server: it starts and answers, or says why not."""
    good = 0
    for limit in limits:
        def few():
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
        server = case.programs.start(*words, "--listen", "127.0.0.1:0", preexec_fn=few, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        line = server.stdout.readline().decode().strip()
        if not line:
            code, said = server.wait(10), server.stderr.read().decode()
            case.judge(limit, subprocess.CompletedProcess([], code, "", said))
            continue
        begin = time.monotonic()
        try:
            with urllib.request.urlopen(line.split()[-1].rstrip("/") + "/metrics", timeout=10) as answer:
                answered = answer.status == 200
        except OSError as error:
            answered = False
            if time.monotonic() - begin > 9:
                case.tell(limit, f"no answer: {error}")
        if server.poll() is not None:
            case.tell(limit, f"ended with {server.returncode}")
        server.terminate()
        server.wait(20)
        case.said += not answered
        good += answered
        if answered:
            case.enough = case.enough or limit
        if good >= 3 or (limit == 256 and answered):
            return
    case.tell(256, "was not enough")


def serve(case, step, most):
    served(case, [*range(3, most, 2 * step), 256], ["slicefarm", "serve", "--dir", "farm"])


def page(case, step, most):
    kills_parts.fast_printer(case.path("fast.toml"), 2)
    served(case, [*range(3, most, step), 256], ["printbridge", "serve", "--printer", "fast.toml", "--dir", "state"])


def send(case, step, most):
    """A file is sent to a printer on the network: it has the whole file or none of this name."""
    with kills_parts.octoprint(case.programs) as (_, asked):
        kills_parts.sl1(case.path("part.sl1"), 4)
        want, good = sha256(case.path("part.sl1")), 0
        for limit in range(3, most, step):
            done = case.judge(limit, case.limited(limit, ["slicefarm", "machines", "send", "part.sl1", "octo", "--dir", "farm"]))
            there = asked("log")["files"]
            if any(sha != want for sha in there.values()) or (done and not there):
                case.tell(limit, f"on the machine: {there}")
            left = hidden(case.path("farm"))
            if left:
                case.tell(limit, f"left {left}")
            if done:
                case.enough = case.enough or limit
                good += 1
            if good >= 3:
                return
    case.tell(most, "was never enough")


def bridge_words(case):
    """What prints a small stack, but for the machine's address."""
    mesh, target, stack = kills_parts.fast_printer(case.path("fast.toml"), 2)
    printer = case.path("fast.toml")
    case.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
    case.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um", "110", *SPEED)
    return ["printbridge", "print", stack, "--printer", printer, "--dir", "state", "--sink", "null", "--lockstep", "--modbus"]


def machine(case, step, most):
    """printer-sim itself: it starts and is printed on, or says why not; a bridge that it does not answer says so."""
    words, good = bridge_words(case), 0
    for limit in range(3, most, step):
        def few():
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
        sim = case.programs.start("printer-sim", "--printer", case.path("fast.toml"), "--listen", "127.0.0.1:0", "--quiet", "--lockstep",
                                  preexec_fn=few, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        line = sim.stdout.readline()
        if not line:
            case.judge(limit, subprocess.CompletedProcess([], sim.wait(10), "", sim.stderr.read().decode()))
            continue
        modbus = json.loads(line)["modbus"]
        shutil.rmtree(case.path("state"), ignore_errors=True)
        done = case.programs.run(*words, modbus if modbus.startswith("tcp:") else "tcp:" + modbus)
        if done.returncode not in (0, 2, 4):
            case.tell(limit, f"the bridge ends with {done.returncode}: {done.stderr[-300:]}")
        if sim.poll() is not None:
            case.tell(limit, f"ended with {sim.returncode}: {sim.stderr.read().decode()[-300:]}")
        sim.terminate()
        sim.wait()
        if done.returncode == 0:
            case.enough = case.enough or limit
            good += 1
        else:
            case.said += 1
        if good >= 3:
            return
    case.tell(most, "was never enough")


def bridge(case, step, most):
    words = bridge_words(case)
    good = 0
    for limit in range(3, most, step):
        sim, modbus = case.programs.machine(case.path("fast.toml"))
        shutil.rmtree(case.path("state"), ignore_errors=True)
        try:
            if case.judge(limit, case.limited(limit, [*words, modbus])):
                case.enough = case.enough or limit
                good += 1
        except subprocess.TimeoutExpired:
            case.tell(limit, "no end after 60 s")
        finally:
            sim.terminate()
            sim.wait()
        left = hidden(case.path("state")) if os.path.isdir(case.path("state")) else []
        if left:
            case.tell(limit, f"left {left}")
        if good >= 3:
            return


CASES = {f.__name__: f for f in (run, convert, post, add, submit, farm, serve, send, bridge, page, machine)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--most", type=int, default=120)
    add_options(parser)
    options = parser.parse_args()
    return run_cases(options, CASES, lambda: Case(options.bin),
                     lambda ask, case: ask(case, options.step, options.most),
                     lambda case: {"said why": case.said, "enough": case.enough})


if __name__ == "__main__":
    sys.exit(main())
