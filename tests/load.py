#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Many clients, a long queue, many prints one after the other.

    load.py --bin build/bin [--jobs N] [--clients N] [--seconds S] [--upload-mb M] [--prints N] [--json FILE] [CASE...]

queue    slicefarm serve and status with N queued jobs: how long each view takes, the median of five
clients  N clients of slicefarm serve for S seconds, all of one address: most ask for pages and lists, a tenth reads a byte now
         and then, a tenth sends half a request and waits, some upload; meanwhile two well-behaved clients are timed, one
         of the same address and one of another, which is always answered
upload   one part of M MB: memory stays, and a disk that has no room for the next says so (on a small disk of its own, where
         the user may mount one)
long_print  one print of S slices in simulated time (--slices): memory and open files of bridge and machine
prints   a farm's service, its server and a machine's page live on while N jobs are corrected and printed on printer-sim in
         simulated time: memory, open files and files on the disk at a third and at the end

No time is asserted but in `queue` (--most-ms). What must hold: no answer of 5xx but 503 that says why, servers live on,
and what they use at the end is what they used before. A line of JSON per case on stdout; exit code 0: all held.
"""

import argparse
import http.client
import json
import os
import random
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import kills_parts
import load_queue
from cases import add_options, run_cases
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs

TOKEN = "0123456789abcdef" * 2
VIEWS = ["/", "/print", "/machines", "/materials", "/healthz", "/metrics", "/report", "/api/v1/overview", "/api/v1/report",
         "/api/v1/timeline.svg", "/api/v1/openapi.json", "/api/v1/me", "/api/v1/machines", "/api/v1/bridges", "/api/v1/resins",
         "/api/v1/printers", "/api/v1/events", "/api/v1/events?after=1&limit=1000", "/api/v1/jobs/1", "/api/v1/jobs/1/log",
         "/api/v1/jobs", "/api/v1/jobs?state=queued&order=urgency&limit=20", "/api/v1/jobs?state=queued",
         "/api/v1/jobs?state=queued&order=newest", "/api/v1/jobs?state=failed&order=ended&limit=20",
         "/api/v1/jobs?state=done&order=worst", "/api/v1/jobs?user=user-3", "/api/v1/jobs?user=user-3&offset=5000",
         "/api/v1/jobs?user=user-3&state=queued&order=urgency", "/api/v1/jobs?offset=900000", "/api/v1/jobs?label=none",
         "/api/v1/jobs?text=part-0424", "/api/v1/jobs?text=nothing-is-called-this", "/api/v1/jobs?text=zz",
         "/api/v1/jobs?text=part-0424&state=queued&order=urgency&limit=20"]
# Words that most jobs have: all of them are looked at (docs/farm-tried.md).
COMMON_WORDS = ["/api/v1/jobs?text=part", "/api/v1/jobs?text=a", "/api/v1/jobs?text=part&state=queued&order=urgency&limit=20",
                "/api/v1/jobs?text=part&user=user-3&limit=20"]


# Open files of a connection to the record; the server has one for each of its 16 threads at most.
FILES_OF_A_READER = 3


def used(pid):
    """Memory in kB, open files, threads of a process."""
    with open(f"/proc/{pid}/status") as file:
        status = dict(line.split(":", 1) for line in file if ":" in line)
    return {"rss_kb": int(status["VmRSS"].split()[0]), "files": len(os.listdir(f"/proc/{pid}/fd")),
            "threads": int(status["Threads"])}


def files_below(folder):
    return sum(len(files) for _, _, files in os.walk(folder))


class Case:
    def __init__(self, options):
        self.options, self.folder = options, tempfile.mkdtemp(prefix="load-")
        self.programs = Programs(options.bin, self.folder)
        self.wrong, self.told, self.children, self.mounted = [], {}, [], None

    def path(self, name):
        return os.path.join(self.folder, name)

    def tell(self, text):
        self.wrong.append(text)
        print(f"load: {text}", file=sys.stderr, flush=True)

    def serve(self, *more):
        with open(os.open(self.path("token"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
            file.write(TOKEN + "\n")
        server = self.programs.start("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", "--token-file",
                                     self.path("token"), *more, stdout=subprocess.PIPE)
        self.children.append(server)
        self.address = server.stdout.readline().decode().strip().split("//")[-1].rstrip("/")
        return server

    def ask(self, path, timeout=60, source="127.0.0.1"):
        begin = time.monotonic()
        connection = http.client.HTTPConnection(self.address, timeout=timeout, source_address=(source, 0))
        try:
            connection.request("GET", path)
            answer = connection.getresponse()
            body = answer.read()
            return answer.status, len(body), time.monotonic() - begin, answer.getheader("Retry-After")
        finally:
            connection.close()

    def end(self):
        for child in self.children:
            child.terminate()
            child.wait()
        if self.mounted:
            subprocess.run(["umount", self.mounted], check=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def queue(case):
    begin = time.monotonic()
    size = load_queue.make(case.programs, case.options.jobs)
    case.told = {"jobs": case.options.jobs, "made_s": round(time.monotonic() - begin, 1), "database_mb": size >> 20}
    case.serve()
    views = {}
    for view in VIEWS + COMMON_WORDS:
        times = []
        for _ in range(5):
            status, _, seconds, _ = case.ask(view)
            times.append(1000 * seconds)
            if status != 200 and not (status == 404 and view.endswith("/log")):
                case.tell(f"{view}: {status}")
        views[view] = round(statistics.median(times), 1)
    for words in (["status"], ["status", "--json", "-"], ["status", "--state", "queued"], ["logs", "1"]):
        times = []
        for _ in range(3):
            begin = time.monotonic()
            done = case.programs.run("slicefarm", *words, "--dir", "farm")
            times.append(1000 * (time.monotonic() - begin))
            if done.returncode != 0:
                case.tell(f"{words}: {done.returncode} {done.stderr.strip()}")
        views["slicefarm " + " ".join(words)] = round(statistics.median(times), 1)
    case.told["ms"] = views
    slow = {view: ms for view, ms in views.items() if ms > case.options.most_ms and view not in COMMON_WORDS}
    if slow:
        case.tell(f"slower than {case.options.most_ms} ms: {slow}")


class Client(threading.Thread):
    """What one client does until the end, and the answers that it gets."""

    def __init__(self, case, kind, end, seed):
        super().__init__(daemon=True)
        self.case, self.kind, self.end, self.rng = case, kind, end, random.Random(seed)
        self.answers, self.times, self.broken = {}, [], 0
        host, port = case.address.split(":")
        self.where = (host, int(port))

    def note(self, status):
        self.answers[status] = self.answers.get(status, 0) + 1

    def run(self):
        while not self.end.is_set():
            try:
                getattr(self, self.kind)()
            except (OSError, http.client.HTTPException):
                self.broken += 1
                self.end.wait(0.05)

    def asks(self):
        view = self.rng.choice([v for v in VIEWS if "report" not in v])
        status, _, seconds, retry = self.case.ask(view)
        self.note(status)
        self.times.append(seconds)
        if status == 503:
            self.end.wait(float(retry or 0.2))
        self.end.wait(0.05 + 0.1 * self.rng.random())

    def reads_slowly(self):
        with socket.create_connection(self.where, timeout=30) as s:
            s.sendall(b"GET /api/v1/jobs?limit=1000 HTTP/1.1\r\nHost: %s\r\n\r\n" % self.case.address.encode())
            first = s.recv(12)
            self.note(int(first[9:12]) if len(first) == 12 else 0)
            while not self.end.wait(0.2) and s.recv(1):
                pass

    def half_open(self):
        with socket.create_connection(self.where, timeout=30) as s:
            s.sendall(b"GET /api/v1/jo")
            data = s.recv(100)
            self.note(int(data[9:12]) if len(data) >= 12 else 0)

    def uploads(self):
        connection = http.client.HTTPConnection(self.case.address, timeout=120)
        block = os.urandom(1 << 20)
        size = self.case.options.upload_mb << 20

        def body():
            for _ in range(size >> 20):
                if self.end.is_set():
                    return
                yield block
        connection.request("PUT", "/api/v1/parts/large.stl", body(), {"Authorization": f"Bearer {TOKEN}", "Content-Length": str(size)})
        self.note(connection.getresponse().status)
        connection.close()
        self.end.wait(1)


def clients(case):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    case.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)
    server = case.serve()
    # As many at a time as it has threads: each of them keeps the record open from then on.
    for _ in range(3):
        first = [threading.Thread(target=case.ask, args=("/api/v1/jobs?limit=1000",)) for _ in range(64)]
        for t in first:
            t.start()
        for t in first:
            t.join()
    before, end = used(server.pid), threading.Event()
    n = case.options.clients
    kinds = ["reads_slowly"] * (n // 10) + ["half_open"] * (n // 10) + ["uploads"] * max(1, n // 50)
    kinds += ["asks"] * (n - len(kinds))
    people = [Client(case, kind, end, seed) for seed, kind in enumerate(kinds)]
    for p in people:
        p.start()
    begin, most, third = time.monotonic(), dict(before), None
    well = {source: {"asked": 0, "answered": 0, "longest_s": 0.0} for source in ("127.0.0.1", "127.0.0.2")}
    while time.monotonic() < begin + case.options.seconds:
        for source, own in well.items():
            own["asked"] += 1
            try:
                status, _, seconds, _ = case.ask("/api/v1/overview", source=source)
                own["answered"] += status == 200
                own["longest_s"] = max(own["longest_s"], round(seconds, 3))
            except (OSError, http.client.HTTPException) as error:
                own["failed"] = str(error)
        if server.poll() is not None:
            case.tell(f"the server ended with {server.returncode}")
            break
        now = used(server.pid)
        most = {k: max(v, now[k]) for k, v in most.items()}
        if third is None and time.monotonic() > begin + case.options.seconds / 3:
            third = now
        time.sleep(0.2)
    end.set()
    for p in people:
        p.join(40)
    time.sleep(1)
    answers = {}
    for p in people:
        for status, count in p.answers.items():
            answers[status] = answers.get(status, 0) + count
    times = sorted(t for p in people for t in p.times)
    if server.poll() is None:
        after = used(server.pid)
        until = time.monotonic() + 30
        most_files = before["files"] + FILES_OF_A_READER * 16
        while after["files"] > most_files and time.monotonic() < until:
            time.sleep(0.5)
            after = used(server.pid)
        if after["files"] > most_files:
            case.tell(f"open files: {before['files']} before, {after['files']} after")
        # Buffers of as many threads as there were at a time.
        if third and after["rss_kb"] > 1.5 * third["rss_kb"] + 32768:
            case.tell(f"memory grows: {third['rss_kb']} kB after a third, {after['rss_kb']} kB at the end")
        case.told = {"clients": n, "seconds": case.options.seconds, "upload_mb": case.options.upload_mb, "before": before,
                     "most": most, "after": after}
    bad = {s: c for s, c in answers.items() if s >= 500 and s != 503}
    if bad:
        case.tell(f"answers {bad}")
    if well["127.0.0.1"]["answered"] == 0 or well["127.0.0.2"]["answered"] < well["127.0.0.2"]["asked"]:
        case.tell(f"the well-behaved clients: {well}")
    if case.ask("/healthz")[0] != 200:
        case.tell("not well afterwards")
    left = [n for n in kills_parts.hidden(case.path("farm/uploads"))] if os.path.isdir(case.path("farm/uploads")) else []
    if left:
        case.tell(f"left {left}")
    case.told.update({"answers": {str(k): v for k, v in sorted(answers.items())}, "closed": sum(p.broken for p in people),
                      "median_ms": round(1000 * times[len(times) // 2], 1) if times else None,
                      "99_percent_ms": round(1000 * times[len(times) * 99 // 100], 1) if times else None, "well_behaved": well})


def put(case, size, answers):
    """Uploads `size` bytes, a piece at a time; adds the status and what is said, or the connection's end."""
    block = bytes(range(256)) * 4096
    connection = http.client.HTTPConnection(case.address, timeout=120)
    try:
        connection.request("PUT", "/api/v1/parts/large.stl", (block[:min(len(block), size - at)] for at in range(0, size, len(block))),
                           {"Authorization": f"Bearer {TOKEN}", "Content-Length": str(size)})
        answer = connection.getresponse()
        answers.append((answer.status, answer.read().decode(errors="replace")))
    except (OSError, http.client.HTTPException) as error:
        # The server may answer and close before all has come.
        try:
            connection.sock.settimeout(2)
            said = connection.sock.recv(4096).decode(errors="replace")
            answers.append((int(said[9:12]), said))
        except (OSError, ValueError, AttributeError):
            answers.append((0, str(error)))
    finally:
        connection.close()


