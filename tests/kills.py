#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Kills the programs at random moments (kill -9) and looks at what they leave.

    kills.py --bin build/bin [--count N] [--seed S] [--json FILE] [KIND...]

KIND is run, post, convert, add, farm, bridge, send or upload; all of them unless said. After each kill:
what has a final name is the old file or the new one, byte for byte; the next run of another program in the
folder removes what the killed one left; the program itself does its work when it is run again; and no job
stays at work for ever. A line of JSON per kind on stdout; exit code 0: all held.
"""

import argparse
import contextlib
import http.client
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
import zipfile

import kills_parts
from docs_machine_faults import box_stl
from kills_kind import Kind
from kills_parts import LIGHT, SPEED, hidden, sha256


class Run(Kind):
    """slicecorr run, over the stack, page and figures of another part."""

    def command(self, part):
        return ["slicecorr", "run", f"{part}.stl", "-o", "out/out.uvj", "--layer-um", "50", *SPEED, *LIGHT, "--quiet"]

    def prepare(self):
        box_stl(self.path("a.stl"), 2, 1.5, 1)
        box_stl(self.path("b.stl"), 1, 2, 1.5)
        os.mkdir(self.path("out"))
        self.want = {}
        for part in "ab":
            self.timed(*self.command(part))
            self.want[part] = {e: sha256(self.path(f"out/out.{e}")) for e in ("uvj", "html", "json")}
        self.now, self.other = "b", self.path("out/part.sl1")
        kills_parts.sl1(self.other, 4)

    def one(self):
        next_ = "a" if self.now == "b" else "b"
        self.killed(self.command(next_))
        stack = sha256(self.path("out/out.uvj")) if os.path.exists(self.path("out/out.uvj")) else None
        is_ = [p for p in "ab" if self.want[p]["uvj"] == stack]
        if not is_:
            self.tell("lost" if stack is None else "half", "out.uvj")
            self.programs.sound(*self.command(next_))
            is_ = [next_]
        self.now = is_[0]
        for e in ("html", "json"):
            path = self.path(f"out/out.{e}")
            if os.path.exists(path) and sha256(path) != self.want[self.now][e]:
                self.tell("half", f"out.{e} is not of the stack beside it")
        # Another command, for another file.
        self.programs.sound("slicecorr", "info", self.other, "--json", "out/info.json")
        self.left("out")


class Convert(Kind):
    """slicecorr convert into each format in turn: a zip, a tar, a folder, a binary file."""
    names = ("out.uvj", "out.tar.gz", "out.cws", "slices/", "out.goo")

    def command(self, part, name):
        return ["slicecorr", "convert", f"{part}.sl1", "-o", f"out/{name}", "--quiet"]

    def prepare(self):
        os.mkdir(self.path("out"))
        for seed, part in enumerate("ab"):
            kills_parts.sl1(self.path(f"{part}.sl1"), 60, seed)
        self.want, self.now = {}, {}
        good = []
        for name in self.names:
            for part in "ab":
                begin = time.monotonic()
                done = self.programs.run(*self.command(part, name))
                if done.returncode != 0:
                    print(f"kills: convert to {name} is left out: {done.stderr.strip()}", file=sys.stderr)
                    break
                self.whole_s = time.monotonic() - begin
                self.want[name, part] = self.state(name)
                self.now[name] = part
            else:
                good.append(name)
        self.names = good

    def state(self, name):
        path = self.path(f"out/{name}")
        if not os.path.isdir(path):
            return sha256(path) if os.path.exists(path) else None
        return tuple((n, sha256(os.path.join(path, n))) for n in sorted(os.listdir(path)))

    def one(self):
        name = self.names[self.runs % len(self.names)]
        next_ = "a" if self.now[name] == "b" else "b"
        self.killed(self.command(next_, name))
        now = self.state(name)
        is_ = [p for p in "ab" if self.want[name, p] == now]
        if not is_:
            self.tell("lost" if not now else "half", name)
            self.programs.sound(*self.command(next_, name))
            is_ = [next_]
        self.now[name] = is_[0]
        self.programs.sound("slicecorr", "info", "a.sl1", "--json", "out/info.json")
        self.left("out")


class Post(Kind):
    """slicecorr-post in place, with a copy of the old file."""

    def command(self):
        return ["slicecorr-post", *LIGHT, "--backup", "--threads", "1", "--quiet", "out/part.sl1"]

    def prepare(self):
        os.mkdir(self.path("out"))
        kills_parts.sl1(self.path("old.sl1"), 100)
        kills_parts.sl1(self.path("small.sl1"), 4)
        shutil.copy(self.path("old.sl1"), self.path("out/part.sl1"))
        self.old = sha256(self.path("old.sl1"))
        self.timed(*self.command())
        self.new = sha256(self.path("out/part.sl1"))

    def one(self):
        for name in os.listdir(self.path("out")):
            if not name.startswith("."):
                os.unlink(self.path(f"out/{name}"))
        shutil.copy(self.path("old.sl1"), self.path("out/part.sl1"))
        self.killed(self.command())
        path, copy = self.path("out/part.sl1"), self.path("out/part.sl1.orig")
        now = sha256(path) if os.path.exists(path) else None
        if now not in (self.old, self.new):
            self.tell("lost" if now is None else "half", "part.sl1")
        if os.path.exists(copy) and sha256(copy) != self.old:
            self.tell("half", "part.sl1.orig")
        if now == self.new and not os.path.exists(copy):
            self.tell("lost", "part.sl1.orig")
        if self.runs % 2:
            # Another program, for another file: all but the note of what was in work.
            self.programs.sound("slicecorr", "info", "small.sl1", "--json", "out/info.json")
            for name in hidden(self.path("out")):
                if os.path.basename(name) != "in-work" and "/" in name or os.path.isfile(self.path(f"out/{name}")):
                    self.tell("left", name)
        done = self.programs.run(*self.command())
        if done.returncode != (2 if now == self.new else 0) or sha256(path) != self.new:
            self.tell("lost", f"the next run ends with {done.returncode}: {done.stderr.strip()}")
        self.left("out")


class Add(Kind):
    """resinctl add over another version of a resin."""

    def command(self, part):
        return ["resinctl", "add", f"{part}/mine.toml", "--replace", "-m", part, "-o", "own", "--quiet"]

    def prepare(self):
        with open(os.path.join(kills_parts.ROOT, "resins/db/figure-2-2.toml")) as file:
            text = file.read().replace('"figure-2-2"', '"mine"')
        for part, dose in (("a", "576.0"), ("b", "600.0")):
            os.mkdir(self.path(part))
            with open(self.path(f"{part}/mine.toml"), "w") as file:
                file.write(text.replace("576.0", dose))
        os.mkdir(self.path("own"))
        self.want = {}
        for part in "ab":
            self.timed(*self.command(part))
            self.want[part] = self.text()
        self.now, self.versions = "b", self.history()

    def text(self):
        """The present version without its number; None when it is not there."""
        try:
            with open(self.path("own/mine.toml")) as file:
                return [line for line in file if not line.startswith("version = ")]
        except OSError:
            return None

    def history(self):
        done = self.programs.run("resinctl", "history", "mine", more={"SLICECORR_DB": self.path("own")})
        if done.returncode != 0:
            self.tell("lost", f"history: {done.stderr.strip()}")
        return len(done.stdout.splitlines())

    def one(self):
        next_ = "a" if self.now == "b" else "b"
        self.killed(self.command(next_))
        now = self.text()
        is_ = [p for p in "ab" if self.want[p] == now]
        if not is_:
            self.tell("lost" if now is None else "half", "mine.toml")
        versions = self.history()
        if versions < self.versions:
            self.tell("lost", f"{self.versions - versions} versions")
        # Another resin, which changes nothing; the next version looks at the folder of versions, too.
        self.programs.sound("resinctl", "add", "figure-2-2", "--replace", "-o", "own", "--quiet")
        self.left("own", ".history/")
        self.programs.sound(*self.command(next_))
        if self.text() != self.want[next_]:
            self.tell("lost", "the next version")
        self.now, self.versions = next_, self.history()
        self.left("own")


class Farm(Kind):
    """slicefarm run, its workers, or both; jobs go on until all are done."""
    jobs = 5

    def prepare(self):
        box_stl(self.path("part.stl"), 2, 1.5, 1)
        self.want = []
        for n in range(self.jobs):
            self.programs.sound("slicecorr", "run", "part.stl", "-o", f"want{n}.uvj", "--layer-um", "50", "--speed-mm-h", 800 + n,
                                *LIGHT, "--quiet")
            self.want.append(sha256(self.path(f"want{n}.uvj")))
        self.whole_s = 1.2
        self.begin()

    def begin(self):
        for name in ("farm", "out"):
            shutil.rmtree(self.path(name), ignore_errors=True)
        for n in range(self.jobs):
            self.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", "--speed-mm-h", 800 + n,
                                *LIGHT, "--out", "out", "--name", f"part{n}", "--quiet")
        self.programs.sound("slicefarm", "set", "--dir", "farm", "retry-delay-s=0", "min-free-mb=0", "max-attempts=100")

    def states(self):
        with sqlite3.connect(f"file:{self.path('farm/farm.sqlite')}?mode=ro", uri=True) as db:
            return [s for s, in db.execute("SELECT state FROM jobs")]

    def workers(self, service):
        found = []
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{pid}/stat") as stat, open(f"/proc/{pid}/cmdline") as command:
                    if int(stat.read().rpartition(")")[2].split()[1]) == service and "attempts" in command.read():
                        found.append(int(pid))
            except (OSError, ValueError):
                continue
        return found

    def whole(self):
        for n, want in enumerate(self.want):
            path = self.path(f"out/part{n}.uvj")
            if os.path.exists(path) and sha256(path) != want:
                self.tell("half", f"part{n}.uvj")

    def one(self):
        service = self.programs.start("slicefarm", "run", "--dir", "farm", "--until-empty", "--jobs", "2", "--quiet")
        time.sleep(self.moment())
        what = self.rng.choice(("service", "worker", "both"))
        workers = self.workers(service.pid) if what != "service" else []
        hit = service.poll() is None
        for pid in workers:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        if what != "worker":
            service.kill()
        elif hit:
            self.kills += len(workers)
            try:
                service.wait(20)
            except subprocess.TimeoutExpired:
                self.tell("stuck", f"the service does not end: {self.states()}")
                service.kill()
        self.runs += 1
        self.kills += service.wait() == -signal.SIGKILL and hit
        self.whole_s *= 1.005 if hit else 0.955
        self.whole()
        if all(s == "done" for s in self.states()) or self.runs % 8 == 0:
            self.finish()
            self.begin()

    def finish(self):
        """Works on after whatever happened; then all must be in order."""
        try:
            done = self.programs.run("slicefarm", "run", "--dir", "farm", "--until-empty", timeout=90)
        except subprocess.TimeoutExpired:
            self.tell("stuck", f"no end: {self.states()}")
            return
        states = self.states()
        if done.returncode != 0 or states != ["done"] * self.jobs:
            self.tell("lost" if "running" not in states else "stuck", f"{states} {done.stderr.strip()[-300:]}")
        self.whole()
        for n in range(self.jobs):
            if not os.path.exists(self.path(f"out/part{n}.uvj")):
                self.tell("lost", f"part{n}.uvj")
        self.left("out")
        self.left("farm/machines") if os.path.isdir(self.path("farm/machines")) else None
        if os.listdir(self.path("farm/store/attempts")):
            self.tell("left", "folders of attempts")
        for name in hidden(self.path("farm/store")):
            if "/inputs/" not in f"/{name}":
                self.tell("left", name)
        self.programs.sound("slicefarm", "gc", "--dir", "farm")
        self.left("farm/store")


class Bridge(Kind):
    """printbridge on printer-sim, in real time. The machine's watchdog must put the lamps off."""

    def prepare(self):
        mesh, target, stack = kills_parts.fast_printer(self.path("fast.toml"), 4)
        self.printer, self.stack = self.path("fast.toml"), stack
        self.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", self.printer, "--layer-um", "50",
                            "--antialias", "off")
        self.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", self.printer, "--resin", "figure-2-2",
                            "--ha-um", "110", *SPEED)
        self.sim = None
        self.begin_sim()
        begin = time.monotonic()
        self.programs.sound(*self.command())
        self.whole_s = time.monotonic() - begin

    def begin_sim(self):
        if self.sim:
            self.sim.terminate()
            self.sim.wait()
        self.events = self.path("events.jsonl")
        self.sim = self.programs.start("printer-sim", "--printer", self.printer, "--listen", "127.0.0.1:0", "--frames",
                                       "tcp:127.0.0.1:0", "--record-events", self.events, "--quiet", stdout=subprocess.PIPE,
                                       stderr=open(self.path("sim.err"), "w"))
        self.where = json.loads(self.sim.stdout.readline())

    def command(self):
        return ["printbridge", "print", self.stack, "--printer", self.printer, "--dir", "state", "--modbus",
                self.address(), "--sink", self.where["frames"], "--quiet"]

    def address(self):
        modbus = self.where["modbus"]
        return modbus if modbus.startswith("tcp:") else f"tcp:{modbus}"

    def lit(self):
        """Lamps that the machine says are on."""
        on = set()
        with open(self.events) as file:
            for line in file:
                if not line.endswith("\n"):
                    break
                what = json.loads(line).get("event")
                for lamp in ("blue", "uv"):
                    if what == f"{lamp} on":
                        on.add(lamp)
                    elif what == f"{lamp} off":
                        on.discard(lamp)
        return on

    def status(self):
        done = self.programs.run("printbridge", "status", "--printer", self.printer, "--dir", "state", "--json", "-")
        return json.loads(done.stdout) if done.returncode in (0, 4, 5) and done.stdout.strip() else {}

    def one(self):
        hit = self.killed(self.command())
        if self.sim.poll() is not None:
            with open(self.path("sim.err")) as said:
                self.tell("lost", f"the machine ended with {self.sim.returncode}: {said.read()[-300:]}")
            self.begin_sim()
        until = time.monotonic() + 5
        while self.lit() and time.monotonic() < until:
            time.sleep(0.02)
        if self.lit():
            self.tell("stuck", f"lamps on 5 s after the kill: {self.lit()}")
        status = self.status()
        if not status or status.get("running"):
            self.tell("stuck", f"status: {status}")
        folder = next(at for at, _, files in os.walk(self.path("state")) if "print.lock" in files or "journal.jsonl" in files)
        for name in os.listdir(folder):
            if name.endswith(".json"):
                with open(os.path.join(folder, name)) as file:
                    try:
                        json.load(file)
                    except ValueError:
                        self.tell("half", name)
            if name == "journal.jsonl":
                with open(os.path.join(folder, name)) as file:
                    for line in file.read().split("\n")[:-1]:
                        try:
                            line and json.loads(line)
                        except ValueError:
                            self.tell("half", f"a line of {name}: {line}")
        if hit and status.get("latched"):
            again = self.programs.run(*self.command())
            if again.returncode != 4:
                self.tell("lost", f"the latch: a print after a kill ends with {again.returncode}")
        for attempt in range(40):
            reset = self.programs.run("printbridge", "reset", "--printer", self.printer, "--dir", "state", "--modbus", self.address())
            if reset.returncode == 0:
                break
            time.sleep(0.1)
        else:
            self.tell("stuck", f"no reset: {reset.stderr.strip()}")
            self.begin_sim()
        if self.status().get("latched"):
            self.tell("stuck", "latched after the reset")
        self.left("state")
        if self.runs % 50 == 0:
            self.begin_sim()
        # Its stage goes home for the next.
        if self.runs % 25 == 0:
            done = self.programs.run(*self.command(), "--machine-is-clear")
            if done.returncode != 0:
                self.tell("lost", f"a print after the reset: {done.returncode} {done.stderr.strip()}")

    def killed(self, words, group=False, **how):
        return super().killed([*words, "--machine-is-clear"], group, **how)

    def end(self):
        self.sim.terminate()
        self.sim.wait()
        super().end()


