#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""No text of others moves a terminal's cursor, sets its title, turns its writing or hides a line.

    escapes.py --bin build/bin [--json FILE] [CASE...]

Words that do all this stand wherever others may put them: in names of files, resins, printers, jobs, users, labels, machines
and folders, in archives, stacks, tables, records and states on the disk, and in what machines answer. Every program is run on
a terminal of its own (a pseudo terminal) with them, and nothing of them may arrive there raw. Logs that a program writes are
looked at, too. A line of JSON per case on stdout; exit code 0: all held.
"""

import argparse
import http.server
import json
import os
import pty
import select
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import zipfile

import kills_parts
from cases import add_options, run_cases
from docs_machine_faults import box_stl
from kills_parts import LIGHT, SPEED, Programs

# Title, bell, screen, colour by the one-character form of CSI, direction of writing, another answer of the terminal.
EVIL = "evil\x1b]0;OWNED\x07\x1b[2J\x1b[8mhid\u009b31m\u202etxt\r\x08\x7f\x1b[6n"
# What of it must not come. (A lone \r or \b is the programs' own, in lines that are written again.)
RAW = [b"\x1b]0;OWNED", b"\x07", b"\x1b[8m", b"\xc2\x9b", b"\xe2\x80\xae", b"\x08", b"\x7f", b"\x1b[6n", b"txt\r\x1b"]
NAME = EVIL.replace("\r", "").replace("/", "")


class Case:
    def __init__(self, options):
        self.folder = tempfile.mkdtemp(prefix="escapes-")
        self.programs = Programs(options.bin, self.folder)
        self.wrong, self.told = [], {"runs": 0, "showed the words": 0}

    def path(self, name):
        return os.path.join(self.folder, name)

    def look(self, where, data):
        for raw in RAW:
            if raw in data:
                at = data.index(raw)
                self.wrong.append(f"{where}: {raw!r} in {data[max(0, at - 60):at + 40]!r}")
                print(f"escapes: {self.wrong[-1]}", file=sys.stderr, flush=True)
                return

    def on_terminal(self, *words, seconds=60, keys=b"", stop=None):
        """What a program shows on a terminal; keys are typed after a second, `stop` is sent after two."""
        master, slave = pty.openpty()
        process = subprocess.Popen(self.programs.command(words), cwd=self.folder, env={**self.programs.environment, "TERM": "xterm-256color"},
                                   stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
        os.close(slave)
        shown, begin, typed, stopped = b"", time.monotonic(), False, False
        while time.monotonic() < begin + seconds:
            if select.select([master], [], [], 0.1)[0]:
                try:
                    data = os.read(master, 65536)
                except OSError:
                    break
                if not data:
                    break
                shown += data
            elif process.poll() is not None:
                break
            if keys and not typed and time.monotonic() > begin + 1:
                os.write(master, keys)
                typed = True
            if stop and not stopped and time.monotonic() > begin + 2:
                process.send_signal(stop)
                stopped = True
        if process.poll() is None:
            process.kill()
        process.wait()
        os.close(master)
        self.told["runs"] += 1
        self.told["showed the words"] += b"evil" in shown
        said = " ".join(w.replace(EVIL, "EVIL").replace(NAME, "EVIL") for w in map(str, words))
        self.look(said, shown)
        if process.returncode not in (0, 2, 3, 4, 5, 130, -signal.SIGTERM, -signal.SIGKILL) and not keys:
            self.wrong.append(f"{said}: ends with {process.returncode}: {shown[-200:]!r}")
        return shown.decode(errors="replace")

    def logs(self, folder="."):
        for at, _, files in os.walk(self.path(folder)):
            for name in files:
                if name.endswith((".log", ".txt")) or "log" in name:
                    with open(os.path.join(at, name), "rb") as file:
                        self.look(f"log {name}", file.read())

    def end(self):
        shutil.rmtree(self.folder, ignore_errors=True)


def slicing(case):
    box_stl(case.path(f"{NAME}.stl"), 2, 1.5, 1)
    mesh = f"{NAME}.stl"
    case.on_terminal("slicecorr", "run", mesh, "-o", f"{NAME}.uvj", "--layer-um", "50", *SPEED, *LIGHT)
    for words in (["info", mesh], ["info", f"{NAME}.uvj"], ["info", f"{NAME}.uvj", "--json", "-"], ["verify", f"{NAME}.uvj"],
                  ["convert", f"{NAME}.uvj", "-o", f"{NAME}.goo"], ["convert", f"{NAME}.uvj", "-o", f"{NAME}.cws"],
                  ["solid", f"{NAME}.uvj", "-o", f"{NAME}-solid.stl"], ["report", f"{NAME}.uvj", "-o", f"{NAME}/"],
                  ["run", NAME], [NAME], ["run", mesh, f"--{NAME}"], ["run", mesh, "--printer", NAME, "-o", "x.uvj"],
                  ["run", mesh, "--resin", NAME, "--printer", "small.toml", "-o", "x.uvj", "--layer-um", NAME],
                  ["slice", f"{NAME}/no.stl", "-o", "x.uvj"], ["settings", NAME], ["features", NAME]):
        case.on_terminal("slicecorr", *words)


def files(case):
    """Archives, stacks, meshes and tables that say it themselves."""
    kills_parts.sl1(case.path("good.sl1"), 4)
    for n, name in enumerate(("config.ini", "prusaslicer.ini", NAME, "../" + NAME, f"part{NAME}00000.png")):
        with zipfile.ZipFile(case.path("good.sl1")) as good, zipfile.ZipFile(case.path(f"a{n}.sl1"), "w") as out:
            for entry in good.namelist():
                data = good.read(entry)
                if entry == name:
                    data = b"\n".join(line + (EVIL.encode() if b"=" in line and not line.split(b"=")[1].strip().replace(b".", b"").isdigit()
                                              else b"") for line in data.split(b"\n"))
                out.writestr(entry, data)
            if name not in good.namelist():
                out.writestr(name, b"x")
        for words in (["slicecorr", "info", f"a{n}.sl1"], ["slicecorr", "convert", f"a{n}.sl1", "-o", f"a{n}.uvj"],
                      ["slicecorr", "info", f"a{n}.uvj"], ["slicecorr-post", *LIGHT, f"a{n}.sl1"]):
            case.on_terminal(*words)
    texts = {"bad.off": f"OFF\n3 1 0\n0 0 {EVIL}\n", "bad.obj": f"v 0 0 {EVIL}\nmtllib {EVIL}\nf 1 2 3\n",
             "bad.stl": f"solid {EVIL}\n facet normal {EVIL}\n", "bad.csv": f"{EVIL},b\n1,{EVIL}\n", "bad.json": json.dumps({EVIL: EVIL}),
             "bad.amf": f"<amf unit='{NAME}'/>", "bad.ply": f"ply\nformat ascii 1.0\ncomment {EVIL}\nelement {EVIL} 3\nend_header\n"}
    for name, text in texts.items():
        with open(case.path(name), "w") as file:
            file.write(text)
        case.on_terminal("slicecorr", "info", name)
        case.on_terminal("slicecorr", "run", "good.stl", "-o", "x.uvj", "--layer-um", "50", *LIGHT, "--layers", name)
        case.on_terminal("resinctl", "fit", name)
        case.on_terminal("slicefarm", "submit", name, "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)


def resins(case):
    with open(os.path.join(kills_parts.ROOT, "resins/db/figure-2-2.toml")) as file:
        text = file.read()
    quoted = json.dumps(EVIL)
    lines = []
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        plain = value.startswith('"') and key not in ("name", "kind") and "csv" not in value
        lines.append(f"{key} = {quoted}" if plain else line)
    with open(case.path("figure-2-2.toml"), "w") as file:
        file.write("\n".join(lines) + f"\n{json.dumps('k' + EVIL)} = 1\n")
    with open(case.path("some.toml"), "w") as file:
        file.write(text.replace('maker = "', f'maker = "{quoted[1:-1]}'))
    with open(case.path("printer.toml"), "w") as file:
        file.write(kills_parts.PRINTER.replace('"Works"', quoted).replace('"Small One"', quoted))
    os.rename(case.path("some.toml"), case.path("mine.toml"))
    with open(case.path("mine.toml")) as file:
        mine = file.read().replace('"figure-2-2"', '"mine"')
    with open(case.path("mine.toml"), "w") as file:
        file.write(mine)
    for words in (["validate", "figure-2-2.toml"], ["validate", "mine.toml"], ["validate", "printer.toml"], ["add", "mine.toml", "-m", EVIL],
                  ["add", "mine.toml", "--replace", "-m", EVIL], ["list"], ["show", "mine"], ["history", "mine"], ["diff", "mine", "1", "2"],
                  ["diff", "mine"], ["restore", "mine", "1"], ["show", EVIL], ["export", "mine"], ["import", "figure-2-2.toml"], ["list", "--printers"],
                  ["list", "--search", EVIL], ["add", NAME]):
        case.on_terminal("resinctl", *words)


def farm(case):
    box_stl(case.path("part.stl"), 1, 1.5, 0.5)
    box_stl(case.path(f"{NAME}.stl"), 1, 1.5, 0.5)
    submit = ["slicefarm", "submit", "part.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT]
    for more in (["--name", EVIL], ["--user", EVIL], ["--label", EVIL], ["--out", f"out{NAME}"], ["--ready-by", EVIL], ["--for", EVIL]):
        case.on_terminal(*submit, *more)
    case.on_terminal("slicefarm", "submit", f"{NAME}.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT, "--dry-run")
    case.on_terminal("slicefarm", "submit", f"{NAME}.stl", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)
    case.programs.sound(*submit)
    with open(case.path("jobs.csv"), "w") as file:
        file.write(f'part,name,user\npart.stl,"{NAME}",{NAME}\n"{NAME}",x,y\n')
    case.on_terminal("slicefarm", "submit", "jobs.csv", "--dir", "farm", "--layer-um", "50", *SPEED, *LIGHT)
    # Somebody else's program has written the record.
    with sqlite3.connect(case.path("farm/farm.sqlite")) as db:
        db.execute("UPDATE jobs SET name = name || ?, user = ?", (NAME, NAME))
    looks = (["status"], ["status", "--state", "queued"], ["logs", "1"], ["report", "-o", "-"], ["scans", "1"], ["nodes"], ["gc"], ["set"])
    for words in looks:
        case.on_terminal("slicefarm", *words, "--dir", "farm")
    case.on_terminal("slicefarm", "watch", "--dir", "farm", keys=b"q", seconds=6)
    case.on_terminal("slicefarm", "run", "--dir", "farm", "--until-empty", "--jobs", "1")
    with sqlite3.connect(case.path("farm/farm.sqlite")) as db:
        db.execute("UPDATE jobs SET state = 'failed', message = ?", (EVIL,))
        db.execute("UPDATE attempts SET message = ?, node = ?", (EVIL, EVIL))
    for words in looks:
        case.on_terminal("slicefarm", *words, "--dir", "farm")
    case.on_terminal("slicefarm", "watch", "--dir", "farm", keys=b"q", seconds=6)
    for words in (["set", f"{EVIL}=1"], ["set", f"retry-delay-s={EVIL}"], ["retry", EVIL], ["cancel", EVIL], ["logs", EVIL],
                  ["status", "--state", EVIL], ["run", "--engine", EVIL], ["serve", "--listen", EVIL], ["notify", EVIL]):
        case.on_terminal("slicefarm", *words, "--dir", "farm", seconds=10)
    with open(case.path("farm/notify.toml"), "w") as file:
        file.write(f"[[target]]\nkind = {json.dumps(EVIL)}\n{json.dumps(EVIL)} = 1\n")
    os.chmod(case.path("farm/notify.toml"), 0o600)
    case.on_terminal("slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0", seconds=4, stop=signal.SIGTERM)
    case.on_terminal("slicefarm", "notify", "--dir", "farm", seconds=4, stop=signal.SIGTERM)


class Liar(http.server.BaseHTTPRequestHandler):
    """A printer whose every word is EVIL."""
    protocol_version = "HTTP/1.1"
    status = 200

    def answer(self):
        length = int(self.headers.get("Content-Length") or 0)
        self.rfile.read(length)
        word = EVIL
        body = json.dumps({"api": word, "server": word, "text": word, "version": word, "hostname": word, "state": {"text": word, "error": word, "flags": {}},
                           "job": {"file": {"name": word, "path": word}}, "title": word, "message": word, "error": word, "files": [{"name": word, "path": word}],
                           "printer": {"state": word}, "name": word, "progress": {}, "Status": word, "Path": word}, ensure_ascii=type(self).status == 200).encode()
        self.send_response(type(self).status, "No")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Type", "application/json")
        self.send_header("Location", "/" + EVIL.encode().hex())
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_POST = do_PUT = do_DELETE = do_HEAD = answer

    def log_message(self, *_):
        pass


def machines(case):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Liar)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with open(os.open(case.path("key"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
        file.write("abcdefgh\n")
    kills_parts.sl1(case.path(f"{NAME}.sl1"), 4)
    where = f"127.0.0.1:{server.server_address[1]}"
    case.on_terminal("slicefarm", "machines", "add", EVIL, "--kind", "octoprint", "--address", where, "--format", "sl1", "--dir", "farm")
    for kind in ("octoprint", "prusalink", "prusalink-v1", "nanodlp", "odyssey", "sdcp3"):
        case.on_terminal("slicefarm", "machines", "add", kind, "--kind", kind, "--address", where, "--format", "sl1", "--resolution-px", "160,120",
                         "--key-file", "key", "--dir", "farm", "--note", EVIL)
        case.programs.run("slicefarm", "machines", "add", kind, "--kind", kind, "--address", where, "--format", "sl1", "--resolution-px", "160,120",
                          "--key-file", case.path("key"), "--dir", "farm")
    for status in (200, 404, 409, 500, 301):
        Liar.status = status
        case.on_terminal("slicefarm", "machines", "list", "--dir", "farm")
        for kind in ("octoprint", "prusalink", "prusalink-v1", "nanodlp", "odyssey"):
            for words in (["test", kind], ["send", f"{NAME}.sl1", kind], ["start", kind], ["stop", kind]):
                case.on_terminal("slicefarm", "machines", *words, "--dir", "farm", seconds=30)
    case.on_terminal("slicefarm", "machines", "watch", "--dir", "farm", seconds=4, stop=signal.SIGTERM)
    for words in (["test", EVIL], ["send", "no" + NAME, "octoprint"], ["send", NAME, EVIL]):
        case.on_terminal("slicefarm", "machines", *words, "--dir", "farm")
    case.logs("farm")
    with open(case.path("farm/machines.toml"), "a") as file:
        file.write(f"[[machine]]\nname = {json.dumps(EVIL)}\n{json.dumps(EVIL)} = 1\n")
    case.on_terminal("slicefarm", "machines", "list", "--dir", "farm")
    server.shutdown()


def bridge(case):
    mesh, target, stack = kills_parts.fast_printer(case.path("fast.toml"), 2)
    printer = case.path("fast.toml")
    case.programs.sound("slicecorr", "slice", mesh, "-o", target, "--printer", printer, "--layer-um", "50", "--antialias", "off")
    case.programs.sound("slicecorr", "correct", target, "-o", stack, "--printer", printer, "--resin", "figure-2-2", "--ha-um", "110", *SPEED)
    evil_stack = case.path(f"{NAME}.uvj")
    shutil.copy(stack, evil_stack)
    sim, modbus = case.programs.machine(printer)
    base = ["--printer", printer, "--dir", "state"]
    case.on_terminal("printbridge", "print", evil_stack, *base, "--modbus", modbus, "--sink", "null", "--lockstep")
    sim.terminate()
    sim.wait()
    looks = (["status"], ["status", "--json", "-"], ["report", "-o", "page.html"], ["metrics"], ["reset", "--modbus", "tcp:127.0.0.1:1"])
    for words in looks:
        case.on_terminal("printbridge", *words, *base)
    # Somebody else's program has written the state.
    for at, _, names in os.walk(case.path("state")):
        for name in names:
            if name.endswith((".json", ".jsonl", ".csv")):
                with open(os.path.join(at, name)) as file:
                    text = file.read()
                if name.endswith(".csv"):
                    text = text.replace(",", f",{NAME},", 1)
                else:
                    rows = [json.loads(line) for line in ([text] if name.endswith(".json") else text.splitlines()) if line.strip()]
                    for row in rows:
                        for key, value in list(row.items()):
                            if isinstance(value, str):
                                row[key] = EVIL
                    text = "\n".join(json.dumps(row, ensure_ascii=False) for row in rows) + "\n"
                with open(os.path.join(at, name), "w") as file:
                    file.write(text)
        with open(os.path.join(at, "latch.json"), "w") as file:
            file.write(json.dumps({"reason": EVIL, "message": EVIL, "fault": EVIL, "what": EVIL, "text": EVIL, "time": EVIL}))
    for words in looks:
        case.on_terminal("printbridge", *words, *base)
    case.on_terminal("printbridge", "watch", *base, keys=b"q", seconds=5)
    case.on_terminal("printbridge", "print", evil_stack, *base, "--modbus", "tcp:127.0.0.1:1", "--sink", "null")
    for words in (["print", NAME, *base], ["print", stack, "--printer", NAME], ["print", stack, *base, "--modbus", EVIL],
                  ["print", stack, *base, "--sink", EVIL], [EVIL], ["status", "--printer", printer, "--dir", NAME]):
        case.on_terminal("printbridge", *words, seconds=15)
    case.on_terminal("printer-sim", "--printer", NAME)
    case.on_terminal("printer-sim", "--printer", printer, "--fault", EVIL)


def watch(case):
    os.mkdir(case.path("in"))
    os.mkdir(case.path(f"in/{NAME}"))
    kills_parts.sl1(case.path(f"in/{NAME}.sl1"), 4)
    with open(case.path(f"in/bad{NAME}.sl1"), "w") as file:
        file.write(EVIL)
    os.symlink("/etc/passwd", case.path(f"in/link{NAME}.sl1"))
    for more in ([], ["--log-json"], ["--log", "watch.log"]):
        kills_parts.sl1(case.path(f"in/{NAME}{len(more)}.sl1"), 4)
        case.on_terminal("slicecorr-post", *LIGHT, "--watch", "in", "--settle-s", "0.2", *more, seconds=6, stop=signal.SIGTERM)
    case.logs()
    for words in ([NAME], [*LIGHT, f"no{NAME}.sl1"], [*LIGHT, "--undo", f"no{NAME}.sl1"], ["--watch", NAME], ["--install", NAME]):
        case.on_terminal("slicecorr-post", *words)


CASES = {f.__name__: f for f in (slicing, files, resins, farm, machines, bridge, watch)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", required=True)
    add_options(parser)
    options = parser.parse_args()
    return run_cases(options, CASES, lambda: Case(options), lambda ask, case: ask(case), lambda case: case.told)


if __name__ == "__main__":
    sys.exit(main())