def upload(case):
    """One large part: memory stays, the file is whole; one that is larger than allowed, that finds no room, and that the disk
    has no room for while it comes, is refused in words and leaves nothing."""
    size, answers = case.options.upload_mb * 1_000_000, []
    os.mkdir(case.path("farm"))
    mounted = os.geteuid() == 0 and subprocess.run(["mount", "-t", "tmpfs", "-o", f"mode=755,size={(size * 7) // 4}", "tmpfs", case.path("farm")],
                                                   capture_output=True).returncode == 0
    case.mounted = case.path("farm") if mounted else None
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    case.programs.sound("slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)
    case.programs.sound("slicefarm", "set", "--dir", "farm", "min-free-mb=0")
    server = case.serve("--max-upload-mb", str(case.options.upload_mb))
    case.ask("/api/v1/jobs")
    before = most = used(server.pid)
    begin = time.monotonic()
    one = threading.Thread(target=put, args=(case, size, answers))
    one.start()
    while one.is_alive():
        now = used(server.pid)
        most = {k: max(v, now[k]) for k, v in most.items()}
        time.sleep(0.05)
    case.told = {"upload_mb": case.options.upload_mb, "seconds": round(time.monotonic() - begin, 1), "before": before, "most": most}
    if answers != [] and answers[-1][0] != 201:
        case.tell(f"upload: {answers[-1]}")
    if most["rss_kb"] > before["rss_kb"] + 16384:
        case.tell(f"memory: {before['rss_kb']} kB before, {most['rss_kb']} kB at most")
    there = [os.path.join(at, n) for at, _, names in os.walk(case.path("farm/uploads")) for n in names]
    if [os.path.getsize(p) for p in there] != [size]:
        case.tell(f"in uploads: {there}")
    put(case, size + 1, answers)
    if answers[-1][0] != 413:
        case.tell(f"a part that is too large: {answers[-1]}")
    if mounted:
        # The first fills three quarters of the disk.
        put(case, size, answers)
        if answers[-1][0] != 507:
            case.tell(f"a part that finds no room: {answers[-1]}")
        parts = [threading.Thread(target=put, args=(case, size // 2, answers)) for _ in range(3)]
        for p in parts:
            p.start()
        for p in parts:
            p.join()
        if any(status not in (201, 503, 507) for status, _ in answers[-3:]) or not any(status in (503, 507) for status, _ in answers[-3:]):
            case.tell(f"parts that fill the disk together: {answers[-3:]}")
        case.told["disk is full"] = sorted({text.strip()[-160:] for status, text in answers[-4:] if status in (503, 507)})
    left = kills_parts.hidden(case.path("farm/uploads"))
    if left or case.ask("/healthz")[0] not in (200, 503) or server.poll() is not None:
        case.tell(f"afterwards: left {left}, {server.poll()}")
    case.told["answers"] = [status for status, _ in answers]


def prints(case):
    mesh, _, stack = kills_parts.fast_printer(case.path("fast.toml"), 4)
    printer = case.path("fast.toml")
    case.programs.sound("slicefarm", "submit", mesh, "--dir", "farm", "--layer-um", "50", "--printer", printer, "--resin",
                        "figure-2-2", "--ha-um", "110", *SPEED, "--out", "out", "--name", "part0")
    case.programs.sound("slicefarm", "set", "--dir", "farm", "min-free-mb=0")
    service = case.programs.start("slicefarm", "run", "--dir", "farm", "--jobs", "1")
    case.children.append(service)
    server = case.serve()
    page = case.programs.start("printbridge", "serve", "--printer", printer, "--dir", "state", "--listen", "127.0.0.1:0",
                               stdout=subprocess.PIPE)
    case.children.append(page)
    page.stdout.readline()
    living, seen, simulated_s = {"service": service, "server": server, "page": page}, [], 0.0
    for n in range(case.options.prints):
        if n:
            case.programs.sound("slicefarm", "submit", mesh, "--dir", "farm", "--layer-um", "50", "--printer", printer, "--resin",
                                "figure-2-2", "--ha-um", "110", "--speed-mm-h", 800 + 0.001 * n, "--out", "out", "--name", f"part{n}")
        part, until = case.path(f"out/part{n}.uvj"), time.monotonic() + 120
        while not os.path.exists(part) and time.monotonic() < until:
            time.sleep(0.02)
        sim = case.programs.start("printer-sim", "--printer", printer, "--listen", "127.0.0.1:0", "--frames", "tcp:127.0.0.1:0",
                                  "--lockstep", "--quiet", stdout=subprocess.PIPE)
        where = json.loads(sim.stdout.readline())
        modbus = where["modbus"] if where["modbus"].startswith("tcp:") else "tcp:" + where["modbus"]
        done = case.programs.run("printbridge", "print", part, "--printer", printer, "--dir", "state", "--modbus", modbus, "--sink",
                                 where["frames"], "--lockstep")
        sim.terminate()
        sim.wait()
        if done.returncode != 0:
            case.tell(f"print {n}: {done.returncode} {done.stderr.strip()[-200:]}")
            break
        status = json.loads(case.programs.sound("printbridge", "status", "--printer", printer, "--dir", "state", "--json", "-").stdout)
        simulated_s += float(status.get("elapsed_s") or status.get("at_s") or 0)
        case.ask("/api/v1/overview")
        seen.append({**{k: used(p.pid) for k, p in living.items()}, "state": files_below(case.path("state")),
                     "attempts": files_below(case.path("farm/store/attempts")), "hidden": len(kills_parts.hidden(case.folder))})
    case.told = {"prints": len(seen), "simulated_s": round(simulated_s), "third": seen[len(seen) // 3] if seen else None,
                 "end": seen[-1] if seen else None}
    if len(seen) >= 9:
        third, last = seen[len(seen) // 3], seen[-1]
        for name in living:
            if last[name]["files"] > third[name]["files"] + 2 or last[name]["threads"] > third[name]["threads"] + 1:
                case.tell(f"{name}: {third[name]} after a third, {last[name]} at the end")
            if last[name]["rss_kb"] > 1.2 * third[name]["rss_kb"] + 4096:
                case.tell(f"memory of {name} grows: {third[name]['rss_kb']} kB after a third, {last[name]['rss_kb']} kB at the end")
        for name in ("state", "hidden"):
            if last[name] > third[name]:
                case.tell(f"{name}: {third[name]} files after a third, {last[name]} at the end")


def long_print(case):
    """One print of many slices in simulated time: what bridge and machine use after a third and at the end."""
    slices = case.options.slices
    mesh, target, stack = kills_parts.fast_printer(case.path("fast.toml"), slices, travel_mm=0.05 * slices + 4)
    printer = case.path("fast.toml")
    case.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
    case.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um", "110",
                        "--speed-mm-h", "80", timeout=600)
    sim, modbus = case.programs.machine(printer)
    case.children.append(sim)
    bridge = case.programs.start("printbridge", "print", stack, "--printer", printer, "--dir", "state", "--modbus", modbus, "--sink", "null",
                                 "--lockstep", "--quiet")
    seen, begin = [], time.monotonic()
    while bridge.poll() is None:
        try:
            seen.append({"bridge": used(bridge.pid), "machine": used(sim.pid)})
        except (OSError, KeyError):
            break
        time.sleep(0.1)
    if bridge.wait() != 0:
        case.tell(f"ends with {bridge.returncode}")
    status = json.loads(case.programs.sound("printbridge", "status", "--printer", printer, "--dir", "state", "--json", "-").stdout)
    third, last = seen[len(seen) // 3], seen[-2] if len(seen) > 1 else seen[-1]
    case.told = {"slices": slices, "seconds": round(time.monotonic() - begin), "simulated_s": round(float(status.get("at_s") or 0)),
                 "third": third, "end": last}
    for name in third:
        if last[name]["files"] > third[name]["files"] + 2 or last[name]["rss_kb"] > 1.1 * third[name]["rss_kb"] + 4096:
            case.tell(f"{name}: {third[name]} after a third, {last[name]} at the end")


CASES = {f.__name__: f for f in (queue, clients, upload, prints, long_print)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    parser.add_argument("--jobs", type=int, default=20000)
    parser.add_argument("--most-ms", type=float, default=1e9)
    parser.add_argument("--clients", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--upload-mb", type=int, default=4)
    parser.add_argument("--prints", type=int, default=9)
    parser.add_argument("--slices", type=int, default=100, help="of the long print")
    add_options(parser)
    options = parser.parse_args()
    return run_cases(options, CASES, lambda: Case(options), lambda ask, case: ask(case), lambda case: case.told)


if __name__ == "__main__":
    sys.exit(main())