class Send(Kind):
    """slicefarm machines send to a printer on the network (OctoPrint's calls)."""

    def prepare(self):
        self.machine = contextlib.ExitStack()
        _, self.asked = self.machine.enter_context(kills_parts.octoprint(self.programs))
        kills_parts.sl1(self.path("part.sl1"), 40)
        with open(self.path("noise.bin"), "wb") as file:
            file.write(os.urandom(3 << 20))
        with zipfile.ZipFile(self.path("part.sl1"), "a") as out:
            out.write(self.path("noise.bin"), "notes.bin")
        self.want = sha256(self.path("part.sl1"))
        self.timed(*self.command())

    def command(self):
        return ["slicefarm", "machines", "send", "part.sl1", "octo", "--dir", "farm", "--quiet"]

    def files(self):
        return self.asked("log")["files"]

    def one(self):
        before = self.files()
        self.killed(self.command())
        after = self.files()
        for name, sha in after.items():
            if sha != self.want:
                self.tell("half", f"{name} on the machine")
        if any(after.get(n) != s for n, s in before.items()):
            self.tell("lost", "a file on the machine")
        record = self.path("farm/machines/octo.json")
        if os.path.exists(record):
            with open(record) as file:
                try:
                    json.load(file)
                except ValueError:
                    self.tell("half", "octo.json")
        listed = self.programs.run("slicefarm", "machines", "list", "--json", "-", "--dir", "farm")
        if listed.returncode != 0 or json.loads(listed.stdout)[0]["state"] not in ("idle", "finished"):
            self.tell("stuck", f"list: {listed.stdout} {listed.stderr}")
        if self.runs % 5 == 0:
            done = self.programs.run(*self.command())
            if done.returncode != 0:
                self.tell("lost", f"the next send: {done.stderr.strip()}")
            self.left("farm")

    def end(self):
        self.machine.close()
        super().end()


class Upload(Kind):
    """slicefarm serve, while a browser uploads a part to it."""

    def prepare(self):
        with open(os.open(self.path("token"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
            file.write("0123456789abcdef" * 2 + "\n")
        self.body = os.urandom(4 << 20)
        self.whole_s = 0.15

    def serve(self):
        server = self.programs.start("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", "--token-file",
                                     self.path("token"), stdout=subprocess.PIPE)
        address = server.stdout.readline().decode().strip()
        return server, address.split("//")[-1].rstrip("/")

    def put(self, address, answers, body):
        try:
            connection = http.client.HTTPConnection(address, timeout=20)
            connection.request("PUT", "/api/v1/parts/part.stl", body, {"Authorization": "Bearer " + "0123456789abcdef" * 2})
            answers.append(connection.getresponse().status)
        except (OSError, http.client.HTTPException):
            answers.append(0)

    def uploads(self):
        found = []
        for at, _, files in os.walk(self.path("farm/uploads")):
            found += [os.path.join(at, n) for n in files]
        return found

    def one(self):
        server, address = self.serve()
        answers = []
        client = threading.Thread(target=self.put, args=(address, answers, self.body))
        begin = time.monotonic()
        client.start()
        time.sleep(self.moment())
        hit = client.is_alive()
        server.kill()
        server.wait()
        client.join()
        self.whole_s = self.whole_s * (1.01 if hit else 0.955) if answers[0] in (0, 200, 201) else self.whole_s
        self.runs += 1
        self.kills += 1
        whole = [p for p in self.uploads() if not os.path.basename(p).startswith(".")]
        for path in whole:
            with open(path, "rb") as file:
                if file.read() not in (self.body, b"small"):
                    self.tell("half", os.path.relpath(path, self.folder))
        if answers[0] in (200, 201) and len(whole) == 0:
            self.tell("lost", "an upload that was answered")
        server, address = self.serve()
        answers = []
        self.put(address, answers, b"small")
        if answers[0] not in (200, 201):
            self.tell("stuck", f"the next upload: {answers}")
        server.terminate()
        server.wait()
        self.left("farm/uploads")
        shutil.rmtree(self.path("farm/uploads"), ignore_errors=True)


KINDS = {k.__name__.lower(): k for k in (Run, Convert, Post, Add, Farm, Bridge, Send, Upload)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--count", type=int, default=20, help="kills of each kind")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--most-s", type=float, default=1e9, help="of each kind")
    parser.add_argument("--json", help="also write the lines here")
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    options = parser.parse_args()
    for kind in options.kinds:
        if kind not in KINDS:
            parser.error(f"no kind '{kind}': expected {', '.join(KINDS)}")
    wrong = 0
    for name in options.kinds or KINDS:
        begin = time.monotonic()
        kind = KINDS[name](options.bin, options.seed)
        try:
            while kind.kills < options.count and time.monotonic() - begin < options.most_s:
                kind.one()
            if hasattr(kind, "finish"):
                kind.finish()
        finally:
            kind.end()
        line = {"kind": name, "kills": kind.kills, "runs": kind.runs, "seconds": round(time.monotonic() - begin),
                "seed": options.seed, **{k: len(v) for k, v in kind.wrong.items()}}
        wrong += sum(len(v) for v in kind.wrong.values())
        print(json.dumps(line), flush=True)
        if options.json:
            with open(options.json, "a") as file:
                file.write(json.dumps(line) + "\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
